//! Tests of the C ABI of palpate (a GPU engine for haptic touch of soft bodies) from C, C++ and Python: the committed
//! header `palpate.h` is the one that the tool cbindgen generates, the example programs compile without a warning, and
//! the contact forces that they print equal those of the same scene stepped in Rust, bit for bit. In a scene, the tool
//! is the rigid body that the haptic device leads, by a spring and damper, the virtual coupling.

mod ffi_help;

use std::path::{Path, PathBuf};
use std::process::Command;

use palpate::{Options, Scene, Simulation};

use ffi_help::{compiled, root};

/// Number of steps that are compared.
const STEPS: usize = 40;
/// Scene: the tool, a sphere, is pressed into a soft block.
const SCENE: &str = r#"
[[body]]
name = "block"
layer = { box = [[-0.05, -0.03, -0.05], [0.05, 0.03, 0.05]], cells = [6, 4, 6] }
material = { young = 2e4, poisson = 0.45, density = 1000.0 }
[[body.core]]
name = "bottom"
motion = "fixed"
bind = { box = [[-0.06, -0.04, -0.06], [0.06, -0.029, 0.06]] }
[tool]
sphere = 0.02
mass = 0.05
position = [0.0, 0.0502, 0.0]
[coupling]
stiffness = 500.0
damping = 2.0
angular_stiffness = 0.5
angular_damping = 0.002
[drive]
keys = [[0.0, 0.0, 0.0502, 0.0], [0.02, 0.003, 0.046, 0.0]]
"#;

fn output(program: &mut Command) -> String {
    // LD_LIBRARY_PATH is removed, because cargo sets it to folders that may hold an older build of the library than the
    // one that the program was linked with.
    let done = program.env_remove("LD_LIBRARY_PATH").output().unwrap();
    assert!(done.status.success(), "the program failed: {}", String::from_utf8_lossy(&done.stderr));
    String::from_utf8(done.stdout).unwrap()
}

#[test]
fn the_header_is_the_one_that_the_sources_make() {
    let config = cbindgen::Config::from_file(root().join("crates/capi/src/cbindgen.toml")).unwrap();
    let builder = cbindgen::Builder::new().with_config(config).with_src(root().join("crates/capi/src/lib.rs"));
    let mut made = Vec::new();
    builder.generate().unwrap().write(&mut made);
    let file = root().join("crates/capi/src/palpate.h");
    let made = String::from_utf8(made).unwrap();
    if std::env::var_os("PALPATE_WRITE_HEADER").is_some() {
        std::fs::write(&file, &made).unwrap();
    }
    let committed = std::fs::read_to_string(&file).unwrap_or_default();
    assert!(
        committed == made,
        "crates/capi/src/palpate.h differs from what cbindgen generates from crates/capi/src; update it by: \
        PALPATE_WRITE_HEADER=1 cargo test --release -p palpate-capi --test ffi header"
    );
}

/// Who reads the header from its beginning meets each function after those that must be called before it.
#[test]
fn the_header_has_the_order_of_use() {
    let header = std::fs::read_to_string(root().join("crates/capi/src/palpate.h")).unwrap();
    let declared = header.lines().filter(|line| !line.trim_start().starts_with("//")).filter_map(|line| {
        let name = line.split_once('(')?.0.rsplit([' ', '*']).next()?;
        name.starts_with("palpate_").then_some(name)
    });
    let declared: Vec<&str> = declared.collect();
    let use_of = [
        "palpate_last_error",
        "palpate_context_create",
        "palpate_scene_load",
        "palpate_scene_create",
        "palpate_scene_prepare",
        "palpate_simulation_create",
        "palpate_step",
        "palpate_step_submit",
        "palpate_wrench_newest",
        "palpate_state_save",
        "palpate_state_restore",
        "palpate_skin",
        "palpate_loop_start",
        "palpate_loop_read",
        "palpate_loop_stop",
    ];
    let places = use_of.map(|name| declared.iter().position(|other| *other == name).expect(name));
    assert!(places.is_sorted(), "{use_of:?} are declared at {places:?}");
}

/// Writes the scene to a file and does its steps in Rust, without the C ABI, as the command `palpate run` does. Returns
/// the file's path, and for each step its number, the force on the tool (x, y, z, N) and the flags (warnings, one bit
/// each).
fn run(folder: &Path) -> (PathBuf, Vec<[f64; 5]>) {
    let scene = folder.join("scene.toml");
    std::fs::write(&scene, SCENE).unwrap();
    let mut simulation = Simulation::open(&Scene::load(&scene).unwrap(), &Options::of_program()).unwrap();
    let told: Vec<[f64; 5]> = (0..STEPS)
        .map(|_| {
            let row = simulation.step().unwrap();
            let force = row.tool.unwrap().force;
            [row.step as f64, force.x, force.y, force.z, f64::from(row.flags.0)]
        })
        .collect();
    assert!(told[STEPS - 1][2] > 0.1, "no force; number, force (N) and flags of each step: {told:?}");
    (scene, told)
}

/// Parses the output of an example program: a line per step with the step's number, the force (x, y, z, N) and the
/// flags.
fn felt(said: &str) -> Vec<[f64; 5]> {
    let row = |line: &str| {
        let mut numbers = line.split(' ').map(|word| word.parse::<f64>().unwrap());
        std::array::from_fn(|_| numbers.next().unwrap())
    };
    said.lines().map(row).collect()
}

fn bits(rows: &[[f64; 5]]) -> Vec<[u64; 5]> {
    rows.iter().map(|row| row.map(f64::to_bits)).collect()
}

#[test]
fn programs_in_c_feel_the_forces_of_palpate_run() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, told) = run(folder.path());
    for compiler in ["gcc", "clang"] {
        let program = compiled(compiler, "c11", "examples/c/touch.c", folder.path());
        let said = output(Command::new(program).arg(&scene).arg(STEPS.to_string()));
        assert_eq!(bits(&felt(&said)), bits(&told), "bits of the steps; left: program by {compiler}; right: Rust");
    }
}

#[test]
fn a_program_shares_its_device() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, told) = run(folder.path());
    for compiler in ["gcc", "clang"] {
        let program = compiled(compiler, "c11", "examples/c/host.c", folder.path());
        let said = output(Command::new(program).arg(&scene));
        let force: f64 = said.split(' ').nth(1).unwrap().parse().unwrap();
        assert_eq!(
            force.to_bits(),
            told[STEPS - 1][2].to_bits(),
            "bits of the last force; the program compiled by {compiler} printed: {said}"
        );
        assert!(
            said.contains("vertices shared") && !said.contains("locked 0 times"),
            "no vertices shared, or the lock of the program's queue never taken; the program printed: {said}"
        );
    }
}

#[test]
#[ignore = "long: 13 s"]
fn programs_that_build_their_scenes_feel_them() {
    let folder = tempfile::tempdir().unwrap();
    for compiler in ["gcc", "clang"] {
        let program = compiled(compiler, "c11", "examples/c/build.c", folder.path());
        let told = felt(&output(Command::new(program).arg("100")));
        assert!(
            told.len() == 100 && told[0][2] == 0.0 && told.iter().all(|row| row[4] == 0.0),
            "wrong number of steps, force or flags; number, force (N) and flags of each step: {told:?}"
        );
        // The haptic device moves 9 mm into the block. With a rigid block the virtual coupling, whose stiffness is 500
        // N/m, would give 4.5 N; this block yields, so the force is smaller.
        assert!(told[99][2] > 0.5 && told[99][2] < 4.5, "number, force (N) and flags of the last step: {:?}", told[99]);
    }
    for compiler in ["g++", "clang++"] {
        let program = compiled(compiler, "c++17", "examples/cpp/build.cpp", folder.path());
        let said = output(Command::new(program).arg("200"));
        let force: f64 = said.split(' ').next().unwrap().parse().unwrap();
        assert!(force > 0.2 && force < 4.5, "force of 0.2 to 4.5 N expected; the program printed: {said}");
    }
}

#[test]
#[ignore = "long: 15 s"]
fn a_program_in_cpp_leads_the_device_itself_and_says_what_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, _) = run(folder.path());
    for compiler in ["g++", "clang++"] {
        let program = compiled(compiler, "c++17", "examples/cpp/press.cpp", folder.path());
        // The program moves the haptic device down by 7.5 mm; at the start the sphere is 0.2 mm above the block.
        let said = output(Command::new(&program).arg(&scene).arg("1500"));
        let force: f64 = said.split(' ').next().unwrap().parse().unwrap();
        assert!(force > 0.5 && force < 3.0, "force of 0.5 to 3 N expected; the program printed: {said}");
        let wrong = Command::new(&program).args(["nowhere.toml", "10"]).output().unwrap();
        let said = String::from_utf8(wrong.stderr).unwrap();
        assert!(
            wrong.status.code() == Some(1) && said.contains("nowhere.toml") && said.lines().count() == 1,
            "one line about nowhere.toml and exit status 1 expected; the program reported: {said}"
        );
    }
}
