//! Rendering onto images, for the viewer: methods of [`Recorder`]. A canvas is a set of images that are rendered onto
//! together; a recording is a command buffer with the objects that it uses. Draws without images, by which the depth
//! stage (which finds penetration depths) distributes its work, are in `draw.rs`.
#![allow(unsafe_code)]

use ash::vk::{self, AccessFlags2 as Access, Handle, PipelineStageFlags2 as Stages};

use super::arguments::Arguments;
use super::barrier::{CANVAS, CANVAS_WRITE, Use};
use super::buffer::Buffer;
use super::image::{Image, Texels};
use super::raster::RasterPipeline;
use super::recorder::Recorder;
use crate::error::Result;

/// Attachments that are rendered onto together, all of one size.
#[derive(Clone, Default)]
pub struct Canvas {
    /// Colour attachment.
    pub colour: Option<Image>,
    /// Depth attachment, for hidden-surface removal.
    pub depth: Option<Image>,
    /// Resolve target. Where `colour` has several samples per pixel, this image receives their mean.
    pub mean: Option<Image>,
}

/// The content of a canvas before a pass draws onto it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Before {
    /// What earlier passes drew is kept.
    Kept,
    /// Colour is cleared to this value (red, green, blue, alpha; 0 to 1), and depth to infinitely far away.
    Cleared([f32; 4]),
}

/// One draw call: triangles, and the pipeline that draws them.
pub struct Drawn<'a> {
    /// Pipeline of the draw.
    pub pipeline: &'a RasterPipeline,
    /// Buffers and push constants of the pipeline's shaders.
    pub arguments: &'a dyn Arguments,
    /// Vertex indices, one u32 each; `None`: the draw is not indexed.
    pub indices: Option<&'a Buffer>,
    /// First index and number of indices; first vertex and number of vertices where the draw is not indexed.
    pub range: (u32, u32),
    /// Number of instances.
    pub instances: u32,
    /// Scissor rectangle, pixels: left, top, width, height; `None`: the whole canvas.
    pub part: Option<[u32; 4]>,
}

impl Canvas {
    fn images(&self) -> impl Iterator<Item = &Image> {
        self.colour.iter().chain(&self.depth).chain(&self.mean)
    }

    /// Width and height, pixels.
    pub fn size(&self) -> [u32; 2] {
        self.images().next().map_or([0; 2], Image::size)
    }
}

impl Recorder {
    /// Records the draws `all`, in order, as one pass onto a canvas.
    pub fn paint(&mut self, canvas: &Canvas, before: Before, all: &[Drawn]) {
        let ready = self.try_paint(canvas, before, all);
        self.note(ready);
    }

    fn try_paint(&mut self, canvas: &Canvas, before: Before, all: &[Drawn]) -> Result<()> {
        let size = canvas.size();
        if canvas.images().any(|image| image.size() != size) || size[0] == 0 {
            return Err(self.error("the images of a canvas differ in size, or there are none".into()));
        }
        let mut uses: Vec<Use> = canvas.images().map(drawn_onto).collect();
        let mut bound = Vec::new();
        for drawn in all {
            let (interface, shaders) = (&drawn.pipeline.0.interface, Stages::VERTEX_SHADER | Stages::FRAGMENT_SHADER);
            let (buffers, own) = self.check_uses(interface, drawn.arguments, shaders)?;
            uses.extend(own);
            bound.push(buffers);
            if let Some(indices) = drawn.indices {
                let end = u64::from(drawn.range.0) + u64::from(drawn.range.1);
                if 4 * end > indices.bytes() {
                    let what = format!(
                        "a draw needs {end} indices of 4 bytes, but array {} has {} bytes",
                        indices.name(),
                        indices.bytes()
                    );
                    return Err(self.error(what));
                }
                let id = indices.inner.handle.as_raw();
                uses.push(Use {
                    id,
                    reads: true,
                    writes: false,
                    stages: Stages::INDEX_INPUT,
                    write_access: Access::NONE,
                });
            }
        }
        if !self.is_well() {
            return Ok(());
        }
        let names: Vec<_> = all.iter().map(|drawn| drawn.pipeline.0.interface.name.as_str()).collect();
        self.pass("draw", &names.join(", "), &uses);
        canvas.images().for_each(|image| self.commands.keep(image.0.handle.as_raw(), &image.0));
        self.begin(canvas, before);
        let drawn = all.iter().zip(&bound).try_for_each(|(drawn, buffers)| self.draw_one(drawn, buffers, size));
        // SAFETY: the command buffer is recording, within the rendering that began above.
        unsafe { self.commands.context.device.cmd_end_rendering(self.commands.buffer) };
        drawn
    }

    fn begin(&mut self, canvas: &Canvas, before: Before) {
        let [width, height] = canvas.size();
        let (load, colour) = match before {
            Before::Kept => (vk::AttachmentLoadOp::LOAD, [0.0; 4]),
            Before::Cleared(colour) => (vk::AttachmentLoadOp::CLEAR, colour),
        };
        if before != Before::Kept {
            canvas.colour.iter().chain(&canvas.depth).for_each(|image| self.take(image));
        }
        canvas.mean.iter().for_each(|image| self.take(image));
        let attachment = |image: &Image| {
            vk::RenderingAttachmentInfo::default()
                .image_view(image.0.view)
                .image_layout(vk::ImageLayout::GENERAL)
                .load_op(load)
                .store_op(vk::AttachmentStoreOp::STORE)
        };
        let clear = vk::ClearValue { color: vk::ClearColorValue { float32: colour } };
        let far = vk::ClearValue { depth_stencil: vk::ClearDepthStencilValue { depth: 1.0, stencil: 0 } };
        let mut colours: Vec<_> = canvas.colour.iter().map(|image| attachment(image).clear_value(clear)).collect();
        if let (Some(colour), Some(mean)) = (colours.first_mut(), &canvas.mean) {
            *colour = colour
                .resolve_mode(vk::ResolveModeFlags::AVERAGE)
                .resolve_image_view(mean.0.view)
                .resolve_image_layout(vk::ImageLayout::GENERAL);
        }
        let depth = canvas.depth.as_ref().map(|image| attachment(image).clear_value(far));
        let area = vk::Rect2D { offset: vk::Offset2D::default(), extent: vk::Extent2D { width, height } };
        let mut rendering = vk::RenderingInfo::default().render_area(area).layer_count(1).color_attachments(&colours);
        if let Some(depth) = &depth {
            rendering = rendering.depth_attachment(depth);
        }
        let viewport =
            vk::Viewport { width: width as f32, height: height as f32, max_depth: 1.0, ..vk::Viewport::default() };
        let (device, commands) = (&self.commands.context.device, self.commands.buffer);
        // SAFETY: the command buffer is recording, outside rendering; the recording keeps the images alive; all of them
        // have one size and are in the general layout.
        unsafe {
            device.cmd_begin_rendering(commands, &rendering);
            device.cmd_set_viewport(commands, 0, &[viewport]);
        }
    }

    /// Moves an image to the general layout and discards its content.
    fn take(&mut self, image: &Image) {
        let range =
            vk::ImageSubresourceRange::default().aspect_mask(image.0.texels.aspect()).level_count(1).layer_count(1);
        let barriers = [vk::ImageMemoryBarrier2::default()
            .src_stage_mask(Stages::ALL_COMMANDS)
            .src_access_mask(Access::MEMORY_WRITE)
            .dst_stage_mask(CANVAS)
            .dst_access_mask(CANVAS_WRITE | Access::COLOR_ATTACHMENT_READ | Access::DEPTH_STENCIL_ATTACHMENT_READ)
            .old_layout(vk::ImageLayout::UNDEFINED)
            .new_layout(vk::ImageLayout::GENERAL)
            .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .image(image.0.handle)
            .subresource_range(range)];
        let info = vk::DependencyInfo::default().image_memory_barriers(&barriers);
        // SAFETY: the command buffer is recording, outside rendering; the recording keeps the image alive.
        unsafe { self.commands.context.device.cmd_pipeline_barrier2(self.commands.buffer, &info) };
    }

    fn draw_one(&mut self, drawn: &Drawn, buffers: &[&Buffer], size: [u32; 2]) -> Result<()> {
        let Drawn { pipeline, arguments, indices, range: (first, count), instances, part } = drawn;
        self.commands.keep(pipeline.0.pipeline.as_raw(), &pipeline.0);
        self.bind(&pipeline.0.interface, buffers, &arguments.push(), vk::PipelineBindPoint::GRAPHICS)?;
        if let Some(indices) = indices {
            self.keep(indices);
        }
        let [left, top, width, height] = part.unwrap_or([0, 0, size[0], size[1]]);
        let (width, height) = (width.min(size[0].saturating_sub(left)), height.min(size[1].saturating_sub(top)));
        let scissor = vk::Rect2D {
            offset: vk::Offset2D { x: left as i32, y: top as i32 },
            extent: vk::Extent2D { width, height },
        };
        let (device, commands) = (&self.commands.context.device, self.commands.buffer);
        // SAFETY: the command buffer is recording, within rendering; the recording keeps the pipeline, the descriptor
        // set and the indices alive; the range of indices was checked.
        unsafe {
            device.cmd_bind_pipeline(commands, vk::PipelineBindPoint::GRAPHICS, pipeline.0.pipeline);
            device.cmd_set_scissor(commands, 0, &[scissor]);
            match indices {
                Some(indices) => {
                    device.cmd_bind_index_buffer(commands, indices.inner.handle, 0, vk::IndexType::UINT32);
                    device.cmd_draw_indexed(commands, *count, *instances, *first, 0, 0);
                }
                None => device.cmd_draw(commands, *count, *instances, *first, 0),
            }
        }
        Ok(())
    }

    /// Copies all pixels of an image to an array, row by row from the top, four bytes per pixel. The image must have
    /// been drawn onto before and have one sample per pixel.
    pub fn copy_out(&mut self, image: &Image, array: &Buffer) {
        if array.bytes() < image.bytes() || image.0.samples > 1 {
            let what =
                format!("image {} of {} bytes cannot be copied to array {}", image.name(), image.bytes(), array.name());
            let error = Err(self.error(what));
            self.note(error);
        }
        if !self.is_well() {
            return;
        }
        let (source, target) = (image.0.handle.as_raw(), array.inner.handle.as_raw());
        let read =
            Use { id: source, reads: true, writes: false, stages: Stages::ALL_TRANSFER, write_access: Access::NONE };
        let written = Use { id: target, reads: false, writes: true, write_access: Access::TRANSFER_WRITE, ..read };
        self.pass("copy", array.name(), &[read, written]);
        self.commands.keep(source, &image.0);
        self.keep(array);
        let layers = vk::ImageSubresourceLayers::default().aspect_mask(image.0.texels.aspect()).layer_count(1);
        let [width, height] = image.size();
        let region = [vk::BufferImageCopy::default().image_subresource(layers).image_extent(vk::Extent3D {
            width,
            height,
            depth: 1,
        })];
        let layout = vk::ImageLayout::GENERAL;
        // SAFETY: the command buffer is recording, outside rendering; the recording keeps image and array alive; the
        // array has room for the image.
        unsafe {
            let device = &self.commands.context.device;
            device.cmd_copy_image_to_buffer(self.commands.buffer, image.0.handle, layout, array.inner.handle, &region);
        }
    }
}

fn drawn_onto(image: &Image) -> Use {
    let write_access = match image.0.texels {
        Texels::Colour => Access::COLOR_ATTACHMENT_WRITE,
        Texels::Depth => Access::DEPTH_STENCIL_ATTACHMENT_WRITE,
    };
    Use { id: image.0.handle.as_raw(), reads: true, writes: true, stages: CANVAS, write_access }
}
