//! Solve: implicit Euler by preconditioned conjugate gradients with a single reduction, decided on the device.

use std::mem::offset_of;
use std::ops::Range;
use std::sync::Arc;

use super::contact::Touch;
use super::elastic::Elastic;
use super::model::{Core, Model};
use super::{Common, args, array, count, types, upload, zeros};
use crate::Result;
use crate::gpu::{Buffer, Const, Context, Kernel, Memory, Recorder, Size};

/// The change of velocity that solve/apply takes: the newest solution, or the preconditioned residual of a set of iterates.
#[derive(Clone, Copy)]
enum Change {
    Solution,
    Preconditioned { set: u32 },
}

/// No rotation, a quaternion.
const UNTURNED: [f32; 4] = [0.0, 0.0, 0.0, 1.0];

/// Kernels and vectors, a vec4 a node.
pub struct Solve {
    assemble: Kernel,
    apply: Kernel,
    press: Kernel,
    patches: Option<Kernel>,
    gather_warm: Vec<Variant>,
    gather_loop: Vec<Variant>,
    gather_final: Vec<Variant>,
    coarse: Option<CoarseKernels>,
    start: Kernel,
    begin: Kernel,
    /// The first leads.
    update: Vec<Variant>,
    /// What the others of these are given for arguments.
    no_args: Buffer,
    conclude: Kernel,
    commit: Kernel,
    touch: Touch,
    has_contact: bool,
    block_count: u32,
    rigid_count: usize,
    blocks: Buffer,
    block_nodes: Buffer,
    block_places: Buffer,
    block_moments: Buffer,
    block_rotations: Buffer,
    block_turns: Buffer,
    coarse_blocks: Buffer,
    coarse_inverse: Buffer,
    coarse_scales: Buffer,
    restricted_rhs: Buffer,
    restricted_image: Buffer,
    restricted_residual: Buffer,
    restricted_direction: Buffer,
    coarse_rhs: Buffer,
    coarse_image: Buffer,
    coarse_dots: Buffer,
    /// A [`types::Rigid`] a dynamic core, and the tool.
    pub rigids: Buffer,
    /// Two sets of a [`types::RigidIterate`] each.
    pub iterates: Buffer,
    iterations: Buffer,
    /// Six numbers a dynamic core: the change of its twist, for the host.
    pub core_changes: Buffer,
    /// One [`types::Solve`].
    pub state: Buffer,
    rhs: Buffer,
    leftover: Buffer,
    inverse: Buffer,
    /// Change of velocity; the next step's first guess.
    pub solution: Buffer,
    residual: [Buffer; 2],
    preconditioned: [Buffer; 2],
    direction: [Buffer; 2],
    direction_image: [Buffer; 2],
    image: Buffer,
    partials: Buffer,
    dots: Buffer,
}

/// A kernel for what one role works on; see shaders/shared/roles.glsl.
struct Variant {
    kernel: Kernel,
    /// Workgroups.
    groups: u32,
    /// Slot of the indirect arguments in the loop.
    slot: u32,
}

/// The coarse level outside the loop: before it, and at its end.
struct CoarseKernels {
    warm: Kernel,
    end: Kernel,
}

impl Solve {
    /// Kernels and arrays for a model; `touch` is what it reads of contacts, if there can be any.
    pub fn new(context: &Arc<Context>, model: &Model, touch: Option<&Touch>) -> Result<Solve> {
        let (nodes, tetrahedra) = (model.node_rest.len(), model.tetrahedra.len());
        let (has_tool, is_coarse) = (model.tool_frame.is_some(), !model.coarse.bodies.is_empty());
        let block_count = model.blocks.blocks.len();
        let groups = block_count + usize::from(has_tool);
        let rigid_count = model.cores.len() + usize::from(has_tool);
        let nodes_c = ("NODES", count(nodes));
        let tetrahedra_c = ("TETRAHEDRA", count(tetrahedra));
        let contact = ("CONTACT", Const::Bool(touch.is_some()));
        let friction = ("FRICTION", Const::Bool(model.friction[0] > 0.0));
        let tool = ("TOOL", Const::Bool(has_tool));
        let held = ("HELD", Const::Uint(model.held.map_or(types::NONE, |core| core as u32)));
        let coarse = ("COARSE", Const::Bool(is_coarse));
        let blocks = ("BLOCKS", count(block_count));
        let partials = ("PARTIALS", count(groups));
        let rigids = ("RIGIDS", count(rigid_count));
        let group = ("GROUP", context.group_size().into());
        let reduce = |name: &str, constants: &[(&str, Const)]| Kernel::new(context, name, Size::Reduce, constants);
        // Of each role that there is: its number, its first block, workgroups, arguments.
        let (free, carried) = (model.blocks.free, block_count - model.blocks.free);
        let roles = [
            (0, 0, free, args::LOOP_FREE),
            (1, free, carried, args::LOOP_CARRIED),
            (2, 0, usize::from(has_tool), args::LOOP_TOOL),
        ];
        let roles: Vec<_> = roles.into_iter().filter(|(_, _, groups, _)| *groups > 0).collect();
        let variants = |name: &str, constants: &[(&str, Const)]| -> Result<Vec<Variant>> {
            let variant = |(role, first, groups, slot): &(u32, usize, usize, u32)| {
                let own =
                    [("ROLE", Const::Uint(*role)), ("FIRST", count(*first)), ("LEADS", (*role == roles[0].0).into())];
                let own = if name == "solve/update" { &own[..] } else { &own[..2] };
                let kernel = reduce(name, &[constants, own].concat())?;
                Ok(Variant { kernel, groups: *groups as u32, slot: *slot })
            };
            roles.iter().map(variant).collect()
        };
        let gather = |mode: u32| {
            variants("solve/gather", &[blocks, contact, friction, coarse, rigids, held, ("MODE", mode.into())])
        };
        let patch_count = model.patches.count();
        let patches_c = ("PATCHES", count(patch_count));
        let patches = || Kernel::new(context, "solve/patches", Size::Group, &[patches_c, tetrahedra_c]);
        let coarse_kernel = |warm: bool| reduce("solve/coarse", &[("WARM", warm.into())]);
        let coarse_kernels = || Ok(CoarseKernels { warm: coarse_kernel(true)?, end: coarse_kernel(false)? });
        let vector = |name: &str| zeros::<[f32; 4]>(context, name, nodes);
        let both = |name: &str| Ok([vector(name)?, vector(name)?]);
        let modes = |name: &str, sets: usize| zeros::<[f32; 4]>(context, name, 3 * groups * sets);
        let coarse_modes = |name: &str, sets: usize| modes(name, if is_coarse { sets } else { 0 });
        let all = 2 * rigid_count;
        Ok(Solve {
            assemble: reduce(
                "solve/assemble",
                &[contact, friction, coarse, held, tetrahedra_c, ("PATCHES", (patch_count > 0).into())],
            )?,
            apply: Kernel::new(context, "solve/apply", Size::Group, &[tetrahedra_c])?,
            press: Kernel::new(context, "solve/press", Size::Group, &[friction, tool, rigids])?,
            patches: (patch_count > 0).then(patches).transpose()?,
            gather_warm: gather(0)?,
            gather_loop: gather(1)?,
            gather_final: gather(2)?,
            coarse: is_coarse.then(coarse_kernels).transpose()?,
            start: reduce(
                "solve/start",
                &[
                    tetrahedra_c,
                    contact,
                    friction,
                    tool,
                    coarse,
                    blocks,
                    rigids,
                    group,
                    ("FREE_BLOCKS", count(free)),
                    patches_c,
                    held,
                ],
            )?,
            begin: reduce("solve/begin", &[coarse])?,
            update: variants("solve/update", &[blocks, coarse, partials, rigids])?,
            no_args: zeros::<u32>(context, "no arguments", 1)?,
            conclude: reduce("solve/conclude", &[nodes_c, contact, tool, coarse, blocks, rigids, group])?,
            commit: Kernel::new(context, "solve/commit", Size::Group, &[nodes_c, rigids])?,
            touch: touch.cloned().map_or_else(|| Touch::nothing(context), Ok)?,
            has_contact: touch.is_some(),
            block_count: block_count as u32,
            rigid_count,
            blocks: upload_or_nothing(context, "blocks", &model.blocks.blocks)?,
            block_nodes: upload_or_nothing(context, "nodes of blocks", &model.blocks.nodes)?,
            block_places: upload_or_nothing(context, "places of blocks", &model.blocks.places)?,
            block_moments: upload_or_nothing(context, "moments of blocks", &model.blocks.moments)?,
            block_rotations: upload(context, "rotations of blocks", &vec![UNTURNED; block_count.max(1)])?,
            block_turns: upload(context, "turns of blocks", &vec![UNTURNED; block_count.max(1)])?,
            coarse_blocks: upload_or_nothing(context, "coarse blocks", &model.coarse.blocks)?,
            coarse_inverse: upload_or_nothing(context, "coarse inverse", &model.coarse.inverse)?,
            coarse_scales: upload_or_nothing(context, "coarse scales", &model.coarse.scales)?,
            restricted_rhs: modes("restricted right-hand side", 1)?,
            restricted_image: modes("restricted image", 1)?,
            restricted_residual: coarse_modes("restricted residual", 1)?,
            restricted_direction: coarse_modes("restricted direction", 2)?,
            coarse_rhs: coarse_modes("coarse right-hand side", 1)?,
            coarse_image: coarse_modes("coarse image", 1)?,
            coarse_dots: coarse_modes("coarse inner products", 1)?,
            rigids: upload_or_nothing(context, "rigid bodies", &rigids_of(model))?,
            iterates: zeros::<types::RigidIterate>(context, "iterates of rigid bodies", all)?,
            iterations: zeros::<types::Iteration>(context, "iterations", 2)?,
            core_changes: Buffer::new(
                context,
                "changes of cores",
                24 * model.cores.len().max(1) as u64,
                Memory::Readback,
            )?,
            state: zeros::<types::Solve>(context, "solver state", 1)?,
            rhs: vector("right-hand side")?,
            leftover: vector("leftover")?,
            inverse: zeros::<[f32; 4]>(context, "inverse blocks", 2 * nodes)?,
            solution: vector("solution")?,
            residual: both("residual")?,
            preconditioned: both("preconditioned residual")?,
            direction: both("direction")?,
            direction_image: both("image of the direction")?,
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
            ],
            &[],
            self.block_count,
        );
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
                &self.block_nodes,
                &elastic.node_rest,
                &common.counts,
                &touch.contacts,
                &self.partials,
                &self.dots,
                &self.coarse_dots,
                &self.restricted_rhs,
                &self.restricted_image,
                &self.coarse_rhs,
                &self.coarse_image,
                &self.rhs,
                &self.inverse,
                &self.rigids,
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

/// Dynamic cores, and the tool, at rest.
fn rigids_of(model: &Model) -> Vec<types::Rigid> {
    let nothing = <types::Rigid as bytemuck::Zeroable>::zeroed();
    let core = |(core, (nodes, blocks)): (&Core, &(Range<usize>, Range<usize>))| types::Rigid {
        frame: core.frame as u32,
        node_first: nodes.start as u32,
        node_count: nodes.len() as u32,
        block_first: blocks.start as u32,
        block_count: blocks.len() as u32,
        slot_first: model.blocks.slots.get(blocks.start).copied().unwrap_or_default(),
        hinge: core.hinge.as_vec3().to_array(),
        ..nothing
    };
    let cores = model.cores.iter().zip(&model.blocks.cores).map(core);
    cores.chain(model.tool_frame.map(|_| nothing)).collect()
}

/// A device array with these contents, or one of zeros that nobody reads.
fn upload_or_nothing<T: bytemuck::Pod>(context: &Arc<Context>, name: &str, data: &[T]) -> Result<Buffer> {
    if data.is_empty() { zeros::<T>(context, name, 1) } else { upload(context, name, data) }
}
