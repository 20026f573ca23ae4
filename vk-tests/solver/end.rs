//! Tests of the kernel solve/conclude, which gives the verdict on a solve of A x = b (done, continue, Newton iteration or
//! failed), and of solve/commit, which moves the state to the end of the step. A block is the nodes of one workgroup; a
//! contact that pulls at the end of the step is released, that is, it loses its stiffness. The tool is the rigid body
//! that the haptic device leads, the oracle the f64 reference implementation.

use glam::{DQuat, DVec3};
use palpate::internal::shaders;
use palpate::internal::shaders::{Contact, ToolWrench};

use super::passes::{Change, Passes, SKIN_PARTS, TOOLS, UNTOUCHED};
use crate::harness::random::Random;
use crate::harness::{Tolerance, context, expect_close};
use crate::solver::system::{System, layer, layered, material, triples, two_layers};
use crate::stage::elastic::expect_of_largest;

/// Relative error of a few f32 roundings.
const ROUNDING: Tolerance = Tolerance { abs: 0.0, rel: 2e-6 };
/// Relative error of a residual of order one, which inner products through blocks inverted in f32 give.
const RESIDUAL: Tolerance = Tolerance { abs: 0.0, rel: 1e-4 };
/// Error of the impulses of contacts at a node or on the tool, relative to the largest: each is a sum of differences of
/// terms some ten times as large.
const PRODUCT: f64 = 1e-5;
/// Relative error of a sum of contact forces, each of which is a difference of terms some ten times as large.
const FORCES: Tolerance = Tolerance { abs: 0.0, rel: 1e-5 };
/// The verdict that a solve is accepted. The five constants after it are bits of flags, as in `trace.csv`: not
/// converged, a contact deeper than the limit, a number that is not finite, contacts that still pull, Newton iterations
/// that did not converge.
const DONE: u32 = 0;
const NOT_CONVERGED: u32 = 1;
const DEPTH_LIMIT: u32 = 8;
const NON_FINITE: u32 = 32;
const PULLING: u32 = 256;
const NEWTON_NOT_CONVERGED: u32 = 2048;

/// What wrench/reduce wrote for a tool.
const OF_TOOL: ToolWrench = ToolWrench {
    force: [7.0; 3],
    torque: [7.0; 3],
    pressing: 7.0,
    friction: [7.0; 3],
    stiffness: [7.0; 21],
    damping: [7.0; 21],
};

fn some_nodes() -> Passes {
    let mut passes = Passes::new(System::new(&[layered(layer(70), material(2e4), DQuat::IDENTITY)], 0.0, 1));
    passes.system.stop_at(0.01);
    (passes.state.rhs_norm2, passes.state.floor_norm2) = (64.0, 1e-6);
    // The kernels keep two sets of iterates; the newest iterate is in the second set.
    (passes.state.status, passes.state.current) = (1, 1);
    passes.iterations[1].count = 17;
    // These fields are written by wrench/reduce alone: solve/conclude must leave them.
    passes.report.tools = [OF_TOOL; 4];
    passes
}

/// Replaces the inner products of the blocks of nodes by `dots`: for each block, its shares of r . M^-1 r, with the
/// residual r and the preconditioner M^-1, and of the squared residual that rounding of x leaves.
fn with_dots(passes: &mut Passes, dots: &[[f32; 2]]) {
    (passes.dots, passes.block_count) = (dots.to_vec(), dots.len());
}

/// Numbers of workgroups that solve/conclude requested for solve/commit and wrench/reduce.
fn granted(passes: &Passes) -> [u32; 2] {
    [shaders::ARGS_COMMIT, shaders::ARGS_WRENCH].map(|coarse_index| passes.args[3 * coarse_index as usize])
}

#[test]
fn verdicts_by_hand() {
    // With r . M^-1 r = 0.16 and b . M^-1 b = 64, the residual is sqrt(0.16 / 64) = 0.05, within ten times the
    // tolerance, so that there is no flag.
    let groups = 70u32.div_ceil(context().group_size());
    let mut passes = some_nodes();
    passes.system.counts.flags = DEPTH_LIMIT;
    // The squared residual that rounding of x leaves, (eps x)^2 . D with the rounding unit eps and the diagonal D of A,
    // is 8e-7 here, below that of rounding of b, 1e-6.
    with_dots(&mut passes, &[[0.06, 4e-7], [0.1, 4e-7]]);
    passes.conclude();
    let report = passes.report;
    assert_eq!((report.verdict, report.iterations, report.flags, report.contacts), (DONE, 17, DEPTH_LIMIT, 0));
    assert_eq!(passes.state.solution_dt, passes.system.params.dt);
    expect_close("residual", &[report.residual, report.residual_floor], &[0.05, 1.25e-4], ROUNDING);
    assert_eq!(granted(&passes), [groups, TOOLS]);
    assert_eq!((report.max_depth, report.tools), (0.0, [OF_TOOL; 4]));
    let written =
        [shaders::ARGS_COMMIT, shaders::ARGS_WRENCH, shaders::ARGS_GAP].map(|coarse_index| 3 * coarse_index as usize);
    let others = passes.args.iter().enumerate().filter(|(i, _)| !written.contains(i));
    assert!(
        others.into_iter().all(|(_, word)| *word == UNTOUCHED),
        "other stages' indirect arguments must stay as they were"
    );

    // The recorded iterations ran out before convergence: nothing is accepted yet.
    passes = some_nodes();
    passes.state.status = 0;
    with_dots(&mut passes, &[[0.16, 0.0]]);
    passes.conclude();
    assert_eq!((passes.report.verdict, granted(&passes)), (shaders::VERDICT_CONTINUE, [UNTOUCHED; 2]));

    // The solve stopped at the iteration limit with a residual above ten times the tolerance.
    passes = some_nodes();
    passes.state.status = 2;
    with_dots(&mut passes, &[[1.0, 0.0]]);
    passes.conclude();
    assert_eq!((passes.report.verdict, passes.report.flags), (DONE, NOT_CONVERGED));
    assert_eq!(granted(&passes), [groups, TOOLS]);

    // The solve converged at a residual of 0.02, which is above the tolerance: ten times as much is not too much.
    for (left, flags) in [(0.19f32, 0), (0.21, NOT_CONVERGED)] {
        passes = some_nodes();
        passes.state.stop_norm2 = 64.0 * 0.02 * 0.02;
        with_dots(&mut passes, &[[64.0 * left * left, 0.0]]);
        passes.conclude();
        assert_eq!((passes.report.verdict, passes.report.flags), (DONE, flags), "residual {left}");
    }

    // The solve stopped early with a small residual, and an error of the normal forces of some ten times what is
    // allowed, so that its energy is a hundred times the limit.
    for (status, energy, flags) in [(2, 100.1, NOT_CONVERGED), (2, 99.9, 0), (1, 100.1, 0), (3, 100.1, NOT_CONVERGED)] {
        passes = some_nodes();
        passes.contact = true;
        (passes.state.status, passes.state.energy_limit) = (status, 1.0);
        passes.iterations[1].energies = [0.5 * energy, 0.25 * energy, 0.125 * energy, 0.125 * energy];
        with_dots(&mut passes, &[[0.16, 0.0]]);
        passes.conclude();
        assert_eq!((passes.report.verdict, passes.report.flags), (DONE, flags), "status {status}, energy {energy}");
    }

    // The solve converged, but a Newton iteration is still to come: nothing is committed before the last one.
    passes = some_nodes();
    passes.system.params.newton = 3;
    passes.state.newton_iterations = 1;
    with_dots(&mut passes, &[[0.16, 0.0]]);
    passes.conclude();
    assert_eq!((passes.report.verdict, granted(&passes)), (shaders::VERDICT_NEWTON, [0; 2]));
    assert_eq!(passes.state.newton_iterations, 2, "Newton iterations done");
    // The last of them is followed by a linearisation, whose residual is that of the nonlinear equations: 0.05 of a
    // right-hand side of norm 8. That is unsolved if it is above half of the norm of the step's first right-hand side.
    passes.conclude();
    assert_eq!((passes.report.verdict, granted(&passes)), (shaders::VERDICT_NEWTON, [0; 2]));
    for (first, flags) in [(0.81f32, 0), (0.79, NEWTON_NOT_CONVERGED)] {
        passes.state.first_norm2 = first * first;
        passes.conclude();
        let report = passes.report;
        assert_eq!((report.verdict, granted(&passes), report.flags), (DONE, [groups, TOOLS], flags), "first {first}");
        expect_close("nonlinear residual", &[report.nonlinear_residual], &[0.4 / f64::from(first)], ROUNDING);
    }
    // Where nothing moves there is nothing to solve.
    (passes.state.rhs_norm2, passes.state.floor_norm2, passes.state.first_norm2) = (0.0, 0.0, 0.0);
    with_dots(&mut passes, &[[0.0, 0.0]]);
    passes.conclude();
    assert_eq!((passes.report.verdict, passes.report.flags, passes.report.nonlinear_residual), (DONE, 0, 0.0));
    // A failed solve is not followed by a Newton iteration, and nothing is predicted from its solution.
    passes.state.newton_iterations = 0;
    with_dots(&mut passes, &[[f32::NAN, 0.0]]);
    passes.conclude();
    assert_eq!((passes.report.verdict, passes.state.newton_iterations), (shaders::VERDICT_FAILED, 0));
    assert_eq!(passes.state.solution_dt, 0.0);

    // At rest, where b is zero up to its rounding, the residual counts as zero.
    passes = some_nodes();
    (passes.state.rhs_norm2, passes.state.floor_norm2) = (1e-9, 1e-8);
    with_dots(&mut passes, &[[1e-9, 0.0]]);
    passes.conclude();
    assert_eq!((passes.report.residual, passes.report.flags), (0.0, 0));
}

#[test]
fn the_gap_is_looked_for_where_a_loop_holds_the_tool() {
    for (is_held, worth, want) in [(0, 0.16, 0), (1, 0.16, SKIN_PARTS), (1, f32::NAN, 0)] {
        let mut passes = some_nodes();
        passes.system.params.wants_stiffness = is_held;
        with_dots(&mut passes, &[[worth, 0.0]]);
        passes.conclude();
        assert_eq!(
            passes.args[3 * shaders::ARGS_GAP as usize],
            want,
            "number of workgroups requested for wrench/gap (gap from tool to skins); a haptic loop holds the tool \
             (1: yes): {is_held}; r . M^-1 r: {worth}"
        );
    }
}

#[test]
fn what_is_no_number_is_not_accepted() {
    for bad in [f32::NAN, f32::INFINITY] {
        let mut passes = some_nodes();
        passes.state.status = 2;
        with_dots(&mut passes, &[[bad, 0.0], [1.0, 0.0]]);
        passes.conclude();
        let flags = NOT_CONVERGED | NON_FINITE;
        assert_eq!(
            (passes.report.verdict, passes.report.flags),
            (shaders::VERDICT_FAILED, flags),
            "verdict and flags for {bad}"
        );
        assert_eq!(granted(&passes), [0, 0]);
    }
}

#[test]
fn what_broke_down_is_accepted_where_it_is_nearly_solved() {
    // A solve that broke down is accepted up to a squared residual of 0.1^2 = 0.01: with 0.32 / 64 = 0.005 it is, with
    // 1.28 / 64 = 0.02 it is not. At the iteration limit both are accepted, but not 96 / 64 = 1.5: x = 0 has a smaller
    // residual, of one. A residual within ten times the floor that rounding of x leaves, here sqrt(16 / 64), is always
    // accepted.
    let (stopped, broken) = (2, 3);
    for (status, residual2, floor2, want) in [
        (broken, 0.32, 0.0, DONE),
        (broken, 1.28, 0.0, shaders::VERDICT_FAILED),
        (stopped, 1.28, 0.0, DONE),
        (broken, 1.28, 16.0, DONE),
        (stopped, 60.0, 0.0, DONE),
        (stopped, 96.0, 0.0, shaders::VERDICT_FAILED),
        (stopped, 96.0, 16.0, DONE),
    ] {
        let mut passes = some_nodes();
        passes.state.status = status;
        with_dots(&mut passes, &[[residual2, floor2]]);
        passes.conclude();
        assert_eq!(
            passes.report.verdict, want,
            "verdict for status {status}, squared residual {residual2}, squared floor {floor2}"
        );
        let (groups, failed) = (70u32.div_ceil(context().group_size()), want == shaders::VERDICT_FAILED);
        assert_eq!(granted(&passes), if failed { [0, 0] } else { [groups, TOOLS] });
        // A failed step applies no force.
        let none = ToolWrench { force: [0.0; 3], torque: [0.0; 3], pressing: 0.0, friction: [0.0; 3], ..OF_TOOL };
        // So it is for each of TOOLS tools; what comes after them stays.
        let tools: [ToolWrench; 4] =
            std::array::from_fn(|tool| if failed && tool < TOOLS as usize { none } else { OF_TOOL });
        assert_eq!(passes.report.tools, tools);
        let floor = (f64::from(floor2.max(1e-6)) / 64.0).sqrt();
        expect_close("floor", &[passes.report.residual_floor], &[floor], ROUNDING);
    }
}

/// Pressure of each contact at the end of the step, k depth + (h k + d) rate, Pa, with stiffness k, damping d, time
/// step h and rate of depth, for a change of velocity `change` given in the oracle's unknowns.
fn pressures(system: &System, change: &[f64]) -> Vec<f64> {
    let places = system.twin.unknowns();
    let end: Vec<f64> = system.start().iter().zip(change).map(|(v, dv)| v + dv).collect();
    let pressure = |contact: &palpate_oracle::contact::Contact| -> f64 {
        let palpate_oracle::contact::Contact { stiffness, damping, depth, .. } = contact;
        let rate: f64 = system.twin.row(&places, contact).iter().map(|(i, w)| w * end[*i]).sum();
        stiffness * depth + (system.twin.dt * stiffness + damping) * rate
    };
    system.twin_contacts.iter().map(pressure).collect()
}

#[test]
fn contacts_under_tension_are_released_and_the_residual_is_recomputed() {
    // The kernels solve/contact_product, solve/gather and solve/conclude run on random vectors in place of a solution x,
    // and are compared with the oracle's b - A x, with all contacts and without those that are under tension at x.
    for seed in 0..3 {
        let system = System::new(&two_layers(), 0.004, seed).with_tool();
        let system = if seed < 2 { system } else { system.with_friction() };
        let mut passes = Passes::new(system.with_contacts(100, 70 + seed));
        let mut random = Random(80 + seed);
        passes.record_start();
        passes.solution = passes.system.random_field(&mut random).iter().map(|x| x.map(|x| 0.3 * x)).collect();
        let tool_x: [f32; 6] = std::array::from_fn(|_| 0.3 * random.next() as f32);
        passes.tool_iterate_mut().x = tool_x;
        let before = passes.system.contacts.clone();
        let x = passes.system.unknowns(&passes.solution, &tool_x);
        let pressures = pressures(&passes.system, &x);
        let on = |c: &usize| before[*c].stiffness != 0.0;
        let pulls: Vec<bool> = (0..100).map(|c| on(&c) && pressures[c] < 0.0).collect();
        let pulling = pulls.iter().filter(|p| **p).count();
        assert!(pulling > 5 && pulling < 90, "number of contacts that pull: {pulling}");
        // b - A x with these contacts, or without those of them that pull.
        let left = |released: bool| -> Vec<f64> {
            let s = &passes.system;
            let kept = s.twin_contacts.iter().zip(&pulls).filter(|(_, pulls)| !(released && **pulls));
            let kept: Vec<_> = kept.map(|(contact, _)| contact.clone()).collect();
            let (a, b) = s.twin.assemble(s.device.as_ref(), &kept);
            b.iter().zip(a.multiply(&x)).map(|(b, y)| b - y).collect()
        };
        let (with_all, without) = (left(false), left(true));

        // An iteration counts the contacts that pull, and a later one releases them: with u = 0 its product is what the
        // residual loses.
        passes.apply(Change::Preconditioned);
        let set = passes.state.current as usize;
        assert_eq!(passes.state.pulling[set] as usize, pulling, "contacts that pull, seed {seed}");
        assert_eq!(passes.system.contacts, before, "contacts that are only counted");
        passes.iterations[set].is_release = 1;
        passes.preconditioned.fill([0.0; 4]);
        passes.tool_iterate_mut().u = [0.0; 6];
        passes.apply(Change::Preconditioned);
        passes.gather(1);
        for (c, (now, was)) in passes.system.contacts.iter().zip(&before).enumerate() {
            let want = Contact { stiffness: if pulls[c] { -was.stiffness } else { was.stiffness }, ..*was };
            assert_eq!(*now, want, "contact {c}, with a pressure of {:e} Pa", pressures[c]);
        }
        assert_eq!(passes.state.pulling[set] as usize, pulling, "contacts that are released are not counted again");
        let lost: Vec<f64> = with_all.iter().zip(&without).map(|(all, without)| all - without).collect();
        let (nodes, twist) = passes.system.rows(&lost);
        expect_of_largest("product at the nodes", &triples(&passes.operator_product), &nodes.concat(), PRODUCT);
        expect_of_largest("product, force on the tool", &passes.tool_rows()[..3], &twist[..3], PRODUCT);
        expect_of_largest("product, torque on the tool", &passes.tool_rows()[3..], &twist[3..], PRODUCT);
        let just_released = passes.system.contacts.clone();

        // Sums of contact forces of the step before; they stay until a step is accepted.
        let mut kept = [3.0, 5.0];
        passes.state.normal_forces = kept.map(|force| force as f32);
        let deepest = |released: bool| {
            let counted = (0..100).filter(on).filter(|c| !(released && pulls[*c]));
            counted.map(|c| before[c].depth).fold(0.0, f32::max)
        };
        for (released, status) in [(true, 1), (true, 2), (true, 0), (false, 1), (false, 0)] {
            passes.system.contacts = if released { just_released.clone() } else { before.clone() };
            passes.apply(Change::End);
            passes.gather(2);
            let left = if released { &without } else { &with_all };
            let places = passes.system.twin.unknowns();
            let mut norm2 = 0.0;
            for (i, first) in places.nodes.iter().flatten().enumerate() {
                let [(first, _)] = &first[..] else { continue };
                let r: [f64; 3] = std::array::from_fn(|k| left[first + k]);
                norm2 += passes.precondition(i, r).iter().zip(r).map(|(z, r)| z * r).sum::<f64>();
            }
            let r = &left[places.tool..];
            norm2 += (0..36).map(|k| r[k / 6] * passes.rigid_inverse(0, k / 6, k % 6) * r[k % 6]).sum::<f64>();
            // The norm of b is chosen so that the residual stays below one: a solution with a greater residual is worse
            // than x = 0 and fails.
            passes.state.rhs_norm2 = 4.0 * norm2 as f32;
            let want = (norm2 / f64::from(passes.state.rhs_norm2)).sqrt();
            passes.state.status = status;
            passes.state.pulling[set] = if released { 0 } else { pulling as u32 };
            passes.iterations[set].releases = u32::from(released);
            passes.args.fill(UNTOUCHED);
            let trends = passes.rigid_trends[0].x;
            passes.conclude();
            let report = passes.report;
            expect_close("residual", &[report.residual], &[want], RESIDUAL);
            let count = (0..100).filter(on).count() - if released { pulling } else { 0 };
            assert_eq!((report.contacts, report.max_depth), (count as u32, deepest(released)));
            assert_eq!((report.tool_change, report.releases), (tool_x, u32::from(released)));
            let forces = [true, false].map(|of_tool| {
                let of_kind = (0..100).filter(on).filter(|c| (before[*c].tool_sign != 0.0) == of_tool);
                of_kind.map(|c| pressures[c].max(0.0) * f64::from(before[c].area)).sum::<f64>()
            });
            let want_forces = if report.verdict == DONE { forces } else { kept };
            expect_close("contact forces", &passes.state.normal_forces, &want_forces, FORCES);
            kept = want_forces;
            assert_eq!(report.verdict, if status == 0 { shaders::VERDICT_CONTINUE } else { DONE });
            for (c, (now, was)) in passes.system.contacts.iter().zip(&before).enumerate() {
                let want = match (released && pulls[c], status) {
                    (false, _) => *was,
                    (true, 0) => just_released[c],
                    (true, _) => Contact { stiffness: 0.0, damping: 0.0, friction: 0.0, ..*was },
                };
                assert_eq!(*now, want, "contact {c} after status {status}");
            }
            let told = if released { NOT_CONVERGED } else { NOT_CONVERGED | PULLING };
            assert_eq!(report.flags, if status == 0 { 0 } else { told });
            // The trend of an accepted step is its solution, to which the step's first solve added minus the last one.
            let moved: [f32; 6] = std::array::from_fn(|k| trends[k] + tool_x[k]);
            let want = if report.verdict == DONE { moved } else { trends };
            assert!(passes.rigid_trends.iter().all(|set| set.x == want), "trend of the tool");
            if status == 0 {
                assert_eq!(granted(&passes), [UNTOUCHED; 2]);
                assert_eq!(passes.rigids[0].carried_residual, [0.0; 6]);
            } else {
                let allowed = Tolerance { abs: 1e-5 * r.iter().fold(0.0f64, |m, r| m.max(r.abs())), rel: 0.0 };
                expect_close("carried residual of the tool", &passes.rigids[0].carried_residual, r, allowed);
                passes.rigids[0].carried_residual = [0.0; 6];
            }
        }
    }
}

#[test]
fn the_state_moves_by_hand() {
    // The body's frame, a rigid coordinate frame, is turned by 90 degrees about z: what moves along the world's y moves
    // along the frame's x.
    let nodes = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
    let bound = vec![false, false, false, true];
    let tetrahedron = palpate::internal::prepare::Layer {
        nodes,
        tetrahedra: vec![[0, 1, 2, 3]],
        attached: bound,
        ..Default::default()
    };
    let turn = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
    let mut passes = Passes::new(System::new(&[layered(tetrahedron, material(2e4), turn)], 0.0, 1));
    passes.system.velocity = vec![[0.0, 1.0, 0.0, 0.0]; 4];
    passes.system.displacement = vec![[0.5, 0.0, 0.0, 0.0]; 4];
    passes.solution = vec![[0.0, 3.0, 0.0, 0.0]; 4];
    passes.trend = vec![[1.0, -2.0, 0.0, 0.0]; 4];
    (passes.rhs, passes.operator_product) = (vec![[5.0, 6.0, 7.0, 0.0]; 4], vec![[4.0, 4.0, 4.0, 0.0]; 4]);
    passes.commit();
    let [first, .., last] = &passes.system.displacement[..] else { panic!("fewer than two nodes") };
    let rounding = Tolerance { abs: 1e-8, rel: 1e-7 };
    expect_close("d", first, &[0.5 + 4.0 / 128.0, 0.0, 0.0, 0.0], rounding);
    assert_eq!(passes.system.velocity[..3], [[0.0, 4.0, 0.0, 0.0]; 3]);
    assert_eq!(passes.carried_residual[..3], [[1.0, 2.0, 3.0, 0.0]; 3]);
    assert_eq!(
        (*last, passes.system.velocity[3]),
        ([0.5, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]),
        "displacement and velocity of the attached node"
    );
    assert_eq!(passes.carried_residual[3], [0.0; 4]);
    let prescribed = [1.0, -2.0, 0.0, 0.0];
    assert_eq!(passes.trend, [[1.0, 1.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0], prescribed]);
}

#[test]
fn the_state_moves_at_every_size() {
    // solve/commit computes v += x and d += h R^T v, with velocity v, solution x, displacement d, time step h and the
    // frame's rotation R.
    let width = context().group_size() as usize;
    for nodes in [0, 1, width - 1, width, width + 1, 1234] {
        let turn = DQuat::from_scaled_axis(DVec3::new(1.0, -2.0, 0.5));
        let bodies = if nodes == 0 { vec![] } else { vec![layered(layer(nodes), material(2e4), turn)] };
        let mut passes = Passes::new(System::new(&bodies, 0.004, 5));
        let mut random = Random(nodes as u64 + 2);
        passes.solution = passes.system.random_field(&mut random);
        let wide = |x: &[[f32; 4]]| -> Vec<DVec3> {
            x.iter().map(|x| DVec3::new(x[0].into(), x[1].into(), x[2].into())).collect()
        };
        let (v, d, x) = (wide(&passes.system.velocity), wide(&passes.system.displacement), wide(&passes.solution));
        passes.commit();
        let end: Vec<DVec3> = v.iter().zip(&x).map(|(v, x)| *v + *x).collect();
        let moved = d.iter().zip(&end).map(|(d, v)| *d + passes.system.twin.dt * (turn.inverse() * *v));
        let flat = |x: Vec<DVec3>| -> Vec<f64> { x.iter().flat_map(|x| x.to_array()).collect() };
        let moved = flat(moved.collect());
        let rounding = Tolerance { abs: 1e-7, rel: 0.0 };
        expect_close("v", &triples(&passes.system.velocity), &flat(end), Tolerance { abs: 2e-7, rel: 0.0 });
        expect_close("d", &triples(&passes.system.displacement), &moved, Tolerance { abs: 1e-8, ..rounding });
    }
}
