//! Building blocks of the generated solids. A solid is a function of a point: negative inside, and near the solid's
//! surface about the signed distance of the point from the surface, m.
//!
//! Only additions, products, quotients and square roots are used. These are correctly rounded, so that a model is
//! bitwise the same on every machine.

use glam::DVec3;

/// An ellipsoid with axes along the coordinate axes: zero exactly on the surface, and near the surface the distance to
/// first order.
pub fn ellipsoid(p: DVec3, centre: DVec3, radii: DVec3) -> f64 {
    let scaled = (p - centre) / radii;
    let k0 = scaled.length();
    let k1 = (scaled / radii).length();
    if k1 == 0.0 { -radii.min_element() } else { k0 * (k0 - 1.0) / k1 }
}

/// A rod with round ends from `a` to `b`, whose radius changes linearly from `ra` to `rb`.
pub fn stick(p: DVec3, (a, ra): (DVec3, f64), (b, rb): (DVec3, f64)) -> f64 {
    let along = b - a;
    let t = ((p - a).dot(along) / along.length_squared()).clamp(0.0, 1.0);
    (p - a - t * along).length() - (ra + t * (rb - ra))
}

/// The union of two solids with a fillet about `k` (m) wide: a polynomial smooth minimum with continuous first
/// derivative.
pub fn join(a: f64, b: f64, k: f64) -> f64 {
    let overlap = (k - (a - b).abs()).max(0.0) / k;
    a.min(b) - overlap * overlap * k / 4.0
}

/// Solid `a` without solid `b`, with a fillet about `k` (m) wide.
pub fn carve(a: f64, b: f64, k: f64) -> f64 {
    -join(-a, b, k)
}

/// The intersection of two solids, with a fillet about `k` (m) wide.
pub fn meet(a: f64, b: f64, k: f64) -> f64 {
    -join(-a, -b, k)
}

/// The gradient of a solid's function, by central differences over `step` (m).
pub fn gradient(solid: &impl Fn(DVec3) -> f64, p: DVec3, step: f64) -> DVec3 {
    let slope = |axis: DVec3| (solid(p + axis * step) - solid(p - axis * step)) / (2.0 * step);
    DVec3::new(slope(DVec3::X), slope(DVec3::Y), slope(DVec3::Z))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signs_and_surfaces_are_where_they_should_be() {
        let r = DVec3::new(1.0, 2.0, 3.0);
        for p in [DVec3::X, DVec3::Y * 2.0, DVec3::Z * -3.0] {
            assert!(ellipsoid(p, DVec3::ZERO, r).abs() < 1e-15);
            assert!((gradient(&|q| ellipsoid(q, DVec3::ZERO, r), p, 1e-5).length() - 1.0).abs() < 1e-8);
        }
        assert_eq!(ellipsoid(DVec3::ZERO, DVec3::ZERO, r), -1.0);
        let s = |p| stick(p, (DVec3::ZERO, 1.0), (DVec3::X, 0.5));
        assert_eq!((s(DVec3::Y * 2.0), s(DVec3::new(3.0, 0.0, 0.0))), (1.0, 1.5));
        assert_eq!((join(1.0, 3.0, 0.5), carve(-1.0, 3.0, 0.5), meet(-1.0, 3.0, 0.5)), (1.0, -1.0, 3.0));
        assert!(join(1.0, 1.0, 0.4) == 0.9 && carve(-1.0, 1.0, 0.4) == -0.9 && meet(1.0, 1.0, 0.4) == 1.1);
    }
}
