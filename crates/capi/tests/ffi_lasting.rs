//! Long tests of the C ABI: memory does not grow over many rounds (each creates, steps and destroys a simulation) nor
//! over many steps, valgrind finds no error, and a step through the ABI takes no longer than one in Rust.
#![allow(unsafe_code)]

mod ffi_help;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use palpate::{Context, Options, Scene, Simulation};
use palpate_capi::context::palpate_context_destroy;
use palpate_capi::simulation::{palpate_simulation_destroy, palpate_step};

use ffi_help::{BLOCK, DEEP, SPHERE, compiled, context, ok, simulation, wrench};

/// Greatest allowed growth of allocated memory over all steps after the first 1000, bytes: the driver's threads may
/// hold some memory at either of the two moments that are compared. A leak of one byte per step exceeds it even in the
/// shorter run.
const STEPS_ALLOCATED: f64 = 16384.0;
/// Greatest allowed growth of allocated memory over all rounds, bytes: glibc counts the unused ends of blocks as
/// allocated, some 150 bytes per round (valgrind, which counts exactly, sees no growth). A leak of an object of 440
/// bytes per round exceeds it.
const ROUNDS_ALLOCATED: f64 = 131_072.0;
/// Greatest allowed growth of resident memory, bytes. Resident memory changes by whole pages, and depends on which
/// threads free memory: once it grew by a megabyte although allocated memory did not grow. Leaks are detected by the
/// two bounds above.
const IN_USE: f64 = 4_194_304.0;

/// Scene text: the sphere starts half a millimetre inside a block of eight cells.
fn small() -> String {
    let sphere = SPHERE.replace("0.0502", "0.0495");
    BLOCK.replace("cells = [6, 4, 6]", "cells = [2, 2, 2]") + &sphere
}

/// Compiles a program of these tests and writes the scene file for it; returns both paths.
fn program(source: &str, folder: &Path) -> (PathBuf, PathBuf) {
    let scene = folder.join("scene.toml");
    std::fs::write(&scene, small()).unwrap();
    (compiled("gcc", "c11", source, folder), scene)
}

/// Environment variable, and its value, that make lavapipe compile without optimisation: compiling all kernels anew
/// takes most of a round.
const COMPILE_FAST: (&str, &str) = ("GALLIVM_PERF", "no_opt");

/// Runs a program that prints how much memory it uses at two moments, and checks that memory did not grow between them.
fn holds_memory_flat(what: &str, command: &mut Command, allocated: f64) {
    let done = command.output().unwrap();
    let said = String::from_utf8_lossy(&done.stdout);
    let numbers: Vec<f64> = said.split_whitespace().map(|word| word.parse().unwrap()).collect();
    let [force, bytes, bytes_after, pages, pages_after] = numbers[..] else { panic!("{done:?} {said}") };
    let (grown, more) = (bytes_after - bytes, 4096.0 * (pages_after - pages));
    println!(
        "{what}: allocated memory grew by {grown} from {bytes} bytes, resident memory by {more} bytes; force {force} N"
    );
    assert!(grown < allocated && more < IN_USE, "{what}: memory grew; the program printed: {said}");
    assert!(force > 0.01 && force < 10.0, "{what}: wrong force; the program printed: {said}");
}

#[test]
#[ignore = "lasting: minutes"]
fn lasting_three_hundred_rounds_hold_memory_flat() {
    let folder = tempfile::tempdir().unwrap();
    let (rounds, scene) = program("crates/capi/tests/ffi_help/rounds.c", folder.path());
    let mut rounds = Command::new(rounds);
    rounds.arg(scene).args(["60", "300", "2"]).env(COMPILE_FAST.0, COMPILE_FAST.1);
    holds_memory_flat("300 rounds", &mut rounds, ROUNDS_ALLOCATED);
}

fn soak(steps: &str) {
    let folder = tempfile::tempdir().unwrap();
    let (soak, scene) = program("crates/capi/tests/ffi_help/soak.c", folder.path());
    holds_memory_flat(&format!("{steps} steps"), Command::new(soak).arg(scene).arg(steps), STEPS_ALLOCATED);
}

#[test]
#[ignore = "lasting: minutes"]
fn lasting_steps_hold_memory_flat() {
    soak("20000");
}

#[test]
#[ignore = "lasting: minutes"]
fn lasting_a_million_steps_hold_memory_flat() {
    soak("1000000");
}

/// Number of steps in a row through the ABI, and then in Rust.
const ROW: usize = 40;
/// Number of such pairs of rows.
const TURNS: usize = 25;

/// Compares steps of the same scene through the ABI and in Rust, on two contexts that take turns: returns the ratio of
/// the median times (ABI over Rust), and their difference, s.
fn overhead(text: &str) -> (f64, f64) {
    let context = context();
    let simulation = simulation(context, text);
    let scene = Scene::parse(Path::new("scene"), text).unwrap();
    let mut own = Simulation::on_device(&Context::open(&Options::default()).unwrap(), &scene).unwrap();
    own.time_every(0).unwrap();
    let (position, orientation) = (DEEP.position.into(), glam::DQuat::from_array(DEEP.orientation));
    let (mut told, mut times) = (wrench(), [Vec::new(), Vec::new()]);
    for _ in 0..TURNS {
        for _ in 0..ROW {
            let begun = Instant::now();
            // SAFETY: the pose and the output are live local variables; the library checks handles.
            let status = unsafe { palpate_step(simulation, &DEEP, &mut told) };
            times[0].push(begun.elapsed().as_secs_f64());
            ok(status);
        }
        for _ in 0..ROW {
            let begun = Instant::now();
            let row = own.step_at(palpate::Pose { position, orientation });
            times[1].push(begun.elapsed().as_secs_f64());
            row.unwrap();
        }
    }
    ok(palpate_simulation_destroy(simulation));
    ok(palpate_context_destroy(context));
    let [abi, rust] = times.map(|mut times| {
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    });
    (abi / rust, abi - rust)
}

#[test]
#[ignore = "lasting: minutes"]
fn lasting_the_abi_adds_nothing_that_one_feels() {
    // The best of several tries is taken, because other load on the machine may disturb one kind of step more than the
    // other.
    let mut best = f64::INFINITY;
    for _ in 0..6 {
        let (ratio, difference) = overhead(&format!("{BLOCK}{SPHERE}"));
        println!(
            "a step through the ABI takes {ratio:.4} times as long as one in Rust, a difference of {:+.1} us",
            1e6 * difference
        );
        best = best.min(ratio);
        if best < 1.02 {
            return;
        }
    }
    panic!("a step through the ABI takes {best} times as long as one in Rust, which is too long");
}

#[test]
#[ignore = "lasting: minutes"]
fn lasting_valgrind_finds_nothing_in_ten_rounds() {
    let folder = tempfile::tempdir().unwrap();
    let (program, scene) = program("crates/capi/tests/ffi_help/rounds.c", folder.path());
    let suppressions = ffi_help::root().join("crates/capi/tests/ffi_help/driver.supp");
    let mut valgrind = Command::new("valgrind");
    valgrind.args(["--error-exitcode=9", "--leak-check=full", "--show-leak-kinds=definite,indirect"]);
    valgrind.args(["--errors-for-leak-kinds=definite,indirect", "--num-callers=40"]);
    valgrind.arg(format!("--suppressions={}", suppressions.display()));
    // Lavapipe gets no threads of its own, because valgrind never runs two threads at once.
    valgrind.env(COMPILE_FAST.0, COMPILE_FAST.1).env("LP_NUM_THREADS", "0");
    let done = valgrind.arg(&program).arg(&scene).args(["0", "10", "2"]).output();
    let done = done.unwrap_or_else(|error| panic!("valgrind: {error}; ./setup.sh --tests installs it"));
    assert!(done.status.success(), "valgrind reported: {}", String::from_utf8_lossy(&done.stderr));
    let force = String::from_utf8_lossy(&done.stdout).split(' ').next().map(|word| word.parse::<f64>());
    assert!(force.is_some_and(|force| force.is_ok_and(|force| force > 0.01)), "no force: {done:?}");
}
