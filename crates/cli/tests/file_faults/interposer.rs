//! A library that is loaded before libc (`LD_PRELOAD`) and makes one file operation of a program fail. It counts the
//! operations on files below the folder `FAULT_FOLDER`; number `FAULT_AT` fails with the error `FAULT_KIND` of those
//! that the operation may give, and its name is written to the file `FAULT_SAYS`. Of an operation that follows itself on
//! one file, as where a large file is read or written piece by piece, only the first two are counted. Compiled by the
//! test, which uses it.

use std::collections::BTreeMap;
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::os::unix::ffi::OsStringExt;
use std::sync::{Mutex, OnceLock, PoisonError};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

const ENOENT: c_int = 2;
const EIO: c_int = 5;
const EACCES: c_int = 13;
const EMFILE: c_int = 24;
const ENOSPC: c_int = 28;
const EROFS: c_int = 30;

const CREATES: c_int = 0o100;
/// Write only, or read and write.
const WRITES: c_int = 0o3;
/// Finds the next definition of a function, that of libc.
const NEXT: *mut c_void = -1isize as *mut c_void;
const MOST_FILES: usize = 1024;

unsafe extern "C" {
    fn dlsym(library: *mut c_void, name: *const c_char) -> *mut c_void;
    fn dirfd(folder: *mut c_void) -> c_int;
    fn __errno_location() -> *mut c_int;
}

/// What the environment asks for.
struct Asked {
    folder: Vec<u8>,
    at: u64,
    kind: usize,
    says: CString,
}

static CALLS: AtomicU64 = AtomicU64::new(0);
/// Whether a file descriptor is of a file below the folder.
static OURS: [AtomicBool; MOST_FILES] = [const { AtomicBool::new(false) }; MOST_FILES];

fn asked() -> Option<&'static Asked> {
    static ASKED: OnceLock<Option<Asked>> = OnceLock::new();
    let read = |name: &str| std::env::var_os(name);
    ASKED
        .get_or_init(|| {
            Some(Asked {
                folder: read("FAULT_FOLDER")?.into_vec(),
                at: read("FAULT_AT")?.into_string().ok()?.parse().ok()?,
                kind: read("FAULT_KIND")?.into_string().ok()?.parse().ok()?,
                says: CString::new(read("FAULT_SAYS")?.into_vec()).ok()?,
            })
        })
        .as_ref()
}

/// Whether a path lies below the folder.
unsafe fn is_below(path: *const c_char, _: &'static CStr) -> bool {
    // SAFETY: the caller's path is null or ends with a zero byte.
    !path.is_null() && asked().is_some_and(|asked| unsafe { CStr::from_ptr(path) }.to_bytes().starts_with(&asked.folder))
}

fn is_ours(file: c_int) -> bool {
    usize::try_from(file).ok().and_then(|file| OURS.get(file)).is_some_and(|ours| ours.load(Ordering::SeqCst))
}

fn mark(file: c_int, ours: bool) {
    if let Some(mark) = usize::try_from(file).ok().and_then(|file| OURS.get(file)) {
        mark.store(ours, Ordering::SeqCst);
    }
}

/// Whether the operation `name` on a file follows two of the same kind.
fn is_repeated(name: &'static CStr, file: c_int) -> bool {
    static LAST: Mutex<(&CStr, c_int, u32)> = Mutex::new((c"", -1, 0));
    let mut last = LAST.lock().unwrap_or_else(PoisonError::into_inner);
    let times = if (last.0, last.1) == (name, file) { last.2 + 1 } else { 1 };
    *last = (name, file, times);
    times > 2
}

/// Counts an operation; whether it is to fail. If so, the error is set.
fn fails(name: &CStr, errors: &[c_int]) -> bool {
    let Some(asked) = asked() else { return false };
    if CALLS.fetch_add(1, Ordering::SeqCst) != asked.at {
        return false;
    }
    let error = errors[asked.kind % errors.len()];
    let said = format!("{} {error}\n", name.to_str().unwrap_or("?"));
    // SAFETY: libc's functions, of these types; the pointers live through the calls.
    unsafe {
        let open: unsafe extern "C" fn(*const c_char, c_int, c_int) -> c_int = libc(c"open64");
        let write: unsafe extern "C" fn(c_int, *const c_void, usize) -> isize = libc(c"write");
        let close: unsafe extern "C" fn(c_int) -> c_int = libc(c"close");
        // Write only, created, emptied.
        let file = open(asked.says.as_ptr(), 0o1101, 0o600);
        write(file, said.as_ptr().cast(), said.len());
        close(file);
        *__errno_location() = error;
    }
    true
}

/// The function that this library hides.
///
/// # Safety
/// libc defines the function with the type `F`, a pointer to a function.
unsafe fn libc<F: Copy>(name: &'static CStr) -> F {
    static FOUND: Mutex<BTreeMap<&CStr, usize>> = Mutex::new(BTreeMap::new());
    let mut found = FOUND.lock().unwrap_or_else(PoisonError::into_inner);
    // SAFETY: the name ends with a zero byte.
    let address = found.entry(name).or_insert_with(|| unsafe { dlsym(NEXT, name.as_ptr()) } as usize);
    assert!(*address != 0);
    // SAFETY: see above.
    unsafe { std::mem::transmute_copy(address) }
}

/// Defines functions whose first argument is a path, a file descriptor or an open folder; which of the calls are
/// counted, the function before the name says.
macro_rules! functions {
    ($($where:ident $name:ident($first:ident: $kind:ty $(, $other:ident: $other_kind:ty)*) -> $result:ty, $failed:expr,
       $errors:expr;)*) => {
        $(
            /// # Safety
            /// As for libc's function of this name.
            #[unsafe(no_mangle)]
            pub unsafe extern "C" fn $name($first: $kind $(, $other: $other_kind)*) -> $result {
                const NAME: &CStr = match CStr::from_bytes_with_nul(concat!(stringify!($name), "\0").as_bytes()) {
                    Ok(name) => name,
                    Err(_) => c"?",
                };
                // SAFETY: the caller keeps the conditions of libc's function.
                unsafe {
                    if $where($first, NAME) && fails(NAME, &$errors) {
                        return $failed;
                    }
                    let next: unsafe extern "C" fn($kind $(, $other_kind)*) -> $result = libc(NAME);
                    next($first $(, $other)*)
                }
            }
        )*
    };
}

type Path = *const c_char;
type Bytes = *mut c_void;

unsafe fn is_folder(folder: *mut c_void, name: &'static CStr) -> bool {
    // SAFETY: the caller's pointer is an open folder.
    unsafe { is_moved(dirfd(folder), name) }
}

/// For operations that move data: whether this one is to be counted.
unsafe fn is_moved(file: c_int, name: &'static CStr) -> bool {
    is_ours(file) && !is_repeated(name, file)
}

unsafe fn is_file(file: c_int, _: &'static CStr) -> bool {
    is_ours(file)
}

functions! {
    is_moved read(file: c_int, into: Bytes, size: usize) -> isize, -1, [EIO];
    is_moved write(file: c_int, from: *const c_void, size: usize) -> isize, -1, [ENOSPC, EIO];
    is_moved writev(file: c_int, from: *const c_void, count: c_int) -> isize, -1, [ENOSPC, EIO];
    is_file lseek64(file: c_int, to: i64, from: c_int) -> i64, -1, [EIO];
    is_file ftruncate64(file: c_int, size: i64) -> c_int, -1, [ENOSPC, EIO];
    is_file flock(file: c_int, kind: c_int) -> c_int, -1, [EIO];
    is_folder readdir64(folder: *mut c_void) -> *mut c_void, std::ptr::null_mut(), [EIO];
    is_below mkdir(path: Path, mode: c_int) -> c_int, -1, [ENOSPC, EROFS];
    is_below rmdir(path: Path) -> c_int, -1, [EIO, EROFS];
    is_below unlink(path: Path) -> c_int, -1, [EIO, EROFS];
    is_below rename(path: Path, to: Path) -> c_int, -1, [ENOSPC, EROFS];
    is_below realpath(path: Path, into: *mut c_char) -> *mut c_char, std::ptr::null_mut(), [ENOENT, EACCES];
}

/// # Safety
/// As for libc's function of this name.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn open64(path: Path, flags: c_int, mode: c_int) -> c_int {
    // SAFETY: the caller keeps the conditions of libc's function.
    unsafe {
        let ours = is_below(path, c"open64");
        let writes = flags & (WRITES | CREATES) != 0;
        let errors: &[c_int] = if writes { &[ENOSPC, EROFS] } else { &[ENOENT, EMFILE] };
        if ours && fails(c"open64", errors) {
            return -1;
        }
        let next: unsafe extern "C" fn(Path, c_int, c_int) -> c_int = libc(c"open64");
        let file = next(path, flags, mode);
        mark(file, ours);
        file
    }
}

/// # Safety
/// As for libc's function of this name.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn opendir(path: Path) -> *mut c_void {
    // SAFETY: the caller keeps the conditions of libc's function.
    unsafe {
        let ours = is_below(path, c"opendir");
        if ours && fails(c"opendir", &[EACCES, EMFILE]) {
            return std::ptr::null_mut();
        }
        let next: unsafe extern "C" fn(Path) -> *mut c_void = libc(c"opendir");
        let folder = next(path);
        if !folder.is_null() {
            mark(dirfd(folder), ours);
        }
        folder
    }
}

/// # Safety
/// As for libc's function of this name.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn closedir(folder: *mut c_void) -> c_int {
    // SAFETY: the caller keeps the conditions of libc's function.
    unsafe {
        mark(dirfd(folder), false);
        let next: unsafe extern "C" fn(*mut c_void) -> c_int = libc(c"closedir");
        next(folder)
    }
}

/// # Safety
/// As for libc's function of this name.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn close(file: c_int) -> c_int {
    mark(file, false);
    // SAFETY: the caller keeps the conditions of libc's function.
    unsafe {
        let next: unsafe extern "C" fn(c_int) -> c_int = libc(c"close");
        next(file)
    }
}

/// # Safety
/// As for libc's function of this name.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn statx(
    folder: c_int,
    path: Path,
    flags: c_int,
    mask: u32,
    into: *mut c_void,
) -> c_int {
    /// The path is empty: the file is that of the descriptor.
    const OF_FILE: c_int = 0x1000;
    // SAFETY: the caller keeps the conditions of libc's function.
    unsafe {
        let ours = is_below(path, c"statx") || flags & OF_FILE != 0 && is_ours(folder);
        if ours && fails(c"statx", &[EIO, ENOENT]) {
            return -1;
        }
        let next: unsafe extern "C" fn(c_int, Path, c_int, u32, *mut c_void) -> c_int = libc(c"statx");
        next(folder, path, flags, mask, into)
    }
}
