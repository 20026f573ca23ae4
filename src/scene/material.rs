//! What a soft body is made of: `material`, and `[[body.region]]` where it differs from place to place. Called by
//! `body.rs`.

use glam::DVec3;

use super::body::{corners, sphere};
use super::check;
use super::keys::{Table, Value};
use crate::Result;

/// Elastic material.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Material {
    /// Force by strain.
    pub law: Law,
    /// Young's modulus, Pa; of small strains.
    pub young: f64,
    /// Poisson's ratio; of small strains.
    pub poisson: f64,
    /// Density, kg/m^3.
    pub density: f64,
    /// Rayleigh damping alpha, 1/s.
    pub damping_mass: f64,
    /// Rayleigh damping beta, s.
    pub damping_stiffness: f64,
}

impl Material {
    /// A corotational material without damping: Young's modulus (Pa), Poisson's ratio (-0.5 to below 0.5), density (kg/m^3).
    pub fn new(young: f64, poisson: f64, density: f64) -> Material {
        Material { law: Law::Corotational, young, poisson, density, damping_mass: 0.0, damping_stiffness: 0.0 }
    }
}

/// How force follows from deformation; both laws are Hooke's at small strain.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Law {
    /// Linear in the strain that a tetrahedron has beside its rotation.
    Corotational,
    /// Stable neo-Hookean (Smith, de Goes and Kim 2018).
    NeoHookean,
}

impl Law {
    /// What a scene may ask for.
    const CHOICES: [(&str, Law); 2] = [("corotational", Law::Corotational), ("neo-hookean", Law::NeoHookean)];
}

/// `[[body.region]]`: tetrahedra of another material than the body's.
#[derive(Debug, Clone, PartialEq)]
pub struct Region {
    /// Which tetrahedra; of those that several regions name, the first has them.
    pub place: Place,
    /// Theirs, whole: what the region does not say is the body's.
    pub material: Material,
}

/// Which tetrahedra a region has; boxes and spheres in file coordinates, before scale and pose.
#[derive(Debug, Clone, PartialEq)]
pub enum Place {
    /// Those of a group of the layer's file.
    Group(Group),
    /// Those whose centroids lie in a box.
    Box {
        /// Least corner.
        low: DVec3,
        /// Greatest corner.
        high: DVec3,
    },
    /// Those whose centroids lie in a sphere.
    Sphere {
        /// Centre.
        centre: DVec3,
        /// Radius.
        radius: f64,
    },
}

/// A group of a mesh file, as a scene calls it.
#[derive(Debug, Clone, PartialEq)]
pub enum Group {
    /// By name.
    Name(String),
    /// By number.
    Number(i64),
}

/// A material; what the table leaves out is that of `base`, where there is one.
pub(super) fn material(value: &Value, base: Option<&Material>) -> Result<Material> {
    let table = value.table(&["law", "young", "poisson", "density", "damping_mass", "damping_stiffness"])?;
    let law = table.option("law", |value| value.one_of("law", &Law::CHOICES))?;
    let (base_mass, base_stiffness) = base.map_or((0.0, 0.0), |base| (base.damping_mass, base.damping_stiffness));
    Ok(Material {
        law: law.unwrap_or(base.map_or(Law::Corotational, |base| base.law)),
        young: number(&table, "young", base.map(|base| base.young), Value::positive)?,
        poisson: number(&table, "poisson", base.map(|base| base.poisson), |value| value.ruled(check::poisson))?,
        density: number(&table, "density", base.map(|base| base.density), Value::positive)?,
        damping_mass: table.or("damping_mass", base_mass, Value::not_negative)?,
        damping_stiffness: table.or("damping_stiffness", base_stiffness, Value::not_negative)?,
    })
}

/// A number that must be there where nothing else says it.
fn number<'a>(
    table: &Table<'a>,
    key: &str,
    otherwise: Option<f64>,
    read: impl Fn(&Value<'a>) -> Result<f64>,
) -> Result<f64> {
    match (table.get(key), otherwise) {
        (None, Some(otherwise)) => Ok(otherwise),
        _ => read(&table.need(key)?),
    }
}

/// The regions of a soft body; `from_file`: whether its layer is a file's, which may have groups.
pub(super) fn regions(body: &Table, base: &Material, from_file: bool) -> Result<Vec<Region>> {
    let Some(array) = body.get("region") else { return Ok(Vec::new()) };
    let region = |element: &Value| {
        let table = element.table(&["group", "box", "sphere", "material"])?;
        let place = match table.exactly_one(&["group", "box", "sphere"])? {
            "group" if !from_file => {
                let problem = "the layer is made here and has no groups";
                return Err(table.error("group", problem, "give `box` or `sphere`, or a layer from a file"));
            }
            "group" => Place::Group(group(&table.need("group")?)?),
            "box" => corners(&table.need("box")?).map(|(low, high)| Place::Box { low, high })?,
            _ => sphere(&table.need("sphere")?).map(|(centre, radius)| Place::Sphere { centre, radius })?,
        };
        Ok(Region { place, material: material(&table.need("material")?, Some(base))? })
    };
    array.array()?.iter().map(region).collect()
}

fn group(value: &Value) -> Result<Group> {
    if value.is_text() {
        return value.text().map(|name| Group::Name(name.into()));
    }
    value.integer().map(Group::Number)
}
