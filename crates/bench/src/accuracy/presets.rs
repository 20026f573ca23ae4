//! The presets: which of all settings has each name, and whether the program ships it.

use palpate::scene::preset::Preset;
use palpate::scene::{self, Sides};

use super::document::{digits, percent};
use super::{Curve, JUST_NOTICEABLE, Point};
use crate::{Section, Table};

/// Names, and below which error the cheapest setting has each: what is just noticed, its half, its quarter.
pub const PRESETS: [(&str, f64); 3] =
    [("fast", JUST_NOTICEABLE), ("balanced", JUST_NOTICEABLE / 2.0), ("accurate", JUST_NOTICEABLE / 4.0)];
/// A shipped time step is the measured one within this factor: measured ones halve each other.
const SAME_STEP: f64 = 1.25;

/// A setting on every body that it was measured on.
#[derive(Debug, Clone)]
pub struct Setting<'a> {
    /// One of each body: a panel of the curve.
    pub points: Vec<&'a Point>,
    /// Mean over the bodies of its time over that of the cheapest setting there.
    pub cost: f64,
}

impl Setting<'_> {
    /// The greater of its errors; `None` where one is no number.
    pub fn error(&self) -> Option<f64> {
        let errors: Option<Vec<f64>> = self.points.iter().map(|point| point.error()).collect();
        errors?.into_iter().max_by(f64::total_cmp)
    }

    fn is_flagged(&self) -> bool {
        self.points.iter().any(|point| !point.flags.is_empty())
    }

    /// What it has at a key of a scene.
    fn key(&self, name: &str) -> &str {
        let keys = self.points.iter().flat_map(|point| &point.keys);
        keys.into_iter().find(|(key, _)| key == name).map_or("", |(_, value)| value)
    }

    /// Of the solver; not a number where its keys do not tell.
    fn tolerance(&self) -> f64 {
        self.key("solver.tolerance").parse().unwrap_or(f64::NAN)
    }

    /// In words, without the body.
    fn name(&self) -> &str {
        let Some(point) = self.points.first() else { return "" };
        point.setting.strip_prefix(&format!("{}, ", point.panel)).unwrap_or(&point.setting)
    }

    /// Times on each body over the time that they simulate.
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

/// The setting that has each preset's name: the cheapest without a flag that is below its error on every body, solved to no
/// looser a tolerance than the preset before it.
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

/// Whether what is shipped is as good as what was found: the measured setting that it is keeps the preset's error, without a
/// flag, and costs no more beyond noise. Else what is wrong.
fn disagreement(curve: &Curve, shipped: &Preset, below: f64, found: Option<&Setting>) -> Option<String> {
    let Some(own) = settings(curve).into_iter().find(|own| is_measured(shipped, own)) else {
        return Some("was not measured".into());
    };
    match own.error() {
        Some(error) if error < below && !own.is_flagged() => {}
        error => return Some(format!("has an error of {}", error.map_or("no number".into(), percent))),
    }
    let is_cheaper = |found: &&Setting| {
        found.cost < own.cost && found.points.iter().zip(&own.points).any(|(found, own)| found.is_cheaper(own))
    };
    let found = found.filter(is_cheaper)?;
    Some(format!("costs {} times what {} does", digits(own.cost / found.cost), found.name()))
}

/// Whether a measured setting is a preset's.
fn is_measured(shipped: &Preset, own: &Setting) -> bool {
    let number = |name: &str| own.key(name).parse::<f64>().unwrap_or(f64::NAN);
    let ratio = number("step.dt") / shipped.dt;
    (1.0 / SAME_STEP..=SAME_STEP).contains(&ratio)
        && (own.tolerance() / shipped.tolerance - 1.0).abs() < 1e-6
        && number("step.newton") == f64::from(shipped.newton)
        && own.key("contact.sides") == sides(shipped)
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
    let heads = heads.chain(["of real time", "error", "is it shipped"]);
    let mut table = Table::new(heads.map(String::from));
    let (mut named, mut notes) = (Vec::new(), Vec::new());
    for (name, below, found) in presets(curve) {
        named.push(match &found {
            Some(own) => format!("`{name}` is {} ({} of real time)", own.name(), own.of_real_time()),
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
        notes.extend(wrong.map(|wrong| format!("What is shipped as `{name}` does NOT agree: it {wrong}.")));
    }
    if notes.is_empty() {
        notes.push("What is shipped agrees with all of them.".into());
    }
    Section {
        title: "Presets".into(),
        question:
            "Which settings should a scene get that names a preset? Of the settings above the cheapest without a flag whose error \
             is below the preset's on every body, and whose tolerance is no looser than that of the preset before; cost is the mean over the bodies of the time over that of the cheapest setting. \
             What the program ships agrees where it is below that error as well and costs no more beyond noise. A part of real \
             time below one is faster than the world; it is said of each body."
                .into(),
        table,
        plot: None,
        finding: format!("{}.", named.join("; ")),
        notes,
    }
}

/// Settings, times and error of what was found.
fn cells(found: Option<&Setting>) -> Vec<String> {
    let Some(own) = found else { return vec!["none".into(); KEYS.len() + 2] };
    let mut row = KEYS.map(|key| own.key(key).to_string()).to_vec();
    row.extend([own.of_real_time(), own.error().map_or(String::new(), percent)]);
    row
}

/// What is shipped, under the columns of what was found.
fn row(s: &Preset) -> Vec<String> {
    let own = [format!("{:.6}", s.dt), s.newton.to_string(), format!("{:e}", s.tolerance), sides(s).into()];
    let row = [format!("{}, shipped", s.name), String::new()].into_iter().chain(own);
    row.chain(std::iter::repeat_n(String::new(), 3)).collect()
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
        assert!(!section.notes.concat().contains("NOT"), "{:?}", section.notes);
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
            assert!(notes.contains(why) && notes.matches("NOT").count() == 1, "{notes}");
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
        // What is more accurate is not solved less far.
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
