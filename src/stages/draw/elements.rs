//! Fields of the tetrahedra of soft bodies after a step, for display and export: strain energy density and stress. They
//! are computed from the state that a step leaves, without changing it.

use std::sync::Arc;

use super::super::elastic::Elastic;
use super::super::material_law;
use super::super::model::Model;
use super::super::{array, count, upload};
use super::{Draw, lists};
use crate::Result;
use crate::gpu::{Buffer, Const, Context, Kernel, Recorder, Size};
use crate::shaders;
use crate::shaders::NONE;

/// Kernels and arrays of the tetrahedra's fields.
pub struct ElementFields {
    energy: Kernel,
    /// The kernel of `energy`, specialised to compute stresses too.
    stress: Kernel,
    share: Option<Patches>,
    /// One vec4 per tetrahedron: strain energy density (J/m^3), rest volume (m^3), trace of the strain, and the part of
    /// the stress that its F-bar patch applies (Pa).
    pub densities: Buffer,
    /// Two vec4 per tetrahedron, of Cauchy's stress in world axes, Pa: xx, yy, zz and von Mises's stress; xy, xz, yz and
    /// hydrostatic pressure, zero under tension.
    pub stresses: Buffer,
}

/// The F-bar patches (groups of tetrahedra that share one volumetric strain), with the kernel that adds the energy of
/// this strain.
struct Patches {
    kernel: Kernel,
    count: u32,
    first: Buffer,
    members: Buffer,
}

impl ElementFields {
    /// Kernels and arrays for a model.
    pub fn new(context: &Arc<Context>, model: &Model) -> Result<ElementFields> {
        let share = || -> Result<Patches> {
            let patches = model.patches.of.iter().zip(0..).filter(|(patch, _)| **patch != NONE);
            let (first, members) = lists(model.patches.count(), patches.map(|(patch, t)| (*patch, t)));
            Ok(Patches {
                kernel: group(context, "draw/share", &[("PATCHES", count(model.patches.count()))])?,
                count: model.patches.count() as u32,
                first: upload(context, "patch_first", &first)?,
                members: upload(context, "patch_members", &members)?,
            })
        };
        let has_patches = model.patches.count() > 0;
        let kernel = |has_stress: bool| {
            let constants = [
                ("TETRAHEDRA", count(model.tetrahedra.len())),
                ("SPANS", model.spans_frames().into()),
                ("PATCHES", has_patches.into()),
                ("LAWS", material_law::laws_of(&model.materials).into()),
                ("STRESS", has_stress.into()),
            ];
            group(context, "draw/elements", &constants)
        };
        Ok(ElementFields {
            energy: kernel(false)?,
            stress: kernel(true)?,
            share: has_patches.then(share).transpose()?,
            densities: array::<[f32; 4]>(context, "densities", model.tetrahedra.len())?
                .known_as(&["densities", "numbers"]),
            stresses: array::<[f32; 8]>(context, "stresses", model.tetrahedra.len())?
                .known_as(&["stresses", "numbers"]),
        })
    }

    /// Records the passes that fill `densities`.
    pub fn record_energy(&self, recorder: &mut Recorder, draw: &Draw, elastic: &Elastic) {
        self.record_elements(recorder, &self.energy, draw, elastic);
        if let Some(patches) = &self.share {
            let arguments = shaders::draw::Share {
                patch_first: &patches.first,
                patch_members: &patches.members,
                densities: &self.densities,
            };
            recorder.dispatch(&patches.kernel, &arguments, patches.count);
        }
    }

    /// Records the passes that fill `densities` and `stresses`: one where there are no patches.
    pub fn record_all(&self, recorder: &mut Recorder, draw: &Draw, elastic: &Elastic) {
        if self.share.is_some() {
            self.record_energy(recorder, draw, elastic);
        }
        self.record_elements(recorder, &self.stress, draw, elastic);
    }

    fn record_elements(&self, recorder: &mut Recorder, kernel: &Kernel, draw: &Draw, elastic: &Elastic) {
        let arguments = shaders::draw::Elements {
            materials: &elastic.materials,
            frames: &draw.frames,
            tetrahedra: &elastic.tetrahedra,
            rest_gradients: &elastic.rest_gradients,
            element_info: &elastic.element_info,
            displacement: &elastic.displacement,
            tetrahedron_links: elastic.tetrahedron_links.as_ref(),
            node_rest: Some(&elastic.node_rest),
            links: Some(&draw.links),
            patch_of: elastic.mean_dilatation.as_ref().map(|mean_dilatation| &mean_dilatation.patch_of),
            rotations: &elastic.rotations,
            densities: Some(&self.densities),
            stresses: &self.stresses,
        };
        recorder.dispatch(kernel, &arguments, elastic.tetrahedron_count as u32);
    }
}

/// A kernel that runs one invocation for each element.
pub fn group(context: &Arc<Context>, name: &str, constants: &[(&str, Const)]) -> Result<Kernel> {
    Kernel::new(context, name, Size::Group, constants)
}
