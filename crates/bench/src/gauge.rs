//! Measures how fast the machine is while a benchmark runs, by the time of a fixed piece of work. Shared machines are
//! slower at some hours than at others, and a comparison of results ([`crate::compare`]) divides the measured times by
//! the time of that work.

use std::hint::black_box;
use std::time::Instant;

/// Number of f64 values in the array that the work goes along: 4 MB, more than the private cache of a CPU core holds.
const NUMBERS: usize = 1 << 19;
/// Number of times that one sample goes along the array.
const ROUNDS: usize = 4;
/// Number of samples, that is, of times that are measured.
const SAMPLES: usize = 15;

/// Times of the fixed work, us, one for each sample. The work is a multiplication and an addition for each value of an
/// array that is larger than the private cache of a CPU core.
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
    // The first sample is dropped, since in it the program accesses the array's memory for the first time.
    sample();
    (0..SAMPLES).map(|_| sample()).collect()
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_gauge_has_its_samples() {
        let samples = super::gauge();
        assert!(samples.len() == super::SAMPLES && samples.iter().all(|us| *us > 0.0), "sample times, us: {samples:?}");
    }
}
