//! Fields of the tetrahedra of soft bodies: stress and strain energy density.

use std::ops::Range;

use glam::{DMat3, DVec3};

use super::{ShownFields, Simulation, missing};
use crate::Result;
use crate::prepare::{Body, Shape};

/// Fields of all tetrahedra, body after body.
#[doc(hidden)]
pub struct TetrahedronFields {
    /// Strain energy density (J/m^3), rest volume (m^3), and two numbers of the computation.
    pub densities: Vec<[f32; 4]>,
    /// Cauchy's stress, world axes, Pa: xx, yy, zz and von Mises's stress; xy, xz, yz and hydrostatic pressure, zero
    /// under tension.
    pub stresses: Vec<[f32; 8]>,
}

impl Simulation {
    /// Cauchy's stress in each tetrahedron of a soft body after the last step: symmetric, world axes, Pa, in the order of
    /// the body's tetrahedral mesh; empty for a body that is not soft. The stress is that of the material's law, with the
    /// penalty on compression below a stretch of 0.3, without damping; it is constant in a tetrahedron. It is zero in a
    /// tetrahedron that is flat or inside out, which [`Flags::INVERTED`](crate::Flags) reports. The first call makes the
    /// arrays; every call costs transfers from the GPU.
    ///
    /// # Errors
    /// [`crate::Error::Vulkan`]: a transfer failed, or there is no memory for the arrays.
    pub fn stresses(&mut self, body: usize) -> Result<Vec<DMat3>> {
        let range = self.tetrahedron_range(body);
        if range.is_empty() {
            return Ok(Vec::new());
        }
        let all = self.tetrahedron_fields()?.stresses;
        let stress = |[xx, yy, zz, _, xy, xz, yz, _]: [f32; 8]| {
            let column = |x: f32, y: f32, z: f32| DVec3::new(x.into(), y.into(), z.into());
            DMat3::from_cols(column(xx, xy, xz), column(xy, yy, yz), column(xz, yz, zz))
        };
        Ok(all[range].iter().copied().map(stress).collect())
    }

    /// Strain energy density in each tetrahedron of a soft body after the last step, J/m^3 of volume at rest, in the order
    /// of the body's tetrahedral mesh; empty for a body that is not soft. Costs are those of [`Simulation::stresses`].
    ///
    /// # Errors
    /// [`crate::Error::Vulkan`]: a transfer failed, or there is no memory for the arrays.
    pub fn strain_energy_densities(&mut self, body: usize) -> Result<Vec<f64>> {
        let range = self.tetrahedron_range(body);
        if range.is_empty() {
            return Ok(Vec::new());
        }
        Ok(self.tetrahedron_fields()?.densities[range].iter().map(|row| row[0].into()).collect())
    }

    /// The tetrahedra of a body among those of all bodies; empty for a body that is not soft.
    #[doc(hidden)]
    pub fn tetrahedron_range(&self, body: usize) -> Range<usize> {
        let count = |body: &Body| match &body.shape {
            Shape::Soft { layer, .. } => layer.tetrahedra.len(),
            _ => 0,
        };
        let first = self.bodies.iter().take(body).map(count).sum();
        first..first + self.bodies.get(body).map_or(0, count)
    }

    /// Fields of all tetrahedra after the last step.
    #[doc(hidden)]
    pub fn tetrahedron_fields(&mut self) -> Result<TetrahedronFields> {
        self.shown_fields()?;
        let shown = self.shown_at(DVec3::ZERO)?;
        let Some(ShownFields { of_tetrahedra: (recording, [densities, stresses]), .. }) = &shown.fields else {
            return Err(missing());
        };
        recording.submit_and_wait()?;
        Ok(TetrahedronFields { densities: densities.read()?, stresses: stresses.read()? })
    }
}
