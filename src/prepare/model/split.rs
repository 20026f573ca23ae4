//! Adds vertices to a mesh without changing its surface: splits the longest edge within a flat face again and again.

use std::collections::{BinaryHeap, HashMap};

use glam::DVec3;

/// Greatest length of the x-y part of a face's unit normal, for the face to count as flat and perpendicular to z.
const FLAT: f64 = 1e-9;

/// Splits edges of a closed manifold, the longest edge first, until the mesh has `count` vertices or no edge is left.
/// Only edges between two faces that are both perpendicular to z are split.
pub fn to_count(vertices: &mut Vec<DVec3>, triangles: &mut Vec<[u32; 3]>, count: usize) {
    // The triangle to the left of each directed edge. The map is only looked up and never iterated, so the result does
    // not depend on hashing.
    let mut left: HashMap<(u32, u32), u32> = HashMap::new();
    for (t, triangle) in triangles.iter().enumerate() {
        left.extend((0..3).map(|k| ((triangle[k], triangle[(k + 1) % 3]), t as u32)));
    }
    let length =
        |vertices: &[DVec3], a: u32, b: u32| vertices[a as usize].distance_squared(vertices[b as usize]).to_bits();
    let is_flat = |t: u32| {
        let [a, b, c] = triangles[t as usize].map(|v| vertices[v as usize]);
        (b - a).cross(c - a).normalize_or_zero().truncate().length() < FLAT
    };
    let edges = triangles.iter().flat_map(|t| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])]).filter(|(a, b)| a < b);
    let flat = edges.filter(|&(a, b)| is_flat(left[&(a, b)]) && is_flat(left[&(b, a)]));
    let mut queue: BinaryHeap<(u64, u32, u32)> = flat.map(|(a, b)| (length(vertices, a, b), a, b)).collect();
    while vertices.len() < count {
        let Some((_, a, b)) = queue.pop() else { return };
        let middle = vertices.len() as u32;
        vertices.push((vertices[a as usize] + vertices[b as usize]) / 2.0);
        for (from, to) in [(a, b), (b, a)] {
            let t = left[&(from, to)];
            let far = triangles[t as usize].into_iter().find(|&v| v != from && v != to).unwrap_or(from);
            let new = triangles.len() as u32;
            triangles[t as usize] = [from, middle, far];
            triangles.push([middle, to, far]);
            left.extend([((from, middle), t), ((middle, far), t), ((far, from), t)]);
            left.extend([((middle, to), new), ((to, far), new), ((far, middle), new)]);
            queue.push((length(vertices, middle, far), far, middle));
        }
        queue.push((length(vertices, a, middle), a, middle));
        queue.push((length(vertices, b, middle), b, middle));
    }
}
