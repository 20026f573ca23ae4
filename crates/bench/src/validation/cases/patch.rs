//! Patch tests on an irregular mesh: tractions of a uniform stress must give that stress in every tetrahedron, and a
//! uniform stretch must store the same energy everywhere.

use glam::{DMat3, DVec3};
use palpate::Result;
use palpate::internal::prepare::Layer;
use palpate::internal::prepare::layer::{kuhn_box, volume6};
use palpate::internal::step::Field;
use palpate::scene::{Material, MaterialLaw};
use palpate_oracle::elastic::{Elements, lame, polar_rotation, strain};
use palpate_oracle::material_law::stress;

use super::super::lab::{Lab, Run};
use super::super::series::{Convergence, Quantity};
use super::{Case, face, head, traction};

/// Single precision, and a solver that stops at 1e-7.
const WITHIN: f64 = 1e-5;
/// The material and the gradient of displacement of MacNeal and Harder.
const YOUNG: f64 = 1e6;
const POISSON: f64 = 0.25;
const GRADIENT: DMat3 = DMat3::from_cols_array(&[1e-3, 0.5e-3, 0.5e-3, 0.5e-3, 1e-3, 0.5e-3, 0.5e-3, 0.5e-3, 1e-3]);
/// By how much greater the gradient is for the neo-Hookean law, which makes its stretches 1.05 to 1.2.
const LARGE: f64 = 100.0;
/// Cells along the edge of the cube.
const CELLS: [u32; 2] = [2, 4];
/// By how much inner nodes are moved aside, in cells.
const ASIDE: f64 = 0.25;

/// The patch test of both laws.
pub const CASE: Case = Case {
    name: "patch",
    title: "Patch test of both laws",
    source: "R. H. MacNeal and R. L. Harder, \"A proposed standard set of problems to test finite element accuracy\" \
             (1985), patch test for solids; the large stretches by T. Smith, F. de Goes and T. Kim, \"Stable \
             Neo-Hookean flesh simulation\" (2018), equation 14",
    problem: "A unit cube whose inner nodes are moved aside is loaded on its six faces by the tractions of a uniform \
              stress: 2,000 Pa normal, 400 Pa shear for a strain of 1e-3 and 1e6 Pa, Poisson's ratio 0.25. It is \
              held by nothing. The stress must be that in every tetrahedron; of all, the one farthest off is shown. \
              The corotational law has the published strain, the neo-Hookean law a hundred times that.",
    measure,
};

/// The energy of a stretched cube.
pub const ENERGY: Case = Case {
    name: "energy",
    title: "Energy of a stretched cube",
    source: "MuJoCo, test ElasticEnergySolid of test/engine/engine_passive_test.cc \
             (github.com/google-deepmind/mujoco, commit 7927e908): 3 s^2 for the strain s = 1, 2, 3 on all axes, \
             Young's modulus 2, Poisson's ratio 0",
    problem: "The cube of the patch test, of 2 Pa, is stretched by the factor 1 + s on all axes. Shown is the \
              greatest energy density on the skin by the corotational law, J/m^3. There, the strain is that of \
              Green, set directly.",
    measure: energy,
};

fn energy(lab: &mut Lab) -> Result<Vec<Quantity>> {
    let layer = irregular(2);
    let file = lab.folder.layer("energy", &layer.nodes, &layer.tetrahedra)?;
    let text = head(0.02, [0.0; 3], 1e-7)
        + &format!(
            "[[body]]\nname = \"cube\"\nlayer = {file:?}\n\
             material = {{ young = 2.0, poisson = 0.0, density = 1000.0 }}\n"
        );
    let mut quantities = Vec::new();
    for strain in [1.0, 2.0, 3.0] {
        let mut run = lab.open("energy", &format!("strain {strain}"), &text)?;
        let stretched: Vec<DVec3> = run.layer().nodes.iter().map(|x| strain * *x).collect();
        run.simulation.place_nodes(0, &stretched, &vec![DVec3::ZERO; stretched.len()])?;
        let greatest = run.simulation.field(Field::StrainEnergy)?.greatest;
        quantities.push(Quantity {
            name: format!("energy density at strain {strain}"),
            unit: "J/m^3",
            published: 3.0 * strain * strain,
            rounding: 0.0,
            model: 0.0,
            reason: String::new(),
            convergence: Convergence::Exact(WITHIN),
            levels: vec![run.level(0.5, f64::from(greatest.first().copied().unwrap_or(f32::NAN)))],
        });
    }
    Ok(quantities)
}

fn measure(lab: &mut Lab) -> Result<Vec<Quantity>> {
    let mut quantities = Vec::new();
    for (law, name, gradient) in [
        (MaterialLaw::Corotational, "corotational", GRADIENT),
        (MaterialLaw::NeoHookean, "neo-hookean", LARGE * GRADIENT),
    ] {
        let material = Material { law, ..Material::new(YOUNG, POISSON, 1000.0) };
        // The gradient is symmetric, so nothing is turned. Of MacNeal and Harder's strain the stress is published.
        let published = match law {
            MaterialLaw::Corotational => DMat3::from_cols_array(&[2e3, 4e2, 4e2, 4e2, 2e3, 4e2, 4e2, 4e2, 2e3]),
            MaterialLaw::NeoHookean => stress(&material, lame(&material).1, gradient),
        };
        let mut levels = [Vec::new(), Vec::new()];
        for &cells in lab.levels(&CELLS) {
            let label = format!("{name}, {cells} cells along the edge");
            let mut run = lab.open("patch", &label, &scene(lab, cells, name, published)?)?;
            run.rest(40, 1000)?;
            let [normal, shear] = farthest(&run, &material, published)?;
            levels[0].push(run.level(1.0 / f64::from(cells), normal));
            levels[1].push(run.level(1.0 / f64::from(cells), shear));
        }
        let [normal, shear] = levels;
        for (part, published, levels) in [("normal", published.x_axis.x, normal), ("shear", published.x_axis.y, shear)]
        {
            quantities.push(Quantity {
                name: format!("{part} stress, {name}"),
                unit: "Pa",
                published,
                rounding: 0.0,
                model: 0.0,
                reason: String::new(),
                convergence: Convergence::Exact(WITHIN),
                levels,
            });
        }
    }
    Ok(quantities)
}

/// The cube, under the tractions of the first Piola-Kirchhoff stress `stress`.
fn scene(lab: &Lab, cells: u32, law: &str, stress: DMat3) -> Result<String> {
    let layer = irregular(cells);
    let file = lab.folder.layer(&format!("cube{cells}"), &layer.nodes, &layer.tetrahedra)?;
    let mut text = head(0.02, [0.0; 3], 1e-7)
        + &format!(
            "[[body]]\nname = \"cube\"\nlayer = {file:?}\n\
             material = {{ young = {YOUNG:?}, poisson = {POISSON:?}, density = 1000.0, law = \"{law}\" }}\n"
        );
    for axis in 0..3 {
        for (at, sign) in [(0.0, -1.0), (1.0, 1.0)] {
            let force = sign * stress.col(axis);
            text += &traction(&format!("side{axis}{at}"), force.to_array(), &face(axis, at));
        }
    }
    Ok(text)
}

/// A unit cube whose inner nodes are moved aside, each along another direction.
fn irregular(cells: u32) -> Layer {
    let mut layer = kuhn_box(DVec3::ZERO, DVec3::ONE, [cells; 3]);
    let is_inside = |x: &DVec3| x.min_element() > 1e-9 && x.max_element() < 1.0 - 1e-9;
    for (index, node) in layer.nodes.iter_mut().enumerate().filter(|(_, node)| is_inside(node)) {
        let turn = index as f64;
        *node += ASIDE / f64::from(cells) * DVec3::new(turn.sin(), (2.0 * turn).cos(), (3.0 * turn).sin());
    }
    debug_assert!(layer.tetrahedra.iter().all(|tetrahedron| volume6(&layer.nodes, tetrahedron) > 0.0));
    layer
}

/// The normal and the shear component of the stress that are farthest from `published`, of all tetrahedra, Pa.
fn farthest(run: &Run, material: &Material, published: DMat3) -> Result<[f64; 2]> {
    let elements = Elements::new(run.layer(), *material, DMat3::IDENTITY);
    let displacements = run.displacements()?;
    let mut worst = [published.x_axis.x, published.x_axis.y];
    for element in 0..run.layer().tetrahedra.len() {
        let gradient = elements.gradient(element, &displacements);
        let turn = polar_rotation(DMat3::IDENTITY + gradient);
        let stress = stress(material, lame(material).1, strain(turn, gradient));
        for row in 0..3 {
            for column in 0..3 {
                let (part, value) = (usize::from(row != column), stress.col(column)[row]);
                let want = [published.x_axis.x, published.x_axis.y][part];
                // NaN must not be passed over.
                if value.is_nan() || (value - want).abs() > (worst[part] - want).abs() {
                    worst[part] = value;
                }
            }
        }
    }
    Ok(worst)
}
