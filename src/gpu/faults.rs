//! Makes Vulkan calls fail, for tests of what happens then. Each function that may fail is replaced by one that counts
//! its calls and, at the call that a test chose, returns an error instead of calling the driver. All functions are
//! looked up through `vkGetInstanceProcAddr`, whose replacement gives the other replacements away. Names of objects may
//! fail without harm, and are left out.
#![allow(unsafe_code)]

use std::cell::Cell;
use std::ffi::{CStr, c_char, c_int, c_void};
use std::ptr::null_mut;
use std::sync::atomic::{AtomicI64, AtomicPtr, AtomicU64, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};

use ash::vk;

thread_local!(static CONCERNED: Cell<bool> = const { Cell::new(false) });

/// The process's faults: Vulkan's functions have no room for a pointer of ours, so that all contexts which they concern
/// share them. Tests that use them must follow one another.
pub struct Faults {
    calls: AtomicU64,
    instances: AtomicI64,
    fault: Mutex<Fault>,
}

/// The call that fails, and what has failed so far.
#[derive(Debug, Clone, Copy, Default)]
struct Fault {
    /// Number of the call, from 0; `None`: none fails.
    at: Option<u64>,
    /// Which of the errors that the function may return.
    kind: usize,
    /// Name of the function that failed, and what it returned.
    struck: Option<(&'static str, vk::Result)>,
}

/// The faults of this process.
pub static FAULTS: Faults = Faults {
    calls: AtomicU64::new(0),
    instances: AtomicI64::new(0),
    fault: Mutex::new(Fault { at: None, kind: 0, struck: None }),
};

impl Faults {
    /// Lets calls of all contexts fail that this thread opens from now on. Contexts that exist at the same time must be
    /// of one driver, all with or all without validation: a function has one replacement, which knows one driver.
    pub fn concern_contexts_of_this_thread(&self) {
        CONCERNED.set(true);
    }

    /// Whether contexts that this thread opens are concerned.
    pub(super) fn concerns_this_thread(&self) -> bool {
        CONCERNED.get()
    }

    /// Lets the call fail that comes after `after` others, with the first, second .. error (`kind`) that its function
    /// may return, in turn. `None`: no call fails.
    pub fn arm(&self, after: Option<u64>, kind: usize) {
        let mut fault = self.lock();
        *fault = Fault { at: after.map(|after| self.calls.load(Ordering::SeqCst) + after), kind, struck: None };
    }

    /// Loses the devices: from now on, until the next call of [`Faults::arm`], every call fails that may say so.
    pub fn lose_devices(&self) {
        self.lock().struck = Some(("the device", vk::Result::ERROR_DEVICE_LOST));
    }

    /// Name of the function that failed since the last call of [`Faults::arm`], and the name of the error that it
    /// returned, such as `ERROR_DEVICE_LOST`.
    pub fn struck(&self) -> Option<(&'static str, String)> {
        self.lock().struck.map(|(name, result)| (name, format!("{result:?}")))
    }

    /// Number of calls so far.
    pub fn calls(&self) -> u64 {
        self.calls.load(Ordering::SeqCst)
    }

    /// Number of Vulkan instances that exist. (The validation layer reports all other objects that are left.)
    pub fn instances(&self) -> i64 {
        self.instances.load(Ordering::SeqCst)
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Fault> {
        self.fault.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Counts a call; the error that it returns, if it is the one that fails. A device that is lost stays lost.
    fn next(&self, name: &'static str, errors: &[vk::Result]) -> Option<vk::Result> {
        let call = self.calls.fetch_add(1, Ordering::SeqCst);
        let mut fault = self.lock();
        let lost = vk::Result::ERROR_DEVICE_LOST;
        if fault.struck.is_some_and(|(_, result)| result == lost) && errors.contains(&lost) {
            return Some(lost);
        }
        if fault.at != Some(call) {
            return None;
        }
        let error = errors[fault.kind % errors.len()];
        fault.struck = Some((name, error));
        Some(error)
    }
}

const HOST: vk::Result = vk::Result::ERROR_OUT_OF_HOST_MEMORY;
const DEVICE: vk::Result = vk::Result::ERROR_OUT_OF_DEVICE_MEMORY;
const LOST: vk::Result = vk::Result::ERROR_DEVICE_LOST;
const UNMAPPED: vk::Result = vk::Result::ERROR_MEMORY_MAP_FAILED;
const FAILED: vk::Result = vk::Result::ERROR_INITIALIZATION_FAILED;
const OUTDATED: vk::Result = vk::Result::ERROR_OUT_OF_DATE_KHR;
const NO_SURFACE: vk::Result = vk::Result::ERROR_SURFACE_LOST_KHR;
const NO_WINDOW: vk::Result = vk::Result::ERROR_NATIVE_WINDOW_IN_USE_KHR;

/// Defines for each function its replacement, which calls the driver's function unless the call is to fail.
macro_rules! replacements {
    ($($name:literal $function:ident($($kind:ty),*) $errors:expr;)*) => {
        $(
            #[allow(non_snake_case)]
            mod $function {
                use super::*;
                pub static DRIVERS: AtomicPtr<c_void> = AtomicPtr::new(null_mut());
                pub type Function = unsafe extern "system" fn($($kind),*) -> vk::Result;
            }
        )*
        /// The replacement of the driver's function `found` called `name`, or `found` itself if it cannot fail.
        fn replaced(name: &CStr, found: *const c_void) -> *const c_void {
            if found.is_null() {
                return found;
            }
            match name.to_bytes() {
                $(
                    $name => {
                        $function::DRIVERS.store(found.cast_mut(), Ordering::SeqCst);
                        replacement!($function, $name, ($($kind),*), $errors)
                    }
                )*
                _ => found,
            }
        }
    };
}

/// A pointer to the replacement of one function.
macro_rules! replacement {
    ($function:ident, $name:literal, ($a:ty), $errors:expr) => { replacement!(@ $function, $name, $errors, a: $a) };
    ($function:ident, $name:literal, ($a:ty, $b:ty), $errors:expr) => {
        replacement!(@ $function, $name, $errors, a: $a, b: $b)
    };
    ($function:ident, $name:literal, ($a:ty, $b:ty, $c:ty), $errors:expr) => {
        replacement!(@ $function, $name, $errors, a: $a, b: $b, c: $c)
    };
    ($function:ident, $name:literal, ($a:ty, $b:ty, $c:ty, $d:ty), $errors:expr) => {
        replacement!(@ $function, $name, $errors, a: $a, b: $b, c: $c, d: $d)
    };
    ($function:ident, $name:literal, ($a:ty, $b:ty, $c:ty, $d:ty, $e:ty), $errors:expr) => {
        replacement!(@ $function, $name, $errors, a: $a, b: $b, c: $c, d: $d, e: $e)
    };
    ($function:ident, $name:literal, ($a:ty, $b:ty, $c:ty, $d:ty, $e:ty, $f:ty), $errors:expr) => {
        replacement!(@ $function, $name, $errors, a: $a, b: $b, c: $c, d: $d, e: $e, f: $f)
    };
    ($function:ident, $name:literal, ($a:ty, $b:ty, $c:ty, $d:ty, $e:ty, $f:ty, $g:ty, $h:ty), $errors:expr) => {
        replacement!(@ $function, $name, $errors, a: $a, b: $b, c: $c, d: $d, e: $e, f: $f, g: $g, h: $h)
    };
    (@ $function:ident, $name:literal, $errors:expr, $($value:ident: $kind:ty),*) => {{
        unsafe extern "system" fn replacement($($value: $kind),*) -> vk::Result {
            let error = FAULTS.next(const { text($name) }, &$errors);
            // A driver whose wait failed is idle; here the work must end before what it uses is destroyed.
            let waits = $name.ends_with(b"WaitForFences") || $name.ends_with(b"WaitIdle");
            if let (Some(error), false) = (error, waits) {
                return error;
            }
            // SAFETY: `replaced` stored the driver's function of this name, which has this type, before it gave this
            // replacement away; the caller keeps that function's own conditions.
            let result = unsafe {
                let drivers: $function::Function = std::mem::transmute($function::DRIVERS.load(Ordering::SeqCst));
                drivers($($value),*)
            };
            if $name.as_slice() == b"vkCreateInstance" && result == vk::Result::SUCCESS {
                FAULTS.instances.fetch_add(1, Ordering::SeqCst);
            }
            error.unwrap_or(result)
        }
        replacement as *const c_void
    }};
}

/// The name of a function as text.
const fn text(name: &'static [u8]) -> &'static str {
    match std::str::from_utf8(name) {
        Ok(text) => text,
        Err(_) => "?",
    }
}

type Callbacks = *const vk::AllocationCallbacks<'static>;

replacements! {
    b"vkEnumerateInstanceLayerProperties" enumerate_layers(*mut u32, *mut vk::LayerProperties) [HOST, DEVICE];
    b"vkEnumerateInstanceExtensionProperties" enumerate_extensions(
        *const c_char, *mut u32, *mut vk::ExtensionProperties) [HOST, DEVICE];
    b"vkCreateInstance" create_instance(*const vk::InstanceCreateInfo<'static>, Callbacks, *mut vk::Instance)
        [FAILED, HOST, DEVICE];
    b"vkEnumeratePhysicalDevices" enumerate_physical_devices(vk::Instance, *mut u32, *mut vk::PhysicalDevice)
        [FAILED, HOST, DEVICE];
    b"vkEnumerateDeviceExtensionProperties" enumerate_device_extensions(
        vk::PhysicalDevice, *const c_char, *mut u32, *mut vk::ExtensionProperties) [HOST, DEVICE];
    b"vkCreateDevice" create_device(
        vk::PhysicalDevice, *const vk::DeviceCreateInfo<'static>, Callbacks, *mut vk::Device) [FAILED, HOST, LOST];
    b"vkCreateDebugUtilsMessengerEXT" create_messenger(
        vk::Instance, *const vk::DebugUtilsMessengerCreateInfoEXT<'static>, Callbacks,
        *mut vk::DebugUtilsMessengerEXT) [HOST];
    b"vkGetPhysicalDeviceSurfaceSupportKHR" surface_support(
        vk::PhysicalDevice, u32, vk::SurfaceKHR, *mut vk::Bool32) [NO_SURFACE, HOST, DEVICE];
    b"vkGetPhysicalDeviceSurfaceCapabilitiesKHR" surface_capabilities(
        vk::PhysicalDevice, vk::SurfaceKHR, *mut vk::SurfaceCapabilitiesKHR) [NO_SURFACE, HOST, DEVICE];
    b"vkGetPhysicalDeviceSurfaceFormatsKHR" surface_formats(
        vk::PhysicalDevice, vk::SurfaceKHR, *mut u32, *mut vk::SurfaceFormatKHR) [NO_SURFACE, HOST, DEVICE];
    b"vkGetPhysicalDeviceSurfacePresentModesKHR" surface_modes(
        vk::PhysicalDevice, vk::SurfaceKHR, *mut u32, *mut vk::PresentModeKHR) [NO_SURFACE, HOST, DEVICE];
    b"vkCreateXlibSurfaceKHR" create_xlib_surface(
        vk::Instance, *const vk::XlibSurfaceCreateInfoKHR<'static>, Callbacks, *mut vk::SurfaceKHR) [HOST, DEVICE];
    b"vkCreateXcbSurfaceKHR" create_xcb_surface(
        vk::Instance, *const vk::XcbSurfaceCreateInfoKHR<'static>, Callbacks, *mut vk::SurfaceKHR) [HOST, DEVICE];
    b"vkCreateWaylandSurfaceKHR" create_wayland_surface(
        vk::Instance, *const vk::WaylandSurfaceCreateInfoKHR<'static>, Callbacks, *mut vk::SurfaceKHR) [HOST, DEVICE];
    b"vkCreateSwapchainKHR" create_swapchain(
        vk::Device, *const vk::SwapchainCreateInfoKHR<'static>, Callbacks, *mut vk::SwapchainKHR)
        [NO_WINDOW, HOST, LOST];
    b"vkGetSwapchainImagesKHR" get_swapchain_images(vk::Device, vk::SwapchainKHR, *mut u32, *mut vk::Image)
        [HOST, DEVICE];
    b"vkAcquireNextImageKHR" acquire_next_image(
        vk::Device, vk::SwapchainKHR, u64, vk::Semaphore, vk::Fence, *mut u32) [NO_SURFACE, LOST, OUTDATED];
    b"vkQueuePresentKHR" queue_present(vk::Queue, *const vk::PresentInfoKHR<'static>) [NO_SURFACE, LOST, OUTDATED];
    b"vkCreateSemaphore" create_semaphore(
        vk::Device, *const vk::SemaphoreCreateInfo<'static>, Callbacks, *mut vk::Semaphore) [HOST, DEVICE];
    b"vkGetMemoryFdKHR" get_memory_fd(vk::Device, *const vk::MemoryGetFdInfoKHR<'static>, *mut c_int)
        [HOST, vk::Result::ERROR_TOO_MANY_OBJECTS];
    b"vkQueueWaitIdle" queue_wait_idle(vk::Queue) [LOST, HOST, DEVICE];
    b"vkAllocateMemory" allocate_memory(
        vk::Device, *const vk::MemoryAllocateInfo<'static>, Callbacks, *mut vk::DeviceMemory) [DEVICE, HOST];
    b"vkMapMemory" map_memory(
        vk::Device, vk::DeviceMemory, vk::DeviceSize, vk::DeviceSize, vk::MemoryMapFlags, *mut *mut c_void)
        [UNMAPPED, HOST];
    b"vkBindBufferMemory" bind_buffer_memory(vk::Device, vk::Buffer, vk::DeviceMemory, vk::DeviceSize) [DEVICE, HOST];
    b"vkBindImageMemory" bind_image_memory(vk::Device, vk::Image, vk::DeviceMemory, vk::DeviceSize) [DEVICE, HOST];
    b"vkCreateBuffer" create_buffer(
        vk::Device, *const vk::BufferCreateInfo<'static>, Callbacks, *mut vk::Buffer) [HOST, DEVICE];
    b"vkCreateBufferView" create_buffer_view(
        vk::Device, *const vk::BufferViewCreateInfo<'static>, Callbacks, *mut vk::BufferView) [HOST, DEVICE];
    b"vkCreateImage" create_image(
        vk::Device, *const vk::ImageCreateInfo<'static>, Callbacks, *mut vk::Image) [HOST, DEVICE];
    b"vkCreateImageView" create_image_view(
        vk::Device, *const vk::ImageViewCreateInfo<'static>, Callbacks, *mut vk::ImageView) [HOST, DEVICE];
    b"vkCreateShaderModule" create_shader_module(
        vk::Device, *const vk::ShaderModuleCreateInfo<'static>, Callbacks, *mut vk::ShaderModule) [HOST, DEVICE];
    b"vkCreateDescriptorSetLayout" create_descriptor_set_layout(
        vk::Device, *const vk::DescriptorSetLayoutCreateInfo<'static>, Callbacks, *mut vk::DescriptorSetLayout)
        [HOST, DEVICE];
    b"vkCreatePipelineLayout" create_pipeline_layout(
        vk::Device, *const vk::PipelineLayoutCreateInfo<'static>, Callbacks, *mut vk::PipelineLayout) [HOST, DEVICE];
    b"vkCreatePipelineCache" create_pipeline_cache(
        vk::Device, *const vk::PipelineCacheCreateInfo<'static>, Callbacks, *mut vk::PipelineCache) [HOST, DEVICE];
    b"vkGetPipelineCacheData" get_pipeline_cache_data(vk::Device, vk::PipelineCache, *mut usize, *mut c_void)
        [HOST, DEVICE];
    b"vkCreateComputePipelines" create_compute_pipelines(
        vk::Device, vk::PipelineCache, u32, *const vk::ComputePipelineCreateInfo<'static>, Callbacks,
        *mut vk::Pipeline) [HOST, DEVICE];
    b"vkCreateGraphicsPipelines" create_graphics_pipelines(
        vk::Device, vk::PipelineCache, u32, *const vk::GraphicsPipelineCreateInfo<'static>, Callbacks,
        *mut vk::Pipeline) [HOST, DEVICE];
    b"vkCreateDescriptorPool" create_descriptor_pool(
        vk::Device, *const vk::DescriptorPoolCreateInfo<'static>, Callbacks, *mut vk::DescriptorPool) [HOST, DEVICE];
    b"vkAllocateDescriptorSets" allocate_descriptor_sets(
        vk::Device, *const vk::DescriptorSetAllocateInfo<'static>, *mut vk::DescriptorSet) [HOST, DEVICE];
    b"vkCreateQueryPool" create_query_pool(
        vk::Device, *const vk::QueryPoolCreateInfo<'static>, Callbacks, *mut vk::QueryPool) [HOST, DEVICE];
    b"vkGetQueryPoolResults" get_query_pool_results(
        vk::Device, vk::QueryPool, u32, u32, usize, *mut c_void, vk::DeviceSize, vk::QueryResultFlags) [LOST, HOST];
    b"vkCreateCommandPool" create_command_pool(
        vk::Device, *const vk::CommandPoolCreateInfo<'static>, Callbacks, *mut vk::CommandPool) [HOST, DEVICE];
    b"vkResetCommandPool" reset_command_pool(vk::Device, vk::CommandPool, vk::CommandPoolResetFlags) [DEVICE];
    b"vkAllocateCommandBuffers" allocate_command_buffers(
        vk::Device, *const vk::CommandBufferAllocateInfo<'static>, *mut vk::CommandBuffer) [HOST, DEVICE];
    b"vkBeginCommandBuffer" begin_command_buffer(
        vk::CommandBuffer, *const vk::CommandBufferBeginInfo<'static>) [HOST, DEVICE];
    b"vkEndCommandBuffer" end_command_buffer(vk::CommandBuffer) [HOST, DEVICE];
    b"vkCreateFence" create_fence(
        vk::Device, *const vk::FenceCreateInfo<'static>, Callbacks, *mut vk::Fence) [HOST, DEVICE];
    b"vkResetFences" reset_fences(vk::Device, u32, *const vk::Fence) [DEVICE];
    b"vkWaitForFences" wait_for_fences(vk::Device, u32, *const vk::Fence, vk::Bool32, u64) [LOST, HOST, DEVICE];
    b"vkQueueSubmit2" queue_submit2(vk::Queue, u32, *const vk::SubmitInfo2<'static>, vk::Fence) [LOST, HOST, DEVICE];
}

/// The Vulkan loader, whose library stays loaded.
static LOADER: OnceLock<ash::Entry> = OnceLock::new();
/// The loader's functions of these names.
static GET_DEVICE_PROC_ADDR: AtomicPtr<c_void> = AtomicPtr::new(null_mut());
static DESTROY_INSTANCE: AtomicPtr<c_void> = AtomicPtr::new(null_mut());

/// Vulkan with functions that fail where [`FAULTS`] says.
pub(super) fn faulty(entry: ash::Entry) -> ash::Entry {
    LOADER.get_or_init(|| entry);
    // SAFETY: the function finds those of the loader, which stays loaded, or replacements of the same types.
    unsafe { ash::Entry::from_static_fn(ash::StaticFn { get_instance_proc_addr }) }
}

unsafe extern "system" fn get_instance_proc_addr(
    instance: vk::Instance,
    name: *const c_char,
) -> vk::PFN_vkVoidFunction {
    let loader = LOADER.get()?;
    // SAFETY: the caller keeps the conditions of the loader's function.
    let (found, name) = unsafe { (loader.get_instance_proc_addr(instance, name)?, CStr::from_ptr(name)) };
    let found = found as *const c_void;
    let given = match name.to_bytes() {
        b"vkGetInstanceProcAddr" => get_instance_proc_addr as *const c_void,
        b"vkGetDeviceProcAddr" => {
            GET_DEVICE_PROC_ADDR.store(found.cast_mut(), Ordering::SeqCst);
            get_device_proc_addr as *const c_void
        }
        b"vkDestroyInstance" => {
            DESTROY_INSTANCE.store(found.cast_mut(), Ordering::SeqCst);
            destroy_instance as *const c_void
        }
        _ => replaced(name, found),
    };
    function(given)
}

unsafe extern "system" fn get_device_proc_addr(device: vk::Device, name: *const c_char) -> vk::PFN_vkVoidFunction {
    // SAFETY: the loader's function was stored before this one was given away; the caller keeps its conditions.
    unsafe {
        let find: vk::PFN_vkGetDeviceProcAddr = std::mem::transmute(GET_DEVICE_PROC_ADDR.load(Ordering::SeqCst));
        let found = find(device, name)?;
        function(replaced(CStr::from_ptr(name), found as *const c_void))
    }
}

unsafe extern "system" fn destroy_instance(instance: vk::Instance, callbacks: Callbacks) {
    FAULTS.instances.fetch_sub(1, Ordering::SeqCst);
    // SAFETY: as for `get_device_proc_addr`.
    unsafe {
        let destroy: unsafe extern "system" fn(vk::Instance, Callbacks) =
            std::mem::transmute(DESTROY_INSTANCE.load(Ordering::SeqCst));
        destroy(instance, callbacks);
    }
}

/// The Vulkan function at an address that is not null.
fn function(address: *const c_void) -> vk::PFN_vkVoidFunction {
    // SAFETY: pointers to functions have the size of pointers to data on all platforms with Vulkan.
    Some(unsafe { std::mem::transmute::<*const c_void, unsafe extern "system" fn()>(address) })
}
