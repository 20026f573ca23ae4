//! Skins (the surface meshes of the bodies) in memory that the CPU reads: a recording copies them there from the GPU, and
//! Python gets views of that memory, so nothing is copied on the CPU.

use std::ops::Range;

use glam::DVec3;
use numpy::ndarray::ArrayView2;
use numpy::{PyArray2, PyArrayMethods};
use palpate::Simulation;
use palpate::internal::gpu::{Buffer, Memory, Recorder, Recording};
use pyo3::prelude::*;

/// A view of positions or normals: rows of four float32.
pub type View<'py> = Bound<'py, PyArray2<f32>>;

/// Memory of all skins' positions and normals, four floats a vertex each, and the recording that fills it.
pub struct SkinCopies {
    fetch: Recording,
    arrays: [Buffer; 2],
    /// The GPU arrays that are copied. A simulation makes new ones where friction comes into its scene.
    sources: [u64; 2],
}

/// Keeps the memory of a view alive.
#[pyclass(frozen, module = "palpate.native")]
struct Owner {
    _buffer: Buffer,
}

impl SkinCopies {
    fn new(simulation: &mut Simulation) -> palpate::Result<SkinCopies> {
        let context = simulation.context().clone();
        let skins = simulation.skin_arrays()?;
        let sources = [skins.positions, skins.normals];
        let copy = |from: &Buffer| Buffer::new(&context, from.name(), from.bytes(), Memory::Readback);
        let arrays = [copy(sources[0])?, copy(sources[1])?];
        let mut recorder = Recorder::untimed(&context)?;
        recorder.stage("read");
        sources.iter().zip(&arrays).for_each(|(from, to)| recorder.copy(from, to));
        Ok(SkinCopies { fetch: recorder.finish()?, sources: sources.map(Buffer::raw), arrays })
    }

    /// Copies the skins as they are now into `copies`, which is made anew where the simulation has other arrays; returns
    /// handles of the positions and normals.
    pub fn refresh(copies: &mut Option<SkinCopies>, simulation: &mut Simulation) -> palpate::Result<[Buffer; 2]> {
        simulation.skins(DVec3::ZERO)?;
        let skins = simulation.skin_arrays()?;
        let sources = [skins.positions.raw(), skins.normals.raw()];
        let current = match copies.take() {
            Some(copies) if copies.sources == sources => copies,
            _ => SkinCopies::new(simulation)?,
        };
        let copies = copies.insert(current);
        copies.fetch.submit_and_wait()?;
        Ok(copies.arrays.each_ref().map(|array| array.known_as(&[])))
    }
}

/// A view of the vertices in this range.
pub fn view<'py>(py: Python<'py>, buffer: &Buffer, range: Range<usize>) -> PyResult<View<'py>> {
    let mapped = buffer.mapped::<[f32; 4]>().map_err(crate::failure::raise)?;
    let own = &mapped[range];
    // SAFETY: the memory stays mapped as long as its buffer lives, which the view's owner keeps alive. The GPU writes it
    // only within `SkinCopies::refresh`, whose caller holds the simulation; Python's documentation says that a view
    // changes then.
    let rows = unsafe { ArrayView2::from_shape_ptr([own.len(), 4], own.as_ptr().cast::<f32>()) };
    let owner = Bound::new(py, Owner { _buffer: buffer.known_as(&[]) })?;
    // SAFETY: the owner keeps the memory alive.
    let view = unsafe { PyArray2::borrow_from_array(&rows, owner.into_any()) };
    view.readwrite().make_nonwriteable();
    Ok(view)
}
