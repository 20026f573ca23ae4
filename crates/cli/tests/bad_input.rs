//! Tests of bad input through the built program: it ends with status 2, prints one line on standard error that names
//! the mistake, its place and the remedy, does not panic, and leaves nothing in the output directory. Input is refused
//! before a Vulkan device is opened. A body's *skin* is its surface mesh, its *layer* the tetrahedral mesh in which the
//! skin is embedded, its collision *proxies* are convex hulls of parts of the skin. The ignored tests
//! read *real meshes*, a folder of mesh files that is not part of the repository.

#[path = "../../../tests/real_meshes/mod.rs"]
mod real_meshes;

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use palpate::Scene;
use palpate::internal::prepare::{self, repair};
use palpate::scene::gmsh;
use tempfile::TempDir;

use real_meshes::meshes;

/// A unit cube as an OBJ file: closed, and with faces that are counter-clockwise seen from outside.
const CUBE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\nf 4 3 2 1\nf 5 6 7 8\n\
                    f 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";
const MATERIAL: &str = "material = { young = 2e4, poisson = 0.4, density = 1000.0 }";

/// Runs `palpate` with these arguments.
fn palpate(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_palpate")).args(arguments).output().unwrap()
}

/// Runs a scene with `--out`, checks that it is cleanly refused, and returns the message.
fn refusal(folder: &Path, scene: &str) -> String {
    let (file, out) = (folder.join("scene.toml"), folder.join("made/out"));
    fs::write(&file, scene).unwrap();
    let output = palpate(&["run", file.to_str().unwrap(), "--steps", "1", "--out", out.to_str().unwrap()]);
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "exit status of the scene\n{scene}\nwith the error: {message}");
    assert_eq!(message.lines().count(), 1, "wrong error: {message}");
    assert!(message.starts_with("error: ") && !message.contains("panicked"), "wrong error: {message}");
    assert!(output.stdout.is_empty(), "standard output must be empty");
    assert!(!folder.join("made").exists(), "the output directory must not be made");
    message
}

fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("cube.obj"), CUBE).unwrap();
    folder
}

fn soft(surface: &str, layer: &str) -> String {
    format!("[[body]]\nname = \"a\"\n{surface}\nlayer = {layer}\n{MATERIAL}\n")
}

#[test]
fn a_good_scene_is_not_refused_as_bad_input() {
    let folder = folder();
    let file = folder.path().join("good.toml");
    fs::write(&file, soft("surface = \"cube.obj\"", "{ cell = 0.5 }")).unwrap();
    let output = palpate(&["run", file.to_str().unwrap(), "--steps", "1"]);
    assert_ne!(output.status.code(), Some(2), "wrong error: {}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn mistakes_in_a_scene() {
    let folder = folder();
    let cube = "surface = \"cube.obj\"";
    let body = soft(cube, "{ cell = 0.5 }");
    for (scene, words) in [
        ("[stepp]\n".into(), "scene.toml:1: unknown key `stepp`; did you mean `step`?"),
        (format!("{body}frction = 1\n"), "scene.toml:6: unknown key `body[0].frction`"),
        (body.replace("young", "yung"), "did you mean `young`?"),
        (body.replace("2e4", "nan"), "`body.a.material.young`: is NaN"),
        (body.replace("2e4", "-5.0"), "`body.a.material.young`: is -5"),
        (body.replace("0.4", "0.5"), "`body.a.material.poisson`: is 0.5"),
        (body.replace("0.4", "-0.6"), "`body.a.material.poisson`: is -0.6; give a number from -0.5"),
        (body.replace("cube.obj", "cub.obj"), "there is no file"),
        (
            format!("{body}[[body.region]]\ngroup = \"fat\"\nmaterial = {{ young = 1e3 }}\n"),
            "`body.a.region[0].group`: the layer is generated and has no groups; give `box` or `sphere`",
        ),
        (
            format!("{body}[[body.region]]\nsphere = [9, 9, 9, 1]\nmaterial = {{ young = 1e3 }}\n"),
            "`body.a.region[0].sphere`: no tetrahedron has its centroid in the region; enlarge the region, or remove it",
        ),
        (body.replace("young", "law = \"hooke\", young"), "`body.a.material.law`: there is no law \"hooke\""),
        (soft(cube, "\"none.msh\""), "`body.a.layer`: there is no file"),
        (soft("", "{ cell = 0.5 }"), "`body.a.surface`: missing"),
        (format!("{body}[contact]\nfriction = -0.5\n"), "`contact.friction`: is -0.5; give zero or a number greater"),
        (format!("{body}[contact]\nfriction = nan\n"), "`contact.friction`: is NaN; give a finite number"),
        (format!("{body}[contact]\nfriction = \"some\"\n"), "`contact.friction`: is of type string; give a number"),
        (format!("{body}[contact]\nfriction_speed = 0\n"), "`contact.friction_speed`: is 0.0; give 1e-6 m/s or more"),
        (format!("{body}[contact]\nfriction_speed = -1.0\n"), "`contact.friction_speed`: is -1.0; give 1e-6 m/s"),
        (format!("{body}[contact]\nfriction_speed = inf\n"), "`contact.friction_speed`: is inf; give a finite number"),
        ("[step\n".into(), "not TOML"),
        (
            "[tool]\nsphere = 0.1\n[tool]\nsphere = 0.2\n".into(),
            "scene.toml:3: `tool` is given a second time; keep one",
        ),
        ("\"k\\u001b[31m\" = 3\n".into(), "unknown key `k\\u{1b}[31m`"),
        (body.replace("cube.obj", "."), "is a folder, not a file"),
        (body.replace("cube.obj", "cube.step"), "there is no file"),
        (format!("{body}units = \"km\"\n"), "`body.a.units`: there is no unit of length \"km\"; known: m, cm, mm, in"),
        (
            "[tool]\nsphere = 0.01\nmass = 0.1\nunits = \"mm\"\n".into(),
            "`tool.units`: has no meaning together with `sphere`",
        ),
        ("\u{0}\u{1}".into(), "not TOML"),
        (String::new(), "neither a body nor a tool"),
        (
            body.replace("2e4", "1e-300"),
            "`body.a.material.young`: is 1e-300; give a number greater than zero, 1e-30 at least",
        ),
        (body.replace("\"a\"", &format!("\"{}\"", "a".repeat(300))), "a name of 300 characters"),
        (format!("{body}[solver]\nmax_iterations = 10001\n"), "give a whole number from 1 to 10000"),
    ] {
        let message = refusal(folder.path(), &scene);
        assert!(message.contains(words), "expected `{words}` in: {message}");
    }
}

#[test]
fn mistakes_in_supports() {
    let folder = folder();
    let all = "bind = { all = true }";
    let body = "[[body]]\nname = \"a\"\nlayer = { box = [[0, 0, 0], [1, 1, 1]], cells = [2, 2, 2] }\n".to_owned()
        + MATERIAL
        + "\n";
    let support = |keys: &str| format!("{body}[[body.support]]\nname = \"s\"\n{keys}\n");
    let low = "bind = { box = [[-1, -1, -1], [2, 0.1, 2]] }";
    let roller = format!("plane = [0, 1, 0]\n{low}");
    let core = |motion: &str| format!("[[body.core]]\nname = \"c\"\n{motion}\n{low}\n");
    let mesh = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n1\n2 5 \"left\"\n$EndPhysicalNames\n$Nodes\n4\n\
                1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n$EndNodes\n$Elements\n2\n1 2 2 5 1 1 3 4\n2 4 2 7 1 1 2 3 4\n\
                $EndElements\n";
    fs::write(folder.path().join("t.msh"), mesh).unwrap();
    let of_file = |group: &str| {
        let layer = "{ box = [[0, 0, 0], [1, 1, 1]], cells = [2, 2, 2] }";
        support(&format!("point = true\nbind = {{ group = {group} }}")).replace(layer, "\"t.msh\"")
    };
    for (scene, words) in [
        (support(all), "`body.a.support.s.plane`: missing; give exactly one of: plane, axis, point"),
        (
            support(&format!("plane = [1, 0, 0]\npoint = true\n{all}")),
            "given together with `plane`; give only one of them",
        ),
        (support("point = true"), "`body.a.support.s.bind`: missing"),
        (support(&format!("plane = [0, 0, 0]\n{all}")), "`body.a.support.s.plane`: is zero; give the three components"),
        (support(&format!("axis = [0, nan, 0]\n{all}")), "`body.a.support.s.axis[1]`: is NaN"),
        (support(&format!("point = false\n{all}")), "`body.a.support.s.point`"),
        (support(&format!("point = true\nplan = 1\n{all}")), "unknown key"),
        (
            support("plane = [1, 0, 0]\nbind = { box = [[5, 5, 5], [6, 6, 6]] }"),
            "`body.a.support.s.bind`: no node lies in the region: the support holds nothing; enlarge the region",
        ),
        (
            support(&format!("point = true\n{all}")),
            "`body.a.support`: cores and supports hold all nodes: nothing is left free to move",
        ),
        (
            support(&format!("plane = [0, 1, 0]\n{low}\n")) + &core(""),
            "`body.a.support.s.bind`: all nodes in the region are attached to cores: none is left for the support",
        ),
        (
            support(&format!("plane = [0, 1, 0]\n{all}\n")) + &core("motion = \"dynamic\""),
            "`body.a.support.s.bind`: node 0 is attached to the dynamic core \"c\", which no support can hold",
        ),
        (
            support(&format!("plane = [0, 1, 0]\n{low}\n")) + &core("").replace("\"c\"", "\"s\""),
            "`body.a.support.s.name`: \"s\" is taken by another core or support",
        ),
        (
            "[[body]]\nname = \"a\"\nsurface = \"cube.obj\"\nreactions = true\n".into(),
            "`body.a.reactions`: belongs to a soft body, and this one is rigid; remove it",
        ),
        (format!("{body}reactions = true\n"), "`body.a.reactions`: nothing that holds the body has a reaction"),
        (
            format!(
                "{}[[body.support]]\nname = \"b.c\"\n{roller}\n{}[[body.support]]\nname = \"c\"\n{roller}\n",
                body,
                body.replace("\"a\"", "\"a.b\"")
            ),
            "`body[1].name`: \"a.b.c\" would be the name of two reactions",
        ),
        (
            support("point = true\nbind = { group = \"left\" }"),
            "there is no group \"left\" with nodes; the body's mesh has no groups",
        ),
        (
            of_file("\"right\""),
            "`body.a.support.s.bind`: there is no group \"right\" with nodes; the file's groups are 5 \"left\" (faces), 7 \
             (volumes)",
        ),
        (of_file("7"), "cores and supports hold all nodes"),
        (support("point = true\nbind = { nodes = [99] }"), "node 99 does not exist: the layer has 27 nodes"),
    ] {
        let message = refusal(folder.path(), &scene);
        assert!(message.contains(words), "expected `{words}` in: {message}");
    }
    let file = folder.path().join("good.toml");
    fs::write(&file, of_file("\"left\"")).unwrap();
    let output = palpate(&["run", file.to_str().unwrap(), "--steps", "1"]);
    assert!(output.status.success(), "a good support: {}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn mistakes_in_loads() {
    let folder = folder();
    let all = "bind = { all = true }";
    let body = "[[body]]\nname = \"a\"\nlayer = { box = [[0, 0, 0], [1, 1, 1]], cells = [2, 2, 2] }\n".to_owned()
        + MATERIAL
        + "\n";
    let load = |keys: &str| format!("{body}[[body.load]]\nname = \"l\"\n{keys}\n");
    let core = "[[body.core]]\nname = \"c\"\nbind = { box = [[-1, -1, -1], [2, 0.1, 2]] }\n";
    let rigid = |keys: &str| {
        format!(
            "[[body]]\nname = \"a\"\nsurface = \"cube.obj\"\nmotion = \"dynamic\"\nmass = 1.0\n\
             [[body.load]]\nname = \"l\"\n{keys}\n"
        )
    };
    for (scene, words) in [
        (load(all), "give exactly one of: force, traction, pressure, torque"),
        (load("force = [1, 0, 0]"), "`body.a.load.l.bind`: missing; give exactly one of: bind, core"),
        (load(&format!("force = [1, 0]\n{all}")), "`body.a.load.l.force`"),
        (load(&format!("pressure = inf\n{all}")), "`body.a.load.l.pressure`: is inf; give a finite number"),
        (load(&format!("torque = [1, 0, 0]\n{all}")), "`body.a.load.l.torque`: acts on a core; give `core` in place"),
        (load("pressure = 1\ncore = \"c\"") + core, "`body.a.load.l.pressure`: acts on the skin, and not on a core"),
        (
            load("force = [1, 0, 0]\ncore = \"d\"") + core,
            "`body.a.load.l.core`: there is no core \"d\"; the body's cores are c",
        ),
        (load("force = [1, 0, 0]\ncore = \"c\"") + core, "`body.a.load.l.core`: the core \"c\" is not moved by forces"),
        (load("force = [1, 0, 0]\ncore = \"c\""), "the body has no cores: give `bind`"),
        (
            load("force = [1, 0, 0]\nbind = { box = [[5, 5, 5], [6, 6, 6]] }"),
            "`body.a.load.l.bind`: no node lies in the region: the load acts on nothing; enlarge the region",
        ),
        (
            load("pressure = 1\nbind = { box = [[0.4, 0.4, 0.4], [0.6, 0.6, 0.6]] }"),
            "`body.a.load.l.bind`: no triangle of the skin lies with all corners in the region",
        ),
        (
            load("pressure = 1\nbind = { box = [[-1, -1, -1], [2, 0.1, 2]] }") + core,
            "`body.a.load.l.bind`: acts only on nodes of cores that do not move by forces: it changes nothing",
        ),
        (
            rigid("force = [1, 0, 0]")
                .replace("[[body.load]]", "hinge = { point = [0, 0, 0], axis = [0, 0, 1] }\n[[body.load]]"),
            "`body.a.load.l.force`: acts on the hinge of \"a\", which holds it; give `torque`",
        ),
        (load("pressure = 1\nbind = { inset = 0.1 }"), "`body.a.load.l.bind`: is no part of the skin"),
        (
            load(&format!("pressure = 1\n{all}\nfactors = [[1, 1], [1, 2]]")),
            "`body.a.load.l.factors[1]`: time 1.0 does not come after 1.0; give pairs of time and factor",
        ),
        (load(&format!("pressure = 1\n{all}\nfactors = []")), "`body.a.load.l.factors`: is empty"),
        (load(&format!("pressure = 1\n{all}\nfactors = [1, 1]")), "`body.a.load.l.factors[0]`"),
        (
            load(&format!("pressure = 1\n{all}\n[[body.load]]\nname = \"l\"\npressure = 1\n{all}")),
            "`body.a.load.l.name`: \"l\" is taken by another load",
        ),
        (
            rigid("pressure = 1"),
            "`body.a.load.l.pressure`: acts on the skin, and not on a core; give `force` or `torque`",
        ),
        (rigid(&format!("force = [1, 0, 0]\n{all}")), "`body.a.load.l.bind`: has no meaning for a rigid body"),
        (
            rigid("force = [1, 0, 0]").replace("motion = \"dynamic\"\nmass = 1.0\n", ""),
            "`body.a.load.l.core`: the core \"a\" is not moved by forces",
        ),
        (
            "[[body]]\nname = \"a\"\nplane = [0, 1, 0, 0]\n[[body.load]]\nname = \"l\"\nforce = [1, 0, 0]\n".into(),
            "has no meaning for a plane",
        ),
    ] {
        let message = refusal(folder.path(), &scene);
        assert!(message.contains(words), "expected `{words}` in: {message}");
    }
    let file = folder.path().join("good.toml");
    let good = load(&format!("pressure = 1\n{all}\nfactors = [[0, 0], [1, 1]]")) + core;
    fs::write(&file, good).unwrap();
    let output = palpate(&["run", file.to_str().unwrap(), "--steps", "1"]);
    assert!(output.status.success(), "a good load: {}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn what_is_most_likely_a_mistake_is_noted() {
    let folder = folder();
    let file = folder.path().join("odd.toml");
    let note = |scene: &str, words: &str| {
        fs::write(&file, scene).unwrap();
        let output = palpate(&["run", file.to_str().unwrap(), "--steps", "1"]);
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success() && said.contains(words), "expected `{words}` in: {said}");
    };
    let body = soft("surface = \"cube.obj\"", "{ cell = 0.5 }");
    let large = "note: `body.a`: the body is 1.000e2 m across; if its lengths are in millimetres, give units = \"mm\"";
    note(&body.replace("surface", "scale = 100.0\nsurface"), large);
    note(&body.replace("surface", "scale = 1e-5\nsurface"), "the body is 1.000e-5 m across; give `units`");
    note(&format!("{body}[step]\ndt = 2\n"), "note: `step.dt`: a step of 2 s leaves out");
}

/// Where the process may have 700 MB: what would not fit is refused before the work on it begins.
#[test]
#[cfg(target_os = "linux")]
fn work_that_the_memory_is_too_small_for_is_refused() {
    let folder = folder();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let box_ = "{ box = [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]], cells = [80, 80, 80] }";
    fs::write(path("box.toml"), soft("", box_)).unwrap();
    fs::write(path("large.obj"), format!("{CUBE}{}", "# nothing\n".repeat(6_000_000))).unwrap();
    let (box_, large, out) = (path("box.toml"), path("large.obj"), path("out"));
    let commands: [(&[&str], &str); 3] = [
        (&["run", &box_, "--steps", "1", "--out", &out], "box.toml: `body.a.layer.cells`: about 3072 MB of memory"),
        (&["prepare", "head:1000", "--no-cache", "--cells", "95", "--out", &out], "MB of memory are needed"),
        (&["prepare", &large, "--no-cache", "--cells", "4", "--out", &out], "large.obj: about 960 MB of memory"),
    ];
    for (command, words) in commands {
        let mut limited = Command::new("sh");
        limited.args(["-c", "ulimit -v 700000; exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_palpate")]).args(command);
        let output = limited.output().unwrap();
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "exit status of {command:?} with the error: {message}");
        let is_told = message.contains(words) && message.contains("which the system does not give; ");
        assert!(is_told && message.lines().count() == 1, "wrong error of {command:?}: {message}");
        assert!(!Path::new(&out).exists(), "{command:?} left its output directory");
    }
}

#[test]
fn mistakes_on_the_command_line() {
    let folder = folder();
    let missing = folder.path().join("missing.toml");
    let output = palpate(&["run", missing.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("missing.toml: cannot be read"));
    #[cfg(unix)]
    {
        let endless = palpate(&["run", "/dev/zero"]);
        assert_eq!(endless.status.code(), Some(2));
        assert!(String::from_utf8_lossy(&endless.stderr).contains("/dev/zero: is a pipe or a device"));
    }
    let hostile = palpate(&["run", "no\u{1b}[31m.toml"]);
    assert!(String::from_utf8_lossy(&hostile.stderr).starts_with("error: no\\u{1b}[31m.toml: cannot be read"));
    fs::write(folder.path().join("binary.toml"), [0xff, 0xfe, 0x00]).unwrap();
    let binary = folder.path().join("binary.toml");
    assert_eq!(palpate(&["run", binary.to_str().unwrap()]).status.code(), Some(2));
    for arguments in [
        &["run"][..],
        &["run", "x", "--steps", "0"],
        &["run", "x", "--steps", "-1"],
        &["run", "x", "--steps", "1e99"],
        &["run", "x", "--steps", "100000001"],
        &["run", "x", "--device", ""],
        &["run", "x", "--seconds", "nan"],
        &["run", "x", "--seconds", "0"],
        &["run", "x", "--steps", "1", "--seconds", "1"],
        &["walk"],
    ] {
        let output = palpate(arguments);
        assert_eq!(output.status.code(), Some(2), "arguments: {arguments:?}");
        let message = String::from_utf8(output.stderr).unwrap();
        assert!(message.starts_with("error: ") && message.lines().count() == 1, "wrong error: {message}");
    }
    let file = folder.path().join("good.toml");
    fs::write(&file, soft("surface = \"cube.obj\"", "{ cell = 0.5 }")).unwrap();
    let output = palpate(&["run", file.to_str().unwrap(), "--seconds", "1e300"]);
    assert_eq!(output.status.code(), Some(2));
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(message.contains("1e300 s are more than 100000000 steps"), "wrong error: {message}");
}

/// Expected outcome of preparing a mesh in `bad/`, the folder of defective files.
enum Answer {
    /// The mesh is refused, with an error that contains these words.
    Refused(&'static str),
    /// The surface mesh is prepared as the skin of a rigid body, and of a soft body with lattice cells of this edge, m;
    /// both times with these notes (given without the file's name and line number).
    Cells(f64, &'static [&'static str]),
    /// The tetrahedral mesh is prepared as the layer of a soft body, with these notes.
    Layer(&'static [&'static str]),
}
use Answer::{Cells, Layer, Refused};

/// Every mesh in `bad/`, with its expected outcome.
const ANSWERS: [(&str, Answer); 25] = [
    ("duplicate_faces.obj", Cells(0.1, &["300 triangles given more than once dropped"])),
    ("empty.obj", Refused("has no vertices")),
    // The scene's key `scale` cannot help: in any unit, the edges are too short for f32 so far from the origin.
    ("far_from_origin.obj", Refused("from the origin, where neighbouring f32 numbers are")),
    ("flipped_10pct.obj", Cells(0.1, &["1619 edges with inconsistently oriented triangles; 599 triangles reversed"])),
    ("huge_coords.obj", Refused("coordinates reach 8.491e17")),
    ("index_out_of_range.obj", Refused("obj:5: a face names vertex 0")),
    ("inside_out.obj", Cells(0.1, &["1 pieces were inside out, and reversed"])),
    ("moebius.obj", Refused("one side only and cannot be oriented")),
    ("nan_inf.obj", Refused("obj:2: coordinate `nan` is not a finite number")),
    ("nan_node.v22.msh", Refused("msh:7: a node's coordinate is not a finite number")),
    ("no_faces.obj", Refused("has no faces")),
    ("nonmanifold_edge_welded.obj", Cells(0.2, &["1 edges of more than two triangles, kept as they are"])),
    // A pyramid in several dialects of the OBJ format, which is closed only if the reader understands all of them.
    ("ok_dialects.obj", Cells(0.2, &[])),
    (
        "open_holes.obj",
        Cells(
            0.1,
            &["352 edges of one triangle around 103 holes, left open; for volume and mass, triangle fans close them \
               (2.35 % of the surface)"],
        ),
    ),
    // A head that is open at the neck and whose triangles face inwards.
    (
        "real_cgal_head_open.obj",
        Cells(
            1.0,
            &[
                "1 pieces were inside out, and reversed",
                "58 edges of one triangle around 3 holes, left open; for volume and mass, triangle fans close them \
                 (8.96 % of the surface)",
            ],
        ),
    ),
    // Besides a human, the file holds clothes, eyelashes and the joints of a rig; some of these are open sheets.
    (
        "real_makehuman_base.obj",
        Cells(
            0.7,
            &[
                "2 pieces were inside out, and reversed",
                "784 edges of one triangle around 28 holes, left open; for volume and mass, triangle fans close them \
                 (17.30 % of the surface)",
                "2390 pairs of triangles intersect, kept; first triangles 410 and 35121 (from 0)",
            ],
        ),
    ),
    (
        "self_intersect_tori.obj",
        Cells(0.3, &["256 pairs of triangles intersect, kept; first triangles 8 and 2469 (from 0)"]),
    ),
    ("sparse_ids_ok.v22.msh", Layer(&[])),
    ("triangle_soup.obj", Cells(0.1, &["14988 vertices joined with others at the same place, where edges were open"])),
    ("truncated.obj", Refused("obj:14: a vertex with 1 coordinates")),
    ("truncated.v41.msh", Refused(": the file ends early")),
    (
        "zero_area.obj",
        Cells(
            0.1,
            &[
                "156 triangles without area dropped",
                "78 vertices joined with others at the same place, where edges were open",
                "3 pairs of triangles intersect, kept; first triangles 2973 and 2977 (from 0)",
            ],
        ),
    ),
    ("zero_volume_dup_tet.v22.msh", Refused("msh:14: tetrahedron 1 has no volume")),
    ("out_of_range.node", Refused("out_of_range.ele:2: tetrahedron 0 names node 4, which does not exist")),
    ("out_of_range.ele", Refused("out_of_range.ele:2: tetrahedron 0 names node 4, which does not exist")),
];

/// Prepares the only body of a scene.
fn prepared(folder: &Path, scene: &str) -> palpate::Result<prepare::Body> {
    let file = folder.join("scene.toml");
    fs::write(&file, scene).unwrap();
    let scene = Scene::load(&file)?;
    prepare::body(&scene.bodies[0], &scene)
}

/// Checks that a prepared body is finite, that its skin is embedded and covered by collision proxies, and that the
/// notes on the mesh file at `path` are `notes`.
fn assert_prepared(name: &str, path: &Path, body: &prepare::Body, notes: &[&str]) {
    let (skin, proxies) = match &body.shape {
        prepare::Shape::Soft { layer, embedding, skin, proxies, .. } => {
            assert_eq!(embedding.len(), skin.vertices.len(), "{name}: numbers of embedded and skin vertices");
            assert!(embedding.iter().flat_map(|e| e.weights).all(f64::is_finite), "{name}: an embedding is not finite");
            assert!(layer.nodes.iter().all(|node| node.is_finite()), "{name}: a node is not finite");
            (skin, proxies)
        }
        prepare::Shape::Rigid { skin, proxies, volume, centroid, .. } => {
            assert!(*volume > 0.0 && centroid.is_finite(), "{name}: the volume or the centroid is not valid");
            (skin, proxies)
        }
        prepare::Shape::Plane { .. } => panic!("{name}: the body is a plane"),
    };
    assert!(
        proxies.iter().flat_map(|proxy| &proxy.hull).all(|corner| corner.is_finite()),
        "{name}: a corner of a collision hull is not finite"
    );
    assert_eq!(
        proxies.iter().map(|proxy| proxy.vertices.len()).sum::<usize>(),
        skin.vertices.len(),
        "{name}: numbers of vertices of all proxies and of the skin"
    );
    assert_eq!(
        proxies.iter().map(|proxy| proxy.triangles.len()).sum::<usize>(),
        skin.triangles.len(),
        "{name}: numbers of triangles of all proxies and of the skin"
    );
    // Other notes, which do not begin with the file's path, name details that cells of this size cannot resolve.
    let of_file = body.report.notes.iter().filter(|note| note.starts_with(&path.display().to_string()));
    let said: Vec<&str> = of_file.map(|note| note.split_once(": ").unwrap().1).collect();
    assert_eq!(said, notes, "{name}: notes on the file");
}

#[test]
#[ignore = "needs real meshes"]
fn every_bad_mesh_is_prepared_with_a_report_or_refused_with_the_reason() {
    let Some(meshes) = meshes() else { return };
    for entry in fs::read_dir(meshes.join("bad")).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        assert!(ANSWERS.iter().any(|(known, _)| *known == name), "{name} has no entry in ANSWERS");
    }
    let folder = folder();
    for (name, answer) in &ANSWERS {
        let path = meshes.join("bad").join(name);
        let layer = soft("", &format!("{path:?}"));
        let cells = |cell: f64| soft(&format!("surface = {path:?}"), &format!("{{ cell = {cell:?} }}"));
        let rigid = format!("[[body]]\nname = \"a\"\nsurface = {path:?}\n");
        match answer {
            Refused(words) => {
                let message = refusal(folder.path(), if name.ends_with(".obj") { &rigid } else { &layer });
                assert!(message.contains(words), "{name} is refused with: {message}");
            }
            Cells(cell, notes) => {
                let start = std::time::Instant::now();
                assert_prepared(name, &path, &prepared(folder.path(), &rigid).unwrap(), notes);
                assert_prepared(name, &path, &prepared(folder.path(), &cells(*cell)).unwrap(), notes);
                println!("{name}: prepared in {:.1?}", start.elapsed());
                // With `repair = false` a mesh that needs repair is refused; a mesh is not refused for intersecting
                // triangles alone.
                let strict = prepared(folder.path(), &format!("{rigid}repair = false\n"));
                let is_sound = notes.iter().all(|note| note.contains("pairs of triangles intersect"));
                assert_eq!(
                    strict.is_ok(),
                    is_sound,
                    "{name}: whether it is accepted with `repair = false`; error: {:?}",
                    strict.err()
                );
            }
            Layer(notes) => assert_prepared(name, &path, &prepared(folder.path(), &layer).unwrap(), notes),
        }
    }
}

#[test]
#[ignore = "needs real meshes"]
fn every_good_mesh_is_read() {
    let Some(meshes) = meshes() else { return };
    for (name, vertices, triangles) in [
        ("head", 44_000, 87_996),
        ("pumpkin", 30_000, 59_996),
        ("gear", 29_000, 58_000),
        ("human", 13_380, 26_756),
        ("human_3000", 3_000, 5_996),
    ] {
        let (mesh, report) = repair::read(&meshes.join(format!("surf/{name}.obj")), true).unwrap();
        assert!(report.is_clean(), "{name} was repaired: {report:?}");
        assert_eq!(
            (mesh.vertices.len(), mesh.triangles.len()),
            (vertices, triangles),
            "numbers of vertices and triangles of {name}"
        );
    }
    for (name, nodes, tetrahedra) in [
        ("human.v22", 3128, 10_204),
        ("human.v41", 3128, 10_204),
        ("human_tetgen_sliver.v41", 3060, 10_333),
        ("head.v41", 2598, 10_336),
        ("pumpkin.v41", 2420, 8779),
        ("gear.v41", 1238, 3636),
        ("cantilever.v41", 653, 2317),
        ("cantilever_kuhn.v22", 525, 1920),
        ("bad_slivers.v41", 729, 3575),
    ] {
        let mesh = gmsh::read(&meshes.join(format!("tet/{name}.msh"))).unwrap();
        assert_eq!((mesh.nodes.len(), mesh.tetrahedra.len()), (nodes, tetrahedra), "nodes and tetrahedra of {name}");
    }
}

/// Greatest allowed ratio of two sums of hull sizes: that of a triangle soup (whose triangles share no vertices) to
/// that of the sound surface. The size of a collision hull is the diagonal of its bounding box. Repair joins vertices
/// of the soup; a joined vertex that was assigned to a distant hull would stretch that hull over the body.
const SAME_HULLS: f64 = 1.05;

#[test]
#[ignore = "needs real meshes"]
fn joined_vertices_do_not_stretch_proxies() {
    let Some(meshes) = meshes() else { return };
    let [sound, soup] = ["surf/human_3000.obj", "bad/triangle_soup.obj"].map(|file| {
        let (mesh, _) = repair::read(&meshes.join(file), true).unwrap();
        let proxies = prepare::proxies(&prepare::skin::build(mesh.vertices, mesh.triangles)).unwrap();
        let diagonal = |hull: &[glam::DVec3]| {
            let low = hull.iter().copied().reduce(glam::DVec3::min).unwrap();
            low.distance(hull.iter().copied().reduce(glam::DVec3::max).unwrap())
        };
        (proxies.len(), proxies.iter().map(|proxy| diagonal(&proxy.hull)).sum::<f64>())
    });
    println!("number of hulls and sum of their diagonals: {sound:?} for the surface, {soup:?} for its triangle soup");
    assert_eq!(soup.0, sound.0);
    assert!(soup.1 < SAME_HULLS * sound.1, "number and diagonals of hulls: soup {soup:?}, surface {sound:?}");
}

#[test]
#[ignore = "needs real meshes"]
fn layers_with_slivers_are_prepared_and_name_the_worst() {
    let Some(meshes) = meshes() else { return };
    let folder = folder();
    for (name, words) in [("human_tetgen_sliver.v41.msh", "786 tetrahedra"), ("bad_slivers.v41.msh", "524 tetrahedra")]
    {
        let path = meshes.join("tet").join(name);
        let body = prepared(folder.path(), &soft("", &format!("{path:?}"))).unwrap();
        println!("{}", body.report.notes.join("\n"));
        let notes: Vec<&str> = body.report.notes.iter().map(|note| note.split_once(": ").unwrap().1).collect();
        assert!(
            notes.iter().any(|note| note.starts_with(words) && note.contains("the worst is")),
            "no note on slivers: {notes:?}"
        );
        assert_prepared(name, &path, &body, &notes);
    }
}

#[test]
fn a_run_says_what_was_repaired() {
    let folder = folder();
    let inside_out = CUBE.replace("f 4 3 2 1", "f 1 2 3 4");
    fs::write(folder.path().join("cube.obj"), inside_out).unwrap();
    let (file, out) = (folder.path().join("mended.toml"), folder.path().join("out"));
    fs::write(&file, soft("surface = \"cube.obj\"", "{ cell = 0.5 }")).unwrap();
    let output = palpate(&["run", file.to_str().unwrap(), "--steps", "1", "--out", out.to_str().unwrap()]);
    if output.status.code() == Some(3) {
        println!("the test of a run's notes on repairs is skipped, because there is no Vulkan device");
        return;
    }
    let (said, note) = (String::from_utf8(output.stderr).unwrap(), "4 edges with inconsistently oriented triangles");
    assert!(said.starts_with("note: ") && said.contains("cube.obj:9: ") && said.contains(note), "notes: {said}");
    let summary: serde_json::Value = serde_json::from_slice(&fs::read(out.join("summary.json")).unwrap()).unwrap();
    let told = &summary["files"]["a"];
    assert_eq!(
        (&told["repair"]["turned_triangles"], &told["repair"]["clashing_edges"]["count"]),
        (&2.into(), &4.into())
    );
    assert!(told["notes"][0].as_str().unwrap().contains(note), "summary.json: {told}");
}
