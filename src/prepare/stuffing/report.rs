//! The report on a *layer* (tetrahedral mesh of a soft body) that was made by filling a surface by means of a
//! body-centred cubic lattice (isosurface stuffing): sizes, angles, volumes, and features of the surface that the
//! lattice could not represent. A *cell* is a cube of the lattice; the *filling* is the set of tetrahedra before small
//! parts are removed. Positions and lengths are in the coordinates of the surface.

use serde::{Deserialize, Serialize};

use super::{Filled, parts, total};
use crate::prepare::lattice::Lattice;
use crate::prepare::quality::quality;

/// Greatest number of entries in each list of places in the report; the largest or farthest come first.
const PLACES: usize = 100;

/// A lattice edge across a gap of the solid that the layer fills, or through a piece of the solid that the layer lacks.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SurfaceEdge {
    /// Midpoint of the edge, m.
    pub place: [f64; 3],
    /// Length of the gap, or of the piece of the solid, along the edge, m.
    pub width: f64,
}

/// Lattice edges of one kind: across gaps that are filled, or through pieces of the solid that are missing.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SurfaceEdges {
    /// Number of edges of this kind.
    pub count: usize,
    /// The edges with the widest gaps or pieces, widest first, at most 100.
    pub widest: Vec<SurfaceEdge>,
}

/// Lattice nodes outside the surface that are *taken in*, that is, count as inside, so that thin features are filled.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Thickened {
    /// Number of nodes that are taken in.
    pub nodes: usize,
    /// Positions of the taken nodes that are farthest from the surface, farthest first, m; at most 100.
    pub places: Vec<[f64; 3]>,
}

/// Small parts of the filling that were left out of the layer, because each connected piece of the surface keeps only
/// the largest part that touches it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Dropped {
    /// Number of parts left out.
    pub parts: usize,
    /// Number of tetrahedra in all parts left out.
    pub tetrahedra: usize,
    /// Volume of all parts left out, m^3.
    pub volume: f64,
    /// Position of one node of each of the largest parts left out, largest first, m; at most 100.
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
    /// Volume inside the surface, m^3. If `clean` is false, it is the volume in which the winding number is above one
    /// half.
    pub surface_volume: f64,
    /// Whether the surface is closed and has a winding number of 0 or 1 everywhere.
    pub clean: bool,
    /// Relative difference of the layer's volume from `surface_volume`. The inner volume that a layer of limited
    /// thickness leaves out counts as a part of the layer's volume.
    pub volume_difference: f64,
    /// By how much the surface was shifted outwards before it was filled, so that the layer's volume agrees with the
    /// surface's, m.
    pub shift: f64,
    /// Smallest dihedral angle of all tetrahedra, degrees.
    pub worst_dihedral: f64,
    /// First percentile of the tetrahedra's smallest dihedral angles, degrees.
    pub first_percentile_dihedral: f64,
    /// Largest dihedral angle of all tetrahedra, degrees.
    pub largest_dihedral: f64,
    /// Number of parts of the layer; different parts share no node.
    pub parts: usize,
    /// Small parts of the filling that were left out of the layer.
    pub dropped: Dropped,
    /// Number of lattice edges across a gap whose sides were kept separate.
    pub separated: usize,
    /// Number of nodes that were duplicated because tetrahedra touched there by a corner or an edge only.
    pub doubled: usize,
    /// Lattice edges across a gap that is filled, so that its two sides are connected.
    pub welded: SurfaceEdges,
    /// Lattice nodes outside the surface that count as inside, so that features thinner than a cell stay connected.
    pub thickened: Thickened,
    /// Lattice edges through pieces of the solid that the layer lacks: features thinner than a cell, and sharp edges.
    pub lost: SurfaceEdges,
    /// Wall-clock time of the filling, s. It is not stored in the cache, because a cached report must be the same in
    /// every run.
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
    /// The report on this filling of a surface; `taken`: the nodes outside the surface that were taken in.
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
