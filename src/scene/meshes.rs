//! Meshes that a program passes in memory, each under a name: surfaces (of triangles) and layers (the tetrahedral
//! meshes of soft bodies). The readers of scenes and the module `crate::prepare` treat them like mesh files: a scene
//! has `surface = { mesh = "liver" }` instead of `surface = "liver.obj"`.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use glam::DVec3;

use super::cursor::{Cursor, LARGEST};
use super::tetrahedra::{self, Contents, Element, TetMesh};
use super::triangles::{self, TriangleMesh};
use super::triangulate::triangulate;
use crate::{Error, Result};

/// What the program can do about an invalid mesh; error messages show it.
const REMEDY: &str = "correct the arrays";

/// The surfaces and the layers that a program has passed, by name.
#[derive(Debug, Clone, Default)]
pub struct Meshes {
    surfaces: BTreeMap<String, Arc<TriangleMesh>>,
    layers: BTreeMap<String, Arc<TetMesh>>,
}

static NONE: Meshes = Meshes { surfaces: BTreeMap::new(), layers: BTreeMap::new() };

impl Meshes {
    /// An empty collection.
    pub fn none() -> &'static Meshes {
        &NONE
    }

    /// Adds a surface; it is treated like a mesh file with these vertices and triangles.
    pub fn add_surface(&mut self, name: &str, vertices: Vec<DVec3>, triangles: &[[u32; 3]]) -> Result<()> {
        check_name("surface", name, self.surfaces.contains_key(name))?;
        self.surfaces.insert(name.into(), Arc::new(surface(name, vertices, triangles)?));
        Ok(())
    }

    /// Adds a layer; it is treated like a mesh file with these nodes and these tetrahedra as elements.
    pub fn add_layer(&mut self, name: &str, nodes: Vec<DVec3>, tetrahedra: &[[u32; 4]]) -> Result<()> {
        check_name("layer", name, self.layers.contains_key(name))?;
        self.layers.insert(name.into(), Arc::new(layer(name, nodes, tetrahedra)?));
        Ok(())
    }

    /// The surface of this name; the error is the list of the existing names.
    pub(super) fn surface(&self, name: &str) -> std::result::Result<Arc<TriangleMesh>, Vec<String>> {
        self.surfaces.get(name).cloned().ok_or_else(|| self.surfaces.keys().cloned().collect())
    }

    /// The layer of this name; the error is the list of the existing names.
    pub(super) fn layer(&self, name: &str) -> std::result::Result<Arc<TetMesh>, Vec<String>> {
        self.layers.get(name).cloned().ok_or_else(|| self.layers.keys().cloned().collect())
    }
}

/// Checks a surface and makes its mesh; errors show `name`.
pub(super) fn surface(name: &str, vertices: Vec<DVec3>, triangles: &[[u32; 3]]) -> Result<TriangleMesh> {
    let wrong = |problem: String| wrong("surface", name, problem);
    check_points(&vertices).map_err(|problem| wrong(format!("vertex {problem}")))?;
    check_indices(vertices.len(), triangles).map_err(|problem| wrong(format!("triangle {problem}")))?;
    let mut mesh = TriangleMesh { vertices, triangles: Vec::with_capacity(triangles.len()) };
    triangles.iter().for_each(|corners| triangulate(&mesh.vertices, corners, &mut mesh.triangles));
    if triangles::has_area(&mesh) { Ok(mesh) } else { Err(wrong("no triangle has any area".into())) }
}

/// Checks the tetrahedra of a layer and makes their mesh; errors show `name`.
pub(super) fn layer(name: &str, nodes: Vec<DVec3>, tetrahedra: &[[u32; 4]]) -> Result<TetMesh> {
    let wrong = |problem: String| wrong("layer", name, problem);
    check_points(&nodes).map_err(|problem| wrong(format!("node {problem}")))?;
    check_indices(nodes.len(), tetrahedra).map_err(|problem| wrong(format!("tetrahedron {problem}")))?;
    let element =
        |(id, nodes): (usize, &[u32; 4])| Element { id: id as u64, mark: 0, nodes: nodes.map(u64::from), group: None };
    let contents = Contents {
        index: (0..nodes.len() as u32).map(|node| (node.into(), node)).collect(),
        nodes,
        elements: tetrahedra.iter().enumerate().map(element).collect(),
        ..Contents::default()
    };
    let label = label("layer", name);
    tetrahedra::settle(contents, &Cursor::of_arrays(Path::new(&label), REMEDY))
}

/// What error messages call a mesh, in place of a file; `kind` is "surface" or "layer".
fn label(kind: &str, name: &str) -> String {
    format!("{kind} \"{}\"", name.escape_debug())
}

fn wrong(kind: &str, name: &str, problem: String) -> Error {
    Error::input(Path::new(&label(kind, name)), None, problem, REMEDY)
}

fn check_name(kind: &str, name: &str, is_taken: bool) -> Result<()> {
    let problem = match (name.is_empty(), is_taken) {
        (false, false) => return Ok(()),
        (true, _) => "the name is empty",
        (_, true) => "the name is already taken",
    };
    Err(Error::input(Path::new(&label(kind, name)), None, problem, "give another name"))
}

/// Checks the coordinates of a mesh's points. The caller puts "vertex" or "node" before the error's text.
fn check_points(points: &[DVec3]) -> std::result::Result<(), String> {
    // Other modules use the greatest index of 32 bits to mean "none", so no point may have this index.
    if points.len() >= u32::MAX as usize {
        return Err(format!("count is {}, but must be below {}", points.len(), u32::MAX));
    }
    let is_wrong = |x: &f64| !x.is_finite() || x.abs() > LARGEST;
    let bad = points.iter().enumerate().find_map(|(k, point)| Some((k, *point.as_ref().iter().find(|x| is_wrong(x))?)));
    match bad {
        Some((k, x)) => Err(format!("{k} has the coordinate {x:?}, which is not a finite number below 1e30")),
        None if points.is_empty() => Err("count is 0".into()),
        None => Ok(()),
    }
}

/// Checks the indices of a mesh's triangles or tetrahedra; `count` is the number of points that the mesh has. The
/// caller puts "triangle" or "tetrahedron" before the error's text.
fn check_indices<const N: usize>(count: usize, elements: &[[u32; N]]) -> std::result::Result<(), String> {
    let bad = elements.iter().enumerate().find_map(|(k, e)| Some((k, e.iter().find(|&&i| i as usize >= count)?)));
    match bad {
        Some((k, index)) => Err(format!("{k} names point {index}, but there are {count} points, counted from 0")),
        None if elements.is_empty() => Err("count is 0".into()),
        None => Ok(()),
    }
}
