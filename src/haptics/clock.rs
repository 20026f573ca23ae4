//! The timer of the haptic loop (which reads the haptic device and commands a force to it, usually 1000 times a
//! second): it wakes the loop's thread at absolute deadlines. This file also has statistics of how late each tick (one
//! iteration of the loop) came after its deadline.

use std::time::{Duration, Instant};

/// A tick that begins more than this time after its deadline has missed that deadline, s.
pub const MISSED: f64 = 2e-3;

/// Wakes the thread that waits for it at whole multiples of a period, counted from its beginning.
#[derive(Debug)]
pub struct Metronome {
    begun: Instant,
    period: Duration,
    next: u64,
}

/// One wake-up of the metronome.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Beat {
    /// Time of the wake-up since the metronome began, s.
    pub time: f64,
    /// Delay of the wake-up after its deadline, s.
    pub late: f64,
}

impl Metronome {
    /// Creates a metronome that wakes its thread every `period` s from now on.
    pub fn new(period: f64) -> Metronome {
        Metronome::since(Instant::now(), period)
    }

    /// Creates a metronome that wakes its thread every `period` s since `begun`.
    pub fn since(begun: Instant, period: f64) -> Metronome {
        Metronome { begun, period: Duration::from_secs_f64(period), next: 0 }
    }

    /// Sleeps until the next deadline. Deadlines that have already passed are skipped, not made up for.
    pub fn wait(&mut self) -> Beat {
        let due = Duration::from_nanos(self.period.as_nanos() as u64 * self.next);
        std::thread::sleep((self.begun + due).saturating_duration_since(Instant::now()));
        let now = self.begun.elapsed();
        let passed = (now.as_nanos() / self.period.as_nanos().max(1)) as u64;
        self.next = passed.max(self.next) + 1;
        Beat { time: now.as_secs_f64(), late: now.saturating_sub(due).as_secs_f64() }
    }
}

/// A histogram of how late ticks came after their deadlines.
#[derive(Debug, Clone, Default)]
pub struct Lateness {
    /// Number of ticks in each bin of lateness: [`FINE`] bins of one microsecond each, then [`COARSE`] bins whose width
    /// grows with the lateness.
    histogram: Vec<u64>,
    ticks: u64,
    missed: u64,
    worst: f64,
}

/// Number of bins of one microsecond each, which resolve lateness up to 0.1 s.
const FINE: usize = 100_000;
/// Ratio of the upper to the lower end of each of the [`COARSE`] bins. A lateness differs from the middle of its bin by
/// half a percent at most.
const WIDENING: f64 = 1.01;
/// Number of bins of growing width after the first [`FINE`] bins; these bins cover lateness up to more than 1000 s.
/// Ticks that are still later are counted in the last bin.
const COARSE: usize = 930;
/// Index of the last bin.
const LAST: usize = FINE + COARSE - 1;

/// The bin of a lateness given in s.
fn bin(late: f64) -> usize {
    // The cast to an integer puts NaN and negative numbers into bin 0; the minimum below puts infinity into the last
    // bin.
    let us = (late * 1e6).round();
    if us.is_nan() || us < FINE as f64 {
        return us as usize;
    }
    let beyond = (us / FINE as f64).ln() / WIDENING.ln();
    FINE + (beyond as usize).min(LAST - FINE)
}

/// The lateness that a bin stands for, s.
fn lateness_of(bin: usize) -> f64 {
    match bin.checked_sub(FINE) {
        None => bin as f64 / 1e6,
        Some(beyond) => FINE as f64 / 1e6 * WIDENING.powf(beyond as f64 + 0.5),
    }
}

impl Lateness {
    /// An empty histogram.
    pub fn new() -> Lateness {
        Lateness { histogram: vec![0; FINE + COARSE], ..Lateness::default() }
    }

    /// Adds a tick that came `late` s after its deadline; deadlines are `period` s apart. If `late` exceeds [`MISSED`],
    /// the tick's own deadline counts as missed, and so does each later deadline that lay more than [`MISSED`] in the
    /// past when the tick came.
    pub fn add(&mut self, late: f64, period: f64) {
        self.ticks += 1;
        self.worst = self.worst.max(late);
        self.histogram[bin(late)] += 1;
        if late > MISSED {
            self.missed += ((late - MISSED) / period).ceil().max(1.0) as u64;
        }
    }

    /// The lateness that a `share` (0 to 1) of the ticks does not exceed, s: exact to a microsecond up to 0.1 s and to
    /// half a percent up to 1000 s; 0 if there was no tick. Except for rounding to a microsecond, it is never above
    /// [`Lateness::worst`].
    pub fn quantile(&self, share: f64) -> f64 {
        let wanted = (share * self.ticks as f64).ceil().max(1.0) as u64;
        let mut seen = 0;
        let at = self.histogram.iter().position(|count| {
            seen += count;
            seen >= wanted
        });
        at.map_or(0.0, |at| match at {
            // The value of a bin of one microsecond is returned unchanged, although rounding may put it half a
            // microsecond above the greatest lateness.
            ..FINE => lateness_of(at),
            LAST => self.worst,
            _ => lateness_of(at).min(self.worst),
        })
    }

    /// Number of ticks that were added.
    pub fn ticks(&self) -> u64 {
        self.ticks
    }

    /// Number of deadlines that were missed, as [`Lateness::add`] counts them.
    pub fn missed(&self) -> u64 {
        self.missed
    }

    /// Number of missed deadlines divided by the number of ticks and missed deadlines together, 0 to 1.
    pub fn share_missed(&self) -> f64 {
        self.missed as f64 / (self.ticks + self.missed).max(1) as f64
    }

    /// The greatest lateness of any tick, s.
    pub fn worst(&self) -> f64 {
        self.worst
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lateness_counts_every_deadline_that_a_late_tick_let_pass() {
        let mut lateness = Lateness::new();
        (0..997).for_each(|_| lateness.add(50e-6, 1e-3));
        lateness.add(1.9e-3, 1e-3);
        assert_eq!(lateness.missed(), 0);
        lateness.add(2.5e-3, 1e-3);
        lateness.add(6.5e-3, 1e-3);
        assert_eq!((lateness.ticks(), lateness.missed()), (1000, 1 + 5));
        assert_eq!((lateness.quantile(0.5), lateness.quantile(0.999)), (50e-6, 2.5e-3));
        assert_eq!(lateness.worst(), 6.5e-3);
    }

    #[test]
    fn quantiles_are_right_far_beyond_a_tenth_of_a_second() {
        for late in [0.0999, 0.1, 0.15, 0.3, 2.0, 10.0, 59.9, 490.0] {
            let mut lateness = Lateness::new();
            (0..60).for_each(|_| lateness.add(late, f64::INFINITY));
            (0..39).for_each(|_| lateness.add(2.0 * late, f64::INFINITY));
            lateness.add(30.0 * late, f64::INFINITY);
            for (share, exact) in [(0.5, late), (0.6, late), (0.99, 2.0 * late), (1.0, 30.0 * late)] {
                let told = lateness.quantile(share);
                assert!(
                    (told - exact).abs() <= 0.01 * exact,
                    "quantile {share} of ticks that are {late} s late or more: {told} s, expected {exact} s"
                );
            }
            assert_eq!(lateness.worst(), 30.0 * late);
        }
    }

    #[test]
    fn no_quantile_is_above_the_latest_and_what_cannot_be_is_counted_all_the_same() {
        let mut lateness = Lateness::new();
        assert_eq!((lateness.quantile(0.5), lateness.quantile(1.0)), (0.0, 0.0));
        for late in (0..2000).map(|k| 1e-4 * 1.01_f64.powi(k)).take_while(|late| *late < 2000.0) {
            lateness.add(late, f64::INFINITY);
            let last = lateness.quantile(1.0);
            assert!(
                last <= lateness.worst() + 5e-7 && last >= 0.99 * late,
                "the greatest lateness of a tick is {late} s, but the greatest quantile is {last} s"
            );
        }
        let before = lateness.ticks();
        [f64::NAN, f64::INFINITY, 1e300, -1.0].iter().for_each(|late| lateness.add(*late, f64::INFINITY));
        assert_eq!((lateness.ticks(), lateness.quantile(1.0)), (before + 4, f64::INFINITY));
        // The lateness that a bin stands for lies within that bin.
        for k in 0..FINE + COARSE {
            assert_eq!(bin(lateness_of(k)), k);
        }
    }

    #[test]
    fn beats_keep_to_their_deadlines_and_none_is_made_up_for() {
        let mut metronome = Metronome::new(1e-3);
        let first = metronome.wait();
        std::thread::sleep(Duration::from_millis(20));
        let after = metronome.wait();
        assert!(
            after.time >= 0.02 && after.late > 0.015,
            "the metronome's first wake-up: {first:?}; its wake-up after 20 ms of sleep: {after:?}"
        );
        let next = metronome.wait();
        // The deadline of `next` is a whole multiple of the period, and the first such time after the wake-up `after`.
        let due = next.time - next.late;
        assert!((due * 1e3 - (due * 1e3).round()).abs() < 1e-6 && due > after.time && due - after.time <= 1.001e-3);
    }
}
