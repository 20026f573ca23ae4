//! Decides, before the first step, which *frame* each collision *proxy* follows. A proxy is a convex hull that covers a
//! part of the *skin* (surface mesh) of a soft body; a frame is the rigid coordinate frame of a *core* (rigid body
//! inside the soft one). A proxy whose skin follows several cores is split into one proxy for each core: a hull that
//! followed only one of two cores at a joint would have to be inflated by the whole swing of the other core.

use std::collections::BTreeMap;

use super::hull::Growing;
use super::{Embedding, Layer, NONE, Proxy, Skin};

/// Triangles that follow another frame than most triangles of their proxy stay with that proxy if they are at most this
/// share of its triangles.
const FEW: f64 = 0.1;
/// Least number of corners to which the hull of a split proxy grows, if its skin has that many.
const LEAST_CORNERS: usize = 8;

/// Lets each proxy follow the frame that most of its skin triangles follow, and splits a proxy if more than the share
/// [`FEW`] of its skin triangles follow another frame. The skin is embedded in `layer`, the body's tetrahedral mesh.
/// All positions are in the rest frame of the body; `node_frames` is the index of the frame that each node of the layer
/// follows. If all nodes follow frame 0, the proxies are returned unchanged.
pub(super) fn on_frames(
    proxies: Vec<Proxy>,
    skin: &Skin,
    layer: &Layer,
    embedding: &[Embedding],
    node_frames: &[u32],
) -> Vec<Proxy> {
    if node_frames.iter().all(|&frame| frame == 0) {
        return proxies;
    }
    let followed: Vec<u32> = embedding.iter().map(|e| frame_of(e, layer, node_frames)).collect();
    let mut parted = Vec::with_capacity(proxies.len());
    for proxy in proxies {
        let mut groups: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for &t in &proxy.triangles {
            let [a, b, c] = skin.triangles[t as usize].map(|v| followed[v as usize]);
            groups.entry(if b == c { b } else { a }).or_default().push(t);
        }
        // If several groups are largest, the first of them is taken.
        let most = groups.iter().rev().max_by_key(|(_, list)| list.len()).map_or(0, |(frame, _)| *frame);
        let least = (FEW * proxy.triangles.len() as f64) as usize;
        let few: Vec<u32> =
            groups.iter().filter(|(f, list)| **f != most && list.len() <= least).map(|g| *g.0).collect();
        for frame in few {
            let list = groups.remove(&frame).unwrap_or_default();
            groups.entry(most).or_default().extend(list);
        }
        if groups.len() == 1 {
            parted.push(Proxy { frame: most, ..proxy });
        } else {
            parted.extend(part(&proxy, skin, groups, most));
        }
    }
    parted
}

/// The frame that a skin vertex with embedding `e` follows: the frame of the node with the largest weight.
fn frame_of(e: &Embedding, layer: &Layer, node_frames: &[u32]) -> u32 {
    let strongest = (0..4).rev().max_by(|&i, &j| e.weights[i].total_cmp(&e.weights[j])).unwrap_or(0);
    node_frames[layer.tetrahedra[e.tetrahedron as usize][strongest] as usize]
}

/// Splits a proxy into one proxy for each of `groups`: a group is a frame and the triangles that follow it. Vertices of
/// no triangle go to the proxy of the frame `most`.
fn part(proxy: &Proxy, skin: &Skin, groups: BTreeMap<u32, Vec<u32>>, most: u32) -> Vec<Proxy> {
    let mut owner: BTreeMap<u32, u32> = proxy.vertices.iter().map(|&v| (v, NONE)).collect();
    for (frame, list) in &groups {
        for v in list.iter().flat_map(|&t| skin.triangles[t as usize]) {
            owner.entry(v).and_modify(|f| *f = if *f == NONE { *frame } else { *f });
        }
    }
    let make = |(frame, mut triangles): (u32, Vec<u32>)| {
        triangles.sort_unstable();
        let is_own = |f: u32| f == frame || (f == NONE && frame == most);
        let vertices: Vec<u32> = proxy.vertices.iter().copied().filter(|v| is_own(owner[v])).collect();
        let covered = || triangles.iter().flat_map(|&t| skin.triangles[t as usize]);
        let points: Vec<_> = covered().map(|v| skin.vertices[v as usize]).collect();
        let (hull, faces) = match Growing::new(&points) {
            Some(mut growing) => {
                while growing.hull.vertices.len() < proxy.hull.len().max(LEAST_CORNERS) && growing.grow() {}
                (growing.hull.vertices, growing.hull.faces)
            }
            // If all points of a group coincide, its proxy keeps the old hull, which also contains these points.
            None => (proxy.hull.clone(), proxy.faces.clone()),
        };
        let height = |v: u32| {
            let x = skin.vertices[v as usize];
            faces.iter().map(|(n, d)| n.dot(x) - d).fold(f64::NEG_INFINITY, f64::max)
        };
        let margin = covered().map(height).fold(0.0, f64::max);
        Proxy { frame, hull, faces, vertices, triangles, margin }
    };
    groups.into_iter().map(make).collect()
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::prepare::{embed, layer, proxies, proxy, skin};

    #[test]
    fn a_bar_between_two_cores_is_parted_between_them() {
        let bar = layer::kuhn_box(DVec3::ZERO, DVec3::new(4.0, 1.0, 1.0), [16, 4, 4]);
        let (vertices, triangles, _) = layer::boundary(&bar);
        let skin = skin::build(vertices, triangles);
        let embedding = embed(&skin.vertices, &bar).unwrap();
        let whole = proxies(&skin).unwrap();
        assert_eq!(whole.len(), 1);
        let frames: Vec<u32> = bar.nodes.iter().map(|n| u32::from(n.x > 2.6)).collect();
        let parted = on_frames(whole.clone(), &skin, &bar, &embedding, &frames);
        proxy::tests::check(&skin, &parted);
        assert_eq!(parted.iter().map(|p| p.frame).collect::<Vec<_>>(), [0, 1]);
        for p in &parted {
            let (low, high) = if p.frame == 0 { (0.0, 2.8) } else { (2.4, 4.0) };
            assert!(
                p.hull.iter().all(|v| v.x >= low && v.x <= high),
                "the hull reaches beyond the part of the bar that its frame moves: {:?}",
                p.hull
            );
        }
        // Triangles that follow another frame make a proxy of their own if they are more than a tenth of their proxy's
        // triangles; fewer stay with their proxy. With a single frame nothing changes.
        let few: Vec<u32> = bar.nodes.iter().map(|n| u32::from(n.x > 3.6)).collect();
        assert_eq!(on_frames(whole.clone(), &skin, &bar, &embedding, &few).len(), 2);
        let fewer: Vec<u32> = bar.nodes.iter().map(|n| u32::from(n.x > 3.9 && n.y > 0.6)).collect();
        assert_eq!(on_frames(whole.clone(), &skin, &bar, &embedding, &fewer), whole);
        let none = vec![0; bar.nodes.len()];
        assert_eq!(on_frames(whole.clone(), &skin, &bar, &embedding, &none), whole);
    }
}
