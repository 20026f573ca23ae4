//! Paints flat triangles over a rendered image, for the legend and for the panel (the controls in the window of
//! `palpate view`). The CPU writes the triangles' corners for each image, and the atlas (the texture with the letters)
//! whenever the atlas changes. A *point* is the user interface's unit of length: a pixel or more.

use std::sync::Arc;

use palpate::internal::gpu::{Before, Buffer, Canvas, Drawn, Image, Memory, Onto, RasterPipeline, Recorder, Recording};
use palpate::internal::shaders;
use palpate::{Context, Error, Result};

/// Number of 32-bit words of a triangle's corner: two for its position, two for its position in the atlas, one for its
/// colour.
pub const CORNER_WORDS: usize = 5;
/// The sizes of the arrays on the GPU are multiples of this, bytes.
const GROWTH: u64 = 1 << 18;

/// Triangles that are drawn with one clipping rectangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// Clipping rectangle: left, top, width, height, pixels.
    pub part: [u32; 4],
    /// Place of the triangles' first index in [`Flat::indices`], and number of the triangles' indices.
    pub range: (u32, u32),
}

/// Triangles to paint.
#[derive(Debug, Clone, Default)]
pub struct Flat {
    /// [`CORNER_WORDS`] words per corner: x and y in points from the upper left; x and y in the atlas from 0 to 1; red,
    /// green, blue and alpha, a byte each, sRGB and multiplied by alpha.
    pub corners: Vec<u32>,
    /// Indices of corners, three per triangle; index 0 is the first corner in `corners`.
    pub indices: Vec<u32>,
    /// The pieces, in the order in which they are painted.
    pub pieces: Vec<Piece>,
    /// Size of the image, points.
    pub points: [f32; 2],
}

/// The texture that triangles are filled with.
#[derive(Debug, Clone, Default)]
pub struct Atlas {
    /// Width and height, texels.
    pub size: [usize; 2],
    /// Red, green, blue and alpha, a byte each, sRGB and multiplied by alpha.
    pub texels: Vec<[u8; 4]>,
}

/// Paints triangles onto images with one sample per pixel.
pub struct Painter {
    context: Arc<Context>,
    pipeline: RasterPipeline,
    corners: Buffer,
    indices: Buffer,
    atlas: Buffer,
    size: [u32; 2],
}

impl Painter {
    /// A painter with an empty atlas.
    pub fn new(context: &Arc<Context>) -> Result<Painter> {
        let onto = Onto { has_colour: true, blends: true, samples: 1, ..Onto::default() };
        let array = |name| Buffer::new(context, name, GROWTH, Memory::Upload);
        Ok(Painter {
            pipeline: RasterPipeline::onto(context, "view/panel", &[], &onto)?,
            corners: array("corners")?,
            indices: array("triangles")?,
            atlas: array("texels")?,
            size: [1, 1],
            context: context.clone(),
        })
    }

    /// Replaces the atlas. The GPU must have finished the recording that [`Painter::paint`] returned last.
    pub fn set_atlas(&mut self, atlas: &Atlas) -> Result<()> {
        write(&self.context, &mut self.atlas, bytemuck::cast_slice(&atlas.texels))?;
        self.size = atlas.size.map(|side| side as u32);
        Ok(())
    }

    /// The recording of GPU commands that paint triangles onto an image. The GPU must have finished the recording that
    /// the call before this one returned.
    pub fn paint(&mut self, flat: &Flat, image: &Image) -> Result<Recording> {
        let corners = (flat.corners.len() / CORNER_WORDS) as u32;
        if flat.indices.iter().any(|index| *index >= corners) {
            return Err(Error::Simulation("internal error: a triangle of the panel has an index out of range".into()));
        }
        write(&self.context, &mut self.corners, bytemuck::cast_slice(&flat.corners))?;
        write(&self.context, &mut self.indices, bytemuck::cast_slice(&flat.indices))?;
        let (points, atlas) = (flat.points, self.size);
        let arguments = shaders::view::DrawPanel { points, atlas, corners: &self.corners, texels: &self.atlas };
        let drawn = |piece: &Piece| Drawn {
            pipeline: &self.pipeline,
            arguments: &arguments,
            indices: Some(&self.indices),
            range: piece.range,
            instances: 1,
            part: Some(piece.part),
        };
        let all: Vec<Drawn> = flat.pieces.iter().map(drawn).collect();
        let mut recorder = Recorder::untimed(&self.context)?;
        recorder.stage("panel");
        if !all.is_empty() {
            let canvas = Canvas { colour: Some(image.clone()), ..Canvas::default() };
            recorder.paint(&canvas, Before::Kept, &all);
        }
        recorder.finish()
    }
}

/// Writes bytes to the start of an array; an array that is too small is replaced by a larger one.
fn write(context: &Arc<Context>, array: &mut Buffer, bytes: &[u8]) -> Result<()> {
    if array.bytes() < bytes.len() as u64 {
        let room = (bytes.len() as u64).next_multiple_of(GROWTH);
        *array = Buffer::new(context, array.name(), room, Memory::Upload)?;
    }
    array.mapped_mut::<u8>()?[..bytes.len()].copy_from_slice(bytes);
    Ok(())
}
