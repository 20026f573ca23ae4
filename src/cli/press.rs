//! The scene that `palpate prepare` writes beside a body: a sphere presses into it from the front and is held there.

use std::io::Write;

use glam::DVec3;
use palpate::prepare::{Layer, Skin, layer};

/// Radius of the sphere, as a share of the body's largest extent.
const RADIUS: f64 = 0.04;
/// How far the device goes beyond the first touch, in radii.
const TRAVEL: f64 = 0.5;
/// Gap before the sphere touches, in radii.
const GAP: f64 = 0.05;
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
    /// Along z towards the deepest node, where there is most body behind the skin; `depths` are those of the nodes.
    pub fn into(skin: &Skin, layer: &Layer, depths: &[f64]) -> Press {
        let points = || skin.vertices.iter().copied();
        let low = points().fold(DVec3::INFINITY, DVec3::min);
        let high = points().fold(DVec3::NEG_INFINITY, DVec3::max);
        let radius = RADIUS * (high - low).max_element();
        // The first of the deepest. Adding zero turns a negative zero into one that reads well.
        let deepest = (0..depths.len()).rev().max_by(|&i, &j| depths[i].total_cmp(&depths[j]));
        let target = deepest.map_or(0.5 * (low + high), |node| layer.nodes[node]) + DVec3::ZERO;
        // Where the sphere's centre is when it first meets a vertex on its way down.
        let met = |p: DVec3| {
            let room = radius * radius - (p - target).truncate().length_squared();
            (room > 0.0).then(|| p.z + room.sqrt())
        };
        let touching = points().filter_map(met).fold(target.z, f64::max);
        let at = |radii: f64| DVec3::new(target.x, target.y, touching + radii * radius);
        Press { radius, start: at(GAP), end: at(-TRAVEL) }
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
