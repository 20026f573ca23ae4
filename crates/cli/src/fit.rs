//! `palpate fit`: finds the values of a scene with which its simulated force agrees best with a measured curve.

use std::io::Write;
use std::path::PathBuf;

use clap::builder::NonEmptyStringValueParser;
use palpate::internal::files;
use palpate::{Context, Error, Options, Result, Threads};
use palpate_fit::{Abscissa, Fit, Free, Measured, Verdict, fit};
use palpate_page::page;
use palpate_page::plot::{Axis, Curve, Line, curve, lines};
use serde::Serialize;

use crate::print;
use crate::report::Output;

const RESULT: &str = "fit.json";
const CURVE: &str = "curve.csv";
const PAGE: &str = "report.html";

/// Options of `palpate fit`.
#[derive(clap::Args)]
#[command(after_help = "Exit status: 4 if no value fits or the fit does not converge; else 0")]
pub struct Arguments {
    /// The scene, a TOML file in which a tool presses into a body as in the measurement
    scene: PathBuf,
    /// The measured curve, a CSV file whose first line names the columns, with units: `time (s)` since the start of the
    /// scene or `indentation (mm)` since first touch, and `force (N)`
    #[arg(long, value_name = "FILE")]
    data: PathBuf,
    /// Key of a value to fit, such as body.material.young, and its bounds if wanted, as in
    /// contact.friction=0:1; several values: give the option again. The search begins at the scene's value
    #[arg(long, value_name = "KEY[=LOW:HIGH]", required = true, value_parser = free)]
    free: Vec<Free>,
    /// Vulkan device: its name, or its index in the list of `palpate devices`
    #[arg(long, value_name = "NAME-OR-INDEX", value_parser = NonEmptyStringValueParser::new())]
    device: Option<String>,
    /// Directory to write fit.json, curve.csv and report.html into; without it nothing is written
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// What `fit.json` holds.
#[derive(Serialize)]
struct Results<'a> {
    version: &'a str,
    scene: String,
    data: String,
    points: usize,
    flags: Vec<&'a str>,
    #[serde(flatten)]
    fit: &'a Fit,
}

fn free(text: &str) -> std::result::Result<Free, String> {
    let (key, bounds) = text.split_once('=').map_or((text, None), |(key, bounds)| (key, Some(bounds)));
    let number = |text: &str| text.trim().parse().ok().filter(|x: &f64| x.is_finite());
    let read = |bounds: &str| {
        let (low, high) = bounds.split_once(':')?;
        number(low).zip(number(high)).filter(|(low, high)| low < high)
    };
    match bounds.map(read) {
        None if !key.is_empty() => Ok(Free { key: key.into(), bounds: None }),
        Some(Some(bounds)) if !key.is_empty() => Ok(Free { key: key.into(), bounds: Some(bounds) }),
        _ => Err("give a key, or a key with bounds such as contact.friction=0:1".into()),
    }
}

/// Fits the values, prints them, and writes the report.
pub fn run(arguments: &Arguments) -> Result<()> {
    let Arguments { scene, data, .. } = arguments;
    // Read as a scene first: its messages name lines.
    palpate::Scene::load(scene)?;
    let tables = files::text(scene, "give a scene file")?
        .parse()
        .map_err(|error| Error::Usage(format!("{}: {error}", scene.display())))?;
    let measured = Measured::read(data)?;
    let output = arguments.out.as_deref().map(Output::create).transpose()?;
    output.as_ref().map_or(Ok(()), |output| output.reserve(&[RESULT, CURVE, PAGE]))?;
    let options = Options { device: arguments.device.clone(), threads: Some(Threads::Auto), ..Options::of_program() };
    let found = fit(scene.clone(), &tables, &measured, &arguments.free, &Context::open(&options)?)?;
    let words = words(&found, &measured);
    if let Some(mut output) = output {
        let results = Results {
            version: env!("CARGO_PKG_VERSION"),
            scene: scene.display().to_string(),
            data: data.display().to_string(),
            points: measured.points.len(),
            flags: found.flags.names().collect(),
            fit: &found,
        };
        output.write(RESULT, |w| serde_json::to_writer_pretty(w, &results).map_err(Into::into))?;
        output.write(CURVE, |w| write_curve(w, &found, &measured))?;
        let page = report(&words, &found, &measured)?;
        output.write(PAGE, |w| w.write_all(page.as_bytes()))?;
        output.commit()?;
    }
    print(&words)?;
    match found.verdict {
        Verdict::Fits | Verdict::OtherShape | Verdict::FewPoints | Verdict::AtBound => Ok(()),
        Verdict::NoValueFits => Err(Error::Simulation(
            "no value of these keys gives the measured curve; check scene, units and the beginning of the curve".into(),
        )),
        Verdict::NotConverged => Err(Error::Simulation(format!(
            "the fit did not converge in {} simulations; begin nearer, or give bounds",
            found.simulations
        ))),
    }
}

/// The result in words, a line for each value.
fn words(fit: &Fit, measured: &Measured) -> String {
    let mut text = String::new();
    for e in &fit.estimates {
        text += &format!(
            "{}: {:.5e}, standard error {:.1e} ({:.1} %), 95 % interval {:.4e} to {:.4e}; began at {:.4e}\n",
            e.key,
            e.value,
            e.standard_error,
            100.0 * (e.standard_error / e.value).abs(),
            e.interval[0],
            e.interval[1],
            e.initial
        );
    }
    for (i, row) in fit.correlation.iter().enumerate() {
        for (j, correlation) in row.iter().enumerate().take(i) {
            text +=
                &format!("correlation of {} and {}: {correlation:.2}\n", fit.estimates[j].key, fit.estimates[i].key);
        }
    }
    let share = 100.0 * fit.scatter / measured.peak();
    let verdict = match fit.verdict {
        Verdict::Fits => "What is left looks like noise.",
        Verdict::OtherShape => {
            "What is left has a pattern: the scene's curve has another shape than the measured one, and the intervals are \
             too narrow."
        }
        Verdict::NoValueFits => "No value fits: the scene's curve has another shape than the measured one.",
        Verdict::FewPoints => "There are too few points to tell whether what is left is noise.",
        Verdict::AtBound => "A value ended at one of its bounds; its interval is cut off there.",
        Verdict::NotConverged => "The fit did not converge.",
    };
    text += &format!(
        "{} points, {} simulations; scatter {:.3e} N ({share:.1} % of the greatest force). {verdict}\n",
        measured.points.len(),
        fit.simulations,
        fit.scatter
    );
    if fit.extrapolated > 0 {
        text += &format!(
            "{} points lie deeper than the fitted scene presses; its curve was extended there. Extend the keys of [drive].\n",
            fit.extrapolated
        );
    }
    if fit.flags != Default::default() {
        let names = fit.flags.names().collect::<Vec<_>>().join(", ");
        text += &format!("Steps of the fitted scene raised flags: {names}.\n");
    }
    text
}

fn write_curve(w: &mut dyn Write, fit: &Fit, measured: &Measured) -> std::io::Result<()> {
    let head = if measured.over == Abscissa::Time { "time (s)" } else { "indentation (m)" };
    writeln!(w, "{head},measured force (N),fitted force (N),residual (N)")?;
    for ((x, force), fitted) in measured.points.iter().zip(&fit.forces) {
        writeln!(w, "{x:?},{force:?},{fitted:?},{:?}", fitted - force)?;
    }
    Ok(())
}

/// A page with the result, both curves and the residuals.
fn report(words: &str, fit: &Fit, measured: &Measured) -> Result<String> {
    let (label, factor) = match measured.over {
        Abscissa::Time => ("time, s", 1.0),
        Abscissa::Indentation => ("indentation, mm", 1e3),
    };
    let mut rows: Vec<[f64; 3]> =
        measured.points.iter().zip(&fit.forces).map(|((x, force), fitted)| [factor * x, *force, *fitted]).collect();
    rows.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let line = |name: &str, column: usize| Line {
        name: name.into(),
        points: rows.iter().map(|row| (row[0], row[column])).collect(),
        ranges: Vec::new(),
    };
    let axis = Axis { label: label.into(), names: Vec::new() };
    let both = lines(&axis, "force, N", &[line("measured", 1), line("fitted", 2)])?;
    let residuals: Vec<(f64, f64)> = rows.iter().map(|row| (row[0], row[2] - row[1])).collect();
    let left = curve(&Curve { title: "Residuals", x: label, y: "residual, N", points: &residuals, mark: None })?;
    let mut body = String::new();
    for line in words.lines() {
        body += &format!("<p>{}</p>\n", page::escaped(line));
    }
    body += &page::figure(&both, "Measured and fitted force.");
    body += &page::figure(&left, "Residuals: fitted less measured force.");
    Ok(page::whole("Fit of a scene to a measured curve", &body))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn free_values_are_read_with_their_bounds() {
        let plain = Free { key: "body.material.young".into(), bounds: None };
        assert_eq!(free("body.material.young"), Ok(plain));
        assert_eq!(free("a.b=-1:2e3"), Ok(Free { key: "a.b".into(), bounds: Some((-1.0, 2e3)) }));
        for wrong in ["", "=1:2", "a=1", "a=2:1", "a=x:1", "a=1:inf"] {
            assert!(free(wrong).is_err(), "{wrong}");
        }
    }
}
