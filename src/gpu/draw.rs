//! Draws without attachments (images that are rendered onto): a method of [`Recorder`], which writes passes into a
//! command buffer (the recording). The depth stage of a time step, which finds penetration depths, can use the
//! rasterizer to distribute its work; the stage's fragment shader writes buffers instead of an image.
#![allow(unsafe_code)]

use ash::vk::{self, Handle, PipelineStageFlags2 as Stages};

use super::arguments::Arguments;
use super::buffer::Buffer;
use super::raster::RasterPipeline;
use super::recorder::Recorder;
use crate::error::Result;

/// Size of a VkDrawIndirectCommand, bytes.
const DRAW_ARGS: u64 = 16;

impl Recorder {
    /// Records a draw of triangles. The viewport has `side` x `side` pixels and shows the whole of clip space.
    /// `arguments` are the buffers and push constants of the shaders; the vertex and instance counts are those of the
    /// VkDrawIndirectCommand (four u32) with index `slot` in `args`.
    pub fn draw_indirect(
        &mut self,
        pipeline: &RasterPipeline,
        arguments: &dyn Arguments,
        args: &Buffer,
        slot: u32,
        side: u32,
    ) {
        let ready = self.try_draw(pipeline, arguments, (args, u64::from(slot) * DRAW_ARGS), side);
        self.note(ready);
    }

    fn try_draw(
        &mut self,
        pipeline: &RasterPipeline,
        arguments: &dyn Arguments,
        (args, offset): (&Buffer, u64),
        side: u32,
    ) -> Result<()> {
        let interface = &pipeline.0.interface;
        let limits = &self.commands.context.limits;
        let most = limits.max_framebuffer_width.min(limits.max_framebuffer_height);
        let most = most.min(limits.max_viewport_dimensions[0]).min(limits.max_viewport_dimensions[1]);
        if side == 0 || side > most {
            let what = format!(
                "{}: a viewport with {side} pixels a side was requested, but the device allows 1 to {most}",
                interface.name
            );
            return Err(self.error(what));
        }
        self.check_args(args, offset, DRAW_ARGS)?;
        let shaders = Stages::VERTEX_SHADER | Stages::FRAGMENT_SHADER;
        let (buffers, mut uses) = self.check_uses(interface, arguments, shaders)?;
        if !self.is_well() {
            return Ok(());
        }
        self.add_args(&mut uses, args);
        self.pass("", &format!("{0}.vert, {0}.frag", interface.name), &uses);
        self.commands.keep(pipeline.0.pipeline.as_raw(), &pipeline.0);
        self.bind(interface, &buffers, &arguments.push(), vk::PipelineBindPoint::GRAPHICS)?;
        let area = vk::Rect2D { offset: vk::Offset2D::default(), extent: vk::Extent2D { width: side, height: side } };
        let viewport =
            vk::Viewport { width: side as f32, height: side as f32, max_depth: 1.0, ..vk::Viewport::default() };
        let rendering = vk::RenderingInfo::default().render_area(area).layer_count(1);
        let (device, commands) = (&self.commands.context.device, self.commands.buffer);
        // SAFETY: the command buffer is in recording state; the recording keeps the pipeline, the descriptor set and
        // `args` alive; the VkDrawIndirectCommand lies within `args`, and the area within the device's limits; neither
        // the pipeline nor the rendering has attachments.
        unsafe {
            device.cmd_bind_pipeline(commands, vk::PipelineBindPoint::GRAPHICS, pipeline.0.pipeline);
            device.cmd_set_viewport(commands, 0, &[viewport]);
            device.cmd_set_scissor(commands, 0, &[area]);
            device.cmd_begin_rendering(commands, &rendering);
            if self.is_empty() {
                device.cmd_draw(commands, 0, 1, 0, 0);
            } else {
                device.cmd_draw_indirect(commands, args.inner.handle, offset, 1, DRAW_ARGS as u32);
            }
            device.cmd_end_rendering(commands);
        }
        Ok(())
    }
}
