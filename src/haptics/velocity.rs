//! Velocity of a haptic device from quantised encoder positions, by first-order adaptive windowing in its end-fit form
//! (F. Janabi-Sharifi, V. Hayward and C.-S. J. Chen 2000, "Discrete-time adaptive windowing for velocity estimation").
//! One position is read per *tick* (iteration of the haptic loop); a window is a run of successive positions up to the
//! newest one. The velocity is the slope of the straight line between the ends of the longest window in which every
//! position lies within one *quantum* (resolution of the encoder) of that line. The window is one tick for fast motion
//! and grows to all kept positions for slow motion.

use glam::DVec3;

/// Number of positions that are kept; the longest window spans `KEPT - 1` ticks.
const KEPT: usize = 32;

/// The newest positions, from which the velocity is estimated. Nothing is allocated after construction.
#[derive(Debug, Clone)]
pub struct AdaptiveWindow {
    /// Bound on the error of a position along each axis, m.
    quantum: f64,
    times: [f64; KEPT],
    positions: [DVec3; KEPT],
    newest: usize,
    count: usize,
}

impl AdaptiveWindow {
    /// An estimator without positions. `quantum` is the encoder's resolution, m; if it is 0, the window is one
    /// tick unless the motion is exactly uniform.
    pub fn new(quantum: f64) -> AdaptiveWindow {
        AdaptiveWindow { quantum, times: [0.0; KEPT], positions: [DVec3::ZERO; KEPT], newest: 0, count: 0 }
    }

    /// Adds a finite position (m) read at `time` (s). A position that is no later than the newest one carries no
    /// information and is left out.
    pub fn push(&mut self, time: f64, position: DVec3) {
        if self.count > 0 && time <= self.times[self.newest] {
            return;
        }
        self.newest = (self.newest + 1) % KEPT;
        self.times[self.newest] = time;
        self.positions[self.newest] = position;
        self.count = (self.count + 1).min(KEPT);
    }

    /// The estimated velocity, m/s; zero before there are two positions. Each axis has its own window.
    pub fn velocity(&self) -> DVec3 {
        DVec3::new(self.slope(0), self.slope(1), self.slope(2))
    }

    /// Velocity along one axis, m/s. The window grows into the past, one tick at a time. A line through the newest
    /// position passes within a quantum of every other position in the window if its slope lies in `low..=high`.
    fn slope(&self, axis: usize) -> f64 {
        let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
        let mut slope = 0.0;
        for back in 1..self.count {
            let index = (self.newest + KEPT - back) % KEPT;
            let span = self.times[self.newest] - self.times[index];
            let moved = self.positions[self.newest][axis] - self.positions[index][axis];
            let longer = moved / span;
            if longer < low || longer > high {
                break;
            }
            slope = longer;
            low = low.max((moved - self.quantum) / span);
            high = high.min((moved + self.quantum) / span);
        }
        slope
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const QUANTUM: f64 = 1.0 / 65536.0;
    const TICK: f64 = 1.0 / 1024.0;

    /// The estimate after each of the given positions (in quanta, one tick apart), m/s.
    fn estimates(quanta: &[f64]) -> Vec<f64> {
        let mut window = AdaptiveWindow::new(QUANTUM);
        let read = |(i, q): (usize, &f64)| {
            window.push(i as f64 * TICK, DVec3::new(q * QUANTUM, 0.0, -q * QUANTUM));
            let v = window.velocity();
            assert_eq!([v.y, v.z], [0.0, -v.x]);
            v.x
        };
        quanta.iter().enumerate().map(read).collect()
    }

    #[test]
    fn a_ramp_of_whole_quanta_is_exact() {
        for rate in [1.0, 3.0, -7.0, 1000.0] {
            let quanta: Vec<f64> = (0..100).map(|i| rate * i as f64).collect();
            let found = estimates(&quanta);
            assert_eq!(found[0], 0.0);
            assert!(
                found[1..].iter().all(|&v| v == rate * QUANTUM / TICK),
                "speed {rate} quanta a tick: estimates {found:?} m/s"
            );
        }
    }

    /// In a full window, rounding changes the distance between the two ends by at most one quantum, so that the error
    /// of a steady speed is at most a quantum divided by the window's duration.
    #[test]
    fn a_slow_ramp_is_within_a_quantum_over_the_window() {
        for rate in [0.013, 0.1, 0.37, 2.61] {
            let quanta: Vec<f64> = (0..200).map(|i| (rate * i as f64).round()).collect();
            let worst = (KEPT - 1) as f64 * TICK;
            for (i, v) in estimates(&quanta).into_iter().enumerate().skip(KEPT) {
                assert!(
                    (v - rate * QUANTUM / TICK).abs() <= QUANTUM / worst,
                    "speed {rate} quanta a tick, tick {i}: estimate {v} m/s"
                );
            }
        }
    }

    /// The estimate at rest may differ from zero by at most a quantum divided by the duration of the full window, 31
    /// ticks. A velocity from only two successive positions could differ by 31 times as much.
    #[test]
    fn rest_is_still_and_its_flicker_is_small() {
        assert!(estimates(&[5.0; 80]).iter().all(|&v| v == 0.0));
        let flicker: Vec<f64> = (0..200).map(|i| f64::from(i * i * 7 % 11 > 5)).collect();
        let bound = QUANTUM / ((KEPT - 1) as f64 * TICK);
        assert!(flicker.contains(&0.0) && flicker.contains(&1.0));
        for (i, v) in estimates(&flicker).into_iter().enumerate().skip(KEPT) {
            assert!(v.abs() <= bound, "device at rest, tick {i}: estimate {v} m/s exceeds the bound");
        }
    }

    #[test]
    fn a_stop_is_seen_in_a_tick() {
        let quanta: Vec<f64> = (0..60).map(|i: i32| 50.0 * f64::from(i.min(40))).collect();
        let found = estimates(&quanta);
        assert_eq!(found[40], 50.0 * QUANTUM / TICK);
        assert!(found[41..].iter().all(|&v| v == 0.0), "not zero after the stop: estimates {found:?} m/s");
    }

    /// A motion of two quanta a tick stops; the expected estimates are calculated by hand. One tick after the stop, the
    /// line over two ticks still passes within a quantum of the position between its ends, but the line over three
    /// ticks does not. Another tick later, no line that reaches back before the stop does.
    #[test]
    fn a_slow_stop_is_seen_as_soon_as_a_quantum_allows() {
        let quanta: Vec<f64> = (0..60).map(|i: i32| 2.0 * f64::from(i.min(40))).collect();
        let found: Vec<f64> = estimates(&quanta)[40..44].iter().map(|v| v * TICK / QUANTUM).collect();
        assert_eq!(found, [2.0, 1.0, 0.0, 0.0]);
    }

    #[test]
    fn a_position_that_is_no_later_is_left_out() {
        let mut window = AdaptiveWindow::new(0.0);
        window.push(0.0, DVec3::ZERO);
        window.push(2.0, DVec3::X);
        window.push(2.0, DVec3::Y);
        window.push(1.0, DVec3::Z);
        assert_eq!(window.velocity(), DVec3::X * 0.5);
    }
}
