//! Scalar fields that are shown as colours on the skins (surface meshes): contact depth and pressure, strain energy,
//! displacement. The fields are computed from the state that a step leaves, without changing it. A frame is a rigid
//! coordinate frame, a core a rigid body inside a soft one, to which nodes are attached.

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

/// A scalar field to colour the skins by. Its values are finite and never negative.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Field {
    /// How deep a vertex was in another body at the start of the last step, m; zero without a contact. A contact is
    /// found at a vertex of either skin; it counts for that vertex and for the three corners of the triangle that the
    /// vertex's ray along the contact normal hits. Of several contacts of a vertex the deepest is shown.
    Depth,
    /// Pressure of the last step's contacts at the end of the step, Pa; a contact's pressure times its area is the
    /// contact force along its normal. Pressure is shown at the same vertices as depth; of several contacts of a vertex
    /// the one with the greatest pressure is shown. After a saved state was restored, and until the next step, the
    /// field is the pressure at the start of the last step.
    Pressure,
    /// Strain energy density of the tetrahedral mesh in which the skin is embedded, J/m^3, by the law of each
    /// tetrahedron's material: averaged by volume around each node, and interpolated to the skin by its embedding
    /// weights. Zero on rigid bodies.
    StrainEnergy,
    /// Distance, m, by which deformation has moved a vertex from where it would be if its nodes were attached rigidly
    /// to their frames (those of the body's cores, or, in a body without cores, a floating frame, which is fitted to
    /// the body's nodes). Rigid motion of the whole body is no part of it; in a body with fixed cores the field is the
    /// distance from the vertex's place at rest. Zero on rigid bodies.
    Displacement,
}

impl Field {
    /// All fields.
    pub const ALL: [Field; 4] = [Field::Depth, Field::Pressure, Field::StrainEnergy, Field::Displacement];

    /// Name of the field.
    pub fn name(self) -> &'static str {
        match self {
            Field::Depth => "penetration depth",
            Field::Pressure => "pressure",
            Field::StrainEnergy => "strain energy density",
            Field::Displacement => "displacement",
        }
    }

    /// Unit of the field's values.
    pub fn unit(self) -> &'static str {
        match self {
            Field::Depth | Field::Displacement => "m",
            Field::Pressure => "Pa",
            Field::StrainEnergy => "J/m^3",
        }
    }
}

/// Kernels and arrays of the fields.
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
    /// One u32, written by the host: whether the GPU still holds the contact forces that the solver applied in the last
    /// step.
    pub is_solved: Buffer,
    /// One float per skin vertex; an array for each [`Field`].
    pub values: [Buffer; 4],
    /// One float per body, the tool's last: the greatest value of its vertices; an array for each [`Field`].
    pub most_values: [Buffer; 4],
}

/// Names by which kernels may bind a field's array. The kernel for contacts writes depths and pressures at once and
/// binds each array by a name of its own.
fn roles(field: Field) -> &'static [&'static str] {
    match field {
        Field::Depth => &["depths", "values"],
        Field::Pressure => &["pressures", "values"],
        Field::StrainEnergy | Field::Displacement => &["values"],
    }
}

/// The F-bar patches (groups of tetrahedra that share one volumetric strain), with the kernel that adds the energy of
/// this strain.
struct Patches {
    kernel: Kernel,
    count: u32,
    first: Buffer,
    members: Buffer,
}

impl Fields {
    /// Kernels and arrays for a model. `ranges`: for each body the range of its vertices among the skin vertices of all
    /// bodies; `touch`: the contact arrays, where anything can touch.
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
        // The arrays are padded to whole texels of 16 bytes.
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

    /// Records the passes that fill a field's array in `values` and its array in `most_values`; depth and pressure are
    /// filled together. `touch` must be the contact arrays that [`Fields::new`] was given.
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

    /// Records the passes that fill `values` for the vertices of another mesh, which are attached to nodes: with the
    /// field's values at these vertices, or with zeros where the field is defined by contacts.
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

    /// Records one pass that finds the greatest of the `values` in each of the `ranges`. A range is two u32: its first
    /// index, and the index after its last one.
    pub fn record_most(&self, recorder: &mut Recorder, ranges: &Buffer, values: &Buffer, most: &Buffer) {
        let arguments = shaders::draw::Most { ranges, values, most };
        recorder.dispatch_groups(&self.most, &arguments, (ranges.bytes() / 8) as u32);
    }

    fn record_touched(&self, recorder: &mut Recorder, common: &Common, touch: Option<&Touch>, triangles: &Buffer) {
        recorder.upload(&self.is_solved);
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

    /// Records the passes that compute the strain energy density at the nodes.
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
            patch_of: elastic.mean_dilatation.as_ref().map(|mean_dilatation| &mean_dilatation.patch_of),
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
