//! The edges of the tetrahedra, by which the solver keeps its operator as a matrix of 3x3 blocks. An *edge* is a pair of
//! nodes that share a tetrahedron.

use crate::shaders;

use super::model::Model;

/// Number of edges, consecutive in the order of their nodes, that are sorted by their number of tetrahedra, so that the
/// lanes of a subgroup have equal work and yet read neighbouring tetrahedra.
const SORTED_TOGETHER: usize = 256;

/// The edges of a model's tetrahedra, as arrays for the kernels. A tetrahedron whose nodes are all attached to one core,
/// or all move as prescribed, exerts no force that the solver must know, and has no edges.
#[derive(Debug, Clone, Default)]
pub struct Edges {
    /// Per edge: index of its first entry in `elements`, number of its entries, and its two nodes; the node with the
    /// smaller index comes first.
    pub edges: Vec<[u32; 4]>,
    /// Edge by edge, without gaps, an entry for each of the edge's tetrahedra: 16 times the tetrahedron's index, plus
    /// four times the corner at which it has the edge's first node, plus the corner at which it has the second. The
    /// array is padded to a whole texel of four entries.
    pub elements: Vec<[u32; 4]>,
    /// Per node of the blocks, its edges, two per texel: the other node, and twice the edge's index, plus 1 if the other
    /// node is the edge's first. The node's last texel is padded with the node itself and with edge number
    /// `edges.len()`, which stands for no stiffness.
    pub of_nodes: Vec<[u32; 4]>,
    /// As the blocks' array `nodes`, with the texels of `of_nodes` in place of those of `node_elements`.
    pub block_nodes: Vec<[u32; 4]>,
}

impl Edges {
    /// The edges of a model whose blocks are made already.
    pub fn of(model: &Model) -> Edges {
        let mut entries = Vec::new();
        for (t, nodes) in model.tetrahedra.iter().enumerate() {
            let holder = model.holder(nodes[0]);
            if holder.is_some() && nodes.iter().all(|n| model.holder(*n) == holder) {
                continue;
            }
            for (i, j) in [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)] {
                let (i, j) = if nodes[i] < nodes[j] { (i, j) } else { (j, i) };
                entries.push(([nodes[i], nodes[j]], (16 * t + 4 * i + j) as u32));
            }
        }
        entries.sort_unstable();
        let mut groups: Vec<_> = entries.chunk_by(|a, b| a.0 == b.0).collect();
        groups.chunks_mut(SORTED_TOGETHER).for_each(|part| part.sort_by_key(|group| group.len()));
        let mut edges = Edges::default();
        let (mut elements, mut adjacent) = (Vec::new(), vec![Vec::new(); model.node_info.len()]);
        for (e, group) in groups.iter().enumerate() {
            let [i, j] = group[0].0;
            adjacent[i as usize].push([j, 2 * e as u32]);
            adjacent[j as usize].push([i, 2 * e as u32 + 1]);
            edges.edges.push([elements.len() as u32, group.len() as u32, i, j]);
            elements.extend(group.iter().map(|entry| entry.1));
        }
        edges.elements = elements.chunks(4).map(|four| std::array::from_fn(|k| *four.get(k).unwrap_or(&0))).collect();
        let no_stiffness = 2 * edges.edges.len() as u32;
        for node in &model.blocks.nodes {
            let own = &adjacent[node[0] as usize];
            edges.block_nodes.push([node[0], edges.of_nodes.len() as u32, own.len().div_ceil(2) as u32, node[3]]);
            for two in own.chunks(2) {
                let [other, edge] = *two.get(1).unwrap_or(&[node[0], no_stiffness]);
                edges.of_nodes.push([two[0][0], two[0][1], other, edge]);
            }
        }
        edges
    }
}

impl Model {
    /// What determines the motion of a node that is no unknown: the frame of its core, or `NONE` if it moves as
    /// prescribed. `None` for a free node.
    fn holder(&self, node: u32) -> Option<u32> {
        match self.node_info[node as usize] {
            [_, _, _, shaders::NODE_FREE] => None,
            [_, _, _, shaders::NODE_KINEMATIC] => Some(shaders::NONE),
            [_, _, frame, _] => Some(frame),
        }
    }
}
