//! Tetrahedral meshes: TetGen's pair of files; the input is cut at its first zero byte.
#![no_main]

use libfuzzer_sys::fuzz_target;
use palpate::scene::tetrahedra;
use palpate_fuzz::{fair, in_file};

fuzz_target!(|bytes: &[u8]| {
    let at = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    let (nodes, elements) = (&bytes[..at], &bytes[(at + 1).min(bytes.len())..]);
    in_file("mesh.ele", elements, |_| ());
    let Some(mesh) = fair(in_file("mesh.node", nodes, tetrahedra::read)) else { return };
    let count = mesh.nodes.len() as u32;
    assert!(mesh.tetrahedra.iter().flatten().all(|node| *node < count));
});
