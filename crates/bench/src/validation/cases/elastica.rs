//! Large bending of a slender bar, by the theory of the elastica: a case of PyElastica, whose bodies are rods. With
//! Poisson's ratio zero a bar of tetrahedra has the same theory.

use glam::DVec3;
use palpate::Result;

use super::super::lab::Lab;
use super::super::meshes::{Split, grid};
use super::super::series::{Convergence, Of, Quantity};
use super::{Case, face, head, support};

const YOUNG: f64 = 1e6;
const DENSITY: f64 = 1000.0;
/// Cells across the height of the bar.
const CELLS: [u32; 4] = [2, 4, 6, 8];

/// A bar under a uniform load.
pub const CASE: Case = Case {
    name: "elastica",
    title: "Cantilever under a uniform load, large deflection",
    source: "PyElastica, examples/CantileverDistributedLoad (github.com/GazzolaLab/PyElastica, commit 1aa3ce27), \
             table of cantilever_distributed_load_data.json, load q L^3 / (E I) = 5",
    problem: "A bar of 50 x 2 cm is clamped at one end and bends under its weight until its end hangs down by half \
              its length. Poisson's ratio is zero, and one cell is wide between planes.",
    measure,
};

const LENGTH: f64 = 0.5;
const HEIGHT: f64 = 0.02;
/// Load per length times the cube of the length, over the stiffness E I against bending.
const LOAD: f64 = 5.0;

fn measure(lab: &mut Lab) -> Result<Vec<Quantity>> {
    let mut levels = [Vec::new(), Vec::new()];
    for &cells in lab.levels(&CELLS) {
        let text = scene(lab, cells)?;
        let mut run = lab.open("elastica", &format!("{cells} cells across"), &text)?;
        run.rest(60, 1000)?;
        let end = run.displacement(DVec3::new(LENGTH, 0.5 * HEIGHT, 0.0))? / LENGTH;
        levels[0].push(run.level(1.0 / f64::from(cells), -end.y));
        levels[1].push(run.level(1.0 / f64::from(cells), -end.x));
    }
    let quantity = |name: &str, published: f64, of, levels| {
        Quantity {
            name: name.into(),
            unit: "",
            published,
            // Half a unit of the table's last digit.
            rounding: 0.5e-4,
            model: 4e-3,
            reason:
                "so much the table differs from the equation of the elastica, integrated in f64 (0.4959 and 0.1533); \
                 a bar with shear bends by 0.05 % more"
                    .into(),
            convergence: Convergence::Order(2.0, of),
            levels,
        }
    };
    let [down, back] = levels;
    Ok(vec![
        quantity("deflection over length", 0.4976, Of::Reciprocal, down),
        quantity("shortening over length", 1.0 - 0.8455, Of::ReciprocalRoot, back),
    ])
}

/// A bar along x from the origin with square cells, one of them wide, clamped at x = 0.
fn scene(lab: &Lab, cells: u32) -> Result<String> {
    let size = HEIGHT / f64::from(cells);
    let along = (LENGTH / size).round() as u32;
    let layer = grid(DVec3::ZERO, DVec3::new(LENGTH, HEIGHT, size), [along, cells, 1], Split::Mirrored);
    let file = lab.folder.layer(&format!("elastica{cells}"), &layer.nodes, &layer.tetrahedra)?;
    // The load per length is density times area times gravity.
    let gravity = LOAD * YOUNG * HEIGHT * HEIGHT / (12.0 * DENSITY * LENGTH.powi(3));
    Ok(head(0.3, [0.0, -gravity, 0.0], 1e-4)
        + &format!(
            "[[body]]\nname = \"bar\"\nlayer = {file:?}\n\
             material = {{ young = {YOUNG:?}, poisson = 0.0, density = {DENSITY:?}, damping_mass = 15.0 }}\n"
        )
        + &support("clamp", "point = true", &face(0, 0.0))
        + &support("sides", "plane = [0, 0, 1]", "{ all = true }"))
}
