//! What the scene format knows and the engine does not do yet. Each feature is refused here and nowhere else, so that
//! whoever adds it deletes lines here.

use super::keys::{Table, Value};
use super::{Dilatation, Preconditioner, Scene, ToolShape};
use crate::{Error, Result};

/// Refuses a valid scene that asks for more than the engine does, naming the key.
pub(super) fn check(root: &Table, scene: &Scene) -> Result<()> {
    let of = |table: &str, key: &str| root.need(table)?.unchecked_table()?.need(key);
    if scene.step.newton != 1 {
        return Err(refuse(&of("step", "newton")?, "leave it at 1"));
    }
    if scene.solver.preconditioner == Preconditioner::Coarse {
        return Err(refuse(&of("solver", "preconditioner")?, "use \"auto\" or \"jacobi\""));
    }
    if let Some(index) = scene.bodies.iter().position(|body| body.dilatation == Dilatation::Patch) {
        let value = root.need("body")?.array()?[index].unchecked_table()?.need("dilatation")?;
        return Err(refuse(&value, "use \"element\""));
    }
    if scene.haptics.device != "scripted" {
        return Err(refuse(&of("haptics", "device")?, "use \"scripted\""));
    }
    if let Some(tool) = &scene.tool
        && let ToolShape::Body(_) = tool.shape
    {
        return Err(refuse(&of("tool", "body")?, "use `sphere` or `surface`"));
    }
    Ok(())
}

fn refuse(value: &Value, remedy: &str) -> Error {
    value.error("this version does not do that yet", remedy)
}
