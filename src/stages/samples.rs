//! Chooses what of a pair of bodies is tested for contact: vertices of the skins (surface meshes), or triangles. A skin
//! vertex stands for the skin around it, so vertices do well where both skins are fine against the area of contact.
//! Where an edge, a tip or a coarse skin is pressed into a body, or a body into a coarse skin, few vertices lie within
//! the contact; then the depth is integrated over triangles.

use std::collections::HashMap;

use glam::DVec3;

use crate::prepare::proxy::CONVEX;
use crate::prepare::{Body, FrameMotion, Shape, Skin, hull, mass};
use crate::scene::Samples;

/// Cosine of the angle between the normals of two triangles at an edge below which the edge is sharp: 40 degrees.
const SHARP: f64 = 0.766;
/// How many times as long the mean edge of a rigid body's skin may be as that of the other body's skin for vertices.
const COARSER: f64 = 1.5;

/// How long the mean edge of a skin may be, as a share of the second longest side of a rigid body's box, for its
/// vertices to be tested against that body. At this share the force on a ball of 20 mm pressed 1.5 mm deep is up to 3 %
/// off, its torque 9 % (8 poses); at a quarter 7 and 34 %.
const FEW: f64 = 0.2;
/// A soft body is a sheet if its mean thickness, twice its volume over its area, is less than the first of these shares
/// of a tool's second longest side, and than the second of its own: it folds round the tool, and its thickness along
/// one normal says little. The shares for its own side: a plate of 6 by 6 by 2, 0.2; a block of 6 by 6 by 3, 0.25; a
/// cube or a ball, a third.
const SHEET: [f64; 2] = [0.5, 0.22];
/// How long the mean edge of the tested triangles may be, as a share of the second longest side of either body's box,
/// for the engine to choose triangles: a triangle's contact has no resistance to rotation about its own centre of
/// pressure, so several of them must share a face that lies flat on them. At this share seven or more lie in part under a
/// square face, and resist its rotation with 77 % of what the exact overlap does; at half of it with 88 %.
const COARSEST: f64 = 0.75;

/// The side of a pair (0: the first body, 1: the second) whose triangles are tested for contact; `None` where vertices
/// are. The other side must be rigid and nearly convex, with one collision proxy (convex hull): then its skin, seen
/// along a normal, has one near and one far side.
pub fn side_by_triangles(samples: Samples, pair: [&Body; 2]) -> Option<usize> {
    // A dynamic rigid body moves by nodes, and a contact's nodes are those of the triangle alone.
    let rigid = |body: &Body| match &body.shape {
        Shape::Rigid { motion: FrameMotion::Dynamic { .. }, .. } => false,
        Shape::Rigid { proxies, .. } => proxies.len() == 1,
        _ => false,
    };
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
        Samples::Auto => {
            let is_faceted = edge(other) > COARSER * edge(own) || has_sharp_edge(other);
            let meets_few = edge(own) > FEW * width(other) && !is_sheet(pair[side], width(other));
            edge(own) <= COARSEST * width(own).min(width(other)) && (is_faceted || meets_few)
        }
    };
    (asked && is_nearly_convex(pair[1 - side])).then_some(side)
}

/// Whether a rigid body fills the convex hull of its skin. A body of several parts has one proxy too if the scene asks
/// for one hull.
fn is_nearly_convex(body: &Body) -> bool {
    let Shape::Rigid { skin, volume, .. } = &body.shape else { return false };
    hull::convex(&hull::thinned(&skin.vertices)).is_some_and(|whole| *volume >= CONVEX * whole.volume())
}

/// Whether a soft body is a sheet against a tool of such a width (m).
fn is_sheet(body: &Body, tool: f64) -> bool {
    let Shape::Soft { skin, .. } = &body.shape else { return false };
    let thickness = 2.0 * volume(skin) / area(skin);
    thickness < SHEET[0] * tool && thickness < SHEET[1] * width(skin)
}

/// Volume that a skin encloses, m^3.
fn volume(skin: &Skin) -> f64 {
    mass::properties(&skin.vertices, &skin.triangles).volume
}

/// Area of a skin, m^2.
fn area(skin: &Skin) -> f64 {
    skin.areas.iter().sum()
}

/// The second longest side of the box around a skin, m.
fn width(skin: &Skin) -> f64 {
    let low = skin.vertices.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let high = skin.vertices.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    let mut sides = (high - low).to_array();
    sides.sort_by(f64::total_cmp);
    sides[1]
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::{self, layer, skin};

    fn body(mesh: (Vec<DVec3>, Vec<[u32; 3]>), is_soft: bool) -> Body {
        let skin = skin::build(mesh.0, mesh.1);
        let proxies = prepare::proxies(&skin).unwrap();
        let volume = prepare::mass::properties(&skin.vertices, &skin.triangles).volume;
        let motion = FrameMotion::Fixed;
        let (centroid, inertia) = (DVec3::ZERO, glam::DMat3::IDENTITY);
        let shape = match is_soft {
            false => Shape::Rigid { skin, proxies, volume, centroid, inertia, motion },
            true => Shape::Soft {
                layer: Default::default(),
                frames: vec![],
                node_frames: vec![],
                supports: Default::default(),
                joints: vec![],
                materials: prepare::Materials { all: vec![], which: vec![] },
                embedding: vec![],
                skin,
                proxies,
            },
        };
        let (position, orientation) = (DVec3::ZERO, glam::DQuat::IDENTITY);
        Body {
            name: "body".into(),
            shape,
            position,
            orientation,
            velocity: DVec3::ZERO,
            loads: vec![],
            report: Default::default(),
        }
    }

    fn cuboid(half: DVec3, cells: [u32; 3]) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let (vertices, triangles, _) = layer::boundary(&layer::kuhn_box(-half, half, cells));
        (vertices, triangles)
    }

    #[test]
    fn triangles_are_tested_where_a_rigid_body_is_sharp_or_either_skin_coarse() {
        let soft = body(cuboid(DVec3::splat(0.03), [8; 3]), true);
        let cube = body(cuboid(DVec3::splat(0.01), [1; 3]), false);
        let blade = body(cuboid(DVec3::new(0.00025, 0.01, 0.01), [1; 3]), false);
        let plate = body(cuboid(DVec3::new(0.03, 0.001, 0.03), [1; 3]), false);
        let ball = body(prepare::sphere::icosphere(0.01), false);
        let auto = |a: &Body, b: &Body| side_by_triangles(Samples::Auto, [a, b]);
        assert_eq!((auto(&soft, &cube), auto(&cube, &soft), auto(&soft, &blade)), (Some(0), Some(1), Some(0)));
        // A ball on cells of 7.5 mm meets few vertices, on cells of 3 mm enough. A sheet folds round it.
        let fine = body(cuboid(DVec3::splat(0.03), [20; 3]), true);
        assert_eq!((auto(&soft, &ball), auto(&fine, &ball), auto(&soft, &soft)), (Some(0), None, None));
        let sheet = |half| body(cuboid(DVec3::new(0.03, half, 0.03), [8, 2, 8]), true);
        assert_eq!([0.001, 0.004, 0.008].map(|half| auto(&sheet(half), &ball)), [None, None, Some(0)]);
        // A cube is no sheet, however small. No round tool may be smaller than a triangle.
        let cube_of = |half| body(cuboid(DVec3::splat(half), [6; 3]), true);
        let icosphere = |radius| body(prepare::sphere::icosphere(radius), false);
        assert_eq!([auto(&cube_of(0.014), &ball), auto(&soft, &icosphere(0.005))], [Some(0), None]);
        // Edges of 4.3 and 3.8 mm against a fifth of 20 mm; a block of 2 by 2 by 1 is no sheet for a wide tool.
        let cells = |n| auto(&body(cuboid(DVec3::splat(0.03), [n; 3]), true), &ball);
        assert_eq!([16, 18].map(cells), [Some(0), None]);
        let block = body(cuboid(DVec3::new(0.03, 0.015, 0.03), [6, 3, 6]), true);
        assert_eq!(auto(&block, &icosphere(0.025)), Some(0));
        // A ball on a fixed coarse body, and above a half-space.
        let fixed = body(cuboid(DVec3::splat(0.03), [8; 3]), false);
        let mut plane = fixed.clone();
        plane.shape = Shape::Plane { normal: DVec3::Y, offset: 0.0 };
        assert_eq!((auto(&fixed, &ball), auto(&plane, &ball)), (Some(1), None));
        // Two triangles would carry the cube.
        assert_eq!(auto(&plate, &cube), None);
        assert_eq!(side_by_triangles(Samples::Triangles, [&plate, &cube]), Some(1));
        assert_eq!(side_by_triangles(Samples::Triangles, [&soft, &ball]), Some(0));
        assert_eq!(side_by_triangles(Samples::Vertices, [&soft, &cube]), None);
        // Two cubes apart, covered by one hull as a scene may ask.
        let (mut vertices, mut triangles) = cuboid(DVec3::splat(0.01), [1; 3]);
        let count = vertices.len() as u32;
        vertices.extend(vertices.clone().iter().map(|x| *x + 0.05 * DVec3::X));
        triangles.extend(triangles.clone().iter().map(|t| t.map(|v| v + count)));
        let mut two = body((vertices, triangles), false);
        let Shape::Rigid { skin, proxies, .. } = &mut two.shape else { unreachable!() };
        *proxies = prepare::proxy::at_most(skin, 1).unwrap();
        assert_eq!((proxies.len(), side_by_triangles(Samples::Triangles, [&soft, &two])), (1, None));
    }
}
