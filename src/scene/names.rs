//! Checks that the bodies to which a scene refers by name exist, and that there is a tool (the rigid body that the
//! haptic device moves) where the scene refers to one. The modules `load.rs` and `build.rs` call this one.

use super::keys::{Table, Value};
use super::load::TOOL;
use super::{Body, Core, Motion, Scene, Shape, Tool, ToolShape};
use crate::Result;

/// A name in a scene to which no suitable body or tool corresponds: its place, what is wrong, and what the user can do.
pub(super) struct Unresolved {
    pub place: Place,
    pub problem: String,
    pub remedy: String,
}

/// A place where a scene refers to a body or the tool by name.
pub(super) enum Place {
    /// The key `collides` of the body with this index.
    Collides(usize),
    /// The key `body` of the probe with this index.
    Probe(usize),
    /// The key `tool.body`.
    Tool,
    /// The key `body` of the tool with this index among the further tools.
    FurtherTool(usize),
}

impl Place {
    /// The dotted path of the place's key in a scene file.
    pub fn key(&self, scene: &Scene) -> String {
        match *self {
            Place::Collides(body) => format!("body.{}.collides", scene.bodies[body].name),
            Place::Probe(probe) => format!("probe.{}.body", scene.probes[probe].name),
            Place::Tool => "tool.body".into(),
            Place::FurtherTool(index) => format!("tool.{}.body", scene.further_tools[index].name),
        }
    }

    /// The value at the place, in the tables of `root`, which were added to a scene. `before`: numbers of bodies and of
    /// probes that the scene had before.
    fn value<'a>(&self, root: &Table<'a>, before: [usize; 2]) -> Result<Value<'a>> {
        let of = |array: &str, index: usize| root.need(array)?.array()?[index].unchecked_table();
        match *self {
            Place::Collides(body) => of("body", body - before[0])?.need("collides"),
            Place::Probe(probe) => of("probe", probe - before[1])?.need("body"),
            Place::Tool if root.need("tool")?.is_array() => of("tool", 0)?.need("body"),
            Place::Tool => root.need("tool")?.unchecked_table()?.need("body"),
            Place::FurtherTool(index) => of("tool", index + 1)?.need("body"),
        }
    }
}

/// Checks that all names in the tables of `root`, which were added to a scene, refer to something that exists, and that
/// there is a tool for the tables that need one. `before`: numbers of bodies and of probes that the scene had before.
pub(super) fn check_names(root: &Table, scene: &Scene, before: [usize; 2]) -> Result<()> {
    for key in ["coupling", "drive", "haptics"] {
        if scene.tool.is_none() && root.has(key) {
            return Err(root.error(key, "there is no [tool] for this table", "add a [tool], or remove the table"));
        }
        if !scene.further_tools.is_empty() && key != "haptics" && root.has(key) {
            let problem = "does not say for which of several tools";
            return Err(root.error(key, problem, format!("give `{key}` in each [[tool]]")));
        }
    }
    let check = resolve(scene, before, root.has("tool"));
    check.or_else(|Unresolved { place, problem, remedy }| Err(place.value(root, before)?.error(problem, remedy)))
}

/// Checks the names to which bodies and probes of a scene refer; `from`: index of the first body and of the first probe
/// to check. If `is_new`, the tools are checked too: where they are bodies of the scene, these must exist, and their first
/// rigid cores (for a rigid body, the body itself) must be dynamic.
pub(super) fn resolve(scene: &Scene, from: [usize; 2], is_new: bool) -> std::result::Result<(), Unresolved> {
    let wrong = |place, (problem, remedy)| Err(Unresolved { place, problem, remedy });
    for (index, body) in scene.bodies.iter().enumerate().skip(from[0]) {
        for name in body.collides.iter().flatten() {
            if let Err(words) = check_partner(scene, body, name) {
                return wrong(Place::Collides(index), words);
            }
        }
    }
    for (index, probe) in scene.probes.iter().enumerate().skip(from[1]) {
        match scene.bodies.iter().find(|body| body.name == probe.body) {
            None => return wrong(Place::Probe(index), unknown(scene, &probe.body)),
            Some(body) if matches!(body.shape, Shape::Plane { .. }) => {
                let words = ("is a plane, which has no skin to follow".into(), "name another body".into());
                return wrong(Place::Probe(index), words);
            }
            Some(_) => {}
        }
    }
    let Some(Tool { shape: ToolShape::Body(name), .. }) = scene.tool.as_ref().filter(|_| is_new) else { return Ok(()) };
    let names_tool = |body: &&Body| body.collides.iter().flatten().any(|name| name == TOOL);
    if let Some(other) = scene.bodies[..from[0]].iter().find(names_tool) {
        let problem = format!("body \"{}\" names \"tool\" in `collides`, but this tool is a body", other.name);
        return wrong(Place::Tool, (problem, "add the tool first, then name the tool's body in `collides`".into()));
    }
    let further = scene.further_tools.iter().enumerate().map(|(index, tool)| (Place::FurtherTool(index), &tool.body));
    let mut held: Vec<&str> = Vec::new();
    for (place, name) in std::iter::once((Place::Tool, name)).chain(further) {
        if let Err(words) = check_held(scene, name, &held) {
            return wrong(place, words);
        }
        held.push(name);
    }
    Ok(())
}

/// Checks the body called `name` that a tool is, while other tools are the bodies `held`; the error is a problem and its
/// remedy.
fn check_held(scene: &Scene, name: &str, held: &[&str]) -> std::result::Result<(), (String, String)> {
    let Some(body) = scene.bodies.iter().find(|body| body.name == name) else { return Err(unknown(scene, name)) };
    if held.contains(&name) {
        return Err((format!("\"{name}\" is another tool already"), "give each tool a body of its own".into()));
    }
    if !matches!(body.cores.first(), Some(Core { motion: Motion::Dynamic, .. })) {
        let problem = format!("the first core of \"{name}\", to which the haptic device is coupled, is not dynamic");
        let remedy = "give its first [[body.core]], or the rigid body, motion = \"dynamic\"";
        return Err((problem, remedy.into()));
    }
    Ok(())
}

/// Checks a name that a body has in its list `collides`; the error is a problem and its remedy.
pub(super) fn check_partner(scene: &Scene, body: &Body, name: &str) -> std::result::Result<(), (String, String)> {
    let wrong = |problem: &str, remedy: &str| Err((problem.into(), remedy.into()));
    if name == body.name {
        return wrong("names the body itself", "remove it: a body never collides with itself");
    }
    if name != TOOL {
        let is_there = scene.bodies.iter().any(|other| other.name == name);
        return if is_there { Ok(()) } else { Err(unknown(scene, name)) };
    }
    match (&scene.tool, scene.rigid_tool()) {
        (None, _) => wrong("there is no [tool]", "add one, or remove \"tool\""),
        (Some(_), None) => wrong("names the tool, which is a body", "give that body's name"),
        _ => Ok(()),
    }
}

/// Problem and remedy for a name that is not the name of any body.
fn unknown(scene: &Scene, name: &str) -> (String, String) {
    let bodies: Vec<&str> = scene.bodies.iter().map(|body| body.name.as_str()).collect();
    let known = if bodies.is_empty() { "none".into() } else { bodies.join(", ") };
    (format!("there is no body \"{}\"", name.escape_debug()), format!("bodies of this scene: {known}"))
}
