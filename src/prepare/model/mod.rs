//! Models made by the engine itself, so that scenes need no files.

/// Stand-in.
pub fn head(_vertex_count: usize) -> (Vec<glam::DVec3>, Vec<[u32; 3]>) {
    super::sphere::icosphere(0.1)
}
