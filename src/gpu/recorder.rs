//! Writes passes, in order, into a [`Recording`], a command buffer that can be submitted many times. A pass is one
//! dispatch, draw, fill or copy; each pass belongs to a stage of the time step (pose, cull, ...). Barriers between
//! passes follow from what each kernel declares to read and write.
//!
//! The methods that record return no errors, so that the code of a stage reads like its algorithm. The first error is
//! kept with the name of the stage in which it occurred; [`Recorder::finish`] returns it.
#![allow(unsafe_code)]

use std::collections::HashMap;
use std::sync::Arc;

use ash::vk::{self, AccessFlags2 as Access, Handle, PipelineStageFlags2 as Stages};

use super::arguments::Arguments;
use super::barrier::{Hazards, Use};
use super::buffer::{Buffer, Memory};
use super::context::Context;
use super::kernel::{Interface, Kernel, descriptor_type};
use super::recording::{ArrayUse, Commands, Pass, Recording};
use super::spirv::BindingKind;
use crate::error::{Error, Result};

/// Size of a VkDispatchIndirectCommand, bytes.
const DISPATCH_ARGS: u64 = 12;

/// What the timers of a recording measure.
#[derive(Clone, Copy)]
enum Timers {
    /// Nothing.
    None,
    /// Stages: the function maps the name of a stage to the name of the timer that measures it.
    Stages(fn(&str) -> &str),
    /// Each pass by itself; a timer has the name of its pass, see [`Pass::what`].
    Passes,
}

/// Records passes into a [`Recording`].
pub struct Recorder {
    pub(super) commands: Commands,
    hazards: Hazards,
    sets: HashMap<(vk::DescriptorSetLayout, Vec<vk::Buffer>), vk::DescriptorSet>,
    bound: vk::Pipeline,
    stage: String,
    labelled: bool,
    timers: Timers,
    /// Name of the timer that is running.
    timer: Option<String>,
    /// Whether dispatches are recorded without workgroups and draws without vertices.
    empty: bool,
    error: Option<Error>,
    /// Every kernel dispatch with its arguments, for tests that swap buffers among the arguments.
    #[cfg(test)]
    pub seen: Vec<Seen>,
}

/// A kernel, its buffers by the shader's names, and the bytes of its push constants.
#[cfg(test)]
pub type Seen = (Kernel, Vec<(String, Buffer)>, Vec<u8>);

impl Recorder {
    /// Begins a recording in which each stage is timed by itself. The recording sees the results of all earlier work on
    /// the device.
    pub fn new(context: &Arc<Context>) -> Result<Recorder> {
        Self::timed_by(context, |stage| stage)
    }

    /// Begins a recording in which each stage is measured by the timer that `timers` names for the stage. No timestamp
    /// is written between consecutive stages with the same timer.
    pub fn timed_by(context: &Arc<Context>, timers: fn(&str) -> &str) -> Result<Recorder> {
        Self::with_timers(context, Timers::Stages(timers))
    }

    /// Begins a recording in which each pass is timed by itself. Since a timestamp waits for all passes before it, no
    /// two passes overlap.
    pub fn timed_by_pass(context: &Arc<Context>) -> Result<Recorder> {
        Self::with_timers(context, Timers::Passes)
    }

    fn with_timers(context: &Arc<Context>, timers: Timers) -> Result<Recorder> {
        let timers = if context.timestamp_bits > 0 { timers } else { Timers::None };
        Ok(Recorder { timers, ..Self::untimed(context)? })
    }

    /// Begins a recording without timestamps; on some drivers the GPU waits at each timestamp.
    pub fn untimed(context: &Arc<Context>) -> Result<Recorder> {
        let recorder = Recorder {
            commands: Commands::new(context)?,
            hazards: Hazards::default(),
            sets: HashMap::new(),
            bound: vk::Pipeline::null(),
            stage: "set-up".into(),
            labelled: false,
            timers: Timers::None,
            timer: None,
            empty: false,
            error: None,
            #[cfg(test)]
            seen: Vec::new(),
        };
        recorder.barrier(Hazards::opening());
        Ok(recorder)
    }

    /// Begins a recording whose passes have no work (dispatches without workgroups, draws without vertices). This
    /// recording is submitted once before the first time step, because some drivers compile a pipeline only when the
    /// pipeline is first used.
    pub fn warm_up(context: &Arc<Context>) -> Result<Recorder> {
        Ok(Recorder { empty: true, ..Self::untimed(context)? })
    }

    /// Begins the stage `name`. Until the next stage begins, `name` labels the commands for debugging, selects the
    /// timer and is named in errors.
    pub fn stage(&mut self, name: &str) {
        self.end_label();
        self.stage = name.into();
        if let Timers::Stages(timers) = self.timers
            && self.timer.as_deref() != Some(timers(name))
        {
            let timer = timers(name).to_string();
            let marked = self.commands.mark(&timer);
            self.note(marked);
            self.timer = Some(timer);
        }
        self.commands.context.labels.begin(self.commands.buffer, name);
        self.labelled = true;
    }

    /// Records the passes of the closure `passes`, which then run concurrently: no barrier separates them, whatever
    /// their kernels declare to read and write. So no pass may actually read or write memory that another of them
    /// writes. Within another such closure its passes belong to the outer one.
    pub fn together(&mut self, passes: impl FnOnce(&mut Recorder)) {
        let opens = self.hazards.begin_together();
        passes(self);
        if opens {
            self.hazards.end_together();
        }
    }

    /// Records a dispatch of `elements` invocations, rounded up to whole workgroups; for 0 it records nothing.
    pub fn dispatch(&mut self, kernel: &Kernel, arguments: &dyn Arguments, elements: u32) {
        self.dispatch_groups(kernel, arguments, elements.div_ceil(kernel.local_size()));
    }

    /// Records a dispatch of `groups` workgroups; for 0 it records nothing.
    pub fn dispatch_groups(&mut self, kernel: &Kernel, arguments: &dyn Arguments, groups: u32) {
        let limit = self.commands.context.most_workgroups();
        let fits = if groups > limit {
            Err(self.error(format!("kernel {}: {groups} workgroups, but the device's limit is {limit}", kernel.name())))
        } else {
            Ok(())
        };
        let ready = fits.and_then(|()| self.prepare_compute(kernel, arguments, None, groups == 0));
        if self.note(ready) && groups > 0 {
            // SAFETY: the command buffer is in recording state; `prepare_compute` bound pipeline, descriptor set and
            // push constants; the recording keeps the pipeline and the buffers alive.
            let groups = if self.empty { 0 } else { groups };
            unsafe { self.commands.context.device.cmd_dispatch(self.commands.buffer, groups, 1, 1) };
        }
    }

    /// Records a dispatch whose workgroup counts are the VkDispatchIndirectCommand (three u32) with index `slot` in
    /// `args`.
    pub fn dispatch_indirect(&mut self, kernel: &Kernel, arguments: &dyn Arguments, args: &Buffer, slot: u32) {
        let offset = u64::from(slot) * DISPATCH_ARGS;
        let ready = self
            .check_args(args, offset, DISPATCH_ARGS)
            .and_then(|()| self.prepare_compute(kernel, arguments, Some(args), false));
        if self.note(ready) {
            // SAFETY: as in `dispatch_groups`; the VkDispatchIndirectCommand lies within `args`.
            let (device, commands) = (&self.commands.context.device, self.commands.buffer);
            unsafe {
                if self.empty {
                    device.cmd_dispatch(commands, 0, 1, 1);
                } else {
                    device.cmd_dispatch_indirect(commands, args.inner.handle, offset);
                }
            }
        }
    }

    /// Records a fill that sets every 32-bit word of `buffer` to `value`.
    pub fn fill(&mut self, buffer: &Buffer, value: u32) {
        self.fill_words(buffer, 0, vk::WHOLE_SIZE, value);
    }

    /// Records a fill that sets the 32-bit words of `bytes` bytes of `buffer`, from `first_byte` on, to `value`.
    /// `first_byte` and `bytes` must be multiples of 4.
    pub fn fill_range(&mut self, buffer: &Buffer, first_byte: u64, bytes: u64, value: u32) {
        let sound = first_byte.is_multiple_of(4) && bytes.is_multiple_of(4);
        if !sound || first_byte.checked_add(bytes).is_none_or(|end| end > buffer.bytes()) {
            let size = buffer.bytes();
            let what =
                format!("{bytes} bytes from byte {first_byte} are not whole words within the array's {size} bytes");
            self.fail(format!("fill of {}: {what}", buffer.name()));
        } else if bytes > 0 {
            self.fill_words(buffer, first_byte, bytes, value);
        }
    }

    /// Records the copy of what the CPU wrote into an array of [`Memory::Upload`], where that is in another place.
    pub fn upload(&mut self, buffer: &Buffer) {
        if let Some(staging) = buffer.inner.staging.clone() {
            self.copy(&staging, buffer);
        }
    }

    /// Records a copy of the whole of `src` to the start of `dst`.
    pub fn copy(&mut self, src: &Buffer, dst: &Buffer) {
        self.copy_range(src, 0, dst, 0, src.bytes());
    }

    /// Records a copy of `bytes` bytes from byte `src_byte` of `src` to byte `dst_byte` of `dst`.
    pub fn copy_range(&mut self, src: &Buffer, src_byte: u64, dst: &Buffer, dst_byte: u64, bytes: u64) {
        let within = |at: u64, buffer: &Buffer| at.checked_add(bytes).is_some_and(|end| end <= buffer.bytes());
        if !within(src_byte, src) || !within(dst_byte, dst) || src.inner.handle == dst.inner.handle {
            let (a, b) = (src.bytes(), dst.bytes());
            self.fail(format!(
                "{bytes} bytes cannot be copied from array {} of {a} bytes to array {} of {b} bytes",
                src.name(),
                dst.name()
            ));
        }
        if bytes == 0 || self.error.is_some() {
            return;
        }
        self.pass("copy", dst.name(), &[transfer(src, false), transfer(dst, true)]);
        self.keep(src);
        self.keep(dst);
        let region = [vk::BufferCopy { src_offset: src_byte, dst_offset: dst_byte, size: bytes }];
        let device = &self.commands.context.device;
        // SAFETY: the command buffer is in recording state; the recording keeps both buffers alive; the byte ranges lie
        // within the buffers, and the two buffers differ.
        unsafe { device.cmd_copy_buffer(self.commands.buffer, src.inner.handle, dst.inner.handle, &region) };
    }

    /// Ends the recording, or returns the first error of any pass.
    pub fn finish(mut self) -> Result<Recording> {
        self.end_label();
        if !matches!(self.timers, Timers::None) {
            let marked = self.commands.mark("end");
            self.note(marked);
        }
        self.barrier(Hazards::closing());
        match self.error {
            Some(error) => Err(error),
            None => self.commands.end(&self.stage),
        }
    }

    fn fill_words(&mut self, buffer: &Buffer, first: u64, bytes: u64, value: u32) {
        if self.error.is_some() {
            return;
        }
        self.pass("fill", buffer.name(), &[transfer(buffer, true)]);
        self.keep(buffer);
        // SAFETY: the command buffer is in recording state; the recording keeps the buffer alive; the caller checked
        // the byte range, or it is the whole buffer.
        unsafe {
            let device = &self.commands.context.device;
            device.cmd_fill_buffer(self.commands.buffer, buffer.inner.handle, first, bytes, value);
        }
    }

    /// Checks the arguments of a dispatch, and records the barrier and the bindings that the dispatch needs; with
    /// `only_check` it records nothing.
    fn prepare_compute(
        &mut self,
        kernel: &Kernel,
        arguments: &dyn Arguments,
        args: Option<&Buffer>,
        only_check: bool,
    ) -> Result<()> {
        let inner = &kernel.inner;
        #[cfg(test)]
        self.see(kernel, arguments);
        let (buffers, mut uses) = self.check_uses(&inner.interface, arguments, Stages::COMPUTE_SHADER)?;
        if self.error.is_some() || only_check {
            return Ok(());
        }
        if let Some(args) = args {
            self.add_args(&mut uses, args);
        }
        self.pass("", kernel.name(), &uses);
        if self.bound != inner.pipeline {
            self.bound = inner.pipeline;
            self.commands.keep(inner.pipeline.as_raw(), inner);
            let (device, point) = (&self.commands.context.device, vk::PipelineBindPoint::COMPUTE);
            // SAFETY: the command buffer is in recording state; the recording keeps the pipeline alive.
            unsafe { device.cmd_bind_pipeline(self.commands.buffer, point, inner.pipeline) };
        }
        self.bind(&inner.interface, &buffers, &arguments.push(), vk::PipelineBindPoint::COMPUTE)
    }

    #[cfg(test)]
    fn see(&mut self, kernel: &Kernel, arguments: &dyn Arguments) {
        let given = arguments.buffers().into_iter();
        let buffers = given.filter_map(|(name, buffer)| Some((name.to_string(), buffer?.clone()))).collect();
        self.seen.push((kernel.clone(), buffers, arguments.push()));
    }

    /// Records the binding of a descriptor set with these buffers and of the push constants.
    pub(super) fn bind(
        &mut self,
        interface: &Interface,
        buffers: &[&Buffer],
        push: &[u8],
        point: vk::PipelineBindPoint,
    ) -> Result<()> {
        let set = if buffers.is_empty() { None } else { Some(self.descriptor_set(interface, buffers)?) };
        buffers.iter().for_each(|buffer| self.keep(buffer));
        let (device, commands) = (&self.commands.context.device, self.commands.buffer);
        // SAFETY: the command buffer is in recording state; descriptor set and layout are alive and fit the pipeline,
        // which the recording keeps alive; the size of the push constants was checked.
        unsafe {
            if let Some(set) = set {
                device.cmd_bind_descriptor_sets(commands, point, interface.layout, 0, &[set], &[]);
            }
            if !push.is_empty() {
                device.cmd_push_constants(commands, interface.layout, interface.stages, 0, push);
            }
        }
        Ok(())
    }

    /// A descriptor set with these buffers; if this recording already has such a set, that set is reused.
    fn descriptor_set(&mut self, interface: &Interface, buffers: &[&Buffer]) -> Result<vk::DescriptorSet> {
        let key = (interface.set_layout, buffers.iter().map(|b| b.inner.handle).collect::<Vec<_>>());
        if let Some(&set) = self.sets.get(&key) {
            return Ok(set);
        }
        let set = self.commands.descriptor_set(interface.set_layout, &self.stage)?;
        let bindings = &interface.reflection.bindings;
        let range = |buffer: &Buffer| if buffer.bytes() == 0 { vk::WHOLE_SIZE } else { buffer.bytes() };
        let infos: Vec<_> = buffers
            .iter()
            .map(|b| [vk::DescriptorBufferInfo { buffer: b.inner.handle, offset: 0, range: range(b) }])
            .collect();
        let views: Vec<_> = bindings
            .iter()
            .zip(buffers)
            .map(|(b, buffer)| {
                [buffer
                    .inner
                    .views
                    .map_or(vk::BufferView::null(), |v| v[usize::from(b.kind == BindingKind::TexelUint)])]
            })
            .collect();
        let writes: Vec<_> = bindings
            .iter()
            .enumerate()
            .map(|(i, b)| {
                let write = vk::WriteDescriptorSet::default()
                    .dst_set(set)
                    .dst_binding(b.binding)
                    .descriptor_type(descriptor_type(b.kind));
                match b.kind {
                    BindingKind::Storage | BindingKind::Uniform => write.buffer_info(&infos[i]),
                    BindingKind::TexelFloat | BindingKind::TexelUint => write.texel_buffer_view(&views[i]),
                }
            })
            .collect();
        // SAFETY: the descriptor set is new, so nothing uses it yet; the caller keeps buffers and views alive.
        unsafe { self.commands.context.device.update_descriptor_sets(&writes, &[]) };
        self.sets.insert(key, set);
        Ok(set)
    }

    /// Adds a pass to the list of passes, and records a barrier before the pass if it must wait for earlier passes.
    /// `verb` is "fill", "copy", "draw" (onto images), or empty for a dispatch or a draw without images. `name` is the
    /// array that a fill or copy writes, or else the kernel or shaders that run.
    pub(super) fn pass(&mut self, verb: &str, name: &str, uses: &[Use]) {
        let barrier = self.hazards.before(uses);
        let what = format!("{verb} {name}").trim().to_string();
        let waits = self.commands.passes.is_empty() || barrier.is_some();
        if matches!(self.timers, Timers::Passes) {
            let marked = self.commands.mark(&what);
            self.note(marked);
        }
        self.commands.passes.push(Pass { stage: self.stage.clone(), what, is_kernel: verb.is_empty(), waits });
        if let Some(barrier) = barrier {
            self.barrier(barrier);
        }
    }

    fn barrier(&self, barrier: vk::MemoryBarrier2<'_>) {
        let barriers = [barrier];
        let info = vk::DependencyInfo::default().memory_barriers(&barriers);
        // SAFETY: the command buffer is in recording state, outside rendering; synchronization2 is enabled.
        unsafe { self.commands.context.device.cmd_pipeline_barrier2(self.commands.buffer, &info) };
    }

    pub(super) fn keep(&mut self, buffer: &Buffer) {
        let id = buffer.inner.handle.as_raw();
        if !self.commands.keeps(id) {
            let (stage, name) = (self.stage.clone(), buffer.name().to_string());
            let on_device = buffer.memory() == Memory::Device;
            self.commands.arrays.push(ArrayUse { id, stage, name, bytes: buffer.bytes(), on_device });
        }
        self.commands.keep(id, &buffer.inner);
    }

    fn end_label(&mut self) {
        if std::mem::take(&mut self.labelled) {
            self.commands.context.labels.end(self.commands.buffer);
        }
    }

    /// Keeps the error of `result` if it is the first error of the recording. Returns whether there is no error so far.
    pub(super) fn note(&mut self, result: Result<()>) -> bool {
        if let Err(error) = result {
            self.error.get_or_insert(error);
        }
        self.error.is_none()
    }

    pub(super) fn is_well(&self) -> bool {
        self.error.is_none()
    }

    /// Whether the passes are recorded without work, as [`Recorder::warm_up`] describes.
    pub(super) fn is_empty(&self) -> bool {
        self.empty
    }

    fn fail(&mut self, what: String) {
        let error = Err(self.error(what));
        self.note(error);
    }

    pub(super) fn error(&self, what: String) -> Error {
        Error::Simulation(format!("stage {}: {what}", self.stage))
    }
}

fn transfer(buffer: &Buffer, writes: bool) -> Use {
    let write_access = if writes { Access::TRANSFER_WRITE } else { Access::NONE };
    Use { id: buffer.inner.handle.as_raw(), reads: !writes, writes, stages: Stages::ALL_TRANSFER, write_access }
}

#[cfg(test)]
mod tests {
    use super::super::{Named, Options, Size};
    use super::*;

    /// Vulkan's validation layer must report a missing barrier before a pass that reads what another pass wrote,
    /// because other tests rely on these reports. (The layer does not report a missing barrier between two passes that
    /// write the same buffer, because it treats shader writes at one pipeline stage as ordered.)
    #[test]
    fn a_missing_barrier_is_seen_by_validation() {
        let device = std::env::var("PALPATE_TEST_DEVICE").ok();
        let context = Context::open(&Options { device, validation: true, ..Options::default() }).unwrap();
        let kernel = Kernel::new(&context, "test/copy", Size::Group, &[]).unwrap();
        let array = |name: &str| Buffer::from_slice(&context, name, &[0u32; 64], Memory::Device).unwrap();
        let (params, offsets, marked) = (array("params"), array("offsets"), array("marked"));
        let any = |name: &str| array(name).known_as(&["source", "target", "offsets"]);
        let (a, b) = (any("a"), any("b"));
        let said = |passes: [[&Buffer; 3]; 2], forget: bool| {
            let mut recorder = Recorder::new(&context).unwrap();
            for [source, offsets, target] in passes {
                let buffers = [
                    ("params", &params),
                    ("source", source),
                    ("offsets", offsets),
                    ("marked", &marked),
                    ("target", target),
                ];
                let first = 0u32;
                let push = bytemuck::bytes_of(&first);
                recorder.dispatch(&kernel, &Named { shader: "test/copy", buffers: &buffers, push }, 64);
                if forget {
                    recorder.hazards = Hazards::default();
                }
            }
            recorder.finish().unwrap();
            context.validation_messages()
        };
        let (a_to_b, b_to_a) = ([&a, &offsets, &b], [&b, &offsets, &a]);
        let other = any("c");
        // `b_to_a` reads `b` as `source`, a storage buffer; `texels` reads `b` as `offsets`, which may be a texel
        // buffer.
        let texels = [&other, &b, &a];
        for second in [b_to_a, texels] {
            assert_eq!(said([a_to_b, second], false), Vec::<String>::new());
            let said = said([a_to_b, second], true);
            assert!(
                said.iter().any(|m| m.contains("READ-AFTER-WRITE") || m.contains("READ_AFTER_WRITE")),
                "messages of the validation layer, none of which reports the missing barrier: {said:?}"
            );
        }
    }
}
