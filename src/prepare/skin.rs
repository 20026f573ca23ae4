//! Vertex areas and topology of the skin (the triangle mesh of a body that is seen and touched). They are computed
//! once, before the first step; the contact stage uses them in every step.

use glam::DVec3;

use super::Skin;

/// Makes a skin of vertex positions (m, rest frame of the body) and triangles, counter-clockwise seen from outside.
/// Every index must be below the number of vertices (the readers of mesh files check this).
pub fn build(vertices: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> Skin {
    let mut areas = vec![0.0; vertices.len()];
    for triangle in &triangles {
        let [a, b, c] = triangle.map(|i| vertices[i as usize]);
        let third = (b - a).cross(c - a).length() / 6.0;
        for &i in triangle {
            areas[i as usize] += third;
        }
    }
    Skin { vertices, triangles, areas }
}

/// Counts defective edges. The first number counts edges with one triangle. The second number counts edges with three
/// or more triangles, and edges with two triangles that run along the edge in the same direction.
pub fn defects(triangles: &[[u32; 3]]) -> (usize, usize) {
    let mut edges: Vec<(u32, u32, bool)> = Vec::with_capacity(3 * triangles.len());
    for &[a, b, c] in triangles {
        edges.extend([(a, b), (b, c), (c, a)].map(|(a, b)| (a.min(b), a.max(b), a < b)));
    }
    edges.sort_unstable();
    let mut counts = (0, 0);
    for group in edges.chunk_by(|e, f| (e.0, e.1) == (f.0, f.1)) {
        match group {
            [_] => counts.0 += 1,
            [e, f] if e.2 != f.2 => {}
            _ => counts.1 += 1,
        }
    }
    counts
}

/// Parts of a triangle mesh that are connected through shared vertices: the part of each vertex, and the number of
/// parts. Parts are numbered in the order of their least vertices; a vertex that belongs to no triangle is a part by
/// itself.
pub fn parts(vertex_count: usize, triangles: &[[u32; 3]]) -> (Vec<u32>, usize) {
    let mut sets = Sets::new(vertex_count);
    for t in triangles {
        sets.join(t[0], t[1]);
        sets.join(t[1], t[2]);
    }
    sets.labels()
}

/// Disjoint sets of indices (union-find). A set's representative is always its least member, so that labels do not
/// depend on the order of joining.
pub struct Sets(Vec<u32>);

impl Sets {
    /// Makes `count` sets with one index each.
    pub fn new(count: usize) -> Self {
        Sets((0..count as u32).collect())
    }

    /// The least member of the set that contains `i`.
    pub fn find(&mut self, mut i: u32) -> u32 {
        while self.0[i as usize] != i {
            self.0[i as usize] = self.0[self.0[i as usize] as usize];
            i = self.0[i as usize];
        }
        i
    }

    /// Joins the sets that contain `i` and `j`.
    pub fn join(&mut self, i: u32, j: u32) {
        let (a, b) = (self.find(i), self.find(j));
        let (low, high) = (a.min(b), a.max(b));
        self.0[high as usize] = low;
    }

    /// A label for each index, numbered from 0 in the order of the sets' least members, and the number of sets.
    pub fn labels(mut self) -> (Vec<u32>, usize) {
        let mut labels = vec![0; self.0.len()];
        let mut count = 0;
        for i in 0..self.0.len() as u32 {
            let root = self.find(i);
            if root == i {
                labels[i as usize] = count;
                count += 1;
            } else {
                labels[i as usize] = labels[root as usize];
            }
        }
        (labels, count as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_vertex_has_a_third_of_the_area_of_its_triangles() {
        let v = [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]].map(DVec3::from_array);
        let skin = build(v.to_vec(), vec![[0, 1, 2], [0, 2, 3]]);
        assert_eq!(defects(&skin.triangles), (4, 0));
        let expected = [1.0 / 3.0, 1.0 / 6.0, 1.0 / 3.0, 1.0 / 6.0];
        for (area, want) in skin.areas.iter().zip(expected) {
            assert!((area - want).abs() < 1e-15);
        }
    }

    #[test]
    fn a_flipped_triangle_and_a_third_triangle_are_defects() {
        assert_eq!(defects(&[[0, 1, 2], [0, 1, 3]]), (4, 1));
        assert_eq!(defects(&[[0, 1, 2], [1, 0, 3], [0, 1, 4]]), (6, 1));
    }

    #[test]
    fn parts_are_numbered_by_their_least_vertex() {
        let (labels, count) = parts(7, &[[5, 6, 1], [0, 4, 2]]);
        assert_eq!((labels, count), (vec![0, 1, 0, 2, 0, 1, 1], 3));
    }
}
