//! From a scene's body or tool to a prepared [`Body`]: files read, scale applied, nodes bound, everything checked.

use std::cell::RefCell;
use std::path::Path;

use glam::DVec3;

use super::model::{VERTICES, head};
use super::{Body, BodyReport, FrameMotion, Layer, Shape, embed, layer, mass, proxies, repair, skin};
use crate::scene::obj::TriangleMesh;
use crate::scene::{self, Motion, Scene, Surface, ToolShape, tetrahedra};
use crate::{Error, Result};

/// A closed skin fills at least this share of its bounding box's diagonal cubed; less is rounding.
const LEAST_VOLUME: f64 = 1e-12;

/// Prepares a body of the scene. Errors name the scene's key, or the file.
pub fn body(body: &scene::Body, scene: &Scene) -> Result<Body> {
    let keys = Keys { scene, body, report: RefCell::default() };
    let shape = match &body.shape {
        scene::Shape::Soft { surface, layer } => soft(&keys, surface.as_ref(), layer)?,
        scene::Shape::Rigid { surface } => {
            let mesh = scaled(keys.surface_mesh(surface)?, body.scale);
            rigid(mesh, motion(&body.cores))
                .map_err(|problem| keys.error("surface", problem, "give a closed surface with volume"))?
        }
        scene::Shape::Plane { normal, offset } => Shape::Plane { normal: *normal, offset: *offset },
    };
    Ok(Body {
        name: body.name.clone(),
        shape,
        position: body.position,
        orientation: body.orientation,
        velocity: body.velocity,
        report: keys.report.into_inner(),
    })
}

/// Prepares the tool as a rigid body named "tool", in its own coordinates: a sphere's centre is the origin, a surface
/// keeps its file's coordinates (its centroid is in [`Shape::Rigid`]).
pub fn tool(tool: &scene::Tool, scene: &Scene) -> Result<Body> {
    let report = RefCell::default();
    let (key, mesh) = match &tool.shape {
        ToolShape::Sphere(radius) => {
            let (vertices, triangles) = super::sphere::icosphere(*radius);
            ("tool.sphere", TriangleMesh { vertices, triangles })
        }
        ToolShape::Surface(path) => ("tool.surface", scaled(read_surface(path, tool.repair, &report)?, tool.scale)),
        ToolShape::Body(name) => {
            let problem = format!("body `{name}` as a tool is prepared as a body");
            return Err(Error::key(&scene.file, "tool.body", problem, "give `sphere` or `surface`"));
        }
    };
    let shape = rigid(mesh, FrameMotion::Fixed)
        .map_err(|p| Error::key(&scene.file, key, p, "give a closed surface with volume"))?;
    Ok(Body {
        name: "tool".into(),
        shape,
        position: tool.position,
        orientation: tool.orientation,
        velocity: tool.velocity,
        report: report.into_inner(),
    })
}

/// Errors about keys of one body.
struct Keys<'a> {
    scene: &'a Scene,
    body: &'a scene::Body,
    report: RefCell<BodyReport>,
}

impl Keys<'_> {
    fn error(&self, key: &str, problem: impl Into<String>, remedy: impl Into<String>) -> Error {
        Error::key(&self.scene.file, format!("body.{}.{key}", self.body.name), problem, remedy)
    }

    /// Triangles of a surface in file coordinates.
    fn surface_mesh(&self, surface: &Surface) -> Result<TriangleMesh> {
        match surface {
            Surface::File(path) => read_surface(path, self.body.repair, &self.report),
            Surface::Head { vertices } if !VERTICES.contains(vertices) => {
                let remedy = format!("give {} to {}", VERTICES.start(), VERTICES.end());
                Err(self.error("surface.vertices", format!("a head of {vertices} vertices is not made"), remedy))
            }
            Surface::Head { vertices } => {
                let (vertices, triangles) = head(*vertices);
                Ok(TriangleMesh { vertices, triangles })
            }
        }
    }
}

/// A skin that rides on one frame; the problem where it has no volume.
fn rigid(mesh: TriangleMesh, motion: FrameMotion) -> std::result::Result<Shape, String> {
    // What fills the holes has mass, and is never touched.
    let (vertices, triangles) = repair::closed(&mesh.vertices, &mesh.triangles);
    let p = mass::properties(&vertices, &triangles);
    let low = mesh.vertices.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let diagonal = mesh.vertices.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max).distance(low);
    // Written so that a NaN is refused too.
    if p.volume.is_nan() || p.volume <= LEAST_VOLUME * diagonal.powi(3) {
        return Err(format!("the surface encloses a volume of {:.3e} m^3", p.volume));
    }
    let skin = skin::build(mesh.vertices, mesh.triangles);
    let proxies = proxies(&skin)?;
    Ok(Shape::Rigid { skin, proxies, volume: p.volume, centroid: p.centroid, inertia: p.inertia, motion })
}

/// How the one core of a rigid body moves.
fn motion(cores: &[scene::Core]) -> FrameMotion {
    match cores.first().map(|core| &core.motion) {
        Some(Motion::Driven(keys)) => FrameMotion::Driven(keys.clone()),
        _ => FrameMotion::Fixed,
    }
}

/// A layer that deforms and its skin.
fn soft(keys: &Keys, surface: Option<&Surface>, source: &scene::Layer) -> Result<Shape> {
    let material =
        keys.body.material.ok_or_else(|| keys.error("material", "missing", "a soft body needs a material"))?;
    let mesh = surface.map(|s| keys.surface_mesh(s)).transpose()?;
    let mut layer = file_layer(keys, mesh.as_ref(), source)?;
    let mesh = match mesh {
        Some(mesh) => mesh,
        None => boundary(keys, &layer, source)?,
    };
    let numbers = drop_unused(keys, &mut layer, source);
    let node_frames = super::cores::bind(keys.body, &mut layer, &numbers, &mesh, |key, problem, remedy| {
        keys.error(key, problem, remedy)
    })?;
    let mesh = scaled(mesh, keys.body.scale);
    layer.nodes.iter_mut().for_each(|n| *n *= keys.body.scale);
    let embedding = embed(&mesh.vertices, &layer)
        .map_err(|problem| keys.error("layer", problem, "give a layer that surrounds the skin, in the same units"))?;
    let skin = skin::build(mesh.vertices, mesh.triangles);
    let proxies = proxies(&skin).map_err(|p| keys.error("surface", p, "give a closed surface with volume"))?;
    let frames = super::cores::frames(keys.body, &layer, &node_frames, &material);
    Ok(Shape::Soft { layer, frames, node_frames, material, embedding, skin, proxies })
}

/// The layer's boundary as a surface. That of a file is repaired like any other: elements may overlap or be missing.
fn boundary(keys: &Keys, layer: &Layer, source: &scene::Layer) -> Result<TriangleMesh> {
    let (vertices, triangles, _) = layer::boundary(layer);
    let mesh = TriangleMesh { vertices, triangles };
    let scene::Layer::File(path) = source else { return Ok(mesh) };
    let (mesh, found) = repair::repair(mesh)
        .map_err(|refusal| keys.error("layer", format!("of its boundary, {}", refusal.problem), refusal.remedy))?;
    let mut report = keys.report.borrow_mut();
    let said = found.sentences().into_iter();
    report.notes.extend(said.map(|(_, text)| format!("{}: of the boundary, {text}", path.display())));
    report.repair = Some(found);
    Ok(mesh)
}

/// The layer in file coordinates, nothing bound.
fn file_layer(keys: &Keys, mesh: Option<&TriangleMesh>, source: &scene::Layer) -> Result<Layer> {
    let layer = match (source, mesh) {
        (scene::Layer::Cell(cell), Some(mesh)) => {
            // The inside must not run out through a hole.
            let (vertices, triangles) = repair::closed(&mesh.vertices, &mesh.triangles);
            super::lattice::lattice(&vertices, &triangles, *cell).map_err(|problem| {
                keys.error("layer.cell", problem, "cells are in the file's coordinates, before scale")
            })?
        }
        (scene::Layer::Cell(_), None) => {
            return Err(keys.error("layer.cell", "there is no surface to fill", "give `surface` too"));
        }
        (scene::Layer::File(path), _) => {
            let mesh = tetrahedra::read(path)?;
            keys.report.borrow_mut().notes.extend(mesh.notes.iter().map(|note| format!("{}: {note}", path.display())));
            let bound = vec![false; mesh.nodes.len()];
            Layer { nodes: mesh.nodes, tetrahedra: mesh.tetrahedra, bound }
        }
        (scene::Layer::Box { low, high, cells }, _) => {
            let count = cells.iter().map(|&c| f64::from(c)).product::<f64>() * 6.0;
            if !(1.0..=super::lattice::MAX_TETRAHEDRA).contains(&count) {
                let problem = format!("{count:.0} tetrahedra; there are at least 6 and at most 4 million");
                return Err(keys.error("layer.cells", problem, "give other numbers of cells"));
            }
            layer::kuhn_box(*low, *high, *cells)
        }
    };
    Ok(layer)
}

/// Leaves out nodes of no tetrahedron, which have no mass and whose motion has no meaning; returns the number in the
/// file of each that stays. The others keep their order, in the step and in what is written.
fn drop_unused(keys: &Keys, layer: &mut Layer, source: &scene::Layer) -> Vec<u32> {
    let before = layer.nodes.len();
    let numbers = layer::drop_unused(layer);
    let dropped = before - numbers.len();
    if let scene::Layer::File(path) = source
        && dropped > 0
    {
        let note = format!(
            "{}: {dropped} nodes of no tetrahedron left out; `nodes` of a core keep the file's numbers",
            path.display()
        );
        keys.report.borrow_mut().notes.push(note);
    }
    numbers
}

/// A surface from a file, fit to be a skin; the loader has made the path complete. Adds to the report.
fn read_surface(path: &Path, mends: bool, report: &RefCell<BodyReport>) -> Result<TriangleMesh> {
    let (mesh, found) = repair::read(path, mends)?;
    let mut report = report.borrow_mut();
    report.notes.extend(repair::notes(&found, path));
    report.repair = Some(found);
    Ok(mesh)
}

fn scaled(mut mesh: TriangleMesh, scale: f64) -> TriangleMesh {
    mesh.vertices.iter_mut().for_each(|v| *v *= scale);
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_surface_without_volume_is_refused() {
        let (vertices, mut triangles) = crate::prepare::sphere::icosphere(1.0);
        triangles.iter_mut().for_each(|t| t.swap(0, 1));
        assert!(
            rigid(TriangleMesh { vertices, triangles }, FrameMotion::Fixed)
                .unwrap_err()
                .contains("encloses a volume of -")
        );
    }
}
