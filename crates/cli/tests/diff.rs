//! Tests of `palpate diff` in the built program: runs that are the same, that differ, and that cannot be compared.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

const SCENE: &str = "[step]\ndt = 0.004\n[[body]]\nname = \"block\"\n\
    layer = { box = [[-0.03, -0.03, -0.03], [0.03, 0.0, 0.03]], cells = [6, 3, 6] }\n\
    material = { young = 1e4, poisson = 0.45, density = 1000.0, damping_stiffness = 0.002 }\n\
    [[body.core]]\nname = \"table\"\nbind = { box = [[-0.031, -0.031, -0.031], [0.031, -0.0299, 0.031]] }\n\
    [tool]\nsphere = 0.012\nmass = 0.05\nposition = [0.0, 0.0125, 0.0]\n\
    [coupling]\nstiffness = 2000.0\ndamping = 10.0\n\
    [drive]\nkeys = [[0.0, 0.0, 0.0125, 0.0], [0.1, 0.0, 0.004, 0.0]]\n";

fn palpate(folder: &Path, arguments: &[&str]) -> (Option<i32>, String, String) {
    let mut program = Command::new(env!("CARGO_BIN_EXE_palpate"));
    let Output { status, stdout, stderr } = program.current_dir(folder).args(arguments).output().unwrap();
    (status.code(), String::from_utf8(stdout).unwrap(), String::from_utf8(stderr).unwrap())
}

/// Runs a scene for 0.1 s, with a moment of the series every 20 ms.
fn run(folder: &Path, name: &str, scene: &str) {
    fs::write(folder.join("scene.toml"), scene).unwrap();
    let series = format!("{name}/series");
    let arguments = ["run", "scene.toml", "--seconds", "0.1", "--out", name, "--export", &series, "--fps", "50"];
    let (status, _, said) = palpate(folder, &arguments);
    assert_eq!(status, Some(0), "{said}");
}

/// The entry of `diff.json` for a quantity.
fn entry(folder: &Path, quantity: &str) -> Value {
    let text = fs::read_to_string(folder.join("diff.json")).unwrap();
    let all: Vec<Value> = serde_json::from_str(&text).unwrap();
    all.into_iter().find(|entry| entry["quantity"] == quantity).unwrap_or_else(|| panic!("{quantity} is not in {text}"))
}

#[test]
fn runs_are_compared_by_traces_and_fields() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    run(folder, "a", SCENE);
    run(folder, "again", SCENE);
    run(folder, "softer", &SCENE.replace("young = 1e4", "young = 9e3"));
    run(folder, "finer", &SCENE.replace("dt = 0.004", "dt = 0.002"));

    // Two runs of one scene do not differ at all.
    for (a, b) in [("a", "again"), ("a/series", "again/series"), ("a/trace.csv", "again/trace.csv")] {
        let (status, table, said) = palpate(folder, &["diff", a, b]);
        assert_eq!((status, said.as_str()), (Some(0), ""), "{a}: {table}");
    }
    let (_, table, _) = palpate(folder, &["diff", "a/series", "again/series"]);
    for quantity in ["block-layer von_mises_stress", "block-skin Points", "contacts pressure", "tool-skin Points"] {
        assert!(table.contains(quantity), "{quantity} is not in {table}");
    }

    // A block softer by a tenth: the force is less by nearly so much, and beyond a tolerance that is an error.
    let (status, table, said) = palpate(folder, &["diff", "a", "softer", "--tolerance", "0.01", "--out", "d"]);
    assert_eq!(status, Some(4), "{table}");
    assert!(said.contains("error: the runs differ: ") && said.contains("allowed is 1e-2"), "{said}");
    let force = entry(&folder.join("d"), "force");
    let share = force["greatest"].as_f64().unwrap() / force["of"].as_f64().unwrap();
    assert!((0.03..0.11).contains(&share), "the force differs by {share}");
    assert!(force["rms"].as_f64().unwrap() < force["greatest"].as_f64().unwrap() && force["unit"] == "N");
    assert!(fs::read_to_string(folder.join("d/diff.svg")).unwrap().contains("force"));
    let (status, ..) = palpate(folder, &["diff", "a/trace.csv", "softer/trace.csv", "--tolerance", "10"]);
    assert_eq!(status, Some(0));
    let (status, ..) = palpate(folder, &["diff", "a/series", "softer/series", "--tolerance", "0.01", "--out", "s"]);
    assert_eq!(status, Some(4));
    let strain = entry(&folder.join("s"), "block-layer displacement");
    assert!(strain["greatest"].as_f64().unwrap() > 0.0 && strain["unit"] == "m");

    // Shorter steps: the trace is interpolated, and the moments are the same.
    let (status, table, said) = palpate(folder, &["diff", "a", "finer", "--tolerance", "1"]);
    assert_eq!(status, Some(0), "{table}{said}");
    assert!(said.contains("25 and 50 steps; 25 times are compared"), "{said}");
    let files = ["diff", "a/series/block-layer.pvd", "finer/series/block-layer.pvd", "--tolerance", "1"];
    let (status, table, said) = palpate(folder, &files);
    assert_eq!((status, said.as_str()), (Some(0), ""), "{table}");
}

/// A trace of two steps, of which cells can be replaced.
const TRACE: &str = "time_s,tool_x,tool_y,tool_z,force_x,force_y,force_z,contacts,flags\n\
                     0.1,0,0,0,1,0,0,3,0\n0.2,0,0,1e-18,2,0,0,3,0\n";

#[test]
fn what_is_infinite_or_missing_is_a_difference() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("a.csv"), TRACE).unwrap();
    for (from, to, wanted) in [
        // The first run, or the second, has diverged.
        ("0.2,0,0,1e-18,2", "0.2,0,0,1e-18,inf", "force by inf of its greatest value"),
        ("0.2,0,0,1e-18,2", "0.2,0,0,1e-18,1e200", "force by "),
        ("0.2,0,0,1e-18,2", "0.2,0,0,1e-18,NaN", "the runs differ in what they have"),
        ("0.2,0,0,1e-18,2", "0.2,0,0,1e-18,", "the runs differ in what they have"),
        ("2,0,0,3,0\n", "2,0,0,,0\n", "contacts: a value is missing or no number"),
        ("contacts", "counts", "the runs differ in what they have"),
        ("3,0\n0.2", "3,16\n0.2", "the runs differ in what they have"),
        ("0.2,0,0,1e-18,2,0,0,3,0\n", "0.2,0,0,1e-18,2,0,0,3,0\n0.9,0,0,0,2,0,0,3,0\n", "the runs differ in what"),
    ] {
        let other = TRACE.replace(from, to);
        assert_ne!(other, TRACE);
        fs::write(folder.join("b.csv"), other).unwrap();
        for pair in [["a.csv", "b.csv"], ["b.csv", "a.csv"]] {
            let (status, table, said) = palpate(folder, &[&["diff"], &pair[..], &["--out", "d"]].concat());
            assert!(status == Some(4) && said.contains("error: the runs differ"), "{pair:?}, {to}: {table}{said}");
            let one_way = pair[0] == "a.csv";
            assert!(!one_way || said.contains(wanted), "{pair:?}, {to}: {said}");
            assert!(!table.contains("NaN") && folder.join("d/diff.svg").exists(), "{table}");
        }
    }
    // What moves by less than can be told is not measured against rounding.
    fs::write(folder.join("b.csv"), TRACE.replace("1e-18", "1e-12")).unwrap();
    let (status, table, said) = palpate(folder, &["diff", "a.csv", "b.csv", "--tolerance", "1e-5"]);
    assert_eq!(status, Some(0), "{table}{said}");
}

/// A grid without cells, with positions, vertices, and one more array.
fn grid(vertices: &str, points: &str, name: &str, numbers: &str) -> String {
    let count = vertices.split(' ').filter(|word| !word.is_empty()).count();
    let array = |kind: &str, name: &str, components: usize, numbers: &str| {
        format!(
            "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"ascii\">{numbers}</DataArray>"
        )
    };
    let zeros = vec!["0"; count].join(" ");
    let keys = ["body", "other_body"].map(|name| array("Int32", name, 1, &zeros)).concat();
    format!(
        "<VTKFile type=\"UnstructuredGrid\"><UnstructuredGrid><Piece NumberOfPoints=\"{count}\" NumberOfCells=\"0\"><PointData>\
         {keys}{}{}</PointData><Points>{}</Points></Piece></UnstructuredGrid></VTKFile>",
        array("Int32", "vertex", 1, vertices),
        array("Float32", name, 1, numbers),
        array("Float64", "Points", 3, points),
    )
}

#[test]
fn contacts_are_matched_by_their_vertices() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for (name, text) in [
        ("a", grid("4 7 7", "0 0 0 1 0 0 1 1 0", "depth", "1 2 3")),
        // This run has the contacts of the first one in another order, and one that is new.
        ("b", grid("7 9 4 7", "1 0 0 5 5 5 0 0 0 1 1 0", "depth", "2 0.5 1 3")),
        ("c", grid("4 7 7", "0 0 0 1 0 0 1 1 0", "height", "1 2 3")),
    ] {
        fs::write(folder.join(format!("{name}.vtu")), text).unwrap();
        let list = format!(
            "<VTKFile type=\"Collection\"><Collection><DataSet timestep=\"0\" file=\"{name}.vtu\"/></Collection></VTKFile>"
        );
        fs::write(folder.join(format!("{name}.pvd")), list).unwrap();
    }
    let (status, table, said) = palpate(folder, &["diff", "a.pvd", "b.pvd", "--out", "d"]);
    assert!(status == Some(4) && said.contains("a depth by 1.667e-1 of its greatest value"), "{table}{said}");
    let depth = entry(&folder.join("d"), "a depth");
    assert_eq!((depth["greatest"].as_f64(), depth["of"].as_f64()), (Some(0.5), Some(3.0)));
    assert_eq!(entry(&folder.join("d"), "a Points")["greatest"].as_f64(), Some(0.0));
    let (status, _, said) = palpate(folder, &["diff", "a.pvd", "c.pvd", "--tolerance", "1"]);
    assert!(status == Some(4) && said.contains("a: only the first run has depth, at 1 of 1 moments"), "{said}");
    assert!(said.contains("a: only the second run has height"), "{said}");
}

#[test]
fn what_cannot_be_compared_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for name in ["empty", "other"] {
        fs::create_dir(folder.join(name)).unwrap();
    }
    let list = |time: &str, file: &str| {
        format!(
            "<VTKFile type=\"Collection\"><Collection><DataSet timestep=\"{time}\" file=\"{file}\"/></Collection></VTKFile>"
        )
    };
    for (name, text) in [
        ("a.pvd", list("0.1", "none.vtu")),
        ("b.pvd", list("0.2", "none.vtu")),
        ("c.pvd", list("soon", "none.vtu")),
        ("d.pvd", "<VTKFile".into()),
        ("a.csv", "time_s,contacts\n0.1,1\n".into()),
        ("b.csv", "time_s,contacts\n0.2,1\n".into()),
        ("c.csv", "time_s,contacts\n0.1,x\n".into()),
    ] {
        fs::write(folder.join(name), text).unwrap();
    }
    for (arguments, wanted) in [
        (["empty", "other"], "have nothing to compare: give two directories with a trace.csv"),
        (["nowhere", "other"], "nowhere: does not exist; give a directory of results, a trace or a .pvd file"),
        (["a.csv", "a.pvd"], "have nothing to compare"),
        (["a.pvd", "b.pvd"], "a.pvd: has no moment in common with b.pvd; export both runs at the same times"),
        (["a.pvd", "a.pvd"], "none.vtu: cannot be read"),
        (["a.pvd", "c.pvd"], "c.pvd:1: has no timestep"),
        (["a.pvd", "d.pvd"], "d.pvd:1: is no XML"),
        (["a.csv", "b.csv"], "a.csv: has no time in common with b.csv"),
        (["a.csv", "c.csv"], "c.csv:2: \"x\" is no number; give a trace.csv"),
    ] {
        let (status, _, said) = palpate(folder, &[&["diff"], &arguments[..]].concat());
        assert_eq!(status, Some(2), "{arguments:?}: {said}");
        assert!(said.contains(wanted) && said.lines().count() == 1, "{arguments:?}: {said}");
    }
    let (status, _, said) = palpate(folder, &["diff", "a.csv", "a.csv", "--tolerance", "-1"]);
    assert!(status == Some(2) && said.contains("give a number that is not negative"), "{said}");
}
