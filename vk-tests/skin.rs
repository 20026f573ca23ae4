//! skin/bound, skin/embed and skin/probe: how far skin may have moved, where it is, and the probed vertices.

use bytemuck::Zeroable;
use glam::{DQuat, DVec3};
use palpate::oracle::{proximity, skin as oracle};
use palpate::prepare::{Body, Shape};
use palpate::stages::types::{ActiveProxy, Counts, Frame, Link, Proxy, ProxyBounds, StepParams};

use crate::bodies::{octants, soft, sphere};
use crate::flow::Flow;
use crate::harness::{Outcome, Tolerance, case, context, expect_close};
use crate::random::Random;

/// Positions of order one, a few f32 operations.
const PLACED: Tolerance = Tolerance { abs: 1e-6, rel: 1e-6 };
/// The bound adds a thousandth and a micrometre of its own, so that rounding never makes it too small.
const BOUND: Tolerance = Tolerance { abs: 1.1e-6, rel: 1.1e-3 };

fn vector(x: &[f32; 4]) -> DVec3 {
    DVec3::new(x[0].into(), x[1].into(), x[2].into())
}

fn texels(random: &mut Random, count: usize) -> Vec<[f32; 4]> {
    (0..count).map(|_| [random.next() as f32, random.next() as f32, random.next() as f32, 0.0]).collect()
}

#[test]
fn bounds_by_hand_and_against_the_oracle() {
    let width = context().reduce_size() as usize;
    let mut random = Random(2);
    let sizes = [(4, 0), (4, 1), (width, width - 1), (width + 1, width), (60, width + 1), (64, 1234)];
    let (mut proxies, mut want) = (vec![], vec![]);
    let hull = texels(&mut random, sizes.iter().map(|s| s.0).sum());
    let displacement = texels(&mut random, 2000);
    let proxy_nodes: Vec<[u32; 2]> = (0..sizes.iter().map(|s| s.1 as u32).sum()).map(|i| [i * 37 % 2000, 0]).collect();
    let (mut hulls, mut nodes) = (0, 0);
    for (hull_count, node_count) in sizes {
        let (margin, weight_bound) = (0.01, 1.5);
        proxies.push(Proxy {
            hull_first: hulls as u32,
            hull_count: hull_count as u32,
            node_first: nodes as u32,
            node_count: node_count as u32,
            margin: margin as f32,
            weight_bound: weight_bound as f32,
            ..Proxy::zeroed()
        });
        let points: Vec<DVec3> = hull[hulls..hulls + hull_count].iter().map(vector).collect();
        let moved = proxy_nodes[nodes..nodes + node_count].iter().map(|n| vector(&displacement[n[0] as usize]));
        want.push(proximity::bounds(&points, margin, weight_bound, &moved.collect::<Vec<_>>()));
        (hulls, nodes) = (hulls + hull_count, nodes + node_count);
    }
    // By hand: nothing moves the first proxy, so that only its margin is left.
    assert_eq!(want[0].inflation, 0.01);
    let out = case("skin/bound")
        .size(palpate::gpu::Size::Reduce)
        .input("proxies", &proxies)
        .input("hull", &hull)
        .input("proxy_nodes", &proxy_nodes)
        .input("displacement", &displacement)
        .input("node_rest", &[[0.0f32; 4]])
        .input("links", &[Link::default()])
        .output::<ProxyBounds>("bounds", proxies.len())
        .groups(proxies.len())
        .run();
    for (got, want) in out.get::<ProxyBounds>("bounds").iter().zip(&want) {
        let exact = Tolerance { abs: 0.0, rel: 0.0 };
        expect_close("low", &got.low, &want.low.to_array(), exact);
        expect_close("high", &got.high, &want.high.to_array(), exact);
        expect_close("inflation", &[got.inflation], &[want.inflation], BOUND);
        assert!(f64::from(got.inflation) > want.inflation, "never too small");
        expect_close("radius", &[got.radius], &[0.5 * (want.high - want.low).length()], PLACED);
    }
}

/// A soft ball in general position whose nodes are displaced by up to `size` each way.
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
        flow.bound();
        activate(&mut flow);
        flow.embed();
        for (proxy, bounds) in flow.model.proxies.iter().zip(&flow.bounds) {
            let faces = &flow.faces[proxy.face_first as usize..][..proxy.face_count as usize];
            let own = flow.model.proxy_vertices[proxy.vertex_first as usize..][..proxy.vertex_count as usize].to_vec();
            let range = proxy.triangle_first as usize..(proxy.triangle_first + proxy.triangle_count) as usize;
            let drawn = flow.model.proxy_triangles[range].iter().flat_map(|t| &flow.model.triangles[*t as usize][..3]);
            for v in own.iter().chain(drawn) {
                let x = vector(&flow.skin[*v as usize]);
                let outside = faces.iter().map(|f| vector(f).dot(x) - f64::from(f[3])).fold(f64::MIN, f64::max);
                assert!(outside <= f64::from(bounds.inflation), "{outside} outside, {} allowed", bounds.inflation);
            }
        }
    }
}

/// All proxies active, with their running totals.
fn activate(flow: &mut Flow) {
    flow.active_list.clear();
    flow.counts = Counts::default();
    for (i, proxy) in flow.model.proxies.iter().enumerate() {
        let c = &mut flow.counts;
        let totals = (c.vertices, c.triangles, c.embeds);
        let (vertex_first, triangle_first, embed_first) = totals;
        flow.active_list.push(ActiveProxy { proxy: i as u32, side: 0, vertex_first, triangle_first, embed_first });
        c.active_proxies += 1;
        c.vertices += proxy.vertex_count;
        c.triangles += proxy.triangle_count;
        c.embeds += proxy.embed_count;
    }
    flow.args[3] = flow.counts.embeds.div_ceil(context().group_size());
}

#[test]
fn embedded_skin_is_where_the_oracle_has_it_and_carries_the_step() {
    let (ball, mut flow) = shaken(0.03);
    flow.params.step = 0x12_3456;
    activate(&mut flow);
    flow.embed();
    let Shape::Soft { layer, embedding, .. } = &ball.shape else { unreachable!() };
    let moved: Vec<DVec3> = layer.nodes.iter().zip(&flow.displacement).map(|(x, d)| *x + vector(d)).collect();
    let local = oracle::embed(embedding, layer, &moved);
    let want = local
        .iter()
        .flat_map(|x| (ball.position + ball.orientation * *x).extend(f64::from(1 + 0x12_3456 % 0xf_ffff)).to_array());
    let got: Vec<f32> = flow.skin.as_flattened().to_vec();
    expect_close("skin", &got, &want.collect::<Vec<_>>(), PLACED);
}

/// One proxy that lists `n` vertices of a rigid skin backwards; twice as many are there.
fn rigid_skin(n: usize) -> (Outcome, Vec<[f32; 4]>, Frame) {
    let mut random = Random(4);
    let rotation = random.turn(3.0).as_quat().to_array();
    let frame = Frame { rotation, centre: [1.0, 2.0, 3.0], ..Frame::zeroed() };
    let weights = texels(&mut random, 2 * n.max(1));
    let embeds: Vec<u32> = (0..n.max(1) as u32).rev().collect();
    let out = case("skin/embed")
        .input("params", &[StepParams { step: 9, ..StepParams::zeroed() }])
        .input("frames", &[frame])
        .input("counts", &[Counts { active_proxies: 1, embeds: n as u32, ..Default::default() }])
        .input("active_list", &[ActiveProxy::default()])
        .input("proxies", &[Proxy { embed_count: n as u32, ..Proxy::zeroed() }])
        .input("proxy_embeds", &embeds)
        .input("skin_nodes", &vec![[u32::MAX, 0, 0, 0]; weights.len()])
        .input("skin_weights", &weights)
        .input("node_rest", &[[0.0f32; 4]])
        .input("displacement", &[[0.0f32; 4]])
        .input("node_info", &[[0u32; 4]])
        .partial("skin", &vec![[-5.0f32; 4]; weights.len()])
        .elements(n)
        .run();
    (out, weights, frame)
}

#[test]
fn rigid_skin_of_any_size_and_only_what_is_listed() {
    let width = context().group_size() as usize;
    for n in [0, 1, width - 1, width, width + 1, 1234] {
        let (out, weights, frame) = rigid_skin(n);
        let skin: Vec<[f32; 4]> = out.get("skin");
        let rotation = DQuat::from_array(frame.rotation.map(f64::from));
        let want = weights[..n].iter().flat_map(|x| {
            let at = proximity::embed(DVec3::new(1.0, 2.0, 3.0), rotation, [vector(x); 4], [0.25; 4]);
            at.extend(10.0).to_array()
        });
        expect_close("skin", skin[..n].as_flattened(), &want.collect::<Vec<_>>(), PLACED);
        assert!(skin[n..].iter().all(|x| *x == [-5.0; 4]), "what no proxy lists stays");
    }
}

#[test]
fn probes_of_any_number_are_the_displacements_of_their_nodes() {
    let width = context().group_size() as usize;
    let mut random = Random(6);
    let displacement = texels(&mut random, 50);
    for n in [0, 1, width - 1, width, width + 1, 1234] {
        let mut nodes: Vec<u32> = (0..n.max(1) as u32).map(|i| 7 * i % 50).collect();
        // One of a rigid skin, which nothing displaces.
        nodes[n / 2] = palpate::stages::types::NONE;
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
