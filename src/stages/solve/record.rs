//! The passes of the solver, in their order.

use std::mem::offset_of;

use super::super::elastic::Elastic;
use super::super::{Common, args, types};
use super::{Solve, Variant};
use crate::gpu::{Buffer, Kernel, Recorder};

/// The change of velocity that solve/apply takes: the newest solution, or the preconditioned residual of a set of iterates.
#[derive(Clone, Copy)]
enum Change {
    Solution,
    Preconditioned { set: u32 },
}

impl Solve {
    /// A new step: contacts that pulled last time say nothing about this one, and it is linearised at its start.
    pub fn record_reset(&self, recorder: &mut Recorder) {
        recorder.stage("solve");
        recorder.fill_range(&self.state, offset_of!(types::Solve, retries) as u64, 8, 0);
    }

    /// Right-hand side, preconditioner, warm start, first residual.
    pub fn record_start(&self, recorder: &mut Recorder, common: &Common, elastic: &Elastic) {
        recorder.stage("solve");
        let touch = &self.touch;
        recorder.dispatch_groups(
            &self.assemble,
            &[
                &common.params,
                &common.frames,
                &self.blocks,
                &self.block_nodes,
                &self.block_places,
                &self.block_moments,
                &self.coarse_blocks,
                &elastic.node_rest,
                &elastic.velocity,
                &elastic.displacement,
                &elastic.node_elements,
                &elastic.element_forces,
                &elastic.gradients,
                // Without patches nobody reads of them.
                elastic.dilate.as_ref().map_or(&elastic.gradients, |dilate| &dilate.rows),
                &touch.node_entries,
                &touch.sorted,
                &touch.contacts,
                &self.leftover,
                &self.rigids,
                &self.rhs,
                &self.preconditioned[0],
                &self.inverse,
                &self.partials,
                &self.restricted_rhs,
                &self.block_rotations,
                &self.block_turns,
                &self.coarse_scales,
                &common.joints,
                &self.joint_sides,
            ],
            &[],
            self.block_count,
        );
        self.record_cores(recorder, common, elastic);
        self.record_apply(recorder, common, elastic, Change::Solution);
        self.record_gather(recorder, common, elastic, &self.gather_warm, None);
        if let Some(coarse) = &self.coarse {
            self.record_coarse(recorder, &coarse.warm, &self.restricted_rhs);
        }
        recorder.dispatch_groups(
            &self.start,
            &[
                &common.params,
                &common.frames,
                &common.counts,
                &touch.contacts,
                &self.partials,
                &self.dots,
                &self.coarse_dots,
                &self.restricted_image,
                &self.coarse_rhs,
                &self.coarse_image,
                &self.rigids,
                &self.rigid_inverses,
                &self.iterates,
                &self.state,
                &self.iterations,
                &common.args,
            ],
            &[],
            1,
        );
        recorder.dispatch_groups(
            &self.begin,
            &[
                &self.state,
                &self.block_turns,
                &self.blocks,
                &self.block_nodes,
                &self.block_places,
                &self.coarse_blocks,
                &elastic.node_rest,
                &self.rhs,
                &self.image,
                &self.inverse,
                &self.coarse_rhs,
                &self.coarse_image,
                &self.iterates,
                &self.solution,
                &self.residual[0],
                &self.preconditioned[0],
                &self.direction[0],
                &self.direction_image[0],
                &self.restricted_direction,
            ],
            &[],
            self.block_count,
        );
    }

    /// Iterations of three dependent passes each, an even number of them; free once converged.
    pub fn record_iterations(&self, recorder: &mut Recorder, common: &Common, elastic: &Elastic, iterations: u32) {
        recorder.stage("solve");
        for iteration in 0..iterations.next_multiple_of(2) {
            let set = iteration % 2;
            let now = set as usize;
            self.record_apply(recorder, common, elastic, Change::Preconditioned { set });
            self.record_gather(recorder, common, elastic, &self.gather_loop, Some(set));
            let buffers = |args| {
                [
                    &common.params,
                    &self.block_turns,
                    &self.blocks,
                    &self.block_nodes,
                    &self.block_places,
                    &elastic.node_rest,
                    &self.coarse_blocks,
                    &self.coarse_inverse,
                    &self.coarse_scales,
                    &self.dots,
                    &self.restricted_image,
                    &self.restricted_residual,
                    &self.image,
                    &self.inverse,
                    &self.residual[now],
                    &self.preconditioned[now],
                    &self.direction[now],
                    &self.direction_image[now],
                    &self.rigids,
                    &self.state,
                    &self.iterations,
                    &self.iterates,
                    &self.restricted_direction,
                    &self.solution,
                    &self.residual[1 - now],
                    &self.preconditioned[1 - now],
                    &self.direction[1 - now],
                    &self.direction_image[1 - now],
                    args,
                    &self.rigid_inverses,
                ]
            };
            let push = bytemuck::bytes_of(&set);
            recorder.together(|recorder| {
                // One goes by the loop's arguments, and writes them; the others must do neither at the same time.
                for (index, Variant { kernel, groups, slot }) in self.update.iter().enumerate() {
                    if index == 0 {
                        recorder.dispatch_indirect(kernel, &buffers(&common.args), push, &common.args, *slot);
                    } else {
                        recorder.dispatch_groups(kernel, &buffers(&self.no_args), push, *groups);
                    }
                }
            });
        }
    }

    /// The residual recomputed, the verdict, and the new state where it is accepted.
    pub fn record_end(&self, recorder: &mut Recorder, common: &Common, elastic: &Elastic) {
        recorder.stage("solve");
        let touch = &self.touch;
        self.record_apply(recorder, common, elastic, Change::Solution);
        self.record_gather(recorder, common, elastic, &self.gather_final, None);
        if let Some(coarse) = &self.coarse {
            self.record_coarse(recorder, &coarse.end, &self.restricted_residual);
        }
        recorder.dispatch_groups(
            &self.conclude,
            &[
                &common.params,
                &common.frames,
                &self.dots,
                &self.coarse_dots,
                &self.restricted_image,
                &touch.contact_forces,
                &self.iterations,
                &self.iterates,
                &common.counts,
                &touch.contacts,
                &self.state,
                &self.rigids,
                &common.args,
                &common.report,
                &self.core_changes,
                &self.rigid_inverses,
            ],
            &[],
            1,
        );
        let buffers = [
            &common.params,
            &common.frames,
            &elastic.node_info,
            &self.solution,
            &self.rhs,
            &self.image,
            &elastic.node_rest,
            &self.state,
            &self.iterates,
            &elastic.velocity,
            &elastic.displacement,
            &self.leftover,
        ];
        recorder.dispatch_indirect(&self.commit, &buffers, &[], &common.args, args::COMMIT);
    }

    /// Nothing moves, nothing is left over.
    pub fn record_stop(&self, recorder: &mut Recorder, elastic: &Elastic) {
        recorder.stage("solve");
        for buffer in [&elastic.velocity, &self.leftover, &self.solution, &self.iterates] {
            recorder.fill(buffer, 0);
        }
        for rigid in 0..self.rigid_count {
            let first = rigid * size_of::<types::Rigid>() + offset_of!(types::Rigid, leftover);
            recorder.fill_range(&self.rigids, first as u64, 24, 0);
        }
    }

    fn record_coarse(&self, recorder: &mut Recorder, kernel: &Kernel, rhs: &Buffer) {
        let buffers = [
            &self.coarse_blocks,
            &self.coarse_inverse,
            &self.coarse_scales,
            rhs,
            &self.restricted_image,
            &self.coarse_rhs,
            &self.coarse_image,
            &self.coarse_dots,
        ];
        recorder.dispatch_groups(kernel, &buffers, &[], self.block_count);
    }

    /// A group's first core has a workgroup; those of the others have nothing to do.
    fn record_cores(&self, recorder: &mut Recorder, common: &Common, elastic: &Elastic) {
        let Some(kernel) = &self.cores else { return };
        let buffers = [
            &common.params,
            &common.frames,
            &self.block_nodes,
            &elastic.node_rest,
            &self.rhs,
            &self.inverse,
            &self.restricted_rhs,
            &common.joints,
            &self.joint_sides,
            &self.rigids,
            &self.rigid_blocks,
            &self.rigid_inverses,
        ];
        recorder.dispatch_groups(kernel, &buffers, &[], self.core_count as u32);
    }

    fn record_apply(&self, recorder: &mut Recorder, common: &Common, elastic: &Elastic, change: Change) {
        let (push, vector, in_loop) = match change {
            Change::Solution => ([1, 0], &self.solution, false),
            Change::Preconditioned { set } => ([0, set], &self.preconditioned[set as usize], true),
        };
        let touch = &self.touch;
        let of_elements = [&elastic.tetrahedra, &elastic.gradients, vector, &elastic.element_forces];
        let of_contacts = [
            &common.params,
            vector,
            &common.counts,
            &touch.contacts,
            &touch.entry_nodes,
            &touch.entry_weights,
            &self.state,
            &self.iterates,
            &touch.contact_forces,
        ];
        recorder.together(|recorder| {
            if in_loop {
                recorder.dispatch_indirect(&self.apply, &of_elements, &[], &common.args, args::LOOP_APPLY);
            } else {
                recorder.dispatch(&self.apply, &of_elements, &[], elastic.tetrahedron_count as u32);
            }
            if let (Some(kernel), Some(dilate)) = (&self.patches, &elastic.dilate) {
                let buffers = [&dilate.nodes, &dilate.rows, vector, &elastic.element_forces];
                match in_loop {
                    true => recorder.dispatch_indirect(kernel, &buffers, &[], &common.args, args::LOOP_PATCHES),
                    false => recorder.dispatch(kernel, &buffers, &[], dilate.patch_count as u32),
                }
            }
            if self.has_contact {
                let slot = if in_loop { args::LOOP_PRESS } else { args::CONTACTS };
                recorder.dispatch_indirect(&self.press, &of_contacts, bytemuck::bytes_of(&push), &common.args, slot);
            }
        });
    }

    /// `set`: of iterates, in the loop.
    fn record_gather(
        &self,
        recorder: &mut Recorder,
        common: &Common,
        elastic: &Elastic,
        kernels: &[Variant],
        set: Option<u32>,
    ) {
        // What the inner products are taken with; see the modes of solve/gather.
        let (change, first, second) = match set.map(|set| set as usize) {
            Some(now) => (&self.preconditioned[now], &self.preconditioned[now], &self.residual[now]),
            None => (&self.solution, &self.preconditioned[0], &self.rhs),
        };
        let touch = &self.touch;
        let buffers = [
            &common.params,
            &self.block_turns,
            &self.blocks,
            &self.block_nodes,
            &self.block_places,
            &self.coarse_blocks,
            &elastic.node_rest,
            &elastic.node_elements,
            &elastic.element_forces,
            &touch.node_entries,
            &touch.sorted,
            &common.counts,
            &touch.contacts,
            &touch.contact_forces,
            change,
            first,
            second,
            &self.inverse,
            &self.rigids,
            &self.iterates,
            &self.image,
            &self.dots,
            &self.restricted_image,
            &self.restricted_residual,
            &self.state,
            &self.coarse_scales,
            &common.joints,
            &self.joint_sides,
        ];
        let push = set.unwrap_or_default();
        let push = bytemuck::bytes_of(&push);
        recorder.together(|recorder| {
            for Variant { kernel, groups, slot } in kernels {
                match set {
                    Some(_) => recorder.dispatch_indirect(kernel, &buffers, push, &common.args, *slot),
                    None => recorder.dispatch_groups(kernel, &buffers, push, *groups),
                }
            }
        });
    }
}
