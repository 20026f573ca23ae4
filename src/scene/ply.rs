//! Reads triangle meshes from PLY files (Turk, "The PLY Polygon File Format", 1994), ASCII and binary of either byte
//! order. Of the vertices the coordinates are read, of the faces the corners; polygons and triangle strips are cut into
//! triangles. Everything else, such as colours and normals, is passed over.

use std::path::Path;

use super::cursor::{self, Cursor, Order, short};
use super::number::Number;
use super::triangles::{Polygons, TriangleFile};
use crate::Result;

const REMEDY: &str = "export the surface as PLY again";

/// The type of this name.
fn number_named(name: &str) -> Option<Number> {
    let whole = |bytes, signed| Some(Number::Whole { bytes, signed });
    match name {
        "char" | "int8" => whole(1, true),
        "uchar" | "uint8" => whole(1, false),
        "short" | "int16" => whole(2, true),
        "ushort" | "uint16" => whole(2, false),
        "int" | "int32" => whole(4, true),
        "uint" | "uint32" => whole(4, false),
        "float" | "float32" => Some(Number::Float),
        "double" | "float64" => Some(Number::Double),
        _ => None,
    }
}

/// A property of the entries of an element: a number, or a list of numbers.
struct Property {
    name: String,
    /// Type of the number that tells a list's length.
    length: Option<Number>,
    number: Number,
}

/// An element: a table of entries, such as vertices or faces.
struct ElementKind {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

impl ElementKind {
    fn index(&self, names: &[&str], is_list: bool) -> Option<usize> {
        self.properties.iter().position(|p| names.contains(&p.name.as_str()) && p.length.is_some() == is_list)
    }
}

/// Reads a PLY file.
pub(super) fn read(path: &Path) -> Result<TriangleFile> {
    let bytes = cursor::bytes(path)?;
    let mut cursor = Cursor::new(path, &bytes, REMEDY);
    let (elements, order) = header(&mut cursor)?;
    cursor.order = order;
    let mut vertices = Vec::new();
    let (mut faces, mut strips): (Vec<Face>, Vec<Face>) = (Vec::new(), Vec::new());
    let mut notes = Vec::new();
    for element in &elements {
        let what = format!("an entry of the element \"{}\"", short(&element.name));
        match element.name.as_str() {
            "vertex" => {
                let place = |name: &str| {
                    let missing = || cursor.error_of_file(&format!("its vertices have no coordinate {name}"), REMEDY);
                    element.index(&[name], false).ok_or_else(missing)
                };
                let places = [place("x")?, place("y")?, place("z")?];
                for _ in 0..element.count {
                    let entry = entry(&mut cursor, element, &what, None)?;
                    vertices.push(cursor.point(&places.map(|place| entry.numbers[place]))?);
                }
            }
            "face" | "tristrips" => {
                let Some(place) = element.index(&["vertex_indices", "vertex_index"], true) else {
                    let problem = format!("the element \"{}\" has no list vertex_indices", element.name);
                    return Err(cursor.error_of_file(&problem, REMEDY));
                };
                let kind = if element.name == "face" { &mut faces } else { &mut strips };
                for _ in 0..element.count {
                    let entry = entry(&mut cursor, element, &what, Some(place))?;
                    kind.push(Face { corners: entry.list, mark: entry.mark });
                }
            }
            _ => {
                for _ in 0..element.count {
                    entry(&mut cursor, element, &what, None)?;
                }
                if element.count > 0 {
                    notes.push(format!(
                        "{} entries of the element \"{}\" were left out",
                        element.count,
                        short(&element.name)
                    ));
                }
            }
        }
    }
    let left = cursor.left().trim_ascii().len();
    if left > 0 {
        notes.push(format!("{left} bytes after the last element were left out"));
    }
    if faces.is_empty() && strips.is_empty() && !vertices.is_empty() {
        return Err(cursor.error_of_file("has no faces", "give a surface: points alone are none"));
    }
    let mut polygons = Polygons::new(vertices);
    let wrong = |face: &Face, problem: String| cursor.error_at(face.mark, problem, REMEDY);
    for face in &faces {
        let corners = naturals(&face.corners).ok_or_else(|| wrong(face, "a face has an index that is none".into()))?;
        polygons.add(&corners).map_err(|problem| wrong(face, format!("a face {problem}")))?;
    }
    for strip in &strips {
        // A negative index ends a strip and begins another.
        for part in strip.corners.split(|corner| *corner < 0.0).filter(|part| !part.is_empty()) {
            let corners = naturals(part).ok_or_else(|| wrong(strip, "a strip has an index that is none".into()))?;
            polygons.add_strip(&corners).map_err(|problem| wrong(strip, format!("a triangle strip {problem}")))?;
        }
    }
    Ok(TriangleFile { mesh: polygons.into_mesh(), notes })
}

/// The corners of a face or a strip, and the place in the file to which errors refer.
struct Face {
    corners: Vec<f64>,
    mark: usize,
}

/// The numbers as indices, if all are whole and not negative.
fn naturals(numbers: &[f64]) -> Option<Vec<u64>> {
    numbers.iter().map(|x| (*x >= 0.0 && x.fract() == 0.0).then_some(*x as u64)).collect()
}

/// Reads the header; returns the elements, and the byte order of a binary file.
fn header(cursor: &mut Cursor) -> Result<(Vec<ElementKind>, Option<Order>)> {
    match cursor.next_line() {
        Some("ply") => {}
        other => return Err(cursor.error(format!("found \"{}\" instead of \"ply\"", short(other.unwrap_or_default())))),
    }
    let mut elements: Vec<ElementKind> = Vec::new();
    let mut order = None;
    let mut has_format = false;
    loop {
        let line = cursor.need("end_header")?;
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["comment" | "obj_info", ..] => {}
            ["format", format, "1.0"] => {
                has_format = true;
                order = match format {
                    "ascii" => None,
                    "binary_little_endian" => Some(Order::Little),
                    "binary_big_endian" => Some(Order::Big),
                    other => return Err(cursor.error(format!("unknown format \"{}\"", short(other)))),
                };
            }
            ["element", name, count] => {
                let count = cursor.parse(count, "a count")?;
                elements.push(ElementKind { name: name.into(), count, properties: Vec::new() });
            }
            ["property", ref kind @ .., name] => {
                let number = |word: &str| {
                    let unknown = || cursor.error(format!("unknown type \"{}\"", short(word)));
                    number_named(word).ok_or_else(unknown)
                };
                let property = match kind {
                    ["list", length, of] => {
                        Property { name: name.into(), length: Some(number(length)?), number: number(of)? }
                    }
                    [of] => Property { name: name.into(), length: None, number: number(of)? },
                    _ => return Err(cursor.error("a property needs a type and a name")),
                };
                if matches!(property.length, Some(Number::Float | Number::Double)) {
                    return Err(cursor.error("the length of a list must be a whole number"));
                }
                match elements.last_mut() {
                    Some(element) => element.properties.push(property),
                    None => return Err(cursor.error("a property stands before the first element")),
                }
            }
            ["end_header"] if !has_format => return Err(cursor.error("the header has no line \"format\"")),
            ["end_header"] => {
                return match elements.iter().find(|element| element.properties.is_empty() && element.count > 0) {
                    Some(empty) => {
                        Err(cursor.error(format!("the element \"{}\" has no properties", short(&empty.name))))
                    }
                    None => Ok((elements, order)),
                };
            }
            _ => return Err(cursor.error(format!("unknown line \"{}\" in the header", short(line)))),
        }
    }
}

/// An entry of an element: its properties that are single numbers (0 in place of a list), and one of its lists.
struct Entry {
    /// Where the entry begins in the file.
    mark: usize,
    numbers: Vec<f64>,
    list: Vec<f64>,
}

/// Reads the next entry; `list` is the index of the property whose list is kept.
fn entry(cursor: &mut Cursor, element: &ElementKind, what: &str, list: Option<usize>) -> Result<Entry> {
    let mark = cursor.position();
    let mut read = Entry { mark, numbers: Vec::with_capacity(element.properties.len()), list: Vec::new() };
    let mut words = match cursor.order {
        None => cursor.need(what)?.split_whitespace(),
        Some(_) => "".split_whitespace(),
    };
    for (k, property) in element.properties.iter().enumerate() {
        let mut number = |cursor: &mut Cursor, kind: Number| match (cursor.order, words.next()) {
            (Some(_), _) => kind.read(cursor, what),
            (None, Some(word)) => cursor.parse(word, what),
            (None, None) => Err(cursor.error(format!("the line ends early, within {what}"))),
        };
        let Some(length) = property.length else {
            read.numbers.push(number(cursor, property.number)?);
            continue;
        };
        read.numbers.push(0.0);
        let length = number(cursor, length)?;
        let Some(length) = naturals(&[length]).map(|length| length[0]) else {
            return Err(cursor.error(format!("{length} is not valid for the length of a list")));
        };
        for _ in 0..length {
            let item = number(cursor, property.number)?;
            if list == Some(k) {
                read.list.push(item);
            }
        }
    }
    Ok(read)
}
