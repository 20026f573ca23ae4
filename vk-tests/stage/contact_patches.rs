//! Tests of kernel cull/contact_patches, which finds the contact patches of a pair of bodies (places where the pair may
//! touch along one normal), their rectangles, and the pair proxies that take part. A pair proxy is a collision proxy
//! (convex hull) of one of the two bodies; a side is body a or b of the pair; inflation is how far a skin (surface
//! mesh) may lie outside its hull.

use bytemuck::Zeroable;
use glam::DVec3;
use palpate::internal::gpu::Size;
use palpate::internal::shaders;
use palpate::internal::shaders::{ContactPatch, Counts, NONE, Pair, Proxy, ProxyBounds, StepParams};
use palpate::internal::stages::ARGS_WORDS;
use palpate::internal::stages::PAIR_PATCHES;
use palpate_oracle::proximity;

use crate::harness::random::Random;
use crate::harness::{Outcome, Tolerance, case, expect_close};
use crate::stage::flow::{Box3, GRID_WORDS};

/// Error of dot products of order one in f32.
const PLACED: Tolerance = Tolerance { abs: 2e-6, rel: 2e-6 };
/// Error of a unit vector from a weighted sum of some hundred vectors.
const DIRECTION: Tolerance = Tolerance { abs: 3e-6, rel: 0.0 };
/// The flag that the contact normals of a pair's proxies form more groups than the pair may have contact patches.
const REGION_OVERFLOW: u32 = 2;
const INFLATION: f32 = 0.03;
const HALF: f64 = 0.2;

/// Cubes as collision proxies, those of body a before those of b. `directions` has two elements for each pair of
/// proxies: a contact normal with its weight, and a push, which is the sum of depth times area times normal over the
/// pair's contacts in the last step.
struct Given {
    places: Vec<DVec3>,
    pair: Pair,
    directions: Vec<[f32; 4]>,
    before: Vec<ContactPatch>,
}

fn wide(x: [f32; 3]) -> DVec3 {
    DVec3::from_array(x.map(f64::from))
}

fn corners(place: DVec3) -> Vec<DVec3> {
    let corner = |k: usize| DVec3::from_array([k & 1, k >> 1 & 1, k >> 2].map(|bit| (2.0 * bit as f64 - 1.0) * HALF));
    (0..8).map(|k| place + corner(k)).collect()
}

impl Given {
    /// Cubes about the origin; `counts` has the number of cubes of each body. The pairs of proxies have these
    /// directions and weights in turn, and no pushes.
    fn new(counts: [u32; 2], directions: &[(DVec3, f64)], random: &mut Random) -> Given {
        let pairs = counts[0] * counts[1];
        let pair = Pair {
            proxy_pair_count: pairs,
            first_proxy: [0, counts[0]],
            proxy_count: counts,
            first_pair_proxy: [0, counts[0]],
            ..Pair::zeroed()
        };
        let both = |k: u32| {
            let (n, w) = directions[k as usize % directions.len()];
            [n.as_vec3().extend(w as f32).to_array(), [0.0; 4]]
        };
        Given {
            places: (0..counts[0] + counts[1]).map(|_| 0.1 * random.vector()).collect(),
            pair,
            directions: (0..pairs).flat_map(both).collect(),
            before: vec![ContactPatch::default(); PAIR_PATCHES],
        }
    }

    fn hull(&self, proxy: usize) -> Vec<DVec3> {
        corners(self.places[proxy]).iter().map(|x| x.as_vec3().as_dvec3()).collect()
    }

    fn run(&self) -> Outcome {
        let count = self.places.len();
        let proxy = |i: usize| Proxy { hull_first: 8 * i as u32, hull_count: 8, edge: 0.01, ..Proxy::zeroed() };
        let bounds = |i: usize| ProxyBounds {
            low: (self.places[i] - HALF).as_vec3().to_array(),
            inflation: INFLATION,
            high: (self.places[i] + HALF).as_vec3().to_array(),
            radius: 0.3,
        };
        let hull: Vec<[f32; 4]> =
            (0..count).flat_map(|i| self.hull(i)).map(|x| x.as_vec3().extend(0.0).to_array()).collect();
        case("cull/contact_patches")
            .size(Size::Reduce)
            .input("params", &[StepParams::zeroed()])
            .input("pairs", &[self.pair])
            .input("proxies", &(0..count).map(proxy).collect::<Vec<_>>())
            .input("bounds", &(0..count).map(bounds).collect::<Vec<_>>())
            .input("hull", &hull)
            .input("directions", &crate::stage::flow::some(&self.directions))
            .inout("contact_patches", &self.before)
            .output::<f32>("shares", PAIR_PATCHES * count)
            .inout("boxes", &vec![[[9.0f32; 3]; 2]; PAIR_PATCHES * count])
            .inout("proxy_patches", &vec![NONE; count])
            .partial("pair_proxy_counts", &vec![[7u32; 2]; count])
            .partial("active_pair_proxies", &vec![NONE; count])
            .partial("depth_grids", &vec![7u32; PAIR_PATCHES * GRID_WORDS])
            .inout("counts", &[Counts::default()])
            .inout("args", &vec![0u32; ARGS_WORDS])
            .partial("near_pairs", &vec![NONE; self.directions.len() / 2])
            .groups(1)
            .run()
    }
}

/// Checks what must hold for any input: axes are orthonormal, boxes hold the inflated hulls, a patch's rectangle is
/// what its members (pair proxies that belong to the patch) of both sides cover in common, shares (weights of the
/// patches at a pair proxy) sum to one, min-max depth grids (how far each side reaches along the normal, by cell) are
/// cleared, and the pair proxies in a rectangle are active. Returns the number of patches.
fn check(given: &Given, out: &Outcome) -> usize {
    let (contact_patches, boxes): (Vec<ContactPatch>, Vec<Box3>) = (out.get("contact_patches"), out.get("boxes"));
    let (shares, bits): (Vec<f32>, Vec<u32>) = (out.get("shares"), out.get("proxy_patches"));
    let depth_grids: Vec<u32> = out.get("depth_grids");
    let live = contact_patches.iter().filter(|contact_patch| contact_patch.weight > 0.0).count();
    let count = given.places.len();
    for (r, contact_patch) in contact_patches.iter().enumerate().take(live) {
        assert!(contact_patch.weight > 0.0, "contact patches in use must come first");
        let axes = [contact_patch.tangent, contact_patch.bitangent, contact_patch.normal].map(wide);
        for i in 0..3 {
            let along = axes.map(|axis| axis.dot(axes[i]) as f32);
            expect_close("products of axes", &along, &[0, 1, 2].map(|k| f64::from(u8::from(k == i))), PLACED);
        }
        assert!(axes[0].cross(axes[1]).dot(axes[2]) > 0.0);
        let mut sides = vec![];
        for side in 0..2 {
            let first = given.pair.first_proxy[side] as usize;
            let own = first..first + given.pair.proxy_count[side] as usize;
            let hulls: Vec<Vec<DVec3>> = own.clone().map(|p| given.hull(p)).collect();
            let boxed = |p: usize| proximity::side_box(axes, &[(&hulls[p - first], f64::from(INFLATION))]);
            let members: Vec<usize> = own.clone().filter(|p| bits[*p] >> (PAIR_PATCHES + r) & 1 == 1).collect();
            let whole: Vec<(&[DVec3], f64)> =
                members.iter().map(|p| (hulls[p - first].as_slice(), f64::from(INFLATION))).collect();
            sides.push(proximity::side_box(axes, &whole));
            for p in own.filter(|p| bits[*p] >> r & 1 == 1) {
                let (low, high) = boxed(p);
                let got = boxes[p * PAIR_PATCHES + r].map(wide);
                assert!(
                    (low - got[0]).min_element() > -2e-6 && (got[1] - high).min_element() > -2e-6,
                    "the box of pair proxy {p} must hold its inflated hull"
                );
                if members.contains(&p) {
                    expect_close("box", &boxes[p * PAIR_PATCHES + r][0], &low.to_array(), PLACED);
                }
            }
        }
        let (low, high) = (sides[0].0.max(sides[1].0), sides[0].1.min(sides[1].1));
        expect_close("low", &contact_patch.low, &[low.x, low.y], PLACED);
        expect_close("high", &contact_patch.high, &[high.x, high.y], PLACED);
        let own = &depth_grids[r * GRID_WORDS..][..GRID_WORDS];
        assert!(
            own[..256].iter().all(|f| *f == 0) && own[256..].iter().all(|f| *f == NONE),
            "the depth grids must be cleared"
        );
    }
    for s in 0..count {
        let own = &shares[PAIR_PATCHES * s..][..PAIR_PATCHES];
        let sum: f32 = own.iter().sum();
        let member = bits[s] >> PAIR_PATCHES != 0;
        // A patch of which pair proxy `s` is no member has a share of at most (q - 0.1) / 20 at `s`, where q is the
        // patch's field `weight` divided by the sum of this field over all patches.
        for r in (0..live).filter(|r| bits[s] >> (PAIR_PATCHES + r) & 1 == 0) {
            let strength = contact_patches[r].weight
                / contact_patches.iter().map(|contact_patch| contact_patch.weight).sum::<f32>();
            assert!(
                own[r] <= 0.05 * (strength - 0.1).max(0.0) + 1e-6,
                "pair proxy {s}, contact patch {r}: shares {own:?}"
            );
        }
        // A member's shares in its own patches sum to one; its shares in other patches come on top.
        assert!(if member { sum > 0.998 && sum < 1.052 } else { sum <= 0.05 }, "pair proxy {s}: shares {own:?}");
        assert!(own[live..].iter().all(|share| *share == 0.0));
    }
    let mut active: Vec<u32> = out.get("active_pair_proxies");
    let groups = out.get::<u32>("args")[3 * shaders::ARGS_CHUNKS as usize] as usize;
    assert!(active[groups..].iter().all(|pair_proxy| *pair_proxy == NONE));
    active.truncate(groups);
    active.sort_unstable();
    let wanted = (0..count as u32).filter(|s| bits[*s as usize] & ((1 << PAIR_PATCHES) - 1) != 0);
    assert_eq!(active, wanted.collect::<Vec<_>>());
    assert!(out.get::<[u32; 2]>("pair_proxy_counts").iter().all(|c| *c == [0, 0]));
    live
}

fn flags(out: &Outcome) -> u32 {
    out.get::<Counts>("counts")[0].flags
}

#[test]
fn like_directions_give_their_weighted_mean() {
    let mut random = Random(91);
    for (counts, scale) in [([1, 1], 1.0), ([3, 5], 1e-9), ([9, 8], 1.0), ([17, 3], 1e9)] {
        let leaning = random.vector().normalize();
        let directions: Vec<(DVec3, f64)> = (0..counts[0] * counts[1])
            .map(|_| ((leaning + 0.2 * random.vector()).normalize(), scale * (1.0 + random.next())))
            .collect();
        let given = Given::new(counts, &directions, &mut random);
        let out = given.run();
        assert_eq!((check(&given, &out), flags(&out)), (1, 0));
        let mean = proximity::mean_direction(&directions).unwrap();
        expect_close("normal", &out.get::<ContactPatch>("contact_patches")[0].normal, &mean.to_array(), DIRECTION);
    }
}

#[test]
fn opposite_groups_have_a_region_each() {
    let mut random = Random(92);
    let leaning = random.vector().normalize();
    let directions: Vec<(DVec3, f64)> = (0..20)
        .map(|k| {
            let sign = if k % 4 == 0 { -1.0 } else { 1.0 };
            (sign * (leaning + 0.1 * random.vector()).normalize(), 1.5 + random.next())
        })
        .collect();
    let given = Given::new([4, 5], &directions, &mut random);
    let out = given.run();
    assert_eq!((check(&given, &out), flags(&out)), (2, 0));
    let contact_patches: Vec<ContactPatch> = out.get("contact_patches");
    let mut cosines = [0, 1].map(|r| wide(contact_patches[r].normal).dot(leaning));
    cosines.sort_by(f64::total_cmp);
    assert!(cosines[0] < -0.98 && cosines[1] > 0.98, "cosines between the patches' normals and `leaning`: {cosines:?}");
    for contact_patch in &contact_patches[..2] {
        let of = |d: &&(DVec3, f64)| d.0.dot(wide(contact_patch.normal)) > 0.0;
        let own: Vec<(DVec3, f64)> = directions.iter().filter(of).copied().collect();
        let mean = proximity::mean_direction(&own).unwrap();
        expect_close("normal", &contact_patch.normal, &mean.to_array(), DIRECTION);
    }
}

#[test]
fn nothing_near_gives_nothing() {
    let mut random = Random(93);
    let mut given = Given::new([3, 4], &[(DVec3::X, 0.0)], &mut random);
    // These patches are left from the last step.
    given.before.fill(ContactPatch { normal: [0.0, 1.0, 0.0], weight: 1.0, ..ContactPatch::default() });
    let out = given.run();
    assert_eq!((check(&given, &out), flags(&out)), (0, 0));
    assert!(out.get::<u32>("args").iter().all(|word| *word == 0));
}

#[test]
fn more_groups_than_regions_are_flagged() {
    let mut random = Random(94);
    let axes: Vec<(DVec3, f64)> =
        DVec3::AXES.iter().flat_map(|axis| [*axis, -*axis]).enumerate().map(|(k, n)| (n, 1.0 + k as f64)).collect();
    for count in 1..=6 {
        let given = Given::new([6, 6], &axes[..count], &mut random);
        let out = given.run();
        let want = if count > PAIR_PATCHES { REGION_OVERFLOW } else { 0 };
        assert_eq!(
            (check(&given, &out), flags(&out)),
            (count.min(PAIR_PATCHES), want),
            "number of contact patches, and flags, for {count} groups of directions"
        );
    }
}

#[test]
fn a_direction_that_is_given_is_the_only_one() {
    let mut random = Random(95);
    let mut given = Given::new([3, 4], &[(DVec3::X, 1.0), (DVec3::Y, 2.0)], &mut random);
    given.pair.direction = [0.0, 0.0, -1.0, 1.0];
    let out = given.run();
    assert_eq!(out.get::<ContactPatch>("contact_patches")[0].normal, [0.0, 0.0, -1.0]);
    assert!(out.get::<ContactPatch>("contact_patches")[1..].iter().all(|contact_patch| contact_patch.weight == 0.0));
}

#[test]
fn a_half_space_has_one_region_and_the_slots_that_reach_it() {
    let mut random = Random(96);
    let mut given = Given::new([30, 0], &[(DVec3::X, 1.0)], &mut random);
    given.places.iter_mut().for_each(|place| *place *= 5.0);
    let normal = random.vector().normalize().as_vec3();
    given.pair = Pair { is_plane: 1, plane: normal.extend(-0.3).to_array(), ..given.pair };
    let out = given.run();
    let contact_patches: Vec<ContactPatch> = out.get("contact_patches");
    expect_close("normal", &contact_patches[0].normal, &(-normal.as_dvec3()).to_array(), DIRECTION);
    assert!(
        contact_patches[0].weight > 0.0 && contact_patches[1..].iter().all(|contact_patch| contact_patch.weight == 0.0)
    );
    let (bits, shares): (Vec<u32>, Vec<f32>) = (out.get("proxy_patches"), out.get("shares"));
    let mut below = 0;
    for (s, bit) in bits.iter().enumerate() {
        let lowest = given.hull(s).iter().map(|x| normal.as_dvec3().dot(*x)).fold(f64::INFINITY, f64::min);
        let above = lowest + 0.3 - f64::from(INFLATION);
        assert!(
            above.abs() < 1e-5 || (*bit == 1) == (above < 0.0),
            "pair proxy {s}: its inflated hull is {above} m above the plane, and its bits of patches are {bit}"
        );
        assert_eq!(shares[PAIR_PATCHES * s], *bit as f32);
        below += bit;
    }
    assert!(below > 2 && below < 28 && out.get::<u32>("args")[3 * shaders::ARGS_CHUNKS as usize] == below);
}
