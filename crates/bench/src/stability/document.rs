//! The report of the stability matrix: the heat map, where the safe range of each axis ends, and every case that did
//! not pass.

use palpate::Flags;

use super::invariants::{Invariant, Verdict};
use super::{AxisResult, CellResult, Judged, Results, heat_map, reasons};
use crate::document::{Chapter, Document, Section, Table};

/// The whole report.
pub fn document(results: &Results) -> Document {
    let count = |verdict: Verdict| results.cases().filter(|(_, _, case)| case.verdict == verdict).count();
    let preface = format!(
        "palpate {} (commit {}), {} ({}), {} threads. {} cases in {:.0} s{}.",
        results.version,
        results.commit,
        results.device,
        results.driver,
        results.threads,
        results.cases().count(),
        results.seconds,
        if results.settings.is_quick { ", the short form" } else { "" },
    );
    let method = "A block of 10 cm (162 tetrahedra, 20 kPa, nu 0.4, 1000 kg/m^3, steps of 1 ms) is let go from a face (hang), \
         pressed by a sphere of 4 cm and 50 g on a coupling of 500 N/m and 5 N s/m (press), stretched by a tenth and let go \
         free of weight (pluck), thrown at, thrust through, stretched, turned. One thing at a time is taken to its extreme; \
         what goes with it: size takes Young's modulus (as stiff for its weight), the sphere's size and mass and its coupling \
         along; gravity or its lack changes how far the block sags; a block stiffer than the usual is plucked by less, with \
         the same energy; thrust and teleport have a coupling a hundred times stiffer. Damping by mass is set to the frequency of the \
         slowest wave along the block's edge (70 1/s as it stands, 5e5 at 1 TPa), near to where nothing swings any more, in \
         hang, and in press but where it says undamped; undamped, pluck and spin have none but what implicit Euler takes. Each \
         step is measured from outside in f64.";
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
            "What becomes of each case? A cell shows the worst of its simulations. Pass: every invariant holds, and no \
                   flag was raised. Degraded: a flag was raised, and energy and force keep their invariants. Fail: they do \
                   not, and a flag says so. Silent failure: a invariant is broken in a step none of whose flags says that it may \
                   be; any other flag excuses nothing."
                .into(),
        table: invariants(results),
        plot: Some(heat_map::svg(results)),
        finding,
        ..Section::default()
    };
    let sections = vec![matrix, safe(results), rest(results)];
    let chapter = Chapter { title: "Stability".into(), preface: method.into(), sections };
    Document { title: "Stability on stiff and extreme cases".into(), preface, chapters: vec![chapter] }
}

/// A table of the invariants (`Invariant`), with their bounds and the number of cases in which each was checked.
fn invariants(results: &Results) -> Table {
    let mut table = Table::new(["invariant", "bound", "cases"]);
    for (invariant, bound) in [
        (Invariant::Finite, "all reported numbers are finite"),
        (
            Invariant::Energy,
            "at most the initial energy plus the energy supplied, within 1e-3 of the energy turned over",
        ),
        (
            Invariant::Force,
            "the wrench is the sum of its contacts' area (k depth + d rate): within 1e-3, or f32's rounding",
        ),
        (Invariant::Push, "no contact pulls by more than the bound of `force`"),
        (Invariant::Residual, "b - A x in f64, contacts and tool included: 1e-3 of b or of weight, or f32's rounding"),
        (Invariant::Balance, "force, weight and coupling move the tool: within 1e-2 of the largest"),
        (
            Invariant::Rest,
            "over the last tenth kinetic energy is down as the slowest mode of the mesh has it, or to 1e-4 of the most that \
             the block had; nothing is promised where the case is too short for that mode",
        ),
        (
            Invariant::Drift,
            "a body that nothing pushes stays within 1e-5 of its edge; a plucked one has 1e-5 of its stretch per step \
             in addition",
        ),
        (
            Invariant::Shape,
            "over the last tenth every node is within a tenth of the edge of where it was, where rest is due",
        ),
        (Invariant::Touch, "contacts press in a case in which the tool or the floor should touch"),
        (Invariant::Parted, "over the last tenth nothing presses where the tool was drawn out or went through"),
    ] {
        // In a case without a tool these invariants have nothing to check, so that it does not count.
        let may_be_idle = matches!(invariant, Invariant::Force | Invariant::Push | Invariant::Balance);
        let has_tool =
            |judged: &Judged| judged.findings.iter().any(|f| f.invariant == Invariant::Balance && f.worst != 0.0);
        let is_held = |judged: &Judged| {
            judged.findings.iter().any(|finding| finding.invariant == invariant) && (!may_be_idle || has_tool(judged))
        };
        let cases = results.cases().filter(|(_, _, case)| is_held(case)).count();
        table.rows.push(vec![invariant.name().into(), bound.into(), cases.to_string()]);
    }
    table
}

/// Up to so many consecutive values are listed one by one; more are written as a range.
const LISTED: usize = 6;

fn safe(results: &Results) -> Section {
    let mut table = Table::new(["axis", "passes", "does not"]);
    let mut ends = Vec::new();
    for axis in &results.axes {
        let [passing, others] = [true, false].map(|is_pass| values(axis, is_pass));
        if !others.is_empty() {
            ends.push(axis.title.to_lowercase());
        }
        let or_none = |words: String| if words.is_empty() { "none".to_string() } else { words };
        table.rows.push(vec![axis.title.clone(), or_none(passing), or_none(others)]);
    }
    let all = results.axes.len();
    let finding = match ends.len() {
        0 => format!("All values of all {all} axes pass."),
        count => format!("{} of {all} axes pass at all their values; {} do not.", all - count, ends.join(", ")),
    };
    Section {
        title: "Where the safe region ends".into(),
        question:
            "At which values of each axis do all cases pass, of those that were tried? Between two nothing was tried."
                .into(),
        table,
        plot: None,
        finding,
        ..Section::default()
    }
}

/// The labels of the values that pass, or of those that do not with their verdicts; many consecutive ones are written
/// as a range.
fn values(axis: &AxisResult, is_pass: bool) -> String {
    let of = |cell: &CellResult| (cell.verdict == Verdict::Pass) == is_pass;
    let runs = axis.cells.chunk_by(|a, b| of(a) == of(b)).filter(|run| of(&run[0]));
    let words = |run: &[CellResult]| match (run, is_pass) {
        ([first, .., last], true) if run.len() > LISTED && !axis.is_listed => {
            format!("{} to {}, {} values", first.label, last.label, run.len())
        }
        (_, true) => run.iter().map(|cell| cell.label.clone()).collect::<Vec<_>>().join(", "),
        _ => {
            let each = run.iter().map(|cell| format!("{}: {}", cell.label, cell.verdict.name()));
            each.collect::<Vec<_>>().join(", ")
        }
    };
    runs.map(words).collect::<Vec<_>>().join("; ")
}

fn rest(results: &Results) -> Section {
    let mut table = Table::new(["case", "verdict", "flags", "invariant broken: worst, allowed, step", "why"]);
    for (axis, cell, case) in results.cases().filter(|(_, _, case)| case.verdict != Verdict::Pass) {
        let name = format!("{} {}, {}", axis.title, cell.label, case.scenario);
        let broken: Vec<String> = case.findings.iter().filter_map(|f| f.in_words()).collect();
        let broken = if broken.is_empty() { "none".into() } else { broken.join("; ") };
        let why = case.refusal.clone().unwrap_or_else(|| reasons::reason(axis, cell, case));
        table.rows.push(vec![name, case.verdict.name().into(), flags(case), broken, why]);
    }
    Section {
        title: "What does not pass, and why".into(),
        question: "Which invariant is broken, by how much, from which step on, and what did the wrench say then?"
            .into(),
        table,
        plot: None,
        finding: match results.faults().as_slice() {
            [] => "No failure is silent, and all that must pass passes.".into(),
            faults => format!("Requirements not met: {}.", faults.join("; ")),
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
