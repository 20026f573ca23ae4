//! Measured curves for a fit: CSV files.
#![no_main]

use libfuzzer_sys::fuzz_target;
use palpate_fit::Measured;
use palpate_fuzz::{fair, in_file};

fuzz_target!(|bytes: &[u8]| {
    let Some(measured) = fair(in_file("curve.csv", bytes, Measured::read)) else { return };
    assert!(measured.points.len() >= 3 && measured.points.iter().all(|(x, f)| x.is_finite() && f.is_finite()));
});
