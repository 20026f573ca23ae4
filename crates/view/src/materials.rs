//! Names and colours of the materials of soft bodies: a body's own, and those of its material regions (parts of the
//! body for which the scene gives a material of their own).

use palpate::Simulation;
use palpate::scene::{Body, Group, Place};

/// Colours of materials, sRGB, which people with any colour vision can tell apart: most of the colours are those of
/// Okabe and Ito 2008, and a test measures how far apart the colours are.
pub const COLOURS: [[u8; 3]; 8] = [
    [86, 180, 233],
    [230, 159, 0],
    [120, 60, 140],
    [240, 228, 66],
    [0, 158, 115],
    [213, 94, 0],
    [40, 60, 210],
    [190, 190, 190],
];
/// Factor that darkens the colours in each further round through [`COLOURS`], if there are more materials than colours.
const DARKER: f32 = 0.6;
/// Greatest number of characters of a name that a label shows in full.
const LONGEST: usize = 24;

/// A material of a soft body, as images show it.
#[derive(Debug, Clone, PartialEq)]
pub struct Coloured {
    /// Index of the body.
    pub body: usize,
    /// Index among the body's materials.
    pub index: usize,
    /// Colour, sRGB.
    pub colour: [u8; 3],
    /// Name for the user.
    pub name: String,
    /// Young's modulus as it is now, Pa.
    pub young: f64,
}

/// The name of a body's material region with the number `region`, counted from 1 in the order of the scene's file.
pub fn region_name(body: &Body, region: usize) -> String {
    let of = region.checked_sub(1).and_then(|index| body.regions.get(index));
    match of.map(|region| &region.place) {
        Some(Place::Group(Group::Name(name))) => format!("group {}", shortened(name)),
        Some(Place::Group(Group::Number(number))) => format!("group {number}"),
        Some(Place::Box { .. }) => format!("region {region} (box)"),
        Some(Place::Sphere { .. }) => format!("region {region} (sphere)"),
        None => format!("region {region}"),
    }
}

/// A name on one line of at most [`LONGEST`] characters; what is left out is replaced by an ellipsis.
fn shortened(name: &str) -> String {
    let name: String = name.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    if name.chars().count() <= LONGEST {
        return name;
    }
    name.chars().take(LONGEST - 1).chain(['\u{2026}']).collect()
}

/// The materials of all soft bodies in the order of the scene, each with a colour: first [`COLOURS`], then darker ones.
pub fn coloured(simulation: &Simulation) -> Vec<Coloured> {
    let of_body = |(body, of): (usize, &Body)| {
        let materials = simulation.materials(body).to_vec();
        let is_divided = materials.len() > 1;
        let name = shortened(&of.name);
        let names = (0..materials.len()).map(|index| match (index, is_divided) {
            (0, false) => name.clone(),
            (0, true) => format!("{name}, own material"),
            _ => format!("{name}, {}", region_name(of, index)),
        });
        let all = names.zip(materials).enumerate();
        all.map(|(index, (name, material))| (body, index, name, material.young)).collect::<Vec<_>>()
    };
    let all = simulation.scene().bodies.iter().enumerate().flat_map(of_body);
    let paint =
        |(place, (body, index, name, young)): (usize, _)| Coloured { body, index, colour: colour(place), name, young };
    all.enumerate().map(paint).collect()
}

/// The colour of the material at this place in the legend, counted from 0.
fn colour(place: usize) -> [u8; 3] {
    let share = DARKER.powi((place / COLOURS.len()) as i32);
    COLOURS[place % COLOURS.len()].map(|byte| (f32::from(byte) * share) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::look::linear;

    /// Kinds of sight, as matrices that turn linear red, green and blue into the colour that is seen (Machado and
    /// others 2009): normal sight, protanopia, deuteranopia, tritanopia.
    const SIGHT: [[[f64; 3]; 3]; 4] = [
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.01182, 0.04294, 0.968881]],
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.3039]],
    ];
    /// Least distance between two colours in CIELAB; colours that lie side by side are told apart from about 2 on.
    const APART: f64 = 15.0;

    fn times(matrix: &[[f64; 3]; 3], x: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|row| (0..3).map(|k| matrix[row][k] * x[k]).sum())
    }

    /// Converts a colour from linear red, green and blue to CIELAB.
    fn lab(colour: [f64; 3]) -> [f64; 3] {
        const XYZ: [[f64; 3]; 3] = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]];
        let white = times(&XYZ, [1.0; 3]);
        let xyz = times(&XYZ, colour.map(|c| c.clamp(0.0, 1.0)));
        let [x, y, z] = [0, 1, 2].map(|k| {
            let t = xyz[k] / white[k];
            if t > 0.008856 { t.cbrt() } else { 7.787 * t + 16.0 / 116.0 }
        });
        [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
    }

    #[test]
    fn every_sight_tells_the_colours_apart() {
        for (kind, sight) in SIGHT.iter().enumerate() {
            let seen = COLOURS.map(|colour| lab(times(sight, colour.map(|byte| linear(byte).into()))));
            for a in 0..seen.len() {
                for b in 0..a {
                    let apart = (0..3).map(|k| (seen[a][k] - seen[b][k]).powi(2)).sum::<f64>().sqrt();
                    assert!(
                        apart > APART,
                        "kind of sight {kind}: colours {a} and {b} are only {apart:.1} apart in CIELAB"
                    );
                }
            }
        }
        assert!(colour(0) == COLOURS[0] && colour(8) != COLOURS[0], "a further round must have other colours");
    }

    #[test]
    fn long_names_are_shortened_visibly() {
        assert_eq!(shortened("fat"), "fat");
        let long = shortened(&"muscle\n".repeat(20));
        assert!(long.chars().count() == LONGEST && long.ends_with('\u{2026}') && !long.contains('\n'), "name: {long}");
    }
}
