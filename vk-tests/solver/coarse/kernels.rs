//! solve/coarse, and what solve/assemble, gather, start, begin and update do for the coarse level, against sums in f64 over
//! the oracle's modes with the inverse that the kernels read.

use faer::Mat;
use glam::{DMat3, DVec3};
use palpate::internal::prepare::Body;
use palpate::scene::Preconditioner;
use palpate_oracle::coarse::MODES;

use super::super::passes::{Change, Passes};
use super::{host_inverse, kinds, large_core, modes_of, product, soft_and_stiff, turned};
use crate::harness::context;
use crate::harness::random::Random;
use crate::solver::system::{System, layer, triples, two_layers, two_layers_one_on_a_core, two_layers_one_on_a_hinge};

/// Sums of f32 products, of the sum of magnitudes: some hundred roundings that mostly cancel.
pub const SUM: f64 = 2.0e-6;
/// The same behind a few iterations, whose P^T r is a recurrence's, and through blocks inverted in f32.
const ROUNDS: f64 = 5.0e-6;
/// m: of cells of 20 mm; blocks of eight nodes turn by some degrees.
const AMPLITUDE: f64 = 0.004;

/// P and what the kernels have as A_c^-1.
pub struct Twin {
    pub p: Mat<f64>,
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

/// Every value within a share of a size of its own; returns the largest share of that taken.
fn expect_within(what: &str, got: &[f64], want: &[f64], sizes: &[f64], share: f64) -> f64 {
    assert_eq!((got.len(), sizes.len()), (want.len(), want.len()), "{what}");
    let mut worst = 0.0f64;
    for (i, (got, want)) in got.iter().zip(want).enumerate() {
        let error = (got - want).abs();
        assert!(error <= share * sizes[i], "{what} [{i}]: got {got:e}, want {want:e}, size {:e}", sizes[i]);
        worst = worst.max(if sizes[i] > 0.0 { error / sizes[i] } else { 0.0 });
    }
    worst
}

impl Twin {
    /// With the blocks turned as solve/assemble found them.
    pub fn new(passes: &Passes) -> Twin {
        let p = modes_of(&passes.system, &passes.block_turns);
        Twin { p, inverse: host_inverse(&passes.system.model, false) }
    }

    fn absolute(&self) -> Twin {
        let of = |m: &Mat<f64>| Mat::from_fn(m.nrows(), m.ncols(), |i, j| m[(i, j)].abs());
        Twin { p: of(&self.p), inverse: of(&self.inverse) }
    }

    /// P^T of a vector over the unknowns.
    fn restricted(&self, x: &[f64]) -> Vec<f64> {
        transposed(&self.p, x)
    }

    /// P A_c^-1 P^T x.
    fn correction(&self, x: &[f64]) -> Vec<f64> {
        product(&self.p, &product(&self.inverse, &self.restricted(x)))
    }

    /// M^-1 x, with the kernels' diagonal blocks.
    fn preconditioned(&self, passes: &Passes, x: &[f64]) -> Vec<f64> {
        self.correction(x).iter().zip(diagonal(passes, x, |x| x)).map(|(z, d)| z + d).collect()
    }

    /// The sums of magnitudes that M^-1 x is made of.
    pub fn sizes(&self, passes: &Passes, x: &[f64]) -> Vec<f64> {
        let x = magnitudes(x);
        self.absolute().correction(&x).iter().zip(diagonal(passes, &x, f64::abs)).map(|(z, d)| z + d).collect()
    }
}

/// D^-1 x, each entry of D^-1 as `of` has it.
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

/// The modes of a core summed over its blocks, which all have its motion: in the first of them.
fn summed(passes: &Passes, mut modes: Vec<f64>) -> Vec<f64> {
    modes.truncate(MODES * passes.blocks());
    for rigid in &passes.rigids[..passes.system.model.cores.len()] {
        let first = rigid.slot_first as usize;
        for slot in first + 1..first + rigid.block_count as usize {
            for k in 0..MODES {
                modes[MODES * first + k] += std::mem::take(&mut modes[MODES * slot + k]);
            }
        }
    }
    modes
}

/// Random unknowns as the device can hold them; what a hinge does not let move is zero. The tool's and the cores' are
/// `rigid` times as large.
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

/// The six numbers of a core or of the tool among the unknowns.
pub fn six(passes: &Passes, index: usize, x: &[f64]) -> [f32; 6] {
    let unknowns = passes.system.twin.unknowns();
    let first = unknowns.cores.get(index).copied().unwrap_or(unknowns.tool);
    std::array::from_fn(|k| x[first + k] as f32)
}

/// Node vectors: of free nodes their own, of carried ones what their core gives them.
pub fn node_vectors(system: &System, x: &[f64]) -> Vec<[f32; 4]> {
    let (bodies, _) = system.rows(x);
    bodies.iter().flat_map(|rows| rows.chunks(3)).map(|v| [v[0] as f32, v[1] as f32, v[2] as f32, 0.0]).collect()
}

/// Without what cores carry.
pub fn only_free(passes: &Passes, mut nodes: Vec<[f32; 4]>) -> Vec<[f32; 4]> {
    nodes.iter_mut().zip(passes.roles()).filter(|(_, role)| *role != Some(0)).for_each(|(x, _)| *x = [0.0; 4]);
    nodes
}

/// The passes of a step on a solution that is no solution, three iterations of it, and its end; each pass against the
/// oracle from what it was given. Returns the largest share of the sizes that an error took.
fn follow(what: &str, system: System) -> f64 {
    let mut passes = Passes::new(system);
    assert!(passes.coarse, "{what}: no coarse level");
    let mut random = Random(7);
    let left = random_unknowns(&passes.system, &mut random, 1.0)
        .iter()
        .map(|x| f64::from(1e-4 * *x as f32))
        .collect::<Vec<_>>();
    let x = random_unknowns(&passes.system, &mut random, 5.0);
    passes.leftover = only_free(&passes, node_vectors(&passes.system, &left));
    passes.solution = node_vectors(&passes.system, &x);
    passes.state.current = 1;
    for index in 0..passes.rigids.len() {
        passes.rigids[index].leftover = six(&passes, index, &left);
        passes.rigid(index).x = six(&passes, index, &x);
    }
    let (a, mut b) = passes.system.twin.assemble(passes.system.device.as_ref(), &passes.system.twin_contacts);
    b.iter_mut().zip(&left).for_each(|(b, left)| *b += left);

    passes.assemble();
    passes.cores();
    let twin = Twin::new(&passes);
    let absolute = twin.absolute();
    let mut worst = 0.0f64;
    // b is made of elastic terms that nearly cancel: of the largest of the kind rather than of its own.
    let of_b = absolute.restricted(&vec![largest(&b); b.len()]);
    worst = worst.max(expect_within(
        &format!("{what}: P^T b"),
        &summed(&passes, flat(&passes.restricted_rhs)),
        &twin.restricted(&b),
        &of_b,
        SUM,
    ));
    passes.apply(Change::Solution);
    passes.gather(0);
    let y = a.multiply(&x);
    let of_y = absolute.restricted(&vec![largest(&y); y.len()]);
    worst = worst.max(expect_within(
        &format!("{what}: P^T A x"),
        &summed(&passes, flat(&passes.restricted_image)),
        &twin.restricted(&y),
        &of_y,
        SUM,
    ));
    assert!(
        passes.restricted_residual[..3 * passes.blocks()].iter().all(|r| *r == [0.0; 4]),
        "{what}: no residual yet"
    );

    passes.coarse(true);
    let count = MODES * passes.blocks();
    let (of_rhs, of_image) =
        (flat(&passes.restricted_rhs)[..count].to_vec(), flat(&passes.restricted_image)[..count].to_vec());
    for (name, got, from) in
        [("A_c^-1 P^T b", &passes.coarse_rhs, &of_rhs), ("A_c^-1 P^T A x", &passes.coarse_image, &of_image)]
    {
        let sizes = product(&absolute.inverse, &magnitudes(from));
        worst = worst.max(expect_within(
            &format!("{what}: {name}"),
            &flat(got),
            &product(&twin.inverse, from),
            &sizes,
            SUM,
        ));
    }
    let dots: [f64; 3] = std::array::from_fn(|k| passes.coarse_dots.iter().map(|d| f64::from(d[k])).sum());
    let (z_b, z_y) = (flat(&passes.coarse_rhs), flat(&passes.coarse_image));
    for (k, (u, v)) in [(&of_rhs, &z_b), (&of_image, &z_b), (&of_image, &z_y)].into_iter().enumerate() {
        let size = dot(&magnitudes(u), &magnitudes(v));
        expect_within(&format!("{what}: inner product {k}"), &dots[k..=k], &[dot(u, v)], &[size], SUM);
    }

    passes.start();
    let (warm, m_b, m_y) =
        (f64::from(passes.state.warm), twin.preconditioned(&passes, &b), twin.preconditioned(&passes, &y));
    let norms = (dot(&b, &m_b), dot(&y, &m_y));
    // Inner products through blocks inverted in f32.
    assert!(
        (f64::from(passes.state.rhs_norm2) - norms.0).abs() < 1e-4 * norms.0,
        "{what}: b.M^-1 b {} for {}",
        passes.state.rhs_norm2,
        norms.0
    );
    let wanted = dot(&y, &m_b) / norms.1;
    assert!((warm - wanted).abs() < 1e-4 * (norms.0 / norms.1).sqrt(), "{what}: warm {warm} for {wanted}");
    passes.begin();
    let r: Vec<f64> = b.iter().zip(&y).map(|(b, y)| b - warm * y).collect();
    let got = passes.unknowns(&passes.residual, |now| now.r);
    let size = largest(&b).max(warm.abs() * largest(&y));
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
            &summed(&passes, flat(&passes.restricted_image)),
            &twin.restricted(&w),
            &of_w,
            SUM,
        ));
        // A recurrence's r keeps the roundings of what it was.
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
        assert_eq!((passes.state.status, passes.iterations_done()), (0, round + 1), "{what}");
        worst = worst.max(expect_preconditioned(&what, &passes, &twin));
        let s = passes.unknowns(&passes.direction_image, |now| now.s);
        let own = passes.state.current as usize * 3 * passes.blocks();
        let directions = flat(&passes.restricted_direction[own..own + 3 * passes.blocks()]);
        let of_s = absolute.restricted(&vec![largest(&s); s.len()]);
        expect_within(&format!("{what}: P^T s"), &summed(&passes, directions), &twin.restricted(&s), &of_s, ROUNDS);
    }

    passes.apply(Change::Solution);
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
    let sum: f64 = passes.coarse_dots.iter().map(|d| f64::from(d[0])).sum();
    expect_within(
        &format!("{what}: its inner product"),
        &[sum],
        &[dot(&left, &z)],
        &[dot(&magnitudes(&left), &sizes)],
        SUM,
    );
    passes.conclude();
    let norm2 = dot(&r, &twin.preconditioned(&passes, &r));
    let want = (norm2 / f64::from(passes.state.rhs_norm2)).sqrt();
    let got = f64::from(passes.report.residual);
    assert!((got - want).abs() < 1e-3 * want, "{what}: residual {got} for {want}");
    worst
}

fn largest(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |m, x| m.max(x.abs()))
}

/// u = M^-1 r, both as the device has them, and what it makes of carried nodes.
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
    println!("errors of up to {worst:.1e} of the sums of magnitudes");
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
    assert_eq!(bodies, [1], "numbers {:?}", system.model.coarse.bodies);
    follow("alone", system);
    let system = System::preconditioned(&soft_and_stiff(), AMPLITUDE, 5, Preconditioner::Auto);
    follow("contacts", system.with_tool().with_contacts(40, 8));
}

#[test]
fn passes_follow_the_oracle_at_every_size() {
    let width = context().reduce_size() as usize;
    for nodes in [0, 1, width - 1, width, width + 1, 1234] {
        let bodies = if nodes == 0 { vec![] } else { vec![turned(layer(nodes))] };
        let system = coarse(&bodies, 6);
        let free = system.model.node_info.iter().filter(|info| info[3] == 0).count();
        assert_eq!(system.model.coarse.bodies.is_empty(), free == 0, "{nodes} nodes");
        println!("{nodes} nodes, {free} of them free: {} blocks", system.model.blocks.free);
        if free > 0 {
            follow(&format!("{nodes} nodes"), system);
        }
    }
}
