//! What a step gives back to the haptic loop: the contact wrench on the tool with its slopes, and the gap to the nearest body.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::rigid::{RigidState, Wrench};

/// Of the sizes of the contacts' forces summed, the size of their sum from which on they count as pressing from one side:
/// half a sphere, pressed evenly, has 0.5; two sides have 0.
const ONE_SIDED: f64 = 0.3;

/// What a step of the simulation gives back to the loop.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ContactWrench {
    /// Steps done, this one included; 0: there was none yet.
    pub step: u64,
    /// When the step's inputs were taken, s on the loop's clock.
    pub time: f64,
    /// The tool at the end of the step.
    pub tool: RigidState,
    /// Of all contacts on the tool, about its centre, world axes.
    pub wrench: Wrench,
    /// N/m, N/rad, N m/m, N m/rad: rows and columns linear, then angular; symmetric.
    pub stiffness: [[f64; 6]; 6],
    /// The same, times s.
    pub damping: [[f64; 6]; 6],
    /// Sizes of the contacts' forces along their normals, summed, N: as large as the force where all press the same way.
    pub pressing: f64,
    /// The free way to the nearest body; `None`: the tool touches something, or nothing is known to be near.
    pub gap: Option<Gap>,
    /// Whether a body moved as it is told during the step: contact may do work that nobody did on it.
    pub is_driven: bool,
}

/// The free way from the tool to the nearest body, and how stiff contact will be where it ends.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Gap {
    /// Unit vector from the body to the tool: the direction in which contact will push.
    pub normal: DVec3,
    /// How far the tool can go against the normal before it touches, m; below zero, it touches at the end of a step that began
    /// without contact.
    pub distance: f64,
    /// An upper bound of the stiffness that contact will have at first, with the body held still, N/m.
    pub stiffness: f64,
}

impl ContactWrench {
    /// Before the first step: no contact.
    pub fn none(tool: RigidState) -> ContactWrench {
        let zero = [[0.0; 6]; 6];
        let (stiffness, damping) = (zero, zero);
        ContactWrench {
            step: 0,
            time: 0.0,
            tool,
            wrench: Wrench::ZERO,
            stiffness,
            damping,
            pressing: 0.0,
            gap: None,
            is_driven: false,
        }
    }

    /// The direction in which contacts push, where they press from one side.
    pub fn normal(&self) -> Option<DVec3> {
        let size = self.wrench.force.length();
        (size > 0.0 && size >= ONE_SIDED * self.pressing).then(|| self.wrench.force / size)
    }

    /// Whether all of it is finite.
    pub fn is_finite(&self) -> bool {
        let numbers = self.stiffness.iter().chain(&self.damping).flatten();
        self.tool.is_valid()
            && self.wrench.is_finite()
            && self.pressing.is_finite()
            && self.gap.is_none_or(|gap| gap.is_valid())
            && numbers.into_iter().all(|x| x.is_finite())
    }
}

impl Gap {
    /// Whether the normal is a unit vector to 1e-3, the distance finite, and the stiffness finite and not negative.
    pub fn is_valid(&self) -> bool {
        let is_stiffness = self.stiffness.is_finite() && self.stiffness >= 0.0;
        (self.normal.length() - 1.0).abs() < 1e-3 && self.distance.is_finite() && is_stiffness
    }
}
