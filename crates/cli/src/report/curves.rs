//! The curves of a run over time, reduced to what a plot can show. The *tool* is the rigid body that the haptic device
//! leads; *indentation* is the distance that the tool's centre has moved since the step of first touch, along minus the
//! direction of the peak force. The curves are read from `trace.csv`, which has a row for each step, since the
//! direction of the peak force is known only at the end of the run, and all steps of a long run do not fit into memory.

use std::io::Read;

use glam::DVec3;
use palpate_page::Reduced;
use serde::Deserialize;

use super::felt::Touch;

/// Index in [`Curves`] of the contact force on the tool, N.
pub const FORCE: usize = 0;
/// Index of the indentation, mm, which has values from the first touch on.
pub const INDENTATION: usize = 1;
/// Index of the number of contacts in the scene.
pub const CONTACTS: usize = 2;
/// Index of the number of iterations of the solver.
pub const ITERATIONS: usize = 3;

/// Four quantities over the steps of a run: force on the tool (N), indentation (mm), number of contacts in the scene,
/// and number of iterations of the solver.
pub type Curves = Reduced<4>;

/// The columns of `trace.csv` from which the curves are made.
#[derive(Deserialize)]
struct Row {
    time_s: f64,
    tool_x: Option<f64>,
    tool_y: Option<f64>,
    tool_z: Option<f64>,
    force_x: Option<f64>,
    force_y: Option<f64>,
    force_z: Option<f64>,
    contacts: Option<u32>,
    iterations: u32,
}

/// Reads the curves from the text of `trace.csv`; `touch` is what the tool felt, if there is a tool.
pub fn read(trace: impl Read, touch: Option<&Touch>) -> Result<Curves, csv::Error> {
    let mut curves = Curves::default();
    let vector = |x: Option<f64>, y: Option<f64>, z: Option<f64>| Some(DVec3::new(x?, y?, z?));
    for row in csv::Reader::from_reader(trace).deserialize() {
        let row: Row = row?;
        let force = vector(row.force_x, row.force_y, row.force_z).map_or(f64::NAN, |force| force.length());
        let has_touched = touch.and_then(|touch| touch.first).is_some_and(|(time, _)| row.time_s >= time);
        let centre = vector(row.tool_x, row.tool_y, row.tool_z).filter(|_| has_touched);
        let indentation = centre.zip(touch).and_then(|(centre, touch)| touch.indentation(centre));
        let contacts = row.contacts.map_or(f64::NAN, f64::from);
        let indentation = indentation.map_or(f64::NAN, |depth| 1e3 * depth);
        curves.add(row.time_s, [force, indentation, contacts, row.iterations.into()]);
    }
    Ok(curves)
}

/// Reads the contact force (N) over time (s) on a tool after the first from the text of `trace.csv`.
pub fn read_force(trace: impl Read, tool: &str) -> Result<Reduced<1>, csv::Error> {
    let mut reader = csv::Reader::from_reader(trace);
    let heads = reader.headers()?.clone();
    let column = |name: &str| heads.iter().position(|head| head == name);
    let number = |row: &csv::StringRecord, at: Option<usize>| {
        at.and_then(|at| row.get(at)).and_then(|cell| cell.parse().ok()).unwrap_or(f64::NAN)
    };
    let time = column("time_s");
    let force = ["x", "y", "z"].map(|axis| column(&format!("{tool}:force_{axis}")));
    let mut curve = Reduced::default();
    for row in reader.records() {
        let row = row?;
        curve.add(number(&row, time), [DVec3::from(force.map(|at| number(&row, at))).length()]);
    }
    Ok(curve)
}

#[cfg(test)]
mod tests {
    use palpate::{Pose, StepReport, ToolReport};

    use super::super::{Names, Trace};
    use super::*;

    #[test]
    fn what_a_trace_says_is_what_is_drawn() {
        let (mut bytes, mut touch) = (Vec::new(), Touch::default());
        let mut trace = Trace::new(&mut bytes, &Names { probes: vec!["nose".into()], ..Names::default() }).unwrap();
        for (k, (y, force)) in [(0.05, 0.0), (0.04, 1.0), (0.035, 3.0), (0.03, f64::NAN)].into_iter().enumerate() {
            let tool = Pose { position: DVec3::Y * y, ..Pose::default() };
            let tool = ToolReport { tool, force: DVec3::Y * force, ..ToolReport::default() };
            let (step, contacts) = (k as u64 + 1, Some(k as u32));
            let (time, probes) = (step as f64, vec![DVec3::ONE]);
            let row =
                StepReport { step, time, tool: Some(tool), contacts, iterations: 9, probes, ..Default::default() };
            trace.write(&row).unwrap();
            touch.add(&row, &tool);
        }
        trace.finish().unwrap();
        let curves = read(bytes.as_slice(), Some(&touch)).unwrap();
        assert_eq!(curves.over_time(FORCE), [(1.0, 0.0), (2.0, 1.0), (3.0, 3.0)]);
        assert_eq!(curves.over_time(CONTACTS), [(1.0, 0.0), (2.0, 1.0), (3.0, 2.0), (4.0, 3.0)]);
        assert_eq!(curves.over_time(ITERATIONS)[3], (4.0, 9.0));
        let pressed = curves.over(INDENTATION, FORCE);
        assert!(
            pressed.len() == 2 && pressed[0] == (0.0, 1.0) && (pressed[1].0 - 5.0).abs() < 1e-12,
            "indentation in mm and force in N: two points expected, at 0 mm and 5 mm: {pressed:?}"
        );
        let (names, mut bytes_of_two) = (Names { further_tools: vec!["right".into()], ..Names::default() }, Vec::new());
        let mut trace = Trace::new(&mut bytes_of_two, &names).unwrap();
        for (step, force) in [(1, DVec3::new(3.0, 0.0, 4.0)), (2, DVec3::Y)] {
            let further_tools = vec![ToolReport { force, ..ToolReport::default() }];
            let (tool, time) = (Some(ToolReport::default()), step as f64);
            trace.write(&StepReport { step, time, tool, further_tools, ..Default::default() }).unwrap();
        }
        trace.finish().unwrap();
        let right = read_force(bytes_of_two.as_slice(), "right").unwrap();
        assert_eq!(right.over_time(0), [(1.0, 5.0), (2.0, 1.0)]);
        let without = read(bytes.as_slice(), None).unwrap();
        assert!(without.over_time(INDENTATION).is_empty());
    }
}
