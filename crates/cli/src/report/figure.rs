//! Images of a prepared body, as in Figure 2 of Galoppo et al. 2007: the proxies (convex collision hulls), each in its
//! own colour; the layer (tetrahedral mesh), cut open; the skin (surface mesh).

use std::collections::BTreeSet;

use glam::DVec3;
use palpate::internal::prepare::{Layer, Proxy, Skin, hull, layer};

use super::picture::{Colour, Face, Picture, View, draw};

/// Longer side of each image, pixels.
pub const SIDE: usize = 900;
/// Direction from the body to the viewer: a little from the right and from above its front.
const TOWARDS: DVec3 = DVec3::new(0.5, 0.35, 1.0);
/// A corner of a triangle is shaded with the triangle's own normal unless the cosine between this normal and the mean
/// normal at the vertex is greater than this value.
const SHARP: f64 = 0.8;
const SKIN: Colour = [0.80, 0.58, 0.44];
const OUTSIDE: Colour = [0.36, 0.55, 0.74];
const INSIDE: Colour = [0.95, 0.74, 0.36];
const CORE: Colour = [0.86, 0.85, 0.80];

/// The camera that all images of a body share.
pub fn view(skin: &Skin) -> View {
    View::of(skin.vertices.iter().copied(), TOWARDS, DVec3::Y)
}

/// The skin, smoothly shaded.
pub fn skin(skin: &Skin, view: &View) -> Picture {
    let mut normals = vec![DVec3::ZERO; skin.vertices.len()];
    let corners = |t: &[u32; 3]| t.map(|i| skin.vertices[i as usize]);
    for t in &skin.triangles {
        let [a, b, c] = corners(t);
        t.iter().for_each(|&i| normals[i as usize] += (b - a).cross(c - a));
    }
    // Sharp edges stay sharp: where a corner's mean normal differs much from the face's normal, the latter is used.
    let faces = skin.triangles.iter().map(|t| {
        let mut face = Face::flat(corners(t), SKIN, false);
        for k in 0..3 {
            let mean = normals[t[k] as usize].normalize_or_zero();
            if mean.dot(face.normals[k]) > SHARP {
                face.normals[k] = mean;
            }
        }
        face
    });
    draw(&faces.collect::<Vec<_>>(), view, SIDE)
}

/// The proxies' hulls, each in its own colour.
pub fn proxies(proxies: &[Proxy], view: &View) -> Picture {
    let mut faces = Vec::new();
    for (i, proxy) in proxies.iter().enumerate() {
        let colour = hue(i);
        let Some(hull) = hull::convex(&proxy.hull) else { continue };
        let corners = hull.triangles.iter().map(|t| t.map(|i| hull.vertices[i as usize]));
        faces.extend(corners.map(|corners| Face::flat(corners, colour, true)));
    }
    draw(&faces, view, SIDE)
}

/// The tetrahedra of a layer, without the quarter that lies at the right and towards the viewer. A tetrahedron whose
/// nodes are all attached to a rigid core is pale.
pub fn layer(layer: &Layer, view: &View) -> Picture {
    let [right, _, towards] = view.axes();
    let low = layer.nodes.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let high = layer.nodes.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    let middle = 0.5 * (low + high);
    let front = DVec3::new(towards.x, 0.0, towards.z).normalize_or(DVec3::Z);
    let is_kept = |t: &[u32; 4]| {
        let centre = t.iter().map(|&i| layer.nodes[i as usize]).sum::<DVec3>() / 4.0 - middle;
        centre.dot(right) < 0.0 || centre.dot(front) < 0.0
    };
    let kept: Vec<[u32; 4]> = layer.tetrahedra.iter().filter(|t| is_kept(t)).copied().collect();
    let outer: BTreeSet<[u32; 3]> =
        layer::boundary_faces(&layer.tetrahedra).into_iter().map(|(triangle, _)| sorted(triangle)).collect();
    let faces = layer::boundary_faces(&kept).into_iter().map(|(triangle, tetrahedron)| {
        let corners = triangle.map(|n| layer.nodes[n as usize]);
        let is_bound = kept[tetrahedron as usize].iter().all(|&n| layer.attached[n as usize]);
        let colour = match (outer.contains(&sorted(triangle)), is_bound) {
            (true, _) => OUTSIDE,
            (false, true) => CORE,
            (false, false) => INSIDE,
        };
        Face::flat(corners, colour, true)
    });
    draw(&faces.collect::<Vec<_>>(), view, SIDE)
}

fn sorted(mut triangle: [u32; 3]) -> [u32; 3] {
    triangle.sort_unstable();
    triangle
}

/// A colour for each index, well apart from the colours of neighbouring indices: hues in steps of the golden ratio.
fn hue(index: usize) -> Colour {
    let at = (index as f64 * 0.618_033_988_749_895 + 0.05).fract() * 6.0;
    let ramp = |shift: f64| (((at + shift) % 6.0 - 3.0).abs() - 1.0).clamp(0.0, 1.0);
    let (light, deep) = if index.is_multiple_of(2) { (0.85, 0.25) } else { (0.65, 0.12) };
    [ramp(0.0), ramp(4.0), ramp(2.0)].map(|c| deep + (light - deep) * c)
}
