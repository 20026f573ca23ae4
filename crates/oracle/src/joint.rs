//! Ball joints between dynamic cores, or of one with what moves as it is told, as implicit springs.

use glam::{DQuat, DVec3};
use palpate::scene::Resistance;

use crate::body::Core;
use crate::linear::Entries;

/// Step of the central differences that give angles' derivatives, rad.
const DIFFERENCE: f64 = 1e-5;

/// A side of a joint, as it stands.
#[derive(Debug, Clone, Copy)]
pub struct Side {
    /// The dynamic core that it is.
    pub core: Option<usize>,
    /// Where it has the joint, world, m.
    pub end: DVec3,
    /// How it has turned since rest, world.
    pub turn: DQuat,
    /// `end` and `turn` after the next step, of what is no dynamic core; the caller sets them.
    pub next: (DVec3, DQuat),
}

/// A ball joint.
#[derive(Debug, Clone)]
pub struct Joint {
    /// The second turns about the first.
    pub sides: [Side; 2],
    /// Of the spring between the two ends, N/m.
    pub stiffness: f64,
    /// Of the springs beyond the limits of swing and of twist, N m/rad.
    pub limit_stiffness: [f64; 2],
    /// What resists turning; its axis at rest in the world.
    pub resistance: Resistance,
}

impl Joint {
    /// Adds the springs to A and b of a step of `h` seconds: h^2 k and -h k (what it stretches to if nothing is done).
    pub fn add_terms(&self, cores: &[Core], firsts: &[usize], a: &mut Entries, b: &mut [f64], h: f64) {
        let [first, second] = &self.sides;
        let middle = 0.5 * (first.end + second.end);
        let arm = |side: &Side| side.core.map_or(DVec3::ZERO, |core| middle - cores[core].centre);
        // How each end goes on, and turns, by itself.
        let way = |side: &Side| match side.core {
            Some(core) => (h * (cores[core].velocity + cores[core].spin.cross(arm(side))), h * cores[core].spin),
            None => (side.next.0 - side.end, (side.next.1 * side.turn.inverse()).to_scaled_axis()),
        };
        let (ways, apart) = ([way(first), way(second)], first.end - second.end);
        let turned = (second.turn * first.turn.inverse()).to_scaled_axis();
        for axis in DVec3::AXES {
            // Of the first against the second along the axis, and about it.
            let stretch = axis.dot(apart + ways[0].0 - ways[1].0);
            let row = self.row(cores, firsts, [axis, -axis], [0, 1].map(|k| arm(&self.sides[k]).cross(axis)));
            add_spring(a, b, &row, h * h * self.stiffness, -h * self.stiffness * stretch);
            let drift = axis.dot(ways[0].1 - ways[1].1);
            let Resistance { stiffness, damping, .. } = self.resistance;
            let pull = h * stiffness * (axis.dot(turned) - drift) - damping * drift;
            add_spring(
                a,
                b,
                &self.row(cores, firsts, [DVec3::ZERO; 2], [axis, axis]),
                h * (h * stiffness + damping),
                pull,
            );
        }
        let limits = [
            (self.resistance.swing, swing as fn(DVec3, DQuat, DQuat) -> f64),
            (self.resistance.twist, |axis, first, second| twist(axis, first, second).abs()),
        ];
        for ((limit, angle), stiffness) in limits.into_iter().zip(self.limit_stiffness) {
            let Some(limit) = limit else { continue };
            let of = |turn: DVec3| angle(self.resistance.axis, first.turn, DQuat::from_scaled_axis(turn) * second.turn);
            let slope = |axis: DVec3| (of(DIFFERENCE * axis) - of(-DIFFERENCE * axis)) / (2.0 * DIFFERENCE);
            let about = DVec3::from(DVec3::AXES.map(slope));
            // By the end of the step, if nothing is done.
            let beyond = of(DVec3::ZERO) - limit + about.dot(ways[1].1 - ways[0].1);
            if beyond > 0.0 {
                let row = self.row(cores, firsts, [DVec3::ZERO; 2], [-about, -about]);
                add_spring(a, b, &row, h * h * stiffness, -h * stiffness * beyond);
            }
        }
    }

    /// Coefficients of the unknowns, as far as hinges let cores follow: `linear` of each side's velocity, `angular` of the
    /// first's spin, less those of the second's.
    fn row(&self, cores: &[Core], firsts: &[usize], linear: [DVec3; 2], angular: [DVec3; 2]) -> Vec<(usize, f64)> {
        let mut row = Vec::new();
        for (k, sign) in [(0, 1.0), (1, -1.0)] {
            let Some(core) = self.sides[k].core else { continue };
            let (follows, turns) = cores[core].freedom();
            let six = (follows * linear[k]).to_array().into_iter().chain((sign * (turns * angular[k])).to_array());
            row.extend(six.enumerate().map(|(i, x)| (firsts[core] + i, x)));
        }
        row
    }

    /// Goes with its sides for `h` seconds; cores are there already.
    pub fn advance(&mut self, cores: &[Core], h: f64) {
        for side in &mut self.sides {
            (side.end, side.turn) = match side.core.map(|core| &cores[core]) {
                Some(core) => {
                    let turn = DQuat::from_scaled_axis(h * core.spin);
                    let arm = side.end - (core.centre - h * core.velocity);
                    (core.centre + turn * arm, (turn * side.turn).normalize())
                }
                None => side.next,
            };
        }
    }
}

fn add_spring(a: &mut Entries, b: &mut [f64], row: &[(usize, f64)], size: f64, impulse: f64) {
    a.add_outer(row, size);
    row.iter().for_each(|(i, x)| b[*i] += impulse * x);
}

/// Angle between the axis as both sides have it.
fn swing(axis: DVec3, first: DQuat, second: DQuat) -> f64 {
    (first * axis).dot(second * axis).clamp(-1.0, 1.0).acos()
}

/// By how much the second has turned about its axis, after the shortest turn that brings the axes together.
fn twist(axis: DVec3, first: DQuat, second: DQuat) -> f64 {
    let across = axis.any_orthonormal_vector();
    let (along, from) = (second * axis, DQuat::from_rotation_arc(first * axis, second * axis) * (first * across));
    let to = second * across;
    along.dot(from.cross(to)).atan2(from.dot(to))
}
