//! Measures the resolution of a haptic device's positions: the step of its encoders, as it appears in the position.

use std::thread;
use std::time::{Duration, Instant};

use glam::DVec3;
use palpate::Wrench;
use palpate::internal::haptics::Device;

/// Time between two readings, s.
const PERIOD: f64 = 1e-3;
/// Fewest changes of the position from which a resolution is taken.
const FEWEST: usize = 20;
/// A device that moves farther than this while it is measured is not at rest, m.
const FARTHEST: f64 = 2e-3;

/// A measured resolution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Resolution {
    /// Median length of the changes of the position from one reading to the next, m. At rest nearly every change is one
    /// step of one encoder.
    pub step: f64,
    /// Number of readings that differed from the one before.
    pub changes: usize,
    /// Number of readings.
    pub readings: usize,
    /// Diagonal of the box around all positions, m.
    pub range: f64,
}

impl Resolution {
    /// The resolution that successive positions (m) of a device at rest show.
    ///
    /// # Errors
    /// One line with a remedy, if the device was not at rest, or if its position hardly ever changed.
    pub fn of(positions: &[DVec3]) -> Result<Resolution, String> {
        let mut lengths: Vec<f64> = positions.windows(2).map(|pair| pair[0].distance(pair[1])).collect();
        lengths.retain(|length| *length > 0.0);
        lengths.sort_unstable_by(f64::total_cmp);
        let low = positions.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let high = positions.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
        let (changes, readings, range) = (lengths.len(), positions.len(), low.distance(high));
        if changes < FEWEST {
            return Err(format!(
                "the position changed {changes} times in {readings} readings; touch the device lightly, so that it \
                 trembles, and measure again"
            ));
        }
        if range.is_nan() || range > FARTHEST {
            return Err(format!(
                "the device moved by {:.1} mm; let it rest, within {:.0} mm, and measure again",
                1e3 * range,
                1e3 * FARTHEST
            ));
        }
        Ok(Resolution { step: lengths[changes / 2], changes, readings, range })
    }

    /// Reads an open device a thousand times a second for some seconds of real time, while it exerts no force.
    ///
    /// # Errors
    /// Those of [`Resolution::of`]; the device cannot be read or written.
    pub fn measure(device: &mut dyn Device, seconds: f64) -> Result<Resolution, String> {
        let begun = Instant::now();
        let mut positions = Vec::new();
        for tick in 0..(seconds / PERIOD) as u64 {
            let time = tick as f64 * PERIOD;
            thread::sleep(Duration::from_secs_f64(time).saturating_sub(begun.elapsed()));
            device.write(&Wrench::ZERO).map_err(|fault| fault.to_string())?;
            positions.push(device.read(time).map_err(|fault| fault.to_string())?.state.position);
        }
        Resolution::of(&positions)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Positions of a device that trembles by `tremor` (m) and drifts, read by encoders of `step` (m) along skew axes.
    fn positions(step: f64, tremor: f64, drift: f64) -> Vec<DVec3> {
        let axes = [DVec3::new(0.8, 0.6, 0.0), DVec3::new(-0.6, 0.8, 0.0), DVec3::Z];
        let at = |k: u32| {
            let t = f64::from(k) * PERIOD;
            tremor * DVec3::new((50.0 * t).sin(), (37.0 * t).sin(), (61.0 * t).cos()) + drift * t * DVec3::ONE
        };
        (0..3000).map(|k| axes.iter().map(|axis| (axis.dot(at(k)) / step).round() * step * *axis).sum()).collect()
    }

    #[test]
    fn the_step_of_encoders_is_found_and_a_device_that_moves_or_stands_still_is_refused() {
        for step in [1.5e-6, 2e-5, 6.3e-5] {
            let found = Resolution::of(&positions(step, 1.2 * step, 0.0)).unwrap();
            assert!((found.step / step - 1.0).abs() < 1e-6 && found.changes >= FEWEST, "step {step} m: {found:?}");
        }
        let still = Resolution::of(&positions(2e-5, 1e-6, 0.0)).unwrap_err();
        assert!(still.contains("changed 0 times in 3000 readings"), "{still}");
        let moved = Resolution::of(&positions(2e-5, 2e-5, 1e-3)).unwrap_err();
        assert!(moved.contains("moved by 5.2 mm"), "{moved}");
        assert!(Resolution::of(&[]).is_err());
        assert!(Resolution::of(&[DVec3::NAN; 100]).is_err());
    }
}
