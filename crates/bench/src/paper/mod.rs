//! `palpate bench paper`: the times that palpate takes for the scenes of the paper (Galoppo and others 2007), compared
//! with the times that the paper reports, and how the time of a step grows with the contact area, with the sizes of the
//! meshes and with the number of bodies.

mod document;
mod growth;
mod scenes;
mod watched;

use std::path::PathBuf;

use serde::Serialize;
use serde_json::{Map, Value};

pub use growth::{By, Grown};
pub use scenes::{Ran, SCENES, Told};
pub use watched::Times;

use palpate::Result;

use super::suite::{from_value, part, to_value};
use super::{Benchmark, Section};

/// How much is measured.
#[derive(Debug, Clone, Serialize)]
pub struct Settings {
    /// Folder of the files of the paper's scenes.
    pub scenes: PathBuf,
    /// Greatest number of steps that each of the paper's scenes does after its first contact.
    pub steps: usize,
    /// Longest wall time for which each of the paper's scenes is run, s.
    pub scene_seconds: f64,
    /// Radii of the sphere that is pressed into a head, where the contact area is varied, m.
    pub radii: Vec<f64>,
    /// Numbers of vertices of the head's skin (its surface mesh), where the skin is varied.
    pub vertices: Vec<f64>,
    /// Cell sizes of the head's layer (its tetrahedral mesh), where the layer is varied, m.
    pub cells: Vec<f64>,
    /// Numbers of soft blocks on the ground, where the number of bodies is varied.
    pub bodies: Vec<f64>,
    /// Number of turns that each scene has where growth is measured; in each turn four steps of the scene are measured.
    pub growth_steps: usize,
    /// GPU device, by name or index; `None`: the best one.
    pub device: Option<String>,
}

impl Settings {
    /// The whole benchmark, which takes some minutes.
    pub fn full() -> Settings {
        Settings {
            scenes: PathBuf::from("assets/scenes"),
            steps: 200,
            scene_seconds: 60.0,
            radii: vec![0.0025, 0.005, 0.01, 0.02, 0.04, 0.08],
            vertices: vec![11e3, 22e3, 44e3, 88e3, 176e3, 352e3],
            cells: vec![0.03, 0.024, 0.018, 0.014, 0.011, 0.009],
            bodies: vec![1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0],
            growth_steps: 20,
            device: None,
        }
    }

    /// A short form with few samples, for a first look; not for figures to quote.
    pub fn quick() -> Settings {
        Settings {
            steps: 16,
            scene_seconds: 3.0,
            vertices: vec![5.5e3, 11e3, 22e3, 44e3, 88e3, 176e3],
            cells: vec![0.036, 0.03, 0.024, 0.02, 0.018, 0.016],
            bodies: vec![1.0, 2.0, 4.0, 8.0, 16.0, 32.0],
            growth_steps: 4,
            ..Settings::full()
        }
    }

    fn values(&self, by: By) -> &[f64] {
        match by {
            By::Area => &self.radii,
            By::Skin => &self.vertices,
            By::Layer => &self.cells,
            By::Bodies => &self.bodies,
        }
    }
}

/// Results of the benchmark; the results of parts that were not measured are missing or empty.
#[derive(Debug, Clone, Default)]
pub struct Results {
    /// Results of the paper's scenes.
    pub scenes: Vec<Ran>,
    /// For each quantity that is varied (contact area, skin, layer, number of bodies), the results of its scenes.
    pub growth: Vec<(By, Vec<Grown>)>,
}

impl Results {
    /// Reads the results of the parts that were measured. Errors: a part does not have the form of this benchmark's
    /// results.
    pub fn of(parts: &Map<String, Value>) -> Result<Results> {
        let scenes = SCENES.iter().filter_map(|told| parts.get(told.name)).map(from_value);
        let growth = By::ALL.into_iter().map(|by| Ok((by, part(parts, by.name())?)));
        Ok(Results { scenes: scenes.collect::<Result<_>>()?, growth: growth.collect::<Result<_>>()? })
    }
}

/// The benchmark `paper`. It has a part for each scene of the paper, and one for each quantity that is varied to
/// measure how times grow.
pub struct Paper(pub Settings);

impl Benchmark for Paper {
    fn name(&self) -> &'static str {
        "paper"
    }

    fn title(&self) -> &'static str {
        "The paper's scenes"
    }

    fn settings(&self) -> Result<Value> {
        to_value(&self.0)
    }

    fn parts(&self) -> Vec<String> {
        SCENES.iter().map(|told| told.name).chain(By::ALL.map(By::name)).map(Into::into).collect()
    }

    fn measure(&self, part: &str, watch: &mut dyn FnMut(&str)) -> Result<Value> {
        match By::ALL.into_iter().find(|by| by.name() == part) {
            Some(by) => to_value(&growth::measure(by, &self.0, watch)?),
            None => to_value(&scenes::run(part, &self.0)?),
        }
    }

    fn preface(&self, settings: &Value) -> Result<String> {
        Ok(document::preface(settings))
    }

    fn sections(&self, parts: &Map<String, Value>) -> Result<Vec<Section>> {
        document::sections(&Results::of(parts)?)
    }
}
