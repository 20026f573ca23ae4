//! Makes a context, on which simulations are made, on a Vulkan device that the calling program opened itself and lends
//! to the library. In the names of this file, "host" is the calling program.

use std::ffi::{c_char, c_void};

use palpate::internal::gpu::{HostDevice, QueueLock};
use palpate::{Context, Options};

use super::context::{ContextObject, cache_folder, palpate_context, truth};
use super::handles;
use super::log::{self, palpate_log};
use super::sized::{self, Field, Sized32, fields};
use super::status::{Failure, Outcome, guarded, palpate_status};

/// Feature of a lent device, for `enabled` of palpate_vulkan: shaderInt64 and shaderBufferInt64Atomics are enabled.
pub const PALPATE_VULKAN_INT64_ATOMICS: u32 = 1;
/// Feature of a lent device, for `enabled` of palpate_vulkan: fragmentStoresAndAtomics is enabled, so that the library
/// may use the rasterizer to compute penetration depths.
pub const PALPATE_VULKAN_FRAGMENT_STORES: u32 = 2;
/// Feature of a lent device, for `enabled` of palpate_vulkan: VK_KHR_external_memory_fd is enabled, so that skins
/// (surface meshes of bodies) can be exported.
pub const PALPATE_VULKAN_EXTERNAL_MEMORY_FD: u32 = 4;

/// Callback that takes or releases the calling program's lock around its queue.
pub type palpate_queue_lock = Option<unsafe extern "C" fn(user: *mut c_void)>;

/// A Vulkan device that the calling program opened. Its instance must have been created for Vulkan 1.3, and the device
/// with the features scalarBlockLayout, synchronization2, dynamicRendering and maintenance4. All handles must stay
/// valid until the context made from them and the last simulation on that context are gone.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_vulkan {
    /// Size of the struct in bytes: sizeof(palpate_vulkan).
    pub size: u32,
    /// Further features that the device was created with: a sum of PALPATE_VULKAN_*. Do not add a feature that is not
    /// enabled.
    pub enabled: u32,
    /// vkGetInstanceProcAddr of the Vulkan loader that the handles come from; null: the system's loader is opened.
    pub get_instance_proc_addr: Option<unsafe extern "C" fn()>,
    /// The program's VkInstance.
    pub instance: *mut c_void,
    /// The VkPhysicalDevice of `device`.
    pub physical_device: *mut c_void,
    /// The program's VkDevice.
    pub device: *mut c_void,
    /// A VkQueue of `device`. The library submits to the queue in every call that steps a simulation or copies its
    /// data, and waits for that work.
    pub queue: *mut c_void,
    /// Index of the queue's family, which must have graphics and compute.
    pub queue_family: u32,
    /// Reserved: must be 0.
    pub reserved: u32,
    /// Takes the program's lock before each use of the queue; `unlock` releases the lock afterwards on the same thread,
    /// which may be any thread. The lock is held only briefly. Neither callback may call the library, and the program
    /// must not hold the lock when it calls the library, unless the lock is recursive. If both callbacks are null, the
    /// program must not use the queue during any call of the library, and must create at most one context on the queue.
    pub lock: palpate_queue_lock,
    /// Releases the program's lock; see `lock`.
    pub unlock: palpate_queue_lock,
    /// Pointer that is passed to `lock` and `unlock`.
    pub lock_user: *mut c_void,
    /// Callback that receives the library's messages; null: they are discarded.
    pub log: palpate_log,
    /// Pointer that is passed to `log`.
    pub log_user: *mut c_void,
    /// Cache folder; see `cache` in palpate_context_options.
    pub cache: *const c_char,
    /// 1: where the library has two implementations of a computation, it measures which is faster on the device; see
    /// `measure` in palpate_context_options.
    pub measure: u32,
}

// SAFETY: the struct is `repr(C)`, its first field is the size, and any bytes are a valid value of its numbers and
// pointers; a pointer is followed only under the rules of the comment at the top of palpate.h.
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

/// Makes a context on a Vulkan device of the calling program; the device stays open when the context is destroyed. The
/// library checks what it can: that the physical device belongs to the instance and can run palpate, and that the
/// queue's family has graphics and compute. It cannot detect invalid handles, or features that were not enabled.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_context_create_on(
    vulkan: *const palpate_vulkan,
    context: *mut *mut palpate_context,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let (given, context) = unsafe { (sized::read(vulkan)?, sized::answer(context, "context")?) };
        *context = std::ptr::null_mut();
        if vulkan.is_null() {
            return Err(Failure::new(palpate_status::Null, "vulkan is null; pass a palpate_vulkan"));
        }
        let measure = truth("palpate_vulkan.measure", given.measure)?;
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let cache = unsafe { cache_folder(given.cache)? };
        let options = Options { log: log::to(given.log, given.log_user), cache, measure, ..Options::default() };
        // SAFETY: the C caller fulfils the header's conditions for the handles and the lock of a palpate_vulkan.
        let opened = unsafe { Context::on_host(host_of(&given)?, &options)? };
        *context = handles::insert(ContextObject(opened)) as *mut palpate_context;
        Ok(())
    })
}

fn host_of(given: &palpate_vulkan) -> Outcome<HostDevice> {
    let wrong = |problem: String| Err(Failure::new(palpate_status::Argument, problem));
    let known = PALPATE_VULKAN_INT64_ATOMICS | PALPATE_VULKAN_FRAGMENT_STORES | PALPATE_VULKAN_EXTERNAL_MEMORY_FD;
    if given.enabled & !known != 0 {
        return wrong(format!("palpate_vulkan.enabled is {}; give a sum of PALPATE_VULKAN_*", given.enabled));
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
