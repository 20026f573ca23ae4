//! Recordings of haptic sessions.
#![no_main]

use libfuzzer_sys::fuzz_target;
use palpate_devices::record::Recorded;
use palpate_fuzz::{fair, in_file};

fuzz_target!(|bytes: &[u8]| {
    let Some(recorded) = fair(in_file("session.palpate", bytes, Recorded::open)) else { return };
    for entry in recorded {
        fair(entry);
    }
});
