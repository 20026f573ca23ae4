//! The tool: the rigid body that the haptic device leads, through a virtual coupling (spring and damper between device
//! and tool). The tool has six unknowns in the step's linear system: the change of its twist (linear and angular
//! velocity). The host keeps the tool's pose and twist in f64 and computes the six rows, from inertia and coupling; the
//! solver on the GPU returns the change of twist. Where the tool is a body of the scene, the device leads that body's
//! first core (the rigid body to which nodes of a soft body are attached, or a dynamic rigid body itself), and only the
//! coupling is added to the core's rows.

use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};

use crate::scene::Coupling;
use crate::step::trajectory::rotation_vector;
use crate::step::{RigidState, Wrench};

/// Number of Newton iterations for the gyroscopic torque; they converge quadratically, starting from the angular
/// velocity at the start of the step.
const GYROSCOPIC_ROUNDS: usize = 4;

/// State and constants of the tool.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Tool {
    /// Mass, kg.
    pub mass: f64,
    /// Inertia tensor about the centre of mass, tool axes, kg m^2.
    pub inertia: DMat3,
    /// Virtual coupling to the haptic device; `None`: nothing holds the tool.
    pub coupling: Option<Coupling>,
    /// World position of the centre of mass, m.
    pub centre: DVec3,
    /// Rotation from the tool's axes to the world's.
    pub orientation: DQuat,
    /// Velocity of the centre of mass, world axes, m/s.
    pub velocity: DVec3,
    /// Angular velocity, world axes, rad/s.
    pub angular_velocity: DVec3,
}

/// The tool's rows of the linear system for the change of its twist (linear, then angular), without contact.
#[derive(Debug, Clone, Copy)]
pub struct Rows {
    /// Symmetric positive definite matrix, row by row.
    pub matrix: [[f64; 6]; 6],
    /// Right-hand side: three linear impulses, N s, then three angular impulses, N m s.
    pub rhs: [f64; 6],
}

impl Tool {
    /// Pose and twist of the tool.
    pub fn state(&self) -> RigidState {
        RigidState {
            position: self.centre,
            orientation: self.orientation,
            velocity: self.velocity,
            angular_velocity: self.angular_velocity,
        }
    }

    /// Velocity at the end of an implicit Euler step of `h` seconds without contact, under the coupling to a haptic device.
    /// If contact holds the tool (`is_pressed`), the spring to the device does not count, and the faster of both motions is
    /// the answer.
    pub fn free_velocity(&self, device: &RigidState, h: f64, is_pressed: bool) -> DVec3 {
        let Some(coupling) = &self.coupling else { return self.velocity };
        if is_pressed {
            let is_faster = device.velocity.length_squared() > self.velocity.length_squared();
            return if is_faster { device.velocity } else { self.velocity };
        }
        let (spring, damper) = (h * coupling.stiffness, h * coupling.damping);
        let pull = spring * (device.position - self.centre) + damper * device.velocity;
        (self.mass * self.velocity + pull) / (self.mass + damper + h * spring)
    }

    /// The tool's rows for an implicit Euler step of `h` seconds, linearised about the state at its start. They contain
    /// inertia, gravity, gyroscopic torque, and the coupling to the pose and twist of the haptic device at the end of
    /// the step.
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

    /// The rows of the coupling alone: the matrix h^2 K + h D (h: time step; K, D: stiffness and damping of the
    /// coupling), and the coupling's impulse over the step as right-hand side. Both are zero where nothing holds the
    /// tool.
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

    /// The wrench with which the coupling pulls the tool in its present state towards the haptic device's state
    /// `device`.
    pub fn pull(&self, device: &RigidState) -> Wrench {
        let Some(c) = &self.coupling else { return Wrench::ZERO };
        let turn = rotation_vector(device.orientation * self.orientation.conjugate());
        Wrench {
            force: c.stiffness * (device.position - self.centre) + c.damping * (device.velocity - self.velocity),
            torque: c.angular_stiffness * turn + c.angular_damping * (device.angular_velocity - self.angular_velocity),
        }
    }

    /// The state of the haptic device, with its position moved so close to the tool that the coupling's spring pulls no
    /// harder than `force` (N).
    pub fn within_reach(&self, device: &RigidState, force: f64) -> RigidState {
        let away = (device.position - self.centre).clamp_length_max(self.reach(force));
        RigidState { position: self.centre + away, ..*device }
    }

    /// The stretch of the coupling's spring, m, at which it pulls with `force` (N).
    fn reach(&self, force: f64) -> f64 {
        self.coupling.map_or(f64::INFINITY, |c| if c.stiffness > 0.0 { force / c.stiffness } else { f64::INFINITY })
    }

    /// Energy in the coupling's springs and kinetic energy of the tool, J. The linear spring is taken to pull no harder
    /// than `force` (N), however far away the haptic device is. `turns` tells whether the energy of the angular spring
    /// is included.
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

    /// Adds the change of twist that the solver found, and moves the tool for `h` seconds with the new twist.
    pub fn advance(&mut self, h: f64, change: [f64; 6]) {
        self.velocity += DVec3::from_slice(&change[..3]);
        self.angular_velocity += DVec3::from_slice(&change[3..]);
        self.centre += h * self.velocity;
        self.orientation = (DQuat::from_scaled_axis(h * self.angular_velocity) * self.orientation).normalize();
    }
}

/// Change of a rigid body's angular momentum by its own spin over `h` seconds, N m s. It is I (w1 - w0), where w1
/// solves the equation I (w1 - w0) + h w1 x I w1 = 0, I is the inertia tensor (world axes) at the start, and w0 = `w`
/// is the angular velocity at the start, rad/s (E. Catto 2015, "Physics for game programmers: numerical methods"). If
/// the torque at the start were used instead, a spinning body with unequal principal moments would gain energy.
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
    // A body without extent has a zero inertia tensor, so that `slope` has no inverse; its gyroscopic torque is zero.
    if impulse.is_finite() { impulse } else { DVec3::ZERO }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_free_velocity_solves_the_implicit_step_under_the_coupling() {
        let (stiffness, damping, h) = (800.0, 7.0, 4e-3);
        let coupling = Some(Coupling { stiffness, damping, angular_stiffness: 0.0, angular_damping: 0.0 });
        let device = RigidState {
            velocity: DVec3::new(0.0, 0.5, 0.1),
            ..RigidState::at_rest(DVec3::new(0.01, -0.02, 0.03), DQuat::IDENTITY)
        };
        let tool = Tool {
            mass: 0.2,
            inertia: DMat3::IDENTITY,
            coupling,
            centre: DVec3::new(0.02, 0.0, 0.0),
            orientation: DQuat::IDENTITY,
            velocity: DVec3::new(-0.3, 0.2, 0.0),
            angular_velocity: DVec3::ZERO,
        };
        let end = tool.free_velocity(&device, h, false);
        let pull = stiffness * (device.position - tool.centre - h * end) + damping * (device.velocity - end);
        assert!((tool.mass * (end - tool.velocity) - h * pull).length() < 1e-15);
        assert_eq!(tool.free_velocity(&device, h, true), device.velocity);
        assert_eq!(Tool { coupling: None, ..tool.clone() }.free_velocity(&device, h, false), tool.velocity);
    }
}
