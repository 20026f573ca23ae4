//! Broad phase of collision detection in f64: separation and penetration of convex hulls. Reference implementation of
//! the cull stage of a step.

use glam::DVec3;
use parry3d_f64::math::{Pose, Vector};
use parry3d_f64::query;
use parry3d_f64::shape::ConvexPolyhedron;

/// Separation of two point sets along a unit direction n from A to B, m: the least n . b over B minus the greatest
/// n . a over A; negative where the sets overlap along n.
pub fn separation_along(normal: DVec3, a: &[DVec3], b: &[DVec3]) -> f64 {
    let least = b.iter().map(|y| normal.dot(*y)).fold(f64::INFINITY, f64::min);
    let greatest = a.iter().map(|x| normal.dot(*x)).fold(f64::NEG_INFINITY, f64::max);
    least - greatest
}

/// The face normal of either hull (A's outward, B's reversed, so that all point from A to B) along which the separation
/// is greatest, and that separation, m. Where it is negative, its magnitude is the least penetration along a face
/// normal; the true penetration may be less, along a cross product of edges. If several normals have the greatest
/// separation, the first of them is returned; `None` if there are no faces.
pub fn best_face(a: &[DVec3], a_faces: &[(DVec3, f64)], b: &[DVec3], b_faces: &[(DVec3, f64)]) -> Option<(DVec3, f64)> {
    let normals = a_faces.iter().map(|f| f.0).chain(b_faces.iter().map(|f| -f.0));
    let mut best: Option<(DVec3, f64)> = None;
    for normal in normals {
        let separation = separation_along(normal, a, b);
        if best.is_none_or(|b| separation > b.1) {
            best = Some((normal, separation));
        }
    }
    best
}

/// Unit normal from A to B and signed distance, m, of the convex hulls of two point sets, by the library parry: GJK
/// where the hulls are apart, EPA where they overlap (negative distance). `None` where a hull is degenerate, or no
/// normal exists.
pub fn exact_distance(a: &[DVec3], b: &[DVec3]) -> Option<(DVec3, f64)> {
    let hull = |points: &[DVec3]| {
        let points: Vec<Vector> = points.iter().map(|p| Vector::new(p.x, p.y, p.z)).collect();
        ConvexPolyhedron::from_convex_hull(&points)
    };
    let (a, b) = (hull(a)?, hull(b)?);
    // Distance up to which parry looks for contacts, larger than any distance here; it must be finite.
    const REACH: f64 = 1e6;
    let contact = query::contact(&Pose::IDENTITY, &a, &Pose::IDENTITY, &b, REACH).ok()??;
    let normal = DVec3::new(contact.normal1.x, contact.normal1.y, contact.normal1.z);
    Some((normal, contact.dist))
}
