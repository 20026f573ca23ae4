//! Solve stage, after the contact and the elastic stage of a step: solves the linear system A x = b of implicit Euler
//! for the change x of velocities and twists, by preconditioned conjugate gradients with a single reduction
//! (Chronopoulos and Gear 1989); the GPU itself decides when to stop. Nodes come in blocks, each of which one workgroup
//! works on. The rigid bodies are the tool and the dynamic cores, which are rigid bodies that forces move and that have
//! nodes attached to them; a group is all cores that joints connect with each other. In the names below,
//! `operator_product` is the product A p with a vector p, `carried_residual` the residual b - A x that a step adds to
//! the right-hand side of the next, and `restricted` means multiplied by P^T, the restriction to the preconditioner's
//! coarse space (a few motions of each block).

mod record;
#[cfg(test)]
mod tests;

use crate::shaders;
use std::sync::Arc;

use super::contact::Touch;
use super::edges::Edges;
use super::loads::LoadArrays;
use super::model::Model;
use super::supports::SupportArrays;
use super::{array, count, gap, upload, upload_or_nothing, zeros};
use crate::Result;
use crate::gpu::{Buffer, Const, Context, Kernel, Memory, Size};

/// The quaternion x y z w of no rotation.
const UNTURNED: [f32; 4] = [0.0, 0.0, 0.0, 1.0];

/// Kernels and vectors of the solver; a vector has a vec4 per node.
pub struct Solve {
    assemble: Kernel,
    operator: Operator,
    contact_product: Kernel,
    contact_iteration: Kernel,
    patch_product: Option<Kernel>,
    gather_warm_start: Vec<Variant>,
    gather_loop: Vec<Variant>,
    gather_final: Vec<Variant>,
    coarse: Option<CoarseKernels>,
    /// Present where there are dynamic cores.
    cores: Option<Kernel>,
    first_residual: Kernel,
    first_iterate: Kernel,
    /// One variant per role (see [`Variant`]); the first variant also writes the scalars of the iteration.
    update: Vec<Variant>,
    conclude: Kernel,
    commit: Kernel,
    /// The contact arrays, where there can be contacts.
    touch: Option<Touch>,
    /// The arrays of supports, where supports hold nodes or reactions are reported.
    pub supports: Option<SupportArrays>,
    /// The arrays of loads, where there are any.
    pub loads: Option<LoadArrays>,
    block_count: u32,
    rigid_count: usize,
    core_count: usize,
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
    restricted_product: Buffer,
    restricted_residual: Buffer,
    restricted_direction: Both,
    coarse_rhs: Buffer,
    coarse_product: Buffer,
    coarse_dots: Buffer,
    pub(super) trend: Trend,
    /// One [`shaders::Rigid`] per rigid body, the tool's last.
    pub rigids: Buffer,
    /// Two sets, each of one [`shaders::RigidIterate`] per rigid body; an iteration reads one set and writes the other.
    pub iterates: Buffer,
    /// `CORE_NUMBERS` floats per dynamic core, used while the inverse of the core's group is computed.
    rigid_blocks: Buffer,
    /// Per group of cores, and for the tool: the inverse of the diagonal block of A for their twists (linear and
    /// angular velocities), row by row.
    rigid_inverses: Buffer,
    /// Per dynamic core: the joints that act on it, each as twice the joint's index, plus 1 where the core is the
    /// joint's second core.
    joint_sides: Buffer,
    iterations: Buffer,
    /// Six numbers per dynamic core, read by the host: the change of its twist.
    pub core_changes: Buffer,
    /// State of the solver, one [`shaders::Solve`].
    pub state: Buffer,
    pub(super) rhs: Buffer,
    carried_residual: Buffer,
    inverse: Buffer,
    /// Per node two vec4: its diagonal block of A without the contacts' part; empty without a coarse space, or without
    /// contacts and supports.
    blocks_without_contacts: Buffer,
    /// Change of velocity of the nodes; the next step's iterations start from it and from the trend.
    pub solution: Buffer,
    residual: Both,
    preconditioned: Both,
    direction: Both,
    direction_product: Both,
    pub(super) operator_product: Buffer,
    partials: Buffer,
    dots: Buffer,
    projections: Buffer,
}

/// Two copies of an array, called sets 0 and 1, of which an iteration reads one and writes the other. `now` and `next`
/// are the same two buffers, under the names by which kernels read them and write them.
struct Both {
    now: [Buffer; 2],
    next: [Buffer; 2],
}

impl Both {
    fn new(sets: [Buffer; 2], now: &'static [&'static str], next: &'static [&'static str]) -> Both {
        Both { now: sets.each_ref().map(|set| set.known_as(now)), next: sets.map(|set| set.known_as(next)) }
    }

    /// The copy that is read by an iteration that reads this set.
    fn now(&self, set: u32) -> &Buffer {
        &self.now[set as usize]
    }

    /// The other copy, which is written by the iteration that reads this set.
    fn next(&self, set: u32) -> &Buffer {
        &self.next[1 - set as usize]
    }
}

/// The second vector of the warm start, beside the solution: the difference of the last two solutions; in solves of a step
/// after its first, minus the last step's solution. And what its operator product leads to.
pub(super) struct Trend {
    pub(super) nodes: Buffer,
    /// As `iterates`, with this vector as x in both sets.
    pub(super) rigids: Buffer,
    /// The second set of `direction_product`, which is free until the first iteration writes it.
    operator_product: Buffer,
    restricted_product: Buffer,
    coarse_product: Buffer,
    projections: Buffer,
    contact_forces: Buffer,
}

/// A kernel specialised for one role, which is the kind of rows of A that it works on: free nodes, nodes attached to
/// dynamic cores, or the tool (see shaders/shared/roles.glsl).
struct Variant {
    kernel: Kernel,
    /// Number of workgroups of the kernel.
    groups: u32,
    /// Index of the kernel's indirect arguments in the solver's loop (shaders/shared/args.glsl).
    args_index: u32,
}

/// The kernel of the coarse space, which multiplies restricted vectors by the inverse of the coarse matrix A_c = P^T A
/// P. Its two variants run outside the solver's loop: `warm_start` before the loop, `end` after it.
struct CoarseKernels {
    warm_start: Kernel,
    end: Kernel,
}

/// How the elements' part of the operator is applied.
enum Operator {
    /// By a kernel that computes the forces of each tetrahedron in each iteration.
    MatrixFree { element_product: Kernel },
    /// As a matrix.
    Assembled(Assembled),
}

/// The elements' part of the operator as rows of 3x3 blocks (see [`Edges`]), assembled once a solve.
struct Assembled {
    stiffness_blocks: Kernel,
    edge_count: u32,
    edges: Buffer,
    edge_elements: Buffer,
    /// As on the GPU in `block_nodes`, with the damping that the simulation began with.
    nodes: Vec<[u32; 4]>,
    block_nodes: Buffer,
    blocks: Buffer,
}

impl Assembled {
    fn new(context: &Arc<Context>, model: &Model) -> Result<Assembled> {
        let edges = Edges::of(model);
        let edge_count = edges.edges.len() as u32;
        let edge_count_c = ("EDGES", Const::Uint(edge_count));
        Ok(Assembled {
            stiffness_blocks: Kernel::new(context, "solve/stiffness_blocks", Size::Group, &[edge_count_c])?,
            edge_count,
            edges: upload_or_nothing(context, "edges", &edges.edges)?,
            edge_elements: upload_or_nothing(context, "edge_elements", &edges.elements)?,
            block_nodes: upload_or_nothing(context, "block_nodes", &edges.block_nodes)?,
            nodes: edges.block_nodes,
            blocks: upload_or_nothing(context, "stiffness_blocks", &edges.blocks)?,
        })
    }
}

impl Solve {
    /// Kernels and arrays for a model; `touch`: the contact arrays, if there can be contacts.
    pub fn new(context: &Arc<Context>, model: &Model, touch: Option<&Touch>) -> Result<Solve> {
        let (nodes, tetrahedra) = (model.node_rest.len(), model.tetrahedra.len());
        let (has_tool, is_coarse) = (model.tool_frame.is_some(), !model.coarse.bodies.is_empty());
        let block_count = model.blocks.blocks.len();
        let groups = block_count + usize::from(has_tool);
        let rigid_count = model.rigid_count();
        let nodes_c = ("NODES", count(nodes));
        let tetrahedra_c = ("TETRAHEDRA", count(tetrahedra));
        let contact = ("CONTACT", Const::Bool(touch.is_some()));
        let supports = SupportArrays::new(context, model)?;
        let is_supported = supports.is_some();
        let loads = LoadArrays::new(context, model)?;
        let loaded = ("LOADS", Const::Bool(loads.is_some()));
        let supported = ("SUPPORTS", Const::Bool(is_supported));
        let friction = ("FRICTION", Const::Bool(model.friction[0] > 0.0));
        let tool = ("TOOL", Const::Bool(has_tool));
        let held = ("HELD", count(model.tool_cores.len()));
        let tools = ("TOOLS", count(model.tool_count().max(1)));
        let coarse = ("COARSE", Const::Bool(is_coarse));
        let blocks = ("BLOCKS", count(block_count));
        let partials = ("PARTIALS", count(groups));
        let rigids = ("RIGIDS", count(rigid_count));
        let group = ("GROUP", context.group_size().into());
        let joints = ("JOINTS", Const::Bool(!model.joints.is_empty()));
        let widest = model.cores.iter().map(|core| core.group.len()).max().unwrap_or(1);
        let (rigids_at_rest, inverse_numbers) = rigids_of(model);
        let reduce = |name: &str, constants: &[(&str, Const)]| Kernel::new(context, name, Size::Reduce, constants);
        // Each role that occurs in the model: its number, its first block, its number of workgroups, the index of its
        // indirect arguments.
        let (free, attached) = (model.blocks.free, block_count - model.blocks.free);
        let roles = [
            (shaders::FREE_NODES, 0, free, shaders::ARGS_LOOP_FREE),
            (shaders::ATTACHED_NODES, free, attached, shaders::ARGS_LOOP_ATTACHED),
            (shaders::TOOL_ROWS, 0, usize::from(has_tool), shaders::ARGS_LOOP_TOOL),
        ];
        let roles: Vec<_> = roles.into_iter().filter(|(_, _, groups, _)| *groups > 0).collect();
        let variants = |name: &str, constants: &[(&str, Const)]| -> Result<Vec<Variant>> {
            let variant = |(role, first, groups, args_index): &(u32, usize, usize, u32)| {
                let own =
                    [("ROLE", Const::Uint(*role)), ("FIRST", count(*first)), ("LEADS", (*role == roles[0].0).into())];
                let own = if name == "solve/update" { &own[..] } else { &own[..2] };
                let kernel = reduce(name, &[constants, own].concat())?;
                Ok(Variant { kernel, groups: *groups as u32, args_index: *args_index })
            };
            roles.iter().map(variant).collect()
        };
        let operator = if model.assembles {
            Operator::Assembled(Assembled::new(context, model)?)
        } else {
            let element_product = Kernel::new(context, "solve/element_product", Size::Group, &[tetrahedra_c])?;
            Operator::MatrixFree { element_product }
        };
        let is_assembled = ("ASSEMBLED", model.assembles.into());
        let gather = |mode: u32| {
            variants(
                "solve/gather",
                &[
                    blocks,
                    contact,
                    friction,
                    coarse,
                    rigids,
                    joints,
                    held,
                    supported,
                    ("MODE", mode.into()),
                    is_assembled,
                ],
            )
        };
        let patch_count = model.patches.count();
        let patches_c = ("PATCHES", count(patch_count));
        let patch_product = || Kernel::new(context, "solve/patch_product", Size::Group, &[patches_c, tetrahedra_c]);
        let coarse_kernel = |warm_start: bool| reduce("solve/coarse", &[("WARM_START", warm_start.into())]);
        let coarse_kernels = || Ok(CoarseKernels { warm_start: coarse_kernel(true)?, end: coarse_kernel(false)? });
        let vector = |name: &str| zeros::<[f32; 4]>(context, name, nodes);
        let both = |now: &'static [&'static str], next: &'static [&'static str]| {
            Ok(Both::new([vector(now[0])?, vector(now[0])?], now, next))
        };
        let block_vector = |name: &str| zeros::<[f32; 4]>(context, name, 3 * groups);
        let coarse_vector = |name: &str| zeros::<[f32; 4]>(context, name, if is_coarse { 3 * groups } else { 0 });
        let directions = [coarse_vector("restricted_direction")?, coarse_vector("restricted_direction")?];
        let contact_capacity = touch.map_or(0, |touch| touch.contact_forces.bytes() as usize / size_of::<[f32; 4]>());
        let all = 2 * rigid_count;
        let direction_product = both(&["direction_product"], &["next_direction_product"])?;
        let trend_product = direction_product.now[1].known_as(&["trend_product", "operator_product"]);
        Ok(Solve {
            assemble: reduce(
                "solve/assemble",
                &[
                    contact,
                    friction,
                    coarse,
                    joints,
                    held,
                    supported,
                    loaded,
                    nodes_c,
                    tetrahedra_c,
                    ("PATCHES", (patch_count > 0).into()),
                ],
            )?,
            operator,
            contact_product: Kernel::new(context, "solve/contact_product", Size::Group, &[friction, tool, rigids])?,
            contact_iteration: Kernel::new(context, "solve/contact_iteration", Size::Group, &[friction, tool, rigids])?,
            patch_product: (patch_count > 0).then(patch_product).transpose()?,
            gather_warm_start: gather(shaders::GATHER_WARM_START)?,
            gather_loop: gather(shaders::GATHER_LOOP)?,
            gather_final: gather(shaders::GATHER_END)?,
            coarse: is_coarse.then(coarse_kernels).transpose()?,
            cores: (!model.cores.is_empty())
                .then(|| reduce("solve/cores", &[joints, held, loaded, nodes_c]))
                .transpose()?,
            first_residual: reduce(
                "solve/first_residual",
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
                ],
            )?,
            first_iterate: reduce("solve/first_iterate", &[contact, coarse, supported])?,
            update: variants(
                "solve/update",
                &[contact, blocks, coarse, supported, partials, rigids, ("WIDEST", count(widest))],
            )?,
            conclude: reduce(
                "solve/conclude",
                &[
                    nodes_c,
                    contact,
                    tool,
                    tools,
                    coarse,
                    blocks,
                    rigids,
                    group,
                    ("SKIN_PARTS", count(gap::part_count(model))),
                ],
            )?,
            commit: Kernel::new(
                context,
                "solve/commit",
                Size::Group,
                &[nodes_c, rigids, supported, ("NEWTON", Const::Bool(model.newton > 1))],
            )?,
            touch: touch.cloned(),
            supports,
            loads,
            block_count: block_count as u32,
            rigid_count,
            core_count: model.cores.len(),
            blocks: upload_or_nothing(context, "blocks", &model.blocks.blocks)?,
            block_nodes: upload_or_nothing(context, "block_nodes", &model.blocks.nodes)?,
            block_places: upload_or_nothing(context, "block_places", &model.blocks.places)?,
            block_moments: upload_or_nothing(context, "block_moments", &model.blocks.moments)?,
            block_rotations: upload(context, "block_rotations", &vec![UNTURNED; block_count.max(1)])?,
            block_turns: upload(context, "block_turns", &vec![UNTURNED; block_count.max(1)])?,
            coarse_blocks: upload_or_nothing(context, "coarse_blocks", &model.coarse.blocks)?,
            coarse_inverse: upload_or_nothing(context, "coarse_inverse", &model.coarse.inverse)?,
            coarse_scales: upload_or_nothing(context, "coarse_scales", &model.coarse.scales)?,
            restricted_rhs: block_vector("restricted_rhs")?,
            restricted_product: block_vector("restricted_product")?,
            restricted_residual: coarse_vector("restricted_residual")?
                .known_as(&["restricted_residual", "restricted_rhs"]),
            restricted_direction: Both::new(directions, &["restricted_direction"], &["next_restricted_direction"]),
            coarse_rhs: coarse_vector("coarse_rhs")?,
            coarse_product: coarse_vector("coarse_product")?,
            coarse_dots: array::<f32>(context, "coarse_dots", if is_coarse { groups } else { 0 })?,
            rigids: upload_or_nothing(context, "rigids", &rigids_at_rest)?,
            rigid_blocks: array::<f32>(context, "rigid_blocks", shaders::CORE_NUMBERS as usize * model.cores.len())?,
            rigid_inverses: array::<f32>(context, "rigid_inverses", inverse_numbers)?,
            joint_sides: upload_or_nothing(context, "joint_sides", &sides_of(model).concat())?,
            iterates: zeros::<shaders::RigidIterate>(context, "iterates", all)?,
            iterations: zeros::<shaders::Iteration>(context, "iterations", 2)?,
            core_changes: Buffer::new(context, "core_changes", 24 * model.cores.len().max(1) as u64, Memory::Readback)?,
            state: zeros::<shaders::Solve>(context, "solve", 1)?,
            rhs: vector("rhs")?.known_as(&["rhs", "residual_or_rhs"]),
            carried_residual: vector("carried_residual")?,
            inverse: zeros::<[f32; 4]>(context, "inverse", 2 * nodes)?,
            blocks_without_contacts: array::<[f32; 4]>(
                context,
                "blocks_without_contacts",
                if is_coarse && (touch.is_some() || is_supported) { 2 * nodes } else { 0 },
            )?,
            solution: vector("solution")?.known_as(&["solution", "change"]),
            residual: both(&["residual", "residual_or_rhs"], &["next_residual"])?,
            preconditioned: both(&["preconditioned", "change"], &["next_preconditioned"])?,
            direction: both(&["direction"], &["next_direction"])?,
            direction_product,
            operator_product: vector("operator_product")?,
            partials: array::<[f32; 2]>(context, "partials", groups)?,
            dots: array::<[f32; 4]>(context, "dots", groups.div_ceil(2))?,
            projections: array::<[f32; 4]>(context, "projections", groups)?,
            trend: Trend {
                nodes: vector("trend")?.known_as(&["trend", "change"]),
                rigids: zeros::<shaders::RigidIterate>(context, "rigid_trends", all)?
                    .known_as(&["rigid_trends", "iterates"]),
                operator_product: trend_product,
                restricted_product: block_vector("restricted_trend")?
                    .known_as(&["restricted_trend", "restricted_product"]),
                coarse_product: coarse_vector("coarse_trend")?,
                projections: array::<[f32; 4]>(context, "trend_projections", groups)?
                    .known_as(&["trend_projections", "projections"]),
                contact_forces: array::<[f32; 4]>(context, "trend_contact_forces", contact_capacity)?
                    .known_as(&["contact_forces"]),
            },
        })
    }
}

impl Solve {
    fn assembled(&self) -> Option<&Assembled> {
        match &self.operator {
            Operator::Assembled(assembled) => Some(assembled),
            Operator::MatrixFree { .. } => None,
        }
    }

    /// Writes the damping and the coarse space of a model of the same bodies to the GPU.
    pub fn refresh(&self, model: &Model) -> Result<()> {
        self.block_nodes.write(&model.blocks.nodes)?;
        if let Some(assembled) = self.assembled() {
            let damped =
                assembled.nodes.iter().zip(&model.blocks.nodes).map(|(row, node)| [row[0], row[1], row[2], node[3]]);
            assembled.block_nodes.write(&damped.collect::<Vec<_>>())?;
        }
        self.coarse_inverse.write(&model.coarse.inverse)?;
        self.coarse_scales.write(&model.coarse.scales)
    }

    /// The arrays that a step leaves for the next: the solution, the trend and the carried residual, of nodes and of
    /// rigid bodies, the solver's state, and the rotations of the blocks.
    pub fn state(&self) -> [&Buffer; 8] {
        let of_nodes = [&self.solution, &self.trend.nodes, &self.carried_residual];
        let of_rigids = [&self.rigids, &self.iterates, &self.trend.rigids];
        let ([a, b, c], [d, e, f]) = (of_nodes, of_rigids);
        [a, b, c, d, e, f, &self.state, &self.block_rotations]
    }
}

/// The dynamic cores and the tool at rest, and the number of entries of the array `rigid_inverses`.
fn rigids_of(model: &Model) -> (Vec<shaders::Rigid>, usize) {
    let nothing = shaders::Rigid { parent: shaders::NONE, ..bytemuck::Zeroable::zeroed() };
    let (mut joint_first, mut numbers) = (0, 0);
    let mut rigids = Vec::new();
    for (index, (core, sides)) in model.cores.iter().zip(sides_of(model)).enumerate() {
        let (nodes, blocks) = &model.blocks.cores[index];
        rigids.push(shaders::Rigid {
            frame: core.frame as u32,
            node_first: nodes.start as u32,
            node_count: nodes.len() as u32,
            block_first: blocks.start as u32,
            block_count: blocks.len() as u32,
            first_coarse_index: model.blocks.coarse_indices.get(blocks.start).copied().unwrap_or_default(),
            hinge: core.hinge.as_vec3().to_array(),
            joint_first,
            joint_count: sides.len() as u32,
            group_first: core.group.start as u32,
            group_count: core.group.len() as u32,
            parent: core.parent.map_or(shaders::NONE, |parent| parent as u32),
            inverse_first: numbers as u32,
            ..nothing
        });
        joint_first += sides.len() as u32;
        if index + 1 == core.group.end {
            numbers += 36 * core.group.len().pow(2);
        }
    }
    if model.tool_frame.is_some() {
        let (group_first, inverse_first) = (rigids.len() as u32, numbers as u32);
        rigids.push(shaders::Rigid { group_first, group_count: 1, inverse_first, ..nothing });
        numbers += 36;
    }
    (rigids, numbers)
}

/// Per dynamic core: the joints that act on it, each as twice the joint's index, plus 1 where the core is the joint's
/// second core.
fn sides_of(model: &Model) -> Vec<Vec<u32>> {
    let mut sides = vec![Vec::new(); model.cores.len()];
    for (index, joint) in model.joints.iter().enumerate() {
        for (side, core) in joint.cores.iter().enumerate() {
            core.iter().for_each(|core| sides[*core].push(2 * index as u32 + side as u32));
        }
    }
    sides
}
