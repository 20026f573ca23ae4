//! Reduces a mesh to a given number of vertices by collapsing the shortest edge again and again.
//!
//! An edge may be collapsed only if its ends have exactly two common neighbours. This link condition (T. Dey and others
//! 1999) keeps a closed manifold closed, manifold and of the same genus.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::DVec3;

use crate::prepare::NONE;

/// Least cosine of the angle by which a collapse may turn a triangle's normal; the angle is about 80 degrees.
const LEAST_COSINE: f64 = 0.2;

/// Collapses the shortest edges of a closed manifold, each to its midpoint, until `count` vertices are left or no edge
/// may be collapsed. The remaining vertices and triangles keep their order.
pub fn to_count(vertices: Vec<DVec3>, triangles: Vec<[u32; 3]>, count: usize) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let mut mesh = Mesh::new(vertices, triangles);
    // If the bound on the turn of normals forbids too many collapses, the second pass, with a bound below any cosine,
    // checks the topology only.
    for least_cosine in [LEAST_COSINE, -2.0] {
        mesh.queue_all();
        while mesh.left > count {
            let Some(Reverse((length, a, b))) = mesh.queue.pop() else { break };
            if mesh.length(a, b).is_some_and(|now| now.to_bits() == length) {
                mesh.collapse(a, b, least_cosine);
            }
        }
    }
    mesh.compact()
}

/// A mesh while it is reduced. A removed vertex has no triangles; a removed triangle has the vertices [`NONE`].
struct Mesh {
    vertices: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    /// Remaining triangles around each vertex.
    around: Vec<Vec<u32>>,
    left: usize,
    /// Edges, the shortest first: the squared length as a bit pattern (non-negative floats have the order of their bit
    /// patterns), and the two ends in ascending order.
    queue: BinaryHeap<Reverse<(u64, u32, u32)>>,
}

impl Mesh {
    fn new(vertices: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> Self {
        let mut around = vec![Vec::new(); vertices.len()];
        for (t, triangle) in triangles.iter().enumerate() {
            triangle.iter().for_each(|&v| around[v as usize].push(t as u32));
        }
        let left = vertices.len();
        Mesh { vertices, triangles, around, left, queue: BinaryHeap::new() }
    }

    fn queue_all(&mut self) {
        self.queue.clear();
        for t in self.triangles.clone().into_iter().filter(|t| t[0] != NONE) {
            for k in 0..3 {
                if t[k] < t[(k + 1) % 3] {
                    self.push(t[k], t[(k + 1) % 3]);
                }
            }
        }
    }

    fn push(&mut self, a: u32, b: u32) {
        let length = self.vertices[a as usize].distance_squared(self.vertices[b as usize]);
        self.queue.push(Reverse((length.to_bits(), a.min(b), a.max(b))));
    }

    /// Squared length of an edge; `None` if the edge no longer exists.
    fn length(&self, a: u32, b: u32) -> Option<f64> {
        let alive = self.around[a as usize].iter().any(|&t| self.triangles[t as usize].contains(&b));
        alive.then(|| self.vertices[a as usize].distance_squared(self.vertices[b as usize]))
    }

    /// Neighbours of a vertex, ascending.
    fn neighbours(&self, v: u32) -> Vec<u32> {
        let corners = self.around[v as usize].iter().flat_map(|&t| self.triangles[t as usize]);
        let mut near: Vec<u32> = corners.filter(|&c| c != v).collect();
        near.sort_unstable();
        near.dedup();
        near
    }

    /// Moves `a` to the midpoint of the edge and merges `b` into it, if topology and normals allow it.
    fn collapse(&mut self, a: u32, b: u32, least_cosine: f64) {
        let near = self.neighbours(b);
        let shared = self.neighbours(a).into_iter().filter(|v| near.binary_search(v).is_ok()).count();
        let middle = (self.vertices[a as usize] + self.vertices[b as usize]) / 2.0;
        let folds = |&t: &u32| self.turn(t, a, b, middle) < least_cosine;
        let both = self.around[a as usize].iter().chain(&self.around[b as usize]);
        if shared != 2 || self.left <= 4 || both.into_iter().any(folds) {
            return;
        }
        self.vertices[a as usize] = middle;
        for t in std::mem::take(&mut self.around[b as usize]) {
            let triangle = self.triangles[t as usize];
            if triangle.contains(&a) {
                for v in triangle {
                    self.around[v as usize].retain(|&u| u != t);
                }
                self.triangles[t as usize] = [NONE; 3];
            } else {
                self.triangles[t as usize] = triangle.map(|v| if v == b { a } else { v });
                self.around[a as usize].push(t);
            }
        }
        self.left -= 1;
        for v in self.neighbours(a) {
            self.push(a, v);
        }
    }

    /// Cosine of the angle by which a triangle's normal turns when its corner at `a` or `b` moves to `to`; 1 if the
    /// collapse removes the triangle.
    fn turn(&self, t: u32, a: u32, b: u32, to: DVec3) -> f64 {
        let triangle = self.triangles[t as usize];
        if triangle.contains(&a) && triangle.contains(&b) {
            return 1.0;
        }
        let old = triangle.map(|v| self.vertices[v as usize]);
        let new = [0, 1, 2].map(|k| if triangle[k] == a || triangle[k] == b { to } else { old[k] });
        let normal = |[p, q, r]: [DVec3; 3]| (q - p).cross(r - p).normalize_or_zero();
        normal(old).dot(normal(new))
    }

    fn compact(self) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let mut number = vec![NONE; self.vertices.len()];
        let mut vertices = Vec::with_capacity(self.left);
        for (v, _) in self.around.iter().enumerate().filter(|(_, around)| !around.is_empty()) {
            number[v] = vertices.len() as u32;
            vertices.push(self.vertices[v]);
        }
        let alive = self.triangles.into_iter().filter(|t| t[0] != NONE);
        (vertices, alive.map(|t| t.map(|v| number[v as usize])).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::{mass, skin, sphere};

    #[test]
    fn a_sphere_stays_closed_down_to_any_count() {
        for count in [2561, 1000, 300, 12, 4] {
            let (vertices, triangles) = sphere::icosphere(1.0);
            let (vertices, triangles) = to_count(vertices, triangles, count);
            assert_eq!((vertices.len(), triangles.len()), (count, 2 * count - 4));
            let skin = skin::build(vertices, triangles);
            assert_eq!(skin::defects(&skin.triangles), (0, 0));
            let volume = mass::properties(&skin.vertices, &skin.triangles).volume;
            assert!(count < 300 || volume > 3.5, "{count} vertices: volume {volume}, expected more than 3.5");
        }
    }

    #[test]
    fn a_tetrahedron_is_left_alone() {
        let triangles = vec![[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];
        let vertices = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
        assert_eq!(to_count(vertices.clone(), triangles.clone(), 2), (vertices, triangles));
    }
}
