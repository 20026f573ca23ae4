//! How many threads lavapipe works with: it reads that from the environment when it is first asked for devices.
#![allow(unsafe_code)]

use std::sync::atomic::{AtomicBool, Ordering};

/// Threads besides the calling one; a user's own setting wins.
const VARIABLE: &str = "LP_NUM_THREADS";

/// Whether the variable is ours.
static SET: AtomicBool = AtomicBool::new(false);

/// With how many threads lavapipe works, besides the one that calls; other drivers do not ask.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Threads {
    /// None for a scene of little work (below 20,000 tetrahedra), where waking threads costs more than they do: some 50 us a
    /// pass. As the driver likes for others.
    Auto,
    /// So many.
    Count(u32),
}

/// For instances made from here on; `None`: as the driver likes.
pub(super) fn choose(count: Option<u32>) {
    let ours = SET.load(Ordering::Relaxed);
    if !ours && std::env::var_os(VARIABLE).is_some() {
        return;
    }
    match count {
        Some(count) => {
            SET.store(true, Ordering::Relaxed);
            // SAFETY: who asks for threads promises that nobody else looks at the environment now (see `Options`).
            unsafe { std::env::set_var(VARIABLE, count.to_string()) };
        }
        None if ours => {
            SET.store(false, Ordering::Relaxed);
            // SAFETY: as above; without such a promise it was never set.
            unsafe { std::env::remove_var(VARIABLE) };
        }
        None => {}
    }
}
