//! Messages of the Haply service.
#![no_main]

use libfuzzer_sys::fuzz_target;
use palpate_devices::haply::read_message;

fuzz_target!(|text: &str| {
    if let Some(vectors) = read_message(text) {
        assert!(vectors.iter().all(|vector| vector.is_finite()));
    }
});
