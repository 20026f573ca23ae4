//! cull/regions: a pair's normal, its tile, the list of active proxies and the work that follows.

use bytemuck::Zeroable;
use glam::DVec3;
use palpate::gpu::Size;
use palpate::oracle::proximity;
use palpate::stages::args;
use palpate::stages::types::{ActiveProxy, Counts, NONE, Pair, Proxy, ProxyBounds, Region, StepParams};

use crate::harness::{Outcome, Tolerance, case, context, expect_close};
use crate::random::Random;

/// Dot products of order one in f32.
const PLACED: Tolerance = Tolerance { abs: 1e-6, rel: 1e-6 };
/// A unit vector from a weighted sum of some hundred.
const DIRECTION: Tolerance = Tolerance { abs: 3e-6, rel: 0.0 };
const TILE: u32 = 32;
const REGION_OVERFLOW: u32 = 2;

/// Cubes of half an edge `half` at these places: one proxy each.
struct Given {
    places: Vec<DVec3>,
    half: f64,
    inflation: f32,
    pairs: Vec<Pair>,
    active: Vec<u32>,
    directions: Vec<[f32; 4]>,
    texel: f32,
}

fn corners(place: DVec3, half: f64) -> Vec<DVec3> {
    let corner = |k: usize| DVec3::from_array([k & 1, k >> 1 & 1, k >> 2].map(|bit| (2.0 * bit as f64 - 1.0) * half));
    (0..8).map(|k| place + corner(k)).collect()
}

impl Given {
    fn proxies(&self) -> Vec<Proxy> {
        let proxy = |i: usize| Proxy {
            hull_first: 8 * i as u32,
            hull_count: 8,
            vertex_count: 10 + i as u32,
            triangle_count: 100 + i as u32,
            embed_count: 20 + i as u32,
            ..Proxy::zeroed()
        };
        (0..self.places.len()).map(proxy).collect()
    }

    fn run(&self) -> Outcome {
        let hull: Vec<[f32; 4]> = self
            .places
            .iter()
            .flat_map(|x| corners(*x, self.half))
            .map(|x| x.as_vec3().extend(0.0).to_array())
            .collect();
        let bounds = ProxyBounds { inflation: self.inflation, ..ProxyBounds::default() };
        let unused = ActiveProxy { proxy: NONE, ..Default::default() };
        case("cull/regions")
            .size(Size::Reduce)
            .constant("PAIRS", self.pairs.len() as u32)
            .constant("TILE", TILE)
            .constant("GROUP", context().group_size())
            .input("params", &[StepParams { texel: self.texel, ..StepParams::zeroed() }])
            .input("pairs", &self.pairs)
            .input("proxies", &self.proxies())
            .input("bounds", &vec![bounds; self.places.len()])
            .input("hull", &hull)
            .input("proxy_active", &self.active)
            .input("directions", &self.directions)
            .output::<Region>("regions", self.pairs.len())
            .partial("active_list", &vec![unused; self.active.len()])
            .inout("counts", &[Counts::default()])
            .inout("args", &vec![0u32; args::WORDS])
            .groups(1)
            .run()
    }
}

fn f64s(x: [f32; 3]) -> DVec3 {
    DVec3::from_array(x.map(f64::from))
}

fn axes(region: &Region) -> [DVec3; 3] {
    [f64s(region.tangent), f64s(region.bitangent), f64s(region.normal)]
}

/// Two cubes of unit edge, b over a corner of a, with an overlap of 0.5 x 0.24 along z.
fn two_cubes() -> Given {
    let pair = Pair { proxy_pair_count: 1, first_proxy: [0, 1], proxy_count: [1, 1], ..Pair::zeroed() };
    Given {
        places: vec![DVec3::ZERO, DVec3::new(0.5, 0.76, 0.9)],
        half: 0.5,
        inflation: 0.0,
        pairs: vec![pair],
        active: vec![1, 1],
        directions: vec![[0.0, 0.0, 1.0, 0.3]],
        texel: 0.0,
    }
}

#[test]
fn two_cubes_by_hand() {
    let out = two_cubes().run();
    let region = out.get::<Region>("regions")[0];
    expect_close(
        "axes",
        &[region.tangent, region.bitangent, region.normal].concat(),
        &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        PLACED,
    );
    let texel = 0.5 / f64::from(TILE - 2);
    expect_close("texel", &[region.texel], &[texel], PLACED);
    expect_close("low", &region.low, &[-texel, 0.26 - texel], PLACED);
    expect_close("heights", &[region.height_low, region.height_high], &[-0.5, 1.4], PLACED);
    assert_eq!((region.width, region.height), (TILE, 14 + 3));
    let list: Vec<ActiveProxy> = out.get("active_list");
    let second = ActiveProxy { proxy: 1, side: 1, vertex_first: 10, triangle_first: 100, embed_first: 20 };
    assert_eq!(list, [ActiveProxy::default(), second]);
    let want = Counts { active_proxies: 2, vertices: 21, triangles: 201, embeds: 41, ..Counts::default() };
    assert_eq!(out.get::<Counts>("counts"), [want]);
    let (slots, group): (Vec<u32>, _) = (out.get("args"), context().group_size());
    let of = |slot: u32| slots[3 * slot as usize];
    assert_eq!(of(args::EMBED), 41u32.div_ceil(group));
    assert_eq!(of(args::RASTER), 201u32.div_ceil(group));
    assert_eq!(of(args::CANDIDATES), 21u32.div_ceil(group));
    assert_eq!(of(args::COMPACT), 1);
    assert_eq!(slots[4 * args::DRAW as usize..][..4], [603, 1, 0, 0]);
}

#[test]
fn a_texel_too_fine_is_flagged_and_one_too_coarse_is_refined() {
    // With fewer than 32 texels a side triangles would slip between their centres: finer costs time, never contacts.
    let coarse = Given { texel: 0.05, ..two_cubes() }.run();
    expect_close("texel", &[coarse.get::<Region>("regions")[0].texel], &[0.5 / 30.0], PLACED);
    assert_eq!(coarse.get::<Counts>("counts")[0].flags, 0);
    let fine = Given { texel: 0.001, ..two_cubes() }.run();
    expect_close("texel", &[fine.get::<Region>("regions")[0].texel], &[0.5 / 30.0], PLACED);
    assert_eq!(fine.get::<Counts>("counts")[0].flags, REGION_OVERFLOW);
}

#[test]
fn what_does_not_touch_asks_for_no_work() {
    let nothing = Given { active: vec![0, 0], directions: vec![[0.0; 4]], ..two_cubes() }.run();
    let region = nothing.get::<Region>("regions")[0];
    assert_eq!((region.width, region.height), (0, 0));
    assert_eq!(nothing.get::<Counts>("counts"), [Counts::default()]);
    let words: Vec<u32> = nothing.get("args");
    assert!(words.iter().enumerate().all(|(k, w)| *w == u32::from(k == 4 * args::DRAW as usize + 1)), "{words:?}");
    // Active, but side by side along the normal: no ray meets both.
    let aside = Given { places: vec![DVec3::ZERO, DVec3::new(3.0, 0.0, 0.9)], ..two_cubes() }.run();
    assert_eq!(aside.get::<Region>("regions")[0].width, 0);
}

#[test]
fn directions_that_cancel_leave_the_heaviest() {
    let mut given = two_cubes();
    given.pairs[0].proxy_pair_count = 3;
    given.directions = vec![[1.0, 0.0, 0.0, 0.5], [-1.0, 0.0, 0.0, 0.51], [0.0, 0.0, 1.0, 0.0]];
    assert_eq!(given.run().get::<Region>("regions")[0].normal, [-1.0, 0.0, 0.0]);
}

/// Three bodies of `n` cubes each and a half-space; some cubes active, in general position.
fn crowd(n: u32, random: &mut Random) -> Given {
    let pair = |a: u32, b: u32, first: u32| Pair {
        first_proxy_pair: first,
        proxy_pair_count: n * n,
        first_proxy: [a * n, b * n],
        proxy_count: [n, n],
        ..Pair::zeroed()
    };
    let normal = random.vector().normalize().as_vec3().extend(0.1).to_array();
    let floor = Pair { first_proxy: [n, 0], proxy_count: [n, 0], is_plane: 1, plane: normal, ..Pair::zeroed() };
    let leaning = random.vector().normalize();
    let direction = |random: &mut Random| {
        let weight = random.next().max(0.0);
        (leaning + 0.4 * random.vector()).normalize().as_vec3().extend(weight as f32).to_array()
    };
    Given {
        places: (0..3 * n).map(|_| 0.7 * random.vector()).collect(),
        half: 0.2,
        inflation: 0.03,
        pairs: vec![pair(0, 1, 0), floor, pair(1, 2, n * n)],
        active: (0..5 * n).map(|_| u32::from(random.next() > -0.2)).collect(),
        directions: (0..2 * n * n).map(|_| direction(random)).collect(),
        texel: 0.0,
    }
}

#[test]
fn crowds_of_any_size_against_the_oracle() {
    let width = context().reduce_size();
    let mut random = Random(15);
    for n in [1, width - 1, width, width + 1, 35] {
        let given = crowd(n, &mut random);
        let out = given.run();
        let regions: Vec<Region> = out.get("regions");
        let mut slot = 0;
        for (pair, region) in given.pairs.iter().zip(&regions) {
            slot = check_region(&given, pair, region, slot);
        }
        check_list(&given, &out);
    }
}

/// Normal, orthonormal axes and a tile that holds what both sides have in common; returns the next pair's first slot.
fn check_region(given: &Given, pair: &Pair, region: &Region, mut slot: usize) -> usize {
    let directions = &given.directions[pair.first_proxy_pair as usize..][..pair.proxy_pair_count as usize];
    let weighted: Vec<_> = directions.iter().map(|d| (f64s([d[0], d[1], d[2]]), f64::from(d[3]))).collect();
    let plane = -f64s([pair.plane[0], pair.plane[1], pair.plane[2]]);
    let mean = proximity::mean_direction(&weighted).unwrap_or(DVec3::Y);
    let normal = if pair.is_plane != 0 { plane } else { mean };
    expect_close("normal", &region.normal, &normal.to_array(), DIRECTION);
    let axes = axes(region);
    for i in 0..3 {
        let along = axes.map(|axis| axis.dot(axes[i]) as f32);
        expect_close("orthonormal", &along, &[0, 1, 2].map(|k| f64::from(u8::from(k == i))), PLACED);
    }
    let mut boxes = vec![];
    for side in 0..if pair.is_plane != 0 { 1 } else { 2 } {
        let ids = (0..pair.proxy_count[side] as usize).filter(|p| given.active[slot + p] != 0);
        let hulls: Vec<_> =
            ids.map(|p| corners(given.places[pair.first_proxy[side] as usize + p], given.half)).collect();
        let hulls: Vec<_> = hulls.iter().map(|h| (h.as_slice(), f64::from(given.inflation))).collect();
        boxes.push(proximity::side_box(axes, &hulls));
        slot += pair.proxy_count[side] as usize;
    }
    let (a, b) = (boxes[0], boxes[boxes.len() - 1]);
    let (low, high) = (a.0.max(b.0), a.1.min(b.1));
    let extent = (high - low).truncate();
    if extent.min_element() < -1e-5 {
        assert_eq!(region.width, 0);
    } else if extent.min_element() > 1e-5 {
        let texel = extent.max_element() / f64::from(TILE - 2);
        expect_close("texel", &[region.texel], &[texel], PLACED);
        expect_close("low", &region.low, &(low.truncate() - texel).to_array(), PLACED);
        let size = [region.width, region.height].map(f64::from);
        let covered = [0, 1].map(|k| f64::from(region.low[k]) + size[k] * f64::from(region.texel));
        assert!(covered[0] > high.x && covered[1] > high.y && region.width.max(region.height) <= TILE, "{region:?}");
        let heights = [region.height_low, region.height_high];
        expect_close("heights", &heights, &[a.0.z.min(b.0.z), a.1.z.max(b.1.z)], PLACED);
    }
    slot
}

/// Active proxies in order of pair, side and proxy, with running totals; a half-space draws nothing.
fn check_list(given: &Given, out: &Outcome) {
    let (mut want, mut counts, mut slot) = (vec![], Counts::default(), 0);
    let proxies = given.proxies();
    for (r, pair) in given.pairs.iter().enumerate() {
        for side in 0..if pair.is_plane != 0 { 1 } else { 2 } {
            for id in pair.first_proxy[side]..pair.first_proxy[side] + pair.proxy_count[side] {
                if given.active[slot] != 0 {
                    want.push(ActiveProxy {
                        proxy: id,
                        side: 2 * r as u32 + side as u32,
                        vertex_first: counts.vertices,
                        triangle_first: counts.triangles,
                        embed_first: counts.embeds,
                    });
                    counts.active_proxies += 1;
                    counts.vertices += proxies[id as usize].vertex_count;
                    counts.triangles += if pair.is_plane != 0 { 0 } else { proxies[id as usize].triangle_count };
                    counts.embeds += proxies[id as usize].embed_count;
                }
                slot += 1;
            }
        }
    }
    let list: Vec<ActiveProxy> = out.get("active_list");
    assert_eq!(list[..want.len()], want);
    assert!(list[want.len()..].iter().all(|entry| entry.proxy == NONE));
    assert_eq!(out.get::<Counts>("counts"), [counts]);
}
