//! Surfaces and tetrahedral meshes: VTK's XML files.
#![no_main]

use libfuzzer_sys::fuzz_target;
use palpate_fuzz::{layer, surface};

fuzz_target!(|bytes: &[u8]| {
    surface("mesh.vtp", bytes);
    layer("mesh.vtu", bytes);
});
