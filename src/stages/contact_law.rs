//! The host's part of the contact law: the stiffness and damping of a pair of bodies, and the traction of a contact for
//! reports. The law itself, a penalty with damping and regularised friction, is `shaders/shared/contact_law.glsl`. A
//! contact is a vertex of one body's surface mesh that lies inside the other body.

use glam::DVec3;

use crate::prepare::{Body, Layer, Shape};
use crate::scene::{Material, Scene};
use crate::shaders::Contact;

/// Contact stiffness (N/m^3) of a scene without soft bodies: what [`auto_stiffness`] gives for a Young's modulus of 20
/// kPa, Poisson's ratio 0.45 and edges of 10 mm.
const RIGID_STIFFNESS: f64 = 5.0e7;

/// Radius over which a tetrahedral mesh spreads the force of a small contact, as a share of its mean edge; 0.4 to 1.2 by
/// the compliances that are learned on block, head and human.
const SPREAD: f64 = 0.4;

/// The contact law between two bodies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Law {
    /// Contact stiffness, N/m^3.
    pub stiffness: f64,
    /// Contact damping, N s/m^3.
    pub damping: f64,
    /// How the softer body yields; `None` where both are rigid.
    pub softer: Option<Yielding>,
    /// Whether stiffness, and damping, are greater at tips and edges (`tips.rs`): what a scene gives is taken as it is.
    pub stiffens_tips: [bool; 2],
}

/// How a soft body yields under a contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Yielding {
    /// Plane strain modulus E / (1 - nu^2), with Young's modulus E and Poisson's ratio nu, Pa.
    pub modulus: f64,
    /// Retardation time, s: damping over stiffness (Rayleigh's beta).
    pub retardation: f64,
    /// Mean edge of the tetrahedra, m.
    pub edge: f64,
}

impl Yielding {
    /// `None` for a body that is not soft.
    pub fn of(body: &Body) -> Option<Yielding> {
        let (Shape::Soft { layer, .. }, Some(material)) = (&body.shape, softest(body)) else { return None };
        let (modulus, retardation) = (modulus(material), material.damping_stiffness);
        Some(Yielding { modulus, retardation, edge: mean_edge(layer) })
    }

    /// Estimate of the compliance, m/N, that a sphere of this radius (m) finds: that of a half-space under a rigid
    /// cylinder of radius a, 1 / (2 E* a), with the plane strain modulus E* (K. Johnson, "Contact Mechanics", 1985,
    /// section 3.4) and a^2 = R^2 + (SPREAD edge)^2, since coarse tetrahedra spread the force. On a thick, finely meshed
    /// body the sphere's area of contact is smaller than that of the cylinder, and the body yields more; a thin layer
    /// yields less.
    pub fn compliance(&self, radius: f64) -> f64 {
        0.5 / (self.modulus * radius.hypot(SPREAD * self.edge))
    }
}

/// The contact law between two bodies of a scene, by how they yield; `all`: how the scene's bodies and the tool yield.
pub fn parameters(scene: &Scene, pair: [Option<Yielding>; 2], all: &[Option<Yielding>]) -> Law {
    let (given, damping) = (scene.contact.stiffness, scene.contact.damping);
    let stiffness = given.unwrap_or_else(|| auto_stiffness(&pair, all));
    let softer = pair.into_iter().flatten().min_by(|a, b| a.modulus.total_cmp(&b.modulus));
    let stiffens = given.is_none() && softer.is_some();
    // With this damping the penalty force relaxes with a time constant of one step.
    let automatic = stiffness * scene.step.dt;
    Law {
        stiffness,
        damping: damping.unwrap_or(automatic),
        softer,
        stiffens_tips: [stiffens, stiffens && damping.is_none()],
    }
}

/// Traction between the two bodies of a contact: force over the contact's area.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Traction {
    /// Pressure along the normal, Pa; never below zero, since contacts do not adhere.
    pub pressure: f64,
    /// Friction on the second body of the pair, world axes, Pa; the first one feels the opposite.
    pub friction: DVec3,
}

/// The traction at the end of a step of `h` seconds, where `force` (N s) is what the solver stored for the contact in
/// the array `contact_forces`. The net force on the tool is the sum of these tractions times their areas.
pub fn end_traction(contact: &Contact, force: [f32; 4], h: f32) -> Traction {
    let [stiffness, depth, area, h] = [contact.stiffness, contact.depth, contact.area, h].map(f64::from);
    let [x, y, z, along] = force.map(f64::from);
    let slope = h * stiffness + f64::from(contact.damping);
    // Either the contact was released (it would have pulled, so its stiffness and damping were set to zero), or its
    // area, which is projected along the normal, is zero.
    if area <= 0.0 || slope <= 0.0 {
        return Traction { pressure: 0.0, friction: DVec3::ZERO };
    }
    let rate = f64::from(contact.rate) + along / (h * slope * area);
    let pressure = stiffness * depth + slope * rate;
    if pressure <= 0.0 {
        return Traction { pressure: 0.0, friction: DVec3::ZERO };
    }
    let drag =
        f64::from(contact.friction) * wide(contact.slip) + (DVec3::new(x, y, z) - along * wide(contact.normal)) / h;
    Traction { pressure, friction: drag / area }
}

/// The traction at the start of a step, without friction: for contacts whose traction at the end of the step is not
/// known.
pub fn start_traction(contact: &Contact) -> Traction {
    let [stiffness, damping, depth, rate] =
        [contact.stiffness, contact.damping, contact.depth, contact.rate].map(f64::from);
    Traction { pressure: (stiffness * depth + damping * rate).max(0.0), friction: DVec3::ZERO }
}

fn wide(x: [f32; 3]) -> DVec3 {
    DVec3::from_array(x.map(f64::from))
}

/// Automatic contact stiffness of a pair of bodies, N/m^3: 20 times the plane strain modulus over the mean edge of the
/// tetrahedral mesh, of the softer body, or, where both are rigid, of the softest of all bodies.
fn auto_stiffness(pair: &[Option<Yielding>], all: &[Option<Yielding>]) -> f64 {
    let of = |bodies: &[Option<Yielding>]| {
        bodies.iter().flatten().map(|soft| 20.0 * soft.modulus / soft.edge).reduce(f64::min)
    };
    of(pair).or_else(|| of(all)).unwrap_or(RIGID_STIFFNESS)
}

/// The material by which a soft body counts: of several, the softest of those in which its surface mesh is embedded,
/// since that material gives way first, and deeper materials are felt through it.
fn softest(body: &Body) -> Option<&Material> {
    let Shape::Soft { materials, embedding, .. } = &body.shape else { return None };
    let of_skin = embedding.iter().map(|e| materials.of(e.tetrahedron as usize));
    of_skin.min_by(|a, b| modulus(a).total_cmp(&modulus(b)))
}

/// Plane strain modulus E / (1 - nu^2), Pa.
fn modulus(material: &Material) -> f64 {
    material.young / (1.0 - material.poisson.powi(2))
}

/// Mean edge length of a tetrahedral mesh, each edge counted once, m.
pub fn mean_edge(layer: &Layer) -> f64 {
    let mut edges: Vec<[u32; 2]> = Vec::with_capacity(6 * layer.tetrahedra.len());
    for t in &layer.tetrahedra {
        for (i, k) in [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)] {
            edges.push([t[i].min(t[k]), t[i].max(t[k])]);
        }
    }
    edges.sort_unstable();
    edges.dedup();
    let length = |e: &[u32; 2]| layer.nodes[e[0] as usize].distance(layer.nodes[e[1] as usize]);
    edges.iter().map(length).sum::<f64>() / edges.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::body;

    /// Automatic contact stiffness, N/m^3, of a cube of three cells a side with a softer material region; `sphere`:
    /// centre and radius of that region, m, as TOML.
    fn stiffness(sphere: &str) -> f64 {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("scene.toml");
        let text = format!(
            "[[body]]\nname = \"a\"\nlayer = {{ box = [[0, 0, 0], [3, 3, 3]], cells = [3, 3, 3] }}\n\
             material = {{ young = 3e5, poisson = 0.0, density = 1000 }}\n\
             [[body.region]]\nsphere = {sphere}\nmaterial = {{ young = 1e5 }}\n"
        );
        std::fs::write(&file, text).unwrap();
        let scene = Scene::load(&file).unwrap();
        let body = body(&scene.bodies[0], &scene).unwrap();
        auto_stiffness(&[Yielding::of(&body)], &[])
    }

    #[test]
    fn the_softest_material_under_the_skin_decides() {
        let (inside, corner) = (stiffness("[1.5, 1.5, 1.5, 0.5]"), stiffness("[0, 0, 0, 1]"));
        assert!(
            (inside / corner - 3.0).abs() < 1e-12,
            "contact stiffness {inside} N/m^3 with the soft region inside, {corner} N/m^3 at a corner; expected ratio 3"
        );
    }

    /// The contact law of a soft and a rigid box, or of two rigid ones, with these keys of `[contact]`.
    fn law(contact: &str, both_are_rigid: bool) -> Law {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("scene.toml");
        let soft = "layer = { box = [[0, 0, 0], [1, 1, 1]], cells = [1, 1, 1] }\n\
                    material = { young = 1e5, poisson = 0.0, density = 1000, damping_stiffness = 2e-3 }";
        let kind = |is_rigid: bool| if is_rigid { "surface = \"tip.obj\"" } else { soft };
        let tip = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n";
        std::fs::write(folder.path().join("tip.obj"), tip).unwrap();
        let body_of = |name: &str, is_rigid| format!("[[body]]\nname = \"{name}\"\n{}\n", kind(is_rigid));
        std::fs::write(
            &file,
            format!("contact = {{ {contact} }}\n{}{}", body_of("a", both_are_rigid), body_of("b", true)),
        )
        .unwrap();
        let scene = Scene::load(&file).unwrap();
        let yielding = |k: usize| Yielding::of(&body(&scene.bodies[k], &scene).unwrap());
        let pair = [yielding(0), yielding(1)];
        parameters(&scene, pair, &pair)
    }

    #[test]
    fn the_softer_body_yields() {
        let softer = law("", false).softer.unwrap();
        assert_eq!((softer.modulus, softer.retardation), (1e5, 2e-3));
        // Six tetrahedra of one cell: twelve edges of the cube, six diagonals of its sides, one through it.
        let edge = (12.0 + 6.0 * 2f64.sqrt() + 3f64.sqrt()) / 19.0;
        assert!((softer.edge - edge).abs() < 1e-12);
        assert!((softer.compliance(SPREAD * edge) - 0.5 / (1e5 * SPREAD * edge * 2f64.sqrt())).abs() < 1e-15);
        assert_eq!(law("", true).softer, None);
    }

    #[test]
    fn a_stiffness_or_damping_that_is_given_is_taken_at_tips_too() {
        let stiffens = |contact: &str| law(contact, false).stiffens_tips;
        assert_eq!(stiffens(""), [true, true]);
        assert_eq!(stiffens("damping = 3.0"), [true, false]);
        assert_eq!(stiffens("stiffness = 1e6"), [false, false]);
        assert_eq!((law("stiffness = 1e6", false).stiffness, law("damping = 3.0", false).damping), (1e6, 3.0));
        assert_eq!(law("", true).stiffens_tips, [false, false]);
    }
}
