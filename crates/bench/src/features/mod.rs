//! `palpate bench features`: the time and memory that each feature of the engine costs, measured with two scenes, one
//! with the feature and one without it; and whether a feature that is not used costs nothing. In most scenes the tool
//! (rigid body that the haptic device leads) is pressed into a soft body.

mod document;
mod plan;
mod scenes;

use std::time::Instant;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

pub use plan::Plan;
pub use scenes::Feature;

use palpate::internal::step::DeviceInput;
use palpate::{Error, Options, Result, RigidState, Scene, Simulation, StepReport, Threads};

use super::suite::{from_value, to_value};
use super::{Benchmark, Section, median};

/// Time step of the scenes, s.
const STEP: f64 = 0.001;

/// How much is measured.
#[derive(Debug, Clone, Serialize)]
pub struct Settings {
    /// Number of steps at the start that are not measured; during these steps the tool is pressed in.
    pub warm_up: usize,
    /// Number of rounds; each round runs the scene with the feature and the scene without it, every second round in
    /// reverse order.
    pub rounds: usize,
    /// Steps of each scene in a round.
    pub steps: usize,
    /// GPU device, by name or index; `None`: the best one.
    pub device: Option<String>,
}

impl Settings {
    /// The whole benchmark, which takes some minutes.
    pub fn full() -> Settings {
        Settings { warm_up: 30, rounds: 10, steps: 20, device: None }
    }

    /// A short form of the benchmark, for a first look.
    pub fn quick() -> Settings {
        Settings { warm_up: 22, rounds: 3, steps: 5, ..Settings::full() }
    }
}

/// Measurements of the scene with the feature or of the scene without it.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Run {
    /// Wall time of each step, us; one list for each round.
    pub step_us: Vec<Vec<f64>>,
    /// Passes (kernels, fills and copies on the GPU) and memory of a step.
    pub plan: Plan,
    /// Solver iterations of all measured steps together.
    pub iterations: u64,
}

/// The cost of a feature.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Cost {
    /// The scene with the feature.
    pub with: Run,
    /// The scene without the feature.
    pub without: Run,
    /// Passes and memory of two simulations that do not use the feature: in the first the feature is switched off, in
    /// the second nothing ever asked for it. The two must be equal. `None`: no key of a scene switches the feature off.
    pub idle: Option<[Plan; 2]>,
}

impl Cost {
    /// Whether the feature costs nothing where it is switched off; `None`: it cannot be switched off.
    pub fn is_free_when_idle(&self) -> Option<bool> {
        self.idle.as_ref().map(|[off, never]| off == never)
    }
}

impl Run {
    /// Time of a step, ms: the median over the rounds of each round's median over its steps.
    pub fn ms(&self) -> f64 {
        median(&self.step_us.iter().map(|round| 1e-3 * median(round)).collect::<Vec<_>>())
    }

    /// Time of a step divided by the mean number of its solver iterations, ms.
    fn ms_an_iteration(&self) -> f64 {
        self.ms() / self.mean_iterations()
    }

    /// Mean number of solver iterations of a measured step.
    fn mean_iterations(&self) -> f64 {
        let steps: usize = self.step_us.iter().map(Vec::len).sum();
        self.iterations as f64 / steps.max(1) as f64
    }
}

/// The benchmark `features`; each feature is a part of it.
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
            "For each feature the smallest scene that shows it is run with and without it, alternately: {} steps that \
             are not measured, then {} rounds of {} steps each. A time is the median over the rounds of each round's \
             median. Passes are those of a step of {} solver iterations.",
            number("warm_up"),
            number("rounds"),
            number("steps"),
            plan::ITERATIONS
        ))
    }

    fn sections(&self, parts: &Map<String, Value>) -> Result<Vec<Section>> {
        let costs = costs(parts)?;
        if costs.is_empty() { Ok(Vec::new()) } else { Ok(vec![document::section(&costs)?]) }
    }

    fn faults(&self, parts: &Map<String, Value>) -> Result<Vec<String>> {
        let bad = costs(parts)?.into_iter().filter(|(_, cost)| cost.is_free_when_idle() == Some(false));
        Ok(bad
            .map(|(feature, _)| format!("{}: costs passes or memory although it is switched off", feature.name()))
            .collect())
    }
}

fn costs(parts: &Map<String, Value>) -> Result<Vec<(Feature, Cost)>> {
    let known = Feature::ALL.into_iter().filter_map(|feature| Some((feature, parts.get(feature.name())?)));
    known.map(|(feature, value)| Ok((feature, from_value(value)?))).collect()
}

/// A running simulation, with the feature or without it.
struct Side {
    simulation: Simulation,
    /// Only for [`Feature::Stiffness`]: the input from a haptic loop (which reads the device and plays forces to it),
    /// and whether every step computes contact stiffness and damping for this loop; if not, only the last step of the
    /// warm-up does.
    input: Option<(DeviceInput, bool)>,
    run: Run,
}

impl Side {
    fn open(feature: Feature, with: bool, settings: &Settings) -> Result<Side> {
        let scene = feature.scene(with)?;
        let mut simulation = open(&scene, settings)?;
        simulation.time_every(u64::from(feature == Feature::Timestamps && with))?;
        let run = Run { plan: Plan::of(&simulation), ..Run::default() };
        let input = (feature == Feature::Stiffness).then(|| input(&scene)).flatten().map(|input| (input, with));
        Ok(Side { simulation, input, run })
    }

    /// Does `count` steps that are not measured, during which the tool is pressed in, and for [`Feature::Stiffness`]
    /// one more, in which the haptic loop takes over the tool.
    fn warm_up(&mut self, count: usize) -> Result<()> {
        (0..count).try_for_each(|_| self.simulation.step().map(drop))?;
        self.step_device_input().map(drop)
    }

    /// Does a step that also computes contact stiffness and damping for a haptic loop; `None`: there is no loop.
    fn step_device_input(&mut self) -> Result<Option<StepReport>> {
        let Some((input, _)) = &self.input else { return Ok(None) };
        // The loop's tool is placed where the simulation has it, so that the simulations with and without the feature
        // move alike.
        let now = self.simulation.tool().map(|tool| RigidState {
            position: tool.centre,
            orientation: tool.orientation,
            velocity: tool.velocity,
            angular_velocity: tool.angular_velocity,
        });
        let input = DeviceInput { tool: now.unwrap_or(input.tool), ..*input };
        self.simulation.step_device_input(&input, STEP).map(Some)
    }

    /// One round: measures `count` steps.
    fn steps(&mut self, count: usize) -> Result<()> {
        let mut times = Vec::with_capacity(count);
        for _ in 0..count {
            let begun = Instant::now();
            let asked =
                if self.input.as_ref().is_some_and(|(_, with)| *with) { self.step_device_input()? } else { None };
            let row = asked.map_or_else(|| self.simulation.step(), Ok)?;
            times.push(begun.elapsed().as_secs_f64() * 1e6);
            self.run.iterations += u64::from(row.iterations);
        }
        self.run.step_us.push(times);
        Ok(())
    }
}

fn open(scene: &Scene, settings: &Settings) -> Result<Simulation> {
    let options = Options { device: settings.device.clone(), threads: Some(Threads::Auto), ..Options::of_program() };
    Simulation::open(scene, &options)
}

/// Input from a haptic loop whose device stays at the last pose of the scene's trajectory (its keys in `[drive]`).
fn input(scene: &Scene) -> Option<DeviceInput> {
    let last = scene.trajectory.last()?;
    let state = RigidState::at_rest(last.position, last.orientation);
    Some(DeviceInput {
        ticks: 0,
        time: 0.0,
        device: state,
        tool: state,
        coupling: scene.coupling,
        max_force: f64::INFINITY,
    })
}

fn cost(feature: Feature, settings: &Settings) -> Result<Cost> {
    let [mut with, mut without] = [Side::open(feature, true, settings)?, Side::open(feature, false, settings)?];
    with.warm_up(settings.warm_up)?;
    without.warm_up(settings.warm_up)?;
    for round in 0..settings.rounds {
        // Each of the two simulations goes first in every second round.
        let order = if round % 2 == 0 { [&mut with, &mut without] } else { [&mut without, &mut with] };
        for side in order {
            side.steps(settings.steps)?;
        }
    }
    let idle = match feature.idle()? {
        Some(scenes::Idle::Scenes(both)) => {
            let [off, never] = both.each_ref().map(|scene| open(scene, settings).map(|s| Plan::of(&s)));
            Some([off?, never?])
        }
        // `Again` is for features that the caller asks for at a step, not in the scene. The simulation `with` has used
        // the feature and now does a step without it; `never` has not used it at all.
        Some(scenes::Idle::Again(scene)) => {
            with.simulation.time_every(0)?;
            with.simulation.step()?;
            let mut never = open(&scene, settings)?;
            never.time_every(0)?;
            Some([Plan::of(&with.simulation), Plan::of(&never)])
        }
        None => None,
    };
    Ok(Cost { with: with.run, without: without.run, idle })
}
