//! Tests that a variant of a kernel (its shader with other specialization constants) declares the buffers that it uses
//! and no others, both where arrays are read through texel buffers and where they are read through storage buffers.

use std::collections::BTreeSet;

use palpate::internal::gpu::{Arrays, Const, Kernel, Size};
use palpate::internal::shaders;

use crate::harness::{assert_clean, context};

/// Names of the buffers that the variant of `kernel` with these constants uses; they must be the same whether arrays
/// are read through texel buffers or through storage buffers.
fn buffers(kernel: &str, constants: &[(&str, Const)]) -> BTreeSet<String> {
    let [texel, storage] = [Arrays::Texel, Arrays::Storage].map(|arrays| {
        let kernel = Kernel::with_arrays(context(), kernel, Size::Reduce, constants, arrays).unwrap();
        kernel.bindings().iter().map(|binding| binding.name.clone()).collect::<BTreeSet<_>>()
    });
    assert_eq!(
        texel, storage,
        "{kernel} with {constants:?}: names of the buffers, with texel buffers (left) and with storage buffers (right)"
    );
    texel
}

/// Names of the buffers that the variant `with` uses in addition to those of the variant `without`.
fn more(kernel: &str, with: &[(&str, Const)], without: &[(&str, Const)]) -> Vec<String> {
    let (with, without) = (buffers(kernel, with), buffers(kernel, without));
    assert!(
        without.is_subset(&with),
        "{kernel}: the variant with a feature must use at least the buffers of the variant without it, {without:?}, \
         but uses {with:?}"
    );
    with.difference(&without).cloned().collect()
}

#[test]
fn a_feature_that_a_variant_lacks_takes_its_buffers_with_it() {
    let flag = |name, value: bool| [(name, Const::Bool(value))];
    let of = |kernel: &str, name| more(kernel, &flag(name, true), &flag(name, false));
    assert_eq!(of("solve/assemble", "CONTACT"), ["contacts", "node_entries", "sorted"]);
    assert_eq!(of("solve/assemble", "PATCHES"), ["patch_rows"]);
    assert_eq!(of("solve/assemble", "JOINTS"), ["joint_sides", "joints"]);
    assert_eq!(of("solve/conclude", "CONTACT"), ["contact_forces", "contacts"]);
    assert_eq!(of("contact/candidates", "SKINS"), ["hits", "shares"]);
    assert_eq!(of("elastic/element_forces", "NEWTON"), ["trial_change"]);
    // The assembled operator reads its rows in place of the forces of tetrahedra.
    let [assembled, free] = [true, false].map(|assembled| buffers("solve/gather", &flag("ASSEMBLED", assembled)));
    assert!(assembled.difference(&free).eq(["stiffness_blocks"]), "{assembled:?}");
    assert!(free.difference(&assembled).eq(["element_forces", "node_elements"]), "{free:?}");
    // `HELD` is the number of rigid cores (rigid bodies inside soft ones) that haptic devices lead as tools, through
    // springs and dampers (virtual couplings).
    let held = more("solve/assemble", &[("HELD", Const::Uint(1))], &[("HELD", Const::Uint(0))]);
    assert_eq!(held, Vec::<String>::new(), "buffers that only the variant with a led rigid core uses");
    // The contacts of several tools are told apart by their pairs of bodies.
    assert_eq!(more("wrench/reduce", &[("TOOLS", Const::Uint(2))], &[("TOOLS", Const::Uint(1))]), ["pairs"]);
    assert_clean(context(), "variants of kernels");
}

#[test]
fn of_the_variants_that_run_side_by_side_the_leader_alone_writes_arguments() {
    // `ROLE` selects the unknowns that a variant of the kernel solve/update updates. One of the variants has `LEADS`
    // set: it writes the scalars and the indirect arguments that all variants use.
    for role in [shaders::FREE_NODES, shaders::ATTACHED_NODES, shaders::TOOL_ROWS] {
        let of = |leads: bool| buffers("solve/update", &[("ROLE", role.into()), ("LEADS", leads.into())]);
        let (leader, other) = (of(true), of(false));
        assert!(
            leader.contains("args") && !other.contains("args"),
            "role {role}: the variant that leads has the buffers {leader:?}, the variant that does not lead {other:?}"
        );
        assert!(other.contains("dots"), "buffer dots is missing in a variant that does not lead, which has {other:?}");
    }
    let tool = buffers("solve/update", &[("ROLE", shaders::TOOL_ROWS.into())]);
    assert!(
        !tool.contains("residual") && !tool.contains("block_nodes"),
        "the variant for the tool's unknowns must not use the buffers residual and block_nodes: {tool:?}"
    );
}
