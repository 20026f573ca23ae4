//! Pose (position and orientation), twist (linear and angular velocity) and wrench (force and torque) of a rigid
//! object: the haptic device, or the tool, which is the rigid body that the device leads.

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// Pose and twist of a rigid object, world axes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RigidState {
    /// World position, m.
    pub position: DVec3,
    /// Rotation from the object's axes to the world's.
    pub orientation: DQuat,
    /// World velocity, m/s.
    pub velocity: DVec3,
    /// World angular velocity, rad/s.
    pub angular_velocity: DVec3,
}

impl RigidState {
    /// The state at rest in a pose.
    pub fn at_rest(position: DVec3, orientation: DQuat) -> RigidState {
        RigidState { position, orientation, velocity: DVec3::ZERO, angular_velocity: DVec3::ZERO }
    }

    /// Whether all numbers are finite, and the orientation is a unit quaternion to 1e-3.
    pub fn is_valid(&self) -> bool {
        let finite = [self.position, self.velocity, self.angular_velocity].iter().all(|v| v.is_finite());
        finite && (self.orientation.length() - 1.0).abs() < 1e-3
    }
}

/// A force and a torque, world axes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Wrench {
    /// Force, N.
    pub force: DVec3,
    /// Torque, N m, about the position of the object that it acts on, or about a point that is named.
    pub torque: DVec3,
}

impl Wrench {
    /// No force and no torque.
    pub const ZERO: Wrench = Wrench { force: DVec3::ZERO, torque: DVec3::ZERO };

    /// Whether force and torque are finite.
    pub fn is_finite(&self) -> bool {
        self.force.is_finite() && self.torque.is_finite()
    }
}
