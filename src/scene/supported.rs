//! What the scene format knows and the engine does not do yet. Each feature is refused here and nowhere else, so that
//! whoever adds it deletes lines here.

use super::Scene;
use super::keys::{Table, Value};
use crate::{Error, Result};

/// Refuses a valid scene that asks for more than the engine does, naming the key.
pub(super) fn check(root: &Table, scene: &Scene) -> Result<()> {
    let of = |table: &str, key: &str| root.need(table)?.unchecked_table()?.need(key);
    if scene.haptics.device != "scripted" {
        return Err(refuse(&of("haptics", "device")?, "use \"scripted\""));
    }
    Ok(())
}

fn refuse(value: &Value, remedy: &str) -> Error {
    value.error("this version does not do that yet", remedy)
}
