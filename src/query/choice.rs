//! Chooses between the two implementations (*paths*) of the depth stage of a step, by compute or by graphics. The depth
//! stage finds where rays from the vertices of one skin (surface mesh of a body) hit triangles of another skin. The
//! path is the one that is asked for, or the only one that the device can run, or the faster one, which is measured
//! once per device. A *context* is an open Vulkan device.

use std::fmt;
use std::sync::Arc;
use std::time::Instant;

use glam::{DQuat, DVec3};

use crate::gpu::Context;
use crate::prepare::cache::{Entry, KeyMaker};
use crate::prepare::{self, Body, Cache};
use crate::query::{Query, QuerySettings};
use crate::scene::{Scene, Tool};
use crate::stages::depth::{self, Path};
use crate::{Error, Result};

/// Number of runs of each path before times are taken.
const WARM_UP: usize = 3;
/// Number of timed runs of each path; the median time counts.
const RUNS: usize = 9;
/// Radius of the two spheres on which the paths are measured, m.
const RADIUS: f64 = 0.01;
/// Depth by which the two spheres overlap, m.
const OVERLAP: f64 = 0.002;

/// The path that was chosen, and why.
pub struct Choice {
    /// The path that was chosen.
    pub path: Path,
    why: Why,
}

enum Why {
    /// The caller asks for this path.
    Asked,
    /// The device can run no other path.
    Only,
    /// The options do not ask for a measurement.
    Unmeasured,
    /// Median times of the depth stage, microseconds: first by the chosen path, second by the other path.
    Measured(f64, f64),
}

impl Choice {
    /// Takes the path `asked`, or else the only path that the device can run, or else the faster path if the context's
    /// options ask for a measurement (the times are kept in the context's cache folder), or else the compute path.
    pub fn new(context: &Arc<Context>, asked: Option<Path>) -> Result<Choice> {
        match asked {
            Some(Path::Graphics) if !context.fragment_stores() => Err(Error::NoDevice(format!(
                "{} lacks fragmentStoresAndAtomics for the graphics path; ask for depth \"compute\" or \"auto\"",
                context.device_name()
            ))),
            Some(path) => Ok(Choice { path, why: Why::Asked }),
            None if !context.fragment_stores() => Ok(Choice { path: Path::Compute, why: Why::Only }),
            None if !context.measures() => Ok(Choice { path: Path::Compute, why: Why::Unmeasured }),
            None => Ok(Choice::faster(kept_times(context, &Cache::of(context))?)),
        }
    }

    fn faster([graphics, compute]: [f64; 2]) -> Choice {
        if graphics < compute {
            Choice { path: Path::Graphics, why: Why::Measured(graphics, compute) }
        } else {
            Choice { path: Path::Compute, why: Why::Measured(compute, graphics) }
        }
    }
}

impl fmt::Display for Choice {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{} path: ", self.path.name())?;
        match self.why {
            Why::Asked => write!(f, "asked for"),
            Why::Only => write!(f, "the only one, since the device lacks fragmentStoresAndAtomics"),
            Why::Unmeasured => write!(f, "not measured"),
            Why::Measured(own, other) => write!(f, "measured {own:.0} us, the other path {other:.0} us"),
        }
    }
}

/// Median times of the depth stage by the graphics and by the compute path, microseconds. They are measured only if the
/// cache has no times for this device, this driver, this version of palpate and the kind of arrays in use.
fn kept_times(context: &Arc<Context>, cache: &Cache) -> Result<[f64; 2]> {
    if let Some(times) = context.measured_paths().get() {
        return Ok(*times);
    }
    let mut key = KeyMaker::new();
    let arrays = format!("{:?}", context.arrays());
    for field in [
        "depth path, storage texel buffers",
        &arrays,
        context.device_name(),
        context.driver(),
        env!("CARGO_PKG_VERSION"),
    ] {
        key.add(field.as_bytes());
    }
    let key = key.finish();
    let times = match cache.load(&key) {
        Entry::Found(times) => times,
        _ => {
            let times = measured_times(context)?;
            // If the times cannot be stored, the next context measures them again.
            let _ = cache.store(&key, &times);
            times
        }
    };
    Ok(*context.measured_paths().get_or_init(|| times))
}

/// Measures the median times of the depth stage by the graphics and by the compute path, microseconds. Both paths
/// answer one proximity query, for two spheres that overlap.
fn measured_times(context: &Arc<Context>) -> Result<[f64; 2]> {
    let scene = Scene::empty("two spheres");
    let ball = sphere(&scene)?;
    let settings = QuerySettings { direction: Some(DVec3::Y), ..QuerySettings::of(&ball, &ball) };
    let ask = |path| Query::on_device(context, &ball, &ball, &QuerySettings { depth: Some(path), ..settings });
    let mut queries = [ask(Path::Graphics)?, ask(Path::Compute)?];
    let mut times = [const { Vec::new() }; 2];
    for run in 0..WARM_UP + RUNS {
        for (query, times) in queries.iter_mut().zip(&mut times) {
            let begun = Instant::now();
            let pose = |height| (height * DVec3::Y, DQuat::IDENTITY);
            let answer = query.run(pose(0.0), pose(2.0 * RADIUS - OVERLAP))?;
            // If the device has no timestamps, the time of the whole query is taken; the other stages cost the same for
            // both paths.
            let whole = begun.elapsed().as_secs_f64() * 1e6;
            let stage = answer.stage_times.into_iter().find(|(stage, _)| stage == depth::STAGE);
            if run >= WARM_UP {
                times.push(stage.map_or(whole, |(_, us)| us));
            }
        }
    }
    Ok(times.map(|mut times| {
        times.sort_unstable_by(f64::total_cmp);
        times[RUNS / 2]
    }))
}

/// A rigid sphere with radius [`RADIUS`], centred at the origin.
fn sphere(scene: &Scene) -> Result<Body> {
    prepare::tool(&Tool::sphere(RADIUS, 1.0), scene)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::Options;

    #[test]
    fn a_device_is_measured_once_where_that_is_asked_for_and_never_where_the_path_is() {
        let device = std::env::var("PALPATE_TEST_DEVICE").ok();
        let folder = tempfile::tempdir().unwrap();
        let open = |cache: Option<&str>, measure| {
            let cache = cache.map(|name| folder.path().join(name));
            Context::open(&Options { device: device.clone(), cache, measure, ..Options::default() }).unwrap()
        };
        let context = open(Some("cache"), true);
        let choose = |context: &Arc<Context>, asked| Choice::new(context, asked).unwrap().to_string();
        assert_eq!(choose(&context, Some(Path::Compute)), "compute path: asked for");
        assert!(!folder.path().join("cache").exists());
        if !context.fragment_stores() {
            assert!(Choice::new(&context, Some(Path::Graphics)).is_err_and(|e| e.exit_status() == 3));
            assert!(choose(&context, None).starts_with("compute path: the only one"));
            return;
        }
        assert_eq!(choose(&context, Some(Path::Graphics)), "graphics path: asked for");
        assert_eq!(choose(&open(None, false), None), "compute path: not measured");
        let cache = Cache::of(&context);
        let begun = Instant::now();
        let first = kept_times(&context, &cache).unwrap();
        println!("median times of graphics and compute path {first:?} us, measured in {:?}", begun.elapsed());
        assert!(first.iter().all(|us| *us > 0.0 && us.is_finite()), "median times of both paths {first:?} us");
        // Times differ from one measurement to the next, so times equal to the last bit show that stored times were
        // read.
        assert_eq!(kept_times(&context, &cache).unwrap(), first);
        assert!(choose(&context, None).contains(" path: measured "));
        std::fs::write(folder.path().join("file"), "").unwrap();
        assert!(choose(&open(Some("file/under"), true), None).contains(" path: measured "));
        assert!(choose(&open(None, true), None).contains(" path: measured "));
        assert_eq!(context.validation_messages(), Vec::<String>::new());
    }

    #[test]
    fn the_faster_path_is_taken_and_said_with_both_figures() {
        let of = |times| Choice::faster(times).to_string();
        assert_eq!(of([210.4, 900.0]), "graphics path: measured 210 us, the other path 900 us");
        assert_eq!(of([900.0, 210.4]), "compute path: measured 210 us, the other path 900 us");
        assert_eq!(of([5.0, 5.0]), "compute path: measured 5 us, the other path 5 us");
    }
}
