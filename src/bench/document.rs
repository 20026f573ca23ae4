//! A report: for each question the table, the plot, and what was found.

use std::fmt::Write;

/// A report in Markdown, readable as plain text.
#[derive(Debug, Clone, Default)]
pub struct Document {
    /// Heading.
    pub title: String,
    /// Where and how it was measured.
    pub preface: String,
    /// Its questions.
    pub sections: Vec<Section>,
}

/// A question and its answer.
#[derive(Debug, Clone, Default)]
pub struct Section {
    /// Heading.
    pub title: String,
    /// What was asked, and of what.
    pub question: String,
    /// What was measured.
    pub table: Table,
    /// File name and contents of a plot.
    pub plot: Option<(String, String)>,
    /// One sentence that the numbers say.
    pub finding: String,
}

/// Columns of text; the first is flush left, the others are numbers.
#[derive(Debug, Clone, Default)]
pub struct Table {
    /// Names of the columns, with units.
    pub heads: Vec<String>,
    /// A cell a column.
    pub rows: Vec<Vec<String>>,
}

impl Document {
    /// The report; plots are named where they lie beside it.
    pub fn markdown(&self, has_plots: bool) -> String {
        let mut text = format!("# {}\n\n{}\n", self.title, self.preface);
        for section in &self.sections {
            let Section { title, question, table, plot, finding } = section;
            // Writing into a string cannot fail.
            let _ = write!(text, "\n## {title}\n\n{question}\n\n{}\n", table.markdown());
            if let Some((file, _)) = plot.as_ref().filter(|_| has_plots) {
                let _ = write!(text, "![{title}]({file})\n\n");
            }
            let _ = writeln!(text, "**Found:** {finding}");
        }
        text
    }
}

impl Table {
    /// A table of such columns.
    pub fn new<S: Into<String>>(heads: impl IntoIterator<Item = S>) -> Table {
        Table { heads: heads.into_iter().map(Into::into).collect(), rows: Vec::new() }
    }

    fn markdown(&self) -> String {
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
    fn a_table_is_aligned_and_a_plot_is_named_where_it_is() {
        let table = Table { rows: vec![vec!["a".into(), "12".into()]], ..Table::new(["name", "n"]) };
        let plot = Some(("x.svg".to_string(), String::new()));
        let section = Section { title: "T".into(), table, plot, finding: "So.".into(), ..Section::default() };
        let document = Document { sections: vec![section], ..Document::default() };
        let text = document.markdown(true);
        assert!(text.contains("| name |  n |\n| ---- | -: |\n| a    | 12 |\n"), "{text}");
        assert!(text.contains("![T](x.svg)") && text.ends_with("**Found:** So.\n"), "{text}");
        assert!(!document.markdown(false).contains("x.svg"));
    }
}
