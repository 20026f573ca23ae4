//! Fills any surface with a *layer* (tetrahedral mesh of a soft body) by isosurface stuffing (F. Labelle and J.
//! Shewchuk 2007), before the first step. The *solid* is the inside of the surface.
//!
//! The signed distance from the surface, negative inside, is sampled at the nodes of a body-centred cubic lattice
//! (module `sample`). A *cut* is a point where a lattice edge leaves the solid; a node that is too near a cut is
//! *warped*, that is, moved onto the cut (`cut`). A *stencil* fills the inside part of every lattice tetrahedron with
//! tetrahedra (`stencil`, `fill`); deep inside, an octree makes larger tetrahedra (`grade`). All dihedral angles are
//! above 10 degrees for any surface, because the bound depends on the lattice alone.
//!
//! There are three additions to the paper. The surface is drawn at a *level*, a signed distance slightly off zero (the
//! *shift*), so that the layer's volume equals the surface's: with a shift of zero, the layer in a convex surface would
//! be too small, because the layer's flat faces lie inside the surface. A lattice edge that leaves the solid between
//! two inside ends connects nothing, so that *limbs* (parts of the solid with a gap narrower than a cell between them)
//! stay separate. Outside nodes are *taken in*, that is, count as inside, where a feature of the surface is thinner
//! than a lattice cell (`thin`). The report counts and locates gaps that were filled and features that are too thin.

mod cut;
mod fill;
mod grade;
mod parts;
mod report;
mod sample;
mod stencil;
#[cfg(test)]
mod tests;
mod thin;
mod volume;

use std::time::Instant;

use glam::DVec3;

use super::distance::Solid;
use super::lattice::Lattice;
use super::{Layer, layer, mass};
use crate::memory;
pub use report::{Dropped, LayerReport, SurfaceEdge, SurfaceEdges, Thickened};
use stencil::Corner;

/// Greatest number of tetrahedra in a layer; a simulation of so many takes more than a gigabyte of GPU memory.
pub const MAX_TETRAHEDRA: f64 = 4e6;
/// Greatest number of tetrahedra of the whole lattice around the surface, inside or not; the lattice has one node for
/// every six tetrahedra.
const MAX_LATTICE: f64 = 48e6;
/// Least volume of a solid, as a share of the cube of its largest extent along an axis.
const LEAST_VOLUME: f64 = 1e-9;
/// Greatest shift of the level, as a share of the cell edge.
const MAX_SHIFT: f64 = 0.1;
/// A shift is good enough if the layer's volume differs from the surface's by at most this share.
const AGREEMENT: f64 = 1e-3;
/// Greatest number of shifts that are tried; the surface is filled once for each.
const TRIALS: usize = 4;
/// Greatest allowed cell edge deep inside, as a multiple of the cell edge at the surface.
const MAX_GRADE: u32 = 8;

/// Parameters of the layer to be made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Edge length of the lattice's cubic cells, m.
    pub cell: f64,
    /// Greatest cell edge deep inside, as a multiple of `cell`: 1 (all equal), 2, 4 or 8.
    pub grade: u32,
    /// If given, the layer is a shell: only tetrahedra with a node less than this deep below the surface (m) are kept.
    /// `None`: the layer fills the whole solid.
    pub thickness: Option<f64>,
}

impl Options {
    /// Options of a layer that fills the whole solid, with one cell size (edge length, m) everywhere.
    pub fn uniform(cell: f64) -> Self {
        Options { cell, grade: 1, thickness: None }
    }
}

/// Fills a surface (vertices in m, triangles counter-clockwise seen from outside) with tetrahedra; no node is attached
/// to a rigid core.
///
/// The surface may be open, folded over or partly oriented inwards: a point is inside if its winding number is above
/// one half. Errors, each with its remedy: a surface smaller than a cell, more than [`MAX_TETRAHEDRA`] tetrahedra,
/// nothing inside, a coordinate that is not finite.
pub fn stuff(vertices: &[DVec3], triangles: &[[u32; 3]], options: &Options) -> Result<(Layer, LayerReport), String> {
    let start = Instant::now();
    let low = vertices.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let high = vertices.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    check(vertices, triangles, high - low, options)?;
    let solid = Solid::new(vertices, triangles)?;
    let cell = options.cell;
    let lattice = Lattice::around(low, high - low, cell);
    let reach = (1.2 * cell).max(options.thickness.unwrap_or(0.0));
    let field = sample::field(&solid, &lattice, (low, high), reach);
    let edges = sample::edges(&solid, &lattice, &field.value);
    let octants = grade::Octants::new(&solid, &lattice, &field, options.grade);
    let (surface_volume, clean) = volume::target(&solid, &lattice, &field, vertices, triangles);
    // The condition refuses a NaN too.
    if surface_volume.is_nan() || surface_volume <= LEAST_VOLUME * (high - low).max_element().powi(3) {
        return Err("the surface encloses nothing: it is turned inside out, flat, or too open; flip or close it".into());
    }
    let area: f64 = triangles.iter().map(|t| triangle_area(t.map(|i| vertices[i as usize]))).sum();
    let plain = cut::cut(&solid, &lattice, &field, &edges, 0.0, &[]);
    let taken = thin::taken_in(&solid, (vertices, triangles), &lattice, &field, &plain);
    let surface = Surface { vertices, triangles, solid, lattice, field, edges, taken, octants, options };
    let filled = surface.fill_to(surface_volume, area);
    if filled.layer.tetrahedra.len() as f64 > MAX_TETRAHEDRA {
        return Err(format!(
            "a cell of {cell:.3e}, in the surface's unit, gives {} tetrahedra, more than 4 million; choose a larger cell",
            filled.layer.tetrahedra.len()
        ));
    }
    let seconds = start.elapsed().as_secs_f64();
    let report = filled.report(surface_volume, clean, &surface.lattice, &surface.taken, seconds)?;
    Ok((filled.layer, report))
}

fn triangle_area([a, b, c]: [DVec3; 3]) -> f64 {
    (b - a).cross(c - a).length() / 2.0
}

/// Refuses a grade that is not possible, and cells that are too large or too small for the surface.
fn check(vertices: &[DVec3], triangles: &[[u32; 3]], extent: DVec3, options: &Options) -> Result<(), String> {
    let cell = options.cell;
    if !options.grade.is_power_of_two() || options.grade > MAX_GRADE {
        return Err(format!("a grade of {} is not possible; give 1, 2, 4 or 8 times the cell", options.grade));
    }
    if extent.max_element().is_nan() || extent.max_element() < cell {
        return Err(format!(
            "the surface is {:.3e} across, smaller than one cell of {cell:.3e}; choose a smaller cell, in the surface's unit",
            extent.max_element()
        ));
    }
    let volume = mass::properties(vertices, triangles).volume;
    let box_cells = (extent / cell + 4.0).to_array().iter().product::<f64>();
    let whole = options.grade == 1 && options.thickness.is_none();
    if (whole && 12.0 * volume / cell.powi(3) > MAX_TETRAHEDRA) || 12.0 * box_cells > MAX_LATTICE {
        let least = (12.0 * volume / MAX_TETRAHEDRA).cbrt().max(cell * (12.0 * box_cells / MAX_LATTICE).cbrt());
        return Err(format!(
            "a cell of {cell:.3e} would give more than 4 million tetrahedra in a surface that is {:.3e} across; choose one \
             above {:.1e}, in the surface's unit",
            extent.max_element(),
            1.1 * least
        ));
    }
    memory::ask(memory::BYTES_PER_CELL * box_cells)
        .map_err(|problem| format!("{problem}; choose a larger cell, or free memory"))
}

/// The surface with its lattice, samples and options: everything that does not change with the level.
struct Surface<'a> {
    vertices: &'a [DVec3],
    triangles: &'a [[u32; 3]],
    solid: Solid,
    lattice: Lattice,
    field: sample::Field,
    edges: Vec<sample::Edge>,
    taken: Vec<u32>,
    octants: grade::Octants,
    options: &'a Options,
}

/// The result of one filling at a certain shift of the level.
struct Filled {
    layer: Layer,
    shift: f64,
    /// Volume of the layer, together with the inner volume that a shell leaves out, m^3.
    volume: f64,
    parts: usize,
    dropped: Vec<parts::Dropped>,
    doubled: usize,
    separated: usize,
    welded: Vec<([u32; 2], f64)>,
    lost: Vec<([u32; 2], f64)>,
}

impl Surface<'_> {
    /// The filling whose volume is nearest to `volume` (m^3), found by the secant method from shift 0. `area` is the
    /// surface's area (m^2). Shifts greater than [`MAX_SHIFT`] times the cell edge are not tried.
    fn fill_to(&self, volume: f64, area: f64) -> Filled {
        let most = MAX_SHIFT * self.options.cell;
        let mut best = self.fill(0.0);
        let (mut rate, mut last) = (area, (0.0, best.volume));
        for _ in 1..TRIALS {
            let shift = last.0 + (volume - last.1) / rate;
            if (best.volume - volume).abs() <= AGREEMENT * volume || shift.is_nan() || shift.abs() > most {
                break;
            }
            let next = self.fill(shift);
            if next.volume != last.1 && shift != last.0 {
                rate = ((next.volume - last.1) / (shift - last.0)).max(0.1 * area);
            }
            last = (shift, next.volume);
            if (next.volume - volume).abs() < (best.volume - volume).abs() {
                best = next;
            }
        }
        best
    }

    fn fill(&self, shift: f64) -> Filled {
        let cuts = cut::cut(&self.solid, &self.lattice, &self.field, &self.edges, shift, &self.taken);
        let mut filling = fill::fill(&self.lattice, &self.octants, &cuts);
        let mut core = 0.0;
        if let Some(thickness) = self.options.thickness {
            let deep = |corner: Corner| match corner {
                Corner::Node(n) => self.field.value[n as usize] <= -thickness,
                Corner::Cut(..) => false,
            };
            let deep: Vec<bool> = filling.corners.iter().map(|&c| deep(c)).collect();
            let all: f64 = total(&filling.nodes, &filling.tetrahedra);
            filling.tetrahedra.retain(|t| !t.iter().all(|&n| deep[n as usize]));
            core = all - total(&filling.nodes, &filling.tetrahedra);
            parts::compact(&mut filling);
        }
        let doubled = parts::split(&self.solid, &cuts, &mut filling);
        let (parts, dropped) = parts::drop_bits(&self.solid, (self.vertices, self.triangles), &cuts, &mut filling);
        let volume = core + total(&filling.nodes, &filling.tetrahedra);
        let bound = vec![false; filling.nodes.len()];
        let layer = Layer { nodes: filling.nodes, tetrahedra: filling.tetrahedra, attached: bound, ..Layer::default() };
        Filled {
            layer,
            shift,
            volume,
            parts,
            dropped,
            doubled,
            separated: cuts.apart.len(),
            welded: cuts.welded,
            lost: cuts.lost,
        }
    }
}

/// Volume of all tetrahedra, m^3.
fn total(nodes: &[DVec3], tetrahedra: &[[u32; 4]]) -> f64 {
    tetrahedra.iter().map(|t| layer::volume6(nodes, t) / 6.0).sum()
}
