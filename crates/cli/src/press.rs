//! The scene that `palpate prepare` writes along with a soft body: a sphere presses into the body from the front and is
//! held there. The sphere is the scene's *tool*, which the haptic device leads by a *coupling* (spring and damper). The
//! body's *layer* is its tetrahedral mesh, its *skin* the surface mesh; a *rigid core* holds the nodes that are
//! attached to it.

use std::io::Write;

use glam::DVec3;
use palpate::internal::prepare::distance::Solid;
use palpate::internal::prepare::{Layer, Skin, layer};

/// Radius of the sphere, as a share of the body's largest extent.
const RADIUS: f64 = 0.04;
/// Distance that the haptic device goes beyond the sphere's first touch of the skin, in radii of the sphere.
const TRAVEL: f64 = 0.5;
/// Gap between sphere and skin at the start, in radii of the sphere.
const GAP: f64 = 0.05;
/// The sphere counts as touching the skin when the gap between them is smaller than this share of the sphere's radius.
const NEAR: f64 = 1e-3;
/// Nodes are attached to a rigid core if their depth below the skin is at least this share of the greatest depth in
/// their connected part of the layer.
const HELD: f64 = 0.5;

/// A sphere that is pressed into a body: its radius, and where the haptic device that leads it starts and ends.
pub struct Press {
    /// Radius of the sphere, m.
    radius: f64,
    start: DVec3,
    end: DVec3,
}

impl Press {
    /// A press along z towards the node that lies deepest below the skin, where the body is thickest; `depths` are the
    /// nodes' depths below the skin, m.
    pub fn into(skin: &Skin, layer: &Layer, depths: &[f64]) -> Press {
        let points = || skin.vertices.iter().copied();
        let low = points().fold(DVec3::INFINITY, DVec3::min);
        let high = points().fold(DVec3::NEG_INFINITY, DVec3::max);
        let radius = RADIUS * (high - low).max_element();
        // The deepest node; if several are equally deep, the first of them. Adding zero turns a coordinate of -0 into
        // 0, which reads better in the scene file.
        let deepest = (0..depths.len()).rev().max_by(|&i, &j| depths[i].total_cmp(&depths[j]));
        let target = deepest.map_or(0.5 * (low + high), |node| layer.nodes[node]) + DVec3::ZERO;
        let touching =
            met(skin, DVec3::new(target.x, target.y, high.z + 2.0 * radius), radius, low.z).unwrap_or(target.z);
        let at = |radii: f64| DVec3::new(target.x, target.y, touching + radii * radius);
        Press { radius, start: at(GAP), end: at(-TRAVEL) }
    }

    /// Writes the scene; `cores` has the value of the scene key `bind` for each rigid core, as the function [`cores`]
    /// returns them. Stiffness and damping of the coupling and the mass of the sphere grow with the sphere's radius, so
    /// that a body of any size is pressed in the same time.
    pub fn write(&self, w: &mut impl Write, name: &str, cores: &[String]) -> std::io::Result<()> {
        let (r, s, e) = (self.radius, self.start, self.end);
        writeln!(
            w,
            "# A sphere presses into {name}. Written by palpate prepare; run it with: palpate run scene.toml\n"
        )?;
        writeln!(w, "[step]\ngravity = [0.0, 0.0, 0.0]       # so that the soft body does not sag\n")?;
        writeln!(w, "[contact]\ndepth_limit = {r:?}\nfriction = 0.0\n")?;
        writeln!(w, "[[body]]\nname = \"{name}\"\nsurface = \"skin.obj\"\nlayer = \"layer.msh\"")?;
        writeln!(w, "material = {{ young = 2e4, poisson = 0.45, density = 1000.0, damping_stiffness = 0.002 }}\n")?;
        for (part, bind) in cores.iter().enumerate() {
            writeln!(w, "[[body.core]]\nname = \"core{part}\"\nmotion = \"fixed\"\nbind = {bind}\n")?;
        }
        writeln!(w, "[tool]\nsphere = {r:?}\nmass = {:?}\nposition = [{:?}, {:?}, {:?}]\n", 5.0 * r, s.x, s.y, s.z)?;
        writeln!(w, "[coupling]\nstiffness = {:?}\ndamping = {:?}", 5e4 * r, 500.0 * r)?;
        writeln!(w, "angular_stiffness = {:?}\nangular_damping = {:?}\n", 5e5 * r.powi(3), 2e3 * r.powi(3))?;
        let key = |t: f64, p: DVec3| format!("[{t:?}, {:?}, {:?}, {:?}]", p.x, p.y, p.z);
        writeln!(w, "[drive]\nkeys = [{}, {}, {}]", key(0.0, s), key(0.15, e), key(0.2, e))
    }
}

/// Height z, m, at which a sphere that comes down along z from `from` meets the skin, by sphere tracing (J. Hart 1996);
/// `None` if the sphere misses the skin and falls below the height `lowest`, or if the distance to the skin cannot be
/// computed.
fn met(skin: &Skin, from: DVec3, radius: f64, lowest: f64) -> Option<f64> {
    let solid = Solid::new(&skin.vertices, &skin.triangles).ok()?;
    let mut centre = from;
    while centre.z > lowest - radius {
        let room = solid.distance(centre) - radius;
        if room < NEAR * radius {
            return Some(centre.z);
        }
        centre.z -= room;
    }
    None
}

/// Places one rigid core in each connected part of the layer, where the nodes are deepest below the skin; `depths` are
/// the nodes' depths, m. Returns the value of the scene key `bind` for each core, and for each node whether it is
/// attached to a core. If the layer has one part, `bind` gives the least depth of attached nodes (`inset`); if it has
/// several, `bind` lists the attached nodes.
pub fn cores(layer: &Layer, depths: &[f64]) -> (Vec<String>, Vec<bool>) {
    let (labels, count) = layer::parts(layer);
    let mut deepest = vec![f64::NEG_INFINITY; count];
    for (&label, &depth) in labels.iter().zip(depths) {
        deepest[label as usize] = deepest[label as usize].max(depth);
    }
    let least: Vec<f64> = deepest.iter().map(|&deepest| if deepest > 0.0 { HELD * deepest } else { deepest }).collect();
    let held: Vec<bool> = labels.iter().zip(depths).map(|(&label, &depth)| depth >= least[label as usize]).collect();
    if count == 1 && deepest[0] > 0.0 {
        return (vec![format!("{{ inset = {:?} }}", least[0])], held);
    }
    let nodes = |part: usize| {
        let own = (0..depths.len()).filter(|&n| labels[n] as usize == part && held[n]);
        format!("{{ nodes = {:?} }}", own.collect::<Vec<_>>())
    };
    ((0..count).map(nodes).collect(), held)
}
