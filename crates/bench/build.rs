//! Build script: the commit that reports name, as `PALPATE_COMMIT`; `-changed` where what is measured differed from it.
//!
//! It is asked for when something that is measured changes, and not when a commit is made of what was built already.

use std::process::Command;

/// What reports measure.
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
