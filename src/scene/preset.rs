//! Presets: named sets of settings. A scene that names a preset gets the preset's value for every setting that the
//! scene itself does not give.

use serde::Serialize;

use super::Sides;

/// The settings of a preset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Preset {
    /// Name of the preset.
    pub name: &'static str,
    /// Value of `step.dt`, s.
    pub dt: f64,
    /// Value of `solver.tolerance`.
    pub tolerance: f64,
    /// Value of `solver.max_iterations`.
    pub max_iterations: u32,
    /// Value of `step.newton`.
    pub newton: u32,
    /// Value of `contact.sides`.
    pub sides: Sides,
}

/// The settings of a scene that names no preset.
pub const NONE: Preset =
    Preset { name: "none", dt: 0.001, tolerance: 1e-5, max_iterations: 200, newton: 1, sides: Sides::Both };

/// The presets, cheapest first. They were found by `palpate bench accuracy/presets`, on a soft and on a stiff head.
pub const PRESETS: [Preset; 3] = [
    Preset { name: "fast", dt: 0.008, tolerance: 1e-2, max_iterations: 200, newton: 1, sides: Sides::Both },
    Preset { name: "balanced", dt: 0.002, tolerance: 1e-2, max_iterations: 200, newton: 1, sides: Sides::Both },
    Preset { name: "accurate", dt: 0.001, tolerance: 1e-2, max_iterations: 200, newton: 1, sides: Sides::Both },
];

/// The preset that a scene names, and the settings whose values come from it; keys that the scene itself gives take
/// precedence.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Chosen {
    /// Name of the preset.
    pub preset: &'static str,
    /// Dotted key and value, as in a scene file, of each setting whose value comes from the preset.
    pub set: Vec<(&'static str, String)>,
}

impl Preset {
    /// The settings that get their values from this preset; `is_given` is true for keys (table, key) that the scene
    /// gives.
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
