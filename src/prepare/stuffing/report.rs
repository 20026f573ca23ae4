//! What stuffing reports: sizes, shapes, volumes, and everything that the lattice could not follow.

use serde::{Deserialize, Serialize};

use super::{Filled, parts, total};
use crate::prepare::lattice::Lattice;
use crate::prepare::quality::quality;

/// Places listed in a report at most, worst first.
const PLACES: usize = 100;

/// A lattice edge that the solid crosses in a way the layer cannot follow.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Crossing {
    /// Middle of the edge, m.
    pub place: [f64; 3],
    /// Length of the gap, or of the material, on the edge, m.
    pub width: f64,
}

/// Crossings of one kind.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Crossings {
    /// How many lattice edges.
    pub count: usize,
    /// The widest, widest first.
    pub widest: Vec<Crossing>,
}

/// Nodes taken in.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Thickened {
    /// How many.
    pub nodes: usize,
    /// The farthest from the surface, farthest first, m.
    pub places: Vec<[f64; 3]>,
}

/// Loose bits of the filling, left out of the layer: parts that are not the largest of any connected surface they touch.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Dropped {
    /// How many.
    pub parts: usize,
    /// Their tetrahedra.
    pub tetrahedra: usize,
    /// Their volume, m^3.
    pub volume: f64,
    /// A node of each of the largest, largest first, m.
    pub places: Vec<[f64; 3]>,
}

/// What was made, and what was not.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LayerReport {
    /// Nodes.
    pub nodes: usize,
    /// Tetrahedra.
    pub tetrahedra: usize,
    /// Volume of the layer, m^3.
    pub volume: f64,
    /// Volume inside the surface, m^3; where it is not closed and clean, by winding numbers.
    pub surface_volume: f64,
    /// Whether the surface is closed and winds once around its inside.
    pub clean: bool,
    /// Volume of the layer, with the inside that a shell leaves out, over that of the surface, less one.
    pub volume_difference: f64,
    /// Outward shift of the surface that made the volumes agree, m.
    pub shift: f64,
    /// Smallest dihedral angle, degrees.
    pub worst_dihedral: f64,
    /// Smallest dihedral angle that 99 in 100 tetrahedra exceed, degrees.
    pub first_percentile_dihedral: f64,
    /// Largest dihedral angle, degrees.
    pub largest_dihedral: f64,
    /// Parts of the layer that share no node.
    pub parts: usize,
    /// Bits left out.
    pub dropped: Dropped,
    /// Lattice edges across a gap whose sides were kept apart.
    pub separated: usize,
    /// Nodes doubled where limbs only touched.
    pub doubled: usize,
    /// Lattice edges across a gap that is filled: both sides hang together within a cell.
    pub welded: Crossings,
    /// Lattice nodes outside the surface that were taken in, so that features thinner than a cell hang together.
    pub thickened: Thickened,
    /// Lattice edges through material that the layer lacks: features thinner than a cell, and sharp edges.
    pub lost: Crossings,
    /// Wall-clock seconds; left out where the report is kept, which is to be the same every time.
    #[serde(skip)]
    pub seconds: f64,
}

/// The report's view of some crossed lattice edges.
fn crossings(mut edges: Vec<([u32; 2], f64)>, lattice: &Lattice) -> Crossings {
    edges.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    let place = |nodes: [u32; 2]| (lattice.position(nodes[0]) + lattice.position(nodes[1])) / 2.0;
    let crossing = |&(nodes, width): &([u32; 2], f64)| Crossing { place: place(nodes).to_array(), width };
    Crossings { count: edges.len(), widest: edges.iter().take(PLACES).map(crossing).collect() }
}

impl Filled {
    /// The report on this filling of a surface, with the nodes that were taken in.
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
            welded: crossings(self.welded.clone(), lattice),
            thickened: Thickened {
                nodes: taken.len(),
                places: taken.iter().take(PLACES).map(|&n| lattice.position(n).to_array()).collect(),
            },
            lost: crossings(self.lost.clone(), lattice),
            seconds,
        })
    }
}
