//! One step on the device: submitted, continued where it was too short, halved where it failed.

use super::{Simulation, tools};
use crate::gpu::Recording;
use crate::stages::types::{Fit, Report, verdict};
use crate::step::Flags;
use crate::{Error, Result};

/// Iterations a plan has over the last step's count, so that most steps need one submit.
const SPARE_ITERATIONS: u32 = 4;
/// Submits of one linearisation at most; beyond, the device does not keep its word.
const MOST_SUBMITS: u32 = 64;

impl Simulation {
    /// Advances by `h` seconds from the time `from`. A step that fails (not finite, or broken down with a tenth of the
    /// right-hand side's norm left) leaves the state as it was, and is done in halves, up to so many times; where even those
    /// fail, everything stops where it is: nothing ever leaps.
    pub(super) fn advance(&mut self, from: f64, h: f64, halvings: u32) -> Result<Report> {
        let device = self.drive.device(from + h, h);
        self.frames.set_out(from + h, h, self.tool.as_ref());
        self.step_origin = self.origin();
        self.write_inputs(h, &device)?;
        let mut report = self.submit()?;
        if report.verdict != verdict::FAILED {
            if let (Some(tool), None) = (&mut self.tool, self.model.held) {
                tool.advance(h, report.tool_change.map(f64::from));
            }
            let newton = self.scene.step.newton;
            let turned = self.frames.turns_too_far(h, newton);
            self.arrive(h, true)?;
            if turned || self.frames.turns_too_far(h, newton) {
                report.flags |= Flags::TURNS_TOO_FAR.0;
            }
            return Ok(report);
        }
        if halvings == 0 {
            self.stop(h)?;
            report.flags |= Flags::FROZEN.0;
            return Ok(report);
        }
        let first = self.advance(from, 0.5 * h, halvings - 1)?;
        let mut last = first;
        if !Flags(first.flags).contains(Flags::FROZEN) {
            last = self.advance(from + 0.5 * h, 0.5 * h, halvings - 1)?;
            last.iterations += first.iterations;
        }
        last.iterations += report.iterations;
        // Whether the solver converged is said by the steps that count.
        last.flags |= first.flags | (report.flags & !Flags::NOT_CONVERGED.0) | Flags::STEP_RETRIED.0;
        Ok(last)
    }

    /// No step succeeded: all that moves by itself stands still; what is driven goes on.
    fn stop(&mut self, h: f64) -> Result<()> {
        Recording::submit_all(&[&self.plain.stop])?;
        if let Some(tool) = &mut self.tool {
            (tool.velocity, tool.angular_velocity) = Default::default();
        }
        self.frames.stop();
        self.arrive(h, false)
    }

    /// Submits the step; where it ran out of iterations, contacts pulled, or it is to be linearised again, what is missing.
    /// Iterations are those of all solves.
    fn submit(&mut self) -> Result<Report> {
        let timed = self.timed_every > 0 && self.step % self.timed_every == 1 % self.timed_every;
        let set = match &self.timed {
            Some(both) if timed => &both[(self.step / self.timed_every % 2) as usize],
            _ => &self.plain,
        };
        let mut wanted = self.last_iterations + SPARE_ITERATIONS;
        let (mut again, mut times) = (&set.again, Vec::new());
        // What comes first, if anything does.
        let mut first = Some(&set.begin);
        // Of solves before the last, and of the longest linearisation.
        let (mut earlier, mut longest) = (0, 0);
        for _ in 0..MOST_SUBMITS * self.scene.step.newton {
            let all = [first.unwrap_or(&set.end), set.plan(wanted), &set.end];
            let parts = if first.is_some() { &all[..] } else { &all[1..] };
            Recording::submit_all(parts)?;
            if timed {
                parts.iter().for_each(|part| add_times(&mut times, part.stage_times()));
            }
            let mut report = self.stages.common.report.mapped::<Report>()?[0];
            match report.verdict {
                // Twice as many at a time, so that as many as a scene may ask for are soon reached.
                verdict::CONTINUE => (first, wanted) = (None, 2 * wanted),
                verdict::RETRY => {
                    earlier += report.iterations;
                    first = Some(again);
                }
                verdict::RELINEARISE => {
                    let Some([next, others]) = &set.newton else { break };
                    (earlier, longest) = (earlier + report.iterations, longest.max(report.iterations));
                    (again, first) = (others, Some(next));
                }
                _ => {
                    self.last_iterations = longest.max(report.iterations);
                    report.iterations += earlier;
                    self.last_timed = timed.then_some(times);
                    return Ok(report);
                }
            }
        }
        Err(Error::Simulation(format!("step {}: the solver reached no verdict", self.step)))
    }

    /// Frames to the end of the step; those that float to where their nodes are, those that are dynamic as they were pushed.
    fn arrive(&mut self, h: f64, accepted: bool) -> Result<()> {
        let floating = self.stages.floating.as_ref().filter(|_| accepted);
        let fits = floating.map(|floating| floating.fits.mapped::<Fit>()).transpose()?;
        let has_cores = accepted && !self.model.cores.is_empty();
        let changes = has_cores.then(|| self.stages.solve.core_changes.mapped::<[f32; 6]>()).transpose()?;
        self.frames.arrive(h, fits.as_deref().unwrap_or_default(), changes.as_deref().unwrap_or_default());
        if let (Some(tool), Some(core)) = (&mut self.tool, self.model.held) {
            tools::follow(tool, &self.frames, self.model.cores[core].frame);
        }
        Ok(())
    }
}

fn add_times(sums: &mut Vec<(String, f64)>, times: Vec<(String, f64)>) {
    for (name, us) in times {
        match sums.iter_mut().find(|(known, _)| *known == name) {
            Some((_, sum)) => *sum += us,
            None => sums.push((name, us)),
        }
    }
}
