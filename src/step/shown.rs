//! What another program draws: the skins as they are now, on the device.

use std::ops::Range;

use glam::DVec3;

use super::Simulation;
use crate::Result;
use crate::gpu::{Buffer, Recorder, Recording};
use crate::prepare::{Body, Shape};
use crate::stages::draw::Draw;
use crate::stages::types::Frame;

/// The arrays that are shown, and the passes that fill them.
pub(super) struct Shown {
    draw: Draw,
    recording: Recording,
}

/// Skins on the device: a vec4 a vertex of all bodies, one after another, the tool's last.
pub struct Skins<'a> {
    /// m, from the origin that was asked for; w is 1.
    pub positions: &'a Buffer,
    /// Unit, outward; w is 0. Zero where a vertex has no triangle with an area.
    pub normals: &'a Buffer,
    /// Three vertices a triangle, and a zero: four u32.
    pub triangles: &'a Buffer,
}

impl Simulation {
    /// The skins as they are now, relative to `origin` (m): the arrays are filled when this returns, and stay so until it is
    /// called again. They are made at the first call.
    pub fn skins(&mut self, origin: DVec3) -> Result<Skins<'_>> {
        if self.shown.is_none() {
            let skin = self.stages.touch.as_ref().map(|touch| &touch.skin);
            let draw = Draw::new(&self.context, &self.model, &self.skin_ranges(), skin)?;
            let mut recorder = Recorder::untimed(&self.context)?;
            draw.record(&mut recorder, &self.stages.elastic);
            self.shown = Some(Shown { draw, recording: recorder.finish()? });
        }
        let Some(Shown { draw, recording }) = &self.shown else { unreachable!("made just now") };
        self.frames.write_places(origin, self.tool.as_ref(), &mut draw.frames.mapped_mut::<Frame>()?);
        recording.submit_and_wait()?;
        Ok(Skins { positions: &draw.positions, normals: &draw.normals, triangles: &draw.triangles })
    }

    /// The vertices of each body's skin among those of all, the tool's last; none of a half-space.
    pub fn skin_ranges(&self) -> Vec<Range<usize>> {
        let size = |body: &Body| match &body.shape {
            Shape::Soft { skin, .. } | Shape::Rigid { skin, .. } => skin.vertices.len(),
            Shape::Plane { .. } => 0,
        };
        let mut first = 0;
        let range = |body: &Body| {
            let range = first..first + size(body);
            first = range.end;
            range
        };
        self.bodies.iter().chain(&self.tool_body).map(range).collect()
    }

    /// Triangles of a body's skin, of its own vertices; the tool comes after the bodies.
    pub fn skin_triangles(&self, body: usize) -> &[[u32; 3]] {
        match self.bodies.iter().chain(&self.tool_body).nth(body).map(|body| &body.shape) {
            Some(Shape::Soft { skin, .. } | Shape::Rigid { skin, .. }) => &skin.triangles,
            _ => &[],
        }
    }

    /// The vertices of the tool's skin about its centre of mass, tool axes, m; empty where it is none of its own.
    pub fn tool_skin(&self) -> Vec<DVec3> {
        match self.tool_body.as_ref().map(|body| &body.shape) {
            Some(Shape::Rigid { skin, centroid, .. }) => skin.vertices.iter().map(|x| *x - *centroid).collect(),
            _ => Vec::new(),
        }
    }
}
