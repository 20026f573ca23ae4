//! Tests of how the built program ends: by a signal (what was done is kept and marked, or nothing is left), on a disk
//! that is full, and where another run writes into the same directory or was killed there.
#![cfg(unix)]

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

/// A block of gelatine that falls for an hour of simulated time.
const SCENE: &str = "[[body]]\nname = \"block\"\nlayer = { box = [[0, 0, 0], [0.04, 0.04, 0.04]], cells = [2, 2, 2] }\n\
                     material = { young = 2e4, poisson = 0.4, density = 1000.0 }\n";
/// Longest time that a run may take to begin, or to end after a signal.
const PATIENCE: Duration = Duration::from_secs(120);

fn start(arguments: &[&str]) -> Child {
    let mut program = Command::new(env!("CARGO_BIN_EXE_palpate"));
    program.args(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

fn until(what: &str, holds: impl Fn() -> bool) {
    let begun = Instant::now();
    while !holds() {
        assert!(begun.elapsed() < PATIENCE, "{what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

fn send(signal: &str, program: &Child) {
    assert!(Command::new("kill").args([signal, &program.id().to_string()]).status().unwrap().success());
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Starts a run of an hour into `out`, and returns it when its trace has begun.
fn begun(scene: &Path, out: &Path) -> Child {
    fs::write(scene, SCENE).unwrap();
    let program = start(&["run", scene.to_str().unwrap(), "--seconds", "3600", "--out", out.to_str().unwrap()]);
    let trace = out.join(".palpate-unfinished/trace.csv");
    until("the run writes no trace", || fs::metadata(&trace).is_ok_and(|facts| facts.len() > 0));
    program
}

#[test]
fn a_run_that_is_interrupted_keeps_what_was_done_and_says_so() {
    for signal in ["-INT", "-TERM"] {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        let program = begun(&folder.path().join("scene.toml"), &out);
        send(signal, &program);
        let Output { status, stderr, .. } = program.wait_with_output().unwrap();
        let said = String::from_utf8(stderr).unwrap();
        assert_eq!(status.code(), Some(4), "the program said: {said}");
        assert!(said.contains("interrupted after ") && said.contains(" of 3600000 steps"), "it said: {said}");
        assert_eq!(names(&out), ["block.obj", "block.vtk", "report.html", "summary.json", "trace.csv"]);
        let summary: Value = serde_json::from_str(&fs::read_to_string(out.join("summary.json")).unwrap()).unwrap();
        assert!(summary["interrupted"].as_str().unwrap().starts_with("interrupted after "));
        let rows = fs::read_to_string(out.join("trace.csv")).unwrap().lines().count() as u64 - 1;
        assert_eq!(summary["steps"], rows);
        assert!(fs::read_to_string(out.join("report.html")).unwrap().contains("The run was interrupted after"));
    }
}

#[test]
fn a_signal_that_is_ignored_stays_ignored() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, out) = (folder.path().join("scene.toml"), folder.path().join("out"));
    fs::write(&scene, SCENE).unwrap();
    let mut program = Command::new("sh");
    program.args(["-c", "trap '' HUP; exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_palpate"), "run"]);
    program.args([&scene, Path::new("--seconds"), Path::new("3600"), Path::new("--out"), &out]);
    let program = program.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let trace = out.join(".palpate-unfinished/trace.csv");
    let length = || fs::metadata(&trace).map_or(0, |facts| facts.len());
    until("the run writes no trace", || length() > 0);
    send("-HUP", &program);
    let before = length();
    until("the run has ended", || length() > before + 10_000);
    send("-TERM", &program);
    let said = String::from_utf8(program.wait_with_output().unwrap().stderr).unwrap();
    assert!(said.contains("interrupted after ") && said.contains("what was done is in"), "it said: {said}");
}

#[test]
fn what_cannot_be_kept_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.toml");
    fs::write(&scene, SCENE).unwrap();
    let out = folder.path().join("made/out");
    let commands: [&[&str]; 2] = [
        &["prepare", "head", "--no-cache", "--cells", "100", "--out"],
        &["film", scene.to_str().unwrap(), "--seconds", "3600", "--out"],
    ];
    for command in commands {
        let program = start(&[command, &[out.to_str().unwrap()]].concat());
        until("the directory is not made", || out.join(".palpate-unfinished/lock").exists());
        send("-TERM", &program);
        let ended = program.wait_with_output().unwrap();
        assert!(!ended.status.success(), "{command:?} ended with {}", ended.status);
        assert_eq!(names(folder.path()), ["scene.toml"], "after {command:?}");
    }
}

#[test]
fn a_directory_is_written_by_one_run_and_freed_when_that_is_killed() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, out) = (folder.path().join("scene.toml"), folder.path().join("out"));
    let mut program = begun(&scene, &out);
    let [scene, folder_of] = [&scene, &out].map(|path| path.to_str().unwrap());
    let second = ["run", scene, "--steps", "2", "--out", folder_of];
    let refused = start(&second).wait_with_output().unwrap();
    let said = String::from_utf8(refused.stderr).unwrap();
    assert_eq!(refused.status.code(), Some(2), "it said: {said}");
    assert!(said.contains("another run is writing there now") && said.lines().count() == 1, "it said: {said}");
    program.kill().unwrap();
    program.wait().unwrap();
    assert!(out.join(".palpate-unfinished").exists());
    let ended = start(&second).wait_with_output().unwrap();
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
    assert_eq!(names(&out), ["block.obj", "block.vtk", "report.html", "summary.json", "trace.csv"]);
}

/// Runs the program where no file may grow beyond a number of blocks of 512 bytes.
fn with_room(blocks: u32, arguments: &[&str]) -> Output {
    let words = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" \"$@\"");
    Command::new("sh").args(["-c", &words, env!("CARGO_BIN_EXE_palpate")]).args(arguments).output().unwrap()
}

#[test]
fn a_full_disk_is_one_message_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.toml");
    fs::write(&scene, SCENE).unwrap();
    let out = folder.path().join("made/out");
    let (scene, out) = (scene.to_str().unwrap(), out.to_str().unwrap());
    let commands: [(&[&str], &[u32]); 3] = [
        (&["run", scene, "--steps", "300", "--out", out], &[1, 2, 4, 8, 16, 32, 64]),
        (&["prepare", "head:1000", "--no-cache", "--out", out], &[1, 16, 128]),
        (&["run", scene, "--explain", "--out", out], &[1]),
    ];
    let mut failed = 0;
    for (command, sizes) in commands {
        for blocks in sizes {
            let Output { status, stderr, .. } = with_room(*blocks, command);
            let said = String::from_utf8(stderr).unwrap();
            if status.success() {
                fs::remove_dir_all(folder.path().join("made")).unwrap();
                continue;
            }
            failed += 1;
            // A device in software may keep its memory in files too.
            assert!([Some(2), Some(4)].contains(&status.code()), "{command:?}, {blocks} blocks: {status}, {said}");
            let errors = said.lines().filter(|line| !line.starts_with("note: ")).count();
            assert!(errors == 1 && !said.contains("panicked"), "{command:?}, {blocks} blocks: it said {said}");
            assert_eq!(names(folder.path()), ["scene.toml"], "after {command:?} with {blocks} blocks");
        }
    }
    assert!(failed >= 8, "only {failed} commands failed for want of room");
}
