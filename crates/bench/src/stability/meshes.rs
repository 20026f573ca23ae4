//! Writes mesh files for the stability matrix (many stiff and extreme simulations, each judged by invariants), for
//! bodies that a scene cannot describe by numbers: a block in which one row of cells is squeezed to slivers (flat
//! tetrahedra), a single tetrahedron, a bar that hangs, and a head.

use std::path::PathBuf;

use glam::DVec3;
use palpate::Result;
use palpate::internal::prepare::layer::{boundary, kuhn_box};
use palpate::internal::prepare::model;
use palpate::internal::prepare::stuffing::{self, Options};
use palpate::scene::Model;

use crate::meshes::MeshFolder;

/// Number of cells of the block along y, of which the second is thin.
const CELLS: u32 = 4;
/// Number of cells along the largest extent of the head.
const HEAD_CELLS: f64 = 8.0;
/// Numbers of cells of the bar along x, y and z.
const BAR: [u32; 3] = [2, 20, 2];

/// Writes a cube of edge `edge` (m) whose second row of cells along y is so thin that the least dihedral angle of its
/// tetrahedra is `angle` (degrees). Returns the path of the file.
pub fn slivers(folder: &MeshFolder, angle: f64, edge: f64) -> Result<PathBuf> {
    let mut layer = kuhn_box(DVec3::ZERO, DVec3::splat(edge), [3, CELLS, 3]);
    let cell = edge / 3.0;
    let thin = cell * angle.to_radians().tan();
    // Heights of the planes of nodes, m; the second plane and the third are close together.
    let heights = [0.0, edge / 3.0, edge / 3.0 + thin, edge * (2.0 / 3.0), edge];
    for node in &mut layer.nodes {
        node.y = heights[(node.y / edge * f64::from(CELLS)).round() as usize];
    }
    folder.layer(&format!("slivers-{angle}"), &layer.nodes, &layer.tetrahedra)
}

/// Writes a bar that hangs down from the plane y = 0, with a square section of a fifth of its length `edge` (m).
/// Neighbouring cells are mirror images of each other, so that the bar has the symmetry of its section and hangs
/// straight down. Returns the path of the file.
pub fn bar(folder: &MeshFolder, edge: f64) -> Result<PathBuf> {
    let half = 0.05 * edge;
    let cells = BAR;
    let layer = kuhn_box(DVec3::new(-half, -edge, -half), DVec3::new(half, 0.0, half), cells);
    // Position of a node in the grid of cells, from its coordinates.
    let place = |x: DVec3| {
        let share = (x - DVec3::new(-half, -edge, -half)) / DVec3::new(2.0 * half, edge, 2.0 * half);
        (share * DVec3::from_array(cells.map(f64::from))).round()
    };
    let nodes: std::collections::HashMap<[i64; 3], u32> =
        layer.nodes.iter().zip(0..).map(|(x, i)| (place(*x).to_array().map(|k| k as i64), i)).collect();
    let mirrored = |tetrahedron: &[u32; 4]| {
        let places = tetrahedron.map(|i| place(layer.nodes[i as usize]));
        let first = places.into_iter().fold(DVec3::INFINITY, DVec3::min);
        // Along each axis every second cell is a mirror image.
        let odd = first.to_array().map(|k| k as i64 % 2 == 1);
        let turned = places.map(|at| {
            let mirror = |k: usize| if odd[k] { 2.0 * first[k] + 1.0 - at[k] } else { at[k] };
            nodes[&std::array::from_fn(|k| mirror(k) as i64)]
        });
        // An odd number of mirrors turns a tetrahedron inside out, which two exchanged nodes make up for.
        let [a, b, c, d] = turned;
        if odd.iter().filter(|is_odd| **is_odd).count() % 2 == 1 { [a, b, d, c] } else { turned }
    };
    let tetrahedra: Vec<[u32; 4]> = layer.tetrahedra.iter().map(mirrored).collect();
    folder.layer("bar", &layer.nodes, &tetrahedra)
}

/// Writes a sheet of the height of a tenth of a cube of edge `edge` (m), at the top of that cube. Returns the path of
/// the file.
pub fn sheet(folder: &MeshFolder, edge: f64) -> Result<PathBuf> {
    let layer = kuhn_box(DVec3::new(0.0, 0.9 * edge, 0.0), DVec3::splat(edge), [8, 1, 8]);
    folder.layer("sheet", &layer.nodes, &layer.tetrahedra)
}

/// Writes a needle: a cone whose centre of mass is at the origin, with its tip `height` (m) below. Returns the path of
/// the file.
pub fn needle(folder: &MeshFolder, height: f64) -> Result<PathBuf> {
    // The centre of mass of a cone is three quarters of its height from its tip.
    let (sides, top, radius) = (12, height / 3.0, 0.2 * height);
    let rim = (0..sides).map(|k| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / f64::from(sides)).sin_cos();
        DVec3::new(radius * cos, top, radius * sin)
    });
    let vertices = [DVec3::new(0.0, -height, 0.0), DVec3::new(0.0, top, 0.0)].into_iter().chain(rim).collect();
    let triangles = (0..sides).flat_map(|k| {
        let (own, next) = (2 + k, 2 + (k + 1) % sides);
        [[0, own, next], [1, next, own]]
    });
    folder.surface("needle", &(vertices, triangles.collect()))
}

/// Writes a blade that is pressed by its edge: a thin box about the origin, whose lower edge lies `height` (m) below.
/// Returns the path of the file.
pub fn blade(folder: &MeshFolder, height: f64) -> Result<PathBuf> {
    let half = DVec3::new(0.05 * height, height, height);
    let (vertices, triangles, _) = boundary(&kuhn_box(-half, half, [1, 1, 1]));
    folder.surface("blade", &(vertices, triangles))
}

/// Writes the model of a head, filled with tetrahedra as the engine fills a scan. Its largest extent is `edge` (m), and
/// its highest vertex is at the middle of the top of a cube of that edge whose least corner is the origin. Returns the
/// path of the file. Errors: the file cannot be written.
pub fn head(folder: &MeshFolder, edge: f64) -> Result<PathBuf> {
    let (mut vertices, triangles) = model::surface(Model::Head, *Model::Head.vertices().start());
    let low = vertices.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let high = vertices.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    let up = |a: &DVec3, b: &DVec3| a.y.total_cmp(&b.y);
    let top = vertices.iter().copied().max_by(up).unwrap_or_default();
    let scale = edge / (high - low).max_element();
    vertices.iter_mut().for_each(|x| *x = scale * (*x - top) + edge * DVec3::new(0.5, 1.0, 0.5));
    let (layer, _) = stuffing::stuff(&vertices, &triangles, &Options::uniform(edge / HEAD_CELLS))
        .map_err(palpate::Error::Simulation)?;
    folder.layer("head", &layer.nodes, &layer.tetrahedra)
}

/// Writes one tetrahedron with a face in the plane x = 0 and three edges of length `edge` (m) along the axes. Returns
/// the path of the file.
pub fn tetrahedron(folder: &MeshFolder, edge: f64) -> Result<PathBuf> {
    let corners = [DVec3::ZERO, DVec3::Y * edge, DVec3::Z * edge, DVec3::X * edge];
    folder.layer("tetrahedron", &corners, &[[0, 1, 2, 3]])
}
