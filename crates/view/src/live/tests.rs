//! Tests of the thread on which a simulation runs: another thread draws at the same time, commands are executed, a step
//! fails, and a session (run of the haptic loop) is recorded. A *slice* is a part of an image's drawing that takes a
//! turn at the GPU's queue; the *tool* is the rigid body that the scene's keys or a haptic device move; *skins* are the
//! bodies' surface meshes.

use std::cell::Cell;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use glam::{DQuat, DVec3};
use palpate::internal::gpu::{FAULTS, Recorder};
use palpate::{Options, StepWork};
use palpate_devices::Mouse;
use palpate_devices::mouse::Goal;

use super::*;

/// A scene in which a ball, the tool, goes down into a soft block.
const SCENE: &str = "[step]\ngravity = [0.0, 0.0, 0.0]\n[[body]]\nname = \"block\"\n\
    layer = { box = [[-0.05, -0.03, -0.05], [0.05, 0.03, 0.05]], cells = [4, 3, 4] }\n\
    material = { young = 2e4, poisson = 0.45, density = 1000.0 }\n\
    [[body.core]]\nname = \"bottom\"\nbind = { box = [[-0.06, -0.04, -0.06], [0.06, -0.029, 0.06]] }\n\
    [tool]\nsphere = 0.02\nmass = 0.05\nposition = [0.0, 0.053, 0.0]\n\
    [coupling]\nstiffness = 500.0\ndamping = 5.0\nangular_stiffness = 0.5\nangular_damping = 0.005\n\
    [drive]\nkeys = [[0.0, 0.0, 0.053, 0.0], [0.06, 0.0, 0.04, 0.0]]\n";

/// Waits until no other test uses Vulkan's validation layer, and reserves that layer until this test's thread ends, as
/// the harness of the tests in `vk-tests` does.
fn turn() {
    static TURN: Mutex<()> = Mutex::new(());
    thread_local!(static HELD: Cell<Option<MutexGuard<'static, ()>>> = const { Cell::new(None) });
    HELD.with(|held| {
        let turn = held.take().unwrap_or_else(|| TURN.lock().unwrap_or_else(PoisonError::into_inner));
        held.set(Some(turn));
    });
}

fn simulation(folder: &std::path::Path) -> Simulation {
    turn();
    let file = folder.join("scene.toml");
    std::fs::write(&file, SCENE).unwrap();
    let device = std::env::var("PALPATE_TEST_DEVICE").ok();
    let options = Options { device, validation: true, ..Options::of_program() };
    Simulation::open(&Scene::load(&file).unwrap(), &options).unwrap()
}

/// A step report as text, without the time that the step took.
fn bits(row: &StepReport) -> String {
    format!("{:?}", StepReport { step_us: 0.0, work: StepWork::default(), ..row.clone() })
}

fn live(
    simulation: Simulation,
    lead: Lead,
    extent: Extent,
    folder: &std::path::Path,
) -> (Live, Arc<Mutex<Vec<StepReport>>>) {
    let rows = Arc::new(Mutex::new(Vec::new()));
    let kept = rows.clone();
    let watch: Watch = Box::new(move |row: &StepReport| {
        kept.lock().unwrap().push(row.clone());
        Ok(())
    });
    let begin = Begin { simulation, lead, extent, watch, folder: folder.into() };
    (Live::start(begin).unwrap(), rows)
}

fn until(live: &mut Live, what: impl Fn(&Snapshot) -> bool) -> Snapshot {
    let begun = Instant::now();
    loop {
        let snapshot = live.snapshot().clone();
        if what(&snapshot) {
            return snapshot;
        }
        assert!(begun.elapsed() < Duration::from_secs(60), "the awaited snapshot did not come: {:?}", snapshot.state);
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[test]
fn beside_drawing_the_trace_is_the_same_bits() {
    const STEPS: u64 = 80;
    let folder = tempfile::tempdir().unwrap();
    let mut plain = simulation(folder.path());
    let expected: Vec<String> = (0..STEPS).map(|_| bits(&plain.step().unwrap())).collect();
    assert!(plain.contact_wrench().unwrap().wrench.force.y > 0.0, "the ball must touch the block at the end");

    let (mut live, rows) = live(simulation(folder.path()), Lead::Script, Extent::Steps(STEPS), folder.path());
    let stop = AtomicBool::new(false);
    let (mut captures, mut slices) = (0, 0);
    let link = live.link().clone();
    std::thread::scope(|scope| {
        scope.spawn(|| {
            while !stop.load(Ordering::Relaxed) {
                // Reads the skins relative to a changing origin, then submits four slices that copy their positions.
                let origin = DVec3::X * f64::from(captures % 7);
                let copy = link.ask(move |simulation, _| {
                    let context = simulation.context().clone();
                    let skins = simulation.skins(origin).unwrap();
                    let bytes = skins.positions.bytes();
                    let target = palpate::internal::gpu::Buffer::new(
                        &context,
                        "drawn",
                        bytes,
                        palpate::internal::gpu::Memory::Device,
                    )
                    .unwrap();
                    let mut recorder = Recorder::untimed(&context).unwrap();
                    recorder.copy(skins.positions, &target);
                    recorder.finish().unwrap()
                });
                let Some(copy) = copy else { return };
                captures += 1;
                for _ in 0..4 {
                    let _turn = link.turns().slice();
                    copy.submit_and_wait().unwrap();
                    slices += 1;
                }
            }
        });
        until(&mut live, |snapshot| snapshot.state == State::Ended);
        stop.store(true, Ordering::Relaxed);
    });
    assert!(captures > 10 && slices > 40, "skins were read {captures} times, {slices} slices were drawn");
    let rows: Vec<String> = rows.lock().unwrap().iter().map(bits).collect();
    assert_eq!(rows, expected);
    let messages = live.link().ask(|simulation, _| simulation.context().validation_messages()).unwrap();
    assert!(messages.is_empty(), "validation messages: {messages:?}");
    assert!(live.samples().count() as u64 == STEPS && live.quit());
}

#[test]
fn it_pauses_steps_by_hand_resets_and_changes_between_steps() {
    let folder = tempfile::tempdir().unwrap();
    let (mut live, rows) = live(simulation(folder.path()), Lead::Script, Extent::Endless, folder.path());
    until(&mut live, |snapshot| snapshot.row.as_ref().is_some_and(|row| row.step >= 5));
    live.link().tell(Command::Pause);
    let paused = until(&mut live, |snapshot| snapshot.state == State::Paused).row.unwrap();
    live.link().tell(Command::Step);
    until(&mut live, |snapshot| snapshot.row.as_ref().is_some_and(|row| row.step == paused.step + 1));
    assert_eq!(live.snapshot().state, State::Paused);
    let softer = |settings: &Settings| {
        let (body, index, _, material) = settings.materials[0].clone();
        Command::Material(body, index, Material { young: 1e3, ..material })
    };
    let command = softer(&live.snapshot().settings);
    live.link().tell(command);
    until(&mut live, |snapshot| snapshot.settings.materials[0].3.young == 1e3);
    let impossible = Material { young: -1.0, ..live.snapshot().settings.materials[0].3 };
    live.link().tell(Command::Material(0, 0, impossible));
    live.link().tell(Command::Record);
    live.link().ask(|_, _| ()).unwrap();
    let notes: Vec<String> = live.notes().collect();
    assert!(notes.iter().any(|note| note.contains("material.young")), "notes: {notes:?}");
    assert!(notes.iter().any(|note| note.contains("nothing is recorded")), "notes: {notes:?}");
    let first = bits(&rows.lock().unwrap()[0]);
    let before = rows.lock().unwrap().len();
    live.link().tell(Command::Reset);
    until(&mut live, |snapshot| snapshot.state == State::Paused && snapshot.row.is_none());
    live.link().tell(Command::Pause);
    until(&mut live, |snapshot| snapshot.state == State::Running && snapshot.row.is_some());
    assert_eq!(bits(&rows.lock().unwrap()[before]), first, "after a reset the first step must repeat");
    assert!(live.quit() && !live.is_running());
    assert!(live.link().ask(|_, _| ()).is_none());
}

#[test]
fn a_failure_is_shown_and_a_reset_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let mut left = 3;
    let watch: Watch = Box::new(move |_| {
        left -= 1;
        if left == 0 { Err(Error::Simulation("no step succeeds".into())) } else { Ok(()) }
    });
    let simulation = simulation(folder.path());
    let begin = Begin { simulation, lead: Lead::Script, extent: Extent::Endless, watch, folder: folder.path().into() };
    let mut live = Live::start(begin).unwrap();
    until(&mut live, |snapshot| snapshot.state == State::Failed("no step succeeds".into()));
    assert_eq!(live.link().ask(|simulation, _| simulation.bodies().len()), Some(1), "the simulation must still answer");
    live.link().tell(Command::Reset);
    until(&mut live, |snapshot| snapshot.state == State::Running);
}

#[test]
fn a_device_that_is_lost_is_shown_with_the_stages_under_way() {
    let folder = tempfile::tempdir().unwrap();
    turn();
    FAULTS.concern_contexts_of_this_thread();
    FAULTS.arm(None, 0);
    let goal = Goal::new(DVec3::Y * 0.053, DQuat::IDENTITY);
    for lead in [Lead::Script, mouse(&goal)] {
        let (mut live, _) = live(simulation(folder.path()), lead, Extent::Endless, folder.path());
        until(&mut live, |snapshot| snapshot.row.as_ref().is_some_and(|row| row.step > 10));
        FAULTS.lose_devices();
        let failed = until(&mut live, |snapshot| matches!(snapshot.state, State::Failed(_)));
        let State::Failed(why) = failed.state else { panic!("it did not fail") };
        assert!(why.contains(" failed in stage") && why.ends_with("the device was lost"), "it said: {why}");
        assert!(live.quit(), "the thread must end although its device is lost");
        FAULTS.arm(None, 0);
    }
}

fn mouse(goal: &Goal) -> Lead {
    let goal = goal.clone();
    let make: MakeDevice = Box::new(move |_, start: Key| {
        goal.place(start.position, start.orientation);
        Ok(Box::new(Mouse::new(goal.clone())) as Box<dyn Device>)
    });
    Lead::Device { name: "mouse".into(), make }
}

#[test]
fn a_mouse_presses_is_recorded_from_the_start_and_replays_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let goal = Goal::new(DVec3::ZERO, DQuat::IDENTITY);
    let (mut live, _) = live(simulation(folder.path()), mouse(&goal), Extent::Endless, folder.path());
    until(&mut live, |snapshot| snapshot.haptics.as_ref().is_some_and(|state| state.ticks > 20));
    goal.shift(DVec3::Y * -0.01);
    let pressed = |snapshot: &Snapshot| {
        let tool = snapshot.row.as_ref().and_then(|row| row.tool);
        tool.is_some_and(|tool| tool.force.y > 0.01)
    };
    until(&mut live, pressed);
    // A material and the virtual coupling are changed; the recording must still use the values in the scene's file.
    let material = Material { young: 5e4, ..live.snapshot().settings.materials[0].3 };
    live.link().tell(Command::Material(0, 0, material));
    let coupling = Coupling { stiffness: 300.0, damping: 3.0, angular_stiffness: 0.1, angular_damping: 0.001 };
    live.link().tell(Command::Coupling(coupling));
    until(&mut live, |snapshot| snapshot.settings.coupling == Some(coupling));
    live.link().tell(Command::Record);
    let recording = |snapshot: &Snapshot| matches!(snapshot.state, State::Recording(_));
    until(&mut live, |snapshot| recording(snapshot) && snapshot.haptics.as_ref().is_some_and(|s| s.ticks > 20));
    goal.shift(DVec3::Y * -0.01);
    let has_stepped = |snapshot: &Snapshot| snapshot.row.as_ref().is_some_and(|row| row.step > 20);
    until(&mut live, |snapshot| recording(snapshot) && pressed(snapshot) && has_stepped(snapshot));
    live.link().tell(Command::Record);
    until(&mut live, |snapshot| snapshot.state == State::Running);
    live.link().tell(Command::Pause);
    until(&mut live, |snapshot| snapshot.state == State::Paused);
    live.link().tell(Command::Step);
    live.link().tell(Command::Pause);
    until(&mut live, |snapshot| snapshot.state == State::Running && pressed(snapshot));
    assert!(live.quit());
    let notes: Vec<String> = live.notes().collect();
    let file = folder.path().join("scene-1.palpate");
    assert!(
        notes.iter().any(|note| note.contains("palpate replay") && note.contains("scene-1.palpate")),
        "notes: {notes:?}"
    );

    let recorded = palpate_devices::record::Recorded::open(&file).unwrap();
    assert_eq!(
        (recorded.header.leaders[0].profile.as_str(), recorded.header.leaders[0].device.as_str()),
        ("mouse", "mouse")
    );
    let mut again = simulation(folder.path());
    let mut steps = 0;
    for entry in recorded {
        if let palpate_devices::record::Entry::Step(step) = entry.unwrap() {
            again.step_device_inputs(&step.inputs, step.h).unwrap();
            assert_eq!(again.contact_wrench(), Some(&step.wrenches[0]), "the replayed wrench of step {steps} differs");
            steps += 1;
        }
    }
    assert!(steps > 20, "only {steps} steps were recorded");
}
