//! The tool: a rigid body of six unknowns. The host keeps its pose and twist in f64 and gives the device its part of the
//! step's linear system, inertia and virtual coupling; the solver on the device gives back the change of its twist.

use glam::{DMat3, DQuat, DVec3};

use super::drive::{Device, rotation_vector};
use crate::scene::Coupling;

/// The tool's state and constants.
#[derive(Debug, Clone)]
pub struct Tool {
    /// kg.
    pub mass: f64,
    /// About the centre, tool axes, kg m^2.
    pub inertia: DMat3,
    /// Virtual coupling; `None`: nothing holds it.
    pub coupling: Option<Coupling>,
    /// World position of its centre of mass, m.
    pub centre: DVec3,
    /// Tool to world.
    pub orientation: DQuat,
    /// World, m/s.
    pub velocity: DVec3,
    /// World, rad/s.
    pub angular_velocity: DVec3,
}

/// The tool's rows of the linear system for the change of its twist (linear, then angular), without contact.
#[derive(Debug, Clone, Copy)]
pub struct Rows {
    /// Symmetric positive definite, by rows.
    pub matrix: [[f64; 6]; 6],
    /// Right-hand side.
    pub rhs: [f64; 6],
}

impl Tool {
    /// Implicit Euler over `h` seconds, linearised about the start: gravity, gyroscopic torque (explicit), and the
    /// coupling towards the device's pose and twist at the end of the step.
    pub fn rows(&self, h: f64, gravity: DVec3, device: &Device) -> Rows {
        let turn = DMat3::from_quat(self.orientation);
        let mut angular = turn * self.inertia * turn.transpose();
        let (v, w) = (self.velocity, self.angular_velocity);
        let mut linear = self.mass;
        let mut force = self.mass * gravity;
        let mut torque = -w.cross(angular * w);
        if let Some(c) = &self.coupling {
            linear += h * (h * c.stiffness + c.damping);
            angular += DMat3::from_diagonal(DVec3::splat(h * (h * c.angular_stiffness + c.angular_damping)));
            let turn = rotation_vector(device.orientation * self.orientation.conjugate());
            force += c.stiffness * (device.position - self.centre - h * v) + c.damping * (device.velocity - v);
            torque += c.angular_stiffness * (turn - h * w) + c.angular_damping * (device.angular_velocity - w);
        }
        let mut rows = Rows { matrix: [[0.0; 6]; 6], rhs: [0.0; 6] };
        for i in 0..3 {
            rows.matrix[i][i] = linear;
            rows.rhs[i] = h * force[i];
            rows.rhs[3 + i] = h * torque[i];
            for k in 0..3 {
                rows.matrix[3 + i][3 + k] = angular.col(k)[i];
            }
        }
        rows
    }

    /// Takes the solved change of the twist and moves for `h` seconds.
    pub fn advance(&mut self, h: f64, change: [f32; 6]) {
        let change = change.map(f64::from);
        self.velocity += DVec3::from_slice(&change[..3]);
        self.angular_velocity += DVec3::from_slice(&change[3..]);
        self.centre += h * self.velocity;
        self.orientation = (DQuat::from_scaled_axis(h * self.angular_velocity) * self.orientation).normalize();
    }
}
