//! Passivity observer and controller (B. Hannaford and J.-H. Ryu, "Time-domain passivity control of haptic interfaces",
//! 2002): observes the energy that the user's hand gave and received through the haptic device, and limits the energy
//! that the hand receives. The *budget* is the energy that the hand gave or was lent and has not received back; it may
//! not fall below a small negative allowance. Energy is *lent* for a contact force that appears late, after the hand
//! has already moved unopposed into the contact. Further terms: the *tool* is the rigid body that the device leads by a
//! virtual coupling; a *tick* is one iteration of the haptic loop; a wrench is *played* when it is commanded to the
//! device; the *gain* is the share (0 to 1) of the force that is played while it fades in or out; the *quantum* is the
//! resolution of the device's encoders.
//!
//! The played force F_k is constant from one tick to the next, so F_k . (x_k+1 - x_k), for two successive positions
//! as the device reports them, is exactly the work done on the hand, up to the quantum. Each axis is observed by
//! itself, but there is one budget for all axes, because energy that enters along one axis may rightly leave along
//! another (press down, slide off sideways).
//!
//! The budget is enforced twice. The blending of contact models (`follow.rs`) asks [`Passivity::surplus`] before it
//! adds energy, as an energy tank does (F. Ferraguti, C. Secchi and C. Fantuzzi, "A tank-based approach to impedance
//! control with variable stiffness", 2013). And a wrench that would still overdraw the budget is damped before it is
//! played; a force that does no work on the hand, or takes energy from it, is played in full.

use serde::{Deserialize, Serialize};

use crate::step::trajectory::rotation_vector;
use crate::step::{RigidState, Wrench};

/// Least value of the allowance (the amount by which the budget may be overdrawn), J.
const ALLOWANCE: f64 = 5e-7;
/// The budget may be overdrawn by this share of the product of quantum and force variation (the sum of the magnitudes
/// of all changes of the played force): the energy computed from quantised positions differs from the true energy by up
/// to half of that product.
const ALLOWED_VARIATION: f64 = 0.25;
/// The force variation counts up to this multiple of the greatest force, so that a force that keeps oscillating does
/// not raise the allowance without bound.
const MOST_VARIATION: f64 = 20.0;
/// The quantum of rotation, rad: a device that stays within this angle of an orientation is at rest.
const ANGULAR_QUANTUM: f64 = 2e-4;
/// Where the device would have to be damped by more than it renders stably, the share of the force that is missing is
/// withheld in the following ticks too: the share withheld approaches it with the time constant `WITHHOLD`, s, and
/// falls from one to zero in `RETURN` s. If the force came back at once when the device turns round, force and motion
/// would chatter, and the hand would receive energy at every turn.
const WITHHOLD: f64 = 0.01;
const RETURN: f64 = 0.07;
/// Part of the budget that survives the end of contact, J: a position that flickers by a quantum seems to take about
/// this much energy from the hand and to give it back later, and until then the budget must remember the energy.
const KEPT: f64 = 2e-5;
/// Bound on the hand's acceleration, whether it moves by itself or is pushed, m/s^2: 8 N on 0.2 kg.
const QUICKEST: f64 = 40.0;
/// Bound on the hand's angular acceleration, rad/s^2: 0.2 N m on 5e-4 kg m^2.
const QUICKEST_TURN: f64 = 400.0;
/// Damping that would dissipate less than this share of the work of the wrench in a tick is left out.
const NEGLIGIBLE: f64 = 1e-9;

/// Energies since the loop began.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Energy {
    /// Energy that the hand gave along each axis, J: x, y, z, then rotations about them.
    pub taken: [f64; 6],
    /// Energy that the hand received along each axis, J.
    pub given: [f64; 6],
    /// Energy that the controller removed from the wrenches to be played, J.
    pub damped: f64,
    /// Energy that was lent and is not repaid yet, J.
    pub lent: f64,
    /// Energy that coupling, tool and contact model store now, times the gain, J.
    pub stored: f64,
}

impl Energy {
    /// Energy that the hand received beyond what it gave, over all axes, J.
    pub fn net(&self) -> f64 {
        self.given.iter().sum::<f64>() - self.taken.iter().sum::<f64>()
    }

    /// Dissipated energy, J: the energy that the hand gave or was lent, less the energy that it received and the energy
    /// that is stored. A negative value means that energy was generated.
    pub fn dissipated(&self) -> f64 {
        self.lent - self.net() - self.stored
    }
}

/// Passivity observer and controller of one haptic loop.
#[derive(Debug, Clone)]
pub struct Passivity {
    /// Whether the controller acts; the observer always does.
    is_on: bool,
    /// Whether the force stays that of the last simulation step whatever the device does, so that the force may
    /// oscillate.
    may_swing: bool,
    /// Greatest linear damping that may be injected, N s/m.
    most_damping: f64,
    /// Greatest angular damping about any axis that may be injected, N m s/rad.
    most_angular_damping: f64,
    energy: Energy,
    /// Energy that the hand gave or was lent and has not received back, J; negative if it received more.
    budget: f64,
    /// `has_faded`: whether the force has faded since contact began. `limit`: bound on `energy.lent` from the second
    /// fade on, J.
    has_faded: bool,
    limit: Option<f64>,
    last: Option<RigidState>,
    /// Rest pose of the device: when the device moves, the rest pose follows one quantum behind.
    rest: Option<RigidState>,
    /// Whether the pose at the last reading was more than a quantum away from the rest pose.
    has_moved: bool,
    played: Wrench,
    /// The quantum of the encoders, m: the device's resolution, or the least change of a position seen so far if that
    /// is less. A device that stays within one quantum of a place is at rest.
    quantum: f64,
    /// Sum of the magnitudes of all changes of the played force, N.
    variation: f64,
    /// The greatest force played, N.
    peak: f64,
    /// Share of the wrench that is withheld because much energy was missing in the last ticks; see [`WITHHOLD`].
    withheld: f64,
}

/// What the controller did with one wrench.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Control {
    /// The wrench that may be played.
    pub wrench: Wrench,
    /// Linear damping that was injected, N s/m.
    pub damping: f64,
    /// Whether damping within its bound did not cover the energy deficit, or the wrench was scaled down instead.
    pub is_limited: bool,
}

impl Passivity {
    /// Makes an observer, with a controller if `is_on`. The controller injects at most the given linear
    /// damping (N s/m) and angular damping (N m s/rad). `may_swing` means that the force stays that of the last
    /// simulation step whatever the device does, so the force is no gradient of a potential. `resolution`: that of the
    /// device's positions, m.
    pub fn new(
        is_on: bool,
        may_swing: bool,
        [most_damping, most_angular_damping]: [f64; 2],
        resolution: f64,
    ) -> Passivity {
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
            quantum: resolution,
            variation: 0.0,
            peak: 0.0,
            withheld: 0.0,
        }
    }

    /// Takes a reading of the device, and books the work that the wrench played since the last reading did on the hand.
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

    /// Whether the device is more than a quantum away from its rest pose; if so, the rest pose follows.
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

    /// The energy that may still be added to the energy `stored` (J), J: budget plus allowance less `stored`.
    pub fn surplus(&self, stored: f64) -> f64 {
        self.budget + self.allowance() - stored
    }

    /// Work of a `force` (N) over one quantum of the encoder, J.
    pub fn quantum_worth(&self, force: f64) -> f64 {
        self.quantum * force
    }

    /// The allowance: the amount by which the budget may be overdrawn, J.
    fn allowance(&self) -> f64 {
        (ALLOWED_VARIATION * self.quantum * self.variation.min(MOST_VARIATION * self.peak)).max(ALLOWANCE)
    }

    /// Whether the controller acts, which withholds energy that the budget does not cover.
    pub fn is_on(&self) -> bool {
        self.is_on
    }

    /// Lends up to `energy` (J) to the budget, within the limit on loans; returns the amount lent, J.
    pub fn lend(&mut self, energy: f64) -> f64 {
        let limit = self.limit.map_or(f64::INFINITY, |limit| limit - self.energy.lent);
        let loan = energy.min(limit).max(0.0);
        self.energy.lent += loan;
        self.budget += loan;
        loan
    }

    /// Notes that the force begins to fade. When the force first returns, all missing energy may be lent. From the
    /// second fade until the end of contact, the energy on loan may not exceed its amount at that second fade. So a
    /// simulation that stalls repeatedly borrows no more than one that stalls once.
    pub fn begin_to_fade(&mut self) {
        if self.has_faded {
            self.limit.get_or_insert(self.energy.lent);
        }
        self.has_faded = true;
    }

    /// Notes that stored energy (J) has vanished: it repays loans.
    pub fn repay(&mut self, energy: f64) {
        let repaid = energy.min(self.energy.lent).max(0.0);
        self.energy.lent -= repaid;
        self.budget -= repaid;
    }

    /// Notes that contact has ended. What the budget holds beyond the energy in coupling and tool (`stored`, J) first
    /// repays loans; then the budget is cut down to the sum of `stored` and the small amount `KEPT`.
    pub fn end_contact(&mut self, stored: f64) {
        self.repay(self.budget - stored);
        self.budget = self.budget.min(stored + KEPT);
        (self.has_faded, self.limit) = (false, None);
    }

    /// Notes the energy that coupling, tool and contact model store at the end of a tick, times the gain, J.
    pub fn note_stored(&mut self, stored: f64) {
        self.energy.stored = stored;
    }

    /// Damps the `wanted` wrench if it would give the hand more energy in the next `period` (s) than the budget holds.
    /// Only the deficit is removed, and never so much that the power changes its sign. A deficit below the work of the
    /// force over one quantum is removed with at most the damping that the device renders stably (the bound times
    /// `gain`, 0 to 1), and the rest waits for later ticks; a larger deficit is removed at once, up to the whole force
    /// along the motion, and withholds a share of the force in the next ticks (`WITHHOLD`). Other than that, a force
    /// against the motion and any force on a device at rest are played unchanged, unless the force may oscillate
    /// (`may_swing`).
    pub fn control(&mut self, wanted: Wrench, device: &RigidState, period: f64, gain: f64) -> Control {
        let none = Control { wrench: wanted, damping: 0.0, is_limited: false };
        if !self.is_on {
            return none;
        }
        if self.may_swing {
            return self.shorten(wanted, device, period);
        }
        self.withheld = (self.withheld - period / RETURN).max(0.0);
        let (v, w) = (device.velocity, device.angular_velocity);
        let whole = wanted.force.dot(v) + wanted.torque.dot(w);
        let played = 1.0 - self.withheld;
        let wanted = Wrench { force: played * wanted.force, torque: played * wanted.torque };
        let none = Control { wrench: wanted, ..none };
        if !self.has_moved {
            return none;
        }
        // What is withheld of a force against the motion costs the hand no energy.
        self.energy.damped += self.withheld * whole.max(0.0) * period;
        let carried = self.quantum_worth(wanted.force.length());
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
        if damping > gain * self.most_damping {
            let share = (gone / ((power[0] + power[1]) * period)).min(1.0);
            self.withheld += (period / WITHHOLD).min(1.0) * (1.0 - self.withheld) * share;
        }
        let wrench = Wrench { force: wanted.force - damping * v, torque: wanted.torque - angular * w };
        Control { wrench, damping, is_limited: missing > gone * (1.0 + NEGLIGIBLE) }
    }

    /// Scales down a wrench that may oscillate, so that the wrench's work in the next `period` (s) stays within the
    /// budget. That work is computed for the hand's present velocity and for the motion that the hand's greatest
    /// acceleration may add: by the time at which that motion is measured, the hand has already received the energy.
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

    /// Notes the wrench that is played until the next reading.
    pub fn play(&mut self, wrench: Wrench) {
        self.variation += (wrench.force - self.played.force).length();
        self.peak = self.peak.max(wrench.force.length());
        self.played = wrench;
    }

    /// Notes that the device's pose jumped: no work is booked for the jump, and a positive budget is set to zero.
    pub fn jump(&mut self) {
        (self.last, self.rest) = (None, None);
        self.budget = self.budget.min(0.0);
    }

    /// The energies observed so far.
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

    /// Presses a one-sided spring of `k` (N/m), whose force is one tick late, by `depth` (m) and leaves it, in `ticks`
    /// ticks each way; returns the net energy that the hand received, J.
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
        let mut without = Passivity::new(false, false, [10.0, 0.0], 2e-5);
        let free = press(&mut without, 1000.0, 0.01, 100);
        // Calculated by hand: the played force is 1.5 ticks old on average and so generates about 2 x 1.5 x k x depth x
        // step, J, where step is the displacement in a tick.
        assert!(free > 1e-3, "generated energy {free} J, expected more than 1 mJ");
        assert_eq!(without.energy().damped, 0.0);
        let mut with = Passivity::new(true, false, [10.0, 0.0], 2e-5);
        let held = press(&mut with, 1000.0, 0.01, 100);
        // The force varies by 10 N up and 10 N down, at a quantum of 20 um.
        assert!(
            held < 2e-5 * (10.0 + 10.0) && with.variation > 15.0,
            "the hand received too much energy, {held} J, or the force varied too little, by {} N",
            with.variation
        );
        assert!(with.energy().damped > 0.7 * free, "too little energy was damped: {:?}", with.energy());
    }

    #[test]
    fn what_a_prompt_spring_gives_back_is_left_alone() {
        let mut passivity = Passivity::new(true, false, [10.0, 0.0], 2e-5);
        for k in (0..100).chain((0..100).rev()) {
            let way = if k < 99 { 1.0 } else { -1.0 };
            let device = at(1e-4 * f64::from(k), 0.05 * way);
            passivity.observe(&device);
            let control = passivity.control(push(-0.1 * f64::from(k)), &device, 1e-3, 1.0);
            passivity.play(control.wrench);
        }
        // Sample and hold generates the energy k v^2 h T (stiffness k, speed v, period h, duration T), J,
        // approximately; the controller may remove no more.
        assert!(
            passivity.energy().damped < 1e-3 * 0.05 * 0.1 * 200.0,
            "too much energy was damped: {:?}",
            passivity.energy()
        );
    }

    #[test]
    fn a_force_at_rest_or_against_the_motion_is_played_whatever_the_budget() {
        let mut passivity = Passivity::new(true, false, [10.0, 0.0], 2e-5);
        passivity.budget = -1.0;
        for x in [0.0, 2e-5, 0.0, 2e-5, 0.0] {
            passivity.observe(&at(x, 0.01));
            assert_eq!(passivity.control(push(3.0), &at(x, 0.01), 1e-3, 1.0).wrench, push(3.0));
        }
        passivity.observe(&at(1e-3, 0.1));
        assert_eq!(passivity.control(push(-3.0), &at(1e-3, 0.1), 1e-3, 1.0).wrench, push(-3.0));
        // Along the motion: the budget lacks a whole joule, so the whole force is removed.
        let damped = passivity.control(push(3.0), &at(1e-3, 0.1), 1e-3, 1.0);
        assert!(
            damped.wrench.force.x.abs() < 1e-12 && damped.is_limited,
            "the whole force along the motion must be removed: {damped:?}"
        );
        passivity.withheld = 0.0;
        // A deficit below the work of the force over one quantum is damped within the bound of 10 N s/m: here with
        // 1.95 N s/m, which removes 0.195 N at 0.1 m/s.
        passivity.budget = 0.3e-3 - 2e-5;
        let carried = passivity.control(push(3.0), &at(1e-3, 0.1), 1e-3, 1.0);
        assert!(
            (carried.wrench.force.x - 3.0 + 0.195).abs() < 1e-9 && !carried.is_limited,
            "damping within its bound removes 0.195 N: {carried:?}"
        );
        passivity.budget = -1e-5;
        let weak = passivity.control(push(0.5), &at(1e-3, 0.1), 1e-3, 1.0);
        assert!(weak.wrench.force.x.abs() < 1e-12, "the power must not change its sign: {weak:?}");
        // A slow device also counts as moving, once it is a quantum away from its rest pose; the quantum is the least
        // change seen so far.
        (0..10).for_each(|k| passivity.observe(&at(1e-3 + 1e-6 * f64::from(k), 1e-3)));
        assert!(passivity.has_moved);
        passivity.observe(&at(1e-3 + 8e-6, -1e-3));
        assert!(!passivity.has_moved, "a device that turned back by less than a quantum is at rest");
    }

    #[test]
    fn a_force_that_took_too_much_damping_comes_back_slowly() {
        let mut passivity = Passivity::new(true, false, [10.0, 0.0], 2e-5);
        passivity.budget = -1.0;
        passivity.observe(&at(0.0, 0.1));
        passivity.observe(&at(1e-3, 0.1));
        // The whole force is missing, which takes 30 N s/m where 10 are rendered stably.
        assert!(passivity.control(push(3.0), &at(1e-3, 0.1), 1e-3, 1.0).wrench.force.x.abs() < 1e-12);
        // A share stays away, against the motion too, where it costs no energy.
        let damped = passivity.energy().damped;
        for n in 1..10 {
            let played = passivity.control(push(-3.0), &at(1e-3, 0.1), 1e-3, 1.0).wrench.force.x / -3.0;
            let withheld = (1e-3 / WITHHOLD - f64::from(n) * 1e-3 / RETURN).max(0.0);
            assert!((1.0 - played - withheld).abs() < 1e-9, "tick {n}: {played} of the force is played");
        }
        assert_eq!((passivity.withheld, passivity.energy().damped), (0.0, damped));
        // A deficit that lasts withholds about as much at every rate, in the mean: from two thirds, where what is left
        // takes no more than 10 N s/m, to 1 - WITHHOLD / RETURN.
        for rate in [50.0, 250.0, 1000.0, 4000.0] {
            passivity.withheld = 0.0;
            let damped = passivity.energy().damped;
            let mut withheld = 0.0;
            for _ in 0..(0.4 * rate) as u32 {
                passivity.control(push(3.0), &at(1e-3, 0.1), 1.0 / rate, 1.0);
                withheld += passivity.withheld / (0.4 * rate);
            }
            assert!((0.6..0.9).contains(&withheld), "{rate} Hz: {withheld} withheld");
            // All of the work of 3 N over 40 mm was removed, by damping or by what was withheld.
            assert!((passivity.energy().damped - damped - 0.12).abs() < 1e-9, "{rate} Hz: {:?}", passivity.energy());
        }
    }

    #[test]
    fn energy_that_enters_along_one_axis_may_leave_along_another() {
        let mut passivity = Passivity::new(true, false, [1000.0, 0.0], 2e-5);
        passivity.observe(&at(0.0, 0.0));
        passivity.play(push(-2.0));
        passivity.observe(&at(0.01, 0.0));
        let sideways = RigidState { velocity: DVec3::Y * 0.1, ..at(0.01, 0.0) };
        let push = Wrench { force: DVec3::Y, ..Wrench::ZERO };
        assert_eq!(passivity.control(push, &sideways, 1e-3, 1.0).wrench, push);
        passivity.end_contact(0.0);
        // This push would give 1e-4 J in a tick; only the energy that is kept at the end of contact is left for it.
        let left = passivity.control(push, &sideways, 1e-3, 1.0).wrench.force;
        let kept = KEPT + passivity.allowance();
        assert!(kept < 4e-5 && (left.y - kept / 1e-4).abs() < 1e-9, "force that is left: {left} N");
    }

    #[test]
    fn what_is_lent_is_repaid_by_what_is_lost_and_a_loan_is_never_more_than_was_asked() {
        let mut passivity = Passivity::new(true, false, [5.0, 0.0], 2e-5);
        for _ in 0..1000 {
            passivity.lend(0.01);
            assert!((passivity.surplus(0.01) - ALLOWANCE).abs() < 1e-12);
            passivity.repay(0.01);
        }
        assert_eq!((passivity.energy().lent, passivity.budget), (0.0, 0.0));
        // The part of a repayment that exceeds the loan is ignored.
        passivity.lend(0.01);
        passivity.repay(0.05);
        assert_eq!((passivity.energy().lent, passivity.budget), (0.0, 0.0));
        // At the end of contact, the energy that the hand gave repays the loan, and the rest of that energy is
        // forgotten.
        passivity.lend(0.01);
        passivity.observe(&at(0.0, 0.0));
        passivity.play(push(-2.0));
        passivity.observe(&at(0.01, 0.0));
        passivity.end_contact(1e-3);
        assert_eq!((passivity.energy().lent, passivity.budget), (0.0, 1e-3 + KEPT));
        assert!((passivity.energy().dissipated() - 0.02).abs() < 1e-12);
    }
}
