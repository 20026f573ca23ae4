//! Pose: proxies into the world, and the step's counters to zero.

use std::sync::Arc;

use super::model::Model;
use super::{Common, array, count, upload};
use crate::Result;
use crate::gpu::{Buffer, Context, Kernel, Recorder, Size};

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
