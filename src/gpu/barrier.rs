//! When one pass must wait for another. Kept per buffer, answered with global memory barriers: drivers treat those as
//! well as per-buffer ones, and one barrier then covers all that came before it.

use std::collections::HashSet;

use ash::vk::{AccessFlags2 as Access, MemoryBarrier2, PipelineStageFlags2 as Stages};

/// One use of a buffer by one command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Use {
    /// The Vulkan handle.
    pub id: u64,
    pub reads: bool,
    pub writes: bool,
    /// Where in the pipeline.
    pub stages: Stages,
    /// How it is written; none for a read.
    pub write_access: Access,
}

/// Stages whose shaders draw.
const GRAPHICS: Stages = Stages::from_raw(Stages::VERTEX_SHADER.as_raw() | Stages::FRAGMENT_SHADER.as_raw());
/// Stages that touch the images drawn onto, and how.
pub(super) const CANVAS: Stages = Stages::from_raw(
    Stages::COLOR_ATTACHMENT_OUTPUT.as_raw()
        | Stages::EARLY_FRAGMENT_TESTS.as_raw()
        | Stages::LATE_FRAGMENT_TESTS.as_raw(),
);
pub(super) const CANVAS_WRITE: Access =
    Access::from_raw(Access::COLOR_ATTACHMENT_WRITE.as_raw() | Access::DEPTH_STENCIL_ATTACHMENT_WRITE.as_raw());
const CANVAS_READ: Access =
    Access::from_raw(Access::COLOR_ATTACHMENT_READ.as_raw() | Access::DEPTH_STENCIL_ATTACHMENT_READ.as_raw());

/// What happened since the last barrier.
#[derive(Debug, Default)]
pub(super) struct Hazards {
    written: HashSet<u64>,
    read: HashSet<u64>,
    stages: Stages,
    writes: Access,
    barriers: u32,
    /// The recording draws, so barriers from here on also hold back drawing.
    draws: bool,
    /// What passes that run side by side did so far, which none of them waits for.
    together: Option<Vec<Use>>,
}

impl Hazards {
    /// Notes a command and its uses. The barrier, if one must come before it.
    pub fn before(&mut self, uses: &[Use]) -> Option<MemoryBarrier2<'static>> {
        let waits = |u: &Use| self.written.contains(&u.id) || (u.writes && self.read.contains(&u.id));
        let mut needed = uses.iter().any(waits);
        if !self.draws && uses.iter().any(|u| u.stages.intersects(GRAPHICS | CANVAS)) {
            self.draws = true;
            // Earlier barriers did not reach the drawing stages: this one carries all earlier writes to them.
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

    /// From here on passes do not wait for each other, only for what came before.
    pub fn begin_together(&mut self) {
        self.together = Some(Vec::new());
    }

    /// Up to here.
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

    /// From all since the last barrier, to whatever may follow.
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

    /// Before a recording: everything that ran earlier, to everything in it.
    pub fn opening() -> MemoryBarrier2<'static> {
        MemoryBarrier2::default()
            .src_stage_mask(Stages::ALL_COMMANDS)
            .src_access_mask(Access::MEMORY_WRITE)
            .dst_stage_mask(Stages::ALL_COMMANDS)
            .dst_access_mask(Access::MEMORY_READ | Access::MEMORY_WRITE)
    }

    /// After a recording: everything in it, to the host's reads.
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
        assert_eq!(barriers(&[&[write(1)], &[write(2)], &[read(3)]]), [false, false, false], "independent");
        assert_eq!(barriers(&[&[read(1)], &[read(1)]]), [false, false], "two reads");
        assert_eq!(barriers(&[&[write(1)], &[read(1)]]), [false, true], "read after write");
        assert_eq!(barriers(&[&[read(1)], &[write(1)]]), [false, true], "write after read");
        assert_eq!(barriers(&[&[write(1)], &[write(1)]]), [false, true], "write after write");
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
        hazards.begin_together();
        let mut waits = |uses: &[Use]| hazards.before(uses).is_some();
        assert!(!waits(&[write(2), write(3)]));
        assert!(waits(&[read(1), write(2)]), "what was before");
        assert!(!waits(&[read(1), write(2)]), "each other");
        hazards.end_together();
        let mut waits = |uses: &[Use]| hazards.before(uses).is_some();
        assert!(waits(&[read(3)]), "also what was written before a barrier among them");
        assert!(!waits(&[read(2)]), "one barrier covers all");
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
