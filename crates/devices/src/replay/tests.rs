//! Tests of the replay of whole, shortened and changed recordings of sessions, and of the device that gives recorded
//! readings again. A *tick* is one iteration of the haptic loop, a *step* one step of the simulation.

use std::path::{Path, PathBuf};

use palpate::internal::haptics::Device;
use palpate::internal::step::DeviceInput;

use super::*;
use crate::record::tests::{TICKS, Walled, recorded};
use crate::record::{Header, Leader, Recording};

fn replayed(path: &Path) -> Result<Replayed> {
    replay(Recorded::open(path)?, &mut Walled::new())
}

fn difference(spoil: impl Fn(&mut Entry)) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = recorded(folder.path(), spoil);
    replayed(&path).unwrap().difference.expect("a difference must be found").to_string()
}

fn refusal(spoil: impl Fn(&mut Entry)) -> String {
    let folder = tempfile::tempdir().unwrap();
    let error = replayed(&recorded(folder.path(), spoil)).unwrap_err();
    assert_eq!(error.exit_status(), 2);
    error.to_string()
}

/// Makes a function that changes one tick of a recording and no other entry.
fn tick(index: u64, change: impl Fn(&mut Tick)) -> impl Fn(&mut Entry) {
    move |entry| {
        if let Entry::Tick(_, tick) = entry
            && tick.index == index
        {
            change(tick);
        }
    }
}

/// Makes a function that changes one step, numbered from 1, and no other entry.
fn step(number: u64, change: impl Fn(&mut Step)) -> impl Fn(&mut Entry) {
    move |entry| {
        if let Entry::Step(step) = entry
            && step.wrenches[0].step == number
        {
            change(step);
        }
    }
}

fn flip(number: &mut f64) {
    *number = f64::from_bits(number.to_bits() ^ 1);
}

#[test]
fn a_session_with_every_fault_replays_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let path = recorded(folder.path(), |_| {});
    let result = replayed(&path).unwrap();
    assert_eq!(result, Replayed { ticks: TICKS, steps: 27, is_whole: true, difference: None });
    // If a recording was cut short, its complete part is replayed.
    let bytes = std::fs::read(&path).unwrap();
    let mut most = 0;
    for eighths in 1..8 {
        std::fs::write(&path, &bytes[..bytes.len() * eighths / 8]).unwrap();
        let result = replayed(&path).unwrap();
        assert!(
            result.difference.is_none() && !result.is_whole && result.ticks > most,
            "replay of the first {eighths} eighths of the file: {result:?}"
        );
        most = result.ticks;
    }
    assert!(most > TICKS * 3 / 4);
}

#[test]
fn one_bit_is_found_and_named_where_it_is() {
    let starts =
        |message: String, words: &str| assert!(message.starts_with(words), "got {message}\nmust begin with {words}");
    starts(difference(tick(137, |tick| flip(&mut tick.played.force.y))), "tick 137 differs first in played_force_y: ");
    starts(difference(tick(0, |tick| flip(&mut tick.energy.given[3]))), "tick 0 differs first in energy_given_rx: ");
    starts(difference(tick(499, |tick| tick.events.raise(Event::Clamped))), "tick 499 differs first in events: ");
    starts(difference(step(9, |step| step.h += 1e-6)), "step 9 differs first in ");
    starts(
        difference(step(9, |step| flip(&mut step.inputs[0].tool.position.x))),
        "step 9 differs first in held_tool_x: ",
    );
    starts(difference(step(2, |step| flip(&mut step.wrenches[0].wrench.force.y))), "step 2 differs first in force_y: ");
    starts(
        difference(step(5, |step| flip(&mut step.wrenches[0].stiffness[1][3]))),
        "step 5 differs first in stiffness_y_rx: ",
    );
    // Smoothing of the device's pose may round off a change of a reading's last bit, so these changes are larger.
    let moved = tick(200, |tick| tick.reading.as_mut().unwrap().state.position.y += 1e-9);
    starts(difference(moved), "tick 200 differs first in device_");
    starts(difference(tick(200, |tick| tick.time += 1e-9)), "tick 200 differs first in device_");
    let unread = tick(200, |tick| tick.reading = None);
    starts(difference(unread), "tick 200 differs first in device_");
    let later = tick(145, |tick| tick.step -= 1);
    starts(difference(later), "tick 145 differs first in ");
}

/// Two tools, each with a wall of its own.
struct Walls([Walled; 2]);

impl Environment for Walls {
    fn feel_each(&mut self, inputs: &[DeviceInput], h: f64) -> Result<Vec<ContactWrench>> {
        inputs.iter().zip(&mut self.0).map(|(input, wall)| wall.feel(input, h)).collect()
    }
}

/// Records a session of two devices, made of the tests' session: each entry for one tool, then for the other. Of the
/// second tool's entries each is changed by `spoil`.
fn recorded_twice(folder: &Path, spoil: impl Fn(&mut Entry)) -> PathBuf {
    let single = Recorded::open(&recorded(folder, |_| {})).unwrap();
    let leader = single.header.leaders[0].clone();
    let leaders = vec![leader.clone(), Leader { tool: "right".into(), ..leader }];
    let path = folder.join("both.palpate");
    let mut recording = Recording::create(&path, &Header { leaders, ..single.header.clone() }).unwrap();
    for entry in single.map(|entry| entry.unwrap()) {
        let mut other = entry.clone();
        spoil(&mut other);
        match (entry, other) {
            (Entry::Begin(_, begin), _) => {
                (0..2).for_each(|index| recording.begin(index, &begin.settings, &begin.tool).unwrap());
            }
            (Entry::Tick(_, tick), Entry::Tick(_, other)) => {
                recording.tick(0, &tick).unwrap();
                recording.tick(1, &other).unwrap();
            }
            (Entry::Step(step), Entry::Step(other)) => {
                let inputs = [step.inputs[0], other.inputs[0]];
                recording.step(&inputs, step.h, &[step.wrenches[0], other.wrenches[0]]).unwrap();
            }
            _ => {}
        }
    }
    recording.finish().unwrap();
    path
}

#[test]
fn a_session_of_two_devices_replays_to_the_same_bits_and_says_whose_differ() {
    let folder = tempfile::tempdir().unwrap();
    let replayed = |path: &Path| {
        let mut walls = Walls([Walled::new(), Walled::new()]);
        replay(Recorded::open(path).unwrap(), &mut walls).unwrap()
    };
    let path = recorded_twice(folder.path(), |_| {});
    assert_eq!(replayed(&path), Replayed { ticks: 2 * TICKS, steps: 27, is_whole: true, difference: None });
    // Of a recording that was cut short, what is complete of either device is replayed.
    let bytes = std::fs::read(&path).unwrap();
    let mut most = 0;
    for eighths in 1..8 {
        let cut = folder.path().join("cut.palpate");
        std::fs::write(&cut, &bytes[..bytes.len() * eighths / 8]).unwrap();
        let result = replayed(&cut);
        let all = Recorded::open(&cut).unwrap().filter(|entry| matches!(entry, Ok(Entry::Tick(..)))).count() as u64;
        assert!(
            result.difference.is_none() && !result.is_whole && result.ticks > most,
            "{eighths} eighths: {result:?}"
        );
        // Ticks that use the wrench of a step that was recorded after them are left out.
        assert!(result.ticks + 2 * 20 >= all, "{eighths} eighths: {} of {all} ticks were replayed", result.ticks);
        most = result.ticks;
    }
    // An environment of one tool refuses it; a device gives the readings of its own tool.
    let error = replay(Recorded::open(&path).unwrap(), &mut Walled::new()).unwrap_err();
    assert!(error.to_string().contains("2 haptic devices are given for what has one tool"), "{error}");
    assert_eq!(crate::Replay::open(&path, 1).unwrap().ticks() as u64, TICKS);
    assert!(
        crate::Replay::open(&path, 2).is_err_and(|error| error.to_string().contains("those of number 3 are asked for"))
    );

    let found = |spoil: &dyn Fn(&mut Entry), words: &str| {
        std::fs::remove_file(folder.path().join("both.palpate")).unwrap();
        std::fs::remove_file(folder.path().join("session.palpate")).unwrap();
        let found = replayed(&recorded_twice(folder.path(), spoil)).difference.expect("a difference must be found");
        assert!(found.to_string().starts_with(words), "got {found}, must begin with {words}");
    };
    let played = tick(137, |tick| flip(&mut tick.played.force.y));
    found(&played, "tick 137 of right differs first in played_force_y: ");
    let held = step(9, |step| flip(&mut step.inputs[0].tool.position.x));
    found(&held, "step 9 of right differs first in held_tool_x: ");
}

#[test]
fn what_is_no_session_is_refused() {
    let lost = refusal(|entry| {
        if let Entry::Tick(_, tick) = entry {
            tick.index += u64::from(tick.index > 60) * 2;
        }
    });
    assert!(lost.contains("ticks 61 to 62 were lost"), "wrong error: {lost}");
    let never = refusal(tick(300, |tick| tick.step = 1000));
    assert!(
        never.contains("tick 300 uses the wrench of step 1000, which is missing or out of order"),
        "wrong error: {never}"
    );
    for h in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(refusal(step(4, |step| step.h = h)).contains("step 4 is "), "wrong error for a step length of {h} s");
    }
    for watchdog in [f64::NAN, -0.1] {
        let spoil = |entry: &mut Entry| {
            if let Entry::Begin(_, begin) = entry {
                begin.settings.limits.watchdog = watchdog;
            }
        };
        assert!(
            refusal(spoil).contains("a limit of the haptic loop is "),
            "wrong error for a watchdog limit of {watchdog} s"
        );
    }
    let past = refusal(step(8, |step| step.inputs[0].ticks = 3));
    assert!(past.contains("step 8 starts from tick 3"), "wrong error: {past}");
    let beyond = refusal(step(27, |step| step.inputs[0].ticks = 10_000));
    assert!(
        beyond.contains("tick 485 uses the wrench of step 27") || beyond.contains("after the last"),
        "wrong error: {beyond}"
    );
}

#[test]
fn the_replay_device_says_what_was_said_and_then_rests() {
    let folder = tempfile::tempdir().unwrap();
    let path = recorded(folder.path(), |_| {});
    let mut device = crate::Replay::open(&path, 0).unwrap();
    assert_eq!(device.profile().name, "premium");
    let mut last = None;
    for entry in Recorded::open(&path).unwrap() {
        let Entry::Tick(_, tick) = entry.unwrap() else { continue };
        let (said, recorded) = (device.read(0.0), reading_of(&tick));
        assert_eq!(format!("{said:?}"), format!("{recorded:?}"));
        assert_eq!(said.is_ok(), tick.reading.is_some());
        last = said.ok().or(last);
    }
    let (rest, last) = (device.read(9.0).unwrap(), last.unwrap());
    assert_eq!((rest.state.position, rest.time), (last.state.position, last.time));
    assert_eq!(rest.state.velocity, glam::DVec3::ZERO);
    assert_ne!(last.state.velocity, glam::DVec3::ZERO);
}

#[test]
fn no_spoiled_byte_ends_in_a_panic() {
    let folder = tempfile::tempdir().unwrap();
    let path = recorded(folder.path(), |_| {});
    let bytes = std::fs::read(&path).unwrap();
    // Each of the first 3000 bytes, which hold the settings of the servo (the loop's controller), is changed, and then
    // every 1499th byte. The changed bits include sign, exponent and last bit of a number.
    let begin = 3000;
    for at in (0..begin).chain((begin..bytes.len()).step_by(1499)) {
        for flip in [1, 0x40, 0x80, 0xff] {
            let mut spoiled = bytes.clone();
            spoiled[at] ^= flip;
            let recorded = Recorded::read(&path, std::io::Cursor::new(spoiled));
            // The result does not matter: a changed name in the header, for example, makes no difference.
            let _ = recorded.and_then(|recorded| replay(recorded, &mut Walled::new()));
        }
    }
}
