//! Choices that must not matter: a run that is repeated, the path of the depth stage, the kind of arrays, inputs that
//! are copied, and the size of workgroups.

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use palpate::internal::gpu::Arrays;
use palpate::scene::{DepthPath, Scene};
use palpate::{Context, Options, Result, Simulation};
use serde::Serialize;

use super::greatest;

/// A ball, the tool, goes down into a soft block that lies on another.
const SCENE: &str = include_str!("press.toml");
/// Number of steps for which each choice is compared.
const STEPS: usize = 60;
/// Number of steps of the run that is repeated.
const REPEATED: usize = 1000;
/// Sizes of workgroups: those of CPUs, and of GPUs.
const WORKGROUPS: [u32; 5] = [8, 16, 32, 64, 128];

/// A choice that must not matter.
#[derive(Debug, Clone, Serialize)]
pub struct Variant {
    /// What is chosen.
    pub choice: String,
    /// Greatest difference of a step's force on the tool from that of the device's own choice, as a fraction of the
    /// greatest force; not a number if a force is not.
    pub difference: f64,
}

fn scene() -> Result<Scene> {
    Scene::parse(Path::new("press.toml"), SCENE)
}

fn forces(context: &Arc<Context>, scene: &Scene, steps: usize) -> Result<Vec<DVec3>> {
    let mut simulation = Simulation::on_device(context, scene)?;
    (0..steps).map(|_| Ok(simulation.step()?.tool.map_or(DVec3::ZERO, |tool| tool.force))).collect()
}

/// The number of steps of a run that was done twice, and whether both gave the same bits.
pub fn repeats(context: &Arc<Context>) -> Result<(usize, bool)> {
    let scene = scene()?;
    let bits = |forces: Vec<DVec3>| forces.iter().map(|x| x.to_array().map(f64::to_bits)).collect::<Vec<_>>();
    let [first, second] = [forces(context, &scene, REPEATED)?, forces(context, &scene, REPEATED)?];
    Ok((REPEATED, bits(first) == bits(second)))
}

/// Compares the choices with those of the device itself.
pub fn compare(options: &Options, watch: &mut dyn FnMut(&str)) -> Result<Vec<Variant>> {
    let scene = scene()?;
    let (own, has_texel, has_storage) = {
        let context = Context::open(options)?;
        let has_storage = context.storage_buffers() >= palpate::internal::shaders::MOST_STORAGE_BUFFERS;
        (forces(&context, &scene, STEPS)?, context.has_texel_buffers(), has_storage)
    };
    let greatest_force = greatest(own.iter().map(|force| force.length()));
    let mut variants = Vec::new();
    let mut add = |choice: String, options: &Options, scene: &Scene| -> Result<()> {
        watch(&choice);
        let context = Context::open(options)?;
        if scene.contact.depth == Some(DepthPath::Graphics) && !context.fragment_stores() {
            return Ok(());
        }
        let found = forces(&context, scene, STEPS)?;
        let apart = greatest(found.iter().zip(&own).map(|(a, b)| a.distance(*b)));
        variants.push(Variant { choice, difference: apart / greatest_force });
        Ok(())
    };
    for (name, path) in [("compute", DepthPath::Compute), ("graphics", DepthPath::Graphics)] {
        let mut scene = scene.clone();
        scene.contact.depth = Some(path);
        add(format!("the {name} path of the depth stage"), options, &scene)?;
    }
    let kinds = [("texel", Arrays::Texel, has_texel), ("storage", Arrays::Storage, has_storage)];
    for (name, arrays, _) in kinds.into_iter().filter(|(.., has)| *has) {
        add(format!("{name} buffers"), &Options { arrays: Some(arrays), ..options.clone() }, &scene)?;
    }
    add("inputs copied into GPU memory".into(), &Options { copies_inputs: true, ..options.clone() }, &scene)?;
    for size in WORKGROUPS {
        add(format!("workgroups of {size}"), &Options { workgroup: Some(size), ..options.clone() }, &scene)?;
    }
    Ok(variants)
}
