//! Layers out as Gmsh 2.2 ASCII, which [`super::gmsh`] reads back to the same bits.

use std::io::Write;

use glam::DVec3;

/// Gmsh's element type of a four-node tetrahedron.
const TETRAHEDRON: u32 = 4;

/// Writes nodes (m) and tetrahedra; every coordinate as the shortest number that reads back the same.
pub fn write(w: &mut impl Write, nodes: &[DVec3], tetrahedra: &[[u32; 4]]) -> std::io::Result<()> {
    writeln!(w, "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{}", nodes.len())?;
    for (i, n) in nodes.iter().enumerate() {
        writeln!(w, "{} {:e} {:e} {:e}", i + 1, n.x, n.y, n.z)?;
    }
    writeln!(w, "$EndNodes\n$Elements\n{}", tetrahedra.len())?;
    for (i, t) in tetrahedra.iter().enumerate() {
        let [a, b, c, d] = t.map(|n| n + 1);
        writeln!(w, "{} {TETRAHEDRON} 2 0 0 {a} {b} {c} {d}", i + 1)?;
    }
    writeln!(w, "$EndElements")
}

#[cfg(test)]
mod tests {
    use super::super::gmsh;
    use super::*;

    #[test]
    fn what_is_written_comes_back_bit_for_bit() {
        let nodes = [DVec3::new(0.1, -2.0 / 3.0, 1e-9), DVec3::X * 3.0, DVec3::Y, DVec3::Z, DVec3::new(0.7, 0.8, 9.0)];
        let tetrahedra = [[0, 1, 2, 3], [1, 2, 3, 4]];
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("layer.msh");
        let mut bytes = Vec::new();
        write(&mut bytes, &nodes, &tetrahedra).unwrap();
        std::fs::write(&path, bytes).unwrap();
        let back = gmsh::read(&path).unwrap();
        assert_eq!(back.nodes, nodes);
        assert!(back.tetrahedra == tetrahedra, "{:?}", back.tetrahedra);
    }
}
