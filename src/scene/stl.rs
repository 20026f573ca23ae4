//! Reads triangle meshes from STL files, ASCII and binary. Corners at the same place, bit by bit, become one vertex. The
//! normals that the file gives are not read: which side is outside follows from the order of the corners.
//!
//! The format is 3D Systems' "StereoLithography Interface Specification" (1988), as Burns, "Automated Fabrication"
//! (1993) quotes it. A binary file has 80 bytes of any text, the number of triangles, and 50 bytes for each; a file
//! that begins with `solid`, has another length, and soon goes on with `facet` or `endsolid` is text.

use std::collections::HashMap;
use std::path::Path;

use glam::DVec3;

use super::cursor::{self, Cursor, Order, short};
use super::triangles::{TriangleFile, TriangleMesh};
use crate::Result;

const REMEDY: &str = "export the surface as STL again";
/// Bytes of a binary file before its first triangle, and of each triangle.
const HEAD: usize = 84;
const TRIANGLE: usize = 50;
/// Bytes within which the name of a text's first solid ends.
const NAMED: usize = 1024;

/// Reads an STL file.
pub(super) fn read(path: &Path) -> Result<TriangleFile> {
    let bytes = cursor::bytes(path)?;
    let mut cursor = Cursor::new(path, &bytes, REMEDY);
    let told = bytes.get(HEAD - 4..HEAD).map(|count| u32::from_le_bytes([count[0], count[1], count[2], count[3]]));
    let length = told.map(|count| HEAD as u64 + TRIANGLE as u64 * u64::from(count));
    let is_text = is_text(&bytes);
    match (told, length) {
        (Some(count), Some(length)) if length == bytes.len() as u64 || !is_text => {
            binary(&mut cursor, count, length, bytes.len() as u64)
        }
        _ if is_text => text(&mut cursor),
        _ => Err(cursor
            .error_of_file("is no STL file: it neither begins with `solid` nor has a binary file's 84 bytes", REMEDY)),
    }
}

/// Whether a file begins like a text; binary files may begin with `solid` too.
fn is_text(bytes: &[u8]) -> bool {
    let begin = bytes[..bytes.len().min(NAMED)].trim_ascii_start().to_ascii_lowercase();
    let has = |word: &[u8]| begin.windows(word.len()).any(|window| window == word);
    begin.starts_with(b"solid") && (bytes.len() < HEAD || has(b"facet") || has(b"endsolid"))
}

fn binary(cursor: &mut Cursor, count: u32, length: u64, found: u64) -> Result<TriangleFile> {
    if found < length {
        let problem = format!("is cut off: its {count} triangles need {length} bytes, and it has {found}");
        return Err(cursor.error_of_file(&problem, REMEDY));
    }
    cursor.order = Some(Order::Little);
    cursor.take(HEAD, "the file's head")?;
    let mut corners = Welded::default();
    for _ in 0..count {
        cursor.take(12, "a triangle's normal")?;
        let mut triangle = [0; 3];
        for corner in &mut triangle {
            let point = [cursor.f32(CORNER)?, cursor.f32(CORNER)?, cursor.f32(CORNER)?];
            *corner = corners.vertex(cursor.point(&point)?);
        }
        corners.mesh.triangles.push(triangle);
        cursor.take(2, "a triangle's attributes")?;
    }
    let notes = if found > length {
        vec![format!("{} bytes after the last triangle were left out", found - length)]
    } else {
        Vec::new()
    };
    Ok(TriangleFile { mesh: corners.mesh, notes })
}

/// What a vertex is called in errors.
const CORNER: &str = "a triangle's corner (x, y, z)";

/// Skips the name of a solid: the rest of its line, or up to a facet or the solid's end if the file is one line.
fn skip_name<'a>(words: &mut (impl Iterator<Item = &'a str> + Clone)) {
    let is = |word: Option<&str>, keyword| word.is_some_and(|word| word.eq_ignore_ascii_case(keyword));
    loop {
        let mut ahead = words.clone();
        let (word, after) = (ahead.next(), ahead.next());
        if word.is_none() || is(word, "endsolid") || is(word, "facet") && is(after, "normal") {
            return;
        }
        words.next();
    }
}

fn text(cursor: &mut Cursor) -> Result<TriangleFile> {
    let mut corners = Welded::default();
    // The corners of the triangle that is being read, and whether the file has ended its last solid.
    let (mut triangle, mut is_open): (Vec<u32>, bool) = (Vec::new(), false);
    while let Some(line) = cursor.next_filled() {
        let mut words = line.split_whitespace().peekable();
        while let Some(word) = words.next() {
            match word.to_lowercase().as_str() {
                "solid" => {
                    is_open = true;
                    skip_name(&mut words);
                }
                "endsolid" => {
                    is_open = false;
                    skip_name(&mut words);
                }
                "facet" if triangle.is_empty() => {
                    is_open = true;
                    if words.next_if(|word| word.eq_ignore_ascii_case("normal")).is_some() {
                        words.by_ref().take(3).for_each(drop);
                    }
                }
                "outer" if triangle.is_empty() => drop(words.next_if(|word| word.eq_ignore_ascii_case("loop"))),
                "vertex" => {
                    let point: Vec<f64> =
                        words.by_ref().take(3).map(|word| cursor.parse(word, CORNER)).collect::<Result<_>>()?;
                    triangle.push(corners.vertex(cursor.point(&point)?));
                }
                "endloop" => match triangle[..] {
                    [a, b, c] => {
                        corners.mesh.triangles.push([a, b, c]);
                        triangle.clear();
                    }
                    _ => return Err(cursor.error(format!("a facet has {} corners instead of three", triangle.len()))),
                },
                "endfacet" if triangle.is_empty() => {}
                "facet" | "outer" | "endfacet" => return Err(cursor.error("the last facet has no `endloop`")),
                other => return Err(cursor.error(format!("unknown keyword \"{}\"", short(other)))),
            }
        }
    }
    if is_open || !triangle.is_empty() {
        return Err(cursor.error("the file ends early, before `endsolid`"));
    }
    Ok(TriangleFile { mesh: corners.mesh, notes: Vec::new() })
}

/// A mesh in which corners at the same place are one vertex.
#[derive(Default)]
struct Welded {
    mesh: TriangleMesh,
    index: HashMap<[u64; 3], u32>,
}

impl Welded {
    /// Index of the vertex at this place.
    fn vertex(&mut self, point: DVec3) -> u32 {
        // Adding zero turns a negative zero into zero.
        let point = point + 0.0;
        *self.index.entry(point.to_array().map(f64::to_bits)).or_insert_with(|| {
            self.mesh.vertices.push(point);
            self.mesh.vertices.len() as u32 - 1
        })
    }
}
