//! Tests of the kernels elastic/mean_dilatation and solve/patch_product, against the f64 oracle (reference
//! implementation). A patch (F-bar) is a group of tetrahedra that share one volumetric strain, their mean dilatation.
//! The first kernel computes each patch's row, whose outer product with itself the patch adds to the operator, and the
//! patch's part of the right-hand side; the second kernel computes the patch's part of the operator product.

use glam::{DQuat, DVec3};
use palpate::internal::prepare::layer::kuhn_box;
use palpate::internal::prepare::patch::{MOST_NODES, patches};
use palpate::internal::prepare::{Body, Shape};
use palpate::internal::shaders::GRADIENT_TEXELS;
use palpate::internal::stages::mean_dilatation::Patches;
use palpate_oracle::elastic::lame;

use crate::harness::random::Random;
use crate::harness::{case, context};
use crate::solver::system::{System, layered, material, triples, two_layers, two_layers_one_on_a_core};
use crate::stage::elastic::{expect_of_largest, rotate, scattered};

/// Error of rows relative to the largest value: a row sums up to twelve rotated gradients, each of which is a dozen
/// roundings away from the input.
const ROW: f64 = 1.0e-6;
/// Error of the right-hand side relative to the largest value: strains of order one tenth come from terms of order one,
/// known to 1e-7.
const FORCE: f64 = 1.0e-5;
/// Error of products relative to the largest value: a product sums a dozen terms of both signs, each of which is as
/// exact as a row.
const PRODUCT: f64 = 3.0e-6;
/// Largest displacement of a node, m; the cells of the layers are 20 mm wide.
const AMPLITUDE: f64 = 0.004;

/// Gives patches to the bodies for which `on` is true.
fn patched(mut bodies: Vec<Body>, on: impl Fn(usize) -> bool) -> Vec<Body> {
    for (index, body) in bodies.iter_mut().enumerate().filter(|(index, _)| on(*index)) {
        let Shape::Soft { layer, .. } = &mut body.shape else { panic!("body {index} is not soft") };
        layer.patches = patches(layer, |_| 0);
    }
    bodies
}

/// The arrays of a system's patches as the kernels read them; no tetrahedron counts as lying within a rigid core.
fn arrays(system: &System) -> Patches {
    let mut all = Patches::default();
    for (body, range) in system.twin.bodies.iter().zip(&system.model.soft) {
        let material = body.elements.materials[0];
        let constants = [lame(&material).1, material.damping_stiffness];
        all.add(&body.layer, range.nodes.start, |_| constants, |_| false);
    }
    all
}

/// Runs elastic/element_forces and elastic/mean_dilatation. Returns the forces (those of tetrahedra, four zeros, and
/// those of patches) and the rows.
fn mean_dilatation(system: &System, all: &Patches) -> (Vec<[f32; 4]>, Vec<[f32; 4]>) {
    let tetrahedra = system.model.tetrahedra.len();
    let turned = rotate(system, &all.of);
    let mut gradients: Vec<[f32; 4]> = turned.get("gradients");
    gradients.extend([[0.0; 4]; GRADIENT_TEXELS as usize]);
    let mut forces: Vec<[f32; 4]> = turned.get("element_forces");
    forces.extend([[0.0; 4]; 4]);
    forces.extend(vec![[f32::NAN; 4]; MOST_NODES * all.count()]);
    let outcome = case("elastic/mean_dilatation")
        .constant("PATCHES", all.count() as u32)
        .constant("TETRAHEDRA", tetrahedra as u32)
        .constant("NEWTON", !system.trial_change.is_empty())
        .input("params", &[system.params])
        .input("patch_nodes", &all.device_nodes())
        .input("patch_members", &all.device_members())
        .input("patch_constants", &all.constants)
        .input("rest_gradients", &system.model.rest_gradients)
        .input("gradients", &gradients)
        .input("velocity", &system.velocity)
        .input("trial_change", system.trial())
        .output::<[f32; 4]>("patch_rows", MOST_NODES * all.count())
        .partial("element_forces", &forces)
        .elements(all.count())
        .run();
    (outcome.get("element_forces"), outcome.get("patch_rows"))
}

/// Runs solve/patch_product, which computes the forces of patches for a change of velocity. Returns the array of
/// element forces, in which those of patches come last.
fn product(system: &System, all: &Patches, rows: &[[f32; 4]], change: &[[f32; 4]]) -> Vec<[f32; 4]> {
    let first = 4 * (system.model.tetrahedra.len() + 1);
    let outcome = case("solve/patch_product")
        .constant("PATCHES", all.count() as u32)
        .constant("TETRAHEDRA", system.model.tetrahedra.len() as u32)
        .input("patch_nodes", &all.device_nodes())
        .input("patch_rows", rows)
        .input("change", change)
        .partial("element_forces", &vec![[0.0f32; 4]; first + MOST_NODES * all.count()])
        .elements(all.count())
        .run();
    outcome.get("element_forces")
}

/// Forces of tetrahedra and patches, summed at each node.
fn gathered(system: &System, all: &Patches, forces: &[[f32; 4]]) -> Vec<f32> {
    let tetrahedra = system.model.tetrahedra.iter().flatten().copied().zip(0..);
    let first = 4 * (system.model.tetrahedra.len() as u32 + 1);
    let of_patches = all.entries(0).map(|(node, [p, k])| (node, first + k * all.count() as u32 + p));
    let mut sums = vec![[0.0f64; 4]; system.model.node_rest.len()];
    for (node, entry) in tetrahedra.chain(of_patches) {
        (0..3).for_each(|k| sums[node as usize][k] += f64::from(forces[entry as usize][k]));
    }
    triples(&sums.iter().map(|sum| sum.map(|x| x as f32)).collect::<Vec<_>>())
}

fn wide(x: &[f32; 4]) -> DVec3 {
    DVec3::new(x[0].into(), x[1].into(), x[2].into())
}

/// Compares rows, right-hand side and product of each body with the oracle's.
fn expect_oracle(what: &str, system: &System, seed: u64) {
    let all = arrays(system);
    let (forces, rows) = mean_dilatation(system, &all);
    let change = system.random_field(&mut Random(seed));
    let operator_product = gathered(system, &all, &product(system, &all, &rows, &change));
    let right = gathered(system, &all, &forces);
    let entries: Vec<_> = all.entries(0).collect();
    let mut patch = 0;
    for (index, (body, range)) in system.twin.bodies.iter().zip(&system.model.soft).enumerate() {
        let what = format!("{what}, body {index}");
        let (own, own3) = (range.nodes.clone(), 3 * range.nodes.start..3 * range.nodes.end);
        let (h, beta) = (system.twin.dt, body.elements.materials[0].damping_stiffness);
        let step = h * h + h * beta;
        let q: Vec<DQuat> = body.given_rotations.clone().unwrap();
        let (mut got, mut want) = (vec![], vec![]);
        let mut products = vec![DVec3::ZERO; own.len()];
        for row in body.elements.patch_rows(&q) {
            let along: f64 = row.iter().map(|(n, c)| c.dot(wide(&change[own.start + *n as usize]))).sum();
            row.iter().for_each(|(n, c)| products[*n as usize] += step * along * *c);
            for (node, [p, k]) in entries.iter().filter(|(_, [p, _])| *p as usize == patch) {
                got.extend(&rows[*k as usize * all.count() + *p as usize][..3]);
                want.extend((step.sqrt() * row[&(node - own.start as u32)]).to_array());
            }
            patch += 1;
        }
        expect_of_largest(&format!("{what}: rows"), &got, &want, ROW);
        let want: Vec<f64> = products.iter().flat_map(|x| x.to_array()).collect();
        expect_of_largest(&format!("{what}: product"), &operator_product[own3.clone()], &want, PRODUCT);
        let elements = body.elements.linearised(&body.displacement, &q);
        let change = system.trial_change_of(index);
        let want = elements.impulses(&body.displacement, &q, &body.velocity, change.as_deref(), h);
        let want: Vec<f64> = want.iter().flat_map(|f| f.to_array()).collect();
        expect_of_largest(&format!("{what}: right-hand side"), &right[own3], &want, FORCE);
    }
    assert_eq!(patch, all.count());
}

#[test]
fn patches_of_one_tetrahedron_are_that_tetrahedron_at_every_size() {
    let width = context().group_size() as usize;
    for count in [0, 1, width - 1, width, width + 1, 1234] {
        let mut layer = scattered(count, &mut Random(41));
        layer.patches = (0..count as u32).collect();
        let bodies = if count == 0 { vec![] } else { vec![layered(layer, material(2e4), Random(42).turn(2.5))] };
        let system = System::new(&bodies, 0.002, 43);
        expect_oracle(&format!("{count} patches"), &system, 44);
        // A patch of one tetrahedron must act as the tetrahedron does without patches, but for geometric stiffness, which
        // tetrahedra in patches do not have; so nothing moves here.
        let mut system = system;
        system.velocity.fill([0.0; 4]);
        system.rotate();
        let all = arrays(&system);
        let with = gathered(&system, &all, &mean_dilatation(&system, &all).0);
        let without: Vec<f64> =
            gathered(&system, &Patches::default(), &system.element_forces).iter().map(|x| f64::from(*x)).collect();
        expect_of_largest("forces with patches of one tetrahedron and without patches", &with, &without, FORCE);
    }
}

#[test]
fn patches_of_layers_agree_with_the_oracle() {
    // `on` says of each of the two bodies whether it has patches.
    for (seed, on) in [(51, [true, true]), (52, [true, false]), (53, [false, true])] {
        let system = System::new(&patched(two_layers(), |body| on[body]), AMPLITUDE, seed);
        expect_oracle(&format!("two layers, with patches {on:?}"), &system, seed + 10);
        let mut system = System::new(&patched(two_layers_one_on_a_core(), |body| on[body]), AMPLITUDE, seed);
        expect_oracle(&format!("two layers, one on a rigid core, with patches {on:?}"), &system, seed + 20);
        system.trial_change = system.random_field(&mut Random(seed)).iter().map(|v| v.map(|x| 0.1 * x)).collect();
        expect_oracle(&format!("one on a core, patches {on:?}, at a trial change of velocity"), &system, seed + 30);
    }
}

#[test]
fn a_common_velocity_is_not_resisted_at_all() {
    let system = System::new(&patched(two_layers(), |_| true), AMPLITUDE, 61);
    let all = arrays(&system);
    let (_, rows) = mean_dilatation(&system, &all);
    let change = vec![[3.0f32, -20.0, 7.0, 0.0]; system.model.node_rest.len()];
    let forces = product(&system, &all, &rows, &change);
    assert!(all.count() > 5 && forces.iter().all(|f| *f == [0.0; 4]), "the force must be exactly zero");
}

#[test]
fn tetrahedra_within_a_core_need_no_patch() {
    let mut layer = kuhn_box(DVec3::ZERO, DVec3::ONE, [6, 3, 3]);
    layer.attached = layer.nodes.iter().map(|x| x.x < 0.6).collect();
    layer.patches = patches(&layer, |_| 0);
    let within = |t: usize| layer.tetrahedra[t].iter().all(|n| layer.attached[*n as usize]);
    let mut all = Patches::default();
    all.add(&layer, 0, |_| [1.0, 0.0], within);
    let count = layer.patches.iter().max().map_or(0, |last| *last as usize + 1);
    let left_out = (0..layer.tetrahedra.len()).filter(|t| all.of[*t] == u32::MAX).collect::<Vec<_>>();
    assert!(!left_out.is_empty() && all.count() < count);
    assert!(left_out.into_iter().all(within) && (0..layer.tetrahedra.len()).any(|t| !within(t)));
}
