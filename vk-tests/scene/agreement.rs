//! Compares the proximity query (which vertices of two bodies lie inside the other body, and how deep) with f64 ray
//! casts, for real meshes in light contact and for small meshes in thousands of poses. Depths and the sets of colliding
//! vertices must agree, and culling must leave no colliding vertex out.

use std::sync::Arc;

use glam::DVec3;
use palpate::internal::prepare::repair;
use palpate::internal::query::QuerySettings;
use palpate::internal::query::{Answer, Timing};
use palpate::scene::Model;
use palpate::{Context, Options, Query, QueryContact};
use palpate_oracle::rays::Rays;
use parry3d_f64::math::Vector;
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::TriMesh;

use crate::harness::bodies::{Mesh, octants, sphere, whole};
use crate::harness::random::Random;
use crate::harness::real_meshes::meshes;
use crate::scene::judge::{APART, Pose, Subject, Tally, head, judge};

/// Greatest error of a depth in light contact, relative to the smaller body's size (measured: see
/// docs/evidence/accuracy.md).
const DEPTH: f64 = 1e-5;
/// Greatest number of colliding vertices (vertices inside the other body) that only the query or only the rays find,
/// relative to the number of contacts, which are the colliding vertices that the query finds.
const DIFFERENT: f64 = 1e-3;
/// Depth of a light contact, relative to the smaller body's size.
const LIGHT: f64 = 5e-3;
/// Least ratio of a contact's depth along the normal to the vertex's shortest distance to the other surface: 1, less an
/// allowance for rounding.
const LEAST_RATIO: f64 = 1.0 - 1e-6;
/// Number of poses of each pair of real meshes; each pose is queried twice.
const POSES: usize = 20;
/// Number of poses of small meshes that are queried, summed over all ten pairs of meshes.
const THROWN: usize = 10_000;

/// A context without Vulkan's validation layer, since these tests run ten thousand queries.
fn device() -> Arc<Context> {
    let device = std::env::var("PALPATE_TEST_DEVICE").ok();
    Context::open(&Options { device, validation: false, ..Options::of_program() }).unwrap_or_else(|e| panic!("{e}"))
}

/// Distance, m, by which body b, which lies far away from body a in the direction `towards`, must move against this
/// direction until a vertex of either body meets a triangle of the other; `None` if the bodies never meet. `a` and `b`
/// are the bodies' vertices.
fn room(towards: DVec3, subjects: [&Subject; 2], a: &[DVec3], b: &[DVec3]) -> Option<f64> {
    let up = Rays::new(-towards, b, &subjects[1].skin().triangles);
    let down = Rays::new(towards, a, &subjects[0].skin().triangles);
    let rooms = a.iter().filter_map(|x| up.first(*x)).chain(b.iter().filter_map(|x| down.first(*x)));
    rooms.map(|ray_hit| ray_hit.depth).reduce(f64::min)
}

/// Random poses of two bodies in light contact, and the direction from a to b. Both bodies are turned at random, b is
/// also shifted at random, and b is moved along the direction until it is slightly deeper than at first touch.
fn light(random: &mut Random, subjects: [&Subject; 2]) -> ([Pose; 2], DVec3) {
    let [a, b] = subjects;
    loop {
        let towards = random.vector().normalize();
        let pose_a = a.pose(random.turn(3.0), DVec3::ZERO);
        let far = 2.0 * (a.size + b.size);
        let turn = random.turn(3.0);
        let aside = 0.3 * a.size.min(b.size) * random.vector();
        let place = |along: f64| b.pose(turn, aside + along * towards);
        let Some(room) = room(towards, subjects, &a.placed(pose_a), &b.placed(place(far))) else { continue };
        let deeper = LIGHT * a.size.min(b.size);
        return ([pose_a, place(far - room - deeper)], towards);
    }
}

/// For every contact of an answer, the depth along the normal divided by the vertex's distance to the other surface.
/// Contacts whose distance is within rounding errors are left out.
fn ratios(subjects: [&Subject; 2], poses: [Pose; 2], trees: &[TriMesh; 2], answer: &Answer) -> Vec<f64> {
    let of = |contact: &QueryContact| {
        let (own, other) = (contact.body, 1 - contact.body);
        let x = poses[own].0 + poses[own].1 * subjects[own].skin().vertices[contact.vertex as usize];
        let local = poses[other].1.conjugate() * (x - poses[other].0);
        let point = Vector::new(local.x, local.y, local.z);
        let near = trees[other].project_local_point(point, false).point;
        let corners = subjects[other].skin().triangles[contact.triangle as usize];
        let met: DVec3 =
            (0..3).map(|k| contact.barycentric[k] * subjects[other].skin().vertices[corners[k] as usize]).sum();
        // The contact also has the point of the other surface that the vertex's ray hits. The distance of vertex and
        // point is the depth, without the f32 rounding of the depth that the query reports.
        (local.distance(met), local.distance(DVec3::new(near.x, near.y, near.z)))
    };
    let size = subjects[0].size.min(subjects[1].size);
    answer.contacts.iter().map(of).filter(|(_, near)| *near > APART * size).map(|(depth, near)| depth / near).collect()
}

fn tree(subject: &Subject) -> TriMesh {
    let points = subject.skin().vertices.iter().map(|x| Vector::new(x.x, x.y, x.z)).collect();
    TriMesh::new(points, subject.skin().triangles.clone()).unwrap()
}

#[test]
#[ignore = "needs real meshes"]
fn lasting_real_meshes_in_light_contact_agree_with_f64_rays() {
    let Some(folder) = meshes() else { return };
    let read = |name: &str| {
        let (mesh, _) = repair::read(&folder.join(format!("surf/{name}.obj")), true).unwrap();
        Subject::new(name, (mesh.vertices, mesh.triangles), whole)
    };
    let [head_mesh, gear, pumpkin, human, small] = ["head", "gear", "pumpkin", "human", "human_3000"].map(read);
    let (device, mut random) = (device(), Random(401));
    head();
    let mut all = Tally::default();
    for [a, b] in
        [[&head_mesh, &head_mesh], [&gear, &gear], [&pumpkin, &pumpkin], [&human, &head_mesh], [&small, &gear]]
    {
        let name = format!("{} {}", a.name, b.name);
        let settings = QuerySettings { timing: Timing::Off, ..QuerySettings::of(&a.body, &b.body) };
        let mut query = Query::on_device(&device, &a.body, &b.body, &settings).unwrap();
        let trees = [tree(a), tree(b)];
        let mut sum = Tally::default();
        for pose in 0..POSES {
            let (poses, towards) = light(&mut random, [a, b]);
            // The query runs once with the direction of depth that it estimates itself, and once with `towards`.
            for direction in [None, Some(towards)] {
                query.set_direction(direction);
                let answer = query.run(poses[0], poses[1]).unwrap();
                let mut tally =
                    judge(&format!("{name}, pose {pose}, {direction:?}"), [a, b], poses, &answer, f64::INFINITY);
                tally.ratios = ratios([a, b], poses, &trees, &answer);
                sum.add(tally);
            }
        }
        sum.row(&name);
        all.add(sum);
    }
    all.row("all");
    all.ratios.sort_by(f64::total_cmp);
    let at = |share: f64| all.ratios[((all.ratios.len() - 1) as f64 * share) as usize];
    println!(
        "depth along the normal divided by the distance to the surface: least {:.6}, median {:.3}, 90th percentile \
         {:.3}, greatest {:.1}",
        at(0.0),
        at(0.5),
        at(0.9),
        at(1.0)
    );
    assert!(all.contacts > 10 * POSES && at(0.0) > LEAST_RATIO);
    assert!(
        all.worst <= DEPTH,
        "greatest depth error, relative to the smaller body's size, is {}; it occurs in {}",
        all.worst,
        all.where_worst
    );
    assert!(
        ((all.missing + all.extra) as f64) <= DIFFERENT * all.contacts as f64,
        "vertices that only the query or only the rays find:\n{}",
        all.different.join("\n")
    );
}

/// A torus with a ring of radius `radius` and a round section of radius `section`, m.
fn torus(radius: f64, section: f64, around: u32, across: u32) -> Mesh {
    let at = |i: u32, n: u32| std::f64::consts::TAU * f64::from(i) / f64::from(n);
    let vertex = |(i, k): (u32, u32)| {
        let (long, short) = (at(i, around), at(k, across));
        let out = radius + section * short.cos();
        DVec3::new(out * long.cos(), out * long.sin(), section * short.sin())
    };
    let cells = || (0..around).flat_map(move |i| (0..across).map(move |k| (i, k)));
    let index = |i: u32, k: u32| (i % around) * across + k % across;
    let halves = cells().flat_map(|(i, k)| {
        let [a, b, c, d] = [index(i, k), index(i + 1, k), index(i + 1, k + 1), index(i, k + 1)];
        [[a, b, c], [a, c, d]]
    });
    (cells().map(vertex).collect(), halves.collect())
}

#[test]
#[ignore = "long: 2 min"]
fn lasting_culling_leaves_no_colliding_vertex_out() {
    let subjects = [
        Subject::new("sphere 258", sphere(0.1, 3), octants),
        Subject::new("torus 480", torus(0.08, 0.03, 30, 16), whole),
        Subject::new("thin torus 384", torus(0.1, 0.012, 48, 8), whole),
        Subject::new("head 3000", palpate::internal::prepare::model::surface(Model::Head, 3000), whole),
    ];
    let (device, mut random) = (device(), Random(402));
    head();
    let mut all = Tally::default();
    for (i, a) in subjects.iter().enumerate() {
        for b in &subjects[i..] {
            let settings = QuerySettings { timing: Timing::Off, ..QuerySettings::of(&a.body, &b.body) };
            let mut query = Query::on_device(&device, &a.body, &b.body, &settings).unwrap();
            let mut sum = Tally::default();
            for pose in 0..THROWN / 10 {
                // The poses range from a light touch to one body within the other.
                let apart = 0.5 * (a.size + b.size) * (0.6 + 0.4 * random.next());
                let poses = [
                    a.pose(random.turn(3.0), DVec3::ZERO),
                    b.pose(random.turn(3.0), apart * random.vector().normalize()),
                ];
                let answer = query.run(poses[0], poses[1]).unwrap();
                sum.add(judge(&format!("pose {pose}"), [a, b], poses, &answer, settings.depth_limit));
            }
            sum.row(&format!("{}, {}", a.name, b.name));
            all.add(sum);
        }
    }
    all.row("all");
    assert!(all.queries >= THROWN && all.contacts > 10 * THROWN);
    assert_eq!(all.missing, 0, "colliding vertices that the query left out:\n{}", all.different.join("\n"));
    assert!(
        all.extra as f64 <= DIFFERENT * all.contacts as f64,
        "contacts that the f64 rays do not have:\n{}",
        all.different.join("\n")
    );
}
