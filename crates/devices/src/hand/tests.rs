//! Tests of the simulated hand (a haptic device with the person who holds it): its motion, friction, energy balance,
//! quantised readings and delay. A *tick* is one iteration of the haptic loop, in which the loop reads the hand and
//! writes a force; a *substep* is the time step of the hand's equations of motion. A force or torque is *played* when
//! the device exerts it.

use palpate::scene::Key;

use super::*;

const TICK: f64 = 1e-3;

/// Parameters without damping, friction and encoder resolution: a mass on a spring alone.
const IDEAL: HandParameters = HandParameters {
    mass: 0.1,
    stiffness: 400.0,
    damping: 0.0,
    device_damping: 0.0,
    friction: 0.0,
    inertia: 1e-3,
    angular_stiffness: 2.0,
    angular_damping: 0.0,
    quantum: Some(0.0),
    delay: 0.0,
    substep: 1e-4,
};

fn key(time: f64, position: DVec3, turn: DVec3) -> Key {
    Key { time, position, orientation: DQuat::from_scaled_axis(turn) }
}

fn hand(parameters: HandParameters, keys: &[Key]) -> Hand {
    let intended = Trajectory::new(keys, key(0.0, DVec3::ZERO, DVec3::ZERO));
    Hand::new(parameters, intended, Profile::named("scripted").unwrap().clone()).unwrap()
}

fn push(force: DVec3) -> Wrench {
    Wrench { force, torque: DVec3::ZERO }
}

fn assert_near(found: f64, expected: f64, tolerance: f64, what: &str) {
    assert!((found - expected).abs() <= tolerance, "{what}: {found} is not within {tolerance} of {expected}");
}

/// Greatest errors of position and of angle in 0.1 s, each relative to its initial value, of a hand that is released at
/// rest away from the intended pose. The exact motion is e^(-d t) (cos w t + d / w sin w t) times the initial value,
/// with d = damping / (2 mass) and w^2 = stiffness / mass - d^2.
fn error_of_swing(substep: f64) -> (f64, f64) {
    let parameters = HandParameters { damping: 2.0, device_damping: 1.0, angular_damping: 0.02, substep, ..IDEAL };
    let mut hand = hand(parameters, &[]);
    let axis = DVec3::new(2.0, -1.0, 2.0) / 3.0;
    hand.place(RigidState::at_rest(axis * 0.01, DQuat::from_scaled_axis(axis * 0.5)));
    let closed = |mass: f64, stiffness: f64, damping: f64, t: f64| {
        let d = damping / (2.0 * mass);
        let w = (stiffness / mass - d * d).sqrt();
        (-d * t).exp() * ((w * t).cos() + d / w * (w * t).sin())
    };
    let mut worst = (0.0f64, 0.0f64);
    for tick in 1..=100 {
        hand.read(f64::from(tick) * TICK).unwrap();
        let t = hand.time();
        let moved = hand.state().position / 0.01 - axis * closed(0.1, 400.0, 3.0, t);
        let turned = rotation_vector(hand.state().orientation) / 0.5 - axis * closed(1e-3, 2.0, 0.02, t);
        worst = (worst.0.max(moved.length()), worst.1.max(turned.length()));
    }
    worst
}

/// The implicit midpoint rule is of second order: half the substep gives a quarter of the error.
#[test]
fn a_free_swing_is_the_damped_oscillator() {
    let (coarse, fine) = (error_of_swing(1e-4), error_of_swing(5e-5));
    for (name, coarse, fine) in [("position", coarse.0, fine.0), ("rotation", coarse.1, fine.1)] {
        println!("{name}: relative error {coarse:.2e}; with half the substep, relative error {fine:.2e}");
        assert!(coarse < 1e-4, "{name}: relative error {coarse}");
        assert_near(coarse / fine, 4.0, 0.05, name);
    }
}

#[test]
fn a_constant_wrench_deflects_by_force_over_stiffness() {
    let mut hand = hand(HandParameters { friction: 0.0, quantum: Some(0.0), ..Default::default() }, &[]);
    let wrench = Wrench { force: DVec3::new(3.0, -1.0, 0.5), torque: DVec3::new(0.0, 0.0, 0.3) };
    hand.read(0.0).unwrap();
    hand.write(&wrench).unwrap();
    for tick in 1..=3000 {
        hand.read(f64::from(tick) * TICK).unwrap();
    }
    assert_near((hand.state().position - wrench.force / 300.0).length(), 0.0, 1e-12, "position");
    assert_near((rotation_vector(hand.state().orientation) - wrench.torque / 2.0).length(), 0.0, 1e-12, "angle");
}

/// A device that plays no torque does not turn the wrist, and a device that senses no rotation reports no rotation.
#[test]
fn torque_and_rotation_are_the_profiles() {
    let turning = [key(0.0, DVec3::ZERO, DVec3::ZERO), key(1.0, DVec3::ZERO, DVec3::Y)];
    for (name, plays, senses) in [("premium", true, true), ("touch", false, true), ("falcon", false, false)] {
        let profile = Profile::named(name).unwrap().clone();
        let mut hand = Hand::new(IDEAL, Trajectory::new(&turning, turning[0]), profile).unwrap();
        hand.write(&Wrench { force: DVec3::ZERO, torque: DVec3::X * 0.1 }).unwrap();
        let reading = hand.read(0.05).unwrap();
        assert_eq!(hand.state().angular_velocity.x != 0.0, plays, "{name}: whether the torque turns the hand");
        assert_eq!(hand.energy().torque != 0.0, plays, "{name}: whether the torque does work");
        assert_eq!(reading.state.orientation != DQuat::IDENTITY, senses, "{name}: whether orientation is sensed");
        assert_eq!(reading.state.angular_velocity != DVec3::ZERO, senses, "{name}: whether angular velocity is sensed");
    }
}

/// A force below the friction does not move the hand by a single bit, a greater force does, and a hand that slides
/// comes to an exact rest.
#[test]
fn coulomb_friction_sticks() {
    let parameters = HandParameters { friction: 0.2, ..IDEAL };
    let mut hand = hand(parameters, &[]);
    let direction = DVec3::new(0.6, 0.0, -0.8);
    hand.write(&push(direction * 0.199)).unwrap();
    for tick in 1..=1000 {
        hand.read(f64::from(tick) * TICK).unwrap();
        assert_eq!(*hand.state(), RigidState::at_rest(DVec3::ZERO, DQuat::IDENTITY));
    }
    hand.write(&push(direction * 1.0)).unwrap();
    hand.read(1.01).unwrap();
    assert!(hand.state().position.dot(direction) > 1e-4);
    hand.write(&Wrench::ZERO).unwrap();
    for tick in 1011..=2000 {
        hand.read(f64::from(tick) * TICK).unwrap();
    }
    let held = *hand.state();
    assert_eq!(held.velocity, DVec3::ZERO);
    assert!(held.position != DVec3::ZERO && held.position.length() * parameters.stiffness <= parameters.friction);
    hand.read(2.05).unwrap();
    assert_eq!(*hand.state(), held);
}

/// With friction f alone, a mass m of initial speed v comes to rest after m v^2 / (2 f) and never moves back. The
/// tolerance is wide because the friction impulse is of first order in the substep.
#[test]
fn coulomb_friction_stops_and_never_reverses() {
    let parameters = HandParameters { stiffness: 0.0, friction: 0.2, ..IDEAL };
    let mut hand = hand(parameters, &[]);
    let mut speed = 0.05;
    hand.place(RigidState { velocity: DVec3::Y * speed, ..*hand.state() });
    for tick in 1..=500 {
        hand.read(f64::from(tick) * 1e-4).unwrap();
        let now = hand.state().velocity.y;
        assert!((0.0..=speed).contains(&now), "speed {now} m/s");
        speed = now;
    }
    assert_eq!(speed, 0.0);
    let way = 0.1 * 0.05 * 0.05 / (2.0 * 0.2);
    assert_near(hand.state().position.y, way, 0.01 * way, "stopping distance, m");
    assert_near(hand.energy().lost, 0.5 * 0.1 * 0.05 * 0.05, 1e-18, "energy lost, J");
}

/// Only rounding may change the energy: by a few units in the last place in each of 100,000 substeps.
#[test]
fn without_damping_energy_stays() {
    let mut hand = hand(IDEAL, &[]);
    let orientation = DQuat::from_rotation_z(0.4);
    hand.place(RigidState { velocity: DVec3::X * 0.1, ..RigidState::at_rest(DVec3::Y * 0.02, orientation) });
    let start = hand.stored();
    let mut drift = 0.0f64;
    for tick in 1..=10_000 {
        hand.read(f64::from(tick) * TICK).unwrap();
        drift = drift.max((hand.stored() / start - 1.0).abs());
    }
    println!("relative drift {drift:.1e} of an energy of {start} J");
    assert!(drift < 1e-10, "relative drift of the energy {drift}");
}

/// Where the axis of rotation changes, the integration in time loses a little energy and never adds any.
#[test]
fn turning_about_many_axes_makes_no_energy() {
    let mut hand = hand(IDEAL, &[]);
    let tilted = RigidState::at_rest(DVec3::ZERO, DQuat::from_rotation_z(1.0));
    hand.place(RigidState { angular_velocity: DVec3::new(30.0, -20.0, 5.0), ..tilted });
    let start = hand.stored();
    let mut last = start;
    for tick in 1..=10_000 {
        hand.read(f64::from(tick) * TICK).unwrap();
        assert!(hand.stored() <= last * (1.0 + 1e-12), "energy rose to {} J from {last} J", hand.stored());
        last = hand.stored();
    }
    println!("after 10 s, the share {:.4} of the initial energy of {start} J is left", last / start);
}

#[test]
fn with_damping_energy_only_falls() {
    let mut hand = hand(HandParameters { quantum: Some(0.0), ..Default::default() }, &[]);
    hand.place(RigidState {
        velocity: DVec3::X * 0.3,
        ..RigidState::at_rest(DVec3::Y * 0.02, DQuat::from_rotation_x(0.3))
    });
    let start = hand.stored();
    let mut last = start;
    for tick in 1..=2000 {
        hand.read(f64::from(tick) * TICK).unwrap();
        assert!(hand.stored() <= last, "energy rose to {} J from {last} J", hand.stored());
        last = hand.stored();
    }
    // The energy left is at most that of a spring of stiffness k held by friction f: f^2 / (2 k).
    assert!(last <= 0.05 * 0.05 / 600.0, "energy left {last} J");
    assert_near(hand.energy().lost, start - last, 1e-12 * start, "energy lost, J");
}

/// The energy balance holds under forces, rotation about one axis, friction and a moving intended pose.
#[test]
fn energy_is_accounted_for() {
    let keys = [key(0.0, DVec3::ZERO, DVec3::ZERO), key(0.7, DVec3::new(0.05, 0.02, 0.0), DVec3::Z * 0.6)];
    let parameters = HandParameters { friction: 0.2, delay: 0.002, ..Default::default() };
    let mut hand = hand(parameters, &keys);
    let mut greatest = 0.0f64;
    for tick in 1..=3000 {
        let t = f64::from(tick) * TICK;
        let force = DVec3::new((40.0 * t).sin(), 2.0 * (17.0 * t).cos(), 0.3);
        hand.write(&Wrench { force, torque: DVec3::Z * 0.2 * (30.0 * t).sin() }).unwrap();
        hand.read(t).unwrap();
        let energy = hand.energy();
        greatest = greatest.max(energy.lost).max(energy.received().abs());
        let balance = energy.received() + energy.intent - energy.lost;
        assert_near(balance, hand.stored(), 1e-9 * greatest, "energy balance, J");
    }
    let HandEnergy { force, torque, intent, lost } = hand.energy();
    assert!(
        [force, torque, intent, lost].iter().all(|joules| joules.abs() > 1e-4),
        "an energy is at most 1e-4 J: {:?}",
        hand.energy()
    );
    hand.reset_energy();
    assert_eq!(hand.energy(), HandEnergy::default());
}

/// The work of a constant force is the force times the displacement.
#[test]
fn energy_received_is_the_integral_of_force_by_motion() {
    let mut hand = hand(HandParameters::default(), &[]);
    hand.read(0.5).unwrap();
    let wrench = Wrench { force: DVec3::new(1.0, 2.0, 0.0), torque: DVec3::X * 0.1 };
    hand.write(&wrench).unwrap();
    for tick in 1..=50 {
        hand.read(0.1 + f64::from(tick) * TICK).unwrap();
        let work = wrench.force.dot(hand.state().position);
        let turned = wrench.torque.dot(rotation_vector(hand.state().orientation));
        assert_near(hand.energy().force, work, 1e-15, "work of the force, J");
        assert_near(hand.energy().torque, turned, 1e-15, "work of the torque, J");
    }
    assert!(hand.energy().force > 1e-3 && hand.energy().torque > 1e-4);
}

#[test]
fn readings_are_quantised() {
    let keys = [key(0.0, DVec3::ZERO, DVec3::ZERO), key(1.0, DVec3::new(0.1, -0.03, 0.001), DVec3::ZERO)];
    let quantum = 1e-3;
    let mut hand = hand(HandParameters { quantum: Some(quantum), ..Default::default() }, &keys);
    for tick in 1..=1500 {
        let reading = hand.read(f64::from(tick) * TICK).unwrap();
        let steps = reading.state.position / quantum;
        assert!((steps - steps.round()).abs().max_element() < 1e-9, "position in units of the resolution: {steps}");
        let error = (reading.state.position - hand.state().position).abs().max_element();
        assert!(error <= 0.5 * quantum * (1.0 + 1e-9), "quantisation error {error} m");
    }
    let at_rest = hand.read(1.6).unwrap();
    assert_eq!(at_rest.state.velocity, DVec3::ZERO);
}

/// A wrench written at 4 ms with 3 ms of delay first acts in the substep that ends at 7.1 ms.
#[test]
fn a_delayed_force_acts_from_its_time_plus_the_delay() {
    for delay in [0.0, 0.0003, 0.003, 0.02] {
        let mut hand = hand(HandParameters { delay, ..IDEAL }, &[]);
        hand.read(0.004).unwrap();
        hand.write(&push(DVec3::ONE * 9.0)).unwrap();
        hand.write(&push(DVec3::X)).unwrap();
        assert_eq!(hand.coming.len(), 1);
        assert_eq!(hand.read(0.004 + delay).unwrap().state.position, DVec3::ZERO, "the hand moved too early");
        let after = hand.read(0.0041 + delay).unwrap();
        let accelerated = 0.5 * 1e-8 / 0.1;
        assert_near(after.state.position.x, accelerated, 1e-4 * accelerated, "displacement, m");
        assert_eq!(after.state.position.y, 0.0, "a wrench that a later one replaced was played");
    }
}

/// One wrench a tick, each delayed by 5 ticks, acts like the same sequence begun 5 ticks later without delay.
#[test]
fn delayed_forces_keep_their_order() {
    let run = |delay: f64, first: i32| {
        let mut hand = hand(HandParameters { delay, ..Default::default() }, &[]);
        let mut path = Vec::new();
        for tick in 0..200 {
            let reading = hand.read(f64::from(tick) * TICK).unwrap();
            path.push(reading.state.position);
            let step = tick - first;
            hand.write(&push(DVec3::X * if step >= 0 { f64::from(step * 37 % 11) - 5.0 } else { 0.0 })).unwrap();
        }
        path
    };
    assert_eq!(run(0.005, 0), run(0.0, 5));
    assert_ne!(run(0.005, 0), run(0.0, 4));
}

#[test]
fn two_runs_are_the_same_bits() {
    let keys = [key(0.0, DVec3::ZERO, DVec3::ZERO), key(0.3, DVec3::new(0.02, 0.01, 0.0), DVec3::new(0.1, 0.2, 0.0))];
    let run = |delay: f64| {
        let mut hand = hand(HandParameters { delay, ..Default::default() }, &keys);
        let mut bits = Vec::new();
        for tick in 1..=1000 {
            let state = hand.read(f64::from(tick) * TICK).unwrap().state;
            let force = -500.0 * (state.position - DVec3::X * 0.01) - 2.0 * state.velocity;
            hand.write(&Wrench { force, torque: rotation_vector(state.orientation) * -0.5 }).unwrap();
            bits.extend(state.position.to_array().map(f64::to_bits));
            bits.extend(state.velocity.to_array().map(f64::to_bits));
            bits.extend(state.orientation.to_array().map(f64::to_bits));
        }
        bits.push(hand.energy().received().to_bits());
        bits
    };
    assert_eq!(run(0.001), run(0.001));
    assert_ne!(run(0.001), run(0.002));
}

#[test]
fn a_clock_that_jumps_is_followed_at_a_bounded_pace() {
    let mut hand = hand(HandParameters::default(), &[]);
    assert_near(hand.read(1e9).unwrap().time, 0.1, 1e-12, "time after a jump to 1e9 s");
    assert_near(hand.read(0.05).unwrap().time, 0.1, 1e-12, "time after a jump back");
    assert_near(hand.read(f64::NAN).unwrap().time, 0.1, 1e-12, "time after a NaN");
    assert_near(hand.read(f64::INFINITY).unwrap().time, 0.2, 1e-12, "time after infinity");
    assert_near(hand.read(0.25005).unwrap().time, 0.25, 1e-12, "time between substeps");
}

#[test]
fn what_is_not_finite_is_not_played() {
    let mut hand = hand(IDEAL, &[]);
    hand.write(&push(DVec3::X)).unwrap();
    assert!(matches!(hand.write(&push(DVec3::NAN)), Err(Fault::Garbled(_))));
    assert_eq!(hand.read(0.05).unwrap().state.position, DVec3::ZERO);
}

#[test]
fn closing_lets_go() {
    for delay in [0.0, 0.01] {
        let mut hand = hand(HandParameters { delay, ..IDEAL }, &[]);
        hand.open().unwrap();
        hand.write(&push(DVec3::X)).unwrap();
        hand.close();
        assert_eq!(hand.read(0.05).unwrap().state.position, DVec3::ZERO);
    }
}

#[test]
fn parameters_out_of_range_are_named() {
    assert_eq!(HandParameters::default().check(), Ok(()));
    let profile = Profile::named("scripted").unwrap();
    let refused = |parameters: HandParameters, name: &str| {
        let line = parameters.check().unwrap_err();
        assert!(
            line.contains(name) && line.contains("give") && !line.contains('\n'),
            "the error must be one line that names `{name}` and the values to give: {line}"
        );
        assert!(
            Hand::new(parameters, Trajectory::new(&[], key(0.0, DVec3::ZERO, DVec3::ZERO)), profile.clone()).is_err()
        );
    };
    for bad in [-1.0, f64::NAN, f64::INFINITY] {
        let good = HandParameters::default();
        refused(HandParameters { mass: bad, ..good }, "mass");
        refused(HandParameters { stiffness: bad, ..good }, " stiffness");
        refused(HandParameters { damping: bad, ..good }, " damping");
        refused(HandParameters { device_damping: bad, ..good }, "device_damping");
        refused(HandParameters { friction: bad, ..good }, "friction");
        refused(HandParameters { inertia: bad, ..good }, "inertia");
        refused(HandParameters { angular_stiffness: bad, ..good }, "angular_stiffness");
        refused(HandParameters { angular_damping: bad, ..good }, "angular_damping");
        refused(HandParameters { quantum: Some(bad), ..good }, "quantum");
        refused(HandParameters { delay: bad, ..good }, "delay");
        refused(HandParameters { substep: bad, ..good }, "substep");
    }
    refused(HandParameters { delay: 0.00015, ..HandParameters::default() }, "whole number");
}
