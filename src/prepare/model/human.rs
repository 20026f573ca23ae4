//! Generates a standing human for scenes without files: 1.7 m tall, y up, looking towards +z, soles at y = 0, arms held
//! out level with palms down and fingers apart. The shape is a signed distance function, m, negative inside; the head's
//! shape comes from `head.rs`.
//!
//! Hands, feet and head get shorter edges than the rest: the mesh is made in the *mesher's space*, in which these parts
//! are magnified by a bijective map, and the mesh's vertices are then mapped back.

use glam::DVec3;

use super::Blank;
use super::head::with_neck;
use super::solid::{carve, ellipsoid, join, meet, stick};

/// Origin of the head's coordinates in the coordinates of the body, m.
const HEAD: DVec3 = DVec3::new(0.0, 1.575, 0.022);
/// Height (y) and depth (z) of an arm's axis, m.
const ARM: (f64, f64) = (1.395, -0.012);
/// Half width of the zone in which the two mirrored halves are blended at the plane of symmetry, m.
const MIRROR: f64 = 0.004;
/// Distance that is used for parts which are left out because they are far away, m: it is larger than the width of any
/// blend.
const FAR: f64 = 1.0;

/// Magnification of hands, head and feet in the mesher's space, along x (hands) or y (head, feet): the coordinate at
/// which the magnification begins (m), the length over which it sets in (m), and the inverse of the full magnification.
const HAND: Lens = Lens { start: 0.46, length: 0.35, scale: 1.0 / 2.5 };
const FACE: Lens = Lens { start: 1.43, length: 0.12, scale: 1.0 / 2.7 };
const FOOT: Lens = Lens { start: -0.24, length: 0.18, scale: 1.0 / 2.2 };

/// A human with exactly `vertex_count` vertices.
pub fn human(vertex_count: usize) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let blank = Blank {
        solid: |u: DVec3| solid(from_mesher(u)),
        bounds: [DVec3::new(-1.7, -0.5, -0.40), DVec3::new(1.7, 2.2, 0.50)],
        inside: DVec3::new(0.0, 1.2, 0.0),
        vertices_per_cell: 13.0,
        coarsest: 0.014,
    };
    let (mut vertices, triangles) = blank.surface(vertex_count);
    vertices.iter_mut().for_each(|v| *v = from_mesher(*v));
    (vertices, triangles)
}

/// A magnification along a line: beyond `start`, lengths of the mesher's space shrink smoothly over `length` (m) to the
/// share `scale` in the body's space.
struct Lens {
    start: f64,
    length: f64,
    scale: f64,
}

impl Lens {
    /// Maps a coordinate along the line from the mesher's space to the body's space (m). The second value is the factor
    /// by which lengths across the line are to be multiplied.
    fn at(&self, u: f64) -> (f64, f64) {
        let t = ((u - self.start) / self.length).clamp(0.0, 1.0);
        let lost = 1.0 - self.scale;
        let share = 1.0 - lost * t * t * (3.0 - 2.0 * t);
        // Distance covered in the body's space from `start` to the point, within `length`: the integral of `share`.
        let along = self.length * (t - lost * t * t * t * (1.0 - t / 2.0));
        (u.min(self.start) + along + self.scale * (u - self.start - self.length).max(0.0), share)
    }
}

/// Maps a point from the mesher's space to the body's, m.
fn from_mesher(u: DVec3) -> DVec3 {
    let (up, share) = FACE.at(u.y);
    let mut p = DVec3::new(u.x * share, up, HEAD.z + (u.z - HEAD.z) * share);
    let (down, share) = FOOT.at(-p.y);
    p = DVec3::new(p.x * share, -down, p.z * share);
    let (out, share) = HAND.at(p.x.abs());
    DVec3::new(if p.x < 0.0 { -out } else { out }, ARM.0 + (p.y - ARM.0) * share, ARM.1 + (p.z - ARM.1) * share)
}

fn at(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// Signed distance of the whole body. Parts far from the point are left out, because no blend reaches that far.
fn solid(point: DVec3) -> f64 {
    let p = DVec3::new((point.x * point.x + MIRROR * MIRROR).sqrt(), point.y, point.z);
    let mut body = if p.x < 0.5 && p.y > 0.55 { torso(p) } else { FAR };
    if p.y < 1.1 {
        body = join(body, leg(p), 0.05);
    }
    if p.y < 0.25 {
        body = meet(join(body, foot(p), 0.03), -p.y, 0.008);
    }
    if p.x > 0.1 && p.y > 1.0 {
        body = join(body, arm(p), 0.05);
    }
    if p.x > 0.6 && p.y > 1.0 {
        body = join(body, hand(p), 0.012);
    }
    if p.y > 1.3 && p.x < 0.4 {
        body = join(body, with_neck(point - HEAD), 0.035);
    }
    body
}

/// Signed distance of the torso: ribs, chest, waist, belly, pelvis, seat, shoulder blades and shoulders.
fn torso(p: DVec3) -> f64 {
    let ribs = ellipsoid(p, at(0.0, 1.250, -0.010), at(0.158, 0.205, 0.106));
    let chest = ellipsoid(p, at(0.074, 1.315, 0.052), at(0.090, 0.066, 0.040));
    let waist = ellipsoid(p, at(0.0, 1.06, 0.000), at(0.136, 0.18, 0.094));
    let belly = ellipsoid(p, at(0.0, 1.02, 0.046), at(0.085, 0.110, 0.050));
    let pelvis = ellipsoid(p, at(0.0, 0.925, -0.006), at(0.150, 0.115, 0.102));
    let seat = ellipsoid(p, at(0.074, 0.885, -0.058), at(0.078, 0.088, 0.068));
    let blade = ellipsoid(p, at(0.085, 1.30, -0.075), at(0.065, 0.095, 0.035));
    let shoulder = stick(p, (at(0.03, 1.445, -0.030), 0.045), (at(0.170, 1.395, -0.014), 0.056));
    let side = stick(p, (at(0.130, 1.34, -0.035), 0.045), (at(0.100, 1.14, -0.020), 0.040));
    let trunk = join(join(join(ribs, waist, 0.10), belly, 0.05), join(pelvis, seat, 0.03), 0.08);
    join(join(join(join(trunk, side, 0.05), shoulder, 0.05), blade, 0.03), chest, 0.045)
}

/// Signed distance of the arms: upper arm and forearm, from the shoulder to the wrist.
fn arm(p: DVec3) -> f64 {
    let (shoulder, elbow) = (at(0.170, ARM.0, ARM.1), at(0.445, ARM.0, ARM.1));
    let upper = stick(p, (shoulder, 0.050), (elbow, 0.037));
    let deltoid = ellipsoid(p, at(0.205, 1.402, -0.012), at(0.075, 0.056, 0.058));
    let biceps = ellipsoid(p, at(0.325, 1.403, 0.004), at(0.080, 0.036, 0.036));
    let triceps = ellipsoid(p, at(0.315, 1.386, -0.028), at(0.085, 0.034, 0.034));
    let lower = stick(p, (elbow, 0.036), (at(0.690, ARM.0, ARM.1), 0.0235));
    let muscle = ellipsoid(p, at(0.515, 1.395, -0.008), at(0.090, 0.039, 0.043));
    let upper = join(join(join(upper, deltoid, 0.03), biceps, 0.02), triceps, 0.02);
    join(upper, join(lower, muscle, 0.03), 0.03)
}

/// Signed distance of the hands: palm, four fingers and a thumb.
fn hand(p: DVec3) -> f64 {
    let palm = ellipsoid(p, at(0.735, 1.393, -0.010), at(0.058, 0.0155, 0.043));
    let wrist = ellipsoid(p, at(0.690, 1.394, -0.011), at(0.045, 0.020, 0.030));
    let heel = ellipsoid(p, at(0.722, 1.386, 0.016), at(0.034, 0.015, 0.020));
    let palm = join(join(palm, wrist, 0.02), heel, 0.015);
    // Each finger: knuckle, middle joint, tip (m), and the radius at the knuckle (m).
    let fingers = [
        (at(0.774, 1.397, 0.023), at(0.818, 1.396, 0.035), at(0.848, 1.389, 0.042), 0.0090),
        (at(0.780, 1.398, 0.001), at(0.828, 1.397, 0.006), at(0.862, 1.390, 0.009), 0.0092),
        (at(0.776, 1.397, -0.021), at(0.821, 1.396, -0.025), at(0.853, 1.389, -0.028), 0.0088),
        (at(0.766, 1.395, -0.041), at(0.799, 1.393, -0.053), at(0.822, 1.387, -0.060), 0.0078),
    ];
    let mut hand = palm;
    for (knuckle, middle, tip, radius) in fingers {
        let root = at(0.710, knuckle.y - 0.003, ARM.1 + (knuckle.z - ARM.1) * 0.6);
        let bone = stick(p, (root, 0.010), (knuckle, radius + 0.0015));
        let finger = join(
            stick(p, (knuckle, radius), (middle, radius * 0.92)),
            stick(p, (middle, radius * 0.92), (tip, radius * 0.78)),
            0.003,
        );
        hand = join(hand, join(bone, finger, 0.004), 0.005);
    }
    let thumb =
        [(at(0.705, 1.388, 0.012), 0.0150), (at(0.745, 1.384, 0.046), 0.0115), (at(0.780, 1.381, 0.066), 0.0088)];
    let thumb = join(stick(p, thumb[0], thumb[1]), stick(p, thumb[1], thumb[2]), 0.004);
    join(hand, thumb, 0.012)
}

/// Signed distance of the legs: thigh, knee and calf.
fn leg(p: DVec3) -> f64 {
    let (hip, knee, ankle) = (at(0.090, 0.87, -0.004), at(0.100, 0.475, 0.000), at(0.103, 0.085, -0.022));
    let thigh = stick(p, (hip, 0.080), (knee, 0.049));
    let front = ellipsoid(p, at(0.102, 0.68, 0.024), at(0.058, 0.180, 0.054));
    let back = ellipsoid(p, at(0.098, 0.67, -0.024), at(0.056, 0.170, 0.050));
    let shin = stick(p, (knee, 0.045), (ankle, 0.031));
    let calf = ellipsoid(p, at(0.102, 0.340, -0.028), at(0.050, 0.130, 0.046));
    let cap = ellipsoid(p, at(0.100, 0.480, 0.024), at(0.034, 0.048, 0.030));
    let thigh = join(join(thigh, front, 0.03), back, 0.03);
    join(join(thigh, join(shin, calf, 0.03), 0.04), cap, 0.03)
}

/// Signed distance of the feet: heel, instep, ball and toes, turned out a little.
fn foot(p: DVec3) -> f64 {
    let heel = ellipsoid(p, at(0.103, 0.032, -0.044), at(0.032, 0.044, 0.042));
    let ankle = ellipsoid(p, at(0.103, 0.080, -0.020), at(0.038, 0.026, 0.034));
    let instep = stick(p, (at(0.104, 0.070, -0.008), 0.034), (at(0.114, 0.028, 0.095), 0.026));
    let sole = stick(p, (at(0.106, 0.014, -0.045), 0.026), (at(0.120, 0.012, 0.090), 0.032));
    let ball = ellipsoid(p, at(0.121, 0.020, 0.096), at(0.045, 0.022, 0.046));
    let toes = [
        (at(0.096, 0.015, 0.115), at(0.097, 0.013, 0.172), 0.0150),
        (at(0.115, 0.014, 0.115), at(0.119, 0.012, 0.167), 0.0102),
        (at(0.130, 0.013, 0.112), at(0.135, 0.012, 0.158), 0.0100),
        (at(0.144, 0.012, 0.104), at(0.150, 0.012, 0.147), 0.0096),
        (at(0.156, 0.012, 0.094), at(0.163, 0.012, 0.132), 0.0094),
    ];
    let mut foot = join(join(join(join(heel, ankle, 0.02), instep, 0.025), sole, 0.015), ball, 0.02);
    for (root, tip, radius) in toes {
        foot = join(foot, stick(p, (root, radius), (tip, radius)), 0.004);
    }
    carve(foot, ellipsoid(p, at(0.066, -0.002, 0.028), at(0.014, 0.014, 0.040)), 0.012)
}
