//! Raises the engine's errors as exceptions of `palpate.errors`, one class for each kind.

use palpate::Error;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

/// The Python exception for an error of the engine.
pub fn raise(error: Error) -> PyErr {
    let class = match &error {
        Error::Input { .. } | Error::Key { .. } | Error::Usage(_) => "InputError",
        Error::Output { .. } => "OutputError",
        Error::NoDevice(_) => "DeviceError",
        Error::Vulkan { .. } => "VulkanError",
        Error::Memory(_) => "OutOfMemoryError",
        Error::Simulation(_) | Error::Cancelled(_) => "SimulationError",
    };
    let message = error.to_string();
    Python::attach(|py| {
        let made = py.import("palpate.errors").and_then(|errors| errors.getattr(class)?.call1((&message,)));
        made.map_or_else(|_| PyRuntimeError::new_err(message.clone()), PyErr::from_value)
    })
}

/// The exception for an argument that cannot be used.
pub fn wrong(message: impl Into<String>) -> PyErr {
    raise(Error::Usage(message.into()))
}
