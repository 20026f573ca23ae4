//! The stages (parts of a step) that a scene needs, with their kernels and arrays; the order in which they run is in
//! `algorithm.rs`. A probe is a skin vertex (vertex of a body's surface mesh) whose position a scene records; it moves
//! with the four nodes of the tetrahedron that it lies in.

use std::sync::Arc;

use crate::Result;
use crate::gpu::{Buffer, Context};
use crate::stages::depth::Path;
use crate::stages::elastic::Elastic;
use crate::stages::gap::Gap;
use crate::stages::model::Model;
use crate::stages::skin::Probes;
use crate::stages::solve::Solve;
use crate::stages::touch::TouchStages;
use crate::stages::wrench::Wrench;
use crate::stages::{Common, pose};

/// The stages that a scene needs; stages that it does not need are `None`, and have neither commands nor arrays.
pub struct Stages {
    pub common: Common,
    pub elastic: Elastic,
    pub solve: Solve,
    pub touch: Option<TouchStages>,
    pub wrench: Option<Wrench>,
    pub gap: Option<Gap>,
    pub probes: Option<Probes>,
    pub attached: Option<pose::AttachedNodes>,
    pub floating: Option<pose::Floating>,
}

impl Stages {
    /// Makes the kernels and arrays of the stages that the model needs. `path` tells whether the depth stage, where it
    /// is needed, runs as graphics or as compute pipelines; `probe_nodes` are the four nodes of each probe.
    pub fn new(context: &Arc<Context>, model: &Model, path: Option<Path>, probe_nodes: &[[u32; 4]]) -> Result<Stages> {
        let common = Common::new(context, model)?;
        let touch = if model.pairs.is_empty() { None } else { Some(TouchStages::new(context, model, path, true)?) };
        let solve = Solve::new(context, model, touch.as_ref().map(|t| &t.contact.touch))?;
        let held = model.tool_frame.or(model.tool_core());
        let wrench = if held.is_some() && touch.is_some() { Some(Wrench::new(context, model)?) } else { None };
        let gap = if touch.is_some() { Gap::new(context, model)? } else { None };
        let probes = if probe_nodes.is_empty() { None } else { Some(Probes::new(context, probe_nodes)?) };
        let (attached, floating) = (pose::AttachedNodes::new(context, model)?, pose::Floating::new(context, model)?);
        let elastic = Elastic::new(context, model)?;
        Ok(Stages { elastic, common, solve, touch, wrench, gap, probes, attached, floating })
    }

    /// Writes changed material parameters to the GPU; `model` must be a model of the same bodies as before.
    pub fn refresh(&self, model: &Model) -> Result<()> {
        self.elastic.refresh(model)?;
        self.solve.refresh(model)
    }

    /// The arrays whose contents a step leaves for the next one: nothing else on the GPU is kept from step to step.
    pub fn state(&self) -> Vec<&Buffer> {
        let mut arrays = vec![&self.common.counts];
        arrays.extend(self.elastic.state());
        arrays.extend(self.solve.state());
        if let Some(touch) = &self.touch {
            arrays.extend(touch.cull.state());
            arrays.extend(touch.contact.state());
        }
        arrays
    }
}
