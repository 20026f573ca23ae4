//! `palpate replay`: runs a recorded session (run of the haptic loop with a device) again and compares all its results
//! with the recorded ones, bit for bit; or writes the session's ticks (iterations of the haptic loop) as a table.

use std::io::BufReader;
use std::path::{Path, PathBuf};

use clap::builder::NonEmptyStringValueParser;
use indicatif::{ProgressBar, ProgressFinish, ProgressStyle};
use palpate::internal::files;
use palpate::scene::DepthPath;
use palpate::{Error, Options, Result, Scene, Simulation, Threads};
use palpate_devices::record::{self, Entry, Header, Recorded, Table};
use palpate_devices::replay;

use crate::report::Output;
use crate::{print, tell};

/// Options of `palpate replay`.
#[derive(clap::Args)]
pub struct Arguments {
    /// A recording that `palpate run --record` wrote
    file: PathBuf,
    /// Scene file to use if that of the recording has moved or changed [default: the recording's, which must be
    /// unchanged]
    #[arg(long, value_name = "SCENE")]
    scene: Option<PathBuf>,
    /// Vulkan device: its name, or its index in the list of `palpate devices`; results are the same to the last bit
    /// only on the device of the recording
    #[arg(long, value_name = "NAME-OR-INDEX", value_parser = NonEmptyStringValueParser::new())]
    device: Option<String>,
    /// Do not replay; write the recorded ticks (iterations of the haptic loop) as CSV to this file
    #[arg(long, value_name = "OUT", conflicts_with_all = ["scene", "device"])]
    csv: Option<PathBuf>,
}

/// Replays a recording, or writes its ticks as a table.
pub fn replay(arguments: &Arguments) -> Result<()> {
    let (recorded, bar) = open(&arguments.file)?;
    let result = match &arguments.csv {
        Some(out) => export(recorded, out),
        None => again(recorded, arguments),
    };
    bar.finish_and_clear();
    print(&result?)
}

/// Opens the recording; a progress bar on standard error shows how much is read, if standard error is a terminal.
fn open(path: &Path) -> Result<(Recorded, ProgressBar)> {
    let file = files::open(path, "give a file that `palpate run --record` wrote")?;
    let bytes = file.metadata().map_or(0, |facts| facts.len());
    let mut bar = ProgressBar::new(bytes).with_finish(ProgressFinish::AndClear);
    if let Ok(style) = ProgressStyle::with_template("{wide_bar} {bytes} of {total_bytes}, {eta} left") {
        bar = bar.with_style(style);
    }
    Ok((Recorded::read(path, BufReader::new(bar.wrap_read(file)))?, bar))
}

const CUT_SHORT: &str = "the recording was cut short; only its complete part is used";

fn again(recorded: Recorded, arguments: &Arguments) -> Result<String> {
    let header = recorded.header.clone();
    let mut scene = scene_of(&header, arguments)?;
    if let Some(path) = depth_of(&header, &arguments.file)? {
        scene.contact.depth = Some(path);
    }
    let options = Options { device: arguments.device.clone(), threads: Some(Threads::Auto), ..Options::of_program() };
    let mut simulation = Simulation::open(&scene, &options)?;
    let context = simulation.context();
    let now = [env!("CARGO_PKG_VERSION"), context.device_name(), context.driver()];
    for (then, now) in [&header.program, &header.device, &header.driver].into_iter().zip(now) {
        if then != now {
            tell(&format!("recorded with {then}, replayed with {now}: results may differ in the last bits"));
        }
    }
    let replayed = replay::replay(recorded, &mut simulation)?;
    if let Some(difference) = replayed.difference {
        return Err(Error::Simulation(format!("{}: {difference}", arguments.file.display())));
    }
    if !replayed.is_whole {
        tell(CUT_SHORT);
    }
    Ok(format!("replayed {} ticks and {} steps: the same bits\n", replayed.ticks, replayed.steps))
}

/// Loads the scene of the recording, or the one that `--scene` gives.
fn scene_of(header: &Header, arguments: &Arguments) -> Result<Scene> {
    let path = arguments.scene.as_deref().unwrap_or(Path::new(&header.scene));
    if arguments.scene.is_none() && !path.exists() {
        let problem = format!("its scene {} does not exist", path.display());
        return Err(Error::input(&arguments.file, None, problem, "give the scene by --scene"));
    }
    let mut scene = Scene::load(path)?;
    scene.haptics.has_device = true;
    if record::digest(path)? != header.scene_digest {
        let problem = "has changed since the recording";
        if arguments.scene.is_none() {
            return Err(Error::input(path, None, problem, "restore it, or give the scene to replay with by --scene"));
        }
        tell(&format!("{} {problem}", path.display()));
    }
    Ok(scene)
}

fn depth_of(header: &Header, file: &Path) -> Result<Option<DepthPath>> {
    let Some(name) = &header.depth else { return Ok(None) };
    let known = DepthPath::CHOICES.iter().find(|(known, path)| known == name && path.is_some());
    let unknown = || {
        let problem = format!("names in its header an unknown implementation of the depth stage, \"{name}\"");
        Error::input(file, None, problem, "use an undamaged copy")
    };
    Ok(known.ok_or_else(unknown)?.1)
}

/// Writes all ticks as a table; the file appears only when it is complete.
fn export(recorded: Recorded, out: &Path) -> Result<String> {
    let failed = |source| Error::Output { file: out.into(), source };
    let name = out.file_name().and_then(|name| name.to_str());
    let name = name.ok_or_else(|| failed(std::io::ErrorKind::InvalidFilename.into()))?;
    let mut output = Output::create(out.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new(".")))?;
    let mut table = Table::new(output.file(name)?, &recorded.header);
    let (mut ticks, mut is_whole) = (0u64, false);
    for entry in recorded {
        match entry? {
            Entry::Tick(index, tick) => {
                table.write(index, &tick).map_err(failed)?;
                ticks += 1;
            }
            Entry::End(_) => is_whole = true,
            Entry::Begin(..) | Entry::Step(_) => {}
        }
    }
    table.finish().map_err(failed)?;
    output.commit()?;
    if !is_whole {
        tell(CUT_SHORT);
    }
    Ok(format!("wrote {ticks} ticks\n"))
}
