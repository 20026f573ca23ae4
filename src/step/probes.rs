//! Probes: vertices of skins (surface meshes) whose positions a scene records after each step. A vertex of a soft
//! body's skin moves with the four nodes of the tetrahedron that it lies in: the GPU gives the displacements of these
//! nodes, and the host computes the vertex's position in f64.

use glam::DVec3;

use crate::prepare::{Body, Shape};
use crate::scene::Scene;
use crate::shaders::NONE;
use crate::stages::model::Model;
use crate::{Error, Result};

/// A probe on the host: a weighted sum of four points, which are the nodes of its tetrahedron. Each point's rest
/// position is given in a frame (rigid coordinate frame of a body or of a rigid body inside it).
pub struct ProbePlace {
    /// For each point: its rest position relative to the frame's centre (m), its weight, and the index of the frame.
    pub points: [(DVec3, f64, usize); 4],
}

/// The probes on the host, and for the GPU the indices of each probe's four nodes (`NONE` for a rigid body).
pub type ProbeArrays = (Vec<ProbePlace>, Vec<[u32; 4]>);

/// For each probe of the scene, finds the skin vertex nearest to the point that the scene gives.
pub fn probes_of(scene: &Scene, bodies: &[Body], model: &Model) -> Result<ProbeArrays> {
    let (mut places, mut nodes) = (Vec::new(), Vec::new());
    for probe in &scene.probes {
        let key = format!("probe.{}.body", probe.name);
        let refuse = |problem: &str, remedy: &str| Error::key(&scene.file, &key, problem, remedy);
        let index = bodies.iter().position(|body| body.name == probe.body);
        let index = index.ok_or_else(|| refuse("no body has this name", "name a body of the scene"))?;
        let target = probe.nearest * scene.bodies[index].metres();
        let frame_first = model.body_frames[index] as usize;
        let skin = match &bodies[index].shape {
            Shape::Soft { skin, .. } | Shape::Rigid { skin, .. } => skin,
            Shape::Plane { .. } => return Err(refuse("a plane has no skin", "probe a body with a skin")),
        };
        let distance = |i: &usize| skin.vertices[*i].distance_squared(target);
        let nearest = (0..skin.vertices.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)));
        let nearest = nearest.ok_or_else(|| refuse("its skin has no vertex", "give it a surface"))?;
        let first = model.soft.iter().find(|soft| soft.body == index).map_or(0, |soft| soft.nodes.start as u32);
        let centre = |frame: usize| model.frames[frame].rest_centre;
        let (points, four) = match &bodies[index].shape {
            Shape::Soft { layer, embedding, node_frames, .. } => {
                let e = &embedding[nearest];
                let four = layer.tetrahedra[e.tetrahedron as usize];
                let point = |k: usize| {
                    let frame = frame_first + node_frames[four[k] as usize] as usize;
                    (layer.nodes[four[k] as usize] - centre(frame), e.weights[k], frame)
                };
                ([0, 1, 2, 3].map(point), four.map(|n| n + first))
            }
            _ => {
                let rest = skin.vertices[nearest] - centre(frame_first);
                ([0, 1, 2, 3].map(|k| (rest, f64::from(u8::from(k == 0)), frame_first)), [NONE; 4])
            }
        };
        places.push(ProbePlace { points });
        nodes.push(four);
    }
    Ok((places, nodes))
}
