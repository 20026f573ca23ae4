//! What is recorded of a step: the stages that a scene needs, and the command buffers that replay them.

use std::sync::Arc;

use crate::Result;
use crate::gpu::{Buffer, Context, Recorder, Recording};
use crate::stages::depth::Path;
use crate::stages::elastic::Elastic;
use crate::stages::gap::{Gap, Skins};
use crate::stages::model::Model;
use crate::stages::skin::Probes;
use crate::stages::solve::Solve;
use crate::stages::touch::TouchStages;
use crate::stages::wrench::Wrench;
use crate::stages::{Common, pose};

/// Iterations of the shortest recorded plan; each further one is twice as long.
const SHORTEST_PLAN: u32 = 16;

/// The stages that a scene needs; what it does not need is neither recorded nor allocated.
pub struct Stages {
    pub common: Common,
    pub elastic: Elastic,
    pub solve: Solve,
    pub touch: Option<TouchStages>,
    pub wrench: Option<Wrench>,
    pub gap: Option<Gap>,
    pub probes: Option<Probes>,
    pub carried: Option<pose::Carried>,
    pub floating: Option<pose::Floating>,
}

/// One step, recorded in parts that are submitted together.
pub struct Recordings {
    /// Everything before the solver's loop.
    pub begin: Recording,
    /// The solver's set-up once more, after contacts were dropped.
    pub again: Recording,
    /// The same two, of a step that is linearised once more, where there are any.
    pub newton: Option<[Recording; 2]>,
    /// Iterations, in plans of graded length.
    pub iterate: Vec<(u32, Recording)>,
    /// The verdict, the new state, the wrench.
    pub end: Recording,
    /// Where no step succeeds: everything stops.
    pub stop: Recording,
}

impl Stages {
    /// Kernels and arrays of the stages that the model needs; `path` where it needs the depth stage.
    pub fn new(context: &Arc<Context>, model: &Model, path: Option<Path>, probe_nodes: &[[u32; 4]]) -> Result<Stages> {
        let common = Common::new(context, model)?;
        let touch = if model.pairs.is_empty() { None } else { Some(TouchStages::new(context, model, path, true)?) };
        let solve = Solve::new(context, model, touch.as_ref().map(|t| &t.contact.touch))?;
        let held = model.tool_frame.or(model.held);
        let wrench = if held.is_some() && touch.is_some() { Some(Wrench::new(context, model)?) } else { None };
        let gap = if touch.is_some() { Gap::new(context, model)? } else { None };
        let probes = if probe_nodes.is_empty() { None } else { Some(Probes::new(context, probe_nodes)?) };
        let (carried, floating) = (pose::Carried::new(context, model)?, pose::Floating::new(context, model)?);
        let elastic = Elastic::new(context, model)?;
        Ok(Stages { elastic, common, solve, touch, wrench, gap, probes, carried, floating })
    }

    /// Takes up what a model of the same bodies says of materials.
    pub fn refresh(&self, model: &Model) -> Result<()> {
        self.elastic.refresh(model)?;
        self.solve.refresh(model)
    }

    /// The arrays that a step leaves for the next: all that there is of the past on the device.
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

impl Recordings {
    /// Records every part, with iterations up to one more than the cap, so that the pass that notices it is there.
    pub fn new(stages: &Stages, max_iterations: u32, recorder: impl Fn() -> Result<Recorder>) -> Result<Recordings> {
        let Stages { common, elastic, solve, touch, wrench, gap, probes, carried, floating } = stages;

        let mut begin = recorder()?;
        if let Some(carried) = carried {
            carried.record(&mut begin, common, elastic, solve);
        }
        match touch {
            Some(touch) => touch.record(&mut begin, common, elastic),
            None => elastic.record_reset(&mut begin, common),
        }
        solve.record_reset(&mut begin);
        elastic.record(&mut begin, common);
        solve.record_start(&mut begin, common, elastic);

        let mut again = recorder()?;
        elastic.record(&mut again, common);
        solve.record_start(&mut again, common, elastic);

        let newton = match elastic.repeats() {
            true => {
                let [mut first, mut again] = [recorder()?, recorder()?];
                elastic.record_trial(&mut first, common, solve);
                for part in [&mut first, &mut again] {
                    elastic.record_again(part, common);
                    solve.record_start(part, common, elastic);
                }
                Some([first.finish()?, again.finish()?])
            }
            false => None,
        };

        let mut iterate = Vec::new();
        let mut length = SHORTEST_PLAN;
        loop {
            let mut plan = recorder()?;
            let iterations = length.min((max_iterations + 1).next_multiple_of(2));
            solve.record_iterations(&mut plan, common, elastic, iterations);
            iterate.push((iterations, plan.finish()?));
            if length > max_iterations {
                break;
            }
            length *= 2;
        }

        let mut end = recorder()?;
        solve.record_end(&mut end, common, elastic);
        if let (Some(wrench), Some(touch)) = (wrench, touch) {
            wrench.record(&mut end, common, &touch.contact.touch);
        }
        if let (Some(gap), Some(TouchStages { pose, skin, cull, depth: Some(depth), .. })) = (gap, touch) {
            gap.record(&mut end, common, &Skins { pose, cull, skin, depth }, elastic, solve);
        }
        if let Some(floating) = floating {
            floating.record(&mut end, common, elastic);
        }
        if let Some(probes) = probes {
            probes.record(&mut end, elastic);
        }
        let mut stop = recorder()?;
        solve.record_stop(&mut stop, elastic);
        let (begin, again, end, stop) = (begin.finish()?, again.finish()?, end.finish()?, stop.finish()?);
        Ok(Recordings { begin, again, newton, iterate, end, stop })
    }

    /// Every part once.
    pub fn submit_once(&self) -> Result<()> {
        let mut parts = vec![&self.begin, &self.again];
        parts.extend(self.newton.iter().flatten());
        parts.extend(self.iterate.iter().map(|(_, plan)| plan));
        parts.push(&self.end);
        Recording::submit_all(&parts)
    }

    /// The shortest plan of at least so many iterations, or the longest.
    pub fn plan(&self, iterations: u32) -> &Recording {
        let fits = self.iterate.iter().find(|(length, _)| *length >= iterations);
        &fits.unwrap_or(&self.iterate[self.iterate.len() - 1]).1
    }
}
