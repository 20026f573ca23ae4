//! What a tool can meet: a simulation, or a wall of known stiffness to measure the loop with.

use glam::DVec3;

use super::device::{RigidState, Wrench};
use super::local_model::ContactWrench;
use super::servo::state_of;
use super::servo_thread::Held;
use super::tool::Tool;
use crate::Result;
use crate::step::Simulation;

/// Steps from what the loop holds to what the tool feels.
pub trait Environment {
    /// A step of `h` s from a state of device and tool.
    fn feel(&mut self, held: &Held, h: f64) -> Result<ContactWrench>;
}

impl Environment for Simulation {
    fn feel(&mut self, held: &Held, h: f64) -> Result<ContactWrench> {
        self.step_held(held, h)?;
        let nothing = || ContactWrench { time: held.time, ..ContactWrench::none(held.tool) };
        Ok(self.contact_wrench().copied().unwrap_or_else(nothing))
    }
}

/// All below y = 0, pushing up with stiffness and damping on a point: F = max(0, -k y - d y').
#[derive(Debug, Clone)]
pub struct Wall {
    /// N/m.
    pub stiffness: f64,
    /// N s/m.
    pub damping: f64,
    /// As the loop's.
    pub tool: Tool,
    /// Steps done.
    pub steps: u64,
}

impl Environment for Wall {
    /// As a simulation does: the tool by implicit Euler towards the device as it is, then the force at the end.
    fn feel(&mut self, held: &Held, h: f64) -> Result<ContactWrench> {
        let tool = &mut self.tool;
        tool.coupling = held.coupling;
        let RigidState { position, orientation, velocity, angular_velocity } = held.tool;
        (tool.centre, tool.orientation) = (position, orientation);
        (tool.velocity, tool.angular_velocity) = (velocity, angular_velocity);
        let device = RigidState::at_rest(held.device.position, held.device.orientation);
        let rows = tool.rows(h, DVec3::ZERO, &device);
        let force = |y: f64, v: f64| -self.stiffness * y - self.damping * v;
        let mut change: [f64; 6] = std::array::from_fn(|k| rows.rhs[k] / rows.matrix[k][k]);
        if position.y + h * (velocity.y + change[1]) < 0.0 {
            let held_up = rows.rhs[1] + h * force(position.y + h * velocity.y, velocity.y);
            change[1] = held_up / (rows.matrix[1][1] + h * (self.damping + h * self.stiffness));
        }
        tool.advance(h, change);
        self.steps += 1;
        let depth = (-tool.centre.y).max(0.0);
        let push = if depth > 0.0 { force(tool.centre.y, tool.velocity.y).max(0.0) } else { 0.0 };
        let mut wrench = ContactWrench {
            step: self.steps,
            time: held.time,
            wrench: Wrench { force: DVec3::Y * push, torque: DVec3::ZERO },
            pressing: push,
            ..ContactWrench::none(state_of(tool))
        };
        if push > 0.0 {
            (wrench.stiffness[1][1], wrench.damping[1][1]) = (self.stiffness, self.damping);
        }
        Ok(wrench)
    }
}
