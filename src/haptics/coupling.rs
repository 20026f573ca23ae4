//! Chooses the gains (stiffness and damping) of the virtual coupling: the spring and damper between haptic device and
//! tool, the rigid body that the device leads.
//!
//! A virtual wall of stiffness K and damping B, sampled with period T, is passive if b > K T / 2 + |B|, where b is the
//! device's own mechanical damping (J. E. Colgate and G. Schenkel, "Passivity of a class of sampled-data systems",
//! 1997); with a delay t_d of the force the wall is stable if K < (b + B) / (T / 2 + t_d) (J. J. Gil, E. Sanchez, T.
//! Hulin, C. Preusche and G. Hirzinger, "Stability boundary for haptic rendering: influence of damping and delay",
//! 2009).

use crate::scene::Coupling;
use crate::scene::profile::Profile;

/// Sampling period for which the device profiles (published data of haptic devices) give stiffness and damping, s.
const PUBLISHED_PERIOD: f64 = 1e-3;
/// Safety factor: the share of a theoretical limit that is used.
const MARGIN: f64 = 0.8;
/// Greatest change of the force, N, that one encoder step may cause through the coupling's stiffness.
const SPRING_STEP: f64 = 0.03;
/// Greatest change of the force, N, that one encoder step may cause through the coupling's damping, if the velocity is
/// that of a single period. It is estimated over many periods unless the device is fast, so that steps are felt less.
const DAMPER_STEP: f64 = 0.12;

/// The chosen gains, and the reason for them.
#[derive(Debug, Clone, PartialEq)]
pub struct Gains {
    /// The stiffness and damping of the coupling.
    pub coupling: Coupling,
    /// Damping that passivity control (`passivity.rs`) may inject in addition to the coupling's own damping: linear,
    /// N s/m, and angular, N m s/rad. See [`injectable`].
    pub most_damping: [f64; 2],
    /// One line of text: the gains, and the limits from which they follow.
    pub reason: String,
}

/// A lower bound of the device's own damping b, N s/m, for a device that renders the published `stiffness` (N/m) and
/// `damping` (N s/m) stably at 1 kHz: the larger of K T / 2 and B, where K is `stiffness`, B is `damping` and T is 1
/// ms.
pub fn dissipation(stiffness: f64, damping: f64) -> f64 {
    (0.5 * stiffness * PUBLISHED_PERIOD).max(damping)
}

/// The greatest stiffness K (N/m) that both rules of this file's first comment allow: for the device's own damping b
/// (`dissipation`) and a virtual damping B (`damping`), both in N s/m, and for a sampling period T (`period`) and a
/// delay t_d (`delay`) of the force, both in s.
pub fn stiffest(dissipation: f64, damping: f64, period: f64, delay: f64) -> f64 {
    let colgate = 2.0 * (dissipation - damping).max(0.0) / period;
    let delayed = (dissipation + damping) / (0.5 * period + delay);
    colgate.min(delayed)
}

/// Damping that may be added at the sampling period T (s) to a coupling of stiffness K and damping B: half of the slack
/// in Colgate's rule `b > K T / 2 + B`, times the safety factor. The half accounts for the estimate of the velocity,
/// which is taken over one period and so delays the force by `t_d = T / 2`; by Gil's rule this leaves only the share
/// `1 / (1 + 2 t_d / T) = 1 / 2` of the slack.
pub fn injectable(dissipation: f64, stiffness: f64, damping: f64, period: f64) -> f64 {
    MARGIN * 0.5 * (dissipation - 0.5 * stiffness * period - damping).max(0.0)
}

/// Chooses the gains from the device's profile, the period (s) and the delay of the force (s). The delay is 0 if a
/// local contact model (a linear force law) follows the tool between simulation steps; otherwise the force of the last
/// step is played (commanded to the device), and the delay is the age of that force. `asked` holds the scene's gains;
/// those above a limit are lowered to the limit. Stiffness and damping are low enough for the steps of the device's
/// encoders not to be felt as jumps of the force, if its resolution is known. `mass` (kg) and `inertia` (kg m^2) are
/// the tool's; they scale the angular gains if the device plays no torque.
pub fn choose(profile: &Profile, period: f64, delay: f64, mass: f64, inertia: f64, asked: Option<&Coupling>) -> Gains {
    let slower = (PUBLISHED_PERIOD / period).min(1.0);
    let axis = |stiffness: f64, damping: f64| {
        let b = dissipation(stiffness, damping);
        let virtual_damping = 0.5 * b;
        let most = MARGIN * stiffest(b, virtual_damping, period, delay);
        ((stiffness * slower).min(most), virtual_damping)
    };
    let (stable, virtual_damping) = axis(profile.stiffness, profile.damping);
    let step = profile.resolution.unwrap_or(0.0).max(f64::MIN_POSITIVE);
    let stiffness = stable.min(SPRING_STEP / step);
    let damping = virtual_damping.min(DAMPER_STEP * period / step);
    let (angular_stiffness, angular_damping) = match profile.angular_stiffness > 0.0 {
        true => axis(profile.angular_stiffness, profile.angular_damping),
        // The device plays no torque, so these gains are not felt: they let the tool's rotation follow the device as
        // quickly as the tool's position does.
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
    let coarse = match most.stiffness < stable || most.damping < virtual_damping {
        true => format!(" and encoder steps of {:.1} um", 1e6 * step),
        false => String::new(),
    };
    let reason = format!(
        "coupling {stiffness:.0} N/m, {damping:.2} N s/m, {angular_stiffness:.3} N m/rad, {angular_damping:.4} N m s/rad \
         ({origin}); limits of profile {} at {:.0} Hz with a force delay of {:.1} ms{coarse}: {:.0} N/m, {:.2} N s/m",
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::profile::PROFILES;

    #[test]
    fn the_gains_follow_the_resolution_of_the_device() {
        let gains = |profile: &Profile| choose(profile, 1e-3, 0.0, 0.05, 2e-6, None);
        for profile in PROFILES {
            let exact = gains(&Profile { resolution: None, ..profile.clone() });
            let Some(step) = profile.resolution else { continue };
            let Gains { coupling, reason, .. } = gains(&profile);
            assert!(coupling.stiffness * step <= SPRING_STEP * 1.000_001, "{}: {coupling:?}", profile.name);
            assert!(coupling.damping * step / 1e-3 <= DAMPER_STEP * 1.000_001, "{}: {coupling:?}", profile.name);
            // What a step of the encoders does not limit is as without encoders.
            let is_coarse = coupling != exact.coupling;
            assert_eq!(is_coarse, ["omega.x", "delta.6", "falcon"].contains(&profile.name), "{}", profile.name);
            assert_eq!(reason.contains("encoder steps of"), is_coarse, "{reason}");
            assert_eq!(coupling.stiffness, exact.coupling.stiffness.min(SPRING_STEP / step), "{}", profile.name);
        }
    }
}
