//! Generates a human head for scenes without files: 0.25 m tall, y up, the face towards +z, the neck cut off flat. The
//! shape is a signed distance function, m, negative inside.

use glam::DVec3;

use super::Blank;
use super::solid::{carve, ellipsoid, join, meet, stick};

/// Half the height, m: the head reaches from the cut neck at y = -HALF to the crown at y = HALF.
const HALF: f64 = 0.125;
/// Half extents of a box that contains the head, m.
const BOX: DVec3 = DVec3::new(0.105, 0.13, 0.12);
/// Half width of the zone in which the two mirrored halves are blended at the plane of symmetry, m.
const MIRROR: f64 = 0.002;

/// A head with exactly `vertex_count` vertices.
pub fn head(vertex_count: usize) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let blank = Blank { solid, bounds: [-BOX, BOX], inside: DVec3::ZERO, vertices_per_cell: 0.93, coarsest: 0.004 };
    blank.surface(vertex_count)
}

/// The head's signed distance: head and neck, cut off at the bottom.
fn solid(point: DVec3) -> f64 {
    meet(with_neck(point), -HALF - point.y, 0.008)
}

/// Signed distance of the head with a neck that goes on downwards, to where a body's chest would be.
pub(super) fn with_neck(point: DVec3) -> f64 {
    // With the absolute value of x in place of x, the formulas of one half of the head give both halves. The absolute
    // value is rounded off near x = 0, which keeps the surface smooth where the halves meet.
    let p = DVec3::new((point.x * point.x + MIRROR * MIRROR).sqrt(), point.y, point.z);
    let head = mouth(p, nose(p, eyes(p, skull(p))));
    let neck = stick(p * DVec3::new(0.95, 1.0, 1.0), (at(0.0, -0.04, -0.028), 0.05), (at(0.0, -0.2, -0.04), 0.054));
    ears(p, join(head, neck, 0.025))
}

fn at(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// Signed distance of the skull: cranium, forehead, face, jaw, chin, cheeks and brows.
fn skull(p: DVec3) -> f64 {
    let cranium = ellipsoid(p, at(0.0, 0.045, -0.016), at(0.075, 0.081, 0.094));
    let forehead = ellipsoid(p, at(0.0, 0.055, 0.034), at(0.060, 0.050, 0.046));
    let face = ellipsoid(p, at(0.0, -0.008, 0.026), at(0.060, 0.078, 0.056));
    let jaw = ellipsoid(p, at(0.0, -0.056, 0.034), at(0.046, 0.032, 0.042));
    let corner = ellipsoid(p, at(0.040, -0.042, 0.004), at(0.018, 0.030, 0.030));
    let chin = ellipsoid(p, at(0.0, -0.075, 0.067), at(0.018, 0.013, 0.014));
    let cheek = ellipsoid(p, at(0.038, -0.004, 0.055), at(0.022, 0.018, 0.018));
    let brow = ellipsoid(p, at(0.026, 0.037, 0.072), at(0.028, 0.009, 0.013));
    let upper = join(cranium, forehead, 0.03);
    let lower = join(join(join(face, jaw, 0.025), corner, 0.025), chin, 0.014);
    join(join(join(upper, lower, 0.03), cheek, 0.03), brow, 0.018)
}

/// Carves the eye sockets and puts eyeballs into them.
fn eyes(p: DVec3, head: f64) -> f64 {
    let socket = ellipsoid(p, at(0.031, 0.019, 0.092), at(0.019, 0.013, 0.018));
    let ball = ellipsoid(p, at(0.031, 0.018, 0.068), DVec3::splat(0.0135));
    let slit = ellipsoid(p, at(0.031, 0.0160, 0.0835), at(0.014, 0.0030, 0.0050));
    carve(join(carve(head, socket, 0.014), ball, 0.005), slit, 0.004)
}

/// Adds the nose: bridge, wings and nostrils.
fn nose(p: DVec3, head: f64) -> f64 {
    let bridge = stick(p, (at(0.0, 0.032, 0.080), 0.0065), (at(0.0, -0.010, 0.103), 0.0095));
    let wing = ellipsoid(p, at(0.0105, -0.014, 0.089), at(0.0080, 0.0075, 0.013));
    let nostril = ellipsoid(p, at(0.0065, -0.0225, 0.096), at(0.0035, 0.005, 0.005));
    carve(join(join(head, bridge, 0.012), wing, 0.010), nostril, 0.003)
}

/// Adds the mouth: the swell of the teeth, two lips and the line between them.
fn mouth(p: DVec3, head: f64) -> f64 {
    let swell = ellipsoid(p, at(0.0, -0.043, 0.068), at(0.030, 0.024, 0.018));
    let upper = ellipsoid(p, at(0.0, -0.0395, 0.084), at(0.021, 0.0055, 0.008));
    let lower = ellipsoid(p, at(0.0, -0.0495, 0.082), at(0.018, 0.0060, 0.009));
    let line = ellipsoid(p, at(0.0, -0.0445, 0.094), at(0.024, 0.0032, 0.0085));
    let lips = join(upper, lower, 0.003);
    carve(join(join(head, swell, 0.02), lips, 0.006), line, 0.004)
}

/// Adds the ears: each is a shell that stands off to the back and is hollow at its front.
fn ears(p: DVec3, head: f64) -> f64 {
    // The ear's own coordinates are rotated by angles with rational sine and cosine (3-4-5 and 7-24-25 triangles), so
    // that no trigonometric function is rounded.
    let local = p - at(0.078, 0.008, -0.014);
    let (c, s) = (0.8, 0.6);
    let turned = at(c * local.x + s * local.z, local.y, c * local.z - s * local.x);
    let (c, s) = (24.0 / 25.0, 7.0 / 25.0);
    let tilted = at(turned.x, c * turned.y + s * turned.z, c * turned.z - s * turned.y);
    let shell = ellipsoid(tilted, DVec3::ZERO, at(0.0075, 0.032, 0.020));
    let hollow = ellipsoid(tilted, at(0.0085, 0.004, 0.001), at(0.006, 0.021, 0.012));
    carve(join(head, shell, 0.008), hollow, 0.004)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heads_lie_on_their_solid() {
        for count in [500, 10_001] {
            let off = head(count).0.iter().map(|&v| solid(v).abs()).fold(0.0, f64::max);
            // The tolerance is this large because of creases, where Newton iterations may stop short of the surface.
            assert!(off < 5e-4, "{count} vertices: a vertex is {off} m off the surface");
        }
    }
}
