//! Tests of `palpate run --export` in the built program: files at the times that were asked for, with the state that the
//! run's other results have; the same bytes each time; a run that is not changed by it; clear errors.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use roxmltree::Document;

/// A ball that is pressed into a block beside a rigid one that stays.
const SCENE: &str = "[[body]]\nname = \"block\"\n\
    layer = { box = [[-0.03, -0.03, -0.03], [0.03, 0.0, 0.03]], cells = [6, 3, 6] }\n\
    material = { young = 1e4, poisson = 0.45, density = 1000.0, damping_stiffness = 0.002 }\n\
    [[body.core]]\nname = \"table\"\nbind = { box = [[-0.031, -0.031, -0.031], [0.031, -0.0299, 0.031]] }\n\
    [[body]]\nname = \"rock\"\nsurface = \"rock.obj\"\nposition = [0.2, 0.0, 0.0]\n\
    [tool]\nsphere = 0.012\nmass = 0.05\nposition = [0.0, 0.0125, 0.0]\n\
    [coupling]\nstiffness = 2000.0\ndamping = 10.0\n\
    [drive]\nkeys = [[0.0, 0.0, 0.0125, 0.0], [0.1, 0.0, 0.004, 0.0]]\n";
const ROCK: &str = "v 0 0 0\nv 0.01 0 0\nv 0 0.01 0\nv 0 0 0.01\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
/// Error of what is written in single precision, relative to the largest number.
const SINGLE: f64 = 1e-6;

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.toml"), SCENE).unwrap();
    fs::write(folder.path().join("rock.obj"), ROCK).unwrap();
    folder
}

fn run(folder: &Path, arguments: &[&str]) -> Output {
    let mut program = Command::new(env!("CARGO_BIN_EXE_palpate"));
    program.current_dir(folder).args(["run", "scene.toml"]).args(arguments).output().unwrap()
}

fn succeeds(folder: &Path, arguments: &[&str]) {
    let output = run(folder, arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// The files of a folder by their names.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap());
    entries.map(|entry| (entry.file_name().into_string().unwrap(), fs::read(entry.path()).unwrap())).collect()
}

/// Times and names of the files of a series.
fn series(file: &Path) -> Vec<(f64, String)> {
    let text = fs::read_to_string(file).unwrap();
    let document = Document::parse(&text).unwrap();
    let sets = document.descendants().filter(|node| node.has_tag_name("DataSet"));
    sets.map(|set| (set.attribute("timestep").unwrap().parse().unwrap(), set.attribute("file").unwrap().into()))
        .collect()
}

/// Numbers of an array of an uncompressed file.
fn numbers(file: &Path, name: &str) -> Vec<f64> {
    const APPENDED: &[u8] = b"<AppendedData encoding=\"raw\">\n_";
    let all = fs::read(file).unwrap();
    let end = all.windows(APPENDED.len()).position(|window| window == APPENDED).unwrap();
    let text = format!("{}</VTKFile>", std::str::from_utf8(&all[..end]).unwrap());
    let document = Document::parse(&text).unwrap();
    let array = document.descendants().find(|node| node.attribute("Name") == Some(name));
    let array = array.unwrap_or_else(|| panic!("{}: no array {name}", file.display()));
    // The number of bytes comes first.
    let at = end + APPENDED.len() + array.attribute("offset").unwrap().parse::<usize>().unwrap();
    let size = u64::from_le_bytes(all[at..at + 8].try_into().unwrap()) as usize;
    let bytes = &all[at + 8..at + 8 + size];
    match array.attribute("type").unwrap() {
        "Float64" => bytes.chunks(8).map(|x| f64::from_le_bytes(x.try_into().unwrap())).collect(),
        "Float32" => bytes.chunks(4).map(|x| f32::from_le_bytes(x.try_into().unwrap()).into()).collect(),
        "Int32" => bytes.chunks(4).map(|x| i32::from_le_bytes(x.try_into().unwrap()).into()).collect(),
        other => panic!("an array of {other}"),
    }
}

fn vectors(all: &[f64]) -> Vec<[f64; 3]> {
    all.chunks(3).map(|v| v.try_into().unwrap()).collect()
}

fn sum(all: &[[f64; 3]]) -> [f64; 3] {
    std::array::from_fn(|k| all.iter().map(|v| v[k]).sum())
}

fn near(what: &str, got: &[f64], wanted: &[f64]) {
    let size = wanted.iter().fold(1e-30f64, |size, x| size.max(x.abs()));
    assert_eq!(got.len(), wanted.len(), "{what}");
    let error = got.iter().zip(wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(error <= SINGLE * size, "{what}: {error} off, of {size}");
}

#[test]
fn a_series_has_the_state_of_the_run() {
    let folder = folder();
    let all = ["--steps", "60", "--out", "out", "--export", "series", "--every", "20", "--compression", "0"];
    succeeds(folder.path(), &all);
    let made = folder.path().join("series");
    let names: Vec<String> = files(&made).into_keys().collect();
    let at = |series: &str| [0, 20, 40, 60].map(|step| format!("{series}-{step:06}.vtu"));
    let mut wanted: Vec<String> =
        ["block-layer", "block-skin", "contacts", "tool-skin"].iter().flat_map(|s| at(s)).collect();
    // The rock stays, so that it has one file, which is listed for every moment.
    wanted.push("rock-skin-000000.vtu".into());
    wanted
        .extend(["block-layer", "block-skin", "contacts", "rock-skin", "tool-skin"].map(|name| format!("{name}.pvd")));
    wanted.sort();
    assert_eq!(names, wanted);
    let listed = series(&made.join("block-layer.pvd"));
    let trace = fs::read_to_string(folder.path().join("out/trace.csv")).unwrap();
    let mut table = csv::Reader::from_reader(trace.as_bytes());
    let header = table.headers().unwrap().clone();
    let rows: Vec<csv::StringRecord> = table.records().map(Result::unwrap).collect();
    let cell = |row: &csv::StringRecord, name: &str| -> f64 {
        row[header.iter().position(|column| column == name).unwrap()].parse().unwrap()
    };
    let times: Vec<f64> = listed.iter().map(|(time, _)| *time).collect();
    assert_eq!(times[1..], [19, 39, 59].map(|k: usize| cell(&rows[k], "time_s")));
    assert_eq!(times[0], 0.0);
    assert_eq!(listed.iter().map(|(_, file)| file.clone()).collect::<Vec<_>>(), at("block-layer"));
    assert_eq!(series(&made.join("rock-skin.pvd")).iter().map(|(time, _)| *time).collect::<Vec<_>>(), times);

    // The last moment is the end of the run, as `block.vtk` and `block.obj` have it.
    let layer = made.join("block-layer-000060.vtu");
    let text = fs::read_to_string(folder.path().join("out/block.vtk")).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    let count: usize = lines[4].split(' ').nth(1).unwrap().parse().unwrap();
    let read = |lines: &[&str]| -> Vec<f64> {
        lines.iter().flat_map(|line| line.split(' ').map(|word| word.parse::<f64>().unwrap())).collect()
    };
    near("nodes", &numbers(&layer, "Points"), &read(&lines[5..5 + count]));
    near("displacements", &numbers(&layer, "displacement"), &read(&lines[lines.len() - count..]));
    let obj = fs::read_to_string(folder.path().join("out/block.obj")).unwrap();
    let vertices: Vec<f64> = obj
        .lines()
        .filter_map(|line| line.strip_prefix("v "))
        .flat_map(|line| line.split(' ').map(|word| word.parse::<f64>().unwrap()))
        .collect();
    let skin = made.join("block-skin-000060.vtu");
    near("vertices", &numbers(&skin, "Points"), &vertices);

    // Forces on nodes, on vertices, and of the contacts sum to what the tool feels.
    let felt = ["force_x", "force_y", "force_z"].map(|name| -cell(&rows[59], name));
    assert!(felt[1] < -0.1, "the tool feels {felt:?} N");
    near("forces on nodes", &sum(&vectors(&numbers(&layer, "contact_force"))), &felt);
    near("forces on vertices", &sum(&vectors(&numbers(&skin, "contact_force"))), &felt);
    let contacts = made.join("contacts-000060.vtu");
    let bodies = numbers(&contacts, "body");
    let forces = vectors(&numbers(&contacts, "force"));
    assert_eq!(forces.len(), cell(&rows[59], "contacts") as usize);
    let signed: Vec<[f64; 3]> =
        forces.iter().zip(&bodies).map(|(f, body)| f.map(|x| if *body == 0.0 { x } else { -x })).collect();
    near("forces of contacts", &sum(&signed), &felt);
    let parts = numbers(&contacts, "pressure").into_iter().zip(numbers(&contacts, "area"));
    let pushed: f64 = parts.map(|(pressure, area)| pressure * area).sum();
    let along: f64 = forces
        .iter()
        .zip(vectors(&numbers(&contacts, "normal")))
        .map(|(f, n)| (0..3).map(|k| f[k] * n[k]).sum::<f64>())
        .sum();
    near("pressures", &[along], &[pushed]);
    assert!(numbers(&contacts, "depth").iter().all(|depth| *depth > 0.0));

    // Stresses: what is told of a tensor follows from it.
    let tensors: Vec<Vec<f64>> = numbers(&layer, "cauchy_stress").chunks(6).map(<[f64]>::to_vec).collect();
    let pressures: Vec<f64> = tensors.iter().map(|t| -(t[0] + t[1] + t[2]) / 3.0).collect();
    near("pressures", &numbers(&layer, "hydrostatic_pressure"), &pressures);
    let principal = vectors(&numbers(&layer, "principal_stress"));
    let von_mises: Vec<f64> = principal
        .iter()
        .map(|[a, b, c]| (0.5 * ((a - b).powi(2) + (b - c).powi(2) + (c - a).powi(2))).sqrt())
        .collect();
    near("von Mises stress", &numbers(&layer, "von_mises_stress"), &von_mises);
    let squares: Vec<f64> = tensors
        .iter()
        .map(|t| t[..3].iter().map(|x| x * x).sum::<f64>() + 2.0 * t[3..].iter().map(|x| x * x).sum::<f64>())
        .collect();
    let of_principal: Vec<f64> = principal.iter().map(|p| p.iter().map(|x| x * x).sum()).collect();
    near("principal stress", &of_principal, &squares);
    assert!(von_mises.iter().any(|stress| *stress > 500.0));
    assert!(numbers(&layer, "strain_energy_density").iter().all(|density| *density >= 0.0));
    assert!(numbers(&layer, "least_stretch").iter().all(|stretch| (0.3..1.001).contains(stretch)));
    assert!(numbers(&layer, "velocity").iter().any(|v| v.abs() > 1e-4));
    // At rest there is nothing of all this.
    let first = made.join("block-layer-000000.vtu");
    for name in ["cauchy_stress", "displacement", "velocity", "contact_force", "strain_energy_density"] {
        assert!(numbers(&first, name).iter().all(|x| x.abs() < 1e-12), "{name} at the beginning");
    }
    assert!(numbers(&made.join("contacts-000000.vtu"), "force").is_empty());
}

#[test]
fn a_series_is_the_same_bytes_and_changes_nothing() {
    let folder = folder();
    for (out, series) in [("a", Some("x")), ("b", Some("y")), ("c", None)] {
        let mut arguments = vec!["--steps", "40", "--out", out];
        arguments.extend(series.iter().flat_map(|series| ["--export", series, "--fps", "100"]));
        succeeds(folder.path(), &arguments);
    }
    let [x, y] = ["x", "y"].map(|name| files(&folder.path().join(name)));
    assert!(x.len() > 20 && x == y, "a series has other bytes the second time");
    // A shorter series in the same folder replaces a longer one, and leaves what is not of it; its last moment is written.
    fs::write(folder.path().join("y/block-layer-mine.vtu"), "").unwrap();
    succeeds(folder.path(), &["--steps", "7", "--export", "y", "--every", "5"]);
    let there = files(&folder.path().join("y"));
    let of_layer: Vec<&String> = there.keys().filter(|name| name.starts_with("block-layer-")).collect();
    assert_eq!(
        of_layer,
        ["block-layer-000000.vtu", "block-layer-000005.vtu", "block-layer-000007.vtu", "block-layer-mine.vtu"]
    );
    assert_eq!(series(&folder.path().join("y/contacts.pvd")).len(), 3);
    // But for times that were measured, a trace is the same with a series and without.
    let trace = |out: &str| {
        let text = fs::read_to_string(folder.path().join(out).join("trace.csv")).unwrap();
        let mut table = csv::Reader::from_reader(text.as_bytes());
        let measured: Vec<bool> = table.headers().unwrap().iter().map(|name| name.ends_with("_us")).collect();
        let kept = |row: csv::StringRecord| -> Vec<String> {
            row.iter().zip(&measured).filter(|(_, measured)| !**measured).map(|(cell, _)| cell.into()).collect()
        };
        table.records().map(|row| kept(row.unwrap())).collect::<Vec<_>>()
    };
    assert_eq!(trace("a"), trace("c"));
}

#[test]
fn what_cannot_be_exported_is_refused_and_leaves_nothing() {
    let folder = folder();
    fs::write(folder.path().join("file"), "").unwrap();
    let cases: [(&[&str], i32, &str); 7] = [
        (&["--out", "same", "--export", "same"], 2, "the same directory: give two, such as --export same/series"),
        (&["--out", "same", "--export", "./same"], 2, "the same directory"),
        (&["--export", "series", "--fps", "1e5"], 2, "more than there are steps; give a smaller --fps, or --every 1"),
        (&["--every", "2"], 2, "--export <DIR>"),
        (&["--export", "series", "--every", "2", "--fps", "3"], 2, "cannot be used with"),
        (&["--export", "series", "--every", "0"], 2, "--every"),
        (&["--export", "file/series"], 2, "file/series"),
    ];
    let before = files(folder.path());
    for (arguments, status, wanted) in cases {
        let output = run(folder.path(), arguments);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(status), "{arguments:?}: {said}");
        assert!(said.contains(wanted), "{arguments:?}: {said}");
        assert_eq!(files(folder.path()), before, "{arguments:?} left something");
    }
}

#[test]
fn a_series_that_cannot_be_written_does_not_take_the_results_with_it() {
    let folder = folder();
    fs::create_dir_all(folder.path().join("series/block-layer.pvd")).unwrap();
    let output = run(folder.path(), &["--steps", "10", "--out", "out", "--export", "series"]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(2) && said.contains("block-layer.pvd"), "{said}");
    assert!(folder.path().join("out/trace.csv").exists());
    assert_eq!(fs::read_dir(folder.path().join("series")).unwrap().count(), 1);
}

#[test]
fn a_run_that_fails_leaves_nothing_of_its_series() {
    let folder = folder();
    // The mesh is large enough that files are still to be written when the run fails.
    let scene = SCENE.replace("young = 1e4", "young = 1e30").replace("[6, 3, 6]", "[16, 8, 16]");
    fs::write(folder.path().join("scene.toml"), scene).unwrap();
    let output = run(folder.path(), &["--steps", "3", "--export", "series", "--every", "1", "--compression", "9"]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(4) && said.contains("none of the 3 steps had a finite solution"), "{said}");
    assert!(!folder.path().join("series").exists());
}
