//! Colours and materials of rendered images. `look.glsl` in shaders/shared declares the materials for the shaders, and
//! `surface.glsl` beside it computes their colours under light.

use glam::{DMat4, DVec3};
use palpate::internal::shaders;
pub use palpate::internal::shaders::{Material, View};
use palpate::internal::step::Field;

/// Flags of a [`Material`].
pub mod flags {
    pub use palpate::internal::shaders::{BARE, EVEN, FLAT, GLASS, NUMBERED, UNLIT, VALUED};
}

/// Background colour, sRGB.
pub const BACKGROUND: [f32; 4] = [0.93, 0.94, 0.95, 1.0];
/// Colours of the first, second and following bodies, sRGB: warm and cold in turn, of similar lightness, and
/// distinguishable for the colour-blind.
const BODIES: [[u8; 3]; 6] =
    [[226, 178, 146], [142, 176, 204], [212, 196, 120], [176, 160, 200], [150, 190, 164], [205, 160, 165]];

/// Constructors of materials.
pub trait Look: Sized {
    /// A material of one colour (sRGB).
    fn plain(colour: [u8; 3]) -> Self;
    /// The material of the body with this index.
    fn body(index: usize) -> Self;
    /// The material with these flags added.
    fn with(self, flags: u32) -> Self;
    /// The material made transparent, with this opacity.
    fn glass(self, alpha: f32) -> Self;
}

impl Look for Material {
    fn plain(colour: [u8; 3]) -> Material {
        let [r, g, b] = colour.map(linear);
        Material { colour: [r, g, b, 1.0], low: 0.0, high: 1.0, flags: 0 }
    }

    fn body(index: usize) -> Material {
        Material::plain(BODIES[index % BODIES.len()])
    }

    fn with(self, flags: u32) -> Material {
        Material { flags: self.flags | flags, ..self }
    }

    fn glass(mut self, alpha: f32) -> Material {
        self.colour[3] = alpha;
        self.with(flags::GLASS)
    }
}

/// Number of colours of a field's colour scale. In [`colours`] the same number of other colours follows, by which
/// numbered meshes (collision proxies) are distinguished.
pub const SCALE_COLOURS: usize = shaders::SCALE_COLOURS as usize;

/// The colour map of a field: perceptually uniform, and legible for the colour-blind.
pub fn map(field: Field) -> colorous::Gradient {
    match field {
        Field::Depth | Field::StrainEnergy => colorous::VIRIDIS,
        Field::Pressure => colorous::PLASMA,
        Field::Displacement => colorous::CIVIDIS,
        Field::VonMises => colorous::INFERNO,
        Field::Hydrostatic => colorous::MAGMA,
    }
}

/// The colours of a field's colour map, then the colours by which numbered meshes (collision proxies) are
/// distinguished, as linear intensities.
pub fn colours(field: Option<Field>) -> Vec<[f32; 4]> {
    let shown = |colour: colorous::Color| {
        let [r, g, b] = [colour.r, colour.g, colour.b].map(linear);
        [r, g, b, 1.0]
    };
    let map = map(field.unwrap_or(Field::Pressure));
    let scale = (0..SCALE_COLOURS).map(|k| shown(map.eval_rational(k, SCALE_COLOURS)));
    // Consecutive numbers get hues that are far apart.
    let golden = |k: usize| (k as f64 * 0.618_033_988_749_895).fract();
    let numbers = (0..SCALE_COLOURS).map(|k| shown(colorous::RAINBOW.eval_continuous(golden(k))));
    let pale = |c: [f32; 4]| [0.25 + 0.6 * c[0], 0.25 + 0.6 * c[1], 0.25 + 0.6 * c[2], 1.0];
    scale.chain(numbers.map(pale)).collect()
}

/// Converts a byte of sRGB to linear intensity.
pub fn linear(byte: u8) -> f32 {
    let x = f32::from(byte) / 255.0;
    if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

/// The columns of a matrix in single precision, as the GPU reads them.
pub fn columns(matrix: DMat4) -> [[f32; 4]; 4] {
    matrix.as_mat4().to_cols_array_2d()
}

/// Two unit vectors perpendicular to each other and to `sun`, the unit vector towards the sun.
pub fn across(sun: DVec3) -> [DVec3; 2] {
    let right = sun.any_orthonormal_vector();
    [right, sun.cross(right)]
}

/// The shadow map's matrix. It maps the sphere around `middle` of radius `reach` (m), as seen from the sun (in the
/// direction of the unit vector `sun`), to x and y from 0 to 1 and depth from 0 (nearest to the sun) to 1.
pub fn light(sun: DVec3, middle: DVec3, reach: f64) -> DMat4 {
    let [right, up] = across(sun);
    let scale = 0.5 / reach;
    let row = |axis: DVec3| (scale * axis).extend(0.5 - scale * axis.dot(middle));
    DMat4::from_cols(row(right), row(up), row(-sun), glam::DVec4::W).transpose()
}
