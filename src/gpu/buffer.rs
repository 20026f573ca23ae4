//! Arrays in GPU memory. A [`Buffer`] is a cheap, reference-counted handle: the memory is freed with the last handle,
//! and a recording (command buffer) holds handles of all arrays that it uses.
#![allow(unsafe_code)]

use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};
use std::sync::atomic::Ordering;
use std::sync::{Arc, RwLock, RwLockReadGuard, RwLockWriteGuard};

use ash::vk;
use bytemuck::Pod;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};

use super::context::Context;
use super::{Recorder, failed};
use crate::error::{Error, Result};

/// Where the memory of a [`Buffer`] is, and how the CPU reaches it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Memory {
    /// GPU memory; the CPU reaches it only by copies through a staging buffer, which is mapped.
    Device,
    /// Memory that the CPU writes and the GPU reads: mapped and coherent, and on the GPU as far as the device has such
    /// memory. Where it has none, or [`Options::copies_inputs`] asks for it, GPU memory with a mapped staging array
    /// beside it, which [`super::Recorder::upload`] copies.
    ///
    /// [`Options::copies_inputs`]: crate::Options::copies_inputs
    Upload,
    /// Mapped, coherent memory in which the CPU leaves what is to be copied.
    Staging,
    /// Mapped, coherent and cached memory that the CPU reads.
    Readback,
}

/// How memory is exported to other programs: as an opaque file descriptor.
pub(super) const EXTERNAL: vk::ExternalMemoryHandleTypeFlags = vk::ExternalMemoryHandleTypeFlags::OPAQUE_FD;
/// Vulkan usages that every array is created with.
const USAGE: vk::BufferUsageFlags = vk::BufferUsageFlags::from_raw(
    vk::BufferUsageFlags::STORAGE_BUFFER.as_raw()
        | vk::BufferUsageFlags::UNIFORM_BUFFER.as_raw()
        | vk::BufferUsageFlags::STORAGE_TEXEL_BUFFER.as_raw()
        | vk::BufferUsageFlags::INDIRECT_BUFFER.as_raw()
        | vk::BufferUsageFlags::INDEX_BUFFER.as_raw()
        | vk::BufferUsageFlags::TRANSFER_SRC.as_raw()
        | vk::BufferUsageFlags::TRANSFER_DST.as_raw(),
);
/// Vulkan usages of an array that other programs bind: those of `USAGE`, and use as a vertex buffer.
pub(super) const SHARED_USAGE: vk::BufferUsageFlags =
    vk::BufferUsageFlags::from_raw(USAGE.as_raw() | vk::BufferUsageFlags::VERTEX_BUFFER.as_raw());
/// Bytes of an element of a texel buffer, one vec4 or uvec4.
const TEXEL_BYTES: u64 = 16;
/// Least size of a buffer, bytes; a buffer of this size is made even for an array without elements, so that it can be
/// bound.
const LEAST_BYTES: u64 = 16;

/// An array in memory that the GPU accesses, usable as storage, uniform or texel buffer, as indirect arguments, and as
/// source or target of copies.
#[derive(Clone)]
pub struct Buffer {
    pub(super) inner: Arc<Inner>,
    /// Names of those buffers of shaders to which this handle may be bound; empty: only the array's own name.
    roles: &'static [&'static str],
}

pub(super) struct Inner {
    pub context: Arc<Context>,
    pub name: String,
    pub handle: vk::Buffer,
    pub bytes: u64,
    pub memory: Memory,
    /// Texel buffer views with formats RGBA32F and RGBA32UI. `None` where the size is no multiple of 16 bytes or above
    /// the device's limit.
    pub views: Option<[vk::BufferView; 2]>,
    allocation: Option<Allocation>,
    /// The mapped array that is copied into this one, where the CPU cannot write this one: see [`Memory::Upload`].
    pub staging: Option<Buffer>,
    /// Dedicated memory of an array that is shared with other programs, and the size of that memory, bytes.
    own: Option<(vk::DeviceMemory, u64)>,
    /// Locks readers and writers on the CPU against each other while memory is mapped.
    mapping: RwLock<()>,
}

impl Buffer {
    /// Makes an uninitialised array of `bytes` bytes. It occupies at least 16 bytes, so that an array of 0 bytes can be
    /// bound too. An array larger than the device's largest storage buffer is refused; the error names it.
    pub fn new(context: &Arc<Context>, name: &str, bytes: u64, memory: Memory) -> Result<Buffer> {
        Self::made(context, name, bytes, memory, false)
    }

    /// Makes an array in GPU memory that other programs may bind, also as a vertex buffer. Where the device can export
    /// memory ([`Context::shares_memory`]), the array has dedicated memory, which other programs may import.
    pub fn shared(context: &Arc<Context>, name: &str, bytes: u64) -> Result<Buffer> {
        Self::made(context, name, bytes, Memory::Device, true)
    }

    fn made(context: &Arc<Context>, name: &str, bytes: u64, memory: Memory, is_shared: bool) -> Result<Buffer> {
        let limit = u64::from(context.limits.max_storage_buffer_range);
        // Only arrays in GPU memory are limited: staging arrays are never bound to a kernel.
        if memory == Memory::Device && bytes > limit {
            return Err(Error::Memory(format!(
                "array {name} needs {bytes} bytes, but a storage buffer of {} holds at most {limit} bytes",
                context.device_name()
            )));
        }
        let is_copied = memory == Memory::Upload && context.copies_inputs();
        let staging = || Self::made(context, &format!("{name} (staging)"), bytes, Memory::Staging, false);
        let staging = is_copied.then(staging).transpose()?;
        let memory = if is_copied { Memory::Device } else { memory };
        let usage = if is_shared { SHARED_USAGE } else { USAGE };
        let size = bytes.max(LEAST_BYTES).next_multiple_of(4);
        let is_external = is_shared && context.shares_memory();
        let mut external = vk::ExternalMemoryBufferCreateInfo::default().handle_types(EXTERNAL);
        let info = vk::BufferCreateInfo::default().size(size).usage(usage);
        let info = if is_external { info.push_next(&mut external) } else { info };
        // SAFETY: the device is alive; `info` lives through the call.
        let handle = unsafe { context.device.create_buffer(&info, None) }
            .map_err(failed("vkCreateBuffer", format!("array {name}")))?;
        context.labels.name(handle, name);
        // From here on, dropping `inner` frees whatever has been made so far.
        let mut inner = Inner {
            context: context.clone(),
            name: name.into(),
            handle,
            bytes,
            memory,
            views: None,
            allocation: None,
            staging,
            own: None,
            mapping: RwLock::new(()),
        };
        if is_external {
            inner.allocate_external()?;
        } else {
            inner.allocate()?;
        }
        if size.is_multiple_of(TEXEL_BYTES) && size / TEXEL_BYTES <= u64::from(context.limits.max_texel_buffer_elements)
        {
            inner.views = Some(inner.create_views()?);
        }
        Ok(Buffer { inner: Arc::new(inner), roles: &[] })
    }

    /// Makes an array that holds `data`. GPU memory is filled through a staging buffer, with a submit of its own.
    pub fn from_slice<T: Pod>(context: &Arc<Context>, name: &str, data: &[T], memory: Memory) -> Result<Buffer> {
        let buffer = Buffer::new(context, name, size_of_val(data) as u64, memory)?;
        buffer.write(data)?;
        Ok(buffer)
    }

    /// Another handle of this array, which may be bound to those buffers of shaders that have one of the names `roles`,
    /// and to no others. Without a call of this function, a handle may be bound only to buffers with the array's name.
    pub fn known_as(&self, roles: &'static [&'static str]) -> Buffer {
        Buffer { inner: self.inner.clone(), roles }
    }

    /// Whether this handle may be bound to a buffer that a shader declares as `name`.
    pub(super) fn may_be(&self, name: &str) -> bool {
        if self.roles.is_empty() { self.name() == name } else { self.roles.contains(&name) }
    }

    /// Name of the array, as it appears in messages.
    pub fn name(&self) -> &str {
        &self.inner.name
    }

    /// Size of the array as asked for, bytes.
    pub fn bytes(&self) -> u64 {
        self.inner.bytes
    }

    /// Where the memory is.
    pub fn memory(&self) -> Memory {
        self.inner.memory
    }

    /// The raw VkBuffer handle, for a program that shares the device.
    pub fn raw(&self) -> u64 {
        vk::Handle::as_raw(self.inner.handle)
    }

    /// Exports the memory of an array made by [`Buffer::shared`]: a file descriptor, which the caller must import or
    /// close, and the size of that memory, bytes. Fails where the array is not shared or the device cannot export
    /// memory.
    pub fn export(&self) -> Result<(i32, u64)> {
        let (Some(external), Some((memory, bytes))) = (&self.inner.context.external_memory, self.inner.own) else {
            return Err(self.misuse(
                "it cannot be exported: it is not shared, or the device lacks VK_KHR_external_memory_fd".into(),
            ));
        };
        let info = vk::MemoryGetFdInfoKHR::default().memory(memory).handle_type(EXTERNAL);
        // SAFETY: the memory is alive, and was allocated for export as such a file descriptor.
        let descriptor = unsafe { external.get_memory_fd(&info) }.map_err(failed("vkGetMemoryFdKHR", self.name()))?;
        Ok((descriptor, bytes))
    }

    /// Copies the whole array to the CPU, wherever its memory is. For GPU memory this takes a staging copy and a submit
    /// of its own, so the function is meant for tests and export, not for the step.
    pub fn read<T: Pod>(&self) -> Result<Vec<T>> {
        self.read_first(self.inner.bytes as usize / size_of::<T>())
    }

    /// Reads the first `count` elements, or all where there are fewer.
    pub fn read_first<T: Pod>(&self, count: usize) -> Result<Vec<T>> {
        let count = count.min(self.inner.bytes as usize / size_of::<T>());
        if self.inner.memory != Memory::Device {
            return Ok(self.mapped::<T>()?[..count].to_vec());
        }
        let bytes = (count * size_of::<T>()) as u64;
        if bytes == 0 {
            return Ok(Vec::new());
        }
        let name = format!("{} (read)", self.inner.name);
        let staging = Buffer::new(&self.inner.context, &name, bytes, Memory::Readback)?;
        let mut recorder = Recorder::untimed(&self.inner.context)?;
        recorder.stage("read");
        recorder.copy_range(self, 0, &staging, 0, bytes);
        recorder.finish()?.submit_and_wait()?;
        staging.read()
    }

    /// Overwrites the start of the array with `data`, wherever its memory is. For GPU memory this takes a staging copy
    /// and a submit of its own, like [`Buffer::read`].
    pub fn write<T: Pod>(&self, data: &[T]) -> Result<()> {
        let bytes = size_of_val(data) as u64;
        if bytes > self.inner.bytes {
            return Err(self.misuse(format!("{bytes} bytes do not fit into its {} bytes", self.inner.bytes)));
        }
        if bytes == 0 {
            return Ok(());
        }
        if self.inner.memory != Memory::Device {
            self.mapped_mut::<T>()?[..data.len()].copy_from_slice(data);
            return Ok(());
        }
        let staging =
            Buffer::from_slice(&self.inner.context, &format!("{} (write)", self.inner.name), data, Memory::Staging)?;
        let mut recorder = Recorder::untimed(&self.inner.context)?;
        recorder.stage("write");
        recorder.copy(&staging, self);
        recorder.finish()?.submit_and_wait()
    }

    /// A view of the mapped memory for reading, without a copy. Drop the view before submitting work that writes this
    /// buffer.
    pub fn mapped<T: Pod>(&self) -> Result<Mapped<'_, T>> {
        if let Some(staging) = &self.inner.staging {
            return staging.mapped();
        }
        let pointer = self.pointer::<T>()?;
        let guard = self.inner.mapping.read().unwrap_or_else(|e| e.into_inner());
        Ok(Mapped { pointer, length: self.length::<T>(), _guard: guard, _of: PhantomData })
    }

    /// A view of the mapped memory for writing, without a copy. Drop the view before submitting work that uses this
    /// buffer.
    pub fn mapped_mut<T: Pod>(&self) -> Result<MappedMut<'_, T>> {
        if let Some(staging) = &self.inner.staging {
            return staging.mapped_mut();
        }
        let pointer = self.pointer::<T>()?;
        let guard = self.inner.mapping.write().unwrap_or_else(|e| e.into_inner());
        Ok(MappedMut { pointer, length: self.length::<T>(), _guard: guard, _of: PhantomData })
    }

    fn length<T>(&self) -> usize {
        (self.inner.bytes as usize).checked_div(size_of::<T>()).unwrap_or(0)
    }

    fn pointer<T>(&self) -> Result<*mut T> {
        let pointer = self.inner.allocation.as_ref().and_then(|a| a.mapped_ptr());
        let Some(pointer) = pointer.filter(|_| self.inner.memory != Memory::Device) else {
            return Err(self.misuse("it is device memory, which is not mapped; use read() or write()".into()));
        };
        let pointer = pointer.as_ptr().cast::<T>();
        if !pointer.is_aligned() {
            return Err(self.misuse(format!("its memory is not aligned to {} bytes", align_of::<T>())));
        }
        Ok(pointer)
    }

    fn misuse(&self, what: String) -> Error {
        Error::Simulation(format!("array {}: {what}", self.inner.name))
    }
}

impl Inner {
    fn allocate(&mut self) -> Result<()> {
        let location = match self.memory {
            Memory::Device => MemoryLocation::GpuOnly,
            Memory::Upload | Memory::Staging => MemoryLocation::CpuToGpu,
            Memory::Readback => MemoryLocation::GpuToCpu,
        };
        let device = &self.context.device;
        // SAFETY: the buffer belongs to this live device.
        let requirements = unsafe { device.get_buffer_memory_requirements(self.handle) };
        let name = &self.name;
        let desc = AllocationCreateDesc {
            name,
            requirements,
            location,
            linear: true,
            allocation_scheme: AllocationScheme::GpuAllocatorManaged,
        };
        let allocation = self.context.allocator().allocate(&desc).map_err(|e| {
            Error::Memory(format!("array {name} of {} bytes gets no memory from the device: {e}", self.bytes))
        })?;
        // SAFETY: the range of memory belongs to this allocation alone, and meets the buffer's requirements.
        let bound = unsafe { device.bind_buffer_memory(self.handle, allocation.memory(), allocation.offset()) };
        if self.memory == Memory::Device {
            self.context.allocated.fetch_add(allocation.size(), Ordering::Relaxed);
        }
        self.allocation = Some(allocation);
        bound.map_err(failed("vkBindBufferMemory", format!("array {}", self.name)))
    }

    /// Allocates dedicated memory that can be exported, of the first memory type in GPU memory that suits the buffer.
    fn allocate_external(&mut self) -> Result<()> {
        let device = &self.context.device;
        // SAFETY: the buffer belongs to this live device.
        let requirements = unsafe { device.get_buffer_memory_requirements(self.handle) };
        let kind = self.context.device_memory_type(requirements.memory_type_bits);
        let kind = kind.ok_or_else(|| Error::Memory(format!("array {}: no suitable type of memory", self.name)))?;
        let mut export = vk::ExportMemoryAllocateInfo::default().handle_types(EXTERNAL);
        let mut dedicated = vk::MemoryDedicatedAllocateInfo::default().buffer(self.handle);
        let info = vk::MemoryAllocateInfo::default()
            .allocation_size(requirements.size)
            .memory_type_index(kind)
            .push_next(&mut export)
            .push_next(&mut dedicated);
        // SAFETY: the info lives through the call.
        let memory = unsafe { device.allocate_memory(&info, None) }
            .map_err(failed("vkAllocateMemory", format!("array {}", self.name)))?;
        self.own = Some((memory, requirements.size));
        self.context.allocated.fetch_add(requirements.size, Ordering::Relaxed);
        // SAFETY: the memory belongs to this buffer alone.
        unsafe { device.bind_buffer_memory(self.handle, memory, 0) }
            .map_err(failed("vkBindBufferMemory", format!("array {}", self.name)))
    }

    fn create_views(&self) -> Result<[vk::BufferView; 2]> {
        let view = |format| {
            let info = vk::BufferViewCreateInfo::default().buffer(self.handle).format(format).range(vk::WHOLE_SIZE);
            // SAFETY: the buffer is bound to memory and has texel usage, for which every device supports both formats.
            unsafe { self.context.device.create_buffer_view(&info, None) }
                .map_err(failed("vkCreateBufferView", format!("array {}", self.name)))
        };
        let float = view(vk::Format::R32G32B32A32_SFLOAT)?;
        match view(vk::Format::R32G32B32A32_UINT) {
            Ok(uint) => Ok([float, uint]),
            Err(error) => {
                // SAFETY: this view was made just above, and nothing uses it.
                unsafe { self.context.device.destroy_buffer_view(float, None) };
                Err(error)
            }
        }
    }
}

impl Drop for Inner {
    fn drop(&mut self) {
        // SAFETY: this is the last handle. Recordings hold handles and wait for their work, so the GPU no longer uses
        // the buffer.
        unsafe {
            for view in self.views.into_iter().flatten() {
                self.context.device.destroy_buffer_view(view, None);
            }
            self.context.device.destroy_buffer(self.handle, None);
        }
        if let Some((memory, bytes)) = self.own.take() {
            self.context.allocated.fetch_sub(bytes, Ordering::Relaxed);
            // SAFETY: the GPU no longer uses this memory; the buffer that was bound to it has been destroyed.
            unsafe { self.context.device.free_memory(memory, None) };
        }
        if let Some(allocation) = self.allocation.take() {
            if self.memory == Memory::Device {
                self.context.allocated.fetch_sub(allocation.size(), Ordering::Relaxed);
            }
            let _ = self.context.allocator().free(allocation);
        }
    }
}

/// A view of mapped memory for reading; other readers may exist at the same time, writers may not.
pub struct Mapped<'a, T> {
    pointer: *const T,
    length: usize,
    _guard: RwLockReadGuard<'a, ()>,
    _of: PhantomData<&'a [T]>,
}

/// A view of mapped memory for writing; no other view exists at the same time.
pub struct MappedMut<'a, T> {
    pointer: *mut T,
    length: usize,
    _guard: RwLockWriteGuard<'a, ()>,
    _of: PhantomData<&'a mut [T]>,
}

impl<T: Pod> Deref for Mapped<'_, T> {
    type Target = [T];
    fn deref(&self) -> &[T] {
        // SAFETY: the pointer is aligned and mapped for the buffer's life, which the guard borrows; any bit pattern is
        // a T (Pod); the lock keeps out writers on the CPU, and callers drop a mapping before they submit work that
        // writes the buffer.
        unsafe { std::slice::from_raw_parts(self.pointer, self.length) }
    }
}

impl<T: Pod> Deref for MappedMut<'_, T> {
    type Target = [T];
    fn deref(&self) -> &[T] {
        // SAFETY: as for `Mapped`; the guard is exclusive.
        unsafe { std::slice::from_raw_parts(self.pointer, self.length) }
    }
}

impl<T: Pod> DerefMut for MappedMut<'_, T> {
    fn deref_mut(&mut self) -> &mut [T] {
        // SAFETY: as for `Mapped`; the guard is exclusive.
        unsafe { std::slice::from_raw_parts_mut(self.pointer, self.length) }
    }
}
