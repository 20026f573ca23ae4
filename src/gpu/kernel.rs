//! Compute kernels: immutable compute pipelines, each with the interface (buffers, push constants) that its shader's
//! SPIR-V declares. A kernel is made once, and any recording (command buffer) can use it. A *variant* of a shader is
//! the shader with given values of its specialization constants. A [`Context`] is an opened Vulkan device; it keeps the
//! kernels that it has made, so that a second simulation of the same body opens without compiling them again.
#![allow(unsafe_code)]

use std::cell::RefCell;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use ash::vk;

use super::context::{Arrays, Context};
use super::spirv::{self, Binding, BindingKind, ConstKind, Reflection};
use super::{failed, specialise};
use crate::error::{Error, Result};

/// Id of the specialization constant ONE_SUBGROUP: whether a workgroup is one subgroup (shaders/shared/sums.glsl).
pub(super) const ONE_SUBGROUP: u32 = 30;

mod table {
    include!(concat!(env!("OUT_DIR"), "/spirv.rs"));
}
pub(super) use table::MOST_TEXEL_BUFFERS;

/// How the workgroup size of a kernel is chosen; specialization constant 0 of the shader gets this size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Size {
    /// For kernels with one invocation per element; see [`Context::group_size`].
    Group,
    /// For kernels with one workgroup per item of work, where the invocations of a workgroup synchronise at barriers;
    /// see [`Context::reduce_size`].
    Reduce,
    /// One invocation per workgroup.
    One,
}

/// The value of a specialization constant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Const {
    /// Value of a constant of type `uint`.
    Uint(u32),
    /// Value of a constant of type `int`.
    Int(i32),
    /// Value of a constant of type `float`.
    Float(f32),
    /// Value of a constant of type `bool`.
    Bool(bool),
}

impl From<u32> for Const {
    fn from(value: u32) -> Self {
        Const::Uint(value)
    }
}

impl From<i32> for Const {
    fn from(value: i32) -> Self {
        Const::Int(value)
    }
}

impl From<f32> for Const {
    fn from(value: f32) -> Self {
        Const::Float(value)
    }
}

impl From<bool> for Const {
    fn from(value: bool) -> Self {
        Const::Bool(value)
    }
}

impl Const {
    fn bits(self) -> (ConstKind, u32) {
        match self {
            Const::Uint(v) => (ConstKind::Uint, v),
            Const::Int(v) => (ConstKind::Int, v.cast_unsigned()),
            Const::Float(v) => (ConstKind::Float, v.to_bits()),
            Const::Bool(v) => (ConstKind::Bool, u32::from(v)),
        }
    }
}

/// A compute pipeline. The value is a reference-counted handle, so cloning it is cheap.
#[derive(Clone)]
pub struct Kernel {
    // Fields are dropped in the order in which they are declared: the pipeline before the device.
    pub(super) inner: Arc<Inner>,
    _context: Arc<Context>,
}

pub(super) struct Inner {
    pub interface: Interface,
    pub pipeline: vk::Pipeline,
    pub local_size: u32,
}

/// What tells two variants of the library's shaders apart on one device.
#[derive(PartialEq, Eq, Hash)]
struct Variant {
    shader: String,
    arrays: Arrays,
    /// Ids of specialization constants and the bits of their values, sorted.
    constants: Vec<(u32, u32)>,
}

/// Number of variants above which those that nothing uses are dropped; one simulation uses some thirty.
const MOST_KEPT: usize = 128;

/// The variants that a context has made.
#[derive(Default)]
pub(super) struct Kept(Mutex<HashMap<Variant, Arc<Inner>>>);

impl Kept {
    fn find(&self, variant: &Variant) -> Option<Arc<Inner>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).get(variant).cloned()
    }

    fn keep(&self, variant: Variant, made: &Arc<Inner>) {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if kept.len() >= MOST_KEPT {
            kept.retain(|_, other| Arc::strong_count(other) > 1);
        }
        kept.insert(variant, made.clone());
    }
}

/// Receives the number of kernels compiled so far before each further one; an error cancels the work.
pub type Watch = Box<dyn FnMut(usize) -> Result<()>>;

/// A watch, and the number of kernels compiled while it was there.
type Watching = Option<(Watch, usize)>;

thread_local! {
    static WATCH: RefCell<Watching> = const { RefCell::new(None) };
}

/// Puts an earlier watch back when it is dropped, also where the work panics.
struct Before(Watching);

impl Drop for Before {
    fn drop(&mut self) {
        WATCH.replace(self.0.take());
    }
}

/// Does `work`, and calls `watch` before each kernel that the work compiles on this thread. Kernels that the context
/// keeps are not compiled.
pub fn watched<T>(watch: Watch, work: impl FnOnce() -> T) -> T {
    let _before = Before(WATCH.replace(Some((watch, 0))));
    work()
}

/// Compiles a kernel by `work`, after the watch was told.
fn told<T>(work: impl FnOnce() -> Result<T>) -> Result<T> {
    // Taken out for the call, which may itself make kernels.
    let Some((mut watch, count)) = WATCH.take() else { return work() };
    let wish = watch(count);
    WATCH.replace(Some((watch, count)));
    let made = wish.and_then(|()| work())?;
    WATCH.with_borrow_mut(|watching| watching.iter_mut().for_each(|(_, count)| *count += 1));
    Ok(made)
}

/// Names of all shaders compiled into the library, sorted.
pub fn shader_names() -> impl Iterator<Item = &'static str> {
    table::SHADERS.iter().map(|(name, _)| *name)
}

impl Kernel {
    /// Makes the kernel of the shader `shaders/<name>.comp`. `constants` gives values to specialization constants by
    /// name; all others keep the shader's defaults. A name that the shader does not declare is an error.
    pub fn new(context: &Arc<Context>, name: &str, size: Size, constants: &[(&str, Const)]) -> Result<Kernel> {
        Self::with_arrays(context, name, size, constants, context.arrays())
    }

    /// Makes the kernel as [`Kernel::new`] does, but its read-only arrays are buffers of the kind `arrays` (texel or
    /// storage buffers) instead of the kind that the context uses, so that the two kinds can be compared.
    pub fn with_arrays(
        context: &Arc<Context>,
        name: &str,
        size: Size,
        constants: &[(&str, Const)],
        arrays: Arrays,
    ) -> Result<Kernel> {
        let local_size = match size {
            Size::Group => context.group_size(),
            Size::Reduce => context.reduce_size(),
            Size::One => 1,
        };
        let (words, reflection) = shader(context, name, arrays)?;
        let mut special = Specialization::new(name, &reflection, constants)?;
        let is_one_subgroup = size == Size::Reduce && context.is_one_subgroup(local_size);
        special.set(0, local_size);
        special.set(ONE_SUBGROUP, is_one_subgroup.into());
        let variant = Variant { shader: name.into(), arrays, constants: special.sorted() };
        let inner = match context.kernels.find(&variant) {
            Some(kept) => kept,
            None => {
                let compile =
                    || Self::compiled(context, name, (&words, reflection), &special, local_size, is_one_subgroup);
                let made = Arc::new(told(compile)?);
                context.kernels.keep(variant, &made);
                made
            }
        };
        Ok(Kernel { inner, _context: context.clone() })
    }

    fn compiled(
        context: &Context,
        name: &str,
        (words, reflection): (&[u32], Reflection),
        special: &Specialization,
        local_size: u32,
        is_one_subgroup: bool,
    ) -> Result<Inner> {
        let declared = reflection.names().map(Into::into).collect();
        let (words, reflection) = specialised(name, words, special, |_| None)?;
        let module = Module::new(context, name, &words)?;
        let interface = Interface::new(context, name, declared, reflection, vk::ShaderStageFlags::COMPUTE)?;
        let special = special.info();
        let full = if is_one_subgroup {
            vk::PipelineShaderStageCreateFlags::REQUIRE_FULL_SUBGROUPS
        } else {
            vk::PipelineShaderStageCreateFlags::empty()
        };
        let stage_info = vk::PipelineShaderStageCreateInfo::default()
            .flags(full)
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(module.handle)
            .name(c"main")
            .specialization_info(&special);
        let info = vk::ComputePipelineCreateInfo::default().stage(stage_info).layout(interface.layout);
        // SAFETY: module and layout belong to this device and live through the call.
        let made = unsafe { context.device.create_compute_pipelines(context.cache, &[info], None) };
        let stage = format!("kernel {name}");
        let pipeline = made.map_err(|(_, e)| failed("vkCreateComputePipelines", stage)(e))?[0];
        context.labels.name(pipeline, name);
        Ok(Inner { interface, pipeline, local_size })
    }

    /// Name of the kernel, such as `solve/element_product`.
    pub fn name(&self) -> &str {
        &self.inner.interface.name
    }

    /// Number of invocations in a workgroup.
    pub fn local_size(&self) -> u32 {
        self.inner.local_size
    }

    /// The buffers that this kernel uses, given the values of its specialization constants.
    pub fn bindings(&self) -> &[Binding] {
        &self.inner.interface.reflection.bindings
    }
}

impl Drop for Inner {
    fn drop(&mut self) {
        // SAFETY: recordings hold handles of the kernels they use, so no recording that uses this pipeline is left.
        unsafe { self.interface.device.destroy_pipeline(self.pipeline, None) };
    }
}

/// The interface of a pipeline, and the descriptor set layout and the pipeline layout that are made from it. Whoever
/// holds it keeps the context alive, or is kept by the context, which drops it before it closes the device.
pub(super) struct Interface {
    pub device: ash::Device,
    pub name: String,
    /// Names of all buffers that the shader declares, including those that this variant does not use.
    pub declared: Vec<String>,
    /// Bindings and push constants that this variant uses.
    pub reflection: Reflection,
    pub set_layout: vk::DescriptorSetLayout,
    pub layout: vk::PipelineLayout,
    pub stages: vk::ShaderStageFlags,
}

impl Interface {
    pub fn new(
        context: &Context,
        name: &str,
        declared: Vec<String>,
        reflection: Reflection,
        stages: vk::ShaderStageFlags,
    ) -> Result<Interface> {
        let stage = || format!("kernel {name}");
        let limits = &context.limits;
        for (kind, other, ty, most) in [
            ("storage", "texel", vk::DescriptorType::STORAGE_BUFFER, limits.max_per_stage_descriptor_storage_buffers),
            (
                "texel",
                "storage",
                vk::DescriptorType::STORAGE_TEXEL_BUFFER,
                limits.max_per_stage_descriptor_storage_images,
            ),
        ] {
            let count = reflection.bindings.iter().filter(|b| descriptor_type(b.kind) == ty).count();
            if count > most as usize {
                let device = context.device_name();
                let what = format!("{device} allows {most} {kind} buffers per kernel, but kernel {name} has {count}");
                let remedy = format!("choose another device with --device, or try --arrays {other}");
                return Err(Error::NoDevice(format!("{what}; {remedy}")));
            }
        }
        let bindings: Vec<_> = reflection
            .bindings
            .iter()
            .map(|b| {
                vk::DescriptorSetLayoutBinding::default()
                    .binding(b.binding)
                    .descriptor_type(descriptor_type(b.kind))
                    .descriptor_count(1)
                    .stage_flags(stages)
            })
            .collect();
        let device = &context.device;
        let mut interface = Interface {
            device: device.clone(),
            name: name.into(),
            declared,
            reflection,
            set_layout: vk::DescriptorSetLayout::null(),
            layout: vk::PipelineLayout::null(),
            stages,
        };
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
        // SAFETY: the device is alive; `info` lives through the call. On an error, dropping `interface` frees its
        // parts.
        interface.set_layout = unsafe { device.create_descriptor_set_layout(&info, None) }
            .map_err(failed("vkCreateDescriptorSetLayout", stage()))?;
        let sets = [interface.set_layout];
        let range = [vk::PushConstantRange::default().stage_flags(stages).size(interface.reflection.push_bytes)];
        let mut info = vk::PipelineLayoutCreateInfo::default().set_layouts(&sets);
        if interface.reflection.push_bytes > 0 {
            info = info.push_constant_ranges(&range);
        }
        // SAFETY: the device is alive; `info` lives through the call.
        interface.layout =
            unsafe { device.create_pipeline_layout(&info, None) }.map_err(failed("vkCreatePipelineLayout", stage()))?;
        Ok(interface)
    }
}

impl Drop for Interface {
    fn drop(&mut self) {
        // SAFETY: pipelines that use the two layouts hold this interface, so none is left; null handles are ignored.
        unsafe {
            self.device.destroy_pipeline_layout(self.layout, None);
            self.device.destroy_descriptor_set_layout(self.set_layout, None);
        }
    }
}

pub(super) fn descriptor_type(kind: BindingKind) -> vk::DescriptorType {
    match kind {
        BindingKind::Storage => vk::DescriptorType::STORAGE_BUFFER,
        BindingKind::Uniform => vk::DescriptorType::UNIFORM_BUFFER,
        BindingKind::TexelFloat | BindingKind::TexelUint => vk::DescriptorType::STORAGE_TEXEL_BUFFER,
    }
}

/// The SPIR-V of one of the library's shaders, as bytes, compiled for this kind of read-only arrays.
pub(super) fn known(name: &str, arrays: Arrays) -> Result<&'static [u8]> {
    let found = table::SHADERS.binary_search_by_key(&name, |(name, _)| name);
    let index = found.map_err(|_| {
        let near = shader_names().max_by(|a, b| strsim::jaro(a, name).total_cmp(&strsim::jaro(b, name)));
        let hint = near.map(|n| format!("; the nearest is {n}")).unwrap_or_default();
        Error::Simulation(format!("there is no shader {name}{hint}"))
    })?;
    let [texel, storage] = table::SHADERS[index].1;
    Ok(if arrays == Arrays::Texel { texel } else { storage })
}

/// The SPIR-V words of a shader, or of its replacement (`Options::replaced`), and the interface that they declare.
pub(super) fn shader(context: &Context, name: &str, arrays: Arrays) -> Result<(Vec<u32>, Reflection)> {
    let replaced = context.replaced.iter().find(|(other, _)| other == name);
    let bytes = replaced.map_or_else(|| known(name, arrays), |(_, bytes)| Ok(bytes.as_slice()))?;
    let refuse = |problem: String| Error::Simulation(format!("shader {name}: {problem}"));
    if bytes.len() % size_of::<u32>() != 0 {
        return Err(refuse(format!("{} bytes of SPIR-V are no whole number of words", bytes.len())));
    }
    // The bytes may not be aligned as 32-bit words must be, so they are copied.
    let words: Vec<u32> = bytemuck::allocation::pod_collect_to_vec(bytes);
    let reflection = spirv::reflect(&words).map_err(|e| refuse(e.to_string()))?;
    Ok((words, reflection))
}

/// Applies values to the specialization constants of a shader, and removes the buffers that the shader then never uses.
/// Returns the SPIR-V words and the interface of the result. `number` returns the new binding number of the buffer with
/// a given name, or `None` to keep the number.
pub(super) fn specialised(
    name: &str,
    words: &[u32],
    constants: &Specialization,
    number: impl Fn(&str) -> Option<u32>,
) -> Result<(Vec<u32>, Reflection)> {
    let refuse = |problem: String| Error::Simulation(format!("shader {name}: {problem}"));
    let mut words = specialise::specialised(words, &constants.values()).map_err(refuse)?;
    let mut reflection = spirv::reflect(&words).map_err(refuse)?;
    for binding in &mut reflection.bindings {
        binding.binding = number(&binding.name).unwrap_or(binding.binding);
    }
    spirv::renumber(&mut words, &reflection.bindings).map_err(refuse)?;
    Ok((words, reflection))
}

/// A shader module, needed only until the pipelines are made from it.
pub(super) struct Module<'a> {
    context: &'a Context,
    pub handle: vk::ShaderModule,
}

impl<'a> Module<'a> {
    pub fn new(context: &'a Context, name: &str, words: &[u32]) -> Result<Module<'a>> {
        let info = vk::ShaderModuleCreateInfo::default().code(words);
        // SAFETY: the words are SPIR-V from the compiler and live through the call.
        let handle = unsafe { context.device.create_shader_module(&info, None) }
            .map_err(failed("vkCreateShaderModule", format!("kernel {name}")))?;
        Ok(Module { context, handle })
    }
}

impl Drop for Module<'_> {
    fn drop(&mut self) {
        // SAFETY: a pipeline does not need its module after it has been created.
        unsafe { self.context.device.destroy_shader_module(self.handle, None) };
    }
}

/// Values of specialization constants, each with its constant id.
pub(super) struct Specialization {
    entries: Vec<vk::SpecializationMapEntry>,
    data: Vec<u32>,
}

impl Specialization {
    pub fn new(shader: &str, reflection: &Reflection, constants: &[(&str, Const)]) -> Result<Specialization> {
        let mut out = Specialization { entries: Vec::new(), data: Vec::new() };
        for (name, value) in constants {
            let Some(&(id, kind)) = reflection.constants.get(*name) else {
                let known: Vec<_> = reflection.constants.keys().map(String::as_str).collect();
                return Err(Error::Simulation(format!(
                    "shader {shader} has no specialization constant {name} (or never uses it); it has: {}",
                    known.join(", ")
                )));
            };
            let (given, bits) = value.bits();
            if given != kind {
                return Err(Error::Simulation(format!("shader {shader}: constant {name} is {kind:?}, not {given:?}")));
            }
            out.set(id, bits);
        }
        Ok(out)
    }

    pub fn set(&mut self, id: u32, bits: u32) {
        let offset = (self.data.len() * size_of::<u32>()) as u32;
        self.data.push(bits);
        self.entries.push(vk::SpecializationMapEntry { constant_id: id, offset, size: size_of::<u32>() });
    }

    /// Ids of the constants and the bit patterns of their values, sorted.
    fn sorted(&self) -> Vec<(u32, u32)> {
        let mut all: Vec<_> = self.values().into_iter().collect();
        all.sort_unstable();
        all
    }

    /// Bit pattern of each value, keyed by constant id.
    fn values(&self) -> HashMap<u32, u32> {
        self.entries.iter().zip(&self.data).map(|(entry, bits)| (entry.constant_id, *bits)).collect()
    }

    pub fn info(&self) -> vk::SpecializationInfo<'_> {
        vk::SpecializationInfo::default().map_entries(&self.entries).data(bytemuck::cast_slice(&self.data))
    }
}

#[cfg(test)]
mod tests {
    use super::super::Options;
    use super::*;

    fn scaled(context: &Arc<Context>, scale: f32, arrays: Arrays) -> Kernel {
        Kernel::with_arrays(context, "test/copy", Size::Group, &[("scale", scale.into())], arrays).unwrap()
    }

    #[test]
    fn a_context_keeps_one_pipeline_for_each_variant_and_does_not_keep_itself_open() {
        let device = std::env::var("PALPATE_TEST_DEVICE").ok();
        let context = Context::open(&Options { device, ..Options::default() }).unwrap();
        let first = scaled(&context, 2.0, Arrays::Texel);
        let pipeline = first.inner.pipeline;
        // The handles alone would not tell: a driver may give a destroyed pipeline's handle to the next.
        let kept = Arc::downgrade(&first.inner);
        drop(first);
        let kept = kept.upgrade().expect("a pipeline that nothing uses is kept");
        assert!(Arc::ptr_eq(&scaled(&context, 2.0, Arrays::Texel).inner, &kept), "the same variant, made again");
        drop(kept);
        let others = [
            scaled(&context, 3.0, Arrays::Texel),
            scaled(&context, 2.0, Arrays::Storage),
            Kernel::with_arrays(&context, "test/copy", Size::One, &[("scale", 2.0.into())], Arrays::Texel).unwrap(),
        ];
        assert!(others.iter().all(|other| other.inner.pipeline != pipeline), "variants with another value or size");
        drop(others);
        let in_use = scaled(&context, -1.0, Arrays::Texel);
        for scale in 0..MOST_KEPT + 8 {
            scaled(&context, scale as f32, Arrays::Texel);
        }
        assert!(context.kernels.0.lock().unwrap().len() <= MOST_KEPT);
        assert_eq!(scaled(&context, -1.0, Arrays::Texel).inner.pipeline, in_use.inner.pipeline, "a variant in use");
        drop(in_use);
        assert_eq!(Arc::strong_count(&context), 1, "kernels that a context keeps must not keep it open");
    }
}
