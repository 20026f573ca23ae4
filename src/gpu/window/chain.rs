//! A window's swapchain and its images, each with a semaphore that is signalled when the image's content is complete.
#![allow(unsafe_code)]

use std::sync::Arc;

use ash::vk;

use super::STAGE;
use crate::error::Result;
use crate::gpu::{Context, failed};

/// A swapchain; no work on its images may be pending when it is dropped.
pub(super) struct Chain {
    pub handle: vk::SwapchainKHR,
    pub images: Vec<Image>,
    /// Size of the images, pixels.
    pub extent: vk::Extent2D,
    /// Size of the window that the swapchain was made for, pixels.
    pub asked: [u32; 2],
    /// Whether the swapchain no longer fits the window.
    pub is_stale: bool,
    swapchains: ash::khr::swapchain::Device,
    context: Arc<Context>,
}

/// One image of a swapchain.
pub(super) struct Image {
    pub image: vk::Image,
    /// Signalled when the image's content is complete; presenting waits for it.
    pub drawn: vk::Semaphore,
}

impl Chain {
    /// Number of images to request: one more than the surface's minimum, so that one is free while others wait to be
    /// shown.
    pub fn images_of(can: &vk::SurfaceCapabilitiesKHR) -> u32 {
        let most = if can.max_image_count == 0 { u32::MAX } else { can.max_image_count };
        (can.min_image_count + 1).min(most)
    }

    pub fn new(
        context: &Arc<Context>,
        swapchains: &ash::khr::swapchain::Device,
        info: &vk::SwapchainCreateInfoKHR,
        asked: [u32; 2],
    ) -> Result<Chain> {
        // SAFETY: the surface is alive, and no work on the old swapchain (`info.old_swapchain`) is pending.
        let handle =
            unsafe { swapchains.create_swapchain(info, None) }.map_err(failed("vkCreateSwapchainKHR", STAGE))?;
        let mut chain = Chain {
            handle,
            images: Vec::new(),
            extent: info.image_extent,
            asked,
            is_stale: false,
            swapchains: swapchains.clone(),
            context: context.clone(),
        };
        // SAFETY: the swapchain is alive; on an error `chain` frees what was made.
        unsafe {
            let images = swapchains.get_swapchain_images(handle).map_err(failed("vkGetSwapchainImagesKHR", STAGE))?;
            for image in images {
                let drawn = context.device.create_semaphore(&vk::SemaphoreCreateInfo::default(), None);
                let drawn = drawn.map_err(failed("vkCreateSemaphore", STAGE))?;
                chain.images.push(Image { image, drawn });
            }
        }
        Ok(chain)
    }
}

impl Drop for Chain {
    fn drop(&mut self) {
        // SAFETY: the window waited until no work on the swapchain is pending.
        unsafe {
            self.images.iter().for_each(|image| self.context.device.destroy_semaphore(image.drawn, None));
            self.swapchains.destroy_swapchain(self.handle, None);
        }
    }
}
