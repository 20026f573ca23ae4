//! Build script: the commit that reports name.

use std::path::Path;
use std::process;

/// The commit that reports name, as `PALPATE_COMMIT`; changes since then are not known to it.
fn main() {
    let git = |arguments: &[&str]| {
        let output = process::Command::new("git").args(arguments).output().ok().filter(|o| o.status.success())?;
        Some(String::from_utf8_lossy(&output.stdout).trim().to_string()).filter(|text| !text.is_empty())
    };
    println!(
        "cargo:rustc-env=PALPATE_COMMIT={}",
        git(&["rev-parse", "--short=10", "HEAD"]).unwrap_or("unknown".into())
    );
    // Written with every commit and checkout; a file that is not there would have this script run every time.
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"]).filter(|log| Path::new(log).exists()) {
        println!("cargo:rerun-if-changed={log}");
    }
}
