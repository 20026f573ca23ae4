//! The tool: a rigid body of six unknowns. The host keeps its pose and twist in f64 and gives the device its part of the
//! step's linear system, inertia and virtual coupling; the solver on the device gives back the change of its twist. Where
//! the tool is a soft body, it is that body's first core, and only the coupling is added to that core's rows.

use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};

use crate::scene::Coupling;
use crate::step::drive::rotation_vector;
use crate::step::{RigidState, Wrench};

/// Newton's rounds for the gyroscopic term; it converges quadratically from the start's spin.
const GYROSCOPIC_ROUNDS: usize = 4;

/// The tool's state and constants.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
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
    /// Its pose and twist.
    pub fn state(&self) -> RigidState {
        RigidState {
            position: self.centre,
            orientation: self.orientation,
            velocity: self.velocity,
            angular_velocity: self.angular_velocity,
        }
    }

    /// Implicit Euler over `h` seconds, linearised about the start: gravity, gyroscopic torque, and the
    /// coupling towards the device's pose and twist at the end of the step.
    pub fn rows(&self, h: f64, gravity: DVec3, device: &RigidState) -> Rows {
        let turn = DMat3::from_quat(self.orientation);
        let inertia = turn * self.inertia * turn.transpose();
        let gyroscopic = gyroscopic_impulse(inertia, self.angular_velocity, h);
        let mut rows = self.coupling_rows(h, device);
        for i in 0..3 {
            rows.matrix[i][i] += self.mass;
            rows.rhs[i] += h * self.mass * gravity[i];
            rows.rhs[3 + i] += gyroscopic[i];
            for k in 0..3 {
                rows.matrix[3 + i][3 + k] += inertia.col(k)[i];
            }
        }
        rows
    }

    /// What the coupling alone adds to the rows: h^2 K + h D, and its impulse; zero where nothing holds the tool.
    pub fn coupling_rows(&self, h: f64, device: &RigidState) -> Rows {
        let mut rows = Rows { matrix: [[0.0; 6]; 6], rhs: [0.0; 6] };
        let Some(c) = &self.coupling else { return rows };
        let (v, w) = (self.velocity, self.angular_velocity);
        let turn = rotation_vector(device.orientation * self.orientation.conjugate());
        let force = c.stiffness * (device.position - self.centre - h * v) + c.damping * (device.velocity - v);
        let torque = c.angular_stiffness * (turn - h * w) + c.angular_damping * (device.angular_velocity - w);
        for i in 0..3 {
            rows.matrix[i][i] = h * (h * c.stiffness + c.damping);
            rows.matrix[3 + i][3 + i] = h * (h * c.angular_stiffness + c.angular_damping);
            rows.rhs[i] = h * force[i];
            rows.rhs[3 + i] = h * torque[i];
        }
        rows
    }

    /// What the coupling pulls the tool with now, towards a device.
    pub fn pull(&self, device: &RigidState) -> Wrench {
        let Some(c) = &self.coupling else { return Wrench::ZERO };
        let turn = rotation_vector(device.orientation * self.orientation.conjugate());
        Wrench {
            force: c.stiffness * (device.position - self.centre) + c.damping * (device.velocity - self.velocity),
            torque: c.angular_stiffness * turn + c.angular_damping * (device.angular_velocity - self.angular_velocity),
        }
    }

    /// A device as the coupling feels it: drawn up to the tool so far that the coupling's stiffness pulls no harder than `force`
    /// (N).
    pub fn within_reach(&self, device: &RigidState, force: f64) -> RigidState {
        let away = (device.position - self.centre).clamp_length_max(self.reach(force));
        RigidState { position: self.centre + away, ..*device }
    }

    /// How far the coupling stretches before it pulls with `force` (N), m.
    fn reach(&self, force: f64) -> f64 {
        self.coupling.map_or(f64::INFINITY, |c| if c.stiffness > 0.0 { force / c.stiffness } else { f64::INFINITY })
    }

    /// What the coupling and the tool's motion store, J. The coupling pulls no harder than `force` (N), however far the device
    /// is; `turns`: whether its turning is felt.
    pub fn stored(&self, device: &RigidState, force: f64, turns: bool) -> f64 {
        let turn = DMat3::from_quat(self.orientation);
        let (v, w) = (self.velocity, turn.transpose() * self.angular_velocity);
        let motion = 0.5 * self.mass * v.length_squared() + 0.5 * w.dot(self.inertia * w);
        let springs = self.coupling.map_or(0.0, |c| {
            let turn = rotation_vector(device.orientation * self.orientation.conjugate());
            let stretch = (device.position - self.centre).length();
            let near = stretch.min(self.reach(force));
            let angular = if turns { 0.5 * c.angular_stiffness * turn.length_squared() } else { 0.0 };
            c.stiffness * near * (stretch - 0.5 * near) + angular
        });
        motion + springs
    }

    /// Takes the solved change of the twist and moves for `h` seconds.
    pub fn advance(&mut self, h: f64, change: [f64; 6]) {
        self.velocity += DVec3::from_slice(&change[..3]);
        self.angular_velocity += DVec3::from_slice(&change[3..]);
        self.centre += h * self.velocity;
        self.orientation = (DQuat::from_scaled_axis(h * self.angular_velocity) * self.orientation).normalize();
    }
}

/// What a rigid body's spin gives to its angular momentum over `h` seconds, N m s: I (w1 - w0) with
/// I (w1 - w0) + h w1 x I w1 = 0, the inertia (world axes) held as at the start (E. Catto 2015, "Physics for game
/// programmers: numerical methods"). Taken at the start instead, the torque would feed the spin of any body that is not
/// round. `w`: at the start, rad/s.
pub fn gyroscopic_impulse(inertia: DMat3, w: DVec3, h: f64) -> DVec3 {
    let cross =
        |v: DVec3| DMat3::from_cols(DVec3::new(0.0, v.z, -v.y), DVec3::new(-v.z, 0.0, v.x), DVec3::new(v.y, -v.x, 0.0));
    let mut end = w;
    for _ in 0..GYROSCOPIC_ROUNDS {
        let momentum = inertia * end;
        let residual = inertia * (end - w) + h * end.cross(momentum);
        let slope = inertia + h * (cross(end) * inertia - cross(momentum));
        end -= slope.inverse() * residual;
    }
    let impulse = inertia * (end - w);
    // Of no use where it cannot be solved: a body without extent has no such torque.
    if impulse.is_finite() { impulse } else { DVec3::ZERO }
}
