//! A haptic device of the caller's: four callbacks, as the loop's device.

use std::cell::Cell;
use std::ffi::{c_char, c_void};

use glam::{DQuat, DVec3};
use palpate::internal::haptics::velocity::AdaptiveWindow;
use palpate::internal::haptics::{Device, Fault, Reading};
use palpate::internal::step::drive::rotation_vector;
use palpate::scene::Profile;
use palpate::scene::profile::PROFILES;
use palpate::{RigidState, Wrench};

use super::simulation::palpate_pose;
use super::sized::{self, Field, Sized32, fields};
use super::status::{Failure, Outcome, palpate_status};

/// Steps of a coarse encoder, m and rad: velocities that a device does not measure are as fine as these allow.
const QUANTA: [f64; 2] = [2e-5, 5e-4];

/// What a device says of itself, world axes. The library fills it before each call of `read`, as described; a device writes
/// over what it knows.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_reading {
    /// As the library knows it: a device writes to no field beyond.
    pub size: u32,
    /// A bit each, the first in the lowest; 1: pressed. Filled with 0.
    pub buttons: u32,
    /// When it was measured, s on the loop's clock. Filled with the time of the call.
    pub time: f64,
    /// Where the device is. Its position must be written; its orientation is filled with the one that turns nothing, and left
    /// so by a device that senses no rotation.
    pub pose: palpate_pose,
    /// m/s. Filled with NaN; left so, it is taken from the positions.
    pub velocity: [f64; 3],
    /// rad/s. Filled with NaN; left so, it is taken from the orientations.
    pub angular_velocity: [f64; 3],
}

/// What a device plays until it is told the next, world axes: within the limits of its profile, always finite.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_play {
    /// As the library knows it: fields beyond are not there.
    pub size: u32,
    /// 0.
    pub reserved: u32,
    /// What the hand is pushed with, N.
    pub force: [f64; 3],
    /// About the device's position, N m; zero where the profile plays none.
    pub torque: [f64; 3],
}

/// A haptic device that the caller's callbacks stand for. They run on threads of the loop, never two at a time, and give 0 if
/// all is well; anything else says that the device is lost for now: nothing is played, and it is asked again at the next tick,
/// until it has been lost for 5 s.
/// None may wait for longer than a small part of a tick, nor let an exception or a longjmp out. `palpate_loop_stop` and
/// `palpate_loop_destroy` from within one only ask the loop to end.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_haptic_device {
    /// sizeof(palpate_haptic_device).
    pub size: u32,
    /// 0.
    pub reserved: u32,
    /// Given to each callback; the library does not look at it. What it points to stays until the loop has ended.
    pub user: *mut c_void,
    /// Makes ready; called once, first of all. Null: there is nothing to do. Other than 0: the loop does not begin, and `close`
    /// is not called.
    pub open: Option<unsafe extern "C" fn(user: *mut c_void) -> i32>,
    /// Where the device is at `time`, s on the loop's clock; called once a tick. Readings that cannot be (not finite, no
    /// rotation, too fast for a hand) are not believed.
    pub read: Option<unsafe extern "C" fn(user: *mut c_void, time: f64, reading: *mut palpate_reading) -> i32>,
    /// Plays from now until the next; called once a tick, and with zero after `open` and before `close`.
    pub write: Option<unsafe extern "C" fn(user: *mut c_void, play: *const palpate_play) -> i32>,
    /// Lets go; called once at the end, whatever happened, if `open` gave 0. Null: there is nothing to do.
    pub close: Option<unsafe extern "C" fn(user: *mut c_void)>,
    /// What the device can do, by name: "scripted", "premium", "touch", "omega.x", "delta.6", "sigma.7", "falcon", "inverse3",
    /// "minverse" or "mouse" (README, "The hand"). Null: the scene's `haptics.profile`.
    pub profile: *const c_char,
}

// SAFETY: `repr(C)`, the size comes first, and any bytes are a value: pointers are only followed as the header says.
unsafe impl Sized32 for palpate_haptic_device {
    const NAME: &str = "palpate_haptic_device";
    const LEAST: usize = 2 * size_of::<u32>() + 6 * size_of::<*const c_void>();
    const FIELDS: &'static [Field] =
        fields!(palpate_haptic_device { size, reserved, user, open, read, write, close, profile });

    fn unset() -> Self {
        let (user, profile) = (std::ptr::null_mut(), std::ptr::null());
        let size = size_of::<Self>() as u32;
        palpate_haptic_device { size, reserved: 0, user, open: None, read: None, write: None, close: None, profile }
    }
}

thread_local! {
    static IS_CALLED: Cell<bool> = const { Cell::new(false) };
}

/// Whether this thread is in a callback: then it must not wait for a loop's end.
pub(super) fn is_in_callback() -> bool {
    IS_CALLED.get()
}

/// The callbacks as the loop's device.
pub(super) struct Callbacks {
    calls: palpate_haptic_device,
    read: unsafe extern "C" fn(*mut c_void, f64, *mut palpate_reading) -> i32,
    write: unsafe extern "C" fn(*mut c_void, *const palpate_play) -> i32,
    profile: Profile,
    motion: Motion,
}

// SAFETY: what `user` points to is used by the callbacks alone, which the header says run on the loop's threads.
unsafe impl Send for Callbacks {}

impl Callbacks {
    /// Checked. `default`: the scene's profile.
    ///
    /// # Safety
    /// As the header says of a `palpate_haptic_device`.
    pub unsafe fn new(device: *const palpate_haptic_device, default: Option<&Profile>) -> Outcome<Callbacks> {
        let null = |name: &str| Failure::new(palpate_status::Null, format!("{name} is null; give one"));
        if device.is_null() {
            return Err(null("device"));
        }
        // SAFETY: the caller's promise.
        let calls = unsafe { sized::read(device)? };
        if calls.reserved != 0 {
            let problem = format!("palpate_haptic_device.reserved is {}; set it to 0", calls.reserved);
            return Err(Failure::new(palpate_status::Argument, problem));
        }
        let read = calls.read.ok_or_else(|| null("device.read"))?;
        let write = calls.write.ok_or_else(|| null("device.write"))?;
        let names = || PROFILES.map(|profile| profile.name).join(", ");
        let wrong = |what: String| Failure::new(palpate_status::Argument, format!("{what}; give one of {}", names()));
        let profile = match (calls.profile.is_null(), default) {
            (true, Some(profile)) => profile,
            (true, None) => return Err(wrong("device.profile is null, and the scene has no haptics.profile".into())),
            (false, _) => {
                // SAFETY: the caller's promise.
                let name = unsafe { sized::string(calls.profile, "device.profile")? };
                Profile::named(name).ok_or_else(|| wrong(format!("device.profile is `{name}`")))?
            }
        };
        Ok(Callbacks { calls, read, write, profile: profile.clone(), motion: Motion::new() })
    }

    /// What a callback gives, with the thread marked as in one.
    fn call<R>(&self, callback: impl FnOnce(*mut c_void) -> R) -> R {
        IS_CALLED.set(true);
        let given = callback(self.calls.user);
        IS_CALLED.set(false);
        given
    }
}

/// Nothing is made of a device that is lost in the middle: the loop only asks whether it is, a thousand times a second.
fn lost(status: i32) -> Result<(), Fault> {
    if status == 0 { Ok(()) } else { Err(Fault::Lost(String::new())) }
}

impl Device for Callbacks {
    fn open(&mut self) -> Result<(), Fault> {
        let said = |name: &str, status: i32| Fault::Lost(format!("its callback {name} gave {status}"));
        if let Some(open) = self.calls.open {
            // SAFETY (all callbacks): as the header says, they can be called, with what `user` was given for.
            let status = self.call(|user| unsafe { open(user) });
            if status != 0 {
                return Err(said("open", status));
            }
        }
        self.write(&Wrench::ZERO).map_err(|_| {
            self.close();
            Fault::Lost("its callback write did not take a force of zero".into())
        })
    }

    fn profile(&self) -> &Profile {
        &self.profile
    }

    fn read(&mut self, time: f64) -> Result<Reading, Fault> {
        let mut reading = palpate_reading {
            size: size_of::<palpate_reading>() as u32,
            buttons: 0,
            time,
            pose: palpate_pose { position: [f64::NAN; 3], orientation: [0.0, 0.0, 0.0, 1.0] },
            velocity: [f64::NAN; 3],
            angular_velocity: [f64::NAN; 3],
        };
        let read = self.read;
        // SAFETY: above; any bytes are a reading.
        lost(self.call(|user| unsafe { read(user, time, &mut reading) }))?;
        Ok(self.motion.completed(&reading, time))
    }

    fn write(&mut self, wrench: &Wrench) -> Result<(), Fault> {
        let size = size_of::<palpate_play>() as u32;
        let (force, torque) = (wrench.force.to_array(), wrench.torque.to_array());
        let play = palpate_play { size, reserved: 0, force, torque };
        let write = self.write;
        // SAFETY: above.
        lost(self.call(|user| unsafe { write(user, &play) }))
    }

    fn close(&mut self) {
        // A device that is gone has nothing to let go of.
        let _ = self.write(&Wrench::ZERO);
        if let Some(close) = self.calls.close {
            // SAFETY: above.
            self.call(|user| unsafe { close(user) });
        }
    }
}

/// Velocities of a device that does not measure them.
struct Motion {
    positions: AdaptiveWindow,
    /// Of all turns so far, added up: its slope is the angular velocity.
    turns: AdaptiveWindow,
    turned: DVec3,
    last: DQuat,
}

impl Motion {
    fn new() -> Motion {
        let [positions, turns] = QUANTA.map(AdaptiveWindow::new);
        Motion { positions, turns, turned: DVec3::ZERO, last: DQuat::IDENTITY }
    }

    /// A reading with all that was left out; what cannot be is passed on, for the loop guards against it.
    fn completed(&mut self, reading: &palpate_reading, now: f64) -> Reading {
        let time = if reading.time.is_finite() { reading.time } else { now };
        let position = DVec3::from_array(reading.pose.position);
        let orientation = DQuat::from_array(reading.pose.orientation);
        let mut state = RigidState::at_rest(position, orientation);
        if state.is_valid() {
            self.turned += rotation_vector(orientation.normalize() * self.last.conjugate());
            self.last = orientation.normalize();
            self.positions.push(time, position);
            self.turns.push(time, self.turned);
        }
        let known = |given: [f64; 3], own: DVec3| match given.iter().all(|x| x.is_nan()) {
            true => own,
            false => DVec3::from_array(given),
        };
        state.velocity = known(reading.velocity, self.positions.velocity());
        state.angular_velocity = known(reading.angular_velocity, self.turns.velocity());
        Reading { time, state, buttons: reading.buttons }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reading(x: f64, angle: f64) -> palpate_reading {
        let orientation = DQuat::from_rotation_z(angle).to_array();
        palpate_reading {
            size: size_of::<palpate_reading>() as u32,
            buttons: 3,
            time: f64::NAN,
            pose: palpate_pose { position: [x, 0.0, 0.0], orientation },
            velocity: [f64::NAN; 3],
            angular_velocity: [f64::NAN; 3],
        }
    }

    #[test]
    fn velocities_that_are_not_measured_are_taken_from_poses_and_others_are_kept() {
        let mut motion = Motion::new();
        let mut last = motion.completed(&reading(0.0, 0.0), 0.0);
        assert_eq!((last.state.velocity, last.buttons), (DVec3::ZERO, 3));
        for k in 1..40 {
            let t = f64::from(k) * 1e-3;
            last = motion.completed(&reading(0.1 * t, 2.0 * t), t);
        }
        assert!((last.state.velocity - DVec3::X * 0.1).length() < 1e-9, "{last:?}");
        assert!((last.state.angular_velocity - DVec3::Z * 2.0).length() < 1e-9, "{last:?}");
        let measured = palpate_reading { velocity: [1.0, f64::NAN, 0.0], ..reading(0.0, 0.0) };
        let kept = motion.completed(&measured, 0.05).state;
        assert!(kept.velocity.x == 1.0 && kept.velocity.y.is_nan() && !kept.is_valid());
    }

    #[test]
    fn a_reading_that_cannot_be_leaves_no_trace_in_the_velocities() {
        let mut motion = Motion::new();
        motion.completed(&reading(0.0, 0.0), 0.0);
        let mut bad = reading(f64::NAN, 0.0);
        assert!(!motion.completed(&bad, 1e-3).state.is_valid());
        bad = reading(0.0, 0.0);
        bad.pose.orientation = [0.0; 4];
        assert!(!motion.completed(&bad, 2e-3).state.is_valid());
        let good = motion.completed(&reading(3e-4, 0.0), 3e-3);
        assert!((good.state.velocity.x - 0.1).abs() < 1e-9, "{good:?}");
    }
}
