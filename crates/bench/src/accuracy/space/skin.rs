//! The curves `skin` and `sides` of `palpate bench accuracy`: how fine the skins (surface meshes) of a block and of a
//! ball that is pressed into it must be. The shapes of block and ball stay the same and only the number of their skin
//! vertices changes, so that the force should not change.

use std::path::PathBuf;

use glam::DVec3;
use palpate::Result;
use palpate::internal::stages::QUERY;
use palpate::scene::{Sides, Surface};

use super::layer::{GRADES, block};
use super::press::{Body, HALF_WIDTH, HEIGHT, Press};
use super::shapes::{ball, block_skin};
use super::{entrant, error_against, force};
use crate::accuracy::race::{Entrant, race};
use crate::accuracy::{Curve, Expected, Point, Settings};
use crate::limit::limit;
use crate::meshes::MeshFolder;

/// Numbers of cells across the block's skin, and along a quarter of the ball's girth.
const CELLS: [u32; 6] = [6, 8, 12, 16, 24, 32];
/// Numbers of cells of the two meshes from which the limit is extrapolated; both are finer than any of [`CELLS`].
const REFERENCE: [u32; 2] = [40, 80];
/// Number of cells of the other skin while one skin is varied. It is no divisor or multiple of the varied numbers, so
/// that vertices of the two skins do not coincide.
const OTHER: u32 = 44;
/// Where the skins touch, their cells are finer than even ones by the factor 1 + this.
const GRADE: f64 = 2.0;
/// Number of cells across the layer, the block's tetrahedral mesh.
const LAYER: u32 = 8;
/// Order of convergence of the force in the size of the skin's cells.
const ORDER: f64 = 2.0;
/// Largest allowed error of the force with the finest skin, as a share of the limit.
const BOUND: f64 = 0.02;
/// A line of the curve: whether the skin of the block and that of the ball are varied, and whose vertices are tested
/// for contact.
struct Line {
    name: &'static str,
    is_varied: [bool; 2],
    sides: Sides,
}

const EITHER: [Line; 2] = [
    Line { name: "the block's skin", is_varied: [true, false], sides: Sides::Both },
    Line { name: "the ball's mesh", is_varied: [false, true], sides: Sides::Both },
];
const BOTH: [Line; 2] = [
    Line { name: "both sides", is_varied: [true, true], sides: Sides::Both },
    Line { name: "one side", is_varied: [true, true], sides: Sides::One },
];

/// Measures the force with different numbers of vertices of either skin.
pub fn by_skin(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Curve> {
    let (points, _) = compared(&EITHER, false, settings, watch)?;
    Ok(Curve {
        name: "skin".into(),
        title: "Resolution of the skin".into(),
        question: format!(
            "Does the force depend on how fine the skins are? {} One skin is varied while the other has {OTHER} \
             cells; each of the two lines is compared with its own limit.",
            scene()
        ),
        span_reason: "each skin's contacts carry half of the force, so that coarse vertices of one skin spoil at \
                      most half of it"
            .into(),
        ..curve(points)
    })
}

/// Measures the force with contacts at the vertices of both skins, and at those of the finer skin alone.
pub fn by_sides(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Curve> {
    let (points, limits) = compared(&BOTH, true, settings, watch)?;
    Ok(Curve {
        name: "sides".into(),
        title: "Two-sided and one-sided contact".into(),
        question: format!(
            "What do the vertices of the second skin buy? {} Both skins are varied, with `sides = \"both\"` and with \
             `sides = \"one\"`; both lines are compared with the limit of two sides. The limit of one side differs \
             from it by {:+.2} %.",
            scene(),
            100.0 * (limits[1] / limits[0] - 1.0)
        ),
        span_reason: {
            let ratio = f64::from(CELLS[CELLS.len() - 1]) / f64::from(CELLS[0]);
            format!(
                "between skin cells whose sizes have a ratio of {ratio:.1}, an error of order 2 falls by no more than \
                 {:.1} powers of ten",
                ORDER * ratio.log10()
            )
        },
        ..curve(points)
    })
}

fn scene() -> String {
    format!(
        "A ball of 6 cm radius goes 3 mm into a block of {LAYER} cells across; the skins have ever more vertices, \
         three times as fine where they touch. The reference is the limit of skins of {} and {} cells, extrapolated \
         with order 2.",
        REFERENCE[0], REFERENCE[1]
    )
}

fn curve(points: Vec<Point>) -> Curve {
    let law = "forces are sums over vertices of a continuous pressure".into();
    Curve {
        knob: "one over the skin's cells".into(),
        stage: "pose to contact".into(),
        points,
        order_reason: "it is chance whether a vertex lies just inside the rim of the contact area or outside".into(),
        expected: Some(Expected { order: ORDER, law, is_of_shape: false }),
        bound: BOUND,
        ..Curve::default()
    }
}

impl Line {
    fn press(&self, folder: &MeshFolder, cells: u32) -> Result<Press> {
        let [of_block, of_ball] = self.is_varied.map(|is_varied| if is_varied { cells } else { OTHER });
        let surface = Some(Surface::File(skin(folder, of_block)?));
        let mut press = Press::new(Body::Based(surface, block(folder, LAYER, GRADES)?));
        press.ball = Some(folder.surface(&format!("ball{of_ball}"), &ball(press.radius, of_ball, GRADE))?);
        press.sides = self.sides;
        Ok(press)
    }
}

/// The points of both lines, and the limit of the force on each line, N. The errors of both lines are relative to the
/// first limit if `is_shared`, else to the limit of their own line.
fn compared(
    lines: &[Line; 2],
    is_shared: bool,
    settings: &Settings,
    watch: &mut dyn FnMut(&str),
) -> Result<(Vec<Point>, [f64; 2])> {
    let folder = MeshFolder::new()?;
    let mut entrants: Vec<Entrant> = Vec::new();
    let mut limits = [0.0; 2];
    for (line, own) in lines.iter().zip(&mut limits) {
        let mut last = [(0.0, 0.0); 2];
        for (last, cells) in last.iter_mut().zip(REFERENCE) {
            watch(&format!("reference: {}, {cells} cells", line.name));
            *last = (1.0 / f64::from(cells), force(&line.press(&folder, cells)?.scene(), settings)?);
        }
        *own = limit(last, ORDER);
        for cells in CELLS {
            let setting = format!("{}, {cells} cells", line.name);
            entrants.push(entrant(&line.press(&folder, cells)?, "", line.name, setting, 1.0 / f64::from(cells)));
        }
    }
    let options = settings.options();
    let rules = settings.rules(&QUERY, &options);
    let reference = |index: usize| limits[if is_shared { 0 } else { index / CELLS.len() }];
    let points = race(entrants, &rules, watch, &mut |index, run| error_against(reference(index), run))?;
    Ok((points, limits))
}

fn skin(folder: &MeshFolder, cells: u32) -> Result<PathBuf> {
    let size = DVec3::new(HALF_WIDTH, HEIGHT, HALF_WIDTH);
    let mesh = block_skin(size, [cells, cells.div_ceil(2), cells], DVec3::new(GRADE, 1.0, GRADE));
    folder.surface(&format!("skin{cells}"), &mesh)
}
