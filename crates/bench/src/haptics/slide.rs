//! Part `slide` of `palpate bench haptics`: a simulated person slides the tool (rigid body that the haptic device leads
//! by a spring and damper, the virtual coupling) over the cheek of a soft head, and the greatest jump of the force from
//! one tick (iteration of the haptic loop) to the next is measured. The head's skin is its surface mesh.

use glam::DVec3;
use palpate::Result;
use palpate::internal::haptics::servo::Tick;
use palpate::internal::haptics::virtual_time::Schedule;
use palpate::internal::step::ContactWrench;
use palpate::scene::Key;
use palpate_devices::hand::HandParameters;
use serde::{Deserialize, Serialize};

use super::head::{self, CHEEK, Skin};
use super::hold::cases;
use super::rig::{Mode, PERIOD, Recorded, Rig, Spread, key, tool};
use super::{Settings, profile};

/// Speed of the slide, m/s.
pub const SPEED: f64 = 0.05;
/// Length of the slide, which goes from the cheek upwards along y, m.
pub const WAY: f64 = 0.03;
/// A change of the force from one tick to the next is allowed up to this share of the force or up to [`ALLOWED`],
/// whichever is greater.
pub const ALLOWED_SHARE: f64 = 0.05;
/// A change of the force by up to this much is always allowed, N.
pub const ALLOWED: f64 = 0.05;
/// Height of the tool at the start above the position in which it first touches the skin, m.
const ABOVE: f64 = 0.003;
/// Depth below the position of first touch to which the person means to press, m.
const WITHIN: f64 = 0.005;
/// Distance between keys (desired poses at given times) of the path along the skin, m.
const SPACING: f64 = 0.0025;
/// Times at which the person begins to press, means to have reached the full depth, and begins to slide, s.
const TIMES: [f64; 3] = [0.3, 0.6, 1.0];
/// Number of ticks from one point of [`Slid::trace`] to the next.
const TRACED: usize = 5;

/// Among the changes of a force in a phase, the change that is the greatest relative to what is allowed. The phases are
/// the time before the slide and the slide itself.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Change {
    /// Length of the change, N.
    pub newtons: f64,
    /// The greater of the forces before and after the change, N.
    pub force: f64,
    /// When the change happened, s.
    pub time: f64,
    /// Length of the change divided by the allowed length; the change is too great if this exceeds 1.
    pub excess: f64,
}

/// The worst change of each of three forces in one phase, that is, the change with the greatest [`Change::excess`].
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Changes {
    /// Change of the played force (commanded to the haptic device) from tick to tick.
    pub played: Change,
    /// Change of the contact force of the loop's local model (its force law between wrenches) from tick to tick.
    pub contact: Change,
    /// Change of the contact force that the simulation found, from one simulation step to the next. A loop that played
    /// this force unchanged between steps would let the played force jump by this change.
    pub raw: Change,
}

/// Results of a slide.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Slid {
    /// Name of the haptic device's profile.
    pub profile: String,
    /// Rate of the simulation, Hz.
    pub rate: f64,
    /// How the haptic loop used the simulation's wrenches.
    pub mode: Mode,
    /// Magnitude of the played force while sliding, N.
    pub force: Spread,
    /// Forces that one increment of the haptic device's encoders causes: by the stiffness and by the damping of the
    /// virtual coupling, N.
    pub quantum_forces: [f64; 2],
    /// Worst changes before the slide, including the first touch.
    pub touch: Changes,
    /// Worst changes while sliding.
    pub slide: Changes,
    /// Points of the slide: time (s), and magnitudes of the played force, of the local model's contact force and of the
    /// newest force of the simulation (N).
    pub trace: Vec<[f64; 4]>,
}

/// Measures slides with every haptic device of the settings, at every rate, in every mode.
pub fn measure(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Vec<Slid>> {
    let keys = way(&Skin::of(&head::scene(settings, DVec3::ZERO))?)?;
    let scene = head::scene(settings, keys[0].position);
    let mut slides = Vec::new();
    for (name, rate, mode) in cases(&settings.slide_devices, &settings.slide_rates) {
        watch(&format!("slide: {name} at {rate} Hz"));
        let rig = Rig { profile: profile(name)?, hand: HandParameters::default(), mode };
        let mut simulation = head::open(&scene, settings)?;
        let mut recorded = Recorded { inner: &mut simulation, wrenches: Vec::new() };
        let ticks = rig.follow(&keys, &tool(keys[0].position), &mut recorded, Schedule::at(rate, PERIOD))?;
        slides.push(judge(&rig, rate, &ticks, &recorded.wrenches));
    }
    Ok(slides)
}

/// The desired path: down to the cheek, then along it at a constant depth below the skin at rest.
fn way(skin: &Skin) -> Result<Vec<Key>> {
    let [x, y] = CHEEK;
    let [presses, within, slides] = TIMES;
    let touch = skin.touch(CHEEK)?;
    let start = touch + DVec3::Z * ABOVE;
    let mut keys = vec![key(0.0, start), key(presses, start), key(within, touch - DVec3::Z * WITHIN)];
    for k in 0..=(WAY / SPACING).round() as u32 {
        let gone = f64::from(k) * SPACING;
        keys.push(key(slides + gone / SPEED, skin.touch([x, y + gone])? - DVec3::Z * WITHIN));
    }
    Ok(keys)
}

fn judge(rig: &Rig, rate: f64, ticks: &[Tick], wrenches: &[ContactWrench]) -> Slid {
    let slides = TIMES[2];
    let changes = |is_in: &dyn Fn(f64) -> bool| {
        let of_ticks = |force: fn(&Tick) -> DVec3| worst(ticks.iter().map(|t| (t.time, force(t))), is_in);
        Changes {
            played: of_ticks(|tick| tick.played.force),
            contact: of_ticks(|tick| tick.contact.force),
            raw: worst(wrenches.iter().map(|w| (w.time, w.wrench.force)), is_in),
        }
    };
    let sliding: Vec<&Tick> = ticks.iter().filter(|tick| tick.time >= slides).collect();
    let found = |tick: &Tick| wrenches.iter().find(|w| w.step == tick.step).map_or(0.0, |w| w.wrench.force.length());
    let point = |t: &&Tick| [t.time, t.played.force.length(), t.contact.force.length(), found(t)];
    Slid {
        profile: rig.profile.name.into(),
        rate,
        mode: rig.mode,
        quantum_forces: rig.quantum_forces(),
        force: Spread::of(sliding.iter().map(|tick| tick.played.force.length())),
        touch: changes(&|time| time < slides),
        slide: changes(&|time| time >= slides),
        trace: sliding.iter().step_by(TRACED).map(point).collect(),
    }
}

/// The worst change of a force between two successive times, among those changes for whose later time `is_in` holds.
fn worst(forces: impl Iterator<Item = (f64, DVec3)>, is_in: &dyn Fn(f64) -> bool) -> Change {
    let (mut worst, mut last) = (Change::default(), None);
    for (time, now) in forces {
        if let Some(before) = last.replace(now).filter(|_| is_in(time)) {
            let newtons = (now - before).length();
            let force = now.length().max(before.length());
            let excess = newtons / ALLOWED.max(ALLOWED_SHARE * force);
            if excess > worst.excess {
                worst = Change { newtons, force, time, excess };
            }
        }
    }
    worst
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_change_is_the_one_that_is_furthest_beyond_what_is_allowed() {
        let forces = [(0.0, 4.0), (0.1, 4.15), (0.2, 4.15), (0.3, 0.5), (0.4, 0.44), (0.5, 0.45)];
        let of = |from: f64| worst(forces.iter().map(|&(t, f)| (t, DVec3::Z * f)), &|time| time >= from);
        let all = of(0.0);
        assert!(
            all.time == 0.3 && (all.newtons - 3.65).abs() < 1e-12 && all.excess > 17.0,
            "worst change over the whole time: {all:?}"
        );
        let late = of(0.35);
        assert!(
            late.time == 0.4 && (late.excess - 1.2).abs() < 1e-9 && late.force == 0.5,
            "worst change from 0.35 s: {late:?}"
        );
        assert_eq!(of(1.0), Change::default());
    }
}
