//! What a picture shows of a simulation between two steps, besides the arrays on the device.

use glam::{DQuat, DVec3};

use crate::Result;
use crate::step::Simulation;

/// A simulation as it was when [`Moment::of`] looked.
#[derive(Debug, Clone)]
pub struct Moment {
    /// Simulated time, s.
    pub time: f64,
    /// Where the tool is, and how it is turned.
    pub tool: Option<(DVec3, DQuat)>,
    /// Contact force on the tool, N.
    pub force: DVec3,
    /// Contact torque on the tool about its centre, N m.
    pub torque: DVec3,
    /// Where the first frame of each body is, the tool's last, m.
    pub frames: Vec<Option<DVec3>>,
}

impl Moment {
    /// Fills the arrays of the shown skins, relative to `origin`, and says where the rest is. Between two steps.
    pub fn of(simulation: &mut Simulation, origin: DVec3) -> Result<Moment> {
        simulation.skins(origin)?;
        let wrench = simulation.contact_wrench().map(|felt| felt.wrench).unwrap_or_default();
        let frames = (0..simulation.bodies().len()).map(|body| simulation.frames(body).first().map(|p| p.centre));
        let tool = simulation.tool().map(|tool| tool.centre);
        Ok(Moment {
            time: simulation.time(),
            tool: simulation.tool().map(|tool| (tool.centre, tool.orientation)),
            force: wrench.force,
            torque: wrench.torque,
            frames: frames.chain([tool]).collect(),
        })
    }
}
