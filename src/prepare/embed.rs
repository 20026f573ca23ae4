//! Embeds the skin (surface mesh of a soft body) in the layer (tetrahedral simulation mesh): expresses the position of
//! each skin vertex as a weighted sum of the positions of the nodes of one tetrahedron. The simulation moves the skin
//! by these weights. At least one weight is negative if the vertex lies outside the tetrahedron: the position is then
//! extrapolated.

use glam::{DMat3, DVec3};
use parry3d_f64::math::Vector;
use parry3d_f64::query::PointQueryWithLocation;
use parry3d_f64::shape::TriMesh;

use super::{Embedding, Layer, layer};

/// A point whose least weight is at most this far below zero still counts as inside: the difference is due to rounding.
const INSIDE_ROUNDING: f64 = 1e-12;
/// A skin vertex whose distance from the layer exceeds this share of the diagonal of the layer's bounding box is
/// refused: skin and layer are then not in the same units or place.
const FARTHEST: f64 = 0.1;
/// A tetrahedron is flat if six times its volume is at most this share of the cube of its longest edge.
const FLAT: f64 = 1e-14;

/// Embeds every point in the layer (both in the same coordinates, m).
///
/// A point inside the layer gets the tetrahedron in which its least weight is largest (in a tie, the one with the
/// lowest index). A point outside gets one of the tetrahedra that share a node with the tetrahedron behind the nearest
/// boundary face: the one that extrapolates least (whose least weight is largest). A point exactly on a node gets
/// exactly the weight 1 for that node. It is an error if the layer is empty, if a tetrahedron is flat, or if a point
/// lies far outside the layer.
pub fn embed(points: &[DVec3], layer: &Layer) -> Result<Vec<Embedding>, String> {
    let grid = Grid::build(layer)?;
    let mut outside: Option<Outside> = None;
    let mut embeddings = Vec::with_capacity(points.len());
    for (v, &point) in points.iter().enumerate() {
        let (t, weights) = match grid.containing(layer, point) {
            Some(found) => found,
            None => {
                let surface = match &mut outside {
                    Some(surface) => surface,
                    None => outside.insert(Outside::build(layer)?),
                };
                let (t, distance) = surface.nearest(point);
                if distance > FARTHEST * grid.diagonal {
                    return Err(format!(
                        "skin vertex {v} lies {distance:.3e} m outside the layer, whose diagonal is {:.3e} m",
                        grid.diagonal
                    ));
                }
                surface.steadiest(layer, &grid, t, point)
            }
        };
        embeddings.push(Embedding { tetrahedron: t, weights });
    }
    Ok(embeddings)
}

/// The largest extrapolation: how far the least weight of all embeddings lies below zero; 0 if all points lie inside.
pub fn extrapolation(embeddings: &[Embedding]) -> f64 {
    embeddings.iter().flat_map(|e| e.weights).fold(0.0, |worst: f64, w| worst.max(-w))
}

/// A uniform grid over the layer that lists, for each cell, the tetrahedra whose bounding boxes meet it, ascending. The
/// list of cell c is `entries[start[c]..start[c + 1]]`.
struct Grid {
    low: DVec3,
    high: DVec3,
    /// Cells per metre along each axis.
    rate: DVec3,
    size: [usize; 3],
    start: Vec<u32>,
    entries: Vec<u32>,
    /// For each tetrahedron, the matrix from a position relative to its node 0 to the weights of nodes 1 to 3.
    inverses: Vec<DMat3>,
    diagonal: f64,
}

impl Grid {
    fn build(layer: &Layer) -> Result<Self, String> {
        let inverses = inverses(layer)?;
        let corners = || layer.tetrahedra.iter().flatten().map(|&i| layer.nodes[i as usize]);
        let low = corners().fold(DVec3::INFINITY, DVec3::min);
        let high = corners().fold(DVec3::NEG_INFINITY, DVec3::max);
        let extent = high - low;
        // With about one cell per tetrahedron, a cell lists a few tens of tetrahedra.
        let edge = (extent.x * extent.y * extent.z / layer.tetrahedra.len() as f64).cbrt();
        let size = extent.to_array().map(|e| ((e / edge) as usize).clamp(1, 512));
        let rate = DVec3::new(size[0] as f64, size[1] as f64, size[2] as f64) / extent;
        let mut grid =
            Grid { low, high, rate, size, start: Vec::new(), entries: Vec::new(), inverses, diagonal: extent.length() };
        grid.fill(layer);
        Ok(grid)
    }

    /// Fills the lists in two passes: the first counts the entries of each cell, the second writes them.
    fn fill(&mut self, layer: &Layer) {
        let mut start = vec![0u32; self.size.iter().product::<usize>() + 1];
        for pass in 0..2 {
            for (t, tetrahedron) in layer.tetrahedra.iter().enumerate() {
                let p = tetrahedron.map(|i| layer.nodes[i as usize]);
                let a = self.cell(p[0].min(p[1]).min(p[2].min(p[3])));
                let b = self.cell(p[0].max(p[1]).max(p[2].max(p[3])));
                for (z, y, x) in
                    (a[2]..=b[2]).flat_map(|z| (a[1]..=b[1]).flat_map(move |y| (a[0]..=b[0]).map(move |x| (z, y, x))))
                {
                    let c = x + self.size[0] * (y + self.size[1] * z);
                    if pass == 1 {
                        self.entries[start[c] as usize] = t as u32;
                        start[c] += 1;
                    } else {
                        start[c + 1] += 1;
                    }
                }
            }
            if pass == 0 {
                for c in 1..start.len() {
                    start[c] += start[c - 1];
                }
                self.entries = vec![0; start[start.len() - 1] as usize];
            }
        }
        // Writing has advanced the start of each cell to the start of the next cell. The shift by one undoes this.
        start.rotate_right(1);
        start[0] = 0;
        self.start = start;
    }

    /// The cell of a point, clamped to the grid.
    fn cell(&self, point: DVec3) -> [usize; 3] {
        let c = (point - self.low) * self.rate;
        [0, 1, 2].map(|k| (c[k] as usize).min(self.size[k] - 1))
    }

    /// Weights of a point on the four nodes of tetrahedron `t`; exactly 1 on a node that coincides with the point.
    fn weights(&self, layer: &Layer, t: u32, point: DVec3) -> [f64; 4] {
        let nodes = layer.tetrahedra[t as usize].map(|i| layer.nodes[i as usize]);
        if let Some(k) = nodes.iter().position(|&n| n == point) {
            return [0, 1, 2, 3].map(|i| if i == k { 1.0 } else { 0.0 });
        }
        let w = self.inverses[t as usize] * (point - nodes[0]);
        [1.0 - w.x - w.y - w.z, w.x, w.y, w.z]
    }

    /// Finds, of the tetrahedra that contain the point, the one in which the least weight of the point is largest.
    /// Returns its index and the weights; `None` if no tetrahedron contains the point.
    fn containing(&self, layer: &Layer, point: DVec3) -> Option<(u32, [f64; 4])> {
        if point.cmplt(self.low).any() || point.cmpgt(self.high).any() {
            return None;
        }
        let [x, y, z] = self.cell(point);
        let c = x + self.size[0] * (y + self.size[1] * z);
        let mut best: Option<(f64, u32, [f64; 4])> = None;
        for &t in &self.entries[self.start[c] as usize..self.start[c + 1] as usize] {
            let weights = self.weights(layer, t, point);
            let least = weights.iter().copied().fold(f64::INFINITY, f64::min);
            if weights.contains(&1.0) && least == 0.0 {
                return Some((t, weights));
            }
            if least >= -INSIDE_ROUNDING && best.is_none_or(|(l, ..)| least > l) {
                best = Some((least, t, weights));
            }
        }
        best.map(|(_, t, weights)| (t, weights))
    }
}

/// For each tetrahedron, the matrix from a position relative to its node 0 to the weights of nodes 1 to 3.
fn inverses(layer: &Layer) -> Result<Vec<DMat3>, String> {
    if layer.tetrahedra.is_empty() {
        return Err("the layer has no tetrahedra".into());
    }
    let mut inverses = Vec::with_capacity(layer.tetrahedra.len());
    for (t, tetrahedron) in layer.tetrahedra.iter().enumerate() {
        let [a, b, c, d] = tetrahedron.map(|i| layer.nodes[i as usize]);
        let edges = DMat3::from_cols(b - a, c - a, d - a);
        let longest = [b - a, c - a, d - a, c - b, d - b, d - c].map(|e| e.length()).into_iter().fold(0.0, f64::max);
        let determinant = edges.determinant().abs();
        // The condition refuses a NaN too.
        if determinant.is_nan() || determinant <= FLAT * longest.powi(3) {
            return Err(format!("tetrahedron {t} of the layer has no volume"));
        }
        inverses.push(edges.inverse());
    }
    Ok(inverses)
}

/// The layer's boundary surface, with the tetrahedron behind each of its faces: finds tetrahedra for points outside.
struct Outside {
    surface: TriMesh,
    tetrahedra: Vec<u32>,
    /// Tetrahedra around each node, ascending.
    around: Vec<Vec<u32>>,
}

impl Outside {
    fn build(layer: &Layer) -> Result<Self, String> {
        let (vertices, triangles, _) = layer::boundary(layer);
        let tetrahedra = layer::boundary_faces(&layer.tetrahedra).into_iter().map(|(_, t)| t).collect();
        let vertices = vertices.into_iter().map(|p| Vector::new(p.x, p.y, p.z)).collect();
        let surface = TriMesh::new(vertices, triangles).map_err(|e| format!("the layer has no boundary: {e}"))?;
        let mut around = vec![Vec::new(); layer.nodes.len()];
        for (t, tetrahedron) in layer.tetrahedra.iter().enumerate() {
            tetrahedron.iter().for_each(|&n| around[n as usize].push(t as u32));
        }
        Ok(Outside { surface, tetrahedra, around })
    }

    /// Of the tetrahedra that share a node with `t`, the one that extrapolates least to the point, and the weights in
    /// it. Tetrahedron `t`, which lies behind the nearest face, may be a sliver with large weights: a weight of 3 would
    /// treble every motion of its node.
    fn steadiest(&self, layer: &Layer, grid: &Grid, t: u32, point: DVec3) -> (u32, [f64; 4]) {
        let least = |w: &[f64; 4]| w.iter().copied().fold(f64::INFINITY, f64::min);
        let mut best = (t, grid.weights(layer, t, point));
        for &other in layer.tetrahedra[t as usize].iter().flat_map(|&n| &self.around[n as usize]) {
            let weights = grid.weights(layer, other, point);
            if least(&weights) > least(&best.1) {
                best = (other, weights);
            }
        }
        best
    }

    /// The tetrahedron behind the nearest boundary face, and the distance to that face, m.
    fn nearest(&self, point: DVec3) -> (u32, f64) {
        let point = Vector::new(point.x, point.y, point.z);
        let (projection, (face, _)) = self.surface.project_local_point_and_get_location(point, false);
        (self.tetrahedra[face as usize], (projection.point - point).length())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Allowed error, m, of a point that is reconstructed from its weights in f64; the point lies within about 1.3 m of
    /// the origin.
    const RECONSTRUCTION: f64 = 1e-13;

    fn place(layer: &Layer, e: &Embedding) -> DVec3 {
        e.interpolate(&layer.tetrahedra, &layer.nodes)
    }

    #[test]
    fn nodes_get_weight_one_and_points_come_back() {
        let layer = layer::kuhn_box(DVec3::new(-0.3, 0.0, 0.1), DVec3::new(0.5, 0.7, 1.0), [3, 4, 5]);
        for (e, &node) in embed(&layer.nodes, &layer).unwrap().iter().zip(&layer.nodes) {
            assert_eq!(place(&layer, e), node);
            assert_eq!(e.weights.iter().filter(|&&w| w == 1.0).count(), 1);
        }
        let points: Vec<DVec3> = (1..200u32)
            .map(|i| DVec3::new(i as f64 * 0.137, i as f64 * 0.319, i as f64 * 0.531).map(f64::fract))
            .map(|p| DVec3::new(-0.3, 0.0, 0.1) + p * DVec3::new(0.8, 0.7, 0.9))
            .collect();
        let embeddings = embed(&points, &layer).unwrap();
        for (e, &p) in embeddings.iter().zip(&points) {
            assert!(place(&layer, e).distance(p) < RECONSTRUCTION);
            assert!(e.weights.iter().all(|&w| w >= -INSIDE_ROUNDING));
        }
        assert!(extrapolation(&embeddings) <= INSIDE_ROUNDING);
        let mut spoiled = embeddings[7];
        spoiled.weights[2] += 1e-9;
        assert!(place(&layer, &spoiled).distance(points[7]) > RECONSTRUCTION);
    }

    #[test]
    fn a_point_outside_is_extrapolated_from_the_nearest_tetrahedron() {
        let layer = layer::kuhn_box(DVec3::ZERO, DVec3::ONE, [4, 4, 4]);
        let point = DVec3::new(0.55, 1.03, 0.4);
        let e = embed(&[point], &layer).unwrap();
        assert!(place(&layer, &e[0]).distance(point) < RECONSTRUCTION);
        let nodes = layer.tetrahedra[e[0].tetrahedron as usize].map(|i| layer.nodes[i as usize]);
        assert_eq!(nodes.iter().filter(|n| n.y == 1.0).count(), 3);
        // The point is 0.03 m above a cell of height 0.25 m, so that its least weight is -0.03 / 0.25 = -0.12.
        assert!(
            (extrapolation(&e) - 0.12).abs() < 1e-12,
            "greatest extrapolation {}, expected 0.12",
            extrapolation(&e)
        );
    }

    #[test]
    fn a_point_far_away_and_a_flat_or_empty_layer_are_refused() {
        let mut layer = layer::kuhn_box(DVec3::ZERO, DVec3::ONE, [2, 2, 2]);
        assert!(embed(&[DVec3::new(0.5, 3.0, 0.5)], &layer).unwrap_err().contains("vertex 0 lies 2.000e0 m outside"));
        layer.tetrahedra[5][3] = layer.tetrahedra[5][0];
        assert!(embed(&[DVec3::ZERO], &layer).unwrap_err().contains("tetrahedron 5"));
        assert!(embed(&[DVec3::ZERO], &Layer::default()).is_err());
    }
}
