//! Long tests of the C ABI of palpate: memory grows neither over many rounds (each round creates a simulation, does
//! steps, and destroys the simulation) nor over many steps, valgrind finds no error, and a step through the ABI takes
//! no longer than a step in Rust.
#![allow(unsafe_code)]

mod ffi_help;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use palpate::{Context, Options, Scene, Simulation};
use palpate_capi::context::palpate_context_destroy;
use palpate_capi::simulation::{palpate_simulation_destroy, palpate_step};

use ffi_help::{BLOCK, DEEP, SPHERE, compiled, context, ok, simulation, wrench};

/// Greatest allowed growth of allocated memory over all steps after the first 1000, bytes. It is not zero, because the
/// driver's threads may hold some memory at the beginning or the end of these steps. With a leak of one byte per step,
/// memory grows by more than this bound even in the shorter run, of 20,000 steps.
const STEPS_ALLOCATED: f64 = 16384.0;
/// Greatest allowed growth of allocated memory over all 300 rounds, bytes. It is not zero, because glibc counts unused
/// ends of blocks as allocated, some 150 bytes per round (valgrind, which counts exactly, sees no growth). With a leak
/// of 440 bytes per round, memory grows by more than this bound.
const ROUNDS_ALLOCATED: f64 = 131_072.0;
/// Greatest allowed growth of resident memory, bytes. The bound is wide, because resident memory changes by whole pages
/// and depends on which threads free memory: once it grew by a megabyte although allocated memory did not grow. Smaller
/// leaks are detected by the two bounds above.
const IN_USE: f64 = 4_194_304.0;

/// Scene text: a soft block of eight cells, and as the tool (the rigid body that the haptic device leads) a sphere that
/// starts half a millimetre inside the block.
fn small() -> String {
    let sphere = SPHERE.replace("0.0502", "0.0495");
    BLOCK.replace("cells = [6, 4, 6]", "cells = [2, 2, 2]") + &sphere
}

/// Compiles the program `source` and writes a scene file for it; returns the paths of the executable and of the scene.
fn program(source: &str, folder: &Path) -> (PathBuf, PathBuf) {
    let scene = folder.join("scene.toml");
    std::fs::write(&scene, small()).unwrap();
    (compiled("gcc", "c11", source, folder), scene)
}

/// Environment variable, with its value, that makes lavapipe (Mesa's Vulkan driver for CPUs) compile shaders without
/// optimisation, because most of the time of a round goes into compiling all shaders anew.
const COMPILE_FAST: (&str, &str) = ("GALLIVM_PERF", "no_opt");

/// Runs a program that prints a force and how much memory it uses at two moments, and checks how much memory grew
/// between these moments: allocated memory by less than `allocated` bytes, resident memory by less than [`IN_USE`]
/// bytes. `what` names the program in messages.
fn holds_memory_flat(what: &str, command: &mut Command, allocated: f64) {
    let done = command.output().unwrap();
    let said = String::from_utf8_lossy(&done.stdout);
    let numbers: Vec<f64> = said.split_whitespace().map(|word| word.parse().unwrap()).collect();
    let [force, bytes, bytes_after, pages, pages_after] = numbers[..] else {
        panic!("the program did not print five numbers: {done:?}; it printed: {said}")
    };
    let (grown, more) = (bytes_after - bytes, 4096.0 * (pages_after - pages));
    println!(
        "{what}: allocated memory was {bytes} bytes and grew by {grown} bytes; resident memory grew by {more} bytes; \
         force {force} N"
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

/// Checks that memory does not grow over `steps` steps (the number as text), after 1000 steps in which it may grow.
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

/// Number of steps that are done in a row through the ABI, and then in a row in Rust.
const ROW: usize = 40;
/// Number of times that a row of steps through the ABI and a row of steps in Rust are done.
const TURNS: usize = 25;

/// Times the steps of a scene through the ABI and in Rust, each on its own open Vulkan device, in turns. Returns the
/// median time of a step through the ABI divided by that of a step in Rust, and the difference of these two medians, s.
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
            // SAFETY: the pointers to pose and output lead to live memory; the library checks handles.
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
    // The best of several tries is taken, because other load on the machine may slow the steps through the ABI more
    // than those in Rust.
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
    let done = done.unwrap_or_else(|error| panic!("cannot run valgrind: {error}; ./setup.sh --tests installs it"));
    assert!(done.status.success(), "valgrind reported: {}", String::from_utf8_lossy(&done.stderr));
    let force = String::from_utf8_lossy(&done.stdout).split(' ').next().map(|word| word.parse::<f64>());
    assert!(
        force.is_some_and(|force| force.is_ok_and(|force| force > 0.01)),
        "the program printed no force above 0.01 N: {done:?}"
    );
}
