//! Invariants of Newton iterations: the residual of implicit Euler's equations falls with each iteration, for both
//! material laws and with F-bar patches (tetrahedra that share one volumetric strain). Tests print what they measure:
//! run with `--nocapture`.

use glam::{DQuat, DVec3};
use palpate::internal::prepare::layer::kuhn_box;
use palpate::internal::prepare::patch::patches;
use palpate::scene::{Material, MaterialLaw};

use super::material;
use crate::step::{Simulation, SoftBody};

/// Bound on the rounding of a direct solve of the bar's 270 unknowns, relative to the elastic forces.
const ROUNDING: f64 = 1e-13;
const GRAVITY: DVec3 = DVec3::new(0.0, -9.81, 0.0);

/// A bar of 20 cm whose nodes at x = 0 are held, bent by `angle` (rad) over its length, with zero velocity.
fn bent(material: Material, patched: bool, angle: f64) -> SoftBody {
    let mut layer = kuhn_box(DVec3::new(0.0, -0.02, -0.02), DVec3::new(0.2, 0.02, 0.02), [10, 2, 2]);
    layer.attached = layer.nodes.iter().map(|x| x.x < 1e-9).collect();
    if patched {
        layer.patches = patches(&layer, |_| 0);
    }
    let radius = 0.2 / angle;
    let place = |x: &DVec3| {
        let (sine, cosine) = (x.x / radius).sin_cos();
        DVec3::new((radius - x.y) * sine, radius - (radius - x.y) * cosine, x.z)
    };
    let displacement = layer.nodes.iter().map(|x| place(x) - *x).collect();
    let mut body = SoftBody::new(layer, material, DVec3::ZERO, DQuat::from_rotation_z(0.3), DVec3::ZERO);
    body.displacement = displacement;
    body
}

/// Relative residual of implicit Euler over free nodes: the norm of
/// M (v1 - v0) - h (M g - alpha M v1 + f_el(d1) - beta K(d1) v1), divided by the norm of h f_el(d0), with mass M,
/// gravity g, elastic force f_el, stiffness K, damping coefficients alpha (of M) and beta (of K), displacements d0 and
/// velocities v0 before a step of `h` seconds, and d1 and v1 after it.
fn left(before: &SoftBody, after: &SoftBody, h: f64) -> f64 {
    let forces = |body: &SoftBody| body.elements.forces(&body.displacement, &body.rotations());
    let rotations = after.rotations();
    let elements = after.elements.linearised(&after.displacement, &rotations);
    let viscous = elements.viscous_forces(&after.velocity, &rotations);
    let (elastic, start) = (forces(after), forces(before));
    let (mut sum, mut size) = (0.0, 0.0);
    for i in (0..elastic.len()).filter(|i| !after.layer.attached[*i]) {
        let (mass, damping) = (elements.masses[i], elements.damping[i]);
        let force = mass * GRAVITY - damping * after.velocity[i] + elastic[i] - viscous[i];
        sum += (mass * (after.velocity[i] - before.velocity[i]) - h * force).length_squared();
        size += (h * start[i]).length_squared();
    }
    (sum / size).sqrt()
}

#[test]
fn what_is_left_of_implicit_euler_falls_with_every_iteration() {
    let soft = Material { damping_mass: 2.0, damping_stiffness: 0.002, ..material(2e4, 0.4) };
    let neo = Material { law: MaterialLaw::NeoHookean, ..soft };
    for (name, matter, patched) in
        [("corotational", soft, false), ("corotational with patches", soft, true), ("neo-Hookean", neo, false)]
    {
        for h in [0.01, 0.02] {
            let start = bent(matter, patched, 1.2);
            let residuals: Vec<f64> = (1..=24)
                .map(|newton| {
                    let mut simulation = Simulation { newton, ..Simulation::new(h, GRAVITY) };
                    simulation.bodies.push(start.clone());
                    simulation.step(None, &[]).unwrap();
                    left(&start, &simulation.bodies[0], h)
                })
                .collect();
            let text: Vec<String> = residuals.iter().map(|r| format!("{r:.1e}")).collect();
            println!("{name}, step {h} s: relative residual after 1, 2, 3 .. Newton iterations: {}", text.join(" "));
            assert!(
                residuals[0] > 0.02 && residuals[1] < 0.3 * residuals[0],
                "{name}, step {h} s: the second iteration must reduce the residual"
            );
            let falls = residuals.windows(2).take_while(|pair| pair[0] > ROUNDING);
            // Convergence is linear: what the operator leaves out is the negative geometric stiffness of the side of the
            // bar that is pressed, so it is too stiff in bending.
            assert!(
                falls.into_iter().all(|pair| pair[1] < 0.5 * pair[0]),
                "{name}, step {h} s: each iteration must reduce the residual"
            );
            assert!(residuals[23] < 1e-9, "{name}, step {h} s: the last residual is {}", residuals[23]);
        }
    }
}
