//! The reference of accuracy curves in which a tool (rigid body that the haptic device leads) is pressed into a soft
//! body: the same steps by the f64 reference implementation (the oracle), with a direct solver
//! ([`palpate_oracle::step`]) and contacts by exact rays or overlaps ([`palpate_oracle::contact`]). Only three
//! things come from the engine, which does each step just before the oracle: the normal of the contact patch (place
//! where body and tool may touch), the choice of what is tested for contact, and how much stiffer contact is at
//! triangles of the tool.

use glam::DVec3;
use palpate::internal::prepare::{self, Shape};
use palpate::internal::step::trajectory::Trajectory;
use palpate::scene::Key;
use palpate::{Error, Options, Result, Scene, Simulation};
use palpate_oracle::contact::{self, ContactLaw, Gathering, Support, Surface};
use palpate_oracle::contact_law::auto_stiffness;
use palpate_oracle::step::{self, SoftBody};
use palpate_oracle::tool;

use super::race::{Errors, Run, relative_error};

/// Solver tolerance of the engine's run; single precision gains nothing from a tighter one.
const TIGHT: f64 = 1e-7;
/// Cap on the solver iterations of the engine's run.
const MANY: u32 = 2_000;

/// Results of the oracle's run.
#[derive(Debug, Clone, PartialEq)]
pub struct Reference {
    /// Force on the tool at the end of each step, world axes, N.
    pub forces: Vec<DVec3>,
    /// Displacements of the body's nodes after the last step, in the axes of the body at rest, m.
    pub displacement: Vec<DVec3>,
}

impl Reference {
    /// Errors of a run that has at most as many steps as the reference; a run with fewer steps has no error of the
    /// displacements.
    pub fn errors(&self, run: &Run) -> Errors {
        let forces = &self.forces[..run.forces.len().min(self.forces.len())];
        let is_whole = run.forces.len() == self.forces.len();
        let shape = if is_whole { relative_error(&run.displacement, &self.displacement) } else { None };
        (relative_error(&run.forces, forces), shape)
    }
}

/// The oracle's state of a soft body and a rigid tool, with both skins (surface meshes) and the contact law.
struct Twin {
    oracle: step::Simulation,
    skin: (prepare::Skin, Vec<prepare::Embedding>),
    tool: prepare::Skin,
    law: ContactLaw,
    gathering: Gathering,
}

/// The reference for `steps` steps of a scene with one soft body and a rigid tool. Errors: the scene's first body is
/// not soft, the scene has no rigid tool, or a system of equations cannot be factorised.
pub fn reference(scene: &Scene, steps: usize, options: &Options) -> Result<Reference> {
    let mut beside = scene.clone();
    (beside.solver.tolerance, beside.solver.max_iterations) = (Some(TIGHT), MANY);
    let mut simulation = Simulation::open(&beside, options)?;
    simulation.time_every(0)?;
    let mut twin = Twin::new(scene, &simulation)?;
    let start = Key { time: 0.0, position: DVec3::ZERO, orientation: glam::DQuat::IDENTITY };
    let trajectory = Trajectory::new(&scene.trajectory, start);
    let mut forces = Vec::with_capacity(steps);
    for _ in 0..steps {
        let row = simulation.step()?;
        let (contact_patches, _) = simulation.touch()?;
        let normal = contact_patches
            .first()
            .map_or(DVec3::ZERO, |contact_patch| DVec3::from(contact_patch.normal.map(f64::from)));
        let contacts = twin.contacts(normal.normalize_or_zero());
        let device = trajectory.device(row.time, scene.step.dt);
        let device = tool::Device {
            position: device.position,
            orientation: device.orientation,
            velocity: device.velocity,
            angular_velocity: device.angular_velocity,
        };
        forces.push(twin.oracle.step(Some(&device), &contacts)?.wrench.force);
    }
    Ok(Reference { forces, displacement: twin.oracle.bodies[0].displacement.clone() })
}

impl Twin {
    fn new(scene: &Scene, simulation: &Simulation) -> Result<Twin> {
        let missing = || Error::Simulation("a reference needs a scene of one soft body and a rigid tool".into());
        let spec = scene.rigid_tool().ok_or_else(missing)?;
        let body = prepare::tool(spec, scene)?;
        let soft = simulation.bodies().first().ok_or_else(missing)?;
        let gathering = Gathering::chosen(&scene.contact, soft, &body);
        let Shape::Soft { layer, materials, skin: own, embedding, .. } = &soft.shape else { return Err(missing()) };
        let mut oracle = step::Simulation::new(scene.step.dt, scene.step.gravity);
        let Shape::Rigid { skin, centroid, volume, inertia, .. } = body.shape else { return Err(missing()) };
        oracle.newton = scene.step.newton as usize;
        oracle.bodies.push(SoftBody::new(layer.clone(), materials, soft.position, soft.orientation, soft.velocity));
        oracle.tool = Some(tool::Tool {
            mass: spec.mass,
            inertia: inertia * (spec.mass / volume),
            centre: body.position,
            orientation: body.orientation,
            velocity: body.velocity,
            angular_velocity: DVec3::ZERO,
            coupling: scene.coupling,
        });
        let tool = prepare::Skin { vertices: skin.vertices.iter().map(|x| *x - centroid).collect(), ..skin };
        let given = scene.contact.stiffness;
        let stiffness = given.or_else(|| auto_stiffness(&[(layer, &materials.all[0])])).ok_or_else(missing)?;
        let damping = scene.contact.damping.unwrap_or(stiffness * scene.step.dt);
        let law = ContactLaw { stiffness, damping, depth_limit: scene.contact.depth_limit };
        Ok(Twin { oracle, skin: (own.clone(), embedding.clone()), tool, law, gathering })
    }

    /// Contacts between body and tool in the present state, along `normal`, which points from the body to the tool;
    /// none if `normal` is zero.
    fn contacts(&self, normal: DVec3) -> Vec<contact::Contact> {
        let Some(tool) = self.oracle.tool.as_ref().filter(|_| normal != DVec3::ZERO) else { return Vec::new() };
        let tool = Surface {
            positions: self.tool.vertices.iter().map(|x| tool.place(*x)).collect(),
            triangles: &self.tool.triangles,
            areas: &self.tool.areas,
            support: Support::Tool,
        };
        let body = self.oracle.bodies[0].surface(0, &self.skin.0, &self.skin.1);
        self.gathering.contacts(normal, &body, &tool, &self.law)
    }
}
