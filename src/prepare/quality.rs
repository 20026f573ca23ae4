//! Shape quality of the tetrahedra of a layer (simulation mesh of a soft body): their dihedral angles.

use glam::DVec3;

use super::{Layer, layer::FACES};

/// Dihedral angles of a layer, degrees.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Quality {
    /// The smallest dihedral angle of the layer.
    pub worst: f64,
    /// First percentile of the tetrahedra's smallest dihedral angles: only 1 in 100 tetrahedra has a smaller angle.
    pub first_percentile: f64,
    /// The largest dihedral angle of the layer.
    pub largest: f64,
    /// Index of the tetrahedron with the smallest angle.
    pub worst_tetrahedron: u32,
}

/// Smallest and largest dihedral angle of the tetrahedron with these corners (positions, m), degrees; 0 and 180 for a
/// flat tetrahedron.
pub fn dihedral(corners: [DVec3; 4]) -> (f64, f64) {
    let normals = FACES.map(|face| {
        let [a, b, c] = face.map(|k| corners[k]);
        (b - a).cross(c - a)
    });
    let (mut least, mut largest) = (180.0, 0.0);
    for i in 0..4 {
        for j in i + 1..4 {
            // The angle is computed from the sine and the cosine of the angle between outward normals, so that angles
            // near 0 and 180 degrees keep their precision.
            let sine = normals[i].cross(normals[j]).length();
            let angle = sine.atan2(-normals[i].dot(normals[j])).to_degrees();
            (least, largest) = (f64::min(least, angle), f64::max(largest, angle));
        }
    }
    (least, largest)
}

/// Dihedral angles of a layer; `None` if it has no tetrahedra.
pub fn quality(layer: &Layer) -> Option<Quality> {
    let angles: Vec<(f64, f64)> =
        layer.tetrahedra.iter().map(|t| dihedral(t.map(|n| layer.nodes[n as usize]))).collect();
    let worst = (0..angles.len()).min_by(|&a, &b| angles[a].0.total_cmp(&angles[b].0))?;
    let mut least: Vec<f64> = angles.iter().map(|a| a.0).collect();
    let (_, &mut first_percentile, _) = least.select_nth_unstable_by(angles.len() / 100, f64::total_cmp);
    let largest = angles.iter().map(|a| a.1).fold(0.0, f64::max);
    Some(Quality { worst: angles[worst].0, first_percentile, largest, worst_tetrahedron: worst as u32 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::layer;

    #[test]
    fn regular_right_and_flat_tetrahedra_have_the_textbook_angles() {
        let regular = [[1., 1., 1.], [1., -1., -1.], [-1., 1., -1.], [-1., -1., 1.]].map(DVec3::from_array);
        let third = (1.0f64 / 3.0).acos().to_degrees();
        let (least, largest) = dihedral(regular);
        assert!((least - third).abs() < 1e-9 && (largest - third).abs() < 1e-9);
        let (least, largest) = dihedral([DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z]);
        assert!((largest - 90.0).abs() < 1e-9 && (least - 3f64.sqrt().recip().acos().to_degrees()).abs() < 1e-9);
        let flat = dihedral([DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y, DVec3::Y]);
        assert_eq!(flat, (0.0, 180.0));
    }

    #[test]
    fn one_bad_tetrahedron_is_the_worst_and_not_the_first_percentile() {
        let mut layer = layer::kuhn_box(DVec3::ZERO, DVec3::ONE, [5, 5, 5]);
        let good = quality(&layer).unwrap();
        assert!((good.worst - 45.0).abs() < 1e-9 && (good.largest - 90.0).abs() < 1e-9);
        let [a, b, c, _] = layer.tetrahedra[100].map(|n| layer.nodes[n as usize]);
        layer.nodes.push((a + b + c) / 3.0 + 0.01 * (b - a).cross(c - a));
        layer.tetrahedra[100][3] = 216;
        let spoiled = quality(&layer).unwrap();
        assert_eq!(spoiled.worst_tetrahedron, 100);
        assert!(spoiled.worst < 5.0 && spoiled.first_percentile > 44.0, "angles of the spoiled layer: {spoiled:?}");
        assert!(quality(&Layer::default()).is_none());
    }
}
