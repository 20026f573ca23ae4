//! The last step of reading a tetrahedral mesh: ids to places, winding made positive, defects refused.

use std::collections::HashMap;
use std::path::Path;

use glam::DVec3;

use super::gmsh::{Contents, TetMesh};
use crate::{Error, Result};

/// Volume against the cube of the longest edge below which a tetrahedron is flat: a rest gradient in single precision
/// means nothing well before.
const FLATTEST: f64 = 1e-12;

/// A tetrahedron as the file names it.
pub(super) struct Element {
    pub id: u64,
    pub line: usize,
    pub nodes: [u64; 4],
}

pub(super) fn settle(file: Contents, path: &Path) -> Result<TetMesh> {
    if file.nodes.is_empty() {
        return Err(Error::input(path, None, "has no nodes", "export the mesh with its nodes"));
    }
    if file.elements.is_empty() {
        let problem = "has no tetrahedra of four nodes";
        let remedy = if file.has_second_order {
            "its second-order tetrahedra are not read: export first-order ones"
        } else {
            "export the volume mesh, not its surface alone"
        };
        return Err(Error::input(path, None, problem, remedy));
    }
    let mut seen: HashMap<[u32; 4], u64> = HashMap::with_capacity(file.elements.len());
    let mut tetrahedra = Vec::with_capacity(file.elements.len());
    for element in &file.elements {
        let refuse = |problem: String, remedy: &str| {
            Error::input(path, Some(element.line), format!("tetrahedron {} {problem}", element.id), remedy)
        };
        let mut nodes = [0; 4];
        for (node, id) in nodes.iter_mut().zip(element.nodes) {
            let place = file.index.get(&id);
            *node = *place.ok_or_else(|| refuse(format!("names node {id}, which is not there"), "export again"))?;
        }
        let volume = volume(&file.nodes, nodes);
        if volume.abs() <= FLATTEST * longest_edge(&file.nodes, nodes).powi(3) {
            return Err(refuse("has no volume".into(), "remove it, or mesh again with better quality"));
        }
        if volume < 0.0 {
            nodes.swap(2, 3);
        }
        let mut key = nodes;
        key.sort_unstable();
        if let Some(first) = seen.insert(key, element.id) {
            return Err(refuse(format!("is tetrahedron {first} again"), "remove the copy"));
        }
        tetrahedra.push(nodes);
    }
    Ok(TetMesh { nodes: file.nodes, tetrahedra })
}

fn volume(nodes: &[DVec3], tetrahedron: [u32; 4]) -> f64 {
    let [a, b, c, d] = tetrahedron.map(|node| nodes[node as usize]);
    (b - a).cross(c - a).dot(d - a) / 6.0
}

fn longest_edge(nodes: &[DVec3], tetrahedron: [u32; 4]) -> f64 {
    let points = tetrahedron.map(|node| nodes[node as usize]);
    points.iter().flat_map(|a| points.iter().map(|b| a.distance(*b))).fold(0.0, f64::max)
}
