//! The proximity query: where the skins of two rigid bodies overlap.

use std::sync::{Mutex, PoisonError};

use glam::DVec3;
use numpy::{IntoPyArray, PyArray1};
use palpate::Options;
use pyo3::prelude::*;

use crate::arrays::{PlainPose, Points, numbers, points, pose};
use crate::context::{OPENING, options};
use crate::failure::raise;
use crate::scene::Scene;

/// The contacts of an answer by columns (body, vertex, depth, normal, triangle, barycentric coordinates, area), and its
/// flags.
type Answer<'py> = (
    Bound<'py, PyArray1<u32>>,
    Bound<'py, PyArray1<u32>>,
    Bound<'py, PyArray1<f64>>,
    Points<'py>,
    Bound<'py, PyArray1<u32>>,
    Points<'py>,
    Bound<'py, PyArray1<f64>>,
    u32,
);

/// Two rigid bodies whose skins may overlap.
#[pyclass(frozen, module = "palpate.native")]
pub struct Query {
    inner: Mutex<palpate::Query>,
}

#[pymethods]
impl Query {
    #[new]
    fn new(py: Python<'_>, scene: &Scene, a: &str, b: &str, device: Option<String>) -> PyResult<Query> {
        let options: Options = options(device, Some("auto"), true, None)?;
        let opened = py.detach(|| {
            let _guard = OPENING.lock().unwrap_or_else(PoisonError::into_inner);
            palpate::Query::open(&scene.inner, [a, b], &options)
        });
        Ok(Query { inner: Mutex::new(opened.map_err(raise)?) })
    }

    /// The overlap with the bodies in these poses; `direction` is the world direction from a to b along which depth is
    /// measured, or None.
    fn run<'py>(
        &self,
        py: Python<'py>,
        a: PlainPose,
        b: PlainPose,
        direction: Option<[f64; 3]>,
        depth_limit: Option<f64>,
    ) -> PyResult<Answer<'py>> {
        let [a, b] = [pose(a)?, pose(b)?].map(|pose| (pose.position, pose.orientation));
        let answer = py.detach(|| {
            let mut query = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
            query.set_direction(direction.map(DVec3::from_array));
            depth_limit.map_or(Ok(()), |limit| query.set_depth_limit(limit))?;
            query.run(a, b)
        });
        let answer = answer.map_err(raise)?;
        let contacts = &answer.contacts;
        let column = |of: &dyn Fn(&palpate::QueryContact) -> u32| -> Bound<'py, PyArray1<u32>> {
            contacts.iter().map(of).collect::<Vec<_>>().into_pyarray(py)
        };
        Ok((
            column(&|contact| contact.body as u32),
            column(&|contact| contact.vertex),
            numbers(py, contacts.iter().map(|contact| contact.depth)),
            points(py, contacts.iter().map(|contact| contact.normal).collect())?,
            column(&|contact| contact.triangle),
            points(py, contacts.iter().map(|contact| DVec3::from_array(contact.barycentric)).collect())?,
            numbers(py, contacts.iter().map(|contact| contact.area)),
            answer.flags.0,
        ))
    }
}
