//! Ball joints between cores (rigid bodies to which nodes are attached) on the host, in f64: how far the two ends of
//! each joint are apart, how far its two sides (the cores) are rotated relative to each other, and what its springs add
//! to the solver's equations (rows) of the two cores.

use glam::{DMat3, DQuat, DVec3};

use super::frames::{Frames, Place, unwound};
use crate::shaders::{self, NONE};
use crate::stages::joints::Joint;
use crate::step::trajectory::rotation_vector;

/// Least value of the divisor 1 + cos(swing) in the axis of the spring that limits the twist. The swing is the angle
/// between the joint's axis on the first side and on the second side, the twist the rotation about that axis. Beyond a
/// swing of 155 degrees the twist is hardly defined, and this limit makes the spring softer there.
const LEAST_ALONG: f64 = 0.1;

/// Writes the GPU's joints for a step of `h` seconds.
pub fn write(joints: &[Joint], frames: &Frames, h: f64, out: &mut [shaders::Joint]) {
    for (out, joint) in out.iter_mut().zip(joints) {
        *out = at_start(joint, frames, h);
    }
}

/// A joint's springs by implicit Euler. The force on the first side is -k (gap + h gap'), where k is the stiffness, gap
/// the vector from the joint's end on the second side to its end on the first, and gap' the rate of this vector at the
/// end of the step; the force acts at the middle between the ends.
fn at_start(joint: &Joint, frames: &Frames, h: f64) -> shaders::Joint {
    let places = joint.frames.map(|frame| frames.place(frame));
    let ends = [0, 1].map(|k| frames.world(joint.frames[k], joint.arms[k]));
    let middle = 0.5 * (ends[0] + ends[1]);
    let arms = places.map(|place| middle - place.centre);
    // Displacement of the joint's end on side k over the step (m), and rotation vector of that side (rad), if nothing
    // pushed the side.
    let way = |k: usize| match (frames.twist(joint.frames[k]), frames.end(joint.frames[k])) {
        (Some((velocity, spin)), _) => (h * (velocity + spin.cross(arms[k])), h * spin),
        (None, Place { centre, rotation }) => {
            let turned = unwound(rotation * places[k].rotation.conjugate());
            (centre + rotation * joint.arms[k] - ends[k], rotation_vector(turned))
        }
    };
    let ways = [way(0), way(1)];
    let gap = ends[0] - ends[1] + ways[0].0 - ways[1].0;
    let spin = (ways[0].1 - ways[1].1) / h;
    let (operator, torque) = turning(joint, places.map(|place| place.rotation), h * spin, h);
    let twist = h * torque - operator * spin;
    let [x, y, z] = [operator.x_axis, operator.y_axis, operator.z_axis];
    shaders::Joint {
        rigid: joint.cores.map(|core| core.map_or(NONE, |core| core as u32)),
        arm: arms.map(|arm| arm.as_vec3().to_array()),
        linear: (h * h * joint.stiffness) as f32,
        angular: [x.x, y.y, z.z, x.y, x.z, y.z].map(|x| x as f32),
        impulse: (-h * joint.stiffness * gap).as_vec3().to_array(),
        twist: twist.as_vec3().to_array(),
    }
}

/// The rotational part of a joint: a spring and damper towards the orientation at rest, and springs that push the
/// second side back within its limits of swing and twist, where without a push it would be beyond them at the end of
/// the step. `way` is the rotation vector (rad) by which the first side will turn relative to the second in the step if
/// nothing pushes them. Returns h^2 K + h D (kg m^2), with K the rotational stiffness and D the damping, and the torque
/// on the first side at the step's start (N m).
fn turning(joint: &Joint, [first, second]: [DQuat; 2], way: DVec3, h: f64) -> (DMat3, DVec3) {
    let resistance = &joint.resistance;
    let away = rotation_vector(unwound(second * first.conjugate()));
    let mut operator = DMat3::from_diagonal(DVec3::splat(h * (h * resistance.stiffness + resistance.damping)));
    let mut torque = resistance.stiffness * away;
    let mut push_back = |stiffness: f64, beyond: f64, about: DVec3| {
        if beyond > about.dot(way) {
            torque += stiffness * beyond * about;
            operator += h * h * stiffness * DMat3::from_cols(about * about.x, about * about.y, about * about.z);
        }
    };
    let [swing_stiffness, twist_stiffness] = joint.limit_stiffness;
    let axes = [first * resistance.axis, second * resistance.axis];
    let (across, along) = (axes[0].cross(axes[1]), axes[0].dot(axes[1]));
    if let Some(limit) = resistance.swing {
        push_back(swing_stiffness, across.length().atan2(along) - limit, across.normalize_or_zero());
    }
    if let Some(limit) = resistance.twist {
        // The twist is found by the decomposition of the rotation into swing and twist (P. Dobrowolski 2015); `about`
        // is the axis about which rotation increases the twist.
        let turn = unwound(first.conjugate() * second);
        let twist = 2.0 * DVec3::new(turn.x, turn.y, turn.z).dot(resistance.axis).atan2(turn.w);
        let about = (axes[0] + axes[1]) / (1.0 + along).max(LEAST_ALONG);
        push_back(twist_stiffness, twist.abs() - limit, twist.signum() * about);
    }
    (operator, torque)
}
