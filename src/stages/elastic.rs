//! Elastic stage, between the contact stage and the solver in a step: holds the state of the tetrahedral meshes
//! (layers) of soft bodies, and computes, of each tetrahedron that can deform, rotation, forces, and shape function
//! gradients, rotated into world axes, from which the solver computes the elements' part of its matrix-vector products.
//! A frame is a rigid coordinate frame in which displacements of nodes are measured; a link is the relative placement
//! of two frames.

use std::mem::offset_of;
use std::sync::Arc;

use super::material_law;
use super::mean_dilatation::MeanDilatation;
use super::model::Model;
use super::solve::Solve;
use super::{Common, count, upload, zeros};
use crate::Result;
use crate::gpu::{Buffer, Const, Context, Kernel, Recorder, Size};
use crate::prepare::patch::MOST_NODES;
use crate::shaders;
use crate::shaders::Counts;

/// The nodes and tetrahedra, their state, and the kernels of the stage.
pub struct Elastic {
    forces_kernel: Kernel,
    newton: Option<Newton>,
    /// The F-bar patches (tetrahedra that share one volumetric strain), if there are any.
    pub mean_dilatation: Option<MeanDilatation>,
    /// Number of tetrahedra.
    pub tetrahedron_count: usize,
    /// Number of nodes.
    pub node_count: usize,
    pub(super) materials: Buffer,
    /// Four nodes per tetrahedron.
    pub tetrahedra: Buffer,
    /// Per tetrahedron: links from its frame (that of its first node) to the frames of its four nodes; present only
    /// where some tetrahedra have nodes in several frames.
    pub(super) tetrahedron_links: Option<Buffer>,
    /// Three per tetrahedron: rest gradients of its last three nodes' shape functions (1/m); w of the first is the
    /// square root of the tetrahedron's volume (in m^3).
    pub(super) rest_gradients: Buffer,
    /// Per tetrahedron: its material and frame.
    pub(super) element_info: Buffer,
    /// The tetrahedra that can deform; see [`Model::deforming`].
    deforming: Buffer,
    deforming_count: u32,
    /// Per node: rest position relative to its frame's centre (m), and mass (kg).
    pub node_rest: Buffer,
    /// Per node: its first quad (uvec4) in `node_elements`, number of quads, frame, and what decides its motion, as in
    /// shaders/shared/node_motion.glsl.
    pub node_info: Buffer,
    /// Indices of the elements of `element_forces` that add up at each node, node by node, four per texel (uvec4).
    pub node_elements: Buffer,
    /// State: displacement of each node from rest, axes of its frame, m.
    pub displacement: Buffer,
    /// State: velocity of each node, world axes, m/s.
    pub velocity: Buffer,
    /// State: rotation of each tetrahedron (quaternion); the next step starts its search for the new rotation from this
    /// one.
    pub rotations: Buffer,
    /// `GRADIENT_TEXELS` per tetrahedron: the gradients of its shape functions (as in `rest_gradients`), rotated into
    /// world axes, and its geometric stiffness.
    pub gradients: Buffer,
    /// Forces of elements on nodes, as impulses (N s): four vectors per tetrahedron, four zero vectors, and twelve
    /// vectors per F-bar patch.
    pub element_forces: Buffer,
}

/// Kernels and arrays that only steps with several Newton iterations need.
struct Newton {
    trial: Kernel,
    forces_kernel: Kernel,
    /// Per node: its displacement at the end of the step according to the last solve, in the axes of its frame at the
    /// step's start, m.
    displacement: Buffer,
    /// Per node: its change of velocity according to the last solve, world axes, m/s.
    change: Buffer,
    /// Per node: residual b - A x of the last solve, N s.
    linear_residual: Buffer,
}

impl Elastic {
    /// Kernels and arrays for a model, with all nodes at their rest positions.
    pub fn new(context: &Arc<Context>, model: &Model) -> Result<Elastic> {
        let (nodes, tetrahedra) = (model.node_rest.len(), model.tetrahedra.len());
        let patches = model.patches.count();
        let texels = shaders::GRADIENT_TEXELS as usize;
        let constants = |newton: bool| {
            [
                ("NEWTON", Const::Bool(newton)),
                ("ELEMENTS", count(model.deforming.len())),
                ("SPANS", Const::Bool(model.spans_frames())),
                ("PATCHES", Const::Bool(patches > 0)),
                ("LAWS", Const::Uint(material_law::laws_of(&model.materials))),
            ]
        };
        let forces_kernel =
            |newton: bool| Kernel::new(context, "elastic/element_forces", Size::Group, &constants(newton));
        let rigids = ("RIGIDS", count(model.rigid_count()));
        let newton = || -> Result<Newton> {
            Ok(Newton {
                trial: Kernel::new(context, "elastic/trial", Size::Group, &[("NODES", count(nodes)), rigids])?,
                forces_kernel: forces_kernel(true)?,
                displacement: zeros::<[f32; 4]>(context, "trial_displacement", nodes)?
                    .known_as(&["trial_displacement", "displacement"]),
                change: zeros::<[f32; 4]>(context, "trial_change", nodes)?,
                linear_residual: zeros::<[f32; 4]>(context, "linear_residual", nodes)?,
            })
        };
        let repeats = model.newton > 1;
        let links = || upload(context, "tetrahedron_links", &model.tetrahedron_links);
        Ok(Elastic {
            mean_dilatation: (patches > 0)
                .then(|| MeanDilatation::new(context, &model.patches, repeats))
                .transpose()?,
            newton: repeats.then(newton).transpose()?,
            forces_kernel: forces_kernel(false)?,
            tetrahedron_count: tetrahedra,
            node_count: nodes,
            materials: upload(context, "materials", &model.materials)?,
            tetrahedra: upload(context, "tetrahedra", &model.tetrahedra)?,
            tetrahedron_links: model.spans_frames().then(links).transpose()?,
            rest_gradients: upload(context, "rest_gradients", &model.rest_gradients)?,
            element_info: upload(context, "element_info", &model.element_info)?,
            deforming: upload(context, "deforming", &model.deforming)?,
            deforming_count: model.deforming.len() as u32,
            node_rest: upload(context, "node_rest", &model.node_rest)?,
            node_info: upload(context, "node_info", &model.node_info)?,
            node_elements: upload(context, "node_elements", &model.padded_node_elements())?,
            displacement: zeros::<[f32; 4]>(context, "displacement", nodes)?,
            velocity: upload(context, "velocity", &model.velocity)?,
            rotations: upload(context, "rotations", &vec![[0.0f32, 0.0, 0.0, 1.0]; tetrahedra.max(1)])?,
            gradients: zeros::<[f32; 4]>(context, "gradients", texels * (tetrahedra + 1))?,
            element_forces: zeros::<[f32; 4]>(context, "element_forces", 4 * (tetrahedra + 1) + MOST_NODES * patches)?,
        })
    }

    /// Writes the materials and masses of a model of the same bodies to the GPU.
    pub fn refresh(&self, model: &Model) -> Result<()> {
        self.materials.write(&model.materials)?;
        self.node_rest.write(&model.node_rest)?;
        self.mean_dilatation.as_ref().map_or(Ok(()), |mean_dilatation| mean_dilatation.refresh(&model.patches))
    }

    /// The arrays that a step leaves for the next.
    pub fn state(&self) -> [&Buffer; 3] {
        [&self.displacement, &self.velocity, &self.rotations]
    }

    /// Residual b - A x of the last Newton iteration's solve, per node, where steps have several.
    pub(super) fn linear_residual(&self) -> Option<&Buffer> {
        self.newton.as_ref().map(|newton| &newton.linear_residual)
    }

    /// Whether steps may have several Newton iterations.
    pub fn repeats(&self) -> bool {
        self.newton.is_some()
    }

    /// Clears the flags, bits by which kernels report problems of a step, in scenes where nothing can touch; in other
    /// scenes the first stage of contact, pose, clears them.
    pub fn record_reset(&self, recorder: &mut Recorder, common: &Common) {
        // Where nothing can touch, only passes over tetrahedra raise flags in `counts`.
        if self.tetrahedron_count > 0 {
            recorder.stage("elastic");
            recorder.fill_range(&common.counts, offset_of!(Counts, flags) as u64, 4, 0);
        }
    }

    /// Records one pass over the tetrahedra, and one over the F-bar patches if there are any.
    pub fn record(&self, recorder: &mut Recorder, common: &Common) {
        self.record_at(recorder, common, None);
    }

    /// Records one pass over the nodes that computes their displacements at the end of the step according to the last
    /// solve, for the next Newton iteration. Records nothing where a step has only one Newton iteration.
    pub fn record_trial(&self, recorder: &mut Recorder, common: &Common, solve: &Solve) {
        let Some(newton) = &self.newton else { return };
        recorder.stage("elastic");
        recorder.dispatch(
            &newton.trial,
            &shaders::elastic::Trial {
                params: &common.params,
                frames: &common.frames,
                node_info: &self.node_info,
                node_rest: Some(&self.node_rest),
                displacement: &self.displacement,
                velocity: &self.velocity,
                solution: &solve.solution,
                rhs: &solve.rhs,
                operator_product: &solve.operator_product,
                solve: Some(&solve.state),
                iterates: Some(&solve.iterates),
                trial_displacement: &newton.displacement,
                trial_change: &newton.change,
                linear_residual: &newton.linear_residual,
            },
            self.node_count as u32,
        );
    }

    /// Records the passes of [`Elastic::record`] for a further Newton iteration, at the displacements that the pass of
    /// [`Elastic::record_trial`] computes.
    pub fn record_newton(&self, recorder: &mut Recorder, common: &Common) {
        self.record_at(recorder, common, self.newton.as_ref());
    }

    fn record_at(&self, recorder: &mut Recorder, common: &Common, newton: Option<&Newton>) {
        recorder.stage("elastic");
        recorder.dispatch(
            newton.map_or(&self.forces_kernel, |newton| &newton.forces_kernel),
            &shaders::elastic::ElementForces {
                params: &common.params,
                frames: &common.frames,
                materials: &self.materials,
                tetrahedra: &self.tetrahedra,
                rest_gradients: &self.rest_gradients,
                deforming: &self.deforming,
                displacement: newton.map_or(&self.displacement, |newton| &newton.displacement),
                velocity: &self.velocity,
                tetrahedron_links: self.tetrahedron_links.as_ref(),
                node_rest: Some(&self.node_rest),
                links: Some(&common.links),
                patch_of: self.mean_dilatation.as_ref().map(|mean_dilatation| &mean_dilatation.patch_of),
                trial_change: newton.map(|newton| &newton.change),
                rotations: &self.rotations,
                gradients: &self.gradients,
                counts: &common.counts,
                element_forces: &self.element_forces,
            },
            self.deforming_count,
        );
        if let Some(mean_dilatation) = &self.mean_dilatation {
            mean_dilatation.record(recorder, common, self, newton.map(|newton| &newton.change));
        }
    }
}
