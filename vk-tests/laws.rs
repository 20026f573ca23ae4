//! Laws that whole steps keep, whatever the oracle says: balance of momentum, energy, the same answer everywhere and every
//! time, no work that a scene does not need, no step that blows up.

use glam::{DQuat, DVec3};
use palpate::gpu::Options;
use palpate::oracle;
use palpate::report::{Flags, Row};
use palpate::scene::Scene;
use palpate::stages::depth;
use palpate::stages::types::Contact;
use palpate::step::Simulation;

use crate::touch::{Place, press};
use crate::whole_step::{open, run, scene, soft_twin};

/// Nodes, their velocities and the tool at one moment.
struct State {
    twin: oracle::step::SoftBody,
    tool: Option<palpate::haptics::tool::Tool>,
}

impl State {
    fn of(simulation: &Simulation) -> State {
        let mut twin = soft_twin(simulation, 0);
        (twin.displacement, twin.velocity) = simulation.nodes(0).unwrap().unwrap();
        State { twin, tool: simulation.tool().cloned() }
    }

    fn nodes(&self) -> impl Iterator<Item = (f64, DVec3, DVec3)> {
        let free = self.twin.layer.bound.iter().map(|bound| !bound);
        let all = self.twin.elements.masses.iter().copied().zip(self.twin.world_nodes()).zip(&self.twin.velocity);
        all.zip(free).filter(|(_, free)| *free).map(|(((m, x), v), _)| (m, x, *v))
    }

    /// Linear and angular momentum (about the origin) of free nodes and tool, kg m/s and kg m^2/s.
    fn momentum(&self) -> (DVec3, DVec3) {
        let (mut linear, mut angular) = (DVec3::ZERO, DVec3::ZERO);
        for (m, x, v) in self.nodes() {
            linear += m * v;
            angular += m * x.cross(v);
        }
        if let Some(t) = &self.tool {
            let turn = glam::DMat3::from_quat(t.orientation);
            linear += t.mass * t.velocity;
            angular += t.mass * t.centre.cross(t.velocity) + turn * t.inertia * turn.transpose() * t.angular_velocity;
        }
        (linear, angular)
    }

    /// Kinetic, elastic and gravity's energy, J.
    fn energy(&self, gravity: DVec3) -> f64 {
        let nodes: f64 = self.nodes().map(|(m, x, v)| m * (0.5 * v.length_squared() - gravity.dot(x))).sum();
        let rotations = self.twin.elements.rotations(&self.twin.displacement);
        let tool = self.tool.as_ref().map_or(0.0, |t| {
            let turn = glam::DMat3::from_quat(t.orientation);
            let spin = turn.transpose() * t.angular_velocity;
            t.mass * (0.5 * t.velocity.length_squared() - gravity.dot(t.centre)) + 0.5 * spin.dot(t.inertia * spin)
        });
        nodes + tool + self.twin.elements.energy(&self.twin.displacement, &rotations)
    }
}

const BLOCK: &str = "box = [[-0.05, -0.05, -0.05], [0.05, 0.05, 0.05]]";

/// A free block that flies into a resting sphere off its centre, both free.
fn collision(young: f64) -> String {
    format!(
        "[step]\ngravity = [0.0, 0.0, 0.0]\n[solver]\ntolerance = 1e-6\nmax_iterations = 1000\n[[body]]\nname = \"block\"\n\
         layer = {{ {BLOCK}, cells = [5, 5, 5] }}\nvelocity = [0.1, 0.5, 0.0]\n\
         material = {{ young = {young:e}, poisson = 0.4, density = 1000.0 }}\n\
         [tool]\nsphere = 0.02\nmass = 0.3\nposition = [0.015, 0.072, -0.01]\n"
    )
}

#[test]
fn a_free_block_and_a_free_tool_keep_their_momentum() {
    for young in [2.0e4, 5.0e5] {
        let scene = scene(&collision(young));
        let mut simulation = open(&scene, None);
        let mut before = State::of(&simulation);
        let (start, spin) = before.momentum();
        let (mut worst, mut drift, mut twist, mut method) = (0.0f64, 0.0f64, 0.0f64, 0.0f64);
        let (mut contacts, mut force) = (0, 0.0f64);
        for _ in 0..40 {
            let row = run(&mut simulation, 1).remove(0);
            assert_eq!(row.flags, Flags::default());
            let after = State::of(&simulation);
            let ((p0, l0), (p1, l1)) = (before.momentum(), after.momentum());
            worst = worst.max(p1.distance(p0));
            drift = drift.max(p1.distance(start));
            // The stiffness term of the step acts with the rotations of its start: its own, known torque.
            let body = &before.twin;
            let stiff = body.elements.apply_stiffness(&after.twin.velocity, &body.rotations());
            let turn: DVec3 = body.world_nodes().iter().zip(&stiff).map(|(x, f)| x.cross(*f)).sum();
            let h = scene.step.dt;
            method = method.max((h * h * turn).length());
            twist = twist.max((l1 - l0 + h * h * turn).length());
            contacts = contacts.max(row.contacts.unwrap());
            force = force.max(row.tool.unwrap().force.length());
            before = after;
        }
        let (end, end_spin) = before.momentum();
        let tool = before.tool.unwrap().velocity;
        println!(
            "momentum at {young:e} Pa: {:.3} kg m/s; per step {worst:.1e}, over all {drift:.1e} (end {:.1e}); angular {:.1e}: \
             per step {twist:.1e} beside the method's {method:.1e}, from start to end {:.1e}; {contacts} contacts, {force:.1} N, \
             tool leaves at {tool:.2}",
            start.length(),
            end.distance(start),
            spin.length(),
            end_spin.distance(spin)
        );
    }
}

/// Penalty energy of contacts that stand, J.
fn penalty(contacts: &[Contact]) -> f64 {
    contacts.iter().map(|c| 0.5 * f64::from(c.stiffness) * f64::from(c.area) * f64::from(c.depth).powi(2)).sum()
}

/// A run's energies at the start of each step (with the contacts gathered there), and heights.
fn energies(text: &str, steps: usize, height: impl Fn(&State) -> f64) -> (Vec<(f64, f64)>, Vec<f64>, Vec<Row>) {
    let scene = scene(text);
    let mut simulation = open(&scene, None);
    let (mut all, mut heights, mut rows) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..steps {
        let state = State::of(&simulation);
        rows.extend(run(&mut simulation, 1));
        all.push((state.energy(scene.step.gravity), penalty(&simulation.touch().unwrap().1)));
        heights.push(height(&state));
    }
    (all, heights, rows)
}

fn judge(name: &str, text: &str, steps: usize, height: impl Fn(&State) -> f64) {
    let (all, heights, rows) = energies(text, steps, height);
    let start = all[0].0 + all[0].1;
    let lowest_height = heights.iter().copied().fold(f64::INFINITY, f64::min);
    let at = heights.iter().position(|h| *h == lowest_height).unwrap();
    let rebound = heights[at..].iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let scale = all.iter().map(|(e, _)| (e - start).abs()).fold(0.0, f64::max);
    let plain = all.iter().map(|(e, _)| e - start).fold(f64::NEG_INFINITY, f64::max);
    let total = all.iter().map(|(e, c)| e + c - start).fold(f64::NEG_INFINITY, f64::max);
    let most = all.iter().map(|e| e.1).fold(0.0, f64::max);
    let flags: Vec<u32> = rows.iter().map(|r| r.flags.0).filter(|f| *f != 0).collect();
    println!(
        "{name}: rises {:.1e} without, {:.1e} with the contacts' (to {most:.2e}), of {scale:.2e} J turned over; \
         fell to {:.4} at step {at}, back to {:.4} of {:.4} m; flags {flags:?}",
        plain / scale,
        total / scale,
        lowest_height,
        rebound,
        heights[0]
    );
}

#[test]
fn a_dropped_tool_never_gains_energy() {
    for (young, drop) in [(5.0e3, 0.01), (2.0e4, 0.02), (2.0e4, 0.1), (1.0e6, 0.02)] {
        let text = format!(
            "[solver]\ntolerance = 1e-6\nmax_iterations = 1000\n[[body]]\nname = \"block\"\n\
             layer = {{ {BLOCK}, cells = [6, 6, 6] }}\n\
             material = {{ young = {young:e}, poisson = 0.45, density = 1000.0 }}\n[[body.core]]\nname = \"c\"\n\
             motion = \"fixed\"\nbind = {{ box = [[-0.06, -0.06, -0.06], [0.06, -0.049, 0.06]] }}\n\
             [tool]\nsphere = 0.02\nmass = 0.05\nposition = [0.0, {:?}, 0.0]\n",
            0.07 + drop
        );
        judge(&format!("tool on {young:e} Pa from {drop} m"), &text, 250, |s| s.tool.as_ref().unwrap().centre.y);
    }
}

#[test]
fn a_dropped_block_never_gains_energy() {
    for (young, drop, tilt) in [(2.0e4, 0.02, 0.0), (2.0e4, 0.1, 0.0), (1.0e6, 0.02, 0.0), (5.0e4, 0.03, 0.4)] {
        let turn = DQuat::from_axis_angle(DVec3::new(1.0, 0.0, 0.6).normalize(), tilt).to_array();
        let lowest = 0.05 * DQuat::from_array(turn).conjugate().mul_vec3(DVec3::Y).abs().element_sum();
        let text = format!(
            "[solver]\ntolerance = 1e-6\nmax_iterations = 1000\n[[body]]\nname = \"block\"\n\
             layer = {{ {BLOCK}, cells = [5, 5, 5] }}\nposition = [0.0, {:?}, 0.0]\norientation = {turn:?}\n\
             material = {{ young = {young:e}, poisson = 0.4, density = 1000.0 }}\n\
             [[body]]\nname = \"floor\"\nplane = [0.0, 1.0, 0.0, 0.0]\n",
            lowest + drop
        );
        let height = |s: &State| s.nodes().map(|(m, x, _)| m * x.y).sum::<f64>() / s.nodes().map(|n| n.0).sum::<f64>();
        judge(&format!("block of {young:e} Pa from {drop} m, tilt {tilt}"), &text, 250, height);
    }
}
