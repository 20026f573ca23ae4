//! The energy that the hand gave and received, and how what it receives is kept from being more than what it gave and was
//! lent (time-domain passivity: B. Hannaford and J.-H. Ryu, "Time-domain passivity control of haptic interfaces", 2002).
//!
//! The force is held from one tick to the next, so F_k . (x_k+1 - x_k) between two raw readings is the energy exactly, up to
//! the encoder's quantum. Each axis is observed by itself, but the budget is that of the whole port, for energy that enters
//! along one axis may rightly leave along another (press down, slide off sideways).
//!
//! The budget pays for two things. Whoever would add energy to the contact model asks [`Passivity::surplus`] first (the servo's
//! blending, as an energy tank does: F. Ferraguti, C. Secchi and C. Fantuzzi, "A tank-based approach to impedance control
//! with variable stiffness", 2013). And what the device plays is damped where it would overdraw the budget all the same; a
//! force that does no work, or takes work from the hand, is played in full.

use serde::{Deserialize, Serialize};

use crate::step::drive::rotation_vector;
use crate::step::{RigidState, Wrench};

/// The budget may be overdrawn by so much at least, J.
const ALLOWANCE: f64 = 5e-7;
/// And by this share of the encoder's step times the force's variation: by half of it the energy of the readings differs from
/// the true one.
const ALLOWED_VARIATION: f64 = 0.25;
/// The variation counts up to so many times the greatest force: a force that swings must not earn more.
const MOST_VARIATION: f64 = 20.0;
/// The quantum of a coarse encoder, m, until a smaller change of a reading is seen. A device that stays within its quantum of a
/// place is at rest.
const QUANTUM: f64 = 2e-5;
/// A device that turns by no more than this is at rest as well, rad.
const ANGULAR_QUANTUM: f64 = 2e-4;
/// Of what was paid, so much is kept without contact, J: readings that jump by a quantum take and give as much as that, and what
/// they take must not be forgotten before they give it.
const KEPT: f64 = 2e-5;
/// A hand that starts to move by itself or is pushed is no quicker, m/s^2: 8 N on 0.2 kg.
const QUICKEST: f64 = 40.0;
/// Nor does it turn more quickly, rad/s^2: 0.2 N m on 5e-4 kg m^2.
const QUICKEST_TURN: f64 = 400.0;
/// A wrench that is changed by less than this share of itself is left as it is.
const NEGLIGIBLE: f64 = 1e-9;

/// Energy over a run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Energy {
    /// That the hand gave, J, an axis each: x, y, z, then about them.
    pub taken: [f64; 6],
    /// That the hand received, J, an axis each.
    pub given: [f64; 6],
    /// That the controller took from what was to be played, J.
    pub damped: f64,
    /// That was lent to the hand and is not repaid yet, J: a force that came where the hand had gone unopposed.
    pub lent: f64,
    /// That coupling, tool and contact model hold now as far as it is played, J.
    pub stored: f64,
}

impl Energy {
    /// That the hand received more than it gave, J, of all axes.
    pub fn net(&self) -> f64 {
        self.given.iter().sum::<f64>() - self.taken.iter().sum::<f64>()
    }

    /// That was neither given back nor is stored, J: what the hand gave and was lent, less those. Below zero, energy came from
    /// nowhere.
    pub fn dissipated(&self) -> f64 {
        self.lent - self.net() - self.stored
    }
}

/// Observer and controller.
#[derive(Debug, Clone)]
pub struct Passivity {
    /// Whether the controller acts.
    is_on: bool,
    /// Whether the force may swing between two readings.
    may_swing: bool,
    /// Greatest damping that it may inject, N s/m.
    most_damping: f64,
    /// Greatest damping about any axis that it may inject, N m s/rad.
    most_angular_damping: f64,
    energy: Energy,
    /// What the hand gave or was lent, and has not received back, J; below zero: it received more.
    budget: f64,
    /// Whether the force faded since contact began, and what may be lent then, J.
    has_faded: bool,
    limit: Option<f64>,
    last: Option<RigidState>,
    /// Where the device rests: it follows the device a quantum behind.
    rest: Option<RigidState>,
    /// Whether the device left its rest with the last reading.
    has_moved: bool,
    played: Wrench,
    /// The encoder's step, m: the least change of a reading that was seen.
    quantum: f64,
    /// Sum of the changes of the force that was played, N.
    variation: f64,
    /// The greatest force that was played, N.
    peak: f64,
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
    /// An observer; with a controller where `is_on`, of such damping at most, N s/m and N m s/rad. `may_swing`: whether the force
    /// is that of the last step whatever the device does, and so no gradient of a potential.
    pub fn new(is_on: bool, may_swing: bool, [most_damping, most_angular_damping]: [f64; 2]) -> Passivity {
        Passivity {
            is_on,
            may_swing,
            most_damping,
            most_angular_damping,
            energy: Energy::default(),
            budget: 0.0,
            has_faded: false,
            limit: None,
            last: None,
            rest: None,
            has_moved: false,
            played: Wrench::ZERO,
            quantum: QUANTUM,
            variation: 0.0,
            peak: 0.0,
        }
    }

    /// Takes a reading: the force played since the last one did its work.
    pub fn observe(&mut self, device: &RigidState) {
        if let Some(last) = self.last {
            let moved = device.position - last.position;
            let turned = rotation_vector(device.orientation * last.orientation.conjugate());
            let changes = moved.to_array().into_iter().map(f64::abs).filter(|change| *change > 0.0);
            self.quantum = changes.fold(self.quantum, f64::min);
            let work = [self.played.force * moved, self.played.torque * turned];
            for (k, work) in work.iter().flat_map(|work| work.to_array()).enumerate() {
                self.energy.given[k] += work.max(0.0);
                self.energy.taken[k] += (-work).max(0.0);
                self.budget -= work;
            }
        }
        self.last = Some(*device);
        self.has_moved = self.leaves_rest(device);
    }

    /// Whether the device is further than a quantum from where it rests; it rests a quantum behind then.
    fn leaves_rest(&mut self, device: &RigidState) -> bool {
        let rest = self.rest.get_or_insert(*device);
        let away = device.position - rest.position;
        let turned = rotation_vector(device.orientation * rest.orientation.conjugate());
        let (has_moved, has_turned) = (away.length() > self.quantum, turned.length() > ANGULAR_QUANTUM);
        if has_moved {
            rest.position += away * (1.0 - self.quantum / away.length());
        }
        if has_turned {
            rest.orientation = device.orientation;
        }
        has_moved || has_turned
    }

    /// What is left of the budget beyond `stored` (J), J: that much may be added to what is stored.
    pub fn surplus(&self, stored: f64) -> f64 {
        self.budget + self.allowance() - stored
    }

    /// What one step of the encoder is worth against a force, J.
    pub fn quantum_worth(&self, force: f64) -> f64 {
        self.quantum * force
    }

    /// By how much the budget may be overdrawn, J.
    fn allowance(&self) -> f64 {
        (ALLOWED_VARIATION * self.quantum * self.variation.min(MOST_VARIATION * self.peak)).max(ALLOWANCE)
    }

    /// Whether energy that is not paid for is kept back.
    pub fn is_on(&self) -> bool {
        self.is_on
    }

    /// Lends the hand so much, J, or as much as may be lent still; gives back how much it was.
    pub fn lend(&mut self, energy: f64) -> f64 {
        let limit = self.limit.map_or(f64::INFINITY, |limit| limit - self.energy.lent);
        let loan = energy.min(limit).max(0.0);
        self.energy.lent += loan;
        self.budget += loan;
        loan
    }

    /// The force begins to fade. It may be lent all that it lacks when it first comes back; after that nothing beyond what was lent
    /// then, until contact ends: a simulation that stalls again and again lends no more than one that stalls once.
    pub fn begin_to_fade(&mut self) {
        if self.has_faded {
            self.limit.get_or_insert(self.energy.lent);
        }
        self.has_faded = true;
    }

    /// Energy that was stored has gone, J: it repays what was lent.
    pub fn repay(&mut self, energy: f64) {
        let repaid = energy.min(self.energy.lent).max(0.0);
        self.energy.lent -= repaid;
        self.budget -= repaid;
    }

    /// Contact has ended: nothing but what coupling and tool store (`stored`, J) and a little of what was paid may be given back.
    /// What is left repays first.
    pub fn end_contact(&mut self, stored: f64) {
        self.repay(self.budget - stored);
        self.budget = self.budget.min(stored + KEPT);
        (self.has_faded, self.limit) = (false, None);
    }

    /// What coupling, tool and contact model hold at the end of a tick as far as it is played, J.
    pub fn note_stored(&mut self, stored: f64) {
        self.energy.stored = stored;
    }

    /// Damps a wrench where it would give the hand more in the `period` (s) to come than the budget holds: only what is
    /// missing, and never so much that the hand would pay. Up to a quantum's worth of energy is carried on where that takes more
    /// damping than the device bears, times `gain` (0 to 1); beyond it the force along the motion goes. A force that pushes
    /// against the motion, and any force on a device at rest, is played as it is, unless it may swing.
    pub fn control(&mut self, wanted: Wrench, device: &RigidState, period: f64, gain: f64) -> Control {
        let none = Control { wrench: wanted, damping: 0.0, is_limited: false };
        if !self.is_on {
            return none;
        }
        let carried = self.quantum_worth(wanted.force.length());
        if self.may_swing {
            return self.shorten(wanted, device, period);
        }
        if !self.has_moved {
            return none;
        }
        let (v, w) = (device.velocity, device.angular_velocity);
        let power = [wanted.force.dot(v), wanted.torque.dot(w)];
        let missing = (power[0] + power[1]) * period - self.surplus(0.0);
        if power[0] + power[1] <= 0.0 || missing <= 0.0 {
            return none;
        }
        let damping_of = |missing: f64, power: f64, speed2: f64, most: f64| match power > 0.0 && speed2 > 0.0 {
            true => {
                let most = if missing > carried { f64::INFINITY } else { gain * most };
                (missing / (period * speed2)).min(most).min(power / speed2).max(0.0)
            }
            false => 0.0,
        };
        let damping = damping_of(missing, power[0], v.length_squared(), self.most_damping);
        let gone = damping * v.length_squared() * period;
        let angular = damping_of(missing - gone, power[1], w.length_squared(), self.most_angular_damping);
        let gone = gone + angular * w.length_squared() * period;
        if gone <= NEGLIGIBLE * (power[0] + power[1]) * period {
            return none;
        }
        self.energy.damped += gone;
        let wrench = Wrench { force: wanted.force - damping * v, torque: wanted.torque - angular * w };
        Control { wrench, damping, is_limited: missing > gone * (1.0 + NEGLIGIBLE) }
    }

    /// A force that may swing is shortened to what the budget holds, for the way that the hand goes in the `period` (s) to come and
    /// as much more as it may go unforeseen: before its motion is seen, it has the energy.
    fn shorten(&mut self, wanted: Wrench, device: &RigidState, period: f64) -> Control {
        let Wrench { force, torque } = wanted;
        let power = force.dot(device.velocity) + torque.dot(device.angular_velocity);
        let unforeseen = period * period * (force.length() * QUICKEST + torque.length() * QUICKEST_TURN);
        let (asked, left) = (power * period + unforeseen, self.surplus(0.0).max(0.0));
        let share = if asked > left { left / asked } else { 1.0 };
        self.energy.damped += (1.0 - share) * power.max(0.0) * period;
        Control {
            wrench: Wrench { force: share * force, torque: share * torque },
            damping: 0.0,
            is_limited: share < 1.0,
        }
    }

    /// What is played until the next reading.
    pub fn play(&mut self, wrench: Wrench) {
        self.variation += (wrench.force - self.played.force).length();
        self.peak = self.peak.max(wrench.force.length());
        self.played = wrench;
    }

    /// The device is elsewhere all at once: what moved it is no work.
    pub fn jump(&mut self) {
        (self.last, self.rest) = (None, None);
        self.budget = self.budget.min(0.0);
    }

    /// Energies so far.
    pub fn energy(&self) -> Energy {
        self.energy
    }
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};

    use super::*;

    fn at(x: f64, v: f64) -> RigidState {
        RigidState { velocity: DVec3::X * v, ..RigidState::at_rest(DVec3::X * x, DQuat::IDENTITY) }
    }

    fn push(force: f64) -> Wrench {
        Wrench { force: DVec3::X * force, ..Wrench::ZERO }
    }

    /// Presses a spring of `k` (N/m, one-sided, felt two ticks late) by `depth` and leaves it, `ticks` each way; the energy given.
    fn press(passivity: &mut Passivity, k: f64, depth: f64, ticks: i32) -> f64 {
        let (period, mut late) = (1e-3, 0.0);
        let step = depth / f64::from(ticks);
        for tick in 0..=2 * ticks + 20 {
            let x = f64::from(tick.min(2 * ticks + 20 - tick).min(ticks) - 10) * step;
            let way = if tick < ticks { 1.0 } else { -1.0 };
            let device = at(x, way * step / period);
            passivity.observe(&device);
            let control = passivity.control(push(late), &device, period, 1.0);
            late = -k * x.max(0.0);
            passivity.play(control.wrench);
        }
        passivity.energy().net()
    }

    #[test]
    fn a_late_spring_gives_energy_and_the_controller_takes_it() {
        let mut without = Passivity::new(false, false, [10.0, 0.0]);
        let free = press(&mut without, 1000.0, 0.01, 100);
        // By hand: each tick the force is 1.5 ticks old on average: 2 x 1.5 x k depth step.
        assert!(free > 1e-3, "{free}");
        assert_eq!(without.energy().damped, 0.0);
        let mut with = Passivity::new(true, false, [10.0, 0.0]);
        let held = press(&mut with, 1000.0, 0.01, 100);
        // 10 N and back, at a quantum of 20 um.
        assert!(held < 2e-5 * (10.0 + 10.0) && with.variation > 15.0, "{held} J, {} N", with.variation);
        assert!(with.energy().damped > 0.7 * free, "{:?}", with.energy());
    }

    #[test]
    fn what_a_prompt_spring_gives_back_is_left_alone() {
        let mut passivity = Passivity::new(true, false, [10.0, 0.0]);
        for k in (0..100).chain((0..100).rev()) {
            let way = if k < 99 { 1.0 } else { -1.0 };
            let device = at(1e-4 * f64::from(k), 0.05 * way);
            passivity.observe(&device);
            let control = passivity.control(push(-0.1 * f64::from(k)), &device, 1e-3, 1.0);
            passivity.play(control.wrench);
        }
        // Held forces give back k h v^2 T less a little; the controller may take no more than that.
        assert!(passivity.energy().damped < 1e-3 * 0.05 * 0.1 * 200.0, "{:?}", passivity.energy());
    }

    #[test]
    fn a_force_at_rest_or_against_the_motion_is_played_whatever_the_budget() {
        let mut passivity = Passivity::new(true, false, [10.0, 0.0]);
        passivity.budget = -1.0;
        for x in [0.0, 2e-5, 0.0, 2e-5, 0.0] {
            passivity.observe(&at(x, 0.01));
            assert_eq!(passivity.control(push(3.0), &at(x, 0.01), 1e-3, 1.0).wrench, push(3.0));
        }
        passivity.observe(&at(1e-3, 0.1));
        assert_eq!(passivity.control(push(-3.0), &at(1e-3, 0.1), 1e-3, 1.0).wrench, push(-3.0));
        // Along the motion a whole newton is missing: all goes.
        let damped = passivity.control(push(3.0), &at(1e-3, 0.1), 1e-3, 1.0);
        assert!(damped.wrench.force.x.abs() < 1e-12 && damped.is_limited, "{damped:?}");
        // A quantum's worth is carried on: 10 N s/m at 0.1 m/s.
        passivity.budget = 0.3e-3 - 2e-5;
        let carried = passivity.control(push(3.0), &at(1e-3, 0.1), 1e-3, 1.0);
        assert!((carried.wrench.force.x - 3.0 + 0.195).abs() < 1e-9 && !carried.is_limited, "{carried:?}");
        passivity.budget = -1e-5;
        let weak = passivity.control(push(0.5), &at(1e-3, 0.1), 1e-3, 1.0);
        assert!(weak.wrench.force.x.abs() < 1e-12, "power never changes sign: {weak:?}");
        // A slow device moves too, once it is a quantum away from where it was; its quantum is the least change that was seen.
        (0..10).for_each(|k| passivity.observe(&at(1e-3 + 1e-6 * f64::from(k), 1e-3)));
        assert!(passivity.has_moved);
        passivity.observe(&at(1e-3 + 8e-6, -1e-3));
        assert!(!passivity.has_moved, "it turned back");
    }

    #[test]
    fn energy_that_enters_along_one_axis_may_leave_along_another() {
        let mut passivity = Passivity::new(true, false, [1000.0, 0.0]);
        passivity.observe(&at(0.0, 0.0));
        passivity.play(push(-2.0));
        passivity.observe(&at(0.01, 0.0));
        let sideways = RigidState { velocity: DVec3::Y * 0.1, ..at(0.01, 0.0) };
        let push = Wrench { force: DVec3::Y, ..Wrench::ZERO };
        assert_eq!(passivity.control(push, &sideways, 1e-3, 1.0).wrench, push);
        passivity.end_contact(0.0);
        // What is kept is left, of the 1e-4 J that the push gives in a tick.
        let left = passivity.control(push, &sideways, 1e-3, 1.0).wrench.force;
        let kept = KEPT + passivity.allowance();
        assert!(kept < 4e-5 && (left.y - kept / 1e-4).abs() < 1e-9, "{left}");
    }

    #[test]
    fn what_is_lent_is_repaid_by_what_is_lost_and_a_loan_is_never_more_than_was_asked() {
        let mut passivity = Passivity::new(true, false, [5.0, 0.0]);
        for _ in 0..1000 {
            passivity.lend(0.01);
            assert!((passivity.surplus(0.01) - ALLOWANCE).abs() < 1e-12);
            passivity.repay(0.01);
        }
        assert_eq!((passivity.energy().lent, passivity.budget), (0.0, 0.0));
        // Nobody is paid who lent nothing.
        passivity.lend(0.01);
        passivity.repay(0.05);
        assert_eq!((passivity.energy().lent, passivity.budget), (0.0, 0.0));
        // What the hand gave beyond it repays at the end of contact, and is forgotten then.
        passivity.lend(0.01);
        passivity.observe(&at(0.0, 0.0));
        passivity.play(push(-2.0));
        passivity.observe(&at(0.01, 0.0));
        passivity.end_contact(1e-3);
        assert_eq!((passivity.energy().lent, passivity.budget), (0.0, 1e-3 + KEPT));
        assert!((passivity.energy().dissipated() - 0.02).abs() < 1e-12);
    }
}
