//! Selects the nodes of a layer (tetrahedral mesh of a soft body) that are to be attached to a *core* (rigid body
//! inside the soft body): the nodes in the core's region `bind`, for example a box. The *skin* is the body's surface
//! mesh; a *bone* is a core whose region is a capsule. Coordinates are file coordinates: the body's scale is not yet
//! applied.

use glam::DVec3;

use super::distance::{HALF, Solid};
use super::{Layer, layer, repair};
use crate::scene::{Bind, Capsule, Core};

/// A node whose distance from the skin is below this share of the diagonal of the skin's bounding box lies on the skin.
const ON_SKIN: f64 = 1e-9;

/// Returns for each node of the layer whether it lies in the region `bind`. `skin` and the layer are in file
/// coordinates. An error consists of a problem and its remedy.
pub fn named(layer: &Layer, skin: (&[DVec3], &[[u32; 3]]), bind: &Bind) -> Result<Vec<bool>, (String, &'static str)> {
    Ok(match bind {
        Bind::All => vec![true; layer.nodes.len()],
        Bind::Box { low, high } => layer.nodes.iter().map(|n| n.cmpge(*low).all() && n.cmple(*high).all()).collect(),
        Bind::Sphere { centre, radius } => layer.nodes.iter().map(|n| n.distance(*centre) <= *radius).collect(),
        Bind::Inset(least) => {
            let depths = depths(layer, skin).map_err(|problem| (problem, "give a closed surface"))?;
            depths.iter().map(|depth| depth >= least).collect()
        }
        // `cores::selected` looks groups up in the layer's file.
        Bind::Group(_) => return Err(("no group is known here".into(), "give the nodes in another way")),
        Bind::Capsule(capsule) => layer.nodes.iter().map(|&n| capsule_depth(n, capsule) <= 1.0).collect(),
        Bind::Nodes(list) => {
            let mut named = vec![false; layer.nodes.len()];
            for &node in list {
                let count = layer.nodes.len();
                *named.get_mut(node as usize).ok_or_else(|| {
                    (
                        format!("node {node} does not exist: the layer has {count} nodes"),
                        "number the nodes from 0, in the order of the layer's file",
                    )
                })? = true;
            }
            named
        }
    })
}

/// Depth of each node below the skin, in file coordinates; negative outside. Holes of the skin are closed by triangle
/// fans. It is an error if no triangle of the skin has an area, or if a coordinate of a skin vertex is not finite.
pub fn depths(layer: &Layer, (vertices, triangles): (&[DVec3], &[[u32; 3]])) -> Result<Vec<f64>, String> {
    let (vertices, triangles) = repair::closed(vertices, triangles);
    let surface = Solid::new(&vertices, &triangles).map_err(|e| format!("the skin cannot be searched: {e}"))?;
    let low = vertices.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let size = vertices.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max).distance(low);
    let depth = |&node: &DVec3| {
        let distance = surface.distance(node);
        // On the skin the winding number is one half up to rounding, and could not tell inside from outside.
        if distance <= ON_SKIN * size || surface.winding(node) > HALF { distance } else { -distance }
    };
    Ok(layer.nodes.iter().map(depth).collect())
}

/// Distance of a point from the nearest point of a capsule's axis, divided by the capsule's radius at that nearest
/// point: at most 1 inside the capsule.
pub fn capsule_depth(point: DVec3, capsule: &Capsule) -> f64 {
    let [a, b] = capsule.ends;
    let along = b - a;
    let t = if along == DVec3::ZERO { 0.0 } else { ((point - a).dot(along) / along.length_squared()).clamp(0.0, 1.0) };
    (point - a - t * along).length() / (capsule.radii[0] + t * (capsule.radii[1] - capsule.radii[0]))
}

/// Unmarks the nodes that belong to another bone in `named`, which marks the nodes selected for the bone with index
/// `index`. If capsules overlap, a node belongs to the bone with the least [`capsule_depth`], in a tie to the bone with
/// the lowest index. A core that is no bone keeps all of its selected nodes.
pub fn nearer_bones(layer: &Layer, cores: &[Core], index: usize, named: &mut [bool]) {
    let bone = |core: &Core| if let Some(Bind::Capsule(capsule)) = core.bind { Some(capsule) } else { None };
    let Some(own) = bone(&cores[index]) else { return };
    for (node, named) in layer.nodes.iter().zip(named).filter(|(_, named)| **named) {
        let depth = capsule_depth(*node, &own);
        let nearer = |(other, core): (usize, &Core)| {
            bone(core)
                .map(|capsule| capsule_depth(*node, &capsule))
                .is_some_and(|d| d < depth || d == depth && other < index)
        };
        *named = !cores.iter().enumerate().any(nearer);
    }
}

/// Finds nodes that nothing holds: the nodes of each connected part of the layer of which no node is `held`. Returns the
/// number of such nodes and the lowest index among them; `None` if there are none.
pub fn unattached(layer: &Layer, held: &[bool]) -> Option<(usize, u32)> {
    let (labels, count) = layer::parts(layer);
    let mut is_held = vec![false; count];
    for (&label, &held) in labels.iter().zip(held) {
        is_held[label as usize] |= held;
    }
    let mut loose = (0..labels.len()).filter(|&n| !is_held[labels[n] as usize]);
    let first = loose.next()?;
    Some((1 + loose.count(), first as u32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Motion;

    fn bound(region: Bind) -> Result<Vec<u32>, (String, &'static str)> {
        let layer = layer::kuhn_box(DVec3::ZERO, DVec3::ONE, [4, 4, 4]);
        let (v, t, _) = layer::boundary(&layer);
        let named = named(&layer, (&v, &t), &region)?;
        Ok((0..125).filter(|&n| named[n as usize]).collect())
    }

    #[test]
    fn each_region_binds_its_nodes() {
        assert_eq!(bound(Bind::All).unwrap().len(), 125);
        let high = DVec3::new(1.0, 0.0, 1.0);
        assert_eq!(bound(Bind::Box { low: DVec3::ZERO, high }).unwrap().len(), 25);
        assert_eq!(bound(Bind::Sphere { centre: DVec3::ZERO, radius: 0.26 }).unwrap(), [0, 1, 5, 25]);
        assert_eq!(bound(Bind::Nodes(vec![7, 3, 7])).unwrap(), [3, 7]);
        assert!(bound(Bind::Nodes(vec![125])).unwrap_err().0.contains("node 125 does not exist"));
        assert_eq!(bound(Bind::Inset(0.2)).unwrap().len(), 27);
        assert_eq!(bound(Bind::Inset(0.3)).unwrap(), [62]);
        assert!(bound(Bind::Inset(0.6)).unwrap().is_empty());
    }

    #[test]
    fn a_capsule_binds_its_nodes() {
        let rod = |radii| Capsule { ends: [DVec3::ZERO, DVec3::new(0.5, 0.0, 0.0)], radii };
        // The capsule's axis runs through nodes 0, 1 and 2. The nodes are 0.25 apart, so that a radius of 0.26 adds
        // node 3 beyond the axis's end, and the neighbours of nodes 0, 1 and 2 in y and in z.
        assert_eq!(bound(Bind::Capsule(rod([0.1, 0.1]))).unwrap(), [0, 1, 2]);
        assert_eq!(bound(Bind::Capsule(rod([0.26, 0.26]))).unwrap(), [0, 1, 2, 3, 5, 6, 7, 25, 26, 27]);
        assert_eq!(bound(Bind::Capsule(rod([0.05, 0.26]))).unwrap(), [0, 1, 2, 3, 7, 27]);
    }

    #[test]
    fn of_overlapping_bones_the_nearest_has_a_node() {
        let layer = layer::kuhn_box(DVec3::ZERO, DVec3::ONE, [4, 4, 4]);
        let core = |low: f64, high: f64, radius: f64| {
            let ends = [low, high].map(|x| DVec3::new(x, 0.0, 0.0));
            let bind = Some(Bind::Capsule(Capsule { ends, radii: [radius; 2] }));
            Core { name: String::new(), motion: Motion::Fixed, bind, mass: None, hinge: None }
        };
        // The third bone equals the second, so the second bone gets the nodes of both. The fourth core binds a sphere,
        // so it is no bone: it neither loses nodes to a bone nor takes any from one.
        let mut cores = vec![core(0.0, 0.5, 0.3), core(1.0, 1.0, 0.6), core(1.0, 1.0, 0.6)];
        cores.push(Core { bind: Some(Bind::Sphere { centre: DVec3::ZERO, radius: 0.1 }), ..cores[0].clone() });
        let held = |index| {
            let mut named: Vec<bool> = layer.nodes.iter().map(|n| n.y == 0.0 && n.z == 0.0).collect();
            nearer_bones(&layer, &cores, index, &mut named);
            (0..5).filter(|&n| named[n]).collect::<Vec<_>>()
        };
        assert_eq!(held(0), [0, 1, 2]);
        assert_eq!(held(1), [3, 4]);
        assert!(held(2).is_empty());
        assert_eq!(held(3), [0, 1, 2, 3, 4]);
    }

    #[test]
    fn inset_leaves_out_nodes_beyond_the_skin() {
        let layer = layer::kuhn_box(DVec3::ZERO, DVec3::ONE, [4, 4, 4]);
        let (v, t, _) = layer::boundary(&layer::kuhn_box(DVec3::ZERO, DVec3::new(0.3, 1.0, 1.0), [1, 1, 1]));
        let named = named(&layer, (&v, &t), &Bind::Inset(0.04)).unwrap();
        assert!((0..125).all(|n| !named[n] || layer.nodes[n].x == 0.25));
        assert!(named.contains(&true));
    }

    #[test]
    fn a_part_without_bound_nodes_is_found() {
        let mut layer = layer::kuhn_box(DVec3::ZERO, DVec3::ONE, [1, 1, 1]);
        layer.tetrahedra.extend(layer.tetrahedra.clone().iter().map(|t| t.map(|i| i + 8)));
        layer.nodes.extend_from_within(..);
        let mut held = vec![false; 16];
        held[3] = true;
        assert_eq!(unattached(&layer, &held), Some((8, 8)));
        held[15] = true;
        assert_eq!(unattached(&layer, &held), None);
    }
}
