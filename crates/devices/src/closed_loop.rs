//! Tests of the whole haptic loop in virtual time (no clock is waited for): the simulated hand presses the tool, the
//! rigid body that the haptic device leads by a virtual coupling, against a wall of known stiffness. The loop runs with
//! and without the local model, which extrapolates the contact force between simulation steps; without it the loop
//! plays the *raw force*, that of the last step. The loop also runs with and without the passivity controller, which
//! keeps it from giving energy to the hand. A tick is one iteration of the loop; a force is played when it is commanded
//! to the device.

use glam::{DMat3, DQuat, DVec3};
use palpate::internal::haptics::environment::Wall;
use palpate::internal::haptics::safety::Limits;
use palpate::internal::haptics::servo::{Servo, Settings, Tick};
use palpate::internal::haptics::virtual_time::{self, Schedule};
use palpate::internal::haptics::{Device, coupling};
use palpate::internal::step::tool::Tool;
use palpate::internal::step::trajectory::Trajectory;
use palpate::scene::profile::Profile;
use palpate::scene::{Haptics, Key, Lowered};

use super::hand::{Hand, HandParameters};

const PERIOD: f64 = 1e-3;

fn tool() -> Tool {
    Tool {
        mass: 0.05,
        inertia: DMat3::IDENTITY * 2e-6,
        coupling: None,
        centre: DVec3::Y * 0.005,
        orientation: DQuat::IDENTITY,
        velocity: DVec3::ZERO,
        angular_velocity: DVec3::ZERO,
    }
}

fn key(time: f64, y: f64) -> Key {
    Key { time, position: DVec3::Y * y, orientation: DQuat::IDENTITY }
}

/// The servo (the haptic loop's controller, called once a tick) for a device of this profile, and a wall of this
/// stiffness, N/m.
fn make(profile: &Profile, stiffness: f64, adjust: impl FnOnce(&mut Settings)) -> (Servo, Wall) {
    let (limits, _) = Limits::new(profile, &Lowered::default());
    let gains = coupling::choose(profile, PERIOD, 0.0, 0.05, 2e-6, None);
    let tool = Tool { coupling: Some(gains.coupling), ..tool() };
    let mut settings = Settings {
        period: PERIOD,
        limits,
        local_model: true,
        passivity: true,
        most_damping: gains.most_damping,
        trust: Haptics::default().trust,
        arm: 0.01,
        resolution: profile.step(),
    };
    adjust(&mut settings);
    let wall = Wall { stiffness, damping: 0.0, tells_gap: true, tool: tool.clone(), steps: 0 };
    (Servo::new(settings, tool), wall)
}

/// Runs the loop for three seconds with a hand that intends to go 10 mm into the wall and to stay there; returns all
/// ticks and the hand. `rate` is the number of simulation steps a second, Hz.
fn press(profile: &str, stiffness: f64, rate: f64, adjust: impl FnOnce(&mut Settings)) -> (Vec<Tick>, Hand) {
    follow(&[key(0.0, 0.005), key(0.3, 0.005), key(0.6, -0.01)], profile, stiffness, rate, adjust)
}

/// Runs the loop for three seconds with a hand that intends to follow the keys (poses at given times); returns all
/// ticks and the hand.
fn follow(
    keys: &[Key],
    profile: &str,
    stiffness: f64,
    rate: f64,
    adjust: impl FnOnce(&mut Settings),
) -> (Vec<Tick>, Hand) {
    let profile = Profile::named(profile).unwrap();
    let (mut servo, mut wall) = make(profile, stiffness, adjust);
    let mut hand = Hand::new(HandParameters::default(), Trajectory::new(keys, keys[0]), profile.clone()).unwrap();
    hand.open().unwrap();
    let mut ticks = Vec::new();
    let schedule = Schedule::at(rate, PERIOD);
    virtual_time::run(&mut hand, &mut servo, &mut wall, schedule, 3000, |tick| ticks.push(*tick)).unwrap();
    (ticks, hand)
}

/// Runs the loop with a hand that intends to go 10 mm into the wall, to stay there for a second and to leave again.
fn cycle(profile: &str, stiffness: f64, rate: f64, adjust: impl FnOnce(&mut Settings)) -> (Vec<Tick>, Hand) {
    let keys = [key(0.0, 0.005), key(0.3, 0.005), key(0.6, -0.01), key(1.6, -0.01), key(2.0, 0.01)];
    follow(&keys, profile, stiffness, rate, adjust)
}

/// Mean and standard deviation of the force played over the last second, N, along the wall's normal.
fn force_at_end(ticks: &[Tick]) -> (f64, f64) {
    let last: Vec<f64> = ticks[ticks.len() - 1000..].iter().map(|tick| tick.played.force.y).collect();
    let mean = last.iter().sum::<f64>() / last.len() as f64;
    (mean, (last.iter().map(|f| (f - mean).powi(2)).sum::<f64>() / last.len() as f64).sqrt())
}

#[test]
fn the_local_model_holds_contact_where_the_raw_force_swings() {
    for profile in ["premium", "touch", "inverse3", "sigma.7"] {
        for (rate, stiffness) in [(50.0, 1000.0), (50.0, 2000.0), (30.0, 1000.0), (30.0, 5000.0)] {
            let with = |local_model: bool| {
                force_at_end(
                    &press(profile, stiffness, rate, |s| (s.local_model, s.passivity) = (local_model, false)).0,
                )
            };
            let ((mean, deviation), (_, raw)) = (with(true), with(false));
            println!(
                "{profile}, wall of {stiffness} N/m at {rate} Hz: force {mean:.3} N, standard deviation \
                 {deviation:.4} N; standard deviation of the raw force {raw:.2} N"
            );
            assert!(
                mean > 1.0 && deviation < 0.001 * mean,
                "{profile}, {rate} Hz, {stiffness} N/m: force {mean} N, standard deviation {deviation} N"
            );
            assert!(
                raw > 0.5,
                "{profile}, {rate} Hz, {stiffness} N/m: the raw force has a standard deviation of only {raw} N"
            );
        }
    }
}

#[test]
fn a_prompt_force_is_the_same_with_and_without_the_local_model() {
    for profile in ["premium", "touch", "inverse3", "sigma.7"] {
        let with =
            |local_model: bool| force_at_end(&press(profile, 300.0, 1000.0, |s| s.local_model = local_model).0).0;
        let (local, raw) = (with(true), with(false));
        // Arm, virtual coupling and wall are springs in series, stretched by 10 mm in all; friction may hold the hand
        // at a force that differs by up to 0.05 N.
        let coupling = coupling::choose(Profile::named(profile).unwrap(), PERIOD, 0.0, 0.05, 2e-6, None).coupling;
        let exact = 0.01 / (1.0 / 300.0 + 1.0 / 300.0 + 1.0 / coupling.stiffness);
        assert!(
            (local - exact).abs() < 0.05 && (raw - exact).abs() < 0.05,
            "{profile}: force with the local model {local} N, without {raw} N, expected {exact} N"
        );
    }
}

#[test]
fn a_press_and_release_gives_the_hand_no_energy() {
    for profile in ["premium", "touch", "inverse3", "minverse", "sigma.7"] {
        for (rate, stiffness) in [(1000.0, 2000.0), (200.0, 2000.0), (50.0, 2000.0), (30.0, 5000.0)] {
            for local_model in [true, false] {
                let (ticks, hand) = cycle(profile, stiffness, rate, |s| s.local_model = local_model);
                let peak = ticks.iter().map(|tick| tick.played.force.length()).fold(0.0, f64::max);
                let changes = ticks.windows(2).map(|pair| (pair[1].played.force - pair[0].played.force).length());
                let variation: f64 = changes.sum();
                let most = (Profile::named(profile).unwrap().step() * (peak + 0.5 * variation)).max(1e-6);
                let energy = ticks.last().unwrap().energy;
                let (seen, received) = (energy.net(), hand.energy().received());
                println!(
                    "{profile}, {stiffness} N/m at {rate} Hz, local model {local_model}: the hand received \
                     {received:.1e} J, at most {most:.1e} J allowed"
                );
                assert!(
                    peak > 0.3,
                    "{profile}, {stiffness} N/m, {rate} Hz, local model {local_model}: peak force only {peak} N"
                );
                assert!(
                    received <= most && seen <= most && energy.lent == 0.0,
                    "{profile}, {stiffness} N/m, {rate} Hz, local model {local_model}: the hand received {received} J, \
                     the passivity observer saw {seen} J; energies of the loop: {energy:?}"
                );
            }
        }
    }
    let (_, hand) = cycle("premium", 2000.0, 50.0, |s| (s.local_model, s.passivity) = (false, false));
    assert!(
        hand.energy().received() > 0.1,
        "without the controller the raw force must give the hand energy: {:?}",
        hand.energy()
    );
}

/// A hand presses, holds and releases all day. Clocks, counters and energies grow all the time; what is felt may not
/// change with them.
#[test]
#[ignore = "long: minutes"]
fn lasting_a_day_feels_the_same_at_its_end_as_at_its_beginning() {
    const CYCLE: f64 = 10.0;
    const CYCLES: usize = 24 * 360;
    let of_cycle = |k: usize| {
        [(0.0, 0.005), (2.0, 0.005), (4.0, -0.01), (7.0, -0.01), (9.0, 0.005)]
            .map(|(time, y)| key(k as f64 * CYCLE + time, y))
    };
    let keys: Vec<Key> = (0..CYCLES).flat_map(of_cycle).collect();
    let profile = Profile::named("premium").unwrap();
    let (mut servo, mut wall) = make(profile, 1000.0, |_| ());
    let mut hand = Hand::new(HandParameters::default(), Trajectory::new(&keys, keys[0]), profile.clone()).unwrap();
    hand.open().unwrap();
    // The greatest force, the force in the middle of the hold, and the energy given to the hand so far, of each cycle.
    let mut felt = vec![[0.0f64; 3]; CYCLES];
    let ticks = (CYCLES as f64 * CYCLE / PERIOD) as u64;
    let mut seen = 0;
    virtual_time::run(&mut hand, &mut servo, &mut wall, Schedule::at(100.0, PERIOD), ticks, |tick| {
        assert!(tick.played.force.is_finite() && tick.index == seen, "tick {seen}: {tick:?}");
        assert!(tick.step == 0 || tick.staleness <= 0.0205, "tick {seen} has a wrench {} s old", tick.staleness);
        seen += 1;
        let within = tick.time % CYCLE;
        let cycle = &mut felt[((tick.time / CYCLE) as usize).min(CYCLES - 1)];
        let force = tick.played.force.length();
        cycle[0] = cycle[0].max(force);
        if (5.4995..5.5005).contains(&within) {
            cycle[1] = force;
        }
        cycle[2] = tick.energy.net();
    })
    .unwrap();
    assert_eq!(seen, ticks);
    let hold = felt[1][1];
    assert!(hold > 1.0, "the hand feels {hold} N in the hold");
    for (k, cycle) in felt.iter().enumerate().skip(2) {
        assert!((cycle[1] - hold).abs() < 1e-6 * hold, "cycle {k}: hold {} N, in the second {hold} N", cycle[1]);
    }
    // The overshoot before the hold differs by some percent from cycle to cycle.
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let peaks: Vec<f64> = felt[1..].iter().map(|cycle| cycle[0]).collect();
    let most = peaks.iter().copied().fold(0.0, f64::max);
    let [early, late] = [mean(&peaks[..CYCLES / 10]), mean(&peaks[peaks.len() - CYCLES / 10..])];
    assert!(
        most < 1.1 * early && (late / early - 1.0).abs() < 0.02,
        "peaks: {early} N, later {late} N, at most {most}"
    );
    // The bound that docs/understanding/passivity-and-safety.md gives for a press.
    let gain = felt.windows(2).map(|pair| pair[1][2] - pair[0][2]).fold(0.0, f64::max);
    assert!(gain <= 6e-4, "the hand gains up to {gain} J in a cycle");
}
