//! Replay of a recorded session (one run of the haptic loop with a device): a new servo (the loop's controller) gets
//! the recorded readings and times, a new environment (source of contact wrenches, usually the simulation) does the
//! recorded steps again, and every value is compared with the recorded one, bit for bit. A *tick* is one iteration of
//! the loop.

use std::collections::VecDeque;
use std::fmt;

use palpate::internal::haptics::device::{Fault, Reading};
use palpate::internal::haptics::environment::Environment;
use palpate::internal::haptics::event::Event;
use palpate::internal::haptics::safety::Limits;
use palpate::internal::haptics::servo::{Servo, Settings, Tick};
use palpate::internal::step::ContactWrench;
use palpate::{Error, Result};

use super::record::fields::{self, Field};
use super::record::{Begin, Entry, Recorded, Step};

/// Result of a replay.
#[derive(Debug, Clone, PartialEq)]
pub struct Replayed {
    /// Number of ticks whose values all agree with the recording.
    pub ticks: u64,
    /// Number of steps whose values all agree with the recording.
    pub steps: u64,
    /// Whether the recording is complete; otherwise the part of it that exists was replayed.
    pub is_whole: bool,
    /// The first difference; nothing after it was replayed.
    pub difference: Option<Difference>,
}

/// The first value in which a replay differs from its recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Difference {
    /// The tick or the step that differs.
    pub place: Place,
    /// Name of the value, as [`fields`] defines it.
    pub field: String,
    /// The value as recorded.
    pub recorded: String,
    /// The value as replayed.
    pub replayed: String,
}

/// A place in a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// A tick of the haptic loop, numbered from 0.
    Tick(u64),
    /// A step of the simulation, numbered from 1.
    Step(u64),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Place::Tick(index) => write!(f, "tick {index}"),
            Place::Step(step) => write!(f, "step {step}"),
        }
    }
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Difference { place, field, recorded, replayed } = self;
        write!(f, "{place} differs first in {field}: {recorded} recorded, {replayed} replayed")
    }
}

/// The result of reading the device in a recorded tick: the reading, or the fault.
pub fn reading_of(tick: &Tick) -> std::result::Result<Reading, Fault> {
    match tick.reading {
        Some(reading) => Ok(reading),
        None if tick.events.has(Event::BadReading) => Err(Fault::Garbled("as in the recording".into())),
        None => Err(Fault::Lost("as in the recording".into())),
    }
}

/// Replays a recording up to its end or to the first difference. The environment must be made as that of the recorded
/// session was, and must not have stepped yet. Fails if the recording holds no session that can be replayed (ticks are
/// missing, entries are out of order), and if the environment fails.
pub fn replay(recorded: Recorded, environment: &mut dyn Environment) -> Result<Replayed> {
    let mut replay = Replay {
        source: Source { recorded, ticks: VecDeque::new(), steps: VecDeque::new(), is_over: false, is_whole: false },
        environment,
        wrenches: VecDeque::new(),
        done: (0, 0),
    };
    let difference = replay.run()?;
    let (ticks, steps) = replay.done;
    Ok(Replayed { ticks, steps, is_whole: replay.source.is_whole, difference })
}

/// The recording, read ahead as far as needed: a step may be recorded after the ticks that ran while it was computed.
struct Source {
    recorded: Recorded,
    ticks: VecDeque<Box<Tick>>,
    steps: VecDeque<Box<Step>>,
    is_over: bool,
    is_whole: bool,
}

impl Source {
    /// Reads on until the next tick and the next step are known, or the recording ends.
    fn look_ahead(&mut self) -> Result<()> {
        while (self.ticks.is_empty() || self.steps.is_empty()) && !self.is_over {
            match self.recorded.next().transpose()? {
                Some(Entry::Tick(tick)) => self.ticks.push_back(tick),
                Some(Entry::Step(step)) => self.steps.push_back(step),
                Some(Entry::Begin(_)) => return Err(self.wrong("the settings of the haptic loop come twice".into())),
                Some(Entry::End(_)) => self.is_whole = true,
                None => self.is_over = true,
            }
        }
        Ok(())
    }

    fn wrong(&self, problem: String) -> Error {
        let remedy = "only an intact recording can be replayed; use an undamaged copy, or record again";
        Error::input(self.recorded.file(), None, problem, remedy)
    }
}

struct Replay<'a> {
    source: Source,
    environment: &'a mut dyn Environment,
    /// Contact wrenches that the servo may still take, in ascending order of their steps.
    wrenches: VecDeque<ContactWrench>,
    /// Numbers of ticks and of steps whose values all agree with the recording.
    done: (u64, u64),
}

impl Replay<'_> {
    fn run(&mut self) -> Result<Option<Difference>> {
        let begin = match self.source.recorded.next().transpose()? {
            Some(Entry::Begin(begin)) => begin,
            // The file was cut short before its first entry.
            None => return Ok(None),
            Some(_) => return Err(self.source.wrong("the settings of the haptic loop do not come first".into())),
        };
        if let Some(problem) = problem_of(&begin.settings) {
            return Err(self.source.wrong(problem));
        }
        let Begin { settings, tool } = *begin;
        let mut servo = Servo::new(settings, tool);
        loop {
            self.source.look_ahead()?;
            let is_due = self.source.steps.front().is_some_and(|step| step.input.ticks <= self.done.0);
            if is_due && let Some(step) = self.source.steps.pop_front() {
                if let Some(difference) = self.step(&step, &servo)? {
                    return Ok(Some(difference));
                }
                continue;
            }
            let Some(tick) = self.source.ticks.pop_front() else { break };
            let Some(offered) = self.offered(&tick, &servo)? else { return Ok(None) };
            if let Some(difference) = self.tick(&tick, &mut servo, &offered)? {
                return Ok(Some(difference));
            }
        }
        match self.source.steps.front() {
            Some(step) if self.source.is_whole => {
                let problem =
                    format!("step {} starts from tick {}, after the last tick", self.done.1 + 1, step.input.ticks);
                Err(self.source.wrong(problem))
            }
            _ => Ok(None),
        }
    }

    /// Repeats a recorded step, from the servo's present state.
    fn step(&mut self, recorded: &Step, servo: &Servo) -> Result<Option<Difference>> {
        let number = self.done.1 + 1;
        if recorded.input.ticks < self.done.0 {
            let problem = format!("step {number} starts from tick {}, which is out of order", recorded.input.ticks);
            return Err(self.source.wrong(problem));
        }
        if !(recorded.h > 0.0 && recorded.h.is_finite()) {
            return Err(self.source.wrong(format!("step {number} is {:?} s long, which is impossible", recorded.h)));
        }
        let input = servo.input();
        let wrench = self.environment.feel(&input, recorded.h)?;
        let step = Step { input, wrench, ..*recorded };
        let difference = first_difference(Place::Step(number), &fields::of_step(recorded), &fields::of_step(&step));
        if difference.is_none() {
            self.done.1 = number;
        }
        if wrench.step > 0 {
            self.wrenches.push_back(wrench);
        }
        Ok(difference)
    }

    /// The contact wrench that the servo was given in a tick; `None` if the recording was cut short before that
    /// wrench's step.
    fn offered(&mut self, tick: &Tick, servo: &Servo) -> Result<Option<ContactWrench>> {
        if tick.index != self.done.0 {
            let problem = format!("ticks {} to {} were lost in the recording", self.done.0, tick.index - 1);
            return Err(self.source.wrong(problem));
        }
        while self.wrenches.front().is_some_and(|wrench| wrench.step < tick.step) {
            self.wrenches.pop_front();
        }
        if tick.events.has(Event::BadWrench) {
            // The servo refuses a wrench that is not finite, and keeps the wrench that it had before.
            let bad = self.wrenches.iter().find(|wrench| wrench.step > tick.step && !wrench.is_finite());
            return Ok(Some(bad.copied().unwrap_or(servo.newest())));
        }
        let taken = self.wrenches.front().filter(|wrench| wrench.step == tick.step);
        if let Some(wrench) = taken {
            return Ok(Some(*wrench));
        }
        if tick.step == servo.newest().step {
            return Ok(Some(servo.newest()));
        }
        if !self.source.is_whole && self.source.is_over && self.wrenches.is_empty() {
            return Ok(None);
        }
        Err(self.source.wrong(format!(
            "tick {} uses the wrench of step {}, which is missing or out of order",
            tick.index, tick.step
        )))
    }

    fn tick(&mut self, recorded: &Tick, servo: &mut Servo, offered: &ContactWrench) -> Result<Option<Difference>> {
        let mut tick = servo.tick(recorded.time, recorded.late, reading_of(recorded), offered);
        if recorded.events.has(Event::DeviceLost) && !tick.events.has(Event::DeviceLost) {
            servo.unplayed(&mut tick);
        }
        let difference = first_difference(Place::Tick(tick.index), &fields::of_tick(recorded), &fields::of_tick(&tick));
        if difference.is_none() {
            self.done.0 += 1;
        }
        Ok(difference)
    }
}

/// The reason why no servo can be made with these settings, which may come from a damaged file; `None` if a servo can
/// be made.
fn problem_of(settings: &Settings) -> Option<String> {
    let Settings { period, limits, most_damping, trust, arm, .. } = *settings;
    let Limits { force, torque, slew, angular_slew, workspace, watchdog } = limits;
    let [linear, angular] = most_damping;
    let rest = [linear, angular, trust, arm, force, torque, slew, angular_slew, workspace, watchdog];
    if !(period > 0.0 && period.is_finite()) {
        return Some(format!("the period of the haptic loop is {period:?} s"));
    }
    let wrong = rest.into_iter().find(|x| x.is_nan() || *x < 0.0)?;
    Some(format!("a limit of the haptic loop is {wrong:?}"))
}

fn first_difference(place: Place, recorded: &[Field], replayed: &[Field]) -> Option<Difference> {
    let (a, b) = recorded.iter().zip(replayed).find(|(a, b)| !a.is_same(b))?;
    Some(Difference { place, field: a.name(), recorded: a.told(), replayed: b.told() })
}

#[cfg(test)]
mod tests;
