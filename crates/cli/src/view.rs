//! `palpate view`: a window that shows a running scene, whose tools, rigid bodies, the user moves with the mouse or
//! haptic devices. The trace is `trace.csv`, a table with a row for each step.

mod app;
mod closing;
mod drawing;
mod dropped;
mod easel;
mod hand;
mod panel;

use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use clap::builder::{NonEmptyStringValueParser, PossibleValuesParser};
use palpate::internal::gpu::display_extensions;
use palpate::internal::haptics::{Device, session};
use palpate::scene::profile::PROFILES;
use palpate::scene::{DeviceKind, FurtherTool, Haptics, Key};
use palpate::{Error, Options, Result, Scene, Simulation, StepReport, Threads};
use palpate_devices::Mouse;
use palpate_devices::mouse::Goal;
use palpate_view::live::{Begin, Extent, Held, Lead, Live, Watch};
use winit::event_loop::EventLoop;

use crate::report::{Names, Output, Trace};
use crate::signals::Stop;
use crate::{hold, tell};
use app::App;

const TRACE: &str = "trace.csv";

/// What may move the tool, by name.
fn movers() -> impl Iterator<Item = &'static str> {
    ["mouse", "drive"].into_iter().chain(DeviceKind::CHOICES.map(|(name, _)| name))
}

/// Options of `palpate view`.
#[derive(clap::Args)]
pub struct Arguments {
    /// The scene, a TOML file
    scene: PathBuf,
    /// What moves the tool, of several the first: the mouse, a haptic device, or `drive`, which stands for the scene's
    /// keys (timed poses) of all tools [default: mouse; drive if the scene has no tool]
    #[arg(long, alias = "haptics", value_name = "DEVICE", value_parser = PossibleValuesParser::new(movers()))]
    device: Option<String>,
    /// Profile (limits of force and workspace) of the haptic device, instead of the scene's; a real device's can only
    /// be lowered
    #[arg(long, value_name = "NAME", value_parser = PossibleValuesParser::new(PROFILES.map(|profile| profile.name)))]
    profile: Option<String>,
    /// Vulkan device: its name, or its index in the list of `palpate devices`
    #[arg(long, value_name = "NAME-OR-INDEX", value_parser = NonEmptyStringValueParser::new())]
    gpu: Option<String>,
    /// Width and height of the window, pixels
    #[arg(long, value_name = "WxH", value_parser = crate::film::size)]
    size: Option<[u32; 2]>,
    /// Close after this number of steps; refused with a haptic device
    #[arg(long, value_name = "N", conflicts_with = "seconds", value_parser = crate::run::steps, allow_negative_numbers = true)]
    steps: Option<u64>,
    /// Close after this time, s
    #[arg(long, value_name = "S", value_parser = crate::run::positive, allow_negative_numbers = true)]
    seconds: Option<f64>,
    /// Directory to write trace.csv into, a table with a row for each step
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Check all Vulkan calls by the Khronos validation layer; any message of the layer is an error
    #[arg(long, hide = true)]
    validation: bool,
}

/// Opens the window and returns when it is closed. Input is read before the window opens; whatever closes the window,
/// the haptic device is released.
pub fn view(arguments: &Arguments) -> Result<()> {
    let mut scene = Scene::load(&arguments.scene)?;
    let name = arguments.device.as_deref().unwrap_or(if scene.tool.is_some() { "mouse" } else { "drive" });
    if let Some((_, kind)) = DeviceKind::CHOICES.iter().find(|(known, _)| *known == name) {
        scene.haptics.device = *kind;
    }
    scene.haptics.has_device = name != "drive";
    if scene.haptics.has_device && scene.tool.is_none() {
        let problem = "is missing, but a haptic device needs a tool to hold";
        return Err(Error::key(&scene.file, "tool", problem, "add a [tool], or give --device drive"));
    }
    if let Some(profile) = &arguments.profile {
        if !DeviceKind::CHOICES.iter().any(|(known, _)| *known == name) {
            let problem = format!("--profile {profile} applies to a haptic device, but the tool is moved by `{name}`");
            return Err(Error::Usage(format!("{problem}: give --device DEVICE as well, or leave it out")));
        }
        hold::choose_profile(&mut scene, profile)?;
    }
    let extent = extent_of(arguments, &scene)?;
    let events = EventLoop::with_user_event().build().map_err(|error| no_display(&arguments.scene, &error))?;
    let options = Options {
        device: arguments.gpu.clone(),
        threads: Some(Threads::Auto),
        validation: arguments.validation,
        display: display_extensions(&events.owned_display_handle())?,
        ..Options::of_program()
    };
    crate::watch("preparing the scene");
    let simulation = Simulation::open(&scene, &options)?;
    simulation.notes().iter().for_each(|note| tell(note));
    let context = simulation.context().clone();
    let stop = Stop::or_suspended()?;
    let mut output = arguments.out.as_deref().map(Output::create).transpose()?;
    let trace = Shared::new(output.as_mut(), &simulation)?;
    let goals = goals(&scene, name);
    let folder = arguments.out.clone().unwrap_or_default();
    let begin = Begin {
        lead: lead(name, &goals, &scene.haptics),
        extent,
        watch: trace.watch(),
        folder: folder.clone(),
        simulation,
    };
    let size = arguments.size.unwrap_or(crate::film::SIZE);
    let mut app = App::new(
        &events,
        Live::start(begin)?,
        context.clone(),
        app::Setup { size, goals, folder, ends: extent != Extent::Endless, stop: stop.flag(), scene },
    );
    let ran = events.run_app(&mut app).map_err(|error| Error::NoDevice(format!("the window failed: {error}")));
    let ended = app.end();
    trace.finish()?;
    ended.and(ran)?;
    if let Some(output) = output {
        output.commit()?;
    }
    match context.validation_messages() {
        messages if messages.is_empty() => Ok(()),
        messages => Err(Error::Simulation(format!("validation: {}", messages.join(" ")))),
    }
}

/// When the simulation ends. If the tool follows the scene's keys, a time is converted to a number of steps.
fn extent_of(arguments: &Arguments, scene: &Scene) -> Result<Extent> {
    match (arguments.steps, arguments.seconds) {
        (None, None) => Ok(Extent::Endless),
        (Some(_), _) if scene.haptics.has_device => {
            let problem = "--steps was given, but a session with a haptic device is limited by time";
            Err(Error::key(&scene.file, "haptics.device", problem, "give --seconds instead, or --device drive"))
        }
        (Some(steps), _) => Ok(Extent::Steps(steps)),
        (None, Some(seconds)) if scene.haptics.has_device => Ok(Extent::Seconds(seconds)),
        (None, Some(seconds)) => Ok(Extent::Steps((seconds / scene.step.dt).round().max(1.0) as u64)),
    }
}

fn no_display(scene: &Path, error: &winit::error::EventLoopError) -> Error {
    let (scene, error) = (scene.display(), error.to_string());
    // winit's error text begins with a file and line of winit's source, which are cut off.
    let error =
        error.rsplit(".rs:").next().map_or("", |end| end.trim_start_matches(|c: char| c.is_ascii_digit() || c == ':'));
    let error = error.trim().trim_end_matches('.');
    Error::NoDevice(format!(
        "there is no display to open a window on ({error}); without one make a film: palpate film {scene} --out film.apng"
    ))
}

/// For each tool the pose that the mouse moves, if the mouse holds the tool: the first one if `name` on the command line
/// is `mouse`, and each further one that has no keys and, unless `name` is `mouse`, no haptic device.
fn goals(scene: &Scene, name: &str) -> Vec<Option<Goal>> {
    let first = scene.tool.iter().map(|_| name == "mouse");
    let has_device = |tool: &FurtherTool| name != "mouse" && tool.haptics.is_some();
    let is_free = |tool: &FurtherTool| name != "drive" && !has_device(tool) && tool.trajectory.is_empty();
    first.chain(scene.further_tools.iter().map(is_free)).map(|is_held| is_held.then(Goal::default)).collect()
}

/// What moves the tools, by the name on the command line; `goals` are those of [`goals`], and `haptics` are the settings of
/// the first tool's device.
fn lead(name: &str, goals: &[Option<Goal>], haptics: &Haptics) -> Lead {
    if name == "drive" {
        return Lead::Script;
    }
    let (is_mouse, goals, haptics) = (name == "mouse", goals.to_vec(), haptics.clone());
    let make = move |simulation: &Simulation, starts: &[Key]| {
        // After a surface file is dropped onto the window, the new scene gets the haptic device that the user chose.
        let mut scene = Scene { haptics: haptics.clone(), ..simulation.scene().clone() };
        if is_mouse {
            // The mouse takes the place of their devices; tools with keys follow them all the same.
            let further = scene.further_tools.iter_mut().filter_map(|tool| tool.haptics.as_mut());
            further.for_each(|haptics| haptics.device = DeviceKind::Scripted);
        }
        let held = goals.iter().rposition(Option::is_some).map_or(0, |last| last + 1).max(scene.held_tools());
        let device = |(start, goal): (&Key, &Option<Goal>)| {
            let mouse = goal.as_ref().map(|goal| {
                goal.place(start.position, start.orientation);
                Box::new(Mouse::new(goal.clone())) as Box<dyn Device>
            });
            (*start, mouse)
        };
        let leaders = hold::leaders_with(
            simulation,
            &scene,
            simulation.time(),
            starts.iter().zip(&goals).take(held).map(device).collect(),
        )?;
        let named = |(leader, goal): (session::Leader, &Option<Goal>)| {
            let device = if goal.is_some() { "mouse" } else { leader.haptics.device.name() };
            Held { device: device.into(), leader }
        };
        Ok(leaders.into_iter().zip(&goals).map(named).collect())
    };
    Lead::Devices(Box::new(make))
}

/// The trace, written by the simulation's thread and finished by the window's thread.
struct Shared {
    trace: Arc<Mutex<Option<Trace<BufWriter<File>>>>>,
    file: PathBuf,
}

impl Shared {
    fn new(output: Option<&mut Output>, simulation: &Simulation) -> Result<Shared> {
        let (mut trace, mut file) = (None, PathBuf::new());
        if let Some(output) = output {
            file = output.path(TRACE);
            let made = Trace::new(output.file(TRACE)?, &Names::of(simulation));
            trace = Some(made.map_err(|source| Error::Output { file: file.clone(), source })?);
        }
        Ok(Shared { trace: Arc::new(Mutex::new(trace)), file })
    }

    /// The function that writes each step report into the trace.
    fn watch(&self) -> Watch {
        let (trace, file) = (self.trace.clone(), self.file.clone());
        Box::new(move |row: &StepReport| {
            let mut trace = trace.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
            match &mut *trace {
                Some(trace) => trace.write(row).map_err(|source| Error::Output { file: file.clone(), source }),
                None => Ok(()),
            }
        })
    }

    fn finish(&self) -> Result<()> {
        let trace = self.trace.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).take();
        let finished = trace.map_or(Ok(()), Trace::finish);
        finished.map_err(|source| Error::Output { file: self.file.clone(), source })
    }
}
