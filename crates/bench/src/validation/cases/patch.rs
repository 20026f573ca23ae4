//! Patch tests on an irregular mesh: tractions of a uniform stress must give that stress in every tetrahedron, and a
//! uniform stretch must store the same energy everywhere.

use glam::{DMat3, DVec3};
use palpate::Result;
use palpate::internal::prepare::Layer;
use palpate::internal::prepare::layer::{kuhn_box, volume6};
use palpate::internal::step::Field;
use palpate::scene::Material;
use palpate_oracle::elastic::{Elements, polar_rotation, strain};

use super::super::lab::{Lab, Run};
use super::super::series::{Convergence, Quantity};
use super::{Case, face, head, traction};

/// Single precision, and a solver that stops at 1e-7.
const WITHIN: f64 = 1e-5;
/// The material of MacNeal and Harder; their strain, its normal and its shear components; and their stress, Pa.
const YOUNG: f64 = 1e6;
const POISSON: f64 = 0.25;
const STRAIN: [f64; 2] = [1e-3, 0.5e-3];
const STRESS: [f64; 2] = [2000.0, 400.0];
/// By how much greater the strain is for the neo-Hookean law, which makes the stretches 1.05 to 1.2.
const LARGE: f64 = 100.0;
/// First Piola-Kirchhoff stress of that strain, Pa: m F (1 - 1 / (I + 1)) + l (J - 1 - 3 m / (4 l)) J F^-T, with
/// I = tr(F^T F), J = det F, m = 4/3 mu and l = lambda + 5/6 mu, worked out apart from the engine.
const LARGE_STRESS: [f64; 2] = [263382.4849, 29490.2266];
/// Steps in which the cube comes to rest.
const STEPS: usize = 60;
/// Cells along the edge of the cube.
const CELLS: [u32; 2] = [2, 4];
/// By how much inner nodes are moved aside, in cells.
const ASIDE: f64 = 0.25;

/// The patch test of both laws.
pub const CASE: Case = Case {
    name: "patch",
    title: "Patch test of both laws",
    source: "R. H. MacNeal and R. L. Harder, \"A proposed standard set of problems to test finite element accuracy\" \
             (1985), patch test for solids; the large strain by T. Smith, F. de Goes and T. Kim, \"Stable \
             Neo-Hookean flesh simulation\" (2018), equation 14",
    problem: "A unit cube whose inner nodes are moved aside is loaded on its six faces by the tractions of a uniform \
              stress: 2,000 Pa normal, 400 Pa shear, which for 1 MPa and Poisson's ratio 0.25 make strains of 1e-3 \
              and 5e-4. It is held by nothing. The strain must be that in every tetrahedron; of all, the component \
              farthest off is shown. The corotational law has the published strain, the neo-Hookean law a hundred \
              times that. MacNeal and Harder move the nodes of the faces instead, on a mesh of hexahedra.",
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
        let mut run = lab.open(&format!("strain {strain}"), &text)?;
        let stretched: Vec<DVec3> = run.layer().nodes.iter().map(|x| strain * *x).collect();
        run.simulation.place_nodes(0, &stretched, &vec![DVec3::ZERO; stretched.len()])?;
        let greatest = run.simulation.field(Field::StrainEnergy)?.greatest;
        let name = format!("energy density at strain {strain}");
        let levels = vec![run.level(0.5, f64::from(greatest.first().copied().unwrap_or(f32::NAN)))];
        let published = 3.0 * strain * strain;
        quantities.push(Quantity::new(&name, "J/m^3", published, Convergence::Exact(WITHIN), levels));
    }
    Ok(quantities)
}

fn measure(lab: &mut Lab) -> Result<Vec<Quantity>> {
    let mut quantities = Vec::new();
    for (name, strain, [normal, shear]) in
        [("corotational", STRAIN, STRESS), ("neo-hookean", STRAIN.map(|e| LARGE * e), LARGE_STRESS)]
    {
        let stress = DMat3::from_cols_array(&[normal, shear, shear, shear, normal, shear, shear, shear, normal]);
        let mut levels = [Vec::new(), Vec::new()];
        for &cells in lab.levels(&CELLS) {
            let label = format!("{name}, {cells} cells along the edge");
            let mut run = lab.open(&label, &scene(lab, cells, name, stress)?)?;
            // The cube rests soon, but it floats, and its displacements are those in a frame that follows it.
            for _ in 0..STEPS {
                run.step()?;
            }
            for (levels, value) in levels.iter_mut().zip(farthest(&run, strain)?) {
                levels.push(run.level(1.0 / f64::from(cells), value));
            }
        }
        for ((part, published), levels) in ["normal", "shear"].iter().zip(strain).zip(levels) {
            let name = format!("{part} strain, {name}");
            quantities.push(Quantity::new(&name, "", published, Convergence::Exact(WITHIN), levels));
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

/// The normal and the shear component of the strain that are farthest from `expected`, of all tetrahedra: the
/// components of R^T F - I, with the deformation gradient F and its rotation R.
fn farthest(run: &Run, expected: [f64; 2]) -> Result<[f64; 2]> {
    let elements = Elements::new(run.layer(), Material::new(YOUNG, POISSON, 1000.0), DMat3::IDENTITY);
    let displacements = run.displacements()?;
    let mut worst = expected;
    for element in 0..run.layer().tetrahedra.len() {
        let gradient = elements.gradient(element, &displacements);
        let strain = strain(polar_rotation(DMat3::IDENTITY + gradient), gradient);
        for row in 0..3 {
            for column in 0..3 {
                let (part, value) = (usize::from(row != column), strain.col(column)[row]);
                // NaN must not be passed over.
                if value.is_nan() || (value - expected[part]).abs() > (worst[part] - expected[part]).abs() {
                    worst[part] = value;
                }
            }
        }
    }
    Ok(worst)
}
