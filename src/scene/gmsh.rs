//! Reads meshes of the mesh generator Gmsh: MSH files of version 2.2 or 4.1, as ASCII or as binary of either byte
//! order. Writes MSH 4.1 as ASCII. In Gmsh, an *entity* is a point, curve, surface or volume of the geometry, a
//! *physical group* is a set of entities with a number, and a *tag* is a number that belongs to an entity or element.
//!
//! The format is described in the Gmsh reference manual, "MSH file format" and "MSH file format version 2 (Legacy)".

mod groups;

use std::collections::HashMap;
use std::io::Write;
use std::path::Path;

use glam::DVec3;

use super::cursor::{self, Cursor, Order, short};
use super::tetrahedra::{Contents, Element, TetMesh, VOLUME, settle};
use crate::Result;

const REMEDY: &str = "export the mesh again as MSH 2.2 or 4.1";
/// Gmsh's type number of the four-node tetrahedron.
const TETRAHEDRON: u64 = 4;
/// The number that means "in no physical group" in version 2.
const UNGROUPED: i64 = 0;
/// Number of nodes of each of Gmsh's element types; the first entry is that of type 1.
const NODE_COUNTS: [usize; 31] =
    [2, 3, 4, 4, 8, 6, 5, 3, 6, 9, 10, 27, 18, 14, 1, 8, 20, 15, 13, 9, 10, 12, 15, 15, 21, 4, 5, 6, 20, 35, 56];
/// Every type number of Gmsh's element types is less than this number; any other type number means a damaged file.
const TYPE_COUNT: u64 = 200;

/// Reads the nodes and the four-node tetrahedra of an MSH file; other elements are left out, and a note of the mesh
/// says how many. Node ids may have gaps. The group of a tetrahedron is a physical group: in version 2.2 the
/// tetrahedron's first tag, in version 4.1 the first group of the volume in which the tetrahedron lies.
pub fn read(path: &Path) -> Result<TetMesh> {
    parse(&cursor::bytes(path)?, path)
}

/// Like [`read`], but from the bytes of a file; messages name the file by `path`.
pub fn parse(bytes: &[u8], path: &Path) -> Result<TetMesh> {
    let mut cursor = Cursor::new(path, bytes, REMEDY);
    let version = header(&mut cursor)?;
    let (mut file, mut entities) = (Contents::default(), HashMap::new());
    while let Some(head) = cursor.next_filled() {
        match head {
            "$Nodes" if version == Version::V2 => nodes_v2(&mut cursor, &mut file)?,
            "$Nodes" => nodes_v4(&mut cursor, &mut file)?,
            "$Elements" if version == Version::V2 => elements_v2(&mut cursor, &mut file)?,
            "$Elements" => elements_v4(&mut cursor, &mut file, &entities)?,
            "$PhysicalNames" => groups::names(&mut cursor, &mut file)?,
            "$Entities" if version == Version::V4 => entities = groups::entities(&mut cursor, &mut file)?,
            other if other.starts_with('$') => cursor.skip_past(&format!("$End{}", &other[1..]))?,
            other => return Err(cursor.error(format!("\"{}\" is outside any section", short(other)))),
        }
    }
    settle(file, &cursor)
}

#[derive(PartialEq, Clone, Copy)]
enum Version {
    V2,
    V4,
}

fn header(cursor: &mut Cursor) -> Result<Version> {
    cursor.expect("$MeshFormat")?;
    let words: Vec<String> = cursor.numbers("the format line (version, file type, data size)", 3)?;
    let version = match words[0].as_str() {
        "2" | "2.1" | "2.2" => Version::V2,
        "4.1" => Version::V4,
        other => return Err(cursor.error(format!("MSH version {} is not supported", short(other)))),
    };
    match words[1].as_str() {
        "0" => {}
        "1" => {
            if words[2] != "8" {
                return Err(cursor.error(format!("binary numbers of {} bytes are not supported", short(&words[2]))));
            }
            cursor.order = Some(Order::Little);
            cursor.order = match cursor.i32("the integer 1 that shows the byte order")? {
                1 => Some(Order::Little),
                0x0100_0000 => Some(Order::Big),
                other => return Err(cursor.error(format!("found {other} instead of the 1 that shows the byte order"))),
            };
        }
        other => return Err(cursor.error(format!("file type {} is neither 0 (text) nor 1 (binary)", short(other)))),
    }
    cursor.expect("$EndMeshFormat")?;
    Ok(version)
}

/// Reads whole numbers: from a text file, one line with at least `ints` + `sizes` numbers; from a binary file, `ints`
/// four-byte integers and then `sizes` eight-byte integers.
fn whole(cursor: &mut Cursor, what: &str, ints: usize, sizes: usize) -> Result<Vec<i64>> {
    if cursor.order.is_none() {
        return cursor.numbers(what, ints + sizes);
    }
    let mut numbers = Vec::with_capacity(ints + sizes);
    for _ in 0..ints {
        numbers.push(cursor.i32(what)?.into());
    }
    for _ in 0..sizes {
        numbers.push(cursor.i64(what)?);
    }
    Ok(numbers)
}

/// Reads floating-point numbers: from a text file, one line with at least `least` numbers; from a binary file, exactly
/// `least` numbers.
fn real(cursor: &mut Cursor, what: &str, least: usize) -> Result<Vec<f64>> {
    if cursor.order.is_none() {
        return cursor.numbers(what, least);
    }
    (0..least).map(|_| cursor.f64(what)).collect()
}

fn nodes_v2(cursor: &mut Cursor, file: &mut Contents) -> Result<()> {
    let count = cursor.numbers::<u64>("the number of nodes", 1)?[0];
    for _ in 0..count {
        const WHAT: &str = "a node (id, x, y, z)";
        let words = match cursor.order {
            Some(_) => [vec![cursor.i32(WHAT)?.into()], real(cursor, WHAT, 3)?].concat(),
            None => cursor.numbers(WHAT, 4)?,
        };
        // The id was read as a float, which is exact up to 2^53, far above the number of nodes in any mesh.
        if words[0] < 0.0 || words[0].fract() != 0.0 || !words[0].is_finite() {
            return Err(cursor.error(format!("node id {} is not valid", words[0])));
        }
        let point = cursor.point(&words[1..])?;
        file.add_node(cursor, words[0] as u64, point)?;
    }
    cursor.expect("$EndNodes")
}

fn nodes_v4(cursor: &mut Cursor, file: &mut Contents) -> Result<()> {
    let blocks = whole(cursor, "the counts of $Nodes", 0, 4)?[0];
    for _ in 0..cursor.natural(blocks, "the number of blocks")? {
        let head = whole(cursor, "a block of nodes (dimension, tag, parametric, count)", 3, 1)?;
        // A parametric node has, after its coordinates, one parameter for each dimension of the entity it lies on.
        let parameters = if head[2] == 0 { 0 } else { head[0].clamp(0, 3) as usize };
        let mut ids = Vec::new();
        for _ in 0..cursor.natural(head[3], "the number of nodes in a block")? {
            let id = whole(cursor, "a node id", 0, 1)?[0];
            ids.push(cursor.natural(id, "a node id")?);
        }
        for id in ids {
            let words = real(cursor, "a node (x, y, z)", 3 + parameters)?;
            let point = cursor.point(&words)?;
            file.add_node(cursor, id, point)?;
        }
    }
    cursor.expect("$EndNodes")
}

/// Adds the element that was read last; if it is not a four-node tetrahedron, only counts it. `kind`: number of the
/// element's type; `groups`: numbers of its physical groups, of which a tetrahedron is in the first. The nodes of points,
/// lines and faces are kept by group.
fn add_element(
    cursor: &Cursor,
    file: &mut Contents,
    kind: u64,
    (id, groups): (u64, &[i64]),
    nodes: &[u64],
) -> Result<()> {
    match (kind, nodes) {
        (TETRAHEDRON, &[a, b, c, d]) => {
            // A tetrahedron has the material of its first group, and its nodes are in all of its groups.
            for group in groups.iter().skip(1) {
                file.grouped_nodes.entry((VOLUME, *group)).or_default().extend(nodes);
            }
            file.elements.push(Element {
                id,
                mark: cursor.mark(),
                nodes: [a, b, c, d],
                group: groups.first().copied(),
            });
        }
        (TETRAHEDRON, _) => return Err(cursor.error(format!("tetrahedron {id} has {} nodes", nodes.len()))),
        (0 | TYPE_COUNT.., _) => return Err(cursor.error(format!("element {id} is of the unknown type {kind}"))),
        _ => {
            if let Some(dimension) = dimension_of(kind) {
                for group in groups {
                    file.grouped_nodes.entry((dimension, *group)).or_default().extend(nodes);
                }
            }
            file.skip(&name(kind));
        }
    }
    Ok(())
}

/// Number of dimensions of the elements of a type with which Gmsh meshes points, curves and surfaces.
fn dimension_of(kind: u64) -> Option<usize> {
    match kind {
        15 => Some(0),
        1 | 8 | 26..=28 => Some(1),
        2 | 3 | 9 | 10 | 16 | 20..=25 => Some(2),
        _ => None,
    }
}

/// What elements of a type are called in notes; `kind`: number of the type.
fn name(kind: u64) -> String {
    match kind {
        1 => "lines".into(),
        2 => "triangles".into(),
        3 => "quadrangles".into(),
        5 => "hexahedra".into(),
        6 => "prisms".into(),
        7 => "pyramids".into(),
        11 => "second-order tetrahedra".into(),
        15 => "points".into(),
        _ => format!("of Gmsh's type {kind}"),
    }
}

/// Number of nodes of an element of type `kind`; a binary file does not give this number.
fn nodes_of(cursor: &Cursor, kind: u64) -> Result<usize> {
    let known = kind.checked_sub(1).and_then(|place| NODE_COUNTS.get(place as usize));
    known.copied().ok_or_else(|| cursor.error(format!("elements of the unknown type {kind}")))
}

fn elements_v2(cursor: &mut Cursor, file: &mut Contents) -> Result<()> {
    let count = cursor.numbers::<u64>("the number of elements", 1)?[0];
    let mut done = 0;
    while done < count {
        const WHAT: &str = "an element (id, type, number of tags, tags, nodes)";
        if cursor.order.is_some() {
            done += binary_elements_v2(cursor, file)?;
            continue;
        }
        let words: Vec<i64> = cursor.numbers(WHAT, 4)?;
        let ids: Vec<u64> = words.iter().map(|&word| word.max(0) as u64).collect();
        let first = usize::try_from(ids[2]).ok().and_then(|tags| tags.checked_add(3));
        let nodes = first.and_then(|first| ids.get(first..)).unwrap_or_default();
        let group = if ids[2] > 0 { words.get(3).copied() } else { None };
        add_element(cursor, file, ids[1], (ids[0], group.filter(|&group| group != UNGROUPED).as_slice()), nodes)?;
        done += 1;
    }
    cursor.expect("$EndElements")
}

/// Reads a run of binary elements, which are all of one type, and returns the number of elements.
fn binary_elements_v2(cursor: &mut Cursor, file: &mut Contents) -> Result<u64> {
    const WHAT: &str = "a run of elements (type, count, number of tags)";
    let head = whole(cursor, WHAT, 3, 0)?;
    let kind = cursor.natural(head[0], WHAT)?;
    let count = cursor.natural(head[1], WHAT)?;
    let tags = cursor.natural(head[2], WHAT)? as usize;
    let nodes = nodes_of(cursor, kind)?;
    for _ in 0..count {
        let id = cursor.i32("an element")?.max(0) as u64;
        let tags = (0..tags).map(|_| cursor.i32("an element's tags")).collect::<Result<Vec<_>>>()?;
        let group = tags.first().map(|&group| group.into()).filter(|&group| group != UNGROUPED);
        let words = whole(cursor, "an element's nodes", nodes, 0)?;
        let words: Vec<u64> = words.iter().map(|&word| word.max(0) as u64).collect();
        add_element(cursor, file, kind, (id, group.as_slice()), &words)?;
    }
    Ok(count)
}

fn elements_v4(cursor: &mut Cursor, file: &mut Contents, entities: &groups::Entities) -> Result<()> {
    let blocks = whole(cursor, "the counts of $Elements", 0, 4)?[0];
    for _ in 0..cursor.natural(blocks, "the number of blocks")? {
        let head = whole(cursor, "a block of elements (dimension, tag, type, count)", 3, 1)?;
        let kind = cursor.natural(head[2], "a type of elements")?;
        let groups = entities.get(&(head[0], head[1])).map_or(&[][..], Vec::as_slice);
        let nodes = if cursor.order.is_some() { nodes_of(cursor, kind)? } else { 1 };
        for _ in 0..cursor.natural(head[3], "the number of elements in a block")? {
            let words = whole(cursor, "an element (id, nodes)", 0, 1 + nodes)?;
            let words: Vec<u64> = words.iter().map(|&word| word.max(0) as u64).collect();
            add_element(cursor, file, kind, (words[0], groups), &words[1..])?;
        }
    }
    cursor.expect("$EndElements")
}

/// Writes tetrahedra as MSH 4.1 ASCII, in one volume. Nodes and tetrahedra keep their order; their ids count from 1.
/// Coordinates have enough digits to be read back with the same bits.
pub fn write(w: &mut impl Write, nodes: &[DVec3], tetrahedra: &[[u32; 4]]) -> std::io::Result<()> {
    let low = nodes.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let high = nodes.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    writeln!(w, "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Entities\n0 0 0 1")?;
    writeln!(w, "1 {:e} {:e} {:e} {:e} {:e} {:e} 0 0\n$EndEntities", low.x, low.y, low.z, high.x, high.y, high.z)?;
    let count = nodes.len();
    writeln!(w, "$Nodes\n1 {count} 1 {count}\n3 1 0 {count}")?;
    (1..=count).try_for_each(|id| writeln!(w, "{id}"))?;
    nodes.iter().try_for_each(|p| writeln!(w, "{:e} {:e} {:e}", p.x, p.y, p.z))?;
    let count = tetrahedra.len();
    writeln!(w, "$EndNodes\n$Elements\n1 {count} 1 {count}\n3 1 {TETRAHEDRON} {count}")?;
    for (id, nodes) in (1..).zip(tetrahedra) {
        let [a, b, c, d] = nodes.map(|node| node + 1);
        writeln!(w, "{id} {a} {b} {c} {d}")?;
    }
    writeln!(w, "$EndElements")
}

#[cfg(test)]
mod tests {
    use super::*;

    const NODES: &str = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n5\n10 0 0 0\n700 1 0 0\n31 0 1 0\n99 0 0 1\n\
                         4 5 5 5\n$EndNodes\n";

    fn v2(elements: &[&str]) -> Result<TetMesh> {
        let body = elements.join("\n");
        parse(format!("{NODES}$Elements\n{}\n{body}\n$EndElements\n", elements.len()).as_bytes(), Path::new("t.msh"))
    }

    #[test]
    fn sparse_ids_other_elements_and_negative_volumes() {
        let mesh = v2(&["1 15 2 1 1 10", "2 4 2 1 1 10 700 31 99"]).unwrap();
        assert_eq!(mesh.nodes.len(), 5, "unused nodes must be kept");
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
        let mesh = parse(text.as_bytes(), Path::new("t.msh")).unwrap();
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
            assert!(message.contains(words), "elements {elements:?} give the error: {message}");
        }
        for (text, words) in [
            (NODES.replace("2.2 0", "2.2 1"), "instead of the 1 that shows the byte order"),
            (NODES.replace("2.2 0", "4 0"), "version 4 "),
            (NODES.replace("1 0 0", "nan 0 0"), "t.msh:7:"),
            (NODES.replace("700", "10"), "given twice"),
            (NODES.replace("$EndNodes\n", ""), "ends early"),
            (String::new(), "ends early"),
        ] {
            let message = parse(text.as_bytes(), Path::new("t.msh")).unwrap_err().to_string();
            assert!(message.contains(words), "expected `{words}` in the error: {message}");
        }
    }
}
