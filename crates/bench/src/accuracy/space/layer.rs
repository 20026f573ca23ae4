//! How fine the layer must be: blocks and a dome pressed by a ball, the same bodies with ever finer cells, against the limit
//! that they tend to.

use std::path::Path;

use glam::DVec3;
use palpate::Result;
use palpate::scene::{Dilatation, Layer, Surface};

use super::limit::limit;
use super::press::{self, HALF_WIDTH, HEIGHT, Press};
use super::shapes::{ball, dome, graded_block};
use super::{entrant, error_against, force};
use crate::accuracy::race::{Entrant, race};
use crate::accuracy::{Curve, Expected, Settings};
use crate::meshes::MeshFolder;

/// Cells across blocks, and across domes: in full and in short.
const CELLS: [[u32; 6]; 2] = [[4, 6, 8, 10, 12, 16], [4, 6, 8, 10, 12, 14]];
/// The limit is extrapolated from two meshes, the second twice as fine as the first: in full and in short.
const REFERENCES: [[u32; 2]; 2] = [[12, 24], [10, 20]];
const ORDER: f64 = 2.0;
/// Cells are finer by one more than this where the ball touches: across the block, and from its top down.
pub const GRADES: DVec3 = DVec3::new(1.0, 0.5, 1.0);
/// Of the ball's mesh, a quarter of its girth, and by how much it is finer where it touches.
const BALL: (u32, f64) = (32, 3.0);
/// Across the dome's skin.
const DOME_SKIN: u32 = 48;
/// Of the ball, so large that it touches several cells, m.
const RADIUS: f64 = 0.1;
/// How deep it goes, m.
const DEPTH: f64 = 0.004;
/// The force of the finest layer, of the limit.
const BOUND: f64 = 0.12;
/// What the times are of.
const STAGES: &[&str] = &["solve"];

/// A body, however fine.
struct Line {
    name: &'static str,
    is_dome: bool,
    poisson: f64,
    dilatation: Dilatation,
}

const LINES: [Line; 3] = [
    Line { name: "block, nu 0.3", is_dome: false, poisson: 0.3, dilatation: Dilatation::Element },
    Line { name: "dome, nu 0.3", is_dome: true, poisson: 0.3, dilatation: Dilatation::Element },
    PATCHED,
];
const PATCHED: Line =
    Line { name: "block, nu 0.49, patch", is_dome: false, poisson: 0.49, dilatation: Dilatation::Patch };
/// What locks: told beside the others.
const LOCKING: Line = Line { name: "block, nu 0.49", dilatation: Dilatation::Element, ..PATCHED };

/// The block of these presses, as a file; its cells are the finer by one more than `grades` where the ball touches.
pub fn block(folder: &MeshFolder, cells: u32, grades: DVec3) -> Result<Layer> {
    let size = DVec3::new(HALF_WIDTH, HEIGHT, HALF_WIDTH);
    let file = graded_block(folder, &format!("block{cells}"), size, [cells, cells.div_ceil(2), cells], grades)?;
    Ok(Layer::File(file))
}

/// The ball's mesh, fine where it touches.
pub fn fine_ball(folder: &MeshFolder, radius: f64) -> Result<std::path::PathBuf> {
    folder.surface("ball", &ball(radius, BALL.0, BALL.1))
}

impl Line {
    fn press(&self, folder: &MeshFolder, skin: &Path, cells: u32) -> Result<Press> {
        let body = if self.is_dome {
            let layer = Layer::Across { cells, grade: 1, thickness: None };
            press::Body::Based(Some(Surface::File(skin.into())), layer)
        } else {
            press::Body::Based(None, block(folder, cells, GRADES)?)
        };
        let (poisson, dilatation) = (self.poisson, self.dilatation);
        let mut press = Press { poisson, dilatation, radius: RADIUS, depth: DEPTH, ..Press::new(body) };
        press.ball = Some(fine_ball(folder, press.radius)?);
        Ok(press)
    }
}

/// Cells across the layer.
pub fn by_layer(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Curve> {
    let folder = MeshFolder::new()?;
    let skin = folder.surface("dome", &dome(HEIGHT, DOME_SKIN))?;
    let quick = usize::from(settings.is_quick);
    let (references, all_cells) = (REFERENCES[quick], CELLS[quick]);
    // What takes longest is left to the whole.
    let lines = if settings.is_quick { &LINES[..2] } else { &LINES[..] };
    let mut limits = Vec::new();
    let mut entrants: Vec<Entrant> = Vec::new();
    for line in lines {
        let mut pair = [(0.0, 0.0); 2];
        for (pair, cells) in pair.iter_mut().zip(references) {
            watch(&format!("reference: {}, {cells} cells across", line.name));
            *pair = (1.0 / f64::from(cells), force(&line.press(&folder, &skin, cells)?.scene(), settings)?);
        }
        for cells in all_cells {
            let press = line.press(&folder, &skin, cells)?;
            let setting = format!("{}, {cells} cells", line.name);
            entrants.push(entrant(&press, line.name, "", setting, 1.0 / f64::from(cells)));
            limits.push(limit(pair, ORDER));
        }
    }
    let finest = all_cells[all_cells.len() - 1];
    let locking = if settings.is_quick {
        String::new()
    } else {
        watch("what locks");
        let locked = force(&LOCKING.press(&folder, &skin, finest)?.scene(), settings)?;
        // The last line is the same block without locking.
        let too_stiff = limits.last().map_or(f64::NAN, |limit| 100.0 * (locked / limit - 1.0));
        format!(
            " `patch` is `dilatation = \"patch\"`: without it the block of nu 0.49 locks, and with {finest} cells is \
             {too_stiff:.0} % too stiff."
        )
    };
    let options = settings.options();
    let rules = settings.rules(STAGES, &options);
    let points = race(entrants, &rules, watch, &mut |index, run| error_against(limits[index], run))?;
    let ratio = f64::from(finest) / f64::from(all_cells[0]);
    let span_reason = format!(
        "cells whose sizes have a ratio of {ratio:.1} give an error of order 2 no more than {:.1}, and two need cells ten times \
         as fine, a thousand times as many",
        ORDER * ratio.log10()
    );
    let [coarse, fine] = references;
    Ok(Curve {
        name: "layer".into(),
        title: "Resolution of the layer".into(),
        question: format!(
            "How fine must the layer be for the force to be right? A ball of 10 cm is pressed 4 mm into blocks of 12 x 4 x 12 \
             cm (cells twice as fine where it touches) and into a dome of 4 cm whose layer the engine makes, 20 kPa, and held \
             until all is at rest; contact is of {:.0e} N/m^3 everywhere. Against the limit of layers of {coarse} and {fine} \
             cells across, extrapolated with order 2.{locking}",
            press::STIFFNESS
        ),
        knob: "one over the cells across".into(),
        stage: STAGES.concat(),
        points,
        expected: Some(Expected {
            order: ORDER,
            is_of_shape: false,
            law: "linear elements: energies, and so forces at given ways, with the square of the cell".into(),
        }),
        order_reason: "what nodes lie under the ball changes from mesh to mesh, and coarse ones have few".into(),
        span_reason,
        bound: BOUND,
        ..Curve::default()
    })
}
