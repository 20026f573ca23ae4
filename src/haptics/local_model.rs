//! Contact between two wrenches: F = F0 - K (y - y0) - D (v - v0) about the tool's pose y0 and twist v0 of the newest one.
//! K holds the body still, so it is what the tool feels in the first moment and more than it feels later.
//!
//! K. Mahvash and V. Hayward, "High-fidelity haptic synthesis of contact with deformable bodies" (2004), and M. Otaduy and
//! M. Lin, "A modular haptic rendering algorithm for stable and transparent 6-DOF manipulation" (2006), do the like.

use glam::DVec3;
use nalgebra::{Matrix6, SymmetricEigen, Vector6};
use serde::{Deserialize, Serialize};

use super::device::{RigidState, Wrench};
use super::drive::rotation_vector;

/// Of the sizes of the contacts' forces summed, the size of their sum from which on they count as pressing from one side:
/// half a sphere, pressed evenly, has 0.5; two sides have 0.
const ONE_SIDED: f64 = 0.3;

/// An arm is taken for no shorter, m: a tool of one point has none.
const SHORTEST_ARM: f64 = 1e-4;
/// Rounds of the eigenvalue iteration at most; it takes about ten.
const MOST_ROUNDS: usize = 200;

/// What a step of the simulation gives back to the loop.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ContactWrench {
    /// Steps done, this one included; 0: there was none yet.
    pub step: u64,
    /// When the step's inputs were taken, s on the loop's clock.
    pub time: f64,
    /// The tool at the end of the step.
    pub tool: RigidState,
    /// Of all contacts on the tool, about its centre, world axes.
    pub wrench: Wrench,
    /// N/m, N/rad, N m/m, N m/rad: rows and columns linear, then angular; symmetric.
    pub stiffness: [[f64; 6]; 6],
    /// The same, times s.
    pub damping: [[f64; 6]; 6],
    /// Sizes of the contacts' forces along their normals, summed, N: as large as the force where all press the same way.
    pub pressing: f64,
}

impl ContactWrench {
    /// Before the first step: no contact.
    pub fn none(tool: RigidState) -> ContactWrench {
        let zero = [[0.0; 6]; 6];
        ContactWrench { step: 0, time: 0.0, tool, wrench: Wrench::ZERO, stiffness: zero, damping: zero, pressing: 0.0 }
    }

    /// Whether all of it is finite.
    pub fn is_finite(&self) -> bool {
        let numbers = self.stiffness.iter().chain(&self.damping).flatten();
        self.tool.is_valid()
            && self.wrench.is_finite()
            && self.pressing.is_finite()
            && numbers.into_iter().all(|x| x.is_finite())
    }
}

/// Force (linear, then angular) at a state, and its slopes: F falls by K per displacement and by D per velocity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tangent {
    /// N, N m.
    pub force: Vector6<f64>,
    /// Symmetric positive semi-definite.
    pub stiffness: Matrix6<f64>,
    /// Symmetric positive semi-definite.
    pub damping: Matrix6<f64>,
}

impl Tangent {
    /// No contact.
    pub fn zero() -> Tangent {
        Tangent { force: Vector6::zeros(), stiffness: Matrix6::zeros(), damping: Matrix6::zeros() }
    }

    /// (1 - share) of this and `share` of another.
    pub fn blend(&self, other: &Tangent, share: f64) -> Tangent {
        let mix = |a: Matrix6<f64>, b: Matrix6<f64>| a * (1.0 - share) + b * share;
        Tangent {
            force: self.force * (1.0 - share) + other.force * share,
            stiffness: mix(self.stiffness, other.stiffness),
            damping: mix(self.damping, other.damping),
        }
    }
}

/// The model of one wrench.
#[derive(Debug, Clone, Copy)]
pub struct LocalModel {
    tool: RigidState,
    at: Tangent,
    pressing: f64,
    /// Rotations count as displacements at this arm, m.
    arm: f64,
    /// How far from the wrench's pose it is trusted, m.
    trust: f64,
}

impl LocalModel {
    /// The model of a wrench; `arm`: m, the radius of the tool; `trust`: m. K and D lose what is not symmetric positive
    /// semi-definite about them.
    pub fn new(wrench: &ContactWrench, arm: f64, trust: f64) -> LocalModel {
        let arm = arm.max(SHORTEST_ARM);
        let at = Tangent {
            force: vector(wrench.wrench.force, wrench.wrench.torque),
            stiffness: project(&wrench.stiffness, arm),
            damping: project(&wrench.damping, arm),
        };
        LocalModel { tool: wrench.tool, at, pressing: wrench.pressing, arm, trust }
    }

    /// The same without K and D: the raw force, whatever the tool does.
    pub fn raw(wrench: &ContactWrench) -> LocalModel {
        let at = Tangent { force: vector(wrench.wrench.force, wrench.wrench.torque), ..Tangent::zero() };
        LocalModel { tool: wrench.tool, at, pressing: 0.0, arm: 1.0, trust: f64::INFINITY }
    }

    /// Force, torque and slopes where the tool is now, and whether it is beyond trust. Contact that lets go pulls nothing.
    pub fn evaluate(&self, tool: &RigidState) -> (Tangent, bool) {
        let moved = tool.position - self.tool.position;
        let turned = rotation_vector(tool.orientation * self.tool.orientation.conjugate());
        let length = moved.length().hypot(self.arm * turned.length());
        let faster = vector(tool.velocity - self.tool.velocity, tool.angular_velocity - self.tool.angular_velocity);
        let (moved, damped) = (vector(moved, turned), self.at.damping * faster);
        // Trust limits how far the force grows, not that it ends.
        if self.has_let_go(&(self.at.force - self.at.stiffness * moved - damped)) {
            return (Tangent::zero(), false);
        }
        let is_beyond = length > self.trust && self.has_contact();
        let stiffness = if is_beyond { self.at.stiffness * (self.trust / length) } else { self.at.stiffness };
        let force = self.at.force - stiffness * moved - damped;
        (Tangent { force, stiffness, damping: self.at.damping }, is_beyond)
    }

    /// Whether the wrench had contact.
    pub fn has_contact(&self) -> bool {
        self.at.stiffness.trace() > 0.0
    }

    /// Contacts that press from one side pull where the model is followed past the point at which they part.
    fn has_let_go(&self, force: &Vector6<f64>) -> bool {
        let start = self.at.force.fixed_rows::<3>(0);
        let size = start.norm();
        if size == 0.0 {
            return false;
        }
        let normal = start / size;
        let slope = (normal.transpose() * self.at.stiffness.fixed_view::<3, 3>(0, 0) * normal).x;
        size >= ONE_SIDED * self.pressing && slope > 0.0 && normal.dot(&force.fixed_rows::<3>(0)) <= 0.0
    }

    /// The force along the wrench's own direction that K foretells at another pose, and that direction; for comparison
    /// with what came.
    pub fn foretell(&self, tool: &RigidState) -> Option<(DVec3, f64)> {
        let start = DVec3::new(self.at.force[0], self.at.force[1], self.at.force[2]);
        let normal = start.try_normalize()?;
        let moved = tool.position - self.tool.position;
        let turned = rotation_vector(tool.orientation * self.tool.orientation.conjugate());
        let change = self.at.stiffness * vector(moved, turned);
        Some((normal, -normal.dot(DVec3::new(change[0], change[1], change[2]))))
    }
}

/// Linear and angular as one.
pub fn vector(linear: DVec3, angular: DVec3) -> Vector6<f64> {
    Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z)
}

/// The nearest symmetric positive semi-definite matrix (in the Frobenius norm, rotations measured at `arm`).
fn project(rows: &[[f64; 6]; 6], arm: f64) -> Matrix6<f64> {
    let unit = |k: usize| if k < 3 { 1.0 } else { arm };
    let scaled = Matrix6::from_fn(|i, k| 0.5 * (rows[i][k] + rows[k][i]) / (unit(i) * unit(k)));
    if scaled.iter().all(|x| *x == 0.0) {
        return Matrix6::zeros();
    }
    // Numbers so large that their squares overflow have no such parts, and are followed as a raw force is.
    let Some(mut parts) = SymmetricEigen::try_new(scaled, f64::EPSILON, MOST_ROUNDS) else { return Matrix6::zeros() };
    parts.eigenvalues.apply(|x| *x = x.max(0.0));
    let nearest = parts.recompose();
    Matrix6::from_fn(|i, k| 0.5 * (nearest[(i, k)] + nearest[(k, i)]) * unit(i) * unit(k))
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;

    fn at(y: f64) -> RigidState {
        RigidState::at_rest(DVec3::Y * y, DQuat::IDENTITY)
    }

    /// 2 N upwards at y = 0 from 1000 N/m below.
    fn pressed(pressing: f64) -> ContactWrench {
        let mut wrench = ContactWrench { step: 1, pressing, ..ContactWrench::none(at(0.0)) };
        wrench.wrench.force = DVec3::Y * 2.0;
        wrench.stiffness[1][1] = 1000.0;
        wrench.damping[1][1] = 3.0;
        wrench
    }

    #[test]
    fn force_follows_the_tool_and_lets_go_without_pulling() {
        let model = LocalModel::new(&pressed(2.0), 0.01, 1e-3);
        let force = |y: f64| model.evaluate(&at(y)).0.force[1];
        assert!((force(-5e-4) - 2.5).abs() < 1e-12 && (force(5e-4) - 1.5).abs() < 1e-12);
        // Beyond trust no stiffer, and let go of at 2 mm.
        assert!((force(-0.01) - 3.0).abs() < 1e-12 && model.evaluate(&at(-0.01)).1);
        assert_eq!(model.evaluate(&at(2.1e-3)), (Tangent::zero(), false));
        let leaving = RigidState { velocity: DVec3::Y * 0.1, ..at(0.0) };
        assert!((model.evaluate(&leaving).0.force[1] - 1.7).abs() < 1e-12);
        // From two sides, 6 N and 4 N, it pushes back either way.
        let between = LocalModel::new(&pressed(10.0), 0.01, 1.0);
        assert!((between.evaluate(&at(5e-3)).0.force[1] + 3.0).abs() < 1e-12);
        assert_eq!(LocalModel::raw(&pressed(2.0)).evaluate(&at(-0.1)).0.force[1], 2.0);
    }

    #[test]
    fn what_is_not_positive_semi_definite_is_taken_away() {
        let mut wrench = pressed(2.0);
        wrench.stiffness[0][0] = -50.0;
        (wrench.stiffness[3][3], wrench.stiffness[3][1], wrench.stiffness[1][3]) = (0.1, 30.0, 30.0);
        let before = Matrix6::from_fn(|i, k| wrench.stiffness[i][k]);
        assert!(before.symmetric_eigenvalues().min() < -1.0);
        for arm in [0.01, 0.0] {
            let (tangent, _) = LocalModel::new(&wrench, arm, 1.0).evaluate(&at(0.0));
            let least = tangent.stiffness.symmetric_eigenvalues().min();
            assert!(least > -1e-9 && tangent.stiffness == tangent.stiffness.transpose(), "{arm}: {least}");
            assert!(tangent.stiffness[(0, 0)].abs() < 1e-9 && tangent.stiffness[(1, 1)] > 100.0, "{arm}");
        }
        // One that is positive semi-definite stays as it is.
        let (tangent, _) = LocalModel::new(&pressed(2.0), 0.01, 1.0).evaluate(&at(0.0));
        assert!((tangent.stiffness[(1, 1)] - 1000.0).abs() < 1e-9);
        wrench.stiffness = [[1e200; 6]; 6];
        assert!(LocalModel::new(&wrench, 0.01, 1.0).evaluate(&at(0.0)).0.stiffness.iter().all(|x| x.is_finite()));
    }

    #[test]
    fn the_change_that_k_foretells() {
        let model = LocalModel::new(&pressed(2.0), 0.01, 1.0);
        let (normal, change) = model.foretell(&at(-1e-3)).unwrap();
        assert!(normal == DVec3::Y && (change - 1.0).abs() < 1e-12);
        assert!(LocalModel::new(&ContactWrench::none(at(0.0)), 0.01, 1.0).foretell(&at(1.0)).is_none());
    }
}
