//! The graphics pipeline, where a stage wants it: triangles whose corners the vertex shader fetches itself, and the
//! R32_UINT colour and depth images they are drawn into. `draw.rs` records with them.
#![allow(unsafe_code)]

use std::sync::Arc;
use std::sync::atomic::Ordering;

use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};

use super::context::Context;
use super::failed;
use super::kernel::{Const, Interface, Module, Specialization, shader};
use super::spirv::Reflection;
use crate::error::{Error, Result};

pub(super) const COLOR: vk::Format = vk::Format::R32_UINT;
pub(super) const DEPTH: vk::Format = vk::Format::D32_SFLOAT;

/// Which fragment stays, of those at one texel. Vulkan's depth runs from 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DepthTest {
    /// The nearer one; the earlier of equals.
    Less,
    /// The nearer one; the later of equals.
    LessOrEqual,
    /// The farther one; the earlier of equals.
    Greater,
    /// The farther one; the later of equals.
    GreaterOrEqual,
}

/// A graphics pipeline; a cheap handle. No vertex attributes, no culling.
#[derive(Clone)]
pub struct RasterPipeline(pub(super) Arc<PipelineInner>);

pub(super) struct PipelineInner {
    pub interface: Interface,
    pub pipeline: vk::Pipeline,
}

impl RasterPipeline {
    /// The pipeline of `shaders/<name>.vert` and `.frag`; both may only read their buffers. `constants` are given to
    /// the stages that declare them; a name that neither declares is an error.
    pub fn new(
        context: &Arc<Context>,
        name: &str,
        test: DepthTest,
        constants: &[(&str, Const)],
    ) -> Result<RasterPipeline> {
        let (vertex_words, vertex) = shader(&format!("{name}.vert"))?;
        let (fragment_words, fragment) = shader(&format!("{name}.frag"))?;
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
        let pipeline = create_pipeline(context, &interface, &stages, test)?;
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
fn merge(mut a: Reflection, b: Reflection) -> std::result::Result<Reflection, String> {
    for binding in b.bindings {
        match a.bindings.iter().find(|other| other.binding == binding.binding) {
            None => a.bindings.push(binding),
            Some(same) if *same == binding => {}
            Some(other) => {
                return Err(format!(
                    "binding {} is {} in one stage and {} in the other",
                    binding.binding, other.name, binding.name
                ));
            }
        }
    }
    a.bindings.sort_by_key(|binding| binding.binding);
    if let Some(written) = a.bindings.iter().find(|binding| binding.writes) {
        return Err(format!("{} is not readonly; a draw writes only its target", written.name));
    }
    a.push_bytes = a.push_bytes.max(b.push_bytes);
    a.structs.extend(b.structs);
    Ok(a)
}

fn create_pipeline(
    context: &Context,
    interface: &Interface,
    stages: &[vk::PipelineShaderStageCreateInfo<'_>],
    test: DepthTest,
) -> Result<vk::Pipeline> {
    let compare = match test {
        DepthTest::Less => vk::CompareOp::LESS,
        DepthTest::LessOrEqual => vk::CompareOp::LESS_OR_EQUAL,
        DepthTest::Greater => vk::CompareOp::GREATER,
        DepthTest::GreaterOrEqual => vk::CompareOp::GREATER_OR_EQUAL,
    };
    let vertices = vk::PipelineVertexInputStateCreateInfo::default();
    let assembly = vk::PipelineInputAssemblyStateCreateInfo::default().topology(vk::PrimitiveTopology::TRIANGLE_LIST);
    let viewport = vk::PipelineViewportStateCreateInfo::default().viewport_count(1).scissor_count(1);
    let raster = vk::PipelineRasterizationStateCreateInfo::default().cull_mode(vk::CullModeFlags::NONE).line_width(1.0);
    let samples = vk::PipelineMultisampleStateCreateInfo::default().rasterization_samples(vk::SampleCountFlags::TYPE_1);
    let depth = vk::PipelineDepthStencilStateCreateInfo::default()
        .depth_test_enable(true)
        .depth_write_enable(true)
        .depth_compare_op(compare);
    let attachment = [vk::PipelineColorBlendAttachmentState::default().color_write_mask(vk::ColorComponentFlags::R)];
    let blend = vk::PipelineColorBlendStateCreateInfo::default().attachments(&attachment);
    let dynamic = [vk::DynamicState::VIEWPORT, vk::DynamicState::SCISSOR];
    let dynamic = vk::PipelineDynamicStateCreateInfo::default().dynamic_states(&dynamic);
    let mut formats = vk::PipelineRenderingCreateInfo::default()
        .color_attachment_formats(std::slice::from_ref(&COLOR))
        .depth_attachment_format(DEPTH);
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
        .push_next(&mut formats);
    // SAFETY: modules and layout belong to this device; every pointer lives through the call.
    let made = unsafe { context.device.create_graphics_pipelines(context.cache, &[info], None) };
    let stage = || format!("pipeline {}", interface.name);
    made.map(|pipelines| pipelines[0]).map_err(|(_, e)| failed("vkCreateGraphicsPipelines", stage())(e))
}

/// A colour image of unsigned integers and its depth image; a cheap handle. Contents last from one draw to the next
/// within a recording; the first draw of a recording must clear the whole.
#[derive(Clone)]
pub struct RasterTarget(pub(super) Arc<TargetInner>);

pub(super) struct TargetInner {
    context: Arc<Context>,
    pub name: String,
    pub extent: [u32; 2],
    pub color: Image,
    pub depth: Image,
}

#[derive(Default)]
pub(super) struct Image {
    pub handle: vk::Image,
    pub view: vk::ImageView,
    allocation: Option<Allocation>,
}

impl RasterTarget {
    /// A target of `width` x `height` texels, 8 bytes each.
    pub fn new(context: &Arc<Context>, name: &str, width: u32, height: u32) -> Result<RasterTarget> {
        let limit = context.limits.max_image_dimension2_d.min(context.limits.max_framebuffer_width);
        let limit = limit.min(context.limits.max_framebuffer_height);
        if width == 0 || height == 0 || width > limit || height > limit {
            let what = format!("target {name} of {width} x {height} texels; the device draws 1 to {limit} a side");
            return Err(Error::Simulation(what));
        }
        use vk::FormatFeatureFlags as Offers;
        let enough = context.format_offers(COLOR, Offers::COLOR_ATTACHMENT | Offers::TRANSFER_SRC)
            && context.format_offers(DEPTH, Offers::DEPTH_STENCIL_ATTACHMENT | Offers::TRANSFER_SRC);
        if !enough {
            return Err(Error::NoDevice(format!(
                "{} cannot draw to R32_UINT with D32_SFLOAT depth; use the compute path",
                context.device_name()
            )));
        }
        let mut inner = TargetInner {
            context: context.clone(),
            name: name.into(),
            extent: [width, height],
            color: Image::default(),
            depth: Image::default(),
        };
        inner.color.create(context, name, [width, height], COLOR)?;
        inner.depth.create(context, name, [width, height], DEPTH)?;
        Ok(RasterTarget(Arc::new(inner)))
    }

    /// Width and height, texels.
    pub fn extent(&self) -> [u32; 2] {
        self.0.extent
    }
}

impl Image {
    /// Creates image, memory and view in turn; on an error the target's `Drop` frees what was made.
    fn create(&mut self, context: &Context, name: &str, extent: [u32; 2], format: vk::Format) -> Result<()> {
        let attachment = if format == COLOR {
            vk::ImageUsageFlags::COLOR_ATTACHMENT
        } else {
            vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT
        };
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(format)
            .extent(vk::Extent3D { width: extent[0], height: extent[1], depth: 1 })
            .mip_levels(1)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .usage(attachment | vk::ImageUsageFlags::TRANSFER_SRC);
        let (device, stage) = (&context.device, || format!("target {name}"));
        // SAFETY (this and the next): the device is alive, infos live through their calls.
        self.handle = unsafe { device.create_image(&info, None) }.map_err(failed("vkCreateImage", stage()))?;
        let requirements = unsafe { device.get_image_memory_requirements(self.handle) };
        context.labels.name(self.handle, name);
        let desc = AllocationCreateDesc {
            name,
            requirements,
            location: MemoryLocation::GpuOnly,
            linear: false,
            allocation_scheme: AllocationScheme::GpuAllocatorManaged,
        };
        let allocated = context.allocator().allocate(&desc);
        let allocation = self.allocation.insert(
            allocated.map_err(|e| Error::Simulation(format!("target {name} gets no memory from the device: {e}")))?,
        );
        context.allocated.fetch_add(allocation.size(), Ordering::Relaxed);
        let view = vk::ImageViewCreateInfo::default()
            .image(self.handle)
            .view_type(vk::ImageViewType::TYPE_2D)
            .format(format)
            .subresource_range(range(aspect(format)));
        // SAFETY: the range belongs to this allocation alone; the view is of an image bound just now.
        unsafe {
            device
                .bind_image_memory(self.handle, allocation.memory(), allocation.offset())
                .map_err(failed("vkBindImageMemory", stage()))?;
            self.view = device.create_image_view(&view, None).map_err(failed("vkCreateImageView", stage()))?;
        }
        Ok(())
    }
}

impl Drop for TargetInner {
    fn drop(&mut self) {
        for image in [&mut self.color, &mut self.depth] {
            // SAFETY: the last handle goes; recordings hold handles and wait for their work. Null handles are ignored.
            unsafe {
                self.context.device.destroy_image_view(image.view, None);
                self.context.device.destroy_image(image.handle, None);
            }
            if let Some(allocation) = image.allocation.take() {
                self.context.allocated.fetch_sub(allocation.size(), Ordering::Relaxed);
                let _ = self.context.allocator().free(allocation);
            }
        }
    }
}

pub(super) fn aspect(format: vk::Format) -> vk::ImageAspectFlags {
    if format == COLOR { vk::ImageAspectFlags::COLOR } else { vk::ImageAspectFlags::DEPTH }
}

pub(super) fn range(aspect: vk::ImageAspectFlags) -> vk::ImageSubresourceRange {
    vk::ImageSubresourceRange {
        aspect_mask: aspect,
        base_mip_level: 0,
        level_count: 1,
        base_array_layer: 0,
        layer_count: 1,
    }
}
