//! Tests of F-bar patches, groups of tetrahedra that share one volumetric strain. They must remove volumetric locking
//! (linear tetrahedra become much too stiff near Poisson's ratio 0.5), and the stiffness must stay symmetric positive
//! semi-definite, as the solver needs it.

use faer::{Mat, Side};
use glam::{DMat3, DQuat, DVec3};
use palpate::internal::prepare::layer::kuhn_box;
use palpate::internal::prepare::{Layer, patch};
use palpate::scene::Material;

use super::material;
use crate::elastic::{Elements, Weight};
use crate::testing::{Random, boundary};
use crate::{skin, statics};

/// Reference values, which `assets/reference/locking.py` computes with quadratic elements; they are within 0.2 % of the
/// limit to which they converge on ever finer meshes.
const REFERENCE: &str = include_str!("../../../../assets/reference/locking.csv");
/// Relative tolerance for the rounding of f64 sums of a few hundred terms.
const ROUNDING: f64 = 1e-12;

/// Reference values at Young's modulus 1 Pa and this Poisson's ratio, in this order: deflection of a cantilever, m;
/// force on a pressed block, N; bulge (mean outward displacement of the sides) of this block, m.
fn reference(poisson: f64) -> [f64; 3] {
    let rows = REFERENCE.lines().skip(1).map(|line| line.split(',').collect::<Vec<_>>());
    let own: Vec<f64> = rows.filter(|r| r[0].parse() == Ok(poisson)).map(|r| r[2].parse().unwrap()).collect();
    own.try_into().unwrap()
}

fn elements(mut layer: Layer, material: &Material, patched: bool) -> (Layer, Elements) {
    if patched {
        layer.patches = patch::patches(&layer, |_| 0);
    }
    let elements = Elements::new(&layer, *material, DMat3::IDENTITY);
    (layer, elements)
}

/// Share of each node in the area of the face of a box where coordinate `axis` equals `at` (m); zero off this face.
fn face(layer: &Layer, axis: usize, at: f64) -> Vec<f64> {
    let on = |t: &[u32; 3]| t.iter().all(|i| (layer.nodes[*i as usize][axis] - at).abs() < 1e-9);
    let triangles: Vec<_> = boundary(layer).into_iter().filter(on).collect();
    let areas = skin::areas(&layer.nodes, &triangles);
    let total: f64 = areas.iter().sum();
    areas.iter().map(|a| a / total).collect()
}

/// Mean deflection of the end of a cantilever, m, under 1 N spread evenly over this end, with `n` cells across it.
fn cantilever(poisson: f64, n: u32, patched: bool) -> f64 {
    let layer = kuhn_box(DVec3::ZERO, DVec3::new(1.0, 0.2, 0.2), [5 * n, n, n]);
    let (layer, elements) = elements(layer, &material(1.0, poisson), patched);
    let fixed: Vec<_> = layer.nodes.iter().map(|x| [x.x == 0.0; 3]).collect();
    let loads: Vec<_> = face(&layer, 0, 1.0).iter().map(|share| DVec3::new(0.0, -share, 0.0)).collect();
    dot(&statics::solve(&elements, &fixed, &loads).unwrap(), &loads)
}

/// Force, N, and bulge, m, of a cube of 0.1 m that is pressed together by 0.01 m, with `n` cells across it.
fn block(poisson: f64, n: u32, patched: bool) -> [f64; 2] {
    let (side, pressed) = (0.1, 0.01);
    let layer = kuhn_box(DVec3::ZERO, DVec3::splat(side), [n; 3]);
    let (layer, elements) = elements(layer, &material(1.0, poisson), patched);
    let rotations = vec![DQuat::IDENTITY; elements.tetrahedra.len()];
    let given = |x: &DVec3| if x.y > side - 1e-9 { DVec3::new(0.0, -pressed, 0.0) } else { DVec3::ZERO };
    let given: Vec<_> = layer.nodes.iter().map(given).collect();
    let fixed: Vec<_> = layer.nodes.iter().map(|x| [x.y < 1e-9 || x.y > side - 1e-9; 3]).collect();
    let loads: Vec<_> = elements.apply_stiffness(&given, &rotations).iter().map(|f| -*f).collect();
    let free = statics::solve(&elements, &fixed, &loads).unwrap();
    let u: Vec<_> = free.iter().zip(&given).map(|(a, b)| *a + *b).collect();
    let outward = |at: f64| face(&layer, 0, at).iter().zip(&u).map(|(share, u)| share * u.x).sum::<f64>();
    let force = dot(&u, &elements.apply_stiffness(&u, &rotations)) / pressed;
    [force, 0.5 * (outward(side) - outward(0.0))]
}

fn dot(a: &[DVec3], b: &[DVec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum()
}

fn greatest(v: &[DVec3]) -> f64 {
    v.iter().map(|x| x.length()).fold(0.0, f64::max)
}

/// Errors, %, of the cantilever's deflection and of the block's force and bulge, with `n` cells across each body.
fn errors(poisson: f64, n: u32, patched: bool) -> [f64; 3] {
    let [force, bulge] = block(poisson, n, patched);
    let got = [cantilever(poisson, n, patched), force, bulge];
    std::array::from_fn(|k| 100.0 * (got[k] / reference(poisson)[k] - 1.0))
}

#[test]
fn patches_free_bodies_from_volumetric_locking() {
    println!("errors against quadratic elements, %: [cantilever's deflection, pressed block's force, its bulge]");
    let bending = [2, 4, 8].map(|n| errors(0.3, n, true));
    for poisson in [0.3, 0.45, 0.49, 0.499] {
        for (k, n) in [2, 4, 8].into_iter().enumerate() {
            let (without, with) = (errors(poisson, n, false), errors(poisson, n, true));
            println!("Poisson's ratio {poisson}, cells across {n}: no patches {without:6.1?}, patches {with:6.1?}");
            assert!((0..3).all(|q| with[q].abs() < without[q].abs()), "patches must reduce all three errors");
            // With patches, the cantilever's error is that of linear elements in bending, at every Poisson's ratio.
            assert!(
                (with[0] - bending[k][0]).abs() < 2.0,
                "the cantilever's error with patches must hardly depend on Poisson's ratio"
            );
            assert!(with[0] < 0.0 && with[1] > 0.0, "linear elements must be too stiff, not too soft");
        }
    }
    let (without, with) = (errors(0.45, 8, false), errors(0.45, 8, true));
    assert!(without[0] < -15.0 && with[0] > -5.0 && without[1] > 9.0 && with[1] < 4.0);
    let (without, with) = (errors(0.499, 8, false), errors(0.499, 8, true));
    assert!(without[0] < -80.0 && with[0] > -5.0 && without[1] > 150.0 && with[1] < 5.0);
}

/// A rotated box that has F-bar patches and randomly moved nodes, and random displacements of its nodes by at most
/// `amplitude` (m) along each axis.
fn bent_box(seed: u64, amplitude: f64) -> (Layer, Elements, Vec<DVec3>) {
    let mut layer = kuhn_box(DVec3::ZERO, DVec3::new(0.3, 0.2, 0.1), [3, 3, 2]);
    let mut random = Random(seed);
    layer.nodes.iter_mut().for_each(|x| *x += 0.005 * random.vector());
    layer.patches = patch::patches(&layer, |_| 0);
    let elements = Elements::new(&layer, material(2e4, 0.49), DMat3::from_quat(DQuat::from_rotation_y(0.7)));
    let d = layer.nodes.iter().map(|_| amplitude * random.vector()).collect();
    (layer, elements, d)
}

#[test]
fn rigid_motion_of_patches_gives_no_force_and_bent_ones_balance() {
    let (layer, elements, bent) = bent_box(31, 0.02);
    let turn = DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 2.9));
    let d: Vec<_> = layer.nodes.iter().map(|r| turn * *r + DVec3::new(3.0, -1.0, 2.0) - *r).collect();
    let forces = elements.forces(&bent, &elements.rotations(&bent));
    // Displacements are metres in rigid motion and centimetres in the bent box, so rounding is about 100 times larger.
    assert!(greatest(&elements.forces(&d, &elements.rotations(&d))) < 100.0 * ROUNDING * greatest(&forces));
    let place = |(r, d): (&DVec3, &DVec3)| elements.frame * (*r + *d);
    let torque: DVec3 = layer.nodes.iter().zip(&bent).map(place).zip(&forces).map(|(x, f)| x.cross(*f)).sum();
    assert!(forces.iter().sum::<DVec3>().length() < ROUNDING * greatest(&forces));
    // With deformation gradient F, its polar rotation R, and the stress T in the axes that R rotates, R T F^T is
    // symmetric, also with the patch's pressure in T. Then the forces have no net torque.
    assert!(torque.length() < ROUNDING * greatest(&forces), "net torque {torque} N m, expected zero");
}

#[test]
fn stiffness_of_patches_is_its_blocks_and_rows_and_symmetric() {
    let (layer, elements, d) = bent_box(33, 0.02);
    let rotations = elements.rotations(&d);
    let mut random = Random(34);
    let mut field = || layer.nodes.iter().map(|_| random.vector()).collect::<Vec<_>>();
    let (x, y) = (field(), field());
    let (kx, ky) = (elements.apply_stiffness(&x, &rotations), elements.apply_stiffness(&y, &rotations));
    assert!((dot(&x, &ky) - dot(&y, &kx)).abs() < ROUNDING * dot(&x, &kx));
    let mut sum = vec![DVec3::ZERO; x.len()];
    for (e, nodes) in elements.tetrahedra.iter().enumerate() {
        let k = elements.stiffness_blocks(e, rotations[e], Weight::both(1.0));
        for (i, row) in nodes.iter().zip(&k) {
            nodes.iter().zip(row).for_each(|(j, block)| sum[*i as usize] += *block * x[*j as usize]);
        }
    }
    for row in elements.patch_rows(&rotations) {
        let along: f64 = row.iter().map(|(j, c)| c.dot(x[*j as usize])).sum();
        row.iter().for_each(|(i, c)| sum[*i as usize] += along * *c);
    }
    let difference: Vec<_> = sum.iter().zip(&kx).map(|(a, b)| *a - *b).collect();
    assert!(greatest(&difference) < ROUNDING * greatest(&kx));
}

#[test]
fn forces_of_patches_are_the_gradient_of_their_energy() {
    let (layer, elements, d) = bent_box(35, 0.005);
    let rotations = elements.rotations(&d);
    let mut random = Random(36);
    let p: Vec<_> = layer.nodes.iter().map(|_| 0.01 * random.vector()).collect();
    let world: Vec<_> = p.iter().map(|p| elements.frame * *p).collect();
    let moved = |t: f64| d.iter().zip(&p).map(|(d, p)| *d + t * *p).collect::<Vec<_>>();
    let step = 1e-4;
    let energy = |t: f64| elements.energy(&moved(t), &elements.rotations(&moved(t)));
    let slope = (energy(step) - energy(-step)) / (2.0 * step);
    let work = -dot(&elements.forces(&d, &rotations), &world);
    // Central differences with a step of 1e-4 have errors of about 1e-8 by truncation and 1e-12 by cancellation.
    assert!((slope - work).abs() < 1e-7 * work.abs(), "slope of the energy {slope} J, work of the forces {work} J");
    let (up, down) = (elements.forces(&moved(step), &rotations), elements.forces(&moved(-step), &rotations));
    let difference: Vec<_> = up.iter().zip(&down).map(|(u, w)| -(*u - *w) / (2.0 * step)).collect();
    let product = elements.apply_stiffness(&world, &rotations);
    let error: Vec<_> = difference.iter().zip(&product).map(|(a, b)| *a - *b).collect();
    assert!(greatest(&error) < 1e-7 * greatest(&product));
}

/// Eigenvalues of the stiffness matrix at rest, ascending, N/m.
fn eigenvalues(elements: &Elements) -> Vec<f64> {
    let rotations = vec![DQuat::IDENTITY; elements.tetrahedra.len()];
    let count = 3 * elements.node_count();
    let mut matrix = Mat::zeros(count, count);
    for column in 0..count {
        let mut unit = vec![DVec3::ZERO; elements.node_count()];
        unit[column / 3][column % 3] = 1.0;
        for (i, f) in elements.apply_stiffness(&unit, &rotations).iter().enumerate() {
            (0..3).for_each(|axis| matrix[(3 * i + axis, column)] = f[axis]);
        }
    }
    matrix.self_adjoint_eigenvalues(Side::Lower).unwrap()
}

#[test]
fn no_mode_of_patches_is_softer_than_shear_alone() {
    let (_, elements, _) = bent_box(37, 0.0);
    let modes = eigenvalues(&elements);
    // `elements` has operators without Lame's lambda, because its patches apply lambda, and `without` has copies of
    // these operators. Linearising `without` anew adds lambda, because it has no patches.
    let without = Elements { patches: vec![], ..elements.clone() };
    let shear = eigenvalues(&without);
    let (d, unturned) = (vec![DVec3::ZERO; elements.node_count()], vec![DQuat::IDENTITY; elements.tetrahedra.len()]);
    let alone = eigenvalues(&without.linearised(&d, &unturned));
    println!(
        "least nonzero eigenvalues, N/m: with patches {:.3?}, shear alone (no lambda) {:.3?}, no patches {:.3?}",
        &modes[6..9],
        &shear[6..9],
        &alone[6..9]
    );
    let largest = modes[modes.len() - 1];
    assert!(modes[..6].iter().all(|m| m.abs() < ROUNDING * largest), "there must be six rigid modes");
    for ((mode, shear), alone) in modes.iter().zip(&shear).zip(&alone).skip(6) {
        assert!(*mode > shear * (1.0 - ROUNDING) && *mode < alone * (1.0 + ROUNDING) && *shear > 0.0);
    }
}
