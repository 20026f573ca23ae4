//! The seam between the program and the engine: everything the program asks of it, and nothing else.

use glam::DVec3;
use palpate::report::{Facts, Row};
use palpate::scene::Scene;
use palpate::{Error, Result};

/// A simulation under way.
pub struct Engine {
    never: std::convert::Infallible,
}

/// What is left when a run is over.
pub struct Outcome {
    /// Device, plan and times.
    pub facts: Facts,
    /// Layers of the soft bodies.
    pub layers: Vec<LayerResult>,
    /// Skins of the soft bodies.
    pub skins: Vec<SkinResult>,
}

/// A layer at the end of a run, for `NAME.vtk`.
pub struct LayerResult {
    /// The body.
    pub name: String,
    /// Deformed world positions, m, in input order.
    pub nodes: Vec<DVec3>,
    /// Four nodes each.
    pub tetrahedra: Vec<[u32; 4]>,
    /// From rest as placed, world axes, m; one a node.
    pub displacement: Vec<DVec3>,
}

/// A skin at the end of a run, for `NAME.obj`.
pub struct SkinResult {
    /// The body.
    pub name: String,
    /// Deformed world positions, m, in file order.
    pub vertices: Vec<DVec3>,
    /// Three vertices each.
    pub triangles: Vec<[u32; 3]>,
}

impl Engine {
    /// Prepares the scene, opens the device (a name, an index, or the best one) and records the step.
    pub fn open(scene: &Scene, _device: Option<&str>) -> Result<Self> {
        scene.check_meshes()?;
        Err(no_engine())
    }

    /// One step.
    pub fn step(&mut self) -> Result<Row> {
        match self.never {}
    }

    /// Reads back what is left.
    pub fn finish(self) -> Result<Outcome> {
        match self.never {}
    }
}

/// Names of the devices that can be used, by index.
pub fn devices() -> Result<Vec<String>> {
    Err(no_engine())
}

fn no_engine() -> Error {
    Error::NoDevice("no device can be used: this build has no engine; build a later version".into())
}
