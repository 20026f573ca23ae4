//! Tests of friction in the f64 reference implementation of a time step: Coulomb's law on a slope, momentum, and the
//! wrench (force and torque) on the tool, a rigid body that a haptic device may lead; here it moves freely.

use glam::{DMat3, DQuat, DVec3};
use palpate::internal::prepare::layer::kuhn_box;
use palpate::scene::Material;

use super::material;
use crate::contact::{Carrier, Contact, ContactLaw, Point, Support, Surface, Tested, gather_plane};
use crate::contact_law::Friction;
use crate::contact_law::auto_stiffness;
use crate::skin;
use crate::step::{Report, Simulation, SoftBody};
use crate::testing::boundary;
use crate::tool::Tool;

/// Tolerance for the rounding of a well-conditioned direct solve of a few hundred unknowns.
const SOLVE: f64 = 1e-10;
/// Regularised Coulomb friction: mu N v / sqrt(v^2 + speed^2) at normal force N and sliding velocity v, with mu the
/// coefficient of friction.
const FRICTION: Friction = Friction { coefficient: 0.4, speed: 1e-3 };
/// Time step, s.
const H: f64 = 1e-3;

/// Gravity, m/s^2, in the axes of a slope that falls along x; `tangent` is the tangent of the slope's angle.
fn slope(tangent: f64) -> DVec3 {
    9.81 * DVec3::new(tangent, -1.0, 0.0).normalize()
}

/// Velocity down the slope, m/s, after each of `steps` steps, of a rigid box of 0.2 kg (the tool) that slides on it.
fn slide(tangent: f64, steps: usize) -> Vec<f64> {
    let layer = kuhn_box(DVec3::new(-0.05, -0.02, -0.05), DVec3::new(0.05, 0.02, 0.05), [4, 2, 4]);
    let triangles = boundary(&layer);
    let areas = skin::areas(&layer.nodes, &triangles);
    let law = ContactLaw { stiffness: 2e6, damping: 2e6 * H, depth_limit: 0.02 };
    let mut simulation = Simulation::new(H, slope(tangent));
    simulation.friction = Some(FRICTION);
    let mut tool = Tool::sphere(0.02, 0.2, DVec3::Y * 0.0199);
    tool.inertia = DMat3::from_diagonal(DVec3::new(2e-4, 3.3e-4, 2e-4));
    simulation.tool = Some(tool);
    let mut step = || {
        let tool = simulation.tool.as_ref().unwrap();
        let positions = layer.nodes.iter().map(|x| tool.place(*x)).collect();
        let skin = Surface { positions, triangles: &triangles, areas: &areas, support: Support::Tool };
        let contacts = gather_plane(&skin, DVec3::Y, 0.0, &law);
        simulation.step(None, &contacts).unwrap();
        simulation.tool.as_ref().unwrap().velocity.x
    };
    (0..steps).map(|_| step()).collect()
}

#[test]
fn below_the_friction_angle_a_box_creeps_as_the_regularisation_says() {
    for tangent in [0.1, 0.3, 0.39] {
        let velocity = slide(tangent, 800)[799];
        // Friction and gravity along the slope balance: mu N v / sqrt(v^2 + speed^2) = N tangent, with normal force N
        // and coefficient of friction mu. The velocity v that solves this equation is `creep`.
        let creep = FRICTION.speed * tangent / (FRICTION.coefficient.powi(2) - tangent * tangent).sqrt();
        println!("slope of tangent {tangent}: velocity {velocity:.6e} m/s, by the regularised law {creep:.6e} m/s");
        assert!((velocity - creep).abs() < 1e-3 * creep);
    }
}

#[test]
fn above_the_friction_angle_a_box_slides_as_coulomb_says() {
    for tangent in [0.45, 0.6, 1.0] {
        let velocity = slide(tangent, 600);
        let cosine = 1.0 / tangent.hypot(1.0);
        let want = 9.81 * cosine * (tangent - FRICTION.coefficient);
        let got = (velocity[599] - velocity[299]) / (300.0 * H);
        println!(
            "slope of tangent {tangent}: acceleration {got:.4} m/s^2, by Coulomb's law {want:.4} m/s^2; velocity after \
             0.6 s {:.4} m/s, expected {:.4} m/s",
            velocity[599],
            0.6 * want
        );
        // The predicted speed is exact at constant acceleration.
        assert!((got - want).abs() < 2e-3 * want, "acceleration {got} m/s^2, expected {want} m/s^2");
    }
}

/// A moving soft block, and a contact of depth `deep` (m) between its node 13 and a point fixed in space.
fn pair(deep: f64) -> (Simulation, Contact) {
    let mut simulation = Simulation::new(H, DVec3::ZERO);
    simulation.friction = Some(FRICTION);
    let layer = kuhn_box(DVec3::splat(-0.05), DVec3::splat(0.05), [2; 3]);
    let turn = DQuat::from_rotation_z(0.3);
    simulation.bodies.push(SoftBody::new(layer, material(2e4, 0.45), DVec3::ZERO, turn, DVec3::new(0.1, 0.2, 0.3)));
    let position = simulation.bodies[0].world_node(13);
    let contact = Contact {
        normal: DVec3::NEG_Y,
        area: 1e-4,
        depth: deep,
        stiffness: 5e6,
        damping: 5e3,
        first: Point { position: position - deep * DVec3::Y, carrier: Carrier::Fixed },
        second: Point { position, carrier: Carrier::Nodes(0, vec![(13, 1.0)]) },
        of_first: true,
        tested: Tested::Vertex(13),
    };
    (simulation, contact)
}

/// Linear momentum (N s) of all nodes and the tool, and their angular momentum (N m s) about the tool's centre or,
/// without tool, about the origin. `places`: positions of each body's nodes relative to that point, m.
fn momentum(simulation: &Simulation, places: &[Vec<DVec3>]) -> (DVec3, DVec3) {
    let (mut linear, mut angular) = (DVec3::ZERO, DVec3::ZERO);
    for (body, places) in simulation.bodies.iter().zip(places) {
        for ((m, x), v) in body.elements.masses.iter().zip(places).zip(&body.velocity) {
            linear += *m * *v;
            angular += *m * x.cross(*v);
        }
    }
    if let Some(tool) = &simulation.tool {
        linear += tool.mass * tool.velocity;
        angular += tool.world_inertia() * tool.angular_velocity;
    }
    (linear, angular)
}

/// Takes one step; returns the changes of linear and angular momentum and the step's report. Both momenta are computed
/// with the nodes' positions at the start of the step.
fn changes(simulation: &mut Simulation, contact: Contact) -> (DVec3, DVec3, Report) {
    let places: Vec<_> = simulation.bodies.iter().map(|b| b.world_nodes()).collect();
    // Angular momentum is taken about the tool's centre or, without tool, about the origin.
    let centre = simulation.tool.as_ref().map_or(DVec3::ZERO, |t| t.centre);
    let places: Vec<Vec<_>> = places.iter().map(|p| p.iter().map(|x| *x - centre).collect()).collect();
    let before = momentum(simulation, &places);
    let report = simulation.step(None, &[contact]).unwrap();
    let after = momentum(simulation, &places);
    (after.0 - before.0, after.1 - before.1, report)
}

#[test]
fn a_tool_and_a_body_that_rub_keep_linear_and_angular_momentum() {
    let (mut simulation, mut contact) = pair(2e-3);
    let mut tool = Tool::sphere(0.02, 0.05, DVec3::new(0.01, 0.08, 0.0));
    tool.velocity = DVec3::new(0.8, -0.3, 0.1);
    simulation.tool = Some(tool.clone());
    contact.first.carrier = Carrier::Tool;
    let (linear, angular, report) = changes(&mut simulation, contact);
    let size = report.wrench.force.length() * H;
    assert!(
        linear.length() < SOLVE && angular.length() < SOLVE * 0.1,
        "linear momentum changes by {linear} N s, angular momentum by {angular} N m s; contact impulse {size} N s"
    );
    // The tool is free, so nothing but the contact's wrench changes its momentum.
    let end = simulation.tool.as_ref().unwrap();
    let force = 0.05 * (end.velocity - tool.velocity) / H;
    let torque = tool.world_inertia() * (end.angular_velocity - tool.angular_velocity) / H;
    let wrench = report.wrench;
    assert!((wrench.force - force).length() < 1e-9 * force.length(), "force {} N, expected {force} N", wrench.force);
    assert!(
        (wrench.torque - torque).length() < 1e-9 * torque.length(),
        "torque {} N m, expected {torque} N m",
        wrench.torque
    );
    let friction = report.contacts[0].friction;
    assert!(friction.x < 0.0 && friction.y.abs() < 1e-12 && friction.length() < 0.4 * report.contacts[0].force * 1.01);
    // Along x, a tangent of the contact, the tool's damping is the ratio of friction to sliding velocity.
    assert!((wrench.damping[0][0] - report.contacts[0].viscosity).abs() < 1e-12);
}

#[test]
fn two_bodies_that_rub_keep_linear_momentum_and_gain_the_couple_of_the_depth() {
    let (mut simulation, mut contact) = pair(2e-3);
    let layer = kuhn_box(DVec3::splat(-0.05), DVec3::splat(0.05), [2; 3]);
    let place = contact.second.position + DVec3::Y * 0.049;
    simulation.bodies.push(SoftBody::new(
        layer,
        material(2e4, 0.45),
        place,
        DQuat::IDENTITY,
        DVec3::new(1.0, -0.5, 0.0),
    ));
    contact.first.position = simulation.bodies[1].world_node(10);
    contact.second.position = contact.first.position + 2e-3 * DVec3::Y;
    let shift = contact.second.position - simulation.bodies[0].world_node(13);
    simulation.bodies[0].position += shift;
    contact.first.carrier = Carrier::Nodes(1, vec![(10, 1.0)]);
    let (linear, angular, report) = changes(&mut simulation, contact.clone());
    let friction = report.contacts[0].friction;
    let couple = H * (contact.first.position - contact.second.position).cross(friction);
    println!(
        "friction {friction} N; angular momentum changes by {angular} N m s, expected {couple} N m s from friction"
    );
    assert!(linear.length() < SOLVE && couple.length() > 1e-7);
    assert!((angular - couple).length() < SOLVE);
}

#[test]
fn a_block_thrown_on_a_plane_loses_energy_and_comes_to_rest() {
    let layer = kuhn_box(DVec3::splat(-0.05), DVec3::splat(0.05), [3; 3]);
    let material = Material { damping_mass: 2.0, damping_stiffness: 5e-3, ..material(5e4, 0.4) };
    let triangles = boundary(&layer);
    let areas = skin::areas(&layer.nodes, &triangles);
    let stiffness = auto_stiffness(&[(&layer, &material)]).unwrap();
    let law = ContactLaw { stiffness, damping: stiffness * H, depth_limit: 0.05 };
    let mut simulation = Simulation::new(H, slope(0.0));
    simulation.friction = Some(FRICTION);
    let velocity = DVec3::new(0.6, 0.0, 0.2);
    simulation.bodies.push(SoftBody::new(layer, material, DVec3::Y * 0.051, DQuat::IDENTITY, velocity));
    let energy = |s: &Simulation| {
        let body = &s.bodies[0];
        let fall = |(x, m): (&DVec3, &f64)| 9.81 * x.y * m;
        body.energy() + body.world_nodes().iter().zip(&body.elements.masses).map(fall).sum::<f64>()
    };
    let (first, mut last) = (energy(&simulation), f64::INFINITY);
    let (mut pushed, mut rubbed, mut worst) = (0.0, 0.0, 0.0f64);
    for _ in 0..800 {
        let body = &simulation.bodies[0];
        let embedding = skin::node_embedding(&body.layer);
        let support = Support::Soft(0, &body.layer, &embedding);
        let skin = Surface { positions: body.world_nodes(), triangles: &triangles, areas: &areas, support };
        let contacts = gather_plane(&skin, DVec3::Y, 0.0, &law);
        let report = simulation.step(None, &contacts).unwrap();
        last = energy(&simulation);
        assert!(last <= first * (1.0 + 1e-9), "energy {last} J exceeds the initial energy {first} J");
        let force: f64 = report.contacts.iter().map(|c| c.force).sum();
        let drag: f64 = report.contacts.iter().map(|c| c.friction.length()).sum();
        pushed += force;
        rubbed += drag;
        worst = if force > 1.0 { worst.max(drag / force) } else { worst };
    }
    let speed = simulation.bodies[0].momentum().reject_from_normalized(DVec3::Y).length();
    println!(
        "thrown block: energy at the start {first:.4} J, at the end {last:.4} J; horizontal momentum at the end \
         {speed:.1e} N s; ratio of friction to normal force: mean {:.3}, greatest {worst:.3}",
        rubbed / pushed
    );
    assert!(speed < 1e-4 && rubbed > 0.0);
}
