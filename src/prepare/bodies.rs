//! Prepares all bodies of a scene, one after another, and the scene's tool (the rigid body that the haptic device
//! leads): preparation computes each body's meshes and mass properties before the first step. A simulation is made from
//! the prepared bodies and the scene.

use super::cache::Cache;
use super::report::Stage;
use super::{Body, body_and_report, watched_tool};
use crate::Result;
use crate::scene::Scene;

/// The prepared bodies of a scene, or those bodies that are ready so far.
#[derive(Debug, Clone, Default)]
pub struct Bodies {
    /// The bodies, in the scene's order.
    pub bodies: Vec<Body>,
    /// The prepared tool; `None` if it is not ready, if it is one of the scene's bodies, or if the scene has no tool.
    pub tool: Option<Body>,
}

/// Progress of the preparation, for a display.
#[derive(Debug, Clone, Copy)]
pub struct Progress<'a> {
    /// Name of the body in preparation, or "tool".
    pub name: &'a str,
    /// Stage of the body's preparation that begins now.
    pub stage: Stage,
    /// Number of bodies that are ready, this one included at [`Stage::Ready`]; the tool counts as one.
    pub done: usize,
    /// Number of bodies in all; the tool counts as one.
    pub total: usize,
}

impl Bodies {
    /// Prepares all bodies of a scene.
    pub fn prepare(scene: &Scene, cache: &Cache) -> Result<Bodies> {
        let mut bodies = Bodies::default();
        bodies.complete(scene, cache, &mut |_| Ok(()))?;
        Ok(bodies)
    }

    /// Prepares the bodies that are not ready yet. `watch` is called at the beginning of each stage; if it returns an
    /// error, the preparation stops with that error, and bodies that are ready stay ready.
    pub fn complete(
        &mut self,
        scene: &Scene,
        cache: &Cache,
        watch: &mut dyn FnMut(Progress) -> Result<()>,
    ) -> Result<()> {
        let total = scene.bodies.len() + usize::from(scene.rigid_tool().is_some());
        while let Some(body) = scene.bodies.get(self.bodies.len()) {
            let (name, done) = (body.name.as_str(), self.bodies.len());
            let mut of_body = |stage| watch(Progress { name, stage, done, total });
            self.bodies.push(body_and_report(body, scene, cache, &mut of_body)?.0);
            watch(Progress { name, stage: Stage::Ready, done: done + 1, total })?;
        }
        if let (Some(tool), None) = (scene.rigid_tool(), &self.tool) {
            let mut of_tool = |stage| watch(Progress { name: "tool", stage, done: total - 1, total });
            self.tool = Some(watched_tool(tool, scene, cache, &mut of_tool)?);
            watch(Progress { name: "tool", stage: Stage::Ready, done: total, total })?;
        }
        Ok(())
    }
}
