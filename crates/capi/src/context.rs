//! Devices, and what is opened on them.

use std::ffi::{c_char, c_void};
use std::path::PathBuf;
use std::sync::Arc;

use palpate::internal::gpu::{DeviceKind, Threads};
use palpate::{Context, Options};

use super::handles::{self, Handled};
use super::log::{self, palpate_log};
use super::sized::{self, Field, Sized32, fields};
use super::status::{Failure, Outcome, guarded, palpate_status};

/// A Vulkan device under the library's hands. Simulations hold on to theirs: it goes with the last of them, whether it was
/// destroyed before or not.
pub struct palpate_context {
    _opaque: [u8; 0],
}

/// What sort of device it is.
#[repr(i32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum palpate_device_kind {
    /// Anything else.
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

/// A Vulkan device of this machine. Strings that are longer than their room are cut, and end in a zero.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_device {
    /// What it is.
    pub kind: palpate_device_kind,
    /// 1: it can be used; 0: `reason` says why not.
    pub usable: u32,
    /// The driver's name for it. This, or a part of it, or the position in the list opens it.
    pub name: [c_char; 256],
    /// Name and version of the driver.
    pub driver: [c_char; 256],
    /// Why it cannot be used; "" where it can.
    pub reason: [c_char; 256],
}

/// How a context is opened. Zero is right for all of it but the size.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_context_options {
    /// sizeof(palpate_context_options).
    pub size: u32,
    /// 1: the Khronos validation layer looks on, with synchronisation validation, and its messages go to `log`; slow. 0: not.
    pub validation: u32,
    /// Device: its position in `palpate_devices`, or part of its name; null: the best one.
    pub device: *const c_char,
    /// Hears what there is to say; null: nobody.
    pub log: palpate_log,
    /// Passed to `log`.
    pub log_user: *mut c_void,
    /// Folder where prepared bodies, compiled pipelines and what was measured of devices are kept for later runs; "": the
    /// user's (PALPATE_CACHE, else palpate in XDG_CACHE_HOME or ~/.cache). Null: nothing is kept.
    pub cache: *const c_char,
    /// 1: measures, once, which of two ways is faster on the device where the scene does not say (arrays, depth stage). 0: not.
    pub measure: u32,
    /// With how many threads lavapipe works, by LP_NUM_THREADS in the environment unless that is set; -1: none but the calling
    /// one. 0: the environment stays as it is. Other drivers do not ask. Anything but 0 sets the variable in
    /// palpate_context_create: no other thread of the process may read or write the environment meanwhile.
    pub threads: i32,
}

// SAFETY: `repr(C)`, the size comes first, and any bytes are a value: a pointer is only followed as the header says.
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

/// Lists the devices of this machine, usable or not. `count` receives how many there are; up to `capacity` are written to
/// `devices`, which may be null where `capacity` is 0. PALPATE_STATUS_TOO_SMALL: there are more, and none was written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_devices(
    devices: *mut palpate_device,
    capacity: usize,
    count: *mut usize,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the caller's, as the header says.
        let count = unsafe { sized::answer(count, "count")? };
        let all: Vec<palpate_device> = Context::list()?.iter().map(device_of).collect();
        *count = all.len();
        if capacity == 0 {
            return Ok(());
        }
        // SAFETY: the caller's, as the header says.
        unsafe { sized::copy(&all, devices, capacity, "devices") }
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

/// As much of a text as fits, whole characters and a zero.
pub(super) fn room<const N: usize>(text: &str) -> [c_char; N] {
    let end = (0..N).rev().find(|&end| text.is_char_boundary(end.min(text.len()))).unwrap_or(0).min(text.len());
    let mut room = [0; N];
    room.iter_mut().zip(text.as_bytes()[..end].iter()).for_each(|(to, byte)| *to = *byte as c_char);
    room
}

/// Opens a device. `options` may be null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_context_create(
    options: *const palpate_context_options,
    context: *mut *mut palpate_context,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the caller's, as the header says.
        let (options, context) = unsafe { (sized::read(options)?, sized::answer(context, "context")?) };
        *context = std::ptr::null_mut();
        let validation = truth("palpate_context_options.validation", options.validation)?;
        let measure = truth("palpate_context_options.measure", options.measure)?;
        let device = match options.device.is_null() {
            true => None,
            // SAFETY: the caller's, as the header says.
            false => Some(unsafe { sized::string(options.device, "options.device")? }.to_owned()),
        };
        let log = log::to(options.log, options.log_user);
        let threads = match options.threads {
            0 => None,
            -1 => Some(Threads::Count(0)),
            count => Some(Threads::Count(u32::try_from(count).map_err(|_| {
                let problem = format!("palpate_context_options.threads is {count}; give -1, 0 or a number above");
                Failure::new(palpate_status::Argument, problem)
            })?)),
        };
        // SAFETY: the caller's, as the header says.
        let cache = unsafe { cache_folder(options.cache)? };
        let options = Options { device, validation, log, cache, measure, threads, ..Options::default() };
        let opened = Context::open(&options)?;
        *context = handles::insert(ContextObject(opened)) as *mut palpate_context;
        Ok(())
    })
}

/// A number that is 0 or 1.
pub(super) fn truth(name: &str, given: u32) -> Outcome<bool> {
    match given {
        0 | 1 => Ok(given == 1),
        _ => Err(Failure::new(palpate_status::Argument, format!("{name} is {given}; give 0 or 1"))),
    }
}

/// Of a `cache` that a caller names: null is none, an empty one the user's.
///
/// # Safety
/// As [`sized::string`].
pub(super) unsafe fn cache_folder(folder: *const c_char) -> Outcome<Option<PathBuf>> {
    if folder.is_null() {
        return Ok(None);
    }
    // SAFETY: the caller's promise.
    let folder = unsafe { sized::string(folder, "cache")? };
    Ok(if folder.is_empty() { Options::user_cache() } else { Some(folder.into()) })
}

/// Lets go of a context. Null does nothing.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_context_destroy(context: *mut palpate_context) -> palpate_status {
    guarded(|| if context.is_null() { Ok(()) } else { handles::remove::<ContextObject>(context as usize) })
}

/// The open device of a context.
pub(super) fn opened(context: *mut palpate_context) -> Outcome<Arc<Context>> {
    handles::with(context as usize, |object: &mut ContextObject| Ok(Arc::clone(&object.0)))
}

/// Bytes of the device's memory that arrays of a context's simulations hold.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_context_memory(context: *mut palpate_context, bytes: *mut u64) -> palpate_status {
    guarded(|| {
        // SAFETY: the caller's, as the header says.
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
