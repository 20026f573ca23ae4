//! Parts `damping`, `delay` and `rate` of `palpate bench haptics`: the stiffest wall that the haptic loop renders
//! without oscillating (the Z-width), for different dampings of the wall, delays of the force and rates of the
//! simulation. A wrench is the contact wrench that a simulation step finds. The raw force is the force of the newest
//! wrench, played unchanged until the next wrench arrives; the local model is the force law by which a session (the
//! haptic loop with a device and a simulation) computes forces between wrenches instead. A tick is one iteration of the
//! loop. The virtual coupling is a spring and damper by which the haptic device leads the tool, a rigid body.

use glam::DVec3;
use palpate::Result;
use palpate::internal::haptics::coupling;
use palpate::internal::haptics::local_model::in_series;
use palpate::internal::haptics::servo::Tick;
use palpate::internal::haptics::virtual_time::Schedule;
use palpate::scene::{Key, Profile};
use palpate_devices::hand::HandParameters;
use serde::{Deserialize, Serialize};

use super::Settings;
use super::rig::{Mode, PERIOD, Rig, Spread, key, tool, wall};

/// Stiffness of the softest and of the stiffest wall tried, N/m.
pub const RANGE: [f64; 2] = [10.0, 1e5];
/// Number of walls tried for each power of ten of stiffness, up to the first wall that oscillates; bisection then finds
/// the stiffest wall that does not.
const TRIED: f64 = 4.0;
/// A critical hand: it dissipates little, and it has neither friction nor encoders, as the linear bounds of stability
/// (Colgate's and Gil's) assume.
pub const CRITICAL: HandParameters = HandParameters {
    mass: 0.15,
    stiffness: 300.0,
    damping: 2.0,
    device_damping: 0.5,
    friction: 0.0,
    inertia: 1e-3,
    angular_stiffness: 2.0,
    angular_damping: 0.04,
    quantum: Some(0.0),
    delay: 0.0,
    substep: 1e-4,
};
/// A force is still if its range from least to greatest is at most this share of its mean, or at most [`STILL`].
pub const STILL_SHARE: f64 = 0.01;
/// A force whose range is at most this is still in any case, N.
pub const STILL: f64 = 0.01;
/// An oscillation counts as growing if, in the last second of a press, its range in the second half is more than this
/// many times its range in the first half.
const GROWTH: f64 = 1.2;
/// A force counts as present if it is at least this share of the force of the springs (arm, coupling, wall) in
/// equilibrium. Without this condition a force that vanished would count as still.
const THERE: f64 = 0.97;
/// Depth within the wall to which the hand means to press, m.
const WITHIN: f64 = 0.01;
/// Oscillations with a smaller range than this count as rounding errors, N.
const NOTHING: f64 = 1e-6;

const DELAY: &str = "delay";
const RATE: &str = "rate";

/// Stiffness of the stiffest wall with a still force, N/m: 0 if no wall that was tried has a still force, the upper end
/// of [`RANGE`] if all have.
pub type Stiffest = f64;

/// Stiffest walls of one haptic device for one damping of the wall.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Width {
    /// Name of the haptic device's profile.
    pub profile: String,
    /// Stiffness of the virtual coupling, N/m.
    pub coupling: f64,
    /// Damping of the wall, N s/m.
    pub damping: f64,
    /// Stiffest wall with the local model and passivity control (which bounds the energy given to the hand).
    pub session: Stiffest,
    /// Stiffest wall with the local model, without passivity control.
    pub local: Stiffest,
    /// Stiffest wall with the raw force.
    pub raw: Stiffest,
    /// Stiffest passive wall without a coupling, by Colgate and Schenkel's condition, N/m.
    pub colgate: f64,
}

/// Stiffest walls of one haptic device for one delay of the force and one rate of the simulation.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Limit {
    /// Name of the haptic device's profile.
    pub profile: String,
    /// Stiffness of the virtual coupling, N/m.
    pub coupling: f64,
    /// Delay of the haptic device between the command of a force and its playing, s.
    pub delay: f64,
    /// Rate of the simulation, Hz.
    pub rate: f64,
    /// Stiffest wall with the local model.
    pub local: Stiffest,
    /// Stiffest wall with the raw force.
    pub raw: Stiffest,
    /// Stiffest passive wall that is sampled at the simulation's rate without further delay, by Colgate and Schenkel's
    /// condition, N/m.
    pub colgate: f64,
    /// Stiffest stable wall by Gil and others' bound, N/m. The bound takes the delay of the device and, in the part
    /// `rate`, adds one interval between simulation steps to this delay.
    pub gil: f64,
}

/// Damping of the critical hand and its haptic device together, N s/m.
pub fn dissipation() -> f64 {
    CRITICAL.damping + CRITICAL.device_damping
}

/// Measures the stiffest walls for different dampings of the wall, with simulations at 1 kHz.
pub fn by_damping(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Vec<Width>> {
    let mut widths = Vec::new();
    for profile in settings.profiles()? {
        watch(&format!("walls: {} by damping", profile.name));
        for &damping in &settings.dampings {
            let of = |mode: Mode| {
                let rig = Rig { mode, ..rig_of(profile) };
                stiffest(settings, |stiffness| press(&rig, stiffness, damping, 1.0 / PERIOD))
            };
            let stiffness = rig_of(profile).coupling().stiffness;
            let colgate = coupling::stiffest(dissipation(), damping, PERIOD, 0.0);
            let (session, local, raw) = (of(Mode::Session)?, of(Mode::Local)?, of(Mode::Raw)?);
            widths.push(Width {
                profile: profile.name.into(),
                coupling: stiffness,
                damping,
                session,
                local,
                raw,
                colgate,
            });
        }
    }
    Ok(widths)
}

/// Measures the stiffest walls for different delays of the force, with simulations at 1 kHz.
pub fn by_delay(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Vec<Limit>> {
    let cases: Vec<(f64, f64)> = settings.delays.iter().map(|&delay| (delay, 1.0 / PERIOD)).collect();
    limits(settings, DELAY, &cases, watch)
}

/// Measures the stiffest walls for different rates of the simulation, whose wrench arrives one interval after its step
/// began.
pub fn by_rate(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Vec<Limit>> {
    let cases: Vec<(f64, f64)> = settings.rates.iter().map(|&rate| (0.0, rate)).collect();
    limits(settings, RATE, &cases, watch)
}

fn limits(settings: &Settings, what: &str, cases: &[(f64, f64)], watch: &mut dyn FnMut(&str)) -> Result<Vec<Limit>> {
    let mut limits = Vec::new();
    for profile in settings.profiles()? {
        watch(&format!("walls: {} by {what}", profile.name));
        for &(delay, rate) in cases {
            let of = |mode: Mode| {
                let rig = Rig { hand: HandParameters { delay, ..CRITICAL }, mode, ..rig_of(profile) };
                stiffest(settings, |stiffness| press(&rig, stiffness, 0.0, rate))
            };
            let interval = interval(rate);
            // In the part `rate`, Gil's bound counts the interval from a step to its wrench as a delay, too.
            let late = delay + if what == RATE { interval } else { 0.0 };
            limits.push(Limit {
                profile: profile.name.into(),
                coupling: rig_of(profile).coupling().stiffness,
                delay,
                rate,
                local: of(Mode::Local)?,
                raw: of(Mode::Raw)?,
                colgate: coupling::stiffest(dissipation(), 0.0, interval, 0.0),
                gil: dissipation() / (0.5 * interval + late),
            });
        }
    }
    Ok(limits)
}

/// Time from one simulation step to the next at about `rate` steps a second, s; it is a whole number of ticks.
fn interval(rate: f64) -> f64 {
    f64::from(Schedule::at(rate, PERIOD).ticks_a_step) * PERIOD
}

fn rig_of(profile: &'static Profile) -> Rig {
    Rig { profile, hand: CRITICAL, mode: Mode::Local }
}

/// Presses [`WITHIN`] into a wall of this stiffness and damping, and returns whether there is a force at the end that
/// is still.
fn press(rig: &Rig, stiffness: f64, damping: f64, rate: f64) -> Result<bool> {
    let (start, within) = (DVec3::Y * 0.005, DVec3::Y * -WITHIN);
    let keys: [Key; 4] = [key(0.0, start), key(0.3, start), key(0.6, within), key(4.0, within)];
    let ticks = rig.follow(&keys, &tool(start), &mut wall(stiffness, damping, start), Schedule::at(rate, PERIOD))?;
    let balance = WITHIN / (1.0 / CRITICAL.stiffness + 1.0 / in_series(stiffness, 1.0 / rig.coupling().stiffness));
    Ok(keeps_still(&ticks, balance))
}

/// Whether there was a played force in the last second and this force was still. `balance` is the force of the springs
/// (arm, coupling, wall) in equilibrium, N.
fn keeps_still(ticks: &[Tick], balance: f64) -> bool {
    let second = (1.0 / PERIOD) as usize;
    let last: Vec<f64> = ticks[ticks.len().saturating_sub(second)..].iter().map(|tick| tick.played.force.y).collect();
    let (first, second) = last.split_at(last.len() / 2);
    let [whole, first, second] = [&last[..], first, second].map(|part| Spread::of(part.iter().copied()));
    let grows = second.swing > GROWTH * first.swing && second.swing > NOTHING;
    whole.swing <= (STILL_SHARE * whole.mean.abs()).max(STILL) && !grows && whole.mean >= THERE * balance
}

/// The stiffest wall whose force is still: tries walls from the softest up to the first whose force is not still, then
/// bisects between the last two walls tried.
fn stiffest(settings: &Settings, mut is_still: impl FnMut(f64) -> Result<bool>) -> Result<Stiffest> {
    let steps = (TRIED * (RANGE[1] / RANGE[0]).log10()).round() as i32;
    let (mut still, mut swings) = (0.0, None);
    for k in 0..=steps {
        let stiffness = RANGE[0] * 10f64.powf(f64::from(k) / TRIED);
        if !is_still(stiffness)? {
            swings = Some(stiffness);
            break;
        }
        still = stiffness;
    }
    let Some(mut swings) = swings.filter(|_| still > 0.0) else { return Ok(still) };
    while swings > still * (1.0 + settings.bisected) {
        let middle = (still * swings).sqrt();
        if is_still(middle)? { still = middle } else { swings = middle }
    }
    Ok(still)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stiffest_wall_is_found_between_none_and_all() {
        let settings = Settings { bisected: 0.01, ..Settings::quick() };
        let mut tried = 0;
        let found = stiffest(&settings, |k| {
            tried += 1;
            Ok(k <= 777.0)
        });
        let found = found.unwrap();
        assert!(
            found <= 777.0 && found > 777.0 / 1.01 && tried < 20,
            "stiffest wall found: {found} N/m, expected just below 777 N/m, after {tried} presses"
        );
        assert_eq!(stiffest(&settings, |_| Ok(false)).unwrap(), 0.0);
        assert!((stiffest(&settings, |_| Ok(true)).unwrap() / RANGE[1] - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_force_keeps_still_that_neither_swings_nor_grows() {
        let profile = Profile::named("touch").unwrap();
        let start = DVec3::Y;
        let keys = [key(0.0, start), key(1.0, start)];
        let far = || wall(1.0, 0.0, start);
        let mut ticks = rig_of(profile).follow(&keys, &tool(start), &mut far(), Schedule::at(1e3, PERIOD)).unwrap();
        let mut judge = |balance: f64, force: &dyn Fn(f64) -> f64| {
            for (k, tick) in ticks.iter_mut().enumerate() {
                tick.played.force.y = force(k as f64 * PERIOD);
            }
            keeps_still(&ticks, balance)
        };
        let wave = |t: f64| (40.0 * t).sin();
        assert!(
            judge(3.0, &|_| 3.0) && judge(3.0, &|t| 3.0 + 0.01 * wave(t)) && judge(0.1, &|t| 0.1 + 0.004 * wave(t))
        );
        assert!(!judge(3.0, &|t| 3.0 + 0.03 * wave(t)) && !judge(0.1, &|t| 0.1 + 0.006 * wave(t)));
        assert!(!judge(3.0, &|t| 3.0 + 0.003 * t * wave(t)) && !judge(3.0, &|_| f64::NAN) && !judge(3.0, &|_| 0.0));
    }
}
