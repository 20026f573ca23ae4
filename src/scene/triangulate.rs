//! Cuts the polygons of a surface into triangles. A convex polygon is cut as a fan: all its triangles share one
//! corner. Any other polygon is cut by ear clipping: an ear, that is, a convex corner whose triangle with its two
//! neighbours contains no other corner, is cut off until the rest is convex.
//!
//! Ear clipping follows Meisters, "Polygons have ears" (1975), in the plane perpendicular to Newell's normal (the sum
//! of the cross products of successive corners). No vertex is dropped, not even one on a straight edge: a neighbouring
//! face may use it too, and without it there would be a gap between the two faces.

use glam::{DVec2, DVec3};

/// Appends the triangles of one polygon to `triangles`: n corners give n - 2 triangles, with the polygon's orientation.
pub(super) fn triangulate(vertices: &[DVec3], corners: &[u32], triangles: &mut Vec<[u32; 3]>) {
    let points = flatten(vertices, corners);
    let mut left: Vec<usize> = (0..corners.len()).collect();
    while left.len() > 3 && !is_convex(&points, &left) {
        // A polygon that crosses itself may have no ear; its remaining corners are then cut as a fan.
        let Some(ear) = (0..left.len()).find(|&at| is_ear(&points, &left, at)) else { break };
        triangles.push(around(&left, ear).map(|corner| corners[corner]));
        left.remove(ear);
    }
    for k in 1..left.len() - 1 {
        triangles.push([left[0], left[k], left[k + 1]].map(|corner| corners[corner]));
    }
}

/// Returns the corner at index `at` of the remaining polygon `left`, between its two neighbours.
fn around(left: &[usize], at: usize) -> [usize; 3] {
    let n = left.len();
    [left[(at + n - 1) % n], left[at], left[(at + 1) % n]]
}

/// Returns the corners as points in the polygon's plane, in counter-clockwise order.
fn flatten(vertices: &[DVec3], corners: &[u32]) -> Vec<DVec2> {
    let at = |k: usize| vertices[corners[k % corners.len()] as usize] - vertices[corners[0] as usize];
    let normal: DVec3 = (0..corners.len()).map(|k| at(k).cross(at(k + 1))).sum();
    let (u, v) = normal.try_normalize().unwrap_or(DVec3::Z).any_orthonormal_pair();
    (0..corners.len()).map(|k| DVec2::new(u.dot(at(k)), v.dot(at(k)))).collect()
}

fn turn(points: &[DVec2], [a, b, c]: [usize; 3]) -> f64 {
    (points[b] - points[a]).perp_dot(points[c] - points[b])
}

fn is_convex(points: &[DVec2], left: &[usize]) -> bool {
    (0..left.len()).all(|at| turn(points, around(left, at)) >= 0.0)
}

fn is_ear(points: &[DVec2], left: &[usize], at: usize) -> bool {
    let triangle = around(left, at);
    let [a, b, c] = triangle;
    let inside = |p: usize| {
        let side = |from: usize, to: usize| (points[to] - points[from]).perp_dot(points[p] - points[from]);
        side(a, b) >= 0.0 && side(b, c) >= 0.0 && side(c, a) >= 0.0
    };
    turn(points, triangle) > 0.0 && !left.iter().any(|&p| !triangle.contains(&p) && inside(p))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(polygon: &[DVec3]) -> (Vec<[u32; 3]>, f64, f64) {
        let mut triangles = Vec::new();
        let corners: Vec<u32> = (0..polygon.len() as u32).collect();
        triangulate(polygon, &corners, &mut triangles);
        let z = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|k| polygon[k as usize]);
            (b - a).cross(c - a).z / 2.0
        };
        (triangles.clone(), triangles.iter().map(z).sum(), triangles.iter().map(|t| z(t).abs()).sum())
    }

    #[test]
    fn a_convex_polygon_is_a_fan() {
        let square = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, y)| DVec3::new(x, y, 0.0));
        assert_eq!(area(&square).0, [[0, 1, 2], [0, 2, 3]]);
    }

    #[test]
    fn a_concave_polygon_is_covered_once_from_every_start() {
        // An L-shaped polygon of area 3 and a dart of area 1. In a fan from the wrong corner, triangles would overlap.
        let l = [(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0), (1.0, 2.0), (0.0, 2.0)];
        let dart = [(0.0, 0.0), (2.0, 1.0), (0.0, 2.0), (1.0, 1.0)];
        for (polygon, expected) in [(&l[..], 3.0), (&dart[..], 1.0)] {
            for start in 0..polygon.len() {
                let at = |k: usize| polygon[(k + start) % polygon.len()];
                let turned: Vec<DVec3> = (0..polygon.len()).map(|k| DVec3::new(at(k).0, at(k).1, 0.0)).collect();
                let (triangles, signed, unsigned) = area(&turned);
                assert_eq!(triangles.len(), polygon.len() - 2);
                assert!(
                    (signed - expected).abs() < 1e-12 && (unsigned - expected).abs() < 1e-12,
                    "the triangles must cover the polygon once when it starts at corner {start}"
                );
            }
        }
    }
}
