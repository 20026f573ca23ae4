//! Surfaces and tetrahedral meshes: legacy VTK files, ASCII and binary.
#![no_main]

use libfuzzer_sys::fuzz_target;
use palpate_fuzz::{layer, surface};

fuzz_target!(|bytes: &[u8]| {
    surface("mesh.vtk", bytes);
    layer("mesh.vtk", bytes);
});
