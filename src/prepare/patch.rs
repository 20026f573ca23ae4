//! F-bar patches of a layer (tetrahedral mesh of a soft body): groups of neighbouring tetrahedra that share one
//! volumetric strain, their mean dilatation, which prevents volumetric locking. The method is that of E. A. de Souza
//! Neto, F. M. Andrade Pires, D. R. J. Owen, "F-bar-based linear triangles and tetrahedra for finite strain analysis of
//! nearly incompressible solids. Part I" (2005), with the mean dilatation of J. C. Nagtegaal, D. M. Parks, J. R. Rice,
//! "On numerically accurate finite element solutions in the fully plastic range" (1974).

use crate::shaders;
use std::collections::HashMap;

use super::{Layer, NONE, layer::FACES};

/// Greatest number of tetrahedra in a patch: twelve. Of the sizes from 6 to 24, this size comes closest to the
/// deflections of quadratic elements: smaller patches still lock on coarse meshes, and patches of 24 tetrahedra give
/// deflections under a load that are too large by 6 to 10 %.
pub const MOST_TETRAHEDRA: usize = shaders::PATCH_TETRAHEDRA as usize;
/// Greatest number of nodes in a patch.
pub const MOST_NODES: usize = shaders::PATCH_NODES as usize;

/// Index of the patch of each tetrahedron. A patch is connected over faces. It grows greedily by one neighbour at a
/// time, which keeps it compact. All tetrahedra of a patch have the same label `group` (the index of their material).
/// Tetrahedra whose four nodes are all attached to rigid cores hardly deform; a patch never mixes them with others.
pub fn patches(layer: &Layer, group: impl Fn(usize) -> u32) -> Vec<u32> {
    let neighbours = neighbours(&layer.tetrahedra);
    let bound = |t: usize| layer.tetrahedra[t].iter().all(|n| layer.attached[*n as usize]);
    let alike = |a: usize, b: usize| group(a) == group(b) && bound(a) == bound(b);
    let mut patch_of = vec![NONE; layer.tetrahedra.len()];
    let mut count = 0;
    for seed in 0..patch_of.len() {
        if patch_of[seed] != NONE {
            continue;
        }
        let (mut members, mut nodes) = (vec![seed], layer.tetrahedra[seed].to_vec());
        patch_of[seed] = count;
        while members.len() < MOST_TETRAHEDRA {
            let added = |t: usize| layer.tetrahedra[t].iter().filter(|n| !nodes.contains(n)).count();
            let free =
                |t: usize| neighbours[t].iter().filter(|n| **n != NONE && patch_of[**n as usize] == NONE).count();
            let inside = |t: usize| neighbours[t].iter().filter(|n| members.contains(&(**n as usize))).count();
            let candidates = members.iter().flat_map(|m| neighbours[*m]).filter(|n| *n != NONE).map(|n| n as usize);
            let open = candidates.filter(|t| patch_of[*t] == NONE && alike(*t, seed));
            // The best candidate adds the fewest nodes. In a tie, it shares the most faces with the patch; then it has
            // the fewest neighbours without a patch; then it has the lowest index.
            let best = open
                .filter(|t| nodes.len() + added(*t) <= MOST_NODES)
                .min_by_key(|t| (added(*t), std::cmp::Reverse(inside(*t)), free(*t), *t));
            let Some(best) = best else { break };
            patch_of[best] = count;
            members.push(best);
            let new: Vec<u32> = layer.tetrahedra[best].iter().filter(|n| !nodes.contains(n)).copied().collect();
            nodes.extend(new);
        }
        count += 1;
    }
    patch_of
}

/// Neighbour of each tetrahedron across each of its faces; [`NONE`] at the boundary.
fn neighbours(tetrahedra: &[[u32; 4]]) -> Vec<[u32; 4]> {
    let mut open = HashMap::new();
    let mut neighbours = vec![[NONE; 4]; tetrahedra.len()];
    for (t, nodes) in tetrahedra.iter().enumerate() {
        for (k, face) in FACES.iter().enumerate() {
            let mut key = face.map(|i| nodes[i]);
            key.sort_unstable();
            if let Some((other, side)) = open.remove(&key) {
                let (other, side): (usize, usize) = (other, side);
                neighbours[t][k] = other as u32;
                neighbours[other][side] = t as u32;
            } else {
                open.insert(key, (t, k));
            }
        }
    }
    neighbours
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use glam::DVec3;

    use super::*;
    use crate::prepare::layer::kuhn_box;

    fn members(patch_of: &[u32]) -> Vec<Vec<usize>> {
        let count = patch_of.iter().max().map_or(0, |last| last + 1);
        (0..count).map(|p| (0..patch_of.len()).filter(|t| patch_of[*t] == p).collect()).collect()
    }

    #[test]
    fn patches_of_a_box_are_two_cells_each() {
        let layer = kuhn_box(DVec3::ZERO, DVec3::ONE, [4, 4, 4]);
        let patches = members(&patches(&layer, |_| 0));
        assert_eq!(patches.len(), 32);
        for patch in patches {
            let nodes: BTreeSet<u32> = patch.iter().flat_map(|t| layer.tetrahedra[*t]).collect();
            assert_eq!((patch.len(), nodes.len()), (MOST_TETRAHEDRA, MOST_NODES));
        }
    }

    #[test]
    fn patches_keep_within_groups_and_limits() {
        let mut layer = kuhn_box(DVec3::ZERO, DVec3::ONE, [5, 3, 3]);
        layer.attached = layer.nodes.iter().map(|x| x.x < 0.41).collect();
        let group = |t: usize| u32::from(t.is_multiple_of(7));
        let bound = |t: usize| layer.tetrahedra[t].iter().all(|n| layer.attached[*n as usize]);
        let patches = members(&patches(&layer, group));
        assert_eq!(patches.iter().map(Vec::len).sum::<usize>(), layer.tetrahedra.len());
        for patch in patches {
            let nodes: BTreeSet<u32> = patch.iter().flat_map(|t| layer.tetrahedra[*t]).collect();
            assert!(patch.len() <= MOST_TETRAHEDRA && nodes.len() <= MOST_NODES);
            assert!(patch.iter().all(|t| group(*t) == group(patch[0]) && bound(*t) == bound(patch[0])));
        }
    }

    #[test]
    fn a_layer_of_nothing_has_no_patches() {
        assert!(patches(&Layer::default(), |_| 0).is_empty());
    }
}
