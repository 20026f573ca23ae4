//! What a rendered image shows of a simulation between two steps: arrays on the GPU, and values on the CPU.

use glam::DVec3;
use palpate::internal::gpu::Buffer;
use palpate::internal::step::{self, ContactPatchRectangle, Field, FieldValues, Mesh};
use palpate::{Result, Simulation};

use super::overlay::{Overlay, Overlays};

/// A simulation as it was when [`Moment::of`] was called. The arrays that it refers to keep their content until
/// [`Moment::of`] is called again.
#[derive(Clone)]
pub struct Moment {
    /// What is shown besides the skins (the bodies' surface meshes).
    pub shown: Overlays,
    /// Position of the tool (the rigid body that the haptic device leads), m.
    pub tool: Option<DVec3>,
    /// Position of the haptic device that holds the tool, m; set by a caller that knows this position.
    pub device: Option<DVec3>,
    /// Contact force on the tool, N.
    pub force: DVec3,
    /// Contact torque on the tool about its centre, N m.
    pub torque: DVec3,
    /// Positions of the vertices of all skins; another buffer than in the [`Moment`] before if the simulation has made
    /// its arrays anew.
    pub(super) positions: Buffer,
    pub(super) normals: Buffer,
    /// Origin of each body's first rigid coordinate frame, and last the tool's centre, m.
    pub(super) frames: Vec<Option<DVec3>>,
    /// The scalar field that skins are coloured by.
    pub(super) field: Option<FieldValues>,
    pub(super) meshes: Vec<(step::Overlay, Mesh)>,
    pub(super) contact_patches: Vec<ContactPatchRectangle>,
}

impl Moment {
    /// Fills the arrays that an image with these overlays shows, with positions relative to `origin`. Must be called
    /// between two steps.
    pub fn of(simulation: &mut Simulation, origin: DVec3, shown: Overlays) -> Result<Moment> {
        let skins = simulation.skins(origin)?;
        let (positions, normals) = (skins.positions.clone(), skins.normals.clone());
        let field = shown.field().map(|field| simulation.field(field)).transpose()?;
        let layers = step::Overlay::Layers(shown.field().unwrap_or(Field::StrainEnergy));
        let wanted = [
            (Overlay::Proxies, step::Overlay::Proxies),
            (Overlay::Layer, layers),
            (Overlay::Cores, step::Overlay::Cores),
            (Overlay::Cores, step::Overlay::Bones),
        ];
        let mut meshes = Vec::new();
        for (_, overlay) in wanted.into_iter().filter(|(overlay, _)| shown.has(*overlay)) {
            let mesh = simulation.overlay(overlay, origin)?;
            if mesh.triangle_count > 0 {
                meshes.push((overlay, mesh));
            }
        }
        let contact_patches =
            if shown.has(Overlay::ContactPatches) { simulation.contact_patch_rectangles()? } else { Vec::new() };
        let wrench = simulation.contact_wrench().map(|felt| felt.wrench).unwrap_or_default();
        let tool = simulation.tool().map(|tool| tool.centre);
        let frames = (0..simulation.bodies().len()).map(|body| simulation.frames(body).first().map(|p| p.centre));
        Ok(Moment {
            shown,
            tool,
            device: None,
            force: wrench.force,
            torque: wrench.torque,
            positions,
            normals,
            frames: frames.chain([tool]).collect(),
            field,
            meshes,
            contact_patches,
        })
    }
}
