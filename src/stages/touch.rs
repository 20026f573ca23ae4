//! The stages from pose to contact together, which the step and the proximity query have in common.

use std::sync::Arc;

use super::contact::Contact;
use super::cull::Cull;
use super::depth::{Depth, Path};
use super::elastic::Elastic;
use super::model::Model;
use super::skin::Skin;
use super::{Common, pose};
use crate::Result;
use crate::gpu::{Context, Recorder};

/// The stages of scenes where something can touch.
pub struct TouchStages {
    /// Pose stage: the collision proxies (convex hulls that cover the skins) in the world, and their bounds.
    pub pose: pose::Pose,
    /// Skin stage: the skins (surface meshes) in the world.
    pub skin: Skin,
    /// Cull stage: the broad phase.
    pub cull: Cull,
    /// Depth stage: the narrow phase; `None` where only half-spaces can be touched.
    pub depth: Option<Depth>,
    /// Contact stage: the colliding vertices.
    pub contact: Contact,
}

impl TouchStages {
    /// Kernels and arrays of the stages from pose to contact. `path`: the implementation of the depth stage, graphics
    /// or compute, where that stage is needed; `blend`: as in [`Contact::new`], and also `smooth` of [`Cull::new`].
    pub fn new(context: &Arc<Context>, model: &Model, path: Option<Path>, blend: bool) -> Result<TouchStages> {
        Ok(TouchStages {
            pose: pose::Pose::new(context, model)?,
            skin: Skin::new(context, model)?,
            cull: Cull::new(context, model, blend)?,
            depth: path.map(|path| Depth::new(context, model, path)).transpose()?,
            contact: Contact::new(context, model, path.is_some(), blend)?,
        })
    }

    /// Records the stages in the order in which they run: pose, cull, skin, depth, contact.
    pub fn record(&self, recorder: &mut Recorder, common: &Common, elastic: &Elastic) {
        let TouchStages { pose, skin, cull, depth, contact } = self;
        pose.record(recorder, common, elastic, skin);
        cull.record(recorder, common, pose, skin, contact, elastic);
        skin.record(recorder, common, pose, cull, elastic);
        if let Some(depth) = depth {
            depth.record(recorder, common, cull, skin);
        }
        contact.record(recorder, common, cull, skin, depth.as_ref(), elastic);
    }
}
