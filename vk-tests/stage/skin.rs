//! Tests of the kernels skin/embed, which computes the positions of skin vertices (of the surface meshes), and
//! skin/probe, which collects the displacements of nodes for probed vertices. The spatial hash that skin/embed fills is
//! tested in ray_hits.rs. A chunk is a group of skin vertices and triangles; each chunk belongs to a collision proxy
//! (convex hull), and the proxy's inflation is how far skin may lie outside the hull.

use glam::{DQuat, DVec3};
use palpate::internal::prepare::{Body, Shape};
use palpate::internal::shaders;
use palpate::internal::shaders::{ActiveChunk, Chunk, ContactPatch, Frame, NONE, Pair, PairProxy};
use palpate::internal::stages::CHUNK_VERTICES;
use palpate::internal::stages::model::Model;
use palpate_oracle::{proximity, skin as oracle};

use crate::harness::bodies::{half_space, octants, rigid, soft, sphere, whole};
use crate::harness::random::Random;
use crate::harness::{Tolerance, case, context, expect_close};
use crate::stage::flow::{Flow, GRID_WORDS};

/// Error of positions of order one after a few f32 operations.
const PLACED: Tolerance = Tolerance { abs: 1e-6, rel: 1e-6 };

fn vector(x: &[f32; 4]) -> DVec3 {
    DVec3::new(x[0].into(), x[1].into(), x[2].into())
}

fn texels(random: &mut Random, count: usize) -> Vec<[f32; 4]> {
    (0..count).map(|_| [random.next() as f32, random.next() as f32, random.next() as f32, 0.0]).collect()
}

/// A soft ball in general position whose nodes are displaced by up to `size` (m) along each axis.
fn shaken(size: f64) -> (Body, Flow) {
    let mut random = Random(21);
    let place = DVec3::new(0.3, -0.2, 0.1);
    let ball = soft("ball", sphere(0.1, 3), octants, place, random.turn(3.0));
    let mut flow = Flow::new(std::slice::from_ref(&ball), None, DVec3::ZERO);
    for d in &mut flow.displacement {
        *d = (size * random.vector()).as_vec3().extend(0.0).to_array();
    }
    (ball, flow)
}

#[test]
fn no_skin_leaves_its_inflated_hull() {
    for size in [0.0, 0.01, 0.05] {
        let (_, mut flow) = shaken(size);
        flow.place();
        activate(&mut flow);
        flow.embed();
        for (proxy, bounds) in flow.model.proxies.iter().zip(&flow.bounds) {
            let faces = &flow.faces[proxy.face_first as usize..][..proxy.face_count as usize];
            for chunk in &flow.model.chunks[proxy.chunk_first as usize..][..proxy.chunk_count as usize] {
                for v in covered(&flow.model, chunk) {
                    let x = vector(&flow.skin[v as usize]);
                    let outside = faces.iter().map(|f| vector(f).dot(x) - f64::from(f[3])).fold(f64::MIN, f64::max);
                    assert!(
                        outside <= f64::from(bounds.inflation),
                        "a vertex lies {outside} m outside its hull; the inflation is {} m",
                        bounds.inflation
                    );
                }
            }
        }
    }
}

/// A chunk's own vertices and the corners of the chunk's triangles.
pub fn covered(model: &Model, chunk: &Chunk) -> Vec<u32> {
    let own = &model.chunk_vertices[chunk.vertex_first as usize..][..chunk.vertex_count as usize];
    let drawn = &model.chunk_triangles[chunk.triangle_first as usize..][..chunk.triangle_count as usize];
    let corners = drawn.iter().flat_map(|t| &model.triangles[*t as usize][..3]);
    own.iter().chain(corners).copied().collect()
}

/// Makes all chunks active against a half-space, so that no vertex goes into the spatial hash.
fn activate(flow: &mut Flow) {
    flow.pairs = vec![Pair { is_plane: 1, ..Pair::default() }];
    (flow.contact_patches, flow.depth_grids) = (vec![ContactPatch::default()], vec![0; GRID_WORDS]);
    flow.model.pair_proxies =
        (0..flow.model.proxies.len() as u32).map(|proxy| PairProxy { proxy, ..PairProxy::default() }).collect();
    flow.active_chunks = vec![];
    for (pair_proxy, proxy) in flow.model.proxies.iter().enumerate() {
        let chunks = proxy.chunk_first..proxy.chunk_first + proxy.chunk_count;
        flow.active_chunks.extend(chunks.map(|chunk| ActiveChunk {
            chunk,
            pair_proxy: pair_proxy as u32,
            ..Default::default()
        }));
    }
    flow.args[3 * shaders::ARGS_ACTIVE as usize] = flow.active_chunks.len() as u32;
}

#[test]
fn embedded_skin_is_where_the_oracle_has_it() {
    let (ball, mut flow) = shaken(0.03);
    activate(&mut flow);
    flow.embed();
    let Shape::Soft { layer, embedding, .. } = &ball.shape else { unreachable!() };
    let moved: Vec<DVec3> = layer.nodes.iter().zip(&flow.displacement).map(|(x, d)| *x + vector(d)).collect();
    let local = oracle::embed(embedding, layer, &moved);
    let want = local.iter().flat_map(|x| (ball.position + ball.orientation * *x).extend(1.0).to_array());
    let got: Vec<f32> = flow.skin.as_flattened().to_vec();
    expect_close("skin", &got, &want.collect::<Vec<_>>(), PLACED);
    assert!(flow.buckets.iter().all(|b| *b == NONE) && flow.hash_entries.iter().all(|b| b[3] == NONE - 1));
}

#[test]
fn rigid_skin_of_any_size_and_only_what_is_listed() {
    let width = context().reduce_size() as usize;
    let mut random = Random(4);
    for n in [0, 1, width - 1, width, width + 1, 64, 1234] {
        let ball = rigid("ball", sphere(1.0, 0), whole, DVec3::ZERO, DQuat::IDENTITY);
        let floor = half_space(DVec3::Y, 0.0);
        let mut flow = Flow::new(&[floor], Some(&ball), DVec3::ZERO);
        let (rotation, centre) = (random.turn(3.0), DVec3::new(1.0, 2.0, 3.0));
        flow.frames[0] =
            Frame { rotation: rotation.as_quat().to_array(), centre: centre.as_vec3().to_array(), ..Frame::default() };
        // A single chunk lists `n` vertices in falling order; the skin has twice as many vertices.
        let own = n.min(CHUNK_VERTICES) as u32;
        flow.model.chunks = vec![Chunk { vertex_count: own, embed_count: n as u32, ..Chunk::default() }];
        flow.model.chunk_vertices = (0..n.max(1) as u32).rev().collect();
        flow.model.skin_weights = texels(&mut random, 2 * n.max(1));
        flow.model.skin_nodes = vec![[NONE, 0, 0, 0]; 2 * n.max(1)];
        flow.skin = vec![[-5.0; 4]; 2 * n.max(1)];
        flow.model.proxies[0].chunk_count = 1;
        activate(&mut flow);
        flow.embed();
        let want = flow.model.skin_weights[..n]
            .iter()
            .flat_map(|x| proximity::embed(centre, rotation, [vector(x); 4], [0.25; 4]).extend(1.0).to_array());
        expect_close("skin", flow.skin[..n].as_flattened(), &want.collect::<Vec<_>>(), PLACED);
        assert!(flow.skin[n..].iter().all(|x| *x == [-5.0; 4]), "vertices that no chunk lists must stay as they were");
    }
}

#[test]
fn probes_of_any_number_are_the_displacements_of_their_nodes() {
    let width = context().group_size() as usize;
    let mut random = Random(6);
    let displacement = texels(&mut random, 50);
    for n in [0, 1, width - 1, width, width + 1, 1234] {
        let mut nodes: Vec<u32> = (0..n.max(1) as u32).map(|i| 7 * i % 50).collect();
        // One element stands for a vertex of a rigid skin, which has no nodes: it must give a displacement of zero.
        nodes[n / 2] = NONE;
        let out = case("skin/probe")
            .constant("PROBE_NODES", n as u32)
            .input("probe_nodes", &nodes)
            .input("displacement", &displacement)
            .output::<[f32; 4]>("probes", n)
            .elements(n)
            .run();
        let want = nodes.iter().take(n).map(|&i| displacement.get(i as usize).map_or([0.0; 4], |d| *d));
        assert_eq!(out.get::<[f32; 4]>("probes"), want.collect::<Vec<_>>());
    }
}
