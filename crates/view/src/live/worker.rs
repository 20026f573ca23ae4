//! The work of the simulation's thread: it does one task after another (run, pause, reset, record, replace, quit) and
//! executes commands between two steps. Its steps and the *slices* (parts of images) that another thread draws take
//! turns at the GPU's queue. A *session* is one run of the haptic loop, in which a haptic device holds the *tool*, a
//! rigid body.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, TryRecvError};
use std::time::{Duration, Instant};

use palpate::internal::prepare::bodies::Bodies;
use palpate::internal::step::DeviceInput;
use palpate::internal::step::tool::Tool;
use palpate::{Error, Result, Scene, Simulation, StepReport};

use super::snapshot::{self, LoopState, Out, Snapshot, State};
use super::{Begin, Command, Extent, Lead, Watch};
use crate::turns::Turns;

/// The simulation and the state of its thread.
pub(super) struct Worker {
    pub simulation: Simulation,
    pub lead: Lead,
    pub extent: Extent,
    pub folder: PathBuf,
    pub out: Out,
    pub snapshot: Snapshot,
    /// Inputs of the last step of a session: pose and twist of each haptic device and its tool.
    pub last_inputs: Vec<DeviceInput>,
    /// The next task, once one is requested; the present task then ends.
    pub next: Option<Next>,
    watch: Watch,
    turns: Arc<Turns>,
    commands: Receiver<Command>,
    /// The scene as it was given, without changes by commands.
    given: Scene,
    /// The simulation's state before the first step, as saved by [`Simulation::save`].
    first: Vec<u8>,
    is_changed: bool,
    /// Whether the scene was replaced. The steps of the new scene are not passed to `watch`, and sessions with it
    /// cannot be recorded, because there is no scene file for a replay.
    is_replaced: bool,
    /// Number of steps along the scene's keys that were done; [`Extent::Steps`] limits it.
    done: u64,
}

/// A task of the thread.
pub(super) enum Next {
    Run,
    Rest(State),
    /// Restore the state before the first step, then run or, if `rests`, pause.
    Reset {
        rests: bool,
    },
    Record,
    Replace(Box<(Scene, Bodies)>),
    Quit,
}

impl Worker {
    pub fn new(begin: Begin, turns: Arc<Turns>, commands: Receiver<Command>, out: Out) -> Result<Worker> {
        let Begin { simulation, lead, extent, watch, folder } = begin;
        let mut worker = Worker {
            first: simulation.save()?,
            given: simulation.scene().clone(),
            simulation,
            lead,
            extent,
            folder,
            out,
            snapshot: Snapshot::default(),
            last_inputs: Vec::new(),
            next: None,
            watch,
            turns,
            commands,
            is_changed: false,
            is_replaced: false,
            done: 0,
        };
        worker.show_settings();
        Ok(worker)
    }

    /// Does one task after another until [`Next::Quit`].
    pub fn run(mut self) {
        let mut next = Next::Run;
        loop {
            let done = match next {
                Next::Quit => return,
                Next::Run => self.go(None),
                Next::Reset { rests: false } => self.reset().and_then(|()| self.go(None)),
                Next::Reset { rests: true } => self.reset().map(|()| self.rest(State::Paused)),
                Next::Record => self.record(),
                Next::Replace(other) => {
                    self.replace(*other);
                    self.go(None)
                }
                Next::Rest(state) => {
                    self.rest(state);
                    Ok(())
                }
            };
            next = match done {
                Ok(()) => self.next.take().unwrap_or(Next::Rest(State::Ended)),
                Err(error) => {
                    let line = error.to_string().lines().collect::<Vec<_>>().join(" ");
                    self.out.note(line.clone());
                    // A task that was requested meanwhile comes next. Otherwise the thread shows the failure and waits.
                    self.next.take().unwrap_or(Next::Rest(State::Failed(line)))
                }
            };
        }
    }

    /// Steps until another task is requested or the end is reached; records a session if a file is given.
    pub fn go(&mut self, record: Option<PathBuf>) -> Result<()> {
        self.set_state(record.as_ref().map_or(State::Running, |file| State::Recording(file.clone())));
        let done = match self.lead {
            Lead::Script => self.drive(),
            Lead::Devices(_) => self.hold(record),
        };
        self.turns.rest();
        done
    }

    /// Steps along the scene's keys, no faster than real time.
    fn drive(&mut self) -> Result<()> {
        let mut due = Instant::now();
        while self.next.is_none() {
            if matches!(self.extent, Extent::Steps(steps) if self.done >= steps) {
                return Ok(());
            }
            let row = self.in_turn(Simulation::step)?;
            self.done += 1;
            self.found(&row)?;
            // Time lost by a slow step is not made up for by faster steps.
            due = (due + Duration::from_secs_f64(self.simulation.scene().step.dt)).max(Instant::now());
            self.obey_until(due);
        }
        Ok(())
    }

    /// Does a step within a turn at the GPU's queue.
    pub fn in_turn<R>(&mut self, step: impl FnOnce(&mut Simulation) -> Result<R>) -> Result<R> {
        let turns = self.turns.clone();
        let _turn = turns.step();
        step(&mut self.simulation)
    }

    /// Publishes a step report.
    pub fn found(&mut self, row: &StepReport) -> Result<()> {
        if !self.is_replaced {
            (self.watch)(row)?;
        }
        self.out.sample(row);
        if let Some(stages) = self.simulation.stage_times() {
            self.snapshot.stages = stages.to_vec();
        }
        self.snapshot.row = Some(row.clone());
        self.publish();
        Ok(())
    }

    pub fn publish(&mut self) {
        self.out.out.write(self.snapshot.clone());
    }

    pub fn set_loops(&mut self, states: Vec<LoopState>) {
        self.snapshot.haptics = states;
    }

    fn set_state(&mut self, state: State) {
        self.snapshot.state = state;
        self.publish();
    }

    fn show_settings(&mut self) {
        let is_held = matches!(self.lead, Lead::Devices(_));
        self.snapshot.settings = Arc::new(snapshot::settings(&self.simulation, is_held));
        let probes = self.simulation.scene().probes.iter().map(|probe| probe.name.clone()).collect();
        self.snapshot.probes = Arc::new(probes);
        self.publish();
    }

    /// Executes waiting commands until another task is requested, no command is left, or a [`Command::Ask`] was
    /// executed. As [`Command::Ask`] takes the turn of a slice, the next step waits for one slice at most.
    pub fn obey_all(&mut self) {
        while self.next.is_none() {
            match self.commands.try_recv() {
                Ok(Command::Ask(what)) => {
                    let turns = self.turns.clone();
                    let _turn = turns.slice_before_step();
                    return what(&mut self.simulation, self.snapshot.generation);
                }
                Ok(command) => self.obey(command),
                Err(TryRecvError::Empty) => return,
                Err(TryRecvError::Disconnected) => self.next = Some(Next::Quit),
            }
        }
    }

    /// Executes waiting commands, and commands that arrive before `due`, the time of the next step.
    fn obey_until(&mut self, due: Instant) {
        self.obey_all();
        while self.next.is_none() && Instant::now() < due {
            self.turns.rest();
            match self.commands.recv_timeout(due.saturating_duration_since(Instant::now())) {
                Ok(command) => self.obey(command),
                Err(RecvTimeoutError::Timeout) => return,
                Err(RecvTimeoutError::Disconnected) => self.next = Some(Next::Quit),
            }
        }
    }

    /// Publishes this state and executes commands, until another task is requested.
    fn rest(&mut self, state: State) {
        self.set_loops(Vec::new());
        self.set_state(state);
        while self.next.is_none() {
            match self.commands.recv() {
                Ok(command) => self.obey(command),
                Err(_) => self.next = Some(Next::Quit),
            }
        }
    }

    fn obey(&mut self, command: Command) {
        let rests = !matches!(self.snapshot.state, State::Running | State::Recording(_));
        match command {
            Command::Ask(what) => {
                let turns = self.turns.clone();
                let _turn = turns.slice();
                what(&mut self.simulation, self.snapshot.generation);
            }
            Command::Quit => self.next = Some(Next::Quit),
            Command::Reset => self.next = Some(Next::Reset { rests: self.snapshot.state == State::Paused }),
            Command::Pause => self.next = Some(if rests { Next::Run } else { Next::Rest(State::Paused) }),
            Command::Step if rests => self.step_once(),
            Command::Step => self.next = Some(Next::Rest(State::Paused)),
            Command::Record => match (&self.snapshot.state, &self.lead) {
                (State::Recording(_), _) => self.next = Some(Next::Run),
                (_, Lead::Script) => self.out.note("nothing is recorded: the tool follows [drive], no haptic device"),
                _ if self.is_replaced => {
                    let remedy = "run palpate prepare FILE --out DIR, then palpate view DIR/scene.toml";
                    self.out.note(format!("nothing is recorded: a dropped file has no scene to replay; {remedy}"));
                }
                _ => self.next = Some(Next::Record),
            },
            Command::Replace(other) => self.next = Some(Next::Replace(other)),
            Command::Material(..) | Command::Contact(_) | Command::Coupling(_) => self.change(command),
        }
    }

    /// Changes a material, the contact law or the virtual coupling. A change is refused while a session is recorded,
    /// because the recording would not contain it.
    fn change(&mut self, command: Command) {
        if matches!(self.snapshot.state, State::Recording(_)) {
            self.out.note("sliders are disabled while a session is recorded");
            return;
        }
        let turns = self.turns.clone();
        let turn = turns.step();
        let had_friction = self.simulation.scene().contact.friction > 0.0;
        let changed = match command {
            Command::Material(body, index, material) => self.simulation.set_material(body, index, material),
            Command::Contact(law) => self.simulation.set_contact(&law),
            Command::Coupling(coupling) => {
                if matches!(self.lead, Lead::Devices(_)) && self.snapshot.state == State::Running {
                    self.next = Some(Next::Run);
                }
                self.simulation.set_coupling(Some(coupling))
            }
            _ => Ok(()),
        };
        drop(turn);
        self.is_changed = true;
        if !had_friction && self.simulation.scene().contact.friction > 0.0 {
            // With friction the step's GPU commands were recorded anew and use new arrays, so drawing must begin anew,
            // as for another simulation.
            self.snapshot.generation += 1;
        }
        if let Err(error) = changed {
            self.out.note(error.to_string());
        }
        self.show_settings();
    }

    /// Does a single step while the simulation is paused, with the last inputs from the devices.
    fn step_once(&mut self) {
        let h = self.simulation.scene().step.dt;
        let input = |(index, tool): (usize, &Tool)| {
            let own = tool.state();
            let (coupling, max_force) = (tool.coupling, f64::INFINITY);
            let first = DeviceInput { ticks: 0, time: 0.0, device: own, tool: own, coupling, max_force };
            DeviceInput { tool: own, ..self.last_inputs.get(index).copied().unwrap_or(first) }
        };
        let led = self.last_inputs.len().max(1);
        let inputs: Vec<DeviceInput> = self.simulation.tools().take(led).enumerate().map(input).collect();
        let row = match &self.lead {
            Lead::Devices(_) if !inputs.is_empty() => {
                self.in_turn(|simulation| simulation.step_device_inputs(&inputs, h))
            }
            _ => self.in_turn(Simulation::step),
        };
        let state = match row.and_then(|row| self.found(&row)) {
            Ok(()) => State::Paused,
            Err(error) => State::Failed(error.to_string()),
        };
        self.set_state(state);
    }

    fn reset(&mut self) -> Result<()> {
        self.last_inputs.clear();
        self.snapshot.row = None;
        let turns = self.turns.clone();
        let _turn = turns.step();
        self.simulation.restore(&self.first)?;
        self.couple();
        Ok(())
    }

    /// Gives the tools the couplings of the scene.
    pub fn couple(&mut self) {
        let coupling = self.simulation.scene().coupling;
        self.simulation.couple(coupling);
    }

    /// Records a session from the state before the first step, without changes by commands, so that a replay with the
    /// scene's file gives equal results.
    fn record(&mut self) -> Result<()> {
        if self.is_changed {
            let (context, path) = (self.simulation.context().clone(), self.simulation.depth_path());
            let mut scene = self.given.clone();
            scene.contact.depth = path;
            self.take(Simulation::on_device(&context, &scene)?)?;
            self.out.note("the recording starts anew, with the materials, contact and coupling of the scene's file");
        }
        self.reset()?;
        let name = self.given.name();
        let files = (1_u32..).map(|k| self.folder.join(format!("{name}-{k}.palpate")));
        let file = files.into_iter().find(|file| !file.exists());
        self.go(file)
    }

    /// Replaces the scene; if the new scene cannot be simulated, the simulation of the old scene goes on.
    fn replace(&mut self, (scene, bodies): (Scene, Bodies)) {
        let context = self.simulation.context().clone();
        let made =
            Simulation::check_room(&context, &scene).and_then(|()| Simulation::with_bodies(&context, &scene, bodies));
        match made.and_then(|simulation| self.take(simulation)) {
            Ok(()) => (self.given, self.is_replaced) = (scene, true),
            Err(error) => self.out.note(error.to_string()),
        }
    }

    fn take(&mut self, simulation: Simulation) -> Result<()> {
        self.first = simulation.save()?;
        self.simulation = simulation;
        self.snapshot.generation += 1;
        self.snapshot.stages.clear();
        self.last_inputs.clear();
        (self.snapshot.row, self.is_changed) = (None, false);
        self.show_settings();
        Ok(())
    }
}

impl Drop for Worker {
    /// Declares that no step is due, so that drawing continues even if this thread ends by a panic.
    fn drop(&mut self) {
        self.turns.rest();
    }
}

/// The error for a scene without a tool, where a haptic device has nothing to hold.
pub(super) fn no_tool(scene: &Scene) -> Error {
    Error::key(&scene.file, "tool", "is missing, but a haptic device needs a tool to hold", "add a [tool]")
}
