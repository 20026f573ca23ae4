//! A device held: the loop in its thread, the simulation step after step in this one, and what came of it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use super::clock::Lateness;
use super::coupling;
use super::device::Device;
use super::environment::Environment;
use super::event::{Event, EventCounts};
use super::local_model::LocalModel;
use super::pace::Pace;
use super::passivity::Energy;
use super::safety::Limits;
use super::servo::{Servo, Settings, Tick};
use super::servo_thread::{BareTimer, ServoThread};
use crate::scene::Haptics;
use crate::step::tool::Tool;
use crate::step::{ContactWrench, Held, Wrench};
use crate::{Error, Result};

/// Steps before the loop begins, to learn how long one takes.
const FIRST_STEPS: u32 = 5;
/// A device that is lost for longer ends the session, s.
const LONGEST_LOSS: f64 = 5.0;
/// Forces below which K says nothing about what is felt, N.
const FELT: f64 = 0.02;

/// What a session is begun with.
pub struct Options {
    /// How long it lasts, s.
    pub seconds: f64,
    /// Shortest step of the simulation, s: the scene's.
    pub shortest_step: f64,
    /// Set from outside, it ends the session.
    pub stop: Arc<AtomicBool>,
    /// Whether a bare timer runs beside the loop, to compare its ticks with.
    pub bare_timer: bool,
}

/// What a session records, in order.
#[derive(Debug, Clone, Copy)]
pub enum Moment<'a> {
    /// Something the user should know before the loop begins.
    Note(&'a str),
    /// The servo as it begins.
    Begin(&'a Settings, &'a Tool),
    /// A tick of the loop.
    Tick(&'a Tick),
    /// A step of the simulation: what it started from, its length (s), what it found.
    Step(&'a Held, f64, &'a ContactWrench),
}

/// What came of a session.
#[derive(Debug, Clone)]
pub struct Report {
    /// The device's profile.
    pub profile: &'static str,
    /// Why the coupling's gains are what they are, and what else is to be known: a line each.
    pub notes: Vec<String>,
    /// Of the loop.
    pub lateness: Lateness,
    /// Of the bare timer beside it.
    pub bare: Option<Lateness>,
    /// Of the newest wrench, at every tick that had one.
    pub age: Ages,
    /// Events.
    pub events: EventCounts,
    /// What went between hand and device.
    pub energy: Energy,
    /// Greatest force that was played, N.
    pub peak_force: f64,
    /// What was played in the last tick before the end, and what contact pushed the tool with then.
    pub end: [Wrench; 2],
    /// Sums of the force changes that K foretold and of those that came, N: how far K overestimates what is felt.
    pub foretold: (f64, f64),
    /// Steps of the simulation while the loop ran.
    pub steps: u64,
    /// Simulated time by time that passed: below 1 bodies moved slower than in the world.
    pub pace: f64,
    /// Ticks that were done and are neither counted here nor recorded, nobody having taken them in time.
    pub lost: u64,
    /// Why it ended before its time, where it did.
    pub ended: Option<String>,
}

impl Report {
    /// How many times what is felt K foretells; `None`: too little was felt to say.
    pub fn overestimate(&self) -> Option<f64> {
        let (foretold, came) = self.foretold;
        (came > FELT).then(|| foretold / came)
    }
}

/// How old wrenches were: to the microsecond up to a tenth of a second, to half a percent up to 1000 s.
#[derive(Debug, Clone)]
pub struct Ages(Lateness);

impl Ages {
    /// Nothing yet.
    pub fn new() -> Ages {
        Ages(Lateness::new())
    }

    /// Adds the age of the newest wrench at a tick, s.
    fn add(&mut self, age: f64) {
        self.0.add(age, f64::INFINITY);
    }

    /// The age that a share of the ticks stays within, s; 0 without any.
    pub fn quantile(&self, share: f64) -> f64 {
        if self.0.ticks() == 0 { 0.0 } else { self.0.quantile(share) }
    }
}

impl Default for Ages {
    fn default() -> Self {
        Ages::new()
    }
}

/// Holds a device until its time is over, or `options.stop` is set, or the device stays lost. `record` hears everything in
/// order. The device plays nothing and is closed at the end, however that comes.
pub fn hold(
    device: Box<dyn Device>,
    tool: &Tool,
    haptics: &Haptics,
    environment: &mut dyn Environment,
    options: &Options,
    mut record: impl FnMut(Moment) -> Result<()>,
) -> Result<Report> {
    let mut notes = device.notes();
    let profile = device.profile().clone();
    let (limits, refused) = Limits::new(&profile, &haptics.limits);
    for key in refused {
        notes.push(format!("haptics.{key} is above what the profile {} allows, which holds", profile.name));
    }
    let first = first_steps(environment, tool, options.shortest_step, limits.force)?;
    let period = 1.0 / haptics.rate;
    let delay = if haptics.local_model { 0.0 } else { first.age };
    let inertia = (0..3).map(|k| tool.inertia.col(k)[k]).sum::<f64>() / 3.0;
    let gains = coupling::choose(&profile, period, delay, tool.mass, inertia, tool.coupling.as_ref());
    notes.push(gains.reason);
    let settings = Settings {
        period,
        limits,
        local_model: haptics.local_model,
        passivity: haptics.passivity,
        most_damping: gains.most_damping,
        trust: haptics.trust,
        arm: (inertia / tool.mass).sqrt(),
    };
    let tool = Tool { coupling: Some(gains.coupling), ..tool.clone() };
    record(Moment::Begin(&settings, &tool))?;
    for (held, wrench) in &first.steps {
        record(Moment::Step(held, options.shortest_step, wrench))?;
    }
    let servo = Servo::new(settings, tool);
    let bare = options.bare_timer.then(|| BareTimer::start(period));
    let thread = ServoThread::start(device, servo, options.stop.clone());
    let thread = thread.map_err(|fault| Error::NoDevice(fault.to_string()))?;
    if let Err(reason) = &thread.priority {
        notes.push(format!(
            "the loop has no elevated priority ({reason}): allow real-time scheduling for fewer late ticks"
        ));
    }
    notes.iter().try_for_each(|note| record(Moment::Note(note)))?;
    let mut session = Session::new(thread, profile.name, notes, period, &settings);
    if let Some((_, wrench)) = first.steps.last() {
        session.thread.give(*wrench);
    }
    let ended = session.run(environment, options, haptics, &first, &mut record);
    let has_failed = !session.thread.stop();
    let taken = session.take_ticks(&mut record);
    session.report.lost = session.thread.newest().ticks.saturating_sub(session.report.lateness.ticks());
    session.report.bare = bare.and_then(BareTimer::stop);
    ended.and(taken)?;
    match has_failed {
        true => Err(Error::Simulation("the haptic loop failed; its device was let go of".into())),
        false => Ok(session.report),
    }
}

/// What was learned before the loop began.
struct FirstSteps {
    steps: Vec<(Held, ContactWrench)>,
    /// How long one takes, s.
    took: f64,
    /// How old its wrench becomes at most: it is the newest until the next is there, s.
    age: f64,
}

/// Steps with the tool at rest, coupled to nothing: the first is not counted, for it is slow on many drivers.
fn first_steps(environment: &mut dyn Environment, tool: &Tool, h: f64, max_force: f64) -> Result<FirstSteps> {
    let state = tool.state();
    let held = Held { ticks: 0, time: 0.0, device: state, tool: state, coupling: None, max_force };
    let (mut steps, mut times) = (Vec::new(), Vec::new());
    for _ in 0..FIRST_STEPS {
        let begun = Instant::now();
        steps.push((held, environment.feel(&held, h)?));
        times.push(begun.elapsed().as_secs_f64());
    }
    times.remove(0);
    times.sort_unstable_by(f64::total_cmp);
    let took = times[times.len() / 2].max(h);
    Ok(FirstSteps { steps, took, age: 2.0 * took })
}

struct Session {
    thread: ServoThread,
    report: Report,
    period: f64,
    settings: Settings,
    before: Option<(LocalModel, ContactWrench)>,
    lost_since: Option<f64>,
}

impl Session {
    fn new(
        thread: ServoThread,
        profile: &'static str,
        notes: Vec<String>,
        period: f64,
        settings: &Settings,
    ) -> Session {
        let report = Report {
            profile,
            notes,
            lateness: Lateness::new(),
            bare: None,
            age: Ages::default(),
            events: EventCounts::default(),
            energy: Energy::default(),
            peak_force: 0.0,
            end: [Wrench::ZERO; 2],
            foretold: (0.0, 0.0),
            steps: 0,
            pace: 1.0,
            lost: 0,
            ended: None,
        };
        Session { thread, report, period, settings: *settings, before: None, lost_since: None }
    }

    /// Steps as long as they take, so that bodies move as in the world, but no longer than the scene allows.
    fn run(
        &mut self,
        environment: &mut dyn Environment,
        options: &Options,
        haptics: &Haptics,
        first: &FirstSteps,
        record: &mut impl FnMut(Moment) -> Result<()>,
    ) -> Result<()> {
        let mut pace = Pace::new(options.shortest_step, haptics.longest_step, first.took);
        let mut simulated = 0.0;
        while self.thread.newest().ticks == 0 && self.thread.is_running() {
            std::thread::sleep(Duration::from_secs_f64(self.period));
        }
        let begun = self.thread.now();
        let (mut last, mut ahead) = (begun, 0.0);
        while self.goes_on(options) {
            let (start, held) = (self.thread.now(), self.thread.newest());
            let h = pace.length();
            let wrench = environment.feel(&held, h)?;
            self.thread.give(wrench);
            simulated += h;
            self.report.steps += 1;
            self.compare(&wrench);
            record(Moment::Step(&held, h, &wrench))?;
            self.take_ticks(record)?;
            // A step that was done before its time waits for the world.
            let now = self.thread.now();
            pace.took(now - start, now);
            // Steps that are done before their time wait for the world; a step that took longer is made up for, but no more.
            ahead = (ahead + h - (now - last)).max(-h);
            last = now;
            if ahead > 0.0 {
                std::thread::sleep(Duration::from_secs_f64(ahead));
            }
        }
        self.report.pace = simulated / (self.thread.now() - begun).max(self.period);
        Ok(())
    }

    /// Whether time is left and all is in order; says what is not.
    fn goes_on(&mut self, options: &Options) -> bool {
        let now = self.thread.now();
        let loss = self.lost_since.map_or(0.0, |since| now - since);
        let stopped = options.stop.load(Ordering::Relaxed);
        self.report.ended = match (stopped, self.thread.is_running(), loss > LONGEST_LOSS) {
            (true, ..) => Some("it was stopped".into()),
            (_, false, _) => Some("the loop failed".into()),
            (.., true) => Some(format!("the device was lost for {LONGEST_LOSS} s")),
            _ => None,
        };
        self.report.ended.is_none() && now < options.seconds
    }

    fn take_ticks(&mut self, record: &mut impl FnMut(Moment) -> Result<()>) -> Result<()> {
        let report = &mut self.report;
        for tick in self.thread.ticks() {
            report.lateness.add(tick.late, self.period);
            report.events.add(tick.events);
            report.energy = tick.energy;
            report.peak_force = report.peak_force.max(tick.played.force.length());
            report.end = [tick.played, tick.contact];
            if tick.step > 0 {
                report.age.add(tick.age);
            }
            let is_lost = tick.events.has(Event::DeviceLost);
            self.lost_since = if is_lost { self.lost_since.or(Some(tick.time)) } else { None };
            record(Moment::Tick(&tick))?;
        }
        Ok(())
    }

    /// What the model of the last wrench foretold of this one.
    fn compare(&mut self, wrench: &ContactWrench) {
        if let Some((model, last)) = &self.before
            && let Some((normal, foretold)) = model.foretell(&wrench.tool)
            && last.wrench.force.length() > FELT
            && wrench.wrench.force.length() > FELT
        {
            let came = normal.dot(wrench.wrench.force - last.wrench.force);
            self.report.foretold.0 += foretold.abs();
            self.report.foretold.1 += came.abs();
        }
        self.before = Some((LocalModel::new(wrench, self.settings.arm, f64::INFINITY), *wrench));
    }
}
