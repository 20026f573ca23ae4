//! Points: vertices that ride on four nodes or on a frame, whatever mesh they are of.

use std::sync::Arc;

use super::super::elastic::Elastic;
use super::super::{count, upload};
use crate::Result;
use crate::gpu::{Buffer, Context, Kernel, Recorder, Size};

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
            rigid_frames: upload(context, "frames of rigid vertices", rigid_frames)?,
            positions: Buffer::shared(context, "shown positions", (16 * vertices.max(1)) as u64)?,
        })
    }

    /// One pass over them; `frames`: where the host put them.
    pub fn record(&self, recorder: &mut Recorder, frames: &Buffer, elastic: &Elastic) {
        recorder.stage("draw");
        let buffers = [
            frames,
            &self.nodes,
            &self.weights,
            &elastic.node_rest,
            &elastic.displacement,
            &elastic.node_info,
            &self.rigid_frames,
            &self.positions,
        ];
        recorder.dispatch(&self.place, &buffers, &[], self.count);
    }
}
