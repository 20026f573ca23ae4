//! Fields: numbers a vertex that are shown as colours. Read from what the step leaves; nothing of that is written.

use std::ops::Range;
use std::sync::Arc;

use super::super::contact::Touch;
use super::super::elastic::Elastic;
use super::super::material_law;
use super::super::model::Model;
use super::super::{Common, array, count, upload};
use super::{Draw, Points, lists};
use crate::Result;
use crate::gpu::{Buffer, Const, Context, Kernel, Memory, Recorder, Size};
use crate::shaders;
use crate::shaders::{Contact, NONE};

/// What is shown as a colour on the skins. None is ever negative, nor anything but a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Field {
    /// How deep a vertex was in another body at the start of the last step, m; zero without a contact. Contacts are gathered by
    /// the vertices of one skin or of both; each counts for the vertex that gathers it and for the corners of the triangle
    /// that it meets, and the deepest of a vertex is shown.
    Depth,
    /// With which the last step's contacts pushed at its end, Pa: times a contact's area that is its force along its normal.
    /// Shown at the same vertices as the depth, the greatest of each. After a state was taken up, and before the next step,
    /// with which it began to push.
    Pressure,
    /// Of the layer that the skin is embedded in, J/m^3, by each tetrahedron's law; the mean by volume around a node, and
    /// between nodes as the skin is embedded. Zero on rigid bodies.
    StrainEnergy,
    /// How far deformation has moved a vertex, m: from where it would be if its body were carried rigidly, by the core that
    /// each of its nodes goes with, or by the frame that follows a body without cores. How the body as a whole moves is no
    /// part of it; with fixed cores it is the distance from where the vertex was placed. Zero on rigid bodies.
    Displacement,
}

impl Field {
    /// All of them.
    pub const ALL: [Field; 4] = [Field::Depth, Field::Pressure, Field::StrainEnergy, Field::Displacement];

    /// What it is called.
    pub fn name(self) -> &'static str {
        match self {
            Field::Depth => "penetration depth",
            Field::Pressure => "pressure",
            Field::StrainEnergy => "strain energy density",
            Field::Displacement => "displacement",
        }
    }

    /// The unit of its numbers.
    pub fn unit(self) -> &'static str {
        match self {
            Field::Depth | Field::Displacement => "m",
            Field::Pressure => "Pa",
            Field::StrainEnergy => "J/m^3",
        }
    }
}

/// Kernels and arrays.
pub struct Fields {
    touched: Option<Kernel>,
    energy: Kernel,
    share: Option<Patches>,
    mean: Kernel,
    spread: Kernel,
    moved: Kernel,
    most: Kernel,
    node_first: Buffer,
    node_tetrahedra: Buffer,
    densities: Buffer,
    node_values: Buffer,
    ranges: Buffer,
    /// Whether the device still has what the solver applied in the last step: one u32, written by the host.
    pub is_solved: Buffer,
    /// A float a vertex, by [`Field`].
    pub values: [Buffer; 4],
    /// A float a body, the tool's last: the greatest of its vertices; by [`Field`].
    pub most_values: [Buffer; 4],
}

/// What kernels call the array of a field: contacts write two of them by name.
fn roles(field: Field) -> &'static [&'static str] {
    match field {
        Field::Depth => &["depths", "values"],
        Field::Pressure => &["pressures", "values"],
        Field::StrainEnergy | Field::Displacement => &["values"],
    }
}

/// Tetrahedra that share a volumetric strain.
struct Patches {
    kernel: Kernel,
    count: u32,
    first: Buffer,
    members: Buffer,
}

impl Fields {
    /// For a model whose bodies' skins take up these ranges of the vertices; `touch`: where anything can.
    pub fn new(
        context: &Arc<Context>,
        model: &Model,
        ranges: &[Range<usize>],
        touch: Option<&Touch>,
    ) -> Result<Fields> {
        let (vertices, nodes) = (model.skin_nodes.len(), model.node_rest.len());
        let corners = model.tetrahedra.iter().zip(0..).flat_map(|(nodes, t)| nodes.map(|node| (node, t)));
        let (node_first, node_tetrahedra) = lists(nodes, corners);
        let group = |name: &str, constants: &[(&str, Const)]| Kernel::new(context, name, Size::Group, constants);
        let share = || -> Result<Patches> {
            let patches = model.patches.of.iter().zip(0..).filter(|(patch, _)| **patch != NONE);
            let (first, members) = lists(model.patches.count(), patches.map(|(patch, t)| (*patch, t)));
            Ok(Patches {
                kernel: group("draw/share", &[("PATCHES", count(model.patches.count()))])?,
                count: model.patches.count() as u32,
                first: upload(context, "patch_first", &first)?,
                members: upload(context, "patch_members", &members)?,
            })
        };
        let touched = |touch: &Touch| {
            let capacity = touch.contacts.bytes() as usize / size_of::<Contact>();
            group("draw/touched", &[("CAPACITY", count(capacity))])
        };
        let rows: Vec<[u32; 2]> = ranges.iter().map(|range| [range.start as u32, range.end as u32]).collect();
        let has_patches = model.patches.count() > 0;
        // In whole texels.
        let bytes = (4 * vertices.max(1)).next_multiple_of(16) as u64;
        let [depths, pressures, energies, distances]: [Result<Buffer>; 4] =
            Field::ALL.map(|field| Ok(Buffer::shared(context, field.name(), bytes)?.known_as(roles(field))));
        let most = |field: Field| -> Result<Buffer> {
            let name = format!("greatest {}", field.name());
            let most = Buffer::new(context, &name, (4 * rows.len().max(1)) as u64, Memory::Readback)?;
            Ok(most.known_as(&["most"]))
        };
        let [most_depths, most_pressures, most_energies, most_distances] = Field::ALL.map(most);
        Ok(Fields {
            touched: touch.map(touched).transpose()?,
            energy: group(
                "draw/energy",
                &[
                    ("TETRAHEDRA", count(model.tetrahedra.len())),
                    ("SPANS", model.spans_frames().into()),
                    ("PATCHES", has_patches.into()),
                    ("LAWS", material_law::laws_of(&model.materials).into()),
                ],
            )?,
            share: has_patches.then(share).transpose()?,
            mean: group("draw/mean", &[("NODES", count(nodes))])?,
            spread: group("draw/spread", &[])?,
            moved: group("draw/moved", &[])?,
            most: Kernel::new(context, "draw/most", Size::Reduce, &[])?,
            node_first: upload(context, "node_first", &node_first)?,
            node_tetrahedra: upload(context, "node_tetrahedra", &node_tetrahedra)?,
            densities: array::<[f32; 4]>(context, "densities", model.tetrahedra.len())?,
            node_values: array::<f32>(context, "node_values", nodes)?,
            ranges: upload(context, "ranges", &rows)?,
            is_solved: Buffer::new(context, "is_solved", 4, Memory::Upload)?,
            values: [depths?, pressures?, energies?, distances?],
            most_values: [most_depths?, most_pressures?, most_energies?, most_distances?],
        })
    }

    /// Fills the array of a field, and the greatest of each body; depth and pressure come together. `touch`: as when this was
    /// made.
    pub fn record(
        &self,
        recorder: &mut Recorder,
        field: Field,
        draw: &Draw,
        common: &Common,
        elastic: &Elastic,
        touch: Option<&Touch>,
    ) {
        recorder.stage("draw");
        let both = [Field::Depth, Field::Pressure];
        let filled = if both.contains(&field) { &both[..] } else { &[field] };
        match field {
            Field::Depth | Field::Pressure => self.record_touched(recorder, common, touch, &draw.triangles),
            _ => self.record_onto(recorder, field, draw, elastic, &draw.points, &self.values[field as usize]),
        }
        for field in filled {
            let (values, most) = (&self.values[*field as usize], &self.most_values[*field as usize]);
            self.record_most(recorder, &self.ranges, values, most);
        }
    }

    /// Fills an array of other vertices that ride on nodes: with the field there, or with zeros where contacts make it.
    pub fn record_onto(
        &self,
        recorder: &mut Recorder,
        field: Field,
        draw: &Draw,
        elastic: &Elastic,
        points: &Points,
        values: &Buffer,
    ) {
        recorder.stage("draw");
        match field {
            Field::Depth | Field::Pressure => recorder.fill(values, 0),
            Field::StrainEnergy => {
                self.record_energy(recorder, draw, elastic);
                let arguments = shaders::draw::Spread {
                    vertices: points.count,
                    skin_nodes: &points.nodes,
                    skin_weights: &points.weights,
                    node_values: &self.node_values,
                    values,
                };
                recorder.dispatch(&self.spread, &arguments, points.count);
            }
            Field::Displacement => {
                let arguments = shaders::draw::Moved {
                    vertices: points.count,
                    frames: &draw.frames,
                    skin_nodes: &points.nodes,
                    skin_weights: &points.weights,
                    displacement: &elastic.displacement,
                    node_info: &elastic.node_info,
                    values,
                };
                recorder.dispatch(&self.moved, &arguments, points.count);
            }
        }
    }

    /// The greatest of each of these ranges, two u32 each.
    pub fn record_most(&self, recorder: &mut Recorder, ranges: &Buffer, values: &Buffer, most: &Buffer) {
        let arguments = shaders::draw::Most { ranges, values, most };
        recorder.dispatch_groups(&self.most, &arguments, (ranges.bytes() / 8) as u32);
    }

    fn record_touched(&self, recorder: &mut Recorder, common: &Common, touch: Option<&Touch>, triangles: &Buffer) {
        let [depths, pressures, ..] = &self.values;
        recorder.fill(depths, 0);
        recorder.fill(pressures, 0);
        let (Some(touched), Some(touch)) = (&self.touched, touch) else { return };
        let capacity = touch.contacts.bytes() as usize / size_of::<Contact>();
        let arguments = shaders::draw::Touched {
            params: &common.params,
            counts: &common.counts,
            contacts: &touch.contacts,
            contact_forces: &touch.contact_forces,
            triangles,
            is_solved: &self.is_solved,
            depths,
            pressures,
        };
        recorder.dispatch(touched, &arguments, capacity as u32);
    }

    /// To the nodes.
    fn record_energy(&self, recorder: &mut Recorder, draw: &Draw, elastic: &Elastic) {
        let arguments = shaders::draw::Energy {
            materials: &elastic.materials,
            tetrahedra: &elastic.tetrahedra,
            rest_gradients: &elastic.rest_gradients,
            element_info: &elastic.element_info,
            displacement: &elastic.displacement,
            tetrahedron_links: elastic.tetrahedron_links.as_ref(),
            node_rest: Some(&elastic.node_rest),
            links: Some(&draw.links),
            patch_of: elastic.dilate.as_ref().map(|dilate| &dilate.patch_of),
            rotations: &elastic.rotations,
            densities: &self.densities,
        };
        recorder.dispatch(&self.energy, &arguments, elastic.tetrahedron_count as u32);
        if let Some(patches) = &self.share {
            let arguments = shaders::draw::Share {
                patch_first: &patches.first,
                patch_members: &patches.members,
                densities: &self.densities,
            };
            recorder.dispatch(&patches.kernel, &arguments, patches.count);
        }
        let arguments = shaders::draw::Mean {
            node_first: &self.node_first,
            node_tetrahedra: &self.node_tetrahedra,
            densities: &self.densities,
            node_values: &self.node_values,
        };
        recorder.dispatch(&self.mean, &arguments, elastic.node_count as u32);
    }
}
