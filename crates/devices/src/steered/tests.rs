//! What all devices without force share, with hardware that a test plays; the directions in which each moves the tool;
//! and what is said where there is none.

use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};

use palpate::internal::step::trajectory::rotation_vector;

use super::*;

/// News of the hardware that a test plays.
#[derive(Clone, Copy)]
enum News {
    Asked([DVec3; 2]),
    Placed(DVec3),
    Pressed(u32),
    /// The driver hangs for so long, ms.
    Hung(u64),
    Panicked,
    Ended,
}

/// Hardware whose news a test sends, and the strength of whose vibration it sees.
struct Played {
    news: Receiver<News>,
    strength: Arc<AtomicU64>,
}

impl Hardware for Played {
    fn unit(&self) -> String {
        "Test".into()
    }

    fn note(&self) -> String {
        "Test".into()
    }

    fn follow(&mut self, steering: &Steering) -> Result<(), Loss> {
        self.strength.store(steering.strength().to_bits(), Relaxed);
        match self.news.recv_timeout(Duration::from_millis(2)) {
            Ok(News::Asked(velocities)) => steering.ask(velocities),
            Ok(News::Placed(position)) => steering.goal.place(position, DQuat::IDENTITY),
            Ok(News::Pressed(buttons)) => steering.buttons.store(buttons, Relaxed),
            Err(RecvTimeoutError::Timeout) => {}
            Ok(News::Hung(ms)) => thread::sleep(Duration::from_millis(ms)),
            Ok(News::Panicked) => panic!("a planted fault of a driver"),
            Ok(News::Ended) => return Err(Loss::ForGood("the user has ended it".into())),
            Err(RecvTimeoutError::Disconnected) => return Err(Loss::ForNow("it was pulled out".into())),
        }
        Ok(())
    }
}

/// A device whose news a test sends.
struct Bench {
    device: Steered,
    /// Whether the hardware can be opened.
    is_there: Arc<AtomicBool>,
    strength: Arc<AtomicU64>,
}

/// When the sender of a receiver is dropped, the hardware is unplugged; the next receiver is the hardware plugged in
/// again.
fn plugged(receivers: Vec<Receiver<News>>) -> Bench {
    let (left, is_there) = (Mutex::new(receivers.into_iter()), Arc::new(AtomicBool::new(true)));
    let (can_open, strength) = (is_there.clone(), Arc::new(AtomicU64::new(0)));
    let seen = strength.clone();
    let opens = move |unit: Option<&str>| {
        assert!([None, Some("Test")].contains(&unit));
        if !can_open.load(Relaxed) {
            return Err("nothing is plugged in".to_string());
        }
        let news = left.lock().unwrap().next().ok_or("nothing is plugged in")?;
        Ok(Box::new(Played { news, strength: seen.clone() }) as Box<dyn Hardware>)
    };
    let device = Steered::with(Arc::new(opens), None, DVec3::new(0.3, 0.2, 0.1), DQuat::IDENTITY);
    Bench { device, is_there, strength }
}

/// Waits until the thread has brought something about.
fn until(what: &str, holds: impl Fn() -> bool) {
    let begun = Instant::now();
    while !holds() {
        assert!(begun.elapsed() < Duration::from_secs(20), "it never came about that {what}");
        thread::sleep(Duration::from_millis(1));
    }
}

/// Sends news, and waits until they are read; `mark` is other buttons than before.
fn sent(bench: &Bench, sender: &Sender<News>, news: &[News], mark: u32) {
    news.iter().chain(&[News::Pressed(mark)]).for_each(|news| sender.send(*news).unwrap());
    until("the news are read", || bench.device.steering.buttons.load(Relaxed) == mark);
}

/// Change of position and rotation vector over the readings of a second, at 1 kHz.
fn moved(device: &mut Steered, from: f64) -> [DVec3; 2] {
    let first = device.read(from).unwrap().state;
    let last = (1..=1000).map(|k| device.read(from + 1e-3 * f64::from(k)).unwrap().state).last().unwrap();
    let turn = last.orientation * first.orientation.conjugate();
    [last.position - first.position, rotation_vector(turn)]
}

#[test]
fn the_tool_moves_and_turns_as_long_as_the_controls_ask_for_it() {
    let (sender, receiver) = channel();
    let mut bench = plugged(vec![receiver]);
    bench.device.open().unwrap();
    let asked = [DVec3::new(0.05, -0.02, 0.01), DVec3::new(0.0, 0.9, -0.2)];
    sent(&bench, &sender, &[News::Asked(asked)], 1);
    // In the first second the device still hurries up to the goal.
    moved(&mut bench.device, 0.0);
    let [way, turn] = moved(&mut bench.device, 1.0);
    assert!((way - asked[0]).length() < 1e-4, "{way} m in a second");
    assert!((turn - asked[1]).length() < 1e-3, "{turn} rad in a second");
    sent(&bench, &sender, &[News::Asked([DVec3::ZERO; 2])], 2);
    moved(&mut bench.device, 2.0);
    let [way, turn] = moved(&mut bench.device, 3.0);
    assert!(way.length() < 1e-12 && turn.length() < 1e-12, "{way} m and {turn} rad while nobody pushes");
    // Hardware that knows places gives them.
    sent(&bench, &sender, &[News::Placed(DVec3::new(0.35, 0.2, 0.1))], 0x102);
    moved(&mut bench.device, 4.0);
    let reading = bench.device.read(5.5).unwrap();
    assert!((reading.state.position - DVec3::new(0.35, 0.2, 0.1)).length() < 1e-6, "{}", reading.state.position);
    assert_eq!(reading.buttons, 0x102);
    // A clock that stands, or is none, moves nothing.
    sent(&bench, &sender, &[News::Asked(asked)], 3);
    let goal = bench.device.goal.pose();
    for time in [5.5, f64::NAN, f64::NEG_INFINITY, 5.0, 5.0] {
        assert_eq!(bench.device.read(time).unwrap().state.position, reading.state.position, "at {time} s");
        assert_eq!(bench.device.goal.pose(), goal, "at {time} s");
    }
}

#[test]
fn small_pushes_move_finely() {
    let dead = 0.1;
    let speed = |push: f64| speeds([DVec3::X * push, DVec3::Z * push], dead);
    assert_eq!(speed(0.1), [DVec3::ZERO; 2], "within the dead zone");
    assert_eq!(speed(-0.0999), [DVec3::ZERO; 2], "within the dead zone");
    // Half of what is above the dead zone asks for a quarter of the speed.
    let [way, turn] = speed(-0.55);
    assert!((way + 0.025 * DVec3::X).length() < 1e-12 && (turn + 0.375 * DVec3::Z).length() < 1e-12, "{way} {turn}");
    // Hardware that reports more than its range is no faster.
    assert_eq!(speed(1.0), speed(7.0));
    assert_eq!(speed(1.0), [0.1 * DVec3::X, 1.5 * DVec3::Z]);
}

#[test]
fn hardware_that_is_pulled_out_stops_and_goes_on_from_there_when_it_is_back() {
    let (sender, receiver) = channel();
    let (again, other) = channel();
    let mut bench = plugged(vec![receiver, other]);
    bench.device.open().unwrap();
    sent(&bench, &sender, &[News::Asked([0.1 * DVec3::X, DVec3::ZERO])], 1);
    moved(&mut bench.device, 0.0);
    let steering = bench.device.steering.clone();
    let is_lost = || steering.is_lost.load(Relaxed);
    bench.is_there.store(false, Relaxed);
    drop(sender);
    until("it is lost", is_lost);
    let fault = bench.device.read(1.1).unwrap_err().to_string();
    assert!(fault.contains("pulled out") || fault.contains("nothing is plugged in"), "{fault}");
    bench.is_there.store(true, Relaxed);
    until("it is back", || !is_lost());
    let [way, _] = moved(&mut bench.device, 2.0);
    let [rest, _] = moved(&mut bench.device, 3.0);
    assert!(way.length() < 6e-3 && rest.length() < 1e-9, "{way} m, then {rest} m with controls that nobody pushes");
    sent(&bench, &again, &[News::Asked([0.1 * DVec3::Z, DVec3::ZERO])], 2);
    moved(&mut bench.device, 4.0);
    let [way, _] = moved(&mut bench.device, 5.0);
    assert!((way - 0.1 * DVec3::Z).length() < 1e-3, "{way} m with the hardware that is back");
}

#[test]
fn the_force_is_shown_by_vibration() {
    let (_sender, receiver) = channel();
    let mut bench = plugged(vec![receiver]);
    bench.device.open().unwrap();
    let greatest = MOUSE.max_force;
    // A quarter of the greatest force vibrates by half.
    for (force, expected) in [(0.25 * greatest, 0.5), (greatest, 1.0), (0.0, 0.0)] {
        bench.device.write(&Wrench { force: -force * DVec3::Y, torque: DVec3::ONE }).unwrap();
        let strength = || f64::from_bits(bench.strength.load(Relaxed));
        until("the hardware knows the force", || (strength() - expected).abs() < 1e-12);
    }
}

#[test]
fn a_vibration_is_renewed_before_it_ends_and_told_no_more_often_than_it_changes() {
    let (begun, ms) = (Instant::now(), Duration::from_millis);
    let mut vibration = Vibration::none();
    let mut due = |strength: f64, at: u64| vibration.due(strength, begun + ms(at));
    assert_eq!(due(0.0, 0), None, "nothing is to be felt");
    assert_eq!(due(0.01, 1), None, "too little to be felt");
    assert_eq!(due(0.5, 2), Some(0.5));
    assert_eq!(due(0.505, 3), None);
    assert_eq!(due(0.52, 4), Some(0.52));
    assert_eq!(due(0.52, 103), None);
    assert_eq!(due(0.52, 104), Some(0.52), "it is renewed");
    assert_eq!(due(0.01, 105), Some(0.0), "it ends");
    assert_eq!(due(0.0, 1000), None);
    assert!(Vibration::RENEWS + Vibration::TICK < Vibration::LASTS);
}

#[test]
fn a_driver_that_hangs_or_panics_is_a_lost_device_and_holds_up_nobody() {
    for fault in [News::Hung(60_000), News::Panicked] {
        let (sender, receiver) = channel();
        let mut bench = plugged(vec![receiver]);
        bench.device.open().unwrap();
        sent(&bench, &sender, &[News::Asked([0.1 * DVec3::X, DVec3::ZERO])], 1);
        moved(&mut bench.device, 0.0);
        sender.send(fault).unwrap();
        until("its silence is noticed", || bench.device.steering.check().is_err());
        let (place, begun) = (bench.device.goal.pose(), Instant::now());
        let fault = bench.device.read(2.0).unwrap_err().to_string();
        assert!(fault.contains("has not answered for "), "{fault}");
        assert_eq!(bench.device.goal.pose(), place, "a lost device moves nothing");
        bench.device.close();
        assert!(begun.elapsed() < Duration::from_secs(30), "closing waited for the driver");
    }
}

#[test]
fn what_the_user_has_ended_is_not_opened_again() {
    let (sender, receiver) = channel();
    let mut bench = plugged(vec![receiver, channel().1]);
    bench.device.open().unwrap();
    sender.send(News::Ended).unwrap();
    let steering = bench.device.steering.clone();
    until("it is lost", || steering.is_lost.load(Relaxed));
    thread::sleep(RETRY + Duration::from_millis(100));
    assert_eq!(bench.device.read(1.0), Err(Fault::Lost("the user has ended it".into())));
}

#[test]
fn a_device_that_cannot_be_opened_says_why() {
    let mut bench = plugged(vec![channel().1]);
    assert!(bench.device.notes().is_empty());
    bench.device.identify().unwrap();
    assert_eq!(bench.device.notes(), ["Test"]);
    // The hardware that was identified is that which is opened.
    bench.device.open().unwrap();
    bench.device.close();
    assert_eq!(bench.device.open(), Err(Fault::Lost("nothing is plugged in".into())));
    bench.device.close();
}

/// On a machine that has the hardware, a name that it does not have.
#[test]
fn where_there_is_none_one_line_says_so() {
    let all: [(DeviceKind, &[&str]); 3] = [
        (DeviceKind::SpaceMouse, &["called no such device is plugged in", "cannot be listed"]),
        (DeviceKind::GamePad, &["no game pad called no such device"]),
        (DeviceKind::OpenXr, &["no such device is no hand; give left or right"]),
    ];
    for (kind, told) in all {
        let unit = Some("no such device".into());
        let fault = Steered::new(kind, unit, DVec3::ZERO, DQuat::IDENTITY).open().unwrap_err().to_string();
        let is_told = fault.contains("on Linux alone") || told.iter().any(|told| fault.contains(told));
        assert!(is_told && !fault.contains('\n'), "{fault}");
    }
}

#[cfg(target_os = "linux")]
mod on_linux {
    use super::*;
    use crate::steered::game_pad::{self, SHOULDER, Sticks};
    use crate::steered::openxr::{Carrier, runs, why_unknown};
    use crate::steered::space_mouse::{DEAD, Reports, SpaceMouse};
    use ::openxr::SessionState as State;

    /// A report of a SpaceMouse: its kind, and 16-bit numbers.
    fn report(kind: u8, numbers: &[i16]) -> Vec<u8> {
        [kind].into_iter().chain(numbers.iter().flat_map(|number| number.to_le_bytes())).collect()
    }

    /// What a SpaceMouse asks for after reports, and its buttons.
    fn after(reports: Vec<Vec<u8>>) -> ([DVec3; 2], u32) {
        let count = reports.len();
        let mut left = reports.into_iter();
        let reports: Reports = Box::new(move |_| Ok(left.next().unwrap()));
        let (mut mouse, steering) =
            (SpaceMouse::new("Test".into(), "Test".into(), reports), Steering::new(Goal::default()));
        (0..count).for_each(|_| assert!(mouse.follow(&steering).is_ok()));
        (steering.velocities(), steering.buttons.load(Relaxed))
    }

    #[test]
    fn a_cap_moves_the_tool_along_the_axes_of_the_world() {
        let directions = [DVec3::X, DVec3::Z, -DVec3::Y];
        for (k, direction) in directions.into_iter().enumerate() {
            let mut push = [0; 6];
            push[k] = 350;
            // Newer models send the rotation with the translation.
            for first in [report(1, &push[..3]), report(1, &push)] {
                let ([way, turn], _) = after(vec![first, report(2, &[0, 0, 0])]);
                assert!((way - 0.1 * direction).length() < 1e-12 && turn == DVec3::ZERO, "axis {k}: {way} {turn}");
            }
            let mut turned = [0; 3];
            turned[k] = -350;
            let ([way, turn], _) = after(vec![report(1, &[0; 6]), report(2, &turned)]);
            assert!((turn + 1.5 * direction).length() < 1e-12 && way == DVec3::ZERO, "axis {k}: {way} {turn}");
        }
    }

    #[test]
    fn what_is_no_report_of_a_cap_moves_nothing() {
        assert_eq!(after(vec![report(1, &[14, -14, 10])]).0, [DVec3::ZERO; 2], "within the dead zone");
        let half = (350.0 * (DEAD + 0.5 * (1.0 - DEAD))) as i16;
        let odd = vec![report(1, &[half, 0, 0]), vec![3, 2, 1], vec![], vec![1], vec![1, 7], vec![9, 255, 255]];
        let ([way, _], buttons) = after(odd);
        assert!((way - 0.025 * DVec3::X).length() < 3e-4, "{way} m/s at half of the push");
        assert_eq!(buttons, 0x102);
    }

    #[test]
    fn a_pads_sticks_move_the_tool_and_turn_it_with_the_shoulder_button() {
        // Other buttons change nothing.
        let buttons = |turns: bool| if turns { 1 | SHOULDER } else { !SHOULDER };
        let pushes = |sticks, turns| game_pad::pushes(sticks, buttons(turns)).map(|way| way + DVec3::ZERO);
        let cases = [
            ([1.0, 0.0, 0.0, 0.0], false, [DVec3::X, DVec3::ZERO]),
            ([0.0, 1.0, 0.0, 0.0], false, [DVec3::Z, DVec3::ZERO]),
            // A stick that is pushed forward reports less.
            ([0.0, 0.0, 0.0, -1.0], false, [DVec3::Y, DVec3::ZERO]),
            ([0.0, 0.0, 1.0, 0.0], false, [DVec3::ZERO, -DVec3::Y]),
            ([1.0, 0.0, 0.0, 0.0], true, [DVec3::ZERO, -DVec3::Z]),
            ([0.0, 1.0, 0.0, 0.0], true, [DVec3::ZERO, DVec3::X]),
            ([0.0, 0.0, 0.0, -1.0], true, [DVec3::Y, DVec3::ZERO]),
        ];
        for (sticks, turns, expected) in cases {
            assert_eq!(pushes(sticks, turns), expected, "{sticks:?}, turning: {turns}");
        }
        // To the right: the top of the tool goes to the right.
        let [_, turn] = pushes([1.0, 0.0, 0.0, 0.0], true);
        assert!(turn.cross(DVec3::Y).x > 0.0);
        // Towards the user: its top comes to the user.
        let [_, turn] = pushes([0.0, 1.0, 0.0, 0.0], true);
        assert!(turn.cross(DVec3::Y).z > 0.0);
    }

    #[test]
    fn a_stick_reports_shares_of_its_way() {
        assert_eq!([0, 255].map(|value| game_pad::share(value, 0, 255)), [-1.0, 1.0]);
        assert!(game_pad::share(128, 0, 255).abs() < game_pad::DEAD);
        assert_eq!([-32768, 32767].map(|value| game_pad::share(value, -32768, 32767)), [-1.0, 1.0]);
        assert_eq!(game_pad::share(i32::MAX, 0, 255), 1.0, "a pad that reports more than it says");
        assert_eq!(game_pad::share(5, 0, 0), 0.0, "a pad that says nothing of its range");
        assert!((game_pad::share(i32::MAX, i32::MIN, i32::MAX) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_stick_that_was_never_released_asks_for_nothing() {
        let mut sticks = Sticks::default();
        // What the kernel knows before the first report, of sticks that go from 0 to 255.
        assert_eq!(sticks.released_once([-1.0; 4]), [0.0; 4]);
        assert_eq!(sticks.released_once([-1.0, 0.01, -1.0, 1.0]), [0.0, 0.01, 0.0, 0.0]);
        assert_eq!(sticks.released_once([-0.5, -1.0, 0.0, 1.0]), [0.0, -1.0, 0.0, 0.0]);
        assert_eq!(sticks.released_once([0.0, 1.0, 0.7, 0.1]), [0.0, 1.0, 0.7, 0.1]);
        assert_eq!(sticks.released_once([1.0; 4]), [1.0; 4]);
    }

    /// Position and orientation of a goal.
    fn goal() -> (DVec3, DQuat) {
        (DVec3::new(1.0, 2.0, 3.0), DQuat::from_rotation_z(0.4))
    }

    #[test]
    fn a_controller_carries_the_tool_from_where_both_were() {
        let (position, orientation) = goal();
        let steering = Steering::new(Goal::new(position, orientation));
        let first = (DVec3::new(-0.2, 1.1, -0.3), DQuat::from_rotation_x(1.0));
        let mut carrier = Carrier::default();
        let mut after = |pose| {
            carrier.take(Some(pose), || unreachable!(), &steering);
            steering.goal.pose()
        };
        let (at, turned) = after(first);
        assert!((at - position).length() < 1e-12 && turned.angle_between(orientation) < 1e-7, "{at} {turned}");
        // Turned about an axis of the world, the tool turns about that axis too.
        let turn = DQuat::from_axis_angle(DVec3::new(0.36, 0.48, 0.8), 0.7);
        let (at, turned) = after((first.0 + 0.01 * DVec3::Y, turn * first.1));
        assert!((at - position - 0.01 * DVec3::Y).length() < 1e-12, "{at}");
        assert!(turned.angle_between(turn * orientation) < 1e-7, "{turned}");
    }

    #[test]
    fn a_controller_that_is_found_again_carries_the_tool_on_from_where_it_stayed() {
        let (position, orientation) = goal();
        let steering = Steering::new(Goal::new(position, orientation));
        let mut carrier = Carrier::default();
        let mut take = |x: Option<f64>| {
            let pose = x.map(|x| (DVec3::X * x, DQuat::IDENTITY));
            carrier.take(pose, || "out of sight".into(), &steering);
            steering.goal.pose().0.x - position.x
        };
        take(Some(0.0));
        assert!((take(Some(0.1)) - 0.1).abs() < 1e-12);
        for _ in 0..2 {
            assert!((take(None) - 0.1).abs() < 1e-12);
            assert_eq!(steering.check(), Err(Fault::Lost("out of sight".into())));
        }
        // It comes back at another place.
        assert!((take(Some(0.7)) - 0.1).abs() < 1e-12, "the tool leaps");
        assert_eq!(steering.check(), Ok(()));
        assert!((take(Some(0.8)) - 0.2).abs() < 1e-12);
    }

    #[test]
    fn a_session_says_why_it_knows_no_controller() {
        let told = |state, words: &str| why_unknown(state, "left").contains(words);
        assert!(runs(State::FOCUSED) && told(State::FOCUSED, "of the left hand is not tracked"));
        for state in [State::READY, State::SYNCHRONIZED, State::VISIBLE] {
            assert!(runs(state) && told(state, "another application"), "{state:?}");
        }
        for state in [State::IDLE, State::STOPPING, State::EXITING, State::LOSS_PENDING] {
            assert!(!runs(state) && told(state, "has not begun the session"), "{state:?}");
        }
    }
}
