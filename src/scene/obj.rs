//! Reads triangle meshes from Wavefront OBJ files and writes them. The files that are written hold skins as prepared for the simulation (repaired, for example), and skins as deformed at the end of a run.
//!
//! The parser is our own, because the tobj crate drops unused vertices, orders the others by first use, does not
//! support continuation lines (a line that ends in a backslash goes on in the next one) and reports no line numbers. A
//! scene needs all vertices in file order, continuation lines, and line numbers in errors. The format is described in
//! Wavefront's "Object Files (.obj)", appendix B1 of the Advanced Visualizer manual; only `v` lines (vertices) and `f`
//! lines (faces) matter to a skin, and all others are ignored.

use std::io::Write;
use std::path::Path;

use glam::DVec3;

use super::cursor::{BYTE_ORDER_MARK, LARGEST};
use super::triangles::TriangleMesh;
use super::triangulate::triangulate;
use crate::{Error, Result, files};

const REMEDY: &str = "give an OBJ file";

/// Reads an OBJ file: polygons are cut into triangles, the groups and objects of the file are joined into one mesh, and
/// vertices stay in file order. Every coordinate of the result is finite, and every index is that of a vertex.
pub(super) fn read(path: &Path) -> Result<TriangleMesh> {
    Ok(parse(&text(path)?, path)?.mesh)
}

/// Returns, for each triangle of an OBJ file, the one-based number of the line whose face contains the triangle.
pub(super) fn triangle_lines(path: &Path) -> Result<Vec<u32>> {
    Ok(parse(&text(path)?, path)?.lines)
}

/// The text of a file; bytes that are no text are replaced.
fn text(path: &Path) -> Result<String> {
    let bytes = files::mesh(path, REMEDY)?;
    Ok(String::from_utf8_lossy(bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(&bytes)).into_owned())
}

/// The mesh of a file, and for each triangle the one-based number of the line whose face contains it.
struct Parsed {
    mesh: TriangleMesh,
    lines: Vec<u32>,
}

/// A face whose vertex indices (zero-based) have not yet been compared with the number of vertices.
struct Face {
    corners: Vec<i64>,
    line: usize,
}

fn parse(text: &str, path: &Path) -> Result<Parsed> {
    let mut vertices = Vec::new();
    let mut faces = Vec::new();
    for (line, content) in logical_lines(text) {
        let mut words = content.split_whitespace();
        match words.next() {
            Some("v") => vertices.push(vertex(words).map_err(|problem| {
                Error::input(path, Some(line), problem, "give each vertex three finite coordinates")
            })?),
            Some("f") => {
                let corners = face(words, vertices.len()).map_err(|problem| {
                    Error::input(path, Some(line), problem, "give each face three or more vertices, counted from 1")
                })?;
                faces.push(Face { corners, line });
            }
            _ => {}
        }
    }
    if vertices.is_empty() {
        return Err(Error::input(path, None, "has no vertices (`v` lines)", "export the surface as OBJ again"));
    }
    if faces.is_empty() {
        return Err(Error::input(path, None, "has no faces (`f` lines)", "export the surface with its faces"));
    }
    let mut parsed = Parsed { mesh: TriangleMesh { vertices, triangles: Vec::new() }, lines: Vec::new() };
    for face in &faces {
        let count = parsed.mesh.vertices.len();
        let corners: Vec<u32> = face.corners.iter().filter_map(|&i| u32::try_from(i).ok()).collect();
        if let Some(bad) = face.corners.iter().find(|&&corner| corner < 0 || corner >= count as i64) {
            let problem = format!("a face names vertex {}, but there are {count} vertices", bad + 1);
            return Err(Error::input(path, Some(face.line), problem, "correct the index, or export again"));
        }
        triangulate(&parsed.mesh.vertices, &corners, &mut parsed.mesh.triangles);
        parsed.lines.resize(parsed.mesh.triangles.len(), face.line as u32);
    }
    Ok(parsed)
}

/// Returns the lines of a text with their one-based numbers, comments removed. A line that ends in a backslash is
/// joined with the next one and keeps its own number.
fn logical_lines(text: &str) -> impl Iterator<Item = (usize, String)> {
    let mut lines = text.lines().enumerate();
    std::iter::from_fn(move || {
        let (index, first) = lines.next()?;
        let mut joined = first.split('#').next().unwrap_or_default().trim_end().to_string();
        while joined.ends_with('\\') {
            joined.pop();
            joined.push(' ');
            let Some((_, next)) = lines.next() else { break };
            joined.push_str(next.split('#').next().unwrap_or_default().trim_end());
        }
        Some((index + 1, joined))
    })
}

/// Parses the words `x y z` of a `v` line as a position; further words (a weight, a colour) are ignored.
fn vertex<'a>(words: impl Iterator<Item = &'a str>) -> std::result::Result<DVec3, String> {
    let mut coordinates = Vec::with_capacity(3);
    for word in words.take(3) {
        let number: f64 = word.parse().map_err(|_| format!("`{}` is not a number", word.escape_debug()))?;
        if !number.is_finite() || number.abs() > LARGEST {
            return Err(format!("coordinate `{}` is not a finite number in range", word.escape_debug()));
        }
        coordinates.push(number);
    }
    match coordinates[..] {
        [x, y, z] => Ok(DVec3::new(x, y, z)),
        _ => Err(format!("a vertex with {} coordinates", coordinates.len())),
    }
}

/// Parses the words of an `f` line as zero-based vertex indices. Each word is `v`, `v/vt`, `v//vn` or `v/vt/vn`; a
/// negative index `v` counts back from the last of the `vertices` vertices read so far.
fn face<'a>(words: impl Iterator<Item = &'a str>, vertices: usize) -> std::result::Result<Vec<i64>, String> {
    let mut corners = Vec::with_capacity(4);
    for word in words {
        let first = word.split('/').next().unwrap_or_default();
        let index: i64 = first.parse().map_err(|_| format!("`{}` is not a vertex index", word.escape_debug()))?;
        match index {
            0 => return Err("a face names vertex 0".into()),
            1.. => corners.push(index - 1),
            _ if index.unsigned_abs() > vertices as u64 => {
                return Err(format!("a face names vertex {index}, but only {vertices} vertices come before it"));
            }
            _ => corners.push(vertices as i64 + index),
        }
    }
    if corners.len() < 3 { Err(format!("a face with {} vertices", corners.len())) } else { Ok(corners) }
}

/// Writes a triangle mesh as an OBJ file. Coordinates have nine significant digits, so that single-precision values are
/// read back unchanged.
pub fn write(w: &mut impl Write, vertices: &[DVec3], triangles: &[[u32; 3]]) -> std::io::Result<()> {
    for v in vertices {
        writeln!(w, "v {:.8e} {:.8e} {:.8e}", v.x, v.y, v.z)?;
    }
    for [a, b, c] in triangles.iter().map(|triangle| triangle.map(|vertex| vertex + 1)) {
        writeln!(w, "f {a} {b} {c}")?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mesh(text: &str) -> Result<TriangleMesh> {
        parse(text, Path::new("test.obj")).map(|parsed| parsed.mesh)
    }

    #[test]
    fn dialects_are_read_alike() {
        let text = "o a\r\nv 0 0 0 1.0 # first\r\nv 1 0 0\r\nv 1 1 0\r\nv 0 1 0\r\nv 9 9 9\r\nvt 0 0\r\nvn 0 0 1\r\n\
                    g one\r\nf 4/1/1 3/1/1 2/1/1 \\\r\n 1/1/1\r\ng two\r\nf -5//1 -4//-1 -2//1\r\nf 1/7 2/7 3/7";
        let mesh = mesh(text).unwrap();
        assert_eq!(mesh.vertices.len(), 5, "unused vertices must be kept");
        assert_eq!(mesh.triangles, [[3, 2, 1], [3, 1, 0], [0, 1, 3], [0, 1, 2]]);
    }

    #[test]
    fn errors_name_their_line() {
        let head = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
        let cases = [
            ("f 1 2 4", ":4:", "vertex 4, but there are 3"),
            ("f 0 1 2", ":4:", "vertex 0"),
            ("f -4 1 2", ":4:", "vertex -4"),
            ("f 1 2 99999999999999999999", ":4:", "not a vertex index"),
            ("f 1 2", ":4:", "2 vertices"),
            ("v 1 2", ":4:", "2 coordinates"),
            ("v 1 nan 3", ":4:", "not a finite number"),
            ("v 1 -1e400 3", ":4:", "not a finite number"),
            ("v 1 x 3", ":4:", "not a number"),
            ("", "", "no faces"),
        ];
        for (line, place, words) in cases {
            let message = mesh(&format!("{head}{line}")).unwrap_err().to_string();
            assert!(message.contains(place) && message.contains(words), "line `{line}` gives the error: {message}");
        }
        assert!(mesh("# nothing").unwrap_err().to_string().contains("no vertices"));
    }

    #[test]
    fn what_is_written_comes_back() {
        let vertices = [DVec3::new(0.1, -2e-7, 3e5), DVec3::X, DVec3::new(1.0 / 3.0, 1.0, 0.0)];
        let mut bytes = Vec::new();
        write(&mut bytes, &vertices, &[[0, 1, 2]]).unwrap();
        let back = mesh(&String::from_utf8(bytes).unwrap()).unwrap();
        assert_eq!(back.triangles, [[0, 1, 2]]);
        for (a, b) in vertices.iter().zip(&back.vertices) {
            assert_eq!(a.as_vec3(), b.as_vec3());
        }
    }
}
