//! Time-domain passivity: an observer of the energy that the hand receives, and a controller that takes away what would
//! make it more than the hand gave (B. Hannaford and J.-H. Ryu, "Time-domain passivity control of haptic interfaces",
//! 2002).
//!
//! The force is held from one tick to the next, so F . dx between two readings is the energy exactly, up to the
//! encoder's quantum. Each axis is observed by itself; the controller looks at what a device plays as one port, for energy
//! that enters along one axis may rightly leave along another (press down, slide off sideways).

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::device::{RigidState, Wrench};
use super::drive::rotation_vector;

/// A hand that starts to move by itself or is pushed is no quicker, m/s^2: 8 N on 0.2 kg.
const QUICKEST: f64 = 40.0;
/// Nor does it turn more quickly, rad/s^2: 0.2 N m on 5e-4 kg m^2.
const QUICKEST_TURN: f64 = 400.0;

/// What may be given unpaid, J. Without it a slow hand could not begin: nothing would be played before it had given, and it
/// gives nothing to what pushes back with nothing. Once it is used up, damping earns it again.
const ALLOWANCE: f64 = 1e-6;

/// Energy over a run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Energy {
    /// That the hand gave, J, an axis each: x, y, z, then about them.
    pub taken: [f64; 6],
    /// That the hand received, J, an axis each.
    pub given: [f64; 6],
    /// That the controller took from what was to be played, J.
    pub damped: f64,
}

impl Energy {
    /// That the hand received more than it gave, J, of all axes.
    pub fn net(&self) -> f64 {
        self.given.iter().sum::<f64>() - self.taken.iter().sum::<f64>()
    }
}

/// Observer and controller.
#[derive(Debug, Clone)]
pub struct Passivity {
    /// Whether the controller acts.
    is_on: bool,
    /// Greatest damping that it may inject beyond taking the force away, N s/m.
    most_damping: f64,
    energy: Energy,
    /// What the hand gave and has not received back, J; below zero: it received more.
    budget: f64,
    last: Option<RigidState>,
    played: Wrench,
}

/// What the controller did in a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Control {
    /// What may be played.
    pub wrench: Wrench,
    /// Damping that it took, N s/m (of the force alone).
    pub damping: f64,
    /// Whether it wanted more than the bound.
    pub is_limited: bool,
}

impl Passivity {
    /// An observer; with a controller where `is_on`, of such damping at most, N s/m.
    pub fn new(is_on: bool, most_damping: f64) -> Passivity {
        let energy = Energy::default();
        Passivity { is_on, most_damping, energy, budget: 0.0, last: None, played: Wrench::ZERO }
    }

    /// Takes a reading: the force played since the last one did its work.
    pub fn observe(&mut self, device: &RigidState) {
        if let Some(last) = self.last {
            let moved = device.position - last.position;
            let turned = rotation_vector(device.orientation * last.orientation.conjugate());
            let work = [self.played.force * moved, self.played.torque * turned];
            for (k, work) in work.iter().flat_map(|work| work.to_array()).enumerate() {
                self.energy.given[k] += work.max(0.0);
                self.energy.taken[k] += (-work).max(0.0);
                self.budget -= work;
            }
        }
        self.last = Some(*device);
    }

    /// Without contact nothing but what the coupling and the tool's motion store may be given back; `stored`: J.
    pub fn forget(&mut self, stored: f64) {
        self.budget = self.budget.min(stored);
    }

    /// A force that comes back, in a place where the hand sank in while there was none, may push it out again, as far as what
    /// it stores: `risen` (J) more, up to `stored` (J) in all.
    pub fn lend(&mut self, risen: f64, stored: f64) {
        if self.budget < stored {
            self.budget = (self.budget + risen).min(stored);
        }
    }

    /// Shortens a wrench to what the budget holds over the `period` (s) to come, for the way that the hand goes and as much
    /// more as it may go unforeseen; where the budget is overdrawn, damps, as far as the force is played at all (`gain`, 0 to 1).
    pub fn control(&mut self, wanted: Wrench, device: &RigidState, period: f64, gain: f64) -> Control {
        let none = Control { wrench: wanted, damping: 0.0, is_limited: false };
        if !self.is_on {
            return none;
        }
        let Wrench { force, torque } = wanted;
        let (v, w) = (device.velocity, device.angular_velocity);
        let power = force.dot(v) + torque.dot(w);
        let unforeseen = period * period * (force.length() * QUICKEST + torque.length() * QUICKEST_TURN);
        let asked = power * period + unforeseen;
        let left = self.budget + ALLOWANCE;
        let share = if asked > left.max(0.0) { (left / asked).max(0.0) } else { 1.0 };
        let owed = if v == DVec3::ZERO { 0.0 } else { (-self.budget).max(0.0) / (period * v.length_squared()) };
        let damping = owed.min(gain * self.most_damping);
        if share == 1.0 && damping == 0.0 {
            return none;
        }
        let wrench = Wrench { force: share * force - damping * v, torque: share * torque };
        let gone = power - wrench.force.dot(v) - wrench.torque.dot(w);
        self.energy.damped += gone * period;
        let total = if v == DVec3::ZERO { 0.0 } else { gone / v.length_squared() };
        Control { wrench, damping: total, is_limited: owed > damping }
    }

    /// What is played until the next reading.
    pub fn play(&mut self, wrench: Wrench) {
        self.played = wrench;
    }

    /// The device is elsewhere all at once: what moved it is no work.
    pub fn jump(&mut self) {
        self.last = None;
        self.budget = self.budget.min(0.0);
    }

    /// Energies so far.
    pub fn energy(&self) -> Energy {
        self.energy
    }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;

    fn at(x: f64, v: f64) -> RigidState {
        RigidState { velocity: DVec3::X * v, ..RigidState::at_rest(DVec3::X * x, DQuat::IDENTITY) }
    }

    /// Presses a spring of `k` (N/m, one-sided, felt a tick late) by `depth` and leaves it, `ticks` each way; the energy given.
    fn press(passivity: &mut Passivity, k: f64, depth: f64, ticks: i32) -> f64 {
        let (period, mut late) = (1e-3, 0.0);
        let step = depth / f64::from(ticks);
        for tick in 0..=2 * ticks + 20 {
            let x = f64::from(tick.min(2 * ticks + 20 - tick).min(ticks) - 10) * step;
            let way = if tick < ticks { 1.0 } else { -1.0 };
            let device = at(x, way * step / period);
            passivity.observe(&device);
            let force = Wrench { force: DVec3::X * late, ..Wrench::ZERO };
            late = -k * x.max(0.0);
            let control = passivity.control(force, &device, period, 1.0);
            passivity.play(control.wrench);
        }
        passivity.energy().net()
    }

    #[test]
    fn a_late_spring_gives_energy_and_the_controller_takes_it() {
        let mut without = Passivity::new(false, 10.0);
        let free = press(&mut without, 1000.0, 0.01, 100);
        // By hand: each tick the force is 1.5 ticks old on average: 2 x 1.5 x k depth step.
        assert!(free > 1e-3, "{free}");
        assert_eq!(without.energy().damped, 0.0);
        let mut with = Passivity::new(true, 10.0);
        let held = press(&mut with, 1000.0, 0.01, 100);
        assert!(held < 1e-9, "{held}");
        assert!(with.energy().damped > 0.9 * free, "{:?}", with.energy());
    }

    #[test]
    fn what_a_prompt_spring_gives_back_is_left_alone() {
        let mut passivity = Passivity::new(true, 10.0);
        for k in (0..100).chain((0..100).rev()) {
            let way = if k < 99 { 1.0 } else { -1.0 };
            let device = at(1e-4 * f64::from(k), 0.0);
            passivity.observe(&device);
            let force = Wrench { force: DVec3::X * -0.1 * f64::from(k), ..Wrench::ZERO };
            let control = passivity.control(force, &at(0.0, 0.05 * way), 1e-3, 1.0);
            passivity.play(control.wrench);
        }
        // Held forces give back k h v^2 T less a little; the controller may take no more than that.
        assert!(passivity.energy().damped < 1e-3 * 0.05 * 0.1 * 200.0, "{:?}", passivity.energy());
    }

    #[test]
    fn energy_that_enters_along_one_axis_may_leave_along_another() {
        let mut passivity = Passivity::new(true, 10.0);
        passivity.observe(&at(0.0, 0.0));
        passivity.play(Wrench { force: DVec3::X * -2.0, ..Wrench::ZERO });
        passivity.observe(&at(0.01, 0.0));
        let sideways = RigidState { velocity: DVec3::Y * 0.1, ..at(0.01, 0.0) };
        let push = Wrench { force: DVec3::Y, ..Wrench::ZERO };
        assert_eq!(passivity.control(push, &sideways, 1e-3, 1.0).wrench, push);
        passivity.forget(0.0);
        // The allowance alone is left: 1e-6 J of the 1.4e-4 J that the push may give in a tick.
        assert!(passivity.control(push, &sideways, 1e-3, 1.0).wrench.force.length() < 0.01);
    }

    #[test]
    fn a_force_that_comes_and_goes_lends_no_more_than_it_stores() {
        let mut passivity = Passivity::new(true, 5.0);
        (0..1000).for_each(|_| passivity.lend(0.005 * 0.01, 0.01));
        assert!((passivity.budget - 0.01).abs() < 1e-12);
        passivity.budget = 0.02;
        passivity.lend(0.01, 0.01);
        assert_eq!(passivity.budget, 0.02);
    }

    #[test]
    fn a_slow_hand_is_let_to_begin() {
        for speed in [1e-4, 1e-3, 0.01, 0.1] {
            let mut passivity = Passivity::new(true, 5.0);
            let (mut played, mut wanted) = (0.0, 0.0);
            for tick in 0..(0.005 / (speed * 1e-3)) as u64 {
                let device = at(-speed * 1e-3 * tick as f64, -speed);
                passivity.observe(&device);
                wanted = -500.0 * device.position.x;
                let control =
                    passivity.control(Wrench { force: DVec3::X * wanted, ..Wrench::ZERO }, &device, 1e-3, 1.0);
                played = control.wrench.force.x;
                passivity.play(control.wrench);
            }
            assert!(wanted > 2.0 && (played - wanted).abs() < 0.01 * wanted, "{speed} m/s: {played} of {wanted} N");
        }
    }
}
