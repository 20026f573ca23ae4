//! Reads and writes meshes as legacy VTK files. The files that are read hold the layer (the tetrahedral mesh) of a soft
//! body, as an unstructured grid, or a surface, as polydata or as an unstructured grid. The files that are written hold
//! a layer as it is deformed at the end of a run, for ParaView and similar programs.
//!
//! The format is described in "VTK File Formats", simple legacy formats. Versions 1 to 4 and 5.1 are read, as ASCII or
//! as binary; binary numbers are always big-endian.

mod data;
pub(super) mod grid;

use std::io::Write;
use std::path::Path;

use glam::DVec3;

use self::data::CellData;
use self::grid::{Cells, Grid, LINE, POINTS, POLYGON, STRIP, TETRAHEDRON};
use super::cursor::{self, Cursor, Order, short};
use super::tetrahedra::TetMesh;
use super::triangles::TriangleFile;
use crate::Result;

const REMEDY: &str = "export the mesh again as a legacy VTK file";

/// Reads the points and the four-node tetrahedra of an unstructured grid; other cells are left out and counted in the
/// notes of the mesh. The group of a tetrahedron (a number by which a scene can give tetrahedra a material of their
/// own) is taken from the cell data called `group`, or else from the first cell data with one whole number per cell.
/// Cell or point data that cannot be read cause a note, not an error.
pub fn read(path: &Path) -> Result<TetMesh> {
    parse(&cursor::bytes(path)?, path)
}

/// Does what [`read`] does with the bytes of a file; messages name the file by `path`.
pub fn parse(bytes: &[u8], path: &Path) -> Result<TetMesh> {
    let mut cursor = Cursor::new(path, bytes, REMEDY);
    grid(&mut cursor)?.into_layer(&cursor)
}

/// Reads the points of a surface and its triangles, quadrangles, polygons and triangle strips, which are cut into
/// triangles; other cells are left out and counted in the notes.
pub fn read_surface(path: &Path) -> Result<TriangleFile> {
    let bytes = cursor::bytes(path)?;
    let mut cursor = Cursor::new(path, &bytes, REMEDY);
    grid(&mut cursor)?.into_surface(&cursor)
}

/// Reads the whole file.
fn grid(cursor: &mut Cursor) -> Result<Grid> {
    header(cursor)?;
    let mut grid = Grid::default();
    let mut is_polydata = false;
    let mut on_cells = CellData::default();
    while let Some(line) = cursor.next_filled() {
        let words: Vec<&str> = line.split_whitespace().collect();
        let keyword = words[0].to_uppercase();
        match keyword.as_str() {
            "DATASET" => match words.get(1).map(|kind| kind.to_uppercase()).as_deref() {
                Some("UNSTRUCTURED_GRID") => is_polydata = false,
                Some("POLYDATA") => is_polydata = true,
                other => return Err(cursor.error(format!("a dataset of type {}", short(other.unwrap_or_default())))),
            },
            "POINTS" => points(cursor, &words, &mut grid)?,
            "CELLS" if !is_polydata => grid.cells = Cells::read(cursor, &words)?,
            "CELL_TYPES" if !is_polydata => {
                for _ in 0..count(cursor, &words, 1)? {
                    grid.types.push(natural(cursor, 4, "a cell's type")?);
                }
            }
            "VERTICES" | "LINES" | "POLYGONS" | "TRIANGLE_STRIPS" if is_polydata => {
                let kind = match keyword.as_str() {
                    "VERTICES" => POINTS,
                    "LINES" => LINE,
                    "POLYGONS" => POLYGON,
                    _ => STRIP,
                };
                let cells = Cells::read(cursor, &words)?;
                grid.types.resize(grid.types.len() + cells.count(), kind);
                grid.cells.append(&cells);
            }
            "FIELD" => field(cursor, &words)?,
            "METADATA" => while cursor.next_line().is_some_and(|line| !line.is_empty()) {},
            // Data on points and cells are not part of the mesh, so errors in them do not prevent the mesh from being
            // read.
            "POINT_DATA" | "CELL_DATA" => {
                if let Err(error) = on_cells.read(cursor, &words) {
                    grid.notes.push(format!("data on points and cells were left out: {error}"));
                    on_cells = CellData::default();
                }
                break;
            }
            other => return Err(cursor.error(format!("unknown keyword \"{}\"", short(other)))),
        }
    }
    grid.groups = on_cells.groups;
    Ok(grid)
}

fn header(cursor: &mut Cursor) -> Result<()> {
    let magic = cursor.next_line().unwrap_or_default();
    if !magic.to_lowercase().starts_with("# vtk datafile version") {
        return Err(cursor.error(format!("found \"{}\" instead of \"# vtk DataFile Version\"", short(magic))));
    }
    // This line is the title, which may be any text.
    cursor.next_line();
    match cursor.need("ASCII or BINARY")?.to_uppercase().as_str() {
        "ASCII" => {}
        "BINARY" => cursor.order = Some(Order::Big),
        other => return Err(cursor.error(format!("found \"{}\" instead of ASCII or BINARY", short(other)))),
    }
    Ok(())
}

/// Parses the count at index `place` of `words`, which are the words of a keyword's line.
fn count(cursor: &Cursor, words: &[&str], place: usize) -> Result<u64> {
    let word =
        words.get(place).ok_or_else(|| cursor.error(format!("{} must be followed by its counts", short(words[0]))))?;
    cursor.parse(word, "a count")
}

/// Reads a whole number that is not negative: in a text file a word, in a binary file an integer of 8 bytes if `bytes`
/// is 8, else of 4 bytes. In errors, `what` is the number's meaning.
fn natural(cursor: &mut Cursor, bytes: usize, what: &str) -> Result<u64> {
    let number = match (cursor.order, bytes) {
        (None, _) => {
            let word = cursor.word(what)?;
            cursor.parse(word, what)?
        }
        (Some(_), 8) => cursor.i64(what)?,
        (Some(_), _) => cursor.i32(what)?.into(),
    };
    cursor.natural(number, what)
}

/// Returns the size in bytes that a number of type `kind` has in a binary file.
fn size_of(cursor: &Cursor, kind: Option<&&str>) -> Result<usize> {
    match kind.map(|kind| kind.to_lowercase()).as_deref() {
        Some("char" | "unsigned_char") => Ok(1),
        Some("short" | "unsigned_short") => Ok(2),
        Some("int" | "unsigned_int" | "float" | "vtkidtype" | "vtktypeint32") => Ok(4),
        Some("long" | "unsigned_long" | "double" | "vtktypeint64") => Ok(8),
        other => Err(cursor.error(format!("unknown number type \"{}\"", short(other.unwrap_or_default())))),
    }
}

fn points(cursor: &mut Cursor, words: &[&str], grid: &mut Grid) -> Result<()> {
    const WHAT: &str = "a point (x, y, z)";
    let size = size_of(cursor, words.get(2))?;
    let kind = words[2].to_lowercase();
    for _ in 0..count(cursor, words, 1)? {
        let mut point = [0.0; 3];
        for coordinate in &mut point {
            *coordinate = match (cursor.order, kind.as_str()) {
                (None, _) => {
                    let word = cursor.word(WHAT)?;
                    cursor.parse(word, WHAT)?
                }
                (Some(_), "double") => cursor.f64(WHAT)?,
                (Some(_), "float") => cursor.f32(WHAT)?,
                (Some(_), whole) => cursor.integer(size, !whole.starts_with("unsigned"), WHAT)? as f64,
            };
        }
        grid.points.push(cursor.point(&point)?);
    }
    Ok(())
}

/// The line that begins an array of a `FIELD`, after what the file tells of the array before.
fn array_line<'a>(cursor: &mut Cursor<'a>) -> Result<&'a str> {
    loop {
        let line = cursor.need("an array of a FIELD")?;
        if !line.eq_ignore_ascii_case("METADATA") {
            return Ok(line);
        }
        while cursor.next_line().is_some_and(|line| !line.is_empty()) {}
    }
}

/// Skips the arrays of a `FIELD` section, which hold data about the whole grid.
fn field(cursor: &mut Cursor, words: &[&str]) -> Result<()> {
    for _ in 0..count(cursor, words, 2)? {
        let line = array_line(cursor)?;
        let words: Vec<&str> = line.split_whitespace().collect();
        let numbers = count(cursor, &words, 1)?.saturating_mul(count(cursor, &words, 2)?);
        if cursor.order.is_some() {
            skip_values(cursor, words.get(3), numbers)?;
            continue;
        }
        for _ in 0..numbers {
            cursor.word("an array of a FIELD")?;
        }
    }
    Ok(())
}

/// Skips the values of an array of a `FIELD` in a binary file.
fn skip_values(cursor: &mut Cursor, kind: Option<&&str>, count: u64) -> Result<()> {
    const WHAT: &str = "an array of a FIELD";
    let bytes = match kind.map(|kind| kind.to_lowercase()).as_deref() {
        Some("string") => {
            for _ in 0..count {
                // The two highest bits of a string's length, the most significant byte first, say of how many bytes it is.
                let first = cursor.take(1, WHAT)?[0];
                let more = [7, 3, 1, 0][usize::from(first >> 6)];
                let length = cursor.integer(more, false, WHAT)? | i64::from(first & 0x3f) << (8 * more);
                cursor.take(usize::try_from(length).unwrap_or(usize::MAX), WHAT)?;
            }
            return Ok(());
        }
        Some("bit") => count.div_ceil(8),
        _ => count.saturating_mul(size_of(cursor, kind)? as u64),
    };
    cursor.take(usize::try_from(bytes).unwrap_or(usize::MAX), WHAT)?;
    Ok(())
}

/// Writes tetrahedra as a legacy VTK ASCII unstructured grid. Coordinates have so many digits that they are read back
/// with the same bits.
pub fn write(w: &mut impl Write, nodes: &[DVec3], tetrahedra: &[[u32; 4]]) -> std::io::Result<()> {
    head(w, nodes.len())?;
    nodes.iter().try_for_each(|p| writeln!(w, "{:e} {:e} {:e}", p.x, p.y, p.z))?;
    write_cells(w, tetrahedra)
}

fn head(w: &mut impl Write, nodes: usize) -> std::io::Result<()> {
    writeln!(w, "# vtk DataFile Version 3.0\npalpate layer\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS {nodes} double")
}

fn write_cells(w: &mut impl Write, tetrahedra: &[[u32; 4]]) -> std::io::Result<()> {
    writeln!(w, "CELLS {} {}", tetrahedra.len(), 5 * tetrahedra.len())?;
    for [a, b, c, d] in tetrahedra {
        writeln!(w, "4 {a} {b} {c} {d}")?;
    }
    writeln!(w, "CELL_TYPES {}", tetrahedra.len())?;
    tetrahedra.iter().try_for_each(|_| writeln!(w, "{TETRAHEDRON}"))
}

/// Writes a deformed layer as a legacy VTK ASCII unstructured grid.
///
/// `nodes` are the deformed world positions of the nodes (m), in the order of the input mesh. `displacement` has one
/// vector per node: from the node's rest position as placed in the scene to its deformed position (world axes, m). Both
/// arrays are written with nine significant digits.
pub fn write_layer(
    w: &mut impl Write,
    nodes: &[DVec3],
    tetrahedra: &[[u32; 4]],
    displacement: &[DVec3],
) -> std::io::Result<()> {
    head(w, nodes.len())?;
    write_vectors(w, nodes)?;
    write_cells(w, tetrahedra)?;
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
