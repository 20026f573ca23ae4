//! The paper's scenes as they run: times of the query's stages in steps with contact.

use std::time::Instant;

use serde::Serialize;

use super::Settings;
use crate::bench::Samples;
use crate::gpu::Options;
use crate::report::Flags;
use crate::scene::Scene;
use crate::step::Simulation;
use crate::{Error, Result};

/// Name, what the paper reports (Galoppo and others 2007, GeForce 7800; ms) and what is aimed at on two cores (ms).
const SCENES: [(&str, f64, f64); 5] = [
    ("touch-head", 2.0, 1.5),
    ("two-heads", 6.0, 2.5),
    ("gears", 3.0, 2.0),
    ("pumpkins", 3.0, 2.0),
    ("touch-human", 2.0, 1.5),
];

/// A scene's times.
#[derive(Debug, Clone, Serialize)]
pub struct SceneTimes {
    /// The scene.
    pub name: &'static str,
    /// Time of the query in the paper, ms.
    pub paper_ms: f64,
    /// What is aimed at, ms.
    pub goal_ms: f64,
    /// What happened.
    pub outcome: Outcome,
}

/// What happened to a scene.
#[derive(Debug, Clone, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Its file is not there.
    Missing(String),
    /// It ran.
    Ran {
        /// Steps after that of the first contact.
        steps: usize,
        /// Steps before them, untimed.
        before: usize,
        /// Those of `steps` that had contacts, whose times are below.
        touching: usize,
        /// Median contacts of the latter, of both skins.
        contacts: f64,
        /// Most contacts of a step.
        most_contacts: u32,
        /// Names of the flags that were raised.
        flags: Vec<&'static str>,
        /// Microseconds, a step each.
        samples_us: Samples,
    },
}

/// A scene where its file is there, else where it is not.
pub type Read = std::result::Result<Scene, String>;

/// Reads all scenes; errors are of files that are there and are no scenes.
pub fn read(settings: &Settings) -> Result<Vec<Read>> {
    if !settings.scenes.is_dir() {
        return Err(Error::input(&settings.scenes, None, "is no folder", "give that of the scenes with --scenes"));
    }
    let read = |(name, ..): &(&str, f64, f64)| -> Result<Read> {
        let path = settings.scenes.join(format!("{name}.toml"));
        if path.exists() { Ok(Ok(Scene::load(&path)?)) } else { Ok(Err(path.display().to_string())) }
    };
    SCENES.iter().map(read).collect()
}

/// Runs them one after the other.
pub fn measure(scenes: Vec<Read>, settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Vec<SceneTimes>> {
    let measure = |((name, paper_ms, goal_ms), scene): ((&'static str, f64, f64), Read)| {
        watch(&format!("scenes: {name}"));
        let outcome = match scene {
            Ok(scene) => run(&scene, settings)?,
            Err(path) => Outcome::Missing(path),
        };
        Ok(SceneTimes { name, paper_ms, goal_ms, outcome })
    };
    SCENES.into_iter().zip(scenes).map(measure).collect()
}

/// Steps to the first contact untimed, since taking times takes time, and all after it timed.
fn run(scene: &Scene, settings: &Settings) -> Result<Outcome> {
    let options = Options { device: settings.device.clone(), one_thread: true, ..Options::default() };
    let mut simulation = Simulation::new(scene, &options, None)?;
    simulation.time_every(0);
    let begun = Instant::now();
    let (mut has_begun, mut before, mut steps, mut flags) = (false, 0, 0, 0);
    let (mut contacts, mut samples_us) = (Vec::new(), Samples::default());
    let last = (scene.duration() / scene.step.dt).round() as usize;
    while steps < settings.steps && before + steps < last && begun.elapsed().as_secs_f64() < settings.scene_seconds {
        let row = simulation.step()?;
        flags |= row.flags.0;
        let found = row.contacts.unwrap_or(0);
        if !has_begun {
            before += 1;
            has_begun = found > 0;
            simulation.time_every(has_begun.into());
            continue;
        }
        steps += 1;
        if let Some(times) = simulation.stage_times().filter(|_| found > 0) {
            samples_us.add(times);
            contacts.push(found);
        }
    }
    let numbers: Vec<f64> = contacts.iter().map(|&found| f64::from(found)).collect();
    Ok(Outcome::Ran {
        steps,
        before,
        touching: contacts.len(),
        contacts: crate::bench::median(&numbers),
        most_contacts: contacts.into_iter().max().unwrap_or(0),
        flags: Flags(flags).names().collect(),
        samples_us,
    })
}
