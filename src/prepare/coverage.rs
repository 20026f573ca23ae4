//! Share of the vertices of the skin (surface mesh) that lie inside the collision proxies (convex hulls that cover the
//! skin). A proxy is *inflated* by moving its faces outwards by its margin. Each vertex is owned by exactly one proxy,
//! but counts as covered if it lies inside any inflated proxy.

use super::{Proxy, Skin};

/// Tolerance that lets a point on an inflated face count as inside: the rounding error of the point's distance from the
/// face's plane, as a share of the greatest magnitude of a coordinate of the skin's vertices.
const ROUNDING: f64 = 1e-12;

/// Share of the skin's vertices (only those that triangles use) inside at least one inflated proxy. The share is 1 if
/// the proxies were made correctly. A vertex is first tested against the proxy that owns it, so that the cost is about
/// the number of vertices times the number of faces of one hull.
pub fn share(skin: &Skin, proxies: &[Proxy]) -> f64 {
    let mut used = vec![false; skin.vertices.len()];
    skin.triangles.iter().flatten().for_each(|&v| used[v as usize] = true);
    let count = used.iter().filter(|&&used| used).count();
    let size = skin.vertices.iter().map(|v| v.abs().max_element()).fold(0.0, f64::max);
    let inside = |proxy: &Proxy, v: u32| {
        let x = skin.vertices[v as usize];
        proxy.faces.iter().all(|(n, d)| n.dot(x) - d <= proxy.margin + ROUNDING * size)
    };
    let mut covered = vec![false; skin.vertices.len()];
    for proxy in proxies {
        proxy.vertices.iter().for_each(|&v| covered[v as usize] = inside(proxy, v));
    }
    for (v, covered) in covered.iter_mut().enumerate().filter(|(_, covered)| !**covered) {
        *covered = proxies.iter().any(|proxy| inside(proxy, v as u32));
    }
    let inside = covered.iter().zip(&used).filter(|&(covered, used)| *covered && *used).count();
    if count == 0 { 1.0 } else { inside as f64 / count as f64 }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::prepare::cache::Cache;
    use crate::prepare::tests::scene;
    use crate::prepare::{Body, Embedding, Layer, Shape, body_and_report, embed, proxies, skin};
    use crate::scene;
    use crate::stages::model::Model;

    /// Tolerance for the rounding of margins and weights to f32 on the GPU. A vertex may stick out of its inflated
    /// proxy by this length (m), and in addition by this share of the inflation.
    const SINGLE: f64 = 1e-6;

    /// A soft body in the shape of a head, with its arrays for the GPU. The skin is enlarged by the share `stand_off`,
    /// so that it lies outside the layer (tetrahedral mesh) in places, where its embedding weights extrapolate.
    fn head(stand_off: f64) -> (Body, Model) {
        let surface = Some(scene::Surface::Model { model: scene::Model::Head, vertices: 3000 });
        let scene = scene(
            scene::Shape::Soft { surface, layer: scene::Layer::Cell { cell: 0.02, grade: 1, thickness: None } },
            &[],
        );
        let (mut body, _) = body_and_report(&scene.bodies[0], &scene, &Cache::off(), &mut |_| Ok(())).unwrap();
        if let Shape::Soft { layer, embedding, skin, proxies, .. } = &mut body.shape {
            let lifted = skin.vertices.iter().map(|v| *v * (1.0 + stand_off)).collect();
            *skin = skin::build(lifted, skin.triangles.clone());
            *embedding = embed(&skin.vertices, layer).unwrap();
            *proxies = super::super::proxies(skin).unwrap();
        }
        let model = Model::new(&scene, std::slice::from_ref(&body), None);
        (body, model)
    }

    /// A pseudo-random number from 0 to 1; the sequence is the same in every run.
    fn random(state: &mut u64) -> f64 {
        *state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (*state >> 11) as f64 / (1u64 << 53) as f64
    }

    fn random_vector(state: &mut u64) -> DVec3 {
        2.0 * DVec3::new(random(state), random(state), random(state)) - 1.0
    }

    /// Five displacement fields of the nodes: a smooth one, a rough one, one that is nonzero at only one node in fifty,
    /// one that is far larger than the body, and a rigid rotation.
    fn fields(nodes: &[DVec3]) -> Vec<Vec<DVec3>> {
        let mut state = 7;
        let turn = glam::DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 2.0) / 3.0, 2.0);
        let size = nodes.iter().map(|n| n.length()).fold(0.0, f64::max);
        let mut field =
            |of: &mut dyn FnMut(DVec3, &mut u64) -> DVec3| nodes.iter().map(|n| of(*n, &mut state)).collect();
        vec![
            field(&mut |n, _| 0.2 * size * DVec3::new((20.0 * n.y).sin(), (15.0 * n.z).cos(), (n.x * 30.0).sin())),
            field(&mut |_, s| 0.1 * size * random_vector(s)),
            field(&mut |_, s| if random(s) < 0.02 { 0.3 * size * random_vector(s) } else { DVec3::ZERO }),
            field(&mut |_, s| 20.0 * size * random_vector(s)),
            field(&mut |n, _| turn * n - n),
        ]
    }

    fn moved(e: &Embedding, layer: &Layer, d: &[DVec3]) -> DVec3 {
        let nodes = layer.tetrahedra[e.tetrahedron as usize];
        (0..4).map(|k| d[nodes[k] as usize] * e.weights[k]).sum()
    }

    /// A proxy needs a share of its inflation to contain its skin under the displacement field `d`. Returns the
    /// greatest of these shares; the skin is covered if it is at most 1. Under displacements a proxy's inflation is its
    /// margin plus the largest displacement of its nodes times the greatest sum of absolute embedding weights of its
    /// vertices; `weight`, if given, replaces this greatest sum.
    fn used(body: &Body, model: &Model, d: &[DVec3], weight: Option<f64>) -> f64 {
        let Shape::Soft { layer, embedding, skin, proxies, .. } = &body.shape else { panic!("the body is not soft") };
        let mut worst = 0.0f64;
        let mut covered = vec![false; skin.vertices.len()];
        for (proxy, on_device) in proxies.iter().zip(&model.proxies) {
            let nodes = &model.proxy_nodes[on_device.node_first as usize..][..on_device.node_count as usize];
            let farthest = nodes.iter().map(|&[n, _]| d[n as usize].length()).fold(0.0, f64::max);
            let weight = weight.unwrap_or(f64::from(on_device.weight_bound));
            let inflation = f64::from(on_device.margin) + weight * farthest;
            let drawn = proxy.triangles.iter().flat_map(|&t| skin.triangles[t as usize]);
            for v in drawn.chain(proxy.vertices.iter().copied()) {
                let x = skin.vertices[v as usize] + moved(&embedding[v as usize], layer, d);
                let height = proxy.faces.iter().map(|(n, o)| n.dot(x) - o).fold(f64::NEG_INFINITY, f64::max);
                worst = worst.max((height - SINGLE) / inflation.max(SINGLE));
                covered[v as usize] = true;
            }
        }
        assert!(covered.into_iter().all(|c| c));
        worst
    }

    #[test]
    fn skin_stays_within_inflated_proxies_under_any_deformation() {
        for stand_off in [0.0, 0.06] {
            let (body, model) = head(stand_off);
            let Shape::Soft { layer, embedding, .. } = &body.shape else { panic!("the body is not soft") };
            assert!(stand_off == 0.0 || embed::extrapolation(embedding) > 0.1);
            assert!(used(&body, &model, &vec![DVec3::ZERO; layer.nodes.len()], None) <= 1.0 + SINGLE);
            for (i, field) in fields(&layer.nodes).iter().enumerate() {
                let share = used(&body, &model, field, None);
                println!("skin enlarged by {stand_off}, displacement field {i}: {share:.3} of the inflation is needed");
                assert!(
                    share > 0.05 && share <= 1.0 + SINGLE,
                    "displacement field {i}: the skin needs {share} of the inflation, expected 0.05 to 1"
                );
            }
        }
    }

    /// Displaces the four nodes of the vertex that is extrapolated most: outwards where the vertex's weight is
    /// positive, inwards where it is negative, so that all four displacements move the vertex outwards. The proxy then
    /// needs nearly its whole inflation; with 1 in place of the sum of absolute weights, the inflation is too small.
    #[test]
    fn the_weights_of_extrapolated_skin_are_needed() {
        let (body, model) = head(0.06);
        let Shape::Soft { layer, embedding, proxies, .. } = &body.shape else { panic!("the body is not soft") };
        let sum = |e: &Embedding| e.weights.iter().map(|w| w.abs()).sum::<f64>();
        let most = (0..embedding.len()).max_by(|&a, &b| sum(&embedding[a]).total_cmp(&sum(&embedding[b]))).unwrap();
        let owner = proxies.iter().find(|p| p.vertices.contains(&(most as u32))).unwrap();
        let mut field = vec![DVec3::ZERO; layer.nodes.len()];
        for (n, w) in layer.tetrahedra[embedding[most].tetrahedron as usize].iter().zip(embedding[most].weights) {
            field[*n as usize] = owner.faces[0].0 * (10.0 * w.signum());
        }
        let share = used(&body, &model, &field, None);
        assert!(share > 0.9 && share <= 1.0 + SINGLE, "the skin needs {share} of the inflation, expected 0.9 to 1");
        assert!(used(&body, &model, &field, Some(1.0)) > 1.1);
    }

    #[test]
    fn each_proxy_draws_one_contiguous_range_and_each_triangle_has_one_owner() {
        let (body, model) = head(0.0);
        let Shape::Soft { skin, .. } = &body.shape else { panic!("the body is not soft") };
        let mut chunks = 0;
        for proxy in &model.proxies {
            assert_eq!(proxy.chunk_first, chunks);
            chunks += proxy.chunk_count;
        }
        assert_eq!(chunks as usize, model.chunks.len());
        let drawn = model.chunks.iter().flat_map(|chunk| {
            let first = chunk.triangle_first as usize;
            model.chunk_triangles[first..first + chunk.triangle_count as usize].to_vec()
        });
        let owned = model.chunks.iter().flat_map(|chunk| {
            let first = chunk.vertex_first as usize;
            model.chunk_vertices[first..first + chunk.vertex_count as usize].to_vec()
        });
        let permutation = |mut list: Vec<u32>, count: usize| {
            list.sort_unstable();
            list == (0..count as u32).collect::<Vec<_>>()
        };
        assert!(permutation(drawn.collect(), skin.triangles.len()));
        assert!(permutation(owned.collect(), skin.vertices.len()));
    }

    #[test]
    fn a_margin_too_small_shows_in_the_coverage() {
        let (vertices, triangles) = crate::prepare::model::surface(scene::Model::Head, 3000);
        let skin = skin::build(vertices, triangles);
        let mut proxies = proxies(&skin).unwrap();
        assert_eq!(share(&skin, &proxies), 1.0);
        proxies.iter_mut().for_each(|p| p.margin = 0.0);
        let less = share(&skin, &proxies);
        assert!(less > 0.1 && less < 0.9, "share of vertices covered without margins: {less}, expected 0.1 to 0.9");
    }
}
