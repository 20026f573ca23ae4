//! Overlays: meshes that are drawn in addition to the skins (surface meshes) and show what the step works with:
//! collision proxies (convex hulls that cover the skins), layers (tetrahedral meshes), cores (rigid bodies inside a
//! soft one, to which nodes are attached) and bones (cores of a skeleton, whose nodes are chosen by a capsule). A frame
//! is the rigid coordinate frame of a body or a core. A recording is a recorded GPU command buffer. The tool is the
//! rigid body that the haptic device leads.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::Arc;

use glam::DVec3;

use super::super::Simulation;
use super::{Shown, missing};
use crate::gpu::{Buffer, Recorder, Recording};
use crate::prepare::layer::boundary_faces;
use crate::prepare::{Body, Layer, Shape, hull};
use crate::scene::Bind;
use crate::stages::draw::{self, Field, Outline};
use crate::{Error, Result};

/// A mesh to draw over the skins, or in their place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Overlay {
    /// The collision proxies of all bodies, each attached to its frame; one part per body. Values: the index of the
    /// proxy among the proxies of all bodies.
    Proxies,
    /// Tetrahedral meshes (layers) cut open (see [`Simulation::cut_layer`]), with nodes where they are now; for each
    /// material of a soft body two parts, "skin" for faces on the mesh's boundary and "cut" for those that the cut laid
    /// open. Values: the field at each node, zero for a field that is defined by contacts.
    Layers(Field),
    /// The boundary of the tetrahedra whose four nodes are all attached to one core; one part per core, with its name.
    /// Values: the core's index in its body.
    Cores,
    /// The capsules of bones and of other cores whose nodes are chosen by a capsule, each attached to the core's frame;
    /// one part per such core, with its name. Values: the core's index in its body.
    Bones,
}

impl Overlay {
    fn kind(self) -> usize {
        match self {
            Overlay::Proxies => 0,
            Overlay::Layers(_) => 1,
            Overlay::Cores => 2,
            Overlay::Bones => 3,
        }
    }

    fn name(self) -> &'static str {
        ["proxies", "layers", "cores", "bones"][self.kind()]
    }
}

/// A part of an overlay's mesh.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Part {
    /// Name of the part; [`Overlay`] tells which names there are.
    pub name: String,
    /// Index of the body that the part belongs to; the index after that of the last body is the tool's.
    pub body: usize,
    /// The range of the part's vertices among those of the mesh.
    pub vertices: Range<usize>,
    /// The range of the part's triangles among those of the mesh.
    pub triangles: Range<usize>,
    /// In [`Overlay::Layers`] the material of the tetrahedra that its triangles belong to, as an index into
    /// [`Simulation::materials`]; otherwise zero.
    pub material: usize,
}

/// An overlay's mesh on the GPU, as it was when [`Simulation::overlay`] was called. Every call for the same overlay
/// returns handles of the same arrays.
#[derive(Clone)]
pub struct Mesh {
    /// One vec4 per vertex: position, m, relative to the origin that the caller gave; w is 1.
    pub positions: Buffer,
    /// Three u32 per triangle, its vertices counter-clockwise seen from outside, packed; zeros are added at the end
    /// until the number of u32 is a multiple of four (one texel).
    pub triangles: Buffer,
    /// One float per vertex to colour it by, packed and padded in the same way as `triangles`.
    pub values: Buffer,
    /// The greatest of `values`; zero where the mesh has no vertices.
    pub greatest: f32,
    /// Number of vertices.
    pub vertex_count: usize,
    /// Number of triangles.
    pub triangle_count: usize,
    /// The parts that the mesh consists of.
    pub parts: Arc<[Part]>,
}

/// The plane at which a layer is cut open: a tetrahedron with centroid x is left out of the drawing if
/// `normal . x > offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cut {
    /// Unit normal, rest axes of the body.
    pub normal: DVec3,
    /// Offset along the normal, m.
    pub offset: f64,
}

/// An overlay's mesh and the recordings that fill it.
pub(super) struct ShownMesh {
    mesh: draw::Mesh,
    parts: Arc<[Part]>,
    triangle_count: usize,
    place: Recording,
    /// One recording per [`Field`]; empty for overlays other than [`Overlay::Layers`].
    fields: Vec<Recording>,
}

impl Simulation {
    /// The mesh of an overlay as it is now, relative to `origin` (m). Its arrays are filled when this function returns,
    /// and keep their contents until it is called again for the same overlay. The arrays are made at the first call,
    /// and made anew whenever the arrays of the skins are made anew. The arrays of layers are also made anew when a cut
    /// has changed.
    #[doc(hidden)]
    pub fn overlay(&mut self, overlay: Overlay, origin: DVec3) -> Result<Mesh> {
        if let Overlay::Layers(_) = overlay {
            self.shown_fields()?;
        }
        let kind = overlay.kind();
        if self.shown()?.meshes[kind].is_none() {
            let made = self.show_mesh(overlay)?;
            self.shown()?.meshes[kind] = Some(made);
        }
        let shown = self.shown_at(origin)?;
        let Some(ShownMesh { mesh, parts, triangle_count, place, fields }) = &shown.meshes[kind] else {
            return Err(missing());
        };
        place.submit_and_wait()?;
        if let Overlay::Layers(field) = overlay
            && let Some(recording) = fields.get(field as usize)
        {
            recording.submit_and_wait()?;
        }
        Ok(Mesh {
            positions: mesh.points.positions.clone(),
            triangles: mesh.triangles.clone(),
            values: mesh.values.clone(),
            greatest: mesh.most.mapped::<f32>()?[0],
            vertex_count: mesh.points.count as usize,
            triangle_count: *triangle_count,
            parts: parts.clone(),
        })
    }

    /// Sets where a soft body's layer is cut open from now on. `None` restores the default cut, a plane through the
    /// middle of the layer's bounding box; its normal is the x axis or the z axis, whichever the box is shorter along.
    /// It is an error if the body is not soft, or if the cut's normal is zero or a number of the cut is not finite.
    #[doc(hidden)]
    pub fn cut_layer(&mut self, body: usize, cut: Option<Cut>) -> Result<()> {
        if self.layer_cut(body).is_none() {
            return Err(Error::Usage(format!("body {body} is not soft, so it has no layer to cut open")));
        }
        match cut {
            None => self.cuts.remove(&body),
            Some(Cut { normal, offset }) => {
                let length = normal.length();
                if !(length > 0.0 && length.is_finite() && offset.is_finite()) {
                    return Err(Error::Usage(format!(
                        "normal {normal} or offset {offset} is not valid for a cutting plane; give a finite normal \
                         that is not zero, and a finite offset"
                    )));
                }
                self.cuts.insert(body, Cut { normal: normal / length, offset })
            }
        };
        if let Some(shown) = &mut self.shown {
            shown.meshes[Overlay::Layers(Field::StrainEnergy).kind()] = None;
        }
        Ok(())
    }

    /// The plane at which a soft body's layer is cut open; `None` where the body is not soft.
    #[doc(hidden)]
    pub fn layer_cut(&self, body: usize) -> Option<Cut> {
        let Shape::Soft { layer, .. } = &self.bodies.get(body)?.shape else { return None };
        Some(self.cuts.get(&body).copied().unwrap_or_else(|| middle(layer)))
    }

    fn show_mesh(&self, overlay: Overlay) -> Result<ShownMesh> {
        let Some(Shown { draw, fields, .. }) = &self.shown else { return Err(missing()) };
        let (outline, parts) = match overlay {
            Overlay::Proxies => self.proxies_outline(),
            Overlay::Layers(_) => self.layers_outline(),
            Overlay::Cores => self.cores_outline(),
            Overlay::Bones => self.bones_outline(),
        };
        let mesh = draw::Mesh::new(&self.context, overlay.name(), &outline)?;
        let elastic = &self.stages.elastic;
        let record = |write: &dyn Fn(&mut Recorder)| -> Result<Recording> {
            let mut recorder = Recorder::untimed(&self.context)?;
            write(&mut recorder);
            recorder.finish()
        };
        let place = record(&|recorder| mesh.points.record(recorder, &draw.frames, elastic))?;
        let field_recording = |field: Field| {
            let Some(shown) = fields else { return Err(missing()) };
            record(&|recorder| {
                shown.fields.record_onto(recorder, field, draw, elastic, &mesh.points, &mesh.values);
                shown.fields.record_most(recorder, &mesh.range, &mesh.values, &mesh.most);
            })
        };
        let fields = match overlay {
            Overlay::Layers(_) => Field::ALL.into_iter().map(field_recording).collect::<Result<_>>()?,
            _ => Vec::new(),
        };
        Ok(ShownMesh { triangle_count: outline.triangles.len(), mesh, parts: parts.into(), place, fields })
    }

    /// One item for each body: its index, the body, and the index of its first frame. If the tool has a body of its own,
    /// the last item is that body's.
    fn shown_bodies(&self) -> impl Iterator<Item = (usize, &Body, u32)> {
        let all = self.bodies.iter().chain(&self.tool_body).zip(&self.model.body_frames);
        all.enumerate().map(|(index, (body, frame))| (index, body, *frame))
    }

    fn proxies_outline(&self) -> (Outline, Vec<Part>) {
        let (mut building, mut number) = (Building::default(), 0);
        for (index, body, first) in self.shown_bodies() {
            let (Shape::Soft { proxies, .. } | Shape::Rigid { proxies, .. }) = &body.shape else { continue };
            building.part(&body.name, index, |outline| {
                for proxy in proxies {
                    let frame = first + proxy.frame;
                    let centre = self.model.frames[frame as usize].rest_centre;
                    if let Some(hull) = hull::convex(&proxy.hull) {
                        let corner = |x: &DVec3| outline.add_rigid(frame, *x - centre, number as f32);
                        let corners: Vec<u32> = hull.vertices.iter().map(corner).collect();
                        outline.triangles.extend(hull.triangles.iter().map(|t| t.map(|v| corners[v as usize])));
                    }
                    number += 1;
                }
            });
        }
        building.done()
    }

    fn layers_outline(&self) -> (Outline, Vec<Part>) {
        let mut building = Building::default();
        for (index, body, _) in self.shown_bodies() {
            let (Shape::Soft { layer, materials, .. }, Some(cut)) = (&body.shape, self.layer_cut(index)) else {
                continue;
            };
            let (skin, open) = opened(layer, cut);
            for material in 0..materials.all.len() {
                for (name, faces) in [("skin", &skin), ("cut", &open)] {
                    let own = faces.iter().filter(|(_, tetrahedron)| materials.index(*tetrahedron) == material);
                    let own: Vec<[u32; 3]> = own.map(|(face, _)| *face).collect();
                    let add = |outline: &mut Outline| add_faces(outline, self.first_node(index), &own, 0.0);
                    building.part(name, index, add).material = material;
                }
            }
        }
        building.done()
    }

    fn cores_outline(&self) -> (Outline, Vec<Part>) {
        let mut building = Building::default();
        for (index, body, _) in self.shown_bodies() {
            let Shape::Soft { layer, node_frames, .. } = &body.shape else { continue };
            for (k, core) in self.scene.bodies[index].cores.iter().enumerate() {
                let own = |node: &u32| layer.attached[*node as usize] && node_frames[*node as usize] == k as u32;
                let whole: Vec<[u32; 4]> = layer.tetrahedra.iter().filter(|t| t.iter().all(own)).copied().collect();
                let faces: Vec<[u32; 3]> = boundary_faces(&whole).into_iter().map(|(face, _)| face).collect();
                let first = self.first_node(index);
                building.part(&core.name, index, |outline| add_faces(outline, first, &faces, k as f32));
            }
        }
        building.done()
    }

    fn bones_outline(&self) -> (Outline, Vec<Part>) {
        let mut building = Building::default();
        for (index, body, first) in self.shown_bodies() {
            let Shape::Soft { .. } = &body.shape else { continue };
            let scene = &self.scene.bodies[index];
            for (k, core) in scene.cores.iter().enumerate() {
                let Some(Bind::Capsule(capsule)) = &core.bind else { continue };
                let frame = first + k as u32;
                let centre = self.model.frames[frame as usize].rest_centre;
                let ends = capsule.ends.map(|end| scene.metres() * end - centre);
                let radii = capsule.radii.map(|radius| scene.metres() * radius);
                building.part(&core.name, index, |outline| add_capsule(outline, frame, ends, radii, k as f32));
            }
        }
        building.done()
    }

    /// Index of a soft body's first node among all nodes.
    fn first_node(&self, body: usize) -> u32 {
        let own = self.model.soft.iter().find(|soft| soft.body == body);
        own.map_or(0, |soft| soft.nodes.start as u32)
    }
}

/// An outline (a mesh that is being made) and its parts.
#[derive(Default)]
struct Building {
    outline: Outline,
    parts: Vec<Part>,
}

impl Building {
    /// Adds a part, which consists of what `add` adds to the outline.
    fn part(&mut self, name: &str, body: usize, add: impl FnOnce(&mut Outline)) -> &mut Part {
        let (vertex, triangle) = (self.outline.len(), self.outline.triangles.len());
        add(&mut self.outline);
        let (vertices, triangles) = (vertex..self.outline.len(), triangle..self.outline.triangles.len());
        let at = self.parts.len();
        self.parts.push(Part { name: name.into(), body, vertices, triangles, material: 0 });
        &mut self.parts[at]
    }

    fn done(self) -> (Outline, Vec<Part>) {
        (self.outline, self.parts)
    }
}

/// The default cut: a plane through the middle of a layer's bounding box. Its normal is the x axis or the z axis,
/// whichever the box is shorter along, so that the cut is as wide as possible.
fn middle(layer: &Layer) -> Cut {
    let low = layer.nodes.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let high = layer.nodes.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    let normal = if high.x - low.x < high.z - low.z { DVec3::X } else { DVec3::Z };
    Cut { normal, offset: normal.dot(0.5 * (low + high)) }
}

/// An outward face of a tetrahedron, and the tetrahedron's index in the whole layer.
type BoundaryFace = ([u32; 3], usize);

/// Outward faces of the tetrahedra that a cut leaves: those on the boundary of the whole mesh, and those that the cut
/// laid open.
fn opened(layer: &Layer, cut: Cut) -> (Vec<BoundaryFace>, Vec<BoundaryFace>) {
    let behind = |(_, t): &(usize, [u32; 4])| {
        let middle = t.iter().map(|n| layer.nodes[*n as usize]).sum::<DVec3>() / 4.0;
        cut.normal.dot(middle) <= cut.offset
    };
    let (indices, kept): (Vec<usize>, Vec<[u32; 4]>) =
        layer.tetrahedra.iter().copied().enumerate().filter(behind).unzip();
    let sorted = |mut face: [u32; 3]| {
        face.sort_unstable();
        face
    };
    let outer: BTreeSet<[u32; 3]> =
        boundary_faces(&layer.tetrahedra).into_iter().map(|(face, _)| sorted(face)).collect();
    let faces = boundary_faces(&kept).into_iter().map(|(face, kept)| (face, indices[kept as usize]));
    faces.partition(|(face, _)| outer.contains(&sorted(*face)))
}

/// Adds triangles whose corners are nodes of a body to an outline; the body's first node has the index `first` among
/// the nodes of all bodies. Each node becomes one vertex with the value `value`.
fn add_faces(outline: &mut Outline, first: u32, faces: &[[u32; 3]], value: f32) {
    let nodes: BTreeSet<u32> = faces.iter().flatten().copied().collect();
    let vertices: BTreeMap<u32, u32> =
        nodes.into_iter().map(|node| (node, outline.add_node(first + node, value))).collect();
    outline.triangles.extend(faces.iter().map(|face| face.map(|node| vertices[&node])));
}

/// Number of vertices of each ring around a capsule.
const AROUND: usize = 16;
/// Number of rings of vertices on each end of a capsule.
const RINGS: usize = 5;

/// Adds a capsule to an outline: a hemisphere at each end of the axis from `a` to `b`, each with its own radius, and
/// the surface of a truncated cone between them.
fn add_capsule(outline: &mut Outline, frame: u32, [a, b]: [DVec3; 2], radii: [f64; 2], value: f32) {
    let axis = (b - a).try_normalize().unwrap_or(DVec3::Y);
    let (u, v) = axis.any_orthonormal_pair();
    let start = outline.add_rigid(frame, a - radii[0] * axis, value);
    // Rings from the pole at end a to the equator there, then from the equator at end b to the pole there.
    let quarter = std::f64::consts::FRAC_PI_2 / RINGS as f64;
    let of_a = (1..=RINGS).map(|k| (a, radii[0], k as f64 * quarter));
    let of_b = (0..RINGS).map(|k| (b, radii[1], (RINGS + k) as f64 * quarter));
    let mut rings: Vec<Vec<u32>> = Vec::new();
    for (end, radius, angle) in of_a.chain(of_b) {
        let at = |k: usize| {
            let turn = std::f64::consts::TAU * k as f64 / AROUND as f64;
            end + radius * (angle.sin() * (turn.cos() * u + turn.sin() * v) - angle.cos() * axis)
        };
        rings.push((0..AROUND).map(|k| outline.add_rigid(frame, at(k), value)).collect());
    }
    let finish = outline.add_rigid(frame, b + radii[1] * axis, value);
    let next = |k: usize| (k + 1) % AROUND;
    for k in 0..AROUND {
        outline.triangles.push([start, rings[0][next(k)], rings[0][k]]);
        for pair in rings.windows(2) {
            outline.triangles.push([pair[0][k], pair[0][next(k)], pair[1][next(k)]]);
            outline.triangles.push([pair[0][k], pair[1][next(k)], pair[1][k]]);
        }
        let last = &rings[rings.len() - 1];
        outline.triangles.push([last[k], last[next(k)], finish]);
    }
}
