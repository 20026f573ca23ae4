//! Reads tetrahedral meshes of TetGen: a `.node` file with the nodes, and an `.ele` file with the tetrahedra.
//! Attributes, boundary markers and comments are accepted.
//!
//! The format is described in the TetGen manual, "File formats". Ids are used as in the files, so that they may count
//! from 0 or from 1.

use std::path::Path;

use super::cursor::{self, Cursor};
use super::tetrahedra::{Contents, Element, TetMesh, settle};
use crate::{Error, Result};

const REMEDY: &str = "export the mesh again with TetGen";

/// Reads a `.node` and an `.ele` file; `path` may name either of the two. The first attribute of a tetrahedron is the
/// number of its group (a set of tetrahedra to which a scene can give a material of its own).
pub fn read(path: &Path) -> Result<TetMesh> {
    let (nodes, elements) = (path.with_extension("node"), path.with_extension("ele"));
    if let Some(missing) = [&nodes, &elements].into_iter().find(|path| !path.exists()) {
        let problem = format!("its companion file {} is missing", missing.display());
        return Err(Error::input(path, None, problem, "put the .node and the .ele file into one folder"));
    }
    let (node_bytes, element_bytes) = (cursor::bytes(&nodes)?, cursor::bytes(&elements)?);
    let mut contents = Contents::default();
    read_nodes(&mut Cursor::new(&nodes, &node_bytes, REMEDY), &mut contents)?;
    let mut elements = Cursor::new(&elements, &element_bytes, REMEDY);
    read_elements(&mut elements, &mut contents)?;
    settle(contents, &elements)
}

/// Returns the numbers of the next line that has any, or `None` at the end of the file; in errors, `what` is the
/// meaning of the line.
fn row(cursor: &mut Cursor, what: &str) -> Result<Option<Vec<f64>>> {
    while let Some(line) = cursor.next_filled() {
        let data = line.split('#').next().unwrap_or_default();
        let row: Vec<f64> = data.split_whitespace().map(|word| cursor.parse(word, what)).collect::<Result<_>>()?;
        if !row.is_empty() {
            return Ok(Some(row));
        }
    }
    Ok(None)
}

/// Returns the whole number at index `place` of a row; in errors, `what` is the number's meaning.
fn natural(cursor: &Cursor, row: &[f64], place: usize, what: &str) -> Result<u64> {
    match row.get(place) {
        // The number was read as a float, which holds whole numbers exactly up to 2^53, more than any mesh has nodes.
        Some(&number) if number >= 0.0 && number.fract() == 0.0 && number < 2f64.powi(53) => Ok(number as u64),
        Some(number) => Err(cursor.error(format!("{number} is not valid for {what}"))),
        None => Err(cursor.error(format!("{} numbers in a line: {what} is missing", row.len()))),
    }
}

fn header(cursor: &mut Cursor, what: &str) -> Result<Vec<f64>> {
    row(cursor, what)?.ok_or_else(|| cursor.error(format!("the file ends early, before {what}")))
}

/// Reads `count` rows, as many as the first line announces, and fails if the file has more rows.
fn rows(cursor: &mut Cursor, count: u64, what: &str, mut add: impl FnMut(&Cursor, &[f64]) -> Result<()>) -> Result<()> {
    for done in 0..count {
        let Some(row) = row(cursor, what)? else {
            return Err(cursor.error(format!("the file ends early, after {done} of {count} rows")));
        };
        add(cursor, &row)?;
    }
    match row(cursor, what)? {
        None => Ok(()),
        Some(_) => Err(cursor.error(format!("there are more than the {count} rows that the first line announces"))),
    }
}

fn read_nodes(cursor: &mut Cursor, contents: &mut Contents) -> Result<()> {
    let head = header(cursor, "the first line (number of nodes, dimension, attributes, markers)")?;
    let count = natural(cursor, &head, 0, "the number of nodes")?;
    if natural(cursor, &head, 1, "the dimension")? != 3 {
        return Err(cursor.error(format!("the mesh has {} dimensions, not 3", head[1])));
    }
    rows(cursor, count, "a node (id, x, y, z)", |cursor, row| {
        let id = natural(cursor, row, 0, "a node's id")?;
        contents.add_node(cursor, id, cursor.point(&row[1..])?)
    })
}

fn read_elements(cursor: &mut Cursor, contents: &mut Contents) -> Result<()> {
    let head = header(cursor, "the first line (number of tetrahedra, nodes of each, attributes)")?;
    let count = natural(cursor, &head, 0, "the number of tetrahedra")?;
    let corners = natural(cursor, &head, 1, "the number of nodes of a tetrahedron")?;
    if corners != 4 {
        let problem = format!("tetrahedra of {corners} nodes are not supported");
        return Err(cursor.error_at(cursor.mark(), problem, "export first-order tetrahedra, of 4 nodes"));
    }
    let mut odd = 0;
    rows(cursor, count, "a tetrahedron (id, four nodes)", |cursor, row| {
        let id = natural(cursor, row, 0, "a tetrahedron's id")?;
        let mut nodes = [0; 4];
        for (k, node) in nodes.iter_mut().enumerate() {
            *node = natural(cursor, row, 1 + k, "a node of a tetrahedron")?;
        }
        let group = row.get(5).copied();
        // As in `natural`, only numbers below 2^53 count as whole, because a float does not hold every larger whole
        // number.
        let is_whole = |number: &f64| number.fract() == 0.0 && number.abs() < 2f64.powi(53);
        odd += u64::from(group.is_some_and(|number| !is_whole(&number)));
        let group = group.filter(is_whole).map(|number| number as i64);
        contents.elements.push(Element { id, mark: cursor.mark(), nodes, group });
        Ok(())
    })?;
    if odd > 0 {
        contents.notes.push(format!("{odd} tetrahedra have an attribute that is no whole number, and are in no group"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    const NODES: &str =
        "# made by hand\n4 3 1 1\n0 0 0 0 7 1\n1 1 0 0 7 1 # a remark\n\n2 0 1 0 7 1\n3 0 0 1 7 1\n# end\n";
    const ELEMENTS: &str = "1 4 1\n0 0 1 2 3 5\n";

    fn mesh(nodes: &str, elements: &str) -> Result<TetMesh> {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("a.node"), nodes).unwrap();
        fs::write(folder.path().join("a.ele"), elements).unwrap();
        let read = read(&folder.path().join("a.ele"));
        assert_eq!(read.as_ref().ok(), super::read(&folder.path().join("a.node")).as_ref().ok());
        read
    }

    #[test]
    fn either_base_attributes_markers_and_comments() {
        let zero = mesh(NODES, ELEMENTS).unwrap();
        assert_eq!((zero.nodes.len(), &zero.tetrahedra[..], zero.notes.len()), (4, &[[0, 1, 2, 3]][..], 0));
        assert_eq!(zero.groups.of, [Some(5)]);
        let odd = mesh(NODES, "1 4 1\n0 0 1 2 3 0.5\n").unwrap();
        assert!(
            odd.groups.of == [None] && odd.notes[0].contains("1 tetrahedra have an attribute"),
            "unexpected notes: {:?}",
            odd.notes
        );
        let zero = mesh(NODES, "1 4 0\n0 0 1 2 3\n").unwrap();
        assert_eq!(zero.groups.of, [None]);
        let nodes = "4 3 0 0\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n";
        assert_eq!(mesh(nodes, "1 4 0\n1 1 2 3 4\n").unwrap(), zero);
        assert_eq!(
            mesh(nodes, "1 4 0\n1 1 2 4 3\n").unwrap(),
            zero,
            "a tetrahedron of negative volume must be reordered"
        );
    }

    #[test]
    fn no_bytes_make_it_panic() {
        for place in 0..NODES.len() {
            let _ = mesh(&NODES[..place], ELEMENTS);
            let _ = mesh(&NODES.replacen(&NODES[place..=place], "99999999999", 1), ELEMENTS);
        }
        for place in 0..ELEMENTS.len() {
            let _ = mesh(NODES, &ELEMENTS[..place]);
            let _ = mesh(NODES, &ELEMENTS.replacen(&ELEMENTS[place..=place], "-", 1));
        }
    }

    #[test]
    fn errors_name_the_file_and_the_line() {
        let cases = [
            (NODES, "1 4 0\n0 0 1 2 4\n", "a.ele:2: tetrahedron 0 names node 4"),
            (NODES, "1 4 0\n0 0 1 2\n", "a.ele:2: 4 numbers in a line"),
            (NODES, "2 4 0\n0 0 1 2 3\n", "a.ele:3: the file ends early, after 1 of 2"),
            (NODES, "1 4 0\n0 0 1 2 3\n1 0 1 2 3\n", "a.ele:3: there are more than the 1 rows"),
            (
                NODES,
                "18446744073709551615 4 0\n0 0 1 2 3\n",
                "a.ele:1: 18446744073709552000 is not valid for the number",
            ),
            (NODES, "1 10 0\n0 0 1 2 3 0 0 0 0 0 0\n", "a.ele:1: tetrahedra of 10 nodes"),
            (NODES, "1 4 0\n0 0 1 2.5 3\n", "a.ele:2: 2.5 is not valid for a node"),
            ("4 3 0 0\n0 0 0 nan\n", ELEMENTS, "a.node:2: a node's coordinate is not a finite"),
            ("4 2 0 0\n", ELEMENTS, "a.node:1: the mesh has 2 dimensions"),
            ("4 3 0 0\n0 0 0 0\n0 1 1 1\n", ELEMENTS, "a.node:3: node 0 is given twice"),
            ("4 3 0 0\n0 0 x 0\n", ELEMENTS, "a.node:2: \"x\" is not valid for a node"),
            ("", ELEMENTS, "a.node:1: the file ends early"),
            ("9007199254740991 3 0 0\n0 0 0 0\n", ELEMENTS, "a.node:3: the file ends early"),
        ];
        for (nodes, elements, words) in cases {
            let message = mesh(nodes, elements).unwrap_err().to_string();
            assert!(message.contains(words), "expected `{words}` in the error: {message}");
        }
        assert!(read(Path::new("nowhere/a.node")).unwrap_err().to_string().contains("its companion file"));
    }
}
