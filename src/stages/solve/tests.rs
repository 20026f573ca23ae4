//! Tests that a pass with two swapped buffers is refused when it is recorded. The test swaps every two buffers of each
//! pass of the solver, and of the stages from pose to contact, which run before the solver.

use std::collections::BTreeSet;
use std::path::Path;

use super::super::elastic::Elastic;
use super::super::model::Model;
use super::super::touch::TouchStages;
use super::super::{Common, depth};
use super::Solve;
use crate::gpu::{Context, Named, Options, Recorder};
use crate::prepare::Cache;
use crate::prepare::bodies::Bodies;
use crate::scene::Scene;

#[test]
fn any_two_buffers_of_a_pass_that_are_swapped_are_refused_by_name() {
    let device = std::env::var("PALPATE_TEST_DEVICE").ok();
    let context = Context::open(&Options { device, ..Options::default() }).unwrap();
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/scenes/touch-head.toml");
    let scene = Scene::load(&scene).unwrap();
    let Bodies { bodies, tool } = Bodies::prepare(&scene, &Cache::of_user()).unwrap();
    let model = Model::new(&scene, &bodies, tool.as_ref());
    let (common, elastic) = (Common::new(&context, &model).unwrap(), Elastic::new(&context, &model).unwrap());
    let touch = TouchStages::new(&context, &model, Some(depth::Path::Compute), true).unwrap();
    let solve = Solve::new(&context, &model, Some(&touch.contact.touch)).unwrap();
    let mut recorder = Recorder::untimed(&context).unwrap();
    touch.record(&mut recorder, &common, &elastic, Some(&solve));
    solve.record_operator(&mut recorder, &elastic);
    solve.record_start(&mut recorder, &common, &elastic);
    solve.record_iterations(&mut recorder, &common, &elastic, 2);
    solve.record_end(&mut recorder, &common, &elastic);
    let seen = std::mem::take(&mut recorder.seen);
    recorder.finish().unwrap();
    let (mut swaps, mut kernels) = (0, BTreeSet::new());
    for (kernel, buffers, push) in &seen {
        let given = |swapped: Option<(usize, usize)>| {
            let mut named: Vec<_> = buffers.iter().map(|(name, buffer)| (name.as_str(), buffer)).collect();
            if let Some((i, j)) = swapped {
                (named[i].1, named[j].1) = (named[j].1, named[i].1);
            }
            let mut recorder = Recorder::untimed(&context).unwrap();
            recorder.dispatch_groups(kernel, &Named { shader: kernel.name(), buffers: &named, push }, 1);
            recorder.finish().map(|_| ())
        };
        given(None).unwrap();
        for i in 0..buffers.len() {
            for j in 0..i {
                let ((a, x), (b, y)) = (&buffers[i], &buffers[j]);
                if x.raw() == y.raw() {
                    continue;
                }
                let refused = given(Some((i, j))).map_err(|error| error.to_string());
                assert!(
                    refused.is_err_and(|e| e.contains("may not be bound to its buffer")),
                    "kernel {}: swapped buffers {a} and {b} were accepted, expected an error",
                    kernel.name()
                );
                swaps += 1;
            }
        }
        kernels.insert(kernel.name());
    }
    for kernel in ["solve/update", "solve/assemble", "solve/stiffness_blocks", "solve/gather", "contact/candidates"] {
        assert!(kernels.contains(kernel), "kernel {kernel} was not tested; the tested kernels are {kernels:?}");
    }
    println!("refused swaps of two buffers: {swaps}, in {} passes of {} different kernels", seen.len(), kernels.len());
    assert!(swaps > 2000, "only {swaps} swaps of two buffers were tested, expected more than 2000");
}
