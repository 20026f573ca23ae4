//! The reasons, for `palpate run --explain`, why a step leaves out a kernel. Which kernels a step runs is read from its
//! recordings (the command buffers that every step submits). In the reasons, "half-space" is a rigid body that fills
//! one side of a plane; "skin" is a body's surface mesh; "ray hits" are where rays from skin vertices of one body hit
//! the other body of a pair; "F-bar patches" are groups of tetrahedra that share one volumetric strain; "dynamic cores"
//! are rigid bodies inside soft bodies that forces move; a "frame" is the rigid coordinate frame of a body or core; the
//! "tool" is the rigid body that a haptic device leads.

use crate::stages::gap;
use crate::stages::model::Model;

/// The stage (part of the step) that a kernel belongs to. It is named by the folder of the kernel's shader, with two
/// exceptions.
pub fn stage_of(kernel: &str) -> &str {
    match kernel {
        "pose/fit" => "fit",
        "skin/probe" => "probe",
        _ => kernel.split('/').next().unwrap_or(kernel),
    }
}

/// Why a stage that a step runs leaves out this kernel. `graphics`: whether the depth stage, which finds the ray hits,
/// uses its graphics implementation (path) rather than its compute implementation. `None` means that no reason is
/// known; a test checks that this never happens.
pub fn why_not(kernel: &str, model: &Model, graphics: bool) -> Option<&'static str> {
    let touches = !model.pairs.is_empty();
    let reason = match kernel {
        "pose/place" if !touches => "nothing can touch",
        "pose/carry" if model.attached_nodes.is_empty() => "no nodes are attached to a moving frame",
        "cull/pairs" | "cull/direction" if !model.has_skin_pairs() => "only half-spaces are touched",
        "depth/overlaps" if !model.needs_overlaps() => "no pair of bodies is tested by triangles",
        "depth/ray_hits" | "depth/ray_hits.vert" | "depth/ray_hits.frag" if !model.needs_depth() => {
            "no pair of bodies is tested by vertices"
        }
        "contact/sort" if model.node_rest.is_empty() => "no nodes",
        "depth/ray_hits.vert" | "depth/ray_hits.frag" if !graphics => "the compute path finds the ray hits",
        "depth/ray_hits" if graphics => "the graphics path finds the ray hits",
        "elastic/trial" if model.newton == 1 => "the step has one Newton iteration",
        "elastic/mean_dilatation" | "solve/patch_product" if model.patches.count() == 0 => "there are no F-bar patches",
        "solve/contact_product" | "solve/contact_iteration" if !touches => "nothing can touch",
        "solve/coarse" if model.coarse.bodies.is_empty() => "the preconditioner of no body has a coarse level",
        "solve/cores" if model.cores.is_empty() => "no dynamic cores",
        "solve/stiffness_blocks" | "solve/element_product" if model.tetrahedra.is_empty() => "no tetrahedra",
        "solve/element_product" if model.assembles => "the operator is assembled",
        "solve/stiffness_blocks" if model.assembles => "no tetrahedron deforms",
        "solve/stiffness_blocks" if model.patches.count() > 0 => "F-bar patches need the matrix-free operator",
        "solve/stiffness_blocks" => "solver.operator is matrix-free, or there are too many nodes for a matrix",
        "elastic/loads" if model.loads.sources.is_empty() => "there are no loads",
        "elastic/pressures" => "there is no pressure",
        "solve/reactions" if model.held.holders.is_empty() => "no body reports reactions",
        "solve/commit" if model.node_rest.is_empty() => "no nodes",
        "wrench/gap" if model.tool_frame.is_none() => "a body of the scene is the tool",
        "wrench/gap" if gap::part_count(model) == 0 => "there is no skin that the tool may touch",
        "wrench/gap" => "no haptic loop moves the tool",
        "solve/assemble" | "solve/first_iterate" | "solve/coarse" if model.blocks.blocks.is_empty() => "no nodes",
        "solve/gather" | "solve/update" if model.blocks.blocks.is_empty() && model.tool_frame.is_none() => {
            "nothing moves"
        }
        _ => return None,
    };
    Some(reason)
}
