//! What a device costs before it computes anything: a pass, an empty one, a fill, a copy and a submit.

use std::sync::Arc;
use std::time::Instant;

use palpate::internal::gpu::{Buffer, Kernel, Memory, Recorder, Recording, Size};
use palpate::internal::shaders::test::Bump;
use palpate::{Context, Result};
use serde::Serialize;

use crate::median;

/// Number of passes in a recording; the cost of one is the recording's time, less that of an empty recording, divided by
/// this number.
const PASSES: u32 = 200;
/// Number of submits of which the median is taken, and of those before, which are not counted.
const RUNS: usize = 41;
const WARM_UP: usize = 5;
/// Number of 32-bit words that the passes work on.
const WORDS: usize = 64;

/// What one thing costs.
#[derive(Debug, Clone, Serialize)]
pub struct Cost {
    /// What is done.
    pub what: &'static str,
    /// Its time, us.
    pub us: f64,
}

/// Measures a device.
pub fn measure(context: &Arc<Context>) -> Result<Vec<Cost>> {
    let kernel = Kernel::new(context, "test/bump", Size::Group, &[])?;
    let array = |name: &str| Buffer::from_slice(context, name, &[0u32; WORDS], Memory::Device);
    let (a, b) = (array("a")?.known_as(&["cells"]), array("b")?.known_as(&["cells"]));
    let nothing = Buffer::from_slice(context, "args", &[0u32, 1, 1], Memory::Device)?;
    let bump = Bump { cells: &a, amount: 1, count: WORDS as u32 };
    let time = |pass: &dyn Fn(&mut Recorder, u32)| -> Result<f64> {
        let mut recorder = Recorder::untimed(context)?;
        (0..PASSES).for_each(|k| pass(&mut recorder, k));
        submit_us(&recorder.finish()?)
    };
    let submit = time(&|_, _| ())?;
    let each = |what, pass: &dyn Fn(&mut Recorder, u32)| {
        Ok(Cost { what, us: ((time(pass)? - submit) / f64::from(PASSES)).max(0.0) })
    };
    Ok(vec![
        Cost { what: "a submit and the wait for its end", us: submit },
        each("a pass of one workgroup that waits for the last", &|r, _| r.dispatch(&kernel, &bump, WORDS as u32))?,
        each("an indirect pass without workgroups", &|r, _| r.dispatch_indirect(&kernel, &bump, &nothing, 0))?,
        each("a fill of 256 bytes", &|r, k| r.fill(&a, k))?,
        each("a copy of 256 bytes", &|r, k| if k % 2 == 0 { r.copy(&a, &b) } else { r.copy(&b, &a) })?,
    ])
}

/// The median wall time of a submit and the wait for its end, us.
fn submit_us(recording: &Recording) -> Result<f64> {
    let mut times = Vec::with_capacity(RUNS);
    for run in 0..WARM_UP + RUNS {
        let begun = Instant::now();
        recording.submit_and_wait()?;
        if run >= WARM_UP {
            times.push(begun.elapsed().as_secs_f64() * 1e6);
        }
    }
    Ok(median(&times))
}
