//! What a frame is drawn with, in parts: it begins on the simulation's thread, between two steps, and goes on where there is time.

use std::fs::{self, File};
use std::io::BufWriter;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use palpate::internal::gpu::{Content, Recording, Window};
use palpate::{Context, Error, Result, Simulation};
use palpate_view::painter::Painter;
use palpate_view::picture::Picture;
use palpate_view::{Labels, Moment, Renderer, Settings};

use super::drawing::{Drawn, Order};

/// Samples a pixel.
const SAMPLES: u32 = 1;

/// Window, renderer, and what writes onto pictures.
pub struct Easel {
    painter: Painter,
    labels: Labels,
    window: Window,
    seen: Option<Seen>,
    /// How long each part of the frame before took.
    took: Vec<Duration>,
}

/// A simulation's renderer, and the simulation's number.
struct Seen {
    renderer: Renderer,
    generation: u64,
    size: [u32; 2],
}

/// A frame under way.
pub struct Frame {
    order: Order,
    labels: Option<Recording>,
    panel: Recording,
    parts: usize,
    took: Vec<Duration>,
    picture: Option<Picture>,
    drawn: Drawn,
}

impl Frame {
    /// Whether it is shown.
    pub fn is_done(&self) -> bool {
        self.took.len() == self.parts
    }
}

impl Easel {
    /// Nothing drawn yet.
    pub fn new(context: &Arc<Context>, window: Window) -> Result<Easel> {
        let (painter, labels) = (Painter::new(context)?, Labels::new(context)?);
        Ok(Easel { painter, labels, window, seen: None, took: Vec::new() })
    }

    /// Takes the image that is shown next; whether there is one.
    pub fn acquire(&mut self, width: u32, height: u32) -> Result<bool> {
        self.window.acquire(width, height)
    }

    /// Looks at a simulation between two steps; nothing is drawn yet.
    pub fn begin(&mut self, simulation: &mut Simulation, generation: u64, order: Order) -> Result<Frame> {
        if let Some(atlas) = &order.atlas {
            self.painter.set_atlas(atlas)?;
        }
        let before = self.seen.as_ref().map(|seen| seen.generation);
        let size = order.size;
        let mut seen = match self.seen.take().filter(|seen| seen.generation == generation) {
            Some(seen) => seen,
            None => {
                Seen { renderer: Renderer::new(simulation, Settings { size, samples: SAMPLES })?, generation, size }
            }
        };
        if seen.size != size {
            seen.renderer.resize(size)?;
            seen.size = size;
        }
        let Seen { renderer, .. } = self.seen.insert(seen);
        let mut moment = Moment::of(simulation, renderer.origin(), order.overlays)?;
        moment.device = order.device;
        renderer.look(&moment, &order.camera)?;
        let labels = self.labels.paint(&moment, renderer.legend(), renderer.image()?)?;
        let panel = self.painter.paint(&order.panel, renderer.image()?)?;
        let framed = (before != Some(generation)).then(|| renderer.camera());
        let drawn = Drawn { is_shown: true, framed, ..Drawn::default() };
        // The last writes onto the picture and shows it.
        let parts = renderer.slices().len() + 1;
        Ok(Frame { order, labels, panel, parts, took: Vec::new(), picture: None, drawn })
    }

    /// Draws parts that will be done by then, as far as the frame before tells.
    pub fn go_on(&mut self, frame: &mut Frame, until: Instant) -> Result<()> {
        while let Some(part) = self.took.get(frame.took.len()) {
            if frame.is_done() || Instant::now() + *part > until {
                break;
            }
            self.draw_next(frame)?;
        }
        Ok(())
    }

    /// Draws the next part.
    pub fn draw_next(&mut self, frame: &mut Frame) -> Result<()> {
        let begun = Instant::now();
        let Some(Seen { renderer, .. }) = &self.seen else { return Ok(()) };
        match renderer.slices().get(frame.took.len()) {
            Some(slice) => slice.submit_and_wait()?,
            None => {
                let labels: Vec<&Recording> = frame.labels.iter().collect();
                if frame.order.picture.is_some() {
                    Recording::submit_all(&labels)?;
                    frame.picture = Some(renderer.read()?);
                    frame.panel.submit_and_wait()?;
                } else {
                    Recording::submit_all(&labels.into_iter().chain([&frame.panel]).collect::<Vec<_>>())?;
                }
                self.window.present(Content::Picture(renderer.image()?))?;
            }
        }
        frame.took.push(begun.elapsed());
        Ok(())
    }

    /// Writes the picture that was asked for, where one was.
    pub fn end(&mut self, frame: Frame) -> Drawn {
        let Frame { order, took, picture, drawn, .. } = frame;
        self.took = took;
        let written = picture.zip(order.picture).map(|(picture, file)| write(&picture, &file).map(|()| file));
        Drawn { picture: written, ..drawn }
    }
}

/// All of the file, or nothing.
fn write(picture: &Picture, file: &Path) -> Result<()> {
    // Not an `Output`: the session may be writing one into the same folder.
    let partial = file.with_extension("png.partial");
    let written = File::create(&partial)
        .and_then(|out| picture.write_png(BufWriter::new(out)))
        .and_then(|()| fs::rename(&partial, file));
    written.map_err(|source| {
        // What cannot be removed stays: there is nobody left to tell.
        let _ = fs::remove_file(&partial);
        Error::Output { file: file.into(), source }
    })
}
