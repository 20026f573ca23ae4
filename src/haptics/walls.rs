//! Walls at the ends of the gaps between the tool (the rigid body that the haptic device leads) and bodies that it does
//! not touch: the haptic loop's model of contact before the first touch.

use glam::DVec3;
use nalgebra::{Matrix3, Vector3, Vector6};

use super::local_model::{Evaluation, Tangent, along, in_series};
use crate::step::{ContactWrench, FARTHER, Gap};

/// A wall at the end of a gap.
#[derive(Debug, Clone, Copy)]
struct Wall {
    normal: DVec3,
    /// Distance that the tool may go against the normal from the model's pose, m.
    distance: f64,
    /// Stiffness, N/m.
    stiffness: f64,
    /// Whether the wall is a part of the body that yields.
    yields: bool,
}

/// Walls at the ends of the gaps of a wrench without contact.
///
/// The body that is nearest yields as a whole, by the displacement -u where u makes the energy u.u / (2 c) + sum k d^2 / 2
/// least: c is the body's compliance, k the stiffness of a wall, and d the depth of the tool in it, less what the
/// displacement takes from it; walls that the tool does not reach do not count. The least energy is the walls' potential,
/// so that a tool in a hollow feels the body as stiff as on a plane. Walls of other bodies count each by itself.
#[derive(Debug, Clone, Copy)]
pub struct Walls {
    walls: [Option<Wall>; 1 + FARTHER],
    /// Compliance of the body that is nearest, m/N.
    compliance: f64,
    /// Stiffness that one wall of that body is felt with, N/m.
    felt: f64,
    /// Depth in a wall up to which the force grows, m.
    trust: f64,
}

/// Greatest number of Newton's steps for the set of walls that press, and of halvings of a step. The energy is convex and
/// piecewise quadratic, so that few are needed.
const MOST_SETS: usize = 40;
const MOST_HALVINGS: usize = 30;
/// A step that is shorter than this share of the displacement is left out.
const SETTLED: f64 = 1e-12;

impl Walls {
    /// No walls.
    pub fn none() -> Walls {
        Walls { walls: [None; 1 + FARTHER], compliance: 0.0, felt: 0.0, trust: f64::INFINITY }
    }

    /// The walls of a wrench without contact on a body of the given compliance (m/N).
    pub fn of(wrench: &ContactWrench, compliance: f64, trust: f64) -> Walls {
        let Some(nearest) = wrench.gap else { return Walls::none() };
        let wall = |gap: &Gap| {
            let yields = gap.pair == nearest.pair;
            let stiffness = if yields { gap.stiffness } else { in_series(gap.stiffness, gap.compliance) };
            Wall { normal: gap.normal, distance: gap.distance, stiffness, yields }
        };
        let mut walls = wrench.gaps().map(wall);
        Walls {
            walls: std::array::from_fn(|_| walls.next()),
            compliance,
            felt: in_series(nearest.stiffness, compliance),
            trust: trust + (-nearest.distance).max(0.0),
        }
    }

    /// Normal of the nearest wall.
    pub fn normal(&self) -> Option<DVec3> {
        self.walls[0].map(|wall| wall.normal)
    }

    /// Whether a wall pushes where the tool reaches it.
    pub fn push(&self) -> bool {
        self.walls.iter().flatten().any(|wall| wall.stiffness > 0.0)
    }

    /// The walls' force on a tool that moved by a displacement from the model's pose.
    pub fn evaluate(&self, moved: &Vector6<f64>) -> Evaluation {
        let depths = self.walls.map(|wall| wall.map_or(0.0, |wall| -wall.distance - along(&wall.normal, moved)));
        if depths.iter().all(|depth| *depth <= 0.0) {
            return Evaluation::zero();
        }
        let u = self.yielding(&depths);
        let mut force = Vector3::zeros();
        for (wall, pressed) in self.pressed(&depths, &u).filter(|(wall, _)| wall.yields) {
            force += wall.stiffness * pressed * wall.n();
        }
        let of_body = limited(self.energy(&depths, &u), force, self.stiffness(&depths, &u), self.felt, self.trust);
        let others = self.pressed(&depths, &u).filter(|(wall, _)| !wall.yields).map(|(wall, depth)| {
            let n = wall.n();
            let (energy, stiffness) = (0.5 * wall.stiffness * depth * depth, wall.stiffness * n * n.transpose());
            limited(energy, wall.stiffness * depth * n, stiffness, wall.stiffness, self.trust)
        });
        others.fold(of_body, |sum, other| sum.and(&other))
    }

    /// The walls that press where the body yields by u, and the depths in them that are left, m.
    fn pressed(&self, depths: &[f64; 1 + FARTHER], u: &Vector3<f64>) -> impl Iterator<Item = (&Wall, f64)> {
        let left = self.walls.iter().zip(depths).filter_map(|(wall, depth)| Some((wall.as_ref()?, *depth)));
        left.map(|(wall, depth)| (wall, depth - wall.given(u))).filter(|(_, depth)| *depth > 0.0)
    }

    /// The energy of the body and its walls, J.
    fn energy(&self, depths: &[f64; 1 + FARTHER], u: &Vector3<f64>) -> f64 {
        let of_walls = self.pressed(depths, u).filter(|(wall, _)| wall.yields);
        let of_walls: f64 = of_walls.map(|(wall, depth)| 0.5 * wall.stiffness * depth * depth).sum();
        of_walls + if self.compliance > 0.0 { 0.5 * u.norm_squared() / self.compliance } else { 0.0 }
    }

    /// The displacement u, by Newton's method; a step that does not lessen the energy is halved.
    fn yielding(&self, depths: &[f64; 1 + FARTHER]) -> Vector3<f64> {
        let mut u = Vector3::zeros();
        if self.compliance <= 0.0 {
            return u;
        }
        for _ in 0..MOST_SETS {
            // (I + c S) u = c sum k depth n, of the walls that press now.
            let pressing = self.pressed(depths, &u).filter(|(wall, _)| wall.yields);
            let push: Vector3<f64> =
                pressing.map(|(wall, left)| wall.stiffness * (left + wall.given(&u)) * wall.n()).sum();
            let matrix = Matrix3::identity() + self.compliance * self.sum(depths, &u);
            let Some(factor) = matrix.cholesky() else { return u };
            let mut step = factor.solve(&(self.compliance * push)) - u;
            if step.norm() <= SETTLED * u.norm() {
                return u;
            }
            let energy = self.energy(depths, &u);
            let lessens = |step: &Vector3<f64>| self.energy(depths, &(u + step)) < energy;
            let mut halvings = 0;
            while !lessens(&step) && halvings < MOST_HALVINGS {
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

    /// Sum k n n^T of the pressing walls of the body that yields.
    fn sum(&self, depths: &[f64; 1 + FARTHER], u: &Vector3<f64>) -> Matrix3<f64> {
        let pressing = self.pressed(depths, u).filter(|(wall, _)| wall.yields);
        pressing.map(|(wall, _)| wall.stiffness * wall.n() * wall.n().transpose()).sum()
    }

    /// The stiffness that the pressing walls of the body have together, in series with the body.
    fn stiffness(&self, depths: &[f64; 1 + FARTHER], u: &Vector3<f64>) -> Matrix3<f64> {
        let of_walls = self.sum(depths, u);
        let matrix = Matrix3::identity() + self.compliance * of_walls;
        let felt = matrix.cholesky().map_or(Matrix3::zeros(), |factor| factor.solve(&of_walls));
        0.5 * (felt + felt.transpose())
    }
}

/// Force, stiffness and energy of walls, where the force grows as far as it would in one wall of stiffness `felt` (N/m) to
/// the depth `trust` (m); beyond that it stays.
fn limited(energy: f64, force: Vector3<f64>, stiffness: Matrix3<f64>, felt: f64, trust: f64) -> Evaluation {
    let (size, most) = ((2.0 * energy).sqrt(), felt.sqrt() * trust);
    let is_beyond = size > most;
    let share = if is_beyond { most / size } else { 1.0 };
    let stored = if is_beyond { most * (size - 0.5 * most) } else { energy };
    let mut tangent = Tangent::zero();
    tangent.force.fixed_rows_mut::<3>(0).copy_from(&(share * force));
    tangent.stiffness.fixed_view_mut::<3, 3>(0, 0).copy_from(&(share * stiffness));
    Evaluation { tangent, stored, is_beyond }
}

impl Wall {
    fn n(&self) -> Vector3<f64> {
        Vector3::from(self.normal.to_array())
    }

    /// The part of a tool's depth that the body's yielding by u takes away, m.
    fn given(&self, u: &Vector3<f64>) -> f64 {
        if self.yields { self.n().dot(u) } else { 0.0 }
    }
}
