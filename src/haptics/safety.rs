//! The last stage before the haptic device: limits on the force that may be *played* (commanded to the device). No
//! scene, simulation or device can bypass it.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::event::{Event, Events};
use crate::scene::{Lowered, Profile};
use crate::step::Wrench;

/// The shortest time in which the force may go from zero to its limit, s.
const SLEW_TIME: f64 = 4e-3;
/// Time in which a force fades to zero, s.
pub const FADE_TIME: f64 = 0.05;
/// Time in which the force rises from zero, at the start and after each fade, s.
pub const ENGAGE_TIME: f64 = 0.2;
/// Greatest time, s, by which a contact wrench may be out of date before the force fades, unless a scene asks for a
/// shorter time. Until then the force comes from the local contact model (the linear force law of the last wrench),
/// which is passive by itself. The time is long because a step of large bodies takes a tenth of a second and more.
pub const WATCHDOG: f64 = 1.0;

/// Limits on the wrench that is played.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Limits {
    /// Greatest force, N.
    pub force: f64,
    /// Greatest torque, N m; 0 means that no torque is played.
    pub torque: f64,
    /// Greatest rate of change of the force, N/s.
    pub slew: f64,
    /// Greatest rate of change of the torque, N m/s.
    pub angular_slew: f64,
    /// Radius of the workspace around the position where the device was first read, m.
    pub workspace: f64,
    /// Age of the newest contact wrench beyond which the force fades, s.
    pub watchdog: f64,
}

impl Limits {
    /// The limits of a device's profile, lowered where a scene asks for less. The second value lists the scene's keys
    /// that ask for more than the profile allows; for these keys the profile's limit stays.
    pub fn new(profile: &Profile, lowered: &Lowered) -> (Limits, Vec<&'static str>) {
        let mut refused = Vec::new();
        let mut least = |name: &'static str, limit: f64, asked: Option<f64>| {
            if asked.is_some_and(|asked| asked > limit) {
                refused.push(name);
            }
            // A NaN counts as no request.
            asked.map_or(limit, |asked| limit.min(asked)).max(0.0)
        };
        let force = least("max_force", profile.max_force, lowered.force);
        let torque = least("max_torque", profile.max_torque, lowered.torque);
        let slew = least("max_slew", profile.max_force / SLEW_TIME, lowered.slew);
        let workspace = least("workspace", profile.workspace, lowered.workspace);
        let watchdog = least("watchdog", WATCHDOG, lowered.watchdog);
        let angular_slew = profile.max_torque / SLEW_TIME;
        (Limits { force, torque, slew, angular_slew, workspace, watchdog }, refused)
    }
}

/// The share of the force that is played, from 0 (none) to 1 (all). It falls quickly and rises slowly.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Gain(f64);

impl Gain {
    /// Advances by `period` s: the share rises if `is_well` (nothing asks for a fade), otherwise it falls.
    pub fn go(&mut self, is_well: bool, period: f64) {
        let change = if is_well { period / ENGAGE_TIME } else { -period / FADE_TIME };
        self.0 = (self.0 + change).clamp(0.0, 1.0);
    }

    /// Sets the share to 1 at once, for a force that is almost zero.
    pub fn fill(&mut self) {
        self.0 = 1.0;
    }

    /// Sets the share to 0 at once.
    pub fn cut(&mut self) {
        self.0 = 0.0;
    }

    /// The share, 0 to 1.
    pub fn value(self) -> f64 {
        self.0
    }
}

/// Clamps the size and the rate of change of the wrench that is played. The guard remembers the last wrench played.
#[derive(Debug, Clone)]
pub struct Guard {
    limits: Limits,
    last: Wrench,
}

impl Guard {
    /// A guard that has played nothing yet.
    pub fn new(limits: Limits) -> Guard {
        Guard { limits, last: Wrench::ZERO }
    }

    /// Returns the wrench to play instead of `wanted`, `period` s after the last one. The returned wrench is finite and
    /// within the limits on size; it grows no faster than the slew limits allow, may fall as fast as a fade, and is
    /// zero at once if `wanted` is not finite.
    pub fn pass(&mut self, wanted: Wrench, period: f64, events: &mut Events) -> Wrench {
        if !wanted.is_finite() {
            events.raise(Event::BadForce);
            return self.cut();
        }
        let Limits { force, torque, slew, angular_slew, .. } = self.limits;
        let short = Wrench { force: within(wanted.force, force), torque: within(wanted.torque, torque) };
        // If the device plays no torque, removing the torque does not count as clamping.
        let is_clamped = short.force != wanted.force || (torque > 0.0 && short.torque != wanted.torque);
        let change = Wrench { force: short.force - self.last.force, torque: short.torque - self.last.torque };
        // A falling force may always change as fast as a fading one, so that a low slew limit does not delay its fall.
        let rate = |slew: f64, limit: f64, falls: bool| if falls { slew.max(limit / FADE_TIME) } else { slew };
        let most = period * rate(slew, force, short.force.length() < self.last.force.length());
        let most_angular = period * rate(angular_slew, torque, short.torque.length() < self.last.torque.length());
        let slow = Wrench {
            force: self.last.force + change.force.clamp_length_max(most),
            torque: self.last.torque + change.torque.clamp_length_max(most_angular),
        };
        let is_slow = change.force.length() > most || change.torque.length() > most_angular;
        // By rounding, last wrench plus change may exceed the limit slightly, so the sum is shortened once more.
        self.last = Wrench { force: within(slow.force, force), torque: within(slow.torque, torque) };
        for (event, is_raised) in [(Event::Clamped, is_clamped), (Event::SlewLimited, is_slow)] {
            if is_raised {
                events.raise(event);
            }
        }
        self.last
    }

    /// Drops the wrench to zero at once, without fading; returns the zero wrench.
    pub fn cut(&mut self) -> Wrench {
        self.last = Wrench::ZERO;
        Wrench::ZERO
    }
}

/// The vector, shortened to the length `most` if it is longer; the result does not exceed `most` even by rounding.
fn within(vector: DVec3, most: f64) -> DVec3 {
    let mut short = vector.clamp_length_max(most);
    while short.length() > most {
        short *= 1.0 - f64::EPSILON;
    }
    short
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_limit_holds_to_the_last_bit() {
        // When scaled to length 0.03, one in five of these vectors is too long by the last bit of rounding.
        for k in 0..1000 {
            let vector = DVec3::new(1.0 + f64::from(k), 2.0, 0.3 * f64::from(k));
            assert!(within(vector, 0.03).length() <= 0.03, "vector {vector} is longer than 0.03 after shortening");
        }
        assert_eq!(within(DVec3::X, 2.0), DVec3::X);
        assert_eq!(within(DVec3::X, 0.0), DVec3::ZERO);
    }

    #[test]
    fn a_scene_lowers_limits_and_never_raises_them() {
        let profile = Profile::named("premium").unwrap();
        let (whole, _) = Limits::new(profile, &Lowered::default());
        assert_eq!((whole.force, whole.torque, whole.workspace, whole.watchdog), (8.5, 0.188, 0.12, 1.0));
        let ask = |x| Lowered { force: Some(x), torque: Some(x), slew: Some(x), workspace: Some(x), watchdog: Some(x) };
        let (low, refused) = Limits::new(profile, &ask(0.01));
        assert_eq!([low.force, low.torque, low.slew, low.workspace, low.watchdog], [0.01; 5]);
        assert!(refused.is_empty());
        let (high, refused) = Limits::new(profile, &ask(1e9));
        assert_eq!(high, whole);
        assert_eq!(refused, ["max_force", "max_torque", "max_slew", "workspace", "watchdog"]);
        for odd in [f64::NAN, -1.0, f64::INFINITY] {
            let (limits, _) = Limits::new(profile, &ask(odd));
            assert!(
                limits.force <= whole.force && limits.force >= 0.0 && limits.watchdog <= whole.watchdog,
                "scene limits of {odd} led to limits beyond those of the profile, or below zero"
            );
        }
    }

    #[test]
    fn no_force_passes_that_is_too_great_too_sudden_or_no_number() {
        let (limits, _) = Limits::new(Profile::named("premium").unwrap(), &Lowered::default());
        let mut guard = Guard::new(limits);
        let mut last = Wrench::ZERO;
        let force = |x: f64, y: f64| Wrench { force: DVec3::new(x, y, 0.0), torque: DVec3::new(y, 0.0, x) };
        let wanted =
            [(1e9, 0.0), (1e300, -1e300), (3.0, 3.0), (0.0, 0.0), (-1e9, 2.0), (f64::INFINITY, 0.0), (1.0, 0.0)];
        for (x, y) in wanted.into_iter().flat_map(|pair| [pair; 7]) {
            let mut events = Events::default();
            let played = guard.pass(force(x, y), 1e-3, &mut events);
            assert!(
                played.force.length() <= limits.force && played.torque.length() <= limits.torque,
                "wanted force ({x}, {y}, 0) N: a limit is exceeded"
            );
            let step = (played.force - last.force).length();
            assert!(
                step <= limits.slew * 1e-3 * (1.0 + 1e-12) || events.has(Event::BadForce),
                "wanted force ({x}, {y}, 0) N: the played force changed by {step} N in a tick"
            );
            last = played;
        }
        let mut events = Events::default();
        assert_eq!(guard.pass(force(f64::NAN, 0.0), 1e-3, &mut events), Wrench::ZERO);
        assert!(events.has(Event::BadForce));
        let mut events = Events::default();
        guard.pass(force(1e9, 0.0), 1e-3, &mut events);
        assert!(events.has(Event::Clamped) && events.has(Event::SlewLimited));
    }

    #[test]
    fn a_low_slew_does_not_keep_a_force_that_fades() {
        let lowered = Lowered { slew: Some(1.0), ..Lowered::default() };
        let (limits, _) = Limits::new(Profile::named("premium").unwrap(), &lowered);
        let (mut guard, mut events) = (Guard::new(limits), Events::default());
        let wanted = Wrench { force: DVec3::X * 8.0, ..Wrench::ZERO };
        for _ in 0..8000 {
            guard.pass(wanted, 1e-3, &mut events);
        }
        assert!((guard.last.force.x - 8.0).abs() < 1e-6, "the force did not rise to 8 N: {guard:?}");
        for _ in 0..50 {
            guard.pass(Wrench::ZERO, 1e-3, &mut events);
        }
        assert!(guard.last.force.length() < 1e-9, "the force did not fade within 50 ms: {guard:?}");
    }

    #[test]
    fn a_force_fades_in_fifty_milliseconds_and_returns_in_two_hundred() {
        let mut gain = Gain::default();
        (0..200).for_each(|_| gain.go(true, 1e-3));
        assert!((gain.value() - 1.0).abs() < 1e-9);
        (0..50).for_each(|_| gain.go(false, 1e-3));
        assert!(gain.value() < 1e-9, "the share did not fall to zero within 50 ms: {gain:?}");
    }
}
