//! A Vulkan device with its one queue and its memory, opened once and shared by the whole `gpu` module. In this file a
//! "device" is always a Vulkan device; the "host" is another program whose device the engine borrows (see `host.rs`).
//! lavapipe is Mesa's Vulkan driver for CPUs.
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
use super::faults::{self, FAULTS};
use super::host::{HostDevice, QueueGuard};
use super::log::{Level, Log};
use super::threads::Threads;
use super::{cache, failed, kernel, loader, threads};
use crate::error::{Error, Result};

const VALIDATION_LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";
/// Standard workgroup size of kernels, invocations: two warps or one wavefront of a GPU. On lavapipe all sizes from 64
/// to 1024 were equally fast.
pub(super) const GROUP_SIZE: u32 = 64;
/// Workgroup size, invocations, on a GPU, of kernels whose invocations synchronise at barriers.
const REDUCE_SIZE: u32 = 128;
/// The sizes that may be asked for instead.
const REDUCE_SIZES: std::ops::RangeInclusive<u32> = 8..=256;
/// Size of the blocks in which memory is requested from the driver, bytes.
const MEMORY_BLOCK: u64 = 16 << 20;

/// Least number of 16-byte elements that the device's storage texel buffers must be able to hold for them to be used.
/// These elements take 1 GiB, less than the memory of most GPUs; with a lower limit, large scenes could not run.
const TEXEL_ELEMENTS: u32 = 1 << 26;

/// How kernels reach arrays of vectors that they only read; see `shaders/shared/arrays.glsl`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Arrays {
    /// Through storage texel buffers.
    Texel,
    /// Through storage buffers.
    Storage,
}

/// How to choose and open a device.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Index of the device, or part of its name in upper or lower case. `None`: the first usable one, in the order
    /// discrete GPU, integrated GPU, virtual GPU, CPU.
    pub device: Option<String>,
    /// Whether to use the Khronos validation layer, with synchronisation validation.
    pub validation: bool,
    /// Instance extensions needed to show images in a window; see `display_extensions`. Empty: no window is used.
    pub display: Vec<&'static CStr>,
    /// Number of threads that lavapipe uses. It is set through the variable `LP_NUM_THREADS` of the process's
    /// environment, unless that is set already. Ask for a number only while no other thread reads the environment.
    /// `None`: the environment stays as it is, and lavapipe uses all cores.
    pub threads: Option<Threads>,
    /// Folder in which prepared bodies, compiled pipelines and measurements of devices are kept for later runs. It is
    /// created where it is missing, and ignored where it cannot be written. `None`: nothing is kept. The `palpate`
    /// program uses the folder [`Options::user_cache`].
    pub cache: Option<PathBuf>,
    /// Whether to measure, in a fraction of a second, which alternative is faster on the device, where no option
    /// decides: texel or storage buffers for arrays, and compute or graphics pipelines for the depth stage (which finds
    /// penetration depths). This is measured once per context, or with a cache folder once per device. `false`: texel
    /// buffers are used where the device has enough and large ones, and compute pipelines.
    pub measure: bool,
    /// Shaders to replace: the name of each, and the SPIR-V that is used instead, whichever kind of arrays is chosen.
    /// The SPIR-V must declare the buffers of the shader that it replaces; an unknown name is an error. For tests which
    /// show that a check can fail.
    pub replaced: Vec<(String, Vec<u8>)>,
    /// How kernels reach arrays of vectors that they only read; `None`: chosen as [`Context::arrays`] describes.
    pub arrays: Option<Arrays>,
    /// Upper limit for the number of elements of a texel buffer, where it is below the device's own limit. For tests.
    pub texel_elements: Option<u32>,
    /// Number of invocations in a workgroup of kernels whose invocations synchronise: a power of two from 8 to 256.
    /// `None`: one subgroup on a CPU, 128 on any other device. So kernels can be run on a CPU at the sizes of a GPU.
    pub workgroup: Option<u32>,
    /// Copies what the CPU writes for each step into GPU memory, also where the CPU can write GPU memory itself. For
    /// tests: a device without such memory always does so.
    pub copies_inputs: bool,
    /// Receives the engine's messages. A log with a receiver also gets the validation layer's messages, which are then
    /// not kept for [`Context::validation_messages`].
    pub log: Log,
}

impl Options {
    /// The user's cache folder: `PALPATE_CACHE`, else `palpate` in `XDG_CACHE_HOME` (or the operating system's
    /// equivalent), else in `~/.cache`.
    pub fn user_cache() -> Option<PathBuf> {
        cache::user_folder()
    }

    /// The options with which the `palpate` program opens a device: with the user's cache folder, with measurements
    /// (see [`Options::measure`]), and with the size of workgroups that the environment variable `PALPATE_WORKGROUP`
    /// gives.
    pub fn of_program() -> Options {
        // What is no number becomes 0, a size that is refused when the device is opened.
        let workgroup = std::env::var("PALPATE_WORKGROUP").ok().map(|text| text.parse().unwrap_or_default());
        Options { cache: Options::user_cache(), measure: true, workgroup, ..Options::default() }
    }
}

/// An open Vulkan device. Its methods may be called from any thread; submits are serialised.
pub struct Context {
    // `Drop` destroys the Vulkan objects among these fields in the order in which the fields are declared here.
    /// The kernels that the context has made; see `kernel.rs`.
    pub(super) kernels: kernel::Kept,
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
    /// Set where the device belongs to another program; such a device is not destroyed.
    host: Option<HostDevice>,
    pub(super) queue_family: u32,
    pub(super) limits: vk::PhysicalDeviceLimits,
    pub(super) timestamp_bits: u32,
    pub(super) allocated: AtomicU64,
    copies_inputs: bool,
    /// Whether the queue can draw.
    pub(super) graphics: bool,
    info: DeviceInfo,
    subgroup_size: u32,
    reduce_size: u32,
    full_subgroups: bool,
    int64_atomics: bool,
    fragment_stores: bool,
    #[cfg_attr(not(feature = "window"), allow(dead_code))]
    pub(super) physical: vk::PhysicalDevice,
    /// Whether the device was opened to present to windows.
    #[cfg_attr(not(feature = "window"), allow(dead_code))]
    pub(super) presents: bool,
    /// Functions that export memory to other programs; `None` where the device has none.
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
    /// Opens a device. If none can be used, [`Error::NoDevice`] explains what is missing and how to get it.
    pub fn open(options: &Options) -> Result<Arc<Context>> {
        for (name, _) in &options.replaced {
            kernel::known(name, Arrays::Texel)?;
        }
        threads::choose(options.threads);
        let _guard = loader::changes_devices();
        let entry = if FAULTS.concerns_this_thread() { faults::faulty(load()?) } else { load()? };
        let messages = Box::new(Messages::heard_by(options.log.clone()));
        let NewInstance { instance, debug, layer } = create_instance(&entry, options, &messages)?;
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
                // SAFETY: nothing made from the instance is left.
                unsafe { instance.destroy_instance(None) };
                return Err(error);
            }
        };
        // SAFETY: the device was created with queue 0 of this queue family.
        let queue = unsafe { device.get_device_queue(chosen.queue_family, 0) };
        let labels = Labels::new(debug.then(|| ash::ext::debug_utils::Device::new(&instance, &device)), layer);
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

    /// Uses a device that another program, the host, opened, and leaves it open. The fields `device`, `validation` and
    /// `threads` of `options` are ignored, since the host decides them.
    ///
    /// # Safety
    /// The handles must belong to one Vulkan 1.3 instance and stay alive as long as the context, which buffers,
    /// simulations and recordings keep alive. The device must have been created with [`HostDevice::FEATURES`] and with
    /// whatever else the fields of `host` declare as enabled. The host may use the queue only while it holds the lock,
    /// whose functions may be called from any thread; without a lock, only while no call into the engine is running.
    #[doc(hidden)]
    pub unsafe fn on_host(host: HostDevice, options: &Options) -> Result<Arc<Context>> {
        use vk::Handle;
        let _guard = loader::changes_devices();
        // SAFETY: the caller guarantees that the handles are valid, see above.
        let (entry, instance) = unsafe { host.instance()? };
        let chosen = host.candidate(&instance)?;
        // SAFETY: the caller guarantees that the handles are valid, see above.
        let device = unsafe { ash::Device::load(instance.fp_v1_0(), vk::Device::from_raw(host.device)) };
        let queue = vk::Queue::from_raw(host.queue);
        let (labels, messages) = (Labels::new(None, None), Box::new(Messages::default()));
        let host = Some(host);
        Self::of(Opened { entry, instance, device, queue, labels, messenger: None, messages, host }, chosen, options)
    }

    fn of(mut opened: Opened, chosen: Candidate, options: &Options) -> Result<Arc<Context>> {
        let made = reduce_size(&chosen, options.workgroup).and_then(|reduce_size| {
            let allocator = create_allocator(&opened, &chosen)?;
            let cache = create_cache(&opened.device, options.cache.as_deref(), &chosen.cache_key)?;
            Ok((reduce_size, allocator, cache))
        });
        let (reduce_size, allocator, cache) = match made {
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
            kernels: kernel::Kept::default(),
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
            copies_inputs: options.copies_inputs || !has_mapped_device_memory(&memory),
            graphics: chosen.graphics,
            info: chosen.info,
            subgroup_size: chosen.subgroup_size,
            reduce_size,
            full_subgroups: chosen.full_subgroups,
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

    /// Lists all Vulkan devices, usable or not.
    pub fn list() -> Result<Vec<DeviceInfo>> {
        let _guard = loader::changes_devices();
        let entry = load()?;
        let NewInstance { instance, .. } = create_instance(&entry, &Options::default(), &Messages::default())?;
        let list = device::candidates(&instance).map(|all| all.into_iter().map(|c| c.info).collect());
        // SAFETY: nothing made from the instance is left.
        unsafe { instance.destroy_instance(None) };
        list
    }

    /// Name that the driver gives the device.
    pub fn device_name(&self) -> &str {
        &self.info.name
    }

    /// Name and version of the device's driver.
    pub fn driver(&self) -> &str {
        &self.info.driver
    }

    /// Type of the device, such as discrete GPU or CPU.
    pub fn kind(&self) -> DeviceKind {
        self.info.kind
    }

    /// Standard workgroup size of a kernel, invocations.
    #[doc(hidden)]
    pub fn group_size(&self) -> u32 {
        GROUP_SIZE
    }

    /// Workgroup size, in invocations, of kernels whose invocations synchronise at barriers. On a CPU device this size
    /// is the subgroup size: a workgroup is then one SIMD vector, and needs no barriers for sums.
    #[doc(hidden)]
    pub fn reduce_size(&self) -> u32 {
        self.reduce_size
    }

    /// Whether a workgroup of this size is one subgroup, in which all lanes are in use, and may add over the subgroup.
    pub(super) fn is_one_subgroup(&self, workgroup: u32) -> bool {
        self.full_subgroups && workgroup == self.subgroup_size
    }

    /// Number of invocations in a subgroup. Use it only to choose between variants of a kernel: no kernel may rely on
    /// this number, but for the sums of shaders/shared/sums.glsl.
    #[doc(hidden)]
    pub fn subgroup_size(&self) -> u32 {
        self.subgroup_size
    }

    /// Whether what the CPU writes for each step is copied into GPU memory, which the CPU cannot write itself.
    pub(super) fn copies_inputs(&self) -> bool {
        self.copies_inputs
    }

    /// Whether shaders may use 64-bit atomics on storage buffers; a device need not support them.
    #[doc(hidden)]
    pub fn int64_atomics(&self) -> bool {
        self.int64_atomics
    }

    /// Whether fragment shaders may write storage buffers, as a [`super::RasterPipeline`] needs; a device need not
    /// support this.
    #[doc(hidden)]
    pub fn fragment_stores(&self) -> bool {
        self.fragment_stores
    }

    /// Greatest number of workgroups of a dispatch.
    #[doc(hidden)]
    pub fn most_workgroups(&self) -> u32 {
        self.limits.max_compute_work_group_count[0]
    }

    /// How kernels reach arrays of vectors that they only read: the kind given by [`Options::arrays`], else the kind
    /// that [`Context::choose_arrays`] decided, else texel buffers where the device has enough and large ones.
    pub fn arrays(&self) -> Arrays {
        let by_limit = || if self.has_texel_buffers() { Arrays::Texel } else { Arrays::Storage };
        *self.arrays.get_or_init(by_limit)
    }

    /// Whether the device's texel buffers are large enough for large scenes, and every kernel can bind all of its own.
    #[doc(hidden)]
    pub fn has_texel_buffers(&self) -> bool {
        self.limits.max_texel_buffer_elements >= TEXEL_ELEMENTS && self.binds_texel_buffers()
    }

    /// Whether every kernel can bind all of its texel buffers.
    #[doc(hidden)]
    pub fn binds_texel_buffers(&self) -> bool {
        self.texel_buffers() >= kernel::MOST_TEXEL_BUFFERS
    }

    /// Greatest number of storage texel buffers that a kernel may bind.
    #[doc(hidden)]
    pub fn texel_buffers(&self) -> u32 {
        self.limits.max_per_stage_descriptor_storage_images
    }

    /// The value of [`Options::arrays`].
    #[doc(hidden)]
    pub fn arrays_asked_for(&self) -> Option<Arrays> {
        self.arrays_asked_for
    }

    /// Decides how all kernels made from now on reach their arrays, unless this has been decided already; see
    /// [`Context::has_arrays`].
    #[doc(hidden)]
    pub fn choose_arrays(&self, arrays: Arrays) {
        self.arrays.get_or_init(|| arrays);
    }

    /// Greatest number of storage buffers that a kernel may bind.
    #[doc(hidden)]
    pub fn storage_buffers(&self) -> u32 {
        self.limits.max_per_stage_descriptor_storage_buffers
    }

    /// Greatest size of a storage buffer binding (bytes), and of a texel buffer (elements of 16 bytes).
    #[doc(hidden)]
    pub fn array_limits(&self) -> (u64, u64) {
        (u64::from(self.limits.max_storage_buffer_range), u64::from(self.limits.max_texel_buffer_elements))
    }

    /// Device memory that buffers and images occupy, bytes.
    pub fn bytes_allocated(&self) -> u64 {
        self.allocated.load(Ordering::Relaxed)
    }

    /// Whether arrays can be placed in memory that other programs import ([`super::Buffer::export`]).
    #[doc(hidden)]
    pub fn shares_memory(&self) -> bool {
        self.external_memory.is_some()
    }

    /// The first device-local memory type among `types` (one bit per type).
    pub(super) fn device_memory_type(&self, types: u32) -> Option<u32> {
        let own = vk::MemoryPropertyFlags::DEVICE_LOCAL;
        let all = self.memory.memory_types_as_slice().iter().zip(0..);
        all.into_iter().find(|(kind, i)| types & (1 << i) != 0 && kind.property_flags.contains(own)).map(|(_, i)| i)
    }

    /// Returns and forgets the validation layer's messages; empty when there are none or validation is off.
    pub fn validation_messages(&self) -> Vec<String> {
        self.messages.drain()
    }

    /// The value of [`Options::cache`].
    #[doc(hidden)]
    pub fn cache_folder(&self) -> Option<&Path> {
        self.cache_folder.as_deref()
    }

    /// Times of the depth stage, microseconds, as graphics draws and as compute dispatches; set once they are measured.
    #[doc(hidden)]
    pub fn measured_paths(&self) -> &OnceLock<[f64; 2]> {
        &self.measured_paths
    }

    /// Whether the kind of arrays is decided: by the options, by [`Context::choose_arrays`], or by a call of
    /// [`Context::arrays`], as when a kernel is made.
    #[doc(hidden)]
    pub fn has_arrays(&self) -> bool {
        self.arrays.get().is_some()
    }

    /// The value of [`Options::measure`].
    #[doc(hidden)]
    pub fn measures(&self) -> bool {
        self.measures
    }

    /// Stores compiled pipelines for the next run, where there is a cache folder. Dropping the context does this as
    /// well.
    #[doc(hidden)]
    pub fn save_pipeline_cache(&self) {
        let Some(folder) = self.cache_folder() else { return };
        // SAFETY: the cache belongs to this device, and the driver locks the cache itself.
        if let Ok(blob) = unsafe { self.device.get_pipeline_cache_data(self.cache) } {
            cache::save(folder, &self.cache_key, &blob);
        }
    }

    /// Passes a message to the log of [`Options::log`].
    #[doc(hidden)]
    pub fn tell(&self, level: Level, message: &str) {
        self.log.tell(level, message);
    }

    /// The queue, locked for the calling thread.
    pub(super) fn queue(&self) -> QueueGuard<'_> {
        let queue = self.queue.lock().unwrap_or_else(|e| e.into_inner());
        QueueGuard::new(queue, self.host.as_ref().and_then(|host| host.lock))
    }

    /// Waits until the queue is idle, ignoring failures. On a host's device this includes the host's own work on the
    /// queue.
    pub(super) fn wait_idle(&self) {
        let queue = self.queue();
        // SAFETY: the queue is alive and locked. An error means that the device is lost: there is nothing to wait for.
        let _ = unsafe { self.device.queue_wait_idle(queue.queue()) };
    }

    pub(super) fn allocator(&self) -> MutexGuard<'_, memory::Allocator> {
        self.allocator.lock().unwrap_or_else(|e| e.into_inner())
    }
}

impl Drop for Context {
    fn drop(&mut self) {
        // SAFETY: buffers, kernels and recordings hold an Arc of this context, so none of them is left but the kernels
        // that the context itself keeps, and each recording has waited for its own work. Each object is destroyed before
        // the object that it was made from, and is not used afterwards.
        unsafe {
            self.wait_idle();
            self.save_pipeline_cache();
            drop(std::mem::take(&mut self.kernels));
            ManuallyDrop::drop(&mut self.allocator);
            self.device.destroy_pipeline_cache(self.cache, None);
            if self.host.is_some() {
                return;
            }
            let _guard = loader::changes_devices();
            self.device.destroy_device(None);
            if let Some((utils, messenger)) = self.messenger.take() {
                utils.destroy_debug_utils_messenger(messenger, None);
            }
            self.instance.destroy_instance(None);
        }
    }
}

/// The Vulkan objects that a context is made of, opened by the engine or by a host.
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
    /// Destroys what the engine opened, where no context could be made of it; a host's objects are left alone.
    fn close(&mut self) {
        if self.host.is_some() {
            return;
        }
        // SAFETY: nothing made from the device or the instance is left, and neither of them is used again.
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
    // SAFETY: the system's Vulkan loader is trusted to initialise soundly, and stays loaded as long as the entry lives.
    unsafe { ash::Entry::load() }
        .map_err(|e| Error::NoDevice(format!("the Vulkan loader cannot be loaded ({e}). {}", device::REMEDY)))
}

/// What [`create_instance`] made.
struct NewInstance {
    instance: ash::Instance,
    /// Whether the instance has the extension VK_EXT_debug_utils.
    debug: bool,
    /// Version of the validation layer, if that is in use.
    layer: Option<u32>,
}

fn create_instance(entry: &ash::Entry, options: &Options, messages: &Messages) -> Result<NewInstance> {
    let validation = options.validation;
    // SAFETY (for this and the next call): these are plain queries of a loaded entry.
    let layers = if validation { unsafe { entry.enumerate_instance_layer_properties() } } else { Ok(Vec::new()) }
        .map_err(failed("vkEnumerateInstanceLayerProperties", "set-up"))?;
    let extensions = unsafe { entry.enumerate_instance_extension_properties(None) }
        .map_err(failed("vkEnumerateInstanceExtensionProperties", "set-up"))?;
    let layer = layers.iter().find(|l| l.layer_name_as_c_str() == Ok(VALIDATION_LAYER)).map(|l| l.spec_version);
    if validation && layer.is_none() {
        return Err(Error::NoDevice(
            "validation was asked for, but VK_LAYER_KHRONOS_validation is missing; on Debian or Ubuntu run ./setup.sh, \
             or: apt-get install vulkan-validationlayers"
                .into(),
        ));
    }
    let offers = |name: &CStr| extensions.iter().any(|e| e.extension_name_as_c_str() == Ok(name));
    let debug = offers(ash::ext::debug_utils::NAME);
    // Without this extension the loader does not list devices such as MoltenVK's, which lack parts of Vulkan.
    let portability = offers(ash::khr::portability_enumeration::NAME);
    let mut names: Vec<*const c_char> = Vec::new();
    if debug {
        names.push(ash::ext::debug_utils::NAME.as_ptr());
    }
    if portability {
        names.push(ash::khr::portability_enumeration::NAME.as_ptr());
    }
    // Without this setting newer versions of the layer overlook what shaders read and write.
    let on = vk::TRUE;
    let settings = [vk::LayerSettingEXT {
        ty: vk::LayerSettingTypeEXT::BOOL32,
        value_count: 1,
        p_values: (&raw const on).cast(),
        ..vk::LayerSettingEXT::default().layer_name(VALIDATION_LAYER).setting_name(c"syncval_shader_accesses_heuristic")
    }];
    let mut settings = vk::LayerSettingsCreateInfoEXT::default().settings(&settings);
    let mut has_settings = false;
    if validation {
        names.push(ash::ext::validation_features::NAME.as_ptr());
        // SAFETY: as above.
        let offered = unsafe { entry.enumerate_instance_extension_properties(Some(VALIDATION_LAYER)) }
            .map_err(failed("vkEnumerateInstanceExtensionProperties", "set-up"))?;
        let is_settings =
            |e: &vk::ExtensionProperties| e.extension_name_as_c_str() == Ok(ash::ext::layer_settings::NAME);
        has_settings = offered.iter().any(is_settings);
    }
    if has_settings {
        names.push(ash::ext::layer_settings::NAME.as_ptr());
    }
    let lacking = options.display.iter().find(|name| !offers(name));
    if let Some(name) = lacking {
        let name = name.to_string_lossy();
        return Err(Error::NoDevice(format!(
            "Vulkan cannot present images in a window here: {name} is missing. {}",
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
    let flags = match portability {
        true => vk::InstanceCreateFlags::ENUMERATE_PORTABILITY_KHR,
        false => vk::InstanceCreateFlags::empty(),
    };
    let mut info = vk::InstanceCreateInfo::default()
        .flags(flags)
        .application_info(&application)
        .enabled_layer_names(&layer_names)
        .enabled_extension_names(&names);
    if validation {
        info = info.push_next(&mut features);
        if has_settings {
            info = info.push_next(&mut settings);
        }
        if debug {
            info = info.push_next(&mut messenger);
        }
    }
    // SAFETY: every pointer in `info` lives through the call; `messages` outlives the instance where validation is on.
    match unsafe { entry.create_instance(&info, None) } {
        Ok(instance) => Ok(NewInstance { instance, debug, layer }),
        Err(result) => Err(match failed("vkCreateInstance", "set-up")(result) {
            Error::Memory(why) => Error::Memory(why),
            _ => Error::NoDevice(format!("Vulkan does not start (vkCreateInstance: {result}). {}", device::REMEDY)),
        }),
    }
}

fn create_device(instance: &ash::Instance, chosen: &Candidate, presents: bool) -> Result<ash::Device> {
    if presents && !chosen.swapchain {
        let name = &chosen.info.name;
        return Err(Error::NoDevice(format!(
            "{name} cannot present images in a window: its driver lacks VK_KHR_swapchain; choose another device"
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
    let mut v13 = vk::PhysicalDeviceVulkan13Features::default()
        .synchronization2(true)
        .dynamic_rendering(true)
        .maintenance4(true)
        .compute_full_subgroups(chosen.full_subgroups);
    let wanted = [
        (chosen.external_memory_fd, ash::khr::external_memory_fd::NAME),
        (presents, ash::khr::swapchain::NAME),
        (chosen.portability_subset, ash::khr::portability_subset::NAME),
    ];
    let extensions: Vec<_> = wanted.iter().filter(|(is, _)| *is).map(|(_, name)| name.as_ptr()).collect();
    let info = vk::DeviceCreateInfo::default()
        .queue_create_infos(&queues)
        .enabled_features(&core)
        .enabled_extension_names(&extensions)
        .push_next(&mut v12)
        .push_next(&mut v13);
    // SAFETY: the device has the features to be enabled (checked in device.rs); every pointer lives through the call.
    unsafe { instance.create_device(chosen.physical, &info, None) }.map_err(failed("vkCreateDevice", "set-up"))
}

/// Whether the device has memory of its own that is mapped and coherent for the CPU.
fn has_mapped_device_memory(memory: &vk::PhysicalDeviceMemoryProperties) -> bool {
    use vk::MemoryPropertyFlags as Flags;
    let wanted = Flags::DEVICE_LOCAL | Flags::HOST_VISIBLE | Flags::HOST_COHERENT;
    memory.memory_types[..memory.memory_type_count as usize].iter().any(|ty| ty.property_flags.contains(wanted))
}

/// Workgroup size of kernels whose invocations synchronise at barriers, on a device; `asked`: the size asked for.
pub(super) fn reduce_size(chosen: &Candidate, asked: Option<u32>) -> Result<u32> {
    let limits = &chosen.properties.limits;
    let most = limits.max_compute_work_group_invocations.min(limits.max_compute_work_group_size[0]);
    match asked {
        None if chosen.info.kind == DeviceKind::Cpu => Ok(chosen.subgroup_size.max(1)),
        None => Ok(REDUCE_SIZE),
        Some(size) if REDUCE_SIZES.contains(&size) && size.is_power_of_two() && size <= most => Ok(size),
        Some(size) => Err(Error::Usage(format!(
            "workgroups of {size} invocations are not possible: give a power of two from {} to {} (--workgroup, or the \
             environment variable PALPATE_WORKGROUP); {} allows up to {most}",
            REDUCE_SIZES.start(),
            REDUCE_SIZES.end(),
            chosen.info.name
        ))),
    }
}

fn create_cache(device: &ash::Device, folder: Option<&Path>, key: &str) -> Result<vk::PipelineCache> {
    let blob = folder.map(|folder| cache::load(folder, key)).unwrap_or_default();
    let kept = vk::PipelineCacheCreateInfo::default().initial_data(&blob);
    // SAFETY: the blob passed its checksum, so it is what this driver wrote; it lives through the call.
    unsafe {
        device
            .create_pipeline_cache(&kept, None)
            .or_else(|_| device.create_pipeline_cache(&vk::PipelineCacheCreateInfo::default(), None))
    }
    .map_err(failed("vkCreatePipelineCache", "set-up"))
}
