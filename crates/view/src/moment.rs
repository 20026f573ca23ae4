//! What a rendered image shows of a simulation between two steps: arrays on the GPU, and values on the CPU.

use glam::DVec3;
use palpate::internal::gpu::Buffer;
use palpate::internal::step::tool::Tool;
use palpate::internal::step::{self, ContactPatchRectangle, ContactWrench, Field, FieldValues, Mesh};
use palpate::{Result, Simulation, Wrench};

use super::materials::{self, Coloured};
use super::overlay::{Overlay, Overlays};

/// A simulation as it was when [`Moment::of`] was called. The arrays that it refers to keep their content until
/// [`Moment::of`] is called again.
#[derive(Clone)]
pub struct Moment {
    /// What is shown besides the skins (the bodies' surface meshes).
    pub shown: Overlays,
    /// The tools (the rigid bodies that haptic devices lead), in the scene's order.
    pub tools: Vec<ShownTool>,
    /// Positions of the haptic devices that hold the tools, m; set by a caller that knows them, for the first tools.
    pub devices: Vec<DVec3>,
    /// Text in the image's upper left corner, such as the simulated time from [`clock`]; set by a caller that wants a
    /// text.
    pub corner: Option<String>,
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
    /// The materials of soft bodies with their colours; empty unless they are shown.
    pub(super) materials: Vec<Coloured>,
}

/// A tool with the wrench of its contacts.
#[derive(Debug, Clone)]
pub struct ShownTool {
    /// Name of the tool.
    pub name: String,
    /// Position of the tool, m.
    pub centre: DVec3,
    /// Contact force on the tool, N, and contact torque about its centre, N m.
    pub wrench: Wrench,
}

/// The simulated time as text, such as `t = 0.125 s`, with three decimals, or with as many more, up to six, as the
/// length of a step needs.
pub fn clock(simulation: &Simulation) -> String {
    let dt = simulation.scene().step.dt;
    let is_whole = |digits: &i32| {
        let units = dt * 10f64.powi(*digits);
        units > 0.5 && (units - units.round()).abs() < 1e-6
    };
    let digits = (3..6).find(is_whole).unwrap_or(6) as usize;
    format!("t = {:.digits$} s", simulation.time())
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
            (shown.has(Overlay::Proxies), step::Overlay::Proxies),
            (shown.opens_layers(), layers),
            (shown.has(Overlay::Cores), step::Overlay::Cores),
            (shown.has(Overlay::Cores), step::Overlay::Bones),
        ];
        let mut meshes = Vec::new();
        for (_, overlay) in wanted.into_iter().filter(|(is_wanted, _)| *is_wanted) {
            let mesh = simulation.overlay(overlay, origin)?;
            if mesh.triangle_count > 0 {
                meshes.push((overlay, mesh));
            }
        }
        let contact_patches =
            if shown.has(Overlay::ContactPatches) { simulation.contact_patch_rectangles()? } else { Vec::new() };
        let shown_tool = |((name, tool), wrench): ((&str, &Tool), Option<&ContactWrench>)| ShownTool {
            name: name.into(),
            centre: tool.centre,
            wrench: wrench.map_or(Wrench::ZERO, |felt| felt.wrench),
        };
        let named = simulation.scene().tool_names().zip(simulation.tools());
        let tools: Vec<ShownTool> = named.zip(simulation.last_wrenches()).map(shown_tool).collect();
        let tool = tools.first().map(|tool| tool.centre);
        let frames = (0..simulation.bodies().len()).map(|body| simulation.frames(body).first().map(|p| p.centre));
        Ok(Moment {
            shown,
            tools,
            devices: Vec::new(),
            corner: None,
            materials: if shown.has(Overlay::Materials) { materials::coloured(simulation) } else { Vec::new() },
            positions,
            normals,
            frames: frames.chain([tool]).collect(),
            field,
            meshes,
            contact_patches,
        })
    }
}
