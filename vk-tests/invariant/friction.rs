//! Friction in whole steps: Coulomb's law on a slope, agreement of every step with the oracle (the reference
//! implementation in f64), and the momentum of free bodies that collide. The oracle's copy of a scene is called its
//! twin. The tool is the rigid body, or the core (rigid body inside a soft one), that the haptic device leads through a
//! virtual coupling (spring and damper). A contact patch is a place with one normal where two bodies may touch.

use std::collections::BTreeMap;

use glam::{DQuat, DVec3};
use palpate::internal::prepare::{self, Embedding, Shape, Skin};
use palpate::internal::stages::PAIR_PATCHES;
use palpate::internal::step::trajectory::Trajectory;
use palpate::scene::Key;
use palpate::{Flags, Scene, Simulation, StepReport};
use palpate_oracle as oracle;
use palpate_oracle::contact::{self, ContactLaw, Gathering, Support, Surface};
use palpate_oracle::contact_law::Friction;
use palpate_oracle::contact_law::auto_stiffness;
use palpate_oracle::step::CoupledCore;
use palpate_oracle::tool;

use crate::scene::bones::{cube, twin_cores};
use crate::scene::touch::{DISPLACEMENT, Place, press};
use crate::scene::whole_step::{open, relative_error, run, scene, soft_twin};

const TIGHT: &str = "tolerance = 1e-6\nmax_iterations = 1000";

/// The twin of a scene with one pair of bodies: two soft bodies, a soft body and the tool, a soft body and a
/// half-space, or the tool and a half-space; or of a scene in which soft bodies that are tools touch one other soft body,
/// the first. The twin finds its contacts itself; it takes only the normals of contact patches from the engine.
pub struct Twin {
    pub oracle: oracle::step::Simulation,
    soft: Vec<(Skin, Vec<Embedding>)>,
    tool: Option<Skin>,
    plane: Option<(DVec3, f64)>,
    law: ContactLaw,
    gathering: Gathering,
}

impl Twin {
    fn new(scene: &Scene, simulation: &Simulation) -> Twin {
        let (mut soft, mut plane, mut layers, mut first_cores) = (vec![], None, vec![], BTreeMap::new());
        let mut oracle = oracle::step::Simulation::new(scene.step.dt, scene.step.gravity);
        oracle.newton = scene.step.newton as usize;
        for (index, body) in simulation.bodies().iter().enumerate() {
            match &body.shape {
                Shape::Soft { skin, embedding, layer, materials, .. } => {
                    soft.push((skin.clone(), embedding.clone()));
                    layers.push((layer, &materials.all[0]));
                    if let (true, Some(coupling)) = (scene.tool_body_index() == Some(index), scene.coupling) {
                        let (core, orientation) = (oracle.cores.len(), body.orientation);
                        oracle.coupled = Some(CoupledCore { core, orientation, coupling });
                    }
                    first_cores.insert(body.name.as_str(), (oracle.cores.len(), body.orientation));
                    oracle.cores.extend(twin_cores(simulation, index));
                    oracle.bodies.push(soft_twin(simulation, index));
                }
                Shape::Plane { normal, offset } => plane = Some((*normal, *offset)),
                Shape::Rigid { .. } => panic!("{} is rigid, but this twin has no rigid bodies", body.name),
            }
        }
        for tool in &scene.further_tools {
            let (core, orientation) = first_cores[tool.body.as_str()];
            let held = CoupledCore { core, orientation, coupling: tool.coupling.unwrap() };
            oracle.further.push((held, Default::default()));
        }
        for core in &oracle.cores {
            core.nodes.iter().for_each(|(b, n)| oracle.bodies[*b].velocity[*n as usize] = core.velocity);
        }
        let mut gathering = Gathering::Both;
        let tool = scene.rigid_tool().map(|spec| {
            let body = prepare::tool(spec, scene).unwrap();
            gathering = Gathering::chosen(&scene.contact, &simulation.bodies()[0], &body);
            let Shape::Rigid { skin, centroid, volume, inertia, .. } = body.shape else { panic!("the tool is soft") };
            oracle.tool = Some(tool::Tool {
                mass: spec.mass,
                inertia: inertia * (spec.mass / volume),
                centre: body.position,
                orientation: body.orientation,
                velocity: body.velocity,
                angular_velocity: DVec3::ZERO,
                coupling: scene.coupling,
            });
            Skin { vertices: skin.vertices.iter().map(|x| *x - centroid).collect(), ..skin }
        });
        let contact = &scene.contact;
        oracle.friction = Some(Friction { coefficient: contact.friction, speed: contact.friction_speed });
        let stiffness = contact.stiffness.or_else(|| auto_stiffness(&layers)).unwrap();
        let law = ContactLaw { stiffness, damping: stiffness * scene.step.dt, depth_limit: contact.depth_limit };
        Twin { oracle, soft, tool, plane, law, gathering }
    }

    /// Finds the contacts (skin vertices inside the other body) in the twin's present state, with depths along `normals`,
    /// one for each pair of the first body and another.
    fn contacts(&self, normals: &[DVec3]) -> Vec<contact::Contact> {
        let soft = self.soft.iter().enumerate().map(|(i, (skin, e))| self.oracle.bodies[i].surface(i, skin, e));
        let tool = self.tool.iter().map(|skin| Surface {
            positions: skin.vertices.iter().map(|x| self.oracle.tool.as_ref().unwrap().place(*x)).collect(),
            triangles: &skin.triangles,
            areas: &skin.areas,
            support: Support::Tool,
        });
        let all: Vec<Surface> = soft.chain(tool).collect();
        match self.plane {
            Some((normal, offset)) => contact::gather_plane(&all[0], normal, offset, &self.law),
            None => {
                let of_pair =
                    |(other, normal): (&Surface, &DVec3)| self.gathering.contacts(*normal, &all[0], other, &self.law);
                assert_eq!(all.len() - 1, normals.len(), "surfaces beside the first, and normals");
                all[1..].iter().zip(normals).flat_map(of_pair).collect()
            }
        }
    }

    /// Centre of mass of the rigid tool, or of the core on which the virtual coupling acts, m.
    fn tool_centre(&self) -> DVec3 {
        let held = || self.oracle.cores[self.oracle.coupled.unwrap().core].centre;
        self.oracle.tool.as_ref().map_or_else(held, |tool| tool.centre)
    }

    /// Linear momentum of all soft bodies, kg m/s, and their angular momentum about the origin, kg m^2/s.
    fn momentum(&self) -> (DVec3, DVec3) {
        momentum(self.oracle.bodies.iter())
    }
}

fn momentum<'a>(bodies: impl Iterator<Item = &'a oracle::step::SoftBody>) -> (DVec3, DVec3) {
    let (mut linear, mut angular) = (DVec3::ZERO, DVec3::ZERO);
    for body in bodies {
        for ((m, x), v) in body.elements.masses.iter().zip(body.world_nodes()).zip(&body.velocity) {
            linear += *m * *v;
            angular += *m * x.cross(*v);
        }
    }
    (linear, angular)
}

/// Linear momentum, kg m/s, and angular momentum about the origin, kg m^2/s, of the first `count` soft bodies, from
/// their state on the GPU.
pub fn device_momentum(simulation: &Simulation, count: usize) -> (DVec3, DVec3) {
    let bodies: Vec<_> = (0..count)
        .map(|index| {
            let mut body = soft_twin(simulation, index);
            (body.displacement, body.velocity) = simulation.nodes(index).unwrap().unwrap();
            body
        })
        .collect();
    momentum(bodies.iter())
}

/// Greatest differences between engine and oracle: `force` and `torque` on the tool, each relative to its largest
/// value; `place`, the tool's position, m; `shape`, node displacements, relative to the largest displacement.
#[derive(Debug, Default)]
pub struct Errors {
    pub force: f64,
    pub torque: f64,
    pub place: f64,
    pub shape: f64,
}

/// Runs a scene in the engine and in the oracle side by side. `each` is called after every step, for further checks.
pub fn beside(
    scene: &Scene,
    steps: usize,
    mut each: impl FnMut(&StepReport, &Simulation, &Twin, &oracle::step::Report),
) -> Errors {
    let mut simulation = open(scene, None);
    let mut twin = Twin::new(scene, &simulation);
    let mut errors = Errors::default();
    let (mut forces, mut torques, h) = ((vec![], vec![]), (vec![], vec![]), scene.step.dt);
    for _ in 0..steps {
        let row = run(&mut simulation, 1).remove(0);
        assert_eq!(row.flags, Flags::default(), "flags of step {}", row.step);
        let contact_patches = simulation.touch().unwrap().0;
        let first_of_pairs = contact_patches.iter().step_by(PAIR_PATCHES);
        let normals: Vec<DVec3> =
            first_of_pairs.map(|patch| DVec3::from(patch.normal.map(f64::from)).normalize_or_zero()).collect();
        let contacts = twin.contacts(&normals);
        let device_of = |keys: &[Key]| {
            let device = Trajectory::new(keys, keys[0]).device(row.time, h);
            tool::Device {
                position: device.position,
                orientation: device.orientation,
                velocity: device.velocity,
                angular_velocity: device.angular_velocity,
            }
        };
        let device = scene.coupling.map(|_| device_of(&scene.trajectory));
        for ((_, device), tool) in twin.oracle.further.iter_mut().zip(&scene.further_tools) {
            *device = device_of(&tool.trajectory);
        }
        let report = twin.oracle.step(device.as_ref(), &contacts).unwrap();
        if let Some(tool) = row.tool {
            forces.0.push(tool.force);
            forces.1.push(report.wrench.force);
            torques.0.push(tool.torque);
            torques.1.push(report.wrench.torque);
            errors.place = errors.place.max(tool.tool.position.distance(twin.tool_centre()));
        }
        for (index, body) in twin.oracle.bodies.iter().enumerate() {
            let (moved, _) = simulation.nodes(index).unwrap().unwrap();
            if body.displacement.iter().any(|d| *d != DVec3::ZERO) {
                errors.shape = errors.shape.max(relative_error(&moved, &body.displacement));
            }
        }
        each(&row, &simulation, &twin, &report);
    }
    if !forces.0.is_empty() {
        errors.force = relative_error(&forces.0, &forces.1);
        errors.torque = relative_error(&torques.0, &torques.1);
    }
    errors
}

/// Sum of the magnitudes of the friction forces of all contacts of a step, divided by the sum of the magnitudes of
/// their normal forces; zero where nothing touches.
fn ratio(report: &oracle::step::Report) -> f64 {
    let force: f64 = report.contacts.iter().map(|c| c.force).sum();
    let drag: f64 = report.contacts.iter().map(|c| c.friction.length()).sum();
    if force > 0.0 { drag / force } else { 0.0 }
}

/// Limits of the fields of [`Errors`], as in vk-tests/scene/touch.rs: `FORCE` and `SHAPE` are relative to the largest
/// value, `PLACE` is in m.
const FORCE: f64 = 5.0e-5;
const SHAPE: f64 = 5.0e-5;
const PLACE: f64 = 1.0e-7;

#[test]
#[ignore = "long: 9 s"]
fn a_tool_dragged_over_a_block_rubs_as_the_oracles() {
    let oblique = Place {
        shift: DVec3::new(0.3, -0.1, 0.2),
        turn: DQuat::from_rotation_z(0.5),
        slide: DVec3::new(0.012, 0.0, -0.007),
    };
    for (young, friction) in [(2.0e4, 0.3), (2.0e4, 1.0), (5.0e5, 0.5)] {
        let solver = format!("{TIGHT}\n[contact]\nfriction = {friction:?}");
        let mut most = 0.0f64;
        let errors = beside(&scene(&press(young, 0.001, oblique, &solver)), 60, |_, _, _, report| {
            most = most.max(ratio(report));
        });
        println!(
            "drag, Young's modulus {young:e} Pa, friction coefficient {friction}: differences from the oracle \
             {errors:?}; friction over normal force at most {most:.3}"
        );
        assert!(most > 0.2 * friction && most < 2.5 * friction, "friction over normal force at most {most}");
        assert!(
            errors.force < FORCE && errors.place < PLACE && errors.shape < DISPLACEMENT[1],
            "differences from the oracle: {errors:?}"
        );
    }
}

/// A scene of a soft block thrown on a plane; `core` is further text of the block's table in the scene file.
pub fn thrown(young: f64, friction: f64, core: &str) -> String {
    format!(
        "[solver]\n{TIGHT}\n[contact]\nfriction = {friction:?}\n[[body]]\nname = \"block\"\n\
         layer = {{ box = [[-0.05, -0.03, -0.05], [0.05, 0.03, 0.05]], cells = [4, 3, 4] }}\n\
         position = [0.0, 0.031, 0.0]\nvelocity = [0.5, -0.2, 0.2]\n\
         material = {{ young = {young:e}, poisson = 0.4, density = 1000.0 }}\n{core}\
         [[body]]\nname = \"floor\"\nplane = [0.0, 1.0, 0.0, 0.0]\n"
    )
}

#[test]
#[ignore = "long: 7 s"]
fn a_thrown_block_slides_and_stops_as_the_oracles() {
    let stone = "[[body.core]]\nname = \"stone\"\nmotion = \"dynamic\"\n\
                 bind = { box = [[-0.06, -0.04, -0.06], [0.0, 0.001, 0.06]] }\n";
    for (name, young, core) in [("soft", 2.0e4, ""), ("stiff", 1.0e6, ""), ("half of stone", 5.0e4, stone)] {
        let (mut most, mut speed) = (0.0f64, 0.0);
        let errors = beside(&scene(&thrown(young, 0.4, core)), 120, |_, _, twin, report| {
            most = most.max(ratio(report));
            speed = twin.momentum().0.length() / twin.oracle.bodies[0].elements.masses.iter().sum::<f64>();
        });
        println!(
            "{name} block: differences from the oracle {errors:?}; friction over normal force at most {most:.3}, \
             speed at the end {speed:.3} m/s"
        );
        assert!(
            most > 0.2 && most < 12.0 * 0.4 && speed < 0.45 && errors.shape < SHAPE,
            "differences from the oracle: {errors:?}"
        );
    }
}

/// Lets a free rigid cube (the tool) go on a slope whose angle has the tangent `tangent`, in steps of `dt` s. Returns
/// its velocity down the slope after each step, m/s, and the greatest differences from the oracle.
fn slide(tangent: f64, steps: usize, dt: f64) -> (Vec<f64>, Errors) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("cube.obj");
    std::fs::write(&file, cube(0.02)).unwrap();
    let down = DVec3::new(tangent, -1.0, 0.0).normalize() * 9.81;
    let text = format!(
        "[step]\ndt = {dt:?}\ngravity = [{:?}, {:?}, 0.0]\n[solver]\n{TIGHT}\n[contact]\nstiffness = 2e7\nfriction = 0.4\n\
         [[body]]\nname = \"slope\"\nplane = [0.0, 1.0, 0.0, 0.0]\n\
         [tool]\nsurface = {file:?}\nmass = 0.1\nposition = [0.0, 0.01995, 0.0]\n",
        down.x, down.y
    );
    let mut velocity = vec![];
    let errors = beside(&scene(&text), steps, |_, simulation, _, _| {
        velocity.push(simulation.tool().unwrap().velocity.x);
    });
    (velocity, errors)
}

#[test]
#[ignore = "long: 8 s"]
fn a_rigid_cube_sticks_to_a_slope_or_slides_as_coulomb_says() {
    for tangent in [0.2, 0.35] {
        let (velocity, errors) = slide(tangent, 400, 1e-3);
        // The speed v at which the friction of the regularised law, with coefficient mu = 0.4 and normal force N,
        // balances gravity: mu N v / sqrt(v^2 + v0^2) = N tangent, where v0 = 1e-3 m/s.
        let creep = 1e-3 * tangent / (0.4f64.powi(2) - tangent * tangent).sqrt();
        println!(
            "slope of tangent {tangent}: speed {:.5e} m/s, by the regularised law {creep:.5e} m/s; differences from \
             the oracle {errors:?}",
            velocity[399]
        );
        assert!(
            (velocity[399] - creep).abs() < 2e-3 * creep,
            "the cube must only creep, at the speed of the regularised law"
        );
        assert!(errors.force < FORCE && errors.place < PLACE, "differences from the oracle: {errors:?}");
    }
    // The acceleration near the friction angle, too: 1 % above it, the friction of a speed that lags by a step would
    // slow the cube by 8 % in steps of 1 ms and by 22 % in steps of 2 ms.
    for (tangent, dt) in [(0.404, 1e-3), (0.404, 2e-3), (0.416, 2e-3), (0.44, 1e-3), (0.5, 1e-3), (0.9, 2e-3)] {
        let steps = (0.4f64 / dt).round() as usize;
        let (velocity, errors) = slide(tangent, steps, dt);
        let want = regularised(tangent, 0.4) - regularised(tangent, 0.2);
        let got = velocity[steps - 1] - velocity[steps / 2 - 1];
        println!(
            "slope of tangent {tangent}, steps of {dt} s: gains {got:.5} m/s, by the regularised law {want:.5} m/s; \
             differences from the oracle {errors:?}"
        );
        // Just above the friction angle the cube is driven by the small difference of two forces.
        let share = if tangent < 0.41 { 0.03 } else { 3e-3 };
        assert!((got - want).abs() < share * want, "gains {got} m/s, by the regularised law {want} m/s");
        assert!(errors.force < FORCE && errors.place < PLACE, "differences from the oracle: {errors:?}");
    }
}

/// Speed, m/s, that a cube has after `time` (s) on a slope of this tangent by the regularised law, with friction
/// coefficient 0.4 and speed 1 mm/s, in steps of a microsecond.
fn regularised(tangent: f64, time: f64) -> f64 {
    let weight = 9.81 / tangent.hypot(1.0);
    let step = 1e-6;
    (0..(time / step) as usize).fold(0.0, |v: f64, _| v + step * weight * (tangent - 0.4 * v / v.hypot(1e-3)))
}

/// A scene of two free blocks that collide obliquely and off their centres, without gravity.
pub fn collision(friction: f64) -> String {
    let body = |name: &str, place: DVec3, velocity: DVec3, turn: DQuat| {
        let list = |x: DVec3| format!("{:?}", x.to_array());
        format!(
            "[[body]]\nname = \"{name}\"\nlayer = {{ box = [[-0.03, -0.03, -0.03], [0.03, 0.03, 0.03]], cells = [3, 3, 3] }}\n\
             position = {}\norientation = {:?}\nvelocity = {}\n\
             material = {{ young = 3e4, poisson = 0.4, density = 1000.0, damping_stiffness = 1e-3 }}\n",
            list(place),
            turn.to_array(),
            list(velocity)
        )
    };
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.1, 0.2, 0.05);
    format!(
        "[step]\ngravity = [0.0, 0.0, 0.0]\n[solver]\n{TIGHT}\n[contact]\nfriction = {friction:?}\n{}{}",
        body("a", DVec3::ZERO, DVec3::new(0.3, 0.4, 0.0), DQuat::IDENTITY),
        body("b", DVec3::new(0.02, 0.066, 0.01), DVec3::new(-0.2, -0.2, 0.1), turn)
    )
}

/// Greatest change of linear momentum since the start that 500 steps in f32 may cause, relative to a body's mass times
/// 0.5 m/s.
const MOMENTUM: f64 = 1.0e-5;
/// Greatest difference between the changes of angular momentum in engine and oracle, relative to a body's mass times
/// 0.5 m/s times half the edge of a body.
const SPIN: f64 = 1.0e-4;

#[test]
fn two_free_bodies_that_collide_keep_their_momentum_with_and_without_friction() {
    for friction in [0.0, 0.5] {
        let scene = scene(&collision(friction));
        let mut start = None;
        let (mut linear, mut angular, mut change) = (0.0f64, 0.0f64, 0.0f64);
        let (mut touching, mut most) = (0, 0.0f64);
        let errors = beside(&scene, 500, |row, simulation, twin, report| {
            let (device, oracle) = (device_momentum(simulation, 2), twin.momentum());
            let (first, first_twin) = start.get_or_insert((device, oracle));
            linear = linear.max(device.0.distance(first.0));
            angular = angular.max((device.1 - first.1).distance(oracle.1 - first_twin.1));
            change = change.max(oracle.1.distance(first_twin.1));
            touching += usize::from(row.contacts.unwrap() > 0);
            most = most.max(ratio(report));
        });
        let size = 0.06f64.powi(3) * 1000.0 * 0.5;
        println!(
            "collision, friction coefficient {friction}: relative changes of linear momentum {:.1e}, of angular \
             momentum {:.1e}, which differs by {:.1e} from the oracle's; {touching} steps in contact, friction over \
             normal force at most {most:.2}; differences from the oracle {errors:?}",
            linear / size,
            change / (size * 0.03),
            angular / (size * 0.03)
        );
        assert!(touching > 10 && (most > 0.1) == (friction > 0.0));
        assert!(
            linear < MOMENTUM * size && angular < SPIN * size * 0.03,
            "linear momentum changes by {linear:e} kg m/s, angular differs from the oracle's by {angular:e} kg m^2/s"
        );
    }
}
