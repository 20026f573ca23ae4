//! `skeleton = "human-skeleton.toml"` of a body: bones as capsules, each a core. Called by `body.rs`.
//!
//! A bone's nodes are those within its capsule; a node within several belongs to the bone whose axis is nearest relative
//! to the radius there, the first of equals. Coordinates are the body's file coordinates, before scale and pose.

use std::path::PathBuf;

use glam::DVec3;

use super::Capsule;
use super::keys::{Source, Table, Value, suggest};
use crate::{Error, Result};

/// A skeleton file.
#[derive(Debug, Clone, PartialEq)]
pub struct Skeleton {
    /// Where it was read from.
    pub file: PathBuf,
    /// Parents come before their children.
    pub bones: Vec<Bone>,
}

/// `[[bone]]`.
#[derive(Debug, Clone, PartialEq)]
pub struct Bone {
    /// Unique name: that of its core.
    pub name: String,
    /// The bone it hangs on, an index; `None` for a root.
    pub parent: Option<usize>,
    /// Where it turns about its parent.
    pub joint: DVec3,
    /// Its nodes are within.
    pub capsule: Capsule,
}

/// The skeleton of a file named in a scene. Errors name the skeleton file, its line and key.
pub(super) fn read(value: &Value) -> Result<Skeleton> {
    let file = value.file()?;
    let text = std::fs::read_to_string(&file)
        .map_err(|error| Error::input(&file, None, format!("cannot be read: {error}"), "give a skeleton file"))?;
    let source = Source { file: &file, text: &text };
    let document = source.parse()?;
    let root = Table::root(&source, &document, &["bone"])?;
    let mut bones: Vec<Bone> = Vec::new();
    for element in root.need("bone")?.array()? {
        bones.push(bone(&element, &bones)?);
    }
    if bones.is_empty() {
        return Err(root.error("bone", "there is none", "give at least one [[bone]]"));
    }
    Ok(Skeleton { file, bones })
}

fn bone(value: &Value, before: &[Bone]) -> Result<Bone> {
    let unnamed = value.table(&["name", "parent", "joint", "ends", "radius", "radii"])?;
    let name = unnamed.need("name")?.name()?;
    let table = unnamed.renamed(format!("bone.{name}"));
    if before.iter().any(|other| other.name == name) {
        return Err(table.error("name", format!("\"{name}\" is taken by another bone"), "choose another name"));
    }
    let parent = table.option("parent", |value| {
        let parent = value.text()?;
        before.iter().position(|other| other.name == parent).ok_or_else(|| {
            let names: Vec<&str> = before.iter().map(|other| other.name.as_str()).collect();
            let problem = format!("no bone \"{}\" comes before this one", parent.escape_debug());
            value.error(problem, format!("parents come first; {}", suggest(parent, &names)))
        })
    })?;
    let ends = table.need("ends")?.array_of(Value::vector)?;
    let radii = match table.exactly_one(&["radius", "radii"])? {
        "radius" => [table.need("radius")?.positive()?; 2],
        _ => table.need("radii")?.array_of(Value::positive)?,
    };
    let joint = table.need("joint")?.vector()?;
    Ok(Bone { name, parent, joint, capsule: Capsule { ends, radii } })
}
