//! The tool, a rigid body that the haptic device leads by virtual coupling (spring and damper), in f64: its inertia,
//! its terms in the linear system A x = b of a time step, and its motion over the step.

use glam::{DMat3, DQuat, DVec3};
use palpate::scene::Coupling;

use crate::elastic::outer;
use crate::linear::Entries;

/// A rigid body with six unknowns in the system: the change of `velocity`, then of `angular_velocity`, over the step.
#[derive(Debug, Clone)]
pub struct Tool {
    /// Mass, kg.
    pub mass: f64,
    /// Inertia about the centre of mass, tool axes, kg m^2.
    pub inertia: DMat3,
    /// Centre of mass, m.
    pub centre: DVec3,
    /// Rotation from tool axes to world axes.
    pub orientation: DQuat,
    /// Velocity of the centre, m/s.
    pub velocity: DVec3,
    /// Angular velocity, rad/s, world axes.
    pub angular_velocity: DVec3,
    /// Virtual coupling (spring and damper) to the device; `None`: the tool moves freely.
    pub coupling: Option<Coupling>,
}

/// Pose and twist of the haptic device at the end of a step.
#[derive(Debug, Clone, Copy, Default)]
pub struct Device {
    /// Position of the device's handle, m.
    pub position: DVec3,
    /// Rotation from the handle's axes to world axes.
    pub orientation: DQuat,
    /// Velocity of the handle, m/s.
    pub velocity: DVec3,
    /// Angular velocity of the handle, rad/s, world axes.
    pub angular_velocity: DVec3,
}

impl Tool {
    /// A solid sphere at rest, without coupling.
    pub fn sphere(radius: f64, mass: f64, centre: DVec3) -> Self {
        let inertia = DMat3::from_diagonal(DVec3::splat(0.4 * mass * radius * radius));
        let (velocity, angular_velocity) = (DVec3::ZERO, DVec3::ZERO);
        Self { mass, inertia, centre, orientation: DQuat::IDENTITY, velocity, angular_velocity, coupling: None }
    }

    /// Inertia tensor about the centre, kg m^2, world axes.
    pub fn world_inertia(&self) -> DMat3 {
        let r = DMat3::from_quat(self.orientation);
        r * self.inertia * r.transpose()
    }

    /// World position, m, of the point `local`, given in tool axes relative to the centre.
    pub fn place(&self, local: DVec3) -> DVec3 {
        self.centre + self.orientation * local
    }

    /// Adds the tool's terms of a step of `h` seconds to the system's matrix `a` and right-hand side `b`, at the tool's
    /// six unknowns, which begin at `first`: inertia, gravity, the gyroscopic torque, and the virtual coupling to the
    /// device's pose and twist at the end of the step.
    pub fn add_terms(
        &self,
        a: &mut Entries,
        b: &mut [f64],
        first: usize,
        h: f64,
        gravity: DVec3,
        device: Option<&Device>,
    ) {
        let inertia = self.world_inertia();
        let mut linear = DMat3::from_diagonal(DVec3::splat(self.mass));
        let mut angular = inertia;
        let mut impulse = gravity * self.mass * h;
        let mut twist = gyroscopic(inertia, self.angular_velocity, h);
        if let (Some(spring), Some(device)) = (&self.coupling, device) {
            let pose = (self.centre, self.orientation);
            let ([along, about], [push, wrest]) =
                coupling_terms(spring, pose, (self.velocity, self.angular_velocity), h, device);
            let identity = |x: f64| DMat3::from_diagonal(DVec3::splat(x));
            linear += identity(along);
            angular += identity(about);
            impulse += push;
            twist += wrest;
        }
        for i in 0..3 {
            for j in 0..3 {
                a.add(first + i, first + j, linear.col(j)[i]);
                a.add(first + 3 + i, first + 3 + j, angular.col(j)[i]);
            }
            b[first + i] += impulse[i];
            b[first + 3 + i] += twist[i];
        }
    }

    /// Force (N) and torque (N m) of the virtual coupling on the tool in its present state.
    pub fn coupling_wrench(&self, device: &Device) -> (DVec3, DVec3) {
        let Some(spring) = &self.coupling else { return (DVec3::ZERO, DVec3::ZERO) };
        let turn = rotation_vector(device.orientation * self.orientation.conjugate());
        let force = spring.stiffness * (device.position - self.centre);
        let torque = spring.angular_stiffness * turn;
        let slip = device.angular_velocity - self.angular_velocity;
        (force + spring.damping * (device.velocity - self.velocity), torque + spring.angular_damping * slip)
    }

    /// Adds `change` to the velocity and angular velocity, then moves the tool for `h` seconds: c1 = c0 + h u1 and q1 =
    /// exp(h w1) q0, with centre c, orientation q, velocity u and angular velocity w, before (0) and after (1).
    pub fn advance(&mut self, h: f64, change: [f64; 6]) {
        self.velocity += DVec3::from_slice(&change[..3]);
        self.angular_velocity += DVec3::from_slice(&change[3..]);
        self.centre += h * self.velocity;
        self.orientation = (DQuat::from_scaled_axis(h * self.angular_velocity) * self.orientation).normalize();
    }

    /// Kinetic energy, J.
    pub fn kinetic_energy(&self) -> f64 {
        let w = self.angular_velocity;
        0.5 * (self.mass * self.velocity.length_squared() + w.dot(self.world_inertia() * w))
    }
}

/// Terms of a virtual coupling in the six equations of a body at `pose` (centre, orientation) with velocity `u` and
/// angular velocity `w`, over a step of `h` seconds. The first array, for A, holds h^2 K + h D of the coupling's
/// stiffness K and damping D, linear, then angular; the second, for b, the coupling's impulse and angular impulse.
pub fn coupling_terms(
    spring: &Coupling,
    pose: (DVec3, DQuat),
    (u, w): (DVec3, DVec3),
    h: f64,
    device: &Device,
) -> ([f64; 2], [DVec3; 2]) {
    let turn = rotation_vector(device.orientation * pose.1.conjugate());
    let pull = spring.stiffness * (device.position - pose.0 - h * u) + spring.damping * (device.velocity - u);
    let wrest = spring.angular_stiffness * (turn - h * w) + spring.angular_damping * (device.angular_velocity - w);
    let along = h * h * spring.stiffness + h * spring.damping;
    let about = h * h * spring.angular_stiffness + h * spring.angular_damping;
    ([along, about], [h * pull, h * wrest])
}

/// The rotation vector (axis times angle, rad) of a unit quaternion, with the angle at most pi.
pub fn rotation_vector(q: DQuat) -> DVec3 {
    let q = if q.w < 0.0 { -q } else { q };
    let axis = DVec3::new(q.x, q.y, q.z);
    let sine = axis.length();
    // Below this sine, the half angle equals its sine to the last digit.
    if sine < 1e-9 { axis * 2.0 } else { axis * (2.0 * sine.atan2(q.w) / sine) }
}

/// Gyroscopic impulse I (w1 - w0) = -h w1 x I w1 of a step of implicit Euler, N m s, for `inertia` I, with the angular
/// velocities w0 (`w`) at the start and w1 at the end of the step. Newton's method finds w1, for a sequence of step
/// lengths that grow to `h`.
pub fn gyroscopic(inertia: DMat3, w: DVec3, h: f64) -> DVec3 {
    // The solution for each step length is the guess for the next. Newton's matrix is computed by central differences,
    // which are exact for a quadratic.
    let residual = |x: DVec3, h: f64| inertia * (x - w) + h * x.cross(inertia * x);
    let mut end = w;
    for share in 1..=8 {
        let h = h * f64::from(share) / 8.0;
        for _ in 0..20 {
            let size = 1e-3 * (1.0 + end.length());
            let column = |axis: DVec3| (residual(end + size * axis, h) - residual(end - size * axis, h)) / (2.0 * size);
            let slope = DMat3::from_cols(column(DVec3::X), column(DVec3::Y), column(DVec3::Z));
            end -= slope.inverse() * residual(end, h);
        }
    }
    inertia * (end - w)
}

/// Inertia tensor about the centre, kg m^2, of a point `mass` at `r` (m) from the centre.
pub fn point_inertia(mass: f64, r: DVec3) -> DMat3 {
    (DMat3::from_diagonal(DVec3::splat(r.length_squared())) - outer(r, r)) * mass
}
