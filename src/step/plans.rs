//! How many solver iterations are submitted with a step, before it is known how many the step needs: a plan. Iterations
//! that are left over find nothing to do, but their passes take some time; a plan that is too short costs a further
//! submit, for which the host waits.

use crate::Result;
use crate::gpu::Recording;

/// Number of iterations in the shortest recording.
const SHORTEST: u32 = 4;
/// Most recordings of iterations.
pub const MOST_PARTS: usize = 24;
/// Number of latest steps whose needs are remembered.
const REMEMBERED: usize = 8;
/// Number of iterations that a plan has beyond five quarters of the greatest remembered need. Over 300 steps of each
/// example scene this left at most 1.3 % of the plans too short, and 48 to 62 % of the planned iterations without work;
/// plans without the quarter left up to 7.3 % too short, and 37 to 55 % without work.
const SPARE: u32 = 2;

/// Recordings of 4, 8, 16, ... iterations. Some of them together, each at most once, are a plan of any multiple of four
/// iterations.
pub struct Plans(Vec<Recording>);

impl Plans {
    /// Records iterations with the function `record`, until the longest plan has at least `most` iterations.
    pub fn new(most: u32, record: impl Fn(u32) -> Result<Recording>) -> Result<Plans> {
        let mut recordings = vec![record(SHORTEST)?];
        while longest(recordings.len()) < most && recordings.len() < MOST_PARTS {
            recordings.push(record(SHORTEST << recordings.len())?);
        }
        Ok(Plans(recordings))
    }

    /// The number of iterations of the shortest plan with at least `iterations` of them, at least one, or else of the
    /// longest; and the recordings that it is made of.
    pub fn plan(&self, iterations: u32) -> (u32, impl Iterator<Item = &Recording>) {
        let planned = planned(iterations, self.0.len());
        let parts = self.0.iter().enumerate().filter(move |(k, _)| is_part(*k, planned));
        (planned, parts.map(|(_, recording)| recording))
    }

    /// The recordings, by rising length.
    pub fn recordings(&self) -> &[Recording] {
        &self.0
    }

    /// The shortest recording, and its number of iterations.
    pub fn shortest(&self) -> (u32, &Recording) {
        (SHORTEST, &self.0[0])
    }
}

/// Number of iterations of the shortest plan with at least `iterations` of them that so many recordings make, or else of
/// the longest.
fn planned(iterations: u32, recordings: usize) -> u32 {
    iterations.max(1).next_multiple_of(SHORTEST).min(longest(recordings))
}

/// Whether the recording with this index is a part of a plan.
fn is_part(recording: usize, planned: u32) -> bool {
    (planned / SHORTEST) >> recording & 1 == 1
}

/// Number of iterations of the longest plan that so many recordings make.
fn longest(recordings: usize) -> u32 {
    SHORTEST * ((1 << recordings) - 1)
}

/// The numbers of iterations that the last steps needed.
#[derive(Default)]
pub struct Needs {
    last: [u32; REMEMBERED],
    next: usize,
}

impl Needs {
    /// Remembers the number of iterations that a step needed.
    pub fn note(&mut self, iterations: u32) {
        self.last[self.next] = iterations;
        self.next = (self.next + 1) % REMEMBERED;
    }

    /// Number of iterations that are to be submitted with the next step.
    pub fn predicted(&self) -> u32 {
        self.last.iter().max().map_or(0, |most| most + most.div_ceil(4) + SPARE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_parts_of_a_plan_have_its_iterations() {
        for (wanted, has) in [(0, 4), (1, 4), (4, 4), (5, 8), (13, 16), (26, 28), (28, 28), (29, 28), (1000, 28)] {
            let planned = planned(wanted, 3);
            let parts = (0..3).filter(|k| is_part(*k, planned)).map(|k| SHORTEST << k);
            assert_eq!((planned, parts.sum::<u32>()), (has, has), "{wanted} iterations");
        }
    }

    #[test]
    fn a_quarter_more_than_the_greatest_of_the_last_needs_is_predicted() {
        let mut needs = Needs::default();
        needs.note(40);
        (0..7).for_each(|k| needs.note(k));
        assert_eq!(needs.predicted(), 52, "while the first need is remembered");
        needs.note(9);
        assert_eq!(needs.predicted(), 14, "when it is forgotten");
    }
}
