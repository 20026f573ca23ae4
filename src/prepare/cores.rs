//! Cores: which nodes each rigid core of a body carries, and the frames that nodes, skin and proxies ride on.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::{DMat3, DVec3};

use super::{Frame, FrameMotion, Layer, Materials, NONE, bind};
use crate::Result;
use crate::scene::obj::TriangleMesh;
use crate::scene::{Bind, Body, Hinge, Motion};

/// Determinant of a dynamic core's inertia against the cube of its mean, or inertia about its hinge against the mean, at
/// least: less is a line of nodes.
const THINNEST: f64 = 1e-6;
/// What to do about a core that holds nothing.
const ENLARGE: &str = "enlarge the region, or leave the core out for a free body";

/// Marks the nodes that the body's cores carry as bound, and returns the core of each node: of a bound node the first in
/// the body's list that names it (of bones whose capsules overlap, see [`bind::nearer_bones`]), of a free node the
/// nearest along the edges of the layer (so that a hand beside a thigh follows the arm); 0 everywhere in a body without
/// cores. `skin` and `layer` are in file coordinates, `numbers` those of the layer's nodes in their file (ascending). `error` makes an error of a key (`core.NAME.bind`, `layer`), a
/// problem and a remedy.
///
/// Refused: a core that carries no node, and a part of the layer that no core holds.
pub fn bind(
    body: &Body,
    layer: &mut Layer,
    numbers: &[u32],
    skin: &TriangleMesh,
    error: impl Fn(&str, &str, &str) -> crate::Error,
) -> Result<Vec<u32>> {
    let mut holders = vec![NONE; layer.nodes.len()];
    for (index, core) in body.cores.iter().enumerate() {
        let key = format!("core.{}.bind", core.name);
        let region = core.bind.as_ref().ok_or_else(|| error(&key, "missing", "say which nodes the core carries"))?;
        let mut named = renumbered(region, numbers)
            .and_then(|region| bind::named(layer, (&skin.vertices, &skin.triangles), &region))
            .map_err(|(problem, remedy)| error(&key, &problem, remedy))?;
        bind::nearer_bones(layer, &body.cores, index, &mut named);
        for (holder, _) in holders.iter_mut().zip(&named).filter(|(holder, named)| **named && **holder == NONE) {
            *holder = index as u32;
        }
        if !holders.contains(&(index as u32)) {
            let problem = if named.contains(&true) {
                "all nodes in the region are carried by cores before it: this one would hold nothing"
            } else {
                "no node lies in the region: the core would hold nothing"
            };
            return Err(error(&key, problem, ENLARGE));
        }
    }
    layer.bound = holders.iter().map(|&holder| holder != NONE).collect();
    if body.cores.is_empty() {
        return Ok(vec![0; holders.len()]);
    }
    if let Some((count, node)) = bind::unheld(layer) {
        let (p, node) = (layer.nodes[node as usize], numbers[node as usize]);
        let problem = format!(
            "{count} nodes with nothing to hold them: the layer has a part without bound nodes, with node {node} at \
             [{:.4}, {:.4}, {:.4}]",
            p.x, p.y, p.z
        );
        return Err(error("layer", &problem, "join the parts, bind a node of each, or make them bodies of their own"));
    }
    Ok(nearest(layer, holders))
}

/// A region whose nodes, if it lists any, are those of the layer and not of its file.
fn renumbered(bind: &Bind, numbers: &[u32]) -> std::result::Result<Bind, (String, &'static str)> {
    let Bind::Nodes(list) = bind else { return Ok(bind.clone()) };
    let place = |node: &u32| match numbers.binary_search(node) {
        Ok(place) => Ok(place as u32),
        // Beyond the file's last node: the binding itself says so.
        Err(place) if place == numbers.len() => Ok(*node),
        Err(_) => Err((format!("node {node} belongs to no tetrahedron"), "name nodes of tetrahedra")),
    };
    list.iter().map(place).collect::<std::result::Result<_, _>>().map(Bind::Nodes)
}

/// Gives every node without a holder that of the node it reaches first along edges (E. Dijkstra 1959); equally far, the
/// lower core's.
fn nearest(layer: &Layer, mut holders: Vec<u32>) -> Vec<u32> {
    if holders.iter().all(|&holder| holder == 0 || holder == NONE) {
        return vec![0; holders.len()];
    }
    let mut around = vec![Vec::new(); layer.nodes.len()];
    for t in &layer.tetrahedra {
        for (i, j) in (0..4).flat_map(|i| (0..4).map(move |j| (i, j))).filter(|(i, j)| i != j) {
            around[t[i] as usize].push(t[j]);
        }
    }
    // Distances are non-negative, and the order of their bits is theirs.
    let start = |(node, &holder): (usize, &u32)| (holder != NONE).then_some(Reverse((0u64, holder, node as u32)));
    let mut queue: BinaryHeap<_> = holders.iter().enumerate().filter_map(start).collect();
    let mut done = vec![false; holders.len()];
    while let Some(Reverse((bits, holder, node))) = queue.pop() {
        if std::mem::replace(&mut done[node as usize], true) {
            continue;
        }
        holders[node as usize] = holder;
        for &next in around[node as usize].iter().filter(|&&next| !done[next as usize]) {
            let step = layer.nodes[node as usize].distance(layer.nodes[next as usize]);
            queue.push(Reverse(((f64::from_bits(bits) + step).to_bits(), holder, next)));
        }
    }
    holders
}

/// The frames of a soft body: one a core, centred at the centre of the mass it carries, or on its hinge; without cores one floating frame at the
/// centre of mass. `layer` is in the rest frame (m), `holders` what `bind` returned. Refused (key, problem, remedy): a
/// dynamic core whose nodes lie on one line, or on its hinge, about which it would have no inertia.
pub fn frames(
    body: &Body,
    layer: &Layer,
    holders: &[u32],
    materials: &Materials,
) -> std::result::Result<Vec<Frame>, (String, &'static str, &'static str)> {
    if body.cores.is_empty() {
        return Ok(vec![floating(layer, materials)]);
    }
    let shares = shares(layer, materials);
    let frame = |(index, core): (usize, &crate::scene::Core)| {
        let carried = (0..holders.len()).filter(|&n| layer.bound[n] && holders[n] == index as u32);
        let add = |(sum, all): (DVec3, f64), n: usize| (sum + shares[n] * layer.nodes[n], all + shares[n]);
        let (sum, all) = carried.fold((DVec3::ZERO, 0.0), add);
        let motion = match &core.motion {
            Motion::Fixed => FrameMotion::Fixed,
            Motion::Driven(keys) => FrameMotion::Driven(keys.clone()),
            Motion::Dynamic => dynamic(core, body.scale),
        };
        let mut centre = sum / f64::max(all, f64::MIN_POSITIVE);
        if let FrameMotion::Dynamic { hinge, .. } = motion {
            centre = hinge.map_or(centre, |hinge| hinge.point);
            let carried = (0..holders.len()).filter(|&n| layer.bound[n] && holders[n] == index as u32);
            let inertia = carried.fold(DMat3::ZERO, |sum, n| sum + point_inertia(shares[n], layer.nodes[n] - centre));
            let size = (inertia.x_axis.x + inertia.y_axis.y + inertia.z_axis.z) / 3.0;
            let (spread, problem) = match hinge {
                Some(Hinge { axis, .. }) => {
                    (axis.dot(inertia * axis) / size, "all its nodes lie on its hinge, about which it has no inertia")
                }
                None => (
                    inertia.determinant() / size.powi(3),
                    "a dynamic core's nodes lie on one line, about which it has no inertia",
                ),
            };
            if spread.is_nan() || spread <= THINNEST {
                return Err((format!("core.{}.bind", core.name), problem, "enlarge the region"));
            }
        }
        Ok(Frame { centre, motion })
    };
    body.cores.iter().enumerate().map(frame).collect()
}

/// How a dynamic core of a body of this scale moves.
pub fn dynamic(core: &crate::scene::Core, scale: f64) -> FrameMotion {
    let hinge = core.hinge.map(|hinge| Hinge { point: scale * hinge.point, ..hinge });
    FrameMotion::Dynamic { mass: core.mass, hinge }
}

/// A frame that follows the nodes: mass, centre and inertia of the lumped layer.
pub fn floating(layer: &Layer, materials: &Materials) -> Frame {
    let shares = shares(layer, materials);
    let weighted = || shares.iter().zip(&layer.nodes);
    let all: f64 = shares.iter().sum();
    let centre = weighted().map(|(m, x)| *m * *x).sum::<DVec3>() / all;
    let inertia = weighted().fold(DMat3::ZERO, |sum, (m, x)| sum + point_inertia(*m, *x - centre));
    let density = materials.all[0].density;
    Frame { centre, motion: FrameMotion::Floating { mass: density * all, inertia: inertia * density } }
}

/// Lumped masses of the nodes over the density of the body's own material, m^3: so that of a body of one material the centre is
/// the same to the last bit whatever it weighs.
fn shares(layer: &Layer, materials: &Materials) -> Vec<f64> {
    let mut shares = vec![0.0; layer.nodes.len()];
    for (index, t) in layer.tetrahedra.iter().enumerate() {
        let [a, b, c, d] = t.map(|n| layer.nodes[n as usize]);
        let density = materials.of(index).density / materials.all[0].density;
        let quarter = density * DMat3::from_cols(b - a, c - a, d - a).determinant() / 24.0;
        t.iter().for_each(|&n| shares[n as usize] += quarter);
    }
    shares
}

/// Inertia of a point mass at `r` (m) from the centre, mass m^2.
fn point_inertia(mass: f64, r: DVec3) -> DMat3 {
    mass * (DMat3::from_diagonal(DVec3::splat(r.length_squared())) - DMat3::from_cols(r * r.x, r * r.y, r * r.z))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::layer;
    use crate::scene::Material;

    #[test]
    fn a_free_node_follows_the_core_it_reaches_first_along_the_layer() {
        // Two prongs on a base, the first bound at its tip, the second in the base: a node at the second's tip is
        // nearer to the first's in space and not along the layer.
        let mut fork = layer::kuhn_box(DVec3::ZERO, DVec3::new(0.5, 1.0, 0.1), [5, 10, 1]);
        let middle = |t: &[u32; 4]| t.iter().map(|&n| fork.nodes[n as usize]).sum::<DVec3>() / 4.0;
        let kept = fork.tetrahedra.iter().filter(|t| middle(t).y < 0.2 || !(0.2..0.3).contains(&middle(t).x));
        fork.tetrahedra = kept.copied().collect();
        let at = |x: f64, y: f64| fork.nodes.iter().position(|n| n.distance(DVec3::new(x, y, 0.0)) < 1e-9).unwrap();
        let (left, right, base) = (at(0.0, 1.0), at(0.3, 1.0), at(0.5, 0.0));
        let mut holders = vec![NONE; fork.nodes.len()];
        (holders[left], holders[base]) = (0, 1);
        let found = nearest(&fork, holders);
        assert_eq!((found[left], found[base], found[right]), (0, 1, 1));
        assert_eq!(found[at(0.2, 1.0)], 0);
    }

    #[test]
    fn a_hinge_through_all_nodes_of_its_core_is_refused() {
        let mut block = layer::kuhn_box(DVec3::ZERO, DVec3::splat(0.2), [2, 2, 2]);
        block.bound = block.nodes.iter().map(|x| x.x == 0.0 && x.y == 0.0).collect();
        let material = Material { density: 500.0, ..crate::prepare::tests::MATERIAL }.into();
        let mut scene = crate::prepare::tests::scene(
            crate::scene::Shape::Rigid { surface: crate::scene::Surface::File("a.obj".into()) },
            &[Bind::All],
        );
        let mut frames_on = |point: DVec3| {
            let core = &mut scene.bodies[0].cores[0];
            (core.motion, core.hinge) = (Motion::Dynamic, Some(Hinge { point, axis: DVec3::Z }));
            frames(&scene.bodies[0], &block, &vec![0; block.nodes.len()], &material)
        };
        let (key, problem, _) = frames_on(DVec3::ZERO).unwrap_err();
        assert!(key == "core.core0.bind" && problem.contains("lie on its hinge"), "{key} {problem}");
        // Beside it they have inertia about it, though they are on a line; the hinge is scaled with the body.
        assert_eq!(frames_on(DVec3::new(0.05, 0.0, 0.0)).unwrap()[0].centre, DVec3::new(0.1, 0.0, 0.0));
    }

    #[test]
    fn a_floating_frame_has_the_mass_and_inertia_of_a_block() {
        let block = layer::kuhn_box(DVec3::ZERO, DVec3::new(0.2, 0.4, 0.6), [16, 16, 16]);
        let material = Material { density: 500.0, ..crate::prepare::tests::MATERIAL }.into();
        let frame = floating(&block, &material);
        let FrameMotion::Floating { mass, inertia } = frame.motion else { panic!("not floating") };
        assert!((mass - 24.0).abs() < 1e-9 && frame.centre.distance(DVec3::new(0.1, 0.2, 0.3)) < 0.002);
        let want = mass / 12.0 * (0.16 + 0.36);
        // Lumping moves mass outwards by a share of the cell squared.
        assert!((inertia.x_axis.x / want - 1.0).abs() < 0.01, "{} {want}", inertia.x_axis.x);
    }
}
