//! Broad phase of collision detection in f64: placement and bounds of collision proxies (convex hulls of parts of a
//! skin), embedding of the skin (surface mesh of a body), and the contact normal of a pair of proxies. Reference
//! implementation of the pose, skin and cull stages of a step; bounds of parts of a skin are in
//! [`super::contact_patches`], contacts in [`super::contact`].

use glam::{DQuat, DVec3};

use super::cull::{exact_distance, separation_along};

/// A face plane, n . x = offset: its unit normal n and its offset, m.
pub type Face = (DVec3, f64);

/// World position of a point of a rigid coordinate frame, given by its rest position.
pub fn place(centre: DVec3, rotation: DQuat, rest: DVec3) -> DVec3 {
    centre + rotation * rest
}

/// World plane of a face of a rigid coordinate frame, given by its rest plane.
pub fn place_face(centre: DVec3, rotation: DQuat, rest: Face) -> Face {
    let normal = rotation * rest.0;
    (normal, rest.1 + normal.dot(centre))
}

/// World position of a skin vertex, from the positions of the four nodes of its tetrahedron in their rigid coordinate
/// frame, and from its weights on these nodes.
pub fn embed(centre: DVec3, rotation: DQuat, nodes: [DVec3; 4], weights: [f64; 4]) -> DVec3 {
    place(centre, rotation, nodes.iter().zip(weights).map(|(x, w)| *x * w).sum())
}

/// Bounds of a collision proxy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Least corner of the hull's box, m.
    pub low: DVec3,
    /// Greatest corner, m.
    pub high: DVec3,
    /// How far the skin may lie outside the hull, m.
    pub inflation: f64,
}

/// Bounds of a hull: its box, and the inflation margin + weight_bound * (greatest displacement of a node);
/// `weight_bound` is the greatest sum of the absolute weights of a skin vertex.
pub fn bounds(hull: &[DVec3], margin: f64, weight_bound: f64, displacements: &[DVec3]) -> Bounds {
    let low = hull.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let high = hull.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    let largest = displacements.iter().map(|d| d.length()).fold(0.0, f64::max);
    Bounds { low, high, inflation: margin + weight_bound * largest }
}

/// Whether two hulls are no farther apart than `reach` (m), by the library parry3d; `None` where parry3d finds no
/// answer.
pub fn pairs(a: &[DVec3], b: &[DVec3], reach: f64) -> Option<bool> {
    Some(exact_distance(a, b)?.1 <= reach)
}

/// Blended contact normal from hull a to hull b, and the greatest separation s_max along a face normal, m. A face
/// normal n with separation s has the weight max(0, 1 - (s_max - s) / blend)^2. Where the normals cancel, the first
/// face normal with s_max is returned. `None` without faces.
pub fn direction(a: &[DVec3], a_faces: &[Face], b: &[DVec3], b_faces: &[Face], blend: f64) -> Option<(DVec3, f64)> {
    let (sum, weights, best, greatest) = blended(a, a_faces, b, b_faces, blend)?;
    Some((if sum.length() > CANCELLED * weights { sum.normalize() } else { best }, greatest))
}

/// Whether the face normals cancel in [`direction`], or so nearly that rounding may decide which normal it returns.
pub fn nearly_cancels(a: &[DVec3], a_faces: &[Face], b: &[DVec3], b_faces: &[Face], blend: f64) -> bool {
    blended(a, a_faces, b, b_faces, blend).is_none_or(|(sum, weights, ..)| sum.length() < 1.01 * CANCELLED * weights)
}

/// The weighted sum of the face normals, the sum of their weights, the first normal with the greatest separation, and
/// this separation, m.
fn blended(
    a: &[DVec3],
    a_faces: &[Face],
    b: &[DVec3],
    b_faces: &[Face],
    blend: f64,
) -> Option<(DVec3, f64, DVec3, f64)> {
    let normals: Vec<DVec3> = a_faces.iter().map(|f| f.0).chain(b_faces.iter().map(|f| -f.0)).collect();
    let separations: Vec<f64> = normals.iter().map(|n| separation_along(*n, a, b)).collect();
    let greatest = separations.iter().copied().reduce(f64::max)?;
    let weight = |s: &f64| (1.0 - (greatest - s) / blend).max(0.0).powi(2);
    let sum = normals.iter().zip(&separations).map(|(n, s)| *n * weight(s)).sum();
    let best = separations.iter().position(|s| *s == greatest)?;
    Some((sum, separations.iter().map(weight).sum(), normals[best], greatest))
}

/// Length of a weighted mean of unit directions below which they count as cancelled.
pub const CANCELLED: f64 = 0.1;

/// Weighted mean of directions, normalised; where the directions cancel, the direction of the greatest weight; `None`
/// where no direction has weight.
pub fn mean_direction(directions: &[(DVec3, f64)]) -> Option<DVec3> {
    let sum: DVec3 = directions.iter().map(|(n, w)| *n * *w).sum();
    let weights: f64 = directions.iter().map(|d| d.1).sum();
    let heaviest = directions.iter().max_by(|x, y| x.1.total_cmp(&y.1)).filter(|d| d.1 > 0.0)?;
    Some(if sum.length() > CANCELLED * weights { sum.normalize() } else { heaviest.0 })
}

/// Box of hulls along three axes, each hull given with its inflation (m): least and greatest corner.
pub fn side_box(axes: [DVec3; 3], hulls: &[(&[DVec3], f64)]) -> (DVec3, DVec3) {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for (hull, inflation) in hulls {
        for x in *hull {
            let along = DVec3::from_array(axes.map(|axis| axis.dot(*x)));
            low = low.min(along - *inflation);
            high = high.max(along + *inflation);
        }
    }
    (low, high)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CUBE_FACES: [DVec3; 6] = [DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z];

    fn cube(centre: DVec3) -> (Vec<DVec3>, Vec<Face>) {
        let corner = |k: usize| DVec3::from_array([k & 1, k >> 1 & 1, k >> 2].map(|bit| bit as f64 - 0.5)) + centre;
        ((0..8).map(corner).collect(), CUBE_FACES.map(|n| (n, 0.5 + n.dot(centre))).to_vec())
    }

    #[test]
    fn cubes_part_along_the_axis_between_them() {
        let ((a, a_faces), (b, b_faces)) = (cube(DVec3::ZERO), cube(DVec3::X * 0.9));
        let (n, s) = direction(&a, &a_faces, &b, &b_faces, 0.2).unwrap();
        assert!((n - DVec3::X).length() < 1e-12 && (s + 0.1).abs() < 1e-12);
        // Where the cubes coincide all normals have equal separation and cancel, so the first is returned.
        assert_eq!(direction(&a, &a_faces, &a, &a_faces, 0.2).unwrap().0, DVec3::X);
        assert_eq!(pairs(&a, &b, 0.0), Some(true));
        assert_eq!(pairs(&a, &cube(DVec3::X * 1.3).0, 0.29), Some(false));
    }

    #[test]
    fn directions_that_cancel_leave_the_heaviest() {
        let (x, y) = (DVec3::X, DVec3::Y);
        assert_eq!(mean_direction(&[(x, 1.0), (-x, 1.01)]), Some(-x));
        assert!((mean_direction(&[(x, 1.0), (y, 1.0)]).unwrap() - (x + y).normalize()).length() < 1e-15);
        assert_eq!(mean_direction(&[(x, 0.0)]), None);
    }
}
