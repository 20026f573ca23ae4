//! Tests of every fault that the haptic loop must survive. The tick (iteration of the loop) in which a fault occurs
//! raises the fault's event; the played force (the one commanded to the device) stays within its limits, and returns
//! once the fault has passed. A wrench is the force and torque of the contacts on the tool, the rigid body that the
//! device leads.

use glam::{DMat3, DQuat, DVec3};
use palpate::Wrench;
use palpate::internal::haptics::coupling;
use palpate::internal::haptics::device::{Device, Fault, Reading};
use palpate::internal::haptics::environment::{Environment, Wall};
use palpate::internal::haptics::event::Event;
use palpate::internal::haptics::safety::Limits;
use palpate::internal::haptics::servo::{Servo, Settings, Tick};
use palpate::internal::step::ContactWrench;
use palpate::internal::step::tool::Tool;
use palpate::internal::step::trajectory::Trajectory;
use palpate::scene::profile::Profile;
use palpate::scene::{Haptics, Key, Lowered};

use super::hand::{Hand, HandParameters};

const PERIOD: f64 = 1e-3;
/// Number of ticks from the beginning of one simulation step to that of the next. The loop has the wrench of a step
/// this many ticks after the step's beginning.
const INTERVAL: u64 = 20;
/// Tick in which the fault begins.
const FAULT: u64 = 1500;
const TICKS: u64 = 4000;

/// Inputs of one tick, which a test changes to simulate a fault.
struct Inputs {
    time: f64,
    reading: Result<Reading, Fault>,
    newest: ContactWrench,
    /// Whether the haptic device accepts the wrench to be played.
    is_taken: bool,
}

/// Parameters of a session: one run of the haptic loop with the simulated hand, which presses on a wall.
#[derive(Clone)]
struct Making {
    profile: Profile,
    settings: Settings,
    tool: Tool,
    /// Stiffness of the wall, N/m.
    wall: f64,
}

fn making(profile: &str) -> Making {
    let profile = Profile::named(profile).unwrap().clone();
    let (limits, _) = Limits::new(&profile, &Lowered::default());
    let gains = coupling::choose(&profile, PERIOD, 0.0, 0.05, 2e-6, None);
    let tool = Tool {
        mass: 0.05,
        inertia: DMat3::IDENTITY * 2e-6,
        coupling: Some(gains.coupling),
        centre: DVec3::Y * 0.005,
        orientation: DQuat::IDENTITY,
        velocity: DVec3::ZERO,
        angular_velocity: DVec3::ZERO,
    };
    let settings = Settings {
        period: PERIOD,
        limits,
        local_model: true,
        passivity: true,
        most_damping: gains.most_damping,
        trust: Haptics::default().trust,
        arm: 6e-3,
        resolution: profile.step(),
    };
    Making { profile, settings, tool, wall: 1000.0 }
}

/// Runs a session of four seconds, in which the hand presses on the wall and holds, twice: with the passivity
/// controller (which damps forces that would give the hand energy) and without. Every tick is checked against the
/// limits. Returns the ticks of the run without the controller.
fn session(making: Making, mut fault: impl FnMut(u64, &mut Inputs)) -> Vec<Tick> {
    let [_, ticks] = [true, false].map(|passivity| {
        let mut making = making.clone();
        making.settings.passivity = passivity;
        one_session(making, &mut fault)
    });
    ticks
}

fn one_session(making: Making, mut fault: impl FnMut(u64, &mut Inputs)) -> Vec<Tick> {
    let Making { profile, settings, tool, wall } = making;
    let mut wall = Wall { stiffness: wall, damping: 0.0, tells_gap: true, tool: tool.clone(), steps: 0 };
    let mut servo = Servo::new(settings, tool);
    let key = |time: f64, y: f64| Key { time, position: DVec3::Y * y, orientation: DQuat::IDENTITY };
    let keys = [key(0.0, 0.005), key(0.3, 0.005), key(0.6, -0.01)];
    let mut hand = Hand::new(HandParameters::default(), Trajectory::new(&keys, keys[0]), profile).unwrap();
    hand.open().unwrap();
    let (mut newest, mut coming) = (servo.newest(), servo.newest());
    let mut ticks: Vec<Tick> = Vec::new();
    for k in 0..TICKS {
        if k % INTERVAL == 0 {
            newest = coming;
            coming = wall.feel(&servo.input(), INTERVAL as f64 * PERIOD).unwrap();
        }
        let time = k as f64 * PERIOD;
        let mut inputs = Inputs { time, reading: hand.read(time), newest, is_taken: true };
        fault(k, &mut inputs);
        let mut tick = servo.tick(inputs.time, 0.0, inputs.reading, &inputs.newest);
        if !inputs.is_taken {
            servo.unplayed(&mut tick);
        }
        hand.write(&tick.played).unwrap();
        check(&settings.limits, ticks.last(), &tick);
        ticks.push(tick);
    }
    ticks
}

fn check(limits: &Limits, last: Option<&Tick>, tick: &Tick) {
    let (force, torque) = (tick.played.force.length(), tick.played.torque.length());
    assert!(
        tick.played.is_finite() && tick.device.is_valid() && tick.tool.is_valid(),
        "the played wrench or a pose is not finite: {tick:?}"
    );
    assert!(
        force <= limits.force && torque <= limits.torque,
        "tick {}: the force {force} N or the torque {torque} N m is above its limit",
        tick.index
    );
    let before = last.map_or(DVec3::ZERO, |tick| tick.played.force);
    let change = (tick.played.force - before).length();
    // The slew limit bounds the rate of change of the force over the time that a tick integrates, at most four periods.
    // A force that is cut off drops to zero at once.
    let most = 4.0 * limits.slew * PERIOD * (1.0 + 1e-9);
    assert!(change <= most || tick.played.force == DVec3::ZERO, "tick {}: force changed by {change} N", tick.index);
}

/// Indices of the ticks that raised an event.
fn with(ticks: &[Tick], event: Event) -> Vec<u64> {
    ticks.iter().filter(|tick| tick.events.has(event)).map(|tick| tick.index).collect()
}

fn force(ticks: &[Tick], at: u64) -> f64 {
    ticks[at as usize].played.force.length()
}

/// Whether the force at the end is within 0.05 N of that of a session without fault.
fn has_recovered(ticks: &[Tick]) -> bool {
    let whole = session(making("premium"), |_, _| ());
    (force(ticks, TICKS - 1) - force(&whole, TICKS - 1)).abs() < 0.05
}

#[test]
fn nothing_is_told_of_a_session_without_fault() {
    let ticks = session(making("premium"), |_, _| ());
    assert!(force(&ticks, TICKS - 1) > 1.0);
    for (event, name) in Event::ALL {
        let expected = matches!(event, Event::Engaging | Event::Damped | Event::BeyondTrust);
        assert!(
            expected || with(&ticks, event).is_empty(),
            "the event {name} was raised without a fault, in ticks {:?}",
            with(&ticks, event)
        );
    }
    assert!(*with(&ticks, Event::Engaging).last().unwrap() < 250);
}

/// Ticks of a session whose simulation stalls: from tick `FAULT` on, for `ticks` ticks, the loop gets no new wrench.
fn stalled(ticks: u64, passivity: bool) -> Vec<Tick> {
    let (mut last, mut making) = (None, making("premium"));
    making.settings.passivity = passivity;
    one_session(making, |k, inputs| match (FAULT..FAULT + ticks).contains(&k) {
        true => inputs.newest = *last.get_or_insert(inputs.newest),
        false => last = None,
    })
}

#[test]
fn a_simulation_that_stalls_for_less_than_a_second_does_not_mute() {
    for (ticks, passivity) in [100, 300, 900].into_iter().flat_map(|ticks| [(ticks, true), (ticks, false)]) {
        let stalled = stalled(ticks, passivity);
        assert!(with(&stalled, Event::StaleWrench).is_empty() && has_recovered(&stalled));
        let before = force(&stalled, FAULT - 1);
        let kept = (FAULT..FAULT + ticks).all(|k| (force(&stalled, k) - before).abs() < 0.01 * before);
        assert!(before > 1.0 && kept, "the force is not kept in a stall of {ticks} ticks");
    }
}

#[test]
fn a_simulation_that_stalls_for_longer_lets_the_force_fade() {
    for passivity in [true, false] {
        let ticks = stalled(1500, passivity);
        let stale = with(&ticks, Event::StaleWrench);
        // When the stall began, the newest wrench was out of date by 20 to 40 ms; it is stale once it is out of date by
        // 1 s.
        assert!((FAULT + 960..=FAULT + 980).contains(&stale[0]), "ticks with a stale wrench: {stale:?}");
        assert!(force(&ticks, stale[0] - 1) > 1.0);
        // The force has faded within 50 ms and is still zero at the end of the stall.
        assert!(force(&ticks, stale[0] + 50) < 1e-9 && force(&ticks, FAULT + 1499) < 1e-9);
        assert!(*stale.last().unwrap() < FAULT + 1500 && has_recovered(&ticks));
    }
}

#[test]
fn a_force_that_is_there_from_the_start_rises_slowly_and_one_that_is_not_is_played_at_once() {
    let Making { settings, mut tool, .. } = making("premium");
    tool.centre = DVec3::ZERO;
    let start = tool.state();
    let reading = Reading { time: 0.0, state: start, buttons: 0 };
    let pushed = Wrench { force: DVec3::Y * 2.0, ..Wrench::ZERO };
    let mut wrench = ContactWrench { step: 5, wrench: pushed, pressing: 2.0, ..ContactWrench::none(start) };
    wrench.stiffness[1][1] = 500.0;
    for (newest, whole) in [(wrench, false), (ContactWrench { step: 5, ..ContactWrench::none(start) }, true)] {
        let mut servo = Servo::new(settings, tool.clone());
        let tick = |servo: &mut Servo, k: u64| servo.tick(k as f64 * PERIOD, 0.0, Ok(reading), &newest);
        let ticks: Vec<Tick> = (0..250).map(|k| tick(&mut servo, k)).collect();
        assert_eq!(ticks[0].gain == 1.0, whole, "gain (share of the force that is played) {}", ticks[0].gain);
        assert!(ticks[0].played.force.length() < 0.02 && ticks[249].gain == 1.0);
    }
}

#[test]
fn an_unplugged_device_is_told_nothing_until_it_is_back() {
    let lost = |k: u64| (FAULT..FAULT + 500).contains(&k);
    let at_reading = session(making("premium"), |k, inputs| {
        if lost(k) {
            inputs.reading = Err(Fault::Lost("unplugged".into()));
        }
    });
    let at_writing = session(making("premium"), |k, inputs| inputs.is_taken = !lost(k));
    for ticks in [at_reading, at_writing] {
        assert_eq!(with(&ticks, Event::DeviceLost), (FAULT..FAULT + 500).collect::<Vec<_>>());
        assert!((FAULT..FAULT + 500).all(|k| force(&ticks, k) == 0.0) && force(&ticks, FAULT - 1) > 1.0);
        // The force takes 200 ms to rise: ten ticks after the device is back, a twentieth of the force is played. The
        // hand has sunk into the wall meanwhile, so the whole force is greater than before the fault.
        assert!(force(&ticks, FAULT + 510) < 0.3, "force 10 ticks after the fault: {} N", force(&ticks, FAULT + 510));
        assert!(has_recovered(&ticks));
    }
}

#[test]
fn a_pose_that_is_no_number_is_not_used() {
    for odd in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let spoil: [fn(&mut Reading, f64); 4] = [
            |reading, odd| reading.state.position.y = odd,
            |reading, odd| reading.state.orientation.x = odd,
            |reading, odd| reading.state.velocity.z = odd,
            |reading, _| reading.state.orientation = DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0),
        ];
        for spoil in spoil {
            let ticks = session(making("premium"), |k, inputs| {
                if let (Ok(reading), true) = (&mut inputs.reading, (FAULT..FAULT + 200).contains(&k)) {
                    spoil(reading, odd);
                }
            });
            assert_eq!(with(&ticks, Event::BadReading), (FAULT..FAULT + 200).collect::<Vec<_>>());
            assert!(force(&ticks, FAULT + 60) < 1e-9, "after 60 ticks of fault: {} N", force(&ticks, FAULT + 60));
            assert!(has_recovered(&ticks));
        }
    }
    // A single bad reading hardly changes the force.
    let ticks = session(making("premium"), |k, inputs| {
        if let (Ok(reading), FAULT) = (&mut inputs.reading, k) {
            reading.state.position.x = f64::NAN;
        }
    });
    assert!(force(&ticks, FAULT + 1) > 0.9 * force(&ticks, FAULT - 1));
}

#[test]
fn a_pose_that_jumps_is_taken_only_once_the_force_has_gone() {
    for jump in [DVec3::X, DVec3::Y, DVec3::NEG_Y, DVec3::new(1.0, -1.0, 1.0).normalize()] {
        let ticks = session(making("premium"), |k, inputs| {
            if let (Ok(reading), true) = (&mut inputs.reading, k >= FAULT) {
                reading.state.position += 0.1 * jump;
            }
        });
        let jumped = with(&ticks, Event::PoseJump);
        assert_eq!(jumped[0], FAULT, "first tick with the event PoseJump, jump along {jump}");
        assert!(
            jumped.len() > 40 && jumped.len() < 60,
            "jump along {jump}: {} ticks have the event PoseJump",
            jumped.len()
        );
        let last = *jumped.last().unwrap();
        assert!(force(&ticks, last) < 1e-9, "last tick of the jump along {jump}: force {} N", force(&ticks, last));
        let device = ticks[last as usize].device.position;
        let before = ticks[FAULT as usize - 1].device.position;
        assert!((device - before - 0.1 * jump).length() < 0.01, "wrong displacement by the jump along {jump}");
    }
    // A single reading that jumps there and back is ignored.
    let ticks = session(making("premium"), |k, inputs| {
        if let (Ok(reading), FAULT) = (&mut inputs.reading, k) {
            reading.state.position.x += 0.1;
        }
    });
    assert_eq!(with(&ticks, Event::PoseJump), [FAULT]);
    assert!(ticks.iter().all(|tick| tick.device.position.x.abs() < 0.01) && has_recovered(&ticks));
}

#[test]
fn a_clock_that_jumps_starts_the_force_again() {
    for jump in [1.0, 3600.0, -1.0, -3600.0] {
        let ticks = session(making("premium"), |k, inputs| {
            if k >= FAULT {
                inputs.time += jump;
            }
        });
        assert_eq!(with(&ticks, Event::ClockJump), [FAULT], "ticks with the event ClockJump, jump of {jump} s");
        assert_eq!(force(&ticks, FAULT), 0.0, "force at a clock jump of {jump} s");
        assert!(has_recovered(&ticks), "clock jump of {jump} s: force at the end {} N", force(&ticks, TICKS - 1));
    }
    let ticks = session(making("premium"), |k, inputs| {
        if k == FAULT {
            inputs.time = f64::NAN;
        }
    });
    assert_eq!(with(&ticks, Event::ClockJump), [FAULT, FAULT + 1]);
}

#[test]
fn gains_ten_times_too_high_stay_within_the_limits() {
    let mut told = [0; 3];
    for profile in ["premium", "touch", "sigma.7"] {
        let mut making = making(profile);
        if let Some(coupling) = &mut making.tool.coupling {
            coupling.stiffness *= 10.0;
            coupling.damping *= 10.0;
            coupling.angular_stiffness *= 10.0;
            coupling.angular_damping *= 10.0;
        }
        // Even with such gains the force on a soft wall is steady; the force on a hard wall is not.
        for (passivity, wall) in [(true, 1000.0), (false, 1000.0), (true, 1e5), (false, 1e5)] {
            (making.settings.passivity, making.wall) = (passivity, wall);
            // `one_session` checks every tick against the limits.
            let ticks = one_session(making.clone(), |_, _| ());
            let events = [Event::Clamped, Event::SlewLimited, Event::Damped];
            events.iter().zip(&mut told).for_each(|(event, count)| *count += with(&ticks, *event).len());
        }
    }
    assert!(
        told.iter().sum::<usize>() > 0,
        "no limit acted; counts of clamped, slew-limited and damped forces: {told:?}"
    );
}

#[test]
fn gains_above_the_limits_are_lowered_and_said_so() {
    let profile = Profile::named("touch").unwrap();
    let chosen = coupling::choose(profile, PERIOD, 0.0, 0.05, 2e-6, None).coupling;
    let mut asked = chosen;
    (asked.stiffness, asked.damping) = (10.0 * chosen.stiffness, 10.0 * chosen.damping);
    let gains = coupling::choose(profile, PERIOD, 0.0, 0.05, 2e-6, Some(&asked));
    assert!(
        gains.coupling.stiffness <= profile.stiffness && gains.coupling.damping <= profile.damping,
        "gains above those of the profile: {gains:?}"
    );
    assert!(gains.reason.contains("lowered"), "the reason does not say that gains were lowered: {}", gains.reason);
}

#[test]
fn a_wrench_that_is_no_number_is_not_taken() {
    let ticks = session(making("premium"), |k, inputs| {
        if (FAULT..FAULT + 300).contains(&k) {
            inputs.newest.wrench.force.y = f64::NAN;
        }
    });
    assert!(with(&ticks, Event::BadWrench).len() > 200 && !with(&ticks, Event::StaleWrench).is_empty());
    assert!(has_recovered(&ticks));
    // A huge but finite force is accepted, and the limits bound what is played.
    session(making("premium"), |k, inputs| {
        if k > FAULT {
            inputs.newest.wrench.force.y = 1e30;
            inputs.newest.stiffness[1][1] = 1e30;
        }
    });
}

#[test]
fn beyond_the_workspace_nothing_is_played() {
    let mut making = making("premium");
    making.settings.limits.workspace = 0.004;
    let ticks = session(making, |_, _| ());
    let outside = with(&ticks, Event::OutsideWorkspace);
    assert!(outside.len() > 500, "only {} ticks outside the workspace", outside.len());
    assert!(force(&ticks, outside[100]) < 0.05, "force outside the workspace {} N", force(&ticks, outside[100]));
}
