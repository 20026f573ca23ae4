//! A haptic session: the haptic loop runs in its own thread, the simulation steps in the calling thread, and a report
//! on both is returned. A *tick* is one iteration of the loop; the *tool* is the rigid body that the haptic device
//! leads by a virtual *coupling* (spring and damper); a *wrench* is a force with a torque, and is *played* when it is
//! commanded to the device; the *newest wrench* is the contact wrench on the tool that the last simulation step found.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use super::clock::Lateness;
use super::coupling;
use super::device::Device;
use super::environment::Environment;
use super::event::{Event, EventCounts};
use super::pace::Pace;
use super::passivity::Energy;
use super::prediction::Prediction;
use super::safety::Limits;
use super::servo::{Servo, Settings, Tick};
use super::servo_thread::{BareTimer, ServoThread};
use crate::scene::Haptics;
use crate::step::tool::Tool;
use crate::step::{ContactWrench, DeviceInput, Wrench};
use crate::{Error, Result};

/// Number of simulation steps before the loop begins; they measure how long a step takes.
const FIRST_STEPS: u32 = 5;
/// A device that cannot be read or written for longer than this ends the session, s.
const LONGEST_LOSS: f64 = 5.0;
/// Forces below this are too small to compare the predicted with the observed stiffness, N.
const FELT: f64 = 0.02;

/// Settings of a session.
pub struct Options {
    /// Duration of the session, s.
    pub seconds: f64,
    /// Shortest step of the simulation, s, as the scene gives it.
    pub shortest_step: f64,
    /// Ends the session when another thread sets it.
    pub stop: Arc<AtomicBool>,
    /// Whether a second thread, which only wakes at the loop's deadlines, runs as a baseline for the ticks' lateness.
    pub bare_timer: bool,
}

/// A record of a session; records come in chronological order.
#[derive(Debug, Clone, Copy)]
pub enum Moment<'a> {
    /// A line that the user should read. Notes are recorded as soon as the device is open and the loop has started.
    Note(&'a str),
    /// Settings and tool of the loop at its beginning.
    Begin(&'a Settings, &'a Tool),
    /// A tick of the loop.
    Tick(&'a Tick),
    /// A step of the simulation: the state of device and tool that it started from, its length (s), and the wrench it
    /// found.
    Step(&'a DeviceInput, f64, &'a ContactWrench),
}

/// Summary of a session.
#[derive(Debug, Clone)]
pub struct Report {
    /// Name of the device's profile, which is the table of the device's limits (force, torque, stiffness and others).
    pub profile: &'static str,
    /// Notes for the user, one line each: the reason for the coupling's gains, and anything unusual at the start.
    pub notes: Vec<String>,
    /// How late the loop's ticks came.
    pub lateness: Lateness,
    /// How late the baseline thread woke, if it ran.
    pub bare: Option<Lateness>,
    /// The time by which the newest wrench was out of date, at every tick after the first wrench had arrived.
    pub staleness: Staleness,
    /// Number and duration of unusual events.
    pub events: EventCounts,
    /// Energy exchanged between hand and device.
    pub energy: Energy,
    /// The greatest force played, N.
    pub peak_force: f64,
    /// In the last tick: the wrench played, and the contact wrench on the tool.
    pub end: [Wrench; 2],
    /// Two sums over all pairs of successive wrenches, N: the magnitudes of the force changes that the local model of
    /// the earlier wrench foretold, and the magnitudes of the force changes that were observed. The ratio of the two
    /// sums is the factor by which the model overestimates the felt stiffness.
    pub foretold: (f64, f64),
    /// Number of simulation steps while the loop ran.
    pub steps: u64,
    /// Simulated time over elapsed time: below 1, bodies moved more slowly than in reality.
    pub pace: f64,
    /// Number of ticks that ran but are missing from this report and from the recording, because the queue from the
    /// loop's thread was full.
    pub lost: u64,
    /// Why the session ended early; `None` if it ran for its whole duration.
    pub ended: Option<String>,
}

impl Report {
    /// Ratio of the stiffness of the local model to the stiffness that is felt; `None` if the observed force changes
    /// are too small.
    pub fn overestimate(&self) -> Option<f64> {
        let (foretold, came) = self.foretold;
        (came > FELT).then(|| foretold / came)
    }
}

/// Statistics of the time by which wrenches were out of date. Up to 0.1 s they are exact to a microsecond; above that,
/// up to 1000 s, to half a percent.
#[derive(Debug, Clone)]
pub struct Staleness(Lateness);

impl Staleness {
    /// Empty statistics.
    pub fn new() -> Staleness {
        Staleness(Lateness::new())
    }

    /// Adds the time (s) by which the newest wrench was out of date at a tick.
    fn add(&mut self, staleness: f64) {
        self.0.add(staleness, f64::INFINITY);
    }

    /// The staleness (time by which the newest wrench was out of date), s, that a `share` (0 to 1) of the ticks does
    /// not exceed; 0 if there was no tick.
    pub fn quantile(&self, share: f64) -> f64 {
        if self.0.ticks() == 0 { 0.0 } else { self.0.quantile(share) }
    }
}

impl Default for Staleness {
    fn default() -> Self {
        Staleness::new()
    }
}

/// Runs a session until its time is over, `options.stop` is set, or the device cannot be read or written for too long.
/// `record` is called with every record, in order. However the session ends, the device then exerts no force and is
/// closed.
pub fn hold(
    device: Box<dyn Device>,
    tool: &Tool,
    haptics: &Haptics,
    environment: &mut dyn Environment,
    options: &Options,
    mut record: impl FnMut(Moment) -> Result<()>,
) -> Result<Report> {
    let mut notes = device.notes();
    let mut profile = device.profile().clone();
    profile.resolution = haptics.resolution.or(profile.resolution);
    let (limits, refused) = Limits::new(&profile, &haptics.limits);
    for key in refused {
        notes.push(format!("haptics.{key} exceeds the limit of profile {}; the profile's limit is used", profile.name));
    }
    let first = first_steps(environment, tool, options.shortest_step, limits.force)?;
    let period = 1.0 / haptics.rate;
    let delay = if haptics.local_model { 0.0 } else { first.staleness };
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
        resolution: profile.step(),
    };
    let tool = Tool { coupling: Some(gains.coupling), ..tool.clone() };
    record(Moment::Begin(&settings, &tool))?;
    for (input, wrench) in &first.steps {
        record(Moment::Step(input, options.shortest_step, wrench))?;
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
        true => Err(Error::Simulation("the haptic loop's thread panicked; the device was released".into())),
        false => Ok(session.report),
    }
}

/// Results of the simulation steps that run before the loop begins.
struct FirstSteps {
    steps: Vec<(DeviceInput, ContactWrench)>,
    /// Wall-clock time of one step, s.
    took: f64,
    /// Greatest time by which a wrench gets out of date, s: a wrench stays the newest until the next step has finished.
    /// This is twice the time of a step.
    staleness: f64,
}

/// Simulates [`FIRST_STEPS`] steps with the tool at rest and uncoupled. The first step is not timed, because many GPU
/// drivers are slow in it.
fn first_steps(environment: &mut dyn Environment, tool: &Tool, h: f64, max_force: f64) -> Result<FirstSteps> {
    let state = tool.state();
    let input = DeviceInput { ticks: 0, time: 0.0, device: state, tool: state, coupling: None, max_force };
    let (mut steps, mut times) = (Vec::new(), Vec::new());
    for _ in 0..FIRST_STEPS {
        let begun = Instant::now();
        steps.push((input, environment.feel(&input, h)?));
        times.push(begun.elapsed().as_secs_f64());
        environment.after()?;
    }
    times.remove(0);
    times.sort_unstable_by(f64::total_cmp);
    let took = times[times.len() / 2].max(h);
    Ok(FirstSteps { steps, took, staleness: 2.0 * took })
}

struct Session {
    thread: ServoThread,
    report: Report,
    period: f64,
    prediction: Prediction,
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
            staleness: Staleness::default(),
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
        Session { thread, report, period, prediction: Prediction::new(settings.arm), lost_since: None }
    }

    /// Simulates steps until the session ends. A step simulates as much time as computing a step takes, so that bodies
    /// move in real time; this length is at most the scene's longest step.
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
            let (start, input) = (self.thread.now(), self.thread.newest());
            let h = pace.length();
            let wrench = environment.feel(&input, h)?;
            self.thread.give(wrench);
            environment.after()?;
            simulated += h;
            self.report.steps += 1;
            self.compare(&wrench);
            record(Moment::Step(&input, h, &wrench))?;
            self.take_ticks(record)?;
            let now = self.thread.now();
            pace.took(now - start, now);
            // If simulated time is ahead of real time, the thread waits. If simulated time is behind, the following
            // steps catch up by at most the length of one step.
            ahead = (ahead + h - (now - last)).max(-h);
            last = now;
            if ahead > 0.0 {
                std::thread::sleep(Duration::from_secs_f64(ahead));
            }
        }
        self.report.pace = simulated / (self.thread.now() - begun).max(self.period);
        Ok(())
    }

    /// Whether the session goes on. If it must end before its time is over, the reason is written into the report.
    fn goes_on(&mut self, options: &Options) -> bool {
        let now = self.thread.now();
        let loss = self.lost_since.map_or(0.0, |since| now - since);
        let stopped = options.stop.load(Ordering::Relaxed);
        self.report.ended = match (stopped, self.thread.is_running(), loss > LONGEST_LOSS) {
            (true, ..) => Some("it was stopped".into()),
            (_, false, _) => Some("the loop's thread panicked".into()),
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
                report.staleness.add(tick.staleness);
            }
            let is_lost = tick.events.has(Event::DeviceLost);
            self.lost_since = if is_lost { self.lost_since.or(Some(tick.time)) } else { None };
            record(Moment::Tick(&tick))?;
        }
        Ok(())
    }

    /// Adds the predicted and the observed change of force from the previous wrench to this one.
    fn compare(&mut self, wrench: &ContactWrench) {
        if let Some([predicted, observed]) = self.prediction.take(wrench) {
            self.report.foretold.0 += predicted.abs();
            self.report.foretold.1 += observed.abs();
        }
    }
}
