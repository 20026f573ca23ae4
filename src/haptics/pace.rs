//! How long the simulation's steps are while a device is held: the smallest h with cost(h) <= h, so that bodies move as in the
//! world and the loop hears of contact as often as it can.
//!
//! A longer step costs more iterations, so cost(h) = h may hold at several h, and a length that follows the cost of the last
//! steps stays at whichever it fell into (a stiff block: at 2 ms, and again at 20). From below, h = cost(h) taken again and
//! again climbs to the smallest of them (Kleene's iteration of a rising function): now and then the length begins there anew.

/// Share of the newest in the mean cost of a step.
const NEWEST_SHARE: f64 = 0.1;
/// From one search to the next, s, at first; twice that each time nothing better was found, up to the last.
const SEARCHED_EVERY: [f64; 2] = [1.0, 16.0];
/// Steps of a search at most.
const MOST_TRIES: u32 = 8;
/// A step that is not shorter than this share of the old one is nothing better.
const BETTER: f64 = 0.8;
/// A cost that exceeds the step's length by no more than this share is as long as the step.
const AS_LONG: f64 = 1.1;

/// The length of steps.
#[derive(Debug, Clone)]
pub struct Pace {
    shortest: f64,
    longest: f64,
    /// Of the last steps, s.
    mean: f64,
    search: Option<Search>,
    /// When the next search begins, s.
    next: f64,
    interval: f64,
}

/// A search from below.
#[derive(Debug, Clone, Copy)]
struct Search {
    length: f64,
    tries: u32,
}

impl Pace {
    /// Steps of `shortest` to `longest` s; `cost`: of one of the shortest, s.
    pub fn new(shortest: f64, longest: f64, cost: f64) -> Pace {
        let interval = SEARCHED_EVERY[0];
        Pace { shortest, longest: longest.max(shortest), mean: cost, search: None, next: interval, interval }
    }

    /// The next step's length, s.
    pub fn length(&self) -> f64 {
        self.search.map_or(self.mean, |search| search.length).clamp(self.shortest, self.longest)
    }

    /// A step of that length took so long (s); it is `now` (s).
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

    /// Steps for so many seconds; the length at the end and the simulated share of time.
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

    /// Of a stiff block: 1.5 ms and then as much as keeps 20 ms busy.
    fn stiff(h: f64) -> f64 {
        if h < 4e-3 { 1.5e-3 + 0.2 * h } else { 0.018 + 0.1 * h }
    }

    #[test]
    fn of_two_lengths_that_last_as_long_as_they_cost_the_shorter_is_found() {
        let mut pace = Pace::new(1e-3, 0.02, 0.02);
        let (length, share) = run(&mut pace, 20.0, |h, _| stiff(h));
        assert!((length - 1.875e-3).abs() < 2e-4 && share > 0.95, "{length} s, {share}");
        // As the mean alone has it.
        let mut mean = 0.02f64;
        (0..1000).for_each(|_| mean += 0.1 * (stiff(mean.min(0.02)) - mean));
        assert!(mean > 0.019, "{mean}");
    }

    #[test]
    fn a_disturbance_is_left_again() {
        let mut pace = Pace::new(1e-3, 0.02, 2e-3);
        let (length, _) = run(&mut pace, 20.0, |h, step| if step % 700 < 30 { 0.03 } else { stiff(h) });
        assert!(length < 4e-3, "{length}");
    }

    #[test]
    fn where_there_is_one_length_it_is_kept_and_searching_costs_little() {
        for cost in [0.014, 0.1] {
            let mut pace = Pace::new(1e-3, 0.02, cost);
            let (length, share) = run(&mut pace, 100.0, |_, _| cost);
            let expected: f64 = if cost < 0.02 { 1.0 } else { 0.02 / cost };
            assert!((length - cost.min(0.02)).abs() < 1e-9 && share > 0.99 * expected, "{cost}: {length} s, {share}");
        }
        let mut pace = Pace::new(1e-3, 0.02, 1e-4);
        assert_eq!(run(&mut pace, 10.0, |_, _| 1e-4), (1e-3, 1.0));
    }
}
