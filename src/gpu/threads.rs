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

/// For instances made from here on; `None`: the environment stays as it is.
pub(super) fn choose(threads: Option<Threads>) {
    let ours = SET.load(Ordering::Relaxed);
    if !ours && std::env::var_os(VARIABLE).is_some() {
        return;
    }
    match threads {
        None => {}
        Some(Threads::Count(count)) => {
            SET.store(true, Ordering::Relaxed);
            // SAFETY: who asks for threads, by `Options` or by the C interface's options, promises that nobody else looks at the
            // environment now.
            unsafe { std::env::set_var(VARIABLE, count.to_string()) };
        }
        Some(Threads::Auto) if ours => {
            SET.store(false, Ordering::Relaxed);
            // SAFETY: as above.
            unsafe { std::env::remove_var(VARIABLE) };
        }
        Some(Threads::Auto) => {}
    }
}
