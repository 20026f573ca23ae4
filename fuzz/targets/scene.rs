//! Scene files. A scene that is accepted has finite settings.
#![no_main]

use libfuzzer_sys::fuzz_target;
use palpate_fuzz::{fair, in_folder, scene};

fuzz_target!(|text: &str| {
    let Some(scene) = fair(in_folder(|folder| scene(folder, text))) else { return };
    assert!(scene.step.dt.is_finite() && scene.step.dt > 0.0 && scene.duration().is_finite());
    assert!(scene.notes().iter().all(|note| !note.is_empty()));
});
