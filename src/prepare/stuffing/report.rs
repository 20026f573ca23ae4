//! The report on a layer (tetrahedral mesh) that was made by filling a surface: sizes, angles, volumes, and features of
//! the surface that the background lattice could not represent. Positions and lengths are in the coordinates of the
//! surface.

use serde::{Deserialize, Serialize};

use super::{Filled, parts, total};
use crate::prepare::lattice::Lattice;
use crate::prepare::quality::quality;

/// Greatest number of places listed in a report; the worst come first.
const PLACES: usize = 100;

/// A lattice edge across a gap that the layer fills, or through a piece of material that it lacks.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SurfaceEdge {
    /// Midpoint of the edge, m.
    pub place: [f64; 3],
    /// Length of the gap, or of the material, along the edge, m.
    pub width: f64,
}

/// Lattice edges of one kind: across filled gaps, or through missing material.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SurfaceEdges {
    /// Number of such edges.
    pub count: usize,
    /// The edges with the widest gap or material, widest first.
    pub widest: Vec<SurfaceEdge>,
}

/// Lattice nodes outside the surface that count as inside (are *taken in*) for the sake of thin features.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Thickened {
    /// Number of such nodes.
    pub nodes: usize,
    /// Positions of those farthest from the surface, farthest first, m.
    pub places: Vec<[f64; 3]>,
}

/// Small parts of the filling that were left out of the layer, because each connected piece of the surface keeps only
/// the largest part that touches it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Dropped {
    /// Number of parts left out.
    pub parts: usize,
    /// Number of their tetrahedra.
    pub tetrahedra: usize,
    /// Their volume, m^3.
    pub volume: f64,
    /// One node of each of the largest parts, largest first, m.
    pub places: Vec<[f64; 3]>,
}

/// The report on a layer that was made by filling a surface.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LayerReport {
    /// Number of nodes.
    pub nodes: usize,
    /// Number of tetrahedra.
    pub tetrahedra: usize,
    /// Volume of the layer, m^3.
    pub volume: f64,
    /// Volume inside the surface, m^3; if the surface is not closed or not clean, that of the points with a winding
    /// number above one half.
    pub surface_volume: f64,
    /// Whether the surface is closed and has a winding number of 0 or 1 everywhere.
    pub clean: bool,
    /// Volume of the layer, including the inside that a shell leaves out, over that of the surface, less one.
    pub volume_difference: f64,
    /// Outward shift of the surface that makes the layer's volume agree with the surface's, m.
    pub shift: f64,
    /// Smallest dihedral angle, degrees.
    pub worst_dihedral: f64,
    /// Smallest dihedral angle that 99 in 100 tetrahedra exceed, degrees.
    pub first_percentile_dihedral: f64,
    /// Largest dihedral angle, degrees.
    pub largest_dihedral: f64,
    /// Number of parts of the layer that share no node.
    pub parts: usize,
    /// Small parts left out of the layer.
    pub dropped: Dropped,
    /// Number of lattice edges across a gap whose sides were kept separate.
    pub separated: usize,
    /// Number of nodes that were duplicated because tetrahedra touched there by a corner or an edge only.
    pub doubled: usize,
    /// Lattice edges across a gap that is filled: both sides are connected within a cell.
    pub welded: SurfaceEdges,
    /// Lattice nodes outside the surface that count as inside, so that features thinner than a cell stay connected.
    pub thickened: Thickened,
    /// Lattice edges through material that the layer lacks: features thinner than a cell, and sharp edges.
    pub lost: SurfaceEdges,
    /// Wall-clock time, s; it is not stored with a cached report, which must be the same in every run.
    #[serde(skip)]
    pub seconds: f64,
}

/// The report's entry for lattice edges of one kind, given by their nodes and widths (m).
fn surface_edges(mut edges: Vec<([u32; 2], f64)>, lattice: &Lattice) -> SurfaceEdges {
    edges.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    let place = |nodes: [u32; 2]| (lattice.position(nodes[0]) + lattice.position(nodes[1])) / 2.0;
    let surface_edge = |&(nodes, width): &([u32; 2], f64)| SurfaceEdge { place: place(nodes).to_array(), width };
    SurfaceEdges { count: edges.len(), widest: edges.iter().take(PLACES).map(surface_edge).collect() }
}

impl Filled {
    /// The report on this filling of a surface; `taken` are the nodes that were taken in.
    pub(super) fn report(
        &self,
        surface_volume: f64,
        clean: bool,
        lattice: &Lattice,
        taken: &[u32],
        seconds: f64,
    ) -> Result<LayerReport, String> {
        let angles = quality(&self.layer).ok_or("the layer has no tetrahedra")?;
        let mut bits: Vec<&parts::Dropped> = self.dropped.iter().collect();
        bits.sort_by(|a, b| b.volume.total_cmp(&a.volume));
        Ok(LayerReport {
            nodes: self.layer.nodes.len(),
            tetrahedra: self.layer.tetrahedra.len(),
            volume: total(&self.layer.nodes, &self.layer.tetrahedra),
            surface_volume,
            clean,
            volume_difference: self.volume / surface_volume - 1.0,
            shift: self.shift,
            worst_dihedral: angles.worst,
            first_percentile_dihedral: angles.first_percentile,
            largest_dihedral: angles.largest,
            parts: self.parts,
            dropped: Dropped {
                parts: bits.len(),
                tetrahedra: bits.iter().map(|b| b.tetrahedra).sum(),
                volume: bits.iter().map(|b| b.volume).sum(),
                places: bits.iter().take(PLACES).map(|b| b.place.to_array()).collect(),
            },
            separated: self.separated,
            doubled: self.doubled,
            welded: surface_edges(self.welded.clone(), lattice),
            thickened: Thickened {
                nodes: taken.len(),
                places: taken.iter().take(PLACES).map(|&n| lattice.position(n).to_array()).collect(),
            },
            lost: surface_edges(self.lost.clone(), lattice),
            seconds,
        })
    }
}
