//! Draw: the skins of all bodies as they are, positions and normals, in arrays that another program may bind or map. No part of
//! the step: made and run when somebody looks.

use std::ops::Range;
use std::sync::Arc;

use super::elastic::Elastic;
use super::model::Model;
use super::skin::Skin;
use super::types::{Frame, NONE};
use super::{count, upload};
use crate::Result;
use crate::gpu::{Buffer, Context, Kernel, Memory, Recorder, Size};

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
    place: Kernel,
    normals_kernel: Kernel,
    vertex_count: u32,
    skin_nodes: Buffer,
    skin_weights: Buffer,
    rigid_frames: Buffer,
    fan_first: Buffer,
    fans: Buffer,
    /// A [`Frame`] a frame of the model, of which place and rotation count; written by the host.
    pub frames: Buffer,
    /// Three skin vertices a triangle, and a zero.
    pub triangles: Buffer,
    /// A vec4 a skin vertex, m, from the origin.
    pub positions: Buffer,
    /// A vec4 a skin vertex, unit, outward.
    pub normals: Buffer,
}

impl Draw {
    /// For a model whose bodies' skins take up these ranges of the vertices; `skin`: of the step, where it has one, whose arrays
    /// are shared.
    pub fn new(context: &Arc<Context>, model: &Model, ranges: &[Range<usize>], skin: Option<&Skin>) -> Result<Draw> {
        let vertices = model.skin_nodes.len();
        let constants = [("VERTICES", count(vertices))];
        let mut rigid_frames = vec![NONE; vertices];
        for (range, frame) in ranges.iter().zip(&model.body_frames) {
            rigid_frames[range.clone()].fill(*frame);
        }
        let (fan_first, fans) = fans(model);
        let shown = (16 * vertices.max(1)) as u64;
        Ok(Draw {
            place: Kernel::new(context, "draw/place", Size::Group, &constants)?,
            normals_kernel: Kernel::new(context, "draw/normals", Size::Group, &constants)?,
            vertex_count: vertices as u32,
            skin_nodes: match skin {
                Some(skin) => skin.skin_nodes.clone(),
                None => upload(context, "nodes of the skin", &model.skin_nodes)?,
            },
            skin_weights: match skin {
                Some(skin) => skin.skin_weights.clone(),
                None => upload(context, "weights of the skin", &model.skin_weights)?,
            },
            triangles: match skin {
                Some(skin) => skin.triangles.clone(),
                None => upload(context, "triangles", &model.triangles)?,
            },
            rigid_frames: upload(context, "frames of rigid vertices", &rigid_frames)?,
            fan_first: upload(context, "first triangles around shown vertices", &fan_first)?,
            fans: upload(context, "triangles around shown vertices", &fans)?,
            frames: Buffer::new(
                context,
                "shown frames",
                (model.frames.len().max(1) * size_of::<Frame>()) as u64,
                Memory::Upload,
            )?,
            positions: Buffer::shared(context, "shown positions", shown)?,
            normals: Buffer::shared(context, "shown normals", shown)?,
        })
    }

    /// What is shown.
    pub fn skins(&self) -> Skins<'_> {
        Skins { positions: &self.positions, normals: &self.normals, triangles: &self.triangles }
    }

    /// Two passes over all skin vertices.
    pub fn record(&self, recorder: &mut Recorder, elastic: &Elastic) {
        recorder.stage("draw");
        let buffers = [
            &self.frames,
            &self.skin_nodes,
            &self.skin_weights,
            &elastic.node_rest,
            &elastic.displacement,
            &elastic.node_info,
            &self.rigid_frames,
            &self.positions,
        ];
        recorder.dispatch(&self.place, &buffers, &[], self.vertex_count);
        let buffers = [&self.triangles, &self.fan_first, &self.fans, &self.positions, &self.normals];
        recorder.dispatch(&self.normals_kernel, &buffers, &[], self.vertex_count);
    }
}

/// Running totals of the triangles around each skin vertex, and those: of all vertices, where the model keeps those that contact
/// asks for.
fn fans(model: &Model) -> (Vec<u32>, Vec<u32>) {
    let mut first = vec![0u32; model.skin_nodes.len() + 1];
    let corners = || model.triangles.iter().enumerate().flat_map(|(t, [a, b, c, _])| [(t, a), (t, b), (t, c)]);
    corners().for_each(|(_, v)| first[*v as usize + 1] += 1);
    for v in 1..first.len() {
        first[v] += first[v - 1];
    }
    let (mut next, mut fans) = (first.clone(), vec![0; 3 * model.triangles.len()]);
    for (t, v) in corners() {
        fans[next[*v as usize] as usize] = t as u32;
        next[*v as usize] += 1;
    }
    (first, fans)
}
