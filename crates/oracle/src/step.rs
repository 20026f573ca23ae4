//! The whole step in f64: implicit Euler of soft bodies, dynamic cores (rigid cores inside soft bodies, whose motion
//! the solver finds), contacts and the tool (rigid body that the haptic device moves), solved directly (equations in
//! docs/understanding/solver.md, "Implicit Euler"). The unknowns are changes of velocity over the step.

use faer::Mat;
use faer::linalg::solvers::Solve as _;
use glam::{DMat3, DQuat, DVec3};

pub use crate::body::{Core, CoupledCore, SoftBody};
use palpate::Result;

use crate::contact::{Carrier, Contact, Point};
use crate::contact_law::Friction;
use crate::elastic::cross_matrix;
use crate::joint::Joint;
use crate::linear::{Entries, Solver};
use crate::newton::Trial;
use crate::tool::{self, Device, Tool};
use crate::wrench::{self, Wrench};

/// Flag of a step: contacts were under tension even after the last repeated solve; their force counts as zero.
pub const TENSION_REMAINS: u32 = 256;
/// Greatest number of repeated solves after contacts under tension are released; the GPU engine releases them as often,
/// but goes on with its iterations.
pub const MAX_RETRIES: usize = 4;

/// A contact with its forces at the end of the step.
#[derive(Debug, Clone)]
pub struct Resolved {
    /// The contact.
    pub contact: Contact,
    /// Normal force that pushes the two bodies apart, N; never negative.
    pub force: f64,
    /// Friction on body A, N; its opposite acts on body B.
    pub friction: DVec3,
    /// Ratio of friction to the tangential velocity at the end of the step, N s/m.
    pub viscosity: f64,
    /// Whether the contact was part of the last solve and is not under tension.
    pub active: bool,
}

/// Report of a step.
#[derive(Debug, Clone)]
pub struct Report {
    /// Every contact given to the step, in the same order.
    pub contacts: Vec<Resolved>,
    /// Contact wrench on the tool, or on the body whose core the device holds; zero if there is neither.
    pub wrench: Wrench,
    /// Contact wrenches on the bodies whose cores further devices hold.
    pub further: Vec<Wrench>,
    /// Bit mask of flags, such as [`TENSION_REMAINS`].
    pub flags: u32,
    /// Residual of the nonlinear equations after the last of several Newton iterations, relative to the right-hand side
    /// of the first, both in the norm of the inverse of the diagonal blocks of nodes, cores and tool; zero after a
    /// single iteration.
    pub nonlinear_residual: f64,
    /// For each node of each body with supports the force that holds it in the step, N: what is left of its equation in
    /// the directions that supports, or a core of prescribed motion, take from it. Empty for other bodies.
    pub holding: Vec<Vec<DVec3>>,
}

/// A scene of soft bodies, dynamic cores and the tool, which can be stepped.
#[derive(Default)]
pub struct Simulation {
    /// Time step, s.
    pub dt: f64,
    /// Gravity, m/s^2.
    pub gravity: DVec3,
    /// Soft bodies.
    pub bodies: Vec<SoftBody>,
    /// The rigid tool, if there is one.
    pub tool: Option<Tool>,
    /// Dynamic cores.
    pub cores: Vec<Core>,
    /// Joints of the cores.
    pub joints: Vec<Joint>,
    /// The core that the haptic device holds, if any.
    pub coupled: Option<CoupledCore>,
    /// Cores that further haptic devices hold, each with its device at the end of the next step.
    pub further: Vec<(CoupledCore, Device)>,
    /// External force on each node of each body in the next step, N; empty without loads.
    pub node_loads: Vec<Vec<DVec3>>,
    /// Force (N) and torque (N m) on each dynamic core in the next step; empty without loads.
    pub core_loads: Vec<(DVec3, DVec3)>,
    /// Friction of all contacts, if there is any.
    pub friction: Option<Friction>,
    /// Newton iterations of a step.
    pub newton: usize,
    /// Changes of the unknown velocities over the last step; empty before the first.
    pub last_change: Vec<f64>,
    /// Direct solver, which keeps its symbolic factorisation from step to step.
    pub solver: Solver,
}

/// How a node's change of velocity follows from the unknowns: a sum of 3x3 matrices, each times three unknowns from the
/// given index on. The map is empty where the node's motion is prescribed.
pub type Map = Vec<(usize, DMat3)>;

/// Indices of nodes, cores and the tool among the unknowns.
pub struct Unknowns {
    /// Map of each node of each body: a free node has three unknowns of its own; a node attached to a dynamic core
    /// depends on the core's six unknowns.
    pub nodes: Vec<Vec<Map>>,
    /// First of the six unknowns of each core.
    pub cores: Vec<usize>,
    /// First of the tool's six unknowns.
    pub tool: usize,
    /// Number of all unknowns.
    pub count: usize,
}

impl Unknowns {
    /// Norm sqrt(r . D^-1 r) of a vector of the unknowns' equations, with the diagonal blocks D of the matrix `a`: 3x3
    /// for each node, 6x6 for each core and for the tool.
    fn norm(&self, a: &Entries, r: &[f64]) -> f64 {
        let free = self.cores.first().copied().unwrap_or(self.tool);
        let block = |i: usize| if i < free { (i - i % 3, 3) } else { (i - (i - free) % 6, 6) };
        let mut blocks = std::collections::BTreeMap::new();
        for (i, j, value) in a.lower() {
            let (first, size) = block(i);
            if j < first || j >= first + size {
                continue;
            }
            let matrix = blocks.entry(first).or_insert_with(|| Mat::<f64>::zeros(size, size));
            matrix[(i - first, j - first)] += value;
            if i != j {
                matrix[(j - first, i - first)] += value;
            }
        }
        let mut sum = 0.0;
        for (first, matrix) in blocks {
            let own = Mat::from_fn(matrix.nrows(), 1, |i, _| r[first + i]);
            let solved = matrix.partial_piv_lu().solve(&own);
            sum += (0..matrix.nrows()).map(|i| own[(i, 0)] * solved[(i, 0)]).sum::<f64>();
        }
        sum.sqrt()
    }
}

impl Simulation {
    /// An empty scene.
    pub fn new(dt: f64, gravity: DVec3) -> Self {
        Self { dt, gravity, newton: 1, ..Self::default() }
    }

    /// Advances by one step. `device`: pose and twist of the haptic device at the end of the step; `contacts`: contacts
    /// found in the present state. Returns an error if the system cannot be factorised.
    pub fn step(&mut self, device: Option<&Device>, contacts: &[Contact]) -> Result<Report> {
        let unknowns = self.unknowns();
        let mut trials: Vec<_> = self.bodies.iter().map(Trial::start).collect();
        let rows: Vec<_> = contacts.iter().map(|c| self.row(&unknowns, c)).collect();
        let (start, last) = (self.velocities(&unknowns), self.last_change(&unknowns));
        let known: Vec<f64> = contacts.iter().map(|c| self.known_rate(&unknowns, c)).collect();
        let drags: Vec<_> = contacts.iter().map(|c| self.drag(&unknowns, &start, &last, c)).collect();
        let mut active = vec![true; contacts.len()];
        let mut change = Vec::new();
        let mut pressures = Vec::new();
        let mut flags = 0;
        let mut of_first = None;
        for left in (0..self.newton).rev() {
            let (base, load) = self.system(&unknowns, &trials, device);
            for attempt in 0..=MAX_RETRIES {
                let (mut a, mut b) = (base.clone(), load.clone());
                for j in (0..contacts.len()).filter(|&j| active[j]) {
                    let rate = known[j] + dot(&rows[j], &start);
                    add_contact(&mut a, &mut b, &rows[j], &contacts[j], rate, self.dt);
                    drags[j].add(&mut a, &mut b, self.dt);
                }
                change = self.solver.solve(&a, &b)?;
                if left + 1 == self.newton {
                    of_first = Some(unknowns.norm(&a, &b));
                }
                let end: Vec<f64> = start.iter().zip(&change).map(|(v, dv)| v + dv).collect();
                let rate = |j: usize| known[j] + dot(&rows[j], &end);
                pressures = contacts.iter().enumerate().map(|(j, c)| self.pressure(c, rate(j))).collect();
                let under_tension =
                    (0..contacts.len()).filter(|&j| active[j] && pressures[j] < 0.0).collect::<Vec<_>>();
                // A contact under tension after the last repeated solve may be under pressure in the next Newton
                // iteration.
                if under_tension.is_empty() || (attempt == MAX_RETRIES && left > 0) {
                    break;
                }
                under_tension.iter().for_each(|&j| active[j] = false);
                flags |= if attempt == MAX_RETRIES { TENSION_REMAINS } else { 0 };
            }
            if self.newton > 1 {
                trials = self.trials(&unknowns, &change);
            }
        }
        let mut nonlinear_residual = 0.0;
        if let (Some(of_first), true) = (of_first, self.newton > 1) {
            let (mut a, mut b) = self.system(&unknowns, &trials, device);
            for j in (0..contacts.len()).filter(|&j| active[j]) {
                let rate = known[j] + dot(&rows[j], &start);
                add_contact(&mut a, &mut b, &rows[j], &contacts[j], rate, self.dt);
                drags[j].add(&mut a, &mut b, self.dt);
            }
            let left: Vec<f64> = b.iter().zip(a.multiply(&change)).map(|(b, y)| b - y).collect();
            nonlinear_residual = unknowns.norm(&a, &left) / of_first;
        }
        let resolve = |j: usize| Resolved {
            contact: contacts[j].clone(),
            force: if active[j] { contacts[j].area * pressures[j] } else { 0.0 },
            friction: if active[j] { drags[j].force(&change) } else { DVec3::ZERO },
            viscosity: drags[j].viscosity,
            active: active[j],
        };
        let contacts: Vec<_> = (0..contacts.len()).map(resolve).collect();
        let wrench = match (&self.tool, &self.coupled) {
            (Some(tool), _) => wrench::on_tool(&contacts, tool.centre),
            (None, Some(held)) => wrench::on_core(&contacts, &self.cores[held.core]),
            (None, None) => Wrench::default(),
        };
        let further = self.further.iter().map(|(held, _)| wrench::on_core(&contacts, &self.cores[held.core])).collect();
        let acting: Vec<Contact> =
            (0..contacts.len()).filter(|j| active[*j]).map(|j| contacts[j].contact.clone()).collect();
        let holding = self.holding(&unknowns, &change, &trials, device, &acting);
        self.commit(&unknowns, &change);
        self.last_change = change;
        Ok(Report { contacts, wrench, further, flags, nonlinear_residual, holding })
    }

    /// Changes of the unknown velocities over the last step; zeros before the first.
    fn last_change(&self, unknowns: &Unknowns) -> Vec<f64> {
        let known = self.last_change.iter().copied().chain(std::iter::repeat(0.0));
        known.take(unknowns.count).collect()
    }

    /// The forces that hold the nodes of bodies with supports, N (see [`Report::holding`]): the residual of a system in
    /// which all nodes are free, for the solution `change` of the system of `unknowns`.
    fn holding(
        &self,
        unknowns: &Unknowns,
        change: &[f64],
        trials: &[Trial],
        device: Option<&Device>,
        contacts: &[Contact],
    ) -> Vec<Vec<DVec3>> {
        if self.bodies.iter().all(|body| body.supports.is_empty()) {
            return vec![Vec::new(); self.bodies.len()];
        }
        let all = self.numbered(true);
        let spread = |x: &[f64]| {
            let mut spread = vec![0.0; all.count];
            for (map, own) in all.nodes.iter().flatten().zip(unknowns.nodes.iter().flatten()) {
                if let ([(to, _)], [(from, left)]) = (&map[..], &own[..]) {
                    let moved = *left * DVec3::from_slice(&x[*from..from + 3]);
                    spread[*to..to + 3].copy_from_slice(&moved.to_array());
                }
            }
            let rigid = unknowns.cores.first().copied().unwrap_or(unknowns.tool);
            let to = all.cores.first().copied().unwrap_or(all.tool);
            spread[to..].copy_from_slice(&x[rigid..]);
            spread
        };
        let (mut a, mut b) = self.system(&all, trials, device);
        let (start, last) = (self.velocities(&all), spread(&self.last_change(unknowns)));
        for contact in contacts {
            let row = self.row(&all, contact);
            let rate = self.known_rate(&all, contact) + dot(&row, &start);
            add_contact(&mut a, &mut b, &row, contact, rate, self.dt);
            self.drag(&all, &start, &last, contact).add(&mut a, &mut b, self.dt);
        }
        let product = a.multiply(&spread(change));
        let impulse = |map: &Map, left: &DMat3| match map[..] {
            [(first, _)] => {
                let all = DVec3::from_slice(&product[first..first + 3]) - DVec3::from_slice(&b[first..first + 3]);
                (all - *left * all) / self.dt
            }
            _ => DVec3::ZERO,
        };
        let of_body = |(body, maps): (&SoftBody, &Vec<Map>)| {
            body.supports.iter().zip(maps).map(|(left, map)| impulse(map, left)).collect()
        };
        self.bodies.iter().zip(&all.nodes).map(of_body).collect()
    }

    /// The forces that hold the nodes of bodies with supports, N (see [`Report::holding`]), for the solution `change` of
    /// the system of the next step with all of the given contacts in it.
    pub fn held_by(&self, device: Option<&Device>, contacts: &[Contact], change: &[f64]) -> Vec<Vec<DVec3>> {
        let trials: Vec<_> = self.bodies.iter().map(Trial::start).collect();
        self.holding(&self.unknowns(), change, &trials, device, contacts)
    }

    /// Numbers the unknowns: nodes body by body, then the cores, then the tool.
    pub fn unknowns(&self) -> Unknowns {
        self.numbered(false)
    }

    /// Numbers the unknowns. `all`: as if no node were supported or attached to a core of prescribed motion.
    fn numbered(&self, all: bool) -> Unknowns {
        let mut count = 0;
        let mut number = |body: &SoftBody, node: usize| {
            let is_bound = !all && body.layer.attached[node];
            let first = count;
            count += if is_bound { 0 } else { 3 };
            let left = body.supports.get(node).copied().filter(|_| !all).unwrap_or(DMat3::IDENTITY);
            if is_bound { vec![] } else { vec![(first, left)] }
        };
        let mut nodes: Vec<Vec<Map>> =
            self.bodies.iter().map(|b| (0..b.layer.nodes.len()).map(|n| number(b, n)).collect()).collect();
        let cores: Vec<usize> = (0..self.cores.len()).map(|k| count + 6 * k).collect();
        for (core, first) in self.cores.iter().zip(&cores) {
            for (body, node) in &core.nodes {
                let arm = self.bodies[*body].world_node(*node) - core.centre;
                let (linear, angular) = core.freedom();
                nodes[*body][*node as usize] = vec![(*first, linear), (*first + 3, cross_matrix(-arm) * angular)];
            }
        }
        let tool = count + 6 * cores.len();
        Unknowns { nodes, cores, tool, count: tool + if self.tool.is_some() { 6 } else { 0 } }
    }

    /// Matrix A and right-hand side b of the system of the next step, with all of the given contacts in it.
    pub fn assemble(&self, device: Option<&Device>, contacts: &[Contact]) -> (Entries, Vec<f64>) {
        let unknowns = self.unknowns();
        let trials: Vec<_> = self.bodies.iter().map(Trial::start).collect();
        let (mut a, mut b) = self.system(&unknowns, &trials, device);
        let (start, last) = (self.velocities(&unknowns), self.last_change(&unknowns));
        for contact in contacts {
            let row = self.row(&unknowns, contact);
            let rate = self.known_rate(&unknowns, contact) + dot(&row, &start);
            add_contact(&mut a, &mut b, &row, contact, rate, self.dt);
            self.drag(&unknowns, &start, &last, contact).add(&mut a, &mut b, self.dt);
        }
        (a, b)
    }

    /// Matrix A and right-hand side b of a step's system without contacts, with the elasticity of each body linearised
    /// at its trial state.
    fn system(&self, unknowns: &Unknowns, trials: &[Trial], device: Option<&Device>) -> (Entries, Vec<f64>) {
        let (mut a, mut b) = (Entries::default(), vec![0.0; unknowns.count]);
        for (((body, nodes), trial), index) in self.bodies.iter().zip(&unknowns.nodes).zip(trials).zip(0..) {
            let loads = self.node_loads.get(index).map_or(&[][..], Vec::as_slice);
            for (map, force) in nodes.iter().zip(loads) {
                for (first, matrix) in map {
                    let impulse = self.dt * (matrix.transpose() * *force);
                    (0..3).for_each(|axis| b[first + axis] += impulse[axis]);
                }
            }
            self.add_body(&mut a, &mut b, body, trial, nodes);
            for (first, left) in nodes.iter().filter(|map| map.len() == 1).map(|map| map[0]) {
                // Ones on the diagonal of A keep the changes of velocity that supports prevent at zero.
                if left != DMat3::IDENTITY {
                    a.add_block(first, first, &(DMat3::IDENTITY - left));
                }
            }
        }
        for ((core, first), (force, torque)) in self.cores.iter().zip(&unknowns.cores).zip(&self.core_loads) {
            let (linear, angular) = core.freedom();
            let (force, torque) = (linear * *force, angular * *torque);
            (0..3).for_each(|axis| b[first + axis] += self.dt * force[axis]);
            (0..3).for_each(|axis| b[first + 3 + axis] += self.dt * torque[axis]);
        }
        for (core, first) in self.cores.iter().zip(&unknowns.cores) {
            let inertia = core.nodes.iter().fold(DMat3::ZERO, |sum, (body, node)| {
                let body = &self.bodies[*body];
                sum + tool::point_inertia(body.elements.masses[*node as usize], body.world_node(*node) - core.centre)
            });
            let (linear, angular) = core.freedom();
            if core.hinge.is_some() {
                // Spin about a fixed axis causes no gyroscopic torque about that axis. Ones on the diagonal of A keep
                // the changes of velocity that the hinge prevents at zero.
                a.add_block(*first, *first, &(DMat3::IDENTITY - linear));
                a.add_block(first + 3, first + 3, &(DMat3::IDENTITY - angular));
                continue;
            }
            let gyroscopic = tool::gyroscopic(inertia, core.spin, self.dt);
            (0..3).for_each(|axis| b[first + 3 + axis] += gyroscopic[axis]);
        }
        for joint in &self.joints {
            joint.add_terms(&self.cores, &unknowns.cores, &mut a, &mut b, self.dt);
        }
        if let (Some(held), Some(device)) = (&self.coupled, device) {
            held.add_terms(&self.cores[held.core], &mut a, &mut b, unknowns.cores[held.core], self.dt, device);
        }
        for (held, device) in &self.further {
            held.add_terms(&self.cores[held.core], &mut a, &mut b, unknowns.cores[held.core], self.dt, device);
        }
        if let Some(tool) = &self.tool {
            tool.add_terms(&mut a, &mut b, unknowns.tool, self.dt, self.gravity, device);
        }
        (a, b)
    }

    /// Row c of a contact's Jacobian: c . v is the rate of the contact's depth, with the vector v of the velocities
    /// whose changes are the unknowns.
    pub fn row(&self, unknowns: &Unknowns, contact: &Contact) -> Vec<(usize, f64)> {
        self.row_along(unknowns, contact, contact.normal)
    }

    /// Row c of a contact's Jacobian along a direction: c . v is the relative velocity along it, with the vector v of
    /// the velocities whose changes are the unknowns.
    pub(super) fn row_along(&self, unknowns: &Unknowns, contact: &Contact, direction: DVec3) -> Vec<(usize, f64)> {
        let mut row = Vec::new();
        self.add_point(&mut row, unknowns, &contact.first, direction);
        self.add_point(&mut row, unknowns, &contact.second, -direction);
        row
    }

    fn add_point(&self, row: &mut Vec<(usize, f64)>, unknowns: &Unknowns, point: &Point, direction: DVec3) {
        match (&point.carrier, &self.tool) {
            (Carrier::Nodes(body, weights), _) => {
                for (node, weight) in weights {
                    for (first, matrix) in &unknowns.nodes[*body][*node as usize] {
                        let mapped = *weight * (matrix.transpose() * direction);
                        row.extend((0..3).map(|axis| (first + axis, mapped[axis])));
                    }
                }
            }
            (Carrier::Tool, Some(tool)) => {
                let moment = (point.position - tool.centre).cross(direction);
                let both = direction.to_array().into_iter().chain(moment.to_array());
                row.extend(both.enumerate().map(|(k, x)| (unknowns.tool + k, x)));
            }
            (Carrier::Fixed, _) | (Carrier::Tool, None) => {}
        }
    }

    fn velocities(&self, unknowns: &Unknowns) -> Vec<f64> {
        let mut all = vec![0.0; unknowns.count];
        for (body, nodes) in self.bodies.iter().zip(&unknowns.nodes) {
            for (v, map) in body.velocity.iter().zip(nodes) {
                if let [(first, _)] = map[..] {
                    all[first..first + 3].copy_from_slice(&v.to_array());
                }
            }
        }
        for (core, first) in self.cores.iter().zip(&unknowns.cores) {
            all[*first..first + 3].copy_from_slice(&core.velocity.to_array());
            all[first + 3..first + 6].copy_from_slice(&core.spin.to_array());
        }
        if let Some(tool) = &self.tool {
            all[unknowns.tool..unknowns.tool + 3].copy_from_slice(&tool.velocity.to_array());
            all[unknowns.tool + 3..].copy_from_slice(&tool.angular_velocity.to_array());
        }
        all
    }

    /// Part of the rate of the contact's depth that comes from nodes whose motion is prescribed, m/s.
    pub(super) fn known_rate(&self, unknowns: &Unknowns, contact: &Contact) -> f64 {
        self.known_along(unknowns, contact, contact.normal)
    }

    pub(super) fn known_along(&self, unknowns: &Unknowns, contact: &Contact, along: DVec3) -> f64 {
        let of = |point: &Point, direction: DVec3| match &point.carrier {
            Carrier::Nodes(index, weights) => {
                let (index, body) = (*index, &self.bodies[*index]);
                let known = weights.iter().filter(|(node, _)| unknowns.nodes[index][*node as usize].is_empty());
                known.map(|(node, weight)| weight * direction.dot(body.velocity[*node as usize])).sum()
            }
            Carrier::Tool | Carrier::Fixed => 0.0,
        };
        of(&contact.first, along) + of(&contact.second, -along)
    }

    /// Pressure of a contact at the end of the step, N/m^2, if the contact's depth then has the given rate, m/s.
    fn pressure(&self, contact: &Contact, rate: f64) -> f64 {
        contact.penalty().end_pressure(contact.depth, rate, self.dt)
    }

    /// Commits the solution dv over a step of h seconds: velocities v1 = v0 + dv, and displacements d1 = d0 + h R^T v1
    /// with the rotation R from rest axes to world axes. Attached nodes of prescribed motion keep the velocity that the
    /// caller gave them; cores and the tool move with their new twist.
    fn commit(&mut self, unknowns: &Unknowns, change: &[f64]) {
        for (body, nodes) in self.bodies.iter_mut().zip(&unknowns.nodes) {
            let to_rest = body.elements.frame.transpose();
            for (i, map) in nodes.iter().enumerate() {
                if let [(first, left)] = map[..] {
                    body.velocity[i] += left * DVec3::from_slice(&change[first..first + 3]);
                }
                if map.len() < 2 {
                    body.displacement[i] += self.dt * (to_rest * body.velocity[i]);
                }
            }
        }
        for (core, first) in self.cores.iter_mut().zip(&unknowns.cores) {
            core.velocity += DVec3::from_slice(&change[*first..first + 3]);
            core.spin += DVec3::from_slice(&change[first + 3..first + 6]);
            let (from, turn) = (core.centre, DQuat::from_scaled_axis(self.dt * core.spin));
            core.centre += self.dt * core.velocity;
            for (body, node) in &core.nodes {
                let body = &mut self.bodies[*body];
                let arm = turn * (body.world_node(*node) - from);
                let node = *node as usize;
                let rest = body.elements.frame.transpose() * (core.centre + arm - body.position);
                body.displacement[node] = rest - body.layer.nodes[node];
                body.velocity[node] = core.velocity + core.spin.cross(arm);
            }
        }
        self.joints.iter_mut().for_each(|joint| joint.advance(&self.cores, self.dt));
        if let Some(held) = &mut self.coupled {
            held.turn(self.dt, &self.cores[held.core]);
        }
        for (held, _) in &mut self.further {
            held.turn(self.dt, &self.cores[held.core]);
        }
        if let Some(tool) = &mut self.tool {
            let twist = std::array::from_fn(|k| change[unknowns.tool + k]);
            tool.advance(self.dt, twist);
        }
    }
}

/// Adds a contact to the system of a step of `h` seconds: (h^2 k + h d) a c c^T to its matrix, and
/// -h a (k depth + (d + h k) depth') c to its right-hand side, with the contact's Jacobian row c, area a, stiffness k
/// and damping d; `rate` is depth', the rate of the depth, at the start of the step, m/s.
fn add_contact(a: &mut Entries, b: &mut [f64], row: &[(usize, f64)], contact: &Contact, rate: f64, h: f64) {
    let penalty = contact.penalty();
    a.add_outer(row, h * penalty.slope(h) * contact.area);
    let impulse = -h * contact.area * penalty.end_pressure(contact.depth, rate, h);
    for (i, x) in row {
        b[*i] += impulse * x;
    }
}

/// Adds a 3x3 block B between two nodes i and j in terms of their unknowns: P_i^T B P_j, with the nodes' maps P.
pub(super) fn add_mapped(a: &mut Entries, rows: &Map, columns: &Map, block: &DMat3) {
    for (row, left) in rows {
        for (column, right) in columns {
            a.add_block(*row, *column, &(left.transpose() * *block * *right));
        }
    }
}

pub(super) fn dot(row: &[(usize, f64)], x: &[f64]) -> f64 {
    row.iter().map(|(i, c)| c * x[*i]).sum()
}
