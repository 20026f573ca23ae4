//! Chooses what of a pair of bodies is tested for contact: vertices of the skins (surface meshes), or triangles. A skin
//! vertex stands for the skin around it, so vertices do well where both skins are fine against the area of contact.
//! Where an edge, a tip or a coarse skin is pressed into a body, few vertices lie within the contact; then the depth is
//! integrated over triangles.

use std::collections::HashMap;

use glam::DVec3;

use crate::prepare::{Body, FrameMotion, Shape, Skin};
use crate::scene::Samples;

/// Cosine of the angle between the normals of two triangles at an edge below which the edge is sharp: 40 degrees.
const SHARP: f64 = 0.766;
/// How many times as long the mean edge of a rigid body's skin may be as that of the other body's skin for vertices.
const COARSER: f64 = 1.5;

/// The side of a pair (0: the first body, 1: the second) whose triangles are tested for contact; `None` where vertices
/// are. The other side must be rigid and nearly convex, that is, have one collision proxy (convex hull): then each of
/// its skin's two layers, seen along a normal, has one height.
pub fn side_by_triangles(samples: Samples, pair: [&Body; 2]) -> Option<usize> {
    let rigid = |body: &Body| matches!(&body.shape, Shape::Rigid { proxies, .. } if proxies.len() == 1);
    // Of two such bodies the triangles are those of the one with the finer skin.
    let side = match pair.map(rigid) {
        [false, false] => return None,
        [true, false] => 1,
        [false, true] => 0,
        [true, true] => usize::from(edge(skin(pair[1])?) < edge(skin(pair[0])?)),
    };
    let (own, other) = (skin(pair[side])?, skin(pair[1 - side])?);
    let asked = match samples {
        Samples::Vertices => false,
        Samples::Triangles => true,
        Samples::Auto => edge(other) > COARSER * edge(own) || has_sharp_edge(other),
    };
    // The nodes of a dynamic rigid body would move with the contact's triangle only.
    let moves_by_nodes = matches!(pair[1 - side].shape, Shape::Rigid { motion: FrameMotion::Dynamic { .. }, .. });
    (asked && !moves_by_nodes).then_some(side)
}

fn skin(body: &Body) -> Option<&Skin> {
    match &body.shape {
        Shape::Soft { skin, .. } | Shape::Rigid { skin, .. } => Some(skin),
        Shape::Plane { .. } => None,
    }
}

/// Mean length of the edges of a skin's triangles, m.
fn edge(skin: &Skin) -> f64 {
    let around = |[a, b, c]: [DVec3; 3]| a.distance(b) + b.distance(c) + c.distance(a);
    let sum: f64 = skin.triangles.iter().map(|t| around(t.map(|v| skin.vertices[v as usize]))).sum();
    sum / (3 * skin.triangles.len()).max(1) as f64
}

/// Whether the skin is bent outwards by more than the angle of [`SHARP`] at some edge.
fn has_sharp_edge(skin: &Skin) -> bool {
    let corners = |t: u32| skin.triangles[t as usize].map(|v| skin.vertices[v as usize]);
    let normal = |t: u32| {
        let [a, b, c] = corners(t);
        (b - a).cross(c - a).normalize_or_zero()
    };
    let mut first: HashMap<(u32, u32), u32> = HashMap::new();
    for (t, corners_of) in skin.triangles.iter().enumerate() {
        for k in 0..3 {
            let (v, w) = (corners_of[k], corners_of[(k + 1) % 3]);
            let Some(other) = first.insert((v.min(w), v.max(w)), t as u32) else { continue };
            let across = corners(other).iter().sum::<DVec3>() / 3.0 - skin.vertices[v as usize];
            if normal(t as u32).dot(normal(other)) < SHARP && normal(t as u32).dot(across) < 0.0 {
                return true;
            }
        }
    }
    false
}
