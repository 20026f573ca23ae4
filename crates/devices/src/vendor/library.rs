//! Opens a maker's library, and finds its functions.

use std::ffi::{CStr, c_char};
use std::path::Path;

use libloading::Library;
use palpate::internal::haptics::Fault;

/// Opens the library `file`, or the first of `names` that the system's loader can open. Where there is none, the fault's
/// text is what the loader says of a file that it found, else of the first name, and ends in `remedy`.
pub fn open(file: Option<&Path>, names: &[&str], remedy: &str) -> Result<Library, Fault> {
    // SAFETY: opening a library runs its code. It is the one that the user has installed under the name of the maker's,
    // or names outside of any scene.
    let open = |name: &Path| unsafe { Library::new(name) };
    if let Some(file) = file {
        return open(file).map_err(|error| lost(&error, remedy));
    }
    let mut failure = None;
    for name in names {
        match open(Path::new(name)) {
            Ok(library) => return Ok(library),
            Err(error) => {
                let is_found = |error: &libloading::Error| !error.to_string().contains("No such file");
                if failure.is_none() || is_found(&error) {
                    failure = Some(error);
                }
            }
        }
    }
    Err(failure.map_or_else(|| Fault::Lost(remedy.into()), |error| lost(&error, remedy)))
}

fn lost(error: &libloading::Error, remedy: &str) -> Fault {
    Fault::Lost(format!("{}: {remedy}", line(&error.to_string())))
}

/// Declares a struct of functions, each with the name under which a library exports it, and `of`, which finds them.
macro_rules! functions {
    ($(#[$about:meta])* $name:ident { $($field:ident = $symbol:ident: $kind:ty,)* }) => {
        $(#[$about])*
        #[derive(Clone, Copy)]
        struct $name {
            $($field: $kind,)*
        }

        impl $name {
            fn of(library: libloading::Library) -> Result<$name, palpate::internal::haptics::Fault> {
                $(
                    // SAFETY: the type is that of the function in the maker's documentation.
                    let $field: $kind = *unsafe { library.get::<$kind>(stringify!($symbol).as_bytes()) }
                        .map_err(|_| $crate::vendor::library::lacks(stringify!($symbol)))?;
                )*
                // The library is never closed: a thread of its own may still run in it.
                std::mem::forget(library);
                Ok($name { $($field,)* })
            }
        }
    };
}
pub(super) use functions;

/// The fault of a library without a function.
pub fn lacks(symbol: &str) -> Fault {
    Fault::Lost(format!("the library has no function {symbol}: install a newer version"))
}

/// The text of a library as one line of at most 200 characters; empty for a null pointer.
///
/// # Safety
/// The pointer is null, or points to a text that ends in a zero byte and does not change during the call.
pub unsafe fn text(pointer: *const c_char) -> String {
    match pointer.is_null() {
        true => String::new(),
        // SAFETY: the caller's promise.
        false => line(&unsafe { CStr::from_ptr(pointer) }.to_string_lossy()),
    }
}

fn line(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).take(200).collect()
}
