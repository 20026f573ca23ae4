//! Tests of the two commands that lead from a surface to a touch: `palpate prepare` writes a soft body and a scene, and
//! `palpate run` simulates that scene. Another test checks which implementation (path) of the depth stage runs,
//! graphics or compute; this stage finds how deep skins (surface meshes) penetrate each other.

#[path = "../../../tests/real_meshes/mod.rs"]
mod real_meshes;

use std::path::Path;
use std::process::Command;

use real_meshes::meshes;

/// Number of cells of the tetrahedral mesh along its largest extent; less than the default, so that the test is short.
const CELLS: &str = "20";
/// Greatest permitted change of the contact force in a step, as a share of the peak force: a contact that appears or
/// vanishes at once would change the force more.
const JUMP: f64 = 0.1;

fn palpate(arguments: &[&str], cache: &Path) {
    let output =
        Command::new(env!("CARGO_BIN_EXE_palpate")).args(arguments).env("PALPATE_CACHE", cache).output().unwrap();
    assert!(output.status.success(), "palpate {arguments:?} failed: {}", String::from_utf8_lossy(&output.stderr));
}

/// Prepares a surface, runs the prepared scene for 200 steps, in which a sphere is pressed into the body, and checks
/// the forces in the trace (`trace.csv`: a row per step).
fn press(name: &str, surface: &str) {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let (body, out) = (path("body"), path("out"));
    palpate(&["prepare", surface, "--out", &body, "--cells", CELLS, "--no-pictures"], &folder.path().join("cache"));
    palpate(&["run", &format!("{body}/scene.toml"), "--steps", "200", "--out", &out], &folder.path().join("cache"));
    let mut trace = csv::Reader::from_path(folder.path().join("out/trace.csv")).unwrap();
    let headers = trace.headers().unwrap().clone();
    let column = |name: &str| headers.iter().position(|header| header == name).unwrap();
    let axes = ["force_x", "force_y", "force_z"].map(column);
    let mut force = Vec::new();
    for row in trace.records() {
        let row = row.unwrap();
        let f = axes.map(|axis| row[axis].parse::<f64>().unwrap());
        force.push((f[0] * f[0] + f[1] * f[1] + f[2] * f[2]).sqrt());
    }
    let peak = force.iter().copied().fold(0.0, f64::max);
    let jump = force.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
    println!("{name}: peak force {peak:.3} N; greatest change in a step {:.1} % of the peak", 100.0 * jump / peak);
    assert!(force.len() == 200 && force.iter().all(|f| f.is_finite()));
    assert!(peak > 0.01 && jump < JUMP * peak, "{name}: peak force {peak} N, greatest change of force {jump} N");
}

/// A scene in which a ball presses on a block and vertices are tested, for which the depth stage finds ray hits.
const BLOCK: &str = "[contact]\ndepth = \"graphics\"\nsamples = \"vertices\"\n[[body]]\nname = \"block\"\n\
    layer = { box = [[-0.05, -0.05, -0.05], [0.05, 0.0, 0.05]], cells = [6, 3, 6] }\n\
    material = { young = 2e4, poisson = 0.45, density = 1000.0 }\n\
    [[body.core]]\nname = \"core\"\nmotion = \"fixed\"\nbind = { box = [[-1.0, -1.0, -1.0], [1.0, -0.04, 1.0]] }\n\
    [tool]\nsphere = 0.02\nmass = 0.05\nposition = [0.0, 0.018, 0.0]\n";

#[test]
fn the_path_of_depth_is_said_and_the_command_line_wins() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    std::fs::write(path("scene.toml"), BLOCK).unwrap();
    let run = |out: &str, more: &[&str]| {
        let (scene, out_path) = (path("scene.toml"), path(out));
        let arguments = [&["run", &scene, "--steps", "5", "--out", &out_path], more].concat();
        palpate(&arguments, &folder.path().join("cache"));
        let summary = std::fs::read_to_string(folder.path().join(out).join("summary.json")).unwrap();
        let summary: serde_json::Value = serde_json::from_str(&summary).unwrap();
        summary["plan"]["reasons"]["depth"].as_str().unwrap().to_string()
    };
    assert_eq!(run("scene", &[]), "graphics path: asked for");
    assert_eq!(run("asked", &["--depth", "compute"]), "compute path: asked for");
    let measured = run("auto", &["--depth", "auto"]);
    assert!(measured.contains(" path: measured "), "reason for the choice of the path in summary.json: {measured}");
    assert_eq!(
        run("again", &["--depth", "auto"]),
        measured,
        "the second run must reuse the times measured by the first"
    );
}

#[test]
#[ignore = "needs real meshes"]
fn lasting_real_meshes_are_prepared_and_pressed() {
    let Some(folder) = meshes() else { return };
    for name in ["head", "pumpkin", "gear", "human"] {
        press(name, folder.join(format!("surf/{name}.obj")).to_str().unwrap());
    }
}

#[test]
#[ignore = "long: 14 s"]
fn the_models_are_prepared_and_pressed() {
    for name in ["pumpkin:8000", "gear:8000"] {
        press(name, name);
    }
}
