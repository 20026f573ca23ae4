//! Reads recordings of sessions with a haptic device back (`record.rs` describes the format: a header, then entries). A
//! file may come from anywhere: nothing in it is trusted before it is checked.

use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use palpate::internal::files;
use palpate::internal::shaders;
use palpate::{Error, Result};
use serde::de::DeserializeOwned;

use super::{Entry, Header, MAGIC, MOST_BYTES, Totals, VERSION};

const REMEDY: &str = "give a file that `palpate run --record` wrote";

/// Greatest number of haptic devices in a recording.
const MOST_TOOLS: usize = shaders::MOST_TOOLS as usize;

/// An open recording, which iterates over its entries. If the file was cut short, the iteration ends after the last
/// whole entry, without [`Entry::End`].
pub struct Recorded {
    /// Header of the recording.
    pub header: Header,
    file: PathBuf,
    bytes: Box<dyn Read>,
    /// Number of bytes read.
    position: u64,
    /// Numbers of entries read.
    totals: Totals,
    /// For each tool: index of the next tick if none is missing.
    next: Vec<u64>,
    is_over: bool,
}

impl Recorded {
    /// Opens a file and reads its header.
    pub fn open(path: &Path) -> Result<Recorded> {
        Recorded::read(path, BufReader::new(files::open(path, REMEDY)?))
    }

    /// Reads the header of a recording from any source of bytes; `path` is the file's name in errors.
    pub fn read(path: &Path, bytes: impl Read + 'static) -> Result<Recorded> {
        let mut bytes: Box<dyn Read> = Box::new(bytes);
        let not_one = |problem: String| Error::input(path, None, problem, REMEDY);
        let mut opening = [0; MAGIC.len() + 4];
        let is_whole = fill(&mut bytes, &mut opening).map_err(|e| unreadable(path, &e))?;
        let (magic, version) = opening.split_at(MAGIC.len());
        if !is_whole || magic != MAGIC {
            return Err(not_one("is not a recording (a CSV table of ticks cannot be replayed)".into()));
        }
        let version = version.try_into().map_or(0, u32::from_le_bytes);
        if version != VERSION {
            let problem = format!("is a recording of version {version}; this palpate reads version {VERSION}");
            return Err(Error::input(path, None, problem, "use the version of palpate that wrote it"));
        }
        let mut position = opening.len() as u64;
        let header = value::<Header>(path, &mut bytes, &mut position)?;
        let header = header.ok_or_else(|| not_one("is cut short: it ends within the header".into()))?;
        let leaders = header.leaders.len();
        if leaders == 0 || leaders > MOST_TOOLS {
            let problem = format!("its header names {leaders} haptic devices, where 1 to {MOST_TOOLS} are possible");
            return Err(damaged(path, opening.len() as u64, &problem));
        }
        let (totals, file) = (Totals::default(), path.into());
        Ok(Recorded { header, file, bytes, position, totals, next: vec![0; leaders], is_over: false })
    }

    /// Path of the file.
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// Reads the next entry and checks that it is consistent with the entries before; `None` where the file ends.
    fn entry(&mut self) -> Result<Option<Entry>> {
        let at = self.position;
        let Some(entry) = value::<Entry>(&self.file, &mut self.bytes, &mut self.position)? else { return Ok(None) };
        let leaders = self.next.len();
        match &entry {
            Entry::Begin(index, _) | Entry::Tick(index, _) if *index >= leaders => {
                let problem = format!("it is of tool {index}, where the header names {leaders}");
                return Err(damaged(&self.file, at, &problem));
            }
            Entry::Begin(..) => {}
            Entry::Tick(index, tick) if tick.index < self.next[*index] || tick.index == u64::MAX => {
                return Err(damaged(&self.file, at, &format!("tick {} is repeated or out of order", tick.index)));
            }
            Entry::Tick(index, tick) => {
                self.totals.ticks += 1;
                self.totals.lost += tick.index - self.next[*index];
                self.next[*index] = tick.index + 1;
            }
            Entry::Step(step) if [step.inputs.len(), step.wrenches.len()] != [leaders; 2] => {
                let (inputs, wrenches) = (step.inputs.len(), step.wrenches.len());
                let problem =
                    format!("it has {inputs} inputs and {wrenches} wrenches, where the header names {leaders} tools");
                return Err(damaged(&self.file, at, &problem));
            }
            Entry::Step(_) => self.totals.steps += 1,
            Entry::End(totals) => {
                self.is_over = true;
                if *totals != self.totals {
                    let problem = format!("it counts {totals:?}, but the file has {:?}", self.totals);
                    return Err(damaged(&self.file, at, &problem));
                }
                if fill(&mut self.bytes, &mut [0]).map_err(|e| unreadable(&self.file, &e))? {
                    return Err(damaged(&self.file, self.position, "there is more data after the end"));
                }
            }
        }
        Ok(Some(entry))
    }
}

impl Iterator for Recorded {
    type Item = Result<Entry>;

    fn next(&mut self) -> Option<Result<Entry>> {
        if self.is_over {
            return None;
        }
        let entry = self.entry().transpose();
        self.is_over |= !matches!(entry, Some(Ok(_)));
        entry
    }
}

/// Reads a value that is preceded by its length; `None` where the file ends before the end of the value.
fn value<T: DeserializeOwned>(file: &Path, bytes: &mut impl Read, position: &mut u64) -> Result<Option<T>> {
    let at = *position;
    let mut length = [0; 4];
    if !fill(bytes, &mut length).map_err(|e| unreadable(file, &e))? {
        return Ok(None);
    }
    let length = u32::from_le_bytes(length) as usize;
    if length > MOST_BYTES {
        return Err(damaged(file, at, &format!("it is {length} bytes long, more than the {MOST_BYTES} allowed")));
    }
    let mut content = vec![0; length];
    if !fill(bytes, &mut content).map_err(|e| unreadable(file, &e))? {
        return Ok(None);
    }
    *position += 4 + length as u64;
    match postcard::take_from_bytes(&content) {
        Ok((value, [])) => Ok(Some(value)),
        Ok((_, rest)) => Err(damaged(file, at, &format!("it has {} surplus bytes", rest.len()))),
        Err(error) => Err(damaged(file, at, &error.to_string())),
    }
}

/// Fills a buffer; returns whether there were enough bytes.
fn fill(bytes: &mut impl Read, buffer: &mut [u8]) -> std::io::Result<bool> {
    match bytes.read_exact(buffer) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => Ok(false),
        Err(error) => Err(error),
    }
}

fn unreadable(file: &Path, error: &std::io::Error) -> Error {
    Error::input(file, None, format!("cannot be read: {error}"), REMEDY)
}

fn damaged(file: &Path, at: u64, problem: &str) -> Error {
    Error::input(file, None, format!("the entry at byte {at} is damaged: {problem}"), "use an undamaged copy")
}
