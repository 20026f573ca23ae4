//! A check of a haptic device with little force, before a first session with it: whether readings are plausible, each
//! direction pushes the handle that way, and no force remains where none is commanded. The person who holds the handle
//! is told what to do. A *tick* reads the device and commands a force once, a thousand times a second.

use std::sync::atomic::{AtomicBool, Ordering};

use glam::{DQuat, DVec3};
use palpate::Wrench;
use palpate::internal::haptics::Device;
use palpate::internal::step::trajectory::Trajectory;
use palpate::scene::{HandParameters, Key, Profile};

use crate::Hand;

/// Time of a tick, s.
const PERIOD: f64 = 1e-3;
/// Greatest force of the check, as a share of the device's limit.
pub const SHARE: f64 = 0.1;
/// Times of the check's parts, s: motion without force; a push's rise, hold and fall; the release; the silence.
const FREE: f64 = 5.0;
const RISE: f64 = 0.5;
const STAY: f64 = 0.3;
const FALL: f64 = 0.5;
const RELEASE: f64 = 1.0;
const SILENCE: f64 = 0.3;
/// Least way in each direction of the motion without force, m.
const LEAST_WAY: f64 = 5e-3;
/// Least way of the handle under a push that counts as a motion, m.
const LEAST_PUSH: f64 = 2e-4;
/// Greatest speed of the handle while it is pushed, m/s, and greatest way, m: beyond either the check ends.
const FASTEST: f64 = 0.5;
const FARTHEST: f64 = 0.05;
/// Greatest speed of a hand, m/s: a faster reading is wrong.
const IMPLAUSIBLE: f64 = 5.0;
/// Greatest mean speed of the handle after the release, m/s.
const AT_REST: f64 = 0.1;

/// Directions of the pushes, as a person who sits before the device sees them.
const DIRECTIONS: [(&str, DVec3); 6] = [
    ("to the right", DVec3::X),
    ("to the left", DVec3::NEG_X),
    ("up", DVec3::Y),
    ("down", DVec3::NEG_Y),
    ("towards you", DVec3::Z),
    ("away from you", DVec3::NEG_Z),
];

/// A part of the check: what was looked for and found, and whether that is well.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// What was found, in a line.
    pub text: String,
    /// Whether it is as it should be.
    pub is_well: bool,
}

/// How the check keeps time and speaks to the person.
pub struct Guide<'a> {
    /// Waits until a time, s since the check began.
    pub wait: &'a mut dyn FnMut(f64),
    /// Says a line to the person.
    pub say: &'a mut dyn FnMut(&str),
    /// Set to end the check.
    pub stop: &'a AtomicBool,
    /// Whether the driver ends the force by itself where no other is commanded; that is then checked too.
    pub has_watchdog: bool,
}

/// Checks an open device. It has no force at the end, however the check ends.
///
/// # Errors
/// A line with the reason why the check could not go on: the device is lost, moves too fast or too far, or a person ends
/// the check.
pub fn check(device: &mut dyn Device, guide: &mut Guide) -> Result<Vec<Finding>, String> {
    let has_watchdog = guide.has_watchdog;
    let mut checker = Checker { force: SHARE * device.profile().max_force, device, guide, tick: 0, last: None };
    let found = checker.parts(has_watchdog);
    // Where this fails, nothing more can be done.
    let _ = checker.device.write(&Wrench::ZERO);
    found
}

/// The simulated hand, which moves its handle as the check asks at first, as a rehearsal.
///
/// # Errors
/// None: the parameters of the hand are the default ones.
pub fn rehearsal(profile: Profile) -> Result<Hand, String> {
    let key = |time: f64, position: DVec3| Key { time, position, orientation: DQuat::IDENTITY };
    let place = |k: u32| 0.015 * [DVec3::ZERO, DVec3::X, DVec3::ONE, DVec3::ZERO][k as usize];
    let keys: Vec<Key> = (0..4).map(|k| key(0.25 * FREE * f64::from(k), place(k))).collect();
    let intended = Trajectory::new(&keys, keys[0]);
    Hand::new(HandParameters::default(), intended, profile)
}

struct Checker<'a, 'g> {
    device: &'a mut dyn Device,
    guide: &'a mut Guide<'g>,
    /// Force of a push, N.
    force: f64,
    tick: u64,
    last: Option<DVec3>,
}

impl Checker<'_, '_> {
    fn parts(&mut self, has_watchdog: bool) -> Result<Vec<Finding>, String> {
        let mut found = vec![self.moves_freely()?];
        (self.guide.say)(&format!("hold the handle loosely: it is pushed six times, with {:.2} N", self.force));
        for (name, direction) in DIRECTIONS {
            found.push(self.pushes(name, direction)?);
        }
        found.push(self.rests()?);
        if has_watchdog {
            found.push(self.falls_silent()?);
        }
        Ok(found)
    }

    /// Commands a force, or nothing at all, and reads the position a tick later.
    fn tick(&mut self, force: Option<DVec3>) -> Result<DVec3, String> {
        if self.guide.stop.load(Ordering::Relaxed) {
            return Err("the check was ended".into());
        }
        if let Some(force) = force {
            let wrench = Wrench { force, torque: DVec3::ZERO };
            self.device.write(&wrench).map_err(|fault| fault.to_string())?;
        }
        self.tick += 1;
        let time = self.tick as f64 * PERIOD;
        (self.guide.wait)(time);
        let place = self.device.read(time).map_err(|fault| fault.to_string())?.state.position;
        if !place.is_finite() {
            return Err("the device's position is not finite".into());
        }
        let way = self.last.replace(place).map_or(0.0, |last| last.distance(place));
        if way > IMPLAUSIBLE * PERIOD {
            return Err(format!("the device's position leapt by {:.1} mm within a reading", 1e3 * way));
        }
        Ok(place)
    }

    fn moves_freely(&mut self) -> Result<Finding, String> {
        (self.guide.say)("move the handle a few centimetres to the right, up and towards you, and back");
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for _ in 0..(FREE / PERIOD) as u64 {
            let place = self.tick(Some(DVec3::ZERO))?;
            (low, high) = (low.min(place), high.max(place));
        }
        let way = high - low;
        let [x, y, z] = (1e3 * way).to_array();
        let text = format!("without force the handle moved by {x:.0} mm across, {y:.0} mm up, {z:.0} mm towards you");
        let is_well = way.min_element() >= LEAST_WAY;
        let remedy = if is_well { "" } else { "; move it farther in each direction, and check again" };
        Ok(Finding { text: text + remedy, is_well })
    }

    /// Pushes in a direction; returns where the handle was, and its way up to the end of the full force, m.
    fn push(&mut self, direction: DVec3) -> Result<[DVec3; 2], String> {
        let begin = self.tick(Some(DVec3::ZERO))?;
        let (mut place, mut before) = (begin, begin);
        for k in 0..((RISE + STAY) / PERIOD) as u64 {
            let share = (k as f64 * PERIOD / RISE).min(1.0);
            place = self.tick(Some(share * self.force * direction))?;
            // The speed is taken over 10 ms, since the encoder's steps are felt in that of a tick.
            if k % 10 == 9 {
                if before.distance(place) > FASTEST * 10.0 * PERIOD {
                    return Err(format!("the handle moved faster than {FASTEST} m/s under {:.2} N", self.force));
                }
                before = place;
            }
            if begin.distance(place) > FARTHEST {
                return Err(format!("the handle moved farther than {:.0} mm: hold it", 1e3 * FARTHEST));
            }
        }
        Ok([begin, place - begin])
    }

    fn pushes(&mut self, name: &str, direction: DVec3) -> Result<Finding, String> {
        let [_, moved] = self.push(direction)?;
        for k in 0..(FALL / PERIOD) as u64 {
            self.tick(Some((1.0 - k as f64 * PERIOD / FALL) * self.force * direction))?;
        }
        let way = moved.dot(direction);
        let aside = (moved - way * direction).length();
        let is_well = way > LEAST_PUSH && aside < way;
        let remedy = match (is_well, moved.length() > LEAST_PUSH) {
            (true, _) => "",
            (false, true) => ": if it does so again, its axes are wrong, and it must not be used",
            (false, false) => ": hold it more loosely, and check again",
        };
        let [way, aside] = [way, aside].map(|way| 1e3 * way);
        let text = format!("pushed {name}, the handle went {way:.1} mm that way and {aside:.1} mm aside{remedy}");
        Ok(Finding { text, is_well })
    }

    /// After the pushes no force remains.
    fn rests(&mut self) -> Result<Finding, String> {
        let ticks = (RELEASE / PERIOD) as u64;
        let mut way = 0.0;
        let mut before = self.tick(Some(DVec3::ZERO))?;
        for _ in 0..ticks / 10 {
            let mut place = before;
            for _ in 0..10 {
                place = self.tick(Some(DVec3::ZERO))?;
            }
            way += before.distance(place);
            before = place;
        }
        let speed = way / RELEASE;
        let text = format!("released, the handle moved at {:.0} mm/s", 1e3 * speed);
        Ok(Finding { text, is_well: speed <= AT_REST })
    }

    /// Where no force is commanded any more, the driver ends the one before.
    fn falls_silent(&mut self) -> Result<Finding, String> {
        let [begin, pushed] = self.push(DVec3::Y)?;
        let mut place = begin;
        for _ in 0..(SILENCE / PERIOD) as u64 {
            place = self.tick(None)?;
        }
        let left = (place - begin).dot(DVec3::Y);
        self.tick(Some(DVec3::ZERO))?;
        let [left, pushed] = [left, pushed.y].map(|way| 1e3 * way);
        let text = format!("left without commands, the handle came back to {left:.1} mm from {pushed:.1} mm");
        Ok(Finding { text, is_well: left < 0.5 * pushed })
    }
}

#[cfg(test)]
mod tests {
    use palpate::internal::haptics::{Fault, Reading};
    use palpate::scene::profile::TOUCH;

    use super::*;

    /// A simulated device with a driver in between, which may be wrong.
    struct Driver {
        hand: Hand,
        wrong: Wrong,
        silent: u32,
        greatest: f64,
        last: Wrench,
    }

    #[derive(Debug, Clone, Copy, PartialEq)]
    enum Wrong {
        Nothing,
        /// Forces along x have the wrong sign.
        Sign,
        /// y and z are exchanged.
        Axes,
        /// The force stays where none is commanded.
        NoWatchdog,
        /// No force is played.
        Weak,
        /// A reading leaps.
        Leap,
        Lost,
    }

    impl Device for Driver {
        fn open(&mut self) -> Result<(), Fault> {
            self.hand.open()
        }

        fn profile(&self) -> &Profile {
            self.hand.profile()
        }

        fn read(&mut self, time: f64) -> Result<Reading, Fault> {
            self.silent += 1;
            if self.silent > 20 && self.wrong != Wrong::NoWatchdog {
                self.hand.write(&Wrench::ZERO)?;
            }
            let mut reading = self.hand.read(time)?;
            match self.wrong {
                Wrong::Leap if time > 7.0 => reading.state.position.x += 0.1,
                Wrong::Lost if time > 7.0 => return Err(Fault::Lost("unplugged".into())),
                _ => {}
            }
            Ok(reading)
        }

        fn write(&mut self, wrench: &Wrench) -> Result<(), Fault> {
            self.silent = 0;
            self.last = *wrench;
            self.greatest = self.greatest.max(wrench.force.length());
            let DVec3 { x, y, z } = wrench.force;
            let force = match self.wrong {
                Wrong::Sign => DVec3::new(-x, y, z),
                Wrong::Axes => DVec3::new(x, z, y),
                Wrong::Weak => DVec3::ZERO,
                _ => wrench.force,
            };
            self.hand.write(&Wrench { force, torque: DVec3::ZERO })
        }

        fn close(&mut self) {
            self.hand.close();
        }
    }

    fn checked(wrong: Wrong) -> (Result<Vec<Finding>, String>, Driver) {
        let mut driver =
            Driver { hand: rehearsal(TOUCH).unwrap(), wrong, silent: 0, greatest: 0.0, last: Wrench::ZERO };
        driver.open().unwrap();
        let (mut said, stop) = (Vec::new(), AtomicBool::new(false));
        let mut say = |line: &str| said.push(line.to_string());
        let mut guide = Guide { wait: &mut |_| {}, say: &mut say, stop: &stop, has_watchdog: true };
        let found = check(&mut driver, &mut guide);
        assert_eq!(driver.last, Wrench::ZERO, "a force remains after {wrong:?}");
        assert!(driver.greatest <= SHARE * TOUCH.max_force + 1e-12, "{} N", driver.greatest);
        (found, driver)
    }

    #[test]
    fn a_device_that_is_well_passes_and_each_fault_is_seen() {
        let failed = |wrong: Wrong| -> Vec<usize> {
            let found = checked(wrong).0.unwrap();
            assert_eq!(found.len(), 9);
            (0..9).filter(|k| !found[*k].is_well).collect()
        };
        assert_eq!(failed(Wrong::Nothing), [0; 0]);
        assert_eq!(failed(Wrong::Sign), [1, 2]);
        // Pushed along y it moves along z: neither is a motion along the push. The last part pushes along y too.
        assert_eq!(failed(Wrong::Axes)[..4], [3, 4, 5, 6]);
        assert_eq!(failed(Wrong::NoWatchdog), [8]);
        assert_eq!(failed(Wrong::Weak)[..6], [1, 2, 3, 4, 5, 6]);
        for (wrong, said) in [(Wrong::Leap, "leapt by 100"), (Wrong::Lost, "unplugged")] {
            assert!(checked(wrong).0.unwrap_err().contains(said), "{wrong:?}");
        }
    }

    #[test]
    fn a_handle_that_nobody_holds_ends_the_check() {
        let free =
            HandParameters { stiffness: 0.0, damping: 0.0, mass: 0.02, friction: 0.0, ..HandParameters::default() };
        let key = |time: f64| Key { time, position: DVec3::ZERO, orientation: DQuat::IDENTITY };
        let mut hand = Hand::new(free, Trajectory::new(&[key(0.0), key(1.0)], key(0.0)), TOUCH).unwrap();
        hand.open().unwrap();
        let stop = AtomicBool::new(false);
        let mut guide = Guide { wait: &mut |_| {}, say: &mut |_| {}, stop: &stop, has_watchdog: false };
        let said = check(&mut hand, &mut guide).unwrap_err();
        assert!(said.contains("faster than") || said.contains("farther than"), "{said}");
        stop.store(true, Ordering::Relaxed);
        let mut guide = Guide { wait: &mut |_| {}, say: &mut |_| {}, stop: &stop, has_watchdog: false };
        assert_eq!(check(&mut hand, &mut guide), Err("the check was ended".into()));
    }
}
