//! Reads tetrahedral meshes of every supported format (Gmsh, TetGen, VTK), and does the last step of each
//! reader: node ids become indices, tetrahedra get positive volume, and invalid meshes are refused. A group is a set of
//! tetrahedra that a file marks with a number; a scene can give each group a material of its own.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};

use glam::DVec3;

use super::cursor::Cursor;
use super::groups::{Groups, NodeGroup};
use super::{gmsh, tetgen, vtk, vtk_xml};
use crate::files::extension;
use crate::{Error, Result};

/// Extensions of the files that [`read`] can read.
pub const EXTENSIONS: [&str; 5] = ["msh", "node", "ele", "vtu", "vtk"];

/// A tetrahedron counts as flat, and is refused, if its volume is at most this fraction of the cube of its longest
/// edge. Even well above this fraction, the gradients of its shape functions at rest are mostly rounding error in
/// single precision. Such slivers (thin tetrahedra) are kept all the same, since the implicit time step tolerates them.
const FLATTEST: f64 = 1e-12;
/// Number of dimensions of a tetrahedron.
pub(super) const VOLUME: usize = 3;
/// Dihedral angle below which a tetrahedron is reported as a sliver, degrees.
const SLIVER: f64 = 5.0;

/// A tetrahedral mesh, with the groups and the notes that its reader made.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TetMesh {
    /// All nodes, used or not by a tetrahedron, in file order and in the coordinates of the file.
    pub nodes: Vec<DVec3>,
    /// Zero-based node indices of each tetrahedron, in an order that makes its volume positive.
    pub tetrahedra: Vec<[u32; 4]>,
    /// The group that each tetrahedron is in.
    pub groups: Groups,
    /// Notes on parts of the file that were left out or changed, or that are of poor quality; one sentence for each.
    pub notes: Vec<String>,
}

/// Returns the files that [`read`] reads for `path`: the file itself, or both files of a TetGen pair.
pub fn files(path: &Path) -> Vec<PathBuf> {
    match extension(path).as_str() {
        "node" | "ele" => ["node", "ele"].map(|extension| path.with_extension(extension)).to_vec(),
        _ => vec![path.to_path_buf()],
    }
}

/// Reads a mesh in the format that its extension names: Gmsh `.msh`, TetGen `.node` and `.ele` (either name reads both
/// files), VTK `.vtu` and legacy `.vtk`.
///
/// The function refuses flat or repeated tetrahedra, nodes that do not exist, numbers that are not finite, and files
/// that end early. The error names the line (of a text file) or the byte (of a binary file).
pub fn read(path: &Path) -> Result<TetMesh> {
    match extension(path).as_str() {
        "msh" => gmsh::read(path),
        "node" | "ele" => tetgen::read(path),
        "vtu" => vtk_xml::read(path),
        "vtk" => vtk::read(path),
        _ => {
            let remedy = format!("give .{}", EXTENSIONS.join(", ."));
            Err(Error::input(path, None, "has no extension of a supported tetrahedral mesh", remedy))
        }
    }
}

/// What the reader of a format has collected from a file; node ids are not yet converted to indices.
#[derive(Default)]
pub(super) struct Contents {
    pub nodes: Vec<DVec3>,
    /// Index of each node in `nodes`, by the node's id.
    pub index: HashMap<u64, u32>,
    pub elements: Vec<Element>,
    /// How many elements of each type were left out, by the name of the type; four-node tetrahedra are never left out.
    pub skipped: BTreeMap<String, usize>,
    /// Names of the groups of tetrahedra, by the number of the group.
    pub groups: BTreeMap<i64, String>,
    /// Ids of the nodes of other elements, by the number of dimensions of the elements and the number of their group.
    pub grouped_nodes: BTreeMap<(usize, i64), BTreeSet<u64>>,
    /// Names of the groups of other elements, likewise.
    pub other_groups: BTreeMap<(usize, i64), String>,
    /// Notes of the reader about the file, one sentence each.
    pub notes: Vec<String>,
}

/// A tetrahedron, with the ids that the file gives to it and to its nodes.
pub(super) struct Element {
    pub id: u64,
    /// Position of the tetrahedron in the file, bytes, to which errors refer.
    pub mark: usize,
    pub nodes: [u64; 4],
    pub group: Option<i64>,
}

impl Contents {
    /// Adds a node at `point` with the given id, which must be new; an error refers to what `cursor` read last.
    pub(super) fn add_node(&mut self, cursor: &Cursor, id: u64, point: DVec3) -> Result<()> {
        if self.index.insert(id, self.nodes.len() as u32).is_some() {
            return Err(cursor.error(format!("node {id} is given twice")));
        }
        self.nodes.push(point);
        Ok(())
    }

    /// Counts an element that is left out; `what` is the name of its type.
    pub(super) fn skip(&mut self, what: &str) {
        *self.skipped.entry(what.into()).or_default() += 1;
    }
}

/// Does the last step of every reader: checks the contents of a file and converts them to a mesh.
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
    let mut notes = notes(&file, turned, &tetrahedra);
    let absent = file.grouped_nodes.values().flatten().filter(|id| !file.index.contains_key(id)).count();
    if absent > 0 {
        notes.push(format!("{absent} nodes of points, lines and faces in groups do not exist, and were left out"));
    }
    let of_nodes = node_groups(&file);
    let of = file.elements.iter().map(|element| element.group).collect();
    let groups = Groups { of, names: file.groups, of_nodes };
    Ok(TetMesh { nodes: file.nodes, tetrahedra, groups, notes })
}

/// The groups of nodes: first those of points, lines and faces, then those of tetrahedra. Nodes that the file does not have
/// are left out.
fn node_groups(file: &Contents) -> Vec<NodeGroup> {
    let mut all: BTreeMap<(usize, i64), BTreeSet<u64>> = file.grouped_nodes.clone();
    for element in &file.elements {
        if let Some(group) = element.group {
            all.entry((VOLUME, group)).or_default().extend(element.nodes);
        }
    }
    let group = |((dimension, number), ids): ((usize, i64), BTreeSet<u64>)| {
        let mut nodes: Vec<u32> = ids.iter().filter_map(|id| file.index.get(id).copied()).collect();
        nodes.sort_unstable();
        let named =
            if dimension == VOLUME { file.groups.get(&number) } else { file.other_groups.get(&(dimension, number)) };
        NodeGroup { dimension, number, name: named.cloned(), nodes }
    };
    all.into_iter().map(group).collect()
}

fn notes(file: &Contents, turned: usize, tetrahedra: &[[u32; 4]]) -> Vec<String> {
    let mut notes = file.notes.clone();
    if !file.skipped.is_empty() {
        let kinds: Vec<String> = file.skipped.iter().map(|(what, count)| format!("{count} {what}")).collect();
        notes.push(format!("elements that are not four-node tetrahedra were left out: {}", kinds.join(", ")));
    }
    // A file in which all tetrahedra have negative volume is valid: it orders nodes by the opposite convention, as
    // TetGen does.
    if turned > 0 && turned < file.elements.len() {
        notes.push(format!("{turned} tetrahedra had negative volume, and their nodes were reordered"));
    }
    let angles: Vec<f64> = tetrahedra.iter().map(|&t| least_dihedral(&file.nodes, t)).collect();
    let slivers = angles.iter().filter(|&&angle| angle < SLIVER).count();
    let worst = file.elements.iter().zip(&angles).min_by(|a, b| a.1.total_cmp(b.1));
    if let Some((element, angle)) = worst.filter(|_| slivers > 0) {
        notes.push(format!(
            "{slivers} tetrahedra have a dihedral angle under {SLIVER} degrees and are kept; \
             the worst is tetrahedron {} with {angle:.1e} degrees",
            element.id
        ));
    }
    notes
}

/// The least dihedral angle of a tetrahedron of positive volume, degrees.
fn least_dihedral(nodes: &[DVec3], tetrahedron: [u32; 4]) -> f64 {
    let [a, b, c, d] = tetrahedron.map(|node| nodes[node as usize]);
    // Outward normals of the four faces; the length of each is twice the area of its face.
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
