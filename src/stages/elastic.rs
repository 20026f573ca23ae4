//! Elastic: the layers' state, element rotations, forces and rotated gradients.

use std::mem::offset_of;
use std::sync::Arc;

use super::dilate::Dilate;
use super::material_law;
use super::model::Model;
use super::solve::Solve;
use super::{Common, count, upload, zeros};
use crate::Result;
use crate::gpu::{Buffer, Const, Context, Kernel, Recorder, Size};
use crate::prepare::patch::MOST_NODES;
use crate::shaders;
use crate::shaders::Counts;

/// Nodes, tetrahedra and their state.
pub struct Elastic {
    rotate: Kernel,
    again: Option<Again>,
    /// Patches, if there are any.
    pub dilate: Option<Dilate>,
    /// Tetrahedra.
    pub tetrahedron_count: usize,
    /// Nodes.
    pub node_count: usize,
    pub(super) materials: Buffer,
    /// Four nodes a tetrahedron.
    pub tetrahedra: Buffer,
    /// Where something spans frames.
    pub(super) tetrahedron_links: Option<Buffer>,
    /// Three a tetrahedron, rest axes, and the square root of its volume.
    pub(super) rest_gradients: Buffer,
    /// Material and frame of each tetrahedron.
    pub(super) element_info: Buffer,
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

/// What a step needs besides that is linearised more than once.
struct Again {
    trial: Kernel,
    rotate: Kernel,
    /// Where the last solve would take each node, frame axes at the start, m.
    displacement: Buffer,
    /// Its change of velocity, world axes, m/s.
    change: Buffer,
}

impl Elastic {
    /// Kernels and arrays for a model, at rest.
    pub fn new(context: &Arc<Context>, model: &Model) -> Result<Elastic> {
        let (nodes, tetrahedra) = (model.node_rest.len(), model.tetrahedra.len());
        let patches = model.patches.count();
        let constants = |again: bool| {
            [
                ("AGAIN", Const::Bool(again)),
                ("TETRAHEDRA", count(tetrahedra)),
                ("SPANS", Const::Bool(model.spans_frames())),
                ("PATCHES", Const::Bool(patches > 0)),
                ("LAWS", Const::Uint(material_law::laws_of(&model.materials))),
            ]
        };
        let rotate = |again: bool| Kernel::new(context, "elastic/rotate", Size::Group, &constants(again));
        let rigids = ("RIGIDS", count(model.cores.len() + usize::from(model.tool_frame.is_some())));
        let again = || -> Result<Again> {
            Ok(Again {
                trial: Kernel::new(context, "elastic/trial", Size::Group, &[("NODES", count(nodes)), rigids])?,
                rotate: rotate(true)?,
                displacement: zeros::<[f32; 4]>(context, "trial_displacement", nodes)?
                    .known_as(&["trial_displacement", "displacement"]),
                change: zeros::<[f32; 4]>(context, "trial_change", nodes)?,
            })
        };
        let repeats = model.newton > 1;
        let links = || upload(context, "tetrahedron_links", &model.tetrahedron_links);
        Ok(Elastic {
            dilate: (patches > 0).then(|| Dilate::new(context, &model.patches, repeats)).transpose()?,
            again: repeats.then(again).transpose()?,
            rotate: rotate(false)?,
            tetrahedron_count: tetrahedra,
            node_count: nodes,
            materials: upload(context, "materials", &model.materials)?,
            tetrahedra: upload(context, "tetrahedra", &model.tetrahedra)?,
            tetrahedron_links: model.spans_frames().then(links).transpose()?,
            rest_gradients: upload(context, "rest_gradients", &model.rest_gradients)?,
            element_info: upload(context, "element_info", &model.element_info)?,
            node_rest: upload(context, "node_rest", &model.node_rest)?,
            node_info: upload(context, "node_info", &model.node_info)?,
            node_elements: upload(context, "node_elements", &model.padded_node_elements())?,
            displacement: zeros::<[f32; 4]>(context, "displacement", nodes)?,
            velocity: upload(context, "velocity", &model.velocity)?,
            rotations: upload(context, "rotations", &vec![[0.0f32, 0.0, 0.0, 1.0]; tetrahedra.max(1)])?,
            gradients: zeros::<[f32; 4]>(context, "gradients", 3 * (tetrahedra + 1))?,
            element_forces: zeros::<[f32; 4]>(context, "element_forces", 4 * (tetrahedra + 1) + MOST_NODES * patches)?,
        })
    }

    /// Takes up the materials and masses of a model of the same bodies.
    pub fn refresh(&self, model: &Model) -> Result<()> {
        self.materials.write(&model.materials)?;
        self.node_rest.write(&model.node_rest)?;
        self.dilate.as_ref().map_or(Ok(()), |dilate| dilate.refresh(&model.patches))
    }

    /// What a step leaves for the next.
    pub fn state(&self) -> [&Buffer; 3] {
        [&self.displacement, &self.velocity, &self.rotations]
    }

    /// Whether a step may be linearised again.
    pub fn repeats(&self) -> bool {
        self.again.is_some()
    }

    /// No flag is raised yet: of scenes where nothing can touch, since elsewhere the pose stage does it.
    pub fn record_reset(&self, recorder: &mut Recorder, common: &Common) {
        // Without tetrahedra nothing after this raises any.
        if self.tetrahedron_count > 0 {
            recorder.stage("elastic");
            recorder.fill_range(&common.counts, offset_of!(Counts, flags) as u64, 4, 0);
        }
    }

    /// One pass over tetrahedra, and one over patches.
    pub fn record(&self, recorder: &mut Recorder, common: &Common) {
        self.record_at(recorder, common, None);
    }

    /// Where the last solve would take the nodes: one pass over them. Only of a step that is linearised more than once.
    pub fn record_trial(&self, recorder: &mut Recorder, common: &Common, solve: &Solve) {
        let Some(again) = &self.again else { return };
        recorder.stage("elastic");
        recorder.dispatch(
            &again.trial,
            &shaders::elastic::Trial {
                params: &common.params,
                frames: &common.frames,
                node_info: &self.node_info,
                node_rest: Some(&self.node_rest),
                displacement: &self.displacement,
                velocity: &self.velocity,
                solution: &solve.solution,
                solve: Some(&solve.state),
                iterates: Some(&solve.iterates),
                trial_displacement: &again.displacement,
                trial_change: &again.change,
            },
            self.node_count as u32,
        );
    }

    /// As [`Elastic::record`], at the trial.
    pub fn record_again(&self, recorder: &mut Recorder, common: &Common) {
        self.record_at(recorder, common, self.again.as_ref());
    }

    fn record_at(&self, recorder: &mut Recorder, common: &Common, again: Option<&Again>) {
        recorder.stage("elastic");
        recorder.dispatch(
            again.map_or(&self.rotate, |again| &again.rotate),
            &shaders::elastic::Rotate {
                params: &common.params,
                frames: &common.frames,
                materials: &self.materials,
                tetrahedra: &self.tetrahedra,
                rest_gradients: &self.rest_gradients,
                element_info: &self.element_info,
                displacement: again.map_or(&self.displacement, |again| &again.displacement),
                velocity: &self.velocity,
                tetrahedron_links: self.tetrahedron_links.as_ref(),
                node_rest: Some(&self.node_rest),
                links: Some(&common.links),
                patch_of: self.dilate.as_ref().map(|dilate| &dilate.patch_of),
                trial_change: again.map(|again| &again.change),
                rotations: &self.rotations,
                gradients: &self.gradients,
                counts: &common.counts,
                element_forces: &self.element_forces,
            },
            self.tetrahedron_count as u32,
        );
        if let Some(dilate) = &self.dilate {
            dilate.record(recorder, common, self, again.map(|again| &again.change));
        }
    }
}
