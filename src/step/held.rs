//! What a program needs that leads a simulation by steps and by the loop in turn.

use super::Simulation;
use crate::scene::{Coupling, Scene};

impl Simulation {
    /// The scene that it was made of, with what was changed since.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// At the end of the last step, s.
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Contact stiffness of the stiffest pair of bodies, N/m^3; 0: nothing can touch.
    pub fn contact_stiffness(&self) -> f64 {
        self.model.pairs.iter().map(|pair| f64::from(pair.stiffness)).fold(0.0, f64::max)
    }

    /// What joins tool and device from now on. The loop chooses its own; whoever steps on without it gives back what there was.
    pub fn couple(&mut self, coupling: Option<Coupling>) {
        if let Some(tool) = &mut self.tool {
            tool.coupling = coupling;
        }
    }

    /// When the next step of `h` s ends, s: a whole multiple of it, unless the loop took steps of its own length.
    pub(super) fn next_end(&self, h: f64) -> f64 {
        if self.time == self.step as f64 * h { (self.step + 1) as f64 * h } else { self.time + h }
    }
}
