//! The host's part of the material law: what the device is told of a material. The law itself is
//! `shaders/shared/material_law.glsl`.

use crate::scene::{Law, Material};
use crate::shaders::{ElasticMaterial, LAW_COROTATIONAL, LAW_NEO_HOOKEAN};

/// The device's id of a law.
fn id(law: Law) -> u32 {
    match law {
        Law::Corotational => LAW_COROTATIONAL,
        Law::NeoHookean => LAW_NEO_HOOKEAN,
    }
}

/// A bit for each law that some of these materials have: kernels are specialised for those.
pub fn laws_of(materials: &[ElasticMaterial]) -> u32 {
    materials.iter().fold(0, |bits, material| bits | 1 << material.law)
}

/// Whether some of these materials have a law.
pub fn has(materials: &[ElasticMaterial], law: Law) -> bool {
    laws_of(materials) & (1 << id(law)) != 0
}

/// Lame's parameters of small strain from Young's modulus and Poisson's ratio, and the law's id.
pub fn parameters(material: &Material) -> ElasticMaterial {
    let mu = material.young / (2.0 * (1.0 + material.poisson));
    let lambda = 2.0 * mu * material.poisson / (1.0 - 2.0 * material.poisson);
    ElasticMaterial {
        mu: mu as f32,
        lambda: lambda as f32,
        law: id(material.law),
        damping: material.damping_stiffness as f32,
        more: [0.0; 4],
    }
}
