//! Loads on bodies in f64: the external force on each node of a soft body, and force and torque on dynamic cores.

use glam::DVec3;
use palpate::internal::prepare::loads::{Load, Part};
use palpate::internal::prepare::{Body, Shape};
use palpate::scene::LoadKind;

use crate::body::SoftBody;

/// Factor of a load at a time, s: linear between the load's times, constant outside.
pub fn factor(load: &Load, time: f64) -> f64 {
    let all = &load.source.factors;
    let [Some(first), Some(last)] = [all.first(), all.last()] else { return 1.0 };
    if time <= first[0] {
        return first[1];
    }
    let between = all.windows(2).find(|pair| (pair[0][0]..pair[1][0]).contains(&time));
    between.map_or(last[1], |pair| {
        let share = (time - pair[0][0]) / (pair[1][0] - pair[0][0]);
        (1.0 - share) * pair[0][1] + share * pair[1][1]
    })
}

/// External force on each node of a soft body in its present state, N, for a step that ends at `time`.
pub fn on_nodes(body: &Body, state: &SoftBody, time: f64) -> Vec<DVec3> {
    let mut forces = vec![DVec3::ZERO; state.layer.nodes.len()];
    let Shape::Soft { layer, embedding, skin, .. } = &body.shape else { return forces };
    let places = state.world_nodes();
    let mut push = |triangle: u32, force: DVec3| {
        for vertex in skin.triangles[triangle as usize] {
            let e = &embedding[vertex as usize];
            for (node, weight) in layer.tetrahedra[e.tetrahedron as usize].iter().zip(e.weights) {
                forces[*node as usize] += weight * force / 3.0;
            }
        }
    };
    let area = |triangle: u32, place: &dyn Fn(u32) -> DVec3| {
        let [a, b, c] = skin.triangles[triangle as usize].map(place);
        0.5 * (b - a).cross(c - a)
    };
    let embedded = |vertex: u32| {
        let e = &embedding[vertex as usize];
        let nodes = layer.tetrahedra[e.tetrahedron as usize];
        nodes.iter().zip(e.weights).map(|(node, weight)| weight * places[*node as usize]).sum::<DVec3>()
    };
    let mut shared = Vec::new();
    for load in &body.loads {
        let factor = factor(load, time);
        match (&load.source.kind, &load.part) {
            (LoadKind::Force { force, .. }, Part::Nodes(nodes)) => {
                shared.extend(nodes.iter().map(|node| (*node as usize, factor * *force / nodes.len() as f64)));
            }
            (LoadKind::Traction { traction, .. }, Part::Triangles(all)) => {
                let rest = |vertex: u32| skin.vertices[vertex as usize];
                all.iter().for_each(|t| push(*t, factor * *traction * area(*t, &rest).length()));
            }
            (LoadKind::Pressure { pressure, .. }, Part::Triangles(all)) => {
                all.iter().for_each(|t| push(*t, -factor * *pressure * area(*t, &embedded)));
            }
            _ => {}
        }
    }
    shared.into_iter().for_each(|(node, force)| forces[node] += force);
    forces
}

/// Force (N) and torque (N m) on a body's core in a step that ends at `time`.
pub fn on_core(body: &Body, core: usize, time: f64) -> (DVec3, DVec3) {
    let mut sum = (DVec3::ZERO, DVec3::ZERO);
    for load in body.loads.iter().filter(|load| load.part == Part::Core(core)) {
        if let LoadKind::Core { force, torque, .. } = &load.source.kind {
            let factor = factor(load, time);
            sum = (sum.0 + factor * *force, sum.1 + factor * *torque);
        }
    }
    sum
}
