//! Tests of the kernels of loads: elastic/pressures, which computes the force of pressure on triangles of a skin (surface
//! mesh), and elastic/loads, which sums the loads on each target (a node, or force or torque on a dynamic core).

use glam::{DQuat, DVec3};
use palpate::internal::gpu::Size;
use palpate::internal::shaders::Frame;

use crate::harness::random::Random;
use crate::harness::{Tolerance, case, expect_close};

/// Error of a cross product of edges of order one whose places come from a few f32 operations.
const FORCE: Tolerance = Tolerance { abs: 1e-5, rel: 1e-5 };
/// Error of a sum of a dozen numbers of order one.
const SUM: Tolerance = Tolerance { abs: 1e-6, rel: 1e-6 };

fn wide(x: [f32; 4]) -> DVec3 {
    DVec3::new(x[0].into(), x[1].into(), x[2].into())
}

fn narrow(x: DVec3, w: f64) -> [f32; 4] {
    x.as_vec3().extend(w as f32).to_array()
}

#[test]
fn pressure_acts_against_the_normals_of_the_moved_triangles() {
    let mut random = Random(3);
    // More triangles than a workgroup has invocations, over nodes in two frames that have moved.
    let (nodes, triangles, sources) = (60, 150, 4);
    let frame = |random: &mut Random| {
        let rotation = random.turn(3.0);
        Frame {
            rotation: rotation.as_quat().to_array(),
            centre: random.vector().as_vec3().to_array(),
            ..Frame::default()
        }
    };
    let frames = [frame(&mut random), frame(&mut random)];
    let node_info: Vec<[u32; 4]> = (0..nodes).map(|n| [0, 0, n % 2, 0]).collect();
    let rest: Vec<[f32; 4]> = (0..nodes).map(|_| narrow(random.vector(), 1.0)).collect();
    let moved: Vec<[f32; 4]> = (0..nodes).map(|_| narrow(0.2 * random.vector(), 0.0)).collect();
    let load_sources: Vec<[f32; 4]> = (0..sources).map(|_| narrow(random.vector(), 3.0 * random.next())).collect();
    let of: Vec<u32> = (0..triangles).map(|t| t % sources).collect();
    let corner_nodes: Vec<[u32; 4]> =
        (0..3 * triangles).map(|_| std::array::from_fn(|_| random.below(nodes as usize) as u32)).collect();
    let corner_weights: Vec<[f32; 4]> = (0..3 * triangles).map(|_| narrow(random.vector(), random.next())).collect();
    let got: Vec<[f32; 4]> = case("elastic/pressures")
        .size(Size::Group)
        .constant("TRIANGLES", triangles)
        .input("frames", &frames)
        .input("node_info", &node_info)
        .input("node_rest", &rest)
        .input("displacement", &moved)
        .input("load_sources", &load_sources)
        .input("loaded_triangles", &of)
        .input("corner_nodes", &corner_nodes)
        .input("corner_weights", &corner_weights)
        .output::<[f32; 4]>("triangle_forces", triangles as usize)
        .elements(triangles as usize)
        .run()
        .get("triangle_forces");
    let place = |node: u32| {
        let (n, frame) = (node as usize, &frames[node_info[node as usize][2] as usize]);
        let rotation = DQuat::from_array(frame.rotation.map(f64::from)).normalize();
        DVec3::from(frame.centre.map(f64::from)) + rotation * (wide(rest[n]) + wide(moved[n]))
    };
    let corner = |k: usize| -> DVec3 {
        corner_nodes[k].iter().zip(corner_weights[k]).map(|(node, weight)| f64::from(weight) * place(*node)).sum()
    };
    for t in 0..triangles as usize {
        let [a, b, c] = [0, 1, 2].map(|k| corner(3 * t + k));
        let want = -f64::from(load_sources[of[t] as usize][3]) * 0.5 * (b - a).cross(c - a);
        expect_close(&format!("force on triangle {t}"), &got[t][..3], &want.to_array(), FORCE);
    }
}

#[test]
fn loads_are_summed_by_target() {
    let mut random = Random(4);
    let (targets, sources, triangles, forces) = (150u32, 5u32, 20u32, 400usize);
    let load_sources: Vec<[f32; 4]> = (0..sources).map(|_| narrow(random.vector(), random.next())).collect();
    let triangle_forces: Vec<[f32; 4]> = (0..triangles).map(|_| narrow(random.vector(), 0.0)).collect();
    let (mut load_targets, mut entries) = (Vec::new(), Vec::new());
    for k in 0..targets {
        let count = random.below(12) as u32;
        // The places are not in the order of the targets, and some places have no target.
        load_targets.push([(7 * k) % forces as u32, entries.len() as u32, count]);
        for _ in 0..count {
            entries.push([random.below((sources + triangles) as usize) as u32, (random.next() as f32).to_bits()]);
        }
    }
    let untouched = vec![[7.0f32; 4]; forces];
    let got: Vec<[f32; 4]> = case("elastic/loads")
        .size(Size::Group)
        .constant("TARGETS", targets)
        .constant("SOURCES", sources)
        .input("load_sources", &load_sources)
        .input("triangle_forces", &triangle_forces)
        .input("load_targets", &load_targets)
        .input("load_entries", &entries)
        .partial("external_forces", &untouched)
        .elements(targets as usize)
        .run()
        .get("external_forces");
    let mut want = vec![None; forces];
    for [place, first, count] in load_targets {
        let own = entries[first as usize..(first + count) as usize].iter().map(|[index, factor]| {
            let force = match index.checked_sub(sources) {
                None => load_sources[*index as usize],
                Some(triangle) => triangle_forces[triangle as usize],
            };
            f64::from(f32::from_bits(*factor)) * wide(force)
        });
        want[place as usize] = Some(own.sum::<DVec3>());
    }
    for (k, (got, want)) in got.iter().zip(want).enumerate() {
        match want {
            Some(want) => expect_close(&format!("load {k}"), &got[..3], &want.to_array(), SUM),
            None => assert_eq!(*got, [7.0; 4], "place {k} has no target"),
        }
    }
}
