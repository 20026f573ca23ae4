//! Points: vertices that ride on four nodes or on a frame, whatever mesh they are of.

use std::sync::Arc;

use super::super::elastic::Elastic;
use super::super::{count, upload};
use crate::Result;
use crate::gpu::{Buffer, Context, Kernel, Recorder, Size};
use crate::shaders;

/// Where they ride, and where they are.
pub struct Points {
    place: Kernel,
    /// How many.
    pub count: u32,
    /// Four nodes each; `NONE` first: on a frame.
    pub nodes: Buffer,
    /// Their weights; or the position in the frame, m.
    pub weights: Buffer,
    rigid_frames: Buffer,
    /// A vec4 each, m, from the origin; w is 1.
    pub positions: Buffer,
}

impl Points {
    /// `count` of them; `rigid_frames`: the frame of each that rides on one.
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

    /// One pass over them; `frames`: where the host put them.
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
