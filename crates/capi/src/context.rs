//! C functions that list the Vulkan devices of the machine, and open one of them as a context, on which simulations are
//! made.

use std::ffi::{c_char, c_void};
use std::path::PathBuf;
use std::sync::Arc;

use palpate::internal::gpu::{DeviceKind, Threads};
use palpate::{Context, Options};

use super::handles::{self, Handled};
use super::log::{self, palpate_log};
use super::sized::{self, Field, Sized32, fields};
use super::status::{Failure, Outcome, guarded, palpate_status};

/// A context: an open Vulkan device. A simulation holds on to its context, so the device stays open until the context
/// is destroyed and the last simulation on it is gone.
pub struct palpate_context {
    _opaque: [u8; 0],
}

/// Kind of a Vulkan device.
#[repr(i32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum palpate_device_kind {
    /// None of the kinds below.
    Other = 0,
    /// A GPU with memory of its own.
    Discrete = 1,
    /// A GPU that shares the processor's memory.
    Integrated = 2,
    /// A GPU seen through a virtual machine.
    Virtual = 3,
    /// A software rasterizer on the processor.
    Cpu = 4,
}

/// A Vulkan device of this machine. Strings that are too long for their arrays are cut off; all end with a zero byte.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_device {
    /// Kind of the device.
    pub kind: palpate_device_kind,
    /// 1: palpate can use the device; 0: palpate cannot use it, and `reason` says why.
    pub usable: u32,
    /// The driver's name for the device. `device` in palpate_context_options takes this name, a part of it, or the
    /// position of the device in the list of `palpate_devices`, from 0.
    pub name: [c_char; 256],
    /// Name and version of the driver.
    pub driver: [c_char; 256],
    /// Why palpate cannot use the device; "" where it can.
    pub reason: [c_char; 256],
}

/// Options for opening a context. In every field but `size`, zero (or null) is the default.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_context_options {
    /// Size of the struct in bytes: sizeof(palpate_context_options).
    pub size: u32,
    /// 1: switches the Khronos validation layer on, with synchronisation validation; its messages go to `log`. This is
    /// slow. 0: off.
    pub validation: u32,
    /// Device to open: its position in the list of `palpate_devices`, from 0, as a decimal number, or part of its name;
    /// null: the first usable one in the order discrete GPU, integrated GPU, virtual GPU, CPU.
    pub device: *const c_char,
    /// Callback that receives the library's messages; null: they are discarded.
    pub log: palpate_log,
    /// Pointer that is passed to `log`.
    pub log_user: *mut c_void,
    /// Folder where prepared bodies, compiled pipelines and measurements of devices are kept for later runs; "": the
    /// user's cache folder (PALPATE_CACHE, else palpate in XDG_CACHE_HOME or ~/.cache). Null: nothing is kept.
    pub cache: *const c_char,
    /// 1: the library measures which of two implementations is faster on the device, where the scene does not choose:
    /// arrays read through texel or through storage buffers, and penetration depths computed by compute or by graphics
    /// pipelines. It measures once per context, or once per device if there is a cache. 0: the library does not
    /// measure.
    pub measure: u32,
    /// Number of threads that lavapipe (Mesa's Vulkan driver for CPUs) uses in addition to the calling one; -1: none.
    /// Any value but 0 sets the environment variable LP_NUM_THREADS in palpate_context_create, unless the environment
    /// has it already; during that call no other thread of the process may read or write the environment. 0: the
    /// environment stays as it is. Other drivers ignore LP_NUM_THREADS.
    pub threads: i32,
}

// SAFETY: the struct is `repr(C)`, its first field is the size, and any bytes are a valid value of its numbers and
// pointers; a pointer is followed only under the rules of the comment at the top of palpate.h.
unsafe impl Sized32 for palpate_context_options {
    const NAME: &str = "palpate_context_options";
    const LEAST: usize = 2 * size_of::<u32>() + size_of::<*const c_char>();
    const FIELDS: &'static [Field] =
        fields!(palpate_context_options { size, validation, device, log, log_user, cache, measure, threads });

    fn unset() -> Self {
        palpate_context_options {
            size: size_of::<Self>() as u32,
            validation: 0,
            device: std::ptr::null(),
            log: None,
            log_user: std::ptr::null_mut(),
            cache: std::ptr::null(),
            measure: 0,
            threads: 0,
        }
    }
}

pub(super) struct ContextObject(pub Arc<Context>);

impl Handled for ContextObject {
    const NAME: &str = "context";
}

/// Lists the Vulkan devices of this machine, usable or not. `count` receives their number; up to `capacity` devices are
/// written to `devices`, which may be null where `capacity` is 0. PALPATE_STATUS_TOO_SMALL: there are more than
/// `capacity` devices, and none was written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_devices(
    devices: *mut palpate_device,
    capacity: usize,
    count: *mut usize,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let count = unsafe { sized::answer(count, "count")? };
        let all: Vec<palpate_device> = Context::list()?.iter().map(device_of).collect();
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        unsafe { sized::list(&all, devices, capacity, count, "devices") }
    })
}

fn device_of(info: &palpate::internal::gpu::DeviceInfo) -> palpate_device {
    let kind = match info.kind {
        DeviceKind::Discrete => palpate_device_kind::Discrete,
        DeviceKind::Integrated => palpate_device_kind::Integrated,
        DeviceKind::Virtual => palpate_device_kind::Virtual,
        DeviceKind::Cpu => palpate_device_kind::Cpu,
        DeviceKind::Other => palpate_device_kind::Other,
    };
    palpate_device {
        kind,
        usable: u32::from(info.usable.is_ok()),
        name: room(&info.name),
        driver: room(&info.driver),
        reason: room(info.usable.as_ref().err().map_or("", String::as_str)),
    }
}

/// Copies as much of a text as fits into N bytes with a terminating zero; no character is cut in two.
pub(super) fn room<const N: usize>(text: &str) -> [c_char; N] {
    let end = (0..N).rev().find(|&end| text.is_char_boundary(end.min(text.len()))).unwrap_or(0).min(text.len());
    let mut room = [0; N];
    room.iter_mut().zip(text.as_bytes()[..end].iter()).for_each(|(to, byte)| *to = *byte as c_char);
    room
}

/// Opens a Vulkan device as a context. `options` may be null: then all options have their defaults.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_context_create(
    options: *const palpate_context_options,
    context: *mut *mut palpate_context,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let (options, context) = unsafe { (sized::read(options)?, sized::answer(context, "context")?) };
        *context = std::ptr::null_mut();
        let validation = truth("palpate_context_options.validation", options.validation)?;
        let measure = truth("palpate_context_options.measure", options.measure)?;
        let device = match options.device.is_null() {
            true => None,
            // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
            false => Some(unsafe { sized::string(options.device, "options.device")? }.to_owned()),
        };
        let log = log::to(options.log, options.log_user);
        let threads = match options.threads {
            0 => None,
            -1 => Some(Threads::Count(0)),
            count => Some(Threads::Count(u32::try_from(count).map_err(|_| {
                let problem = format!("palpate_context_options.threads is {count}; give -1, 0 or a positive number");
                Failure::new(palpate_status::Argument, problem)
            })?)),
        };
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let cache = unsafe { cache_folder(options.cache)? };
        let options = Options { device, validation, log, cache, measure, threads, ..Options::default() };
        let opened = Context::open(&options)?;
        *context = handles::insert(ContextObject(opened)) as *mut palpate_context;
        Ok(())
    })
}

/// Converts a number that must be 0 or 1 to a boolean; the error calls the number `name`.
pub(super) fn truth(name: &str, given: u32) -> Outcome<bool> {
    match given {
        0 | 1 => Ok(given == 1),
        _ => Err(Failure::new(palpate_status::Argument, format!("{name} is {given}; give 0 or 1"))),
    }
}

/// Returns the folder that the caller's option `cache` names: no folder for null, the user's cache folder for "".
///
/// # Safety
/// The conditions of [`sized::string`] hold for `folder`.
pub(super) unsafe fn cache_folder(folder: *const c_char) -> Outcome<Option<PathBuf>> {
    if folder.is_null() {
        return Ok(None);
    }
    // SAFETY: the caller keeps the conditions under `# Safety`.
    let folder = unsafe { sized::string(folder, "cache")? };
    Ok(if folder.is_empty() { Options::user_cache() } else { Some(folder.into()) })
}

/// Destroys a context. The device is closed as soon as the last simulation on the context is gone. Null does nothing.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_context_destroy(context: *mut palpate_context) -> palpate_status {
    guarded(|| if context.is_null() { Ok(()) } else { handles::remove::<ContextObject>(context as usize) })
}

/// Returns the context behind a handle.
pub(super) fn opened(context: *mut palpate_context) -> Outcome<Arc<Context>> {
    handles::with(context as usize, |object: &mut ContextObject| Ok(Arc::clone(&object.0)))
}

/// Reads how many bytes of the device's memory the arrays of all simulations on a context occupy.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_context_memory(context: *mut palpate_context, bytes: *mut u64) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let bytes = unsafe { sized::answer(bytes, "bytes")? };
        *bytes = opened(context)?.bytes_allocated();
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_names_are_cut_between_characters() {
        let text = |room: &[c_char]| room.iter().take_while(|c| **c != 0).map(|c| *c as u8).collect::<Vec<u8>>();
        assert_eq!(text(&room::<8>("llvmpipe")), b"llvmpip");
        assert_eq!(text(&room::<8>("llvm")), b"llvm");
        assert_eq!(text(&room::<4>("ab\u{e4}")), "ab".as_bytes());
        assert_eq!(text(&room::<5>("ab\u{e4}")), "ab\u{e4}".as_bytes());
    }
}
