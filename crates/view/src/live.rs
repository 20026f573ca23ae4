//! The thread on which a simulation runs while other threads draw it. The simulation's *tools* (rigid bodies) are held by
//! haptic devices or follow the scene's keys (key frames of the desired pose). Between two steps the thread executes
//! commands; after each step it publishes the results. The thread waits for drawing only at the GPU's queue, which
//! steps and *slices* (the parts in which an image is drawn) use in turns (see [`Turns`]).

mod haptic_session;
mod snapshot;
#[cfg(test)]
mod tests;
mod worker;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

use palpate::internal::haptics::session::{self, Report};
use palpate::internal::prepare::bodies::Bodies;
use palpate::scene::{Contact, Coupling, Key, Material};
use palpate::{Error, Result, Scene, Simulation, StepReport};

use super::turns::Turns;
pub use snapshot::{LoopState, Sample, Settings, Snapshot, State};
use worker::Worker;

/// Capacity of the queue of samples (time, force and torque of a step); while the queue is full, new samples are
/// dropped.
const SAMPLES: usize = 1 << 14;

/// A haptic device with the tool that it leads, and the name of the device for a recording of the session.
pub struct Held {
    /// The device and its tool.
    pub leader: session::Leader,
    /// Name of the kind of device.
    pub device: String,
}

/// Makes the haptic devices for a session (one run of the haptic loop), for the first of the tools. Its arguments are the
/// simulation and for each tool the pose at which its device begins.
pub type MakeDevices = Box<dyn FnMut(&Simulation, &[Key]) -> Result<Vec<Held>> + Send>;

/// A function that is called with every step report; if it returns an error, the simulation stops stepping.
pub type Watch = Box<dyn FnMut(&StepReport) -> Result<()> + Send>;

/// A function that is called with the simulation between two steps, and with a number that changes when the simulation
/// is replaced.
pub type Question = Box<dyn FnOnce(&mut Simulation, u64) + Send>;

/// What moves the tools.
pub enum Lead {
    /// The scene's keys, which the tools follow step after step, no faster than real time.
    Script,
    /// Haptic devices, through haptic loops. The function makes the devices of each session. Another session begins after
    /// each pause, each reset, and each change of the virtual coupling (spring and damper between device and tool).
    Devices(MakeDevices),
}

/// When the simulation ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Extent {
    /// The simulation ends only by [`Command::Quit`].
    Endless,
    /// The simulation ends after this number of steps along the scene's keys.
    Steps(u64),
    /// The simulation ends when a session has lasted for this time, s.
    Seconds(f64),
}

/// What the thread begins with.
pub struct Begin {
    /// The simulation, which must not have stepped yet.
    pub simulation: Simulation,
    /// What moves the simulation's tool.
    pub lead: Lead,
    /// When the simulation ends.
    pub extent: Extent,
    /// The function that is called with every step report.
    pub watch: Watch,
    /// Folder into which recordings of sessions are written.
    pub folder: PathBuf,
}

/// A command, which is executed between two steps.
pub enum Command {
    /// Pause the simulation, or, if it is paused, go on.
    Pause,
    /// Do one step, then pause.
    Step,
    /// Restore the state before the first step.
    Reset,
    /// Change a material: the body, the index among its materials, and the new material.
    Material(usize, usize, Material),
    /// Change the contact law.
    Contact(Contact),
    /// Change the virtual coupling. A running session is replaced by a new one, because the haptic loop limits the
    /// coupling's gains only when a session begins.
    Coupling(Coupling),
    /// Record a new session from the state before the first step, or, if a session is being recorded, end the
    /// recording.
    Record,
    /// Replace the scene and its bodies.
    Replace(Box<(Scene, Bodies)>),
    /// End the thread.
    Quit,
    /// Call a function with the simulation between two steps. While the function runs, it has the turn of a slice at
    /// the GPU's queue.
    Ask(Question),
}

/// The running thread; when this value is dropped, the thread ends after the current step.
pub struct Live {
    link: Link,
    thread: Option<JoinHandle<()>>,
    snapshots: triple_buffer::Output<Snapshot>,
    samples: rtrb::Consumer<Sample>,
    notes: Receiver<String>,
    sessions: Receiver<Vec<Report>>,
}

/// Sends commands to the simulation's thread; each thread that sends commands has its own clone of this value.
#[derive(Clone)]
pub struct Link {
    commands: Sender<Command>,
    turns: Arc<Turns>,
}

impl Live {
    /// Starts the thread, which begins to step the simulation.
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

    /// The sender of commands to the thread; a clone of it may be given to another thread.
    pub fn link(&self) -> &Link {
        &self.link
    }

    /// The newest snapshot that the thread published.
    pub fn snapshot(&mut self) -> &Snapshot {
        self.snapshots.read()
    }

    /// Samples of the steps since the last call of this function, the oldest first.
    pub fn samples(&mut self) -> impl Iterator<Item = Sample> + '_ {
        std::iter::from_fn(|| self.samples.pop().ok())
    }

    /// Lines for the user to read, which the thread sent since the last call of this function.
    pub fn notes(&self) -> impl Iterator<Item = String> + '_ {
        self.notes.try_iter()
    }

    /// Reports of the sessions that ended since the last call of this function, the oldest first; a session has one for
    /// each device.
    pub fn sessions(&self) -> impl Iterator<Item = Vec<Report>> + '_ {
        self.sessions.try_iter()
    }

    /// Whether the thread is running.
    pub fn is_running(&self) -> bool {
        self.thread.as_ref().is_some_and(|thread| !thread.is_finished())
    }

    /// Ends the thread after the current step and releases the device. Returns whether the thread ended without a
    /// panic.
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
    /// Sends a command to the thread; nothing happens if the thread has ended.
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

    /// The turns at the GPU's queue; whoever draws a slice must take a turn first.
    pub fn turns(&self) -> &Arc<Turns> {
        &self.turns
    }
}
