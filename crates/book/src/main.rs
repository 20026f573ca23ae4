//! Builds the book: `cargo run --release -p palpate-book` checks every link of README.md and of the pages in docs/, and
//! then writes the pages as HTML into target/book.
//!
//! A link must lead to a file of the repository, or to a heading of a page; links to other sites are not followed.
//! Every page of docs/ is listed in docs/SUMMARY.md and begins, below its title, with a sentence that says whom it is
//! for. No long sentence of README.md stands in a page of the book as well.

mod check;
mod html;
mod pages;

use std::path::Path;
use std::process::ExitCode;

use mdbook_driver::MDBook;

fn main() -> ExitCode {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let problems = match check::problems(&root) {
        Ok(problems) => problems,
        Err(error) => vec![format!("docs cannot be read: {error}")],
    };
    for problem in &problems {
        eprintln!("error: {problem}");
    }
    if !problems.is_empty() {
        return ExitCode::from(2);
    }
    if let Err(error) = MDBook::load(root.join("docs")).and_then(|book| book.build()) {
        eprintln!("error: the book cannot be built: {error:#}");
        return ExitCode::from(2);
    }
    let problems = match html::mend(&root, &root.join("target/book")) {
        Ok(problems) => problems,
        Err(error) => vec![format!("target/book cannot be read: {error}")],
    };
    for problem in &problems {
        eprintln!("error: {problem}");
    }
    if problems.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(2) }
}
