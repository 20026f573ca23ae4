//! [`Scene::load`] reads a scene file (TOML) into a [`Scene`] (the bodies, the tool and the settings of a simulation)
//! and checks it. The tool is the rigid body that the haptic device moves; the reference trajectory, `[drive]`, gives
//! poses (*keys*) of the device at given times; a probe, `[[probe]]`, is a skin vertex whose positions are recorded; a
//! preset is a named set of settings.
//!
//! Bodies are read in `body.rs`, tools in `tools.rs`, trajectories in `trajectory.rs`, and the settings of the haptic loop
//! in `haptics.rs`. Mesh files must exist, but are not read here.

use std::iter;
use std::path::{Path, PathBuf};

use glam::DVec3;

use super::keys::{Node, Source, Table, Value};
use super::preset::{self, PRESETS, Preset};
use super::reference::{self, TableKeys};
use super::{
    Body, Contact, DepthPath, FurtherTool, Haptics, Key, Operator, Preconditioner, Probe, Samples, Scene, SceneBuilder,
    Sides, Solver, Step, Tool, ToolShape, body, check, haptics, names, tools, trajectory,
};
use crate::{Error, Result, files};

/// Name by which bodies of a scene refer to the tool.
pub(super) const TOOL: &str = "tool";
/// Length of a run, s, if no key of the reference trajectory has a time above zero.
const DEFAULT_DURATION: f64 = 1.0;
/// Default acceleration of gravity, m/s^2.
const GRAVITY: DVec3 = DVec3::new(0.0, -9.81, 0.0);
/// Default speed below which friction is viscous, m/s.
const FRICTION_SPEED: f64 = 0.001;
/// Default penetration depth above which a step sets a flag (a warning bit) in its results, m.
const DEPTH_LIMIT: f64 = 0.02;

impl Scene {
    /// Reads a scene file and checks it: every number is finite and in range, and whatever a name or a path refers to
    /// exists. Errors name the file, the line, the key and the remedy.
    pub fn load(path: &Path) -> Result<Scene> {
        Scene::parse(path, &files::text(path, "give a scene file")?)
    }

    /// Reads and checks the text of a scene file. Errors name `path`, and paths in the text are relative to the folder
    /// of `path`.
    pub fn parse(path: &Path, text: &str) -> Result<Scene> {
        let mut builder = SceneBuilder::new(path);
        let source = Source::of_file(path, text);
        add(&mut builder, &source, &source.parse()?)?;
        builder.scene().check_filled()?;
        Ok(builder.scene().clone())
    }

    /// Fails for a scene with neither a body nor a tool, in which there is nothing to simulate.
    #[doc(hidden)]
    pub fn check_filled(&self) -> Result<()> {
        if !self.bodies.is_empty() || self.tool.is_some() {
            return Ok(());
        }
        let problem = "the scene has neither a body nor a tool";
        Err(Error::input(&self.file, None, problem, "add a [[body]] or a [tool]"))
    }

    /// A scene of one body, with the settings that an empty scene file gives. Error messages name `file`.
    #[doc(hidden)]
    pub fn of_body(file: impl Into<PathBuf>, body: Body) -> Scene {
        Scene { bodies: vec![body], ..Scene::empty(file) }
    }

    /// A scene without bodies and tool, with the settings that an empty scene file gives. Error messages name `file`.
    pub fn empty(file: impl Into<PathBuf>) -> Scene {
        Scene {
            file: file.into(),
            step: no_step(&preset::NONE),
            solver: no_solver(&preset::NONE),
            contact: no_contact(&preset::NONE),
            bodies: Vec::new(),
            tool: None,
            further_tools: Vec::new(),
            coupling: None,
            trajectory: Vec::new(),
            haptics: Haptics::default(),
            probes: Vec::new(),
            preset: None,
        }
    }

    /// The longest time step of the simulation, s. With a haptic device, a step is as long as its computation takes, but
    /// at least `step.dt` and at most this long, of several devices the least of their settings; without one, every step has this length.
    pub fn longest_step(&self) -> f64 {
        let further = self.further_tools.iter().filter_map(|tool| Some(tool.haptics.as_ref()?.longest_step));
        let longest = further.fold(self.haptics.longest_step, f64::min);
        if self.haptics.has_device { longest.max(self.step.dt) } else { self.step.dt }
    }

    /// Name of the scene: the name of its file without folder and extension.
    pub fn name(&self) -> String {
        self.file.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default()
    }

    /// Index of the body that serves as the tool, if a body does; of several tools the first.
    pub fn tool_body_index(&self) -> Option<usize> {
        match &self.tool.as_ref()?.shape {
            ToolShape::Body(name) => self.bodies.iter().position(|body| body.name == *name),
            _ => None,
        }
    }

    /// Indices of the bodies that serve as tools, in the order of the tools.
    pub(crate) fn tool_bodies(&self) -> impl Iterator<Item = usize> {
        let index = |tool: &FurtherTool| self.bodies.iter().position(|body| body.name == tool.body);
        self.tool_body_index().into_iter().chain(self.further_tools.iter().filter_map(index))
    }

    /// The reference trajectories of all haptic devices.
    fn trajectories(&self) -> impl Iterator<Item = &[Key]> {
        iter::once(&self.trajectory[..]).chain(self.further_tools.iter().map(|tool| &tool.trajectory[..]))
    }

    /// The tool; `None` if there is no tool, or if one of the scene's bodies serves as the tool.
    pub fn rigid_tool(&self) -> Option<&Tool> {
        self.tool.as_ref().filter(|tool| !matches!(tool.shape, ToolShape::Body(_)))
    }

    /// Length of a run, s, if the user gives none: the time of the last key of any trajectory, or one second if no key
    /// has a time above zero.
    pub fn duration(&self) -> f64 {
        let last = self.trajectories().filter_map(|keys| keys.last()).map(|key| key.time).fold(0.0, f64::max);
        if last > 0.0 { last } else { DEFAULT_DURATION }
    }
}

impl Default for Step {
    /// Steps of 1 ms, gravity along -y, one Newton iteration.
    fn default() -> Step {
        no_step(&preset::NONE)
    }
}

impl Default for Solver {
    /// Stops at a relative residual of 1e-5 or after 200 iterations; the preconditioner is chosen automatically.
    fn default() -> Solver {
        no_solver(&preset::NONE)
    }
}

impl Default for Contact {
    /// Automatic stiffness and damping, no friction.
    fn default() -> Contact {
        no_contact(&preset::NONE)
    }
}

/// Adds the tables of `document` to a scene. Bodies and probes of the document come after those of the scene; a key of
/// `[step]`, `[solver]` or `[contact]` replaces one value of the scene, and any other table replaces the scene's whole
/// table. After an error the scene may be changed in part.
pub(super) fn add(builder: &mut SceneBuilder, source: &Source, document: &Node) -> Result<()> {
    let root = Table::root(source, document, &reference::ROOT)?;
    let tables = ["step", "solver", "contact"];
    let is_given = |table: &str, key: &str| {
        tables.contains(&table) && root.get(table).is_some_and(|t| t.unchecked_table().is_ok_and(|t| t.has(key)))
    };
    let scene = builder.scene_mut();
    if let Some(preset) = root.option("preset", preset_of)? {
        let Step { gravity, .. } = scene.step;
        scene.step = Step { gravity, ..no_step(&preset) };
        scene.solver = Solver { tolerance: preset.tolerance, max_iterations: preset.max_iterations, ..scene.solver };
        scene.contact.sides = preset.sides;
        scene.preset = Some(preset.chosen(is_given));
    }
    scene.step = step(&root, &scene.step)?;
    scene.solver = solver(&root, &scene.solver)?;
    scene.contact = contact(&root, &scene.contact)?;
    let before = [scene.bodies.len(), scene.probes.len()];
    body::read(&root, builder)?;
    let scene = builder.scene_mut();
    tools::read(&root, scene)?;
    scene.coupling = root.option("coupling", tools::coupling)?.or(scene.coupling);
    if let Some(keys) = root.option("drive", trajectory::read)? {
        scene.trajectory = keys;
    }
    if root.has("haptics") {
        scene.haptics = haptics::read(&root)?;
    }
    scene.haptics.has_device |= scene.has_further_device();
    probes(&root, &mut scene.probes)?;
    names::check_names(&root, scene, before)
}

/// A table of the root table; `None` if the scene file leaves it out.
fn section<'a>(root: &Table<'a>, key: &str, known: &TableKeys) -> Result<Option<Table<'a>>> {
    root.option(key, |value| value.table(known))
}

/// Reads the name of a preset.
fn preset_of(value: &Value) -> Result<Preset> {
    value.one_of("preset", &PRESETS.map(|preset| (preset.name, preset)))
}

/// The settings of a scene without `[step]`; the preset `defaults` gives all values but gravity.
fn no_step(defaults: &Preset) -> Step {
    Step { dt: defaults.dt, gravity: GRAVITY, newton: defaults.newton }
}

/// The settings of a scene without `[solver]`; the preset `defaults` gives tolerance and iterations.
fn no_solver(defaults: &Preset) -> Solver {
    let Preset { tolerance, max_iterations, .. } = *defaults;
    Solver { tolerance, max_iterations, preconditioner: Preconditioner::Auto, operator: Operator::Auto }
}

/// The settings of a scene without `[contact]`; the preset `defaults` gives the value of `sides`.
fn no_contact(defaults: &Preset) -> Contact {
    Contact {
        stiffness: None,
        damping: None,
        friction: 0.0,
        friction_speed: FRICTION_SPEED,
        texel: None,
        depth_limit: DEPTH_LIMIT,
        depth: None,
        sides: defaults.sides,
        samples: Samples::Auto,
    }
}

/// Reads `[step]`; keys that the table leaves out have the values of `none`.
fn step(root: &Table, none: &Step) -> Result<Step> {
    let Some(table) = section(root, "step", &reference::STEP)? else { return Ok(none.clone()) };
    Ok(Step {
        dt: table.or("dt", none.dt, Value::positive)?,
        gravity: table.or("gravity", none.gravity, Value::vector)?,
        newton: table.or("newton", none.newton, |value| value.whole(1, check::MOST_LINEARISATIONS))?,
    })
}

/// Reads `[solver]`; keys that the table leaves out have the values of `none`.
fn solver(root: &Table, none: &Solver) -> Result<Solver> {
    let Some(table) = section(root, "solver", &reference::SOLVER)? else {
        return Ok(none.clone());
    };
    Ok(Solver {
        tolerance: table.or("tolerance", none.tolerance, |value| value.ruled(check::tolerance).map(Some))?,
        max_iterations: table
            .or("max_iterations", none.max_iterations, |value| value.whole(1, check::MOST_ITERATIONS))?,
        preconditioner: table.or("preconditioner", none.preconditioner, |value| {
            value.one_of("preconditioner", &Preconditioner::CHOICES)
        })?,
        operator: table.or("operator", none.operator, |value| value.one_of("operator", &Operator::CHOICES))?,
    })
}

/// Reads `[contact]`; keys that the table leaves out have the values of `none`.
fn contact(root: &Table, none: &Contact) -> Result<Contact> {
    let Some(table) = section(root, "contact", &reference::CONTACT)? else {
        return Ok(none.clone());
    };
    Ok(Contact {
        stiffness: table.or("stiffness", none.stiffness, Value::auto_or_positive)?,
        damping: table.or("damping", none.damping, Value::auto_or_not_negative)?,
        friction: table.or("friction", none.friction, Value::not_negative)?,
        friction_speed: table.or("friction_speed", none.friction_speed, |value| value.ruled(check::friction_speed))?,
        texel: table.or("texel", none.texel, Value::auto_or_positive)?,
        depth_limit: table.or("depth_limit", none.depth_limit, Value::positive)?,
        depth: table.or("depth", none.depth, |value| value.one_of("path", &DepthPath::CHOICES))?,
        sides: table.or("sides", none.sides, |value| value.one_of("choice of sides", &Sides::CHOICES))?,
        samples: table.or("samples", none.samples, |value| value.one_of("kind of samples", &Samples::CHOICES))?,
    })
}

fn probes(root: &Table, probes: &mut Vec<Probe>) -> Result<()> {
    let Some(array) = root.get("probe") else { return Ok(()) };
    for element in array.array()? {
        let table = element.table(&reference::PROBE)?;
        let name = table.need("name")?.name()?;
        let probe = Probe { name, body: table.need("body")?.name()?, nearest: table.need("nearest")?.vector()? };
        probe.check(probes).map_err(|problem| table.wrong(problem))?;
        probes.push(probe);
    }
    Ok(())
}
