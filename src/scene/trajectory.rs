//! Reads trajectories (poses over time): `[drive]`, which is the reference trajectory of the haptic device, and the
//! keys of kinematic (motion = "driven") rigid bodies and rigid cores (rigid bodies inside soft ones). Called by
//! `load.rs` and `body.rs`.
//!
//! A key is a time, a position and optionally a quaternion: 4 or 8 numbers. A trajectory may also be a CSV file with
//! one key per row; a first row without any number is a heading.

use std::path::Path;

use glam::{DQuat, DVec3};

use super::Key;
use super::check::{self, KEY_REMEDY};
use super::cursor::BYTE_ORDER_MARK;
use super::keys::Value;
use super::reference;
use crate::{Error, Result, files};

/// Reads the table `[drive]`: `keys = [[..], ..]` or `path = "file.csv"`.
pub(super) fn read(value: &Value) -> Result<Vec<Key>> {
    let table = value.table(&reference::DRIVE)?;
    if table.exactly_one(&["keys", "path"])? == "path" {
        return core_keys(&table.need("path")?);
    }
    listed(&table.need("keys")?)
}

/// Reads keys that the scene file itself lists: `[[t, x, y, z, ..], ..]`.
fn listed(keys: &Value) -> Result<Vec<Key>> {
    let mut result: Vec<Key> = Vec::new();
    for element in keys.array()? {
        let numbers: Vec<f64> = element.array()?.iter().map(Value::number).collect::<Result<_>>()?;
        let key = key(&numbers, result.last()).map_err(|problem| element.error(problem, KEY_REMEDY))?;
        result.push(key);
    }
    if result.is_empty() {
        return Err(keys.error("is empty", "give at least one key"));
    }
    Ok(result)
}

/// Reads the keys of a kinematic rigid body or core: a list in the scene file, or the name of a CSV file.
pub(super) fn core_keys(value: &Value) -> Result<Vec<Key>> {
    if value.is_text() { read_csv(&value.file()?) } else { listed(value) }
}

fn key(numbers: &[f64], before: Option<&Key>) -> std::result::Result<Key, String> {
    if let Some(bad) = numbers.iter().find(|x| check::finite(**x).is_err()) {
        return Err(format!("contains {bad:?}"));
    }
    let (time, position, orientation) = match *numbers {
        [t, x, y, z] => (t, DVec3::new(x, y, z), DQuat::IDENTITY),
        [t, x, y, z, qx, qy, qz, qw] => {
            let orientation = check::unit_quaternion([qx, qy, qz, qw]).map_err(|problem| problem.problem)?;
            (t, DVec3::new(x, y, z), orientation)
        }
        _ => return Err(format!("has {} numbers", numbers.len())),
    };
    check::key_time(time, before.map(|key| key.time)).map_err(|problem| problem.problem)?;
    Ok(Key { time, position, orientation })
}

/// Reads a CSV file with one key per line. A line that begins with `#` is a comment, and blanks and double quotes
/// around a number are ignored.
fn read_csv(path: &Path) -> Result<Vec<Key>> {
    let bytes = files::bytes(path, files::MOST_TEXT, KEY_REMEDY)?;
    // Some programs begin UTF-8 files with a byte order mark.
    let bytes = bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(&bytes);
    let mut keys: Vec<Key> = Vec::new();
    let mut is_first = true;
    for (line, row) in bytes.split(|byte| *byte == b'\n').enumerate() {
        let bad = |problem: String| Error::input(path, Some(line + 1), problem, KEY_REMEDY);
        let row = std::str::from_utf8(row).map_err(|_| bad("is not UTF-8".into()))?.trim();
        if row.is_empty() || row.starts_with('#') {
            continue;
        }
        let fields = || row.split(',').map(|field| field.trim().trim_matches('"').trim());
        if std::mem::take(&mut is_first) && fields().all(|field| field.parse::<f64>().is_err()) {
            continue;
        }
        let number =
            |field: &str| field.parse().map_err(|_| bad(format!("\"{}\" is not a number", field.escape_debug())));
        let numbers: Vec<f64> = fields().map(number).collect::<Result<_>>()?;
        keys.push(key(&numbers, keys.last()).map_err(bad)?);
    }
    if keys.is_empty() {
        return Err(Error::input(path, None, "contains no keys", KEY_REMEDY));
    }
    Ok(keys)
}
