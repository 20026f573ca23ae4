//! Arrays for renderers: the current skins (surface meshes of the bodies) on the GPU, and scalar fields to colour them
//! by. This code reads what a step leaves on the GPU and changes none of it, so a run gives the same results to the
//! last bit whether it is displayed or not. A frame is the rigid coordinate frame of a body or of a rigid body inside
//! it; a link is the placement of one frame relative to another. The tool is the rigid body that the haptic device
//! leads.

mod contact_patches;
mod elements;
mod overlay;

use std::ops::Range;

use glam::DVec3;

use super::Simulation;
use crate::gpu::{Buffer, Memory, Recorder, Recording};
use crate::prepare::{Body, Shape};
use crate::shaders::{Frame, Link};
use crate::stages::contact::Touch;
use crate::stages::draw::{Draw, FIELDS, Fields, of_all};
pub use crate::stages::draw::{Field, Skins};
use crate::{Error, Result};
pub use contact_patches::ContactPatchRectangle;
pub use elements::TetrahedronFields;
use overlay::ShownMesh;
pub use overlay::{Cut, Mesh, Overlay, Part};

/// The arrays that are displayed, and the recordings that fill them.
pub(super) struct Shown {
    draw: Draw,
    recording: Recording,
    fields: Option<ShownFields>,
    /// One mesh per kind of overlay (see [`Overlay`]), made when it is first asked for.
    meshes: [Option<ShownMesh>; 4],
}

/// The scalar fields and their recordings, made when the first field is asked for.
struct ShownFields {
    fields: Fields,
    /// One recording per [`Field`].
    recordings: [Recording; FIELDS],
    /// Fills the fields of the tetrahedra and copies them to the host: densities, then stresses.
    of_tetrahedra: (Recording, [Buffer; 2]),
}

/// A scalar field as it was when it was asked for.
#[derive(Clone)]
pub struct FieldValues {
    /// Which field the values are of.
    pub field: Field,
    /// One float per skin vertex, body after body, packed; floats are added at the end until their number is a multiple
    /// of four (one texel). Every call of [`Simulation::field`] returns the same array for a field, which can be bound
    /// as a storage, texel or vertex buffer.
    pub values: Buffer,
    /// The greatest value on each body, that on the tool last; zero for a body without skin.
    pub greatest: Vec<f32>,
}

impl Simulation {
    /// The skins as they are now, with positions relative to `origin` (m). The arrays are made at the first call. They
    /// are filled when this function returns, and keep their contents until it is called again.
    #[doc(hidden)]
    pub fn skins(&mut self, origin: DVec3) -> Result<Skins<'_>> {
        let shown = self.shown_at(origin)?;
        shown.recording.submit_and_wait()?;
        Ok(shown.draw.skins())
    }

    /// The arrays of [`Simulation::skins`] with the contents that the last call of that function wrote; before its
    /// first call the arrays are uninitialised.
    #[doc(hidden)]
    pub fn skin_arrays(&mut self) -> Result<Skins<'_>> {
        Ok(self.shown()?.draw.skins())
    }

    /// A scalar field after the last step, on the GPU: its array is filled when this function returns, and keeps its
    /// contents until the field is asked for again (a call for depth or for pressure fills both arrays). The arrays are
    /// made at the first call. They and the arrays of the skins are made anew where [`Simulation::set_contact`] brings
    /// friction into a scene that had none.
    #[doc(hidden)]
    pub fn field(&mut self, field: Field) -> Result<FieldValues> {
        let is_solved = u32::from(self.is_solved);
        self.shown_fields()?;
        let shown = self.shown_at(DVec3::ZERO)?;
        let Some(ShownFields { fields, recordings, .. }) = &shown.fields else { return Err(missing()) };
        fields.is_solved.mapped_mut::<u32>()?[0] = is_solved;
        let at = field as usize;
        recordings[at].submit_and_wait()?;
        let values = fields.values[at].clone();
        let greatest = fields.most_values[at].read()?;
        let bodies = self.bodies.len() + usize::from(self.tool_body.is_some());
        Ok(FieldValues { field, values, greatest: greatest[..bodies].to_vec() })
    }

    /// Writes the frames and links as they are now for the recordings, and returns the arrays that are displayed.
    /// Positions will be relative to `origin` (m).
    fn shown_at(&mut self, origin: DVec3) -> Result<&mut Shown> {
        self.shown()?;
        let Some(shown) = &mut self.shown else { return Err(missing()) };
        self.frames.write_places(origin, self.tool.as_ref(), &mut shown.draw.frames.mapped_mut::<Frame>()?);
        self.frames.write_links(&mut shown.draw.links.mapped_mut::<Link>()?);
        Ok(shown)
    }

    fn shown(&mut self) -> Result<&mut Shown> {
        let shown = match self.shown.take() {
            Some(shown) => shown,
            None => self.show()?,
        };
        Ok(self.shown.insert(shown))
    }

    fn show(&self) -> Result<Shown> {
        let skin = self.stages.touch.as_ref().map(|touch| &touch.skin);
        let draw = Draw::new(&self.context, &self.model, &self.skin_ranges(), skin)?;
        let mut recorder = Recorder::untimed(&self.context)?;
        draw.record(&mut recorder, &self.stages.elastic);
        Ok(Shown { draw, recording: recorder.finish()?, fields: None, meshes: Default::default() })
    }

    fn shown_fields(&mut self) -> Result<()> {
        if self.shown()?.fields.is_none() {
            let fields = self.show_fields()?;
            self.shown()?.fields = Some(fields);
        }
        Ok(())
    }

    fn show_fields(&self) -> Result<ShownFields> {
        let Some(Shown { draw, .. }) = &self.shown else { return Err(missing()) };
        let touch: Option<&Touch> = self.stages.touch.as_ref().map(|stages| &stages.contact.touch);
        let fields = Fields::new(&self.context, &self.model, &self.skin_ranges(), touch)?;
        let record = |field: Field| -> Result<Recording> {
            let mut recorder = Recorder::untimed(&self.context)?;
            fields.record(&mut recorder, field, draw, &self.stages.common, &self.stages.elastic, touch);
            recorder.finish()
        };
        let mut recorder = Recorder::untimed(&self.context)?;
        draw.record_frames(&mut recorder);
        fields.elements.record_all(&mut recorder, draw, &self.stages.elastic);
        let copied = |buffer: &Buffer| -> Result<Buffer> {
            let copy = Buffer::new(&self.context, buffer.name(), buffer.bytes(), Memory::Readback)?;
            recorder.copy(buffer, &copy);
            Ok(copy)
        };
        let [densities, stresses] = [&fields.elements.densities, &fields.elements.stresses].map(copied);
        let copies = [densities?, stresses?];
        let of_tetrahedra = (recorder.finish()?, copies);
        Ok(ShownFields { recordings: of_all(record)?, of_tetrahedra, fields })
    }

    /// For each body, and last for the tool, the range of its vertices among the skin vertices of all bodies; the range
    /// of a half-space, which has no skin, is empty.
    #[doc(hidden)]
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

    /// Triangles of the skin of body `body`, as indices of that skin's vertices; the index after that of the last body
    /// is the tool's.
    pub fn skin_triangles(&self, body: usize) -> &[[u32; 3]] {
        match self.bodies.iter().chain(&self.tool_body).nth(body).map(|body| &body.shape) {
            Some(Shape::Soft { skin, .. } | Shape::Rigid { skin, .. }) => &skin.triangles,
            _ => &[],
        }
    }

    /// Vertices of the tool's skin relative to the tool's centre of mass, tool axes, m; empty where the tool is one of
    /// the scene's bodies and so has no body of its own.
    #[doc(hidden)]
    pub fn tool_skin(&self) -> Vec<DVec3> {
        match self.tool_body.as_ref().map(|body| &body.shape) {
            Some(Shape::Rigid { skin, centroid, .. }) => skin.vertices.iter().map(|x| *x - *centroid).collect(),
            _ => Vec::new(),
        }
    }
}

/// The error that tells that arrays are missing which should have been made before.
fn missing() -> Error {
    Error::Simulation("internal error: the arrays to display were not made".into())
}
