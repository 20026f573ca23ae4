//! What a Vulkan device offers of what matters to the engine, and what the engine chooses for it, in words.
#![allow(unsafe_code)]

use ash::vk;

use super::context::{GROUP_SIZE, reduce_size};
use super::device::Candidate;

/// Pairs of a name and a value; empty for a device that cannot be used.
pub(super) fn details(instance: &ash::Instance, of: &Candidate) -> Vec<(&'static str, String)> {
    let Ok(own_size) = reduce_size(of, None) else { return Vec::new() };
    if of.info.usable.is_err() {
        return Vec::new();
    }
    let limits = &of.properties.limits;
    // SAFETY (both calls): the physical device belongs to this live instance.
    let (families, memory) = unsafe {
        (
            instance.get_physical_device_queue_family_properties(of.physical),
            instance.get_physical_device_memory_properties(of.physical),
        )
    };
    let queue = match of.timestamp_bits {
        0 => "no timestamps".into(),
        bits => format!("timestamps of {bits} bits, one tick is {} ns", limits.timestamp_period),
    };
    let sums = if of.full_subgroups { "sums over a subgroup are used" } else { "no sums over a subgroup" };
    let mut rows = vec![
        (
            "queue",
            format!(
                "family {} of {}, {}, {queue}",
                of.queue_family,
                families.len(),
                if of.graphics { "which draws" } else { "which cannot draw" }
            ),
        ),
        ("subgroups", format!("{} lanes; {sums}", of.subgroup_size)),
        (
            "workgroups",
            format!(
                "{own_size} invocations in kernels that synchronise, {GROUP_SIZE} in others; at most {}, with {} of \
                 shared memory",
                limits.max_compute_work_group_invocations,
                bytes(limits.max_compute_shared_memory_size.into())
            ),
        ),
        (
            "arrays",
            format!(
                "for each kernel {} texel buffers of up to {} elements, {} storage buffers of up to {}",
                limits.max_per_stage_descriptor_storage_images,
                limits.max_texel_buffer_elements,
                limits.max_per_stage_descriptor_storage_buffers,
                bytes(limits.max_storage_buffer_range.into())
            ),
        ),
        (
            "dispatches",
            format!(
                "up to {} workgroups; {} indirect draws at once",
                limits.max_compute_work_group_count[0], limits.max_draw_indirect_count
            ),
        ),
    ];
    let offers = [
        (of.int64_atomics, "64-bit atomics"),
        (of.fragment_stores, "stores from fragment shaders"),
        (of.external_memory_fd, "shared memory for other programs"),
        (of.swapchain, "windows"),
    ];
    let (has, lacks): (Vec<_>, Vec<_>) = offers.iter().partition(|(has, _)| *has);
    for (title, list) in [("offers", has), ("lacks", lacks)] {
        if !list.is_empty() {
            rows.push((title, list.iter().map(|(_, name)| *name).collect::<Vec<_>>().join(", ")));
        }
    }
    let types = &memory.memory_types[..memory.memory_type_count as usize];
    for (index, heap) in memory.memory_heaps[..memory.memory_heap_count as usize].iter().enumerate() {
        let in_heap = |ty: &&vk::MemoryType| ty.heap_index as usize == index;
        let visible = vk::MemoryPropertyFlags::HOST_VISIBLE;
        let is_visible = types.iter().filter(in_heap).any(|ty| ty.property_flags.contains(visible));
        let whose =
            if heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL) { "of the device" } else { "of the host" };
        let access = if is_visible { "the CPU can write it" } else { "the CPU cannot write it" };
        rows.push(("memory", format!("{} {whose}; {access}", bytes(heap.size))));
    }
    rows
}

fn bytes(count: u64) -> String {
    match count {
        1_000_000_000.. => format!("{:.1} GB", count as f64 / 1e9),
        1_000_000.. => format!("{:.0} MB", count as f64 / 1e6),
        _ => format!("{:.0} kB", count as f64 / 1e3),
    }
}
