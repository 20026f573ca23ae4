//! All bodies of a scene, prepared one after another: what a simulation is made of beside the scene itself.

use super::cache::Cache;
use super::report::Stage;
use super::{Body, body_and_report, watched_tool};
use crate::Result;
use crate::scene::Scene;

/// The prepared bodies of a scene, or the first of them.
#[derive(Debug, Clone, Default)]
pub struct Bodies {
    /// In the scene's order.
    pub bodies: Vec<Body>,
    /// The tool, where it is one of its own and no body of the scene.
    pub tool: Option<Body>,
}

/// What is being prepared.
#[derive(Debug, Clone, Copy)]
pub struct Progress<'a> {
    /// The body, or "tool".
    pub name: &'a str,
    /// What is done to it.
    pub stage: Stage,
    /// Bodies that are ready, the tool counted as one.
    pub done: usize,
    /// Bodies in all.
    pub total: usize,
}

impl Bodies {
    /// Prepares a whole scene.
    pub fn prepare(scene: &Scene, cache: &Cache) -> Result<Bodies> {
        let mut bodies = Bodies::default();
        bodies.complete(scene, cache, &mut |_| Ok(()))?;
        Ok(bodies)
    }

    /// Prepares what is not prepared yet. `watch` is told each stage as it begins; where it gives an error, that ends it, and
    /// bodies that are ready stay so.
    pub fn complete(
        &mut self,
        scene: &Scene,
        cache: &Cache,
        watch: &mut dyn FnMut(Progress) -> Result<()>,
    ) -> Result<()> {
        let total = scene.bodies.len() + usize::from(scene.rigid_tool().is_some());
        while let Some(body) = scene.bodies.get(self.bodies.len()) {
            let (name, done) = (body.name.as_str(), self.bodies.len());
            let mut watch = |stage| watch(Progress { name, stage, done, total });
            self.bodies.push(body_and_report(body, scene, cache, &mut watch)?.0);
        }
        if let (Some(tool), None) = (scene.rigid_tool(), &self.tool) {
            let mut watch = |stage| watch(Progress { name: "tool", stage, done: total - 1, total });
            self.tool = Some(watched_tool(tool, scene, cache, &mut watch)?);
        }
        Ok(())
    }
}
