//! Variants of a solver kernel that run at the same time: for blocks of free nodes (a block is the nodes that one
//! workgroup owns), for blocks of nodes attached to dynamic cores (rigid bodies inside soft ones), and for the tool
//! (the rigid body that the haptic device leads). Each variant reads the arrays as they were before any variant ran,
//! and no two variants write the same word.

use bytemuck::Pod;

use super::Passes;
use crate::harness::{CANARY, Outcome};

/// The role of a variant (shaders/shared/roles.glsl) that works on blocks of free nodes.
pub const FREE: u32 = 0;
/// The role of a variant that works on nodes attached to dynamic cores.
pub const CARRIED: u32 = 1;
/// The role of a variant that works on the six unknowns of the tool.
const TOOL: u32 = 2;

/// A variant: its role, its first block, and its number of workgroups.
pub struct Variant {
    pub role: u32,
    pub first: usize,
    pub groups: usize,
}

/// An array full of canaries, the harness's mark of unwritten words.
pub fn unwritten<T: Pod>(len: usize) -> Vec<T> {
    bytemuck::allocation::pod_collect_to_vec(&vec![CANARY; len * size_of::<T>() / 4])
}

/// An array after all variants have run; panics where two variants wrote the same word.
pub fn merged<T: Pod>(name: &str, given: &[T], outcomes: &[Outcome]) -> Vec<T> {
    let before: Vec<u32> = bytemuck::allocation::pod_collect_to_vec(given);
    let mut words = before.clone();
    for outcome in outcomes {
        for (i, after) in outcome.get::<u32>(name).into_iter().enumerate().filter(|(i, after)| *after != before[*i]) {
            assert_eq!(words[i], before[i], "word {i} of {name} is written by two variants");
            words[i] = after;
        }
    }
    bytemuck::allocation::pod_collect_to_vec(&words)
}

/// Checks that exactly the elements for which `written` holds were written, and sets the others to zero.
pub fn settled<const N: usize>(
    name: &str,
    mut values: Vec<[f32; N]>,
    written: impl Fn(usize) -> bool,
) -> Vec<[f32; N]> {
    for (i, value) in values.iter_mut().enumerate() {
        let blank = value.iter().filter(|x| x.to_bits() == CANARY).count();
        assert_eq!(blank, if written(i) { 0 } else { N }, "number of unwritten words in element {i} of {name}");
        if blank > 0 {
            *value = [0.0; N];
        }
    }
    values
}

impl Passes {
    /// The variants for which the model has work.
    pub fn variants(&self) -> Vec<Variant> {
        let (free, all) = (self.system.model.blocks.free, self.blocks());
        let roles = [(FREE, 0, free), (CARRIED, free, all - free), (TOOL, 0, usize::from(self.tool))];
        let variants = roles.into_iter().map(|(role, first, groups)| Variant { role, first, groups });
        variants.filter(|variant| variant.groups > 0).collect()
    }

    /// The role of the block that each node is in; `None` for nodes in no block.
    pub fn roles(&self) -> Vec<Option<u32>> {
        let mut roles = vec![None; self.nodes()];
        let blocks = &self.system.model.blocks;
        for (b, [first, count, ..]) in blocks.blocks.iter().enumerate() {
            for node in &blocks.nodes[*first as usize..(first + count) as usize] {
                assert_eq!(roles[node[0] as usize], None, "node {} is in two blocks", node[0]);
                roles[node[0] as usize] = Some(if b < blocks.free { FREE } else { CARRIED });
            }
        }
        roles
    }

    /// The role of the block whose modes (its motions in the coarse space: affine, or rigid on a core) are
    /// stored at `coarse_index`, or the tool's role where there is no such block.
    pub fn role_of_coarse_index(&self, coarse_index: usize) -> u32 {
        let blocks = &self.system.model.blocks;
        match blocks.coarse_indices.iter().position(|own| *own as usize == coarse_index) {
            Some(b) if b < blocks.free => FREE,
            Some(_) => CARRIED,
            None => TOOL,
        }
    }
}
