//! Wrench stage, after the solve in a step: sums all contacts on the tool (the rigid body that the haptic device leads)
//! to a net force, torque, stiffness and damping.

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

    /// Records one pass of one workgroup, which runs only where the step's solution is accepted.
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
