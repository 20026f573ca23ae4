//! Tests of the kernels that deal with the rigid coordinate frames of bodies: tetrahedra, skin (surface mesh) and
//! collision proxies with nodes in two frames, nodes attached to kinematic frames (whose motion is known) and to
//! dynamic cores (rigid bodies inside soft ones, whose motion is solved for), the new state relative to the frame at
//! the end of a step, and the sums from which a floating frame is fitted to the nodes of its body.

use bytemuck::Zeroable;
use glam::{DMat3, DQuat, DVec3};
use palpate::internal::gpu::{Const, Size};
use palpate::internal::prepare::layer::kuhn_box;
use palpate::internal::prepare::{Body, Frame as BodyFrame, FrameMotion, Shape};
use palpate::internal::shaders::{
    ActiveChunk, Chunk, ContactPatch, Counts, Fit, Frame, Link, Pair, PairProxy, Proxy, ProxyBounds, RigidIterate,
    Solve, StepParams,
};
use palpate::internal::stages::ARGS_WORDS;
use palpate::internal::stages::model::FramePlace;

use crate::harness::random::Random;
use crate::harness::{Tolerance, case, context, expect_close};
use crate::solver::system::{System, layered, material};

/// Error of positions of some tenths of a metre after a dozen f32 operations, m.
const PLACED: Tolerance = Tolerance { abs: 2e-7, rel: 1e-6 };
/// Error of forces relative to the largest: strains of one tenth are computed from positions known to 1e-7.
const FORCE: f64 = 1.0e-5;
/// Error of velocities of about 1 m/s.
const VELOCITY: Tolerance = Tolerance { abs: 1e-6, rel: 2e-6 };
/// Error of sums over up to 1234 nodes, relative to the summed magnitudes.
const SUM: f64 = 2.0e-6;

/// Place of a frame in the world.
#[derive(Clone, Copy)]
struct Placed {
    centre: DVec3,
    rotation: DQuat,
}

fn wide(x: &[f32]) -> DVec3 {
    DVec3::new(x[0].into(), x[1].into(), x[2].into())
}

fn narrow(x: DVec3) -> [f32; 4] {
    x.as_vec3().extend(0.0).to_array()
}

/// A bar, one half of which belongs to one frame and the other half to another frame.
fn two_frames() -> Body {
    let mut body = layered(
        kuhn_box(DVec3::new(-0.06, -0.02, -0.02), DVec3::new(0.06, 0.02, 0.02), [6, 2, 2]),
        material(2e4),
        Random(3).turn(2.0),
    );
    if let Shape::Soft { layer, frames, node_frames, .. } = &mut body.shape {
        let frame = |x: f64| BodyFrame { centre: DVec3::X * x, motion: FrameMotion::Fixed };
        *frames = vec![frame(-0.03), frame(0.03)];
        *node_frames = layer.nodes.iter().map(|x| u32::from(x.x > 0.001)).collect();
    }
    body
}

/// The bar at some place, and bent: its frames are turned by up to `angle` (rad) against one another, and nodes are
/// displaced in their frames. Links (transforms between frames) and frames are as the host writes them. The f64
/// oracle's bar has the same shape relative to rest axes.
fn bent(angle: f64, seed: u64) -> (System, Vec<Placed>) {
    let body = two_frames();
    let mut random = Random(seed);
    let mut system = System::new(std::slice::from_ref(&body), 0.003, seed);
    let common = random.turn(3.0);
    let mut placed = |place: &FramePlace| Placed {
        centre: common * (place.orientation * place.rest_centre + 0.01 * angle * random.vector()),
        rotation: common * place.orientation * random.turn(angle),
    };
    let places: Vec<Placed> = system.model.frames.iter().map(&mut placed).collect();
    for (frame, place) in system.frames.iter_mut().zip(&places) {
        *frame = Frame {
            rotation: place.rotation.as_quat().to_array(),
            centre: place.centre.as_vec3().to_array(),
            ..Frame::default()
        };
    }
    // Links in both directions are added, also those that no tetrahedron needs.
    for link in [[0, 1], [1, 0]].into_iter().filter(|link| !system.model.links.contains(link)).collect::<Vec<_>>() {
        system.model.links.push(link);
    }
    system.links.resize(system.model.links.len(), Link::default());
    for (link, [to, from]) in system.links.iter_mut().zip(&system.model.links) {
        let (a, b) = (places[*to as usize], places[*from as usize]);
        let rest = |frame: &u32| system.model.frames[*frame as usize].rest_centre;
        let back = a.rotation.conjugate();
        *link = Link {
            turn: (back * b.rotation).as_quat().to_array(),
            offset: (back * (b.centre - a.centre) - (rest(from) - rest(to))).as_vec3().to_array(),
            ..Link::default()
        };
    }
    let Shape::Soft { layer, .. } = &body.shape else { unreachable!() };
    let moved = world(&system, &places);
    for (i, x) in moved.iter().enumerate() {
        system.twin.bodies[0].displacement[i] = body.orientation.conjugate() * (*x - body.position) - layer.nodes[i];
    }
    (system, places)
}

/// World positions of the nodes.
fn world(system: &System, places: &[Placed]) -> Vec<DVec3> {
    let node = |((rest, d), info): ((&[f32; 4], &[f32; 4]), &[u32; 4])| {
        let place = places[info[2] as usize];
        place.centre + place.rotation * (wide(rest) + wide(d))
    };
    system.model.node_rest.iter().zip(&system.displacement).zip(&system.model.node_info).map(node).collect()
}

#[test]
fn tetrahedra_that_span_two_frames_have_the_oracles_forces() {
    for (angle, seed) in [(0.0, 5), (1e-3, 6), (0.1, 7), (0.3, 8)] {
        let (mut system, _) = bent(angle, seed);
        let spanning = system.model.tetrahedron_links.iter().filter(|links| **links != [0; 4]).count();
        assert!(spanning > 10, "only {spanning} tetrahedra span both frames");
        system.rotate();
        let body = &system.twin.bodies[0];
        // The oracle uses its own rotations, the polar rotations of the whole deformation from rest axes.
        let rotations = body.elements.rotations(&body.displacement);
        let linearised = body.elements.linearised(&body.displacement, &rotations);
        let want = linearised.impulses(&body.displacement, &rotations, &body.velocity, None, system.twin.dt);
        let mut got = vec![DVec3::ZERO; want.len()];
        for (t, nodes) in system.model.tetrahedra.iter().enumerate() {
            for (corner, node) in nodes.iter().enumerate() {
                got[*node as usize] += wide(&system.element_forces[4 * t + corner]);
            }
        }
        let largest = want.iter().map(|f| f.length()).fold(0.0, f64::max);
        let error = got.iter().zip(&want).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max) / largest;
        assert!(error < FORCE, "frames turned by {angle} rad: relative error of forces {error:e}");
    }
}

#[test]
fn frames_moved_as_one_give_no_force() {
    let (mut system, _) = bent(0.0, 9);
    system.displacement.fill([0.0; 4]);
    system.velocity.fill([0.0; 4]);
    system.rotate();
    // Links computed in f64 are off by 1e-16 m at most, and f32 keeps such small numbers small.
    let largest = system.element_forces.iter().map(|f| wide(f).length()).fold(0.0, f64::max);
    assert!(largest < 1e-14, "largest impulse on a node {largest:e} N s, expected almost none");
}

#[test]
fn skin_across_frames_is_where_its_nodes_are_and_within_its_bounds() {
    let (system, places) = bent(0.9, 11);
    let moved = world(&system, &places);
    let nodes = system.model.node_rest.len();
    // Barycentric weights of the middle of each tetrahedron, and of a point outside the tetrahedron.
    let weights = [[0.25f32; 4], [1.5, -0.3, -0.4, 0.2]];
    let skin_nodes: Vec<[u32; 4]> = system.model.tetrahedra.iter().flat_map(|t| [*t; 2]).collect();
    let skin_weights: Vec<[f32; 4]> = system.model.tetrahedra.iter().flat_map(|_| weights).collect();
    let count = skin_nodes.len();
    let untouched = u32::MAX - 1;
    let out = case("skin/embed")
        .size(Size::Reduce)
        .constant("BUCKETS", 4u32)
        .constant("SPANS", Const::Bool(true))
        .input("frames", &system.frames)
        .input("active_chunks", &[ActiveChunk::default()])
        .input("pairs", &[Pair { is_plane: 1, ..Pair::default() }])
        .input("pair_proxies", &[PairProxy::default()])
        .input("proxies", &[Proxy::default()])
        .input("chunks", &[Chunk { embed_count: count as u32, ..Chunk::default() }])
        .input("chunk_vertices", &crate::stage::flow::fours(&(0..count as u32).collect::<Vec<_>>()))
        .input("skin_nodes", &skin_nodes)
        .input("skin_weights", &skin_weights)
        .input("node_rest", &system.model.node_rest)
        .input("displacement", &system.displacement)
        .input("node_info", &system.model.node_info)
        .input("contact_patches", &[ContactPatch::default()])
        .input("shares", &[1.0f32; 4])
        .output::<[f32; 4]>("skin", count)
        .inout("buckets", &[untouched; 4])
        .partial("hash_entries", &[[untouched; 4]; 64])
        .partial("entry_hits", &[untouched; 64])
        .partial("entry_cells", &[[untouched; 2]; 64])
        .input("depth_grids", &[[0u32; 4]; 128])
        .groups(1)
        .run();
    let place = |(nodes, weights): (&[u32; 4], &[f32; 4])| {
        let x: DVec3 = nodes.iter().zip(weights).map(|(n, w)| f64::from(*w) * moved[*n as usize]).sum();
        x.extend(1.0).to_array()
    };
    let want: Vec<f64> = skin_nodes.iter().zip(&skin_weights).flat_map(place).collect();
    expect_close("skin", out.get::<[f32; 4]>("skin").as_flattened(), &want, PLACED);

    // Each frame has a collision proxy (convex hull) that lists all nodes. A proxy's inflation (how far skin may lie
    // outside the hull) follows from the greatest displacement of a node, seen from the proxy's frame.
    let proxy = |frame: u32| Proxy {
        frame,
        hull_first: 4 * frame,
        hull_count: 4,
        node_first: frame * nodes.next_multiple_of(2) as u32,
        node_count: nodes as u32,
        weight_bound: 2.0,
        ..Default::default()
    };
    let link =
        |to: u32, from: u32| system.model.links.iter().position(|l| *l == [to, from] || (to == from && *l == [0, 0]));
    let listed: Vec<[u32; 2]> = (0..2u32)
        .flat_map(|to| {
            let own = system.model.node_info.iter().enumerate().map(move |(n, info)| (to, n, info[2]));
            // Two nodes share a texel, so that an odd number of nodes is filled up with one more.
            own.chain((nodes % 2 == 1).then_some((to, 0, system.model.node_info[0][2])))
        })
        .map(|(to, n, from)| [n as u32, if to == from { 0 } else { link(to, from).unwrap() as u32 }])
        .collect();
    let out = case("pose/place")
        .size(Size::Reduce)
        .constant("SPANS", Const::Bool(true))
        .input("frames", &system.frames)
        .input("proxies", &[proxy(0), proxy(1)])
        .input("hull_rest", &[[0.0f32; 4]; 8])
        .input("face_rest", &[[0.0f32; 4]])
        .input("proxy_nodes", &listed)
        .input("displacement", &system.displacement)
        .input("node_rest", &system.model.node_rest)
        .input("links", &system.links)
        .output::<[f32; 4]>("hull", 8)
        .output::<[f32; 4]>("faces", 0)
        .output::<ProxyBounds>("bounds", 2)
        .inout("counts", &[Counts::default()])
        .partial("args", &[0u32; ARGS_WORDS])
        .groups(2)
        .run();
    let body = two_frames();
    let Shape::Soft { layer, frames, .. } = &body.shape else { unreachable!() };
    for (bounds, (place, frame)) in out.get::<ProxyBounds>("bounds").iter().zip(places.iter().zip(frames)) {
        let away = |(x, rest): (&DVec3, &DVec3)| {
            (place.rotation.conjugate() * (*x - place.centre) - (*rest - frame.centre)).length()
        };
        let want = 2.0 * moved.iter().zip(&layer.nodes).map(away).fold(0.0, f64::max);
        let got = f64::from(bounds.inflation);
        assert!(got > want && got < 1.0011 * want + 1.1e-6, "inflation {got} m, expected {want} m");
    }
}

/// A frame that moves over the step, with its places at the start and at the end.
fn moving(random: &mut Random, h: f64, angle: f64) -> (Frame, Placed, Placed) {
    let start = Placed { centre: random.vector(), rotation: random.turn(3.0) };
    let end = Placed { centre: start.centre + 0.01 * random.vector(), rotation: random.turn(angle) * start.rotation };
    let turn = end.rotation.conjugate() * start.rotation;
    let frame = Frame {
        rotation: start.rotation.as_quat().to_array(),
        centre: start.centre.as_vec3().to_array(),
        linear: ((end.centre - start.centre) / h).as_vec3().to_array(),
        turn: turn.as_quat().to_array(),
        core: palpate::internal::shaders::NONE,
        ..Frame::default()
    };
    (frame, start, end)
}

#[test]
fn the_new_state_is_the_same_place_seen_from_the_frames_end() {
    let (h, width) = (1.0 / 128.0, context().group_size() as usize);
    for (count, angle) in [(0, 0.1), (1, 0.1), (width - 1, 1e-4), (width, 0.3), (width + 1, 2.0), (1234, 0.05)] {
        let mut random = Random(31 + count as u64);
        let (frame, start, end) = moving(&mut random, h, angle);
        let some = count.max(1);
        let field = |scale: f64, random: &mut Random| -> Vec<[f32; 4]> {
            (0..some).map(|_| narrow(scale * random.vector())).collect()
        };
        let (rest, d, v) = (field(0.2, &mut random), field(0.02, &mut random), field(1.0, &mut random));
        let out = case("solve/commit")
            .constant("NODES", count as u32)
            .input("params", &[StepParams { dt: h as f32, ..bytemuck::Zeroable::zeroed() }])
            .input("frames", &[frame])
            .input("node_info", &vec![[0u32; 4]; some])
            .input("solution", &vec![[0.0f32; 4]; some])
            .input("rhs", &vec![[0.0f32; 4]; some])
            .input("operator_product", &vec![[0.0f32; 4]; some])
            .input("node_rest", &rest)
            .input("solve", &[Solve::zeroed()])
            .input("iterates", &[RigidIterate::zeroed()])
            .inout("velocity", &v)
            .inout("displacement", &d)
            .inout("trend", &vec![[0.0f32; 4]; some])
            .output::<[f32; 4]>("carried_residual", count)
            .elements(count)
            .run();
        for (i, got) in out.get::<[f32; 4]>("displacement").iter().enumerate().take(count) {
            let x = start.centre + start.rotation * (wide(&rest[i]) + wide(&d[i])) + h * wide(&v[i]);
            let want = end.rotation.conjugate() * (x - end.centre) - wide(&rest[i]);
            assert!(wide(got).distance(want) < PLACED.abs, "displacement {got:?}, expected {want}");
        }
    }
}

#[test]
fn kinematic_nodes_go_where_their_frame_takes_them() {
    let (h, width) = (1e-3, context().group_size() as usize);
    for (count, angle) in [(1, 0.0), (width - 1, 1e-4), (width, 1e-3), (width + 1, 0.5), (1234, 0.01)] {
        let mut random = Random(41 + count as u64);
        let (frame, start, end) = moving(&mut random, h, angle);
        let rest: Vec<[f32; 4]> = (0..2 * count).map(|_| narrow(0.2 * random.vector())).collect();
        let kinematic: Vec<u32> = (0..count as u32).map(|i| 2 * i + 1).collect();
        let out = case("pose/carry")
            .constant("ATTACHED_NODES", count as u32)
            .input("params", &[StepParams { dt: h as f32, ..bytemuck::Zeroable::zeroed() }])
            .input("frames", &[frame])
            .input("attached_nodes", &kinematic)
            .input("node_info", &vec![[0u32; 4]; 2 * count])
            .input("node_rest", &rest)
            .input("solve", &[Solve::zeroed()])
            .input("iterates", &[RigidIterate::zeroed()])
            .input("rigid_trends", &[RigidIterate::zeroed()])
            .partial("velocity", &vec![[-7.0f32; 4]; 2 * count])
            .partial("solution", &vec![[-8.0f32; 4]; 2 * count])
            .partial("trend", &vec![[-8.0f32; 4]; 2 * count])
            .elements(count)
            .run();
        let got: Vec<[f32; 4]> = out.get("velocity");
        for i in 0..count {
            assert_eq!(got[2 * i], [-7.0; 4], "velocity of a free node, which must stay as it was");
            let r = wide(&rest[2 * i + 1]);
            let want = (end.centre + end.rotation * r - start.centre - start.rotation * r) / h;
            // In f32 the vector part of the frame's turn has a relative error of 6e-8, and so has the distance by which
            // the turn moves a node.
            let tolerance = VELOCITY.abs + VELOCITY.rel * (want.length() + angle * r.length() / h);
            assert!(wide(&got[2 * i + 1]).distance(want) < tolerance, "velocity {:?}, expected {want}", got[2 * i + 1]);
        }
    }
}

#[test]
fn what_dynamic_cores_carry_has_their_twist_and_its_first_guess() {
    let (h, width) = (1e-3, context().group_size() as usize);
    for count in [1, width - 1, width, width + 1, 1234] {
        let mut random = Random(61 + count as u64);
        let (frame, start, _) = moving(&mut random, h, 0.1);
        let (linear, angular) = (random.vector(), random.vector());
        let frame = Frame { core: 1, linear: linear.as_vec3().into(), angular: angular.as_vec3().into(), ..frame };
        let x: [f32; 6] = std::array::from_fn(|_| random.next() as f32);
        // The core is the second of two, and either of the solver's two sets of iterates may hold the newest iterate.
        let current = count as u32 % 2;
        let mut iterates = [RigidIterate::zeroed(); 4];
        iterates[2 * current as usize + 1].x = x;
        let trend: [f32; 6] = std::array::from_fn(|_| random.next() as f32);
        let mut rigid_trends = [RigidIterate::zeroed(); 4];
        rigid_trends[1].x = trend;
        let rest: Vec<[f32; 4]> = (0..count).map(|_| narrow(0.2 * random.vector())).collect();
        let out = case("pose/carry")
            .constant("ATTACHED_NODES", count as u32)
            .input("params", &[StepParams { dt: h as f32, ..bytemuck::Zeroable::zeroed() }])
            .input("frames", &[frame])
            .input("attached_nodes", &(0..count as u32).collect::<Vec<_>>())
            .input("node_info", &vec![[0u32; 4]; count])
            .input("node_rest", &rest)
            .constant("RIGIDS", 2u32)
            .input("solve", &[Solve { current, ..Solve::zeroed() }])
            .input("iterates", &iterates)
            .input("rigid_trends", &rigid_trends)
            .output::<[f32; 4]>("velocity", count)
            .output::<[f32; 4]>("solution", count)
            .output::<[f32; 4]>("trend", count)
            .elements(count)
            .run();
        let [velocity, solution, carried]: [Vec<[f32; 4]>; 3] =
            ["velocity", "solution", "trend"].map(|name| out.get(name));
        for i in 0..count {
            let arm = start.rotation * wide(&rest[i]);
            assert!(wide(&velocity[i]).distance(linear + angular.cross(arm)) < VELOCITY.abs);
            for (got, twist) in [(&solution[i], x), (&carried[i], trend)] {
                assert!(wide(got).distance(wide(&twist[..3]) + wide(&twist[3..]).cross(arm)) < VELOCITY.abs);
            }
        }
    }
}

#[test]
fn floating_frames_are_fitted_from_the_sums_of_their_nodes() {
    let width = context().reduce_size() as usize;
    let mut random = Random(51);
    let sizes = [1, width - 1, width, width + 1, 1234];
    let h = 1e-3;
    let total: usize = sizes.iter().sum();
    let field = |scale: f64, random: &mut Random| -> Vec<[f32; 4]> {
        (0..total).map(|_| narrow(scale * random.vector())).collect()
    };
    let mut rest = field(0.2, &mut random);
    rest.iter_mut().for_each(|r| r[3] = (0.01 + 0.005 * random.next()) as f32);
    let (d, v) = (field(0.02, &mut random), field(1.0, &mut random));
    let moves: Vec<_> = sizes.iter().map(|_| moving(&mut random, h, 0.2)).collect();
    let firsts: Vec<usize> = sizes.iter().scan(0, |sum, n| Some(std::mem::replace(sum, *sum + n))).collect();
    let floating: Vec<[u32; 4]> = (0..sizes.len()).map(|i| [i as u32, firsts[i] as u32, sizes[i] as u32, 0]).collect();
    let out = case("pose/fit")
        .size(Size::Reduce)
        .input("frames", &moves.iter().map(|m| m.0).collect::<Vec<_>>())
        .input("floating", &floating)
        .input("node_rest", &rest)
        .input("displacement", &d)
        .input("velocity", &v)
        .output::<Fit>("fits", sizes.len())
        .groups(sizes.len())
        .run();
    for (i, fit) in out.get::<Fit>("fits").iter().enumerate() {
        let end = DMat3::from_quat(moves[i].2.rotation);
        let (mut want, mut size) = ([DVec3::ZERO; 4], [0.0; 4]);
        for n in firsts[i]..firsts[i] + sizes[i] {
            let (m, r, d, v) = (f64::from(rest[n][3]), wide(&rest[n]), wide(&d[n]), wide(&v[n]));
            for (k, term) in [m * d, m * r.cross(d), m * v, m * (end * (r + d)).cross(v)].into_iter().enumerate() {
                want[k] += term;
                size[k] += term.length();
            }
        }
        for (k, got) in [fit.shift, fit.twist, fit.momentum, fit.spin].iter().enumerate() {
            let error = wide(got).distance(want[k]) / size[k];
            assert!(
                error < SUM,
                "sum {k} (0: shift, 1: twist, 2: momentum, 3: spin) over {} nodes: relative error {error:e}",
                sizes[i]
            );
        }
    }
}
