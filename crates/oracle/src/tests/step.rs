//! Tests of the f64 reference implementation of a time step by implicit Euler: free fall, momentum, energy, and contact
//! and virtual coupling of the tool, a rigid body that the haptic device leads by a spring and damper.

use glam::{DMat3, DQuat, DVec3};
use palpate::internal::prepare::layer::kuhn_box;
use palpate::scene::{Coupling, Material};

use super::material;
use crate::contact::{Carrier, Contact, ContactLaw, Point, Support, Surface, Tested, gather_plane};
use crate::contact_law::{auto_stiffness, mean_edge};
use crate::skin;
use crate::step::{Simulation, SoftBody, TENSION_REMAINS};
use crate::testing::{Random, boundary};
use crate::tool::{Device, Tool, point_inertia, rotation_vector};

const GRAVITY: DVec3 = DVec3::new(0.0, -9.81, 0.0);
/// Relative tolerance for the rounding of a well-conditioned direct solve of a few hundred unknowns.
const SOLVE: f64 = 1e-10;

fn block(material: Material, position: DVec3, cells: u32) -> SoftBody {
    let layer = kuhn_box(DVec3::splat(-0.05), DVec3::splat(0.05), [cells; 3]);
    SoftBody::new(layer, material, position, DQuat::from_rotation_z(0.3), DVec3::new(0.1, 0.2, 0.3))
}

#[test]
fn free_fall_is_exact() {
    let mut simulation = Simulation::new(1e-3, GRAVITY);
    simulation.bodies.push(block(material(2e4, 0.45), DVec3::Y, 3));
    let before = simulation.bodies[0].world_nodes();
    let start = DVec3::new(0.1, 0.2, 0.3);
    let steps = 50;
    for _ in 0..steps {
        simulation.step(None, &[]).unwrap();
    }
    // In n steps of h seconds of implicit Euler, a point with initial velocity v0 travels n h v0 + h^2 g n (n + 1) / 2
    // under gravity g.
    let (n, h) = (f64::from(steps), 1e-3);
    let travel = n * h * start + h * h * GRAVITY * n * (n + 1.0) / 2.0;
    for (x0, x1) in before.iter().zip(simulation.bodies[0].world_nodes()) {
        assert!((x1 - *x0 - travel).length() < SOLVE * travel.length());
    }
    assert_eq!(simulation.solver.symbolic_count, 1, "the symbolic factorisation must be reused");
}

#[test]
fn free_bodies_keep_their_momentum_while_they_wobble() {
    let mut simulation = Simulation::new(1e-3, DVec3::ZERO);
    simulation.bodies.push(block(Material { damping_stiffness: 1e-3, ..material(2e4, 0.45) }, DVec3::Y, 3));
    let mut random = Random(3);
    simulation.bodies[0].displacement.iter_mut().for_each(|d| *d = 0.005 * random.vector());
    let (before, energy) = (simulation.bodies[0].momentum(), simulation.bodies[0].energy());
    let mut last = energy;
    for _ in 0..50 {
        simulation.step(None, &[]).unwrap();
        let now = simulation.bodies[0].energy();
        assert!(now <= last * (1.0 + SOLVE), "a step must not add energy: before it {last} J, after it {now} J");
        last = now;
    }
    assert!(last < 0.9 * energy, "the body must lose energy as it deforms");
    assert!((simulation.bodies[0].momentum() - before).length() < SOLVE * before.length());
}

#[test]
fn one_step_satisfies_the_equation_of_motion() {
    let damped = Material { damping_mass: 3.0, damping_stiffness: 2e-3, ..material(2e4, 0.4) };
    let mut simulation = Simulation::new(2e-3, GRAVITY);
    simulation.bodies.push(block(damped, DVec3::ZERO, 2));
    let body = &mut simulation.bodies[0];
    let mut random = Random(4);
    for i in 0..body.layer.nodes.len() {
        body.layer.attached[i] = body.layer.nodes[i].y < -0.04;
        if body.layer.attached[i] {
            body.velocity[i] = DVec3::ZERO;
        } else {
            body.displacement[i] = 0.005 * random.vector();
            body.velocity[i] = random.vector();
        }
    }
    let before = body.clone();
    simulation.step(None, &[]).unwrap();
    let after = &simulation.bodies[0];
    // Equation of motion with the linearised force at the end of a step of h seconds: M (v1 - v0) = h [M g + f(d0) +
    // h f'(v0) - h K (v1 - v0) - alpha M v1 - beta K v1], with masses M, gravity g, elastic force f at displacements d0
    // and its rate f' at velocities v0, stiffness K, damping coefficients alpha and beta, velocities v1 at the end.
    let (h, rotations) = (2e-3, before.rotations());
    let force = before.elements.forces(&before.displacement, &rotations);
    let rates = before.elements.force_rates(&before.displacement, &rotations, &before.velocity);
    let elements = before.elements.linearised(&before.displacement, &rotations);
    let change: Vec<DVec3> = after.velocity.iter().zip(&before.velocity).map(|(v1, v0)| *v1 - *v0).collect();
    let stiff = elements.apply_stiffness(&change, &rotations);
    let viscous = elements.viscous_forces(&after.velocity, &rotations);
    for i in (0..force.len()).filter(|i| !before.layer.attached[*i]) {
        let m = before.elements.masses[i];
        let v1 = after.velocity[i];
        let elastic = force[i] + h * rates[i] - h * stiff[i] - viscous[i];
        let right = h * (m * GRAVITY + elastic - 3.0 * m * v1);
        assert!((m * (v1 - before.velocity[i]) - right).length() < SOLVE * right.length().max(m));
    }
    for i in (0..force.len()).filter(|i| before.layer.attached[*i]) {
        assert_eq!(after.displacement[i], DVec3::ZERO);
    }
}

fn on_floor(simulation: &Simulation, triangles: &[[u32; 3]], areas: &[f64], law: &ContactLaw) -> Vec<Contact> {
    let body = &simulation.bodies[0];
    let embedding = skin::node_embedding(&body.layer);
    let support = Support::Soft(0, &body.layer, &embedding);
    gather_plane(&Surface { positions: body.world_nodes(), triangles, areas, support }, DVec3::Y, 0.0, law)
}

#[test]
fn a_block_dropped_on_a_plane_never_rebounds_higher() {
    let start = 0.08;
    let mut simulation = Simulation::new(1e-3, GRAVITY);
    let layer = kuhn_box(DVec3::splat(-0.05), DVec3::splat(0.05), [4; 3]);
    let material = material(2e4, 0.4);
    let triangles = boundary(&layer);
    let areas = skin::areas(&layer.nodes, &triangles);
    let stiffness = auto_stiffness(&[(&layer, &material)]).unwrap();
    let law = ContactLaw { stiffness, damping: stiffness * 1e-3, depth_limit: 0.05 };
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.2, 0.1, 0.3);
    simulation.bodies.push(SoftBody::new(layer, material, DVec3::Y * start, turn, DVec3::ZERO));
    let energy = |s: &Simulation| {
        let body = &s.bodies[0];
        let fall = |(x, m): (&DVec3, &f64)| 9.81 * x.y * m;
        body.energy() + body.world_nodes().iter().zip(&body.elements.masses).map(fall).sum::<f64>()
    };
    let first = energy(&simulation);
    let (mut last, mut contacts, mut deepest) = (first, 0, 0.0f64);
    for _ in 0..400 {
        let gathered = on_floor(&simulation, &triangles, &areas, &law);
        deepest = gathered.iter().map(|c| c.depth).fold(deepest, f64::max);
        let report = simulation.step(None, &gathered).unwrap();
        contacts += gathered.len();
        // `now` includes the energy stored in the contacts' penalty springs at the end of the step.
        let rest = on_floor(&simulation, &triangles, &areas, &law);
        let stored: f64 = rest.iter().map(|c| 0.5 * c.stiffness * c.area * c.depth * c.depth).sum();
        let now = energy(&simulation) + stored;
        last = now;
        assert!(now <= first * (1.0 + 1e-6), "energy {now} J exceeds the initial energy {first} J");
        assert!(report.contacts.iter().all(|c| c.force >= 0.0));
    }
    println!(
        "dropped block: energy at the start {first:.4} J, at the end {last:.4} J; contacts in all steps {contacts}, \
         greatest depth {:.2} mm",
        deepest * 1e3
    );
    assert!(contacts > 100 && deepest < 0.01);
}

#[test]
fn a_resting_block_is_carried_by_its_weight() {
    let mut simulation = Simulation::new(5e-3, GRAVITY);
    let layer = kuhn_box(DVec3::splat(-0.05), DVec3::splat(0.05), [3; 3]);
    let material = Material { damping_mass: 20.0, ..material(2e4, 0.3) };
    let triangles = boundary(&layer);
    let areas = skin::areas(&layer.nodes, &triangles);
    let stiffness = auto_stiffness(&[(&layer, &material)]).unwrap();
    let law = ContactLaw { stiffness, damping: stiffness * 5e-3, depth_limit: 0.05 };
    simulation.bodies.push(SoftBody::new(layer, material, DVec3::Y * 0.0501, DQuat::IDENTITY, DVec3::ZERO));
    let mut force = 0.0;
    for _ in 0..600 {
        let gathered = on_floor(&simulation, &triangles, &areas, &law);
        let report = simulation.step(None, &gathered).unwrap();
        force = report.contacts.iter().map(|c| c.force).sum();
    }
    println!("resting block: contact force {force:.6} N, weight {:.6} N", 9.81);
    assert!((force - 9.81).abs() < 1e-3 * 9.81);
}

fn coupled_tool() -> Tool {
    let mut tool = Tool::sphere(0.01, 0.05, DVec3::new(0.1, 0.2, 0.3));
    tool.inertia =
        DMat3::from_diagonal(DVec3::new(2e-6, 3e-6, 4e-6)) + point_inertia(0.001, DVec3::new(0.01, 0.02, 0.0));
    tool.orientation = DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -0.3, 0.2);
    tool.coupling = Some(Coupling { stiffness: 500.0, damping: 2.0, angular_stiffness: 0.5, angular_damping: 0.002 });
    tool
}

#[test]
fn the_tool_comes_to_rest_on_the_device() {
    let mut simulation = Simulation::new(1e-3, DVec3::ZERO);
    simulation.tool = Some(coupled_tool());
    let target = Device {
        position: DVec3::new(0.11, 0.19, 0.3),
        orientation: DQuat::from_rotation_y(0.6),
        velocity: DVec3::ZERO,
        angular_velocity: DVec3::ZERO,
    };
    let mut simulation_step = || simulation.step(Some(&target), &[]).unwrap();
    for _ in 0..2000 {
        simulation_step();
    }
    let tool = simulation.tool.as_ref().unwrap();
    assert!((tool.centre - target.position).length() < 1e-9);
    assert!(rotation_vector(target.orientation * tool.orientation.conjugate()).length() < 1e-9);
    let (force, torque) = tool.coupling_wrench(&target);
    assert!(force.length() < 1e-6 && torque.length() < 1e-9);
}

#[test]
fn a_coupled_step_applies_the_force_of_its_end() {
    let mut simulation = Simulation::new(1e-3, GRAVITY);
    let mut tool = coupled_tool();
    tool.velocity = DVec3::new(0.3, -0.1, 0.2);
    simulation.tool = Some(tool);
    let device = Device {
        position: DVec3::new(0.12, 0.18, 0.33),
        orientation: DQuat::from_rotation_y(0.1),
        velocity: DVec3::X,
        angular_velocity: DVec3::Y,
    };
    let before = simulation.tool.clone().unwrap();
    simulation.step(Some(&device), &[]).unwrap();
    let after = simulation.tool.as_ref().unwrap();
    let (force, _) = after.coupling_wrench(&device);
    let momentum = before.mass * (after.velocity - before.velocity);
    let impulse = 1e-3 * (force + before.mass * GRAVITY);
    assert!((momentum - impulse).length() < SOLVE * impulse.length());
}

#[test]
fn a_contact_pair_keeps_momentum_and_counts_no_pull() {
    let mut simulation = Simulation::new(1e-3, DVec3::ZERO);
    simulation.bodies.push(block(material(2e4, 0.45), DVec3::ZERO, 2));
    let mut tool = Tool::sphere(0.02, 0.05, DVec3::new(0.01, 0.08, 0.0));
    tool.velocity = DVec3::new(0.1, -0.5, 0.0);
    simulation.tool = Some(tool);
    let position = simulation.bodies[0].world_nodes()[13];
    let contact = |node: u32, depth: f64| Contact {
        normal: DVec3::NEG_Y,
        area: 1e-4,
        depth,
        stiffness: 5e6,
        damping: 5e3,
        first: Point { position, carrier: Carrier::Tool },
        second: Point {
            position: position + depth * DVec3::Y,
            carrier: Carrier::Nodes(0, vec![(node, 0.5), (node + 1, 0.5)]),
        },
        of_first: true,
        tested: Tested::Vertex(node),
    };
    let momentum = |s: &Simulation| s.bodies[0].momentum() + s.tool.as_ref().unwrap().velocity * 0.05;
    let before = momentum(&simulation);
    let u0 = simulation.tool.as_ref().unwrap().velocity;
    let contacts = [contact(13, 1e-3), contact(16, -5e-3)];
    let report = simulation.step(None, &contacts).unwrap();
    assert!((momentum(&simulation) - before).length() < SOLVE * before.length());
    assert!(report.contacts[0].active && report.contacts[0].force > 0.0);
    assert!(!report.contacts[1].active && report.contacts[1].force == 0.0, "a contact across a gap must be inactive");
    assert_eq!(report.flags & TENSION_REMAINS, 0);
    // The report's wrench (force and torque) is what the solver applied: nothing else changes the free tool's momentum.
    let change = 0.05 * (simulation.tool.as_ref().unwrap().velocity - u0) / 1e-3;
    assert!(
        (report.wrench.force - change).length() < SOLVE * change.length(),
        "force {} N, expected {change} N",
        report.wrench.force
    );
    assert!(report.wrench.torque.length() > 0.0);
    let k = report.wrench.stiffness;
    assert!((k[1][1] - 5e6 * 1e-4).abs() < SOLVE * 500.0 && k[0][0] == 0.0);
}

#[test]
fn auto_stiffness_follows_the_softer_body() {
    let layer = kuhn_box(DVec3::ZERO, DVec3::ONE, [1; 3]);
    // A Kuhn cell (a cube of six tetrahedra) has 12 edges, 6 face diagonals and one body diagonal.
    let edge = (12.0 + 6.0 * 2f64.sqrt() + 3f64.sqrt()) / 19.0;
    assert!((mean_edge(&layer) - edge).abs() < SOLVE);
    let (soft, hard) = (material(1e4, 0.5 - 0.1), material(1e6, 0.3));
    let expected = 20.0 * 1e4 / (1.0 - 0.16) / edge;
    let auto = auto_stiffness(&[(&layer, &hard), (&layer, &soft)]).unwrap();
    assert!((auto - expected).abs() < SOLVE * expected);
    assert_eq!(auto_stiffness(&[]), None);
}

#[test]
fn ten_thousand_tetrahedra_take_twenty_steps_in_seconds() {
    let layer = kuhn_box(DVec3::ZERO, DVec3::splat(0.1), [12; 3]);
    assert_eq!(layer.tetrahedra.len(), 10_368);
    let mut simulation = Simulation::new(1e-3, GRAVITY);
    let mut body = SoftBody::new(layer, material(2e4, 0.45), DVec3::ZERO, DQuat::IDENTITY, DVec3::ZERO);
    body.layer.attached = body.layer.nodes.iter().map(|x| x.x == 0.0).collect();
    simulation.bodies.push(body);
    let clock = std::time::Instant::now();
    for _ in 0..20 {
        simulation.step(None, &[]).unwrap();
    }
    let time = clock.elapsed().as_secs_f64();
    println!("20 steps of 10,368 tetrahedra take {time:.2} s");
    assert!(simulation.bodies[0].displacement.iter().any(|d| d.y < -1e-4), "the block must sag");
    // The limit is generous, because a busy machine is several times slower than an idle one.
    assert!(time < 120.0);
}
