//! Decimation of the meshes that cast shadows in a rendered image: fewer triangles over the same vertices, by
//! clustering vertices on a lattice (J. Rossignac and P. Borrel 1993, "Multi-resolution 3D approximations for rendering
//! complex scenes").

use std::collections::{HashMap, HashSet};

use glam::DVec3;

/// The triangles with each corner replaced by the first vertex in the corner's lattice cell. Triangles of which two
/// corners are then equal are left out. Lattice cells have edges of `cell` m.
pub fn clustered(vertices: &[DVec3], triangles: &[[u32; 3]], cell: f64) -> Vec<[u32; 3]> {
    let mut first: HashMap<[i64; 3], u32> = HashMap::new();
    let place = |x: &DVec3| (*x / cell).floor().to_array().map(|x| x as i64);
    let of: Vec<u32> = vertices.iter().zip(0..).map(|(x, i)| *first.entry(place(x)).or_insert(i)).collect();
    let mut seen = HashSet::new();
    let moved = triangles.iter().map(|t| t.map(|i| of[i as usize]));
    moved
        .filter(|[a, b, c]| a != b && b != c && c != a)
        .filter(|t| {
            // Of triangles with equal corners in the same cyclic order only the first is kept.
            let least = (0..3).min_by_key(|k| t[*k]).unwrap_or(0);
            seen.insert([t[least], t[(least + 1) % 3], t[(least + 2) % 3]])
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A unit square in the plane z = 0, of n x n cells with two triangles each.
    fn square(n: u32) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let at = |i: u32, k: u32| DVec3::new(f64::from(i) / f64::from(n), f64::from(k) / f64::from(n), 0.0);
        let vertices = (0..=n).flat_map(|k| (0..=n).map(move |i| at(i, k))).collect();
        let index = |i: u32, k: u32| k * (n + 1) + i;
        let cells = (0..n).flat_map(|k| (0..n).map(move |i| (i, k)));
        let triangles = cells.flat_map(|(i, k)| {
            let [a, b, c, d] = [index(i, k), index(i + 1, k), index(i + 1, k + 1), index(i, k + 1)];
            [[a, b, c], [a, c, d]]
        });
        (vertices, triangles.collect())
    }

    #[test]
    fn few_triangles_cover_what_many_did() {
        let (vertices, triangles) = square(64);
        let few = clustered(&vertices, &triangles, 0.125);
        assert!(few.len() <= 2 * 9 * 9 && few.len() >= 2 * 7 * 7, "clustering left {} triangles", few.len());
        let area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| vertices[i as usize]);
            0.5 * (b - a).cross(c - a).z
        };
        let total: f64 = few.iter().map(area).sum();
        assert!((total - 1.0).abs() < 0.15, "total area {total} m^2, expected about 1 m^2");
        assert!(few.iter().all(|t| area(t) > 0.0), "no triangle may be reversed");
    }

    #[test]
    fn cells_smaller_than_edges_leave_all() {
        let (vertices, triangles) = square(5);
        assert_eq!(clustered(&vertices, &triangles, 0.01), triangles);
    }
}
