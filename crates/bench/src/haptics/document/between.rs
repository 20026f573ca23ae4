//! The section of the haptics report about the force between two steps of the simulation.

use palpate::Result;

use super::range;
use crate::haptics::between::{DEVICE, FRICTION, Path, REFERENCE};
use crate::haptics::{Between, Mode};
use crate::plot::{Axis, Line, lines};
use crate::{Section, Table};

fn name_of(path: Path) -> String {
    match path {
        Path::Press(speed) => format!("press and release, {:.0} mm/s", 1e3 * speed),
        Path::Slide => "slide with friction".into(),
    }
}

fn percent(share: f64) -> String {
    format!("{:.1}", 1e2 * share)
}

/// The section about the force between steps.
pub fn between(all: &[Between]) -> Result<Section> {
    let mut table = Table::new(["place", "E, kPa", "path", "rate, Hz", "loop"]);
    table.heads.extend(["peak, N", "difference, %", "p95, %", "greatest, %", "prediction error, %"].map(Into::into));
    for run in all {
        let mut row = vec![run.place.name().into(), format!("{:.0}", 1e-3 * run.young), name_of(run.path)];
        row.push(format!("{:.0}", run.rate));
        row.extend([run.mode.name().into(), format!("{:.2}", run.peak)]);
        row.extend([run.difference[0], run.difference[1], run.greatest].map(percent));
        row.push(run.prediction_error.map_or_else(String::new, percent));
        table.rows.push(row);
    }
    Ok(Section {
        title: "What is felt between two steps".into(),
        question: format!(
            "A scripted device ({DEVICE}) presses the sphere into a soft body (cheek or forehead of the head of \
             `touch-head.toml`, the belly of a human, a block) and releases it, or slides along it with friction of \
             {FRICTION}. How far is the loop's contact force from \
             that of the same path at {REFERENCE:.0} steps a second? `difference` is over the greatest force: \
             the median over all ticks in which the device moves and something is felt, and the 95th percentile. \
             `greatest` is the greatest force over that at {REFERENCE:.0} steps a second. `prediction error` is the \
             median relative error of the change of force that the local model predicts from one step to the next. \
             The plot shows the median for the first body and path."
        ),
        table,
        plot: (!all.is_empty()).then(|| plot(all)).transpose()?,
        finding: finding(all),
        ..Section::default()
    })
}

fn plot(all: &[Between]) -> Result<String> {
    let first = |run: &Between| (run.place, run.young, run.path) == (all[0].place, all[0].young, all[0].path);
    let is_drawn = |run: &&Between| run.rate < REFERENCE && first(run);
    let of = |mode: Mode, name: &str| {
        let runs = all.iter().filter(is_drawn).filter(|run| run.mode == mode);
        let points = runs.map(|run| (run.rate, 1e2 * run.difference[0])).collect();
        Line { name: name.into(), points, ..Line::default() }
    };
    let axis = Axis { label: "rate of the simulation, Hz".into(), names: Vec::new() };
    lines(&axis, "difference, %", &[of(Mode::Session, "session"), of(Mode::Raw, "raw")])
}

fn finding(all: &[Between]) -> String {
    let slower = || all.iter().filter(|run| run.rate < REFERENCE);
    let paths = all.iter().fold(Vec::new(), |mut paths: Vec<Path>, run| {
        if !paths.contains(&run.path) {
            paths.push(run.path);
        }
        paths
    });
    let of_path = |path: &Path| {
        let difference = |mode: Mode| {
            let runs = slower().filter(|run| run.path == *path && run.mode == mode);
            range(runs.map(|run| run.difference[0]), percent)
        };
        format!("{} {} % ({} % with the raw force)", name_of(*path), difference(Mode::Session), difference(Mode::Raw))
    };
    let paths: Vec<String> = paths.iter().map(of_path).collect();
    let errors = range(all.iter().filter_map(|run| run.prediction_error), percent);
    let greatest = range(slower().filter(|run| run.mode == Mode::Session).map(|run| run.greatest), percent);
    format!(
        "Medians of the difference: {}. The greatest force is {greatest} % of that at {REFERENCE:.0} steps a second. \
         The local model predicts the next step's change of force to {errors} %.",
        paths.join("; ")
    )
}
