//! Draws a frame (rendered image) in parts: drawing begins on the simulation's thread, between two steps, and continues
//! on the drawing thread, part by part, in turns with the simulation's steps. The panel (texts and sliders) is drawn
//! over the image.

use std::fs::{self, File};
use std::io::BufWriter;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use palpate::internal::gpu::{Content, Recording, Window};
use palpate::{Context, Error, Result, Simulation};
use palpate_view::painter::Painter;
use palpate_view::picture::Picture;
use palpate_view::{Labels, Moment, Renderer, Settings, clock};

use super::drawing::{Drawn, Order};

/// Samples per pixel; 1 means no antialiasing.
const SAMPLES: u32 = 1;

/// The window, the renderer, and the painters that add legend and panel to the renderer's images.
pub struct Easel {
    painter: Painter,
    labels: Labels,
    window: Window,
    seen: Option<Seen>,
    /// Duration of each part of the previous frame.
    took: Vec<Duration>,
}

/// A simulation's renderer; `generation` is a number that changes when the simulation, or the GPU arrays that it uses,
/// are replaced.
struct Seen {
    renderer: Renderer,
    generation: u64,
    size: [u32; 2],
}

/// A frame that is being drawn.
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
    /// Whether all parts are drawn and the frame is therefore shown.
    pub fn is_done(&self) -> bool {
        self.took.len() == self.parts
    }
}

impl Easel {
    /// An easel that has drawn nothing yet.
    pub fn new(context: &Arc<Context>, window: Window) -> Result<Easel> {
        let (painter, labels) = (Painter::new(context)?, Labels::new(context)?);
        Ok(Easel { painter, labels, window, seen: None, took: Vec::new() })
    }

    /// Acquires the window's next image; returns whether there is one.
    pub fn acquire(&mut self, width: u32, height: u32) -> Result<bool> {
        self.window.acquire(width, height)
    }

    /// Captures the state of a simulation between two steps; nothing is drawn yet.
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
        moment.devices.clone_from(&order.devices);
        // In the window the panel shows the simulated time; an image file does not show the panel.
        moment.corner = order.picture.is_some().then(|| clock(simulation));
        renderer.look(&moment, &order.camera)?;
        let labels = self.labels.paint(&moment, renderer.legend(), renderer.image()?)?;
        let panel = self.painter.paint(&order.panel, renderer.image()?)?;
        let framed = (before != Some(generation)).then(|| renderer.camera());
        let drawn = Drawn { is_shown: true, framed, ..Drawn::default() };
        // Each of the renderer's slices, recorded commands that draw a piece of the image, is a part; the last part
        // paints legend and panel onto the image and shows it.
        let parts = renderer.slices().len() + 1;
        Ok(Frame { order, labels, panel, parts, took: Vec::new(), picture: None, drawn })
    }

    /// Draws the next parts, as long as they will end before `until` if each takes as long as in the previous frame.
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

    /// Ends the frame, and writes the image file if one was asked for.
    pub fn end(&mut self, frame: Frame) -> Drawn {
        let Frame { order, took, picture, drawn, .. } = frame;
        self.took = took;
        let written = picture.zip(order.picture).map(|(picture, file)| write(&picture, &file).map(|()| file));
        Drawn { picture: written, ..drawn }
    }
}

/// Writes an image file completely or not at all.
fn write(picture: &Picture, file: &Path) -> Result<()> {
    // `Output`, which collects files in a hidden folder, is not used here, because `palpate view --out` may already use
    // the same hidden folder.
    let partial = file.with_extension("png.partial");
    let written = File::create(&partial)
        .and_then(|out| picture.write_png(BufWriter::new(out)))
        .and_then(|()| fs::rename(&partial, file));
    written.map_err(|source| {
        // If the partial file cannot be removed, it stays; the error that is reported is that of writing.
        let _ = fs::remove_file(&partial);
        Error::Output { file: file.into(), source }
    })
}
