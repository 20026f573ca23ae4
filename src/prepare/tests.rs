//! The whole preparation on real meshes, where they are at hand: `../shared/meshes`, or the folder PALPATE_MESHES.

use std::path::PathBuf;
use std::time::Instant;

use super::{Layer, NONE, embed, lattice, layer, mass, proxies, skin};
use crate::scene::obj;

/// The folder of meshes, or one visible line and nothing.
pub fn meshes(test: &str) -> Option<PathBuf> {
    let beside = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/meshes");
    let folder = std::env::var_os("PALPATE_MESHES").map_or(beside, PathBuf::from);
    if !folder.is_dir() {
        eprintln!("skipped: {test}: no meshes in {}", folder.display());
        return None;
    }
    Some(folder)
}

#[test]
fn real_surfaces_get_a_layer_an_embedding_and_proxies() {
    let Some(folder) = meshes("real surfaces") else { return };
    for name in ["head", "pumpkin", "gear", "human", "human_3000"] {
        let mesh = obj::read(&folder.join(format!("surf/{name}.obj"))).unwrap();
        let low = mesh.vertices.iter().copied().fold(glam::DVec3::INFINITY, glam::DVec3::min);
        let high = mesh.vertices.iter().copied().fold(glam::DVec3::NEG_INFINITY, glam::DVec3::max);
        let cell = (high - low).max_element() / 25.0;
        let start = Instant::now();
        let layer = lattice::lattice(&mesh.vertices, &mesh.triangles, cell).unwrap();
        let lattice_time = start.elapsed();
        check_layer(&layer, mass::properties(&mesh.vertices, &mesh.triangles).volume);
        let embeddings = embed(&mesh.vertices, &layer).unwrap();
        let worst = embed::extrapolation(&embeddings);
        assert!(worst < 1e-8, "{name}: {worst}, cell {cell}");
        let embed_time = start.elapsed() - lattice_time;
        let skin = skin::build(mesh.vertices, mesh.triangles);
        assert!(skin.neighbours.iter().flatten().all(|&n| n != NONE));
        let start = Instant::now();
        let proxies = proxies(&skin).unwrap();
        let proxy_time = start.elapsed();
        super::proxy::tests::check(&skin, &proxies);
        assert!((2..=32).contains(&proxies.len()));
        let margin = proxies.iter().map(|p| p.margin).fold(0.0, f64::max);
        let most = proxies.iter().map(|p| p.triangles.len()).max().unwrap();
        println!(
            "{name}: {} tetrahedra {lattice_time:.0?}, embedding {embed_time:.0?}, {} proxies {proxy_time:.0?}, \
             margin {margin:.2e}, most triangles {most}",
            layer.tetrahedra.len(),
            proxies.len()
        );
        // Greedy hulls of 64 corners leave a few per cent of a part's size; a missed corner would leave far more.
        assert!(margin < 0.02 * (high - low).length(), "{name}: {margin}");
    }
}

/// Positive volumes, and not less than the surface encloses.
fn check_layer(layer: &Layer, volume: f64) {
    let volumes = layer.tetrahedra.iter().map(|t| layer::volume6(&layer.nodes, t) / 6.0);
    assert!(volumes.clone().all(|v| v > 0.0));
    assert!(volumes.sum::<f64>() > volume);
    assert_eq!(layer::parts(layer).1, 1);
}
