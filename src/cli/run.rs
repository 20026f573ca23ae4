//! `palpate run`: a scene from the first step to the last, a trace of it, and its state at the end.

use std::io::Write;
use std::path::PathBuf;

use clap::builder::{NonEmptyStringValueParser, PossibleValuesParser};
use indicatif::{ProgressBar, ProgressFinish, ProgressStyle};
use palpate::Result;
use palpate::report::summary::ClosingTable;
use palpate::report::{Output, Summary, Tally, Trace};
use palpate::scene::{DepthPath, Scene, obj, vtk};

use crate::engine::{Engine, Outcome};
use crate::print;

const TRACE: &str = "trace.csv";
const SUMMARY: &str = "summary.json";
/// A day at one kilohertz, and some; the times of all steps are kept for the closing table.
const MOST_STEPS: u64 = 100_000_000;

/// Options of `palpate run`.
#[derive(clap::Args)]
pub struct Arguments {
    /// The scene, a TOML file
    scene: PathBuf,
    /// Steps to do [default: to the device's last key, else one second]
    #[arg(long, value_name = "N", conflicts_with = "seconds", value_parser = steps, allow_negative_numbers = true)]
    steps: Option<u64>,
    /// Time to simulate, s
    #[arg(long, value_name = "S", value_parser = positive, allow_negative_numbers = true)]
    seconds: Option<f64>,
    /// Vulkan device, by name or by index in `palpate devices`
    #[arg(long, value_name = "NAME-OR-INDEX", value_parser = NonEmptyStringValueParser::new())]
    device: Option<String>,
    /// Path of the depth stage, whatever the scene says [default: the faster one, measured once a device]
    #[arg(long, value_name = "PATH", value_parser = PossibleValuesParser::new(DepthPath::CHOICES.map(|(name, _)| name)))]
    depth: Option<String>,
    /// Directory to write results into; without it nothing is written
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

fn positive(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number > 0.0 && number.is_finite() => Ok(number),
        _ => Err("give a number greater than zero".into()),
    }
}

fn steps(text: &str) -> std::result::Result<u64, String> {
    let steps = text.parse().ok().filter(|steps| (1..=MOST_STEPS).contains(steps));
    steps.ok_or_else(|| format!("give a whole number from 1 to {MOST_STEPS}"))
}

/// How many steps to do; refuses more than anyone waits for.
fn steps_of(arguments: &Arguments, scene: &Scene) -> Result<u64> {
    let seconds = arguments.seconds.unwrap_or(scene.duration());
    let steps = arguments.steps.unwrap_or_else(|| (seconds / scene.step.dt).round().max(1.0) as u64);
    if steps <= MOST_STEPS {
        return Ok(steps);
    }
    let problem = format!("{seconds:?} s are more than {MOST_STEPS} steps of {:?} s", scene.step.dt);
    Err(palpate::Error::key(&scene.file, "step.dt", problem, "give a longer step, or fewer by --steps or --seconds"))
}

/// Runs a scene. Input is read and prepared before the device is opened, and output is made after.
pub fn run(arguments: &Arguments) -> Result<()> {
    let mut scene = Scene::load(&arguments.scene)?;
    if let Some(name) = &arguments.depth {
        scene.contact.depth = DepthPath::CHOICES.iter().find(|(known, _)| known == name).and_then(|(_, path)| *path);
    }
    let steps = steps_of(arguments, &scene)?;
    let engine = Engine::open(&scene, arguments.device.as_deref())?;
    // A closed stderr does not stop a run; the summary carries the notes too.
    engine.notes().for_each(|note| drop(writeln!(std::io::stderr(), "note: {note}")));
    let mut output = arguments.out.as_deref().map(Output::create).transpose()?;
    let (tally, outcome) = simulate(engine, &scene, steps, output.as_mut())?;
    if let Some(mut output) = output {
        write_end(&mut output, &scene, &tally, &outcome)?;
        output.commit()?;
    }
    print(&ClosingTable { facts: &outcome.facts, tally: &tally }.to_string())
}

/// All steps, each with its row in the trace.
fn simulate(
    mut engine: Engine,
    scene: &Scene,
    steps: u64,
    mut output: Option<&mut Output>,
) -> Result<(Tally, Outcome)> {
    let probes: Vec<String> = scene.probes.iter().map(|probe| probe.name.clone()).collect();
    let file = output.as_ref().map(|output| output.path(TRACE)).unwrap_or_default();
    let failed = |source| palpate::Error::Output { file: file.clone(), source };
    let mut trace = match &mut output {
        Some(output) => Some(Trace::new(output.file(TRACE)?, &probes).map_err(failed)?),
        None => None,
    };
    let bar = progress(steps);
    let mut tally = Tally::default();
    for _ in 0..steps {
        let row = engine.step()?;
        if let Some(trace) = &mut trace {
            trace.write(&row).map_err(failed)?;
        }
        tally.add(&row);
        bar.inc(1);
    }
    bar.finish_and_clear();
    if tally.raised().any(|(name, count)| name == "non_finite" && count == steps) {
        let problem = format!("none of the {steps} steps had a finite solution, and nothing moved");
        let remedy = "bring the scene's numbers (sizes, masses, stiffnesses, the time step) closer to one another";
        return Err(palpate::Error::Simulation(format!("{}: {problem}; {remedy}", scene.file.display())));
    }
    if let Some(trace) = trace {
        trace.finish().map_err(failed)?;
    }
    Ok((tally, engine.finish()?))
}

/// A bar on standard error, drawn only where that is a terminal.
fn progress(steps: u64) -> ProgressBar {
    let bar = ProgressBar::new(steps).with_finish(ProgressFinish::AndClear);
    match ProgressStyle::with_template("{wide_bar} {pos}/{len} steps, {eta} left") {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

/// The files that are written once, at the end.
fn write_end(output: &mut Output, scene: &Scene, tally: &Tally, outcome: &Outcome) -> Result<()> {
    for layer in &outcome.layers {
        let name = format!("{}.vtk", layer.name);
        output.write(&name, |w| vtk::write_layer(w, &layer.nodes, &layer.tetrahedra, &layer.displacement))?;
    }
    for skin in &outcome.skins {
        output.write(&format!("{}.obj", skin.name), |w| obj::write(w, &skin.vertices, &skin.triangles))?;
    }
    let summary = Summary::new(&scene.name(), scene.step.dt, &outcome.facts, tally);
    output.write(SUMMARY, |w| serde_json::to_writer_pretty(w, &summary).map_err(Into::into))
}
