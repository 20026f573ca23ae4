//! Graphics pipelines: the vertex shader fetches the corners of triangles from buffers itself, and the fragment shader
//! runs once per covered pixel. Either a pipeline has no attachments (images), and a stage of the time step uses the
//! rasterizer only to distribute work (recorded by `draw.rs`); or the pipeline renders onto the images of a canvas for
//! display (recorded by `canvas.rs`). A recording is a command buffer that holds handles of everything it uses.
#![allow(unsafe_code)]

use std::sync::Arc;

use ash::vk;

use super::context::Context;
use super::failed;
use super::image::{Texels, sample_flag};
use super::kernel::{Const, Interface, Module, Specialization, shader, specialised};
use super::spirv::Reflection;
use crate::error::{Error, Result};

/// How a pipeline draws onto a canvas (a set of images: colour, depth or both).
#[derive(Debug, Clone, Copy, Default)]
pub struct Onto {
    /// Whether the canvas has a colour attachment.
    pub has_colour: bool,
    /// Whether the canvas has a depth attachment, against which the depth of each drawn pixel is tested.
    pub has_depth: bool,
    /// Whether depth is written, so that what is drawn hides what lies behind it.
    pub hides: bool,
    /// Whether drawn colours are blended over earlier ones; the drawn colours must be premultiplied by their alpha.
    pub blends: bool,
    /// Face culling: triangles that show this side to the viewer are not drawn; `None`: all triangles are drawn.
    pub culls: Option<Side>,
    /// Samples per pixel: 1 or 4.
    pub samples: u32,
}

/// A side of a triangle, distinguished by the order in which the triangle's corners run in the rendered image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The side from which the corners run counter-clockwise.
    Front,
    /// The side from which the corners run clockwise.
    Back,
}

/// A graphics pipeline without vertex attributes. The value is a reference-counted handle, so cloning it is cheap.
#[derive(Clone)]
pub struct RasterPipeline(pub(super) Arc<PipelineInner>);

pub(super) struct PipelineInner {
    // Fields are dropped in the order in which they are declared: the interface before the device.
    pub interface: Interface,
    pub pipeline: vk::Pipeline,
    _context: Arc<Context>,
}

impl RasterPipeline {
    /// Makes a pipeline, without attachments, from the shaders `shaders/<name>.vert`, which may only read buffers, and
    /// `shaders/<name>.frag`, which may also write them. `constants` gives values to specialization constants by name,
    /// in each of the two shaders that declares the name; a name that neither shader declares is an error. On the
    /// device, fragment shaders must be able to write buffers ([`Context::fragment_stores`]).
    pub fn new(context: &Arc<Context>, name: &str, constants: &[(&str, Const)]) -> Result<RasterPipeline> {
        if !context.fragment_stores() {
            let device = context.device_name();
            return Err(Error::NoDevice(format!("{device} cannot run {name}: it lacks fragmentStoresAndAtomics")));
        }
        Self::made(context, name, constants, &Onto { samples: 1, ..Onto::default() })
    }

    /// Makes a pipeline from `shaders/<name>.vert` and `shaders/<name>.frag`, both of which may only read buffers. The
    /// pipeline draws as `onto` says, onto canvases with the attachments that `onto` names.
    pub fn onto(
        context: &Arc<Context>,
        name: &str,
        constants: &[(&str, Const)],
        onto: &Onto,
    ) -> Result<RasterPipeline> {
        let pipeline = Self::made(context, name, constants, onto)?;
        match pipeline.bindings().iter().find(|binding| binding.writes) {
            Some(written) => Err(Error::Simulation(format!(
                "pipeline {name} draws onto a canvas, so its shaders may not write {}",
                written.name
            ))),
            None => Ok(pipeline),
        }
    }

    fn made(context: &Arc<Context>, name: &str, constants: &[(&str, Const)], onto: &Onto) -> Result<RasterPipeline> {
        if !context.graphics {
            return Err(Error::NoDevice(format!(
                "{} cannot draw {name}: its queue only computes; choose another device for pictures (--device)",
                context.device_name()
            )));
        }
        let (vertex_words, vertex) = shader(context, &format!("{name}.vert"), context.arrays())?;
        let (fragment_words, fragment) = shader(context, &format!("{name}.frag"), context.arrays())?;
        let (of_vertex, of_fragment): (Vec<_>, Vec<_>) = (
            constants
                .iter()
                .copied()
                .filter(|(n, _)| !fragment.constants.contains_key(*n) || vertex.constants.contains_key(*n))
                .collect(),
            constants.iter().copied().filter(|(n, _)| fragment.constants.contains_key(*n)).collect(),
        );
        let of_vertex = Specialization::new(name, &vertex, &of_vertex)?;
        let of_fragment = Specialization::new(name, &fragment, &of_fragment)?;
        let mut declared: Vec<String> = vertex.names().chain(fragment.names()).map(Into::into).collect();
        declared.sort();
        declared.dedup();
        let number = |name: &str| declared.iter().position(|declared| declared == name).map(|at| at as u32);
        let (vertex_words, vertex) = specialised(name, &vertex_words, &of_vertex, number)?;
        let (fragment_words, fragment) = specialised(name, &fragment_words, &of_fragment, number)?;
        let modules = (Module::new(context, name, &vertex_words)?, Module::new(context, name, &fragment_words)?);
        let reflection = merge(vertex, fragment).map_err(|e| Error::Simulation(format!("pipeline {name}: {e}")))?;
        let stages = vk::ShaderStageFlags::VERTEX | vk::ShaderStageFlags::FRAGMENT;
        let interface = Interface::new(context, name, declared, reflection, stages)?;
        let (of_vertex, of_fragment) = (of_vertex.info(), of_fragment.info());
        let stage = |flag, module, special| {
            vk::PipelineShaderStageCreateInfo::default()
                .stage(flag)
                .module(module)
                .name(c"main")
                .specialization_info(special)
        };
        let stages = [
            stage(vk::ShaderStageFlags::VERTEX, modules.0.handle, &of_vertex),
            stage(vk::ShaderStageFlags::FRAGMENT, modules.1.handle, &of_fragment),
        ];
        let pipeline = create_pipeline(context, &interface, &stages, onto)?;
        context.labels.name(pipeline, name);
        Ok(RasterPipeline(Arc::new(PipelineInner { interface, pipeline, _context: context.clone() })))
    }

    /// The buffers that at least one of the two shaders uses.
    pub fn bindings(&self) -> &[super::spirv::Binding] {
        &self.0.interface.reflection.bindings
    }
}

impl Drop for PipelineInner {
    fn drop(&mut self) {
        // SAFETY: recordings hold handles of the pipelines they use, so no recording that uses this pipeline is left.
        unsafe { self.interface.device.destroy_pipeline(self.pipeline, None) };
    }
}

/// Merges the interfaces (buffers, push constants) of a pipeline's two shaders; fails if they contradict each other.
fn merge(mut vertex: Reflection, fragment: Reflection) -> std::result::Result<Reflection, String> {
    if let Some(written) = vertex.bindings.iter().find(|binding| binding.writes) {
        return Err(format!(
            "the vertex shader may write {}: declare it readonly, since only fragment shaders may write",
            written.name
        ));
    }
    for binding in fragment.bindings {
        match vertex.bindings.iter().find(|other| other.binding == binding.binding) {
            None => vertex.bindings.push(binding),
            Some(same) if same.kind == binding.kind && !binding.writes => {}
            Some(same) => return Err(format!("its vertex and fragment shader declare {} differently", same.name)),
        }
    }
    vertex.bindings.sort_by_key(|binding| binding.binding);
    vertex.push_bytes = vertex.push_bytes.max(fragment.push_bytes);
    Ok(vertex)
}

fn create_pipeline(
    context: &Context,
    interface: &Interface,
    stages: &[vk::PipelineShaderStageCreateInfo<'_>],
    onto: &Onto,
) -> Result<vk::Pipeline> {
    let vertices = vk::PipelineVertexInputStateCreateInfo::default();
    let assembly = vk::PipelineInputAssemblyStateCreateInfo::default().topology(vk::PrimitiveTopology::TRIANGLE_LIST);
    let viewport = vk::PipelineViewportStateCreateInfo::default().viewport_count(1).scissor_count(1);
    let cull = match onto.culls {
        None => vk::CullModeFlags::NONE,
        Some(Side::Front) => vk::CullModeFlags::FRONT,
        Some(Side::Back) => vk::CullModeFlags::BACK,
    };
    let raster = vk::PipelineRasterizationStateCreateInfo::default().cull_mode(cull).line_width(1.0);
    let samples =
        vk::PipelineMultisampleStateCreateInfo::default().rasterization_samples(sample_flag(onto.samples.max(1)));
    let depth = vk::PipelineDepthStencilStateCreateInfo::default()
        .depth_test_enable(onto.has_depth)
        .depth_write_enable(onto.has_depth && onto.hides)
        .depth_compare_op(vk::CompareOp::LESS_OR_EQUAL);
    let mix = [vk::PipelineColorBlendAttachmentState::default()
        .color_write_mask(vk::ColorComponentFlags::RGBA)
        .blend_enable(onto.blends)
        .src_color_blend_factor(vk::BlendFactor::ONE)
        .dst_color_blend_factor(vk::BlendFactor::ONE_MINUS_SRC_ALPHA)
        .src_alpha_blend_factor(vk::BlendFactor::ONE)
        .dst_alpha_blend_factor(vk::BlendFactor::ONE_MINUS_SRC_ALPHA)];
    let colours = [Texels::Colour.format()];
    let colour_count = usize::from(onto.has_colour);
    let blend = vk::PipelineColorBlendStateCreateInfo::default().attachments(&mix[..colour_count]);
    let dynamic = [vk::DynamicState::VIEWPORT, vk::DynamicState::SCISSOR];
    let dynamic = vk::PipelineDynamicStateCreateInfo::default().dynamic_states(&dynamic);
    let mut attachments = vk::PipelineRenderingCreateInfo::default().color_attachment_formats(&colours[..colour_count]);
    if onto.has_depth {
        attachments = attachments.depth_attachment_format(Texels::Depth.format());
    }
    let info = vk::GraphicsPipelineCreateInfo::default()
        .stages(stages)
        .vertex_input_state(&vertices)
        .input_assembly_state(&assembly)
        .viewport_state(&viewport)
        .rasterization_state(&raster)
        .multisample_state(&samples)
        .depth_stencil_state(&depth)
        .color_blend_state(&blend)
        .dynamic_state(&dynamic)
        .layout(interface.layout)
        .push_next(&mut attachments);
    // SAFETY: modules and layout belong to this device; every pointer lives through the call.
    let made = unsafe { context.device.create_graphics_pipelines(context.cache, &[info], None) };
    let stage = || format!("pipeline {}", interface.name);
    made.map(|pipelines| pipelines[0]).map_err(|(_, e)| failed("vkCreateGraphicsPipelines", stage())(e))
}
