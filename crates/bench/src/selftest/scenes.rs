//! The shipped scenes, and the forces that they gave when they were pinned.

use std::fs;
use std::sync::Arc;

use palpate::{Context, Error, Flags, Result, Scene, Simulation, StepReport};
use serde::{Deserialize, Serialize};

use super::greatest;

/// Name and text of each shipped scene, and the number of steps after which it has contact.
const SCENES: [(&str, &str, u64); 9] = [
    ("touch-head", include_str!("../../../../assets/scenes/touch-head.toml"), 60),
    ("touch-human", include_str!("../../../../assets/scenes/touch-human.toml"), 60),
    ("two-heads", include_str!("../../../../assets/scenes/two-heads.toml"), 60),
    ("gears", include_str!("../../../../assets/scenes/gears.toml"), 60),
    ("pumpkins", include_str!("../../../../assets/scenes/pumpkins.toml"), 60),
    ("press-gear", include_str!("../../../../assets/scenes/press-gear.toml"), 60),
    ("press-pumpkin", include_str!("../../../../assets/scenes/press-pumpkin.toml"), 60),
    ("held-pad", include_str!("../../../../assets/scenes/held-pad.toml"), 260),
    ("pose-human", include_str!("../../../../assets/scenes/pose-human.toml"), 60),
];
const SKELETON: &str = include_str!("../../../../assets/human-skeleton.toml");
/// Number of steps at the end of a scene of which values are pinned, and of how many steps one is pinned.
const LAST: u64 = 20;
const EVERY: u64 = 5;
/// The solver's tolerance: small, so that results depend little on when a driver's rounding lets it stop.
const TOLERANCE: f64 = 1e-6;

/// What a scene gave when it was pinned.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Pinned {
    /// Name of the scene.
    pub scene: String,
    /// For some steps: the force on the tool, N, or without a tool the displacements of the probes, m; three numbers
    /// each.
    pub values: Vec<Vec<f64>>,
}

/// How well a scene agrees with what is pinned.
#[derive(Debug, Clone, Serialize)]
pub struct Agreement {
    /// Name of the scene.
    pub scene: String,
    /// The greatest value that is pinned: a force, N, or without a tool a displacement, m.
    pub greatest: f64,
    /// Whether the values are forces.
    pub is_force: bool,
    /// Greatest difference of a value from the pinned one, as a fraction of the greatest; not a number if a value is
    /// not.
    pub difference: f64,
    /// Names of the flags that the steps raised.
    pub flags: Vec<String>,
    /// Mean number of iterations of a step.
    pub iterations: f64,
    /// Median wall time of a step, ms.
    pub step_ms: f64,
}

/// All that is pinned.
pub fn pinned() -> Vec<Pinned> {
    serde_json::from_str(include_str!("pinned.json")).expect("pinned.json is read by a test")
}

/// What the shipped scenes give on a device, to be pinned.
pub fn record(context: &Arc<Context>) -> Result<Vec<Pinned>> {
    SCENES.iter().map(|(name, ..)| Ok(ran(context, name)?.0)).collect()
}

/// Runs a scene and compares it with what is pinned.
pub fn agreement(context: &Arc<Context>, pinned: &Pinned) -> Result<Agreement> {
    let (found, rows) = ran(context, &pinned.scene)?;
    let length = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>().sqrt();
    let greatest_value = greatest(pinned.values.iter().map(|x| length(x)));
    let apart = |(a, b): (&Vec<f64>, &Vec<f64>)| length(&a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<f64>>());
    let difference = greatest(found.values.iter().zip(&pinned.values).map(apart)) / greatest_value;
    let flags = rows.iter().fold(Flags::default(), |all, row| all | row.flags);
    let times: Vec<f64> = rows.iter().map(|row| 1e-3 * row.step_us).collect();
    Ok(Agreement {
        scene: pinned.scene.clone(),
        greatest: greatest_value,
        is_force: rows.iter().any(|row| row.tool.is_some()),
        difference,
        flags: flags.names().map(Into::into).collect(),
        iterations: rows.iter().map(|row| f64::from(row.iterations)).sum::<f64>() / rows.len() as f64,
        step_ms: crate::median(&times),
    })
}

fn ran(context: &Arc<Context>, name: &str) -> Result<(Pinned, Vec<StepReport>)> {
    let (scene, steps) = scene(name)?;
    let mut simulation = Simulation::on_device(context, &scene)?;
    let rows: Vec<StepReport> = (0..steps).map(|_| simulation.step()).collect::<Result<_>>()?;
    let start: Vec<f64> = rows[0].probes.iter().flat_map(|x| x.to_array()).collect();
    let value = |row: &StepReport| match &row.tool {
        Some(tool) => tool.force.to_array().to_vec(),
        None => row.probes.iter().flat_map(|x| x.to_array()).zip(&start).map(|(x, start)| x - start).collect(),
    };
    let pinned = rows.iter().filter(|row| row.step + LAST >= steps && row.step % EVERY == 0);
    Ok((Pinned { scene: name.into(), values: pinned.map(value).collect() }, rows))
}

/// A shipped scene with a tight tolerance, and its number of steps.
fn scene(name: &str) -> Result<(Scene, u64)> {
    let folder = tempfile::tempdir().map_err(|source| Error::Output { file: "a temporary folder".into(), source })?;
    // Scenes name the skeleton by its place beside their folder.
    let (scenes, skeleton) = (folder.path().join("scenes"), folder.path().join("human-skeleton.toml"));
    fs::create_dir(&scenes).map_err(|source| Error::Output { file: scenes.clone(), source })?;
    fs::write(&skeleton, SKELETON).map_err(|source| Error::Output { file: skeleton, source })?;
    let known = SCENES.iter().find(|(known, ..)| *known == name);
    let Some((_, text, steps)) = known else { return Err(Error::Usage(format!("{name} is no shipped scene"))) };
    let mut scene = Scene::parse(&scenes.join(format!("{name}.toml")), text)?;
    scene.solver.tolerance = Some(TOLERANCE);
    Ok((scene, *steps))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_shipped_scene_is_pinned() {
        let names: Vec<String> = pinned().into_iter().map(|pinned| pinned.scene).collect();
        assert_eq!(names, SCENES.map(|(name, ..)| name));
        let values = (LAST / EVERY + 1) as usize;
        for pinned in pinned() {
            assert!(pinned.values.len() == values && pinned.values.iter().flatten().any(|x| *x != 0.0));
            scene(&pinned.scene).unwrap();
        }
    }
}
