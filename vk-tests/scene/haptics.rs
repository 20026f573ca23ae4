//! Tests of the haptic loop with the engine and a simulated hand, in virtual time (one thread, no clock, the same bits
//! every time). With the local model, which extrapolates the newest contact wrench between simulation steps, contact
//! must be stable even where it is unstable if that wrench is played unchanged. The hand must gain no energy; a steady
//! force must be free of noise and equal to that of the simulation; and a drag along the skin (surface mesh) must add
//! no damping. The passivity observer accounts for the energy that the hand gets, and the passivity controller damps
//! where that is too much. The loop may *lend* energy to the hand, for a contact force that appears late, after the
//! hand has already moved.

use glam::{DQuat, DVec3};
use palpate::internal::haptics::environment::Environment;
use palpate::internal::haptics::event::Event;
use palpate::internal::haptics::safety::Limits;
use palpate::internal::haptics::servo::{Servo, Settings, Tick};
use palpate::internal::haptics::virtual_time::{self, Schedule};
use palpate::internal::haptics::{Device, coupling};
use palpate::internal::step::tool::Tool;
use palpate::internal::step::trajectory::Trajectory;
use palpate::internal::step::{ContactWrench, DeviceInput};
use palpate::scene::{Haptics, Key, Lowered, Profile};
use palpate::{Options, Simulation};
use palpate_devices::{Hand, HandParameters, Scripted};

use crate::scene::whole_step::scene;

/// Period of a tick (one cycle of the haptic loop), s.
const PERIOD: f64 = 1e-3;
/// Rate of the simulation, Hz.
const RATE: f64 = 50.0;
/// Young's modulus of the block, Pa: the tool, a sphere of 10 mm radius, feels a stiffness of 2 kN/m.
const YOUNG: f64 = 1.5e5;

/// A block of 80 mm with a fixed bottom and its top at y = 0, and a sphere above it as the tool.
fn block() -> Simulation {
    let text = format!(
        "[step]\ndt = 0.02\ngravity = [0.0, 0.0, 0.0]\n[solver]\nmax_iterations = 1000\n\
         [contact]\ndamping = 2e5\n\
         [[body]]\nname = \"block\"\n\
         layer = {{ box = [[-0.04, -0.05, -0.04], [0.04, 0.0, 0.04]], cells = [10, 6, 10] }}\n\
         material = {{ young = {YOUNG:e}, poisson = 0.45, density = 1000.0, damping_stiffness = 0.002 }}\n\
         [[body.core]]\nname = \"bottom\"\nbind = {{ box = [[-1.0, -1.0, -1.0], [1.0, -0.049, 1.0]] }}\n\
         [tool]\nsphere = 0.01\nmass = 0.05\nposition = [0.001, 0.011, -0.002]\n"
    );
    // Vulkan validation is left off: it would slow these runs down too much.
    let options = Options { device: std::env::var("PALPATE_TEST_DEVICE").ok(), ..Options::of_program() };
    Simulation::open(&scene(&text), &options).unwrap()
}

/// All ticks of a run of the haptic loop, and the simulated hand after the run.
struct Session {
    ticks: Vec<Tick>,
    hand: Hand,
}

impl Session {
    /// Mean and standard deviation of the played force along y, N, over the second from tick `from` on.
    fn force(&self, from: usize) -> (f64, f64) {
        let forces: Vec<f64> = self.ticks[from..from + 1000].iter().map(|tick| tick.played.force.y).collect();
        let mean = forces.iter().sum::<f64>() / 1000.0;
        (mean, (forces.iter().map(|f| (f - mean).powi(2)).sum::<f64>() / 1000.0).sqrt())
    }
}

/// Runs the loop with a simulated hand that holds a delta.6 haptic device. The hand intends to press the tool `deep` m
/// below the block's top, to stay there from 0.5 s to `until` (s), and then to lift it off. `adjust` changes the loop's
/// settings before the run of `seconds` s.
fn press(deep: f64, until: f64, seconds: f64, adjust: impl FnOnce(&mut Settings)) -> Session {
    let mut simulation = block();
    let profile = Profile::named("delta.6").unwrap();
    let (limits, _) = Limits::new(profile, &Lowered::default());
    let tool = simulation.tool().unwrap().clone();
    let inertia = tool.inertia.col(0).x;
    let gains = coupling::choose(profile, PERIOD, 0.0, tool.mass, inertia, None);
    let mut settings = Settings {
        period: PERIOD,
        limits,
        local_model: true,
        passivity: true,
        most_damping: gains.most_damping,
        trust: Haptics::default().trust,
        arm: (inertia / tool.mass).sqrt(),
        resolution: profile.step(),
    };
    adjust(&mut settings);
    let start = tool.centre;
    let key = |time: f64, y: f64| key(time, DVec3::new(start.x, y, start.z));
    let keys =
        [key(0.0, start.y), key(0.3, start.y), key(0.5, 0.01 - deep), key(until, 0.01 - deep), key(until + 0.3, 0.02)];
    let mut servo = Servo::new(settings, Tool { coupling: Some(gains.coupling), ..tool });
    let mut hand = Hand::new(HandParameters::default(), Trajectory::new(&keys, keys[0]), profile.clone()).unwrap();
    hand.open().unwrap();
    let (mut ticks, count) = (Vec::new(), (seconds / PERIOD) as u64);
    let schedule = Schedule::at(RATE, PERIOD);
    virtual_time::run(&mut hand, &mut servo, &mut simulation, schedule, count, |tick| ticks.push(*tick)).unwrap();
    Session { ticks, hand }
}

#[test]
#[ignore = "long: 8 s"]
fn at_50_hz_a_body_of_two_kilonewtons_a_metre_is_held_and_without_the_local_model_it_swings() {
    let press =
        |deep: f64, local_model: bool| press(deep, 10.0, 2.5, |s| (s.local_model, s.passivity) = (local_model, false));
    let [soft, hard] = [0.01, 0.014].map(|deep| press(deep, true));
    let [(less, _), (more, noise)] = [&soft, &hard].map(|session| session.force(1500));
    let [high, low] = [&soft, &hard].map(|session| session.ticks.last().unwrap().tool.position.y);
    let stiffness = (more - less) / (high - low);
    let (_, raw) = press(0.014, false).force(1500);
    println!(
        "stiffness felt {stiffness:.0} N/m; at a force of {more:.2} N, standard deviation of the force {noise:.1e} N \
         with the local model, {raw:.2} N without"
    );
    assert!((1700.0..2300.0).contains(&stiffness), "stiffness {stiffness} N/m, expected 1700 to 2300 N/m");
    // The standard deviation of a steady force must be below 1 % of the force or 0.01 N.
    assert!(
        noise < (0.01 * more).max(0.01),
        "with the local model: standard deviation {noise} N of a force of {more} N"
    );
    assert!(raw > 0.2 * more, "without the local model: standard deviation {raw} N of a force of {more} N");
}

#[test]
fn a_press_hold_and_release_gives_the_hand_no_energy() {
    for local_model in [true, false] {
        let session = press(0.01, 1.5, 2.5, |s| s.local_model = local_model);
        let peak = session.ticks.iter().map(|tick| tick.played.force.length()).fold(0.0, f64::max);
        let changes = session.ticks.windows(2).map(|pair| (pair[1].played.force - pair[0].played.force).length());
        let variation: f64 = changes.sum();
        let most = (Profile::named("delta.6").unwrap().step() * (peak + 0.5 * variation)).max(1e-6);
        let (seen, received) = (session.ticks.last().unwrap().energy.net(), session.hand.energy().received());
        let lent = session.ticks.iter().map(|tick| tick.energy.lent).fold(0.0, f64::max);
        println!(
            "local model {local_model}: the hand received {received:.1e} J ({seen:.1e} J by the passivity observer); \
             {lent:.1e} J were lent, and {most:.1e} J more are allowed; peak force {peak:.2} N"
        );
        assert!(
            peak > 1.0 && received <= lent + most && seen <= lent + most && lent < 1e-4,
            "local model {local_model}: the hand received {received} J, {seen} J by the observer; peak force {peak} N"
        );
    }
}

/// A simulation, and the contact wrenches of all its steps so far.
struct Recorded<'a> {
    simulation: &'a mut Simulation,
    wrenches: Vec<ContactWrench>,
}

impl Environment for Recorded<'_> {
    fn feel_each(&mut self, inputs: &[DeviceInput], h: f64) -> palpate::Result<Vec<ContactWrench>> {
        let wrenches = self.simulation.feel_each(inputs, h)?;
        self.wrenches.extend(&wrenches);
        Ok(wrenches)
    }
}

/// Runs the loop with a scripted device, which has the named profile (limits of one model of haptic device) and follows
/// keys, poses at given times, exactly; passivity control is on. Returns all ticks of the loop, and the contact
/// wrenches of all simulation steps.
fn follow(simulation: &mut Simulation, profile: &str, keys: &[Key], seconds: f64) -> (Vec<Tick>, Vec<ContactWrench>) {
    let profile = Profile::named(profile).unwrap();
    let tool = simulation.tool().unwrap().clone();
    let inertia = tool.inertia.col(0).x;
    let gains = coupling::choose(profile, PERIOD, 0.0, tool.mass, inertia, None);
    let settings = Settings {
        period: PERIOD,
        limits: Limits::new(profile, &Lowered::default()).0,
        local_model: true,
        passivity: true,
        most_damping: gains.most_damping,
        trust: Haptics::default().trust,
        arm: (inertia / tool.mass).sqrt(),
        resolution: profile.step(),
    };
    let mut servo = Servo::new(settings, Tool { coupling: Some(gains.coupling), ..tool });
    let mut device = Scripted::new(Trajectory::new(keys, keys[0]), profile.clone(), PERIOD);
    device.open().unwrap();
    let mut ticks = Vec::new();
    let mut recorded = Recorded { simulation, wrenches: Vec::new() };
    let schedule = Schedule::at(RATE, PERIOD);
    let count = (seconds / PERIOD) as u64;
    virtual_time::run(&mut device, &mut servo, &mut recorded, schedule, count, |tick| ticks.push(*tick)).unwrap();
    (ticks, recorded.wrenches)
}

fn key(time: f64, position: DVec3) -> Key {
    Key { time, position, orientation: DQuat::IDENTITY }
}

/// True if the passivity controller acted in a tick.
fn acts(tick: &&Tick) -> bool {
    tick.events.has_any(&[Event::Damped, Event::Unpaid])
}

#[test]
#[ignore = "long: 11 s"]
fn a_force_held_is_that_of_the_step_and_of_the_block_at_rest_and_the_first_touch_is_not_lent() {
    for profile in ["touch", "premium", "sigma.7"] {
        let mut simulation = block();
        let start = simulation.tool().unwrap().centre;
        let [above, deep] = [start, DVec3::new(start.x, 0.008, start.z)];
        // The device moves in at 10 mm/s, stays for two seconds and moves out again.
        let keys = [key(0.0, above), key(0.1, above), key(0.4, deep), key(2.4, deep), key(2.7, above)];
        let (ticks, wrenches) = follow(&mut simulation, profile, &keys, 3.0);
        let input = &ticks[2300];
        let (played, step) = (input.played.force.length(), wrenches[input.step as usize - 1].wrench.force.length());
        // For comparison, the block without the haptic loop: the device stays at the same place, with the same virtual
        // coupling, until nothing moves.
        let mut alone = block();
        let coupling = coupling::choose(
            Profile::named(profile).unwrap(),
            PERIOD,
            0.0,
            0.05,
            simulation.tool().unwrap().inertia.col(0).x,
            None,
        );
        alone.couple(Some(coupling.coupling));
        let pose = |position| palpate::Pose { position, orientation: DQuat::IDENTITY };
        let rest = (0..150).map(|_| alone.step_at(pose(input.device.position)).unwrap()).last().unwrap();
        let rest = rest.tool.unwrap().force.length();
        println!(
            "{profile}: force played {played:.4} N, of the simulation step {step:.4} N, of the block at rest \
             {rest:.4} N"
        );
        assert!(
            played > 0.3 && (played / step - 1.0).abs() < 0.03 && (played / rest - 1.0).abs() < 0.03,
            "{profile}: the force played is not that of the step and of the block at rest"
        );
        let acting = ticks.iter().filter(acts).count() as f64 / ticks.len() as f64;
        let lent = ticks.iter().map(|tick| tick.energy.lent).fold(0.0, f64::max);
        assert!(
            acting < 0.01 && lent < 1e-6,
            "{profile}: share of ticks in which passivity control acts {acting}; energy lent {lent} J"
        );
        let net: f64 = ticks
            .windows(2)
            .map(|pair| {
                let [from, to] = [&pair[0], &pair[1]].map(|tick| tick.reading.unwrap().state.position);
                pair[0].played.force.dot(to - from)
            })
            .sum();
        assert!(net < 1e-6, "{profile}: the hand received {net} J");
    }
}

/// Opens a simulation of a soft head, with a sphere above its cheek as the tool.
fn head() -> Simulation {
    let text = "[[body]]\nname = \"head\"\nsurface = { model = \"head\", vertices = 6000 }\nlayer = { cell = 0.018 }\n\
         material = { young = 2e4, poisson = 0.45, density = 1000.0, damping_stiffness = 0.002 }\n\
         [[body.core]]\nname = \"skull\"\nmotion = \"fixed\"\nbind = { inset = 0.03 }\n\
         [tool]\nsphere = 0.01\nmass = 0.05\nposition = [0.03, -0.02, 0.092]\n";
    let options = Options { device: std::env::var("PALPATE_TEST_DEVICE").ok(), ..Options::of_program() };
    Simulation::open(&scene(text), &options).unwrap()
}

#[test]
#[ignore = "long: 24 s"]
fn a_drag_over_the_head_adds_no_damping_to_the_force_along_the_motion() {
    for profile in ["touch", "premium", "sigma.7"] {
        let mut simulation = head();
        let at = |y: f64, z: f64| DVec3::new(0.03, y, z);
        let (above, pressed, along) = (at(-0.02, 0.092), at(-0.02, 0.082), at(0.01, 0.082));
        let keys = [
            key(0.0, above),
            key(0.1, above),
            key(0.5, pressed),
            key(1.0, pressed),
            key(2.5, along),
            key(2.8, along),
            key(3.1, at(0.01, 0.1)),
        ];
        let (ticks, wrenches) = follow(&mut simulation, profile, &keys, 3.3);
        let median = |mut forces: Vec<f64>| {
            forces.sort_unstable_by(f64::total_cmp);
            forces[forces.len() / 2]
        };
        let dragged: Vec<&Tick> = ticks.iter().filter(|tick| (1.2..2.4).contains(&tick.time)).collect();
        let played = median(dragged.iter().map(|tick| tick.played.force.y).collect());
        let steps = dragged[0].step as usize..dragged[dragged.len() - 1].step as usize;
        let found = median(wrenches[steps].iter().map(|wrench| wrench.wrench.force.y).collect());
        let left_out = median(dragged.iter().map(|tick| (tick.played.force.y - tick.contact.force.y).abs()).collect());
        let along = median(dragged.iter().map(|tick| tick.contact.force.y.abs()).collect());
        println!(
            "{profile}: force along the drag {played:.4} N played, {found:.4} N computed by the simulation; \
             {left_out:.5} N of the contact force of {along:.4} N are not played"
        );
        let size = median(dragged.iter().map(|tick| tick.played.force.length()).collect());
        assert!(
            size > 1.0 && (played - found).abs() < 0.03 * size,
            "{profile}: force along the drag {played} N played, {found} N computed; magnitude of the force {size} N"
        );
        assert!(
            left_out < 0.03 * along,
            "{profile}: of the contact force of {along} N along the drag, {left_out} N are not played"
        );
        assert!(
            dragged.iter().filter(|tick| acts(tick)).count() * 100 < dragged.len(),
            "{profile}: passivity control acts in 1 % of the ticks or more"
        );
        // Once the tool is lifted off, nothing holds the device back.
        assert!(
            ticks[3250].played.force.length() < 0.01 && ticks[3250].contact.force == DVec3::ZERO,
            "{profile}: a force remains after the tool was lifted off"
        );
    }
}
