//! Builds the book: `cargo run --release -p palpate-book` checks every link of README.md and of the pages in docs/, and
//! then writes the pages as HTML into target/book; with `--no-default-features` it only checks.
//!
//! A link must lead to a file of the repository, or to a heading of a page; links to other sites are not followed.
//! Every page of docs/ is listed in docs/SUMMARY.md and begins, below its title, with a sentence that says whom it is
//! for. README.md has at most 150 lines, and no long sentence of it stands in a page of the book as well.

mod check;
#[cfg(feature = "html")]
mod html;
mod pages;

use std::path::Path;
use std::process::ExitCode;

fn main() -> ExitCode {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let problems = match check::problems(&root) {
        Ok(problems) => problems,
        Err(error) => vec![format!("docs cannot be read: {error}")],
    };
    let problems = if problems.is_empty() { build(&root) } else { problems };
    for problem in &problems {
        eprintln!("error: {problem}");
    }
    if problems.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(2) }
}

/// Without the feature `html` no page is written.
#[cfg(not(feature = "html"))]
fn build(_root: &Path) -> Vec<String> {
    Vec::new()
}

/// Writes the pages as HTML; returns what is wrong with them.
#[cfg(feature = "html")]
fn build(root: &Path) -> Vec<String> {
    let built = mdbook_driver::MDBook::load(root.join("docs")).and_then(|book| book.build());
    if let Err(error) = built {
        return vec![format!("the book cannot be built: {error:#}")];
    }
    html::mend(root, &root.join("target/book"))
        .unwrap_or_else(|error| vec![format!("target/book cannot be read: {error}")])
}
