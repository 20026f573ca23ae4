//! `palpate bench features`: what each feature costs in time and memory, switched off one by one.

mod scenes;

use std::time::Instant;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

pub use scenes::Feature;

use super::plot::{self, Bar};
use super::suite::{from_value, to_value};
use super::{Benchmark, Section, Table, median};
use crate::gpu::Options;
use crate::haptics::RigidState;
use crate::haptics::servo_thread::Held;
use crate::scene::Scene;
use crate::step::Simulation;
use crate::{Error, Result};

/// Solver iterations of the step whose passes are counted.
const ITERATIONS: u32 = 16;

/// How much is measured.
#[derive(Debug, Clone, Serialize)]
pub struct Settings {
    /// Steps before those that count: until the tool is pressed in.
    pub warm_up: usize,
    /// Rounds; in each, both take their turn.
    pub rounds: usize,
    /// Steps of each in a round.
    pub steps: usize,
    /// Device, by name or index; `None`: the best.
    pub device: Option<String>,
}

impl Settings {
    /// Some minutes.
    pub fn full() -> Settings {
        Settings { warm_up: 30, rounds: 10, steps: 20, device: None }
    }

    /// A first look.
    pub fn quick() -> Settings {
        Settings { warm_up: 22, rounds: 3, steps: 5, ..Settings::full() }
    }
}

/// A scene with the feature, or without it.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Run {
    /// Microseconds, a step each, for each round.
    pub step_us: Vec<Vec<f64>>,
    /// Memory on the device.
    pub bytes_device: u64,
    /// Of a step of sixteen iterations.
    pub passes: u32,
    /// Those of them that wait for an earlier one.
    pub dependent_passes: u32,
    /// Iterations of all steps that count.
    pub iterations: u64,
}

/// A feature's cost.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Cost {
    /// With it.
    pub with: Run,
    /// Without it.
    pub without: Run,
}

impl Run {
    /// Median over the steps of a round, the median of those, ms.
    pub fn ms(&self) -> f64 {
        median(&self.step_us.iter().map(|round| 1e-3 * median(round)).collect::<Vec<_>>())
    }

    /// Of a step that counts.
    fn mean_iterations(&self) -> f64 {
        let steps: usize = self.step_us.iter().map(Vec::len).sum();
        self.iterations as f64 / steps.max(1) as f64
    }
}

/// The benchmark: a part a feature.
pub struct Features(pub Settings);

impl Benchmark for Features {
    fn name(&self) -> &'static str {
        "features"
    }

    fn title(&self) -> &'static str {
        "What a feature costs"
    }

    fn settings(&self) -> Result<Value> {
        to_value(&self.0)
    }

    fn parts(&self) -> Vec<String> {
        Feature::ALL.map(|feature| feature.name().into()).to_vec()
    }

    fn measure(&self, part: &str, watch: &mut dyn FnMut(&str)) -> Result<Value> {
        let unknown = || Error::Usage(format!("no feature `{part}`; --list shows all"));
        let feature = Feature::ALL.into_iter().find(|feature| feature.name() == part).ok_or_else(unknown)?;
        watch(part);
        to_value(&cost(feature, &self.0)?)
    }

    fn preface(&self, settings: &Value) -> Result<String> {
        let number = |key: &str| settings[key].as_u64().unwrap_or(0);
        Ok(format!(
            "The smallest scene that shows a feature, with and without it, in turns: {} steps that do not count, then {} rounds \
             of {} steps each; medians of a round, and of those. Passes are those of a step of {ITERATIONS} solver iterations.",
            number("warm_up"),
            number("rounds"),
            number("steps")
        ))
    }

    fn sections(&self, parts: &Map<String, Value>) -> Result<Vec<Section>> {
        let known = Feature::ALL.into_iter().filter_map(|feature| Some((feature, parts.get(feature.name())?)));
        let costs: Vec<(Feature, Cost)> =
            known.map(|(feature, value)| Ok((feature, from_value(value)?))).collect::<Result<_>>()?;
        if costs.is_empty() { Ok(Vec::new()) } else { Ok(vec![section(&costs)?]) }
    }
}

/// One of the two under way.
struct Side {
    simulation: Simulation,
    held: Option<Held>,
    run: Run,
}

impl Side {
    fn open(feature: Feature, with: bool, settings: &Settings) -> Result<Side> {
        let scene = feature.scene(with)?;
        let options = Options { device: settings.device.clone(), one_thread: true, ..Options::default() };
        let mut simulation = Simulation::new(&scene, &options, None)?;
        simulation.time_every(u64::from(feature == Feature::Timestamps && with))?;
        let (passes, dependent_passes) = simulation.passes(ITERATIONS);
        let run = Run {
            bytes_device: simulation.context().bytes_allocated(),
            passes: passes.iter().map(|(_, count)| count).sum(),
            dependent_passes,
            ..Run::default()
        };
        let held = (feature == Feature::Stiffness && with).then(|| held(&scene)).flatten();
        Ok(Side { simulation, held, run })
    }

    /// So many steps; those of the warm-up are the keys' own.
    fn steps(&mut self, count: usize, counts: bool, dt: f64) -> Result<()> {
        let mut times = Vec::with_capacity(count);
        for _ in 0..count {
            let begun = Instant::now();
            let row = match &self.held {
                Some(held) if counts => self.simulation.step_held(held, dt)?,
                _ => self.simulation.step()?,
            };
            times.push(begun.elapsed().as_secs_f64() * 1e6);
            self.run.iterations += if counts { u64::from(row.iterations) } else { 0 };
        }
        if counts {
            self.run.step_us.push(times);
        }
        Ok(())
    }
}

/// A loop whose device stays where the keys end, and whose tool is pressed in as deep.
fn held(scene: &Scene) -> Option<Held> {
    let last = scene.drive.last()?;
    let state = RigidState::at_rest(last.position, last.orientation);
    Some(Held { ticks: 0, time: 0.0, device: state, tool: state, coupling: scene.coupling })
}

fn cost(feature: Feature, settings: &Settings) -> Result<Cost> {
    let mut sides = [true, false].map(|with| Side::open(feature, with, settings));
    if let [Ok(with), Ok(without)] = &mut sides {
        for side in [&mut *with, &mut *without] {
            side.steps(settings.warm_up, false, 0.001)?;
        }
        for round in 0..settings.rounds {
            // First the one, then the other goes first.
            let order = if round % 2 == 0 { [&mut *with, &mut *without] } else { [&mut *without, &mut *with] };
            for side in order {
                side.steps(settings.steps, true, 0.001)?;
            }
        }
    }
    let [with, without] = sides;
    Ok(Cost { with: with?.run, without: without?.run })
}

fn section(costs: &[(Feature, Cost)]) -> Result<Section> {
    let heads = [
        "feature",
        "compared",
        "with, ms",
        "without, ms",
        "ratio",
        "iterations",
        "with, MB",
        "without, MB",
        "passes",
        "dependent",
    ];
    let mut table = Table::new(heads);
    let mut bars = Vec::new();
    for (feature, Cost { with, without }) in costs {
        let pair = |of: fn(&Run) -> u32| format!("{} / {}", of(with), of(without));
        let megabytes = |run: &Run| format!("{:.2}", 1e-6 * run.bytes_device as f64);
        table.rows.push(vec![
            feature.name().into(),
            feature.question().into(),
            format!("{:.2}", with.ms()),
            format!("{:.2}", without.ms()),
            format!("{:.2}", with.ms() / without.ms()),
            format!("{:.0} / {:.0}", with.mean_iterations(), without.mean_iterations()),
            megabytes(with),
            megabytes(without),
            pair(|run| run.passes),
            pair(|run| run.dependent_passes),
        ]);
        for (run, kind, what) in [(with, 0, "with"), (without, 1, "without")] {
            bars.push(Bar { name: format!("{what} {}", feature.name()), length: run.ms(), kind });
        }
    }
    Ok(Section {
        title: "Time and memory of a step with each feature, and without it".into(),
        question:
            "What does a feature cost where it is used? Iterations (of a step, mean), passes and dependent passes are \
                   with and without it."
                .into(),
        table,
        plot: Some(plot::bars("ms a step", &bars)?),
        finding: finding(costs),
        ..Section::default()
    })
}

/// The dearest in time, and in memory.
fn finding(costs: &[(Feature, Cost)]) -> String {
    let time = |cost: &Cost| cost.with.ms() / cost.without.ms();
    let bytes = |cost: &Cost| cost.with.bytes_device as f64 / cost.without.bytes_device.max(1) as f64;
    let most = |of: &dyn Fn(&Cost) -> f64| costs.iter().max_by(|a, b| of(&a.1).total_cmp(&of(&b.1)));
    let (Some((slow, a)), Some((large, b))) = (most(&time), most(&bytes)) else { return String::new() };
    format!(
        "Dearest in time is {} ({:.2} times the step without), in memory {} ({:.2} times).",
        slow.name(),
        time(a),
        large.name(),
        bytes(b)
    )
}
