//! The measured curve: force over time or over indentation, read from a CSV file.

use std::path::Path;

use palpate::internal::files;
use palpate::{Error, Result};

/// What the force is measured over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Abscissa {
    /// Time since the beginning of the scene, s.
    Time,
    /// Indentation since first touch, m.
    Indentation,
}

/// A measured curve.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    /// What the force is measured over.
    pub over: Abscissa,
    /// Time (s) or indentation (m) and force (N) of each point.
    pub points: Vec<(f64, f64)>,
}

/// Names of columns in lower case, what they mean, and the factor that turns their unit into the engine's.
const ABSCISSAE: [(&str, Abscissa); 3] =
    [("time", Abscissa::Time), ("indentation", Abscissa::Indentation), ("depth", Abscissa::Indentation)];
const UNITS_OF_TIME: [(&str, f64); 2] = [("s", 1.0), ("ms", 1e-3)];
const UNITS_OF_LENGTH: [(&str, f64); 3] = [("m", 1.0), ("mm", 1e-3), ("um", 1e-6)];
const UNITS_OF_FORCE: [(&str, f64); 3] = [("n", 1.0), ("mn", 1e-3), ("kn", 1e3)];
/// What a file must look like, for messages.
const REMEDY: &str = "begin the file with a line such as `time (s),force (N)` or `indentation (mm),force (N)`";

impl Measured {
    /// Checks a curve that a program made.
    ///
    /// # Errors
    /// A number is not finite, or there are fewer than three points.
    pub fn of(over: Abscissa, points: Vec<(f64, f64)>) -> Result<Measured> {
        if points.len() < 3 {
            return Err(Error::Usage(format!("the measured curve has {} points; give three or more", points.len())));
        }
        match points.iter().position(|(x, force)| !(x.is_finite() && force.is_finite())) {
            Some(at) => Err(Error::Usage(format!("point {at} of the measured curve is not finite; leave it out"))),
            None => Ok(Measured { over, points }),
        }
    }

    /// Reads a CSV file. Its first line names the columns, with units in brackets: `time (s)` or `indentation (mm)`, and
    /// `force (N)`; other columns are ignored.
    ///
    /// # Errors
    /// The file cannot be read, lacks such a line or has two such columns, has a value that is no number, or times that go
    /// back.
    pub fn read(file: &Path) -> Result<Measured> {
        let wrong = |line: Option<usize>, problem: String| Error::input(file, line, problem, REMEDY);
        let bytes = files::bytes(file, files::MOST_TEXT, REMEDY)?;
        let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(bytes.as_slice());
        let heads = reader.headers().map_err(|error| wrong(Some(1), format!("cannot be read: {error}")))?.clone();
        let columns: Vec<(String, String)> = heads.iter().map(name_and_unit).collect();
        let is_used = |name: &str| name == "force" || ABSCISSAE.iter().any(|(known, _)| *known == name);
        for (at, (name, _)) in columns.iter().enumerate().filter(|(_, (name, _))| is_used(name)) {
            if columns[..at].iter().any(|(other, _)| other == name) {
                return Err(wrong(Some(1), format!("two columns are called {name}")));
            }
        }
        let abscissae: Vec<&str> =
            columns.iter().map(|(name, _)| name.as_str()).filter(|n| is_used(n) && *n != "force").collect();
        if let [one, other, ..] = abscissae[..] {
            return Err(wrong(
                Some(1),
                format!("the force may be over {one} or over {other}: leave one of the columns out"),
            ));
        }
        let find = |name: &str| columns.iter().position(|(head, _)| head == name);
        let Some((x, over)) = ABSCISSAE.iter().find_map(|(name, over)| Some((find(name)?, *over))) else {
            return Err(wrong(Some(1), "no column is called time, indentation or depth".into()));
        };
        let Some(force) = find("force") else { return Err(wrong(Some(1), "no column is called force".into())) };
        let units = if over == Abscissa::Time { &UNITS_OF_TIME[..] } else { &UNITS_OF_LENGTH[..] };
        let factor = |column: usize, units: &[(&str, f64)]| {
            let (name, unit) = &columns[column];
            let known = units.iter().find(|(known, _)| known == unit).map(|(_, factor)| *factor);
            known.ok_or_else(|| {
                let names = units.iter().map(|(unit, _)| *unit).collect::<Vec<_>>().join(", ");
                let unit = unit.escape_debug();
                wrong(Some(1), format!("the column {name} has the unit \"{unit}\", none of {names}"))
            })
        };
        let factors = [factor(x, units)?, factor(force, &UNITS_OF_FORCE)?];
        let mut points = Vec::new();
        for record in reader.records() {
            let record = record.map_err(|error| wrong(None, format!("cannot be read: {error}")))?;
            let line = record.position().map(|position| position.line() as usize);
            let number = |column: usize| {
                let text = record.get(column).unwrap_or_default();
                let number = text.parse().ok().filter(|number: &f64| number.is_finite());
                number.ok_or_else(|| {
                    let problem = format!("\"{}\" is no number", text.escape_debug());
                    Error::input(file, line, problem, "correct or remove the line")
                })
            };
            let point = (factors[0] * number(x)?, factors[1] * number(force)?);
            let is_back = points.last().is_some_and(|last: &(f64, f64)| point.0 < last.0);
            if over == Abscissa::Time && (point.0 < 0.0 || is_back) {
                let problem = format!("time {} is below zero, or before the one above", point.0);
                return Err(Error::input(file, line, problem, "give times in ascending order, from 0 s on"));
            }
            points.push(point);
        }
        Measured::of(over, points).map_err(|error| Error::input(file, None, error.to_string(), "measure more points"))
    }

    /// Greatest magnitude of the force, N.
    pub fn peak(&self) -> f64 {
        self.points.iter().fold(0.0, |peak, (_, force)| force.abs().max(peak))
    }
}

/// Name and unit of a column, in lower case, from a head such as `Force (N)` or `force_N`.
fn name_and_unit(head: &str) -> (String, String) {
    let head = head.to_lowercase();
    let (name, unit) = head.split_once(['(', '[', '_', ' ']).unwrap_or((&head, ""));
    (name.trim().into(), unit.trim_matches(|c: char| !c.is_alphanumeric()).into())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> std::result::Result<Measured, String> {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("curve.csv");
        std::fs::write(&file, text).unwrap();
        Measured::read(&file).map_err(|error| error.to_string())
    }

    #[test]
    fn columns_are_found_by_name_and_unit() {
        let rows = "0.5,1,9\n1,2,9\n1.5,4,9\n";
        let expected = vec![(0.5e-3, 1.0), (1e-3, 2.0), (1.5e-3, 4.0)];
        for head in ["indentation (mm),force (N),other", "Depth [mm], Force [N] ,x", "depth_mm,force_N,x"] {
            let curve = read(&format!("{head}\n{rows}")).unwrap();
            assert_eq!(curve, Measured { over: Abscissa::Indentation, points: expected.clone() }, "{head}");
        }
        let curve = read("force (mN),time (s)\n1000,0\n2000,1\n-5000,2\n").unwrap();
        assert_eq!((curve.over, curve.points[1], curve.peak()), (Abscissa::Time, (1.0, 2.0), 5.0));
    }

    #[test]
    fn mistakes_are_named_with_their_line() {
        for (text, part) in [
            ("a,b\n1,2\n", "no column is called time"),
            ("time (s),b\n1,2\n", "no column is called force"),
            ("time,force (N)\n1,2\n", "none of s, ms"),
            ("time (s),force (N)\n1,2\n2,x\n3,4\n", "curve.csv:3: \"x\" is no number"),
            ("time (s),force (N)\n1,2\n2,\"x\ny\"\n3,4\n", "curve.csv:3: \"x\\ny\" is no number"),
            ("time (s),force (N)\n1,2\n2,inf\n3,4\n", "curve.csv:3"),
            ("time (s),force (N)\n1,2\n2,3\n", "three or more"),
            ("time (s),force (N),force (N)\n1,2,2\n", "two columns are called force"),
            ("time (s),depth (mm),force (N)\n1,2,2\n", "over time or over depth"),
            ("time (s),force (N)\n1,2\n3,3\n2,3\n", "curve.csv:4: time 2"),
            ("time (s),force (N)\n-1,2\n3,3\n4,3\n", "curve.csv:2: time -1"),
        ] {
            let message = read(text).unwrap_err();
            assert!(message.contains(part), "{message}");
        }
        assert!(Measured::read(Path::new("none.csv")).unwrap_err().to_string().contains("cannot be read"));
        assert!(Measured::of(Abscissa::Time, vec![(0.0, f64::NAN); 3]).is_err());
    }
}
