//! Supports of a soft body, `[[body.support]]`: conditions on the displacements of some of the nodes of its layer (its
//! tetrahedral mesh), such as rollers and planes of symmetry. They hold the body from outside, whereas a core is a rigid
//! part inside it.

use glam::DVec3;

use super::body::bind;
use super::check::{self, Check, Problem, Under};
use super::keys::{Table, Value};
use super::{Bind, Core, reference};
use crate::Result;

/// Least length of a direction before it is normalised.
const SHORTEST: f64 = 1e-9;

/// A support of a soft body: nodes that may move only along a plane, along a line, or not at all.
#[derive(Debug, Clone)]
pub struct Support {
    /// Name of the support; unique among the cores and supports of its body.
    pub name: String,
    /// Where the nodes may move.
    pub constraint: Constraint,
    /// The nodes. Those that are attached to a core follow the core.
    pub bind: Bind,
}

/// What a support leaves to a node; directions are in the axes of the body's file, and stay where they are in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Constraint {
    /// The node moves in the plane with this unit normal: a roller, or a plane of symmetry.
    Plane(DVec3),
    /// The node moves along the line with this unit direction.
    Axis(DVec3),
    /// The node does not move.
    Point,
}

impl Support {
    /// A roller, or a plane of symmetry: the nodes move only in planes with this normal, which may have any length but
    /// zero.
    pub fn plane(name: &str, normal: [f64; 3], bind: Bind) -> Support {
        Support { name: name.into(), constraint: Constraint::Plane(DVec3::from(normal).normalize_or_zero()), bind }
    }

    /// A guide: the nodes move only along this direction, which may have any length but zero.
    pub fn axis(name: &str, direction: [f64; 3], bind: Bind) -> Support {
        Support { name: name.into(), constraint: Constraint::Axis(DVec3::from(direction).normalize_or_zero()), bind }
    }

    /// A pin: the nodes do not move.
    pub fn point(name: &str, bind: Bind) -> Support {
        Support { name: name.into(), constraint: Constraint::Point, bind }
    }

    /// Checks all values, and returns the first problem. `cores` are the cores of the body, `others` the supports before
    /// this one.
    pub(super) fn check(&self, cores: &[Core], others: &[Support]) -> Check {
        check::name(&self.name).under("name")?;
        let is_taken =
            cores.iter().any(|core| core.name == self.name) || others.iter().any(|other| other.name == self.name);
        if is_taken {
            let problem = format!("\"{}\" is taken by another core or support", self.name);
            return Err(Problem::of("name", problem, "choose another name"));
        }
        match self.constraint {
            Constraint::Plane(normal) => check::direction(normal).under("plane")?,
            Constraint::Axis(direction) => check::direction(direction).under("axis")?,
            Constraint::Point => {}
        }
        self.bind.check().under("bind")
    }
}

/// The supports of the body's table, in the order of the file. Whether their names are unique is checked with the body.
pub(super) fn read(body: &Table) -> Result<Vec<Support>> {
    let Some(array) = body.get("support") else { return Ok(Vec::new()) };
    array.array()?.iter().map(|element| support(body, element)).collect()
}

fn support(body: &Table, element: &Value) -> Result<Support> {
    let unnamed = element.table(&reference::SUPPORT)?;
    let name = unnamed.need("name")?.name()?;
    let table = unnamed.renamed(body.dotted(&format!("support.{name}")));
    let kind = table.exactly_one(&["plane", "axis", "point"])?;
    let value = table.need(kind)?;
    let constraint = match kind {
        "plane" => Constraint::Plane(unit(&value)?),
        "axis" => Constraint::Axis(unit(&value)?),
        _ => value.must_be_true().map(|()| Constraint::Point)?,
    };
    Ok(Support { name, constraint, bind: bind(&table.need("bind")?)? })
}

fn unit(value: &Value) -> Result<DVec3> {
    let direction = value.vector()?;
    match direction.length() < SHORTEST {
        true => Err(value.error("is zero", "give the three components of a direction")),
        false => Ok(direction.normalize()),
    }
}
