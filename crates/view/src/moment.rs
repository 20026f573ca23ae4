//! What a picture shows of a simulation between two steps: what the device filled, and what the host knows.

use glam::DVec3;
use palpate::internal::gpu::Buffer;
use palpate::internal::step::{self, Field, FieldValues, Mesh, RegionSquare};
use palpate::{Result, Simulation};

use super::overlay::{Overlay, Overlays};

/// A simulation as it was when [`Moment::of`] looked. The arrays it names stay as they are until it looks again.
#[derive(Clone)]
pub struct Moment {
    /// What is shown besides the skins.
    pub shown: Overlays,
    /// Where the tool is, m.
    pub tool: Option<DVec3>,
    /// Where the device that holds it is, m; whoever knows sets it.
    pub device: Option<DVec3>,
    /// Contact force on the tool, N.
    pub force: DVec3,
    /// Contact torque on the tool about its centre, N m.
    pub torque: DVec3,
    /// Of all skins; others than before where the simulation made them anew.
    pub(super) positions: Buffer,
    pub(super) normals: Buffer,
    /// Where the first frame of each body is, the tool's last, m.
    pub(super) frames: Vec<Option<DVec3>>,
    /// What skins are coloured by.
    pub(super) field: Option<FieldValues>,
    pub(super) meshes: Vec<(step::Overlay, Mesh)>,
    pub(super) regions: Vec<RegionSquare>,
}

impl Moment {
    /// Fills the arrays of what is shown, relative to `origin`. Between two steps.
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
        let regions = if shown.has(Overlay::Regions) { simulation.region_squares()? } else { Vec::new() };
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
            regions,
        })
    }
}
