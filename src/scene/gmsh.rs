//! Gmsh meshes in: ASCII MSH 2.2 and 4.1, the layers that a scene names by file.
//!
//! One small parser for both versions, because errors name the file and the line (the mshio crate reads 4.1 only and
//! has no lines). Format: Gmsh reference manual, "MSH file format" and "MSH file format version 2 (Legacy)".

use std::collections::HashMap;
use std::path::Path;
use std::str::FromStr;

use glam::DVec3;

use super::tetrahedra::{Element, settle};
use crate::{Error, Result};

/// Gmsh's type number of the four-node tetrahedron.
const TETRAHEDRON: usize = 4;
/// Gmsh's type number of the ten-node tetrahedron.
const SECOND_ORDER_TETRAHEDRON: usize = 11;
/// Element types Gmsh numbers below this; more is a damaged file.
const TYPE_COUNT: usize = 200;
/// Greatest magnitude of a coordinate: more does not fit in single precision with room for a product.
const LARGEST: f64 = 1e30;

/// Tetrahedra as a file gives them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TetMesh {
    /// Every node, used or not, in file order and file coordinates.
    pub nodes: Vec<DVec3>,
    /// Zero-based nodes of each tetrahedron, positive volume (two nodes are swapped where the file's is negative).
    pub tetrahedra: Vec<[u32; 4]>,
}

/// Reads the nodes and the four-node tetrahedra of an MSH file; other elements are passed over. Node ids need not be
/// dense. Refused, with element and line: flat or repeated tetrahedra, ids that no node has, numbers that are not finite.
pub fn read(path: &Path) -> Result<TetMesh> {
    let bytes = std::fs::read(path)
        .map_err(|error| Error::input(path, None, format!("cannot be read: {error}"), "give an MSH file"))?;
    parse(&String::from_utf8_lossy(&bytes), path)
}

fn parse(text: &str, path: &Path) -> Result<TetMesh> {
    let mut reader = Reader { path, lines: text.lines(), line: 0 };
    let version = header(&mut reader)?;
    let mut file = Contents::default();
    while let Some(head) = reader.next_filled() {
        match head {
            "$Nodes" if version == Version::V2 => nodes_v2(&mut reader, &mut file)?,
            "$Nodes" => nodes_v4(&mut reader, &mut file)?,
            "$Elements" if version == Version::V2 => elements_v2(&mut reader, &mut file)?,
            "$Elements" => elements_v4(&mut reader, &mut file)?,
            other if other.starts_with('$') => {
                let end = format!("$End{}", &other[1..]);
                while reader.need(&end)? != end {}
            }
            other => return Err(reader.error(format!("\"{}\" stands outside any section", short(other)))),
        }
    }
    settle(file, path)
}

/// What the sections hold, ids not yet resolved.
#[derive(Default)]
pub(super) struct Contents {
    pub nodes: Vec<DVec3>,
    /// Place of a node by its id.
    pub index: HashMap<u64, u32>,
    pub elements: Vec<Element>,
    pub has_second_order: bool,
}

#[derive(PartialEq, Clone, Copy)]
enum Version {
    V2,
    V4,
}

/// Lines of a file, counted.
struct Reader<'a> {
    path: &'a Path,
    lines: std::str::Lines<'a>,
    line: usize,
}

impl<'a> Reader<'a> {
    fn error(&self, problem: impl Into<String>) -> Error {
        Error::input(self.path, Some(self.line), problem, "export the mesh again as ASCII MSH 2.2 or 4.1")
    }

    fn next_filled(&mut self) -> Option<&'a str> {
        loop {
            self.line += 1;
            let line = self.lines.next()?.trim();
            if !line.is_empty() {
                return Some(line);
            }
        }
    }

    /// The next line that is not empty; `what` is said where the file ends instead.
    fn need(&mut self, what: &str) -> Result<&'a str> {
        self.next_filled().ok_or_else(|| self.error(format!("the file ends early, before {what}")))
    }

    fn expect(&mut self, marker: &str) -> Result<()> {
        match self.need(marker)? {
            line if line == marker => Ok(()),
            line => Err(self.error(format!("\"{}\" stands where {marker} should", short(line)))),
        }
    }

    /// All numbers of the next line, at least `least` of them.
    fn numbers<T: FromStr>(&mut self, what: &str, least: usize) -> Result<Vec<T>> {
        let line = self.need(what)?;
        let parse = |word: &str| word.parse().map_err(|_| self.error(format!("\"{}\" in {what}", short(word))));
        let numbers: Vec<T> = line.split_whitespace().map(parse).collect::<Result<_>>()?;
        if numbers.len() < least && self.lines.clone().next().is_none() {
            return Err(self.error(format!("the file ends early, within {what}")));
        }
        if numbers.len() < least {
            return Err(self.error(format!("{} numbers in {what}, which has {least}", numbers.len())));
        }
        Ok(numbers)
    }

    fn point(&self, words: &[f64]) -> Result<DVec3> {
        match words {
            [x, y, z, ..] if words[..3].iter().all(|c| c.is_finite() && c.abs() <= LARGEST) => {
                Ok(DVec3::new(*x, *y, *z))
            }
            [_, _, _, ..] => Err(self.error("a node's coordinate is not a finite number in range")),
            _ => Err(self.error("a node has three coordinates")),
        }
    }
}

/// A word fit for a message.
fn short(word: &str) -> String {
    word.chars().take(40).collect::<String>().escape_debug().to_string()
}

fn header(reader: &mut Reader) -> Result<Version> {
    reader.expect("$MeshFormat")?;
    let words: Vec<String> = reader.numbers("the format line (version, file type, data size)", 3)?;
    if words[1] != "0" {
        return Err(reader.error("the file is binary"));
    }
    let version = match words[0].as_str() {
        "2" | "2.1" | "2.2" => Version::V2,
        "4.1" => Version::V4,
        other => return Err(reader.error(format!("MSH version {} is not read", short(other)))),
    };
    reader.expect("$EndMeshFormat")?;
    Ok(version)
}

fn add_node(reader: &Reader, file: &mut Contents, id: u64, point: DVec3) -> Result<()> {
    if file.index.insert(id, file.nodes.len() as u32).is_some() {
        return Err(reader.error(format!("node {id} is given twice")));
    }
    file.nodes.push(point);
    Ok(())
}

fn nodes_v2(reader: &mut Reader, file: &mut Contents) -> Result<()> {
    let count = reader.numbers::<u64>("the number of nodes", 1)?[0];
    for _ in 0..count {
        let words: Vec<f64> = reader.numbers("a node (id, x, y, z)", 4)?;
        // An id written in a float is exact up to 2^53, far above any mesh.
        if words[0] < 0.0 || words[0].fract() != 0.0 || !words[0].is_finite() {
            return Err(reader.error(format!("node id {}", words[0])));
        }
        let point = reader.point(&words[1..])?;
        add_node(reader, file, words[0] as u64, point)?;
    }
    reader.expect("$EndNodes")
}

fn nodes_v4(reader: &mut Reader, file: &mut Contents) -> Result<()> {
    let blocks = reader.numbers::<u64>("the counts of $Nodes", 4)?[0];
    for _ in 0..blocks {
        let count = reader.numbers::<i64>("a block of nodes (dimension, tag, parametric, count)", 4)?[3];
        let mut ids = Vec::new();
        for _ in 0..count {
            ids.push(reader.numbers::<u64>("a node id", 1)?[0]);
        }
        for id in ids {
            let words: Vec<f64> = reader.numbers("a node (x, y, z)", 3)?;
            let point = reader.point(&words)?;
            add_node(reader, file, id, point)?;
        }
    }
    reader.expect("$EndNodes")
}

fn add_element(reader: &Reader, file: &mut Contents, kind: usize, id: u64, nodes: &[u64]) -> Result<()> {
    match (kind, nodes) {
        (TETRAHEDRON, &[a, b, c, d]) => {
            file.elements.push(Element { id, line: reader.line, nodes: [a, b, c, d] });
            Ok(())
        }
        (TETRAHEDRON, _) => Err(reader.error(format!("tetrahedron {id} has {} nodes", nodes.len()))),
        (SECOND_ORDER_TETRAHEDRON, _) => {
            file.has_second_order = true;
            Ok(())
        }
        (0 | TYPE_COUNT.., _) => Err(reader.error(format!("element {id} is of the unknown type {kind}"))),
        _ => Ok(()),
    }
}

fn elements_v2(reader: &mut Reader, file: &mut Contents) -> Result<()> {
    let count = reader.numbers::<u64>("the number of elements", 1)?[0];
    for _ in 0..count {
        let words: Vec<i64> = reader.numbers("an element (id, type, number of tags, tags, nodes)", 4)?;
        let ids: Vec<u64> = words.iter().map(|&word| word.max(0) as u64).collect();
        let nodes = ids.get(3 + ids[2] as usize..).unwrap_or_default();
        add_element(reader, file, ids[1] as usize, ids[0], nodes)?;
    }
    reader.expect("$EndElements")
}

fn elements_v4(reader: &mut Reader, file: &mut Contents) -> Result<()> {
    let blocks = reader.numbers::<u64>("the counts of $Elements", 4)?[0];
    for _ in 0..blocks {
        let head: Vec<i64> = reader.numbers("a block of elements (dimension, tag, type, count)", 4)?;
        for _ in 0..head[3] {
            let words: Vec<u64> = reader.numbers("an element (id, nodes)", 2)?;
            add_element(reader, file, head[2].max(0) as usize, words[0], &words[1..])?;
        }
    }
    reader.expect("$EndElements")
}

#[cfg(test)]
mod tests {
    use super::*;

    const NODES: &str = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n5\n10 0 0 0\n700 1 0 0\n31 0 1 0\n99 0 0 1\n\
                         4 5 5 5\n$EndNodes\n";

    fn v2(elements: &[&str]) -> Result<TetMesh> {
        let body = elements.join("\n");
        parse(&format!("{NODES}$Elements\n{}\n{body}\n$EndElements\n", elements.len()), Path::new("t.msh"))
    }

    #[test]
    fn sparse_ids_other_elements_and_negative_volumes() {
        let mesh = v2(&["1 15 2 1 1 10", "2 4 2 1 1 10 700 31 99"]).unwrap();
        assert_eq!(mesh.nodes.len(), 5, "unused nodes stay");
        assert_eq!(mesh.tetrahedra, [[0, 1, 2, 3]]);
        let turned = v2(&["2 4 2 1 1 700 10 31 99"]).unwrap().tetrahedra[0];
        let [a, b, c, d] = turned.map(|node| mesh.nodes[node as usize]);
        assert!((b - a).cross(c - a).dot(d - a) > 0.0);
    }

    #[test]
    fn version_4_1_in_blocks() {
        let text = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Comments\nnothing\n$EndComments\n$Nodes\n2 4 1 9\n\
                    2 1 1 1\n7\n0 0 0 0.5 0.5\n3 1 0 3\n9\n2\n1\n1 0 0\n0 1 0\n0 0 1\n$EndNodes\n$Elements\n2 2 1 2\n\
                    2 1 2 1\n1 7 9 2\n3 1 4 1\n2 7 9 2 1\n$EndElements\n";
        let mesh = parse(text, Path::new("t.msh")).unwrap();
        assert_eq!(mesh.nodes, [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z]);
        assert_eq!(mesh.tetrahedra, [[0, 1, 2, 3]]);
    }

    #[test]
    fn errors_name_element_and_line() {
        let good = "2 4 2 1 1 10 700 31 99";
        let cases: [(&[&str], &str); 6] = [
            (&["1 4 2 1 1 10 700 31 8"], "t.msh:14: tetrahedron 1 names node 8"),
            (&[good, "3 4 2 1 1 31 99 10 700"], "t.msh:15: tetrahedron 3"),
            (&["1 4 2 1 1 10 700 31 31"], "t.msh:14: tetrahedron 1 has no volume"),
            (&["1 4 2 1 1 10 700 31"], "has 3 nodes"),
            (&["1 15 2 1 1 10"], "no tetrahedra"),
            (&["1 11 2 1 1 10 700 31 99 4 4 4 4 4 4"], "second-order"),
        ];
        for (elements, words) in cases {
            let message = v2(elements).unwrap_err().to_string();
            assert!(message.contains(words), "{elements:?}: {message}");
        }
        for (text, words) in [
            (NODES.replace("2.2 0", "2.2 1"), "binary"),
            (NODES.replace("2.2 0", "4 0"), "version 4 "),
            (NODES.replace("1 0 0", "nan 0 0"), "t.msh:7:"),
            (NODES.replace("700", "10"), "given twice"),
            (NODES.replace("$EndNodes\n", ""), "ends early"),
            (String::new(), "ends early"),
        ] {
            let message = parse(&text, Path::new("t.msh")).unwrap_err().to_string();
            assert!(message.contains(words), "{words}: {message}");
        }
    }
}
