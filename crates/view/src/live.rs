//! The thread on which a simulation runs while other threads draw it. Its tool is held by a haptic device or follows
//! the scene's keys (key frames of the desired pose). Between two steps the thread executes commands; after each step
//! it publishes the results. It waits for drawing only at the GPU's queue, which both use in turns (see [`Turns`]).

mod haptic_session;
mod snapshot;
#[cfg(test)]
mod tests;
mod worker;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

use palpate::internal::haptics::Device;
use palpate::internal::haptics::session::Report;
use palpate::internal::prepare::bodies::Bodies;
use palpate::scene::{Contact, Coupling, Key, Material};
use palpate::{Error, Result, Scene, Simulation, StepReport};

use super::turns::Turns;
pub use snapshot::{LoopState, Sample, Settings, Snapshot, State};
use worker::Worker;

/// Capacity of the queue of samples (time, force and torque of a step); where it is full, new samples are dropped.
const SAMPLES: usize = 1 << 14;

/// Makes the haptic device for a session (one run of the haptic loop) that begins at a pose.
pub type MakeDevice = Box<dyn FnMut(&Simulation, Key) -> Result<Box<dyn Device>> + Send>;

/// Is called with every step report; an error ends the run.
pub type Watch = Box<dyn FnMut(&StepReport) -> Result<()> + Send>;

/// A function that is called with the simulation between two steps, and with a number that changes when the simulation
/// is replaced.
pub type Question = Box<dyn FnOnce(&mut Simulation, u64) + Send>;

/// What moves the tool.
pub enum Lead {
    /// The scene's keys, step after step, no faster than real time.
    Script,
    /// A haptic device, through the haptic loop.
    Device {
        /// Name by which the user chose the device.
        name: String,
        /// Makes the device of each session; another session begins after each pause, reset, or change of the coupling.
        make: MakeDevice,
    },
}

/// When the simulation ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Extent {
    /// It ends only by [`Command::Quit`].
    Endless,
    /// It ends after this number of steps along the keys.
    Steps(u64),
    /// It ends after this time of a session, s.
    Seconds(f64),
}

/// What the thread begins with.
pub struct Begin {
    /// The simulation, which must not have stepped yet.
    pub simulation: Simulation,
    /// What moves its tool.
    pub lead: Lead,
    /// When it ends.
    pub extent: Extent,
    /// Is called with every step report.
    pub watch: Watch,
    /// Folder for recordings.
    pub folder: PathBuf,
}

/// A command, which is executed between two steps.
pub enum Command {
    /// Pause, or go on.
    Pause,
    /// Do one step, then pause.
    Step,
    /// Restore the state before the first step.
    Reset,
    /// Change a material: the body, the index among its materials, and the new material.
    Material(usize, usize, Material),
    /// Change the contact law.
    Contact(Contact),
    /// Change the virtual coupling. A session begins anew with it, because the haptic loop limits the gains when it
    /// begins.
    Coupling(Coupling),
    /// Record a new session from the state before the first step, or end the recording.
    Record,
    /// Replace the scene and its bodies.
    Replace(Box<(Scene, Bodies)>),
    /// End the thread.
    Quit,
    /// Call a function with the simulation between two steps. While it runs it has the turn at the GPU's queue that
    /// belongs to drawing.
    Ask(Question),
}

/// The running thread; when this is dropped, it ends after the current step.
pub struct Live {
    link: Link,
    thread: Option<JoinHandle<()>>,
    snapshots: triple_buffer::Output<Snapshot>,
    samples: rtrb::Consumer<Sample>,
    notes: Receiver<String>,
    sessions: Receiver<Report>,
}

/// Sends commands to the thread; each thread that sends commands has a clone of it.
#[derive(Clone)]
pub struct Link {
    commands: Sender<Command>,
    turns: Arc<Turns>,
}

impl Live {
    /// Starts the thread, which begins to step.
    ///
    /// # Errors
    /// The initial state cannot be saved, or no thread can be started.
    pub fn start(begin: Begin) -> Result<Live> {
        let turns = Arc::new(Turns::new());
        let (commands, told) = channel();
        let (out, snapshots) = triple_buffer::triple_buffer(&Snapshot::default());
        let (samples_in, samples) = rtrb::RingBuffer::new(SAMPLES);
        let (tell, notes) = channel();
        let (end, sessions) = channel();
        let worker = Worker::new(
            begin,
            turns.clone(),
            told,
            snapshot::Out { out, samples: samples_in, notes: tell, sessions: end },
        )?;
        let thread = std::thread::Builder::new().name("palpate-steps".into()).spawn(move || worker.run());
        let thread =
            thread.map_err(|error| Error::Simulation(format!("the simulation's thread cannot be started: {error}")))?;
        Ok(Live { link: Link { commands, turns }, thread: Some(thread), snapshots, samples, notes, sessions })
    }

    /// The sender of commands, which may be cloned for another thread.
    pub fn link(&self) -> &Link {
        &self.link
    }

    /// The newest snapshot that the thread published.
    pub fn snapshot(&mut self) -> &Snapshot {
        self.snapshots.read()
    }

    /// Samples of the steps since the last call, the oldest first.
    pub fn samples(&mut self) -> impl Iterator<Item = Sample> + '_ {
        std::iter::from_fn(|| self.samples.pop().ok())
    }

    /// Lines that the user should read, since the last call.
    pub fn notes(&self) -> impl Iterator<Item = String> + '_ {
        self.notes.try_iter()
    }

    /// Reports of sessions with a device that ended since the last call, the oldest first.
    pub fn sessions(&self) -> impl Iterator<Item = Report> + '_ {
        self.sessions.try_iter()
    }

    /// Whether the thread is running.
    pub fn is_running(&self) -> bool {
        self.thread.as_ref().is_some_and(|thread| !thread.is_finished())
    }

    /// Ends the thread after the current step and releases the device. Returns whether it ended without a panic.
    pub fn quit(&mut self) -> bool {
        self.link.tell(Command::Quit);
        self.thread.take().is_none_or(|thread| thread.join().is_ok())
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        self.quit();
    }
}

impl Link {
    /// Sends a command; nothing happens if the thread has ended.
    pub fn tell(&self, command: Command) {
        let _ = self.commands.send(command);
    }

    /// Has the thread call a function with the simulation between two steps, and waits for the result; `None` if the
    /// thread has ended.
    pub fn ask<R: Send + 'static>(&self, what: impl FnOnce(&mut Simulation, u64) -> R + Send + 'static) -> Option<R> {
        let (reply, answer) = channel();
        self.tell(Command::Ask(Box::new(move |simulation, generation| {
            // If the caller is gone, sending fails, which is ignored.
            let _ = reply.send(what(simulation, generation));
        })));
        answer.recv().ok()
    }

    /// The turns at the GPU's queue, which a slice (part) of drawing must take.
    pub fn turns(&self) -> &Arc<Turns> {
        &self.turns
    }
}
