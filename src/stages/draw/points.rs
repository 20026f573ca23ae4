//! Vertices to be drawn, of any mesh, each attached to four nodes with weights or to one rigid coordinate frame.

use std::sync::Arc;

use super::super::elastic::Elastic;
use super::super::{count, upload};
use crate::Result;
use crate::gpu::{Buffer, Context, Kernel, Recorder, Size};
use crate::shaders;

/// The vertices' attachments, and their positions.
pub struct Points {
    place: Kernel,
    /// Number of vertices.
    pub count: u32,
    /// Per vertex: its four nodes; the first is `NONE` where the vertex is attached to a frame.
    pub nodes: Buffer,
    /// Per vertex: the weights of its nodes, or, where it is attached to a frame, its position in that frame, m.
    pub weights: Buffer,
    rigid_frames: Buffer,
    /// Per vertex: its current position, m, relative to the same origin as the frames that [`Points::record`] is given;
    /// w is 1.
    pub positions: Buffer,
}

impl Points {
    /// Kernel and arrays for `vertices` vertices; `rigid_frames`: per vertex, the frame that it is attached to, or
    /// `NONE`.
    pub fn new(
        context: &Arc<Context>,
        vertices: usize,
        nodes: Buffer,
        weights: Buffer,
        rigid_frames: &[u32],
    ) -> Result<Points> {
        Ok(Points {
            place: Kernel::new(context, "draw/place", Size::Group, &[("VERTICES", count(vertices))])?,
            count: vertices as u32,
            nodes,
            weights,
            rigid_frames: upload(context, "rigid_frames", rigid_frames)?,
            positions: Buffer::shared(context, "positions", (16 * vertices.max(1)) as u64)?,
        })
    }

    /// Records one pass over the vertices; `frames`: the current poses of the coordinate frames, written by the host.
    pub fn record(&self, recorder: &mut Recorder, frames: &Buffer, elastic: &Elastic) {
        recorder.stage("draw");
        let arguments = shaders::draw::Place {
            frames,
            skin_nodes: &self.nodes,
            skin_weights: &self.weights,
            node_rest: &elastic.node_rest,
            displacement: &elastic.displacement,
            node_info: &elastic.node_info,
            rigid_frames: &self.rigid_frames,
            positions: &self.positions,
        };
        recorder.dispatch(&self.place, &arguments, self.count);
    }
}
