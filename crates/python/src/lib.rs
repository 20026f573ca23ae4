//! The compiled part of the Python package `palpate`: scenes, simulations, queries and the program, with NumPy arrays.
//! `python/palpate/*.py` beside this crate's sources is what a user sees; it documents units and shapes, and nothing here is
//! called by anybody else. Arrays are packed rows of float64 or uint32 unless stated; indices of bodies are those of the
//! scene, and the tool's is the one after the last.
// pyo3's macros and views of mapped memory need it; each use of our own has a SAFETY line.
#![allow(unsafe_code)]

mod arrays;
mod context;
mod failure;
mod hold;
mod identify;
mod query;
mod scene;
mod simulation;
mod skins;

use pyo3::prelude::*;

/// The module `palpate.native`.
#[pymodule]
mod native {
    use pyo3::prelude::*;

    #[pymodule_export]
    use crate::context::{Context, devices};
    #[pymodule_export]
    use crate::identify::fit;
    #[pymodule_export]
    use crate::query::Query;
    #[pymodule_export]
    use crate::scene::Scene;
    #[pymodule_export]
    use crate::simulation::Simulation;

    /// Runs the program `palpate` with these arguments, the program's name first; returns its exit status.
    #[pyfunction]
    fn program(py: Python<'_>, arguments: Vec<String>) -> u8 {
        py.detach(|| palpate_cli::program(arguments))
    }

    /// Runs a command of the program, such as `["film", "scene.toml", "--out", "film.png"]`.
    #[pyfunction]
    fn command(py: Python<'_>, arguments: Vec<String>) -> PyResult<()> {
        let name = std::iter::once("palpate".to_string());
        let run = || {
            let _guard = super::context::OPENING.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            palpate_cli::command(name.chain(arguments))
        };
        py.detach(run).map_err(super::failure::raise)
    }

    /// Every flag of a step: its bit and its name.
    #[pyfunction]
    fn flags() -> Vec<(u32, &'static str)> {
        palpate::Flags::ALL.iter().map(|(flag, name)| (flag.0, *name)).collect()
    }

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
