//! Narrow phase in f64: how deep each skin vertex lies below the other body's skin, found by exact rays, or how deep
//! each triangle overlaps the other body, and the resulting contacts. Reference implementation of the depth and contact
//! stages of a step.
//!
//! A contact patch is an area in which bodies A and B may touch, with one normal. A skin (surface mesh of a body)
//! "gathers" contacts if its vertices or triangles are tested and become contacts.

use std::collections::BTreeMap;

use glam::DVec3;
use palpate::internal::prepare::{Body, Embedding, Layer, Shape};
use palpate::internal::stages::{samples, tips};
use palpate::scene::{self, Sides};

use crate::contact_law::mean_edge;
use crate::overlap::{self, Overlap};
use crate::rays::{RayHit, Rays};
use crate::skin;

/// Hit of a skin vertex's ray, along the normal of the contact patch, on the other skin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Penetration depth along the normal, m, positive.
    pub depth: f64,
    /// Index of the triangle of the other skin that is hit.
    pub triangle: u32,
    /// Barycentric coordinates of the hit on the triangle.
    pub barycentric: [f64; 3],
}

/// What moves a point of contact.
#[derive(Debug, Clone, PartialEq)]
pub enum Carrier {
    /// Nodes of a soft body (index into the simulation's bodies) with weights; each node once.
    Nodes(usize, Vec<(u32, f64)>),
    /// The rigid tool.
    Tool,
    /// A body that does not move.
    Fixed,
}

/// A point of contact on one of the two bodies.
#[derive(Debug, Clone, PartialEq)]
pub struct Point {
    /// World position, m.
    pub position: DVec3,
    /// What moves the point.
    pub carrier: Carrier,
}

/// A contact. The force on body A at `first` is -area (k depth + d depth') normal, with stiffness k, damping d and the
/// depth's rate depth'; the opposite force acts on body B at `second`.
#[derive(Debug, Clone, PartialEq)]
pub struct Contact {
    /// Unit normal from body A to body B.
    pub normal: DVec3,
    /// Area of the contact, projected on the normal, m^2.
    pub area: f64,
    /// Penetration depth, m: normal . (first - second).
    pub depth: f64,
    /// Penalty stiffness per projected area, N/m^3.
    pub stiffness: f64,
    /// Penalty damping per projected area, N s/m^3.
    pub damping: f64,
    /// The contact's point on body A.
    pub first: Point,
    /// The contact's point on body B.
    pub second: Point,
    /// Whether the vertex or triangle that became this contact belongs to body A.
    pub of_first: bool,
    /// What of a skin became this contact.
    pub tested: Tested,
}

/// What of a skin became a contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Tested {
    /// The vertex of this index.
    Vertex(u32),
    /// The triangle of this index.
    Triangle(u32),
}

/// Parameters of the penalty contact between two bodies.
#[derive(Debug, Clone, Copy)]
pub struct ContactLaw {
    /// Stiffness per projected area, N/m^3.
    pub stiffness: f64,
    /// Damping per projected area, N s/m^3.
    pub damping: f64,
    /// Penetration depth above which a vertex is no contact, m; triangles have no such limit.
    pub depth_limit: f64,
}

/// A skin at its present position.
#[derive(Debug, Clone)]
pub struct Surface<'a> {
    /// World positions of the vertices, m.
    pub positions: Vec<DVec3>,
    /// Triangles, counter-clockwise from outside.
    pub triangles: &'a [[u32; 3]],
    /// Rest area of each vertex, m^2.
    pub areas: &'a [f64],
    /// What moves the vertices.
    pub support: Support<'a>,
}

/// What moves a skin.
#[derive(Debug, Clone, Copy)]
pub enum Support<'a> {
    /// A soft body: its index in the simulation, its layer (tetrahedral mesh), and for each vertex its tetrahedron and
    /// weights.
    Soft(usize, &'a Layer, &'a [Embedding]),
    /// The rigid tool.
    Tool,
    /// A body at rest.
    Fixed,
}

impl Surface<'_> {
    /// The point that is the weighted mean of vertices, each given with its weight.
    fn point(&self, vertices: &[(u32, f64)]) -> Point {
        let position = vertices.iter().map(|(v, w)| self.positions[*v as usize] * *w).sum();
        let carrier = match self.support {
            Support::Tool => Carrier::Tool,
            Support::Fixed => Carrier::Fixed,
            Support::Soft(body, layer, embedding) => {
                let mut nodes = BTreeMap::new();
                for (v, w) in vertices {
                    let e = &embedding[*v as usize];
                    for (node, weight) in layer.tetrahedra[e.tetrahedron as usize].iter().zip(e.weights) {
                        *nodes.entry(*node).or_insert(0.0) += w * weight;
                    }
                }
                Carrier::Nodes(body, nodes.into_iter().collect())
            }
        };
        Point { position, carrier }
    }
}

/// Depths of the vertices of A within B. A vertex whose normal points along `normal` (unit, from A to B) has a ray
/// along -`normal`. Of the triangles of B that the ray hits, front or back, the nearest decides: if the ray leaves B
/// there, the vertex lies within B, and its depth is the distance to the hit, where that is at most `depth_limit`;
/// triangles of B further away do not matter. For the depths of the vertices of B within A, this function is called
/// with -normal and with the bodies swapped.
pub fn ray_depths(
    normal: DVec3,
    a_positions: &[DVec3],
    a_triangles: &[[u32; 3]],
    b_positions: &[DVec3],
    b_triangles: &[[u32; 3]],
    depth_limit: f64,
) -> Vec<Option<Hit>> {
    let rays = Rays::new(normal, b_positions, b_triangles);
    let facing = skin::normals(a_positions, a_triangles);
    let hit = |(x, m): (&DVec3, &DVec3)| {
        let first = if m.dot(normal) > 0.0 { rays.first(*x)? } else { return None };
        let RayHit { depth, triangle, barycentric, leaves } = first;
        (leaves && depth <= depth_limit).then_some(Hit { depth, triangle, barycentric })
    };
    a_positions.iter().zip(&facing).map(hit).collect()
}

/// Stiffer contact at tips and edges of a rigid body.
#[derive(Debug, Clone, PartialEq)]
pub struct Tips {
    /// Factor of the stiffness for each triangle of the rigid body.
    pub stiffening: Vec<f64>,
    /// Whether the damping has the same factors.
    pub damps: bool,
}

/// What of the skins of a soft body and the tool is tested for contact.
#[derive(Debug, Clone, PartialEq)]
pub enum Gathering {
    /// Vertices of both skins.
    Both,
    /// Vertices of the finer skin.
    Finer,
    /// Triangles of the soft body's skin.
    Triangles(Tips),
}

impl Gathering {
    /// What the engine tests, by a scene's settings. The choice and the factors of tips are the engine's own, which its
    /// unit tests check.
    pub fn chosen(settings: &scene::Contact, body: &Body, tool: &Body) -> Gathering {
        let (Shape::Soft { layer, .. }, Shape::Rigid { skin, .. }) = (&body.shape, &tool.shape) else {
            return Gathering::Both;
        };
        if samples::side_by_triangles(settings.samples, [body, tool]).is_some() {
            let stiffens = settings.stiffness.is_none();
            let of_tool = tips::stiffening(skin, mean_edge(layer));
            let stiffening = of_tool.into_iter().map(|factor| if stiffens { f64::from(factor) } else { 1.0 }).collect();
            return Gathering::Triangles(Tips { stiffening, damps: settings.damping.is_none() });
        }
        if settings.sides == Sides::One { Gathering::Finer } else { Gathering::Both }
    }

    /// Contacts of the soft body, A, and the tool, B, along the normal of a contact patch.
    pub fn contacts(&self, normal: DVec3, a: &Surface, b: &Surface, law: &ContactLaw) -> Vec<Contact> {
        match self {
            Gathering::Both => gather(normal, a, b, law),
            Gathering::Finer => gather_finer(normal, a, b, law),
            Gathering::Triangles(tips) => gather_triangles(normal, a, b, law, tips),
        }
    }
}

/// Contacts of two skins along the normal of a contact patch: first those of A's vertices, then those of B's, each in
/// ascending order of the vertices. All areas are halved, because vertices of both skins become contacts.
pub fn gather(normal: DVec3, a: &Surface, b: &Surface, law: &ContactLaw) -> Vec<Contact> {
    let mut contacts = gather_side(normal, a, b, law, true, 0.5);
    contacts.extend(gather_side(-normal, b, a, law, false, 0.5));
    contacts
}

/// Contacts of two skins if only the finer skin gathers, with its whole area: the skin with less area per vertex, or
/// A's skin where these areas are equal.
pub fn gather_finer(normal: DVec3, a: &Surface, b: &Surface, law: &ContactLaw) -> Vec<Contact> {
    let mean_area = |surface: &Surface| surface.areas.iter().sum::<f64>() / surface.areas.len() as f64;
    if mean_area(b) < mean_area(a) {
        gather_side(-normal, b, a, law, false, 1.0)
    } else {
        gather_side(normal, a, b, law, true, 1.0)
    }
}

fn gather_side(
    outward: DVec3,
    own: &Surface,
    other: &Surface,
    law: &ContactLaw,
    of_first: bool,
    share: f64,
) -> Vec<Contact> {
    let hits = ray_depths(outward, &own.positions, own.triangles, &other.positions, other.triangles, law.depth_limit);
    let facing = skin::normals(&own.positions, own.triangles);
    let contact = |(vertex, hit): (usize, Hit)| {
        let corners = other.triangles[hit.triangle as usize];
        let mine = own.point(&[(vertex as u32, 1.0)]);
        let weights: [(u32, f64); 3] = std::array::from_fn(|k| (corners[k], hit.barycentric[k]));
        let theirs = other.point(&weights);
        let (first, second) = if of_first { (mine, theirs) } else { (theirs, mine) };
        Contact {
            normal: if of_first { outward } else { -outward },
            area: share * own.areas[vertex] * facing[vertex].dot(outward),
            depth: hit.depth,
            stiffness: law.stiffness,
            damping: law.damping,
            first,
            second,
            of_first,
            tested: Tested::Vertex(vertex as u32),
        }
    };
    hits.into_iter().enumerate().filter_map(|(v, hit)| Some((v, hit?))).map(contact).collect()
}

/// Contacts of two skins if the triangles of A's are tested: one for each triangle that overlaps B, at the centre of
/// pressure, with the mean depth and with the area of the overlap. B must be rigid and convex.
pub fn gather_triangles(normal: DVec3, a: &Surface, b: &Surface, law: &ContactLaw, tips: &Tips) -> Vec<Contact> {
    let found = overlap::overlaps(normal, &a.positions, a.triangles, &b.positions, b.triangles, &tips.stiffening);
    let contact = |(triangle, overlap): (usize, Overlap)| {
        let position = overlap.moment / overlap.stiff_volume;
        let corners = a.triangles[triangle];
        let [p, q, r] = corners.map(|v| a.positions[v as usize] - position);
        let shares = [q.cross(r), r.cross(p), p.cross(q)].map(|area| area.dot(normal));
        let weights = std::array::from_fn::<_, 3, _>(|k| (corners[k], shares[k] / shares.iter().sum::<f64>()));
        let factor = overlap.stiff_volume / overlap.volume;
        Contact {
            normal,
            area: overlap.area,
            depth: overlap.volume / overlap.area,
            stiffness: factor * law.stiffness,
            damping: if tips.damps { factor } else { 1.0 } * law.damping,
            first: a.point(&weights),
            second: Point {
                position: position - overlap.volume / overlap.area * normal,
                carrier: b.point(&[]).carrier,
            },
            of_first: true,
            tested: Tested::Triangle(triangle as u32),
        }
    };
    found.into_iter().enumerate().filter(|(_, overlap)| overlap.volume > 0.0).map(contact).collect()
}

/// Contacts of a skin with the fixed half-space `plane . x <= offset`, where `plane` is a unit normal. Only the skin
/// gathers, with its whole area.
pub fn gather_plane(a: &Surface, plane: DVec3, offset: f64, law: &ContactLaw) -> Vec<Contact> {
    let facing = skin::normals(&a.positions, a.triangles);
    let contact = |(vertex, x): (usize, &DVec3)| {
        let depth = offset - plane.dot(*x);
        let towards = -facing[vertex].dot(plane);
        (towards > 0.0 && depth > 0.0 && depth <= law.depth_limit).then(|| Contact {
            normal: -plane,
            area: a.areas[vertex] * towards,
            depth,
            stiffness: law.stiffness,
            damping: law.damping,
            first: a.point(&[(vertex as u32, 1.0)]),
            second: Point { position: *x + depth * plane, carrier: Carrier::Fixed },
            of_first: true,
            tested: Tested::Vertex(vertex as u32),
        })
    };
    a.positions.iter().enumerate().filter_map(contact).collect()
}
