//! Chooses the length h of the simulation's steps during a haptic session, in which the simulation runs beside the
//! haptic loop. cost(h) is the wall-clock time that computing a step of length h takes. The choice is the smallest h
//! with cost(h) <= h: simulated time then keeps up with real time, and the haptic loop gets a new contact wrench (force
//! and torque) as often as possible.
//!
//! A longer step costs more solver iterations, so cost(h) = h may hold at several h (for a stiff block, for example, at
//! h = 2 ms and again at h = 20 ms). A length that merely follows the cost of the last steps stays at the first such h
//! that it reaches. The iteration h <- cost(h), started from the shortest step, climbs to the smallest such h (Kleene's
//! fixed-point iteration of a monotone function), so a search from the shortest step is repeated at intervals.

/// Weight of the newest step in the running mean of the cost.
const NEWEST_SHARE: f64 = 0.1;
/// Time from one search to the next, s. It begins with the first value here, and doubles, up to the second value,
/// whenever a search finds no shorter length; a search that finds one sets it back to the first value.
const SEARCHED_EVERY: [f64; 2] = [1.0, 16.0];
/// Greatest number of steps in one search.
const MOST_TRIES: u32 = 8;
/// A length that a search finds replaces the old length only if it is shorter than the old length times this factor.
const BETTER: f64 = 0.8;
/// A step is fast enough if its cost is at most this many times its length.
const AS_LONG: f64 = 1.1;

/// The step length, and the search for a shorter one.
#[derive(Debug, Clone)]
pub struct Pace {
    shortest: f64,
    longest: f64,
    /// Running mean of the cost of the last steps, s.
    mean: f64,
    search: Option<Search>,
    /// Time at which the next search begins, s.
    next: f64,
    /// Time from one search to the next, s.
    interval: f64,
}

/// A search that climbs from the shortest step.
#[derive(Debug, Clone, Copy)]
struct Search {
    /// Length of the next step, s.
    length: f64,
    /// Number of steps done in this search.
    tries: u32,
}

impl Pace {
    /// Makes a pace whose steps will be from `shortest` to `longest` s long. `cost` (s) is the measured cost of a step
    /// whose length is `shortest`.
    pub fn new(shortest: f64, longest: f64, cost: f64) -> Pace {
        let interval = SEARCHED_EVERY[0];
        Pace { shortest, longest: longest.max(shortest), mean: cost, search: None, next: interval, interval }
    }

    /// The next step's length, s.
    pub fn length(&self) -> f64 {
        self.search.map_or(self.mean, |search| search.length).clamp(self.shortest, self.longest)
    }

    /// Takes the cost (s) of a step whose length was [`Pace::length`]; `now` is the present time, s.
    pub fn took(&mut self, cost: f64, now: f64) {
        let length = self.length();
        let Some(search) = &mut self.search else {
            self.mean += NEWEST_SHARE * (cost - self.mean);
            if now >= self.next && self.length() > self.shortest {
                self.search = Some(Search { length: self.shortest, tries: 0 });
            }
            return;
        };
        search.tries += 1;
        let old = self.mean.clamp(self.shortest, self.longest);
        let is_found = cost <= AS_LONG * length && length < BETTER * old;
        if is_found || search.tries >= MOST_TRIES || cost >= BETTER * old {
            self.search = None;
            self.interval = if is_found { SEARCHED_EVERY[0] } else { (2.0 * self.interval).min(SEARCHED_EVERY[1]) };
            self.next = now + self.interval;
            if is_found {
                self.mean = cost.max(length);
            }
        } else {
            search.length = cost.max(length);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs steps for `seconds` s of elapsed time, where `cost` gives the cost (s) of a step by its length (s) and
    /// number. Returns the final step length (s), and the ratio of simulated time to elapsed time.
    fn run(pace: &mut Pace, seconds: f64, cost: impl Fn(f64, u32) -> f64) -> (f64, f64) {
        let (mut now, mut simulated, mut step) = (0.0, 0.0, 0);
        while now < seconds {
            let length = pace.length();
            let took = cost(length, step);
            (now, simulated, step) = (now + took.max(length), simulated + length, step + 1);
            pace.took(took, now);
        }
        (pace.length(), simulated / now)
    }

    /// Cost of a stiff block's step of length `h`, s: little more than 1.5 ms for short steps; a step of 20 ms costs 20
    /// ms.
    fn stiff(h: f64) -> f64 {
        if h < 4e-3 { 1.5e-3 + 0.2 * h } else { 0.018 + 0.1 * h }
    }

    #[test]
    fn of_two_lengths_that_last_as_long_as_they_cost_the_shorter_is_found() {
        let mut pace = Pace::new(1e-3, 0.02, 0.02);
        let (length, share) = run(&mut pace, 20.0, |h, _| stiff(h));
        assert!(
            (length - 1.875e-3).abs() < 2e-4 && share > 0.95,
            "step length {length} s, expected 1.875e-3 s; ratio of simulated to elapsed time {share}, expected > 0.95"
        );
        // The running mean alone would stay at the longer of the two lengths.
        let mut mean = 0.02f64;
        (0..1000).for_each(|_| mean += 0.1 * (stiff(mean.min(0.02)) - mean));
        assert!(mean > 0.019, "running mean of the cost {mean} s, expected above 0.019 s");
    }

    #[test]
    fn a_disturbance_is_left_again() {
        let mut pace = Pace::new(1e-3, 0.02, 2e-3);
        let (length, _) = run(&mut pace, 20.0, |h, step| if step % 700 < 30 { 0.03 } else { stiff(h) });
        assert!(length < 4e-3, "step length {length} s, expected below 4e-3 s");
    }

    #[test]
    fn where_there_is_one_length_it_is_kept_and_searching_costs_little() {
        for cost in [0.014, 0.1] {
            let mut pace = Pace::new(1e-3, 0.02, cost);
            let (length, share) = run(&mut pace, 100.0, |_, _| cost);
            let expected: f64 = if cost < 0.02 { 1.0 } else { 0.02 / cost };
            assert!(
                (length - cost.min(0.02)).abs() < 1e-9 && share > 0.99 * expected,
                "cost {cost} s: step length {length} s, ratio of simulated to elapsed time {share}"
            );
        }
        let mut pace = Pace::new(1e-3, 0.02, 1e-4);
        assert_eq!(run(&mut pace, 10.0, |_, _| 1e-4), (1e-3, 1.0));
    }
}
