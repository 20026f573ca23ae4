//! Reads the skeleton file that a soft body of a scene names, as in `skeleton = "human-skeleton.toml"`. Each bone of
//! the file has a capsule (a line segment, its axis, with a radius at either end) and becomes a rigid core of the body:
//! a rigid body inside the soft one, to which nodes of the layer (the tetrahedral mesh) are attached. Called by
//! `body.rs`.
//!
//! The nodes in a bone's capsule are attached to that bone. A node in several capsules belongs to the bone whose axis
//! is nearest, as a multiple of the capsule's radius at the nearest point of the axis; of equally near bones, to the
//! first in the file. Coordinates are those of the body's mesh file, before scale and pose.

use std::path::PathBuf;

use glam::DVec3;

use super::Capsule;
use super::joint::{self, Resistance};
use super::keys::{Source, Table, Value, suggest};
use super::reference;
use crate::{Result, files};

/// A skeleton, as its file describes it.
#[derive(Debug, Clone, PartialEq)]
pub struct Skeleton {
    /// The file that the skeleton was read from.
    pub file: PathBuf,
    /// The bones; the parent of a bone comes before the bone.
    pub bones: Vec<Bone>,
}

/// A bone: a table `[[bone]]` of the file.
#[derive(Debug, Clone, PartialEq)]
pub struct Bone {
    /// Name of the bone and of its core, unique in the skeleton.
    pub name: String,
    /// Index of the parent, the bone with which this one shares a joint; `None` for a root, which has no parent.
    pub parent: Option<usize>,
    /// Position of the ball joint between the bone and its parent, in the coordinates of the mesh file.
    pub joint: DVec3,
    /// Resistance of that joint to rotation; limits of the rotation refer to the capsule's axis.
    pub resistance: Resistance,
    /// The capsule in which nodes are attached to the bone.
    pub capsule: Capsule,
}

/// Reads the skeleton file that a body of a scene names. Errors name the skeleton file, the line and the key.
pub(super) fn read(value: &Value) -> Result<Skeleton> {
    let file = value.file()?;
    let text = files::text(&file, "give a skeleton file")?;
    let source = Source::of_file(&file, &text);
    let document = source.parse()?;
    let root = Table::root(&source, &document, &reference::SKELETON)?;
    let mut bones: Vec<Bone> = Vec::new();
    for element in root.need("bone")?.array()? {
        bones.push(bone(&element, &bones)?);
    }
    if bones.is_empty() {
        return Err(root.error("bone", "there is none", "give at least one [[bone]]"));
    }
    Ok(Skeleton { file, bones })
}

fn bone(value: &Value, before: &[Bone]) -> Result<Bone> {
    let unnamed = value.table(&reference::BONE)?;
    let name = unnamed.need("name")?.name()?;
    let table = unnamed.renamed(format!("bone.{name}"));
    if before.iter().any(|other| other.name == name) {
        return Err(table.error("name", format!("\"{name}\" is taken by another bone"), "choose another name"));
    }
    let parent = table.option("parent", |value| {
        let parent = value.text()?;
        before.iter().position(|other| other.name == parent).ok_or_else(|| {
            let names: Vec<&str> = before.iter().map(|other| other.name.as_str()).collect();
            let problem = format!("no bone \"{}\" comes before this one", parent.escape_debug());
            value.error(problem, format!("parents come first; {}", suggest(parent, &names)))
        })
    })?;
    let ends = table.need("ends")?.array_of(Value::vector)?;
    let radii = match table.exactly_one(&["radius", "radii"])? {
        "radius" => [table.need("radius")?.positive()?; 2],
        _ => table.need("radii")?.array_of(Value::positive)?,
    };
    let joint = table.need("joint")?.vector()?;
    let resistance = joint::resistance(&table, Some(ends[1] - ends[0]))?;
    if let (None, Some(key)) = (parent, joint::KEYS.iter().find(|key| table.has(key))) {
        return Err(table.error(key, "a root bone has no parent to turn on", "remove it, or give the bone a `parent`"));
    }
    Ok(Bone { name, parent, joint, resistance, capsule: Capsule { ends, radii } })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::prepare::bind;
    use crate::prepare::distance::winding_number;
    use crate::prepare::stuffing::{Options, stuff};
    use crate::scene::{Bind, Core, Model, Motion};

    /// Least allowed distance between a bone's axis and the vertices of the skin (the body's surface mesh), m.
    const DEEP: f64 = 0.008;
    /// Least allowed number of nodes attached to a bone: three nodes determine a rigid motion.
    const HELD: usize = 3;
    /// Edge of the cells from which the layer of the model `human` is made, m; at this size it has about 10,340
    /// tetrahedra.
    const CELL: f64 = 0.0459;

    fn skeleton(text: &str) -> Result<Skeleton> {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("bones.toml"), text).unwrap();
        load(&folder.path().join("scene.toml"), "bones.toml")
    }

    fn load(scene: &Path, path: &str) -> Result<Skeleton> {
        let text = format!("skeleton = {path:?}");
        let source = Source::of_file(scene, &text);
        let document = source.parse()?;
        read(&Table::root(&source, &document, &reference::BODY)?.need("skeleton")?)
    }

    fn human() -> Vec<Bone> {
        let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/scenes");
        load(&scenes.join("touch-human.toml"), "../human-skeleton.toml").unwrap().bones
    }

    #[test]
    fn bones_of_the_human_lie_within_its_skin() {
        let bones = human();
        assert!(bones.len() >= 15);
        assert_eq!(bones.iter().filter(|bone| bone.parent.is_none()).count(), 1);
        let (vertices, triangles) = crate::prepare::model::surface(Model::Human, Model::Human.default_vertices());
        for bone in &bones {
            let [a, b] = bone.capsule.ends;
            for p in (0..=10).map(|k| a.lerp(b, f64::from(k) / 10.0)) {
                assert!(winding_number(&vertices, &triangles, p) > 0.5, "axis of {} leaves the skin at {p}", bone.name);
                let near = vertices.iter().map(|v| v.distance(p)).fold(f64::INFINITY, f64::min);
                assert!(near > DEEP, "the axis of {} at {p} is only {near} m from a skin vertex", bone.name);
            }
            let inside = winding_number(&vertices, &triangles, bone.joint) > 0.5;
            assert!(inside, "the joint of {} must lie within the skin", bone.name);
            // Bones on the left mirror those on the right.
            if let Some(other) = bone.name.strip_prefix("left_") {
                let other = bones.iter().find(|b| b.name == format!("right_{other}")).unwrap();
                let mirror = |p: DVec3| DVec3::new(-p.x, p.y, p.z);
                assert_eq!((bone.capsule.ends.map(mirror), mirror(bone.joint)), (other.capsule.ends, other.joint));
            }
        }
    }

    #[test]
    fn every_bone_of_the_human_holds_nodes_of_a_coarse_layer() {
        let (vertices, triangles) = crate::prepare::model::surface(Model::Human, Model::Human.default_vertices());
        let (layer, _) = stuff(&vertices, &triangles, &Options::uniform(CELL)).unwrap();
        println!("layer of the human: {} nodes, {} tetrahedra", layer.nodes.len(), layer.tetrahedra.len());
        let core = |bone: &Bone| Core {
            name: bone.name.clone(),
            motion: Motion::Fixed,
            bind: Some(Bind::Capsule(bone.capsule)),
            mass: None,
            hinge: None,
        };
        let cores: Vec<Core> = human().iter().map(core).collect();
        let mut least = usize::MAX;
        for (index, bone) in human().iter().enumerate() {
            let depths = layer.nodes.iter().map(|&n| bind::capsule_depth(n, &bone.capsule));
            let mut named: Vec<bool> = depths.map(|depth| depth <= 1.0).collect();
            bind::nearer_bones(&layer, &cores, index, &mut named);
            let count = named.iter().filter(|&&n| n).count();
            println!("bone {}: {count} attached nodes", bone.name);
            least = least.min(count);
        }
        assert!(least >= HELD, "a bone has only {least} attached nodes");
    }

    const TWO: &str = "[[bone]]\nname = \"hip\"\njoint = [0, 0, 0]\nends = [[0, 0, 0], [1, 0, 0]]\nradius = 0.1\n\n\
                       [[bone]]\nname = \"shin\"\nparent = \"hip\"\njoint = [1, 0, 0]\nends = [[1, 0, 0], [2, 0, 0]]\n\
                       radii = [0.1, 0.2]\n";

    #[test]
    fn a_skeleton_is_read_and_its_mistakes_are_named() {
        let bones = skeleton(TWO).unwrap().bones;
        assert_eq!((bones[0].parent, bones[1].parent, bones[1].joint), (None, Some(0), DVec3::X));
        assert_eq!((bones[0].capsule.radii, bones[1].capsule.radii), ([0.1; 2], [0.1, 0.2]));
        let limp = skeleton(&(TWO.to_owned() + "damping = 0.5\ntwist = 0.3\n")).unwrap().bones;
        assert_eq!(bones[1].resistance, Resistance::default());
        let resistance = Resistance { damping: 0.5, twist: Some(0.3), axis: DVec3::X, ..Resistance::default() };
        assert_eq!(limp[1].resistance, resistance);
        for (old, new, words) in [
            ("parent = \"hip\"", "parent = \"hop\"", "bones.toml:9: `bone.shin.parent`: no bone \"hop\""),
            ("parent = \"hip\"", "parent = \"hop\"", "did you mean \"hip\"?"),
            ("parent = \"hip\"", "parent = \"shin\"", "parents come first"),
            ("parent", "parnt", "bones.toml:9: unknown key `bone[1].parnt`; did you mean `parent`?"),
            ("\"shin\"", "\"hip\"", "\"hip\" is taken by another bone"),
            ("radius = 0.1", "radius = 0", "bones.toml:5: `bone.hip.radius`: is 0"),
            ("radii = [0.1, 0.2]", "radii = [0.1]", "`bone.shin.radii`: has 1 elements"),
            ("radius = 0.1", "radius = 0.1\nradii = [1, 1]", "`bone.hip.radii`: given together with `radius`"),
            ("joint = [0, 0, 0]", "", "`bone.hip.joint`: missing"),
            ("joint = [0, 0, 0]", "joint = [0, nan, 0]", "`bone.hip.joint[1]`: is NaN"),
            ("radius = 0.1", "radius = 0.1\nstiffness = 1", "`bone.hip.stiffness`: a root bone has no parent"),
            ("radii = [0.1, 0.2]", "radius = 0.1\nswing = 4", "bones.toml:13: `bone.shin.swing`: is 4"),
            (
                "[2, 0, 0]]\nradii = [0.1, 0.2]",
                "[1, 0, 0]]\nradius = 0.1\ntwist = 1",
                "`bone.shin.twist`: a limit needs the axis",
            ),
            ("[[bone]]", "[[bones]]", "unknown key `bones`"),
            ("[[bone]]", "[[bone]", "bones.toml:1: not TOML"),
        ] {
            assert!(TWO.contains(old));
            let message = skeleton(&TWO.replacen(old, new, 1)).unwrap_err().to_string();
            assert!(message.contains(words), "the text `{new}` gives the error: {message}");
        }
        assert!(skeleton("").unwrap_err().to_string().contains("`bone`: missing"));
        assert!(skeleton("bone = []").unwrap_err().to_string().contains("there is none"));
    }
}
