//! Ticks at absolute deadlines, and how late they came.

use std::time::{Duration, Instant};

/// A deadline is missed where its tick comes later than this, s.
pub const MISSED: f64 = 2e-3;

/// Wakes its thread at whole multiples of a period since it was made.
#[derive(Debug)]
pub struct Metronome {
    begun: Instant,
    period: Duration,
    next: u64,
}

/// A tick that is due.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Beat {
    /// Since the metronome was made, s.
    pub time: f64,
    /// After the deadline, s.
    pub late: f64,
}

impl Metronome {
    /// A beat every `period` s from now on.
    pub fn new(period: f64) -> Metronome {
        Metronome { begun: Instant::now(), period: Duration::from_secs_f64(period), next: 0 }
    }

    /// Sleeps until the next deadline. Deadlines that passed meanwhile are not made up for.
    pub fn wait(&mut self) -> Beat {
        let due = Duration::from_nanos(self.period.as_nanos() as u64 * self.next);
        std::thread::sleep((self.begun + due).saturating_duration_since(Instant::now()));
        let now = self.begun.elapsed();
        let passed = (now.as_nanos() / self.period.as_nanos().max(1)) as u64;
        self.next = passed.max(self.next) + 1;
        Beat { time: now.as_secs_f64(), late: now.saturating_sub(due).as_secs_f64() }
    }

    /// When it was made.
    pub fn begun(&self) -> Instant {
        self.begun
    }
}

/// How late ticks were.
#[derive(Debug, Clone, Default)]
pub struct Lateness {
    /// Of each tick, microseconds, whole.
    histogram: Vec<u64>,
    ticks: u64,
    missed: u64,
    worst: f64,
}

/// Lateness is told apart up to here, microseconds; what is later is counted there.
const LONGEST: usize = 100_000;

impl Lateness {
    /// Nothing yet.
    pub fn new() -> Lateness {
        Lateness { histogram: vec![0; LONGEST + 1], ..Lateness::default() }
    }

    /// Adds a tick that came `late` s after its deadline, `period` s from the next. Deadlines that passed while it was
    /// waited for are missed as well where they were waited for too long.
    pub fn add(&mut self, late: f64, period: f64) {
        self.ticks += 1;
        self.worst = self.worst.max(late);
        self.histogram[((late * 1e6).round() as usize).min(LONGEST)] += 1;
        if late > MISSED {
            self.missed += ((late - MISSED) / period).ceil().max(1.0) as u64;
        }
    }

    /// The lateness that a share of the ticks stays within, s.
    pub fn quantile(&self, share: f64) -> f64 {
        let wanted = (share * self.ticks as f64).ceil().max(1.0) as u64;
        let mut seen = 0;
        let at = self.histogram.iter().position(|count| {
            seen += count;
            seen >= wanted
        });
        at.map_or(0.0, |us| if us == LONGEST { self.worst } else { us as f64 / 1e6 })
    }

    /// Ticks.
    pub fn ticks(&self) -> u64 {
        self.ticks
    }

    /// Deadlines missed by more than [`MISSED`].
    pub fn missed(&self) -> u64 {
        self.missed
    }

    /// The same, of all deadlines.
    pub fn share_missed(&self) -> f64 {
        self.missed as f64 / (self.ticks + self.missed).max(1) as f64
    }

    /// Of the latest tick, s.
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
    fn beats_keep_to_their_deadlines_and_none_is_made_up_for() {
        let mut metronome = Metronome::new(1e-3);
        let first = metronome.wait();
        std::thread::sleep(Duration::from_millis(20));
        let after = metronome.wait();
        assert!(after.time >= 0.02 && after.late > 0.015, "{first:?} {after:?}");
        let next = metronome.wait();
        // The deadline is a whole multiple of the period, the first one after the last beat.
        let due = next.time - next.late;
        assert!((due * 1e3 - (due * 1e3).round()).abs() < 1e-6 && due > after.time && due - after.time <= 1.001e-3);
    }
}
