//! A Vulkan device, its one queue and its memory: made once, shared by everything in this room.
#![allow(unsafe_code)]

use std::ffi::{CStr, c_char};
use std::mem::ManuallyDrop;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock};

use ash::vk;
use gpu_allocator::vulkan as memory;

use super::debug::{Labels, Messages};
use super::device::{self, Candidate, DeviceInfo, DeviceKind};
use super::host::{HostDevice, QueueGuard};
use super::log::{Level, Log};
use super::threads::Threads;
use super::{cache, failed, kernel, threads};
use crate::error::{Error, Result};

const VALIDATION_LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";
/// Standard local size of kernels: two warps, one wavefront; any size from 64 to 1024 was as fast on lavapipe.
const GROUP_SIZE: u32 = 64;
/// Local size of kernels that meet at barriers, on a GPU.
const REDUCE_SIZE: u32 = 128;
/// Memory is taken from the driver in blocks of this size, bytes.
const MEMORY_BLOCK: u64 = 16 << 20;

/// Elements of 16 bytes that a texel buffer has to hold for texel arrays to be used: a gigabyte, less than most GPUs have. Where
/// there are fewer, large scenes would not run.
const TEXEL_ELEMENTS: u32 = 1 << 26;

/// How kernels reach arrays of vectors that they only read: see `shaders/shared/arrays.glsl`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Arrays {
    /// Through texel buffers.
    Texel,
    /// Through storage buffers.
    Storage,
}

/// How to choose and open a device.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Index, or part of the name in any case; `None`: discrete before integrated, virtual, CPU.
    pub device: Option<String>,
    /// Use the Khronos validation layer with synchronisation validation.
    pub validation: bool,
    /// What showing in a window takes of the instance: see `display_extensions`. Empty: nothing
    /// is shown.
    pub display: Vec<&'static CStr>,
    /// With how many threads lavapipe works, by `LP_NUM_THREADS` in the process's environment, unless it is set already: ask
    /// for it only where no other thread of the process looks at the environment meanwhile. `None`: the environment stays as
    /// it is, and lavapipe takes all cores.
    pub threads: Option<Threads>,
    /// Folder where prepared bodies, compiled pipelines and what was measured of devices are kept for later runs, made where
    /// it is missing. `None`: nothing is kept. The usual one: [`Options::user_cache`]. A folder that cannot be written
    /// is passed over.
    pub cache: Option<PathBuf>,
    /// Measure, in a fraction of a second, which of two ways is faster on the device where nobody says: arrays through texel or
    /// storage buffers, and the depth stage by compute or graphics. Done once a context; with a cache once a device. False: texel
    /// buffers where they are large, and compute.
    pub measure: bool,
    /// Names of shaders, and the SPIR-V that stands for the library's own of that name, with the same buffers,
    /// whichever kind of arrays is chosen. For tests
    /// that show that a check can fail; a name that the library does not have is an error.
    pub replaced: Vec<(String, Vec<u8>)>,
    /// How kernels reach arrays of vectors that they only read; `None`: see [`Context::arrays`].
    pub arrays: Option<Arrays>,
    /// The most elements that a texel buffer may have, if the device allows more. For tests.
    pub texel_elements: Option<u32>,
    /// Hears what there is to say. The validation layer's messages go there too, and are then not kept.
    pub log: Log,
}

impl Options {
    /// The user's cache folder: `PALPATE_CACHE`, else `palpate` in `XDG_CACHE_HOME` (or the system's like), else in `~/.cache`.
    pub fn user_cache() -> Option<PathBuf> {
        cache::user_folder()
    }

    /// As the program opens devices: what takes long is kept in the user's cache, and the faster ways are measured, once where
    /// there is such a cache, else for each context.
    pub fn of_program() -> Options {
        Options { cache: Options::user_cache(), measure: true, ..Options::default() }
    }
}

/// An open device. All calls may come from any thread; submits are serialised.
pub struct Context {
    // In the order of `Drop`.
    pub(super) allocator: ManuallyDrop<Mutex<memory::Allocator>>,
    pub(super) cache: vk::PipelineCache,
    pub(super) device: ash::Device,
    pub(super) labels: Labels,
    messenger: Option<(ash::ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    pub(super) instance: ash::Instance,
    #[cfg_attr(not(feature = "window"), allow(dead_code))]
    pub(super) entry: ash::Entry,
    messages: Box<Messages>,
    queue: Mutex<vk::Queue>,
    /// Of another program's device, which is left as it is.
    host: Option<HostDevice>,
    pub(super) queue_family: u32,
    pub(super) limits: vk::PhysicalDeviceLimits,
    pub(super) timestamp_bits: u32,
    pub(super) allocated: AtomicU64,
    info: DeviceInfo,
    subgroup_size: u32,
    int64_atomics: bool,
    fragment_stores: bool,
    #[cfg_attr(not(feature = "window"), allow(dead_code))]
    pub(super) physical: vk::PhysicalDevice,
    /// Whether it was opened to show in windows.
    #[cfg_attr(not(feature = "window"), allow(dead_code))]
    pub(super) presents: bool,
    /// Where arrays can be handed to other programs.
    pub(super) external_memory: Option<ash::khr::external_memory_fd::Device>,
    memory: vk::PhysicalDeviceMemoryProperties,
    cache_key: String,
    cache_folder: Option<PathBuf>,
    measures: bool,
    measured_paths: OnceLock<[f64; 2]>,
    arrays: OnceLock<Arrays>,
    arrays_asked_for: Option<Arrays>,
    log: Log,
    pub(super) replaced: Vec<(String, Vec<u8>)>,
}

impl Context {
    /// Opens a device. [`Error::NoDevice`] says what is missing and how to get it.
    pub fn open(options: &Options) -> Result<Arc<Context>> {
        for (name, _) in &options.replaced {
            kernel::known(name, Arrays::Texel)?;
        }
        threads::choose(options.threads);
        let entry = load()?;
        let messages = Box::new(Messages::heard_by(options.log.clone()));
        let (instance, debug) = create_instance(&entry, options, &messages)?;
        let chosen = device::candidates(&instance).and_then(|all| device::choose(all, options.device.as_deref()));
        let chosen = match chosen {
            Ok(chosen) => chosen,
            Err(error) => {
                // SAFETY: nothing made from the instance is left.
                unsafe { instance.destroy_instance(None) };
                return Err(error);
            }
        };
        let device = match create_device(&instance, &chosen, !options.display.is_empty()) {
            Ok(device) => device,
            Err(error) => {
                // SAFETY: as above.
                unsafe { instance.destroy_instance(None) };
                return Err(error);
            }
        };
        // SAFETY: the device was created with queue 0 of this family.
        let queue = unsafe { device.get_device_queue(chosen.queue_family, 0) };
        let labels = Labels(debug.then(|| ash::ext::debug_utils::Device::new(&instance, &device)));
        let mut opened = Opened { entry, instance, device, queue, labels, messenger: None, messages, host: None };
        if options.validation && debug {
            let utils = ash::ext::debug_utils::Instance::new(&opened.entry, &opened.instance);
            // SAFETY: `messages` is boxed and outlives the messenger (see `Drop`).
            let messenger = unsafe { utils.create_debug_utils_messenger(&opened.messages.create_info(), None) };
            match messenger {
                Ok(messenger) => opened.messenger = Some((utils, messenger)),
                Err(result) => {
                    opened.close();
                    return Err(failed("vkCreateDebugUtilsMessengerEXT", "set-up")(result));
                }
            }
        }
        Self::of(opened, chosen, options)
    }

    /// Uses a device that another program opened, and leaves it open. `options` but for `device`, `validation` and
    /// `threads`, which are the host's business.
    ///
    /// # Safety
    /// The handles are of one instance of Vulkan 1.3 and alive for as long as the context, which buffers, simulations and
    /// recordings hold on to; the device was created with [`HostDevice::FEATURES`] and whatever else `host` says is enabled.
    /// The host uses the queue only while it holds the lock, whose functions may be called from any thread; or without one, at
    /// no time at which any of the engine's calls is under way.
    #[doc(hidden)]
    pub unsafe fn on_host(host: HostDevice, options: &Options) -> Result<Arc<Context>> {
        use vk::Handle;
        // SAFETY: the caller's promise.
        let (entry, instance) = unsafe { host.instance()? };
        let chosen = host.candidate(&instance)?;
        // SAFETY: the caller's promise.
        let device = unsafe { ash::Device::load(instance.fp_v1_0(), vk::Device::from_raw(host.device)) };
        let queue = vk::Queue::from_raw(host.queue);
        let (labels, messages) = (Labels(None), Box::new(Messages::default()));
        let host = Some(host);
        Self::of(Opened { entry, instance, device, queue, labels, messenger: None, messages, host }, chosen, options)
    }

    fn of(mut opened: Opened, chosen: Candidate, options: &Options) -> Result<Arc<Context>> {
        let made = create_allocator(&opened, &chosen).and_then(|allocator| {
            let cache = create_cache(&opened.device, options.cache.as_deref(), &chosen.cache_key)?;
            Ok((allocator, cache))
        });
        let (allocator, cache) = match made {
            Ok(made) => made,
            Err(error) => {
                opened.close();
                return Err(error);
            }
        };
        let Opened { entry, instance, device, queue, labels, messenger, messages, host } = opened;
        let presents = host.is_none() && !options.display.is_empty();
        let external = || ash::khr::external_memory_fd::Device::new(&instance, &device);
        let external_memory = chosen.external_memory_fd.then(external);
        // SAFETY: the physical device is of this live instance.
        let memory = unsafe { instance.get_physical_device_memory_properties(chosen.physical) };
        let mut limits = chosen.properties.limits;
        limits.max_texel_buffer_elements =
            options.texel_elements.unwrap_or(u32::MAX).min(limits.max_texel_buffer_elements);
        options.log.tell(Level::Note, &format!("device: {} ({})", chosen.info.name, chosen.info.driver));
        Ok(Arc::new(Context {
            allocator: ManuallyDrop::new(Mutex::new(allocator)),
            cache,
            device,
            labels,
            messenger,
            instance,
            entry,
            messages,
            queue: Mutex::new(queue),
            host,
            queue_family: chosen.queue_family,
            limits,
            timestamp_bits: chosen.timestamp_bits,
            allocated: AtomicU64::new(0),
            info: chosen.info,
            subgroup_size: chosen.subgroup_size,
            int64_atomics: chosen.int64_atomics,
            fragment_stores: chosen.fragment_stores,
            physical: chosen.physical,
            presents,
            external_memory,
            memory,
            cache_key: chosen.cache_key,
            cache_folder: options.cache.clone(),
            measures: options.measure,
            measured_paths: OnceLock::new(),
            arrays_asked_for: options.arrays,
            arrays: options.arrays.map_or_else(OnceLock::new, OnceLock::from),
            log: options.log.clone(),
            replaced: options.replaced.clone(),
        }))
    }

    /// All devices, usable or not.
    pub fn list() -> Result<Vec<DeviceInfo>> {
        let entry = load()?;
        let (instance, _) = create_instance(&entry, &Options::default(), &Messages::default())?;
        let list = device::candidates(&instance).map(|all| all.into_iter().map(|c| c.info).collect());
        // SAFETY: nothing made from the instance is left.
        unsafe { instance.destroy_instance(None) };
        list
    }

    /// The driver's name of the device.
    pub fn device_name(&self) -> &str {
        &self.info.name
    }

    /// Driver name and version.
    pub fn driver(&self) -> &str {
        &self.info.driver
    }

    /// What sort of device it is.
    pub fn kind(&self) -> DeviceKind {
        self.info.kind
    }

    /// Standard local size of a kernel, invocations.
    #[doc(hidden)]
    pub fn group_size(&self) -> u32 {
        GROUP_SIZE
    }

    /// Local size of kernels of one workgroup an item that meet at barriers, invocations. On a CPU the subgroup size:
    /// then a workgroup is one vector and barriers cost nothing.
    #[doc(hidden)]
    pub fn reduce_size(&self) -> u32 {
        if self.info.kind == DeviceKind::Cpu { self.subgroup_size.max(1) } else { REDUCE_SIZE }
    }

    /// Invocations of a subgroup. For choosing variants only: no kernel may rely on it.
    #[doc(hidden)]
    pub fn subgroup_size(&self) -> u32 {
        self.subgroup_size
    }

    /// Whether shaders may use 64-bit atomics on storage buffers (optional: have a fallback).
    #[doc(hidden)]
    pub fn int64_atomics(&self) -> bool {
        self.int64_atomics
    }

    /// Whether fragment shaders may write storage buffers (optional: [`super::RasterPipeline`] needs it).
    #[doc(hidden)]
    pub fn fragment_stores(&self) -> bool {
        self.fragment_stores
    }

    /// How kernels reach arrays of vectors that they only read: as asked for, else as chosen, else through texel buffers where
    /// these are large.
    pub fn arrays(&self) -> Arrays {
        let by_limit = || if self.has_large_texel_buffers() { Arrays::Texel } else { Arrays::Storage };
        *self.arrays.get_or_init(by_limit)
    }

    /// Whether texel buffers hold what large scenes have.
    #[doc(hidden)]
    pub fn has_large_texel_buffers(&self) -> bool {
        self.limits.max_texel_buffer_elements >= TEXEL_ELEMENTS
    }

    /// What [`Options::arrays`] asked for.
    #[doc(hidden)]
    pub fn arrays_asked_for(&self) -> Option<Arrays> {
        self.arrays_asked_for
    }

    /// Chooses for all kernels made from now on, if nothing was asked for or chosen before.
    #[doc(hidden)]
    pub fn choose_arrays(&self, arrays: Arrays) {
        self.arrays.get_or_init(|| arrays);
    }

    /// Storage buffers that a kernel may have.
    #[doc(hidden)]
    pub fn storage_buffers(&self) -> u32 {
        self.limits.max_per_stage_descriptor_storage_buffers
    }

    /// Largest storage buffer binding, bytes, and largest texel buffer, elements of 16 bytes.
    #[doc(hidden)]
    pub fn array_limits(&self) -> (u64, u64) {
        (u64::from(self.limits.max_storage_buffer_range), u64::from(self.limits.max_texel_buffer_elements))
    }

    /// Device memory held by buffers, bytes.
    pub fn bytes_allocated(&self) -> u64 {
        self.allocated.load(Ordering::Relaxed)
    }

    /// Whether arrays can be made in memory that other programs import ([`super::Buffer::export`]).
    #[doc(hidden)]
    pub fn shares_memory(&self) -> bool {
        self.external_memory.is_some()
    }

    /// The first type of these (a bit each) in the device's own memory.
    pub(super) fn device_memory_type(&self, types: u32) -> Option<u32> {
        let own = vk::MemoryPropertyFlags::DEVICE_LOCAL;
        let all = self.memory.memory_types_as_slice().iter().zip(0..);
        all.into_iter().find(|(kind, i)| types & (1 << i) != 0 && kind.property_flags.contains(own)).map(|(_, i)| i)
    }

    /// Takes the validation layer's messages; empty when all is clean or validation is off.
    pub fn validation_messages(&self) -> Vec<String> {
        self.messages.drain()
    }

    /// [`Options::cache`].
    #[doc(hidden)]
    pub fn cache_folder(&self) -> Option<&Path> {
        self.cache_folder.as_deref()
    }

    /// Times of the depth stage's two paths, us, once they are measured.
    #[doc(hidden)]
    pub fn measured_paths(&self) -> &OnceLock<[f64; 2]> {
        &self.measured_paths
    }

    /// Whether the kind of arrays is settled: asked for, chosen, or used by a kernel.
    #[doc(hidden)]
    pub fn has_arrays(&self) -> bool {
        self.arrays.get().is_some()
    }

    /// [`Options::measure`].
    #[doc(hidden)]
    pub fn measures(&self) -> bool {
        self.measures
    }

    /// Keeps compiled pipelines for the next run, where there is a cache. Also done when the context is dropped.
    #[doc(hidden)]
    pub fn save_pipeline_cache(&self) {
        let Some(folder) = self.cache_folder() else { return };
        // SAFETY: the cache belongs to this device; the driver locks it itself.
        if let Ok(blob) = unsafe { self.device.get_pipeline_cache_data(self.cache) } {
            cache::save(folder, &self.cache_key, &blob);
        }
    }

    /// Says something to whoever hears.
    #[doc(hidden)]
    pub fn tell(&self, level: Level, message: &str) {
        self.log.tell(level, message);
    }

    /// The queue, held by one thread at a time.
    pub(super) fn queue(&self) -> QueueGuard<'_> {
        let queue = self.queue.lock().unwrap_or_else(|e| e.into_inner());
        QueueGuard::new(queue, self.host.as_ref().and_then(|host| host.lock))
    }

    /// Waits for all that was submitted, whatever became of it. On a host's device for its work on the queue as well.
    pub(super) fn wait_idle(&self) {
        let queue = self.queue();
        // SAFETY: the queue is alive and locked. Where the device is lost there is nothing to wait for.
        let _ = unsafe { self.device.queue_wait_idle(queue.queue()) };
    }

    pub(super) fn allocator(&self) -> MutexGuard<'_, memory::Allocator> {
        self.allocator.lock().unwrap_or_else(|e| e.into_inner())
    }
}

impl Drop for Context {
    fn drop(&mut self) {
        // SAFETY: buffers, kernels and recordings hold an Arc of this context, so none is left, and each recording
        // waited for its own work. Children go before their parents, and nothing is used afterwards.
        unsafe {
            self.wait_idle();
            self.save_pipeline_cache();
            ManuallyDrop::drop(&mut self.allocator);
            self.device.destroy_pipeline_cache(self.cache, None);
            if self.host.is_some() {
                return;
            }
            self.device.destroy_device(None);
            if let Some((utils, messenger)) = self.messenger.take() {
                utils.destroy_debug_utils_messenger(messenger, None);
            }
            self.instance.destroy_instance(None);
        }
    }
}

/// What a context is made of, whoever opened it.
struct Opened {
    entry: ash::Entry,
    instance: ash::Instance,
    device: ash::Device,
    queue: vk::Queue,
    labels: Labels,
    messenger: Option<(ash::ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    messages: Box<Messages>,
    host: Option<HostDevice>,
}

impl Opened {
    /// Closes all that is not a host's, where no context comes of it.
    fn close(&mut self) {
        if self.host.is_some() {
            return;
        }
        // SAFETY: nothing made of them is left, and they are not used again.
        unsafe {
            self.device.destroy_device(None);
            if let Some((utils, messenger)) = self.messenger.take() {
                utils.destroy_debug_utils_messenger(messenger, None);
            }
            self.instance.destroy_instance(None);
        }
    }
}

fn create_allocator(opened: &Opened, chosen: &Candidate) -> Result<memory::Allocator> {
    let description = memory::AllocatorCreateDesc {
        instance: opened.instance.clone(),
        device: opened.device.clone(),
        physical_device: chosen.physical,
        debug_settings: Default::default(),
        buffer_device_address: false,
        allocation_sizes: gpu_allocator::AllocationSizes::new(MEMORY_BLOCK, MEMORY_BLOCK),
    };
    memory::Allocator::new(&description)
        .map_err(|e| Error::NoDevice(format!("{}: its memory cannot be managed: {e}", chosen.info.name)))
}

pub(super) fn load() -> Result<ash::Entry> {
    // SAFETY: the system's Vulkan loader is trusted to initialise soundly; it stays loaded as long as the entry.
    unsafe { ash::Entry::load() }
        .map_err(|e| Error::NoDevice(format!("the Vulkan loader cannot be loaded ({e}). {}", device::REMEDY)))
}

/// The instance, and whether it has debug utilities.
fn create_instance(entry: &ash::Entry, options: &Options, messages: &Messages) -> Result<(ash::Instance, bool)> {
    let validation = options.validation;
    // SAFETY (this and the next): plain queries of a loaded entry.
    let layers = unsafe { entry.enumerate_instance_layer_properties() }.unwrap_or_default();
    let extensions = unsafe { entry.enumerate_instance_extension_properties(None) }.unwrap_or_default();
    if validation && !layers.iter().any(|l| l.layer_name_as_c_str() == Ok(VALIDATION_LAYER)) {
        return Err(Error::NoDevice(
            "validation was asked for, but VK_LAYER_KHRONOS_validation is missing; on Debian or Ubuntu run ./setup.sh, \
             or: apt-get install vulkan-validationlayers"
                .into(),
        ));
    }
    let debug = extensions.iter().any(|e| e.extension_name_as_c_str() == Ok(ash::ext::debug_utils::NAME));
    let mut names: Vec<*const c_char> = Vec::new();
    if debug {
        names.push(ash::ext::debug_utils::NAME.as_ptr());
    }
    if validation {
        names.push(ash::ext::validation_features::NAME.as_ptr());
    }
    let lacking =
        options.display.iter().find(|name| !extensions.iter().any(|e| e.extension_name_as_c_str() == Ok(**name)));
    if let Some(name) = lacking {
        let name = name.to_string_lossy();
        return Err(Error::NoDevice(format!(
            "Vulkan cannot show in a window here: {name} is missing. {}",
            device::REMEDY
        )));
    }
    names.extend(options.display.iter().map(|name| name.as_ptr()));
    let layer_names = if validation { vec![VALIDATION_LAYER.as_ptr()] } else { vec![] };
    let application = vk::ApplicationInfo::default()
        .application_name(c"palpate")
        .engine_name(c"palpate")
        .api_version(vk::API_VERSION_1_3);
    let enabled = [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];
    let mut features = vk::ValidationFeaturesEXT::default().enabled_validation_features(&enabled);
    let mut messenger = messages.create_info();
    let mut info = vk::InstanceCreateInfo::default()
        .application_info(&application)
        .enabled_layer_names(&layer_names)
        .enabled_extension_names(&names);
    if validation {
        info = info.push_next(&mut features);
        if debug {
            info = info.push_next(&mut messenger);
        }
    }
    // SAFETY: every pointer in `info` lives through the call; `messages` outlives the instance where validation is on.
    let instance = unsafe { entry.create_instance(&info, None) }
        .map_err(|e| Error::NoDevice(format!("Vulkan does not start (vkCreateInstance: {e}). {}", device::REMEDY)))?;
    Ok((instance, debug))
}

fn create_device(instance: &ash::Instance, chosen: &Candidate, presents: bool) -> Result<ash::Device> {
    if presents && !chosen.swapchain {
        let name = &chosen.info.name;
        return Err(Error::NoDevice(format!(
            "{name} cannot show in a window: its driver lacks VK_KHR_swapchain; name another"
        )));
    }
    let priority = [1.0];
    let queues =
        [vk::DeviceQueueCreateInfo::default().queue_family_index(chosen.queue_family).queue_priorities(&priority)];
    let core = vk::PhysicalDeviceFeatures::default()
        .shader_int64(chosen.int64_atomics)
        .fragment_stores_and_atomics(chosen.fragment_stores);
    let mut v12 = vk::PhysicalDeviceVulkan12Features::default()
        .scalar_block_layout(true)
        .shader_buffer_int64_atomics(chosen.int64_atomics);
    let mut v13 =
        vk::PhysicalDeviceVulkan13Features::default().synchronization2(true).dynamic_rendering(true).maintenance4(true);
    let wanted =
        [(chosen.external_memory_fd, ash::khr::external_memory_fd::NAME), (presents, ash::khr::swapchain::NAME)];
    let extensions: Vec<_> = wanted.iter().filter(|(is, _)| *is).map(|(_, name)| name.as_ptr()).collect();
    let info = vk::DeviceCreateInfo::default()
        .queue_create_infos(&queues)
        .enabled_features(&core)
        .enabled_extension_names(&extensions)
        .push_next(&mut v12)
        .push_next(&mut v13);
    // SAFETY: the device offers what is asked (checked in device.rs); every pointer lives through the call.
    unsafe { instance.create_device(chosen.physical, &info, None) }.map_err(failed("vkCreateDevice", "set-up"))
}

fn create_cache(device: &ash::Device, folder: Option<&Path>, key: &str) -> Result<vk::PipelineCache> {
    let blob = folder.map(|folder| cache::load(folder, key)).unwrap_or_default();
    let kept = vk::PipelineCacheCreateInfo::default().initial_data(&blob);
    // SAFETY: the blob passed its checksum, so it is what this driver gave; it lives through the call.
    unsafe {
        device
            .create_pipeline_cache(&kept, None)
            .or_else(|_| device.create_pipeline_cache(&vk::PipelineCacheCreateInfo::default(), None))
    }
    .map_err(failed("vkCreatePipelineCache", "set-up"))
}
