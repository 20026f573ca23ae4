//! The algorithm of a step, in the order in which it runs. A core is a rigid body to which nodes of a soft body are
//! attached; a frame is a rigid coordinate frame, which floats where a soft body has no core. The tool is the rigid
//! body that the haptic device leads; a probe is a skin vertex whose path is recorded.
//!
//! 1. [`Simulation::advance_in_parts`] divides a step in which a fast tool could pass through a body.
//!    [`Simulation::advance`] writes the step's inputs: the haptic device's pose, rigid coordinate frames, the tool.
//! 2. [`Recordings::begin`]: velocities of nodes attached to moving frames; broad phase, narrow phase and contacts at
//!    the step's start (pose, cull, skin, depth, contact), beside which the element forces and the operator are
//!    computed; the solver's set-up with its first residual.
//! 3. [`Recordings::iterate`]: conjugate gradients, in recordings of several lengths, which together make a plan of
//!    as many iterations as the step will probably need; most steps need only one submit.
//! 4. [`Recordings::end`]: the verdict (a number by which the GPU says what is to follow the solve), the state at the
//!    end of the step, the wrench on the tool, the fit of floating frames, the probes; in a haptic loop also
//!    [`Recordings::gap`].
//! 5. [`Simulation::submit`] reads the verdict, which asks for more iterations, for a further Newton iteration or the
//!    check after the last ([`Recordings::newton`]), or for nothing more, or says that the step failed.
//! 6. [`Simulation::arrive`] moves frames and tool to the end of the step. A step that failed is repeated in two
//!    halves; where even the shortest halves fail, everything stops ([`Recordings::stop`]).

use super::plans::{MOST_PARTS, Plans};
use super::stage_set::Stages;
use super::{Flags, MOST_HALVINGS, Simulation, StepWork, Timing, tools};
use glam::DVec3;

use crate::gpu::{Recorder, Recording};
use crate::shaders::{self, Fit, Report};
use crate::stages::gap::Skins;
use crate::stages::touch::TouchStages;
use crate::{Error, Result};

/// Number of iterations of a plan that a release of contacts takes, besides those that the solver needs after it.
const RELEASE_ITERATIONS: u32 = 2;
/// Largest number of submits per Newton iteration. No step needs more, since the kernels limit the numbers of
/// iterations and of releases.
const MOST_SUBMITS: u32 = 64;

/// One step, recorded in parts; a submit has several of these.
pub struct Recordings {
    /// Everything before the solver's loop.
    pub begin: Recording,
    /// The element forces and the solver's set-up for a further Newton iteration, or for the check after the last.
    /// `None` where a step has only one Newton iteration.
    pub newton: Option<Recording>,
    pub iterate: Plans,
    /// What follows the iterations: the verdict, the state at the end of the step, the wrench.
    pub end: Recording,
    /// The gaps between the tool and the bodies near it, which only the steps of a haptic loop need.
    pub gap: Option<Recording>,
    /// Stops all motion, where no attempt at a step succeeds.
    pub stop: Recording,
}

/// A function that makes an empty recording.
type Blank<'a> = &'a dyn Fn() -> Result<Recorder>;

impl Recordings {
    /// Records every part. The longest plan has at least one iteration more than `max_iterations`: the passes of this
    /// further iteration notice that the limit is reached.
    pub fn new(stages: &Stages, max_iterations: u32, recorder: impl Fn() -> Result<Recorder>) -> Result<Recordings> {
        Ok(Recordings {
            begin: begin(stages, &recorder)?,
            newton: newton(stages, &recorder)?,
            iterate: iterate(stages, max_iterations, &recorder)?,
            end: end(stages, &recorder)?,
            gap: gap(stages, &recorder)?,
            stop: stop(stages, &recorder)?,
        })
    }

    /// Submits every part once, to warm up drivers that compile kernels late.
    pub fn submit_once(&self) -> Result<()> {
        let mut parts = vec![&self.begin];
        parts.extend(&self.newton);
        parts.extend(self.iterate.recordings());
        parts.push(&self.end);
        parts.extend(&self.gap);
        Recording::submit_all(&parts)
    }
}

fn begin(stages: &Stages, blank: Blank) -> Result<Recording> {
    let Stages { common, elastic, solve, touch, attached, .. } = stages;
    let mut begin = blank()?;
    common.record_inputs(&mut begin);
    if let Some(attached) = attached {
        attached.record(&mut begin, common, elastic, solve);
    }
    // Element forces and operator do not depend on contact, so their passes run beside those of the broad phase.
    match touch {
        Some(touch) => touch.record_pose(&mut begin, common, elastic),
        None => elastic.record_reset(&mut begin, common),
    }
    solve.record_reset(&mut begin);
    if let Some(loads) = &solve.loads {
        loads.record(&mut begin, common, elastic);
    }
    elastic.record(&mut begin, common);
    if let Some(touch) = touch {
        touch.record_broad_phase(&mut begin, common, elastic);
    }
    solve.record_operator(&mut begin, elastic);
    if let Some(touch) = touch {
        touch.record_narrow_phase(&mut begin, common, elastic, Some(solve));
    }
    solve.record_start(&mut begin, common, elastic);
    begin.finish()
}

fn newton(stages: &Stages, blank: Blank) -> Result<Option<Recording>> {
    let Stages { common, elastic, solve, .. } = stages;
    if !elastic.repeats() {
        return Ok(None);
    }
    let mut newton = blank()?;
    elastic.record_trial(&mut newton, common, solve);
    elastic.record_newton(&mut newton, common);
    solve.record_operator(&mut newton, elastic);
    solve.record_start(&mut newton, common, elastic);
    newton.finish().map(Some)
}

fn iterate(stages: &Stages, max_iterations: u32, blank: Blank) -> Result<Plans> {
    let Stages { common, elastic, solve, .. } = stages;
    Plans::new(max_iterations + 1, |iterations| {
        let mut part = blank()?;
        solve.record_iterations(&mut part, common, elastic, iterations);
        part.finish()
    })
}

fn end(stages: &Stages, blank: Blank) -> Result<Recording> {
    let Stages { common, elastic, solve, touch, wrench, probes, floating, .. } = stages;
    let mut end = blank()?;
    solve.record_end(&mut end, common, elastic);
    if let (Some(wrench), Some(touch)) = (wrench, touch) {
        wrench.record(&mut end, common, &touch.contact.touch, &touch.cull.pairs);
    }
    if let Some(floating) = floating {
        floating.record(&mut end, common, elastic);
    }
    if let Some(probes) = probes {
        probes.record(&mut end, elastic);
    }
    end.finish()
}

fn gap(stages: &Stages, blank: Blank) -> Result<Option<Recording>> {
    let Stages { common, elastic, solve, touch, gap, .. } = stages;
    let (Some(gap), Some(TouchStages { pose, skin, cull, .. })) = (gap, touch) else {
        return Ok(None);
    };
    let mut part = blank()?;
    gap.record(&mut part, common, &Skins { pose, cull, skin }, elastic, solve);
    part.finish().map(Some)
}

fn stop(stages: &Stages, blank: Blank) -> Result<Recording> {
    let mut stop = blank()?;
    stages.solve.record_stop(&mut stop, &stages.elastic);
    stop.finish()
}

impl Simulation {
    /// Advances by `h` seconds from the time `from` (s), in several parts if the tool could pass through a body unseen
    /// otherwise.
    pub(super) fn advance_in_parts(&mut self, from: f64, h: f64) -> Result<Report> {
        self.last_parts = 1;
        let (Some(passing), Some(tool), None) = (&self.passing, &self.tool, self.model.tool_core()) else {
            return self.advance(from, h, MOST_HALVINGS);
        };
        let device = self.trajectory.device(from + h, h);
        let is_pressed = self.last_wrench.is_some_and(|wrench| wrench.wrench.force != DVec3::ZERO);
        let displacement = h * tool.free_velocity(&device, h, is_pressed);
        let parts =
            passing.parts(tool, displacement, self.is_in_haptic_loop(), |frame| self.frames.place(frame).centre);
        self.last_parts = parts;
        let part = h / f64::from(parts);
        let mut all: Option<Report> = None;
        for k in 0..parts {
            let before = self.tool_end.or(self.tool.as_ref().map(|tool| tool.centre)).unwrap_or_default();
            let mut report = self.advance(from + f64::from(k) * part, part, MOST_HALVINGS)?;
            if let (Some(passing), Some(tool)) = (&self.passing, &self.tool) {
                self.tool_end = Some(tool.centre);
                // From the end of the last step on, since a haptic loop moves the tool between steps.
                let displacement = tool.centre - before;
                if passing.may_have_passed(tool, displacement, |frame| self.frames.place(frame).centre) {
                    report.flags |= Flags::MOVED_TOO_FAR.0;
                }
            }
            if let Some(all) = &all {
                report.iterations += all.iterations;
                report.nonlinear_residual = report.nonlinear_residual.max(all.nonlinear_residual);
                report.flags |= all.flags;
            }
            let is_frozen = Flags(report.flags).contains(Flags::FROZEN);
            all = Some(report);
            if is_frozen {
                break;
            }
        }
        all.ok_or_else(|| Error::Simulation("a step has no parts; this is an error in palpate".into()))
    }

    /// Advances by `h` seconds from the time `from` (s). A step fails where its solution is not finite, or the solver
    /// diverged or broke down early. A failed step leaves the state as it was and is repeated in two halves, which may
    /// be halved again, up to `halvings` times. Where even the shortest halves fail, everything stops where it is, so
    /// that nothing ever jumps.
    pub(super) fn advance(&mut self, from: f64, h: f64, halvings: u32) -> Result<Report> {
        let device = self.trajectory.device(from + h, h);
        self.frames.set_out(from + h, h, self.tool.as_ref());
        self.step_origin = self.origin();
        self.write_inputs(from + h, h, &device)?;
        if let Some(loads) = &self.stages.solve.loads {
            loads.write(&self.model, from + h)?;
        }
        let mut report = self.submit()?;
        if report.verdict != shaders::VERDICT_FAILED {
            if let (Some(tool), None) = (&mut self.tool, self.model.tool_core()) {
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
            last.nonlinear_residual = last.nonlinear_residual.max(first.nonlinear_residual);
        }
        last.iterations += report.iterations;
        // Flags for what did not converge are raised by the shorter steps alone, since they replace this one.
        let replaced = Flags::NOT_CONVERGED.0 | Flags::NEWTON_NOT_CONVERGED.0;
        last.flags |= first.flags | (report.flags & !replaced) | Flags::STEP_RETRIED.0;
        Ok(last)
    }

    /// Stops everything that forces move, where no attempt at the step succeeded; frames that follow a trajectory
    /// (driven frames) move on.
    fn stop(&mut self, h: f64) -> Result<()> {
        Recording::submit_all(&[&self.plain.stop])?;
        if let Some(tool) = &mut self.tool {
            (tool.velocity, tool.angular_velocity) = Default::default();
        }
        self.frames.stop();
        self.arrive(h, false)
    }

    /// Whether timestamps measure the current step.
    pub(super) fn is_timed(&self) -> bool {
        self.timed_every > 0 && self.step % self.timed_every == 1 % self.timed_every
    }

    /// Submits the step, and after it whatever the verdict asks for: more iterations, a further Newton iteration, or the
    /// check after the last of several. The report's number of iterations is the sum over all solves.
    fn submit(&mut self) -> Result<Report> {
        let timed = self.is_timed();
        let turn = self.step.checked_div(self.timed_every).unwrap_or_default() as usize;
        let set = if timed { &self.timed[turn % self.timed.len()] } else { &self.plain };
        let mut wanted = self.needs.predicted();
        let mut times = Vec::new();
        let gap = set.gap.as_ref().filter(|_| self.is_in_haptic_loop());
        // The part to submit before the iterations, if any.
        let mut first = Some(&set.begin);
        // Number of iterations of all earlier solves of this step together, of the longest, and the most that a plan
        // needed.
        let (mut earlier, mut longest, mut needed) = (0, 0, 0);
        // Number of iterations that were submitted of the present solve.
        let mut submitted = 0;
        for _ in 0..MOST_SUBMITS * (self.scene.step.newton + 1) {
            let (planned, plan) = set.iterate.plan(wanted);
            submitted = planned + if first.is_some() { 0 } else { submitted };
            let mut all = [&set.end; MOST_PARTS + 3];
            let mut count = 0;
            for part in first.into_iter().chain(plan).chain([&set.end]).chain(gap) {
                all[count] = part;
                count += 1;
            }
            let parts = &all[..count];
            Recording::submit_all(parts)?;
            let timed_parts = if timed { parts } else { &[] };
            let part_times: Vec<(String, f64)> = timed_parts.iter().flat_map(|part| part.stage_times()).collect();
            self.last_work += StepWork {
                solves: 0,
                submits: 1,
                planned_iterations: planned,
                dependent_passes: parts.iter().map(|part| part.dependent_passes()).sum(),
                gpu_us: timed.then(|| part_times.iter().map(|(_, us)| us).sum()),
            };
            add_by_name(&mut times, part_times);
            if self.timing == Timing::Passes {
                let passes = parts.iter().flat_map(|part| part.all_passes());
                add_by_name(&mut self.pass_counts, passes.map(|pass| (pass.what.clone(), 1)));
            }
            let mut report = self.stages.common.report.mapped::<Report>()?[0];
            if report.verdict == shaders::VERDICT_CONTINUE {
                // As many iterations again as the solve has had, so that even a large limit is reached soon.
                (first, wanted) = (None, submitted);
                continue;
            }
            self.last_work.solves += 1 + report.releases;
            longest = longest.max(report.iterations);
            needed = needed.max(report.iterations + RELEASE_ITERATIONS * report.releases + 1);
            match report.verdict {
                shaders::VERDICT_NEWTON => {
                    let Some(next) = &set.newton else { break };
                    earlier += report.iterations;
                    (first, wanted) = (Some(next), self.needs.predicted());
                }
                _ => {
                    self.last_iterations = longest;
                    if report.verdict == shaders::VERDICT_DONE {
                        self.needs.note(needed);
                    }
                    report.iterations += earlier;
                    self.last_timed = timed.then_some(times);
                    return Ok(report);
                }
            }
        }
        Err(Error::Simulation(format!(
            "step {}: the solver did not finish within the allowed submits; this is an error in palpate or the driver",
            self.step
        )))
    }

    /// Moves the frames to the end of the step: floating frames by a fit to sums that the GPU made, and the frames of
    /// dynamic cores (cores that forces move) by the change of twist that the solver found. `accepted`: whether the
    /// step succeeded; otherwise these frames stay where they are.
    fn arrive(&mut self, h: f64, accepted: bool) -> Result<()> {
        let floating = self.stages.floating.as_ref().filter(|_| accepted);
        let fits = floating.map(|floating| floating.fits.mapped::<Fit>()).transpose()?;
        let has_cores = accepted && !self.model.cores.is_empty();
        let changes = has_cores.then(|| self.stages.solve.core_changes.mapped::<[f32; 6]>()).transpose()?;
        self.frames.arrive(h, fits.as_deref().unwrap_or_default(), changes.as_deref().unwrap_or_default());
        if let (Some(tool), Some(core)) = (&mut self.tool, self.model.tool_core()) {
            tools::follow(tool, &self.frames, self.model.cores[core].frame);
        }
        self.further_tools.iter_mut().for_each(|tool| tool.follow(&self.model, &self.frames));
        Ok(())
    }
}

fn add_by_name<T: std::ops::AddAssign>(sums: &mut Vec<(String, T)>, more: impl IntoIterator<Item = (String, T)>) {
    for (name, value) in more {
        match sums.iter_mut().find(|(known, _)| *known == name) {
            Some((_, sum)) => *sum += value,
            None => sums.push((name, value)),
        }
    }
}
