//! depth/raster (heights, then names) and depth/depth (the graphics pipeline): which triangle lies over each texel.

use bytemuck::Zeroable;
use glam::{DQuat, DVec2, DVec3};
use palpate::oracle::proximity::{self, Sheet};
use palpate::stages::depth::Path;
use palpate::stages::types::{ActiveProxy, Counts, NONE, Proxy, Region};

use crate::bodies::{octants, rigid, sphere, whole};
use crate::flow::Flow;
use crate::harness::context;
use crate::random::Random;

/// A texel's centre is known to f32 in texels (1e-5 of 128), and the graphics pipeline snaps corners to 1/256 of a
/// texel: a triangle may reach this much farther, as a share of its own height; beyond it there is no doubt.
const EDGE: f64 = 0.06;
/// Heights of a centimetre in f32, where slopes near a rim multiply what the tangents round.
const HEIGHT: f64 = 2e-7;
const PATHS: [Path; 2] = [Path::Compute, Path::Graphics];

/// A height from its sortable key: the inverse of what shared/tile.glsl documents.
fn height_of(key: u32, side_b: bool) -> f64 {
    let bits = if key & 0x8000_0000 != 0 { key & 0x7fff_ffff } else { !key };
    let value = f64::from(f32::from_bits(bits));
    if side_b { value } else { -value }
}

fn f64s(x: [f32; 3]) -> DVec3 {
    DVec3::from_array(x.map(f64::from))
}

/// Everything one texel may hold, by the oracle; and the least height along the side's direction that it must reach.
fn check_texel(flow: &Flow, side: u32, at: [u32; 2], sheets: &[Sheet], path: Path) -> bool {
    let index = ((side * flow.tile + at[1]) * flow.tile + at[0]) as usize;
    let (name, stored) = (flow.names[index], flow.heights[index]);
    let what = format!("{}, side {side}, texel {at:?}", path.name());
    let region = &flow.regions[side as usize / 2];
    let side_b = side % 2 == 1;
    // Side a is seen from above: its greatest height counts.
    let order = |h: f64| if side_b { h } else { -h };
    let certain = sheets.iter().filter(|s| s.inside >= EDGE).map(|s| order(s.height)).fold(f64::INFINITY, f64::min);
    if name == NONE {
        assert!(certain == f64::INFINITY, "{what} is empty, but a triangle lies over its centre");
        return false;
    }
    let found = sheets.iter().find(|s| s.triangle == name as usize);
    let found = found.unwrap_or_else(|| panic!("{what}: triangle {name} is not there, or faces away"));
    let slack = HEIGHT + if found.inside < EDGE { f64::from(region.texel) } else { 0.0 };
    assert!(order(found.height) <= certain + slack, "{what}: triangle {name} is hidden");
    let height = match path {
        Path::Compute => height_of(stored, side_b),
        Path::Graphics => {
            let depth = f64::from(f32::from_bits(stored));
            let share = if side_b { depth } else { 1.0 - depth };
            f64::from(region.height_low) + share * f64::from(region.height_high - region.height_low)
        }
    };
    assert!((height - found.height).abs() <= slack, "{what}: {height} high, not {}", found.height);
    true
}

/// Every texel of both sides of the first region; how many are covered on each side.
fn check_tiles(flow: &Flow, path: Path) -> [usize; 2] {
    let region = flow.regions[0];
    let axes = [f64s(region.tangent), f64s(region.bitangent), f64s(region.normal)];
    let positions: Vec<DVec3> = flow.skin.iter().map(|x| f64s([x[0], x[1], x[2]])).collect();
    let triangles: Vec<[u32; 3]> = flow.model.triangles.iter().map(|t| [t[0], t[1], t[2]]).collect();
    let mut covered = [0; 2];
    for side in 0..2u32 {
        // Only what active proxies own is drawn.
        let mut drawn = vec![[0; 3]; triangles.len()];
        for entry in flow.active_list.iter().filter(|e| e.proxy != NONE && e.side == side) {
            let p = &flow.model.proxies[entry.proxy as usize];
            let own = &flow.model.proxy_triangles[p.triangle_first as usize..][..p.triangle_count as usize];
            own.iter().for_each(|t| drawn[*t as usize] = triangles[*t as usize]);
        }
        for y in 0..flow.tile {
            for x in 0..flow.tile {
                if x >= region.width || y >= region.height {
                    let index = ((side * flow.tile + y) * flow.tile + x) as usize;
                    assert_eq!(flow.names[index], NONE, "{}: texel {x}, {y} is behind the tile", path.name());
                    continue;
                }
                let centre = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) * f64::from(region.texel);
                let at = centre + DVec2::new(region.low[0].into(), region.low[1].into());
                let sign = if side == 0 { 1.0 } else { -1.0 };
                let sheets = proximity::raster(axes, sign, &positions, &drawn, at, EDGE);
                covered[side as usize] += usize::from(check_texel(flow, side, [x, y], &sheets, path));
            }
        }
    }
    covered
}

#[test]
fn every_texel_names_the_nearest_facing_triangle() {
    let mut random = Random(41);
    for path in PATHS {
        for cut in [whole, octants] {
            let a = rigid("a", sphere(0.01, 2), cut, DVec3::ZERO, random.turn(3.0));
            let place = 0.015 * random.vector().normalize();
            let tool = rigid("tool", sphere(0.012, 2), cut, place, random.turn(3.0));
            let mut flow = Flow::new(std::slice::from_ref(&a), Some(&tool), place);
            flow.tile = 48;
            flow.query(path);
            let covered = check_tiles(&flow, path);
            assert!(covered.iter().all(|n| *n > 500), "{covered:?}");
        }
    }
}

/// A square of two triangles at each height, facing up or down, in a tile of unit texels.
fn squares(heights: &[(f32, bool)], sides: u32) -> Flow {
    let ball = rigid("ball", sphere(1.0, 0), whole, DVec3::ZERO, DQuat::IDENTITY);
    let mut flow = Flow::new(std::slice::from_ref(&ball), Some(&ball.clone()), DVec3::ZERO);
    (flow.tile, flow.skin, flow.model.triangles) = (8, vec![], vec![]);
    for (height, up) in heights {
        let first = flow.skin.len() as u32;
        let corner = |x: f32, y: f32| [x, y, *height, 1.0];
        flow.skin.extend([corner(1.0, 1.0), corner(5.0, 1.0), corner(5.0, 4.0), corner(1.0, 4.0)]);
        let [a, b, c, d] = [first, first + 1, first + 2, first + 3];
        let turned: [[u32; 4]; 2] = if *up { [[a, b, c, 0], [a, c, d, 0]] } else { [[a, c, b, 0], [a, d, c, 0]] };
        flow.model.triangles.extend(turned);
    }
    let count = flow.model.triangles.len() as u32;
    flow.model.proxies = vec![Proxy { triangle_count: count, ..Proxy::zeroed() }];
    flow.model.proxy_triangles = (0..count).rev().collect();
    flow.regions = vec![Region {
        normal: [0.0, 0.0, 1.0],
        tangent: [1.0, 0.0, 0.0],
        bitangent: [0.0, 1.0, 0.0],
        texel: 1.0,
        width: 7,
        height: 6,
        height_low: -10.0,
        height_high: 10.0,
        ..Region::default()
    }];
    let entry = |side: u32| ActiveProxy { side, triangle_first: side * count, ..ActiveProxy::default() };
    flow.active_list = (0..sides).map(entry).collect();
    flow.counts = Counts { active_proxies: sides, triangles: sides * count, ..Counts::default() };
    flow.args[6] = (sides * count).div_ceil(context().group_size());
    flow.args[48..52].copy_from_slice(&[3 * sides * count, 1, 0, 0]);
    flow
}

fn rasterize(flow: &mut Flow, path: Path) {
    match path {
        Path::Compute => flow.raster(),
        Path::Graphics => flow.draw(),
    }
}

#[test]
fn squares_by_hand() {
    for path in PATHS {
        // Up at 1 and 3, down at 2 and -4: a is seen from above, b from below.
        let mut flow = squares(&[(1.0, true), (3.0, true), (2.0, false), (-4.0, false)], 2);
        rasterize(&mut flow, path);
        for (side, triangles) in [[2u32, 3], [6, 7]].into_iter().enumerate() {
            for y in 0..8 {
                for x in 0..8 {
                    let name = flow.names[(side * 8 + y) * 8 + x];
                    let within = (1..5).contains(&x) && (1..4).contains(&y);
                    // The diagonal from (1, 1) to (5, 4) parts the square.
                    let below = 3.0 * (x as f64 - 0.5) > 4.0 * (y as f64 - 0.5);
                    let want = if within { triangles[usize::from(!below)] } else { NONE };
                    assert_eq!(name, want, "{}, side {side}, texel {x}, {y}", path.name());
                }
            }
        }
    }
}

#[test]
fn equal_heights_go_to_the_least_triangle_by_compute_and_to_one_of_them_by_graphics() {
    for path in PATHS {
        let mut flow = squares(&[(1.0, true), (1.0, true), (0.5, true)], 1);
        rasterize(&mut flow, path);
        let names: Vec<u32> = flow.names.iter().copied().filter(|n| *n != NONE).collect();
        assert_eq!(names.len(), 12);
        let allowed = if path == Path::Compute { 0..2 } else { 0..4 };
        assert!(names.iter().all(|n| allowed.contains(n)), "{}: {names:?}", path.name());
    }
}

#[test]
fn any_number_of_triangles() {
    let width = context().group_size() as usize;
    for n in [0, 1, width - 1, width, width + 1, 1234] {
        let mut flow = squares(&vec![(1.0, true); 617], 1);
        // The last triangles lie higher, so that the last of the n shows.
        for (i, x) in flow.skin.iter_mut().enumerate() {
            x[2] = i as f32 * 1e-3;
        }
        flow.model.proxy_triangles = (0..n.max(1) as u32).collect();
        flow.counts.triangles = n as u32;
        flow.args[6] = n.div_ceil(width) as u32;
        flow.args[48] = 3 * n as u32;
        for path in PATHS {
            rasterize(&mut flow, path);
            let highest = flow.names.iter().filter(|name| **name != NONE).max();
            assert_eq!(highest.copied(), n.checked_sub(1).map(|last| last as u32), "{}", path.name());
        }
    }
}

/// What a triangle is given once is the same whichever order the proxies are listed in.
#[test]
fn compute_names_do_not_depend_on_order() {
    let mut flow = squares(&[(2.0, true), (2.0, true), (1.0, false), (1.0, false), (1.5, true)], 2);
    flow.raster();
    let (names, heights) = (flow.names.clone(), flow.heights.clone());
    flow.model.proxy_triangles.reverse();
    flow.raster();
    assert_eq!((&flow.names, &flow.heights), (&names, &heights));
    assert!(case_names_texels(&flow) > 0);
}

/// Texels with a height are named, and no others.
fn case_names_texels(flow: &Flow) -> usize {
    let named = flow.names.iter().zip(&flow.heights).filter(|(name, height)| {
        assert_eq!(**name == NONE, **height == u32::MAX, "a height and a name come together");
        **name != NONE
    });
    named.count()
}
