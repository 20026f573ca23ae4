//! Makes the collision *proxies*: convex hulls that cover the skin (surface mesh), for the broad phase and for a first
//! estimate of the contact normal. A proxy *owns* skin triangles and vertices: the narrow phase tests them if the proxy
//! may touch another body. The *solid* is the inside of the skin.
//!
//! Approximate convex decomposition (K. Mamou's V-HACD, in the crate parry) cuts the voxels of the solid into parts,
//! and parts with too many skin triangles are halved. Each skin triangle belongs to the part that contains the voxel of
//! the triangle's centroid. A part's hull is the convex hull of its triangles' corners and of its inner voxels'
//! centres, so that the hull fits the skin tightly and contains the part's volume behind the skin. All hulls together
//! have a limited number of triangles; hulls get further corners where the skin sticks out most.

use glam::DVec3;
use parry3d_f64::math::Vector;
use parry3d_f64::transformation::vhacd::{VHACD, VHACDParameters};
use parry3d_f64::transformation::voxelization::{FillMode, VoxelSet};

use super::hull::{self, Growing};
use super::{NONE, Proxy, Skin, mass, repair};

/// A skin that encloses this share of its convex hull's volume or more counts as convex and gets one proxy.
pub const CONVEX: f64 = 0.99;
/// Number of voxels along the longest side of the skin's bounding box. More voxels change the parts little, and the
/// cost grows with the cube of this number.
const RESOLUTION: u32 = 64;
/// A part is cut further while its convex hull has more empty volume than this share of the volume of the whole skin's
/// hull. With this value a head, a gear or a pumpkin is cut into 20 to 30 parts.
const CONCAVITY: f64 = 0.0025;
/// Default for the greatest number of proxies. It is a compromise: with fewer proxies, one proxy of a head with 88,000
/// triangles owns more than 5,000 triangles, and all of them are processed if that proxy may touch; with 40 proxies
/// each, two bodies have at most 1,600 pairs of proxies.
const HULLS: u32 = 40;
/// The convex decomposition is asked for one part per this many proxies (it may make more parts); the other proxies are
/// left for halving parts with many triangles.
const CUT: u32 = 3;
/// A part is halved while it has more triangles than this factor times the even share (number of all triangles over the
/// greatest number of proxies), and while there are fewer parts than proxies allowed.
const BUSY: f64 = 1.25;
/// A part with at most this many triangles is never halved: to process them costs less than another proxy.
const FEW: usize = 1000;
/// Approximate number of triangles of all hulls of a body together.
const HULL_TRIANGLES: usize = 800;

/// Covers the skin as [`at_most`] does, with at most the default number of proxies (`HULLS`).
pub fn proxies(skin: &Skin) -> Result<Vec<Proxy>, String> {
    at_most(skin, HULLS)
}

/// Covers the skin with at most `hulls` proxies, at least one. Each triangle and each vertex is owned by one proxy; a
/// triangle sticks out of its proxy's hull by at most the proxy's margin. A convex skin gets one proxy. The result does
/// not depend on thread timing or hash order. Errors: no triangles, or positions that are not finite.
pub fn at_most(skin: &Skin, hulls: u32) -> Result<Vec<Proxy>, String> {
    if skin.triangles.is_empty() {
        return Err("the skin has no triangles".into());
    }
    if skin.vertices.iter().any(|v| !v.is_finite()) {
        return Err("the skin has a vertex that is not finite".into());
    }
    let points = together(skin);
    let whole = hull::convex(&hull::thinned(&points));
    // Holes are closed before voxels are filled: through an open hole the fill would leak and leave a shell, whose
    // hulls have no depth.
    let (vertices, triangles) = repair::closed(&points, &skin.triangles);
    let volume = mass::properties(&vertices, &triangles).volume;
    let parts = match whole {
        Some(whole) if hulls > 1 && volume < CONVEX * whole.volume() => {
            let mut parts = decompose(skin, (&vertices, &triangles), hulls);
            split_busy(skin, &mut parts, hulls as usize);
            parts
        }
        _ => Parts { count: 1, owner: vec![0; skin.triangles.len()], place: Vec::new(), inner: vec![Vec::new()] },
    };
    cover(skin, &parts)
}

/// The skin's vertices. Each vertex that belongs to no triangle is replaced by a corner of the first triangle, because
/// a vertex far away would enlarge the hull and the voxel grid.
fn together(skin: &Skin) -> Vec<DVec3> {
    let first = skin.vertices[skin.triangles[0][0] as usize];
    let mut points = vec![first; skin.vertices.len()];
    skin.triangles.iter().flatten().for_each(|&v| points[v as usize] = skin.vertices[v as usize]);
    points
}

/// The parts into which the solid is cut.
struct Parts {
    count: usize,
    /// For each skin triangle, the part to which it belongs.
    owner: Vec<u32>,
    /// For each skin vertex, the part of the voxel at or near it; the list is empty if there is one part only.
    place: Vec<u32>,
    /// For each part, the centres of its inner voxels.
    inner: Vec<Vec<DVec3>>,
}

/// Cuts the solid, which is the skin with its holes closed, into nearly convex parts.
fn decompose(skin: &Skin, (vertices, triangles): (&[DVec3], &[[u32; 3]]), hulls: u32) -> Parts {
    let points: Vec<Vector> = vertices.iter().map(|p| Vector::new(p.x, p.y, p.z)).collect();
    let fill = FillMode::FloodFill { detect_cavities: false };
    let voxels = VoxelSet::voxelize(&points, triangles, RESOLUTION, fill, false);
    let grid = VoxelGrid::new(&voxels);
    let parameters = VHACDParameters {
        concavity: CONCAVITY,
        resolution: RESOLUTION,
        max_convex_hulls: (hulls / CUT).max(1),
        ..VHACDParameters::default()
    };
    let cut = VHACD::from_voxels(&parameters, voxels);
    let mut part_of = vec![NONE; grid.surface.len()];
    let mut inner = vec![Vec::new(); cut.voxel_parts().len()];
    for (part, set) in cut.voxel_parts().iter().enumerate() {
        for voxel in set.voxels() {
            let at = grid.index(voxel.coords.to_array());
            if let Some(at) = at {
                part_of[at] = part as u32;
                if !grid.surface[at] {
                    let p = set.get_voxel_point(voxel);
                    inner[part].push(DVec3::new(p.x, p.y, p.z));
                }
            }
        }
    }
    let owner = skin.triangles.iter().map(|t| {
        let [a, b, c] = t.map(|i| skin.vertices[i as usize]);
        grid.nearest_part(&part_of, (a + b + c) / 3.0)
    });
    let place = skin.vertices.iter().map(|&p| grid.nearest_part(&part_of, p)).collect();
    Parts { owner: owner.collect(), place, count: inner.len(), inner }
}

/// Halves the part with the most triangles across the longest side of its bounding box, again and again, until no part
/// has many more triangles than the even share, or there are `hulls` parts. A proxy that may touch is processed as a
/// whole, so a proxy with many triangles would cost far more than its contact needs.
fn split_busy(skin: &Skin, parts: &mut Parts, hulls: usize) {
    let centroid = |t: u32| skin.triangles[t as usize].map(|i| skin.vertices[i as usize]).iter().sum::<DVec3>() / 3.0;
    let mut owned = vec![Vec::new(); parts.count];
    for (t, &part) in parts.owner.iter().enumerate() {
        owned[part as usize].push(t as u32);
    }
    let share = (BUSY * skin.triangles.len() as f64 / hulls as f64).max(FEW as f64) as usize;
    // Parts without triangles are removed later, so they do not count as used.
    let mut used = owned.iter().filter(|list| !list.is_empty()).count();
    while used < hulls {
        // Of several parts with the most triangles, the first is taken.
        let Some(busiest) = (0..owned.len()).rev().max_by_key(|&p| owned[p].len()) else { break };
        if owned[busiest].len() <= share {
            break;
        }
        let mut list: Vec<(f64, u32)> = Vec::with_capacity(owned[busiest].len());
        let centroids = || owned[busiest].iter().map(|&t| centroid(t));
        let low = centroids().fold(DVec3::INFINITY, DVec3::min);
        let extent = centroids().fold(DVec3::NEG_INFINITY, DVec3::max) - low;
        let axis = (0..3).rev().max_by(|&i, &j| extent[i].total_cmp(&extent[j])).unwrap_or(0);
        list.extend(owned[busiest].iter().map(|&t| (centroid(t)[axis], t)));
        list.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let middle = list.len() / 2;
        let cut = list[middle].0;
        owned[busiest] = list[..middle].iter().map(|&(_, t)| t).collect();
        owned.push(list[middle..].iter().map(|&(_, t)| t).collect());
        let (beyond, within) = parts.inner[busiest].iter().partition(|p| p[axis] >= cut);
        parts.inner[busiest] = within;
        parts.inner.push(beyond);
        used += 1;
    }
    for (part, list) in owned.iter().enumerate() {
        list.iter().for_each(|&t| parts.owner[t as usize] = part as u32);
    }
    parts.count = owned.len();
}

/// Geometry of the voxel grid, and which voxels the skin passes through.
struct VoxelGrid {
    origin: DVec3,
    edge: f64,
    size: [i64; 3],
    surface: Vec<bool>,
}

impl VoxelGrid {
    fn new(voxels: &VoxelSet) -> Self {
        let most = |k: usize| voxels.voxels().iter().map(|v| v.coords[k]).max().unwrap_or(0);
        let size = [0, 1, 2].map(|k| most(k) + 1);
        let origin = DVec3::new(voxels.origin.x, voxels.origin.y, voxels.origin.z);
        let surface = vec![false; size.iter().product::<i64>() as usize];
        let mut grid = VoxelGrid { origin, edge: voxels.scale, size, surface };
        for voxel in voxels.voxels() {
            if let Some(at) = grid.index(voxel.coords.to_array()) {
                grid.surface[at] = voxel.is_on_surface;
            }
        }
        grid
    }

    fn index(&self, c: [i64; 3]) -> Option<usize> {
        let within = (0..3).all(|k| (0..self.size[k]).contains(&c[k]));
        within.then(|| (c[0] + self.size[0] * (c[1] + self.size[1] * c[2])) as usize)
    }

    /// The part of the voxel at a point. If that voxel belongs to no part (by rounding at voxel faces), the part of the
    /// nearest voxel within two voxels that belongs to a part, or else part 0.
    fn nearest_part(&self, part_of: &[u32], point: DVec3) -> u32 {
        let local = (point - self.origin) / self.edge;
        let centre = local.to_array().map(|c| c.round() as i64);
        for reach in 0..=2i64 {
            let mut best = (f64::INFINITY, NONE);
            for code in 0..(2 * reach + 1).pow(3) {
                let side = 2 * reach + 1;
                let step = [code % side, code / side % side, code / side / side];
                let c = [0, 1, 2].map(|k| centre[k] + step[k] - reach);
                let Some(part) = self.index(c).map(|at| part_of[at]).filter(|&p| p != NONE) else { continue };
                let distance = local.distance_squared(DVec3::from_array(c.map(|x| x as f64)));
                if distance < best.0 {
                    best = (distance, part);
                }
            }
            if best.1 != NONE {
                return best.1;
            }
        }
        0
    }
}

/// Makes a proxy for every part that has triangles, in the order of the parts. A proxy's margin is the greatest
/// distance by which its triangles stick out of its hull.
fn cover(skin: &Skin, parts: &Parts) -> Result<Vec<Proxy>, String> {
    let mut proxies = vec![Proxy::default(); parts.count];
    for (t, &part) in parts.owner.iter().enumerate() {
        proxies[part as usize].triangles.push(t as u32);
    }
    // A vertex belongs to the part of the first of its triangles. A vertex without triangles (a repair may have merged
    // it with another vertex) belongs to the part of the voxel at its place or, if that part has no triangles, to the
    // part of the skin's first triangle. A vertex without triangles touches nothing and enlarges no hull.
    let first = parts.owner[0];
    let mut vertex_owner = vec![NONE; skin.vertices.len()];
    for (triangle, &part) in skin.triangles.iter().zip(&parts.owner) {
        for &i in triangle {
            let owner = &mut vertex_owner[i as usize];
            *owner = if *owner == NONE { part } else { *owner };
        }
    }
    for (v, &owner) in vertex_owner.iter().enumerate() {
        let at_place = || parts.place.get(v).copied().filter(|&part| !proxies[part as usize].triangles.is_empty());
        let owner = if owner == NONE { at_place().unwrap_or(first) } else { owner };
        proxies[owner as usize].vertices.push(v as u32);
    }
    let mut covers = Vec::with_capacity(parts.count);
    for (proxy, inner) in proxies.iter().zip(&parts.inner).filter(|(p, _)| !p.triangles.is_empty()) {
        let mut covered: Vec<u32> = proxy.triangles.iter().flat_map(|&t| skin.triangles[t as usize]).collect();
        covered.sort_unstable();
        covered.dedup();
        let mut points: Vec<DVec3> = covered.iter().map(|&v| skin.vertices[v as usize]).collect();
        points.extend(inner);
        covers.push((covered, Growing::new(&points).ok_or("a part of the skin is a single point")?));
    }
    proxies.retain(|p| !p.triangles.is_empty());
    spend(&mut covers);
    for (proxy, (covered, growing)) in proxies.iter_mut().zip(covers) {
        let hull = growing.hull;
        let height = |&v: &u32| hull.height(skin.vertices[v as usize]);
        proxy.margin = covered.iter().map(height).fold(0.0, f64::max);
        (proxy.hull, proxy.faces) = (hull.vertices, hull.faces);
    }
    Ok(proxies)
}

/// Adds corners to the hulls, each to the hull out of which its skin sticks farthest (the first hull if several tie),
/// until all hulls together have about [`HULL_TRIANGLES`] triangles.
fn spend(covers: &mut [(Vec<u32>, Growing)]) {
    // By Euler's formula a hull with n corners has 2 n - 4 triangles.
    let mut left = HULL_TRIANGLES as i64;
    covers.iter().for_each(|(_, g)| left -= 2 * g.hull.vertices.len() as i64 - 4);
    while left > 0 {
        let worst = covers.iter_mut().map(|(_, g)| g).rev().max_by(|a, b| a.excess().total_cmp(&b.excess()));
        let Some(growing) = worst.filter(|g| g.excess() > 0.0) else { return };
        let before = growing.hull.vertices.len() as i64;
        growing.grow();
        // A new corner may turn old corners into inner points, so the numbers of corners before and after are compared.
        left -= 2 * (growing.hull.vertices.len() as i64 - before);
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::prepare::{MAX_HULL_VERTICES, layer, skin, sphere};

    pub(crate) fn check(skin: &Skin, proxies: &[Proxy]) {
        let mut triangles = vec![0; skin.triangles.len()];
        let mut vertices = vec![0; skin.vertices.len()];
        for p in proxies {
            assert!(!p.triangles.is_empty() && p.hull.len() <= MAX_HULL_VERTICES && p.faces.len() >= 4);
            assert!(p.faces.iter().all(|(n, _)| (n.length() - 1.0).abs() < 1e-12));
            let height = |x: DVec3| p.faces.iter().map(|(n, d)| n.dot(x) - d).fold(f64::NEG_INFINITY, f64::max);
            let corners = p.triangles.iter().flat_map(|&t| skin.triangles[t as usize]);
            let margin = corners.map(|v| height(skin.vertices[v as usize])).fold(0.0, f64::max);
            assert_eq!(margin, p.margin);
            p.triangles.iter().for_each(|&t| triangles[t as usize] += 1);
            p.vertices.iter().for_each(|&v| vertices[v as usize] += 1);
        }
        assert!(triangles.iter().chain(&vertices).all(|&owners| owners == 1));
    }

    #[test]
    fn a_convex_skin_has_one_proxy() {
        let (v, t) = sphere::icosphere(0.01);
        let ball = skin::build(v, t);
        let proxies = super::proxies(&ball).unwrap();
        check(&ball, &proxies);
        assert_eq!(proxies.len(), 1);
        assert!(proxies[0].margin < 0.001, "margin {} m, expected below 0.001 m", proxies[0].margin);
        let (v, t, _) = layer::boundary(&layer::kuhn_box(DVec3::ZERO, DVec3::ONE, [4, 4, 4]));
        let cube = skin::build(v, t);
        let proxies = super::proxies(&cube).unwrap();
        check(&cube, &proxies);
        assert_eq!((proxies.len(), proxies[0].hull.len(), proxies[0].faces.len()), (1, 8, 6));
        assert!(proxies[0].margin < 1e-15);
    }

    #[test]
    fn a_vertex_of_no_triangle_stretches_no_hull() {
        let (mut v, t) = sphere::icosphere(0.01);
        let ball = skin::build(v.clone(), t.clone());
        v.push(DVec3::splat(9.0));
        let stray = skin::build(v, t);
        let (proxies, wanted) = (super::proxies(&stray).unwrap(), super::proxies(&ball).unwrap());
        check(&stray, &proxies);
        assert_eq!((&proxies[0].hull, proxies[0].margin), (&wanted[0].hull, wanted[0].margin));
    }

    #[test]
    fn an_l_of_two_boxes_gets_tight_proxies() {
        let mut l = layer::kuhn_box(DVec3::ZERO, DVec3::new(1.0, 1.0, 0.2), [10, 10, 2]);
        let centre =
            |l: &super::super::Layer, t: &[u32; 4]| t.iter().map(|&i| l.nodes[i as usize]).sum::<DVec3>() / 4.0;
        let kept: Vec<_> =
            l.tetrahedra.iter().filter(|t| centre(&l, t).x < 0.3 || centre(&l, t).y < 0.3).copied().collect();
        l.tetrahedra = kept;
        let (v, t, _) = layer::boundary(&l);
        let skin = skin::build(v, t);
        let proxies = super::proxies(&skin).unwrap();
        check(&skin, &proxies);
        assert!((2..=12).contains(&proxies.len()), "the L has {} proxies, expected between 2 and 12", proxies.len());
        // No hull contains the point in the open corner of the L, which shows that the parts follow the concavity.
        let open = DVec3::new(0.5, 0.5, 0.1);
        let inside = |p: &Proxy| p.faces.iter().all(|(n, d)| n.dot(open) <= *d);
        assert!(!proxies.iter().any(inside));
    }

    #[test]
    fn busy_parts_are_halved_and_the_number_asked_for_is_kept() {
        let (v, t) = crate::prepare::model::surface(crate::scene::Model::Head, 6000);
        let head = skin::build(v, t);
        for hulls in [1, 4, 16, 24, 48] {
            let proxies = at_most(&head, hulls).unwrap();
            check(&head, &proxies);
            let (count, busiest) = (proxies.len(), proxies.iter().map(|p| p.triangles.len()).max().unwrap());
            assert!(count <= hulls as usize, "there are {count} proxies, but at most {hulls} are allowed");
            assert!(
                count == hulls as usize || busiest <= FEW,
                "one proxy owns {busiest} triangles, too many for {count} proxies where {hulls} are allowed"
            );
            assert!(
                busiest <= 3 * 11_996 / count + FEW,
                "one proxy owns {busiest} triangles, too many for {count} proxies where {hulls} are allowed"
            );
            let triangles: usize = proxies.iter().map(|p| 2 * p.hull.len() - 4).sum();
            assert!(triangles <= HULL_TRIANGLES + 2, "the hulls together have {triangles} triangles, too many");
        }
    }

    #[test]
    fn a_plate_of_two_triangles_and_scattered_triangles_do_not_panic() {
        let v = [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]].map(DVec3::from_array);
        let plate = skin::build(v.to_vec(), vec![[0, 1, 2], [0, 2, 3]]);
        check(&plate, &super::proxies(&plate).unwrap());
        let scattered: Vec<DVec3> = (1..301)
            .map(|i| DVec3::new(i as f64 * 0.137, i as f64 * 0.319, i as f64 * 0.531).map(f64::fract))
            .collect();
        let soup = skin::build(scattered, (0..100).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect());
        check(&soup, &super::proxies(&soup).unwrap());
        assert!(super::proxies(&Skin::default()).is_err());
    }
}
