//! The loop closed as simply as can be: the hand presses on a virtual wall, rendered directly at 1 kHz.

use palpate::scene::Key;

use super::*;

const TICK: f64 = 1e-3;
/// Viscous damping of the devices tried, N s/m.
const DAMPINGS: [f64; 5] = [0.1, 0.3, 0.8, 2.0, 5.0];
/// The arm's damping: of the worst person, who takes nothing, and of the default one, N s/m.
const PERSONS: [f64; 2] = [0.0, 5.0];
/// Where the person wants to be, 10 mm within the wall, m.
const WITHIN: f64 = 0.01;

/// A stability limit is found to this part of it.
const BISECTED: f64 = 1e-3;

/// The wall starts at x = 0: F = -K x. Greatest speed in every second, from a start at a place and the intention at once
/// within the wall, m/s.
fn peaks(parameters: HandParameters, stiffness: f64, start: f64, seconds: usize) -> Vec<f64> {
    let intended = Key { time: 0.0, position: DVec3::X * WITHIN, orientation: DQuat::IDENTITY };
    let profile = Profile::named("scripted").unwrap().clone();
    let mut hand = Hand::new(parameters, Drive::new(&[], intended), profile).unwrap();
    hand.place(RigidState::at_rest(DVec3::X * start, DQuat::IDENTITY));
    let wall = |x: f64| Wrench { force: DVec3::X * (-stiffness * x).min(0.0), torque: DVec3::ZERO };
    // As if it had been held there: what is on its way is not zero.
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

/// No friction and no encoder, which the linear theory leaves out.
fn linear(damping: f64, device_damping: f64, delay: f64) -> HandParameters {
    HandParameters { damping, device_damping, delay, friction: 0.0, quantum: 0.0, ..Default::default() }
}

/// Whether a disturbance of a thousandth of the way to balance grows; what has grown until it leaves the wall is faster than
/// it ever was.
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

/// The same from the exact discretisation of mass, damping and arm under a force held for a tick: the characteristic
/// polynomial's last coefficient reaches one.
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

/// Colgate and Schenkel 1997, "Passivity of a class of sampled-data systems": b > K T / 2.
#[test]
fn a_wall_is_stable_below_the_passivity_bound_and_unstable_above_its_limit() {
    for damping in PERSONS {
        for device_damping in DAMPINGS {
            let parameters = linear(damping, device_damping, 0.0);
            let bound = 2.0 * device_damping / TICK;
            let (found, exact) = (found_limit(parameters), exact_limit(&parameters));
            println!(
                "arm {damping}, device {device_damping} N s/m: limit {found:.0} N/m, {:.3} of the bound",
                found / bound
            );
            assert!((found / exact - 1.0).abs() < 0.01, "found {found} N/m, exact {exact}");
            // Without the arm's damping the bound is the limit itself, to less than the bisection shows.
            assert!(exact >= bound && found >= bound * (1.0 - 2.0 * BISECTED), "{found} N/m, bound {bound}");
            for part in [0.5, 0.95] {
                let peaks = peaks(parameters, part * bound, -0.005, 60);
                assert!(peaks[59] < 0.5 * peaks[0], "{part} of {bound} N/m: {peaks:?}");
            }
            assert!(grows(parameters, 1.05 * found), "{found} N/m");
        }
    }
}

/// With a delay d the bound is K < b / (T / 2 + d) (J. J. Gil, E. Sánchez, T. Hulin, C. Preusche and G. Hirzinger 2009,
/// "Stability boundary for haptic rendering: influence of damping and delay").
#[test]
fn delay_lowers_the_limit_to_the_bound_with_delay() {
    for delay in [0.001, 0.002, 0.005] {
        for device_damping in DAMPINGS {
            let bound = device_damping / (0.5 * TICK + delay);
            let found = found_limit(linear(0.0, device_damping, delay));
            println!(
                "delay {delay} s, device {device_damping} N s/m: limit {found:.0} N/m, {:.3} of it",
                found / bound
            );
            // The bound is the limit of slow swings; the fastest here turn by 0.5 rad in the delay, and lie 4 % above.
            assert!((1.0 - 2.0 * BISECTED..1.05).contains(&(found / bound)), "{found} N/m, bound {bound}");
        }
    }
}
