//! Recording of a session (one run of the haptic loop with a device): every tick (iteration of the loop) and every step
//! of the simulation go to a file, from which `replay.rs` can run the session again, bit for bit.
//!
//! Format of the file: the eight bytes `palpate` and zero, the version (u32, little endian), the [`Header`], then one
//! [`Entry`] after another, the last of them [`Entry::End`]. Header and entries are encoded with the crate `postcard`,
//! each preceded by its length in bytes (u32, little endian). If the process was killed, [`Entry::End`] is missing, and
//! all entries that were written before can be read.

pub mod fields;
mod log;
mod read;
mod table;
#[cfg(test)]
pub(super) mod tests;

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

pub use log::{Log, Outcome};
use palpate::internal::files;
use palpate::internal::haptics::servo::{Settings, Tick};
use palpate::internal::step::tool::Tool;
use palpate::internal::step::{ContactWrench, DeviceInput};
use palpate::{Error, Result, Scene, Simulation};
pub use read::Recorded;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
pub use table::Table;

/// First bytes of a recording.
const MAGIC: &[u8; 8] = b"palpate\0";
/// Version of the format, which changes whenever the content of header or entries changes.
const VERSION: u32 = 7;
/// Greatest length of a header or an entry, bytes.
const MOST_BYTES: usize = 1 << 20;
/// Size of the write buffer, bytes.
const BUFFER: usize = 1 << 16;

/// The scene, Vulkan device and haptic device of a session; [`Begin`] holds the settings of the haptic loop.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// Version of palpate that made the recording.
    pub program: String,
    /// The scene file's absolute path.
    pub scene: String,
    /// SHA-256 of the scene file alone, without the files that the scene names.
    pub scene_digest: [u8; 32],
    /// Name of the Vulkan device.
    pub device: String,
    /// Driver of the Vulkan device.
    pub driver: String,
    /// Name of the implementation of the depth stage (the part of a step that finds how deep bodies penetrate each
    /// other), see [`name`](palpate::scene::DepthPath::name); `None` if the step has no depth stage.
    pub depth: Option<String>,
    /// The haptic devices, in the order of the tools that they lead.
    pub leaders: Vec<Leader>,
}

/// A haptic device of a session.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Leader {
    /// Name of the tool that it leads.
    pub tool: String,
    /// Name of its profile (set of its limits).
    pub profile: String,
    /// Name of the kind of device, as the user gives it.
    pub device: String,
}

impl Header {
    /// The header of a session of `simulation`, whose scene `scene` was loaded from a file, with these haptic devices.
    pub fn new(scene: &Scene, simulation: &Simulation, leaders: Vec<Leader>) -> Result<Header> {
        let context = simulation.context();
        // Without a working directory there are no absolute paths; then a replay must be given the scene's path.
        let absolute = std::path::absolute(&scene.file).unwrap_or_else(|_| scene.file.clone());
        Ok(Header {
            program: env!("CARGO_PKG_VERSION").into(),
            scene: absolute.to_string_lossy().into_owned(),
            scene_digest: digest(&scene.file)?,
            device: context.device_name().into(),
            driver: context.driver().into(),
            depth: simulation.depth_path().map(|path| path.name().into()),
            leaders,
        })
    }
}

/// SHA-256 of a scene file.
pub fn digest(scene: &Path) -> Result<[u8; 32]> {
    Ok(Sha256::digest(files::bytes(scene, files::MOST_TEXT, "give a scene file")?).into())
}

/// What the servo (the haptic loop's controller, called once a tick) was made with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Begin {
    /// Settings of the servo, including the period of a tick.
    pub settings: Settings,
    /// The tool (rigid body that the device leads), including its virtual coupling (spring and damper) to the device.
    pub tool: Tool,
}

/// A step of the simulation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// Inputs of the step: pose and twist of each haptic device and tool.
    pub inputs: Vec<DeviceInput>,
    /// Length of the step, s.
    pub h: f64,
    /// Contact wrench (force and torque) on each of the tools that the step returned.
    pub wrenches: Vec<ContactWrench>,
}

/// Numbers of entries in a recording, of all devices together.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Totals {
    /// Ticks recorded.
    pub ticks: u64,
    /// Steps recorded.
    pub steps: u64,
    /// Ticks missing before the first recorded tick or between recorded ticks.
    pub lost: u64,
}

/// An entry of a recording. An index is that of a tool, from 0.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Entry {
    /// What the servo of a tool was made with: the first entries, one for each tool in order.
    Begin(usize, Box<Begin>),
    /// A tick of a tool's loop.
    Tick(usize, Box<Tick>),
    /// A step of the simulation. The entry may come after ticks that already used the step's wrench.
    Step(Box<Step>),
    /// The regular end of the session: the last entry.
    End(Totals),
}

/// A recording being written. If it is dropped before [`Recording::finish`], all that was recorded is in the file; of one
/// that can be replayed, only [`Entry::End`] is missing.
pub struct Recording {
    file: PathBuf,
    sink: Sink,
    totals: Totals,
    /// For each tool: index of the next tick if no tick is missing.
    next: Vec<u64>,
}

enum Sink {
    Binary(BufWriter<File>),
    Csv(Box<Table<BufWriter<File>>>),
    Mcap(Box<Log<BufWriter<File>>>),
}

impl Recording {
    /// Creates the file, which must not exist. A file that cannot be replayed is made where its name ends in
    /// `.csv`, with the ticks alone as a table (see [`Table`]), and in `.mcap`, with all of it for other programs (see
    /// [`Log`]).
    pub fn create(path: &Path, header: &Header) -> Result<Recording> {
        let ending = path.extension().unwrap_or_default().to_ascii_lowercase();
        let failed = |source| Error::Output { file: path.into(), source };
        let mut file = BufWriter::with_capacity(BUFFER, File::create_new(path).map_err(failed)?);
        let sink = match ending.to_str() {
            Some("csv") => Sink::Csv(Box::new(Table::new(file, header))),
            Some("mcap") => Sink::Mcap(Box::new(Log::new(file, header).map_err(failed)?)),
            _ => {
                let opening = [MAGIC.as_slice(), &VERSION.to_le_bytes()].concat();
                file.write_all(&opening).and_then(|()| write(&mut file, header)).map_err(failed)?;
                Sink::Binary(file)
            }
        };
        Ok(Recording { file: path.into(), sink, totals: Totals::default(), next: vec![0; header.leaders.len()] })
    }

    /// Whether the file has room for what [`Recording::outcome`] records. Only an MCAP log does.
    pub fn takes_outcomes(&self) -> bool {
        matches!(self.sink, Sink::Mcap(_))
    }

    /// Records what the servo of the tool `index` was made with; called for each tool in order, before the first tick and
    /// the first step.
    pub fn begin(&mut self, index: usize, settings: &Settings, tool: &Tool) -> Result<()> {
        self.put(Entry::Begin(index, Box::new(Begin { settings: *settings, tool: tool.clone() })))
    }

    /// Records a tick of the loop of the tool `index`, which is one of those in the header.
    pub fn tick(&mut self, index: usize, tick: &Tick) -> Result<()> {
        self.totals.ticks += 1;
        self.totals.lost += tick.index.saturating_sub(self.next[index]);
        self.next[index] = tick.index + 1;
        self.put(Entry::Tick(index, Box::new(*tick)))
    }

    /// Records a step of `h` s with its inputs and the contact wrenches that it returned.
    pub fn step(&mut self, inputs: &[DeviceInput], h: f64, wrenches: &[ContactWrench]) -> Result<()> {
        self.totals.steps += 1;
        self.put(Entry::Step(Box::new(Step { inputs: inputs.into(), h, wrenches: wrenches.into() })))
    }

    /// Records the outcome of the step whose inputs were taken at `time`, s; does nothing unless
    /// [`Recording::takes_outcomes`].
    pub fn outcome(&mut self, time: f64, outcome: &Outcome) -> Result<()> {
        match &mut self.sink {
            Sink::Mcap(log) => log.outcome(time, outcome),
            Sink::Binary(_) | Sink::Csv(_) => Ok(()),
        }
        .map_err(|source| Error::Output { file: self.file.clone(), source })
    }

    /// Writes [`Entry::End`] and returns the numbers of entries.
    pub fn finish(mut self) -> Result<Totals> {
        self.put(Entry::End(self.totals))?;
        let flushed = match self.sink {
            Sink::Binary(mut file) => file.flush(),
            Sink::Csv(table) => table.finish(),
            Sink::Mcap(log) => log.finish(),
        };
        flushed.map_err(|source| Error::Output { file: self.file, source })?;
        Ok(self.totals)
    }

    /// Writes an entry, or as much of it as the file's format has room for.
    fn put(&mut self, entry: Entry) -> Result<()> {
        match (&mut self.sink, &entry) {
            (Sink::Binary(file), _) => write(file, &entry),
            (Sink::Csv(table), Entry::Tick(index, tick)) => table.write(*index, tick),
            (Sink::Mcap(log), Entry::Begin(index, begin)) => log.begin(*index, begin),
            (Sink::Mcap(log), Entry::Tick(index, tick)) => log.tick(*index, tick),
            (Sink::Mcap(log), Entry::Step(step)) => log.step(step),
            (Sink::Csv(_) | Sink::Mcap(_), _) => Ok(()),
        }
        .map_err(|source| Error::Output { file: self.file.clone(), source })
    }
}

/// Writes a value, preceded by its length.
fn write(file: &mut impl Write, value: &impl Serialize) -> std::io::Result<()> {
    let bytes = postcard::to_stdvec(value).map_err(std::io::Error::other)?;
    if bytes.len() > MOST_BYTES {
        return Err(std::io::Error::other("an entry of the recording is too long"));
    }
    file.write_all(&(bytes.len() as u32).to_le_bytes())?;
    file.write_all(&bytes)
}
