//! `palpate bench proximity`: what the proximity query costs, and what that depends on.

mod document;
pub mod graded;
mod patches;
mod peers;

use serde::Serialize;
use serde_json::{Map, Value};

pub use patches::{Area, Place, Sensitivity};
pub use peers::Peers;

use palpate::internal::prepare::{self, Body, FrameMotion, Shape, mass, skin};
use palpate::{Context, Options, Result};

use super::suite::{part, to_value};
use super::{Benchmark, Section};

/// How much is measured.
#[derive(Debug, Clone, Serialize)]
pub struct Settings {
    /// Runs of each query whose times are taken; half as many for contact areas.
    pub runs: usize,
    /// Runs of each before them.
    pub warm_up: usize,
    /// Vertices of the skins that share a patch, about.
    pub sizes: Vec<usize>,
    /// Contact areas, cm^2.
    pub areas_cm2: Vec<f64>,
    /// Vertices of both skins of the area's series, about.
    pub area_vertices: usize,
    /// Vertices of the pumpkin, and of the head, that peers are compared on.
    pub peer_vertices: [usize; 2],
    /// Vertices of the pumpkin that are within the head, about.
    pub peer_colliding: usize,
    /// Whether this is a short form of the whole.
    pub is_quick: bool,
    /// Device, by name or index; `None`: the best.
    pub device: Option<String>,
}

impl Settings {
    /// All of it: some minutes.
    pub fn full() -> Settings {
        Settings {
            runs: 200,
            warm_up: 10,
            sizes: vec![11_000, 44_000, 176_000, 704_000],
            areas_cm2: vec![0.0, 1.0, 2.0, 4.0, 6.0, 9.0, 12.0, 16.0, 20.0],
            area_vertices: 44_000,
            peer_vertices: [30_000, 41_000],
            peer_colliding: 320,
            is_quick: false,
            device: None,
        }
    }

    /// Every question with few samples: for a first look, not for figures.
    pub fn quick() -> Settings {
        Settings {
            runs: 20,
            warm_up: 2,
            sizes: vec![11_000, 44_000, 176_000],
            areas_cm2: vec![0.0, 1.0, 4.0, 9.0, 20.0],
            is_quick: true,
            ..Settings::full()
        }
    }
}

/// What was found; nothing of a part that was not measured.
#[derive(Debug, Clone, Default)]
pub struct Results {
    /// One patch on skins of several sizes.
    pub sensitivity: Vec<Sensitivity>,
    /// Two skins pressed together ever deeper.
    pub area: Vec<Area>,
    /// The same work by others.
    pub peers: Option<Peers>,
}

impl Results {
    /// Of the parts that were measured. Errors: they are none of this benchmark.
    pub fn of(parts: &Map<String, Value>) -> Result<Results> {
        let [sensitivity, area, peers] = PARTS;
        Ok(Results { sensitivity: part(parts, sensitivity)?, area: part(parts, area)?, peers: part(parts, peers)? })
    }
}

/// Names of the parts.
const PARTS: [&str; 3] = ["sensitivity", "area", "peers"];

/// The benchmark: a part for each question.
pub struct Proximity(pub Settings);

impl Benchmark for Proximity {
    fn name(&self) -> &'static str {
        "proximity"
    }

    fn title(&self) -> &'static str {
        "What the proximity query costs"
    }

    fn settings(&self) -> Result<Value> {
        to_value(&self.0)
    }

    fn parts(&self) -> Vec<String> {
        PARTS.map(Into::into).into()
    }

    fn measure(&self, part: &str, watch: &mut dyn FnMut(&str)) -> Result<Value> {
        let settings = &self.0;
        let context = Context::open(&Options { device: settings.device.clone(), ..Options::of_program() })?;
        match part {
            "sensitivity" => to_value(&patches::sensitivity(&context, settings, watch)?),
            "area" => to_value(&patches::area(&context, settings, watch)?),
            _ => to_value(&peers::peers(&context, settings, watch)?),
        }
    }

    fn preface(&self, settings: &Value) -> Result<String> {
        Ok(document::preface(settings))
    }

    fn sections(&self, parts: &Map<String, Value>) -> Result<Vec<Section>> {
        document::sections(&Results::of(parts)?)
    }
}

/// A fixed rigid body of a closed surface, its proxies as the engine makes them.
fn rigid(name: &str, vertices: Vec<glam::DVec3>, triangles: Vec<[u32; 3]>) -> Result<Body> {
    let mass::Properties { volume, centroid, inertia } = mass::properties(&vertices, &triangles);
    let skin = skin::build(vertices, triangles);
    let proxies = prepare::proxies(&skin).map_err(|e| palpate::Error::Simulation(format!("`{name}`: {e}")))?;
    Ok(Body {
        name: name.into(),
        shape: Shape::Rigid { skin, proxies, volume, centroid, inertia, motion: FrameMotion::Fixed },
        position: glam::DVec3::ZERO,
        orientation: glam::DQuat::IDENTITY,
        velocity: glam::DVec3::ZERO,
        report: prepare::BodyReport::default(),
    })
}

/// Vertices, triangles and proxies of a rigid body.
fn counts(body: &Body) -> (usize, usize, usize) {
    match &body.shape {
        Shape::Rigid { skin, proxies, .. } => (skin.vertices.len(), skin.triangles.len(), proxies.len()),
        _ => (0, 0, 0),
    }
}
