//! Mends the links of the book's built pages (HTML files in target/book): where a page names a file of the repository
//! that is no page of the book, the link must lead from target/book to that file.

use std::io;
use std::path::{Component, Path, PathBuf};

use crate::check::tidy;

/// Rewrites the links of all pages in `book`, the folder of the built pages, to files of the repository in `root`.
/// Returns a message for each page that has a link that leads nowhere.
pub fn mend(root: &Path, book: &Path) -> io::Result<Vec<String>> {
    let (mut problems, mut folders) = (Vec::new(), vec![PathBuf::new()]);
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(book.join(&folder))? {
            let name = folder.join(entry?.file_name());
            let file = book.join(&name);
            if file.is_dir() {
                folders.push(name);
            } else if name.extension().is_some_and(|end| end == "html") {
                let text = std::fs::read_to_string(&file)?;
                let target = |link: &str| target(root, book, &folder, link);
                let mended = links(&text, " href=\"", target).and_then(|text| links(&text, " src=\"", target));
                match mended {
                    Ok(mended) if mended != text => std::fs::write(&file, mended)?,
                    Ok(_) => {}
                    Err(link) => problems.push(format!("{}: {link} leads nowhere", name.display())),
                }
            }
        }
    }
    Ok(problems)
}

/// Replaces every link that follows `start` (the attribute `href` or `src` of an element) by what `target` makes of it;
/// fails with the first link that has no target.
fn links(text: &str, start: &str, target: impl Fn(&str) -> Option<String>) -> Result<String, String> {
    let mut parts = text.split(start);
    let mut result = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let (link, rest) = part.split_once('"').unwrap_or((part, ""));
        let target = target(link).ok_or_else(|| link.to_owned())?;
        result += &format!("{start}{target}\"{rest}");
    }
    Ok(result)
}

/// The link to write in place of `link`, which stands in a page in `folder`, a folder inside the book; `None` if `link`
/// leads nowhere.
fn target(root: &Path, book: &Path, folder: &Path, link: &str) -> Option<String> {
    let is_elsewhere = link.contains("://") || link.starts_with("mailto:") || link.starts_with('#') || link.is_empty();
    let (path, anchor) = link.split_once('#').unwrap_or((link, ""));
    // Links that begin with `/`, the root of a web site, are kept: 404.html, the page for unknown addresses, has them.
    let within = tidy(&folder.join(path));
    let stays = Path::new(path).components().filter(|part| *part == Component::ParentDir).count()
        <= folder.components().count();
    if is_elsewhere || path.starts_with('/') || stays && book.join(&within).exists() {
        return Some(link.to_owned());
    }
    let source =
        |path: &Path| Some(tidy(&Path::new("docs").join(folder).join(path))).filter(|file| root.join(file).exists());
    let file = source(Path::new(path)).or_else(|| source(&Path::new(path).with_extension("md")))?;
    // A page lies as many folders below target/book as `folder` has parts, and target/book two below the root.
    let up = "../".repeat(folder.components().count() + 2);
    let anchor = if anchor.is_empty() { String::new() } else { format!("#{anchor}") };
    Some(format!("{up}{}{anchor}", file.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_lead_to_pages_of_the_book_or_to_files_of_the_repository() {
        let folder = tempfile::tempdir().unwrap();
        let (root, book) = (folder.path(), folder.path().join("target/book"));
        for path in ["docs/a", "target/book/a", "src"] {
            std::fs::create_dir_all(root.join(path)).unwrap();
        }
        std::fs::write(root.join("README.md"), "").unwrap();
        std::fs::write(root.join("src/law.rs"), "").unwrap();
        std::fs::write(book.join("b.html"), "").unwrap();
        let page = "<a href=\"../../src/law.rs#L1\">x</a> <a href=\"../b.html\">y</a> <img src=\"../../src/law.rs\"> \
                    <a href=\"../../README.html\">z</a>";
        std::fs::write(book.join("a/page.html"), page).unwrap();
        assert_eq!(mend(root, &book).unwrap(), Vec::<String>::new());
        let mended = std::fs::read_to_string(book.join("a/page.html")).unwrap();
        let expected = "<a href=\"../../../src/law.rs#L1\">x</a> <a href=\"../b.html\">y</a> \
                        <img src=\"../../../src/law.rs\"> <a href=\"../../../README.md\">z</a>";
        assert_eq!(mended, expected);
        std::fs::write(book.join("a/page.html"), "<a href=\"../c.html\">x</a>").unwrap();
        assert_eq!(mend(root, &book).unwrap(), ["a/page.html: ../c.html leads nowhere"]);
    }
}
