//! Small meshes for the laws' tests.

use glam::DVec3;

use crate::prepare::Layer;

/// A box of Kuhn cells; nodes x fastest, then y, then z; nothing bound.
pub fn kuhn_box(low: DVec3, high: DVec3, cells: [usize; 3]) -> Layer {
    let [nx, ny, nz] = cells;
    let index = |x: usize, y: usize, z: usize| (x + (nx + 1) * (y + (ny + 1) * z)) as u32;
    let mut layer = Layer::default();
    for z in 0..=nz {
        for y in 0..=ny {
            for x in 0..=nx {
                let t = DVec3::new(x as f64 / nx as f64, y as f64 / ny as f64, z as f64 / nz as f64);
                layer.nodes.push(low + t * (high - low));
            }
        }
    }
    // Each path from corner 000 to 111 along the axes in this order is a tetrahedron; odd orders swap two nodes.
    let paths = [
        ([0, 1, 2], true),
        ([1, 2, 0], true),
        ([2, 0, 1], true),
        ([0, 2, 1], false),
        ([2, 1, 0], false),
        ([1, 0, 2], false),
    ];
    for z in 0..nz {
        for y in 0..ny {
            for x in 0..nx {
                for (axes, even) in paths {
                    let mut at = [x, y, z];
                    let mut t = [index(x, y, z); 4];
                    for (k, axis) in axes.into_iter().enumerate() {
                        at[axis] += 1;
                        t[k + 1] = index(at[0], at[1], at[2]);
                    }
                    if !even {
                        t.swap(1, 2);
                    }
                    layer.tetrahedra.push(t);
                }
            }
        }
    }
    layer.bound = vec![false; layer.nodes.len()];
    layer
}

/// The boundary triangles of a layer, outward; vertices are nodes.
pub fn boundary(layer: &Layer) -> Vec<[u32; 3]> {
    let mut faces = std::collections::BTreeMap::new();
    for t in &layer.tetrahedra {
        for f in [[t[0], t[2], t[1]], [t[0], t[1], t[3]], [t[1], t[2], t[3]], [t[0], t[3], t[2]]] {
            let mut key = f;
            key.sort_unstable();
            if faces.remove(&key).is_none() {
                faces.insert(key, f);
            }
        }
    }
    faces.into_values().collect()
}

/// Numbers in [-1, 1], the same every time.
pub struct Random(pub u64);

impl Random {
    /// The next number.
    pub fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// A vector of three.
    pub fn vector(&mut self) -> DVec3 {
        DVec3::new(self.next(), self.next(), self.next())
    }
}
