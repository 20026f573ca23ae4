//! A simulated haptic device that follows a given trajectory, whatever wrench is written to it.

use glam::{DQuat, DVec3};
use palpate::Wrench;
use palpate::internal::haptics::{Device, Fault, Reading};
use palpate::internal::step::trajectory::Trajectory;
use palpate::scene::Profile;

/// A device whose pose is a given function of time.
#[derive(Debug, Clone)]
pub struct Scripted {
    trajectory: Trajectory,
    profile: Profile,
    tick: f64,
}

impl Scripted {
    /// A device that follows `trajectory`, with the limits of `profile`. `tick` is the time between readings, s; the
    /// velocity in a reading is the mean velocity over the tick before the reading.
    pub fn new(trajectory: Trajectory, profile: Profile, tick: f64) -> Scripted {
        Scripted { trajectory, profile, tick }
    }
}

impl Device for Scripted {
    fn open(&mut self) -> Result<(), Fault> {
        Ok(())
    }

    fn profile(&self) -> &Profile {
        &self.profile
    }

    fn read(&mut self, time: f64) -> Result<Reading, Fault> {
        let mut state = self.trajectory.device(time, self.tick);
        if !self.profile.senses_rotation {
            (state.orientation, state.angular_velocity) = (DQuat::IDENTITY, DVec3::ZERO);
        }
        Ok(Reading { time, state, buttons: 0 })
    }

    fn write(&mut self, _: &Wrench) -> Result<(), Fault> {
        Ok(())
    }

    fn close(&mut self) {}
}

#[cfg(test)]
mod tests {
    use palpate::scene::Key;
    use palpate::scene::profile::PROFILES;

    use super::*;

    fn key(time: f64, x: f64, angle: f64) -> Key {
        Key { time, position: DVec3::X * x, orientation: DQuat::from_rotation_y(angle) }
    }

    #[test]
    fn readings_are_the_drive_with_the_last_ticks_twist() {
        for profile in PROFILES {
            let trajectory = Trajectory::new(&[key(1.0, 0.0, 0.0), key(3.0, 4.0, 1.0)], key(0.0, 0.0, 0.0));
            let mut device = Scripted::new(trajectory.clone(), profile.clone(), 1e-3);
            assert_eq!(device.profile(), &profile);
            device.open().unwrap();
            for time in [0.0, 1.0, 1.0005, 2.0, 2.9, 3.0005, 7.0] {
                let reading = device.read(time).unwrap();
                let expected = trajectory.device(time, 1e-3);
                assert_eq!((reading.time, reading.buttons), (time, 0));
                assert_eq!((reading.state.position, reading.state.velocity), (expected.position, expected.velocity));
                let turned = if profile.senses_rotation {
                    (expected.orientation, expected.angular_velocity)
                } else {
                    (DQuat::IDENTITY, DVec3::ZERO)
                };
                assert_eq!(
                    (reading.state.orientation, reading.state.angular_velocity),
                    turned,
                    "orientation and angular velocity with the profile {}",
                    profile.name
                );
                device.write(&Wrench { force: DVec3::ONE, torque: DVec3::ONE }).unwrap();
            }
            assert!((device.read(1.0005).unwrap().state.velocity.x - 1.0).abs() < 1e-9);
            device.close();
        }
    }
}
