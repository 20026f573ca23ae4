//! The simulation's own thread beside whoever looks: it steps, held by a device or led by the scene's keys, does what it is
//! told between two steps, and publishes what it found; nobody ever waits for whoever looks but within its turn
//! (see [`Turns`]).

mod held;
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

/// Samples that wait to be taken at most: more are dropped, the oldest kept.
const SAMPLES: usize = 1 << 14;

/// Makes the device for a session that begins with the tool at a pose.
pub type MakeDevice = Box<dyn FnMut(&Simulation, Key) -> Result<Box<dyn Device>> + Send>;

/// Hears every row; an error ends the run.
pub type Watch = Box<dyn FnMut(&StepReport) -> Result<()> + Send>;

/// What is done with a simulation between two steps; the number changes with the simulation.
pub type Question = Box<dyn FnOnce(&mut Simulation, u64) + Send>;

/// What leads the tool.
pub enum Lead {
    /// The scene's keys, step after step, no faster than the world.
    Drive,
    /// A device in a hand, by the haptic loop.
    Device {
        /// As the user names it.
        name: String,
        /// A session takes one; another begins after each pause, reset, or change of the coupling.
        make: MakeDevice,
    },
}

/// How far it goes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Extent {
    /// Until told to quit.
    Endless,
    /// Steps of the keys.
    Steps(u64),
    /// Of a session, s.
    Seconds(f64),
}

/// What the thread begins with.
pub struct Begin {
    /// Of which no step was done.
    pub simulation: Simulation,
    /// What leads its tool.
    pub lead: Lead,
    /// How far it goes.
    pub extent: Extent,
    /// Hears every row.
    pub watch: Watch,
    /// Where recordings go.
    pub folder: PathBuf,
}

/// What may be told between two steps.
pub enum Command {
    /// Rest, or go on.
    Pause,
    /// One step, and rest.
    Step,
    /// As it was at the start.
    Reset,
    /// Another material of a body, at its index.
    Material(usize, usize, Material),
    /// Another contact law.
    Contact(Contact),
    /// Another coupling; a session begins anew with it, for the loop chooses what is safe.
    Coupling(Coupling),
    /// Record a session from the start on, or end the recording.
    Record,
    /// Another scene with its bodies.
    Replace(Box<(Scene, Bodies)>),
    /// Come to an end.
    Quit,
    /// Anything else, within a turn of drawing.
    Ask(Question),
}

/// The running thread; dropped, it ends after the step under way.
pub struct Live {
    link: Link,
    thread: Option<JoinHandle<()>>,
    snapshots: triple_buffer::Output<Snapshot>,
    samples: rtrb::Consumer<Sample>,
    notes: Receiver<String>,
    sessions: Receiver<Report>,
}

/// What tells the thread; one for each who does.
#[derive(Clone)]
pub struct Link {
    commands: Sender<Command>,
    turns: Arc<Turns>,
}

impl Live {
    /// Begins to step.
    ///
    /// # Errors
    /// The state at the start cannot be saved, or there is no thread to be had.
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
        let thread = thread.map_err(|error| Error::Simulation(format!("no thread for the simulation: {error}")))?;
        Ok(Live { link: Link { commands, turns }, thread: Some(thread), snapshots, samples, notes, sessions })
    }

    /// What tells it, for another thread as well.
    pub fn link(&self) -> &Link {
        &self.link
    }

    /// The newest that it published.
    pub fn snapshot(&mut self) -> &Snapshot {
        self.snapshots.read()
    }

    /// What steps found since this was last asked, the oldest first.
    pub fn samples(&mut self) -> impl Iterator<Item = Sample> + '_ {
        std::iter::from_fn(|| self.samples.pop().ok())
    }

    /// Lines that the user should read.
    pub fn notes(&self) -> impl Iterator<Item = String> + '_ {
        self.notes.try_iter()
    }

    /// What came of sessions with a device that ended since this was last asked, the oldest first.
    pub fn sessions(&self) -> impl Iterator<Item = Report> + '_ {
        self.sessions.try_iter()
    }

    /// Whether the thread is there.
    pub fn is_running(&self) -> bool {
        self.thread.as_ref().is_some_and(|thread| !thread.is_finished())
    }

    /// Ends it after the step under way, and lets the device go. Says whether it ended in order.
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
    /// Tells it; a thread that has ended hears nothing.
    pub fn tell(&self, command: Command) {
        let _ = self.commands.send(command);
    }

    /// Has something done with the simulation between two steps, and waits for it; `None`: the thread has ended.
    pub fn ask<R: Send + 'static>(&self, what: impl FnOnce(&mut Simulation, u64) -> R + Send + 'static) -> Option<R> {
        let (reply, answer) = channel();
        self.tell(Command::Ask(Box::new(move |simulation, generation| {
            // Who asked may be gone.
            let _ = reply.send(what(simulation, generation));
        })));
        answer.recv().ok()
    }

    /// Turns at the device, for slices of drawing.
    pub fn turns(&self) -> &Arc<Turns> {
        &self.turns
    }
}
