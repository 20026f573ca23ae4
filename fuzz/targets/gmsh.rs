//! Tetrahedral meshes: Gmsh .msh files, ASCII and binary.
#![no_main]

use libfuzzer_sys::fuzz_target;
use palpate::scene::tetrahedra;
use palpate_fuzz::{fair, in_file};

fuzz_target!(|bytes: &[u8]| {
    let Some(mesh) = fair(in_file("mesh.msh", bytes, tetrahedra::read)) else { return };
    let count = mesh.nodes.len() as u32;
    assert!(mesh.nodes.iter().all(|node| node.is_finite()));
    assert!(mesh.tetrahedra.iter().flatten().all(|node| *node < count));
});
