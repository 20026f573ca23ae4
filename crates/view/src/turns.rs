//! Turns at the GPU's queue, which the simulation's steps share with *slices*, the parts in which an image is drawn.
//! While a step and a slice wait for the queue, turns alternate: a step is delayed by at most one slice, and drawing
//! makes progress even if the simulation never pauses. The haptic loop runs on the CPU and takes no turns.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard};
use std::time::{Duration, Instant};

use palpate::internal::haptics::clock::Lateness;

/// Number of steps whose delays are kept.
const RECENT: usize = 128;
/// Time within which a due step must ask for its turn; after this time slices no longer wait for that step.
const SOON: Duration = Duration::from_millis(20);
/// Greatest duration of a slice, as a multiple of the duration of a step.
const SLICE: f64 = 1.5;
/// Number of steps whose durations are kept; it is small, because durations change at once when contact begins.
const NEWEST: usize = 7;

/// The turns at the GPU's queue.
#[derive(Debug, Default)]
pub struct Turns {
    state: Mutex<State>,
    freed: Condvar,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
enum Who {
    Step,
    #[default]
    Slice,
}

#[derive(Debug)]
struct State {
    is_taken: bool,
    /// Number of steps that wait for a turn, and number of slices that wait for one.
    waiting: [u32; 2],
    /// Whether the last turn was a step's or a slice's.
    last: Who,
    /// Time by which slices that were drawn before a due step have delayed that step; `None` without such a slice.
    owed: Option<Duration>,
    /// When the last slice before a due step ended.
    owed_since: Option<Instant>,
    delays: VecDeque<Duration>,
    /// Durations of recent steps, without the time that they waited for their turns.
    lengths: VecDeque<Duration>,
    steps: u64,
    slices: u64,
    longest_slice: Duration,
    all: Lateness,
}

impl Default for State {
    fn default() -> State {
        State {
            is_taken: false,
            waiting: [0; 2],
            last: Who::default(),
            owed: None,
            owed_since: None,
            delays: VecDeque::new(),
            lengths: VecDeque::new(),
            steps: 0,
            slices: 0,
            longest_slice: Duration::ZERO,
            all: Lateness::new(),
        }
    }
}

/// Statistics of recent turns.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Delays {
    /// How long the last step waited for drawing, s.
    pub last: f64,
    /// Median delay of recent steps, s.
    pub median: f64,
    /// Longest delay of recent steps, s.
    pub most: f64,
    /// Number of steps so far.
    pub steps: u64,
    /// Number of slices so far.
    pub slices: u64,
    /// Duration of the longest slice since the last call of [`Turns::delays`], s.
    pub longest_slice: f64,
}

/// A turn, which lasts until it is dropped.
#[derive(Debug)]
pub struct Turn<'a> {
    turns: &'a Turns,
    who: Who,
    /// Whether the simulation's thread took the turn, for a slice that it draws before its own step.
    is_before_step: bool,
    begun: Instant,
}

impl Turns {
    /// Turns at a queue that nobody uses yet.
    pub fn new() -> Turns {
        Turns::default()
    }

    /// Waits until a step may use the queue, and takes the turn for it.
    pub fn step(&self) -> Turn<'_> {
        let asked = Instant::now();
        let turn = self.take(Who::Step);
        let mut state = self.state();
        let owed = state.owed.take().unwrap_or_default();
        let delay = turn.begun - asked + owed;
        keep(&mut state.delays, delay, RECENT);
        state.all.add(delay.as_secs_f64(), f64::INFINITY);
        state.steps += 1;
        turn
    }

    /// Waits until a slice may use the queue, and takes the turn for it.
    pub fn slice(&self) -> Turn<'_> {
        self.take(Who::Slice)
    }

    /// Takes the turn for a slice that the simulation's thread draws itself before its next step. The slice delays that
    /// step; no other slice begins until the step has had its turn, 20 ms have passed, or [`Turns::rest`] is called.
    pub fn slice_before_step(&self) -> Turn<'_> {
        self.take_as(Who::Slice, true)
    }

    /// Declares that no step is due, so that slices need not wait for a step.
    pub fn rest(&self) {
        self.state().owed = None;
        self.freed.notify_all();
    }

    /// Greatest duration of a slice, s: one and a half times the median duration of the last steps. Drawing then leaves
    /// the simulation at least two fifths of its speed, and an image that takes no longer than this is drawn in one
    /// slice.
    pub fn slice_length(&self) -> f64 {
        let lengths = self.state().lengths.clone();
        SLICE * median(lengths).as_secs_f64()
    }

    /// Delays of all steps since [`Turns::forget`].
    pub fn all_delays(&self) -> Lateness {
        self.state().all.clone()
    }

    /// Resets the statistics; called after the first image, whose turn is long because pipelines are compiled in it.
    pub fn forget(&self) {
        let mut state = self.state();
        state.delays.clear();
        (state.all, state.longest_slice) = (Lateness::new(), Duration::ZERO);
    }

    /// Statistics of recent turns.
    pub fn delays(&self) -> Delays {
        let (recent, last, slices, steps, longest) = {
            let mut state = self.state();
            let longest = std::mem::take(&mut state.longest_slice);
            (state.delays.clone(), state.delays.back().copied(), state.slices, state.steps, longest)
        };
        Delays {
            last: last.unwrap_or_default().as_secs_f64(),
            most: recent.iter().max().copied().unwrap_or_default().as_secs_f64(),
            median: median(recent).as_secs_f64(),
            steps,
            slices,
            longest_slice: longest.as_secs_f64(),
        }
    }

    fn take(&self, who: Who) -> Turn<'_> {
        self.take_as(who, false)
    }

    fn take_as(&self, who: Who, is_before_step: bool) -> Turn<'_> {
        let mut state = self.state();
        state.waiting[who as usize] += 1;
        let must_wait = |state: &State| {
            let is_others = state.last == who && state.waiting[1 - who as usize] > 0;
            let is_due = state.owed.is_some() && state.owed_since.is_some_and(|since| since.elapsed() < SOON);
            state.is_taken || is_others || (who == Who::Slice && !is_before_step && is_due)
        };
        while must_wait(&state) {
            let waited = self.freed.wait_timeout(state, SOON);
            state = waited.unwrap_or_else(|poisoned| poisoned.into_inner()).0;
        }
        state.waiting[who as usize] -= 1;
        state.is_taken = true;
        Turn { turns: self, who, is_before_step, begun: Instant::now() }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }
}

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        let mut state = self.turns.state();
        (state.is_taken, state.last) = (false, self.who);
        if self.who == Who::Step {
            keep(&mut state.lengths, self.begun.elapsed(), NEWEST);
        } else {
            state.slices += 1;
            state.longest_slice = state.longest_slice.max(self.begun.elapsed());
            if self.is_before_step {
                state.owed = Some(state.owed.unwrap_or_default() + self.begun.elapsed());
                state.owed_since = Some(Instant::now());
            }
        }
        drop(state);
        // All waiting threads are woken, and each checks for itself whether it is its turn.
        self.turns.freed.notify_all();
    }
}

/// Appends the newest value and keeps at most the `most` newest values.
fn keep(recent: &mut VecDeque<Duration>, newest: Duration, most: usize) {
    if recent.len() == most {
        recent.pop_front();
    }
    recent.push_back(newest);
}

fn median(recent: VecDeque<Duration>) -> Duration {
    let mut sorted = Vec::from(recent);
    sorted.sort_unstable();
    sorted.get(sorted.len() / 2).copied().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
    use std::thread;

    use super::*;

    fn until(what: impl Fn() -> bool) {
        let begun = Instant::now();
        while !what() {
            assert!(begun.elapsed() < Duration::from_secs(20), "the awaited condition did not hold within 20 s");
            thread::sleep(Duration::from_micros(200));
        }
    }

    fn waiting(turns: &Turns, who: Who) -> u32 {
        turns.state().waiting[who as usize]
    }

    #[test]
    fn a_step_that_comes_within_a_slice_goes_before_the_next_slice() {
        for round in 0..20 {
            let turns = Turns::new();
            let order = Mutex::new(Vec::new());
            thread::scope(|scope| {
                let slice = turns.slice();
                // A second slice asks for the turn before the step does, and must still come after the step.
                scope.spawn(|| {
                    let _turn = turns.slice();
                    order.lock().unwrap().push("slice");
                });
                until(|| waiting(&turns, Who::Slice) == 1);
                scope.spawn(|| {
                    let _turn = turns.step();
                    order.lock().unwrap().push("step");
                });
                until(|| waiting(&turns, Who::Step) == 1);
                drop(slice);
            });
            assert_eq!(*order.lock().unwrap(), ["step", "slice"], "wrong order of turns in round {round}");
        }
    }

    #[test]
    fn drawing_gets_on_while_steps_run_back_to_back_and_no_step_waits_for_two_slices() {
        let turns = Arc::new(Turns::new());
        let (stop, slices) = (AtomicBool::new(false), AtomicU64::new(0));
        let mut worst = 0;
        thread::scope(|scope| {
            scope.spawn(|| {
                while !stop.load(Ordering::Relaxed) {
                    let _turn = turns.slice();
                    slices.fetch_add(1, Ordering::SeqCst);
                    thread::sleep(Duration::from_micros(50));
                }
            });
            until(|| slices.load(Ordering::SeqCst) > 0);
            for _ in 0..1000 {
                let before = slices.load(Ordering::SeqCst);
                let turn = turns.step();
                worst = worst.max(slices.load(Ordering::SeqCst) - before);
                thread::sleep(Duration::from_micros(50));
                drop(turn);
            }
            stop.store(true, Ordering::Relaxed);
        });
        // Between reading the count and asking for the turn, one slice may end and another begin; then two are counted
        // although the step waits for one. The test before this one counts exactly.
        assert!(worst <= 2, "a step waited for {worst} slices");
        assert!(slices.load(Ordering::SeqCst) > 250, "only {slices:?} slices during 1000 steps");
        let delays = turns.delays();
        assert_eq!(delays.steps, 1000);
        assert!(delays.most >= delays.median && delays.longest_slice >= 50e-6);
    }

    #[test]
    fn a_slice_in_a_steps_place_delays_that_step_and_holds_back_others() {
        let turns = Turns::new();
        let order = Mutex::new(Vec::new());
        thread::scope(|scope| {
            let slice = turns.slice_before_step();
            scope.spawn(|| {
                let _turn = turns.slice();
                order.lock().unwrap().push("slice");
            });
            until(|| waiting(&turns, Who::Slice) == 1);
            thread::sleep(Duration::from_millis(5));
            drop(slice);
            thread::sleep(Duration::from_millis(5));
            let step = turns.step();
            order.lock().unwrap().push("step");
            drop(step);
        });
        assert_eq!(*order.lock().unwrap(), ["step", "slice"]);
        assert!(turns.delays().last >= 5e-3, "the step's delay must be 5 ms at least: {:?}", turns.delays());
        // A second slice before the step must not make the simulation's thread wait for its own step, which never
        // comes.
        (0..2).for_each(|_| drop(turns.slice_before_step()));
        turns.rest();
        drop(turns.slice());
    }

    #[test]
    fn without_the_other_nobody_waits() {
        let turns = Turns::new();
        assert_eq!(turns.delays(), Delays::default());
        (0..10).for_each(|_| drop(turns.step()));
        (0..10).for_each(|_| drop(turns.slice()));
        let delays = turns.delays();
        assert_eq!((delays.steps, delays.slices), (10, 10));
        assert!(delays.most < 0.5);
    }

    #[test]
    fn a_turn_ends_with_a_panic() {
        let turns = Turns::new();
        thread::scope(|scope| {
            let failing = scope.spawn(|| {
                let _turn = turns.step();
                panic!("a step fails");
            });
            assert!(failing.join().is_err());
            drop(turns.slice());
        });
    }
}
