//! Drivers of the solver's kernels (compute shaders) for tests. Each method of [`Passes`] runs one kernel in the test
//! harness and stores the arrays that the kernel wrote. A block is the set of nodes that one workgroup owns; a dynamic
//! core is a rigid body inside a soft one, to which nodes are attached and whose motion the solver finds.

use bytemuck::Zeroable;
use palpate::internal::gpu::Size;
use palpate::internal::shaders::{Contact, Iteration, RigidIterate, Supported};

use super::side_by_side::{FREE, Variant, merged, settled, unwritten};
use super::{Change, Passes};
use crate::harness::{Case, Outcome, case, context};
use crate::stage::flow::{fours, pairs};

type Quads = Vec<[f32; 4]>;

/// Number of parts of the bodies' skins (surface meshes). solve/conclude requests one workgroup of wrench/gap for each
/// part; wrench/gap measures the gap from the tool (the rigid body that the haptic device leads) to each part.
pub const SKIN_PARTS: u32 = 5;
/// Number of tools that solve/conclude is told of.
pub const TOOLS: u32 = 3;

impl Passes {
    fn reduce(&self, name: &str) -> Case {
        case(name).size(self.size).constant("COARSE", self.coarse)
    }

    /// A case of a kernel that restricts its equations to what supports leave to the nodes.
    fn restricted(&self, name: &str) -> Case {
        self.reduce(name).constant("SUPPORTS", self.supports)
    }

    /// The nodes as the kernels see their supports; a single one where nothing is held.
    fn supported(&self) -> Vec<Supported> {
        if self.supports { self.supported.clone() } else { vec![Supported::zeroed()] }
    }

    fn rigid_count(&self) -> u32 {
        self.rigids.len() as u32
    }

    /// Number of workgroups of solve/gather: one for each block of nodes, and one for the tool if there is one.
    fn groups(&self) -> usize {
        self.blocks() + usize::from(self.tool)
    }

    pub fn assemble(&mut self) {
        let (s, nodes, blocks) = (&self.system, self.nodes(), self.blocks());
        let outcome = self
            .restricted("solve/assemble")
            .constant("CONTACT", self.contact)
            .constant("FRICTION", self.friction)
            .input("params", &[s.params])
            .input("frames", &s.frames)
            .input("blocks", &s.model.blocks.blocks)
            .input("block_nodes", &s.model.blocks.nodes)
            .input("block_places", &s.model.blocks.places)
            .input("block_moments", &s.model.blocks.moments)
            .input("coarse_blocks", &s.model.coarse.blocks)
            .input("node_rest", &s.model.node_rest)
            .input("velocity", &s.velocity)
            .input("displacement", &s.displacement)
            .input("node_elements", &s.node_elements)
            .input("element_forces", &s.element_forces)
            .input("gradients", &s.gradients)
            // The kernel does not read this array, since no tetrahedra here share their volumetric strain (F-bar
            // patches).
            .input("patch_rows", &s.gradients)
            .input("node_entries", &pairs(&s.node_entries))
            .input("sorted", &pairs(&s.sorted))
            .input("contacts", &s.contacts)
            .input("carried_residual", &self.carried_residual)
            .input("rigids", &self.rigids)
            .partial("rhs", &unwritten::<[f32; 4]>(nodes))
            .partial("inverse", &unwritten::<[f32; 4]>(2 * nodes))
            .partial("blocks_without_contacts", &unwritten::<[f32; 4]>(2 * nodes))
            .output::<[f32; 2]>("partials", blocks)
            .output::<[f32; 4]>("restricted_rhs", 3 * blocks)
            .inout("block_rotations", &self.block_rotations)
            .output::<[f32; 4]>("block_turns", blocks)
            .input("coarse_scales", &s.model.coarse.scales)
            .constant("JOINTS", !self.joints.is_empty())
            .input("joints", &self.joints)
            .input("joint_sides", &self.joint_sides)
            .partial("supported", &self.supported())
            .groups(blocks)
            .run();
        let roles = self.roles();
        self.rhs = settled("rhs", outcome.get("rhs"), |i| roles[i].is_some());
        self.inverse = settled("inverse", outcome.get("inverse"), |i| roles[i / 2].is_some());
        self.supported = outcome.get("supported");
        let is_kept = |i: usize| (self.contact || self.supports) && self.coarse && roles[i / 2] == Some(FREE);
        self.blocks_without_contacts =
            settled("blocks_without_contacts", outcome.get("blocks_without_contacts"), is_kept);
        self.partials = outcome.get("partials");
        self.restricted_rhs = outcome.get("restricted_rhs");
        self.block_rotations = outcome.get("block_rotations");
        self.block_turns = outcome.get("block_turns");
    }

    /// Runs solve/cores where there are dynamic cores.
    pub fn cores(&mut self) {
        let (s, cores) = (&self.system, self.system.model.cores.len());
        if cores == 0 {
            return;
        }
        let outcome = case("solve/cores")
            .size(Size::Reduce)
            .constant("JOINTS", !self.joints.is_empty())
            .input("params", &[s.params])
            .input("frames", &s.frames)
            .input("block_nodes", &s.model.blocks.nodes)
            .input("node_rest", &s.model.node_rest)
            .input("rhs", &self.rhs)
            .input("inverse", &self.inverse)
            .input("restricted_rhs", &self.restricted_rhs)
            .input("joints", &self.joints)
            .input("joint_sides", &self.joint_sides)
            .inout("rigids", &self.rigids)
            .partial("rigid_blocks", &unwritten::<f32>(72 * cores))
            .partial("rigid_inverses", &self.rigid_inverses)
            .groups(cores)
            .run();
        self.rigids = outcome.get("rigids");
        self.rigid_inverses = outcome.get("rigid_inverses");
    }

    /// Runs solve/stiffness_blocks.
    fn assemble_operator(&mut self) {
        let (edges, gradients) = (&self.edges, &self.system.gradients);
        let count = edges.edges.len();
        let outcome = case("solve/stiffness_blocks")
            .constant("EDGES", count as u32)
            .input("edges", &edges.edges)
            .input("edge_elements", &edges.elements)
            .input("gradients", gradients)
            .partial("stiffness_blocks", &self.edges.blocks)
            .elements(count)
            .run();
        self.edges.blocks = outcome.get("stiffness_blocks");
    }

    /// Runs solve/stiffness_blocks or solve/element_product. With contacts it also runs solve/contact_iteration in an
    /// iteration, and solve/contact_product outside the iterations.
    pub fn apply(&mut self, change: Change) {
        if self.assembled {
            self.assemble_operator();
        } else {
            self.apply_elements(change);
        }
        self.apply_contacts(change);
    }

    fn apply_elements(&mut self, change: Change) {
        let (s, tetrahedra) = (&self.system, self.tetrahedra());
        let outcome = case("solve/element_product")
            .constant("TETRAHEDRA", tetrahedra as u32)
            .input("tetrahedra", &s.model.tetrahedra)
            .input("gradients", &s.gradients)
            .input("change", self.changed(change).0)
            .output::<[f32; 4]>("element_forces", 4 * tetrahedra)
            .elements(tetrahedra)
            .run();
        let mut forces: Quads = outcome.get("element_forces");
        forces.extend([[0.0; 4]; 4]);
        self.element_forces = forces;
    }

    fn apply_contacts(&mut self, change: Change) {
        if !self.contact {
            return;
        }
        let (s, (vector, iterates)) = (&self.system, self.changed(change));
        let in_loop = change == Change::Preconditioned;
        let case = case(if in_loop { "solve/contact_iteration" } else { "solve/contact_product" })
            .constant("FRICTION", self.friction)
            .constant("RIGIDS", self.rigid_count())
            .input("params", &[s.params])
            .input("change", vector)
            .input("counts", &[s.counts])
            .input("entry_nodes", &s.entry_nodes)
            .input("entry_weights", &s.entry_weights)
            .input("iterates", iterates)
            .output::<[f32; 4]>("contact_forces", s.contacts.len())
            .elements(s.contacts.len());
        if in_loop {
            let outcome = case
                .input("solution", &self.solution)
                .input("iterations", &self.iterations)
                .inout("contacts", &s.contacts)
                .inout("solve", &[self.state])
                .push(&self.state.current)
                .run();
            self.contact_forces = outcome.get("contact_forces");
            self.state = outcome.get("solve")[0];
            self.system.contacts = outcome.get("contacts");
        } else {
            let is_end = u32::from(change == Change::End);
            let case = case.input("contacts", &s.contacts).input("solve", &[self.state]).push(&is_end);
            self.contact_forces = case.run().get("contact_forces");
        }
    }

    /// The vector at the nodes that the operator is applied to, and the iterates of the rigid bodies that belong to it.
    fn changed(&self, change: Change) -> (&[[f32; 4]], &[RigidIterate]) {
        match change {
            Change::Start | Change::End => (&self.solution, &self.iterates),
            Change::Trend => (&self.trend, &self.rigid_trends),
            Change::Preconditioned => (&self.preconditioned, &self.iterates),
        }
    }

    /// Runs solve/gather. `mode` is as in the kernel's header (0: warm start, 1: iteration, 2: end) and determines
    /// which vectors enter the inner products.
    pub fn gather(&mut self, mode: u32) {
        let change = [Change::Start, Change::Preconditioned, Change::End][mode as usize];
        self.gather_of(mode, change);
    }

    /// Runs solve/gather in mode 0 (warm start) for the trend in place of the solution.
    pub fn gather_trend(&mut self) {
        let of_solution = (self.operator_product.clone(), self.restricted_product.clone(), self.projections.clone());
        self.gather_of(0, Change::Trend);
        self.trend_product = std::mem::replace(&mut self.operator_product, of_solution.0);
        self.restricted_trend = std::mem::replace(&mut self.restricted_product, of_solution.1);
        self.trend_projections = std::mem::replace(&mut self.projections, of_solution.2);
    }

    fn gather_of(&mut self, mode: u32, change: Change) {
        let outcomes: Vec<_> =
            self.variants().iter().map(|variant| self.gather_variant(mode, change, variant)).collect();
        let (roles, groups) = (self.roles(), self.groups());
        let operator_product = merged("operator_product", &unwritten::<[f32; 4]>(self.nodes()), &outcomes);
        self.operator_product = settled("operator_product", operator_product, |i| roles[i].is_some());
        self.supported = merged("supported", &self.supported(), &outcomes);
        let dots = merged("dots", &unwritten::<[f32; 2]>(groups), &outcomes);
        self.dots = settled("dots", dots, |_| mode != 0);
        let projections = merged("projections", &unwritten::<[f32; 4]>(groups), &outcomes);
        self.projections = settled("projections", projections, |_| mode == 0);
        let modes = |name: &str| merged(name, &unwritten::<[f32; 4]>(3 * groups), &outcomes);
        self.restricted_product = settled("restricted_product", modes("restricted_product"), |i| {
            self.coarse || self.role_of_coarse_index(i / 3) != FREE
        });
        self.restricted_residual =
            settled("restricted_residual", modes("restricted_residual"), |_| self.coarse && mode != 0);
    }

    fn gather_variant(&self, mode: u32, change: Change, variant: &Variant) -> Outcome {
        let (s, groups, (vector, iterates)) = (&self.system, self.groups(), self.changed(change));
        let block_nodes = if self.assembled { &self.edges.block_nodes } else { &s.model.blocks.nodes };
        let residual_or_rhs = if mode == 1 { &self.residual } else { &self.rhs };
        self.restricted("solve/gather")
            .constant("BLOCKS", self.blocks() as u32)
            .constant("CONTACT", self.contact)
            .constant("FRICTION", self.friction)
            .constant("RIGIDS", self.rigid_count())
            .constant("MODE", mode)
            .constant("ROLE", variant.role)
            .constant("FIRST", variant.first as u32)
            .constant("ASSEMBLED", self.assembled)
            .input("params", &[s.params])
            .input("block_turns", &self.block_turns)
            .input("blocks", &s.model.blocks.blocks)
            .input("block_nodes", block_nodes)
            .input("block_places", &s.model.blocks.places)
            .input("coarse_blocks", &s.model.coarse.blocks)
            .input("node_rest", &s.model.node_rest)
            .input("node_elements", &s.node_elements)
            .input("element_forces", &self.element_forces)
            .input("stiffness_blocks", &self.edges.blocks)
            .input("node_entries", &pairs(&s.node_entries))
            .input("sorted", &pairs(&s.sorted))
            .input("counts", &[s.counts])
            .input("contacts", &s.contacts)
            .input("contact_forces", &self.contact_forces)
            .input("change", vector)
            .input("trend", &self.trend)
            .input("residual_or_rhs", residual_or_rhs)
            .input("inverse", &self.inverse)
            .input("blocks_without_contacts", &self.blocks_without_contacts)
            .input("rigids", &self.rigids)
            .input("iterates", iterates)
            .partial("operator_product", &unwritten::<[f32; 4]>(self.nodes()))
            .partial("dots", &unwritten::<[f32; 2]>(groups))
            .partial("projections", &unwritten::<[f32; 4]>(groups))
            .partial("restricted_product", &unwritten::<[f32; 4]>(3 * groups))
            .partial("restricted_residual", &unwritten::<[f32; 4]>(3 * groups))
            .input("solve", &[self.state])
            .input("coarse_scales", &s.model.coarse.scales)
            .constant("JOINTS", !self.joints.is_empty())
            .input("joints", &self.joints)
            .input("joint_sides", &self.joint_sides)
            .partial("supported", &self.supported())
            .push(&if mode == 1 { self.state.current } else { 0 })
            .groups(variant.groups)
            .run()
    }

    /// Runs solve/coarse, which applies the coarse space of the preconditioner: before the iteration loop if
    /// `warm_start`, else after the loop, to the final residual.
    pub fn coarse(&mut self, warm_start: bool) {
        let (coarse, blocks) = (&self.system.model.coarse, self.blocks());
        let outcome = case("solve/coarse")
            .size(self.size)
            .constant("WARM_START", warm_start)
            .input("coarse_blocks", &coarse.blocks)
            .input("coarse_inverse", &coarse.inverse)
            .input("coarse_scales", &coarse.scales)
            .input("restricted_rhs", if warm_start { &self.restricted_rhs } else { &self.restricted_residual })
            .input("restricted_product", &self.restricted_product)
            .input("restricted_trend", &self.restricted_trend)
            .output::<[f32; 4]>("coarse_rhs", 3 * blocks)
            .partial("coarse_product", &unwritten::<[f32; 4]>(3 * blocks))
            .partial("coarse_trend", &unwritten::<[f32; 4]>(3 * blocks))
            .output::<f32>("coarse_dots", blocks)
            .groups(blocks)
            .run();
        self.coarse_rhs = outcome.get("coarse_rhs");
        self.coarse_product = settled("coarse_product", outcome.get("coarse_product"), |_| warm_start);
        self.coarse_trend = settled("coarse_trend", outcome.get("coarse_trend"), |_| warm_start);
        self.coarse_dots = outcome.get("coarse_dots");
    }

    pub fn start(&mut self) {
        let s = &self.system;
        let outcome = self
            .reduce("solve/first_residual")
            .constant("TETRAHEDRA", self.tetrahedra() as u32)
            .constant("CONTACT", self.contact)
            .constant("FRICTION", self.friction)
            .constant("TOOL", self.tool)
            .constant("BLOCKS", self.block_count as u32)
            .constant("FREE_BLOCKS", s.model.blocks.free as u32)
            .constant("RIGIDS", self.rigid_count())
            .constant("GROUP", context().group_size())
            .input("params", &[s.params])
            .input("frames", &s.frames)
            .input("counts", &[s.counts])
            .input("contacts", &s.contacts)
            .input("partials", &self.partials)
            .input("projections", &self.projections)
            .input("trend_projections", &self.trend_projections)
            .input("coarse_dots", &self.coarse_dots)
            .input("restricted_product", &self.restricted_product)
            .input("restricted_trend", &self.restricted_trend)
            .input("coarse_rhs", &self.coarse_rhs)
            .input("coarse_product", &self.coarse_product)
            .input("coarse_trend", &self.coarse_trend)
            .inout("rigids", &self.rigids)
            .partial("rigid_inverses", &self.rigid_inverses)
            .inout("iterates", &self.iterates)
            .inout("rigid_trends", &self.rigid_trends)
            .inout("solve", &[self.state])
            .output::<Iteration>("iterations", 2)
            .partial("args", &self.args)
            .groups(1)
            .run();
        self.rigids = outcome.get("rigids");
        self.rigid_inverses = outcome.get("rigid_inverses");
        self.iterates = outcome.get("iterates");
        self.rigid_trends = outcome.get("rigid_trends");
        self.state = outcome.get("solve")[0];
        let iterations: Vec<Iteration> = outcome.get("iterations");
        self.iterations = [iterations[0], iterations[1]];
        self.args = outcome.get("args");
    }

    pub fn begin(&mut self) {
        let (s, nodes) = (&self.system, self.nodes());
        let outcome = self
            .restricted("solve/first_iterate")
            .constant("CONTACT", self.contact)
            .input("solve", &[self.state])
            .input("block_turns", &self.block_turns)
            .input("blocks", &s.model.blocks.blocks)
            .input("block_nodes", &s.model.blocks.nodes)
            .input("block_places", &s.model.blocks.places)
            .input("coarse_blocks", &s.model.coarse.blocks)
            .input("node_rest", &s.model.node_rest)
            .input("rhs", &self.rhs)
            .input("operator_product", &self.operator_product)
            .input("trend_product", &self.trend_product)
            .input("inverse", &self.inverse)
            .input("blocks_without_contacts", &self.blocks_without_contacts)
            .input("coarse_rhs", &self.coarse_rhs)
            .input("coarse_product", &self.coarse_product)
            .input("coarse_trend", &self.coarse_trend)
            .input("iterates", &self.iterates)
            .inout("solution", &self.solution)
            .inout("trend", &self.trend)
            .partial("residual", &unwritten::<[f32; 4]>(nodes))
            .partial("preconditioned", &unwritten::<[f32; 4]>(nodes))
            .partial("direction", &unwritten::<[f32; 4]>(nodes))
            .partial("direction_product", &unwritten::<[f32; 4]>(nodes))
            .partial("restricted_direction", &unwritten::<[f32; 4]>(self.restricted_direction.len()))
            .groups(self.blocks())
            .run();
        let roles = self.roles();
        let of_nodes = |name: &str| settled(name, outcome.get(name), |i| roles[i].is_some());
        (self.solution, self.trend) = (outcome.get("solution"), outcome.get("trend"));
        (self.residual, self.preconditioned) = (of_nodes("residual"), of_nodes("preconditioned"));
        (self.direction, self.direction_product) = (of_nodes("direction"), of_nodes("direction_product"));
        let directions = outcome.get("restricted_direction");
        self.restricted_direction = settled("restricted_direction", directions, |_| self.coarse);
    }

    pub fn update(&mut self) {
        // The variant that leads is dispatched by the loop's indirect arguments.
        let ended = self.has_ended();
        let outcomes: Vec<_> = (self.variants().iter().enumerate())
            .filter(|(index, _)| *index > 0 || !ended)
            .map(|(index, variant)| self.update_variant(index == 0, variant))
            .collect();
        if outcomes.is_empty() {
            return;
        }
        let before = self.state;
        self.state = merged("solve", &[self.state], &outcomes)[0];
        let iterations = merged("iterations", &self.iterations, &outcomes);
        self.iterations = [iterations[0], iterations[1]];
        self.iterates = merged("iterates", &self.iterates, &outcomes);
        self.solution = merged("solution", &self.solution, &outcomes);
        self.args = merged("args", &self.args, &outcomes);
        let (roles, goes_on) = (self.roles(), self.state.current != before.current);
        let next = |name: &str, carried: bool| {
            let values = merged(name, &unwritten::<[f32; 4]>(self.nodes()), &outcomes);
            settled(name, values, |i| goes_on && roles[i].is_some_and(|role| role == FREE || carried))
        };
        let (residual, preconditioned) = (next("next_residual", false), next("next_preconditioned", true));
        let (direction, operator_product) = (next("next_direction", false), next("next_direction_product", false));
        let modes =
            merged("next_restricted_direction", &unwritten::<[f32; 4]>(self.restricted_direction.len()), &outcomes);
        let modes = settled("next_restricted_direction", modes, |_| goes_on && self.coarse);
        if goes_on {
            (self.residual, self.preconditioned) = (residual, preconditioned);
            (self.direction, self.direction_product) = (direction, operator_product);
            self.restricted_direction = modes;
        }
    }

    fn update_variant(&self, leads: bool, variant: &Variant) -> Outcome {
        let s = &self.system;
        self.restricted("solve/update")
            .constant("CONTACT", self.contact)
            .constant("BLOCKS", self.blocks() as u32)
            .constant("PARTIALS", self.dots.len() as u32)
            .constant("WIDEST", self.rigids.iter().map(|rigid| rigid.group_count).max().unwrap_or(1))
            .constant("RIGIDS", self.rigid_count())
            .constant("ROLE", variant.role)
            .constant("FIRST", variant.first as u32)
            .constant("LEADS", leads)
            .input("params", &[s.params])
            .input("block_turns", &self.block_turns)
            .input("blocks", &s.model.blocks.blocks)
            .input("block_nodes", &s.model.blocks.nodes)
            .input("block_places", &s.model.blocks.places)
            .input("node_rest", &s.model.node_rest)
            .input("coarse_blocks", &s.model.coarse.blocks)
            .input("coarse_inverse", &s.model.coarse.inverse)
            .input("coarse_scales", &s.model.coarse.scales)
            .input("dots", &fours(self.dots.as_flattened()))
            .input("restricted_product", &self.restricted_product)
            .input("restricted_residual", &self.restricted_residual)
            .input("operator_product", &self.operator_product)
            .input("inverse", &self.inverse)
            .input("blocks_without_contacts", &self.blocks_without_contacts)
            .input("residual", &self.residual)
            .input("preconditioned", &self.preconditioned)
            .input("direction", &self.direction)
            .input("direction_product", &self.direction_product)
            .input("rigids", &self.rigids)
            .inout("solve", &[self.state])
            .inout("iterations", &self.iterations)
            .inout("iterates", &self.iterates)
            .input("restricted_direction", &self.restricted_direction)
            .partial("next_restricted_direction", &unwritten::<[f32; 4]>(self.restricted_direction.len()))
            .inout("solution", &self.solution)
            .partial("next_residual", &unwritten::<[f32; 4]>(self.nodes()))
            .partial("next_preconditioned", &unwritten::<[f32; 4]>(self.nodes()))
            .partial("next_direction", &unwritten::<[f32; 4]>(self.nodes()))
            .partial("next_direction_product", &unwritten::<[f32; 4]>(self.nodes()))
            .partial("args", &self.args)
            .input("rigid_inverses", &self.rigid_inverses)
            .push(&self.state.current)
            .groups(variant.groups)
            .run()
    }

    pub fn conclude(&mut self) {
        let s = &self.system;
        let outcome = self
            .reduce("solve/conclude")
            .constant("NODES", self.nodes() as u32)
            .constant("CONTACT", self.contact)
            .constant("TOOL", self.tool)
            .constant("TOOLS", TOOLS)
            .constant("BLOCKS", self.block_count as u32)
            .constant("RIGIDS", self.rigid_count())
            .constant("GROUP", context().group_size())
            .constant("SKIN_PARTS", SKIN_PARTS)
            .input("params", &[s.params])
            .input("frames", &s.frames)
            .input("dots", &self.dots)
            .input("coarse_dots", &self.coarse_dots)
            .input("restricted_product", &self.restricted_product)
            .input("contact_forces", &self.contact_forces)
            .input("iterations", &self.iterations)
            .input("iterates", &self.iterates)
            .input("counts", &[s.counts])
            .inout("contacts", &s.contacts)
            .inout("solve", &[self.state])
            .inout("rigids", &self.rigids)
            .inout("rigid_trends", &self.rigid_trends)
            .partial("args", &self.args)
            .partial("report", &[self.report])
            .output::<f32>("core_changes", 6 * s.model.cores.len())
            .input("rigid_inverses", &self.rigid_inverses)
            .groups(1)
            .run();
        self.state = outcome.get("solve")[0];
        self.rigids = outcome.get("rigids");
        self.rigid_trends = outcome.get("rigid_trends");
        self.core_changes = outcome.get("core_changes");
        self.args = outcome.get("args");
        self.report = outcome.get("report")[0];
        self.system.contacts = outcome.get::<Contact>("contacts");
    }

    /// Runs solve/reactions, and returns force and torque of each holder.
    pub fn reactions(&self) -> Vec<f32> {
        let (s, held) = (&self.system, &self.system.model.held);
        let holders: Vec<[u32; 2]> =
            held.holders.iter().map(|holder| [holder.nodes.start as u32, holder.nodes.len() as u32]).collect();
        let outcome = case("solve/reactions")
            .size(self.size)
            .input("params", &[s.params])
            .input("frames", &s.frames)
            .input("node_info", &s.model.node_info)
            .input("node_rest", &s.model.node_rest)
            .input("displacement", &s.displacement)
            .input("supported", &self.supported)
            .input("holders", &holders)
            .input("held_nodes", &held.list)
            .input("held_shares", &held.shares)
            .output::<f32>("reactions", 6 * holders.len())
            .groups(holders.len())
            .run();
        outcome.get("reactions")
    }

    pub fn commit(&mut self) {
        let s = &self.system;
        let outcome = case("solve/commit")
            .constant("NODES", self.nodes() as u32)
            .constant("RIGIDS", self.rigid_count())
            .constant("SUPPORTS", self.supports)
            .input("supported", &self.supported())
            .input("params", &[s.params])
            .input("frames", &s.frames)
            .input("node_info", &s.model.node_info)
            .input("solution", &self.solution)
            .input("rhs", &self.rhs)
            .input("operator_product", &self.operator_product)
            .input("node_rest", &s.model.node_rest)
            .input("solve", &[self.state])
            .input("iterates", &self.iterates)
            .inout("velocity", &s.velocity)
            .inout("displacement", &s.displacement)
            .inout("trend", &self.trend)
            .partial("carried_residual", &self.carried_residual)
            .elements(self.nodes())
            .run();
        self.carried_residual = outcome.get("carried_residual");
        self.trend = outcome.get("trend");
        self.system.velocity = outcome.get("velocity");
        self.system.displacement = outcome.get("displacement");
    }
}
