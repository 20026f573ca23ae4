//! What another program draws: the skins as they are now, on the device.

use std::ops::Range;

use glam::DVec3;

use super::Simulation;
use crate::Result;
use crate::gpu::{Recorder, Recording};
use crate::prepare::{Body, Shape};
use crate::stages::draw::Draw;
pub use crate::stages::draw::Skins;
use crate::stages::types::Frame;

/// The arrays that are shown, and the passes that fill them.
pub(super) struct Shown {
    draw: Draw,
    recording: Recording,
}

impl Simulation {
    /// The skins as they are now, relative to `origin` (m): the arrays are filled when this returns, and stay so until it is
    /// called again. They are made at the first call.
    pub fn skins(&mut self, origin: DVec3) -> Result<Skins<'_>> {
        let shown = match self.shown.take() {
            Some(shown) => shown,
            None => self.show()?,
        };
        let Shown { draw, recording } = self.shown.insert(shown);
        self.frames.write_places(origin, self.tool.as_ref(), &mut draw.frames.mapped_mut::<Frame>()?);
        recording.submit_and_wait()?;
        Ok(draw.skins())
    }

    /// The same arrays as they were filled last; uninitialised before.
    pub fn skin_arrays(&mut self) -> Result<Skins<'_>> {
        let shown = match self.shown.take() {
            Some(shown) => shown,
            None => self.show()?,
        };
        Ok(self.shown.insert(shown).draw.skins())
    }

    fn show(&self) -> Result<Shown> {
        let skin = self.stages.touch.as_ref().map(|touch| &touch.skin);
        let draw = Draw::new(&self.context, &self.model, &self.skin_ranges(), skin)?;
        let mut recorder = Recorder::untimed(&self.context)?;
        draw.record(&mut recorder, &self.stages.elastic);
        Ok(Shown { draw, recording: recorder.finish()? })
    }

    /// Where the vertices of any body's skin are, world, m; the tool comes after the bodies.
    pub fn vertex_positions(&self, body: usize) -> Result<Vec<DVec3>> {
        let rigid = self.bodies.get(body).map(|body| &body.shape);
        match rigid {
            None => {
                let Some(tool) = &self.tool else { return Ok(Vec::new()) };
                Ok(self.tool_skin().iter().map(|x| tool.centre + tool.orientation * *x).collect())
            }
            Some(Shape::Rigid { skin, .. }) => {
                let frame = self.model.body_frames[body] as usize;
                let centre = self.model.frames[frame].rest_centre;
                Ok(skin.vertices.iter().map(|x| self.frames.world(frame, *x - centre)).collect())
            }
            Some(_) => self.skin_positions(body),
        }
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
