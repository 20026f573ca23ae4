//! Functions for a *layer*, the tetrahedral simulation mesh of a soft body: they make the layer of a box, remove unused
//! nodes, and find a layer's boundary, volumes and connected parts.

use glam::DVec3;

use super::{Layer, skin::Sets};

/// Local node indices of the face opposite each node, counter-clockwise seen from outside if the tetrahedron's volume
/// is positive.
pub const FACES: [[usize; 3]; 4] = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];

/// The six Kuhn tetrahedra into which a cell is cut. The nodes of each tetrahedron form a path along three edges of the
/// cell, from the cell's low corner to its high corner. Each entry gives the order of the axes along this path, and
/// whether that order is an even permutation.
const KUHN: [([usize; 3], bool); 6] = [
    ([0, 1, 2], true),
    ([0, 2, 1], false),
    ([1, 0, 2], false),
    ([1, 2, 0], true),
    ([2, 0, 1], true),
    ([2, 1, 0], false),
];

/// The layer of a box from `low` to `high` (m), with `cells` cells along the axes. Nodes are numbered with x fastest,
/// then y, then z. Every cell is cut into six Kuhn tetrahedra around its diagonal from (0,0,0) to (1,1,1); all have a
/// positive volume if `low < high`.
pub fn kuhn_box(low: DVec3, high: DVec3, cells: [u32; 3]) -> Layer {
    let [nx, ny, nz] = cells;
    let node = |c: [u32; 3]| c[0] + (nx + 1) * (c[1] + (ny + 1) * c[2]);
    let mut layer = Layer::default();
    for z in 0..=nz {
        for y in 0..=ny {
            for x in 0..=nx {
                let t = DVec3::new(x as f64 / nx as f64, y as f64 / ny as f64, z as f64 / nz as f64);
                // This formula gives exactly `low` and `high` at the ends, which scenes with touching bodies or with
                // clamped faces may rely on.
                layer.nodes.push(low * (DVec3::ONE - t) + high * t);
            }
        }
    }
    for z in 0..nz {
        for y in 0..ny {
            for x in 0..nx {
                layer.tetrahedra.extend(KUHN.map(|(order, even)| kuhn_tetrahedron([x, y, z], order, even, node)));
            }
        }
    }
    layer.attached = vec![false; layer.nodes.len()];
    layer
}

/// The tetrahedron whose nodes lie on the path from the cell's low corner along the axes in `order`.
fn kuhn_tetrahedron(cell: [u32; 3], order: [usize; 3], even: bool, node: impl Fn([u32; 3]) -> u32) -> [u32; 4] {
    let mut corner = cell;
    let mut path = [node(corner); 4];
    for (step, axis) in order.into_iter().enumerate() {
        corner[axis] += 1;
        path[step + 1] = node(corner);
    }
    if !even {
        path.swap(2, 3);
    }
    path
}

/// Removes nodes that belong to no tetrahedron; the others keep their order. Returns the former index of each remaining
/// node.
pub fn drop_unused(layer: &mut Layer) -> Vec<u32> {
    let mut place = vec![super::NONE; layer.nodes.len()];
    layer.tetrahedra.iter().flatten().for_each(|&node| place[node as usize] = 0);
    let kept: Vec<u32> = (0..layer.nodes.len() as u32).filter(|&node| place[node as usize] == 0).collect();
    kept.iter().zip(0..).for_each(|(&node, new)| place[node as usize] = new);
    layer.nodes = kept.iter().map(|&node| layer.nodes[node as usize]).collect();
    layer.attached = kept.iter().map(|&node| layer.attached[node as usize]).collect();
    layer.tetrahedra.iter_mut().flatten().for_each(|node| *node = place[*node as usize]);
    kept
}

/// Six times the signed volume of a tetrahedron, m^3.
pub fn volume6(nodes: &[DVec3], tetrahedron: &[u32; 4]) -> f64 {
    let [a, b, c, d] = tetrahedron.map(|i| nodes[i as usize]);
    (b - a).dot((c - a).cross(d - a))
}

/// The boundary of a layer: its vertices in ascending order of node, its triangles (oriented outwards, in order of
/// their tetrahedra), and the node of each vertex.
pub fn boundary(layer: &Layer) -> (Vec<DVec3>, Vec<[u32; 3]>, Vec<u32>) {
    let faces = boundary_faces(&layer.tetrahedra);
    let mut used = vec![false; layer.nodes.len()];
    for &i in faces.iter().flat_map(|(triangle, _)| triangle) {
        used[i as usize] = true;
    }
    let nodes: Vec<u32> = (0..layer.nodes.len() as u32).filter(|&i| used[i as usize]).collect();
    let mut vertex = vec![super::NONE; layer.nodes.len()];
    for (v, &n) in nodes.iter().enumerate() {
        vertex[n as usize] = v as u32;
    }
    let vertices = nodes.iter().map(|&n| layer.nodes[n as usize]).collect();
    let triangles = faces.iter().map(|(triangle, _)| triangle.map(|n| vertex[n as usize])).collect();
    (vertices, triangles, nodes)
}

/// Faces that belong to one tetrahedron only: their nodes, counter-clockwise seen from outside, and the tetrahedron; in
/// order of tetrahedron, then face.
pub fn boundary_faces(tetrahedra: &[[u32; 4]]) -> Vec<([u32; 3], u32)> {
    let mut faces: Vec<([u32; 3], u32)> = Vec::with_capacity(4 * tetrahedra.len());
    for (t, tetrahedron) in tetrahedra.iter().enumerate() {
        for (f, face) in FACES.iter().enumerate() {
            let mut key = face.map(|k| tetrahedron[k]);
            key.sort_unstable();
            faces.push((key, 4 * t as u32 + f as u32));
        }
    }
    faces.sort_unstable();
    let mut open: Vec<u32> = faces.chunk_by(|a, b| a.0 == b.0).filter(|g| g.len() == 1).map(|g| g[0].1).collect();
    open.sort_unstable();
    let corners = |id: u32| FACES[(id % 4) as usize].map(|k| tetrahedra[(id / 4) as usize][k]);
    open.into_iter().map(|id| (corners(id), id / 4)).collect()
}

/// Parts of a layer that are connected through shared nodes: the part of each node, and the number of parts. A node
/// that belongs to no tetrahedron is a part by itself.
pub fn parts(layer: &Layer) -> (Vec<u32>, usize) {
    let mut sets = Sets::new(layer.nodes.len());
    for t in &layer.tetrahedra {
        for k in 1..4 {
            sets.join(t[0], t[k]);
        }
    }
    sets.labels()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::skin;

    #[test]
    fn a_box_is_filled_by_positive_tetrahedra_and_its_nodes_run_x_first() {
        let (low, high) = (DVec3::new(-1.0, 0.5, 2.0), DVec3::new(0.1, 0.8, 2.9));
        let layer = kuhn_box(low, high, [3, 2, 4]);
        assert_eq!((layer.nodes.len(), layer.tetrahedra.len()), (4 * 3 * 5, 6 * 24));
        assert_eq!((layer.nodes[0], layer.nodes[59]), (low, high));
        assert!(layer.nodes[1].x > low.x && layer.nodes[1].y == low.y && layer.nodes[4].y > low.y);
        let volumes: Vec<f64> = layer.tetrahedra.iter().map(|t| volume6(&layer.nodes, t) / 6.0).collect();
        assert!(volumes.iter().all(|&v| v > 0.0));
        let box_volume = (high - low).to_array().iter().product::<f64>();
        assert!((volumes.iter().sum::<f64>() - box_volume).abs() < 1e-12 * box_volume);
        // Each cell is cut around its diagonal: every tetrahedron of the first cell contains both ends of it.
        let diagonal = [0, 1 + 4 * (1 + 3)];
        assert!(layer.tetrahedra[..6].iter().all(|t| diagonal.iter().all(|n| t.contains(n))));
    }

    #[test]
    fn the_boundary_of_a_box_is_closed_outward_and_ascending() {
        let layer = kuhn_box(DVec3::ZERO, DVec3::ONE, [3, 3, 3]);
        let (vertices, triangles, nodes) = boundary(&layer);
        assert_eq!((vertices.len(), triangles.len()), (56, 6 * 9 * 2));
        assert!(nodes.windows(2).all(|w| w[0] < w[1]));
        let skin = skin::build(vertices, triangles);
        assert_eq!(skin::defects(&skin.triangles), (0, 0));
        assert!((skin.areas.iter().sum::<f64>() - 6.0).abs() < 1e-12);
        let middle = DVec3::splat(0.5);
        for t in &skin.triangles {
            let [a, b, c] = t.map(|i| skin.vertices[i as usize]);
            assert!((b - a).cross(c - a).dot(a - middle) > 0.0);
        }
    }

    #[test]
    fn two_boxes_are_two_parts() {
        let mut layer = kuhn_box(DVec3::ZERO, DVec3::ONE, [1, 1, 1]);
        let other = layer.tetrahedra.iter().map(|t| t.map(|i| i + 8)).collect::<Vec<_>>();
        layer.nodes.extend(layer.nodes.clone());
        layer.tetrahedra.extend(other);
        let (labels, count) = parts(&layer);
        assert_eq!(count, 2);
        assert_eq!((labels[7], labels[8]), (0, 1));
    }
}
