//! Records the passes of the solve stage of a step, in the order in which they run: conjugate gradients for a linear
//! system A x = b, whose matrix A is called the operator. The iterates (residual, direction and so on) exist twice, as
//! two sets; an iteration reads one set and writes the other.

use std::mem::offset_of;

use super::super::Common;
use super::super::elastic::Elastic;
use super::{Operator, Solve, Touch, Trend, Variant};
use crate::gpu::{Buffer, Kernel, Recorder};
use crate::shaders;

/// The vector that the operator is applied to: the latest solution, the trend (see [`super::Trend`]), or the
/// preconditioned residual of one set of iterates.
#[derive(Clone, Copy)]
enum Change {
    /// The last solution, before the iterations.
    Start,
    Trend,
    Preconditioned {
        set: u32,
    },
    /// The solution, after the iterations.
    End,
}

impl Solve {
    /// Records the reset, at the start of a step, of the number of Newton iterations that were done.
    pub fn record_reset(&self, recorder: &mut Recorder) {
        recorder.stage("solve");
        recorder.fill_range(&self.state, offset_of!(shaders::Solve, newton_iterations) as u64, 4, 0);
    }

    /// Records the assembly of the operator, if it is assembled, after the stage `elastic` has written its gradients.
    pub fn record_operator(&self, recorder: &mut Recorder, elastic: &Elastic) {
        let Some(assembled) = self.assembled() else { return };
        recorder.stage("solve");
        recorder.dispatch(
            &assembled.stiffness_blocks,
            &shaders::solve::StiffnessBlocks {
                edges: &assembled.edges,
                edge_elements: &assembled.edge_elements,
                gradients: &elastic.gradients,
                stiffness_blocks: &assembled.blocks,
            },
            assembled.edge_count,
        );
    }

    /// Records what precedes the iterations: right-hand side, preconditioner, warm start, first residual.
    pub fn record_start(&self, recorder: &mut Recorder, common: &Common, elastic: &Elastic) {
        recorder.stage("solve");
        let vectors = [Change::Start, Change::Trend];
        if self.assembled().is_some() {
            // Neither of the products needs anything of the other or of solve/assemble.
            recorder.together(|recorder| {
                self.record_assemble(recorder, common, elastic);
                for change in vectors {
                    self.record_product(recorder, common, elastic, change);
                }
            });
            self.record_cores(recorder, common, elastic);
            for change in vectors {
                self.record_gather(recorder, common, elastic, &self.gather_warm_start, change);
            }
        } else {
            // The products write the elements' forces, which solve/assemble and solve/gather read.
            self.record_assemble(recorder, common, elastic);
            self.record_cores(recorder, common, elastic);
            for change in vectors {
                self.record_product(recorder, common, elastic, change);
                self.record_gather(recorder, common, elastic, &self.gather_warm_start, change);
            }
        }
        if let Some(coarse) = &self.coarse {
            self.record_coarse(recorder, &coarse.warm_start, &self.restricted_rhs);
        }
        self.record_first_iterate(recorder, common, elastic);
    }

    /// Records right-hand side and preconditioner.
    fn record_assemble(&self, recorder: &mut Recorder, common: &Common, elastic: &Elastic) {
        let touch = self.touch.as_ref();
        recorder.dispatch_groups(
            &self.assemble,
            &shaders::solve::Assemble {
                params: &common.params,
                frames: &common.frames,
                blocks: &self.blocks,
                block_nodes: &self.block_nodes,
                block_places: &self.block_places,
                block_moments: Some(&self.block_moments),
                coarse_blocks: &self.coarse_blocks,
                node_rest: &elastic.node_rest,
                velocity: &elastic.velocity,
                displacement: Some(&elastic.displacement),
                node_elements: &elastic.node_elements,
                element_forces: &elastic.element_forces,
                gradients: &elastic.gradients,
                patch_rows: elastic.mean_dilatation.as_ref().map(|mean_dilatation| &mean_dilatation.rows),
                node_entries: touch.map(|touch| &touch.node_entries),
                sorted: touch.map(|touch| &touch.sorted),
                contacts: touch.map(|touch| &touch.contacts),
                carried_residual: &self.carried_residual,
                rigids: &self.rigids,
                rhs: &self.rhs,
                inverse: &self.inverse,
                blocks_without_contacts: Some(&self.blocks_without_contacts),
                partials: &self.partials,
                restricted_rhs: &self.restricted_rhs,
                block_rotations: Some(&self.block_rotations),
                block_turns: &self.block_turns,
                coarse_scales: Some(&self.coarse_scales),
                joints: Some(&common.joints),
                joint_sides: Some(&self.joint_sides),
                external_forces: self.loads.as_ref().map(|loads| &loads.external_forces),
                supported: self.supports.as_ref().map(|supports| &supports.nodes),
            },
            self.block_count,
        );
    }

    /// Records the choice of the warm start, and the first iterate.
    fn record_first_iterate(&self, recorder: &mut Recorder, common: &Common, elastic: &Elastic) {
        let touch = self.touch.as_ref();
        recorder.dispatch_groups(
            &self.first_residual,
            &shaders::solve::FirstResidual {
                params: &common.params,
                frames: Some(&common.frames),
                counts: Some(&common.counts),
                contacts: touch.map(|touch| &touch.contacts),
                partials: &self.partials,
                projections: &self.projections,
                trend_projections: &self.trend.projections,
                coarse_dots: Some(&self.coarse_dots),
                restricted_product: &self.restricted_product,
                restricted_trend: &self.trend.restricted_product,
                coarse_rhs: Some(&self.coarse_rhs),
                coarse_product: Some(&self.coarse_product),
                coarse_trend: Some(&self.trend.coarse_product),
                rigids: &self.rigids,
                rigid_inverses: &self.rigid_inverses,
                iterates: &self.iterates,
                rigid_trends: &self.trend.rigids,
                solve: &self.state,
                iterations: &self.iterations,
                args: &common.args,
            },
            1,
        );
        recorder.dispatch_groups(
            &self.first_iterate,
            &shaders::solve::FirstIterate {
                solve: &self.state,
                block_turns: &self.block_turns,
                blocks: &self.blocks,
                block_nodes: &self.block_nodes,
                block_places: &self.block_places,
                coarse_blocks: Some(&self.coarse_blocks),
                node_rest: &elastic.node_rest,
                rhs: &self.rhs,
                operator_product: &self.operator_product,
                trend_product: &self.trend.operator_product,
                inverse: &self.inverse,
                blocks_without_contacts: Some(&self.blocks_without_contacts),
                coarse_rhs: Some(&self.coarse_rhs),
                coarse_product: Some(&self.coarse_product),
                coarse_trend: Some(&self.trend.coarse_product),
                iterates: &self.iterates,
                solution: &self.solution,
                trend: &self.trend.nodes,
                residual: self.residual.now(0),
                preconditioned: self.preconditioned.now(0),
                direction: self.direction.now(0),
                direction_product: self.direction_product.now(0),
                restricted_direction: Some(self.restricted_direction.now(0)),
            },
            self.block_count,
        );
    }

    /// Records `iterations` solver iterations, rounded up to an even number, each of two or three passes that depend on one
    /// another. Once the solver has converged, the indirect arguments are zero, and the workgroups that are dispatched
    /// directly return at once, so the passes cost next to nothing.
    pub fn record_iterations(&self, recorder: &mut Recorder, common: &Common, elastic: &Elastic, iterations: u32) {
        recorder.stage("solve");
        for iteration in 0..iterations.next_multiple_of(2) {
            let set = iteration % 2;
            self.record_product(recorder, common, elastic, Change::Preconditioned { set });
            self.record_gather(recorder, common, elastic, &self.gather_loop, Change::Preconditioned { set });
            let arguments = shaders::solve::Update {
                set,
                params: &common.params,
                block_turns: &self.block_turns,
                blocks: &self.blocks,
                block_nodes: Some(&self.block_nodes),
                block_places: Some(&self.block_places),
                node_rest: Some(&elastic.node_rest),
                coarse_blocks: Some(&self.coarse_blocks),
                coarse_inverse: Some(&self.coarse_inverse),
                coarse_scales: Some(&self.coarse_scales),
                dots: &self.dots,
                restricted_product: Some(&self.restricted_product),
                restricted_residual: Some(&self.restricted_residual),
                operator_product: Some(&self.operator_product),
                inverse: Some(&self.inverse),
                blocks_without_contacts: Some(&self.blocks_without_contacts),
                residual: Some(self.residual.now(set)),
                preconditioned: Some(self.preconditioned.now(set)),
                direction: Some(self.direction.now(set)),
                direction_product: Some(self.direction_product.now(set)),
                rigids: Some(&self.rigids),
                solve: &self.state,
                iterations: &self.iterations,
                iterates: Some(&self.iterates),
                restricted_direction: Some(self.restricted_direction.now(set)),
                next_restricted_direction: Some(self.restricted_direction.next(set)),
                solution: Some(&self.solution),
                next_residual: Some(self.residual.next(set)),
                next_preconditioned: Some(self.preconditioned.next(set)),
                next_direction: Some(self.direction.next(set)),
                next_direction_product: Some(self.direction_product.next(set)),
                args: &common.args,
                rigid_inverses: Some(&self.rigid_inverses),
            };
            recorder.together(|recorder| {
                // The first variant is dispatched by the loop's indirect arguments and writes them anew; the other
                // variants run at the same time, so they must neither read nor write these arguments.
                for (index, Variant { kernel, groups, args_index }) in self.update.iter().enumerate() {
                    if index == 0 {
                        recorder.dispatch_indirect(kernel, &arguments, &common.args, *args_index);
                    } else {
                        recorder.dispatch_groups(kernel, &arguments, *groups);
                    }
                }
            });
        }
    }

    /// Records what follows the iterations: the residual computed anew, the decision whether the solution is accepted,
    /// and, if it is accepted, the new velocities and displacements.
    pub fn record_end(&self, recorder: &mut Recorder, common: &Common, elastic: &Elastic) {
        recorder.stage("solve");
        let touch = self.touch.as_ref();
        self.record_product(recorder, common, elastic, Change::End);
        self.record_gather(recorder, common, elastic, &self.gather_final, Change::End);
        if let Some(coarse) = &self.coarse {
            self.record_coarse(recorder, &coarse.end, &self.restricted_residual);
        }
        recorder.dispatch_groups(
            &self.conclude,
            &shaders::solve::Conclude {
                params: &common.params,
                frames: Some(&common.frames),
                dots: &self.dots,
                coarse_dots: Some(&self.coarse_dots),
                restricted_product: &self.restricted_product,
                contact_forces: touch.map(|touch| &touch.contact_forces),
                iterations: &self.iterations,
                iterates: &self.iterates,
                counts: &common.counts,
                contacts: touch.map(|touch| &touch.contacts),
                solve: &self.state,
                rigids: &self.rigids,
                rigid_trends: Some(&self.trend.rigids),
                args: &common.args,
                report: &common.report,
                core_changes: Some(&self.core_changes),
                rigid_inverses: &self.rigid_inverses,
            },
            1,
        );
        if let Some(supports) = &self.supports {
            supports.record(recorder, common, elastic);
        }
        let arguments = shaders::solve::Commit {
            params: &common.params,
            frames: &common.frames,
            node_info: &elastic.node_info,
            solution: &self.solution,
            rhs: Some(&self.rhs),
            operator_product: Some(&self.operator_product),
            linear_residual: elastic.linear_residual(),
            node_rest: &elastic.node_rest,
            solve: Some(&self.state),
            iterates: Some(&self.iterates),
            velocity: &elastic.velocity,
            displacement: &elastic.displacement,
            trend: &self.trend.nodes,
            carried_residual: &self.carried_residual,
            supported: self.supports.as_ref().map(|supports| &supports.nodes),
        };
        recorder.dispatch_indirect(&self.commit, &arguments, &common.args, shaders::ARGS_COMMIT);
    }

    /// Records the passes that stop all motion and clear the residual that is carried over to the next step.
    pub fn record_stop(&self, recorder: &mut Recorder, elastic: &Elastic) {
        recorder.stage("solve");
        let Trend { nodes, rigids, .. } = &self.trend;
        for buffer in [&elastic.velocity, &self.carried_residual, &self.solution, &self.iterates, nodes, rigids] {
            recorder.fill(buffer, 0);
        }
        for rigid in 0..self.rigid_count {
            let first = rigid * size_of::<shaders::Rigid>() + offset_of!(shaders::Rigid, carried_residual);
            recorder.fill_range(&self.rigids, first as u64, 24, 0);
        }
    }

    fn record_coarse(&self, recorder: &mut Recorder, kernel: &Kernel, rhs: &Buffer) {
        let arguments = shaders::solve::Coarse {
            coarse_blocks: &self.coarse_blocks,
            coarse_inverse: &self.coarse_inverse,
            coarse_scales: &self.coarse_scales,
            restricted_rhs: rhs,
            restricted_product: &self.restricted_product,
            restricted_trend: &self.trend.restricted_product,
            coarse_rhs: &self.coarse_rhs,
            coarse_product: &self.coarse_product,
            coarse_trend: &self.trend.coarse_product,
            coarse_dots: &self.coarse_dots,
        };
        recorder.dispatch_groups(kernel, &arguments, self.block_count);
    }

    /// Records the inversion of the diagonal blocks of A for the twists (linear and angular velocities) of dynamic
    /// cores, which are rigid bodies that forces move and that have nodes attached to them. Cores that joints connect
    /// form a group; the workgroup of the group's first core does the work, and the workgroups of the others return at
    /// once.
    fn record_cores(&self, recorder: &mut Recorder, common: &Common, elastic: &Elastic) {
        let Some(kernel) = &self.cores else { return };
        let arguments = shaders::solve::Cores {
            params: Some(&common.params),
            frames: &common.frames,
            block_nodes: &self.block_nodes,
            node_rest: &elastic.node_rest,
            rhs: &self.rhs,
            inverse: &self.inverse,
            restricted_rhs: &self.restricted_rhs,
            joints: &common.joints,
            joint_sides: &self.joint_sides,
            rigids: &self.rigids,
            rigid_blocks: &self.rigid_blocks,
            rigid_inverses: &self.rigid_inverses,
            external_forces: self.loads.as_ref().map(|loads| &loads.external_forces),
        };
        recorder.dispatch_groups(kernel, &arguments, self.core_count as u32);
    }

    /// Records what precedes [`Solve::record_gather`] in a product of the operator with a vector: contacts and, where the
    /// operator is matrix-free, tetrahedra and F-bar patches (groups of tetrahedra that share one volumetric strain).
    fn record_product(&self, recorder: &mut Recorder, common: &Common, elastic: &Elastic, change: Change) {
        let vector = match change {
            Change::Start | Change::End => &self.solution,
            Change::Trend => &self.trend.nodes,
            Change::Preconditioned { set } => self.preconditioned.now(set),
        };
        let in_loop = matches!(change, Change::Preconditioned { .. });
        let of_elements = shaders::solve::ElementProduct {
            tetrahedra: &elastic.tetrahedra,
            gradients: &elastic.gradients,
            change: vector,
            element_forces: &elastic.element_forces,
        };
        recorder.together(|recorder| {
            if let Operator::MatrixFree { element_product } = &self.operator {
                match in_loop {
                    true => recorder.dispatch_indirect(
                        element_product,
                        &of_elements,
                        &common.args,
                        shaders::ARGS_LOOP_ELEMENT_PRODUCT,
                    ),
                    false => recorder.dispatch(element_product, &of_elements, elastic.tetrahedron_count as u32),
                }
            }
            if let (Some(kernel), Some(mean_dilatation)) = (&self.patch_product, &elastic.mean_dilatation) {
                let arguments = shaders::solve::PatchProduct {
                    patch_nodes: &mean_dilatation.nodes,
                    patch_rows: &mean_dilatation.rows,
                    change: vector,
                    element_forces: &elastic.element_forces,
                };
                match in_loop {
                    true => recorder.dispatch_indirect(kernel, &arguments, &common.args, shaders::ARGS_LOOP_PATCHES),
                    false => recorder.dispatch(kernel, &arguments, mean_dilatation.patch_count as u32),
                }
            }
            if let Some(touch) = &self.touch {
                self.record_contacts(recorder, common, touch, change);
            }
        });
    }

    /// Records the contacts' part of a product.
    fn record_contacts(&self, recorder: &mut Recorder, common: &Common, touch: &Touch, change: Change) {
        if let Change::Preconditioned { set } = change {
            let arguments = shaders::solve::ContactIteration {
                set,
                params: &common.params,
                change: self.preconditioned.now(set),
                solution: &self.solution,
                counts: &common.counts,
                contacts: &touch.contacts,
                entry_nodes: &touch.entry_nodes,
                entry_weights: &touch.entry_weights,
                solve: &self.state,
                iterations: &self.iterations,
                iterates: Some(&self.iterates),
                contact_forces: &touch.contact_forces,
            };
            let kernel = &self.contact_iteration;
            recorder.dispatch_indirect(kernel, &arguments, &common.args, shaders::ARGS_LOOP_CONTACT_PRODUCT);
            return;
        }
        let (vector, iterates, contact_forces) = match (change, &self.trend) {
            (Change::Trend, trend) => (&trend.nodes, &trend.rigids, &trend.contact_forces),
            _ => (&self.solution, &self.iterates, &touch.contact_forces),
        };
        let arguments = shaders::solve::ContactProduct {
            is_end: matches!(change, Change::End).into(),
            params: &common.params,
            change: vector,
            counts: &common.counts,
            contacts: &touch.contacts,
            entry_nodes: &touch.entry_nodes,
            entry_weights: &touch.entry_weights,
            solve: Some(&self.state),
            iterates: Some(iterates),
            contact_forces,
        };
        recorder.dispatch_indirect(&self.contact_product, &arguments, &common.args, shaders::ARGS_CONTACTS);
    }

    /// Records the passes that sum the products of elements and contacts at the nodes, and take the inner products of
    /// vectors that conjugate gradients need. `change`: the vector that the products are with.
    fn record_gather(
        &self,
        recorder: &mut Recorder,
        common: &Common,
        elastic: &Elastic,
        kernels: &[Variant],
        change: Change,
    ) {
        // The constant MODE of the kernel solve/gather determines between which vectors it takes inner products.
        let set = if let Change::Preconditioned { set } = change { Some(set) } else { None };
        let preconditioned = self.preconditioned.now(set.unwrap_or_default());
        let residual_or_rhs = set.map_or(&self.rhs, |set| self.residual.now(set));
        let vector = if set.is_some() { preconditioned } else { &self.solution };
        let usual = (vector, &self.iterates, &self.operator_product, &self.restricted_product, &self.projections);
        let is_trend = matches!(change, Change::Trend);
        let (change, iterates, operator_product, restricted_product, projections) = match (is_trend, &self.trend) {
            (true, t) => (&t.nodes, &t.rigids, &t.operator_product, &t.restricted_product, &t.projections),
            _ => usual,
        };
        let (touch, assembled) = (self.touch.as_ref(), self.assembled());
        let arguments = shaders::solve::Gather {
            set: set.unwrap_or_default(),
            params: Some(&common.params),
            block_turns: Some(&self.block_turns),
            blocks: Some(&self.blocks),
            block_nodes: Some(assembled.map_or(&self.block_nodes, |assembled| &assembled.block_nodes)),
            block_places: Some(&self.block_places),
            coarse_blocks: Some(&self.coarse_blocks),
            node_rest: Some(&elastic.node_rest),
            node_elements: Some(&elastic.node_elements),
            element_forces: Some(&elastic.element_forces),
            stiffness_blocks: assembled.map(|assembled| &assembled.blocks),
            node_entries: touch.map(|touch| &touch.node_entries),
            sorted: touch.map(|touch| &touch.sorted),
            counts: Some(&common.counts),
            contacts: touch.map(|touch| &touch.contacts),
            contact_forces: touch.map(|touch| match is_trend {
                true => &self.trend.contact_forces,
                false => &touch.contact_forces,
            }),
            change: Some(change),
            trend: Some(&self.trend.nodes),
            residual_or_rhs: Some(residual_or_rhs),
            inverse: Some(&self.inverse),
            blocks_without_contacts: Some(&self.blocks_without_contacts),
            rigids: Some(&self.rigids),
            iterates: Some(iterates),
            operator_product: Some(operator_product),
            dots: Some(&self.dots),
            projections: Some(projections),
            restricted_product,
            restricted_residual: Some(&self.restricted_residual),
            solve: Some(&self.state),
            coarse_scales: Some(&self.coarse_scales),
            joints: Some(&common.joints),
            joint_sides: Some(&self.joint_sides),
            supported: self.supports.as_ref().map(|supports| &supports.nodes),
        };
        recorder.together(|recorder| {
            for Variant { kernel, groups, args_index } in kernels {
                match set {
                    Some(_) => recorder.dispatch_indirect(kernel, &arguments, &common.args, *args_index),
                    None => recorder.dispatch_groups(kernel, &arguments, *groups),
                }
            }
        });
    }
}
