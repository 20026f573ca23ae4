//! Vulkan devices: their list, and the choice of one.

use std::sync::{Arc, Mutex, PoisonError};

use palpate::{Options, Threads};
use pyo3::prelude::*;

use crate::failure::{raise, wrong};

/// Held while a device is opened, which may set a variable of the process's environment that the driver reads.
pub static OPENING: Mutex<()> = Mutex::new(());

/// An open Vulkan device.
#[pyclass(frozen, module = "palpate.native")]
pub struct Context {
    pub inner: Arc<palpate::Context>,
}

/// Options of an opened device, as `palpate.Context` describes them.
pub fn options(
    device: Option<String>,
    threads: Option<&str>,
    cache: bool,
    workgroup: Option<u32>,
) -> PyResult<Options> {
    let threads = match threads {
        None => None,
        Some("auto") => Some(Threads::Auto),
        Some(text) => {
            let count = text.parse().map_err(|_| wrong("threads is a number, \"auto\" or None"))?;
            Some(Threads::Count(count))
        }
    };
    let program = Options::of_program();
    let workgroup = workgroup.or(program.workgroup);
    Ok(Options { device, threads, workgroup, cache: program.cache.filter(|_| cache), measure: cache, ..program })
}

#[pymethods]
impl Context {
    #[new]
    #[pyo3(signature = (device, threads, cache, workgroup, validation))]
    fn new(
        py: Python<'_>,
        device: Option<String>,
        threads: Option<&str>,
        cache: bool,
        workgroup: Option<u32>,
        validation: bool,
    ) -> PyResult<Context> {
        let options = Options { validation, ..options(device, threads, cache, workgroup)? };
        let inner = py.detach(|| {
            let _guard = OPENING.lock().unwrap_or_else(PoisonError::into_inner);
            palpate::Context::open(&options)
        });
        Ok(Context { inner: inner.map_err(raise)? })
    }

    #[getter]
    fn device(&self) -> &str {
        self.inner.device_name()
    }

    #[getter]
    fn driver(&self) -> &str {
        self.inner.driver()
    }
}

/// A Vulkan device: index, name, driver, Vulkan version, and why it cannot be used (None: it can).
type Device = (usize, String, String, String, Option<String>);

/// The Vulkan devices of this machine.
#[pyfunction]
pub fn devices(py: Python<'_>) -> PyResult<Vec<Device>> {
    let list = py.detach(palpate::Context::list).map_err(raise)?;
    Ok(list.into_iter().map(|d| (d.index, d.name, d.driver, d.api_version, d.usable.err())).collect())
}
