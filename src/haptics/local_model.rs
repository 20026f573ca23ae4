//! The local contact model, a linear force law on the tool (the rigid body that the haptic device leads) which the
//! haptic loop evaluates between two simulation steps: F = F0 - K (y - y0) - D (v - v0) - D_b (v - v_b). F0 is the
//! contact wrench (force, then torque; N, N m) that the newest step found, K and D are the stiffness and damping of the
//! contact in series with the body that yields (`compliance.rs`), y0 and v0 are the tool's pose and twist at that step,
//! y and v its present pose and twist. D_b is the body's own damping, and v_b the tool's mean twist in the step, which
//! the body followed.
//!
//! Similar models: M. Mahvash and V. Hayward, "High-fidelity haptic synthesis of contact with deformable bodies"
//! (2004); M. Otaduy and M. Lin, "A modular haptic rendering algorithm for stable and transparent 6-DOF manipulation"
//! (2006).

use glam::DVec3;
use nalgebra::{Const, Matrix6, SymmetricEigen, Vector3, Vector6};

use super::compliance::Compliance;
use super::walls::Walls;
use crate::step::trajectory::rotation_vector;
use crate::step::{ContactWrench, RigidState, Wrench};

/// Least lever arm, m. A rotation of the tool counts as a displacement of its angle (rad) times the lever arm; a
/// point-like tool has no lever arm of its own.
const SHORTEST_ARM: f64 = 1e-4;
/// An eigenvalue of K below this share of the greatest eigenvalue counts as zero: a force along its eigenvector stores
/// no energy.
const LEAST_STIFF: f64 = 1e-3;
/// Greatest number of iterations for the eigenvalues; about ten are usually needed.
const MOST_ROUNDS: usize = 200;
/// The body's damping takes at most this share of a wrench: it is reduced where the wrench leaves no room for it.
const MOST_DAMPED: f64 = 0.5;

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
/// Let f = F0 + D v0 + D_b v_b - K (y - y0) be the wrench for zero velocity, and C the pseudo-inverse of K. The
/// potential is f . C f / 2: the energy that contact gives back until the tool leaves it. With p = sqrt(f . C f) the
/// potential is quadratic in p up to a bound set by the trusted distance and linear beyond (P. Huber, "Robust
/// estimation of a location parameter", 1964). So the force grows no further beyond the bound, and the hand gets back
/// on its way out no more than it put in on its way in.
#[derive(Debug, Clone, Copy)]
pub struct LocalModel {
    /// The tool's pose y0 and twist v0.
    tool: RigidState,
    /// The wrench F0 and the slopes K and D that are felt.
    at: Tangent,
    /// The wrench at `tool`'s pose for zero velocity: F0 + D v0 + D_b v_b.
    at_rest: Vector6<f64>,
    /// The body's own damping D_b.
    body_damping: Matrix6<f64>,
    /// The twist v_b that the body followed.
    followed: Vector6<f64>,
    /// Pseudo-inverse C of the stiffness.
    compliance: Matrix6<f64>,
    /// Direction in which contact pushes the tool, if contact pushes from one side only.
    normal: Option<DVec3>,
    /// Bound of p up to which the force grows, square root of J.
    most: f64,
    friction: Option<Friction>,
    walls: Walls,
}

/// Friction between two wrenches: the tangential part of the damping wrench D v, up to the greatest friction. What the
/// step found beyond D v0, because the tool stuck to the skin, remains.
#[derive(Debug, Clone, Copy)]
struct Friction {
    /// Unit normal of the contact.
    normal: DVec3,
    /// Greatest friction, N; where contact pushes from one side, over the normal force.
    most: f64,
    is_one_sided: bool,
    /// The part of the step's friction that D v0 does not account for, N: it opposes the tool.
    stuck: DVec3,
}

impl Friction {
    /// Friction of a wrench with the given damping, and the damping that it leaves: if D v0 exceeds the friction that
    /// the step found, the skin moves with the tool, and D is reduced by as much. `None` without friction.
    fn of(wrench: &ContactWrench, damping: Matrix6<f64>) -> (Option<Friction>, Matrix6<f64>) {
        let Some(normal) = wrench.contact_normal().filter(|_| wrench.most_friction > 0.0) else {
            return (None, damping);
        };
        let across = |force: DVec3| force - normal.dot(force) * normal;
        let twist = vector(wrench.tool.velocity, wrench.tool.angular_velocity);
        let [found, told] = [across(-wrench.friction), across(linear(&(damping * twist)))];
        let share = if told.length() > found.length() { found.length() / told.length() } else { 1.0 };
        let stuck = found * (1.0 - told.length() / found.length().max(f64::MIN_POSITIVE)).max(0.0);
        let pressing = normal.dot(wrench.wrench.force);
        let is_one_sided = wrench.normal().is_some() && pressing > 0.0;
        let most = if is_one_sided { wrench.most_friction / pressing } else { wrench.most_friction };
        (Some(Friction { normal, most, is_one_sided, stuck }), reduced(&damping, &normal, share))
    }

    /// The wrench by which a contact of the given damping opposes a twist, beyond what is stuck, and that wrench's
    /// damping. `pressing`: the contact's wrench without damping.
    fn drag(&self, damping: &Matrix6<f64>, twist: &Vector6<f64>, pressing: &Vector6<f64>) -> Tangent {
        let force = damping * twist;
        let tangential = linear(&force) - self.normal.dot(linear(&force)) * self.normal;
        let most = self.most * if self.is_one_sided { along(&self.normal, pressing).max(0.0) } else { 1.0 };
        let whole = self.stuck + tangential;
        if whole.length() <= most {
            return Tangent { force, damping: *damping, ..Tangent::zero() };
        }
        let damping = reduced(damping, &self.normal, (most / tangential.length()).min(1.0));
        let mut force = damping * twist;
        let slides = self.normal.dot(linear(&force)) * self.normal + most / whole.length() * whole - self.stuck;
        force.fixed_rows_mut::<3>(0).copy_from(&Vector3::from(slides.to_array()));
        Tangent { force, damping, ..Tangent::zero() }
    }
}

/// Damping with its part across a normal, and its angular part, multiplied by a `share` from 0 to 1.
fn reduced(damping: &Matrix6<f64>, normal: &DVec3, share: f64) -> Matrix6<f64> {
    if share == 1.0 {
        return *damping;
    }
    let (root, n) = (share.sqrt(), vector(*normal, DVec3::ZERO));
    let scale = root * Matrix6::identity() + (1.0 - root) * (n * n.transpose());
    scale * damping * scale
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
    /// The part of the damping that is the body's own.
    pub body_damping: Matrix6<f64>,
}

impl Evaluation {
    /// The values of no contact: all zero.
    pub fn zero() -> Evaluation {
        Evaluation { tangent: Tangent::zero(), stored: 0.0, is_beyond: false, body_damping: Matrix6::zeros() }
    }

    /// The sum of two evaluations, of different contacts at the same time.
    pub fn and(self, other: &Evaluation) -> Evaluation {
        let tangent = Tangent {
            force: self.tangent.force + other.tangent.force,
            stiffness: self.tangent.stiffness + other.tangent.stiffness,
            damping: self.tangent.damping + other.tangent.damping,
        };
        Evaluation {
            tangent,
            stored: self.stored + other.stored,
            is_beyond: self.is_beyond || other.is_beyond,
            body_damping: self.body_damping + other.body_damping,
        }
    }

    /// Blend of two evaluations: (1 - `share`) times this one plus `share` times the other.
    pub fn blend(&self, other: &Evaluation, share: f64) -> Evaluation {
        let mix = |a: Matrix6<f64>, b: Matrix6<f64>| a * (1.0 - share) + b * share;
        let tangent = Tangent {
            force: self.tangent.force * (1.0 - share) + other.tangent.force * share,
            stiffness: mix(self.tangent.stiffness, other.tangent.stiffness),
            damping: mix(self.tangent.damping, other.tangent.damping),
        };
        Evaluation {
            tangent,
            stored: self.stored * (1.0 - share) + other.stored * share,
            is_beyond: self.is_beyond || other.is_beyond,
            body_damping: mix(self.body_damping, other.body_damping),
        }
    }
}

impl LocalModel {
    /// Makes the model of a wrench. `arm` (m) is the tool's lever arm, which turns rotations into displacements;
    /// `trust` (m) is the distance from the wrench's pose up to which the force grows in proportion to K. K and D are
    /// projected onto the symmetric positive semi-definite matrices. If the wrench has no contact but reports gaps
    /// (distances and directions), the model has a wall at the end of each. In series with contact or
    /// wall is the compliance of the body.
    pub fn new(wrench: &ContactWrench, body: &Compliance, arm: f64, trust: f64) -> LocalModel {
        if wrench.gap.is_some() && wrench.wrench == Wrench::ZERO {
            return LocalModel { walls: Walls::of(wrench, body, trust), ..LocalModel::raw(wrench) };
        }
        let arm = arm.max(SHORTEST_ARM);
        let contact = Spectrum::of(&wrench.stiffness, arm);
        let (felt, share) = (contact.in_series(body.value()), contact.share(body.value()));
        let damping = share * Spectrum::of(&wrench.damping, arm).matrix() * share.transpose();
        let (friction, damping) = Friction::of(wrench, damping);
        let force = vector(wrench.wrench.force, wrench.wrench.torque);
        let at = Tangent { force, stiffness: felt.matrix(), damping };
        let normal = wrench.normal().and(wrench.contact_normal());
        let damped = |twist| bounded((felt.with_values(|k| body.damping(k), [1, 1]), twist), wrench);
        let of_body = body.twist().map_or_else(undamped, damped);
        LocalModel::with(wrench.tool, at, of_body, felt.inverse(), normal, trust * felt.greatest().sqrt(), friction)
    }

    /// Makes a model about the pose of `tool`, with the body's own damping and the twist that the body followed; the
    /// bound of p is the value of p there plus `growth`, square root of J.
    fn with(
        tool: RigidState,
        at: Tangent,
        (body_damping, followed): (Matrix6<f64>, Vector6<f64>),
        compliance: Matrix6<f64>,
        normal: Option<DVec3>,
        growth: f64,
        friction: Option<Friction>,
    ) -> LocalModel {
        let at_rest = at.force + at.damping * vector(tool.velocity, tool.angular_velocity) + body_damping * followed;
        let presses = normal.is_none_or(|normal| along(&normal, &at_rest) > 0.0);
        let now = if presses { at_rest.dot(&(compliance * at_rest)).max(0.0).sqrt() } else { 0.0 };
        let (most, walls) = (now + growth, Walls::none());
        LocalModel { tool, at, at_rest, body_damping, followed, compliance, normal, most, friction, walls }
    }

    /// The model without K and D: the wrench stays the same whatever the tool does.
    pub fn raw(wrench: &ContactWrench) -> LocalModel {
        let at = Tangent { force: vector(wrench.wrench.force, wrench.wrench.torque), ..Tangent::zero() };
        LocalModel::with(wrench.tool, at, undamped(), Matrix6::zeros(), None, f64::INFINITY, None)
    }

    /// Makes a model about this state of the tool, where it has the wrench and slopes of the given evaluation, and the
    /// bound on friction of `like`.
    pub fn of(tool: &RigidState, evaluation: &Evaluation, like: &LocalModel, arm: f64, trust: f64) -> LocalModel {
        let at = evaluation.tangent;
        let rows: [[f64; 6]; 6] = std::array::from_fn(|i| std::array::from_fn(|k| at.stiffness[(i, k)]));
        let spectrum = Spectrum::of(&rows, arm.max(SHORTEST_ARM));
        let stiffness = spectrum.matrix();
        let normal = linear(&at.force).try_normalize();
        let normal = normal.filter(|normal| slope(normal, &stiffness) > 0.0);
        let growth = trust * spectrum.greatest().sqrt();
        // Damping and force of the evaluation contain what friction did there.
        let friction = like.friction.map(|friction| Friction { stuck: DVec3::ZERO, ..friction });
        let at = Tangent { stiffness, damping: at.damping - evaluation.body_damping, ..at };
        let of_body = (evaluation.body_damping, vector(tool.velocity, tool.angular_velocity));
        LocalModel::with(*tool, at, of_body, spectrum.inverse(), normal, growth, friction)
    }

    /// Wrench, slopes and potential at the tool's present state. Contact that the tool has left exerts no force: it
    /// never pulls.
    pub fn evaluate(&self, tool: &RigidState) -> Evaluation {
        let moved = vector(
            tool.position - self.tool.position,
            rotation_vector(tool.orientation * self.tool.orientation.conjugate()),
        );
        let contact = self.evaluate_contact(&moved, &vector(tool.velocity, tool.angular_velocity));
        contact.and(&self.walls.evaluate(&moved, &tool.velocity))
    }

    /// The values of the contact that the wrench had, for a tool that moved by a displacement from the model's pose.
    fn evaluate_contact(&self, moved: &Vector6<f64>, twist: &Vector6<f64>) -> Evaluation {
        let at_rest = self.at_rest - self.at.stiffness * moved;
        let strain = self.compliance * at_rest;
        let size = at_rest.dot(&strain).max(0.0).sqrt();
        let is_beyond = size > self.most;
        let share = if is_beyond { self.most / size } else { 1.0 };
        let pushes = if is_beyond { at_rest - (1.0 - share) * (self.at.stiffness * strain) } else { at_rest };
        let free = || Tangent { force: self.at.damping * twist, ..self.at };
        let drag = self.friction.map_or_else(free, |friction| friction.drag(&self.at.damping, twist, &pushes));
        let body_damping = share * share * self.body_damping;
        let force = pushes - drag.force - body_damping * twist;
        let stored = if is_beyond { self.most * (size - 0.5 * self.most) } else { 0.5 * size * size };
        if self.normal.is_some_and(|normal| self.has_let_go(&normal, &force)) {
            // Where only damping keeps the skin from following the tool, the body keeps its energy.
            let presses = self.normal.is_some_and(|normal| along(&normal, &at_rest) > 0.0);
            return Evaluation { stored: if presses { stored } else { 0.0 }, ..Evaluation::zero() };
        }
        let stiffness = if is_beyond { share * self.at.stiffness } else { self.at.stiffness };
        let tangent = Tangent { force, stiffness, damping: drag.damping + body_damping };
        Evaluation { tangent, stored, is_beyond, body_damping }
    }

    /// Whether there is contact, or a wall at the end of a gap.
    pub fn has_contact(&self) -> bool {
        self.at.stiffness.trace() > 0.0 || self.walls.push()
    }

    /// Direction in which contact pushes a tool in this state; where nothing pushes it, in which the nearest wall would.
    pub fn normal(&self, tool: &RigidState) -> Option<DVec3> {
        let contact = self.normal.or_else(|| linear(&self.at.force).try_normalize());
        let pushes = || linear(&self.evaluate(tool).tangent.force).try_normalize();
        contact.or_else(pushes).or_else(|| self.walls.normal())
    }

    /// Whether the tool has left a one-sided contact. `force` is the wrench by the linear law; it pulls where the tool
    /// is beyond the point at which the bodies part.
    fn has_let_go(&self, normal: &DVec3, force: &Vector6<f64>) -> bool {
        slope(normal, &self.at.stiffness) > 0.0 && along(normal, force) <= 0.0
    }

    /// The direction of the wrench's force, and the change of force (N) along this direction that stiffness and the
    /// body's damping predict for another pose of the tool, to which the body followed it with the given twist, where
    /// that is known; for comparison with the change that is observed.
    pub fn foretell(&self, tool: &RigidState, twist: Option<Vector6<f64>>) -> Option<(DVec3, f64)> {
        let normal = linear(&self.at.force).try_normalize()?;
        let moved = tool.position - self.tool.position;
        let turned = rotation_vector(tool.orientation * self.tool.orientation.conjugate());
        let change = self.at.stiffness * vector(moved, turned)
            + twist.map_or_else(Vector6::zeros, |twist| self.body_damping * (twist - self.followed));
        Some((normal, -along(&normal, &change)))
    }
}

/// A body's damping and the twist that it followed, where the damping is reduced so that along the normal it takes at
/// most [`MOST_DAMPED`] of a wrench.
fn bounded((damping, followed): (Matrix6<f64>, Vector6<f64>), wrench: &ContactWrench) -> (Matrix6<f64>, Vector6<f64>) {
    let Some(normal) = wrench.contact_normal() else { return undamped() };
    let taken = along(&normal, &(damping * followed)).abs();
    let most = MOST_DAMPED * normal.dot(wrench.wrench.force).abs();
    (if taken > most { most / taken * damping } else { damping }, followed)
}

/// The damping of a body without damping, and the twist that it followed.
fn undamped() -> (Matrix6<f64>, Vector6<f64>) {
    (Matrix6::zeros(), Vector6::zeros())
}

/// Linear part of a 6-vector.
pub fn linear(v: &Vector6<f64>) -> DVec3 {
    DVec3::new(v[0], v[1], v[2])
}

/// Component of a 6-vector's linear part along a direction.
pub fn along(direction: &DVec3, v: &Vector6<f64>) -> f64 {
    direction.dot(linear(v))
}

/// Stiffness (N/m) of a spring in series with a compliance (m/N).
pub fn in_series(stiffness: f64, compliance: f64) -> f64 {
    stiffness / (1.0 + compliance * stiffness)
}

/// Stiffness along a direction, N/m.
pub fn slope(direction: &DVec3, stiffness: &Matrix6<f64>) -> f64 {
    along(direction, &(stiffness * vector(*direction, DVec3::ZERO)))
}

/// The 6-vector that holds a linear part, then an angular part.
pub fn vector(linear: DVec3, angular: DVec3) -> Vector6<f64> {
    Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z)
}

/// The symmetric positive semi-definite matrix that is nearest to a given one (K or D) in the Frobenius norm, by its
/// eigenvalues and eigenvectors. Norm and eigenvalues measure rotations as displacements at the lever `arm` (m).
struct Spectrum {
    parts: SymmetricEigen<f64, Const<6>>,
    arm: f64,
}

impl Spectrum {
    fn of(rows: &[[f64; 6]; 6], arm: f64) -> Spectrum {
        let unit = |k: usize| if k < 3 { 1.0 } else { arm };
        let scaled = Matrix6::from_fn(|i, k| 0.5 * (rows[i][k] + rows[k][i]) / (unit(i) * unit(k)));
        // If squares of the entries overflow, no eigenvalues are found, and the matrix is taken as zero.
        let parts = SymmetricEigen::try_new(scaled, f64::EPSILON, MOST_ROUNDS);
        let none = || SymmetricEigen { eigenvectors: Matrix6::identity(), eigenvalues: Vector6::zeros() };
        let mut parts = parts.unwrap_or_else(none);
        parts.eigenvalues.apply(|x| *x = x.max(0.0));
        Spectrum { parts, arm }
    }

    fn greatest(&self) -> f64 {
        self.parts.eigenvalues.max()
    }

    /// This stiffness in series with a `compliance` (m/N) equal in all directions.
    fn in_series(&self, compliance: f64) -> Spectrum {
        let mut parts = self.parts;
        parts.eigenvalues.apply(|x| *x = in_series(*x, compliance));
        Spectrum { parts, arm: self.arm }
    }

    fn matrix(&self) -> Matrix6<f64> {
        self.with_values(|x| x, [1, 1])
    }

    /// The pseudo-inverse.
    fn inverse(&self) -> Matrix6<f64> {
        let least = LEAST_STIFF * self.greatest();
        self.with_values(|x| if x > least { 1.0 / x } else { 0.0 }, [-1, -1])
    }

    /// The matrix that turns a wrench of a contact with this stiffness into the wrench that is left if the contact is
    /// in series with a `compliance` (m/N) equal in all directions.
    fn share(&self, compliance: f64) -> Matrix6<f64> {
        self.with_values(|x| 1.0 / (1.0 + compliance * x), [1, -1])
    }

    /// The matrix with the same eigenvectors, whose eigenvalues are a function of those of this one. Its rows and
    /// columns get the given powers of the lever arm.
    fn with_values(&self, of: impl Fn(f64) -> f64, powers: [i32; 2]) -> Matrix6<f64> {
        let mut parts = self.parts;
        parts.eigenvalues.apply(|x| *x = of(*x));
        let whole = parts.recompose();
        let unit = |k: usize, power: i32| if k < 3 { 1.0 } else { self.arm.powi(power) };
        Matrix6::from_fn(|i, k| 0.5 * (whole[(i, k)] + whole[(k, i)]) * unit(i, powers[0]) * unit(k, powers[1]))
    }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;
    use crate::step::Gap;

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

    /// A body of this compliance, m/N.
    fn yielding(compliance: f64) -> Compliance {
        damped(compliance, 0.0)
    }

    /// A body of this compliance (m/N) and retardation time (s).
    fn damped(compliance: f64, retardation: f64) -> Compliance {
        let gap = Gap { compliance, retardation, ..Gap::rigid(DVec3::Y, 1e-3, 1.0) };
        let near = ContactWrench { gap: Some(gap), ..ContactWrench::none(at(0.0)) };
        let mut body = Compliance::default();
        body.learn(&ContactWrench::none(at(0.0)), &near, 0.01);
        body
    }

    /// A body of 250 N/m in series with the contact's 1000 N/m: 200 N/m are felt. The contact's damper moves by a fifth
    /// of the tool's velocity, and a fifth of its force comes through.
    #[test]
    fn the_body_is_in_series_with_contact_and_wall() {
        let tangent = LocalModel::new(&pressed(2.0), &yielding(1.0 / 250.0), 0.01, 1.0).evaluate(&at(0.0)).tangent;
        assert!(
            (tangent.stiffness[(1, 1)] - 200.0).abs() < 1e-9 && (tangent.damping[(1, 1)] - 3.0 / 25.0).abs() < 1e-12
        );
        assert_eq!(tangent.force[1], 2.0);
        // Rotations count at the lever arm: 0.05 N m/rad at 10 mm are 500 N/m.
        let mut wrench = pressed(2.0);
        wrench.stiffness[4][4] = 0.05;
        let tangent = LocalModel::new(&wrench, &yielding(1.0 / 250.0), 0.01, 1.0).evaluate(&at(0.0)).tangent;
        assert!((tangent.stiffness[(4, 4)] - 0.05 / 3.0).abs() < 1e-12);
        let gap = Gap::rigid(DVec3::Y, 0.0, 1000.0);
        let near = ContactWrench { step: 1, gap: Some(gap), ..ContactWrench::none(at(0.0)) };
        let wall = LocalModel::new(&near, &yielding(1.0 / 250.0), 0.01, 1.0).evaluate(&at(-1e-3)).tangent;
        assert!((wall.force[1] - 0.2).abs() < 1e-12);
    }

    /// A body of 250 N/m with a damper of 1 N s/m, of which 16/25 are felt, since the body takes four fifths of the
    /// tool's velocity. The wrench was found at rest.
    #[test]
    fn the_damper_of_the_body_is_felt() {
        let mut body = damped(1.0 / 250.0, 4e-3);
        let still = ContactWrench { h: 0.01, ..pressed(2.0) };
        body.learn(&still, &still, 0.01);
        let model = LocalModel::new(&still, &body, 0.01, 1.0);
        let moving = |y: f64, v: f64| RigidState { velocity: DVec3::Y * v, ..at(y) };
        let of_contact = 3.0 / 25.0;
        for v in [-0.1, -0.01, 0.05] {
            let tangent = model.evaluate(&moving(0.0, v)).tangent;
            assert!((tangent.damping[(1, 1)] - (0.64 + of_contact)).abs() < 1e-12);
            assert!((tangent.force[1] - (2.0 - (0.64 + of_contact) * v)).abs() < 1e-12, "velocity {v} m/s");
        }
        // Withdrawn fast, the skin lags behind and lets go, and keeps its energy.
        let (fast, slow) = (model.evaluate(&moving(0.0, 3.0)), model.evaluate(&moving(0.0, 0.0)));
        assert!(fast.tangent == Tangent::zero() && fast.stored == slow.stored && fast.stored > 0.0);
        // Behind a wall it is felt as well, and does not hold back a tool that is withdrawn.
        let gap = Gap::rigid(DVec3::Y, 0.0, 1000.0);
        let near = ContactWrench { step: 1, gap: Some(gap), ..ContactWrench::none(at(0.0)) };
        let wall = LocalModel::new(&near, &body, 0.01, 1.0);
        let force = |y: f64, v: f64| wall.evaluate(&moving(y, v)).tangent.force[1];
        assert!((force(-1e-3, -0.1) - (0.2 + 0.064)).abs() < 1e-12);
        assert!((force(-1e-3, 0.1) - (0.2 - 0.064)).abs() < 1e-12);
        let let_go = wall.evaluate(&moving(-1e-3, 1.0));
        assert!(let_go.tangent == Tangent::zero() && let_go.stored > 0.0 && force(1e-6, -1.0) == 0.0);
        // At the surface the force begins at zero, however fast the tool comes.
        assert!((force(-1e-9, -1.0) - 4e-7).abs() < 1e-12);
    }

    /// A first wrench that is half of what it should be, at a velocity whose damping would be more than the wrench:
    /// half of the wrench counts as damping, so that a tool that comes to rest is still pushed.
    #[test]
    fn damping_is_at_most_half_of_a_wrench() {
        let mut body = damped(1.0 / 250.0, 4e-3);
        let near = ContactWrench { gap: Some(Gap::rigid(DVec3::Y, 1e-3, 1e3)), ..ContactWrench::none(at(1e-3)) };
        let mut first = ContactWrench { h: 0.01, damping: [[0.0; 6]; 6], ..pressed(0.05) };
        first.wrench.force = DVec3::Y * 0.05;
        first.tool.position.y = -2e-3;
        body.learn(&near, &first, 0.01);
        assert!((body.twist().unwrap()[1] + 0.2).abs() < 1e-12);
        let model = LocalModel::new(&first, &body, 0.01, 1.0);
        let force = |v: f64| model.evaluate(&RigidState { velocity: DVec3::Y * v, ..at(-2e-3) }).tangent.force[1];
        assert!((force(-0.2) - 0.05).abs() < 1e-12 && (force(0.0) - 0.025).abs() < 1e-12);
    }

    /// A wrench that was found while the body followed the tool: at the same velocity the force is the wrench's, and at
    /// rest it is less by what the damper took.
    #[test]
    fn the_velocity_at_which_the_body_was_found_counts() {
        let mut body = damped(1.0 / 250.0, 4e-3);
        let deep = ContactWrench { h: 0.01, ..pressed(2.0) };
        let mut deeper = ContactWrench { tool: at(-1e-3), ..deep };
        deeper.wrench.force.y = 2.2 + 0.064;
        body.learn(&deep, &deep, 0.01);
        body.learn(&deep, &deeper, 0.01);
        assert!((body.twist().unwrap() + vector(0.1 * DVec3::Y, DVec3::ZERO)).norm() < 1e-12);
        let model = LocalModel::new(&ContactWrench { damping: [[0.0; 6]; 6], ..deeper }, &body, 0.01, 1.0);
        let force = |v: f64| model.evaluate(&RigidState { velocity: DVec3::Y * v, ..at(-1e-3) }).tangent.force[1];
        assert!((force(-0.1) - deeper.wrench.force.y).abs() < 1e-12);
        let taken = body.damping(model.evaluate(&at(-1e-3)).tangent.stiffness[(1, 1)]) * 0.1;
        assert!((force(0.0) - (deeper.wrench.force.y - taken)).abs() < 1e-12 && (taken - 0.064).abs() < 0.01);
        // The change that is foretold counts it as well: 1 mm further, and at rest.
        let (_, change) = model.foretell(&at(-2e-3), Some(Vector6::zeros())).unwrap();
        let stiffness = model.evaluate(&at(-1e-3)).tangent.stiffness[(1, 1)];
        assert!((change - (1e-3 * stiffness - taken)).abs() < 1e-12);
    }

    /// A contact that presses with 2 N and slides with a coefficient of friction of 0.3: the damping of friction counts
    /// up to 0.6 N, and for more where the force presses more.
    #[test]
    fn friction_is_limited_by_the_normal_force() {
        let mut wrench = ContactWrench { most_friction: 0.6, ..pressed(2.0) };
        (wrench.damping[0][0], wrench.damping[2][2]) = (100.0, 100.0);
        let model = LocalModel::new(&wrench, &Compliance::default(), 0.01, 1e-2);
        let sliding = |x: f64, y: f64, depth: f64| RigidState { velocity: DVec3::new(x, y, 0.0), ..at(-depth) };
        let force = |state: &RigidState| model.evaluate(state).tangent.force;
        assert!((force(&sliding(0.004, 0.0, 0.0))[0] + 0.4).abs() < 1e-12);
        assert!((force(&sliding(0.05, 0.0, 0.0))[0] + 0.6).abs() < 1e-12);
        assert!((force(&sliding(-0.05, 0.0, 1e-3))[0] - 0.9).abs() < 1e-12);
        // The contact's damping along the normal stays as it is, and the damping is that of the force.
        let state = sliding(0.05, -0.1, 0.0);
        let tangent = model.evaluate(&state).tangent;
        assert!((tangent.force[1] - 2.3).abs() < 1e-12 && (tangent.damping[(0, 0)] * 0.05 - 0.6).abs() < 1e-12);
        assert!(tangent.damping.symmetric_eigenvalues().min() > -1e-12);
        // A wrench that was found while the tool slid: at its own state the force is that of the wrench, and at rest
        // there is no friction. The skin moved, so that D v0 is more than the friction, and D is less.
        (wrench.wrench.force.x, wrench.friction.x, wrench.tool.velocity.x) = (-0.5, -0.5, 0.02);
        let model = LocalModel::new(&wrench, &Compliance::default(), 0.01, 1e-2);
        let force = |x: f64| model.evaluate(&sliding(x, 0.0, 0.0)).tangent.force[0];
        assert!((force(0.02) + 0.5).abs() < 1e-12 && force(0.0).abs() < 1e-12);
        assert!((force(0.01) + 0.25).abs() < 1e-12 && (force(0.05) + 0.6).abs() < 1e-12);
        // A tool that stuck to the skin stays where it is, and slides once it is moved.
        wrench.tool.velocity.x = 0.0;
        let model = LocalModel::new(&wrench, &Compliance::default(), 0.01, 1e-2);
        let force = |x: f64| model.evaluate(&sliding(x, 0.0, 0.0)).tangent.force[0];
        assert!((force(0.0) + 0.5).abs() < 1e-12 && (force(0.05) + 0.6).abs() < 1e-12);
        assert!((force(-0.05) - 0.6).abs() < 1e-12 && (force(-0.001) + 0.4).abs() < 1e-12);
    }

    /// With a coefficient of friction of 1 the net force is tilted by 45 degrees. A tool that slides back keeps its
    /// contact, and one that is withdrawn lets go without being pulled back.
    #[test]
    fn friction_neither_ends_a_contact_nor_lets_it_pull() {
        let mut wrench = ContactWrench { most_friction: 2.0, ..pressed(2.0) };
        wrench.damping[0][0] = 1000.0;
        (wrench.wrench.force.x, wrench.friction.x, wrench.tool.velocity.x) = (-2.0, -2.0, 0.1);
        let model = LocalModel::new(&wrench, &Compliance::default(), 0.01, 1e-2);
        for x in [-0.2, -0.01, 0.0, 0.01, 0.2] {
            for y in (0..200).map(|k| 0.01 * f64::from(k)) {
                let state = RigidState { velocity: DVec3::new(x, y, 0.0), ..at(-1e-4) };
                let force = model.evaluate(&state).tangent.force;
                assert!(force[1] >= 0.0 && (y > 0.1 || force[1] > 1.0), "velocity {x}, {y} m/s: force {force}");
                assert!(force[0] * x <= 1e-12 && force[0].abs() <= 2.2 + 1e-12);
            }
        }
    }

    #[test]
    fn force_follows_the_tool_and_lets_go_without_pulling() {
        let model = LocalModel::new(&pressed(2.0), &Compliance::default(), 0.01, 1e-3);
        let force = |y: f64| model.evaluate(&at(y)).tangent.force[1];
        assert!((force(-5e-4) - 2.5).abs() < 1e-12 && (force(5e-4) - 1.5).abs() < 1e-12);
        // Beyond the trusted distance the force grows no further; 2 mm above y = 0 the tool leaves the contact.
        assert!((force(-0.01) - 3.0).abs() < 1e-12 && model.evaluate(&at(-0.01)).is_beyond);
        assert_eq!(model.evaluate(&at(2.1e-3)), Evaluation::zero());
        let leaving = RigidState { velocity: DVec3::Y * 0.1, ..at(0.0) };
        assert!((model.evaluate(&leaving).tangent.force[1] - 1.7).abs() < 1e-12);
        // Contact from two sides, with 6 N up and 4 N down, pushes the tool back whichever way it moves.
        let between = LocalModel::new(&pressed(10.0), &Compliance::default(), 0.01, 1.0);
        assert!((between.evaluate(&at(5e-3)).tangent.force[1] + 3.0).abs() < 1e-12);
        assert_eq!(LocalModel::raw(&pressed(2.0)).evaluate(&at(-0.1)).tangent.force[1], 2.0);
    }

    #[test]
    fn a_gap_is_a_wall_where_it_ends() {
        let gap = Gap::rigid(DVec3::Y, 2e-3, 500.0);
        let model = LocalModel::new(
            &ContactWrench { step: 1, gap: Some(gap), ..ContactWrench::none(at(0.0)) },
            &Compliance::default(),
            0.01,
            1e-3,
        );
        assert!(model.has_contact() && model.evaluate(&at(-1.9e-3)) == Evaluation::zero());
        let within = model.evaluate(&at(-2.4e-3));
        assert!((within.tangent.force[1] - 0.2).abs() < 1e-12 && (within.stored - 0.5 * 500.0 * 1.6e-7).abs() < 1e-15);
        let touched = Gap { distance: -1e-3, ..gap };
        let wrench = ContactWrench { step: 1, gap: Some(touched), ..ContactWrench::none(at(0.0)) };
        assert!(
            (LocalModel::new(&wrench, &Compliance::default(), 0.01, 1e-3).evaluate(&at(0.0)).tangent.force[1] - 0.5)
                .abs()
                < 1e-12
        );
        let deep = model.evaluate(&at(-0.01));
        assert!((deep.tangent.force[1] - 0.5).abs() < 1e-12 && deep.is_beyond);
    }

    /// A wrench without contact, with these gaps to one body, and from the fifth on to another.
    fn beside(gaps: &[(DVec3, f64)]) -> ContactWrench {
        let number = |gap: &(DVec3, f64)| gaps.iter().position(|other| other == gap).unwrap();
        let of = |gap: &(DVec3, f64)| Gap {
            compliance: 2e-3,
            pair: u32::from(number(gap) >= 4),
            ..Gap::rigid(gap.0.normalize(), gap.1, 500.0 + 100.0 * number(gap) as f64)
        };
        let farther = std::array::from_fn(|k| gaps.get(k + 1).map(of));
        ContactWrench { step: 1, gap: gaps.first().map(of), farther, ..ContactWrench::none(at(0.0)) }
    }

    /// Round contact on bodies that yield or not: of the depth, the contact keeps what its force needs, and the body
    /// takes what is left.
    #[test]
    fn the_force_of_a_round_contact_goes_with_the_square_of_its_depth() {
        let wall = |stiffness: f64, compliance: f64, pair: u32| {
            let nearest = Gap { steepness: 1e6, ..Gap::rigid(DVec3::X, 1.0, stiffness) };
            let gap = Gap { steepness: 1e6, compliance, pair, ..Gap::rigid(DVec3::Y, 0.0, stiffness) };
            let farther = [Some(gap), None, None, None, None];
            let near = ContactWrench { step: 1, gap: Some(nearest), farther, ..ContactWrench::none(at(0.0)) };
            LocalModel::new(&near, &yielding(compliance), 0.01, 1.0)
        };
        for (stiffness, compliance) in [(0.0, 0.0), (0.0, 1e-3), (200.0, 1e-3), (200.0, 0.0)] {
            // A wall of the nearest body, and of another one.
            for pair in [0, 1] {
                for depth in [1e-6, 1e-4, 2e-3, 1e-2] {
                    let found = wall(stiffness, compliance, pair).evaluate(&at(-depth));
                    let force = found.tangent.force[1];
                    let left = depth - compliance * force;
                    let expected = stiffness * left + 1e6 * left * left;
                    assert!((force / expected - 1.0).abs() < 1e-9, "depth {depth} m: {force} N, not {expected} N");
                    let slope = in_series(stiffness + 2e6 * left, compliance);
                    assert!((found.tangent.stiffness[(1, 1)] / slope - 1.0).abs() < 1e-9);
                }
            }
        }
    }

    /// Walls of 500 and 600 N/m on a body of 250 N/m. In a corner each wall pushes; in a hollow, whose walls are nearly parallel,
    /// the body is hardly stiffer than on a plane; between two walls the forces cancel, and the body stays.
    #[test]
    fn the_body_yields_once_for_all_walls() {
        let force = |gaps: &[(DVec3, f64)], y: DVec3| {
            let model = LocalModel::new(&beside(gaps), &yielding(1.0 / 250.0), 0.01, 1.0);
            model.evaluate(&RigidState::at_rest(y, DQuat::IDENTITY)).tangent.force.fixed_rows::<3>(0).into_owned()
        };
        let felt = [500.0, 600.0].map(|stiffness| in_series(stiffness, 1.0 / 250.0));
        let corner = [(DVec3::Y, 2e-3), (DVec3::X, 3e-3)];
        let f = force(&corner, DVec3::new(-5e-3, -5e-3, 0.0));
        assert!((f - Vector3::new(2e-3 * felt[1], 3e-3 * felt[0], 0.0)).norm() < 1e-12, "{f}");
        let f = force(&corner, DVec3::new(-2e-3, -5e-3, 0.0));
        assert!((f - Vector3::new(0.0, 3e-3 * felt[0], 0.0)).norm() < 1e-12, "{f}");
        // Two walls of 500 and 600 N/m along y, all but parallel, are one of 1100 N/m.
        let hollow = [(DVec3::new(1e-4, 1.0, 0.0), 0.0), (DVec3::new(-1e-4, 1.0, 0.0), 0.0)];
        let f = force(&hollow, DVec3::Y * -1e-3);
        assert!((f.y - 1e-3 * in_series(1100.0, 1.0 / 250.0)).abs() < 1e-6 && f.x.abs() < 1e-4, "{f}");
        let slot = [(DVec3::Y, -1.2e-3), (DVec3::NEG_Y, -1e-3)];
        assert!(force(&slot, DVec3::ZERO).norm() < 1e-12);
        assert!((force(&slot, DVec3::Y * 1e-4).y + 1e-4 * in_series(1100.0, 1.0 / 250.0)).abs() < 1e-12);
    }

    /// With walls in many directions on a body that yields, within the trusted distance and beyond, the force is the
    /// gradient of the potential, and the stiffness that of the force.
    #[test]
    fn the_force_of_walls_is_the_gradient_of_their_potential() {
        let gaps = [
            (DVec3::new(0.9, 0.1, 0.2), -1e-3),
            (DVec3::new(0.5, 0.8, -0.1), 0.0),
            (DVec3::Y, 2e-4),
            (DVec3::new(-0.7, 0.6, 0.3), 5e-4),
            (DVec3::new(0.0, -0.4, 1.0), 1e-3),
            (DVec3::new(0.3, -1.0, 0.2), 1.5e-3),
        ];
        let (mut beyond, mut compared) = (0, 0);
        let cases = [
            (1.0, 1.0 / 250.0, 0.0),
            (1e-3, 1.0 / 250.0, 0.0),
            (1.0, 0.0, 0.0),
            (1e-3, 1e-2, 0.0),
            (1.0, 0.1, 0.0),
            (1.0, 1.0 / 250.0, 1e6),
            (1.0, 0.0, 1e6),
            (1e-3, 1e-2, 1e7),
        ];
        for (trust, compliance, steepness) in cases {
            let mut near = beside(&gaps);
            near.gap.iter_mut().chain(near.farther.iter_mut().flatten()).for_each(|gap| gap.steepness = steepness);
            let model = LocalModel::new(&near, &yielding(compliance), 0.01, trust);
            for k in 0..400 {
                let (sine, cosine) = (0.7 * f64::from(k)).sin_cos();
                let x = 4e-3 * DVec3::new(sine, cosine * 0.8, (1.3 * f64::from(k)).sin());
                let value = |x: DVec3| model.evaluate(&RigidState::at_rest(x, DQuat::IDENTITY));
                let here = value(x);
                beyond += usize::from(here.is_beyond);
                for (axis, unit) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().enumerate() {
                    let step = 1e-8;
                    let slope = (value(x + step * unit).stored - value(x - step * unit).stored) / (2.0 * step);
                    assert!(
                        (slope + here.tangent.force[axis]).abs() < 1e-6,
                        "trust {trust} m, compliance {compliance} m/N, at {x}: force {}, slope {slope}",
                        here.tangent.force
                    );
                    // Where a wall begins to press within the step the stiffness jumps.
                    let other = value(x + step * unit);
                    if other.is_beyond || here.is_beyond || other.tangent.stiffness != here.tangent.stiffness {
                        continue;
                    }
                    compared += 1;
                    let change = (here.tangent.force - other.tangent.force)[axis] / step;
                    let own = here.tangent.stiffness[(axis, axis)];
                    assert!((change - own).abs() < 1e-3, "stiffness {own} N/m, the force falls by {change} N/m");
                }
            }
        }
        assert!(beyond > 100 && compared > 1000, "{beyond} places beyond the trusted distance, {compared} slopes");
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
        let cases = [(2.0, 1e-4, 0.0), (2.0, 1e-2, 1e-3), (10.0, 1e-4, 1e-3), (10.0, 1e-2, 0.0)];
        for (pressing, trust, compliance) in cases {
            let model = LocalModel::new(&ContactWrench { pressing, ..wrench }, &yielding(compliance), 0.01, trust);
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
        let model = LocalModel::new(&pressed(2.0), &Compliance::default(), 0.01, 1e-3);
        let here = RigidState { velocity: DVec3::Y * -0.01, ..at(-4e-4) };
        let felt = model.evaluate(&here);
        let next = LocalModel::of(&here, &felt, &model, 0.01, 1e-3);
        for y in [-8e-4, -4e-4, 0.0, 5e-4] {
            let there = RigidState { velocity: DVec3::Y * 0.02, ..at(y) };
            let (a, b) = (model.evaluate(&there), next.evaluate(&there));
            assert!(
                (a.tangent.force - b.tangent.force).norm() < 1e-9 && (a.stored - b.stored).abs() < 1e-12,
                "the two models differ at y = {y} m"
            );
        }
    }

    /// A model made of what is felt gives the same force as the model before it, also while the tool slides, sticks or is
    /// withdrawn.
    #[test]
    fn a_model_of_what_is_felt_goes_on_while_the_tool_slides() {
        let mut wrench = ContactWrench { most_friction: 0.6, ..pressed(2.0) };
        wrench.damping[0][0] = 100.0;
        (wrench.wrench.force.x, wrench.friction.x) = (-0.4, -0.4);
        for v in [DVec3::new(0.05, 0.02, 0.0), DVec3::new(-0.05, -0.02, 0.0), DVec3::new(0.003, 0.01, 0.0)] {
            let model = LocalModel::new(&wrench, &Compliance::default(), 0.01, 1e-2);
            let here = RigidState { velocity: v, ..at(-4e-4) };
            let felt = model.evaluate(&here);
            let next = LocalModel::of(&here, &felt, &model, 0.01, 1e-2).evaluate(&here);
            let difference = (felt.tangent.force - next.tangent.force).norm();
            assert!(difference < 1e-12, "velocity {v} m/s: the force changes by {difference} N");
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
            let tangent = LocalModel::new(&wrench, &Compliance::default(), arm, 1.0).evaluate(&at(0.0)).tangent;
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
        let tangent = LocalModel::new(&pressed(2.0), &Compliance::default(), 0.01, 1.0).evaluate(&at(0.0)).tangent;
        assert!((tangent.stiffness[(1, 1)] - 1000.0).abs() < 1e-9);
        wrench.stiffness = [[1e200; 6]; 6];
        let tangent = LocalModel::new(&wrench, &Compliance::default(), 0.01, 1.0).evaluate(&at(0.0)).tangent;
        assert!(tangent.stiffness.iter().all(|x| x.is_finite()));
    }

    #[test]
    fn the_change_that_k_foretells() {
        let model = LocalModel::new(&pressed(2.0), &Compliance::default(), 0.01, 1.0);
        let (normal, change) = model.foretell(&at(-1e-3), None).unwrap();
        assert!(normal == DVec3::Y && (change - 1.0).abs() < 1e-12);
        assert!(
            LocalModel::new(&ContactWrench::none(at(0.0)), &Compliance::default(), 0.01, 1.0)
                .foretell(&at(1.0), None)
                .is_none()
        );
    }
}
