//! Drawing and reading back targets: what [`Recorder`] does with the graphics pipeline.
#![allow(unsafe_code)]

use ash::vk::{self, AccessFlags2 as Access, Handle, PipelineStageFlags2 as Stages};

use super::barrier::Use;
use super::buffer::Buffer;
use super::raster::{COLOR, DEPTH, Image, RasterPipeline, RasterTarget, aspect, range};
use super::recorder::Recorder;
use crate::error::Result;

/// Bytes of a VkDrawIndirectCommand.
const DRAW_ARGS: u64 = 16;

/// What a draw does with its target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pass {
    /// Colour and depth to clear the area to first; `None` keeps what is there.
    pub clear: Option<(u32, f32)>,
    /// Viewport and scissor: x, y, width, height in texels; `None` is the whole target.
    pub area: Option<[u32; 4]>,
}

impl Pass {
    /// The whole target, cleared first.
    pub fn cleared(color: u32, depth: f32) -> Pass {
        Pass { clear: Some((color, depth)), area: None }
    }
}

impl Recorder {
    /// Draws the triangles of the `slot`-th VkDrawIndirectCommand (four u32) of `args`. Buffers and push constants as
    /// for [`Recorder::dispatch`]. Without `clear`, an earlier draw of this recording must have drawn to the target.
    #[allow(clippy::too_many_arguments)] // A draw is a dispatch with a target.
    pub fn draw_indirect(
        &mut self,
        pipeline: &RasterPipeline,
        target: &RasterTarget,
        buffers: &[&Buffer],
        push: &[u8],
        args: &Buffer,
        slot: u32,
        pass: Pass,
    ) {
        let ready = self.try_draw(pipeline, target, buffers, push, (args, u64::from(slot) * DRAW_ARGS), pass);
        self.note(ready);
    }

    fn try_draw(
        &mut self,
        pipeline: &RasterPipeline,
        target: &RasterTarget,
        buffers: &[&Buffer],
        push: &[u8],
        (args, offset): (&Buffer, u64),
        pass: Pass,
    ) -> Result<()> {
        let interface = &pipeline.0.interface;
        let shading = Stages::VERTEX_SHADER | Stages::FRAGMENT_SHADER;
        self.check_args(args, offset, DRAW_ARGS)?;
        let [x, y, width, height] = pass.area.unwrap_or([0, 0, target.0.extent[0], target.0.extent[1]]);
        let fits = |at: u32, size: u32, whole: u32| size > 0 && at.checked_add(size).is_some_and(|end| end <= whole);
        if !fits(x, width, target.0.extent[0]) || !fits(y, height, target.0.extent[1]) {
            let what =
                format!("area {:?} lies outside target {} of {:?} texels", pass.area, target.0.name, target.0.extent);
            return Err(self.error(what));
        }
        let whole = [x, y, width, height] == [0, 0, target.0.extent[0], target.0.extent[1]];
        let id = target.0.color.handle.as_raw();
        // A draw that clears the whole needs nothing of what was there before.
        let discard = whole && pass.clear.is_some();
        if !(discard || self.commands.keeps(id)) {
            return Err(self.error(format!("the first draw to target {} must clear the whole of it", target.0.name)));
        }
        let mut uses = self.check_uses(interface, buffers, push, shading)?;
        if !self.is_well() {
            return Ok(());
        }
        self.add_args(&mut uses, args);
        uses.push(target_use(target, true));
        self.pass(&uses);
        self.transition(target, Layout::Draw { discard });
        self.commands.keep(id, &target.0);
        self.commands.keep(pipeline.0.pipeline.as_raw(), &pipeline.0);
        self.bind(interface, buffers, push, vk::PipelineBindPoint::GRAPHICS)?;
        let viewport = vk::Viewport {
            x: x as f32,
            y: y as f32,
            width: width as f32,
            height: height as f32,
            min_depth: 0.0,
            max_depth: 1.0,
        };
        let offset_2d = vk::Offset2D { x: x.cast_signed(), y: y.cast_signed() };
        let area = vk::Rect2D { offset: offset_2d, extent: vk::Extent2D { width, height } };
        let (device, commands) = (&self.commands.context.device, self.commands.buffer);
        // SAFETY: recording; pipeline, target, set and arguments are alive and kept; the area and the arguments lie
        // within theirs; target and pipeline share their formats.
        unsafe {
            device.cmd_bind_pipeline(commands, vk::PipelineBindPoint::GRAPHICS, pipeline.0.pipeline);
            device.cmd_set_viewport(commands, 0, &[viewport]);
            device.cmd_set_scissor(commands, 0, &[area]);
            begin_rendering(device, commands, target, area, pass.clear);
            device.cmd_draw_indirect(commands, args.0.handle, offset, 1, DRAW_ARGS as u32);
            device.cmd_end_rendering(commands);
        }
        Ok(())
    }

    /// Copies a target, row by row without padding, into one buffer of u32 and one of f32.
    pub fn copy_target(&mut self, target: &RasterTarget, color: &Buffer, depth: &Buffer) {
        let copied = self.try_copy_target(target, color, depth);
        self.note(copied);
    }

    fn try_copy_target(&mut self, target: &RasterTarget, color: &Buffer, depth: &Buffer) -> Result<()> {
        let [width, height] = target.0.extent;
        let bytes = u64::from(width) * u64::from(height) * 4;
        for buffer in [color, depth] {
            if buffer.bytes() < bytes {
                let (buffer, target) = (buffer.name(), &target.0.name);
                return Err(self.error(format!("target {target} of {bytes} bytes does not fit into {buffer}")));
            }
        }
        if color.0.handle == depth.0.handle || !self.commands.keeps(target.0.color.handle.as_raw()) {
            let what =
                format!("copy of target {}: nothing was drawn to it, or both copies go to one buffer", target.0.name);
            return Err(self.error(what));
        }
        if !self.is_well() {
            return Ok(());
        }
        let write = |buffer: &Buffer| Use {
            id: buffer.0.handle.as_raw(),
            reads: false,
            writes: true,
            stages: Stages::ALL_TRANSFER,
            write_access: Access::TRANSFER_WRITE,
        };
        self.pass(&[target_use(target, false), write(color), write(depth)]);
        self.transition(target, Layout::Copy);
        self.keep(color);
        self.keep(depth);
        for (image, format, buffer) in [(&target.0.color, COLOR, color), (&target.0.depth, DEPTH, depth)] {
            let layers = vk::ImageSubresourceLayers::default().aspect_mask(aspect(format)).layer_count(1);
            let extent = vk::Extent3D { width, height, depth: 1 };
            let region = [vk::BufferImageCopy::default().image_subresource(layers).image_extent(extent)];
            let (device, layout) = (&self.commands.context.device, vk::ImageLayout::TRANSFER_SRC_OPTIMAL);
            // SAFETY: recording, outside rendering; image and buffer are alive and kept, and the buffer has room.
            unsafe {
                device.cmd_copy_image_to_buffer(self.commands.buffer, image.handle, layout, buffer.0.handle, &region);
            }
        }
        Ok(())
    }

    /// Moves a target's images to the layout the next command needs.
    fn transition(&mut self, target: &RasterTarget, to: Layout) {
        let id = target.0.color.handle.as_raw();
        let copying = to == Layout::Copy;
        let was_copying = self.copying.contains(&id);
        let discard = to == Layout::Draw { discard: true };
        if copying == was_copying && !discard {
            return;
        }
        if copying {
            self.copying.insert(id)
        } else {
            self.copying.remove(&id)
        };
        let barrier = |image: &Image, format, drawn: vk::ImageLayout| {
            let copied = vk::ImageLayout::TRANSFER_SRC_OPTIMAL;
            let (old, new) = if copying { (drawn, copied) } else { (copied, drawn) };
            vk::ImageMemoryBarrier2::default()
                .image(image.handle)
                .subresource_range(range(aspect(format)))
                .old_layout(if discard { vk::ImageLayout::UNDEFINED } else { old })
                .new_layout(new)
                .src_stage_mask(DRAWN_STAGES | Stages::ALL_TRANSFER)
                .src_access_mask(DRAWN_ACCESS)
                .dst_stage_mask(if copying { Stages::ALL_TRANSFER } else { DRAWN_STAGES })
                .dst_access_mask(if copying { Access::TRANSFER_READ } else { DRAWN_ACCESS })
        };
        let barriers = [
            barrier(&target.0.color, COLOR, vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL),
            barrier(&target.0.depth, DEPTH, vk::ImageLayout::DEPTH_ATTACHMENT_OPTIMAL),
        ];
        let info = vk::DependencyInfo::default().image_memory_barriers(&barriers);
        // SAFETY: recording, outside rendering; the images are alive and kept, and in the layout stated.
        unsafe { self.commands.context.device.cmd_pipeline_barrier2(self.commands.buffer, &info) };
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Layout {
    Draw { discard: bool },
    Copy,
}

const DRAWN_STAGES: Stages = Stages::from_raw(
    Stages::COLOR_ATTACHMENT_OUTPUT.as_raw()
        | Stages::EARLY_FRAGMENT_TESTS.as_raw()
        | Stages::LATE_FRAGMENT_TESTS.as_raw(),
);
const DRAWN_ACCESS: Access = Access::from_raw(
    Access::COLOR_ATTACHMENT_READ.as_raw()
        | Access::COLOR_ATTACHMENT_WRITE.as_raw()
        | Access::DEPTH_STENCIL_ATTACHMENT_READ.as_raw()
        | Access::DEPTH_STENCIL_ATTACHMENT_WRITE.as_raw(),
);

/// One id stands for both images. A copy counts as a write too: it changes their layout.
fn target_use(target: &RasterTarget, draws: bool) -> Use {
    let (stages, write_access) =
        if draws { (DRAWN_STAGES, DRAWN_ACCESS) } else { (Stages::ALL_TRANSFER, Access::NONE) };
    Use { id: target.0.color.handle.as_raw(), reads: true, writes: true, stages, write_access }
}

/// # Safety
/// The command buffer is recording; the target is alive, kept, and in drawing layout.
unsafe fn begin_rendering(
    device: &ash::Device,
    commands: vk::CommandBuffer,
    target: &RasterTarget,
    area: vk::Rect2D,
    clear: Option<(u32, f32)>,
) {
    let load = if clear.is_some() { vk::AttachmentLoadOp::CLEAR } else { vk::AttachmentLoadOp::LOAD };
    let (color, depth) = clear.unwrap_or_default();
    let attachment = |image: &Image, layout, value| {
        vk::RenderingAttachmentInfo::default()
            .image_view(image.view)
            .image_layout(layout)
            .load_op(load)
            .store_op(vk::AttachmentStoreOp::STORE)
            .clear_value(value)
    };
    let value = vk::ClearValue { color: vk::ClearColorValue { uint32: [color, 0, 0, 0] } };
    let colors = [attachment(&target.0.color, vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL, value)];
    let value = vk::ClearValue { depth_stencil: vk::ClearDepthStencilValue { depth, stencil: 0 } };
    let depth = attachment(&target.0.depth, vk::ImageLayout::DEPTH_ATTACHMENT_OPTIMAL, value);
    let info = vk::RenderingInfo::default()
        .render_area(area)
        .layer_count(1)
        .color_attachments(&colors)
        .depth_attachment(&depth);
    // SAFETY: promised by the caller; dynamic rendering is enabled.
    unsafe { device.cmd_begin_rendering(commands, &info) };
}
