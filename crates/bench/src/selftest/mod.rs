//! `palpate selftest`: whether a Vulkan device and its driver compute what they should, and what a device costs before it
//! computes anything. The shipped scenes must give the forces that are pinned in `pinned.json`; a scene must repeat with
//! the same bits; and each choice that must not matter (the path of the depth stage, the kind of arrays, the size of
//! workgroups) must give the same forces.

mod costs;
mod document;
mod scenes;
mod variants;

use palpate::{Context, Options, Result};
use serde::Serialize;

pub use costs::Cost;
pub use document::document;
pub use scenes::{Agreement, Pinned, record};
pub use variants::Variant;

/// Greatest difference from a pinned force, as a fraction of the greatest pinned force of the scene. Where a scene has no
/// tool, and so no force, the displacements of its probes take the place of forces.
pub const TOLERANCE: f64 = 1e-4;

/// Results of a self-test.
#[derive(Debug, Clone, Serialize)]
pub struct Results {
    /// Name of the Vulkan device.
    pub device: String,
    /// Name and version of the device's driver.
    pub driver: String,
    /// Number of invocations in a workgroup of kernels whose invocations synchronise.
    pub workgroup: u32,
    /// What a pass, a submit and so on cost.
    pub costs: Vec<Cost>,
    /// The shipped scenes.
    pub scenes: Vec<Agreement>,
    /// The number of steps of a scene that were repeated, and whether the results were the same to the last bit.
    pub repeats: (usize, bool),
    /// The choices that must not matter.
    pub variants: Vec<Variant>,
}

impl Results {
    /// What is wrong, a sentence each.
    pub fn faults(&self) -> Vec<String> {
        let off = |difference: f64| difference.is_nan() || difference > TOLERANCE;
        let scenes = self.scenes.iter().filter(|scene| off(scene.difference) || !scene.flags.is_empty());
        let scenes = scenes.map(|scene| match scene.flags.is_empty() {
            true => format!("{} differs by {:.1e} from what is pinned", scene.scene, scene.difference),
            false => format!("{} raised {}", scene.scene, scene.flags.join(", ")),
        });
        let variants = self.variants.iter().filter(|variant| off(variant.difference));
        let variants =
            variants.map(|variant| format!("with {} forces differ by {:.1e}", variant.choice, variant.difference));
        let repeats = (!self.repeats.1).then(|| "a repeated run gave other bits".to_string());
        scenes.chain(variants).chain(repeats).collect()
    }
}

/// The greatest of some numbers, none of which is negative; not a number if any of them is not, which `f64::max` would
/// hide.
fn greatest(numbers: impl Iterator<Item = f64>) -> f64 {
    numbers.fold(0.0, |a, b| if a.is_nan() || a >= b { a } else { b })
}

/// Runs the self-test on the device that `options` name; tells `watch` what it does.
///
/// # Errors
/// Those of [`Context::open`] and [`palpate::Simulation::open`], and whatever a step fails with.
pub fn run(options: &Options, watch: &mut dyn FnMut(&str)) -> Result<Results> {
    let context = Context::open(options)?;
    watch("what a pass costs");
    let costs = costs::measure(&context)?;
    let mut scenes = Vec::new();
    for pinned in scenes::pinned() {
        watch(&pinned.scene);
        scenes.push(scenes::agreement(&context, &pinned)?);
    }
    watch("repeats");
    let repeats = variants::repeats(&context)?;
    let (device, driver, workgroup) = (context.device_name().into(), context.driver().into(), context.reduce_size());
    drop(context);
    let variants = variants::compare(options, watch)?;
    Ok(Results { device, driver, workgroup, costs, scenes, repeats, variants })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn results() -> Results {
        let scene = Agreement {
            scene: "press".into(),
            greatest: 1.0,
            is_force: true,
            difference: 0.5 * TOLERANCE,
            flags: Vec::new(),
            iterations: 1.0,
            step_ms: 1.0,
        };
        let variants = vec![Variant { choice: "texel buffers".into(), difference: 0.0 }];
        let (device, driver) = ("a device".into(), "a driver".into());
        Results { device, driver, workgroup: 8, costs: vec![], scenes: vec![scene], repeats: (1, true), variants }
    }

    #[test]
    fn whatever_differs_is_a_fault() {
        let told = |spoil: fn(&mut Results)| {
            let mut results = results();
            spoil(&mut results);
            let (faults, page) = (results.faults(), document(&results).markdown());
            assert_eq!(page.contains("All agree."), faults.is_empty(), "wrong page: {page}");
            faults.join("; ")
        };
        assert_eq!(told(|_| ()), "");
        assert_eq!(told(|r| r.scenes[0].difference = 2e-4), "press differs by 2.0e-4 from what is pinned");
        assert_eq!(told(|r| r.scenes[0].difference = f64::NAN), "press differs by NaN from what is pinned");
        assert_eq!(told(|r| r.scenes[0].flags.push("frozen".into())), "press raised frozen");
        assert_eq!(told(|r| r.variants[0].difference = f64::NAN), "with texel buffers forces differ by NaN");
        assert_eq!(told(|r| r.repeats.1 = false), "a repeated run gave other bits");
    }

    #[test]
    fn a_number_that_is_none_is_the_greatest() {
        assert_eq!(greatest([1.0, 3.0, 2.0].into_iter()), 3.0);
        assert_eq!(greatest(std::iter::empty()), 0.0);
        for at in 0..3 {
            let numbers = (0..3).map(|k| if k == at { f64::NAN } else { 1.0 });
            assert!(greatest(numbers).is_nan(), "number {at} is none");
        }
    }
}
