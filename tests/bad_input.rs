//! Bad input through the built program: exit status 2, one line on standard error that says what, where and what to
//! do, no panic, and nothing left in the output directory. All of it happens before a device is opened.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use palpate::prepare::repair;
use palpate::scene::gmsh;
use tempfile::TempDir;

/// A unit cube, closed and wound outwards.
const CUBE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\nf 4 3 2 1\nf 5 6 7 8\n\
                    f 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";
const MATERIAL: &str = "material = { young = 2e4, poisson = 0.4, density = 1000.0 }";

/// Runs `palpate` with these arguments.
fn palpate(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_palpate")).args(arguments).output().unwrap()
}

/// Runs a scene with `--out`, insists on a clean refusal, and returns the message.
fn refusal(folder: &Path, scene: &str) -> String {
    let (file, out) = (folder.join("scene.toml"), folder.join("made/out"));
    fs::write(&file, scene).unwrap();
    let output = palpate(&["run", file.to_str().unwrap(), "--steps", "1", "--out", out.to_str().unwrap()]);
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{scene}\n{message}");
    assert_eq!(message.lines().count(), 1, "{message}");
    assert!(message.starts_with("error: ") && !message.contains("panicked"), "{message}");
    assert!(output.stdout.is_empty(), "nothing on standard output");
    assert!(!folder.join("made").exists(), "the output directory is not made");
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
    assert_ne!(output.status.code(), Some(2), "{}", String::from_utf8_lossy(&output.stderr));
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
        (body.replace("cube.obj", "cub.obj"), "there is no file"),
        (soft(cube, "\"none.msh\""), "`body.a.layer`: there is no file"),
        (soft("", "{ cell = 0.5 }"), "`body.a.surface`: missing"),
        (format!("{body}[contact]\nfriction = 0.5\n"), "`contact.friction`: this version does not do that yet"),
        ("[step\n".into(), "not TOML"),
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
        assert!(message.contains(words), "{words}: {message}");
    }
}

#[test]
fn mistakes_on_the_command_line() {
    let folder = folder();
    let missing = folder.path().join("missing.toml");
    let output = palpate(&["run", missing.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("missing.toml: cannot be read"));
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
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        let message = String::from_utf8(output.stderr).unwrap();
        assert!(message.starts_with("error: ") && message.lines().count() == 1, "{message}");
    }
    let file = folder.path().join("good.toml");
    fs::write(&file, soft("surface = \"cube.obj\"", "{ cell = 0.5 }")).unwrap();
    let output = palpate(&["run", file.to_str().unwrap(), "--seconds", "1e300"]);
    assert_eq!(output.status.code(), Some(2));
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(message.contains("1e300 s are more than 100000000 steps"), "{message}");
}

/// The shared meshes, or `None` and a visible line where they are not there.
fn meshes() -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/meshes");
    let folder = std::env::var_os("PALPATE_MESHES").map_or(beside, PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    println!("skipped: no meshes at {} (set PALPATE_MESHES)", folder.display());
    None
}

/// Every mesh of `bad/` that palpate reads, and what it is answered; empty: it is accepted.
const ANSWERS: [(&str, &str); 24] = [
    ("duplicate_faces.obj", "300 triangles given more than once, first at triangle"),
    ("empty.obj", "has no vertices"),
    ("far_from_origin.obj", "from the origin, where single precision steps by"),
    ("flipped_10pct.obj", "1619 edges between triangles wound opposite ways"),
    ("huge_coords.obj", "coordinates reach 8.491e17"),
    ("index_out_of_range.obj", "obj:5: a face names vertex 0"),
    ("inside_out.obj", "the surface is inside out"),
    ("moebius.obj", "one side only and cannot be oriented"),
    ("nan_inf.obj", "obj:2: coordinate `nan` is not a finite number"),
    ("nan_node.v22.msh", "msh:7: a node's coordinate is not a finite number"),
    ("no_faces.obj", "has no faces"),
    ("nonmanifold_edge_welded.obj", "1 edges with more than two triangles"),
    // A pyramid: closed, once every dialect in it is understood.
    ("ok_dialects.obj", ""),
    ("open_holes.obj", "the surface is open: 352 edges with one triangle"),
    ("real_cgal_head_open.obj", "the surface is open: 58 edges with one triangle"),
    // Clothes, lashes and joints of the rig lie in the same file, some of them open sheets.
    ("real_makehuman_base.obj", "the surface is open: 784 edges with one triangle"),
    // Two sound solids that cross: only a search for crossing triangles would tell.
    ("self_intersect_tori.obj", ""),
    ("sparse_ids_ok.v22.msh", ""),
    ("triangle_soup.obj", "weld vertices"),
    ("truncated.obj", "obj:14: a vertex with 1 coordinates"),
    ("truncated.v41.msh", ": the file ends early"),
    ("zero_area.obj", "156 triangles without area"),
    ("zero_volume_dup_tet.v22.msh", "msh:14: tetrahedron 1 has no volume"),
    ("out_of_range.node", "files of type .node are not read here"),
];

#[test]
fn every_bad_mesh_has_its_answer() {
    let Some(meshes) = meshes() else { return };
    for entry in fs::read_dir(meshes.join("bad")).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        assert!(name.ends_with(".ele") || ANSWERS.iter().any(|(known, _)| *known == name), "{name} has no answer");
    }
    let folder = folder();
    for (name, words) in ANSWERS {
        let path = meshes.join("bad").join(name);
        let is_surface = name.ends_with(".obj");
        if words.is_empty() {
            if is_surface {
                repair::read(&path, true).unwrap();
            } else {
                gmsh::read(&path).unwrap();
            }
            continue;
        }
        let scene = if is_surface {
            soft(&format!("surface = {path:?}"), "{ cell = 0.5 }")
        } else {
            soft("surface = \"cube.obj\"", &format!("{path:?}"))
        };
        let message = refusal(folder.path(), &scene);
        assert!(message.contains(words), "{name}: {message}");
    }
}

#[test]
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
        println!("{name}: {report:?}");
        assert_eq!((mesh.vertices.len(), mesh.triangles.len()), (vertices, triangles), "{name}");
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
        assert_eq!((mesh.nodes.len(), mesh.tetrahedra.len()), (nodes, tetrahedra), "{name}");
    }
}

#[test]
fn both_versions_of_a_mesh_file_are_the_same_mesh() {
    let Some(meshes) = meshes() else { return };
    let [old, new] = ["22", "41"].map(|v| gmsh::read(&meshes.join(format!("tet/human.v{v}.msh"))).unwrap());
    assert_eq!(old.tetrahedra, new.tetrahedra);
    assert!(old.nodes.iter().zip(&new.nodes).all(|(a, b)| a.distance(*b) < 1e-12));
}

#[test]
fn zz() {
    let Some(meshes) = meshes() else { return };
    for (name, _) in ANSWERS {
        if !name.ends_with("obj") { continue; }
        let path = meshes.join("bad").join(name);
        for m in [true, false] {
        match repair::read(&path, m) {
            Err(e) => println!("{name}: REFUSED {e}"),
            Ok((_, r)) => { println!("{name}: {}", serde_json::to_string(&r).unwrap()); for n in repair::notes(&r, &path) { println!("   {n}"); } }
        }}
    }
}
