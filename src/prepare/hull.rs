//! Convex hulls of points, for the collision proxies that cover a body's surface. A hull always has a volume, and no
//! two of its faces lie in one plane. A *reduced* hull, which may leave some of the points outside, has at most 64
//! corners.

use glam::DVec3;
use parry3d_f64::math::Vector;
use parry3d_f64::transformation::try_convex_hull;

use super::MAX_HULL_VERTICES;

/// Half of the thickness that a flat hull is given, as a share of the diagonal of its bounding box.
const THICKNESS: f64 = 1e-3;
/// A hull thinner than this share of its bounding box's diagonal is flat: its planes would be mostly rounding error.
const FLAT: f64 = 1e-6;
/// Two faces count as one plane if the sine of the angle between their normals is below this value. Times the diagonal
/// of the bounding box, it is also the greatest distance by which a corner may lie outside a triangle's plane; with a
/// greater distance, the triangle is a sliver and gives no face.
const COPLANAR: f64 = 1e-7;

/// Sets of more points than this are thinned before their hull is computed: only the outermost point along each of a
/// fixed set of directions is kept.
const MANY: usize = 1500;
/// The directions for thinning run from a cube's centre to a square grid of points on each face of the cube; this is
/// the grid's number of points along one side. Neighbouring directions are at most 13 degrees apart, which is finer
/// than a hull of 64 corners can resolve.
const DIRECTIONS: usize = 10;

/// A convex hull with volume.
#[derive(Debug, Clone, Default)]
pub struct Hull {
    /// Corners of the hull, m; at most [`MAX_HULL_VERTICES`] in a reduced hull.
    pub vertices: Vec<DVec3>,
    /// Unit outward normal n and offset (m) of each distinct face plane; n . x <= offset holds at every corner.
    pub faces: Vec<(DVec3, f64)>,
    /// Triangles of the hull's surface, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl Hull {
    /// The greatest of a point's signed distances from the face planes, m; negative inside the hull.
    pub fn height(&self, point: DVec3) -> f64 {
        self.faces.iter().map(|(n, d)| n.dot(point) - d).fold(f64::NEG_INFINITY, f64::max)
    }

    /// Volume, m^3.
    pub fn volume(&self) -> f64 {
        super::mass::properties(&self.vertices, &self.triangles).volume
    }
}

/// The full convex hull of the points. `None`: the points lie in a plane, there are fewer than four, or the hull
/// algorithm fails on them.
pub fn convex(points: &[DVec3]) -> Option<Hull> {
    let (low, diagonal) = bounds(points)?;
    // The points are scaled to unit size near the origin, because the hull algorithm's tolerances are absolute.
    let local: Vec<Vector> = points.iter().map(|&p| (p - low) / diagonal).map(|p| Vector::new(p.x, p.y, p.z)).collect();
    let (corners, triangles) = try_convex_hull(&local).ok()?;
    let corners: Vec<DVec3> = corners.into_iter().map(|p| DVec3::new(p.x, p.y, p.z)).collect();
    let mut faces: Vec<(DVec3, f64)> = Vec::new();
    for t in &triangles {
        let [a, b, c] = t.map(|i| corners[i as usize]);
        let Some(normal) = (b - a).cross(c - a).try_normalize() else { continue };
        let offset = corners.iter().map(|&p| normal.dot(p)).fold(f64::NEG_INFINITY, f64::max);
        // The normal of a sliver is rounding noise. A plane with that normal through the outermost corner would stand
        // off the sliver itself and bound nothing, so the plane is left out.
        let same = |f: &(DVec3, f64)| f.0.dot(normal) > 0.0 && f.0.cross(normal).length() < COPLANAR;
        if offset - normal.dot(a) < COPLANAR && !faces.iter().any(same) {
            faces.push((normal, offset));
        }
    }
    // A hull that is thinner than [`FLAT`] along any face normal has no usable volume.
    let thickness = |f: &(DVec3, f64)| f.1 - corners.iter().map(|&p| f.0.dot(p)).fold(f64::INFINITY, f64::min);
    if faces.len() < 4 || faces.iter().any(|f| thickness(f) < FLAT) {
        return None;
    }
    let vertices: Vec<DVec3> = corners.iter().map(|&c| low + c * diagonal).collect();
    for (normal, offset) in &mut faces {
        *offset = vertices.iter().map(|&p| normal.dot(p)).fold(f64::NEG_INFINITY, f64::max);
    }
    Some(Hull { vertices, faces, triangles })
}

/// A *reduced* hull, whose corners are at most [`MAX_HULL_VERTICES`] of the points; other points may lie outside. A
/// hull of flat points is given a thickness. `None`: all points coincide, or a point is not finite.
pub fn reduced(points: &[DVec3]) -> Option<Hull> {
    let mut growing = Growing::new(points)?;
    while growing.grow() {}
    Some(growing.hull)
}

/// A hull that grows by one corner at a time. Each time, of the corners of the points' full convex hull, the one that
/// lies farthest outside this hull (in a tie, the one with the lowest index) becomes a corner of this hull; the part
/// left outside therefore shrinks fast.
pub struct Growing {
    /// Corners of the full hull.
    corners: Vec<DVec3>,
    chosen: Vec<usize>,
    /// The hull so far; it has volume.
    pub hull: Hull,
    farthest: Option<(f64, usize)>,
}

impl Growing {
    /// Starts with extreme points. Flat points are given a thickness; if their hull still has no volume, the points'
    /// bounding box is the hull. `None`: all points coincide, or a point is not finite.
    pub fn new(points: &[DVec3]) -> Option<Growing> {
        let thinned = thinned(points);
        let Some(full) = convex(&thinned).or_else(|| thickened(&thinned)) else {
            let hull = boxed(points)?;
            return Some(Growing { corners: Vec::new(), chosen: Vec::new(), hull, farthest: None });
        };
        // A few extreme points may lie in a plane. Then more extreme points are tried, and at last all corners of the
        // full hull, which has a volume.
        let all: Vec<usize> = (0..full.vertices.len()).collect();
        let seeds = [seed(&full.vertices, 1), seed(&full.vertices, 3), all];
        for chosen in seeds {
            let corners: Vec<DVec3> = chosen.iter().map(|&i| full.vertices[i]).collect();
            if let Some(hull) = convex(&corners) {
                let mut growing = Growing { corners: full.vertices, chosen, hull, farthest: None };
                growing.look();
                return Some(growing);
            }
        }
        None
    }

    /// Greatest distance by which a corner of the full hull lies outside this hull, m; 0 if no corner does, or if this
    /// hull cannot grow further.
    pub fn excess(&self) -> f64 {
        self.farthest.map_or(0.0, |(height, _)| height)
    }

    /// Adds the corner of the full hull that lies farthest outside; returns false if no corner lies outside, or if this
    /// hull cannot grow further.
    pub fn grow(&mut self) -> bool {
        let Some((_, next)) = self.farthest else { return false };
        self.chosen.push(next);
        let corners: Vec<DVec3> = self.chosen.iter().map(|&i| self.corners[i]).collect();
        match convex(&corners) {
            Some(hull) => self.hull = hull,
            // If the algorithm fails with the new corner, the last good hull stays.
            None => {
                self.farthest = None;
                return false;
            }
        }
        self.look();
        true
    }

    fn look(&mut self) {
        self.farthest = None;
        if self.hull.vertices.len() >= MAX_HULL_VERTICES {
            return;
        }
        let mut best = (0.0, None);
        for (i, &p) in self.corners.iter().enumerate() {
            let height = self.hull.height(p);
            if height > best.0 && !self.chosen.contains(&i) {
                best = (height, Some(i));
            }
        }
        self.farthest = best.1.map(|i| (best.0, i));
    }
}

/// Returns all points if they are few; otherwise only the outermost point along each of a fixed set of directions
/// (`DIRECTIONS` squared for each face of a cube), in a tie the point with the lowest index. Without thinning, the cost
/// of a hull would grow with the square of the number of its corners.
pub fn thinned(points: &[DVec3]) -> Vec<DVec3> {
    if points.len() <= MANY {
        return points.to_vec();
    }
    seed(points, DIRECTIONS).into_iter().map(|i| points[i]).collect()
}

/// Indices of the extreme points along the directions from a cube's centre to a grid of `side` x `side` points on each
/// face (if `side` is 1, to the faces' centres), ascending and without repetition.
fn seed(points: &[DVec3], side: usize) -> Vec<usize> {
    let at = |i: usize| if side == 1 { 0.0 } else { 2.0 * i as f64 / (side - 1) as f64 - 1.0 };
    let mut chosen = Vec::new();
    for code in 0..6 * side * side {
        let (face, u, v) = (code % 6, at(code / 6 % side), at(code / 6 / side));
        let mut d = [u, v, if face < 3 { 1.0 } else { -1.0 }];
        d.rotate_right(face % 3);
        let direction = DVec3::from_array(d);
        let mut best = (f64::NEG_INFINITY, 0);
        for (i, p) in points.iter().enumerate() {
            let reach = direction.dot(*p);
            if reach > best.0 {
                best = (reach, i);
            }
        }
        chosen.push(best.1);
    }
    chosen.sort_unstable();
    chosen.dedup();
    chosen
}

/// The hull of the points with a small octahedron around each: this gives flat points a thickness.
fn thickened(points: &[DVec3]) -> Option<Hull> {
    let (_, diagonal) = bounds(points)?;
    let step = THICKNESS * diagonal;
    let offsets = DVec3::AXES.into_iter().flat_map(|axis| [axis * step, -axis * step]);
    let thick: Vec<DVec3> = offsets.flat_map(|o| points.iter().map(move |&p| p + o)).collect();
    convex(&thick)
}

/// The points' bounding box, slightly enlarged along every axis, as a hull.
fn boxed(points: &[DVec3]) -> Option<Hull> {
    let (low, diagonal) = bounds(points)?;
    let high = points.iter().copied().fold(low, DVec3::max);
    let (low, high) = (low - THICKNESS * diagonal, high + THICKNESS * diagonal);
    let corner = |i: usize| DVec3::new([low.x, high.x][i % 2], [low.y, high.y][i / 2 % 2], [low.z, high.z][i / 4]);
    let faces = DVec3::AXES.into_iter().flat_map(|n| [(n, n.dot(high)), (-n, -n.dot(low))]).collect();
    let triangles = [
        [0, 4, 6],
        [0, 6, 2],
        [1, 3, 7],
        [1, 7, 5],
        [0, 1, 5],
        [0, 5, 4],
        [2, 6, 7],
        [2, 7, 3],
        [0, 2, 3],
        [0, 3, 1],
        [4, 5, 7],
        [4, 7, 6],
    ];
    Some(Hull { vertices: (0..8).map(corner).collect(), faces, triangles: triangles.to_vec() })
}

/// Least corner (m) and diagonal (m) of the points' bounding box. `None`: there are no points, all points coincide, or
/// a point is not finite.
fn bounds(points: &[DVec3]) -> Option<(DVec3, f64)> {
    if points.iter().any(|p| !p.is_finite()) {
        return None;
    }
    let low = points.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let diagonal = points.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max).distance(low);
    (diagonal.is_finite() && diagonal > 0.0).then_some((low, diagonal))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::{layer, sphere};

    /// Greatest distance by which rounding may move a corner off the hull's surface, in a hull of about unit size.
    const INSIDE: f64 = 1e-12;

    fn check(hull: &Hull) {
        assert!(hull.vertices.len() <= MAX_HULL_VERTICES && hull.faces.len() >= 4);
        assert!(hull.volume() > 0.0);
        assert!(hull.vertices.iter().all(|&v| hull.height(v).abs() < INSIDE));
    }

    #[test]
    fn a_box_has_six_faces_and_eight_corners_however_it_is_cut() {
        let (points, ..) = layer::boundary(&layer::kuhn_box(DVec3::splat(5.0), DVec3::new(6.0, 7.0, 5.5), [5, 4, 3]));
        let hull = reduced(&points).unwrap();
        check(&hull);
        assert_eq!(hull.faces.len(), 6);
        assert!((hull.volume() - 1.0).abs() < 1e-12);
        assert!(hull.height(DVec3::new(6.5, 6.0, 5.2)) - 0.5 < INSIDE);
    }

    #[test]
    fn a_sphere_is_reduced_to_64_corners_with_a_small_margin() {
        let (points, _) = sphere::icosphere(1.0);
        assert_eq!(convex(&points).unwrap().vertices.len(), points.len());
        let hull = reduced(&points).unwrap();
        check(&hull);
        let margin = points.iter().map(|&p| hull.height(p)).fold(0.0, f64::max);
        // The middle of a face lies 1 - cos(a) below the unit sphere, where `a` is the angle between the middle and the
        // face's corners. With 64 corners, `a` is 0.27 rad at best, which gives the distance 0.04; corners that are
        // chosen greedily give up to twice that distance.
        assert!(
            margin > 0.02 && margin < 0.1,
            "a point sticks out of the hull by {margin} of the radius, expected 0.02 to 0.1"
        );
    }

    #[test]
    fn flat_and_thin_points_still_give_a_hull() {
        let plate = [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.5], [0., 1., 0.5]].map(DVec3::from_array);
        let line = [DVec3::ZERO, DVec3::ONE, DVec3::splat(0.3)];
        let crowd: Vec<DVec3> = (0..500).map(|i| DVec3::new((i as f64).sin(), 0.0, (i as f64).cos())).collect();
        for points in [&plate[..], &plate[..3], &line, &crowd] {
            let hull = reduced(points).unwrap();
            check(&hull);
            assert!(points.iter().all(|&p| hull.height(p) < 0.05));
        }
        assert!(reduced(&[DVec3::ONE, DVec3::ONE]).is_none());
        assert!(reduced(&[DVec3::ONE, DVec3::NAN]).is_none());
    }
}
