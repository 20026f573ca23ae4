//! From a scene's body or tool to a prepared [`Body`]: files read, scale applied, nodes bound, everything checked.

use std::path::Path;

use glam::DVec3;

use super::model::{VERTICES, head};
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
        (scene::Layer::Cell(cell), Some(mesh)) => super::lattice::lattice(&mesh.vertices, &mesh.triangles, *cell)
            .map_err(|problem| {
                keys.error("layer.cell", problem, "cells are in the file's coordinates, before scale")
            })?,
        (scene::Layer::Cell(_), None) => {
            return Err(keys.error("layer.cell", "there is no surface to fill", "give `surface` too"));
        }
        (scene::Layer::File(path), _) => {
            let mesh = gmsh::read(path)?;
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
    use crate::prepare::{embed, tests::meshes};
    use crate::scene::{Bind, Contact, Core, Haptics, Material, Preconditioner, Solver, Step, Tool};
    use glam::DQuat;

    fn scene(shape: scene::Shape, cores: &[Bind]) -> Scene {
        let core = |(i, bind): (usize, &Bind)| Core {
            name: format!("core{i}"),
            motion: Motion::Fixed,
            bind: Some(bind.clone()),
            mass: None,
        };
        let body = scene::Body {
            name: "thing".into(),
            shape,
            scale: 2.0,
            position: DVec3::X,
            orientation: DQuat::IDENTITY,
            velocity: DVec3::ZERO,
            material: Some(Material {
                young: 2e4,
                poisson: 0.45,
                density: 1000.0,
                damping_mass: 0.0,
                damping_stiffness: 0.0,
            }),
            collides: None,
            cores: cores.iter().enumerate().map(core).collect(),
        };
        Scene {
            file: "scene.toml".into(),
            step: Step { dt: 0.001, gravity: DVec3::ZERO, newton: 1 },
            solver: Solver { tolerance: 1e-5, max_iterations: 200, preconditioner: Preconditioner::Auto },
            contact: Contact {
                stiffness: None,
                damping: None,
                friction: 0.0,
                friction_speed: 0.001,
                texel: None,
                depth_limit: 0.02,
            },
            bodies: vec![body],
            tool: None,
            coupling: None,
            drive: Vec::new(),
            haptics: Haptics { device: "scripted".into(), rate: 1000.0, max_force: None },
            probes: Vec::new(),
        }
    }

    fn cube() -> scene::Shape {
        let layer = scene::Layer::Box { low: DVec3::ZERO, high: DVec3::ONE, cells: [2, 2, 2] };
        scene::Shape::Soft { surface: None, layer }
    }

    fn prepared(scene: &Scene) -> Result<Body> {
        body(&scene.bodies[0], scene)
    }

    #[test]
    fn a_box_is_bound_in_file_coordinates_and_scaled() {
        let face = Bind::Box { low: DVec3::ZERO, high: DVec3::new(0.0, 1.0, 1.0) };
        let body = prepared(&scene(cube(), &[face])).unwrap();
        let Shape::Soft { layer, embedding, skin, proxies, .. } = body.shape else { panic!("not soft") };
        assert_eq!(layer.nodes[26], DVec3::splat(2.0));
        assert_eq!(layer.bound.iter().filter(|&&b| b).count(), 9);
        assert!((0..27).all(|n| layer.bound[n] == (layer.nodes[n].x == 0.0)));
        assert_eq!((skin.vertices.len(), proxies.len()), (26, 1));
        assert!(embedding.iter().all(|e| e.weights.contains(&1.0)));
        assert_eq!(body.position, DVec3::X);
    }

    #[test]
    fn cores_that_hold_nothing_and_bad_nodes_are_refused_by_name() {
        let nowhere = Bind::Sphere { centre: DVec3::splat(9.0), radius: 0.1 };
        let error = prepared(&scene(cube(), &[Bind::All, nowhere])).unwrap_err().to_string();
        assert!(error.contains("`body.thing.core.core1.bind`") && error.contains("nothing would hold"), "{error}");
        let error = prepared(&scene(cube(), &[Bind::Nodes(vec![27])])).unwrap_err().to_string();
        assert!(error.contains("node 27 does not exist, the layer has 27"), "{error}");
        assert!(prepared(&scene(cube(), &[])).is_ok());
    }

    #[test]
    fn cells_out_of_range_are_refused_by_name() {
        let layer = scene::Layer::Box { low: DVec3::ZERO, high: DVec3::ONE, cells: [200, 200, 200] };
        let error = prepared(&scene(scene::Shape::Soft { surface: None, layer }, &[])).unwrap_err().to_string();
        assert!(error.contains("`body.thing.layer.cells`") && error.contains("48000000"), "{error}");
        let layer = scene::Layer::Cell(3.0);
        let surface = Some(Surface::Head { vertices: 3000 });
        let error = prepared(&scene(scene::Shape::Soft { surface, layer }, &[])).unwrap_err().to_string();
        assert!(error.contains("`body.thing.layer.cell`") && error.contains("smaller than one cell"), "{error}");
    }

    #[test]
    fn parts_with_nothing_to_hold_them_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("two.msh");
        let nodes = "1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n5 9 0 0\n6 10 0 0\n7 9 1 0\n8 9 0 1\n";
        let elements = "1 4 2 0 0 1 2 3 4\n2 4 2 0 0 5 6 7 8\n";
        let text = format!(
            "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n8\n{nodes}$EndNodes\n$Elements\n2\n{elements}$EndElements\n"
        );
        std::fs::write(&path, text).unwrap();
        let shape = scene::Shape::Soft { surface: None, layer: scene::Layer::File(path) };
        let error = prepared(&scene(shape.clone(), &[Bind::Nodes(vec![1])])).unwrap_err().to_string();
        assert!(error.contains("4 nodes with nothing to hold them") && error.contains("node 4"), "{error}");
        assert!(prepared(&scene(shape, &[Bind::Nodes(vec![1, 7])])).is_ok());
    }

    #[test]
    fn the_sphere_tool_is_a_ball_and_a_tool_body_is_not_made_here() {
        let scene = scene(cube(), &[]);
        let mut tool = Tool {
            shape: ToolShape::Sphere(0.01),
            mass: 0.05,
            position: DVec3::Y,
            orientation: DQuat::IDENTITY,
            velocity: DVec3::ZERO,
            scale: 1.0,
        };
        let Shape::Rigid { skin, proxies, centroid, .. } = super::tool(&tool, &scene).unwrap().shape else {
            panic!("not rigid")
        };
        assert!(skin.vertices.len() >= 2500 && proxies.len() == 1 && centroid.length() < 1e-15);
        tool.shape = ToolShape::Body("thing".into());
        assert!(super::tool(&tool, &scene).unwrap_err().to_string().contains("`tool.body`"));
    }

    #[test]
    fn a_surface_without_volume_is_refused() {
        let (vertices, mut triangles) = crate::prepare::sphere::icosphere(1.0);
        triangles.iter_mut().for_each(|t| t.swap(0, 1));
        assert!(rigid(TriangleMesh { vertices, triangles }).unwrap_err().contains("encloses a volume of -"));
    }

    #[test]
    fn the_real_head_is_prepared_with_a_core() {
        let Some(folder) = meshes("the real head") else { return };
        let surface = Some(Surface::File(folder.join("surf/head.obj")));
        let shape = scene::Shape::Soft { surface, layer: scene::Layer::Cell(0.012) };
        let start = std::time::Instant::now();
        let body = prepared(&scene(shape, &[Bind::Inset(0.03)])).unwrap();
        println!("head in {:.1?}", start.elapsed());
        let Shape::Soft { layer, embedding, skin, .. } = body.shape else { panic!("not soft") };
        let bound = layer.bound.iter().filter(|&&b| b).count();
        assert!(bound > layer.nodes.len() / 10 && bound < layer.nodes.len() / 2, "{bound} of {}", layer.nodes.len());
        assert_eq!(embedding.len(), skin.vertices.len());
        assert!(embed::extrapolation(&embedding) < 1e-8);
    }
}
