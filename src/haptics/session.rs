//! A haptic session: the haptic loop runs in its own thread, the simulation steps in the calling thread, and a report
//! on both is returned. A *tick* is one iteration of the loop; the *tool* is the rigid body that the haptic device
//! leads by a virtual *coupling* (spring and damper); a *wrench* is a force with a torque, and is *played* when it is
//! commanded to the device; the *newest wrench* is the contact wrench on the tool that the last simulation step found.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use super::clock::Lateness;
use super::coupling;
use super::device::{Device, Fault};
use super::environment::Environment;
use super::event::{Event, EventCounts};
use super::pace::Pace;
use super::passivity::Energy;
use super::prediction::Prediction;
use super::safety::Limits;
use super::servo::{Servo, Settings, Tick};
use super::servo_thread::{BareTimer, Opened, ServoThread};
use crate::scene::{Haptics, Profile};
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

/// A record of a session. The steps come in their order, and so do the ticks of each loop.
#[derive(Debug, Clone, Copy)]
pub enum Moment<'a> {
    /// A line that the user should read. Notes are recorded as soon as all devices are open and all loops have started.
    Note(&'a str),
    /// Settings and tool of a loop at its beginning, with the index of its tool.
    Begin(usize, &'a Settings, &'a Tool),
    /// A tick of the loop of this tool.
    Tick(usize, &'a Tick),
    /// A step of the simulation: the states of devices and tools that it started from, its length (s), and the wrenches it
    /// found, one for each device.
    Step(&'a [DeviceInput], f64, &'a [ContactWrench]),
}

/// Summary of a session.
#[derive(Debug, Clone)]
pub struct Report {
    /// Name of the tool that the device led, as [`Leader::name`] gives it; empty in a session of one device.
    pub tool: String,
    /// Name of the device's profile, which is the table of the device's limits (force, torque, stiffness and others).
    pub profile: &'static str,
    /// Notes for the user, one line each: the reason for the coupling's gains, and anything unusual at the start.
    pub notes: Vec<String>,
    /// How late the loop's ticks came.
    pub lateness: Lateness,
    /// How late the baseline thread woke, if it ran; of several devices the first one's report has it.
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

/// A haptic device and the tool that it leads.
pub struct Leader {
    /// Name of the tool, which stands before the notes on it in a session of several devices.
    pub name: String,
    /// The device, not opened yet.
    pub device: Box<dyn Device>,
    /// The tool in its state at the beginning.
    pub tool: Tool,
    /// Settings of the device's haptic loop.
    pub haptics: Haptics,
}

/// Like [`hold_each`], with one device.
pub fn hold(
    device: Box<dyn Device>,
    tool: &Tool,
    haptics: &Haptics,
    environment: &mut dyn Environment,
    options: &Options,
    record: impl FnMut(Moment) -> Result<()>,
) -> Result<Report> {
    let leader = Leader { name: String::new(), device, tool: tool.clone(), haptics: haptics.clone() };
    hold_each(vec![leader], environment, options, record).map(|mut reports| reports.remove(0))
}

/// Runs a session until its time is over, `options.stop` is set, or no device can be read or written for too long. The
/// devices lead the first tools in the scene's order, each in a haptic loop of its own; all loops have one clock. A loop
/// knows nothing of the others, so that a fault of one device leaves the others' forces as they are. `record` is called
/// with every record, in order. However the session ends, the devices then exert no force and are closed. The result has
/// a report for each device.
pub fn hold_each(
    mut leaders: Vec<Leader>,
    environment: &mut dyn Environment,
    options: &Options,
    mut record: impl FnMut(Moment) -> Result<()>,
) -> Result<Vec<Report>> {
    if leaders.is_empty() {
        return Err(Error::Usage("a session needs a haptic device; give one".into()));
    }
    let longest_step = leaders.iter().map(|leader| leader.haptics.longest_step).fold(f64::INFINITY, f64::min);
    if let [alone] = &mut leaders[..] {
        // Nobody has to be told which tool is meant.
        alone.name.clear();
    }
    let mut prepared: Vec<Prepared> = leaders.into_iter().map(Prepared::new).collect();
    let first = first_steps(environment, &prepared, options.shortest_step)?;
    let mut servos = Vec::new();
    for (index, leader) in prepared.iter_mut().enumerate() {
        let (settings, tool) = leader.settings(first.staleness);
        record(Moment::Begin(index, &settings, &tool))?;
        servos.push((settings, Servo::new(settings, tool)));
    }
    for (inputs, wrenches) in &first.steps {
        record(Moment::Step(inputs, options.shortest_step, wrenches))?;
    }
    let bare = options.bare_timer.then(|| BareTimer::start(servos[0].0.period));
    let no_device = |tool: &str, fault: Fault| Error::NoDevice(format!("{}{fault}", before_notes(tool)));
    let mut opened = Vec::new();
    for Prepared { leader, profile, notes, .. } in prepared {
        let device = Opened::new(leader.device).map_err(|fault| no_device(&leader.name, fault))?;
        opened.push((device, leader.name, profile.name, notes));
    }
    let begun = Instant::now();
    let mut session = Session { loops: Vec::new(), ended: None, steps: 0, pace: 1.0 };
    for ((device, tool, profile, mut notes), (settings, servo)) in opened.into_iter().zip(servos) {
        let thread = ServoThread::start(device, servo, options.stop.clone(), begun);
        let thread = thread.map_err(|fault| no_device(&tool, fault))?;
        if let Err(reason) = &thread.priority {
            let why = format!("the loop has no elevated priority ({reason})");
            notes.push(format!("{}{why}: allow real-time scheduling for fewer late ticks", before_notes(&tool)));
        }
        session.loops.push(Loop::new(thread, tool, profile, notes, &settings));
    }
    let mut notes = session.loops.iter().flat_map(|one| &one.report.notes);
    notes.try_for_each(|note| record(Moment::Note(note)))?;
    if let Some((_, wrenches)) = first.steps.last() {
        session.give(wrenches);
    }
    let ended = session.run(environment, options, longest_step, &first, &mut record);
    // The flag stops all loops; none waits for another to end.
    let mut failed = None;
    for one in &mut session.loops {
        if !one.thread.stop() {
            failed = failed.or(Some(one.report.tool.clone()));
        }
    }
    let taken = session.take_ticks(&mut record);
    let bare = bare.and_then(BareTimer::stop);
    ended.and(taken)?;
    match failed {
        Some(tool) => {
            let problem = "the haptic loop's thread panicked; the device was released";
            Err(Error::Simulation(format!("{}{problem}", before_notes(&tool))))
        }
        None => Ok(session.reports(bare)),
    }
}

/// What stands before a note on the tool of this name, which is empty where there is only one.
fn before_notes(tool: &str) -> String {
    if tool.is_empty() { String::new() } else { format!("{tool}: ") }
}

/// A leader before its loop begins.
struct Prepared {
    leader: Leader,
    profile: Profile,
    limits: Limits,
    notes: Vec<String>,
}

impl Prepared {
    fn new(leader: Leader) -> Prepared {
        let mut notes = leader.device.notes();
        let mut profile = leader.device.profile().clone();
        profile.resolution = leader.haptics.resolution.or(profile.resolution);
        let (limits, refused) = Limits::new(&profile, &leader.haptics.limits);
        for key in refused {
            notes.push(format!(
                "haptics.{key} exceeds the limit of profile {}; the profile's limit is used",
                profile.name
            ));
        }
        notes.iter_mut().for_each(|note| note.insert_str(0, &before_notes(&leader.name)));
        Prepared { leader, profile, limits, notes }
    }

    /// Settings of the loop and the tool with its coupling, where a wrench is out of date by `staleness`, s, at most.
    fn settings(&mut self, staleness: f64) -> (Settings, Tool) {
        let Leader { name, tool, haptics, .. } = &self.leader;
        let period = 1.0 / haptics.rate;
        let delay = if haptics.local_model { 0.0 } else { staleness };
        let inertia = (0..3).map(|k| tool.inertia.col(k)[k]).sum::<f64>() / 3.0;
        let gains = coupling::choose(&self.profile, period, delay, tool.mass, inertia, tool.coupling.as_ref());
        self.notes.push(format!("{}{}", before_notes(name), gains.reason));
        let settings = Settings {
            period,
            limits: self.limits,
            local_model: haptics.local_model,
            passivity: haptics.passivity,
            most_damping: gains.most_damping,
            trust: haptics.trust,
            arm: (inertia / tool.mass).sqrt(),
            resolution: self.profile.step(),
        };
        (settings, Tool { coupling: Some(gains.coupling), ..tool.clone() })
    }
}

/// Results of the simulation steps that run before the loops begin.
struct FirstSteps {
    steps: Vec<(Vec<DeviceInput>, Vec<ContactWrench>)>,
    /// Wall-clock time of one step, s.
    took: f64,
    /// Greatest time by which a wrench gets out of date, s: a wrench stays the newest until the next step has finished.
    /// This is twice the time of a step.
    staleness: f64,
}

/// Simulates [`FIRST_STEPS`] steps with the tools at rest and uncoupled. The first step is not timed, because many GPU
/// drivers are slow in it.
fn first_steps(environment: &mut dyn Environment, leaders: &[Prepared], h: f64) -> Result<FirstSteps> {
    let input = |leader: &Prepared| {
        let (state, max_force) = (leader.leader.tool.state(), leader.limits.force);
        DeviceInput { ticks: 0, time: 0.0, device: state, tool: state, coupling: None, max_force }
    };
    let inputs: Vec<DeviceInput> = leaders.iter().map(input).collect();
    let (mut steps, mut times) = (Vec::new(), Vec::new());
    for _ in 0..FIRST_STEPS {
        let begun = Instant::now();
        steps.push((inputs.clone(), environment.feel_each(&inputs, h)?));
        times.push(begun.elapsed().as_secs_f64());
        environment.after()?;
    }
    times.remove(0);
    times.sort_unstable_by(f64::total_cmp);
    let took = times[times.len() / 2].max(h);
    Ok(FirstSteps { steps, took, staleness: 2.0 * took })
}

/// The haptic loops of a session and the simulation beside them.
struct Session {
    loops: Vec<Loop>,
    ended: Option<String>,
    steps: u64,
    pace: f64,
}

/// The haptic loop of one device.
struct Loop {
    thread: ServoThread,
    report: Report,
    period: f64,
    prediction: Prediction,
    lost_since: Option<f64>,
}

impl Loop {
    fn new(thread: ServoThread, tool: String, profile: &'static str, notes: Vec<String>, settings: &Settings) -> Loop {
        let report = Report {
            tool,
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
        let prediction = Prediction::new(settings.arm);
        Loop { thread, report, period: settings.period, prediction, lost_since: None }
    }

    /// Adds the predicted and the observed change of force from the previous wrench to this one.
    fn compare(&mut self, wrench: &ContactWrench) {
        if let Some([predicted, observed]) = self.prediction.take(wrench) {
            self.report.foretold.0 += predicted.abs();
            self.report.foretold.1 += observed.abs();
        }
    }
}

impl Session {
    /// The present time, s on the loops' clock.
    fn now(&self) -> f64 {
        self.loops[0].thread.now()
    }

    /// The newest states of devices and tools, from which the next simulation step starts.
    fn newest(&mut self) -> Vec<DeviceInput> {
        self.loops.iter_mut().map(|one| one.thread.newest()).collect()
    }

    /// Passes to each loop its contact wrench.
    fn give(&mut self, wrenches: &[ContactWrench]) {
        self.loops.iter_mut().zip(wrenches).for_each(|(one, wrench)| one.thread.give(*wrench));
    }

    /// Simulates steps until the session ends. A step simulates as much time as computing a step takes, so that bodies
    /// move in real time; this length is at most the scene's longest step.
    fn run(
        &mut self,
        environment: &mut dyn Environment,
        options: &Options,
        longest_step: f64,
        first: &FirstSteps,
        record: &mut impl FnMut(Moment) -> Result<()>,
    ) -> Result<()> {
        let mut pace = Pace::new(options.shortest_step, longest_step, first.took);
        let mut simulated = 0.0;
        let is_waiting = |one: &mut Loop| one.thread.newest().ticks == 0 && one.thread.is_running();
        while self.loops.iter_mut().any(is_waiting) && !options.stop.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_secs_f64(self.loops[0].period));
        }
        let begun = self.now();
        let (mut last, mut ahead) = (begun, 0.0);
        while self.goes_on(options) {
            let (start, inputs) = (self.now(), self.newest());
            let h = pace.length();
            let wrenches = environment.feel_each(&inputs, h)?;
            self.give(&wrenches);
            environment.after()?;
            simulated += h;
            self.steps += 1;
            self.loops.iter_mut().zip(&wrenches).for_each(|(one, wrench)| one.compare(wrench));
            record(Moment::Step(&inputs, h, &wrenches))?;
            self.take_ticks(record)?;
            let now = self.now();
            pace.took(now - start, now);
            // If simulated time is ahead of real time, the thread waits. If simulated time is behind, the following
            // steps catch up by at most the length of one step.
            ahead = (ahead + h - (now - last)).max(-h);
            last = now;
            if ahead > 0.0 {
                std::thread::sleep(Duration::from_secs_f64(ahead));
            }
        }
        self.pace = simulated / (self.now() - begun).max(self.loops[0].period);
        Ok(())
    }

    /// Whether the session goes on. If it must end before its time is over, the reason is kept.
    fn goes_on(&mut self, options: &Options) -> bool {
        let now = self.now();
        let loss = |one: &Loop| one.lost_since.map_or(0.0, |since| now - since);
        let stopped = options.stop.load(Ordering::Relaxed);
        let panicked = self.loops.iter().find(|one| !one.thread.is_running());
        let lost = if self.loops.len() == 1 { "the device was" } else { "all devices were" };
        self.ended = match (stopped, panicked) {
            (true, _) => Some("it was stopped".into()),
            (_, Some(one)) => Some(format!("{}the loop's thread panicked", before_notes(&one.report.tool))),
            _ if self.loops.iter().all(|one| loss(one) > LONGEST_LOSS) => {
                Some(format!("{lost} lost for {LONGEST_LOSS} s"))
            }
            _ => None,
        };
        self.ended.is_none() && now < options.seconds
    }

    /// The reports on all loops, which have ended.
    fn reports(self, mut bare: Option<Lateness>) -> Vec<Report> {
        let Session { loops, ended, steps, pace } = self;
        let report = |mut one: Loop| {
            let lost = one.thread.newest().ticks.saturating_sub(one.report.lateness.ticks());
            Report { bare: bare.take(), steps, pace, lost, ended: ended.clone(), ..one.report }
        };
        loops.into_iter().map(report).collect()
    }

    fn take_ticks(&mut self, record: &mut impl FnMut(Moment) -> Result<()>) -> Result<()> {
        for (index, one) in self.loops.iter_mut().enumerate() {
            let report = &mut one.report;
            for tick in one.thread.ticks() {
                report.lateness.add(tick.late, one.period);
                report.events.add(tick.events);
                report.energy = tick.energy;
                report.peak_force = report.peak_force.max(tick.played.force.length());
                report.end = [tick.played, tick.contact];
                if tick.step > 0 {
                    report.staleness.add(tick.staleness);
                }
                let is_lost = tick.events.has(Event::DeviceLost);
                one.lost_since = if is_lost { one.lost_since.or(Some(tick.time)) } else { None };
                record(Moment::Tick(index, &tick))?;
            }
        }
        Ok(())
    }
}
