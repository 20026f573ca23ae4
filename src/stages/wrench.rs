//! Wrench stage, after the solve in a step: sums all contacts on each tool (a rigid body that a haptic device leads) to a
//! net force and torque, and for the first tool to stiffness and damping.

use std::sync::Arc;

use super::Common;
use super::contact::Touch;
use super::model::Model;
use crate::Result;
use crate::gpu::{Buffer, Const, Context, Kernel, Recorder, Size};
use crate::shaders;

/// The kernel that sums over the contacts.
pub struct Wrench {
    reduce: Kernel,
}

impl Wrench {
    /// The kernel for a model.
    pub fn new(context: &Arc<Context>, model: &Model) -> Result<Wrench> {
        let friction = ("FRICTION", Const::Bool(model.friction[0] > 0.0));
        let tools = ("TOOLS", super::count(model.tool_count()));
        Ok(Wrench { reduce: Kernel::new(context, "wrench/reduce", Size::Reduce, &[friction, tools])? })
    }

    /// Records one pass of a workgroup for each tool, which runs only where the step's solution is accepted. `pairs`: the
    /// pairs of bodies that may touch.
    pub fn record(&self, recorder: &mut Recorder, common: &Common, touch: &Touch, pairs: &Buffer) {
        recorder.stage("wrench");
        let arguments = shaders::wrench::Reduce {
            params: &common.params,
            counts: &common.counts,
            contacts: &touch.contacts,
            pairs: Some(pairs),
            contact_forces: &touch.contact_forces,
            report: &common.report,
        };
        recorder.dispatch_indirect(&self.reduce, &arguments, &common.args, shaders::ARGS_WRENCH);
    }
}
