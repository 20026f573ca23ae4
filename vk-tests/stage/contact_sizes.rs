//! Tests of the kernels contact/candidates (which finds the skin vertices that collide) and contact/response (which
//! computes the coefficients of contacts for the solver) for any number of elements. A candidate is a vertex of a skin
//! (surface mesh) that may be a contact. An entry is a node with its weight in a contact, and a quad is four entries;
//! each node has linked lists of its entries.

use glam::{DQuat, DVec3};
use palpate::internal::shaders;
use palpate::internal::shaders::{ActiveChunk, Chunk, Contact, Counts, NONE};
use palpate::internal::stages::CHUNK_VERTICES;

use crate::harness::bodies::{half_space, rigid, sphere, whole};
use crate::harness::random::Random;
use crate::harness::{Tolerance, expect_close};
use crate::stage::flow::Flow;
use crate::stage::sizes;

/// Tolerance of sums and products of a few f32 numbers of order one.
const CLOSE: Tolerance = Tolerance { abs: 1e-6, rel: 2e-6 };

/// A skin of `n` separate triangles that face down to a half-space, with chunks (groups of up to 64 vertices) that hold
/// the first corners of the triangles.
fn loose(n: usize, random: &mut Random) -> Flow {
    let ball = rigid("tool", sphere(1.0, 0), whole, DVec3::ZERO, DQuat::IDENTITY);
    let mut flow = Flow::new(&[half_space(DVec3::Y, 0.0)], Some(&ball), DVec3::ZERO);
    let model = &mut flow.model;
    (flow.skin, model.triangles, model.fan_first, model.fans) = (vec![], vec![], vec![0], vec![]);
    for i in 0..n.max(1) as u32 {
        let place = random.vector();
        for corner in [DVec3::ZERO, DVec3::X, DVec3::Z] {
            flow.skin.push((place + 0.1 * corner).as_vec3().extend(7.0).to_array());
            model.fans.push(i);
            model.fan_first.push(model.fans.len() as u32);
        }
        model.triangles.push([3 * i, 3 * i + 1, 3 * i + 2, 0]);
    }
    model.skin_areas = (0..flow.skin.len()).map(|i| 0.5 + (i % 7) as f32).collect();
    model.chunk_vertices = (0..n as u32).map(|i| 3 * i).collect();
    let chunk = |first: usize| Chunk {
        vertex_first: first as u32,
        vertex_count: (n - first).min(CHUNK_VERTICES) as u32,
        ..Chunk::default()
    };
    model.chunks = (0..n).step_by(CHUNK_VERTICES).map(chunk).collect();
    let chunks = model.chunks.len() as u32;
    flow.active_chunks = (0..chunks)
        .map(|chunk| ActiveChunk { chunk, contact_patches: 1, first_work_item: chunk, ..Default::default() })
        .collect();
    flow.contact_patches[0].normal = [0.0, -1.0, 0.0];
    flow.counts = Counts { gathering: chunks, ..Counts::default() };
    flow.args[3 * shaders::ARGS_GATHERING as usize] = chunks;
    flow.capacity = n;
    flow
}

#[test]
fn candidates_of_any_number() {
    let mut random = Random(19);
    for n in sizes() {
        let mut flow = loose(n, &mut random);
        flow.candidates();
        assert_eq!(flow.hits.len(), n.next_multiple_of(CHUNK_VERTICES));
        for (i, (hit, what)) in flow.hits.iter().zip(&flow.what).enumerate() {
            let depth = if i < n { -f64::from(flow.skin[3 * i][1]) } else { 0.0 };
            if depth <= 0.0 {
                assert_eq!(*hit, [0.0; 4]);
                continue;
            }
            assert_eq!(what, &[3 * i as u32, 0, NONE, 0]);
            let area = f64::from(flow.model.skin_areas[3 * i]);
            expect_close("hit", hit, &[depth, 0.0, 0.0, area], CLOSE);
            expect_close("normal", &flow.normals[i], &[0.0, -1.0, 0.0, 1.0], CLOSE);
            expect_close("push", &flow.pushes[i][..3], &[0.0, -depth * area, 0.0], CLOSE);
            assert_eq!(flow.pushes[i][3].to_bits(), NONE, "a half-space has no pair of proxies");
        }
        let colliding: Vec<u32> = (0..flow.hits.len()).filter(|i| flow.hits[*i][0] > 0.0).map(|i| i as u32).collect();
        assert_eq!(flow.source[..flow.counts.contacts as usize], colliding);
        // With their orientation reversed, no triangle faces the half-space.
        flow.model.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        flow.candidates();
        assert!(flow.hits.iter().all(|hit| *hit == [0.0; 4]) && flow.counts.contacts == 0);
    }
}

#[test]
fn responses_of_any_number() {
    let mut random = Random(20);
    for n in sizes() {
        let mut flow = loose(3 * n, &mut random);
        let nodes = 50;
        flow.velocity = (0..nodes).map(|_| random.vector().as_vec3().extend(0.0).to_array()).collect();
        let vertices = flow.skin.len();
        flow.model.skin_nodes = (0..vertices as u32).map(|i| [0, 1, 2, 3].map(|k| (i * 7 + k * 13) % 50)).collect();
        flow.model.skin_weights = (0..vertices).map(|i| [0.25, 0.5, 0.25 + (i % 4) as f32 * 0.125, 0.0]).collect();
        // Every third candidate is a contact, and every other contact is with a triangle. Candidates that fill up the
        // last chunk are no contacts.
        let hit = |i: usize| if i % 3 == 2 && i < 3 * n { [0.1 + i as f32, 0.25, 0.5, 2.0] } else { [0.0; 4] };
        let count = (3 * n).next_multiple_of(CHUNK_VERTICES);
        flow.hits = (0..count).map(hit).collect();
        let met = |i: usize| if i.is_multiple_of(2) { i as u32 / 2 } else { NONE };
        flow.what = (0..count).map(|i| [3 * i as u32, (i as u32 / 3) % 2, met(i), 0]).collect();
        let stiffening = |random: &mut Random| 8.5 + 7.5 * random.next() as f32;
        flow.normals = (0..count)
            .map(|_| random.vector().normalize().as_vec3().extend(stiffening(&mut random)).to_array())
            .collect();
        flow.pairs[0].damps_tips = (n % 2) as u32;
        flow.forget_entries(nodes);
        flow.list_candidates();
        assert_eq!(flow.counts.contacts as usize, n);
        flow.respond();
        let mut counts = vec![0u32; nodes];
        for c in 0..n {
            check_response(&flow, c, &mut counts);
        }
        check_lists(&flow, &counts);
    }
}

/// Checks that each node's lists hold its entries and no others, and that each node with entries is once in the list of
/// touched nodes.
fn check_lists(flow: &Flow, counts: &[u32]) {
    let lists = flow.node_lists.len() / counts.len();
    let mut listed = vec![false; flow.next_entries.len()];
    for (k, &head) in flow.node_lists.iter().enumerate() {
        let mut entry = head;
        while entry != NONE {
            let e = entry as usize;
            let (node, weight) = (flow.entry_nodes[e / 4][e % 4], flow.entry_weights[e / 4][e % 4]);
            assert!(
                !listed[e] && node as usize == k / lists && weight != 0.0,
                "entry {e} is wrongly on a list of node {}",
                k / lists
            );
            listed[e] = true;
            entry = flow.next_entries[e];
        }
    }
    assert_eq!(listed.iter().filter(|l| **l).count() as u32, counts.iter().sum::<u32>());
    let in_use = flow.node_lists.chunks(lists).map(|heads| heads.iter().filter(|head| **head != NONE).count() as u32);
    assert_eq!(flow.node_list_counts, in_use.collect::<Vec<_>>());
    let mut touched = flow.touched_nodes[..flow.args[3 * shaders::ARGS_NODES as usize] as usize].to_vec();
    touched.sort_unstable();
    let counted = (0..counts.len()).filter(|node| counts[*node] > 0);
    assert_eq!(touched, counted.map(|node| node as u32).collect::<Vec<_>>());
}

/// Checks contact `c`, which comes from candidate 3 c + 2, and adds its entries to the `counts` of its nodes.
fn check_response(flow: &Flow, c: usize, counts: &mut [u32]) {
    let i = 3 * c + 2;
    let got: &Contact = &flow.contacts[c];
    let sign = if c % 2 == 1 { -1.0 } else { 1.0 };
    let mut points = vec![(3 * i, sign)];
    if flow.what[i][2] != NONE {
        let corners = flow.model.triangles[flow.what[i][2] as usize];
        points.extend([(corners[0] as usize, -0.25 * sign), (corners[1] as usize, -0.25 * sign)]);
        points.push((corners[2] as usize, -0.5 * sign));
    }
    assert_eq!(got.normal, flow.normals[i][..3]);
    let (pair, stiffening) = (&flow.pairs[0], flow.normals[i][3]);
    let damping = if pair.damps_tips == 0 { pair.damping } else { stiffening * pair.damping };
    assert_eq!((got.stiffness, got.damping), (stiffening * pair.stiffness, damping));
    // Vertices embedded in the same tetrahedron share a quad of four entries.
    let mut quads: Vec<([u32; 4], [f64; 4])> = Vec::new();
    for (vertex, share) in points {
        let nodes = flow.model.skin_nodes[vertex];
        let weights = flow.model.skin_weights[vertex].map(|w| share * f64::from(w));
        match quads.iter_mut().find(|(known, _)| *known == nodes) {
            Some((_, sums)) => sums.iter_mut().zip(weights).for_each(|(sum, w)| *sum += w),
            None => quads.push((nodes, weights)),
        }
    }
    assert_eq!((got.quads as usize, got.vertex as usize, got.side as usize), (quads.len(), 3 * i, c % 2));
    let mut rate = 0.0;
    for (quad, (nodes, weights)) in quads.into_iter().enumerate() {
        assert_eq!(flow.entry_nodes[4 * c + quad], nodes);
        expect_close("weights", &flow.entry_weights[4 * c + quad], &weights, CLOSE);
        for (node, w) in nodes.iter().zip(weights) {
            let speed = |k: usize| f64::from(flow.normals[i][k]) * f64::from(flow.velocity[*node as usize][k]);
            rate += w * (0..3).map(speed).sum::<f64>();
            counts[*node as usize] += u32::from(w != 0.0);
        }
    }
    expect_close("rate", &[got.rate], &[rate], CLOSE);
    let untouched = &flow.entry_nodes[4 * c + got.quads as usize..4 * c + 4];
    assert!(untouched.iter().all(|quad| *quad == [NONE; 4]), "unused quads must stay as they were");
}
