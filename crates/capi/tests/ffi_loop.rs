//! Tests of the haptic loop through the C ABI of palpate, with a haptic device made of callbacks: the device presses
//! the tool (the rigid body that it leads) into a soft block while the test reads the loop's state, the loop is stopped
//! by the test or by a callback, and everything is released in order. At each tick (one iteration) the loop reads the
//! device and plays a force on it, that is, commands it to exert this force; meanwhile the simulation does steps, each
//! of which gives a wrench: contact force and torque on the tool.
#![allow(unsafe_code)]

mod ffi_help;

use std::ffi::{CStr, c_void};
use std::path::Path;
use std::ptr::{null, null_mut};
use std::sync::Mutex;

use palpate::internal::gpu::FAULTS;
use palpate_capi::context::palpate_context_destroy;
use palpate_capi::haptic_device::{palpate_haptic_device, palpate_play, palpate_reading};
use palpate_capi::haptic_loop::{
    palpate_loop, palpate_loop_destroy, palpate_loop_ended, palpate_loop_note, palpate_loop_read,
    palpate_loop_read_tool, palpate_loop_start, palpate_loop_start_tools, palpate_loop_stop, palpate_loop_wrench,
    palpate_loop_wrench_tool,
};
use palpate_capi::loop_options::palpate_loop_options;
use palpate_capi::loop_state::*;
use palpate_capi::simulation::{
    palpate_pose, palpate_simulation, palpate_simulation_destroy, palpate_step, palpate_wrench,
};
use palpate_capi::status::palpate_status;
use palpate_capi::steps::{palpate_step_submit, palpate_step_wait, palpate_wrench_newest};

use ffi_help::*;

/// Record of the calls of the device's callbacks, and what the callbacks are to do from now on (`wish`).
#[derive(Debug, Default, Clone, PartialEq)]
struct Facts {
    opened: u32,
    closed: u32,
    reads: u64,
    writes: u64,
    last_force: [f64; 3],
    peak: f64,
    /// Handle of the loop as a number, for a callback that stops or destroys its own loop; 0: not yet known.
    the_loop: usize,
    /// Status and error message of each call that a callback made on its own loop.
    said: Vec<(palpate_status, String)>,
    /// Number of calls of callbacks after the device was closed.
    after_close: u32,
    wish: Wish,
    /// Start of the device relative to (0, 50.2 mm, 0), m.
    offset: [f64; 3],
}

/// What the callbacks of the device do: `Press`: they press the tool into the block; `Stop` and `Destroy`: they also
/// stop or destroy their own loop; otherwise a callback fails or reports a wrong pose or velocity.
#[derive(Debug, Default, Clone, Copy, PartialEq)]
enum Wish {
    #[default]
    Press,
    FailToOpen,
    FailToWrite,
    FailToRead,
    SayNothing,
    SayNaN,
    Stop,
    Destroy,
}

/// The data to which the pointer `user` of the device's callbacks leads. Callbacks and test share these data, so the
/// data are behind a lock.
#[derive(Default)]
struct Hand(Mutex<Facts>);

impl Hand {
    fn wishes(wish: Wish) -> Hand {
        Hand(Mutex::new(Facts { wish, ..Facts::default() }))
    }

    fn facts(&self) -> Facts {
        self.0.lock().unwrap().clone()
    }

    fn wish(&self, wish: Wish) {
        self.0.lock().unwrap().wish = wish;
    }

    fn device(&self) -> palpate_haptic_device {
        palpate_haptic_device {
            user: (&raw const *self).cast_mut().cast(),
            open: Some(open),
            read: Some(read),
            write: Some(write),
            close: Some(close),
            profile: c"touch".as_ptr(),
            ..zeroed()
        }
    }
}

fn with<R>(user: *mut c_void, work: impl FnOnce(&mut Facts) -> R) -> R {
    // SAFETY: `user` leads to the `Hand` of the test, which outlives the loop.
    let hand = unsafe { &*user.cast::<Hand>() };
    let mut facts = hand.0.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    facts.after_close += u32::from(facts.closed > 0);
    work(&mut facts)
}

unsafe extern "C" fn open(user: *mut c_void) -> i32 {
    with(user, |facts| {
        facts.opened += 1;
        if facts.wish == Wish::FailToOpen { 7 } else { 0 }
    })
}

unsafe extern "C" fn read(user: *mut c_void, time: f64, reading: *mut palpate_reading) -> i32 {
    // SAFETY: the pointer leads to a struct of the library that is valid during the call of this callback.
    let reading = unsafe { &mut *reading };
    assert!(reading.size as usize == size_of::<palpate_reading>() && reading.pose.position[0].is_nan());
    with(user, |facts| {
        facts.reads += 1;
        // The device moves down into the block by 5 mm within a second, and then stays there.
        let [x, y, z] = facts.offset;
        reading.pose.position = [x, 0.0502 - 0.005 * time.min(1.0) + y, z];
        reading.buttons = 5;
        match facts.wish {
            Wish::FailToRead => return -1,
            Wish::SayNothing => reading.pose.position = [f64::NAN; 3],
            Wish::SayNaN => reading.velocity = [0.0, f64::NAN, 0.0],
            Wish::Stop | Wish::Destroy if facts.the_loop != 0 && facts.said.len() < 3 => ask(facts),
            _ => {}
        }
        0
    })
}

/// Reads the state of the callback's own loop, and then asks the loop to stop or be destroyed, as `wish` says. The
/// library must refuse to wait for the loop's end within a callback.
fn ask(facts: &mut Facts) {
    let the_loop = facts.the_loop as *mut palpate_loop;
    let mut state: palpate_loop_state = zeroed();
    // SAFETY: the output pointer leads to a live local variable; the library checks handles.
    facts.said.push((unsafe { palpate_loop_read(the_loop, &mut state) }, String::new()));
    let status = match facts.wish {
        Wish::Stop => palpate_loop_stop(the_loop),
        _ => palpate_loop_destroy(the_loop),
    };
    facts.said.push((status, last_error()));
}

unsafe extern "C" fn write(user: *mut c_void, play: *const palpate_play) -> i32 {
    // SAFETY: the pointer leads to a struct of the library that is valid during the call of this callback.
    let play = unsafe { *play };
    with(user, |facts| {
        facts.writes += 1;
        facts.last_force = play.force;
        let force = play.force.iter().map(|x| x * x).sum::<f64>().sqrt();
        facts.peak = facts.peak.max(force);
        if facts.wish == Wish::FailToWrite { 1 } else { 0 }
    })
}

unsafe extern "C" fn close(user: *mut c_void) {
    with(user, |facts| facts.closed += 1);
}

fn scene() -> String {
    format!("[step]\ngravity = [0.0, 0.0, 0.0]\n{BLOCK}{SPHERE}")
}

fn start(simulation: *mut palpate_simulation, hand: &Hand) -> *mut palpate_loop {
    start_with(simulation, hand, zeroed())
}

fn start_with(simulation: *mut palpate_simulation, hand: &Hand, options: palpate_loop_options) -> *mut palpate_loop {
    let mut the_loop = null_mut();
    // SAFETY: the structs and the output variable outlive the call; the library checks handles.
    ok(unsafe { palpate_loop_start(simulation, &hand.device(), &options, &mut the_loop) });
    the_loop
}

fn state(the_loop: *mut palpate_loop) -> palpate_loop_state {
    let mut state = zeroed();
    // SAFETY: the output pointer leads to a live local variable; the library checks handles.
    ok(unsafe { palpate_loop_read(the_loop, &mut state) });
    state
}

fn ended(the_loop: *mut palpate_loop) -> String {
    let (mut text, mut count) = ([1; 256], 0);
    // SAFETY: the array has the length that is passed, and the output pointer leads to a live local variable.
    ok(unsafe { palpate_loop_ended(the_loop, text.as_mut_ptr(), text.len(), &mut count) });
    // SAFETY: the library terminates the text by a zero byte.
    let text = unsafe { CStr::from_ptr(text.as_ptr()) }.to_str().unwrap().to_owned();
    assert_eq!(count, text.len() + 1);
    text
}

fn step(simulation: *mut palpate_simulation) -> palpate_status {
    // SAFETY: null is passed only where palpate.h allows it; the library checks handles.
    unsafe { palpate_step(simulation, null(), null_mut()) }
}

/// The newest wrench, and the time since its step began, s.
type Newest = (palpate_wrench, f64);

fn newest(simulation: *mut palpate_simulation) -> Newest {
    let (mut told, mut age) = (wrench(), f64::NAN);
    // SAFETY: the output pointers lead to live local variables; the library checks handles.
    ok(unsafe { palpate_wrench_newest(simulation, &mut told, &mut age) });
    (told, age)
}

fn loop_wrench(the_loop: *mut palpate_loop) -> Newest {
    let (mut told, mut age) = (wrench(), f64::NAN);
    // SAFETY: the output pointers lead to live local variables; the library checks handles.
    ok(unsafe { palpate_loop_wrench(the_loop, &mut told, &mut age) });
    (told, age)
}

#[test]
fn a_loop_presses_is_watched_and_gives_the_simulation_back() {
    let (context, hand) = (context(), Hand::default());
    let simulation = simulation(context, &scene());
    ok(step(simulation));
    let the_loop = start(simulation, &hand);
    assert_eq!(ended(the_loop), "");
    wait_for(|| {
        refused(step(simulation), palpate_status::Busy, "in use by a loop");
        state(the_loop).peak_force > 0.05 && loop_wrench(the_loop).0.force[1] > 0.05
    });
    let (told, age) = loop_wrench(the_loop);
    assert!(
        told.step > 5 && age >= 0.0 && age.is_finite() && told.force[1] > 0.0,
        "expected a force after more than 5 steps; wrench: {told:?}, age: {age} s"
    );
    assert!(newest(simulation).0.step >= told.step);
    // SAFETY: null is passed only where palpate.h allows it; the library checks handles.
    refused(unsafe { palpate_step_submit(simulation, null()) }, palpate_status::Busy, "in use by a loop");
    ok(palpate_loop_stop(the_loop));
    let (last, facts) = (state(the_loop), hand.facts());
    assert_eq!(
        (facts.opened, facts.closed, facts.after_close, facts.last_force),
        (1, 1, 0, [0.0; 3]),
        "left: numbers of calls of `open`, of `close` and after `close`; last force, N; all facts: {facts:?}"
    );
    // The loop writes once per tick, and in addition a zero force once before the first tick and once after the last
    // tick.
    assert!(facts.reads > 10 && facts.writes == facts.reads + 2, "wrong number of reads or writes: {facts:?}");
    assert!(
        last.is_running == 0 && last.status == palpate_status::Ok && last.ticks == facts.reads,
        "the loop still runs, failed or miscounted; its state: {last:?}; calls of the device: {facts:?}"
    );
    assert!(
        (last.peak_force - facts.peak).abs() < 1e-12 && facts.peak > 0.05 && facts.peak <= 3.3,
        "wrong greatest force; state after the end: {last:?}; calls of the device: {facts:?}"
    );
    assert!(
        last.buttons == 5 && last.gain > 0.0 && last.wrench_step > 1 && last.late_worst >= last.late_p99,
        "wrong buttons, gain, step or lateness; state after the end: {last:?}"
    );
    assert!(last.events_so_far & PALPATE_EVENT_ENGAGING != 0 && last.events_so_far & PALPATE_EVENT_BAD_READING == 0);
    assert!(
        last.device.position[1] < 0.0502 && last.tool.position[1] > last.device.position[1],
        "the device is not pressed down, or the tool is not above it; state after the end: {last:?}"
    );
    assert_eq!(ended(the_loop), "it was stopped");
    // The simulation continues from the state in which the loop left it, by steps as long as the scene's time step.
    let (left, _) = newest(simulation);
    let mut steps = [wrench(); 2];
    for told in &mut steps {
        // SAFETY: the output pointer leads to a live local variable; the library checks handles.
        ok(unsafe { palpate_step(simulation, null(), told) });
    }
    assert_eq!([steps[0].step, steps[1].step], [left.step + 1, left.step + 2]);
    let lengths = [steps[0].time - left.time, steps[1].time - steps[0].time];
    assert!(
        lengths.iter().all(|h| (h - 1e-3).abs() < 1e-9),
        "expected steps of 1 ms after the loop; their lengths, s: {lengths:?}"
    );
    assert!(steps[1].force[1] > 0.0 && (steps[0].device.position[1] - left.device.position[1]).abs() < 1e-9);
    assert!(
        (steps[0].tool.position[1] - left.tool.position[1]).abs() < 1e-3,
        "the tool jumped; last wrench of the loop: {left:?}; wrenches of the steps after the loop: {steps:?}"
    );
    ok(palpate_loop_destroy(the_loop));
    refused(palpate_loop_stop(the_loop), palpate_status::Handle, "was destroyed");
    ok(palpate_simulation_destroy(simulation));
    assert_eq!(memory(context), 0);
    ok(palpate_context_destroy(context));
}

/// The state that a loop tells of a tool.
fn state_of(the_loop: *mut palpate_loop, tool: u32) -> palpate_loop_state {
    let mut state = zeroed();
    // SAFETY: the output pointer leads to a live local variable; the library checks handles.
    ok(unsafe { palpate_loop_read_tool(the_loop, tool, &mut state) });
    state
}

#[test]
fn each_of_two_tools_is_led_by_a_device_of_its_own() {
    use palpate_status::{Argument, Null};
    let context = context();
    let simulation = simulation(context, TWO_TOOLS);
    // Above each ball, which the plane stops.
    let hands = [-0.03, 0.03].map(|x| Hand(Mutex::new(Facts { offset: [x, -0.04, 0.0], ..Facts::default() })));
    let devices = [hands[0].device(), palpate_haptic_device { profile: c"premium".as_ptr(), ..hands[1].device() }];
    let options = [zeroed(), palpate_loop_options { max_force: 0.1, ..zeroed() }];
    let mut the_loop = null_mut();
    let mut start = |devices: &[palpate_haptic_device], options: *const palpate_loop_options, count| {
        // SAFETY: devices, options and the output variable outlive the call, and the library checks handles.
        unsafe { palpate_loop_start_tools(simulation, devices.as_ptr(), options, count, &mut the_loop) }
    };
    let mut wrong = options;
    wrong[1].rate = 1.0;
    let unable = [devices[0], palpate_haptic_device { read: None, ..devices[1] }];
    let unnamed = [devices[0], palpate_haptic_device { profile: null(), ..devices[1] }];
    refused(start(&devices, null(), 0), Argument, "count is 0");
    refused(start(&[devices[0]; 3], null(), 3), Argument, "count is 3, but the scene has 2 tools");
    refused(start(&devices, wrong.as_ptr(), 2), Argument, "options[1].rate is 1");
    refused(start(&unable, null(), 2), Null, "devices[1].read is null");
    refused(start(&unnamed, null(), 2), Argument, "and the scene has no tool.right.haptics.profile");
    hands[1].wish(Wish::FailToOpen);
    refused(start(&devices, null(), 2), palpate_status::NoDevice, "right: the haptic device is lost");
    assert_eq!([0, 1].map(|k: usize| hands[k].facts().closed), [1, 0]);
    for hand in &hands {
        let mut facts = hand.0.lock().unwrap();
        *facts = Facts { offset: facts.offset, ..Facts::default() };
    }

    ok(start(&devices, options.as_ptr(), 2));
    wait_for(|| [0, 1].into_iter().all(|tool| state_of(the_loop, tool).peak_force > 0.09));
    hands[0].wish(Wish::FailToRead);
    wait_for(|| state_of(the_loop, 0).events_so_far & PALPATE_EVENT_DEVICE_LOST != 0);
    hands[0].wish(Wish::Press);
    wait_for(|| state_of(the_loop, 0).gain == 1.0 && state_of(the_loop, 0).time > 1.2);
    ok(palpate_loop_stop(the_loop));
    assert_eq!(ended(the_loop), "it was stopped");
    let states = [0, 1].map(|tool| state_of(the_loop, tool));
    for (tool, (state, hand)) in states.iter().zip(&hands).enumerate() {
        let (facts, x) = (hand.facts(), [-0.03, 0.03][tool]);
        let place = format!("tool {tool}: {state:?}, {facts:?}");
        assert_eq!((facts.opened, facts.closed, facts.after_close, facts.last_force), (1, 1, 0, [0.0; 3]), "{place}");
        assert!((state.device.position[0] - x).abs() < 1e-3 && (state.tool.position[0] - x).abs() < 5e-3, "{place}");
        assert_eq!((state.is_running, state.notes), (0, states[0].notes), "{place}");
        assert!(state.events_so_far & PALPATE_EVENT_DEVICE_LOST == 0 || tool == 0, "{place}");
        assert!(facts.peak <= [f64::INFINITY, 0.1 + 1e-12][tool] && facts.peak > [0.2, 0.09][tool], "{place}");
        let (mut told, mut age) = (wrench(), f64::NAN);
        // SAFETY: the output pointers lead to live local variables; the library checks handles.
        ok(unsafe { palpate_loop_wrench_tool(the_loop, tool as u32, &mut told, &mut age) });
        let near = |pose: palpate_pose| (pose.position[0] - x).abs() < 5e-3;
        assert!(near(told.tool) && near(told.device) && told.force[1] > 0.09 && age.is_finite(), "{place}: {told:?}");
    }
    // SAFETY (both blocks): the output pointers lead to live local variables; the library checks handles.
    let state = unsafe { palpate_loop_read_tool(the_loop, 2, &mut zeroed()) };
    refused(state, Argument, "tool is 2, and the loop leads 2 of them");
    let wrench = unsafe { palpate_loop_wrench_tool(the_loop, 2, &mut wrench(), null_mut()) };
    refused(wrench, Argument, "tool is 2, and the loop leads 2 of them");
    ok(palpate_loop_destroy(the_loop));
    ok(step(simulation));
    ok(palpate_simulation_destroy(simulation));
    assert_eq!(memory(context), 0);
    ok(palpate_context_destroy(context));
}

#[test]
fn a_device_that_does_not_open_leaves_the_simulation_as_it_can_be_used() {
    let context = context();
    let simulation = simulation(context, &scene());
    for (wish, words, closed) in
        [(Wish::FailToOpen, "its callback open returned 7", 0), (Wish::FailToWrite, "failed for a force of zero", 1)]
    {
        let (hand, mut the_loop) = (Hand::wishes(wish), usize::MAX as *mut palpate_loop);
        // SAFETY: the struct and the output variable outlive the call; the library checks handles.
        let status = unsafe { palpate_loop_start(simulation, &hand.device(), null(), &mut the_loop) };
        refused(status, palpate_status::NoDevice, words);
        assert!(the_loop.is_null());
        let facts = hand.facts();
        assert_eq!(
            (facts.opened, facts.closed, facts.reads),
            (1, closed, 0),
            "numbers of calls of `open`, `close` and `read`; all facts: {facts:?}"
        );
        ok(step(simulation));
    }
    ok(palpate_simulation_destroy(simulation));
    ok(palpate_context_destroy(context));
}

#[test]
fn a_device_that_is_lost_or_says_what_cannot_be_plays_nothing_until_it_is_well() {
    let (context, hand) = (context(), Hand::default());
    let simulation = simulation(context, &scene());
    let the_loop = start(simulation, &hand);
    let faults = [
        (Wish::FailToRead, PALPATE_EVENT_DEVICE_LOST),
        (Wish::FailToWrite, PALPATE_EVENT_DEVICE_LOST),
        (Wish::SayNothing, PALPATE_EVENT_BAD_READING),
        (Wish::SayNaN, PALPATE_EVENT_BAD_READING),
    ];
    for (wish, event) in faults {
        wait_for(|| state(the_loop).events & event == 0 && state(the_loop).gain > 0.0);
        hand.wish(wish);
        // After bad readings the force fades out; wait until no force is played.
        wait_for(|| state(the_loop).events & event != 0 && state(the_loop).played_force == [0.0; 3]);
        hand.wish(Wish::Press);
    }
    wait_for(|| state(the_loop).gain == 1.0);
    assert!(state(the_loop).is_running == 1);
    ok(palpate_loop_destroy(the_loop));
    ok(palpate_simulation_destroy(simulation));
    ok(palpate_context_destroy(context));
}

#[test]
fn a_loop_whose_vulkan_device_is_lost_plays_nothing_and_says_so() {
    FAULTS.concern_contexts_of_this_thread();
    FAULTS.arm(None, 0);
    let (context, hand) = (context(), Hand::default());
    let simulation = simulation(context, &scene());
    let the_loop = start(simulation, &hand);
    wait_for(|| state(the_loop).peak_force > 0.05);
    FAULTS.lose_devices();
    wait_for(|| state(the_loop).is_running == 0);
    let (last, facts) = (state(the_loop), hand.facts());
    assert_eq!(
        (last.status, facts.last_force, facts.closed, facts.after_close),
        (palpate_status::Vulkan, [0.0; 3], 1, 0)
    );
    let why = ended(the_loop);
    assert!(why.contains(" failed in stage") && why.ends_with("the device was lost"), "it said: {why}");
    ok(palpate_loop_destroy(the_loop));
    refused(step(simulation), palpate_status::Simulation, "an earlier step failed halfway");
    ok(palpate_simulation_destroy(simulation));
    ok(palpate_context_destroy(context));
    FAULTS.arm(None, 0);
}

#[test]
fn a_callback_that_stops_or_destroys_its_own_loop_only_asks() {
    let context = context();
    let simulation = simulation(context, &scene());
    for wish in [Wish::Stop, Wish::Destroy] {
        let hand = Hand::wishes(wish);
        let the_loop = start(simulation, &hand);
        hand.0.lock().unwrap().the_loop = the_loop as usize;
        wait_for(|| state(the_loop).is_running == 0);
        let said = hand.facts().said;
        assert_eq!(said[0].0, palpate_status::Ok);
        assert!(
            said[1].0 == palpate_status::Busy && said[1].1.contains("asked to end"),
            "the callback's call to end its loop was not refused as busy; status and message of its calls: {said:?}"
        );
        assert_eq!(hand.facts().closed, 1);
        assert_eq!(ended(the_loop), "it was stopped");
        ok(palpate_loop_stop(the_loop));
        ok(step(simulation));
        ok(palpate_loop_destroy(the_loop));
    }
    ok(palpate_simulation_destroy(simulation));
    ok(palpate_context_destroy(context));
}

#[test]
fn a_simulation_destroyed_while_a_loop_holds_it_goes_with_the_loop() {
    let (context, hand) = (context(), Hand::default());
    let simulation = simulation(context, &scene());
    let the_loop = start(simulation, &hand);
    ok(palpate_simulation_destroy(simulation));
    refused(step(simulation), palpate_status::Handle, "was destroyed");
    assert!(memory(context) > 0);
    let steps = state(the_loop).steps;
    wait_for(|| state(the_loop).steps > steps && state(the_loop).ticks > 0);
    assert!(loop_wrench(the_loop).0.step > 0);
    ok(palpate_loop_stop(the_loop));
    assert_eq!(memory(context), 0);
    ok(palpate_loop_destroy(the_loop));
    ok(palpate_context_destroy(context));
}

#[test]
fn options_lower_what_the_scene_says_and_a_loop_ends_by_itself() {
    let context = context();
    let simulation = simulation(context, &scene());
    let hand = Hand::default();
    let lower = palpate_loop_options {
        seconds: 2.0,
        rate: 400.0,
        max_force: 0.05,
        max_torque: 4.0,
        local_model: -1,
        passivity: -1,
        ..zeroed()
    };
    let first = start_with(simulation, &hand, lower);
    wait_for(|| state(first).is_running == 0);
    assert_eq!(ended(first), "its duration is over");
    let (told, facts) = (state(first), hand.facts());
    assert!(
        facts.peak > 0.0 && facts.peak <= 0.05 + 1e-12,
        "force up to 0.05 N expected; calls of the device: {facts:?}"
    );
    assert!(
        told.ticks > 10
            && told.ticks as f64 <= 400.0 * told.time + 2.0
            && told.events_so_far & PALPATE_EVENT_DAMPED == 0,
        "wrong number of ticks, or damped without passivity control; state after the end: {told:?}"
    );
    let (mut text, mut count) = ([1; 512], 0);
    // SAFETY (all calls in this closure): the array has at least the length that is passed, and the output pointer
    // leads to a live local variable.
    let mut note = |k: u32, room: usize| unsafe {
        let status = palpate_loop_note(first, k, text.as_mut_ptr(), room, &mut count);
        (status, count, CStr::from_ptr(text.as_ptr()).to_string_lossy().into_owned())
    };
    text_of_notes(&mut note, told.notes);
    // Another loop can start while the handle of the first loop, which has ended, still exists.
    let hand = Hand::default();
    let second = start(simulation, &hand);
    ok(palpate_loop_destroy(first));
    ok(palpate_loop_destroy(second));
    ok(palpate_loop_destroy(null_mut()));
    ok(palpate_simulation_destroy(simulation));
    ok(palpate_context_destroy(context));
}

/// Checks that the notes of a loop (lines of text about it) are copied whole or not at all. `note` takes the number of
/// a note and the length of an array; it reads the note into the array, and returns the status, the length of the note
/// with its terminating zero, and the text in the array. `notes`: number of notes.
fn text_of_notes(note: &mut dyn FnMut(u32, usize) -> (palpate_status, usize, String), notes: u32) {
    let all: Vec<String> = (0..notes).map(|k| note(k, 512).2).collect();
    assert!(
        all.iter().any(|line| line.starts_with("haptics.max_torque exceeds the limit of profile touch")),
        "no note about max_torque; notes of the loop: {all:?}"
    );
    assert!(all.iter().any(|line| line.starts_with("coupling ")), "no note about the coupling: {all:?}");
    let (status, length, _) = note(0, 0);
    assert_eq!((status, length), (palpate_status::Ok, all[0].len() + 1));
    let (status, count, before) = note(0, length - 1);
    refused(status, palpate_status::TooSmall, "text has room for");
    assert_eq!(count, length);
    assert_eq!(
        before,
        *all.last().unwrap(),
        "an array that is too small was written; its text (left), and the text before the call (right)"
    );
    assert_eq!(note(0, length).2, all[0]);
    refused(note(notes, 512).0, palpate_status::Argument, "counted from 0");
}

#[test]
fn wrong_use_is_told_and_nothing_begins() {
    use palpate_status::{Argument, Busy, Input, Null};
    let (context, hand) = (context(), Hand::default());
    let able = simulation(context, &scene());
    let toolless = simulation(context, BLOCK);
    let good = hand.device();
    let mut the_loop = null_mut();
    let mut start = |simulation, device: *const palpate_haptic_device, options: palpate_loop_options| {
        // SAFETY: the structs and the output variable outlive the call; the library checks handles.
        unsafe { palpate_loop_start(simulation, device, &options, &mut the_loop) }
    };
    let none: palpate_loop_options = zeroed();
    refused(start(null_mut(), &good, none), Null, "simulation is null");
    refused(start(able, null(), none), Null, "device is null");
    refused(start(able, &palpate_haptic_device { read: None, ..good }, none), Null, "device.read is null");
    refused(start(able, &palpate_haptic_device { write: None, ..good }, none), Null, "device.write is null");
    let named = |profile: *const _| palpate_haptic_device { profile, ..good };
    refused(start(able, &named(null()), none), Argument, "the scene has no haptics.profile");
    refused(start(able, &named(c"omni".as_ptr()), none), Argument, "device.profile is `omni`");
    refused(start(able, &palpate_haptic_device { reserved: 1, ..good }, none), Argument, "reserved is 1");
    refused(start(able, &palpate_haptic_device { size: 8, ..good }, none), Argument, "palpate_haptic_device.size is 8");
    refused(start(able, &good, palpate_loop_options { rate: 1.0, ..none }), Argument, "options.rate is 1");
    refused(start(able, &good, palpate_loop_options { size: 4, ..none }), Argument, "palpate_loop_options.size is 4");
    refused(start(toolless, &good, none), Input, "no tool");
    assert_eq!(hand.facts(), Facts::default());
    let held = self::start(able, &hand);
    refused(start(able, &good, none), Busy, "in use by a loop");
    assert!(the_loop.is_null());
    ok(palpate_simulation_destroy(toolless));
    // SAFETY: each pointer is null, which the library must refuse, or leads to a live local variable.
    unsafe {
        refused(palpate_loop_start(able, &good, null(), null_mut()), Null, "the_loop is null");
        refused(palpate_loop_read(null_mut(), &mut zeroed()), Null, "loop is null");
        refused(palpate_loop_read(able.cast(), &mut zeroed()), palpate_status::Handle, "not that of a loop");
    }
    refused(palpate_loop_stop(null_mut()), Null, "loop is null");
    ok(palpate_step_wait(able));
    ok(palpate_loop_destroy(held));
    ok(palpate_simulation_destroy(able));
    ok(palpate_context_destroy(context));
}

#[test]
fn programs_in_c_and_cpp_hold_a_device_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scene.toml");
    std::fs::write(&file, scene()).unwrap();
    let arguments: [&Path; 1] = [&file];
    for compiler in ["gcc", "clang"] {
        let said = output(compiler, "c11", "examples/c/hold.c", &arguments);
        assert!(said.contains(" ticks, ") && said.contains("its duration is over"), "the program printed: {said}");
        let force: f64 = said.lines().last().unwrap().split(' ').next().unwrap().parse().unwrap();
        assert!(force > 0.05 && force <= 3.3, "force of 0.05 to 3.3 N expected; the program printed: {said}");
    }
    for compiler in ["g++", "clang++"] {
        assert_eq!(output(compiler, "c++17", "crates/capi/tests/ffi_help/both.cpp", &arguments), "right\n");
    }
}
