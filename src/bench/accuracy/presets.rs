//! The presets: which of all settings has each name, and whether the program ships it.

use super::document::{digits, ms, percent};
use super::{Curve, JUST_NOTICEABLE, Point};
use crate::bench::{Section, Table};
use crate::scene::preset::Preset;
use crate::scene::{self, Sides};

/// Names, and below which error the cheapest setting has each: what is just noticed, its half, its quarter.
pub const PRESETS: [(&str, f64); 3] =
    [("fast", JUST_NOTICEABLE), ("balanced", JUST_NOTICEABLE / 2.0), ("accurate", JUST_NOTICEABLE / 4.0)];
/// A shipped time step is the measured one within this factor: measured ones halve each other.
const SAME_STEP: f64 = 1.25;

/// The setting that has each preset's name: the cheapest of the best buys below its error.
pub fn presets(curve: &Curve) -> [(&'static str, f64, Option<&Point>); 3] {
    let best = curve.best();
    PRESETS.map(|(name, below)| {
        let fits = |point: &&Point| point.error().is_some_and(|error| error < below);
        let best = curve.points.iter().zip(&best).filter(|(_, is_best)| **is_best).map(|(point, _)| point);
        (name, below, best.filter(fits).min_by(|a, b| a.cost().total_cmp(&b.cost())))
    })
}

/// Whether what is shipped is as good as what was found: the measured setting that it is keeps the preset's error, without a
/// flag, and costs no more beyond noise. Else what is wrong.
fn disagreement(curve: &Curve, shipped: &Preset, below: f64, found: Option<&Point>) -> Option<String> {
    let Some(own) = curve.points.iter().find(|point| is_measured(shipped, point)) else {
        return Some("was not measured".into());
    };
    match own.error() {
        Some(error) if error < below && own.flags.is_empty() => {}
        error => return Some(format!("has an error of {}", error.map_or("no number".into(), percent))),
    }
    let found = found.filter(|found| found.is_cheaper(own))?;
    Some(format!("costs {} times what {} does", digits(own.cost() / found.cost()), found.setting))
}

/// Whether a point has a preset's settings.
fn is_measured(shipped: &Preset, point: &Point) -> bool {
    let key = |name: &str| point.keys.iter().find(|(key, _)| key == name).map_or("", |(_, value)| value);
    let number = |name: &str| key(name).parse::<f64>().unwrap_or(f64::NAN);
    let ratio = number("step.dt") / shipped.dt;
    (1.0 / SAME_STEP..=SAME_STEP).contains(&ratio)
        && (number("solver.tolerance") / shipped.tolerance - 1.0).abs() < 1e-6
        && number("step.newton") == f64::from(shipped.newton)
        && key("contact.sides") == sides(shipped)
}

fn sides(shipped: &Preset) -> &'static str {
    Sides::CHOICES.iter().find(|(_, sides)| *sides == shipped.sides).map_or("", |(name, _)| *name)
}

/// The presets as a table: what was found, and below each what is shipped.
pub fn section(curve: &Curve) -> Section {
    section_of(curve, &scene::preset::PRESETS)
}

/// What a preset decides, of what is varied.
const KEYS: [&str; 4] = ["step.dt", "step.newton", "solver.tolerance", "contact.sides"];

fn section_of(curve: &Curve, shipped: &[Preset]) -> Section {
    let heads = ["preset", "error below"].into_iter().chain(KEYS);
    let heads = heads.chain(["ms", "of real time", "error", "is it shipped"]);
    let mut table = Table::new(heads.map(String::from));
    let mut said = Vec::new();
    for (name, below, point) in presets(curve) {
        said.push(match point {
            Some(point) => format!("`{name}` is {} ({} of real time)", point.setting, digits(point.cost())),
            None => format!("no setting is below the {} of `{name}`", percent(below)),
        });
        let shipped = shipped.iter().find(|shipped| shipped.name == name);
        let wrong = match shipped {
            Some(shipped) => disagreement(curve, shipped, below, point),
            None => Some("has no setting".into()),
        };
        let agrees = wrong.clone().map_or("agrees".into(), |wrong| format!("no: {wrong}"));
        let names = [name.to_string(), percent(below)];
        table.rows.push(names.into_iter().chain(found(point)).chain([agrees]).collect());
        table.rows.extend(shipped.map(row));
        said.push(match wrong {
            Some(wrong) => format!("what is shipped as `{name}` does NOT agree: it {wrong}"),
            None => "what is shipped agrees".into(),
        });
    }
    Section {
        title: "Presets".into(),
        question:
            "Which settings should a scene get that names a preset? Of the best buys above, the cheapest whose error is below \
             the preset's. What the program ships agrees where it is below that error as well and costs no more beyond noise. \
             A part of real time below one is faster than the world."
                .into(),
        table,
        plot: None,
        finding: format!("{}.", said.join("; ")),
        ..Section::default()
    }
}

/// Settings, times and error of what was found.
fn found(point: Option<&Point>) -> Vec<String> {
    let Some(point) = point else { return vec!["none".into(); KEYS.len() + 3] };
    let value = |name: &str| point.keys.iter().find(|(key, _)| key == name).map_or("", |(_, value)| value);
    let mut row = KEYS.map(|key| value(key).to_string()).to_vec();
    row.extend([ms(point.step_ms()), digits(point.cost()), point.error().map_or(String::new(), percent)]);
    row
}

/// What is shipped, under the columns of what was found.
fn row(s: &Preset) -> Vec<String> {
    let own = [format!("{:.6}", s.dt), s.newton.to_string(), format!("{:e}", s.tolerance), sides(s).into()];
    let row = [format!("{}, shipped", s.name), String::new()].into_iter().chain(own);
    row.chain(std::iter::repeat_n(String::new(), 4)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As many seconds of computing as a step is cheap, and an error by its length: 4 ms are below half, 8 ms are not.
    fn curve() -> Curve {
        let point = |dt: f64, tolerance: &str| Point {
            setting: format!("{dt}, {tolerance}"),
            force_error: Some(6.0 * dt),
            step_us: vec![vec![if tolerance == "1e-1" { 1e3 } else { 2e3 }]],
            simulated_s: dt,
            keys: [
                ("step.dt", &*dt.to_string()),
                ("step.newton", "1"),
                ("solver.tolerance", tolerance),
                ("contact.sides", "both"),
            ]
            .map(|(key, value)| (key.to_string(), value.to_string()))
            .to_vec(),
            ..Point::default()
        };
        let points =
            [0.0081, 0.0041, 0.0021].into_iter().flat_map(|dt| ["1e-1", "1e-2"].map(|tolerance| point(dt, tolerance)));
        Curve { points: points.collect(), ..Curve::default() }
    }

    #[test]
    fn what_is_shipped_agrees_or_is_told_why_not() {
        let preset = |name, dt, tolerance| Preset { name, dt, tolerance, ..scene::preset::NONE };
        let good = [preset("fast", 0.008, 1e-1), preset("balanced", 0.004, 1e-1), preset("accurate", 0.002, 1e-1)];
        let section = section_of(&curve(), &good);
        assert!(!section.finding.contains("NOT"), "{}", section.finding);
        assert!(
            section.table.rows.len() == 6
                && section.table.rows.iter().all(|row| row.len() == section.table.heads.len())
        );
        for (k, spoilt, why) in [
            (0, preset("fast", 0.008, 1e-2), "costs 2"),
            (1, preset("balanced", 0.008, 1e-1), "error of 4.9 %"),
            (2, preset("accurate", 0.001, 1e-1), "not measured"),
            (2, preset("precise", 0.002, 1e-1), "no setting"),
        ] {
            let mut shipped = good;
            shipped[k] = spoilt;
            let finding = section_of(&curve(), &shipped).finding;
            assert!(finding.contains(why) && finding.matches("NOT").count() == 1, "{finding}");
        }
    }

    #[test]
    fn shipped_presets_are_those_that_are_looked_for() {
        assert_eq!(scene::preset::PRESETS.map(|preset| preset.name), PRESETS.map(|(name, _)| name));
    }
}
