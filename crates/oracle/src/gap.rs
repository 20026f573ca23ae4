//! The shortest ways from a tool (rigid body that a haptic device moves) to a skin (surface mesh of a soft body), by
//! trying all pairs of vertices and triangles. Reference implementation of the shader `wrench/gap`.

use glam::DVec3;

/// A triangle mesh: positions of its vertices, m, and vertex indices of its triangles.
pub type Mesh<'a> = (&'a [DVec3], &'a [[u32; 3]]);

/// A way from the tool to a skin: from a vertex of the tool to the nearest point of a triangle of the skin, or from the
/// nearest point of a triangle of the tool to a vertex of the skin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Way {
    /// Vector from the tool to the skin, m.
    pub along: DVec3,
    /// Index of the triangle, in the skin or in the tool.
    pub triangle: usize,
    /// Whether the triangle faces the vertex.
    pub faces: bool,
    /// Cosine of the angle between the way and the triangle's normal, at most 90 degrees; 1 where the way has no length.
    pub cosine: f64,
}

/// The point of a triangle nearest to `x`, by Voronoi regions (Ericson, "Real-Time Collision Detection", 2005, 5.1.5).
pub fn nearest_of_triangle(x: DVec3, [a, b, c]: [DVec3; 3]) -> DVec3 {
    let (ab, ac) = (b - a, c - a);
    let [(d1, d2), (d3, d4), (d5, d6)] = [a, b, c].map(|corner| (ab.dot(x - corner), ac.dot(x - corner)));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let (of_a, of_b, of_c) = (d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2);
    if of_c <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + ab * (d1 / (d1 - d3));
    }
    if of_b <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * (d2 / (d2 - d6));
    }
    let (from_b, from_c) = (d4 - d3, d5 - d6);
    if of_a <= 0.0 && from_b >= 0.0 && from_c >= 0.0 {
        return b + (c - b) * (from_b / (from_b + from_c));
    }
    a + (ab * of_b + ac * of_c) / (of_a + of_b + of_c)
}

/// The ways from a point to the triangles of a mesh.
pub fn from_point<'a>(x: DVec3, (positions, triangles): Mesh<'a>) -> impl Iterator<Item = Way> + 'a {
    triangles.iter().enumerate().map(move |(triangle, corners)| {
        let [a, b, c] = corners.map(|i| positions[i as usize]);
        let normal = (b - a).cross(c - a);
        let along = nearest_of_triangle(x, [a, b, c]) - x;
        let cosine = if along == DVec3::ZERO { 1.0 } else { normal.normalize().dot(along.normalize()).abs() };
        Way { along, triangle, faces: normal.dot(x - a) >= 0.0, cosine }
    })
}

/// The ways from the tool's vertices to the skin's triangles, and from the tool's triangles to the skin's vertices.
pub fn from_surface<'a>(tool: Mesh<'a>, skin: Mesh<'a>) -> impl Iterator<Item = Way> + 'a {
    let to_triangles = tool.0.iter().flat_map(move |x| from_point(*x, skin));
    let back = move |x: &DVec3| from_point(*x, tool).map(|way| Way { along: -way.along, ..way });
    to_triangles.chain(skin.0.iter().flat_map(back))
}

/// The shortest of the ways whose triangle faces the vertex (`faces` true) or faces away from the vertex (`faces`
/// false); `None` if there is no such way.
pub fn shortest(ways: impl Iterator<Item = Way>, faces: bool) -> Option<Way> {
    ways.filter(|way| way.faces == faces).min_by(|a, b| a.along.length().total_cmp(&b.along.length()))
}

/// The ways to the planes of those triangles that face the point at an angle of at least this cosine between way and
/// normal.
pub fn to_planes<'a>(x: DVec3, mesh: Mesh<'a>, cosine: f64) -> impl Iterator<Item = Way> + 'a {
    from_point(x, mesh).filter(move |way| way.faces && way.cosine >= cosine).map(move |way| {
        let [a, b, c] = mesh.1[way.triangle].map(|i| mesh.0[i as usize]);
        Way { along: (a - x).project_onto((b - a).cross(c - a)), ..way }
    })
}

/// Digits of the sector of a direction of length 1: 1 where a component is more than a half, -1 where it is less than
/// minus a half, else 0.
pub fn sector_of(direction: DVec3) -> [i32; 3] {
    direction.to_array().map(|x| i32::from(x > 0.5) - i32::from(x < -0.5))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_region_of_a_triangle_by_hand() {
        let corners = [DVec3::ZERO, DVec3::X * 2.0, DVec3::Y * 2.0];
        for (x, want) in [
            ([0.5, 0.5, 3.0], [0.5, 0.5, 0.0]),
            ([-1.0, -1.0, 1.0], [0.0, 0.0, 0.0]),
            ([3.0, -1.0, 1.0], [2.0, 0.0, 0.0]),
            ([-1.0, 3.0, -1.0], [0.0, 2.0, 0.0]),
            ([1.0, -2.0, 1.0], [1.0, 0.0, 0.0]),
            ([-2.0, 1.5, 0.0], [0.0, 1.5, 0.0]),
            ([2.0, 2.0, 1.0], [1.0, 1.0, 0.0]),
        ] {
            assert!(
                (nearest_of_triangle(x.into(), corners) - DVec3::from(want)).length() < 1e-15,
                "wrong nearest point of the triangle for the point {x:?} m"
            );
        }
    }

    #[test]
    fn a_tool_before_a_triangle_and_behind_it() {
        let skin = ([DVec3::ZERO, DVec3::X * 2.0, DVec3::Y * 2.0], [[0, 1, 2]]);
        let skin = (&skin.0[..], &skin.1[..]);
        let at = |z: f64| from_point(DVec3::new(0.5, 0.5, z), skin).next().unwrap();
        assert_eq!((at(3.0).along, at(3.0).faces, at(-3.0).faces), (-DVec3::Z * 3.0, true, false));
        assert_eq!(at(3.0).cosine, 1.0);
        // Beside the triangle the way meets it at 45 degrees; its plane is straight below.
        let beside = |cosine: f64| to_planes(DVec3::new(-1.0, 1.0, 1.0), skin, cosine).next();
        assert!(beside(0.7).is_some_and(|way| way.along.distance(-DVec3::Z) < 1e-15) && beside(0.71).is_none());
        assert_eq!(sector_of(DVec3::new(0.8, 0.0, -0.6)), [1, 0, -1]);
        // No vertex of the tool lies over the skin; the skin's vertex at the origin lies under an edge of the tool.
        let tool = ([DVec3::new(-1.0, 1.0, 1.0), DVec3::new(1.0, -1.0, 1.0), DVec3::new(-1.0, -1.0, 1.0)], [[0, 1, 2]]);
        let ways: Vec<Way> = from_surface((&tool.0, &tool.1), skin).collect();
        assert_eq!(ways.len(), 6);
        let least = shortest(ways.into_iter(), true).unwrap();
        assert!((least.along + DVec3::Z).length() < 1e-15, "shortest way: {least:?}");
    }
}
