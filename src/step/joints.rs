//! Joints on the host, in f64: how far each is from where it should be, and what that gives to the cores it joins.

use glam::{DMat3, DQuat, DVec3};

use super::frames::{Frames, Place, unwound};
use crate::shaders::{self, NONE};
use crate::stages::joints::Joint;
use crate::step::drive::rotation_vector;

/// 1 + cos of a swing at least, for the twist: with the axis turned nearly back to front (beyond 155 degrees), where it is
/// hardly defined, its spring pulls more softly.
const LEAST_ALONG: f64 = 0.1;

/// Writes the device's joints for a step of `h` seconds.
pub fn write(joints: &[Joint], frames: &Frames, h: f64, out: &mut [shaders::Joint]) {
    for (out, joint) in out.iter_mut().zip(joints) {
        *out = at_start(joint, frames, h);
    }
}

/// Implicit Euler of the springs, f = -k (gap + h gap' at the end): on the first side, at the middle of the two ends.
fn at_start(joint: &Joint, frames: &Frames, h: f64) -> shaders::Joint {
    let places = joint.frames.map(|frame| frames.place(frame));
    let ends = [0, 1].map(|k| frames.world(joint.frames[k], joint.arms[k]));
    let middle = 0.5 * (ends[0] + ends[1]);
    let arms = places.map(|place| middle - place.centre);
    // How far a side would go, and turn, if nothing pushed it.
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

/// What resists turning, towards the orientation at rest, and back to the limits where the second side would be beyond them at
/// the end, if the first goes on to turn by `way` (rad) against it: h^2 K + h D (kg m^2), and the torque on the first side at
/// the start (N m).
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
        // Swing and twist of a rotation, and how the twist answers to a spin (P. Dobrowolski 2015).
        let turn = unwound(first.conjugate() * second);
        let twist = 2.0 * DVec3::new(turn.x, turn.y, turn.z).dot(resistance.axis).atan2(turn.w);
        let about = (axes[0] + axes[1]) / (1.0 + along).max(LEAST_ALONG);
        push_back(twist_stiffness, twist.abs() - limit, twist.signum() * about);
    }
    (operator, torque)
}
