//! Tests of a tool (rigid body that the haptic device leads) that presses into a soft body. Each step is compared with
//! the f64 oracle (the reference implementation on the CPU), and both depth paths (graphics and compute implementation
//! of the depth stage) are compared with each other.

use glam::{DQuat, DVec3};
use palpate::internal::prepare::{self, Shape};
use palpate::internal::shaders::Contact;
use palpate::internal::stages::depth;
use palpate::scene::{Samples, Sides};
use palpate::{Flags, Scene, Simulation, StepReport};
use palpate_oracle as oracle;
use palpate_oracle::contact::{self, ContactLaw, Gathering, Support, Surface, Tested};
use palpate_oracle::contact_law::auto_stiffness;
use palpate_oracle::step::{self};

use crate::scene::whole_step::{open, relative_error, run, scene, soft_twin};

/// Where a press happens: the block is turned by `turn`, then shifted by `shift` (m), and the device's motion ends
/// `slide` (m) aside, in the block's axes.
#[derive(Debug, Clone, Copy, Default)]
pub struct Place {
    pub shift: DVec3,
    pub turn: DQuat,
    pub slide: DVec3,
}

/// Text of a scene in which a sphere of 20 mm radius is pressed into a block with a fixed bottom, from 0.5 mm above the
/// block to 4 mm deep in 40 ms, and then stays at rest. `young` is the block's Young's modulus (Pa), `dt` the time step
/// (s), `solver` text of the `[solver]` table.
pub fn press(young: f64, dt: f64, place: Place, solver: &str) -> String {
    let world = |local: DVec3| (place.shift + place.turn * local).to_array().map(|x| format!("{x:?}")).join(", ");
    let (origin, start) = (world(DVec3::ZERO), world(DVec3::Y * 0.0505));
    let end = world(DVec3::Y * 0.046 + place.slide);
    let turn = place.turn.to_array();
    format!(
        "[step]\ndt = {dt:?}\ngravity = [0.0, 0.0, 0.0]\n[solver]\n{solver}\n[[body]]\nname = \"block\"\n\
         layer = {{ box = [[-0.05, -0.03, -0.05], [0.05, 0.03, 0.05]], cells = [8, 5, 8] }}\n\
         position = [{origin}]\norientation = {turn:?}\n\
         material = {{ young = {young:e}, poisson = 0.45, density = 1000.0 }}\n\
         [[body.core]]\nname = \"bottom\"\nmotion = \"fixed\"\n\
         bind = {{ box = [[-0.06, -0.04, -0.06], [0.06, -0.029, 0.06]] }}\n\
         [tool]\nsphere = 0.02\nmass = 0.05\nposition = [{start}]\n\
         [coupling]\nstiffness = 500.0\ndamping = 2.0\nangular_stiffness = 0.5\nangular_damping = 0.002\n\
         [drive]\nkeys = [[0.0, {start}], [0.04, {end}]]\n"
    )
}

/// A scene with one soft body and a rigid tool as the oracle computes it. The oracle finds its own contacts; it takes
/// only the normal of the contact patch from the engine.
pub struct Twin {
    pub oracle: step::Simulation,
    skin: (prepare::Skin, Vec<prepare::Embedding>),
    tool: prepare::Skin,
    law: ContactLaw,
    gathering: Gathering,
}

impl Twin {
    pub fn new(scene: &Scene, simulation: &Simulation) -> Twin {
        let mut oracle = step::Simulation::new(scene.step.dt, scene.step.gravity);
        oracle.bodies.push(soft_twin(simulation, 0));
        let body = prepare::tool(scene.tool.as_ref().unwrap(), scene).unwrap();
        let gathering = Gathering::chosen(&scene.contact, &simulation.bodies()[0], &body);
        let Shape::Rigid { skin: tool, centroid, volume, inertia, .. } = body.shape else { panic!("the tool is soft") };
        let tool = prepare::Skin { vertices: tool.vertices.iter().map(|x| *x - centroid).collect(), ..tool };
        let mass = scene.tool.as_ref().unwrap().mass;
        oracle.tool = Some(oracle::tool::Tool {
            mass,
            inertia: inertia * (mass / volume),
            centre: body.position,
            orientation: body.orientation,
            velocity: body.velocity,
            angular_velocity: DVec3::ZERO,
            coupling: scene.coupling,
        });
        let Shape::Soft { layer, materials, skin, embedding, .. } = &simulation.bodies()[0].shape else {
            panic!("the body is rigid")
        };
        let stiffness = auto_stiffness(&[(layer, &materials.all[0])]).unwrap();
        let law = ContactLaw { stiffness, damping: stiffness * scene.step.dt, depth_limit: scene.contact.depth_limit };
        Twin { oracle, skin: (skin.clone(), embedding.clone()), tool, law, gathering }
    }

    /// Contacts of the oracle's present state along `normal` (from the body to the tool).
    pub fn contacts(&self, normal: DVec3) -> Vec<contact::Contact> {
        let tool = self.oracle.tool.as_ref().unwrap();
        let tool = Surface {
            positions: self.tool.vertices.iter().map(|x| tool.place(*x)).collect(),
            triangles: &self.tool.triangles,
            areas: &self.tool.areas,
            support: Support::Tool,
        };
        let body = self.oracle.bodies[0].surface(0, &self.skin.0, &self.skin.1);
        self.gathering.contacts(normal, &body, &tool, &self.law)
    }
}

/// The greatest depth (m) and the number of contacts that only the engine (`device`) or only the oracle (`twin`) has.
/// `tool_vertex_first` is the number of the tool's first vertex in the engine, `None` if triangles are tested.
fn unmatched(device: &[Contact], twin: &[contact::Contact], tool_vertex_first: Option<u32>) -> (f64, usize) {
    let of_device = |c: &Contact| {
        let of_tool = c.side % 2 == 1;
        let tested = match tool_vertex_first {
            None => (false, c.triangle),
            Some(first) => (of_tool, c.vertex - if of_tool { first } else { 0 }),
        };
        (tested, f64::from(c.depth))
    };
    let of_twin = |c: &contact::Contact| match c.tested {
        Tested::Vertex(i) | Tested::Triangle(i) => ((!c.of_first, i), c.depth),
    };
    let a: std::collections::BTreeMap<_, _> = device.iter().map(of_device).collect();
    let b: std::collections::BTreeMap<_, _> = twin.iter().map(of_twin).collect();
    let only = |x: &std::collections::BTreeMap<_, f64>, y: &std::collections::BTreeMap<_, f64>| -> Vec<f64> {
        x.iter().filter(|(key, _)| !y.contains_key(*key)).map(|(_, depth)| *depth).collect()
    };
    let lone = [only(&a, &b), only(&b, &a)].concat();
    (lone.iter().copied().fold(0.0, f64::max), lone.len())
}

/// Number of steps of the press: approach, press, rest.
const PRESS_STEPS: usize = 60;
const TIGHT: &str = "tolerance = 1e-6\nmax_iterations = 1000";
/// Greatest allowed error of the force on the tool, relative to the largest force of the run.
const FORCE: f64 = 5.0e-5;
/// Greatest allowed error of the tool's position, relative to the greatest distance from its start.
const POSE: f64 = 1.0e-5;
/// Greatest allowed error of node displacements, relative to the largest displacement, by vertices and by triangles. By
/// triangles it is greatest in the first step of contact, when displacements are smallest: heights are known to some 1e-8
/// m, and a contact of a triangle takes in many of them.
pub const DISPLACEMENT: [f64; 2] = [5.0e-5, 1.0e-4];
/// Greatest depth of a contact that only the engine or only the oracle finds, m.
const LONE_DEPTH: f64 = 1.0e-7;

#[test]
#[ignore = "long: 30 s"]
fn touch_agrees_with_the_oracle_and_the_depth_paths_with_each_other() {
    let straight = Place::default();
    let slide = DVec3::new(0.012, 0.0, -0.007);
    let oblique = Place { shift: DVec3::new(0.3, -0.1, 0.2), turn: DQuat::from_rotation_z(0.5), slide };
    let vertices = [Sides::Both, Sides::One].map(|sides| (sides, Samples::Vertices));
    let [both, one] = vertices;
    // By default triangles of this coarse skin are tested.
    let auto = (Sides::Both, Samples::Auto);
    let cases = [
        (2.0e4, straight, both),
        (5.0e5, straight, both),
        (2.0e4, oblique, both),
        (2.0e4, oblique, one),
        (5.0e5, straight, auto),
        (2.0e4, oblique, auto),
    ];
    for (young, place, (sides, samples)) in cases {
        let mut scene = scene(&press(young, 0.001, place, TIGHT));
        (scene.contact.sides, scene.contact.samples) = (sides, samples);
        let paths = [depth::Path::Compute, depth::Path::Graphics];
        let [(compute, found), (graphics, found_too)] = paths.map(|path| against_the_oracle(&scene, path, young));
        assert_eq!(found, found_too, "contacts of the compute path (left) and the graphics path (right)");
        let force = |rows: &[StepReport]| -> Vec<DVec3> { rows.iter().map(|r| r.tool.unwrap().force).collect() };
        let error = relative_error(&force(&compute), &force(&graphics));
        println!("touch at {young:e} Pa: relative difference of the forces of compute and graphics path {error:.1e}");
        assert!(error < FORCE);
    }
}

/// Side (even: vertex of the soft body, odd: of the tool) and vertex of every contact, by step.
type Found = Vec<Vec<(u32, u32)>>;

fn against_the_oracle(scene: &Scene, path: depth::Path, young: f64) -> (Vec<StepReport>, Found) {
    let mut simulation = open(scene, Some(path));
    let mut twin = Twin::new(scene, &simulation);
    let by_triangles = matches!(twin.gathering, Gathering::Triangles(_));
    assert_eq!(by_triangles, scene.contact.samples == Samples::Auto);
    let skin_vertices = (!by_triangles).then_some(twin.skin.0.vertices.len() as u32);
    let (mut rows, mut found, mut lone) = (Vec::new(), Found::new(), (0.0f64, 0));
    let (mut forces, mut poses, mut shapes) = ((vec![], vec![]), (vec![], vec![]), 0.0f64);
    let mut tilt = 0.0f64;
    for _ in 0..PRESS_STEPS {
        let row = run(&mut simulation, 1).remove(0);
        let (contact_patches, contacts) = simulation.touch().unwrap();
        let normal = DVec3::from(contact_patches[0].normal.map(f64::from)).normalize();
        tilt = tilt.max(normal.distance(twin.oracle.bodies[0].elements.frame * DVec3::Y));
        let own = twin.contacts(normal);
        let (depth, count) = unmatched(&contacts, &own, skin_vertices);
        lone = (lone.0.max(depth), lone.1 + count);
        found.push(contacts.iter().map(|c| (c.side, c.vertex)).collect());
        let tool = row.tool.unwrap();
        let h = scene.step.dt;
        let device = palpate::internal::step::trajectory::Trajectory::new(&scene.trajectory, scene.trajectory[0])
            .device(row.time, h);
        let device = oracle::tool::Device {
            position: device.position,
            orientation: device.orientation,
            velocity: device.velocity,
            angular_velocity: device.angular_velocity,
        };
        let report = twin.oracle.step(Some(&device), &own).unwrap();
        forces.0.push(tool.force);
        forces.1.push(report.wrench.force);
        poses.0.push(tool.tool.position - scene.trajectory[0].position);
        poses.1.push(twin.oracle.tool.as_ref().unwrap().centre - scene.trajectory[0].position);
        let (moved, _) = simulation.nodes(0).unwrap().unwrap();
        let want = &twin.oracle.bodies[0].displacement;
        if want.iter().any(|d| *d != DVec3::ZERO) {
            shapes = shapes.max(relative_error(&moved, want));
        }
        rows.push(row);
    }
    let (force, pose) = (relative_error(&forces.0, &forces.1), relative_error(&poses.0, &poses.1));
    let peak = forces.1.iter().map(|f| f.length()).fold(0.0, f64::max);
    println!(
        "touch at {young:e} Pa, {} path: greatest force {peak:.2} N; relative errors of force {force:.1e}, of the \
         tool's position {pose:.1e}, of displacements {shapes:.1e}; up to {} contacts in a step; {} contacts found by \
         engine or oracle alone, up to {:.1e} m deep; unit vectors of the contact normal and of the \
         normal of the block's top differ by {tilt:.1e}; up to {} solver iterations",
        path.name(),
        found.iter().map(Vec::len).max().unwrap(),
        lone.1,
        lone.0,
        rows.iter().map(|r| r.iterations).max().unwrap()
    );
    assert!(peak > 0.05 && rows.iter().all(|row| row.flags == Flags::default()));
    let gathers = |side: u32| found.iter().flatten().any(|(s, _)| *s == side);
    assert_eq!(
        gathers(0) && gathers(1),
        twin.gathering == Gathering::Both,
        "vertices of both bodies must become contacts exactly if `sides` is \"both\""
    );
    let displacement = DISPLACEMENT[usize::from(by_triangles)];
    assert!(lone.0 < LONE_DEPTH && force < FORCE && pose < POSE && shapes < displacement);
    (rows, found)
}
