//! Reads the elastic material of a soft body, `material`, and its material regions, `[[body.region]]`, which are parts
//! of the body with another material. A layer is the tetrahedral mesh of a soft body. The module `body.rs` calls this
//! one.

use glam::DVec3;

use super::body::{corners, sphere};
use super::check;
use super::keys::{Table, Value};
use super::reference;
use crate::Result;

/// An elastic material.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Material {
    /// Material law: how stress follows from strain.
    pub law: MaterialLaw,
    /// Young's modulus at small strain, Pa.
    pub young: f64,
    /// Poisson's ratio at small strain.
    pub poisson: f64,
    /// Density, kg/m^3.
    pub density: f64,
    /// Rayleigh damping coefficient alpha, which multiplies the mass matrix, 1/s.
    pub damping_mass: f64,
    /// Rayleigh damping coefficient beta, which multiplies the stiffness matrix, s.
    pub damping_stiffness: f64,
}

impl Material {
    /// A material with the corotational law and without damping. `young` is in Pa, `poisson` lies from -0.5 to below
    /// 0.5, `density` is in kg/m^3.
    pub fn new(young: f64, poisson: f64, density: f64) -> Material {
        Material { law: MaterialLaw::Corotational, young, poisson, density, damping_mass: 0.0, damping_stiffness: 0.0 }
    }
}

/// How stress follows from strain; both laws agree with Hooke's law at small strain.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MaterialLaw {
    /// Stress is linear in the strain that remains after a tetrahedron's rotation is removed.
    Corotational,
    /// The stable neo-Hookean law (Smith, de Goes and Kim 2018).
    NeoHookean,
}

impl MaterialLaw {
    /// Names that a scene file may give, with their values.
    const CHOICES: [(&str, MaterialLaw); 2] =
        [("corotational", MaterialLaw::Corotational), ("neo-hookean", MaterialLaw::NeoHookean)];
}

/// A material region, `[[body.region]]`: tetrahedra of a soft body whose material is not the body's.
#[derive(Debug, Clone, PartialEq)]
pub struct Region {
    /// Selects the tetrahedra. A tetrahedron that several regions select belongs to the first of them.
    pub place: Place,
    /// The region's material with all its values: those that the scene file leaves out are the body's.
    pub material: Material,
}

/// Selects the tetrahedra of a material region; boxes and spheres are in the coordinates of the mesh file, before scale
/// and pose.
#[derive(Debug, Clone, PartialEq)]
pub enum Place {
    /// The tetrahedra of a group in the layer's mesh file.
    Group(Group),
    /// The tetrahedra whose centroids lie in a box.
    Box {
        /// Least corner.
        low: DVec3,
        /// Greatest corner.
        high: DVec3,
    },
    /// The tetrahedra whose centroids lie in a sphere.
    Sphere {
        /// Centre.
        centre: DVec3,
        /// Radius, in the units of the mesh file.
        radius: f64,
    },
}

/// A group in a mesh file, as a scene names it.
#[derive(Debug, Clone, PartialEq)]
pub enum Group {
    /// The group's name.
    Name(String),
    /// The group's number.
    Number(i64),
}

/// Reads a material; values that the table leaves out are taken from `base`, if there is one.
pub(super) fn material(value: &Value, base: Option<&Material>) -> Result<Material> {
    let table = value.table(&reference::MATERIAL)?;
    let law = table.option("law", |value| value.one_of("law", &MaterialLaw::CHOICES))?;
    let (base_mass, base_stiffness) = base.map_or((0.0, 0.0), |base| (base.damping_mass, base.damping_stiffness));
    Ok(Material {
        law: law.unwrap_or(base.map_or(MaterialLaw::Corotational, |base| base.law)),
        young: number(&table, "young", base.map(|base| base.young), Value::positive)?,
        poisson: number(&table, "poisson", base.map(|base| base.poisson), |value| value.ruled(check::poisson))?,
        density: number(&table, "density", base.map(|base| base.density), Value::positive)?,
        damping_mass: table.or("damping_mass", base_mass, Value::not_negative)?,
        damping_stiffness: table.or("damping_stiffness", base_stiffness, Value::not_negative)?,
    })
}

/// Reads the number of a key. Where the key is absent, returns `otherwise`, or fails if `otherwise` is `None`.
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

/// Reads the material regions of a soft body. `from_file`: whether the body's layer is read from a mesh file, which may
/// have groups of tetrahedra.
pub(super) fn regions(body: &Table, base: &Material, from_file: bool) -> Result<Vec<Region>> {
    let Some(array) = body.get("region") else { return Ok(Vec::new()) };
    let region = |element: &Value| {
        let table = element.table(&reference::REGION)?;
        let place = match table.exactly_one(&["group", "box", "sphere"])? {
            "group" if !from_file => {
                let problem = "the layer is generated and has no groups";
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

/// Reads the name (a string) or the number of a group in a mesh file.
pub(super) fn group(value: &Value) -> Result<Group> {
    if value.is_text() {
        return value.text().map(|name| Group::Name(name.into()));
    }
    value.integer().map(Group::Number)
}
