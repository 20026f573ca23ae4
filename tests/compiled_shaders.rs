//! The SPIR-V that `packages/source.sh` packs is what the build script left in its output folder: here it is held against
//! a fresh compilation of the sources.

use std::path::{Path, PathBuf};

use palpate_glsl::{Arrays, compile, digest, is_shader, whole_text};

/// The sources of all shaders, without the files that others include.
fn sources(root: &Path) -> Vec<PathBuf> {
    let entries =
        |folder: &Path| std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect::<Vec<_>>();
    let folders = entries(root).into_iter().filter(|path| path.is_dir() && !path.ends_with("shared"));
    folders.flat_map(|folder| entries(&folder)).filter(|path| is_shader(path)).collect()
}

/// Compares the binaries of a shader in the folder `built`; returns how many there are.
fn check(root: &Path, source: &Path, built: &Path) -> usize {
    let name = source.strip_prefix(root).unwrap().to_str().unwrap();
    let stem = name.strip_suffix(".comp").unwrap_or(name).replace('/', "-");
    let made_of = std::fs::read_to_string(built.join(format!("{stem}.sha256"))).unwrap();
    assert_eq!(made_of, digest(&whole_text(root, source).unwrap()), "digest of {name}");
    let same = |arrays: Arrays| {
        let file = built.join(format!("{stem}.{arrays:?}.spv"));
        file.exists()
            .then(|| assert!(std::fs::read(&file).unwrap() == compile(root, source, arrays).unwrap(), "{name}"))
    };
    [Arrays::Texel, Arrays::Storage].into_iter().filter_map(same).count()
}

#[test]
fn compiled_shaders_are_those_of_the_sources() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders");
    let built = Path::new(env!("OUT_DIR"));
    let sources = sources(&root);
    assert!(sources.len() > 50);
    let (first, second) = sources.split_at(sources.len() / 2);
    let count = |share: &[PathBuf]| share.iter().map(|source| check(&root, source, built)).sum::<usize>();
    let binaries = std::thread::scope(|scope| {
        let other = scope.spawn(|| count(second));
        count(first) + other.join().unwrap()
    });
    assert!(binaries > sources.len());
}
