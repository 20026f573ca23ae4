//! F-bar patches on the GPU: groups of tetrahedra that share one volumetric strain, against volumetric locking
//! ([`crate::prepare::patch`]). A patch adds c c^T to the operator, the matrix of the solver's linear system; its row c
//! is the scaled gradient of the shared strain with respect to the positions of its nodes. One pass in each Newton
//! iteration writes the rows and the patches' part of the right-hand side. In the solver's loop a patch counts as one
//! more element: its product with a vector is computed at the same time as the products of the tetrahedra, and all
//! these products are summed at the nodes.

use std::ops::Range;
use std::sync::Arc;

use super::elastic::Elastic;
use super::{Common, count, upload, zeros};
use crate::Result;
use crate::gpu::{Buffer, Context, Kernel, Recorder, Size};
use crate::prepare::Layer;
use crate::prepare::layer::volume6;
use crate::prepare::patch::{MOST_NODES, MOST_TETRAHEDRA};
use crate::shaders;
use crate::shaders::NONE;

/// Static arrays of the patches of all bodies.
#[derive(Debug, Clone, Default)]
pub struct Patches {
    /// Per tetrahedron: its patch, or `NONE`.
    pub of: Vec<u32>,
    /// Per patch: its nodes in three uvec4; where it has fewer than twelve nodes, its first node fills the rest.
    nodes: Vec<[[u32; 4]; 3]>,
    /// Per patch: its members in six pairs. A member is the index of a tetrahedron (`NONE` after the last member) and
    /// the places of the tetrahedron's four nodes in the patch's node list, four bits each.
    members: Vec<[[u32; 4]; 6]>,
    /// Per patch: volume (m^3), Lame parameter lambda (Pa), coefficient beta of stiffness-proportional damping (s), 0.
    pub constants: Vec<[f32; 4]>,
    /// Per patch: its nodes in the order of `nodes`, without the padding.
    node_lists: Vec<Vec<u32>>,
}

impl Patches {
    /// Appends the patches of a tetrahedral mesh, whose nodes and tetrahedra come next among those of all bodies.
    /// `material`: lambda (Pa) and beta (s) of a tetrahedron, as in `constants`; `rigid`: whether all nodes of a
    /// tetrahedron are attached to one rigid core, so that it cannot deform; a patch that consists of such tetrahedra
    /// alone is left out.
    pub fn add(
        &mut self,
        layer: &Layer,
        node_first: usize,
        material: impl Fn(usize) -> [f64; 2],
        rigid: impl Fn(usize) -> bool,
    ) {
        let tetrahedron_first = self.of.len();
        self.of.resize(tetrahedron_first + layer.tetrahedra.len(), NONE);
        let mut members = vec![Vec::new(); layer.patches.iter().max().map_or(0, |last| *last as usize + 1)];
        layer.patches.iter().enumerate().for_each(|(t, patch)| members[*patch as usize].push(t));
        for own in members.iter().filter(|own| !own.iter().all(|t| rigid(*t))) {
            let mut nodes: Vec<u32> = Vec::new();
            let mut entries = [[NONE, 0]; MOST_TETRAHEDRA];
            let mut volume = 0.0;
            for (entry, t) in entries.iter_mut().zip(own) {
                self.of[tetrahedron_first + t] = self.constants.len() as u32;
                volume += volume6(&layer.nodes, &layer.tetrahedra[*t]) / 6.0;
                let mut corners = 0;
                for (k, node) in layer.tetrahedra[*t].iter().enumerate() {
                    let node = node + node_first as u32;
                    let slot = nodes.iter().position(|n| *n == node).unwrap_or_else(|| {
                        nodes.push(node);
                        nodes.len() - 1
                    });
                    corners |= (slot as u32) << (4 * k);
                }
                *entry = [(tetrahedron_first + t) as u32, corners];
            }
            let [lambda, beta] = material(own[0]).map(|x| x as f32);
            self.constants.push([volume as f32, lambda, beta, 0.0]);
            self.members.push(std::array::from_fn(|k| {
                let [[a, b], [c, d]] = [entries[2 * k], entries[2 * k + 1]];
                [a, b, c, d]
            }));
            let padded: [u32; MOST_NODES] = std::array::from_fn(|k| nodes.get(k).copied().unwrap_or(nodes[0]));
            self.nodes.push(std::array::from_fn(|q| std::array::from_fn(|k| padded[4 * q + k])));
            self.node_lists.push(nodes);
        }
    }

    /// Number of patches.
    pub fn count(&self) -> usize {
        self.constants.len()
    }

    /// Every node of every patch from index `first` on, as the node, the patch, and the node's place in the patch's
    /// node list. On the GPU the patch's row at that node has the index place x [`Patches::count`] + patch. The patch's
    /// force on the node has the same index in the part of the force array that follows the tetrahedra's forces and
    /// four zero vectors.
    pub fn entries(&self, first: usize) -> impl Iterator<Item = (u32, [u32; 2])> {
        let lists = self.node_lists.iter().zip(0..).skip(first);
        lists.flat_map(|(nodes, p)| nodes.iter().zip(0..).map(move |(node, k)| (*node, [p, k])))
    }

    /// Indices of the patches whose nodes all lie in this range.
    pub(super) fn within<'a>(&'a self, nodes: &'a Range<usize>) -> impl Iterator<Item = usize> + 'a {
        (0..self.count()).filter(|p| self.node_lists[*p].iter().all(|n| nodes.contains(&(*n as usize))))
    }

    /// The tetrahedra of a patch.
    pub(super) fn members_of(&self, patch: usize) -> impl Iterator<Item = usize> {
        let pairs = self.members[patch].into_iter().flat_map(|[a, _, c, _]| [a, c]);
        pairs.filter(|t| *t != NONE).map(|t| t as usize)
    }

    /// The nodes of the patches in the order that the GPU needs: the first uvec4 of every patch, then the second, then
    /// the third.
    pub fn device_nodes(&self) -> Vec<[u32; 4]> {
        beside(&self.nodes)
    }

    /// The members of the patches in the order that the GPU needs, interleaved as in [`Patches::device_nodes`]. Padding
    /// becomes the index after the last tetrahedron, at which the gradients are zero; so this is called once all bodies
    /// have been added.
    pub fn device_members(&self) -> Vec<[u32; 4]> {
        let nothing = self.of.len() as u32;
        beside(&self.members).iter().map(|pair| pair.map(|x| if x == NONE { nothing } else { x })).collect()
    }
}

/// Interleaves rows: the first element of every row, then the second of every row and so on, so that neighbouring
/// invocations (one per row) read neighbouring elements.
fn beside<const N: usize>(rows: &[[[u32; 4]; N]]) -> Vec<[u32; 4]> {
    (0..N).flat_map(|k| rows.iter().map(move |row| row[k])).collect()
}

/// The kernel that runs after elastic/element_forces (the forces of the tetrahedra), and the patch arrays that the
/// solver reads.
pub struct MeanDilatation {
    kernel: Kernel,
    /// Variant of the kernel for further Newton iterations of a step.
    newton: Option<Kernel>,
    /// Number of patches.
    pub patch_count: usize,
    /// Per tetrahedron: its patch, or `NONE`; elastic/element_forces reads it.
    pub patch_of: Buffer,
    /// Three uvec4 of node indices per patch.
    pub nodes: Buffer,
    members: Buffer,
    constants: Buffer,
    /// Twelve vec4 per patch, one for each of its nodes: the patch's row c, by which it adds c c^T to the operator.
    pub rows: Buffer,
}

impl MeanDilatation {
    /// Kernels and arrays, for a model with patches. `newton`: whether a step may have several Newton iterations.
    pub fn new(context: &Arc<Context>, patches: &Patches, newton: bool) -> Result<MeanDilatation> {
        let constants = [("PATCHES", count(patches.count())), ("TETRAHEDRA", count(patches.of.len()))];
        let kernel = |newton: bool| {
            let constants = [&constants[..], &[("NEWTON", newton.into())]].concat();
            Kernel::new(context, "elastic/mean_dilatation", Size::Group, &constants)
        };
        Ok(MeanDilatation {
            kernel: kernel(false)?,
            newton: newton.then(|| kernel(true)).transpose()?,
            patch_count: patches.count(),
            patch_of: upload(context, "patch_of", &patches.of)?,
            nodes: upload(context, "patch_nodes", &patches.device_nodes())?,
            members: upload(context, "patch_members", &patches.device_members())?,
            constants: upload(context, "patch_constants", &patches.constants)?,
            rows: zeros::<[f32; 4]>(context, "patch_rows", MOST_NODES * patches.count())?,
        })
    }

    /// Writes the material constants of the patches to the GPU, after a change of materials alone.
    pub fn refresh(&self, patches: &Patches) -> Result<()> {
        self.constants.write(&patches.constants)
    }

    /// Records one pass over the patches, after elastic/element_forces. `trial_change`: in a further Newton iteration,
    /// the change of velocity by the last solve.
    pub fn record(&self, recorder: &mut Recorder, common: &Common, elastic: &Elastic, trial_change: Option<&Buffer>) {
        recorder.stage("elastic");
        recorder.dispatch(
            self.newton.as_ref().filter(|_| trial_change.is_some()).unwrap_or(&self.kernel),
            &shaders::elastic::MeanDilatation {
                params: &common.params,
                patch_nodes: &self.nodes,
                patch_members: &self.members,
                patch_constants: &self.constants,
                rest_gradients: &elastic.rest_gradients,
                gradients: &elastic.gradients,
                velocity: &elastic.velocity,
                trial_change,
                patch_rows: &self.rows,
                element_forces: &elastic.element_forces,
            },
            self.patch_count as u32,
        );
    }
}
