//! The graphics pipeline without attachments, where a stage wants the rasterizer to share out work: triangles whose
//! corners the vertex shader fetches itself, an invocation of the fragment shader a pixel. `draw.rs` records with it.
#![allow(unsafe_code)]

use std::sync::Arc;

use ash::vk;

use super::context::Context;
use super::failed;
use super::kernel::{Const, Interface, Module, Specialization, shader};
use super::spirv::Reflection;
use crate::error::{Error, Result};

/// A graphics pipeline; a cheap handle. No vertex attributes, no culling, no attachments.
#[derive(Clone)]
pub struct RasterPipeline(pub(super) Arc<PipelineInner>);

pub(super) struct PipelineInner {
    pub interface: Interface,
    pub pipeline: vk::Pipeline,
}

impl RasterPipeline {
    /// The pipeline of `shaders/<name>.vert`, which may only read its buffers, and `.frag`, which may write them.
    /// `constants` are given to the stages that declare them; a name that neither declares is an error. The device must
    /// have [`Context::fragment_stores`].
    pub fn new(context: &Arc<Context>, name: &str, constants: &[(&str, Const)]) -> Result<RasterPipeline> {
        if !context.fragment_stores() {
            let device = context.device_name();
            return Err(Error::NoDevice(format!("{device} cannot run {name}: it lacks fragmentStoresAndAtomics")));
        }
        let (vertex_words, vertex) = shader(context, &format!("{name}.vert"))?;
        let (fragment_words, fragment) = shader(context, &format!("{name}.frag"))?;
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
        let modules = (Module::new(context, name, &vertex_words)?, Module::new(context, name, &fragment_words)?);
        let reflection = merge(vertex, fragment).map_err(|e| Error::Simulation(format!("pipeline {name}: {e}")))?;
        let stages = vk::ShaderStageFlags::VERTEX | vk::ShaderStageFlags::FRAGMENT;
        let interface = Interface::new(context, name, reflection, stages)?;
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
        let pipeline = create_pipeline(context, &interface, &stages)?;
        context.labels.name(pipeline, name);
        Ok(RasterPipeline(Arc::new(PipelineInner { interface, pipeline })))
    }

    /// The bindings of both stages, ascending: the order in which buffers are given.
    pub fn bindings(&self) -> &[super::spirv::Binding] {
        &self.0.interface.reflection.bindings
    }
}

impl Drop for PipelineInner {
    fn drop(&mut self) {
        // SAFETY: recordings hold handles, so none that uses the pipeline is left.
        unsafe { self.interface.context.device.destroy_pipeline(self.pipeline, None) };
    }
}

/// The interface of both stages together.
fn merge(mut vertex: Reflection, fragment: Reflection) -> std::result::Result<Reflection, String> {
    if let Some(written) = vertex.bindings.iter().find(|binding| binding.writes) {
        return Err(format!("{} is not readonly; only fragments may write", written.name));
    }
    for binding in fragment.bindings {
        match vertex.bindings.iter().find(|other| other.binding == binding.binding) {
            None => vertex.bindings.push(binding),
            Some(same) if *same == binding => {}
            Some(other) => {
                return Err(format!(
                    "binding {} is {} in one stage and {} in the other",
                    binding.binding, other.name, binding.name
                ));
            }
        }
    }
    vertex.bindings.sort_by_key(|binding| binding.binding);
    vertex.push_bytes = vertex.push_bytes.max(fragment.push_bytes);
    vertex.structs.extend(fragment.structs);
    Ok(vertex)
}

fn create_pipeline(
    context: &Context,
    interface: &Interface,
    stages: &[vk::PipelineShaderStageCreateInfo<'_>],
) -> Result<vk::Pipeline> {
    let vertices = vk::PipelineVertexInputStateCreateInfo::default();
    let assembly = vk::PipelineInputAssemblyStateCreateInfo::default().topology(vk::PrimitiveTopology::TRIANGLE_LIST);
    let viewport = vk::PipelineViewportStateCreateInfo::default().viewport_count(1).scissor_count(1);
    let raster = vk::PipelineRasterizationStateCreateInfo::default().cull_mode(vk::CullModeFlags::NONE).line_width(1.0);
    let samples = vk::PipelineMultisampleStateCreateInfo::default().rasterization_samples(vk::SampleCountFlags::TYPE_1);
    let dynamic = [vk::DynamicState::VIEWPORT, vk::DynamicState::SCISSOR];
    let dynamic = vk::PipelineDynamicStateCreateInfo::default().dynamic_states(&dynamic);
    let mut no_attachments = vk::PipelineRenderingCreateInfo::default();
    let info = vk::GraphicsPipelineCreateInfo::default()
        .stages(stages)
        .vertex_input_state(&vertices)
        .input_assembly_state(&assembly)
        .viewport_state(&viewport)
        .rasterization_state(&raster)
        .multisample_state(&samples)
        .dynamic_state(&dynamic)
        .layout(interface.layout)
        .push_next(&mut no_attachments);
    // SAFETY: modules and layout belong to this device; every pointer lives through the call.
    let made = unsafe { context.device.create_graphics_pipelines(context.cache, &[info], None) };
    let stage = || format!("pipeline {}", interface.name);
    made.map(|pipelines| pipelines[0]).map_err(|(_, e)| failed("vkCreateGraphicsPipelines", stage())(e))
}
