//! A haptic device that gives the readings of a recorded session (one run of the haptic loop with a device) again.

use std::path::Path;

use palpate::internal::haptics::{Device, Fault, Reading};
use palpate::scene::profile::{PROFILES, Profile};
use palpate::{Error, Result, RigidState, Wrench};

use crate::record::{Entry, Recorded};
use crate::replay::reading_of;

/// The readings of one device of a recording in their order, one for each tick (iteration of the loop): the n-th call to read gives
/// the n-th reading, faults included, whatever the time. After the last reading the device rests at its last pose. A
/// wrench written to it has no effect.
pub struct Replay {
    profile: &'static Profile,
    readings: std::vec::IntoIter<std::result::Result<Reading, Fault>>,
    last: Option<Reading>,
}

impl Replay {
    /// Reads the readings of the device that led the tool `index`: of a whole recording, or of what there is of one that was
    /// cut short.
    pub fn open(path: &Path, index: usize) -> Result<Replay> {
        let recorded = Recorded::open(path)?;
        let Some(leader) = recorded.header.leaders.get(index) else {
            let (has, asked) = (recorded.header.leaders.len(), index + 1);
            let problem =
                format!("has the readings of {has} haptic device(s), and those of number {asked} are asked for");
            return Err(Error::input(path, None, problem, "give a recording of a session with as many devices"));
        };
        let name = &leader.profile;
        let profile = Profile::named(name).ok_or_else(|| {
            let problem = format!("was recorded with the device profile \"{name}\", which is unknown");
            let known = PROFILES.each_ref().map(|profile| profile.name).join(", ");
            Error::input(path, None, problem, format!("record again with one of {known}"))
        })?;
        let mut readings = Vec::new();
        for entry in recorded {
            match entry? {
                Entry::Tick(of, tick) if of == index => readings.push(reading_of(&tick)),
                _ => {}
            }
        }
        Ok(Replay { profile, readings: readings.into_iter(), last: None })
    }

    /// Number of recorded ticks that have not been read yet.
    pub fn ticks(&self) -> usize {
        self.readings.len()
    }
}

impl Device for Replay {
    fn open(&mut self) -> std::result::Result<(), Fault> {
        Ok(())
    }

    fn profile(&self) -> &Profile {
        self.profile
    }

    fn read(&mut self, _time: f64) -> std::result::Result<Reading, Fault> {
        if let Some(reading) = self.readings.next() {
            self.last = reading.as_ref().ok().copied().or(self.last);
            return reading;
        }
        let last = self.last.ok_or_else(|| Fault::Lost("the recording has no reading of the device".into()))?;
        Ok(Reading { state: RigidState::at_rest(last.state.position, last.state.orientation), ..last })
    }

    fn write(&mut self, _wrench: &Wrench) -> std::result::Result<(), Fault> {
        Ok(())
    }

    fn close(&mut self) {}
}
