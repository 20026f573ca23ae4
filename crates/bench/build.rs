//! Build script. It sets `PALPATE_COMMIT`, which the reports print: the git commit, with `-changed` appended where the
//! measured sources have changes that are not committed.
//!
//! Cargo runs this script again only when a measured source file changes. Committing changes none of these files, so
//! the reports still print the earlier commit with `-changed` until the next change.

use std::process::Command;

/// Paths, from the repository root, whose code the benchmarks measure.
const MEASURED: [&str; 6] = ["src", "shaders", "crates/oracle", "crates/devices", "crates/bench", "Cargo.lock"];

fn main() {
    for path in MEASURED {
        println!("cargo:rerun-if-changed=../../{path}");
    }
    let git = |arguments: &[&str]| {
        let output = Command::new("git").current_dir("../..").args(arguments).output().ok()?;
        output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_string())
    };
    let commit = git(&["rev-parse", "--short=10", "HEAD"]).filter(|commit| !commit.is_empty());
    let changes = git(&[&["status", "--porcelain", "--"], &MEASURED[..]].concat());
    let stamp = match (commit, changes) {
        (Some(commit), Some(changes)) if changes.is_empty() => commit,
        (Some(commit), _) => format!("{commit}-changed"),
        (None, _) => "unknown".into(),
    };
    println!("cargo:rustc-env=PALPATE_COMMIT={stamp}");
}
