//! Wrench stage: sums the contacts on the tool to net force, torque, stiffness and damping.

use std::sync::Arc;

use super::Common;
use super::contact::Touch;
use super::model::Model;
use crate::Result;
use crate::gpu::{Const, Context, Kernel, Recorder, Size};
use crate::shaders;

/// The kernel that sums over the contacts.
pub struct Wrench {
    reduce: Kernel,
}

impl Wrench {
    /// The kernel for a model.
    pub fn new(context: &Arc<Context>, model: &Model) -> Result<Wrench> {
        let friction = ("FRICTION", Const::Bool(model.friction[0] > 0.0));
        Ok(Wrench { reduce: Kernel::new(context, "wrench/reduce", Size::Reduce, &[friction])? })
    }

    /// Records one workgroup, which runs only in a step that is accepted.
    pub fn record(&self, recorder: &mut Recorder, common: &Common, touch: &Touch) {
        recorder.stage("wrench");
        let arguments = shaders::wrench::Reduce {
            params: &common.params,
            counts: &common.counts,
            contacts: &touch.contacts,
            contact_forces: &touch.contact_forces,
            report: &common.report,
        };
        recorder.dispatch_indirect(&self.reduce, &arguments, &common.args, shaders::ARGS_WRENCH);
    }
}
