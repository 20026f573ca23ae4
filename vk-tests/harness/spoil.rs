//! Kernels with a fault planted in them, for tests that show that checks can fail.

use std::path::Path;

use palpate_glsl::Arrays;

/// The SPIR-V of the kernel `shaders/<kernel>.comp`, or of a shader whose name says its stage, with the one place of its text, and
/// of what it includes, that reads `from` reading `to` instead; its name and this are what [`palpate::Options::replaced`] takes.
pub fn spoiled(kernel: &str, from: &str, to: &str) -> Vec<u8> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let root = here.ancestors().map(|folder| folder.join("shaders")).find(|shaders| shaders.is_dir()).unwrap();
    let plain = root.join(kernel);
    let source = if palpate_glsl::kind(&plain).is_some() { plain } else { root.join(format!("{kernel}.comp")) };
    let text = inlined(&root, &source);
    assert_eq!(text.matches(from).count(), 1, "`{from}` stands in {kernel}, or in what it includes, once");
    assert!(palpate_glsl::kind(&source).is_some());
    palpate_glsl::compile(&root, &source, &text.replace(from, to), Arrays::Storage).unwrap_or_else(|e| panic!("{e}"))
}

/// The text of a shader with the files that it includes in place of the lines that ask for them.
fn inlined(root: &Path, source: &Path) -> String {
    let text = std::fs::read_to_string(source).unwrap();
    let lines = text.lines().map(|line| match line.strip_prefix("#include ") {
        Some(asked) => inlined(root, &root.join(asked.trim_matches('"'))),
        None => format!("{line}\n"),
    });
    lines.collect()
}
