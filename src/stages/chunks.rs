//! Fills the arrays of collision proxies and chunks in the *model* (all arrays about the bodies that go to the GPU
//! once, before the first step). A *proxy* is a convex hull that covers a part of a body's *skin* (surface mesh) and
//! follows one *frame* (rigid coordinate frame). A *chunk* is the unit of culling: at most `CHUNK_VERTICES` skin
//! vertices of one proxy with at most `CHUNK_TRIANGLES` triangles. A *link* is the relative placement of two frames.
//! The skin of a soft body is embedded in a tetrahedral mesh, whose *nodes* move the skin's vertices.

use std::collections::HashSet;

use glam::{DMat3, DVec3};

use super::model::{Carrier, Model, texel};
use crate::prepare::{self, Skin};
use crate::shaders::{Chunk, Proxy};
use crate::stages::{CHUNK_TRIANGLES, CHUNK_VERTICES};

/// A second hull covers a face of a first hull if it contains the point this far outside the middle of the face, as a
/// share of the diagonal of the first hull's bounding box.
const COVERED: f64 = 0.02;

/// A chunk that is being made: its triangles and the vertices that it owns, as indices in the skin.
#[derive(Debug, Default, PartialEq)]
struct Part {
    triangles: Vec<u32>,
    vertices: Vec<u32>,
}

/// A box around `points` with one axis along the mean normal of the triangles of `part`, so that the box is thin where
/// the skin is flat. Returns the box's axes (columns), and its least and greatest coordinates along these axes (m).
fn rest_box(skin: &Skin, part: &Part, points: impl Iterator<Item = DVec3>) -> (DMat3, DVec3, DVec3) {
    let area = |t: &u32| {
        let [a, b, c] = skin.triangles[*t as usize].map(|v| skin.vertices[v as usize]);
        (b - a).cross(c - a)
    };
    let normal = part.triangles.iter().map(area).sum::<DVec3>().try_normalize().unwrap_or(DVec3::Z);
    let (u, v) = normal.any_orthonormal_pair();
    let axes = DMat3::from_cols(u, v, u.cross(v));
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for x in points.map(|x| axes.transpose() * x) {
        low = low.min(x);
        high = high.max(x);
    }
    (axes, low, high)
}

/// The nodes whose displacements move a set of skin vertices, and a bound on their influence. The number of nodes is
/// even. `weight_bound` is the greatest sum of absolute embedding weights that one of these vertices has.
#[derive(Default)]
struct Movers {
    nodes: Vec<u32>,
    weight_bound: f64,
}

impl Model {
    /// Adds the proxies of a skin that [`Model::add_skin`] has just added. `frame_first` and `vertex_first` are the
    /// indices of the body's first frame and first skin vertex in the model; `carrier` is the tetrahedral mesh in which
    /// the skin is embedded, `None` if there is none.
    pub(super) fn add_proxies(
        &mut self,
        skin: &Skin,
        proxies: &[prepare::Proxy],
        frame_first: usize,
        vertex_first: usize,
        carrier: Option<&Carrier>,
    ) {
        let triangle_first = self.triangles.len() - skin.triangles.len();
        for proxy in proxies {
            let frame = frame_first as u32 + proxy.frame;
            let centre = self.frames[frame as usize].rest_centre;
            let chunk_first = self.chunks.len();
            for part in cut(skin, proxy) {
                self.add_chunk(skin, &part, frame, (vertex_first, triangle_first), carrier);
            }
            let covered = covered(skin, &proxy.triangles, &proxy.vertices);
            let movers = movers(&covered, carrier);
            let (node_first, node_count) = (self.proxy_nodes.len(), movers.nodes.len());
            for node in movers.nodes {
                let link = self.link(frame, self.node_info[node as usize][2]);
                self.proxy_nodes.push([node, link]);
            }
            let faces = outer_faces(proxy, proxies);
            self.proxies.push(Proxy {
                frame,
                hull_first: self.hull.len() as u32,
                hull_count: proxy.hull.len() as u32,
                face_first: self.faces.len() as u32,
                face_count: faces.len() as u32,
                chunk_first: chunk_first as u32,
                chunk_count: (self.chunks.len() - chunk_first) as u32,
                node_first: node_first as u32,
                node_count: node_count as u32,
                margin: proxy.margin as f32,
                weight_bound: movers.weight_bound as f32,
                edge: mean_edge(skin, &proxy.triangles) as f32,
            });
            self.hull.extend(proxy.hull.iter().map(|x| texel(*x - centre, 0.0)));
            self.faces.extend(faces.iter().map(|(n, d)| texel(*n, d - n.dot(centre))));
        }
    }

    fn add_chunk(
        &mut self,
        skin: &Skin,
        part: &Part,
        frame: u32,
        (vertex_first, triangle_first): (usize, usize),
        carrier: Option<&Carrier>,
    ) {
        let centre = self.frames[frame as usize].rest_centre;
        let covered = covered(skin, &part.triangles, &part.vertices);
        // `besides` becomes the list of vertices that the chunk does not own but needs: corners of its triangles, and
        // neighbours of its own vertices, from which the normals of its own vertices are computed.
        let mut besides = covered.clone();
        for v in &part.vertices {
            let v = vertex_first + *v as usize;
            for t in &self.fans[self.fan_first[v] as usize..self.fan_first[v + 1] as usize] {
                besides.extend(&skin.triangles[*t as usize - triangle_first]);
            }
        }
        besides.sort_unstable();
        besides.dedup();
        let own: HashSet<u32> = part.vertices.iter().copied().collect();
        besides.retain(|v| !own.contains(v));

        let movers = movers(&covered, carrier);
        let rest = |v: &u32| skin.vertices[*v as usize] - centre;
        let (axes, low, high) = rest_box(skin, part, covered.iter().map(rest));
        // The added term makes up for the rounding of the box to f32 on the GPU.
        let half_extent = (high - low) * 0.5 + DVec3::splat(1e-6 * low.abs().max(high.abs()).max_element());
        let node_first = self.chunk_nodes.len();
        let node_count = movers.nodes.len();
        for node in movers.nodes {
            let link = self.link(frame, self.node_info[node as usize][2]);
            self.chunk_nodes.push([node, link]);
        }
        self.chunks.push(Chunk {
            centre: (axes * (low + high) * 0.5).as_vec3().to_array(),
            axes: [axes.x_axis, axes.y_axis].map(|axis| axis.as_vec3().to_array()),
            half_extent: half_extent.as_vec3().to_array(),
            weight_bound: movers.weight_bound as f32,
            vertex_first: self.chunk_vertices.len() as u32,
            vertex_count: part.vertices.len() as u32,
            embed_count: (part.vertices.len() + besides.len()) as u32,
            triangle_first: self.chunk_triangles.len() as u32,
            triangle_count: part.triangles.len() as u32,
            node_first: node_first as u32,
            node_count: node_count as u32,
        });
        self.chunk_vertices.extend(part.vertices.iter().chain(&besides).map(|v| v + vertex_first as u32));
        self.chunk_triangles.extend(part.triangles.iter().map(|t| t + triangle_first as u32));
    }
}

/// Cuts the skin of a proxy into parts that fit a chunk: a set of triangles is halved at the median along the longest
/// side of its bounding box until each part fits. A vertex belongs to the first part that has one of the vertex's
/// triangles; vertices without triangles form parts of their own at the end.
fn cut(skin: &Skin, proxy: &prepare::Proxy) -> Vec<Part> {
    let centre = |t: u32| skin.triangles[t as usize].iter().map(|v| skin.vertices[*v as usize]).sum::<DVec3>() / 3.0;
    let mut triangles: Vec<(DVec3, u32)> = proxy.triangles.iter().map(|t| (centre(*t), *t)).collect();
    let mut unowned: HashSet<u32> = proxy.vertices.iter().copied().collect();
    let mut parts = Vec::new();
    halve(skin, &mut triangles, &mut unowned, &mut parts);
    let mut lonely: Vec<u32> = unowned.into_iter().collect();
    lonely.sort_unstable();
    parts.extend(lonely.chunks(CHUNK_VERTICES).map(|v| Part { triangles: Vec::new(), vertices: v.to_vec() }));
    parts
}

fn halve(skin: &Skin, triangles: &mut [(DVec3, u32)], unowned: &mut HashSet<u32>, parts: &mut Vec<Part>) {
    if triangles.is_empty() {
        return;
    }
    if triangles.len() <= CHUNK_TRIANGLES {
        let mut vertices: Vec<u32> =
            triangles.iter().flat_map(|(_, t)| skin.triangles[*t as usize]).filter(|v| unowned.contains(v)).collect();
        vertices.sort_unstable();
        vertices.dedup();
        if vertices.len() <= CHUNK_VERTICES {
            vertices.iter().for_each(|v| {
                unowned.remove(v);
            });
            let mut triangles: Vec<u32> = triangles.iter().map(|(_, t)| *t).collect();
            triangles.sort_unstable();
            parts.push(Part { triangles, vertices });
            return;
        }
    }
    let low = triangles.iter().fold(DVec3::INFINITY, |low, (x, _)| low.min(*x));
    let high = triangles.iter().fold(DVec3::NEG_INFINITY, |high, (x, _)| high.max(*x));
    let extent = (high - low).to_array();
    let axis = (0..3).rev().max_by(|i, k| extent[*i].total_cmp(&extent[*k])).unwrap_or(0);
    let middle = triangles.len() / 2;
    triangles.select_nth_unstable_by(middle, |(x, t), (y, u)| x[axis].total_cmp(&y[axis]).then(t.cmp(u)));
    let (left, right) = triangles.split_at_mut(middle);
    halve(skin, left, unowned, parts);
    halve(skin, right, unowned, parts);
}

/// The vertices in `vertices` and the corners of `triangles`, sorted, each once.
fn covered(skin: &Skin, triangles: &[u32], vertices: &[u32]) -> Vec<u32> {
    let mut covered: Vec<u32> = triangles.iter().flat_map(|t| skin.triangles[*t as usize]).collect();
    covered.extend(vertices);
    covered.sort_unstable();
    covered.dedup();
    covered
}

/// The nodes that move the skin vertices `covered`; none if the skin is not embedded in a tetrahedral mesh.
fn movers(covered: &[u32], carrier: Option<&Carrier>) -> Movers {
    let Some(Carrier { layer, embedding, node_first }) = carrier else { return Movers::default() };
    let mut movers = Movers::default();
    for v in covered {
        let e = &embedding[*v as usize];
        for (node, weight) in layer.tetrahedra[e.tetrahedron as usize].iter().zip(e.weights) {
            if weight != 0.0 {
                movers.nodes.push(node + *node_first as u32);
            }
        }
        movers.weight_bound = movers.weight_bound.max(e.weights.iter().map(|w| w.abs()).sum());
    }
    movers.nodes.sort_unstable();
    movers.nodes.dedup();
    // The kernels read nodes two at a time.
    if movers.nodes.len() % 2 == 1 {
        movers.nodes.push(movers.nodes[movers.nodes.len() - 1]);
    }
    movers
}

/// The faces of a proxy's hull that no other hull of the same frame covers (see [`COVERED`]). A covered face lies
/// within the body, so another body cannot be pushed out along the face's normal. If every face is covered, all faces
/// are returned.
fn outer_faces(proxy: &prepare::Proxy, all: &[prepare::Proxy]) -> Vec<(DVec3, f64)> {
    let (low, high) =
        proxy.hull.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
    let slack = COVERED * low.distance(high);
    let covered = |(n, d): &(DVec3, f64)| {
        let corners: Vec<DVec3> = proxy.hull.iter().copied().filter(|x| n.dot(*x) > d - 1e-9 * slack).collect();
        let outside = corners.iter().sum::<DVec3>() / corners.len().max(1) as f64 + *n * slack;
        let within = |other: &prepare::Proxy| other.faces.iter().all(|(m, e)| m.dot(outside) <= *e);
        all.iter().any(|other| other.frame == proxy.frame && within(other))
    };
    let outer: Vec<(DVec3, f64)> = proxy.faces.iter().filter(|face| !covered(face)).copied().collect();
    if outer.is_empty() { proxy.faces.clone() } else { outer }
}

/// Mean edge length of the triangles with these indices, m.
fn mean_edge(skin: &Skin, triangles: &[u32]) -> f64 {
    let mut sum = 0.0;
    for t in triangles {
        let [a, b, c] = skin.triangles[*t as usize].map(|v| skin.vertices[v as usize]);
        sum += a.distance(b) + b.distance(c) + c.distance(a);
    }
    sum / (3 * triangles.len()).max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::skin;

    #[test]
    fn chunks_hold_each_vertex_and_triangle_once_and_stay_small() {
        let (vertices, triangles) = crate::prepare::model::surface(crate::scene::Model::Head, 6000);
        let head = skin::build(vertices, triangles);
        let proxies = prepare::proxies(&head).unwrap();
        let (mut owned, mut drawn, mut parts) = (vec![0; head.vertices.len()], vec![0; head.triangles.len()], 0);
        for proxy in &proxies {
            for part in cut(&head, proxy) {
                assert!(part.vertices.len() <= CHUNK_VERTICES && part.triangles.len() <= CHUNK_TRIANGLES);
                part.vertices.iter().for_each(|v| owned[*v as usize] += 1);
                part.triangles.iter().for_each(|t| drawn[*t as usize] += 1);
                parts += 1;
            }
        }
        assert!(owned.iter().chain(&drawn).all(|n| *n == 1));
        // Most chunks are at least about half full, because they are made by halving; this bounds their number.
        assert!(parts < 3 * head.vertices.len() / CHUNK_VERTICES, "{parts} chunks are too many");
    }
}
