//! A haptic device that the program which embeds palpate implements by two functions: one returns the device's pose,
//! the other takes the wrench (force and torque) to *play*, that is to exert on the hand. A *tick* is one iteration of
//! the haptic loop.

use palpate::Wrench;
use palpate::internal::haptics::{Device, Fault, Reading};
use palpate::scene::Profile;

/// A function that returns a measurement of the device at a time, s since the loop began. The loop's thread calls it
/// once a tick.
pub type Read = Box<dyn FnMut(f64) -> Result<Reading, Fault> + Send>;
/// A function that takes the wrench that the device plays until the next call. The loop's thread calls it once a tick,
/// and with a zero wrench on opening and on closing.
pub type Write = Box<dyn FnMut(&Wrench) -> Result<(), Fault> + Send>;

/// A haptic device made of two functions, neither of which may block for longer than a small part of a tick. What the
/// functions return is passed on unchecked, because the loop itself rejects impossible poses.
pub struct Callback {
    profile: Profile,
    read: Read,
    write: Write,
}

impl Callback {
    /// A device with the limits of `profile` (limits of force, workspace and so on): a built-in profile, or one with
    /// limits that the embedding program chooses.
    ///
    /// # Errors
    /// One line that says what is wrong with the profile; see [`Profile::check`].
    pub fn new(profile: Profile, read: Read, write: Write) -> Result<Callback, String> {
        profile.check()?;
        Ok(Callback { profile, read, write })
    }
}

impl Device for Callback {
    fn open(&mut self) -> Result<(), Fault> {
        (self.write)(&Wrench::ZERO)
    }

    fn profile(&self) -> &Profile {
        &self.profile
    }

    fn read(&mut self, time: f64) -> Result<Reading, Fault> {
        (self.read)(time)
    }

    fn write(&mut self, wrench: &Wrench) -> Result<(), Fault> {
        (self.write)(wrench)
    }

    fn close(&mut self) {
        // The result is ignored: where the device is gone there is no force left to release.
        let _ = (self.write)(&Wrench::ZERO);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use glam::{DQuat, DVec3};
    use palpate::RigidState;
    use palpate::scene::profile::PROFILES;

    use super::*;

    fn still(time: f64) -> Result<Reading, Fault> {
        Ok(Reading { time, state: RigidState::at_rest(DVec3::Y, DQuat::IDENTITY), buttons: 5 })
    }

    #[test]
    fn the_host_reads_and_is_written_to_with_zero_at_both_ends() {
        let played = Arc::new(Mutex::new(Vec::new()));
        let heard = Arc::clone(&played);
        let write = move |wrench: &Wrench| {
            heard.lock().unwrap().push(*wrench);
            if wrench.force.x > 5.0 { Err(Fault::Lost("unplugged; plug it in".into())) } else { Ok(()) }
        };
        let mut device = Callback::new(PROFILES[2].clone(), Box::new(still), Box::new(write)).unwrap();
        let push = |x| Wrench { force: DVec3::X * x, torque: DVec3::ZERO };
        device.open().unwrap();
        assert_eq!(device.read(0.25), still(0.25));
        assert_eq!(device.write(&push(1.0)), Ok(()));
        assert_eq!(device.write(&push(6.0)), Err(Fault::Lost("unplugged; plug it in".into())));
        device.close();
        assert_eq!(*played.lock().unwrap(), [Wrench::ZERO, push(1.0), push(6.0), Wrench::ZERO]);
    }

    #[test]
    fn the_hosts_own_figures_are_checked() {
        let own = Profile { name: "own", max_force: f64::NAN, ..PROFILES[0].clone() };
        let refused = Callback::new(own, Box::new(still), Box::new(|_| Ok(()))).err().unwrap();
        assert!(
            refused.contains("own") && refused.contains("max_force"),
            "the error must name the profile and the limit that is wrong: {refused}"
        );
    }
}
