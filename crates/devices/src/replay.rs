//! Replay of a recorded session (one run of the haptic loop with a device, or of several loops side by side): a new servo
//! (the loop's controller) for each device gets the recorded readings and times, a new environment (source of contact
//! wrenches, usually the simulation) does the recorded steps again, and every value is compared with the recorded one, bit
//! for bit. A *tick* is one iteration of a loop.

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
    /// Name of the tool whose value it is, in a session of several haptic devices; otherwise empty.
    pub tool: String,
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

/// Words that say of which tool a tick or step is told, where there are several.
fn of_tool(tool: &str) -> String {
    if tool.is_empty() { String::new() } else { format!(" of {tool}") }
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Difference { place, tool, field, recorded, replayed } = self;
        write!(f, "{place}{} differs first in {field}: {recorded} recorded, {replayed} replayed", of_tool(tool))
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
    let ticks = recorded.header.leaders.iter().map(|_| VecDeque::new()).collect();
    let source = Source { recorded, ticks, steps: VecDeque::new(), is_over: false, is_whole: false };
    let mut replay = Replay { source, environment, loops: Vec::new(), steps: 0 };
    let difference = replay.run()?;
    let ticks = replay.loops.iter().map(|one| one.ticks).sum();
    Ok(Replayed { ticks, steps: replay.steps, is_whole: replay.source.is_whole, difference })
}

/// The recording, read ahead as far as needed: a step may be recorded after the ticks that ran while it was computed.
struct Source {
    recorded: Recorded,
    /// For each tool.
    ticks: Vec<VecDeque<Box<Tick>>>,
    steps: VecDeque<Box<Step>>,
    is_over: bool,
    is_whole: bool,
}

impl Source {
    /// Reads on until the next step is known, and the next tick of every loop that has to come to it, or the recording
    /// ends. `done`: number of ticks that each loop has done.
    fn look_ahead(&mut self, done: &[u64]) -> Result<()> {
        let lacks = |source: &Source| {
            let Some(step) = source.steps.front() else { return true };
            let mut loops = step.inputs.iter().zip(done).zip(&source.ticks);
            loops.any(|((input, done), ticks)| *done < input.ticks && ticks.is_empty())
        };
        while lacks(self) && !self.is_over {
            match self.recorded.next().transpose()? {
                Some(Entry::Tick(index, tick)) => self.ticks[index].push_back(tick),
                Some(Entry::Step(step)) => self.steps.push_back(step),
                Some(Entry::Begin(..)) => return Err(self.wrong("the settings of the haptic loop come twice".into())),
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
    loops: Vec<Loop>,
    /// Number of steps whose values all agree with the recording.
    steps: u64,
}

/// The haptic loop of one tool.
struct Loop {
    /// Name of the tool where there are several.
    tool: String,
    servo: Servo,
    /// Contact wrenches that the servo may still take, in ascending order of their steps.
    wrenches: VecDeque<ContactWrench>,
    /// Number of ticks whose values all agree with the recording.
    ticks: u64,
}

impl Loop {
    /// Whether the loop has not come to the tick from which a step starts for the tool `index`.
    fn is_before(&self, step: &Step, index: usize) -> bool {
        self.ticks < step.inputs[index].ticks
    }
}

impl Replay<'_> {
    fn run(&mut self) -> Result<Option<Difference>> {
        let tools = self.source.recorded.header.leaders.clone();
        for (index, leader) in tools.iter().enumerate() {
            let begin = match self.source.recorded.next().transpose()? {
                Some(Entry::Begin(of, begin)) if of == index => begin,
                // The file was cut short before the session began.
                None => return Ok(None),
                Some(_) => return Err(self.source.wrong("the settings of the haptic loop do not come first".into())),
            };
            if let Some(problem) = problem_of(&begin.settings) {
                return Err(self.source.wrong(problem));
            }
            let Begin { settings, tool } = *begin;
            let name = if tools.len() > 1 { leader.tool.clone() } else { String::new() };
            let servo = Servo::new(settings, tool);
            self.loops.push(Loop { tool: name, servo, wrenches: VecDeque::new(), ticks: 0 });
        }
        loop {
            let done: Vec<u64> = self.loops.iter().map(|one| one.ticks).collect();
            self.source.look_ahead(&done)?;
            // A loop whose ticks are at the next step waits until the others have come there too.
            let step = self.source.steps.front();
            if let Some(step) = step
                && !self.loops.iter().enumerate().any(|(index, one)| one.is_before(step, index))
            {
                let step = self.source.steps.pop_front();
                if let Some(difference) = step.map_or(Ok(None), |step| self.step(&step))? {
                    return Ok(Some(difference));
                }
                continue;
            }
            let comes = |(index, one): &(usize, &Loop)| step.is_none_or(|step| one.is_before(step, *index));
            let has_tick = |index: &usize| !self.source.ticks[*index].is_empty();
            let next = self.loops.iter().enumerate().filter(comes).map(|(index, _)| index).find(has_tick);
            let Some(index) = next else { break };
            let Some(tick) = self.source.ticks[index].pop_front() else { break };
            let Some(offered) = self.offered(&tick, index)? else { return Ok(None) };
            if let Some(difference) = self.tick(&tick, index, &offered) {
                return Ok(Some(difference));
            }
        }
        match self.source.steps.front() {
            Some(step) if self.source.is_whole => {
                let late = self.loops.iter().enumerate().find(|(index, one)| one.is_before(step, *index));
                let ticks = late.map_or(0, |(index, _)| step.inputs[index].ticks);
                let problem = format!("step {} starts from tick {ticks}, after the last tick", self.steps + 1);
                Err(self.source.wrong(problem))
            }
            _ => Ok(None),
        }
    }

    /// Repeats a recorded step, from the servos' present states.
    fn step(&mut self, recorded: &Step) -> Result<Option<Difference>> {
        let number = self.steps + 1;
        if let Some((input, _)) = recorded.inputs.iter().zip(&self.loops).find(|(input, one)| input.ticks < one.ticks) {
            let problem = format!("step {number} starts from tick {}, which is out of order", input.ticks);
            return Err(self.source.wrong(problem));
        }
        let h = recorded.h;
        if !(h > 0.0 && h.is_finite()) {
            return Err(self.source.wrong(format!("step {number} is {h:?} s long, which is impossible")));
        }
        let inputs: Vec<_> = self.loops.iter().map(|one| one.servo.input()).collect();
        let wrenches = self.environment.feel_each(&inputs, h)?;
        let mut difference = None;
        for (index, (one, wrench)) in self.loops.iter_mut().zip(&wrenches).enumerate() {
            let then = fields::of_step(&recorded.inputs[index], h, &recorded.wrenches[index]);
            let now = fields::of_step(&inputs[index], h, wrench);
            difference = difference.or_else(|| first_difference(Place::Step(number), &one.tool, &then, &now));
            if wrench.step > 0 {
                one.wrenches.push_back(*wrench);
            }
        }
        if difference.is_none() {
            self.steps = number;
        }
        Ok(difference)
    }

    /// The contact wrench that the servo of the tool `index` was given in a tick; `None` if the recording was cut short
    /// before that wrench's step.
    fn offered(&mut self, tick: &Tick, index: usize) -> Result<Option<ContactWrench>> {
        let Loop { tool, servo, wrenches, ticks } = &mut self.loops[index];
        let of = of_tool(tool);
        if tick.index != *ticks {
            let problem = format!("ticks {ticks} to {}{of} were lost in the recording", tick.index - 1);
            return Err(self.source.wrong(problem));
        }
        while wrenches.front().is_some_and(|wrench| wrench.step < tick.step) {
            wrenches.pop_front();
        }
        if tick.events.has(Event::BadWrench) {
            // The servo refuses a wrench that is not finite, and keeps the wrench that it had before.
            let bad = wrenches.iter().find(|wrench| wrench.step > tick.step && !wrench.is_finite());
            let is_cut_off = bad.is_none() && self.source.is_over && !self.source.is_whole;
            return Ok(if is_cut_off { None } else { Some(bad.copied().unwrap_or(servo.newest())) });
        }
        let taken = wrenches.front().filter(|wrench| wrench.step == tick.step);
        if let Some(wrench) = taken {
            return Ok(Some(*wrench));
        }
        if tick.step == servo.newest().step {
            return Ok(Some(servo.newest()));
        }
        if !self.source.is_whole && self.source.is_over && wrenches.is_empty() {
            return Ok(None);
        }
        Err(self.source.wrong(format!(
            "tick {}{of} uses the wrench of step {}, which is missing or out of order",
            tick.index, tick.step
        )))
    }

    fn tick(&mut self, recorded: &Tick, index: usize, offered: &ContactWrench) -> Option<Difference> {
        let Loop { tool, servo, ticks, .. } = &mut self.loops[index];
        let mut tick = servo.tick(recorded.time, recorded.late, reading_of(recorded), offered);
        if recorded.events.has(Event::DeviceLost) && !tick.events.has(Event::DeviceLost) {
            servo.unplayed(&mut tick);
        }
        let (then, now) = (fields::of_tick(recorded), fields::of_tick(&tick));
        let difference = first_difference(Place::Tick(tick.index), tool, &then, &now);
        *ticks += u64::from(difference.is_none());
        difference
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

fn first_difference(place: Place, tool: &str, recorded: &[Field], replayed: &[Field]) -> Option<Difference> {
    let (a, b) = recorded.iter().zip(replayed).find(|(a, b)| !a.is_same(b))?;
    Some(Difference { place, tool: tool.into(), field: a.name(), recorded: a.told(), replayed: b.told() })
}

#[cfg(test)]
mod tests;
