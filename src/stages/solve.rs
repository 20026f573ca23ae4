//! Solve: implicit Euler by preconditioned conjugate gradients with a single reduction, decided on the device.

use std::mem::offset_of;
use std::sync::Arc;

use super::contact::Touch;
use super::elastic::Elastic;
use super::model::Model;
use super::{Common, args, array, count, types, upload, zeros};
use crate::Result;
use crate::gpu::{Buffer, Const, Context, Kernel, Memory, Recorder, Size};

/// The change of velocity that solve/apply takes: the solution, or the preconditioned residual.
#[derive(Clone, Copy)]
enum Change {
    Solution,
    Preconditioned,
}

/// Kernels and vectors, a vec4 a node.
pub struct Solve {
    assemble: Kernel,
    apply: Kernel,
    gather_warm: Kernel,
    gather_loop: Kernel,
    gather_final: Kernel,
    start: Kernel,
    begin: Kernel,
    scalars: Kernel,
    update: Kernel,
    conclude: Kernel,
    commit: Kernel,
    touch: Touch,
    has_contact: bool,
    /// A [`types::Core`] a dynamic core.
    pub cores: Buffer,
    core_nodes: Buffer,
    /// Six numbers a dynamic core: the change of its twist, for the host.
    pub core_changes: Buffer,
    /// One [`types::Solve`].
    pub state: Buffer,
    rhs: Buffer,
    leftover: Buffer,
    inverse: Buffer,
    /// Change of velocity; the next step's first guess.
    pub solution: Buffer,
    residual: Buffer,
    preconditioned: Buffer,
    direction: Buffer,
    direction_image: Buffer,
    image: Buffer,
    partials: Buffer,
    dots: Buffer,
}

impl Solve {
    /// Kernels and arrays for a model; `touch` is what it reads of contacts, if there can be any.
    pub fn new(context: &Arc<Context>, model: &Model, touch: Option<&Touch>) -> Result<Solve> {
        let (nodes, tetrahedra) = (model.node_rest.len(), model.tetrahedra.len());
        let groups = nodes.div_ceil(context.reduce_size() as usize);
        let nodes_c = ("NODES", count(nodes));
        let tetrahedra_c = ("TETRAHEDRA", count(tetrahedra));
        let contact = ("CONTACT", Const::Bool(touch.is_some()));
        let friction = ("FRICTION", Const::Bool(model.friction[0] > 0.0));
        let tool = ("TOOL", Const::Bool(model.tool_frame.is_some()));
        let partials = ("PARTIALS", count(groups));
        let group = ("GROUP", context.group_size().into());
        let cores = ("CORES", count(model.cores.len()));
        let reduce = |name: &str, constants: &[(&str, Const)]| Kernel::new(context, name, Size::Reduce, constants);
        let gather = |mode: u32| reduce("solve/gather", &[nodes_c, contact, ("MODE", mode.into())]);
        let by_node = |name: &str| Kernel::new(context, name, Size::Group, &[nodes_c, cores]);
        let vector = |name: &str| zeros::<[f32; 4]>(context, name, nodes);
        let core_count = model.cores.len().max(1);
        let mut core_nodes: Vec<u32> = model.cores.iter().flat_map(|core| core.nodes.clone()).collect();
        core_nodes.resize(core_nodes.len().max(1), types::NONE);
        Ok(Solve {
            assemble: reduce("solve/assemble", &[nodes_c, contact, friction])?,
            apply: Kernel::new(context, "solve/apply", Size::Group, &[tetrahedra_c, contact, friction])?,
            gather_warm: gather(0)?,
            gather_loop: gather(1)?,
            gather_final: gather(2)?,
            start: reduce("solve/start", &[nodes_c, tetrahedra_c, contact, friction, tool, partials, cores, group])?,
            begin: by_node("solve/begin")?,
            scalars: reduce("solve/scalars", &[contact, friction, tool, partials, cores])?,
            update: by_node("solve/update")?,
            conclude: reduce("solve/conclude", &[nodes_c, contact, friction, tool, partials, cores, group])?,
            commit: by_node("solve/commit")?,
            touch: touch.cloned().map_or_else(|| Touch::nothing(context), Ok)?,
            has_contact: touch.is_some(),
            cores: upload(context, "cores", &cores_of(model))?,
            core_nodes: upload(context, "nodes of cores", &core_nodes)?,
            core_changes: Buffer::new(context, "changes of cores", (24 * core_count) as u64, Memory::Readback)?,
            state: zeros::<types::Solve>(context, "solver state", 1)?,
            rhs: vector("right-hand side")?,
            leftover: vector("leftover")?,
            inverse: zeros::<[f32; 4]>(context, "inverse blocks", 2 * nodes)?,
            solution: vector("solution")?,
            residual: vector("residual")?,
            preconditioned: vector("preconditioned residual")?,
            direction: vector("direction")?,
            direction_image: vector("image of the direction")?,
            image: vector("image")?,
            partials: array::<[f32; 2]>(context, "partial sums", groups)?,
            dots: array::<[f32; 2]>(context, "inner products", groups)?,
        })
    }

    /// A new step: contacts that pulled last time say nothing about this one.
    pub fn record_reset(&self, recorder: &mut Recorder) {
        recorder.stage("solve");
        recorder.fill_range(&self.state, offset_of!(types::Solve, retries) as u64, 4, 0);
    }

    /// Right-hand side, preconditioner, warm start, first residual.
    pub fn record_start(&self, recorder: &mut Recorder, common: &Common, elastic: &Elastic) {
        recorder.stage("solve");
        let touch = &self.touch;
        let nodes = elastic.node_count as u32;
        recorder.dispatch(
            &self.assemble,
            &[
                &common.params,
                &elastic.node_damping,
                &elastic.node_info,
                &elastic.node_rest,
                &elastic.velocity,
                &elastic.node_elements,
                &elastic.element_forces,
                &elastic.gradients,
                &touch.node_entries,
                &touch.sorted,
                &touch.contacts,
                &self.leftover,
                &self.rhs,
                &self.preconditioned,
                &self.inverse,
                &self.partials,
            ],
            &[],
            nodes,
        );
        self.record_apply(recorder, common, elastic, Change::Solution, args::APPLY);
        self.record_gather(recorder, common, elastic, &self.gather_warm, None);
        recorder.dispatch_groups(
            &self.start,
            &[
                &common.params,
                &self.partials,
                &self.dots,
                &common.counts,
                &touch.contacts,
                &touch.contact_forces,
                &common.frames,
                &elastic.node_rest,
                &self.core_nodes,
                &self.rhs,
                &self.inverse,
                &self.image,
                &self.state,
                &self.cores,
                &common.args,
            ],
            &[],
            1,
        );
        recorder.dispatch(
            &self.begin,
            &[
                &self.state,
                &self.rhs,
                &self.image,
                &self.inverse,
                &common.frames,
                &self.cores,
                &elastic.node_info,
                &elastic.node_rest,
                &self.solution,
                &self.residual,
                &self.preconditioned,
                &self.direction,
                &self.direction_image,
            ],
            &[],
            nodes,
        );
    }

    /// Iterations of four passes each; free once converged.
    pub fn record_iterations(&self, recorder: &mut Recorder, common: &Common, elastic: &Elastic, iterations: u32) {
        recorder.stage("solve");
        for _ in 0..iterations {
            self.record_apply(recorder, common, elastic, Change::Preconditioned, args::LOOP_APPLY);
            self.record_gather(recorder, common, elastic, &self.gather_loop, Some(args::LOOP_GATHER));
            let touch = &self.touch;
            recorder.dispatch_indirect(
                &self.scalars,
                &[
                    &common.params,
                    &self.dots,
                    &common.counts,
                    &touch.contacts,
                    &touch.contact_forces,
                    &common.frames,
                    &elastic.node_rest,
                    &self.core_nodes,
                    &self.image,
                    &self.state,
                    &self.cores,
                    &common.args,
                ],
                &[],
                &common.args,
                args::LOOP_ONE,
            );
            recorder.dispatch_indirect(
                &self.update,
                &[
                    &self.state,
                    &self.image,
                    &self.inverse,
                    &common.frames,
                    &self.cores,
                    &elastic.node_info,
                    &elastic.node_rest,
                    &self.solution,
                    &self.residual,
                    &self.preconditioned,
                    &self.direction,
                    &self.direction_image,
                ],
                &[],
                &common.args,
                args::LOOP_UPDATE,
            );
        }
    }

    /// The residual recomputed, the verdict, and the new state where it is accepted.
    pub fn record_end(&self, recorder: &mut Recorder, common: &Common, elastic: &Elastic) {
        recorder.stage("solve");
        let touch = &self.touch;
        self.record_apply(recorder, common, elastic, Change::Solution, args::APPLY);
        self.record_gather(recorder, common, elastic, &self.gather_final, None);
        recorder.dispatch_groups(
            &self.conclude,
            &[
                &common.params,
                &self.dots,
                &common.counts,
                &touch.contacts,
                &touch.contact_forces,
                &common.frames,
                &elastic.node_rest,
                &self.core_nodes,
                &self.image,
                &self.state,
                &self.cores,
                &common.args,
                &common.report,
                &self.core_changes,
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
            &self.cores,
            &elastic.velocity,
            &elastic.displacement,
            &self.leftover,
        ];
        recorder.dispatch_indirect(&self.commit, &buffers, &[], &common.args, args::COMMIT);
    }

    fn record_apply(&self, recorder: &mut Recorder, common: &Common, elastic: &Elastic, change: Change, slot: u32) {
        let (of_tool, vector) = match change {
            Change::Solution => (0u32, &self.solution),
            Change::Preconditioned => (1, &self.preconditioned),
        };
        let touch = &self.touch;
        let buffers = [
            &common.params,
            &elastic.tetrahedra,
            &elastic.gradients,
            vector,
            &common.counts,
            &touch.contacts,
            &touch.entry_nodes,
            &touch.entry_weights,
            &self.state,
            &elastic.element_forces,
            &touch.contact_forces,
        ];
        let push = bytemuck::bytes_of(&of_tool);
        if self.has_contact || slot != args::APPLY {
            recorder.dispatch_indirect(&self.apply, &buffers, push, &common.args, slot);
        } else {
            recorder.dispatch(&self.apply, &buffers, push, elastic.tetrahedron_count as u32);
        }
    }

    fn record_gather(
        &self,
        recorder: &mut Recorder,
        common: &Common,
        elastic: &Elastic,
        kernel: &Kernel,
        slot: Option<u32>,
    ) {
        // What the inner products are taken with; see the modes of solve/gather.
        let (change, first, second) = if slot.is_some() {
            (&self.preconditioned, &self.preconditioned, &self.residual)
        } else {
            (&self.solution, &self.preconditioned, &self.rhs)
        };
        let touch = &self.touch;
        let buffers = [
            &common.params,
            &elastic.node_damping,
            &elastic.node_info,
            &elastic.node_rest,
            &elastic.node_elements,
            &elastic.element_forces,
            &touch.node_entries,
            &touch.sorted,
            &touch.contact_forces,
            change,
            first,
            second,
            &self.inverse,
            &self.image,
            &self.dots,
        ];
        match slot {
            Some(slot) => recorder.dispatch_indirect(kernel, &buffers, &[], &common.args, slot),
            None => recorder.dispatch(kernel, &buffers, &[], elastic.node_count as u32),
        }
    }
}

/// Dynamic cores at rest; one that is none where there are none.
fn cores_of(model: &Model) -> Vec<types::Core> {
    let mut first = 0;
    let mut cores: Vec<types::Core> = Vec::new();
    for core in &model.cores {
        let node_count = core.nodes.len() as u32;
        let nothing = <types::Core as bytemuck::Zeroable>::zeroed();
        let hinge = core.hinge.as_vec3().to_array();
        cores.push(types::Core { frame: core.frame as u32, node_first: first, node_count, hinge, ..nothing });
        first += node_count;
    }
    cores.resize(cores.len().max(1), bytemuck::Zeroable::zeroed());
    cores
}
