//! The curve `layer` of `palpate bench accuracy`: how fine the layer (the tetrahedral mesh of a body) must be. A ball
//! is pressed into blocks and a dome that are meshed with ever finer cells. The error is the relative difference of the
//! contact force from its limit for vanishing cells.

use std::path::Path;

use glam::DVec3;
use palpate::Result;
use palpate::scene::{Dilatation, Layer, Surface};

use super::press::{self, HALF_WIDTH, HEIGHT, Press};
use super::shapes::{ball, dome, graded_block};
use super::{entrant, error_against, force};
use crate::accuracy::race::{Entrant, race};
use crate::accuracy::{Curve, Expected, Settings};
use crate::limit::limit;
use crate::meshes::MeshFolder;

/// Numbers of cells across the blocks and the dome: in the whole benchmark and in its short form.
const CELLS: [[u32; 6]; 2] = [[4, 6, 8, 10, 12, 16], [4, 6, 8, 10, 12, 14]];
/// Cells across the two meshes from which the limit is extrapolated: in the whole benchmark and in its short form.
const REFERENCES: [[u32; 2]; 2] = [[12, 24], [10, 20]];
/// Order of convergence of the force in the size of the cells.
const ORDER: f64 = 2.0;
/// Grading of the block's cells (see [`super::shapes::graded`]), across the block (x, z) and from its top down (y):
/// where the ball touches, cells are finer than even ones by the factor 1 + grade.
pub const GRADES: DVec3 = DVec3::new(1.0, 0.5, 1.0);
/// The ball's mesh: triangle edges along a quarter of its girth, and its grading.
const BALL: (u32, f64) = (32, 3.0);
/// Cells across the dome's skin (its surface mesh).
const DOME_SKIN: u32 = 48;
/// Radius of the ball, m; so large that the ball touches several cells.
const RADIUS: f64 = 0.1;
/// Depth to which the ball is pressed, m.
const DEPTH: f64 = 0.004;
/// Largest allowed error of the force with the finest layer, as a share of the limit.
const BOUND: f64 = 0.12;
/// Stages of a time step whose times are summed.
const STAGES: &[&str] = &["solve"];

/// A line of the curve: one body, meshed with different numbers of cells. In its name, nu is Poisson's ratio, and
/// `patch` means that patches of tetrahedra share their volumetric strain (F-bar) against locking.
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
/// The block whose elements lock, that is, are much too stiff, because its linear tetrahedra are nearly incompressible;
/// the report says by how much the block is too stiff.
const LOCKING: Line = Line { name: "block, nu 0.49", dilatation: Dilatation::Element, ..PATCHED };

/// Writes the block that the ball is pressed into as a mesh file. Where the ball touches the block, the block's cells
/// are finer than even ones by the factor 1 + `grades` along each axis.
pub fn block(folder: &MeshFolder, cells: u32, grades: DVec3) -> Result<Layer> {
    let size = DVec3::new(HALF_WIDTH, HEIGHT, HALF_WIDTH);
    let file = graded_block(folder, &format!("block{cells}"), size, [cells, cells.div_ceil(2), cells], grades)?;
    Ok(Layer::File(file))
}

/// Writes the mesh of the ball, which is finest where the ball touches the body.
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

/// Measures the force for different numbers of cells across the layer.
pub fn by_layer(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Curve> {
    let folder = MeshFolder::new()?;
    let skin = folder.surface("dome", &dome(HEIGHT, DOME_SKIN))?;
    let quick = usize::from(settings.is_quick);
    let (references, all_cells) = (REFERENCES[quick], CELLS[quick]);
    // The short form leaves out the block with a Poisson's ratio of 0.49, which takes longest.
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
        watch("reference: block whose elements lock");
        let locked = force(&LOCKING.press(&folder, &skin, finest)?.scene(), settings)?;
        // The last line of the curve is the same block with `dilatation = "patch"`, which does not lock.
        let too_stiff = limits.last().map_or(f64::NAN, |limit| 100.0 * (locked / limit - 1.0));
        format!(
            " The line `patch` has `dilatation = \"patch\"` in its scene: without it the block of nu 0.49 locks, and \
             with {finest} cells is {too_stiff:.0} % too stiff."
        )
    };
    let options = settings.options();
    let rules = settings.rules(STAGES, &options);
    let points = race(entrants, &rules, watch, &mut |index, run| error_against(limits[index], run))?;
    let ratio = f64::from(finest) / f64::from(all_cells[0]);
    let span_reason = format!(
        "between cell sizes with a ratio of {ratio:.1}, an error of order 2 falls by no more than {:.1} powers of \
         ten; for errors that span two powers of ten, cells would have to be ten times as fine, a thousand times as many",
        ORDER * ratio.log10()
    );
    let [coarse, fine] = references;
    Ok(Curve {
        name: "layer".into(),
        title: "Resolution of the layer".into(),
        question: format!(
            "How fine must the layer be for the force to be right? A ball of 10 cm radius is pressed 4 mm into blocks \
             of 12 x 4 x 12 cm (cells twice as fine where it touches) and into a dome of 4 cm radius whose layer the \
             engine makes; all are of 20 kPa, and the ball is held until everything is at rest. The contact stiffness \
             is {:.0e} N/m^3 everywhere. The reference is the limit of layers of {coarse} and {fine} cells across, \
             extrapolated with order 2.{locking}",
            press::STIFFNESS
        ),
        knob: "one over the cells across".into(),
        stage: STAGES.concat(),
        points,
        expected: Some(Expected {
            order: ORDER,
            is_of_shape: false,
            law: "linear elements: energies, and with them the forces at given displacements, converge with the \
                  square of the cell size"
                .into(),
        }),
        order_reason: "errors scatter about the expected order, because the nodes under the ball differ from mesh to mesh, and a coarse mesh has few there".into(),
        span_reason,
        bound: BOUND,
        ..Curve::default()
    })
}
