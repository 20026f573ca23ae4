//! Runs the scenes of the paper and measures the steps with contact: the time of the query (the stages that find
//! contacts), of every stage, and of the whole step.

use std::time::Instant;

use palpate::{Error, Flags, Result, Scene};
use serde::{Deserialize, Serialize};

use super::Settings;
use super::watched::{Times, Watched};

/// A scene of the paper, the time that the paper reports for it (Galoppo and others 2007, a GeForce 7800 and a Pentium
/// of 3.4 GHz), and the time that palpate aims at on two CPU cores.
#[derive(Debug, Clone, Copy)]
pub struct Told {
    /// Name of the scene's file, without its extension.
    pub name: &'static str,
    /// The bodies that touch, in words.
    pub what: &'static str,
    /// Time that the paper reports for the query, ms: an upper bound or an approximate figure.
    pub paper_ms: f64,
    /// Time that palpate aims at for the query, ms.
    pub goal_ms: f64,
}

const fn told(name: &'static str, what: &'static str, paper_ms: f64, goal_ms: f64) -> Told {
    Told { name, what, paper_ms, goal_ms }
}

/// The five scenes of the paper.
pub const SCENES: [Told; 5] = [
    told("touch-head", "sphere on a head, 44,000 skin vertices", 2.0, 1.5),
    told("two-heads", "two heads, 44,000 each", 6.0, 2.5),
    told("gears", "two gears, 29,000 each", 3.0, 2.0),
    told("pumpkins", "two pumpkins, 30,000 each", 3.0, 2.0),
    told("touch-human", "sphere on a human, 10,382 tetrahedra", 2.0, 1.5),
];

/// Results of a scene.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Ran {
    /// Name of the scene.
    pub name: String,
    /// Number of tetrahedra of all soft bodies.
    pub tetrahedra: usize,
    /// Number of vertices of the skins (surface meshes) of all bodies except the tool, the rigid body that the haptic
    /// device leads.
    pub vertices: usize,
    /// Number of steps after the step of the first contact.
    pub steps: usize,
    /// Number of steps up to and including the step of the first contact; these steps are not timed.
    pub before: usize,
    /// Times and contacts of the steps with contact.
    #[serde(flatten)]
    pub times: Times,
    /// Names of the flags (warnings of a step) that any step raised.
    pub flags: Vec<String>,
}

/// Runs a scene. Steps up to the first contact have no GPU timestamps, since timestamps take time; of the later steps
/// every second one has timestamps.
pub fn run(name: &str, settings: &Settings) -> Result<Ran> {
    let file = settings.scenes.join(format!("{name}.toml"));
    if !file.exists() {
        let remedy = "name the folder of the paper's scenes with --scenes, or benchmarks other than `paper`";
        return Err(Error::input(&file, None, "is not there", remedy));
    }
    let scene = Scene::load(&file)?;
    let mut watched = Watched::open(&scene, settings)?;
    let mut ran = Ran { name: name.into(), ..Ran::default() };
    (ran.tetrahedra, ran.vertices) = watched.sizes();
    let mut flags = Flags::default();
    let begun = Instant::now();
    let mut has_begun = false;
    let last = (scene.duration() / scene.step.dt).round() as usize;
    while ran.steps < settings.steps
        && ran.before + ran.steps < last
        && begun.elapsed().as_secs_f64() < settings.scene_seconds
    {
        let row = watched.step(has_begun.then_some(&mut ran.times))?;
        flags |= row.flags;
        if has_begun {
            ran.steps += 1;
        } else {
            ran.before += 1;
            has_begun = row.contacts.unwrap_or(0) > 0;
        }
    }
    ran.flags = flags.names().map(Into::into).collect();
    Ok(ran)
}
