//! Tests of the inverse of the coarse matrix A_c = P^T A P that the host computes, against that of the f64 oracle, the
//! reference implementation on the CPU. A is the operator of the linear system; the columns of the prolongation P are
//! modes, affine motions of blocks of nodes (mod.rs explains the coarse space).

use faer::{Mat, Side};
use glam::DQuat;
use palpate::scene::Preconditioner;
use palpate_oracle::coarse::{correction, matrix};
use palpate_oracle::linear::Entries;

use super::{coarse_vector_of, host_inverse, kinds, large_core, rest_turns};
use crate::solver::system::{System, layer, layered, material};

/// Relative rounding of a number stored in half precision: half a unit in the last place.
const HALF: f64 = 1.0 / 2048.0;
/// Greatest allowed error of an entry, relative to the geometric mean of the diagonal entries of its row and column:
/// rounding of node positions, gradients and masses to f32 (6e-8) times the condition number of the scaled matrix, one
/// or two hundred.
const INPUT: f64 = 2e-5;

fn absolute(matrix: &Mat<f64>) -> Mat<f64> {
    Mat::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)].abs())
}

#[test]
fn the_host_s_inverse_is_the_oracle_s() {
    // The product P A_c^-1 P^T, which maps a residual to its correction, is compared: it is unique even where
    // modes are linearly dependent.
    for (what, bodies) in kinds() {
        let system = System::preconditioned(&bodies, 0.0, 1, Preconditioner::Coarse);
        let p = coarse_vector_of(&system, &rest_turns(&system));
        let (a, _) = system.twin.assemble(None, &[]);
        let want = correction(&a, &p).unwrap();
        // The oracle itself is checked: its correction leaves no error that the modes can represent.
        let (square, of_p) = (matrix(&a, &Mat::identity(p.nrows(), p.nrows())), absolute(&p));
        let left = &want * &square * &p - &p;
        let worst = (0..p.nrows()).flat_map(|i| (0..p.ncols()).map(move |j| (i, j))).map(|at| left[at].abs());
        assert!(
            worst.fold(0.0, f64::max) < 1e-8,
            "{what}: the oracle's correction leaves an error in the span of the modes"
        );
        let inverse = host_inverse(&system.model, false);
        let got = &p * &inverse * p.transpose();
        let rounding = &of_p * absolute(&inverse) * of_p.transpose();
        let mut worst = (0.0, 0, 0);
        for i in 0..p.nrows() {
            for j in 0..p.nrows() {
                let size = (want[(i, i)] * want[(j, j)]).sqrt();
                let allowed = HALF * rounding[(i, j)] + INPUT * size + f64::MIN_POSITIVE;
                let share = (got[(i, j)] - want[(i, j)]).abs() / allowed;
                worst = if share > worst.0 || share.is_nan() { (share, i, j) } else { worst };
            }
        }
        let (share, i, j) = worst;
        println!("{what}: {} modes, {} unknowns, largest error {share:.3} times the tolerance", p.ncols(), p.nrows());
        assert!(share < 1.0, "{what}: entry {:e} at row {i}, column {j}, expected {:e}", got[(i, j)], want[(i, j)]);
    }
}

#[test]
fn the_inverse_is_symmetric_to_the_bit_and_has_ones_on_its_diagonal() {
    for (what, bodies) in kinds() {
        let system = System::preconditioned(&bodies, 0.0, 1, Preconditioner::Coarse);
        let inverse = host_inverse(&system.model, true);
        let mut used = 0;
        for i in 0..inverse.nrows() {
            (0..i).for_each(|j| assert_eq!(inverse[(i, j)], inverse[(j, i)], "{what}: entry ({i}, {j})"));
            let any = (0..inverse.ncols()).any(|j| inverse[(i, j)] != 0.0);
            assert_eq!(inverse[(i, i)], if any { 1.0 } else { 0.0 }, "{what}: diagonal entry {i}");
            used += usize::from(any);
        }
        assert!(used > 0, "{what}: the inverse is zero");
    }
}

/// The block Jacobi preconditioner: the inverted diagonal blocks of A, 3x3 of nodes and 6x6 of rigid cores (rigid
/// bodies inside soft ones).
fn jacobi(system: &System, a: &Entries) -> Mat<f64> {
    let unknowns = system.twin.unknowns();
    let square = matrix(a, &Mat::identity(unknowns.count, unknowns.count));
    let mut inverse = Mat::zeros(unknowns.count, unknowns.count);
    let nodes = unknowns.nodes.iter().flatten().filter(|map| map.len() == 1).map(|map| (map[0].0, 3));
    for (first, size) in nodes.chain(unknowns.cores.iter().map(|first| (*first, 6))) {
        let block = square.submatrix(first, first, size, size).to_owned();
        let own = faer::linalg::solvers::DenseSolveCore::inverse(&block.llt(Side::Lower).unwrap());
        (0..size * size).for_each(|k| inverse[(first + k / size, first + k % size)] = own[(k / size, k % size)]);
    }
    inverse
}

/// Eigenvalues, in rising order, of a symmetric matrix that is first scaled to ones on its diagonal (zeros stay zero).
fn scaled_eigenvalues(matrix: &Mat<f64>) -> Vec<f64> {
    let root = |i: usize| if matrix[(i, i)] > 0.0 { matrix[(i, i)].sqrt() } else { 1.0 };
    let scaled = Mat::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)] / (root(i) * root(j)));
    scaled.self_adjoint_eigenvalues(Side::Lower).unwrap()
}

#[test]
fn half_precision_leaves_the_preconditioner_positive() {
    // The least eigenvalue of D^-1 + P A_c^-1 P^T (D: diagonal blocks of A), scaled to ones on the diagonal, must be
    // positive: for free bodies, and for bodies as stiff as bone.
    let mut cases: Vec<(String, System)> = Vec::new();
    for (what, bodies) in kinds() {
        cases.push((what.into(), System::preconditioned(&bodies, 0.0, 1, Preconditioner::Coarse)));
    }
    for young in [2e5, 2e6, 2e7, 2e8] {
        let body = layered(layer(216), material(young), DQuat::IDENTITY);
        cases.push((format!("{young:e} Pa"), System::preconditioned(&[body], 0.0, 1, Preconditioner::Coarse)));
    }
    let mut stiff = large_core(false);
    if let palpate::internal::prepare::Shape::Soft { materials, .. } = &mut stiff.shape {
        materials.all[0].young = 2e7;
    }
    cases.push(("2e7 Pa on a core".into(), System::preconditioned(&[stiff], 0.0, 1, Preconditioner::Coarse)));
    for (what, system) in cases {
        let p = coarse_vector_of(&system, &rest_turns(&system));
        let (a, _) = system.twin.assemble(None, &[]);
        let coarse = &p * host_inverse(&system.model, false) * p.transpose();
        let values = scaled_eigenvalues(&(jacobi(&system, &a) + &coarse));
        // Where contacts are so stiff that D^-1 vanishes, the coarse part P A_c^-1 P^T alone must still be positive,
        // apart from rounding errors of this test.
        let alone = scaled_eigenvalues(&coarse);
        assert!(
            alone[0] > -1e-11 * alone[alone.len() - 1],
            "{what}: least eigenvalue of the coarse part alone {:e}",
            alone[0]
        );
        let exact = correction(&a, &p).unwrap();
        let grown = (0..p.nrows()).map(|i| coarse[(i, i)] / exact[(i, i)]).fold(1.0, f64::max);
        let number = system.model.coarse.bodies[0].1;
        println!(
            "{what}, stiffness over inertia of a node {number:.1e}: eigenvalues of the preconditioner from {:.1e} to \
             {:.1e}, least of the coarse part alone {:.1e}; relative excess of the coarse part's diagonal over the \
             exact one up to {:.1e}",
            values[0],
            values[values.len() - 1],
            alone[0],
            grown - 1.0
        );
        assert!(values[0] > 0.0, "{what}: the preconditioner is not positive: least eigenvalue {:e}", values[0]);
    }
}
