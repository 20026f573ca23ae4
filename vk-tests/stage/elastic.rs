//! Tests of kernel elastic/element_forces, by hand and against the f64 oracle (reference implementation): the rotation
//! of each tetrahedron, its rotated gradients, and its part of the right-hand side.

use glam::{DMat3, DQuat, DVec3};
use palpate::Flags;
use palpate::internal::gpu::Const;
use palpate::internal::prepare::{Layer, Materials};
use palpate::internal::shaders::{Counts, GRADIENT_TEXELS, NODE_FREE};
use palpate::internal::stages::material_law::{has, laws_of};
use palpate::scene::MaterialLaw;
use palpate_oracle::compression::Penalty;
use palpate_oracle::elastic::{lame, outer, polar_rotation, strain};

use crate::harness::random::Random;
use crate::harness::{CANARY, Outcome, Tolerance, case, context, expect_close};
use crate::solver::system::{DT, System, layer, layered, material};

/// Error of a rotation, rad. The deformation gradient F is known to 1e-7 in f32, the polar rotation magnifies this
/// error by one over the sum of the two least singular values (above 0.2 here), and the iteration ends within 1e-7 of
/// its limit.
const ANGLE: f64 = 2.0e-6;
/// Error of an inverted tetrahedron's rotation from a cold start, rad: each of 40 iterations leaves up to 0.85 of the
/// error, and in tetrahedra that start nearly half a turn away the error hardly falls in the first iterations.
const INVERTED_FROM_AFAR: f64 = 5.0e-2;
/// Error up to which a rotation counts as found, rad. The kernel counts a rotation as converged where an iteration
/// turns it by less than a bound; this is that bound, divided by the share of the error that the slowest iterations
/// here remove.
const FOUND: f64 = 2.0e-3;
/// Error of gradients relative to the largest value: they are a dozen roundings away from the input.
const GRADIENT: f64 = 1.0e-6;
/// Error of gradients relative to the largest value where they are those of the deformed tetrahedron (neo-Hookean):
/// they contain the inverse of the stretch, and the stretch is known to 1e-7 and is at least a third.
const FOLDED: f64 = 5.0e-6;
/// Error of a strain in f32 for stretches up to two. Where the compression penalty's modulus rises, the modulus has this
/// error times its slope over the strain.
const STRAIN: f64 = 2.0e-7;
/// Error of forces relative to the largest value: strains of order one tenth come from terms of order one, known to
/// 1e-7.
const FORCE: f64 = 1.0e-5;
/// Error of the geometric stiffness relative to the largest value: it is made of stresses, whose error is [`FORCE`], and
/// a root of a polynomial, which is less well known where two eigenvalues nearly agree.
const GEOMETRIC: f64 = 5.0e-5;
/// Error of forces relative to the largest value at strains of 1e-6; strains that are differences of numbers of order
/// one would give 1e-1 at best.
const TINY_STRAIN: f64 = 5.0e-6;

/// Runs elastic/element_forces over a whole system. `patch_of` has the F-bar patch of each tetrahedron (the group with
/// which it shares its volumetric strain) or `NONE`, and is empty without patches.
pub fn rotate(system: &System, patch_of: &[u32]) -> Outcome {
    // The kernel works on all tetrahedra here, also on those that a step leaves out, since they cannot deform.
    let all: Vec<_> = (0..system.model.tetrahedra.len()).collect();
    rotate_some(system, patch_of, &all)
}

/// As [`rotate`], for some of the tetrahedra.
fn rotate_some(system: &System, patch_of: &[u32], some: &[usize]) -> Outcome {
    let tetrahedra = system.model.tetrahedra.len();
    let listed = |t: &usize| {
        let [material, frame] = system.model.element_info[*t];
        [*t as u32, material, frame, 0]
    };
    let deforming: Vec<[u32; 4]> = some.iter().map(listed).collect();
    case("elastic/element_forces")
        .constant("ELEMENTS", some.len() as u32)
        .constant("SPANS", Const::Bool(system.model.spans_frames()))
        .constant("PATCHES", Const::Bool(!patch_of.is_empty()))
        .constant("LAWS", laws_of(&system.model.materials))
        .constant("NEWTON", Const::Bool(!system.trial_change.is_empty()))
        .input("params", &[system.params])
        .input("frames", &system.frames)
        .input("materials", &system.model.materials)
        .input("tetrahedra", &system.model.tetrahedra)
        .input("rest_gradients", &system.model.rest_gradients)
        .input("deforming", &deforming)
        .input("displacement", &system.displacement)
        .input("velocity", &system.velocity)
        .input("tetrahedron_links", &system.model.tetrahedron_links)
        .input("node_rest", &system.model.node_rest)
        .input("links", &system.links)
        .input("patch_of", if patch_of.is_empty() { &[0] } else { patch_of })
        .input("trial_change", system.trial())
        .inout("rotations", &system.rotations)
        .partial("gradients", &unwritten(GRADIENT_TEXELS as usize * tetrahedra))
        .inout("counts", &[system.counts])
        .partial("element_forces", &unwritten(4 * tetrahedra))
        .elements(some.len())
        .run()
}

/// `count` tetrahedra that share no node.
pub fn scattered(count: usize, random: &mut Random) -> Layer {
    let mut layer = Layer::default();
    for t in 0..count as u32 {
        let centre = 0.1 * random.vector();
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
        layer.nodes.extend(corners.map(|x| centre + 0.02 * (x + 0.2 * random.vector())));
        layer.tetrahedra.push(std::array::from_fn(|k| 4 * t + k as u32));
    }
    layer.attached = vec![false; layer.nodes.len()];
    layer
}

/// Scattered tetrahedra with the deformation gradients that `deform` gives, and without velocity.
fn deformed(count: usize, seed: u64, deform: impl FnMut(&mut Random) -> DMat3) -> System {
    deformed_of(&material(2e4).into(), count, seed, deform)
}

/// Scattered tetrahedra of these materials with the deformation gradients that `deform` gives, and without velocity.
pub fn deformed_of(
    materials: &Materials,
    count: usize,
    seed: u64,
    mut deform: impl FnMut(&mut Random) -> DMat3,
) -> System {
    let mut random = Random(seed);
    let layer = scattered(count, &mut random);
    let nodes = layer.nodes.clone();
    let bodies = if count == 0 { vec![] } else { vec![layered(layer, materials, random.turn(2.5))] };
    let mut system = System::new(&bodies, 0.0, seed);
    system.velocity.fill([0.0; 4]);
    for (x, d) in nodes.chunks(4).zip(system.displacement.chunks_mut(4)) {
        let gradient = deform(&mut random) - DMat3::IDENTITY;
        for k in 0..4 {
            let moved = (gradient * (x[k] - x[0])).as_vec3();
            d[k] = [moved.x, moved.y, moved.z, 0.0];
        }
    }
    sync(&mut system);
    system
}

/// Copies displacements and velocities of the system to the oracle.
pub fn sync(system: &mut System) {
    let wide = |x: &[f32; 4]| DVec3::new(x[0].into(), x[1].into(), x[2].into());
    for body in &mut system.twin.bodies {
        body.displacement = system.displacement.iter().map(wide).collect();
        body.velocity = system.velocity.iter().map(wide).collect();
    }
}

/// The product R S of a rotation R and a stretch S along random axes with singular values from `least` to 1.4.
pub fn stretched(rotation: DQuat, least: f64, random: &mut Random) -> DMat3 {
    let axes = DMat3::from_quat(random.turn(2.5));
    let middle = 1.0 + 0.15 * random.next();
    let stretch = DMat3::from_diagonal(DVec3::new(1.3 + 0.1 * random.next(), middle, least));
    DMat3::from_quat(rotation) * axes * stretch * axes.transpose()
}

/// The angle between two rotations, rad, whatever the signs of their quaternions.
fn angle(a: DQuat, b: DQuat) -> f64 {
    let between = a.normalize().conjugate() * b.normalize();
    2.0 * between.xyz().length().asin()
}

fn quaternions(system: &System) -> Vec<DQuat> {
    system.rotations.iter().map(|q| DQuat::from_array(q.map(f64::from))).collect()
}

/// Compares rotations with the oracle's polar rotations, and gradients and forces with those that the oracle computes
/// at the rotations that the kernel found.
pub fn expect_oracle(what: &str, system: &System, force: f64) {
    let found = quaternions(system);
    let Some(body) = system.twin.bodies.first() else { return assert!(found.is_empty()) };
    for (t, (q, want)) in found.iter().zip(body.elements.rotations(&body.displacement)).enumerate() {
        assert!((q.length() - 1.0).abs() < 1e-6, "{what}, tetrahedron {t}: {q} is no unit quaternion");
        assert!(angle(*q, want) < ANGLE, "{what}, tetrahedron {t}: {q} is {:e} rad from {want}", angle(*q, want));
    }
    expect_gradients(what, system);
    let h = system.twin.dt;
    let change = system.trial_change_of(0);
    let elements = body.elements.linearised(&body.displacement, &found);
    let want = elements.impulses(&body.displacement, &found, &body.velocity, change.as_deref(), h);
    let want: Vec<f64> = want.iter().flat_map(|f| f.to_array()).collect();
    let got = &system.element_forces[..system.element_forces.len() - 4];
    expect_of_largest(&format!("{what}: forces"), &crate::solver::system::triples(got), &want, force);
}

fn expect_gradients(what: &str, system: &System) {
    let body = &system.twin.bodies[0];
    let h = system.twin.dt;
    let share = if has(&system.model.materials, MaterialLaw::NeoHookean) { FOLDED } else { GRADIENT };
    let (mut got, mut want, mut traces, mut stiff) = (vec![], vec![], (vec![], vec![]), (vec![], vec![]));
    let operators = body.elements.linearised(&body.displacement, &quaternions(system)).operators;
    for (t, q) in quaternions(system).iter().enumerate() {
        let operator = &operators[t];
        let turn =
            body.elements.frame * DMat3::from_quat(q.normalize()) * operator.fold * body.elements.volumes[t].sqrt();
        let [h1, h2, h3, diagonal, off] = system.gradients[5 * t..5 * t + 5] else { panic!("five vectors") };
        got.extend([h1, h2, h3].iter().flat_map(|g| [g[0], g[1], g[2]]));
        let world = body.elements.frame * DMat3::from_quat(q.normalize());
        let z = world * operator.geometric * world.transpose() * (0.25 * h * h);
        stiff.0.extend([diagonal, off].iter().flat_map(|z| [z[0], z[1], z[2]]));
        stiff.1.extend([z.x_axis.x, z.y_axis.y, z.z_axis.z, z.x_axis.y, z.x_axis.z, z.y_axis.z]);
        want.extend(body.elements.gradients[t][1..].iter().flat_map(|g| (turn * *g).to_array()));
        let scale = h * (h + body.elements.materials[t].damping_stiffness);
        let moduli = [scale * operator.mu, scale * operator.lambda];
        let e = strain(q.normalize(), body.elements.gradient(t, &body.displacement));
        let penalty = Penalty::new(lame(&body.elements.materials[t]), e);
        let abs = moduli[0] * share + scale * penalty.modulus_slope() * STRAIN;
        expect_close("moduli", &[h1[3], h2[3]], &moduli, Tolerance { abs, rel: share });
        traces.0.push(h3[3]);
        traces.1.push(e.x_axis.x + e.y_axis.y + e.z_axis.z);
    }
    expect_of_largest(&format!("{what}: gradients"), &got, &want, share);
    expect_of_largest(&format!("{what}: trace of the strain"), &traces.0, &traces.1, FORCE);
    expect_of_largest(&format!("{what}: geometric stiffness"), &stiff.0, &stiff.1, GEOMETRIC);
}

/// Checks that the error of every value is at most `share` times the largest wanted value.
pub fn expect_of_largest(what: &str, got: &[f32], want: &[f64], share: f64) {
    let largest = want.iter().fold(0.0f64, |m, w| m.max(w.abs()));
    expect_close(what, got, want, Tolerance { abs: share * largest, rel: 0.0 });
}

#[test]
fn a_tetrahedron_stretched_along_an_edge_by_hand() {
    // elastic/element_forces on a tetrahedron at the corner of a cube with edges of 1 m, whose second node is displaced
    // by (0.01, 0, 0) m: strain E = diag(0.01, 0, 0), stress P = 2 mu E + 0.01 lambda I, volume V = 1/6.
    let nodes = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
    let layer = Layer { nodes, tetrahedra: vec![[0, 1, 2, 3]], attached: vec![false; 4], ..Layer::default() };
    let mut system = System::new(&[layered(layer, material(2e4), DQuat::IDENTITY)], 0.0, 1);
    system.velocity.fill([0.0; 4]);
    system.displacement[1] = [0.01, 0.0, 0.0, 0.0];
    system.rotate();
    assert_eq!(system.rotations, [[0.0, 0.0, 0.0, 1.0]]);
    let (mu, lambda) = (2e4 / 2.9, 2e4 * 0.45 / (1.45 * 0.1));
    let h = f64::from(DT);
    let (along, across) = (h * 0.01 / 6.0 * (2.0 * mu + lambda), h * 0.01 / 6.0 * lambda);
    let want = [along, across, across, -along, 0.0, 0.0, 0.0, -across, 0.0, 0.0, 0.0, -across];
    expect_of_largest("forces", &crate::solver::system::triples(&system.element_forces[..4]), &want, GRADIENT);
    let root = (1.0f64 / 6.0).sqrt();
    let want = [root, 0.0, 0.0, 0.0, root, 0.0, 0.0, 0.0, root];
    expect_of_largest("gradients", &crate::solver::system::triples(&system.gradients[..3]), &want, GRADIENT);
}

#[test]
fn rotations_and_forces_agree_with_the_oracle_at_every_size() {
    let width = context().group_size() as usize;
    for count in [0, 1, width - 1, width, width + 1, 1234] {
        let mut system = deformed(count, 7, |random| {
            let turn = DQuat::from_scaled_axis(0.5 * random.vector());
            stretched(turn, 0.8 + 0.1 * random.next(), random)
        });
        let mut random = Random(8);
        let velocity = system.random_field(&mut random);
        system.velocity = velocity.iter().map(|v| v.map(|x| 0.1 * x)).collect();
        sync(&mut system);
        system.rotate();
        expect_oracle(&format!("{count} tetrahedra"), &system, FORCE);
        system.trial_change = system.random_field(&mut random).iter().map(|v| v.map(|x| 0.1 * x)).collect();
        system.rotate();
        expect_oracle(&format!("{count} tetrahedra, linearised at a trial change of velocity"), &system, FORCE);
    }
}

#[test]
fn tetrahedra_that_are_not_listed_stay_as_they_are() {
    // Every third tetrahedron is left out, and the others are listed in reverse order.
    let mut system = deformed(100, 17, |random| stretched(DQuat::from_rotation_y(0.3), 0.8, random));
    system.rotations.fill([0.0, 0.0, 0.0, 1.0]);
    let some: Vec<usize> = (0..100).rev().filter(|t| t % 3 != 1).collect();
    let (whole, part) = (rotate(&system, &[]), rotate_some(&system, &[], &some));
    let mut kept = 0;
    for (name, width, before) in [
        ("rotations", 1, bits(&system.rotations)),
        ("gradients", GRADIENT_TEXELS as usize, bits(&unwritten(100 * GRADIENT_TEXELS as usize))),
        ("element_forces", 4, bits(&unwritten(400))),
    ] {
        let (whole, part) = (bits(&whole.get::<[f32; 4]>(name)), bits(&part.get::<[f32; 4]>(name)));
        for t in 0..100 {
            let own = 4 * width * t..4 * width * (t + 1);
            let want = if t % 3 == 1 { &before } else { &whole };
            assert_eq!(part[own.clone()], want[own.clone()], "{name} of tetrahedron {t}");
            kept += usize::from(whole[own.clone()] != before[own]);
        }
    }
    assert_eq!(kept, 300, "every tetrahedron changes its numbers where it is listed");
    // The model lists what has a free node: all but the tetrahedra within a core.
    let mut bound = layer(60);
    let core = bound.tetrahedra[7];
    core.iter().for_each(|node| bound.attached[*node as usize] = true);
    let layers = System::new(&[layered(bound, material(2e4), DQuat::IDENTITY)], 0.004, 1);
    let rigid = |t: &[u32; 4]| t.iter().all(|node| layers.model.node_info[*node as usize][3] != NODE_FREE);
    let listed: Vec<usize> = layers.model.deforming.iter().map(|element| element[0] as usize).collect();
    let want: Vec<usize> =
        (0..layers.model.tetrahedra.len()).filter(|t| !rigid(&layers.model.tetrahedra[*t])).collect();
    assert_eq!(listed, want, "the model lists the tetrahedra that have a free node");
    assert!(want.len() < layers.model.tetrahedra.len(), "some tetrahedra lie within the core");
}

fn unwritten(count: usize) -> Vec<[f32; 4]> {
    vec![[f32::from_bits(CANARY); 4]; count]
}

fn bits(texels: &[[f32; 4]]) -> Vec<u32> {
    texels.iter().flatten().map(|x| x.to_bits()).collect()
}

#[test]
fn far_rotations_are_found_from_a_cold_and_a_warm_start() {
    // elastic/element_forces from the identity, for turns up to just below half a turn; at a third of a turn the trace
    // of the rotation is zero.
    let turns = [0.1, 1.0, 1.5, 2.0, 2.0 * std::f64::consts::FRAC_PI_3, 2.5, 3.0, 3.1, 3.13];
    let mut k = 0;
    let mut system = deformed(40 * turns.len(), 11, |random| {
        k += 1;
        let turn = DQuat::from_axis_angle(random.vector().normalize(), turns[k % turns.len()]);
        stretched(turn, 0.9, random)
    });
    system.rotate();
    expect_oracle("from the identity", &system, FORCE);
    // Warm starts follow: from the rotations that were found, and from rotations some way off.
    system.rotate();
    expect_oracle("from the rotations found", &system, FORCE);
    let mut random = Random(12);
    for q in &mut system.rotations {
        let off = DQuat::from_scaled_axis(0.5 * random.vector()) * DQuat::from_array(q.map(f64::from));
        *q = off.normalize().as_quat().to_array();
    }
    system.rotate();
    expect_oracle("from rotations off by up to 0.5 rad an axis", &system, FORCE);
}

#[test]
fn inverted_tetrahedra_keep_proper_rotations() {
    // elastic/element_forces where det F < 0: the rotation is the proper one, which flips the direction of least
    // stretch. With singular values s1 >= s2 >= s3 an iteration leaves s1 / (s1 + s2 + s3) of the error, here up to
    // 0.85: the kernel's first run comes near the rotation, and a few more runs reach it.
    let mut system = deformed(500, 13, |random| {
        let turn = random.turn(2.5);
        stretched(turn, -0.35 + 0.25 * random.next(), random)
    });
    let body = &system.twin.bodies[0];
    let want = body.elements.rotations(&body.displacement);
    system.rotate();
    for (t, (q, want)) in quaternions(&system).iter().zip(want).enumerate() {
        assert!(angle(*q, want) < INVERTED_FROM_AFAR, "tetrahedron {t}: {q} is {:e} rad from {want}", angle(*q, want));
    }
    for _ in 0..4 {
        system.rotate();
    }
    expect_oracle("after five runs", &system, FORCE);
}

/// The flags that the kernel leaves if it starts from the system's flags.
fn flags_of(system: &System) -> Flags {
    Flags(rotate(system, &[]).get::<Counts>("counts")[0].flags)
}

#[test]
fn one_that_is_inside_out_raises_a_flag_beside_others() {
    for (least, is_inverted) in [(0.01, false), (-0.01, true)] {
        let mut t = 0;
        let mut system = deformed(500, 13, |random| {
            t += 1;
            stretched(DQuat::IDENTITY, if t == 317 { least } else { 0.8 }, random)
        });
        let body = &system.twin.bodies[0];
        let gradients = (0..500).map(|e| DMat3::IDENTITY + body.elements.gradient(e, &body.displacement));
        assert_eq!(gradients.filter(|f| f.determinant() <= 0.0).count(), usize::from(is_inverted));
        system.counts.flags = Flags::DEPTH_BEYOND_LIMIT.0;
        let want = if is_inverted { Flags::INVERTED } else { Flags::default() } | Flags::DEPTH_BEYOND_LIMIT;
        assert_eq!(flags_of(&system), want, "flags for a least stretch of {least}");
    }
}

#[test]
fn a_rotation_that_is_not_found_raises_a_flag_until_it_is() {
    // elastic/element_forces on tetrahedra pressed to needles and turned: an iteration leaves 0.987 of the error of the
    // turn about the needle.
    let mut system = deformed(100, 29, |random| {
        let axes = DMat3::from_quat(random.turn(2.5));
        let turn = DMat3::from_quat(DQuat::from_scaled_axis(0.5 * random.vector()));
        turn * axes * DMat3::from_diagonal(DVec3::new(3.0, 0.02, 0.02)) * axes.transpose()
    });
    let body = &system.twin.bodies[0];
    let wanted = body.elements.rotations(&body.displacement);
    let mut flagged = 0;
    for step in 0..60 {
        let flags = flags_of(&system);
        system.rotate();
        let off = quaternions(&system).iter().zip(&wanted).map(|(q, want)| angle(*q, *want)).fold(0.0, f64::max);
        assert!(step > 0 || off > FOUND, "the first rotations are only {off:e} rad off");
        assert!(
            flags == Flags::INVERTED || off < FOUND,
            "step {step}: a rotation is {off:e} rad off, and there is no flag"
        );
        flagged += usize::from(flags == Flags::INVERTED);
    }
    assert!((1..50).contains(&flagged), "{flagged} of 60 steps have a flag");
}

#[test]
fn tiny_strains_keep_their_digits() {
    // elastic/element_forces at strains and turns of 1e-6.
    let mut system = deformed(300, 17, |random| {
        let g = DMat3::from_cols(random.vector(), random.vector(), random.vector());
        DMat3::IDENTITY + 1e-6 * g
    });
    system.rotate();
    expect_oracle("tiny strains", &system, TINY_STRAIN);
}

#[test]
fn rigid_motions_give_no_force_and_forces_balance() {
    // elastic/element_forces: a rotated tetrahedron has no more force than rounding of its strain gives; forces sum to
    // zero; a rigid spin of the whole body (v = w x x) causes no damping force.
    let spin = DVec3::new(3.0, -2.0, 1.0);
    let mut system = deformed(300, 19, |random| DMat3::from_quat(random.turn(2.5)));
    let body = &system.twin.bodies[0];
    let place = |(x, d): (&DVec3, &DVec3)| spin.cross(body.elements.frame * (*x + *d)).as_vec3();
    let twist = body.layer.nodes.iter().zip(&body.displacement).map(place);
    system.velocity = twist.map(|v| [v.x, v.y, v.z, 0.0]).collect();
    system.rotate();
    let body = &system.twin.bodies[0];
    let (h, (mu, lambda)) = (system.twin.dt, lame(&body.elements.materials[0]));
    let unit: Vec<f64> = (0..300)
        .map(|t| h * body.elements.volumes[t] * (2.0 * mu + lambda) * body.elements.gradients[t][1].length())
        .collect();
    for (t, forces) in system.element_forces[..1200].chunks(4).enumerate() {
        let size = crate::solver::system::triples(forces).iter().fold(0.0f32, |m, x| m.max(x.abs()));
        assert!(
            f64::from(size) < FORCE * unit[t],
            "tetrahedron {t}: force {size:e}; a strain of one would give {:e}",
            unit[t]
        );
    }
    // With the tetrahedra deformed, the four forces of each tetrahedron must balance.
    system.displacement.iter_mut().for_each(|d| d[0] *= 1.3);
    system.rotate();
    for forces in system.element_forces[..1200].chunks(4) {
        let sum: DVec3 = forces.iter().map(|f| DVec3::new(f[0].into(), f[1].into(), f[2].into())).sum();
        let size: f64 = forces.iter().map(|f| f64::from(f[0].abs() + f[1].abs() + f[2].abs())).sum();
        assert!(sum.length() < 1e-6 * size, "the forces of a tetrahedron sum to {sum}");
    }
}

#[test]
fn the_oracles_polar_rotation_is_one() {
    // The other tests rely on the oracle's polar rotation R of F: R^T F is symmetric, and R is proper.
    let mut random = Random(23);
    for _ in 0..100 {
        let least = random.next();
        let f = stretched(random.turn(2.5), least, &mut random);
        let rest = DMat3::from_quat(polar_rotation(f)).transpose() * f;
        let skew = rest - rest.transpose();
        assert!(skew.to_cols_array().iter().all(|x| x.abs() < 1e-12), "antisymmetric part of R^T F: {skew}");
    }
    assert_eq!(outer(DVec3::X, DVec3::Y).y_axis, DVec3::X);
}

#[test]
fn a_law_that_is_not_known_is_no_number() {
    let mut system = deformed(3, 5, |random| stretched(random.turn(1.0), 0.7, random));
    system.model.materials[0].law = 9;
    let outcome = rotate(&system, &[]);
    let forces = outcome.get::<[f32; 4]>("element_forces");
    assert!(forces.iter().all(|f| f[..3].iter().all(|x| x.is_nan())), "forces must be NaN: {forces:?}");
    let gradients = outcome.get::<[f32; 4]>("gradients");
    assert!(gradients.iter().all(|g| g[0].is_nan()), "gradients must be NaN: {gradients:?}");
}
