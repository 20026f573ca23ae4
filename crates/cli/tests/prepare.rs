//! Tests of `palpate prepare`, which makes a soft body from a surface, through the built program: what it writes, what
//! it keeps in its cache, and what it refuses. No Vulkan device is opened. A body's *skin* is its surface mesh; its
//! *layer* is its tetrahedral mesh; a *rigid core* is a rigid body inside the body, to which nodes of the layer are
//! attached.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use palpate::Scene;
use palpate::internal::prepare::{self, Cache};
use palpate::scene::{self};
use serde_json::Value;

fn prepare(cache: &Path, out: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_palpate"));
    command.arg("prepare").args(arguments).arg("--out").arg(out).env("PALPATE_CACHE", cache);
    command.output().unwrap()
}

fn prepared(cache: &Path, out: &Path, arguments: &[&str]) -> Value {
    let output = prepare(cache, out, arguments);
    assert!(output.status.success(), "palpate prepare failed: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&fs::read(out.join("report.json")).unwrap()).unwrap()
}

fn names(folder: &Path) -> Vec<String> {
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn body_files(folder: &Path) -> [Vec<u8>; 3] {
    ["skin.obj", "layer.msh", "scene.toml"].map(|name| fs::read(folder.join(name)).unwrap())
}

const SMALL: [&str; 4] = ["head:1500", "--cells", "15", "--no-pictures"];

#[test]
fn a_model_becomes_a_body_that_a_scene_can_use() {
    let folder = tempfile::tempdir().unwrap();
    let (cache, out) = (folder.path().join("cache"), folder.path().join("new/out"));
    let report = prepared(&cache, &out, &["head:1500", "--cells", "15", "--scale", "2"]);
    let expected = [
        "figure.png",
        "layer.msh",
        "layer.png",
        "proxies.png",
        "report.json",
        "report.txt",
        "scene.toml",
        "skin.obj",
        "skin.png",
    ];
    assert_eq!(names(&out), expected);
    assert_eq!((&report["skin"]["vertices"], &report["skin"]["triangles"]), (&1500.into(), &2996.into()));
    assert_eq!((&report["skin"]["components"], &report["skin"]["boundary_edges"]), (&1.into(), &0.into()));
    assert_eq!(report["proxies"]["coverage"], 1.0);
    let extent = report["skin"]["extent_m"][1].as_f64().unwrap();
    assert!((extent - 0.5).abs() < 0.02, "the scaled head must be 0.5 m high, but it is {extent} m high");
    assert!(report["layer"]["tetrahedra"].as_u64().unwrap() > 1000);
    assert!(report["seconds"].as_object().unwrap().contains_key("proxies"));

    let scene = Scene::load(&out.join("scene.toml")).unwrap();
    let (body, _) = prepare::body_and_report(&scene.bodies[0], &scene, &Cache::off(), &mut |_| Ok(())).unwrap();
    let prepare::Shape::Soft { layer, skin, .. } = &body.shape else { panic!("the body is not soft") };
    assert_eq!(layer.tetrahedra.len() as u64, report["layer"]["tetrahedra"].as_u64().unwrap());
    let bound = layer.attached.iter().filter(|&&b| b).count();
    assert!(
        bound > 0 && bound < layer.nodes.len() / 2,
        "{bound} nodes are attached to a rigid core; there must be some, and fewer than half of all {} nodes",
        layer.nodes.len()
    );
    // On the scene's trajectory the tool, a sphere, starts outside the skin and then is pressed into it.
    let scene::ToolShape::Sphere(radius) = scene.tool.as_ref().unwrap().shape else { panic!("the tool is no sphere") };
    let gap = |p: glam::DVec3| skin.vertices.iter().map(|v| v.distance(p)).fold(f64::INFINITY, f64::min) - radius;
    assert!(gap(scene.trajectory[0].position) > 0.0 && gap(scene.trajectory[1].position) < -0.2 * radius);
}

#[test]
fn a_body_from_the_cache_is_the_same_to_the_last_bit() {
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().join("cache");
    let out = |name: &str| folder.path().join(name);
    assert_eq!(prepared(&cache, &out("a"), &SMALL)["cache"], "made");
    assert_eq!(prepared(&cache, &out("b"), &SMALL)["cache"], "found");
    let uncached = prepared(&cache, &out("c"), &[&SMALL[..], &["--no-cache"]].concat());
    assert_eq!(uncached["cache"], "off");
    assert_eq!(body_files(&out("a")), body_files(&out("b")));
    assert_eq!(body_files(&out("a")), body_files(&out("c")));
    let mut entries = names(&cache);
    entries.retain(|name| name.ends_with(".body"));
    assert_eq!(entries.len(), 1);
    // Other options make another body, except the scale, which is applied to the body from the cache.
    assert_eq!(prepared(&cache, &out("d"), &[&SMALL[..], &["--scale", "3"]].concat())["cache"], "found");
    assert_eq!(prepared(&cache, &out("e"), &[&SMALL[..], &["--hulls", "7"]].concat())["cache"], "made");
}

#[test]
fn a_damaged_entry_is_made_again_and_said_so() {
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().join("cache");
    prepared(&cache, &folder.path().join("a"), &SMALL);
    let entry: PathBuf = cache.join(names(&cache).into_iter().find(|name| name.ends_with(".body")).unwrap());
    let sound = fs::read(&entry).unwrap();
    for spoiled in [sound[..sound.len() / 2].to_vec(), Vec::new(), flipped(&sound, sound.len() / 3)] {
        fs::write(&entry, spoiled).unwrap();
        let report = prepared(&cache, &folder.path().join("b"), &SMALL);
        assert_eq!(report["cache"], "made");
        assert!(
            report["notes"][0].as_str().unwrap().contains("is damaged and is made again"),
            "notes in report.json: {}",
            report["notes"]
        );
        assert_eq!(body_files(&folder.path().join("a")), body_files(&folder.path().join("b")));
        assert_eq!(fs::read(&entry).unwrap(), sound);
    }
}

fn flipped(bytes: &[u8], at: usize) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    bytes[at] ^= 0x10;
    bytes
}

#[test]
fn a_changed_file_is_another_body() {
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().join("cache");
    prepared(&cache, &folder.path().join("a"), &SMALL);
    let file = folder.path().join("mine.obj");
    fs::copy(folder.path().join("a/skin.obj"), &file).unwrap();
    let arguments = [file.to_str().unwrap(), "--cells", "15", "--no-pictures"];
    assert_eq!(prepared(&cache, &folder.path().join("b"), &arguments)["cache"], "made");
    assert_eq!(prepared(&cache, &folder.path().join("b"), &arguments)["cache"], "found");
    fs::write(&file, fs::read_to_string(&file).unwrap() + "# changed\n").unwrap();
    assert_eq!(prepared(&cache, &folder.path().join("b"), &arguments)["cache"], "made");
}

/// A scene that somebody has edited is kept; one that nobody has is replaced.
#[test]
fn an_edited_scene_is_not_lost() {
    let folder = tempfile::tempdir().unwrap();
    let (cache, out) = (folder.path().join("cache"), folder.path().join("a"));
    let scene = |name: &str| fs::read_to_string(out.join(name)).unwrap();
    prepared(&cache, &out, &SMALL);
    let first = scene("scene.toml");
    prepared(&cache, &out, &[&SMALL[..], &["--scale", "2"]].concat());
    let second = scene("scene.toml");
    assert!(second != first && !out.join("scene-1.toml").exists());
    let edited = second.replace("young = 2e4", "young = 5e4");
    fs::write(out.join("scene.toml"), &edited).unwrap();
    for _ in 0..2 {
        let output = prepare(&cache, &out, &SMALL);
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success() && said.contains("seems to be edited, and is kept"), "{said}");
        assert!(String::from_utf8(output.stdout).unwrap().contains("scene-1.toml"));
        assert_eq!((scene("scene.toml"), scene("scene-1.toml")), (edited.clone(), first.clone()));
    }
    fs::write(out.join("scene-1.toml"), &edited).unwrap();
    prepared(&cache, &out, &SMALL);
    assert_eq!(
        [scene("scene.toml"), scene("scene-1.toml"), scene("scene-2.toml")],
        [&edited, &edited, &first].map(String::from)
    );
    // The surface itself may be called as a result is.
    let own = ["skin.obj", "--cells", "5", "--no-pictures", "--out", "."];
    let output =
        Command::new(env!("CARGO_BIN_EXE_palpate")).arg("prepare").args(own).current_dir(&out).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(2) && said.contains("skin.obj: this command reads it"), "{said}");
}

#[test]
fn a_shell_is_told_apart_from_a_full_layer() {
    let folder = tempfile::tempdir().unwrap();
    let told = |name: &str, more: &[&str]| {
        prepared(&folder.path().join("cache"), &folder.path().join(name), &[&SMALL[..], more].concat());
        fs::read_to_string(folder.path().join(name).join("report.txt")).unwrap()
    };
    let full = told("full", &[]);
    assert!(full.contains("tetrahedra, volume ") && !full.contains("shell"), "{full}");
    let shell = told("shell", &["--thickness", "0.03"]);
    assert!(shell.contains("tetrahedra, a shell of ") && shell.contains("with its inside "), "{shell}");
}

#[test]
fn a_cache_that_cannot_be_written_is_a_note() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("file"), "").unwrap();
    let report = prepared(&folder.path().join("file/under"), &folder.path().join("a"), &SMALL);
    let notes = report["notes"].to_string();
    assert!(notes.contains("cannot be written") && notes.contains("file/under"), "notes in report.json: {notes}");
}

#[test]
fn what_cannot_be_prepared_is_refused_in_one_line_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let flat = folder.path().join("flat.obj");
    fs::write(&flat, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 3 2 1\n").unwrap();
    fs::write(folder.path().join("a.stl"), "solid").unwrap();
    let missing = folder.path().join("missing.obj");
    let (stl, step) = (folder.path().join("a.stl"), folder.path().join("a.step"));
    let cases: [(&[&str], &str); 11] = [
        (&[missing.to_str().unwrap()], "missing.obj: cannot be read"),
        (&[stl.to_str().unwrap()], "a.stl:1: the file ends early, before `endsolid`"),
        (&[step.to_str().unwrap()], "neither a file with a surface nor a model; give .obj, .stl, .ply"),
        (&["head:1500", "--units", "ft"], "give m, cm, mm, in"),
        (&[flat.to_str().unwrap()], "flat.obj"),
        (&["heart:1000"], "or a model: head, pumpkin, gear, human"),
        (&["head:12"], "give 500 to 400000"),
        (&["head:1500", "--cell", "5"], "`--cell`"),
        (&["head:1500", "--cell", "0"], "--cell"),
        (&["head:1500", "--hulls", "0"], "--hulls"),
        (&["head:1500", "--cell", "0.01", "--cells", "10"], "cannot be used with"),
    ];
    for (arguments, words) in cases {
        let out = folder.path().join("out");
        let output = prepare(&folder.path().join("cache"), &out, arguments);
        let error = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "palpate prepare {arguments:?} printed: {error}");
        assert!(error.contains(words) && error.lines().count() == 1, "{arguments:?}: wrong error: {error}");
        assert!(!out.exists(), "palpate prepare {arguments:?} made the output directory");
    }
}

/// Formats of surfaces, units, and the folder that is written where no other is given.
#[test]
fn a_surface_in_millimetres_is_prepared_without_more_words() {
    let folder = tempfile::tempdir().unwrap();
    let files = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/surface_files");
    for (name, units, metres) in
        [("trimesh.stl", "mm", 1e-3), ("vtk-big.ply", "cm", 1e-2), ("trimesh.glb", "in", 0.0254), ("vtk.vtu", "m", 1.0)]
    {
        fs::copy(files.join(name), folder.path().join(name)).unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_palpate"));
        command.args(["prepare", name, "--units", units, "--cells", "4", "--no-pictures"]);
        let output =
            command.current_dir(folder.path()).env("PALPATE_CACHE", folder.path().join("cache")).output().unwrap();
        assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
        let stem = name.split('.').next().unwrap();
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(said.contains(&format!("palpate run {stem}/scene.toml")), "{name}: {said}");
        let report: Value =
            serde_json::from_slice(&fs::read(folder.path().join(stem).join("report.json")).unwrap()).unwrap();
        let volume = report["skin"]["volume_m3"].as_f64().unwrap() / (6.0 * f64::powi(metres, 3));
        assert!((volume - 1.0).abs() < 1e-6, "{name} in {units}: {volume} of the volume");
        assert_eq!(report["notes"], serde_json::json!([]), "{name}");
    }
}
