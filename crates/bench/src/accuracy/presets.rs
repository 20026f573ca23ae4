//! Chooses the presets (named settings of a scene: `fast`, `balanced`, `accurate`) and compares them with those that
//! the program ships. It chooses from the settings whose error and computing time the curve of [`super::front`] gives
//! for two bodies, a soft and a stiff head.

use palpate::scene::preset::Preset;
use palpate::scene::{self, Sides};

use super::document::{digits, percent};
use super::{Curve, JUST_NOTICEABLE, Point};
use crate::{Section, Table};

/// Name of each preset, and the error that its setting must stay below: the just noticeable difference of a force, a
/// half of it, and a quarter of it.
pub const PRESETS: [(&str, f64); 3] =
    [("fast", JUST_NOTICEABLE), ("balanced", JUST_NOTICEABLE / 2.0), ("accurate", JUST_NOTICEABLE / 4.0)];
/// A shipped time step counts as equal to a measured one if they differ by less than this factor; neighbouring measured
/// time steps differ by a factor of two.
const SAME_STEP: f64 = 1.25;

/// One setting, with its points (measurements) on all the bodies that it was measured on.
#[derive(Debug, Clone)]
pub struct Setting<'a> {
    /// One point for each body; the points of a body are a panel (plot) of the curve.
    pub points: Vec<&'a Point>,
    /// The setting's cost relative to that of the cheapest setting on the same body, as a mean over the bodies.
    pub cost: f64,
}

impl Setting<'_> {
    /// The greatest error over the bodies; `None` where the error on a body is missing.
    pub fn error(&self) -> Option<f64> {
        let errors: Option<Vec<f64>> = self.points.iter().map(|point| point.error()).collect();
        errors?.into_iter().max_by(f64::total_cmp)
    }

    fn is_flagged(&self) -> bool {
        self.points.iter().any(|point| !point.flags.is_empty())
    }

    /// The value that the setting gives to a key of a scene; empty where it gives none.
    fn key(&self, name: &str) -> &str {
        let keys = self.points.iter().flat_map(|point| &point.keys);
        keys.into_iter().find(|(key, _)| key == name).map_or("", |(_, value)| value)
    }

    /// Solver tolerance; NaN where the setting's keys lack it.
    fn tolerance(&self) -> f64 {
        self.key("solver.tolerance").parse().unwrap_or(f64::NAN)
    }

    /// Name of the setting without the name of the body.
    fn name(&self) -> &str {
        let Some(point) = self.points.first() else { return "" };
        point.setting.strip_prefix(&format!("{}, ", point.panel)).unwrap_or(&point.setting)
    }

    /// Computing time over simulated time on each body, as text.
    fn of_real_time(&self) -> String {
        self.points.iter().map(|point| digits(point.cost())).collect::<Vec<_>>().join(", ")
    }
}

/// All settings of a curve.
fn settings(curve: &Curve) -> Vec<Setting<'_>> {
    let panels: Vec<&[Point]> = curve.points.chunk_by(|a, b| a.panel == b.panel).collect();
    let least = |own: &&[Point]| own.iter().map(Point::cost).fold(f64::INFINITY, f64::min);
    let least: Vec<f64> = panels.iter().map(least).collect();
    let of = |first: &Point| {
        let own = panels.iter().filter_map(|panel| panel.iter().find(|point| point.keys == first.keys));
        let points: Vec<&Point> = own.collect();
        let costs = points.iter().zip(&least).map(|(point, least)| point.cost() / least);
        let cost = costs.sum::<f64>() / points.len() as f64;
        Setting { points, cost }
    };
    panels.first().map_or_else(Vec::new, |panel| panel.iter().map(of).collect())
}

/// Name, error bound and setting of each preset: the cheapest setting without a flag (warning of a step) whose error is
/// below the bound on every body, and whose solver tolerance is no looser than that of the previous preset.
pub fn presets(curve: &Curve) -> [(&'static str, f64, Option<Setting<'_>>); 3] {
    let mut loosest = f64::INFINITY;
    PRESETS.map(|(name, below)| {
        let fits = |own: &Setting| {
            !own.is_flagged() && own.error().is_some_and(|error| error < below) && own.tolerance() <= loosest
        };
        let found = settings(curve).into_iter().filter(fits).min_by(|a, b| a.cost.total_cmp(&b.cost));
        loosest = found.as_ref().map_or(loosest, Setting::tolerance);
        (name, below, found)
    })
}

/// Compares a shipped preset with the setting `found` for it and returns what is wrong. `None`: the measured setting
/// that equals the shipped one has an error below `below`, has no flag, and costs at most as much as `found`, apart
/// from noise.
fn disagreement(curve: &Curve, shipped: &Preset, below: f64, found: Option<&Setting>) -> Option<String> {
    let Some(own) = settings(curve).into_iter().find(|own| is_measured(shipped, own)) else {
        return Some("was not measured".into());
    };
    match own.error() {
        Some(error) if error < below && !own.is_flagged() => {}
        error => return Some(format!("has a flag or an error of {}", error.map_or("no number".into(), percent))),
    }
    let is_cheaper = |found: &&Setting| {
        found.cost < own.cost && found.points.iter().zip(&own.points).any(|(found, own)| found.is_cheaper(own))
    };
    let found = found.filter(is_cheaper)?;
    Some(format!("costs {} times as much as {}", digits(own.cost / found.cost), found.name()))
}

/// Whether a measured setting has the values of a shipped preset.
fn is_measured(shipped: &Preset, own: &Setting) -> bool {
    let number = |name: &str| own.key(name).parse::<f64>().unwrap_or(f64::NAN);
    let ratio = number("step.dt") / shipped.dt;
    (1.0 / SAME_STEP..=SAME_STEP).contains(&ratio)
        && shipped.tolerance.is_some_and(|tolerance| (own.tolerance() / tolerance - 1.0).abs() < 1e-6)
        && number("step.newton") == f64::from(shipped.newton)
        && own.key("contact.sides") == sides(shipped)
}

fn sides(shipped: &Preset) -> &'static str {
    Sides::CHOICES.iter().find(|(_, sides)| *sides == shipped.sides).map_or("", |(name, _)| *name)
}

/// The report's section on the presets: for each preset a row with the setting that was found for it, and below it a
/// row with the shipped setting.
pub fn section(curve: &Curve) -> Section {
    section_of(curve, &scene::preset::PRESETS)
}

/// Keys of a scene that a preset sets and that the curve varies.
const KEYS: [&str; 4] = ["step.dt", "step.newton", "solver.tolerance", "contact.sides"];

fn section_of(curve: &Curve, shipped: &[Preset]) -> Section {
    let heads = ["preset", "error below"].into_iter().chain(KEYS);
    let heads = heads.chain(["computing time / simulated time", "error", "agrees with the shipped preset"]);
    let mut table = Table::new(heads.map(String::from));
    let (mut named, mut notes) = (Vec::new(), Vec::new());
    for (name, below, found) in presets(curve) {
        named.push(match &found {
            Some(own) => format!("`{name}` is {} (computing / simulated time: {})", own.name(), own.of_real_time()),
            None => format!("no setting is below the {} of `{name}`", percent(below)),
        });
        let shipped = shipped.iter().find(|shipped| shipped.name == name);
        let wrong = match shipped {
            Some(shipped) => disagreement(curve, shipped, below, found.as_ref()),
            None => Some("has no setting".into()),
        };
        let agrees = wrong.clone().map_or("agrees".into(), |wrong| format!("no: {wrong}"));
        let names = [name.to_string(), percent(below)];
        table.rows.push(names.into_iter().chain(cells(found.as_ref())).chain([agrees]).collect());
        table.rows.extend(shipped.map(row));
        notes.extend(wrong.map(|wrong| format!("The shipped preset `{name}` does NOT agree: it {wrong}.")));
    }
    if notes.is_empty() {
        notes.push("All shipped presets agree.".into());
    }
    Section {
        title: "Presets".into(),
        question:
            "Which settings should a scene get that names a preset? The cheapest of the settings above that has no \
             flag, an error below the preset's bound on every body, and a tolerance no looser than that of the \
             previous preset. The cost of a setting is its time over that of the cheapest setting, as a mean over the \
             bodies. A shipped preset agrees if its error is below the bound as well and it costs no more beyond \
             noise. Computing time / simulated time is given for each body; below one the simulation is faster than \
             real time."
                .into(),
        table,
        plot: None,
        finding: format!("{}.", named.join("; ")),
        notes,
    }
}

/// Table cells of the setting that was found: its keys, times and error.
fn cells(found: Option<&Setting>) -> Vec<String> {
    let Some(own) = found else { return vec!["none".into(); KEYS.len() + 2] };
    let mut row = KEYS.map(|key| own.key(key).to_string()).to_vec();
    row.extend([own.of_real_time(), own.error().map_or(String::new(), percent)]);
    row
}

/// Table row of a shipped preset, under the columns of the setting that was found.
fn row(s: &Preset) -> Vec<String> {
    let own = [
        format!("{:.6}", s.dt),
        s.newton.to_string(),
        s.tolerance.map_or(String::new(), |tolerance| format!("{tolerance:e}")),
        sides(s).into(),
    ];
    let row = [format!("{}, shipped", s.name), String::new()].into_iter().chain(own);
    row.chain(std::iter::repeat_n(String::new(), 3)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A curve whose error is 6 times the time step in seconds: a step of 8.1 ms is accurate enough for `fast` alone,
    /// 4.1 ms for `balanced` too, 2.1 ms for all three. A step takes 1 ms to compute at tolerance 1e-1 and 2 ms at
    /// 1e-2, whatever time it simulates.
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
        let preset = |name, dt, tolerance| Preset { name, dt, tolerance: Some(tolerance), ..scene::preset::NONE };
        let good = [preset("fast", 0.008, 1e-1), preset("balanced", 0.004, 1e-1), preset("accurate", 0.002, 1e-1)];
        let section = section_of(&curve(), &good);
        assert!(!section.notes.concat().contains("NOT"), "an unexpected note: {:?}", section.notes);
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
            let notes = section_of(&curve(), &shipped).notes.concat();
            assert!(notes.contains(why) && notes.matches("NOT").count() == 1, "wrong notes: {notes}");
        }
    }

    #[test]
    fn a_preset_must_do_on_every_body() {
        let mut both = curve();
        let stiff =
            |point: Point| Point { panel: "stiff".into(), force_error: point.error().map(|e| 3.0 * e), ..point };
        both.points.extend(curve().points.into_iter().map(stiff));
        let dt = |curve: &Curve| presets(curve).map(|(_, _, found)| found.map(|own| own.key("step.dt").to_string()));
        assert_eq!(dt(&curve()), [Some("0.0081".into()), Some("0.0041".into()), Some("0.0021".into())]);
        assert_eq!(dt(&both), [Some("0.0021".into()), None, None]);
        both.points[4].flags = vec!["frozen".into()];
        assert_eq!(presets(&both)[0].2.as_ref().map(|own| own.key("solver.tolerance")), Some("1e-2"));
        // A more accurate preset may not have a looser tolerance than the preset before it.
        let mut one = curve();
        for k in [0, 2] {
            one.points[k].flags = vec!["frozen".into()];
        }
        let tolerances = presets(&one).map(|(_, _, found)| found.map_or(0.0, |own| own.tolerance()));
        assert_eq!(tolerances, [1e-2; 3]);
    }

    #[test]
    fn shipped_presets_are_those_that_are_looked_for() {
        assert_eq!(scene::preset::PRESETS.map(|preset| preset.name), PRESETS.map(|(name, _)| name));
    }
}
