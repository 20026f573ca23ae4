//! The host's part of the material law: the parameters that the GPU gets for a material. The law itself is
//! `shaders/shared/material_law.glsl`.

use crate::scene::{Material, MaterialLaw};
use crate::shaders::{ElasticMaterial, LAW_COROTATIONAL, LAW_NEO_HOOKEAN};

/// The number by which the shaders know a law.
fn id(law: MaterialLaw) -> u32 {
    match law {
        MaterialLaw::Corotational => LAW_COROTATIONAL,
        MaterialLaw::NeoHookean => LAW_NEO_HOOKEAN,
    }
}

/// A bit mask of the laws that these materials use (bit = number of the law); kernels are specialised for it.
pub fn laws_of(materials: &[ElasticMaterial]) -> u32 {
    materials.iter().fold(0, |bits, material| bits | 1 << material.law)
}

/// Whether any of these materials uses this law.
pub fn has(materials: &[ElasticMaterial], law: MaterialLaw) -> bool {
    laws_of(materials) & (1 << id(law)) != 0
}

/// Lame parameters of small strain (Pa), computed from Young's modulus and Poisson's ratio, with the material's law and
/// its stiffness-proportional damping (s).
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
