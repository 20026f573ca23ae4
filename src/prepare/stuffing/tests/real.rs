//! Tests of isosurface stuffing, which fills a surface with a *layer* (tetrahedral mesh of a soft body) by means of a
//! lattice of cubic *cells*, on real meshes, sound and defective. The *extrapolation* of a surface vertex is by how
//! much the least of its weights in its tetrahedron lies below zero; it is 0 for a vertex inside the layer.

use glam::DVec3;

use super::super::*;
use super::{Mesh, check, uniform};
use crate::prepare::embed;
use crate::prepare::tests::real_meshes::meshes;
use crate::scene::{Model, triangles};

fn real(folder: &std::path::Path, name: &str) -> Mesh {
    let mesh = triangles::read(&folder.join(format!("surf/{name}.obj"))).unwrap().mesh;
    (mesh.vertices, mesh.triangles)
}

fn largest_extent(mesh: &Mesh) -> f64 {
    let low = mesh.0.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    (mesh.0.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max) - low).max_element()
}

#[test]
#[ignore = "needs real meshes"]
fn files_with_defects_are_filled_soundly_or_refused() {
    let Some(folder) = meshes() else { return };
    let mut files: Vec<_> = std::fs::read_dir(folder.join("bad")).unwrap().map(|f| f.unwrap().path()).collect();
    files.sort();
    let mut filled = 0;
    for path in files.iter().filter(|p| p.extension().is_some_and(|e| e == "obj")) {
        let name = path.file_name().unwrap().to_string_lossy();
        let mesh = match triangles::read(path).map(|file| file.mesh) {
            Ok(mesh) => (mesh.vertices, mesh.triangles),
            Err(error) => {
                println!("{name} cannot be read: {error}");
                continue;
            }
        };
        let cell = largest_extent(&mesh) / 30.0;
        match stuff(&mesh.0, &mesh.1, &Options { cell, grade: 2, thickness: None }) {
            Err(error) => println!("{name} is refused: {error}"),
            Ok((layer, report)) => {
                println!(
                    "{name}: {} tetrahedra, least dihedral angle {:.1} degrees, relative volume difference {:+.2e}, \
                     {} parts, {} parts left out, {} outside nodes taken in, filled in {:.2} s",
                    report.tetrahedra,
                    report.worst_dihedral,
                    report.volume_difference,
                    report.parts,
                    report.dropped.parts,
                    report.thickened.nodes,
                    report.seconds
                );
                check(&layer, &report);
                filled += 1;
            }
        }
    }
    assert!(filled >= 5);
}

#[test]
#[ignore = "takes about a minute; prints the times of filling and embedding"]
fn lasting_seconds_against_vertices() {
    for count in [10_000, 44_000, 100_000, 400_000] {
        let mesh = crate::prepare::model::surface(Model::Head, count);
        let (layer, report) = stuff(&mesh.0, &mesh.1, &Options::uniform(0.00625)).unwrap();
        let start = Instant::now();
        let out = embed::extrapolation(&embed(&mesh.0, &layer).unwrap());
        let embedding = start.elapsed().as_secs_f64();
        println!(
            "{count} vertices: filled in {:.2} s, {} tetrahedra, embedded in {embedding:.2} s, extrapolation {out:.2}",
            report.seconds, report.tetrahedra
        );
    }
}

/// A tetrahedron fills space outside the surface if its centroid is farther outside than this, in cell edges.
const OUTSIDE: f64 = 0.2;

/// Checks that every tetrahedron which fills space outside the surface is near a place that the report lists: a gap
/// that was filled (`welded`), or an outside node that was taken in for a thin feature (`thickened`).
fn what_lies_outside_is_reported(mesh: &Mesh, layer: &Layer, report: &LayerReport, cell: f64) {
    let solid = Solid::new(&mesh.0, &mesh.1).unwrap();
    let welded = report.welded.widest.iter().map(|w| w.place);
    let places: Vec<DVec3> = report.thickened.places.iter().copied().chain(welded).map(DVec3::from_array).collect();
    assert_eq!(places.len(), report.thickened.nodes + report.welded.count);
    for t in &layer.tetrahedra {
        let middle: DVec3 = t.iter().map(|&n| layer.nodes[n as usize] / 4.0).sum();
        let named = || places.iter().any(|p| p.distance(middle) < cell);
        assert!(
            solid.signed(middle) < OUTSIDE * cell || named(),
            "a tetrahedron at {middle} fills space outside the surface, but the report lists no place near it"
        );
    }
}

#[test]
#[ignore = "needs real meshes"]
fn the_real_meshes_keep_their_volume_and_their_angles() {
    let Some(folder) = meshes() else { return };
    let cases = ["head", "pumpkin", "gear", "human"].map(|name| (name, 1.0 / 40.0));
    for (name, share) in cases.into_iter().chain([("human", 0.02 / 1.67)]) {
        let mesh = real(&folder, name);
        let cell = share * largest_extent(&mesh);
        let (layer, report) = uniform(&mesh, cell);
        let out = embed::extrapolation(&embed(&mesh.0, &layer).unwrap());
        println!(
            "{name} with cells of {cell:.4} m: {} nodes, {} tetrahedra, dihedral angles: least {:.2}, first percentile \
             {:.2}, largest {:.2} degrees; relative volume difference {:+.2e}, shift of the surface {:.3} cells; parts \
             {}, parts left out {}, lattice edges over gaps kept open {}, nodes duplicated {}, lattice edges over gaps \
             filled {}, lattice edges through lost features {}, outside nodes taken in {}; greatest extrapolation \
             {out:.2}, filled in {:.2} s",
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
        assert_eq!((report.parts, report.dropped.parts), (1, 0));
        // Every vertex of the surface has a node of the layer within one cell, so no weight is far below zero.
        assert!(out < 1.5, "greatest extrapolation of a surface vertex {out}, expected below 1.5");
        what_lies_outside_is_reported(&mesh, &layer, &report, cell);
    }
}
