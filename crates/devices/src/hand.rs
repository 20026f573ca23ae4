//! A simulated haptic device together with the person who holds it: a mass (hand and handle) which the arm's spring and
//! damper pull towards the pose that the person intends, and which the *played* wrench (the force and torque commanded
//! to the device) pushes. The equations of motion are integrated in *substeps*, several to a tick (iteration) of the
//! haptic loop. The hand is deterministic; closed-loop tests and `bench haptics` use it as their device.

use std::collections::VecDeque;

use glam::{DQuat, DVec3};
use palpate::internal::haptics::velocity::AdaptiveWindow;
use palpate::internal::haptics::{Device, Fault, Reading};
use palpate::internal::step::trajectory::{Trajectory, rotation_vector};
use palpate::scene::Profile;
use palpate::{RigidState, Wrench};

mod limb;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod wall;

pub use palpate::scene::HandParameters;

use limb::{Limb, Load};

/// Rounding tolerance of times, as a share of a substep; see [`HandParameters::EARLY`].
const EARLY: f64 = HandParameters::EARLY;

/// Greatest number of substeps by which one reading advances the hand, so that a reading takes bounded time whatever
/// the clock does.
const CATCH_UP: u64 = 1000;

/// Energy balance of the hand, J. The change of [`Hand::stored`] is `force + torque + intent - lost`. For translation,
/// and for rotation about a fixed axis, this is exact up to rounding. Where the axis of rotation changes there is a
/// small difference, which vanishes as substeps get shorter and is a loss if the person intends no rotation.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct HandEnergy {
    /// Work of the played force on the hand: the integral of the force over the true motion, not the sensed one.
    pub force: f64,
    /// Work of the played torque on the hand.
    pub torque: f64,
    /// Work that the person does by moving the intended pose.
    pub intent: f64,
    /// Energy dissipated by the damping of arm, wrist and device and by friction; never negative.
    pub lost: f64,
}

impl HandEnergy {
    /// Energy that the hand received from the played wrench, J: positive where the loop gave it energy.
    pub fn received(&self) -> f64 {
        self.force + self.torque
    }
}

/// The simulated person with the device. Time advances in whole substeps from 0, when the hand is at rest in the
/// intended pose; a played wrench stays constant until the next one.
#[derive(Debug, Clone)]
pub struct Hand {
    parameters: HandParameters,
    profile: Profile,
    intended: Trajectory,
    state: RigidState,
    /// Number of substeps done.
    done: u64,
    /// Wrenches that were written but, because of the device's delay, do not act yet; each with the substep that first
    /// plays it.
    coming: VecDeque<(u64, Wrench)>,
    played: Wrench,
    window: AdaptiveWindow,
    /// Resolution of the position that the device reads on each axis, m.
    quantum: f64,
    energy: HandEnergy,
}

impl Hand {
    /// A hand that intends to follow the trajectory `intended`, on a device with the limits of `profile`. Torque acts
    /// on the hand only if the profile says that the device plays torque.
    ///
    /// # Errors
    /// One line that says which parameter is out of range; see [`HandParameters::check`].
    pub fn new(parameters: HandParameters, intended: Trajectory, profile: Profile) -> Result<Hand, String> {
        parameters.check()?;
        let (position, orientation) = intended.pose(0.0);
        let quantum = parameters.quantum.unwrap_or(profile.step());
        Ok(Hand {
            parameters,
            profile,
            intended,
            state: RigidState::at_rest(position, orientation),
            done: 0,
            coming: VecDeque::with_capacity(parameters.delay_substeps() as usize + 1),
            played: Wrench::ZERO,
            window: AdaptiveWindow::new(quantum),
            quantum,
            energy: HandEnergy::default(),
        })
    }

    /// Time that the hand has simulated so far, s.
    pub fn time(&self) -> f64 {
        self.done as f64 * self.parameters.substep
    }

    /// True pose and twist of the hand at [`Hand::time`].
    pub fn state(&self) -> &RigidState {
        &self.state
    }

    /// Sets pose and twist of the hand, as tests do to disturb it. The energy of this change is not counted.
    pub fn place(&mut self, state: RigidState) {
        self.state = state;
    }

    /// Energy balance since the start, or since [`Hand::reset_energy`].
    pub fn energy(&self) -> HandEnergy {
        self.energy
    }

    /// Sets the energy balance to zero.
    pub fn reset_energy(&mut self) {
        self.energy = HandEnergy::default();
    }

    /// Energy of the hand's motion and of the springs of its arm and wrist, J.
    pub fn stored(&self) -> f64 {
        let (position, orientation) = self.intended.pose(self.time());
        let turn = rotation_vector(self.state.orientation * orientation.conjugate());
        Limb::arm(&self.parameters).stored(self.state.position - position, self.state.velocity)
            + Limb::wrist(&self.parameters).stored(turn, self.state.angular_velocity)
    }

    /// Does one substep, during which the intended pose moves uniformly from its value at the start to that at the end.
    fn advance(&mut self) {
        while let Some(&(_, wrench)) = self.coming.front().filter(|(due, _)| *due <= self.done) {
            self.played = wrench;
            self.coming.pop_front();
        }
        let h = self.parameters.substep;
        let (from, turned_from) = self.intended.pose(self.time());
        self.done += 1;
        let (to, turned_to) = self.intended.pose(self.time());
        let arm = Load { stretch: self.state.position - from, intended: (to - from) / h, force: self.played.force };
        let wrist = Load {
            stretch: rotation_vector(self.state.orientation * turned_from.conjugate()),
            intended: rotation_vector(turned_to * turned_from.conjugate()) / h,
            force: self.played.torque,
        };
        let moved = Limb::arm(&self.parameters).step(h, self.state.velocity, &arm);
        let turned = Limb::wrist(&self.parameters).step(h, self.state.angular_velocity, &wrist);
        self.state = RigidState {
            position: self.state.position + h * moved.mean,
            orientation: (DQuat::from_scaled_axis(h * turned.mean) * self.state.orientation).normalize(),
            velocity: moved.velocity,
            angular_velocity: turned.velocity,
        };
        self.energy.force += moved.played;
        self.energy.torque += turned.played;
        self.energy.intent += moved.intent + turned.intent;
        self.energy.lost += moved.lost + turned.lost;
    }

    /// Pose and twist as the device senses them: the position quantised by its encoders, the velocity estimated from
    /// quantised positions, and rotation only if the profile senses it.
    fn sensed(&mut self) -> RigidState {
        let quantum = self.quantum;
        let mut sensed = self.state;
        if quantum > 0.0 {
            sensed.position = (sensed.position / quantum).round() * quantum;
        }
        self.window.push(self.time(), sensed.position);
        sensed.velocity = self.window.velocity();
        if !self.profile.senses_rotation {
            (sensed.orientation, sensed.angular_velocity) = (DQuat::IDENTITY, DVec3::ZERO);
        }
        sensed
    }

    fn let_go(&mut self) {
        self.coming.clear();
        self.played = Wrench::ZERO;
    }
}

impl Device for Hand {
    fn open(&mut self) -> Result<(), Fault> {
        self.let_go();
        Ok(())
    }

    fn profile(&self) -> &Profile {
        &self.profile
    }

    /// Advances the hand to the last whole substep that ends by `time`, but by a thousand substeps at most; the
    /// reading's time is the time reached. Positions are quantised, and the velocity is estimated from them; the
    /// angular velocity is the true one.
    fn read(&mut self, time: f64) -> Result<Reading, Fault> {
        // The cast turns a time that is negative or NaN into 0, so that the hand stays where it is.
        let target = (time / self.parameters.substep + EARLY).floor() as u64;
        let last = target.min(self.done + CATCH_UP);
        while self.done < last {
            self.advance();
        }
        Ok(Reading { time: self.time(), state: self.sensed(), buttons: 0 })
    }

    fn write(&mut self, wrench: &Wrench) -> Result<(), Fault> {
        if !wrench.is_finite() {
            self.let_go();
            return Err(Fault::Garbled("the force to play is not finite; none is played".into()));
        }
        let torque = if self.profile.plays_torque() { wrench.torque } else { DVec3::ZERO };
        let due = self.done + self.parameters.delay_substeps();
        // Of several wrenches written at the same time only the last is played; the others are removed from the queue.
        if self.coming.back().is_some_and(|(last, _)| *last == due) {
            self.coming.pop_back();
        }
        self.coming.push_back((due, Wrench { force: wrench.force, torque }));
        Ok(())
    }

    fn close(&mut self) {
        self.let_go();
    }
}
