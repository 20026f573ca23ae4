//! Flat triangles over a picture: the panel's, whoever makes them. Corners and atlas are written by the host each time.

use std::sync::Arc;

use palpate::internal::gpu::{Before, Buffer, Canvas, Drawn, Image, Memory, Onto, RasterPipeline, Recorder, Recording};
use palpate::internal::shaders;
use palpate::{Context, Error, Result};

/// Words of a corner: place (2), place in the atlas (2), colour.
pub const CORNER_WORDS: usize = 5;
/// Arrays grow to the next multiple, bytes.
const GROWTH: u64 = 1 << 18;

/// Triangles that are drawn at once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// The part of the picture that they may cover: left, top, width, height, pixels.
    pub part: [u32; 4],
    /// The first of the indices, and how many.
    pub range: (u32, u32),
}

/// What is painted.
#[derive(Debug, Clone, Default)]
pub struct Flat {
    /// [`CORNER_WORDS`] a corner: x and y in points from the upper left; x and y in the atlas from 0 to 1; red, green, blue
    /// and alpha, a byte each, as shown and multiplied by alpha.
    pub corners: Vec<u32>,
    /// Three corners a triangle.
    pub indices: Vec<u32>,
    /// In order.
    pub pieces: Vec<Piece>,
    /// Size of the picture, points.
    pub points: [f32; 2],
}

/// Texels that triangles are filled with.
#[derive(Debug, Clone, Default)]
pub struct Atlas {
    /// Width and height.
    pub size: [usize; 2],
    /// Red, green, blue and alpha, a byte each, as shown and multiplied by alpha.
    pub texels: Vec<[u8; 4]>,
}

/// Paints onto pictures with one sample a pixel.
pub struct Painter {
    context: Arc<Context>,
    pipeline: RasterPipeline,
    corners: Buffer,
    indices: Buffer,
    atlas: Buffer,
    size: [u32; 2],
}

impl Painter {
    /// With an empty atlas.
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

    /// Takes another atlas; the last recording is done.
    pub fn set_atlas(&mut self, atlas: &Atlas) -> Result<()> {
        write(&self.context, &mut self.atlas, bytemuck::cast_slice(&atlas.texels))?;
        self.size = atlas.size.map(|side| side as u32);
        Ok(())
    }

    /// What paints this onto an image; the last recording is done.
    pub fn paint(&mut self, flat: &Flat, image: &Image) -> Result<Recording> {
        let corners = (flat.corners.len() / CORNER_WORDS) as u32;
        if flat.indices.iter().any(|index| *index >= corners) {
            return Err(Error::Simulation("a triangle of the panel has a corner that is none".into()));
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

/// Writes bytes to the start of an array, a larger one where they need it.
fn write(context: &Arc<Context>, array: &mut Buffer, bytes: &[u8]) -> Result<()> {
    if array.bytes() < bytes.len() as u64 {
        let room = (bytes.len() as u64).next_multiple_of(GROWTH);
        *array = Buffer::new(context, array.name(), room, Memory::Upload)?;
    }
    array.mapped_mut::<u8>()?[..bytes.len()].copy_from_slice(bytes);
    Ok(())
}
