//! Evaluates the contacts of a step in f64, for the stability matrix (many stiff and extreme simulations): how the
//! depth of each contact depends on the motion of the nodes and of the tool (rigid body that the haptic device leads),
//! and the contact's force by the contact law, pressure = stiffness * depth + damping * rate of depth. Stiffness and
//! damping are computed from the scene, not read from the GPU, but for the factor by which contact is stiffer at a tip
//! or an edge of the tool: that of each contact is a mean over triangles of the tool, and is only checked to lie within
//! theirs.

use glam::DVec3;
use palpate::internal::prepare::{self, Body, Shape};
use palpate::internal::shaders::{self, NONE};
use palpate::{Error, Result, Scene, ToolReport};
use palpate_oracle::contact::{Gathering, Tips};
use palpate_oracle::contact_law::Penalty;

use super::joined::Joined;
use super::trace::{HALF_ULP, ROUNDINGS};

/// The skins (surface meshes) of the bodies, joined, and the contact law.
pub struct Skin {
    /// Nodes and weights by which each vertex is embedded in the layer (tetrahedral mesh).
    vertices: Vec<Vec<(usize, f64)>>,
    triangles: Vec<[u32; 3]>,
    penalty: Penalty,
    /// Factors of the stiffness at the tool's triangles, and whether the damping has them too; `None` where vertices
    /// are tested for contact with the tool.
    tips: Option<Tips>,
}

/// Velocities of the nodes and of the tool.
#[derive(Clone, Copy)]
pub struct Motion<'a> {
    /// Velocities of the nodes, world axes, m/s.
    pub nodes: &'a [DVec3],
    /// Velocity of the tool's centre, m/s; zero without a tool.
    pub linear: DVec3,
    /// Angular velocity of the tool, rad/s; zero without a tool.
    pub angular: DVec3,
}

/// A contact that acts. The solver releases (gives no stiffness to) contacts that would pull; those are left out.
pub struct Pressing {
    normal: DVec3,
    /// Nodes on which the contact acts, and their weights: the rate of depth is the sum of weight times velocity along
    /// the normal. Weights are negative for nodes of the second body of the pair in contact.
    pub nodes: Vec<(usize, f64)>,
    /// Coefficients of the tool's velocity and of its angular velocity in the rate of depth; zero if the contact is not
    /// on the tool.
    pub tool: [DVec3; 2],
    area: f64,
    depth: f64,
    penalty: Penalty,
}

/// The contact forces on the tool by the contact law, compared with the wrench that the step reported.
#[derive(Debug, Clone, Copy, Default)]
pub struct ContactSums {
    /// Sum of the magnitudes of all pushes, N.
    pub pressed: f64,
    /// Largest amount by which a contact's pull exceeds the error that f32 rounding may cause in it, N; zero if no
    /// contact's pull does.
    pub tension: f64,
    /// Distance of the reported force from the sum of the contacts' forces, plus the corresponding distance of the
    /// torques divided by the tool's radius, N.
    pub missed: f64,
    /// Error that f32 rounding may cause in the sum of the contacts' forces, N.
    pub rounding: f64,
}

impl Skin {
    /// The skin of `joined` bodies, with the contact law of their scene, whose `bodies` these are. Errors: the scene's
    /// tool cannot be prepared.
    pub fn new(joined: &Joined, bodies: &[Body], scene: &Scene) -> Result<Skin> {
        let stiffness = scene.contact.stiffness.unwrap_or(joined.auto_stiffness);
        let tool = scene.rigid_tool().map(|spec| prepare::tool(spec, scene)).transpose()?;
        let soft = bodies.iter().filter(|body| matches!(body.shape, Shape::Soft { .. }));
        let mut chosen = soft.zip(&tool).map(|(body, tool)| match Gathering::chosen(&scene.contact, body, tool) {
            Gathering::Triangles(tips) => Some(tips),
            Gathering::Both | Gathering::Finer => None,
        });
        let tips = chosen.next().flatten();
        if chosen.any(|other| other != tips) {
            return Err(Error::Simulation("the stability matrix needs soft bodies that touch the tool alike".into()));
        }
        Ok(Skin {
            vertices: joined.vertices.clone(),
            triangles: joined.triangles.clone(),
            penalty: Penalty { stiffness, damping: scene.contact.damping.unwrap_or(stiffness * scene.step.dt) },
            tips,
        })
    }

    /// Whether triangles of the soft bodies are tested for contact with the tool.
    pub fn has_triangles_tested(&self) -> bool {
        self.tips.is_some()
    }

    /// Stiffness and damping of a contact. A factor of the stiffness beyond those of the tool's triangles is not taken.
    fn penalty(&self, contact: &shaders::Contact) -> Penalty {
        let Some(tips) = self.tips.as_ref().filter(|_| contact.tool_sign != 0.0) else { return self.penalty };
        let factor = f64::from(contact.stiffness) / self.penalty.stiffness;
        let [least, most] = [f64::min, f64::max].map(|of| tips.stiffening.iter().copied().reduce(of).unwrap_or(1.0));
        let factor = factor.clamp(least, most);
        let damping = if tips.damps { factor } else { 1.0 } * self.penalty.damping;
        Penalty { stiffness: factor * self.penalty.stiffness, damping }
    }

    /// Those of the engine's contacts that act.
    pub fn pressing(&self, contacts: &[shaders::Contact]) -> Vec<Pressing> {
        contacts.iter().filter(|contact| contact.stiffness != 0.0).map(|contact| self.one(contact)).collect()
    }

    fn one(&self, contact: &shaders::Contact) -> Pressing {
        let wide = |x: [f32; 3]| DVec3::from(x.map(f64::from));
        // Sign of the colliding vertex's velocity in the rate of depth: 1 if the vertex belongs to the first body of
        // the pair in contact (`side` is even), -1 if it belongs to the second.
        let sign = if contact.side.is_multiple_of(2) { 1.0 } else { -1.0 };
        let mut nodes: Vec<(usize, f64)> = Vec::new();
        let mut add = |vertex: usize, share: f64| {
            if let Some(own) = self.vertices.get(vertex) {
                nodes.extend(own.iter().map(|(node, weight)| (*node, share * weight)));
            }
        };
        add(contact.vertex as usize, sign);
        if let Some(corners) = self.triangles.get(contact.triangle as usize).filter(|_| contact.triangle != NONE) {
            let [second, third] = contact.barycentric.map(f64::from);
            for (corner, weight) in corners.iter().zip([1.0 - second - third, second, third]) {
                add(*corner as usize, -sign * weight);
            }
        }
        let normal = wide(contact.normal);
        let lever = wide(contact.arm).cross(normal);
        Pressing {
            normal,
            nodes,
            tool: [normal, lever].map(|x| f64::from(contact.tool_sign) * x),
            area: contact.area.into(),
            depth: contact.depth.into(),
            penalty: self.penalty(contact),
        }
    }
}

impl Pressing {
    /// Rate of depth, m/s; positive while the depth grows.
    fn rate(&self, motion: &Motion) -> f64 {
        let nodes: f64 = self.nodes.iter().map(|(node, weight)| weight * self.normal.dot(motion.nodes[*node])).sum();
        nodes + self.tool[0].dot(motion.linear) + self.tool[1].dot(motion.angular)
    }

    /// Derivative of the force at the end of a step of `h` seconds by the rate of depth at the end, N s/m.
    pub fn slope(&self, h: f64) -> f64 {
        self.area * self.penalty.slope(h)
    }

    /// Force at the end of a step of `h` seconds that ends with this motion, N: area (k depth + (h k + d) rate) with
    /// stiffness k, damping d, the depth at the start of the step and its rate at the end; below zero the contact
    /// pulls.
    pub fn push(&self, h: f64, motion: &Motion) -> f64 {
        self.area * self.penalty.end_pressure(self.depth, self.rate(motion), h)
    }

    /// Error that f32 rounding may cause in the force of [`Pressing::push`], N.
    pub fn rounding(&self, h: f64, motion: &Motion) -> f64 {
        let nodes: f64 = self.nodes.iter().map(|(node, weight)| weight.abs() * motion.nodes[*node].length()).sum();
        let tool = self.tool[0].length() * motion.linear.length() + self.tool[1].length() * motion.angular.length();
        let size = self.area * self.penalty.stiffness * self.depth + self.slope(h) * (nodes + tool);
        ROUNDINGS * HALF_ULP * size
    }

    /// Unit normal, from the first body of the pair to the second; a contact that presses pushes the first body against
    /// it.
    pub fn normal(&self) -> DVec3 {
        self.normal
    }
}

/// Compares the reported wrench (force and torque on the tool) with the sum of the contacts' forces and torques.
/// `radius` is that of the tool (m), and `told` is the tool's part of the step report, `None` without a tool.
pub fn held(contacts: &[Pressing], h: f64, motion: &Motion, told: Option<&ToolReport>, radius: f64) -> ContactSums {
    let mut held = ContactSums::default();
    let (mut force, mut torque) = (DVec3::ZERO, DVec3::ZERO);
    for contact in contacts {
        let push = contact.push(h, motion);
        let rounding = contact.rounding(h, motion);
        held.pressed += push.max(0.0);
        held.tension = held.tension.max(-push - rounding);
        held.rounding += rounding;
        force -= push.max(0.0) * contact.tool[0];
        torque -= push.max(0.0) * contact.tool[1];
    }
    if let Some(told) = told {
        held.missed = told.force.distance(force) + told.torque.distance(torque) / radius;
    }
    held
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A contact between a vertex, which coincides with a node of the pair's first body, and a tool above it, the
    /// second body: area 2 m^2, stiffness 100 N/m^3, damping 10 N s/m^3, depth 0.1 m.
    fn one() -> Pressing {
        Pressing {
            normal: DVec3::Y,
            nodes: vec![(0, 1.0)],
            tool: [-DVec3::Y, DVec3::ZERO],
            area: 2.0,
            depth: 0.1,
            penalty: Penalty { stiffness: 100.0, damping: 10.0 },
        }
    }

    #[test]
    fn a_factor_of_the_stiffness_is_one_that_the_tool_has() {
        let skin = |damps| Skin {
            vertices: vec![],
            triangles: vec![],
            penalty: Penalty { stiffness: 100.0, damping: 10.0 },
            tips: Some(Tips { stiffening: vec![4.0, 9.0, 16.0], damps }),
        };
        let contact = |stiffness, tool_sign| shaders::Contact { stiffness, tool_sign, ..shaders::Contact::default() };
        for (stiffness, expected) in [(100.0, 400.0), (700.0, 700.0), (2000.0, 1600.0)] {
            assert_eq!(skin(true).penalty(&contact(stiffness, -1.0)).stiffness, expected);
        }
        assert_eq!(skin(true).penalty(&contact(700.0, -1.0)).damping, 70.0);
        assert_eq!(skin(false).penalty(&contact(700.0, -1.0)).damping, 10.0);
        // Contact of two soft bodies has no factor.
        assert_eq!(skin(true).penalty(&contact(700.0, 0.0)), Penalty { stiffness: 100.0, damping: 10.0 });
    }

    #[test]
    fn the_law_by_hand_and_what_misses_it() {
        // By hand, area (k depth + (h k + d) rate): 2 * (100 * 0.1 + (0.01 * 100 + 10) * (0.5 - 0.2)) = 26.6 N, upwards
        // on the tool.
        let nodes = [DVec3::Y * 0.5];
        let motion = Motion { nodes: &nodes, linear: DVec3::Y * 0.2, angular: DVec3::ZERO };
        let told = ToolReport { force: DVec3::Y * 26.6, ..ToolReport::default() };
        let good = held(&[one()], 0.01, &motion, Some(&told), 0.02);
        assert!(
            good.missed < 1e-12 && good.tension <= 0.0 && (good.pressed - 26.6).abs() < 1e-12,
            "contact sums, expected a push of 26.6 N, no pull and no error: {good:?}"
        );
        let told = ToolReport { force: DVec3::Y * 1.2 * 26.6, torque: DVec3::X, ..ToolReport::default() };
        let bad = held(&[one()], 0.01, &motion, Some(&told), 0.5);
        assert!((bad.missed - 0.2 * 26.6 - 2.0).abs() < 1e-9, "contact sums, expected an error of 7.32 N: {bad:?}");
    }

    #[test]
    fn what_parts_faster_than_the_spring_pushes_pulls() {
        let nodes = [DVec3::Y * -2.0];
        let motion = Motion { nodes: &nodes, linear: DVec3::ZERO, angular: DVec3::ZERO };
        // By hand, area (k depth + (h k + d) rate): 2 * (10 - 11 * 2) = -24 N. This is a pull, which the wrench leaves
        // out.
        let pulling = held(&[one()], 0.01, &motion, Some(&ToolReport::default()), 0.02);
        assert!(
            (pulling.tension - 24.0).abs() < 1e-3 && pulling.missed == 0.0 && pulling.pressed == 0.0,
            "contact sums, expected a pull of 24 N, no push and no error: {pulling:?}"
        );
    }
}
