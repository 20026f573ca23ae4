//! Mass properties of the solid inside a closed triangle mesh, by the divergence theorem: as sums over signed
//! tetrahedra, one for each triangle, whose fourth corner is a common origin.
//!
//! The second moments of such a tetrahedron follow B. Mirtich 1996, "Fast and accurate computation of polyhedral mass
//! properties", in the form of F. Tonon 2004, which uses the sum of the corners.

use glam::{DMat3, DVec3};

/// Mass properties at unit density.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Properties {
    /// Volume, m^3; negative if the surface is oriented inwards, about 0 if it is flat. It has no meaning if the
    /// surface is open.
    pub volume: f64,
    /// Centroid, m.
    pub centroid: DVec3,
    /// Inertia tensor about the centroid, m^5 (kg m^2 per kg/m^3).
    pub inertia: DMat3,
}

/// Volume, centroid and inertia of the solid of unit density inside a closed surface that is oriented outwards.
pub fn properties(vertices: &[DVec3], triangles: &[[u32; 3]]) -> Properties {
    // Coordinates are taken relative to a point of the surface: for a surface far from the origin, large terms of the
    // sums would otherwise cancel and leave rounding errors.
    let base = vertices.first().copied().unwrap_or_default();
    let (mut volume, mut first, mut second) = (0.0, DVec3::ZERO, DMat3::ZERO);
    for t in triangles {
        let [a, b, c] = t.map(|i| vertices[i as usize] - base);
        let v = a.dot(b.cross(c)) / 6.0;
        let sum = a + b + c;
        volume += v;
        first += v / 4.0 * sum;
        second += v / 20.0 * (outer(a) + outer(b) + outer(c) + outer(sum));
    }
    let offset = if volume == 0.0 { DVec3::ZERO } else { first / volume };
    let about = second - volume * outer(offset);
    let trace = about.x_axis.x + about.y_axis.y + about.z_axis.z;
    Properties { volume, centroid: base + offset, inertia: DMat3::from_diagonal(DVec3::splat(trace)) - about }
}

/// Outer product v v^T.
fn outer(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::{layer, sphere};

    #[test]
    fn a_box_far_from_the_origin_has_the_textbook_inertia() {
        let (low, size) = (DVec3::new(1000.0, -50.0, 3.0), DVec3::new(0.2, 0.5, 0.7));
        let (vertices, triangles, _) = layer::boundary(&layer::kuhn_box(low, low + size, [2, 3, 1]));
        let p = properties(&vertices, &triangles);
        let volume = size.x * size.y * size.z;
        assert!((p.volume - volume).abs() < 1e-10 * volume);
        assert!(p.centroid.distance(low + size / 2.0) < 1e-10);
        let s = size * size;
        let want = DMat3::from_diagonal(volume / 12.0 * DVec3::new(s.y + s.z, s.x + s.z, s.x + s.y));
        assert!(
            (p.inertia - want).to_cols_array().iter().all(|e| e.abs() < 1e-9 * volume),
            "wrong inertia tensor {:?} m^5",
            p.inertia
        );
    }

    #[test]
    fn a_sphere_converges_to_two_fifths() {
        let (mut vertices, triangles) = sphere::icosphere(0.3);
        let ball = properties(&vertices, &triangles);
        let want = 0.4 * 0.09 * ball.volume;
        for e in [ball.inertia.x_axis.x, ball.inertia.y_axis.y, ball.inertia.z_axis.z] {
            // The polyhedron is inscribed in the sphere, so its radius of gyration is a little shorter than the
            // sphere's; the relative difference is less than the relative difference of the volumes.
            assert!(e < want && e > 0.995 * want, "moment of inertia {e} m^5, expected a little less than {want} m^5");
        }
        // An inward orientation gives a negative volume; surfaces with such a volume are refused.
        for v in &mut vertices {
            v.x = -v.x;
        }
        assert!(properties(&vertices, &triangles).volume < 0.0);
    }
}
