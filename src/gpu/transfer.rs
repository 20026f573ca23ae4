//! Copies several arrays (buffers in GPU memory) at once to or from the CPU, with one staging array, which the CPU can
//! access, and one submit.

use std::sync::Arc;

use super::{Buffer, Context, Memory, Recorder};
use crate::error::{Error, Result};

/// Reads the contents of `arrays`; returns their bytes, one array after another.
pub fn read_all(context: &Arc<Context>, arrays: &[&Buffer]) -> Result<Vec<u8>> {
    let total = total(arrays);
    if total == 0 {
        return Ok(Vec::new());
    }
    let staging = Buffer::new(context, "arrays (read)", total, Memory::Readback)?;
    copy(context, arrays, |recorder, array, at| recorder.copy_range(array, 0, &staging, at, array.bytes()))?;
    staging.read()
}

/// Overwrites these arrays with bytes that [`read_all`] returned for arrays of the same sizes.
pub fn write_all(context: &Arc<Context>, arrays: &[&Buffer], bytes: &[u8]) -> Result<()> {
    if bytes.len() as u64 != total(arrays) {
        return Err(Error::Simulation(format!(
            "{} bytes were given for arrays of {} bytes in all",
            bytes.len(),
            total(arrays)
        )));
    }
    if bytes.is_empty() {
        return Ok(());
    }
    let staging = Buffer::from_slice(context, "arrays (write)", bytes, Memory::Staging)?;
    copy(context, arrays, |recorder, array, at| recorder.copy_range(&staging, at, array, 0, array.bytes()))
}

fn total(arrays: &[&Buffer]) -> u64 {
    arrays.iter().map(|array| array.bytes()).sum()
}

fn copy(context: &Arc<Context>, arrays: &[&Buffer], pass: impl Fn(&mut Recorder, &Buffer, u64)) -> Result<()> {
    let mut recorder = Recorder::untimed(context)?;
    recorder.stage("transfer");
    let mut at = 0;
    for array in arrays {
        pass(&mut recorder, array, at);
        at += array.bytes();
    }
    recorder.finish()?.submit_and_wait()
}
