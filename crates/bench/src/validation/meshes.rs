//! Grids of cells, each split into six tetrahedra.

use glam::{DVec3, UVec3};
use palpate::internal::prepare::Layer;

/// Six tetrahedra of a cell, whose corners are 0 to 3 around its lower face and 4 to 7 around its upper one, as SOFA
/// splits a hexahedron (class Hexa2TetraTopologicalMapping).
const SPLIT: [[usize; 4]; 6] = [[0, 5, 1, 6], [0, 1, 3, 6], [1, 3, 6, 2], [6, 3, 0, 7], [6, 7, 0, 5], [7, 5, 4, 0]];
/// Offsets of the corners of a cell.
const CORNERS: [UVec3; 8] = [
    UVec3::new(0, 0, 0),
    UVec3::new(1, 0, 0),
    UVec3::new(1, 1, 0),
    UVec3::new(0, 1, 0),
    UVec3::new(0, 0, 1),
    UVec3::new(1, 0, 1),
    UVec3::new(1, 1, 1),
    UVec3::new(0, 1, 1),
];

/// How the cells of a grid are split.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Split {
    /// All alike.
    Alike,
    /// Neighbours are mirror images of each other, so that a grid of an even number of cells has the symmetry of its
    /// box.
    Mirrored,
}

/// A box from `low` to `high` with this many cells along each axis. Nodes are in the order of x, then y, then z.
pub fn grid(low: DVec3, high: DVec3, cells: [u32; 3], split: Split) -> Layer {
    let cells = UVec3::from(cells);
    let counts = cells + 1;
    let index = |at: UVec3| at.x + counts.x * (at.y + counts.y * at.z);
    let place = |at: UVec3| low + (high - low) * at.as_dvec3() / cells.as_dvec3();
    let all = |counts: UVec3| {
        let planes = (0..counts.z).flat_map(move |z| (0..counts.y).map(move |y| (y, z)));
        planes.flat_map(move |(y, z)| (0..counts.x).map(move |x| UVec3::new(x, y, z)))
    };
    let mut tetrahedra = Vec::new();
    for cell in all(cells) {
        // SOFA mirrors along x in even cells, along y and z in odd ones.
        let is_odd = cell % 2;
        let mirror = match split {
            Split::Alike => UVec3::ZERO,
            Split::Mirrored => UVec3::new(1 - is_odd.x, is_odd.y, is_odd.z),
        };
        let corner = |k: usize| index(cell + (CORNERS[k] + mirror) % 2);
        let is_inside_out = mirror.element_sum() % 2 == 1;
        tetrahedra.extend(SPLIT.map(|tetrahedron| {
            let [a, b, c, d] = tetrahedron.map(corner);
            // A mirror image is inside out.
            if is_inside_out { [a, b, d, c] } else { [a, b, c, d] }
        }));
    }
    Layer { nodes: all(counts).map(place).collect(), tetrahedra, ..Layer::default() }
}

#[cfg(test)]
mod tests {
    use palpate::internal::prepare::layer::{boundary_faces, volume6};

    use super::*;

    #[test]
    fn a_grid_fills_its_box_and_neighbours_fit() {
        for split in [Split::Alike, Split::Mirrored] {
            let cells = [3, 2, 4];
            let layer = grid(DVec3::new(1.0, 2.0, 3.0), DVec3::new(1.3, 2.5, 3.2), cells, split);
            let volumes: Vec<f64> = layer.tetrahedra.iter().map(|t| volume6(&layer.nodes, t) / 6.0).collect();
            assert!(volumes.iter().all(|volume| *volume > 0.0), "{split:?}: a tetrahedron is inside out");
            assert!((volumes.iter().sum::<f64>() - 0.3 * 0.5 * 0.2).abs() < 1e-12);
            // Two triangles for each face of a cell on the boundary, and no faces inside that do not fit.
            assert_eq!(boundary_faces(&layer.tetrahedra).len(), 2 * 2 * (3 * 2 + 2 * 4 + 3 * 4), "{split:?}");
        }
    }

    #[test]
    fn tetrahedra_are_sofas() {
        // The first cell of a mirrored grid is mirrored along x: corners 0 and 1, 3 and 2, 4 and 5, 7 and 6 are
        // exchanged.
        let layer = grid(DVec3::ZERO, DVec3::ONE, [1, 1, 1], Split::Mirrored);
        let sets = |tetrahedra: &[[u32; 4]]| {
            let mut sets = tetrahedra.to_vec();
            sets.iter_mut().for_each(|t| t.sort_unstable());
            sets.sort_unstable();
            sets
        };
        // Corners 2, 3 and 6, 7 of a cell have indices 3, 2 and 7, 6 in the grid.
        let node = [0, 1, 3, 2, 4, 5, 7, 6];
        let exchanged = [1, 0, 3, 2, 5, 4, 7, 6];
        let want = [[0, 5, 6, 1], [0, 1, 6, 3], [1, 3, 2, 6], [6, 3, 7, 0], [6, 7, 5, 0], [7, 5, 0, 4]];
        let want = want.map(|tetrahedron: [usize; 4]| tetrahedron.map(|corner| node[exchanged[corner]]));
        assert_eq!(sets(&layer.tetrahedra), sets(&want));
        let alike = grid(DVec3::ZERO, DVec3::ONE, [1, 1, 1], Split::Alike);
        assert_eq!(sets(&alike.tetrahedra), sets(&SPLIT.map(|t| t.map(|corner| node[corner]))));
    }
}
