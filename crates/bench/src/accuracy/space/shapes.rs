//! Meshes for the accuracy curves in which a ball is pressed into a body: blocks whose cells are finest where the ball
//! touches them, skins (surface meshes) of such blocks with any number of cells, a dome, and a ball.

use std::path::PathBuf;

use glam::{DVec3, UVec3};
use palpate::Result;
use palpate::internal::prepare::layer::kuhn_box;

use crate::meshes::{MeshFolder, Surface};

/// Writes a block of tetrahedra with its top at y = 0 and `cells` along each axis, [`graded`] by `grades`; returns the
/// path of the file. `size`: half width along x, height, half width along z.
pub fn graded_block(folder: &MeshFolder, name: &str, size: DVec3, cells: [u32; 3], grades: DVec3) -> Result<PathBuf> {
    let mut layer = kuhn_box(DVec3::new(-1.0, -1.0, -1.0), DVec3::new(1.0, 0.0, 1.0), cells);
    layer.nodes.iter_mut().for_each(|x| *x = block_point(*x, size, grades));
    folder.layer(name, &layer.nodes, &layer.tetrahedra)
}

/// Grades a coordinate: maps -1..1 onto -1..1 so that even cells become finer by the factor 1 + `grade` at 0, and
/// coarser at the ends.
pub fn graded(u: f64, grade: f64) -> f64 {
    (u + grade * u.powi(3)) / (1.0 + grade)
}

/// Maps a point of the unit block (x and z from -1 to 1, y from -1 to 0) into the block; `size`: half width along x,
/// height, half width along z.
fn block_point(x: DVec3, size: DVec3, grades: DVec3) -> DVec3 {
    size * DVec3::new(graded(x.x, grades.x), graded(x.y, grades.y), graded(x.z, grades.z))
}

/// Surface of the block of [`graded_block`]; the shape of the surface does not depend on the number of cells.
pub fn block_skin(size: DVec3, cells: [u32; 3], grades: DVec3) -> Surface {
    let (vertices, triangles) = unit_box(cells);
    let place = |x: &DVec3| block_point(DVec3::new(2.0 * x.x - 1.0, x.y - 1.0, 2.0 * x.z - 1.0), size, grades);
    (vertices.iter().map(place).collect(), triangles)
}

/// The upper half of a ball with a flat base, with its top at the origin and `cells` across its width.
pub fn dome(radius: f64, cells: u32) -> Surface {
    let (vertices, triangles) = unit_box([cells, cells.div_ceil(2), cells]);
    let place = |x: &DVec3| {
        let x = DVec3::new(2.0 * x.x - 1.0, x.y, 2.0 * x.z - 1.0);
        // Maps concentric cubes to concentric spheres.
        let reach = x.abs().max_element();
        radius * (if reach > 0.0 { x * (reach / x.length()) } else { x } - DVec3::Y)
    };
    (vertices.iter().map(place).collect(), triangles)
}

/// A ball about the origin with `cells` along a quarter of its girth; cells are finer by the factor 1 + `grade` where
/// the axes meet the surface.
pub fn ball(radius: f64, cells: u32, grade: f64) -> Surface {
    let (vertices, triangles) = unit_box([cells; 3]);
    let place = |x: &DVec3| {
        let x = 2.0 * *x - 1.0;
        radius * DVec3::new(graded(x.x, grade), graded(x.y, grade), graded(x.z, grade)).normalize()
    };
    (vertices.iter().map(place).collect(), triangles)
}

/// Surface of the box from 0 to 1 along each axis, with two triangles for each square.
fn unit_box(cells: [u32; 3]) -> Surface {
    let size = UVec3::from_array(cells);
    let mut vertices = Vec::new();
    let mut triangles = Vec::new();
    let mut numbers = std::collections::BTreeMap::new();
    let mut vertex = |at: UVec3| {
        *numbers.entry(at.to_array()).or_insert_with(|| {
            vertices.push(at.as_dvec3() / size.as_dvec3());
            vertices.len() as u32 - 1
        })
    };
    for axis in 0..3 {
        // The other two axes, ordered so that this axis and they make a right-handed system.
        let along =
            [(axis + 1) % 3, (axis + 2) % 3].map(|k| UVec3::from_array(std::array::from_fn(|i| (i == k) as u32)));
        for side in [0, cells[axis]] {
            for i in 0..cells[(axis + 1) % 3] {
                for j in 0..cells[(axis + 2) % 3] {
                    let mut low = i * along[0] + j * along[1];
                    low[axis] = side;
                    let [a, b, c, d] =
                        [low, low + along[0], low + along[0] + along[1], low + along[1]].map(&mut vertex);
                    triangles.extend(if side > 0 { [[a, b, c], [a, c, d]] } else { [[a, c, b], [a, d, c]] });
                }
            }
        }
    }
    (vertices, triangles)
}

#[cfg(test)]
mod tests {
    use palpate::internal::prepare::mass::properties;

    use super::*;

    #[test]
    fn skins_are_closed_and_of_the_right_size() {
        let size = DVec3::new(0.04, 0.03, 0.05);
        let (vertices, triangles) = block_skin(size, [5, 4, 3], DVec3::new(2.0, 1.0, 0.0));
        let volume = properties(&vertices, &triangles).volume;
        assert!((volume / (0.08 * 0.03 * 0.1) - 1.0).abs() < 1e-12, "volume: {volume} m^3, expected 0.00024 m^3");
        let (vertices, triangles) = ball(0.02, 24, 3.0);
        let sphere = 4.0 / 3.0 * std::f64::consts::PI * 8e-6;
        let volume = properties(&vertices, &triangles).volume;
        assert!(volume < sphere && volume > 0.98 * sphere, "volume: {volume} m^3; sphere: {sphere} m^3");
        let (vertices, triangles) = dome(0.02, 32);
        let volume = properties(&vertices, &triangles).volume;
        assert!(
            volume < 0.5 * sphere && volume > 0.98 * 0.5 * sphere,
            "volume {volume} m^3, expected 98 to 100 % of half the ball"
        );
        assert!(vertices.iter().any(|x| x.length() < 1e-12) && vertices.iter().all(|x| x.y <= 1e-12));
    }

    #[test]
    fn grading_keeps_ends_and_makes_the_middle_finer() {
        assert_eq!((graded(-1.0, 3.0), graded(0.0, 3.0), graded(1.0, 3.0)), (-1.0, 0.0, 1.0));
        assert!((graded(1e-3, 3.0) / 1e-3 - 0.25).abs() < 1e-5);
    }
}
