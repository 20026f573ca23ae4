//! Tests of the stable neo-Hookean law in f64: force as gradient of the energy, small strain, rigid motion, and the
//! operator, a positive semi-definite approximation of the energy's second derivative; then the error of linearised
//! steps against steps solved to convergence. F is the deformation gradient, R its polar rotation, R^T F - I the
//! strain.

use faer::{Mat, Side};
use glam::{DMat3, DQuat, DVec3};
use palpate::internal::prepare::Layer;
use palpate::internal::prepare::layer::kuhn_box;
use palpate::scene::{Material, MaterialLaw};

use super::material;
use crate::elastic::{Elements, Weight, axial, lame, outer, polar_rotation, strain};
use crate::linear::{Entries, Solver};
use crate::neo_hookean::{energy, stress};
use crate::testing::Random;

/// Lame parameters mu and lambda, Pa.
const LAME: (f64, f64) = (2e4, 9e4);
/// Relative tolerance for central differences.
const DIFFERENCE: f64 = 1e-7;

fn matter(young: f64, poisson: f64) -> Material {
    Material { law: MaterialLaw::NeoHookean, ..material(young, poisson) }
}

fn random_matrix(random: &mut Random) -> DMat3 {
    DMat3::from_cols(random.vector(), random.vector(), random.vector())
}

/// Inner product A : B, the sum of products of entries.
fn inner(a: DMat3, b: DMat3) -> f64 {
    a.to_cols_array().iter().zip(b.to_cols_array()).map(|(a, b)| a * b).sum()
}

#[test]
fn stress_is_the_gradient_of_the_energy_and_free_of_cancellation() {
    let mut random = Random(1);
    for size in [1.5, 0.3, 1e-2] {
        for _ in 0..50 {
            // Some of these strains turn a tetrahedron inside out (det F < 0).
            let (e, along) = (random_matrix(&mut random) * size, random_matrix(&mut random));
            let step = 1e-5 * size;
            let slope = (energy(LAME, e + along * step) - energy(LAME, e - along * step)) / (2.0 * step);
            let work = inner(stress(LAME, e), along);
            assert!(
                (slope - work).abs() < 10.0 * DIFFERENCE * LAME.1 * size,
                "strain of size {size}: slope of the energy along a direction {slope} Pa, stress along it {work} Pa"
            );
        }
    }
    // At a strain of 1e-12 the law is Hooke's. Subtracting numbers of order one would leave only four correct digits of
    // the stress.
    let e = random_matrix(&mut random) * 1e-12;
    let (mu, lambda) = LAME;
    let hooke =
        (e + e.transpose()) * mu + DMat3::from_diagonal(DVec3::splat(lambda * (e.x_axis.x + e.y_axis.y + e.z_axis.z)));
    let error = stress(LAME, e) - hooke;
    assert!(inner(error, error).sqrt() < 1e-10 * inner(hooke, hooke).sqrt());
}

#[test]
fn rigid_motion_gives_no_force_and_small_strain_that_of_the_other_law() {
    let layer = kuhn_box(DVec3::ZERO, DVec3::new(0.3, 0.2, 0.1), [3, 2, 2]);
    let [soft, linear] =
        [matter(2e4, 0.4), material(2e4, 0.4)].map(|material| Elements::new(&layer, material, DMat3::IDENTITY));
    let turn = DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 2.9));
    let mut random = Random(2);
    let bend: Vec<DVec3> = layer.nodes.iter().map(|_| random.vector()).collect();
    let moved = |size: f64| -> Vec<DVec3> {
        layer.nodes.iter().zip(&bend).map(|(r, b)| turn * (*r + size * *b) + DVec3::X - *r).collect()
    };
    let forces = |elements: &Elements, d: &[DVec3]| elements.forces(d, &elements.rotations(d));
    let greatest = |f: &[DVec3]| f.iter().map(|f| f.length()).fold(0.0, f64::max);
    let rigid = greatest(&forces(&soft, &moved(0.0)));
    for (size, share) in [(1e-5, 1e-2), (1e-7, 1e-4)] {
        let (a, b) = (forces(&soft, &moved(size)), forces(&linear, &moved(size)));
        let error: Vec<DVec3> = a.iter().zip(&b).map(|(a, b)| *a - *b).collect();
        assert!(
            greatest(&error) < share * greatest(&b),
            "displacements of {size} m: the two laws' forces differ by {:e} N; greatest corotational force {:e} N",
            greatest(&error),
            greatest(&b)
        );
        assert!(rigid < 1e-5 * greatest(&b), "rigid motion gives a force of {rigid:e} N");
    }
    let large = (forces(&soft, &moved(0.02)), forces(&linear, &moved(0.02)));
    assert!(greatest(&large.0) > 1.2 * greatest(&large.1), "at large strain the laws must differ");
    let torque: DVec3 = layer.nodes.iter().zip(&moved(0.02)).zip(&large.0).map(|((r, d), f)| (*r + *d).cross(*f)).sum();
    assert!(torque.length() < 1e-12 * greatest(&large.0), "there must be no net torque");
}

/// Exact change, Pa, of the first Piola-Kirchhoff stress when F = `f` changes by `df`, to first order in `df`, from the
/// Lame parameters mu and lambda.
fn derivative((mu, lambda): (f64, f64), f: DMat3, df: DMat3) -> DMat3 {
    let (m, l) = (4.0 / 3.0 * mu, lambda + 5.0 / 6.0 * mu);
    let cof = |f: DMat3| DMat3::from_cols(f.y_axis.cross(f.z_axis), f.z_axis.cross(f.x_axis), f.x_axis.cross(f.y_axis));
    // Cofactors are quadratic in F, so this central difference is exact.
    let dcof = (cof(f + df) - cof(f - df)) * 0.5;
    let invariant = inner(f, f);
    let p = l * (f.determinant() - 1.0) - mu;
    df * (m * (1.0 - 1.0 / (invariant + 1.0)))
        + f * (2.0 * m * inner(f, df) / (invariant + 1.0).powi(2))
        + dcof * p
        + cof(f) * (l * inner(cof(f), df))
}

fn unit(k: usize) -> DMat3 {
    DMat3::from_cols_array(&std::array::from_fn(|i| if i == k { 1.0 } else { 0.0 }))
}

/// The derivative of the first Piola-Kirchhoff stress by F, as a 9x9 matrix with its negative eigenvalues set to zero.
fn projected(lame: (f64, f64), f: DMat3) -> Mat<f64> {
    let columns: Vec<[f64; 9]> = (0..9).map(|k| derivative(lame, f, unit(k)).to_cols_array()).collect();
    let full = Mat::from_fn(9, 9, |i, j| columns[j][i]);
    let eigen = full.self_adjoint_eigen(Side::Lower).unwrap();
    let (values, vectors) = (eigen.S(), eigen.U());
    Mat::from_fn(9, 9, |i, j| (0..9).map(|k| vectors[(i, k)] * values[k].max(0.0) * vectors[(j, k)]).sum())
}

#[test]
fn the_derivative_is_that_of_the_stress() {
    let mut random = Random(3);
    for _ in 0..50 {
        let (e, along) = (random_matrix(&mut random), random_matrix(&mut random));
        let slope = (stress(LAME, e + along * 1e-6) - stress(LAME, e - along * 1e-6)) * (0.5 / 1e-6);
        let error = slope - derivative(LAME, DMat3::IDENTITY + e, along);
        assert!(inner(error, error).sqrt() < 1e-7 * LAME.1, "error of the derivative of the stress: {error} Pa");
    }
}

/// Quadratic form, Pa, of the engine's operator at `strain`, for a change `df` of R^T F: 2 mu |sym W|^2 + lambda
/// tr(W)^2 + w^T Z w with the operator's moduli mu and lambda, its geometric stiffness Z, W = `df` `fold` and the axial
/// vector w of the skew part of W. The operator's matrix `fold` maps gradients at rest to gradients of the deformed
/// tetrahedron.
fn offered(lame: (f64, f64), strain: DMat3, df: DMat3) -> f64 {
    let (mu, lambda) = lame;
    let (young, poisson) = (mu * (3.0 * lambda + 2.0 * mu) / (lambda + mu), 0.5 * lambda / (lambda + mu));
    let operator = crate::material_law::operator(&matter(young, poisson), lambda, strain);
    let w = df * operator.fold;
    let (s, trace) = ((w + w.transpose()) * 0.5, w.x_axis.x + w.y_axis.y + w.z_axis.z);
    let turned = axial(w);
    2.0 * operator.mu * inner(s, s) + operator.lambda * trace * trace + turned.dot(operator.geometric * turned)
}

/// A linearised implicit step whose right-hand side has the exact rate of the force is stable if its operator has at
/// least three quarters of the true stiffness for plane waves: changes a k^T of F, with amplitude a and wave vector k. At rest the operator is exact for every change of F.
#[test]
fn the_operator_is_exact_at_rest_and_enough_for_waves_at_any_stretch() {
    let mut random = Random(4);
    for _ in 0..100 {
        let df = random_matrix(&mut random);
        let truth = inner(derivative(LAME, DMat3::IDENTITY, df), df);
        assert!(
            (offered(LAME, DMat3::ZERO, df) - truth).abs() < 1e-12 * truth.abs().max(LAME.0),
            "the operator at rest must be exact"
        );
    }
    let (mut least, mut most, mut at_rest) = (f64::INFINITY, 0.0f64, f64::INFINITY);
    for lame in [LAME, (2e4, 0.0), (2e4, 2e6)] {
        for _ in 0..20_000 {
            let axes = DMat3::from_quat(DQuat::from_scaled_axis(3.0 * random.vector()));
            // Principal stretches range from -0.5 (inside out) to 2.
            let stretch = DVec3::splat(0.75) + 1.25 * random.vector();
            let s = axes * DMat3::from_diagonal(stretch) * axes.transpose();
            let wave = outer(random.vector().normalize(), random.vector().normalize());
            let truth = inner(derivative(lame, s, wave), wave);
            let share = offered(lame, s - DMat3::IDENTITY, wave) / truth;
            if truth > 1e-3 * lame.0 && stretch.min_element() > 0.3 {
                (least, most) = (least.min(share), most.max(share));
                at_rest = at_rest.min(offered(lame, DMat3::ZERO, wave) / truth);
            }
        }
    }
    println!(
        "share of true stiffness for waves: operator {least:.3} to {most:.3}, operator at rest at least {at_rest:.3}"
    );
    assert!(at_rest < 0.4, "the operator at rest has the share {at_rest} of the true stiffness, must be below 0.4");
    assert!(least > 0.75, "the operator has the share {least} of the true stiffness for waves, must exceed 0.75");
}

/// Operators with which a step may be linearised.
#[derive(Clone, Copy, PartialEq, Debug)]
enum Linear {
    /// The operator at rest, rotated with the tetrahedron, as in the corotational law.
    Rest,
    /// The engine's operator without geometric stiffness; it is isotropic in gradients of the deformed tetrahedron.
    Isotropic,
    /// The engine's operator.
    Engine,
    /// The second derivative of the energy, whose negative eigenvalues in each tetrahedron are set to zero.
    Full,
    /// Newton's method: `Full`, repeated within each step to convergence.
    Newton,
}

/// A moving block whose nodes at x = 0 are held.
struct Block {
    layer: Layer,
    elements: Elements,
    d: Vec<DVec3>,
    v: Vec<DVec3>,
    solver: Solver,
}

impl Block {
    fn new(deform: impl Fn(DVec3) -> DVec3) -> Self {
        let mut layer = kuhn_box(DVec3::ZERO, DVec3::new(0.2, 0.1, 0.1), [6, 3, 3]);
        layer.attached = layer.nodes.iter().map(|x| x.x == 0.0).collect();
        let elements = Elements::new(&layer, matter(2e4, 0.45), DMat3::IDENTITY);
        let d = layer.nodes.iter().map(|x| deform(*x) - *x).collect();
        let v = vec![DVec3::ZERO; layer.nodes.len()];
        Block { layer, elements, d, v, solver: Solver::default() }
    }

    fn forces(&self, d: &[DVec3]) -> Vec<DVec3> {
        self.elements.forces(d, &self.elements.rotations(d))
    }

    /// Passes the stiffness matrix at displacements `d` to `add`: each call gets two nodes of a tetrahedron and the 3x3
    /// block of this tetrahedron's stiffness between them.
    fn stiffness(&self, how: Linear, d: &[DVec3], mut add: impl FnMut(usize, usize, DMat3)) {
        let rotations = self.elements.rotations(d);
        let now = match how {
            Linear::Isotropic | Linear::Engine => &self.elements.linearised(d, &rotations),
            _ => &self.elements,
        };
        for (e, nodes) in now.tetrahedra.iter().enumerate() {
            let blocks = match how {
                Linear::Rest | Linear::Engine => now.stiffness_blocks(e, rotations[e], Weight::both(1.0)),
                Linear::Isotropic => now.stiffness_blocks(e, rotations[e], Weight { moduli: 1.0, geometric: 0.0 }),
                _ => {
                    let f = DMat3::IDENTITY + now.gradient(e, d);
                    let h = projected(lame(&now.materials[e]), f);
                    let g = now.gradients[e];
                    let entry = |i: usize, j: usize, r: usize, c: usize| -> f64 {
                        let pair = |k: usize, l: usize| g[i][k] * g[j][l] * h[(3 * k + r, 3 * l + c)];
                        (0..9).map(|k| pair(k / 3, k % 3)).sum::<f64>() * now.volumes[e]
                    };
                    let block = |i, j| DMat3::from_cols_array(&std::array::from_fn(|k| entry(i, j, k % 3, k / 3)));
                    std::array::from_fn(|i| std::array::from_fn(|j| block(i, j)))
                }
            };
            for (i, row) in nodes.iter().zip(&blocks) {
                for (j, block) in nodes.iter().zip(row) {
                    add(*i as usize, *j as usize, *block);
                }
            }
        }
    }

    /// Solves (M + h^2 K) x = b over free nodes, with masses M, stiffness matrix K at displacements `d` and a step of
    /// `h` seconds; if `velocity`, h^2 K v is first subtracted from b, with v the velocities.
    fn solve(&mut self, how: Linear, h: f64, d: &[DVec3], mut b: Vec<DVec3>, velocity: bool) -> Vec<DVec3> {
        let free: Vec<usize> = (0..d.len()).filter(|i| !self.layer.attached[*i]).collect();
        let mut place = vec![usize::MAX; d.len()];
        free.iter().enumerate().for_each(|(k, i)| place[*i] = 3 * k);
        let mut a = Entries::default();
        let v = self.v.clone();
        self.stiffness(how, d, |i, j, block| {
            if velocity {
                b[i] -= h * h * (block * v[j]);
            }
            if place[i] != usize::MAX && place[j] != usize::MAX {
                (0..9).for_each(|k| a.add(place[i] + k % 3, place[j] + k / 3, h * h * block.col(k / 3)[k % 3]));
            }
        });
        for i in &free {
            (0..3).for_each(|k| a.add(place[*i] + k, place[*i] + k, self.elements.masses[*i]));
        }
        let right: Vec<f64> = free.iter().flat_map(|i| b[*i].to_array()).collect();
        let x = self.solver.solve(&a, &right).unwrap();
        let mut all = vec![DVec3::ZERO; d.len()];
        free.iter().zip(x.chunks(3)).for_each(|(i, x)| all[*i] = DVec3::from_slice(x));
        all
    }

    fn step(&mut self, how: Linear, h: f64) {
        if how != Linear::Newton {
            let d = self.d.clone();
            // The engine's right-hand side has the exact rate of the force; other operators multiply the velocity.
            let exact = how == Linear::Engine;
            let rates = self.elements.force_rates(&d, &self.elements.rotations(&d), &self.v);
            let extrapolated = self.forces(&d).into_iter().zip(rates);
            let b = extrapolated.map(|(f, rate)| h * (f + if exact { h * rate } else { DVec3::ZERO })).collect();
            let change = self.solve(how, h, &d, b, !exact);
            self.v.iter_mut().zip(change).for_each(|(v, dv)| *v += dv);
            self.d.iter_mut().zip(&self.v).for_each(|(d, v)| *d += h * *v);
            return;
        }
        let (start, before) = (self.d.clone(), self.v.clone());
        for _ in 0..50 {
            let end: Vec<DVec3> = start.iter().zip(&self.v).map(|(d, v)| *d + h * *v).collect();
            let momentum = self.elements.masses.iter().zip(&before).zip(&self.v).map(|((m, v0), v)| *m * (*v0 - *v));
            let b: Vec<DVec3> = momentum.zip(self.forces(&end)).map(|(b, f)| b + h * f).collect();
            let change = self.solve(Linear::Full, h, &end, b, false);
            self.v.iter_mut().zip(&change).for_each(|(v, dv)| *v += *dv);
            if change.iter().map(|dv| dv.length()).fold(0.0, f64::max) < 1e-9 {
                self.d.iter_mut().zip(&self.v).for_each(|(d, v)| *d += h * *v);
                return;
            }
        }
        panic!("Newton's method does not converge");
    }
}

/// Greatest error of a node's position over 100 ms in steps of `h` seconds, relative to the greatest initial
/// displacement. `reference`: displacements after each of 100 steps of 1 ms, solved to convergence.
fn error(how: Linear, h: f64, reference: &[Vec<DVec3>], deform: impl Fn(DVec3) -> DVec3) -> f64 {
    let mut block = Block::new(deform);
    let greatest = block.d.iter().map(|d| d.length()).fold(0.0, f64::max);
    let mut worst = 0.0f64;
    for want in reference {
        (0..(1e-3 / h).round() as usize).for_each(|_| block.step(how, h));
        let apart = block.d.iter().zip(want).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
        worst = worst.max(apart / greatest);
    }
    worst
}

fn stretched(x: DVec3) -> DVec3 {
    x * DVec3::new(1.6, 0.8, 0.8)
}

fn pressed(x: DVec3) -> DVec3 {
    x * DVec3::new(0.55, 1.3, 1.3)
}

fn twisted(x: DVec3) -> DVec3 {
    let turn = DQuat::from_rotation_x(std::f64::consts::PI * x.x / 0.2);
    let middle = DVec3::new(0.0, 0.05, 0.05);
    turn * (x - middle) + middle
}

#[test]
fn a_step_in_deformed_gradients_is_near_a_converged_one() {
    for (name, deform, share) in
        [("stretched", stretched as fn(DVec3) -> DVec3, 0.5), ("pressed", pressed, 0.5), ("twisted", twisted, 0.2)]
    {
        let mut block = Block::new(deform);
        let reference: Vec<Vec<DVec3>> = (0..100)
            .map(|_| {
                block.step(Linear::Newton, 1e-3);
                block.d.clone()
            })
            .collect();
        let of = |how: Linear, h: f64| error(how, h, &reference, deform);
        let hows = [Linear::Rest, Linear::Isotropic, Linear::Engine, Linear::Full];
        let [rest, isotropic, engine, full] = hows.map(|how| of(how, 1e-3));
        let finer = of(Linear::Newton, 2.5e-4);
        println!(
            "{name}: relative error of position with the operator at rest {rest:.2e}, with the engine's operator \
             {engine:.2e}, without its geometric stiffness {isotropic:.2e}, with the second derivative of the energy \
             {full:.2e}; relative difference of converged steps of 0.25 ms and 1 ms {finer:.2e}"
        );
        assert!(
            engine < share * finer,
            "{name}: the error with the engine's operator must be less than {share} times the difference between converged steps of 0.25 ms and of 1 ms"
        );
    }
}

#[test]
fn inverted_tetrahedra_come_back() {
    // The block starts inside out along its length, and takes steps with the engine's operator.
    let mut block = Block::new(|x| x * DVec3::new(-0.3, 1.1, 1.1));
    (0..400).for_each(|_| block.step(Linear::Engine, 1e-3));
    for e in 0..block.elements.tetrahedra.len() {
        let f = DMat3::IDENTITY + block.elements.gradient(e, &block.d);
        assert!(f.determinant() > 0.2, "tetrahedron {e}: det F is {}, must exceed 0.2", f.determinant());
        let q = polar_rotation(f);
        assert!(strain(q, block.elements.gradient(e, &block.d)).is_finite());
    }
}
