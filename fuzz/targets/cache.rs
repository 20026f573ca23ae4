//! The cache of prepared bodies: entries with any payload under a right checksum. What is made of such an entry is
//! refused, or is a body that a simulation can be made of.
#![no_main]

use libfuzzer_sys::fuzz_target;
use palpate::Scene;
use palpate::internal::prepare::{self, Cache};
use palpate_fuzz::{fair, in_folder, scene};
use sha2::{Digest, Sha256};

const SCENE: &str = "[[body]]\nname = \"b\"\nlayer = { box = [[0, 0, 0], [1, 1, 1]], cells = [1, 2, 1] }\n\
                     material = { young = 1e4, poisson = 0.4, density = 1e3 }\n";
/// Bytes of an entry before the length of its payload, and before the payload.
const LENGTH: usize = 8 + 32;
const HEADER: usize = LENGTH + 8 + 32;

fn prepared(scene: &Scene, cache: &Cache) -> palpate::Result<prepare::Body> {
    prepare::body_and_report(&scene.bodies[0], scene, cache, &mut |_| Ok(())).map(|(body, _)| body)
}

fuzz_target!(|payload: &[u8]| {
    in_folder(|folder| {
        let scene = scene(folder, SCENE).expect("a scene");
        let cache = Cache::at(folder);
        let entry = || {
            let files = std::fs::read_dir(folder).expect("a folder").flatten().map(|file| file.path());
            files.into_iter().find(|path| path.extension().is_some_and(|end| end == "body"))
        };
        let path = entry().unwrap_or_else(|| {
            prepared(&scene, &cache).expect("a body");
            entry().expect("an entry of the cache")
        });
        let mut bytes = std::fs::read(&path).expect("an entry");
        bytes.truncate(LENGTH);
        bytes.extend((payload.len() as u64).to_le_bytes());
        bytes.extend(Sha256::digest(payload));
        assert_eq!(bytes.len(), HEADER);
        bytes.extend(payload);
        std::fs::write(&path, bytes).expect("an entry");
        fair(prepared(&scene, &cache));
    });
});
