//! The loop with the engine, held by the simulated hand, in virtual time: contact that the local model keeps and the raw
//! force does not, no energy given, a quiet force at rest.

use glam::{DQuat, DVec3};
use palpate::gpu::Options;
use palpate::haptics::devices::{Hand, HandParameters};
use palpate::haptics::drive::Drive;
use palpate::haptics::safety::{Limits, Lowered};
use palpate::haptics::servo::{Servo, Settings, Tick};
use palpate::haptics::tool::Tool;
use palpate::haptics::virtual_time::{self, Schedule};
use palpate::haptics::{Device, Profile, coupling};
use palpate::scene::Key;
use palpate::step::Simulation;

use crate::whole_step::scene;

const PERIOD: f64 = 1e-3;
/// Of the simulation, Hz.
const RATE: f64 = 50.0;
/// Pa, so that a sphere of 10 mm feels 2 kN/m.
const YOUNG: f64 = 1.5e5;

/// A block of 80 mm with a fixed bottom, its top at y = 0, and a sphere above it.
fn block() -> Simulation {
    let text = format!(
        "[step]\ngravity = [0.0, 0.0, 0.0]\n[solver]\nmax_iterations = 1000\n\
         [[body]]\nname = \"block\"\n\
         layer = {{ box = [[-0.04, -0.05, -0.04], [0.04, 0.0, 0.04]], cells = [10, 6, 10] }}\n\
         material = {{ young = {YOUNG:e}, poisson = 0.45, density = 1000.0, damping_stiffness = 0.002 }}\n\
         [[body.core]]\nname = \"bottom\"\nbind = {{ box = [[-1.0, -1.0, -1.0], [1.0, -0.049, 1.0]] }}\n\
         [tool]\nsphere = 0.01\nmass = 0.05\nposition = [0.001, 0.011, -0.002]\n"
    );
    // Long runs: validation is for the short ones.
    let options = Options { device: std::env::var("PALPATE_TEST_DEVICE").ok(), ..Options::default() };
    Simulation::new(&scene(&text), &options, None).unwrap()
}

struct Session {
    ticks: Vec<Tick>,
    hand: Hand,
}

impl Session {
    /// Force along y, mean and standard deviation over a second from a tick on, N.
    fn force(&self, from: usize) -> (f64, f64) {
        let forces: Vec<f64> = self.ticks[from..from + 1000].iter().map(|tick| tick.played.force.y).collect();
        let mean = forces.iter().sum::<f64>() / 1000.0;
        (mean, (forces.iter().map(|f| (f - mean).powi(2)).sum::<f64>() / 1000.0).sqrt())
    }
}

/// A hand on a delta.6 that means to press so deep below the block's top and hold, from 0.5 s to `until`, then lets go.
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
        most_damping: profile.damping,
        trust: 2e-3,
        arm: (inertia / tool.mass).sqrt(),
    };
    adjust(&mut settings);
    let start = tool.centre;
    let key = |time: f64, y: f64| Key { time, position: DVec3::new(start.x, y, start.z), orientation: DQuat::IDENTITY };
    let keys =
        [key(0.0, start.y), key(0.3, start.y), key(0.5, 0.01 - deep), key(until, 0.01 - deep), key(until + 0.3, 0.02)];
    let mut servo = Servo::new(settings, Tool { coupling: Some(gains.coupling), ..tool });
    let mut hand = Hand::new(HandParameters::default(), Drive::new(&keys, keys[0]), profile.clone()).unwrap();
    hand.open().unwrap();
    let (mut ticks, count) = (Vec::new(), (seconds / PERIOD) as u64);
    let schedule = Schedule::at(RATE, PERIOD);
    virtual_time::run(&mut hand, &mut servo, &mut simulation, schedule, count, |tick| ticks.push(*tick)).unwrap();
    Session { ticks, hand }
}

#[test]
fn at_50_hz_a_body_of_two_kilonewtons_a_metre_is_held_and_without_the_local_model_it_swings() {
    let press =
        |deep: f64, local_model: bool| press(deep, 10.0, 2.5, |s| (s.local_model, s.passivity) = (local_model, false));
    let [soft, hard] = [0.01, 0.014].map(|deep| press(deep, true));
    let [(less, _), (more, noise)] = [&soft, &hard].map(|session| session.force(1500));
    let [high, low] = [&soft, &hard].map(|session| session.ticks.last().unwrap().tool.position.y);
    let stiffness = (more - less) / (high - low);
    let (_, raw) = press(0.014, false).force(1500);
    println!("{stiffness:.0} N/m felt at {more:.2} N: swings {noise:.1e} N with the local model, {raw:.2} N without");
    assert!((1700.0..2300.0).contains(&stiffness), "{stiffness} N/m");
    // The steady force is to be quiet: 1 % or 0.01 N.
    assert!(noise < (0.01 * more).max(0.01), "{noise} of {more} N");
    assert!(raw > 0.2 * more, "{raw} of {more} N");
}

#[test]
fn a_press_hold_and_release_gives_the_hand_no_energy() {
    for local_model in [true, false] {
        let session = press(0.01, 1.5, 2.5, |s| s.local_model = local_model);
        let peak = session.ticks.iter().map(|tick| tick.played.force.length()).fold(0.0, f64::max);
        let most = (HandParameters::default().quantum * peak).max(1e-6);
        let (seen, received) = (session.ticks.last().unwrap().energy.net(), session.hand.energy().received());
        println!(
            "local model {local_model}: {received:.1e} J to the hand ({seen:.1e} seen), at most {most:.1e}; {peak:.2} N"
        );
        assert!(peak > 1.0 && received <= most && seen <= most, "{local_model}: {received} {seen} {peak}");
    }
}
