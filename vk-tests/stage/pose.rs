//! Tests of kernel pose/place, which computes the hulls and face planes of collision proxies (convex hulls) in the
//! world and the bounds of proxies, and clears counters and indirect arguments. Inflation, one of the bounds, is how
//! far skin may lie outside the hull; a frame is a rigid coordinate frame; a link is the transform between two frames.

use bytemuck::Zeroable;
use glam::{DQuat, DVec3};
use palpate::internal::gpu::Size;
use palpate::internal::shaders;
use palpate::internal::shaders::{Counts, Frame, Link, Proxy, ProxyBounds};
use palpate::internal::stages::ARGS_WORDS;
use palpate_oracle::proximity;

use crate::harness::random::Random;
use crate::harness::{Outcome, Tolerance, case, context, expect_close};

/// Error of positions of order one after some twenty f32 operations.
const PLACED: Tolerance = Tolerance { abs: 2e-6, rel: 1e-6 };
/// Error of a bound, to which the kernel adds a thousandth and a micrometre, so that rounding never makes it too small.
const BOUND: Tolerance = Tolerance { abs: 1.1e-6, rel: 1.1e-3 };
/// The counters that the last step left.
const LAST: Counts = Counts {
    chunks: 1,
    work_items: 2,
    gathering: 12,
    pair_proxies_met: 10,
    hits: 3,
    overlaps: 0,
    chunks_asked: 11,
    contacts: 4,
    entries: 5,
    turn: 7,
    last_contacts: 8,
    flags: 9,
};

#[derive(Default)]
struct Given {
    frames: Vec<Frame>,
    links: Vec<Link>,
    proxies: Vec<Proxy>,
    hull: Vec<[f32; 4]>,
    faces: Vec<[f32; 4]>,
    nodes: Vec<[u32; 2]>,
    displacement: Vec<[f32; 4]>,
    rest: Vec<[f32; 4]>,
}

impl Given {
    /// Adds a proxy with these hull vertices, face planes and nodes.
    fn add(&mut self, proxy: Proxy, hull: &[[f32; 4]], faces: &[[f32; 4]], nodes: &[[u32; 2]]) {
        self.proxies.push(Proxy {
            hull_first: self.hull.len() as u32,
            hull_count: hull.len() as u32,
            face_first: self.faces.len() as u32,
            face_count: faces.len() as u32,
            node_first: self.nodes.len() as u32,
            node_count: nodes.len() as u32,
            ..proxy
        });
        self.hull.extend(hull);
        self.faces.extend(faces);
        self.nodes.extend(nodes);
        // Two nodes share a texel: where their number is odd, the last one is listed twice.
        if nodes.len() % 2 == 1 {
            self.nodes.push(nodes[nodes.len() - 1]);
            self.proxies.last_mut().unwrap().node_count += 1;
        }
    }

    fn run(&self) -> Outcome {
        // The indirect arguments that an earlier step left.
        let stale = vec![77u32; ARGS_WORDS];
        let nodes = if self.nodes.is_empty() { &vec![[0; 2]; 2] } else { &self.nodes };
        case("pose/place")
            .size(Size::Reduce)
            .constant("SPANS", self.links.len() > 1)
            .input("frames", &self.frames)
            .input("proxies", &self.proxies)
            .input("hull_rest", &self.hull)
            .input("face_rest", &self.faces)
            .input("proxy_nodes", nodes)
            .input("displacement", &self.displacement)
            .input("node_rest", &self.rest)
            .input("links", &self.links)
            .output::<[f32; 4]>("hull", self.hull.len())
            .output::<[f32; 4]>("faces", self.faces.len())
            .output::<ProxyBounds>("bounds", self.proxies.len())
            .inout("counts", &[LAST])
            .partial("args", &stale)
            .groups(self.proxies.len())
            .run()
    }
}

fn frame(rotation: DQuat, centre: DVec3) -> Frame {
    let (rotation, centre) = (rotation.as_quat().to_array(), centre.as_vec3().to_array());
    Frame { rotation, centre, ..Frame::zeroed() }
}

fn f64s(x: &[f32; 4]) -> DVec3 {
    DVec3::new(x[0].into(), x[1].into(), x[2].into())
}

fn texels(random: &mut Random, count: usize) -> Vec<[f32; 4]> {
    (0..count).map(|_| random.vector().as_vec3().extend(0.0).to_array()).collect()
}

#[test]
fn a_quarter_turn_by_hand() {
    let turn = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
    let mut given = Given {
        frames: vec![frame(DQuat::IDENTITY, DVec3::ZERO), frame(turn, DVec3::new(10.0, 0.0, 0.0))],
        links: vec![Link::default()],
        displacement: vec![[0.0, 0.3, 0.4, 9.0], [5.0; 4]],
        rest: vec![[0.0; 4]; 2],
        ..Given::default()
    };
    let proxy = Proxy { margin: 0.01, weight_bound: 2.0, ..Proxy::zeroed() };
    given.add(proxy, &[[1.0, 2.0, 3.0, 0.0]], &[], &[[0, 0]]);
    let hull = [[1.0, 0.0, 0.5, 0.0], [3.0, 4.0, 0.5, 0.0]];
    given.add(Proxy { frame: 1, ..proxy }, &hull, &[[1.0, 0.0, 0.0, 0.25]], &[]);
    let out = given.run();
    let hull: Vec<f32> = out.get("hull");
    expect_close("hull", &hull, &[1.0, 2.0, 3.0, 0.0, 10.0, 1.0, 0.5, 0.0, 6.0, 3.0, 0.5, 0.0], PLACED);
    // The face's normal turns from x to y; the frame is moved along x, so that the offset of the face's plane stays.
    expect_close("faces", &out.get("faces"), &[0.0, 1.0, 0.0, 0.25], PLACED);
    let bounds: Vec<ProxyBounds> = out.get("bounds");
    expect_close("low", &bounds[1].low, &[6.0, 1.0, 0.5], PLACED);
    expect_close("high", &bounds[1].high, &[10.0, 3.0, 0.5], PLACED);
    expect_close("radius", &[bounds[0].radius, bounds[1].radius], &[0.0, 5f64.sqrt()], PLACED);
    // The first proxy's node is displaced by half a metre. The proxy's `weight_bound` is 2, so that its skin may move
    // by twice this displacement. The second proxy has no nodes.
    expect_close("inflation", &[bounds[0].inflation, bounds[1].inflation], &[1.01, 0.01], BOUND);
    assert_eq!(out.get::<Counts>("counts"), [Counts { last_contacts: LAST.contacts, ..Counts::default() }]);
    let args: Vec<u32> = out.get("args");
    for args_index in 0..shaders::ARGS_LOOP_ELEMENT_PRODUCT {
        assert_eq!(args[3 * args_index as usize..][..3], [0, 1, 1], "indirect arguments of dispatch {args_index}");
    }
    let instances = 3 * shaders::ARGS_DRAW as usize + 1;
    assert_eq!(args[instances], 0, "number of instances to draw");
    let mut others = (3 * shaders::ARGS_LOOP_ELEMENT_PRODUCT as usize..ARGS_WORDS).filter(|word| *word != instances);
    assert!(others.all(|word| args[word] == 77), "the solver's indirect arguments must not be cleared");
}

/// The displacement, in another frame, of a node that is displaced by `d` from its place at rest `r` in its own frame.
fn across(link: &Link, r: DVec3, d: DVec3) -> DVec3 {
    let [x, y, z, w] = link.turn.map(f64::from);
    DVec3::from_array(link.offset.map(f64::from)) + DQuat::from_xyzw(x, y, z, w).normalize() * (r + d) - r
}

/// Proxies on five frames. `sizes` has the numbers of hull vertices, faces and nodes of each proxy; if `spans`, some
/// nodes of a proxy are in other frames than the proxy.
fn crowd(sizes: &[[usize; 3]], spans: bool, random: &mut Random) -> Given {
    let place = |random: &mut Random| frame(random.turn(3.0), random.vector());
    let link = |random: &mut Random| {
        let turn = random.turn(1.0).as_quat().to_array();
        Link { turn, offset: random.vector().as_vec3().to_array(), ..Link::default() }
    };
    let mut given = Given {
        frames: (0..5).map(|_| place(random)).collect(),
        links: vec![Link::default()],
        displacement: texels(random, 2000),
        rest: texels(random, 2000),
        ..Given::default()
    };
    if spans {
        given.links.extend((0..3).map(|_| link(random)));
    }
    for (i, [hulls, faces, nodes]) in sizes.iter().enumerate() {
        let hull = texels(random, *hulls);
        let face = |x: [f32; 4]| f64s(&x).normalize().as_vec3().extend(random.next() as f32).to_array();
        let planes: Vec<[f32; 4]> = texels(&mut Random(i as u64), *faces).into_iter().map(face).collect();
        let links = given.links.len() as u32;
        let nodes: Vec<[u32; 2]> = (0..*nodes as u32).map(|k| [(i as u32 + k * 37) % 2000, k % links]).collect();
        let proxy = Proxy { frame: (i * 7 % 5) as u32, margin: 0.01, weight_bound: 1.5, ..Proxy::zeroed() };
        given.add(proxy, &hull, &planes, &nodes);
    }
    given
}

fn check(given: &Given, out: &Outcome) {
    let (hull, faces): (Vec<[f32; 4]>, Vec<[f32; 4]>) = (out.get("hull"), out.get("faces"));
    for (proxy, bounds) in given.proxies.iter().zip(out.get::<ProxyBounds>("bounds")) {
        let own = &given.frames[proxy.frame as usize];
        let centre = DVec3::from_array(own.centre.map(f64::from));
        let rotation = DQuat::from_array(own.rotation.map(f64::from)).normalize();
        let (first, end) = (proxy.hull_first as usize, (proxy.hull_first + proxy.hull_count) as usize);
        let points: Vec<DVec3> =
            given.hull[first..end].iter().map(|x| proximity::place(centre, rotation, f64s(x))).collect();
        let flat: Vec<f64> = points.iter().flat_map(|x| x.extend(0.0).to_array()).collect();
        expect_close("hull", hull[first..end].as_flattened(), &flat, PLACED);
        let range = proxy.face_first as usize..(proxy.face_first + proxy.face_count) as usize;
        let turned = given.faces[range.clone()].iter().flat_map(|x| {
            let (normal, offset) = proximity::place_face(centre, rotation, (f64s(x), x[3].into()));
            normal.extend(offset).to_array()
        });
        expect_close("faces", faces[range].as_flattened(), &turned.collect::<Vec<_>>(), PLACED);

        let nodes = &given.nodes[proxy.node_first as usize..][..proxy.node_count as usize];
        let moved = nodes.iter().map(|[n, link]| {
            let (r, d) = (f64s(&given.rest[*n as usize]), f64s(&given.displacement[*n as usize]));
            if *link == 0 { d } else { across(&given.links[*link as usize], r, d) }
        });
        let (margin, weights) = (proxy.margin.into(), proxy.weight_bound.into());
        let want = proximity::bounds(&points, margin, weights, &moved.collect::<Vec<_>>());
        expect_close("low", &bounds.low, &want.low.to_array(), PLACED);
        expect_close("high", &bounds.high, &want.high.to_array(), PLACED);
        expect_close("radius", &[bounds.radius], &[0.5 * (want.high - want.low).length()], PLACED);
        expect_close("inflation", &[bounds.inflation], &[want.inflation], BOUND);
        assert!(f64::from(bounds.inflation) > want.inflation, "the inflation must never be too small");
    }
}

#[test]
fn proxies_of_any_size_against_the_oracle() {
    let width = context().reduce_size() as usize;
    let mut random = Random(1);
    let sizes = [0, 1, width - 1, width, width + 1, 1234];
    let all: Vec<[usize; 3]> = (0..6).map(|k| [sizes[k].max(1), sizes[(k + 1) % 6], sizes[(k + 2) % 6]]).collect();
    for count in [1, 2, 6] {
        for spans in [false, true] {
            let given = crowd(&all[6 - count..], spans, &mut random);
            check(&given, &given.run());
        }
    }
}

#[test]
fn a_point_keeps_its_height_over_a_face_wherever_both_go() {
    let mut random = Random(9);
    let (x, normal) = (random.vector(), random.vector().normalize());
    let mut given = Given {
        frames: vec![frame(random.turn(3.0), random.vector() * 3.0)],
        links: vec![Link::default()],
        displacement: vec![[0.0; 4]],
        rest: vec![[0.0; 4]],
        ..Given::default()
    };
    let plane = normal.as_vec3().extend(0.5).to_array();
    given.add(Proxy::zeroed(), &[x.as_vec3().extend(0.0).to_array()], &[plane], &[]);
    let out = given.run();
    let (hull, face) = (out.get::<[f32; 4]>("hull")[0], out.get::<[f32; 4]>("faces")[0]);
    let height = f64s(&face).dot(f64s(&hull)) - f64::from(face[3]);
    expect_close("height", &[height as f32], &[normal.dot(x) - 0.5], PLACED);
}
