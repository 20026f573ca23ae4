//! Overlap of two skins (surface meshes) in f64, seen along the normal of a contact patch: for each triangle of one
//! skin, the area that lies inside the other body, and the integral of the depth over it. Reference implementation of
//! kernel depth/overlaps, and of the net force that a penalty pressure has where no skin vertex stands for the skin
//! around it.
//!
//! Each pair of triangles is clipped and integrated by itself, without any search structure. The depth of a point is
//! linear over a pair, so its integral over a part of the plane is area times the depth at the part's centroid.

use glam::{DVec2, DVec3};

/// The overlap of one triangle.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Overlap {
    /// Area of the part inside the other body, projected along the normal, m^2.
    pub area: f64,
    /// Integral of the depth over that part, m^3.
    pub volume: f64,
    /// Integral of depth times stiffening, m^3: the stiffening is that of the triangle of B.
    pub stiff_volume: f64,
    /// Integral of depth times stiffening times world position on the triangle, m^4; divided by `stiff_volume`, the
    /// centre of pressure.
    pub moment: DVec3,
    /// Integral of the depth times a unit normal out of A, m^3: of the mean of A's outward and B's inward normal, each
    /// weighted by the fourth power of its cosine to the patch's normal.
    pub push: DVec3,
    /// Greatest depth, m.
    pub deepest: f64,
}

/// Cosine of the angle between a triangle's normal and the patch's below which the triangle is seen edge-on.
const EDGE_ON: f64 = 0.001;

/// Mean depth, in units of A's thickness, from which on what lies behind B counts less, and at which it does not count.
const THIN: [f64; 2] = [0.8, 1.2];

/// For each triangle of skin A: its overlap with skin B along the unit normal `normal`, which points from A to B. B
/// must be convex; `stiffening` has a factor of the pressure for each of its triangles. Triangles of A that face away
/// from B have none. What lies behind B's far side is no overlap where A is thin, that is, where A's far side is nearer
/// to the centre of pressure than the overlap's mean depth; the change is smooth.
pub fn overlaps(
    normal: DVec3,
    a_positions: &[DVec3],
    a_triangles: &[[u32; 3]],
    b_positions: &[DVec3],
    b_triangles: &[[u32; 3]],
    stiffening: &[f64],
) -> Vec<Overlap> {
    let (u, v) = normal.any_orthonormal_pair();
    let flat = |x: DVec3| DVec3::new(u.dot(x), v.dot(x), normal.dot(x));
    let facets = |positions: &[DVec3], triangles: &[[u32; 3]]| -> Vec<[DVec3; 3]> {
        triangles.iter().map(|t| t.map(|v| flat(positions[v as usize]))).collect()
    };
    let (own, other) = (facets(a_positions, a_triangles), facets(b_positions, b_triangles));
    own.iter()
        .map(|p| {
            if cosine(p) <= EDGE_ON {
                return Overlap::default();
            }
            let mut sum = Overlap::default();
            let mut behind = 0.0;
            for (q, stiffening) in other.iter().zip(stiffening) {
                let faces = -cosine(q);
                let apart = (0..2).any(|k| {
                    let [low, high] = [f64::min, f64::max].map(|of| [p, q].map(|t| of(of(t[0][k], t[1][k]), t[2][k])));
                    low[0] > high[1] || low[1] > high[0]
                });
                if apart || faces.abs() <= EDGE_ON {
                    continue;
                }
                let part = part(p, q);
                if faces < 0.0 {
                    behind += part.area;
                } else {
                    sum.area += part.area;
                    sum.volume += part.volume;
                    sum.stiff_volume += stiffening * part.volume;
                    sum.moment += *stiffening * part.moment;
                    let mean = cosine(p).powi(4) * unit(p) - faces.powi(4) * unit(q);
                    sum.push += part.volume * mean.normalize();
                    sum.deepest = sum.deepest.max(part.deepest);
                }
            }
            let centre = (sum.moment / sum.stiff_volume).truncate();
            let gaps = own.iter().filter(|q| behind > 0.0 && cosine(q) < -EDGE_ON && contains(q, centre));
            let gaps = gaps.map(|q| height(p, centre) - height(q, centre)).filter(|gap| *gap > 0.0);
            let beyond = sum.volume / sum.area / gaps.fold(f64::INFINITY, f64::min);
            let t = ((beyond - THIN[0]) / (THIN[1] - THIN[0])).clamp(0.0, 1.0);
            let share = if sum.area > 0.0 { 1.0 - t * t * (3.0 - 2.0 * t) * (behind / sum.area).min(1.0) } else { 0.0 };
            let world = |m: DVec3| m.x * u + m.y * v + m.z * normal;
            Overlap {
                area: share * sum.area,
                volume: share * sum.volume,
                stiff_volume: share * sum.stiff_volume,
                moment: share * world(sum.moment),
                push: share * world(sum.push),
                deepest: sum.deepest,
            }
        })
        .collect()
}

/// Unit normal of a triangle.
fn unit([a, b, c]: &[DVec3; 3]) -> DVec3 {
    (*b - *a).cross(*c - *a).normalize_or_zero()
}

/// Component along the patch's normal of a triangle's unit normal.
fn cosine(triangle: &[DVec3; 3]) -> f64 {
    unit(triangle).z
}

/// Height of the plane through a triangle, given by coordinates along two tangents and the normal.
fn height(t: &[DVec3; 3], x: DVec2) -> f64 {
    let n = (t[1] - t[0]).cross(t[2] - t[0]);
    t[0].z - (n.x * (x.x - t[0].x) + n.y * (x.y - t[0].y)) / n.z
}

/// Whether a point of the plane lies in a triangle, seen along the normal.
fn contains(t: &[DVec3; 3], x: DVec2) -> bool {
    let side = |k: usize| (t[(k + 1) % 3] - t[k]).truncate().perp_dot(x - t[k].truncate());
    let sides = [side(0), side(1), side(2)];
    sides.iter().all(|s| *s >= 0.0) || sides.iter().all(|s| *s <= 0.0)
}

/// The part of triangle p above triangle q, both given by coordinates along two tangents and the normal.
fn part(p: &[DVec3; 3], q: &[DVec3; 3]) -> Overlap {
    let depth = |x: DVec2| height(p, x) - height(q, x);
    let mut polygon: Vec<DVec2> = p.iter().map(|x| x.truncate()).collect();
    let turned = (q[1] - q[0]).truncate().perp_dot((q[2] - q[0]).truncate()).signum();
    for k in 0..3 {
        let (from, along) = (q[k].truncate(), (q[(k + 1) % 3] - q[k]).truncate());
        polygon = clipped(&polygon, |x| turned * along.perp_dot(x - from));
    }
    polygon = clipped(&polygon, depth);
    let mut sum = Overlap::default();
    for k in 1..polygon.len().saturating_sub(1) {
        let corners = [polygon[0], polygon[k], polygon[k + 1]];
        let area = 0.5 * (corners[1] - corners[0]).perp_dot(corners[2] - corners[0]).abs();
        // The product of two linear functions is integrated exactly by the midpoints of the three edges.
        for (i, k) in [(0, 1), (1, 2), (2, 0)] {
            let x = 0.5 * (corners[i] + corners[k]);
            sum.moment += area / 3.0 * depth(x) * x.extend(height(p, x));
        }
        sum.area += area;
        sum.volume += area * depth((corners[0] + corners[1] + corners[2]) / 3.0);
        sum.deepest = corners.iter().map(|x| depth(*x)).fold(sum.deepest, f64::max);
    }
    sum
}

/// The part of a convex polygon in which a linear function is not negative (Sutherland and Hodgman 1974).
fn clipped(polygon: &[DVec2], value: impl Fn(DVec2) -> f64) -> Vec<DVec2> {
    let mut kept = Vec::new();
    for (k, x) in polygon.iter().enumerate() {
        let before = polygon[(k + polygon.len() - 1) % polygon.len()];
        let (own, last) = (value(*x), value(before));
        if (own >= 0.0) != (last >= 0.0) {
            kept.push(before + last / (last - own) * (*x - before));
        }
        if own >= 0.0 {
            kept.push(*x);
        }
    }
    kept
}

/// Integral of depth times stiffening (m^3) over all overlaps, and its first moment (m^4) at the places on A.
pub fn total(overlaps: &[Overlap]) -> (f64, DVec3) {
    overlaps.iter().fold((0.0, DVec3::ZERO), |(volume, moment), o| (volume + o.stiff_volume, moment + o.moment))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of 2 by 2 m that faces up, as two triangles, at a height.
    fn square(height: f64, up: bool) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
        let vertices = corners.map(|(x, y)| DVec3::new(x, y, height)).to_vec();
        (vertices, if up { vec![[0, 1, 2], [0, 2, 3]] } else { vec![[0, 2, 1], [0, 3, 2]] })
    }

    #[test]
    fn a_corner_in_a_plane_has_the_volume_of_a_tetrahedron() {
        // Three faces of a cube whose corner points down, 0.1 m below a plane: a tetrahedron of height h whose base
        // has the area 3 sqrt(3) / 2 h^2, so a volume of sqrt(3) / 2 h^3.
        let (a, triangles) = square(0.0, true);
        let edges = [0.0f64, 120.0, 240.0].map(|turn| {
            let (sin, cos) = turn.to_radians().sin_cos();
            DVec3::new((2.0f64 / 3.0).sqrt() * cos, (2.0f64 / 3.0).sqrt() * sin, (1.0f64 / 3.0).sqrt())
        });
        let tip = DVec3::new(0.03, -0.02, -0.1);
        let vertices = vec![
            tip,
            tip + edges[0],
            tip + edges[1],
            tip + edges[2],
            tip + edges[0] + edges[1],
            tip + edges[1] + edges[2],
            tip + edges[2] + edges[0],
        ];
        let faces = [[0, 1, 4, 2], [0, 2, 5, 3], [0, 3, 6, 1]];
        let b: Vec<[u32; 3]> = faces.iter().flat_map(|f: &[u32; 4]| [[f[0], f[2], f[1]], [f[0], f[3], f[2]]]).collect();
        let found = overlaps(DVec3::Z, &a, &triangles, &vertices, &b, &vec![1.0; b.len()]);
        let (volume, moment) = total(&found);
        let expected = 3f64.sqrt() / 2.0 * 1e-3;
        assert!((volume / expected - 1.0).abs() < 1e-9, "{volume} m^3 instead of {expected}");
        let centre = moment / volume;
        assert!((centre - DVec3::new(0.03, -0.02, 0.0)).length() < 1e-9, "centre of pressure {centre}");
        assert!((found.iter().map(|o| o.deepest).fold(0.0, f64::max) - 0.1).abs() < 1e-9);
        let area: f64 = found.iter().map(|o| o.area).sum();
        assert!((area / (1.5 * 3f64.sqrt() * 1e-2) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn what_lies_behind_the_far_side_is_outside_where_the_own_body_is_thin() {
        let (mut a, mut triangles) = square(0.0, true);
        let (mut b, mut b_triangles) = square(-0.3, false);
        let (top, others) = square(-0.1, true);
        b_triangles.extend(others.iter().map(|t| t.map(|v| v + b.len() as u32)));
        b.extend(top);
        let (volume, _) = total(&overlaps(DVec3::Z, &a, &triangles, &b, &b_triangles, &vec![1.0; b_triangles.len()]));
        assert!((volume - 1.2).abs() < 1e-12, "a thick body: {volume} m^3");
        let (under, others) = square(-0.05, false);
        triangles.extend(others.iter().map(|t| t.map(|v| v + a.len() as u32)));
        a.extend(under);
        assert_eq!(total(&overlaps(DVec3::Z, &a, &triangles, &b, &b_triangles, &vec![1.0; b_triangles.len()])).0, 0.0);
        b[4..].iter_mut().for_each(|x| x.z = 0.1);
        let (volume, _) = total(&overlaps(DVec3::Z, &a, &triangles, &b, &b_triangles, &vec![1.0; b_triangles.len()]));
        assert!((volume - 1.2).abs() < 1e-12);
    }
}
