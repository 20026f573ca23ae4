//! Generates a pumpkin for scenes without files: 0.3 m across, y up, with ten ribs and a bent stem.
//!
//! The ribs are ellipsoids around the axis, joined with narrow fillets, so that the grooves between them run from the
//! dimple at the top to the dimple at the bottom.

use glam::DVec3;

use super::Blank;
use super::solid::{ellipsoid, join, stick};

/// Number of ribs.
const RIBS: usize = 10;
/// Distance from the axis to the middle of a rib, m.
const RIB_OFFSET: f64 = 0.082;
/// Half axes of a rib: outwards, up, along the circumference, m.
const RIB: DVec3 = DVec3::new(0.066, 0.098, 0.043);
/// Relative size of each rib; the sizes differ because a real pumpkin is not perfectly regular.
const RIB_SIZES: [f64; RIBS] = [1.0, 0.97, 1.03, 0.98, 1.01, 0.96, 1.02, 1.0, 0.97, 1.03];
/// Width of the grooves' fillets, m.
const GROOVE: f64 = 0.008;
/// Half axes of the ellipsoid inside the ribs, m.
const FLESH: DVec3 = DVec3::new(0.11, 0.068, 0.11);
/// Points and radii of the stem, from its root upwards, m.
const STEM: [(DVec3, f64); 4] = [
    (DVec3::new(0.0, 0.060, 0.0), 0.030),
    (DVec3::new(0.001, 0.085, 0.001), 0.0175),
    (DVec3::new(0.007, 0.115, 0.003), 0.0135),
    (DVec3::new(0.022, 0.142, 0.008), 0.0150),
];
/// Number of ridges of the stem.
const STEM_RIBS: i32 = 5;
/// Depth of the stem's grooves as a share of the stem's radius.
const STEM_GROOVE: f64 = 0.16;

/// A pumpkin with exactly `vertex_count` vertices.
pub fn pumpkin(vertex_count: usize) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let directions = std::array::from_fn(|k| {
        // The offset of one half makes one of the ribs point towards +z.
        let (sine, cosine) = libm::sincos(std::f64::consts::TAU * (k as f64 + 0.5) / RIBS as f64);
        DVec3::new(cosine, 0.0, sine)
    });
    let blank = Blank {
        solid: |p: DVec3| solid(p, &directions),
        bounds: [DVec3::new(-0.16, -0.11, -0.16), DVec3::new(0.16, 0.17, 0.16)],
        inside: DVec3::ZERO,
        vertices_per_cell: 1.25,
        coarsest: 0.008,
    };
    blank.surface(vertex_count)
}

fn solid(p: DVec3, directions: &[DVec3; RIBS]) -> f64 {
    let flesh = ellipsoid(p, DVec3::ZERO, FLESH);
    let ribs = directions.iter().zip(RIB_SIZES).map(|(&out, size)| {
        let local = DVec3::new(p.dot(out), p.y, p.dot(DVec3::new(-out.z, 0.0, out.x)));
        ellipsoid(local, DVec3::new(RIB_OFFSET, 0.0, 0.0), RIB * size)
    });
    let body = ribs.fold(flesh, |body, rib| join(body, rib, GROOVE));
    join(body, stem(p), 0.010)
}

/// Signed distance of the stem: a bent rod with grooves along it, wider at its root and at its cut.
fn stem(p: DVec3) -> f64 {
    let grooved = |k: usize| {
        let ((a, ra), (b, rb)) = (STEM[k], STEM[k + 1]);
        let axis = a + (b - a) * ((p.y - a.y) / (b.y - a.y)).clamp(0.0, 1.0);
        let (x, z) = (p.x - axis.x, p.z - axis.z);
        // The cosine of the n-th multiple of an angle is the real part of the n-th power of cosine + i sine.
        let (mut re, mut im) = (1.0, 0.0);
        let r = (x * x + z * z).sqrt().max(1e-9);
        for _ in 0..STEM_RIBS {
            (re, im) = ((re * x - im * z) / r, (re * z + im * x) / r);
        }
        let groove = 1.0 - STEM_GROOVE * 0.5 * (1.0 - re) * (r / ra).min(1.0);
        stick(p, (a, ra * groove), (b, rb * groove))
    };
    let rod = join(join(grooved(0), grooved(1), 0.008), grooved(2), 0.006);
    // The stem's end is cut off flat.
    let cut = (p - STEM[3].0).dot(DVec3::new(0.36, 0.924, 0.13)) - 0.002;
    -join(-rod, -cut, 0.004)
}
