//! Layers out: the tetrahedra of a soft body at the end of a run, for ParaView and its like.

use std::io::Write;

use glam::DVec3;

/// VTK's cell type of a four-node tetrahedron.
const TETRAHEDRON: u32 = 10;

/// Writes a layer as a legacy VTK ASCII unstructured grid.
///
/// `nodes` are deformed world positions (m) in input order, `displacement` the way each went from rest as placed
/// (world axes, m), one a node; both with nine significant digits.
pub fn write_layer(
    w: &mut impl Write,
    nodes: &[DVec3],
    tetrahedra: &[[u32; 4]],
    displacement: &[DVec3],
) -> std::io::Result<()> {
    writeln!(w, "# vtk DataFile Version 3.0\npalpate layer\nASCII\nDATASET UNSTRUCTURED_GRID")?;
    writeln!(w, "POINTS {} double", nodes.len())?;
    write_vectors(w, nodes)?;
    writeln!(w, "CELLS {} {}", tetrahedra.len(), 5 * tetrahedra.len())?;
    for [a, b, c, d] in tetrahedra {
        writeln!(w, "4 {a} {b} {c} {d}")?;
    }
    writeln!(w, "CELL_TYPES {}", tetrahedra.len())?;
    for _ in tetrahedra {
        writeln!(w, "{TETRAHEDRON}")?;
    }
    writeln!(w, "POINT_DATA {}\nVECTORS displacement double", displacement.len())?;
    write_vectors(w, displacement)
}

fn write_vectors(w: &mut impl Write, vectors: &[DVec3]) -> std::io::Result<()> {
    vectors.iter().try_for_each(|v| writeln!(w, "{:.8e} {:.8e} {:.8e}", v.x, v.y, v.z))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tetrahedron_in_full() {
        let nodes = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::new(0.0, 0.0, 1.0 / 3.0)];
        let mut bytes = Vec::new();
        write_layer(&mut bytes, &nodes, &[[0, 1, 2, 3]], &[DVec3::new(1.25e-7, 0.0, -2.0); 4]).unwrap();
        let text = String::from_utf8(bytes).unwrap();
        let zero = "0.00000000e0";
        let moved = format!("1.25000000e-7 {zero} -2.00000000e0\n").repeat(4);
        let expected = format!(
            "# vtk DataFile Version 3.0\npalpate layer\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 double\n\
             {zero} {zero} {zero}\n1.00000000e0 {zero} {zero}\n{zero} 1.00000000e0 {zero}\n{zero} {zero} 3.33333333e-1\n\
             CELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n10\nPOINT_DATA 4\nVECTORS displacement double\n{moved}"
        );
        assert_eq!(text, expected);
    }
}
