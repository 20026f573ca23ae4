//! Scalar fields that are shown as colours on the skins (surface meshes): contact depth and pressure, strain energy,
//! displacement, stress. The fields are computed from the state that a step leaves, without changing it. A frame is a rigid
//! coordinate frame, a core a rigid body inside a soft one, to which nodes are attached.

use std::ops::Range;
use std::sync::Arc;

use super::super::contact::Touch;
use super::super::elastic::Elastic;
use super::super::model::Model;
use super::super::{Common, array, count, upload};
use super::elements::{ElementFields, group};
use super::{Draw, Points, lists};
use crate::Result;
use crate::gpu::{Buffer, Context, Kernel, Memory, Recorder, Size};
use crate::shaders;
use crate::shaders::Contact;

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
    /// Von Mises's stress, Pa, of Cauchy's stress in the tetrahedra, taken to the skin as the strain energy density is.
    VonMises,
    /// Hydrostatic pressure, Pa: minus a third of the trace of Cauchy's stress in the tetrahedra, where that is positive;
    /// zero in a tetrahedron under tension. It is taken to the skin as the strain energy density is.
    Hydrostatic,
}

/// Number of fields.
pub const FIELDS: usize = 6;

impl Field {
    /// All fields.
    pub const ALL: [Field; FIELDS] =
        [Field::Depth, Field::Pressure, Field::StrainEnergy, Field::Displacement, Field::VonMises, Field::Hydrostatic];

    /// Name of the field.
    pub fn name(self) -> &'static str {
        match self {
            Field::Depth => "penetration depth",
            Field::Pressure => "pressure",
            Field::StrainEnergy => "strain energy density",
            Field::Displacement => "displacement",
            Field::VonMises => "von Mises stress",
            Field::Hydrostatic => "hydrostatic pressure",
        }
    }

    /// Unit of the field's values.
    pub fn unit(self) -> &'static str {
        match self {
            Field::Depth | Field::Displacement => "m",
            Field::Pressure | Field::VonMises | Field::Hydrostatic => "Pa",
            Field::StrainEnergy => "J/m^3",
        }
    }
}

/// Kernels and arrays of the fields.
pub struct Fields {
    touched: Option<Kernel>,
    /// Energy and stress of the tetrahedra.
    pub elements: ElementFields,
    /// Means of strain energy density, of von Mises's stress and of hydrostatic pressure.
    means: [Kernel; 3],
    spread: Kernel,
    moved: Kernel,
    most: Kernel,
    node_first: Buffer,
    node_tetrahedra: Buffer,
    node_values: Buffer,
    ranges: Buffer,
    /// One u32, written by the host: whether the GPU still holds the contact forces that the solver applied in the last
    /// step.
    pub is_solved: Buffer,
    /// One float per skin vertex; an array for each [`Field`].
    pub values: [Buffer; FIELDS],
    /// One float per body, the tool's last: the greatest value of its vertices; an array for each [`Field`].
    pub most_values: [Buffer; FIELDS],
}

/// Names by which kernels may bind a field's array. The kernel for contacts writes depths and pressures at once and
/// binds each array by a name of its own.
fn roles(field: Field) -> &'static [&'static str] {
    match field {
        Field::Depth => &["depths", "values"],
        Field::Pressure => &["pressures", "values"],
        _ => &["values"],
    }
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
        let touched = |touch: &Touch| {
            let capacity = touch.contacts.bytes() as usize / size_of::<Contact>();
            group(context, "draw/touched", &[("CAPACITY", count(capacity))])
        };
        let mean = |[texels, texel, component]: [u32; 3]| {
            let place = [("TEXELS", texels.into()), ("TEXEL", texel.into()), ("COMPONENT", component.into())];
            group(context, "draw/mean", &[&[("NODES", count(nodes))], &place[..]].concat())
        };
        let [energies_mean, von_mises_mean, hydrostatic_mean] = [[1, 0, 0], [2, 0, 3], [2, 1, 3]].map(mean);
        let rows: Vec<[u32; 2]> = ranges.iter().map(|range| [range.start as u32, range.end as u32]).collect();
        // The arrays are padded to whole texels of 16 bytes.
        let bytes = (4 * vertices.max(1)).next_multiple_of(16) as u64;
        let values = |field: Field| Ok(Buffer::shared(context, field.name(), bytes)?.known_as(roles(field)));
        let most = |field: Field| -> Result<Buffer> {
            let name = format!("greatest {}", field.name());
            let most = Buffer::new(context, &name, (4 * rows.len().max(1)) as u64, Memory::Readback)?;
            Ok(most.known_as(&["most"]))
        };
        Ok(Fields {
            touched: touch.map(touched).transpose()?,
            elements: ElementFields::new(context, model)?,
            means: [energies_mean?, von_mises_mean?, hydrostatic_mean?],
            spread: group(context, "draw/spread", &[])?,
            moved: group(context, "draw/moved", &[])?,
            most: Kernel::new(context, "draw/most", Size::Reduce, &[])?,
            node_first: upload(context, "node_first", &node_first)?,
            node_tetrahedra: upload(context, "node_tetrahedra", &node_tetrahedra)?,
            node_values: array::<f32>(context, "node_values", nodes)?,
            ranges: upload(context, "ranges", &rows)?,
            is_solved: Buffer::new(context, "is_solved", 4, Memory::Upload)?,
            values: of_all(values)?,
            most_values: of_all(most)?,
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
            Field::StrainEnergy | Field::VonMises | Field::Hydrostatic => {
                self.record_mean(recorder, field, draw, elastic);
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

    /// Records the passes that compute a field of the tetrahedra at the nodes.
    fn record_mean(&self, recorder: &mut Recorder, field: Field, draw: &Draw, elastic: &Elastic) {
        match field {
            Field::StrainEnergy => self.elements.record_energy(recorder, draw, elastic),
            _ => self.elements.record_all(recorder, draw, elastic),
        }
        let (densities, stresses) = (&self.elements.densities, &self.elements.stresses);
        let (mean, numbers) = match field {
            Field::VonMises => (&self.means[1], stresses),
            Field::Hydrostatic => (&self.means[2], stresses),
            _ => (&self.means[0], densities),
        };
        let arguments = shaders::draw::Mean {
            node_first: &self.node_first,
            node_tetrahedra: &self.node_tetrahedra,
            numbers,
            densities,
            node_values: &self.node_values,
        };
        recorder.dispatch(mean, &arguments, elastic.node_count as u32);
    }
}

/// One item for each field.
pub fn of_all<T>(make: impl Fn(Field) -> Result<T>) -> Result<[T; FIELDS]> {
    let [a, b, c, d, e, f] = Field::ALL.map(make);
    Ok([a?, b?, c?, d?, e?, f?])
}
