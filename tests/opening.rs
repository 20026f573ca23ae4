//! Tests the side effects of opening a simulation: unless the options ask for it, the function that opens a simulation
//! must write no cache files, make no measurement of the GPU's speed and set no environment variable. Each case runs in
//! a process of its own, since environment variables, caches and threads belong to a process.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use palpate::scene::{Body, Material, Surface, Tool};
use palpate::{Options, SceneBuilder, Simulation, Threads};

/// The environment variable that tells a process started by the test which case it must run.
const CASE: &str = "PALPATE_OPENING";
/// The environment variable from which lavapipe, Mesa's Vulkan driver for CPUs, takes its number of threads.
const THREADS: &str = "LP_NUM_THREADS";

fn open(options: &Options) -> Simulation {
    let block =
        Body::block("block", [-0.03, -0.03, -0.03], [0.03, 0.0, 0.03], [4, 2, 4], Material::new(2e4, 0.45, 1e3));
    let folder = env::temp_dir().join(format!("palpate-opening-{}", std::process::id()));
    fs::create_dir_all(&folder).unwrap();
    let file = folder.join("pyramid.obj");
    fs::write(&file, PYRAMID).unwrap();
    let scene = SceneBuilder::new("opened")
        .body(block)
        .and_then(|builder| builder.tool(Tool::surface(Surface::File(file), 0.1).at([0.0, 0.1, 0.0])))
        .and_then(|builder| builder.build())
        .unwrap();
    let device = env::var("PALPATE_TEST_DEVICE").ok();
    let simulation = Simulation::open(&scene, &Options { device, ..options.clone() });
    fs::remove_dir_all(&folder).unwrap();
    simulation.unwrap()
}

const PYRAMID: &str = "v 0 0 0\nv 0.02 0 0\nv 0 0.02 0\nv 0 0 0.02\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";

/// Runs one case in a process whose cache folder is `home`, and returns the files that the engine has written into its
/// own folder there.
fn kept(case: &str, home: &Path) -> Vec<PathBuf> {
    let mut process = Command::new(env::current_exe().unwrap());
    let test = "opening_a_simulation_keeps_measures_and_sets_only_what_is_asked_for";
    process.args(["--exact", test, "--nocapture"]).env(CASE, case);
    process.env("XDG_CACHE_HOME", home).env("HOME", home).env_remove("PALPATE_CACHE").env_remove(THREADS);
    let output = process.output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(
        output.status.success() && said.contains("1 passed"),
        "case {case} failed: {said}{}",
        String::from_utf8_lossy(&output.stderr)
    );
    // The Vulkan driver's own cache files lie in `home` too, but not in the engine's folder `palpate`.
    let folder = fs::read_dir(home.join("palpate"));
    folder.map(|files| files.map(|file| file.unwrap().path()).collect()).unwrap_or_default()
}

/// Runs a case, in the process that was started for it: `plain` opens a simulation with default options, any other case
/// with options that ask for cache files, a measurement and a number of threads. The kind of arrays is the kind of
/// buffers through which kernels read their arrays; opening may choose it by a measurement of the GPU's speed.
fn run(case: &str) {
    let threads = || env::var(THREADS).ok();
    if case == "plain" {
        let simulation = open(&Options::default());
        assert!(
            !simulation.kind_of_arrays().contains(": measured "),
            "the kind of arrays must be chosen without a measurement: {}",
            simulation.kind_of_arrays()
        );
        assert_eq!(threads(), None);
        return;
    }
    let simulation = open(&Options { threads: Some(Threads::Auto), ..Options::of_program() });
    assert!(
        !simulation.kind_of_arrays().contains("not measured"),
        "the kind of arrays must be chosen by a measurement: {}",
        simulation.kind_of_arrays()
    );
    assert_eq!(
        threads().as_deref(),
        Some("0"),
        "LP_NUM_THREADS for a scene with few tetrahedra, which must get no worker threads"
    );
    drop(open(&Options { threads: Some(Threads::Count(3)), ..Options::default() }));
    assert_eq!(threads().as_deref(), Some("3"));
    drop(open(&Options::default()));
    assert_eq!(threads().as_deref(), Some("3"), "LP_NUM_THREADS must stay as it is under default options");
}

#[test]
fn opening_a_simulation_keeps_measures_and_sets_only_what_is_asked_for() {
    if let Ok(case) = env::var(CASE) {
        return run(&case);
    }
    let home = tempfile::tempdir().unwrap();
    assert_eq!(kept("plain", home.path()), Vec::<PathBuf>::new());
    let files = kept("asked", home.path());
    let named = |part: &str| files.iter().any(|file| file.to_string_lossy().contains(part));
    assert!(
        named(".body") && named("pipelines-"),
        "a prepared body or compiled pipelines are missing among the cache files: {files:?}"
    );
}
