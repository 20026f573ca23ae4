//! Contexts on a Vulkan device that the host program opened.

use std::ffi::{c_char, c_void};

use palpate::internal::gpu::{HostDevice, QueueLock};
use palpate::{Context, Options};

use super::context::{ContextObject, cache_folder, palpate_context, truth};
use super::handles;
use super::log::{self, palpate_log};
use super::sized::{self, Field, Sized32, fields};
use super::status::{Failure, Outcome, guarded, palpate_status};

/// shaderInt64 and shaderBufferInt64Atomics are enabled on the host's device.
pub const PALPATE_VULKAN_INT64_ATOMICS: u32 = 1;
/// fragmentStoresAndAtomics is enabled: the depth stage may then use the rasterizer.
pub const PALPATE_VULKAN_FRAGMENT_STORES: u32 = 2;
/// VK_KHR_external_memory_fd is enabled: skins can then be exported.
pub const PALPATE_VULKAN_EXTERNAL_MEMORY_FD: u32 = 4;

/// A lock of the host's around its queue.
pub type palpate_queue_lock = Option<unsafe extern "C" fn(user: *mut c_void)>;

/// A Vulkan device of the host's. Its instance was created for Vulkan 1.3, and the device with the features
/// scalarBlockLayout, synchronization2, dynamicRendering and maintenance4. All of it stays alive until the context and the last
/// of its simulations are gone.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_vulkan {
    /// sizeof(palpate_vulkan).
    pub size: u32,
    /// What else the device was created with: PALPATE_VULKAN_*, added up. Say no more than is true.
    pub enabled: u32,
    /// vkGetInstanceProcAddr of the loader that the handles come from; null: the system's loader is opened.
    pub get_instance_proc_addr: Option<unsafe extern "C" fn()>,
    /// VkInstance.
    pub instance: *mut c_void,
    /// VkPhysicalDevice.
    pub physical_device: *mut c_void,
    /// VkDevice.
    pub device: *mut c_void,
    /// VkQueue. The library submits to it in every call that steps or copies, and waits for its own work.
    pub queue: *mut c_void,
    /// The queue's family, which has graphics and compute.
    pub queue_family: u32,
    /// 0.
    pub reserved: u32,
    /// Called before each use of the queue and after it, on the same thread, on any thread; the time between is short. They must
    /// not call the library, and the host must not hold the lock when it does, unless it can be taken twice. Null, both: the host
    /// itself sees to it that it uses the queue in none of the library's calls, and makes one context of it at most.
    pub lock: palpate_queue_lock,
    /// As `lock`.
    pub unlock: palpate_queue_lock,
    /// Passed to both.
    pub lock_user: *mut c_void,
    /// Hears what there is to say; null: nobody.
    pub log: palpate_log,
    /// Passed to `log`.
    pub log_user: *mut c_void,
    /// As in palpate_context_options.
    pub cache: *const c_char,
    /// As in palpate_context_options.
    pub measure: u32,
}

// SAFETY: `repr(C)`, the size comes first, and any bytes are a value: pointers are only followed as the header says.
unsafe impl Sized32 for palpate_vulkan {
    const NAME: &str = "palpate_vulkan";
    const LEAST: usize = 4 * size_of::<u32>() + 10 * size_of::<*const c_void>();
    const FIELDS: &'static [Field] = fields!(palpate_vulkan {
        size,
        enabled,
        get_instance_proc_addr,
        instance,
        physical_device,
        device,
        queue,
        queue_family,
        reserved,
        lock,
        unlock,
        lock_user,
        log,
        log_user,
        cache,
        measure
    });

    fn unset() -> Self {
        let null = std::ptr::null_mut();
        palpate_vulkan {
            size: size_of::<Self>() as u32,
            enabled: 0,
            get_instance_proc_addr: None,
            instance: null,
            physical_device: null,
            device: null,
            queue: null,
            queue_family: 0,
            reserved: 0,
            lock: None,
            unlock: None,
            lock_user: null,
            log: None,
            log_user: null,
            cache: std::ptr::null(),
            measure: 0,
        }
    }
}

/// Makes a context on a device of the host's, which is left open when the context goes. What is in reach is checked: that the
/// physical device is of the instance and can run palpate, and that the queue's family has graphics and compute; handles that are
/// none, and features that were not enabled, cannot be found out.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_context_create_on(
    vulkan: *const palpate_vulkan,
    context: *mut *mut palpate_context,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the caller's, as the header says.
        let (given, context) = unsafe { (sized::read(vulkan)?, sized::answer(context, "context")?) };
        *context = std::ptr::null_mut();
        if vulkan.is_null() {
            return Err(Failure::new(palpate_status::Null, "vulkan is null; say which device"));
        }
        let measure = truth("palpate_vulkan.measure", given.measure)?;
        // SAFETY: the caller's, as the header says.
        let cache = unsafe { cache_folder(given.cache)? };
        let options = Options { log: log::to(given.log, given.log_user), cache, measure, ..Options::default() };
        // SAFETY: the caller's, as the header says.
        let opened = unsafe { Context::on_host(host_of(&given)?, &options)? };
        *context = handles::insert(ContextObject(opened)) as *mut palpate_context;
        Ok(())
    })
}

fn host_of(given: &palpate_vulkan) -> Outcome<HostDevice> {
    let wrong = |problem: String| Err(Failure::new(palpate_status::Argument, problem));
    let known = PALPATE_VULKAN_INT64_ATOMICS | PALPATE_VULKAN_FRAGMENT_STORES | PALPATE_VULKAN_EXTERNAL_MEMORY_FD;
    if given.enabled & !known != 0 {
        return wrong(format!("palpate_vulkan.enabled is {}; add up PALPATE_VULKAN_* alone", given.enabled));
    }
    if given.reserved != 0 {
        return wrong(format!("palpate_vulkan.reserved is {}; set it to 0", given.reserved));
    }
    let lock = match (given.lock, given.unlock) {
        (Some(lock), Some(unlock)) => Some(QueueLock { lock, unlock, user: given.lock_user }),
        (None, None) => None,
        _ => return wrong("palpate_vulkan.lock and unlock go together; give both or neither".into()),
    };
    let raw = |handle: *mut c_void| handle as usize as u64;
    Ok(HostDevice {
        get_instance_proc_addr: given.get_instance_proc_addr,
        instance: raw(given.instance),
        physical_device: raw(given.physical_device),
        device: raw(given.device),
        queue: raw(given.queue),
        queue_family: given.queue_family,
        int64_atomics: given.enabled & PALPATE_VULKAN_INT64_ATOMICS != 0,
        fragment_stores: given.enabled & PALPATE_VULKAN_FRAGMENT_STORES != 0,
        external_memory_fd: given.enabled & PALPATE_VULKAN_EXTERNAL_MEMORY_FD != 0,
        lock,
    })
}
