//! The time that a pressure wave takes across a body, or across the part of a body in which the displacements of nodes
//! are measured in one rigid coordinate frame. The shorter this time, the stiffer is the part for its size.

use glam::DVec3;

use crate::stages::model::Model;

/// For each rigid coordinate frame, the time in s that a pressure wave takes across the nodes whose displacements are
/// measured in it: their least extent at rest along an axis of the frame, divided by the wave speed that follows from
/// their stiffest material and their mean density. `None` where the frame has no such nodes, or they have no volume.
pub fn crossing_times(model: &Model) -> Vec<Option<f64>> {
    let count = model.frames.len();
    let mut boxes = vec![[DVec3::INFINITY, DVec3::NEG_INFINITY]; count];
    let (mut masses, mut volumes, mut moduli) = (vec![0.0; count], vec![0.0; count], vec![0.0f64; count]);
    for (rest, info) in model.node_rest.iter().zip(&model.node_info) {
        let [x, y, z, mass] = rest.map(f64::from);
        let frame = info[2] as usize;
        let [low, high] = &mut boxes[frame];
        (*low, *high) = (low.min(DVec3::new(x, y, z)), high.max(DVec3::new(x, y, z)));
        masses[frame] += mass;
    }
    for (t, nodes) in model.tetrahedra.iter().enumerate() {
        let [mu, lambda, _] = model.material_of(t);
        // Each of a tetrahedron's nodes has a quarter of the tetrahedron's volume.
        for node in nodes {
            let frame = model.node_info[*node as usize][2] as usize;
            volumes[frame] += 0.25 * model.volume(t);
            moduli[frame] = moduli[frame].max(lambda + 2.0 * mu);
        }
    }
    let of = |frame: usize| {
        let [low, high] = boxes[frame];
        let time = (high - low).min_element() * (masses[frame] / volumes[frame] / moduli[frame]).sqrt();
        (time.is_finite() && time > 0.0).then_some(time)
    };
    (0..count).map(of).collect()
}
