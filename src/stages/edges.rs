//! The edges of the tetrahedra, and the rows of 3x3 blocks in which the solver keeps its operator as a matrix. An *edge*
//! is a pair of nodes that share a tetrahedron.

use crate::shaders::{NODE_FREE, NODE_KINEMATIC, NONE, ROW_SLICE};

use super::model::Model;

/// Number of edges, consecutive in the order of their nodes, that are sorted by their number of tetrahedra, so that the
/// lanes of a subgroup have equal work and yet read neighbouring tetrahedra.
const SORTED_TOGETHER: usize = 256;

/// The edges of a model's tetrahedra and the rows of its matrix, as arrays for the kernels. A tetrahedron whose nodes are
/// all attached to one core, or all move as prescribed, exerts no force that the solver must know, and has no edges.
#[derive(Debug, Clone, Default)]
pub struct Edges {
    /// Per edge: index of its first entry in `elements`, number of its entries, and the first texels in `blocks` of the
    /// edge's two blocks, in the row of its first node and in that of its second. The node with the smaller index comes
    /// first. `NONE` stands for a block in the row of a node that moves as prescribed, which is not needed.
    pub edges: Vec<[u32; 4]>,
    /// Edge by edge, without gaps, an entry for each of the edge's tetrahedra: 16 times the tetrahedron's index, plus
    /// four times the corner at which it has the edge's first node, plus the corner at which it has the second. The
    /// array is padded to a whole texel of four entries.
    pub elements: Vec<[u32; 4]>,
    /// The blocks, in the format of shaders/shared/rows.glsl: zeros, and the columns' indices.
    pub blocks: Vec<[f32; 4]>,
    /// As the blocks' array `nodes`, with the row's first texel and number of blocks in place of the texels of
    /// `node_elements`.
    pub block_nodes: Vec<[u32; 4]>,
}

impl Edges {
    /// The edges of a model whose blocks of nodes are made already.
    pub fn of(model: &Model) -> Edges {
        let entries = entries(model);
        let mut groups: Vec<_> = entries.chunk_by(|a, b| a.0 == b.0).collect();
        groups.chunks_mut(SORTED_TOGETHER).for_each(|part| part.sort_by_key(|group| group.len()));
        let (mut edges, mut elements) = (Edges::default(), Vec::new());
        let mut adjacent = vec![Vec::new(); model.node_info.len()];
        for (e, group) in groups.iter().enumerate() {
            let [i, j] = group[0].0;
            adjacent[i as usize].push((j, e, 2));
            adjacent[j as usize].push((i, e, 3));
            edges.edges.push([elements.len() as u32, group.len() as u32, NONE, NONE]);
            elements.extend(group.iter().map(|entry| entry.1));
        }
        edges.elements = elements.chunks(4).map(|four| std::array::from_fn(|k| *four.get(k).unwrap_or(&0))).collect();
        for [first, count, ..] in &model.blocks.blocks {
            let nodes = &model.blocks.nodes[*first as usize..(first + count) as usize];
            nodes.chunks(ROW_SLICE as usize).for_each(|slice| edges.add_slice(slice, &adjacent));
        }
        edges
    }

    /// Adds the rows of nodes that are neighbours in a block. `adjacent`: for each node, its other nodes, with the edge
    /// and with the place in `edges` that tells where the block is.
    fn add_slice(&mut self, nodes: &[[u32; 4]], adjacent: &[Vec<(u32, usize, usize)>]) {
        let (base, lanes) = (self.blocks.len(), ROW_SLICE as usize);
        let longest = nodes.iter().map(|node| adjacent[node[0] as usize].len()).max().unwrap_or_default();
        self.blocks.resize(base + 3 * lanes * longest, [0.0; 4]);
        for (lane, [node, _, _, damping]) in nodes.iter().enumerate() {
            let row = &adjacent[*node as usize];
            for (k, (other, edge, place)) in row.iter().enumerate() {
                let at = base + 3 * lanes * k + lane;
                self.blocks[at][3] = *other as f32;
                self.edges[*edge][*place] = at as u32;
            }
            self.block_nodes.push([*node, (base + lane) as u32, row.len() as u32, *damping]);
        }
    }
}

/// The edges of all tetrahedra, sorted by their two nodes, with what [`Edges::elements`] says of the tetrahedron.
fn entries(model: &Model) -> Vec<([u32; 2], u32)> {
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
    entries
}

impl Model {
    /// What determines the motion of a node that is no unknown: the frame of its core, or `NONE` if it moves as
    /// prescribed. `None` for a free node.
    fn holder(&self, node: u32) -> Option<u32> {
        match self.node_info[node as usize] {
            [_, _, _, NODE_FREE] => None,
            [_, _, _, NODE_KINEMATIC] => Some(NONE),
            [_, _, frame, _] => Some(frame),
        }
    }
}
