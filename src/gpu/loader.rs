//! Guards the list of all devices of the process, which the Vulkan loader keeps. Loaders up to 1.4.341 at least change
//! this list without protection from other threads where a device is created or destroyed, and read it where a function
//! is looked up or an object is named, even in another instance (issue 2018 of Vulkan-Loader). So two threads that
//! each use a context of their own could crash the process.

use std::sync::{PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

static DEVICES: RwLock<()> = RwLock::new(());

/// To be held while instances or devices are created or destroyed.
pub(super) fn changes_devices() -> RwLockWriteGuard<'static, ()> {
    DEVICES.write().unwrap_or_else(PoisonError::into_inner)
}

/// To be held while functions of a device are looked up, or objects are named.
pub(super) fn reads_devices() -> RwLockReadGuard<'static, ()> {
    DEVICES.read().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use crate::gpu::{Buffer, Context, Memory, Options};

    /// Without the guards this crashes, sooner or later, with the loader of Debian 13 (1.4.309).
    #[test]
    fn contexts_open_and_close_while_other_threads_name_objects() {
        let device = std::env::var("PALPATE_TEST_DEVICE").ok();
        let open = || Context::open(&Options { device: device.clone(), ..Options::default() }).unwrap();
        std::thread::scope(|scope| {
            for _ in 0..2 {
                scope.spawn(|| (0..20).for_each(|_| drop(open())));
                scope.spawn(|| {
                    let context = open();
                    for _ in 0..500 {
                        Buffer::from_slice(&context, "named", &[0u32; 4], Memory::Device).unwrap();
                    }
                });
            }
        });
    }
}
