//! Round bodies (families of closed surface meshes) for the proximity benchmark. The bodies of a family differ in their
//! number of vertices, but are identical, bit for bit, within a cap about one pole. Their vertices lie in rings about
//! the z axis, at a fixed spacing within the cap and ever coarser or finer beyond it.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

/// Beyond the cap, the spacing changes from ring to ring by at most this factor.
const GROWTH: f64 = 1.1;
/// Depth of the grooves of a lobed body, as a share of its radius; it is so great that the body gets several collision
/// proxies (convex hulls) instead of one.
const GROOVE: f64 = 0.4;
/// Number of lobes between the grooves.
const LOBES: f64 = 5.0;
/// Range of polar angles, from the cap's rim on, over which the depth of the grooves rises smoothly from zero, rad.
const ONSET: f64 = 0.7;

/// The properties that all bodies of a family share.
#[derive(Debug, Clone, Copy)]
pub struct Family {
    /// Radius of the body, m.
    pub radius: f64,
    /// Radius of the cap, measured along the surface from the pole at +z, m.
    pub cap: f64,
    /// Edge length of the triangles within the cap, m.
    pub spacing: f64,
    /// Whether grooves run down the body beyond the cap, as on a pumpkin; a body without grooves is a sphere.
    pub is_lobed: bool,
}

/// A closed surface mesh with counter-clockwise triangles seen from outside.
#[derive(Debug, Clone)]
pub struct Graded {
    /// Positions of the vertices, m; those of the cap come first.
    pub vertices: Vec<DVec3>,
    /// Triangles; those of the cap come first.
    pub triangles: Vec<[u32; 3]>,
}

/// The vertices at one polar angle (rad) from the pole at +z.
struct Ring {
    polar: f64,
    points: usize,
}

impl Family {
    /// The body whose number of vertices is nearest to `count`. The two numbers differ by a few per cent, unless the
    /// cap and the rings next to it, whose spacing is still close to the cap's, already have more vertices than
    /// `count`.
    pub fn member(&self, count: usize) -> Graded {
        let (mut fine, mut coarse) = (0.05 * self.spacing / self.radius, 0.5_f64);
        for _ in 0..50 {
            let middle = (fine * coarse).sqrt();
            if total(&self.rings(middle)) > count {
                fine = middle;
            } else {
                coarse = middle;
            }
        }
        let (more, fewer) = (self.rings(fine), self.rings(coarse));
        let is_nearer = total(&more).abs_diff(count) < total(&fewer).abs_diff(count);
        self.surface(if is_nearer { &more } else { &fewer })
    }

    /// Number of vertices and number of triangles in the cap.
    pub fn cap_counts(&self) -> (usize, usize) {
        let rings = self.cap_rings();
        (1 + 3 * rings * (rings + 1), 6 * rings * rings)
    }

    fn cap_rings(&self) -> usize {
        (self.cap / self.spacing).round().max(1.0) as usize
    }

    /// The rings between the poles; `far` is the angle between rings far from the cap, rad.
    fn rings(&self, far: f64) -> Vec<Ring> {
        let near = self.spacing / self.radius;
        let cap = self.cap_rings();
        let mut rings: Vec<Ring> = (1..=cap).map(|i| Ring { polar: i as f64 * near, points: 6 * i }).collect();
        let (mut polar, mut spacing) = (cap as f64 * near, near);
        loop {
            spacing = if far > near { (spacing * GROWTH).min(far) } else { (spacing / GROWTH).max(far) };
            polar += spacing;
            if polar > PI - 0.5 * spacing {
                return rings;
            }
            let points = (TAU * libm::sin(polar) / spacing).round().max(6.0) as usize;
            rings.push(Ring { polar, points });
        }
    }

    fn surface(&self, rings: &[Ring]) -> Graded {
        let mut vertices = vec![DVec3::Z * self.radius];
        let mut triangles = Vec::new();
        let first = rings.first().map_or(0, |ring| ring.points);
        triangles.extend((0..first).map(|k| [0, 1 + k, 1 + (k + 1) % first]));
        let mut last: Option<(usize, usize)> = None;
        for ring in rings {
            let start = vertices.len();
            let angle = |k: usize| TAU * k as f64 / ring.points as f64;
            vertices.extend((0..ring.points).map(|k| self.point(ring.polar, angle(k))));
            if let Some((inner, points)) = last {
                zip(&mut triangles, (inner, points), (start, ring.points));
            }
            last = Some((start, ring.points));
        }
        if let Some((start, points)) = last {
            let pole = vertices.len();
            triangles.extend((0..points).map(|k| [pole, start + (k + 1) % points, start + k]));
        }
        vertices.push(DVec3::Z * -self.radius);
        Graded { vertices, triangles: triangles.iter().map(|t| t.map(|v| v as u32)).collect() }
    }

    fn point(&self, polar: f64, angle: f64) -> DVec3 {
        let (sin, cos) = (libm::sin(polar), libm::cos(polar));
        let mut radius = self.radius;
        if self.is_lobed {
            let t = ((polar - self.cap / self.radius) / ONSET).clamp(0.0, 1.0);
            let depth = GROOVE * t * t * (3.0 - 2.0 * t) * sin * sin;
            radius *= 1.0 - depth * 0.5 * (1.0 - libm::cos(LOBES * angle));
        }
        radius * DVec3::new(sin * libm::cos(angle), sin * libm::sin(angle), cos)
    }
}

fn total(rings: &[Ring]) -> usize {
    2 + rings.iter().map(|ring| ring.points).sum::<usize>()
}

/// Joins two rings by triangles. Each ring is given by its first vertex and its number of vertices; each new triangle
/// advances on the ring whose next vertex has the smaller angle about the z axis.
fn zip(triangles: &mut Vec<[usize; 3]>, (inner, m): (usize, usize), (outer, n): (usize, usize)) {
    let (mut i, mut j) = (0, 0);
    while i < m || j < n {
        let (a, b) = (inner + i % m, outer + j % n);
        if i == m || (j < n && (j + 1) * m <= (i + 1) * n) {
            triangles.push([a, b, outer + (j + 1) % n]);
            j += 1;
        } else {
            triangles.push([a, b, inner + (i + 1) % m]);
            i += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use palpate::internal::prepare::{mass, skin};

    use super::*;

    const FAMILY: Family = Family { radius: 0.1, cap: 0.01, spacing: 0.001, is_lobed: true };

    #[test]
    fn members_are_closed_and_outward_and_have_the_vertices_asked_for() {
        for count in [3_000, 11_000, 44_000] {
            let Graded { vertices, triangles } = FAMILY.member(count);
            assert!(
                vertices.len().abs_diff(count) < count / 20,
                "the body has {} vertices, {count} were requested",
                vertices.len()
            );
            // By Euler's formula, a closed surface in one piece and without handles has this number of triangles.
            assert_eq!(triangles.len(), 2 * vertices.len() - 4);
            assert_eq!(skin::defects(&triangles), (0, 0));
            assert_eq!(skin::parts(vertices.len(), &triangles).1, 1);
            let ball = 4.0 / 3.0 * PI * 1e-3;
            let volume = mass::properties(&vertices, &triangles).volume;
            assert!(volume > 0.5 * ball && volume < 0.9 * ball, "volume {volume} m^3");
        }
    }

    #[test]
    fn members_have_the_same_cap_bit_for_bit() {
        let (few, many) = (FAMILY.member(2_000), FAMILY.member(30_000));
        let (vertices, triangles) = FAMILY.cap_counts();
        let bits =
            |graded: &Graded| graded.vertices[..vertices].iter().map(|v| v.to_array().map(f64::to_bits)).collect();
        let (a, b): (Vec<_>, Vec<_>) = (bits(&few), bits(&many));
        assert_eq!(a, b);
        assert_eq!(few.triangles[..triangles], many.triangles[..triangles]);
        assert!(few.triangles[..triangles].iter().flatten().all(|&v| (v as usize) < vertices));
        // No triangle beyond the cap has all its vertices in the cap.
        let within = |t: &&[u32; 3]| t.iter().all(|&v| (v as usize) < vertices);
        assert_eq!(many.triangles.iter().filter(within).count(), triangles);
        // Without grooves every vertex lies on the sphere.
        let sphere = Family { is_lobed: false, ..FAMILY }.member(2_000);
        assert!(sphere.vertices.iter().all(|v| (v.length() - 0.1).abs() < 1e-15));
    }
}
