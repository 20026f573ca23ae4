//! Borrows a Vulkan device that another program, the host, opened: what the host must specify about the
//! device, and how the device's queue is shared. In this file "host" is that program, not the CPU side.
#![allow(unsafe_code)]

use std::ffi::c_void;
use std::sync::MutexGuard;

use ash::vk::{self, Handle};

use super::device::{self, Candidate, REMEDY};
use crate::error::{Error, Result};

/// A Vulkan device that belongs to the host. The fields of type `u64` are raw Vulkan handles.
#[derive(Debug, Clone, Copy)]
pub struct HostDevice {
    /// vkGetInstanceProcAddr of the Vulkan loader that the handles come from; `None`: the system's loader.
    pub get_instance_proc_addr: Option<unsafe extern "C" fn()>,
    /// VkInstance.
    pub instance: u64,
    /// VkPhysicalDevice.
    pub physical_device: u64,
    /// VkDevice, with [`HostDevice::FEATURES`] enabled.
    pub device: u64,
    /// VkQueue of the device, which the engine submits to.
    pub queue: u64,
    /// Queue family of `queue`; it must support compute, and graphics where pictures are drawn.
    pub queue_family: u32,
    /// Whether shaderInt64 and shaderBufferInt64Atomics are enabled.
    pub int64_atomics: bool,
    /// Whether fragmentStoresAndAtomics is enabled.
    pub fragment_stores: bool,
    /// Whether VK_KHR_external_memory_fd is enabled.
    pub external_memory_fd: bool,
    /// The lock by which engine and host share the queue; `None`: the host never uses the queue while a call into the
    /// engine runs.
    pub lock: Option<QueueLock>,
}

/// The host's lock around its queue.
#[derive(Debug, Clone, Copy)]
pub struct QueueLock {
    /// Takes the lock; the engine calls this function before each use of the queue.
    pub lock: unsafe extern "C" fn(*mut c_void),
    /// Releases the lock; the engine calls this function on the thread that took the lock.
    pub unlock: unsafe extern "C" fn(*mut c_void),
    /// Argument that is passed to both functions.
    pub user: *mut c_void,
}

// SAFETY: `user` is only passed to the two functions, which may be called on any thread, as the host guarantees
// (`Context::on_host`).
unsafe impl Send for QueueLock {}
// SAFETY: the reason given for `Send` holds for `Sync` too.
unsafe impl Sync for QueueLock {}

impl HostDevice {
    /// Vulkan 1.3 features that the host must enable when it creates the device.
    pub const FEATURES: [&str; 4] = ["scalarBlockLayout", "synchronization2", "dynamicRendering", "maintenance4"];

    /// Loads the functions of the instance and of the Vulkan loader that the handles come from.
    ///
    /// # Safety
    /// The handles must meet the conditions of [`super::Context::on_host`].
    pub(super) unsafe fn instance(&self) -> Result<(ash::Entry, ash::Instance)> {
        let names = [
            ("instance", self.instance),
            ("physical_device", self.physical_device),
            ("device", self.device),
            ("queue", self.queue),
        ];
        if let Some((name, _)) = names.into_iter().find(|(_, handle)| *handle == 0) {
            return Err(Error::NoDevice(format!("the host's {name} is null; pass the handle")));
        }
        let entry = match self.get_instance_proc_addr {
            Some(function) => {
                // SAFETY: the caller guarantees that `function` is vkGetInstanceProcAddr, which has the target type.
                let get_instance_proc_addr =
                    unsafe { std::mem::transmute::<unsafe extern "C" fn(), vk::PFN_vkGetInstanceProcAddr>(function) };
                // SAFETY: the caller guarantees that the function belongs to a Vulkan loader.
                unsafe { ash::Entry::from_static_fn(ash::StaticFn { get_instance_proc_addr }) }
            }
            None => super::context::load()?,
        };
        // SAFETY: the caller guarantees that the instance is alive and comes from this loader.
        let instance = unsafe { ash::Instance::load(entry.static_fn(), vk::Instance::from_raw(self.instance)) };
        Ok((entry, instance))
    }

    /// The host's physical device, with only those optional features that the host enabled. Fails if the device cannot
    /// run palpate or does not belong to the instance, or if the queue family lacks compute.
    pub(super) fn candidate(&self, instance: &ash::Instance) -> Result<Candidate> {
        let own = vk::PhysicalDevice::from_raw(self.physical_device);
        let found = device::candidates(instance)?.into_iter().find(|candidate| candidate.physical == own);
        let wrong = |what: &str| Error::NoDevice(format!("the host's {what}"));
        let mut candidate = found.ok_or_else(|| {
            wrong(
                "physical_device is not one of the host's instance; pass the one that the host's device was made from",
            )
        })?;
        let name = candidate.info.name.clone();
        if let Err(why) = &candidate.info.usable {
            return Err(Error::NoDevice(format!("{name} cannot run palpate: {why}. {REMEDY}")));
        }
        // SAFETY: the instance and its physical device are alive, as the caller of [`HostDevice::instance`] promised.
        let families = unsafe { instance.get_physical_device_queue_family_properties(own) };
        match families.get(self.queue_family as usize) {
            None => {
                return Err(wrong(&format!(
                    "queue_family is {}; {name} has {} queue families, counted from 0",
                    self.queue_family,
                    families.len()
                )));
            }
            Some(family) if !family.queue_flags.contains(vk::QueueFlags::COMPUTE) => {
                return Err(wrong(&format!("queue_family {} lacks compute", self.queue_family)));
            }
            Some(family) => {
                candidate.timestamp_bits = family.timestamp_valid_bits;
                candidate.graphics = family.queue_flags.contains(vk::QueueFlags::GRAPHICS);
            }
        }
        candidate.queue_family = self.queue_family;
        candidate.int64_atomics &= self.int64_atomics;
        candidate.fragment_stores &= self.fragment_stores && candidate.graphics;
        candidate.full_subgroups = false;
        candidate.external_memory_fd &= self.external_memory_fd;
        Ok(candidate)
    }
}

/// The queue, locked for one thread of the engine; the host's threads are locked out too if the host gave a lock.
pub(super) struct QueueGuard<'a> {
    queue: MutexGuard<'a, vk::Queue>,
    lock: Option<QueueLock>,
}

impl<'a> QueueGuard<'a> {
    /// Takes the host's lock, if there is one. `queue` already holds the engine's own lock.
    pub fn new(queue: MutexGuard<'a, vk::Queue>, lock: Option<QueueLock>) -> QueueGuard<'a> {
        if let Some(QueueLock { lock, user, .. }) = lock {
            // SAFETY: the host guarantees that `lock` may be called with `user`, see `Context::on_host`.
            unsafe { lock(user) };
        }
        QueueGuard { queue, lock }
    }

    pub fn queue(&self) -> vk::Queue {
        *self.queue
    }
}

impl Drop for QueueGuard<'_> {
    fn drop(&mut self) {
        if let Some(QueueLock { unlock, user, .. }) = self.lock {
            // SAFETY: the host guarantees that `unlock` may be called with `user`; this thread took the lock.
            unsafe { unlock(user) };
        }
    }
}
