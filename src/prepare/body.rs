//! Makes a prepared [`Body`] from a body or tool of the scene. The costly parts come from `prepared.rs`, which caches
//! them: the repaired *skin* (surface mesh), the *layer* (tetrahedral mesh), the embedding of the skin in the layer,
//! and the *proxies* (convex hulls for the broad phase). This file then attaches nodes of the layer to rigid cores
//! inside the body, scales and places the body, and checks the result. The *tool* is the rigid body that the haptic
//! device leads.

use glam::DVec3;

use super::cache::Cache;
use super::prepared::{Prepared, Recipe};
use super::repair::{Refusal, RepairReport};
use super::report::{Log, Stage, Watch};
use super::{
    Body, BodyReport, FrameMotion, Proxy, Report, Shape, cores, loads, mass, materials, patch, proxies, repair, ride,
    skin,
};
use crate::scene::triangles::TriangleMesh;
use crate::scene::{self, Dilatation, MaterialLaw, Motion, Scene, Surface, ToolShape};
use crate::{Error, Result};

/// Least volume that a closed skin must enclose, as a share of the cube of its bounding box's diagonal; a smaller
/// volume is rounding error.
const LEAST_VOLUME: f64 = 1e-12;
/// Largest extents of bodies, m, that raise no doubt about the unit of their files.
const USUAL_SIZES: std::ops::RangeInclusive<f64> = 1e-3..=10.0;

/// Prepares a body of the scene with the cache of earlier results in the user's cache folder. Errors name the key in
/// the scene, or the file.
pub fn body(body: &scene::Body, scene: &Scene) -> Result<Body> {
    body_and_report(body, scene, &Cache::of_user(), &mut |_| Ok(())).map(|(body, _)| body)
}

/// Prepares a body of the scene and reports on it. `watch` is called at the beginning of each stage. A half-space has
/// no report.
pub fn body_and_report<'a>(
    body: &scene::Body,
    scene: &Scene,
    cache: &Cache,
    watch: &'a mut Watch<'a>,
) -> Result<(Body, Option<Report>)> {
    let mut log = Log::new(watch);
    let body = make(body, scene, cache, &mut log)?;
    let report = Report::of(&body, log);
    Ok((body, report))
}

fn make(body: &scene::Body, scene: &Scene, cache: &Cache, log: &mut Log) -> Result<Body> {
    let keys = Keys::of_body(scene, body);
    let (surface, layer) = match &body.shape {
        scene::Shape::Soft { surface, layer } => (surface.as_ref(), Some(layer)),
        scene::Shape::Rigid { surface } => (Some(surface), None),
        scene::Shape::Plane { normal, offset } => {
            let shape = Shape::Plane { normal: *normal, offset: *offset };
            return Ok(placed(body, shape, Vec::new(), BodyReport::default()));
        }
    };
    let recipe = Recipe { surface, layer, hulls: body.hulls };
    let prepared = recipe.prepared(&keys, cache, log)?;
    let mut report = report_of(&keys, layer, &prepared, log);
    if body.units.is_none() {
        report.notes.extend(odd_size(&keys, &prepared.mesh.vertices, body.scale));
    }
    log.filling = prepared.filling.clone();
    let made = log.stage(Stage::Bind, || match layer {
        Some(_) => soft(&keys, body, prepared),
        None => {
            let loads =
                loads::loads(body, None, &[], &prepared.mesh, |key, problem, remedy| keys.error(key, problem, remedy))?;
            let shape = rigid(prepared, body.metres(), motion(&body.cores, body.metres()))
                .map_err(|problem| keys.error("surface", problem, "give a closed surface with volume"))?;
            Ok((shape, loads))
        }
    })?;
    let (shape, loads) = made?;
    if let Shape::Soft { supports, .. } = &shape {
        report.notes.extend(supports.notes.iter().map(|note| format!("`{}`: {note}", keys.prefix)));
    }
    Ok(placed(body, shape, loads, report))
}

/// A note on a body so large or so small that its file is most likely in another unit than metres, for a body whose
/// `units` are not said.
fn odd_size(keys: &Keys, vertices: &[DVec3], scale: f64) -> Option<String> {
    let low = vertices.iter().fold(DVec3::INFINITY, |low, vertex| low.min(*vertex));
    let high = vertices.iter().fold(DVec3::NEG_INFINITY, |high, vertex| high.max(*vertex));
    let size = scale * (high - low).max_element();
    if !size.is_finite() || USUAL_SIZES.contains(&size) {
        return None;
    }
    let advice = if size > *USUAL_SIZES.end() {
        "if its lengths are in millimetres, give units = \"mm\""
    } else {
        "give `units`, or a `scale` that turns its lengths into metres"
    };
    Some(format!("`{}`: the body is {size:.3e} m across; {advice} (the scale is {scale})", keys.prefix))
}

/// Collects what was found and changed in the body's files, and the notes of the log.
fn report_of(keys: &Keys, layer: Option<&scene::Layer>, prepared: &Prepared, log: &Log) -> BodyReport {
    let mut notes: Vec<String> = prepared.surface_notes.iter().map(|note| keys.of_surface(note)).collect();
    notes.extend(prepared.repair.iter().flat_map(|found| keys.notes(found)));
    let place = match layer {
        Some(scene::Layer::File(path)) => path.display().to_string(),
        _ => format!("`{}.layer`", keys.prefix),
    };
    notes.extend(prepared.layer_notes.iter().map(|note| format!("{place}: {note}")));
    notes.extend(log.notes.iter().cloned());
    BodyReport { repair: prepared.repair.clone(), notes }
}

fn placed(body: &scene::Body, shape: Shape, loads: Vec<loads::Load>, report: BodyReport) -> Body {
    Body {
        name: body.name.clone(),
        shape,
        position: body.position,
        orientation: body.orientation,
        velocity: body.velocity,
        loads,
        report,
    }
}

/// Prepares the tool as a rigid body named "tool" in its own coordinates: the centre of a sphere is the origin, and a
/// surface keeps its file's coordinates (the surface's centroid is a field of [`Shape::Rigid`]).
pub fn tool(tool: &scene::Tool, scene: &Scene) -> Result<Body> {
    watched_tool(tool, scene, &Cache::of_user(), &mut |_| Ok(()))
}

/// Prepares the tool as [`tool`] does, with the given cache; `watch` is called at the beginning of each stage.
pub fn watched_tool<'a>(tool: &scene::Tool, scene: &Scene, cache: &Cache, watch: &'a mut Watch<'a>) -> Result<Body> {
    let surface = match &tool.shape {
        ToolShape::Sphere(_) => None,
        ToolShape::Surface(surface) => Some(surface),
        ToolShape::Body(name) => {
            let problem = format!("the tool is body `{name}` of the scene and is prepared with the bodies");
            return Err(Error::key(&scene.file, "tool.body", problem, "give `sphere` or `surface`"));
        }
    };
    let keys = Keys { scene, prefix: "tool".into(), surface, repair: tool.repair };
    let mut log = Log::new(watch);
    let (key, prepared) = match tool.shape {
        ToolShape::Sphere(radius) => ("sphere", ball(&keys, radius)?),
        _ => {
            let recipe = Recipe { surface, layer: None, hulls: None };
            ("surface", recipe.prepared(&keys, cache, &mut log)?)
        }
    };
    let report = report_of(&keys, None, &prepared, &log);
    let shape = rigid(prepared, tool.metres(), FrameMotion::Fixed)
        .map_err(|p| keys.error(key, p, "give a closed surface with volume"))?;
    Ok(Body {
        name: "tool".into(),
        shape,
        position: tool.position,
        orientation: tool.orientation,
        velocity: tool.velocity,
        loads: Vec::new(),
        report,
    })
}

/// Skin and proxies of a sphere about the origin.
fn ball(keys: &Keys, radius: f64) -> Result<Prepared> {
    let (vertices, triangles) = super::sphere::icosphere(radius);
    let skin = skin::build(vertices, triangles);
    let proxies = proxies(&skin).map_err(|p| keys.error("sphere", p, "give a radius above zero"))?;
    let mesh = TriangleMesh { vertices: skin.vertices, triangles: skin.triangles };
    Ok(Prepared { mesh, proxies, ..Prepared::default() })
}

/// Makes errors and notes about the keys of one body, or of the tool.
pub(super) struct Keys<'a> {
    scene: &'a Scene,
    /// Dotted path of the body's table in the scene file.
    prefix: String,
    surface: Option<&'a Surface>,
    /// Whether defects of the surface are repaired; otherwise they are refused.
    pub repair: bool,
}

impl<'a> Keys<'a> {
    pub fn of_body(scene: &'a Scene, body: &'a scene::Body) -> Self {
        let surface = match &body.shape {
            scene::Shape::Soft { surface, .. } => surface.as_ref(),
            scene::Shape::Rigid { surface } => Some(surface),
            scene::Shape::Plane { .. } => None,
        };
        Keys { scene, prefix: format!("body.{}", body.name), surface, repair: body.repair }
    }

    /// An error about a key of the table: the problem and its remedy.
    pub fn error(&self, key: &str, problem: impl Into<String>, remedy: impl Into<String>) -> Error {
        Error::key(&self.scene.file, format!("{}.{key}", self.prefix), problem, remedy)
    }

    /// Whether the user gave the surface, which may therefore have defects; otherwise the engine generates it.
    pub fn is_surface_given(&self) -> bool {
        matches!(self.surface, Some(Surface::File(_) | Surface::Mesh(_)))
    }

    /// The error for a given surface that was refused. It names the surface's file if there is one.
    pub fn refusal(&self, refusal: &Refusal) -> Error {
        match self.surface {
            Some(Surface::File(path)) => refusal.error(path),
            _ => self.error("surface", refusal.placed(), refusal.remedy),
        }
    }

    /// A note on the surface's file, with its name.
    fn of_surface(&self, note: &str) -> String {
        match self.surface {
            Some(Surface::File(path)) => format!("{}: {note}", path.display()),
            _ => format!("`{}.surface`: {note}", self.prefix),
        }
    }

    /// The changes that the repair made to a given surface, one sentence each.
    fn notes(&self, found: &RepairReport) -> Vec<String> {
        match self.surface {
            Some(Surface::File(path)) => repair::notes(found, path),
            Some(Surface::Mesh(_)) => found.sentences().iter().map(|(_, text)| self.of_surface(text)).collect(),
            _ => Vec::new(),
        }
    }
}

/// Makes the rigid shape of a prepared skin. It is an error if the skin encloses no volume.
fn rigid(prepared: Prepared, scale: f64, motion: FrameMotion) -> std::result::Result<Shape, String> {
    let mesh = scaled(prepared.mesh, scale);
    // Holes are closed by triangle fans, which count for mass but are never touched.
    let (vertices, triangles) = repair::closed(&mesh.vertices, &mesh.triangles);
    let p = mass::properties(&vertices, &triangles);
    let low = mesh.vertices.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let diagonal = mesh.vertices.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max).distance(low);
    // The condition refuses a NaN too.
    if p.volume.is_nan() || p.volume <= LEAST_VOLUME * diagonal.powi(3) {
        return Err(format!("the surface encloses a volume of {:.3e} m^3", p.volume));
    }
    let skin = skin::build(mesh.vertices, mesh.triangles);
    let proxies = scaled_proxies(prepared.proxies, scale);
    Ok(Shape::Rigid { skin, proxies, volume: p.volume, centroid: p.centroid, inertia: p.inertia, motion })
}

/// Makes the deformable shape of a prepared layer and skin.
fn soft(keys: &Keys, body: &scene::Body, prepared: Prepared) -> Result<(Shape, Vec<loads::Load>)> {
    let mut layer = prepared.layer.unwrap_or_default();
    let materials = materials::materials(keys, body, &layer, &prepared.groups)?;
    let mesh = cores::Numbered { numbers: &prepared.node_numbers, groups: &prepared.groups };
    let (node_frames, supports) =
        cores::bind(body, &mut layer, &mesh, &prepared.mesh, |key, problem, remedy| keys.error(key, problem, remedy))?;
    let soft = Some((&layer, &prepared.embedding[..], &mesh));
    let is_prescribed =
        |n: usize| layer.attached[n] && !matches!(body.cores[node_frames[n] as usize].motion, Motion::Dynamic);
    let prescribed: Vec<bool> = (0..layer.nodes.len()).map(is_prescribed).collect();
    let loads =
        loads::loads(body, soft, &prescribed, &prepared.mesh, |key, problem, remedy| keys.error(key, problem, remedy))?;
    layer.nodes.iter_mut().for_each(|n| *n *= body.metres());
    if body.dilatation == Dilatation::Patch {
        if materials.all.iter().any(|material| material.law != MaterialLaw::Corotational) {
            let problem = "\"patch\" works with the corotational law only";
            return Err(keys.error("dilatation", problem, "use \"element\", or law = \"corotational\" everywhere"));
        }
        if materials.all.iter().any(|material| material.poisson < 0.0) {
            let problem = "\"patch\" needs a Poisson's ratio that is not negative";
            return Err(keys.error("dilatation", problem, "use \"element\", or poisson = 0 or more everywhere"));
        }
        layer.patches = patch::patches(&layer, |t| materials.index(t) as u32);
    }
    let mesh = scaled(prepared.mesh, body.metres());
    let skin = skin::build(mesh.vertices, mesh.triangles);
    let embedding = prepared.embedding;
    let proxies = scaled_proxies(prepared.proxies, body.metres());
    let proxies = ride::on_frames(proxies, &skin, &layer, &embedding, &node_frames);
    let frames = cores::frames(body, &layer, &node_frames, &materials)
        .map_err(|(key, problem, remedy)| keys.error(&key, problem, remedy))?;
    let scaled_joint = |joint: &scene::Joint| scene::Joint { point: body.metres() * joint.point, ..*joint };
    let joints = body.joints.iter().map(scaled_joint).collect();
    let shape = Shape::Soft { layer, frames, node_frames, supports, joints, materials, embedding, skin, proxies };
    Ok((shape, loads))
}

/// Motion of a rigid body, which its only core defines; a body without core is fixed.
fn motion(cores: &[scene::Core], scale: f64) -> FrameMotion {
    match cores.first().map(|core| &core.motion) {
        Some(Motion::Kinematic(keys)) => FrameMotion::Kinematic(keys.clone()),
        Some(Motion::Dynamic) => cores::dynamic(&cores[0], scale),
        _ => FrameMotion::Fixed,
    }
}

fn scaled(mut mesh: TriangleMesh, scale: f64) -> TriangleMesh {
    mesh.vertices.iter_mut().for_each(|v| *v *= scale);
    mesh
}

fn scaled_proxies(mut proxies: Vec<Proxy>, scale: f64) -> Vec<Proxy> {
    for proxy in &mut proxies {
        proxy.hull.iter_mut().for_each(|v| *v *= scale);
        proxy.faces.iter_mut().for_each(|(_, offset)| *offset *= scale);
        proxy.margin *= scale;
    }
    proxies
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_surface_without_volume_is_refused() {
        let (vertices, mut triangles) = crate::prepare::sphere::icosphere(1.0);
        triangles.iter_mut().for_each(|t| t.swap(0, 1));
        let mesh = TriangleMesh { vertices, triangles };
        let prepared = Prepared { mesh, ..Prepared::default() };
        assert!(rigid(prepared, 1.0, FrameMotion::Fixed).unwrap_err().contains("encloses a volume of -"));
    }
}
