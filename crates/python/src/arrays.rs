//! NumPy arrays made from the engine's vectors, and the reverse.

use glam::{DQuat, DVec3};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use palpate::Pose;
use pyo3::prelude::*;

use crate::failure::wrong;

/// Rows of three float64.
pub type Points<'py> = Bound<'py, PyArray2<f64>>;

/// A position and an orientation (x y z w), as Python has them.
pub type PlainPose = ([f64; 3], [f64; 4]);

/// An array of N rows of three.
pub fn points<'py>(py: Python<'py>, vectors: Vec<DVec3>) -> PyResult<Points<'py>> {
    let rows = vectors.len();
    let numbers: Vec<f64> = vectors.into_iter().flat_map(|v| v.to_array()).collect();
    numbers.into_pyarray(py).reshape([rows, 3])
}

/// An array of N rows of K indices.
pub fn rows<'py, const K: usize>(py: Python<'py>, rows: &[[u32; K]]) -> PyResult<Bound<'py, PyArray2<u32>>> {
    rows.as_flattened().to_vec().into_pyarray(py).reshape([rows.len(), K])
}

/// An array of numbers.
pub fn numbers<'py>(py: Python<'py>, values: impl Iterator<Item = f64>) -> Bound<'py, PyArray1<f64>> {
    values.collect::<Vec<f64>>().into_pyarray(py)
}

/// The rows of an array with K columns.
pub fn read<T: numpy::Element + Copy, const K: usize>(
    name: &str,
    array: &PyReadonlyArray2<'_, T>,
) -> PyResult<Vec<[T; K]>> {
    let view = array.as_array();
    if view.ncols() != K {
        return Err(wrong(format!("{name} has {} columns; give {K}", view.ncols())));
    }
    Ok(view.rows().into_iter().map(|row| std::array::from_fn(|k| row[k])).collect())
}

/// A pose as Python has it.
pub fn plain(pose: &Pose) -> PlainPose {
    (pose.position.to_array(), pose.orientation.to_array())
}

/// A pose from a position and an orientation, which is normalised.
pub fn pose((position, orientation): PlainPose) -> PyResult<Pose> {
    let (position, orientation) = (DVec3::from_array(position), DQuat::from_array(orientation));
    let length = orientation.length();
    if !(position.is_finite() && length.is_finite() && length > 0.0) {
        return Err(wrong("a pose is not finite or has an orientation of length 0; give finite numbers"));
    }
    Ok(Pose { position, orientation: orientation.normalize() })
}
