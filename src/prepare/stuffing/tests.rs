//! Stuffing on solids of known volume, on random cuts, on dirty surfaces and on the real meshes.

use glam::DVec3;

use super::*;
use crate::prepare::layer::{self, FACES};
use crate::prepare::tests::meshes;
use crate::prepare::{embed, sphere};
use crate::scene::obj;

/// The least dihedral angle, degrees: every stencil's bound over random cuts and warps is above 10.
const ANGLE: f64 = 10.0;
/// The largest.
const WIDEST: f64 = 165.0;

type Mesh = (Vec<DVec3>, Vec<[u32; 3]>);

/// What must hold of any layer: angles, positive volumes, all nodes used, faces shared by two tetrahedra from both
/// sides, a closed boundary, and a report that tells the truth.
fn check(layer: &Layer, report: &LayerReport) {
    assert!(report.worst_dihedral > ANGLE && report.largest_dihedral < WIDEST, "{report:?}");
    assert!(report.first_percentile_dihedral >= report.worst_dihedral);
    assert!(layer.tetrahedra.iter().all(|t| layer::volume6(&layer.nodes, t) > 0.0));
    let mut used = vec![false; layer.nodes.len()];
    layer.tetrahedra.iter().flatten().for_each(|&n| used[n as usize] = true);
    assert!(used.iter().all(|&u| u) && layer.bound.len() == used.len());
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
        assert!(group.len() == 1 || (group.len() == 2 && group[0].1 != group[1].1), "{group:?}");
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

fn real(folder: &std::path::Path, name: &str) -> Mesh {
    let mesh = obj::read(&folder.join(format!("surf/{name}.obj"))).unwrap();
    (mesh.vertices, mesh.triangles)
}

fn largest_extent(mesh: &Mesh) -> f64 {
    let low = mesh.0.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    (mesh.0.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max) - low).max_element()
}

#[test]
fn the_real_meshes_keep_their_volume_and_their_angles() {
    let Some(folder) = meshes("stuffing the real meshes") else { return };
    let cases = ["head", "pumpkin", "gear", "human"].map(|name| (name, 1.0 / 40.0));
    for (name, share) in cases.into_iter().chain([("human", 0.02 / 1.67)]) {
        let mesh = real(&folder, name);
        let cell = share * largest_extent(&mesh);
        let (layer, report) = uniform(&mesh, cell);
        let out = embed::extrapolation(&embed(&mesh.0, &layer).unwrap());
        println!(
            "{name} cell {cell:.4}: {} nodes {} tetrahedra, dihedral {:.2} {:.2} {:.2}, volume {:+.2e}, shift {:.3} \
             cells, parts {} dropped {} separated {} doubled {} welded {} lost {} thickened {}, extrapolation {out:.2}, \
             {:.2} s",
            report.nodes,
            report.tetrahedra,
            report.worst_dihedral,
            report.first_percentile_dihedral,
            report.largest_dihedral,
            report.volume_difference,
            report.shift / cell,
            report.parts,
            report.dropped.parts,
            report.separated,
            report.doubled,
            report.welded.count,
            report.lost.count,
            report.thickened.nodes,
            report.seconds,
        );
        assert!(report.volume_difference.abs() < 0.02);
    }
}
