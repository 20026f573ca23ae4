//! Elastic: the layers' state, element rotations, forces and rotated gradients.

use std::sync::Arc;

use super::dilate::Dilate;
use super::model::Model;
use super::{Common, count, upload, zeros};
use crate::Result;
use crate::gpu::{Buffer, Const, Context, Kernel, Recorder, Size};
use crate::prepare::patch::MOST_NODES;

/// Nodes, tetrahedra and their state.
pub struct Elastic {
    rotate: Kernel,
    /// Patches, if there are any.
    pub dilate: Option<Dilate>,
    /// Tetrahedra.
    pub tetrahedron_count: usize,
    /// Nodes.
    pub node_count: usize,
    materials: Buffer,
    /// Four nodes a tetrahedron.
    pub tetrahedra: Buffer,
    /// Where something spans frames.
    tetrahedron_links: Option<Buffer>,
    /// Three a tetrahedron, rest axes, and the square root of its volume.
    pub(super) rest_gradients: Buffer,
    /// Position in the frame, mass.
    pub node_rest: Buffer,
    /// First quad of elements, quads, frame, and who holds it, as in shaders/shared/held.glsl.
    pub node_info: Buffer,
    /// Entries into element forces, four a texel.
    pub node_elements: Buffer,
    /// State: displacement from rest, frame axes, m.
    pub displacement: Buffer,
    /// State: velocity, world axes, m/s.
    pub velocity: Buffer,
    /// State: rotation of each tetrahedron, kept as the next start.
    pub rotations: Buffer,
    /// Three a tetrahedron, world axes.
    pub gradients: Buffer,
    /// Four a tetrahedron, four zeros, and twelve a patch.
    pub element_forces: Buffer,
}

impl Elastic {
    /// Kernels and arrays for a model, at rest.
    pub fn new(context: &Arc<Context>, model: &Model) -> Result<Elastic> {
        let (nodes, tetrahedra) = (model.node_rest.len(), model.tetrahedra.len());
        let patches = model.patches.count();
        let constants = [
            ("TETRAHEDRA", count(tetrahedra)),
            ("SPANS", Const::Bool(model.spans_frames())),
            ("PATCHES", Const::Bool(patches > 0)),
            ("NEO_HOOKEAN", Const::Bool(model.has_neo_hookean())),
        ];
        let links = || upload(context, "links of tetrahedra", &model.tetrahedron_links);
        Ok(Elastic {
            dilate: (patches > 0).then(|| Dilate::new(context, &model.patches)).transpose()?,
            rotate: Kernel::new(context, "elastic/rotate", Size::Group, &constants)?,
            tetrahedron_count: tetrahedra,
            node_count: nodes,
            materials: upload(context, "materials", &model.materials)?,
            tetrahedra: upload(context, "tetrahedra", &model.tetrahedra)?,
            tetrahedron_links: model.spans_frames().then(links).transpose()?,
            rest_gradients: upload(context, "gradients at rest", &model.rest_gradients)?,
            node_rest: upload(context, "nodes at rest", &model.node_rest)?,
            node_info: upload(context, "node info", &model.node_info)?,
            node_elements: upload(context, "elements of nodes", &model.padded_node_elements())?,
            displacement: zeros::<[f32; 4]>(context, "displacement", nodes)?,
            velocity: upload(context, "velocity", &model.velocity)?,
            rotations: upload(context, "rotations", &vec![[0.0f32, 0.0, 0.0, 1.0]; tetrahedra.max(1)])?,
            gradients: zeros::<[f32; 4]>(context, "gradients", 3 * (tetrahedra + 1))?,
            element_forces: zeros::<[f32; 4]>(context, "element forces", 4 * (tetrahedra + 1) + MOST_NODES * patches)?,
        })
    }

    /// One pass over tetrahedra, and one over patches.
    pub fn record(&self, recorder: &mut Recorder, common: &Common) {
        recorder.stage("elastic");
        recorder.dispatch(
            &self.rotate,
            &[
                &common.params,
                &common.frames,
                &self.materials,
                &self.tetrahedra,
                &self.rest_gradients,
                &self.displacement,
                &self.velocity,
                // Where nothing spans frames nobody reads of them.
                self.tetrahedron_links.as_ref().unwrap_or(&self.tetrahedra),
                &self.node_rest,
                &common.links,
                // Without patches nobody reads of them.
                self.dilate.as_ref().map_or(&self.tetrahedra, |dilate| &dilate.patch_of),
                &self.rotations,
                &self.gradients,
                &self.element_forces,
            ],
            &[],
            self.tetrahedron_count as u32,
        );
        if let Some(dilate) = &self.dilate {
            dilate.record(recorder, common, self);
        }
    }
}
