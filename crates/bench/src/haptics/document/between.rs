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
    let mut table = Table::new(["E, kPa", "path", "rate, Hz", "loop", "peak, N"]);
    table.heads.extend(["off, %", "off, p95, %", "highest, %", "foretold off by, %"].map(Into::into));
    for run in all {
        let name = Mode::ALL.iter().find(|(mode, _)| *mode == run.mode).map_or("", |(_, name)| name);
        let mut row = vec![format!("{:.0}", 1e-3 * run.young), name_of(run.path), format!("{:.0}", run.rate)];
        row.extend([name.into(), format!("{:.2}", run.peak)]);
        row.extend([run.off[0], run.off[1], run.highest].map(percent));
        row.push(run.foretold.map_or_else(String::new, percent));
        table.rows.push(row);
    }
    Ok(Section {
        title: "What is felt between two steps".into(),
        question: format!(
            "A scripted device ({DEVICE}) presses the sphere into the cheek of the head of `touch-head.toml` and \
             releases it, or slides along it with friction of {FRICTION}. How far is the loop's contact force from \
             that of the same path at {REFERENCE:.0} steps a second? `off` is the difference over the greatest force: \
             the median over all ticks in which the device moves and something is felt, and the 95th percentile. \
             `highest` is the greatest force over that at {REFERENCE:.0} steps a second. `foretold off by` is the \
             median relative error of the change of force that the local model foretells from one step to the next. \
             The plot shows the median for the slow press."
        ),
        table,
        plot: (!all.is_empty()).then(|| plot(all)).transpose()?,
        finding: finding(all),
        ..Section::default()
    })
}

fn plot(all: &[Between]) -> Result<String> {
    let of = |mode: Mode, name: &str| Line {
        name: name.into(),
        points: all
            .iter()
            .filter(|run| run.mode == mode && run.rate < REFERENCE && Some(run.young) == all.first().map(|r| r.young))
            .filter(|run| Some(run.path) == all.first().map(|r| r.path))
            .map(|run| (run.rate, 1e2 * run.off[0]))
            .collect(),
        ..Line::default()
    };
    let axis = Axis { label: "rate of the simulation, Hz".into(), names: Vec::new() };
    lines(&axis, "off, %", &[of(Mode::Session, "session"), of(Mode::Raw, "raw")])
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
        let off = |mode: Mode| {
            let runs = slower().filter(|run| run.path == *path && run.mode == mode);
            range(runs.map(|run| run.off[0]), percent)
        };
        format!("{} {} % ({} % with the raw force)", name_of(*path), off(Mode::Session), off(Mode::Raw))
    };
    let paths: Vec<String> = paths.iter().map(of_path).collect();
    let told = range(all.iter().filter_map(|run| run.foretold), percent);
    let highest = range(slower().filter(|run| run.mode == Mode::Session).map(|run| run.highest), percent);
    format!(
        "Medians of the difference: {}. The greatest force is {highest} % of that at {REFERENCE:.0} steps a second. \
         The local model foretells the next step's change of force to {told} %.",
        paths.join("; ")
    )
}
