//! The stability matrix (many stiff and extreme simulations, each with a verdict from invariants) as an image (SVG): a
//! row for each axis (varied quantity), and in the row a cell for each value of the quantity. A cell has a colour that
//! colour-blind readers can distinguish, and a letter for the worst verdict of the simulations with this value.

use std::fmt::Write;

use super::invariants::Verdict;
use super::{AxisResult, CellResult, Results};
use crate::page::escaped;

/// Width of the image in its own units, in which all lengths here are given; on the page the image is as wide as the
/// page.
const WIDTH: usize = 1240;
/// Width of the column with the names of the rows.
const NAMES: usize = 250;
/// Height of a row.
const ROW: usize = 66;
/// Approximate width of a letter of a label (text of a cell's value), in the image's units.
const LETTER: usize = 7;
/// Height of the legend above the first row.
const TOP: usize = 40;

const VERDICTS: [Verdict; 5] = [Verdict::Pass, Verdict::Degraded, Verdict::Fail, Verdict::Silent, Verdict::Refused];

/// Letter of a verdict, colour of its cells, and colour of the text on them (after Okabe and Ito 2008).
fn look(verdict: Verdict) -> (&'static str, &'static str, &'static str) {
    match verdict {
        Verdict::Pass => ("P", "#bfe3f7", "#000000"),
        Verdict::Degraded => ("D", "#f0e442", "#000000"),
        Verdict::Fail => ("F", "#c04f00", "#ffffff"),
        Verdict::Silent => ("S", "#000000", "#ffffff"),
        Verdict::Refused => ("R", "#d0d0d0", "#000000"),
    }
}

/// The image as SVG.
pub fn svg(results: &Results) -> String {
    let columns = results.axes.iter().map(|axis| axis.cells.len()).max().unwrap_or(1).max(1);
    let cell = ((WIDTH - NAMES) / columns).min(160);
    let height = TOP + ROW * results.axes.len() + 8;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" style=\"width: 100%; max-height: none\" viewBox=\"0 0 {WIDTH} {height}\" \
         font-family=\"sans-serif\" font-size=\"16\">\n<rect width=\"{WIDTH}\" height=\"{height}\" fill=\"#ffffff\"/>\n"
    );
    legend(&mut svg);
    for (k, axis) in results.axes.iter().enumerate() {
        row(&mut svg, axis, TOP + ROW * k, cell);
    }
    svg + "</svg>\n"
}

fn legend(svg: &mut String) {
    let mut x = NAMES;
    for verdict in VERDICTS {
        let (letter, fill, ink) = look(verdict);
        // Writing into a string cannot fail.
        let _ = writeln!(
            svg,
            "<rect x=\"{x}\" y=\"8\" width=\"22\" height=\"20\" fill=\"{fill}\" stroke=\"#555555\"/>\
             <text x=\"{}\" y=\"23\" text-anchor=\"middle\" font-weight=\"bold\" fill=\"{ink}\">{letter}</text>\
             <text x=\"{}\" y=\"23\">{}</text>",
            x + 11,
            x + 28,
            verdict.name()
        );
        x += 56 + 9 * verdict.name().len();
    }
    let _ = writeln!(
        svg,
        "<rect x=\"{x}\" y=\"8\" width=\"22\" height=\"20\" fill=\"none\" stroke=\"#000000\" stroke-width=\"2.5\"/>\
         <text x=\"{}\" y=\"23\">must pass</text>",
        x + 28
    );
}

fn row(svg: &mut String, axis: &AxisResult, y: usize, width: usize) {
    let title = escaped(&axis.title);
    let _ = writeln!(svg, "<text x=\"{}\" y=\"{}\" text-anchor=\"end\">{title}</text>", NAMES - 10, y + 35);
    for (k, cell) in axis.cells.iter().enumerate() {
        cell_at(svg, cell, NAMES + width * k, y, width);
    }
}

fn cell_at(svg: &mut String, cell: &CellResult, x: usize, y: usize, width: usize) {
    let (letter, fill, ink) = look(cell.verdict);
    let middle = x + width / 2;
    let (stroke, thick) = if cell.is_core { ("#000000", 2.5) } else { ("#888888", 0.8) };
    let inner = width - 5;
    // Writing into a string cannot fail.
    let _ = writeln!(
        svg,
        "<rect x=\"{}\" y=\"{}\" width=\"{inner}\" height=\"{}\" fill=\"{fill}\" stroke=\"{stroke}\" \
         stroke-width=\"{thick}\"/><text x=\"{middle}\" y=\"{}\" text-anchor=\"middle\" font-weight=\"bold\" \
         fill=\"{ink}\">{letter}</text>",
        x + 2,
        y + 2,
        ROW - 5,
        y + 18
    );
    for (k, line) in lines(&cell.label, inner / LETTER).into_iter().enumerate() {
        let _ = writeln!(
            svg,
            "<text x=\"{middle}\" y=\"{}\" text-anchor=\"middle\" font-size=\"14\" fill=\"{ink}\">{}</text>",
            y + 33 + 14 * k,
            escaped(&line)
        );
    }
}

/// Splits a label between words into lines of at most `most` letters; a longer word has a line of its own, and a number
/// stays on one line with its per cent sign.
fn lines(label: &str, most: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in label.split(' ') {
        match lines.last_mut() {
            Some(line) if word == "%" || word == "%)" || line.chars().count() + 1 + word.chars().count() <= most => {
                *line += " ";
                *line += word;
            }
            _ => lines.push(word.into()),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_label_is_cut_between_words() {
        assert_eq!(lines("stretched to 400 % (by 300 %)", 10), ["stretched", "to 400 %", "(by 300 %)"]);
        assert_eq!(lines("10 kPa", 10), ["10 kPa"]);
    }
}
