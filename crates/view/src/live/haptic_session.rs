//! A session (one run of the haptic loop with a haptic device that holds the tool), as the simulation's thread runs it:
//! each step takes its turn at the GPU's queue, and commands are executed between two steps.

use std::cell::RefCell;
use std::path::PathBuf;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use glam::DVec3;
use palpate::Result;
use palpate::internal::haptics::clock::Lateness;
use palpate::internal::haptics::environment::Environment;
use palpate::internal::haptics::event::Events;
use palpate::internal::haptics::session::{self, Moment, Options};
use palpate::internal::step::{ContactWrench, DeviceInput};
use palpate::scene::Key;
use palpate_devices::record::{Header, Leader, Recording};

use super::snapshot::LoopState;
use super::worker::{Next, Worker, no_tool};
use super::{Extent, Lead};

/// Time between two evaluations of the quantiles of the ticks' lateness; an evaluation goes through a large histogram.
/// A tick is an iteration of the haptic loop.
const REFRESH: Duration = Duration::from_millis(250);

/// What the haptic loop has reported to the simulation's thread.
struct Heard {
    state: LoopState,
    lateness: Lateness,
    events: Events,
    period: f64,
    refreshed: Option<Instant>,
}

impl Heard {
    /// The loop's state for the next snapshot; the collected events are reset.
    fn taken(&mut self) -> LoopState {
        if self.lateness.ticks() > 0 && self.refreshed.is_none_or(|at| at.elapsed() > REFRESH) {
            self.state.late = [self.lateness.quantile(0.5), self.lateness.quantile(0.99), self.lateness.worst()];
            self.refreshed = Some(Instant::now());
        }
        self.state.ticks = self.lateness.ticks();
        self.state.events = std::mem::take(&mut self.events).names().collect();
        self.state.clone()
    }
}

/// The environment of the haptic loop: it steps the simulation, and publishes a snapshot after each step.
struct Felt<'a, 'b> {
    worker: &'a RefCell<&'b mut Worker>,
    heard: Rc<RefCell<Heard>>,
}

impl Environment for Felt<'_, '_> {
    fn feel(&mut self, input: &DeviceInput, h: f64) -> Result<ContactWrench> {
        let mut worker = self.worker.borrow_mut();
        let row = worker.in_turn(|simulation| simulation.step_device_input(input, h))?;
        let wrench = worker.simulation.contact_wrench_of(input);
        worker.last_input = Some(*input);
        worker.set_loop(Some(self.heard.borrow_mut().taken()));
        worker.found(&row)?;
        Ok(wrench)
    }
}

impl Worker {
    /// Runs a session until another task is requested, the session's time is over, or the device is lost for good.
    /// Records the session if a file is given.
    pub fn hold(&mut self, record: Option<PathBuf>) -> Result<()> {
        let scene = self.simulation.scene().clone();
        let mut tool = self.simulation.tool().cloned().ok_or_else(|| no_tool(&scene))?;
        tool.coupling = scene.coupling;
        if scene.held_tools() > 1 {
            self.out.note("of several haptic devices the window holds the first; palpate run holds them all");
        }
        if self.last_input.is_some() {
            // After a pause the tool starts at rest.
            (tool.velocity, tool.angular_velocity) = (DVec3::ZERO, DVec3::ZERO);
        }
        let (position, orientation) = match &self.last_input {
            Some(input) => (input.device.position, input.device.orientation),
            None => (tool.centre, tool.orientation),
        };
        let start = Key { time: 0.0, position, orientation };
        let Lead::Device { name, make } = &mut self.lead else { return Ok(()) };
        let device = make(&self.simulation, start)?;
        let recording = match &record {
            Some(file) => {
                let tool = scene.tool.as_ref().map_or(String::new(), |tool| tool.name.clone());
                let leader = Leader { tool, profile: device.profile().name.into(), device: name.clone() };
                let header = Header::new(&scene, &self.simulation, vec![leader]);
                match header.and_then(|header| Recording::create(file, &header)) {
                    Ok(recording) => Some(recording),
                    Err(error) => {
                        self.out.note(format!("nothing is recorded: {error}"));
                        self.next = Some(Next::Run);
                        return Ok(());
                    }
                }
            }
            None => None,
        };
        let seconds = if let Extent::Seconds(seconds) = self.extent { seconds } else { f64::INFINITY };
        let stop = Arc::new(AtomicBool::new(false));
        let options = Options { seconds, shortest_step: scene.step.dt, stop: stop.clone(), bare_timer: false };
        let heard = Rc::new(RefCell::new(Heard {
            state: LoopState::default(),
            lateness: Lateness::new(),
            events: Events::default(),
            period: 1.0 / scene.haptics.rate,
            refreshed: None,
        }));
        let (ears, notes) = (heard.clone(), self.out.notes.clone());
        let mut recording = recording;
        let worker = RefCell::new(self);
        let hear = |moment: Moment| {
            match moment {
                // If the receiver is gone, sending fails, which is ignored.
                Moment::Note(note) => drop(notes.send(note.into())),
                Moment::Tick(_, tick) => {
                    let mut heard = ears.borrow_mut();
                    let period = heard.period;
                    heard.lateness.add(tick.late, period);
                    heard.events.0 |= tick.events.0;
                    heard.state.played = tick.played;
                }
                _ => {}
            }
            match (&mut recording, moment) {
                (Some(recording), Moment::Begin(index, settings, tool)) => recording.begin(index, settings, tool)?,
                (Some(recording), Moment::Tick(index, tick)) => recording.tick(index, tick)?,
                (Some(recording), Moment::Step(inputs, h, wrenches)) => recording.step(inputs, h, wrenches)?,
                _ => {}
            }
            // Commands are executed here, between two steps: the loop already has the wrench (force and torque) of the
            // last step, and the inputs of the next step are read afterwards.
            if let Moment::Step(..) = moment {
                let mut worker = worker.borrow_mut();
                worker.obey_all();
                if worker.next.is_some() {
                    stop.store(true, Ordering::Relaxed);
                }
            }
            Ok(())
        };
        let mut felt = Felt { worker: &worker, heard };
        let report = session::hold(device, &tool, &scene.haptics, &mut felt, &options, hear);
        let this = worker.into_inner();
        if let (Some(recording), Some(file)) = (recording, record) {
            let totals = recording.finish()?;
            let name = file.display();
            this.out.note(format!("recorded {} ticks; replay them by: palpate replay {name}", totals.ticks));
        }
        let report = report?;
        if let (Some(why), None) = (&report.ended, &this.next) {
            this.out.note(format!("the session ended: {why}"));
        }
        // If the receiver is gone, sending fails, which is ignored.
        let _ = this.out.sessions.send(report);
        Ok(())
    }
}
