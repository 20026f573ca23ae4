//! Tests of sphere meshes against planes and each other, through every kernel of the proximity query and on every depth
//! path. A depth path is an implementation of the stage that finds ray hits: places where a vertex's ray along the
//! contact normal meets a triangle of the other body. The second body of a pair is called the tool. Depths must be
//! those of f64 ray casts on the same meshes, and their error against a true sphere must shrink with the square of the
//! edge length.

use std::collections::BTreeMap;

use glam::{DQuat, DVec3};
use palpate::internal::prepare::{Body, Shape};
use palpate::internal::stages::depth::Path;
use palpate_oracle::contact::{Hit, ray_depths};

use crate::harness::bodies::{half_space, octants, rigid, sheet, sphere, whole};
use crate::harness::random::Random;
use crate::stage::flow::{Flow, PATHS};

/// Radius of the spheres, m.
const RADIUS: f64 = 0.01;
/// Tolerance of depths, m, as promised to users: f32 rounds positions near the tool to 1e-7 of the radius, and steep
/// slopes at the rim of a contact magnify this error a few times.
const DEPTH: f64 = 1e-5 * RADIUS;
/// Greatest ratio of the depth error on a mesh to that on a mesh with twice the edge length: a quarter in theory, and a
/// little more since the worst vertex is not at the same place in its triangle.
const SECOND_ORDER: f64 = 0.35;
/// World positions of the vertices of a rigid body's skin (surface mesh), and the skin's triangles.
fn mesh(body: &Body) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let Shape::Rigid { skin, .. } = &body.shape else { panic!("the body is not rigid") };
    let place = |x: &DVec3| body.position + body.orientation * *x;
    (skin.vertices.iter().map(place).collect(), skin.triangles.clone())
}

/// Depth (m) of each colliding vertex and the triangle of the other body that the vertex's ray hits, by side (0: vertex
/// of body a, 1: of b) and number of the vertex within its body.
type Depths = BTreeMap<(u32, u32), (f64, u32)>;

/// The ray hits that the kernels found. The kernels number the vertices and triangles of both bodies in common arrays,
/// and the results here number them within each body: `first` and `first_triangle`, the numbers of each body's first
/// vertex and triangle, are subtracted.
fn got(flow: &Flow, first: [u32; 2], first_triangle: [u32; 2]) -> Depths {
    let hit = |(hit, what): (&[f32; 4], &[u32; 4])| {
        let (side, other) = (what[1] as usize % 2, 1 - what[1] as usize % 2);
        let key = (what[1], what[0] - first[side]);
        (hit[0] > 0.0).then(|| (key, (f64::from(hit[0]), what[2].wrapping_sub(first_triangle[other]))))
    };
    flow.hits.iter().zip(&flow.what).filter_map(hit).collect()
}

/// The ray hits of f64 ray casts between bodies `a` and `b` along the normal.
fn wanted(normal: DVec3, a: &Body, b: &Body) -> Depths {
    let ((ax, at), (bx, bt)) = (mesh(a), mesh(b));
    let sides = [ray_depths(normal, &ax, &at, &bx, &bt, 1.0), ray_depths(-normal, &bx, &bt, &ax, &at, 1.0)];
    let mut depths = Depths::new();
    for (side, hits) in sides.iter().enumerate() {
        let found = hits.iter().enumerate().filter_map(|(v, hit): (usize, &Option<Hit>)| Some((v, (*hit)?)));
        depths.extend(found.map(|(v, hit)| ((side as u32, v as u32), (hit.depth, hit.triangle))));
    }
    depths
}

/// Side (0: body a, 1: body b) and vertex of a contact, and the triangle of the other body that the vertex's ray hits;
/// vertex and triangle are counted within their bodies.
type Touch = (usize, u32, u32);

/// The contacts of two rigid bodies by ray casts, and the numbers of the first vertex and triangle of each body in
/// arrays that hold those of body a before those of body b.
pub fn sides(a: &Body, b: &Body, normal: DVec3) -> (Vec<Touch>, [(u32, u32); 2]) {
    let (vertices, triangles) = mesh(a);
    let found = wanted(normal, a, b).into_iter().map(|((side, v), (_, triangle))| (side as usize, v, triangle));
    (found.collect(), [(0, 0), (vertices.len() as u32, triangles.len() as u32)])
}

/// Checks that `got` and `want` have the same contacts at the same depths; only a vertex whose depth is zero within the
/// tolerance may be in one of them alone. Returns how many contacts are in both.
fn same(what: &str, got: &Depths, want: &Depths) -> usize {
    let mut matched = 0;
    for (key, (depth, _)) in want {
        match got.get(key) {
            Some((g, _)) => {
                matched += 1;
                assert!(
                    (g - depth).abs() <= DEPTH,
                    "{what}: (side, vertex) {key:?} has depth {g:e} m, expected {depth:e} m"
                );
            }
            None => assert!(*depth < DEPTH, "{what}: (side, vertex) {key:?} with depth {depth:e} m was missed"),
        }
    }
    for (key, (depth, _)) in got {
        assert!(
            want.contains_key(key) || *depth < DEPTH,
            "{what}: (side, vertex) {key:?} is no contact, but was found with depth {depth:e} m"
        );
    }
    matched
}

/// Gives the pair of bodies its contact normal, from the body towards the tool, so that there is a single contact patch
/// (place where the pair may touch).
fn give_direction(flow: &mut Flow, normal: DVec3) {
    flow.pairs[0].direction = normal.normalize().as_vec3().extend(1.0).to_array();
}

/// Runs the query on every depth path and compares it with ray casts; at least `least` contacts must be found by both.
/// Returns the results of the last path, and its depths.
fn every_path(what: &str, a: &Body, tool: &Body, normal: DVec3, least: usize) -> (Flow, Depths) {
    let Shape::Rigid { skin, .. } = &a.shape else { panic!("the body is not rigid") };
    let first = [0, skin.vertices.len() as u32];
    let first_triangle = [0, skin.triangles.len() as u32];
    let mut last = None;
    for path in PATHS {
        let mut flow = Flow::new(std::slice::from_ref(a), Some(tool), tool.position);
        give_direction(&mut flow, normal);
        flow.query(path);
        assert_eq!(flow.counts.flags, 0, "{what}, {}: flags", path.name());
        let depths = got(&flow, first, first_triangle);
        let normal = DVec3::from_array(flow.contact_patches[0].normal.map(f64::from)).normalize();
        let matched = same(&format!("{what}, {}", path.name()), &depths, &wanted(normal, a, tool));
        assert!(matched >= least, "{what}, {}: only {matched} contacts", path.name());
        last = Some((flow, depths));
    }
    last.unwrap()
}

#[test]
fn a_sphere_on_a_plane_of_two_triangles() {
    let tool = rigid("tool", sphere(RADIUS, 4), whole, DVec3::new(1e-3, 0.9 * RADIUS, -2e-3), DQuat::IDENTITY);
    let plane = rigid("plane", sheet(0.05, 1), whole, DVec3::ZERO, DQuat::IDENTITY);
    let (flow, depths) = every_path("two triangles", &plane, &tool, DVec3::Y, 20);
    // The value wanted is found by hand: the lowest vertex is a tenth of the radius below the plane.
    let deepest = depths.values().fold(0.0f64, |most, d| most.max(d.0));
    let normal_y = f64::from(flow.contact_patches[0].normal[1]);
    assert!(
        (deepest * normal_y - 0.1 * RADIUS).abs() < 2.0 * DEPTH,
        "greatest depth {deepest} m, expected a tenth of the radius along y"
    );
    assert!(depths.keys().all(|k| k.0 == 1), "a corner of the plane collides");
}

#[test]
fn a_turned_sphere_on_a_turned_grid_far_from_the_origin() {
    let mut random = Random(5);
    let (turn, place) = (random.turn(3.0), DVec3::new(300.0, -20.0, 1000.0));
    for cut in [whole, octants] {
        let up = turn * DVec3::Y;
        let tool = rigid("tool", sphere(RADIUS, 4), cut, place + 0.8 * RADIUS * up, random.turn(3.0));
        let plane = rigid("plane", sheet(0.03, 24), whole, place, turn);
        let (_, depths) = every_path("grid", &plane, &tool, up + 0.1 * random.vector(), 60);
        assert!(
            depths.keys().any(|k| k.0 == 0) && depths.keys().any(|k| k.0 == 1),
            "both bodies must have colliding vertices"
        );
    }
}

#[test]
fn two_spheres_in_general_position() {
    let mut random = Random(11);
    for cut in [whole, octants] {
        for gap in [1.95, 1.8, 1.5] {
            let towards = random.vector().normalize();
            let a = rigid("a", sphere(RADIUS, 4), cut, DVec3::ZERO, random.turn(3.0));
            let tool = rigid("tool", sphere(RADIUS, 4), cut, gap * RADIUS * towards, random.turn(3.0));
            every_path(&format!("spheres {gap} radii apart"), &a, &tool, towards + 0.1 * random.vector(), 10);
        }
    }
}

/// The compute path sorts vertices into the square cells of a grid. Cells of another size give other lists of vertices,
/// but must give the same ray hits.
#[test]
fn the_size_of_squares_changes_no_depth() {
    let mut random = Random(12);
    let a = rigid("a", sphere(RADIUS, 5), whole, DVec3::ZERO, random.turn(3.0));
    let place = 1.7 * RADIUS * random.vector().normalize();
    let tool = rigid("tool", sphere(RADIUS, 5), octants, place, random.turn(3.0));
    let depths = [0.0, 1e-4, 3e-3].map(|texel| {
        let mut flow = Flow::new(std::slice::from_ref(&a), Some(&tool), place);
        flow.params.texel = texel;
        give_direction(&mut flow, place);
        flow.query(Path::Compute);
        let mut found = flow.hits.iter().zip(&flow.what).filter(|(hit, _)| hit[0] > 0.0).collect::<Vec<_>>();
        found.sort_by_key(|(_, what)| **what);
        assert!(found.len() > 300);
        format!("{found:?}")
    });
    assert!(depths[0] == depths[1] && depths[0] == depths[2]);
}

#[test]
fn a_sphere_over_a_half_space_is_exact_and_needs_no_mesh() {
    let floor = half_space(DVec3::Y, 0.25);
    let tool = rigid("tool", sphere(RADIUS, 4), octants, DVec3::new(0.0, 0.25 + 0.85 * RADIUS, 0.0), DQuat::IDENTITY);
    let mut flow = Flow::new(&[floor], Some(&tool), tool.position);
    flow.query(Path::Compute);
    let depths = got(&flow, [0, 0], [0, 0]);
    let below = mesh(&tool).0.into_iter().enumerate().map(|(v, x)| (v as u32, 0.25 - x.y)).filter(|(_, d)| *d > 0.0);
    let want: Depths = below.map(|(v, d)| ((0, v), (d, u32::MAX))).collect();
    assert!(same("half-space", &depths, &want) > 50);
    assert!(
        flow.counts.hits == 0 && flow.hash_entries.iter().all(|hash_entry| hash_entry[3] == u32::MAX - 1),
        "a half-space needs no spatial hash and no ray hits"
    );
}

/// Depth along `normal` (which points into the sphere) of a point inside a true sphere, m; `None` for a point outside.
fn sphere_depth(x: DVec3, normal: DVec3, centre: DVec3) -> Option<f64> {
    let from = x - centre;
    let along = from.dot(normal);
    let across2 = from.length_squared() - along * along;
    let depth = (RADIUS * RADIUS - across2).max(0.0).sqrt() + along;
    (across2 < RADIUS * RADIUS && depth > 0.0).then_some(depth)
}

/// Greatest error of the kernels' depths of vertices of body `a` against a true sphere at `place`, m, and the number of
/// those vertices. The mesh of the sphere is refined by `halvings` halvings of its edges.
fn worst(a: &Body, halvings: u32, turn: DQuat, place: DVec3, path: Path) -> (f64, usize) {
    let tool = rigid("tool", sphere(RADIUS, halvings), whole, place, turn);
    let mut flow = Flow::new(std::slice::from_ref(a), Some(&tool), place);
    give_direction(&mut flow, place - a.position);
    flow.query(path);
    let normal = DVec3::from_array(flow.contact_patches[0].normal.map(f64::from)).normalize();
    let own = mesh(a).0;
    let depths = got(&flow, [0, own.len() as u32], [0, 0]);
    let mut worst = 0.0f64;
    let mut count = 0;
    for ((_, vertex), (depth, _)) in depths.iter().filter(|d| d.0.0 == 0) {
        let true_depth = sphere_depth(own[*vertex as usize], normal, place).expect("the vertex is outside the sphere");
        worst = worst.max((depth - true_depth).abs());
        count += 1;
    }
    (worst, count)
}

#[test]
fn depth_tends_to_the_true_sphere_as_edge_length_squared() {
    let turn = Random(3).turn(3.0);
    let plane = rigid("plane", sheet(0.012, 60), whole, DVec3::ZERO, DQuat::IDENTITY);
    let ball = rigid("ball", sphere(RADIUS, 5), whole, DVec3::ZERO, turn.inverse());
    for path in PATHS {
        for (name, a, place) in [
            ("plane", &plane, DVec3::Y * 0.9 * RADIUS),
            ("ball", &ball, DVec3::new(0.5, 1.0, 0.3).normalize() * 1.85 * RADIUS),
        ] {
            let errors: Vec<_> = (2..=5).map(|halvings| worst(a, halvings, turn, place, path)).collect();
            for (k, pair) in errors.windows(2).enumerate() {
                let (coarse, fine) = (pair[0].0, pair[1].0);
                let what = format!(
                    "{name}, {}: from {} to {} halvings of the mesh; errors (m) and numbers of vertices {errors:?}",
                    path.name(),
                    k + 2,
                    k + 3
                );
                assert!(pair[1].1 > 20 && fine < SECOND_ORDER * coarse, "{what}");
            }
        }
    }
}
