//! What a user may change between two steps: materials, the contact law, the virtual coupling (spring and damper
//! between haptic device and tool), and where driven cores go (rigid bodies inside a soft one that follow a
//! trajectory). The bodies are not prepared anew, and their positions and velocities stay.

use std::time::Duration;

use glam::DVec3;

use super::algorithm::Recordings;
use super::frames::Frames;
use super::probes::probes_of;
use super::stage_set::Stages;
use super::{Simulation, make, tools};
use crate::gpu::{Recorder, read_all, write_all};
use crate::prepare::{Body, FrameMotion, Shape, cores};
use crate::scene::check::Problem;
use crate::scene::{self, Coupling, Dilatation, Key, Material};
use crate::stages::model::Model;
use crate::step::Pose;
use crate::{Error, Result};

/// Distance by which rounding may move a centre of mass, as a fraction of the distance from the centre of mass to the
/// farthest node.
const ROUNDING: f64 = 1e-9;

fn refused(what: &str, problem: Problem) -> Error {
    let Problem { key, problem, remedy } = problem.within(what);
    Error::Usage(format!("{key} {problem}; {remedy}"))
}

impl Simulation {
    /// The materials of a body: its own, then those of its material regions; empty where it is not soft.
    pub fn materials(&self, body: usize) -> &[Material] {
        match self.bodies.get(body).map(|body| &body.shape) {
            Some(Shape::Soft { materials, .. }) => &materials.all,
            _ => &[],
        }
    }

    /// Gives a soft body another material from the next step on: the one at `index` of [`Simulation::materials`]. The
    /// preconditioner keeps the body's coarse space if there is one, and gets none otherwise. Errors: the body has no
    /// material at `index`; or the new material is not valid, has another material law, or has a density that would
    /// move a centre of mass.
    pub fn set_material(&mut self, body: usize, index: usize, material: Material) -> Result<()> {
        let wrong = |what: String| Err(Error::Usage(what));
        let Some(old) = self.materials(body).get(index) else {
            return wrong(format!(
                "body {body} has {} materials, counted from 0, and none at {index}",
                self.materials(body).len()
            ));
        };
        material.check().map_err(|problem| refused("material", problem))?;
        if old.law != material.law {
            return wrong("material.law cannot be changed in a running simulation; make a new simulation".into());
        }
        if self.scene.bodies[body].dilatation == Dilatation::Patch && material.poisson < 0.0 {
            return wrong("material.poisson is negative, but dilatation = \"patch\" needs 0 or more".into());
        }
        let mut bodies = self.bodies.clone();
        let Shape::Soft { layer, frames, node_frames, materials, .. } = &mut bodies[body].shape else { return Ok(()) };
        materials.all[index] = material;
        let new = cores::frames(&self.scene.bodies[body], layer, node_frames, materials);
        let new = new.map_err(|(key, problem, remedy)| Error::Usage(format!("{key}: {problem}; {remedy}")))?;
        let reach = |centre: DVec3| layer.nodes.iter().map(|x| x.distance(centre)).fold(0.0, f64::max);
        for (old, new) in frames.iter_mut().zip(new) {
            let counts = matches!(new.motion, FrameMotion::Floating { .. } | FrameMotion::Dynamic { .. });
            if counts && old.centre.distance(new.centre) > ROUNDING * reach(old.centre) {
                let what = "material.density would move a centre of mass; make a new simulation";
                return wrong(what.into());
            }
            old.motion = new.motion;
        }
        let mut scene = self.scene.clone();
        let own = &mut scene.bodies[body];
        match index {
            0 => own.material = Some(material),
            _ => own.regions[index - 1].material = material,
        }
        self.take_up(scene, bodies)
    }

    /// Changes the contact law from the next step on: stiffness, damping, friction and depth limit become those of
    /// `law`, whose other settings are ignored. If the scene had no friction and gets some, the step is recorded anew,
    /// which takes as long as making the simulation did.
    pub fn set_contact(&mut self, law: &scene::Contact) -> Result<()> {
        law.check().map_err(|problem| refused("contact", problem))?;
        let mut scene = self.scene.clone();
        let scene::Contact { texel, depth, sides, samples, .. } = scene.contact;
        scene.contact = scene::Contact { texel, depth, sides, samples, ..law.clone() };
        self.take_up(scene, self.bodies.clone())
    }

    /// Sets the virtual coupling between haptic device and tool (of several tools the first) from the next step on; `None`
    /// removes it.
    pub fn set_coupling(&mut self, coupling: Option<Coupling>) -> Result<()> {
        let Some(tool) = &mut self.tool else { return Err(Error::Usage("the scene has no tool to couple".into())) };
        if let Some(coupling) = &coupling {
            coupling.check().map_err(|problem| refused("coupling", problem))?;
        }
        (tool.coupling, self.scene.coupling) = (coupling, coupling);
        Ok(())
    }

    /// Pose of a core: where the core's motion has taken the coordinate system of the body's file. `None`: the body has
    /// no such core.
    pub fn core_pose(&self, body: usize, core: usize) -> Option<Pose> {
        let frame = self.frame_of(body, core)?;
        let place = self.frames.place(frame);
        let position = place.centre - place.rotation * self.model.frames[frame].rest_centre;
        Some(Pose { position, orientation: place.rotation })
    }

    /// Moves a driven core to a pose, uniformly, in the given time from now on (at least the time of a step), and
    /// leaves it there.
    pub fn move_core(&mut self, body: usize, core: usize, pose: Pose, time: Duration) -> Result<()> {
        let Some(frame) = self.frame_of(body, core) else {
            return Err(Error::Usage(format!("body {body} has no core {core}")));
        };
        let time = time.as_secs_f64().max(self.scene.step.dt);
        let key = Key { time: self.time + time, position: pose.position, orientation: pose.orientation };
        match self.frames.lead(frame, self.time, key) {
            true => Ok(()),
            false => {
                let what =
                    "is not driven; give it motion = \"driven\", with the pose that it starts from as its only key";
                Err(Error::Usage(format!("core {core} of body {body} {what}")))
            }
        }
    }

    /// Index of a core's rigid coordinate frame.
    fn frame_of(&self, body: usize, core: usize) -> Option<usize> {
        let has = core < self.scene.bodies.get(body)?.cores.len();
        has.then(|| self.model.body_frames[body] as usize + core)
    }

    /// Replaces the scene and its bodies by changed ones that differ in materials and contact law alone.
    fn take_up(&mut self, scene: scene::Scene, bodies: Vec<Body>) -> Result<()> {
        let model = self.model.with_materials_of(&scene, &bodies, self.tool_body.as_ref());
        if model.coarse.bodies.len() != self.model.coarse.bodies.len() {
            return Err(Error::Usage(
                "with these materials the coarse matrix of the preconditioner cannot be inverted; make a new simulation"
                    .into(),
            ));
        }
        let mut frames = Frames::new(&model, |_| DVec3::ZERO);
        frames.restore(&self.frames.saved());
        let held = tools::tool_of(&scene, self.tool_body.as_ref(), &model, &frames)?;
        // Everything that can fail is done before anything is changed.
        if model.friction[0] > 0.0 && !self.has_friction {
            let (stages, plain, timed) = self.recorded(&model, &scene, &bodies)?;
            (self.stages, self.plain, self.timed, self.shown) = (stages, plain, timed, None);
            (self.has_friction, self.is_solved) = (true, false);
        } else if let Err(error) = self.stages.refresh(&model) {
            // The old constants are written back to the GPU as far as that is possible.
            let _ = self.stages.refresh(&self.model);
            return Err(error);
        }
        if let (Some(tool), Some(held)) = (&mut self.tool, held) {
            (tool.mass, tool.inertia) = (held.mass, held.inertia);
        }
        self.tool_core_mass = tools::tool_core_mass(&model);
        self.further_tools.iter_mut().for_each(|tool| tool.weigh(&model, &frames));
        (self.model, self.frames, self.scene, self.bodies) = (model, frames, scene, bodies);
        Ok(())
    }

    /// Makes and records the step anew for a model of the same bodies; the arrays that a step leaves for the next keep
    /// their present contents.
    fn recorded(&self, model: &Model, scene: &scene::Scene, bodies: &[Body]) -> Result<NewRecordings> {
        let arrays = read_all(&self.context, &self.stages.state())?;
        let (_, probe_nodes) = probes_of(scene, bodies, model)?;
        let stages = Stages::new(&self.context, model, self.path, &probe_nodes)?;
        write_all(&self.context, &stages.state(), &arrays)?;
        let plain = Recordings::new(&stages, scene.solver.max_iterations, || Recorder::untimed(&self.context))?;
        let timed = make::timed(&self.context, &stages, scene, self.timing)?;
        Ok((stages, plain, timed))
    }
}

/// Kernels and arrays, and the recordings made of them, without and with timestamps.
type NewRecordings = (Stages, Recordings, Vec<Recordings>);
