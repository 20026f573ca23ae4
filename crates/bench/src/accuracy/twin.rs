//! Where the f64 oracle has it: the steps of a press, solved directly ([`palpate_oracle::step`]), with contacts by exact rays
//! ([`palpate_oracle::contact`]). Only the direction of the region is the engine's, from a run beside it.

use glam::DVec3;
use palpate::internal::prepare::{self, Shape};
use palpate::internal::step::drive::Drive;
use palpate::scene::Key;
use palpate::{Error, Options, Result, Scene, Simulation};
use palpate_oracle::contact::{self, Law, Support, Surface};
use palpate_oracle::contact_law::auto_stiffness;
use palpate_oracle::step::{self, SoftBody};
use palpate_oracle::tool;

use super::race::{Errors, Run, relative_error};

/// As tight as a scene can ask for with a purpose: single precision ends here.
const TIGHT: f64 = 1e-7;
/// Iterations that the run beside it may take.
const MANY: u32 = 2_000;

/// What should be found.
#[derive(Debug, Clone, PartialEq)]
pub struct Reference {
    /// Force on the tool after each step, world, N.
    pub forces: Vec<DVec3>,
    /// Displacements of the body's nodes after the last step, rest axes, m.
    pub displacement: Vec<DVec3>,
}

impl Reference {
    /// Errors of a run of as many steps, or of fewer: then of the force alone.
    pub fn errors(&self, run: &Run) -> Errors {
        let forces = &self.forces[..run.forces.len().min(self.forces.len())];
        let is_whole = run.forces.len() == self.forces.len();
        let shape = if is_whole { relative_error(&run.displacement, &self.displacement) } else { None };
        (relative_error(&run.forces, forces), shape)
    }
}

/// A soft body and a sphere, in f64.
struct Twin {
    oracle: step::Simulation,
    skin: (prepare::Skin, Vec<prepare::Embedding>),
    tool: prepare::Skin,
    law: Law,
}

/// The reference of `steps` steps of a scene's one soft body and its rigid tool. Errors: another scene, a system that cannot
/// be factorised.
pub fn reference(scene: &Scene, steps: usize, options: &Options) -> Result<Reference> {
    let mut beside = scene.clone();
    (beside.solver.tolerance, beside.solver.max_iterations) = (TIGHT, MANY);
    let mut simulation = Simulation::open(&beside, options)?;
    simulation.time_every(0)?;
    let mut twin = Twin::new(scene, &simulation)?;
    let start = Key { time: 0.0, position: DVec3::ZERO, orientation: glam::DQuat::IDENTITY };
    let drive = Drive::new(&scene.drive, start);
    let mut forces = Vec::with_capacity(steps);
    for _ in 0..steps {
        let row = simulation.step()?;
        let (regions, _) = simulation.touch()?;
        let normal = regions.first().map_or(DVec3::ZERO, |region| DVec3::from(region.normal.map(f64::from)));
        let contacts = twin.contacts(normal.normalize_or_zero());
        let device = drive.device(row.time, scene.step.dt);
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
        let missing = || Error::Simulation("a reference is of one soft body and a rigid tool".into());
        let spec = scene.rigid_tool().ok_or_else(missing)?;
        let body = prepare::tool(spec, scene)?;
        let Shape::Rigid { skin, centroid, volume, inertia, .. } = body.shape else { return Err(missing()) };
        let soft = simulation.bodies().first().ok_or_else(missing)?;
        let Shape::Soft { layer, materials, skin: own, embedding, .. } = &soft.shape else { return Err(missing()) };
        let mut oracle = step::Simulation::new(scene.step.dt, scene.step.gravity);
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
        let law = Law { stiffness, damping, depth_limit: scene.contact.depth_limit };
        Ok(Twin { oracle, skin: (own.clone(), embedding.clone()), tool, law })
    }

    /// Contacts of the present state along a direction, from the body to the tool; none without one.
    fn contacts(&self, normal: DVec3) -> Vec<contact::Contact> {
        let Some(tool) = self.oracle.tool.as_ref().filter(|_| normal != DVec3::ZERO) else { return Vec::new() };
        let tool = Surface {
            positions: self.tool.vertices.iter().map(|x| tool.place(*x)).collect(),
            triangles: &self.tool.triangles,
            areas: &self.tool.areas,
            support: Support::Tool,
        };
        contact::gather(normal, &self.oracle.bodies[0].surface(0, &self.skin.0, &self.skin.1), &tool, &self.law)
    }
}
