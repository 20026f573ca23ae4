//! The parts of `palpate bench paper` that measure how the time of a step grows with the contact area, with the sizes
//! of the meshes and with the number of bodies. Such a part measures several scenes; the results of one scene are a
//! row. The tool is the rigid body that the haptic device leads, here a sphere.

use std::path::Path;

use glam::DVec3;
use palpate::{Result, Scene};
use serde::{Deserialize, Serialize};

use super::Settings;
use super::watched::{Times, Watched};

/// Number of steps that are not timed, in which the tool reaches its final position or the bodies come to rest on the
/// ground.
const APPROACH: usize = 80;
/// Greatest depth to which a sphere is pressed into the head, m.
const DEEP: f64 = 0.004;
/// Point on the surface of the cheek of the head (the head of `touch-head.toml`) into which spheres are pressed, m.
const CHEEK: DVec3 = DVec3::new(0.03, -0.02, 0.084);
/// Edge of the cubic blocks, m, and number of cells along an edge.
const BLOCK: (f64, u32) = (0.05, 5);
/// Material of the head and of the blocks, in TOML.
const MATERIAL: &str = "young = 2e4, poisson = 0.45, density = 1000.0, damping_stiffness = 0.002";
/// Distance between corresponding points of neighbouring blocks, m.
const APART: f64 = 0.08;

/// The quantity that is varied from row to row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum By {
    /// Contact area; it is varied by the radius of the sphere that is pressed into the head.
    Area,
    /// Number of vertices of the head's skin (surface mesh).
    Skin,
    /// Number of tetrahedra of the head's layer (tetrahedral mesh); it is varied by the layer's cell size.
    Layer,
    /// Number of blocks that lie on the ground.
    Bodies,
}

impl By {
    /// Name of the part that varies this quantity.
    pub fn name(self) -> &'static str {
        match self {
            By::Area => "area",
            By::Skin => "skin",
            By::Layer => "layer",
            By::Bodies => "bodies",
        }
    }

    /// All quantities.
    pub const ALL: [By; 4] = [By::Area, By::Skin, By::Layer, By::Bodies];

    fn scene(self, value: f64) -> Result<Scene> {
        match self {
            By::Area => head(value, 44_000, 0.018),
            By::Skin => head(0.01, value as usize, 0.018),
            By::Layer => head(0.01, 44_000, value),
            By::Bodies => blocks(value as usize),
        }
    }
}

/// Sizes of one scene, and the cost of its steps.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Grown {
    /// Name of the row: `value` as text.
    pub name: String,
    /// Value that was varied: radius (m), skin vertices, cell size (m) or number of bodies.
    pub value: f64,
    /// Number of soft bodies.
    pub bodies: usize,
    /// Number of tetrahedra of all soft bodies.
    pub tetrahedra: usize,
    /// Number of skin vertices of all bodies except the tool.
    pub vertices: usize,
    /// GPU memory of the simulation, bytes.
    pub bytes_device: u64,
    /// Times, contacts and iterations of the measured steps.
    #[serde(flatten)]
    pub times: Times,
}

/// Measures a row for each value of the quantity `by`. All scenes are first brought into contact; then the scenes do a
/// few steps each, in turn.
pub fn measure(by: By, settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Vec<Grown>> {
    let mut all = Vec::new();
    for &value in settings.values(by) {
        watch(&format!("{}: {value}", by.name()));
        let mut watched = Watched::open(&by.scene(value)?, settings)?;
        let (tetrahedra, vertices) = watched.sizes();
        (0..APPROACH).try_for_each(|_| watched.step(None).map(drop))?;
        let bytes_device = watched.bytes();
        let bodies = if by == By::Bodies { value as usize } else { 1 };
        let name = value.to_string();
        let row = Grown { name, value, bodies, tetrahedra, vertices, bytes_device, ..Grown::default() };
        all.push((watched, row));
    }
    for turn in 0..settings.growth_steps {
        let mut order: Vec<_> = all.iter_mut().collect();
        // Every second turn has the reverse order, so that a change of the machine's speed favours no scene.
        if turn % 2 == 1 {
            order.reverse();
        }
        for (watched, row) in order {
            // The first step finds caches cold and is not counted; of the next four, two are timed by GPU timestamps
            // and two by the wall time of the whole step.
            watched.step(None)?;
            (0..4).try_for_each(|_| watched.step(Some(&mut row.times)).map(drop))?;
        }
    }
    Ok(all.into_iter().map(|(_, row)| row).collect())
}

/// A scene in which a sphere of this radius (m) is pressed into the cheek of a head with about `vertices` skin
/// vertices; `cell` is the cell size of the head's layer, m.
fn head(radius: f64, vertices: usize, cell: f64) -> Result<Scene> {
    let end = CHEEK + DVec3::Z * (radius - DEEP);
    let start = end + DVec3::Z * (2.0 * DEEP);
    let [DVec3 { x, y, z }, to] = [start, end];
    let time = 0.4 * APPROACH as f64 * 1e-3;
    let text = format!(
        "
        [[body]]
        name = 'head'
        surface = {{ model = 'head', vertices = {vertices} }}
        layer = {{ cell = {cell} }}
        material = {{ {MATERIAL} }}
        [[body.core]]
        name = 'skull'
        motion = 'fixed'
        bind = {{ inset = 0.03 }}
        [tool]
        sphere = {radius}
        mass = 0.05
        position = [{x}, {y}, {z}]
        [coupling]
        stiffness = 2000.0
        damping = 20.0
        angular_stiffness = 0.5
        angular_damping = 0.002
        [drive]
        keys = [[0.0, {x}, {y}, {z}], [{time}, {}, {}, {}]]
        ",
        to.x, to.y, to.z
    );
    Scene::parse(Path::new("head"), &text)
}

/// A scene of `count` blocks that lie side by side on the ground without touching each other.
fn blocks(count: usize) -> Result<Scene> {
    let (edge, cells) = BLOCK;
    let columns = (count as f64).sqrt().ceil() as usize;
    let block = |k: usize| {
        let (x, z) = (APART * (k % columns) as f64, APART * (k / columns) as f64);
        format!(
            "
            [[body]]
            name = 'block{k}'
            layer = {{ box = [[0.0, 0.0, 0.0], [{edge}, {edge}, {edge}]], cells = [{cells}, {cells}, {cells}] }}
            material = {{ {MATERIAL} }}
            position = [{x}, 0.0, {z}]
            collides = ['floor']
            "
        )
    };
    let floor = "
            [[body]]
            name = 'floor'
            plane = [0.0, 1.0, 0.0, 0.0]
            ";
    Scene::parse(Path::new("blocks"), &((0..count).map(block).collect::<String>() + floor))
}
