//! What a user changes between two steps: materials, the contact law, the coupling, where driven cores go. Bodies are not
//! prepared again, and nothing that moves is touched.

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

/// How far a centre of mass may move by rounding, of the distance of the nodes from it.
const ROUNDING: f64 = 1e-9;

fn refused(what: &str, problem: Problem) -> Error {
    let Problem { key, problem, remedy } = problem.within(what);
    Error::Usage(format!("{key} {problem}; {remedy}"))
}

impl Simulation {
    /// The materials of a body: its own, then those of its regions; empty where it is not soft.
    pub fn materials(&self, body: usize) -> &[Material] {
        match self.bodies.get(body).map(|body| &body.shape) {
            Some(Shape::Soft { materials, .. }) => &materials.all,
            _ => &[],
        }
    }

    /// Gives a soft body another material from the next step on, the one at `index` of [`Simulation::materials`]. Whether it has
    /// a coarse level stays as it was chosen. Errors: there is none there, it cannot be, its law is another, or its density
    /// would move a centre of mass.
    pub fn set_material(&mut self, body: usize, index: usize, material: Material) -> Result<()> {
        let wrong = |what: String| Err(Error::Usage(what));
        let Some(old) = self.materials(body).get(index) else {
            return wrong(format!("body {body} has {} materials, and none at {index}", self.materials(body).len()));
        };
        material.check().map_err(|problem| refused("material", problem))?;
        if old.law != material.law {
            return wrong("material.law is chosen when a simulation is made; make it anew".into());
        }
        if self.scene.bodies[body].dilatation == Dilatation::Patch && material.poisson < 0.0 {
            return wrong("material.poisson is below zero, and patches guard against locking; give 0 or more".into());
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
                let what = "material.density would move a centre of mass; make the simulation anew";
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

    /// Another contact law from the next step on: stiffness, damping, friction and the depth limit of `law`; what else it says
    /// stays as it was. Friction where there was none is recorded first, which takes as long as it took to make the simulation.
    pub fn set_contact(&mut self, law: &scene::Contact) -> Result<()> {
        law.check().map_err(|problem| refused("contact", problem))?;
        let mut scene = self.scene.clone();
        let scene::Contact { texel, depth, sides, .. } = scene.contact;
        scene.contact = scene::Contact { texel, depth, sides, ..law.clone() };
        self.take_up(scene, self.bodies.clone())
    }

    /// What joins device and tool from the next step on; `None`: nothing.
    pub fn set_coupling(&mut self, coupling: Option<Coupling>) -> Result<()> {
        let Some(tool) = &mut self.tool else { return Err(Error::Usage("the scene has no tool to couple".into())) };
        if let Some(coupling) = &coupling {
            coupling.check().map_err(|problem| refused("coupling", problem))?;
        }
        (tool.coupling, self.scene.coupling) = (coupling, coupling);
        Ok(())
    }

    /// Where a core of a body is: the pose of the body's file with it. `None`: there is no such core.
    pub fn core_pose(&self, body: usize, core: usize) -> Option<Pose> {
        let frame = self.frame_of(body, core)?;
        let place = self.frames.place(frame);
        let position = place.centre - place.rotation * self.model.frames[frame].rest_centre;
        Some(Pose { position, orientation: place.rotation })
    }

    /// Takes a driven core to a pose, evenly, in so much time from now on (at least a step), and leaves it there.
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

    /// The frame of a core.
    fn frame_of(&self, body: usize, core: usize) -> Option<usize> {
        let has = core < self.scene.bodies.get(body)?.cores.len();
        has.then(|| self.model.body_frames[body] as usize + core)
    }

    /// The same bodies with what a changed scene says of them.
    fn take_up(&mut self, scene: scene::Scene, bodies: Vec<Body>) -> Result<()> {
        let model = self.model.again(&scene, &bodies, self.tool_body.as_ref());
        if model.coarse.bodies.len() != self.model.coarse.bodies.len() {
            return Err(Error::Usage("with that the coarse level has no inverse; make the simulation anew".into()));
        }
        let mut frames = Frames::new(&model, |_| DVec3::ZERO);
        frames.restore(&self.frames.saved());
        let held = tools::tool_of(&scene, self.tool_body.as_ref(), &model, &frames)?;
        // What can fail comes first.
        if model.friction[0] > 0.0 && !self.has_friction {
            let (stages, plain, timed) = self.recorded(&model, &scene, &bodies)?;
            (self.stages, self.plain, self.timed, self.shown) = (stages, plain, timed, None);
            (self.has_friction, self.is_solved) = (true, false);
        } else if let Err(error) = self.stages.refresh(&model) {
            // As well as it can be.
            let _ = self.stages.refresh(&self.model);
            return Err(error);
        }
        if let (Some(tool), Some(held)) = (&mut self.tool, held) {
            (tool.mass, tool.inertia) = (held.mass, held.inertia);
        }
        self.held_mass = tools::held_mass(&model);
        (self.model, self.frames, self.scene, self.bodies) = (model, frames, scene, bodies);
        Ok(())
    }

    /// The step of a model of the same bodies recorded anew, which goes on where this is.
    fn recorded(&self, model: &Model, scene: &scene::Scene, bodies: &[Body]) -> Result<NewRecordings> {
        let arrays = read_all(&self.context, &self.stages.state())?;
        let (_, probe_nodes) = probes_of(scene, bodies, model)?;
        let stages = Stages::new(&self.context, model, self.path, &probe_nodes)?;
        write_all(&self.context, &stages.state(), &arrays)?;
        let plain = Recordings::new(&stages, scene.solver.max_iterations, || Recorder::untimed(&self.context))?;
        let timed = self.timed.is_some().then(|| make::timed(&self.context, &stages, scene)).transpose()?;
        Ok((stages, plain, timed))
    }
}

/// Kernels and arrays, and the recordings of them, untimed and timed.
type NewRecordings = (Stages, Recordings, Option<[Recordings; 2]>);
