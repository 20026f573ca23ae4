//! Tests of the kernel solve/assemble, against values found by hand and against the f64 oracle (the reference
//! implementation on the CPU). The kernel computes the right-hand side b of the linear system A x = b, and the inverses
//! of the 3x3 diagonal blocks of the operator A, which are the block Jacobi preconditioner M^-1. An attached node moves
//! with a rigid core (a rigid body inside the soft one); the other nodes are free, that is, unknowns.

use std::collections::BTreeMap;

use glam::{DMat3, DQuat, DVec3};
use palpate::internal::prepare::Layer;

use super::passes::Passes;
use crate::harness::random::Random;
use crate::harness::{Tolerance, context, expect_close};
use crate::solver::system::{DT, System, layer, layered, material, mixed, triples, two_layers};
use crate::stage::elastic::expect_of_largest;

/// Greatest allowed error of b, relative to the largest value of a body's rows. Each row sums a few dozen elastic
/// terms, of strains of order one, which f32 represents to 1e-7.
const RHS: f64 = 4.0e-6;
/// Greatest allowed error of an entry of the product of inverse and block, which is the identity: rounding of the
/// block's entries (1e-6) times its condition number (up to 30 here).
const IDENTITY: f64 = 3.0e-5;
/// Greatest allowed relative error of M^-1 b and of b . M^-1 b: sums of a hundred products with f32 blocks.
const SUM: f64 = 2.0e-5;

/// The 3x3 diagonal block of each free node in the oracle's matrix; `None` for attached nodes.
fn true_blocks(system: &System) -> Vec<Option<DMat3>> {
    let (a, _) = system.twin.assemble(system.device.as_ref(), &system.twin_contacts);
    let mut sums: BTreeMap<(usize, usize), f64> = BTreeMap::new();
    let tool = system.twin.unknowns().tool;
    for (i, j, value) in a.lower().filter(|(i, j, _)| *i < tool && i / 3 == j / 3) {
        *sums.entry((i, j)).or_default() += value;
        if i != j {
            *sums.entry((j, i)).or_default() += value;
        }
    }
    let block = |first: usize| DMat3::from_cols_array(&std::array::from_fn(|k| sums[&(first + k % 3, first + k / 3)]));
    let own = |map: &palpate_oracle::step::Map| if let [(first, _)] = map[..] { Some(block(first)) } else { None };
    system.twin.unknowns().nodes.iter().flatten().map(own).collect()
}

/// Compares the right-hand side, the inverse blocks, M^-1 b and inner products with the oracle's.
fn expect_oracle(what: &str, system: System) {
    let mut passes = Passes::new(system);
    let mut random = Random(61);
    // The residual carried over from the last step is about a tenth of the impulse of a node's weight in a step.
    let carried_residual = passes.system.random_field(&mut random);
    passes.carried_residual = carried_residual.iter().map(|x| x.map(|x| 1e-4 * x)).collect();
    passes.assemble();
    let s = &passes.system;
    let (_, b) = s.twin.assemble(s.device.as_ref(), &s.twin_contacts);
    let carried = s.unknowns(&passes.carried_residual, &[0.0; 6]);
    let b: Vec<f64> = b.iter().zip(carried).map(|(b, l)| b + l).collect();
    let (want, _) = s.rows(&b);
    let got = triples(&passes.rhs);
    let mut at = 0;
    for (body, want) in want.iter().enumerate() {
        expect_of_largest(&format!("{what}: rhs of body {body}"), &got[at..at + want.len()], want, RHS);
        at += want.len();
    }
    let mut sum = 0.0;
    for (i, block) in true_blocks(s).into_iter().enumerate() {
        let inverse = DMat3::from_cols_array_2d(
            &[0, 1, 2].map(|k| passes.precondition(i, std::array::from_fn(|l| f64::from(u8::from(k == l))))),
        );
        let Some(block) = block else {
            assert_eq!(inverse, DMat3::ZERO, "{what}: inverse block of node {i}, which is attached");
            assert_eq!(passes.rhs[i], [0.0; 4]);
            continue;
        };
        let error = (inverse * block - DMat3::IDENTITY).to_cols_array();
        assert!(
            error.iter().all(|e| e.abs() < IDENTITY),
            "{what}: node {i}: inverse times block, less the identity: {error:?}"
        );
        let b = DVec3::from_slice(&triples(&passes.rhs[i..=i]).map_wide());
        sum += b.dot(inverse * b);
    }
    let got: f64 = passes.partials.iter().map(|p| f64::from(p[0])).sum();
    assert!((got - sum).abs() <= SUM * sum, "{what}: b . M^-1 b = {got:e}, want {sum:e}");
    let floor: f64 = passes.partials.iter().map(|p| f64::from(p[1])).sum();
    assert!(
        floor <= 1e-10 * got && floor >= 0.0 && (floor > 0.0) == (got > 0.0),
        "{what}: rounding error of b . M^-1 b is estimated as {floor:e}, expected at most 1e-10 of {got:e}"
    );
}

trait Wide {
    fn map_wide(&self) -> Vec<f64>;
}

impl Wide for Vec<f32> {
    fn map_wide(&self) -> Vec<f64> {
        self.iter().map(|x| f64::from(*x)).collect()
    }
}

#[test]
fn a_tetrahedron_at_rest_by_hand() {
    // At rest b = h m g, and the diagonal block of node i is (1 + h alpha) m I + (h^2 + h beta) V (mu (|g_i|^2 I + g_i
    // g_i^T) + lambda g_i g_i^T), with time step h, node mass m, gravity g, damping alpha (by mass) and beta (by
    // stiffness), volume V, Lamé constants mu and lambda, and gradient g_i of the node's shape function. The block of
    // node 1, whose gradient is e_x, is diagonal. Node 2 is attached.
    let nodes = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
    let tetrahedron =
        Layer { nodes, tetrahedra: vec![[0, 1, 2, 3]], attached: vec![false, false, true, false], ..Layer::default() };
    let mut system = System::new(&[layered(tetrahedron, material(2e4), DQuat::IDENTITY)], 0.0, 1);
    system.velocity.fill([0.0; 4]);
    system.rotate();
    let mut passes = Passes::new(system);
    passes.carried_residual[3] = [0.0, 0.0, 7.0, 0.0];
    passes.assemble();
    let (h, m, scale) = (f64::from(DT), 1000.0 / 24.0, f64::from(DT) * (f64::from(DT) + 2e-3) / 6.0);
    let (mu, lambda) = (2e4 / 2.9, 2e4 * 0.45 / (1.45 * 0.1));
    let rounding = Tolerance { abs: 0.0, rel: 2e-6 };
    let weight = [1.5 * h * m, -9.75 * h * m, 0.5 * h * m];
    let want = [weight, weight, [0.0; 3], [weight[0], weight[1], weight[2] + 7.0]].concat();
    expect_close("rhs", &triples(&passes.rhs), &want, rounding);
    let mass = (1.0 + h * 0.5) * m;
    let (along, across) = (mass + scale * (2.0 * mu + lambda), mass + scale * mu);
    let want = [1.0 / along, 1.0 / across, 1.0 / across, 0.0, 0.0, 0.0];
    expect_close("inverse block of node 1", &triples(&passes.inverse[2..4]), &want, rounding);
    assert_eq!(passes.inverse[4..6], [[0.0; 4]; 2], "inverse block of node 2, which is attached");
}

#[test]
fn the_right_hand_side_and_the_blocks_agree_with_the_oracle_at_every_size() {
    let width = context().reduce_size() as usize;
    for nodes in [0, 1, width - 1, width, width + 1, 1234] {
        let bodies =
            if nodes == 0 { vec![] } else { vec![layered(layer(nodes), material(2e4), DQuat::from_rotation_y(2.0))] };
        expect_oracle(&format!("{nodes} nodes"), System::new(&bodies, 0.004, 3));
    }
}

#[test]
fn contacts_count_in_the_right_hand_side_and_the_blocks() {
    // A contact acts on one vertex of a skin (surface mesh of a body), on the three vertices of an opposing triangle,
    // whose tetrahedra share nodes, or on the tool (rigid body that the haptic device leads). Some contacts are
    // released: they have no stiffness.
    for seed in 0..3 {
        let system = System::new(&two_layers(), 0.004, seed).with_contacts(100, seed + 70);
        expect_oracle("contacts", system);
        let system = System::new(&two_layers(), 0.004, seed).with_tool().with_contacts(100, seed + 80);
        expect_oracle("contacts and a tool", system);
        let system = System::new(&two_layers(), 0.004, seed).with_tool().with_friction().with_contacts(100, seed + 80);
        expect_oracle("friction", system);
    }
}

#[test]
fn mixed_materials_count_with_their_own_density_and_damping() {
    // Each element's density and its damping alpha (by mass) count at its nodes; its material law and its damping beta
    // (by stiffness) enter with its gradients.
    let bodies = [
        layered(layer(200), mixed(1000), DQuat::from_rotation_y(2.0)),
        layered(layer(65), mixed(300), DQuat::from_rotation_x(-1.0)),
    ];
    expect_oracle("mixed materials", System::new(&bodies, 0.004, 3));
}

#[test]
fn the_inverse_blocks_are_symmetric_and_positive() {
    // Whatever rounding does, the preconditioner must stay positive definite, also under stiff contacts.
    let mut system = System::new(&two_layers(), 0.012, 9).with_tool().with_friction().with_contacts(100, 90);
    system.contacts.iter_mut().for_each(|contact| {
        contact.damping *= 100.0;
        contact.friction *= 100.0;
    });
    let mut passes = Passes::new(system);
    passes.assemble();
    let mut random = Random(91);
    for (i, info) in passes.system.model.node_info.iter().enumerate().filter(|(_, info)| info[3] == 0) {
        for _ in 0..10 {
            let x = random.vector().to_array();
            let z = passes.precondition(i, x);
            assert!(
                x[0] * z[0] + x[1] * z[1] + x[2] * z[2] > 0.0,
                "node {i}, {info:?}: x . M^-1 x is not positive for x = {x:?}, M^-1 x = {z:?}"
            );
        }
    }
}
