//! Invariants of whole steps that need no comparison with a reference implementation: momentum is conserved, results
//! are the same in every place and every run, no GPU work and memory is spent that a scene does not need, and no step
//! blows up. The tool is the rigid body that the haptic device leads. A rigid core is a rigid body inside a soft one,
//! to which nodes are attached.

use std::collections::BTreeSet;

use glam::{DQuat, DVec3};
use palpate::internal::stages::depth;
use palpate::{Flags, Scene, Simulation, StepReport, StepWork};
use palpate_oracle as oracle;

use crate::invariant::motion::own_impulse;
use crate::scene::touch::{Place, press};
use crate::scene::whole_step::{open, relative_error, run, scene, soft_twin};

/// The state of the first body and of the tool at one moment. `twin` is a copy of the body for the oracle, the
/// reference implementation in f64, which computes momentum and energy from it.
pub struct State {
    twin: oracle::step::SoftBody,
    pub tool: Option<palpate::internal::step::tool::Tool>,
}

impl State {
    pub fn of(simulation: &Simulation) -> State {
        let mut twin = soft_twin(simulation, 0);
        (twin.displacement, twin.velocity) = simulation.nodes(0).unwrap().unwrap();
        State { twin, tool: simulation.tool().cloned() }
    }

    /// Mass, position and velocity of each free node (a node that is not attached to a rigid core).
    pub fn nodes(&self) -> impl Iterator<Item = (f64, DVec3, DVec3)> {
        let free = self.twin.layer.attached.iter().map(|bound| !bound);
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

    /// Kinetic, elastic and gravitational energy of free nodes and tool, J.
    pub fn energy(&self, gravity: DVec3) -> f64 {
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

/// Extent of the soft block of these tests, as a key of a body's `layer` table in the scene file.
pub const BLOCK: &str = "box = [[-0.05, -0.05, -0.05], [0.05, 0.05, 0.05]]";

/// A scene of a free block that flies into a free sphere (the tool) at rest, off its centre.
fn collision(young: f64) -> String {
    format!(
        "[step]\ngravity = [0.0, 0.0, 0.0]\n[solver]\ntolerance = 1e-6\nmax_iterations = 1000\n[[body]]\nname = \
         \"block\"\n\
         layer = {{ {BLOCK}, cells = [5, 5, 5] }}\nvelocity = [0.1, 0.5, 0.0]\n\
         material = {{ young = {young:e}, poisson = 0.4, density = 1000.0 }}\n\
         [tool]\nsphere = 0.02\nmass = 0.3\nposition = [0.015, 0.072, -0.01]\n"
    )
}

/// Greatest change of linear momentum in a step, and also over all steps, relative to the block's momentum at the
/// start. It is not zero, because velocities are f32 (relative rounding error 6e-8), and because the solver leaves an
/// error of 1e-6 of a step's impulse, which the next step corrects.
const MOMENTUM: f64 = 5.0e-7;
/// Greatest change of angular momentum in a step, relative to the block's linear momentum at the start times half its
/// edge. It is not zero for the reasons given at `MOMENTUM`.
const SPIN: f64 = 5.0e-7;

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
            // The linearised forces at the end of the step act where the nodes are at its start, which gives a net
            // torque. Its angular impulse is subtracted here; the rest must be conserved, because all other forces act
            // in pairs along one line.
            let turn = own_impulse(&before.twin, &after.twin, DVec3::ZERO, scene.step.dt);
            method = method.max(turn.length());
            twist = twist.max((l1 - l0 - turn).length());
            contacts = contacts.max(row.contacts.unwrap());
            force = force.max(row.tool.unwrap().force.length());
            before = after;
        }
        let (size, arm) = (start.length(), 0.05);
        println!(
            "momentum, Young's modulus {young:e} Pa: linear {size:.3} kg m/s, relative change {:.1e} in a step, {:.1e} \
             over all steps; angular, relative to the linear one times 0.05 m: change {:.1e} in a step apart from the \
             method's own torque, {:.1e} by that torque, {:.1e} over all steps; up to {contacts} contacts, force up to \
             {force:.1} N",
            worst / size,
            drift / size,
            twist / (size * arm),
            method / (size * arm),
            before.momentum().1.distance(spin) / (size * arm),
        );
        // The sphere meets six triangles of the coarse block, and each is one contact.
        assert!(
            contacts > 4 && force > 1.0 && before.tool.unwrap().velocity.length() > 0.1,
            "the block did not hit the tool"
        );
        assert!(worst < MOMENTUM * size && drift < MOMENTUM * size && twist < SPIN * size * arm);
    }
}

/// Step reports, without their wall time, as text. Two texts differ where any bit of the reports differs, since the
/// debug form of an f64 is the shortest text that reads back as that number.
fn bits(rows: &[StepReport]) -> Vec<String> {
    rows.iter()
        .map(|row| format!("{:?}", StepReport { step_us: 0.0, work: StepWork::default(), ..row.clone() }))
        .collect()
}

#[test]
fn a_run_repeats_to_the_last_bit() {
    let slide = DVec3::new(0.012, 0.0, -0.007);
    let place = Place { turn: DQuat::from_rotation_z(0.5), slide, ..Place::default() };
    let scene = scene(&press(2.0e4, 0.001, place, ""));
    // The stage that finds penetration depths has two implementations, called paths: compute and graphics pipelines.
    for path in [depth::Path::Compute, depth::Path::Graphics] {
        let [(a, shape_a), (b, shape_b)] = [(), ()].map(|()| {
            let mut simulation = open(&scene, Some(path));
            let rows = run(&mut simulation, 45);
            (rows, format!("{:?}", simulation.nodes(0).unwrap()))
        });
        assert!(a[44].tool.unwrap().force.length() > 0.1, "the tool touched nothing");
        assert!(bits(&a) == bits(&b) && shape_a == shape_b, "two runs differ with the {} path", path.name());
    }
}

/// For the scene `text`: the stages (parts of a step) that the plan (the recorded GPU work of a step) contains, the
/// stages that have passes (dispatches, draws, fills or copies), and the number of bytes allocated on the GPU.
fn needs(text: &str) -> (Vec<&'static str>, Vec<String>, u64) {
    let simulation = open(&scene(text), None);
    let planned = simulation.plan().entries.iter().filter(|e| e.recorded).map(|e| e.stage).collect();
    let passes = simulation.passes(8).0.into_iter().filter(|(_, count)| *count > 0).map(|(name, _)| name).collect();
    (planned, passes, simulation.context().bytes_allocated())
}

/// Least number of bytes that the contact stages alone allocate for the sphere: for each of its vertices, 16 entries of
/// the lists that assign contacts to nodes (node, weight, sorted, next: together 20 bytes).
const TOUCH_BYTES: u64 = 2562 * 16 * 20;

#[test]
fn a_scene_records_and_allocates_only_what_it_needs() {
    let free = format!(
        "[[body]]\nname = \"block\"\nlayer = {{ {BLOCK}, cells = [5, 5, 5] }}\n\
         material = {{ young = 2e4, poisson = 0.4, density = 1000.0 }}\n"
    );
    let body = format!("{free}[[body.core]]\nname = \"core\"\nbind = {{ nodes = [0, 1, 2] }}\n");
    // The stage `fit` fits the rigid coordinate frame of a body without a rigid core to the body's nodes.
    assert_eq!(needs(&free).0, ["elastic", "solve", "fit"]);
    let alone = needs(&body);
    let floor = needs(&format!("{body}[[body]]\nname = \"floor\"\nplane = [0.0, 1.0, 0.0, -0.05]\n"));
    let sphere = "[tool]\nsphere = 0.02\nmass = 0.05\nposition = [0.0, 0.08, 0.0]\n";
    let tool = needs(&format!("[contact]\nsamples = \"vertices\"\n{body}{sphere}"));
    // The sphere is tested by triangles of this coarse skin.
    let triangles = needs(&format!("{body}{sphere}"));
    println!(
        "bytes allocated on the GPU for the block: {} alone, {} on a floor, {} with a tool, {} with one by triangles",
        alone.2, floor.2, tool.2, triangles.2
    );
    assert_eq!(alone.0, ["elastic", "solve"]);
    assert_eq!(floor.0, ["pose", "skin", "cull", "contact", "elastic", "solve"]);
    assert_eq!(tool.0, ["pose", "skin", "cull", "depth", "contact", "elastic", "solve", "wrench"]);
    assert_eq!(triangles.0, tool.0);
    for (planned, passes, _) in [&alone, &floor, &tool, &triangles] {
        let with_passes: BTreeSet<&str> = passes.iter().map(String::as_str).collect();
        assert_eq!(with_passes, planned.iter().copied().collect());
    }
    assert!(alone.2 + TOUCH_BYTES < tool.2 && alone.2 < floor.2 && floor.2 + TOUCH_BYTES < tool.2);
    assert!(alone.2 < triangles.2 && triangles.2 < tool.2);
}

/// Greatest difference, relative to the largest force, between the forces in a scene and in its copy one kilometre
/// away. Positions are f64 on the host and relative to the tool on the GPU. So the copy differs only by the rounding of
/// a kilometre in f64 (1e-13 m, while depths are millimetres) and by the last bit of f32 numbers that this rounding
/// changes.
const FAR: f64 = 1.0e-5;

#[test]
fn a_kilometre_away_the_forces_are_the_same() {
    let slide = DVec3::new(0.012, 0.0, -0.007);
    let here = Place { turn: DQuat::from_rotation_z(0.5), slide, ..Place::default() };
    let there = Place { shift: DVec3::new(1000.0, -1000.0, 1000.0), ..here };
    let [near, far] = [here, there].map(|place| {
        let rows = run(&mut open(&scene(&press(2.0e4, 0.001, place, "")), None), 60);
        rows.iter().flat_map(|r| r.tool.map(|t| [t.force, t.torque / 0.02])).flatten().collect::<Vec<_>>()
    });
    let error = relative_error(&far, &near);
    println!("a kilometre away: forces differ by {error:.1e} of the largest force");
    assert!(error < FAR);
}

/// Greatest allowed distance of the tool from the haptic device, and of a node from its rest position, m: a little more
/// than the 4.5 mm by which the device moves.
const BOUND: f64 = 0.005;

#[test]
#[ignore = "long: 20 s"]
fn lasting_a_press_stays_finite_for_all_stiffnesses_and_steps() {
    for young in [1.0e3, 1.0e4, 1.0e5, 1.0e6, 1.0e7] {
        for dt in [2.5e-4, 1.0e-3, 3.0e-3, 1.0e-2] {
            let scene: Scene = scene(&press(young, dt, Place::default(), ""));
            let mut simulation = open(&scene, None);
            let rows = run(&mut simulation, ((0.06 / dt) as usize).clamp(30, 60));
            let (moved, _) = simulation.nodes(0).unwrap().unwrap();
            let largest = moved.iter().map(|d| d.length()).fold(0.0, f64::max);
            let force: Vec<f64> = rows.iter().map(|r| r.tool.unwrap().force.length()).collect();
            let peak = force.iter().copied().fold(0.0, f64::max);
            let tool = rows.last().unwrap().tool.unwrap();
            let iterations = rows.iter().map(|r| r.iterations).max().unwrap();
            let off = tool.tool.position.distance(tool.device.position);
            println!(
                "Young's modulus {young:.0e} Pa, time step {:5.2} ms: force up to {peak:.3} N, tool {:.2} mm from the \
                 device, nodes moved by up to {:.2} mm, up to {iterations} solver iterations",
                dt * 1e3,
                off * 1e3,
                largest * 1e3,
            );
            assert!(
                rows.iter().all(|row| row.flags == Flags::default()),
                "a step raised flags at a Young's modulus of {young:e} Pa and a time step of {dt} s"
            );
            assert!(moved.iter().all(|d| d.is_finite()) && force.iter().all(|f| f.is_finite()));
            assert!(
                peak > 0.0 && off < BOUND && largest < BOUND,
                "no force, or too large motion, at a Young's modulus of {young:e} Pa and a time step of {dt} s"
            );
        }
    }
}
