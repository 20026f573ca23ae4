//! Compares this crate's reader of OBJ files with the reader of the crate tobj on real meshes: both must give the same
//! corners of triangles in the same order. (This crate has a reader of its own, since tobj drops unused vertices,
//! orders the others by first use and reports no line numbers of errors; see src/scene/obj.rs.)

mod real_meshes;

use std::path::Path;

use glam::DVec3;
use palpate::scene::triangles;

use real_meshes::meshes;

fn corners_by_tobj(file: &Path) -> Vec<DVec3> {
    let options = tobj::LoadOptions { triangulate: true, ..Default::default() };
    let (models, _) = tobj::load_obj(file, &options).unwrap();
    let corner = |mesh: &tobj::Mesh, i: u32| DVec3::from_slice(&mesh.positions[3 * i as usize..][..3]);
    models
        .iter()
        .flat_map(|model| model.mesh.indices.iter().map(|i| corner(&model.mesh, *i)).collect::<Vec<_>>())
        .collect()
}

#[test]
#[ignore = "needs real meshes"]
fn the_reader_agrees_with_tobj_on_real_meshes() {
    let Some(meshes) = meshes() else { return };
    for name in ["surf/head.obj", "surf/gear.obj", "surf/human.obj", "surf/pumpkin.obj", "surf/human_3000.obj"] {
        let file = meshes.join(name);
        let mesh = triangles::read(&file).unwrap().mesh;
        let ours: Vec<DVec3> = mesh.triangles.iter().flatten().map(|v| mesh.vertices[*v as usize]).collect();
        assert_eq!(ours, corners_by_tobj(&file), "corners of the triangles of {name}, by this crate and by tobj");
    }
}
