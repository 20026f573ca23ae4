//! Presets: named sets of settings of a scene. A scene that names a preset gets the preset's value for every setting of
//! the preset that the scene itself does not give.

use serde::Serialize;

use super::Sides;

/// The settings of a preset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Preset {
    /// Name of the preset.
    pub name: &'static str,
    /// Value of the scene key `step.dt`: the time step, s.
    pub dt: f64,
    /// Value of the scene key `solver.tolerance`: the relative residual at which the linear solver stops; `None`: the key
    /// is left out.
    pub tolerance: Option<f64>,
    /// Value of the scene key `solver.max_iterations`: the greatest number of iterations of the linear solver.
    pub max_iterations: u32,
    /// Value of the scene key `step.newton`: the number of Newton iterations per step.
    pub newton: u32,
    /// Value of the scene key `contact.sides`: whether the vertices of both touching bodies are tested for contact.
    pub sides: Sides,
}

/// The settings of a scene that names no preset.
pub const NONE: Preset =
    Preset { name: "none", dt: 0.001, tolerance: None, max_iterations: 200, newton: 1, sides: Sides::Both };

/// The presets, the one that needs the least computing time first. They were chosen from results of the benchmark
/// `palpate bench accuracy/presets`, which measures the error and the computing time of many settings on two models of
/// a head, a soft and a stiff one.
pub const PRESETS: [Preset; 3] = [
    Preset { name: "fast", dt: 0.008, tolerance: Some(1e-2), max_iterations: 200, newton: 1, sides: Sides::Both },
    Preset { name: "balanced", dt: 0.002, tolerance: Some(1e-2), max_iterations: 200, newton: 1, sides: Sides::Both },
    Preset { name: "accurate", dt: 0.001, tolerance: Some(1e-2), max_iterations: 200, newton: 1, sides: Sides::Both },
];

/// The preset that a scene names, and the settings whose values come from it; a setting that the scene itself gives
/// keeps the scene's value.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Chosen {
    /// Name of the preset.
    pub preset: &'static str,
    /// Dotted key (such as "step.dt") and value, as in a scene file, of each setting whose value comes from the preset.
    pub set: Vec<(&'static str, String)>,
}

impl Preset {
    /// Returns the settings of a scene that get their values from this preset; `is_given(table, key)` tells whether the
    /// scene itself gives a key.
    pub fn chosen(&self, is_given: impl Fn(&str, &str) -> bool) -> Chosen {
        let sides = Sides::CHOICES.iter().find(|(_, sides)| *sides == self.sides).map_or("", |(name, _)| *name);
        let values = [
            ("step.dt", self.dt.to_string()),
            ("solver.tolerance", self.tolerance.map_or(String::new(), |tolerance| format!("{tolerance:e}"))),
            ("solver.max_iterations", self.max_iterations.to_string()),
            ("step.newton", self.newton.to_string()),
            ("contact.sides", format!("\"{sides}\"")),
        ];
        let open = |(path, value): &(&str, String)| {
            !value.is_empty() && path.split_once('.').is_some_and(|(table, key)| !is_given(table, key))
        };
        Chosen { preset: self.name, set: values.into_iter().filter(open).collect() }
    }
}
