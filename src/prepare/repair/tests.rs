//! Tests of the repair of surfaces on small meshes; `crates/cli/tests/bad_input.rs` tests the repair on defective
//! files. A *piece* is a part of a surface that is connected across edges with two triangles; a *cavity* is a piece
//! inside another piece, oriented inwards. A repaired surface is the *skin* of a body, and *proxies* are convex hulls
//! that cover the skin.

use super::*;
use crate::prepare::{layer, proxy, skin, sphere};

/// Greatest relative rounding error of a volume that is summed over a few hundred triangles.
const ROUNDING: f64 = 1e-12;

/// Closed tetrahedra, each given by its corner and the length of its edges along the axes. A tetrahedron is oriented
/// outwards, or inwards if the length is negative.
fn tetrahedra(places: &[(DVec3, f64)]) -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    for &(corner, edge) in places {
        let first = mesh.vertices.len() as u32;
        let size = edge.abs();
        mesh.vertices.extend([DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z].map(|v| corner + size * v));
        let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        mesh.triangles.extend(faces.map(|[a, b, c]| {
            let face = if edge > 0.0 { [a, b, c] } else { [a, c, b] };
            face.map(|corner| first + corner)
        }));
    }
    mesh
}

fn boxed(low: DVec3, high: DVec3, cells: u32) -> TriangleMesh {
    let (vertices, triangles, _) = layer::boundary(&layer::kuhn_box(low, high, [cells; 3]));
    TriangleMesh { vertices, triangles }
}

fn ball(radius: f64) -> TriangleMesh {
    let (vertices, triangles) = sphere::icosphere(radius);
    TriangleMesh { vertices, triangles }
}

fn join(a: TriangleMesh, b: TriangleMesh) -> TriangleMesh {
    let first = a.vertices.len() as u32;
    let triangles = a.triangles.into_iter().chain(b.triangles.into_iter().map(|t| t.map(|v| v + first))).collect();
    TriangleMesh { vertices: [a.vertices, b.vertices].concat(), triangles }
}

/// The mesh with three vertices of its own for every triangle.
fn soup(mesh: &TriangleMesh) -> TriangleMesh {
    let vertices = mesh.triangles.iter().flatten().map(|&v| mesh.vertices[v as usize]).collect();
    TriangleMesh {
        vertices,
        triangles: (0..mesh.triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
    }
}

/// The message with which [`strict`] refuses a mesh; empty if the mesh is accepted.
fn answer(mesh: &TriangleMesh) -> String {
    strict(mesh.clone()).err().map(|refusal| refusal.error(Path::new("none.obj")).to_string()).unwrap_or_default()
}

/// Checks that a repaired mesh is a sound skin: [`strict`] accepts it, and proxies can cover it.
fn assert_sound(mesh: &TriangleMesh) {
    assert_eq!(answer(mesh), "");
    let skin = skin::build(mesh.vertices.clone(), mesh.triangles.clone());
    proxy::tests::check(&skin, &proxy::proxies(&skin).unwrap());
}

#[test]
fn a_sound_mesh_comes_back_bit_by_bit() {
    for mesh in [tetrahedra(&[(DVec3::ZERO, 1.0), (DVec3::X, 1.0)]), boxed(DVec3::ZERO, DVec3::ONE, 3)] {
        let (same, report) = repair(mesh.clone()).unwrap();
        assert_eq!(same, mesh);
        assert!(report.is_clean() && report.triangles_kept == mesh.triangles.len(), "unexpected report: {report:?}");
    }
}

/// Vertices that no triangle uses, here far away, move to a corner and are told; all vertices keep their numbers.
#[test]
fn unused_vertices_do_not_stay_far_away() {
    let sound = boxed(DVec3::ZERO, DVec3::ONE, 3);
    let mut mesh = sound.clone();
    mesh.vertices.extend([DVec3::splat(1e3), DVec3::NAN]);
    let corner = sound.vertices[sound.triangles[0][0] as usize];
    for mend in [repair, strict] {
        let (mended, report) = mend(mesh.clone()).unwrap();
        assert_eq!((&mended.triangles, report.unused_vertices), (&sound.triangles, 2));
        assert_eq!(mended.vertices, [&sound.vertices[..], &[corner; 2]].concat());
        assert_eq!(report.sentences().len(), 1, "{:?}", report.sentences());
    }
}

#[test]
fn boxes_that_touch_stay_apart() {
    let mesh = join(boxed(DVec3::ZERO, DVec3::ONE, 2), boxed(DVec3::X, DVec3::new(2.0, 1.0, 1.0), 2));
    let (same, report) = repair(mesh.clone()).unwrap();
    assert_eq!((same, report.pieces, report.self_intersections.count), (mesh, 2, 0));
}

#[test]
fn a_soup_is_joined_to_the_first_of_its_vertices() {
    let sphere = ball(0.1);
    let mut soup = soup(&sphere);
    // Positions are rounded to six digits, as exporters write them.
    soup.vertices.iter_mut().for_each(|v| *v = (*v * 1e7).round() / 1e7);
    let (mended, report) = repair(soup.clone()).unwrap();
    assert_eq!(report.welded_vertices.count, 3 * sphere.triangles.len() - sphere.vertices.len());
    assert_eq!((&mended.vertices, report.boundary_edges.count, report.pieces), (&soup.vertices, 0, 1));
    assert!(mended.triangles.iter().flatten().zip(soup.triangles.iter().flatten()).all(|(new, old)| new <= old));
    assert_sound(&mended);
    assert!(answer(&soup).contains("vertices at open edges coincide"), "the refusal is: {}", answer(&soup));
}

#[test]
fn slivers_copies_and_turned_faces_are_undone() {
    let sphere = ball(0.1);
    let mut mesh = sphere.clone();
    mesh.triangles.iter_mut().step_by(9).for_each(|t| t.swap(0, 1));
    mesh.triangles.extend(sphere.triangles[..50].iter().map(|&[a, b, c]| [a, c, b]));
    mesh.triangles.push([7, 9, 9]);
    let (mended, report) = repair(mesh.clone()).unwrap();
    let turned = sphere.triangles.len().div_ceil(9);
    assert_eq!((report.zero_area.count, report.duplicates.count, report.turned_triangles), (1, 50, turned));
    assert_eq!(report.duplicates.first_triangle, Some(sphere.triangles.len()));
    assert_sound(&mended);
    assert!(answer(&mesh).contains("1 triangles without area"), "the refusal is: {}", answer(&mesh));
}

#[test]
fn every_triangle_knows_where_it_came_from() {
    // The mesh has vertices to be merged, a triangle without area, a duplicate, and triangles to be reversed one by one
    // and as a whole piece.
    let mut mesh = join(boxed(DVec3::splat(3.0), DVec3::splat(4.0), 2), soup(&ball(1.0)));
    mesh.triangles.iter_mut().take(48).for_each(|t| t.swap(0, 1));
    mesh.triangles.iter_mut().step_by(9).for_each(|t| t.swap(1, 2));
    mesh.triangles.insert(5, [7, 9, 9]);
    mesh.triangles.insert(60, mesh.triangles[59]);
    let (mended, report) = repair(mesh.clone()).unwrap();
    let origins = origins(&mesh).unwrap();
    assert_eq!(origins.len(), mended.triangles.len());
    assert_eq!(
        (report.zero_area.count, report.duplicates.count, origins[5].triangle, origins[59].triangle),
        (1, 1, 6, 61)
    );
    assert!(origins.iter().any(|o| o.is_turned) && origins.iter().any(|o| !o.is_turned));
    for (triangle, origin) in mended.triangles.iter().zip(&origins) {
        let [a, b, c] = mesh.triangles[origin.triangle as usize];
        let corners = if origin.is_turned { [a, c, b] } else { [a, b, c] };
        assert_eq!(points(&mended.vertices, *triangle), points(&mesh.vertices, corners));
    }
}

#[test]
fn a_collapsed_edge_is_closed_again() {
    // A vertex on one side of a box is moved onto a neighbouring vertex: two triangles lose their area and are removed,
    // and the repair must leave no gap.
    let mut mesh = boxed(DVec3::ZERO, DVec3::ONE, 4);
    let inner = |v: &DVec3| v.x == 0.0 && v.y == 0.5 && v.z == 0.5;
    let at = mesh.vertices.iter().position(inner).unwrap();
    let to = mesh.vertices.iter().position(|v| v.x == 0.0 && v.y == 0.25 && v.z == 0.5).unwrap();
    mesh.vertices[at] = mesh.vertices[to];
    let (mended, report) = repair(mesh).unwrap();
    assert_eq!((report.zero_area.count, report.welded_vertices.count, report.boundary_edges.count), (2, 1, 0));
    assert!((report.volume - 1.0).abs() < ROUNDING, "volume {}, expected 1", report.volume);
    assert_sound(&mended);
}

#[test]
fn pieces_are_turned_outwards_and_cavities_follow_what_is_around_them() {
    let outer = (DVec3::ZERO, 10.0);
    let cavity = (DVec3::splat(1.0), -1.0);
    assert_eq!(answer(&tetrahedra(&[outer, cavity])), "");
    let beside = tetrahedra(&[outer, (DVec3::splat(20.0), -1.0)]);
    assert!(answer(&beside).contains("inside out, first at triangle 4"), "the refusal is: {}", answer(&beside));
    // This inverted piece lies in the bounding box of the outer piece, but outside that piece, so it is no cavity.
    assert!(answer(&tetrahedra(&[outer, (DVec3::splat(8.0), -1.0)])).contains("inside out"));
    let (mended, report) = repair(beside).unwrap();
    assert_eq!((report.turned_pieces.count, report.cavities), (1, 0));
    assert_sound(&mended);
    let (mended, report) = repair(tetrahedra(&[(DVec3::ZERO, -10.0), (DVec3::splat(1.0), 1.0)])).unwrap();
    assert_eq!((report.turned_pieces.count, report.cavities), (2, 1));
    assert!((report.volume - 999.0 / 6.0).abs() < 999.0 * ROUNDING);
    assert_eq!(answer(&mended), "");
}

#[test]
fn holes_are_closed_for_volume_alone() {
    let mut mesh = boxed(DVec3::ZERO, DVec3::ONE, 4);
    let full = mesh.triangles.len();
    let is_lid = |t: &[u32; 3]| t.iter().all(|&v| mesh.vertices[v as usize].z == 1.0);
    mesh.triangles = mesh.triangles.iter().filter(|t| !is_lid(t)).copied().collect();
    let mesh = settle_unused(mesh);
    let (open, report) = repair(mesh.clone()).unwrap();
    assert_eq!((&open, full - mesh.triangles.len()), (&mesh, 32));
    assert_eq!((report.boundary_edges.count, report.holes), (16, 1));
    assert!(
        (report.volume - 1.0).abs() < ROUNDING && (report.hole_area_share - 0.2).abs() < ROUNDING,
        "unexpected report: {report:?}"
    );
    // Proxies are made for the box with its hole closed, so the open box counts as convex and gets one hull.
    let skin = skin::build(open.vertices, open.triangles);
    let proxies = proxy::proxies(&skin).unwrap();
    proxy::tests::check(&skin, &proxies);
    assert_eq!(proxies.len(), 1);
    assert!(
        answer(&mesh).contains("the surface is open: 16 edges with one triangle"),
        "the refusal is: {}",
        answer(&mesh)
    );
}

#[test]
fn an_edge_of_four_triangles_is_kept() {
    // The mesh consists of two cubes that share an edge, which has four triangles.
    let mut mesh =
        join(boxed(DVec3::ZERO, DVec3::ONE, 1), boxed(DVec3::new(1.0, 1.0, 0.0), DVec3::new(2.0, 2.0, 1.0), 1));
    let first: Vec<u32> =
        (0..16).map(|v| mesh.vertices.iter().position(|p| *p == mesh.vertices[v]).unwrap() as u32).collect();
    mesh.triangles.iter_mut().flatten().for_each(|v| *v = first[*v as usize]);
    let mesh = settle_unused(mesh);
    let (same, report) = repair(mesh.clone()).unwrap();
    assert_eq!((&same, report.non_manifold_edges.count, report.pieces), (&mesh, 1, 2));
    assert!((report.volume - 2.0).abs() < ROUNDING);
    assert!(answer(&mesh).contains("1 edges with more than two triangles"));
    let skin = skin::build(same.vertices, same.triangles);
    proxy::tests::check(&skin, &proxy::proxies(&skin).unwrap());
}

#[test]
fn crossings_are_counted_and_touching_is_not() {
    let sphere = ball(1.0);
    assert_eq!(repair(sphere).unwrap().1.self_intersections, Intersections::default());
    let mut mesh = tetrahedra(&[(DVec3::ZERO, 1.0), (DVec3::splat(0.125), 0.25)]);
    assert_eq!(repair(mesh.clone()).unwrap().1.self_intersections, Intersections::default());
    // A corner of the inner tetrahedron is moved out through the slanted face of the outer one, so that three faces
    // intersect that face.
    mesh.vertices[5].x = 2.0;
    let found = repair(mesh.clone()).unwrap().1.self_intersections;
    assert_eq!((found.count, &found.first_pairs[..]), (3, &[[3, 4], [3, 5], [3, 7]][..]));
    // With the corner moved exactly onto that face, the triangles only touch.
    mesh.vertices[5].x = 0.75;
    assert_eq!(repair(mesh).unwrap().1.self_intersections.count, 0);
}

#[test]
fn what_has_no_inside_is_refused() {
    let sphere = ball(1.0);
    type Spoil = fn(&mut TriangleMesh);
    let cases: [(Spoil, &str); 7] = [
        (|mesh| mesh.triangles.clear(), "no faces"),
        (|mesh| mesh.triangles[7][1] = 1 << 20, "names a vertex beyond the last"),
        (|mesh| mesh.vertices.iter_mut().for_each(|v| v.x += 1e5), "neighbouring f32 numbers are"),
        (|mesh| mesh.vertices.iter_mut().for_each(|v| *v *= 1e10), "coordinates reach"),
        (|mesh| mesh.vertices[3].y = f64::NAN, "not a finite number"),
        (|mesh| mesh.vertices.iter_mut().for_each(|v| v.z = 0.0), "encloses no volume"),
        // Only a shallow cap of the sphere is left.
        (
            |mesh| {
                let low = |t: &[u32; 3]| t.iter().all(|&v| mesh.vertices[v as usize].z > 0.9);
                mesh.triangles = mesh.triangles.iter().filter(|t| low(t)).copied().collect();
            },
            "has no inside",
        ),
    ];
    for (spoil, words) in cases {
        let mut mesh = sphere.clone();
        spoil(&mut mesh);
        let refusal = repair(mesh).unwrap_err();
        assert!(refusal.problem.contains(words), "expected `{words}` in the refusal: {}", refusal.problem);
    }
    // A Moebius strip of five triangles.
    let moebius = TriangleMesh {
        vertices: (0..5).map(|k| DVec3::new(f64::from(k), f64::from(k * k), f64::from(k * k * k))).collect(),
        triangles: (0..5).map(|k| [k, (k + 1) % 5, (k + 2) % 5]).collect(),
    };
    assert!(repair(moebius).unwrap_err().problem.contains("one side only"));
}

#[test]
fn each_spoiled_face_is_seen() {
    let sound = tetrahedra(&[(DVec3::ZERO, 1.0), (DVec3::X, 1.0)]);
    type Spoil = fn(&mut TriangleMesh);
    let cases: [(Spoil, &str); 5] = [
        (|mesh| mesh.triangles[5].swap(0, 1), "3 edges with inconsistently oriented triangles"),
        (|mesh| mesh.triangles.truncate(7), "open: 3 edges with one triangle, first at triangle 4"),
        (|mesh| mesh.triangles.push([3, 0, 1]), "1 triangles given more than once, first at triangle 8"),
        (|mesh| mesh.triangles[2] = [0, 3, 3], "1 triangles without area, first at triangle 2"),
        (|mesh| mesh.vertices[3].z = 1e-7, "2 triangles without area"),
    ];
    for (spoil, words) in cases {
        let mut mesh = sound.clone();
        spoil(&mut mesh);
        assert!(answer(&mesh).contains(words), "expected `{words}` in the refusal: {}", answer(&mesh));
    }
}
