//! Presets: names for settings that belong together. A scene that names one gets its values where it says nothing itself.

use serde::Serialize;

use super::Sides;

/// What a scene says of itself by a name.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Preset {
    /// Its name.
    pub name: &'static str,
    /// `step.dt`, s.
    pub dt: f64,
    /// `solver.tolerance`.
    pub tolerance: f64,
    /// `solver.max_iterations`.
    pub max_iterations: u32,
    /// `step.newton`.
    pub newton: u32,
    /// `contact.sides`.
    pub sides: Sides,
}

/// What a scene without a preset has.
pub const NONE: Preset =
    Preset { name: "none", dt: 0.001, tolerance: 1e-5, max_iterations: 200, newton: 1, sides: Sides::Both };

/// The presets, cheapest first: what `palpate bench accuracy/presets` finds, on a soft and on a stiff head.
pub const PRESETS: [Preset; 3] = [
    Preset { name: "fast", dt: 0.008, tolerance: 1e-2, max_iterations: 200, newton: 1, sides: Sides::Both },
    Preset { name: "balanced", dt: 0.002, tolerance: 1e-2, max_iterations: 200, newton: 1, sides: Sides::Both },
    Preset { name: "accurate", dt: 0.001, tolerance: 1e-2, max_iterations: 200, newton: 1, sides: Sides::Both },
];

/// The preset that a scene named, and what it decided there: the file's own keys win.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Chosen {
    /// Its name.
    pub preset: &'static str,
    /// Key and value, in words of a scene file.
    pub set: Vec<(&'static str, String)>,
}

impl Preset {
    /// What it decides where `is_given` says which keys (table, key) the file has.
    pub fn chosen(&self, is_given: impl Fn(&str, &str) -> bool) -> Chosen {
        let sides = Sides::CHOICES.iter().find(|(_, sides)| *sides == self.sides).map_or("", |(name, _)| *name);
        let values = [
            ("step.dt", self.dt.to_string()),
            ("solver.tolerance", format!("{:e}", self.tolerance)),
            ("solver.max_iterations", self.max_iterations.to_string()),
            ("step.newton", self.newton.to_string()),
            ("contact.sides", format!("\"{sides}\"")),
        ];
        let open = |(path, _): &(&str, String)| path.split_once('.').is_some_and(|(table, key)| !is_given(table, key));
        Chosen { preset: self.name, set: values.into_iter().filter(open).collect() }
    }
}
