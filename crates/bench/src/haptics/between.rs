//! Part `between` of `palpate bench haptics`: how well the haptic loop knows the force between two steps of the
//! simulation. A scripted device presses the tool (rigid body that the device leads) into a soft body, or slides it
//! along, and releases it, with a simulation of 1000 steps a second and with slower ones; the contact forces that the loop found
//! are compared tick by tick (iteration of the loop). Besides, the change of force from one step to the next is
//! compared with the change that the local contact model (the loop's force law between steps) predicted.

use glam::DVec3;
use palpate::internal::haptics::prediction::Prediction;
use palpate::internal::haptics::virtual_time::Schedule;
use palpate::internal::step::ContactWrench;
use palpate::internal::step::trajectory::Trajectory;
use palpate::scene::{Bind, Key, Layer, Model, Shape, Surface};
use palpate::{Result, Scene};
use palpate_devices::Scripted;
use serde::{Deserialize, Serialize};

use super::head::{self, CHEEK, Skin};
use super::rig::{Mode, PERIOD, Recorded, Rig, key, tool};
use super::{Settings, profile};
use crate::samples::median;

/// The device's profile.
pub const DEVICE: &str = "sigma.7";
/// Rate of the simulation that the others are compared with, Hz.
pub const REFERENCE: f64 = 1000.0;
/// Coefficient of friction where the tool slides.
pub const FRICTION: f64 = 0.3;
/// Speed of a slow press and of a fast one, and of the slide, m/s.
const SLOW: f64 = 0.02;
const FAST: f64 = 0.2;
const SLIDE: f64 = 0.03;
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

/// Where the tool is pressed in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Place {
    /// The cheek of the head, beside the nose, which is nearer to the tool at first.
    Cheek,
    /// The forehead of the head, smooth.
    Forehead,
    /// The belly of a human around a fixed core.
    Belly,
    /// A block of 100 x 100 x 60 mm on a fixed floor, of cells of 10 mm.
    Block,
}

impl Place {
    /// All places.
    pub const ALL: [Place; 4] = [Place::Cheek, Place::Forehead, Place::Belly, Place::Block];

    /// The place's name.
    pub fn name(self) -> &'static str {
        match self {
            Place::Cheek => "cheek",
            Place::Forehead => "forehead",
            Place::Belly => "belly",
            Place::Block => "block",
        }
    }

    /// Point (x, y) above which the tool starts, m.
    fn above(self) -> [f64; 2] {
        match self {
            Place::Cheek => CHEEK,
            Place::Forehead => [0.0, 0.07],
            Place::Belly => [0.0, 1.05],
            Place::Block => [0.05, 0.05],
        }
    }

    /// A scene with the body and with the tool, whose centre starts at `centre` (m).
    fn scene(self, settings: &Settings, centre: DVec3) -> Scene {
        let mut scene = head::scene(settings, centre);
        let body = &mut scene.bodies[0];
        match self {
            Place::Cheek | Place::Forehead => (),
            Place::Belly => {
                let surface = Some(Surface::Model { model: Model::Human, vertices: 13_000 });
                body.shape = Shape::Soft { surface, layer: Layer::Cell { cell: 0.0459, grade: 1, thickness: None } };
                body.cores[0].bind = Some(Bind::Inset(0.06));
            }
            Place::Block => {
                let high = DVec3::new(0.1, 0.1, 0.06);
                let layer = Layer::Box { low: DVec3::ZERO, high, cells: [10, 10, 6] };
                body.shape = Shape::Soft { surface: None, layer };
                body.cores[0].bind = Some(Bind::Box { low: DVec3::ZERO, high: high.with_z(0.0) });
            }
        }
        scene
    }
}

/// What the device does.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Path {
    /// Presses and releases at this speed, m/s.
    Press(f64),
    /// Presses slowly, slides along the skin with friction and releases.
    Slide,
}

/// Paths that are measured on the cheek; elsewhere the slide is left out.
const PATHS: [Path; 3] = [Path::Press(SLOW), Path::Press(FAST), Path::Slide];

/// One run, compared with the run at 1000 steps a second.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Between {
    /// Where the tool was pressed in.
    pub place: Place,
    /// Young's modulus of the body, Pa.
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
    pub difference: [f64; 2],
    /// The greatest contact force over `peak`.
    pub greatest: f64,
    /// Median relative error of the change of force that the local model predicts for the next step; not where the
    /// newest force is held.
    pub prediction_error: Option<f64>,
}

/// Contact forces of all ticks (N), and the median error of the predicted change of force.
struct Run {
    forces: Vec<DVec3>,
    prediction_error: Option<f64>,
}

/// Measures all paths on all bodies at all rates.
pub fn measure(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Vec<Between>> {
    let mut all = Vec::new();
    for &place in &settings.between_places {
        let touch = Skin::of(&place.scene(settings, DVec3::ZERO))?.touch(place.above())?;
        for &young in &settings.between_moduli {
            for path in PATHS.into_iter().filter(|path| place == Place::Cheek || *path != Path::Slide) {
                watch(&format!("between: {} of {young:.0e} Pa, {path:?}", place.name()));
                measure_path(&mut all, settings, (place, young), path, &keys(touch, path))?;
            }
        }
    }
    Ok(all)
}

/// Measures one path at all rates.
fn measure_path(
    all: &mut Vec<Between>,
    settings: &Settings,
    body @ (place, young): (Place, f64),
    path: Path,
    keys: &[Key],
) -> Result<()> {
    let reference = run(settings, body, path, keys, REFERENCE, Mode::Session)?;
    let mut add = |rate: f64, mode: Mode, own: &Run| {
        let (peak, difference, greatest) =
            compare(&reference.forces, &own.forces, |tick| moves(keys, tick as f64 * PERIOD));
        let prediction_error = own.prediction_error;
        all.push(Between { place, young, path, rate, mode, peak, difference, greatest, prediction_error });
    };
    add(REFERENCE, Mode::Session, &reference);
    for &rate in &settings.between_rates {
        for mode in [Mode::Session, Mode::Raw] {
            add(rate, mode, &run(settings, body, path, keys, rate, mode)?);
        }
    }
    Ok(())
}

/// Whether the device moves at a time, s.
fn moves(keys: &[Key], time: f64) -> bool {
    keys.windows(2).any(|pair| pair[0].position != pair[1].position && (pair[0].time..pair[1].time).contains(&time))
}

/// The device's path. `touch`: where the tool first touches the skin, m.
fn keys(touch: DVec3, path: Path) -> Vec<Key> {
    let [above, deep] = [touch + DVec3::Z * ABOVE, touch - DVec3::Z * WITHIN];
    let speed = if let Path::Press(speed) = path { speed } else { SLOW };
    let (begins, takes) = (RESTS[0], (ABOVE + WITHIN) / speed);
    let mut keys = vec![key(0.0, above), key(begins, above), key(begins + takes, deep)];
    let mut time = begins + takes + RESTS[1];
    keys.push(key(time, deep));
    let slid = if path == Path::Slide { WAY } else { 0.0 } * DVec3::Y;
    if path == Path::Slide {
        time += WAY / SLIDE;
        keys.push(key(time, deep + slid));
    }
    keys.push(key(time + takes, above + slid));
    keys
}

fn run(
    settings: &Settings,
    (place, young): (Place, f64),
    path: Path,
    keys: &[Key],
    rate: f64,
    mode: Mode,
) -> Result<Run> {
    let [first, last] = [keys[0], keys[keys.len() - 1]];
    let mut scene = place.scene(settings, first.position);
    if let Some(material) = &mut scene.bodies[0].material {
        material.young = young;
    }
    scene.contact.friction = if path == Path::Slide { FRICTION } else { 0.0 };
    let mut simulation = head::open(&scene, settings)?;
    let mut recorded = Recorded { inner: &mut simulation, wrenches: Vec::new() };
    let rig = Rig { profile: profile(DEVICE)?, hand: Default::default(), mode };
    let mut device = Scripted::new(Trajectory::new(keys, first), rig.profile.clone(), PERIOD);
    let schedule = Schedule::at(rate, PERIOD);
    let ticks = rig.lead(&mut device, last.time, &tool(first.position), &mut recorded, schedule, |_| ())?;
    let forces = ticks.iter().map(|tick| tick.contact.force).collect();
    let prediction_error = (mode != Mode::Raw).then(|| prediction_error(&recorded.wrenches, rig.arm())).flatten();
    Ok(Run { forces, prediction_error })
}

/// The greatest of the `reference` forces, the median and the 95th percentile of the differences over that force, and
/// the greatest of the `own` forces over it. Compared are the ticks for which `moves` holds.
fn compare(reference: &[DVec3], own: &[DVec3], moves: impl Fn(usize) -> bool) -> (f64, [f64; 2], f64) {
    let greatest = |forces: &[DVec3]| forces.iter().map(|force| force.length()).fold(0.0, f64::max);
    let peak = greatest(reference);
    let felt = |k: &usize| reference[*k].length().max(own[*k].length()) > COMPARED * peak;
    let all = (0..reference.len().min(own.len())).filter(|k| moves(*k)).filter(felt);
    let mut differences: Vec<f64> = all.map(|k| (own[k] - reference[k]).length() / peak).collect();
    differences.sort_unstable_by(f64::total_cmp);
    let p95 = differences.get(differences.len() * 95 / 100).copied().unwrap_or(0.0);
    (peak, [median(&differences), p95], greatest(own) / peak)
}

/// Median relative error of the change of force that the local model of each wrench predicts for the next one.
fn prediction_error(wrenches: &[ContactWrench], arm: f64) -> Option<f64> {
    let mut prediction = Prediction::new(arm);
    let changes: Vec<[f64; 2]> = wrenches.iter().filter_map(|wrench| prediction.take(wrench)).collect();
    let greatest = changes.iter().map(|[_, observed]| observed.abs()).fold(0.0, f64::max);
    let compared = changes.iter().filter(|[_, observed]| observed.abs() > COMPARED * greatest);
    let errors: Vec<f64> = compared.map(|[predicted, observed]| ((predicted - observed) / observed).abs()).collect();
    (!errors.is_empty()).then(|| median(&errors))
}

#[cfg(test)]
mod tests {
    use glam::DQuat;
    use palpate::RigidState;

    use super::*;

    #[test]
    fn forces_are_compared_where_the_device_moves_and_something_is_felt() {
        let reference: Vec<DVec3> = (0..100).map(|k| DVec3::Z * f64::from(k).min(50.0)).collect();
        let own: Vec<DVec3> = reference.iter().map(|force| *force * 1.1).collect();
        let (peak, difference, greatest) = compare(&reference, &own, |k| k < 50);
        assert_eq!(peak, 50.0);
        assert!((greatest - 1.1).abs() < 1e-12);
        // Ticks 3 to 49, of which the middle one is 26 and the 95th percentile 47.
        let expected = [26.0, 47.0].map(|force| 0.1 * force / 50.0);
        assert!(difference.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{difference:?}");
        assert_eq!(compare(&reference, &own, |_| false).1, [0.0; 2]);
    }

    #[test]
    fn the_error_is_that_of_changes_that_are_felt() {
        let at = |k: u32| {
            let tool = RigidState::at_rest(DVec3::Y * -1e-4 * f64::from(k), DQuat::IDENTITY);
            let mut wrench = ContactWrench { step: u64::from(k), ..ContactWrench::none(tool) };
            wrench.wrench.force = DVec3::Y * 300.0 * 1e-4 * f64::from(k);
            wrench.stiffness[1][1] = 1200.0;
            wrench
        };
        assert!((prediction_error(&[at(1), at(2)], 0.01).unwrap() - 3.0).abs() < 1e-9);
        assert!(prediction_error(&(1..30).map(at).collect::<Vec<_>>(), 0.01).unwrap() < 0.01);
        assert!(prediction_error(&[at(0), at(1)], 0.01).is_none());
    }

    #[test]
    fn a_slide_ends_where_it_left_the_skin_and_rests_are_no_motion() {
        let keys = keys(DVec3::ZERO, Path::Slide);
        let end = keys[keys.len() - 1];
        assert!((end.position - DVec3::new(0.0, WAY, ABOVE)).length() < 1e-15);
        let time = 2.0 * (ABOVE + WITHIN) / SLOW + WAY / SLIDE + RESTS[0] + RESTS[1];
        assert!((end.time - time).abs() < 1e-12);
        let moving = (0..(1e3 * time) as usize).filter(|k| moves(&keys, 1e-3 * *k as f64)).count() as f64;
        assert!((moving - 1e3 * (time - RESTS[0] - RESTS[1])).abs() <= 3.0, "{moving} ticks move");
    }
}
