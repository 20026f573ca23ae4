//! A Vulkan device that is lost under way: each command that simulates says so, with the stages of the work that was
//! under way, ends, and leaves nothing half-written.
#![cfg(unix)]

use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use palpate::Error;
use palpate::internal::gpu::FAULTS;
use palpate_devices::record::Recorded;

const SCENE: &str = "[[body]]\nname = \"block\"\nlayer = { box = [[0, 0, 0], [0.04, 0.04, 0.04]], cells = [2, 2, 2] }\n\
                     material = { young = 2e4, poisson = 0.4, density = 1000.0 }\n\
                     [tool]\nsphere = 0.01\nmass = 0.05\nposition = [0.02, 0.055, 0.02]\n\
                     [drive]\nkeys = [[0.0, 0.02, 0.055, 0.02], [1.0, 0.02, 0.04, 0.02]]\n";
/// Longest time that a command may take to begin.
const PATIENCE: Duration = Duration::from_secs(120);

/// Waits until a file has content, and loses the device. Gives up when the command has ended.
fn lose_when_begun(file: &Path, has_ended: &AtomicBool) {
    let begun = Instant::now();
    while !fs::metadata(file).is_ok_and(|facts| facts.len() > 0) {
        if has_ended.load(Ordering::Relaxed) {
            return;
        }
        assert!(begun.elapsed() < PATIENCE, "{} was not begun", file.display());
        std::thread::sleep(Duration::from_millis(5));
    }
    FAULTS.lose_devices();
}

#[test]
fn a_lost_device_ends_every_command_with_the_stages_under_way() {
    FAULTS.concern_contexts_of_this_thread();
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    fs::write(path("scene.toml"), SCENE).unwrap();
    let (scene, out, ticks) = (path("scene.toml"), path("out"), path("ticks"));
    // What may stay is a recording, which is read up to its end.
    let commands: &[(&[&str], &str)] = &[
        (&["run", &scene, "--seconds", "3600", "--out", &out], "trace.csv"),
        (
            &["run", &scene, "--haptics", "scripted", "--seconds", "3600", "--record", &ticks, "--out", &out],
            "trace.csv",
        ),
        #[cfg(feature = "view")]
        (&["film", &scene, "--seconds", "3600", "--size", "64x48", "--out", &out], "frame-00000.png"),
    ];
    for &(command, begun) in commands {
        FAULTS.arm(None, 0);
        let begun = Path::new(&out).join(".palpate-unfinished").join(begun);
        let has_ended = AtomicBool::new(false);
        let ended = std::thread::scope(|scope| {
            scope.spawn(|| lose_when_begun(&begun, &has_ended));
            let ended = palpate_cli::command(std::iter::once("palpate").chain(command.iter().copied()));
            has_ended.store(true, Ordering::Relaxed);
            ended
        });
        let error = ended.expect_err("a command succeeded on a device that was lost");
        let text = error.to_string();
        assert!(matches!(error, Error::Vulkan { .. }) && error.exit_status() == 4, "{command:?} said: {text}");
        assert!(text.contains(" failed in stage") && text.ends_with("the device was lost"), "{command:?} said: {text}");
        if fs::exists(&ticks).unwrap() {
            assert!(Recorded::open(Path::new(&ticks)).unwrap().map(Result::unwrap).count() > 10);
            fs::remove_file(&ticks).unwrap();
        }
        let left: Vec<_> = fs::read_dir(folder.path()).unwrap().flatten().map(|entry| entry.path()).collect();
        assert_eq!(left, [Path::new(&scene)], "left after {command:?}");
    }
}
