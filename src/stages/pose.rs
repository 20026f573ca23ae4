//! Pose: proxies into the world, and the step's counters to zero; nodes that driven frames carry, floating frames fitted.

use std::sync::Arc;

use super::elastic::Elastic;
use super::model::Model;
use super::types::Fit;
use super::{Common, array, count, upload};
use crate::Result;
use crate::gpu::{Buffer, Context, Kernel, Memory, Recorder, Size};

/// Hulls and faces at rest and in the world.
pub struct Pose {
    place: Kernel,
    items: u32,
    hull_rest: Buffer,
    face_rest: Buffer,
    face_frame: Buffer,
    /// Hull vertices of all proxies, relative to the origin.
    pub hull: Buffer,
    /// Face planes of all proxies.
    pub faces: Buffer,
}

impl Pose {
    /// Kernels and arrays for a model.
    pub fn new(context: &Arc<Context>, model: &Model) -> Result<Pose> {
        let (hull, faces) = (model.hull.len(), model.faces.len());
        let constants = [
            ("HULL_VERTICES", count(hull)),
            ("FACES", count(faces)),
            ("TETRAHEDRA", count(model.tetrahedra.len())),
            ("GROUP", context.group_size().into()),
        ];
        Ok(Pose {
            place: Kernel::new(context, "pose/place", Size::Group, &constants)?,
            items: (hull + faces) as u32,
            hull_rest: upload(context, "hull at rest", &model.hull)?,
            face_rest: upload(context, "faces at rest", &model.faces)?,
            face_frame: upload(context, "frames of faces", &model.face_frames)?,
            hull: array::<[f32; 4]>(context, "hull", hull)?,
            faces: array::<[f32; 4]>(context, "faces", faces)?,
        })
    }

    /// One pass over hull vertices and faces.
    pub fn record(&self, recorder: &mut Recorder, common: &Common) {
        recorder.stage("pose");
        recorder.dispatch(
            &self.place,
            &[
                &common.frames,
                &self.hull_rest,
                &self.face_rest,
                &self.face_frame,
                &self.hull,
                &self.faces,
                &common.counts,
                &common.args,
            ],
            &[],
            self.items,
        );
    }
}

/// Nodes that driven frames carry.
pub struct Driven {
    drive: Kernel,
    count: u32,
    nodes: Buffer,
}

impl Driven {
    /// Kernel and nodes; `None` where no frame with nodes is driven.
    pub fn new(context: &Arc<Context>, model: &Model) -> Result<Option<Driven>> {
        if model.driven_nodes.is_empty() {
            return Ok(None);
        }
        let nodes = count(model.driven_nodes.len());
        Ok(Some(Driven {
            drive: Kernel::new(context, "pose/drive", Size::Group, &[("DRIVEN", nodes)])?,
            count: model.driven_nodes.len() as u32,
            nodes: upload(context, "driven nodes", &model.driven_nodes)?,
        }))
    }

    /// At the start of the step: one pass over carried nodes.
    pub fn record(&self, recorder: &mut Recorder, common: &Common, elastic: &Elastic) {
        recorder.stage("pose");
        let buffers =
            [&common.params, &common.frames, &self.nodes, &elastic.node_info, &elastic.node_rest, &elastic.velocity];
        recorder.dispatch(&self.drive, &buffers, &[], self.count);
    }
}

/// Floating frames.
pub struct Floating {
    fit: Kernel,
    count: u32,
    frames: Buffer,
    /// A [`Fit`] a floating frame, for the host.
    pub fits: Buffer,
}

impl Floating {
    /// Kernel and arrays; `None` where no frame floats.
    pub fn new(context: &Arc<Context>, model: &Model) -> Result<Option<Floating>> {
        if model.floating.is_empty() {
            return Ok(None);
        }
        let of = |f: &super::model::Floating| [f.frame as u32, f.nodes.start as u32, f.nodes.len() as u32, 0];
        let frames: Vec<[u32; 4]> = model.floating.iter().map(of).collect();
        Ok(Some(Floating {
            fit: Kernel::new(context, "pose/fit", Size::Reduce, &[])?,
            count: frames.len() as u32,
            frames: upload(context, "floating frames", &frames)?,
            fits: Buffer::new(context, "fits", (frames.len() * size_of::<Fit>()) as u64, Memory::Readback)?,
        }))
    }

    /// At the end of the step: a workgroup a frame.
    pub fn record(&self, recorder: &mut Recorder, common: &Common, elastic: &Elastic) {
        recorder.stage("pose");
        let buffers =
            [&common.frames, &self.frames, &elastic.node_rest, &elastic.displacement, &elastic.velocity, &self.fits];
        recorder.dispatch_groups(&self.fit, &buffers, &[], self.count);
    }
}
