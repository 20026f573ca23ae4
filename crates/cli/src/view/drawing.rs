//! The drawing thread: it draws one frame (rendered image) after the other, so that the window's thread never waits for
//! the GPU. A frame is drawn in *slices*, short periods that take turns at the GPU's queue with the simulation's steps;
//! in each slice one or more parts of the frame are drawn.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use glam::DVec3;
use palpate::internal::gpu::Window;
use palpate::{Context, Error, Result};
use palpate_view::Camera;
use palpate_view::live::Link;
use palpate_view::overlay::Overlays;
use palpate_view::painter::{Atlas, Flat};

use super::easel::Easel;

/// Pause before the next attempt if the window cannot show anything.
const UNSEEN: Duration = Duration::from_millis(50);

/// A frame to draw.
pub struct Order {
    /// Size of the window, pixels.
    pub size: [u32; 2],
    pub camera: Camera,
    pub overlays: Overlays,
    /// Positions of the haptic devices of the first tools, m.
    pub devices: Vec<DVec3>,
    pub panel: Flat,
    /// The atlas (the texture with the letters), if it changed.
    pub atlas: Option<Atlas>,
    /// File to write an image of the scene into, if an image is asked for.
    pub picture: Option<PathBuf>,
}

/// A frame that was drawn.
#[derive(Debug, Default)]
pub struct Drawn {
    /// Whether the frame was shown; if the window can show none, nothing is drawn.
    pub is_shown: bool,
    /// Time that drawing the frame took, s.
    pub took: f64,
    /// Number of slices.
    pub slices: usize,
    /// A camera that shows all bodies; given if this frame is the first of a simulation.
    pub framed: Option<Camera>,
    /// The image file that was written, or the error in writing it; `None` if no image was asked for.
    pub picture: Option<Result<PathBuf>>,
}

/// Handle of the drawing thread; when the handle is dropped, the thread ends after the current frame.
pub struct Drawing {
    orders: Option<Sender<Order>>,
    thread: Option<JoinHandle<()>>,
}

impl Drawing {
    /// Starts the thread, which draws into a window; the thread calls `tell` for each frame that it drew, and with the
    /// error that ends it.
    pub fn start(
        window: Window,
        context: Arc<Context>,
        link: Link,
        tell: impl Fn(Result<Drawn>) + Send + 'static,
    ) -> Result<Drawing> {
        let (orders, given) = channel();
        let mut artist = Artist { easel: Some(Easel::new(&context, window)?), link };
        let work = move || artist.work(&given, tell);
        let thread = std::thread::Builder::new().name("palpate-drawing".into()).spawn(work);
        let thread =
            thread.map_err(|error| Error::Simulation(format!("the drawing thread cannot be started: {error}")))?;
        Ok(Drawing { orders: Some(orders), thread: Some(thread) })
    }

    /// Orders a frame.
    pub fn order(&self, order: Order) {
        // If the thread has ended, it has reported the reason, and the order is dropped.
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

/// State of the drawing thread.
struct Artist {
    /// The renderer and the window, which move to the simulation's thread and back for each frame; `None` if the
    /// simulation's thread has ended.
    easel: Option<Easel>,
    link: Link,
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
        let Some(mut easel) = self.easel.take() else { return Ok(Drawn::default()) };
        if !easel.acquire(width, height)? {
            self.easel = Some(easel);
            std::thread::sleep(UNSEEN);
            return Ok(Drawn::default());
        }
        let turns = self.link.turns().clone();
        let most = Duration::from_secs_f64(turns.slice_length());
        // The simulation's thread captures the scene between two steps, and at once draws as many parts of the frame as
        // fit into a slice.
        let answer = self.link.ask(move |simulation, generation| {
            let looked = Instant::now();
            let frame = easel.begin(simulation, generation, order);
            let frame = frame.and_then(|mut frame| easel.go_on(&mut frame, looked + most).map(|()| frame));
            (easel, frame)
        });
        let Some((mut easel, frame)) = answer else { return Ok(Drawn::default()) };
        let mut frame = frame?;
        let mut slices = 1;
        while !frame.is_done() {
            let _turn = turns.slice();
            let until = Instant::now() + most;
            easel.draw_next(&mut frame)?;
            easel.go_on(&mut frame, until)?;
            slices += 1;
        }
        let drawn = easel.end(frame);
        self.easel = Some(easel);
        Ok(Drawn { slices, took: begun.elapsed().as_secs_f64(), ..drawn })
    }
}
