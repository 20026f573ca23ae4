//! Tests of the strain energy density and Cauchy's stress of tetrahedra: of draw/elements against closed forms and against
//! f64, and of the stress that a simulation gives, which must hold contact forces in equilibrium. A patch is a group of
//! tetrahedra that share one volumetric strain (F-bar); the oracle is the f64 reference implementation.

use glam::{DMat3, DQuat, DVec3};
use palpate::internal::gpu::Const;
use palpate::internal::prepare::patch::patches;
use palpate::internal::prepare::{Layer, Shape};
use palpate::internal::stages::material_law::laws_of;
use palpate::scene::MaterialLaw;

use crate::harness::random::Random;
use crate::harness::{Tolerance, case, expect_close};
use crate::scene::joints;
use crate::scene::touch::{Place, press};
use crate::scene::whole_step::{open, run, scene, soft_twin};
use crate::solver::system::{System, layered, material, mixed, two_layers};
use crate::stage::elastic::{deformed_of, expect_of_largest, stretched};
use crate::stage::fields::{column, energies};
use crate::stage::sizes;

/// Error against closed forms, relative to the largest entry.
const CLOSED: f64 = 1.0e-5;
/// Error of densities and stresses relative to the largest one: strains of order one tenth come from terms of order one,
/// known to 1e-7; a density is quadratic in the strains.
pub const STRESS: f64 = 1.0e-5;
/// Error relative to the largest entry at strains of 1e-6, some of which hardly change the volume, so that their trace is
/// a small difference; strains that are differences of numbers of order one would give 1e-1 at best.
const TINY_STRAIN: f64 = 5.0e-5;
/// Error of the stresses of a simulation relative to the largest: displacements are f32, and the strain is a small
/// difference of them.
const WHOLE: f64 = 2.0e-4;
/// Value of densities that the kernel must not change.
const KEPT: f32 = 7.0;
/// Error of the balance of forces, relative to the contact force.
const BALANCE: f64 = 1.0e-4;

/// Von Mises's stress, and the pressure (minus a third of the trace).
pub fn invariants(stress: DMat3) -> [f64; 2] {
    let [xx, yy, zz] = [stress.x_axis.x, stress.y_axis.y, stress.z_axis.z];
    let off = DVec3::new(stress.x_axis.y, stress.x_axis.z, stress.y_axis.z);
    let squares = (xx - yy).powi(2) + (yy - zz).powi(2) + (zz - xx).powi(2);
    [(0.5 * squares + 3.0 * off.length_squared()).sqrt(), -(xx + yy + zz) / 3.0]
}

/// What draw/elements writes for a system: densities, and stresses where it `has_stress`. It keeps the densities where
/// there are patches too; `adds` is then the part of each tetrahedron's stress that its patch applies.
pub fn elements(system: &System, has_stress: bool, patch_of: &[u32], adds: &[f64]) -> (Vec<[f32; 4]>, Vec<[f32; 8]>) {
    let tetrahedra = system.model.tetrahedra.len();
    let mut densities: Vec<[f32; 4]> = adds.iter().map(|stress| [KEPT, KEPT, KEPT, *stress as f32]).collect();
    densities.resize(tetrahedra.max(1), [KEPT; 4]);
    let case = case("draw/elements")
        .constant("TETRAHEDRA", tetrahedra as u32)
        .constant("SPANS", Const::Bool(system.model.spans_frames()))
        .constant("PATCHES", Const::Bool(!patch_of.is_empty()))
        .constant("LAWS", laws_of(&system.model.materials))
        .constant("STRESS", Const::Bool(has_stress))
        .input("materials", &system.model.materials)
        .input("frames", &system.frames)
        .input("tetrahedra", &system.model.tetrahedra)
        .input("rest_gradients", &system.model.rest_gradients)
        .input("element_info", &system.model.element_info)
        .input("displacement", &system.displacement)
        .input("tetrahedron_links", &system.model.tetrahedron_links)
        .input("node_rest", &system.model.node_rest)
        .input("links", &system.links)
        .input("patch_of", if patch_of.is_empty() { &[0] } else { patch_of })
        .input("rotations", &system.rotations)
        .inout("densities", &densities)
        .elements(tetrahedra);
    let outcome = match has_stress {
        true => case.output::<[f32; 8]>("stresses", tetrahedra).run(),
        false => case.inout("stresses", &vec![[KEPT; 8]; tetrahedra.max(1)]).run(),
    };
    let mut densities: Vec<[f32; 4]> = outcome.get("densities");
    densities.truncate(tetrahedra);
    (densities, outcome.get("stresses"))
}

/// The numbers that draw/elements writes for a stress.
fn row(stress: DMat3) -> [f64; 8] {
    let (x, y, z) = (stress.x_axis, stress.y_axis, stress.z_axis);
    let [von_mises, pressure] = invariants(stress);
    [x.x, y.y, z.z, von_mises, x.y, x.z, y.z, pressure.max(0.0)]
}

/// The oracle's stresses of a system's tetrahedra, at the oracle's own rotations.
fn wanted(system: &System) -> Vec<f64> {
    let of_body = |body: &palpate_oracle::step::SoftBody| {
        let rotations = body.elements.rotations(&body.displacement);
        body.elements.stresses(&body.displacement, &rotations)
    };
    system.twin.bodies.iter().flat_map(of_body).flat_map(row).collect()
}

/// The stress of one tetrahedron with three edges of 1 m along the axes, of Young's modulus 20 kPa and Poisson's ratio
/// 0.45, whose deformation gradient is `f`.
fn of_one(law: MaterialLaw, f: DMat3) -> [f32; 8] {
    let nodes = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
    let layer = Layer { nodes, tetrahedra: vec![[0, 1, 2, 3]], attached: vec![false; 4], ..Layer::default() };
    let soft = palpate::scene::Material { law, ..material(2e4) };
    let mut system = System::new(&[layered(layer, soft, DQuat::IDENTITY)], 0.0, 1);
    let g = f - DMat3::IDENTITY;
    for (k, column) in [g.x_axis, g.y_axis, g.z_axis].into_iter().enumerate() {
        let d = column.as_vec3();
        system.displacement[k + 1] = [d.x, d.y, d.z, 0.0];
    }
    elements(&system, true, &[], &[]).1[0]
}

#[test]
fn stresses_have_their_closed_forms() {
    let (mu, lambda) = (2e4 / 2.9, 2e4 * 0.45 / (1.45 * 0.1));
    let (m, l) = (4.0 / 3.0 * mu, lambda + 5.0 / 6.0 * mu);
    // The corotational stress 2 mu (S - 1) + lambda tr(S - 1), and the stable neo-Hookean stress
    // m (1 - 1 / (I + 1)) F + (l (J - 1) - mu) J F^-T, both times F^T / J.
    let mut all: Vec<(&str, MaterialLaw, DMat3, DMat3)> = Vec::new();
    for stretch in [0.7, 0.999, 1.001, 1.2] {
        // A stretch along x with the width held.
        let f = DMat3::from_diagonal(DVec3::new(stretch, 1.0, 1.0));
        let e = stretch - 1.0;
        let linear = DVec3::new((2.0 * mu + lambda) * e, lambda * e / stretch, lambda * e / stretch);
        all.push(("a stretch", MaterialLaw::Corotational, f, DMat3::from_diagonal(linear)));
        let (slope, push) = (m * (1.0 - 1.0 / (stretch * stretch + 3.0)), l * e - mu);
        let neo = DVec3::new(slope * stretch + push, slope / stretch + push, slope / stretch + push);
        all.push(("a stretch", MaterialLaw::NeoHookean, f, DMat3::from_diagonal(neo)));
        // A stretch along all axes.
        let f = DMat3::from_diagonal(DVec3::splat(stretch));
        let linear = (2.0 * mu + 3.0 * lambda) * e / (stretch * stretch);
        all.push(("a pressure", MaterialLaw::Corotational, f, DMat3::from_diagonal(DVec3::splat(linear))));
        let slope = m * (1.0 - 1.0 / (3.0 * stretch * stretch + 1.0));
        let neo = slope / stretch + l * (stretch.powi(3) - 1.0) - mu;
        all.push(("a pressure", MaterialLaw::NeoHookean, f, DMat3::from_diagonal(DVec3::splat(neo))));
    }
    for shear in [-0.5, 0.001, 0.5] {
        // Simple shear F = 1 + shear x y^T, with the rotation by -atan(shear / 2) about z.
        let f = DMat3::from_cols(DVec3::X, DVec3::new(shear, 1.0, 0.0), DVec3::Z);
        let turn = DMat3::from_rotation_z(-(0.5 * shear).atan());
        let s = turn.transpose() * f;
        let e = s - DMat3::IDENTITY;
        let linear = e * (2.0 * mu) + DMat3::from_diagonal(DVec3::splat(lambda * (e.x_axis.x + e.y_axis.y)));
        all.push(("a shear", MaterialLaw::Corotational, f, turn * linear * s * turn.transpose()));
        let slope = m * (1.0 - 1.0 / (4.0 + shear * shear));
        let neo = f * f.transpose() * slope - DMat3::from_diagonal(DVec3::splat(mu));
        all.push(("a shear", MaterialLaw::NeoHookean, f, neo));
    }
    for (what, law, f, stress) in all {
        let want = row(stress);
        let largest = want.iter().fold(0.0f64, |largest, x| largest.max(x.abs()));
        // Displacements are f32, so that a strain of 1e-3 is known to 6e-5; the stress is compared at the strain given.
        let got = of_one(law, f);
        expect_close(&format!("{what}, {law:?}, {f}"), &got, &want, Tolerance { abs: CLOSED * largest, rel: 0.0 });
    }
    // Inside out: there is no such stress.
    assert_eq!(of_one(MaterialLaw::NeoHookean, DMat3::from_diagonal(DVec3::new(-0.5, 1.0, 1.0))), [0.0; 8]);
}

#[test]
fn energies_and_stresses_agree_with_the_oracle_at_every_size_squeezed_and_tiny() {
    for count in sizes() {
        for (what, least, share) in [("stretched", 0.8, STRESS), ("squeezed", 0.1, STRESS), ("tiny", 1.0, TINY_STRAIN)]
        {
            let system = deformed_of(&mixed(count), count, 7, |random: &mut Random| match what {
                "tiny" => {
                    let vectors = [random.vector(), random.vector(), random.vector()];
                    DMat3::IDENTITY + DMat3::from_cols(vectors[0], vectors[1], vectors[2]) * 1e-6
                }
                _ => {
                    let turn = DQuat::from_scaled_axis(0.5 * random.vector());
                    stretched(turn, least + 0.05 * random.next(), random)
                }
            });
            let what = format!("{count} tetrahedra, {what}");
            let (densities, got) = elements(&system, true, &[], &[]);
            expect_of_largest(&what, &got.concat(), &wanted(&system), share);
            // The kernel writes the same densities with stresses and without.
            assert_eq!(elements(&system, false, &[], &[]).0, densities, "{what}");
            expect_of_largest(&format!("{what}: energy"), &column(&densities, 0), &energies(&system), share);
            let volumes = system.twin.bodies.iter().flat_map(|body| body.elements.volumes.clone());
            assert!(densities.iter().zip(volumes).all(|(row, volume)| (f64::from(row[1]) / volume - 1.0).abs() < 1e-6));
        }
    }
}

#[test]
fn stresses_of_patches_and_of_turned_frames_agree_with_the_oracle() {
    let mut bodies = two_layers();
    for body in &mut bodies {
        let Shape::Soft { layer, .. } = &mut body.shape else { panic!("the body is not soft") };
        layer.patches = patches(layer, |_| 0);
    }
    let system = System::new(&bodies, 0.002, 5);
    let adds = |body: &palpate_oracle::step::SoftBody| {
        let rotations = body.elements.rotations(&body.displacement);
        let strains: Vec<_> = rotations
            .iter()
            .enumerate()
            .map(|(e, turn)| palpate_oracle::elastic::strain(*turn, body.elements.gradient(e, &body.displacement)))
            .collect();
        let means = body.elements.dilatations(&strains);
        let stress = |(theta, material): (f64, _)| theta * palpate_oracle::elastic::lame(material).1;
        means.into_iter().zip(&body.elements.materials).map(stress).collect::<Vec<f64>>()
    };
    let adds: Vec<f64> = system.twin.bodies.iter().flat_map(adds).collect();
    let (densities, got) = elements(&system, true, &system.model.patches.of, &adds);
    expect_of_largest("stresses of patches", &got.concat(), &wanted(&system), STRESS);
    assert!(densities.iter().all(|row| row[0] == KEPT), "what draw/share leaves must stay");
    let turned = system.twin.bodies.iter().any(|body| (body.elements.frame.x_axis - DVec3::X).length() > 0.1);
    assert!(turned && adds.iter().any(|stress| stress.abs() > 0.0));
}

#[test]
fn stresses_of_a_simulation_are_what_the_host_knows() {
    let place = Place { shift: DVec3::new(0.3, -0.2, 0.1), turn: DQuat::from_rotation_z(0.5), slide: DVec3::ZERO };
    let keys = "motion = \"driven\"\nkeys = [[0.0, 0.4, 0.1, -0.2, 0.1, 0.2, 0.3, 0.9273618495495703], \
                [0.2, 0.42, 0.1, -0.2, 0.1, 0.2, 0.3, 0.9273618495495703]]";
    let pressed = press(2e4, 1e-3, place, "");
    let neo = pressed.replace("density = 1000.0", "density = 1000.0, law = \"neo-hookean\"");
    let patched = pressed.replace("name = \"block\"", "name = \"block\"\ndilatation = \"patch\"");
    let chain = joints::chain(2e4, keys, ["", "stiffness = 0.5"], "gravity = [5.0, -25.0, 8.0]");
    for (name, text) in [("pressed", &pressed), ("neo-Hookean", &neo), ("patched", &patched), ("a chain", &chain)] {
        let mut simulation = open(&scene(text), None);
        run(&mut simulation, 45);
        let elements = soft_twin(&simulation, 0).elements;
        let (moved, _) = simulation.nodes(0).unwrap().unwrap();
        let rotations = elements.rotations(&moved);
        let want: Vec<f64> =
            elements.stresses(&moved, &rotations).into_iter().flat_map(|s| s.to_cols_array()).collect();
        let found = simulation.stresses(0).unwrap();
        let got: Vec<f32> = found.iter().flat_map(|stress| stress.to_cols_array()).map(|x| x as f32).collect();
        assert!(want.iter().any(|x| x.abs() > 100.0), "{name}: there is no stress");
        expect_of_largest(&format!("{name}: stress"), &got, &want, WHOLE);
        let energies: Vec<f32> = simulation.strain_energy_densities(0).unwrap().iter().map(|x| *x as f32).collect();
        expect_of_largest(&format!("{name}: energy"), &energies, &elements.densities(&moved, &rotations), WHOLE);
        assert!(simulation.stresses(7).unwrap().is_empty());
        let messages = simulation.context().validation_messages();
        assert!(messages.is_empty(), "{messages:#?}");
    }
}

#[test]
fn stresses_hold_the_contact_force() {
    // At rest, the forces that the stresses exert on the free nodes of the block balance the contact force.
    let text = press(2e4, 5e-3, Place::default(), "tolerance = 1e-7\nmax_iterations = 1000");
    for law in ["corotational", "neo-hookean"] {
        let text = text.replace("density = 1000.0", &format!("density = 1000.0, law = \"{law}\", damping_mass = 30.0"));
        let mut simulation = open(&scene(&text), None);
        let rows = run(&mut simulation, 400);
        let felt = rows.last().unwrap().tool.as_ref().unwrap().force;
        let found = simulation.stresses(0).unwrap();
        let now = simulation.node_positions(0).unwrap();
        let Shape::Soft { layer, embedding, .. } = &simulation.bodies()[0].shape else { panic!("body 0 is not soft") };
        let mut forces = vec![DVec3::ZERO; now.len()];
        for (stress, nodes) in found.iter().zip(&layer.tetrahedra) {
            let [a, b, c, d] = nodes.map(|n| now[n as usize]);
            // Gradients of the shape functions, times six times the volume.
            let gradients = [(d - b).cross(c - b), (c - a).cross(d - a), (d - a).cross(b - a), (b - a).cross(c - a)];
            for (n, gradient) in nodes.iter().zip(gradients) {
                forces[*n as usize] -= *stress * gradient / 6.0;
            }
        }
        let free = |n: &usize| !layer.attached[*n];
        let force: DVec3 = (0..now.len()).filter(free).map(|n| forces[n]).sum();
        let error = (force - felt).length();
        assert!(felt.length() > 0.5, "{law}: the tool feels only {felt} N");
        assert!(error < BALANCE * felt.length(), "{law}: stresses exert {force} N, the tool feels {felt} N");
        // So they do at every node, where the forces at the vertices act by the weights of their embedding.
        let pushes = simulation.contact_forces(0).unwrap();
        for (push, embedded) in pushes.iter().zip(embedding) {
            let nodes = layer.tetrahedra[embedded.tetrahedron as usize];
            nodes.iter().zip(embedded.weights).for_each(|(n, weight)| forces[*n as usize] += weight * *push);
        }
        let greatest = (0..now.len()).filter(free).map(|n| forces[n].length()).fold(0.0, f64::max);
        assert!(greatest < BALANCE * felt.length(), "{law}: {greatest} N are left at a node");
        assert!(pushes.iter().filter(|push| push.length() > 0.0).count() > 3);
    }
}
