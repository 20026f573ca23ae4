//! The version of the code that prepares bodies, given by the texts of its source files and of the lock file, which has
//! the versions of all libraries. The cache of prepared bodies has these texts in every key, so that a body that was
//! cached by other code is made again, and no version number has to be maintained.

/// Contents of every file on which the costly, cached parts of a body depend.
pub(super) const SOURCES: &[&str] = &[
    include_str!("../../Cargo.lock"),
    include_str!("distance.rs"),
    include_str!("embed.rs"),
    include_str!("hull.rs"),
    include_str!("lattice.rs"),
    include_str!("layer.rs"),
    include_str!("mass.rs"),
    include_str!("mod.rs"),
    include_str!("model/collapse.rs"),
    include_str!("model/extract.rs"),
    include_str!("model/gear.rs"),
    include_str!("model/head.rs"),
    include_str!("model/human.rs"),
    include_str!("model/mod.rs"),
    include_str!("model/pumpkin.rs"),
    include_str!("model/solid.rs"),
    include_str!("model/sphere.rs"),
    include_str!("model/split.rs"),
    include_str!("prepared.rs"),
    include_str!("proxy.rs"),
    include_str!("quality.rs"),
    include_str!("repair/intersections.rs"),
    include_str!("repair/faces.rs"),
    include_str!("repair/mod.rs"),
    include_str!("repair/outside.rs"),
    include_str!("repair/report.rs"),
    include_str!("repair/topology.rs"),
    include_str!("skin.rs"),
    include_str!("sphere.rs"),
    include_str!("stuffing/cut.rs"),
    include_str!("stuffing/fill.rs"),
    include_str!("stuffing/grade.rs"),
    include_str!("stuffing/mod.rs"),
    include_str!("stuffing/parts.rs"),
    include_str!("stuffing/report.rs"),
    include_str!("stuffing/sample.rs"),
    include_str!("stuffing/stencil.rs"),
    include_str!("stuffing/thin.rs"),
    include_str!("stuffing/volume.rs"),
    include_str!("../scene/cursor.rs"),
    include_str!("../scene/gltf.rs"),
    include_str!("../scene/gmsh.rs"),
    include_str!("../scene/gmsh/groups.rs"),
    include_str!("../scene/groups.rs"),
    include_str!("../scene/meshes.rs"),
    include_str!("../scene/number.rs"),
    include_str!("../scene/obj.rs"),
    include_str!("../scene/ply.rs"),
    include_str!("../scene/stl.rs"),
    include_str!("../scene/tetgen.rs"),
    include_str!("../scene/tetrahedra.rs"),
    include_str!("../scene/triangles.rs"),
    include_str!("../scene/triangulate.rs"),
    include_str!("../scene/vtk.rs"),
    include_str!("../scene/vtk/data.rs"),
    include_str!("../scene/vtk/grid.rs"),
    include_str!("../scene/vtk_xml.rs"),
    include_str!("../scene/vtk_xml/array.rs"),
];

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::{Path, PathBuf};

    /// Files of the folders `prepare` and `scene` on which the cached parts of a body do not depend.
    const OTHERS: [&str; 43] = [
        "prepare/bind.rs",
        "prepare/bodies.rs",
        "prepare/body.rs",
        "prepare/cache.rs",
        "prepare/cores.rs",
        "prepare/coverage.rs",
        "prepare/loads.rs",
        "prepare/model/tests.rs",
        "prepare/patch.rs",
        "prepare/repair/tests.rs",
        "prepare/materials.rs",
        "prepare/report.rs",
        "prepare/ride.rs",
        "prepare/sources.rs",
        "prepare/supports.rs",
        "prepare/stuffing/tests/mod.rs",
        "prepare/stuffing/tests/random.rs",
        "prepare/stuffing/tests/real.rs",
        "prepare/tests.rs",
        "scene/body.rs",
        "scene/build.rs",
        "scene/check.rs",
        "scene/dotted.rs",
        "scene/tools.rs",
        "scene/trajectory.rs",
        "scene/hand.rs",
        "scene/haptics.rs",
        "scene/joint.rs",
        "scene/keys.rs",
        "scene/load.rs",
        "scene/loads.rs",
        "scene/material.rs",
        "scene/mod.rs",
        "scene/model.rs",
        "scene/names.rs",
        "scene/preset.rs",
        "scene/profile.rs",
        "scene/reference.rs",
        "scene/skeleton.rs",
        "scene/support.rs",
        "scene/tests.rs",
        "scene/units.rs",
        "scene/vtk_xml/write.rs",
    ];

    fn files(folder: &Path, found: &mut Vec<PathBuf>) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                files(&path, found);
            } else {
                found.push(path);
            }
        }
    }

    #[test]
    fn every_source_of_preparation_is_listed() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
        let mut found = Vec::new();
        ["prepare", "scene"].iter().for_each(|folder| files(&root.join(folder), &mut found));
        assert!(found.len() > OTHERS.len());
        for path in found {
            let name = path.strip_prefix(&root).unwrap().to_str().unwrap();
            let text = fs::read_to_string(&path).unwrap();
            let listed = super::SOURCES.contains(&text.as_str());
            assert_ne!(listed, OTHERS.contains(&name), "{name} must be in SOURCES or in OTHERS, and not in both");
        }
    }
}
