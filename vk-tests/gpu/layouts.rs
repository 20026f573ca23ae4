//! Every structure that shaders share has the offsets of its Rust twin, as the SPIR-V of a kernel that uses it says.

use std::mem::offset_of;

use palpate::gpu::{Kernel, Size};
use palpate::stages::types::*;

use crate::harness::context;

/// Compares a struct of a kernel with its twin, member by member.
macro_rules! same_layout {
    ($kernel:literal, $name:ident { $($member:ident),+ $(,)? }) => {{
        let kernel = Kernel::new(context(), $kernel, Size::Group, &[]).unwrap();
        let want = vec![$((stringify!($member).to_string(), offset_of!($name, $member) as u32)),+];
        assert_eq!(kernel.struct_offsets(stringify!($name)), want, "{} of {}", stringify!($name), $kernel);
        assert_eq!(kernel.struct_bytes(stringify!($name)), Some(size_of::<$name>() as u32));
    }};
}

#[test]
fn step_params_and_frame() {
    same_layout!(
        "solve/start",
        StepParams {
            dt,
            tolerance,
            max_iterations,
            newton,
            gravity,
            depth_limit,
            texel,
            is_held,
            friction,
            friction_speed,
            tool_matrix,
            tool_rhs,
            tool_twist,
            tool_centre,
        }
    );
    same_layout!(
        "cull/regions",
        StepParams {
            dt,
            tolerance,
            max_iterations,
            newton,
            gravity,
            depth_limit,
            texel,
            is_held,
            friction,
            friction_speed,
            tool_matrix,
            tool_rhs,
            tool_twist,
            tool_centre,
        }
    );
    same_layout!("pose/place", Frame { rotation, centre, linear, angular, turn, gyroscopic, core });
    same_layout!("elastic/rotate", Link { turn, offset });
    same_layout!(
        "solve/start",
        Rigid {
            frame,
            node_first,
            node_count,
            block_first,
            block_count,
            slot_first,
            hinge,
            joint_first,
            joint_count,
            group_first,
            group_count,
            parent,
            inverse_first,
            rounding,
            b,
            image,
            leftover
        }
    );
    same_layout!("solve/cores", Joint { rigid, arm, linear, angular, impulse, twist });
    same_layout!("solve/update", RigidIterate { x, r, u, p, s });
    same_layout!("pose/fit", Fit { shift, twist, momentum, spin });
}

#[test]
fn pairs_proxies_and_bounds() {
    same_layout!(
        "cull/regions",
        Pair {
            first_proxy_pair,
            proxy_pair_count,
            first_proxy,
            proxy_count,
            first_slot,
            stiffness,
            damping,
            tool_sign,
            is_plane,
            driven_frame,
            lone_side,
            direction,
            plane,
        }
    );
    same_layout!(
        "pose/place",
        Proxy {
            frame,
            hull_first,
            hull_count,
            face_first,
            face_count,
            chunk_first,
            chunk_count,
            node_first,
            node_count,
            margin,
            weight_bound,
            edge,
        }
    );
    same_layout!("pose/place", ProxyBounds { low, inflation, high, radius });
}

#[test]
fn regions_lists_and_counters() {
    same_layout!("cull/regions", Region { normal, tangent, bitangent, low, high, cell, weight, turn });
    same_layout!(
        "cull/chunks",
        Chunk {
            centre,
            axes,
            half_extent,
            weight_bound,
            vertex_first,
            vertex_count,
            embed_count,
            triangle_first,
            triangle_count,
            node_first,
            node_count,
        }
    );
    same_layout!("cull/chunks", Slot { pair, side, proxy, chunk_first });
    same_layout!("cull/meet", ActiveChunk { chunk, slot, side, regions, first_item });
    same_layout!(
        "pose/place",
        Counts {
            chunks,
            items,
            gathering,
            slots_met,
            hits,
            chunks_asked,
            contacts,
            entries,
            pulling,
            turn,
            last_contacts,
            flags
        }
    );
}

#[test]
fn contacts_solver_and_report() {
    same_layout!(
        "contact/response",
        Contact {
            normal,
            area,
            arm,
            tool_sign,
            depth,
            rate,
            stiffness,
            damping,
            friction,
            slip,
            quads,
            vertex,
            side,
            triangle,
            barycentric,
        }
    );
    same_layout!("solve/start", Solve { warm, rhs_norm2, floor_norm2, status, current, retries, linearisations });
    same_layout!("solve/update", Iteration { gamma, alpha, count });
    same_layout!(
        "wrench/reduce",
        Report {
            verdict,
            iterations,
            residual,
            residual_floor,
            contacts,
            max_depth,
            turn,
            flags,
            force,
            torque,
            pressing,
            tool_change,
            stiffness,
            damping,
        }
    );
    same_layout!("wrench/gap", SkinPart { proxy, chunk_first, chunk_count, low, high });
    same_layout!("wrench/gap", SkinGap { way, triangle, back });
}
