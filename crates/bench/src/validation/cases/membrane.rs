//! Cook's membrane.

use glam::DVec3;
use palpate::Result;
use palpate::internal::prepare::Layer;
use palpate::internal::prepare::layer::kuhn_box;

use super::super::lab::Lab;
use super::super::series::{Convergence, Function, Model, Quantity};
use super::{Case, face, head, support, traction};

/// The published deflection is for a Young's modulus, a load and a thickness of 1, so that it is in units of load over
/// modulus and thickness. Here lengths are in mm, and that quotient is this many mm.
const QUOTIENT: f64 = 0.004;
const YOUNG: f64 = 1e6;
const MILLIMETRE: f64 = 1e-3;
/// Cells along and across the membrane.
const CELLS: [u32; 4] = [8, 16, 32, 64];

/// Cook's membrane in plane stress.
pub const CASE: Case = Case {
    name: "cook",
    title: "Cook's membrane",
    source: "R. D. Cook, \"Improved two-dimensional finite element\" (1974); limit of fine meshes 23.96",
    problem: "A tapered panel (48 wide, 44 high at the clamped end and 16 at the free one, 1 thick) carries a shear \
              load of 1 along its free end; Young's modulus 1, Poisson's ratio 1/3, plane stress. The deflection is \
              that of the middle of the free end. Here lengths are mm, the load is so small that the strain is, and \
              one cell is thick on one side of the plane of symmetry.",
    measure,
};

fn measure(lab: &mut Lab) -> Result<Vec<Quantity>> {
    let mut levels = Vec::new();
    for &cells in lab.levels(&CELLS) {
        let layer = membrane(cells);
        let file = lab.folder.layer(&format!("cook{cells}"), &layer.nodes, &layer.tetrahedra)?;
        let text = head(0.1, [0.0; 3], 1e-7)
            + &format!(
                "[[body]]\nname = \"panel\"\nlayer = {file:?}\n\
                 material = {{ young = {YOUNG:?}, poisson = {:?}, density = 1000.0 }}\n",
                1.0 / 3.0
            )
            + &support("clamp", "axis = [0, 0, 1]", &face(0, 0.0))
            + &support("symmetry", "plane = [0, 0, 1]", &face(2, 0.0))
            + &traction("shear", [0.0, QUOTIENT * YOUNG / 16.0, 0.0], &face(0, 48.0 * MILLIMETRE));
        let mut run = lab.open(&format!("{cells} x {cells} cells"), &text)?;
        run.rest(40, 1000)?;
        let end = run.displacement(MILLIMETRE * DVec3::new(48.0, 52.0, 0.0))?;
        levels.push(run.level(1.0 / f64::from(cells), end.y / (QUOTIENT * MILLIMETRE)));
    }
    let model = Model {
        uncertainty: 1e-3,
        reason: "the clamped end is three-dimensional here, not in plane stress",
        ..Model::default()
    };
    let convergence = Convergence::Order(2.0, Function::Reciprocal);
    let quantity = Quantity::new("deflection of the end", "", 23.96, convergence, levels);
    Ok(vec![Quantity { uncertainty: 0.01, model, ..quantity }])
}

/// Half of the membrane's thickness, on one side of the plane of symmetry. All tetrahedra have an edge across the
/// thickness, so that cells much wider than thick do not lock.
fn membrane(cells: u32) -> Layer {
    let mut layer = kuhn_box(DVec3::ZERO, DVec3::ONE, [cells, cells, 1]);
    for node in &mut layer.nodes {
        let (low, high) = (44.0 * node.x, 44.0 + 16.0 * node.x);
        *node = MILLIMETRE * DVec3::new(48.0 * node.x, low + (high - low) * node.y, 0.5 * node.z);
    }
    layer
}
