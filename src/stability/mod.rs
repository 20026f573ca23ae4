//! `palpate stability`: stiff and extreme cases, each with a verdict from laws.

pub mod axes;
pub mod laws;
pub mod setup;
pub mod trace;

use glam::{DQuat, DVec3};
use serde::Serialize;

use crate::gpu::{Context, Options};
use crate::step::Simulation;
use crate::{Error, Result};
use axes::{Axis, Case, Start};
use laws::{Finding, Verdict};
use trace::Observer;

/// What is run.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Settings {
    /// Fewer values and steps.
    pub is_quick: bool,
    /// A million steps of resting contact.
    pub is_soak: bool,
    /// These axes alone; empty: all.
    pub only: Vec<String>,
    /// Device, by name or index; `None`: the best.
    pub device: Option<String>,
    /// See [`Options::replaced`].
    #[serde(skip)]
    pub replaced: Vec<(String, Vec<u8>)>,
}

/// A simulation and its verdict.
#[derive(Debug, Clone, Serialize)]
pub struct Judged {
    /// Which of its cell.
    pub scenario: String,
    /// What became of it.
    pub verdict: Verdict,
    /// Steps done.
    pub steps: usize,
    /// Flags of all steps.
    pub flags: u32,
    /// Steps that raised any.
    pub flagged: usize,
    /// Laws.
    pub findings: Vec<Finding>,
    /// Why it was refused.
    pub refusal: Option<String>,
    /// Wall time, s.
    pub seconds: f64,
}

/// A value of an axis and its verdict.
#[derive(Debug, Clone, Serialize)]
pub struct CellResult {
    /// Value with its unit.
    pub label: String,
    /// Whether it must pass.
    pub is_core: bool,
    /// The worst of its cases.
    pub verdict: Verdict,
    /// Its simulations.
    pub cases: Vec<Judged>,
}

/// A row of the matrix.
#[derive(Debug, Clone, Serialize)]
pub struct AxisResult {
    /// Name.
    pub name: String,
    /// For readers.
    pub title: String,
    /// Its values.
    pub cells: Vec<CellResult>,
}

/// All of it.
#[derive(Debug, Clone, Serialize)]
pub struct Results {
    /// Version of this format.
    pub schema: u32,
    /// Of palpate.
    pub version: String,
    /// Name of the device.
    pub device: String,
    /// Its driver.
    pub driver: String,
    /// Threads of the machine.
    pub threads: usize,
    /// What was asked.
    pub settings: Settings,
    /// Rows.
    pub axes: Vec<AxisResult>,
    /// Wall time, s.
    pub seconds: f64,
}

/// Runs the matrix; `watch` is told what is under way.
pub fn run(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Results> {
    let begun = std::time::Instant::now();
    let wanted = |name: &&&str| settings.only.is_empty() || settings.only.iter().any(|o| o == **name);
    let context = Context::new(&Options { device: settings.device.clone(), ..Options::default() })?;
    let (device, driver) = (context.device_name().to_string(), context.driver().to_string());
    drop(context);
    let mut all = Vec::new();
    for name in axes::NAMES.iter().filter(wanted) {
        let Some(Axis { name, title, cells }) = axes::axis(name, settings.is_quick) else { continue };
        let mut results = Vec::new();
        for cell in cells {
            let mut cases = Vec::new();
            for case in &cell.cases {
                let judged = self::case(case, settings)?;
                let worst: Vec<String> = judged.findings.iter().filter(|f| f.broken.is_some()).map(|f| format!("{} {:.2e}>{:.2e} at {:?} flags {}", f.law.name(), f.worst, f.bound, f.broken, f.flags)).collect();
                watch(&format!("{name} {} {}: {:?} flags {} in {} of {} steps {:.2}s {}", cell.label, case.scenario, judged.verdict, judged.flags, judged.flagged, judged.steps, judged.seconds, worst.join("; ")));
                cases.push(judged);
            }
            let verdict = cases.iter().map(|c| c.verdict).max().unwrap_or(Verdict::Pass);
            results.push(CellResult { label: cell.label, is_core: cell.is_core, verdict, cases });
        }
        all.push(AxisResult { name: name.into(), title: title.into(), cells: results });
    }
    Ok(Results {
        schema: crate::bench::SCHEMA,
        version: env!("CARGO_PKG_VERSION").into(),
        device,
        driver,
        threads: std::thread::available_parallelism().map_or(1, Into::into),
        settings: settings.clone(),
        axes: all,
        seconds: begun.elapsed().as_secs_f64(),
    })
}

fn case(case: &Case, settings: &Settings) -> Result<Judged> {
    let begun = std::time::Instant::now();
    let scene = case.setup.scene(case.scenario);
    let options = Options {
        device: settings.device.clone(),
        one_thread: true,
        replaced: settings.replaced.clone(),
        ..Options::default()
    };
    let mut judged = Judged {
        scenario: case.scenario.into(),
        verdict: Verdict::Pass,
        steps: 0,
        flags: 0,
        flagged: 0,
        findings: Vec::new(),
        refusal: None,
        seconds: 0.0,
    };
    let mut simulation = match Simulation::new(&scene, &options, None) {
        Ok(simulation) => simulation,
        Err(error @ (Error::Key { .. } | Error::Input { .. })) => {
            (judged.verdict, judged.refusal) = (Verdict::Refused, Some(error.to_string()));
            return Ok(judged);
        }
        Err(error) => return Err(error),
    };
    simulation.time_every(0);
    begin(&mut simulation, case)?;
    let mut observer = Observer::new(&simulation, &scene, case.setup.edge)?;
    let mut samples = vec![observer.at_start(&simulation)];
    for _ in 0..case.steps {
        let sample = observer.step(&mut simulation)?;
        samples.push(sample);
        if !sample.is_finite {
            break;
        }
    }
    judged.findings = laws::judge(&samples, &case.promise);
    judged.verdict = laws::verdict(&samples, &judged.findings);
    judged.steps = samples.len() - 1;
    judged.flags = samples.iter().fold(0, |all, s| all | s.flags.0);
    judged.flagged = samples.iter().filter(|s| s.flags.0 != 0).count();
    judged.seconds = begun.elapsed().as_secs_f64();
    Ok(judged)
}

/// Puts the nodes where the case begins.
fn begin(simulation: &mut Simulation, case: &Case) -> Result<()> {
    let crate::prepare::Shape::Soft { layer, .. } = &simulation.bodies()[0].shape else { return Ok(()) };
    let rest = layer.nodes.clone();
    let middle = DVec3::splat(0.5 * case.setup.edge);
    let (displacements, velocities): (Vec<DVec3>, Vec<DVec3>) = match case.start {
        Start::Rest => return Ok(()),
        Start::Stretched(factor) => {
            rest.iter().map(|x| (DVec3::Y * (factor - 1.0) * x.y, DVec3::ZERO)).unzip()
        }
        Start::Spinning(speed) => {
            let spin = speed * DVec3::new(2.0, 3.0, 6.0) / 7.0;
            rest.iter().map(|x| (DVec3::ZERO, spin.cross(*x - middle))).unzip()
        }
    };
    let _ = DQuat::IDENTITY;
    simulation.place_nodes(0, &displacements, &velocities)
}
