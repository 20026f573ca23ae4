//! Scenes must give bit-identical results whether kernels read arrays through texel buffers or through storage buffers,
//! also where texel buffers are limited to the size that every Vulkan device supports, and where what the CPU writes for
//! each step is copied into GPU memory.

use std::path::Path;

use palpate::internal::gpu::Arrays;
use palpate::{Options, Scene, Simulation};

/// Number of elements that the texel buffers of every Vulkan device can hold.
const GUARANTEED: u32 = 65_536;

/// Runs a scene and returns the bits of the force on the tool and of the solver's residual for each step, and then the
/// bits of the node positions after the last step.
fn left(scene: &Scene, options: Options, steps: usize) -> Vec<u64> {
    let device = std::env::var("PALPATE_TEST_DEVICE").ok();
    let options = Options { device, ..options };
    let mut simulation = Simulation::open(scene, &options).unwrap();
    let mut bits = Vec::new();
    for _ in 0..steps {
        let report = simulation.step().unwrap();
        let force = report.tool.map(|tool| tool.force.to_array()).unwrap_or_default();
        bits.extend(force.iter().chain([&report.residual]).map(|x| x.to_bits()));
    }
    for body in 0..simulation.bodies().len() {
        if simulation.nodes(body).unwrap().is_some() {
            let nodes = simulation.node_positions(body).unwrap();
            bits.extend(nodes.iter().flat_map(|x| x.to_array()).map(f64::to_bits));
        }
    }
    bits
}

fn expect_the_same(name: &str, steps: usize) {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("assets/scenes/{name}.toml"));
    let scene = Scene::load(&file).unwrap();
    let texel = left(&scene, Options { arrays: Some(Arrays::Texel), ..Options::of_program() }, steps);
    let storage = left(&scene, Options { arrays: Some(Arrays::Storage), ..Options::of_program() }, steps);
    let few = left(&scene, Options { texel_elements: Some(GUARANTEED), ..Options::of_program() }, steps);
    let copied = left(&scene, Options { copies_inputs: true, ..Options::of_program() }, steps);
    assert_eq!(copied, storage, "{name}: results with copied inputs (left) and without (right)");
    assert!(texel.len() > 4 * steps, "{name}: too few results to compare");
    assert_eq!(
        texel.iter().zip(&storage).position(|(a, b)| a != b),
        None,
        "{name}: index of the first result that differs between texel and storage buffers"
    );
    assert_eq!(few, storage, "{name}: results with small texel buffers (left) and with storage buffers (right)");
}

#[test]
fn inputs_are_copied_where_options_ask_for_it() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/scenes/touch-head.toml");
    let scene = Scene::load(&file).unwrap();
    let device = std::env::var("PALPATE_TEST_DEVICE").ok();
    let passes = [false, true].map(|copies_inputs| {
        let options = Options { device: device.clone(), copies_inputs, ..Options::of_program() };
        Simulation::open(&scene, &options).unwrap().explain(8).passes
    });
    // Parameters, frames, joints, links of frames, and pairs.
    assert_eq!(passes[1] - passes[0], 5, "passes with and without copies: {passes:?}");
}

#[test]
fn a_head_is_touched_the_same_with_either_kind_of_arrays() {
    expect_the_same("touch-head", 12);
}

#[test]
#[ignore = "long: 40 s"]
fn lasting_all_scenes_run_the_same_with_either_kind_of_arrays() {
    for name in
        ["gears", "held-pad", "pose-human", "press-gear", "press-pumpkin", "pumpkins", "touch-human", "two-heads"]
    {
        expect_the_same(name, 12);
    }
}
