//! Gains of the virtual coupling between device and tool, and the limits that they come from.
//!
//! A wall of stiffness K and damping B, sampled every T, is passive where b > K T / 2 + |B|, b being what the device itself
//! dissipates (J. E. Colgate and G. Schenkel, "Passivity of a class of sampled-data systems", 1997); with a delay t_d it is
//! stable where K < (b + B) / (T / 2 + t_d) (J. J. Gil, E. Sanchez, T. Hulin, C. Preusche and G. Hirzinger, "Stability
//! boundary for haptic rendering: influence of damping and delay", 2009).

use crate::scene::Coupling;
use crate::scene::profile::Profile;

/// Period at which the profiles' stiffness and damping are given, s.
const PUBLISHED_PERIOD: f64 = 1e-3;
/// Of what a rule allows, so much is taken.
const MARGIN: f64 = 0.8;

/// What decided the gains.
#[derive(Debug, Clone, PartialEq)]
pub struct Gains {
    /// The gains.
    pub coupling: Coupling,
    /// Damping that the device bears beside them, N s/m, and about any axis, N m s/rad: see [`injectable`].
    pub most_damping: [f64; 2],
    /// One line: what they are, and why.
    pub reason: String,
}

/// What a device dissipates by itself at least, N s/m, if it renders its published stiffness and its published damping at
/// 1 kHz: the larger of K T / 2 and B.
pub fn dissipation(stiffness: f64, damping: f64) -> f64 {
    (0.5 * stiffness * PUBLISHED_PERIOD).max(damping)
}

/// The greatest stiffness that device, period T (s), virtual damping (N s/m) and delay (s) allow.
pub fn stiffest(dissipation: f64, damping: f64, period: f64, delay: f64) -> f64 {
    let colgate = 2.0 * (dissipation - damping).max(0.0) / period;
    let delayed = (dissipation + damping) / (0.5 * period + delay);
    colgate.min(delayed)
}

/// Damping that may be added to a coupling of this stiffness and damping at period T (s): what Colgate's rule leaves,
/// b > K T / 2 + B. A velocity that is estimated over a period is half of one late beside the force that is held for one: the
/// damping then acts with a delay t_d of half a period, and by Gil's rule takes 1 / (1 + 2 t_d / T) of that.
pub fn injectable(dissipation: f64, stiffness: f64, damping: f64, period: f64) -> f64 {
    MARGIN * 0.5 * (dissipation - 0.5 * stiffness * period - damping).max(0.0)
}

/// Gains from the profile, the period (s) and the delay of the force (s): of a raw force the wrench's age; with the local
/// model none. `asked`: the scene's, which may be lower than those but not higher. `inertia`: of the tool, kg m^2, and `mass`,
/// kg, for turning where the device plays no torque.
pub fn choose(profile: &Profile, period: f64, delay: f64, mass: f64, inertia: f64, asked: Option<&Coupling>) -> Gains {
    let slower = (PUBLISHED_PERIOD / period).min(1.0);
    let axis = |stiffness: f64, damping: f64| {
        let b = dissipation(stiffness, damping);
        let virtual_damping = 0.5 * b;
        let most = MARGIN * stiffest(b, virtual_damping, period, delay);
        ((stiffness * slower).min(most), virtual_damping)
    };
    let (stiffness, damping) = axis(profile.stiffness, profile.damping);
    let (angular_stiffness, angular_damping) = match profile.angular_stiffness > 0.0 {
        true => axis(profile.angular_stiffness, profile.angular_damping),
        // Nobody feels it: the tool turns with the device as quickly as it follows it.
        false => (stiffness * inertia / mass, damping * inertia / mass),
    };
    let most = Coupling { stiffness, damping, angular_stiffness, angular_damping };
    let (coupling, origin) = match asked {
        None => (most, "chosen"),
        Some(asked) => {
            let free = !profile.plays_torque();
            let least = |asked: f64, limit: f64, unlimited: bool| if unlimited { asked } else { asked.min(limit) };
            let coupling = Coupling {
                stiffness: asked.stiffness.min(most.stiffness),
                damping: asked.damping.min(most.damping),
                angular_stiffness: least(asked.angular_stiffness, most.angular_stiffness, free),
                angular_damping: least(asked.angular_damping, most.angular_damping, free),
            };
            (coupling, if coupling == *asked { "the scene's" } else { "the scene's, lowered to the limits" })
        }
    };
    let Coupling { stiffness, damping, angular_stiffness, angular_damping } = coupling;
    let reason = format!(
        "coupling {stiffness:.0} N/m, {damping:.2} N s/m, {angular_stiffness:.3} N m/rad, {angular_damping:.4} N m s/rad \
         ({origin}): profile {}, {:.0} Hz, force delayed by {:.1} ms allow {:.0} N/m with {:.2} N s/m",
        profile.name,
        1.0 / period,
        1e3 * delay,
        most.stiffness,
        most.damping,
    );
    let injectable = |[most_stiffness, most_damping]: [f64; 2], stiffness: f64, damping: f64| {
        injectable(dissipation(most_stiffness, most_damping), stiffness, damping, period)
    };
    let most_damping = [
        injectable([profile.stiffness, profile.damping], stiffness, damping),
        injectable([profile.angular_stiffness, profile.angular_damping], angular_stiffness, angular_damping),
    ];
    Gains { coupling, most_damping, reason }
}
