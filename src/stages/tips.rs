//! Stiffer contact of tips and edges. The automatic contact stiffness (`contact_law.rs`) lets a body that is touched
//! over a whole cell of its tetrahedral mesh give way twenty times less in its contact than in its tetrahedra. A tip or
//! an edge touches a small part of a cell, so that with the same stiffness it would sink into the surface mesh before
//! the tetrahedra feel it. Therefore the contact of a triangle of a rigid body is stiffer by its *stiffening*: the area
//! of a disc as wide as a cell, divided by the area of the part of that disc which the rigid body fills a fifth of a
//! cell below the triangle's plane, or half way through a thin body. A contact on a part of a cell is then about as
//! stiff as one that covers the cell.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};

use crate::prepare::{Skin, hull};

/// How far below a triangle's plane the area is measured, in cells. The less this is, the less a tip lies within the
/// skin. With a twentieth of a cell, contacts were so stiff that a needle trembled in the dimple that wraps round its
/// tip.
const DEPTH: f64 = 0.2;
/// Greatest stiffening.
const MOST: f64 = 16.0;
/// Corners of the polygon that stands for the disc.
const CORNERS: u32 = 16;

/// Stiffening of each triangle of the skin (surface mesh) of a rigid, nearly convex body against a body whose
/// tetrahedra have edges of `cell` (m) in the mean; from 1 to 16.
pub fn stiffening(skin: &Skin, cell: f64) -> Vec<f32> {
    let Some(hull) = hull::convex(&hull::thinned(&skin.vertices)) else { return vec![1.0; skin.triangles.len()] };
    let disc = disc(0.5 * cell);
    let whole = area(&disc);
    let of = |corners: [DVec3; 3]| {
        let [a, b, c] = corners;
        let Some(normal) = (b - a).cross(c - a).try_normalize() else { return 1.0 };
        let (u, v) = normal.any_orthonormal_pair();
        let heights = hull.vertices.iter().map(|x| normal.dot(*x));
        let [low, high] = heights.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], x| [a.min(x), b.max(x)]);
        let middle = (a + b + c) / 3.0;
        // A thin body is cut half way through.
        let depth = (DEPTH * cell).min(0.5 * (high - low));
        let middle = middle + (high - depth - normal.dot(middle)) * normal;
        let mut part = disc.clone();
        for (face, offset) in &hull.faces {
            let inside = offset - face.dot(middle);
            // A plane that is farther away than the disc reaches does not cut it.
            if inside < 0.5 * cell {
                part = clipped(&part, |x| inside - face.dot(x.x * u + x.y * v));
            }
        }
        // What is left of the disc may be nothing, or a line of no area.
        (whole / area(&part).max(whole / MOST)).max(1.0)
    };
    skin.triangles.iter().map(|t| of(t.map(|v| skin.vertices[v as usize])) as f32).collect()
}

/// A regular polygon in place of a disc of this radius.
fn disc(radius: f64) -> Vec<DVec2> {
    (0..CORNERS).map(|k| radius * DVec2::from_angle(TAU * f64::from(k) / f64::from(CORNERS))).collect()
}

/// Area of a convex polygon, counter-clockwise.
fn area(polygon: &[DVec2]) -> f64 {
    let twice: f64 = polygon.iter().enumerate().map(|(k, x)| x.perp_dot(polygon[(k + 1) % polygon.len()])).sum();
    0.5 * twice
}

/// The part of a convex polygon in which a linear function is not negative (Sutherland and Hodgman 1974).
fn clipped(polygon: &[DVec2], value: impl Fn(DVec2) -> f64) -> Vec<DVec2> {
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (k, x) in polygon.iter().enumerate() {
        let before = polygon[(k + polygon.len() - 1) % polygon.len()];
        let (own, last) = (value(*x), value(before));
        if (own >= 0.0) != (last >= 0.0) {
            kept.push(before.lerp(*x, last / (last - own)));
        }
        if own >= 0.0 {
            kept.push(*x);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::{layer, skin, sphere};

    const CELL: f64 = 2.5e-3;

    /// Least and greatest stiffening of the triangles whose normal is near `towards`.
    fn range(mesh: (Vec<DVec3>, Vec<[u32; 3]>), towards: DVec3) -> [f64; 2] {
        let skin = skin::build(mesh.0, mesh.1);
        let mut range = [f64::INFINITY, 0.0f64];
        for (t, found) in skin.triangles.iter().zip(stiffening(&skin, CELL)) {
            let [a, b, c] = t.map(|v| skin.vertices[v as usize]);
            if (b - a).cross(c - a).normalize().dot(towards) > 0.99 {
                range = [range[0].min(f64::from(found)), range[1].max(f64::from(found))];
            }
        }
        range
    }

    #[test]
    fn what_covers_less_than_a_cell_is_stiffer_in_proportion() {
        let cuboid = |half: DVec3| {
            let (vertices, triangles, _) = layer::boundary(&layer::kuhn_box(-half, half, [1; 3]));
            (vertices, triangles)
        };
        assert_eq!(range(cuboid(DVec3::splat(0.01)), DVec3::Y), [1.0, 1.0]);
        // An edge 0.5 mm wide, which crosses the disc: very nearly a rectangle as long as the disc is wide.
        let [low, high] = range(cuboid(DVec3::new(0.00025, 0.01, 0.01)), DVec3::Y);
        let expected = 0.25 * std::f64::consts::PI * CELL / 5e-4;
        assert!((low / expected - 1.0).abs() < 0.05 && (high / low - 1.0).abs() < 0.02, "edge: {low} to {high}");
        // Its sides cover many cells, and so do those of a blade that is thinner than the cut is deep.
        for thickness in [5e-4, 3e-4, 1e-5] {
            let blade = cuboid(DVec3::new(0.5 * thickness, 0.01, 0.01));
            assert_eq!(range(blade, DVec3::X), [1.0, 1.0], "sides of a blade of {thickness} m");
        }
        // A ball of 1 mm, of facets as wide as a tenth of it, is cut at a depth of a fifth of a cell in a circle.
        let [low, high] = range(sphere::icosphere(0.001), DVec3::Y);
        let expected = 0.25 * CELL * CELL / (2.0 * 0.001 * DEPTH * CELL - (DEPTH * CELL).powi(2));
        assert!((low / expected - 1.0).abs() < 0.05 && (high / low - 1.0).abs() < 0.08, "ball: {low} to {high}");
        assert_eq!(range(sphere::icosphere(0.02), DVec3::Y), [1.0, 1.0]);
        // A point, which is far smaller than any cell.
        assert_eq!(range(sphere::icosphere(1e-5), DVec3::Y)[1], MOST);
    }
}
