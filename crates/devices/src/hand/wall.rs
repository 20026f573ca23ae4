//! Tests of the simplest closed loop: the simulated hand (a person's hand that holds a haptic device) presses on a
//! virtual wall, a spring that turns each reading of the position into a force at 1 kHz, without the engine's haptic
//! loop. The stiffness of the wall above which the loop is unstable is compared with theory.

use palpate::scene::Key;

use super::*;

const TICK: f64 = 1e-3;
/// Viscous damping of the devices tried, N s/m.
const DAMPINGS: [f64; 5] = [0.1, 0.3, 0.8, 2.0, 5.0];
/// Damping of the person's arm, N s/m: an arm that dissipates nothing, which is the worst case, and the default.
const PERSONS: [f64; 2] = [0.0, 5.0];
/// Depth within the wall at which the person intends to be, m.
const WITHIN: f64 = 0.01;

/// Relative precision to which a stability limit is bisected.
const BISECTED: f64 = 1e-3;

/// Greatest speed of the hand in each second, m/s. The wall fills x > 0 and pushes with F = -K x, where K is
/// `stiffness`, N/m. The hand is released at rest at x = `start`, m, and intends to be at x = `WITHIN` from the
/// beginning.
fn peaks(parameters: HandParameters, stiffness: f64, start: f64, seconds: usize) -> Vec<f64> {
    let intended = Key { time: 0.0, position: DVec3::X * WITHIN, orientation: DQuat::IDENTITY };
    let profile = Profile::named("scripted").unwrap().clone();
    let mut hand = Hand::new(parameters, Trajectory::new(&[], intended), profile).unwrap();
    hand.place(RigidState::at_rest(DVec3::X * start, DQuat::IDENTITY));
    let wall = |x: f64| Wrench { force: DVec3::X * (-stiffness * x).min(0.0), torque: DVec3::ZERO };
    // The force that acts first is that of a hand held at `start`, and so is the force that is written first, which
    // acts after the device's delay.
    hand.write(&wall(start)).unwrap();
    hand.played = wall(start);
    let mut peaks = vec![0.0f64; seconds];
    for tick in 0..seconds * 1000 {
        let reading = hand.read(tick as f64 * TICK).unwrap();
        hand.write(&wall(reading.state.position.x)).unwrap();
        peaks[tick / 1000] = peaks[tick / 1000].max(hand.state().velocity.length());
    }
    peaks
}

/// Parameters without friction and without encoder resolution, both of which the linear theory leaves out.
fn linear(damping: f64, device_damping: f64, delay: f64) -> HandParameters {
    HandParameters { damping, device_damping, delay, friction: 0.0, quantum: Some(0.0), ..Default::default() }
}

/// Whether a disturbance grows. The hand starts a thousandth of the equilibrium depth away from equilibrium. The
/// disturbance grows if the peak speed from 6 s to 7 s is greater than the one from 1 s to 2 s, or than twice the peak
/// speed of the undamped oscillation (which happens if the hand bounces off the wall).
fn grows(parameters: HandParameters, stiffness: f64) -> bool {
    let both = parameters.stiffness + stiffness;
    let balance = parameters.stiffness * WITHIN / both;
    let peaks = peaks(parameters, stiffness, balance * 1.001, 7);
    peaks[6] > peaks[1] || peaks[6] > 2.0 * 0.001 * balance * (both / parameters.mass).sqrt()
}

/// The least stiffness at which a disturbance grows, N/m.
fn found_limit(parameters: HandParameters) -> f64 {
    let (mut stable, mut unstable) = (1.0f64, 1e6);
    while unstable > stable * (1.0 + BISECTED) {
        let middle = (stable * unstable).sqrt();
        if grows(parameters, middle) { unstable = middle } else { stable = middle }
    }
    stable
}

/// The stiffness limit by linear theory, N/m: mass, damping and arm are discretised exactly under a force that is
/// constant over a tick; the loop becomes unstable where the constant coefficient of the characteristic polynomial
/// reaches one.
fn exact_limit(p: &HandParameters) -> f64 {
    let decay = (p.damping + p.device_damping) / (2.0 * p.mass);
    let w = (p.stiffness / p.mass - decay * decay).sqrt();
    let (sine, cosine) = (w * TICK).sin_cos();
    let kept = (-decay * TICK).exp();
    let a = [
        [kept * (cosine + decay / w * sine), kept * sine / w],
        [-kept * p.stiffness / p.mass / w * sine, kept * (cosine - decay / w * sine)],
    ];
    let b = [(1.0 - a[0][0]) / p.stiffness, -a[1][0] / p.stiffness];
    (1.0 - kept * kept) / (b[1] * a[0][1] - b[0] * a[1][1])
}

/// J. E. Colgate and G. G. Schenkel 1997, "Passivity of a class of sampled-data systems": the loop is passive for b > K
/// T / 2, with the device's damping b, the wall's stiffness K and the tick's length T.
#[test]
fn a_wall_is_stable_below_the_passivity_bound_and_unstable_above_its_limit() {
    for damping in PERSONS {
        for device_damping in DAMPINGS {
            let parameters = linear(damping, device_damping, 0.0);
            let bound = 2.0 * device_damping / TICK;
            let (found, exact) = (found_limit(parameters), exact_limit(&parameters));
            println!(
                "damping of arm {damping}, device {device_damping} N s/m: limit {found:.0} N/m, {:.3} times bound",
                found / bound
            );
            assert!((found / exact - 1.0).abs() < 0.01, "limit found {found} N/m, exact {exact} N/m");
            // Without damping of the arm the passivity bound equals the stability limit, to less than the bisection
            // resolves.
            assert!(exact >= bound && found >= bound * (1.0 - 2.0 * BISECTED), "limit {found} N/m, bound {bound} N/m");
            for part in [0.5, 0.95] {
                let peaks = peaks(parameters, part * bound, -0.005, 60);
                assert!(
                    peaks[59] < 0.5 * peaks[0],
                    "at {part} times the bound {bound} N/m the motion must decay; peak speeds by second {peaks:?} m/s"
                );
            }
            assert!(grows(parameters, 1.05 * found), "no growth 5 % above the limit {found} N/m");
        }
    }
}

/// With a delay d of the force, the loop is stable for K < b / (T / 2 + d), with the device's damping b, the wall's
/// stiffness K and the tick's length T (J. J. Gil, E. Sánchez, T. Hulin, C. Preusche and G. Hirzinger 2009, "Stability
/// boundary for haptic rendering: influence of damping and delay").
#[test]
fn delay_lowers_the_limit_to_the_bound_with_delay() {
    for delay in [0.001, 0.002, 0.005] {
        for device_damping in DAMPINGS {
            let bound = device_damping / (0.5 * TICK + delay);
            let found = found_limit(linear(0.0, device_damping, delay));
            println!(
                "delay {delay} s, device damping {device_damping} N s/m: limit {found:.0} N/m, {:.3} times bound",
                found / bound
            );
            // The bound is exact for slow oscillations. In this test the phase of the fastest oscillations advances by
            // 0.5 rad within the delay, and their stability limit lies 4 % above the bound.
            assert!((1.0 - 2.0 * BISECTED..1.05).contains(&(found / bound)), "limit {found} N/m, bound {bound} N/m");
        }
    }
}
