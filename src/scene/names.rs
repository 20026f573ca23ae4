//! Whether what scenes name is there: bodies, and the tool. Called by `load.rs` and `build.rs`.

use super::keys::Table;
use super::load::TOOL;
use super::{Body, Core, Motion, Scene, Shape, Tool, ToolShape};
use crate::Result;

/// Names that refer to bodies must resolve, and tables that serve the tool need one. `before`: bodies and probes that there
/// were before these tables.
pub(super) fn check_names(root: &Table, scene: &Scene, before: [usize; 2]) -> Result<()> {
    for key in ["coupling", "drive", "haptics"] {
        if scene.tool.is_none() && root.has(key) {
            return Err(root.error(key, "there is no [tool] to hold", "add a [tool], or remove the table"));
        }
    }
    for (index, body) in scene.bodies[before[0]..].iter().enumerate() {
        for name in body.collides.iter().flatten() {
            if let Err((problem, remedy)) = check_partner(scene, body, name) {
                let value = root.need("body")?.array()?[index].unchecked_table()?.need("collides")?;
                return Err(value.error(problem, remedy));
            }
        }
    }
    for (index, probe) in scene.probes[before[1]..].iter().enumerate() {
        let value = || root.need("probe")?.array()?[index].unchecked_table()?.need("body");
        match scene.bodies.iter().find(|body| body.name == probe.body) {
            None => {
                let (problem, remedy) = unknown(scene, &probe.body);
                return Err(value()?.error(problem, remedy));
            }
            Some(body) if matches!(body.shape, Shape::Plane { .. }) => {
                return Err(value()?.error("is a plane, which has no skin to follow", "name another body"));
            }
            Some(_) => {}
        }
    }
    let Some(table) = root.get("tool") else { return Ok(()) };
    if let Some(Tool { shape: ToolShape::Body(name), .. }) = &scene.tool {
        let value = table.unchecked_table()?.need("body")?;
        let names_tool = |body: &&Body| body.collides.iter().flatten().any(|name| name == TOOL);
        if let Some(other) = scene.bodies[..before[0]].iter().find(names_tool) {
            let problem = format!("body \"{}\" names \"tool\" in `collides`, and the tool becomes a body", other.name);
            return Err(value.error(problem, "add the tool before that body, and name it there"));
        }
        let Some(body) = scene.held_body().map(|body| &scene.bodies[body]) else {
            let (problem, remedy) = unknown(scene, name);
            return Err(value.error(problem, remedy));
        };
        if !matches!(body.cores.first(), Some(Core { motion: Motion::Dynamic, .. })) {
            let problem = format!("the first core of \"{name}\", by which it is held, is not dynamic");
            return Err(value.error(problem, "give its first [[body.core]], or the rigid body, motion = \"dynamic\""));
        }
    }
    Ok(())
}

/// Refuses a name that a body cannot have in `collides`: problem and remedy.
pub(super) fn check_partner(scene: &Scene, body: &Body, name: &str) -> std::result::Result<(), (String, String)> {
    let wrong = |problem: &str, remedy: &str| Err((problem.into(), remedy.into()));
    if name == body.name {
        return wrong("names the body itself", "a body never collides with itself");
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

/// Problem and remedy of a name that is no body's.
fn unknown(scene: &Scene, name: &str) -> (String, String) {
    let bodies: Vec<&str> = scene.bodies.iter().map(|body| body.name.as_str()).collect();
    let known = if bodies.is_empty() { "none".into() } else { bodies.join(", ") };
    (format!("there is no body \"{}\"", name.escape_debug()), format!("bodies of this scene: {known}"))
}
