//! Writes a report as one HTML page, which contains the plots and needs no other files and no scripts. The page is laid
//! out for a screen 1280 pixels wide and for print.

use std::fmt::Write;

use super::{Document, Section, Table};

const STYLE: &str = include_str!("page.css");
/// A table cell with more characters than this that also contains a space counts as words, not as a number.
const LONGEST_NUMBER: usize = 20;
/// A table with at least this number of columns is set in smaller type.
const WIDE: usize = 11;

/// A whole page: `title` is plain text, `body` is what follows the heading, as HTML.
pub fn whole(title: &str, body: &str) -> String {
    let title = escaped(title);
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n<meta name=\"viewport\" \
         content=\"width=device-width, initial-scale=1\"/>\n<meta name=\"color-scheme\" content=\"light dark\"/>\n\
         <title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n<h1>{title}</h1>\n{body}</body>\n</html>\n"
    )
}

/// A plot as a figure in HTML, with a caption (plain text) unless the caption is empty. `svg` may begin with an XML
/// declaration.
pub fn figure(svg: &str, caption: &str) -> String {
    // The XML declaration before the `<svg>` element belongs in files only.
    let element = svg.find("<svg").map_or(svg, |at| &svg[at..]);
    let caption = if caption.is_empty() { String::new() } else { format!("<figcaption>{}</figcaption>", set(caption)) };
    format!("<figure>{element}{caption}</figure>\n")
}

impl Document {
    /// The report as an HTML page. Text between backquotes is set as code, as in Markdown.
    pub fn html(&self) -> String {
        let mut page = format!("<p class=\"preface\">{}</p>\n", set(&self.preface));
        self.write_contents(&mut page);
        for (number, chapter) in self.chapters.iter().enumerate() {
            // Writing into a string cannot fail.
            let _ = writeln!(
                page,
                "<h2 id=\"c{number}\">{}</h2>\n<p>{}</p>",
                escaped(&chapter.title),
                set(&chapter.preface)
            );
            for (k, section) in chapter.sections.iter().enumerate() {
                write_section(&mut page, section, &format!("c{number}s{k}"));
            }
        }
        whole(&self.title, &page)
    }

    fn write_contents(&self, page: &mut String) {
        let count: usize = self.chapters.iter().map(|chapter| chapter.sections.len()).sum();
        if count < 2 {
            return;
        }
        page.push_str("<nav><ol>\n");
        for (number, chapter) in self.chapters.iter().enumerate() {
            let _ = writeln!(page, "<li><a href=\"#c{number}\">{}</a>\n<ul>", escaped(&chapter.title));
            for (k, section) in chapter.sections.iter().enumerate() {
                let _ = writeln!(page, "<li><a href=\"#c{number}s{k}\">{}</a></li>", escaped(&section.title));
            }
            page.push_str("</ul></li>\n");
        }
        page.push_str("</ol></nav>\n");
    }
}

fn write_section(page: &mut String, section: &Section, id: &str) {
    let Section { title, question, table, plot, finding, notes } = section;
    let _ = writeln!(
        page,
        "<section id=\"{id}\">\n<h3>{}</h3>\n<p class=\"question\">{}</p>",
        escaped(title),
        set(question)
    );
    let _ = writeln!(page, "<p class=\"finding\"><b>Found:</b> {}</p>", set(finding));
    if let Some(svg) = plot {
        page.push_str(&figure(svg, ""));
    }
    if !notes.is_empty() {
        let notes: String = notes.iter().map(|note| format!("<li>{}</li>\n", set(note))).collect();
        let _ = writeln!(page, "<ul class=\"notes\">\n{notes}</ul>");
    }
    page.push_str(&self::table(table));
    page.push_str("</section>\n");
}

/// A table as HTML; empty if the table has no rows. The first column and columns of words are flush left. Text between
/// backquotes is set as code.
pub fn table(table: &Table) -> String {
    let mut page = String::new();
    if table.rows.is_empty() {
        return page;
    }
    let is_text: Vec<bool> = (0..table.heads.len()).map(|k| k == 0 || is_text(table, k)).collect();
    let row = |page: &mut String, cells: &[String], tag: &str| {
        page.push_str("<tr>");
        for (k, cell) in cells.iter().enumerate() {
            let class = if is_text.get(k) == Some(&true) { " class=\"text\"" } else { "" };
            let _ = write!(page, "<{tag}{class}>{}</{tag}>", set(cell));
        }
        page.push_str("</tr>\n");
    };
    let class = if table.heads.len() >= WIDE { " class=\"wide\"" } else { "" };
    let _ = write!(page, "<div class=\"table\"><table{class}>\n<thead>");
    row(&mut page, &table.heads, "th");
    page.push_str("</thead>\n<tbody>\n");
    table.rows.iter().for_each(|cells| row(&mut page, cells, "td"));
    page.push_str("</tbody>\n</table></div>\n");
    page
}

/// Whether a column holds words, which are set flush left; if not, it holds numbers.
fn is_text(table: &Table, column: usize) -> bool {
    let mut cells = table.rows.iter().filter_map(|row| row.get(column));
    cells.any(|cell| cell.chars().count() > LONGEST_NUMBER && cell.contains(' '))
}

/// Text with the characters escaped that have a meaning in HTML. Control characters other than line breaks and tabs,
/// which XML forbids, are shown as the replacement character.
pub fn escaped(text: &str) -> String {
    let is_forbidden = |c: char| c.is_control() && !matches!(c, '\n' | '\r' | '\t');
    let text = text.replace(is_forbidden, "\u{fffd}");
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Text escaped for HTML, with what is between backquotes set as code.
pub fn set(text: &str) -> String {
    // A no-break space keeps a number and its per cent sign on one line.
    let escaped = escaped(text).replace(" %", "\u{a0}%");
    let pieces: Vec<&str> = escaped.split('`').collect();
    // If the number of backquotes is odd, all of them are kept as characters.
    if pieces.len().is_multiple_of(2) {
        return escaped;
    }
    let piece = |(k, piece): (usize, &&str)| if k % 2 == 0 { (*piece).into() } else { format!("<code>{piece}</code>") };
    pieces.iter().enumerate().map(piece).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Chapter;

    #[test]
    fn a_page_has_everything_within_it() {
        let table = Table { rows: vec![vec!["a < b".into(), "12".into()]], ..Table::new(["name", "n"]) };
        let plot = Some("<?xml version=\"1.0\"?>\n<svg width=\"1\"></svg>".into());
        let (question, notes) = ("Is `x` so?".into(), vec!["Not > it.".into()]);
        let section = Section { title: "T & U".into(), question, table, plot, finding: "So.".into(), notes };
        let chapter = Chapter { title: "C".into(), preface: "How.".into(), sections: vec![section.clone(), section] };
        let page = Document { title: "R".into(), preface: "Where.".into(), chapters: vec![chapter] }.html();
        let parts = [
            "<td class=\"text\">a &lt; b</td><td>12</td>",
            "<code>x</code>",
            "T &amp; U",
            "<figure><svg width",
            "<li>Not &gt; it.</li>",
            "#c0s1",
            "Where.",
        ];
        assert!(parts.iter().all(|part| page.contains(part)), "page: {page}");
        assert!(!page.contains("<?xml") && !page.contains("<script") && !page.contains("href=\"http"), "page: {page}");
        assert_eq!(page.matches("<section").count(), page.matches("</section>").count());
    }

    #[test]
    fn an_odd_backquote_stands_for_itself() {
        assert_eq!((set("a ` b").as_str(), set("`a` & b").as_str()), ("a ` b", "<code>a</code> &amp; b"));
    }
}
