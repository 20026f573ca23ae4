//! Tests of the kernel solve/update, one iteration of conjugate gradients with a single reduction (Chronopoulos and
//! Gear 1989) for A x = b. With operator A, preconditioner M, iterate x, residual r and search direction p: u = M^-1 r,
//! w = A u, s = A p, gamma = r.u, delta = w.u, beta = gamma / gamma' and alpha = gamma / (delta - beta gamma / alpha'),
//! where gamma' and alpha' are those of the last iteration. A block is the nodes that one workgroup owns. The tool is
//! the rigid body that the haptic device leads. The kernels keep two sets of iterates and scalars; they read one and
//! write the other.

use palpate::internal::shaders;
use palpate::internal::shaders::{Iteration, RigidIterate, Solve};

use super::passes::{Passes, UNTOUCHED};
use crate::harness::random::Random;
use crate::harness::{Tolerance, context, expect_close};
use crate::solver::system::{System, layer, layered, material, triples};

/// Tolerance for a few roundings of numbers of order one.
const ROUNDING: Tolerance = Tolerance { abs: 2e-6, rel: 2e-6 };

/// Passes of the solver on one block of eight nodes; only the scalars matter.
fn bare() -> Passes {
    let mut passes = Passes::new(System::new(&[layered(layer(8), material(2e4), glam::DQuat::IDENTITY)], 0.0, 1));
    assert_eq!(passes.blocks(), 1);
    passes.system.stop_at(0.1);
    passes.system.params.max_iterations = 10;
    passes.state.rhs_norm2 = 100.0;
    passes
}

/// The scalars after `count` iterations in which no contact was released.
fn after(count: u32, gamma: f32, alpha: f32, energies: [f32; 4], change: f32) -> Iteration {
    Iteration { gamma, alpha, count, fresh: count, releases: 0, is_release: 0, energies, change }
}

#[test]
fn two_iterations_by_hand() {
    // gamma = 6 and delta = 12 give alpha = 1/2; then gamma = 3 and delta = 5 give beta = 1/2 and alpha = gamma /
    // (delta - beta gamma / alpha') = 3 / (5 - 3) = 3/2. With u = 1 in both iterations, the first gives p = 1 and x =
    // 1/2, the second p = 3/2 and x = 1/2 + 9/4.
    let mut passes = bare();
    let ones = vec![[1.0, 1.0, 1.0, 0.0]; 8];
    for (dots, iteration, p, x) in [
        (vec![[1.0, 2.0], [2.0, 4.0], [3.0, 6.0]], after(1, 6.0, 0.5, [3.0, 0.0, 0.0, 0.0], 3.0), 1.0, 0.5),
        (vec![[3.0, 5.0]], after(2, 3.0, 1.5, [4.5, 3.0, 0.0, 0.0], 7.5), 1.5, 2.75),
    ] {
        let before = passes.iterations[passes.state.current as usize];
        (passes.dots, passes.preconditioned) = (dots, ones.clone());
        passes.update();
        assert_eq!((passes.state.current, passes.state.status), (iteration.count % 2, 0));
        let now = passes.state.current as usize;
        assert_eq!(
            (passes.iterations[now], passes.iterations[1 - now]),
            (iteration, before),
            "the new scalars, and the other set, which must stay"
        );
        assert_eq!((passes.direction[7], passes.solution[7]), ([p, p, p, 0.0], [x, x, x, 0.0]));
    }
    assert!(
        passes.args.iter().all(|word| *word == UNTOUCHED),
        "while the loop goes on, no indirect argument may change"
    );
}

#[test]
fn it_stops_where_it_should() {
    // The iteration stops where gamma is down to tolerance^2 b.M^-1 b = 1 or to the rounding floor, at the iteration
    // limit, and where the operator seems not positive or a number is not finite.
    let stopped = |gamma: f32, delta: f32, change: fn(&mut Passes)| {
        let mut passes = bare();
        passes.dots = vec![[gamma, delta]];
        passes.state.current = 1;
        passes.iterations[1] = after(3, 8.0, 0.5, [4.0; 4], 16.0);
        change(&mut passes);
        let (before, iterations) = (passes.state, passes.iterations);
        passes.update();
        let (status, state) = (passes.state.status, passes.state);
        let words: Vec<usize> = (shaders::ARGS_LOOP_ELEMENT_PRODUCT..=shaders::ARGS_LOOP_TOOL)
            .map(|coarse_index| 3 * coarse_index as usize)
            .collect();
        for (i, word) in passes.args.iter().enumerate() {
            assert_eq!(
                *word,
                if status != 0 && words.contains(&i) { 0 } else { UNTOUCHED },
                "word {i} of the indirect arguments"
            );
        }
        if status != 0 {
            let reached = if status == 1 { gamma.abs() } else { 0.0 };
            assert_eq!(
                Solve { status: 0, ..state },
                Solve { stop_norm2: reached, ..before },
                "the state after the loop ended, apart from its status"
            );
            assert_eq!(passes.iterations, iterations, "the scalars after the loop ended");
            // Further updates change nothing, whatever they are given.
            (passes.dots, passes.system.params.max_iterations) = (vec![[5.0, 100.0]], 100);
            passes.update();
            assert_eq!(
                (passes.state, passes.iterations),
                (state, iterations),
                "an update after status {status} must change nothing"
            );
        }
        status
    };
    let (running, converged, stopped_at_most, broken) = (0, 1, 2, 3);
    assert_eq!(stopped(1.01, 10.0, |_| ()), running);
    assert_eq!(stopped(0.99, 10.0, |_| ()), converged);
    assert_eq!(stopped(1.99, 10.0, |p| p.state.floor_norm2 = 2.0), converged);
    // With contacts the error's energy must be small as well, by the sum over four iterations, here 16; this is not
    // asked where the residual is down to the rounding floor.
    fn limited(p: &mut Passes, count: u32, limit: f32) {
        p.contact = true;
        (p.iterations[1].fresh, p.state.energy_limit) = (count, limit);
    }
    assert_eq!(stopped(0.99, 10.0, |p| limited(p, 4, 16.0)), converged);
    assert_eq!(stopped(0.99, 10.0, |p| limited(p, 4, 15.9)), running);
    assert_eq!(stopped(0.99, 10.0, |p| limited(p, 3, 1e9)), running, "status before four iterations are done");
    assert_eq!(stopped(1.01, 10.0, |p| limited(p, 4, 1e9)), running, "status where the residual is too large");
    fn at_floor(p: &mut Passes) {
        limited(p, 4, 0.0);
        p.state.floor_norm2 = 2.0;
    }
    assert_eq!(stopped(1.99, 10.0, at_floor), converged);
    // Without a tolerance the loop ends between tolerance and `loosest`, here at gamma of 1 and 100, where the energy of
    // the error, the last one (2) times q / (1 - q) with the greatest ratio q = 1/2, is 1/1600 of the change (3200).
    fn loose(p: &mut Passes, count: u32, energies: [f32; 4], change: f32) {
        p.system.params.loosest = 10.0 * p.system.params.tolerance;
        p.iterations[1] = after(count, 8.0, 0.5, energies, change);
    }
    const FALLING: [f32; 4] = [2.0, 4.0, 16.0, 40.0];
    assert_eq!(stopped(99.0, 10.0, |p| loose(p, 4, FALLING, 3201.0)), converged);
    assert_eq!(stopped(99.0, 200.0, |p| loose(p, 4, FALLING, 3199.0)), running, "status with too large an error");
    assert_eq!(stopped(101.0, 200.0, |p| loose(p, 4, FALLING, 3201.0)), running, "status above `loosest`");
    assert_eq!(stopped(99.0, 200.0, |p| loose(p, 3, FALLING, 1e9)), running, "status before four iterations are done");
    assert_eq!(stopped(99.0, 200.0, |p| loose(p, 4, [2.0, 4.0, 3.9, 40.0], 1e9)), running, "status where errors rose");
    assert_eq!(stopped(0.99, 10.0, |p| loose(p, 3, FALLING, 0.0)), converged, "status below the tolerance");
    fn loose_and_limited(p: &mut Passes, limit: f32) {
        limited(p, 4, limit);
        loose(p, 4, FALLING, 3201.0);
    }
    assert_eq!(stopped(99.0, 10.0, |p| loose_and_limited(p, 62.0)), converged);
    assert_eq!(stopped(99.0, 200.0, |p| loose_and_limited(p, 61.0)), running, "status with inaccurate normal forces");
    assert_eq!(stopped(2.0, 10.0, |p| p.iterations[1].fresh = 9), running);
    assert_eq!(stopped(2.0, 10.0, |p| p.iterations[1].fresh = 10), stopped_at_most);
    assert_eq!(stopped(2.0, -10.0, |_| ()), broken);
    assert_eq!(stopped(2.0, 1.0, |_| ()), broken, "status where delta - beta gamma / alpha' = 0");
    assert_eq!(
        stopped(20.0, 1.0, |_| ()),
        running,
        "status where the residual has grown so much that the iteration starts anew"
    );
    assert_eq!(stopped(20.0, -1.0, |_| ()), broken);
    for bad in [f32::NAN, f32::INFINITY] {
        assert_eq!(stopped(bad, 10.0, |_| ()), broken);
        assert_eq!(stopped(2.0, bad, |_| ()), broken);
    }
}

#[test]
fn contacts_under_tension_are_released_before_the_loop_ends() {
    // Where the loop would end (here it has converged, or reached the limit of iterations) and contacts are under
    // tension, an iteration leaves x and r and sets u to zero, and the next one subtracts from r its operator product,
    // the impulses that the released contacts lose. Then the search directions start anew.
    for (gamma, fresh) in [(0.5, 4), (2.0, 10)] {
        let mut passes = bare();
        passes.contact = true;
        passes.state.energy_limit = shaders::UNLIMITED;
        passes.iterations[0] = Iteration { fresh, ..after(12, 8.0, 0.5, [4.0; 4], 16.0) };
        passes.state.pulling = [3, 9];
        let mut random = Random(7);
        let mut field = || passes.system.random_field(&mut random);
        (passes.solution, passes.residual, passes.preconditioned) = (field(), field(), field());
        (passes.direction, passes.direction_product, passes.operator_product) = (field(), field(), field());
        passes.inverse = [field(), field()].concat();
        let lost = field();
        let (x, r, last) = (passes.solution.clone(), passes.residual.clone(), passes.iterations[0]);
        passes.dots = vec![[gamma, 10.0]];
        passes.update();
        assert_eq!((passes.state.status, passes.state.current, passes.state.pulling), (0, 1, [3, 0]));
        assert_eq!(passes.iterations[1], Iteration { is_release: 1, ..last });
        assert_eq!((&passes.solution, &passes.residual), (&x, &r), "x and r before the release");
        assert!(passes.preconditioned.iter().all(|u| *u == [0.0; 4]), "u before the release");

        (passes.operator_product, passes.dots) = (lost.clone(), vec![[0.0, 0.0]]);
        passes.update();
        assert_eq!((passes.state.status, passes.state.current, passes.state.pulling), (0, 0, [0, 0]));
        let released = Iteration { releases: 1, ..after(12, 0.0, 0.0, [0.0; 4], 16.0) };
        assert_eq!(passes.iterations[0], Iteration { fresh: 0, ..released });
        assert_eq!(passes.solution, x, "x after the release");
        let r: Vec<f64> = triples(&r).iter().zip(triples(&lost)).map(|(r, s)| f64::from(*r) - f64::from(s)).collect();
        expect_close("r after the release", &triples(&passes.residual), &r, ROUNDING);
        let u: Vec<f64> =
            r.chunks(3).enumerate().flat_map(|(i, r)| passes.precondition(i, [r[0], r[1], r[2]])).collect();
        expect_close("u after the release", &triples(&passes.preconditioned), &u, ROUNDING);

        // The first iteration after the release: p = u, and alpha = gamma / delta.
        let u = passes.preconditioned.clone();
        passes.dots = vec![[6.0, 12.0]];
        passes.update();
        let want = Iteration { releases: 1, fresh: 1, ..after(13, 6.0, 0.5, [3.0, 0.0, 0.0, 0.0], 19.0) };
        assert_eq!(passes.iterations[1], want, "scalars of the first iteration after the release");
        assert_eq!(passes.direction, u);
    }
    // Contacts that still pull after four releases are not released.
    let mut passes = bare();
    passes.contact = true;
    (passes.state.energy_limit, passes.state.pulling) = (shaders::UNLIMITED, [3, 0]);
    passes.iterations[0] = Iteration { releases: 4, ..after(12, 8.0, 0.5, [4.0; 4], 16.0) };
    passes.dots = vec![[0.5, 10.0]];
    passes.update();
    assert_eq!((passes.state.status, passes.state.current, passes.state.pulling), (1, 0, [3, 0]));
}

#[test]
fn the_tool_and_cores_stand_still_in_a_release() {
    // A release leaves the x of rigid bodies as it is. Their u is zero before it, and the tool's residual loses the
    // tool's rows of the product, which are the impulses of the released contacts.
    let system = System::new(&crate::solver::system::two_layers_one_on_a_core(), 0.004, 2);
    let mut passes = Passes::new(system.with_tool().with_contacts(50, 3));
    passes.system.stop_at(1e-6);
    passes.record_start();
    passes.iterate(3);
    // So large a tolerance ends the loop.
    passes.system.stop_at(1e3);
    passes.state.energy_limit = shaders::UNLIMITED;
    let count = passes.rigids.len();
    assert_eq!((count, passes.tool), (2, true), "rigid bodies: a core and the tool");
    let rigid = |passes: &mut Passes| -> Vec<RigidIterate> { (0..count).map(|index| *passes.rigid(index)).collect() };
    let before = rigid(&mut passes);
    passes.iterate(1);
    let now = passes.state.current as usize;
    assert_eq!(
        (passes.state.status, passes.iterations[now].is_release),
        (0, 1),
        "status, and whether a release follows"
    );
    let held = rigid(&mut passes);
    for (held, before) in held.iter().zip(&before) {
        assert_eq!((held.u, held.x, held.r), ([0.0; 6], before.x, before.r), "u, x and r before the release");
    }
    passes.iterate(1);
    let lost = passes.tool_rows();
    let after = rigid(&mut passes);
    assert!(lost.iter().any(|x| *x != 0.0), "no contact of the tool was released");
    for (after, before) in after.iter().zip(&before) {
        assert_eq!(after.x, before.x, "x after the release");
    }
    let want: Vec<f64> = (0..6).map(|k| f64::from(before[1].r[k]) - f64::from(lost[k])).collect();
    let allowed = Tolerance { abs: 1e-6 * want.iter().fold(0.0f64, |m, x| m.max(x.abs())), rel: 0.0 };
    expect_close("the tool's residual after the release", &after[1].r, &want, allowed);
}

#[test]
fn a_loop_that_breaks_down_with_numbers_that_are_not_finite_releases_nothing() {
    for dots in [[f32::NAN, 1.0], [f32::INFINITY, 1.0], [2.0, f32::NAN]] {
        let mut passes = bare();
        passes.contact = true;
        passes.state.pulling = [3, 0];
        passes.iterations[0] = after(3, 8.0, 0.5, [4.0; 4], 16.0);
        passes.dots = vec![dots];
        passes.update();
        assert_eq!((passes.state.status, passes.state.current), (3, 0), "inner products {dots:?}");
    }
}

#[test]
fn the_tools_rows_follow_the_same_recurrence() {
    // With a tool and contacts, the tool's p, s, x, r and u follow the same recurrences as those of the nodes.
    for set in [0, 1] {
        tools_rows(set);
    }
}

/// Lets the kernels read the tool's iterate from the set with index `set`, and checks the iterate that they write to
/// the other set.
fn tools_rows(set: u32) {
    let mut passes =
        Passes::new(System::new(&crate::solver::system::two_layers(), 0.004, 2).with_tool().with_contacts(50, 3));
    let mut random = Random(4);
    let mut six = || -> [f32; 6] { std::array::from_fn(|_| random.next() as f32) };
    passes.contact_forces = (0..50).map(|_| std::array::from_fn(|k| six()[k])).collect();
    passes.state.current = set;
    *passes.tool_iterate_mut() = RigidIterate { x: six(), p: six(), s: six(), r: six(), u: six() };
    passes.rigid_inverses = (0..36).map(|k| six()[k % 6]).collect();
    passes.gather(1);
    // The blocks' inner products are chosen large, so that alpha and beta are still of order one when the tool's share
    // is added.
    assert_eq!(passes.dots.len(), 3, "number of inner products: of two blocks of nodes and of the tool");
    (passes.dots[0], passes.dots[1]) = ([30.0, 40.0], [10.0, 60.0]);
    passes.iterations[set as usize] = after(1, 80.0, 1.5, [0.0; 4], 0.0);
    let before = passes.tool_iterate();
    passes.update();
    assert_eq!((passes.state.current, passes.iterations_done()), (1 - set, 2));
    let (after, params) = (passes.tool_iterate(), &passes.system.params);
    let wide = |x: &[f32]| -> Vec<f64> { x.iter().map(|x| f64::from(*x)).collect() };
    let times = |a: &[f32], x: &[f64]| -> Vec<f64> {
        (0..6).map(|i| (0..6).map(|k| f64::from(a[6 * i + k]) * x[k]).sum()).collect()
    };
    let (u, r) = (wide(&before.u), wide(&before.r));
    let mut operator_product = times(&params.tool_matrix, &u);
    for (contact, force) in
        passes.system.contacts.iter().zip(&passes.contact_forces).filter(|(c, _)| c.tool_sign != 0.0)
    {
        let lever = contact.tool_sign * glam::Vec3::from(contact.arm).cross(contact.normal.into());
        for k in 0..3 {
            operator_product[k] += f64::from(force[3]) * f64::from(contact.tool_sign * contact.normal[k]);
            operator_product[3 + k] += f64::from(force[3]) * f64::from(lever[k]);
        }
    }
    let dot = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
    let (gamma, delta) = (40.0 + dot(&r, &u), 100.0 + dot(&operator_product, &u));
    let beta = gamma / 80.0;
    let alpha = gamma / (delta - beta * gamma / 1.5);
    let scalars = passes.iterations[1 - set as usize];
    expect_close("scalars", &[scalars.gamma, scalars.alpha], &[gamma, alpha], ROUNDING);
    let combined =
        |x: &[f64], factor: f64, y: &[f64]| -> Vec<f64> { x.iter().zip(y).map(|(x, y)| x + factor * y).collect() };
    let p = combined(&u, beta, &wide(&before.p));
    let s = combined(&operator_product, beta, &wide(&before.s));
    expect_close("p", &after.p, &p, ROUNDING);
    expect_close("s", &after.s, &s, ROUNDING);
    expect_close("x", &after.x, &combined(&wide(&before.x), alpha, &p), ROUNDING);
    let r = combined(&r, -alpha, &s);
    expect_close("r", &after.r, &r, ROUNDING);
    expect_close("u", &after.u, &times(&passes.rigid_inverses, &r), ROUNDING);
}

#[test]
fn vectors_follow_the_scalars_at_every_size() {
    // An update computes p = u + beta p, s = w + beta s, x += alpha p, r -= alpha s and u = M^-1 r.
    let width = context().reduce_size() as usize;
    let large = context().group_size() as usize;
    for (case, nodes) in [0, 1, width - 1, width, width + 1, large - 1, large, large + 1, 1234].into_iter().enumerate()
    {
        let bodies =
            if nodes == 0 { vec![] } else { vec![layered(layer(nodes), material(2e4), glam::DQuat::IDENTITY)] };
        let mut passes = Passes::new(System::new(&bodies, 0.0, 1));
        assert_eq!(passes.blocks(), passes.roles().iter().flatten().count().div_ceil(128));
        let mut random = Random(nodes as u64 + 1);
        let mut field = || passes.system.random_field(&mut random);
        (passes.solution, passes.residual, passes.preconditioned) = (field(), field(), field());
        (passes.direction, passes.direction_product, passes.operator_product) = (field(), field(), field());
        passes.inverse = (0..2 * nodes).map(|_| random.vector().as_vec3().extend(0.0).to_array()).collect();
        // Sums over all blocks give gamma = 1 and delta = 1 / 0.7 - 0.4. With gamma' = -2.5 and alpha' = 1 this
        // gives beta = 1 / -2.5 = -0.4 and alpha = 1 / (delta + 0.4) = 0.7.
        let set = case % 2;
        passes.state.current = set as u32;
        passes.iterations[set] = after(1, -2.5, 1.0, [0.0; 4], 0.0);
        let share = 1.0 / passes.blocks().max(1) as f32;
        passes.dots = vec![[share, share * (1.0 / 0.7 - 0.4)]; passes.blocks()];
        let wide = |x: &[[f32; 4]]| -> Vec<f64> { triples(x).into_iter().map(f64::from).collect() };
        let combined =
            |x: &[f64], factor: f64, y: &[f64]| -> Vec<f64> { x.iter().zip(y).map(|(x, y)| x + factor * y).collect() };
        let [operator_product, solution] = [wide(&passes.operator_product), wide(&passes.solution)];
        let before =
            [&passes.preconditioned, &passes.direction, &passes.direction_product, &passes.residual].map(|x| wide(x));
        passes.update();
        if passes.blocks() == 0 {
            continue;
        }
        let Iteration { gamma, alpha, count, .. } = passes.iterations[1 - set];
        expect_close("scalars", &[gamma, alpha], &[1.0, 0.7], ROUNDING);
        assert_eq!((count, passes.state.current), (2, 1 - set as u32));
        let (alpha, [u, p, s, r]) = (f64::from(alpha), before);
        let p = combined(&u, -f64::from(gamma) / 2.5, &p);
        let s = combined(&operator_product, -f64::from(gamma) / 2.5, &s);
        let x = combined(&solution, alpha, &p);
        let r = combined(&r, -alpha, &s);
        let u: Vec<f64> =
            r.chunks(3).enumerate().flat_map(|(i, r)| passes.precondition(i, [r[0], r[1], r[2]])).collect();
        expect_close("p", &triples(&passes.direction), &p, ROUNDING);
        expect_close("s", &triples(&passes.direction_product), &s, ROUNDING);
        expect_close("x", &triples(&passes.solution), &x, ROUNDING);
        expect_close("r", &triples(&passes.residual), &r, ROUNDING);
        expect_close("u", &triples(&passes.preconditioned), &u, ROUNDING);
    }
}
