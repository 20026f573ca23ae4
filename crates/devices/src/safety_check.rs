//! A check of a haptic device with little force, before a first session with it: whether readings are plausible, each
//! direction pushes the handle that way, and no force remains where none is commanded. The person who holds the handle
//! is told what to do. A *tick* reads the device and commands a force once, about a thousand times a second.

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
/// Greatest speed of the handle from the first push on, m/s, and greatest way from where a part began, m: beyond either
/// the check ends. The speed is taken over `SPAN` s, since the encoder's steps are felt in that of a tick.
const FASTEST: f64 = 0.5;
const FARTHEST: f64 = 0.05;
const SPAN: f64 = 0.01;
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
    /// Waits until a time, s since the check began, and returns the time then.
    pub wait: &'a mut dyn FnMut(f64) -> f64,
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
/// A line with the reason why the check could not go on: the device is lost, does not move freely, moves too fast or too
/// far, or a person ends the check.
pub fn check(device: &mut dyn Device, guide: &mut Guide) -> Result<Vec<Finding>, String> {
    let has_watchdog = guide.has_watchdog;
    let force = SHARE * device.profile().max_force;
    let mut checker = Checker { force, device, guide, time: 0.0, last: None, guard: None };
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
    /// Time of the last tick, s since the check began.
    time: f64,
    last: Option<(f64, DVec3)>,
    /// From the first push on: where the part began, and a place with its time for the speed.
    guard: Option<(DVec3, f64, DVec3)>,
}

impl Checker<'_, '_> {
    fn parts(&mut self, has_watchdog: bool) -> Result<Vec<Finding>, String> {
        let free = self.moves_freely()?;
        if !free.is_well {
            return Err(free.text);
        }
        let mut found = vec![free];
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
            // A driver refuses the first wrench after a pause.
            self.device.write(&wrench).or_else(|_| self.device.write(&wrench)).map_err(|fault| fault.to_string())?;
        }
        // Ticks that were missed are not made up for.
        self.time = (self.guide.wait)(self.time + PERIOD);
        let time = self.time;
        let place = self.device.read(time).map_err(|fault| fault.to_string())?.state.position;
        if !place.is_finite() {
            return Err("the device's position is not finite".into());
        }
        let (before, last) = self.last.replace((time, place)).unwrap_or((time, place));
        if last.distance(place) > IMPLAUSIBLE * (time - before).max(PERIOD) {
            return Err(format!("the device's position leapt by {:.1} mm", 1e3 * last.distance(place)));
        }
        if let Some((begin, since, from)) = &mut self.guard {
            if time - *since >= SPAN {
                if from.distance(place) > FASTEST * (time - *since) {
                    return Err(format!("the handle moved faster than {FASTEST} m/s under {:.2} N", self.force));
                }
                (*since, *from) = (time, place);
            }
            if begin.distance(place) > FARTHEST {
                return Err(format!("the handle moved farther than {:.0} mm: hold it", 1e3 * FARTHEST));
            }
        }
        Ok(place)
    }

    /// Begins a part in which speed and way of the handle are bounded; returns where it is.
    fn guarded(&mut self) -> Result<DVec3, String> {
        let place = self.tick(Some(DVec3::ZERO))?;
        self.guard = Some((place, self.time, place));
        Ok(place)
    }

    fn moves_freely(&mut self) -> Result<Finding, String> {
        (self.guide.say)("move the handle a few centimetres to the right, up and towards you, and back");
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        while self.time < FREE {
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
        let begin = self.guarded()?;
        let (mut place, begun) = (begin, self.time);
        while self.time < begun + RISE + STAY {
            let share = ((self.time - begun) / RISE).min(1.0);
            place = self.tick(Some(share * self.force * direction))?;
        }
        Ok([begin, place - begin])
    }

    fn pushes(&mut self, name: &str, direction: DVec3) -> Result<Finding, String> {
        let [_, moved] = self.push(direction)?;
        let begun = self.time;
        while self.time < begun + FALL {
            let share = 1.0 - (self.time - begun) / FALL;
            self.tick(Some(share * self.force * direction))?;
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
        let mut before = self.guarded()?;
        let (begun, mut since, mut way) = (self.time, self.time, 0.0);
        while self.time < begun + RELEASE {
            let place = self.tick(Some(DVec3::ZERO))?;
            if self.time - since >= SPAN {
                way += before.distance(place);
                (before, since) = (place, self.time);
            }
        }
        let speed = way / RELEASE;
        let text = format!("released, the handle moved at {:.0} mm/s", 1e3 * speed);
        Ok(Finding { text, is_well: speed <= AT_REST })
    }

    /// Where no force is commanded any more, the driver ends the one before.
    fn falls_silent(&mut self) -> Result<Finding, String> {
        let [begin, pushed] = self.push(DVec3::Y)?;
        let mut place = begin;
        let begun = self.time;
        while self.time < begun + SILENCE {
            place = self.tick(None)?;
        }
        let left = (place - begin).dot(DVec3::Y);
        self.tick(Some(DVec3::ZERO))?;
        let [left, pushed] = [left, pushed.y].map(|way| 1e3 * way);
        let remedy = if pushed > 1e3 * LEAST_PUSH { "" } else { ": hold it more loosely, and check again" };
        let text = format!("left without commands, the handle came back to {left:.1} mm from {pushed:.1} mm{remedy}");
        Ok(Finding { text, is_well: remedy.is_empty() && left < 0.5 * pushed })
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
        /// Velocity and way of a handle that is let go.
        free: [DVec3; 2],
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
        /// The position stays what it was.
        Frozen,
        /// Nobody holds the handle, of 20 g, when it is pushed.
        LetGo,
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
                Wrong::LetGo => {
                    self.free[0] += self.last.force / 0.02 * PERIOD;
                    self.free[1] += self.free[0] * PERIOD;
                    reading.state.position += self.free[1];
                }
                Wrong::Frozen => reading.state.position = DVec3::ZERO,
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
        let mut driver = Driver {
            hand: rehearsal(TOUCH).unwrap(),
            wrong,
            silent: 0,
            greatest: 0.0,
            last: Wrench::ZERO,
            free: [DVec3::ZERO; 2],
        };
        driver.open().unwrap();
        let (mut said, stop) = (Vec::new(), AtomicBool::new(false));
        let mut say = |line: &str| said.push(line.to_string());
        let mut wait = |time: f64| time;
        let mut guide = Guide { wait: &mut wait, say: &mut say, stop: &stop, has_watchdog: true };
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
        // A watchdog cannot be seen where nothing pushes.
        assert_eq!(failed(Wrong::Weak), [1, 2, 3, 4, 5, 6, 8]);
        for (wrong, said) in
            [(Wrong::Leap, "leapt by 100"), (Wrong::Lost, "unplugged"), (Wrong::Frozen, "move it farther")]
        {
            assert!(checked(wrong).0.unwrap_err().contains(said), "{wrong:?}");
        }
    }

    #[test]
    fn a_handle_that_nobody_holds_ends_the_check() {
        let said = checked(Wrong::LetGo).0.unwrap_err();
        assert!(said.contains("faster than") || said.contains("farther than"), "{said}");
        let (mut hand, stop) = (rehearsal(TOUCH).unwrap(), AtomicBool::new(true));
        let mut guide = Guide { wait: &mut |time| time, say: &mut |_| {}, stop: &stop, has_watchdog: false };
        assert_eq!(check(&mut hand, &mut guide), Err("the check was ended".into()));
    }
}
