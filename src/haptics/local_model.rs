//! The local contact model, a linear force law on the tool (the rigid body that the haptic device leads) which the
//! haptic loop evaluates between two simulation steps: F = F0 - K (y - y0) - D (v - v0). F0 is the contact wrench
//! (force, then torque; N, N m) that the newest step found, K and D are the contact's stiffness and damping, y0 and v0
//! are the tool's pose and twist at that step, y and v its present pose and twist. K leaves out the soft body's own
//! compliance (no Schur complement is formed), so K is the stiffness that the tool feels in the first moment and an
//! upper bound of the stiffness that it feels later.
//!
//! Similar models: M. Mahvash and V. Hayward, "High-fidelity haptic synthesis of contact with deformable bodies"
//! (2004); M. Otaduy and M. Lin, "A modular haptic rendering algorithm for stable and transparent 6-DOF manipulation"
//! (2006).

use glam::DVec3;
use nalgebra::{Matrix6, SymmetricEigen, Vector6};

use crate::step::trajectory::rotation_vector;
use crate::step::{ContactWrench, Gap, RigidState, Wrench};

/// Least lever arm, m. A rotation of the tool counts as a displacement of its angle (rad) times the lever arm; a
/// point-like tool has no lever arm of its own.
const SHORTEST_ARM: f64 = 1e-4;
/// An eigenvalue of K below this share of the greatest eigenvalue counts as zero: a force along its eigenvector stores
/// no energy.
const LEAST_STIFF: f64 = 1e-3;
/// Greatest number of iterations for the eigenvalues; about ten are usually needed.
const MOST_ROUNDS: usize = 200;

/// A linear force law at one state of the tool: the wrench and its slopes. Vectors and matrices hold the linear part
/// first, then the angular part. The wrench falls by K per displacement and by D per velocity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tangent {
    /// Force (N), then torque (N m).
    pub force: Vector6<f64>,
    /// Stiffness K, symmetric positive semi-definite.
    pub stiffness: Matrix6<f64>,
    /// Damping D, symmetric positive semi-definite.
    pub damping: Matrix6<f64>,
}

impl Tangent {
    /// The force law of no contact: all zero.
    pub fn zero() -> Tangent {
        Tangent { force: Vector6::zeros(), stiffness: Matrix6::zeros(), damping: Matrix6::zeros() }
    }
}

/// The local model made from one wrench: the gradient of a convex potential, plus damping.
///
/// Let f = F0 + D v0 - K (y - y0) be the wrench for zero velocity, and C the pseudo-inverse of K. The potential is
/// f . C f / 2: the energy that contact gives back until the tool leaves it. With p = sqrt(f . C f) the potential is
/// quadratic in p up to a bound set by the trusted distance and linear beyond (P. Huber, "Robust estimation of a
/// location parameter", 1964). So the force grows no further beyond the bound, and the hand gets back on its way out no
/// more than it put in on its way in.
#[derive(Debug, Clone, Copy)]
pub struct LocalModel {
    /// The tool's pose y0 and twist v0.
    tool: RigidState,
    /// The wrench F0 and its slopes K and D.
    at: Tangent,
    /// The wrench at `tool`'s pose without its damping part: F0 + D v0.
    at_rest: Vector6<f64>,
    /// Pseudo-inverse C of the stiffness.
    compliance: Matrix6<f64>,
    /// Direction in which contact pushes the tool, if contact pushes from one side only.
    normal: Option<DVec3>,
    /// Bound of p up to which the force grows, square root of J.
    most: f64,
    /// Additional stiffness along the normal, N/m, for poses deeper than the pose of `tool`; and the depth, m, up to
    /// which the force of this stiffness grows.
    inward: [f64; 2],
}

/// The model's values at one state of the tool.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Evaluation {
    /// Wrench and slopes at this state.
    pub tangent: Tangent,
    /// The potential energy, J.
    pub stored: f64,
    /// Whether the state is beyond the trusted distance, where the force is smaller than it would be by K alone.
    pub is_beyond: bool,
}

impl Evaluation {
    /// The values of no contact: all zero.
    fn zero() -> Evaluation {
        Evaluation { tangent: Tangent::zero(), stored: 0.0, is_beyond: false }
    }

    /// Blend of two evaluations: (1 - `share`) times this one plus `share` times the other.
    pub fn blend(&self, other: &Evaluation, share: f64) -> Evaluation {
        let mix = |a: Matrix6<f64>, b: Matrix6<f64>| a * (1.0 - share) + b * share;
        let tangent = Tangent {
            force: self.tangent.force * (1.0 - share) + other.tangent.force * share,
            stiffness: mix(self.tangent.stiffness, other.tangent.stiffness),
            damping: mix(self.tangent.damping, other.tangent.damping),
        };
        let stored = self.stored * (1.0 - share) + other.stored * share;
        Evaluation { tangent, stored, is_beyond: self.is_beyond || other.is_beyond }
    }
}

impl LocalModel {
    /// Makes the model of a wrench. `arm` (m) is the tool's lever arm, which turns rotations into displacements;
    /// `trust` (m) is the distance from the wrench's pose up to which the force grows in proportion to K. K and D are
    /// projected onto the symmetric positive semi-definite matrices. If the wrench has no contact but reports the gap
    /// to the nearest body (distance and direction), the model is a wall at the gap's end.
    pub fn new(wrench: &ContactWrench, arm: f64, trust: f64) -> LocalModel {
        if let (Some(gap), true) = (wrench.gap, wrench.wrench == Wrench::ZERO) {
            return LocalModel::of_gap(wrench.tool, &gap, trust);
        }
        let arm = arm.max(SHORTEST_ARM);
        let (stiffness, compliance, stiffest) = project(&wrench.stiffness, arm);
        let at = Tangent {
            force: vector(wrench.wrench.force, wrench.wrench.torque),
            stiffness,
            damping: project(&wrench.damping, arm).0,
        };
        LocalModel::with(wrench.tool, at, compliance, wrench.normal(), trust * stiffest.sqrt())
    }

    /// Makes the model of a wall at the end of a gap, for the tool in the given state.
    fn of_gap(tool: RigidState, gap: &Gap, trust: f64) -> LocalModel {
        let n = vector(gap.normal, DVec3::ZERO);
        let force = -gap.stiffness * gap.distance * n;
        let at = Tangent { force, stiffness: gap.stiffness * n * n.transpose(), damping: Matrix6::zeros() };
        let compliance = if gap.stiffness > 0.0 { n * n.transpose() / gap.stiffness } else { Matrix6::zeros() };
        LocalModel::with(tool, at, compliance, Some(gap.normal), trust * gap.stiffness.sqrt())
    }

    /// Makes a model about the pose of `tool`; the bound of p is the value of p there plus `growth`, square root of J.
    fn with(tool: RigidState, at: Tangent, compliance: Matrix6<f64>, normal: Option<DVec3>, growth: f64) -> LocalModel {
        let twist = vector(tool.velocity, tool.angular_velocity);
        let at_rest = at.force + at.damping * twist;
        let presses = normal.is_none_or(|normal| along(&normal, &at_rest) > 0.0);
        let now = if presses { at_rest.dot(&(compliance * at_rest)).max(0.0).sqrt() } else { 0.0 };
        LocalModel { tool, at, at_rest, compliance, normal, most: now + growth, inward: [0.0; 2] }
    }

    /// This model, made at least as stiff as `stiffness` (N/m) inwards along its normal, over a depth of `trust` (m):
    /// contact that has just begun is shallow, and gets stiffer further in.
    pub fn no_softer_inward(self, stiffness: f64, trust: f64) -> LocalModel {
        let own = self.normal.map_or(stiffness, |normal| slope(&normal, &self.at.stiffness));
        LocalModel { inward: [(stiffness - own).max(0.0), trust], ..self }
    }

    /// The model without K and D: the wrench stays the same whatever the tool does.
    pub fn raw(wrench: &ContactWrench) -> LocalModel {
        let at = Tangent { force: vector(wrench.wrench.force, wrench.wrench.torque), ..Tangent::zero() };
        LocalModel::with(wrench.tool, at, Matrix6::zeros(), None, f64::INFINITY)
    }

    /// Makes a model about this state of the tool, where it has the wrench and slopes of the given evaluation.
    pub fn of(tool: &RigidState, evaluation: &Evaluation, arm: f64, trust: f64) -> LocalModel {
        let at = evaluation.tangent;
        let rows: [[f64; 6]; 6] = std::array::from_fn(|i| std::array::from_fn(|k| at.stiffness[(i, k)]));
        let (stiffness, compliance, stiffest) = project(&rows, arm.max(SHORTEST_ARM));
        let normal = DVec3::new(at.force[0], at.force[1], at.force[2]).try_normalize();
        let normal = normal.filter(|normal| slope(normal, &stiffness) > 0.0);
        LocalModel::with(*tool, Tangent { stiffness, ..at }, compliance, normal, trust * stiffest.sqrt())
    }

    /// Wrench, slopes and potential at the tool's present state. Contact that the tool has left exerts no force: it
    /// never pulls.
    pub fn evaluate(&self, tool: &RigidState) -> Evaluation {
        let moved = vector(
            tool.position - self.tool.position,
            rotation_vector(tool.orientation * self.tool.orientation.conjugate()),
        );
        let twist = vector(tool.velocity, tool.angular_velocity);
        let at_rest = self.at_rest - self.at.stiffness * moved;
        let damped = self.at.damping * twist;
        if self.normal.is_some_and(|normal| self.has_let_go(&normal, &(at_rest - damped))) {
            return Evaluation::zero();
        }
        let strain = self.compliance * at_rest;
        let size = at_rest.dot(&strain).max(0.0).sqrt();
        let mut evaluation = if size <= self.most {
            let tangent = Tangent { force: at_rest - damped, ..self.at };
            Evaluation { tangent, stored: 0.5 * size * size, is_beyond: false }
        } else {
            let share = self.most / size;
            let force = at_rest - (1.0 - share) * (self.at.stiffness * strain) - damped;
            let tangent = Tangent { force, stiffness: share * self.at.stiffness, damping: self.at.damping };
            Evaluation { tangent, stored: self.most * (size - 0.5 * self.most), is_beyond: true }
        };
        if let Some(normal) = self.normal {
            self.stiffen(&normal, -along(&normal, &moved), &mut evaluation);
        }
        evaluation
    }

    /// Adds the force, stiffness and energy of the additional inward stiffness to `evaluation`. The evaluation was made
    /// at a pose `depth` (m) deeper than the pose of the field `tool`.
    fn stiffen(&self, normal: &DVec3, depth: f64, evaluation: &mut Evaluation) {
        let [stiffness, trust] = self.inward;
        if stiffness == 0.0 || depth <= 0.0 {
            return;
        }
        let (near, n) = (depth.min(trust), vector(*normal, DVec3::ZERO));
        evaluation.tangent.force += stiffness * near * n;
        evaluation.tangent.stiffness += stiffness * near / depth * n * n.transpose();
        evaluation.stored += stiffness * near * (depth - 0.5 * near);
        evaluation.is_beyond |= depth > trust;
    }

    /// Whether there is contact, or a wall at the end of a gap.
    pub fn has_contact(&self) -> bool {
        self.at.stiffness.trace() > 0.0
    }

    /// Direction in which contact pushes the tool.
    pub fn normal(&self) -> Option<DVec3> {
        self.normal.or_else(|| DVec3::new(self.at.force[0], self.at.force[1], self.at.force[2]).try_normalize())
    }

    /// Whether the tool has left a one-sided contact. `force` is the wrench by the linear law; it pulls where the tool
    /// is beyond the point at which the bodies part.
    fn has_let_go(&self, normal: &DVec3, force: &Vector6<f64>) -> bool {
        slope(normal, &self.at.stiffness) > 0.0 && along(normal, force) <= 0.0
    }

    /// The direction of the wrench's force, and the change of force (N) along this direction that K predicts for
    /// another pose of the tool; for comparison with the change that is observed.
    pub fn foretell(&self, tool: &RigidState) -> Option<(DVec3, f64)> {
        let start = DVec3::new(self.at.force[0], self.at.force[1], self.at.force[2]);
        let normal = start.try_normalize()?;
        let moved = tool.position - self.tool.position;
        let turned = rotation_vector(tool.orientation * self.tool.orientation.conjugate());
        let change = self.at.stiffness * vector(moved, turned);
        Some((normal, -along(&normal, &change)))
    }
}

/// Component of a 6-vector's linear part along a direction.
pub fn along(direction: &DVec3, v: &Vector6<f64>) -> f64 {
    direction.dot(DVec3::new(v[0], v[1], v[2]))
}

/// Stiffness along a direction, N/m.
fn slope(direction: &DVec3, stiffness: &Matrix6<f64>) -> f64 {
    along(direction, &(stiffness * vector(*direction, DVec3::ZERO)))
}

/// The 6-vector that holds a linear part, then an angular part.
pub fn vector(linear: DVec3, angular: DVec3) -> Vector6<f64> {
    Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z)
}

/// The symmetric positive semi-definite matrix nearest to `rows` in the Frobenius norm, its pseudo-inverse, and its
/// greatest eigenvalue. Norm and eigenvalue measure rotations as displacements at the lever `arm` (m).
fn project(rows: &[[f64; 6]; 6], arm: f64) -> (Matrix6<f64>, Matrix6<f64>, f64) {
    let unit = |k: usize| if k < 3 { 1.0 } else { arm };
    let scaled = Matrix6::from_fn(|i, k| 0.5 * (rows[i][k] + rows[k][i]) / (unit(i) * unit(k)));
    let none = (Matrix6::zeros(), Matrix6::zeros(), 0.0);
    if scaled.iter().all(|x| *x == 0.0) {
        return none;
    }
    // If squares of the entries overflow, no eigenvalues are found, and the matrix (K or D) is taken as zero.
    let Some(mut parts) = SymmetricEigen::try_new(scaled, f64::EPSILON, MOST_ROUNDS) else { return none };
    parts.eigenvalues.apply(|x| *x = x.max(0.0));
    let greatest = parts.eigenvalues.max();
    let symmetric = |m: &Matrix6<f64>, i: usize, k: usize| 0.5 * (m[(i, k)] + m[(k, i)]);
    let nearest = parts.recompose();
    let nearest = Matrix6::from_fn(|i, k| symmetric(&nearest, i, k) * unit(i) * unit(k));
    parts.eigenvalues.apply(|x| *x = if *x > LEAST_STIFF * greatest { 1.0 / *x } else { 0.0 });
    let inverse = parts.recompose();
    let inverse = Matrix6::from_fn(|i, k| symmetric(&inverse, i, k) / (unit(i) * unit(k)));
    (nearest, inverse, greatest)
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;

    fn at(y: f64) -> RigidState {
        RigidState::at_rest(DVec3::Y * y, DQuat::IDENTITY)
    }

    /// Contact that pushes the tool up with 2 N at y = 0 and has a stiffness of 1000 N/m. `pressing` (N) is the sum of
    /// the magnitudes of its normal forces: 2 N from one side, more from two sides.
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
        let force = |y: f64| model.evaluate(&at(y)).tangent.force[1];
        assert!((force(-5e-4) - 2.5).abs() < 1e-12 && (force(5e-4) - 1.5).abs() < 1e-12);
        // Beyond the trusted distance the force grows no further; 2 mm above y = 0 the tool leaves the contact.
        assert!((force(-0.01) - 3.0).abs() < 1e-12 && model.evaluate(&at(-0.01)).is_beyond);
        assert_eq!(model.evaluate(&at(2.1e-3)), Evaluation::zero());
        let leaving = RigidState { velocity: DVec3::Y * 0.1, ..at(0.0) };
        assert!((model.evaluate(&leaving).tangent.force[1] - 1.7).abs() < 1e-12);
        // Contact from two sides, with 6 N up and 4 N down, pushes the tool back whichever way it moves.
        let between = LocalModel::new(&pressed(10.0), 0.01, 1.0);
        assert!((between.evaluate(&at(5e-3)).tangent.force[1] + 3.0).abs() < 1e-12);
        assert_eq!(LocalModel::raw(&pressed(2.0)).evaluate(&at(-0.1)).tangent.force[1], 2.0);
    }

    #[test]
    fn a_gap_is_a_wall_where_it_ends() {
        let gap = Gap { normal: DVec3::Y, distance: 2e-3, stiffness: 500.0 };
        let model =
            LocalModel::new(&ContactWrench { step: 1, gap: Some(gap), ..ContactWrench::none(at(0.0)) }, 0.01, 1e-3);
        assert!(model.has_contact() && model.evaluate(&at(-1.9e-3)) == Evaluation::zero());
        let within = model.evaluate(&at(-2.4e-3));
        assert!((within.tangent.force[1] - 0.2).abs() < 1e-12 && (within.stored - 0.5 * 500.0 * 1.6e-7).abs() < 1e-15);
        let touched = Gap { distance: -1e-3, ..gap };
        let wrench = ContactWrench { step: 1, gap: Some(touched), ..ContactWrench::none(at(0.0)) };
        assert!((LocalModel::new(&wrench, 0.01, 1e-3).evaluate(&at(0.0)).tangent.force[1] - 0.5).abs() < 1e-12);
        let deep = model.evaluate(&at(-0.01));
        assert!((deep.tangent.force[1] - 0.5).abs() < 1e-12 && deep.is_beyond);
    }

    /// On six axes, with one-sided and two-sided contact, within the trusted distance and beyond: the work along a
    /// closed path is zero, and the work along any path equals the decrease of the potential.
    #[test]
    fn force_is_the_gradient_of_the_potential() {
        let mut wrench = pressed(2.0);
        wrench.wrench.torque = DVec3::new(0.004, 0.0, -0.002);
        for (k, x) in [(0, 300.0), (2, 200.0), (3, 0.05), (4, 0.02), (5, 0.04)] {
            wrench.stiffness[k][k] = x;
        }
        (wrench.stiffness[0][5], wrench.stiffness[5][0]) = (1.5, 1.5);
        wrench.damping = [[0.0; 6]; 6];
        let mut beyond = 0;
        for (pressing, trust) in [(2.0, 1e-4), (2.0, 1e-2), (10.0, 1e-4), (10.0, 1e-2)] {
            let model =
                LocalModel::new(&ContactWrench { pressing, ..wrench }, 0.01, trust).no_softer_inward(2000.0, trust);
            // All rotations are about one axis, so that they add up as vectors do.
            let state = |t: f64| {
                let (sine, cosine) = t.sin_cos();
                RigidState {
                    position: 1e-3 * DVec3::new(sine, 0.6 * cosine - 0.8, (2.0 * t).sin()),
                    orientation: DQuat::from_rotation_z(0.1 * (sine + cosine)),
                    ..at(0.0)
                }
            };
            let (count, mut work) = (40_000, 0.0);
            let time = |k: usize| k as f64 * std::f64::consts::TAU / count as f64;
            let start = model.evaluate(&state(0.0)).stored;
            for k in 0..count {
                let (a, b) = (state(time(k)), state(time(k + 1)));
                let middle = model.evaluate(&state(0.5 * (time(k) + time(k + 1))));
                beyond += usize::from(middle.is_beyond);
                let turned = rotation_vector(b.orientation * a.orientation.conjugate());
                work += middle.tangent.force.dot(&vector(b.position - a.position, turned));
                let fallen = start - model.evaluate(&b).stored;
                assert!(
                    (work - fallen).abs() < 1e-9,
                    "pressing {pressing} N, trust {trust} m, step {k}: work {work} J, potential fell by {fallen} J"
                );
            }
            assert!(work.abs() < 1e-9, "work {work} J around a closed path, expected 0");
        }
        assert!(beyond > 10_000, "only {beyond} steps lie beyond the trusted distance, expected more than 10,000");
    }

    #[test]
    fn a_model_of_what_is_felt_goes_on_from_there() {
        let model = LocalModel::new(&pressed(2.0), 0.01, 1e-3);
        let here = RigidState { velocity: DVec3::Y * -0.01, ..at(-4e-4) };
        let felt = model.evaluate(&here);
        let next = LocalModel::of(&here, &felt, 0.01, 1e-3);
        for y in [-8e-4, -4e-4, 0.0, 5e-4] {
            let there = RigidState { velocity: DVec3::Y * 0.02, ..at(y) };
            let (a, b) = (model.evaluate(&there), next.evaluate(&there));
            assert!(
                (a.tangent.force - b.tangent.force).norm() < 1e-9 && (a.stored - b.stored).abs() < 1e-12,
                "the two models differ at y = {y} m"
            );
        }
    }

    #[test]
    fn what_is_not_positive_semi_definite_is_taken_away() {
        let mut wrench = pressed(2.0);
        wrench.stiffness[0][0] = -50.0;
        (wrench.stiffness[3][3], wrench.stiffness[3][1], wrench.stiffness[1][3]) = (0.1, 30.0, 30.0);
        let before = Matrix6::from_fn(|i, k| wrench.stiffness[i][k]);
        assert!(before.symmetric_eigenvalues().min() < -1.0);
        for arm in [0.01, 0.0] {
            let tangent = LocalModel::new(&wrench, arm, 1.0).evaluate(&at(0.0)).tangent;
            let least = tangent.stiffness.symmetric_eigenvalues().min();
            assert!(
                least > -1e-9 && tangent.stiffness == tangent.stiffness.transpose(),
                "lever arm {arm} m: the stiffness has the least eigenvalue {least}, or is not symmetric"
            );
            assert!(
                tangent.stiffness[(0, 0)].abs() < 1e-9 && tangent.stiffness[(1, 1)] > 100.0,
                "lever arm {arm} m: wrong stiffness along x or y"
            );
        }
        // A matrix that is positive semi-definite stays as it is.
        let tangent = LocalModel::new(&pressed(2.0), 0.01, 1.0).evaluate(&at(0.0)).tangent;
        assert!((tangent.stiffness[(1, 1)] - 1000.0).abs() < 1e-9);
        wrench.stiffness = [[1e200; 6]; 6];
        let tangent = LocalModel::new(&wrench, 0.01, 1.0).evaluate(&at(0.0)).tangent;
        assert!(tangent.stiffness.iter().all(|x| x.is_finite()));
    }

    #[test]
    fn the_change_that_k_foretells() {
        let model = LocalModel::new(&pressed(2.0), 0.01, 1.0);
        let (normal, change) = model.foretell(&at(-1e-3)).unwrap();
        assert!(normal == DVec3::Y && (change - 1.0).abs() < 1e-12);
        assert!(LocalModel::new(&ContactWrench::none(at(0.0)), 0.01, 1.0).foretell(&at(1.0)).is_none());
    }
}
