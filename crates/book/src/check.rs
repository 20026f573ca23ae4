//! Checks of the Markdown pages, made before the book (the pages in docs/) is built: every link of a page must lead
//! somewhere; docs/SUMMARY.md must list each page of the book once; the first paragraph of a page must say whom the
//! page is for; README.md must be short, and no long sentence may stand both in it and in the book.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::{Component, Path, PathBuf};

use pulldown_cmark::{Event, Options, Parser, Tag, TagEnd};

use crate::pages;

/// The page that lists the pages of the book.
const SUMMARY: &str = "docs/SUMMARY.md";
/// Most lines of README.md.
const FRONT_LINES: usize = 150;
/// Sentences with at most this many characters may stand both in README.md and in the book.
const SHORT: usize = 60;
/// Text with which the first paragraph of each page of the book must begin, to say whom the page is for.
const AUDIENCE: &str = "For ";

/// What a page of Markdown holds.
#[derive(Default)]
struct Page {
    /// Targets of links and images.
    links: Vec<String>,
    /// Anchors of the headings (what a link has after `#`), as Markdown viewers make them.
    anchors: BTreeSet<String>,
    /// Text of each paragraph; code blocks and tables are left out.
    paragraphs: Vec<String>,
    /// Number of lines.
    lines: usize,
}

fn parse(text: &str) -> Page {
    let mut page = Page { lines: text.lines().count(), ..Page::default() };
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

/// The anchor of a heading: its letters in lower case, its spaces as hyphens; signs other than `-` and `_` are left
/// out.
fn anchor(heading: &str) -> String {
    let kept = heading.trim().chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.flat_map(char::to_lowercase).map(|c| if c == ' ' { '-' } else { c }).collect()
}

/// The path with its parts `.` and `..` resolved.
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

/// The sentences of a page's paragraphs that have more than [`SHORT`] characters.
fn sentences(page: &Page) -> BTreeSet<String> {
    let all = page.paragraphs.iter().flat_map(|text| text.split_inclusive(['.', '!', '?', ':', ';']));
    all.map(|text| text.trim().to_owned()).filter(|text| text.chars().count() > SHORT).collect()
}

/// Everything that is wrong with the pages of the repository in `root`: one message for each problem.
pub fn problems(root: &Path) -> io::Result<Vec<String>> {
    let mut pages = BTreeMap::new();
    for file in pages::files(root)? {
        let name = tidy(file.strip_prefix(root).unwrap_or(&file));
        pages.insert(name, parse(&std::fs::read_to_string(&file)?));
    }
    let mut problems = Vec::new();
    for (name, page) in &pages {
        for link in &page.links {
            problems
                .extend(broken(root, &pages, name, link).map(|why| format!("{}: link {link}: {why}", name.display())));
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
    let front = pages.get(Path::new("README.md"));
    let lines = front.map_or(0, |page| page.lines);
    if lines > FRONT_LINES {
        problems
            .push(format!("README.md: has {lines} lines, of which {FRONT_LINES} are allowed: move some to the book"));
    }
    let front = front.map(sentences).unwrap_or_default();
    for (name, page) in pages.iter().filter(|(name, _)| of_book(name)) {
        for twice in sentences(page).intersection(&front) {
            problems.push(format!("{}: a sentence stands in README.md as well: {twice}", name.display()));
        }
    }
    Ok(problems)
}

/// Why a link of the page `from` leads nowhere; `None` if it leads somewhere, or to another site.
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
        // Anchors are checked in pages of Markdown only, not in other files such as reports.
        None => None,
    }
}

/// A message for each page of the book that the summary does not list, or lists more than once.
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

    /// The problems of a repository with a README.md, a summary and two pages, of which the second has the text `page`.
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
            (&"Text.\n".repeat(FRONT_LINES + 1), summary, sound.into(), &format!("has {} lines", FRONT_LINES + 1)),
        ] {
            let found = problems_of(front, summary, &page);
            assert!(found.len() == 1 && found[0].contains(problem), "expected \"{problem}\", found {found:?}");
        }
    }
}
