//! Part `between` of `palpate bench haptics`: how well the haptic loop knows the force between two steps of the
//! simulation. A scripted device presses the tool (rigid body that the device leads) into the head, slides it along and
//! releases it, with a simulation of 1000 steps a second and with slower ones; the contact forces that the loop found
//! are compared tick by tick (iteration of the loop). Besides, the change of force from one step to the next is
//! compared with the change that the local contact model (the loop's force law between steps) foretold.

use glam::DVec3;
use palpate::Result;
use palpate::internal::haptics::compliance::Compliance;
use palpate::internal::haptics::local_model::LocalModel;
use palpate::internal::haptics::virtual_time::Schedule;
use palpate::internal::step::ContactWrench;
use palpate::scene::Key;
use serde::{Deserialize, Serialize};

use super::head::{self, CHEEK, Skin};
use super::rig::{Mode, PERIOD, Recorded, Rig, key, tool};
use super::{Settings, profile};

/// The device's profile.
pub const DEVICE: &str = "sigma.7";
/// Rate of the simulation that the others are compared with, Hz.
pub const REFERENCE: f64 = 1000.0;
/// Coefficient of friction where the tool slides.
pub const FRICTION: f64 = 0.3;
/// Speed of the slide, m/s.
const SLIDES: f64 = 0.03;
/// Height of the tool at the start above the position in which it first touches the skin, m.
const ABOVE: f64 = 0.004;
/// Depth below the position of first touch to which the device goes, m.
const WITHIN: f64 = 0.008;
/// Length of the slide, m.
const WAY: f64 = 0.012;
/// Time at which the device begins to move, and time for which it rests at the greatest depth, s.
const RESTS: [f64; 2] = [0.1, 0.3];
/// Forces and changes of force below this share of the greatest one are not compared.
const COMPARED: f64 = 0.05;

/// What the device does.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Path {
    /// Presses and releases at this speed, m/s.
    Press(f64),
    /// Presses slowly, slides along the skin with friction and releases.
    Slide,
}

/// Paths that are measured.
pub const PATHS: [Path; 3] = [Path::Press(0.02), Path::Press(0.2), Path::Slide];

/// One run, compared with the run at 1000 steps a second.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Between {
    /// Young's modulus of the head, Pa.
    pub young: f64,
    /// What the device did.
    pub path: Path,
    /// Rate of the simulation, Hz.
    pub rate: f64,
    /// How the haptic loop used the simulation's wrenches.
    pub mode: Mode,
    /// Greatest contact force of the run at 1000 steps a second, N.
    pub peak: f64,
    /// Difference of the contact force from that of the run at 1000 steps a second, over `peak`: median and 95th
    /// percentile over the ticks in which the device moves and something is felt.
    pub off: [f64; 2],
    /// The greatest contact force over `peak`.
    pub highest: f64,
    /// Median relative error of the change of force that the local model foretells for the next step; not where the
    /// newest force is held.
    pub foretold: Option<f64>,
}

/// Contact forces of all ticks (N), and the median error of the foretold change of force.
struct Run {
    forces: Vec<DVec3>,
    foretold: Option<f64>,
}

/// Measures all paths on all heads at all rates.
pub fn measure(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Vec<Between>> {
    let mut all = Vec::new();
    for &young in &settings.between_moduli {
        for path in PATHS {
            watch(&format!("between: a head of {young:.0e} Pa, {path:?}"));
            let keys = keys(&Skin::of(&head::scene(settings, DVec3::ZERO))?, path)?;
            let moves = |time: f64| keys.windows(2).any(|k| k[0].position != k[1].position && holds(k, time));
            let reference = run(settings, young, path, &keys, REFERENCE, Mode::Session)?;
            let mut add = |rate: f64, mode: Mode, own: &Run| {
                let (peak, off, highest) = compare(&reference.forces, &own.forces, |tick| moves(tick as f64 * PERIOD));
                all.push(Between { young, path, rate, mode, peak, off, highest, foretold: own.foretold });
            };
            add(REFERENCE, Mode::Session, &reference);
            for &rate in &settings.between_rates {
                for mode in [Mode::Session, Mode::Raw] {
                    add(rate, mode, &run(settings, young, path, &keys, rate, mode)?);
                }
            }
        }
    }
    Ok(all)
}

fn holds(keys: &[Key], time: f64) -> bool {
    (keys[0].time..keys[1].time).contains(&time)
}

/// The device's path.
fn keys(skin: &Skin, path: Path) -> Result<Vec<Key>> {
    let touch = skin.touch(CHEEK)?;
    let [above, deep] = [touch + DVec3::Z * ABOVE, touch - DVec3::Z * WITHIN];
    let speed = if let Path::Press(speed) = path { speed } else { 0.02 };
    let (begins, takes) = (RESTS[0], (ABOVE + WITHIN) / speed);
    let mut keys = vec![key(0.0, above), key(begins, above), key(begins + takes, deep)];
    let mut time = begins + takes + RESTS[1];
    keys.push(key(time, deep));
    let mut end = (deep, above);
    if path == Path::Slide {
        end = (deep + DVec3::Y * WAY, above + DVec3::Y * WAY);
        time += WAY / SLIDES;
        keys.push(key(time, end.0));
    }
    keys.push(key(time + takes, end.1));
    Ok(keys)
}

fn run(settings: &Settings, young: f64, path: Path, keys: &[Key], rate: f64, mode: Mode) -> Result<Run> {
    let mut scene = head::scene(settings, keys[0].position);
    if let Some(material) = &mut scene.bodies[0].material {
        material.young = young;
    }
    scene.contact.friction = if path == Path::Slide { FRICTION } else { 0.0 };
    let mut simulation = head::open(&scene, settings)?;
    let mut recorded = Recorded { inner: &mut simulation, wrenches: Vec::new() };
    let rig = Rig { profile: profile(DEVICE)?, hand: Default::default(), mode };
    let tool = tool(keys[0].position);
    let ticks = rig.follow_scripted(keys, &tool, &mut recorded, Schedule::at(rate, PERIOD))?;
    let forces = ticks.iter().map(|tick| tick.contact.force).collect();
    let foretold = (mode != Mode::Raw).then(|| error_of_foretold(&recorded.wrenches, rig.arm())).flatten();
    Ok(Run { forces, foretold })
}

/// The greatest of the `right` forces, the median and the 95th percentile of the differences over that force, and the
/// greatest of the `own` forces over it. Compared are the ticks for which `moves` holds.
fn compare(right: &[DVec3], own: &[DVec3], moves: impl Fn(usize) -> bool) -> (f64, [f64; 2], f64) {
    let greatest = |forces: &[DVec3]| forces.iter().map(|force| force.length()).fold(0.0, f64::max);
    let peak = greatest(right);
    let felt = |k: usize| right[k].length().max(own[k].length()) > COMPARED * peak;
    let all = (0..right.len().min(own.len())).filter(|k| moves(*k) && felt(*k));
    let off = sorted(all.map(|k| (own[k] - right[k]).length() / peak).collect());
    let at = |share: f64| off.get((share * off.len() as f64) as usize).copied().unwrap_or(0.0);
    (peak, [at(0.5), at(0.95)], greatest(own) / peak)
}

/// Median relative error of the change of force that the local model of each wrench foretells for the next one.
fn error_of_foretold(wrenches: &[ContactWrench], arm: f64) -> Option<f64> {
    let mut body = Compliance::default();
    let mut changes = Vec::new();
    for pair in wrenches.windows(2) {
        let model = LocalModel::new(&pair[0], &body, arm, f64::INFINITY);
        let touches = pair.iter().all(|wrench| wrench.wrench.force != DVec3::ZERO);
        if let (true, Some((normal, foretold))) = (touches, model.foretell(&pair[1].tool)) {
            changes.push([foretold, normal.dot(pair[1].wrench.force - pair[0].wrench.force)]);
        }
        body.learn(&pair[0], &pair[1], arm);
    }
    let greatest = changes.iter().map(|[_, came]| came.abs()).fold(0.0, f64::max);
    let told = changes.iter().filter(|[_, came]| came.abs() > COMPARED * greatest);
    let errors = sorted(told.map(|[foretold, came]| (foretold - came).abs() / came.abs()).collect());
    errors.get(errors.len() / 2).copied()
}

fn sorted(mut numbers: Vec<f64>) -> Vec<f64> {
    numbers.sort_unstable_by(f64::total_cmp);
    numbers
}

#[cfg(test)]
mod tests {
    use glam::DQuat;
    use palpate::RigidState;

    use super::*;

    #[test]
    fn forces_are_compared_where_the_device_moves_and_something_is_felt() {
        let right: Vec<DVec3> = (0..100).map(|k| DVec3::Z * f64::from(k).min(50.0)).collect();
        let own: Vec<DVec3> = right.iter().map(|force| *force * 1.1).collect();
        let (peak, off, highest) = compare(&right, &own, |k| k < 50);
        assert_eq!(peak, 50.0);
        assert!((highest - 1.1).abs() < 1e-12);
        // Ticks 3 to 49, of which the middle one is 26 and the 95th percentile 47.
        assert!((off[0] - 0.1 * 26.0 / 50.0).abs() < 1e-12 && (off[1] - 0.1 * 47.0 / 50.0).abs() < 1e-12, "{off:?}");
        assert_eq!(compare(&right, &own, |_| false).1, [0.0; 2]);
    }

    #[test]
    fn the_error_of_what_is_foretold_falls_once_the_body_is_known() {
        let at = |k: u32| {
            let tool = RigidState::at_rest(DVec3::Y * -1e-4 * f64::from(k), DQuat::IDENTITY);
            let mut wrench = ContactWrench { step: u64::from(k), ..ContactWrench::none(tool) };
            wrench.wrench.force = DVec3::Y * 300.0 * 1e-4 * f64::from(k);
            wrench.stiffness[1][1] = 1200.0;
            wrench
        };
        let two: Vec<ContactWrench> = (1..3).map(at).collect();
        assert!((error_of_foretold(&two, 0.01).unwrap() - 3.0).abs() < 1e-9);
        let many: Vec<ContactWrench> = (1..30).map(at).collect();
        assert!(error_of_foretold(&many, 0.01).unwrap() < 0.01);
        assert!(error_of_foretold(&[], 0.01).is_none());
    }
}
