//! The report of the matrix: the picture, where the safe region of each axis ends, and every case that did not pass.

use super::laws::{Law, Verdict};
use super::{AxisResult, Judged, Results, heat_map, reasons};
use crate::bench::document::{Chapter, Document, Section, Table};
use crate::report::Flags;

/// The report.
pub fn document(results: &Results) -> Document {
    let count = |verdict: Verdict| results.cases().filter(|(_, _, case)| case.verdict == verdict).count();
    let preface = format!(
        "palpate {}, {} ({}), {} threads. {} cases in {:.0} s{}.",
        results.version,
        results.device,
        results.driver,
        results.threads,
        results.cases().count(),
        results.seconds,
        if results.settings.is_quick { ", the short form" } else { "" },
    );
    let method = "A block of 10 cm (162 tetrahedra, 20 kPa, nu 0.4, \
         1000 kg/m^3, steps of 1 ms) is let go from a face, pressed by a sphere of 4 cm and 50 g on a coupling of 500 N/m, \
         thrown at, torn or turned; one thing at a time is taken to its extreme. Each step is measured from outside in f64.";
    let finding = format!(
        "{} pass, {} are degraded, {} fail, {} of them without a flag; {} are refused.",
        count(Verdict::Pass),
        count(Verdict::Degraded),
        count(Verdict::Fail) + count(Verdict::Silent),
        count(Verdict::Silent),
        count(Verdict::Refused)
    );
    let matrix = Section {
        title: "The matrix".into(),
        question:
            "What becomes of each case? A cell shows the worst of its simulations. Pass: every law holds, and no \
                   flag was raised. Degraded: a flag was raised, and energy and force keep their bounds. Fail: they do \
                   not, and a flag says so. Silent failure: a law is broken in a step without a flag."
                .into(),
        table: laws(results),
        plot: Some(heat_map::svg(results)),
        finding,
        ..Section::default()
    };
    let sections = vec![matrix, safe(results), rest(results)];
    let chapter = Chapter { title: "Stability".into(), preface: method.into(), sections };
    Document { title: "Stability on stiff and extreme cases".into(), preface, chapters: vec![chapter] }
}

/// Each law, its bound, and how many cases it was held against.
fn laws(results: &Results) -> Table {
    let mut table = Table::new(["law", "bound", "cases"]);
    for (law, bound) in [
        (Law::Finite, "all that a step tells is a number"),
        (Law::Energy, "at most the start's and what was put in, within 1e-3 of what was turned over"),
        (Law::Force, "contact stiffness times depth, and damping times speed, over twice the sphere's cross-section"),
        (Law::Residual, "while nothing touches, b - A x in f64: 1e-3 of b or of weight, or f32's rounding"),
        (Law::Balance, "force, weight and coupling move the tool: within 1e-2 of the largest"),
        (
            Law::Rest,
            "kinetic energy falls as the slowest mode of the mesh does, or to 1e-4 of what was turned over; nothing is \
             promised where the case is too short for that mode",
        ),
        (Law::Drift, "what nothing moves stays within 1e-5 of its edge"),
        (Law::Shape, "what was stretched, pressed or turned inside out is back within a tenth of its edge"),
    ] {
        // Of these a case without a tool, or that always touches, measures nothing.
        let may_be_idle = matches!(law, Law::Force | Law::Residual | Law::Balance);
        let is_held = |judged: &Judged| {
            judged.findings.iter().any(|finding| finding.law == law && (!may_be_idle || finding.worst != 0.0))
        };
        let cases = results.cases().filter(|(_, _, case)| is_held(case)).count();
        table.rows.push(vec![law.name().into(), bound.into(), cases.to_string()]);
    }
    table
}

/// Where a region has no end.
const NOTHING: &str = "none";

fn safe(results: &Results) -> Section {
    let mut table = Table::new(["axis", "passes", "first beyond, below", "first beyond, above"]);
    let mut ends = Vec::new();
    for axis in &results.axes {
        let row = safe_row(axis);
        // Beyond both ends nothing was tried: it passes wherever it was.
        if row[2..] != [NOTHING, NOTHING] {
            ends.push(axis.title.to_lowercase());
        }
        table.rows.push(row);
    }
    let all = results.axes.len();
    let finding = match ends.len() {
        0 => format!("All values of all {all} axes pass."),
        count => format!("{} of {all} axes pass over all their values; {} do not.", all - count, ends.join(", ")),
    };
    Section {
        title: "Where the safe region ends".into(),
        question: "Between which values of each axis do all cases pass, and what comes first beyond?".into(),
        table,
        plot: None,
        finding,
        ..Section::default()
    }
}

/// The longest run of values that pass, and its neighbours.
fn safe_row(axis: &AxisResult) -> Vec<String> {
    let passes: Vec<bool> = axis.cells.iter().map(|cell| cell.verdict == Verdict::Pass).collect();
    let (mut best, mut first) = (0..0, 0);
    for k in 0..=passes.len() {
        if k == passes.len() || !passes[k] {
            if k - first > best.len() {
                best = first..k;
            }
            first = k + 1;
        }
    }
    let label = |k: usize| format!("{} ({})", axis.cells[k].label, axis.cells[k].verdict.name());
    let none = || NOTHING.to_string();
    if best.is_empty() {
        return vec![axis.title.clone(), none(), none(), axis.cells.first().map_or_else(none, |_| label(0))];
    }
    let (low, high) = (best.start, best.end - 1);
    let passing = match low == high {
        true => axis.cells[low].label.clone(),
        false => format!("{} to {}", axis.cells[low].label, axis.cells[high].label),
    };
    let below = if low > 0 { label(low - 1) } else { none() };
    let above = if high + 1 < passes.len() { label(high + 1) } else { none() };
    vec![axis.title.clone(), passing, below, above]
}

fn rest(results: &Results) -> Section {
    let mut table = Table::new(["case", "verdict", "flags", "law broken: worst, allowed, step", "why"]);
    for (axis, cell, case) in results.cases().filter(|(_, _, case)| case.verdict != Verdict::Pass) {
        let name = format!("{} {}, {}", axis.title, cell.label, case.scenario);
        let broken: Vec<String> = case.findings.iter().filter_map(|f| f.in_words()).collect();
        let broken = if broken.is_empty() { "none".into() } else { broken.join("; ") };
        let why = case.refusal.clone().unwrap_or_else(|| reasons::reason(axis, case));
        table.rows.push(vec![name, case.verdict.name().into(), flags(case), broken, why]);
    }
    Section {
        title: "What does not pass, and why".into(),
        question: "Which law is broken, by how much, from which step on, and what did the wrench say then?".into(),
        table,
        plot: None,
        finding: match results.faults().as_slice() {
            [] => "No failure is silent, and all that must pass passes.".into(),
            faults => format!("Not as it must be: {}.", faults.join("; ")),
        },
        ..Section::default()
    }
}

fn flags(case: &Judged) -> String {
    let names: Vec<&str> = Flags(case.flags).names().collect();
    match case.first_flagged {
        Some(step) => format!("{} in {} of {} steps, from {step}", names.join(", "), case.flagged, case.steps),
        None => "none".into(),
    }
}
