//! Tests of the proximity query (which vertices of two bodies lie inside the other body, and how deep) without a
//! simulation, mostly of two spheres. Depths are measured along a given direction, or along the normal of the contact
//! patch, the place where the bodies may touch; sizes and places vary. Answers must be right on both depth paths
//! (graphics and compute implementation of the depth stage) and the same in every run.

use glam::{DQuat, DVec3};
use palpate::internal::prepare::{self, Body, Shape};
use palpate::internal::query::Answer;
use palpate::internal::query::QuerySettings;
use palpate::internal::stages::depth::Path;
use palpate::{Flags, Query};
use palpate_oracle::contact::ray_depths;

use crate::harness::bodies::{octants, rigid, sphere, whole};
use crate::harness::random::Random;
use crate::harness::{assert_clean, context};
use crate::scene::whole_step::scene;

/// Tolerance of depths relative to the spheres' radius, as promised to users.
const DEPTH: f64 = 1e-5;
/// Tolerance of a unit vector's components, which are f32 numbers.
const UNIT: f64 = 1e-6;

type PoseOf = (DVec3, DQuat);

fn placed(body: &Body, (position, orientation): PoseOf) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let Shape::Rigid { skin, .. } = &body.shape else { panic!("the body is not rigid") };
    (skin.vertices.iter().map(|x| position + orientation * *x).collect(), skin.triangles.clone())
}

/// Checks every contact against the ray along its normal, and that no contact which a ray finds is missing. Depths may
/// be off by `DEPTH` times `radius` (m). Returns the number of contacts.
fn check(what: &str, bodies: [&Body; 2], poses: [PoseOf; 2], answer: &Answer, radius: f64) -> usize {
    let normal = DVec3::from(answer.contact_patches[0].normal.map(f64::from)).normalize();
    let [(ax, at), (bx, bt)] = [0, 1].map(|k| placed(bodies[k], poses[k]));
    let hits =
        [ray_depths(normal, &ax, &at, &bx, &bt, f64::INFINITY), ray_depths(-normal, &bx, &bt, &ax, &at, f64::INFINITY)];
    let mut found = [vec![false; ax.len()], vec![false; bx.len()]];
    for contact in &answer.contacts {
        let (body, vertex) = (contact.body, contact.vertex as usize);
        assert!(!std::mem::replace(&mut found[body][vertex], true), "{what}: a vertex is reported twice");
        assert!(
            (contact.normal - normal).abs().max_element() < UNIT,
            "{what}: the contact's normal is not that of the contact patch"
        );
        let depth = hits[body][vertex].map_or(0.0, |hit| hit.depth);
        assert!(
            (contact.depth - depth).abs() < DEPTH * radius,
            "{what}: {contact:?}, but the depth by ray cast is {depth} m"
        );
        // The point that the contact reports must lie where the line through the vertex meets the other skin (surface
        // mesh).
        let (own, other, triangles) = if body == 0 { (&ax, &bx, &bt) } else { (&bx, &ax, &at) };
        let corners = triangles[contact.triangle as usize].map(|v| other[v as usize]);
        let point: DVec3 = corners.iter().zip(contact.barycentric).map(|(x, w)| *x * w).sum();
        let towards = if body == 0 { -normal } else { normal };
        let gap = point.distance(own[vertex] + contact.depth * towards);
        assert!(gap < DEPTH * radius, "{what}: the point of {contact:?} is {gap} m off the line");
    }
    for (hits, found) in hits.iter().zip(&found) {
        let missed =
            hits.iter().zip(found).filter(|(hit, found)| !**found && hit.is_some_and(|h| h.depth > DEPTH * radius));
        assert_eq!(missed.count(), 0, "{what}: number of contacts that only ray casts find");
    }
    answer.contacts.len()
}

#[test]
fn spheres_of_any_size_anywhere_along_any_direction() {
    let mut random = Random(71);
    for path in [Path::Compute, Path::Graphics] {
        for (radius, place) in [(0.01, 0.0), (1e-3, 3.0), (1e4, 1e6), (1.0, 1e3)] {
            let a = rigid("a", sphere(radius, 3), octants, DVec3::ZERO, DQuat::IDENTITY);
            let b = rigid("b", sphere(radius, 4), whole, DVec3::ZERO, DQuat::IDENTITY);
            let towards = random.vector().normalize();
            let tilted = (towards + 0.2 * random.vector()).normalize();
            for direction in [None, Some(7.0 * tilted)] {
                let settings = QuerySettings { direction, depth: Some(path), ..QuerySettings::of(&a, &b) };
                let mut query = Query::on_device(context(), &a, &b, &settings).unwrap();
                for gap in [1.92, 1.85] {
                    let at = place * random.vector();
                    let poses = [(at, random.turn(3.0)), (at + gap * radius * towards, random.turn(3.0))];
                    let answer = query.run(poses[0], poses[1]).unwrap();
                    let what = format!("{}, radius {radius} m, {gap} radii apart", path.name());
                    assert_eq!(
                        (answer.flags, answer.contact_patches.len()),
                        (Flags::default(), 1),
                        "{what}: flags and number of contact patches"
                    );
                    if direction.is_some() {
                        assert!(
                            (answer.contacts[0].normal - tilted).abs().max_element() < UNIT,
                            "{what}: the normal is not the given direction"
                        );
                    }
                    assert!(check(&what, [&a, &b], poses, &answer, radius) > 4, "{what}: at most 4 contacts");
                    let again = query.run(poses[0], poses[1]).unwrap();
                    assert_eq!(again.contacts, answer.contacts, "{what}: a second run gives other contacts");
                    assert!(answer.stage_times.iter().any(|(stage, us)| stage == "contact" && *us > 0.0));
                }
                let apart =
                    query.run((DVec3::ZERO, DQuat::IDENTITY), (3.0 * radius * towards, DQuat::IDENTITY)).unwrap();
                assert_eq!((apart.contacts.len(), apart.flags), (0, Flags::default()));
            }
        }
    }
    assert_clean(context(), "queries");
}

#[test]
#[ignore = "long: 15 s"]
fn a_fine_head_in_a_cube_of_twelve_triangles_is_found_whole_or_flagged() {
    // The engine sorts vertices into a grid whose cells are about as large as the cube's triangles, so that all
    // vertices of the head lie in a few cells.
    let corners = (0..8).map(|k| DVec3::new((k & 1).into(), (k >> 1 & 1).into(), (k >> 2).into()) - 0.5).collect();
    let quads = [[0u32, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let halves = quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    let cube = rigid("cube", (corners, halves), whole, DVec3::ZERO, DQuat::IDENTITY);
    for vertices in [10_000, 200_000] {
        let text = format!("[[body]]\nname = \"head\"\nsurface = {{ model = \"head\", vertices = {vertices} }}\n");
        let scene = scene(&text);
        let head = prepare::body(&scene.bodies[0], &scene).unwrap();
        for path in [Path::Compute, Path::Graphics] {
            for bodies in [[&cube, &head], [&head, &cube]] {
                let poses = [(DVec3::ZERO, DQuat::IDENTITY), (0.36 * DVec3::Y, DQuat::IDENTITY)];
                let settings = QuerySettings {
                    direction: Some(DVec3::Y),
                    depth: Some(path),
                    ..QuerySettings::of(bodies[0], bodies[1])
                };
                let mut query = Query::on_device(context(), bodies[0], bodies[1], &settings).unwrap();
                let answer = query.run(poses[0], poses[1]).unwrap();
                let what = format!("{}, {vertices} vertices", path.name());
                println!("{what}: {} contacts, flags {:?}", answer.contacts.len(), answer.flags);
                if !answer.flags.contains(Flags::CONTACT_OVERFLOW) {
                    check(&what, bodies, poses, &answer, 0.3);
                } else {
                    assert!(vertices > 10_000, "{what}: the contacts overflow, which only the finer head may cause");
                }
            }
        }
    }
    assert_clean(context(), "queries of a cube and a head");
}
