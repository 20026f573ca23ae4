//! Whether a surface can be a skin: closed, manifold, consistently oriented, and fit for single precision. Depth is
//! measured between the insides of two skins, so each must have one. Called for every skin and tool surface.

use std::path::Path;

use glam::DVec3;

use super::obj::{TriangleMesh, triangle_lines};
use crate::{Error, Result};

/// Greatest magnitude of a coordinate: the product of four lengths must stay within single precision (3.4e38).
const LARGEST_COORDINATE: f64 = 1e9;
/// Spacing of f32 at the farthest coordinate against the mean edge, at most: a thousandth still leaves the shape.
const COARSEST: f64 = 1e-3;
/// Twice a triangle's area against its longest edge squared: less, and single precision has no normal for it.
const THINNEST: f64 = 1e-7;
/// A piece's volume against the cube of its box's diagonal: less is a sheet folded on itself, not a solid.
const FLATTEST: f64 = 1e-9;

/// Refuses a surface that cannot be a skin, with the count of what is wrong, its first place and a remedy.
///
/// The rule, in the order of the checks: coordinates that single precision can hold; no triangle without area; no
/// triangle twice; at most two triangles on an edge; neighbours wound alike; no open edge; and each connected piece
/// encloses a volume, positive unless it is a cavity within another piece's box. Open surfaces are refused whatever
/// they serve. Pieces may touch at a vertex and may pass through each other: inside is then where any piece says so.
/// Vertices that no triangle uses are allowed.
pub fn check_solid(mesh: &TriangleMesh, path: &Path) -> Result<()> {
    find_defect(mesh).map_err(|defect| {
        let lines = defect.triangle.and_then(|triangle| Some((triangle, triangle_lines(path).ok()?)));
        let line = lines.and_then(|(triangle, lines)| lines.get(triangle).map(|&line| line as usize));
        let place = defect.triangle.map(|triangle| format!(", first at triangle {triangle}")).unwrap_or_default();
        Error::input(path, line, format!("{}{place}", defect.problem), defect.remedy)
    })
}

/// What is wrong, at which triangle first, and what to do.
struct Defect {
    problem: String,
    triangle: Option<usize>,
    remedy: &'static str,
}

fn find_defect(mesh: &TriangleMesh) -> std::result::Result<(), Defect> {
    coordinates(mesh)?;
    areas(mesh)?;
    duplicates(mesh)?;
    let edges = Edges::new(mesh);
    edges.manifold()?;
    edges.oriented()?;
    edges.closed(mesh)?;
    volumes(mesh, &edges)
}

fn corners(mesh: &TriangleMesh, triangle: usize) -> [DVec3; 3] {
    mesh.triangles[triangle].map(|vertex| mesh.vertices[vertex as usize])
}

/// An error over all triangles of which `is_bad` holds.
fn refuse_where(
    mesh: &TriangleMesh,
    is_bad: impl Fn(usize) -> bool,
    what: &str,
    remedy: &'static str,
) -> std::result::Result<(), Defect> {
    let bad: Vec<usize> = (0..mesh.triangles.len()).filter(|&triangle| is_bad(triangle)).collect();
    match bad.first() {
        None => Ok(()),
        Some(&first) => Err(Defect { problem: format!("{} {what}", bad.len()), triangle: Some(first), remedy }),
    }
}

fn coordinates(mesh: &TriangleMesh) -> std::result::Result<(), Defect> {
    let corner = |&vertex: &u32| mesh.vertices[vertex as usize].abs().max_element();
    let greatest = mesh.triangles.iter().flatten().map(corner).fold(0.0, f64::max);
    if greatest > LARGEST_COORDINATE {
        let problem = format!("coordinates reach {greatest:.3e}, beyond {LARGEST_COORDINATE:e}");
        return Err(Defect { problem, triangle: None, remedy: "scale the file to a sensible unit, such as metres" });
    }
    let length = |triangle: usize| {
        let [a, b, c] = corners(mesh, triangle);
        (a.distance(b) + b.distance(c) + c.distance(a)) / 3.0
    };
    let mean_edge = (0..mesh.triangles.len()).map(length).sum::<f64>() / mesh.triangles.len().max(1) as f64;
    let spacing = greatest * f64::from(f32::EPSILON);
    if spacing > COARSEST * mean_edge {
        let problem = format!(
            "lies {greatest:.4} from the origin, where single precision steps by {spacing:.2e} and the mean edge is \
             {mean_edge:.2e}"
        );
        let remedy = "move the surface to the origin of its file and place it with `position`";
        return Err(Defect { problem, triangle: None, remedy });
    }
    Ok(())
}

fn areas(mesh: &TriangleMesh) -> std::result::Result<(), Defect> {
    let is_flat = |triangle: usize| {
        let [a, b, c] = corners(mesh, triangle);
        let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
        (b - a).cross(c - a).length() <= THINNEST * longest
    };
    refuse_where(mesh, is_flat, "triangles without area", "collapse or remove them (\"merge by distance\")")
}

fn duplicates(mesh: &TriangleMesh) -> std::result::Result<(), Defect> {
    let mut sorted: Vec<([u32; 3], usize)> = mesh
        .triangles
        .iter()
        .enumerate()
        .map(|(index, &corners)| {
            let mut key = corners;
            key.sort_unstable();
            (key, index)
        })
        .collect();
    sorted.sort_unstable();
    let again: Vec<usize> = sorted.windows(2).filter(|pair| pair[0].0 == pair[1].0).map(|pair| pair[1].1).collect();
    match again.iter().min() {
        None => Ok(()),
        Some(&first) => {
            let problem = format!("{} triangles given more than once", again.len());
            Err(Defect { problem, triangle: Some(first), remedy: "remove the copies" })
        }
    }
}

/// One triangle's use of an edge.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Use {
    low: u32,
    high: u32,
    triangle: usize,
    /// From the lower vertex to the higher.
    forward: bool,
}

/// All uses of edges, those of one edge next to each other.
struct Edges {
    uses: Vec<Use>,
    triangles: usize,
}

impl Edges {
    fn new(mesh: &TriangleMesh) -> Self {
        let edge = |(triangle, corners): (usize, &[u32; 3])| {
            let [a, b, c] = *corners;
            [(a, b), (b, c), (c, a)].map(|(from, to)| Use {
                low: from.min(to),
                high: from.max(to),
                triangle,
                forward: from < to,
            })
        };
        let mut uses: Vec<Use> = mesh.triangles.iter().enumerate().flat_map(edge).collect();
        uses.sort_unstable();
        Edges { uses, triangles: mesh.triangles.len() }
    }

    fn groups(&self) -> impl Iterator<Item = &[Use]> {
        self.uses.chunk_by(|a, b| (a.low, a.high) == (b.low, b.high))
    }

    /// How many edges are bad, and the first triangle at one.
    fn count(&self, is_bad: impl Fn(&[Use]) -> bool) -> Option<(usize, usize)> {
        let bad: Vec<usize> = self.groups().filter(|uses| is_bad(uses)).map(|uses| uses[0].triangle).collect();
        bad.iter().min().map(|&first| (bad.len(), first))
    }

    fn manifold(&self) -> std::result::Result<(), Defect> {
        let Some((count, first)) = self.count(|uses| uses.len() > 2) else { return Ok(()) };
        let problem = format!("{count} edges with more than two triangles");
        Err(Defect { problem, triangle: Some(first), remedy: "make the surface manifold: part the pieces at them" })
    }

    fn oriented(&self) -> std::result::Result<(), Defect> {
        let clash = |uses: &[Use]| uses.len() == 2 && uses[0].forward == uses[1].forward;
        let Some((count, first)) = self.count(clash) else { return Ok(()) };
        if !self.is_orientable() {
            let problem = "the surface has one side only and cannot be oriented".into();
            return Err(Defect { problem, triangle: Some(first), remedy: "give the surface of a solid" });
        }
        let problem = format!("{count} edges between triangles wound opposite ways");
        Err(Defect {
            problem,
            triangle: Some(first),
            remedy: "make all faces point outwards (\"recalculate normals\")",
        })
    }

    /// Whether turning some triangles over could make all neighbours agree: no cycle of neighbours contradicts itself.
    fn is_orientable(&self) -> bool {
        let mut forest = Forest::new(2 * self.triangles);
        // Node t is triangle t as it is, node t + n the same turned over.
        let n = self.triangles;
        for uses in self.groups().filter(|uses| uses.len() == 2) {
            let (a, b) = (uses[0].triangle, uses[1].triangle);
            let turned = if uses[0].forward == uses[1].forward { n } else { 0 };
            forest.join(a, b + turned);
            forest.join(a + n, b + n - turned);
        }
        (0..n).all(|triangle| forest.root(triangle) != forest.root(triangle + n))
    }

    fn closed(&self, mesh: &TriangleMesh) -> std::result::Result<(), Defect> {
        let Some((count, first)) = self.count(|uses| uses.len() == 1) else { return Ok(()) };
        // Neighbours that share positions and no vertices: what exporters without welding leave.
        let is_soup = count == 3 * mesh.triangles.len();
        let remedy = if is_soup { "weld vertices that coincide (\"merge by distance\")" } else { "close the holes" };
        Err(Defect {
            problem: format!("the surface is open: {count} edges with one triangle"),
            triangle: Some(first),
            remedy,
        })
    }
}

/// Disjoint sets.
struct Forest {
    parents: Vec<usize>,
}

impl Forest {
    fn new(count: usize) -> Self {
        Forest { parents: (0..count).collect() }
    }

    fn root(&mut self, mut at: usize) -> usize {
        while self.parents[at] != at {
            self.parents[at] = self.parents[self.parents[at]];
            at = self.parents[at];
        }
        at
    }

    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        self.parents[a.max(b)] = a.min(b);
    }
}

/// A connected piece of the surface.
struct Piece {
    first: usize,
    low: DVec3,
    high: DVec3,
    volume: f64,
}

fn pieces(mesh: &TriangleMesh, edges: &Edges) -> Vec<Piece> {
    let mut forest = Forest::new(mesh.triangles.len());
    for uses in edges.groups() {
        forest.join(uses[0].triangle, uses[uses.len() - 1].triangle);
    }
    let mut pieces: Vec<Piece> = Vec::new();
    let mut piece_of = vec![usize::MAX; mesh.triangles.len()];
    for triangle in 0..mesh.triangles.len() {
        let root = forest.root(triangle);
        let corners = corners(mesh, triangle);
        if piece_of[root] == usize::MAX {
            piece_of[root] = pieces.len();
            pieces.push(Piece { first: triangle, low: corners[0], high: corners[0], volume: 0.0 });
        }
        let piece = &mut pieces[piece_of[root]];
        for corner in corners {
            piece.low = piece.low.min(corner);
            piece.high = piece.high.max(corner);
        }
        // About a vertex of the piece itself, so that a far one keeps its digits.
        let origin = mesh.vertices[mesh.triangles[piece.first][0] as usize];
        let [a, b, c] = corners.map(|corner| corner - origin);
        piece.volume += a.dot(b.cross(c)) / 6.0;
    }
    pieces
}

fn volumes(mesh: &TriangleMesh, edges: &Edges) -> std::result::Result<(), Defect> {
    let pieces = pieces(mesh, edges);
    for piece in &pieces {
        let holds = |other: &Piece| {
            other.volume > 0.0 && other.low.cmplt(piece.low).all() && other.high.cmpgt(piece.high).all()
        };
        if piece.volume.abs() <= FLATTEST * (piece.high - piece.low).length().powi(3) {
            let problem = "a piece of the surface encloses no volume".into();
            return Err(Defect { problem, triangle: Some(piece.first), remedy: "remove it, or give it thickness" });
        }
        if piece.volume < 0.0 && !pieces.iter().any(holds) {
            let problem = format!("the surface is inside out: it encloses {:.3e}", piece.volume);
            return Err(Defect {
                problem,
                triangle: Some(piece.first),
                remedy: "reverse its faces (\"flip normals\")",
            });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tetrahedra, closed and wound outwards, or inwards where the edge given is negative.
    fn tetrahedra(places: &[(DVec3, f64)]) -> TriangleMesh {
        let mut mesh = TriangleMesh::default();
        for &(corner, edge) in places {
            let first = mesh.vertices.len() as u32;
            let size = edge.abs();
            mesh.vertices.extend([DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z].map(|v| corner + size * v));
            let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
            mesh.triangles.extend(faces.map(|[a, b, c]| {
                let face = if edge > 0.0 { [a, b, c] } else { [a, c, b] };
                face.map(|corner| first + corner)
            }));
        }
        mesh
    }

    fn answer(mesh: &TriangleMesh) -> String {
        check_solid(mesh, Path::new("none.obj")).err().map(|error| error.to_string()).unwrap_or_default()
    }

    #[test]
    fn a_cavity_within_a_solid_is_sound_and_beside_it_is_not() {
        let outer = (DVec3::ZERO, 10.0);
        assert_eq!(answer(&tetrahedra(&[outer, (DVec3::splat(1.0), -1.0)])), "");
        let beside = answer(&tetrahedra(&[outer, (DVec3::splat(20.0), -1.0)]));
        assert!(beside.contains("inside out") && beside.contains("first at triangle 4"), "{beside}");
        assert!(answer(&tetrahedra(&[(DVec3::ZERO, -1.0)])).contains("inside out"));
    }

    #[test]
    fn each_spoiled_face_is_seen() {
        let sound = tetrahedra(&[(DVec3::ZERO, 1.0), (DVec3::X, 1.0)]);
        assert_eq!(answer(&sound), "");
        type Spoil = fn(&mut TriangleMesh);
        let cases: [(Spoil, &str); 6] = [
            (|mesh| mesh.triangles[5].swap(0, 1), "3 edges between triangles wound opposite ways"),
            (|mesh| mesh.triangles.truncate(7), "open: 3 edges with one triangle, first at triangle 4"),
            (|mesh| mesh.triangles.push([3, 0, 1]), "1 triangles given more than once, first at triangle 8"),
            (|mesh| mesh.triangles[2] = [0, 3, 3], "1 triangles without area, first at triangle 2"),
            (|mesh| mesh.vertices[3].z = 1e-7, "2 triangles without area"),
            (|mesh| mesh.vertices.iter_mut().for_each(|v| v.x += 1e5), "single precision steps by"),
        ];
        for (spoil, words) in cases {
            let mut mesh = sound.clone();
            spoil(&mut mesh);
            assert!(answer(&mesh).contains(words), "{words}: {}", answer(&mesh));
        }
    }

    #[test]
    fn a_sheet_folded_on_itself_is_no_solid() {
        let mut mesh = tetrahedra(&[(DVec3::ZERO, 1.0)]);
        mesh.vertices[3] = DVec3::new(0.3, 0.3, 0.0);
        assert!(answer(&mesh).contains("encloses no volume"), "{}", answer(&mesh));
    }
}
