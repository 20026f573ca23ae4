//! Compares the answer of a proximity query (the vertices of two bodies that lie inside the other body, and their
//! depths) with f64 ray casts along the query's own normals; used by `agreement.rs`. A contact patch is a place and a
//! normal at which the two bodies may touch; the place is a rectangle in a plane across the normal.

use glam::{DQuat, DVec3};
use palpate::QueryContact;
use palpate::internal::prepare::{Body, Proxy, Shape, Skin};
use palpate::internal::query::Answer;
use palpate::internal::shaders::ContactPatch;
use palpate_oracle::rays::{Outline, Rays};
use palpate_oracle::skin::normals;

use crate::harness::bodies::{Mesh, rigid};

/// Width of the surroundings of a discontinuity of the answer. A vertex in them is not compared, since rounding decides
/// whether it is a contact. The width is a distance relative to the smaller body's size or, for directions, a
/// difference of unit vectors.
pub const APART: f64 = 1e-5;
/// Greatest number of differences that a report describes.
const NAMED: usize = 20;
/// Least cosine between two normals that count as equal.
const SAME: f64 = 1.0 - 1e-9;

pub type Pose = (DVec3, DQuat);

/// A body, with the size and the middle of its bounding box at rest, m.
pub struct Subject {
    pub name: String,
    pub body: Body,
    pub size: f64,
    middle: DVec3,
}

impl Subject {
    pub fn new(name: &str, mesh: Mesh, cut: fn(&Skin) -> Vec<Proxy>) -> Subject {
        let low = mesh.0.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let high = mesh.0.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
        let body = rigid(name, mesh, cut, DVec3::ZERO, DQuat::IDENTITY);
        Subject { name: name.into(), body, size: (high - low).max_element(), middle: 0.5 * (low + high) }
    }

    pub fn skin(&self) -> &Skin {
        let Shape::Rigid { skin, .. } = &self.body.shape else { panic!("the body is not rigid") };
        skin
    }

    pub fn placed(&self, (position, orientation): Pose) -> Vec<DVec3> {
        self.skin().vertices.iter().map(|x| position + orientation * *x).collect()
    }

    /// The pose that turns the body about its middle and puts the middle at `place`.
    pub fn pose(&self, turn: DQuat, place: DVec3) -> Pose {
        (place - turn * self.middle, turn)
    }
}

/// Results of comparisons of the query with ray casts, of one query or summed over several.
#[derive(Debug, Default, Clone)]
pub struct Tally {
    pub queries: usize,
    pub contacts: usize,
    /// Greatest error of a depth, relative to the smaller body's size.
    pub worst: f64,
    pub where_worst: String,
    /// Number of colliding vertices that only the rays find.
    pub missing: usize,
    /// Number of colliding vertices that only the query finds.
    pub extra: usize,
    /// Descriptions of the first differences.
    pub different: Vec<String>,
    /// Number of vertices that are not compared, since rounding decides about them.
    pub apart: usize,
    /// Number of queries whose answer has flags.
    pub flagged: usize,
    /// Depth along the normal divided by the distance to the other surface, for each contact.
    pub ratios: Vec<f64>,
}

impl Tally {
    pub fn add(&mut self, other: Tally) {
        self.queries += other.queries;
        self.contacts += other.contacts;
        if other.worst > self.worst {
            (self.worst, self.where_worst) = (other.worst, other.where_worst);
        }
        self.missing += other.missing;
        self.extra += other.extra;
        self.different.extend(other.different);
        self.different.truncate(NAMED);
        self.apart += other.apart;
        self.flagged += other.flagged;
        self.ratios.extend(other.ratios);
    }

    /// Adds the description of a difference between query and ray cast. It names the vertex that only one of them
    /// finds, the contact that the query reports, if any, and what the ray hits. The cosine in it is that of the angle
    /// between the vertex's normal and the ray.
    fn tell(&mut self, difference: impl FnOnce() -> String) {
        if self.different.len() < NAMED {
            self.different.push(difference());
        }
    }

    pub fn row(&self, name: &str) {
        let Tally { queries, contacts, worst, missing, extra, apart, flagged, .. } = self;
        println!(
            "{name:<22} {queries:>7} {contacts:>9} {worst:>11.1e} {missing:>7} {extra:>5} {apart:>5} {flagged:>7}"
        );
    }
}

/// Prints the heading of the table whose lines `Tally::row` prints.
pub fn head() {
    println!(
        "error/size: greatest error of a depth, relative to the smaller body's size; missing: vertices found only by \
         rays; extra: vertices found only by the query; apart: vertices not compared; flagged: queries with flags\n\
         mesh pair              queries  contacts  error/size missing extra apart flagged"
    );
}

/// Ray casts along one normal, from the vertices of one body against the skin (surface mesh) of the other.
struct Seen<'a> {
    rays: Rays<'a>,
    outline: Outline,
    /// The normal, pointing out of the body from whose vertices the rays start.
    normal: DVec3,
}

/// The vertices of one body, to be compared with ray casts against the other.
struct Side<'a> {
    name: &'a str,
    positions: &'a [DVec3],
    facing: Vec<DVec3>,
    seen: Vec<Seen<'a>>,
}

/// True if a vertex (relative to the answer's origin) projects into the rectangle of a contact patch: a patch has
/// contacts only in its rectangle.
fn holds(contact_patch: &ContactPatch, x: DVec3) -> bool {
    let along = |axis: [f32; 3]| x.dot(DVec3::from(axis.map(f64::from)));
    let at = [along(contact_patch.tangent), along(contact_patch.bitangent)];
    (0..2).all(|k| at[k] >= contact_patch.low[k].into() && at[k] <= contact_patch.high[k].into())
}

fn normal_of(contact_patch: &ContactPatch) -> DVec3 {
    DVec3::from(contact_patch.normal.map(f64::from)).normalize()
}

/// Compares an answer with ray casts and returns the results. The query may leave out contacts deeper than `limit` (m).
pub fn judge(what: &str, subjects: [&Subject; 2], poses: [Pose; 2], answer: &Answer, limit: f64) -> Tally {
    let size = subjects[0].size.min(subjects[1].size);
    let positions = [0, 1].map(|k| subjects[k].placed(poses[k]));
    let mut tally = Tally { queries: 1, flagged: usize::from(answer.flags.0 != 0), ..Tally::default() };
    tally.contacts = answer.contacts.len();
    let mut known: Vec<DVec3> = Vec::new();
    for normal in answer.contact_patches.iter().map(normal_of).chain(answer.contacts.iter().map(|c| c.normal)) {
        if !known.iter().any(|other| other.dot(normal) > SAME) {
            known.push(normal);
        }
    }
    for k in 0..2 {
        let (other, triangles) = (&positions[1 - k], &subjects[1 - k].skin().triangles);
        let sign = if k == 0 { 1.0 } else { -1.0 };
        let see = |normal: &DVec3| Seen {
            rays: Rays::new(sign * *normal, other, triangles),
            outline: Outline::new(sign * *normal, other, triangles, APART * size),
            normal: sign * *normal,
        };
        let side = Side {
            name: &subjects[k].name,
            positions: &positions[k],
            facing: normals(&positions[k], &subjects[k].skin().triangles),
            seen: known.iter().map(see).collect(),
        };
        let mut found: Vec<Option<&QueryContact>> = vec![None; side.positions.len()];
        for contact in answer.contacts.iter().filter(|contact| contact.body == k) {
            let twice = found[contact.vertex as usize].replace(contact);
            assert!(twice.is_none(), "{what}: vertex {} of {} is reported twice", contact.vertex, side.name);
        }
        for (v, contact) in found.into_iter().enumerate() {
            match contact {
                Some(contact) => side.found(what, v, contact, size, &mut tally),
                None => side.not_found(what, v, answer, (size, limit), &mut tally),
            }
        }
    }
    tally
}

impl Side<'_> {
    /// Checks a vertex that is a contact: the ray from it along the normal must leave the other body, at the contact's
    /// depth.
    fn found(&self, what: &str, v: usize, contact: &QueryContact, size: f64, tally: &mut Tally) {
        let of = |seen: &&Seen| contact.normal.dot(seen.normal).abs() > SAME;
        let Some(seen) = self.seen.iter().find(of) else { panic!("{what}: no ray has the normal of {contact:?}") };
        let (x, facing) = (self.positions[v], self.facing[v].dot(seen.normal));
        let ray_hit = seen.rays.first(x);
        let inside = ray_hit.filter(|ray_hit| ray_hit.leaves && facing > 0.0);
        let touches = contact.depth < APART * size && ray_hit.is_none_or(|c| !c.leaves || c.depth < APART * size);
        if touches || facing.abs() < APART || seen.outline.is_near(x) {
            tally.apart += 1;
        } else if let Some(ray_hit) = inside {
            let error = (contact.depth - ray_hit.depth).abs() / size;
            if error > tally.worst {
                (tally.worst, tally.where_worst) = (error, format!("{what}: {contact:?}, by ray {ray_hit:?}"));
            }
        } else {
            tally.extra += 1;
            tally.tell(|| format!("{what}: vertex of {}, cosine {facing:.4}: {contact:?}, ray {ray_hit:?}", self.name));
        }
    }

    /// Checks a vertex that is no contact: along the normal of at least one contact patch whose rectangle holds it, it
    /// must not lie within the other body.
    fn not_found(&self, what: &str, v: usize, answer: &Answer, (size, limit): (f64, f64), tally: &mut Tally) {
        let x = self.positions[v];
        // Where all contact patches and contacts have one normal, the query tests all vertices of the skin.
        let looks = |seen: &&Seen| {
            let of = |r: &ContactPatch| normal_of(r).dot(seen.normal).abs() > SAME && holds(r, x - answer.origin);
            self.seen.len() == 1 || answer.contact_patches.iter().any(of)
        };
        let mut first = None;
        for seen in self.seen.iter().filter(looks) {
            let facing = self.facing[v].dot(seen.normal);
            let ray_hit = if facing > 0.0 { seen.rays.first(x) } else { None };
            let Some(inside) = ray_hit.filter(|ray_hit| ray_hit.leaves && ray_hit.depth <= limit) else { return };
            first = first.or(Some((seen, facing, inside)));
        }
        let Some((seen, facing, inside)) = first else { return };
        if inside.depth < APART * size || facing < APART || seen.outline.is_near(x) {
            tally.apart += 1;
        } else {
            tally.missing += 1;
            let flags = answer.flags.0;
            tally
                .tell(|| format!("{what}, flags {flags}: vertex {v} of {}, cosine {facing:.4}: {inside:?}", self.name));
        }
    }
}
