//! The solver's passes one at a time, each a case of the harness; arrays go from one to the next as in the step.

use bytemuck::Zeroable;
use palpate::gpu::Size;
use palpate::stages::args;
use palpate::stages::types::{Contact, Report, Solve};

use crate::harness::{Case, case, context};
use crate::system::System;

/// The change of velocity that solve/apply takes.
#[derive(Clone, Copy, PartialEq)]
pub enum Change {
    Solution = 0,
    Preconditioned = 1,
}

/// A system and the solver's arrays, named as the kernels name them.
pub struct Passes {
    pub system: System,
    /// Variants with contacts, with a tool, with friction.
    pub contact: bool,
    pub tool: bool,
    pub friction: bool,
    pub element_forces: Vec<[f32; 4]>,
    pub contact_forces: Vec<[f32; 4]>,
    pub leftover: Vec<[f32; 4]>,
    pub rhs: Vec<[f32; 4]>,
    pub inverse: Vec<[f32; 4]>,
    pub solution: Vec<[f32; 4]>,
    pub residual: Vec<[f32; 4]>,
    pub preconditioned: Vec<[f32; 4]>,
    pub direction: Vec<[f32; 4]>,
    pub direction_image: Vec<[f32; 4]>,
    pub image: Vec<[f32; 4]>,
    pub partials: Vec<[f32; 2]>,
    pub dots: Vec<[f32; 2]>,
    pub state: Solve,
    pub args: Vec<u32>,
    pub report: Report,
    pub core_changes: Vec<f32>,
}

/// What no pass writes by chance; what is still there was not written.
pub const UNTOUCHED: u32 = 77_777;

impl Passes {
    /// Before a first step: nothing left over, no solution.
    pub fn new(system: System) -> Passes {
        let nodes = system.model.node_rest.len();
        let zeros = vec![[0.0f32; 4]; nodes];
        Passes {
            contact: system.counts.contacts > 0,
            tool: system.twin.tool.is_some(),
            friction: system.twin.friction.is_some(),
            element_forces: system.element_forces.clone(),
            contact_forces: vec![],
            leftover: zeros.clone(),
            rhs: zeros.clone(),
            inverse: vec![[0.0; 4]; 2 * nodes],
            solution: zeros.clone(),
            residual: zeros.clone(),
            preconditioned: zeros.clone(),
            direction: zeros.clone(),
            direction_image: zeros.clone(),
            image: zeros,
            partials: vec![],
            dots: vec![],
            state: Solve::zeroed(),
            args: vec![UNTOUCHED; args::WORDS],
            report: Report::zeroed(),
            core_changes: vec![],
            system,
        }
    }

    /// Dynamic cores.
    fn cores(&self) -> u32 {
        self.system.model.cores.len() as u32
    }

    pub fn nodes(&self) -> usize {
        self.system.model.node_rest.len()
    }

    pub fn tetrahedra(&self) -> usize {
        self.system.model.tetrahedra.len()
    }

    /// Workgroups of the kernels that sum over nodes.
    pub fn groups(&self) -> usize {
        self.nodes().div_ceil(context().reduce_size() as usize)
    }

    fn kernel(&self, name: &str) -> Case {
        case(name).constant("NODES", self.nodes() as u32)
    }

    pub fn assemble(&mut self) {
        let (s, nodes) = (&self.system, self.nodes());
        let outcome = self
            .kernel("solve/assemble")
            .size(Size::Reduce)
            .constant("CONTACT", self.contact)
            .constant("FRICTION", self.friction)
            .input("params", &[s.params])
            .input("node_damping", &s.model.node_damping)
            .input("node_info", &s.model.node_info)
            .input("node_rest", &s.model.node_rest)
            .input("velocity", &s.velocity)
            .input("node_elements", &s.node_elements)
            .input("element_forces", &s.element_forces)
            .input("gradients", &s.gradients)
            .input("node_entries", &s.node_entries)
            .input("sorted", &s.sorted)
            .input("contacts", &s.contacts)
            .input("leftover", &self.leftover)
            .output::<[f32; 4]>("rhs", nodes)
            .output::<[f32; 4]>("preconditioned", nodes)
            .output::<[f32; 4]>("inverse", 2 * nodes)
            .output::<[f32; 2]>("partials", self.groups())
            .elements(nodes)
            .run();
        self.rhs = outcome.get("rhs");
        self.preconditioned = outcome.get("preconditioned");
        self.inverse = outcome.get("inverse");
        self.partials = outcome.get("partials");
    }

    pub fn apply(&mut self, change: Change) {
        let (s, tetrahedra) = (&self.system, self.tetrahedra());
        let vector = if change == Change::Solution { &self.solution } else { &self.preconditioned };
        let contacts = if self.contact { s.contacts.len() } else { 0 };
        let outcome = case("solve/apply")
            .constant("TETRAHEDRA", tetrahedra as u32)
            .constant("CONTACT", self.contact)
            .constant("FRICTION", self.friction)
            .input("params", &[s.params])
            .input("tetrahedra", &s.model.tetrahedra)
            .input("gradients", &s.gradients)
            .input("change", vector)
            .input("counts", &[s.counts])
            .input("contacts", &s.contacts)
            .input("entry_nodes", &s.entry_nodes)
            .input("entry_weights", &s.entry_weights)
            .input("solve", &[self.state])
            .output::<[f32; 4]>("element_forces", 4 * tetrahedra)
            .output::<[f32; 4]>("contact_forces", contacts)
            .push(&(change as u32))
            .elements(tetrahedra + contacts)
            .run();
        self.element_forces = outcome.get("element_forces");
        self.element_forces.extend([[0.0; 4]; 4]);
        self.contact_forces = outcome.get("contact_forces");
    }

    /// `mode` as in the kernel's header; what the inner products are taken with follows from it.
    pub fn gather(&mut self, mode: u32) {
        let (s, nodes) = (&self.system, self.nodes());
        let (change, first, second) = match mode {
            1 => (&self.preconditioned, &self.preconditioned, &self.residual),
            _ => (&self.solution, &self.preconditioned, &self.rhs),
        };
        let outcome = self
            .kernel("solve/gather")
            .size(Size::Reduce)
            .constant("CONTACT", self.contact)
            .constant("MODE", mode)
            .input("params", &[s.params])
            .input("node_damping", &s.model.node_damping)
            .input("node_info", &s.model.node_info)
            .input("node_rest", &s.model.node_rest)
            .input("node_elements", &s.node_elements)
            .input("element_forces", &self.element_forces)
            .input("node_entries", &s.node_entries)
            .input("sorted", &s.sorted)
            .input("contact_forces", &self.contact_forces)
            .input("change", change)
            .input("first", first)
            .input("second", second)
            .input("inverse", &self.inverse)
            .output::<[f32; 4]>("image", nodes)
            .output::<[f32; 2]>("dots", self.groups())
            .elements(nodes)
            .run();
        self.image = outcome.get("image");
        self.dots = outcome.get("dots");
    }

    pub fn start(&mut self) {
        let s = &self.system;
        let outcome = self
            .kernel("solve/start")
            .size(Size::Reduce)
            .constant("TETRAHEDRA", self.tetrahedra() as u32)
            .constant("CONTACT", self.contact)
            .constant("FRICTION", self.friction)
            .constant("TOOL", self.tool)
            .constant("PARTIALS", self.partials.len() as u32)
            .constant("CORES", self.cores())
            .constant("GROUP", context().group_size())
            .input("params", &[s.params])
            .input("partials", &self.partials)
            .input("dots", &self.dots)
            .input("counts", &[s.counts])
            .input("contacts", &s.contacts)
            .input("contact_forces", &self.contact_forces)
            .input("frames", &s.frames)
            .input("node_rest", &s.model.node_rest)
            .input("core_nodes", &s.core_nodes)
            .input("rhs", &self.rhs)
            .input("inverse", &self.inverse)
            .input("image", &self.image)
            .inout("solve", &[self.state])
            .inout("cores", &s.cores)
            .partial("args", &self.args)
            .groups(1)
            .run();
        self.state = outcome.get("solve")[0];
        self.system.cores = outcome.get("cores");
        self.args = outcome.get("args");
    }

    pub fn begin(&mut self) {
        let nodes = self.nodes();
        let outcome = self
            .kernel("solve/begin")
            .constant("CORES", self.cores())
            .input("solve", &[self.state])
            .input("rhs", &self.rhs)
            .input("image", &self.image)
            .input("inverse", &self.inverse)
            .input("frames", &self.system.frames)
            .input("cores", &self.system.cores)
            .input("node_info", &self.system.model.node_info)
            .input("node_rest", &self.system.model.node_rest)
            .inout("solution", &self.solution)
            .output::<[f32; 4]>("residual", nodes)
            .output::<[f32; 4]>("preconditioned", nodes)
            .output::<[f32; 4]>("direction", nodes)
            .output::<[f32; 4]>("direction_image", nodes)
            .elements(nodes)
            .run();
        self.solution = outcome.get("solution");
        self.residual = outcome.get("residual");
        self.preconditioned = outcome.get("preconditioned");
        self.direction = outcome.get("direction");
        self.direction_image = outcome.get("direction_image");
    }

    pub fn scalars(&mut self) {
        let s = &self.system;
        let outcome = case("solve/scalars")
            .size(Size::Reduce)
            .constant("CONTACT", self.contact)
            .constant("FRICTION", self.friction)
            .constant("TOOL", self.tool)
            .constant("PARTIALS", self.dots.len() as u32)
            .constant("CORES", self.cores())
            .input("params", &[s.params])
            .input("dots", &self.dots)
            .input("counts", &[s.counts])
            .input("contacts", &s.contacts)
            .input("contact_forces", &self.contact_forces)
            .input("frames", &s.frames)
            .input("node_rest", &s.model.node_rest)
            .input("core_nodes", &s.core_nodes)
            .input("image", &self.image)
            .inout("solve", &[self.state])
            .inout("cores", &s.cores)
            .partial("args", &self.args)
            .groups(1)
            .run();
        self.state = outcome.get("solve")[0];
        self.system.cores = outcome.get("cores");
        self.args = outcome.get("args");
    }

    pub fn update(&mut self) {
        let outcome = self
            .kernel("solve/update")
            .constant("CORES", self.cores())
            .input("solve", &[self.state])
            .input("image", &self.image)
            .input("inverse", &self.inverse)
            .input("frames", &self.system.frames)
            .input("cores", &self.system.cores)
            .input("node_info", &self.system.model.node_info)
            .input("node_rest", &self.system.model.node_rest)
            .inout("solution", &self.solution)
            .inout("residual", &self.residual)
            .inout("preconditioned", &self.preconditioned)
            .inout("direction", &self.direction)
            .inout("direction_image", &self.direction_image)
            .elements(self.nodes())
            .run();
        self.solution = outcome.get("solution");
        self.residual = outcome.get("residual");
        self.preconditioned = outcome.get("preconditioned");
        self.direction = outcome.get("direction");
        self.direction_image = outcome.get("direction_image");
    }

    pub fn conclude(&mut self) {
        let s = &self.system;
        let outcome = self
            .kernel("solve/conclude")
            .size(Size::Reduce)
            .constant("CONTACT", self.contact)
            .constant("FRICTION", self.friction)
            .constant("TOOL", self.tool)
            .constant("PARTIALS", self.dots.len() as u32)
            .constant("CORES", self.cores())
            .constant("GROUP", context().group_size())
            .input("params", &[s.params])
            .input("dots", &self.dots)
            .inout("counts", &[s.counts])
            .inout("contacts", &s.contacts)
            .input("contact_forces", &self.contact_forces)
            .input("frames", &s.frames)
            .input("node_rest", &s.model.node_rest)
            .input("core_nodes", &s.core_nodes)
            .input("image", &self.image)
            .inout("solve", &[self.state])
            .inout("cores", &s.cores)
            .partial("args", &self.args)
            .partial("report", &[self.report])
            .partial("core_changes", &vec![0.0f32; 6 * s.cores.len()])
            .groups(1)
            .run();
        self.state = outcome.get("solve")[0];
        self.system.cores = outcome.get("cores");
        self.core_changes = outcome.get("core_changes");
        self.args = outcome.get("args");
        self.report = outcome.get("report")[0];
        self.system.counts = outcome.get("counts")[0];
        self.system.contacts = outcome.get::<Contact>("contacts");
    }

    pub fn commit(&mut self) {
        let s = &self.system;
        let outcome = self
            .kernel("solve/commit")
            .constant("CORES", self.cores())
            .input("params", &[s.params])
            .input("frames", &s.frames)
            .input("node_info", &s.model.node_info)
            .input("solution", &self.solution)
            .input("rhs", &self.rhs)
            .input("image", &self.image)
            .input("node_rest", &s.model.node_rest)
            .input("cores", &s.cores)
            .inout("velocity", &s.velocity)
            .inout("displacement", &s.displacement)
            .partial("leftover", &self.leftover)
            .elements(self.nodes())
            .run();
        self.leftover = outcome.get("leftover");
        self.system.velocity = outcome.get("velocity");
        self.system.displacement = outcome.get("displacement");
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

    /// Everything before the first iteration.
    pub fn record_start(&mut self) {
        self.assemble();
        self.apply(Change::Solution);
        self.gather(0);
        self.start();
        self.begin();
    }

    /// Iterations until the device says to stop; at most `limit`.
    pub fn iterate(&mut self, limit: usize) {
        for _ in 0..limit {
            if self.args[3 * args::LOOP_ONE as usize] == 0 {
                return;
            }
            self.apply(Change::Preconditioned);
            self.gather(1);
            self.scalars();
            if self.args[3 * args::LOOP_UPDATE as usize] != 0 {
                self.update();
            }
        }
    }

    /// The recomputed residual and the verdict.
    pub fn record_end(&mut self) {
        self.apply(Change::Solution);
        self.gather(2);
        self.conclude();
    }

    /// The diagonal block's inverse times a vector, in f64.
    pub fn precondition(&self, node: usize, b: [f64; 3]) -> [f64; 3] {
        let [d, o] = [0, 1].map(|k| self.inverse[2 * node + k].map(f64::from));
        let rows = [[d[0], o[0], o[1]], [o[0], d[1], o[2]], [o[1], o[2], d[2]]];
        rows.map(|row| row[0] * b[0] + row[1] * b[1] + row[2] * b[2])
    }
}
