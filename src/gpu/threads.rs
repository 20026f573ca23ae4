//! Sets the number of threads of lavapipe, Mesa's Vulkan driver for CPUs, by a variable of the process's environment.
//! The driver reads the variable when it first lists its devices.
#![allow(unsafe_code)]

use std::sync::atomic::{AtomicBool, Ordering};

/// Environment variable for the number of lavapipe's threads besides the one that calls Vulkan. A value that the user
/// set is kept.
const VARIABLE: &str = "LP_NUM_THREADS";

/// Whether this module, not the user, set [`VARIABLE`].
static SET: AtomicBool = AtomicBool::new(false);

/// Number of lavapipe's threads besides the one that calls Vulkan; other drivers ignore it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Threads {
    /// No further threads for a scene with less than 10,000 tetrahedra, where waking threads for each dispatch costs as
    /// much as they save; the driver's default for larger scenes. `Simulation::open` makes this choice.
    Auto,
    /// This number of threads besides the calling one.
    Count(u32),
}

/// Sets or removes [`VARIABLE`] for Vulkan instances that are made from now on; `None`: the environment stays as it is.
pub(super) fn choose(threads: Option<Threads>) {
    let ours = SET.load(Ordering::Relaxed);
    if !ours && std::env::var_os(VARIABLE).is_some() {
        return;
    }
    match threads {
        None => {}
        Some(Threads::Count(count)) => {
            SET.store(true, Ordering::Relaxed);
            // SAFETY: a caller that asks for threads, through `Options` or the options of the C interface, promises
            // that no other thread reads the environment now.
            unsafe { std::env::set_var(VARIABLE, count.to_string()) };
        }
        Some(Threads::Auto) if ours => {
            SET.store(false, Ordering::Relaxed);
            // SAFETY: the caller's promise for `Threads::Count` holds here too.
            unsafe { std::env::remove_var(VARIABLE) };
        }
        Some(Threads::Auto) => {}
    }
}
