//! The material of each tetrahedron of a layer (tetrahedral mesh of a soft body): the body's base material, or the
//! material of a material region (a part of the body for which the scene gives a material of its own). A region may be
//! a *group* of tetrahedra that the mesh file defines, a box or a sphere.

use glam::DVec3;

use super::Layer;
use super::body::Keys;
use crate::Result;
use crate::scene::groups::Groups;
use crate::scene::{self, Material, Place};

/// The materials of a layer.
#[derive(Debug, Clone, PartialEq)]
pub struct Materials {
    /// The body's base material first, then the materials of its material regions.
    pub all: Vec<Material>,
    /// For each tetrahedron the index of its material in `all`; empty if every tetrahedron has the base material.
    pub which: Vec<u32>,
}

impl Materials {
    /// Index of a tetrahedron's material in `all`.
    pub fn index(&self, tetrahedron: usize) -> usize {
        self.which.get(tetrahedron).map_or(0, |&index| index as usize)
    }

    /// The material of a tetrahedron.
    pub fn of(&self, tetrahedron: usize) -> &Material {
        &self.all[self.index(tetrahedron)]
    }
}

impl From<Material> for Materials {
    fn from(material: Material) -> Self {
        Self { all: vec![material], which: Vec::new() }
    }
}

impl From<&Materials> for Materials {
    fn from(materials: &Materials) -> Self {
        materials.clone()
    }
}

/// The materials of a body's layer, which is in file coordinates. It is an error if the layer's file does not have a
/// region's group, if no tetrahedron lies in a region, or if all tetrahedra in a region belong to earlier regions.
pub(super) fn materials(keys: &Keys, body: &scene::Body, layer: &Layer, groups: &Groups) -> Result<Materials> {
    let base = body.material.ok_or_else(|| keys.error("material", "missing", "a soft body needs a material"))?;
    if body.regions.is_empty() {
        return Ok(base.into());
    }
    let mut which = vec![0; layer.tetrahedra.len()];
    for (index, region) in body.regions.iter().enumerate() {
        let key = |key: &str| format!("region[{index}].{key}");
        let (name, named) = match &region.place {
            Place::Group(group) => {
                let number = groups.find(group).map_err(|list| {
                    let problem = match group {
                        scene::Group::Name(name) => format!("there is no group \"{}\"", name.escape_debug()),
                        scene::Group::Number(number) => format!("there is no group {number}"),
                    };
                    keys.error(&key("group"), format!("{problem} in the layer's file"), list)
                })?;
                ("group", groups.of.iter().map(|&group| group == Some(number)).collect::<Vec<_>>())
            }
            Place::Box { low, high } => {
                ("box", inside(layer, |centroid| centroid.cmpge(*low).all() && centroid.cmple(*high).all()))
            }
            Place::Sphere { centre, radius } => {
                ("sphere", inside(layer, |centroid| centroid.distance(*centre) <= *radius))
            }
        };
        let own = index as u32 + 1;
        for (which, _) in which.iter_mut().zip(&named).filter(|(which, named)| **named && **which == 0) {
            *which = own;
        }
        if !which.contains(&own) {
            let problem = if named.contains(&true) {
                "all tetrahedra of the region are in earlier regions"
            } else {
                "no tetrahedron has its centroid in the region"
            };
            return Err(keys.error(&key(name), problem, "enlarge the region, or remove it"));
        }
    }
    let all = std::iter::once(base).chain(body.regions.iter().map(|region| region.material)).collect();
    Ok(Materials { all, which })
}

/// For each tetrahedron, whether `is_inside` holds for its centroid.
fn inside(layer: &Layer, is_inside: impl Fn(DVec3) -> bool) -> Vec<bool> {
    let centroid = |nodes: &[u32; 4]| nodes.iter().map(|&node| layer.nodes[node as usize]).sum::<DVec3>() / 4.0;
    layer.tetrahedra.iter().map(|nodes| is_inside(centroid(nodes))).collect()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::prepare::{Body, FrameMotion, Shape, body};
    use crate::scene::{MaterialLaw, Scene};

    /// A mesh file of two tetrahedra that share a face, one in the physical group 3 and the other in the physical group
    /// 4, and of a third tetrahedron in no group.
    const MESH: &str = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n2\n3 3 \"fat\"\n3 4 \"muscle\"\n\
                        $EndPhysicalNames\n$Nodes\n6\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n5 1 1 1\n6 2 1 0\n$EndNodes\n\
                        $Elements\n3\n1 4 2 3 1 1 2 3 4\n2 4 2 4 1 2 3 4 5\n3 4 2 0 1 2 3 5 6\n$EndElements\n";
    const BODY: &str = "[[body]]\nname = \"a\"\nlayer = \"a.msh\"\nscale = 0.1\n\
                        material = { young = 2e4, poisson = 0.4, density = 1000, damping_mass = 2.0 }\n";

    fn prepared(regions: &str) -> Result<Body> {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("a.msh"), MESH).unwrap();
        let file = folder.path().join("scene.toml");
        fs::write(&file, format!("{BODY}{regions}")).unwrap();
        let scene = Scene::load(&file)?;
        body(&scene.bodies[0], &scene)
    }

    fn region(place: &str, material: &str) -> String {
        format!("[[body.region]]\n{place}\nmaterial = {{ {material} }}\n")
    }

    fn soft(regions: &str) -> (Materials, f64) {
        let Shape::Soft { materials, frames, .. } = prepared(regions).unwrap().shape else { panic!("body not soft") };
        let FrameMotion::Floating { mass, .. } = frames[0].motion else { panic!("the frame is not floating") };
        (materials, mass)
    }

    #[test]
    fn a_region_overrides_what_it_says_and_the_first_has_a_tetrahedron() {
        assert_eq!(soft("").0.which, [] as [u32; 0]);
        let fat = region("group = \"fat\"", "young = 5e3, density = 900, law = \"neo-hookean\"");
        let rest = region("sphere = [0.6, 0.6, 0.6, 0.3]", "damping_mass = 7, poisson = 0.1")
            + &region("box = [[0, 0, 0], [9, 9, 9]]", "damping_stiffness = 0.5");
        let (materials, mass) = soft(&(fat + &rest));
        assert_eq!(materials.which, [1, 2, 3]);
        let base = materials.all[0];
        let [first, second, third] = [0, 1, 2].map(|t| *materials.of(t));
        assert_eq!(first, Material { young: 5e3, density: 900.0, law: MaterialLaw::NeoHookean, ..base });
        assert_eq!(second, Material { damping_mass: 7.0, poisson: 0.1, ..base });
        assert_eq!(third, Material { damping_stiffness: 0.5, ..base });
        // The tetrahedra have volumes of 1/6, 1/3 and 1/3 m^3 before lengths are scaled by 0.1.
        assert!(
            (mass - (900.0 + 2.0 * 1000.0 + 2.0 * 1000.0) / 6000.0).abs() < 1e-12,
            "wrong mass {mass} kg of the body"
        );
        assert_eq!(soft(&region("group = 4", "density = 1")).0.which, [0, 1, 0]);
    }

    #[test]
    fn mistakes_are_answered_by_key() {
        let young = "young = 1e3";
        let fat = region("group = 3", young);
        for (regions, words) in [
            (
                region("group = \"bone\"", young),
                "`body.a.region[0].group`: there is no group \"bone\" in the layer's file",
            ),
            (region("group = \"bone\"", young), "the file's groups are 3 \"fat\", 4 \"muscle\""),
            (fat.clone() + &region("group = 0", young), "`body.a.region[1].group`: there is no group 0"),
            (fat.clone() + &fat, "`body.a.region[1].group`: all tetrahedra of the region are in earlier regions"),
            (region("sphere = [9, 9, 9, 1]", young), "`body.a.region[0].sphere`: no tetrahedron has its centroid"),
            (region("group = 1.5", young), "`body.a.region[0].group`: is of type float; give a whole number"),
            (region("group = 99999999999999999999", young), "give a whole number of 64 bits"),
            (region("group = 3\nbox = [[0, 0, 0], [1, 1, 1]]", young), "given together with `group`"),
            (region("", young), "`body.a.region[0].group`: missing; give exactly one of: group, box, sphere"),
            (region("box = [[0, 0, 0], [0, 1, 1]]", young), "`body.a.region[0].box`: "),
            (region("sphere = [0, 0, 0, 0]", young), "`body.a.region[0].sphere`: has radius 0.0"),
            (region("group = 3", "yung = 1"), "unknown key `body.a.region[0].material.yung`; did you mean `young`?"),
            (region("group = 3", "poisson = 0.5"), "`body.a.region[0].material.poisson`: is 0.5"),
            (region("group = 3", "density = 0"), "`body.a.region[0].material.density`: is 0.0; give a number greater"),
            (region("group = 3", "law = \"hooke\""), "`body.a.region[0].material.law`: there is no law \"hooke\""),
            ("[[body.region]]\ngroup = 3\n".into(), "`body.a.region[0].material`: missing"),
            (region("group = 3\nname = \"x\"", young), "unknown key `body.a.region[0].name`"),
            ("region = 3\n".into(), "`body.a.region`: is of type integer; give an array"),
        ] {
            let message = prepared(&regions).unwrap_err().to_string();
            assert!(message.contains(words), "scene with {regions} gives the error: {message}");
        }
    }

    #[test]
    fn groups_need_a_file_and_regions_a_soft_body() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("scene.toml");
        fs::write(folder.path().join("a.obj"), "v 0 0 0\n").unwrap();
        for (body, words) in [
            (
                BODY.replace("\"a.msh\"", "{ box = [[0, 0, 0], [1, 1, 1]], cells = [1, 1, 1] }"),
                "`body.a.region[0].group`: the layer is generated and has no groups",
            ),
            (
                "[[body]]\nname = \"a\"\nsurface = \"a.obj\"\n".into(),
                "`body.a.region`: has no meaning for a rigid body",
            ),
            ("[[body]]\nname = \"a\"\nplane = [0, 1, 0, 0]\n".into(), "`body.a.region`: has no meaning for a plane"),
        ] {
            fs::write(&file, body + &region("group = 3", "young = 1")).unwrap();
            let message = Scene::load(&file).unwrap_err().to_string();
            assert!(message.contains(words), "expected `{words}` in the error: {message}");
        }
    }
}
