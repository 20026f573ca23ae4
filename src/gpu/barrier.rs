//! Decides where a pass (dispatch, draw, fill or copy) of a recording (command buffer) must wait for earlier passes.
//! Uses are tracked for each buffer and image, but the result is a global memory barrier: drivers run a global barrier
//! no slower than a barrier for one buffer, and it covers all passes before it.

use std::collections::HashSet;

use ash::vk::{AccessFlags2 as Access, MemoryBarrier2, PipelineStageFlags2 as Stages};

/// One use of a buffer or image by one command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Use {
    /// The Vulkan handle of the buffer or image.
    pub id: u64,
    pub reads: bool,
    pub writes: bool,
    /// Pipeline stages in which the command uses the buffer or image.
    pub stages: Stages,
    /// Kind of write access; empty for a read.
    pub write_access: Access,
}

/// Shader stages of the graphics pipeline.
const GRAPHICS: Stages = Stages::from_raw(Stages::VERTEX_SHADER.as_raw() | Stages::FRAGMENT_SHADER.as_raw());
/// Pipeline stages that read or write the attachments of a canvas (the colour and depth images drawn onto). The kinds
/// of access in these stages are `CANVAS_WRITE` and `CANVAS_READ`.
pub(super) const CANVAS: Stages = Stages::from_raw(
    Stages::COLOR_ATTACHMENT_OUTPUT.as_raw()
        | Stages::EARLY_FRAGMENT_TESTS.as_raw()
        | Stages::LATE_FRAGMENT_TESTS.as_raw(),
);
pub(super) const CANVAS_WRITE: Access =
    Access::from_raw(Access::COLOR_ATTACHMENT_WRITE.as_raw() | Access::DEPTH_STENCIL_ATTACHMENT_WRITE.as_raw());
const CANVAS_READ: Access =
    Access::from_raw(Access::COLOR_ATTACHMENT_READ.as_raw() | Access::DEPTH_STENCIL_ATTACHMENT_READ.as_raw());

/// Uses since the last barrier, which tell whether the next command needs a barrier.
#[derive(Debug, Default)]
pub(super) struct Hazards {
    written: HashSet<u64>,
    read: HashSet<u64>,
    stages: Stages,
    writes: Access,
    barriers: u32,
    /// Whether the recording has draws; if so, every barrier from here on also covers the graphics stages.
    draws: bool,
    /// Uses by the passes of the open group; see `begin_together`. `None` while no group is open.
    together: Option<Vec<Use>>,
}

impl Hazards {
    /// Adds the uses of the next command. Returns the barrier that must be recorded before the command, or `None`.
    pub fn before(&mut self, uses: &[Use]) -> Option<MemoryBarrier2<'static>> {
        let waits = |u: &Use| self.written.contains(&u.id) || (u.writes && self.read.contains(&u.id));
        let mut needed = uses.iter().any(waits);
        if !self.draws && uses.iter().any(|u| u.stages.intersects(GRAPHICS | CANVAS)) {
            self.draws = true;
            // Earlier barriers did not cover the graphics stages, so this one makes all earlier writes visible in them.
            if self.barriers > 0 {
                needed = true;
                self.stages |= Stages::COMPUTE_SHADER | Stages::ALL_TRANSFER;
                self.writes |= Access::SHADER_WRITE | Access::TRANSFER_WRITE;
            }
        }
        let barrier = needed.then(|| self.barrier());
        match &mut self.together {
            Some(group) => group.extend_from_slice(uses),
            None => self.note(uses),
        }
        barrier
    }

    /// Opens a group of passes that do not wait for each other, only for what was recorded before the group. Returns
    /// false within an open group, to which the passes then belong.
    pub fn begin_together(&mut self) -> bool {
        let opens = self.together.is_none();
        if opens {
            self.together = Some(Vec::new());
        }
        opens
    }

    /// Closes the group: from now on, passes wait for passes of the group as for any others.
    pub fn end_together(&mut self) {
        if let Some(group) = self.together.take() {
            self.note(&group);
        }
    }

    fn note(&mut self, uses: &[Use]) {
        for u in uses {
            if u.writes {
                self.written.insert(u.id);
            }
            if u.reads {
                self.read.insert(u.id);
            }
            self.stages |= u.stages;
            self.writes |= u.write_access;
        }
    }

    /// Returns a barrier from all uses since the last barrier to every later command, and forgets those uses.
    fn barrier(&mut self) -> MemoryBarrier2<'static> {
        let mut stages = Stages::COMPUTE_SHADER | Stages::DRAW_INDIRECT | Stages::ALL_TRANSFER;
        let mut access = Access::SHADER_READ
            | Access::SHADER_WRITE
            | Access::UNIFORM_READ
            | Access::INDIRECT_COMMAND_READ
            | Access::TRANSFER_READ
            | Access::TRANSFER_WRITE;
        if self.draws {
            stages |= GRAPHICS | CANVAS | Stages::INDEX_INPUT;
            access |= CANVAS_READ | CANVAS_WRITE | Access::INDEX_READ;
        }
        let barrier = MemoryBarrier2::default()
            .src_stage_mask(self.stages)
            .src_access_mask(self.writes)
            .dst_stage_mask(stages)
            .dst_access_mask(access);
        let together = self.together.take();
        *self = Hazards { barriers: self.barriers + 1, draws: self.draws, together, ..Hazards::default() };
        barrier
    }

    /// The barrier that opens a recording: whatever ran on the GPU before is visible to every command of the recording.
    pub fn opening() -> MemoryBarrier2<'static> {
        MemoryBarrier2::default()
            .src_stage_mask(Stages::ALL_COMMANDS)
            .src_access_mask(Access::MEMORY_WRITE)
            .dst_stage_mask(Stages::ALL_COMMANDS)
            .dst_access_mask(Access::MEMORY_READ | Access::MEMORY_WRITE)
    }

    /// The barrier that closes a recording: whatever the recording wrote is visible to reads by the CPU.
    pub fn closing() -> MemoryBarrier2<'static> {
        MemoryBarrier2::default()
            .src_stage_mask(Stages::ALL_COMMANDS)
            .src_access_mask(Access::MEMORY_WRITE)
            .dst_stage_mask(Stages::HOST)
            .dst_access_mask(Access::HOST_READ)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(id: u64) -> Use {
        Use { id, reads: true, writes: false, stages: Stages::COMPUTE_SHADER, write_access: Access::NONE }
    }

    fn write(id: u64) -> Use {
        Use { id, reads: false, writes: true, stages: Stages::COMPUTE_SHADER, write_access: Access::SHADER_WRITE }
    }

    fn barriers(passes: &[&[Use]]) -> Vec<bool> {
        let mut hazards = Hazards::default();
        passes.iter().map(|uses| hazards.before(uses).is_some()).collect()
    }

    #[test]
    fn only_dependent_passes_wait() {
        assert_eq!(
            barriers(&[&[write(1)], &[write(2)], &[read(3)]]),
            [false, false, false],
            "independent passes must not wait"
        );
        assert_eq!(barriers(&[&[read(1)], &[read(1)]]), [false, false], "a read must not wait for a read");
        assert_eq!(barriers(&[&[write(1)], &[read(1)]]), [false, true], "a read must wait for an earlier write");
        assert_eq!(barriers(&[&[read(1)], &[write(1)]]), [false, true], "a write must wait for an earlier read");
        assert_eq!(barriers(&[&[write(1)], &[write(1)]]), [false, true], "a write must wait for an earlier write");
    }

    #[test]
    fn one_barrier_covers_all_before_it() {
        assert_eq!(
            barriers(&[&[write(1)], &[write(2)], &[read(1), write(3)], &[read(2)]]),
            [false, false, true, false]
        );
        assert_eq!(barriers(&[&[write(1)], &[read(1), write(2)], &[read(1)], &[read(2)]]), [false, true, false, true]);
    }

    #[test]
    fn passes_together_wait_for_what_was_before_and_hold_back_what_comes_after() {
        let mut hazards = Hazards::default();
        let mut waits = |uses: &[Use]| hazards.before(uses).is_some();
        assert!(!waits(&[write(1)]));
        assert!(hazards.begin_together());
        assert!(hazards.before(&[write(4)]).is_none());
        assert!(!hazards.begin_together(), "a group within a group is a part of it");
        let mut waits = |uses: &[Use]| hazards.before(uses).is_some();
        assert!(!waits(&[write(2), write(3)]));
        assert!(waits(&[read(1), write(2)]), "a pass of a group must wait for writes before the group");
        assert!(!waits(&[read(1), write(2)]), "passes of a group must not wait for each other");
        hazards.end_together();
        let mut waits = |uses: &[Use]| hazards.before(uses).is_some();
        assert!(waits(&[read(3)]), "a later pass must wait for the group's first write, despite the barrier after it");
        assert!(!waits(&[read(2), read(4)]), "one barrier must cover all passes of the group");
    }

    #[test]
    fn the_first_draw_waits_for_writes_behind_earlier_barriers() {
        let draw = Use { stages: Stages::VERTEX_SHADER | Stages::FRAGMENT_SHADER, ..read(1) };
        assert_eq!(barriers(&[&[write(1)], &[read(1)], &[draw]]), [false, true, true]);
        assert_eq!(barriers(&[&[draw], &[draw]]), [false, false]);
        let mut hazards = Hazards::default();
        hazards.before(&[write(1)]);
        hazards.before(&[write(1)]);
        let barrier = hazards.before(&[draw]).unwrap();
        assert!(barrier.src_access_mask.contains(Access::SHADER_WRITE));
        assert!(barrier.dst_stage_mask.contains(Stages::VERTEX_SHADER | Stages::FRAGMENT_SHADER));
    }

    #[test]
    fn passes_wait_for_what_a_draw_writes() {
        let stages = Stages::VERTEX_SHADER | Stages::FRAGMENT_SHADER;
        let draw = Use { stages, ..write(1) };
        assert_eq!(barriers(&[&[draw], &[read(1)]]), [false, true]);
        assert_eq!(barriers(&[&[draw], &[draw]]), [false, true]);
        let mut hazards = Hazards::default();
        hazards.before(&[draw]);
        let barrier = hazards.before(&[read(1)]).unwrap();
        assert!(barrier.src_stage_mask.contains(Stages::FRAGMENT_SHADER));
        assert!(barrier.src_access_mask.contains(Access::SHADER_WRITE));
        assert!(barrier.dst_stage_mask.contains(Stages::COMPUTE_SHADER));
    }
}
