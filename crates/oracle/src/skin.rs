//! The skin (surface mesh embedded in a tetrahedral mesh, the layer) in f64: vertex positions from the positions of the
//! layer's nodes, normals, areas. Reference implementation of the skin stage of a step.

use glam::DVec3;
use palpate::internal::prepare::{Embedding, Layer};

/// Values at skin vertices (positions, displacements or velocities) as weighted sums of values at nodes.
pub fn embed(embedding: &[Embedding], layer: &Layer, nodes: &[DVec3]) -> Vec<DVec3> {
    let sum = |e: &Embedding| {
        let corners = layer.tetrahedra[e.tetrahedron as usize];
        corners.iter().zip(e.weights).map(|(i, w)| nodes[*i as usize] * w).sum()
    };
    embedding.iter().map(sum).collect()
}

/// Unit outward normal of each vertex: the normalised sum of its triangles' area vectors; zero where the sum vanishes.
pub fn normals(positions: &[DVec3], triangles: &[[u32; 3]]) -> Vec<DVec3> {
    let mut sums = vec![DVec3::ZERO; positions.len()];
    for t in triangles {
        let area = area_vector(positions, t);
        for i in t {
            sums[*i as usize] += area;
        }
    }
    sums.into_iter().map(DVec3::normalize_or_zero).collect()
}

/// Area times outward normal of a triangle, m^2.
pub fn area_vector(positions: &[DVec3], triangle: &[u32; 3]) -> DVec3 {
    let [a, b, c] = triangle.map(|i| positions[i as usize]);
    (b - a).cross(c - a) * 0.5
}

/// Area of each vertex, m^2: a third of the areas of the adjacent triangles.
pub fn areas(positions: &[DVec3], triangles: &[[u32; 3]]) -> Vec<f64> {
    let mut areas = vec![0.0; positions.len()];
    for t in triangles {
        let third = area_vector(positions, t).length() / 3.0;
        for i in t {
            areas[*i as usize] += third;
        }
    }
    areas
}

/// The embedding of a skin whose vertices are all the layer's nodes, in order: a vertex has weight exactly 1 on its
/// node, in the first tetrahedron with that node. Vertices whose node belongs to no tetrahedron get weights of 0.
pub fn node_embedding(layer: &Layer) -> Vec<Embedding> {
    let mut embedding = vec![Embedding { tetrahedron: 0, weights: [0.0; 4] }; layer.nodes.len()];
    for (t, corners) in layer.tetrahedra.iter().enumerate().rev() {
        for (k, i) in corners.iter().enumerate() {
            let weights = std::array::from_fn(|l| if l == k { 1.0 } else { 0.0 });
            embedding[*i as usize] = Embedding { tetrahedron: t as u32, weights };
        }
    }
    embedding
}
