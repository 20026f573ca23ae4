//! The window's thread: it handles events, lays out the panel (texts and sliders at the right), and orders frames
//! (rendered images) from the drawing thread. It waits for neither the simulation nor the GPU.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use palpate::internal::gpu::Window;
use palpate::internal::prepare::bodies::Bodies;
use palpate::{Context, Error, Result, Scene};
use palpate_devices::mouse::Goal;
use palpate_view::live::{Command, Live, State};
use palpate_view::overlay::Overlay;
use palpate_view::painter::Atlas;
use palpate_view::{Camera, tessellated};
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::{ElementState, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop, EventLoopProxy};
use winit::keyboard::{KeyCode, PhysicalKey};
use winit::window::WindowId;

use super::closing::Frames;
use super::drawing::{Drawing, Drawn, Order};
use super::hand::Hand;
use super::panel::{Panel, WIDTH};
use crate::report::haptics::Closing;
use crate::{print, tell};

/// Least time from one frame to the next.
const FRAME: Duration = Duration::from_millis(15);

/// Messages from other threads to the window's thread.
#[derive(Debug)]
pub enum Said {
    /// A frame was drawn, or drawing has failed.
    Frame(Result<Drawn>),
    /// Progress in preparing a surface file that was dropped onto the window.
    Progress(String),
    /// A file that was dropped onto the window is prepared, or cannot be used.
    Ready(Result<Box<(Scene, Bodies)>>),
}

/// Settings of the window.
pub struct Setup {
    pub size: [u32; 2],
    /// For each tool (a rigid body that the user moves) its goal pose, if the mouse sets it.
    pub goals: Vec<Option<Goal>>,
    /// Folder for image files.
    pub folder: PathBuf,
    /// Whether the window closes by itself after a number of steps or seconds.
    pub ends: bool,
    /// Flag that is set when a signal asks the program to end.
    pub stop: Arc<AtomicBool>,
    pub scene: Scene,
}

/// State of the window.
pub struct App {
    setup: Setup,
    live: Live,
    context: Arc<Context>,
    said: EventLoopProxy<Said>,
    window: Option<Arc<winit::window::Window>>,
    drawing: Option<Drawing>,
    egui: egui::Context,
    input: Option<egui_winit::State>,
    panel: Panel,
    frames: Frames,
    hand: Hand,
    /// Names of the tools, as the simulation's thread has told them.
    tools: Vec<String>,
    /// Index of the tool that the mouse moves and whose force is plotted.
    chosen: usize,
    camera: Camera,
    atlas: Atlas,
    /// Whether the atlas (the texture with the letters) has changed since the last frame that was shown.
    is_atlas_new: bool,
    is_drawing: bool,
    /// Whether the camera is to be moved, so that it shows all of a new scene, as soon as that scene is first drawn.
    reframes: bool,
    due: Instant,
    picture: Option<PathBuf>,
    error: Option<Error>,
}

impl App {
    pub fn new(events: &EventLoop<Said>, live: Live, context: Arc<Context>, setup: Setup) -> App {
        let camera = framed(&live);
        App {
            setup,
            live,
            context,
            said: events.create_proxy(),
            window: None,
            drawing: None,
            egui: egui::Context::default(),
            input: None,
            panel: Panel::new(),
            frames: Frames::default(),
            hand: Hand::default(),
            tools: Vec::new(),
            chosen: 0,
            camera,
            atlas: Atlas::default(),
            is_atlas_new: false,
            is_drawing: false,
            reframes: false,
            due: Instant::now(),
            picture: None,
            error: None,
        }
    }

    /// Ends drawing, then the simulation; returns the first error.
    pub fn end(&mut self) -> Result<()> {
        self.drawing = None;
        self.input = None;
        self.window = None;
        let delays = self.live.link().turns().all_delays();
        if !self.live.quit() {
            return Err(Error::Simulation("the simulation's thread panicked; the haptic device was released".into()));
        }
        let notes: Vec<String> = self.live.notes().collect();
        notes.iter().for_each(|note| tell(note));
        if let State::Failed(why) = &self.live.snapshot().state {
            self.error.get_or_insert(Error::Simulation(why.clone()));
        }
        self.error.take().map_or(Ok(()), Err)?;
        print(&self.frames.summary(&delays))?;
        // Each pause ends a session (run of the haptic loops with devices), so there may be several; only the reports of
        // the last session are printed.
        let reports = self.live.sessions().last().unwrap_or_default();
        reports.iter().try_for_each(|report| print(&Closing(report).to_string()))
    }

    fn open(&mut self, events: &ActiveEventLoop) -> Result<()> {
        let [width, height] = self.setup.size;
        let title = format!("palpate: {}", self.setup.scene.name());
        let attributes = winit::window::Window::default_attributes()
            .with_title(title)
            .with_inner_size(PhysicalSize::new(width, height));
        let window = events.create_window(attributes);
        let window = Arc::new(window.map_err(|error| Error::NoDevice(format!("cannot open the window: {error}")))?);
        let shown = Window::new(&self.context, window.clone())?;
        let said = self.said.clone();
        // If the event loop has ended, sending fails, which is ignored.
        let tell = move |drawn| drop(said.send_event(Said::Frame(drawn)));
        self.drawing = Some(Drawing::start(shown, self.context.clone(), self.live.link().clone(), tell)?);
        let (scale, theme) = (Some(window.scale_factor() as f32), window.theme());
        let input = egui_winit::State::new(self.egui.clone(), egui::ViewportId::ROOT, &window, scale, theme, None);
        (self.input, self.window) = (Some(input), Some(window));
        Ok(())
    }

    fn size(&self) -> [u32; 2] {
        self.window.as_ref().map_or([0, 0], |window| window.inner_size().into())
    }

    /// Lays out the panel and orders a frame with it.
    fn order(&mut self) {
        let size = self.size();
        if size.contains(&0) {
            return;
        }
        let notes: Vec<String> = self.live.notes().collect();
        notes.into_iter().for_each(|note| self.panel.say(note));
        self.panel.take(self.live.samples());
        let delays = self.live.link().turns().delays();
        let snapshot = self.live.snapshot().clone();
        if self.tools != snapshot.settings.tools {
            self.choose(0);
            self.tools.clone_from(&snapshot.settings.tools);
        }
        let (Some(window), Some(input), Some(drawing)) = (&self.window, &mut self.input, &self.drawing) else { return };
        let mut command = None;
        let output = self.egui.run_ui(input.take_egui_input(window), |ui| {
            let tool = self.tools.get(self.chosen).filter(|_| self.tools.len() > 1).map(String::as_str);
            command = self.panel.show(ui, &snapshot, (self.chosen, tool), &delays).or(command.take());
        });
        input.handle_platform_output(window, output.platform_output);
        let device = |tool: usize| {
            let goal = self.setup.goals.get(tool).and_then(Option::as_ref).map(|goal| goal.pose().0);
            goal.or(snapshot.row.as_ref().and_then(|row| row.tools().nth(tool)).map(|tool| tool.device.position))
        };
        self.is_atlas_new |= tessellated::update(&mut self.atlas, &output.textures_delta);
        let mut delta = output.textures_delta;
        delta.clear();
        let primitives = self.egui.tessellate(output.shapes, output.pixels_per_point);
        drawing.order(Order {
            size,
            camera: self.camera,
            overlays: self.panel.overlays,
            devices: (0..).map_while(device).collect(),
            panel: tessellated::flat(&primitives, output.pixels_per_point, size),
            atlas: self.is_atlas_new.then(|| self.atlas.clone()),
            picture: self.picture.clone(),
        });
        self.is_drawing = true;
        command.into_iter().for_each(|command| self.live.link().tell(command));
    }

    fn drawn(&mut self, drawn: Drawn) {
        self.is_drawing = false;
        if drawn.is_shown {
            // A frame that is not shown does not upload the atlas.
            self.is_atlas_new = false;
            self.panel.shown(drawn.took, drawn.slices);
            self.frames.add(drawn.took, drawn.slices, drawn.framed.is_some());
        }
        if drawn.framed.is_some() {
            self.live.link().turns().forget();
        }
        if let Some(camera) = drawn.framed.filter(|_| self.reframes) {
            (self.camera, self.reframes) = (camera, false);
        }
        if drawn.picture.is_some() {
            self.picture = None;
        }
        match drawn.picture {
            Some(Ok(file)) => {
                let line = format!("image: {}", file.display());
                // A closed standard output is ignored.
                let _ = print(&format!("{line}\n"));
                self.panel.say(line);
            }
            Some(Err(error)) => self.panel.say(error.to_string()),
            None => {}
        }
    }

    /// The goal of the chosen tool, if the mouse moves it.
    fn goal(&self) -> Option<&Goal> {
        self.setup.goals.get(self.chosen).and_then(Option::as_ref)
    }

    /// Chooses a tool, if it is not the chosen one.
    fn choose(&mut self, tool: usize) {
        if tool != self.chosen {
            self.goal().into_iter().for_each(|goal| goal.press(false));
            self.hand.let_go();
            self.chosen = tool;
        }
    }

    fn key(&mut self, code: KeyCode, events: &ActiveEventLoop) {
        let link = self.live.link();
        match code {
            KeyCode::Tab => self.choose((self.chosen + 1) % self.tools.len().max(1)),
            KeyCode::Escape => events.exit(),
            KeyCode::Space => link.tell(Command::Pause),
            KeyCode::Period => link.tell(Command::Step),
            KeyCode::KeyR => link.tell(Command::Reset),
            KeyCode::KeyT => link.tell(Command::Record),
            KeyCode::KeyS => {
                let (folder, name) = (&self.setup.folder, self.setup.scene.name());
                let files = (1_u32..).map(|k| folder.join(format!("{name}-{k}.png")));
                self.picture = files.into_iter().find(|file| !file.exists());
            }
            KeyCode::KeyH | KeyCode::F1 => self.panel.shows_help = !self.panel.shows_help,
            other => {
                let keys = [
                    KeyCode::Digit1,
                    KeyCode::Digit2,
                    KeyCode::Digit3,
                    KeyCode::Digit4,
                    KeyCode::Digit5,
                    KeyCode::Digit6,
                    KeyCode::Digit7,
                    KeyCode::Digit8,
                    KeyCode::Digit9,
                    KeyCode::Digit0,
                    KeyCode::KeyV,
                    KeyCode::KeyP,
                ];
                let overlay = keys.iter().position(|key| *key == other).map(|k| Overlay::ALL[k].0);
                overlay.into_iter().for_each(|overlay| self.panel.overlays.toggle(overlay));
            }
        }
    }

    fn fail(&mut self, error: Error, events: &ActiveEventLoop) {
        self.error.get_or_insert(error);
        events.exit();
    }

    fn ready(&mut self, made: Result<Box<(Scene, Bodies)>>) {
        self.panel.progress = None;
        match made {
            Ok(made) => {
                let (scene, bodies) = *made;
                self.setup.scene = scene.clone();
                self.live.link().tell(Command::Replace(Box::new((scene, bodies))));
                self.reframes = true;
            }
            Err(error) => self.panel.say(error.to_string()),
        }
    }
}

/// A camera that shows the whole scene.
fn framed(live: &Live) -> Camera {
    let corners = live.link().ask(|simulation, _| {
        let bodies = 0..=simulation.bodies().len();
        let points = bodies.filter_map(|body| simulation.vertex_positions(body).ok()).flatten();
        let none = (glam::DVec3::INFINITY, glam::DVec3::NEG_INFINITY);
        points.fold(none, |(low, high), point| (low.min(point), high.max(point)))
    });
    let (low, high) = corners.unwrap_or_default();
    Camera::around(low, high)
}

/// Whether an event is of the key that chooses the next tool, with which the panel would go from slider to slider.
fn is_tab(event: &WindowEvent) -> bool {
    matches!(event, WindowEvent::KeyboardInput { event, .. } if event.physical_key == PhysicalKey::Code(KeyCode::Tab))
}

impl ApplicationHandler<Said> for App {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.window.is_none()
            && let Err(error) = self.open(events)
        {
            self.fail(error, events);
        }
    }

    fn user_event(&mut self, events: &ActiveEventLoop, said: Said) {
        match said {
            Said::Frame(Ok(drawn)) => self.drawn(drawn),
            Said::Frame(Err(error)) => self.fail(error, events),
            Said::Progress(line) => self.panel.progress = Some(line),
            Said::Ready(made) => self.ready(made),
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let (Some(window), Some(input)) = (&self.window, &mut self.input) else { return };
        if !(self.tools.len() > 1 && is_tab(&event)) {
            // The response is not needed: the panel is laid out anew for the next frame.
            let _ = input.on_window_event(window, &event);
        }
        if matches!(event, WindowEvent::KeyboardInput { .. }) && self.egui.egui_wants_keyboard_input() {
            // The key belongs to a number that the user types into the panel.
            return;
        }
        let edge = f64::from(window.inner_size().width) - f64::from(WIDTH) * window.scale_factor();
        let size = self.size();
        // Further tools are bodies, of no known radius.
        let first = self.setup.scene.tool.as_ref().filter(|_| self.chosen == 0);
        let radius = first.and_then(|tool| tool.shape.radius());
        let goal = self.setup.goals.get(self.chosen).and_then(Option::as_ref);
        self.hand.hear(&event, edge, &mut self.camera, goal, radius, size);
        match event {
            WindowEvent::CloseRequested => events.exit(),
            WindowEvent::DroppedFile(file) => {
                self.panel.progress = Some(format!("preparing {}", file.display()));
                super::dropped::prepare(file, self.said.clone());
            }
            WindowEvent::KeyboardInput { event, is_synthetic, .. }
                if event.state == ElementState::Pressed && !event.repeat && !is_synthetic =>
            {
                if let PhysicalKey::Code(code) = event.physical_key {
                    self.key(code, events);
                }
            }
            _ => {}
        }
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        let state = &self.live.snapshot().state;
        let is_over = *state == State::Ended || (self.setup.ends && matches!(state, State::Failed(_)));
        if self.setup.stop.load(Ordering::Relaxed) || is_over {
            events.exit();
            return;
        }
        if !self.live.is_running() {
            return self.fail(Error::Simulation("the simulation's thread has ended unexpectedly".into()), events);
        }
        let now = Instant::now();
        if !self.is_drawing && now >= self.due {
            self.due = now + FRAME;
            self.order();
        }
        events.set_control_flow(ControlFlow::WaitUntil(self.due.max(now + Duration::from_millis(5))));
    }
}
