//! `palpate run`: simulates a scene from the first step to the last, and writes a trace (one row per step) and the
//! state at the end. The *tool* is the rigid body that the haptic device leads.

use std::io::{BufReader, Write};
use std::path::PathBuf;

use clap::builder::{NonEmptyStringValueParser, PossibleValuesParser};
use indicatif::{ProgressBar, ProgressFinish, ProgressStyle};
use palpate::internal::gpu::Arrays;
use palpate::internal::haptics::session::Report;
use palpate::scene::profile::PROFILES;
use palpate::scene::{DepthPath, DeviceKind, Leader, obj, vtk};
use palpate::{Error, Flags, Options, Result, Scene, Simulation, StepReport, Threads};
use palpate_devices::Replay;

use crate::engine::{self, Engine, Outcome};
use crate::export::Export;
use crate::hold::Played;
use crate::report::felt::{self, Distance};
use crate::report::haptics::Closing;
use crate::report::page::{Page, Session, Shot};
use crate::report::summary::{ClosingTable, RaisedFlags};
use crate::report::{self, Names, Output, Summary, Tally, Trace, curves};
use crate::signals::Stop;
use crate::{ending, export, hold, print, tell};

/// Greatest number of threads that `--threads` accepts.
const MOST_THREADS: u32 = 1024;
const TRACE: &str = "trace.csv";
const SUMMARY: &str = "summary.json";
const PAGE: &str = "report.html";
/// Greatest number of steps, a little more than a day at 1 kHz; limited because the times of all steps are kept in
/// memory for the closing table.
const MOST_STEPS: u64 = 100_000_000;
/// Greatest number of solver iterations that `--explain` accepts; a scene file has the same limit.
const MOST_ITERATIONS: u32 = 10_000;
const EXPLANATION: &str = "explain.json";
/// Names of the kinds of buffers through which GPU kernels read their arrays.
const ARRAYS: [(&str, Arrays); 2] = [("texel", Arrays::Texel), ("storage", Arrays::Storage)];

/// Options of `palpate run`.
#[derive(clap::Args)]
pub struct Arguments {
    /// The scene, a TOML file
    scene: PathBuf,
    /// Number of steps [default: up to the last key (timed pose) of the scene's [drive]; one second if there are no
    /// keys]
    #[arg(long, value_name = "N", conflicts_with = "seconds", value_parser = steps, allow_negative_numbers = true)]
    steps: Option<u64>,
    /// Time to simulate, s
    #[arg(long, value_name = "S", value_parser = positive, allow_negative_numbers = true)]
    seconds: Option<f64>,
    /// Vulkan device: its name, or its index in the list of `palpate devices`
    #[arg(long, value_name = "NAME-OR-INDEX", value_parser = NonEmptyStringValueParser::new())]
    device: Option<String>,
    /// Kind of buffers through which GPU kernels read their arrays [default: the kind that the device's limits allow;
    /// if they allow both, the faster one, measured once per device]
    #[arg(long, value_name = "KIND", value_parser = PossibleValuesParser::new(ARRAYS.map(|(name, _)| name)))]
    arrays: Option<String>,
    /// Greatest number of elements of a texel buffer, below the device's own limit: imitates a less capable device
    #[arg(long, value_name = "N")]
    texel_elements: Option<u32>,
    /// Number of invocations in a workgroup of GPU kernels whose invocations synchronise, a power of two from 8 to 256
    /// [default: the environment variable PALPATE_WORKGROUP; else one subgroup on a CPU, 128 elsewhere]
    #[arg(long, value_name = "N")]
    workgroup: Option<u32>,
    /// Worker threads of Mesa's CPU driver lavapipe, unless the environment variable LP_NUM_THREADS is set: a number,
    /// "auto" (none below 10000 tetrahedra, else the driver's default) or "driver" (the driver's default)
    #[arg(long, value_name = "N", default_value = "auto", value_parser = lavapipe_threads)]
    threads: LavapipeThreads,
    /// Implementation of the depth stage (which finds how deep vertices lie within other bodies) to use instead of the
    /// scene's; auto is the faster one, measured once per device
    #[arg(long, value_name = "PATH", value_parser = PossibleValuesParser::new(DepthPath::CHOICES.map(|(name, _)| name)))]
    depth: Option<String>,
    /// Haptic device that holds the tool, in real time, with 1000 force updates per second unless the scene says
    /// otherwise [default: the scene's device]
    #[arg(long, value_name = "DEVICE", value_parser = PossibleValuesParser::new(DeviceKind::CHOICES.map(|(name, _)| name)))]
    haptics: Option<String>,
    /// Profile (limits of force and workspace) of the haptic device, instead of the scene's; a real device's can only
    /// be lowered
    #[arg(long, value_name = "NAME", value_parser = PossibleValuesParser::new(PROFILES.map(|profile| profile.name)))]
    profile: Option<String>,
    /// File to record every tick (iteration) of the haptic loop into, for `palpate replay`. A file that cannot be replayed
    /// is made if its name ends in .csv, a table, or in .mcap, a log for Foxglove and rerun with the contacts of every step
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Do not simulate; print which GPU passes a step of N (default 16) solver iterations has, which are left out, and
    /// why
    #[arg(long, value_name = "N", num_args = 0..=1, require_equals = true, default_missing_value = "16",
        conflicts_with_all = ["steps", "seconds", "record"], value_parser = iterations)]
    explain: Option<u32>,
    /// Time every GPU pass of every step by itself, instead of every stage in one step of eight. The step takes longer:
    /// no two passes overlap
    #[arg(long, conflicts_with = "explain")]
    passes: bool,
    /// Write an image every N steps, `snapshot-STEP.png`
    #[cfg(feature = "view")]
    #[arg(long, value_name = "N", requires = "out", conflicts_with = "explain", value_parser = steps, allow_negative_numbers = true)]
    snapshot: Option<u64>,
    #[cfg(feature = "view")]
    #[command(flatten)]
    look: crate::film::Look,
    #[command(flatten)]
    series: export::Arguments,
    /// Directory to write results into; without it nothing is written
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

impl Arguments {
    fn device_options(&self) -> Options {
        let program = Options::of_program();
        let arrays = self.arrays.as_ref().and_then(|name| ARRAYS.iter().find(|(known, _)| known == name));
        Options {
            device: self.device.clone(),
            arrays: arrays.map(|(_, arrays)| *arrays),
            texel_elements: self.texel_elements,
            threads: self.threads.0,
            workgroup: self.workgroup.or(program.workgroup),
            ..program
        }
    }
}

/// Value of the option `--threads`.
#[derive(Clone, Copy)]
struct LavapipeThreads(Option<Threads>);

fn lavapipe_threads(text: &str) -> std::result::Result<LavapipeThreads, String> {
    match text {
        "auto" => Ok(LavapipeThreads(Some(Threads::Auto))),
        "driver" => Ok(LavapipeThreads(None)),
        _ => match text.parse() {
            Ok(count @ 0..=MOST_THREADS) => Ok(LavapipeThreads(Some(Threads::Count(count)))),
            _ => Err(format!("give a number up to {MOST_THREADS}, \"auto\" or \"driver\"")),
        },
    }
}

pub fn positive(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number > 0.0 && number.is_finite() => Ok(number),
        _ => Err("give a number greater than zero".into()),
    }
}

fn iterations(text: &str) -> std::result::Result<u32, String> {
    let iterations = text.parse().ok().filter(|iterations| (1..=MOST_ITERATIONS).contains(iterations));
    iterations.ok_or_else(|| format!("give a whole number from 1 to {MOST_ITERATIONS}"))
}

pub fn steps(text: &str) -> std::result::Result<u64, String> {
    let steps = text.parse().ok().filter(|steps| (1..=MOST_STEPS).contains(steps));
    steps.ok_or_else(|| format!("give a whole number from 1 to {MOST_STEPS}"))
}

/// Duration, s, of a session (run of the haptic loop with a device): the value of `--seconds`. Without it, the duration
/// is unlimited for hardware, which a person holds; for a recording it is the number of recorded ticks (iterations of
/// the loop) over the loop's rate; otherwise it is the duration of the scene. Of several devices the longest counts.
fn seconds_of(arguments: &Arguments, scene: &Scene) -> Result<f64> {
    if let Some(steps) = arguments.steps {
        let problem = format!("{steps} steps were requested, but a session with a haptic device is limited by time");
        return Err(Error::key(&scene.file, "haptics.device", problem, "give --seconds instead of --steps"));
    }
    if let Some(seconds) = arguments.seconds {
        return Ok(seconds);
    }
    let mut leaders = (0..scene.held_tools()).filter_map(|index| scene.leader(index));
    leaders.try_fold(0.0, |longest: f64, Leader { index, haptics, .. }| {
        let seconds = match (haptics.device, &haptics.recording) {
            (device, _) if device.is_real() => f64::INFINITY,
            (DeviceKind::Replay, Some(recording)) => Replay::open(recording, index)?.ticks() as f64 / haptics.rate,
            _ => scene.duration(),
        };
        Ok(longest.max(seconds))
    })
}

/// The number of steps to do; refuses more than [`MOST_STEPS`].
fn steps_of(arguments: &Arguments, scene: &Scene) -> Result<Extent> {
    let seconds = arguments.seconds.unwrap_or(scene.duration());
    let steps = arguments.steps.unwrap_or_else(|| (seconds / scene.step.dt).round().max(1.0) as u64);
    if steps <= MOST_STEPS {
        return Ok(Extent::Steps(steps));
    }
    let problem = format!("{seconds:?} s are more than {MOST_STEPS} steps of {:?} s", scene.step.dt);
    Err(Error::key(&scene.file, "step.dt", problem, "give a longer time step, or fewer --steps or --seconds"))
}

/// Runs a scene. Input is read and prepared before the Vulkan device is opened; the output directory is made
/// afterwards.
pub fn run(arguments: &Arguments) -> Result<()> {
    #[cfg(feature = "view")]
    arguments.look.shown()?;
    #[cfg(feature = "view")]
    if arguments.snapshot.is_none() && arguments.look.is_asked_for() {
        let what = "--size, --camera, --at, --show and --no-time apply to images only, and none are requested";
        return Err(Error::Usage(format!("{what}: give --snapshot N as well")));
    }
    let mut scene = Scene::load(&arguments.scene)?;
    if let Some(name) = &arguments.depth {
        scene.contact.depth = DepthPath::CHOICES.iter().find(|(known, _)| known == name).and_then(|(_, path)| *path);
    }
    if let Some(name) = &arguments.haptics {
        let kind = DeviceKind::CHOICES.iter().find(|(known, _)| known == name);
        scene.haptics.device = kind.map_or(scene.haptics.device, |(_, kind)| *kind);
    }
    arguments.record.as_deref().map_or(Ok(()), hold::refuse_existing)?;
    if arguments.record.is_some() && arguments.haptics.is_none() && !scene.haptics.has_device {
        tell(
            "--record makes this a session in real time, whose device follows [drive]; --haptics gives another device",
        );
    }
    scene.haptics.has_device |= arguments.haptics.is_some() || arguments.record.is_some();
    if let Some(name) = &arguments.profile {
        hold::choose_profile(&mut scene, name)?;
    }
    if let Some(iterations) = arguments.explain {
        return explain(arguments, &scene, iterations);
    }
    #[cfg(feature = "view")]
    if scene.haptics.has_device && arguments.snapshot.is_some() {
        let problem = "runs in real time, and rendering images would delay it";
        let remedy = "leave out --snapshot, or use palpate view";
        return Err(Error::key(&scene.file, "haptics.device", problem, remedy));
    }
    let extent = if scene.haptics.has_device {
        Extent::Seconds(seconds_of(arguments, &scene)?)
    } else {
        steps_of(arguments, &scene)?
    };
    let mut engine = Engine::open(&scene, &arguments.device_options())?;
    engine.simulation().notes().iter().for_each(|note| tell(note));
    if arguments.passes {
        engine.time_passes()?;
    }
    let mut output = arguments.out.as_deref().map(Output::create).transpose()?;
    let mut series = Export::begin(&arguments.series, arguments.out.as_deref(), &scene, engine.simulation_mut())?;
    let stop = Stop::new()?;
    let done = simulate(engine, &stop, &scene, &extent, arguments, output.as_mut(), series.as_mut())?;
    let series = series.map(Export::end);
    let page = match output {
        None => "no page was written: give --out DIR for one".into(),
        Some(mut output) => {
            let page = format!("report: {}", output.path(PAGE).display());
            write_end(&mut output, &scene, &done)?;
            output.commit()?;
            page
        }
    };
    // The run's results are kept even if the series is not.
    let series = series.transpose()?;
    let Done { tally, outcome, reports, nearest, .. } = &done;
    let series = series.map(|folder| format!("series: {}\n", folder.display())).unwrap_or_default();
    let remedy = felt::remedy(tally, felt::advice(&scene), nearest.as_ref());
    print(&format!(
        "{}\n{}{}{}{}{series}{page}\n",
        felt::headline(tally),
        remedy.map(|remedy| format!("{remedy}\n")).unwrap_or_default(),
        RaisedFlags(tally),
        ClosingTable { facts: &outcome.facts, tally },
        reports.iter().map(|report| Closing(report).to_string()).collect::<String>()
    ))?;
    match &done.interrupted {
        Some(how) => {
            let kept = arguments.out.as_ref().map(|out| format!("; what was done is in {}", out.display()));
            Err(Error::Cancelled(format!("{how}{}", kept.unwrap_or_default())))
        }
        None => Ok(()),
    }
}

/// The command line of this program in a form that a shell reads back.
fn command_line() -> String {
    let words = std::env::args_os().skip(1).map(|word| quoted(&word.to_string_lossy()));
    std::iter::once("palpate".to_string()).chain(words).collect::<Vec<_>>().join(" ")
}

/// A word of a command line, in quotes if a shell would read the word differently without quotes.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "_-./:,=+@%".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        return word.into();
    }
    format!("'{}'", word.replace('\'', "'\\''"))
}

/// Prints which GPU passes a step has, which are left out, and why.
fn explain(arguments: &Arguments, scene: &Scene, iterations: u32) -> Result<()> {
    let engine = Engine::open(scene, &arguments.device_options())?;
    engine.simulation().notes().iter().for_each(|note| tell(note));
    let explanation = engine.simulation().explain(iterations);
    if let Some(folder) = &arguments.out {
        let mut output = Output::create(folder)?;
        output.write(EXPLANATION, |w| serde_json::to_writer_pretty(w, &explanation).map_err(Into::into))?;
        output.commit()?;
    }
    print(&explanation.to_string())
}

/// Length of a run.
enum Extent {
    /// Number of steps, each as long as the scene's `dt`.
    Steps(u64),
    /// Duration in real time, s, with the tool held by a haptic device.
    Seconds(f64),
}

/// Results of a run, at its end.
struct Done {
    tally: Tally,
    outcome: Outcome,
    /// The report on each haptic device of a session; empty without a device.
    reports: Vec<Report>,
    /// For each device the force played (commanded to it).
    played: Vec<Played>,
    /// The body that is nearest to the tool at the end.
    nearest: Option<Distance>,
    /// How a signal cut the run short, in words.
    interrupted: Option<String>,
    /// Pictures of the state at the end, or the reason why there are none.
    pictures: std::result::Result<Vec<Shot>, String>,
}

/// Does all steps, or as many as there are before a signal sets `stop`, and writes a row of the trace for each.
fn simulate(
    mut engine: Engine,
    stop: &Stop,
    scene: &Scene,
    extent: &Extent,
    arguments: &Arguments,
    mut output: Option<&mut Output>,
    mut series: Option<&mut Export>,
) -> Result<Done> {
    let names = Names::of(engine.simulation());
    let file = output.as_ref().map(|output| output.path(TRACE)).unwrap_or_default();
    let failed = |source| Error::Output { file: file.clone(), source };
    let mut trace = match &mut output {
        Some(output) => Some(Trace::new(output.file(TRACE)?, &names).map_err(failed)?),
        None => None,
    };
    let bar = progress(extent);
    let mut tally = Tally::new(names.further_tools.iter().cloned());
    let mut watch = |row: &StepReport, simulation: &mut Simulation| {
        if let Some(trace) = &mut trace {
            trace.write(row).map_err(failed)?;
        }
        tally.add(row);
        if let Some(series) = &mut series {
            series.after(tally.steps, simulation)?;
        }
        match extent {
            Extent::Steps(_) => bar.inc(1),
            Extent::Seconds(_) => bar.set_position(bar.elapsed().as_millis() as u64),
        }
        Ok(())
    };
    let mut played = Vec::new();
    let reports = match extent {
        Extent::Steps(steps) => {
            let mut snapshots = Snapshots::new(arguments, &mut engine)?;
            let mut step = |k| {
                let row = engine.step()?;
                watch(&row, engine.simulation_mut())?;
                snapshots.after(k, &mut engine, output.as_deref_mut())
            };
            (1..=*steps).take_while(|_| !stop.is_set()).try_for_each(&mut step).map(|()| Vec::new())
        }
        Extent::Seconds(seconds) => {
            hold::hold(&mut engine, scene, *seconds, arguments.record.as_deref(), &mut watch, &mut played)
        }
    }?;
    bar.finish_and_clear();
    let steps = tally.steps;
    if let Some(series) = series {
        series.last(steps, engine.simulation_mut())?;
    }
    let interrupted = match extent {
        Extent::Steps(all) if steps < *all => Some(format!("interrupted after {steps} of {all} steps")),
        _ => None,
    };
    if steps > 0 && tally.count(Flags::NON_FINITE) == steps {
        let problem = format!("none of the {steps} steps had a finite solution, and nothing moved");
        let remedy = "give less extreme sizes, masses, stiffnesses and time step";
        return Err(Error::Simulation(format!("{}: {problem}; {remedy}", scene.file.display())));
    }
    if let Some(trace) = trace {
        trace.finish().map_err(failed)?;
    }
    let outcome = engine.results()?;
    let has_touched = tally.touch.as_ref().is_none_or(|touch| touch.first.is_some());
    let nearest = if has_touched { None } else { engine::nearest(engine.simulation(), &outcome.skins) };
    // Pictures come last, so that rendering changes nothing that was read before.
    let pictures = match (output.is_some(), &interrupted) {
        (false, _) => Ok(Vec::new()),
        (true, None) => ending::pictures(&mut engine, &tally),
        (true, Some(_)) => Err("No picture was rendered, since the run was interrupted.".into()),
    };
    Ok(Done { tally, outcome, reports, played, nearest, interrupted, pictures })
}

/// Images that are written at regular intervals: the number of steps from one image to the next, and the studio
/// (renderer without a window) that makes the images.
#[cfg(feature = "view")]
struct Snapshots(Option<(u64, palpate_view::Studio)>);

#[cfg(feature = "view")]
impl Snapshots {
    fn new(arguments: &Arguments, engine: &mut Engine) -> Result<Snapshots> {
        let Some(every) = arguments.snapshot else { return Ok(Snapshots(None)) };
        Ok(Snapshots(Some((every, arguments.look.studio(engine.simulation_mut())?))))
    }

    fn after(&mut self, step: u64, engine: &mut Engine, output: Option<&mut Output>) -> Result<()> {
        let (Some((every, studio)), Some(output)) = (&mut self.0, output) else { return Ok(()) };
        if !step.is_multiple_of(*every) {
            return Ok(());
        }
        if step == *every {
            output.replaces(is_snapshot);
        }
        let picture = studio.picture(engine.simulation_mut())?;
        output.write(&format!("snapshot-{step:06}.png"), |w| picture.write_png(w))
    }
}

/// Whether a file's name is that of an image of a run.
#[cfg(feature = "view")]
fn is_snapshot(name: &str) -> bool {
    let number = name.strip_prefix("snapshot-").and_then(|rest| rest.strip_suffix(".png"));
    number.is_some_and(|number| number.len() >= 6 && number.bytes().all(|byte| byte.is_ascii_digit()))
}

/// Takes no images: this program was built without rendering.
#[cfg(not(feature = "view"))]
struct Snapshots;

#[cfg(not(feature = "view"))]
impl Snapshots {
    fn new(_: &Arguments, _: &mut Engine) -> Result<Snapshots> {
        Ok(Snapshots)
    }

    fn after(&mut self, _: u64, _: &mut Engine, _: Option<&mut Output>) -> Result<()> {
        Ok(())
    }
}

/// A progress bar on standard error, drawn only where standard error is a terminal.
fn progress(extent: &Extent) -> ProgressBar {
    let (length, template) = match extent {
        Extent::Steps(steps) => (*steps, "{wide_bar} {pos}/{len} steps, {eta} left"),
        Extent::Seconds(seconds) => ((1e3 * seconds) as u64, "{wide_bar} {elapsed} of the session, {eta} left"),
    };
    let bar = ProgressBar::new(length).with_finish(ProgressFinish::AndClear);
    match ProgressStyle::with_template(template) {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

/// Writes the files that describe the end of the run: layers (tetrahedral meshes of the bodies), skins (their surface
/// meshes) and the summary.
fn write_end(output: &mut Output, scene: &Scene, done: &Done) -> Result<()> {
    let Done { tally, outcome, reports, .. } = done;
    for layer in &outcome.layers {
        let name = format!("{}.vtk", layer.name);
        output.write(&name, |w| vtk::write_layer(w, &layer.nodes, &layer.tetrahedra, &layer.displacement))?;
    }
    for skin in &outcome.skins {
        output.write(&format!("{}.obj", skin.name), |w| obj::write(w, &skin.vertices, &skin.triangles))?;
    }
    let haptics = reports.first().map(report::haptics::summary);
    let of_tool = |of: &Report| (of.tool.clone(), report::haptics::summary(of));
    let further_haptics = reports.iter().skip(1).map(of_tool).collect();
    let preset = scene.preset.clone();
    let interrupted = done.interrupted.clone();
    let summary = Summary {
        haptics,
        further_haptics,
        preset,
        interrupted,
        ..Summary::new(&scene.name(), scene.step.dt, &outcome.facts, tally)
    };
    output.write(SUMMARY, |w| serde_json::to_writer_pretty(w, &summary).map_err(Into::into))?;
    // The run's results are kept even if no page can be made of them.
    match page(output, scene, done) {
        Ok(html) => output.write(PAGE, |w| w.write_all(html.as_bytes())),
        Err(error) => {
            tell(&format!("no {PAGE} was written: {error}"));
            Ok(())
        }
    }
}

/// Makes the page of a run; `trace.csv`, from which the page's curves are made, is already written.
fn page(output: &Output, scene: &Scene, done: &Done) -> Result<String> {
    let Done { tally, outcome, reports, played, nearest, interrupted, pictures } = done;
    let trace = || Ok::<_, Error>(BufReader::new(output.read(TRACE)?));
    let unreadable = |error| output.unreadable(TRACE, &error);
    let force = |(name, _): &(String, _)| curves::read_force(trace()?, name).map_err(unreadable);
    let page = Page {
        scene,
        facts: &outcome.facts,
        tally,
        curves: &curves::read(trace()?, tally.touch.as_ref()).map_err(unreadable)?,
        further_forces: &tally.further_touches.iter().map(force).collect::<Result<Vec<_>>>()?,
        sessions: &reports
            .iter()
            .zip(played)
            .map(|(report, played)| Session { report, played: &played.force })
            .collect::<Vec<_>>(),
        interrupted: interrupted.as_deref(),
        nearest: nearest.as_ref(),
        pictures: pictures.as_ref().map(Vec::as_slice).map_err(String::as_str),
        command: &command_line(),
    };
    page.html()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_of_a_command_line_are_quoted_for_a_shell() {
        let words = ["run", "a/b.toml", "", "two words", "it's", "<x>", "--size=1x2"];
        let expected = ["run", "a/b.toml", "''", "'two words'", "'it'\\''s'", "'<x>'", "--size=1x2"];
        assert_eq!(words.map(quoted), expected);
    }
}
