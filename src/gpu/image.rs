//! Images that are rendered onto. They stay in Vulkan's general layout from the first use on, so that no code has to
//! track image layouts. Shaders do not read images: a shader that needs an image's content reads a copy of the image in
//! an array (a buffer in GPU memory).
#![allow(unsafe_code)]

use std::sync::Arc;
use std::sync::atomic::Ordering;

use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};

use super::context::Context;
use super::failed;
use crate::error::{Error, Result};

/// What each pixel of an image holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Texels {
    /// Red, green, blue and alpha, one byte each, without sRGB conversion.
    Colour,
    /// Depth, a 32-bit float.
    Depth,
}

/// A rectangle of pixels in GPU memory. The value is a reference-counted handle, so cloning it is cheap.
#[derive(Clone)]
pub struct Image(pub(super) Arc<ImageInner>);

pub(super) struct ImageInner {
    pub context: Arc<Context>,
    pub name: String,
    pub handle: vk::Image,
    pub view: vk::ImageView,
    pub texels: Texels,
    pub size: [u32; 2],
    pub samples: u32,
    allocation: Option<Allocation>,
}

impl Texels {
    pub(super) fn format(self) -> vk::Format {
        match self {
            Texels::Colour => vk::Format::R8G8B8A8_UNORM,
            Texels::Depth => vk::Format::D32_SFLOAT,
        }
    }

    pub(super) fn aspect(self) -> vk::ImageAspectFlags {
        match self {
            Texels::Colour => vk::ImageAspectFlags::COLOR,
            Texels::Depth => vk::ImageAspectFlags::DEPTH,
        }
    }

    fn usage(self) -> vk::ImageUsageFlags {
        let attachment = match self {
            Texels::Colour => vk::ImageUsageFlags::COLOR_ATTACHMENT,
            Texels::Depth => vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT,
        };
        attachment | vk::ImageUsageFlags::TRANSFER_SRC
    }
}

impl Image {
    /// Makes an uninitialised image of `size` pixels (width, height). `samples`, the number of samples per pixel,
    /// is 1 or 4.
    pub fn new(context: &Arc<Context>, name: &str, texels: Texels, size: [u32; 2], samples: u32) -> Result<Image> {
        let most = context.limits.max_framebuffer_width.min(context.limits.max_framebuffer_height);
        let most = most.min(context.limits.max_image_dimension2_d);
        if size.iter().any(|side| !(1..=most).contains(side)) {
            let [width, height] = size;
            return Err(Error::Usage(format!(
                "an image of {width} x {height} pixels was requested, but the device allows 1 to {most} pixels a side"
            )));
        }
        let usage = if samples == 1 { texels.usage() } else { texels.usage() & !vk::ImageUsageFlags::TRANSFER_SRC };
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(texels.format())
            .extent(vk::Extent3D { width: size[0], height: size[1], depth: 1 })
            .mip_levels(1)
            .array_layers(1)
            .samples(sample_flag(samples))
            .usage(usage);
        let stage = || format!("image {name}");
        // SAFETY: the device is alive; `info` lives through the call.
        let handle = unsafe { context.device.create_image(&info, None) }.map_err(failed("vkCreateImage", stage()))?;
        context.labels.name(handle, name);
        // From here on, dropping `inner` frees whatever has been made so far.
        let mut inner = ImageInner {
            context: context.clone(),
            name: name.into(),
            handle,
            view: vk::ImageView::null(),
            texels,
            size,
            samples,
            allocation: None,
        };
        inner.allocate()?;
        let range = vk::ImageSubresourceRange::default().aspect_mask(texels.aspect()).level_count(1).layer_count(1);
        let view = vk::ImageViewCreateInfo::default()
            .image(handle)
            .view_type(vk::ImageViewType::TYPE_2D)
            .format(texels.format())
            .subresource_range(range);
        // SAFETY: the image is alive and has memory.
        inner.view =
            unsafe { context.device.create_image_view(&view, None) }.map_err(failed("vkCreateImageView", stage()))?;
        Ok(Image(Arc::new(inner)))
    }

    /// Width and height, pixels.
    pub fn size(&self) -> [u32; 2] {
        self.0.size
    }

    /// What each pixel holds.
    pub fn texels(&self) -> Texels {
        self.0.texels
    }

    /// Size of the image's content, bytes: four bytes for each pixel, with one sample per pixel.
    pub fn bytes(&self) -> u64 {
        4 * u64::from(self.0.size[0]) * u64::from(self.0.size[1])
    }

    /// Name of the image.
    pub fn name(&self) -> &str {
        &self.0.name
    }
}

/// Vulkan's flag for a number of samples per pixel.
pub(super) fn sample_flag(samples: u32) -> vk::SampleCountFlags {
    if samples == 4 { vk::SampleCountFlags::TYPE_4 } else { vk::SampleCountFlags::TYPE_1 }
}

impl ImageInner {
    fn allocate(&mut self) -> Result<()> {
        let device = &self.context.device;
        // SAFETY: the image belongs to this live device.
        let requirements = unsafe { device.get_image_memory_requirements(self.handle) };
        let desc = AllocationCreateDesc {
            name: &self.name,
            requirements,
            location: MemoryLocation::GpuOnly,
            linear: false,
            allocation_scheme: AllocationScheme::GpuAllocatorManaged,
        };
        let allocation = self.context.allocator().allocate(&desc).map_err(|e| {
            let [width, height] = self.size;
            Error::Memory(format!(
                "image {} of {width} x {height} pixels gets no memory from the device: {e}",
                self.name
            ))
        })?;
        // SAFETY: the memory range belongs to this allocation alone, and meets the image's memory requirements.
        let bound = unsafe { device.bind_image_memory(self.handle, allocation.memory(), allocation.offset()) };
        self.context.allocated.fetch_add(allocation.size(), Ordering::Relaxed);
        self.allocation = Some(allocation);
        bound.map_err(failed("vkBindImageMemory", format!("image {}", self.name)))
    }
}

impl Drop for ImageInner {
    fn drop(&mut self) {
        // SAFETY: the last handle of this image is gone. Recordings (command buffers) hold handles of their images and
        // wait for their own end, so the GPU no longer uses the image. A null view is ignored.
        unsafe {
            self.context.device.destroy_image_view(self.view, None);
            self.context.device.destroy_image(self.handle, None);
        }
        if let Some(allocation) = self.allocation.take() {
            self.context.allocated.fetch_sub(allocation.size(), Ordering::Relaxed);
            let _ = self.context.allocator().free(allocation);
        }
    }
}
