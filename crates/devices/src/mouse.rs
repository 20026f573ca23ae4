//! A mouse as a haptic device of six degrees of freedom: the window's thread moves a goal pose with the mouse, and the
//! simulated device follows the goal smoothly and no faster than a hand. The user feels no force, but sees the force as
//! the distance by which the tool, the rigid body that the device leads, lags behind the goal.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use glam::{DQuat, DVec3};
use palpate::internal::haptics::{Device, Fault, Reading};
use palpate::internal::step::trajectory::rotation_vector;
use palpate::scene::Profile;
use palpate::scene::profile::MOUSE;
use palpate::{RigidState, Wrench};

/// Natural frequency of the critically damped motion towards the goal, 1/s: a jump of the goal by one pixel is spread
/// over about fifty ticks (iterations of the haptic loop).
const FOLLOWS: f64 = 40.0;
/// Greatest speed of the device, m/s.
const FASTEST: f64 = 1.0;
/// Greatest angular speed of the device, rad/s.
const FASTEST_TURN: f64 = 10.0;
/// Longest time that is integrated at once, s; a longer time is divided into equal parts.
const TICK: f64 = 1e-3;
/// Longest time that one reading integrates over, s, so that a reading needs bounded computing time whatever the clock
/// does.
pub(crate) const CATCH_UP: f64 = 0.25;
/// Number of attempts of a reading to copy the goal while another thread changes the goal; if all of them fail, the
/// reading uses the goal that was copied last.
const LOOKS: u32 = 4;

/// The pose that the device follows. One thread sets it with the mouse; the device, on another thread, reads it without
/// ever waiting (a sequence lock).
#[derive(Debug, Clone, Default)]
pub struct Goal(Arc<Shared>);

#[derive(Debug, Default)]
struct Shared {
    /// Version of `numbers`; odd while the numbers change.
    version: AtomicU64,
    /// Position and orientation (x y z w), each as the bits of an f64.
    numbers: [AtomicU64; 7],
    is_pressed: AtomicBool,
    /// The goal for the threads that set it; [`Mouse`] never takes this lock.
    own: Mutex<Pose>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Pose {
    position: DVec3,
    orientation: DQuat,
}

impl Goal {
    /// A goal at a pose, with the button of the device released.
    pub fn new(position: DVec3, orientation: DQuat) -> Goal {
        let goal = Goal::default();
        goal.place(position, orientation);
        goal
    }

    /// Sets the goal to a pose.
    pub fn place(&self, position: DVec3, orientation: DQuat) {
        self.set(|_| Pose { position, orientation });
    }

    /// Moves the goal by a displacement, m.
    pub fn shift(&self, by: DVec3) {
        self.set(|pose| Pose { position: pose.position + by, ..pose });
    }

    /// Rotates the goal about its own position by the rotation vector `by`: its direction is a world axis, its length
    /// the angle, rad.
    pub fn turn(&self, by: DVec3) {
        self.set(|pose| Pose { orientation: (DQuat::from_scaled_axis(by) * pose.orientation).normalize(), ..pose });
    }

    /// Sets whether the device's button is pressed.
    pub fn press(&self, is_pressed: bool) {
        self.0.is_pressed.store(is_pressed, Ordering::Relaxed);
    }

    /// Position (m) and orientation of the goal.
    pub fn pose(&self) -> (DVec3, DQuat) {
        let pose = *self.0.own.lock().unwrap_or_else(PoisonError::into_inner);
        (pose.position, pose.orientation)
    }

    fn set(&self, change: impl FnOnce(Pose) -> Pose) {
        let mut own = self.0.own.lock().unwrap_or_else(PoisonError::into_inner);
        let pose = change(*own);
        // A pose that is not finite is ignored.
        if !pose.position.is_finite() || !pose.orientation.is_finite() {
            return;
        }
        *own = pose;
        let version = self.0.version.load(Ordering::SeqCst);
        self.0.version.store(version + 1, Ordering::SeqCst);
        let numbers = pose.position.to_array().into_iter().chain(pose.orientation.to_array());
        self.0.numbers.iter().zip(numbers).for_each(|(cell, x)| cell.store(x.to_bits(), Ordering::SeqCst));
        self.0.version.store(version + 2, Ordering::SeqCst);
    }

    /// Copies the goal's pose; `None` if another thread was changing it during all attempts.
    fn look(&self) -> Option<(DVec3, DQuat)> {
        for _ in 0..LOOKS {
            let version = self.0.version.load(Ordering::SeqCst);
            let x = self.0.numbers.each_ref().map(|cell| f64::from_bits(cell.load(Ordering::SeqCst)));
            if version.is_multiple_of(2) && self.0.version.load(Ordering::SeqCst) == version {
                return Some((DVec3::new(x[0], x[1], x[2]), DQuat::from_xyzw(x[3], x[4], x[5], x[6])));
            }
        }
        None
    }
}

/// The device that follows a [`Goal`]; each reading advances it to the time of the reading.
#[derive(Debug, Clone)]
pub struct Mouse {
    goal: Goal,
    last: (DVec3, DQuat),
    state: RigidState,
    time: f64,
}

impl Mouse {
    /// A device at rest at the goal.
    pub fn new(goal: Goal) -> Mouse {
        let (position, orientation) = goal.pose();
        Mouse { goal, last: (position, orientation), state: RigidState::at_rest(position, orientation), time: 0.0 }
    }

    /// Moves the device towards the goal for `h` s.
    fn advance(&mut self, h: f64) {
        let state = &mut self.state;
        let away = self.last.0 - state.position;
        let (moved, velocity) = follow(away, state.velocity, FASTEST, h);
        (state.position, state.velocity) = (state.position + moved, velocity);
        let away = rotation_vector(self.last.1 * state.orientation.conjugate());
        let (turned, velocity) = follow(away, state.angular_velocity, FASTEST_TURN, h);
        state.orientation = (DQuat::from_scaled_axis(turned) * state.orientation).normalize();
        state.angular_velocity = velocity;
    }
}

/// Displacement and velocity of a point x after `h` s, exact for x'' = w^2 (goal - x) - 2 w x' with w = `FOLLOWS`;
/// `away` is goal - x at the start. `away` is shortened to at most 2 `fastest` / w, the distance at which a goal is
/// followed at the speed `fastest`, so that the speed never exceeds `fastest`.
fn follow(away: DVec3, velocity: DVec3, fastest: f64, h: f64) -> (DVec3, DVec3) {
    let away = away.clamp_length_max(2.0 * fastest / FOLLOWS);
    let c = velocity - FOLLOWS * away;
    let shrinks = (-FOLLOWS * h).exp();
    let left = (c * h - away) * shrinks;
    (left + away, (velocity - FOLLOWS * h * c) * shrinks)
}

impl Device for Mouse {
    fn open(&mut self) -> Result<(), Fault> {
        *self = Mouse::new(self.goal.clone());
        Ok(())
    }

    fn profile(&self) -> &Profile {
        &MOUSE
    }

    fn read(&mut self, time: f64) -> Result<Reading, Fault> {
        self.last = self.goal.look().unwrap_or(self.last);
        // A time that runs backwards or is NaN leaves the device where it is.
        let span = (time - self.time).clamp(0.0, CATCH_UP);
        if span > 0.0 {
            let parts = (span / TICK).ceil();
            (0..parts as u32).for_each(|_| self.advance(span / parts));
        }
        self.time = if time.is_finite() { time } else { self.time };
        let buttons = u32::from(self.goal.0.is_pressed.load(Ordering::Relaxed));
        Ok(Reading { time: self.time, state: self.state, buttons })
    }

    fn write(&mut self, _: &Wrench) -> Result<(), Fault> {
        Ok(())
    }

    fn close(&mut self) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    fn readings(device: &mut Mouse, from: f64, seconds: f64, tick: f64) -> Vec<RigidState> {
        let count = (seconds / tick).round() as u32;
        (1..=count).map(|k| device.read(from + f64::from(k) * tick).unwrap().state).collect()
    }

    fn start() -> (Goal, Mouse) {
        let goal = Goal::new(DVec3::new(0.1, 0.2, -0.3), DQuat::from_rotation_x(0.4));
        let mut device = Mouse::new(goal.clone());
        device.open().unwrap();
        device.read(0.0).unwrap();
        (goal, device)
    }

    #[test]
    fn a_goal_is_reached_without_going_beyond() {
        let (goal, mut device) = start();
        let (from, turned) = goal.pose();
        goal.shift(DVec3::new(0.02, 0.0, 0.0));
        goal.turn(DVec3::new(0.0, 0.1, 0.0));
        let states = readings(&mut device, 0.0, 0.5, 1e-3);
        assert!(states.windows(2).all(|pair| pair[1].position.x >= pair[0].position.x));
        assert!(states.iter().all(|s| s.position.x <= from.x + 0.02 && s.position.y == from.y));
        let last = states[states.len() - 1];
        assert!(last.position.distance(from + 0.02 * DVec3::X) < 1e-8 && last.velocity.length() < 1e-6);
        let wanted = DQuat::from_rotation_y(0.1) * turned;
        assert!(rotation_vector(wanted * last.orientation.conjugate()).length() < 1e-8);
        // After one time constant, 1 / `FOLLOWS`, the share 1 - 2 / e of the way is done, whatever the tick.
        let (goal, mut device) = start();
        goal.shift(DVec3::X * 0.02);
        let done = (device.read(1.0 / FOLLOWS).unwrap().state.position.x - from.x) / 0.02;
        assert!((done - (1.0 - 2.0 / std::f64::consts::E)).abs() < 1e-9, "share of the way done: {done}");
    }

    #[test]
    fn however_far_the_goal_leaps_the_speed_is_bounded_and_nothing_leaps() {
        for tick in [2.5e-4, 1e-3, 7e-3] {
            let (goal, mut device) = start();
            let mut before = device.read(0.0).unwrap().state;
            let (mut fastest, mut fastest_turn) = (0.0_f64, 0.0_f64);
            for leap in 0..8 {
                let sign = if leap % 3 == 0 { -1.0 } else { 1.0 };
                goal.shift(sign * DVec3::new(3.0, -1.0, 0.5));
                goal.turn(sign * DVec3::new(0.3, 2.0, 0.1));
                for state in readings(&mut device, f64::from(leap) * 0.35, 0.35, tick) {
                    let moved = state.position.distance(before.position);
                    let turn = rotation_vector(state.orientation * before.orientation.conjugate()).length();
                    assert!(moved <= FASTEST * tick * (1.0 + 1e-9), "moved {moved} m in {tick} s");
                    assert!(turn <= FASTEST_TURN * tick * (1.0 + 1e-6), "turned {turn} rad in {tick} s");
                    fastest = fastest.max(state.velocity.length());
                    fastest_turn = fastest_turn.max(state.angular_velocity.length());
                    before = state;
                }
            }
            assert!(fastest <= FASTEST && fastest > 0.9 * FASTEST, "greatest speed {fastest} m/s");
            assert!(
                fastest_turn <= FASTEST_TURN && fastest_turn > 0.9 * FASTEST_TURN,
                "greatest angular speed {fastest_turn} rad/s"
            );
        }
    }

    #[test]
    fn the_velocity_is_the_derivative_of_the_pose() {
        let (goal, mut device) = start();
        goal.shift(DVec3::new(0.03, 0.4, 0.0));
        goal.turn(DVec3::new(0.2, 0.1, 0.0));
        let tick = 1e-4;
        let states = readings(&mut device, 0.0, 0.8, tick);
        for three in states.windows(3) {
            let slope = (three[2].position - three[0].position) / (2.0 * tick);
            assert!(
                (slope - three[1].velocity).length() < 2e-3,
                "slope of the position {slope} m/s, velocity {} m/s",
                three[1].velocity
            );
            let turn = rotation_vector(three[2].orientation * three[0].orientation.conjugate()) / (2.0 * tick);
            assert!(
                (turn - three[1].angular_velocity).length() < 2e-2,
                "the angular velocity is not the slope of the rotation, {turn} rad/s"
            );
        }
    }

    #[test]
    fn steps_of_a_pixel_do_not_buzz() {
        let (goal, mut device) = start();
        let (pixel, mut time) = (2e-4, 0.0);
        let mut states = Vec::new();
        // Sixty mouse events a second, each of one pixel (0.2 mm), move the goal at 12 mm/s.
        for _ in 0..120 {
            goal.shift(DVec3::X * pixel);
            states.extend(readings(&mut device, time, 0.0167, 1e-3 * 1.04375));
            time += 0.0167;
        }
        let settled = &states[states.len() / 2..];
        let speeds: Vec<f64> = settled.iter().map(|state| state.velocity.x).collect();
        let mean = speeds.iter().sum::<f64>() / speeds.len() as f64;
        assert!((mean - pixel / 0.0167).abs() < 0.02 * mean, "mean speed {mean} m/s");
        assert!(speeds.iter().all(|speed| (speed - mean).abs() < 0.35 * mean), "speeds must stay near the mean");
    }

    #[test]
    fn without_a_goal_that_moves_it_stays_for_good() {
        let (_, mut device) = start();
        let first = device.read(0.0).unwrap();
        for time in [0.001, 5.0, 4.0, f64::NAN, 1e9] {
            let reading = device.read(time).unwrap();
            assert_eq!((reading.state, reading.buttons), (first.state, 0));
            assert!(reading.time.is_finite());
        }
        device.write(&Wrench { force: DVec3::ONE, torque: DVec3::ONE }).unwrap();
        device.close();
    }

    #[test]
    fn a_reading_never_waits_and_never_sees_half_a_pose() {
        let goal = Goal::new(DVec3::ZERO, DQuat::IDENTITY);
        let stop = AtomicBool::new(false);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let mut k = 0.0;
                while !stop.load(Ordering::Relaxed) {
                    k += 1.0;
                    goal.place(DVec3::new(k, 2.0 * k, 3.0 * k), DQuat::from_xyzw(0.0, 0.0, 0.0, 1.0));
                }
            });
            let mut seen = 0;
            while seen < 2000 {
                if let Some((p, _)) = goal.look() {
                    assert_eq!([2.0 * p.x, 3.0 * p.x], [p.y, p.z]);
                    seen += 1;
                }
            }
            stop.store(true, Ordering::Relaxed);
        });
        goal.place(DVec3::NAN, DQuat::IDENTITY);
        assert!(goal.pose().0.is_finite());
        goal.press(true);
        let mut device = Mouse::new(goal);
        assert_eq!(device.read(0.0).unwrap().buttons, 1);
        assert_eq!(device.profile(), Profile::named("mouse").unwrap());
    }
}
