//! Tests of supports (conditions on the motion of nodes) and of reactions (the forces that hold a body), kernel by kernel
//! and in whole solves, against the f64 oracle, the reference implementation on the CPU.

use glam::{DMat3, DVec3};
use palpate::internal::gpu::Size;
use palpate::internal::prepare::Body;
use palpate::internal::shaders::Supported;
use palpate::internal::stages::supports::Held;
use palpate::scene::Preconditioner;
use palpate_oracle::linear::Solver;

use super::passes::Passes;
use super::whole::{SOLUTION, expect_direct};
use crate::harness::random::Random;
use crate::harness::{Tolerance, expect_close};
use crate::solver::system::{System, triples, two_layers, two_layers_one_on_a_core, two_layers_supported};
use crate::stage::elastic::expect_of_largest;

/// Error of sums of a few dozen terms in f32, relative to the largest value of a body's nodes.
const SUM: f64 = 4e-6;
/// Error of a projection in f32, absolute for vectors of order one.
const PROJECTION: Tolerance = Tolerance { abs: 3e-7, rel: 0.0 };
/// The size of workgroups that make sums together, and a larger one.
const SIZES: [Size; 2] = [Size::Reduce, Size::Group];

fn system(bodies: &[Body], seed: u64, preconditioner: Preconditioner) -> System {
    System::preconditioned(bodies, 0.004, seed, preconditioner)
}

/// The projection of each node's velocity onto what supports leave to it, world axes.
fn projections(system: &System) -> Vec<DMat3> {
    system.twin.bodies.iter().flat_map(|body| body.supports.clone()).collect()
}

fn wide(x: [f32; 4]) -> DVec3 {
    DVec3::new(x[0].into(), x[1].into(), x[2].into())
}

fn three(x: [f32; 3]) -> DVec3 {
    DVec3::from(x.map(f64::from))
}

/// Compares vectors at the nodes with the oracle's, body by body.
fn expect_nodes(what: &str, system: &System, got: &[[f32; 4]], want: &[Vec<f64>], tolerance: f64) {
    for ((body, range), want) in system.model.soft.iter().enumerate().map(|(k, soft)| (k, soft.nodes.clone())).zip(want)
    {
        expect_of_largest(&format!("{what} of body {body}"), &triples(&got[range]), want, tolerance);
    }
}

#[test]
fn right_hand_side_and_blocks_are_restricted_to_what_supports_leave() {
    for size in SIZES {
        let mut passes = Passes::new(system(&two_layers_supported(), 3, Preconditioner::Coarse).with_contacts(20, 7));
        passes.size = size;
        passes.assemble();
        let s = &passes.system;
        let (a, b) = s.twin.assemble(s.device.as_ref(), &s.twin_contacts);
        let (want, _) = s.rows(&b);
        expect_nodes("b", s, &passes.rhs, &want, SUM);
        let free = s.twin.unknowns();
        let maps: Vec<_> = free.nodes.iter().flatten().collect();
        for (i, left) in projections(s).into_iter().enumerate() {
            // What is left of b and what supports take from it are in orthogonal spaces.
            let (rhs, taken) = (wide(passes.rhs[i]), three(passes.supported[i].taken));
            let largest = rhs.length() + taken.length();
            assert!((left * taken).length() <= 1e-6 * largest, "node {i}: {taken} is not what supports take");
            assert!((rhs - left * rhs).length() <= 1e-6 * largest, "node {i}: b is {rhs}");
            if maps[i].is_empty() {
                assert_eq!(passes.rhs[i], [0.0; 4], "node {i} follows a core of prescribed motion");
                continue;
            }
            // D^-1 is the inverse of the oracle's block on what is left, and has no other entries there.
            let at = maps[i][0].0;
            let column = |k: usize| {
                let mut unit = vec![0.0; b.len()];
                (0..3).for_each(|row| unit[at + row] = left.col(k)[row]);
                DVec3::from_slice(&a.multiply(&unit)[at..at + 3])
            };
            let block = DMat3::from_cols(column(0), column(1), column(2));
            let applied = |v: DVec3| DVec3::from(passes.precondition(i, v.to_array()));
            let product = left * DMat3::from_cols(applied(block.x_axis), applied(block.y_axis), applied(block.z_axis));
            let error = (product - left).to_cols_array();
            assert!(error.iter().all(|e| e.abs() < 1e-4), "node {i}: D^-1 D - S is {error:?}");
        }
    }
}

#[test]
fn products_are_restricted_and_the_impulses_that_hold_nodes_are_left() {
    for size in SIZES {
        for assembled in [true, false] {
            let mut passes =
                Passes::new(system(&two_layers_supported(), 4, Preconditioner::Coarse).with_contacts(20, 7));
            (passes.size, passes.assembled) = (size, assembled);
            passes.system.stop_at(1e-6);
            passes.record_start();
            let mut random = Random(9);
            let left = projections(&passes.system);
            let field = passes.system.random_field(&mut random);
            passes.solution =
                field.iter().zip(&left).map(|(x, left)| (*left * wide(*x)).as_vec3().extend(0.0).to_array()).collect();
            passes.apply(super::passes::Change::End);
            passes.gather(2);
            let s = &passes.system;
            let (a, _) = s.twin.assemble(None, &s.twin_contacts);
            let x = s.unknowns(&passes.solution, &[0.0; 6]);
            let (want, _) = s.rows(&a.multiply(&x));
            let what = format!("{size:?}, assembled {assembled}");
            expect_nodes(&format!("{what}: A x"), s, &passes.operator_product, &want, SUM);
            for (i, left) in left.iter().enumerate() {
                let (kept, held) = (wide(passes.operator_product[i]), three(passes.supported[i].impulse));
                let largest = kept.length() + held.length();
                assert!((*left * held).length() <= 1e-6 * largest, "{what}: node {i} is held by {held}");
                assert!((kept - *left * kept).length() <= 1e-6 * largest, "{what}: node {i}: A x is {kept}");
            }
        }
    }
}

/// Solves the system, and compares solution, the impulses that hold the nodes, and the reactions with the oracle's.
fn expect_held(what: &str, system: System, size: Size, assembled: bool) {
    let mut passes = Passes::new(system);
    (passes.size, passes.assembled) = (size, assembled);
    passes.system.stop_at(1e-6);
    passes.record_start();
    passes.keep_contacts();
    passes.iterate(400);
    assert_eq!(passes.state.status, 1, "{what}: status (1: converged) after {} iterations", passes.iterations_done());
    expect_direct(what, &passes);
    passes.record_end();
    assert!(passes.report.residual < 1e-5, "{what}: residual {:e}", passes.report.residual);
    let s = &passes.system;
    let (a, b) = s.twin.assemble(s.device.as_ref(), &s.twin_contacts);
    let change = Solver::default().solve(&a, &b).unwrap();
    let holding = s.twin.held_by(s.device.as_ref(), &s.twin_contacts, &change);
    let h = f64::from(s.params.dt);
    let want: Vec<Vec<f64>> =
        holding.iter().map(|body| body.iter().flat_map(|force| (h * *force).to_array()).collect()).collect();
    let impulses: Vec<[f32; 4]> =
        passes.supported.iter().map(|Supported { impulse: [x, y, z], .. }| [*x, *y, *z, 0.0]).collect();
    expect_nodes(&format!("{what}: impulses"), s, &impulses, &want, SOLUTION);
    // The reactions are sums over the holders' nodes, with torques about the origin.
    let held: &Held = &s.model.held;
    let got = passes.reactions();
    let places: Vec<DVec3> = (0..passes.nodes()).map(|n| world(s, n)).collect();
    for (k, holder) in held.holders.iter().enumerate() {
        let (mut force, mut torque) = (DVec3::ZERO, DVec3::ZERO);
        for at in holder.nodes.clone() {
            let node = held.list[at] as usize;
            let row = |k: usize| wide(held.shares[3 * at + k]);
            let impulse = three(passes.supported[node].impulse);
            let own = DVec3::new(row(0).dot(impulse), row(1).dot(impulse), row(2).dot(impulse)) / h;
            (force, torque) = (force + own, torque + places[node].cross(own));
        }
        let want = [force.to_array(), torque.to_array()].concat();
        let what = format!("{what}: reaction of {}", holder.name);
        expect_of_largest(&what, &got[6 * k..6 * k + 6], &want, 1e-5);
    }
    assert!(held.holders.len() >= 4, "{what}: {} holders", held.holders.len());
}

/// World position of a node relative to its frame's origin in the kernels' arrays.
fn world(system: &System, node: usize) -> DVec3 {
    let frame = &system.frames[system.model.node_info[node][2] as usize];
    let rotation = glam::DQuat::from_array(frame.rotation.map(f64::from));
    let (rest, moved) = (wide(system.model.node_rest[node]), wide(system.displacement[node]));
    DVec3::from(frame.centre.map(f64::from)) + rotation * (rest + moved)
}

#[test]
#[ignore = "long: 30 s"]
fn supported_bodies_reach_the_direct_solution_and_its_reactions() {
    for (size, assembled, with) in [(SIZES[0], true, Preconditioner::Coarse), (SIZES[1], false, Preconditioner::Jacobi)]
    {
        let layers = |seed: u64| system(&two_layers_supported(), seed, with);
        let what = |what: &str| format!("{with:?}, {size:?}, assembled {assembled}: {what}");
        expect_held(&what("alone"), layers(1), size, assembled);
        let rubbed = layers(4).with_tool().with_friction().with_contacts(20, 8);
        expect_held(&what("a tool, friction"), rubbed, size, assembled);
    }
}

#[test]
fn committed_nodes_stay_on_what_supports_leave() {
    let mut passes = Passes::new(system(&two_layers_supported(), 5, Preconditioner::Jacobi));
    let mut random = Random(5);
    passes.solution = passes.system.random_field(&mut random);
    let (left, before) = (projections(&passes.system), passes.system.velocity.clone());
    passes.commit();
    for (i, left) in left.iter().enumerate().filter(|(i, _)| passes.system.model.node_info[*i][3] == 0) {
        let want = *left * (wide(before[i]) + wide(passes.solution[i]));
        let got = wide(passes.system.velocity[i]).as_vec3().to_array();
        expect_close(&format!("velocity of node {i}"), &got, &want.to_array(), PROJECTION);
        let frame = &passes.system.frames[passes.system.model.node_info[i][2] as usize];
        let rotation = DMat3::from_quat(glam::DQuat::from_array(frame.rotation.map(f64::from)));
        let moved = rotation * wide(passes.system.displacement[i]);
        assert!((moved - *left * moved).length() < 1e-9, "node {i} has left what its supports leave: {moved}");
    }
}

#[test]
fn bodies_without_supports_have_no_arrays_for_them() {
    for bodies in [two_layers(), two_layers_one_on_a_core()] {
        let held = system(&bodies, 1, Preconditioner::Jacobi).model.held;
        assert!(held.nodes.is_empty() && held.holders.is_empty() && held.list.is_empty() && held.shares.is_empty());
    }
}
