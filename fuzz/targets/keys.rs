//! Trajectories: CSV files of keys, which a scene names.
#![no_main]

use libfuzzer_sys::fuzz_target;
use palpate_fuzz::{fair, in_file, scene};

const SCENE: &str = "[tool]\nsphere = 0.01\nmass = 0.05\n[drive]\npath = \"keys.csv\"\n";

fuzz_target!(|bytes: &[u8]| {
    let read = in_file("keys.csv", bytes, |path| scene(path.parent().expect("a folder"), SCENE));
    let Some(scene) = fair(read) else { return };
    assert!(scene.trajectory.windows(2).all(|pair| pair[0].time < pair[1].time));
});
