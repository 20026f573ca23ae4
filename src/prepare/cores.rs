//! Rigid cores of a deformable body: finds the nodes of the layer (tetrahedral simulation mesh) that are attached to
//! each core, and makes the rigid coordinate frames that the nodes, the skin (surface mesh) and the collision proxies
//! (convex hulls) follow. A node that is not attached is *free*. A *bone* is a core whose region (key `bind`) is a
//! capsule. A body without cores has one *floating* frame, which follows the body's nodes by shape matching.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::{DMat3, DVec3};

use super::supports::{Freedom, Supports, supports};
use super::{Frame, FrameMotion, Layer, Materials, NONE, bind};
use crate::Result;
use crate::scene::groups::Groups;
use crate::scene::triangles::TriangleMesh;
use crate::scene::{Bind, Body, Hinge, Motion};

/// A dynamic core (one that forces move) is refused if its attached nodes lie on one line, that is, if the determinant
/// of its inertia tensor is at most this share of the cube of its mean principal inertia. A dynamic core on a hinge is
/// refused if its inertia about the hinge is at most this share of its mean principal inertia.
const THINNEST: f64 = 1e-6;
/// Remedy for a core without attached nodes.
const ENLARGE: &str = "enlarge the region, or leave the core out for a free body";

/// How the file of a layer numbers and groups the layer's nodes.
pub struct Numbered<'a> {
    /// For each node of the layer, its number in the file; ascending.
    pub numbers: &'a [u32],
    /// Groups in the file.
    pub groups: &'a Groups,
}

/// Marks in `layer` the nodes attached to the body's cores, and returns the index of the core that each node follows.
/// An attached node follows the first core in the body's list that selects it; where capsules of bones overlap,
/// [`bind::nearer_bones`] decides. A free node follows the core whose attached nodes are nearest along the edges of the
/// layer, so that a hand near a thigh follows the arm's core and not the leg's. Nodes that supports hold count like
/// attached ones of a further core, which rests; what supports leave to each node is the second result. In a body
/// without cores all indices are 0. `skin` and `layer` are in file coordinates. `error` makes an error of a key
/// (`core.NAME.bind` or `layer`), a problem and a remedy.
///
/// It is an error if a core has no attached node, or if cores and supports hold no node of a connected part of the
/// layer.
pub fn bind(
    body: &Body,
    layer: &mut Layer,
    mesh: &Numbered,
    skin: &TriangleMesh,
    error: impl Fn(&str, &str, &str) -> crate::Error,
) -> Result<(Vec<u32>, Supports)> {
    let mut holders = vec![NONE; layer.nodes.len()];
    for (index, core) in body.cores.iter().enumerate() {
        let key = format!("core.{}.bind", core.name);
        let region =
            core.bind.as_ref().ok_or_else(|| error(&key, "missing", "give `bind`, the nodes attached to the core"))?;
        let mut named =
            selected(region, layer, mesh, skin).map_err(|(problem, remedy)| error(&key, &problem, &remedy))?;
        bind::nearer_bones(layer, &body.cores, index, &mut named);
        for (holder, _) in holders.iter_mut().zip(&named).filter(|(holder, named)| **named && **holder == NONE) {
            *holder = index as u32;
        }
        if !holders.contains(&(index as u32)) {
            let problem = if named.contains(&true) {
                "all nodes in the region are attached to earlier cores: no node is left for this one"
            } else {
                "no node lies in the region: no node is attached to the core"
            };
            return Err(error(&key, problem, ENLARGE));
        }
    }
    layer.attached = holders.iter().map(|&holder| holder != NONE).collect();
    let held = supports(body, layer, &holders, mesh, skin, &error)?;
    if body.cores.is_empty() && body.supports.is_empty() {
        return Ok((vec![0; holders.len()], held));
    }
    // The frame of the supports comes after those of the cores.
    for (holder, freedom) in holders.iter_mut().zip(&held.freedom) {
        if *holder == NONE && *freedom != Freedom::Free {
            *holder = body.cores.len() as u32;
        }
    }
    let is_held: Vec<bool> = holders.iter().map(|&holder| holder != NONE).collect();
    if let Some((count, node)) = bind::unattached(layer, &is_held) {
        let (p, node) = (layer.nodes[node as usize], mesh.numbers[node as usize]);
        let problem = format!(
            "a connected part of the layer has no node attached to a core or held by a support: {count} nodes, among \
             them node {node} at \
             [{:.4}, {:.4}, {:.4}]",
            p.x, p.y, p.z
        );
        return Err(error("layer", &problem, "join the parts, attach a node of each, or make them separate bodies"));
    }
    Ok((nearest(layer, holders), held))
}

/// Whether each node of the layer lies in the region `bind`; an error consists of a problem and its remedy.
pub fn selected(
    bind: &Bind,
    layer: &Layer,
    mesh: &Numbered,
    skin: &TriangleMesh,
) -> std::result::Result<Vec<bool>, (String, String)> {
    if let Bind::Group(group) = bind {
        let of_group = mesh.groups.nodes_of(group)?;
        // Nodes of a group that belong to no tetrahedron are left out, like the others of the file.
        return Ok(mesh.numbers.iter().map(|number| of_group.binary_search(number).is_ok()).collect());
    }
    let own = |(problem, remedy): (String, &'static str)| (problem, remedy.to_string());
    let bind = renumbered(bind, mesh.numbers).map_err(own)?;
    bind::named(layer, (&skin.vertices, &skin.triangles), &bind).map_err(own)
}

/// If `bind` lists nodes, translates their numbers in the layer's file into indices of the layer's nodes.
fn renumbered(bind: &Bind, numbers: &[u32]) -> std::result::Result<Bind, (String, &'static str)> {
    let Bind::Nodes(list) = bind else { return Ok(bind.clone()) };
    let place = |node: &u32| match numbers.binary_search(node) {
        Ok(place) => Ok(place as u32),
        // Numbers beyond the file's last node are left for `bind::named` to refuse.
        Err(place) if place == numbers.len() => Ok(*node),
        Err(_) => Err((format!("node {node} belongs to no tetrahedron"), "name nodes of tetrahedra")),
    };
    list.iter().map(place).collect::<std::result::Result<_, _>>().map(Bind::Nodes)
}

/// Assigns each free node to the core whose nearest attached node is nearest along the layer's edges (algorithm of
/// E. Dijkstra 1959); if two cores are equally far, to the core with the lower index.
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
    // The distances are not negative, so their bit patterns, read as integers, have the order of the distances.
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

/// The rigid frames of a soft body: one for each core, with its origin at the centre of mass of the attached nodes or
/// on the core's hinge, and a fixed one where the body has supports; without either, one floating frame at the centre of
/// mass. `layer` is in the rest frame (m),
/// `holders` is the result of the function `bind`. It is an error (key, problem, remedy) if all nodes of a dynamic core
/// lie on one line or on the core's hinge: the core would have no inertia about that line or hinge.
pub fn frames(
    body: &Body,
    layer: &Layer,
    holders: &[u32],
    materials: &Materials,
) -> std::result::Result<Vec<Frame>, (String, &'static str, &'static str)> {
    if body.cores.is_empty() {
        let floating = floating(layer, materials);
        let motion = if body.supports.is_empty() { floating.motion } else { FrameMotion::Fixed };
        return Ok(vec![Frame { motion, ..floating }]);
    }
    let shares = shares(layer, materials);
    let frame = |(index, core): (usize, &crate::scene::Core)| {
        let attached = (0..holders.len()).filter(|&n| layer.attached[n] && holders[n] == index as u32);
        let add = |(sum, all): (DVec3, f64), n: usize| (sum + shares[n] * layer.nodes[n], all + shares[n]);
        let (sum, all) = attached.fold((DVec3::ZERO, 0.0), add);
        let motion = match &core.motion {
            Motion::Fixed => FrameMotion::Fixed,
            Motion::Kinematic(keys) => FrameMotion::Kinematic(keys.clone()),
            Motion::Dynamic => dynamic(core, body.metres()),
        };
        let mut centre = sum / f64::max(all, f64::MIN_POSITIVE);
        if let FrameMotion::Dynamic { hinge, .. } = motion {
            centre = hinge.map_or(centre, |hinge| hinge.point);
            let attached = (0..holders.len()).filter(|&n| layer.attached[n] && holders[n] == index as u32);
            let inertia = attached.fold(DMat3::ZERO, |sum, n| sum + point_inertia(shares[n], layer.nodes[n] - centre));
            let size = (inertia.x_axis.x + inertia.y_axis.y + inertia.z_axis.z) / 3.0;
            let (spread, problem) = match hinge {
                Some(Hinge { axis, .. }) => {
                    (axis.dot(inertia * axis) / size, "the core has no inertia: all its nodes lie on its hinge")
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
    let mut frames: Vec<Frame> = body.cores.iter().enumerate().map(frame).collect::<std::result::Result<_, _>>()?;
    if !body.supports.is_empty() {
        let own = || (0..holders.len()).filter(|&n| holders[n] as usize == body.cores.len());
        let centre = own().map(|n| layer.nodes[n]).sum::<DVec3>() / own().count().max(1) as f64;
        frames.push(Frame { centre, motion: FrameMotion::Fixed });
    }
    Ok(frames)
}

/// Motion of the frame of a dynamic core; `scale` is the factor by which the body's coordinates are scaled.
pub fn dynamic(core: &crate::scene::Core, scale: f64) -> FrameMotion {
    let hinge = core.hinge.map(|hinge| Hinge { point: scale * hinge.point, ..hinge });
    FrameMotion::Dynamic { mass: core.mass, hinge }
}

/// Makes the floating frame of a body, with the mass, centre of mass and inertia of the layer. The layer's mass is
/// lumped at its nodes.
pub fn floating(layer: &Layer, materials: &Materials) -> Frame {
    let shares = shares(layer, materials);
    let weighted = || shares.iter().zip(&layer.nodes);
    let all: f64 = shares.iter().sum();
    let centre = weighted().map(|(m, x)| *m * *x).sum::<DVec3>() / all;
    let inertia = weighted().fold(DMat3::ZERO, |sum, (m, x)| sum + point_inertia(*m, *x - centre));
    let density = materials.all[0].density;
    Frame { centre, motion: FrameMotion::Floating { mass: density * all, inertia: inertia * density } }
}

/// Lumped mass of each node divided by the density of the body's base material, m^3. Because of this division, the
/// centre of mass of a body with one material has the same bits for any density.
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

/// Inertia tensor of a point mass at the offset `r` (m) from the centre, in the unit of `mass` times m^2.
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
        // A fork of two prongs on a base: core 0 binds the first prong's tip, core 1 the base. The node at the second
        // prong's tip is nearer to core 0 in space, but nearer to core 1 along the layer's edges.
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
        block.attached = block.nodes.iter().map(|x| x.x == 0.0 && x.y == 0.0).collect();
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
        assert!(key == "core.core0.bind" && problem.contains("lie on its hinge"), "key {key}, problem: {problem}");
        // The nodes lie on a line, but at a distance from this hinge, so that they have inertia about the hinge. The
        // hinge's point is scaled with the body, by the factor 2.
        assert_eq!(frames_on(DVec3::new(0.05, 0.0, 0.0)).unwrap()[0].centre, DVec3::new(0.1, 0.0, 0.0));
    }

    #[test]
    fn a_floating_frame_has_the_mass_and_inertia_of_a_block() {
        let block = layer::kuhn_box(DVec3::ZERO, DVec3::new(0.2, 0.4, 0.6), [16, 16, 16]);
        let material = Material { density: 500.0, ..crate::prepare::tests::MATERIAL }.into();
        let frame = floating(&block, &material);
        let FrameMotion::Floating { mass, inertia } = frame.motion else { panic!("the frame is not floating") };
        assert!((mass - 24.0).abs() < 1e-9 && frame.centre.distance(DVec3::new(0.1, 0.2, 0.3)) < 0.002);
        let want = mass / 12.0 * (0.16 + 0.36);
        // Lumping the mass at the nodes adds inertia in proportion to the square of the cell edge.
        assert!(
            (inertia.x_axis.x / want - 1.0).abs() < 0.01,
            "inertia about x: {} kg m^2, expected {want} kg m^2",
            inertia.x_axis.x
        );
    }
}
