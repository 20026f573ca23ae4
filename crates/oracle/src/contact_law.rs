//! The contact law in f64: penalty pressure p = k depth + d depth', with stiffness k, damping d and the depth's rate
//! depth', and regularised Coulomb friction. Reference implementation of `shaders/shared/contact_law.glsl`.

use glam::DVec3;
use palpate::internal::prepare::Layer;
use palpate::scene::Material;

use crate::contact::Contact;

/// Penalty stiffness and damping between two bodies, per projected area.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Penalty {
    /// Stiffness k, N/m^3.
    pub stiffness: f64,
    /// Damping d, N s/m^3.
    pub damping: f64,
}

impl Penalty {
    /// Pressure at the start of a step, Pa, from the depth (m) and its rate (m/s); negative under tension.
    pub fn start_pressure(&self, depth: f64, rate: f64) -> f64 {
        self.stiffness * depth + self.damping * rate
    }

    /// Derivative of the pressure at the end of a step of `h` seconds by the depth's rate at the end, N s/m^3.
    pub fn slope(&self, h: f64) -> f64 {
        h * self.stiffness + self.damping
    }

    /// Pressure at the end of a step of `h` seconds, Pa, from the depth at its start and the depth's rate at its end.
    pub fn end_pressure(&self, depth: f64, rate: f64, h: f64) -> f64 {
        self.stiffness * depth + self.slope(h) * rate
    }
}

impl Contact {
    /// Stiffness and damping of the contact's pair of bodies.
    pub fn penalty(&self) -> Penalty {
        Penalty { stiffness: self.stiffness, damping: self.damping }
    }
}

/// Coulomb friction, which is viscous at low speed.
#[derive(Debug, Clone, Copy)]
pub struct Friction {
    /// Coefficient of friction.
    pub coefficient: f64,
    /// Speed below which friction is viscous, m/s.
    pub speed: f64,
}

impl Friction {
    /// Prediction of the sliding speed at the end of a step, m/s, from the tangential velocity at its start and the
    /// change of this velocity over the last step: the change will be the same again, but the speed will at most double
    /// and at least halve.
    pub fn predicted_slip(slip: DVec3, change: DVec3) -> f64 {
        let now = slip.length();
        (slip + change).length().clamp(0.5 * now, 2.0 * now)
    }

    /// Ratio of friction to tangential velocity, N s/m, from the normal force (N) at the start of a step and the
    /// predicted sliding speed (m/s).
    pub fn viscosity(&self, force: f64, sliding: f64) -> f64 {
        self.coefficient * force.max(0.0) / sliding.hypot(self.speed)
    }
}

/// Penalty stiffness "auto" of a scene, N/m^3: 20 times the modulus E / (1 - nu^2), divided by the mean edge length of
/// the layer (tetrahedral mesh), with Young's modulus E and Poisson's ratio nu, all of the softer body. That is the
/// body with the smaller modulus, or, if the moduli are equal, with the smaller stiffness. `None`: there is no soft
/// body.
pub fn auto_stiffness(soft: &[(&Layer, &Material)]) -> Option<f64> {
    let modulus = |m: &Material| m.young / (1.0 - m.poisson * m.poisson);
    let result = |(layer, m): &(&Layer, &Material)| (modulus(m), 20.0 * modulus(m) / mean_edge(layer));
    let least = soft.iter().map(result).min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    least.map(|(_, stiffness)| stiffness)
}

/// Mean length of the distinct edges of a layer (tetrahedral mesh), m.
pub fn mean_edge(layer: &Layer) -> f64 {
    let mut edges = std::collections::BTreeSet::new();
    for t in &layer.tetrahedra {
        for (i, a) in t.iter().enumerate() {
            edges.extend(t[i + 1..].iter().map(|b| (*a.min(b), *a.max(b))));
        }
    }
    let length = |(a, b): &(u32, u32)| layer.nodes[*a as usize].distance(layer.nodes[*b as usize]);
    edges.iter().map(length).sum::<f64>() / edges.len() as f64
}
