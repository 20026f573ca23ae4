//! Net force, net torque, 6x6 stiffness and 6x6 damping of the contacts on the tool (the rigid body that the haptic
//! device leads), or on the rigid core inside a soft body that the device holds in place of a tool. f64 reference
//! implementation of the wrench stage, the last stage of a time step.

use glam::DVec3;

use crate::contact::Carrier;
use crate::step::{Core, Resolved};

/// Wrench of the contacts on the tool or core, with stiffness and damping, about its centre, world axes. The first
/// three rows of the 6x6 matrices belong to the force, the last three to the torque.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Wrench {
    /// Net force, N.
    pub force: DVec3,
    /// Net torque about the centre, N m.
    pub torque: DVec3,
    /// Sum of the magnitudes of the contacts' normal forces, N.
    pub pressing: f64,
    /// Friction on the tool or core, a part of `force`, N.
    pub friction: DVec3,
    /// K = sum k a c c^T over the active contacts (those that press), with stiffness k (N/m^3), area a, normal n,
    /// contact point s and c = (n, (s - centre) x n); symmetric positive semi-definite.
    pub stiffness: [[f64; 6]; 6],
    /// D = sum d a c c^T with damping d (N s/m^3), plus a term for friction along each of two tangents: the viscosity
    /// of friction (N s/m) times c c^T, where c has the tangent in place of n, and in place of s the point where
    /// friction acts.
    pub damping: [[f64; 6]; 6],
}

/// Sums the contacts on the tool; `centre` is the tool's centre at the start of the step. Friction acts at the
/// contact's point on the body that the tool touches.
pub fn on_tool(contacts: &[Resolved], centre: DVec3) -> Wrench {
    sum(contacts, centre, |carrier| matches!(carrier, Carrier::Tool), false)
}

/// Sums the contacts of the soft body whose rigid core the device holds, about that core's centre at the start of the
/// step, as if the whole body were rigid. Friction acts at the contact's point on this body.
pub fn on_core(contacts: &[Resolved], core: &Core) -> Wrench {
    let body = core.nodes.first().map(|(body, _)| *body);
    sum(contacts, core.centre, |carrier| matches!(carrier, Carrier::Nodes(own, _) if Some(*own) == body), true)
}

fn sum(
    contacts: &[Resolved],
    centre: DVec3,
    wants_stiffness: impl Fn(&Carrier) -> bool,
    friction_at_own: bool,
) -> Wrench {
    let mut sum = Wrench::default();
    for resolved in contacts.iter().filter(|r| r.active) {
        let contact = &resolved.contact;
        let of_first = wants_stiffness(&contact.first.carrier);
        let (point, other, direction) = match (of_first, wants_stiffness(&contact.second.carrier)) {
            (true, _) => (&contact.first, &contact.second, -contact.normal),
            (_, true) => (&contact.second, &contact.first, contact.normal),
            _ => continue,
        };
        let moment = (point.position - centre).cross(direction);
        sum.force += direction * resolved.force;
        sum.torque += moment * resolved.force;
        sum.pressing += resolved.force;
        add_outer(&mut sum.stiffness, direction, moment, contact.stiffness * contact.area);
        add_outer(&mut sum.damping, direction, moment, contact.damping * contact.area);
        let at = if friction_at_own { point.position } else { other.position } - centre;
        let drag = if of_first { resolved.friction } else { -resolved.friction };
        sum.force += drag;
        sum.friction += drag;
        sum.torque += at.cross(drag);
        for along in <[DVec3; 2]>::from(contact.normal.any_orthonormal_pair()) {
            add_outer(&mut sum.damping, along, at.cross(along), resolved.viscosity);
        }
    }
    sum
}

/// Adds `factor` times the outer product of the vector (force, torque) with itself.
fn add_outer(matrix: &mut [[f64; 6]; 6], force: DVec3, torque: DVec3, factor: f64) {
    let row: Vec<f64> = force.to_array().into_iter().chain(torque.to_array()).collect();
    for (i, x) in row.iter().enumerate() {
        row.iter().enumerate().for_each(|(j, y)| matrix[i][j] += factor * (x * y));
    }
}
