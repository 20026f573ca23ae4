//! The report of the accuracy curves (error and computing time of the settings of one varied value, the knob): for each
//! curve its table, its plot of one or more panels, and its finding (what the measurements show, in words). All numbers
//! of a finding are computed from the measurements.

use palpate::Result;
use serde_json::Value;

use super::curve::{DECADES, JUST_NOTICEABLE, NEAR_ORDER, SAME_ERROR};
use super::{Curve, Judged, Point, front, presets};
use crate::plot::{self, Logarithmic, Panel, panels};
use crate::{Section, Table};

/// Besides the cheapest setting, the finding names the most accurate one, but only if the error of the cheapest setting
/// is at least this factor times as large.
const WORTH_TELLING: f64 = 2.0;
/// Text of the report where a curve lacks a reason that the report asks for; no shipped curve should lack one.
const UNKNOWN: &str = "why is not known";

/// How the curves were measured, and what the columns of their tables mean.
pub fn preface(settings: &Value) -> String {
    let rounds = settings.get("rounds").and_then(Value::as_u64).unwrap_or(0);
    format!(
        "`ms` is the wall time of a step, from pose in to wrench out: the median over the steps of a run, then the \
         median over {rounds} runs of each setting. `from` and `to` are the least and greatest median of five or more \
         runs or, with fewer than five runs, of five interleaved subsets of the steps. The settings of a curve run \
         alternately, a few steps at a time, at most twelve settings at once. `error` is the largest difference \
         between the force on the tool and the reference's, over the reference's largest force; `shape` is the \
         corresponding error of the nodes' displacements. `*` marks the best buys among settings without a flag: no \
         other setting of the plot is as accurate and faster, or more accurate and as fast; differences count above 5 \
         %, and times only if all runs or subsets agree. The dashed line is {}, the smallest difference of a force \
         that a person notices.",
        percent(JUST_NOTICEABLE)
    )
}

/// A section for each curve, with the curve of this name among `earlier` results beside it; the section of the presets
/// (named settings of a scene) follows that of the curve from which they are chosen.
pub fn sections(curves: &[Curve], earlier: &[Curve]) -> Result<Vec<Section>> {
    let mut sections = Vec::new();
    for curve in curves {
        sections.push(section(curve, earlier.iter().find(|earlier| earlier.name == curve.name))?);
        if curve.name == front::NAME {
            sections.push(presets::section(curve));
        }
    }
    Ok(sections)
}

/// A curve's section: its table, plot and finding. The plot also shows the lines of an earlier curve, and a note
/// compares what accuracy costs in both.
pub fn section(curve: &Curve, before: Option<&Curve>) -> Result<Section> {
    let is_by_time = curve.points.iter().any(|point| point.simulated_s > 0.0);
    let x = if is_by_time { "computing time over simulated time" } else { "ms a step" };
    let axes = Logarithmic { x, y: "force error, %", level: Some(100.0 * JUST_NOTICEABLE) };
    let mut drawn: Vec<Panel> = Vec::new();
    let drawn_line = |line: super::Line, name: String| {
        let at = |point: &&Point| Some(((point.cost(), 100.0 * point.error()?), point.cost_range()));
        let (points, ranges) = line.points.iter().filter_map(at).unzip();
        (line.panel.to_string(), plot::Line { name, points, ranges })
    };
    let now = curve.lines().into_iter().map(|line| (line.name.to_string(), line));
    let earlier = before.into_iter().flat_map(Curve::lines).map(|line| (format!("{} before", line.name), line));
    for (panel, new) in now.chain(earlier).map(|(name, line)| drawn_line(line, name.trim().into())) {
        match drawn.iter_mut().find(|drawn| drawn.title == panel) {
            Some(drawn) => drawn.lines.push(new),
            None => drawn.push(Panel { title: panel, lines: vec![new] }),
        }
    }
    // A panel without errors above zero cannot be drawn on a logarithmic axis.
    drawn.retain(|panel| panel.lines.iter().any(|line| line.points.iter().any(|(_, error)| *error > 0.0)));
    let plot = if drawn.is_empty() { None } else { Some(panels(&axes, &drawn)?) };
    let (finding, mut notes) = finding(curve);
    notes.extend(before.and_then(|before| gain(curve, before)));
    Ok(Section {
        title: curve.title.clone(),
        question: curve.question.clone(),
        table: table(curve, is_by_time),
        plot,
        finding,
        notes,
    })
}

fn table(curve: &Curve, is_by_time: bool) -> Table {
    let stage = format!("ms of {}", curve.stage);
    let mut heads = vec!["setting", "ms", "from", "to", stage.as_str()];
    if is_by_time {
        heads.push("computing time / simulated time");
    }
    heads.extend(["iterations", "error", "shape", "flags", "best"]);
    let mut table = Table::new(heads);
    for (point, is_best) in curve.points.iter().zip(curve.best()) {
        let [low, high] = point.step_range_ms();
        let mut row = vec![point.setting.clone(), ms(point.step_ms()), ms(low), ms(high), ms(point.stage_ms())];
        if is_by_time {
            row.push(digits(point.cost()));
        }
        row.push(format!("{:.0}", point.iterations));
        row.extend([point.force_error, point.displacement_error].map(|error| error.map_or("none".into(), percent)));
        row.push(if point.flags.is_empty() { "-".into() } else { point.flags.join(", ") });
        row.push(if is_best { "*".into() } else { String::new() });
        table.rows.push(row);
    }
    table
}

/// The finding's sentence and the notes below it. The sentence is the verdict (whether the curve is within its bound)
/// if every setting is judged or the curve is beyond its bound; otherwise it says what accuracy costs, and the verdict
/// is a note.
fn finding(curve: &Curve) -> (String, Vec<String>) {
    let (verdict, bought) = (verdict(curve), bought(curve));
    let [first, second] = match (curve.judged, curve.is_within()) {
        (Judged::Every, _) => [verdict, String::new()],
        (_, true) => [bought, verdict],
        (_, false) => [verdict, bought],
    };
    let notes = [second, orders(curve), span(curve)];
    (first, notes.into_iter().filter(|text| !text.is_empty()).collect())
}

/// The verdict: whether the judged settings are within the bound of the curve, and how large their errors are.
fn verdict(curve: &Curve) -> String {
    let bound = percent(curve.bound);
    let of = |error: Option<f64>| error.map_or("no finite force".into(), percent);
    let beyond = curve.beyond();
    if beyond.is_empty() {
        let worst = curve.counted().into_iter().filter_map(|(_, error)| error).fold(0.0, f64::max);
        let who = match curve.judged {
            Judged::Finest => "The finest setting of each line",
            Judged::FinestOfPanel => "The finest setting of each plot",
            Judged::Every => "Every setting",
        };
        if curve.bound == 0.0 {
            return format!("{who} has the reference's force, bit for bit.");
        }
        return format!("{who} is within {bound} of the reference ({} at worst).", percent(worst));
    }
    let all: Vec<String> = beyond.iter().map(|(line, error)| format!("{} ({})", line.title(), of(*error))).collect();
    format!("NOT within {bound} of the reference: {}.", all.join("; "))
}

/// Name and verdict of each curve that is not within its bound.
pub fn faults(curves: &[Curve]) -> Vec<String> {
    let bad = curves.iter().filter(|curve| !curve.is_within());
    bad.map(|curve| format!("{}: {}", curve.name, verdict(curve).trim_end_matches('.'))).collect()
}

/// For each panel: the cheapest best buy (setting that no other beats in both error and cost) with an error below the
/// just noticeable difference, and how many times as much the most accurate best buy costs.
fn bought(curve: &Curve) -> String {
    let best = curve.best();
    let mut panels: Vec<&str> = curve.points.iter().map(|point| point.panel.as_str()).collect();
    panels.dedup();
    panels.retain(|panel| curve.beside.is_empty() || *panel != curve.beside);
    let one = |panel: &&str| {
        let own: Vec<(f64, &Point)> = curve
            .points
            .iter()
            .zip(&best)
            .filter(|(point, is_best)| point.panel == **panel && **is_best)
            .filter_map(|(point, _)| Some((point.error()?, point)))
            .collect();
        let unnoticed = own.iter().filter(|(error, _)| *error < JUST_NOTICEABLE);
        let cheapest = unnoticed.min_by(|a, b| a.1.cost().total_cmp(&b.1.cost()))?;
        let finest = own.iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
        let cheap =
            format!("{} at {} ms a step ({})", cheapest.1.setting, ms(cheapest.1.step_ms()), percent(cheapest.0));
        Some(if WORTH_TELLING * finest.0 > cheapest.0 {
            cheap
        } else {
            let times = digits(finest.1.cost() / cheapest.1.cost());
            format!("{cheap}, and {times} times its cost buys {} ({})", percent(finest.0), finest.1.setting)
        })
    };
    let all: Vec<String> = panels.iter().filter_map(one).collect();
    match all.is_empty() {
        true => format!("No setting without a flag has an error below {}.", percent(JUST_NOTICEABLE)),
        false => format!("Cheapest below {} without a flag: {}.", percent(JUST_NOTICEABLE), all.join("; ")),
    }
}

/// The fitted orders of convergence and the order that theory expects; where these differ, also the orders between
/// neighbouring points, and the reason that the curve gives.
fn orders(curve: &Curve) -> String {
    let Some(expected) = &curve.expected else { return shares(curve) };
    let mut others = Vec::new();
    let one = |line: &super::Line| {
        let order = line.order(expected.is_of_shape);
        if order.is_none_or(|(order, _)| (order - expected.order).abs() > NEAR_ORDER) {
            let all = line.local_orders(expected.is_of_shape);
            let all: Vec<String> = all.iter().map(|order| format!("{order:.1}")).collect();
            others.push(format!("{}{}", all.join(", "), named(line)));
        }
        match order {
            Some((order, count)) => format!("{order:.2}{} ({count} points)", named(line)),
            None => format!("cannot be fitted{}", named(line)),
        }
    };
    let all: Vec<String> = curve.lines().iter().map(one).collect();
    let as_expected = match others.is_empty() {
        true => ", which is close enough to the measured one".into(),
        false => format!("; from setting to setting it is {}: {}", others.join("; "), reason(&curve.order_reason)),
    };
    format!(
        "Order of convergence of the {}, by least squares of the logarithms over the finest settings above the floor, \
         where neighbours agree: {}; theory predicts {} ({}){as_expected}.",
        if expected.is_of_shape { "shape" } else { "force" },
        all.join(", "),
        expected.order,
        expected.law
    )
}

/// The share of the error that each unit of the knob leaves, for curves without a power law.
fn shares(curve: &Curve) -> String {
    if curve.share.is_empty() {
        return String::new();
    }
    let one = |line: &super::Line| {
        let share = line.share().map_or("cannot be fitted".into(), |(x, count)| format!("{x:.2} ({count} points)"));
        format!("{share}{}", named(line))
    };
    let all: Vec<String> = curve.lines().iter().map(one).collect();
    format!(
        "Each further unit of the knob leaves this share of the error: {}; theory predicts a constant factor, not a \
         power law: {}.",
        all.join(", "),
        curve.share
    )
}

/// What the accuracy of each best buy of earlier results costs now, as a share of what it cost then: for each panel the
/// least and the greatest share. `None`: the two have no panel with best buys in common.
fn gain(curve: &Curve, before: &Curve) -> Option<String> {
    let (now, then) = (curve.best(), before.best());
    let best = |curve: &'_ Curve, is_best: &[bool]| -> Vec<Point> {
        curve.points.iter().zip(is_best).filter(|(_, is_best)| **is_best).map(|(point, _)| point.clone()).collect()
    };
    let (now, then) = (best(curve, &now), best(before, &then));
    let mut panels: Vec<&str> = then.iter().map(|point| point.panel.as_str()).collect();
    panels.dedup();
    let one = |panel: &&str| {
        let as_accurate = |point: &&Point, error: f64| {
            point.panel == **panel && point.error().is_some_and(|own| (1.0 - SAME_ERROR) * own <= error)
        };
        let share = |old: &Point| {
            let error = old.error()?;
            let costs = now.iter().filter(|point| as_accurate(point, error)).map(Point::cost);
            Some(costs.fold(f64::INFINITY, f64::min) / old.cost())
        };
        let shares: Vec<f64> = then.iter().filter(|old| old.panel == **panel).filter_map(share).collect();
        let reached: Vec<f64> = shares.iter().copied().filter(|share| share.is_finite()).collect();
        let low = reached.iter().copied().fold(f64::INFINITY, f64::min);
        let high = reached.iter().copied().fold(0.0, f64::max);
        let missed = shares.len() - reached.len();
        let shares = (!reached.is_empty()).then(|| format!("{} to {}", digits(low), digits(high)));
        let least = (missed > 0).then(|| format!("not reached in {missed} of {}", reached.len() + missed));
        let told: Vec<String> = shares.into_iter().chain(least).collect();
        let title = if panel.is_empty() { String::new() } else { format!("{panel}: ") };
        (!told.is_empty()).then(|| format!("{title}{}", told.join(", ")))
    };
    let all: Vec<String> = panels.iter().filter_map(one).collect();
    let what = "The error of each best buy before costs now, as a share of its cost then";
    (!all.is_empty()).then(|| format!("{what}: {}.", all.join("; ")))
}

fn named(line: &super::Line) -> String {
    let title = line.title();
    if title.is_empty() { title } else { format!(" for {title}") }
}

fn span(curve: &Curve) -> String {
    let decades = curve.decades();
    // Where no setting is finer than another, no law predicts the errors: then the report always explains their span.
    if decades >= DECADES && curve.judged != Judged::Every {
        return String::new();
    }
    format!("The errors of a line span {decades:.1} powers of ten: {}.", reason(&curve.span_reason))
}

fn reason(known: &str) -> &str {
    if known.is_empty() { UNKNOWN } else { known }
}

/// A number such as a time in milliseconds, with about three digits.
pub(super) fn ms(time: f64) -> String {
    match time {
        t if t < 10.0 => format!("{t:.2}"),
        t if t < 100.0 => format!("{t:.1}"),
        t => format!("{t:.0}"),
    }
}

pub(super) fn digits(x: f64) -> String {
    if x < 0.01 { format!("{x:.0e}") } else { ms(x) }
}

/// A share of one as a percentage, with about two digits.
pub(super) fn percent(share: f64) -> String {
    match 100.0 * share {
        0.0 => "0 %".into(),
        x if x < 0.01 => format!("{x:.1e} %"),
        x if x < 1.0 => format!("{x:.2} %"),
        x if x < 10.0 => format!("{x:.1} %"),
        x => format!("{x:.0} %"),
    }
}

#[cfg(test)]
#[path = "document_tests.rs"]
mod tests;
