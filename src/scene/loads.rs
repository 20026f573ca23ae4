//! Loads on a body, `[[body.load]]`: forces on nodes, traction or pressure on a part of the skin (surface mesh), force or
//! torque on a dynamic core (a rigid part that forces move), each times a factor that may change over time.

use glam::DVec3;

use super::body::bind;
use super::check::{self, Check, Problem, Under};
use super::keys::{Table, Value};
use super::{Bind, Core, Motion, reference};
use crate::Result;

/// A load on a body.
#[derive(Debug, Clone)]
pub struct Load {
    /// Name of the load; unique among the loads of its body.
    pub name: String,
    /// What acts, and on what.
    pub kind: LoadKind,
    /// Times (s, increasing) and factors between which the factor changes linearly; before the first and after the last
    /// it is constant. Empty: the factor is 1.
    pub factors: Vec<[f64; 2]>,
}

/// What a load is; vectors are in world axes.
#[derive(Debug, Clone)]
pub enum LoadKind {
    /// A force, N, shared equally by nodes of the layer.
    Force {
        /// The whole force.
        force: DVec3,
        /// The nodes.
        on: Bind,
    },
    /// A force per area at rest, Pa, on the triangles of the skin whose corners all lie in a region. Neither direction nor
    /// size change as the body deforms.
    Traction {
        /// The force per area.
        traction: DVec3,
        /// The region.
        on: Bind,
    },
    /// A pressure, Pa, against the skin's triangles whose corners all lie in a region. It follows the skin as it deforms.
    Pressure {
        /// The pressure; a negative one pulls.
        pressure: f64,
        /// The region.
        on: Bind,
    },
    /// A force (N) and a torque (N m) on the dynamic core with this name. The force acts at the centre of mass of its nodes;
    /// a core on a hinge takes no force, and of a torque only the part about the hinge moves it.
    Core {
        /// Name of the core.
        core: String,
        /// Force.
        force: DVec3,
        /// Torque.
        torque: DVec3,
    },
}

impl Load {
    /// A force, N, that nodes share equally.
    pub fn force(name: &str, force: [f64; 3], on: Bind) -> Load {
        Load { name: name.into(), kind: LoadKind::Force { force: force.into(), on }, factors: Vec::new() }
    }

    /// A force per area at rest, Pa, on the skin in a region.
    pub fn traction(name: &str, traction: [f64; 3], on: Bind) -> Load {
        Load { name: name.into(), kind: LoadKind::Traction { traction: traction.into(), on }, factors: Vec::new() }
    }

    /// A pressure, Pa, that follows the skin in a region.
    pub fn pressure(name: &str, pressure: f64, on: Bind) -> Load {
        Load { name: name.into(), kind: LoadKind::Pressure { pressure, on }, factors: Vec::new() }
    }

    /// A force, N, and a torque, N m, on a dynamic core.
    pub fn on_core(name: &str, core: &str, force: [f64; 3], torque: [f64; 3]) -> Load {
        let kind = LoadKind::Core { core: core.into(), force: force.into(), torque: torque.into() };
        Load { name: name.into(), kind, factors: Vec::new() }
    }

    /// The factor at a time, s.
    pub(crate) fn factor(&self, time: f64) -> f64 {
        let after = self.factors.partition_point(|[at, _]| *at <= time);
        match (self.factors.get(after.wrapping_sub(1)), self.factors.get(after)) {
            (None, None) => 1.0,
            (Some([_, only]), None) | (None, Some([_, only])) => *only,
            (Some([t0, a]), Some([t1, b])) => a + (b - a) * (time - t0) / (t1 - t0),
        }
    }

    /// Checks all values, and returns the first problem. `cores` are the cores of the body, `others` the loads before this
    /// one.
    pub(super) fn check(&self, cores: &[Core], others: &[Load]) -> Check {
        check::name(&self.name).under("name")?;
        if others.iter().any(|other| other.name == self.name) {
            let problem = format!("\"{}\" is taken by another load", self.name);
            return Err(Problem::of("name", problem, "choose another name"));
        }
        match &self.kind {
            LoadKind::Force { force, on } => {
                check::vector(*force).under("force")?;
                on.check().under("bind")?;
            }
            LoadKind::Traction { traction, on } => {
                check::vector(*traction).under("traction")?;
                check_skin(on)?;
            }
            LoadKind::Pressure { pressure, on } => {
                check::finite(*pressure).under("pressure")?;
                check_skin(on)?;
            }
            LoadKind::Core { core, force, torque } => {
                check::vector(*force).under("force")?;
                check::vector(*torque).under("torque")?;
                match cores.iter().find(|own| own.name == *core) {
                    None => {
                        let names: Vec<&str> = cores.iter().map(|core| core.name.as_str()).collect();
                        let remedy = if names.is_empty() {
                            "the body has no cores: give `bind`".into()
                        } else {
                            format!("the body's cores are {}", names.join(", "))
                        };
                        return Err(Problem::of("core", format!("there is no core \"{core}\""), remedy));
                    }
                    Some(own) if !matches!(own.motion, Motion::Dynamic) => {
                        let problem = format!("the core \"{core}\" is not moved by forces");
                        return Err(Problem::of("core", problem, "give it motion = \"dynamic\", or remove the load"));
                    }
                    Some(own) if own.hinge.is_some() && *force != DVec3::ZERO => {
                        let problem = format!("acts on the hinge of \"{core}\", which holds it");
                        return Err(Problem::of("force", problem, "give `torque`, or let the core move freely"));
                    }
                    Some(_) => {}
                }
            }
        }
        let mut before = None;
        for (k, [time, factor]) in self.factors.iter().enumerate() {
            let sound = || {
                check::finite(*time)?;
                check::finite(*factor)?;
                match before {
                    Some(before) if before >= *time => {
                        let problem = format!("time {time:?} does not come after {before:?}");
                        Err(Problem::new(problem, "give pairs of time and factor, with times that increase"))
                    }
                    _ => Ok(()),
                }
            };
            sound().under(format!("factors[{k}]"))?;
            before = Some(*time);
        }
        Ok(())
    }
}

/// Checks a region of the skin.
fn check_skin(on: &Bind) -> Check {
    match on {
        Bind::Box { .. } | Bind::Sphere { .. } | Bind::Nodes(_) | Bind::Group(_) | Bind::All => {
            on.check().under("bind")
        }
        Bind::Inset(_) | Bind::Capsule(_) => {
            Err(Problem::of("bind", "is no part of the skin", "give `box`, `sphere`, `nodes`, `group` or `all`"))
        }
    }
}

/// The loads of the body's table, in the order of the file. `only_core`: name of the core of a rigid body, on which its
/// loads act.
pub(super) fn read(body: &Table, only_core: Option<&str>) -> Result<Vec<Load>> {
    let Some(array) = body.get("load") else { return Ok(Vec::new()) };
    array.array()?.iter().map(|element| load(body, element, only_core)).collect()
}

fn load(body: &Table, element: &Value, only_core: Option<&str>) -> Result<Load> {
    let unnamed = element.table(&reference::LOAD)?;
    let name = unnamed.need("name")?.name()?;
    let table = unnamed.renamed(body.dotted(&format!("load.{name}")));
    let factors = |value: &Value| match &value.array()?[..] {
        [] => Err(value.error("is empty", "give pairs of time and factor, or leave it out")),
        pairs => pairs.iter().map(|pair| pair.array_of(Value::number)).collect(),
    };
    let factors = table.option("factors", factors)?.unwrap_or_default();
    let kind = table.exactly_one(&["force", "traction", "pressure", "torque"])?;
    let value = table.need(kind)?;
    if let Some(core) = only_core {
        for key in ["bind", "core"] {
            if table.has(key) {
                return Err(table.error(
                    key,
                    "has no meaning for a rigid body, on whose only core its loads act",
                    "remove it",
                ));
            }
        }
        return on_core(&table, kind, &value, core.into()).map(|kind| Load { name, kind, factors });
    }
    if table.exactly_one(&["bind", "core"])? == "core" {
        let core = table.need("core")?.name()?;
        return on_core(&table, kind, &value, core).map(|kind| Load { name, kind, factors });
    }
    let on = bind(&table.need("bind")?)?;
    let kind = match kind {
        "force" => LoadKind::Force { force: value.vector()?, on },
        "traction" => LoadKind::Traction { traction: value.vector()?, on },
        "pressure" => LoadKind::Pressure { pressure: value.number()?, on },
        _ => return Err(table.error("torque", "acts on a core", "give `core` in place of `bind`")),
    };
    Ok(Load { name, kind, factors })
}

/// A load on a core.
fn on_core(table: &Table, kind: &str, value: &Value, core: String) -> Result<LoadKind> {
    match kind {
        "force" => Ok(LoadKind::Core { core, force: value.vector()?, torque: DVec3::ZERO }),
        "torque" => Ok(LoadKind::Core { core, force: DVec3::ZERO, torque: value.vector()? }),
        other => Err(table.error(other, "acts on the skin, and not on a core", "give `force` or `torque`")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_are_interpolated_and_held_outside() {
        let factors = vec![[1.0, 2.0], [3.0, -2.0], [4.0, 5.0]];
        let load = Load { factors, ..Load::force("a", [0.0; 3], Bind::All) };
        let at = [(0.0, 2.0), (1.0, 2.0), (1.5, 1.0), (3.0, -2.0), (3.5, 1.5), (4.0, 5.0), (9.0, 5.0)];
        at.iter().for_each(|(time, want)| assert_eq!(load.factor(*time), *want, "at {time} s"));
        assert_eq!(Load::force("a", [0.0; 3], Bind::All).factor(7.0), 1.0);
    }
}
