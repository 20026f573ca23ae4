//! Part `ticks` of `palpate bench haptics`: how late the haptic loop's ticks (its iterations) are in real time,
//! compared with a thread that does nothing but wake at the same deadlines (the bare timer).

use std::sync::Arc;

use glam::DVec3;
use palpate::Result;
use palpate::internal::haptics::clock::Lateness;
use palpate::internal::haptics::environment::Environment;
use palpate::internal::haptics::session::{Options, hold};
use palpate::internal::step::trajectory::Trajectory;
use palpate::scene::Haptics;
use palpate_devices::scripted::Scripted;
use serde::{Deserialize, Serialize};

use super::head::{self, CHEEK, Skin};
use super::rig::{PERIOD, key, tool, wall};
use super::{Settings, profile};

/// By how much the share of deadlines that the loop misses may exceed the share that the bare timer misses.
pub const MORE: f64 = 1e-3;
/// Profile of the haptic device, which follows a script and plays no force.
const DEVICE: &str = "scripted";
/// At the start the tool (rigid body that the haptic device leads) is this far above the position in which it first
/// touches the wall or head, at the end it is meant to be this far below that position, m.
const DEEP: f64 = 0.005;
/// Shortest time step of the simulation, s.
const SHORTEST_STEP: f64 = 1e-3;

/// Lateness of the loop's ticks and of the bare timer in the same run.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Punctual {
    /// Whether the engine simulates a soft head during the run, without pause; if not, the tool meets a wall, whose
    /// simulation takes almost no time.
    pub is_loaded: bool,
    /// Lateness of the loop's ticks.
    pub servo: Late,
    /// Lateness of the bare timer's wake-ups; `None`: no thread could be started for the timer.
    pub bare: Option<Late>,
    /// Number of steps of the simulation.
    pub steps: u64,
    /// Staleness, s: by how much the newest contact wrench of the simulation was out of date in a tick; the median and
    /// the 99th percentile over all ticks.
    pub age: [f64; 2],
    /// Remarks that the session (haptic loop with device and simulation) made about its run.
    pub notes: Vec<String>,
}

impl Punctual {
    /// Whether the share of deadlines that the loop missed is at most the share that the bare timer missed (0 if there
    /// is no timer) plus `MORE`.
    pub fn is_punctual(&self) -> bool {
        self.servo.share_missed <= self.bare.map_or(0.0, |bare| bare.share_missed) + MORE
    }
}

/// Distribution of the lateness of ticks or wake-ups.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Late {
    /// Number of ticks that were run.
    pub ticks: u64,
    /// Median lateness, s.
    pub median: f64,
    /// 99th percentile of the lateness, s.
    pub p99: f64,
    /// 99.9th percentile of the lateness, s.
    pub p999: f64,
    /// Greatest lateness, s.
    pub worst: f64,
    /// Number of deadlines missed by more than 2 ms.
    pub missed: u64,
    /// Share of all deadlines that were missed by more than 2 ms.
    pub share_missed: f64,
}

impl Late {
    fn of(lateness: &Lateness) -> Late {
        Late {
            ticks: lateness.ticks(),
            median: lateness.quantile(0.5),
            p99: lateness.quantile(0.99),
            p999: lateness.quantile(0.999),
            worst: lateness.worst(),
            missed: lateness.missed(),
            share_missed: lateness.share_missed(),
        }
    }
}

/// Measures the lateness, first without load, then while the engine simulates the head.
pub fn measure(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Vec<Punctual>> {
    watch("ticks: without load");
    let idle = session(settings, false, [DVec3::Y * DEEP, DVec3::Y * -DEEP], &mut wall(500.0, 0.0, DVec3::Y * DEEP))?;
    watch("ticks: while the head is simulated");
    let touch = Skin::of(&head::scene(settings, DVec3::ZERO))?.touch(CHEEK)?;
    let ends = [touch + DVec3::Z * DEEP, touch - DVec3::Z * DEEP];
    let mut simulation = head::open(&head::scene(settings, ends[0]), settings)?;
    Ok(vec![idle, session(settings, true, ends, &mut simulation)?])
}

fn session(
    settings: &Settings,
    is_loaded: bool,
    [start, end]: [DVec3; 2],
    environment: &mut dyn Environment,
) -> Result<Punctual> {
    let keys = [key(0.0, start), key(0.5, start), key(1.0, end)];
    let device = Scripted::new(Trajectory::new(&keys, keys[0]), profile(DEVICE)?.clone(), PERIOD);
    let options = Options {
        seconds: settings.jitter_seconds,
        shortest_step: SHORTEST_STEP,
        stop: Arc::default(),
        bare_timer: true,
    };
    let report = hold(Box::new(device), &tool(start), &Haptics::default(), environment, &options, |_| Ok(()))?;
    Ok(Punctual {
        is_loaded,
        servo: Late::of(&report.lateness),
        bare: report.bare.as_ref().map(Late::of),
        steps: report.steps,
        age: [0.5, 0.99].map(|share| report.staleness.quantile(share)),
        notes: report.notes,
    })
}
