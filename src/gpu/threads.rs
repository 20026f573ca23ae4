//! Number of threads of lavapipe, Mesa's Vulkan driver for CPUs. The driver reads it from the environment when it first
//! lists its devices.
#![allow(unsafe_code)]

use std::sync::atomic::{AtomicBool, Ordering};

/// Number of lavapipe's threads besides the calling one. A value that the user set is kept.
const VARIABLE: &str = "LP_NUM_THREADS";

/// Whether this module set the variable.
static SET: AtomicBool = AtomicBool::new(false);

/// Number of lavapipe's threads besides the one that calls Vulkan; other drivers ignore it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Threads {
    /// No further threads for a scene with less than 20,000 tetrahedra, where waking threads costs more (some 50 us per
    /// pass) than they save; the driver's default for larger scenes. `Simulation::open` decides this.
    Auto,
    /// This number.
    Count(u32),
}

/// Sets the variable for Vulkan instances made from here on; `None`: the environment stays as it is.
pub(super) fn choose(threads: Option<Threads>) {
    let ours = SET.load(Ordering::Relaxed);
    if !ours && std::env::var_os(VARIABLE).is_some() {
        return;
    }
    match threads {
        None => {}
        Some(Threads::Count(count)) => {
            SET.store(true, Ordering::Relaxed);
            // SAFETY: whoever asks for threads, through `Options` or the options of the C interface, promises that no
            // other thread reads the environment now.
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
