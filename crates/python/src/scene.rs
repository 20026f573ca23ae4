//! Scenes: from the text of a scene file, or from tables and meshes in memory.

use std::path::PathBuf;

use glam::DVec3;
use numpy::PyReadonlyArray2;
use palpate::SceneBuilder;
use palpate::scene::dotted;
use pyo3::prelude::*;

use crate::arrays::read;
use crate::failure::{raise, wrong};

/// Name, points and corners of a mesh.
type Mesh<'py> = (String, PyReadonlyArray2<'py, f64>, PyReadonlyArray2<'py, u32>);

/// What Python's dictionaries, lists and numbers are in TOML.
pub fn plain<T: serde::de::DeserializeOwned>(value: &Bound<'_, PyAny>) -> PyResult<T> {
    pythonize::depythonize(value).map_err(|error| wrong(format!("a value of the scene is none of TOML: {error}")))
}

/// A scene that has been checked.
#[pyclass(frozen, module = "palpate.native")]
pub struct Scene {
    pub inner: palpate::Scene,
}

#[pymethods]
impl Scene {
    /// Reads the text of a scene file; messages name `file`, and relative paths are relative to its folder.
    #[staticmethod]
    fn parse(py: Python<'_>, file: PathBuf, text: &str) -> PyResult<Scene> {
        Ok(Scene { inner: py.detach(|| palpate::Scene::parse(&file, text)).map_err(raise)? })
    }

    /// Makes a scene from tables like those of a scene file, and from surfaces and layers in memory, which the tables
    /// call by name.
    #[staticmethod]
    fn build(
        file: PathBuf,
        tables: &Bound<'_, PyAny>,
        surfaces: Vec<Mesh<'_>>,
        layers: Vec<Mesh<'_>>,
    ) -> PyResult<Scene> {
        let tables: toml::Table = plain(tables)?;
        let mut builder = SceneBuilder::new(file);
        let vectors = |points: Vec<[f64; 3]>| points.into_iter().map(DVec3::from_array).collect();
        for (name, vertices, triangles) in &surfaces {
            let vertices = vectors(read("vertices", vertices)?);
            builder.meshes().add_surface(name, vertices, &read("triangles", triangles)?).map_err(raise)?;
        }
        for (name, nodes, tetrahedra) in &layers {
            let nodes = vectors(read("nodes", nodes)?);
            builder.meshes().add_layer(name, nodes, &read("tetrahedra", tetrahedra)?).map_err(raise)?;
        }
        builder.tables(&tables).map_err(raise)?;
        Ok(Scene { inner: builder.build().map_err(raise)? })
    }

    /// Tables in which a dotted key has another value.
    #[staticmethod]
    fn with_value<'py>(
        py: Python<'py>,
        tables: &Bound<'py, PyAny>,
        key: &str,
        value: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let mut tables = plain::<toml::Table>(tables)?;
        dotted::set(&mut tables, key, plain(value)?).map_err(raise)?;
        Ok(pythonize::pythonize(py, &tables)?)
    }

    /// The value of a dotted key in tables.
    #[staticmethod]
    fn value<'py>(py: Python<'py>, tables: &Bound<'py, PyAny>, key: &str) -> PyResult<Option<Bound<'py, PyAny>>> {
        let value = dotted::get(&plain(tables)?, key).map_err(raise)?;
        value.map(|value| Ok(pythonize::pythonize(py, &value)?)).transpose()
    }

    #[getter]
    fn name(&self) -> String {
        self.inner.name()
    }

    #[getter]
    fn bodies(&self) -> Vec<&str> {
        self.inner.bodies.iter().map(|body| body.name.as_str()).collect()
    }

    #[getter]
    fn dt(&self) -> f64 {
        self.inner.step.dt
    }

    #[getter]
    fn duration(&self) -> f64 {
        self.inner.duration()
    }

    #[getter]
    fn has_tool(&self) -> bool {
        self.inner.tool.is_some()
    }
}
