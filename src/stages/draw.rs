//! Draw: the skins of all bodies as they are, positions and normals, in arrays that another program may bind or map. No part of
//! the step: made and run when somebody looks.

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
pub use fields::{Field, Fields};
pub use mesh::{Mesh, Outline};
pub use points::Points;

/// Skins on the device: a vec4 a vertex of all bodies, one after another, the tool's last.
pub struct Skins<'a> {
    /// m, from the origin that was asked for; w is 1.
    pub positions: &'a Buffer,
    /// Unit, outward; w is 0. Zero where a vertex has no triangle with an area.
    pub normals: &'a Buffer,
    /// Three vertices a triangle, and a zero: four u32.
    pub triangles: &'a Buffer,
}

/// Kernels and arrays.
pub struct Draw {
    normals_kernel: Kernel,
    fan_first: Buffer,
    fans: Buffer,
    /// A [`Frame`] a frame of the model, of which place and rotation count; written by the host.
    pub frames: Buffer,
    /// A [`Link`] a pair of frames that something spans, as they are now; written by the host.
    pub links: Buffer,
    /// Three skin vertices a triangle, and a zero.
    pub triangles: Buffer,
    /// The vertices of all skins.
    pub points: Points,
    /// A vec4 a skin vertex, unit, outward.
    pub normals: Buffer,
}

impl Draw {
    /// For a model whose bodies' skins take up these ranges of the vertices; `skin`: of the step, where it has one, whose arrays
    /// are shared.
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

    /// What is shown.
    pub fn skins(&self) -> Skins<'_> {
        Skins { positions: &self.points.positions, normals: &self.normals, triangles: &self.triangles }
    }

    /// Two passes over all skin vertices.
    pub fn record(&self, recorder: &mut Recorder, elastic: &Elastic) {
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

/// Lists by owner, one after another: running totals of their lengths, and what they hold. `pairs`: owner and what it holds.
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

/// The triangles around each skin vertex: of all vertices, where the model keeps those that contact asks for.
fn fans(model: &Model) -> (Vec<u32>, Vec<u32>) {
    let triangles = model.triangles.iter().zip(0..);
    lists(model.skin_nodes.len(), triangles.flat_map(|(&[a, b, c, _], t)| [(a, t), (b, t), (c, t)]))
}
