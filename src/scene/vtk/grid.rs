//! Points and cells of a VTK file, legacy or XML, and the meshes that are made of them: the layer (tetrahedral mesh) of
//! a soft body, or a surface.

use std::collections::BTreeMap;

use glam::DVec3;

use super::{count, natural, size_of};
use crate::Result;
use crate::scene::cursor::{Cursor, short};
use crate::scene::tetrahedra::{Contents, Element, TetMesh, settle};
use crate::scene::triangles::{Polygons, TriangleFile};

/// Numbers by which VTK denotes types of cells.
pub const POINTS: u64 = 2;
pub const LINE: u64 = 4;
const TRIANGLE: u64 = 5;
pub const STRIP: u64 = 6;
pub const POLYGON: u64 = 7;
const PIXEL: u64 = 8;
const QUADRANGLE: u64 = 9;
pub const TETRAHEDRON: u64 = 10;

/// Points and cells of a file.
#[derive(Default)]
pub struct Grid {
    pub points: Vec<DVec3>,
    pub cells: Cells,
    /// VTK's number of each cell's type.
    pub types: Vec<u64>,
    /// Group number of each cell; empty if the file has no groups.
    pub groups: Vec<i64>,
    /// Notes of the reader, one sentence each.
    pub notes: Vec<String>,
}

/// The corners of all cells, one cell after another.
pub struct Cells {
    /// Index of each corner's point, and the byte offset of that index in the file.
    pub corners: Vec<(u64, usize)>,
    /// Index in `corners` of each cell's first corner; one more entry at the end is the number of all corners.
    pub offsets: Vec<u64>,
}

impl Default for Cells {
    fn default() -> Cells {
        Cells { corners: Vec::new(), offsets: vec![0] }
    }
}

impl Cells {
    /// Reads the cells of a legacy file that follow a line with the given words: a keyword and two counts.
    pub fn read(cursor: &mut Cursor, words: &[&str]) -> Result<Cells> {
        let (cells, size) = (count(cursor, words, 1)?, count(cursor, words, 2)?);
        if cursor.peek_word().eq_ignore_ascii_case("OFFSETS") {
            return Cells::read_5(cursor, cells, size);
        }
        let mut read = Cells::default();
        let mut numbers = 0_u64;
        for cell in 0..cells {
            let length = natural(cursor, 4, "the number of a cell's points")?;
            numbers = numbers.saturating_add(length).saturating_add(1);
            if numbers > size {
                return Err(cursor.error(format!("cell {cell} goes beyond the {size} numbers of {}", short(words[0]))));
            }
            for _ in 0..length {
                read.corners.push((natural(cursor, 4, "a cell's point")?, cursor.mark()));
            }
            read.offsets.push(read.corners.len() as u64);
        }
        if numbers < size {
            let problem = format!("the {cells} cells of {} have {numbers} numbers, not {size}", short(words[0]));
            return Err(cursor.error(problem));
        }
        Ok(read)
    }

    /// Reads cells in the format of VTK 5.1 and later: first the offsets, one more than there are cells, and then the
    /// corners. `offsets` and `corners` say how many there are of each.
    fn read_5(cursor: &mut Cursor, offsets: u64, corners: u64) -> Result<Cells> {
        let mut read = Cells { corners: Vec::new(), offsets: Vec::new() };
        for (keyword, count) in [("OFFSETS", offsets), ("CONNECTIVITY", corners)] {
            let line = cursor.need(keyword)?;
            let words: Vec<&str> = line.split_whitespace().collect();
            if !words[0].eq_ignore_ascii_case(keyword) {
                return Err(cursor.error(format!("found \"{}\" instead of {keyword}", short(words[0]))));
            }
            let bytes = size_of(cursor, words.get(1))?;
            for _ in 0..count {
                let number = natural(cursor, bytes, keyword)?;
                match keyword {
                    "OFFSETS" => read.offsets.push(number),
                    _ => read.corners.push((number, cursor.mark())),
                }
            }
        }
        read.check().map_err(|problem| cursor.error(problem))?;
        Ok(read)
    }

    /// What is wrong with the offsets, if they do not lead from the first corner to the last.
    pub fn check(&self) -> std::result::Result<(), String> {
        let ends = self.offsets.first() == Some(&0) && self.offsets.last() == Some(&(self.corners.len() as u64));
        if ends && self.offsets.is_sorted() {
            return Ok(());
        }
        Err(format!("the offsets of its cells do not lead through its {} corners", self.corners.len()))
    }

    /// Number of cells.
    pub fn count(&self) -> usize {
        self.offsets.len().saturating_sub(1)
    }

    /// Adds cells behind these.
    pub fn append(&mut self, more: &Cells) {
        let first = self.corners.len() as u64;
        self.corners.extend_from_slice(&more.corners);
        self.offsets.extend(more.offsets.iter().skip(1).map(|offset| offset.saturating_add(first)));
    }
}

impl Grid {
    /// Each cell with its index, type and corners; an error refers to what `cursor` read last.
    fn each(&self, cursor: &Cursor, mut use_cell: impl FnMut(usize, u64, &[(u64, usize)]) -> Result<()>) -> Result<()> {
        let cells = self.cells.count();
        if self.types.len() != cells {
            return Err(cursor.error(format!("the file has {cells} cells, but {} cell types", self.types.len())));
        }
        for (id, (range, &kind)) in self.cells.offsets.windows(2).zip(&self.types).enumerate() {
            let Some(corners) = self.cells.corners.get(range[0] as usize..range[1] as usize) else {
                return Err(cursor.error(format!("the file does not give the corners of cell {id}")));
            };
            let (name, length) = kind_of(kind);
            if length.is_some_and(|length| corners.len() != length) {
                return Err(cursor.error(format!("cell {id} is one of the {name}, but has {} points", corners.len())));
            }
            use_cell(id, kind, corners)?;
        }
        Ok(())
    }

    /// The tetrahedra among the cells; others are counted in a note.
    pub fn into_layer(mut self, cursor: &Cursor) -> Result<TetMesh> {
        let mut file = Contents::default();
        if !self.groups.is_empty() && self.groups.len() != self.types.len() {
            let (count, cells) = (self.groups.len(), self.types.len());
            self.notes.push(format!("data on cells were left out: they are for {count} cells, but there are {cells}"));
            self.groups.clear();
        }
        self.each(cursor, |id, kind, corners| {
            match (kind, corners) {
                (TETRAHEDRON, &[a, b, c, d]) => {
                    let nodes = [a.0, b.0, c.0, d.0];
                    let group = self.groups.get(id).copied();
                    file.elements.push(Element { id: id as u64, mark: a.1, nodes, group });
                }
                _ => file.skip(&kind_of(kind).0),
            }
            Ok(())
        })?;
        (file.nodes, file.notes) = (self.points, self.notes);
        file.index = (0..file.nodes.len() as u32).map(|node| (node.into(), node)).collect();
        settle(file, cursor)
    }

    /// The triangles of the triangles, quadrangles, polygons and strips among the cells; others are counted in a note.
    pub fn into_surface(mut self, cursor: &Cursor) -> Result<TriangleFile> {
        let mut left_out: BTreeMap<String, usize> = BTreeMap::new();
        let mut polygons = Polygons::new(std::mem::take(&mut self.points));
        self.each(cursor, |id, kind, corners| {
            let points: Vec<u64> = corners.iter().map(|corner| corner.0).collect();
            let added = match (kind, &points[..]) {
                (TRIANGLE | QUADRANGLE | POLYGON, points) => polygons.add(points),
                (PIXEL, &[a, b, c, d]) => polygons.add(&[a, b, d, c]),
                (STRIP, points) => polygons.add_strip(points),
                _ => {
                    *left_out.entry(kind_of(kind).0).or_default() += 1;
                    Ok(())
                }
            };
            let mark = corners.first().map_or(cursor.mark(), |corner| corner.1);
            added.map_err(|problem| cursor.error_at(mark, format!("cell {id} {problem}"), "export the surface again"))
        })?;
        if !left_out.is_empty() {
            let kinds: Vec<String> = left_out.iter().map(|(what, count)| format!("{count} {what}")).collect();
            self.notes.push(format!("cells that are no faces were left out: {}", kinds.join(", ")));
        }
        Ok(TriangleFile { mesh: polygons.into_mesh(), notes: self.notes })
    }
}

/// Returns the name of a VTK cell type, and its number of points if the type fixes that number.
fn kind_of(kind: u64) -> (String, Option<usize>) {
    let (name, length) = match kind {
        1 => ("points", Some(1)),
        POINTS => ("clouds of points", None),
        3 => ("lines", Some(2)),
        LINE => ("lines of several points", None),
        TRIANGLE => ("triangles", Some(3)),
        STRIP => ("triangle strips", None),
        POLYGON => ("polygons", None),
        PIXEL => ("pixels", Some(4)),
        QUADRANGLE => ("quadrangles", Some(4)),
        TETRAHEDRON => ("tetrahedra", Some(4)),
        12 => ("hexahedra", Some(8)),
        13 => ("prisms", Some(6)),
        14 => ("pyramids", Some(5)),
        24 => ("second-order tetrahedra", Some(10)),
        _ => return (format!("of VTK's type {kind}"), None),
    };
    (name.into(), length)
}
