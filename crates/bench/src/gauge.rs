//! How fast the machine is while something is measured: the time of a piece of work that never changes. Machines that are
//! shared are slower at some hours than at others, which is no property of the program.

use std::hint::black_box;
use std::time::Instant;

/// Numbers that the work goes through: 4 MB, which no core's own cache holds.
const NUMBERS: usize = 1 << 19;
/// Times that it goes through them.
const ROUNDS: usize = 4;
/// Samples.
const SAMPLES: usize = 15;

/// Microseconds of the same work, so many times: multiplying and adding along an array that is larger than caches.
pub fn gauge() -> Vec<f64> {
    let mut numbers = vec![1.0f64; NUMBERS];
    let mut sample = || {
        let begun = Instant::now();
        for _ in 0..ROUNDS {
            numbers.iter_mut().for_each(|x| *x = *x * 0.999_999 + 1e-6);
            black_box(&mut numbers);
        }
        begun.elapsed().as_secs_f64() * 1e6
    };
    // The first finds memory untouched.
    sample();
    (0..SAMPLES).map(|_| sample()).collect()
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_gauge_has_its_samples() {
        let samples = super::gauge();
        assert!(samples.len() == super::SAMPLES && samples.iter().all(|us| *us > 0.0), "{samples:?}");
    }
}
