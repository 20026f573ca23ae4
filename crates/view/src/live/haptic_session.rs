//! A session (one run of the haptic loops with the haptic devices that hold the tools), as the simulation's thread runs it:
//! each step takes its turn at the GPU's queue, and commands are executed between two steps.

use std::cell::RefCell;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use glam::DVec3;
use palpate::internal::haptics::clock::Lateness;
use palpate::internal::haptics::environment::Environment;
use palpate::internal::haptics::event::Events;
use palpate::internal::haptics::servo::Tick;
use palpate::internal::haptics::session::{self, Moment, Options};
use palpate::internal::step::tool::Tool;
use palpate::internal::step::{ContactWrench, DeviceInput};
use palpate::scene::Key;
use palpate::{Result, RigidState};
use palpate_devices::record::{Header, Leader, Recording};

use super::snapshot::LoopState;
use super::worker::{Next, Worker, no_tool};
use super::{Extent, Held, Lead};

/// Time between two evaluations of the quantiles of the ticks' lateness; an evaluation goes through a large histogram.
/// A tick is an iteration of the haptic loop.
const REFRESH: Duration = Duration::from_millis(250);

/// What the haptic loop of a device has reported to the simulation's thread.
struct Heard {
    state: LoopState,
    lateness: Lateness,
    events: Events,
    period: f64,
    refreshed: Option<Instant>,
}

impl Heard {
    /// What is known at the beginning of a loop with this period, s.
    fn new(period: f64) -> Heard {
        let (state, lateness) = (LoopState::default(), Lateness::new());
        Heard { state, lateness, events: Events::default(), period, refreshed: None }
    }

    fn tick(&mut self, tick: &Tick) {
        self.lateness.add(tick.late, self.period);
        self.events.0 |= tick.events.0;
        self.state.played = tick.played;
    }

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

/// The environment of the haptic loops: it steps the simulation, and publishes a snapshot after each step.
struct Felt<'a, 'b> {
    worker: &'a RefCell<&'b mut Worker>,
    heard: &'a RefCell<Vec<Heard>>,
}

impl Environment for Felt<'_, '_> {
    fn feel_each(&mut self, inputs: &[DeviceInput], h: f64) -> Result<Vec<ContactWrench>> {
        let mut worker = self.worker.borrow_mut();
        let row = worker.in_turn(|simulation| simulation.step_device_inputs(inputs, h))?;
        let wrenches = worker.simulation.contact_wrenches(inputs);
        worker.last_inputs = inputs.to_vec();
        worker.set_loops(self.heard.borrow_mut().iter_mut().map(Heard::taken).collect());
        worker.found(&row)?;
        Ok(wrenches)
    }
}

impl Worker {
    /// Runs a session until another task is requested, the session's time is over, or all devices are lost for good.
    /// Records the session if a file is given.
    pub fn hold(&mut self, record: Option<PathBuf>) -> Result<()> {
        let scene = self.simulation.scene().clone();
        if scene.tool.is_none() {
            return Err(no_tool(&scene));
        }
        self.couple();
        let is_first = self.last_inputs.is_empty();
        let start = |(index, tool): (usize, &Tool)| {
            let own = Key { time: 0.0, position: tool.centre, orientation: tool.orientation };
            let device = self.last_inputs.get(index).map(|input| input.device);
            device.map_or(own, |RigidState { position, orientation, .. }| Key { position, orientation, ..own })
        };
        let starts: Vec<Key> = self.simulation.tools().enumerate().map(start).collect();
        let Lead::Devices(make) = &mut self.lead else { return Ok(()) };
        let mut held = make(&self.simulation, &starts)?;
        if !is_first {
            // After a pause the tools start at rest.
            let tools = held.iter_mut().map(|held| &mut held.leader.tool);
            tools.for_each(|tool| (tool.velocity, tool.angular_velocity) = (DVec3::ZERO, DVec3::ZERO));
        }
        let leaders = held.iter().map(|Held { leader, device }| Leader {
            tool: leader.name.clone(),
            profile: leader.device.profile().name.into(),
            device: device.clone(),
        });
        let recording = match &record {
            Some(file) => {
                let header = Header::new(&scene, &self.simulation, leaders.collect());
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
        let leaders: Vec<_> = held.into_iter().map(|held| held.leader).collect();
        let heard: Vec<Heard> = leaders.iter().map(|leader| Heard::new(1.0 / leader.haptics.rate)).collect();
        let heard = RefCell::new(heard);
        let notes = self.out.notes.clone();
        let mut recording = recording;
        let worker = RefCell::new(self);
        let hear = |moment: Moment| {
            match moment {
                // If the receiver is gone, sending fails, which is ignored.
                Moment::Note(note) => drop(notes.send(note.into())),
                Moment::Tick(index, tick) => heard.borrow_mut()[index].tick(tick),
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
        let mut felt = Felt { worker: &worker, heard: &heard };
        let reports = session::hold_each(leaders, &mut felt, &options, hear);
        let this = worker.into_inner();
        if let (Some(recording), Some(file)) = (recording, record) {
            let totals = recording.finish()?;
            let name = file.display();
            this.out.note(format!("recorded {} ticks; replay them by: palpate replay {name}", totals.ticks));
        }
        let reports = reports?;
        if let (Some(why), None) = (&reports[0].ended, &this.next) {
            this.out.note(format!("the session ended: {why}"));
        }
        // If the receiver is gone, sending fails, which is ignored.
        let _ = this.out.sessions.send(reports);
        Ok(())
    }
}
