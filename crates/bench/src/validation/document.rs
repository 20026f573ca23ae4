//! The report of `palpate validate`: each published value with the values on ever finer meshes, and a plot of how their
//! difference from it falls.

use palpate::Result;

use super::series::{Convergence, GREATEST_BOUND, Level, Of, Quantity, Verdict};
use super::{CaseResult, Judged, Results};
use crate::document::{Chapter, Document, Section, Table};
use crate::plot::{self, Line, Logarithmic, Panel};

/// The whole report. Errors: a plot cannot be drawn.
pub fn document(results: &Results) -> Result<Document> {
    let preface = format!(
        "palpate {} (commit {}), {} ({}), {} threads. {} cases took {:.0} s{}.",
        results.version,
        results.commit,
        results.device,
        results.driver,
        results.threads,
        results.cases.len(),
        results.seconds,
        if results.settings.is_quick { ", in the quick form" } else { "" },
    );
    let mut sections = vec![overview(results)];
    for case in &results.cases {
        sections.push(section(case)?);
    }
    let method = format!(
        "Each quantity is computed on ever finer meshes, with shorter steps where time matters. Its limit is \
         extrapolated from the last two (Richardson 1911) with the order that theory gives; where the mesh is too \
         stiff, from what is proportional to stiffness, which is one over a deflection or the square of a frequency. \
         The limit is reproduced if its difference from the published value is at most the bound: what the limit has \
         moved since the level before, or a tenth of what was extrapolated, whichever is more; the rounding of the \
         published value; and what its model leaves out, as each section says. A bound above {} tells nothing and \
         counts as not reproduced, and so does a flag. Solutions that the mesh represents exactly are held to single \
         precision instead.",
        share(GREATEST_BOUND)
    );
    let chapter = Chapter { title: "Validation".into(), preface: method, sections };
    Ok(Document { title: "Validation by values that others published".into(), preface, chapters: vec![chapter] })
}

fn overview(results: &Results) -> Section {
    let mut table =
        Table::new(["case", "quantity", "published", "finest", "limit", "off by", "bound", "order", "reproduced"]);
    for case in &results.cases {
        for Judged { quantity, verdict } in &case.quantities {
            let value = |value: f64| with_unit(value, quantity.unit);
            let finest = quantity.levels.last().map_or(f64::NAN, |level| level.value);
            table.rows.push(vec![
                case.name.into(),
                quantity.name.clone(),
                value(quantity.published),
                value(finest),
                value(verdict.limit),
                share(verdict.error),
                share(verdict.bound),
                order(quantity, verdict),
                if verdict.is_reproduced { "yes" } else { "NO" }.into(),
            ]);
        }
        if let Some(failure) = &case.failure {
            let mut row = vec![case.name.into(), failure.clone()];
            row.resize(8, String::new());
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
        question:
            "Is each published value where refinement leads? `Finest` is the value on the finest mesh, `limit` the \
             extrapolated one; where the mesh represents the solution exactly, `limit` is the worst value of all."
                .into(),
        table,
        finding,
        ..Section::default()
    }
}

fn section(case: &CaseResult) -> Result<Section> {
    let mut table = Table::new(["mesh", "quantity", "value", "off by"]);
    for Judged { quantity, .. } in &case.quantities {
        for level in &quantity.levels {
            table.rows.push(vec![
                level.label.clone(),
                quantity.name.clone(),
                with_unit(level.value, quantity.unit),
                share((level.value - quantity.published) / quantity.published.abs()),
            ]);
        }
    }
    let about = case.case();
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
    let with_model = case.quantities.iter().filter(|judged| judged.quantity.model > 0.0);
    let models = with_model.map(|Judged { quantity, .. }| {
        format!("{}: the models may differ by {} ({}).", quantity.name, share(quantity.model), quantity.reason)
    });
    Ok(Section {
        title: about.title.into(),
        question: format!("{} Source: {}.", about.problem, about.source),
        table,
        plot: plot_of(case)?,
        finding,
        notes: models.collect(),
    })
}

/// The differences from the published value and from the limit against the size of a cell; `None` where the mesh
/// represents the solution exactly.
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
        let point = |level: &Level| (level.size, ((level.value - target) / target).abs());
        Line { name: name.into(), points: quantity.levels.iter().map(point).collect(), ..Line::default() }
    };
    let lines = vec![from("published", quantity.published), from("limit", verdict.limit)];
    Panel { title: quantity.name.clone(), lines }
}

fn order(quantity: &Quantity, verdict: &Verdict) -> String {
    match (quantity.convergence, verdict.order) {
        (Convergence::Exact(_), _) => "exact".into(),
        (Convergence::Order(expected, of), found) => {
            let found = found.map_or("none".into(), |order| format!("{order:.1}"));
            let of = match of {
                Of::Value => "",
                Of::Reciprocal => " of 1/u",
                Of::ReciprocalRoot => " of u^-1/2",
                Of::Square => " of f^2",
            };
            format!("{found} ({expected}{of})")
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
