//! The summary of a run, as `summary.json` and as the closing table on the terminal. A step consists of *stages*;
//! before the first step those stages that the scene needs are recorded as GPU commands. The *tool* is the rigid body
//! that the haptic device leads; a *flag* marks what went wrong in a step.

use std::fmt;

use glam::DVec3;
use palpate::internal::prepare::BodyReport;
use palpate::scene::preset::Chosen;
use palpate::{Explanation, Flags, StepReport};
use serde::Serialize;
use serde_json::{Map, Value, json};

use super::felt::{Felt, Touch};

/// What the engine reports of itself at the end of a run.
#[derive(Debug, Clone, Default)]
pub struct Facts {
    /// Name of the Vulkan device.
    pub device: String,
    /// Name and version of the device's driver.
    pub driver: String,
    /// The kind of buffers through which GPU kernels read their arrays, and the reason for this kind.
    pub arrays: String,
    /// The stages that are recorded and those that are left out, with reasons.
    pub plan: Vec<Plan>,
    /// Number of GPU passes (dispatches, draws, fills and copies) in a step.
    pub passes_per_step: u32,
    /// Memory allocated on the Vulkan device, bytes.
    pub bytes_device: u64,
    /// Times of the stages.
    pub stages: Vec<StageSamples>,
    /// For each body and for the tool: the name, and the findings in the mesh files.
    pub files: Vec<(String, BodyReport)>,
}

/// A stage, recorded or left out.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Name of the stage.
    pub stage: String,
    /// Whether the stage is recorded.
    pub recorded: bool,
    /// Reason for recording the stage or leaving it out.
    pub reason: String,
}

/// Times of one stage, or where passes are timed by themselves, of one kernel, or of the fills or copies of one array.
#[derive(Debug, Clone)]
pub struct StageSamples {
    /// Name of the stage.
    pub stage: String,
    /// Number of GPU passes of this stage in a step.
    pub passes: u32,
    /// Time of the stage in each step, microseconds.
    pub us: Vec<f64>,
}

impl StageSamples {
    /// Median and 99th percentile, microseconds; `None` without samples.
    pub fn quantiles(&self) -> Option<(f64, f64)> {
        quantiles(&self.us)
    }
}

/// Median and 99th percentile of samples, by nearest rank; `None` without samples.
pub fn quantiles(samples: &[f64]) -> Option<(f64, f64)> {
    let mut sorted = samples.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let rank = |percent: usize| (sorted.len() * percent).div_ceil(100).max(1) - 1;
    if sorted.is_empty() { None } else { Some((sorted[rank(50)], sorted[rank(99)])) }
}

/// Least distance that the tool must move in a step, m, for the ratio of a contact normal's rotation to that distance
/// to be meaningful.
const SLIDING: f64 = 1e-6;

/// Sums and extremes over the step reports of a run.
#[derive(Debug, Clone, Default)]
pub struct Tally {
    /// Number of steps done.
    pub steps: u64,
    /// What the tool felt, of several tools the first; `None` without a tool.
    pub touch: Option<Touch>,
    /// Names of the tools after the first, in the scene's order, each with what the tool felt.
    pub further_touches: Vec<(String, Touch)>,
    /// Greatest number of contacts in the scene at once; `None` where nothing can collide.
    pub most_contacts: Option<u32>,
    /// Number of contacts in the scene at the end; `None` where nothing can collide.
    pub last_contacts: Option<u32>,
    /// Greatest angle by which the normal of a contact patch (area with one contact normal) turned in a step, rad;
    /// `None` where nothing can collide.
    pub normal_turn: Option<f64>,
    /// Greatest ratio of the angle by which a contact patch's normal turned in a step to the distance that the tool
    /// moved in that step, rad/mm, among the steps in which the tool moved at least [`SLIDING`].
    pub normal_turn_per_mm: Option<f64>,
    last_tool: Option<DVec3>,
    /// Number of conjugate gradient iterations in all steps together.
    pub iterations: u64,
    /// Greatest number of conjugate gradient iterations in a step.
    pub most_iterations: u32,
    /// Number of steps that raised each flag, in the order of [`Flags::ALL`].
    pub flags: [u64; Flags::ALL.len()],
    /// Wall time of each step, microseconds.
    pub step_us: Vec<f64>,
}

impl Tally {
    /// A tally of no steps. `further_tools`: names of the tools after the first, in the scene's order.
    pub fn new(further_tools: impl Iterator<Item = String>) -> Tally {
        Tally { further_touches: further_tools.map(|name| (name, Touch::default())).collect(), ..Tally::default() }
    }

    /// Adds a step report.
    pub fn add(&mut self, row: &StepReport) {
        self.steps += 1;
        if let Some(tool) = &row.tool {
            self.touch.get_or_insert_default().add(row, tool);
        }
        self.further_touches.iter_mut().zip(&row.further_tools).for_each(|((_, touch), tool)| touch.add(row, tool));
        (self.most_contacts, self.last_contacts) = (self.most_contacts.max(row.contacts), row.contacts);
        let way = row.tool.as_ref().zip(self.last_tool).map(|(tool, last)| tool.tool.position.distance(last));
        if let Some(turn) = row.normal_turn {
            self.normal_turn = Some(self.normal_turn.unwrap_or(0.0).max(turn));
            if let Some(way) = way.filter(|way| *way >= SLIDING) {
                self.normal_turn_per_mm = Some(self.normal_turn_per_mm.unwrap_or(0.0).max(turn / (1e3 * way)));
            }
        }
        self.last_tool = row.tool.as_ref().map(|tool| tool.tool.position);
        self.iterations += u64::from(row.iterations);
        self.most_iterations = self.most_iterations.max(row.iterations);
        for (count, (flag, _)) in self.flags.iter_mut().zip(Flags::ALL) {
            *count += u64::from(row.flags.contains(flag));
        }
        self.step_us.push(row.step_us);
    }

    /// Number of steps that raised a flag.
    pub fn count(&self, flag: Flags) -> u64 {
        let all = Flags::ALL.iter().zip(self.flags);
        all.filter(|((known, _), _)| *known == flag).map(|(_, count)| count).sum()
    }

    /// The flags that were raised, in words, and the number of steps that raised each.
    pub fn raised(&self) -> impl Iterator<Item = (&'static Explanation, u64)> {
        let all = Flags::ALL.into_iter().zip(self.flags).filter(|(_, count)| *count > 0);
        all.flat_map(|((flag, _), count)| flag.explained().map(move |(_, words)| (words, count)))
    }
}

/// The contents of `summary.json`.
#[derive(Debug, Clone, Serialize)]
pub struct Summary {
    /// Name of the Vulkan device.
    pub device: String,
    /// Name and version of the device's driver.
    pub driver: String,
    /// The kind of buffers through which GPU kernels read their arrays, and the reason for this kind.
    pub arrays: String,
    /// Name of the scene.
    pub scene: String,
    /// Number of steps done.
    pub steps: u64,
    /// How a signal cut the run short, in words; left out if it did not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub interrupted: Option<String>,
    /// Time step, s.
    pub dt_s: f64,
    /// `median` and `p99` (99th percentile) of the time of each stage, and of the whole `step` (wall time),
    /// microseconds.
    pub stage_us: Map<String, Value>,
    /// Number of GPU passes in a step.
    pub passes_per_step: u32,
    /// `recorded`: names of the recorded stages; `reasons`: the reason for recording each of these; `left_out`: the
    /// stages left out, with reasons.
    pub plan: Value,
    /// Memory allocated on the Vulkan device, bytes.
    pub bytes_device: u64,
    /// Greatest contact force on the tool, N; null without a tool.
    pub peak_force_n: Option<f64>,
    /// What the tool felt; null without a tool.
    pub felt: Option<Felt>,
    /// By name of the tool: the same for tools after the first; left out if there are none.
    #[serde(skip_serializing_if = "Map::is_empty")]
    pub further_felt: Map<String, Value>,
    /// Greatest angle by which a contact patch's normal turned in a step (`most_rad`), and greatest ratio of that angle
    /// to the distance that the tool moved in the step (`most_rad_per_mm`); null where nothing can collide.
    pub normal_turn: Value,
    /// For each flag, the number of steps that raised it; every flag is listed.
    pub flags: Map<String, Value>,
    /// By name of the body: the findings in the body's files (`repair`, `notes`); bodies without findings are left out.
    pub files: Map<String, Value>,
    /// The preset (named set of settings) that the scene names, and the settings whose values come from it; left out if
    /// the scene names no preset.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub preset: Option<Chosen>,
    /// Report of a session (run of the haptic loop with a device), see [`summary`](super::haptics::summary); left out
    /// if the run had no device.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub haptics: Option<Value>,
    /// By name of the tool: the same for the haptic devices that led tools after the first; left out if there were none.
    #[serde(skip_serializing_if = "Map::is_empty")]
    pub further_haptics: Map<String, Value>,
    /// Version of palpate.
    pub version: &'static str,
}

impl Summary {
    /// Summarises a run.
    pub fn new(scene: &str, dt: f64, facts: &Facts, tally: &Tally) -> Self {
        let times = |(median, p99): (f64, f64)| json!({ "median": median, "p99": p99 });
        let mut stage_us: Map<String, Value> =
            facts.stages.iter().filter_map(|s| Some((s.stage.clone(), times(s.quantiles()?)))).collect();
        stage_us.extend(quantiles(&tally.step_us).map(|step| ("step".into(), times(step))));
        let part = |recorded: bool| facts.plan.iter().filter(move |plan| plan.recorded == recorded);
        let names: Vec<&str> = part(true).map(|plan| plan.stage.as_str()).collect();
        let reasons: Map<String, Value> =
            part(true).map(|plan| (plan.stage.clone(), plan.reason.as_str().into())).collect();
        let out: Vec<Value> = part(false).map(|p| json!({ "stage": p.stage, "reason": p.reason })).collect();
        let told = facts.files.iter().filter(|(_, report)| *report != BodyReport::default());
        let felt = tally.touch.as_ref().map(Touch::felt);
        Summary {
            device: facts.device.clone(),
            driver: facts.driver.clone(),
            arrays: facts.arrays.clone(),
            scene: scene.into(),
            steps: tally.steps,
            interrupted: None,
            dt_s: dt,
            stage_us,
            passes_per_step: facts.passes_per_step,
            plan: json!({ "recorded": names, "reasons": reasons, "left_out": out }),
            bytes_device: facts.bytes_device,
            peak_force_n: felt.as_ref().map(|felt| felt.peak_force_n),
            felt,
            further_felt: tally
                .further_touches
                .iter()
                .map(|(name, touch)| (name.clone(), json!(touch.felt())))
                .collect(),
            normal_turn: json!({ "most_rad": tally.normal_turn, "most_rad_per_mm": tally.normal_turn_per_mm }),
            flags: Flags::ALL.iter().zip(tally.flags).map(|((_, name), n)| (name.to_string(), n.into())).collect(),
            files: told.map(|(name, report)| (name.clone(), json!(report))).collect(),
            preset: None,
            haptics: None,
            further_haptics: Map::new(),
            version: env!("CARGO_PKG_VERSION"),
        }
    }
}

/// The flags that were raised, in words, each on a line.
pub struct RaisedFlags<'a>(pub &'a Tally);

impl fmt::Display for RaisedFlags<'_> {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        for (Explanation { title, meaning, remedy }, count) in self.0.raised() {
            let remedy = remedy.map_or(String::new(), |remedy| format!(" Remedy: {remedy}"));
            writeln!(f, "warning: {title}, in {count} of {} steps. {meaning}{remedy}", self.0.steps)?;
        }
        Ok(())
    }
}

/// The table of what a run cost.
pub struct ClosingTable<'a> {
    /// What the engine reports of itself.
    pub facts: &'a Facts,
    /// Sums and extremes over the step reports of the run.
    pub tally: &'a Tally,
}

impl fmt::Display for ClosingTable<'_> {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let ClosingTable { facts, tally } = self;
        let width = facts.stages.iter().map(|stage| stage.stage.len()).fold(16, usize::max);
        let line = |f: &mut fmt::Formatter, name: &str, passes: u32, times: Option<(f64, f64)>| {
            let cell = |time: Option<f64>| time.map_or("-".into(), |us| format!("{us:.1}"));
            let (median, p99) = (cell(times.map(|t| t.0)), cell(times.map(|t| t.1)));
            writeln!(f, "{name:<width$} {passes:>6} {median:>12} {p99:>12}")
        };
        writeln!(f, "{:<width$} {:>6} {:>12} {:>12}", "stage", "passes", "median us", "p99 us")?;
        for stage in &facts.stages {
            line(f, &stage.stage, stage.passes, stage.quantiles())?;
        }
        line(f, "step", facts.passes_per_step, quantiles(&tally.step_us))?;
        writeln!(f, "device: {} ({})", facts.device, facts.driver)?;
        let mean = tally.iterations as f64 / tally.steps.max(1) as f64;
        writeln!(f, "steps: {}; solver iterations: {mean:.1} per step, {} at most", tally.steps, tally.most_iterations)
    }
}

#[cfg(test)]
mod tests {
    use palpate::ToolReport;

    use super::*;

    fn example() -> (Facts, Tally) {
        let facts = Facts {
            device: "a device".into(),
            driver: "a driver 1.2".into(),
            arrays: "texel buffers: asked for".into(),
            plan: vec![
                Plan { stage: "pose".into(), recorded: true, reason: "one pair".into() },
                Plan { stage: "cull".into(), recorded: false, reason: "nothing collides".into() },
            ],
            passes_per_step: 3,
            bytes_device: 4096,
            stages: vec![StageSamples { stage: "pose".into(), passes: 3, us: (1..=200).map(f64::from).collect() }],
            files: vec![
                ("head".into(), BodyReport { repair: None, notes: vec!["head.obj: mended".into()] }),
                ("floor".into(), BodyReport::default()),
            ],
        };
        let mut tally = Tally::default();
        for (force, flags) in [(3.0, Flags(0)), (5.0, Flags::FROZEN), (4.0, Flags::FROZEN)] {
            let tool = Some(ToolReport { force: DVec3::Y * -force, ..Default::default() });
            tally.add(&StepReport { tool, flags, iterations: 4, step_us: force, ..Default::default() });
        }
        (facts, tally)
    }

    #[test]
    fn a_summary_has_every_key_and_what_the_rows_add_up_to() {
        let (facts, tally) = example();
        let value = serde_json::to_value(Summary::new("press", 0.001, &facts, &tally)).unwrap();
        let keys: Vec<&String> = value.as_object().unwrap().keys().collect();
        let expected = [
            "device",
            "driver",
            "arrays",
            "scene",
            "steps",
            "dt_s",
            "stage_us",
            "passes_per_step",
            "plan",
            "bytes_device",
            "peak_force_n",
            "felt",
            "normal_turn",
            "flags",
            "files",
            "version",
        ];
        assert_eq!(keys, expected);
        assert_eq!((&value["steps"], &value["peak_force_n"]), (&json!(3), &json!(5.0)));
        assert_eq!((&value["felt"]["peak_force_n"], &value["felt"]["steps_in_contact"]), (&json!(5.0), &json!(3)));
        assert_eq!(value["stage_us"]["pose"], json!({ "median": 100.0, "p99": 198.0 }));
        assert_eq!(value["stage_us"]["step"], json!({ "median": 4.0, "p99": 5.0 }));
        assert_eq!((&value["flags"]["frozen"], &value["flags"]["not_converged"]), (&json!(2), &json!(0)));
        assert_eq!(value["files"], json!({ "head": { "repair": null, "notes": ["head.obj: mended"] } }));
        assert_eq!(value["plan"]["recorded"], json!(["pose"]));
        assert_eq!(value["plan"]["reasons"], json!({ "pose": "one pair" }));
        assert_eq!(value["plan"]["left_out"], json!([{ "stage": "cull", "reason": "nothing collides" }]));
    }

    #[test]
    fn each_further_tool_is_summed_up_under_its_name() {
        let mut tally = Tally::new(["right".to_owned()].into_iter());
        for (left, right) in [(3.0, 0.0), (1.0, 7.0)] {
            let [tool, further] = [left, right].map(|y| ToolReport { force: DVec3::Y * y, ..Default::default() });
            tally.add(&StepReport { tool: Some(tool), further_tools: vec![further], ..Default::default() });
        }
        let value = serde_json::to_value(Summary::new("two", 0.1, &Facts::default(), &tally)).unwrap();
        assert_eq!(value["peak_force_n"], json!(3.0));
        let right = &value["further_felt"]["right"];
        assert_eq!((&right["peak_force_n"], &right["steps_in_contact"]), (&json!(7.0), &json!(1)));
    }

    #[test]
    fn the_closing_table_names_stages_and_raised_flags_are_told_in_words() {
        let (facts, tally) = example();
        let text = ClosingTable { facts: &facts, tally: &tally }.to_string();
        assert!(text.contains("pose                  3        100.0        198.0"), "wrong table: {text}");
        let text = RaisedFlags(&tally).to_string();
        assert!(text.starts_with("warning: the simulation stood still, in 2 of 3 steps. "), "wrong lines: {text}");
        assert!(text.contains(" Remedy: ") && text.lines().count() == 1, "wrong lines: {text}");
        assert_eq!((tally.count(Flags::FROZEN), tally.count(Flags::NON_FINITE)), (2, 0));
    }

    #[test]
    fn a_run_without_tool_or_steps_is_summed_up_too() {
        let value = serde_json::to_value(Summary::new("s", 0.1, &Facts::default(), &Tally::default())).unwrap();
        assert_eq!((&value["peak_force_n"], &value["stage_us"]), (&Value::Null, &json!({})));
        assert_eq!(value["felt"], Value::Null);
    }
}
