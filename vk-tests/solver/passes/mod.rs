//! Runs the solver's passes one at a time in the test harness; as in a step, each pass reads the arrays that earlier
//! passes wrote. A block is the set of nodes that one workgroup owns. A rigid body is a dynamic core (a rigid body
//! inside a soft one, to which nodes are attached) or the tool (which the haptic device leads). The oracle is the f64
//! reference implementation.

mod kernels;
mod side_by_side;

use bytemuck::Zeroable;
use palpate::internal::gpu::Size;
use palpate::internal::shaders;
use palpate::internal::shaders::{Iteration, Joint, NONE, Report, Rigid, RigidIterate, Solve, Supported};
use palpate::internal::stages::ARGS_WORDS;
use palpate::internal::stages::edges::Edges;

pub use kernels::{SKIN_PARTS, TOOLS};

use crate::harness::case;
use crate::solver::system::System;

/// The change of velocity that is multiplied by the operator A: the solution before the iterations, the trend (difference
/// of the last two solutions), the preconditioned residual, or the solution after the iterations.
#[derive(Clone, Copy, PartialEq)]
pub enum Change {
    Start,
    Trend,
    Preconditioned,
    End,
}

/// A linear system to be solved, and the solver's arrays, which have the names that the kernels give them.
pub struct Passes {
    pub system: System,
    /// Which variants of the kernels run: `contact`, `tool`, `friction` and `coarse` say whether there are contacts, a
    /// tool, friction, and a coarse space of the preconditioner.
    pub contact: bool,
    pub tool: bool,
    pub friction: bool,
    pub coarse: bool,
    /// Whether supports hold nodes, or reactions are summed.
    pub supports: bool,
    /// Workgroup size of the kernels whose lanes make sums together.
    pub size: Size,
    /// Whether the operator is assembled as a matrix, as a step does it, or applied tetrahedron by tetrahedron
    /// (matrix-free).
    pub assembled: bool,
    /// The edges of the tetrahedra, and the operator's rows.
    pub edges: Edges,
    /// Number of blocks that solve/first_residual and solve/conclude sum over: the model's number, unless a test makes
    /// up the inner products of its own blocks.
    pub block_count: usize,
    pub element_forces: Vec<[f32; 4]>,
    pub contact_forces: Vec<[f32; 4]>,
    pub carried_residual: Vec<[f32; 4]>,
    pub rhs: Vec<[f32; 4]>,
    pub inverse: Vec<[f32; 4]>,
    pub blocks_without_contacts: Vec<[f32; 4]>,
    /// The nodes with what supports leave to them, where `supports` is true.
    pub supported: Vec<Supported>,
    pub solution: Vec<[f32; 4]>,
    pub trend: Vec<[f32; 4]>,
    /// Residual. The kernels write two sets of iterates in turn; this vector and the next three belong to the newer
    /// set.
    pub residual: Vec<[f32; 4]>,
    pub preconditioned: Vec<[f32; 4]>,
    pub direction: Vec<[f32; 4]>,
    pub direction_product: Vec<[f32; 4]>,
    pub operator_product: Vec<[f32; 4]>,
    pub trend_product: Vec<[f32; 4]>,
    pub partials: Vec<[f32; 2]>,
    /// Two inner products of each block of nodes, then two of the tool.
    pub dots: Vec<[f32; 2]>,
    /// Inner products for the warm start, of each block of nodes: with the solution, and with the trend.
    pub projections: Vec<[f32; 4]>,
    pub trend_projections: Vec<[f32; 4]>,
    pub block_rotations: Vec<[f32; 4]>,
    pub block_turns: Vec<[f32; 4]>,
    pub restricted_rhs: Vec<[f32; 4]>,
    pub restricted_product: Vec<[f32; 4]>,
    pub restricted_trend: Vec<[f32; 4]>,
    pub restricted_residual: Vec<[f32; 4]>,
    /// P^T s, with the prolongation P from the coarse space, and s = A p for the search direction p.
    pub restricted_direction: Vec<[f32; 4]>,
    pub coarse_rhs: Vec<[f32; 4]>,
    pub coarse_product: Vec<[f32; 4]>,
    pub coarse_trend: Vec<[f32; 4]>,
    pub coarse_dots: Vec<f32>,
    /// The rigid bodies: the dynamic cores, then the tool.
    pub rigids: Vec<Rigid>,
    /// The joints between rigid cores, as the host writes them for the kernels.
    pub joints: Vec<Joint>,
    /// For each dynamic core, its joints: twice the joint's index, plus 0 if the core is the first of the joint's two
    /// cores and 1 if it is the second.
    pub joint_sides: Vec<u32>,
    /// For each group of rigid bodies that joints connect, the inverse of the group's diagonal block of A, row by row.
    pub rigid_inverses: Vec<f32>,
    /// Iterates of the rigid bodies, of the first set and then of the second.
    pub iterates: Vec<RigidIterate>,
    /// The trend of the rigid bodies, in both sets alike.
    pub rigid_trends: Vec<RigidIterate>,
    pub iterations: [Iteration; 2],
    pub state: Solve,
    pub args: Vec<u32>,
    pub report: Report,
    pub core_changes: Vec<f32>,
}

/// A value that no pass writes by chance: a word that still has it was not written.
pub const UNTOUCHED: u32 = 77_777;

impl Passes {
    /// The passes before a first step, with no residual and no solution from an earlier step.
    pub fn new(system: System) -> Passes {
        let model = &system.model;
        let (nodes, blocks, tool) = (model.node_rest.len(), model.blocks.blocks.len(), system.twin.tool.is_some());
        let zeros = vec![[0.0f32; 4]; nodes];
        let (rigids, inverse_numbers, joint_sides) = rigids(&system);
        // Rotations of the blocks as solve/assemble leaves them for bodies at rest.
        let turns = model.blocks.blocks.iter().map(|block| system.frames[block[2] as usize].rotation).collect();
        let modes = vec![[0.0; 4]; 3 * (blocks + usize::from(tool))];
        Passes {
            contact: system.counts.contacts > 0,
            tool,
            friction: system.twin.friction.is_some(),
            coarse: !model.coarse.bodies.is_empty(),
            supports: !model.held.nodes.is_empty(),
            size: Size::Reduce,
            assembled: true,
            edges: Edges::of(model),
            block_count: blocks,
            element_forces: system.element_forces.clone(),
            contact_forces: vec![],
            carried_residual: zeros.clone(),
            rhs: zeros.clone(),
            inverse: vec![[0.0; 4]; 2 * nodes],
            blocks_without_contacts: vec![[0.0; 4]; 2 * nodes],
            supported: (model.held.nodes.iter()).map(|left| Supported { left: *left, ..Supported::zeroed() }).collect(),
            solution: zeros.clone(),
            trend: zeros.clone(),
            residual: zeros.clone(),
            preconditioned: zeros.clone(),
            direction: zeros.clone(),
            direction_product: zeros.clone(),
            trend_product: zeros.clone(),
            operator_product: zeros,
            partials: vec![],
            dots: vec![],
            projections: vec![],
            trend_projections: vec![[0.0; 4]; blocks + usize::from(tool)],
            block_rotations: vec![[0.0, 0.0, 0.0, 1.0]; blocks],
            block_turns: turns,
            restricted_rhs: modes.clone(),
            restricted_product: modes.clone(),
            restricted_trend: modes.clone(),
            restricted_residual: modes,
            restricted_direction: vec![[0.0; 4]; 3 * blocks],
            coarse_rhs: vec![],
            coarse_product: vec![],
            coarse_trend: vec![],
            coarse_dots: vec![],
            iterates: vec![RigidIterate::zeroed(); 2 * rigids.len()],
            rigid_trends: vec![RigidIterate::zeroed(); 2 * rigids.len()],
            joints: vec![],
            joint_sides,
            rigid_inverses: vec![0.0; inverse_numbers],
            rigids,
            iterations: [Iteration::zeroed(); 2],
            state: Solve::zeroed(),
            args: vec![UNTOUCHED; ARGS_WORDS],
            report: Report::zeroed(),
            core_changes: vec![],
            system,
        }
    }

    pub fn nodes(&self) -> usize {
        self.system.model.node_rest.len()
    }

    pub fn tetrahedra(&self) -> usize {
        self.system.model.tetrahedra.len()
    }

    /// Number of blocks of nodes.
    pub fn blocks(&self) -> usize {
        self.system.model.blocks.blocks.len()
    }

    /// Number of iterations that the solver has done.
    pub fn iterations_done(&self) -> u32 {
        self.iterations[self.state.current as usize].count
    }

    /// The newest iterate of a core, or of the tool, which comes last.
    pub fn rigid(&mut self, index: usize) -> &mut RigidIterate {
        let first = self.state.current as usize * self.rigids.len();
        &mut self.iterates[first + index]
    }

    /// The newest iterate of the tool; zeros without a tool.
    pub fn tool_iterate(&self) -> RigidIterate {
        let now = self.state.current as usize * self.rigids.len() + self.rigids.len().wrapping_sub(1);
        if self.tool { self.iterates[now] } else { RigidIterate::zeroed() }
    }

    /// The newest iterate of the tool, in tests that have one.
    pub fn tool_iterate_mut(&mut self) -> &mut RigidIterate {
        self.rigid(self.rigids.len() - 1)
    }

    /// The tool's six rows of the operator product (A times the vector of the last pass), as solve/gather left them.
    pub fn tool_rows(&self) -> [f32; 6] {
        let Some([a, b, _]) = self.restricted_product.chunks(3).nth(self.blocks()) else { return [0.0; 6] };
        [a[0], a[1], a[2], a[3], b[0], b[1]]
    }

    /// Puts values at the nodes, and six values of each rigid body's newest iterate, into the order of the oracle's
    /// unknowns.
    pub fn unknowns(&self, nodes: &[[f32; 4]], six: impl Fn(&RigidIterate) -> [f32; 6]) -> Vec<f64> {
        let mut all = self.system.unknowns(nodes, &six(&self.tool_iterate()));
        let first = self.state.current as usize * self.rigids.len();
        for (index, at) in self.system.twin.unknowns().cores.iter().enumerate() {
            all[*at..at + 6].copy_from_slice(&six(&self.iterates[first + index]).map(f64::from));
        }
        all
    }

    /// Runs all passes before the first iteration.
    pub fn record_start(&mut self) {
        self.assemble();
        self.cores();
        self.apply(Change::Start);
        self.gather(0);
        self.apply(Change::Trend);
        self.gather_trend();
        if self.coarse {
            self.coarse(true);
        }
        self.start();
        self.begin();
    }

    /// From now on in this solve no contact is released, so that the iterations solve a linear system.
    pub fn keep_contacts(&mut self) {
        self.iterations[self.state.current as usize].releases = shaders::MAX_RELEASES;
    }

    /// Whether the kernels have ended the loop, by setting its indirect arguments to zero.
    fn has_ended(&self) -> bool {
        let args_indices = [shaders::ARGS_LOOP_FREE, shaders::ARGS_LOOP_ATTACHED, shaders::ARGS_LOOP_TOOL];
        args_indices.iter().all(|args_index| self.args[3 * *args_index as usize] == 0)
    }

    /// Runs iterations until the kernels end the loop, at most `limit`.
    pub fn iterate(&mut self, limit: usize) {
        for _ in 0..limit {
            if self.has_ended() {
                return;
            }
            self.apply(Change::Preconditioned);
            self.gather(1);
            self.update();
        }
    }

    /// Runs the passes that recompute the residual and decide whether the step is done, goes on, or has failed.
    pub fn record_end(&mut self) {
        self.apply(Change::End);
        self.gather(2);
        if self.coarse {
            self.coarse(false);
        }
        self.conclude();
    }

    pub fn wrench(&mut self) {
        let s = &self.system;
        let outcome = case("wrench/reduce")
            .size(Size::Reduce)
            .constant("FRICTION", self.friction)
            .input("params", &[s.params])
            .input("counts", &[s.counts])
            .input("contacts", &s.contacts)
            .input("contact_forces", &self.contact_forces)
            .partial("report", &[self.report])
            .groups(1)
            .run();
        self.report = outcome.get("report")[0];
    }

    /// Entry (i, k) of the inverse of a rigid body's 6x6 diagonal block of A, for a body without joints.
    pub fn rigid_inverse(&self, index: usize, i: usize, k: usize) -> f64 {
        f64::from(self.rigid_inverses[self.rigids[index].inverse_first as usize + 6 * i + k])
    }

    /// The inverse of a free node's 3x3 diagonal block of A times a vector, in f64. For a node attached to a dynamic
    /// core, `inverse` holds the block itself, by which the vector is multiplied instead.
    pub fn precondition(&self, node: usize, b: [f64; 3]) -> [f64; 3] {
        let [d, o] = [0, 1].map(|k| self.inverse[2 * node + k].map(f64::from));
        let rows = [[d[0], o[0], o[1]], [o[0], d[1], o[2]], [o[1], o[2], d[2]]];
        rows.map(|row| row[0] * b[0] + row[1] * b[1] + row[2] * b[2])
    }
}

/// Makes `rigids` and `joint_sides` of [`Passes`] from the model's blocks and joints. The number that is returned
/// between these two is the length of `rigid_inverses`.
fn rigids(system: &System) -> (Vec<Rigid>, usize, Vec<u32>) {
    let (model, blocks) = (&system.model, &system.model.blocks.blocks);
    let (mut rigids, mut numbers, mut sides) = (Vec::new(), 0, Vec::new());
    for (index, core) in model.cores.iter().enumerate() {
        let own: Vec<usize> = (0..blocks.len()).filter(|b| blocks[*b][3] == index as u32).collect();
        let first = own.first().copied().unwrap_or_default();
        let joint_first = sides.len() as u32;
        for (joint, side) in (0..2 * model.joints.len()).map(|k| (k / 2, k % 2)) {
            if model.joints[joint].cores[side] == Some(index) {
                sides.push((2 * joint + side) as u32);
            }
        }
        rigids.push(Rigid {
            frame: core.frame as u32,
            node_first: blocks[first][0],
            node_count: core.nodes.len() as u32,
            block_first: first as u32,
            block_count: own.len() as u32,
            first_coarse_index: model.blocks.coarse_indices[first],
            hinge: core.hinge.as_vec3().to_array(),
            joint_first,
            joint_count: sides.len() as u32 - joint_first,
            group_first: core.group.start as u32,
            group_count: core.group.len() as u32,
            parent: core.parent.map_or(NONE, |parent| parent as u32),
            inverse_first: numbers as u32,
            ..Rigid::zeroed()
        });
        if index + 1 == core.group.end {
            numbers += 36 * core.group.len() * core.group.len();
        }
    }
    if system.twin.tool.is_some() {
        let (group_first, inverse_first) = (rigids.len() as u32, numbers as u32);
        rigids.push(Rigid { frame: NONE, group_first, group_count: 1, parent: NONE, inverse_first, ..Rigid::zeroed() });
        numbers += 36;
    }
    (rigids, numbers, sides)
}
