//! Lists the Vulkan devices, finds out for each whether palpate (this engine) can run on it, and if not why, and
//! chooses one. A "device" is always a Vulkan device here, never a haptic device.
#![allow(unsafe_code)]

use std::ffi::CStr;

use ash::vk;

use super::details::details;
use super::failed;
use crate::error::{Error, Result};

/// Type of a Vulkan device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeviceKind {
    /// A GPU with memory of its own.
    Discrete,
    /// A GPU that shares the processor's memory.
    Integrated,
    /// A GPU seen through a virtual machine.
    Virtual,
    /// A software rasterizer on the processor.
    Cpu,
    /// A device of any other type.
    Other,
}

/// One Vulkan device, as the command `palpate devices` lists it.
#[derive(Debug, Clone)]
pub struct DeviceInfo {
    /// Index of the device in the Vulkan loader's list, from 0; a user may give it in place of the device's name.
    pub index: usize,
    /// Name that the driver gives the device.
    pub name: String,
    /// Type of the device.
    pub kind: DeviceKind,
    /// Name and version of the device's driver.
    pub driver: String,
    /// Vulkan version that the driver offers, such as `1.3.230`.
    pub api_version: String,
    /// `Ok` if palpate can run on the device; otherwise the reason why it cannot.
    pub usable: std::result::Result<(), String>,
    /// What the device offers, and what palpate chooses for it, each with a name, in words. Empty if it is not usable.
    pub details: Vec<(&'static str, String)>,
}

/// A physical device that may be chosen, with those of its properties that the engine needs.
pub(super) struct Candidate {
    pub physical: vk::PhysicalDevice,
    pub info: DeviceInfo,
    pub queue_family: u32,
    /// Whether the queue can draw.
    pub graphics: bool,
    pub timestamp_bits: u32,
    pub subgroup_size: u32,
    /// Whether all subgroups of a kernel have `subgroup_size` lanes, if it asks for full ones, and can add over them.
    pub full_subgroups: bool,
    pub int64_atomics: bool,
    pub fragment_stores: bool,
    pub external_memory_fd: bool,
    pub swapchain: bool,
    /// Whether the device lacks parts of Vulkan; such a device must be opened with VK_KHR_portability_subset.
    pub portability_subset: bool,
    pub properties: vk::PhysicalDeviceProperties,
    pub cache_key: String,
}

/// Advice for a user whose machine has no usable device.
pub(super) const REMEDY: &str = "On Debian or Ubuntu run ./setup.sh, or: apt-get install libvulkan1 \
     mesa-vulkan-drivers (software rendering); for a GPU install its vendor's driver with Vulkan 1.3.";

/// Every device of a Vulkan instance, in the order of the Vulkan loader's list.
pub(super) fn candidates(instance: &ash::Instance) -> Result<Vec<Candidate>> {
    // SAFETY: the instance is alive; the call only reads it.
    let physical = unsafe { instance.enumerate_physical_devices() }
        .map_err(failed("vkEnumeratePhysicalDevices", "device selection"))?;
    physical.into_iter().enumerate().map(|(index, device)| candidate(instance, index, device)).collect()
}

/// The device that `asked` names by its index or by part of its name; for `None`, the usable device with the most
/// preferred type (discrete GPU first).
pub(super) fn choose(candidates: Vec<Candidate>, asked: Option<&str>) -> Result<Candidate> {
    if candidates.is_empty() {
        return Err(Error::NoDevice(format!("Vulkan's loader found no device: no driver is installed. {REMEDY}")));
    }
    let list = candidates.iter().map(|c| describe(&c.info)).collect::<Vec<_>>().join("\n");
    let Some(asked) = asked else {
        let usable = candidates.into_iter().filter(|c| c.info.usable.is_ok());
        return usable
            .min_by_key(|c| (preference(c.info.kind), c.info.index))
            .ok_or_else(|| Error::NoDevice(format!("no Vulkan device can run palpate:\n{list}\n{REMEDY}")));
    };
    let by_index = asked.parse::<usize>().ok().filter(|i| *i < candidates.len());
    let lower = asked.to_lowercase();
    let matches = |c: &Candidate| by_index.map_or(c.info.name.to_lowercase().contains(&lower), |i| i == c.info.index);
    let mut found: Vec<Candidate> = candidates.into_iter().filter(matches).collect();
    found.sort_by_key(|c| c.info.usable.is_err());
    match found.into_iter().next() {
        None => Err(Error::NoDevice(format!(
            "no Vulkan device is called `{asked}` (haptic devices are chosen by --haptics); give an index or part of a name of:\n{list}"
        ))),
        Some(Candidate { info: DeviceInfo { name, usable: Err(why), .. }, .. }) => {
            Err(Error::NoDevice(format!("{name} cannot run palpate: {why}. {REMEDY}")))
        }
        Some(candidate) => Ok(candidate),
    }
}

fn describe(info: &DeviceInfo) -> String {
    let state = info.usable.as_ref().err().map(|why| format!(": {why}")).unwrap_or_default();
    format!("  {} {} ({}, Vulkan {}){state}", info.index, info.name, info.driver, info.api_version)
}

fn preference(kind: DeviceKind) -> u32 {
    match kind {
        DeviceKind::Discrete => 0,
        DeviceKind::Integrated => 1,
        DeviceKind::Virtual => 2,
        DeviceKind::Cpu => 3,
        DeviceKind::Other => 4,
    }
}

fn candidate(instance: &ash::Instance, index: usize, physical: vk::PhysicalDevice) -> Result<Candidate> {
    // SAFETY: `physical` was just enumerated from this live instance.
    let api = unsafe { instance.get_physical_device_properties(physical) }.api_version;
    let (mut driver, mut ids) =
        (vk::PhysicalDeviceDriverProperties::default(), vk::PhysicalDeviceIDProperties::default());
    let (mut subgroup, mut sizes) =
        (vk::PhysicalDeviceSubgroupProperties::default(), vk::PhysicalDeviceSubgroupSizeControlProperties::default());
    let mut all = vk::PhysicalDeviceProperties2::default().push_next(&mut subgroup);
    if api >= vk::API_VERSION_1_2 {
        all = all.push_next(&mut driver).push_next(&mut ids);
    }
    if api >= vk::API_VERSION_1_3 {
        all = all.push_next(&mut sizes);
    }
    // SAFETY: `physical` belongs to this live instance; only structs that the device's Vulkan version has are chained.
    unsafe { instance.get_physical_device_properties2(physical, &mut all) };
    let properties = all.properties;
    // SAFETY: `physical` belongs to this live instance.
    let families = unsafe { instance.get_physical_device_queue_family_properties(physical) };
    let family = queue_family(families.iter().map(|family| family.queue_flags));
    let graphics = family.is_some_and(|family| families[family].queue_flags.contains(vk::QueueFlags::GRAPHICS));
    // SAFETY: `physical` belongs to this live instance.
    let extensions = unsafe { instance.enumerate_device_extension_properties(physical) }
        .map_err(failed("vkEnumerateDeviceExtensionProperties", "device selection"))?;
    let offers = |name: &CStr| extensions.iter().any(|extension| extension.extension_name_as_c_str() == Ok(name));
    let features = features(instance, physical, api);
    let usable = match (features.lacking, family) {
        (Some(why), _) => Err(why),
        (None, None) => Err("it has no queue family with compute".into()),
        (None, Some(_)) => Ok(()),
    };
    let hex = |bytes: &[u8]| bytes.iter().map(|b| format!("{b:02x}")).collect::<String>();
    let text = |chars: &[std::ffi::c_char]| {
        // SAFETY: the driver wrote a NUL-terminated string into this array, which was zeroed beforehand.
        unsafe { CStr::from_ptr(chars.as_ptr()) }.to_string_lossy().into_owned()
    };
    let info = DeviceInfo {
        index,
        name: text(&properties.device_name),
        kind: kind(properties.device_type),
        driver: format!("{} {}", text(&driver.driver_name), text(&driver.driver_info)).trim().to_string(),
        api_version: version(api),
        usable,
        details: Vec::new(),
    };
    let mut candidate = Candidate {
        physical,
        info,
        queue_family: family.unwrap_or(0) as u32,
        graphics,
        timestamp_bits: family.map_or(0, |f| families[f].timestamp_valid_bits),
        subgroup_size: subgroup.subgroup_size,
        full_subgroups: features.full_subgroups
            && sizes.min_subgroup_size == sizes.max_subgroup_size
            && subgroup.supported_stages.contains(vk::ShaderStageFlags::COMPUTE)
            && subgroup.supported_operations.contains(vk::SubgroupFeatureFlags::ARITHMETIC),
        int64_atomics: features.int64_atomics,
        fragment_stores: features.fragment_stores && graphics,
        external_memory_fd: offers(ash::khr::external_memory_fd::NAME) && exports_buffers(instance, physical),
        swapchain: offers(ash::khr::swapchain::NAME),
        portability_subset: offers(ash::khr::portability_subset::NAME),
        properties,
        cache_key: format!("{}-{}", hex(&ids.device_uuid), hex(&ids.driver_uuid)),
    };
    candidate.info.details = details(instance, &candidate);
    Ok(candidate)
}

/// The first family with graphics and compute, else the first with compute alone: without graphics everything runs but
/// what draws.
fn queue_family(flags: impl Iterator<Item = vk::QueueFlags> + Clone) -> Option<usize> {
    let both = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
    let first = |wanted| flags.clone().position(|flags| flags.contains(wanted));
    first(both).or_else(|| first(vk::QueueFlags::COMPUTE))
}

/// Whether the device can export the memory of buffers to other programs as a file descriptor.
fn exports_buffers(instance: &ash::Instance, physical: vk::PhysicalDevice) -> bool {
    let info = vk::PhysicalDeviceExternalBufferInfo::default()
        .usage(super::buffer::SHARED_USAGE)
        .handle_type(super::buffer::EXTERNAL);
    let mut properties = vk::ExternalBufferProperties::default();
    // SAFETY: `physical` belongs to this live instance; the structs live through the call, which every device of Vulkan
    // 1.1 supports.
    unsafe { instance.get_physical_device_external_buffer_properties(physical, &info, &mut properties) };
    let can = properties.external_memory_properties.external_memory_features;
    can.contains(vk::ExternalMemoryFeatureFlags::EXPORTABLE)
}

/// What a device offers of the Vulkan features that the engine needs or can use.
#[derive(Default)]
struct Features {
    /// A message that names the required features that the device lacks; `None` if it lacks none.
    lacking: Option<String>,
    /// Whether the device has 64-bit atomics on storage buffers.
    int64_atomics: bool,
    /// Whether fragment shaders may write storage buffers.
    fragment_stores: bool,
    /// Whether a kernel may ask for subgroups all of whose lanes are in use.
    full_subgroups: bool,
}

fn features(instance: &ash::Instance, physical: vk::PhysicalDevice, api: u32) -> Features {
    if api < vk::API_VERSION_1_3 {
        let lacking = Some(format!("its driver offers Vulkan {}, but 1.3 is needed", version(api)));
        return Features { lacking, ..Features::default() };
    }
    let (mut v12, mut v13) =
        (vk::PhysicalDeviceVulkan12Features::default(), vk::PhysicalDeviceVulkan13Features::default());
    let mut all = vk::PhysicalDeviceFeatures2::default().push_next(&mut v12).push_next(&mut v13);
    // SAFETY: `physical` belongs to this live instance and offers Vulkan 1.3, so these structs may be chained.
    unsafe { instance.get_physical_device_features2(physical, &mut all) };
    let (int64, fragments) = (all.features.shader_int64 != 0, all.features.fragment_stores_and_atomics != 0);
    let wanted = [
        ("scalarBlockLayout", v12.scalar_block_layout),
        ("synchronization2", v13.synchronization2),
        ("dynamicRendering", v13.dynamic_rendering),
        ("maintenance4", v13.maintenance4),
    ];
    let lacking: Vec<_> = wanted.iter().filter(|(_, has)| *has == 0).map(|(name, _)| *name).collect();
    Features {
        lacking: (!lacking.is_empty()).then(|| format!("its driver lacks {}", lacking.join(", "))),
        int64_atomics: int64 && v12.shader_buffer_int64_atomics != 0,
        fragment_stores: fragments,
        full_subgroups: v13.compute_full_subgroups != 0,
    }
}

fn kind(ty: vk::PhysicalDeviceType) -> DeviceKind {
    match ty {
        vk::PhysicalDeviceType::DISCRETE_GPU => DeviceKind::Discrete,
        vk::PhysicalDeviceType::INTEGRATED_GPU => DeviceKind::Integrated,
        vk::PhysicalDeviceType::VIRTUAL_GPU => DeviceKind::Virtual,
        vk::PhysicalDeviceType::CPU => DeviceKind::Cpu,
        _ => DeviceKind::Other,
    }
}

fn version(api: u32) -> String {
    let (major, minor) = (vk::api_version_major(api), vk::api_version_minor(api));
    format!("{major}.{minor}.{}", vk::api_version_patch(api))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_queue_that_draws_is_preferred_and_one_that_computes_will_do() {
        let (graphics, compute) = (vk::QueueFlags::GRAPHICS, vk::QueueFlags::COMPUTE);
        let family = |flags: &[vk::QueueFlags]| queue_family(flags.iter().copied());
        assert_eq!(family(&[vk::QueueFlags::TRANSFER, compute, graphics | compute]), Some(2));
        assert_eq!(family(&[graphics, compute]), Some(1));
        assert_eq!(family(&[graphics]), None);
    }
}
