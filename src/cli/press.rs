//! The scene that `palpate prepare` writes beside a body: a sphere presses into its front and is held there.

use std::io::Write;

use glam::DVec3;
use palpate::prepare::{Layer, Skin, layer};

/// Radius of the sphere, as a share of the body's largest extent.
const RADIUS: f64 = 0.04;
/// How far the device goes below the skin, in radii.
const TRAVEL: f64 = 0.5;
/// Gap before the sphere touches, in radii.
const GAP: f64 = 0.05;
/// Skin this near to the frontmost point counts as the front, as a share of the extent.
const FRONT: f64 = 0.02;
/// Nodes deeper than this share of the deepest are held.
const HELD: f64 = 0.5;

/// Where and how hard to press.
pub struct Press {
    /// m.
    radius: f64,
    start: DVec3,
    end: DVec3,
}

impl Press {
    /// Into the middle of what lies farthest along z.
    pub fn into(skin: &Skin) -> Press {
        let points = || skin.vertices.iter().copied();
        let low = points().fold(DVec3::INFINITY, DVec3::min);
        let high = points().fold(DVec3::NEG_INFINITY, DVec3::max);
        let extent = (high - low).max_element();
        let front: Vec<DVec3> = points().filter(|p| p.z >= high.z - FRONT * extent).collect();
        let middle = front.iter().sum::<DVec3>() / front.len().max(1) as f64;
        let nearest = |a: &DVec3, b: &DVec3| a.distance_squared(middle).total_cmp(&b.distance_squared(middle));
        let touched = front.iter().copied().min_by(nearest).unwrap_or(high);
        let radius = RADIUS * extent;
        // Adding zero turns a negative zero into one that reads well.
        let touched = touched + DVec3::ZERO;
        let start = DVec3::new(touched.x, touched.y, high.z + (1.0 + GAP) * radius);
        Press { radius, start, end: touched + (1.0 - TRAVEL) * radius * DVec3::Z }
    }

    /// Writes the scene; `inset` is the depth from which nodes are held, in m. Stiffness and mass of the hand grow with
    /// the sphere, so that a body of any size is pressed in the same time.
    pub fn write(&self, w: &mut impl Write, name: &str, inset: f64) -> std::io::Result<()> {
        let (r, s, e) = (self.radius, self.start, self.end);
        writeln!(
            w,
            "# A sphere presses into {name}. Written by palpate prepare; run it with: palpate run scene.toml\n"
        )?;
        writeln!(w, "[step]\ngravity = [0.0, 0.0, 0.0]       # a soft body at rest keeps its shape\n")?;
        writeln!(w, "[contact]\ndepth_limit = {r:?}\n")?;
        writeln!(w, "[[body]]\nname = \"{name}\"\nsurface = \"skin.obj\"\nlayer = \"layer.msh\"")?;
        writeln!(w, "material = {{ young = 2e4, poisson = 0.45, density = 1000.0, damping_stiffness = 0.002 }}\n")?;
        writeln!(w, "[[body.core]]\nname = \"core\"\nmotion = \"fixed\"\nbind = {{ inset = {inset:?} }}\n")?;
        writeln!(w, "[tool]\nsphere = {r:?}\nmass = {:?}\nposition = [{:?}, {:?}, {:?}]\n", 5.0 * r, s.x, s.y, s.z)?;
        writeln!(w, "[coupling]\nstiffness = {:?}\ndamping = {:?}", 5e4 * r, 500.0 * r)?;
        writeln!(w, "angular_stiffness = {:?}\nangular_damping = {:?}\n", 5e5 * r.powi(3), 2e3 * r.powi(3))?;
        let key = |t: f64, p: DVec3| format!("[{t:?}, {:?}, {:?}, {:?}]", p.x, p.y, p.z);
        writeln!(w, "[drive]\nkeys = [{}, {}, {}]", key(0.0, s), key(0.15, e), key(0.2, e))
    }
}

/// Depth from which nodes are to be held so that every part of the layer has some, m, from the depth of each node.
pub fn inset(layer: &Layer, depths: &[f64]) -> f64 {
    let (labels, count) = layer::parts(layer);
    let mut deepest = vec![0.0f64; count];
    for (&label, &depth) in labels.iter().zip(depths) {
        deepest[label as usize] = deepest[label as usize].max(depth);
    }
    HELD * deepest.into_iter().fold(f64::INFINITY, f64::min)
}
