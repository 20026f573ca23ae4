//! The stages that find contact (pose, cull, skin, depth, contact) together. They run at the start of a step, and alone
//! in the proximity query, which finds contact between two rigid bodies without forces.

use std::sync::Arc;

use super::contact::{Contact, Motion};
use super::cull::Cull;
use super::depth::{Depth, Path};
use super::elastic::Elastic;
use super::model::Model;
use super::overlaps::Overlaps;
use super::skin::Skin;
use super::solve::Solve;
use super::{Common, pose};
use crate::gpu::{Context, Recorder};
use crate::{Error, Result};

/// The stages from pose to contact, which only scenes where something can touch have.
pub struct TouchStages {
    /// Pose stage: the collision proxies (convex hulls that cover the skins) in the world, and their bounds.
    pub pose: pose::Pose,
    /// Skin stage: the skins (surface meshes) in the world.
    pub skin: Skin,
    /// Cull stage: the broad phase, which finds the parts of the skins that may touch.
    pub cull: Cull,
    /// Depth stage: the narrow phase, which casts rays from skin vertices; `None` where only half-spaces can be
    /// touched.
    pub depth: Option<Depth>,
    /// The overlaps of triangles, from which contacts are made where triangles are tested in place of vertices; `None`
    /// where no pair is tested so.
    pub overlaps: Option<Overlaps>,
    /// Contact stage: the skin vertices that lie inside another body.
    pub contact: Contact,
}

impl TouchStages {
    /// Kernels and arrays of the stages from pose to contact. `path`: the implementation of the depth stage, graphics
    /// or compute, `None` where no two skins can meet; `blend`: given to [`Contact::new`] as `blend` and to
    /// [`Cull::new`] as `smooth`.
    pub fn new(context: &Arc<Context>, model: &Model, path: Option<Path>, blend: bool) -> Result<TouchStages> {
        // Numbers of workgroups that the GPU itself sets, so that no dispatch checks them.
        let most = context.most_workgroups();
        for (what, count) in [("pairs of hulls", model.proxy_pairs.len()), ("hulls", model.pair_proxies.len())] {
            if count > most as usize {
                return Err(Error::Memory(format!(
                    "{count} {what} may touch, but {} runs at most {most} workgroups at once; give bodies fewer \
                     collision hulls",
                    context.device_name()
                )));
            }
        }
        Ok(TouchStages {
            pose: pose::Pose::new(context, model)?,
            skin: Skin::new(context, model)?,
            cull: Cull::new(context, model, blend)?,
            depth: path.map(|path| Depth::new(context, model, path)).transpose()?,
            overlaps: model.needs_overlaps().then(|| Overlaps::new(context, model)).transpose()?,
            contact: Contact::new(context, model, path.is_some(), blend)?,
        })
    }

    /// Records the stages in the order in which they run: pose, cull, skin, depth, contact. `solve`: what friction needs
    /// of the last step's solution; `None` where there is no friction.
    pub fn record(&self, recorder: &mut Recorder, common: &Common, elastic: &Elastic, solve: Option<&Solve>) {
        self.record_pose(recorder, common, elastic);
        self.record_broad_phase(recorder, common, elastic);
        self.record_narrow_phase(recorder, common, elastic, solve);
    }

    /// Records the stage pose, which also resets the counters of the step.
    pub fn record_pose(&self, recorder: &mut Recorder, common: &Common, elastic: &Elastic) {
        recorder.upload(&self.cull.pairs);
        self.skin.record_clear(recorder);
        self.pose.record(recorder, common, elastic);
    }

    /// Records the stage cull.
    pub fn record_broad_phase(&self, recorder: &mut Recorder, common: &Common, elastic: &Elastic) {
        self.cull.record(recorder, common, &self.pose, &self.contact, elastic);
    }

    /// Records the stages skin, depth and contact; `solve` as for [`TouchStages::record`].
    pub fn record_narrow_phase(
        &self,
        recorder: &mut Recorder,
        common: &Common,
        elastic: &Elastic,
        solve: Option<&Solve>,
    ) {
        let TouchStages { pose, skin, cull, depth, overlaps, contact } = self;
        skin.record(recorder, common, pose, cull, elastic);
        if let Some(depth) = depth {
            depth.record(recorder, common, cull, skin);
        }
        if let Some(overlaps) = overlaps {
            overlaps.record(recorder, common, pose, cull, skin);
        }
        contact.record(recorder, common, cull, skin, (depth.as_ref(), overlaps.as_ref()), &Motion { elastic, solve });
    }
}
