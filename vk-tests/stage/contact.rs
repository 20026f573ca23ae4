//! Tests of the kernels contact/candidates (which finds the skin vertices that collide), contact/deepest (which lists
//! the deepest contacts where not all fit) and contact/response (which computes the coefficients of contacts for the
//! solver). Soft balls, a tool and a floor are compared with the f64 oracle; flags and contact lists of any length are
//! tested. A side is body a or b of a pair; a candidate is a skin vertex that may be a contact; a chunk is a group of
//! at most 64 skin vertices; a contact patch is a place where a pair may touch along one normal; a depth path is an
//! implementation of the stage that finds ray hits.

use std::collections::BTreeMap;

use glam::{DQuat, DVec3};
use palpate::internal::gpu::Size;
use palpate::internal::prepare::{Body, Shape};
use palpate::internal::shaders;
use palpate::internal::shaders::{Contact, Counts, NONE};
use palpate::internal::stages::depth::Path;
use palpate::internal::stages::{CHUNK_VERTICES, PAIR_PATCHES};
use palpate::scene::Sides;
use palpate_oracle::contact::{Carrier, ContactLaw, Support, Surface, Tested};
use palpate_oracle::{contact as oracle, skin as embedded};

use crate::harness::bodies::{half_space, octants, rigid, soft, sphere, whole};
use crate::harness::random::Random;
use crate::harness::{Tolerance, case, context, expect_close};
use crate::stage::flow::{Flow, PATHS};

/// Radius of the balls and the tool, m.
const RADIUS: f64 = 0.01;
/// Tolerance of depths, m, as in vk-tests/scene/spheres.rs.
const DEPTH: f64 = 1e-5 * RADIUS;
/// Relative tolerance of areas, weights and rates, which are products of a few f32 numbers; a vertex normal, which is
/// summed over the six triangles at the vertex, loses a digit.
const RELATIVE: f64 = 1e-5;
/// Tolerance of barycentric weights: positions are known to 1e-7 of the radius, and triangles have edges of some 0.1
/// radii.
const WEIGHT: f64 = 2e-5;
/// Flags of a step, in this order: too many contacts; a contact deeper than the limit; a skin that is not a height
/// field.
const CONTACT_OVERFLOW: u32 = 4;
const DEPTH_LIMIT: u32 = 8;
const NOT_HEIGHT_FIELD: u32 = 16;

/// Two soft balls side by side, deformed and moving, on a floor, and a tool that presses on both.
pub fn crowd(path: Path) -> (Vec<Body>, Body, Flow) {
    crowd_of(path, Sides::Both, [3; 3])
}

/// The bodies of [`crowd`]. `sides` chooses whose vertices are tested for contact, `levels` how finely the two balls
/// and the tool are divided.
fn crowd_of(path: Path, sides: Sides, levels: [u32; 3]) -> (Vec<Body>, Body, Flow) {
    let mut random = Random(52);
    let ball = |name: &str, level: u32, x: f64, random: &mut Random| {
        soft(name, sphere(RADIUS, level), octants, DVec3::new(x, 0.92 * RADIUS, 0.0), random.turn(3.0))
    };
    let bodies = vec![
        ball("a", levels[0], -0.9 * RADIUS, &mut random),
        ball("b", levels[1], 0.95 * RADIUS, &mut random),
        half_space(DVec3::Y, 0.0),
    ];
    let place = DVec3::new(0.1 * RADIUS, 2.3 * RADIUS, 0.2 * RADIUS);
    let tool = rigid("tool", sphere(RADIUS, levels[2]), whole, place, random.turn(3.0));
    let mut flow = Flow::of_sides(&bodies, Some(&tool), place, sides);
    for (d, v) in flow.displacement.iter_mut().zip(&mut flow.velocity) {
        *d = (0.02 * RADIUS * random.vector()).as_vec3().extend(0.0).to_array();
        *v = (0.1 * random.vector()).as_vec3().extend(0.0).to_array();
    }
    flow.params.tool_twist = [0.1, -0.2, 0.05, 3.0, -2.0, 1.0];
    flow.query(path);
    flow.gather();
    (bodies, tool, flow)
}

pub(super) fn vector(x: &[f32]) -> DVec3 {
    DVec3::new(x[0].into(), x[1].into(), x[2].into())
}

/// Positions of a body's skin in world axes, relative to `origin`, m.
pub(super) fn positions(flow: &Flow, body: &Body, index: usize, origin: DVec3) -> Vec<DVec3> {
    let place = |x: DVec3| body.position - origin + body.orientation * x;
    match &body.shape {
        Shape::Soft { layer, embedding, .. } => {
            let first = flow.model.soft.iter().find(|s| s.body == index).unwrap().nodes.start;
            let moved: Vec<DVec3> =
                layer.nodes.iter().enumerate().map(|(i, x)| *x + vector(&flow.displacement[first + i])).collect();
            embedded::embed(embedding, layer, &moved).into_iter().map(place).collect()
        }
        Shape::Rigid { skin, .. } => skin.vertices.iter().map(|x| place(*x)).collect(),
        Shape::Plane { .. } => vec![],
    }
}

fn surface<'a>(flow: &Flow, body: &'a Body, index: usize, origin: DVec3) -> Surface<'a> {
    let (skin, support) = match &body.shape {
        Shape::Soft { layer, embedding, skin, .. } => (skin, Support::Soft(index, layer, embedding)),
        Shape::Rigid { skin, .. } => (skin, Support::Tool),
        Shape::Plane { .. } => unreachable!(),
    };
    Surface { positions: positions(flow, body, index, origin), triangles: &skin.triangles, areas: &skin.areas, support }
}

/// The oracle's contacts of every pair, by side (2 i: body a of pair i, 2 i + 1: body b) and vertex as the kernels
/// number them.
fn wanted(bodies: &[Body], tool: &Body, flow: &Flow, sides: Sides) -> BTreeMap<(u32, u32), oracle::Contact> {
    let all: Vec<&Body> = bodies.iter().chain([tool]).collect();
    let law = ContactLaw { stiffness: 1e6, damping: 1e3, depth_limit: 1.0 };
    let mut firsts = vec![0];
    for body in &all {
        let count = match &body.shape {
            Shape::Soft { skin, .. } | Shape::Rigid { skin, .. } => skin.vertices.len() as u32,
            Shape::Plane { .. } => 0,
        };
        firsts.push(firsts[firsts.len() - 1] + count);
    }
    // The bodies (0: ball a, 1: ball b, 2: floor, 3: tool) make these pairs, in this order; the floor, a half-space, is
    // always second.
    let pairs = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (3, 2)];
    assert_eq!(flow.pairs.len(), pairs.len());
    let mut contacts = BTreeMap::new();
    for (r, (a, b)) in pairs.into_iter().enumerate() {
        let first = surface(flow, all[a], a, tool.position);
        let found = match &all[b].shape {
            Shape::Plane { normal, offset } => {
                oracle::gather_plane(&first, *normal, offset - normal.dot(tool.position), &law)
            }
            _ => {
                let contact_patches = &flow.contact_patches[PAIR_PATCHES * r..][..PAIR_PATCHES];
                // A pair whose bodies are not near has no contact patch; the other pairs touch in one place each.
                assert!(
                    contact_patches[1..].iter().all(|contact_patch| contact_patch.weight == 0.0),
                    "pair {r} has more than one contact patch: {contact_patches:?}"
                );
                if contact_patches[0].weight == 0.0 {
                    continue;
                }
                let normal = vector(&contact_patches[0].normal).normalize();
                let second = surface(flow, all[b], b, tool.position);
                match sides {
                    Sides::Both => oracle::gather(normal, &first, &second, &law),
                    Sides::One => oracle::gather_finer(normal, &first, &second, &law),
                }
            }
        };
        for contact in found {
            let body = if contact.of_first { a } else { b };
            let side = 2 * r as u32 + u32::from(!contact.of_first);
            let Tested::Vertex(vertex) = contact.tested else { panic!("a contact of a triangle") };
            contacts.insert((side, firsts[body] + vertex), contact);
        }
    }
    contacts
}

/// The weight of each node, and that of the tool, in a contact's normal velocity J v = n . (v(s1) - v(s2)), with the
/// normal n and the velocities v of the contact's two surface points s1 and s2.
fn jacobian(contact: &oracle::Contact, flow: &Flow) -> (BTreeMap<u32, f64>, f64) {
    let (mut nodes, mut tool) = (BTreeMap::new(), 0.0);
    for (point, sign) in [(&contact.first, 1.0), (&contact.second, -1.0)] {
        match &point.carrier {
            Carrier::Tool => tool += sign,
            Carrier::Fixed => {}
            Carrier::Nodes(body, weights) => {
                let first = flow.model.soft.iter().find(|s| s.body == *body).unwrap().nodes.start as u32;
                for (node, w) in weights {
                    *nodes.entry(first + node).or_insert(0.0) += sign * w;
                }
            }
        }
    }
    (nodes, tool)
}

/// Compares one contact's record and entries (nodes with weights) with those of the oracle's contact.
fn check(flow: &Flow, c: usize, want: &oracle::Contact) {
    let got = &flow.contacts[c];
    let what = format!("contact {c}, side {}, vertex {}", got.side, got.vertex);
    let relative = Tolerance { abs: 0.0, rel: RELATIVE };
    expect_close(&what, &got.normal, &want.normal.to_array(), Tolerance { abs: 1e-6, rel: 0.0 });
    expect_close(&what, &[got.depth], &[want.depth], Tolerance { abs: DEPTH, rel: 0.0 });
    // A vertex whose surface is nearly parallel to the contact normal has almost no area.
    expect_close(&what, &[got.area], &[want.area], Tolerance { abs: 1e-5 * RADIUS * RADIUS, rel: 1e-4 });
    expect_close(&what, &[got.stiffness, got.damping], &[want.stiffness, want.damping], relative);
    let (nodes, tool) = jacobian(want, flow);
    assert_eq!(f64::from(got.tool_sign), tool, "{what}: sign of the tool's weight in the normal velocity");
    let mut entries = BTreeMap::new();
    for quad in 4 * c..4 * c + got.quads as usize {
        for (node, w) in flow.entry_nodes[quad].iter().zip(flow.entry_weights[quad]) {
            *entries.entry(*node).or_insert(0.0) += f64::from(w);
        }
    }
    for node in nodes.keys().chain(entries.keys()) {
        let (g, w) = (entries.get(node).copied().unwrap_or(0.0), nodes.get(node).copied().unwrap_or(0.0));
        assert!((g - w).abs() < WEIGHT, "{what}: weight of node {node} is {g}, expected {w}");
    }
    // Arm (from the tool's centre) and rate (normal velocity) are taken at the colliding vertex: the force acts on the
    // line through this vertex and the opposing point.
    let vertex = vector(&flow.skin[got.vertex as usize]) - vector(&flow.params.tool_centre);
    let lever = tool * vertex.cross(want.normal);
    expect_close(&what, &got.arm, &vertex.to_array(), Tolerance { abs: DEPTH, rel: RELATIVE });
    let speed = |(node, w): (&u32, &f64)| w * want.normal.dot(vector(&flow.velocity[*node as usize]));
    let twist = (vector(&flow.params.tool_twist[..3]), vector(&flow.params.tool_twist[3..]));
    let rate = nodes.iter().map(speed).sum::<f64>() + tool * want.normal.dot(twist.0) + lever.dot(twist.1);
    expect_close(&what, &[got.rate], &[rate], Tolerance { abs: 0.1 * WEIGHT, rel: RELATIVE });
}

#[test]
fn a_crowd_of_soft_and_rigid_bodies_against_the_oracle() {
    for path in PATHS {
        check_crowd(path, Sides::Both, [3; 3], &[0, 1, 2, 4, 5, 6, 8, 9], &[10]);
        // Only vertices of the finer skin of each pair are tested: those of ball b against ball a, and those of the
        // balls against the tool.
        check_crowd(path, Sides::One, [3, 4, 2], &[1, 2, 4, 6, 8], &[0, 5, 9, 10]);
    }
}

/// Compares all contacts with the oracle's contacts. `gather` lists the sides that must have contacts, `silent` the
/// sides that must have none.
fn check_crowd(path: Path, sides: Sides, levels: [u32; 3], gather: &[usize], silent: &[usize]) {
    let (bodies, tool, flow) = crowd_of(path, sides, levels);
    let want = wanted(&bodies, &tool, &flow, sides);
    assert_eq!(flow.counts.flags & !NOT_HEIGHT_FIELD, 0, "flags on the depth path {}", path.name());
    let got: BTreeMap<_, _> = flow.contacts.iter().enumerate().map(|(c, x)| ((x.side, x.vertex), c)).collect();
    assert_eq!(
        got.len(),
        flow.counts.contacts as usize,
        "number of different contacts; each side may list a vertex once"
    );
    for (key, contact) in &want {
        match got.get(key) {
            Some(c) => check(&flow, *c, contact),
            None => assert!(
                contact.depth < DEPTH,
                "depth path {}: contact (side, vertex) {key:?}, {} m deep, is missed",
                path.name(),
                contact.depth
            ),
        }
    }
    for (key, c) in &got {
        assert!(
            want.contains_key(key) || f64::from(flow.contacts[*c].depth) < DEPTH,
            "(side, vertex) {key:?} is no contact of the oracle"
        );
    }
    let sides: Vec<usize> = (0..12).map(|s| got.keys().filter(|k| k.0 == s).count()).collect();
    // All pairs of bodies touch, except tool and floor; a half-space has no vertices that could collide.
    assert!(
        gather.iter().all(|s| sides[*s] > 2) && silent.iter().all(|s| sides[*s] == 0),
        "numbers of contacts by side: {sides:?}"
    );
}

#[test]
fn a_depth_beyond_the_limit_is_flagged_and_counts() {
    let floor = half_space(DVec3::Y, 0.0);
    let tool = rigid("tool", sphere(RADIUS, 2), whole, DVec3::Y * 0.5 * RADIUS, DQuat::IDENTITY);
    for (limit, flags) in [(0.6 * RADIUS, 0), (0.4 * RADIUS, DEPTH_LIMIT)] {
        let mut flow = Flow::new(std::slice::from_ref(&floor), Some(&tool), DVec3::ZERO);
        flow.params.depth_limit = limit as f32;
        flow.query(Path::Compute);
        assert_eq!(flow.counts.flags, flags);
        let deepest = flow.hits.iter().map(|h| h[0]).fold(0.0, f32::max);
        assert!(
            (f64::from(deepest) - 0.5 * RADIUS).abs() < DEPTH,
            "a depth beyond the limit must be kept: {deepest} m"
        );
    }
}

/// Runs contact/deepest on candidates with these depths (0: no contact). Returns the list of the deepest that it
/// writes.
fn deepest(depths: &[f32], capacity: usize) -> Vec<u32> {
    // Candidates that do not collide keep a depth of an earlier step, here 7 m.
    let hits: Vec<[f32; 4]> = depths.iter().map(|d| [if *d > 0.0 { *d } else { 7.0 }, 0.0, 0.0, 0.0]).collect();
    let word = |half: &[f32]| half.iter().enumerate().map(|(l, d)| u32::from(*d > 0.0) << l).sum();
    let colliding: Vec<u32> = depths.chunks(32).map(word).collect();
    let out = case("contact/deepest")
        .size(Size::Group)
        .constant("CAPACITY", capacity as u32)
        .input("candidate_hits", &hits)
        .input("counts", &[Counts { gathering: (depths.len() / CHUNK_VERTICES) as u32, ..Counts::default() }])
        .partial("contact_source", &vec![NONE; capacity + 1])
        .input("chunk_contacts", &colliding)
        .groups(1)
        .run();
    out.get("contact_source")
}

/// The list that contact/deepest must write: the deepest candidates in their order, and among equally deep ones the
/// first.
fn wanted_deepest(depths: &[f32], capacity: usize) -> Vec<u32> {
    let mut sorted: Vec<f32> = depths.iter().copied().filter(|d| *d > 0.0).collect();
    sorted.sort_unstable_by(|x, y| y.total_cmp(x));
    let least = sorted[capacity];
    let mut room = capacity - sorted.iter().filter(|d| **d > least).count();
    let mut stays = |d: f32| {
        let tie = d == least && room > 0;
        room -= usize::from(tie);
        tie || d > least
    };
    (0..depths.len() as u32).filter(|i| stays(depths[*i as usize])).collect()
}

#[test]
fn the_deepest_stay_in_order_where_not_all_fit() {
    let mut random = Random(53);
    for chunks in [1, 7, 8, 9, 63, 64, 65, 1000] {
        // At most every third candidate collides, and some are equally deep.
        let depth = |i: usize, x: f64| if i.is_multiple_of(3) { (1e-3 * x).max(0.0) as f32 } else { 0.0 };
        let mut depths: Vec<f32> = (0..CHUNK_VERTICES * chunks).map(|i| depth(i, random.next())).collect();
        depths.iter_mut().step_by(15).for_each(|d| *d = 5e-4);
        let all = depths.iter().filter(|d| **d > 0.0).count();
        for capacity in [1, 5, 500, all - 1].into_iter().filter(|capacity| *capacity < all) {
            let source = deepest(&depths, capacity);
            assert_eq!(
                source[..capacity],
                wanted_deepest(&depths, capacity),
                "list of the deepest candidates of {chunks} chunks, where {capacity} contacts fit"
            );
            assert_eq!(source[capacity], NONE);
        }
    }
}

/// A ball lies wholly below the surface of a half-space: either all its vertices fit into the list, or the deepest stay
/// and a flag is raised.
#[test]
fn more_contacts_than_fit_are_flagged() {
    let floor = half_space(DVec3::Y, 0.5);
    let tool = rigid("tool", sphere(0.1, 5), whole, DVec3::ZERO, DQuat::IDENTITY);
    let run = |capacity: Option<usize>| {
        let mut flow = Flow::new(std::slice::from_ref(&floor), Some(&tool), DVec3::ZERO);
        flow.capacity = capacity.unwrap_or(flow.capacity);
        flow.query(Path::Compute);
        flow
    };
    let all = run(None);
    let found = all.counts.contacts as usize;
    let colliding: Vec<u32> = (0..all.hits.len()).filter(|i| all.hits[*i][0] > 0.0).map(|i| i as u32).collect();
    assert!(
        found > 200 && all.source[..found] == colliding,
        "{found} contacts, expected more than 200 and exactly the colliding vertices"
    );
    let group = context().group_size() as usize;
    for capacity in [1, 64, found - 1, found, found + 1] {
        let mut flow = run(Some(capacity));
        let (kept, fits) = (found.min(capacity), found <= capacity);
        let words = [shaders::ARGS_CONTACTS, shaders::ARGS_DEEPEST]
            .map(|args_index| flow.args[3 * args_index as usize] as usize);
        assert_eq!(flow.counts.contacts as usize, kept);
        assert_eq!(words, [kept.div_ceil(group), usize::from(!fits)]);
        assert_eq!(
            flow.counts.flags & CONTACT_OVERFLOW,
            if fits { 0 } else { CONTACT_OVERFLOW },
            "overflow flag where {capacity} contacts fit"
        );
        assert!(!fits || flow.source[..found] == colliding);
        let depths: Vec<f32> = flow.hits.iter().map(|hit| hit[0]).collect();
        flow.gather();
        let want = if fits { colliding.clone() } else { wanted_deepest(&depths, capacity) };
        assert_eq!(flow.source[..kept], want);
        assert!((0..kept).all(|c| flow.contacts[c].depth == depths[want[c] as usize]));
    }
}

#[test]
fn one_vertex_against_a_half_space_by_hand() {
    // The tool is a regular octahedron with a radius of 1 m. Its lowest corner, the sole contact, is 0.25 m deep. The
    // corner faces the half-space exactly, so that its area is its rest area: a third of four triangles with edges of
    // sqrt(2) m.
    let floor = half_space(DVec3::Y, 0.0);
    let tool = rigid("tool", sphere(1.0, 0), whole, DVec3::new(2.0, 0.75, 0.0), DQuat::IDENTITY);
    let mut flow = Flow::new(&[floor], Some(&tool), DVec3::ZERO);
    flow.params.tool_centre = [1.5, 0.75, 0.0];
    flow.params.tool_twist = [0.0, -2.0, 0.0, 0.0, 0.0, 1.0];
    flow.query(Path::Compute);
    flow.gather();
    assert_eq!((flow.counts.contacts, flow.counts.entries, flow.contacts.len()), (1, 0, 1));
    let got: &Contact = &flow.contacts[0];
    let close = Tolerance { abs: 1e-6, rel: 1e-6 };
    expect_close("normal", &got.normal, &[0.0, -1.0, 0.0], close);
    expect_close("area", &[got.area], &[4.0 / 3.0 * 3f64.sqrt() / 2.0], close);
    expect_close("depth", &[got.depth], &[0.25], close);
    expect_close("arm", &got.arm, &[0.5, -1.0, 0.0], close);
    expect_close("rate", &[got.rate], &[2.0 - 0.5], close);
    // The skin's vertices are x, y, z, -x, -y, -z, so that -y has index 4.
    assert_eq!((got.vertex, got.side, got.triangle, got.quads), (4, 0, NONE, 0));
    assert_eq!((got.tool_sign, got.stiffness, got.damping), (1.0, 1e6, 1e3));
    assert_eq!(got.barycentric, [0.0; 2]);
    assert_eq!(flow.what[flow.source[0] as usize], [4, 0, NONE, 0]);
}
