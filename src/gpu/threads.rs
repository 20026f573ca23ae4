//! How many threads lavapipe works with: it reads that from the environment when it is first asked for devices.
#![allow(unsafe_code)]

use std::sync::atomic::{AtomicBool, Ordering};

/// Threads besides the calling one; a user's own setting wins.
const VARIABLE: &str = "LP_NUM_THREADS";

/// Whether the variable is ours.
static SET: AtomicBool = AtomicBool::new(false);

/// For instances made from here on: the calling thread alone, or as the driver likes.
pub(super) fn choose(one_thread: bool) {
    let ours = SET.load(Ordering::Relaxed);
    if one_thread && !ours && std::env::var_os(VARIABLE).is_none() {
        SET.store(true, Ordering::Relaxed);
        // SAFETY: who asks for one thread promises that nobody else looks at the environment now (see `Options`).
        unsafe { std::env::set_var(VARIABLE, "0") };
    } else if !one_thread && ours {
        SET.store(false, Ordering::Relaxed);
        // SAFETY: as above; without such a promise it was never set.
        unsafe { std::env::remove_var(VARIABLE) };
    }
}
