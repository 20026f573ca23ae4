//! Ball joints between two dynamic cores (rigid cores inside soft bodies, whose motion the solver finds), or between a
//! dynamic core and a body of prescribed motion, as implicit springs. A side is one of the two bodies that a joint
//! connects; an end is the point of a side that the joint holds. Swing is the angle between the joint's axis as rotated
//! with one and with the other side; twist is the rotation of the second side about this axis.

use glam::{DQuat, DVec3};
use palpate::scene::Resistance;

use crate::body::Core;
use crate::linear::Entries;

/// Step of the central differences for derivatives of angles, rad.
const DIFFERENCE: f64 = 1e-5;

/// One of the two sides of a joint, in its present state.
#[derive(Debug, Clone, Copy)]
pub struct Side {
    /// Index of the dynamic core on this side; `None`: the motion of this side is prescribed.
    pub core: Option<usize>,
    /// Position of the joint's end on this side, world, m.
    pub end: DVec3,
    /// Rotation of this side since rest, world.
    pub turn: DQuat,
    /// `end` and `turn` after the next step, where the motion is prescribed; the caller sets them.
    pub next: (DVec3, DQuat),
}

/// A ball joint.
#[derive(Debug, Clone)]
pub struct Joint {
    /// The two sides; angles are those of the second side relative to the first.
    pub sides: [Side; 2],
    /// Stiffness of the spring between the two ends, N/m.
    pub stiffness: f64,
    /// Stiffness of the springs beyond the limits of swing and of twist, N m/rad.
    pub limit_stiffness: [f64; 2],
    /// Springs, damping and limits of the joint's rotation; its axis is given in world axes at rest.
    pub resistance: Resistance,
}

impl Joint {
    /// Adds the joint's springs to the system of a step of `h` seconds. A spring of stiffness k adds h^2 k to the
    /// matrix A, and to the right-hand side b it adds -h k times the stretch that it would have at the end of the step
    /// if no velocity changed.
    pub fn add_terms(&self, cores: &[Core], firsts: &[usize], a: &mut Entries, b: &mut [f64], h: f64) {
        let [first, second] = &self.sides;
        let middle = 0.5 * (first.end + second.end);
        let arm = |side: &Side| side.core.map_or(DVec3::ZERO, |core| middle - cores[core].centre);
        // How far each end moves and turns over the step if no velocity changes.
        let way = |side: &Side| match side.core {
            Some(core) => (h * (cores[core].velocity + cores[core].spin.cross(arm(side))), h * cores[core].spin),
            None => (side.next.0 - side.end, (side.next.1 * side.turn.inverse()).to_scaled_axis()),
        };
        let (ways, apart) = ([way(first), way(second)], first.end - second.end);
        let turned = (second.turn * first.turn.inverse()).to_scaled_axis();
        for axis in DVec3::AXES {
            // First the spring between the two ends along this axis, then the spring and damper of rotation about this
            // axis.
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
            // The angle by which swing or twist would exceed its limit at the end of the step if no velocity changed.
            let beyond = of(DVec3::ZERO) - limit + about.dot(ways[1].1 - ways[0].1);
            if beyond > 0.0 {
                let row = self.row(cores, firsts, [DVec3::ZERO; 2], [-about, -about]);
                add_spring(a, b, &row, h * h * stiffness, -h * stiffness * beyond);
            }
        }
    }

    /// A row of the Jacobian, projected onto the motions that hinges allow: the coefficients of the unknowns in a sum
    /// of scalar products, `linear[k]` with the velocity of side k for both sides, plus `angular[0]` with the angular
    /// velocity of the first side, minus `angular[1]` with the angular velocity of the second side.
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

    /// Advances the ends and rotations of the joint's sides by `h` seconds; the cores must have been advanced before.
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

/// Swing, rad: the angle between the joint's axis as rotated with the first and with the second side.
fn swing(axis: DVec3, first: DQuat, second: DQuat) -> f64 {
    (first * axis).dot(second * axis).clamp(-1.0, 1.0).acos()
}

/// Twist, rad: the angle by which the second side is rotated about the joint's axis relative to the first side, after
/// the smallest rotation that aligns both sides' axes.
fn twist(axis: DVec3, first: DQuat, second: DQuat) -> f64 {
    let across = axis.any_orthonormal_vector();
    let (along, from) = (second * axis, DQuat::from_rotation_arc(first * axis, second * axis) * (first * across));
    let to = second * across;
    along.dot(from.cross(to)).atan2(from.dot(to))
}
