//! Reads meshes from VTK's XML files: unstructured grids (`.vtu`), which hold the layer (the tetrahedral mesh) of a soft
//! body or a surface, and polydata (`.vtp`), which hold a surface. All pieces of a file become one mesh.
//!
//! The format is described in "VTK File Formats", XML formats; that binary arrays have one header for each array, and
//! compressed ones a table of their blocks, in vtkXMLWriter of VTK itself. Arrays may be text, base64 in their place, or
//! appended as base64 or raw bytes; compressed by zlib or LZ4, or not.

mod array;
pub mod write;

use std::path::{Path, PathBuf};

use glam::DVec3;
use roxmltree::{Document, Node};

use self::array::{Appended, Encoding, number_named};
use super::cursor::{self, Cursor, LARGEST, short};
use super::number::Number;
use super::tetrahedra::TetMesh;
use super::triangles::{MOST_TRIANGLES, TriangleFile};
use super::vtk::grid::{Cells, Grid, LINE, POINTS, POLYGON, STRIP};
use crate::{Error, Result, files};

const REMEDY: &str = "save the mesh as VTK XML again, with zlib or without compression";
/// Name of the data on cells that give the groups.
const GROUP: &str = "group";
/// The elements of polydata that have cells, and the types of these.
const FACES: [(&str, u64); 4] = [("Verts", POINTS), ("Lines", LINE), ("Strips", STRIP), ("Polys", POLYGON)];

/// Reads the points and four-node tetrahedra of an unstructured grid; other cells are left out and counted in the notes.
/// Groups are taken as from a legacy file: from the data on cells called `group`, or else the first with one whole number
/// for each cell.
pub(super) fn read(path: &Path) -> Result<TetMesh> {
    grid(path, &cursor::bytes(path)?)?.into_layer(&Cursor::of_arrays(path, REMEDY))
}

/// Reads the faces of polydata or of an unstructured grid, cut into triangles.
pub(super) fn read_surface(path: &Path) -> Result<TriangleFile> {
    grid(path, &cursor::bytes(path)?)?.into_surface(&Cursor::of_arrays(path, REMEDY))
}

/// Data of a file's points or cells.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    /// Name of the array; "Points" are the points themselves.
    pub name: String,
    /// Numbers for each point or cell.
    pub components: usize,
    /// The numbers of one point or cell after another.
    pub numbers: Vec<f64>,
}

/// Reads the points of a file's first piece, and all data of its points and cells.
pub fn read_fields(path: &Path) -> Result<Vec<Field>> {
    with_file(path, &cursor::bytes(path)?, |file| file.fields())
}

/// Reads a file that lists others with their times (`.pvd`): times, s, and paths.
pub fn read_series(path: &Path) -> Result<Vec<(f64, PathBuf)>> {
    let text = files::text(path, REMEDY)?;
    with_file(path, text.as_bytes(), |file| {
        let sets = file.document.descendants().filter(|node| node.has_tag_name("DataSet"));
        let listed = sets.map(|node| {
            let time = node.attribute("timestep").and_then(|time| time.trim().parse::<f64>().ok());
            let time = time.filter(|time| time.is_finite()).ok_or_else(|| file.error(node, "has no timestep"))?;
            let name = node.attribute("file").ok_or_else(|| file.error(node, "names no file"))?;
            Ok((time, path.parent().unwrap_or(Path::new("")).join(name)))
        });
        listed.collect()
    })
}

fn grid(path: &Path, bytes: &[u8]) -> Result<Grid> {
    with_file(path, bytes, |file| file.grid())
}

/// Parses a file, and reads from it.
fn with_file<T>(path: &Path, bytes: &[u8], read: impl FnOnce(&File) -> Result<T>) -> Result<T> {
    let (text, data) = array::split(bytes);
    let text = std::str::from_utf8(text)
        .map_err(|error| Error::input(path, None, format!("is not UTF-8 at byte {}", error.valid_up_to()), REMEDY))?;
    if data.is_some_and(|data| !data.trim_ascii_end().ends_with(b"</VTKFile>")) {
        return Err(Error::input(path, None, "ends early, before </VTKFile>", REMEDY));
    }
    let text = if data.is_some() { format!("{text}</AppendedData></VTKFile>") } else { text.into() };
    if array::is_deep(text.as_bytes()) {
        return Err(Error::input(path, None, "has elements within more than a hundred others", REMEDY));
    }
    let document = Document::parse(&text)
        .map_err(|error| Error::input(path, Some(error.pos().row as usize), format!("is no XML: {error}"), REMEDY))?;
    let mut file = File { path, document: &document, encoding: Encoding::default(), appended: None };
    file.encoding = file.encoding()?;
    file.appended = data.map(|data| file.appended(data)).transpose()?;
    read(&file)
}

/// An XML file of VTK.
struct File<'a> {
    path: &'a Path,
    document: &'a Document<'a>,
    encoding: Encoding,
    appended: Option<Appended<'a>>,
}

impl<'a> File<'a> {
    /// An error at an element of the file.
    fn error(&self, node: Node, problem: impl Into<String>) -> Error {
        let line = self.document.text_pos_at(node.range().start).row;
        Error::input(self.path, Some(line as usize), problem, REMEDY)
    }

    /// What the root says of the file's arrays.
    fn encoding(&self) -> Result<Encoding> {
        let root = self.document.root_element();
        if !root.has_tag_name("VTKFile") {
            return Err(self.error(root, "the root is no VTKFile"));
        }
        Encoding::of(|name| root.attribute(name)).map_err(|problem| self.error(root, problem))
    }

    fn appended(&self, data: &'a [u8]) -> Result<Appended<'a>> {
        let node = self.document.root_element().children().find(|node| node.has_tag_name("AppendedData"));
        let kind = node.and_then(|node| node.attribute("encoding")).unwrap_or("base64");
        Appended::new(kind, data).map_err(|problem| self.error(self.document.root_element(), problem))
    }

    fn grid(&self) -> Result<Grid> {
        let root = self.document.root_element();
        let kind = root.attribute("type").unwrap_or_default();
        if !["UnstructuredGrid", "PolyData"].contains(&kind) {
            return Err(self.error(root, format!("a file of type \"{}\"", short(kind))));
        }
        let all = self.child(root, kind)?;
        let mut grid = Grid::default();
        let mut groups = Vec::new();
        for piece in all.children().filter(|node| node.has_tag_name("Piece")) {
            let first = grid.points.len() as u64;
            self.points(piece, &mut grid)?;
            if kind == "PolyData" {
                for (name, of) in FACES {
                    let Some(node) = piece.children().find(|node| node.has_tag_name(name)) else { continue };
                    let cells = self.cells(node, first, grid.points.len())?;
                    self.told(piece, node, name, cells.count())?;
                    grid.types.resize(grid.types.len() + cells.count(), of);
                    grid.cells.append(&cells);
                }
                continue;
            }
            let node = self.child(piece, "Cells")?;
            let cells = self.cells(node, first, grid.points.len())?;
            let types = self.wholes(self.named(node, "types")?)?;
            self.told(piece, node, "Cells", cells.count())?;
            let (count, found) = (cells.count(), types.len());
            if count != found {
                return Err(self.error(node, format!("{count} cells, but {found} types of cells")));
            }
            grid.types.extend(types);
            grid.cells.append(&cells);
            groups.push(self.groups(piece, count).unwrap_or_else(|error| {
                grid.notes.push(format!("data on cells were left out: {error}"));
                None
            }));
        }
        if groups.iter().all(Option::is_some) {
            grid.groups = groups.into_iter().flatten().flatten().collect();
        } else if groups.iter().any(Option::is_some) {
            grid.notes.push("groups were left out: some pieces have none".into());
        }
        Ok(grid)
    }

    fn fields(&self) -> Result<Vec<Field>> {
        let root = self.document.root_element();
        let piece = self.document.descendants().find(|node| node.has_tag_name("Piece"));
        let piece = piece.ok_or_else(|| self.error(root, "has no Piece"))?;
        let mut fields = Vec::new();
        for element in
            piece.children().filter(|node| ["PointData", "CellData", "Points"].contains(&node.tag_name().name()))
        {
            for node in element.children().filter(|node| node.has_tag_name("DataArray")) {
                let told = node.attribute("NumberOfComponents").unwrap_or("1");
                let components = told.trim().parse().ok().filter(|count| *count > 0);
                let components =
                    components.ok_or_else(|| self.error(node, format!("has \"{}\" components", short(told))))?;
                let numbers = self.numbers(node)?;
                if numbers.len() % components > 0 {
                    let problem = format!("has {} numbers, which are no whole rows of {components}", numbers.len());
                    return Err(self.error(node, problem));
                }
                let is_points = element.has_tag_name("Points");
                let name = if is_points { "Points" } else { node.attribute("Name").unwrap_or_default() };
                fields.push(Field { name: name.into(), components, numbers });
            }
        }
        Ok(fields)
    }

    /// Checks that the number of cells that a piece tells, if it tells one, is that of its element `node`.
    fn told(&self, piece: Node, node: Node, name: &str, cells: usize) -> Result<()> {
        let told = piece.attribute(format!("NumberOf{name}").as_str()).map(str::trim);
        if told.is_some_and(|told| told != cells.to_string()) {
            return Err(self.error(node, format!("{cells} cells, but NumberOf{name} differs")));
        }
        Ok(())
    }

    fn child<'n>(&self, node: Node<'n, 'n>, name: &str) -> Result<Node<'n, 'n>> {
        let child = node.children().find(|child| child.has_tag_name(name));
        child.ok_or_else(|| self.error(node, format!("has no {name}")))
    }

    /// The array of this name.
    fn named<'n>(&self, node: Node<'n, 'n>, name: &str) -> Result<Node<'n, 'n>> {
        let is_it = |child: &Node| child.has_tag_name("DataArray") && child.attribute("Name") == Some(name);
        node.children().find(is_it).ok_or_else(|| self.error(node, format!("has no array \"{name}\"")))
    }

    fn points(&self, piece: Node, grid: &mut Grid) -> Result<()> {
        if piece.attribute("NumberOfPoints").is_some_and(|count| count.trim() == "0") {
            return Ok(());
        }
        let node = self.child(self.child(piece, "Points")?, "DataArray")?;
        let numbers = self.numbers(node)?;
        let told = piece.attribute("NumberOfPoints").and_then(|count| count.trim().parse::<usize>().ok());
        if numbers.len() % 3 > 0 || told != Some(numbers.len() / 3) {
            let told = piece.attribute("NumberOfPoints").unwrap_or("no number of");
            return Err(self.error(node, format!("{} coordinates for {told} points", numbers.len())));
        }
        if let Some(k) = numbers.iter().position(|x| !x.is_finite() || x.abs() > LARGEST) {
            return Err(self.error(node, format!("point {} has a coordinate that is not finite, or too large", k / 3)));
        }
        grid.points.extend(numbers.chunks(3).map(DVec3::from_slice));
        let few = grid.points.len() <= MOST_TRIANGLES && grid.cells.corners.len() <= 3 * MOST_TRIANGLES;
        few.then_some(())
            .ok_or_else(|| self.error(node, "has too many points or cells in all, since pieces repeat data"))
    }

    /// The cells of an element; the indices of their points begin at `first` and end before `end`.
    fn cells(&self, node: Node, first: u64, end: usize) -> Result<Cells> {
        let has_none = !node.children().any(|child| child.has_tag_name("DataArray"));
        if has_none {
            return Ok(Cells::default());
        }
        let corners = self.wholes(self.named(node, "connectivity")?)?;
        let mut offsets = vec![0];
        offsets.extend(self.wholes(self.named(node, "offsets")?)?);
        let corners: Vec<_> = corners.into_iter().map(|corner| (first.saturating_add(corner), 0)).collect();
        if let Some((bad, _)) = corners.iter().find(|corner| corner.0 >= end as u64) {
            let points = end as u64 - first;
            return Err(self.error(node, format!("names point {}, but its piece has {points}", bad - first)));
        }
        let cells = Cells { corners, offsets };
        cells.check().map_err(|problem| self.error(node, problem))?;
        Ok(cells)
    }

    /// The group of each cell of a piece, if there are groups.
    fn groups(&self, piece: Node, count: usize) -> Result<Option<Vec<i64>>> {
        let Some(data) = piece.children().find(|node| node.has_tag_name("CellData")) else { return Ok(None) };
        let is_whole = |node: &Node| {
            let has_one = node.attribute("NumberOfComponents").is_none_or(|count| count.trim() == "1");
            let kind = node.attribute("type").and_then(number_named);
            node.has_tag_name("DataArray") && has_one && matches!(kind, Some(Number::Whole { .. }))
        };
        let is_named = |node: &Node| node.attribute("Name").is_some_and(|name| name.eq_ignore_ascii_case(GROUP));
        let arrays: Vec<Node> = data.children().filter(is_whole).collect();
        let Some(node) = arrays.iter().find(|node| is_named(node)).or(arrays.first()) else { return Ok(None) };
        let groups: Vec<i64> = self.numbers(*node)?.iter().map(|number| *number as i64).collect();
        if groups.len() == count { Ok(Some(groups)) } else { Ok(None) }
    }

    /// The numbers of an array.
    fn numbers(&self, node: Node) -> Result<Vec<f64>> {
        let wrong = |problem: String| {
            let name = node.attribute("Name").unwrap_or("points").escape_debug().to_string();
            self.error(node, format!("array \"{name}\" {problem}"))
        };
        let kind = node.attribute("type").unwrap_or_default();
        let kind =
            number_named(kind).ok_or_else(|| wrong(format!("is of the unknown type \"{}\"", kind.escape_debug())))?;
        let text = || node.children().filter_map(|child| child.text().filter(|_| child.is_text())).collect::<String>();
        match node.attribute("format").unwrap_or("ascii") {
            "ascii" => {
                let text = text();
                let number = |word: &str| {
                    word.parse().map_err(|_| wrong(format!("has \"{}\", which is no number", short(word))))
                };
                text.split_whitespace().map(number).collect()
            }
            "binary" => {
                let mut text = text().into_bytes();
                text.retain(|byte| !byte.is_ascii_whitespace());
                self.encoding.numbers(kind, &Appended::Base64(&text), 0).map_err(wrong)
            }
            "appended" => {
                let offset = node.attribute("offset").and_then(|offset| offset.trim().parse().ok());
                let offset = offset.ok_or_else(|| wrong("has no offset".into()))?;
                let appended =
                    self.appended.as_ref().ok_or_else(|| wrong("is appended to a file without data".into()))?;
                self.encoding.numbers(kind, appended, offset).map_err(wrong)
            }
            other => Err(wrong(format!("has the unknown format \"{}\"", short(other)))),
        }
    }

    /// The numbers of an array, which must be whole and not negative.
    fn wholes(&self, node: Node) -> Result<Vec<u64>> {
        let whole = |number: &f64| {
            let wrong = || self.error(node, format!("{number} is not valid for an index"));
            (*number >= 0.0 && number.fract() == 0.0).then_some(*number as u64).ok_or_else(wrong)
        };
        self.numbers(node)?.iter().map(whole).collect()
    }
}
