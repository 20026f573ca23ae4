//! Simulates a press and reads its contact force where a curve was measured.

use std::sync::Arc;

use glam::DVec3;
use palpate::{Context, Error, Flags, Result, Scene, Simulation};

use crate::measured::{Abscissa, Measured};

/// A step of a simulated press.
#[derive(Debug, Clone, Copy)]
struct Sample {
    time: f64,
    centre: DVec3,
    force: DVec3,
    depth: f64,
}

/// Share of the greatest simulated indentation by which a measured curve may go beyond it: near the best values a stiff
/// body is pressed a little less deep than a soft one, since the coupling yields.
const BEYOND: f64 = 0.05;

/// Force at each abscissa of a measured curve, N, how many of them lie beyond the simulated curve, which is extrapolated
/// there, and the flags of all steps.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulated {
    pub forces: Vec<f64>,
    pub extrapolated: usize,
    pub flags: Flags,
}

/// Simulates a scene and reads its contact force, as a magnitude, where a curve was measured.
pub fn simulate(context: &Arc<Context>, scene: &Scene, measured: &Measured) -> Result<Simulated> {
    let mut simulation = Simulation::on_device(context, scene)?;
    simulation.time_every(0)?;
    let needed = match measured.over {
        Abscissa::Time => measured.points.iter().fold(0.0, |most: f64, (time, _)| most.max(*time)),
        Abscissa::Indentation => scene.duration(),
    };
    let (mut samples, mut flags) = (Vec::new(), Flags::default());
    while simulation.time() < needed - 1e-9 * needed {
        let report = simulation.step()?;
        flags = Flags(flags.0 | report.flags.0);
        let Some(tool) = report.tool else {
            return Err(Error::Usage("the scene has no tool, so no force is felt; add a [tool] and a [drive]".into()));
        };
        let depth = report.max_depth.unwrap_or(0.0);
        samples.push(Sample { time: report.time, centre: tool.tool.position, force: tool.force, depth });
    }
    let start = scene.tool.as_ref().map_or(DVec3::ZERO, |tool| tool.position);
    let curve: Vec<(f64, f64)> = match measured.over {
        Abscissa::Time => {
            std::iter::once((0.0, 0.0)).chain(samples.iter().map(|s| (s.time, s.force.length()))).collect()
        }
        Abscissa::Indentation => over_indentation(&samples, start)?,
    };
    let deepest = curve.last().map_or(0.0, |(x, _)| *x);
    let measured_deepest = measured.points.iter().fold(0.0, |most: f64, (x, _)| most.max(*x));
    if measured_deepest > (1.0 + BEYOND) * deepest {
        return Err(Error::Usage(format!(
            "the scene presses {:.3} mm deep, but the curve was measured to {:.3} mm; extend the keys of [drive], or \
             leave out the deepest points",
            1e3 * deepest,
            1e3 * measured_deepest
        )));
    }
    let forces = measured.points.iter().map(|(x, _)| at(&curve, *x)).collect();
    // Rounding of times and depths is not meant.
    let extrapolated = measured.points.iter().filter(|(x, _)| *x > (1.0 + 1e-6) * deepest).count();
    Ok(Simulated { forces, extrapolated, flags })
}

/// The part of a press up to its greatest indentation: indentation since first touch (m) and force (N), from 0 and 0.
/// Indentation is the distance that the tool's centre has moved since first touch along minus the direction of the peak
/// force. The tool is found to touch in a step at whose beginning it lies some way within the body already; that depth
/// is counted.
fn over_indentation(samples: &[Sample], start: DVec3) -> Result<Vec<(f64, f64)>> {
    let nothing = || Error::Usage("the tool of the scene touches nothing; extend the keys of [drive]".into());
    let first = samples.iter().position(|s| s.force != DVec3::ZERO).ok_or_else(nothing)?;
    let peak = samples.iter().max_by(|a, b| a.force.length().total_cmp(&b.force.length())).ok_or_else(nothing)?;
    let inwards = (-peak.force).try_normalize().ok_or_else(nothing)?;
    // Contacts are found where the step begins, which is where the last step ended.
    let before = first.checked_sub(1).map_or(start, |last| samples[last].centre);
    let touch = samples[first].depth;
    let mut curve = vec![(0.0, 0.0)];
    for sample in &samples[first..] {
        let indentation = touch + (sample.centre - before).dot(inwards);
        if curve.last().is_some_and(|(deepest, _)| indentation > *deepest) {
            curve.push((indentation, sample.force.length()));
        }
    }
    Ok(curve)
}

/// The value of a curve with rising abscissae at `x`: by linear interpolation, beyond the end along the last line, before
/// the beginning the first value.
fn at(curve: &[(f64, f64)], x: f64) -> f64 {
    let line = curve.partition_point(|(at, _)| *at < x).clamp(1, curve.len().saturating_sub(1).max(1));
    match (curve.get(line - 1), curve.get(line)) {
        (Some((x0, y0)), Some((x1, y1))) => y0 + (y1 - y0) * (x - x0).max(0.0) / (x1 - x0),
        (Some((_, y)), None) => *y,
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_are_interpolated() {
        let curve = [(0.0, 0.0), (1.0, 2.0), (3.0, 4.0)];
        for (x, y) in [(-1.0, 0.0), (0.0, 0.0), (0.5, 1.0), (1.0, 2.0), (2.0, 3.0), (5.0, 6.0)] {
            assert_eq!(at(&curve, x), y, "at {x}");
        }
        assert_eq!((at(&curve[..1], 2.0), at(&[], 2.0)), (0.0, 0.0));
    }

    #[test]
    fn indentation_counts_from_the_touch_and_ends_where_the_tool_turns() {
        let sample = |time: f64, y: f64, force: f64, depth: f64| Sample {
            time,
            centre: DVec3::new(0.0, y, 0.0),
            force: DVec3::new(0.0, force, 0.0),
            depth,
        };
        // A sphere of 10 mm on a plane at 0: it touches at y = 10 mm, between the first two samples.
        let samples = [
            sample(0.1, 0.011, 0.0, 0.0),
            sample(0.2, 0.0095, 0.0, 0.0),
            sample(0.3, 0.008, 1.0, 0.0005),
            sample(0.4, 0.006, 2.0, 0.002),
            sample(0.5, 0.007, 1.4, 0.003),
        ];
        let curve = over_indentation(&samples, DVec3::new(0.0, 0.02, 0.0)).unwrap();
        let expected = [(0.0, 0.0), (0.002, 1.0), (0.004, 2.0)];
        assert_eq!(curve.len(), expected.len());
        for ((x, y), (ex, ey)) in curve.iter().zip(expected) {
            assert!((x - ex).abs() < 1e-15 && y == &ey, "{curve:?}");
        }
        assert!(over_indentation(&samples[..2], DVec3::ZERO).unwrap_err().to_string().contains("touches nothing"));
    }
}
