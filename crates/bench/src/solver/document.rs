//! The report of the solver benchmark, made from its [`Results`]. All numbers of the report's findings (the sentences
//! that answer a section's question) are computed from the measurements. A case is a body with a stiffness and a time
//! step; a setting is a preconditioner with a tolerance.

use palpate::Result;
use serde_json::Value;

use super::cases::stiffness;
use super::peers::{ALLOWED_ERROR, PEERS, Peer, fastest};
use super::{Measured, PRECONDITIONERS, Results, Run, Size};
use crate::fit::exponent;
use crate::plot::{Line, Logarithmic, Panel, panels};
use crate::{Section, Table};

/// Greatest allowed exponent with which the time of a solver iteration grows with the number of tetrahedra.
const ALLOWED_EXPONENT: f64 = 1.05;
/// Greatest allowed GPU memory divided by the number of tetrahedra, bytes.
const ALLOWED_BYTES: f64 = 400.0;

/// Text that says how the benchmark was measured.
pub fn preface(settings: &Value) -> String {
    format!(
        "Bodies hang from a fixed rigid core under gravity, without contact, starting at rest (Poisson's ratio 0.45, \
         1000 kg/m^3, no damping). `ms` is the wall time of a step, from pose in to wrench out: the median over the \
         steps of a run, then the median over at most {} runs. `from` and `to` are the least and greatest median of \
         five or more runs or, with fewer than five runs, of five interleaved subsets of the steps. All settings run \
         alternately, a few steps at a time. `error` is the largest distance of a node after the last step from its \
         position after the same f64 steps solved directly, over the largest displacement.",
        settings["repetitions"]
    )
}

/// A section for each body, one for the comparison with other software and one for the growth with the size of the
/// mesh, as far as each was measured.
pub fn sections(results: &Results) -> Result<Vec<Section>> {
    let Results { cases, scaling } = results;
    let mut sections = Vec::new();
    for group in cases.chunk_by(|a, b| a.case.mesh == b.case.mesh) {
        sections.push(accuracy(group)?);
    }
    let compared: Vec<(Peer, &Measured)> =
        PEERS.into_iter().filter_map(|peer| peer.case(cases).map(|case| (peer, case))).collect();
    if !compared.is_empty() {
        sections.push(peers(&compared));
    }
    if !scaling.is_empty() {
        sections.push(growth(scaling)?);
    }
    Ok(sections)
}

/// A time in milliseconds, with about three digits.
fn ms(time: f64) -> String {
    match time {
        t if t < 10.0 => format!("{t:.2}"),
        t if t < 100.0 => format!("{t:.1}"),
        t => format!("{t:.0}"),
    }
}

fn setting(run: &Run) -> String {
    format!("{} to {:.0e}", run.preconditioner, run.tolerance)
}

/// The section on all cases of one body, with the displacement error against the time of a step.
fn accuracy(cases: &[Measured]) -> Result<Section> {
    let heads = ["case", "preconditioner", "tolerance", "ms", "from", "to", "iterations", "flagged steps", "error"];
    let mut table = Table::new(heads);
    let mut drawn = Vec::new();
    for case in cases {
        for run in &case.runs {
            table.rows.push(vec![
                case.case.label(),
                run.preconditioner.clone(),
                format!("{:.0e}", run.tolerance),
                ms(run.ms()),
                ms(run.range_ms()[0]),
                ms(run.range_ms()[1]),
                format!("{:.0}", run.median_iterations()),
                run.flagged.to_string(),
                format!("{:.1e}", run.error),
            ]);
        }
        let line = |&(name, _): &(&str, _)| Line {
            name: name.into(),
            points: case
                .runs
                .iter()
                .filter(|run| run.preconditioner == name)
                .map(|run| (run.ms(), run.error))
                .collect(),
            ..Line::default()
        };
        drawn.push(Panel { title: case.case.label(), lines: PRECONDITIONERS.iter().map(line).collect() });
    }
    let axes = Logarithmic { x: "ms a step", y: "displacement error", level: Some(ALLOWED_ERROR) };
    let Some(first) = cases.first() else { return Ok(Section::default()) };
    let name = first.case.mesh.name();
    Ok(Section {
        title: format!("Time against error: {}", name),
        question: format!(
            "What does a smaller error cost, and which preconditioner reaches it first? {} tetrahedra, {} nodes, {} \
             steps. In the plots, tolerances get smaller from top to bottom; the dashed line is an error of \
             {ALLOWED_ERROR:.0e}.",
            first.tetrahedra, first.nodes, first.case.steps
        ),
        table,
        plot: Some(panels(&axes, &drawn)?),
        finding: accuracy_finding(cases),
        ..Section::default()
    })
}

fn accuracy_finding(cases: &[Measured]) -> String {
    let best = |case: &Measured| match fastest(case) {
        Some(run) => {
            let iterations = run.median_iterations();
            format!("{} at {} ms ({}, {iterations:.0} iterations)", case.case.label(), ms(run.ms()), setting(run))
        }
        None => format!("{}: not reached by any setting", case.case.label()),
    };
    let all: Vec<String> = cases.iter().map(best).collect();
    let mut flags: Vec<&str> =
        cases.iter().flat_map(|case| &case.runs).flat_map(|run| &run.flags).map(String::as_str).collect();
    flags.sort_unstable();
    flags.dedup();
    let flags = if flags.is_empty() { String::new() } else { format!(" Flags were raised: {}.", flags.join(", ")) };
    format!("Fastest setting with an error of at most {ALLOWED_ERROR:.0e} and no flags: {}.{flags}", all.join("; "))
}

fn peers(compared: &[(Peer, &Measured)]) -> Section {
    let mut table = Table::new([
        "case",
        "Vega FEM ms",
        "MuJoCo ms",
        "palpate ms",
        "setting",
        "error",
        "Vega's time / palpate's",
        "faster one's time / palpate's",
        "goal for this ratio",
    ]);
    let mut met = Vec::new();
    for (peer, case) in compared {
        let run = fastest(case);
        let cell = |text: &dyn Fn(&Run) -> String| run.map_or_else(|| "none".into(), text);
        table.rows.push(vec![
            format!("{}, {}", case.case.mesh.name(), case.case.label()),
            ms(peer.vega_ms),
            peer.mujoco_ms.map_or_else(String::new, ms),
            cell(&|run| ms(run.ms())),
            cell(&setting),
            cell(&|run| format!("{:.1e}", run.error)),
            cell(&|run| format!("{:.2}", peer.vega_ms / run.ms())),
            cell(&|run| format!("{:.2}", peer.best_ms() / run.ms())),
            format!("{}", peer.goal),
        ]);
        met.push((run.map_or(0.0, |run| peer.best_ms() / run.ms()), peer, case));
    }
    let reached = met.iter().filter(|(factor, peer, _)| *factor >= peer.goal).count();
    let factor = |(factor, peer, case): &(f64, &Peer, &&Measured)| {
        format!("{} at {}: {factor:.2} (goal {})", case.case.mesh.name(), stiffness(case.case.young), peer.goal)
    };
    Section {
        title: "Other software on the same cases".into(),
        question: format!(
            "How many times as fast as other software is palpate's fastest setting whose displacement error is at \
             most {ALLOWED_ERROR:.0e}? Vega FEM 4.0 ran in f64 with Jacobi-preconditioned conjugate gradients to \
             1e-6, MuJoCo 4 in its fastest setting, both on another machine with two cores: their times are quoted, not measured here."
        ),
        table,
        plot: None,
        finding: format!(
            "{reached} of {} goals are reached (time of the faster of the two over palpate's): {}.",
            met.len(),
            met.iter().map(factor).collect::<Vec<_>>().join("; ")
        ),
        ..Section::default()
    }
}

fn growth(sizes: &[Size]) -> Result<Section> {
    let mut table = Table::new(["tetrahedra", "nodes"]);
    let Some(first) = sizes.first() else { return Ok(Section::default()) };
    for iteration in &first.iterations {
        let name = &iteration.preconditioner;
        table.heads.extend([
            format!("{name}: ms an iteration"),
            "ns a tetrahedron".into(),
            "bytes a tetrahedron".into(),
        ]);
    }
    for steps in &first.steps {
        table.heads.extend([format!("{}: ms a step", stiffness(steps.young)), "iterations".into()]);
    }
    for size in sizes {
        let mut row = vec![size.tetrahedra.to_string(), size.nodes.to_string()];
        let each = |x: f64| x / size.tetrahedra as f64;
        for iteration in &size.iterations {
            let (time, bytes) = (iteration.ms(), iteration.bytes_device as f64);
            row.extend([format!("{time:.3}"), format!("{:.1}", 1e6 * each(time)), format!("{:.0}", each(bytes))]);
        }
        for steps in &size.steps {
            row.extend([ms(steps.ms()), format!("{:.0}", steps.median_iterations())]);
        }
        table.rows.push(row);
    }
    let lines = growth_lines(sizes);
    let axes = Logarithmic { x: "tetrahedra", y: "ms", level: None };
    let panel = Panel { title: "Median time".into(), lines: lines.iter().map(|(line, _)| line.clone()).collect() };
    Ok(Section {
        title: "Growth with size".into(),
        question: "Does an iteration's time grow in proportion to the tetrahedra, and how much faster does the time \
                   of a step grow, which takes more iterations? Blocks of 0.1 m have ever smaller cells; steps are \
                   of 1 ms. The time of an iteration is the difference between steps of 32 and of 8 iterations, over \
                   24. A step is solved to the default tolerance by `preconditioner = \"auto\"`."
            .into(),
        table,
        plot: Some(panels(&axes, &[panel])?),
        finding: growth_finding(sizes, &lines),
        ..Section::default()
    })
}

/// Lines of times over the number of tetrahedra. The bool with each line is true if the line shows the time of a solver
/// iteration, false if it shows the time of a step.
fn growth_lines(sizes: &[Size]) -> Vec<(Line, bool)> {
    let Some(first) = sizes.first() else { return Vec::new() };
    let points = |time: &dyn Fn(&Size) -> f64| sizes.iter().map(|size| (size.tetrahedra as f64, time(size))).collect();
    let of_steps = first.steps.iter().enumerate().map(|(k, steps)| {
        let name = format!("step, {}", stiffness(steps.young));
        (
            Line {
                name,
                points: points(&|size| size.steps.get(k).map_or(f64::NAN, |steps| steps.ms())),
                ..Line::default()
            },
            false,
        )
    });
    let of_iterations = first.iterations.iter().enumerate().map(|(k, iteration)| {
        let name = format!("iteration, {}", iteration.preconditioner);
        (
            Line {
                name,
                points: points(&|size| size.iterations.get(k).map_or(f64::NAN, |it| it.ms())),
                ..Line::default()
            },
            true,
        )
    });
    of_steps.chain(of_iterations).collect()
}

fn growth_finding(sizes: &[Size], lines: &[(Line, bool)]) -> String {
    let (Some(first), Some(last)) = (sizes.first(), sizes.last()) else { return "nothing was measured.".into() };
    let power = |(line, is_bounded): &(Line, bool)| {
        let power = exponent(&line.points)?;
        let verdict = match (is_bounded, power <= ALLOWED_EXPONENT) {
            (false, _) => String::new(),
            (true, true) => format!(" (within the {ALLOWED_EXPONENT} allowed)"),
            (true, false) => format!(" (beyond the {ALLOWED_EXPONENT} allowed)"),
        };
        Some(format!("{} {power:.2}{verdict}", line.name))
    };
    let powers: Vec<String> = lines.iter().filter_map(power).collect();
    let bytes = |size: &Size| {
        let most = size.iterations.iter().map(|iteration| iteration.bytes_device).max().unwrap_or(0);
        most as f64 / size.tetrahedra as f64
    };
    let most = sizes.iter().map(bytes).fold(0.0, f64::max);
    let verdict = if most <= ALLOWED_BYTES { "within" } else { "beyond" };
    format!(
        "From {} to {} tetrahedra times grow with these powers of the number of tetrahedra: {}. At most {most:.0} \
         bytes on the device for each tetrahedron, {verdict} the {ALLOWED_BYTES} allowed.",
        first.tetrahedra,
        last.tetrahedra,
        powers.join(", ")
    )
}

#[cfg(test)]
#[path = "document_tests.rs"]
mod tests;
