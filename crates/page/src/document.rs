//! A report of the benchmarks: for each question its plot, its table and its finding (the answer in words).

use std::fmt::Write;

/// A whole report; [`Document::html`] writes it as a page, [`Document::markdown`] as plain text.
#[derive(Debug, Clone, Default)]
pub struct Document {
    /// Heading of the report.
    pub title: String,
    /// Machine, program and date of the measurement, in words.
    pub preface: String,
    /// Chapters, one for each benchmark.
    pub chapters: Vec<Chapter>,
}

/// The questions of one benchmark.
#[derive(Debug, Clone, Default)]
pub struct Chapter {
    /// Heading of the chapter.
    pub title: String,
    /// How the benchmark was measured.
    pub preface: String,
    /// Sections, one for each question.
    pub sections: Vec<Section>,
}

/// One question and its answer.
#[derive(Debug, Clone, Default)]
pub struct Section {
    /// Heading of the section.
    pub title: String,
    /// The question, and the scenes that it is about.
    pub question: String,
    /// Measurements that answer the question.
    pub table: Table,
    /// A plot as SVG; `None`: there is none.
    pub plot: Option<String>,
    /// The answer to the question in one sentence, computed from the measurements.
    pub finding: String,
    /// Further remarks on the measurements.
    pub notes: Vec<String>,
}

/// A table of text cells. The first column is flush left; the others hold numbers and are flush right.
#[derive(Debug, Clone, Default)]
pub struct Table {
    /// Names of the columns, with units.
    pub heads: Vec<String>,
    /// Rows, with a cell for each column.
    pub rows: Vec<Vec<String>>,
}

impl Document {
    /// The report in Markdown, without the plots.
    pub fn markdown(&self) -> String {
        let mut text = format!("# {}\n\n{}\n", self.title, self.preface);
        for chapter in &self.chapters {
            // Writing into a string cannot fail.
            let _ = write!(text, "\n## {}\n\n{}\n", chapter.title, chapter.preface);
            for Section { title, question, table, finding, notes, .. } in &chapter.sections {
                let _ = write!(text, "\n### {title}\n\n{question}\n\n{}\n**Found:** {finding}\n", table.markdown());
                if !notes.is_empty() {
                    text.push('\n');
                }
                for note in notes {
                    let _ = writeln!(text, "- {note}");
                }
            }
        }
        text
    }
}

impl Table {
    /// An empty table whose columns have the names `heads`.
    pub fn new<S: Into<String>>(heads: impl IntoIterator<Item = S>) -> Table {
        Table { heads: heads.into_iter().map(Into::into).collect(), rows: Vec::new() }
    }

    /// The table in Markdown, with aligned columns.
    pub fn markdown(&self) -> String {
        let lines = || std::iter::once(&self.heads).chain(&self.rows);
        let width = |k: usize| lines().filter_map(|row| row.get(k)).map(|cell| cell.chars().count()).max().unwrap_or(0);
        let widths: Vec<usize> = (0..self.heads.len()).map(|k| width(k).max(2)).collect();
        let line = |row: &Vec<String>| {
            let cells = row.iter().zip(&widths).enumerate();
            let cells = cells.map(|(k, (cell, &w))| if k == 0 { format!("{cell:<w$}") } else { format!("{cell:>w$}") });
            format!("| {} |\n", cells.collect::<Vec<_>>().join(" | "))
        };
        let rule = widths.iter().enumerate().map(|(k, &w)| match k {
            0 => "-".repeat(w),
            _ => format!("{}:", "-".repeat(w - 1)),
        });
        let rule = format!("| {} |\n", rule.collect::<Vec<_>>().join(" | "));
        line(&self.heads) + &rule + &self.rows.iter().map(line).collect::<String>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_is_aligned() {
        let table = Table { rows: vec![vec!["a".into(), "12".into()]], ..Table::new(["name", "n"]) };
        let section = Section { title: "T".into(), table, finding: "So.".into(), ..Section::default() };
        let noted = Section { notes: vec!["And so.".into()], ..section.clone() };
        let chapter = Chapter { title: "C".into(), sections: vec![noted], ..Chapter::default() };
        let text = Document { chapters: vec![chapter], ..Document::default() }.markdown();
        assert!(text.ends_with("**Found:** So.\n\n- And so.\n"), "wrong report: {text}");
        let chapter = Chapter { title: "C".into(), sections: vec![section], ..Chapter::default() };
        let text = Document { chapters: vec![chapter], ..Document::default() }.markdown();
        assert!(text.contains("| name |  n |\n| ---- | -: |\n| a    | 12 |\n"), "wrong report: {text}");
        assert!(
            text.contains("## C") && text.contains("### T") && text.ends_with("**Found:** So.\n"),
            "wrong report: {text}"
        );
    }
}
