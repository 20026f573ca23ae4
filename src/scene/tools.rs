//! Reads the tools of a scene, the rigid bodies that haptic devices lead: `[tool]`, a single one, or `[[tool]]`, up to
//! four, each a body of the scene with a coupling and a trajectory of its own. Called by `load.rs`.

use glam::{DQuat, DVec3};

use super::check::{self, MOST_TOOLS};
use super::keys::{Table, Value};
use super::units::UNITS;
use super::{Coupling, FurtherTool, Haptics, Key, Scene, Tool, ToolShape, body, haptics, reference, trajectory};
use crate::Result;

/// Reads the key `tool` of the scene file's root table, if it is there, into the scene, whose tools it replaces.
pub(super) fn read(root: &Table, scene: &mut Scene) -> Result<()> {
    let Some(value) = root.get("tool") else { return Ok(()) };
    if !value.is_array() {
        scene.tool = Some(tool(&value)?);
        scene.drop_further_tools();
        return Ok(());
    }
    for key in ["coupling", "drive"] {
        if root.has(key) {
            let problem = "has no meaning beside [[tool]]: it does not say for which tool";
            return Err(root.error(key, problem, format!("give `{key}` in each [[tool]]")));
        }
    }
    let tables = value.array()?;
    if tables.is_empty() || tables.len() > MOST_TOOLS {
        return Err(value.error(format!("has {} tools", tables.len()), format!("give 1 to {MOST_TOOLS}")));
    }
    let mut tools: Vec<FurtherTool> = Vec::new();
    for (index, element) in tables.into_iter().enumerate() {
        let unnamed = element.table(&reference::TOOLS)?;
        let name = unnamed.need("name")?.name()?;
        let table = unnamed.renamed(format!("tool.{name}"));
        check::tool_name(&name, tools.iter().map(|tool| tool.name.as_str())).map_err(|problem| table.wrong(problem))?;
        if index == 0 && table.has("haptics") && root.has("haptics") {
            let problem = "stands twice for the first tool: here, and as [haptics]";
            return Err(table.error("haptics", problem, "remove one"));
        }
        tools.push(FurtherTool {
            name,
            body: table.need("body")?.name()?,
            coupling: table.option("coupling", coupling)?,
            trajectory: table.option("drive", trajectory::read)?.unwrap_or_default(),
            haptics: if table.has("haptics") { Some(haptics::read(&table)?) } else { None },
        });
    }
    let first = tools.remove(0);
    if !scene.further_tools.is_empty() {
        // The devices of the tools before no longer make the scene a session.
        scene.haptics = std::mem::take(&mut scene.haptics).for_device();
    }
    scene.tool = Some(Tool { name: first.name, ..Tool::body(&first.body) });
    (scene.coupling, scene.trajectory, scene.further_tools) = (first.coupling, first.trajectory, tools);
    scene.haptics = first.haptics.unwrap_or(std::mem::take(&mut scene.haptics));
    Ok(())
}

/// What a scene says of a haptic device that leads a tool.
#[derive(Debug, PartialEq)]
pub struct Leader<'a> {
    /// Index of the tool.
    pub index: usize,
    /// Its name.
    pub tool: &'a str,
    /// Settings of the device and of its haptic loop.
    pub haptics: Haptics,
    /// Where the device goes that no user moves.
    pub trajectory: &'a [Key],
    /// The key of the settings, for messages.
    pub key: String,
}

impl Scene {
    /// What the scene says of the haptic device that leads the tool of this index. `None`: there is no such tool. A tool
    /// after the first that names no device has the default one.
    #[doc(hidden)]
    pub fn leader(&self, index: usize) -> Option<Leader<'_>> {
        if index == 0 {
            let (haptics, key) = (self.haptics.clone(), "haptics".into());
            return Some(Leader { index, tool: &self.tool.as_ref()?.name, haptics, trajectory: &self.trajectory, key });
        }
        let FurtherTool { name, trajectory, haptics, .. } = self.further_tools.get(index - 1)?;
        let key = format!("tool.{name}.haptics");
        Some(Leader { index, tool: name, haptics: haptics.clone().unwrap_or_default(), trajectory, key })
    }

    /// Names of the tools, in the scene's order.
    #[doc(hidden)]
    pub fn tool_names(&self) -> impl Iterator<Item = &str> {
        let first = self.tool.iter().map(|tool| tool.name.as_str());
        first.chain(self.further_tools.iter().map(|tool| tool.name.as_str()))
    }

    /// Number of tools that haptic devices lead in a session: all up to the last one that has settings of a device.
    pub fn held_tools(&self) -> usize {
        self.further_tools.iter().rposition(|tool| tool.haptics.is_some()).map_or(1, |last| last + 2)
    }

    /// Whether a scene with these tools is a session because a tool after the first has a haptic device.
    pub(super) fn has_further_device(&self) -> bool {
        self.further_tools.iter().any(|tool| tool.haptics.as_ref().is_some_and(|haptics| haptics.has_device))
    }

    /// Drops all tools after the first of several, and what only one of several tools has: a coupling and a trajectory of
    /// its own. Their devices no longer make the scene a session.
    pub(super) fn drop_further_tools(&mut self) {
        if !self.further_tools.is_empty() {
            self.further_tools.clear();
            (self.coupling, self.trajectory) = (None, Vec::new());
            self.haptics = std::mem::take(&mut self.haptics).for_device();
        }
    }
}

fn tool(value: &Value) -> Result<Tool> {
    let table = value.table(&reference::TOOL)?;
    let shape_key = table.exactly_one(&["sphere", "surface", "body"])?;
    let shape_value = table.need(shape_key)?;
    let shape = match shape_key {
        "sphere" => ToolShape::Sphere(shape_value.positive()?),
        "surface" => ToolShape::Surface(body::given_surface(&shape_value)?),
        _ => ToolShape::Body(shape_value.name()?),
    };
    let meaningless: &[&str] = match shape {
        ToolShape::Sphere(_) => &["units", "scale", "repair"],
        ToolShape::Surface(_) => &[],
        ToolShape::Body(_) => &["mass", "position", "orientation", "velocity", "units", "scale", "repair"],
    };
    if let Some(key) = meaningless.iter().find(|key| table.has(key)) {
        return Err(table.error(key, format!("has no meaning together with `{shape_key}`"), "remove it"));
    }
    // A tool that is a body of the scene has that body's mass and pose.
    let mass = if matches!(shape, ToolShape::Body(_)) { 0.0 } else { table.need("mass")?.positive()? };
    Ok(Tool {
        position: table.or("position", DVec3::ZERO, Value::vector)?,
        orientation: table.or("orientation", DQuat::IDENTITY, Value::quaternion)?,
        velocity: table.or("velocity", DVec3::ZERO, Value::vector)?,
        units: table.option("units", |value| value.one_of("unit of length", &UNITS))?,
        scale: table.or("scale", 1.0, Value::positive)?,
        repair: table.or("repair", true, Value::truth)?,
        ..Tool::of(shape, mass)
    })
}

/// Reads a virtual coupling.
pub(super) fn coupling(value: &Value) -> Result<Coupling> {
    let table = value.table(&reference::COUPLING)?;
    Ok(Coupling {
        stiffness: table.need("stiffness")?.not_negative()?,
        damping: table.need("damping")?.not_negative()?,
        angular_stiffness: table.or("angular_stiffness", 0.0, Value::not_negative)?,
        angular_damping: table.or("angular_damping", 0.0, Value::not_negative)?,
    })
}
