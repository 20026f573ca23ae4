//! A recording: a recorded command buffer with everything that its replay needs, and the GPU times of its stages (the
//! parts of a time step, such as cull or solve).
#![allow(unsafe_code)]

use std::any::Any;
use std::cell::Cell;
use std::collections::HashMap;
use std::sync::Arc;

use ash::vk;

use super::context::Context;
use super::failed;
use crate::error::{Error, Result};

/// Number of timestamps in one query pool.
const QUERIES: u32 = 64;
/// Greatest number of recordings in one submit.
const MOST_AT_ONCE: usize = 32;

/// Counts of the passes that one stage recorded. A pass is one dispatch, draw, fill or copy.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StagePasses {
    /// Name of the stage.
    pub stage: String,
    /// Number of passes of all kinds.
    pub dispatches: u32,
    /// Number of passes that wait for an earlier pass; the first pass of a recording counts as one of them. Summed over
    /// all stages, this is the number of barriers between passes plus one.
    pub dependent: u32,
}

/// One pass of a recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pass {
    /// Name of the stage that recorded the pass.
    pub stage: String,
    /// Name of the kernel or of the shaders that run, or of the array that a fill or a copy writes. The word
    /// "fill", "copy" or, for a draw onto images, "draw" stands before the name.
    pub what: String,
    /// Whether the pass is a dispatch or a draw without images; false for a fill, a copy or a draw onto images.
    pub is_kernel: bool,
    /// Whether the pass waits for an earlier pass. The first pass of a recording always counts as waiting.
    pub waits: bool,
}

/// An array that a recording binds.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ArrayUse {
    /// Number that identifies the array in all recordings that bind it.
    pub id: u64,
    /// The first stage that binds the array.
    pub stage: String,
    /// Name of the array.
    pub name: String,
    /// Size that was requested for the array, bytes.
    pub bytes: u64,
    /// Whether the array is in GPU memory; false if it is mapped for the CPU.
    pub on_device: bool,
}

/// A command buffer that can be submitted any number of times. It holds handles of everything that it uses, so that
/// nothing it uses is freed before the recording. It may move between threads, but only one thread at a time may submit
/// it.
pub struct Recording {
    pub(super) commands: Commands,
    ran: Cell<bool>,
}

/// The Vulkan objects behind a recording; they are destroyed together.
pub(super) struct Commands {
    /// What the recording uses, by its Vulkan handle. Fields are dropped in the order in which they are declared: these
    /// objects before the device.
    kept: HashMap<u64, Arc<dyn Any + Send + Sync>>,
    pub context: Arc<Context>,
    pool: vk::CommandPool,
    pub buffer: vk::CommandBuffer,
    fence: vk::Fence,
    descriptor_pools: Vec<vk::DescriptorPool>,
    queries: Vec<vk::QueryPool>,
    /// For each timestamp, the name of the timer that starts at it.
    marks: Vec<String>,
    pub passes: Vec<Pass>,
    pub arrays: Vec<ArrayUse>,
}

impl Commands {
    pub fn new(context: &Arc<Context>) -> Result<Commands> {
        let device = &context.device;
        let mut commands = Commands {
            kept: HashMap::new(),
            context: context.clone(),
            pool: vk::CommandPool::null(),
            buffer: vk::CommandBuffer::null(),
            fence: vk::Fence::null(),
            descriptor_pools: Vec::new(),
            queries: Vec::new(),
            marks: Vec::new(),
            passes: Vec::new(),
            arrays: Vec::new(),
        };
        let pool = vk::CommandPoolCreateInfo::default().queue_family_index(context.queue_family);
        // SAFETY (of all calls below): the device is alive; each info lives through its call; on an error, dropping
        // `commands` frees what was made. Only this recording uses the pool, so no other thread touches the pool.
        unsafe {
            commands.pool = device.create_command_pool(&pool, None).map_err(failed("vkCreateCommandPool", "set-up"))?;
            let info = vk::CommandBufferAllocateInfo::default().command_pool(commands.pool).command_buffer_count(1);
            commands.buffer =
                device.allocate_command_buffers(&info).map_err(failed("vkAllocateCommandBuffers", "set-up"))?[0];
            commands.fence = device
                .create_fence(&vk::FenceCreateInfo::default(), None)
                .map_err(failed("vkCreateFence", "set-up"))?;
            device
                .begin_command_buffer(commands.buffer, &vk::CommandBufferBeginInfo::default())
                .map_err(failed("vkBeginCommandBuffer", "set-up"))?;
        }
        Ok(commands)
    }

    /// Keeps the object `what` alive as long as the recording; `id` is the object's Vulkan handle.
    pub fn keep(&mut self, id: u64, what: &Arc<impl Any + Send + Sync>) {
        self.kept.entry(id).or_insert_with(|| what.clone());
    }

    /// Whether the object with this Vulkan handle is kept.
    pub fn keeps(&self, id: u64) -> bool {
        self.kept.contains_key(&id)
    }

    /// Records a timestamp at which a timer starts. `stage` is the name of the timer: the name of a stage, or of a
    /// group of stages that are timed together.
    pub fn mark(&mut self, stage: &str) -> Result<()> {
        let device = &self.context.device;
        let query = self.marks.len() as u32 % QUERIES;
        if query == 0 {
            let info = vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(QUERIES);
            // SAFETY: the device is alive; the command buffer is in recording state, outside any rendering.
            unsafe {
                let pool = device.create_query_pool(&info, None).map_err(failed("vkCreateQueryPool", stage))?;
                self.queries.push(pool);
                device.cmd_reset_query_pool(self.buffer, pool, 0, QUERIES);
            }
        }
        if let Some(&pool) = self.queries.last() {
            // SAFETY: the command buffer is in recording state; the command that resets all queries of the pool was
            // recorded when the pool was made; this query is written once per submit.
            unsafe {
                device.cmd_write_timestamp2(self.buffer, vk::PipelineStageFlags2::ALL_COMMANDS, pool, query);
            }
        }
        self.marks.push(stage.into());
        Ok(())
    }

    /// Allocates a descriptor set from the last pool, or from a new pool if the last pool is used up.
    pub fn descriptor_set(&mut self, layout: vk::DescriptorSetLayout, stage: &str) -> Result<vk::DescriptorSet> {
        const SETS: u32 = 256;
        let layouts = [layout];
        let device = &self.context.device;
        if let Some(&pool) = self.descriptor_pools.last() {
            let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(pool).set_layouts(&layouts);
            // SAFETY: pool and layout are alive; only this recording uses the pool.
            match unsafe { device.allocate_descriptor_sets(&info) } {
                Ok(sets) => return Ok(sets[0]),
                Err(vk::Result::ERROR_OUT_OF_POOL_MEMORY | vk::Result::ERROR_FRAGMENTED_POOL) => {}
                Err(error) => return Err(failed("vkAllocateDescriptorSets", stage)(error)),
            }
        }
        let size = |ty, count| vk::DescriptorPoolSize { ty, descriptor_count: count };
        let sizes = [
            size(vk::DescriptorType::STORAGE_BUFFER, SETS * 8),
            size(vk::DescriptorType::STORAGE_TEXEL_BUFFER, SETS * 8),
            size(vk::DescriptorType::UNIFORM_BUFFER, SETS),
        ];
        let info = vk::DescriptorPoolCreateInfo::default().max_sets(SETS).pool_sizes(&sizes);
        // SAFETY: the device is alive; each info lives through its call.
        let sets = unsafe {
            let pool = device.create_descriptor_pool(&info, None).map_err(failed("vkCreateDescriptorPool", stage))?;
            self.descriptor_pools.push(pool);
            let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(pool).set_layouts(&layouts);
            device.allocate_descriptor_sets(&info)
        };
        sets.map(|sets| sets[0]).map_err(failed("vkAllocateDescriptorSets", stage))
    }

    /// Ends the recording, which can then be submitted.
    pub fn end(self, stage: &str) -> Result<Recording> {
        // SAFETY: the command buffer is in recording state.
        unsafe { self.context.device.end_command_buffer(self.buffer) }.map_err(failed("vkEndCommandBuffer", stage))?;
        Ok(Recording { commands: self, ran: Cell::new(false) })
    }

    /// For each timestamp: its value in ticks of the GPU's clock, and whether the GPU has written it.
    fn timestamps(&self) -> Vec<(u64, bool)> {
        let mut out = Vec::new();
        for (i, &pool) in self.queries.iter().enumerate() {
            let count = (self.marks.len() - i * QUERIES as usize).min(QUERIES as usize);
            let mut pairs = vec![[0u64; 2]; count];
            let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WITH_AVAILABILITY;
            // SAFETY: the pool is alive, and holds at least `count` queries. On an error, the second number of each
            // pair stays zero: not written.
            let _ = unsafe { self.context.device.get_query_pool_results(pool, 0, &mut pairs, flags) };
            out.extend(pairs.iter().map(|pair| (pair[0], pair[1] != 0)));
        }
        out
    }
}

impl Drop for Commands {
    fn drop(&mut self) {
        let device = &self.context.device;
        // SAFETY: every submit waits for its end, so the GPU no longer uses these objects; null handles are ignored.
        unsafe {
            for &pool in &self.queries {
                device.destroy_query_pool(pool, None);
            }
            for &pool in &self.descriptor_pools {
                device.destroy_descriptor_pool(pool, None);
            }
            device.destroy_fence(self.fence, None);
            device.destroy_command_pool(self.pool, None);
        }
    }
}

impl Recording {
    /// Submits the recording and waits for its end.
    pub fn submit_and_wait(&self) -> Result<()> {
        Self::submit_all(&[self])
    }

    /// Submits several recordings at once and waits for their end; they run in order. No recording may be given twice.
    /// The function allocates no memory.
    pub fn submit_all(recordings: &[&Recording]) -> Result<()> {
        let Some(last) = recordings.last() else { return Ok(()) };
        let context = &last.commands.context;
        for (i, recording) in recordings.iter().enumerate() {
            if recordings[..i].iter().any(|other| std::ptr::eq(*other, *recording)) {
                return Err(Error::Simulation("a recording was given twice in one submit".into()));
            }
            if !Arc::ptr_eq(&recording.commands.context, context) {
                return Err(Error::Simulation("recordings of different devices were submitted together".into()));
            }
        }
        let mut buffers = [vk::CommandBufferSubmitInfo::default(); MOST_AT_ONCE];
        let Some(buffers) = buffers.get_mut(..recordings.len()) else {
            return Err(Error::Simulation(format!("{} recordings are too many for one submit", recordings.len())));
        };
        for (buffer, recording) in buffers.iter_mut().zip(recordings) {
            *buffer = buffer.command_buffer(recording.commands.buffer);
        }
        let submit = [vk::SubmitInfo2::default().command_buffer_infos(buffers)];
        let fences = [last.commands.fence];
        let device = &context.device;
        let lost = |call| move |result| failed(call, Self::stage_reached(recordings))(result);
        // Before the submit, not after it: a call that failed in between must not leave a signalled fence to the next.
        // SAFETY: nothing waits for the fence, since every submit waits for its end.
        unsafe { device.reset_fences(&fences) }.map_err(failed("vkResetFences", "submit"))?;
        {
            let queue = context.queue();
            // SAFETY: the command buffers are recorded, and idle because every submit waits for its end and a
            // `Recording` is not `Sync`; the queue is locked.
            unsafe { device.queue_submit2(queue.queue(), &submit, last.commands.fence) }
                .map_err(lost("vkQueueSubmit2"))?;
        }
        // SAFETY: the fence was submitted just now.
        if let Err(error) = unsafe { device.wait_for_fences(&fences, true, u64::MAX) } {
            // The recordings must not be freed while the device still runs them.
            context.wait_idle();
            return Err(lost("vkWaitForFences")(error));
        }
        recordings.iter().for_each(|r| r.ran.set(true));
        Ok(())
    }

    /// Name and GPU time of each timer (usually of one stage) in the last run of the recording, microseconds, in order
    /// of first appearance; the times of a timer that runs several times are summed. Empty before the first run, and if
    /// nothing was timed.
    pub fn stage_times(&self) -> Vec<(String, f64)> {
        let (context, marks) = (&self.commands.context, &self.commands.marks);
        if !self.ran.get() || context.timestamp_bits == 0 {
            return Vec::new();
        }
        let mask = u64::MAX >> (64 - context.timestamp_bits.min(64));
        let stamps = self.commands.timestamps();
        let mut out: Vec<(String, f64)> = Vec::new();
        for (pair, stage) in stamps.windows(2).zip(marks) {
            let ticks = pair[1].0.wrapping_sub(pair[0].0) & mask;
            let time = ticks as f64 * f64::from(context.limits.timestamp_period) * 1e-3;
            match out.iter_mut().find(|(name, _)| name == stage) {
                Some((_, sum)) => *sum += time,
                None => out.push((stage.clone(), time)),
            }
        }
        out
    }

    /// Number of passes that wait for an earlier pass.
    pub fn dependent_passes(&self) -> u32 {
        self.commands.passes.iter().filter(|pass| pass.waits).count() as u32
    }

    /// The stages in order of first appearance, with their numbers of passes.
    pub fn passes(&self) -> Vec<StagePasses> {
        let mut stages: Vec<StagePasses> = Vec::new();
        for pass in &self.commands.passes {
            let at = stages.iter().position(|known| known.stage == pass.stage).unwrap_or_else(|| {
                stages.push(StagePasses { stage: pass.stage.clone(), dispatches: 0, dependent: 0 });
                stages.len() - 1
            });
            stages[at].dispatches += 1;
            stages[at].dependent += u32::from(pass.waits);
        }
        stages
    }

    /// Every pass in the order of recording.
    pub fn all_passes(&self) -> &[Pass] {
        &self.commands.passes
    }

    /// All arrays that the recording uses, in the order in which they are bound first.
    pub fn arrays(&self) -> &[ArrayUse] {
        &self.commands.arrays
    }

    /// The last stage that started before a submit failed, as far as timestamps show; without timestamps, the first and
    /// the last stage of the submit.
    fn stage_reached(recordings: &[&Recording]) -> String {
        let reached = recordings.iter().rev().find_map(|r| {
            let stamps = r.commands.timestamps();
            let last = stamps.iter().rposition(|(_, written)| *written)?;
            r.commands.marks.get(last).map(|stage| format!("stage {stage}"))
        });
        let mut all = recordings.iter().flat_map(|r| &r.commands.passes).map(|pass| pass.stage.as_str());
        reached.unwrap_or_else(|| match (all.next(), all.next_back()) {
            (Some(first), Some(last)) if first != last => format!("stages {first} to {last}"),
            (Some(only), _) => format!("stage {only}"),
            (None, _) => "no stage".into(),
        })
    }
}
