//! Tests of kernel contact/response, beyond what vk-tests/stage/contact.rs compares with the oracle: the quads of
//! entries (an entry is a node with its weight in a contact, a quad is four entries), and friction. The tool is the
//! rigid body that the haptic device leads.

use glam::DVec3;
use palpate::internal::shaders::{Contact, NONE};
use palpate::internal::stages::depth::Path;

use crate::harness::random::Random;
use crate::harness::{Tolerance, expect_close};
use crate::stage::contact::crowd;
use crate::stage::flow::Flow;

/// The distinct tetrahedra in which a contact's points are embedded: that of the colliding vertex, then those of the
/// corners of the opposing triangle.
fn tetrahedra(flow: &Flow, c: usize) -> Vec<[u32; 4]> {
    let contact = &flow.contacts[c];
    let mut vertices = vec![contact.vertex];
    if contact.triangle != NONE {
        vertices.extend(&flow.model.triangles[contact.triangle as usize][..3]);
    }
    let mut distinct: Vec<[u32; 4]> = Vec::new();
    for nodes in vertices.into_iter().map(|v| flow.model.skin_nodes[v as usize]) {
        if nodes[0] != NONE && !distinct.contains(&nodes) {
            distinct.push(nodes);
        }
    }
    distinct
}

#[test]
fn corners_in_one_tetrahedron_share_a_quad() {
    let (_, _, flow) = crowd(Path::Compute);
    let (mut saved, mut kept) = (0, 0);
    for (c, contact) in flow.contacts.iter().enumerate() {
        let want = tetrahedra(&flow, c);
        let quads = 4 * c..4 * c + contact.quads as usize;
        assert_eq!(flow.entry_nodes[quads.clone()], want, "tetrahedra of contact {c}");
        // The weights of a body with nodes sum to 1 or, for body b, to -1; a body without nodes has no weights.
        let sum: f32 = flow.entry_weights[quads].iter().flatten().sum();
        assert!((sum - sum.round()).abs() < 1e-5 && sum.abs() < 1.5, "contact {c}: weights sum to {sum}");
        let corners = flow.model.skin_nodes[contact.vertex as usize][0] != NONE;
        let soft_triangle = contact.triangle != NONE
            && flow.model.skin_nodes[flow.model.triangles[contact.triangle as usize][0] as usize][0] != NONE;
        saved += usize::from(corners) + if soft_triangle { 3 } else { 0 } - want.len();
        kept += want.len();
    }
    println!("{} contacts: {kept} quads of entries, {saved} saved by sharing", flow.contacts.len());
    assert!(saved > 20 && kept > 100);
}

fn wide(x: &[f32]) -> DVec3 {
    DVec3::new(x[0].into(), x[1].into(), x[2].into())
}

/// The point at which friction of the contact acts, the relative velocity v1 - v2 of bodies a and b there, computed from
/// the contact's own entries, and its change over the last step.
fn relative(flow: &Flow, c: usize) -> (DVec3, DVec3, DVec3) {
    let (contact, n) = (&flow.contacts[c], wide(&flow.contacts[c].normal));
    let pair = &flow.pairs[contact.side as usize / 2];
    let (of_second, vertex) = (contact.side % 2 == 1, wide(&flow.skin[contact.vertex as usize]));
    // Along the normal, the surface point of body a lies beyond that of body b by the depth.
    let depth = f64::from(contact.depth) * n;
    let points = if of_second { [vertex + depth, vertex] } else { [vertex, vertex - depth] };
    let kinematic = |k: usize| pair.kinematic_frame[k] != NONE;
    let at = match pair.tool_sign {
        1.0 => points[1],
        -1.0 => points[0],
        _ if kinematic(0) => points[1],
        _ if kinematic(1) => points[0],
        _ => vertex,
    };
    let (mut v, mut change) = (DVec3::ZERO, DVec3::ZERO);
    for quad in 4 * c..4 * c + contact.quads as usize {
        for (node, w) in flow.entry_nodes[quad].iter().zip(flow.entry_weights[quad]) {
            v += f64::from(w) * wide(&flow.velocity[*node as usize]);
            change += f64::from(w) * wide(&flow.solution[*node as usize]);
        }
    }
    let of_tool = |twist: &[f32; 6]| {
        let spin = wide(&twist[3..]);
        f64::from(pair.tool_sign) * (wide(&twist[..3]) + spin.cross(at - wide(&flow.params.tool_centre)))
    };
    v += of_tool(&flow.params.tool_twist);
    change += of_tool(&flow.tool_change);
    for k in (0..2).filter(|k| kinematic(*k)) {
        let frame = &flow.frames[pair.kinematic_frame[k] as usize];
        let carried = wide(&frame.linear) + wide(&frame.angular).cross(at - wide(&frame.centre));
        v += if k == 0 { carried } else { -carried };
    }
    (at, v, change)
}

/// Compares the coefficient of friction of contact `c` with that of the law at a sliding speed of `speed` (m/s).
fn expect_friction(what: &str, flow: &Flow, c: usize, speed: f64) {
    let (got, [mu, least]) = (&flow.contacts[c], flow.model.friction.map(f64::from));
    let (_, v, _) = relative(flow, c);
    let pressure = f64::from(got.stiffness) * f64::from(got.depth) + f64::from(got.damping) * wide(&got.normal).dot(v);
    let want = mu * f64::from(got.area) * pressure.max(0.0) / speed.hypot(least);
    // The pressure may be a small difference of the spring's pressure and the damper's pressure.
    let size = f64::from(got.area * got.damping) * v.length().max(0.1) * mu / speed.hypot(least);
    expect_close(what, &[got.friction], &[want], Tolerance { abs: 1e-5 * size, rel: 1e-4 });
}

#[test]
fn friction_of_soft_rigid_and_kinematic_skins() {
    let (_, _, mut flow) = crowd(Path::Compute);
    let frictionless = flow.contacts.clone();
    flow.model.friction = [0.6, 0.01];
    [flow.params.friction, flow.params.friction_speed] = flow.model.friction;
    // The bodies of `crowd` are two soft balls, a and b, a floor and a tool. A kinematic frame is a rigid coordinate
    // frame whose motion is known. Here ball a in pair a-b and the floor in pair b-floor are on kinematic frames; the
    // other pairs are a-floor, a-tool, b-tool and tool-floor.
    (flow.pairs[0].kinematic_frame, flow.pairs[3].kinematic_frame) = ([0, NONE], [NONE, 1]);
    for (k, frame) in flow.frames.iter_mut().enumerate() {
        (frame.linear, frame.angular) = ([0.1, 0.3, -0.2 * k as f32], [2.0, -5.0, 3.0]);
    }
    let mut random = Random(31);
    for change in &mut flow.solution {
        *change = (0.2 * random.vector()).as_vec3().extend(0.0).to_array();
    }
    flow.tool_change = [0.01, -0.015, 0.025, 0.15, 0.1, -0.05];
    // The changes are those of a step of half the length, so that those of this step are expected to be twice as large.
    flow.solution_dt = 0.5 * flow.params.dt;
    flow.forget_entries(flow.node_entries.len());
    flow.respond();
    // Tolerance of f32 positions and velocities after a dozen roundings.
    let close = Tolerance { abs: 1e-6, rel: 1e-5 };
    let (mut rubbing, mut tool, mut kinematic, mut halved, mut doubled) = (0, 0, 0, 0, 0);
    for (c, was) in frictionless.iter().enumerate() {
        let got: &Contact = &flow.contacts[c];
        let what = format!("contact {c}, side {}", got.side);
        let (at, v, change) = relative(&flow, c);
        let n = wide(&got.normal);
        if got.tool_sign != 0.0 {
            let arm = at - wide(&flow.params.tool_centre);
            expect_close(&what, &got.arm, &arm.to_array(), close);
            tool += 1;
        }
        let (rate, slip) = (n.dot(v), v - n.dot(v) * n);
        expect_close(&what, &[got.rate], &[rate], close);
        expect_close(&what, &got.slip, &slip.to_array(), Tolerance { abs: 1e-6, ..close });
        let (now, next) = (slip.length(), (slip + 2.0 * (change - n.dot(change) * n)).length());
        halved += usize::from(next < 0.5 * now);
        doubled += usize::from(next > 2.0 * now);
        expect_friction(&what, &flow, c, next.clamp(0.5 * now, 2.0 * now));
        rubbing += usize::from(got.friction > 0.0);
        let pair = &flow.pairs[got.side as usize / 2];
        kinematic += usize::from(pair.kinematic_frame != [NONE; 2]);
        // Without friction, coefficient and slip are zero, and all else is equal.
        assert_eq!((was.friction, was.slip), (0.0, [0.0; 3]));
        assert_eq!((was.normal, was.area, was.depth, was.quads), (got.normal, got.area, got.depth, got.quads));
    }
    println!("{rubbing} contacts with friction; {tool} contacts on the tool, {kinematic} on kinematic frames");
    println!("predicted speed at most halved in {halved}, at most doubled in {doubled}");
    assert!(rubbing > 40 && rubbing < frictionless.len() && tool > 20 && kinematic > 20);
    assert!(halved > 5 && doubled > 5 && halved + doubled < frictionless.len() / 2);
    // Changes of a step that was rejected are left out.
    flow.solution_dt = 0.0;
    flow.forget_entries(flow.node_entries.len());
    flow.respond();
    for c in 0..frictionless.len() {
        let (_, v, _) = relative(&flow, c);
        let n = wide(&flow.contacts[c].normal);
        expect_friction(&format!("contact {c}, no change"), &flow, c, (v - n.dot(v) * n).length());
    }
}
