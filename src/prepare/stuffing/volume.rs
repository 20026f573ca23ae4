//! Part of isosurface stuffing, which fills a surface with a layer (tetrahedral mesh of a soft body) by means of a
//! lattice of cubic cells: computes the volume inside the surface, which the layer should have.

use glam::DVec3;

use super::sample::{Field, in_parallel};
use crate::prepare::distance::{HALF, Solid};
use crate::prepare::lattice::Lattice;
use crate::prepare::mass;

/// Approximate number of sample points for a surface that is open, or not clean (that has winding numbers other than 0
/// and 1): with this number the relative error of the volume is about two thousandths.
const POINTS: usize = 60_000;

/// Volume inside the surface, m^3, and whether it is the exact volume of a closed surface. For a surface that is open,
/// partly oriented inwards or folded over, it is the volume in which the winding number is above one half; it is
/// estimated from points in the lattice cells near the surface.
pub(super) fn target(
    solid: &Solid,
    lattice: &Lattice,
    field: &Field,
    vertices: &[DVec3],
    triangles: &[[u32; 3]],
) -> (f64, bool) {
    if field.clean && is_closed(triangles) {
        return (mass::properties(vertices, triangles).volume, true);
    }
    let cell = lattice.cell();
    let (mut whole, mut near) = (0usize, Vec::new());
    lattice.each_cell(|c| {
        let value = field.value[2 * lattice.place(c) + 1];
        if value.abs() < cell * 0.75f64.sqrt() {
            near.push((c, 0.0));
        } else if value < 0.0 {
            whole += 1;
        }
    });
    let points = (POINTS as f64 / near.len().max(1) as f64).cbrt().round().clamp(1.0, 6.0) as usize;
    in_parallel(&mut near, 64, |_, cells| {
        for (c, share) in cells {
            let low = lattice.at(c.map(|x| 2 * x as i32));
            let inside = |&k: &usize| {
                let step = [k % points, k / points % points, k / points / points];
                let offset = DVec3::from_array(step.map(|s| (s as f64 + 0.5) / points as f64));
                solid.winding(low + cell * offset) > HALF
            };
            *share = (0..points.pow(3)).filter(inside).count() as f64 / points.pow(3) as f64;
        }
    });
    let cells = whole as f64 + near.iter().map(|n| n.1).sum::<f64>();
    (cells * cell.powi(3), false)
}

/// Whether, along every edge, exactly one triangle runs in each of the two directions.
fn is_closed(triangles: &[[u32; 3]]) -> bool {
    let ends = |t: &[u32; 3]| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])];
    let mut forth: Vec<(u32, u32)> = triangles.iter().flat_map(ends).collect();
    let mut back: Vec<(u32, u32)> = forth.iter().map(|&(a, b)| (b, a)).collect();
    forth.sort_unstable();
    back.sort_unstable();
    forth == back && forth.windows(2).all(|w| w[0] != w[1])
}
