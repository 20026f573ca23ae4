//! The axes and cells of the stability matrix, a set of many stiff and extreme simulations of a soft block. Each
//! simulation is a case, which passes if it keeps all invariants (conditions that every simulation must keep) and the
//! engine raises no flag (report of a problem in a step). An axis is a quantity that is varied, one row of the matrix;
//! a cell is one of its values, with the cases that are run for this value. The tool is a sphere, the rigid body that
//! the haptic device leads.

use std::path::PathBuf;

use glam::DVec3;
use palpate::Result;
use palpate::scene::preset::{PRESETS, Preset};
use palpate::scene::{Material, MaterialLaw, Place, Region};

use super::cases::{
    Case, bare, both, hang, hang_loaded, pluck, press, release, rest, sphere, spin, still, teleport, throw, thrust,
};
use super::invariants::Promise;
use super::labels::{power, si, stretched};
use super::meshes;
use super::setup::{Attachment, RADIUS, Setup};
use crate::meshes::MeshFolder;

/// Length of the bar that hangs, m.
const BAR_LENGTH: f64 = 0.2;
/// Density of that bar, kg/m^3.
const BAR_DENSITY: f64 = 200.0;
/// Contact stiffness of two blocks, one on the other, N/m^3.
const STACKED_STIFFNESS: f64 = 1e7;
/// Weight of the load that the bar carries, in units of the bar's weight.
const LOAD: f64 = 15.0;

/// One value of an axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Cell {
    /// The value as text, with its unit.
    pub label: String,
    /// Whether the value is in the core range of the axis, the range of values for which all cases must pass.
    pub is_core: bool,
    /// The simulations that are run for this value.
    pub cases: Vec<Case>,
}

/// A quantity that is varied.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    /// Name on the command line (`--only`).
    pub name: &'static str,
    /// Title in the report.
    pub title: &'static str,
    /// Whether the values are alternatives in words instead of ascending numbers.
    pub is_listed: bool,
    /// The values; numbers are in ascending order.
    pub cells: Vec<Cell>,
}

/// Names of all axes, in the order of the matrix.
pub const NAMES: [&str; 27] = [
    "young",
    "poisson",
    "poisson-neo-hookean",
    "density",
    "step",
    "mass-ratio",
    "contact-stiffness",
    "preset",
    "damping-mass",
    "damping-stiffness",
    "sliver",
    "stretch",
    "thrust",
    "teleport",
    "spin",
    "spin-stiff",
    "rest",
    "size",
    "origin",
    "gravity",
    "tetrahedron",
    "newton",
    "tension",
    "light",
    "bound",
    "body",
    "tool",
];

/// Which part of the matrix is run.
#[derive(Debug, Clone, Copy)]
pub struct Extent<'a> {
    /// Whether the short form of the matrix is run, with fewer values and steps.
    pub is_quick: bool,
    /// Whether a case of a million steps is added in which the block rests on a floor.
    pub is_soak: bool,
    /// Temporary folder for the meshes that the scenes use.
    pub folder: &'a MeshFolder,
}

fn with(change: impl Fn(&mut Setup)) -> Setup {
    let mut setup = Setup::default();
    change(&mut setup);
    setup
}

/// Values of an axis: first those of the whole matrix, then those of its short form.
struct Values(&'static [f64], &'static [f64]);

impl Values {
    /// The axis with these values. For each value, `label` gives the text and `cases` the simulations. `core` is the
    /// core range, ends included; `None`: the axis has no core range.
    fn axis(
        self,
        name: &'static str,
        title: &'static str,
        extent: Extent,
        label: impl Fn(f64) -> String,
        core: Option<[f64; 2]>,
        cases: impl Fn(f64) -> Vec<Case>,
    ) -> Axis {
        let values = if extent.is_quick { self.1 } else { self.0 };
        let is_core = |x: f64| core.is_some_and(|[least, greatest]| least <= x && x <= greatest);
        let cell = |x: &f64| Cell { label: label(*x), is_core: is_core(*x), cases: cases(*x) };
        Axis { name, title, is_listed: false, cells: values.iter().map(cell).collect() }
    }
}

/// A neo-Hookean bar that hangs by its upper end, in steps of 10 ms. Its lowest layer of cells, a twentieth of the bar,
/// weighs `load` times as much as the whole bar at [`BAR_DENSITY`].
fn loaded_bar(extent: Extent, load: f64) -> Result<Setup> {
    let mesh = meshes::bar(extent.folder, BAR_LENGTH)?;
    let material = Material {
        law: MaterialLaw::NeoHookean,
        poisson: 0.45,
        density: BAR_DENSITY,
        damping_stiffness: 0.05,
        ..Setup::default().material
    };
    let wide = DVec3::splat(BAR_LENGTH);
    let place = Place::Box { low: -2.0 * wide, high: DVec3::new(wide.x, -0.95 * BAR_LENGTH, wide.z) };
    let heavy = Region { place, material: Material { density: 20.0 * load * BAR_DENSITY, ..material } };
    Ok(Setup { mesh: Some(mesh), edge: BAR_LENGTH, material, dt: 0.01, regions: vec![heavy], ..Setup::default() })
}

/// Two cases: the given loaded bar, and the same of a corotational material.
fn both_laws(bar: &Setup) -> Vec<Case> {
    let mut corotational = bar.clone();
    corotational.change_materials(|material| material.law = MaterialLaw::Corotational);
    let scenario = "hang, loaded, corotational";
    vec![hang_loaded(bar.clone()), Case { scenario, ..hang_loaded(corotational) }]
}

/// The axis of this name; `None`: no axis has it. Errors: a mesh cannot be written.
pub fn axis(name: &str, extent: Extent) -> Result<Option<Axis>> {
    Ok(match material(name, extent).or_else(|| contact(name, extent)).or_else(|| motion(name, extent)) {
        Some(axis) => Some(axis),
        None => shape(name, extent)?,
    })
}

fn material(name: &str, extent: Extent) -> Option<Axis> {
    const NU: Values = Values(&[-0.5, -0.25, 0.0, 0.3, 0.45, 0.49, 0.499, 0.4999], &[-0.5, 0.3, 0.4999]);
    let poisson = |law: MaterialLaw| move |nu: f64| bare(with(|s| (s.material.poisson, s.material.law) = (nu, law)));
    let plain = |x: f64| format!("{x}");
    let young = |x: f64| bare(with(|s| s.material.young = x));
    let density = |x: f64| bare(with(|s| s.material.density = x));
    let damping_mass = |x: f64| {
        let setup = with(|s| s.material.damping_mass = x);
        vec![hang(setup.clone()), press(setup, sphere(0.1))]
    };
    let damping_stiffness = |x: f64| both(with(|s| s.material.damping_stiffness = x));
    Some(match name {
        "young" => {
            let all = &[1.0, 10.0, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12];
            Values(all, &[1.0, 1e3, 1e5, 1e7, 1e12]).axis(
                "young",
                "Young's modulus",
                extent,
                |x| si(x, "Pa"),
                Some([1e3, 1e7]),
                young,
            )
        }
        "poisson" => NU.axis(
            "poisson",
            "Poisson's ratio, corotational",
            extent,
            plain,
            Some([0.0, 0.49]),
            poisson(MaterialLaw::Corotational),
        ),
        "poisson-neo-hookean" => {
            let title = "Poisson's ratio, neo-Hookean";
            NU.axis("poisson-neo-hookean", title, extent, plain, Some([0.0, 0.49]), poisson(MaterialLaw::NeoHookean))
        }
        "density" => Values(&[1.0, 10.0, 100.0, 1e3, 5e3, 2e4], &[1.0, 1e3, 2e4]).axis(
            "density",
            "Density, kg/m^3",
            extent,
            plain,
            Some([100.0, 5e3]),
            density,
        ),
        "damping-mass" => Values(&[0.0, 1.0, 100.0, 1e4, 1e6], &[0.0, 1e6]).axis(
            "damping-mass",
            "Damping by mass, 1/s",
            extent,
            plain,
            Some([0.0, 100.0]),
            damping_mass,
        ),
        "damping-stiffness" => Values(&[0.0, 1e-3, 0.1, 10.0, 1e3], &[0.0, 1e3]).axis(
            "damping-stiffness",
            "Damping by stiffness",
            extent,
            |x| si(x, "s"),
            Some([0.0, 0.01]),
            damping_stiffness,
        ),
        _ => return None,
    })
}

fn contact(name: &str, extent: Extent) -> Option<Axis> {
    let setup = || Setup::default().damped();
    let stiffness = |x: f64| vec![press(Setup { stiffness: Some(x), ..setup() }, sphere(0.1))];
    Some(match name {
        // The block weighs 1 kg, so that the ratio of the sphere's mass to the block's is the sphere's mass in kg.
        "mass-ratio" => {
            let all = &[1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0, 1e3, 1e4, 1e5];
            let title = "Mass of tool to body";
            Values(all, &[1e-5, 1e-3, 0.1, 10.0, 1e3, 1e5]).axis(
                "mass-ratio",
                title,
                extent,
                power,
                Some([1e-3, 1.0]),
                |x| vec![throw(setup(), x)],
            )
        }
        "contact-stiffness" => {
            let all = &[1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11];
            let title = "Contact stiffness, N/m^3";
            Values(all, &[1e3, 1e5, 1e7, 1e9, 1e11]).axis(
                "contact-stiffness",
                title,
                extent,
                power,
                Some([1e6, 1e8]),
                stiffness,
            )
        }
        "preset" => {
            let all = &[1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10];
            Values(all, &[1e3, 1e5, 1e7, 1e8, 1e9]).axis(
                "preset",
                "Presets, Young's modulus",
                extent,
                |x| si(x, "Pa"),
                Some([1e3, 1e7]),
                |x| {
                    let with_preset = |preset: &Preset| {
                        let material = Material { young: x, ..Setup::default().material };
                        let usual = Setup { material, dt: preset.dt, preset: Some(*preset), ..Setup::default() };
                        // Without gravity, under which the softest blocks would collapse.
                        let setup = Setup { gravity: 0.0, ..usual };
                        let case = press(setup.damped(), sphere(0.1));
                        Case { scenario: preset.name, ..case }
                    };
                    PRESETS.iter().map(with_preset).collect()
                },
            )
        }
        "thrust" => Values(&[0.3, 1.0, 3.0, 10.0], &[1.0, 10.0]).axis(
            "thrust",
            "Speed of a tool thrust through the body",
            extent,
            |x| format!("{x} m/s"),
            None,
            |x| vec![thrust(setup(), x)],
        ),
        "teleport" => Values(&[1e-3, 3e-3, 1e-2, 3e-2, 0.1], &[1e-3, 1e-2, 0.1]).axis(
            "teleport",
            "Device jumps into the body by",
            extent,
            |x| si(x, "m"),
            Some([0.0, 1e-3]),
            |x| vec![teleport(setup(), x)],
        ),
        "rest" => {
            let mut values = vec![1e3];
            values.extend((!extent.is_quick).then_some(1e4));
            values.extend(extent.is_soak.then_some(1e6));
            let label = |x: f64| format!("{x} steps");
            let cell = |x: f64| Cell { label: label(x), is_core: true, cases: vec![rest(setup(), x as usize)] };
            Axis {
                name: "rest",
                title: "Resting contact",
                is_listed: false,
                cells: values.into_iter().map(cell).collect(),
            }
        }
        _ => return None,
    })
}

fn motion(name: &str, extent: Extent) -> Option<Axis> {
    let setup = || Setup::default().damped();
    Some(match name {
        "step" => Values(&[1e-4, 2.5e-4, 1e-3, 4e-3, 1e-2, 3.3e-2, 0.1], &[1e-4, 1e-3, 1e-2, 0.1]).axis(
            "step",
            "Time step",
            extent,
            |x| si(x, "s"),
            Some([2.5e-4, 1e-2]),
            |x| bare(with(|s| s.dt = x)),
        ),
        "stretch" => Values(&[-1.0, -0.5, 0.05, 0.1, 0.5, 2.0, 3.0, 4.0], &[-1.0, 0.1, 4.0]).axis(
            "stretch",
            "Released when",
            extent,
            stretched,
            Some([0.5, 2.0]),
            |x| {
                let neo = |mut s: Setup| {
                    s.material.law = MaterialLaw::NeoHookean;
                    s
                };
                vec![release(setup(), x), release(neo(setup()), x)]
            },
        ),
        "spin" => Values(&[1.0, 10.0, 30.0, 100.0, 300.0, 1000.0], &[10.0, 100.0, 300.0]).axis(
            "spin",
            "Spinning freely",
            extent,
            |x| format!("{x} rad/s"),
            Some([0.0, 10.0]),
            |x| vec![spin(Setup::default(), x)],
        ),
        "spin-stiff" => Values(&[2e4, 1e6, 1e8, 1e10, 1e12], &[2e4, 1e8, 1e12]).axis(
            "spin-stiff",
            "Spinning freely at 10 rad/s",
            extent,
            |x| si(x, "Pa"),
            Some([1e3, 1e6]),
            |x| vec![spin(with(|s| s.material.young = x), 10.0)],
        ),
        "gravity" => Values(&[0.0, 1.0, 3.0, 10.0, 30.0, 100.0], &[0.0, 1.0, 100.0]).axis(
            "gravity",
            "Gravity",
            extent,
            |x| format!("{x} g"),
            Some([0.0, 1.0]),
            |x| {
                let setup = with(|s| s.gravity = 9.81 * x);
                let cases = [both(setup.clone()), vec![hang(setup)]].concat();
                let hangs = |case: &Case| case.scenario.starts_with("hang");
                cases.into_iter().map(|c| if x == 0.0 && hangs(&c) { still(c) } else { c }).collect()
            },
        ),
        "origin" => Values(&[0.0, 1.0, 1e3, 1e6], &[1e3]).axis(
            "origin",
            "Distance from the origin",
            extent,
            |x| si(x, "m"),
            Some([0.0, 1e3]),
            |x| both(with(|s| s.origin = x * DVec3::new(0.6, 0.0, 0.8))),
        ),
        _ => return None,
    })
}

fn shape(name: &str, extent: Extent) -> Result<Option<Axis>> {
    Ok(Some(match name {
        // Young's modulus grows in proportion to the block's size, so that the strain under the block's own weight is
        // equal at all sizes.
        "size" => Values(&[1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0], &[1e-3, 100.0]).axis(
            "size",
            "Size of the body",
            extent,
            |x| si(x, "m"),
            Some([1e-2, 1.0]),
            |x| {
                let setup = with(|s| (s.edge, s.material.young) = (x, 2e4 * x / 0.1));
                [both(setup.clone()), vec![pluck(setup)]].concat()
            },
        ),
        "sliver" => {
            let values: &[f64] = if extent.is_quick { &[0.01, 1.0] } else { &[0.01, 0.1, 1.0, 10.0] };
            let mut cells = Vec::new();
            for &angle in values {
                let mesh = meshes::slivers(extent.folder, angle, Setup::default().edge)?;
                let setup = with(|s| s.mesh = Some(mesh.clone()));
                let cases = [both(setup.clone()), vec![pluck(setup)]].concat();
                cells.push(Cell { label: format!("{angle} deg"), is_core: angle >= 1.0, cases });
            }
            Axis { name: "sliver", title: "Least dihedral angle", is_listed: false, cells }
        }
        "tetrahedron" => {
            let mesh = meshes::tetrahedron(extent.folder, Setup::default().edge)?;
            let setup = with(|s| s.mesh = Some(mesh.clone())).damped();
            let on_floor = rest(setup.clone(), if extent.is_quick { 600 } else { 2000 });
            let cell = |label: &str, case| Cell { label: label.into(), is_core: true, cases: vec![case] };
            let cells = vec![cell("held by a face", hang(setup)), cell("on a floor", on_floor)];
            Axis { name: "tetrahedron", title: "A single tetrahedron", is_listed: true, cells }
        }
        "newton" => {
            let bar = loaded_bar(extent, LOAD)?;
            let of = |newton: f64| both_laws(&Setup { newton: newton as u32, ..bar.clone() });
            Values(&[1.0, 2.0, 3.0, 5.0, 10.0], &[1.0, 2.0]).axis(
                "newton",
                "Newton iterations, loaded bar",
                extent,
                |x| format!("{x}"),
                Some([1.0, 10.0]),
                of,
            )
        }
        "tension" => {
            // Numbers of the bar's own weight, and the strain that Hooke's law would give the bar.
            let (loads, strains) = ([1.5, 5.0, 15.0, 30.0], ["0.03", "0.1", "0.3", "0.6"]);
            let chosen = if extent.is_quick { vec![1, 3] } else { vec![0, 1, 2, 3] };
            let cell = |k: usize| -> Result<Cell> {
                let bar = Setup { newton: 2, ..loaded_bar(extent, loads[k])? };
                let label = format!("{} times its weight, load / (E area) {}", loads[k], strains[k]);
                Ok(Cell { label, is_core: k < 3, cases: both_laws(&bar) })
            };
            let cells = chosen.into_iter().map(cell).collect::<Result<_>>()?;
            Axis { name: "tension", title: "Load that stretches a bar", is_listed: false, cells }
        }
        "light" => {
            let bar = loaded_bar(extent, LOAD)?;
            let of = |density: f64| {
                let material = Material { density, ..bar.material };
                both_laws(&Setup { material, ..bar.clone() })
            };
            Values(&[0.2, 2.0, 20.0, 200.0], &[0.2, 20.0]).axis(
                "light",
                "Density of a bar under a fixed load",
                extent,
                |x| format!("{x} kg/m^3"),
                Some([2.0, 200.0]),
                of,
            )
        }
        "bound" => {
            let cell = |label: &str, attachment: Attachment, is_still| {
                let case =
                    |case: Case| Case { setup: Setup { attachment: attachment.clone(), ..case.setup.clone() }, ..case };
                let cases = both(Setup::default()).into_iter().map(case);
                let cases = cases.map(|c| if is_still { still(c) } else { c }).collect();
                Cell { label: label.into(), is_core: true, cases }
            };
            let stiff = both(with(|setup| setup.change_materials(|material| material.young = 2e6)));
            let on_rollers =
                |case: Case| Case { setup: Setup { attachment: Attachment::Rollers, ..case.setup }, ..case };
            let stiff = stiff.into_iter().map(on_rollers).collect();
            let cells = vec![
                cell("all but one", Attachment::AllButOne, false),
                cell("all", Attachment::All, true),
                cell("rollers", Attachment::Rollers, false),
                Cell { label: "rollers, 2 MPa".into(), is_core: true, cases: stiff },
            ];
            Axis { name: "bound", title: "Attached and supported nodes", is_listed: true, cells }
        }
        "body" => {
            let at = |case: Case, attachment| Case { setup: Setup { attachment, ..case.setup }, ..case };
            let edge = Setup::default().edge;
            let head = meshes::head(extent.folder, edge)?;
            let head = Setup { mesh: Some(head), ..Setup::default() };
            let pressed_head = press(head.clone().damped(), sphere(edge));
            let sagging_head = at(hang(head.clone().damped()), Attachment::LowestQuarter);
            let of_head = vec![sagging_head, at(pressed_head, Attachment::LowestQuarter), pluck(head)];
            let limb = layered_limb().damped();
            let pressed_limb = at(press(limb.clone(), sphere(edge)), Attachment::Bone);
            let mut neo_hookean = pressed_limb.clone();
            neo_hookean.setup.change_materials(|material| material.law = MaterialLaw::NeoHookean);
            let neo_hookean = Case { scenario: "press, neo-Hookean", ..neo_hookean };
            let of_limb = vec![at(hang(limb), Attachment::Bone), pressed_limb, neo_hookean];
            let stacked = with(|s| (s.is_stacked, s.stiffness) = (true, Some(STACKED_STIFFNESS))).damped();
            let pressed_blocks = press(stacked, sphere(edge));
            // The blocks press on each other when the sphere has left.
            let promise = Promise { parts: false, ..pressed_blocks.promise };
            let of_blocks = vec![Case { promise, ..pressed_blocks }];
            let cell = |label: &str, cases| Cell { label: label.into(), is_core: true, cases };
            let mut cells = vec![cell("block on a block", of_blocks)];
            if !extent.is_quick {
                cells.extend([cell("scanned head", of_head), cell("limb with a bone", of_limb)]);
            }
            Axis { name: "body", title: "Other bodies", is_listed: true, cells }
        }
        "tool" => {
            let radius = RADIUS * Setup::default().edge;
            let (needle, blade) = (meshes::needle(extent.folder, radius)?, meshes::blade(extent.folder, radius)?);
            let sheet = meshes::sheet(extent.folder, Setup::default().edge)?;
            let pressed = |tool: Option<PathBuf>, mesh: Option<PathBuf>| {
                let setup = with(|s| (s.tool, s.mesh) = (tool.clone(), mesh.clone())).damped();
                let edge = setup.edge;
                press(setup, sphere(edge))
            };
            let cell = |label: &str, case| Cell { label: label.into(), is_core: true, cases: vec![case] };
            let cells = vec![
                cell("needle", pressed(Some(needle), None)),
                cell("edge of a blade", pressed(Some(blade), None)),
                cell("sphere on a sheet", {
                    let case = pressed(None, Some(sheet));
                    Case { setup: Setup { attachment: Attachment::Side, ..case.setup.clone() }, ..case }
                }),
            ];
            Axis { name: "tool", title: "Needle, edge, sheet", is_listed: true, cells }
        }
        _ => return Ok(None),
    }))
}

/// A limb that lies along x: a bone, which does not move, within muscle three times as stiff as the fat around it. The
/// bone is that of [`Attachment::Bone`].
fn layered_limb() -> Setup {
    let fat = Setup { cells: 6, ..Setup::default() };
    let (edge, wide) = (fat.edge, 2.0 * fat.edge);
    let low = DVec3::new(-wide, edge / 6.0, edge / 6.0);
    let place = Place::Box { low, high: DVec3::new(wide, edge * 5.0 / 6.0, edge * 5.0 / 6.0) };
    let muscle = Region { place, material: Material { young: 3.0 * fat.material.young, ..fat.material } };
    Setup { regions: vec![muscle], ..fat }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whatever_has_something_to_touch_is_to_touch_it() {
        let folder = MeshFolder::new().unwrap();
        for is_quick in [false, true] {
            let extent = Extent { is_quick, is_soak: false, folder: &folder };
            for name in NAMES {
                let axis = axis(name, extent).unwrap().unwrap();
                assert_eq!(axis.name, name);
                for case in axis.cells.iter().flat_map(|cell| &cell.cases) {
                    let can_touch = case.setup.sphere.is_some() || case.setup.has_floor;
                    assert_eq!(
                        case.promise.touches, can_touch,
                        "axis {name}, case {}: contact must be promised exactly where there is a sphere or a floor",
                        case.scenario
                    );
                }
            }
        }
    }
}
