//! Counts the pairs of intersecting triangles in a surface, for the report on its repair. A bounding volume hierarchy
//! finds the pairs that may intersect, and exact predicates decide.

use glam::DVec3;
use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::math::Vector;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy};
use robust::{Coord3D, orient3d};

use super::faces::Faces;
use super::points;
use super::report::Intersections;

/// Greatest number of intersecting pairs that a report lists.
const NAMED: usize = 8;

/// Counts the pairs of triangles in which an edge of one triangle passes through the other triangle. A pair that shares
/// an edge, only touches, or lies in one plane is not counted. The signs of the determinants that decide on which side
/// of a plane a point lies are exact (J. Shewchuk 1997, in the crate `robust`).
pub(super) fn count(faces: &Faces) -> Intersections {
    let boxes: Vec<Aabb> = faces.corners.iter().map(|&t| bounds(points(faces.vertices, t))).collect();
    let tree = Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes);
    let mut found = Vec::new();
    for (a, bounds) in boxes.iter().enumerate() {
        let before = found.len();
        let later = tree.intersect_aabb(bounds).map(|b| b as usize).filter(|&b| b > a);
        found.extend(later.filter(|&b| cross(faces, a, b)).map(|b| [a, b].map(|t| faces.origin[t])));
        found[before..].sort_unstable();
    }
    let first_pairs = found.iter().take(NAMED).copied().collect();
    Intersections { count: found.len(), first_pairs }
}

fn bounds(corners: [DVec3; 3]) -> Aabb {
    let [low, high] = [
        corners.into_iter().fold(DVec3::INFINITY, DVec3::min),
        corners.into_iter().fold(DVec3::NEG_INFINITY, DVec3::max),
    ];
    Aabb::new(Vector::new(low.x, low.y, low.z), Vector::new(high.x, high.y, high.z))
}

/// Whether an edge of triangle `a` passes through triangle `b`, or the reverse. Edges that end at a vertex of both
/// triangles are left out.
fn cross(faces: &Faces, a: usize, b: usize) -> bool {
    let (a, b) = (faces.corners[a], faces.corners[b]);
    if a.iter().filter(|vertex| b.contains(vertex)).count() > 1 {
        return false;
    }
    let pierces = |edges: [u32; 3], other: [u32; 3]| {
        (0..3).any(|k| {
            let (from, to) = (edges[k], edges[(k + 1) % 3]);
            let apart = !other.contains(&from) && !other.contains(&to);
            apart && passes([from, to].map(|v| faces.vertices[v as usize]), points(faces.vertices, other))
        })
    };
    pierces(a, b) || pierces(b, a)
}

/// Whether the ends of the segment p-q lie strictly on different sides of a triangle's plane, and the line through p
/// and q meets the triangle.
fn passes([p, q]: [DVec3; 2], [a, b, c]: [DVec3; 3]) -> bool {
    let side = |a: DVec3, b: DVec3, c: DVec3, d: DVec3| {
        let [a, b, c, d] = [a, b, c, d].map(|p| Coord3D { x: p.x, y: p.y, z: p.z });
        orient3d(a, b, c, d)
    };
    let (above, below) = (side(a, b, c, p), side(a, b, c, q));
    if above == 0.0 || below == 0.0 || (above > 0.0) == (below > 0.0) {
        return false;
    }
    let around = [side(p, q, a, b), side(p, q, b, c), side(p, q, c, a)];
    around.iter().all(|&s| s >= 0.0) || around.iter().all(|&s| s <= 0.0)
}
