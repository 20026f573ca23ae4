//! Tests of the f64 reference implementation of corotational elasticity: rigid motion, the patch test of uniform
//! strain, symmetry of the stiffness, forces as gradient of the energy. F is a tetrahedron's deformation gradient and R
//! its polar rotation, the rotation nearest to F. The compression penalty is a stiffness that is added where a
//! principal stretch of a tetrahedron falls below 0.3.

use glam::{DMat3, DQuat, DVec3};
use palpate::internal::prepare::Layer;
use palpate::internal::prepare::layer::kuhn_box;

use palpate::scene::{Material, MaterialLaw};

use super::material;
use crate::compression::LEAST_STRETCH;
use crate::elastic::{Elements, Operator, Weight, lame, polar_rotation, strain, trace};
use crate::material_law;
use crate::testing::Random;

/// Relative tolerance for the rounding of f64 sums of a few hundred terms.
const ROUNDING: f64 = 1e-12;
/// Relative tolerance for central differences; it is larger than their truncation and cancellation errors.
const DIFFERENCE: f64 = 1e-7;

fn bent_box(seed: u64) -> (Layer, Elements, Vec<DVec3>) {
    let mut layer = kuhn_box(DVec3::ZERO, DVec3::new(0.3, 0.2, 0.1), [3, 2, 2]);
    let mut random = Random(seed);
    layer.nodes.iter_mut().for_each(|x| *x += 0.005 * random.vector());
    let elements = Elements::new(&layer, material(2e4, 0.4), DMat3::from_quat(DQuat::from_rotation_y(0.7)));
    let d = layer.nodes.iter().map(|_| 0.02 * random.vector()).collect();
    (layer, elements, d)
}

fn greatest(v: &[DVec3]) -> f64 {
    v.iter().map(|x| x.length()).fold(0.0, f64::max)
}

fn dot(a: &[DVec3], b: &[DVec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum()
}

#[test]
fn rigid_motion_gives_no_force() {
    let (layer, elements, bent) = bent_box(1);
    let turn = DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 2.9));
    let d: Vec<_> = layer.nodes.iter().map(|r| turn * *r + DVec3::new(3.0, -1.0, 2.0) - *r).collect();
    let force = greatest(&elements.forces(&d, &elements.rotations(&d)));
    let scale = greatest(&elements.forces(&bent, &elements.rotations(&bent)));
    println!("largest nodal force: in rigid motion {force:.1e} N, in the bent box {scale:.1e} N");
    // Displacements are metres in rigid motion and centimetres in the bent box, so rounding is about 100 times larger.
    assert!(force < 100.0 * ROUNDING * scale);
}

#[test]
fn bent_body_pushes_back_as_one_at_rest() {
    let (layer, elements, d) = bent_box(2);
    let forces = elements.forces(&d, &elements.rotations(&d));
    let net: DVec3 = forces.iter().sum();
    let place = |(r, d): (&DVec3, &DVec3)| elements.frame * (*r + *d);
    let torque: DVec3 = layer.nodes.iter().zip(&d).map(place).zip(&forces).map(|(x, f)| x.cross(*f)).sum();
    let scale = greatest(&forces);
    assert!(scale > 0.1, "the bent box must have elastic forces");
    assert!(net.length() < ROUNDING * scale);
    // R T F^T, with T the stress in the axes that R rotates, is symmetric if R is the exact polar rotation of F. Then
    // the forces have no net torque.
    assert!(torque.length() < ROUNDING * scale, "net torque {torque} N m, expected zero");
    let spoiled = vec![DQuat::from_rotation_x(0.1); elements.tetrahedra.len()];
    let forces = elements.forces(&d, &spoiled);
    let torque: DVec3 = layer.nodes.iter().zip(&d).map(place).zip(&forces).map(|(x, f)| x.cross(*f)).sum();
    assert!(torque.length() > 1e-4, "a wrong rotation must cause a net torque");
}

#[test]
fn patch_of_uniform_strain_has_the_stress_of_hooke() {
    let (layer, elements, _) = bent_box(3);
    let stretch = DMat3::from_diagonal(DVec3::new(0.01, 0.0, 0.0));
    let d: Vec<_> = layer.nodes.iter().map(|r| stretch * *r).collect();
    let forces = elements.forces(&d, &elements.rotations(&d));
    let inside: Vec<_> = layer
        .nodes
        .iter()
        .map(|r| r.cmpgt(DVec3::new(0.05, 0.05, 0.02)).all() && r.cmplt(DVec3::new(0.25, 0.15, 0.08)).all())
        .collect();
    assert!(inside.iter().filter(|i| **i).count() >= 2, "the box must have inner nodes");
    for (force, _) in forces.iter().zip(&inside).filter(|(_, i)| **i) {
        assert!(force.length() < ROUNDING * greatest(&forces), "inner nodes must be in equilibrium");
    }
    let volume: f64 = elements.volumes.iter().sum();
    // Virial theorem: -sum f x^T = V sigma over nodal forces f and positions x, volume V and stress sigma. At uniaxial
    // strain eps, sigma_xx = (lambda + 2 mu) eps and sigma_yy = lambda eps.
    let turn = elements.frame.transpose();
    let virial =
        |axis: usize| -layer.nodes.iter().zip(&forces).map(|(r, f)| (turn * *f)[axis] * r[axis]).sum::<f64>() / volume;
    let (mu, lambda) = lame(&elements.materials[0]);
    let expected = (lambda + 2.0 * mu) * 0.01;
    assert!((virial(0) - expected).abs() < ROUNDING * expected, "stress xx {} Pa, expected {expected} Pa", virial(0));
    assert!((virial(1) - lambda * 0.01).abs() < ROUNDING * expected);
}

#[test]
fn stiffness_is_symmetric_positive_and_agrees_with_its_blocks() {
    let (layer, elements, d) = bent_box(4);
    let rotations = elements.rotations(&d);
    let mut random = Random(5);
    let mut field = || layer.nodes.iter().map(|_| random.vector()).collect::<Vec<_>>();
    let (x, y) = (field(), field());
    let (kx, ky) = (elements.apply_stiffness(&x, &rotations), elements.apply_stiffness(&y, &rotations));
    let scale = dot(&x, &kx);
    assert!(scale > 0.0);
    assert!((dot(&x, &ky) - dot(&y, &kx)).abs() < ROUNDING * scale);
    let mut blocks = vec![DVec3::ZERO; x.len()];
    for (e, nodes) in elements.tetrahedra.iter().enumerate() {
        let k = elements.stiffness_blocks(e, rotations[e], Weight::both(1.0));
        for (i, row) in nodes.iter().zip(&k) {
            for (j, block) in nodes.iter().zip(row) {
                blocks[*i as usize] += *block * x[*j as usize];
            }
        }
    }
    let difference: Vec<_> = blocks.iter().zip(&kx).map(|(a, b)| *a - *b).collect();
    assert!(greatest(&difference) < ROUNDING * greatest(&kx));
    let constant = vec![DVec3::new(1.0, 2.0, 3.0); x.len()];
    assert!(greatest(&elements.apply_stiffness(&constant, &rotations)) < ROUNDING * greatest(&kx));
}

/// R, the rotation nearest to F, makes the corotational energy stationary with respect to R. So the force is minus the
/// gradient of this energy although R changes with the displacements. The stiffness is minus the gradient of the force
/// with R held fixed.
#[test]
fn forces_are_the_gradient_of_the_energy() {
    let (layer, elements, d) = bent_box(6);
    // The displacements are small enough that the compression penalty does not act.
    let d: Vec<DVec3> = d.iter().map(|d| 0.3 * *d).collect();
    let rotations = elements.rotations(&d);
    let unstretched = |operator: &Operator| Operator { geometric: DMat3::ZERO, ..*operator };
    let now: Vec<_> = elements.linearised(&d, &rotations).operators.iter().map(unstretched).collect();
    assert_eq!(now, elements.operators);
    let mut random = Random(7);
    let p: Vec<_> = layer.nodes.iter().map(|_| 0.01 * random.vector()).collect();
    let world: Vec<_> = p.iter().map(|p| elements.frame * *p).collect();
    let moved = |t: f64| d.iter().zip(&p).map(|(d, p)| *d + t * *p).collect::<Vec<_>>();
    let step = 1e-4;
    let energy = |t: f64| elements.energy(&moved(t), &elements.rotations(&moved(t)));
    let slope = (energy(step) - energy(-step)) / (2.0 * step);
    let work = -dot(&elements.forces(&d, &rotations), &world);
    println!("slope of the energy {slope:.9e} J, work of the forces {work:.9e} J");
    assert!((slope - work).abs() < DIFFERENCE * work.abs());
    let (up, down) = (elements.forces(&moved(step), &rotations), elements.forces(&moved(-step), &rotations));
    let difference: Vec<_> = up.iter().zip(&down).map(|(u, w)| -(*u - *w) / (2.0 * step)).collect();
    let product = elements.apply_stiffness(&world, &rotations);
    let error: Vec<_> = difference.iter().zip(&product).map(|(a, b)| *a - *b).collect();
    assert!(greatest(&error) < DIFFERENCE * greatest(&product));
}

/// In a box pressed to a tenth of its height, with random displacements added, the compression penalty acts in most
/// tetrahedra. The force must still be minus the gradient of the energy, and the stiffness operator, linearised at
/// these displacements, at least as stiff as the slope of the force.
#[test]
fn a_squeezed_box_pushes_back_by_its_energy() {
    let (layer, elements, noise) = bent_box(16);
    let flat = |(r, n): (&DVec3, &DVec3)| DVec3::new(0.0, -0.9 * r.y, 0.0) + 0.02 * *n;
    let d: Vec<DVec3> = layer.nodes.iter().zip(&noise).map(flat).collect();
    let rotations = elements.rotations(&d);
    let operator = elements.linearised(&d, &rotations);
    assert!(
        operator.operators.iter().zip(&elements.operators).filter(|(now, rest)| now.mu > rest.mu).count()
            > elements.tetrahedra.len() / 2
    );
    let mut random = Random(17);
    let p: Vec<_> = layer.nodes.iter().map(|_| 0.01 * random.vector()).collect();
    let world: Vec<_> = p.iter().map(|p| elements.frame * *p).collect();
    let moved = |t: f64| d.iter().zip(&p).map(|(d, p)| *d + t * *p).collect::<Vec<_>>();
    let step = 1e-5;
    let energy = |t: f64| elements.energy(&moved(t), &elements.rotations(&moved(t)));
    let slope = (energy(step) - energy(-step)) / (2.0 * step);
    let work = -dot(&elements.forces(&d, &rotations), &world);
    assert!((slope - work).abs() < 1e-5 * work.abs(), "slope of the energy {slope} J, work of the forces {work} J");
    let (up, down) = (elements.forces(&moved(step), &rotations), elements.forces(&moved(-step), &rotations));
    let true_slope = -(dot(&up, &world) - dot(&down, &world)) / (2.0 * step);
    let product = dot(&operator.apply_stiffness(&world, &rotations), &world);
    assert!(
        true_slope > 1.5 * dot(&elements.apply_stiffness(&world, &rotations), &world),
        "compression must stiffen the box"
    );
    assert!(
        product >= true_slope,
        "p . K p, with the linearised operator K and displacements p, is {product} J and must be at least -p . f' = \
         {true_slope} J, with the derivative f' of the forces along p"
    );
}

#[test]
fn rotations_are_proper_and_nearest() {
    let mut random = Random(8);
    for _ in 0..200 {
        let f = DMat3::from_cols(random.vector(), random.vector(), random.vector());
        let r = DMat3::from_quat(polar_rotation(f));
        assert!((r.determinant() - 1.0).abs() < ROUNDING);
        let s = r.transpose() * f;
        let skew = s - s.transpose();
        assert!(skew.to_cols_array().iter().all(|x| x.abs() < ROUNDING), "R^T F must be symmetric");
        // R is the rotation nearest to F, so no other rotation may be nearer to F.
        let near = |r: DMat3| (r - f).to_cols_array().iter().map(|x| x * x).sum::<f64>();
        let other = DMat3::from_quat(DQuat::from_scaled_axis(0.1 * random.vector())) * r;
        assert!(near(r) <= near(other) + ROUNDING);
    }
}

#[test]
fn strain_of_tiny_displacements_keeps_its_digits() {
    let (e, w) = (1e-14, 1e-9);
    let g = DMat3::from_cols(DVec3::new(e, w, 0.0), DVec3::new(-w, 0.0, 0.0), DVec3::ZERO);
    let q = polar_rotation(DMat3::IDENTITY + g);
    let strain = strain(q, g);
    // The skew part w of the gradient g adds a strain of w^2 / 2, far below e: to two digits the strain is e along x.
    assert!((strain.x_axis.x - e).abs() < 0.01 * e, "strain {:e}, expected 1e-14", strain.x_axis.x);
    assert!(strain.y_axis.y.abs() < 0.01 * e);
}

/// The rate of the forces is their derivative along the velocity, for both laws and in a turned frame; for a rigid spin it
/// is the forces turned with the body.
#[test]
fn rates_of_forces_are_their_derivative() {
    let (layer, linear, d) = bent_box(27);
    // The displacements are small enough that the compression penalty does not act; the rate would be the operator's.
    let d: Vec<DVec3> = d.iter().map(|d| 0.3 * *d).collect();
    let neo = Material { law: MaterialLaw::NeoHookean, ..linear.materials[0] };
    for elements in [linear.clone(), Elements::new(&layer, neo, linear.frame)] {
        let forces = |d: &[DVec3]| elements.forces(d, &elements.rotations(d));
        let rates = |v: &[DVec3]| elements.force_rates(&d, &elements.rotations(&d), v);
        let mut random = Random(28);
        let v: Vec<DVec3> = layer.nodes.iter().map(|_| random.vector()).collect();
        let moved =
            |t: f64| d.iter().zip(&v).map(|(d, v)| *d + t * (elements.frame.transpose() * *v)).collect::<Vec<_>>();
        let step = 1e-6;
        let slope =
            forces(&moved(step)).into_iter().zip(forces(&moved(-step))).map(|(up, down)| (up - down) / (2.0 * step));
        let error: Vec<DVec3> = slope.zip(rates(&v)).map(|(slope, rate)| slope - rate).collect();
        let largest = greatest(&rates(&v));
        assert!(greatest(&error) < 1e-6 * largest, "rate of forces {largest} N/s, error {:e} N/s", greatest(&error));
        let spin = DVec3::new(0.3, -1.0, 2.0);
        let turning: Vec<DVec3> =
            layer.nodes.iter().zip(&d).map(|(r, d)| spin.cross(elements.frame * (*r + *d))).collect();
        let turned = forces(&d).into_iter().map(|f| spin.cross(f));
        let error: Vec<DVec3> = turned.zip(rates(&turning)).map(|(turned, rate)| turned - rate).collect();
        assert!(greatest(&error) < 1e-10 * greatest(&rates(&v)), "turning forces: error {:e} N/s", greatest(&error));
    }
}

/// Stress, its rate and the operator change by as much as the strain does where a stretch passes the one at which the
/// compression penalty starts: rounding there must not decide anything. The stress is the energy's derivative on both
/// sides and where the penalty has its full modulus.
#[test]
fn the_compression_penalty_starts_without_a_jump() {
    let mut random = Random(29);
    let rate = DMat3::from_cols(random.vector(), random.vector(), random.vector());
    for law in [MaterialLaw::Corotational, MaterialLaw::NeoHookean] {
        let material = Material { law, ..bent_box(30).1.materials[0] };
        let (mu, lambda) = lame(&material);
        let turn = DMat3::from_quat(DQuat::from_scaled_axis(random.vector()));
        let strained =
            |s: f64| turn * DMat3::from_diagonal(DVec3::new(s - 1.0, 0.1, 0.4 * (s - 0.3) - 0.68)) * turn.transpose();
        let at = |s: f64| {
            let operator = material_law::operator(&material, lambda, strained(s));
            let stress = material_law::stress(&material, lambda, strained(s));
            (stress, material_law::stress_rate(&material, lambda, strained(s), rate), operator.mu)
        };
        let change = 1e-6;
        let (below, above) = (at(LEAST_STRETCH - change), at(LEAST_STRETCH + change));
        let far = |a: DMat3, b: DMat3| greatest(&(0..3).map(|k| (a - b).col(k)).collect::<Vec<_>>());
        let most = 3000.0 * change * (lambda + 2.0 * mu);
        assert!(far(below.0, above.0) < most, "{law:?}: the stress jumps by {} Pa", far(below.0, above.0));
        assert!(far(below.1, above.1) < most, "{law:?}: the rate jumps by {} Pa/s", far(below.1, above.1));
        assert!((below.2 - above.2).abs() < most, "{law:?}: the modulus jumps by {} Pa", below.2 - above.2);
        for s in [0.31, 0.295, 0.285, 0.2] {
            let energy = |s: f64| material_law::energy(&material, strained(s), trace(strained(s)));
            let slope = (energy(s + change) - energy(s - change)) / (2.0 * change);
            let direction = (strained(s + change) - strained(s - change)) * (0.5 / change);
            let stress = material_law::stress(&material, lambda, strained(s));
            let work: f64 = (0..3).map(|k| stress.col(k).dot(direction.col(k))).sum();
            assert!(
                (slope - work).abs() < 1e-5 * (lambda + 2.0 * mu),
                "{law:?} at {s}: slope {slope} Pa, work {work} Pa"
            );
        }
    }
}
