//! The step plan: which stages of the step a scene needs, and why the others are left out. It is written to
//! `summary.json`, and pass by pass by `palpate run --explain`.

mod explanation;
mod features;
mod kernels;

use crate::prepare::Body;
use crate::scene::Scene;
use crate::stages::model::Model;

pub use explanation::{Array, Explanation, KernelUse, StageUse};
pub use features::Feature;
pub(crate) use kernels::{stage_of, why_not};

/// A stage of the step, recorded or left out.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Entry {
    /// Name of the stage.
    pub stage: &'static str,
    /// Whether it is recorded (and its arrays allocated).
    pub recorded: bool,
    /// Why it is recorded, or why it is left out.
    pub reason: String,
}

/// All ten stages of the step.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Plan {
    /// One entry per stage.
    pub entries: Vec<Entry>,
    /// Which path the depth stage takes (graphics or compute) and why; `None` where the stage is left out.
    pub depth: Option<String>,
}

impl Plan {
    /// The plan of a scene. `depth`: which path the depth stage takes and why; `None` where it is left out.
    pub fn new(scene: &Scene, model: &Model, depth: Option<String>) -> Plan {
        let path = depth.clone();
        let touches = !model.pairs.is_empty();
        let nothing = match (&scene.tool, scene.bodies.len()) {
            (None, 0 | 1) => "a single body and no tool: nothing to touch",
            (None, _) => "no tool, and no two bodies that may touch",
            (Some(_), _) => "no body may touch the tool or another",
        };
        let planes = "only half-spaces are touched: their depth needs no ray hits";
        let pairs: String = match model.pairs.len() {
            1 => "1 pair of bodies may touch".into(),
            count => format!("{count} pairs of bodies may touch"),
        };
        let mut entries = Vec::new();
        let mut add = |stage, recorded, yes: String, no: &str| {
            entries.push(Entry { stage, recorded, reason: if recorded { yes } else { no.into() } });
        };
        let (carried, floating) = (model.attached_nodes.len(), model.floating.len());
        let pose = if touches { pairs.clone() } else { format!("{carried} nodes attached to moving frames") };
        add("pose", touches || carried > 0, pose, nothing);
        add("skin", touches, pairs.clone(), nothing);
        add("cull", touches, pairs.clone(), nothing);
        add("depth", depth.is_some(), depth.unwrap_or_default(), if touches { planes } else { nothing });
        add("contact", touches, pairs, nothing);
        let soft = !model.tetrahedra.is_empty();
        let times = if model.newton > 1 { format!(", {} Newton iterations", model.newton) } else { String::new() };
        add("elastic", soft, format!("{} tetrahedra{times}", model.tetrahedra.len()), "no soft body");
        let solve = match model.cores.len() {
            0 => format!("{} nodes", model.node_rest.len()),
            cores => format!("{} nodes, {cores} dynamic cores", model.node_rest.len()),
        };
        let solve = match model.joints.len() {
            0 => solve,
            joints => format!("{solve}, {joints} joints"),
        };
        let coarse = |(body, number, aggregates): &(usize, f64, usize)| {
            let name = scene.bodies.get(*body).map_or("", |body| &body.name);
            format!(", coarse level of `{name}`: stiffness number {number:.0}, {aggregates} aggregates")
        };
        let solve = solve + &model.coarse.bodies.iter().map(coarse).collect::<String>();
        add("solve", true, solve, "");
        let wrench = touches && scene.tool.is_some();
        add("wrench", wrench, "net wrench on the tool".into(), if scene.tool.is_some() { nothing } else { "no tool" });
        add("fit", floating > 0, format!("{floating} floating frames"), "no body without cores");
        add("probe", !scene.probes.is_empty(), format!("{} vertices", scene.probes.len()), "no probes");
        Plan { entries, depth: path }
    }

    /// Every feature that a scene can have, and whether this one uses it. `bodies`: the prepared bodies without the
    /// tool; `timed_every`: one step in so many is timed by timestamps, 0: none.
    pub fn features(&self, scene: &Scene, model: &Model, bodies: &[Body], timed_every: u64) -> Vec<Feature> {
        features::features(&features::Known { scene, model, bodies, depth: self.depth.as_deref(), timed_every })
    }
}
