//! Tests of whole scenes in f64: two soft blocks in contact, and a rigid tool that a haptic device presses into a soft
//! block by virtual coupling (spring and damper).

use glam::{DQuat, DVec3};
use palpate::internal::prepare::layer::kuhn_box;
use palpate::scene::Coupling;

use super::contact::sphere;
use super::material;
use crate::contact::{Contact, ContactLaw, Support, Surface, gather};
use crate::contact_law::auto_stiffness;
use crate::skin;
use crate::step::{Simulation, SoftBody};
use crate::testing::boundary;
use crate::tool::{Device, Tool};

/// Relative tolerance for the rounding of a direct solve of a few thousand unknowns.
const SOLVE: f64 = 1e-9;

/// A soft cube from -`half` to `half` (m) about `centre`, with `cells` cells along each side.
fn block(half: f64, cells: u32, centre: DVec3, velocity: DVec3) -> SoftBody {
    let layer = kuhn_box(DVec3::splat(-half), DVec3::splat(half), [cells; 3]);
    SoftBody::new(layer, material(2e4, 0.4), centre, DQuat::IDENTITY, velocity)
}

fn law(body: &SoftBody) -> ContactLaw {
    let stiffness = auto_stiffness(&[(&body.layer, &body.elements.materials[0])]).unwrap();
    ContactLaw { stiffness, damping: stiffness * 1e-3, depth_limit: 0.02 }
}

#[test]
fn two_blocks_in_contact_keep_their_momentum() {
    let mut simulation = Simulation::new(1e-3, DVec3::ZERO);
    simulation.bodies.push(block(0.05, 3, DVec3::ZERO, DVec3::Y * 0.5));
    simulation.bodies.push(block(0.05, 4, DVec3::new(0.013, 0.1005, 0.02), DVec3::ZERO));
    let law = law(&simulation.bodies[0]);
    let skins: Vec<_> = simulation.bodies.iter().map(|b| boundary(&b.layer)).collect();
    let areas: Vec<_> = simulation.bodies.iter().zip(&skins).map(|(b, t)| skin::areas(&b.layer.nodes, t)).collect();
    let start: DVec3 = simulation.bodies.iter().map(SoftBody::momentum).sum();
    let mut touched = 0;
    for _ in 0..60 {
        let embeddings: Vec<_> = simulation.bodies.iter().map(|b| skin::node_embedding(&b.layer)).collect();
        let surface = |i: usize| Surface {
            positions: simulation.bodies[i].world_nodes(),
            triangles: &skins[i],
            areas: &areas[i],
            support: Support::Soft(i, &simulation.bodies[i].layer, &embeddings[i]),
        };
        let contacts: Vec<Contact> = gather(DVec3::Y, &surface(0), &surface(1), &law);
        touched += contacts.len();
        simulation.step(None, &contacts).unwrap();
        let now: DVec3 = simulation.bodies.iter().map(SoftBody::momentum).sum();
        assert!((now - start).length() < SOLVE * start.length(), "momentum {now} kg m/s, expected {start} kg m/s");
    }
    let passed = simulation.bodies[1].momentum().y / start.y;
    println!("two blocks: {touched} contacts in 60 steps; the second block's share of the momentum is {passed:.3}");
    assert!(touched > 100 && passed > 0.5, "the blocks must collide");
}

#[test]
fn the_wrench_at_rest_balances_the_coupling() {
    let mut simulation = Simulation::new(2e-3, DVec3::ZERO);
    let mut body = block(0.05, 6, DVec3::ZERO, DVec3::ZERO);
    body.layer.attached = body.layer.nodes.iter().map(|x| x.y < -0.049).collect();
    body.elements.damping = body.elements.masses.iter().map(|mass| 20.0 * mass).collect();
    let law = law(&body);
    simulation.bodies.push(body);
    let mut tool = Tool::sphere(0.02, 0.05, DVec3::new(0.004, 0.0701, -0.003));
    tool.coupling = Some(Coupling { stiffness: 500.0, damping: 2.0, angular_stiffness: 0.5, angular_damping: 0.002 });
    simulation.tool = Some(tool);
    let (local, triangles) = sphere(0.02, DVec3::ZERO, 4);
    let tool_areas = skin::areas(&local, &triangles);
    let skin = boundary(&simulation.bodies[0].layer);
    let areas = skin::areas(&simulation.bodies[0].layer.nodes, &skin);
    let still = (DVec3::ZERO, DVec3::ZERO);
    let (position, orientation) = (DVec3::new(0.004, 0.064, -0.003), DQuat::IDENTITY);
    let device = Device { position, orientation, velocity: still.0, angular_velocity: still.1 };
    let mut wrench = Default::default();
    for _ in 0..400 {
        let body = &simulation.bodies[0];
        let embedding = skin::node_embedding(&body.layer);
        let tool = simulation.tool.as_ref().unwrap();
        let a = Surface {
            positions: local.iter().map(|x| tool.place(*x)).collect(),
            triangles: &triangles,
            areas: &tool_areas,
            support: Support::Tool,
        };
        let support = Support::Soft(0, &body.layer, &embedding);
        let b = Surface { positions: body.world_nodes(), triangles: &skin, areas: &areas, support };
        let contacts = gather(DVec3::NEG_Y, &a, &b, &law);
        wrench = simulation.step(Some(&device), &contacts).unwrap().wrench;
    }
    let (pull, twist) = simulation.tool.as_ref().unwrap().coupling_wrench(&device);
    println!("force on the tool: by the contacts {:.5} N, by the coupling {:.5} N", wrench.force, pull);
    assert!(wrench.force.y > 0.1, "the block must push the tool up");
    assert!((wrench.force + pull).length() < 1e-3 * pull.length());
    assert!((wrench.torque + twist).length() < 1e-3 * pull.length() * 0.02);
    for i in 0..6 {
        assert!(wrench.stiffness[i][i] >= 0.0);
        assert!((0..6).all(|j| wrench.stiffness[i][j] == wrench.stiffness[j][i]));
    }
}
