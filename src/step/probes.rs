//! Probes: skin vertices that a scene follows. The device gives their displacement, the host the rest in f64.

use glam::DVec3;

use crate::prepare::{Body, Shape};
use crate::scene::Scene;
use crate::stages::model::Model;
use crate::{Error, Result};

/// A probe's rest position and frame, on the host.
pub struct ProbePlace {
    /// In its frame, m.
    pub rest: DVec3,
    /// The frame it rides on.
    pub frame: usize,
}

/// Probes on the host, and their nodes and weights for the device.
pub type ProbeArrays = (Vec<ProbePlace>, Vec<[u32; 4]>, Vec<[f32; 4]>);

/// The skin vertices nearest to the scene's probes.
pub fn probes_of(scene: &Scene, bodies: &[Body], model: &Model) -> Result<ProbeArrays> {
    let (mut places, mut nodes, mut weights) = (Vec::new(), Vec::new(), Vec::new());
    for probe in &scene.probes {
        let key = format!("probe.{}.body", probe.name);
        let refuse = |problem: &str, remedy: &str| Error::key(&scene.file, &key, problem, remedy);
        let index = bodies.iter().position(|body| body.name == probe.body);
        let index = index.ok_or_else(|| refuse("no body has this name", "name a body of the scene"))?;
        let scale = scene.bodies[index].scale;
        let frame = model.body_frames[index] as usize;
        let (skin, embedding) = match &bodies[index].shape {
            Shape::Soft { skin, embedding, layer, .. } => (skin, Some((embedding, layer))),
            Shape::Rigid { skin, .. } => (skin, None),
            Shape::Plane { .. } => return Err(refuse("a plane has no skin", "probe a body with a skin")),
        };
        let target = probe.nearest * scale;
        let distance = |i: &usize| skin.vertices[*i].distance_squared(target);
        let nearest = (0..skin.vertices.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)));
        let nearest = nearest.ok_or_else(|| refuse("its skin has no vertex", "give it a surface"))?;
        let centre = model.frames[frame].rest_centre;
        let first = model.soft.iter().find(|soft| soft.body == index).map_or(0, |soft| soft.node_first as u32);
        let (rest, four, w) = match embedding {
            Some((embedding, layer)) => {
                let e = &embedding[nearest];
                let four = layer.tetrahedra[e.tetrahedron as usize];
                let rest: DVec3 = four.iter().zip(e.weights).map(|(n, w)| w * layer.nodes[*n as usize]).sum();
                (rest, four.map(|n| n + first), e.weights.map(|w| w as f32))
            }
            None => (skin.vertices[nearest], [0; 4], [0.0; 4]),
        };
        places.push(ProbePlace { rest: rest - centre, frame });
        nodes.push(four);
        weights.push(w);
    }
    Ok((places, nodes, weights))
}
