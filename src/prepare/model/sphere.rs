//! Generates a sphere for scenes without files, of radius 1 m about the origin.

use glam::DVec3;

use super::Blank;

/// A sphere with exactly `vertex_count` vertices.
pub fn sphere(vertex_count: usize) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let blank = Blank {
        solid: |p: DVec3| p.length() - 1.0,
        bounds: [DVec3::splat(-1.3), DVec3::splat(1.3)],
        inside: DVec3::ZERO,
        vertices_per_cell: 55.0,
        coarsest: 0.3,
    };
    blank.surface(vertex_count)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vertices_lie_on_the_sphere() {
        for count in [100, 2_500] {
            let off = sphere(count).0.iter().map(|v| (v.length() - 1.0).abs()).fold(0.0, f64::max);
            assert!(off < 1e-6, "{count} vertices: a vertex is {off} m off the sphere");
        }
    }
}
