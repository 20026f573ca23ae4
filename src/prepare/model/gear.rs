//! Generates a spur gear for scenes without files: twenty involute teeth, rim, web, hub and bore, with the axis along
//! z.
//!
//! The gear's surface is a grid of points that is built ring by ring from the gear's profile, so that every edge is
//! sharp and every vertex of a flank (working side of a tooth) lies on an involute. If no such grid has the wanted
//! number of vertices, edges of flat faces are split, which leaves the surface in place.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::split;

/// Number of teeth; with 17 or more no undercut is needed.
pub(super) const TEETH: usize = 20;
/// Radius at the tips, m.
pub(super) const TIP: f64 = 0.05;
/// Module, which is the pitch diameter over the number of teeth, m; the tips stand one module above the pitch circle
/// (ISO 53).
const MODULE: f64 = TIP / (TEETH as f64 / 2.0 + 1.0);
/// Radius of the pitch circle, m.
const PITCH: f64 = MODULE * TEETH as f64 / 2.0;
/// Radius of the root circle between the teeth, m, which leaves the teeth of another gear a clearance of a quarter of a
/// module (ISO 53).
const ROOT: f64 = PITCH - 1.25 * MODULE;
/// Cosine and tangent of the pressure angle, 20 degrees.
const PRESSURE: (f64, f64) = (0.939_692_620_785_908_4, 0.363_970_234_266_202_4);
/// Radius of the base circle, from which the involutes unwind, m.
pub(super) const BASE: f64 = PITCH * PRESSURE.0;
/// Radius of the fillet at a tooth's foot, m (ISO 53: at most 0.38 modules).
const FILLET: f64 = 0.3 * MODULE;
/// Half the face width, m.
pub(super) const HALF_WIDTH: f64 = 0.01;
/// Half the web's thickness, m.
const HALF_WEB: f64 = 0.0045;
/// Radius of the bore, m.
const BORE: f64 = 0.0125;
/// Radial section from the root circle inwards to the bore: radius and height above the middle plane, m.
const SECTION: [(f64, f64); 6] = [
    (ROOT, HALF_WIDTH),
    (0.0335, HALF_WIDTH),
    (0.0325, HALF_WEB),
    (0.0205, HALF_WEB),
    (0.0195, HALF_WIDTH),
    (BORE, HALF_WIDTH),
];
/// Edge length of the coarsest grid, m, and the ratio of each edge length that is tried to the previous one.
const COARSEST: (f64, f64) = (0.01, 0.995);

/// A gear with exactly `vertex_count` vertices.
pub fn gear(vertex_count: usize) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let mut grid = Grid::new(COARSEST.0);
    let mut edge = COARSEST.0;
    loop {
        edge *= COARSEST.1;
        let finer = Grid::new(edge);
        if finer.vertex_count() > vertex_count {
            break;
        }
        grid = finer;
    }
    let (mut vertices, mut triangles) = grid.build();
    split::to_count(&mut vertices, &mut triangles, vertex_count);
    (vertices, triangles)
}

/// Half the angle that a tooth spans at a radius, rad. The tooth's flank is an involute above the base circle and a
/// radial line below the base circle, with a fillet at the foot.
fn half_angle(radius: f64) -> f64 {
    let involute = |tangent: f64| tangent - libm::atan(tangent);
    let roll = ((radius / BASE) * (radius / BASE) - 1.0).max(0.0).sqrt();
    let foot = (ROOT + FILLET - radius).max(0.0);
    let rounding = FILLET - (FILLET * FILLET - foot * foot).max(0.0).sqrt();
    PI / (2.0 * TEETH as f64) + involute(PRESSURE.1) - involute(roll) + rounding / radius
}

fn point(radius: f64, angle: f64, z: f64) -> DVec3 {
    let (sine, cosine) = libm::sincos(angle);
    DVec3::new(radius * cosine, radius * sine, z)
}

/// The grid's number of edges along each part of the gear.
struct Grid {
    /// Number of edges across a tooth.
    across: usize,
    /// Number of edges between two teeth.
    between: usize,
    /// Number of edges up a flank.
    up: usize,
    /// Number of edges over the face width.
    levels: usize,
    /// Radius and height (m) of every ring of points, from the root circle of one side through the bore to the root
    /// circle of the other side.
    rings: Vec<(f64, f64)>,
}

impl Grid {
    fn new(edge: f64) -> Self {
        let count = |length: f64, least: usize| ((length / edge).round() as usize).max(least);
        let foot = 2.0 * ROOT * half_angle(ROOT);
        let tip = 2.0 * TIP * half_angle(TIP);
        let across = count((foot + tip) / 2.0, 2);
        let between = count(TAU * ROOT / TEETH as f64 - foot, 1);
        // On the inner rings points lie closer together. An edge along the section is therefore as long as the
        // geometric mean of the wanted edge length and the distance between neighbouring points of the ring.
        let crowd = TAU / (TEETH * (across + between)) as f64;
        let mut rings = vec![SECTION[0]];
        let other_side = SECTION.iter().rev().map(|&(r, z)| (r, -z));
        for (r, z) in SECTION.into_iter().skip(1).chain(other_side) {
            let (r0, z0) = rings[rings.len() - 1];
            let length = ((r - r0) * (r - r0) + (z - z0) * (z - z0)).sqrt();
            let steps = (length / (edge * crowd * (r + r0) / 2.0).sqrt()).round().max(1.0) as usize;
            rings.extend((1..=steps).map(|k| k as f64 / steps as f64).map(|t| (r0 + t * (r - r0), z0 + t * (z - z0))));
        }
        Grid { across, between, up: count(TIP - ROOT, 3), levels: count(2.0 * HALF_WIDTH, 1), rings }
    }

    fn vertex_count(&self) -> usize {
        let ring = self.across + self.between;
        let caps = 2 * self.up * (self.across + 1);
        TEETH * (self.rings.len() * ring + caps + (self.levels - 1) * (ring + 2 * self.up))
    }

    fn build(&self) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let mut mesh = Mesh { vertices: Vec::with_capacity(self.vertex_count()), triangles: Vec::new() };
        let rings: Vec<Vec<u32>> = self.rings.iter().map(|&(r, z)| self.ring(&mut mesh, r, z)).collect();
        for pair in rings.windows(2) {
            mesh.band(&pair[0], &pair[1]);
        }
        let mut above = self.cap(&mut mesh, &rings[0], HALF_WIDTH);
        let below = self.cap(&mut mesh, &rings[rings.len() - 1], -HALF_WIDTH);
        for level in 1..=self.levels {
            let next = if level == self.levels {
                below.clone()
            } else {
                let z = HALF_WIDTH * (1.0 - 2.0 * level as f64 / self.levels as f64);
                above.iter().map(|&v| mesh.add(mesh.vertices[v as usize].with_z(z))).collect()
            };
            mesh.band(&next, &above);
            above = next;
        }
        (mesh.vertices, mesh.triangles)
    }

    /// Adds a whole circle of points: for each tooth the points at its foot, then the points between this tooth and the
    /// next.
    fn ring(&self, mesh: &mut Mesh, radius: f64, z: f64) -> Vec<u32> {
        let half = half_angle(ROOT);
        let gap = TAU / TEETH as f64 - 2.0 * half;
        let over = (0..self.across).map(|k| half * (2.0 * k as f64 / self.across as f64 - 1.0));
        let beside = (0..self.between).map(|k| half + gap * k as f64 / self.between as f64);
        let angles: Vec<f64> = over.chain(beside).collect();
        let pitch = |tooth: usize| TAU * tooth as f64 / TEETH as f64;
        (0..TEETH)
            .flat_map(|t| angles.iter().map(move |a| pitch(t) + a))
            .map(|a| mesh.add(point(radius, a, z)))
            .collect()
    }

    /// Adds the flat faces of all teeth on one side of the gear, starting from the points `foot` of the root circle;
    /// returns the points along the outline of that side.
    fn cap(&self, mesh: &mut Mesh, foot: &[u32], z: f64) -> Vec<u32> {
        let mut outline = Vec::new();
        let pitch = self.across + self.between;
        for tooth in 0..TEETH {
            let middle = TAU * tooth as f64 / TEETH as f64;
            let at = |k: usize| foot[(tooth * pitch + k) % foot.len()];
            let mut rows: Vec<Vec<u32>> = vec![(0..=self.across).map(at).collect()];
            for j in 1..=self.up {
                let radius = ROOT + (TIP - ROOT) * j as f64 / self.up as f64;
                let step = half_angle(radius) / self.across as f64;
                let angles = (0..=self.across).map(|k| middle + step * (2.0 * k as f64 - self.across as f64));
                rows.push(angles.map(|a| mesh.add(point(radius, a, z))).collect());
            }
            for pair in rows.windows(2) {
                mesh.strip(&pair[usize::from(z > 0.0)], &pair[usize::from(z < 0.0)]);
            }
            outline.extend(rows.iter().map(|row| row[0]));
            outline.extend(&rows[self.up][1..self.across]);
            outline.extend(rows.iter().rev().map(|row| row[self.across]));
            outline.extend((self.across + 1..pitch).map(at));
        }
        outline
    }
}

/// The mesh built so far.
struct Mesh {
    vertices: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
}

impl Mesh {
    fn add(&mut self, vertex: DVec3) -> u32 {
        self.vertices.push(vertex);
        self.vertices.len() as u32 - 1
    }

    /// Adds triangles between two rows of points; seen from outside, both rows run to the right, and `a` lies below
    /// `b`.
    fn strip(&mut self, a: &[u32], b: &[u32]) {
        for (p, q) in a.windows(2).zip(b.windows(2)) {
            self.triangles.extend([[p[0], p[1], q[1]], [p[0], q[1], q[0]]]);
        }
    }

    /// Adds triangles between two closed rows of points, as [`Mesh::strip`] does between two open rows.
    fn band(&mut self, a: &[u32], b: &[u32]) {
        self.strip(a, b);
        let last = a.len() - 1;
        self.strip(&[a[last], a[0]], &[b[last], b[0]]);
    }
}
