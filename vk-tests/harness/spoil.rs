//! Makes shaders with a planted fault for mutation tests, which show that a check can fail.

use std::path::Path;

use palpate_glsl::Arrays;

/// The SPIR-V of the kernel `shaders/<kernel>.comp`, or of `shaders/<kernel>` where that name already has the extension
/// of a shader stage, in which the text `from` is replaced by `to`; `from` must occur exactly once in the shader and
/// its includes. [`palpate::Options::replaced`] takes the kernel's name together with these bytes.
pub fn spoiled(kernel: &str, from: &str, to: &str) -> Vec<u8> {
    // Cargo sets this variable for tests, and crates/bench/pack/run.sh where there is no repository.
    let here = std::env::var("CARGO_MANIFEST_DIR").unwrap_or(env!("CARGO_MANIFEST_DIR").into());
    let root =
        Path::new(&here).ancestors().map(|folder| folder.join("shaders")).find(|shaders| shaders.is_dir()).unwrap();
    let plain = root.join(kernel);
    let source = if palpate_glsl::is_shader(&plain) { plain } else { root.join(format!("{kernel}.comp")) };
    let text = inlined(&root, &source);
    assert_eq!(text.matches(from).count(), 1, "`{from}` must occur exactly once in {kernel} and its includes");
    let folder = tempfile::tempdir().unwrap();
    let spoiled = folder.path().join(source.file_name().unwrap());
    std::fs::write(&spoiled, text.replace(from, to)).unwrap();
    palpate_glsl::compile(&root, &spoiled, Arrays::Storage).unwrap_or_else(|e| panic!("{e}"))
}

/// The text of a shader in which each `#include` line is replaced by the included file.
fn inlined(root: &Path, source: &Path) -> String {
    let text = std::fs::read_to_string(source).unwrap();
    let lines = text.lines().map(|line| match line.strip_prefix("#include ") {
        Some(asked) => inlined(root, &root.join(asked.trim_matches('"'))),
        None => format!("{line}\n"),
    });
    lines.collect()
}
