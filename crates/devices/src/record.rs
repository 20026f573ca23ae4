//! A session on record: every tick of the loop and every step of the simulation, in a file of which all of it can be had
//! again, bit for bit.
//!
//! The file: eight bytes `palpate` and a zero, the version (u32, little endian), the [`Header`], then [`Entry`] after entry,
//! the last of them [`Entry::End`]. Header and entries are postcard, each after its length in bytes (u32, little endian).
//! Where a process was killed the end is missing, and what was written before can be read.

pub mod fields;
mod read;
mod table;
#[cfg(test)]
pub(super) mod tests;

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use palpate::internal::haptics::servo::{Settings, Tick};
use palpate::internal::step::tool::Tool;
use palpate::internal::step::{ContactWrench, Held};
use palpate::{Error, Result, Scene, Simulation};
pub use read::Recorded;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
pub use table::Table;

/// Opens a recording.
const MAGIC: &[u8; 8] = b"palpate\0";
/// Of the format. It changes with anything that is recorded.
const VERSION: u32 = 2;
/// No header or entry is longer, bytes.
const MOST_BYTES: usize = 1 << 20;
/// Written at once, bytes.
const BUFFER: usize = 1 << 16;

/// What a session was made of, the simulation's side.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// Version of palpate.
    pub program: String,
    /// The scene file's absolute path.
    pub scene: String,
    /// SHA-256 of the scene file. Files that the scene names are not in it.
    pub scene_digest: [u8; 32],
    /// Name of the Vulkan device.
    pub device: String,
    /// Its driver.
    pub driver: String,
    /// Path of the depth stage, by [`name`](palpate::scene::DepthPath::name), where the step has one.
    pub depth: Option<String>,
    /// Name of the haptic device's profile.
    pub profile: String,
    /// The haptic device, as the user names it.
    pub haptic_device: String,
}

impl Header {
    /// Of a simulation of a scene that was loaded from a file, held by a device of that profile.
    pub fn new(scene: &Scene, simulation: &Simulation, profile: &str, haptic_device: &str) -> Result<Header> {
        let context = simulation.context();
        // Without a working directory there are no absolute paths: the scene must be given to replay it.
        let absolute = std::path::absolute(&scene.file).unwrap_or_else(|_| scene.file.clone());
        Ok(Header {
            program: env!("CARGO_PKG_VERSION").into(),
            scene: absolute.to_string_lossy().into_owned(),
            scene_digest: digest(&scene.file)?,
            device: context.device_name().into(),
            driver: context.driver().into(),
            depth: simulation.depth_path().map(|path| path.name().into()),
            profile: profile.into(),
            haptic_device: haptic_device.into(),
        })
    }
}

/// SHA-256 of a scene file.
pub fn digest(scene: &Path) -> Result<[u8; 32]> {
    let bytes = std::fs::read(scene)
        .map_err(|error| Error::input(scene, None, format!("cannot be read: {error}"), "give a scene file"))?;
    Ok(Sha256::digest(bytes).into())
}

/// What the servo was made with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Begin {
    /// Its settings, its rate among them.
    pub settings: Settings,
    /// The tool, coupling included.
    pub tool: Tool,
}

/// A step of the simulation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// What it started from.
    pub held: Held,
    /// Its length, s.
    pub h: f64,
    /// What it found.
    pub wrench: ContactWrench,
}

/// How many entries a whole recording holds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Totals {
    /// Ticks.
    pub ticks: u64,
    /// Steps.
    pub steps: u64,
    /// Ticks that are missing between others.
    pub lost: u64,
}

/// What a recording holds, in order.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Entry {
    /// The servo, as it begins: the first entry.
    Begin(Box<Begin>),
    /// A tick of the loop.
    Tick(Box<Tick>),
    /// A step of the simulation. It may stand after ticks that felt it already.
    Step(Box<Step>),
    /// The session ended in order.
    End(Totals),
}

/// A recording being written. Dropped before [`Recording::finish`] it has no end, but all that came before.
pub struct Recording {
    file: PathBuf,
    sink: Sink,
    totals: Totals,
    /// Index of the next tick where none is lost.
    next: u64,
}

enum Sink {
    Binary(BufWriter<File>),
    Csv(Box<Table<BufWriter<File>>>),
}

impl Recording {
    /// A new file; one that was there before is replaced. A name that ends in `.csv` takes the ticks alone, as a table (see
    /// [`Table`]), which cannot be replayed.
    pub fn create(path: &Path, header: &Header) -> Result<Recording> {
        let is_table = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("csv"));
        let failed = |source| Error::Output { file: path.into(), source };
        let mut file = BufWriter::with_capacity(BUFFER, File::create(path).map_err(failed)?);
        let sink = match is_table {
            true => Sink::Csv(Box::new(Table::new(file))),
            false => {
                let opening = [MAGIC.as_slice(), &VERSION.to_le_bytes()].concat();
                file.write_all(&opening).and_then(|()| write(&mut file, header)).map_err(failed)?;
                Sink::Binary(file)
            }
        };
        Ok(Recording { file: path.into(), sink, totals: Totals::default(), next: 0 })
    }

    /// The servo, as it begins: before all ticks and steps.
    pub fn begin(&mut self, settings: &Settings, tool: &Tool) -> Result<()> {
        self.put(Entry::Begin(Box::new(Begin { settings: *settings, tool: tool.clone() })))
    }

    /// A tick of the loop.
    pub fn tick(&mut self, tick: &Tick) -> Result<()> {
        self.totals.ticks += 1;
        self.totals.lost += tick.index.saturating_sub(self.next);
        self.next = tick.index + 1;
        match &mut self.sink {
            Sink::Csv(table) => table.write(tick).map_err(|source| Error::Output { file: self.file.clone(), source }),
            Sink::Binary(_) => self.put(Entry::Tick(Box::new(*tick))),
        }
    }

    /// A step of `h` s: what it started from, what it found.
    pub fn step(&mut self, held: &Held, h: f64, wrench: &ContactWrench) -> Result<()> {
        self.totals.steps += 1;
        self.put(Entry::Step(Box::new(Step { held: *held, h, wrench: *wrench })))
    }

    /// Writes the end; how much there was.
    pub fn finish(mut self) -> Result<Totals> {
        self.put(Entry::End(self.totals))?;
        let flushed = match self.sink {
            Sink::Binary(mut file) => file.flush(),
            Sink::Csv(table) => table.finish(),
        };
        flushed.map_err(|source| Error::Output { file: self.file, source })?;
        Ok(self.totals)
    }

    /// A table has no place for it.
    fn put(&mut self, entry: Entry) -> Result<()> {
        let Sink::Binary(file) = &mut self.sink else { return Ok(()) };
        write(file, &entry).map_err(|source| Error::Output { file: self.file.clone(), source })
    }
}

/// A value after its length.
fn write(file: &mut impl Write, value: &impl Serialize) -> std::io::Result<()> {
    let bytes = postcard::to_stdvec(value).map_err(std::io::Error::other)?;
    if bytes.len() > MOST_BYTES {
        return Err(std::io::Error::other("an entry is too long"));
    }
    file.write_all(&(bytes.len() as u32).to_le_bytes())?;
    file.write_all(&bytes)
}
