//! The scalars of an iteration from solve/scalars, the vectors from solve/update.

use palpate::stages::args;

use super::passes::{Passes, UNTOUCHED};
use crate::harness::{Tolerance, context, expect_close};
use crate::random::Random;
use crate::system::{System, layer, layered, material, triples};

/// A few roundings of numbers of order one.
const ROUNDING: Tolerance = Tolerance { abs: 2e-6, rel: 2e-6 };

/// No bodies: the scalars alone.
fn bare() -> Passes {
    let mut passes = Passes::new(System::new(&[], 0.0, 1));
    passes.system.params.tolerance = 0.1;
    passes.system.params.max_iterations = 10;
    passes.state.rhs_norm2 = 100.0;
    passes
}

#[test]
fn two_iterations_by_hand() {
    // solve/scalars: gamma = 6, delta = 12: alpha = 1/2; then gamma = 3, delta = 5: beta = 1/2, alpha = 3 / (5 - 3) =
    // 3/2.
    let mut passes = bare();
    passes.dots = vec![[1.0, 2.0], [2.0, 4.0], [3.0, 6.0]];
    passes.scalars();
    let s = passes.state;
    assert_eq!((s.gamma, s.beta, s.alpha, s.iterations, s.status), (6.0, 0.0, 0.5, 1, 0));
    passes.dots = vec![[3.0, 5.0]];
    passes.scalars();
    let s = passes.state;
    assert_eq!((s.gamma, s.beta, s.alpha, s.iterations, s.status), (3.0, 0.5, 1.5, 2, 0));
    assert!(passes.args.iter().all(|word| *word == UNTOUCHED), "the loop goes on");
}

#[test]
fn it_stops_where_it_should() {
    // solve/scalars: gamma at tolerance^2 b.M^-1 b = 1 or at the floor; the last iteration; what is no number.
    let stopped = |gamma: f32, delta: f32, change: fn(&mut Passes)| {
        let mut passes = bare();
        passes.dots = vec![[gamma, delta]];
        (passes.state.iterations, passes.state.gamma, passes.state.alpha) = (3, 8.0, 0.5);
        change(&mut passes);
        let before = passes.state;
        passes.scalars();
        let (status, state) = (passes.state.status, passes.state);
        let slots = [args::LOOP_APPLY, args::LOOP_GATHER, args::LOOP_ONE, args::LOOP_UPDATE];
        let words: Vec<usize> = slots.iter().map(|slot| 3 * *slot as usize).collect();
        for (i, word) in passes.args.iter().enumerate() {
            assert_eq!(*word, if status != 0 && words.contains(&i) { 0 } else { UNTOUCHED }, "args [{i}]");
        }
        if status != 0 {
            let same = palpate::stages::types::Solve { status: 0, ..state };
            assert_eq!(bytemuck::bytes_of(&same), bytemuck::bytes_of(&before), "the state stays");
        }
        status
    };
    let (running, converged, broken) = (0, 1, 2);
    assert_eq!(stopped(1.01, 10.0, |_| ()), running);
    assert_eq!(stopped(0.99, 10.0, |_| ()), converged);
    assert_eq!(stopped(1.99, 10.0, |p| p.state.floor_norm2 = 2.0), converged);
    assert_eq!(stopped(2.0, 10.0, |p| p.state.iterations = 9), running);
    assert_eq!(stopped(2.0, 10.0, |p| p.state.iterations = 10), broken);
    assert_eq!(stopped(2.0, -10.0, |_| ()), broken);
    assert_eq!(stopped(2.0, 1.0, |_| ()), broken, "delta - beta gamma / alpha = 0");
    for bad in [f32::NAN, f32::INFINITY] {
        assert_eq!(stopped(bad, 10.0, |_| ()), broken);
        assert_eq!(stopped(2.0, bad, |_| ()), broken);
    }
}

#[test]
fn the_tools_rows_follow_the_same_recurrence() {
    // solve/scalars with a tool and contacts: p, s, x, r, u of the tool as the nodes' are in solve/update.
    let mut passes = Passes::new(System::new(&crate::system::two_layers(), 0.004, 2).with_tool().with_contacts(50, 3));
    let mut random = Random(4);
    let mut six = || -> [f32; 6] { std::array::from_fn(|_| random.next() as f32) };
    passes.contact_forces = (0..50).map(|_| std::array::from_fn(|k| six()[k])).collect();
    let state = &mut passes.state;
    (state.tool_x, state.tool_p, state.tool_s, state.tool_r, state.tool_u) = (six(), six(), six(), six(), six());
    state.tool_inverse = std::array::from_fn(|k| six()[k % 6]);
    // Large, so that the tool's share keeps alpha and beta of order one.
    passes.dots = vec![[30.0, 40.0], [10.0, 60.0]];
    (state.gamma, state.alpha, state.iterations) = (80.0, 1.5, 1);
    let before = passes.state;
    passes.scalars();
    let (after, params) = (passes.state, &passes.system.params);
    let wide = |x: &[f32]| -> Vec<f64> { x.iter().map(|x| f64::from(*x)).collect() };
    let times = |a: &[f32], x: &[f64]| -> Vec<f64> {
        (0..6).map(|i| (0..6).map(|k| f64::from(a[6 * i + k]) * x[k]).sum()).collect()
    };
    let (u, r) = (wide(&before.tool_u), wide(&before.tool_r));
    let mut image = times(&params.tool_matrix, &u);
    for (contact, force) in
        passes.system.contacts.iter().zip(&passes.contact_forces).filter(|(c, _)| c.tool_sign != 0.0)
    {
        let lever = contact.tool_sign * glam::Vec3::from(contact.arm).cross(contact.normal.into());
        for k in 0..3 {
            image[k] += f64::from(force[3]) * f64::from(contact.tool_sign * contact.normal[k]);
            image[3 + k] += f64::from(force[3]) * f64::from(lever[k]);
        }
    }
    let dot = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
    let (gamma, delta) = (40.0 + dot(&r, &u), 100.0 + dot(&image, &u));
    let beta = gamma / 80.0;
    let alpha = gamma / (delta - beta * gamma / 1.5);
    expect_close("scalars", &[after.gamma, after.beta, after.alpha], &[gamma, beta, alpha], ROUNDING);
    let combined =
        |x: &[f64], factor: f64, y: &[f64]| -> Vec<f64> { x.iter().zip(y).map(|(x, y)| x + factor * y).collect() };
    let p = combined(&u, beta, &wide(&before.tool_p));
    let s = combined(&image, beta, &wide(&before.tool_s));
    expect_close("p", &after.tool_p, &p, ROUNDING);
    expect_close("s", &after.tool_s, &s, ROUNDING);
    expect_close("x", &after.tool_x, &combined(&wide(&before.tool_x), alpha, &p), ROUNDING);
    let r = combined(&r, -alpha, &s);
    expect_close("r", &after.tool_r, &r, ROUNDING);
    expect_close("u", &after.tool_u, &times(&before.tool_inverse, &r), ROUNDING);
}

#[test]
fn vectors_follow_the_scalars_at_every_size() {
    // solve/update: p = u + beta p, s = w + beta s, x += alpha p, r -= alpha s, u = M^-1 r.
    let width = context().group_size() as usize;
    for nodes in [0, 1, width - 1, width, width + 1, 1234] {
        let bodies =
            if nodes == 0 { vec![] } else { vec![layered(layer(nodes), material(2e4), glam::DQuat::IDENTITY)] };
        let mut passes = Passes::new(System::new(&bodies, 0.0, 1));
        let mut random = Random(nodes as u64 + 1);
        let mut field = |count: usize| -> Vec<[f32; 4]> {
            (0..count).map(|_| [random.next() as f32, random.next() as f32, random.next() as f32, 0.0]).collect()
        };
        (passes.solution, passes.residual, passes.preconditioned) = (field(nodes), field(nodes), field(nodes));
        (passes.direction, passes.direction_image, passes.image) = (field(nodes), field(nodes), field(nodes));
        passes.inverse = field(2 * nodes);
        (passes.state.alpha, passes.state.beta) = (0.7, -0.4);
        let wide = |x: &[[f32; 4]]| -> Vec<f64> { triples(x).into_iter().map(f64::from).collect() };
        let combined = |x: &[f64], factor: f32, y: &[f64]| -> Vec<f64> {
            x.iter().zip(y).map(|(x, y)| x + f64::from(factor) * y).collect()
        };
        let p = combined(&wide(&passes.preconditioned), -0.4, &wide(&passes.direction));
        let s = combined(&wide(&passes.image), -0.4, &wide(&passes.direction_image));
        let x = combined(&wide(&passes.solution), 0.7, &p);
        let r = combined(&wide(&passes.residual), -0.7, &s);
        let u = r.chunks(3).enumerate().flat_map(|(i, r)| passes.precondition(i, [r[0], r[1], r[2]]));
        let u: Vec<f64> = u.collect();
        passes.update();
        expect_close("p", &triples(&passes.direction), &p, ROUNDING);
        expect_close("s", &triples(&passes.direction_image), &s, ROUNDING);
        expect_close("x", &triples(&passes.solution), &x, ROUNDING);
        expect_close("r", &triples(&passes.residual), &r, ROUNDING);
        expect_close("u", &triples(&passes.preconditioned), &u, ROUNDING);
    }
}
