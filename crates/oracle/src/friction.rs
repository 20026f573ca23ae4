//! Friction in f64: regularised Coulomb friction, implicit in the velocity. The ratio c of friction to tangential
//! velocity is computed from the state at the start of the step and a prediction of the sliding speed at its end.

use glam::DVec3;

use crate::contact::{Carrier, Contact};
use crate::contact_law::Friction;
use crate::linear::Entries;
use crate::step::{Simulation, Unknowns, dot};

/// Friction of one contact: two tangents, and along each the row of the contact's Jacobian J and the relative velocity
/// at the start of the step (m/s).
#[derive(Default)]
pub struct Drag {
    along: [DVec3; 2],
    rows: [Vec<(usize, f64)>; 2],
    speeds: [f64; 2],
    /// Ratio c of friction to the tangential velocity at the end of the step, N s/m.
    pub viscosity: f64,
}

impl Drag {
    /// Adds h c J^T (I - n n^T) J to the matrix A (`a`) of the system of a step of `h` seconds, and
    /// -h c J^T (I - n n^T) v to its right-hand side b, with Jacobian J, normal n and relative velocity v at the start.
    pub(super) fn add(&self, a: &mut Entries, b: &mut [f64], h: f64) {
        for (row, speed) in self.rows.iter().zip(self.speeds) {
            a.add_outer(row, h * self.viscosity);
            row.iter().for_each(|(i, x)| b[*i] -= h * self.viscosity * speed * x);
        }
    }

    /// Tangential velocity at the start of the step, m/s.
    pub fn slip(&self) -> DVec3 {
        self.speeds[0] * self.along[0] + self.speeds[1] * self.along[1]
    }

    /// Friction on body A at the end of the step, N, where the unknown velocities have changed by `change`; its
    /// opposite acts on body B.
    pub(super) fn force(&self, change: &[f64]) -> DVec3 {
        let of = |k: usize| -self.viscosity * (self.speeds[k] + dot(&self.rows[k], change)) * self.along[k];
        of(0) + of(1)
    }
}

impl Simulation {
    /// Friction of a contact, with c = mu f / sqrt(u^2 + w^2): coefficient of friction mu, normal force f at the start of
    /// the step, sliding speed u at its end as predicted from `start` and `last`, the unknown velocities at the start and
    /// their changes over the last step, and w the speed below which friction is viscous. Friction on the tool
    /// (rigid body that the haptic device moves) acts at the contact's point on the other body, so that the friction
    /// forces on the two bodies act at one point.
    pub fn drag(&self, unknowns: &Unknowns, start: &[f64], last: &[f64], contact: &Contact) -> Drag {
        let Some(friction) = self.friction else { return Drag::default() };
        let mut at_one = contact.clone();
        match (&contact.first.carrier, &contact.second.carrier) {
            (Carrier::Tool, _) => at_one.first.position = contact.second.position,
            (_, Carrier::Tool) => at_one.second.position = contact.first.position,
            _ => {}
        }
        let along = <[DVec3; 2]>::from(contact.normal.any_orthonormal_pair());
        let rows = along.map(|t| self.row_along(unknowns, &at_one, t));
        let speeds: [f64; 2] =
            std::array::from_fn(|k| self.known_along(unknowns, contact, along[k]) + dot(&rows[k], start));
        let rate = self.known_rate(unknowns, contact) + dot(&self.row(unknowns, contact), start);
        let force = contact.area * contact.penalty().start_pressure(contact.depth, rate);
        let both = |speeds: [f64; 2]| speeds[0] * along[0] + speeds[1] * along[1];
        let change = both(std::array::from_fn(|k| dot(&rows[k], last)));
        let viscosity = friction.viscosity(force, Friction::predicted_slip(both(speeds), change));
        Drag { along, rows, speeds, viscosity }
    }
}
