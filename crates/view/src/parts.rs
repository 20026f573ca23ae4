//! The skins (surface meshes) of a simulation's bodies as an image shows them: the skins' triangles and materials, and
//! the places of the bodies when rendering began. The *tool* is the rigid body that the haptic device leads.

use std::sync::Arc;

use glam::DVec3;
use palpate::internal::gpu::{Buffer, Memory};
use palpate::internal::prepare::Shape;
use palpate::{Context, Result, Simulation};

use super::decimate::clustered;
use super::look::{Look, Material};

/// Number of lattice cells along a body's largest extent; on this lattice the mesh that casts the body's shadow is
/// decimated.
const SHADOW_CELLS: f64 = 32.0;
/// Colour of a tool that is not one of the bodies, sRGB.
const TOOL: [u8; 3] = [90, 130, 170];
/// Opacity of a tool that is not one of the bodies.
const TOOL_ALPHA: f32 = 0.42;

/// The skin of a body or of the tool.
pub struct Part {
    /// Index of the body; the tool's index follows those of the bodies.
    pub body: usize,
    /// Three indices per triangle, into the vertices of all skins.
    pub indices: Buffer,
    /// Number of indices.
    pub index_count: u32,
    pub material: Material,
    /// Whether this is the skin of a tool that is not one of the bodies; such a skin is drawn transparent.
    pub is_tool: bool,
    /// Whether the body is soft.
    pub is_soft: bool,
    /// Mean length of the triangles' first edges, m.
    pub edge: f64,
    /// Whether the triangles are so small, compared with the shadow map's texels, that the skin is shaded per vertex.
    pub is_fine: bool,
    /// Sphere around the skin's initial vertices: centre and radius, m.
    pub ball: (DVec3, f64),
    /// Initial origin of the body's first rigid coordinate frame, m.
    pub frame: Option<DVec3>,
}

/// All skins, the tool's last; the triangles that cast shadows; the ground on which shadows fall.
pub struct Parts {
    pub skins: Vec<Part>,
    pub casters: Buffer,
    pub caster_count: u32,
    /// The ground: unit normal and offset, m.
    pub ground: (DVec3, f64),
}

impl Parts {
    /// The skins, shadow-casting triangles and ground of a simulation as it is now.
    pub fn new(context: &Arc<Context>, simulation: &Simulation) -> Result<Parts> {
        let ranges = simulation.skin_ranges();
        let (mut skins, mut casters, mut lowest) = (Vec::new(), Vec::new(), f64::INFINITY);
        for (body, range) in ranges.iter().enumerate() {
            let vertices = simulation.vertex_positions(body)?;
            if vertices.is_empty() {
                continue;
            }
            let own = simulation.skin_triangles(body);
            let of_all = |t: &[u32; 3]| t.map(|i| i + range.start as u32);
            let triangles: Vec<[u32; 3]> = own.iter().map(of_all).collect();
            let (low, high) = bounds(&vertices);
            let cell = (high - low).max_element() / SHADOW_CELLS;
            casters.extend(clustered(&vertices, own, cell).iter().map(of_all));
            let is_tool = body == simulation.bodies().len();
            if !is_tool {
                lowest = lowest.min(low.y);
            }
            let centre = 0.5 * (low + high);
            let radius = vertices.iter().map(|x| x.distance(centre)).fold(0.0, f64::max);
            let frame = if is_tool {
                simulation.tool().map(|tool| tool.centre)
            } else {
                simulation.frames(body).first().map(|place| place.centre)
            };
            skins.push(Part {
                body,
                indices: Buffer::from_slice(context, "triangles to draw", &triangles, Memory::Device)?,
                index_count: 3 * triangles.len() as u32,
                material: if is_tool { Material::plain(TOOL).glass(TOOL_ALPHA) } else { Material::body(body) },
                is_tool,
                is_soft: matches!(simulation.bodies().get(body).map(|b| &b.shape), Some(Shape::Soft { .. })),
                edge: edge(&vertices, own),
                is_fine: false,
                ball: (centre, radius),
                frame,
            });
        }
        let plane = simulation.bodies().iter().find_map(|body| match body.shape {
            Shape::Plane { normal, offset } => Some((normal, offset)),
            _ => None,
        });
        let lowest = if lowest.is_finite() { lowest } else { 0.0 };
        Ok(Parts {
            caster_count: 3 * casters.len() as u32,
            casters: Buffer::from_slice(context, "triangles that cast shadows", &casters, Memory::Device)?,
            ground: plane.unwrap_or((DVec3::Y, lowest)),
            skins,
        })
    }
}

/// The lower and the upper corner of the box around points.
pub fn bounds(points: &[DVec3]) -> (DVec3, DVec3) {
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    points.iter().fold(none, |(low, high), x| (low.min(*x), high.max(*x)))
}

/// Mean length of the triangles' first edges, m.
fn edge(vertices: &[DVec3], triangles: &[[u32; 3]]) -> f64 {
    let first = |t: &[u32; 3]| vertices[t[0] as usize].distance(vertices[t[1] as usize]);
    triangles.iter().map(first).sum::<f64>() / triangles.len().max(1) as f64
}
