//! The list of meshes that a rendered image shows, each with its style and material. A *skin* is a body's surface mesh;
//! a *rigid core* is a rigid body inside a soft one, to which nodes are attached; a *contact patch* is a place where a
//! pair of bodies may touch; the *tool* is the rigid body that the haptic device leads.

use std::ops::Range;
use std::sync::Arc;

use glam::DVec3;
use palpate::internal::gpu::Buffer;
use palpate::internal::step::{self, Field};
use palpate::{Context, Result, Wrench};

use super::look::{Look, Material, flags};
use super::marks::Marks;
use super::moment::{Moment, ShownTool};
use super::overlay::Overlay;
use super::parts::Part;
use super::renderer::Legend;

/// Opacity of a skin through which cores are seen, and of the rectangle of a contact patch.
const SHEER: f32 = 0.28;
/// Colours, sRGB, in this order: the inside of a tetrahedral mesh (layer) that is cut open, cores and bones, force,
/// torque, contact patches, and the rod from the tool to the haptic device.
const INSIDE: [u8; 3] = [240, 200, 120];
const BONE: [u8; 3] = [236, 228, 206];
const FORCE: [u8; 3] = [200, 50, 40];
const TORQUE: [u8; 3] = [70, 80, 190];
const REGION: [u8; 3] = [60, 150, 140];
const LEAD: [u8; 3] = [110, 110, 120];
/// Sizes as shares of the height that the image shows at the camera's target: the longest arrow, an arrow's radius, a
/// rod's radius, and the length of a contact patch's normal.
const ARROW: [f64; 4] = [0.3, 0.006, 0.0025, 0.12];

/// How a mesh is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Style {
    /// Only front faces, shaded per pixel.
    Solid,
    /// Only front faces, shaded per vertex.
    Fine,
    /// Both sides of faces, shaded per pixel.
    Open,
    /// Transparent; drawn after everything opaque.
    Glass,
}

/// The arrays of a mesh.
#[derive(Clone)]
pub struct Arrays {
    pub positions: Buffer,
    pub normals: Buffer,
    pub values: Buffer,
    pub indices: Buffer,
}

/// Triangles that are drawn together.
pub struct Piece {
    pub arrays: Arrays,
    /// Range among the indices in `arrays`.
    pub range: Range<u32>,
    pub style: Style,
    /// Index among the image's materials.
    pub material: usize,
}

/// All that an image shows.
#[derive(Default)]
pub struct Pieces {
    pub all: Vec<Piece>,
    pub materials: Vec<Material>,
}

/// The inputs from which pieces are made.
pub struct Source<'a> {
    pub context: &'a Arc<Context>,
    pub moment: &'a Moment,
    pub skins: &'a [Part],
    /// Zeros, used as vertex values (numbers by which a mesh is coloured) of meshes without values.
    pub no_values: &'a Buffer,
    pub origin: DVec3,
    /// Height that the image shows at the camera's target, m.
    pub height: f64,
    pub legend: &'a Legend,
}

/// Whether a field has values everywhere in a body, and not only where bodies touch.
pub fn is_of_bodies(field: Field) -> bool {
    !matches!(field, Field::Depth | Field::Pressure)
}

impl Pieces {
    fn add(&mut self, arrays: Arrays, range: Range<u32>, style: Style, material: Material) {
        let known = self.materials.iter().position(|other| *other == material);
        let material = known.unwrap_or_else(|| {
            self.materials.push(material);
            self.materials.len() - 1
        });
        if !range.is_empty() {
            self.all.push(Piece { arrays, range, style, material });
        }
    }
}

impl Source<'_> {
    /// All pieces of the image.
    pub fn pieces(&self) -> Result<Pieces> {
        let mut pieces = Pieces::default();
        self.skins(&mut pieces);
        self.meshes(&mut pieces);
        self.marks(&mut pieces)?;
        Ok(pieces)
    }

    /// The material, coloured by vertex values if a field is shown.
    fn coloured(&self, material: Material) -> Material {
        let Some((field, high)) = self.legend.field else { return material };
        let flags = if is_of_bodies(field) { flags::VALUED | flags::EVEN } else { flags::VALUED };
        // Before any value was above zero, the scale's upper end is arbitrary: everything has the colour of zero.
        Material { low: 0.0, high: if high > 0.0 { high as f32 } else { 1.0 }, ..material.with(flags) }
    }

    fn skins(&self, pieces: &mut Pieces) {
        let shown = self.moment.shown;
        for part in self.skins {
            let is_replaced = part.is_soft && shown.opens_layers() || shown.has(Overlay::Proxies) && !part.is_tool;
            if is_replaced {
                continue;
            }
            let values = self.moment.field.as_ref().map_or(self.no_values, |field| &field.values);
            let arrays = Arrays {
                positions: self.moment.positions.clone(),
                normals: self.moment.normals.clone(),
                values: values.clone(),
                indices: part.indices.clone(),
            };
            let is_sheer = part.is_soft && shown.has(Overlay::Cores);
            let (style, material) = match (part.is_tool, is_sheer, part.is_fine) {
                (true, ..) => (Style::Glass, part.material),
                (_, true, _) => (Style::Glass, part.material.glass(SHEER)),
                (.., true) => (Style::Fine, part.material),
                _ => (Style::Solid, part.material),
            };
            let material = if part.is_soft { self.coloured(material) } else { material };
            pieces.add(arrays, 0..part.index_count, style, material);
        }
    }

    fn meshes(&self, pieces: &mut Pieces) {
        for (overlay, mesh) in &self.moment.meshes {
            let arrays = Arrays {
                positions: mesh.positions.clone(),
                // These normals are not used, because the mesh is shaded with one normal per face.
                normals: mesh.positions.known_as(&["normals"]),
                values: mesh.values.clone(),
                indices: mesh.triangles.clone(),
            };
            for part in mesh.parts.iter() {
                let body = Material::body(part.body);
                let own = self.moment.materials.iter().find(|own| (own.body, own.index) == (part.body, part.material));
                let (style, material) = match overlay {
                    step::Overlay::Proxies => (Style::Solid, body.with(flags::NUMBERED)),
                    step::Overlay::Layers(_) => {
                        let without = if part.name == "cut" { Material::plain(INSIDE) } else { body };
                        (Style::Open, own.map_or(self.coloured(without), |own| Material::plain(own.colour)))
                    }
                    step::Overlay::Cores | step::Overlay::Bones => (Style::Open, Material::plain(BONE)),
                };
                let range = 3 * part.triangles.start as u32..3 * part.triangles.end as u32;
                pieces.add(arrays.clone(), range, style, material.with(flags::FLAT | flags::BARE));
            }
        }
    }

    fn marks(&self, pieces: &mut Pieces) -> Result<()> {
        let [longest, thick, thin, normal] = ARROW.map(|share| share * self.height);
        let Moment { tools, devices, shown, contact_patches, .. } = self.moment;
        let mut marks = Marks::new(self.origin);
        let mut made = Vec::new();
        for ShownTool { centre, wrench, .. } in tools.iter().filter(|_| shown.has(Overlay::Arrows)) {
            let Wrench { force, torque } = wrench;
            for (vector, high, colour) in [(force, self.legend.force, FORCE), (torque, self.legend.torque, TORQUE)] {
                if high > 0.0 {
                    let arrow = marks.arrow(*centre, centre + longest / high * *vector, thick);
                    made.push((arrow, Style::Solid, Material::plain(colour)));
                }
            }
        }
        for (tool, device) in tools.iter().zip(devices) {
            made.push((marks.rod(tool.centre, *device, thin), Style::Solid, Material::plain(LEAD)));
        }
        for contact_patch in contact_patches {
            let half = [0, 1].map(|k| contact_patch.half[k].max(thick) * contact_patch.tangents[k]);
            let plane = Material::plain(REGION).glass(SHEER).with(flags::UNLIT);
            made.push((marks.rectangle(contact_patch.centre, half), Style::Glass, plane));
            let arrow =
                marks.arrow(contact_patch.centre, contact_patch.centre + normal * contact_patch.normal, 0.5 * thick);
            made.push((arrow, Style::Solid, Material::plain(REGION)));
        }
        let Some(mesh) = marks.upload(self.context)? else { return Ok(()) };
        for (range, style, material) in made {
            pieces.add(mesh.clone(), range, style, material.with(flags::BARE));
        }
        Ok(())
    }
}
