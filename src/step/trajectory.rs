//! Reference trajectory: a pose over time, given by keys (a time with a pose). Between keys, positions are interpolated
//! linearly and orientations by slerp; before the first and after the last key the pose is constant. Where a scene
//! gives such keys, a simulated haptic device follows a trajectory, and so do driven cores (rigid bodies inside a soft
//! one whose motion is prescribed).

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

use crate::scene::Key;
use crate::step::RigidState;

/// A pose over time.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Trajectory {
    keys: Vec<Key>,
}

impl Trajectory {
    /// A trajectory through keys; without keys it rests at `start`.
    pub fn new(keys: &[Key], start: Key) -> Trajectory {
        Trajectory { keys: if keys.is_empty() { vec![start] } else { keys.to_vec() } }
    }

    /// Whether the trajectory has a key, and so a pose at any time.
    pub fn is_whole(&self) -> bool {
        !self.keys.is_empty()
    }

    /// Replaces the trajectory by one that goes at constant speed from the present trajectory's pose at `time` to the
    /// key `next`, and then rests there.
    pub fn lead(&mut self, time: f64, next: Key) {
        let (position, orientation) = self.pose(time);
        self.keys.clear();
        self.keys.extend([Key { time, position, orientation }, next]);
    }

    /// The pose at time `time`, s.
    pub fn pose(&self, time: f64) -> (DVec3, DQuat) {
        let next = self.keys.partition_point(|key| key.time <= time);
        let after = self.keys[next.min(self.keys.len() - 1)];
        let before = self.keys[next.saturating_sub(1)];
        let span = after.time - before.time;
        let s = if span > 0.0 { ((time - before.time) / span).clamp(0.0, 1.0) } else { 0.0 };
        let near = if before.orientation.dot(after.orientation) < 0.0 { -after.orientation } else { after.orientation };
        (before.position.lerp(after.position, s), before.orientation.slerp(near, s).normalize())
    }

    /// The state of a haptic device that follows the trajectory: its pose at `time`, and its mean linear and angular
    /// velocity over the `h` seconds before that time.
    pub fn device(&self, time: f64, h: f64) -> RigidState {
        let (position, orientation) = self.pose(time);
        let (last, turned) = self.pose(time - h);
        RigidState {
            position,
            orientation,
            velocity: (position - last) / h,
            angular_velocity: rotation_vector(orientation * turned.conjugate()) / h,
        }
    }
}

/// Rotation vector of a unit quaternion, the shorter way round, rad; accurate for small angles.
pub fn rotation_vector(q: DQuat) -> DVec3 {
    let q = if q.w < 0.0 { -q } else { q };
    let sine = q.xyz().length();
    let scale = if sine > 1.0e-12 { 2.0 * sine.atan2(q.w) / sine } else { 2.0 };
    q.xyz() * scale
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(time: f64, x: f64, angle: f64) -> Key {
        Key { time, position: DVec3::X * x, orientation: DQuat::from_rotation_y(angle) }
    }

    #[test]
    fn poses_between_keys_are_blended_and_the_ends_are_held() {
        let trajectory = Trajectory::new(&[key(1.0, 0.0, 0.0), key(3.0, 4.0, 1.0)], key(0.0, 9.0, 0.0));
        assert_eq!(trajectory.pose(0.0).0, DVec3::ZERO);
        assert!((trajectory.pose(2.0).0 - DVec3::X * 2.0).length() < 1e-15);
        assert!(trajectory.pose(2.0).1.dot(DQuat::from_rotation_y(0.5)).abs() > 1.0 - 1e-12);
        assert_eq!(trajectory.pose(7.0).0, DVec3::X * 4.0);
        let device = trajectory.device(2.0, 0.001);
        assert!((device.velocity - DVec3::X * 2.0).length() < 1e-9);
        assert!((device.angular_velocity - DVec3::Y * 0.5).length() < 1e-6);
    }

    #[test]
    fn a_device_that_is_led_is_where_it_was_told_to_be_and_moved_evenly() {
        let mut trajectory = Trajectory::new(&[], key(0.0, 1.0, 0.0));
        trajectory.lead(0.5, key(1.0, 2.0, 0.3));
        assert_eq!((trajectory.pose(0.0).0, trajectory.pose(1.0).0), (DVec3::X, 2.0 * DVec3::X));
        assert!((trajectory.device(1.0, 0.5).velocity - 2.0 * DVec3::X).length() < 1e-12);
        trajectory.lead(1.0, key(1.5, 4.0, 0.3));
        assert_eq!((trajectory.pose(1.25).0, trajectory.pose(9.0).0), (3.0 * DVec3::X, 4.0 * DVec3::X));
    }

    #[test]
    fn keys_of_opposite_sign_turn_the_shorter_way() {
        let mut far = key(1.0, 0.0, 0.2);
        far.orientation = -far.orientation;
        let trajectory = Trajectory::new(&[key(0.0, 0.0, 0.0), far], key(0.0, 0.0, 0.0));
        let turned = rotation_vector(trajectory.pose(0.5).1);
        assert!((turned - DVec3::Y * 0.1).length() < 1e-9, "rotation vector {turned} rad, expected 0.1 rad about y");
    }
}
