//! Copies a rendered image into an image of a window's swapchain, with one command buffer that is recorded anew for
//! each copy.
#![allow(unsafe_code)]

use std::sync::Arc;

use ash::vk::{self, AccessFlags2 as Access, ImageLayout as Layout, PipelineStageFlags2 as Stages};

use super::{Content, STAGE};
use crate::error::Result;
use crate::gpu::image::Image;
use crate::gpu::{Context, failed};

/// The command buffer and its fence and semaphore; at most one copy is pending on the GPU at a time.
pub(super) struct Commands {
    context: Arc<Context>,
    pool: vk::CommandPool,
    buffer: vk::CommandBuffer,
    fence: vk::Fence,
    /// Whether a copy was submitted whose end nobody has waited for yet.
    is_under_way: bool,
    /// The rendered image that the pending copy reads; this handle keeps the image alive.
    picture: Option<Image>,
    /// Signalled when the acquired swapchain image may be overwritten; the copy waits for this semaphore.
    pub acquired: vk::Semaphore,
}

impl Commands {
    pub fn new(context: &Arc<Context>) -> Result<Commands> {
        let device = &context.device;
        let mut commands = Commands {
            context: context.clone(),
            pool: vk::CommandPool::null(),
            buffer: vk::CommandBuffer::null(),
            fence: vk::Fence::null(),
            is_under_way: false,
            picture: None,
            acquired: vk::Semaphore::null(),
        };
        let pool = vk::CommandPoolCreateInfo::default()
            .queue_family_index(context.queue_family)
            .flags(vk::CommandPoolCreateFlags::TRANSIENT);
        // SAFETY (of all calls below): the device is alive; each info lives through its call; on an error, dropping
        // `commands` frees what was made.
        unsafe {
            commands.pool = device.create_command_pool(&pool, None).map_err(failed("vkCreateCommandPool", STAGE))?;
            let info = vk::CommandBufferAllocateInfo::default().command_pool(commands.pool).command_buffer_count(1);
            commands.buffer =
                device.allocate_command_buffers(&info).map_err(failed("vkAllocateCommandBuffers", STAGE))?[0];
            let fence = device.create_fence(&vk::FenceCreateInfo::default(), None);
            commands.fence = fence.map_err(failed("vkCreateFence", STAGE))?;
            let semaphore = device.create_semaphore(&vk::SemaphoreCreateInfo::default(), None);
            commands.acquired = semaphore.map_err(failed("vkCreateSemaphore", STAGE))?;
        }
        Ok(commands)
    }

    /// Waits until the last copy has ended.
    pub fn wait(&mut self) -> Result<()> {
        if !std::mem::take(&mut self.is_under_way) {
            return Ok(());
        }
        let (device, fences) = (&self.context.device, [self.fence]);
        // SAFETY: the fence was submitted, and nobody else waits for it.
        unsafe {
            device.wait_for_fences(&fences, true, u64::MAX).map_err(failed("vkWaitForFences", STAGE))?;
            device.reset_fences(&fences).map_err(failed("vkResetFences", STAGE))
        }
    }

    /// Submits commands that fill the acquired swapchain image `image` of `size` pixels with `what`, and that signal
    /// `drawn` when the image's content is complete.
    pub fn copy(&mut self, what: Content, image: vk::Image, size: vk::Extent2D, drawn: vk::Semaphore) -> Result<()> {
        self.wait()?;
        let picture = if let Content::Picture(picture) = what { Some(picture.clone()) } else { None };
        let (device, buffer) = (&self.context.device, self.buffer);
        let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY (of all calls below): the pool's earlier commands have ended; both images are alive, and the swapchain
        // image is acquired; the queue is locked.
        unsafe {
            let reset = device.reset_command_pool(self.pool, vk::CommandPoolResetFlags::empty());
            reset.map_err(failed("vkResetCommandPool", STAGE))?;
            device.begin_command_buffer(buffer, &begin).map_err(failed("vkBeginCommandBuffer", STAGE))?;
            // The image's earlier content is discarded. The submit waits for the semaphore `acquired` in the pipeline
            // stage of this barrier (transfer), so the barrier comes after that wait.
            self.barrier(
                image,
                [Layout::UNDEFINED, Layout::TRANSFER_DST_OPTIMAL],
                Access::NONE,
                Access::TRANSFER_WRITE,
            );
            match what {
                Content::Colour(float32) => {
                    let (colour, layout) = (vk::ClearColorValue { float32 }, Layout::TRANSFER_DST_OPTIMAL);
                    device.cmd_clear_color_image(buffer, image, layout, &colour, &[whole()]);
                }
                Content::Picture(picture) => self.blit(picture, image, size),
            }
            let layouts = [Layout::TRANSFER_DST_OPTIMAL, Layout::PRESENT_SRC_KHR];
            self.barrier(image, layouts, Access::TRANSFER_WRITE, Access::NONE);
            device.end_command_buffer(buffer).map_err(failed("vkEndCommandBuffer", STAGE))?;
            let buffers = [vk::CommandBufferSubmitInfo::default().command_buffer(buffer)];
            let of =
                |semaphore| [vk::SemaphoreSubmitInfo::default().semaphore(semaphore).stage_mask(Stages::ALL_TRANSFER)];
            let (before, after) = (of(self.acquired), of(drawn));
            let submit = vk::SubmitInfo2::default()
                .wait_semaphore_infos(&before)
                .command_buffer_infos(&buffers)
                .signal_semaphore_infos(&after);
            let queue = self.context.queue();
            device.queue_submit2(queue.queue(), &[submit], self.fence).map_err(failed("vkQueueSubmit2", STAGE))?;
        }
        (self.is_under_way, self.picture) = (true, picture);
        Ok(())
    }

    fn barrier(&self, image: vk::Image, [old, new]: [Layout; 2], from: Access, to: Access) {
        let barriers = [vk::ImageMemoryBarrier2::default()
            .src_stage_mask(Stages::ALL_TRANSFER)
            .src_access_mask(from)
            .dst_stage_mask(Stages::ALL_TRANSFER)
            .dst_access_mask(to)
            .old_layout(old)
            .new_layout(new)
            .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .image(image)
            .subresource_range(whole())];
        let info = vk::DependencyInfo::default().image_memory_barriers(&barriers);
        // SAFETY: the command buffer is in recording state; the image is alive; synchronization2 is enabled.
        unsafe { self.context.device.cmd_pipeline_barrier2(self.buffer, &info) };
    }

    fn blit(&self, picture: &Image, image: vk::Image, size: vk::Extent2D) {
        // The GPU work that rendered `picture` has ended; this barrier makes the writes of that work visible to the
        // copy.
        let made = [vk::MemoryBarrier2::default()
            .src_stage_mask(Stages::ALL_COMMANDS)
            .src_access_mask(Access::MEMORY_WRITE)
            .dst_stage_mask(Stages::ALL_TRANSFER)
            .dst_access_mask(Access::TRANSFER_READ)];
        let layers = vk::ImageSubresourceLayers::default().aspect_mask(vk::ImageAspectFlags::COLOR).layer_count(1);
        let corner = |width: u32, height: u32| vk::Offset3D { x: width as i32, y: height as i32, z: 1 };
        let regions = [vk::ImageBlit2::default()
            .src_subresource(layers)
            .src_offsets([vk::Offset3D::default(), corner(picture.0.size[0], picture.0.size[1])])
            .dst_subresource(layers)
            .dst_offsets([vk::Offset3D::default(), corner(size.width, size.height)])];
        let info = vk::BlitImageInfo2::default()
            .src_image(picture.0.handle)
            .src_image_layout(Layout::GENERAL)
            .dst_image(image)
            .dst_image_layout(Layout::TRANSFER_DST_OPTIMAL)
            .regions(&regions)
            .filter(vk::Filter::LINEAR);
        let (device, dependency) = (&self.context.device, vk::DependencyInfo::default().memory_barriers(&made));
        // SAFETY: the command buffer is in recording state; both images are alive and in the layouts given to the call.
        unsafe {
            device.cmd_pipeline_barrier2(self.buffer, &dependency);
            device.cmd_blit_image2(self.buffer, &info);
        }
    }
}

impl Drop for Commands {
    fn drop(&mut self) {
        let _ = self.wait();
        let device = &self.context.device;
        // SAFETY: the last copy has ended; null handles are ignored.
        unsafe {
            device.destroy_semaphore(self.acquired, None);
            device.destroy_fence(self.fence, None);
            device.destroy_command_pool(self.pool, None);
        }
    }
}

/// The whole of a colour image.
fn whole() -> vk::ImageSubresourceRange {
    vk::ImageSubresourceRange {
        aspect_mask: vk::ImageAspectFlags::COLOR,
        level_count: 1,
        layer_count: 1,
        ..vk::ImageSubresourceRange::default()
    }
}
