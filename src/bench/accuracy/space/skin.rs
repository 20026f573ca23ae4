//! How fine skins must be: the same block in skins of any fineness, and the same ball, for neither should count.

use std::path::PathBuf;

use glam::DVec3;

use super::layer::block;
use super::limit::limit;
use super::press::{Body, HALF_WIDTH, HEIGHT, Press};
use super::shapes::{Folder, ball, block_skin};
use super::{entrant, error_against, errors_of, force, local_orders};
use crate::Result;
use crate::bench::accuracy::race::{Entrant, Rules, race};
use crate::bench::accuracy::{Curve, Expected, Settings};
use crate::scene::Surface;
use crate::stages::QUERY;

/// Cells across the block's skin, and a quarter of the ball's girth.
const CELLS: [u32; 6] = [6, 8, 12, 16, 24, 32];
/// Of the skins that the reference is extrapolated from.
const REFERENCE: [u32; 2] = [32, 64];
/// Of the other side, while one is varied: not a divisor of theirs.
const OTHER: u32 = 44;
/// Vertices are the finer by one more than this where they touch.
const GRADE: f64 = 2.0;
/// Across the layer.
const LAYER: u32 = 10;
const ORDER: f64 = 2.0;
/// The finest skin.
const BOUND: f64 = 0.02;
const LINES: [&str; 2] = ["the block's skin", "the ball's mesh"];

/// Vertices of both skins.
pub fn by_skin(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Curve> {
    let folder = Folder::new()?;
    let press = |line: &str, cells: u32| -> Result<Press> {
        let (own, other) = (|is_own: bool| if is_own { cells } else { OTHER }, line == LINES[0]);
        let surface = skin(&folder, own(other))?;
        let mut press = Press::new(Body::Based(Some(Surface::File(surface)), block(&folder, LAYER)?));
        let cells = own(!other);
        press.ball = Some(folder.surface(&format!("ball{cells}"), &ball(press.radius, cells, GRADE))?);
        Ok(press)
    };
    let mut entrants: Vec<Entrant> = Vec::new();
    let mut references = Vec::new();
    for line in LINES {
        let mut last = [(0.0, 0.0); 2];
        for (last, cells) in last.iter_mut().zip(REFERENCE) {
            watch(&format!("reference: {line}, {cells} cells"));
            *last = (1.0 / f64::from(cells), force(&press(line, cells)?.scene(), settings)?);
        }
        for cells in CELLS {
            let setting = format!("{line}, {cells} cells");
            entrants.push(entrant(&press(line, cells)?, "", line, setting, 1.0 / f64::from(cells)));
            references.push(limit(last, ORDER));
        }
    }
    let rules = Rules { rounds: settings.rounds, stages: &QUERY, options: &settings.options() };
    let points = race(entrants, &rules, watch, &mut |index, run| error_against(references[index], run))?;
    let told = LINES.map(|line| {
        let orders = local_orders(&errors_of(&points, "", line));
        format!("{} ({line})", orders.iter().map(|order| format!("{order:.1}")).collect::<Vec<_>>().join(", "))
    });
    Ok(Curve {
        name: "skin".into(),
        title: "Resolution of the skin".into(),
        question: format!(
            "Does the force depend on how finely skins are cut? A ball of 6 cm goes 3 mm into a block of {LAYER} cells across, \
             with skins of ever more vertices on either (three times as fine where they touch; the other side has {OTHER} \
             cells). Against the limit of skins of {} and {} cells, extrapolated with order 2.",
            REFERENCE[0], REFERENCE[1]
        ),
        knob: "one over the skin's cells".into(),
        stage: "pose to contact".into(),
        points,
        expected: Some(Expected { order: ORDER, law: "sums over vertices of a pressure without jumps".into() }),
        reason: format!(
            "either side carries half of the force, so that coarse vertices of one spoil half at most; and whether a vertex \
             lies just within the rim or without is chance: from skin to finer skin the order is {}",
            told.join("; ")
        ),
        bound: BOUND,
    })
}

fn skin(folder: &Folder, cells: u32) -> Result<PathBuf> {
    let size = DVec3::new(HALF_WIDTH, HEIGHT, HALF_WIDTH);
    let mesh = block_skin(size, [cells, cells.div_ceil(2), cells], DVec3::new(GRADE, 1.0, GRADE));
    folder.surface(&format!("skin{cells}"), &mesh)
}
