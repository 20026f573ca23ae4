//! Tests of `palpate fit`: a modulus is found from a curve that the program itself simulated, and a curve that no modulus
//! gives, and mistakes in files and keys, are said in one line.

use std::fmt::Write;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

/// A sphere that presses into a soft block; `YOUNG` stands for its modulus.
const SCENE: &str = "
step = { dt = 0.004, gravity = [0.0, 0.0, 0.0] }
tool = { sphere = 0.01, mass = 0.05, position = [0.0, 0.0105, 0.0] }
coupling = { stiffness = 1000.0, damping = 10.0 }
[drive]
keys = [[0.0, 0.0, 0.0105, 0.0], [0.2, 0.0, 0.005, 0.0]]
[[body]]
name = \"pad\"
layer = { box = [[-0.03, -0.02, -0.03], [0.03, 0.0, 0.03]], cells = [6, 3, 6] }
material = { young = YOUNG, poisson = 0.4, density = 1000.0, damping_stiffness = 0.001 }
[[body.core]]
name = \"table\"
bind = { box = [[-1.0, -1.0, -1.0], [1.0, -0.019, 1.0]] }
";

fn palpate(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_palpate"));
    command.current_dir(folder).env("PALPATE_CACHE", folder.join("cache")).args(arguments).output().unwrap()
}

/// Writes a scene and a curve of force over time, which a simulation with 13 kPa gives.
fn measure(folder: &Path) {
    fs::write(folder.join("truth.toml"), SCENE.replace("YOUNG", "13e3")).unwrap();
    fs::write(folder.join("scene.toml"), SCENE.replace("YOUNG", "30e3")).unwrap();
    let done = palpate(folder, &["run", "truth.toml", "--out", "truth"]);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let mut trace = csv::Reader::from_path(folder.join("truth/trace.csv")).unwrap();
    let heads = trace.headers().unwrap().clone();
    let column = |name: &str| heads.iter().position(|head| head == name).unwrap();
    let columns = ["time_s", "force_x", "force_y", "force_z"].map(column);
    let mut curve = String::from("time (s),force (N)\n");
    for row in trace.records().map(Result::unwrap) {
        let [time, x, y, z] = columns.map(|column| row[column].parse::<f64>().unwrap());
        writeln!(curve, "{time},{}", x.hypot(y).hypot(z)).unwrap();
    }
    fs::write(folder.join("curve.csv"), curve).unwrap();
}

#[test]
fn a_modulus_is_found_and_a_curve_that_none_gives_is_said_so() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    measure(folder);
    let free = ["--free", "body.material.young"];
    let done = palpate(folder, &[&["fit", "scene.toml", "--data", "curve.csv", "--out", "fit"], &free[..]].concat());
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let fit: serde_json::Value = serde_json::from_slice(&fs::read(folder.join("fit/fit.json")).unwrap()).unwrap();
    let young = fit["estimates"][0]["value"].as_f64().unwrap();
    assert!((young / 13e3 - 1.0).abs() < 0.005, "{young} Pa");
    assert!(fit["simulations"].as_u64().unwrap() <= 15 && fit["verdict"] == "fits");
    for file in ["curve.csv", "report.html"] {
        assert!(folder.join("fit").join(file).exists(), "{file}");
    }

    // A force that falls while the tool presses.
    let falling: String =
        (0..40).map(|k| format!("{},{}\n", 0.005 * f64::from(k), 1.0 - 0.02 * f64::from(k))).collect();
    fs::write(folder.join("falling.csv"), format!("time (s),force (N)\n{falling}")).unwrap();
    let done = palpate(folder, &[&["fit", "scene.toml", "--data", "falling.csv"], &free[..]].concat());
    let said = String::from_utf8_lossy(&done.stderr).into_owned();
    assert!(done.status.code() == Some(4) && said.contains("no value"), "{said}");

    for (arguments, part) in [
        (["scene.toml", "--data", "none.csv", "--free", "body.material.young"], "none.csv: cannot be read"),
        (["scene.toml", "--data", "scene.toml", "--free", "body.material.young"], "no column is called time"),
        (["scene.toml", "--data", "curve.csv", "--free", "body.material.yung"], "body.material.yung"),
        (["scene.toml", "--data", "curve.csv", "--free", "body.name"], "has no number"),
        (["none.toml", "--data", "curve.csv", "--free", "body.material.young"], "none.toml"),
    ] {
        let done = palpate(folder, &[&["fit"], &arguments[..]].concat());
        let said = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(done.status.code() == Some(2) && said.contains(part) && said.trim().lines().count() == 1, "{said}");
    }
}
