//! A thick plate under pressure: benchmark LE10 of NAFEMS.

use std::f64::consts::FRAC_PI_2;

use glam::{DVec2, DVec3};
use palpate::Result;
use palpate::internal::prepare::Layer;

use super::super::lab::{Lab, Run};
use super::super::meshes::{Split, grid};
use super::super::series::{Convergence, Function, Model, Quantity};
use super::{Case, face, head, support};

/// Half axes of the inner and the outer ellipse, and thickness, m.
const INNER: DVec2 = DVec2::new(2.0, 1.0);
const OUTER: DVec2 = DVec2::new(3.25, 2.75);
const THICKNESS: f64 = 0.6;
const YOUNG: f64 = 2.1e11;
const POISSON: f64 = 0.3;
const PRESSURE: f64 = 1e6;
/// Cells across the thickness; there are three times as many from the inner to the outer edge, and four times as many
/// along them.
const CELLS: [u32; 3] = [6, 8, 12];

/// The stress at the inner edge.
pub const CASE: Case = Case {
    name: "le10",
    title: "Thick plate under pressure (NAFEMS LE10)",
    source: "NAFEMS, \"The standard NAFEMS benchmarks\" (1990), test LE10",
    problem: "A quarter of an elliptic plate with an elliptic hole (half axes 3.25 x 2.75 and 2 x 1 m, 0.6 m thick, \
              210 GPa, Poisson's ratio 0.3) carries 1 MPa on its upper face. Its outer edge is held aside, and \
              vertically along the middle of its height. Published is the stress along y at the upper inner edge, \
              where it meets the x axis. Here, it follows from the strain of the mesh's edge there, which lies on \
              the axis of symmetry, and from what is known of a free edge: no stress across it, and the pressure on \
              top.",
    measure,
};

fn measure(lab: &mut Lab) -> Result<Vec<Quantity>> {
    let mut levels = Vec::new();
    for &cells in lab.levels(&CELLS) {
        let layer = plate(cells);
        let outer = |node: &DVec3| (DVec2::new(node.x, node.y) / OUTER).length() > 1.0 - 1e-9;
        let nodes = |is: &dyn Fn(&DVec3) -> bool| {
            let all = (0..layer.nodes.len()).filter(|&node| is(&layer.nodes[node])).collect::<Vec<_>>();
            format!("{{ nodes = {all:?} }}")
        };
        let file = lab.folder.layer(&format!("le10-{cells}"), &layer.nodes, &layer.tetrahedra)?;
        let text = head(0.01, [0.0; 3], 1e-7)
            + &format!(
                "[[body]]\nname = \"plate\"\nlayer = {file:?}\n\
                 material = {{ young = {YOUNG:?}, poisson = {POISSON:?}, density = 8000.0 }}\n\
                 [[body.load]]\nname = \"pressure\"\npressure = {PRESSURE:?}\nbind = {}\n",
                face(2, THICKNESS)
            )
            + &support("symmetry-x", "plane = [1, 0, 0]", &face(0, 0.0))
            + &support("symmetry-y", "plane = [0, 1, 0]", &face(1, 0.0))
            + &support("edge", "axis = [0, 0, 1]", &nodes(&outer))
            + &support("middle", "plane = [0, 0, 1]", &nodes(&|x| outer(x) && (x.z - 0.5 * THICKNESS).abs() < 1e-9));
        let mut run = lab.open(&format!("{cells} cells across the thickness"), &text)?;
        run.rest(60, 400)?;
        let stress = YOUNG * strain_of_edge(&run, cells)? - POISSON * PRESSURE;
        levels.push(run.level(1.0 / f64::from(cells), 1e-6 * stress));
    }
    let model = Model {
        uncertainty: 1e-2,
        reason: "linear cells have their stress at an edge of the body to an order between 1 and 2, so that the \
                 limit is uncertain by so much",
        ..Model::default()
    };
    let quantity = Quantity::new("stress along y", "MPa", -5.38, Convergence::Order(2.0, Function::Value), levels);
    Ok(vec![Quantity { uncertainty: 0.005, model, ..quantity }])
}

/// The plate; its cells run from the inner edge outward, then along the edges from the x axis to the y axis.
fn plate(cells: u32) -> Layer {
    let mut layer = grid(DVec3::ZERO, DVec3::ONE, [3 * cells, 4 * cells, cells], Split::Mirrored);
    for node in &mut layer.nodes {
        let angle = FRAC_PI_2 * node.y;
        let around = DVec2::new(if node.y == 1.0 { 0.0 } else { angle.cos() }, angle.sin());
        let place = (INNER + (OUTER - INNER) * node.x) * around;
        *node = DVec3::new(place.x, place.y, THICKNESS * node.z);
    }
    layer
}

/// Strain of the first edge of the upper inner edge. The strain along it is even about the x axis, so that the mean
/// over the edge is that on the axis up to the square of its length.
fn strain_of_edge(run: &Run, cells: u32) -> Result<f64> {
    let angle = FRAC_PI_2 / f64::from(4 * cells);
    let [a, b] = [0.0, angle].map(|angle: f64| run.node((INNER * DVec2::from_angle(angle)).extend(THICKNESS)));
    let (nodes, displacements) = (&run.layer().nodes, run.displacements()?);
    let edge = nodes[b] - nodes[a];
    Ok((displacements[b] - displacements[a]).dot(edge) / edge.length_squared())
}
