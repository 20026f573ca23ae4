//! From a scene's body or tool to a prepared [`Body`]: files read, scale applied, nodes bound, everything checked.

use std::path::Path;

use glam::DVec3;

use super::model::{VERTICES, head};
use super::stuffing::{Options, stuff};
use super::{Body, Layer, Shape, embed, layer, mass, proxies, skin};
use crate::scene::obj::TriangleMesh;
use crate::scene::{self, Motion, Scene, Surface, ToolShape, gmsh, obj};
use crate::{Error, Result};

/// A closed skin fills at least this share of its bounding box's diagonal cubed; less is rounding.
const LEAST_VOLUME: f64 = 1e-12;
/// What to do about a core that holds nothing.
const ENLARGE: &str = "enlarge the region, or leave the core out for a free body";

/// Prepares a body of the scene. Errors name the scene's key, or the file.
pub fn body(body: &scene::Body, scene: &Scene) -> Result<Body> {
    let shape = match &body.shape {
        scene::Shape::Soft { surface, layer } => soft(&Keys { scene, body }, surface.as_ref(), layer)?,
        scene::Shape::Rigid { surface } => {
            let keys = Keys { scene, body };
            let mesh = scaled(keys.surface_mesh(surface)?, body.scale);
            rigid(mesh).map_err(|problem| keys.error("surface", problem, "give a closed surface with volume"))?
        }
        scene::Shape::Plane { normal, offset } => Shape::Plane { normal: *normal, offset: *offset },
    };
    Ok(Body {
        name: body.name.clone(),
        shape,
        position: body.position,
        orientation: body.orientation,
        velocity: body.velocity,
    })
}

/// Prepares the tool as a rigid body named "tool", in its own coordinates: a sphere's centre is the origin, a surface
/// keeps its file's coordinates (its centroid is in [`Shape::Rigid`]).
pub fn tool(tool: &scene::Tool, scene: &Scene) -> Result<Body> {
    let (key, mesh) = match &tool.shape {
        ToolShape::Sphere(radius) => {
            let (vertices, triangles) = super::sphere::icosphere(*radius);
            ("tool.sphere", TriangleMesh { vertices, triangles })
        }
        ToolShape::Surface(path) => ("tool.surface", scaled(read_solid(path)?, tool.scale)),
        ToolShape::Body(name) => {
            let problem = format!("body `{name}` as a tool is prepared as a body");
            return Err(Error::key(&scene.file, "tool.body", problem, "give `sphere` or `surface`"));
        }
    };
    let shape = rigid(mesh).map_err(|p| Error::key(&scene.file, key, p, "give a closed surface with volume"))?;
    Ok(Body {
        name: "tool".into(),
        shape,
        position: tool.position,
        orientation: tool.orientation,
        velocity: tool.velocity,
    })
}

/// Errors about keys of one body.
struct Keys<'a> {
    scene: &'a Scene,
    body: &'a scene::Body,
}

impl Keys<'_> {
    fn error(&self, key: &str, problem: impl Into<String>, remedy: impl Into<String>) -> Error {
        Error::key(&self.scene.file, format!("body.{}.{key}", self.body.name), problem, remedy)
    }

    /// Triangles of a surface in file coordinates.
    fn surface_mesh(&self, surface: &Surface) -> Result<TriangleMesh> {
        match surface {
            Surface::File(path) => read_solid(path),
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
fn rigid(mesh: TriangleMesh) -> std::result::Result<Shape, String> {
    let p = mass::properties(&mesh.vertices, &mesh.triangles);
    let low = mesh.vertices.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let diagonal = mesh.vertices.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max).distance(low);
    // Written so that a NaN is refused too.
    if p.volume.is_nan() || p.volume <= LEAST_VOLUME * diagonal.powi(3) {
        return Err(format!("the surface encloses a volume of {:.3e} m^3", p.volume));
    }
    let skin = skin::build(mesh.vertices, mesh.triangles);
    let proxies = proxies(&skin)?;
    Ok(Shape::Rigid { skin, proxies, volume: p.volume, centroid: p.centroid, inertia: p.inertia })
}

/// A layer that deforms and its skin.
fn soft(keys: &Keys, surface: Option<&Surface>, source: &scene::Layer) -> Result<Shape> {
    let material =
        keys.body.material.ok_or_else(|| keys.error("material", "missing", "a soft body needs a material"))?;
    let mesh = surface.map(|s| keys.surface_mesh(s)).transpose()?;
    let mut layer = file_layer(keys, mesh.as_ref(), source)?;
    let mesh = mesh.unwrap_or_else(|| {
        let (vertices, triangles, _) = layer::boundary(&layer);
        TriangleMesh { vertices, triangles }
    });
    bind_cores(keys, &mut layer, &mesh)?;
    let mesh = scaled(mesh, keys.body.scale);
    layer.nodes.iter_mut().for_each(|n| *n *= keys.body.scale);
    let embedding = embed(&mesh.vertices, &layer)
        .map_err(|problem| keys.error("layer", problem, "give a layer that surrounds the skin, in the same units"))?;
    let skin = skin::build(mesh.vertices, mesh.triangles);
    let proxies = proxies(&skin).map_err(|p| keys.error("surface", p, "give a closed surface with volume"))?;
    Ok(Shape::Soft { layer, material, embedding, skin, proxies })
}

/// The layer in file coordinates, nothing bound.
fn file_layer(keys: &Keys, mesh: Option<&TriangleMesh>, source: &scene::Layer) -> Result<Layer> {
    let layer = match (source, mesh) {
        (&scene::Layer::Cell { cell, grade, thickness }, Some(mesh)) => {
            let options = Options { cell, grade, thickness };
            let (layer, _) = stuff(&mesh.vertices, &mesh.triangles, &options).map_err(|problem| {
                keys.error("layer.cell", problem, "cells are in the file's coordinates, before scale")
            })?;
            layer
        }
        (scene::Layer::Cell { .. }, None) => {
            return Err(keys.error("layer.cell", "there is no surface to fill", "give `surface` too"));
        }
        (scene::Layer::File(path), _) => {
            let mesh = gmsh::read(path)?;
            let bound = vec![false; mesh.nodes.len()];
            Layer { nodes: mesh.nodes, tetrahedra: mesh.tetrahedra, bound }
        }
        (scene::Layer::Box { low, high, cells }, _) => {
            let count = cells.iter().map(|&c| f64::from(c)).product::<f64>() * 6.0;
            if !(1.0..=super::stuffing::MAX_TETRAHEDRA).contains(&count) {
                let problem = format!("{count:.0} tetrahedra; there are at least 6 and at most 4 million");
                return Err(keys.error("layer.cells", problem, "give other numbers of cells"));
            }
            layer::kuhn_box(*low, *high, *cells)
        }
    };
    used_nodes(keys, &layer)?;
    Ok(layer)
}

/// Every node belongs to a tetrahedron: one that does not has no mass, and its motion no meaning.
fn used_nodes(keys: &Keys, layer: &Layer) -> Result<()> {
    let mut used = vec![false; layer.nodes.len()];
    layer.tetrahedra.iter().flatten().for_each(|&n| used[n as usize] = true);
    match used.iter().position(|&u| !u) {
        None => Ok(()),
        Some(node) => {
            let count = used.iter().filter(|&&u| !u).count();
            let problem = format!("{count} nodes belong to no tetrahedron, the first is {node} (from 0)");
            Err(keys.error("layer", problem, "remove them from the file"))
        }
    }
}

/// Binds the nodes of each core, and checks that every core holds some and, with a core that holds the body in place,
/// that no part of the layer is left loose.
fn bind_cores(keys: &Keys, layer: &mut Layer, mesh: &TriangleMesh) -> Result<()> {
    for core in &keys.body.cores {
        let key = format!("core.{}.bind", core.name);
        let Some(bind) = &core.bind else {
            return Err(keys.error(&key, "missing", "say which nodes the core carries"));
        };
        let count = super::bind::bind(layer, (&mesh.vertices, &mesh.triangles), bind)
            .map_err(|(problem, remedy)| keys.error(&key, problem, remedy))?;
        if count == 0 {
            let held = match core.motion {
                Motion::Dynamic => "no node lies in the region: the core would hold nothing",
                _ => "no node lies in the region: nothing would hold the body",
            };
            return Err(keys.error(&key, held, ENLARGE));
        }
    }
    if keys.body.cores.iter().all(|c| matches!(c.motion, Motion::Dynamic)) {
        return Ok(());
    }
    match super::bind::unheld(layer) {
        None => Ok(()),
        Some((count, node)) => {
            let p = layer.nodes[node as usize];
            let problem = format!(
                "{count} nodes with nothing to hold them: the layer has a part without bound nodes, with node {node} at \
                 [{:.4}, {:.4}, {:.4}]",
                p.x, p.y, p.z
            );
            Err(keys.error("layer", problem, "join the parts, bind a node of each, or make them bodies of their own"))
        }
    }
}

/// A closed surface from a file; the loader has made the path complete.
fn read_solid(path: &Path) -> Result<TriangleMesh> {
    let mesh = obj::read(path)?;
    obj::check_solid(&mesh, path)?;
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
        assert!(rigid(TriangleMesh { vertices, triangles }).unwrap_err().contains("encloses a volume of -"));
    }
}
