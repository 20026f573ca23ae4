//! Tests of the kernels cull/pairs, which lists the pairs of collision proxies (convex hulls) that may touch, and
//! cull/direction, which finds the normal that separates a pair best and sums the pushes (depth times area times
//! normal) of the pair's contacts in the last step.

use bytemuck::Zeroable;
use glam::{DQuat, DVec3};
use palpate::internal::prepare::hull::{self, Hull};
use palpate::internal::shaders;
use palpate::internal::shaders::{Counts, NONE, Proxy, ProxyBounds};
use palpate::internal::stages::ARGS_WORDS;
use palpate_oracle::{cull as exact, proximity};

use crate::harness::bodies::sphere;
use crate::harness::random::Random;
use crate::harness::{Outcome, Tolerance, case, context, expect_close};

/// Error of a gap, m: f32 positions of order one are known to 1e-7, and a gap is the difference of two positions after
/// a few iterations (GJK).
const GAP: f64 = 2e-6;
/// Error of a separation along a face normal, m: one difference of dot products of unit normals with points of order
/// one.
const SEPARATION: f64 = 1e-6;
/// Error of a direction, a blend of face normals: blending weights change by the error of the separation over the width
/// of the blend, which is some 0.05 m here.
const DIRECTION: Tolerance = Tolerance { abs: 1e-4, rel: 0.0 };
/// Error of a direction's weight, (reach - separation)^2, which is near one; the reach is the gap up to which a pair
/// may touch.
const WEIGHT: Tolerance = Tolerance { abs: 1e-6, rel: 1e-5 };
/// How far a skin (surface mesh) may lie outside its hull, m.
const INFLATION: f32 = 0.05;

/// Hulls of two bodies in the arrays that the kernels read, the hulls of the first body before those of the second
/// body.
#[derive(Default)]
struct Hulls {
    points: Vec<Vec<DVec3>>,
    planes: Vec<Vec<(DVec3, f64)>>,
    proxies: Vec<Proxy>,
    bounds: Vec<ProxyBounds>,
    hull: Vec<[f32; 4]>,
    faces: Vec<[f32; 4]>,
}

fn texel(x: DVec3, w: f64) -> [f32; 4] {
    [x.x as f32, x.y as f32, x.z as f32, w as f32]
}

fn f64s(x: &[f32; 4]) -> DVec3 {
    DVec3::new(x[0].into(), x[1].into(), x[2].into())
}

impl Hulls {
    /// Adds a hull, rounded to f32 so that the oracle has the same points.
    fn add(&mut self, hull: &Hull, turn: DQuat, place: DVec3) {
        let points: Vec<[f32; 4]> = hull.vertices.iter().map(|x| texel(turn * *x + place, 0.0)).collect();
        let faces: Vec<[f32; 4]> = hull
            .faces
            .iter()
            .map(|(n, d)| {
                let normal = turn * *n;
                texel(normal, d + normal.dot(place))
            })
            .collect();
        let own: Vec<DVec3> = points.iter().map(f64s).collect();
        let bounds = proximity::bounds(&own, 0.0, 0.0, &[]);
        self.bounds.push(ProxyBounds {
            low: bounds.low.as_vec3().to_array(),
            inflation: INFLATION,
            high: bounds.high.as_vec3().to_array(),
            radius: (0.5 * (bounds.high - bounds.low).length()) as f32,
        });
        self.proxies.push(Proxy {
            hull_first: self.hull.len() as u32,
            hull_count: points.len() as u32,
            face_first: self.faces.len() as u32,
            face_count: faces.len() as u32,
            ..Proxy::zeroed()
        });
        self.points.push(own);
        self.planes.push(faces.iter().map(|f| (f64s(f), f64::from(f[3]))).collect());
        self.hull.extend(points);
        self.faces.extend(faces);
    }

    /// Moves a hull and rounds its points to f32 at their new places.
    fn shift(&mut self, i: usize, by: DVec3) {
        let first = self.proxies[i].hull_first as usize;
        for (k, point) in self.points[i].iter_mut().enumerate() {
            self.hull[first + k] = texel(*point + by, 0.0);
            *point = f64s(&self.hull[first + k]);
        }
        let bounds = proximity::bounds(&self.points[i], 0.0, 0.0, &[]);
        self.bounds[i].low = bounds.low.as_vec3().to_array();
        self.bounds[i].high = bounds.high.as_vec3().to_array();
    }

    /// Exchanges a hull with the first one.
    fn swap_first(&mut self, i: usize) {
        self.points.swap(0, i);
        self.planes.swap(0, i);
        self.proxies.swap(0, i);
        self.bounds.swap(0, i);
    }
}

/// A cube of unit edge about the origin.
fn cube() -> Hull {
    let corner = |k: usize| DVec3::from_array([k & 1, k >> 1 & 1, k >> 2].map(|bit| bit as f64 - 0.5));
    hull::convex(&(0..8).map(corner).collect::<Vec<_>>()).unwrap()
}

/// Hulls of boxes, plates, needles, balls and random points, in general position.
fn mixed(random: &mut Random, count: usize, spread: f64) -> Hulls {
    let mut hulls = Hulls::default();
    for i in 0..count {
        let squash = [DVec3::ONE, DVec3::new(1.0, 0.02, 1.0), DVec3::new(0.05, 0.05, 1.5)][i % 3];
        let points: Vec<DVec3> = match i % 4 {
            0 | 1 => cube().vertices,
            2 => sphere(0.5, 2).0,
            _ => (0..20).map(|_| 0.5 * random.vector()).collect(),
        };
        let points: Vec<DVec3> = points.iter().map(|x| *x * squash).collect();
        let hull = hull::reduced(&points).unwrap();
        let (turn, place) = (random.turn(3.0), spread * random.vector());
        hulls.add(&hull, turn, place);
    }
    hulls
}

/// Reach, the gap up to which a pair may touch: the inflations of both hulls together, m.
const REACH: f64 = 0.1;
/// Number of pairs that a workgroup handles.
const SHARE: usize = 64;

/// Runs cull/pairs on `n` pairs. A pair consists of one of the first `a_count` proxies and one of the other proxies.
fn test_pairs(hulls: &Hulls, a_count: usize, n: usize) -> (Outcome, Vec<[u32; 4]>) {
    let b_count = hulls.proxies.len() - a_count;
    let all = (0..a_count as u32).flat_map(|a| (0..b_count as u32).map(move |b| [a, a_count as u32 + b, 0, 0]));
    let proxy_pairs: Vec<[u32; 4]> = all.take(n).collect();
    assert_eq!(proxy_pairs.len(), n);
    let bound = if n == 0 { vec![[0; 4]] } else { proxy_pairs.clone() };
    // The kernel adds to the reach 2 % of the smaller hull's radius; with radius 0 the reach is the sum of the
    // inflations alone.
    let unseamed: Vec<ProxyBounds> = hulls.bounds.iter().map(|b| ProxyBounds { radius: 0.0, ..*b }).collect();
    let out = case("cull/pairs")
        .size(palpate::internal::gpu::Size::Reduce)
        .constant("PROXY_PAIRS", n as u32)
        .constant("SHARE", SHARE as u32)
        .input("proxies", &hulls.proxies)
        .input("bounds", &unseamed)
        .input("proxy_pairs", &bound)
        .input("hull", &hulls.hull)
        .partial("active_pairs", &vec![NONE; n])
        .partial("reach_of", &vec![[-1.0f32; 2]; n])
        .partial("directions", &vec![[5.0f32; 4]; 2 * n])
        .inout("args", &vec![0u32; ARGS_WORDS])
        .groups(n.div_ceil(SHARE))
        .run();
    (out, proxy_pairs)
}

#[test]
fn two_cubes_by_hand() {
    // The cases are: gaps of 0.09 m and 0.11 m, below and above the reach of 0.1 m; an overlap; and cubes that are
    // apart at a corner though their boxes overlap.
    let quarter = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_4);
    for (turn, place, near) in [
        (DQuat::IDENTITY, DVec3::X * 1.09, true),
        (DQuat::IDENTITY, DVec3::X * 1.11, false),
        (DQuat::IDENTITY, DVec3::splat(0.3), true),
        (quarter, DVec3::new(1.2071 + 0.09, 0.0, 0.0), true),
        (quarter, DVec3::new(1.2071 + 0.11, 0.0, 0.0), false),
        (quarter, DVec3::new(0.97, 0.97, 0.0), false),
    ] {
        let mut hulls = Hulls::default();
        hulls.add(&cube(), DQuat::IDENTITY, DVec3::ZERO);
        hulls.add(&cube(), turn, place);
        let (out, _) = test_pairs(&hulls, 1, 1);
        assert_eq!(
            out.get::<u32>("active_pairs"),
            [if near { 0 } else { NONE }],
            "active pairs with the second cube at {place}"
        );
        assert_eq!(out.get::<u32>("args")[3 * shaders::ARGS_DIRECTION as usize], u32::from(near));
        let [reach, gap] = out.get::<[f32; 2]>("reach_of")[0].map(f64::from);
        assert!((reach - if near { REACH } else { -1.0 }).abs() < 1e-7, "reach {reach} m");
        // Two of the three near pairs have a gap of 0.09 m; in the third the cubes overlap.
        assert!(
            !near || (gap - 0.09).abs() < 1e-4 || (gap <= 0.0 && place == DVec3::splat(0.3)),
            "gap {gap} m, expected 0.09 m or an overlap"
        );
        assert_eq!(
            out.get::<[f32; 4]>("directions"),
            [[0.0; 4], [5.0; 4]],
            "cull/pairs must clear the direction and leave the push"
        );
    }
}

#[test]
fn no_pair_within_reach_is_missed_and_none_beyond_it_is_kept() {
    let mut random = Random(31);
    let (mut near, mut far) = (0, 0);
    for n in [0, 1, SHARE - 1, SHARE, SHARE + 1, 1234] {
        let hulls = mixed(&mut random, 72, 1.5);
        let (out, pairs) = test_pairs(&hulls, 36, n);
        let mut kept: Vec<u32> = out.get("active_pairs");
        kept.retain(|i| *i != NONE);
        kept.sort_unstable();
        assert_eq!(out.get::<u32>("args")[3 * shaders::ARGS_DIRECTION as usize] as usize, kept.len());
        for (i, [a, b, ..]) in pairs.iter().enumerate() {
            let (a, b) = (&hulls.points[*a as usize], &hulls.points[*b as usize]);
            let is_kept = kept.binary_search(&(i as u32)).is_ok();
            if proximity::pairs(a, b, REACH - GAP).expect("parry3d finds the distance of two hulls") {
                assert!(is_kept, "pair {i} is missed; normal, distance {:?}", exact::exact_distance(a, b));
                near += 1;
            } else if !proximity::pairs(a, b, REACH + GAP).expect("parry3d finds the distance of two hulls") {
                assert!(!is_kept, "pair {i} is kept; normal, distance {:?}", exact::exact_distance(a, b));
                far += 1;
            }
        }
        let reach: Vec<[f32; 2]> = out.get("reach_of");
        for i in kept {
            let [a, b, ..] = pairs[i as usize].map(|p| p as usize);
            let gap = exact::exact_distance(&hulls.points[a], &hulls.points[b])
                .expect("parry3d finds the distance of two hulls")
                .1
                .max(0.0);
            // The gap that the kernel finds is a lower bound of the true gap, and nearly equal to it.
            let found = f64::from(reach[i as usize][1]);
            assert!(found <= gap + GAP && found >= gap - 0.01 * REACH, "pair {i}: gap {found} m, expected {gap} m");
        }
    }
    assert!(near > 100 && far > 100, "{near} pairs within reach, {far} beyond");
}

/// Each gap is a thousandth of the reach below or above the reach: exactly the pairs with gaps below must be kept.
#[test]
fn gaps_next_to_the_reach_are_told_apart() {
    let mut random = Random(32);
    for round in 0..4 {
        // One hull is tested against two hundred others, each of which was moved along the line through the nearest
        // points to the wanted gap.
        let mut hulls = mixed(&mut random, 201, 2.0);
        let mut wanted = vec![];
        hulls.swap_first(round);
        for b in 1..hulls.points.len() {
            let (normal, distance) = exact::exact_distance(&hulls.points[0], &hulls.points[b]).unwrap();
            let near = b % 2 == 0;
            let target = REACH * if near { 1.0 - 1e-3 } else { 1.0 + 1e-3 };
            hulls.shift(b, (target - distance) * normal);
            wanted.push(near);
        }
        let (out, pairs) = test_pairs(&hulls, 1, 200);
        let kept: Vec<u32> = out.get("active_pairs");
        for (i, [_, b, ..]) in pairs.iter().enumerate() {
            let (_, gap) = exact::exact_distance(&hulls.points[0], &hulls.points[*b as usize]).unwrap();
            // Hulls that overlapped at first may not end at the wanted gap; such pairs are left out.
            let is_near = wanted[*b as usize - 1];
            if (gap < REACH - GAP) == is_near && (gap > REACH + GAP) != is_near {
                assert_eq!(kept.contains(&(i as u32)), is_near, "whether pair {i} with a gap of {gap} m is kept");
            }
        }
    }
}

/// Runs cull/direction on these pairs and returns their directions and pushes. The reach of each pair is 1 m, and in the
/// weights its hulls count as at least `gap` (m) apart. `last` has the pair and the push of each contact of the last
/// step.
fn directions(hulls: &Hulls, pairs: &[[u32; 4]], gap: f32, last: &[(u32, DVec3)]) -> (Vec<[f32; 4]>, Vec<[f32; 4]>) {
    let listed: Vec<u32> = (0..pairs.len() as u32).rev().collect();
    // Between the candidates that were contacts lie candidates that were none.
    let sources: Vec<u32> = (0..last.len() as u32).map(|c| 3 * c + 1).collect();
    let mut pushes = vec![[1e3, 1e3, 1e3, 0.0]; 3 * last.len() + 1];
    for (source, (pair, push)) in sources.iter().zip(last) {
        pushes[*source as usize] = texel(*push, f64::from(f32::from_bits(*pair)));
    }
    let out = case("cull/direction")
        .size(palpate::internal::gpu::Size::Reduce)
        .input("proxies", &hulls.proxies)
        .input("bounds", &hulls.bounds)
        .input("proxy_pairs", pairs)
        .input("hull", &hulls.hull)
        .input("faces", &hulls.faces)
        .input("active_pairs", &listed)
        .input("reach_of", &vec![[1.0f32, gap]; pairs.len()])
        .output::<[f32; 4]>("directions", 2 * pairs.len())
        .input("counts", &[Counts { last_contacts: last.len() as u32, ..Counts::default() }])
        .input("contact_source", &if last.is_empty() { vec![0] } else { sources })
        .input("candidate_pushes", &pushes)
        .groups(pairs.len())
        .run();
    let both: Vec<[f32; 4]> = out.get("directions");
    both.chunks(2).map(|two| (two[0], two[1])).unzip()
}

#[test]
fn cubes_part_along_their_faces() {
    let mut hulls = Hulls::default();
    hulls.add(&cube(), DQuat::IDENTITY, DVec3::ZERO);
    hulls.add(&cube(), DQuat::IDENTITY, DVec3::X * 0.9);
    hulls.add(&cube(), DQuat::IDENTITY, DVec3::new(-0.1, 1.2, 0.1));
    // The cubes of the last pair coincide: all six normals are equally good and cancel, but there must be a direction.
    let pairs = [[0, 1, 0, 0], [0, 2, 0, 0], [0, 0, 0, 0]];
    let (got, pushes) = directions(&hulls, &pairs, 0.0, &[]);
    assert_eq!(pushes, [[0.0; 4]; 3]);
    expect_close("cubes along x, 0.1 m deep", &got[0], &[1.0, 0.0, 0.0, 1.0], WEIGHT);
    expect_close("cubes along y, 0.2 m apart", &got[1], &[0.0, 1.0, 0.0, 0.64], WEIGHT);
    expect_close("weight at 0.3 m", &directions(&hulls, &pairs[1..2], 0.3, &[]).0[0][3..], &[0.49], WEIGHT);
    let length = f64s(&got[2]).length();
    assert!(
        (length - 1.0).abs() < 1e-6 && (f64::from(got[2][3]) - 1.0).abs() < 1e-5,
        "direction of coincident cubes: {:?}",
        got[2]
    );
}

#[test]
fn directions_against_the_oracle_and_from_both_sides() {
    let mut random = Random(77);
    let hulls = mixed(&mut random, 40, 0.4);
    let pairs: Vec<[u32; 4]> = (0..20).flat_map(|a| (20..40).map(move |b| [a, b, 0, 0])).collect();
    let got = directions(&hulls, &pairs, -1e9, &[]).0;
    let mut determined = vec![];
    for ([a, b, ..], got) in pairs.iter().zip(&got) {
        let (a, b) = (*a as usize, *b as usize);
        let blend = 0.25 * f64::from(hulls.bounds[a].radius.min(hulls.bounds[b].radius));
        let (points, planes) = (&hulls.points, &hulls.planes);
        let (normal, separation) = proximity::direction(&points[a], &planes[a], &points[b], &planes[b], blend).unwrap();
        assert!((f64s(got).length() - 1.0).abs() < 1e-6, "not a unit vector: {got:?}");
        let weight = (1.0 - separation).max(0.0).powi(2);
        expect_close("weight", &got[3..], &[weight], WEIGHT);
        // Where the normals nearly cancel, rounding may decide; elsewhere the direction is determined.
        determined.push(!proximity::nearly_cancels(&points[a], &planes[a], &points[b], &planes[b], blend));
        if determined[determined.len() - 1] {
            expect_close("direction", &got[..3], &normal.to_array(), DIRECTION);
        }
        // The distance by parry3d is no less than the separation along any face normal, and equals it where faces meet.
        let (_, distance) = exact::exact_distance(&points[a], &points[b]).unwrap();
        assert!(
            distance < 0.0 || separation <= distance + SEPARATION,
            "separation {separation} m along a face normal, distance {distance} m"
        );
    }
    let compared = determined.iter().filter(|d| **d).count();
    assert!(compared > 350, "the direction of only {compared} of 400 pairs is determined");
    let swapped: Vec<[u32; 4]> = pairs.iter().map(|[a, b, ..]| [*b, *a, 0, 0]).collect();
    for ((there, back), determined) in got.iter().zip(directions(&hulls, &swapped, -1e9, &[]).0).zip(determined) {
        let sum = f64s(there) + f64s(&back);
        assert!(
            !determined || sum.length() < DIRECTION.abs,
            "direction {there:?} of a pair, {back:?} of the swapped pair"
        );
    }
}

#[test]
fn pushes_of_the_last_contacts_are_summed_by_pair() {
    let mut random = Random(78);
    let hulls = mixed(&mut random, 8, 0.4);
    let pairs: Vec<[u32; 4]> = (0..4).flat_map(|a| (4..8).map(move |b| [a, b, 0, 0])).collect();
    let width = context().reduce_size() as usize;
    for n in [0, 1, width - 1, width, width + 1, 1234] {
        let last: Vec<_> = (0..n).map(|c| ((c * 5 % 13) as u32, random.vector())).collect();
        let (_, pushes) = directions(&hulls, &pairs, 0.0, &last);
        for (i, push) in pushes.iter().enumerate() {
            let want: DVec3 = last.iter().filter(|(pair, _)| *pair as usize == i).map(|(_, push)| *push).sum();
            // The sum has a hundred terms of order one.
            expect_close("push", push, &want.extend(want.length()).to_array(), Tolerance { abs: 1e-5, rel: 1e-5 });
        }
    }
}
