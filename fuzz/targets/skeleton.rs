//! Skeleton files, which a scene names.
#![no_main]

use libfuzzer_sys::fuzz_target;
use palpate_fuzz::{fair, in_file, scene};

const SCENE: &str = "[[body]]\nname = \"b\"\nlayer = { box = [[0, 0, 0], [1, 1, 1]], cells = [1, 1, 1] }\n\
                     material = { young = 1e4, poisson = 0.4, density = 1e3 }\nskeleton = \"skeleton.toml\"\n";

fuzz_target!(|bytes: &[u8]| {
    fair(in_file("skeleton.toml", bytes, |path| scene(path.parent().expect("a folder"), SCENE)));
});
