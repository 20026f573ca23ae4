//! `palpate bench proximity`: what the proximity query costs, and what that depends on.

mod document;
pub mod graded;
mod patches;
mod peers;
mod scenes;

use std::path::PathBuf;

use serde::Serialize;

pub use document::document;
pub use patches::{Area, Place, Sensitivity};
pub use peers::Peers;
pub use scenes::{Outcome, SceneTimes};

use crate::Result;
use crate::gpu::{Context, Options};
use crate::prepare::{self, Body, Cache, FrameMotion, Shape, mass, skin};
use crate::step::choice::Choice;

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
    /// Folder of the scenes.
    pub scenes: PathBuf,
    /// Steps of each scene after its first contact.
    pub steps: usize,
    /// A scene is left after so many seconds, s.
    pub scene_seconds: f64,
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
            scenes: PathBuf::from("assets/scenes"),
            steps: 200,
            scene_seconds: 80.0,
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
            steps: 20,
            scene_seconds: 6.0,
            is_quick: true,
            ..Settings::full()
        }
    }
}

/// The contents of `results.json`.
#[derive(Debug, Clone, Serialize)]
pub struct Results {
    /// [`super::SCHEMA`].
    pub schema: u32,
    /// Always `proximity`.
    pub benchmark: &'static str,
    /// Version of palpate.
    pub version: &'static str,
    /// Name of the device.
    pub device: String,
    /// Name and version of its driver.
    pub driver: String,
    /// How the depth field was rasterized.
    pub depth_path: &'static str,
    /// Threads that this machine runs at once.
    pub threads: usize,
    /// What was asked for.
    pub settings: Settings,
    /// One patch on skins of several sizes.
    pub sensitivity: Vec<Sensitivity>,
    /// Two skins pressed together ever deeper.
    pub area: Vec<Area>,
    /// The same work by others.
    pub peers: Peers,
    /// Running scenes.
    pub scenes: Vec<SceneTimes>,
}

/// Measures everything; `watch` is told what begins. Errors: no device, a scene that is no scene, a device that fails.
pub fn run(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Results> {
    // Scenes with mistakes are refused before minutes are spent.
    let read = scenes::read(settings)?;
    let context = Context::new(&Options { device: settings.device.clone(), ..Options::default() })?;
    let sensitivity = patches::sensitivity(&context, settings, watch)?;
    let area = patches::area(&context, settings, watch)?;
    let peers = peers::peers(&context, settings, watch)?;
    let scenes = scenes::measure(read, settings, watch)?;
    Ok(Results {
        schema: super::SCHEMA,
        benchmark: "proximity",
        version: env!("CARGO_PKG_VERSION"),
        device: context.device_name().into(),
        driver: context.driver().into(),
        depth_path: Choice::new(&context, None, &Cache::of_user())?.path.name(),
        threads: std::thread::available_parallelism().map_or(1, Into::into),
        settings: settings.clone(),
        sensitivity,
        area,
        peers,
        scenes,
    })
}

/// A fixed rigid body of a closed surface, its proxies as the engine makes them.
fn rigid(name: &str, vertices: Vec<glam::DVec3>, triangles: Vec<[u32; 3]>) -> Result<Body> {
    let mass::Properties { volume, centroid, inertia } = mass::properties(&vertices, &triangles);
    let skin = skin::build(vertices, triangles);
    let proxies = prepare::proxies(&skin).map_err(|e| crate::Error::Simulation(format!("`{name}`: {e}")))?;
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
