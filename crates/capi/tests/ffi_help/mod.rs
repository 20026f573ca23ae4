//! Helpers that the tests of the C ABI of palpate share: scenes, checks of the status that a call returns, and calls of
//! the compilers for the programs in C and C++. In a scene, the tool is the rigid body that the haptic device leads.
#![allow(dead_code, unsafe_code)]

use std::ffi::{CStr, CString};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::ptr::{null, null_mut};
use std::time::{Duration, Instant};

use palpate_capi::context::{palpate_context, palpate_context_create, palpate_context_memory};
use palpate_capi::scene::{palpate_scene_destroy, palpate_scene_parse};
use palpate_capi::simulation::{
    palpate_nodes, palpate_pose, palpate_simulation, palpate_simulation_create, palpate_wrench,
};
use palpate_capi::status::{palpate_last_error, palpate_status};

/// Scene text: a soft block, fixed at its bottom.
pub const BLOCK: &str = r#"
[[body]]
name = "block"
layer = { box = [[-0.05, -0.03, -0.05], [0.05, 0.03, 0.05]], cells = [6, 4, 6] }
material = { young = 2e4, poisson = 0.45, density = 1000.0 }
[[body.core]]
name = "bottom"
motion = "fixed"
bind = { box = [[-0.06, -0.04, -0.06], [0.06, -0.029, 0.06]] }
"#;

/// Scene text: a spherical tool, 0.2 mm above the block of [`BLOCK`].
pub const SPHERE: &str = r#"
[tool]
sphere = 0.02
mass = 0.05
position = [0.0, 0.0502, 0.0]
[coupling]
stiffness = 300.0
damping = 2.0
angular_stiffness = 0.5
angular_damping = 0.002
"#;

/// Scene text: two rigid spheres of 10 mm above a plane, each a tool with a coupling of its own.
pub const TWO_TOOLS: &str = include_str!("../../../../tests/two_tools.toml");

/// Pose of the haptic device with which the spherical tool is deep in the block.
pub const DEEP: palpate_pose = palpate_pose { position: [0.0, 0.046, 0.0], orientation: [0.0, 0.0, 0.0, 1.0] };

pub fn last_error() -> String {
    // SAFETY: the library's message is never null and is terminated by a zero byte.
    unsafe { CStr::from_ptr(palpate_last_error()) }.to_str().unwrap().into()
}

#[track_caller]
pub fn ok(status: palpate_status) {
    assert_eq!(status, palpate_status::Ok, "last error: {}", last_error());
}

#[track_caller]
pub fn refused(status: palpate_status, expected: palpate_status, words: &str) {
    let error = last_error();
    assert_eq!(status, expected, "last error: {error}");
    assert!(error.contains(words) && error.lines().count() == 1, "wrong error: {error}");
}

/// Waits until the condition `done` returns true; fails if this takes more than two minutes.
#[track_caller]
pub fn wait_for(mut done: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !done() {
        assert!(begun.elapsed() < Duration::from_secs(120), "the condition stayed false for two minutes");
        std::thread::sleep(Duration::from_millis(1));
    }
}

pub fn context() -> *mut palpate_context {
    let mut context = null_mut();
    // SAFETY: null options are allowed, and the output pointer leads to a live local variable.
    ok(unsafe { palpate_context_create(null(), &mut context) });
    context
}

pub fn simulation(context: *mut palpate_context, text: &str) -> *mut palpate_simulation {
    let (mut scene, mut simulation) = (null_mut(), null_mut());
    let text = CString::new(text).unwrap();
    // SAFETY: the text is terminated by a zero byte, and the output pointers lead to live local variables.
    unsafe {
        ok(palpate_scene_parse(text.as_ptr(), null(), &mut scene));
        ok(palpate_simulation_create(context, scene, &mut simulation));
    }
    ok(palpate_scene_destroy(scene));
    simulation
}

/// Returns a struct of palpate.h whose size field is set and whose other fields are zero.
pub fn zeroed<T: Copy>() -> T {
    // SAFETY: the function is used only for structs of numbers and pointers, whose first field, a `u32`, is their size.
    unsafe {
        let mut value: T = std::mem::zeroed();
        (&raw mut value).cast::<u32>().write(size_of::<T>() as u32);
        value
    }
}

pub fn wrench() -> palpate_wrench {
    zeroed()
}

/// Returns the number of bytes of GPU memory that the simulations of a context occupy.
pub fn memory(context: *mut palpate_context) -> u64 {
    let mut bytes = 0;
    // SAFETY: the output pointer leads to a live local variable; the library checks handles.
    ok(unsafe { palpate_context_memory(context, &mut bytes) });
    bytes
}

/// Returns the world positions of the nodes of the first body, m.
pub fn nodes(simulation: *mut palpate_simulation) -> Vec<[f64; 3]> {
    let mut count = 0;
    // SAFETY: the array may be null because the capacity is 0; the output pointer leads to a live local variable.
    ok(unsafe { palpate_nodes(simulation, 0, null_mut(), 0, &mut count) });
    let mut nodes = vec![[0.0; 3]; count];
    // SAFETY: the array has the length that is passed, and the output pointer leads to a live local variable.
    ok(unsafe { palpate_nodes(simulation, 0, nodes.as_mut_ptr(), count, &mut count) });
    nodes
}

pub fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

/// Returns the folder that has the newest build of the shared library, which cargo made for this test run.
pub fn library() -> PathBuf {
    let test = std::env::current_exe().unwrap();
    let deps = test.parent().unwrap();
    let newest = [deps, deps.parent().unwrap()].map(|folder| folder.join("libpalpate_capi.so"));
    let when = |path: &PathBuf| path.metadata().and_then(|m| m.modified()).ok();
    let found = newest.into_iter().filter(|path| path.exists()).max_by_key(when);
    found.expect("cargo has built no libpalpate_capi.so").parent().unwrap().to_path_buf()
}

/// Compiles a C or C++ program of the repository, with warnings as errors; returns the path of the executable.
pub fn compiled(compiler: &str, standard: &str, source: &str, folder: &Path) -> PathBuf {
    let program = folder.join(format!("{}-{compiler}", Path::new(source).file_stem().unwrap().display()));
    let library = library();
    let done = Command::new(compiler)
        .args([&format!("-std={standard}"), "-O1", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-I"])
        .arg(root().join("crates/capi/src"))
        .arg(root().join(source))
        .arg("-o")
        .arg(&program)
        .arg("-L")
        .arg(&library)
        // With the old dynamic tag DT_RPATH the loader first searches the path that is written in the program, and only
        // then LD_LIBRARY_PATH, which cargo sets to folders that may hold other builds of the library.
        .args(["-lpalpate_capi", "-lvulkan", "-lm", "-pthread", "-Wl,--disable-new-dtags"])
        .arg(format!("-Wl,-rpath,{}", library.display()))
        .output()
        .unwrap_or_else(|error| panic!("cannot run {compiler}: {error}; ./setup.sh --tests installs it"));
    assert!(done.status.success(), "{compiler} reported: {}", String::from_utf8_lossy(&done.stderr));
    program
}

/// Compiles and runs a C or C++ program of the repository; returns what the program prints.
pub fn output(compiler: &str, standard: &str, source: &str, arguments: &[&Path]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let done = Command::new(compiled(compiler, standard, source, folder.path())).args(arguments).output().unwrap();
    let said = String::from_utf8(done.stdout).unwrap();
    assert!(done.status.success(), "the program failed: {said}{}", String::from_utf8_lossy(&done.stderr));
    said
}
