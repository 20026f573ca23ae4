//! The report of the stability matrix, a set of many stiff and extreme simulations (the cases), each with a verdict
//! from invariants (conditions that every simulation must keep). An axis is a quantity that is varied; a cell is one of
//! its values, with its cases. A flag is the engine's report of a problem in a step. The report shows the verdicts of
//! all cells as a coloured table (heat map), the values of each axis at which all cases pass, and every case that did
//! not pass.

use palpate::Flags;

use super::invariants::{Invariant, Verdict};
use super::{AxisResult, CellResult, Judged, Results, heat_map, reasons};
use crate::document::{Chapter, Document, Section, Table};

/// The whole report.
pub fn document(results: &Results) -> Document {
    let count = |verdict: Verdict| results.cases().filter(|(_, _, case)| case.verdict == verdict).count();
    let preface = format!(
        "palpate {} (commit {}), {} ({}), {} threads. {} cases took {:.0} s{}.",
        results.version,
        results.commit,
        results.device,
        results.driver,
        results.threads,
        results.cases().count(),
        results.seconds,
        if results.settings.is_quick { ", in the short form" } else { "" },
    );
    let method = "A block of 10 cm (162 tetrahedra, 20 kPa, nu 0.4, 1000 kg/m^3, steps of 1 ms) is attached by a face \
                  and released (hang), pressed by a sphere of 4 cm diameter and 50 g on a coupling of 500 N/m and 5 N \
                  s/m (press), stretched by a tenth and released without weight (pluck), hit by a thrown sphere, \
                  thrust through, stretched, or spun. One quantity at a time is taken to its extremes. Some others \
                  change with it: Young's modulus, the sphere's size and mass and its coupling are scaled with the \
                  block's size, so that it is as stiff for its weight; gravity, or its lack, changes how far the \
                  block sags; a block stiffer than the default one is plucked by less, to the same energy; thrust and \
                  teleport have a coupling a hundred times as stiff. Damping by mass is set to the frequency of the \
                  slowest wave along the block's edge (70 1/s by default, 5e5 at 1 TPa), close to critical damping, \
                  in hang and in press; cases marked undamped, pluck and spin have no damping but that of implicit \
                  Euler. Each step is measured from outside the engine in f64.";
    let finding = format!(
        "{} cases pass, {} are degraded, {} fail, {} of them without a flag; {} are refused.",
        count(Verdict::Pass),
        count(Verdict::Degraded),
        count(Verdict::Fail) + count(Verdict::Silent),
        count(Verdict::Silent),
        count(Verdict::Refused)
    );
    let matrix = Section {
        title: "The matrix".into(),
        question: "What is the verdict on each case? A cell shows the worst verdict of its simulations. Pass: every \
                   invariant holds, and no flag was raised. Degraded: a flag was raised, but energy and force keep their \
                   invariants. Fail: they do not, and a flag warns of it. Silent failure: an invariant is broken in \
                   a step without a flag that warns of it; a flag that warns of something else does not count."
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
            "the energy is at most its initial value plus the energy supplied, within 1e-3 of the sum of all energies' \
             magnitudes",
        ),
        (
            Invariant::Force,
            "the wrench is the sum over contacts of area (stiffness * depth + damping * rate of depth): within 1e-3 of \
             the sum of all pushes, or f32's rounding",
        ),
        (Invariant::Push, "no contact pulls by more than the bound of `force`"),
        (
            Invariant::Residual,
            "the residual b - A x of the step's linear system, with contacts and tool, in f64: within 0.1 of b and \
             weight (0.2 with a preset), or f32's rounding",
        ),
        (
            Invariant::Balance,
            "the tool's momentum changes by the impulses of the reported force, weight and coupling: within 1e-2 of \
             the largest impulse (0.1 with a preset)",
        ),
        (
            Invariant::Peak,
            "with a preset, whose solver is loose: the greatest force on the tool is within 7 % of that with a tolerance \
             of 1e-6",
        ),
        (
            Invariant::Rest,
            "over the last tenth of the steps, kinetic energy has decayed as the slowest mode of the mesh does, or to \
             1e-4 of the body's greatest energy; nothing is promised if the case is too short for that mode",
        ),
        (
            Invariant::Balanced,
            "a loaded bar at rest: the sum of elastic force and weight on each node is within 1e-3 of the whole weight",
        ),
        (
            Invariant::Drift,
            "the centre of a body that nothing pushes moves by at most 1e-5 of the length of its edge; for a plucked \
             body, 1e-5 of its stretch is added for each step",
        ),
        (
            Invariant::Shape,
            "over the last tenth of the steps, each node is within a tenth of the block's edge of its rest position, \
             in cases that must come back to rest",
        ),
        (Invariant::Touch, "a contact presses in some step of a case in which the tool or the floor should touch"),
        (Invariant::Parted, "if the tool is to leave the block: over the last tenth of the steps, no contact presses"),
    ] {
        // In a case without a tool, the invariants of force, push and balance have nothing to check, so that the case
        // is not counted for them.
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

/// Greatest number of consecutive values that are listed one by one; more are written as a range.
const LISTED: usize = 6;

fn safe(results: &Results) -> Section {
    let mut table = Table::new(["axis", "values that pass", "values that do not"]);
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
        count => format!("{} of {all} axes pass at all their values; others do not: {}.", all - count, ends.join(", ")),
    };
    Section {
        title: "Where the safe region ends".into(),
        question:
            "At which of the tried values of each axis do all cases pass? No value between two neighbours was tried."
                .into(),
        table,
        plot: None,
        finding,
        ..Section::default()
    }
}

/// The labels of an axis's values as text: with `is_pass`, those of the values that pass, where many consecutive ones
/// are written as a range; otherwise those of the values that do not pass, each with its verdict.
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
        question: "Which invariant is broken, by how much, from which step on, and which flags did the step raise?"
            .into(),
        table,
        plot: None,
        finding: match results.faults().as_slice() {
            [] => "No failure is silent, no scene is refused, and all cases that must pass do.".into(),
            faults => format!("Requirements not met: {}.", faults.join("; ")),
        },
        ..Section::default()
    }
}

fn flags(case: &Judged) -> String {
    let names: Vec<&str> = Flags(case.flags).names().collect();
    match case.first_flagged {
        Some(step) => format!("{} in {} of {} steps, from step {step} on", names.join(", "), case.flagged, case.steps),
        None => "none".into(),
    }
}
