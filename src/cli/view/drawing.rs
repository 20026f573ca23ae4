//! The drawing thread: a frame at a time, each slice in its turn, so that the window's thread never waits for the device.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use glam::DVec3;
use palpate::gpu::{Content, Context, Recording, Window};
use palpate::step::Simulation;
use palpate::view::live::Link;
use palpate::view::overlay::Overlays;
use palpate::view::painter::{Atlas, Flat, Painter};
use palpate::view::picture::Picture;
use palpate::view::{Camera, Labels, Moment, Renderer, Settings};
use palpate::{Error, Result};

/// Where nothing can be shown, it is looked again after this.
const UNSEEN: Duration = Duration::from_millis(50);
/// Samples a pixel.
const SAMPLES: u32 = 1;

/// A frame to draw.
pub struct Order {
    /// Of the window, pixels.
    pub size: [u32; 2],
    pub camera: Camera,
    pub overlays: Overlays,
    /// Where the device is, m.
    pub device: Option<DVec3>,
    pub panel: Flat,
    /// Where it changed.
    pub atlas: Option<Atlas>,
    /// Where a picture of the scene goes.
    pub picture: Option<PathBuf>,
}

/// A frame that was drawn.
#[derive(Debug)]
pub struct Drawn {
    /// Whether it was shown, and not left out.
    pub is_shown: bool,
    /// s.
    pub took: f64,
    /// Slices.
    pub slices: usize,
    /// From where all of the simulation is seen, where it is another than in the frame before.
    pub framed: Option<Camera>,
    /// The picture that was written.
    pub picture: Option<PathBuf>,
}

/// The thread; dropped, it ends after the frame under way.
pub struct Drawing {
    orders: Option<Sender<Order>>,
    thread: Option<JoinHandle<()>>,
}

impl Drawing {
    /// Draws into a window; `tell` hears of each frame, or of the error that ended it.
    pub fn start(
        window: Window,
        context: Arc<Context>,
        link: Link,
        tell: impl Fn(Result<Drawn>) + Send + 'static,
    ) -> Result<Drawing> {
        let (orders, given) = channel();
        let mut artist =
            Artist { painter: Painter::new(&context)?, labels: Labels::new(&context)?, window, link, seen: None };
        let work = move || artist.work(&given, tell);
        let thread = std::thread::Builder::new().name("palpate-drawing".into()).spawn(work);
        let thread = thread.map_err(|error| Error::Simulation(format!("no thread for drawing: {error}")))?;
        Ok(Drawing { orders: Some(orders), thread: Some(thread) })
    }

    /// Orders a frame.
    pub fn order(&self, order: Order) {
        // A thread that ended said why.
        if let Some(orders) = &self.orders {
            drop(orders.send(order));
        }
    }
}

impl Drop for Drawing {
    fn drop(&mut self) {
        self.orders = None;
        self.thread.take().into_iter().for_each(|thread| drop(thread.join()));
    }
}

/// What draws, and what of.
struct Artist {
    painter: Painter,
    labels: Labels,
    window: Window,
    link: Link,
    seen: Option<Seen>,
}

/// A simulation's renderer, and the simulation's number.
struct Seen {
    renderer: Renderer,
    generation: u64,
    size: [u32; 2],
}

impl Artist {
    fn work(&mut self, orders: &Receiver<Order>, tell: impl Fn(Result<Drawn>)) {
        while let Ok(order) = orders.recv() {
            let drawn = self.draw(order);
            let is_over = drawn.is_err();
            tell(drawn);
            if is_over {
                return;
            }
        }
    }

    fn draw(&mut self, order: Order) -> Result<Drawn> {
        let (begun, [width, height]) = (Instant::now(), order.size);
        if let Some(atlas) = &order.atlas {
            self.painter.set_atlas(atlas)?;
        }
        let none = Drawn { is_shown: false, took: 0.0, slices: 0, framed: None, picture: None };
        let before = self.seen.as_ref().map(|seen| seen.generation);
        if !self.window.acquire(width, height)? {
            std::thread::sleep(UNSEEN);
            return Ok(none);
        }
        let Some(moment) = self.moment(&order)? else { return Ok(none) };
        let Some(seen) = &mut self.seen else { return Ok(none) };
        let turns = self.link.turns();
        let (renderer, generation) = (&mut seen.renderer, seen.generation);
        renderer.look(&moment, &order.camera)?;
        let labels = self.labels.paint(&moment, renderer.legend(), renderer.image()?)?;
        let panel = self.painter.paint(&order.panel, renderer.image()?)?;
        let Some((last, others)) = renderer.slices().split_last() else { return Ok(none) };
        for slice in others {
            let _turn = turns.slice();
            slice.submit_and_wait()?;
        }
        // What is short goes together: each slice lets a step pass.
        let scene: Vec<&Recording> = [last].into_iter().chain(&labels).collect();
        let picture = {
            let _turn = turns.slice();
            let picture = match &order.picture {
                Some(_) => {
                    Recording::submit_all(&scene)?;
                    let picture = renderer.read()?;
                    panel.submit_and_wait()?;
                    Some(picture)
                }
                None => {
                    Recording::submit_all(&scene.into_iter().chain([&panel]).collect::<Vec<_>>())?;
                    None
                }
            };
            self.window.present(Content::Picture(renderer.image()?))?;
            picture
        };
        if let (Some(picture), Some(file)) = (&picture, &order.picture) {
            write(picture, file)?;
        }
        let picture = order.picture.filter(|_| picture.is_some());
        // What fills the arrays is one more.
        let slices = renderer.slices().len() + 1;
        let framed = (before != Some(generation)).then(|| renderer.camera());
        Ok(Drawn { is_shown: true, took: begun.elapsed().as_secs_f64(), slices, framed, picture })
    }

    /// The simulation as it is between two steps, its skins in the arrays that are drawn; `None`: its thread has ended.
    fn moment(&mut self, order: &Order) -> Result<Option<Moment>> {
        let (seen, size, overlays) = (self.seen.take(), order.size, order.overlays);
        let answer =
            self.link.ask(move |simulation, generation| looked(simulation, generation, seen, (size, overlays)));
        let Some(answer) = answer else { return Ok(None) };
        let (seen, mut moment) = answer?;
        moment.device = order.device;
        self.seen = Some(seen);
        Ok(Some(moment))
    }
}

/// A renderer for this simulation and size, and the simulation as it is.
fn looked(
    simulation: &mut Simulation,
    generation: u64,
    seen: Option<Seen>,
    (size, overlays): ([u32; 2], Overlays),
) -> Result<(Seen, Moment)> {
    let mut seen = match seen.filter(|seen| seen.generation == generation) {
        Some(seen) => seen,
        None => Seen { renderer: Renderer::new(simulation, Settings { size, samples: SAMPLES })?, generation, size },
    };
    if seen.size != size {
        seen.renderer.resize(size)?;
        seen.size = size;
    }
    let origin: DVec3 = seen.renderer.origin();
    let moment = Moment::of(simulation, origin, overlays)?;
    Ok((seen, moment))
}

fn write(picture: &Picture, file: &std::path::Path) -> Result<()> {
    let failed = |source| Error::Output { file: file.into(), source };
    let out = std::fs::File::create(file).map_err(failed)?;
    picture.write_png(std::io::BufWriter::new(out)).map_err(failed)
}
