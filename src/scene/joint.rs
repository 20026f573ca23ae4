//! Ball joints between the rigid cores of a soft body: those that the scene file lists as `[[body.joint]]`, and those
//! between the bones of a skeleton and their parent bones. A core is a rigid body inside the soft one, to which nodes
//! of the layer (tetrahedral mesh) are attached; a dynamic core is moved by forces; a bone is a core that a skeleton
//! file defines. The module `body.rs` calls this one.

use glam::DVec3;

use super::check;
use super::keys::{Table, Value, suggest};
use super::reference;
use super::{Core, Motion, Skeleton};
use crate::Result;

/// Keys that describe a joint's resistance, both at a bone of a skeleton file and in `[[body.joint]]`.
pub(super) const KEYS: [&str; 4] = ["stiffness", "damping", "swing", "twist"];
/// Length up to which an axis counts as zero and is refused, in the units of the mesh file.
const SHORTEST_AXIS: f64 = 1e-9;

/// A ball joint: a point that two cores of a body share; at least one of them is dynamic.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Joint {
    /// Indices of the two cores in the body; the joint's angles are those of the second core relative to the first.
    pub cores: [usize; 2],
    /// Position of the joint, in the coordinates of the mesh file, before scale and pose.
    pub point: DVec3,
    /// Resistance to rotation.
    pub resistance: Resistance,
}

/// Resistance to the rotation of a joint's second core relative to its first.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Resistance {
    /// Stiffness towards the rest orientation, N m/rad.
    pub stiffness: f64,
    /// Damping of the relative rotation, N m s/rad.
    pub damping: f64,
    /// Unit axis along the second core, in the coordinates of the mesh file; zero where rotation is not limited.
    pub axis: DVec3,
    /// Greatest angle between that axis and the direction it has at rest, rad; `None`: no limit.
    pub swing: Option<f64>,
    /// Greatest rotation of the second core about that axis, to either side, rad; `None`: no limit.
    pub twist: Option<f64>,
}

/// Reads `stiffness`, `damping`, `swing` and `twist` of a table; `axis` lies along the joint's second core and may have
/// any length.
pub(super) fn resistance(table: &Table, axis: Option<DVec3>) -> Result<Resistance> {
    let angle = |value: &Value| value.ruled(check::limit);
    let (swing, twist) = (table.option("swing", angle)?, table.option("twist", angle)?);
    let limited = if swing.is_some() { Some("swing") } else { twist.map(|_| "twist") };
    let axis = match (limited, axis) {
        (None, _) => DVec3::ZERO,
        (Some(_), Some(axis)) if axis.length() > SHORTEST_AXIS => axis.normalize(),
        (Some(key), _) => {
            return Err(table.error(key, "a limit needs the axis along the core", "give an axis that is not zero"));
        }
    };
    let (stiffness, damping) =
        (table.or("stiffness", 0.0, Value::not_negative)?, table.or("damping", 0.0, Value::not_negative)?);
    Ok(Resistance { stiffness, damping, axis, swing, twist })
}

/// The joints of a body: first those that the body's table lists, then those between bones and their parents. No joint
/// is made between a bone and its parent if the table lists one for them, or if neither of the two is dynamic.
pub(super) fn read(table: &Table, skeleton: Option<&Skeleton>, cores: &[Core]) -> Result<Vec<Joint>> {
    let mut joints: Vec<Joint> = Vec::new();
    if let Some(array) = table.get("joint") {
        for element in array.array()? {
            let joint = joint(&element, cores)?;
            if closes_loop(&joints, &joint, cores) {
                let [a, b] = joint.cores.map(|core| &cores[core].name);
                let problem = format!("\"{a}\" and \"{b}\" are already connected through other joints");
                return Err(element.error(problem, "remove one: joints between dynamic cores must not form a loop"));
            }
            joints.push(joint);
        }
    }
    let same = |a: &Joint, b: &Joint| a.cores == b.cores || a.cores == [b.cores[1], b.cores[0]];
    for (index, bone) in skeleton.iter().flat_map(|skeleton| &skeleton.bones).enumerate() {
        let Some(parent) = bone.parent else { continue };
        let joint = Joint { cores: [parent, index], point: bone.joint, resistance: bone.resistance };
        if !is_dynamic(&joint, cores) || joints.iter().any(|other| same(other, &joint)) {
            continue;
        }
        if closes_loop(&joints, &joint, cores) {
            let problem = format!(
                "with these joints, bone \"{}\" and its parent are also connected through other joints",
                bone.name
            );
            return Err(table.error("joint", problem, "remove one: joints between dynamic cores must not form a loop"));
        }
        joints.push(joint);
    }
    Ok(joints)
}

fn joint(value: &Value, cores: &[Core]) -> Result<Joint> {
    let table = value.table(&reference::JOINT)?;
    let names = table.need("cores")?;
    let [a, b] = names.array()?.try_into().map_err(|_| names.error("is not two names", "name two cores"))?;
    let index = |name: &Value| {
        let text = name.text()?;
        cores.iter().position(|core| core.name == text).ok_or_else(|| {
            let known: Vec<&str> = cores.iter().map(|core| core.name.as_str()).collect();
            name.error(format!("no core is called \"{}\"", text.escape_debug()), suggest(text, &known))
        })
    };
    let axis = table.option("axis", Value::vector)?;
    let joint = Joint {
        cores: [index(&a)?, index(&b)?],
        point: table.need("point")?.vector()?,
        resistance: resistance(&table, axis)?,
    };
    if joint.cores[0] == joint.cores[1] {
        return Err(b.error("is the same core as the first", "name two cores"));
    }
    if !is_dynamic(&joint, cores) {
        return Err(
            names.error("neither core is dynamic", "give one of them motion = \"dynamic\", or remove the joint")
        );
    }
    Ok(joint)
}

/// Whether at least one of the joint's two cores is dynamic.
fn is_dynamic(joint: &Joint, cores: &[Core]) -> bool {
    joint.cores.iter().any(|core| matches!(cores[*core].motion, Motion::Dynamic))
}

/// Whether `joint` would close a loop: its two cores are dynamic, and a chain of `joints` between dynamic cores already
/// connects them. Joints in `joints` between the same two cores do not count.
pub(super) fn closes_loop(joints: &[Joint], joint: &Joint, cores: &[Core]) -> bool {
    let dynamic = |joint: &&Joint| joint.cores.iter().all(|core| matches!(cores[*core].motion, Motion::Dynamic));
    let beside = |other: &&Joint| !joint.cores.iter().all(|core| other.cores.contains(core));
    let mut group: Vec<usize> = (0..cores.len()).collect();
    for other in joints.iter().filter(dynamic).filter(beside) {
        let [a, b] = other.cores.map(|core| group[core]);
        group.iter_mut().filter(|g| **g == a).for_each(|g| *g = b);
    }
    dynamic(&joint) && group[joint.cores[0]] == group[joint.cores[1]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;

    const CORES: &str = "[[body]]\nname = \"arm\"\nlayer = { box = [[0, 0, 0], [1, 1, 1]], cells = [4, 1, 1] }\n\
                         material = { young = 2e4, poisson = 0.4, density = 1000 }\n";

    fn scene(text: &str) -> Result<Scene> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.toml");
        std::fs::write(&path, text).unwrap();
        Scene::load(&path)
    }

    fn with(joints: &str) -> Result<Vec<Joint>> {
        let mut text = CORES.to_owned();
        for (k, motion) in ["fixed", "dynamic", "dynamic", "dynamic", "fixed"].iter().enumerate() {
            let x = k as f64 / 4.0;
            text += &format!("[[body.core]]\nname = \"c{k}\"\nmotion = \"{motion}\"\n");
            text += &format!("bind = {{ box = [[{}, -1, -1], [{}, 2, 2]] }}\n", x - 0.1, x + 0.1);
        }
        scene(&(text + joints)).map(|scene| scene.bodies[0].joints.clone())
    }

    fn of(a: u32, b: u32) -> String {
        format!("[[body.joint]]\ncores = [\"c{a}\", \"c{b}\"]\npoint = [0.5, 0, 0]\n")
    }

    #[test]
    fn joints_are_read_and_what_makes_no_sense_is_refused_by_name() {
        assert_eq!(with("").unwrap(), []);
        let all = "stiffness = 2\ndamping = 0.1\naxis = [2, 0, 0]\nswing = 1.2\ntwist = 0.3\n";
        let joints = with(&(of(0, 1) + &of(2, 1) + all + &of(2, 1))).unwrap();
        let resistance =
            Resistance { stiffness: 2.0, damping: 0.1, axis: DVec3::X, swing: Some(1.2), twist: Some(0.3) };
        let joint = |cores, resistance| Joint { cores, point: DVec3::new(0.5, 0.0, 0.0), resistance };
        let plain = Resistance::default();
        assert_eq!(joints, [joint([0, 1], plain), joint([2, 1], resistance), joint([2, 1], plain)]);
        for (text, problem) in [
            (of(0, 4), "neither core is dynamic"),
            (of(1, 1), "is the same core"),
            (of(1, 7), "no core is called \"c7\""),
            (of(1, 2).replace("\"c2\"", "\"c2\", \"c3\""), "is not two names"),
            (of(1, 2) + &of(2, 3) + &of(3, 1), "are already connected"),
            (of(1, 2) + "swing = 1\n", "needs the axis along the core"),
            (of(1, 2) + "axis = [0, 0, 0]\ntwist = 1\n", "needs the axis along the core"),
            (of(1, 2) + "axis = [1, 0, 0]\ntwist = 3.2\n", "is 3.2"),
            (of(1, 2) + "stiffness = -1\n", "stiffness"),
            (of(1, 2) + "stifness = 1\n", "did you mean `stiffness`"),
            (of(1, 2).replace("point", "points"), "did you mean `point`"),
        ] {
            let error = with(&text).unwrap_err().to_string();
            assert!(error.contains(problem) && error.contains("scene.toml:"), "tables {text} give the error: {error}");
        }
        // A loop is allowed if one of its cores is not dynamic.
        assert_eq!(with(&(of(1, 2) + &of(0, 1) + &of(0, 2))).unwrap().len(), 3);
    }

    #[test]
    fn bones_are_joined_to_their_parents_where_one_of_the_two_moves() {
        let joints = |body: &str| {
            let file = concat!(env!("CARGO_MANIFEST_DIR"), "/assets/human-skeleton.toml");
            let text = CORES.to_owned() + &format!("skeleton = {file:?}\n{body}");
            scene(&text).map(|scene| scene.bodies[0].clone())
        };
        assert_eq!(joints("").unwrap().joints, []);
        let body = joints("bones = \"dynamic\"\n[[body.core]]\nname = \"pelvis\"\n").unwrap();
        assert_eq!(body.joints.len(), body.cores.len() - 1);
        let (forearm, core) =
            (body.cores.iter().position(|core| core.name == "left_forearm").unwrap(), |name: &str| {
                body.cores.iter().position(|core| core.name == name).unwrap()
            });
        let joint = body.joints.iter().find(|joint| joint.cores[1] == forearm).unwrap();
        assert_eq!((joint.cores[0], joint.point), (core("left_upper_arm"), DVec3::new(0.445, 1.395, -0.012)));
        assert!(joint.resistance.axis == DVec3::X && joint.resistance.swing.is_some());
        // First only one bone is dynamic. Then the body's own joint replaces the skeleton's joint, though it names the
        // cores in the opposite order.
        let arm = "[[body.core]]\nname = \"left_forearm\"\nmotion = \"dynamic\"\n";
        let own = "[[body.joint]]\ncores = [\"left_forearm\", \"left_upper_arm\"]\npoint = [0.4, 1.4, 0]\n";
        assert_eq!(joints(arm).unwrap().joints.len(), 2);
        let body = joints(&(arm.to_owned() + own)).unwrap();
        assert_eq!((body.joints.len(), body.joints[0].point), (2, DVec3::new(0.4, 1.4, 0.0)));
        let loops = "[[body.joint]]\ncores = [\"left_hand\", \"head\"]\npoint = [0, 0, 0]\n";
        let error = joints(&format!("bones = \"dynamic\"\n{loops}")).unwrap_err().to_string();
        assert!(error.contains("bone \"") && error.contains("also connected"), "unexpected error: {error}");
        assert!(
            scene(&(CORES.to_owned() + "bones = \"dynamic\"\n")).unwrap_err().to_string().contains("has no `skeleton`")
        );
    }
}
