//! Tests of submitted (asynchronous) steps through the C ABI of palpate: they give the same bits as steps that are
//! waited for, their wrench (contact force and torque on the tool, the rigid body that the haptic device leads) can be
//! read at any time, and wrong calls, or calls during a step, are refused without harm.
#![allow(unsafe_code)]

mod ffi_help;

use std::alloc::{GlobalAlloc, Layout, System};
use std::ptr::{null, null_mut};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard};

use palpate_capi::context::palpate_context_destroy;
use palpate_capi::simulation::{
    palpate_nodes, palpate_pose, palpate_simulation, palpate_simulation_destroy, palpate_step, palpate_wrench,
};
use palpate_capi::status::palpate_status;
use palpate_capi::steps::{palpate_step_poll, palpate_step_submit, palpate_step_wait, palpate_wrench_newest};

use ffi_help::*;

/// An allocator that counts the allocations of all threads of this program, except those of the Vulkan driver, which
/// does not use it.
struct Counted;

/// Number of allocations so far.
static COUNT: AtomicUsize = AtomicUsize::new(0);

// SAFETY: all calls are passed on to the system's allocator, which keeps the conditions of the trait.
unsafe impl GlobalAlloc for Counted {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller keeps the conditions of `GlobalAlloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller keeps the conditions of `GlobalAlloc`.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counted = Counted;

/// Lets one test run at a time, so that all counted allocations are those of the test that counts.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

fn scene() -> String {
    format!("{BLOCK}{SPHERE}")
}

/// Pose of the haptic device that is given to a step: 0.1 mm lower at each step. At every seventh step no pose is
/// given.
fn device(step: usize) -> Option<palpate_pose> {
    let lower = |y: f64| palpate_pose { position: [0.0, y, 0.0], ..DEEP };
    (step % 7 != 6).then(|| lower(0.0502 - 1e-4 * step as f64))
}

fn submit(simulation: *mut palpate_simulation, device: Option<palpate_pose>) -> palpate_status {
    // SAFETY: the pointer to the pose is null, or the pose lives during the call; the library checks handles.
    unsafe { palpate_step_submit(simulation, device.as_ref().map_or(null(), |pose| pose)) }
}

fn is_done(simulation: *mut palpate_simulation) -> bool {
    let mut is_done = 7;
    // SAFETY: the output pointer leads to a live local variable; the library checks handles.
    ok(unsafe { palpate_step_poll(simulation, &mut is_done) });
    assert!(is_done == 0 || is_done == 1);
    is_done == 1
}

/// Returns the newest wrench, and the time since the wrench's step received the pose of the haptic device, s.
fn newest(simulation: *mut palpate_simulation) -> (palpate_wrench, f64) {
    let (mut told, mut age) = (wrench(), f64::NAN);
    // SAFETY: the output pointers lead to live local variables; the library checks handles.
    ok(unsafe { palpate_wrench_newest(simulation, &mut told, &mut age) });
    (told, age)
}

fn bits(told: &palpate_wrench) -> Vec<u64> {
    let poses = [&told.tool, &told.device].map(|pose| [&pose.position[..], &pose.orientation[..]].concat());
    let numbers =
        [&told.force[..], &told.torque[..], &[told.time, told.max_depth, told.residual], &poses[0], &poses[1]];
    let counts = [told.step, told.flags.into(), told.contacts.into(), told.iterations.into()];
    numbers.concat().iter().map(|x| x.to_bits()).chain(counts).collect()
}

#[test]
fn submitted_steps_have_the_bits_of_those_that_are_waited_for() {
    const STEPS: usize = 40;
    let _alone = alone();
    let context = context();
    let [plain, waited, polled] = [(); 3].map(|()| simulation(context, &scene()));
    for step in 0..STEPS {
        let mut told = wrench();
        let pose = device(step);
        // SAFETY: the output pointer leads to a live variable, and so does the pointer to the pose, unless it is null;
        // the library checks handles.
        ok(unsafe { palpate_step(plain, pose.as_ref().map_or(null(), |pose| pose), &mut told) });
        ok(submit(waited, pose));
        ok(submit(polled, pose));
        ok(palpate_step_wait(waited));
        wait_for(|| is_done(polled));
        for simulation in [plain, waited, polled] {
            let (newest, age) = newest(simulation);
            assert_eq!(
                bits(&newest),
                bits(&told),
                "bits of the newest wrench (left) and of the wrench of palpate_step (right), step {step}"
            );
            assert!(age >= 0.0 && age.is_finite());
        }
        assert!(
            told.step == step as u64 + 1 && (step < STEPS - 1 || told.force[1] > 0.1),
            "wrong step number, or no force at the end; wrench of the step: {told:?}"
        );
    }
    let nodes = [plain, waited, polled].map(nodes).map(|nodes| nodes.concat().iter().map(|x| x.to_bits()).collect());
    let nodes: [Vec<u64>; 3] = nodes;
    assert!(nodes[0] == nodes[1] && nodes[0] == nodes[2] && nodes[0].len() > 100);
    // A simulation may do submitted steps and steps that are waited for in turn.
    for step in STEPS..STEPS + 6 {
        let (mut told, pose) = (wrench(), device(step));
        // SAFETY: the output pointer leads to a live variable, and so does the pointer to the pose, unless it is null;
        // the library checks handles.
        unsafe {
            ok(palpate_step(plain, pose.as_ref().map_or(null(), |pose| pose), &mut told));
            match step % 2 {
                0 => ok(palpate_step(waited, pose.as_ref().map_or(null(), |pose| pose), null_mut())),
                _ => {
                    ok(submit(waited, pose));
                    ok(palpate_step_wait(waited));
                }
            }
        }
        assert_eq!(
            bits(&newest(waited).0),
            bits(&told),
            "bits of the newest wrench (left) and of the wrench of palpate_step (right), step {step}"
        );
    }
    for simulation in [plain, waited, polled] {
        ok(palpate_simulation_destroy(simulation));
    }
    ok(palpate_context_destroy(context));
}

#[test]
fn submitted_steps_allocate_nothing_on_any_thread_once_they_run() {
    let _alone = alone();
    let context = context();
    let simulation = simulation(context, &scene());
    let mut told = wrench();
    let mut steps = |count: usize| {
        for _ in 0..count {
            ok(submit(simulation, Some(DEEP)));
            while !is_done(simulation) {
                std::thread::yield_now();
            }
            let mut age = 0.0;
            // SAFETY: the output pointers lead to live local variables; the library checks handles.
            ok(unsafe { palpate_wrench_newest(simulation, &mut told, &mut age) });
        }
    };
    steps(20);
    // The test harness may allocate during some of these rounds of 20 steps, but hardly during all of them.
    let made = |_| {
        let before = COUNT.load(Ordering::Relaxed);
        steps(20);
        COUNT.load(Ordering::Relaxed) - before
    };
    let rounds: Vec<usize> = (0..5).map(made).collect();
    assert!(
        rounds.contains(&0),
        "each round of 20 steps allocated memory; number of allocations of each round: {rounds:?}"
    );
    assert!(told.force[1] > 0.1 && told.step == 120, "no force, or not step 120; wrench of the last step: {told:?}");
    // The check above would notice an allocation on any thread: the counter counts that of another thread.
    let before = COUNT.load(Ordering::Relaxed);
    std::thread::spawn(|| drop(std::hint::black_box(Box::new(1)))).join().unwrap();
    assert!(COUNT.load(Ordering::Relaxed) > before);
    ok(palpate_simulation_destroy(simulation));
    ok(palpate_context_destroy(context));
}

#[test]
fn while_a_step_is_under_way_all_else_is_busy_at_once_and_the_last_wrench_is_told() {
    let _alone = alone();
    let context = context();
    let simulation = simulation(context, &scene());
    assert!(is_done(simulation));
    let (before, age) = newest(simulation);
    assert!(before.step == 0 && before.force == [0.0; 3] && age == f64::INFINITY);
    let mut count = 0;
    // SAFETY (both calls): null is passed only where palpate.h allows it, and the output pointer leads to a live local
    // variable.
    let step = || unsafe { palpate_step(simulation, &DEEP, null_mut()) };
    let nodes = |count: &mut usize| unsafe { palpate_nodes(simulation, 0, null_mut(), 0, count) };
    // If this thread is suspended for too long, the submitted step is done before the other calls are made. So steps
    // are submitted until each of the calls was refused as busy at least once, and a wrench was read during a step at
    // least once.
    let (mut seen, mut was_told) = ([false; 3], false);
    let mut done = 0;
    wait_for(|| {
        ok(submit(simulation, Some(DEEP)));
        let calls: [&mut dyn FnMut() -> palpate_status; 3] =
            [&mut || step(), &mut || nodes(&mut count), &mut || submit(simulation, Some(DEEP))];
        done += 1;
        for (call, seen) in calls.into_iter().zip(&mut seen) {
            match call() {
                palpate_status::Busy => {
                    assert!(
                        last_error().contains("a submitted step that is under way"),
                        "wrong error: {}",
                        last_error()
                    );
                    *seen = true;
                }
                status => ok(status),
            }
        }
        let (told, _) = newest(simulation);
        was_told |= !is_done(simulation) && told.step > 0;
        ok(palpate_step_wait(simulation));
        seen == [true; 3] && was_told
    });
    ok(step());
    let last = newest(simulation).0.step;
    assert!(last > done, "only {last} steps were done, although {done} were submitted and one was waited for");
    ok(palpate_simulation_destroy(simulation));
    ok(palpate_context_destroy(context));
}

#[test]
fn a_simulation_destroyed_amid_a_step_leaves_no_memory() {
    let _alone = alone();
    let context = context();
    for _ in 0..5 {
        let simulation = simulation(context, &scene());
        ok(submit(simulation, Some(DEEP)));
        ok(palpate_simulation_destroy(simulation));
        assert_eq!(memory(context), 0);
        refused(submit(simulation, None), palpate_status::Handle, "was destroyed");
        refused(palpate_step_wait(simulation), palpate_status::Handle, "was destroyed");
    }
    ok(palpate_context_destroy(context));
}

#[test]
fn any_thread_may_ask_for_the_newest_wrench_at_any_time() {
    let _alone = alone();
    let context = context();
    let simulation = simulation(context, &scene()) as usize;
    let ends = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let ask = || {
            let simulation = simulation as *mut palpate_simulation;
            let (mut last, mut asked) = (0, 0);
            while !ends.load(Ordering::Relaxed) {
                let (told, age) = newest(simulation);
                assert!(told.step >= last && age >= 0.0);
                (last, asked) = (told.step, asked + 1);
                is_done(simulation);
            }
            asked
        };
        let asking = [scope.spawn(ask), scope.spawn(ask)];
        let simulation = simulation as *mut palpate_simulation;
        for step in 0..40 {
            ok(submit(simulation, device(step)));
            ok(palpate_step_wait(simulation));
            // SAFETY: null is passed only where palpate.h allows it; the library checks handles.
            ok(unsafe { palpate_step(simulation, null(), null_mut()) });
        }
        ends.store(true, Ordering::Relaxed);
        assert!(asking.into_iter().all(|thread| thread.join().unwrap() > 0));
    });
    assert_eq!(newest(simulation as *mut palpate_simulation).0.step, 80);
    ok(palpate_simulation_destroy(simulation as *mut palpate_simulation));
    ok(palpate_context_destroy(context));
}

#[test]
fn wrong_use_is_told_and_is_no_step() {
    use palpate_status::{Argument, Handle, Null};
    let _alone = alone();
    let context = context();
    let simulation = simulation(context, &scene());
    let bad = palpate_pose { position: [0.0, f64::INFINITY, 0.0], ..DEEP };
    refused(submit(null_mut(), None), Null, "simulation is null");
    refused(submit(context.cast(), None), Handle, "not that of a simulation");
    refused(submit(simulation, Some(bad)), Argument, "device.position[1] is inf");
    refused(palpate_step_wait(null_mut()), Null, "simulation is null");
    // SAFETY: each pointer is null, which the library must refuse, or leads to a live local variable of the right type.
    unsafe {
        refused(palpate_step_poll(simulation, null_mut()), Null, "is_done is null");
        refused(palpate_step_poll(null_mut(), &mut 0), Null, "simulation is null");
        refused(palpate_wrench_newest(simulation, null_mut(), null_mut()), Null, "wrench is null");
        let mut told = wrench();
        told.size = 12;
        refused(palpate_wrench_newest(simulation, &mut told, null_mut()), Argument, "palpate_wrench.size is 12");
        told.size = size_of::<palpate_wrench>() as u32;
        ok(palpate_wrench_newest(simulation, &mut told, null_mut()));
        assert_eq!(told.step, 0);
    }
    ok(submit(simulation, None));
    ok(palpate_step_wait(simulation));
    assert_eq!(newest(simulation).0.step, 1);
    ok(palpate_simulation_destroy(simulation));
    ok(palpate_context_destroy(context));
}
