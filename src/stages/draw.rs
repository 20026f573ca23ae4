//! Draw stage: writes the current positions and normals of the skins (surface meshes) of all bodies into GPU arrays
//! that a renderer or another program may bind or map. It is no part of the step; it is made and run only when a caller
//! asks for it.

mod elements;
mod fields;
mod mesh;
mod points;

use std::ops::Range;
use std::sync::Arc;

use super::elastic::Elastic;
use super::model::Model;
use super::skin::Skin;
use super::{count, upload};
use crate::Result;
use crate::gpu::{Buffer, Context, Kernel, Memory, Recorder, Size};
use crate::shaders;
use crate::shaders::{Frame, Link, NONE};
pub use fields::{FIELDS, Field, Fields, of_all};
pub use mesh::{Mesh, Outline};
pub use points::Points;

/// The skins on the GPU, body after body, the tool's last; positions and normals have one vec4 per vertex.
pub struct Skins<'a> {
    /// Positions, m, relative to the origin that the caller chose; w is 1.
    pub positions: &'a Buffer,
    /// Outward unit normals; w is 0. A normal is zero where the triangles around its vertex have no area.
    pub normals: &'a Buffer,
    /// Four u32 per triangle: its three vertices and a zero.
    pub triangles: &'a Buffer,
}

/// Kernels and arrays of the draw stage.
pub struct Draw {
    normals_kernel: Kernel,
    fan_first: Buffer,
    fans: Buffer,
    /// One [`Frame`] (rigid coordinate frame) per frame of the model, written by the host; only position and rotation
    /// are read.
    pub frames: Buffer,
    /// One [`Link`] per pair of frames in both of which a tetrahedron, collision proxy (convex hull over a part of a
    /// skin) or chunk (group of skin vertices) has nodes: the current placement of one frame relative to the other;
    /// written by the host.
    pub links: Buffer,
    /// Four u32 per triangle: its three skin vertices and a zero.
    pub triangles: Buffer,
    /// The vertices of all skins.
    pub points: Points,
    /// Outward unit normals, one vec4 per skin vertex.
    pub normals: Buffer,
}

impl Draw {
    /// Kernels and arrays for a model. `ranges`: for each body the range of its vertices among the skin vertices of all
    /// bodies; `skin`: the step's skin stage, if the step has one; in that case its arrays are used here too.
    pub fn new(context: &Arc<Context>, model: &Model, ranges: &[Range<usize>], skin: Option<&Skin>) -> Result<Draw> {
        let vertices = model.skin_nodes.len();
        let mut rigid_frames = vec![NONE; vertices];
        for (range, frame) in ranges.iter().zip(&model.body_frames) {
            rigid_frames[range.clone()].fill(*frame);
        }
        let (fan_first, fans) = fans(model);
        let nodes = match skin {
            Some(skin) => skin.skin_nodes.clone(),
            None => upload(context, "skin_nodes", &model.skin_nodes)?,
        };
        let weights = match skin {
            Some(skin) => skin.skin_weights.clone(),
            None => upload(context, "skin_weights", &model.skin_weights)?,
        };
        let frames = (model.frames.len().max(1) * size_of::<Frame>()) as u64;
        let links = (model.links.len().max(1) * size_of::<Link>()) as u64;
        Ok(Draw {
            normals_kernel: Kernel::new(context, "draw/normals", Size::Group, &[("VERTICES", count(vertices))])?,
            triangles: match skin {
                Some(skin) => skin.triangles.clone(),
                None => upload(context, "triangles", &model.triangles)?,
            },
            fan_first: upload(context, "fan_first", &fan_first)?,
            fans: upload(context, "fans", &fans)?,
            frames: Buffer::new(context, "frames", frames, Memory::Upload)?,
            links: Buffer::new(context, "links", links, Memory::Upload)?,
            points: Points::new(context, vertices, nodes, weights, &rigid_frames)?,
            normals: Buffer::shared(context, "normals", (16 * vertices.max(1)) as u64)?,
        })
    }

    /// The arrays to draw.
    pub fn skins(&self) -> Skins<'_> {
        Skins { positions: &self.points.positions, normals: &self.normals, triangles: &self.triangles }
    }

    /// Records the transfer of frames and links, as the host wrote them.
    pub fn record_frames(&self, recorder: &mut Recorder) {
        recorder.upload(&self.frames);
        recorder.upload(&self.links);
    }

    /// Records two passes over all skin vertices.
    pub fn record(&self, recorder: &mut Recorder, elastic: &Elastic) {
        self.record_frames(recorder);
        self.points.record(recorder, &self.frames, elastic);
        let arguments = shaders::draw::Normals {
            triangles: &self.triangles,
            fan_first: &self.fan_first,
            fans: &self.fans,
            positions: &self.points.positions,
            normals: &self.normals,
        };
        recorder.dispatch(&self.normals_kernel, &arguments, self.points.count);
    }
}

/// Sorts `pairs` of an owner and a value into one list per owner: returns the index at which each list begins (and, as
/// a last element, the total length of all lists), and the lists one after another.
fn lists(owners: usize, pairs: impl Iterator<Item = (u32, u32)> + Clone) -> (Vec<u32>, Vec<u32>) {
    let mut first = vec![0u32; owners + 1];
    pairs.clone().for_each(|(owner, _)| first[owner as usize + 1] += 1);
    for owner in 1..first.len() {
        first[owner] += first[owner - 1];
    }
    let (mut next, mut all) = (first.clone(), vec![0; first[owners] as usize]);
    for (owner, held) in pairs {
        all[next[owner as usize] as usize] = held;
        next[owner as usize] += 1;
    }
    (first, all)
}

/// The triangles around every skin vertex, as [`lists`] returns them; the model itself keeps only those around vertices
/// that are tested for contact.
fn fans(model: &Model) -> (Vec<u32>, Vec<u32>) {
    let triangles = model.triangles.iter().zip(0..);
    lists(model.skin_nodes.len(), triangles.flat_map(|(&[a, b, c, _], t)| [(a, t), (b, t), (c, t)]))
}
