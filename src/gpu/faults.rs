//! Makes Vulkan calls fail, for tests of what happens then. Each function of a device that may fail is replaced by one
//! that counts its calls and, at the call that a test chose, returns an error instead of calling the driver.
#![allow(unsafe_code)]

use std::ffi::{CStr, c_void};
use std::ptr::null_mut;
use std::sync::atomic::{AtomicPtr, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use ash::vk;

/// The process's faults: Vulkan's functions have no room for a pointer of ours, so that all devices opened with
/// `Options::faults` share them. Tests that use them must follow one another.
pub struct Faults {
    calls: AtomicU64,
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
pub static FAULTS: Faults =
    Faults { calls: AtomicU64::new(0), fault: Mutex::new(Fault { at: None, kind: 0, struck: None }) };

impl Faults {
    /// Lets the call fail that comes after `after` others, with the first, second .. error (`kind`) that its function
    /// may return, in turn. `None`: no call fails.
    pub fn arm(&self, after: Option<u64>, kind: usize) {
        let mut fault = self.lock();
        *fault = Fault { at: after.map(|after| self.calls.load(Ordering::SeqCst) + after), kind, struck: None };
    }

    /// Name of the function that failed since the last call of [`Faults::arm`], and the error that it returned.
    pub fn struck(&self) -> Option<(&'static str, String)> {
        self.lock().struck.map(|(name, result)| (name, result.to_string()))
    }

    /// Number of calls so far.
    pub fn calls(&self) -> u64 {
        self.calls.load(Ordering::SeqCst)
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
            let waits = $name.as_slice() == b"vkWaitForFences";
            if let (Some(error), false) = (error, waits) {
                return error;
            }
            // SAFETY: `replaced` stored the driver's function of this name, which has this type, before it gave this
            // replacement away; the caller keeps that function's own conditions.
            let result = unsafe {
                let drivers: $function::Function = std::mem::transmute($function::DRIVERS.load(Ordering::SeqCst));
                drivers($($value),*)
            };
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

/// The device with functions that fail where [`FAULTS`] says.
pub(super) fn faulty(instance: &ash::Instance, device: &ash::Device) -> ash::Device {
    // SAFETY: the device is alive and belongs to the instance; each replacement has the type of the function that it
    // replaces.
    unsafe {
        let find = |name: &CStr| {
            let found = instance.get_device_proc_addr(device.handle(), name.as_ptr());
            replaced(name, found.map_or(std::ptr::null(), |function| function as *const c_void))
        };
        ash::Device::load_with(find, device.handle())
    }
}
