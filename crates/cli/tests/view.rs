//! Tests of the window of `palpate view` on an X server without a screen (Xvfb): the mouse moves the tool (the rigid
//! body that a haptic device or the mouse leads), and the window is resized, hidden and closed.
#![cfg(all(unix, feature = "view"))]

#[allow(dead_code, reason = "shared with the test of the book")]
#[path = "display/mod.rs"]
mod display;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::time::Duration;

use display::Display;

/// A scene in which the tool, a ball of 50 g, is close above a soft block.
const SCENE: &str = "[step]\ngravity = [0.0, 0.0, 0.0]\n[[body]]\nname = \"block\"\n\
    layer = { box = [[-0.05, -0.03, -0.05], [0.05, 0.03, 0.05]], cells = [4, 3, 4] }\n\
    material = { young = 2e4, poisson = 0.45, density = 1000.0 }\n\
    [[body.core]]\nname = \"bottom\"\nbind = { box = [[-0.06, -0.04, -0.06], [0.06, -0.029, 0.06]] }\n\
    [tool]\nsphere = 0.02\nmass = 0.05\nposition = [0.0, 0.053, 0.0]\n\
    [coupling]\nstiffness = 500.0\ndamping = 5.0\nangular_stiffness = 0.5\nangular_damping = 0.005\n\
    [drive]\nkeys = [[0.0, 0.0, 0.053, 0.0], [0.1, 0.0, 0.043, 0.0]]\n";

fn scene(folder: &Path) -> PathBuf {
    let file = folder.join("scene.toml");
    fs::write(&file, SCENE).unwrap();
    file
}

/// Waits until the program ends; returns exit status, standard output and standard error.
fn end(program: Child) -> (Option<i32>, String, String) {
    let output = program.wait_with_output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (output.status.code(), text(output.stdout), text(output.stderr))
}

/// The values of a column, row by row; `trace` is the text of a `trace.csv`, `head` the column's heading.
fn column(trace: &str, head: &str) -> Vec<f64> {
    let mut lines = trace.lines();
    let at = lines.next().unwrap().split(',').position(|name| name == head).unwrap();
    lines.map(|line| line.split(',').nth(at).unwrap().parse().unwrap()).collect()
}

fn pause(seconds: f64) {
    std::thread::sleep(Duration::from_secs_f64(seconds));
}

#[test]
#[ignore = "long: 10 s"]
fn the_mouse_presses_a_body_in_a_window_that_is_resized_hidden_and_closed() {
    let (folder, display) = (tempfile::tempdir().unwrap(), Display::start());
    let (file, out) = (scene(folder.path()), folder.path().join("out"));
    let [file, out_name] = [&file, &out].map(|path| path.to_str().unwrap());
    let arguments = ["view", file, "--size", "800x600", "--out", out_name, "--validation"];
    let mut program = display.program(&arguments).spawn().unwrap();
    let id = display.window("palpate: scene", &mut program);
    pause(3.0);
    display.xdotool(&["windowfocus", &id]);
    // The tool is dragged down into the block, where it stays.
    display.xdotool(&["mousemove", "--window", &id, "300", "200", "mousedown", "1"]);
    for _ in 0..8 {
        display.xdotool(&["mousemove_relative", "--", "0", "6"]);
        pause(0.1);
    }
    pause(0.5);
    display.xdotool(&["key", "s"]);
    pause(0.5);
    display.xdotool(&["mouseup", "1"]);
    // The camera orbits and zooms in.
    display.xdotool(&["mousedown", "3", "mousemove_relative", "--", "40", "10", "mouseup", "3", "click", "4"]);
    for key in ["1", "h", "Left", "space", "period", "space"] {
        display.xdotool(&["key", key]);
        pause(0.2);
    }
    for size in [["500", "400"], ["1000", "700"], ["301", "203"]] {
        display.xdotool(&["windowsize", &id, size[0], size[1]]);
        pause(0.4);
    }
    display.xdotool(&["windowunmap", &id]);
    pause(0.5);
    display.xdotool(&["windowmap", &id]);
    pause(0.5);
    display.xdotool(&["windowfocus", &id]);
    display.xdotool(&["key", "r"]);
    pause(0.3);
    assert!(program.try_wait().unwrap().is_none(), "the program must still be running");
    // The window must close at whatever moment of a simulation step the key is pressed.
    display.xdotool(&["key", "Escape"]);
    let (status, text, stderr) = end(program);
    assert_eq!(status, Some(0), "standard error: {stderr}");
    let trace = fs::read_to_string(out.join("trace.csv")).unwrap();
    let (contacts, force) = (column(&trace, "contacts"), column(&trace, "force_y"));
    assert_eq!(contacts[0], 0.0, "nothing may touch in the first step");
    assert!(
        contacts.iter().any(|count| *count > 0.0) && force.iter().any(|newton| *newton > 0.01),
        "the tool must press the block; output {text}, errors {stderr}"
    );
    assert!(text.contains("image: "), "output {text}, errors {stderr}");
    let picture = out.join("scene-1.png");
    let reader = png::Decoder::new(std::io::BufReader::new(fs::File::open(picture).unwrap())).read_info().unwrap();
    assert_eq!((reader.info().width, reader.info().height), (800, 600));
}

#[test]
#[ignore = "long: 10 s"]
fn the_key_tab_chooses_the_tool_that_the_mouse_moves() {
    let (folder, display) = (tempfile::tempdir().unwrap(), Display::start());
    let (file, out) = (folder.path().join("two.toml"), folder.path().join("out"));
    // Beside the two balls, the tools, over the ground, a third follows its `drive`.
    let driven = "[[body]]\nname = \"c\"\nsurface = { model = \"sphere\", vertices = 100 }\nscale = 0.01\n\
        motion = \"dynamic\"\nmass = 0.05\nposition = [0.09, 0.0101, 0.0]\n[[tool]]\nname = \"driven\"\nbody = \"c\"\n\
        coupling = { stiffness = 500, damping = 5, angular_stiffness = 1, angular_damping = 0.01 }\n\
        drive = { keys = [[0.0, 0.09, 0.0101, 0.0], [0.1, 0.09, 0.0061, 0.0]] }\n";
    let scene = include_str!("../../../tests/two_tools.toml").to_owned() + driven;
    fs::write(&file, scene).unwrap();
    let [file, out_name] = [&file, &out].map(|path| path.to_str().unwrap());
    let arguments = ["view", file, "--size", "800x600", "--out", out_name, "--validation"];
    let mut program = display.program(&arguments).spawn().unwrap();
    let id = display.window("palpate: two", &mut program);
    pause(3.0);
    display.xdotool(&["windowfocus", &id]);
    let drag = |by: &str| {
        display.xdotool(&["mousemove", "--window", &id, "300", "200", "mousedown", "1"]);
        for _ in 0..8 {
            display.xdotool(&["mousemove_relative", "--", "0", by]);
            pause(0.1);
        }
        display.xdotool(&["mouseup", "1"]);
        pause(0.5);
    };
    display.xdotool(&["key", "Tab"]);
    drag("4");
    // The third tool is held by none, so that the first comes after it.
    display.xdotool(&["key", "Tab", "key", "Tab"]);
    drag("2");
    display.xdotool(&["key", "Escape"]);
    let (status, text, stderr) = end(program);
    assert_eq!(status, Some(0), "standard error: {stderr}");
    assert!(text.contains("haptic loop of left") && text.contains("haptic loop of right"), "{text}");
    let trace = fs::read_to_string(out.join("trace.csv")).unwrap();
    let height = |head: &str| column(&trace, head);
    let [left, right, driven] = ["device_y", "right:device_y", "driven:device_y"].map(height);
    let began = |heights: &[f64]| heights.iter().position(|y| *y < 0.0095).unwrap_or(usize::MAX);
    assert!(
        began(&right) < began(&left) && began(&left) < usize::MAX,
        "the second tool is to be moved before the first"
    );
    assert!((driven.last().unwrap() - 0.0061).abs() < 1e-6, "the third follows its drive: {:?}", driven.last());
    let forces = ["force_y", "right:force_y", "driven:force_y"].map(|head| *height(head).last().unwrap());
    assert!(forces.iter().all(|newton| *newton > 0.1), "forces at the end, N: {forces:?}");
}

#[test]
fn with_the_window_the_trace_is_that_of_a_run() {
    let (folder, display) = (tempfile::tempdir().unwrap(), Display::start());
    let file = scene(folder.path());
    let (run, view) = (folder.path().join("run"), folder.path().join("view"));
    let [file, run_name, view_name] = [&file, &run, &view].map(|path| path.to_str().unwrap());
    let done = end(display.program(&["run", file, "--steps", "200", "--out", run_name]).spawn().unwrap());
    assert_eq!(done.0, Some(0), "standard error of palpate run: {}", done.2);
    let arguments = ["view", file, "--device", "drive", "--steps", "200", "--size", "320x240", "--out", view_name];
    let done = end(display.program(&arguments).spawn().unwrap());
    assert_eq!(done.0, Some(0), "standard error of palpate view: {}", done.2);
    let [run, view] = [run, view].map(|folder| fs::read_to_string(folder.join("trace.csv")).unwrap());
    // All columns but those of times.
    let kept: Vec<bool> = run.lines().next().unwrap().split(',').map(|name| !name.ends_with("_us")).collect();
    assert_eq!(kept.iter().filter(|kept| !**kept).count(), 2, "columns of times: step_us and gpu_us");
    let bits = |trace: &str| -> Vec<String> {
        let cells = |line: &str| {
            let cells = line.split(',').enumerate().filter(|(k, _)| kept[*k]);
            cells.map(|(_, cell)| cell).collect::<Vec<_>>().join(",")
        };
        trace.lines().map(cells).collect()
    };
    assert_eq!(bits(&run).len(), 201);
    assert!(column(&run, "contacts").iter().any(|count| *count > 0.0), "the tool must touch the block");
    assert_eq!(bits(&run), bits(&view));
}

#[test]
fn a_signal_closes_it_in_order() {
    let (folder, display) = (tempfile::tempdir().unwrap(), Display::start());
    let file = scene(folder.path());
    let mut program = display.program(&["view", file.to_str().unwrap(), "--validation"]).spawn().unwrap();
    display.window("palpate: scene", &mut program);
    pause(1.0);
    let sent = Command::new("kill").args(["-TERM", &program.id().to_string()]).status().unwrap();
    assert!(sent.success());
    let (status, _, stderr) = end(program);
    assert_eq!(status, Some(0), "standard error: {stderr}");
}

#[test]
fn without_a_display_one_line_names_the_film() {
    let folder = tempfile::tempdir().unwrap();
    let file = scene(folder.path());
    let mut command = Command::new(env!("CARGO_BIN_EXE_palpate"));
    command.args(["view", file.to_str().unwrap()]).env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY");
    let output = command.env_remove("WAYLAND_SOCKET").output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!((output.status.code(), stderr.lines().count()), (Some(3), 1), "standard error: {stderr}");
    let film = format!("palpate film {} --out film.apng", file.display());
    assert!(stderr.contains("no display") && stderr.contains(&film), "standard error: {stderr}");
}

#[test]
fn a_profile_is_refused_where_no_haptic_device_could_have_it() {
    let folder = tempfile::tempdir().unwrap();
    let file = scene(folder.path());
    let cases = [
        ("mouse", "touch", "the tool is moved by `mouse`: give --device DEVICE as well"),
        ("drive", "touch", "the tool is moved by `drive`: give --device DEVICE as well"),
        ("haply", "touch", "--profile touch is not that of a Haply: remove it, or give inverse3 or minverse"),
        ("hand", "omni", "possible values: scripted, premium, touch"),
    ];
    for (device, profile, words) in cases {
        let mut command = Command::new(env!("CARGO_BIN_EXE_palpate"));
        command.args(["view", file.to_str().unwrap(), "--device", device, "--profile", profile]);
        let output = command.output().unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!((output.status.code(), stderr.lines().count()), (Some(2), 1), "standard error: {stderr}");
        assert!(stderr.contains(words), "device {device}, profile {profile}: wrong error: {stderr}");
    }
}
