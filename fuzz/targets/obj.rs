//! Surfaces: OBJ files.
#![no_main]

use libfuzzer_sys::fuzz_target;
use palpate::scene::obj;
use palpate_fuzz::{fair, in_file};

fuzz_target!(|bytes: &[u8]| {
    let Some(mesh) = fair(in_file("mesh.obj", bytes, obj::read)) else { return };
    let count = mesh.vertices.len() as u32;
    assert!(mesh.vertices.iter().all(|vertex| vertex.is_finite()));
    assert!(mesh.triangles.iter().flatten().all(|vertex| *vertex < count));
});
