//! Times of the proximity query (the stages of a step that find contacts) in benchmarks, and medians of samples. A
//! sample is one measured time.

use std::collections::BTreeMap;

use palpate::internal::stages::{POSE_TO_CONTACT, QUERY};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Times of the query's stages, and of the query as a whole, us. A run is timed either stage by stage or as a whole.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Samples {
    stages: [Vec<f64>; QUERY.len()],
    whole: Vec<f64>,
}

impl Samples {
    /// Adds the times of a run, each with the name of its timer. Timers of stages outside the query are ignored; a
    /// stage without a timer counts as taking no time.
    pub fn add(&mut self, times: &[(String, f64)]) {
        let of = |timer: &str| times.iter().filter(|(name, _)| name == timer).map(|(_, us)| us).sum();
        if times.iter().any(|(name, _)| name == POSE_TO_CONTACT) {
            self.whole.push(of(POSE_TO_CONTACT));
        } else {
            self.stages.iter_mut().zip(QUERY).for_each(|(samples, stage)| samples.push(of(stage)));
        }
    }

    /// Median time of each stage, ms. Each of these times includes the cost of a timestamp, so that the sum of the
    /// medians exceeds the time of the query as a whole.
    pub fn medians_ms(&self) -> [f64; QUERY.len()] {
        self.stages.each_ref().map(|samples| 1e-3 * median(samples))
    }

    /// Median time of the query as a whole, ms.
    pub fn total_ms(&self) -> f64 {
        1e-3 * median(&self.whole)
    }
}

impl Serialize for Samples {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(QUERY.iter().zip(&self.stages).chain([(&POSE_TO_CONTACT, &self.whole)]))
    }
}

impl<'de> Deserialize<'de> for Samples {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Samples, D::Error> {
        let mut by_name = BTreeMap::<String, Vec<f64>>::deserialize(deserializer)?;
        let mut take = |name: &str| by_name.remove(name).unwrap_or_default();
        Ok(Samples { stages: QUERY.map(&mut take), whole: take(POSE_TO_CONTACT) })
    }
}

/// The median of the samples: for an even number of samples the mean of the two middle ones, for no samples 0.
pub fn median(samples: &[f64]) -> f64 {
    let mut sorted = samples.to_vec();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted.len() / 2;
    match sorted.len() {
        0 => 0.0,
        count if count % 2 == 1 => sorted[middle],
        _ => 0.5 * (sorted[middle - 1] + sorted[middle]),
    }
}

/// Number of hands. A hand is a subset of the samples of all rounds (lists of samples): where there are fewer rounds
/// than hands, all samples are dealt into the hands in turn, like cards, so that each hand has samples from every phase
/// of a run.
pub const HANDS: usize = 5;

/// Medians that show the spread of a time: the median of each round or, with fewer than [`HANDS`] rounds that have
/// samples, the median of each hand.
pub fn hands(rounds: &[Vec<f64>]) -> Vec<f64> {
    let rounds: Vec<&Vec<f64>> = rounds.iter().filter(|round| !round.is_empty()).collect();
    if rounds.len() >= HANDS {
        return rounds.into_iter().map(|round| median(round)).collect();
    }
    let all: Vec<f64> = rounds.into_iter().flatten().copied().collect();
    let hand = |k: usize| all.iter().skip(k).step_by(HANDS).copied().collect::<Vec<f64>>();
    (0..HANDS.min(all.len())).map(|k| median(&hand(k))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(pose: f64, contact: f64) -> Vec<(String, f64)> {
        vec![("pose".into(), pose), ("solve".into(), 1e6), ("contact".into(), contact), ("pose".into(), 1.0)]
    }

    fn as_one(us: f64) -> Vec<(String, f64)> {
        vec![(POSE_TO_CONTACT.into(), us), ("solve".into(), 1e6)]
    }

    #[test]
    fn medians_of_rounds_or_of_hands() {
        assert_eq!([&[][..], &[3.0], &[9.0, 1.0], &[5.0, 1.0, 2.0]].map(median), [0.0, 3.0, 5.0, 2.0]);
        let one: Vec<f64> = (0..10).map(f64::from).collect();
        assert_eq!(hands(std::slice::from_ref(&one)), [2.5, 3.5, 4.5, 5.5, 6.5]);
        assert_eq!(hands(&[vec![1.0, 2.0, 9.0], vec![], vec![4.0]]), [1.0, 2.0, 9.0, 4.0]);
        let five: Vec<Vec<f64>> = (0..5).map(|k| vec![f64::from(k); 3]).collect();
        assert_eq!(hands(&five), [0.0, 1.0, 2.0, 3.0, 4.0]);
    }

    #[test]
    fn medians_are_of_the_stages_and_of_all_as_one() {
        let mut samples = Samples::default();
        [run(1.0, 30.0), as_one(7.0), run(9.0, 10.0), as_one(3.0), run(4.0, 20.0), as_one(5.0)]
            .iter()
            .for_each(|times| samples.add(times));
        assert_eq!(samples.medians_ms(), [5e-3, 0.0, 0.0, 0.0, 20e-3]);
        assert_eq!(samples.total_ms(), 5e-3);
        let value = serde_json::to_value(&samples).unwrap();
        assert_eq!(value["contact"], serde_json::json!([30.0, 10.0, 20.0]));
        assert_eq!(value["pose to contact"], serde_json::json!([7.0, 3.0, 5.0]));
        assert_eq!(serde_json::from_value::<Samples>(value).unwrap(), samples);
        assert_eq!(Samples::default().total_ms(), 0.0);
    }
}
