//! Second part of the repair of a surface, before it becomes the skin of a body: orients triangles outwards, and
//! decides whether the surface has an inside at all. To *turn* a triangle or a piece is to reverse its orientation; a
//! *piece* is a part of the surface that is connected across edges with two triangles. A hole is closed by a *fan*:
//! triangles from the edges of the hole's *rim* to a point in the middle of the rim.

use glam::DVec3;

use super::faces::Faces;
use super::report::{Count, RepairReport};
use super::topology::Edges;
use super::{Refusal, points};
use crate::prepare::distance::winding_number;
use crate::prepare::skin::Sets;

/// A piece is a sheet, not a solid, if its volume is at most this share of the cube of its bounding box's diagonal.
const FLATTEST: f64 = 1e-9;
/// Greatest area of the fans that close all holes, as a share of the surface's own area. The share is 1 for a nearly
/// flat sheet and 0.5 for half a sphere; if it is above 0.75, no point has a winding number clearly near 1.
const MOST_OPEN: f64 = 0.75;

/// Orients triangles and pieces outwards, and writes into the report: the numbers of defective edges (open, with more
/// than two triangles, or inconsistently oriented), of pieces and of holes, and the volume.
pub(super) fn orient(faces: &mut Faces, report: &mut RepairReport) -> Result<(), Refusal> {
    let edges = Edges::new(&faces.corners);
    let count_where = |is_counted: &dyn Fn(usize) -> bool| {
        let mut found = Count::default();
        let groups = edges.groups().filter(|uses| is_counted(uses.len()));
        groups.for_each(|uses| found.add(faces.origin[uses[0].triangle as usize]));
        found
    };
    report.boundary_edges = count_where(&|uses| uses == 1);
    report.non_manifold_edges = count_where(&|uses| uses > 2);
    for (a, _) in edges.pairs().filter(|(a, b)| a.forward == b.forward) {
        report.clashing_edges.add(faces.origin[a.triangle as usize]);
    }
    let (piece_of, count) = agree(faces, &edges, report)?;
    let mut pieces = pieces(faces, &piece_of, count);
    report.pieces = pieces.len();
    turn_outwards(faces, &mut pieces, report);
    judge(faces, report)
}

/// Turns triangles until the two triangles of each edge with two triangles are oriented consistently. In each piece the
/// triangles fall into two groups of opposite orientation, and the smaller group is turned (if both have the same size,
/// the group without the piece's first triangle). Returns the piece of each triangle and the number of pieces.
fn agree(faces: &mut Faces, edges: &Edges, report: &mut RepairReport) -> Result<(Vec<u32>, usize), Refusal> {
    let n = faces.corners.len();
    let mut joined = Sets::new(n);
    // Member t stands for triangle t in its given orientation, and member t + n for triangle t turned. Two members are
    // joined if their orientations are consistent.
    let mut sides = Sets::new(2 * n);
    for (a, b) in edges.pairs() {
        let (a, b, n, clash) = (a.triangle, b.triangle, n as u32, a.forward == b.forward);
        joined.join(a, b);
        sides.join(a, if clash { b + n } else { b });
        sides.join(a + n, if clash { b } else { b + n });
    }
    if let Some(first) = (0..n as u32).find(|&t| sides.find(t) == sides.find(t + n as u32)) {
        let problem = "the surface has one side only and cannot be oriented".into();
        let triangle = report.clashing_edges.first_triangle.or(Some(faces.origin[first as usize]));
        return Err(Refusal { problem, triangle, remedy: "give the surface of a solid" });
    }
    let (piece_of, count) = joined.labels();
    let mut first = vec![u32::MAX; count];
    piece_of.iter().enumerate().rev().for_each(|(t, &piece)| first[piece as usize] = t as u32);
    let differs: Vec<bool> =
        (0..n as u32).map(|t| sides.find(t) != sides.find(first[piece_of[t as usize] as usize])).collect();
    let (mut all, mut differing) = (vec![0_usize; count], vec![0_usize; count]);
    for (&piece, &differs) in piece_of.iter().zip(&differs) {
        all[piece as usize] += 1;
        differing[piece as usize] += usize::from(differs);
    }
    for (t, &piece) in piece_of.iter().enumerate() {
        let most_differ = 2 * differing[piece as usize] > all[piece as usize];
        if differs[t] != most_differ {
            faces.corners[t].swap(1, 2);
            report.turned_triangles += 1;
        }
    }
    Ok((piece_of, count))
}

/// A part of the surface that is connected across edges with two triangles, and its bounding box.
struct Piece {
    /// Indices of the piece's triangles, ascending.
    triangles: Vec<u32>,
    low: DVec3,
    high: DVec3,
    /// Signed volume with holes closed by fans, in the cube of the file's unit of length.
    volume: f64,
    turned: bool,
}

fn pieces(faces: &Faces, piece_of: &[u32], count: usize) -> Vec<Piece> {
    let empty =
        Piece { triangles: Vec::new(), low: DVec3::INFINITY, high: DVec3::NEG_INFINITY, volume: 0.0, turned: false };
    let mut pieces: Vec<Piece> = (0..count).map(|_| Piece { triangles: Vec::new(), ..empty }).collect();
    for (t, &piece) in piece_of.iter().enumerate() {
        let piece = &mut pieces[piece as usize];
        piece.triangles.push(t as u32);
        for corner in points(faces.vertices, faces.corners[t]) {
            (piece.low, piece.high) = (piece.low.min(corner), piece.high.max(corner));
        }
    }
    for piece in &mut pieces {
        piece.volume = volume(faces.vertices, &corners(faces, piece));
    }
    pieces
}

fn corners(faces: &Faces, piece: &Piece) -> Vec<[u32; 3]> {
    piece.triangles.iter().map(|&t| faces.corners[t as usize]).collect()
}

/// Turns pieces outwards, the piece with the largest volume first. A piece inside others is turned if the smallest
/// piece around it was turned; any other piece is turned if its volume is negative. Pieces without volume (sheets)
/// stay.
fn turn_outwards(faces: &mut Faces, pieces: &mut [Piece], report: &mut RepairReport) {
    let is_sheet = |piece: &Piece| piece.volume.abs() <= FLATTEST * (piece.high - piece.low).length().powi(3);
    let mut order: Vec<usize> = (0..pieces.len()).collect();
    order.sort_by(|&a, &b| pieces[b].volume.abs().total_cmp(&pieces[a].volume.abs()));
    for (place, &index) in order.iter().enumerate() {
        let piece = &pieces[index];
        let first = piece.triangles[0];
        if is_sheet(piece) {
            report.sheets.add(faces.origin[first as usize]);
            continue;
        }
        let centre = points(faces.vertices, faces.corners[first as usize]).into_iter().sum::<DVec3>() / 3.0;
        let around = order[..place].iter().rev().map(|&other| &pieces[other]).find(|other| {
            other.low.cmplt(piece.low).all()
                && other.high.cmpgt(piece.high).all()
                && winding_number(faces.vertices, &corners(faces, other), centre).abs() > 0.5
        });
        let turned = around.map_or(piece.volume < 0.0, |other| other.turned);
        report.cavities += usize::from(around.is_some() && (piece.volume < 0.0) != turned);
        if turned {
            report.turned_pieces.add(faces.origin[first as usize]);
            pieces[index].turned = true;
            pieces[index].triangles.iter().for_each(|&t| faces.corners[t as usize].swap(1, 2));
        }
    }
}

/// Writes holes and volume into the report, and refuses a surface without an inside.
fn judge(faces: &Faces, report: &mut RepairReport) -> Result<(), Refusal> {
    let (vertices, triangles) = closed(faces.vertices, &faces.corners);
    let (own, fans) = triangles.split_at(faces.corners.len());
    let area = |triangles: &[[u32; 3]]| triangles.iter().fold(0.0, |sum, &t| sum + area(points(&vertices, t)));
    report.holes = vertices.len() - faces.vertices.len();
    report.hole_area_share = if own.is_empty() { 0.0 } else { area(fans) / area(own) };
    report.volume = volume(faces.vertices, &faces.corners);
    let first = faces.origin.first().copied();
    let used = || own.iter().flatten().map(|&v| faces.vertices[v as usize]);
    let diagonal = used().fold(DVec3::NEG_INFINITY, DVec3::max) - used().fold(DVec3::INFINITY, DVec3::min);
    if own.is_empty() || report.volume <= FLATTEST * diagonal.length().powi(3) {
        let problem = "the surface encloses no volume".into();
        return Err(Refusal { problem, triangle: first, remedy: "give it thickness" });
    }
    if report.hole_area_share > MOST_OPEN {
        let share = 100.0 * report.hole_area_share;
        let problem = format!("the surface has no inside: its holes make up {share:.0} % of its area");
        return Err(Refusal { problem, triangle: first, remedy: "close it, or give it thickness" });
    }
    Ok(())
}

fn area([a, b, c]: [DVec3; 3]) -> f64 {
    (b - a).cross(c - a).length() / 2.0
}

/// Six times the signed volume of the tetrahedron of a triangle and the point `origin`.
fn under(origin: DVec3, corners: [DVec3; 3]) -> f64 {
    let [a, b, c] = corners.map(|corner| corner - origin);
    a.dot(b.cross(c))
}

/// Volume enclosed by the triangles and the fans over their holes, in the cube of the file's unit of length.
fn volume(vertices: &[DVec3], triangles: &[[u32; 3]]) -> f64 {
    // The volume is a sum over tetrahedra from each triangle to one point. This point is a vertex of the surface: with
    // a distant point large volumes would cancel in the sum.
    let origin = triangles.first().map_or(DVec3::ZERO, |t| vertices[t[0] as usize]);
    let fans = Fans::new(vertices, triangles);
    let own: f64 = triangles.iter().map(|&t| under(origin, points(vertices, t))).sum();
    let of_fan = |&([a, b], rim): &([u32; 2], u32)| {
        under(origin, [vertices[b as usize], vertices[a as usize], fans.centres[rim as usize]])
    };
    (own + fans.edges.iter().map(of_fan).sum::<f64>()) / 6.0
}

/// The fans that close a surface: the centre of each hole's rim, and the edges of all rims, directed as the surface's
/// triangles run along them.
struct Fans {
    centres: Vec<DVec3>,
    /// Edges (two vertices each), each with the index of its rim.
    edges: Vec<([u32; 2], u32)>,
}

impl Fans {
    /// An edge is unmatched if triangles run along it more often in one direction than in the other. A rim is a set of
    /// unmatched edges that are connected at vertices; its centre is the mean of its edges' midpoints, weighted by the
    /// edges' lengths. A rim need not be a simple loop: triangles from all its edges to the centre close the surface.
    fn new(vertices: &[DVec3], triangles: &[[u32; 3]]) -> Fans {
        let edges = Edges::new(triangles).unmatched();
        let mut ends: Vec<u32> = edges.iter().flatten().copied().collect();
        ends.sort_unstable();
        ends.dedup();
        let place = |vertex: u32| ends.partition_point(|&end| end < vertex);
        let mut rims = Sets::new(ends.len());
        edges.iter().for_each(|&[a, b]| rims.join(place(a) as u32, place(b) as u32));
        let (rim_of, count) = rims.labels();
        let edges: Vec<([u32; 2], u32)> = edges.into_iter().map(|edge| (edge, rim_of[place(edge[0])])).collect();
        let mut sums = vec![(DVec3::ZERO, 0.0); count];
        for &([a, b], rim) in &edges {
            let (from, to) = (vertices[a as usize], vertices[b as usize]);
            // The weight is above zero, so that a rim without length also has a centre.
            let weight = from.distance(to).max(f64::MIN_POSITIVE);
            let sum = &mut sums[rim as usize];
            *sum = (sum.0 + weight * (from + to) / 2.0, sum.1 + weight);
        }
        Fans { centres: sums.iter().map(|(sum, weight)| *sum / *weight).collect(), edges }
    }
}

/// The surface with every hole closed by a fan of triangles from the hole's rim to the rim's centre. It serves for
/// integrals over the inside (volume, mass) and for filling with cells and voxels, never for contact. The given
/// vertices and triangles come first, unchanged; a closed surface gets no fan.
pub fn closed(vertices: &[DVec3], triangles: &[[u32; 3]]) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let fans = Fans::new(vertices, triangles);
    let first = vertices.len() as u32;
    let of_fan = fans.edges.iter().map(|&([a, b], rim)| [b, a, first + rim]);
    let triangles = triangles.iter().copied().chain(of_fan).collect();
    ([vertices, &fans.centres].concat(), triangles)
}
