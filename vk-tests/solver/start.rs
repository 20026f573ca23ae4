//! Tests of the kernels solve/first_residual, which inverts the tool's block, chooses the factors of the warm start (the
//! combination of the last two solutions from which the solver starts) and writes the indirect arguments of the iteration loop,
//! and solve/first_iterate, which makes the first iterate. The system is A x = b with preconditioner M. The tool's
//! block is the 6x6 diagonal block of A for the motion of the tool (the rigid body that the haptic device leads); in
//! "blocks of nodes", a block is the nodes that one workgroup owns.

use bytemuck::Zeroable;
use palpate::internal::shaders;
use palpate::internal::shaders::{Iteration, Solve};
use palpate_oracle::linear::{Entries, Solver};

use super::passes::{Change, Passes, UNTOUCHED};
use crate::harness::random::Random;
use crate::harness::{Tolerance, context, expect_close};
use crate::solver::system::{System, layer, layered, material, triples, two_layers};
use crate::stage::elastic::expect_of_largest;

/// Relative error of a few f32 roundings.
const ROUNDING: Tolerance = Tolerance { abs: 0.0, rel: 2e-6 };
/// Error of the tool's rows of b and of the residual, relative to the largest value: a row is a sum over a hundred
/// contacts, each term of which is a dozen roundings away from the input.
const SUM: f64 = 5.0e-6;
/// Error of an entry of the inverse of the tool's block relative to the geometric mean of the diagonal entries in its
/// row and in its column: rounding of the block (1e-6) times the condition number (some hundreds) that the block
/// has when it is scaled to a diagonal of ones.
const INVERSE: f64 = 1.0e-4;
/// Relative error of factors and norms, which are inner products with blocks that were inverted in f32.
const FACTOR: f64 = 1.0e-4;

/// Numbers of workgroups in x of the indirect dispatches from `ARGS_LOOP_ELEMENT_PRODUCT` to `ARGS_GAP`.
fn loop_groups(args: &[u32]) -> Vec<u32> {
    (shaders::ARGS_LOOP_ELEMENT_PRODUCT..=shaders::ARGS_GAP).map(|args_index| args[3 * args_index as usize]).collect()
}

#[test]
fn the_warm_start_and_the_arguments_by_hand() {
    // solve/first_residual: with the last solution x and the trend d, x.b = 3, x.Ax = 4, x.Ad = 2, d.b = 2 and d.Ad = 2,
    // f x + g d has the least error for f = g = 1/2. Its difference from the last step's solution is (f - 1) x + g d in
    // a step's first solve, and f x + (g + 1) d in others. There are two blocks of 80 nodes.
    for (newton_iterations, change) in [(0, 0.5), (3, 8.5)] {
        let system = System::new(&[layered(layer(160), material(2e4), glam::DQuat::IDENTITY)], 0.0, 1);
        let mut passes = Passes::new(system);
        passes.partials = vec![[2.0, 0.25], [1.0, 0.5]];
        passes.projections = vec![[1.0, 1.5, 0.5, 0.0], [2.0, 2.5, 1.5, 0.0]];
        passes.trend_projections = vec![[0.5, 0.75, 9.0, 0.0], [1.5, 1.25, 9.0, 0.0]];
        passes.iterations[0] =
            Iteration { gamma: 1.0, alpha: 2.0, count: 9, fresh: 9, energies: [5.0; 4], ..Iteration::zeroed() };
        (passes.state.newton_iterations, passes.state.current) = (newton_iterations, 1);
        passes.state.solution_dt = passes.system.params.dt;
        passes.start();
        let s = &passes.state;
        assert_eq!((s.warm_start, s.rhs_norm2, s.floor_norm2), ([0.5, 0.5], 3.0, 0.75));
        assert_eq!((s.current, s.status, s.newton_iterations), (0, 0, newton_iterations));
        let first = Iteration { change, ..Iteration::zeroed() };
        assert_eq!(passes.iterations, [first, Iteration::zeroed()]);
        let tetrahedra = passes.tetrahedra().div_ceil(context().group_size() as usize) as u32;
        assert_eq!(loop_groups(&passes.args), [tetrahedra, 0, 0, 2, 0, 0, 0, 0, 0]);
        for args_index in shaders::ARGS_LOOP_ELEMENT_PRODUCT..=shaders::ARGS_GAP {
            assert_eq!(
                passes.args[3 * args_index as usize + 1..][..2],
                [1, 1],
                "workgroups in y and z of dispatch {args_index}"
            );
        }
        let others = [
            &passes.args[..3 * shaders::ARGS_LOOP_ELEMENT_PRODUCT as usize],
            &passes.args[3 * shaders::ARGS_GAP as usize + 3..],
        ]
        .concat();
        assert!(
            others.iter().all(|word| *word == UNTOUCHED),
            "other stages' indirect arguments must stay as they were"
        );
    }
}

#[test]
fn a_body_at_rest_and_a_failed_solution_start_from_nothing() {
    // solve/first_residual: where b is no larger than its rounding errors, the loop ends before the first iteration.
    // Where A x has overflowed, the factors of the warm start are zero; where A d has, or where d is a multiple of x, the
    // trend d is left out.
    let mut passes = Passes::new(System::new(&[], 0.0, 1));
    passes.block_count = 1;
    let mut factors = |partials: [f32; 2], of_solution: [f32; 3], of_trend: [f32; 2]| {
        let ([xb, xx, xd], [db, dd]) = (of_solution, of_trend);
        (passes.partials, passes.projections) = (vec![partials], vec![[xb, xx, xd, 0.0]]);
        passes.trend_projections = vec![[db, dd, 0.0, 0.0]];
        passes.start();
        (passes.state.warm_start, passes.state.status, loop_groups(&passes.args))
    };
    let good = [3.0, 4.0, 2.0];
    assert_eq!(factors([0.5, 0.5], good, [2.0, 2.0]), ([0.0; 2], 1, vec![0; 9]));
    for bad in [[f32::NAN; 2], [f32::INFINITY; 2], [f32::NEG_INFINITY, f32::INFINITY], [1.0, 0.0], [f32::NAN, 1.0]] {
        let (start, status, _) = factors([2.0, 0.5], [bad[0], bad[1], 0.0], [1.0, 1.0]);
        assert_eq!((start, status), ([0.0; 2], 0), "factors of the warm start and status, inner products {bad:?}");
    }
    for bad in [[f32::NAN; 2], [f32::INFINITY; 2], [2.0, 1.0], [0.0, 0.0], [f32::NAN, 2.0]] {
        let (start, status, _) = factors([2.0, 0.5], good, bad);
        assert_eq!((start, status), ([0.75, 0.0], 0), "factors of the warm start and status, of the trend {bad:?}");
    }
}

/// Checks the factors of the warm start against those at which the error of f x + g d has the least energy, from the
/// right-hand side `b`, the vectors x and d, and the operator's products with them. Returns the kernel's factors.
pub fn expect_factors(what: &str, state: &Solve, b: &[f64], [x, d]: [&[f64]; 2], [y, w]: [&[f64]; 2]) -> [f64; 2] {
    let (xx, xd, dd, xb, db) = (dot(x, y), dot(x, w), dot(d, w), dot(x, b), dot(d, b));
    let determinant = xx * dd - xd * xd;
    let want = [(dd * xb - xd * db) / determinant, (xx * db - xd * xb) / determinant];
    // The sums of the terms' magnitudes are what rounding is relative to.
    let size = |v: &[f64], norm2: f64| v.iter().zip(b).map(|(v, b)| (v * b).abs()).sum::<f64>() / norm2;
    let allowed = FACTOR * (size(x, xx) + size(d, dd)) * xx * dd / determinant;
    expect_close(&format!("{what}: warm start"), &state.warm_start, &want, Tolerance { abs: allowed, rel: 0.0 });
    state.warm_start.map(f64::from)
}

/// The inverse of the tool's block, row by row, from the matrix A of the oracle (the f64 reference implementation).
fn tool_block(system: &System) -> [Vec<f64>; 6] {
    let (a, _) = system.twin.assemble(system.device.as_ref(), &system.twin_contacts);
    let tool = system.twin.unknowns().tool;
    let mut block = Entries::default();
    a.lower().filter(|(i, j, _)| *i >= tool && *j >= tool).for_each(|(i, j, x)| block.add(i - tool, j - tool, x));
    let unit = |k: usize| (0..6).map(|l| f64::from(u8::from(k == l))).collect::<Vec<_>>();
    std::array::from_fn(|k| Solver::default().solve(&block, &unit(k)).unwrap())
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// M^-1 times the vector `r`, in the order of the oracle's unknowns. M^-1 consists of the kernel's inverses of 3x3
/// blocks for the nodes and of `inverse`, the oracle's inverse of the 6x6 block, for the tool.
fn preconditioned(passes: &Passes, inverse: &[Vec<f64>; 6], r: &[f64]) -> Vec<f64> {
    let places = passes.system.twin.unknowns();
    let mut z = vec![0.0; r.len()];
    for (i, first) in places.nodes.iter().flatten().enumerate() {
        if let [(first, _)] = &first[..] {
            z[*first..first + 3].copy_from_slice(&passes.precondition(i, std::array::from_fn(|k| r[first + k])));
        }
    }
    for (k, row) in inverse.iter().enumerate() {
        z[places.tool + k] = dot(row, &r[places.tool..]);
    }
    z
}

#[test]
fn the_tools_rows_and_the_warm_start_agree_with_the_oracle() {
    // solve/first_residual after solve/assemble, solve/stiffness_blocks and solve/gather on a random vector in place of
    // the last solution.
    for (seed, contacts) in [(0, 100), (1, 100), (2, 3), (3, 0), (4, 100), (5, 9)] {
        let system = System::new(&two_layers(), 0.004, seed).with_tool();
        let system = if seed < 4 { system } else { system.with_friction() };
        let mut passes = Passes::new(system.with_contacts(contacts, 70 + seed));
        let mut random = Random(80 + seed);
        let x = passes.system.random_field(&mut random);
        // The tool's values are large, so that they matter in the factors of the warm start.
        let tool_x: [f32; 6] = std::array::from_fn(|_| 20.0 * random.next() as f32);
        passes.solution = x.clone();
        // Either of the two sets of iterates may hold the last step's solution.
        passes.state.current = seed as u32 % 2;
        passes.tool_iterate_mut().x = tool_x;
        let trend = passes.system.random_field(&mut random);
        let tool_trend: [f32; 6] = std::array::from_fn(|_| 20.0 * random.next() as f32);
        passes.trend = trend.clone();
        passes.rigid_trends.iter_mut().for_each(|set| set.x = tool_trend);
        passes.state.newton_iterations = seed as u32 % 3;
        passes.rigids[0].carried_residual = std::array::from_fn(|_| 1e-3 * random.next() as f32);
        passes.assemble();
        passes.apply(Change::Start);
        passes.gather(0);
        passes.apply(Change::Trend);
        passes.gather_trend();
        let left = passes.rigids[0].carried_residual.map(f64::from);
        passes.start();

        let (s, state, own, tool_now) = (&passes.system, &passes.state, &passes.rigids[0], passes.tool_iterate());
        let (a, mut b) = s.twin.assemble(s.device.as_ref(), &s.twin_contacts);
        let tool = s.twin.unknowns().tool;
        (0..6).for_each(|k| b[tool + k] += left[k]);
        expect_of_largest("tool's b, force", &own.b[..3], &b[tool..tool + 3], SUM);
        expect_of_largest("tool's b, torque", &own.b[3..], &b[tool + 3..], SUM);
        let inverse = tool_block(s);
        for k in 0..36 {
            let (i, j) = (k / 6, k % 6);
            let error = (passes.rigid_inverse(0, i, j) - inverse[i][j]).abs();
            assert!(
                error < INVERSE * (inverse[i][i] * inverse[j][j]).sqrt(),
                "entry ({i}, {j}) of the inverse is off by {error:e}"
            );
        }
        let (x, d) = (s.unknowns(&x, &tool_x), s.unknowns(&trend, &tool_trend));
        let (y, w, zb) = (a.multiply(&x), a.multiply(&d), preconditioned(&passes, &inverse, &b));
        expect_close("b . M^-1 b", &[state.rhs_norm2], &[dot(&b, &zb)], Tolerance { abs: 0.0, rel: FACTOR });
        assert!(state.floor_norm2 > 0.0 && state.floor_norm2 < 1e-9 * state.rhs_norm2);
        // From here on, the expected vectors are computed with the factors that the kernel found.
        let [f, g] = expect_factors("tool", state, &b, [&x, &d], [&y, &w]);
        let start: Vec<f64> = x.iter().zip(&d).map(|(x, d)| f * x + g * d).collect();
        let product: Vec<f64> = y.iter().zip(&w).map(|(y, w)| f * y + g * w).collect();
        let r: Vec<f64> = b.iter().zip(&product).map(|(b, y)| b - y).collect();
        let largest = start[tool..].iter().fold(0.0f64, |m, x| m.max(x.abs()));
        let rounding = Tolerance { abs: 1e-6 * largest, rel: 0.0 };
        expect_close("tool's part of the solution x", &tool_now.x, &start[tool..], rounding);
        let begins = state.newton_iterations == 0;
        let left = if begins { tool_x.map(|x| -x) } else { tool_trend };
        assert!(
            passes.rigid_trends.iter().all(|set| set.x == left),
            "the tool's trend in solve {}",
            state.newton_iterations
        );
        let magnitude = |rows: std::ops::Range<usize>| -> f64 {
            rows.map(|k| b[tool + k].abs().max((f * y[tool + k]).abs()).max((g * w[tool + k]).abs()))
                .fold(0.0, f64::max)
        };
        for rows in [0..3, 3..6] {
            let allowed = Tolerance { abs: 2.0 * SUM * magnitude(rows.clone()), rel: 0.0 };
            expect_close("tool's residual", &tool_now.r[rows.clone()], &r[tool..][rows], allowed);
        }
        let residual = tool_now.r.map(f64::from);
        let u: Vec<f64> = (0..6).map(|i| (0..6).map(|k| passes.rigid_inverse(0, i, k) * residual[k]).sum()).collect();
        let sizes = (0..6).map(|i| (0..6).map(|k| (passes.rigid_inverse(0, i, k) * residual[k]).abs()).sum::<f64>());
        for (i, size) in sizes.enumerate() {
            expect_close(
                "tool's preconditioned residual",
                &tool_now.u[i..=i],
                &u[i..=i],
                Tolerance { abs: SUM * size, rel: 0.0 },
            );
        }
        assert_eq!((tool_now.p, tool_now.s), ([0.0; 6], [0.0; 6]));
        // The energy of the error must never be greater than without a warm start.
        let gained = 2.0 * dot(&start, &b) - dot(&start, &product);
        assert!(gained >= -FACTOR * dot(&start, &product), "energy that the warm start removes: {gained:e}");
    }
}

#[test]
fn the_limit_of_energy_is_that_of_the_contacts() {
    // The sum w of the contacts' normal terms (h^2 k + h d) a, and the greatest error of their impulse, make the limit:
    // that impulse squared over w, once for the tool and once for all other contacts, of which the lesser one counts.
    // The impulse is a share of the normal force times h; a force below 1 N counts as 1 N.
    for (tolerance, share, forces) in [(1e-2, 5e-2, [40.0, 0.3]), (1e-2, 5e-2, [0.2, 90.0]), (1e-6, 1e-3, [2.0, 3.0])] {
        let system = System::new(&two_layers(), 0.004, 6).with_tool().with_contacts(100, 77);
        let mut passes = Passes::new(system);
        passes.system.stop_at(tolerance);
        passes.state.normal_forces = forces;
        passes.assemble();
        passes.apply(Change::Start);
        passes.gather(0);
        passes.start();
        let h = f64::from(passes.system.params.dt);
        let limits = [true, false].map(|of_tool| {
            let chosen = passes.system.contacts.iter().filter(|c| (c.tool_sign != 0.0) == of_tool);
            let terms = chosen.map(|c| (h * f64::from(c.stiffness) + f64::from(c.damping)) * h * f64::from(c.area));
            (share * h * f64::from(forces[usize::from(!of_tool)]).max(1.0)).powi(2) / terms.sum::<f64>()
        });
        expect_close("limit of energy", &[passes.state.energy_limit], &[limits[0].min(limits[1])], ROUNDING);
    }
    let mut alone = Passes::new(System::new(&two_layers(), 0.004, 6).with_tool());
    alone.assemble();
    alone.apply(Change::Start);
    alone.gather(0);
    alone.start();
    assert!(alone.state.energy_limit > 1e38, "without contacts nothing limits the energy");
}

#[test]
fn the_first_iterate_at_every_size() {
    // solve/first_iterate: with the factors f and g of the last solution x and of the trend d, the kernel sets
    // r = b - f A x - g A d and u = M^-1 r, replaces x by f x + g d, and in a step's first solve d by -x. Where a factor
    // is zero, its vectors are not used.
    let width = context().group_size() as usize;
    for nodes in [0, 1, width - 1, width, width + 1, 1234] {
        for (factors, newton_iterations) in [([0.75, -0.5], 0), ([0.75, 0.0], 1), ([0.5, 0.25], 1), ([0.0, 0.0], 0)] {
            let bodies =
                if nodes == 0 { vec![] } else { vec![layered(layer(nodes), material(2e4), glam::DQuat::IDENTITY)] };
            let mut passes = Passes::new(System::new(&bodies, 0.0, 1));
            let mut random = Random(nodes as u64);
            let mut field = || passes.system.random_field(&mut random);
            (passes.solution, passes.rhs, passes.operator_product) = (field(), field(), field());
            (passes.trend, passes.trend_product) = (field(), field());
            passes.inverse = [field(), field()].concat();
            (passes.state.warm_start, passes.state.newton_iterations) = (factors, newton_iterations);
            // Attached nodes are in no block and keep their values.
            for (i, role) in passes.roles().iter().enumerate().filter(|(_, role)| role.is_some()) {
                assert_eq!(*role, Some(0), "role of the block that owns node {i} (0: block of free nodes)");
                if factors[0] == 0.0 {
                    (passes.operator_product[i], passes.solution[i]) = ([f32::NAN; 4], [f32::NAN; 4]);
                }
                if factors[1] == 0.0 {
                    (passes.trend_product[i], passes.trend[i]) = ([f32::NAN; 4], [f32::NAN; 4]);
                }
            }
            let (x, y) = (triples(&passes.solution), triples(&passes.operator_product));
            let (d, w) = (triples(&passes.trend), triples(&passes.trend_product));
            let free: Vec<bool> = passes.roles().iter().flat_map(|role| [role.is_some(); 3]).collect();
            passes.begin();
            let [f, g] = factors.map(f64::from);
            let part = |factor: f64, x: f32| if factor == 0.0 { 0.0 } else { factor * f64::from(x) };
            let both = |x: &[f32], d: &[f32]| -> Vec<f64> {
                x.iter().zip(d).map(|(x, d)| part(f, *x) + part(g, *d)).collect()
            };
            let of_free = |all: Vec<f64>| -> Vec<f64> {
                all.into_iter().zip(&free).filter(|(_, free)| **free).map(|(x, _)| x).collect()
            };
            let got = |all: &[[f32; 4]]| -> Vec<f32> {
                triples(all).into_iter().zip(&free).filter(|(_, free)| **free).map(|(x, _)| x).collect()
            };
            let rounding = Tolerance { abs: 2e-7, rel: 0.0 };
            expect_close("x", &got(&passes.solution), &of_free(both(&x, &d)), rounding);
            let left = x.iter().map(|x| if f == 0.0 { 0.0 } else { -f64::from(*x) });
            if newton_iterations == 0 {
                expect_close("d", &got(&passes.trend), &of_free(left.collect()), ROUNDING);
            } else {
                assert!(triples(&passes.trend).iter().zip(&d).all(|(a, b)| a.to_bits() == b.to_bits()), "the trend");
            }
            let b = triples(&passes.rhs);
            let r: Vec<f64> = b.iter().zip(both(&y, &w)).map(|(b, y)| f64::from(*b) - y).collect();
            expect_close("r", &got(&passes.residual), &of_free(r.clone()), rounding);
            let u = r.chunks(3).enumerate().flat_map(|(i, r)| passes.precondition(i, [r[0], r[1], r[2]]));
            expect_close("u", &got(&passes.preconditioned), &of_free(u.collect()), Tolerance { abs: 2e-6, rel: 0.0 });
            let zeros = passes.direction.iter().chain(&passes.direction_product).all(|x| *x == [0.0; 4]);
            assert!(zeros && passes.residual.iter().all(|r| r[3] == 0.0));
        }
    }
}
