//! Two beams of the regression tests of SOFA, on the same tetrahedra.

use glam::DVec3;
use palpate::Result;

use super::super::lab::Lab;
use super::super::meshes::{Split, grid};
use super::super::series::{Convergence, Model, Quantity};
use super::{Case, face, head, support};

/// Single precision, and a solver that stops at 1e-7, where the discretisation is the same.
const WITHIN: f64 = 5e-5;
/// SOFA writes six significant digits of positions.
const LAST_DIGIT: f64 = 0.5e-6;

/// By how much another rule for the rotations of tetrahedra moves the end of the cantilever, m.
const ROTATIONS: f64 = 1.3e-6;
/// By how much masses at nodes, in place of those of hexahedral cells, move nodes of the swinging beam, m.
const MASSES: f64 = 4.7e-4;

/// The corotational beam at rest.
pub const CANTILEVER: Case = Case {
    name: "sofa-cantilever",
    title: "Corotational cantilever of SOFA",
    source: "SOFA's regression tests (github.com/sofa-framework/Regression, commit a4ea0484, scene \
             examples/Validation/cantilever_beam/tetrahedron/corotational/sequential/assembled of \
             github.com/sofa-framework/sofa, commit 6f95d19d)",
    problem: "A beam of 2 x 2 x 20 cm (4 x 4 x 29 cells split into tetrahedra, 2 MPa, Poisson's ratio 0.45, 1,100 \
              kg/m^3) is clamped at one end and rests under its weight. The mesh is the same, and so is the weight \
              of each node, which is that of hexahedral cells there. Displacements are those of the middle of the \
              end.",
    measure: cantilever,
};

/// The neo-Hookean beam that swings.
pub const SWINGING: Case = Case {
    name: "sofa-neo-hookean",
    title: "Swinging neo-Hookean beam of SOFA",
    source: "SOFA's regression tests (github.com/sofa-framework/Regression, commit 6ae30003, scene \
             examples/Component/SolidMechanics/FEM/TetrahedronHyperelasticityFEMForceField.scn of \
             github.com/sofa-framework/sofa, commit fe3ddcae)",
    problem: "A beam of 1 x 1 x 2.7 m (2 x 2 x 7 cells split into tetrahedra, 10 kPa, Poisson's ratio 0.45, 1 kg) is \
              clamped at one end and let go under gravity of 9 m/s^2. Mesh and steps (5 ms, implicit Euler) are the \
              same. Deflections are those of the middle of the end.",
    measure: swinging,
};

fn cantilever(lab: &mut Lab) -> Result<Vec<Quantity>> {
    const DENSITY: f64 = 1100.0;
    let (half, length, cells) = (0.01, 0.2, [4, 4, 29]);
    let (low, high) = (DVec3::new(-half, -half, 0.0), DVec3::new(half, half, length));
    let layer = grid(low, high, cells, Split::Mirrored);
    let file = lab.folder.layer("sofa-cantilever", &layer.nodes, &layer.tetrahedra)?;
    let mut text = head(0.05, [0.0; 3], 1e-7)
        + &format!(
            "[[body]]\nname = \"beam\"\nlayer = {file:?}\n\
             material = {{ young = 2e6, poisson = 0.45, density = {DENSITY:?}, damping_mass = 10.0 }}\n"
        )
        + &support("clamp", "point = true", &face(2, 0.0));
    // An eighth of a cell's weight goes to each of its corners.
    let corner = (high - low).element_product() / f64::from(cells.iter().product::<u32>()) * DENSITY * 9.81 / 8.0;
    let ends = |x: f64, ends: [f64; 2]| if ends.iter().any(|end| (x - end).abs() < 1e-9) { 1 } else { 2 };
    let around = |x: &DVec3| ends(x.x, [low.x, high.x]) * ends(x.y, [low.y, high.y]) * ends(x.z, [low.z, high.z]);
    for count in [1, 2, 4, 8] {
        let nodes: Vec<usize> = (0..layer.nodes.len()).filter(|&node| around(&layer.nodes[node]) == count).collect();
        let weight = corner * (count as usize * nodes.len()) as f64;
        text += &format!(
            "[[body.load]]\nname = \"weight{count}\"\nforce = [0.0, {:?}, 0.0]\nbind = {{ nodes = {nodes:?} }}\n",
            -weight
        );
    }
    let mut run = lab.open("the same mesh", &text)?;
    run.rest(30, 1000)?;
    let end = run.displacement(DVec3::new(0.0, 0.0, length))?;
    let quantity = |name: &str, published: f64, uncertainty: f64, value: f64| Quantity {
        uncertainty,
        model: Model {
            uncertainty: ROTATIONS / published,
            reason: "SOFA takes a tetrahedron's rotation from three of its nodes, here it is that of the polar \
                     decomposition; a separate f64 computation gives SOFA's values to their last digit with the one, \
                     and an end 1.3e-6 m aside of them, along and across, with the other",
            ..Model::default()
        },
        ..Quantity::new(name, "m", published, Convergence::SameMesh(WITHIN), vec![run.level(1.0, value)])
    };
    Ok(vec![
        quantity("deflection of the end", 0.0244496, LAST_DIGIT / 10.0, -end.y),
        quantity("shortening", length - 0.198298, LAST_DIGIT, -end.z),
    ])
}

fn swinging(lab: &mut Lab) -> Result<Vec<Quantity>> {
    let length = 2.7;
    let layer = grid(DVec3::ZERO, DVec3::new(1.0, 1.0, length), [2, 2, 7], Split::Alike);
    let file = lab.folder.layer("sofa-neo-hookean", &layer.nodes, &layer.tetrahedra)?;
    let text = head(0.005, [0.0, -9.0, 0.0], 1e-7)
        + &format!(
            "newton = 4\n[[body]]\nname = \"beam\"\nlayer = {file:?}\n\
             material = {{ young = 1e4, poisson = 0.45, density = {:?}, law = \"neo-hookean\" }}\n",
            1.0 / length
        )
        + &support("clamp", "point = true", &face(2, 0.0));
    let mut run = lab.open("the same mesh", &text)?;
    let mut quantities = Vec::new();
    // Steps, and the published height of the node, m, which is at 0.5 m at rest.
    for (step, height) in [(20, 0.474450), (60, 0.480414), (99, 0.484777)] {
        while run.steps() < step {
            run.step()?;
        }
        let deflection = -run.displacement(DVec3::new(0.5, 0.5, length))?.y;
        let name = format!("deflection after {} s", 0.005 * step as f64);
        let levels = vec![run.level(1.0, deflection)];
        let quantity = Quantity::new(&name, "m", 0.5 - height, Convergence::SameMesh(WITHIN), levels);
        let model = Model {
            uncertainty: MASSES / quantity.published,
            reason: "masses are those of hexahedral cells there, with terms between nodes; a separate f64 \
                     computation gives SOFA's values to their last digit with those, and heights up to 4.7e-4 m \
                     away, 1.8 % of the greatest deflection, with masses at nodes; and the neo-Hookean law is \
                     another one, equal for small strain",
            ..Model::default()
        };
        quantities.push(Quantity { uncertainty: LAST_DIGIT, model, ..quantity });
    }
    Ok(quantities)
}
