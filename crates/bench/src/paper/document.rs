//! The report of the paper benchmark, which measures the scenes of Galoppo and others (2007), made from its
//! [`Results`]. All numbers of the report's findings (the sentences that answer a section's question) are computed from
//! the measurements. The query is the part of a step that finds contacts: its stages from `pose` to `contact`. The loop
//! is the whole step. A soft body's layer is its tetrahedral mesh, its skin the surface mesh.

use palpate::Result;
use palpate::internal::stages::QUERY;
use serde_json::Value;

use super::{By, Grown, Ran, Results, SCENES, Times, Told};
use crate::fit::exponent;
use crate::plot::{Bar, Line, Logarithmic, Panel, bars, panels};
use crate::{Section, Table};

/// Stages of a step after the query.
const REST: [&str; 4] = ["elastic", "solve", "wrench", "fit"];

/// Columns of the tables that show how times grow with the contact area, the meshes or the number of bodies.
const COLUMNS: [&str; 10] = [
    "bodies",
    "skin vertices",
    "tetrahedra",
    "area cm^2",
    "contacts",
    "query ms",
    "solve ms",
    "loop ms",
    "iterations",
    "MB on the device",
];

/// Text that says how the benchmark was measured.
pub fn preface(settings: &Value) -> String {
    format!(
        "The paper (Galoppo and others 2007, a GeForce 7800) times the query alone, the part of a step that finds \
         contacts; here the whole loop is timed as well, from pose in to wrench out. Times are medians over steps \
         with contact, at most {} of each scene: the loop by wall time in steps without timestamps, stages and query \
         by the device's clock in other steps. Contacts are those of both skins; their area is projected on the \
         contact normals.",
        settings["steps"]
    )
}

/// A section for each part that was measured, and one section for the stages in the paper's scenes.
pub fn sections(results: &Results) -> Result<Vec<Section>> {
    let mut sections = Vec::new();
    if !results.scenes.is_empty() {
        sections.push(scenes(&results.scenes)?);
        sections.push(stages(&results.scenes)?);
    }
    for (by, rows) in results.growth.iter().filter(|(_, rows)| !rows.is_empty()) {
        sections.push(growth(*by, rows)?);
    }
    Ok(sections)
}

fn ms(time: f64) -> String {
    if time < 10.0 { format!("{time:.2}") } else { format!("{time:.1}") }
}

/// The time that the paper reports for a scene, and the time that palpate aims at; `None`: the scene is not one of the
/// paper's.
fn told(ran: &Ran) -> Option<&'static Told> {
    SCENES.iter().find(|told| told.name == ran.name)
}

fn scenes(all: &[Ran]) -> Result<Section> {
    let mut table = Table::new(["scene", "bodies", "skin vertices", "tetrahedra", "contacts", "area cm^2"]);
    table.heads.extend(["paper: query ms", "query ms", "goal: query ms", "loop ms", "iterations"].map(String::from));
    let mut drawn = Vec::new();
    for (ran, told) in all.iter().filter_map(|ran| Some((ran, told(ran)?))) {
        let times = &ran.times;
        let mut row = vec![ran.name.clone(), told.what.into(), ran.vertices.to_string(), ran.tetrahedra.to_string()];
        row.extend([format!("{:.0}", times.contacts()), format!("{:.2}", 1e4 * times.area())]);
        row.extend([told.paper_ms, times.query_ms(), told.goal_ms, times.step_ms()].map(ms));
        row.push(format!("{:.0}", times.iterations()));
        table.rows.push(row);
        let bar = |what: &str, length: f64, kind: usize| Bar { name: format!("{}: {what}", ran.name), length, kind };
        drawn.extend([bar("paper", told.paper_ms, 1), bar("palpate", times.query_ms(), 0)]);
    }
    Ok(Section {
        title: "The paper's table".into(),
        question:
            "How long do the paper's five scenes take: the query, as in the paper, and the whole loop, which the \
             paper does not report? The paper's times are upper bounds or approximate."
                .into(),
        table,
        plot: Some(bars("median time of the query, ms", &drawn)?),
        finding: scenes_finding(all),
        ..Section::default()
    })
}

fn scenes_finding(all: &[Ran]) -> String {
    let touching: Vec<(&Ran, &Told)> =
        all.iter().filter(|ran| ran.times.touching > 0).filter_map(|ran| Some((ran, told(ran)?))).collect();
    let over = |limit: fn(&Told) -> f64| {
        let slow = touching.iter().filter(|(ran, told)| ran.times.query_ms() > limit(told));
        let slow: Vec<String> =
            slow.map(|(ran, _)| format!("{} ({} ms)", ran.name, ms(ran.times.query_ms()))).collect();
        let rest = if slow.is_empty() { String::new() } else { format!(", not {}", slow.join(", ")) };
        format!("{} of {} scenes{rest}", touching.len() - slow.len(), touching.len())
    };
    let loops = touching.iter().map(|(ran, _)| format!("{} {} ms", ran.name, ms(ran.times.step_ms())));
    let mut flags: Vec<&str> = all.iter().flat_map(|ran| &ran.flags).map(String::as_str).collect();
    flags.sort_unstable();
    flags.dedup();
    let flags = if flags.is_empty() { String::new() } else { format!(" Flags were raised: {}.", flags.join(", ")) };
    let idle: Vec<&str> = all.iter().filter(|ran| ran.times.touching == 0).map(|ran| ran.name.as_str()).collect();
    let idle = if idle.is_empty() { String::new() } else { format!(" No bodies touched in {}.", idle.join(", ")) };
    format!(
        "The query takes no longer than the paper's in {}, and no longer than the goal in {}. The whole loop takes: \
         {}.{flags}{idle}",
        over(|told| told.paper_ms),
        over(|told| told.goal_ms),
        loops.collect::<Vec<_>>().join(", ")
    )
}

fn stages(all: &[Ran]) -> Result<Section> {
    let names: Vec<&str> = QUERY.into_iter().chain(REST).collect();
    let mut table = Table::new(["scene".to_string()].into_iter().chain(names.iter().map(|name| format!("{name} ms"))));
    table.heads.push("solve, % of all".into());
    for Ran { name, times, .. } in all {
        let each: Vec<Option<f64>> = names.iter().map(|stage| times.stage_ms(stage)).collect();
        let sum = each.iter().flatten().sum::<f64>();
        let share = times.stage_ms("solve").unwrap_or(0.0) / sum.max(f64::MIN_POSITIVE);
        let cells = each.into_iter().map(|time| time.map_or("-".into(), |time| format!("{time:.3}")));
        let cells = cells.chain([format!("{:.0}", 1e2 * share)]);
        table.rows.push([name.clone()].into_iter().chain(cells).collect());
    }
    let longest = all.iter().map(|ran| {
        let time = |stage: &str| ran.times.stage_ms(stage).unwrap_or(0.0);
        let most = names.iter().max_by(|a, b| time(a).total_cmp(&time(b)));
        format!("{}: {}", ran.name, most.copied().unwrap_or("none"))
    });
    Ok(Section {
        title: "Stage by stage".into(),
        question: "Where does the loop's time go? The time of each stage includes the cost of a timestamp, so that \
                   the stages together take more than the whole."
            .into(),
        table,
        plot: None,
        finding: format!("The longest stage of each scene is: {}.", longest.collect::<Vec<_>>().join("; ")),
        ..Section::default()
    })
}

fn solve_ms(times: &Times) -> f64 {
    times.stage_ms("solve").unwrap_or(0.0)
}

fn growth(by: By, rows: &[Grown]) -> Result<Section> {
    let x = |row: &Grown| match by {
        By::Area => 1e4 * row.times.area(),
        By::Skin => row.vertices as f64,
        By::Layer => row.tetrahedra as f64,
        By::Bodies => row.bodies as f64,
    };
    let (title, axis, question) = words(by);
    let mut table = Table::new(COLUMNS);
    for row in rows {
        let times = &row.times;
        let mut cells = vec![row.bodies.to_string(), row.vertices.to_string(), row.tetrahedra.to_string()];
        cells.extend([format!("{:.2}", 1e4 * times.area()), format!("{:.0}", times.contacts())]);
        cells.extend([times.query_ms(), solve_ms(times), times.step_ms()].map(ms));
        cells.extend([format!("{:.0}", times.iterations()), format!("{:.1}", 1e-6 * row.bytes_device as f64)]);
        table.rows.push(cells);
    }
    let line = |name: &str, time: &dyn Fn(&Times) -> f64| Line {
        name: name.into(),
        points: rows.iter().map(|row| (x(row), time(&row.times))).collect(),
        ..Line::default()
    };
    let drawn = vec![line("loop", &Times::step_ms), line("query", &Times::query_ms), line("solve", &solve_ms)];
    let ends = |of: &dyn Fn(&Grown) -> f64| [rows.first(), rows.last()].map(|row| row.map_or(0.0, of));
    let goes = |time: &dyn Fn(&Times) -> f64, line: &Line| {
        let [from, to] = ends(&|row| time(&row.times)).map(ms);
        let power = exponent(&line.points).map_or("too few rows for a power".into(), |p| format!("power {p:.2}"));
        format!("{from} to {to} ms ({power})")
    };
    let [from, to] = ends(&x).map(digits);
    let finding = format!(
        "From {from} to {to} ({axis}) the query's time goes from {}, the solver's from {}, the loop's from {}.",
        goes(&Times::query_ms, &drawn[1]),
        goes(&solve_ms, &drawn[2]),
        goes(&Times::step_ms, &drawn[0]),
    );
    let axes = Logarithmic { x: axis, y: "median time, ms", level: None };
    let panel = Panel { title: title.into(), lines: drawn };
    Ok(Section {
        title: title.into(),
        question: question.into(),
        table,
        plot: Some(panels(&axes, &[panel])?),
        finding,
        ..Section::default()
    })
}

/// A number rounded to three digits after the point.
fn digits(x: f64) -> f64 {
    (1e3 * x).round() / 1e3
}

/// Heading, label of the horizontal axis, and question of the section on growth with the quantity `by`.
fn words(by: By) -> (&'static str, &'static str, &'static str) {
    match by {
        By::Area => (
            "The loop against contact area",
            "contact area, cm^2",
            "What does a larger contact area cost the whole loop? Spheres of growing radius are pressed 4 mm into the \
             head's cheek and held there.",
        ),
        By::Skin => (
            "The loop against the skin's resolution",
            "skin vertices",
            "What does a finer skin cost the whole loop if the layer stays the same? A sphere of 10 mm radius is \
             pressed 4 mm into the head's cheek; a finer skin has more contacts under the same sphere.",
        ),
        By::Layer => (
            "The loop against the layer's resolution",
            "tetrahedra",
            "What does a finer layer cost the whole loop if the skin stays the same? A sphere of 10 mm radius is \
             pressed 4 mm into the head's cheek.",
        ),
        By::Bodies => (
            "The loop against the number of bodies",
            "bodies",
            "What do more bodies cost? Soft blocks of 750 tetrahedra lie side by side on the ground, each in contact with it.",
        ),
    }
}

#[cfg(test)]
#[path = "document_tests.rs"]
mod tests;
