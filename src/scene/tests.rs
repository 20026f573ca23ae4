//! Tests of scene files: how each table is read, and the message for each mistake. A core is a rigid body inside a soft
//! body, to which nodes of the soft body's layer (its tetrahedral mesh) are attached; a rigid body counts as one core.
//! A bone is a core from a skeleton file.

use std::fs;

use glam::{DQuat, DVec3};
use tempfile::TempDir;

use super::*;
use crate::Result;

/// An example of a scene file, with the tables that docs/reference/scene.md lists.
const EXAMPLE: &str = r#"[step]
dt = 0.001                      # s
gravity = [0.0, -9.81, 0.0]     # m/s^2
newton = 1

[solver]
tolerance = 1e-5                # relative residual
max_iterations = 200
preconditioner = "auto"         # "jacobi", "coarse"

[contact]
stiffness = "auto"              # or N/m^3
damping = "auto"                # or N s/m^3
friction = 0.0
friction_speed = 0.001          # m/s, below it friction is viscous
texel = "auto"                  # or m
depth_limit = 0.02              # m

[[body]]
name = "head"
surface = "head.obj"            # the skin; without it, the layer's boundary
layer = { cell = 0.01 }
scale = 1.0
position = [0.0, 0.0, 0.0]
orientation = [0.0, 0.0, 0.0, 1.0]
velocity = [0.0, 0.0, 0.0]
material = { young = 2e4, poisson = 0.45, density = 1000.0, damping_mass = 0.0, damping_stiffness = 0.0 }
collides = ["tool"]             # default: every other body; never itself

[[body.core]]
name = "skull"
motion = "fixed"                # "driven", "dynamic"
bind = { inset = 0.03 }

[[body]]
name = "floor"
plane = [0.0, 2.0, 0.0, 1.0]    # n, d: n.x = d

[tool]
sphere = 0.01
mass = 0.05                     # kg
position = [0.0, 0.2, 0.15]

[coupling]
stiffness = 500.0               # N/m
damping = 2.0                   # N s/m
angular_stiffness = 0.5         # N m/rad
angular_damping = 0.002         # N m s/rad

[drive]                         # device pose, world
keys = [[0.0, 0.0, 0.2, 0.15], [0.3, 0.0, 0.2, 0.10]]

[haptics]
device = "scripted"
rate = 1000                     # Hz
max_force = 8.0

[[probe]]
name = "nose"
body = "head"
nearest = [0.0, 0.05, 0.1]
"#;

/// A skeleton file with two bones.
const BONES: &str = r#"[[bone]]
name = "upper"
joint = [0, 0, 0]
ends = [[0, 0, 0], [1, 0, 0]]
radius = 0.1
[[bone]]
name = "fore"
parent = "upper"
joint = [1, 0, 0]
ends = [[1, 0, 0], [2, 0, 0]]
radii = [0.1, 0.2]
"#;

/// A temporary folder with the files that the scenes of these tests name.
struct Folder(TempDir);

impl Folder {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        for name in ["head.obj", "head.msh", "head.vtk", "head.xdmf", "head.node"] {
            fs::write(folder.path().join(name), "").unwrap();
        }
        fs::write(folder.path().join("bones.toml"), BONES).unwrap();
        Folder(folder)
    }

    fn load(&self, text: &str) -> Result<Scene> {
        let file = self.0.path().join("press.toml");
        fs::write(&file, text).unwrap();
        Scene::load(&file)
    }

    fn message(&self, text: &str) -> String {
        self.load(text).expect_err(text).to_string()
    }
}

/// The example with `old` replaced once by `new`; panics if the example does not contain `old`.
fn with(old: &str, new: &str) -> String {
    assert!(EXAMPLE.contains(old), "the example must contain `{old}`");
    EXAMPLE.replacen(old, new, 1)
}

#[test]
fn the_example_is_read_in_full() {
    let scene = Folder::new().load(EXAMPLE).unwrap();
    assert_eq!((scene.name().as_str(), scene.duration()), ("press", 0.3));
    assert_eq!((scene.step.dt, scene.step.gravity, scene.step.newton), (0.001, DVec3::new(0.0, -9.81, 0.0), 1));
    assert_eq!((scene.solver.tolerance, scene.solver.max_iterations), (Some(1e-5), 200));
    assert_eq!((scene.contact.stiffness, scene.contact.texel, scene.contact.depth_limit), (None, None, 0.02));
    let head = &scene.bodies[0];
    let Shape::Soft { surface: Some(Surface::File(path)), layer: Layer::Cell { cell, grade: 1, thickness: None } } =
        &head.shape
    else {
        panic!("unexpected shape: {:?}", head.shape)
    };
    assert!(path.ends_with("head.obj") && *cell == 0.01);
    assert_eq!(head.material.unwrap().young, 2e4);
    assert_eq!(head.collides.as_deref(), Some(&["tool".to_string()][..]));
    assert!(matches!((&head.cores[0].motion, &head.cores[0].bind), (Motion::Fixed, Some(Bind::Inset(0.03)))));
    let Shape::Plane { normal, offset } = scene.bodies[1].shape else { panic!("the floor must be a plane") };
    assert_eq!((normal, offset), (DVec3::Y, 0.5), "normal and offset must be divided by the normal's length");
    let tool = scene.tool.unwrap();
    assert!(matches!(tool.shape, ToolShape::Sphere(0.01)));
    assert_eq!((tool.mass, tool.scale, tool.orientation), (0.05, 1.0, DQuat::IDENTITY));
    assert_eq!(scene.coupling.unwrap().angular_damping, 0.002);
    assert_eq!((scene.trajectory.len(), scene.trajectory[1].position.z, scene.trajectory[1].time), (2, 0.1, 0.3));
    assert_eq!((scene.haptics.rate, scene.haptics.limits.force), (1000.0, Some(8.0)));
    assert_eq!((scene.probes[0].body.as_str(), scene.probes[0].nearest.z), ("head", 0.1));
}

#[test]
fn other_ways_to_say_it() {
    let folder = Folder::new();
    let soft = |line: &str| folder.load(&with("layer = { cell = 0.01 }", line)).unwrap().bodies[0].shape.clone();
    for file in ["head.msh", "head.vtk", "head.node"] {
        assert!(matches!(soft(&format!("layer = \"{file}\"")), Shape::Soft { layer: Layer::File(_), .. }));
    }
    let shell = soft("layer = { cell = 0.01, grade = 4, thickness = 0.05 }");
    let Shape::Soft { layer: Layer::Cell { grade: 4, thickness: Some(0.05), .. }, .. } = shell else {
        panic!("unexpected shape: {shell:?}")
    };
    let across = soft("layer = { across = 40, grade = 2 }\nhulls = 7");
    assert!(matches!(across, Shape::Soft { layer: Layer::Across { cells: 40, grade: 2, thickness: None }, .. }));
    let error = folder.load(&with("layer = { cell = 0.01 }", "layer = { cell = 0.01, grade = 3 }")).unwrap_err();
    assert!(
        error.to_string().contains("grade") && error.to_string().contains("1, 2, 4 or 8"),
        "unexpected error: {error}"
    );
    let cube = "layer = { box = [[0, 0, 0], [1.0, 1, 1]], cells = [12, 12, 3] }";
    assert!(matches!(soft(cube), Shape::Soft { layer: Layer::Box { cells: [12, 12, 3], high: DVec3::ONE, .. }, .. }));
    let model = with("\"head.obj\"  ", "{ model = \"head\", vertices = 44000 }");
    let Shape::Soft { surface, .. } = &folder.load(&model).unwrap().bodies[0].shape else {
        panic!("the body \"head\" must be soft")
    };
    assert_eq!(*surface, Some(Surface::Model { model: Model::Head, vertices: 44_000 }));

    let bind = |text: &str| {
        let scene = folder.load(&with("{ inset = 0.03 }", text)).unwrap();
        scene.bodies[0].cores[0].bind.clone().unwrap()
    };
    assert!(matches!(bind("{ sphere = [0, 1, 0, 2] }"), Bind::Sphere { centre: DVec3::Y, radius: 2.0 }));
    assert!(matches!(bind("{ box = [[0, 0, 0], [1, 1, 1]] }"), Bind::Box { .. }));
    assert!(matches!(bind("{ nodes = [3, 0] }"), Bind::Nodes(nodes) if nodes == [3, 0]));
    assert!(matches!(bind("{ all = true }"), Bind::All));

    let rigid = "[[body]]\nname = \"die\"\nsurface = \"head.obj\"\n";
    let scene = folder.load(rigid).unwrap();
    assert!(matches!(scene.bodies[0].cores[..], [Core { motion: Motion::Fixed, bind: None, .. }]));
    assert!(scene.tool.is_none() && scene.coupling.is_none() && scene.duration() == 1.0);
    assert!(folder.message("").contains("neither a body nor a tool"));
    assert!(folder.load("[tool]\nsurface = \"head.obj\"\nmass = 1\nscale = 0.5").unwrap().coupling.is_none());
}

#[test]
fn drives_come_from_keys_or_from_a_file() {
    let folder = Folder::new();
    let tool = "[tool]\nsphere = 1\nmass = 1\n[drive]\n";
    let turned =
        folder.load(&format!("{tool}keys = [[0, 0, 0, 0, 0, 0, 0.6, 0.8004]]")).unwrap().trajectory[0].orientation;
    assert!(
        (turned.length() - 1.0).abs() < 1e-15 && (turned.z - 0.6).abs() < 1e-3,
        "the quaternion must be normalised"
    );
    let file = |text: &str| {
        fs::write(folder.0.path().join("press.csv"), text).unwrap();
        folder.load(&format!("{tool}path = \"press.csv\""))
    };
    let keys = file("t,x,y,z,qx,qy,qz,qw\n0,1,2,3,0,0,0,1\n\n0.5, 4,5,6,1,0,0,0\n").unwrap().trajectory;
    assert_eq!(
        keys[1],
        Key { time: 0.5, position: DVec3::new(4.0, 5.0, 6.0), orientation: DQuat::from_xyzw(1., 0., 0., 0.) }
    );
    for same in ["\u{feff}0,1,2,3\r\n# a remark\r\n\"0.5\" , 4,5,6\r\n", "# a remark\nt,x,y,z\n0,1,2,3\n0.5,4,5,6"] {
        let read = file(same).unwrap().trajectory;
        assert_eq!(
            read.iter().map(|key| key.position).collect::<Vec<_>>(),
            [keys[0].position, keys[1].position],
            "positions of the keys in the file `{same}`"
        );
    }
    for (text, words) in [
        ("0,0,0,0\n0,0,0,0\n", "press.csv:2: time 0.0 does not come after 0"),
        ("t,x,y,z\n0,0,nan,0\n", "press.csv:2: contains NaN"),
        ("0,0,0,0,0,0,0,2\n", "press.csv:1: quaternion has length 2.0000e0"),
        ("0,0,0\n", "press.csv:1: has 3 numbers"),
        ("0,0,zero,0\n", "press.csv:1: \"zero\" is not a number"),
        ("0,0,1e300,0\n", "press.csv:1: contains 1e300"),
        ("O.0,0,0,0\n1,0,0,0\n", "press.csv:1: \"O.0\" is not a number"),
        ("t,x,y,z\n", "press.csv: contains no keys"),
    ] {
        let message = file(text).unwrap_err().to_string();
        assert!(message.contains(words), "the file `{text}` gives the error: {message}");
    }
}

#[test]
fn unknown_keys_are_answered_with_the_nearest() {
    let folder = Folder::new();
    for (old, new, place, nearest) in [
        ("dt = 0.001", "dtt = 0.001", ":2: unknown key `step.dtt`", "`dt`"),
        ("[solver]", "[solvr]", ":6: unknown key `solvr`", "`solver`"),
        ("material = { young", "material = { yuong", ":27: unknown key `body.head.material.yuong`", "`young`"),
        ("bind = {", "binds = {", ":33: unknown key `body.head.core.skull.binds`", "`bind`"),
        ("nearest =", "nearst =", "unknown key `probe[0].nearst`", "`nearest`"),
    ] {
        let message = folder.message(&with(old, new));
        // As long as the keys of an element of an array of tables have not been checked, errors refer to the element by
        // its index, not by its name.
        let place = place.replace("body.head.core.skull", "body.head.core[0]");
        assert!(message.contains(&place), "unexpected error: {message}");
        assert!(message.contains(&format!("did you mean {nearest}?")), "unexpected error: {message}");
    }
}

#[test]
fn values_out_of_range_are_refused_by_key_and_line() {
    let folder = Folder::new();
    for (old, new, words) in [
        ("dt = 0.001", "dt = nan", "press.toml:2: `step.dt`: is NaN"),
        ("dt = 0.001", "dt = -1", "press.toml:2: `step.dt`: is -1"),
        ("dt = 0.001", "dt = \"1\"", "press.toml:2: `step.dt`: is of type string"),
        ("newton = 1", "newton = 0", "`step.newton`: is 0; give a whole number from 1 to 100"),
        ("newton = 1", "newton = 101", "`step.newton`: is 101"),
        ("gravity = [0.0, ", "gravity = [inf, ", "`step.gravity[0]`: is inf"),
        ("gravity = [0.0, ", "gravity = [", "`step.gravity`: has 2 elements"),
        ("young = 2e4", "young = 0", "press.toml:27: `body.head.material.young`: is 0"),
        ("young = 2e4", "young = 1e39", "`body.head.material.young`: is 1"),
        ("poisson = 0.45", "poisson = 0.5", "`body.head.material.poisson`: is 0.5"),
        ("density = 1000.0", "density = -1.0", "`body.head.material.density`: is -1"),
        ("density = 1000.0, ", "", "`body.head.material.density`: missing"),
        ("tolerance = 1e-5", "tolerance = 0", "`solver.tolerance`: is 0"),
        ("tolerance = 1e-5", "tolerance = 2", "`solver.tolerance`: is 2"),
        ("max_iterations = 200", "max_iterations = 0", "`solver.max_iterations`: is 0"),
        ("stiffness = \"auto\"", "stiffness = \"hard\"", "`contact.stiffness`: is \"hard\""),
        ("depth_limit = 0.02", "depth = \"grafics\"", "`contact.depth`: there is no path \"grafics\"; did you mean"),
        (
            "depth_limit = 0.02",
            "sides = \"bothh\"",
            "`contact.sides`: there is no choice of sides \"bothh\"; did you mean \"both\"?",
        ),
        ("mass = 0.05", "mass = 0", "`tool.mass`: is 0"),
        ("damping = 2.0", "damping = -2.0", "`coupling.damping`: is -2"),
        ("scale = 1.0", "scale = 0.0", "`body.head.scale`: is 0"),
        ("orientation = [0.0, 0.0, 0.0, 1.0]", "orientation = [0, 0, 0, 2]", "quaternion has length 2"),
        ("{ cell = 0.01 }", "{ cell = 0 }", "`body.head.layer.cell`: is 0"),
        ("{ cell = 0.01 }", "{ box = [[0, 0, 0], [1, 0, 1]], cells = [1, 1, 1] }", "is not below"),
        ("{ cell = 0.01 }", "{ box = [[0, 0, 0], [1, 1, 1]], cells = [1, 0, 1] }", "`body.head.layer.cells[1]`: is 0"),
        ("{ cell = 0.01 }", "{ box = [[0, 0, 0], [1, 1, 1]], cells = [9999, 9999, 9999] }", "too many tetrahedra"),
        ("{ cell = 0.01 }", "{ cell = 1, box = [[0, 0, 0], [1, 1, 1]] }", "given together with `cell`"),
        ("plane = [0.0, 2.0,", "plane = [0.0, 0.0,", "`body.floor.plane`: the normal is zero"),
        ("[0.3, 0.0, 0.2, 0.10]", "[0.0, 0.0, 0.2, 0.10]", "`drive.keys[1]`: time 0.0 does not come after 0.0"),
        ("[0.3, 0.0, 0.2, 0.10]", "[0.3, 0.0, 0.2]", "`drive.keys[1]`: has 3 numbers"),
        ("{ inset = 0.03 }", "{ sphere = [0, 0, 0, 0] }", "has radius 0"),
        ("[tool]", "[tool", "not TOML"),
        ("scale = 1.0", "dilatation = \"nodal\"", "`body.head.dilatation`: there is no dilatation \"nodal\""),
    ] {
        let message = folder.message(&with(old, new));
        assert!(message.contains(words), "the text `{new}` gives the error: {message}");
        assert!(!message.contains('\n'), "the message must be one line: {message}");
    }
}

#[test]
fn what_does_not_fit_together_is_refused() {
    let folder = Folder::new();
    for (old, new, words) in [
        ("surface = \"head.obj\"", "surface = \"nose.obj\"", "`body.head.surface`: there is no file"),
        ("{ cell = 0.01 }", "\"head.xdmf\"", "files of type .xdmf"),
        ("name = \"floor\"", "name = \"head\"", "\"head\" is taken"),
        ("name = \"floor\"", "name = \"tool\"", "\"tool\" is taken"),
        ("name = \"floor\"", "name = \"../floor\"", "cannot be a name"),
        ("collides = [\"tool\"]", "collides = [\"tol\"]", "there is no body \"tol\""),
        ("collides = [\"tool\"]", "collides = [\"head\"]", "names the body itself"),
        ("body = \"head\"", "body = \"hed\"", "there is no body \"hed\""),
        ("body = \"head\"", "body = \"floor\"", "is a plane"),
        ("name = \"nose\"", "name = \"tool\"", "a column of the trace"),
        ("material = {", "#", "`body.head.material`: missing"),
        ("layer = {", "#", "a rigid body has none"),
        ("surface = \"head.obj\"", "#", "made around a `surface`"),
        ("name = \"floor\"", "name = \"floor\"\nscale = 2.0", "`body.floor.scale`: has no meaning for a plane"),
        ("sphere = 0.01", "sphere = 0.01\nsurface = \"head.obj\"", "`tool.surface`: given together with `sphere`"),
        ("sphere = 0.01", "", "`tool.sphere`: missing"),
        ("[tool]\nsphere = 0.01\nmass = 0.05                     # kg\nposition = [0.0, 0.2, 0.15]\n", "", "no [tool]"),
        ("motion = \"fixed\"", "motion = \"driven\"", "`body.head.core.skull.keys`: missing"),
    ] {
        let message = folder.message(&with(old, new));
        assert!(message.contains(words), "the text `{new}` gives the error: {message}");
    }
}

#[test]
fn models_have_defaults_and_ranges() {
    let folder = Folder::new();
    let surface = |table: &str| {
        let scene = folder.load(&with("\"head.obj\"  ", table))?;
        let Shape::Soft { surface: Some(surface), .. } = &scene.bodies[0].shape else {
            panic!("the body \"head\" must be soft and have a surface")
        };
        Ok::<_, crate::Error>(surface.clone())
    };
    for (name, model, vertices) in [
        ("head", Model::Head, 44_000),
        ("pumpkin", Model::Pumpkin, 30_000),
        ("gear", Model::Gear, 29_000),
        ("human", Model::Human, 13_000),
    ] {
        assert_eq!(surface(&format!("{{ model = {name:?} }}")).unwrap(), Surface::Model { model, vertices });
        let asked = surface(&format!("{{ model = {name:?}, vertices = 5000 }}")).unwrap();
        assert_eq!(asked, Surface::Model { model, vertices: 5000 });
        let (least, most) = model.vertices().into_inner();
        let few = surface(&format!("{{ model = {name:?}, vertices = {} }}", least - 1)).unwrap_err().to_string();
        let words =
            format!("`body.head.surface.vertices`: is {}; give a whole number from {least} to {most}", least - 1);
        assert!(few.contains(&words), "unexpected error: {few}");
    }
    let message = surface("{ model = \"pumkin\" }").unwrap_err().to_string();
    assert!(message.contains("`body.head.surface.model`: there is no model \"pumkin\""), "unexpected error: {message}");
    assert!(
        message.contains("did you mean \"pumpkin\"? known: head, pumpkin, gear, human"),
        "unexpected error: {message}"
    );
}

#[test]
fn a_hinge_belongs_to_a_dynamic_core_and_has_an_axis() {
    let folder = Folder::new();
    let core = |motion: &str| with("motion = \"fixed\"                # \"driven\", \"dynamic\"", motion);
    let hinge = |table: &str| core(&format!("motion = \"dynamic\"\nhinge = {table}"));
    let read =
        folder.load(&hinge("{ point = [1, 2, 3], axis = [0, 0, -2] }")).unwrap().bodies[0].cores[0].hinge.unwrap();
    assert_eq!((read.point, read.axis), (DVec3::new(1.0, 2.0, 3.0), -DVec3::Z));
    let key = "`body.head.core.skull.hinge";
    for (said, words) in [
        (hinge("{ point = [0, 0, 0], axis = [0, 0, 0] }"), ".axis`: is zero; give the direction"),
        (hinge("{ point = [0, 0, 0] }"), ".axis`: missing"),
        (hinge("{ axis = [0, 0, 1] }"), ".point`: missing"),
        (core("hinge = { point = [0, 0, 0], axis = [0, 0, 1] }"), "`: belongs to motion = \"dynamic\"; remove it"),
    ] {
        let message = folder.message(&said);
        assert!(message.contains(&format!("{key}{words}")), "unexpected error: {message}");
    }
}

#[test]
fn a_skeleton_gives_a_core_a_bone() {
    let folder = Folder::new();
    let cores = "[[body.core]]\nname = \"skull\"\nmotion = \"fixed\"                # \"driven\", \"dynamic\"\n\
                 bind = { inset = 0.03 }\n";
    let text = |cores_text: &str| with(cores, &format!("skeleton = \"bones.toml\"\n{cores_text}"));
    let core = |text_of_core: &str| text(&format!("[[body.core]]\n{text_of_core}\n"));
    fs::write(folder.0.path().join("keys.csv"), "0,0,0,0\n").unwrap();
    for (said, words) in [
        ("name = \"fore\"\nbind = { all = true }", "`body.head.core.fore.bind`: the core is a bone"),
        ("name = \"four\"", "`body.head.core.four.name`: \"four\" is not a bone"),
        ("name = \"four\"", "did you mean \"fore\"? known: upper, fore, or add `bind`"),
        ("name = \"fore\"\n[[body.core]]\nname = \"fore\"", "\"fore\" is taken by another core"),
        ("name = \"fore\"\nmotion = \"driven\"", "`body.head.core.fore.keys`: missing"),
    ] {
        let message = folder.message(&core(said));
        assert!(message.contains(words), "the core `{said}` gives the error: {message}");
    }
    // The cores of bones come first, in the skeleton's order; a table `[[body.core]]` with the name of a bone sets how
    // that bone moves.
    let said = "name = \"ball\"\nbind = { all = true }\n[[body.core]]\nname = \"fore\"\nmotion = \"driven\"\n\
                keys = \"keys.csv\"";
    let body = folder.load(&core(said)).unwrap().bodies[0].clone();
    let [upper, fore, ball] = &body.cores[..] else { panic!("unexpected cores: {:?}", body.cores) };
    assert_eq!([&upper.name, &fore.name, &ball.name], ["upper", "fore", "ball"]);
    assert!(matches!((&upper.motion, &upper.bind), (Motion::Fixed, Some(Bind::Capsule(c))) if c.radii == [0.1; 2]));
    assert!(matches!((&fore.motion, &fore.bind), (Motion::Kinematic(_), Some(Bind::Capsule(c))) if c.ends[1].x == 2.0));
    assert!(matches!(ball.bind, Some(Bind::All)));
    let mass = |said: &str| folder.load(&core(said)).unwrap().bodies[0].cores[1].mass;
    assert_eq!(mass("name = \"fore\"\nmotion = \"dynamic\"\nmass = 2"), Some(2.0));
    let idle = folder.message(&core("name = \"fore\"\nmass = 2"));
    assert!(idle.contains("`body.head.core.fore.mass`: belongs to motion"), "unexpected error: {idle}");
    assert_eq!(body.skeleton.unwrap().bones[1].parent, Some(0));
    assert_eq!(folder.load(&text("")).unwrap().bodies[0].cores.len(), 2);

    let rigid = |more| folder.message(&format!("[[body]]\nname = \"a\"\nsurface = \"head.obj\"\n{more}"));
    assert!(rigid("skeleton = \"bones.toml\"").contains("`body.a.skeleton`: a rigid body has no"));
    assert!(rigid("dilatation = \"patch\"").contains("`body.a.dilatation`: belongs to a soft body"));
}

#[test]
fn haptics_are_read_and_what_no_device_has_is_refused() {
    let folder = Folder::new();
    let haptics = |line: &str| with("device = \"scripted\"", line);
    let read = folder.load(&haptics("device = \"hand\"\nprofile = \"touch\"\nlocal_model = false")).unwrap().haptics;
    assert_eq!((read.device, read.profile.unwrap().name), (DeviceKind::Hand, "touch"));
    assert!(!read.local_model && read.passivity);
    for (line, message) in [
        ("device = \"phantom\"", "`haptics.device`"),
        ("profile = \"omni\"", "`haptics.profile`"),
        ("haply = { address = \"ws://localhost:1\" }", "`haptics.haply`: belongs to device = \"haply\""),
        ("unit = \"1\"", "`haptics.unit`: belongs to device = \"touch\" or \"force-dimension\" or \"space-mouse\" or"),
        (
            "device = \"space-mouse\"\nprofile = \"touch\"",
            "`haptics.profile`: does not apply to a device that plays no force",
        ),
        ("device = \"touch\"\nunit = 1", "`haptics.unit`"),
        ("device = \"touch\"\nunit = \"\"", "`haptics.unit`: is no name of a device"),
        ("device = \"force-dimension\"\nunit = \"left\"", "`haptics.unit`: is no serial number"),
        ("device = \"openxr\"\nunit = \"both\"", "`haptics.unit`: is no hand; give \"left\" or \"right\""),
        ("device = \"openxr\"\nprofile = \"mouse\"", "`haptics.profile`: does not apply"),
        ("device = \"hand\"\nhand = { mass = 100 }", "`haptics.hand`: the hand's mass is 100 kg"),
        ("device = \"hand\"\nhand = { weight = 1 }", "`haptics.hand.weight`"),
        ("max_torque = -1", "`haptics.max_torque`"),
        ("device = \"haply\"\nprofile = \"touch\"", "`haptics.profile`: is not that of a Haply"),
    ] {
        let said = folder.message(&haptics(line));
        assert!(said.contains(message), "the line `{line}` gives the error: {said}");
    }
    let fast = folder.message(&with("rate = 1000 ", "rate = 9000 "));
    assert!(fast.contains("`haptics.rate`: is 9000.0; give 50.0 to 4000.0 Hz"), "unexpected error: {fast}");
}

#[test]
fn a_held_body_has_a_dynamic_core_and_no_keys_of_its_own() {
    let folder = Folder::new();
    let held = |body: &str, tool: &str| {
        format!("[[body]]\nname = \"a\"\nsurface = \"head.obj\"\n{body}\n[tool]\nbody = \"a\"\n{tool}")
    };
    let dynamic = "motion = \"dynamic\"\nmass = 0.1";
    let scene = folder.load(&held(dynamic, "")).unwrap();
    assert!(scene.tool_body_index() == Some(0) && scene.rigid_tool().is_none());
    let message = |body: &str, tool: &str| folder.message(&held(body, tool));
    assert!(message("", "").contains("`tool.body`: the first core of \"a\""));
    assert!(message(dynamic, "sphere = 0.1").contains("given together with"));
    for key in ["mass = 1.0", "position = [0.0, 0.0, 0.0]", "velocity = [0.0, 0.0, 0.0]", "scale = 2.0"] {
        let name = key.split(' ').next().unwrap();
        assert!(
            message(dynamic, key).contains(&format!("`tool.{name}`: has no meaning together with `body`")),
            "the error does not refuse `{key}` together with `body`"
        );
    }
    let other = "[[body]]\nname = \"b\"\nsurface = \"head.obj\"\ncollides = [\"tool\"]";
    assert!(message(dynamic, other).contains("give that body's name"));
    assert!(message(&format!("{dynamic}\ncollides = [\"a\"]"), "").contains("names the body itself"));
}

#[test]
fn several_tools_are_bodies_with_couplings_and_trajectories_of_their_own() {
    let folder = Folder::new();
    let body =
        |name: &str| format!("[[body]]\nname = \"{name}\"\nsurface = \"head.obj\"\nmotion = \"dynamic\"\nmass = 0.1\n");
    let bodies = ["a", "b", "c", "d", "e"].map(body).concat();
    let tool = |name: &str, body: &str, more: &str| format!("[[tool]]\nname = \"{name}\"\nbody = \"{body}\"\n{more}\n");
    let led = "coupling = { stiffness = 500, damping = 5 }\ndrive = { keys = [[0, 0, 0, 0], [0.7, 0, 0, 1]] }";
    let both = bodies.clone() + &tool("left", "b", led) + &tool("right", "a", "");
    let scene = folder.load(&both).unwrap();
    let [right] = &scene.further_tools[..] else { panic!("{} tools after the first", scene.further_tools.len()) };
    assert_eq!((scene.tool.as_ref().unwrap().name.as_str(), scene.tool_body_index()), ("left", Some(1)));
    assert_eq!((right.name.as_str(), right.body.as_str(), right.coupling), ("right", "a", None));
    assert_eq!((scene.coupling.unwrap().stiffness, scene.trajectory.len(), scene.duration()), (500.0, 2, 0.7));
    let swapped = folder.load(&(bodies.clone() + &tool("right", "a", "") + &tool("left", "b", led))).unwrap();
    assert!(swapped.coupling.is_none() && swapped.further_tools[0].coupling.unwrap().damping == 5.0);
    assert_eq!(swapped.duration(), 0.7);
    // A device of a tool after the first makes the scene a session, of which the tools before have the default device.
    assert_eq!((scene.haptics.has_device, scene.held_tools()), (false, 1));
    let hand = "haptics = { device = \"hand\", rate = 500 }";
    let scene = folder.load(&(both.clone() + &tool("last", "c", hand))).unwrap();
    assert_eq!((scene.haptics.has_device, scene.haptics.device, scene.held_tools()), (true, DeviceKind::Scripted, 3));
    let rates: Vec<f64> = (0..3).map(|index| scene.leader(index).unwrap().haptics.rate).collect();
    assert_eq!((rates, scene.leader(3)), (vec![1000.0, 1000.0, 500.0], None));
    let quick = hand.replace("rate = 500", "longest_step = 0.005");
    assert_eq!(
        [scene.longest_step(), folder.load(&(both.clone() + &tool("last", "c", &quick))).unwrap().longest_step()],
        [0.02, 0.005]
    );
    let own = folder.load(&(bodies.clone() + &tool("left", "b", hand) + &tool("right", "a", ""))).unwrap();
    assert_eq!((own.haptics.has_device, own.haptics.rate, own.held_tools()), (true, 500.0, 1));
    // A single tool takes the place of several.
    let mut builder = SceneBuilder::of(scene);
    builder.toml("[tool]\nsphere = 0.01\nmass = 0.1").unwrap();
    assert!(builder.scene().further_tools.is_empty() && !builder.scene().haptics.has_device);
    let left = tool("left", "b", "");
    for (text, words) in [
        (tool("left", "b", "") + &tool("left", "a", ""), "`tool.left.name`: \"left\" is taken by another tool"),
        (left.clone() + &tool("right", "b", ""), "`tool[1].body`: \"b\" is another tool already"),
        (left.clone() + &tool("right", "f", ""), "`tool[1].body`: there is no body \"f\""),
        (left.clone() + &tool("right", "a", "sphere = 0.1"), "unknown key `tool[1].sphere`"),
        (left.clone() + "[[tool]]\nbody = \"a\"", "`tool[1].name`: missing"),
        (left.clone() + &tool("right", "a", "coupling = { stiffness = 1 }"), "`tool.right.coupling.damping`: missing"),
        (left.clone() + "[coupling]\nstiffness = 1\ndamping = 1", "`coupling`: has no meaning beside [[tool]]"),
        (left.clone() + "[drive]\nkeys = [[0, 0, 0, 0]]", "`drive`: has no meaning beside [[tool]]"),
        (left.clone() + &tool("right", "a", "haptics = { rate = 1 }"), "`tool.right.haptics.rate`: is 1.0"),
        (tool("left", "b", "haptics = {}") + "[haptics]\nrate = 500", "`tool.left.haptics`: stands twice"),
        (["a", "b", "c", "d", "e"].map(|name| tool(name, name, "")).concat(), "`tool`: has 5 tools; give 1 to 4"),
    ] {
        let message = folder.message(&(bodies.clone() + &text));
        assert!(message.contains(words), "the tools\n{text}\ngive the error: {message}");
    }
    let message = folder.message(&format!("tool = []\n{bodies}"));
    assert!(message.contains("`tool`: has 0 tools; give 1 to 4"), "{message}");
    let message = folder.message(&(bodies.replacen("motion = \"dynamic\"\nmass = 0.1", "", 1) + &both[bodies.len()..]));
    assert!(message.contains("`tool[1].body`: the first core of \"a\""), "{message}");
}

#[test]
fn a_preset_decides_what_the_file_leaves_open() {
    let body = "[[body]]\nname = \"floor\"\nplane = [0.0, 1.0, 0.0, 0.0]\n";
    let of = |text: &str| Scene::parse(std::path::Path::new("s.toml"), &format!("{text}\n{body}"));
    let none = of("").unwrap();
    assert_eq!((none.solver.tolerance, none.solver.max_iterations, none.step.newton), (None, 200, 1));
    assert_eq!((none.contact.sides, none.preset), (Sides::Both, None));
    let fast = of("preset = \"fast\"\n[contact]\nsides = \"both\"\n[step]\ndt = 0.002").unwrap();
    assert_eq!((fast.solver.tolerance, fast.contact.sides, fast.step.dt), (Some(1e-2), Sides::Both, 0.002));
    let chosen = fast.preset.unwrap();
    let keys: Vec<&str> = chosen.set.iter().map(|(key, _)| *key).collect();
    assert_eq!((chosen.preset, keys), ("fast", vec!["solver.tolerance", "solver.max_iterations", "step.newton"]));
    let accurate = of("preset = \"accurate\"").unwrap();
    assert_eq!((accurate.solver.tolerance, accurate.step.dt), (Some(1e-2), 1e-3));
    assert_eq!(of("preset = \"fast\"").unwrap().step.dt, 8e-3);
    let message = of("preset = \"fats\"").unwrap_err().to_string();
    assert!(
        message.contains("s.toml:1: `preset`: there is no preset \"fats\"; did you mean \"fast\"?"),
        "unexpected error: {message}"
    );
}
