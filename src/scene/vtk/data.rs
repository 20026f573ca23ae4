//! Reads the data on the cells of a VTK grid. One of the data arrays gives each tetrahedron the number of its group
//! (tetrahedra to which a scene can give a material of their own): the array called `group`, or else the first array
//! with one whole number per cell.

use super::super::cursor::{Cursor, Order, short};
use super::{array_line, count, size_of};
use crate::Result;

/// Name of the array that gives the groups, whatever its position among the arrays; a file need not have it.
const GROUP: &str = "group";

/// The groups, from the arrays that have been read so far.
#[derive(Default)]
pub(super) struct CellData {
    /// Whether the groups come from an array called [`GROUP`].
    is_named: bool,
    /// Group number of each cell; empty if no suitable array has been found.
    pub groups: Vec<i64>,
}

/// What the arrays of a section of the file are about: cells or points, and how many of these there are.
struct Section {
    is_cells: bool,
    count: u64,
}

impl CellData {
    /// Reads all sections from a `POINT_DATA` or `CELL_DATA` line, whose words are `words`, to the end of the file.
    pub(super) fn read(&mut self, cursor: &mut Cursor, words: &[&str]) -> Result<()> {
        let mut section = section(cursor, words)?;
        while let Some(line) = cursor.next_filled() {
            let words: Vec<&str> = line.split_whitespace().collect();
            let name = words.get(1).copied().unwrap_or_default();
            let (place, components) = match words[0].to_uppercase().as_str() {
                "POINT_DATA" | "CELL_DATA" => {
                    section = self::section(cursor, &words)?;
                    continue;
                }
                "METADATA" => {
                    while cursor.next_line().is_some_and(|line| !line.is_empty()) {}
                    continue;
                }
                "FIELD" => {
                    self.field(cursor, &words, &section)?;
                    continue;
                }
                "LOOKUP_TABLE" => {
                    colours(cursor, count(cursor, &words, 2)?, 4)?;
                    continue;
                }
                "COLOR_SCALARS" => {
                    colours(cursor, section.count, count(cursor, &words, 2)?)?;
                    continue;
                }
                "SCALARS" => {
                    let components = if words.len() > 3 { count(cursor, &words, 3)? } else { 1 };
                    if cursor.peek_word().eq_ignore_ascii_case("LOOKUP_TABLE") {
                        cursor.next_filled();
                    }
                    (2, components)
                }
                "GLOBAL_IDS" | "PEDIGREE_IDS" => (2, 1),
                "VECTORS" | "NORMALS" => (2, 3),
                "TEXTURE_COORDINATES" => (3, count(cursor, &words, 2)?),
                "TENSORS6" => (2, 6),
                "TENSORS" => (2, 9),
                other => return Err(cursor.error(format!("unknown keyword \"{}\"", short(other)))),
            };
            self.array(cursor, &section, name, (words.get(place), section.count, components))?;
        }
        Ok(())
    }

    /// Reads the arrays of a `FIELD`; each array begins with a line of its name, number of components, number of tuples
    /// and type.
    fn field(&mut self, cursor: &mut Cursor, words: &[&str], section: &Section) -> Result<()> {
        for _ in 0..count(cursor, words, 2)? {
            let line = array_line(cursor)?;
            let words: Vec<&str> = line.split_whitespace().collect();
            let (components, tuples) = (count(cursor, &words, 1)?, count(cursor, &words, 2)?);
            self.array(cursor, section, words[0], (words.get(3), tuples, components))?;
        }
        Ok(())
    }

    /// Reads an array of the given type, number of tuples, and number of components per tuple. The array replaces the
    /// groups if it has one whole number per cell, and either no such array was read before, or this is the first one
    /// that is called [`GROUP`].
    fn array(
        &mut self,
        cursor: &mut Cursor,
        section: &Section,
        name: &str,
        (kind, tuples, components): (Option<&&str>, u64, u64),
    ) -> Result<()> {
        let kind = kind.map(|kind| kind.to_lowercase()).unwrap_or_default();
        let whole = integer(&kind);
        let is_named = name.eq_ignore_ascii_case(GROUP);
        let better = self.groups.is_empty() || (is_named && !self.is_named);
        let numbers = tuples.saturating_mul(components);
        match whole {
            Some(whole) if section.is_cells && better && components == 1 && tuples == section.count => {
                self.groups = (0..numbers).map(|_| whole.read(cursor)).collect::<Result<_>>()?;
                self.is_named = is_named;
            }
            _ => skip(cursor, &kind, numbers)?,
        }
        Ok(())
    }
}

fn section(cursor: &Cursor, words: &[&str]) -> Result<Section> {
    Ok(Section { is_cells: words[0].eq_ignore_ascii_case("CELL_DATA"), count: count(cursor, words, 1)? })
}

/// A type of whole numbers: its size in a binary file, bytes, and whether it has a sign.
struct Integer {
    bytes: usize,
    signed: bool,
}

fn integer(kind: &str) -> Option<Integer> {
    let (bytes, signed) = match kind {
        "char" => (1, true),
        "unsigned_char" => (1, false),
        "short" => (2, true),
        "unsigned_short" => (2, false),
        // VTK's writer stores vtkIdType in 32 bits, whatever its size in memory.
        "int" | "vtktypeint32" | "vtkidtype" => (4, true),
        "unsigned_int" => (4, false),
        "long" | "vtktypeint64" => (8, true),
        _ => return None,
    };
    Some(Integer { bytes, signed })
}

impl Integer {
    fn read(&self, cursor: &mut Cursor) -> Result<i64> {
        const WHAT: &str = "data on cells";
        if cursor.order.is_none() {
            let word = cursor.word(WHAT)?;
            return cursor.parse(word, WHAT);
        }
        cursor.integer(self.bytes, self.signed, WHAT)
    }
}

fn skip(cursor: &mut Cursor, kind: &str, numbers: u64) -> Result<()> {
    const WHAT: &str = "an array of data";
    if cursor.order == Some(Order::Big) {
        let bytes = numbers.saturating_mul(size_of(cursor, Some(&kind))? as u64);
        return cursor.take(usize::try_from(bytes).unwrap_or(usize::MAX), WHAT).map(|_| ());
    }
    (0..numbers).try_for_each(|_| cursor.word(WHAT).map(|_| ()))
}

/// Skips colours; in a binary file each component is one byte.
fn colours(cursor: &mut Cursor, count: u64, components: u64) -> Result<()> {
    skip(cursor, "unsigned_char", count.saturating_mul(components))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::super::parse;

    const GRID: &str = "# vtk DataFile Version 3.0\nt\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 5 float\n\
                        0 0 0 1 0 0 0 1 0 0 0 1 1 1 1\nCELLS 3 13\n2 0 1\n4 0 1 2 3\n4 1 2 3 4\nCELL_TYPES 3\n3\n10\n10\n";

    #[test]
    fn the_array_called_group_or_the_first_of_whole_numbers() {
        let first = "SCALARS part int 1\nLOOKUP_TABLE default\n9 4 -5\n";
        let vectors = "VECTORS speed float\n1 2 3 4 5 6 7 8 9\n";
        let field = "FIELD f 2\nmass 1 3 double\n1 2 3\nGroup 1 3 vtktypeint64\n1 2 3\n";
        let points = "POINT_DATA 5\nSCALARS node int\nLOOKUP_TABLE default\n1 2 3 4 5\nMETADATA\nINFORMATION 0\n\n";
        for (data, wanted) in [
            (format!("CELL_DATA 3\n{vectors}{first}"), [Some(4), Some(-5)]),
            (format!("CELL_DATA 3\n{first}{field}"), [Some(2), Some(3)]),
            (format!("{points}CELL_DATA 3\n{field}{first}"), [Some(2), Some(3)]),
            (format!("CELL_DATA 3\n{first}{points}"), [Some(4), Some(-5)]),
            (format!("CELL_DATA 3\n{vectors}{points}"), [None, None]),
            ("CELL_DATA 3\nCOLOR_SCALARS c 2\n1 1 1 1 1 1\nLOOKUP_TABLE t 1\n0 0 0 1\n".into(), [None, None]),
            (String::new(), [None, None]),
        ] {
            let mesh = parse(format!("{GRID}{data}").as_bytes(), Path::new("t.vtk")).unwrap();
            assert_eq!(
                (&mesh.groups.of[..], mesh.notes.len()),
                (&wanted[..], 1),
                "groups and number of notes of a file with the data {data}; notes: {:?}",
                mesh.notes
            );
        }
    }

    #[test]
    fn what_cannot_be_read_is_told_and_the_mesh_is_read() {
        for (data, words) in [
            ("CELL_DATA 3\nSCALARS part int 1\nLOOKUP_TABLE default\n9 4", "within data on cells"),
            ("CELL_DATA 3\nSCALARS part int 1\nLOOKUP_TABLE default\n9 4 x", "\"x\" is not valid for data on cells"),
            ("CELL_DATA 3\nSOMETHING part", "unknown keyword \"SOMETHING\""),
            ("CELL_DATA 7\nSCALARS part int\nLOOKUP_TABLE default\n1 2 3 4 5 6 7", "for 7 cells, but there are 3"),
        ] {
            let mesh = parse(format!("{GRID}{data}").as_bytes(), Path::new("t.vtk")).unwrap();
            assert_eq!(mesh.groups.of, [None, None]);
            assert!(
                mesh.notes.iter().any(|note| note.contains(words)),
                "expected `{words}` in the notes: {:?}",
                mesh.notes
            );
        }
    }

    #[test]
    fn binary_numbers_of_every_size() {
        let kinds: [(&str, &[u8]); 5] = [
            ("unsigned_char", &[9, 4, 251]),
            ("short", &[0, 9, 0, 4, 255, 251]),
            ("int", &[0, 0, 0, 9, 0, 0, 0, 4, 255, 255, 255, 251]),
            ("vtkidtype", &[0, 0, 0, 9, 0, 0, 0, 4, 255, 255, 255, 251]),
            ("unsigned_int", &[0, 0, 0, 9, 0, 0, 0, 4, 255, 255, 255, 251]),
        ];
        for (kind, raw) in kinds {
            let mut cursor = super::Cursor::new(Path::new("t.vtk"), raw, "");
            cursor.order = Some(super::Order::Big);
            let whole = super::integer(kind).unwrap();
            let numbers: Vec<i64> = (0..3).map(|_| whole.read(&mut cursor).unwrap()).collect();
            let last = match kind {
                "unsigned_char" => 251,
                "unsigned_int" => (1 << 32) - 5,
                _ => -5,
            };
            assert_eq!(numbers, [9, 4, last], "numbers read as type {kind}");
        }
    }
}
