//! `palpate run --export`: the bodies, the fields of the soft ones and the contacts over time, as VTK files for ParaView
//! and Python. What a moment needs is copied between two steps; a thread of its own makes files of it while steps go on.
//! A step waits only where that thread is [`AHEAD`] moments behind, so that none is lost.

mod fields;
mod files;
mod moment;

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use palpate::internal::files as inputs;
use palpate::scene::vtk_xml::read_series;
use palpate::{Error, Result, Scene, Simulation};

use crate::report::Output;
use crate::run::{positive, steps};
use files::{Files, Series};
use moment::Moment;

/// Number of moments that may wait to be written.
const AHEAD: usize = 4;
/// Moments of a simulated second, where nothing else is asked for.
const FPS: f64 = 25.0;

/// Options of `palpate run` on series of files.
#[derive(clap::Args)]
pub struct Arguments {
    /// Directory to write the bodies, their fields and the contacts over time into, as VTK files for ParaView: for each
    /// body and for the contacts a .pvd file, which lists a .vtu file for each moment
    #[arg(long, value_name = "DIR", conflicts_with = "explain")]
    export: Option<PathBuf>,
    /// Write a moment every N steps
    #[arg(long, value_name = "N", requires = "export", conflicts_with = "fps", value_parser = steps, allow_negative_numbers = true)]
    every: Option<u64>,
    /// Moments to write per simulated second [default: 25]
    #[arg(long, value_name = "F", requires = "export", value_parser = positive, allow_negative_numbers = true)]
    fps: Option<f64>,
    /// How well the series is compressed, from 1 (fast) to 9 (small); 0 does not compress
    #[arg(long, value_name = "N", requires = "export", default_value_t = 1, value_parser = clap::value_parser!(u8).range(0..=9), allow_negative_numbers = true)]
    compression: u8,
}

/// A series of files that is being written. If it is dropped before [`Export::end`], nothing of it is left.
pub struct Export {
    folder: PathBuf,
    schedule: Schedule,
    /// `None` once the writer was told to end.
    moments: Option<SyncSender<Moment>>,
    /// Steps after which the last moment was taken.
    last: Option<u64>,
    /// `None` once the writer has ended.
    writer: Option<JoinHandle<Result<(Output, Series)>>>,
}

/// Which moments are written.
enum Schedule {
    /// Every so many steps.
    Steps(u64),
    /// So many in a simulated second. `next`: number of the next one.
    Frames { per_second: f64, next: f64 },
}

impl Schedule {
    /// Whether the moment after so many steps, at `time` (s), is one; at each moment this is asked once.
    fn is_due(&mut self, steps: u64, time: f64) -> bool {
        match self {
            Schedule::Steps(every) => steps.is_multiple_of(*every),
            Schedule::Frames { per_second, next } => {
                // Times are sums of steps, and a little wrong.
                let now = (time * *per_second + 1e-6).floor();
                let is_due = now >= *next;
                *next = next.max(now + 1.0);
                is_due
            }
        }
    }
}

impl Export {
    /// Begins a series where one is asked for, with the bodies as they are before the first step. `results`: the
    /// directory that the run's results go into.
    pub fn begin(
        arguments: &Arguments,
        results: Option<&Path>,
        scene: &Scene,
        simulation: &mut Simulation,
    ) -> Result<Option<Export>> {
        let Some(folder) = &arguments.export else { return Ok(None) };
        let same = |other: &Path| matches!((other.canonicalize(), folder.canonicalize()), (Ok(a), Ok(b)) if a == b);
        if results.is_some_and(|results| results == folder || same(results)) {
            let what = "--out and --export give the same directory";
            return Err(Error::Usage(format!(
                "{what}: give two, such as --export {}",
                folder.join("series").display()
            )));
        }
        let per_second = arguments.fps.unwrap_or(FPS.min(1.0 / scene.step.dt));
        if per_second * scene.step.dt > 1.0 + 1e-9 {
            let problem = format!("{per_second:?} moments per simulated second are more than there are steps");
            return Err(Error::key(&scene.file, "step.dt", problem, "give a smaller --fps, or --every 1"));
        }
        let schedule = match arguments.every {
            Some(every) => Schedule::Steps(every),
            None => Schedule::Frames { per_second, next: 0.0 },
        };
        let output = Output::create(folder)?;
        let files = Files::new(simulation, output, arguments.compression);
        let (moments, received) = sync_channel(AHEAD);
        let writer = std::thread::Builder::new()
            .name("export".into())
            .spawn(move || write(files, &received))
            .map_err(|source| Error::Output { file: folder.clone(), source })?;
        let (moments, writer) = (Some(moments), Some(writer));
        let mut export = Export { folder: folder.clone(), schedule, last: None, moments, writer };
        export.after(0, simulation)?;
        Ok(Some(export))
    }

    /// Takes the present moment, after so many steps, if it is due.
    pub fn after(&mut self, steps: u64, simulation: &mut Simulation) -> Result<()> {
        if self.schedule.is_due(steps, simulation.time()) { self.take(steps, simulation) } else { Ok(()) }
    }

    /// Takes the last moment, due or not.
    pub fn last(&mut self, steps: u64, simulation: &mut Simulation) -> Result<()> {
        if self.last == Some(steps) { Ok(()) } else { self.take(steps, simulation) }
    }

    fn take(&mut self, steps: u64, simulation: &mut Simulation) -> Result<()> {
        self.last = Some(steps);
        // A writer that has failed takes no more; its error is told at the end, when the run's other results are kept.
        if let (Some(moments), false) = (&self.moments, self.writer.as_ref().is_none_or(JoinHandle::is_finished)) {
            let _ = moments.send(Moment::of(steps, simulation)?);
        }
        Ok(())
    }

    /// Waits until all is written, gives the files their names, and returns the directory. Files of an older series that
    /// the new one does not have are removed.
    pub fn end(mut self) -> Result<PathBuf> {
        let folder = std::mem::take(&mut self.folder);
        let lost = || Error::Simulation(format!("internal error: the series {} is not written", folder.display()));
        let (output, series) = self.written().ok_or_else(lost)??;
        // The older series is not an input, though it is looked at.
        let older = inputs::unnoticed(|| older(&folder, &series));
        if let Some(file) = older.iter().find(|file| inputs::is_input(file)) {
            let problem = "is of the older series that this one would replace, but this command reads it";
            return Err(Error::input(file, None, problem, "export into another folder"));
        }
        output.commit()?;
        for file in older {
            std::fs::remove_file(&file).map_err(|source| Error::Output { file, source })?;
        }
        Ok(folder)
    }

    /// Waits until the writer has ended, and returns what it leaves; `None` if it has panicked, or was waited for before.
    fn written(&mut self) -> Option<Result<(Output, Series)>> {
        self.moments = None;
        self.writer.take()?.join().ok()
    }
}

impl Drop for Export {
    /// Waits for the writer, which removes its unfinished files; the program may end next.
    fn drop(&mut self) {
        drop(self.written());
    }
}

/// Files that the lists of an older series in `folder` name, of those that the new series replaces; none that it has too.
fn older(folder: &Path, series: &Series) -> Vec<PathBuf> {
    let mut older = Vec::new();
    for (name, files) in series {
        let begin = format!("{name}-");
        let is_own = |file: &PathBuf| {
            let file = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let number = file.strip_prefix(&begin).and_then(|rest| rest.strip_suffix(".vtu"));
            let is_of_series =
                number.is_some_and(|number| !number.is_empty() && number.bytes().all(|c| c.is_ascii_digit()));
            is_of_series && files.iter().all(|(_, new)| *new != file)
        };
        let listed = read_series(&folder.join(format!("{name}.pvd"))).unwrap_or_default();
        let there =
            listed.into_iter().map(|(_, file)| file).filter(|file| file.parent() == Some(folder) && file.exists());
        older.extend(there.filter(is_own));
    }
    older.dedup();
    older
}

/// Writes all moments that come, then the lists of files.
fn write(mut files: Files, moments: &Receiver<Moment>) -> Result<(Output, Series)> {
    for moment in moments {
        files.write(moment)?;
    }
    files.end()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers of the steps of `h` seconds after which a moment is written.
    fn due(mut schedule: Schedule, h: f64, count: u64) -> Vec<u64> {
        let mut time = 0.0;
        let mut is_due = |k: u64| {
            time += if k == 0 { 0.0 } else { h };
            schedule.is_due(k, time)
        };
        (0..=count).filter(|k| is_due(*k)).collect()
    }

    #[test]
    fn moments_are_due_by_steps_or_by_time() {
        assert_eq!(due(Schedule::Steps(3), 0.005, 10), [0, 3, 6, 9]);
        let frames = |per_second| Schedule::Frames { per_second, next: 0.0 };
        assert_eq!(due(frames(25.0), 0.005, 24), [0, 8, 16, 24]);
        // A moment is that of the first step that ends no earlier.
        assert_eq!(due(frames(30.0), 0.01, 10), [0, 4, 7, 10]);
        assert_eq!(due(frames(1e3), 1e-3, 1000).len(), 1001);
        // Steps that are too long for the rate give one moment each.
        assert_eq!(due(frames(1e3), 0.005, 3), [0, 1, 2, 3]);
    }
}
