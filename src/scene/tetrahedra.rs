//! Reads tetrahedral meshes of all formats, and does the last step of each reader: node ids become indices, tetrahedra
//! get positive volume, and invalid meshes are refused.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use glam::DVec3;

use super::cursor::Cursor;
use super::groups::Groups;
use super::{gmsh, tetgen, vtk};
use crate::{Error, Result};

/// Extensions of the files that [`read`] can read.
pub const EXTENSIONS: [&str; 4] = ["msh", "node", "ele", "vtk"];

/// Ratio of the volume to the cube of the longest edge below which a tetrahedron counts as flat. Even well above this
/// ratio its rest gradients are meaningless in single precision. Slivers above it are kept, since the implicit step
/// tolerates them.
const FLATTEST: f64 = 1e-12;
/// Dihedral angle below which a tetrahedron is reported as a sliver, degrees.
const SLIVER: f64 = 5.0;

/// A tetrahedral mesh with the data of a file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TetMesh {
    /// All nodes, used or not, in file order and in the coordinates of the file.
    pub nodes: Vec<DVec3>,
    /// Zero-based nodes of each tetrahedron, ordered so that its volume is positive.
    pub tetrahedra: Vec<[u32; 4]>,
    /// Which group of the file each tetrahedron is in.
    pub groups: Groups,
    /// Parts of the file that were left out or changed, one sentence for each.
    pub notes: Vec<String>,
}

/// The files that [`read`] reads for this path: the file itself, or both files of a TetGen pair.
pub fn files(path: &Path) -> Vec<PathBuf> {
    match path.extension().map(|e| e.to_string_lossy().to_lowercase()).as_deref() {
        Some("node" | "ele") => ["node", "ele"].map(|extension| path.with_extension(extension)).to_vec(),
        _ => vec![path.to_path_buf()],
    }
}

/// Reads a mesh by its extension: Gmsh `.msh`, TetGen `.node` and `.ele` (either of them reads both), legacy VTK
/// `.vtk`.
///
/// It refuses flat or repeated tetrahedra, nodes that do not exist, numbers that are not finite, and files that end
/// early; the error names the element, and the line or byte.
pub fn read(path: &Path) -> Result<TetMesh> {
    match path.extension().map(|e| e.to_string_lossy().to_lowercase()).as_deref() {
        Some("msh") => gmsh::read(path),
        Some("node" | "ele") => tetgen::read(path),
        Some("vtk") => vtk::read(path),
        _ => {
            let remedy = format!("give .{}", EXTENSIONS.join(", ."));
            Err(Error::input(path, None, "has no extension of a supported tetrahedral mesh", remedy))
        }
    }
}

/// The contents of a file, with node ids that are not yet converted to indices.
#[derive(Default)]
pub(super) struct Contents {
    pub nodes: Vec<DVec3>,
    /// Index of each node, by its id.
    pub index: HashMap<u64, u32>,
    pub elements: Vec<Element>,
    /// Numbers of elements that are not four-node tetrahedra, by type.
    pub skipped: BTreeMap<String, usize>,
    /// Names of groups, by number.
    pub groups: BTreeMap<i64, String>,
    /// Other notes about the file, one sentence each.
    pub notes: Vec<String>,
}

/// A tetrahedron, with the ids that the file gives.
pub(super) struct Element {
    pub id: u64,
    /// Position in the file, bytes.
    pub mark: usize,
    pub nodes: [u64; 4],
    pub group: Option<i64>,
}

impl Contents {
    /// Adds the node that was read last.
    pub(super) fn add_node(&mut self, cursor: &Cursor, id: u64, point: DVec3) -> Result<()> {
        if self.index.insert(id, self.nodes.len() as u32).is_some() {
            return Err(cursor.error(format!("node {id} is given twice")));
        }
        self.nodes.push(point);
        Ok(())
    }

    /// Counts an element that is left out; `what` is its type.
    pub(super) fn skip(&mut self, what: &str) {
        *self.skipped.entry(what.into()).or_default() += 1;
    }
}

pub(super) fn settle(file: Contents, cursor: &Cursor) -> Result<TetMesh> {
    if file.nodes.is_empty() {
        return Err(cursor.error_of_file("has no nodes", "export the mesh with its nodes"));
    }
    if file.elements.is_empty() {
        let remedy = if file.skipped.keys().any(|what| what.contains("tetrahedra")) {
            "its second-order tetrahedra are not supported: export first-order ones"
        } else {
            "export the volume mesh, not its surface alone"
        };
        return Err(cursor.error_of_file("has no tetrahedra of four nodes", remedy));
    }
    let mut seen: HashMap<[u32; 4], u64> = HashMap::with_capacity(file.elements.len());
    let mut tetrahedra = Vec::with_capacity(file.elements.len());
    let mut turned = 0;
    for element in &file.elements {
        let refuse = |problem: String, remedy: &str| {
            cursor.error_at(element.mark, format!("tetrahedron {} {problem}", element.id), remedy)
        };
        let mut nodes = [0; 4];
        for (node, id) in nodes.iter_mut().zip(element.nodes) {
            let place = file.index.get(&id);
            *node = *place.ok_or_else(|| refuse(format!("names node {id}, which does not exist"), "export again"))?;
        }
        let volume = volume(&file.nodes, nodes);
        if volume.abs() <= FLATTEST * longest_edge(&file.nodes, nodes).powi(3) {
            return Err(refuse("has no volume".into(), "remove it, or mesh again with better quality"));
        }
        if volume < 0.0 {
            nodes.swap(2, 3);
            turned += 1;
        }
        let mut key = nodes;
        key.sort_unstable();
        if let Some(first) = seen.insert(key, element.id) {
            return Err(refuse(format!("repeats tetrahedron {first}"), "remove the copy"));
        }
        tetrahedra.push(nodes);
    }
    let notes = notes(&file, turned, &tetrahedra);
    let groups = Groups { of: file.elements.iter().map(|element| element.group).collect(), names: file.groups };
    Ok(TetMesh { nodes: file.nodes, tetrahedra, groups, notes })
}

fn notes(file: &Contents, turned: usize, tetrahedra: &[[u32; 4]]) -> Vec<String> {
    let mut notes = file.notes.clone();
    if !file.skipped.is_empty() {
        let kinds: Vec<String> = file.skipped.iter().map(|(what, count)| format!("{count} {what}")).collect();
        notes.push(format!("elements that are not four-node tetrahedra were left out: {}", kinds.join(", ")));
    }
    // A file in which all tetrahedra have negative volume follows another convention (TetGen's) and is valid.
    if turned > 0 && turned < file.elements.len() {
        notes.push(format!("{turned} tetrahedra had negative volume, and their nodes were reordered"));
    }
    let angles: Vec<f64> = tetrahedra.iter().map(|&t| least_dihedral(&file.nodes, t)).collect();
    let slivers = angles.iter().filter(|&&angle| angle < SLIVER).count();
    let worst = file.elements.iter().zip(&angles).min_by(|a, b| a.1.total_cmp(b.1));
    if let Some((element, angle)) = worst.filter(|_| slivers > 0) {
        notes.push(format!(
            "{slivers} tetrahedra have a dihedral angle under {SLIVER} degrees, kept; the worst is {} with {angle:.1e}",
            element.id
        ));
    }
    notes
}

/// The least dihedral angle of a tetrahedron of positive volume, degrees.
fn least_dihedral(nodes: &[DVec3], tetrahedron: [u32; 4]) -> f64 {
    let [a, b, c, d] = tetrahedron.map(|node| nodes[node as usize]);
    // Outward normals of the faces; their length is twice the area.
    let normals = [(b, d, c), (a, c, d), (a, d, b), (a, b, c)].map(|(p, q, r)| (r - p).cross(q - p));
    let angle = |i: usize, j: usize| normals[i].cross(normals[j]).length().atan2(-normals[i].dot(normals[j]));
    let pairs = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)];
    pairs.iter().map(|&(i, j)| angle(i, j)).fold(f64::INFINITY, f64::min).to_degrees()
}

fn volume(nodes: &[DVec3], tetrahedron: [u32; 4]) -> f64 {
    let [a, b, c, d] = tetrahedron.map(|node| nodes[node as usize]);
    (b - a).cross(c - a).dot(d - a) / 6.0
}

fn longest_edge(nodes: &[DVec3], tetrahedron: [u32; 4]) -> f64 {
    let points = tetrahedron.map(|node| nodes[node as usize]);
    points.iter().flat_map(|a| points.iter().map(|b| a.distance(*b))).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dihedral_angles_of_known_tetrahedra() {
        let corner = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
        // The dihedral angle between the slanted face and each other face has the cosine 1 / sqrt(3).
        assert!((least_dihedral(&corner, [0, 1, 2, 3]) - (1.0 / 3f64.sqrt()).acos().to_degrees()).abs() < 1e-12);
        let regular = [(1.0, 1.0, 1.0), (1.0, -1.0, -1.0), (-1.0, 1.0, -1.0), (-1.0, -1.0, 1.0)];
        let regular = regular.map(|(x, y, z)| DVec3::new(x, y, z));
        for t in [[0, 1, 2, 3], [0, 1, 3, 2]] {
            assert!((least_dihedral(&regular, t) - (1.0_f64 / 3.0).acos().to_degrees()).abs() < 1e-12);
        }
        let mut flat = corner;
        flat[3] = DVec3::new(0.3, 0.3, 1e-3);
        assert!(least_dihedral(&flat, [0, 1, 2, 3]) < 0.3);
    }
}
