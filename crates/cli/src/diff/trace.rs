//! Compares two traces.

use std::f64::consts::PI;
use std::io::BufReader;
use std::path::Path;

use palpate::internal::files;
use palpate::{Error, Result};

use super::{Difference, Findings};

const REMEDY: &str = "give a trace.csv that `palpate run --out` wrote";
/// Times that count as the same, as a share of the last one.
const SAME: f64 = 1e-9;

/// A quantity of a trace.
struct Quantity {
    name: String,
    unit: &'static str,
    columns: Vec<String>,
    measure: Measure,
}

/// How a difference of a quantity is measured, and what it is told as a share of.
#[derive(Clone, Copy, PartialEq)]
enum Measure {
    /// A vector or a number, against its greatest value.
    Size,
    /// A position, against its greatest distance from where it began.
    Position,
    /// A rotation by its angle, against half a turn.
    Angle,
}

impl Quantity {
    /// The quantity whose first column has this name; `None` for other columns, and for what is not compared.
    fn beginning_with(column: &str) -> Option<Quantity> {
        let of = |prefix: &str, name: &str, unit, endings: &[&str], measure| {
            let columns = endings.iter().map(|ending| format!("{prefix}{ending}")).collect();
            Some(Quantity { name: format!("{prefix}{name}"), unit, columns, measure })
        };
        // Columns of a tool after the first begin with its name and a colon.
        let (tool, own) = column.rfind(':').map_or(("", column), |at| column.split_at(at + 1));
        match own {
            "contacts" => return of("contacts", "", "", &[""], Measure::Size),
            "max_depth_m" => return of("max_depth_m", "", "m", &[""], Measure::Size),
            "force_x" => return of(&format!("{tool}force"), "", "N", &["_x", "_y", "_z"], Measure::Size),
            "torque_x" => return of(&format!("{tool}torque"), "", "N m", &["_x", "_y", "_z"], Measure::Size),
            _ => {}
        }
        if let Some(prefix) = column.strip_suffix("_qx") {
            return of(prefix, " orientation", "rad", &["_qx", "_qy", "_qz", "_qw"], Measure::Angle);
        }
        if let Some(prefix) = column.strip_suffix("_fx") {
            return of(prefix, " force", "N", &["_fx", "_fy", "_fz"], Measure::Size);
        }
        if let Some(prefix) = column.strip_suffix("_tx") {
            return of(prefix, " torque", "N m", &["_tx", "_ty", "_tz"], Measure::Size);
        }
        of(column.strip_suffix("_x")?, " position", "m", &["_x", "_y", "_z"], Measure::Position)
    }
}

/// A trace, one vector of numbers for each column; NaN where a cell is empty.
struct Trace {
    names: Vec<String>,
    columns: Vec<Vec<f64>>,
}

impl Trace {
    fn read(path: &Path) -> Result<Trace> {
        let wrong =
            |line: Option<u64>, problem: String| Error::input(path, line.map(|line| line as usize), problem, REMEDY);
        let mut table = csv::Reader::from_reader(BufReader::new(files::open(path, REMEDY)?));
        let names: Vec<String> =
            table.headers().map_err(|error| wrong(None, error.to_string()))?.iter().map(Into::into).collect();
        if let Some((_, twice)) = names.iter().enumerate().find(|(at, name)| names[..*at].contains(name)) {
            return Err(wrong(Some(1), format!("two columns are called \"{}\"", twice.escape_debug())));
        }
        let mut columns = vec![Vec::new(); names.len()];
        for row in table.records() {
            let row = row.map_err(|error| wrong(error.position().map(csv::Position::line), error.to_string()))?;
            for (cell, column) in row.iter().zip(&mut columns) {
                let number = if cell.is_empty() { Ok(f64::NAN) } else { cell.parse() };
                let line = row.position().map(csv::Position::line);
                column.push(number.map_err(|_| wrong(line, format!("\"{}\" is no number", cell.escape_debug())))?);
            }
        }
        let trace = Trace { names, columns };
        match trace.column("time_s") {
            Some(times @ [first, ..]) => {
                let last = times[times.len() - 1];
                match times.windows(2).position(|pair| pair[1] <= pair[0] || pair[1].is_nan()) {
                    Some(row) => {
                        Err(wrong(Some(row as u64 + 3), "has a time that is not later than the one before".into()))
                    }
                    None if first.is_finite() && last.is_finite() => Ok(trace),
                    None => Err(wrong(None, "has a time that is not finite".into())),
                }
            }
            _ => Err(wrong(None, "has no column time_s with a row".into())),
        }
    }

    fn column(&self, name: &str) -> Option<&[f64]> {
        self.names.iter().position(|other| other == name).map(|at| self.columns[at].as_slice())
    }

    /// Whether a quantity has no columns, or all their cells are empty.
    fn is_without(&self, quantity: &Quantity) -> bool {
        quantity.columns.iter().filter_map(|name| self.column(name)).flatten().all(|x| x.is_nan())
    }

    /// The columns of a quantity, if all their cells are filled.
    fn filled(&self, quantity: &Quantity) -> Option<Vec<&[f64]>> {
        let columns: Option<Vec<&[f64]>> = quantity.columns.iter().map(|name| self.column(name)).collect();
        columns.filter(|columns| columns.iter().flat_map(|column| column.iter()).all(|x| !x.is_nan()))
    }
}

/// Compares two traces at the times of the first one; between its own times the second one is interpolated.
pub fn compare(a: &Path, b: &Path, findings: &mut Findings) -> Result<Vec<Difference>> {
    let (first, second) = (Trace::read(a)?, Trace::read(b)?);
    let [Some(times), Some(others)] = [first.column("time_s"), second.column("time_s")] else { return Ok(Vec::new()) };
    let end = times[times.len() - 1].abs();
    let are_same = times.len() == others.len() && times.iter().zip(others).all(|(a, b)| (a - b).abs() <= SAME * end);
    let within = |time: f64| time >= others[0] - SAME * end && time <= others[others.len() - 1] + SAME * end;
    let steps: Vec<usize> = (0..times.len()).filter(|k| within(times[*k])).collect();
    if steps.is_empty() {
        return Err(Error::input(
            a,
            None,
            format!("has no time in common with {}", b.display()),
            "compare runs of the same time",
        ));
    }
    if !are_same {
        let counts = format!("{} and {} steps", times.len(), others.len());
        let compared = format!("{} times are compared, and the second trace is interpolated", steps.len());
        findings.notes.push(format!("the traces have {counts}; {compared}"));
    }
    // A step more or less is a matter of where the last one ends.
    let [one, two] = [times, others].map(|times| times[times.len() - 1]);
    let shorter = if one < two { times } else { others };
    let longest = shorter.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
    if (one - two).abs() > 1.5 * longest {
        findings.unmatched.push(format!("the traces end at {one:?} s and at {two:?} s"));
    }
    for (one, two, which) in [(&first, &second, "first"), (&second, &first, "second")] {
        for name in one.names.iter().filter(|name| !two.names.contains(name)) {
            findings.unmatched.push(format!("only the {which} trace has a column {name}"));
        }
    }
    let places: Vec<(usize, f64)> =
        steps.iter().map(|k| if are_same { (*k, 0.0) } else { place(others, times[*k]) }).collect();
    let mut all = Vec::new();
    for quantity in first.names.iter().filter_map(|name| Quantity::beginning_with(name)) {
        let (Some(one), Some(two)) = (first.filled(&quantity), second.filled(&quantity)) else {
            if !(first.is_without(&quantity) && second.is_without(&quantity)) {
                let name = &quantity.name;
                findings.unmatched.push(format!("{name}: a value is missing or no number; it is not compared"));
            }
            continue;
        };
        let start: Vec<f64> = one.iter().map(|column| column[steps[0]]).collect();
        let mut difference = Difference::new(quantity.name, quantity.unit);
        for (k, place) in steps.iter().zip(&places) {
            let at: Vec<f64> = one.iter().map(|column| column[*k]).collect();
            let other = interpolated(&two, *place, quantity.measure == Measure::Angle);
            let values = match quantity.measure {
                Measure::Size => (distance(&at, &other), norm(&at)),
                Measure::Position => (distance(&at, &other), distance(&at, &start)),
                Measure::Angle => (angle(&at, &other), PI),
            };
            difference.add(times[*k], [values].into_iter());
        }
        all.push(difference.done());
    }
    if are_same && let [Some(one), Some(two)] = [first.column("flags"), second.column("flags")] {
        let count = one.iter().zip(two).filter(|(a, b)| a != b).count();
        if count > 0 {
            findings.unmatched.push(format!("flags differ in {count} of {} steps", one.len()));
        }
    }
    Ok(all)
}

/// The interval of `times` that a time lies in, and how far along.
fn place(times: &[f64], time: f64) -> (usize, f64) {
    let after = times.partition_point(|other| *other <= time).clamp(1, times.len().max(2) - 1);
    match times.get(after) {
        Some(end) => (after - 1, ((time - times[after - 1]) / (end - times[after - 1])).clamp(0.0, 1.0)),
        None => (0, 0.0),
    }
}

fn interpolated(columns: &[&[f64]], (at, along): (usize, f64), is_rotation: bool) -> Vec<f64> {
    let row = |at: usize| columns.iter().map(|column| column[at.min(column.len() - 1)]).collect::<Vec<f64>>();
    let (a, b) = (row(at), row(at + 1));
    if along == 0.0 {
        return a;
    }
    // Opposite quaternions are the same rotation.
    let sign = if is_rotation && a.iter().zip(&b).map(|(a, b)| a * b).sum::<f64>() < 0.0 { -1.0 } else { 1.0 };
    a.iter().zip(&b).map(|(a, b)| (1.0 - along) * a + sign * along * b).collect()
}

fn norm(a: &[f64]) -> f64 {
    a.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

/// Angle between two rotations, rad, exact where they are the same.
fn angle(a: &[f64], b: &[f64]) -> f64 {
    let (a, b): (Vec<f64>, Vec<f64>) =
        (a.iter().map(|x| x / norm(a)).collect(), b.iter().map(|x| x / norm(b)).collect());
    let opposite: Vec<f64> = b.iter().map(|x| -x).collect();
    4.0 * (0.5 * distance(&a, &b).min(distance(&a, &opposite))).min(1.0).asin()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn files(texts: [&str; 2]) -> (tempfile::TempDir, [std::path::PathBuf; 2]) {
        let folder = tempfile::tempdir().unwrap();
        let paths = ["a.csv", "b.csv"].map(|name| folder.path().join(name));
        paths.iter().zip(texts).for_each(|(path, text)| std::fs::write(path, text).unwrap());
        (folder, paths)
    }

    fn compared(a: &str, b: &str) -> (Vec<Difference>, Vec<String>) {
        let (_folder, [a, b]) = files([a, b]);
        let mut findings = Findings::default();
        let all = compare(&a, &b, &mut findings).unwrap();
        (all, findings.notes.into_iter().chain(findings.unmatched).collect())
    }

    #[test]
    fn columns_of_further_tools_are_those_of_the_first_with_a_name() {
        let head = "step,time_s,right:tool_x,right:tool_y,right:tool_z,right:force_x,right:force_y,right:force_z\n";
        let (all, _) = compared(&format!("{head}1,0.1,0,0,0,3,0,4\n"), &format!("{head}1,0.1,0,0,0,3,1,4\n"));
        let told: Vec<_> = all.iter().map(|d| (d.quantity.as_str(), d.unit, d.greatest, d.of)).collect();
        assert_eq!(told, [("right:tool position", "m", 0.0, 1e-6), ("right:force", "N", 1.0, 5.0)]);
    }

    const HEAD: &str = "step,time_s,force_x,force_y,force_z,tool_qx,tool_qy,tool_qz,tool_qw,contacts,flags,step_us\n";

    #[test]
    fn vectors_differ_as_a_whole_and_rotations_by_their_angle() {
        let a = format!("{HEAD}1,0.1,1,0,0,0,0,0,1,3,0,5\n2,0.2,0,4,3,0,0,0,1,4,0,6\n");
        let turn = 0.02f64;
        let (s, c) = (0.5 * turn).sin_cos();
        let b = format!("{HEAD}1,0.1,1,0,0,0,0,0,-1,3,0,7\n2,0.2,0,4.3,3.4,{s:?},0,0,{c:?},6,16,9\n");
        let (all, notes) = compared(&a, &b);
        let names: Vec<&str> = all.iter().map(|d| d.quantity.as_str()).collect();
        assert_eq!(names, ["force", "tool orientation", "contacts"]);
        assert!((all[0].greatest - 0.5).abs() < 1e-12 && all[0].of == 5.0 && all[0].time_s == 0.2);
        assert!((all[0].rms - 0.5 / 2f64.sqrt()).abs() < 1e-12 && (all[0].share() - 0.1).abs() < 1e-12);
        assert!((all[1].greatest - turn).abs() < 1e-12, "{}", all[1].greatest);
        assert_eq!((all[2].greatest, all[2].of), (2.0, 4.0));
        assert_eq!(notes, ["flags differ in 1 of 2 steps"]);
        let (all, notes) = compared(&a, &a);
        assert!(notes.is_empty() && all.iter().all(|d| d.greatest == 0.0 && d.share() == 0.0));
    }

    #[test]
    fn a_trace_of_other_steps_is_interpolated() {
        let a = "time_s,force_x,force_y,force_z\n0.1,1,0,0\n0.2,2,0,0\n0.3,3,0,0\n0.9,9,0,0\n";
        let b = "time_s,force_x,force_y,force_z\n0.05,0.5,0,0\n0.25,2.5,0,0\n0.35,3.5,1,0\n";
        let (all, notes) = compared(a, b);
        assert!((all[0].greatest - 0.5).abs() < 1e-12 && all[0].of == 3.0, "{:?}", all[0]);
        let interpolated = "the traces have 4 and 3 steps; 3 times are compared, and the second trace is interpolated";
        assert_eq!(notes, [interpolated, "the traces end at 0.9 s and at 0.35 s"]);
    }

    #[test]
    fn what_is_no_trace_is_refused_with_its_line() {
        for (text, wanted) in [
            ("time_s,force_x\n0.1,1\n0.2,one\n", "a.csv:3: \"one\" is no number"),
            ("time_s,force_x\n0.1,1\n0.2\n", "a.csv:3:"),
            ("step,force_x\n1,1\n", "has no column time_s with a row"),
            ("time_s\n", "has no column time_s with a row"),
            ("time_s\n0.1\n0.3\n0.2\n", "a.csv:4: has a time that is not later"),
            ("time_s\n0.1\nNaN\n0.2\n", "a.csv:3: has a time that is not later"),
            ("time_s\ninf\n", "has a time that is not finite"),
            ("", "has no column time_s with a row"),
        ] {
            let (_folder, [a, b]) = files([text, "time_s\n0.1\n"]);
            let said = compare(&a, &b, &mut Findings::default()).unwrap_err().to_string();
            assert!(said.contains(wanted), "{text:?}: {said}");
        }
    }
}
