//! Walls at the ends of the gaps between the tool (the rigid body that the haptic device leads) and bodies that it does
//! not touch: the haptic loop's model of contact before the first touch.

use glam::DVec3;
use nalgebra::{Matrix3, Vector3, Vector6};

use super::compliance::Compliance;
use super::local_model::{Evaluation, Tangent, along, in_series};
use crate::step::{ContactWrench, FARTHER, Gap};

/// A wall at the end of a gap.
#[derive(Debug, Clone, Copy)]
struct Wall {
    normal: DVec3,
    /// Distance that the tool may go against the normal from the model's pose, m.
    distance: f64,
    contact: Penalty,
    /// Compliance of the wall's own body, m/N; `None` where that is the nearest body.
    own: Option<f64>,
}

/// Force of a contact with a spherical tool and a body held still, by the depth d: stiffness d + steepness d^2.
#[derive(Debug, Clone, Copy)]
struct Penalty {
    /// N/m.
    stiffness: f64,
    /// N/m^2.
    steepness: f64,
}

impl Penalty {
    /// The contact at the end of a gap.
    fn of(gap: &Gap) -> Penalty {
        Penalty { stiffness: gap.stiffness, steepness: gap.steepness }
    }

    fn pushes(&self) -> bool {
        self.stiffness > 0.0 || self.steepness > 0.0
    }

    fn force(&self, depth: f64) -> f64 {
        depth * (self.stiffness + self.steepness * depth)
    }

    fn slope(&self, depth: f64) -> f64 {
        self.stiffness + 2.0 * self.steepness * depth
    }

    fn energy(&self, depth: f64) -> f64 {
        depth * depth * (self.stiffness / 2.0 + self.steepness * depth / 3.0)
    }

    /// The depth that is left to the contact where a body of this compliance (m/N) takes the rest of the depth.
    fn depth_on(&self, compliance: f64, depth: f64) -> f64 {
        let held = 1.0 + compliance * self.stiffness;
        2.0 * depth / (held + (held * held + 4.0 * compliance * self.steepness * depth).sqrt())
    }

    /// Energy of contact and body together, J.
    fn energy_on(&self, compliance: f64, depth: f64) -> f64 {
        let left = self.depth_on(compliance, depth);
        self.energy(left) + 0.5 * compliance * self.force(left).powi(2)
    }
}

/// Walls at the ends of the gaps of a wrench without contact.
///
/// The body that is nearest yields as a whole, by the displacement -u where u makes the energy u.u / (2 c) + sum E(d)
/// least: c is the body's compliance, E the energy of contact with a wall, and d the depth of the tool in it, less what
/// the displacement takes from it; walls that the tool does not reach do not count. The least energy is the walls'
/// potential, so that a tool in a hollow feels the body as stiff as on a plane. The body's own damping is added. Walls
/// of other bodies count each by itself, without damping.
#[derive(Debug, Clone, Copy)]
pub struct Walls {
    walls: [Option<Wall>; 1 + FARTHER],
    /// The body that is nearest.
    body: Compliance,
    /// Depth in a wall up to which the force is trusted, m.
    trust: f64,
}

/// Greatest number of Newton's steps for the set of walls that press, and of halvings of a step. The energy is convex and
/// piecewise cubic, so that few are needed.
const MOST_SETS: usize = 40;
const MOST_HALVINGS: usize = 30;
/// A step that is shorter than this share of the displacement is left out.
const SETTLED: f64 = 1e-12;
/// Share by which two energies may differ by rounding.
const ROUNDING: f64 = 1e-14;

impl Walls {
    /// No walls.
    pub fn none() -> Walls {
        Walls { walls: [None; 1 + FARTHER], body: Compliance::default(), trust: f64::INFINITY }
    }

    /// The walls of a wrench without contact, where `body` is nearest.
    pub fn of(wrench: &ContactWrench, body: &Compliance, trust: f64) -> Walls {
        let Some(nearest) = wrench.gap else { return Walls::none() };
        let wall = |gap: &Gap| {
            let own = (gap.pair != nearest.pair).then_some(gap.compliance);
            Wall { normal: gap.normal, distance: gap.distance, contact: Penalty::of(gap), own }
        };
        let mut walls = wrench.gaps().map(wall);
        Walls { walls: std::array::from_fn(|_| walls.next()), body: *body, trust: trust + (-nearest.distance).max(0.0) }
    }

    /// Normal of the nearest wall.
    pub fn normal(&self) -> Option<DVec3> {
        self.walls[0].map(|wall| wall.normal)
    }

    /// Whether a wall pushes where the tool reaches it.
    pub fn push(&self) -> bool {
        self.walls.iter().flatten().any(|wall| wall.contact.pushes())
    }

    /// The walls' force on a tool that moved by a displacement from the model's pose and has this velocity (m/s).
    pub fn evaluate(&self, moved: &Vector6<f64>, velocity: &DVec3) -> Evaluation {
        let depths = self.walls.map(|wall| wall.map_or(0.0, |wall| -wall.distance - along(&wall.normal, moved)));
        if depths.iter().all(|depth| *depth <= 0.0) {
            return Evaluation::zero();
        }
        let reached = self.walls.iter().zip(depths).filter_map(|(wall, depth)| Some((wall.as_ref()?, depth)));
        let others = reached.filter_map(|(wall, depth)| Some(wall.alone(wall.own?, depth.max(0.0), self.trust)));
        others.fold(self.of_body(&depths, velocity), |sum, other| sum.and(&other))
    }

    /// The force of the nearest body's walls, with the body's own damping.
    fn of_body(&self, depths: &[f64; 1 + FARTHER], velocity: &DVec3) -> Evaluation {
        let Some(nearest) = &self.walls[0] else { return Evaluation::zero() };
        let u = self.yielding(depths);
        let force = self.push_of(depths, &u);
        let most = nearest.contact.energy_on(self.body.value(), self.trust);
        let elastic = limited(self.energy(depths, &u), force, self.stiffness(depths, &u), most);
        self.damped(elastic, &Vector3::from(velocity.to_array()))
    }

    /// The nearest body's walls that press where it yields by u, and the depths in them that are left, m.
    fn pressed(&self, depths: &[f64; 1 + FARTHER], u: &Vector3<f64>) -> impl Iterator<Item = (&Wall, f64)> {
        let walls = self.walls.iter().zip(depths).filter_map(|(wall, depth)| Some((wall.as_ref()?, *depth)));
        let left = walls.filter(|(wall, _)| wall.own.is_none()).map(|(wall, depth)| (wall, depth - wall.n().dot(u)));
        left.filter(|(_, depth)| *depth > 0.0)
    }

    /// The sum of the walls' forces, N.
    fn push_of(&self, depths: &[f64; 1 + FARTHER], u: &Vector3<f64>) -> Vector3<f64> {
        self.pressed(depths, u).map(|(wall, depth)| wall.contact.force(depth) * wall.n()).sum()
    }

    /// The energy of the body and its walls, J.
    fn energy(&self, depths: &[f64; 1 + FARTHER], u: &Vector3<f64>) -> f64 {
        let of_walls: f64 = self.pressed(depths, u).map(|(wall, depth)| wall.contact.energy(depth)).sum();
        of_walls + if self.body.value() > 0.0 { 0.5 * u.norm_squared() / self.body.value() } else { 0.0 }
    }

    /// The force of the body's walls with the body's own damping, which is at most as great as the force without it: so
    /// the force begins at zero, and a tool that is withdrawn is not held back.
    fn damped(&self, mut elastic: Evaluation, velocity: &Vector3<f64>) -> Evaluation {
        let tangent = &mut elastic.tangent;
        let force: Vector3<f64> = tangent.force.fixed_rows::<3>(0).into();
        let stiffness: Matrix3<f64> = tangent.stiffness.fixed_view::<3, 3>(0, 0).into();
        let damping = self.body.damping(1.0) * stiffness * stiffness;
        let resisted = damping * velocity;
        let (pushes, pulls) = (force.norm_squared(), force.dot(&resisted));
        if pulls >= pushes {
            *tangent = Tangent::zero();
            return elastic;
        }
        let share = if pulls < -pushes { -pushes / pulls } else { 1.0 };
        tangent.force.fixed_rows_mut::<3>(0).copy_from(&(force - share * resisted));
        elastic.body_damping.fixed_view_mut::<3, 3>(0, 0).copy_from(&(share * damping));
        elastic.tangent.damping = elastic.body_damping;
        elastic
    }

    /// The displacement u, by Newton's method; a step by which the energy would rise is halved.
    fn yielding(&self, depths: &[f64; 1 + FARTHER]) -> Vector3<f64> {
        let mut u = Vector3::zeros();
        if self.body.value() <= 0.0 {
            return u;
        }
        for _ in 0..MOST_SETS {
            // The gradient of the energy, u / c - f, is zero where the body's spring balances the walls' force f.
            let matrix = Matrix3::identity() + self.body.value() * self.slopes(depths, &u);
            let Some(factor) = matrix.cholesky() else { return u };
            let mut step = factor.solve(&(self.body.value() * self.push_of(depths, &u) - u));
            if step.norm() <= SETTLED * u.norm() {
                return u;
            }
            let energy = self.energy(depths, &u);
            // Near the minimum the energy changes by less than it is rounded by.
            let rises = |step: &Vector3<f64>| self.energy(depths, &(u + step)) > energy * (1.0 + ROUNDING);
            let mut halvings = 0;
            while rises(&step) && halvings < MOST_HALVINGS {
                step *= 0.5;
                halvings += 1;
            }
            if halvings == MOST_HALVINGS {
                return u;
            }
            u += step;
        }
        u
    }

    /// Sum of the stiffnesses of the walls that press, with the body held still.
    fn slopes(&self, depths: &[f64; 1 + FARTHER], u: &Vector3<f64>) -> Matrix3<f64> {
        self.pressed(depths, u).map(|(wall, depth)| wall.contact.slope(depth) * wall.n() * wall.n().transpose()).sum()
    }

    /// The stiffness that the pressing walls of the body have together, in series with the body.
    fn stiffness(&self, depths: &[f64; 1 + FARTHER], u: &Vector3<f64>) -> Matrix3<f64> {
        let of_walls = self.slopes(depths, u);
        let matrix = Matrix3::identity() + self.body.value() * of_walls;
        let felt = matrix.cholesky().map_or(Matrix3::zeros(), |factor| factor.solve(&of_walls));
        0.5 * (felt + felt.transpose())
    }
}

/// Force, stiffness and energy of walls. Beyond the energy `most` (J) the potential is linear in the root of the
/// energy: the force stays where energy goes with the square of the depth, and grows with the root of the depth where
/// energy goes with the cube.
fn limited(energy: f64, force: Vector3<f64>, stiffness: Matrix3<f64>, most: f64) -> Evaluation {
    let [size, most] = [energy, most].map(|energy| (2.0 * energy).sqrt());
    let is_beyond = size > most;
    let share = if is_beyond { most / size } else { 1.0 };
    let stored = if is_beyond { most * (size - 0.5 * most) } else { energy };
    let mut tangent = Tangent::zero();
    tangent.force.fixed_rows_mut::<3>(0).copy_from(&(share * force));
    tangent.stiffness.fixed_view_mut::<3, 3>(0, 0).copy_from(&(share * stiffness));
    Evaluation { tangent, stored, is_beyond, ..Evaluation::zero() }
}

impl Wall {
    fn n(&self) -> Vector3<f64> {
        Vector3::from(self.normal.to_array())
    }

    /// The wall's force at a depth (m) by itself, on a body of its own compliance (m/N).
    fn alone(&self, compliance: f64, depth: f64, trust: f64) -> Evaluation {
        let left = self.contact.depth_on(compliance, depth);
        let stiffness = in_series(self.contact.slope(left), compliance) * self.n() * self.n().transpose();
        let energy = self.contact.energy_on(compliance, depth);
        let force = self.contact.force(left) * self.n();
        if depth > 0.0 {
            limited(energy, force, stiffness, self.contact.energy_on(compliance, trust))
        } else {
            Evaluation::zero()
        }
    }
}
