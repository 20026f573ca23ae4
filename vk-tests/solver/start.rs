//! Tests of the kernels solve/first_residual, which inverts the tool's block, chooses the factor of the warm start (the
//! multiple of the last solution from which the solver starts) and writes the indirect arguments of the iteration loop,
//! and solve/first_iterate, which makes the first iterate. The system is A x = b with preconditioner M. The tool's
//! block is the 6x6 diagonal block of A for the motion of the tool (the rigid body that the haptic device leads); in
//! "blocks of nodes", a block is the nodes that one workgroup owns.

use bytemuck::Zeroable;
use palpate::internal::shaders;
use palpate::internal::shaders::Iteration;
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
fn the_warm_factor_and_the_arguments_by_hand() {
    // solve/first_residual: with y = A x of the last solution x, y.M^-1 b = 3 and y.M^-1 y = 4 give the factor 3/4 of
    // the warm start. There are two blocks of 80 nodes.
    let system = System::new(&[layered(layer(160), material(2e4), glam::DQuat::IDENTITY)], 0.0, 1);
    let mut passes = Passes::new(system);
    (passes.partials, passes.dots) = (vec![[2.0, 0.25], [1.0, 0.5]], vec![[1.0, 1.5], [2.0, 2.5]]);
    passes.iterations[0] = Iteration { gamma: 1.0, alpha: 2.0, count: 9, energies: [5.0; 4], removed: 20.0 };
    (passes.state.retries, passes.state.current) = (3, 1);
    passes.start();
    let s = &passes.state;
    assert_eq!((s.warm_start, s.rhs_norm2, s.floor_norm2), (0.75, 3.0, 0.75));
    assert_eq!((s.current, s.status, s.retries), (0, 0, 3));
    assert_eq!(passes.iterations, [Iteration::zeroed(); 2]);
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
    assert!(others.iter().all(|word| *word == UNTOUCHED), "indirect arguments of other stages must stay as they were");
}

#[test]
fn a_body_at_rest_and_a_failed_solution_start_from_nothing() {
    // solve/first_residual: where b is no larger than its rounding errors, the loop ends before the first iteration.
    // Where A x has overflowed, the factor of the warm start is zero.
    let mut passes = Passes::new(System::new(&[], 0.0, 1));
    passes.block_count = 1;
    (passes.partials, passes.dots) = (vec![[0.5, 0.5]], vec![[1.0, 1.0]]);
    passes.start();
    assert_eq!((passes.state.warm_start, passes.state.status), (0.0, 1));
    assert_eq!(loop_groups(&passes.args), [0; 9]);
    for bad in [[f32::NAN; 2], [f32::INFINITY; 2], [f32::NEG_INFINITY, f32::INFINITY], [1.0, 0.0], [f32::NAN, 1.0]] {
        (passes.partials, passes.dots) = (vec![[2.0, 0.5]], vec![bad]);
        passes.start();
        assert_eq!(
            (passes.state.warm_start, passes.state.status),
            (0.0, 0),
            "factor of the warm start and status, inner products {bad:?}"
        );
    }
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
    // solve/first_residual after solve/assemble, solve/element_product and solve/gather on a random vector in place of
    // the last solution.
    for (seed, contacts) in [(0, 100), (1, 100), (2, 3), (3, 0), (4, 100), (5, 9)] {
        let system = System::new(&two_layers(), 0.004, seed).with_tool();
        let system = if seed < 4 { system } else { system.with_friction() };
        let mut passes = Passes::new(system.with_contacts(contacts, 70 + seed));
        let mut random = Random(80 + seed);
        let x = passes.system.random_field(&mut random);
        // The tool's values are large, so that they matter in the factor of the warm start.
        let tool_x: [f32; 6] = std::array::from_fn(|_| 20.0 * random.next() as f32);
        passes.solution = x.clone();
        // Either of the two sets of iterates may hold the last step's solution.
        passes.state.current = seed as u32 % 2;
        passes.tool_iterate_mut().x = tool_x;
        passes.rigids[0].carried_residual = std::array::from_fn(|_| 1e-3 * random.next() as f32);
        passes.assemble();
        passes.apply(Change::Solution);
        passes.gather(0);
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
        let y = a.multiply(&s.unknowns(&x, &tool_x));
        let (zb, zy) = (preconditioned(&passes, &inverse, &b), preconditioned(&passes, &inverse, &y));
        let warm_start = dot(&y, &zb) / dot(&y, &zy);
        let size = (dot(&b, &zb) / dot(&y, &zy)).sqrt();
        expect_close("warm_start", &[state.warm_start], &[warm_start], Tolerance { abs: FACTOR * size, rel: FACTOR });
        expect_close("b . M^-1 b", &[state.rhs_norm2], &[dot(&b, &zb)], Tolerance { abs: 0.0, rel: FACTOR });
        assert!(state.floor_norm2 > 0.0 && state.floor_norm2 < 1e-9 * state.rhs_norm2);
        // From here on, the expected vectors are computed with the factor that the kernel found.
        let warm_start = f64::from(state.warm_start);
        let r: Vec<f64> = b.iter().zip(&y).map(|(b, y)| b - warm_start * y).collect();
        let scaled: Vec<f64> = tool_x.iter().map(|x| warm_start * f64::from(*x)).collect();
        expect_close("tool's part of the solution x", &tool_now.x, &scaled, ROUNDING);
        let magnitude = |rows: std::ops::Range<usize>| -> f64 {
            rows.map(|k| b[tool + k].abs().max((warm_start * y[tool + k]).abs())).fold(0.0, f64::max)
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
        // With this factor, the first residual must never be greater than without a warm start.
        assert!(dot(&r, &preconditioned(&passes, &inverse, &r)) <= dot(&b, &zb) * (1.0 + FACTOR));
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
        passes.apply(Change::Solution);
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
    alone.apply(Change::Solution);
    alone.gather(0);
    alone.start();
    assert!(alone.state.energy_limit > 1e38, "without contacts nothing limits the energy");
}

#[test]
fn the_first_iterate_at_every_size() {
    // solve/first_iterate: with factor w of the warm start and y = A x, the kernel sets r = b - w y and u = M^-1 r, and
    // replaces x by w x. Where w is zero, the old x and y are not used.
    let width = context().group_size() as usize;
    for nodes in [0, 1, width - 1, width, width + 1, 1234] {
        for warm_start in [0.75, 0.0] {
            let bodies =
                if nodes == 0 { vec![] } else { vec![layered(layer(nodes), material(2e4), glam::DQuat::IDENTITY)] };
            let mut passes = Passes::new(System::new(&bodies, 0.0, 1));
            let mut random = Random(nodes as u64);
            let mut field = || passes.system.random_field(&mut random);
            (passes.solution, passes.rhs, passes.operator_product) = (field(), field(), field());
            passes.inverse = [field(), field()].concat();
            passes.state.warm_start = warm_start;
            if warm_start == 0.0 {
                // Attached nodes are in no block and keep their zeros.
                for (i, role) in passes.roles().iter().enumerate().filter(|(_, role)| role.is_some()) {
                    assert_eq!(*role, Some(0), "role of the block that owns node {i} (0: block of free nodes)");
                    (passes.operator_product[i], passes.solution[i]) = ([f32::NAN; 4], [f32::NAN; 4]);
                }
            }
            let (x, y) = (triples(&passes.solution), triples(&passes.operator_product));
            passes.begin();
            let w = f64::from(warm_start);
            let take = |x: &f32| if w == 0.0 { 0.0 } else { w * f64::from(*x) };
            expect_close("x", &triples(&passes.solution), &x.iter().map(take).collect::<Vec<_>>(), ROUNDING);
            let b = triples(&passes.rhs);
            let r: Vec<f64> = b.iter().zip(&y).map(|(b, y)| f64::from(*b) - take(y)).collect();
            expect_close("r", &triples(&passes.residual), &r, Tolerance { abs: 2e-7, rel: 0.0 });
            let u = r.chunks(3).enumerate().flat_map(|(i, r)| passes.precondition(i, [r[0], r[1], r[2]]));
            let u: Vec<f64> = u.collect();
            expect_close("u", &triples(&passes.preconditioned), &u, Tolerance { abs: 2e-6, rel: 0.0 });
            let zeros = passes.direction.iter().chain(&passes.direction_product).all(|x| *x == [0.0; 4]);
            assert!(zeros && passes.residual.iter().all(|r| r[3] == 0.0));
        }
    }
}
