//! Tests of isosurface stuffing, which fills a surface with a *layer* (tetrahedral mesh of a soft body) by means of a
//! lattice of cubic *cells*: solids of known volume, thin features, narrow gaps, defective surfaces. The
//! *extrapolation* of a surface vertex is by how much the least of its weights in its tetrahedron lies below zero; it
//! is 0 for a vertex inside the layer. The *grade* is the ratio of the largest cell edge deep inside to the cell edge
//! at the surface; a *shell* is a layer of limited thickness.

mod random;
mod real;

use std::f64::consts::FRAC_PI_4;

use glam::DVec3;

use super::*;
use crate::prepare::layer::{self, FACES};
use crate::prepare::{embed, sphere};

/// Least allowed dihedral angle, degrees. The smallest angle in the test on a randomly cut lattice (`random.rs`) is
/// slightly above this bound.
const ANGLE: f64 = 10.0;
/// Greatest allowed dihedral angle, degrees.
const WIDEST: f64 = 165.0;

type Mesh = (Vec<DVec3>, Vec<[u32; 3]>);

/// Checks what every layer must fulfil: bounded angles, positive volumes, no unused node, inner faces that two
/// tetrahedra share in opposite orientations, a closed boundary, and a report that agrees with the layer.
fn check(layer: &Layer, report: &LayerReport) {
    assert!(report.worst_dihedral > ANGLE && report.largest_dihedral < WIDEST, "unexpected report: {report:?}");
    assert!(report.first_percentile_dihedral >= report.worst_dihedral);
    assert!(layer.tetrahedra.iter().all(|t| layer::volume6(&layer.nodes, t) > 0.0));
    let mut used = vec![false; layer.nodes.len()];
    layer.tetrahedra.iter().flatten().for_each(|&n| used[n as usize] = true);
    assert!(used.iter().all(|&u| u) && layer.attached.len() == used.len());
    let mut faces: Vec<([u32; 3], bool)> = Vec::new();
    for t in &layer.tetrahedra {
        for face in FACES {
            let [a, b, c] = face.map(|k| t[k]);
            let mut key = [a, b, c];
            key.sort_unstable();
            let even = [[a, b, c], [b, c, a], [c, a, b]].contains(&key);
            faces.push((key, even));
        }
    }
    faces.sort_unstable();
    for group in faces.chunk_by(|a, b| a.0 == b.0) {
        assert!(
            group.len() == 1 || (group.len() == 2 && group[0].1 != group[1].1),
            "two tetrahedra that share a face must have it in opposite orientations (nodes, orientation): {group:?}"
        );
    }
    let (skin, triangles, _) = layer::boundary(layer);
    let mut edges: Vec<[u32; 2]> = triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
    let mut back: Vec<[u32; 2]> = edges.iter().map(|&[a, b]| [b, a]).collect();
    edges.sort_unstable();
    back.sort_unstable();
    assert_eq!(edges, back);
    let inside = mass::properties(&skin, &triangles).volume;
    assert!((inside / report.volume - 1.0).abs() < 1e-9);
    assert_eq!((report.nodes, report.tetrahedra), (layer.nodes.len(), layer.tetrahedra.len()));
    assert_eq!(report.parts, layer::parts(layer).1);
}

fn made(mesh: &Mesh, options: &Options) -> (Layer, LayerReport) {
    let (layer, report) = stuff(&mesh.0, &mesh.1, options).unwrap();
    check(&layer, &report);
    (layer, report)
}

fn uniform(mesh: &Mesh, cell: f64) -> (Layer, LayerReport) {
    made(mesh, &Options::uniform(cell))
}

fn cuboid(low: DVec3, size: DVec3) -> Mesh {
    let (vertices, triangles, _) = layer::boundary(&layer::kuhn_box(low, low + size, [1, 1, 1]));
    (vertices, triangles)
}

fn joined(meshes: &[Mesh]) -> Mesh {
    let mut all: Mesh = Default::default();
    for (vertices, triangles) in meshes {
        let first = all.0.len() as u32;
        all.0.extend(vertices);
        all.1.extend(triangles.iter().map(|t| t.map(|i| i + first)));
    }
    all
}

/// A generator of pseudo-random numbers in [0, 1), the same sequence in every run (Numerical Recipes).
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// A torus about the z axis, oriented outwards: a tube of radius `minor` (m) around a circle of radius `major` (m).
fn torus(major: f64, minor: f64) -> Mesh {
    let (n, m) = (96u32, 48u32);
    let mut mesh: Mesh = Default::default();
    for (i, j) in (0..n).flat_map(|i| (0..m).map(move |j| (i, j))) {
        let (u, v) = [(i, n), (j, m)].map(|(k, n)| k as f64 / n as f64 * std::f64::consts::TAU).into();
        let r = major + minor * v.cos();
        mesh.0.push(DVec3::new(r * u.cos(), r * u.sin(), minor * v.sin()));
        let at = |i: u32, j: u32| i % n * m + j % m;
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        mesh.1.extend([[a, b, c], [a, c, d]]);
    }
    mesh
}

#[test]
fn spheres_boxes_and_tori_have_their_volume_and_their_surface() {
    let ball = sphere::icosphere(0.1);
    let turned: Mesh = {
        let (v, t) = cuboid(DVec3::splat(-0.1), DVec3::new(0.2, 0.15, 0.1));
        let turn = glam::DMat3::from_rotation_z(0.4) * glam::DMat3::from_rotation_x(0.7);
        (v.into_iter().map(|p| turn * p).collect(), t)
    };
    let cases = [
        (ball, 4e-3 / 3.0 * std::f64::consts::PI),
        (turned, 0.003),
        (torus(0.1, 0.04), { 2.0 * std::f64::consts::PI.powi(2) * 0.1 * 0.04f64.powi(2) }),
    ];
    for (mesh, volume) in cases {
        for cell in [0.021, 0.0137, 0.01] {
            let (layer, report) = uniform(&mesh, cell);
            // The polyhedra that are filled have the volumes of the round solids within 0.4 %.
            assert!(
                (report.volume / volume - 1.0).abs() < 0.006,
                "the layer has a volume of {} m^3, expected about {volume} m^3",
                report.volume
            );
            assert!(report.clean && report.parts == 1 && report.thickened.nodes == 0, "unexpected report: {report:?}");
            let solid = Solid::new(&mesh.0, &mesh.1).unwrap();
            let (skin, ..) = layer::boundary(&layer);
            let off = skin.iter().map(|&p| solid.distance(p)).fold(0.0, f64::max);
            // The surface is shifted by `report.shift` along its normal, so that the volume is kept. The point where
            // the shifted surface cuts a lattice edge is accurate to a thousandth of the edge.
            assert!(
                off < 2e-3 * cell + 1.001 * report.shift.abs(),
                "a boundary node is {off} m off the surface; the surface was shifted by {} m",
                report.shift
            );
            let out = embed::extrapolation(&embed(&mesh.0, &layer).unwrap());
            assert!(out < 1.0, "greatest extrapolation of a surface vertex {out}, expected below 1");
        }
    }
}

#[test]
fn a_hollow_stays_hollow() {
    let outer = sphere::icosphere(0.1);
    let mut inner = sphere::icosphere(0.06);
    inner.1.iter_mut().for_each(|t| t.swap(0, 1));
    let (_, report) = uniform(&joined(&[outer, inner]), 0.01);
    assert!(report.parts == 1 && report.volume_difference.abs() < 2.0 * AGREEMENT, "unexpected report: {report:?}");
}

#[test]
fn plates_nearer_than_a_cell_are_not_welded() {
    // The last rotation makes the gap parallel to faces of the lattice's tetrahedra.
    let turns = [glam::DMat3::IDENTITY, glam::DMat3::from_rotation_x(0.5), glam::DMat3::from_rotation_x(FRAC_PI_4)];
    for (turn, gap, offset) in turns.into_iter().flat_map(|turn| {
        let gaps = [0.9, 0.5, 0.3, 0.2, 0.05].into_iter();
        gaps.flat_map(move |gap| [0.0, 0.13, 0.37, 0.61].map(|offset| (turn, gap, offset)))
    }) {
        let lower = cuboid(DVec3::new(0.0, 0.0, -2.0 - offset), DVec3::new(6.0, 6.0, 2.0 + offset));
        let upper = cuboid(DVec3::new(0.0, 0.0, gap), DVec3::new(6.0, 6.0, 2.0));
        let mut both = joined(&[lower, upper]);
        both.0.iter_mut().for_each(|v| *v = turn * *v);
        let (layer, report) = uniform(&both, 1.0);
        assert_eq!(
            report.parts, 2,
            "number of parts of plates {gap} cells apart, with the lattice moved by {offset} cells: {report:?}"
        );
        assert_eq!((report.welded.count, report.dropped.parts), (0, 0));
        assert!(layer.tetrahedra.len() > 500);
    }
}

/// The surface of a fork, in one piece: two prongs on a base, with a gap of width `gap` (m) between the prongs.
fn fork(gap: f64) -> Mesh {
    let mut block = layer::kuhn_box(DVec3::ZERO, DVec3::new(5.0, 3.0, 2.0), [5, 3, 2]);
    let nodes = block.nodes.clone();
    block.tetrahedra.retain(|t| {
        let middle: DVec3 = t.iter().map(|&n| nodes[n as usize] / 4.0).sum();
        middle.x < 1.0 || middle.y < 1.0 || middle.y > 2.0
    });
    let (mut vertices, triangles, _) = layer::boundary(&block);
    for v in &mut vertices {
        // The gap, which lies between y = 1 and y = 2 before, gets the width `gap`.
        v.y = if v.y < 1.5 { 2.0 * v.y } else { 2.0 + gap + 2.0 * (v.y - 2.0) };
    }
    (vertices, triangles)
}

#[test]
fn prongs_of_a_fork_hang_together_at_its_base_only() {
    for gap in [0.4, 0.2, 0.05] {
        let mesh = fork(gap);
        let (mut layer, report) = uniform(&mesh, 0.5);
        assert_eq!(report.parts, 1);
        // When all tetrahedra in the base and within about a cell of the gap's end are removed, the prongs must be
        // separate.
        let nodes = layer.nodes.clone();
        layer.tetrahedra.retain(|t| t.iter().all(|&n| nodes[n as usize].x > 1.6));
        let (labels, _) = layer::parts(&layer);
        let mut used: Vec<u32> = layer.tetrahedra.iter().map(|t| labels[t[0] as usize]).collect();
        used.sort_unstable();
        used.dedup();
        assert_eq!(used.len(), 2, "number of separate prongs of a fork whose gap is {gap} m wide");
    }
}

#[test]
fn a_plate_and_a_needle_thinner_than_a_cell_are_one_part_with_their_skin_near() {
    for size in [DVec3::new(1.0, 0.01, 1.0), DVec3::new(1.0, 0.02, 0.03)] {
        let (v, t, _) = layer::boundary(&layer::kuhn_box(DVec3::ZERO, size, [20, 1, 20]));
        let (layer, report) = uniform(&(v.clone(), t), 0.1);
        assert!(report.parts == 1 && report.thickened.nodes > 0, "unexpected report: {report:?}");
        let out = embed::extrapolation(&embed(&v, &layer).unwrap());
        assert!(out < 3.0, "greatest extrapolation of a surface vertex {out}, expected below 3");
    }
}

#[test]
fn shells_and_grades_keep_the_surface_and_thin_out_the_inside() {
    let mesh = sphere::icosphere(0.1);
    let cell = 0.006;
    let (_, whole) = uniform(&mesh, cell);
    for grade in [2, 4] {
        let (layer, report) = made(&mesh, &Options { cell, grade, thickness: None });
        // All boundary nodes lie on the sphere, so the inside of the layer has no crack.
        let (skin, ..) = layer::boundary(&layer);
        assert!(skin.iter().all(|p| (p.length() - 0.1).abs() < 0.1 * cell));
        println!("grade {grade} gives {} tetrahedra, equal cells give {}", report.tetrahedra, whole.tetrahedra);
        assert!(report.tetrahedra < 2 * whole.tetrahedra / 3 && (report.volume / whole.volume - 1.0).abs() < 1e-9);
    }
    for (grade, thickness) in [(1, 0.03), (2, 0.05), (1, 0.004)] {
        let (layer, report) = made(&mesh, &Options { cell, grade, thickness: Some(thickness) });
        assert!(report.parts == 1 && report.volume_difference.abs() < 2.0 * AGREEMENT);
        let deepest = layer.nodes.iter().map(|n| 0.1 - n.length()).fold(0.0, f64::max);
        assert!(
            deepest > thickness && deepest < thickness + grade as f64 * cell * 1.01,
            "the deepest node of a shell {thickness} m thick is {deepest} m below the surface"
        );
        let share = 1.0 - ((0.1 - thickness) / 0.1).powi(3);
        assert!(report.volume > share * whole.volume && report.volume < whole.volume);
    }
    let all = made(&mesh, &Options { cell, grade: 1, thickness: Some(1.0) }).1;
    assert_eq!(all.tetrahedra, whole.tetrahedra);
}

#[test]
fn open_turned_and_torn_surfaces_are_filled_soundly() {
    let ball = sphere::icosphere(0.1);
    let mut numbers = Numbers(3);
    let mut open = ball.clone();
    open.1.retain(|t| open.0[t[0] as usize].y < 0.07);
    let mut turned = ball.clone();
    turned.1.iter_mut().filter(|_| numbers.next() < 0.1).for_each(|t| t.swap(0, 1));
    let mut moved = ball.clone();
    moved.0.iter_mut().for_each(|v| *v += DVec3::new(0.1, 0.02, 0.0));
    let soup = (0..200).flat_map(|_| {
        let at = DVec3::new(numbers.next(), numbers.next(), numbers.next());
        [0, 1, 2].map(|_| at + 0.5 * DVec3::new(numbers.next(), numbers.next(), numbers.next()))
    });
    let soup: Mesh = (soup.collect(), (0..200).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect());
    let cases = [("open", open, 0.012), ("turned", turned, 0.012), ("folded", joined(&[ball, moved]), 0.012)];
    for (name, mesh, cell) in cases.into_iter().chain([("soup", soup, 0.06)]) {
        for grade in [1, 2] {
            let (layer, report) = made(&mesh, &Options { cell, grade, thickness: None });
            println!(
                "{name}: {} tetrahedra, relative volume difference {:+.2e}",
                report.tetrahedra, report.volume_difference
            );
            assert!(!report.clean && layer.tetrahedra.len() > 20);
            // The inside of the soup of triangles has thin sheets, whose volume is lost. For the other surfaces, layer
            // and surface have nearly the same volume.
            assert!(name == "soup" || report.volume_difference.abs() < 0.02, "{name}: unexpected report: {report:?}");
        }
    }
}

#[test]
fn a_layer_is_the_same_every_time() {
    let mesh = joined(&[fork(0.1), cuboid(DVec3::splat(2.0), DVec3::splat(4.0))]);
    let make = || made(&mesh, &Options { cell: 0.3, grade: 2, thickness: Some(0.9) }).0;
    let (a, b) = (make(), make());
    assert!(a.nodes == b.nodes && a.tetrahedra == b.tetrahedra);
}

#[test]
fn cells_too_coarse_and_too_fine_and_surfaces_inside_out_are_refused_with_the_remedy() {
    let (vertices, mut triangles) = sphere::icosphere(0.1);
    let fails = |triangles: &[[u32; 3]], cell| stuff(&vertices, triangles, &Options::uniform(cell)).err().unwrap();
    assert!(fails(&triangles, 0.3).contains("choose a smaller cell"));
    let error = fails(&triangles, 1e-4);
    assert!(error.contains("more than 4 million") && error.contains("choose one above"), "the error is: {error}");
    triangles.iter_mut().for_each(|t| t.swap(0, 1));
    assert!(fails(&triangles, 0.01).contains("inside out"));
}
