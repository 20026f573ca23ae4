//! Patches on the device: tetrahedra that share one volumetric strain, against locking ([`crate::prepare::patch`]). A pass a
//! step writes each patch's row of the operator and what it gives to the right-hand side; in the solver's loop a patch is one
//! more element, applied beside the tetrahedra and gathered with them.

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

/// Static arrays of all bodies' patches.
#[derive(Debug, Clone, Default)]
pub struct Patches {
    /// Patch of each tetrahedron, or `NONE`.
    pub of: Vec<u32>,
    /// Three a patch: its nodes, the first again where there are fewer.
    nodes: Vec<[[u32; 4]; 3]>,
    /// Six a patch, two members each: a tetrahedron (`NONE`: no more), and where its nodes are among the patch's, four bits
    /// each.
    members: Vec<[[u32; 4]; 6]>,
    /// Volume (m^3), lambda (Pa), beta (s); a patch.
    pub constants: Vec<[f32; 4]>,
    /// Nodes of each patch, in their order.
    node_lists: Vec<Vec<u32>>,
}

impl Patches {
    /// Appends a layer whose nodes and tetrahedra come next among all. `material`: lambda (Pa) and beta (s) of a tetrahedron;
    /// `rigid`: whether a tetrahedron lies within one core, where nothing deforms and no patch is needed.
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

    /// How many there are.
    pub fn count(&self) -> usize {
        self.constants.len()
    }

    /// Every node of every patch from `first` on, with the patch and its place in it. On the device its row, and its force
    /// behind those of all tetrahedra and four zeros, stand at place times [`Patches::count`] plus patch.
    pub fn entries(&self, first: usize) -> impl Iterator<Item = (u32, [u32; 2])> {
        let lists = self.node_lists.iter().zip(0..).skip(first);
        lists.flat_map(|(nodes, p)| nodes.iter().zip(0..).map(move |(node, k)| (*node, [p, k])))
    }

    /// The patches of these nodes.
    pub(super) fn within<'a>(&'a self, nodes: &'a Range<usize>) -> impl Iterator<Item = usize> + 'a {
        (0..self.count()).filter(|p| self.node_lists[*p].iter().all(|n| nodes.contains(&(*n as usize))))
    }

    /// Tetrahedra of a patch.
    pub(super) fn members_of(&self, patch: usize) -> impl Iterator<Item = usize> {
        let pairs = self.members[patch].into_iter().flat_map(|[a, _, c, _]| [a, c]);
        pairs.filter(|t| *t != NONE).map(|t| t as usize)
    }

    /// Nodes as the device has them, patch beside patch.
    pub fn device_nodes(&self) -> Vec<[u32; 4]> {
        beside(&self.nodes)
    }

    /// Members as the device has them, the padding replaced by the tetrahedron that reads as nothing; called once all layers
    /// are in.
    pub fn device_members(&self) -> Vec<[u32; 4]> {
        let nothing = self.of.len() as u32;
        beside(&self.members).iter().map(|pair| pair.map(|x| if x == NONE { nothing } else { x })).collect()
    }
}

/// First every patch's first, then every one's second and so on, so that neighbouring invocations read side by side.
fn beside<const N: usize>(rows: &[[[u32; 4]; N]]) -> Vec<[u32; 4]> {
    (0..N).flat_map(|k| rows.iter().map(move |row| row[k])).collect()
}

/// The pass after elastic/rotate, and what the solver reads of patches.
pub struct Dilate {
    kernel: Kernel,
    /// Of a step that is linearised again.
    again: Option<Kernel>,
    /// How many.
    pub patch_count: usize,
    /// Patch of each tetrahedron, for elastic/rotate.
    pub patch_of: Buffer,
    /// Three a patch.
    pub nodes: Buffer,
    members: Buffer,
    constants: Buffer,
    /// Twelve a patch: its row of the operator.
    pub rows: Buffer,
}

impl Dilate {
    /// Kernels and arrays; made only where there are patches. `again`: whether a step may be linearised again.
    pub fn new(context: &Arc<Context>, patches: &Patches, again: bool) -> Result<Dilate> {
        let constants = [("PATCHES", count(patches.count())), ("TETRAHEDRA", count(patches.of.len()))];
        let kernel = |again: bool| {
            let constants = [&constants[..], &[("AGAIN", again.into())]].concat();
            Kernel::new(context, "elastic/dilate", Size::Group, &constants)
        };
        Ok(Dilate {
            kernel: kernel(false)?,
            again: again.then(|| kernel(true)).transpose()?,
            patch_count: patches.count(),
            patch_of: upload(context, "patch_of", &patches.of)?,
            nodes: upload(context, "patch_nodes", &patches.device_nodes())?,
            members: upload(context, "patch_members", &patches.device_members())?,
            constants: upload(context, "patch_constants", &patches.constants)?,
            rows: zeros::<[f32; 4]>(context, "patch_rows", MOST_NODES * patches.count())?,
        })
    }

    /// Takes up the materials of the same patches.
    pub fn refresh(&self, patches: &Patches) -> Result<()> {
        self.constants.write(&patches.constants)
    }

    /// One pass over patches, after elastic/rotate. `trial_change`: of the solve where the step is linearised again.
    pub fn record(&self, recorder: &mut Recorder, common: &Common, elastic: &Elastic, trial_change: Option<&Buffer>) {
        recorder.stage("elastic");
        recorder.dispatch(
            self.again.as_ref().filter(|_| trial_change.is_some()).unwrap_or(&self.kernel),
            &shaders::elastic::Dilate {
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
