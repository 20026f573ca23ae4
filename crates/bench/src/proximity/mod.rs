//! `palpate bench proximity`: the cost of the proximity query (the stages of a step that find contacts: broad phase,
//! narrow phase, contacts) by itself, and how this cost depends on the meshes and on the contact area. A contact patch
//! is an area with one normal where two bodies may touch. The benchmark has three parts: `sensitivity` (one contact
//! patch on meshes of several sizes), `area` (several contact areas), and `peers` (comparison with other software, in
//! which a pumpkin is pressed into a head).

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
    /// Number of runs of each query that are timed stage by stage; as many runs are timed as a whole. Where the contact
    /// area is varied, both numbers are halved.
    pub runs: usize,
    /// Number of runs of each query that are not counted, before the counted ones.
    pub warm_up: usize,
    /// Approximate numbers of vertices of the skins (surface meshes) that have the same contact patch, for the part
    /// `sensitivity`.
    pub sizes: Vec<usize>,
    /// Contact areas of the part `area`, cm^2.
    pub areas_cm2: Vec<f64>,
    /// Approximate number of vertices of each skin in the part `area`.
    pub area_vertices: usize,
    /// Numbers of vertices of the pumpkin and the head in the part `peers`.
    pub peer_vertices: [usize; 2],
    /// Approximate number of the pumpkin's vertices that are within the head in the part `peers`.
    pub peer_colliding: usize,
    /// Whether this is the short form of the benchmark (`--quick`).
    pub is_quick: bool,
    /// GPU device, by name or index; `None`: the best one.
    pub device: Option<String>,
}

impl Settings {
    /// The whole benchmark, which takes some minutes.
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

    /// A short form with few samples, for a first look; not for figures to quote.
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

/// Results of the benchmark; the results of parts that were not measured are empty.
#[derive(Debug, Clone, Default)]
pub struct Results {
    /// Results of queries of the same contact patch on skins of several sizes.
    pub sensitivity: Vec<Sensitivity>,
    /// Results of queries of two skins that are pressed together ever deeper.
    pub area: Vec<Area>,
    /// Comparison of palpate's query with other software in one pose of two bodies; `None`: not measured.
    pub peers: Option<Peers>,
}

impl Results {
    /// Reads the results of the parts that were measured. Errors: a part does not have the form of this benchmark's
    /// results.
    pub fn of(parts: &Map<String, Value>) -> Result<Results> {
        let [sensitivity, area, peers] = PARTS;
        Ok(Results { sensitivity: part(parts, sensitivity)?, area: part(parts, area)?, peers: part(parts, peers)? })
    }
}

/// Names of the benchmark's parts.
const PARTS: [&str; 3] = ["sensitivity", "area", "peers"];

/// The benchmark `proximity`; each of its parts measures one field of [`Results`].
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

/// A fixed rigid body that has this closed surface as its skin, with the collision proxies (convex hulls) that the
/// engine makes for it.
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
        loads: Vec::new(),
        report: prepare::BodyReport::default(),
    })
}

/// Numbers of vertices, triangles and collision proxies of a rigid body; zeros for any other body.
fn counts(body: &Body) -> (usize, usize, usize) {
    match &body.shape {
        Shape::Rigid { skin, proxies, .. } => (skin.vertices.len(), skin.triangles.len(), proxies.len()),
        _ => (0, 0, 0),
    }
}
