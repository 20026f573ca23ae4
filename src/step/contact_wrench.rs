//! Output of a step for the haptic loop: the contact wrench on the tool (the rigid body that the haptic device leads)
//! with its stiffness and damping, and the gap between the tool and the nearest body.

use glam::DVec3;
use nalgebra::Matrix6;
use serde::{Deserialize, Serialize};

use super::DeviceInput;
use super::rigid::{RigidState, Wrench};

/// Contacts count as pressing from one side where the magnitude of their net force is at least this fraction of the sum
/// of the magnitudes of their forces. For even pressure on half a sphere that fraction is 0.5, for equal and opposite
/// forces it is 0.
const ONE_SIDED: f64 = 0.3;

/// Greatest number of gaps beside the nearest one.
pub const FARTHER: usize = 5;

/// The output of a step for the haptic loop.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ContactWrench {
    /// Number of steps done, including the one that this wrench is the output of; 0 before the first step.
    pub step: u64,
    /// Time at which the step's inputs were taken, s on the haptic loop's clock.
    pub time: f64,
    /// Length of the step, s.
    pub h: f64,
    /// State of the tool at the end of the step.
    pub tool: RigidState,
    /// Net wrench of all contacts on the tool, about its centre, world axes.
    pub wrench: Wrench,
    /// Contact stiffness felt by the tool, without the bodies' own compliance: a symmetric matrix whose rows and
    /// columns are linear (three), then angular (three), in N/m, N/rad, N m/m and N m/rad.
    pub stiffness: [[f64; 6]; 6],
    /// Contact damping felt by the tool, in the layout of `stiffness`; the units are those of `stiffness` times s.
    pub damping: [[f64; 6]; 6],
    /// Sum of the magnitudes of the contacts' normal forces, N; without friction equal to the magnitude of the net
    /// force where all contacts press in the same direction.
    pub pressing: f64,
    /// Friction of the contacts on the tool, a part of the net force, N.
    pub friction: DVec3,
    /// The greatest friction of the contacts, N: the coefficient of friction times `pressing`.
    pub most_friction: f64,
    /// The gap between the tool and the nearest body; `None` where the tool touches something, or nothing is known to
    /// be near.
    pub gap: Option<Gap>,
    /// Gaps in other directions than that of `gap`, to half-spaces and, for a spherical tool, to places of the skins that
    /// face it: what the tool may touch first although it is farther away. Nearer ones come first.
    pub farther: [Option<Gap>; FARTHER],
    /// Whether a driven body (one that follows a trajectory) moved during the step: contact may then do work on the
    /// tool that does not come from the user's hand.
    pub has_kinematic_motion: bool,
}

/// The gap between the tool and the nearest body, and how stiff contact will be once the gap is closed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Gap {
    /// Unit vector from the body to the tool: the direction in which contact will push.
    pub normal: DVec3,
    /// How far the tool can go against the normal before it touches the body, m; negative where the tool has come into
    /// contact during a step that began without contact.
    pub distance: f64,
    /// The force that contact will have at a depth d, without the body's own compliance, is stiffness d + steepness
    /// d^2: the stiffness at the first touch, N/m.
    pub stiffness: f64,
    /// The steepness of a round contact, N/m^2.
    pub steepness: f64,
    /// Estimate of the body's own compliance under that contact, m/N; 0 for a rigid body.
    pub compliance: f64,
    /// The body's retardation time, s: its damping over its stiffness; 0 for a rigid body.
    pub retardation: f64,
    /// Index of the pair of tool and body, by which bodies are told apart.
    pub pair: u32,
}

impl ContactWrench {
    /// The value before the first step: no contact.
    pub fn none(tool: RigidState) -> ContactWrench {
        let zero = [[0.0; 6]; 6];
        let (stiffness, damping) = (zero, zero);
        ContactWrench {
            step: 0,
            time: 0.0,
            h: 0.0,
            tool,
            wrench: Wrench::ZERO,
            stiffness,
            damping,
            pressing: 0.0,
            friction: DVec3::ZERO,
            most_friction: 0.0,
            gap: None,
            farther: [None; FARTHER],
            has_kinematic_motion: false,
        }
    }

    /// No contact in a step with this input.
    pub fn nothing_at(input: &DeviceInput) -> ContactWrench {
        ContactWrench { time: input.time, ..ContactWrench::none(input.tool) }
    }

    /// Contact stiffness as a matrix.
    pub fn stiffness_matrix(&self) -> Matrix6<f64> {
        Matrix6::from_fn(|i, k| self.stiffness[i][k])
    }

    /// Unit normal of the contact: the direction in which its stiffness turns the net force, which friction tilts.
    pub fn contact_normal(&self) -> Option<DVec3> {
        let force = self.wrench.force;
        let row = |i: usize| DVec3::new(self.stiffness[i][0], self.stiffness[i][1], self.stiffness[i][2]).dot(force);
        DVec3::new(row(0), row(1), row(2)).try_normalize()
    }

    /// The direction in which contacts push the tool, where they press from one side.
    pub fn normal(&self) -> Option<DVec3> {
        let size = self.wrench.force.length();
        (size > 0.0 && size >= ONE_SIDED * self.pressing).then(|| self.wrench.force / size)
    }

    /// All gaps, the nearest first.
    pub fn gaps(&self) -> impl Iterator<Item = &Gap> {
        self.gap.iter().chain(self.farther.iter().flatten())
    }

    /// The gap whose normal is nearest to a direction.
    pub fn gap_along(&self, direction: DVec3) -> Option<&Gap> {
        self.gaps().max_by(|a, b| a.normal.dot(direction).total_cmp(&b.normal.dot(direction)))
    }

    /// Whether all numbers are finite, and the tool's state and the gaps are valid.
    pub fn is_finite(&self) -> bool {
        let numbers = self.stiffness.iter().chain(&self.damping).flatten();
        self.tool.is_valid()
            && self.wrench.is_finite()
            && self.pressing.is_finite()
            && self.friction.is_finite()
            && self.most_friction.is_finite()
            && self.gaps().all(|gap| gap.is_valid())
            && numbers.into_iter().all(|x| x.is_finite())
    }
}

impl Gap {
    /// A gap to a rigid body, with a flat contact of this stiffness (N/m).
    pub fn rigid(normal: DVec3, distance: f64, stiffness: f64) -> Gap {
        Gap { normal, distance, stiffness, steepness: 0.0, compliance: 0.0, retardation: 0.0, pair: 0 }
    }

    /// Whether the normal is a unit vector (to 1e-3), the distance is finite, and the numbers of the law of
    /// contact are finite and not negative.
    pub fn is_valid(&self) -> bool {
        let is_law = [self.stiffness, self.steepness, self.compliance, self.retardation]
            .iter()
            .all(|x| x.is_finite() && *x >= 0.0);
        (self.normal.length() - 1.0).abs() < 1e-3 && self.distance.is_finite() && is_law
    }
}
