//! Tests of the whole loop against a wall of known stiffness, held by the simulated hand, in virtual time.

use glam::{DMat3, DQuat, DVec3};

use super::devices::hand::{Hand, HandParameters};
use super::drive::Drive;
use super::environment::Wall;
use super::profile::Profile;
use super::safety::{Limits, Lowered};
use super::servo::{Servo, Settings, Tick};
use super::tool::Tool;
use super::virtual_time::{self, Schedule};
use super::{Device, coupling};
use crate::scene::Key;

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

/// A servo and a wall for a device of this profile.
fn make(profile: &Profile, stiffness: f64, adjust: impl FnOnce(&mut Settings)) -> (Servo, Wall) {
    let (limits, _) = Limits::new(profile, &Lowered::default());
    let gains = coupling::choose(profile, PERIOD, 0.0, 0.05, 2e-6, None);
    let tool = Tool { coupling: Some(gains.coupling), ..tool() };
    let mut settings = Settings {
        period: PERIOD,
        limits,
        local_model: true,
        passivity: true,
        most_damping: profile.damping,
        trust: 2e-3,
        arm: 0.01,
    };
    adjust(&mut settings);
    let wall = Wall { stiffness, damping: 0.0, tool: tool.clone(), steps: 0 };
    (Servo::new(settings, tool), wall)
}

/// Presses by an intended way and holds; all ticks.
fn press(profile: &str, stiffness: f64, rate: f64, adjust: impl FnOnce(&mut Settings)) -> (Vec<Tick>, Hand) {
    let profile = Profile::named(profile).unwrap();
    let (mut servo, mut wall) = make(profile, stiffness, adjust);
    let keys = [key(0.0, 0.005), key(0.3, 0.005), key(0.6, -0.01)];
    let mut hand = Hand::new(HandParameters::default(), Drive::new(&keys, keys[0]), profile.clone()).unwrap();
    hand.open().unwrap();
    let mut ticks = Vec::new();
    let schedule = Schedule::at(rate, PERIOD);
    virtual_time::run(&mut hand, &mut servo, &mut wall, schedule, 3000, |tick| ticks.push(*tick)).unwrap();
    (ticks, hand)
}

/// Mean and standard deviation of the force played over the last second, N.
fn force_at_end(ticks: &[Tick]) -> (f64, f64) {
    let last: Vec<f64> = ticks[ticks.len() - 1000..].iter().map(|tick| tick.played.force.y).collect();
    let mean = last.iter().sum::<f64>() / last.len() as f64;
    (mean, (last.iter().map(|f| (f - mean).powi(2)).sum::<f64>() / last.len() as f64).sqrt())
}

#[test]
fn explore() {
    for profile in ["sigma.7", "premium"] {
        for rate in [50.0, 30.0] {
            for local_model in [true, false] {
                for passivity in [true, false] {
                    let (ticks, hand) = press(profile, 2000.0, rate, |s| {
                        s.local_model = local_model;
                        s.passivity = passivity;
                    });
                    let (mean, deviation) = force_at_end(&ticks);
                    println!(
                        "{profile} {rate} local {local_model} passivity {passivity}: {mean:.3} N +- {deviation:.4}, net {:.2e}, hand {:.2e}",
                        ticks.last().unwrap().energy.net(), hand.energy().received()
                    );
                }
            }
        }
    }
}
