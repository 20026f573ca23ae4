//! Surface of a spherical tool (the rigid body that the haptic device leads): an icosphere (subdivided icosahedron)
//! whose vertices all lie on the sphere, so that contact starts where the sphere begins.

use std::collections::BTreeMap;

use glam::DVec3;

/// Number of times that the icosahedron's edges are halved. The icosphere then has 2,562 vertices and 5,120 triangles.
const HALVINGS: usize = 4;

/// Vertices and triangles of an icosphere about the origin, oriented outwards, with every vertex at the distance
/// `radius` (m).
pub fn icosphere(radius: f64) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let (mut directions, mut triangles) = icosahedron();
    for _ in 0..HALVINGS {
        let mut middles = BTreeMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                directions.push((directions[a as usize] + directions[b as usize]).normalize());
                directions.len() as u32 - 1
            })
        };
        let mut finer = Vec::with_capacity(4 * triangles.len());
        for &[a, b, c] in &triangles {
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            finer.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        triangles = finer;
    }
    (directions.into_iter().map(|d| d * radius).collect(), triangles)
}

/// The twelve unit vertices of an icosahedron and its twenty outward triangles.
fn icosahedron() -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let golden = (1.0 + 5f64.sqrt()) / 2.0;
    let mut vertices = Vec::with_capacity(12);
    for axis in 0..3 {
        for (s, t) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
            let mut v = [0.0; 3];
            v[(axis + 1) % 3] = s;
            v[(axis + 2) % 3] = t * golden;
            vertices.push(DVec3::from_array(v).normalize());
        }
    }
    // The faces are the triples of mutually nearest vertices; two nearest vertices are one edge length apart.
    let edge = 2.0 / (1.0 + golden * golden).sqrt();
    let near = |a: usize, b: usize| (vertices[a].distance(vertices[b]) - edge).abs() < 1e-6;
    let mut triangles = Vec::with_capacity(20);
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if near(a, b) && near(b, c) && near(a, c) {
                    let outward = vertices[a].dot(vertices[b].cross(vertices[c])) > 0.0;
                    triangles.push(if outward { [a, b, c] } else { [a, c, b] }.map(|i| i as u32));
                }
            }
        }
    }
    (vertices, triangles)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::{mass, skin};

    #[test]
    fn the_icosphere_is_closed_round_and_fine() {
        let (vertices, triangles) = icosphere(0.01);
        assert_eq!((vertices.len(), triangles.len()), (2562, 5120));
        assert!(vertices.iter().all(|v| (v.length() - 0.01).abs() < 1e-17));
        let skin = skin::build(vertices, triangles);
        assert_eq!(skin::defects(&skin.triangles), (0, 0));
        let ball = 4.0 / 3.0 * std::f64::consts::PI * 1e-6;
        let volume = mass::properties(&skin.vertices, &skin.triangles).volume;
        // The volume of an inscribed polyhedron with edge e and radius r is below the ball's by a share of about
        // (e / r)^2 / 4; here e is 0.07 r.
        assert!(volume < ball && volume > 0.995 * ball, "volume {volume} m^3, expected up to 0.5 % below {ball} m^3");
    }
}
