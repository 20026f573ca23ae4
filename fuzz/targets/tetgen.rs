//! Tetrahedral meshes: TetGen's pair of files; the input is cut at its first zero byte.
#![no_main]

use libfuzzer_sys::fuzz_target;
use palpate_fuzz::{in_file, layer};

fuzz_target!(|bytes: &[u8]| {
    let at = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    let (nodes, elements) = (&bytes[..at], &bytes[(at + 1).min(bytes.len())..]);
    in_file("mesh.ele", elements, |_| ());
    layer("mesh.node", nodes);
});
