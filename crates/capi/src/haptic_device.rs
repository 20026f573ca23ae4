//! A haptic device that the calling program supplies as callbacks: the structs that the callbacks receive, and the
//! [`Device`] by which the haptic loop calls them. The haptic loop runs at a fixed rate; in each of its ticks the loop
//! reads the device and plays a force, that is, commands the force to the device.

use std::cell::Cell;
use std::ffi::{c_char, c_void};

use glam::{DQuat, DVec3};
use palpate::internal::haptics::velocity::AdaptiveWindow;
use palpate::internal::haptics::{Device, Fault, Reading};
use palpate::internal::step::trajectory::rotation_vector;
use palpate::scene::profile::PROFILES;
use palpate::scene::{Haptics, Profile};
use palpate::{RigidState, Wrench};

use super::simulation::palpate_pose;
use super::sized::{self, Field, Sized32, fields};
use super::status::{Failure, Outcome, palpate_status};

/// Assumed resolution of a device's angles, rad. The estimate of velocities that a device does not measure needs this
/// bound on the error of a pose.
const ANGULAR_RESOLUTION: f64 = 5e-4;

/// State of a haptic device in world axes, as the callback `read` reports it. Before each call the library fills every
/// field as described below; the callback overwrites the fields that it knows.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_reading {
    /// Size of this struct in the library, bytes: the callback must not write beyond it.
    pub size: u32,
    /// Buttons, one bit each, the first in the lowest bit; 1: pressed. Filled with 0.
    pub buttons: u32,
    /// Time at which the state was measured, s on the loop's clock. Filled with the time of the call.
    pub time: f64,
    /// Pose of the device. The callback must write the position. The orientation is filled with the identity, which a
    /// device that senses no rotation leaves as it is.
    pub pose: palpate_pose,
    /// Velocity, m/s. Filled with NaN; if NaN is left there, the library estimates the velocity from the positions.
    pub velocity: [f64; 3],
    /// Angular velocity, rad/s. Filled with NaN; if NaN is left there, the library estimates the angular velocity from
    /// the orientations.
    pub angular_velocity: [f64; 3],
}

/// Force and torque that a haptic device is to play until the next call of `write`, in world axes. They are always
/// finite, and within the limits of the device's profile (the limits of a type of device).
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_play {
    /// Size of this struct in the library, bytes: the callback must not read beyond it.
    pub size: u32,
    /// Reserved: always 0.
    pub reserved: u32,
    /// Force on the user's hand, N.
    pub force: [f64; 3],
    /// Torque on the user's hand about the device's position, N m; zero where the profile allows no torque.
    pub torque: [f64; 3],
}

/// A haptic device made of the caller's callbacks. The callbacks run on threads of the loop, never two of one device at
/// a time; those of several devices do. They return 0 on success; any other value means that the device is lost for now:
/// nothing is played, and the device is tried again at the next tick. The loop ends when its device, of several all of
/// them, is lost for 5 s. No callback may wait for longer than a small part of a tick, or let an exception or a longjmp
/// out. `palpate_loop_stop` and `palpate_loop_destroy` called from within a callback only ask the loop to end.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_haptic_device {
    /// Size of the struct in bytes: sizeof(palpate_haptic_device).
    pub size: u32,
    /// Reserved: must be 0.
    pub reserved: u32,
    /// Pointer that is passed to each callback; the library does not use it otherwise. What it points to must stay
    /// valid until the loop has ended.
    pub user: *mut c_void,
    /// Prepares the device; called once, before the other callbacks. Null: there is nothing to prepare. If `open`
    /// returns other than 0, the loop does not begin, and `close` is not called.
    pub open: Option<unsafe extern "C" fn(user: *mut c_void) -> i32>,
    /// Reads the state of the device at `time`, s on the loop's clock; called once per tick. The loop rejects a reading
    /// that has numbers that are not finite, an orientation that is no rotation, or a pose that a hand cannot have
    /// reached since the last reading.
    pub read: Option<unsafe extern "C" fn(user: *mut c_void, time: f64, reading: *mut palpate_reading) -> i32>,
    /// Plays force and torque until the next call; called once per tick. Called with zero force and torque after `open`
    /// and before `close`.
    pub write: Option<unsafe extern "C" fn(user: *mut c_void, play: *const palpate_play) -> i32>,
    /// Releases the device; called once at the end, whatever happened, if `open` returned 0. Null: there is nothing to
    /// release.
    pub close: Option<unsafe extern "C" fn(user: *mut c_void)>,
    /// Name of the profile, which holds the limits of the device: "scripted", "premium", "touch", "omega.x", "delta.6",
    /// "sigma.7", "falcon", "inverse3", "minverse" or "mouse" (docs/reference/scene.md). Null: the scene's
    /// `haptics.profile`, for a tool after the first that of the tool.
    pub profile: *const c_char,
}

// SAFETY: the struct is `repr(C)`, its first field is the size, and any bytes are a valid value of its numbers and
// pointers; a pointer is followed only under the rules of the comment at the top of palpate.h.
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

/// Returns whether this thread runs inside a callback; if it does, it must not wait for the end of a loop.
pub(super) fn is_in_callback() -> bool {
    IS_CALLED.get()
}

/// The caller's callbacks as a [`Device`], which the loop reads and writes.
pub(super) struct Callbacks {
    calls: palpate_haptic_device,
    read: unsafe extern "C" fn(*mut c_void, f64, *mut palpate_reading) -> i32,
    write: unsafe extern "C" fn(*mut c_void, *const palpate_play) -> i32,
    profile: Profile,
    motion: Motion,
}

// SAFETY: only the callbacks use the data to which `user` points, and the header states that they run on the loop's
// threads.
unsafe impl Send for Callbacks {}

impl Callbacks {
    /// Checks the caller's struct `calls`, which messages call `name`. The profile of the scene's settings `haptics`, whose
    /// key is `key`, is taken where the struct names none.
    ///
    /// # Safety
    /// The conditions of the header for a `palpate_haptic_device` hold for `calls`.
    pub unsafe fn new(calls: palpate_haptic_device, name: &str, haptics: &Haptics, key: &str) -> Outcome<Callbacks> {
        let null =
            |what: &str| Failure::new(palpate_status::Null, format!("{name}.{what} is null, but it is required"));
        if calls.reserved != 0 {
            let problem = format!("{name}.reserved is {}; set it to 0", calls.reserved);
            return Err(Failure::new(palpate_status::Argument, problem));
        }
        let read = calls.read.ok_or_else(|| null("read"))?;
        let write = calls.write.ok_or_else(|| null("write"))?;
        let names = || PROFILES.map(|profile| profile.name).join(", ");
        let wrong = |what: String| Failure::new(palpate_status::Argument, format!("{what}; give one of {}", names()));
        let profile = match (calls.profile.is_null(), haptics.profile) {
            (true, Some(profile)) => profile,
            (true, None) => {
                return Err(wrong(format!("{name}.profile is null, and the scene has no {key}.profile")));
            }
            (false, _) => {
                let key = format!("{name}.profile");
                // SAFETY: the caller keeps the conditions under `# Safety`.
                let profile = unsafe { sized::string(calls.profile, &key)? };
                Profile::named(profile).ok_or_else(|| wrong(format!("{key} is `{profile}`")))?
            }
        };
        let profile = Profile { resolution: haptics.resolution.or(profile.resolution), ..profile.clone() };
        let motion = Motion::new(profile.step());
        Ok(Callbacks { calls, read, write, profile, motion })
    }

    /// Calls a callback with the caller's `user` and returns its result; meanwhile [`is_in_callback`] is true on this
    /// thread.
    fn call<R>(&self, callback: impl FnOnce(*mut c_void) -> R) -> R {
        IS_CALLED.set(true);
        let given = callback(self.calls.user);
        IS_CALLED.set(false);
        given
    }
}

/// Turns the status of a callback into a result. The fault has no message, because during ticks the loop only checks
/// whether there is a fault.
fn lost(status: i32) -> Result<(), Fault> {
    if status == 0 { Ok(()) } else { Err(Fault::Lost(String::new())) }
}

impl Device for Callbacks {
    fn open(&mut self) -> Result<(), Fault> {
        let said = |name: &str, status: i32| Fault::Lost(format!("its callback {name} returned {status}"));
        if let Some(open) = self.calls.open {
            // SAFETY (all callbacks): the header demands functions that may be called with the `user` of the same
            // palpate_haptic_device.
            let status = self.call(|user| unsafe { open(user) });
            if status != 0 {
                return Err(said("open", status));
            }
        }
        self.write(&Wrench::ZERO).map_err(|_| {
            self.close();
            Fault::Lost("its callback write failed for a force of zero".into())
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
        // SAFETY: as in `open`; any bytes that the callback may write are a valid `palpate_reading`.
        lost(self.call(|user| unsafe { read(user, time, &mut reading) }))?;
        Ok(self.motion.completed(&reading, time))
    }

    fn write(&mut self, wrench: &Wrench) -> Result<(), Fault> {
        let size = size_of::<palpate_play>() as u32;
        let (force, torque) = (wrench.force.to_array(), wrench.torque.to_array());
        let play = palpate_play { size, reserved: 0, force, torque };
        let write = self.write;
        // SAFETY: as in `open`.
        lost(self.call(|user| unsafe { write(user, &play) }))
    }

    fn close(&mut self) {
        // The result is ignored: a device that is lost cannot play the zero force, and is closed nevertheless.
        let _ = self.write(&Wrench::ZERO);
        if let Some(close) = self.calls.close {
            // SAFETY: as in `open`.
            self.call(|user| unsafe { close(user) });
        }
    }
}

/// Estimates velocities from successive poses of a device, for a device that does not measure its velocities.
struct Motion {
    positions: AdaptiveWindow,
    /// The newest values of `turned`, the sum of the rotation vectors between successive readings; the slope of
    /// `turned` over time is the angular velocity.
    turns: AdaptiveWindow,
    turned: DVec3,
    last: DQuat,
}

impl Motion {
    /// An estimator for positions of this resolution, m.
    fn new(resolution: f64) -> Motion {
        let [positions, turns] = [resolution, ANGULAR_RESOLUTION].map(AdaptiveWindow::new);
        Motion { positions, turns, turned: DVec3::ZERO, last: DQuat::IDENTITY }
    }

    /// Converts the caller's reading to a [`Reading`], with estimates of the velocities that the caller left out.
    /// Impossible values are passed on, because the loop rejects them. `now` is the time of the call, s.
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
        let mut motion = Motion::new(2e-5);
        let mut last = motion.completed(&reading(0.0, 0.0), 0.0);
        assert_eq!((last.state.velocity, last.buttons), (DVec3::ZERO, 3));
        for k in 1..40 {
            let t = f64::from(k) * 1e-3;
            last = motion.completed(&reading(0.1 * t, 2.0 * t), t);
        }
        assert!((last.state.velocity - DVec3::X * 0.1).length() < 1e-9, "expected 0.1 m/s along x: {last:?}");
        assert!((last.state.angular_velocity - DVec3::Z * 2.0).length() < 1e-9, "expected 2 rad/s about z: {last:?}");
        let measured = palpate_reading { velocity: [1.0, f64::NAN, 0.0], ..reading(0.0, 0.0) };
        let kept = motion.completed(&measured, 0.05).state;
        assert!(kept.velocity.x == 1.0 && kept.velocity.y.is_nan() && !kept.is_valid());
    }

    #[test]
    fn a_reading_that_cannot_be_leaves_no_trace_in_the_velocities() {
        let mut motion = Motion::new(2e-5);
        motion.completed(&reading(0.0, 0.0), 0.0);
        let mut bad = reading(f64::NAN, 0.0);
        assert!(!motion.completed(&bad, 1e-3).state.is_valid());
        bad = reading(0.0, 0.0);
        bad.pose.orientation = [0.0; 4];
        assert!(!motion.completed(&bad, 2e-3).state.is_valid());
        let good = motion.completed(&reading(3e-4, 0.0), 3e-3);
        assert!((good.state.velocity.x - 0.1).abs() < 1e-9, "expected 0.1 m/s along x: {good:?}");
    }
}
