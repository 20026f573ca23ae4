//! The report of `palpate validate`: each published value with the values on ever finer meshes, and a plot of how their
//! difference from it falls.

use palpate::Result;

use super::series::{Convergence, Function, GREATEST_BOUND, Level, PRECISION, Quantity, Verdict};
use super::{CaseResult, Judged, Results};
use crate::document::{Chapter, Document, Section, Table};
use crate::plot::{self, Line, Logarithmic, Panel};

/// The whole report. Errors: a plot cannot be drawn.
pub fn document(results: &Results) -> Result<Document> {
    let preface = format!(
        "palpate {} (commit {}), {} ({}), {} threads. {} took {:.0} s{}.",
        results.version,
        results.commit,
        results.device,
        results.driver,
        results.threads,
        if results.cases.len() == 1 { "One case".into() } else { format!("{} cases", results.cases.len()) },
        results.seconds,
        if results.settings.is_quick { ", in the quick form" } else { "" },
    );
    let mut sections = vec![overview(results)];
    for case in &results.cases {
        sections.push(section(case)?);
    }
    let method = format!(
        "Each quantity is computed on ever finer meshes, with shorter steps where time matters. Its limit is \
         extrapolated from the last two (Richardson 1911) with the order of smooth solutions; where the mesh is too \
         stiff, from what is proportional to stiffness, which is one over a deflection or the square of a frequency. \
         The published value is reproduced if the limit differs from it by at most the bound, the sum of: the change \
         of the limit since the level before, twice that where the observed order is less than half or more than \
         twice that of theory, and at least a tenth of what was extrapolated; {PRECISION:e} for single precision and \
         the solver; the uncertainty of the published value, and that of its model, as each section says. Where a \
         model is known to differ, its difference is added to the published value first. A bound above {} tells \
         nothing and counts as not reproduced, and so does a flag. Solutions that the mesh represents exactly are \
         held to the bound of single precision on every level, and those of another program to that on the same \
         mesh.",
        share(GREATEST_BOUND)
    );
    let chapter = Chapter { title: "Validation".into(), preface: method, sections };
    Ok(Document { title: "Validation by values that others published".into(), preface, chapters: vec![chapter] })
}

fn overview(results: &Results) -> Section {
    let mut table = Table::new([
        "case",
        "quantity",
        "published",
        "expected",
        "finest",
        "limit",
        "off by",
        "bound",
        "order",
        "reproduced",
    ]);
    for case in &results.cases {
        for Judged { quantity, verdict } in &case.quantities {
            let value = |value: f64| with_unit(value, quantity.unit);
            let finest = quantity.levels.last().map_or(f64::NAN, |level| level.value);
            table.rows.push(vec![
                case.case.name.into(),
                quantity.name.clone(),
                value(quantity.published),
                value(verdict.expected),
                value(finest),
                value(verdict.limit),
                share(verdict.error),
                share(verdict.bound),
                order(quantity, verdict),
                if verdict.is_reproduced { "yes" } else { "NO" }.into(),
            ]);
        }
        if let Some(failure) = &case.failure {
            let mut row = vec![case.case.name.into(), failure.clone()];
            row.resize(9, String::new());
            row.push("NO".into());
            table.rows.push(row);
        }
    }
    let all = results.cases.iter().map(|case| case.quantities.len()).sum::<usize>();
    let finding = match results.faults().as_slice() {
        [] => format!("All {all} published values are reproduced."),
        faults => format!("Not reproduced: {}.", faults.join("; ")),
    };
    Section {
        title: "Overview".into(),
        question: "Is each published value where refinement leads? `Expected` is the published value with the known \
                   difference of its model, `finest` the value on the finest mesh, `limit` the extrapolated one; \
                   without refinement, `limit` is the worst value of all."
            .into(),
        table,
        finding,
        ..Section::default()
    }
}

fn section(case: &CaseResult) -> Result<Section> {
    let mut table = Table::new(["mesh", "quantity", "value", "off by"]);
    for Judged { quantity, verdict } in &case.quantities {
        for level in &quantity.levels {
            table.rows.push(vec![
                level.label.clone(),
                quantity.name.clone(),
                with_unit(level.value, quantity.unit),
                share((level.value - verdict.expected) / verdict.expected.abs()),
            ]);
        }
    }
    let verdicts = case.quantities.iter().map(|Judged { quantity, verdict }| {
        let end = if verdict.is_reproduced { "reproduced" } else { "NOT reproduced" };
        format!(
            "{}: {} published, limit {}, off by {} with a bound of {}, {end}",
            quantity.name,
            with_unit(quantity.published, quantity.unit),
            with_unit(verdict.limit, quantity.unit),
            share(verdict.error),
            share(verdict.bound)
        )
    });
    let finding = verdicts.chain(case.failure.clone()).collect::<Vec<_>>().join("; ") + ".";
    Ok(Section {
        title: case.case.title.into(),
        question: format!("{} Source: {}.", case.case.problem, case.case.source),
        table,
        plot: plot_of(case)?,
        finding,
        notes: notes(case),
    })
}

/// Of what each bound consists, what is known of the models, and how long the case took.
fn notes(case: &CaseResult) -> Vec<String> {
    let mut notes = Vec::new();
    for Judged { quantity, verdict } in &case.quantities {
        let parts = [
            (verdict.numerical, "discretisation and precision"),
            (quantity.uncertainty / verdict.expected.abs(), "the published value"),
            (quantity.model.uncertainty, "its model"),
        ];
        let parts = parts.iter().filter(|(part, _)| *part > 0.0).map(|(part, of)| format!("{} for {of}", share(*part)));
        notes.push(format!("Bound of {}: {}.", quantity.name, parts.collect::<Vec<_>>().join(", ")));
    }
    let mut reasons: Vec<&str> = case.quantities.iter().map(|judged| judged.quantity.model.reason).collect();
    reasons.dedup();
    notes.extend(reasons.iter().filter(|reason| !reason.is_empty()).map(|reason| format!("The model: {reason}.")));
    notes.push(format!("It took {:.0} s.", case.seconds));
    notes
}

/// The differences from the expected value and from the limit against the size of a cell; `None` without refinement.
fn plot_of(case: &CaseResult) -> Result<Option<String>> {
    let refined = case.quantities.iter().filter(|judged| matches!(judged.quantity.convergence, Convergence::Order(..)));
    let panels: Vec<Panel> = refined.map(panel).collect();
    if panels.is_empty() {
        return Ok(None);
    }
    let axes = Logarithmic { x: "size of a cell, relative", y: "relative difference", level: None };
    plot::panels(&axes, &panels).map(Some)
}

fn panel(Judged { quantity, verdict }: &Judged) -> Panel {
    let from = |name: &str, target: f64| {
        // Names stand at the last points, which are those of the coarsest level: there is room for them.
        let point = |level: &Level| (level.size, ((level.value - target) / target).abs());
        Line { name: name.into(), points: quantity.levels.iter().rev().map(point).collect(), ..Line::default() }
    };
    let lines = vec![from("expected", verdict.expected), from("limit", verdict.limit)];
    Panel { title: quantity.name.clone(), lines }
}

/// The observed order, and that of theory with the function that has it.
fn order(quantity: &Quantity, verdict: &Verdict) -> String {
    match quantity.convergence {
        Convergence::Exact(_) => "exact".into(),
        Convergence::SameMesh(_) => "same mesh".into(),
        Convergence::Order(expected, function) => {
            let found = verdict.order.map_or("none".into(), |order| format!("{order:.1}"));
            let function = match function {
                Function::Value => "",
                Function::Reciprocal => " of 1/u",
                Function::ReciprocalRoot => " of u^-1/2",
                Function::Square => " of f^2",
            };
            format!("{found} ({expected}{function})")
        }
    }
}

fn with_unit(value: f64, unit: &str) -> String {
    format!("{} {unit}", number(value)).trim_end().into()
}

/// A number with five significant digits.
pub fn number(value: f64) -> String {
    if value == 0.0 || !value.is_finite() || !(1e-3..1e5).contains(&value.abs()) {
        return format!("{value:.4e}");
    }
    let digits = (4 - value.abs().log10().floor() as i32).max(0) as usize;
    format!("{value:.digits$}")
}

/// A share in per cent with two significant digits, or with an exponent where it is tiny.
pub fn share(value: f64) -> String {
    match value.abs() {
        size if size < 1e-4 && size > 0.0 => format!("{value:.1e}"),
        size if size < 0.01 => format!("{:.2} %", 100.0 * value),
        _ => format!("{:.1} %", 100.0 * value),
    }
}
