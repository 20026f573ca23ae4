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
use palpate::{Options, StepWork, ToolReport};
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

/// A scene in which two balls, the tools, lie on the ground.
const TWO_TOOLS: &str = include_str!("../../../../tests/two_tools.toml");

fn simulation(folder: &std::path::Path) -> Simulation {
    simulation_of(folder, SCENE)
}

fn simulation_of(folder: &std::path::Path, scene: &str) -> Simulation {
    turn();
    let file = folder.join("scene.toml");
    std::fs::write(&file, scene).unwrap();
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
    Lead::Devices(Box::new(move |simulation: &Simulation, starts: &[Key]| {
        goal.place(starts[0].position, starts[0].orientation);
        Ok(vec![held(simulation, 0, &goal)])
    }))
}

/// A mouse that holds the tool of this index.
fn held(simulation: &Simulation, index: usize, goal: &Goal) -> Held {
    let leader = simulation.scene().leader(index).unwrap();
    let (name, haptics) = (leader.tool.into(), leader.haptics.clone());
    let tool = simulation.tools().nth(index).unwrap().clone();
    let leader = session::Leader { name, device: Box::new(Mouse::new(goal.clone())), tool, haptics };
    Held { leader, device: "mouse".into() }
}

#[test]
fn a_mouse_presses_is_recorded_from_the_start_and_replays_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let goal = Goal::new(DVec3::ZERO, DQuat::IDENTITY);
    let (mut live, _) = live(simulation(folder.path()), mouse(&goal), Extent::Endless, folder.path());
    until(&mut live, |snapshot| snapshot.haptics.first().is_some_and(|state| state.ticks > 20));
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
    until(&mut live, |snapshot| recording(snapshot) && snapshot.haptics.first().is_some_and(|s| s.ticks > 20));
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

#[test]
fn each_of_two_tools_is_moved_recorded_and_replays_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let goals = [0, 1].map(|_| Goal::new(DVec3::ZERO, DQuat::IDENTITY));
    let led = goals.clone();
    let lead = Lead::Devices(Box::new(move |simulation: &Simulation, starts: &[Key]| {
        starts.iter().zip(&led).for_each(|(start, goal)| goal.place(start.position, start.orientation));
        Ok(led.iter().enumerate().map(|(index, goal)| held(simulation, index, goal)).collect())
    }));
    let (mut live, _) = live(simulation_of(folder.path(), TWO_TOOLS), lead, Extent::Endless, folder.path());
    let runs = |snapshot: &Snapshot| snapshot.haptics.len() == 2 && snapshot.haptics.iter().all(|s| s.ticks > 20);
    until(&mut live, runs);
    // The goals began at the balls; the second is pressed on the ground, and only it is felt there.
    let places = goals.each_ref().map(|goal| goal.pose().0.x);
    assert!((places[0] + 0.03).abs() < 1e-4 && (places[1] - 0.03).abs() < 1e-4, "places of the goals, m: {places:?}");
    goals[1].shift(DVec3::Y * -0.004);
    let forces = |snapshot: &Snapshot| {
        let row = snapshot.row.as_ref();
        row.map_or(vec![0.0; 2], |row| row.tools().map(|tool| tool.force.y).collect())
    };
    let pressed = until(&mut live, |snapshot| forces(snapshot)[1] > 1.0);
    assert!(forces(&pressed)[0] < 0.2, "forces, N: {:?}", forces(&pressed));
    until(&mut live, |snapshot| snapshot.haptics.get(1).is_some_and(|state| state.played.force.y > 1.0));
    assert!(live.snapshot().haptics[0].played.force.y < 0.2);
    // A ball that is set down may bounce.
    let most = live.samples().fold([0.0_f64; 2], |most, sample| [0, 1].map(|k| most[k].max(sample.forces[k].y)));
    assert!(most[0] < 0.2 && most[1] > 1.0, "greatest forces of the samples, N: {most:?}");
    // After a pause each device begins where it was.
    let arrived = |tool: &ToolReport| (tool.device.position.y - goals[1].pose().0.y).abs() < 1e-4;
    until(&mut live, |snapshot| snapshot.row.as_ref().is_some_and(|row| row.tools().nth(1).is_some_and(arrived)));
    live.link().tell(Command::Pause);
    until(&mut live, |snapshot| snapshot.state == State::Paused);
    live.link().tell(Command::Step);
    live.link().tell(Command::Pause);
    until(&mut live, |snapshot| snapshot.state == State::Running && runs(snapshot) && forces(snapshot)[1] > 1.0);
    assert!((goals[1].pose().0.y - 0.0061).abs() < 1e-3, "place of the goal: {} m", goals[1].pose().0);
    live.link().tell(Command::Record);
    let is_recording = |snapshot: &Snapshot| matches!(snapshot.state, State::Recording(_));
    until(&mut live, |snapshot| is_recording(snapshot) && runs(snapshot));
    goals[0].shift(DVec3::Y * -0.004);
    until(&mut live, |snapshot| is_recording(snapshot) && forces(snapshot)[0] > 0.5);
    assert!(live.quit());
    assert_eq!(live.sessions().map(|reports| reports.len()).collect::<Vec<_>>(), [2, 2, 2]);

    let recorded = palpate_devices::record::Recorded::open(&folder.path().join("scene-1.palpate")).unwrap();
    let leaders = recorded.header.leaders.iter().map(|leader| (leader.tool.as_str(), leader.device.as_str()));
    assert_eq!(leaders.collect::<Vec<_>>(), [("left", "mouse"), ("right", "mouse")]);
    let mut again = simulation_of(folder.path(), TWO_TOOLS);
    let mut most = [0.0_f64; 2];
    for entry in recorded {
        if let palpate_devices::record::Entry::Step(step) = entry.unwrap() {
            again.step_device_inputs(&step.inputs, step.h).unwrap();
            assert!(again.last_wrenches().eq(step.wrenches.iter().map(Some)), "a replayed wrench differs");
            most.iter_mut().zip(&step.wrenches).for_each(|(most, felt)| *most = most.max(felt.wrench.force.y));
        }
    }
    assert!(most[0] > 0.5 && most[1] < 0.2, "greatest forces of the recording, N: {most:?}");
}
