//! Checks of the pages: links, the list of pages, first sentences, and sentences that stand twice.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::{Component, Path, PathBuf};

use pulldown_cmark::{Event, Options, Parser, Tag, TagEnd};

/// Folders whose pages are checked but do not belong to the book.
const OUTSIDE: [&str; 4] = ["README.md", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md"];
/// The list of pages.
const SUMMARY: &str = "docs/SUMMARY.md";
/// Sentences with fewer characters may stand in README.md and in the book.
const SHORT: usize = 60;
/// How the first paragraph of a page begins.
const AUDIENCE: &str = "For ";

/// What a page of Markdown holds.
#[derive(Default)]
struct Page {
    /// Targets of links and images.
    links: Vec<String>,
    /// Anchors of the headings, as Markdown viewers make them.
    anchors: BTreeSet<String>,
    /// Text of the paragraphs, outside of code blocks and tables.
    paragraphs: Vec<String>,
}

fn parse(text: &str) -> Page {
    let mut page = Page::default();
    let (mut heading, mut paragraph) = (None::<String>, None::<String>);
    for event in Parser::new_ext(text, Options::ENABLE_TABLES) {
        match event {
            Event::Start(Tag::Link { dest_url, .. } | Tag::Image { dest_url, .. }) => page.links.push(dest_url.into()),
            Event::Start(Tag::Heading { .. }) => heading = Some(String::new()),
            Event::End(TagEnd::Heading(_)) => {
                page.anchors.extend(heading.take().map(|text| anchor(&text)));
            }
            Event::Start(Tag::Paragraph) => paragraph = Some(String::new()),
            Event::End(TagEnd::Paragraph) => page.paragraphs.extend(paragraph.take()),
            Event::Text(part) | Event::Code(part) => {
                let open = heading.iter_mut().chain(paragraph.iter_mut());
                open.for_each(|text| text.push_str(&part));
            }
            Event::SoftBreak | Event::HardBreak => {
                heading.iter_mut().chain(paragraph.iter_mut()).for_each(|text| text.push(' '));
            }
            _ => {}
        }
    }
    page
}

/// The anchor of a heading: lower case, spaces as hyphens, other signs left out.
fn anchor(heading: &str) -> String {
    let kept = heading.trim().chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.flat_map(char::to_lowercase).map(|c| if c == ' ' { '-' } else { c }).collect()
}

/// A path without `.` and `..`.
pub fn tidy(path: &Path) -> PathBuf {
    let mut result = PathBuf::new();
    for part in path.components() {
        match part {
            Component::CurDir => {}
            Component::ParentDir => drop(result.pop()),
            part => result.push(part),
        }
    }
    result
}

fn markdown(folder: &Path, found: &mut Vec<PathBuf>) -> io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            markdown(&path, found)?;
        } else if path.extension().is_some_and(|end| end == "md") {
            found.push(path);
        }
    }
    Ok(())
}

/// The sentences of a page's paragraphs, long ones only.
fn sentences(page: &Page) -> BTreeSet<String> {
    let all = page.paragraphs.iter().flat_map(|text| text.split_inclusive(['.', '!', '?', ':', ';']));
    all.map(|text| text.trim().to_owned()).filter(|text| text.chars().count() > SHORT).collect()
}

/// Everything that is wrong with the pages of the repository in `root`, a line each.
pub fn problems(root: &Path) -> io::Result<Vec<String>> {
    let mut files: Vec<PathBuf> = OUTSIDE.iter().map(|name| root.join(name)).filter(|file| file.exists()).collect();
    markdown(&root.join("docs"), &mut files)?;
    files.sort();
    let mut pages = BTreeMap::new();
    for file in &files {
        let name = tidy(file.strip_prefix(root).unwrap_or(file));
        pages.insert(name, parse(&std::fs::read_to_string(file)?));
    }
    let mut problems = Vec::new();
    for (name, page) in &pages {
        for link in &page.links {
            problems.extend(broken(root, &pages, name, link).map(|why| format!("{}: {link}: {why}", name.display())));
        }
    }
    problems.extend(unlisted(&pages));
    let of_book = |name: &Path| name.starts_with("docs") && name != Path::new(SUMMARY);
    for (name, page) in pages.iter().filter(|(name, _)| of_book(name)) {
        if !page.paragraphs.first().is_some_and(|text| text.starts_with(AUDIENCE)) {
            problems
                .push(format!("{}: does not begin with \"{AUDIENCE}..\": say whom the page is for", name.display()));
        }
    }
    let front = pages.get(Path::new("README.md")).map(sentences).unwrap_or_default();
    for (name, page) in pages.iter().filter(|(name, _)| of_book(name)) {
        for twice in sentences(page).intersection(&front) {
            problems.push(format!("{}: stands in README.md as well: {twice}", name.display()));
        }
    }
    Ok(problems)
}

/// Why a link leads nowhere.
fn broken(root: &Path, pages: &BTreeMap<PathBuf, Page>, from: &Path, link: &str) -> Option<String> {
    if link.contains("://") || link.starts_with("mailto:") {
        return None;
    }
    let (path, anchor) = link.split_once('#').map_or((link, None), |(path, anchor)| (path, Some(anchor)));
    let target = match path {
        "" => from.to_owned(),
        path => tidy(&from.parent().unwrap_or(Path::new("")).join(path)),
    };
    if !root.join(&target).exists() {
        return Some(format!("there is no {}", target.display()));
    }
    let anchor = anchor?;
    match pages.get(&target) {
        Some(page) if page.anchors.contains(anchor) => None,
        Some(_) => Some(format!("{} has no heading #{anchor}", target.display())),
        // Anchors of other files, such as reports, are their own.
        None => None,
    }
}

/// Pages that the summary does not list, or lists twice.
fn unlisted(pages: &BTreeMap<PathBuf, Page>) -> Vec<String> {
    let Some(summary) = pages.get(Path::new(SUMMARY)) else { return vec![format!("there is no {SUMMARY}")] };
    let listed: Vec<PathBuf> = summary.links.iter().map(|link| tidy(&Path::new("docs").join(link))).collect();
    let count = |name: &Path| listed.iter().filter(|link| *link == name).count();
    let of_book = pages.keys().filter(|name| name.starts_with("docs") && *name != Path::new(SUMMARY));
    let wrong = of_book.filter(|name| count(name) != 1);
    wrong.map(|name| format!("{}: stands {} times in {SUMMARY}, not once", name.display(), count(name))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A repository with a front page, a summary and two pages, in which `page` is the text of the second.
    fn problems_of(front: &str, summary: &str, page: &str) -> Vec<String> {
        let folder = tempfile::tempdir().unwrap();
        let docs = folder.path().join("docs");
        std::fs::create_dir(&docs).unwrap();
        std::fs::write(folder.path().join("README.md"), front).unwrap();
        std::fs::write(docs.join("SUMMARY.md"), summary).unwrap();
        std::fs::write(docs.join("one.md"), "# One\n\nFor all.\n\n## The second `part`, here\n\nText.\n").unwrap();
        std::fs::write(docs.join("two.md"), page).unwrap();
        problems(folder.path()).unwrap()
    }

    #[test]
    fn each_kind_of_mistake_is_found() {
        let (front, summary) = ("# Front\n\nText.\n", "- [One](one.md)\n- [Two](two.md)\n");
        let sound = "# Two\n\nFor some.\n\n[a](one.md#the-second-part-here) [b](../README.md) [c](https://x.y)\n";
        assert_eq!(problems_of(front, summary, sound), Vec::<String>::new());
        let long = "This is a sentence of more than sixty characters, which stands on both pages.";
        for (front, summary, page, problem) in [
            (front, summary, sound.replace("one.md", "three.md"), "there is no docs/three.md"),
            (front, summary, sound.replace("second", "third"), "has no heading #the-third-part-here"),
            (front, summary, sound.replace("For some", "Some"), "say whom the page is for"),
            (front, "- [One](one.md)\n", sound.into(), "docs/two.md: stands 0 times"),
            (long, summary, format!("# Two\n\nFor some. {long}\n"), "stands in README.md as well"),
        ] {
            let found = problems_of(front, summary, &page);
            assert!(found.len() == 1 && found[0].contains(problem), "expected \"{problem}\", found {found:?}");
        }
    }
}
