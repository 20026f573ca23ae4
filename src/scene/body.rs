//! Reads and checks the bodies of a scene file, `[[body]]` with `[[body.core]]`; called by `load.rs`. A soft body has a
//! skin (its triangle surface), a layer (its tetrahedral mesh) and cores (rigid parts to which nodes of the layer are
//! attached); a bone of its skeleton is a core too. A core is fixed, driven (follows a given trajectory) or dynamic
//! (forces move it). A *key* is the name of a value in a scene file; the key `keys` holds the trajectory.

use std::path::PathBuf;

use glam::{DQuat, DVec3};

use super::check;
use super::keys::{Table, Value, suggest};
use super::material::{group, material, regions};
use super::meshes::Meshes;
use super::reference;
use super::tetrahedra::EXTENSIONS;
use super::units::UNITS;
use super::{
    Bind, Body, Core, Hinge, Layer, Model, Motion, SceneBuilder, Shape, Skeleton, Surface, joint, loads, skeleton,
    support, trajectory, triangles,
};
use crate::Result;
use crate::files::extension;

/// Keys that a body which is a plane may have.
const PLANE_KEYS: [&str; 3] = ["name", "plane", "collides"];
/// Keys that describe the core of a rigid body, in the body's own table.
const RIGID_KEYS: [&str; 4] = ["motion", "keys", "mass", "hinge"];
/// Keys that only a dynamic core may have.
const DYNAMIC_KEYS: [&str; 2] = ["mass", "hinge"];
/// Greatest number of collision proxies (convex hulls) of a body: the broad phase tests all pairs of two bodies'
/// proxies.
pub const MOST_HULLS: u32 = 256;
/// Least length of a plane's normal or a hinge's axis before it is normalised.
const SHORTEST_NORMAL: f64 = 1e-9;

/// The volume over which a soft body's dilatation (volumetric strain) is taken to be constant.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Dilatation {
    /// A single tetrahedron. Linear tetrahedra show volumetric locking as Poisson's ratio nears one half.
    #[default]
    Element,
    /// A patch of neighbouring tetrahedra, which share their mean dilatation (F-bar) against volumetric locking; see
    /// [`crate::prepare::patch`].
    Patch,
}

impl Dilatation {
    /// Names that a scene file may give, with their values.
    pub const CHOICES: [(&str, Dilatation); 2] = [("element", Dilatation::Element), ("patch", Dilatation::Patch)];
}

/// Adds all bodies of the scene file, in the order of the file; their names must be unique and not `tool`.
pub(super) fn read(root: &Table, builder: &mut SceneBuilder) -> Result<()> {
    let Some(array) = root.get("body") else { return Ok(()) };
    for element in array.array()? {
        let body = body(&element)?;
        let table = element.unchecked_table()?;
        let path = format!("body.{}", body.name);
        builder.put_body(body).map_err(|problem| match problem.key.as_str() {
            "name" => table.wrong(problem),
            _ => table.renamed(path).wrong(problem),
        })?;
    }
    Ok(())
}

fn body(value: &Value) -> Result<Body> {
    let unnamed = value.unchecked_table()?;
    unnamed.only(&reference::BODY)?;
    let name = unnamed.need("name")?.name()?;
    let table = unnamed.renamed(format!("body.{name}"));
    let shape = shape(&table)?;
    let skeleton = table.option("skeleton", skeleton::read)?;
    let cores = match shape {
        Shape::Soft { .. } => soft_cores(&table, skeleton.as_ref())?,
        Shape::Rigid { .. } => vec![rigid_core(&table, &name)?],
        Shape::Plane { .. } => Vec::new(),
    };
    let only_core = matches!(shape, Shape::Rigid { .. }).then(|| name.clone());
    let joints = joint::read(&table, skeleton.as_ref(), &cores)?;
    if !matches!(
        shape,
        Shape::Soft { surface: Some(Surface::File(_) | Surface::Mesh(_)), .. }
            | Shape::Rigid { surface: Surface::File(_) | Surface::Mesh(_) }
    ) {
        refuse(&table, &["repair"], "has no meaning without a surface from a file")?;
    }
    let material = table.option("material", |value| material(value, None))?;
    let regions = match (&shape, &material) {
        (Shape::Soft { layer, .. }, Some(base)) => regions(&table, base, matches!(layer, Layer::File(_)))?,
        _ => Vec::new(),
    };
    Ok(Body {
        name,
        shape,
        hulls: table.option("hulls", |value| value.whole(1, MOST_HULLS))?,
        units: table.option("units", |value| value.one_of("unit of length", &UNITS))?,
        scale: table.or("scale", 1.0, Value::positive)?,
        position: table.or("position", DVec3::ZERO, Value::vector)?,
        orientation: table.or("orientation", DQuat::IDENTITY, Value::quaternion)?,
        velocity: table.or("velocity", DVec3::ZERO, Value::vector)?,
        material,
        regions,
        dilatation: table
            .or("dilatation", Dilatation::Element, |value| value.one_of("dilatation", &Dilatation::CHOICES))?,
        collides: table.option("collides", |value| value.array()?.iter().map(Value::name).collect())?,
        cores,
        joints,
        supports: support::read(&table)?,
        loads: loads::read(&table, only_core.as_deref())?,
        reactions: table.option("reactions", Value::truth)?,
        repair: table.or("repair", true, Value::truth)?,
        skeleton,
    })
}

/// Fails if the table has any of `keys`; the error names the first of them and says `why` it is refused.
fn refuse(table: &Table, keys: &[&str], why: &str) -> Result<()> {
    match keys.iter().find(|key| table.has(key)) {
        Some(key) => Err(table.error(key, why, "remove it")),
        None => Ok(()),
    }
}

fn shape(table: &Table) -> Result<Shape> {
    if let Some(plane) = table.get("plane") {
        let others: Vec<&str> = reference::BODY.names().into_iter().filter(|key| !PLANE_KEYS.contains(key)).collect();
        refuse(table, &others, "has no meaning for a plane, which is rigid and fixed where `plane` puts it")?;
        let [x, y, z, d] = plane.array_of(Value::number)?;
        let normal = DVec3::new(x, y, z);
        let length = normal.length();
        if length < SHORTEST_NORMAL {
            return Err(plane.error("the normal is zero", "give nx, ny, nz, d with a normal that is not zero"));
        }
        return Ok(Shape::Plane { normal: normal / length, offset: d / length });
    }
    let surface = table.option("surface", surface)?;
    let layer = table.option("layer", layer)?;
    match (surface, layer) {
        (surface, Some(layer)) => {
            refuse(table, &RIGID_KEYS, "belongs to a rigid body, and this one is soft")?;
            Ok(Shape::Soft { surface, layer })
        }
        (Some(surface), None) => {
            if table.has("material") {
                let remedy = "add a `layer` for a soft body, or remove `material` for a rigid one";
                return Err(table.error("material", "a rigid body has none", remedy));
            }
            refuse(table, &["dilatation"], "belongs to a soft body, and this one is rigid")?;
            refuse(table, &["support", "reactions"], "belongs to a soft body, and this one is rigid")?;
            let why = "a rigid body has no [[body.core]]; its own keys are motion, keys, mass and hinge";
            refuse(table, &["core", "joint", "skeleton", "bones"], why)?;
            refuse(table, &["region"], "has no meaning for a rigid body, which has no material")?;
            Ok(Shape::Rigid { surface })
        }
        (None, None) => {
            let remedy = "give a layer (soft), a surface alone (rigid), or a plane";
            Err(table.error("surface", "the body has neither surface, layer nor plane", remedy))
        }
    }
}

/// The path of a mesh file with one of these extensions; the error names any other extension.
pub(super) fn mesh_file(value: &Value, extensions: &[&str]) -> Result<PathBuf> {
    let path = value.file()?;
    let extension = extension(&path);
    if extensions.contains(&extension.as_str()) {
        return Ok(path);
    }
    Err(value
        .error(format!("files of type .{extension} are not supported"), format!("give .{}", extensions.join(", ."))))
}

fn surface(value: &Value) -> Result<Surface> {
    if value.is_text() || names_mesh(value) {
        return given_surface(value);
    }
    let table = value.table(&reference::MODEL)?;
    let model = table.need("model")?.one_of("model", &Model::ALL.map(|model| (model.name(), model)))?;
    let (least, most) = (*model.vertices().start() as u32, *model.vertices().end() as u32);
    let vertices = table.or("vertices", model.default_vertices() as u32, |value| value.whole(least, most))?;
    Ok(Surface::Model { model, vertices: vertices as usize })
}

/// A surface that the engine does not generate: from a file, or passed in memory.
pub(super) fn given_surface(value: &Value) -> Result<Surface> {
    if value.is_text() {
        return mesh_file(value, &triangles::EXTENSIONS).map(Surface::File);
    }
    value.table(&reference::MESH)?.need("mesh")?.mesh(Meshes::surface).map(Surface::Mesh)
}

/// Whether the value is a table `{ mesh = ".." }`, which names a mesh passed in memory.
fn names_mesh(value: &Value) -> bool {
    value.unchecked_table().is_ok_and(|table| table.has("mesh"))
}

fn layer(value: &Value) -> Result<Layer> {
    if value.is_text() {
        return mesh_file(value, &EXTENSIONS).map(Layer::File);
    }
    if names_mesh(value) {
        return value.table(&reference::MESH)?.need("mesh")?.mesh(Meshes::layer).map(Layer::Mesh);
    }
    let table = value.table(&reference::LAYER)?;
    let kind = table.exactly_one(&["cell", "across", "box"])?;
    if kind != "box" {
        refuse(&table, &["cells"], "belongs to a box")?;
        let value = table.need(kind)?;
        let (grade, thickness) = (table.or("grade", 1, grade)?, table.option("thickness", Value::positive)?);
        return Ok(match kind {
            "cell" => Layer::Cell { cell: value.positive()?, grade, thickness },
            _ => Layer::Across { cells: value.whole(1, check::MOST_ACROSS)?, grade, thickness },
        });
    }
    refuse(&table, &["grade", "thickness"], "belongs to cells that fill a surface")?;
    let (low, high) = corners(&table.need("box")?)?;
    let counts = table.need("cells")?;
    let cells: [u32; 3] = counts.array_of(|value| value.whole(1, check::MOST_CELLS))?;
    counts.held(Layer::Box { low, high, cells }, check::box_cells(cells))
}

/// Edge of the largest cells, deep inside a layer, as a multiple of the edge of the cells at the surface.
fn grade(value: &Value) -> Result<u32> {
    let grade = value.whole(1, 8)?;
    value.held(grade, check::grade(grade))
}

/// Two corners of a box, `[[x, y, z], [x, y, z]]`; the first is below the second on every axis.
pub(super) fn corners(value: &Value) -> Result<(DVec3, DVec3)> {
    let [low, high] = value.array_of(Value::vector)?;
    value.held((low, high), check::corners(low, high))
}

/// Centre and radius of a sphere, `[x, y, z, radius]`.
pub(super) fn sphere(value: &Value) -> Result<(DVec3, f64)> {
    let [x, y, z, radius] = value.array_of(Value::number)?;
    value.held((DVec3::new(x, y, z), radius), check::radius(radius))
}

/// The cores of a soft body: first a core for each bone, whose motion `bones` gives unless a `[[body.core]]` with the
/// bone's name does; then the other cores.
fn soft_cores(table: &Table, skeleton: Option<&Skeleton>) -> Result<Vec<Core>> {
    let bones = skeleton.map_or(&[][..], |skeleton| &skeleton.bones);
    if bones.is_empty() {
        refuse(table, &["bones"], "gives the motion of the bones of a `skeleton`, but the body has no `skeleton`")?;
    }
    let motions = [("fixed", false), ("dynamic", true)];
    let usual = match table.or("bones", false, |value| value.one_of("motion of all bones", &motions))? {
        true => Motion::Dynamic,
        false => Motion::Fixed,
    };
    let bone_core = |bone: &skeleton::Bone| {
        let bind = Some(Bind::Capsule(bone.capsule));
        Core { name: bone.name.clone(), motion: usual.clone(), bind, mass: None, hinge: None }
    };
    let mut cores: Vec<Core> = bones.iter().map(bone_core).collect();
    let mut named: Vec<String> = Vec::new();
    let Some(array) = table.get("core") else { return Ok(cores) };
    for element in array.array()? {
        let unnamed = element.table(&reference::CORE)?;
        let name = unnamed.need("name")?.name()?;
        let core = unnamed.renamed(table.dotted(&format!("core.{name}")));
        if named.contains(&name) {
            return Err(core.error("name", format!("\"{name}\" is taken by another core"), "choose another name"));
        }
        named.push(name.clone());
        let motion = motion(&core)?;
        let (mass, hinge) = dynamic_keys(&core, &motion)?;
        if let Some(bone) = cores[..bones.len()].iter_mut().find(|bone| bone.name == name) {
            refuse(&core, &["bind"], "the core is a bone: the skeleton determines its attached nodes")?;
            (bone.motion, bone.mass, bone.hinge) = (motion, mass, hinge);
            continue;
        }
        if !bones.is_empty() && !core.has("bind") {
            let names: Vec<&str> = bones.iter().map(|bone| bone.name.as_str()).collect();
            let problem = format!("\"{name}\" is not a bone and has no `bind`");
            return Err(core.error("name", problem, format!("{}, or add `bind`", suggest(&name, &names))));
        }
        let bind = Some(bind(&core.need("bind")?)?);
        cores.push(Core { name, motion, bind, mass, hinge });
    }
    Ok(cores)
}

/// Mass and hinge of a core. They are refused for a core that is not dynamic, since nothing would use them.
fn dynamic_keys(table: &Table, motion: &Motion) -> Result<(Option<f64>, Option<Hinge>)> {
    if !matches!(motion, Motion::Dynamic) {
        refuse(table, &DYNAMIC_KEYS, "belongs to motion = \"dynamic\"")?;
    }
    Ok((table.option("mass", Value::positive)?, table.option("hinge", hinge)?))
}

fn hinge(value: &Value) -> Result<Hinge> {
    let table = value.table(&reference::HINGE)?;
    let axis = table.need("axis")?;
    let direction = axis.vector()?;
    if direction.length() < SHORTEST_NORMAL {
        return Err(axis.error("is zero", "give the direction of the line about which the core rotates"));
    }
    Ok(Hinge { point: table.need("point")?.vector()?, axis: direction.normalize() })
}

/// The only core of a rigid body; it has the body's name.
fn rigid_core(table: &Table, name: &str) -> Result<Core> {
    let motion = motion(table)?;
    let (mass, hinge) = dynamic_keys(table, &motion)?;
    if !matches!(motion, Motion::Dynamic) {
        refuse(table, &["velocity"], "has no meaning for a rigid body that is not dynamic")?;
    }
    Ok(Core { name: name.into(), motion, bind: None, mass, hinge })
}

fn motion(table: &Table) -> Result<Motion> {
    let motion = match table.get("motion") {
        None => "fixed",
        Some(value) => match value.text()? {
            known @ ("fixed" | "driven" | "dynamic") => known,
            other => {
                let remedy = "give \"fixed\", \"driven\" or \"dynamic\"";
                return Err(value.error(format!("is \"{other}\""), remedy));
            }
        },
    };
    if motion == "driven" {
        return trajectory::core_keys(&table.need("keys")?).map(Motion::Kinematic);
    }
    refuse(table, &["keys"], "belongs to motion = \"driven\"")?;
    Ok(if motion == "dynamic" { Motion::Dynamic } else { Motion::Fixed })
}

/// The nodes of a core, of a support or of a load.
pub(super) fn bind(value: &Value) -> Result<Bind> {
    let table = value.table(&reference::BIND)?;
    let kind = table.exactly_one(&reference::BIND.names())?;
    let value = table.need(kind)?;
    match kind {
        "inset" => value.not_negative().map(Bind::Inset),
        "box" => corners(&value).map(|(low, high)| Bind::Box { low, high }),
        "sphere" => sphere(&value).map(|(centre, radius)| Bind::Sphere { centre, radius }),
        "group" => group(&value).map(Bind::Group),
        "nodes" => {
            let nodes: Vec<u32> =
                value.array()?.iter().map(|node| node.whole(0, u32::MAX - 1)).collect::<Result<_>>()?;
            if nodes.is_empty() {
                return Err(value.error("is empty", "name at least one node (zero-based, file order)"));
            }
            Ok(Bind::Nodes(nodes))
        }
        _ => value.must_be_true().map(|()| Bind::All),
    }
}
