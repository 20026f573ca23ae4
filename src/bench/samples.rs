//! Times of the stages of a query, run by run.

use serde::{Serialize, Serializer};

/// The stages of a proximity query, in their order.
pub const STAGES: [&str; 5] = ["pose", "cull", "skin", "depth", "contact"];

/// Times of [`STAGES`], microseconds, a run each.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Samples {
    us: [Vec<f64>; STAGES.len()],
}

impl Samples {
    /// Adds a run; stages of other names are left out, and a stage that the run lacks took no time.
    pub fn add(&mut self, times: &[(String, f64)]) {
        for (samples, stage) in self.us.iter_mut().zip(STAGES) {
            samples.push(times.iter().filter(|(name, _)| name == stage).map(|(_, us)| us).sum());
        }
    }

    /// Runs added so far.
    pub fn runs(&self) -> usize {
        self.us[0].len()
    }

    /// Median of each stage, ms.
    pub fn medians_ms(&self) -> [f64; STAGES.len()] {
        self.us.each_ref().map(|samples| 1e-3 * median(samples))
    }

    /// Median of the sums of all stages, ms; close to the sum of the medians, and what a query takes.
    pub fn total_ms(&self) -> f64 {
        let sum = |run: usize| self.us.iter().map(|samples| samples[run]).sum();
        1e-3 * median(&(0..self.runs()).map(sum).collect::<Vec<f64>>())
    }
}

impl Serialize for Samples {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(STAGES.iter().zip(&self.us))
    }
}

/// The median by nearest rank; 0 of nothing.
pub fn median(samples: &[f64]) -> f64 {
    crate::report::summary::quantiles(samples).map_or(0.0, |(median, _)| median)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(pose: f64, contact: f64) -> Vec<(String, f64)> {
        vec![("pose".into(), pose), ("solve".into(), 1e6), ("contact".into(), contact), ("pose".into(), 1.0)]
    }

    #[test]
    fn medians_are_of_the_stages_and_of_their_sums() {
        let mut samples = Samples::default();
        [run(1.0, 30.0), run(9.0, 10.0), run(4.0, 20.0)].iter().for_each(|times| samples.add(times));
        assert_eq!((samples.runs(), samples.medians_ms()), (3, [5e-3, 0.0, 0.0, 0.0, 20e-3]));
        assert_eq!(samples.total_ms(), 25e-3);
        let value = serde_json::to_value(&samples).unwrap();
        assert_eq!(value["contact"], serde_json::json!([30.0, 10.0, 20.0]));
        assert_eq!(Samples::default().total_ms(), 0.0);
    }
}
