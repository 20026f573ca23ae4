//! Chooses how kernels reach arrays that they only read, through texel or storage buffers: as the options ask, as the
//! device's limits demand, or the faster way, which is measured once per device. The choice is made before kernels are
//! compiled, so before the first step. A *context* is an open Vulkan device.

use std::fmt;
use std::sync::Arc;
use std::time::Instant;

use crate::Result;
use crate::gpu::{Arrays, Buffer, Const, Context, Kernel, Memory, Recorder, Size};
use crate::prepare::Cache;
use crate::prepare::cache::{Entry, KeyMaker};
use crate::shaders;

/// Number of runs of each recording (recorded commands) before times are taken.
const WARM_UP: usize = 3;
/// Number of timed runs of each recording; the median time counts.
const RUNS: usize = 9;
/// Number of tetrahedra on which the measured kernel works; the nodes of one tetrahedron lie close together in memory.
const TETRAHEDRA: u32 = 1 << 14;

/// The kind of arrays that was chosen (texel or storage buffers), and why.
pub struct ArrayChoice {
    /// The kind that was chosen.
    pub arrays: Arrays,
    why: Why,
}

enum Why {
    /// The options ask for this kind.
    Asked,
    /// The device lets a kernel bind too few texel buffers; this is the greatest number.
    Few(u32),
    /// The device's texel buffers are too small; a texel buffer holds at most this number of elements.
    Small(u32),
    /// The device lets a kernel bind too few storage buffers; this is the greatest number.
    Buffers(u32),
    /// The choice was made earlier in this context, for another kernel or another simulation.
    Before,
    /// The options do not ask for a measurement.
    Unmeasured,
    /// Median times of the measured kernel, microseconds: first with texel buffers, second with storage buffers.
    Measured([f64; 2]),
}

impl ArrayChoice {
    /// Makes the choice and stores it in the context; stores measured times in the context's cache folder.
    pub fn new(context: &Arc<Context>) -> Result<ArrayChoice> {
        let (_, limit) = context.array_limits();
        let why = if context.arrays_asked_for().is_some() {
            Why::Asked
        } else if !context.binds_texel_buffers() {
            Why::Few(context.texel_buffers())
        } else if !context.has_texel_buffers() {
            Why::Small(limit as u32)
        } else if context.storage_buffers() < shaders::MOST_STORAGE_BUFFERS {
            context.choose_arrays(Arrays::Texel);
            Why::Buffers(context.storage_buffers())
        } else if context.has_arrays() {
            Why::Before
        } else if !context.measures() {
            Why::Unmeasured
        } else {
            let times = kept_times(context, &Cache::of(context))?;
            let faster = if times[0] <= times[1] { Arrays::Texel } else { Arrays::Storage };
            context.choose_arrays(faster);
            Why::Measured(times)
        };
        Ok(ArrayChoice { arrays: context.arrays(), why })
    }
}

impl fmt::Display for ArrayChoice {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let name = |arrays| if arrays == Arrays::Texel { "texel" } else { "storage" };
        write!(f, "{} buffers: ", name(self.arrays))?;
        match self.why {
            Why::Asked => write!(f, "asked for"),
            Why::Few(count) => write!(f, "the device lets a kernel bind at most {count} texel buffers"),
            Why::Small(elements) => write!(f, "the device's texel buffers hold only {elements} elements"),
            Why::Buffers(count) => write!(f, "the device lets a kernel bind at most {count} storage buffers"),
            Why::Before => write!(f, "as chosen before on this device"),
            Why::Unmeasured => write!(f, "not measured"),
            Why::Measured([texel, storage]) => {
                write!(f, "measured {texel:.0} us with texel buffers against {storage:.0} us with storage buffers")
            }
        }
    }
}

/// Median times of the measured kernel with texel and with storage buffers, microseconds. They are measured only if the
/// cache has no times for this device, this driver and this version of palpate.
fn kept_times(context: &Arc<Context>, cache: &Cache) -> Result<[f64; 2]> {
    let mut key = KeyMaker::new();
    for field in
        ["storage texel buffers or storage buffers", context.device_name(), context.driver(), env!("CARGO_PKG_VERSION")]
    {
        key.add(field.as_bytes());
    }
    let key = key.finish();
    if let Entry::Found(times) = cache.load(&key) {
        return Ok(times);
    }
    let times = measured_times(context)?;
    // If the times cannot be stored, the next program run measures them again.
    let _ = cache.store(&key, &times);
    Ok(times)
}

/// Measures the median times with texel and with storage buffers, microseconds. The measured kernel computes the
/// products A_e p of the element matrices A_e with a vector p, as a solver with a matrix-free operator does in every
/// iteration; like the kernels of the assembled operator it mostly reads vectors at scattered places.
fn measured_times(context: &Arc<Context>) -> Result<[f64; 2]> {
    let vectors = |name: &str, count: u32| {
        let data: Vec<[f32; 4]> = (0..count).map(|i| [0.1, 0.2, 0.3, i as f32]).collect();
        Buffer::from_slice(context, name, &data, Memory::Device)
    };
    let corners: Vec<[u32; 4]> = (0..TETRAHEDRA).map(|t| [t, t + 1, t + 17, t + 293].map(|n| n % TETRAHEDRA)).collect();
    let tetrahedra = Buffer::from_slice(context, "tetrahedra", &corners, Memory::Device)?;
    let gradients = vectors("gradients", shaders::GRADIENT_TEXELS * (TETRAHEDRA + 1))?;
    let change = vectors("change", TETRAHEDRA)?;
    let element_forces = vectors("element_forces", 4 * (TETRAHEDRA + 1))?;
    let recording = |arrays| {
        let constants = [("TETRAHEDRA", Const::Uint(TETRAHEDRA))];
        let kernel = Kernel::with_arrays(context, "solve/element_product", Size::Group, &constants, arrays)?;
        let mut recorder = Recorder::new(context)?;
        recorder.stage("arrays");
        let arguments = shaders::solve::ElementProduct {
            tetrahedra: &tetrahedra,
            gradients: &gradients,
            change: &change,
            element_forces: &element_forces,
        };
        recorder.dispatch(&kernel, &arguments, TETRAHEDRA);
        recorder.finish()
    };
    let recordings = [recording(Arrays::Texel)?, recording(Arrays::Storage)?];
    let mut times = [const { Vec::new() }; 2];
    for run in 0..WARM_UP + RUNS {
        for (recording, times) in recordings.iter().zip(&mut times) {
            let begun = Instant::now();
            recording.submit_and_wait()?;
            let whole = begun.elapsed().as_secs_f64() * 1e6;
            if run >= WARM_UP {
                times.push(recording.stage_times().first().map_or(whole, |(_, us)| *us));
            }
        }
    }
    Ok(times.map(|mut times| {
        times.sort_unstable_by(f64::total_cmp);
        times[RUNS / 2]
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::Options;

    fn chosen(options: Options) -> (Arrays, String) {
        let device = std::env::var("PALPATE_TEST_DEVICE").ok();
        let context = Context::open(&Options { device, ..options }).unwrap();
        let choice = ArrayChoice::new(&context).unwrap();
        assert_eq!(choice.arrays, context.arrays());
        (choice.arrays, choice.to_string())
    }

    #[test]
    fn arrays_are_as_asked_for_else_by_the_limit_else_measured_once_where_that_is_asked_for() {
        let folder = tempfile::tempdir().unwrap();
        let cache = folder.path().join("cache");
        let measured = || Options { cache: Some(cache.clone()), measure: true, ..Options::default() };
        for (arrays, name) in [(Arrays::Texel, "texel"), (Arrays::Storage, "storage")] {
            let options = Options { arrays: Some(arrays), cache: None, ..measured() };
            assert_eq!(chosen(options), (arrays, format!("{name} buffers: asked for")));
        }
        let options = Options { texel_elements: Some(65_536), cache: None, ..measured() };
        let binds = {
            let device = std::env::var("PALPATE_TEST_DEVICE").ok();
            Context::open(&Options { device, ..Options::default() }).unwrap().binds_texel_buffers()
        };
        if binds {
            let why = "storage buffers: the device's texel buffers hold only 65536 elements";
            assert_eq!(chosen(options), (Arrays::Storage, why.into()));
        }
        let plain = chosen(Options { cache: Some(cache.clone()), ..Options::default() });
        assert!(plain.1.contains("not measured") || plain.0 == Arrays::Storage, "unmeasured choice: {plain:?}");
        let first = chosen(measured());
        assert!(first.1.contains("measured ") || first.0 == Arrays::Storage, "choice by measurement: {first:?}");
        // Times differ from one measurement to the next, so equal times show that the second call read stored times.
        assert_eq!(chosen(measured()), first);
    }
}
