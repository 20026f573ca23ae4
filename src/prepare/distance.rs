//! Signed distance from a solid bounded by triangles, negative inside. The surface may be open, self-intersecting or
//! otherwise defective.
//!
//! Distances come from a bounding volume hierarchy (of the library parry). A point is inside if the generalised winding
//! number (A. Jacobson et al. 2013) of the surface around the point exceeds one half. The winding number is summed over
//! a tree of triangle clusters: exactly for triangles near the point, and by one dipole for each far cluster (G. Barill
//! et al. 2018, first order). Exact solid angles follow A. van Oosterom and J. Strackee 1983.

use std::f64::consts::PI;

use glam::DVec3;
use parry3d_f64::math::Vector;
use parry3d_f64::query::{PointQuery, PointQueryWithLocation};
use parry3d_f64::shape::TriMesh;

/// A cluster that is farther from the point than this many cluster radii is replaced by one dipole: the error of the
/// cluster's solid angle is then a few thousandths of 4 pi.
const FAR: f64 = 3.0;
/// Greatest number of triangles in a leaf of the tree.
const LEAF: usize = 8;
/// Two hits of a segment on the surface count as one if they are closer together than this share of the segment's
/// length, because the segment then meets an edge that two triangles share.
const SAME_CROSSING: f64 = 1e-7;
/// Winding number at the boundary between inside and outside.
pub const HALF: f64 = 0.5;

/// A solid given by its surface.
pub struct Solid {
    surface: TriMesh,
    corners: Vec<[DVec3; 3]>,
    clusters: Vec<Cluster>,
}

/// A node of the tree, with the triangles `first..end` of the list `Solid::corners`, which the tree sorts. `second` is
/// the index of the node's second child, or 0 in a leaf; the first child follows its parent directly.
struct Cluster {
    centre: DVec3,
    radius: f64,
    /// Dipole moment: sum of area times unit normal, m^2.
    dipole: DVec3,
    first: u32,
    end: u32,
    second: u32,
}

impl Solid {
    /// A solid from vertices (m) and triangles; triangles without area are ignored. Errors: no triangle has an area, or
    /// a coordinate is not finite.
    pub fn new(vertices: &[DVec3], triangles: &[[u32; 3]]) -> Result<Self, String> {
        let area = |t: &&[u32; 3]| {
            let [a, b, c] = t.map(|i| vertices[i as usize]);
            (b - a).cross(c - a).length_squared() > 0.0
        };
        let kept: Vec<[u32; 3]> = triangles.iter().filter(area).copied().collect();
        if let Some(v) = vertices.iter().position(|v| !v.is_finite()) {
            return Err(format!("vertex {v} of the surface is not finite"));
        }
        let points = vertices.iter().map(|p| Vector::new(p.x, p.y, p.z)).collect();
        let surface =
            TriMesh::new(points, kept.clone()).map_err(|e| format!("the surface has no triangle with an area: {e}"))?;
        let mut corners: Vec<[DVec3; 3]> = kept.iter().map(|t| t.map(|i| vertices[i as usize])).collect();
        let mut clusters = Vec::with_capacity(corners.len() / 2);
        let count = corners.len();
        cluster(&mut corners, 0, count, &mut clusters);
        Ok(Solid { surface, corners, clusters })
    }

    /// Unsigned distance to the surface, m.
    pub fn distance(&self, point: DVec3) -> f64 {
        self.surface.distance_to_local_point(Vector::new(point.x, point.y, point.z), false)
    }

    /// A vertex of the triangle nearest to the point.
    pub fn nearest_vertex(&self, point: DVec3) -> u32 {
        let point = Vector::new(point.x, point.y, point.z);
        let (_, (triangle, _)) = self.surface.project_local_point_and_get_location(point, false);
        self.surface.indices()[triangle as usize][0]
    }

    /// Winding number of the surface around a point: 1 inside a closed surface that is oriented outwards, 0 outside
    /// such a surface, and between 0 and 1 near an open surface.
    pub fn winding(&self, point: DVec3) -> f64 {
        let (mut angle, mut stack) = (0.0, vec![0]);
        while let Some(index) = stack.pop() {
            let cluster: &Cluster = &self.clusters[index as usize];
            let offset = cluster.centre - point;
            let squared = offset.length_squared();
            if squared > (FAR * cluster.radius).powi(2) {
                angle += cluster.dipole.dot(offset) / (squared * squared.sqrt());
            } else if cluster.second == 0 {
                angle += solid_angle(&self.corners[cluster.first as usize..cluster.end as usize], point);
            } else {
                stack.extend([cluster.second, index + 1]);
            }
        }
        angle / (4.0 * PI)
    }

    /// Signed distance to the surface, negative inside, m.
    pub fn signed(&self, point: DVec3) -> f64 {
        let distance = self.distance(point);
        if self.winding(point) > HALF { -distance } else { distance }
    }

    /// Hits of the segment from `a` to `b` on the surface: the distance of each hit from `a` as a share of the
    /// segment's length, in ascending order.
    pub fn hits(&self, a: DVec3, b: DVec3) -> Vec<f64> {
        let (low, high) = (a.min(b), a.max(b));
        let (low, high) = (Vector::new(low.x, low.y, low.z), Vector::new(high.x, high.y, high.z));
        let near = parry3d_f64::bounding_volume::Aabb::new(low, high);
        let vertices = self.surface.vertices();
        let indices = self.surface.indices();
        let corner = |i: u32| DVec3::new(vertices[i as usize].x, vertices[i as usize].y, vertices[i as usize].z);
        let hit = |t: u32| meet(&indices[t as usize].map(corner), a, b);
        let mut shares: Vec<f64> = self.surface.bvh().intersect_aabb(&near).filter_map(hit).collect();
        shares.sort_unstable_by(f64::total_cmp);
        shares.dedup_by(|next, kept| *next - *kept < SAME_CROSSING);
        shares
    }
}

/// Appends to `clusters` the tree over the triangles `first..end`, which are split into halves again and again.
fn cluster(corners: &mut [[DVec3; 3]], first: usize, end: usize, clusters: &mut Vec<Cluster>) {
    let mine = &mut corners[first..end];
    let (mut dipole, mut sum, mut weight) = (DVec3::ZERO, DVec3::ZERO, 0.0);
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for [a, b, c] in mine.iter() {
        let normal = (b - a).cross(c - a) / 2.0;
        let middle = (a + b + c) / 3.0;
        dipole += normal;
        sum += middle * normal.length();
        weight += normal.length();
        (low, high) = (low.min(middle), high.max(middle));
    }
    let centre = if weight > 0.0 { sum / weight } else { mine[0][0] };
    let radius = mine.iter().flatten().map(|v| v.distance_squared(centre)).fold(0.0, f64::max).sqrt();
    let index = clusters.len();
    clusters.push(Cluster { centre, radius, dipole, first: first as u32, end: end as u32, second: 0 });
    if mine.len() > LEAF {
        let extent = (high - low).to_array();
        let axis = (0..3).fold(0, |best, k| if extent[k] > extent[best] { k } else { best });
        let along = |t: &[DVec3; 3]| t[0][axis] + t[1][axis] + t[2][axis];
        let half = first + mine.len() / 2;
        mine.select_nth_unstable_by(half - first, |s, t| along(s).total_cmp(&along(t)));
        cluster(corners, first, half, clusters);
        clusters[index].second = clusters.len() as u32;
        cluster(corners, half, end, clusters);
    }
}

/// Winding number of triangles around a point, by a sum over all triangles: for few points or few triangles.
pub fn winding_number(vertices: &[DVec3], triangles: &[[u32; 3]], point: DVec3) -> f64 {
    let corners = |t: &[u32; 3]| [t.map(|i| vertices[i as usize])];
    triangles.iter().map(|t| solid_angle(&corners(t), point)).sum::<f64>() / (4.0 * PI)
}

/// Sum of the signed solid angles of triangles seen from a point.
fn solid_angle(triangles: &[[DVec3; 3]], point: DVec3) -> f64 {
    let mut angle = 0.0;
    for t in triangles {
        let [a, b, c] = t.map(|v| v - point);
        let (la, lb, lc) = (a.length(), b.length(), c.length());
        let denominator = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
        angle += 2.0 * a.dot(b.cross(c)).atan2(denominator);
    }
    angle
}

/// Where the segment from `a` to `b` hits a triangle or its edges, as a share of the segment's length (T. Moeller and
/// B. Trumbore 1997); `None` if the segment misses the triangle or is parallel to its plane.
fn meet([p, q, r]: &[DVec3; 3], a: DVec3, b: DVec3) -> Option<f64> {
    let (u, v, ray) = (q - p, r - p, b - a);
    let normal = ray.cross(v);
    let determinant = u.dot(normal);
    let from = a - p;
    let (s, across) = (from.dot(normal) / determinant, from.cross(u));
    let (t, share) = (ray.dot(across) / determinant, v.dot(across) / determinant);
    // A determinant of zero gives NaN or infinity, which fails the conditions.
    (s >= 0.0 && t >= 0.0 && s + t <= 1.0 && (0.0..=1.0).contains(&share)).then_some(share)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::sphere;

    /// Allowed error of winding numbers that are computed with dipoles, for a coarse sphere. Any error below one half
    /// would still let the winding number tell inside from outside.
    const DIPOLES: f64 = 0.02;

    #[test]
    fn a_sphere_has_its_distance_its_winding_and_its_hits() {
        let (vertices, triangles) = sphere::icosphere(0.1);
        let solid = Solid::new(&vertices, &triangles).unwrap();
        for i in 0..200u32 {
            let p = DVec3::new(i as f64 * 0.137, i as f64 * 0.319, i as f64 * 0.531).map(|x| 0.4 * x.fract() - 0.2);
            let w = solid_angle(&solid.corners, p) / (4.0 * PI);
            assert!(
                (solid.winding(p) - w).abs() < DIPOLES,
                "winding number from the tree: {}, from the exact sum: {w}",
                solid.winding(p)
            );
            assert!((solid.signed(p) - (p.length() - 0.1)).abs() < 5e-4);
        }
        let through = solid.hits(DVec3::new(-0.2, 0.01, 0.02), DVec3::new(0.2, 0.01, 0.02));
        assert_eq!(through.len(), 2);
        assert!(
            (through[0] + through[1] - 1.0).abs() < 1e-3 && (through[0] - 0.256).abs() < 2e-3,
            "hits at the shares {through:?} of the segment, expected 0.256 and 0.744"
        );
        assert!(solid.hits(DVec3::ZERO, DVec3::splat(0.05)).is_empty());
    }

    #[test]
    fn an_open_sphere_still_has_an_inside() {
        let (vertices, mut triangles) = sphere::icosphere(0.1);
        triangles.retain(|t| t.iter().all(|&i| vertices[i as usize].y < 0.08));
        let solid = Solid::new(&vertices, &triangles).unwrap();
        assert!(solid.winding(DVec3::ZERO) > 0.8 && solid.winding(DVec3::Y * 0.2) < 0.2);
        assert!(solid.signed(DVec3::ZERO) < -0.07);
    }

    #[test]
    fn surfaces_without_area_or_with_nan_are_refused() {
        let v = [DVec3::ZERO, DVec3::X, DVec3::X * 2.0];
        assert!(Solid::new(&v, &[[0, 1, 2]]).is_err_and(|e| e.contains("no triangle with an area")));
        assert!(Solid::new(&[DVec3::NAN, DVec3::X, DVec3::Y], &[[0, 1, 2]]).is_err_and(|e| e.contains("vertex 0")));
    }
}
