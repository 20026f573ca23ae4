//! Tests of the kernels that apply the coarse space of the preconditioner (solve/coarse, and parts of solve/assemble,
//! gather, first_residual, first_iterate and update) against f64 sums. The sums use the oracle's prolongation P (the
//! oracle is the reference implementation on the CPU) and the coarse inverse A_c^-1 that the kernels read. The
//! preconditioner is M^-1 = D^-1 + P A_c^-1 P^T, with the diagonal blocks D of the operator A; the restriction is P^T. P
//! has the affine motions of blocks, with contacts times D^-1 E, where E is D without contacts.
//! A block is the nodes of one workgroup and has twelve modes, its affine motions, which are columns of P; see mod.rs.
//! The solver finds x in A x = b by conjugate gradients, which keep the residual r = b - A x, u = M^-1 r, w = A u, the
//! search direction p and s = A p.

use faer::Mat;
use glam::{DMat3, DVec3};
use palpate::internal::gpu::Size;
use palpate::internal::prepare::Body;
use palpate::scene::Preconditioner;
use palpate_oracle::coarse::BLOCK_UNKNOWNS;

use super::super::passes::{Change, Passes};
use super::{coarse_vector_of, host_inverse, kinds, large_core, product, soft_and_stiff, turned};
use crate::harness::context;
use crate::harness::random::Random;
use crate::solver::start::expect_factors;
use crate::solver::system::{System, layer, triples, two_layers, two_layers_one_on_a_core, two_layers_one_on_a_hinge};

/// Greatest allowed error of a sum of f32 products, relative to the sum of the terms' magnitudes: some hundred
/// roundings that mostly cancel.
pub const SUM: f64 = 2.0e-6;
/// Greatest allowed error relative to the sum of the terms' magnitudes where `SUM` is too small: after a few
/// iterations, in which a recurrence gives P^T r, and for products with blocks inverted in f32.
const ROUNDS: f64 = 5.0e-6;
/// Largest displacement of a node, m. Cells have edges of 20 mm, so that blocks of eight nodes turn by some degrees.
const AMPLITUDE: f64 = 0.004;

/// What the kernels' results are compared with: the prolongation P (unknowns by modes), and A_c^-1 as the kernels read
/// it.
pub struct Twin {
    pub p: Mat<f64>,
    /// Sum of the magnitudes of the terms of each entry of P.
    p_sizes: Mat<f64>,
    inverse: Mat<f64>,
}

fn wide(x: &[f32]) -> Vec<f64> {
    x.iter().map(|x| f64::from(*x)).collect()
}

fn flat(modes: &[[f32; 4]]) -> Vec<f64> {
    wide(modes.as_flattened())
}

pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

pub fn magnitudes(a: &[f64]) -> Vec<f64> {
    a.iter().map(|a| a.abs()).collect()
}

fn transposed(matrix: &Mat<f64>, x: &[f64]) -> Vec<f64> {
    (0..matrix.ncols()).map(|j| x.iter().enumerate().map(|(i, x)| matrix[(i, j)] * x).sum()).collect()
}

/// Checks that each value of `got` is off by at most `share` of its size in `sizes`. Returns the largest error relative
/// to the size.
fn expect_within(what: &str, got: &[f64], want: &[f64], sizes: &[f64], share: f64) -> f64 {
    assert_eq!((got.len(), sizes.len()), (want.len(), want.len()), "{what}: numbers of results and of sizes");
    let mut worst = 0.0f64;
    for (i, (got, want)) in got.iter().zip(want).enumerate() {
        let error = (got - want).abs();
        assert!(error <= share * sizes[i], "{what} [{i}]: got {got:e}, want {want:e}, size {:e}", sizes[i]);
        worst = worst.max(if sizes[i] > 0.0 { error / sizes[i] } else { 0.0 });
    }
    worst
}

fn absolute(m: &Mat<f64>) -> Mat<f64> {
    Mat::from_fn(m.nrows(), m.ncols(), |i, j| m[(i, j)].abs())
}

impl Twin {
    /// The coarse space of a system whose blocks are rotated as solve/assemble found. With contacts, the rows of a free
    /// node are those of the affine motions times D^-1 E, with the kernels' D^-1 and the oracle's E, the node's diagonal
    /// block without contacts.
    pub fn new(passes: &Passes) -> Twin {
        let system = &passes.system;
        let mut p = coarse_vector_of(system, &passes.block_turns);
        let mut p_sizes = absolute(&p);
        if passes.contact {
            let maps = system.twin.unknowns().nodes;
            let free: Vec<(usize, usize)> = (maps.iter().flatten().enumerate())
                .filter(|(_, map)| map.len() == 1)
                .map(|(i, map)| (i, map[0].0))
                .collect();
            let firsts: Vec<usize> = free.iter().map(|(_, first)| *first).collect();
            let without_contacts = system.twin.assemble(system.device.as_ref(), &[]).0.diagonal_blocks(&firsts);
            for ((node, first), block) in free.iter().zip(without_contacts) {
                let inverse = DMat3::from_cols_array_2d(
                    &[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|unit| passes.precondition(*node, unit)),
                );
                for j in 0..p.ncols() {
                    let moved = DVec3::from_array(std::array::from_fn(|k| p[(first + k, j)]));
                    let (value, size) = (inverse * (block * moved), inverse.abs() * (block.abs() * moved.abs()));
                    (0..3).for_each(|k| (p[(first + k, j)], p_sizes[(first + k, j)]) = (value[k], size[k]));
                }
            }
        }
        Twin { p, p_sizes, inverse: host_inverse(&system.model, false) }
    }

    fn absolute(&self) -> Twin {
        Twin { p: self.p_sizes.clone(), p_sizes: self.p_sizes.clone(), inverse: absolute(&self.inverse) }
    }

    /// The restriction P^T x of a vector over the unknowns.
    fn restricted(&self, x: &[f64]) -> Vec<f64> {
        transposed(&self.p, x)
    }

    /// The coarse correction P A_c^-1 P^T x.
    fn correction(&self, x: &[f64]) -> Vec<f64> {
        product(&self.p, &product(&self.inverse, &self.restricted(x)))
    }

    /// M^-1 x with the kernels' diagonal blocks.
    fn preconditioned(&self, passes: &Passes, x: &[f64]) -> Vec<f64> {
        self.correction(x).iter().zip(diagonal(passes, x, |x| x)).map(|(z, d)| z + d).collect()
    }

    /// For each unknown, the sum of the magnitudes of the terms of M^-1 x.
    pub fn sizes(&self, passes: &Passes, x: &[f64]) -> Vec<f64> {
        let x = magnitudes(x);
        self.absolute().correction(&x).iter().zip(diagonal(passes, &x, f64::abs)).map(|(z, d)| z + d).collect()
    }
}

/// D^-1 x with the kernels' diagonal blocks, where `of` is applied to each entry of D^-1.
fn diagonal(passes: &Passes, x: &[f64], of: fn(f64) -> f64) -> Vec<f64> {
    let unknowns = passes.system.twin.unknowns();
    let mut z = vec![0.0; x.len()];
    for (i, map) in unknowns.nodes.iter().flatten().enumerate() {
        let [(first, _)] = map[..] else { continue };
        for k in 0..3 {
            let unit = std::array::from_fn(|l| if k == l { 1.0 } else { 0.0 });
            let column = passes.precondition(i, unit);
            (0..3).for_each(|l| z[first + l] += of(column[l]) * x[first + k]);
        }
    }
    let firsts = unknowns.cores.iter().copied().chain(passes.tool.then_some(unknowns.tool));
    for (index, first) in firsts.enumerate() {
        for k in 0..36 {
            z[first + k / 6] += of(passes.rigid_inverse(index, k / 6, k % 6)) * x[first + k % 6];
        }
    }
    z
}

/// Puts the sum over all blocks of nodes attached to a rigid core (rigid body inside a soft one) into the first of
/// these blocks, since the attached nodes all move with the core.
fn summed(passes: &Passes, mut modes: Vec<f64>) -> Vec<f64> {
    modes.truncate(BLOCK_UNKNOWNS * passes.blocks());
    for rigid in &passes.rigids[..passes.system.model.cores.len()] {
        let first = rigid.first_coarse_index as usize;
        for coarse_index in first + 1..first + rigid.block_count as usize {
            for k in 0..BLOCK_UNKNOWNS {
                modes[BLOCK_UNKNOWNS * first + k] += std::mem::take(&mut modes[BLOCK_UNKNOWNS * coarse_index + k]);
            }
        }
    }
    modes
}

/// Random values of the unknowns that f32 holds exactly; motions that a hinge does not allow are zero. Values of cores
/// and of the tool (rigid body that the haptic device leads) are multiplied by `rigid`.
pub fn random_unknowns(system: &System, random: &mut Random, rigid: f64) -> Vec<f64> {
    let unknowns = system.twin.unknowns();
    let mut x: Vec<f64> = (0..unknowns.count).map(|_| f64::from(random.next() as f32)).collect();
    for (core, first) in system.twin.cores.iter().zip(&unknowns.cores) {
        let (linear, angular) = core.freedom();
        for (at, free) in [(*first, linear), (first + 3, angular)] {
            let own: DMat3 = free;
            let moved = (own * DVec3::from_slice(&x[at..at + 3])).as_vec3();
            (0..3).for_each(|k| x[at + k] = rigid * f64::from(moved[k]));
        }
    }
    x[unknowns.tool..].iter_mut().for_each(|x| *x *= rigid);
    x
}

/// The six values (three linear, three angular) of a core, or of the tool, which comes after the cores.
pub fn six(passes: &Passes, index: usize, x: &[f64]) -> [f32; 6] {
    let unknowns = passes.system.twin.unknowns();
    let first = unknowns.cores.get(index).copied().unwrap_or(unknowns.tool);
    std::array::from_fn(|k| x[first + k] as f32)
}

/// Values at the nodes: a free node has its own value, and a node attached to a dynamic core moves with the core.
pub fn node_vectors(system: &System, x: &[f64]) -> Vec<[f32; 4]> {
    let (bodies, _) = system.rows(x);
    bodies.iter().flat_map(|rows| rows.chunks(3)).map(|v| [v[0] as f32, v[1] as f32, v[2] as f32, 0.0]).collect()
}

/// Sets the values of all nodes that are not free to zero.
pub fn only_free(passes: &Passes, mut nodes: Vec<[f32; 4]>) -> Vec<[f32; 4]> {
    nodes.iter_mut().zip(passes.roles()).filter(|(_, role)| *role != Some(0)).for_each(|(x, _)| *x = [0.0; 4]);
    nodes
}

/// Runs the passes of a solve with a random earlier solution: the start, three iterations and the end. Compares each
/// pass with the oracle's result from the same inputs. Returns the largest error relative to the size of a value.
fn follow(what: &str, system: System) -> f64 {
    follow_at(what, system, Size::Reduce)
}

/// As [`follow`], with workgroups of this size.
fn follow_at(what: &str, system: System, size: Size) -> f64 {
    let mut passes = Passes { size, ..Passes::new(system) };
    assert!(passes.coarse, "{what}: no coarse space");
    let mut random = Random(7);
    let left = random_unknowns(&passes.system, &mut random, 1.0)
        .iter()
        .map(|x| f64::from(1e-4 * *x as f32))
        .collect::<Vec<_>>();
    let x = random_unknowns(&passes.system, &mut random, 5.0);
    passes.carried_residual = only_free(&passes, node_vectors(&passes.system, &left));
    let trend = random_unknowns(&passes.system, &mut random, 5.0);
    passes.solution = node_vectors(&passes.system, &x);
    passes.trend = node_vectors(&passes.system, &trend);
    passes.state.current = 1;
    for index in 0..passes.rigids.len() {
        passes.rigids[index].carried_residual = six(&passes, index, &left);
        passes.rigid(index).x = six(&passes, index, &x);
        let (of_trend, count) = (six(&passes, index, &trend), passes.rigids.len());
        for at in [index, count + index] {
            passes.rigid_trends[at].x = of_trend;
        }
    }
    let (a, mut b) = passes.system.twin.assemble(passes.system.device.as_ref(), &passes.system.twin_contacts);
    b.iter_mut().zip(&left).for_each(|(b, left)| *b += left);

    passes.assemble();
    passes.cores();
    let twin = Twin::new(&passes);
    let absolute = twin.absolute();
    let mut worst = 0.0f64;
    // The terms of b, elastic forces, nearly cancel: errors are relative to the largest value of b and not to each
    // value's own size.
    let of_b = absolute.restricted(&vec![largest(&b); b.len()]);
    worst = worst.max(expect_within(
        &format!("{what}: P^T b"),
        &summed(&passes, flat(&passes.restricted_rhs)),
        &twin.restricted(&b),
        &of_b,
        SUM,
    ));
    passes.apply(Change::Start);
    passes.gather(0);
    let y = a.multiply(&x);
    let of_y = absolute.restricted(&vec![largest(&y); y.len()]);
    worst = worst.max(expect_within(
        &format!("{what}: P^T A x"),
        &summed(&passes, flat(&passes.restricted_product)),
        &twin.restricted(&y),
        &of_y,
        SUM,
    ));
    assert!(
        passes.restricted_residual[..3 * passes.blocks()].iter().all(|r| *r == [0.0; 4]),
        "{what}: the restricted residual must still be zero"
    );

    passes.apply(Change::Trend);
    passes.gather_trend();
    let y_trend = a.multiply(&trend);
    let of_y_trend = absolute.restricted(&vec![largest(&y_trend); y_trend.len()]);
    worst = worst.max(expect_within(
        &format!("{what}: P^T A d"),
        &summed(&passes, flat(&passes.restricted_trend)),
        &twin.restricted(&y_trend),
        &of_y_trend,
        SUM,
    ));

    passes.coarse(true);
    let count = BLOCK_UNKNOWNS * passes.blocks();
    let [of_rhs, of_product, of_trend] = [&passes.restricted_rhs, &passes.restricted_product, &passes.restricted_trend]
        .map(|all| flat(all)[..count].to_vec());
    for (name, got, from) in [
        ("A_c^-1 P^T b", &passes.coarse_rhs, &of_rhs),
        ("A_c^-1 P^T A x", &passes.coarse_product, &of_product),
        ("A_c^-1 P^T A d", &passes.coarse_trend, &of_trend),
    ] {
        let sizes = product(&absolute.inverse, &magnitudes(from));
        worst = worst.max(expect_within(
            &format!("{what}: {name}"),
            &flat(got),
            &product(&twin.inverse, from),
            &sizes,
            SUM,
        ));
    }
    let (sum, z_b) = (passes.coarse_dots.iter().map(|d| f64::from(*d)).sum::<f64>(), flat(&passes.coarse_rhs));
    let size = dot(&magnitudes(&of_rhs), &magnitudes(&z_b));
    expect_within(&format!("{what}: coarse inner product"), &[sum], &[dot(&of_rhs, &z_b)], &[size], SUM);

    passes.start();
    let norm2 = dot(&b, &twin.preconditioned(&passes, &b));
    // The tolerance, 1e-4, is that of inner products through blocks inverted in f32.
    assert!(
        (f64::from(passes.state.rhs_norm2) - norm2).abs() < 1e-4 * norm2,
        "{what}: b.M^-1 b is {}, expected {norm2}",
        passes.state.rhs_norm2,
    );
    let [f, g] = expect_factors(what, &passes.state, &b, [&x, &trend], [&y, &y_trend]);
    passes.begin();
    let r: Vec<f64> = (0..b.len()).map(|k| b[k] - f * y[k] - g * y_trend[k]).collect();
    let got = passes.unknowns(&passes.residual, |now| now.r);
    let size = largest(&b).max(f.abs() * largest(&y)).max(g.abs() * largest(&y_trend));
    expect_within(&format!("{what}: r"), &got, &r, &vec![size; r.len()], SUM);
    worst = worst.max(expect_preconditioned(&format!("{what}: begin"), &passes, &twin));

    let mut seen = vec![0.0f64; r.len()];
    for round in 0..3 {
        let what = format!("{what}: iteration {round}");
        let (r, u) =
            (passes.unknowns(&passes.residual, |now| now.r), passes.unknowns(&passes.preconditioned, |now| now.u));
        passes.apply(Change::Preconditioned);
        passes.gather(1);
        let w = a.multiply(&u);
        let of_w = absolute.restricted(&vec![largest(&w); w.len()]);
        worst = worst.max(expect_within(
            &format!("{what}: P^T w"),
            &summed(&passes, flat(&passes.restricted_product)),
            &twin.restricted(&w),
            &of_w,
            SUM,
        ));
        // A recurrence gives r, which keeps the rounding errors of the larger values that r had before.
        seen.iter_mut().zip(&r).for_each(|(seen, r)| *seen = r.abs().max(*seen));
        let sizes = absolute.restricted(&seen);
        worst = worst.max(expect_within(
            &format!("{what}: P^T r"),
            &summed(&passes, flat(&passes.restricted_residual)),
            &twin.restricted(&r),
            &sizes,
            SUM,
        ));
        let sums: [f64; 2] = std::array::from_fn(|k| passes.dots.iter().map(|d| f64::from(d[k])).sum());
        let sizes = [(&r, &u), (&w, &u)].map(|(a, b)| dot(&magnitudes(a), &magnitudes(b)));
        expect_within(&format!("{what}: r.u, w.u"), &sums, &[dot(&r, &u), dot(&w, &u)], &sizes, ROUNDS);
        passes.update();
        assert_eq!(
            (passes.state.status, passes.iterations_done()),
            (0, round + 1),
            "{what}: status and number of iterations"
        );
        worst = worst.max(expect_preconditioned(&what, &passes, &twin));
        let s = passes.unknowns(&passes.direction_product, |now| now.s);
        let directions = flat(&passes.restricted_direction);
        let of_s = absolute.restricted(&vec![largest(&s); s.len()]);
        expect_within(&format!("{what}: P^T s"), &summed(&passes, directions), &twin.restricted(&s), &of_s, ROUNDS);
    }

    passes.apply(Change::Start);
    passes.gather(2);
    let x = passes.unknowns(&passes.solution, |now| now.x);
    let y = a.multiply(&x);
    let r: Vec<f64> = b.iter().zip(&y).map(|(b, y)| b - y).collect();
    let of_r = absolute.restricted(&vec![largest(&b).max(largest(&y)); y.len()]);
    expect_within(
        &format!("{what}: P^T (b - A x)"),
        &summed(&passes, flat(&passes.restricted_residual)),
        &twin.restricted(&r),
        &of_r,
        SUM,
    );
    passes.coarse(false);
    let left = flat(&passes.restricted_residual)[..count].to_vec();
    let z = product(&twin.inverse, &left);
    let sizes = product(&absolute.inverse, &magnitudes(&left));
    expect_within(&format!("{what}: A_c^-1 P^T (b - A x)"), &flat(&passes.coarse_rhs), &z, &sizes, SUM);
    let sum: f64 = passes.coarse_dots.iter().map(|d| f64::from(*d)).sum();
    expect_within(
        &format!("{what}: (b - A x)^T P A_c^-1 P^T (b - A x)"),
        &[sum],
        &[dot(&left, &z)],
        &[dot(&magnitudes(&left), &sizes)],
        SUM,
    );
    passes.conclude();
    let norm2 = dot(&r, &twin.preconditioned(&passes, &r));
    let want = (norm2 / f64::from(passes.state.rhs_norm2)).sqrt();
    let got = f64::from(passes.report.residual);
    assert!((got - want).abs() < 1e-3 * want, "{what}: residual {got}, expected {want}");
    worst
}

fn largest(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |m, x| m.max(x.abs()))
}

/// Checks the kernels' u against M^-1 of their r, and u at the nodes attached to dynamic cores. Returns the largest
/// error relative to the size of a value.
fn expect_preconditioned(what: &str, passes: &Passes, twin: &Twin) -> f64 {
    let (r, u) = (passes.unknowns(&passes.residual, |now| now.r), passes.unknowns(&passes.preconditioned, |now| now.u));
    let sizes = twin.sizes(passes, &r);
    let worst = expect_within(&format!("{what}: M^-1 r"), &u, &twin.preconditioned(passes, &r), &sizes, ROUNDS);
    let carried = node_vectors(&passes.system, &u);
    let size = triples(&carried).iter().fold(0.0f64, |m, v| m.max(f64::from(v.abs())));
    let both = [triples(&passes.preconditioned), triples(&carried)].map(|v| wide(&v));
    expect_within(&format!("{what}: u of nodes"), &both[0], &both[1], &vec![size; both[0].len()], 1e-6);
    worst
}

pub fn coarse(bodies: &[Body], seed: u64) -> System {
    System::preconditioned(bodies, AMPLITUDE, seed, Preconditioner::Coarse)
}

#[test]
#[ignore = "long: 9 s"]
fn passes_follow_the_oracle_on_bodies_of_every_kind() {
    let mut worst = 0.0f64;
    for (what, bodies) in kinds() {
        worst = worst.max(follow(what, coarse(&bodies, 5)));
    }
    println!("coarse space: largest error, relative to the sum of the terms' magnitudes, {worst:.1e}");
}

#[test]
#[ignore = "long: 16 s"]
fn passes_follow_the_oracle_with_contacts_and_a_tool() {
    for (what, bodies) in [
        ("two bodies", two_layers()),
        ("a core", two_layers_one_on_a_core()),
        ("a hinge", two_layers_one_on_a_hinge()),
        ("a core of several blocks", vec![large_core(false)]),
    ] {
        follow(&format!("{what}, contacts"), coarse(&bodies, 5).with_contacts(40, 8));
        follow(&format!("{what}, tool"), coarse(&bodies, 5).with_tool().with_contacts(40, 8));
        follow(&format!("{what}, friction"), coarse(&bodies, 5).with_tool().with_friction().with_contacts(40, 8));
    }
}

#[test]
fn one_of_two_bodies_has_a_coarse_level() {
    let system = System::preconditioned(&soft_and_stiff(), AMPLITUDE, 5, Preconditioner::Auto);
    let bodies: Vec<usize> = system.model.coarse.bodies.iter().map(|(body, ..)| *body).collect();
    assert_eq!(
        bodies,
        [1],
        "only body 1 must have a coarse space; index, stiffness number (stiffness over inertia of a node) and number \
         of blocks of each such body: {:?}",
        system.model.coarse.bodies
    );
    follow("one of two bodies", system);
    let system = System::preconditioned(&soft_and_stiff(), AMPLITUDE, 5, Preconditioner::Auto);
    follow("one of two bodies, contacts", system.with_tool().with_contacts(40, 8));
}

#[test]
fn passes_follow_the_oracle_at_every_size() {
    let width = context().reduce_size() as usize;
    for nodes in [0, 1, width - 1, width, width + 1, 1234] {
        let bodies = if nodes == 0 { vec![] } else { vec![turned(layer(nodes))] };
        let system = coarse(&bodies, 6);
        let free = system.model.node_info.iter().filter(|info| info[3] == 0).count();
        assert_eq!(
            system.model.coarse.bodies.is_empty(),
            free == 0,
            "{nodes} nodes: a body with free nodes must have a coarse space, and no other body"
        );
        println!("{nodes} nodes, {free} of them free: {} blocks", system.model.blocks.free);
        if free > 0 {
            follow(&format!("{nodes} nodes"), system);
            // Workgroups of more lanes than a subgroup has sum through shared memory.
            follow_at(&format!("{nodes} nodes, large workgroups"), coarse(&bodies, 6), Size::Group);
        }
    }
}
