//! `palpate film`: renders a scene from the first step to the last as a film, or as images in a folder; no display is
//! needed. An *overlay* is what an image shows besides the skins (the bodies' surface meshes). The *tool* is the rigid
//! body that the haptic device leads; in a film, timed poses of the scene stand in for the device.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Parser;
use clap::builder::NonEmptyStringValueParser;
use indicatif::{ProgressBar, ProgressFinish};
use palpate::{Error, Options, Result, Scene, Simulation, Threads};
use palpate_view::picture::Picture;
use palpate_view::{Overlay, Overlays, Settings, Studio};

use crate::report::Output;
use crate::run::positive;
use crate::{one_line, print, tell};

/// Default width and height of images, pixels.
pub const SIZE: [u32; 2] = [1280, 720];
/// Greatest accepted width and height of an image, pixels; common GPUs draw no larger images.
const LARGEST: u32 = 16_384;
/// Greatest number of images in a film.
const MOST_PICTURES: f64 = 1e5;
/// Endings of the names of videos and of other animated images, which are refused.
const VIDEOS: [&str; 6] = ["mp4", "gif", "webm", "avi", "mov", "mkv"];
/// Overlays that `--show` accepts, by name.
const CHOICES: [(&str, Overlay); 12] = [
    ("pressure", Overlay::Pressure),
    ("depth", Overlay::Depth),
    ("force", Overlay::Arrows),
    ("proxies", Overlay::Proxies),
    ("regions", Overlay::ContactPatches),
    ("layer", Overlay::Layer),
    ("cores", Overlay::Cores),
    ("energy", Overlay::Energy),
    ("displacement", Overlay::Displacement),
    ("materials", Overlay::Materials),
    ("von-mises", Overlay::VonMises),
    ("hydrostatic", Overlay::Hydrostatic),
];

/// Options of `palpate film`.
#[derive(clap::Args)]
pub struct Arguments {
    /// The scene, a TOML file; its tool follows the keys (timed poses) of the file's table [drive]
    scene: PathBuf,
    /// FILE.apng or FILE.png for an animated PNG, which browsers show; any other name is a directory for one image file
    /// per frame
    #[arg(long, value_name = "FILE-OR-DIR")]
    out: PathBuf,
    /// Frames per second
    #[arg(long, value_name = "N", default_value_t = 25, value_parser = clap::value_parser!(u16).range(1..=1000), allow_negative_numbers = true)]
    fps: u16,
    /// Simulated seconds per second of film: 1 is real time, 0.1 is slow motion
    #[arg(long, value_name = "X", default_value_t = 1.0, value_parser = positive, allow_negative_numbers = true)]
    speed: f64,
    /// Time to simulate, s [default: up to the last key of [drive]; one second if there are no keys]
    #[arg(long, value_name = "S", value_parser = positive, allow_negative_numbers = true)]
    seconds: Option<f64>,
    /// Vulkan device: its name, or its index in the list of `palpate devices`
    #[arg(long, value_name = "NAME-OR-INDEX", value_parser = NonEmptyStringValueParser::new())]
    device: Option<String>,
    #[command(flatten)]
    look: Look,
}

/// Options on how images look.
#[derive(Debug, Clone, PartialEq, clap::Args)]
pub struct Look {
    #[arg(long, value_name = "WxH", value_parser = size, help = "Image width and height, pixels [default: 1280x720]")]
    size: Option<[u32; 2]>,
    /// Camera: yaw (to the right of the front) and pitch (above the horizon) in degrees, and a zoom factor (1 shows all
    /// bodies)
    #[arg(long, value_name = "YAW,PITCH[,NEARER]", value_parser = view, allow_hyphen_values = true)]
    camera: Option<View>,
    /// Point that the camera looks at, m [default: the middle of all bodies]
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    at: Option<glam::DVec3>,
    /// What to show besides the skins (surface meshes): one of pressure, depth, energy, displacement, von-mises,
    /// hydrostatic, materials (as colours; materials on the tetrahedra, cut open); and force (arrows), proxies (convex
    /// collision hulls), regions (contact patches), layer (tetrahedra, cut open), cores (rigid cores of soft bodies)
    #[arg(long, value_name = "NAME,..", value_delimiter = ',', value_parser = overlay)]
    show: Vec<Overlay>,
    /// Leave out the simulated time in the images' upper left corner
    #[arg(long)]
    no_time: bool,
}

/// A command line that has the options of [`Look`] alone.
#[derive(clap::Parser)]
struct Picturing {
    #[command(flatten)]
    look: Look,
}

/// Camera of an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Angle to the right of the front, degrees.
    pub yaw: f64,
    /// Angle above the horizon, degrees.
    pub pitch: f64,
    /// Zoom factor: at 1 the camera is so far away that it shows all bodies; the camera's distance is divided by the
    /// factor.
    pub nearer: f64,
}

/// Parses a width and a height, as in `1280x720`.
pub fn size(text: &str) -> std::result::Result<[u32; 2], String> {
    let side = |text: &str| text.parse().ok().filter(|side| (1..=LARGEST).contains(side));
    let sides = text.split_once('x').and_then(|(width, height)| Some([side(width)?, side(height)?]));
    sides.ok_or_else(|| format!("give width and height from 1 to {LARGEST}, such as 1280x720"))
}

fn numbers(text: &str) -> Option<Vec<f64>> {
    text.split(',').map(|part| part.trim().parse().ok().filter(|x: &f64| x.is_finite())).collect()
}

fn view(text: &str) -> std::result::Result<View, String> {
    match numbers(text).as_deref() {
        Some([yaw, pitch]) => Ok(View { yaw: *yaw, pitch: *pitch, nearer: 1.0 }),
        Some([yaw, pitch, nearer]) if *nearer > 0.0 => Ok(View { yaw: *yaw, pitch: *pitch, nearer: *nearer }),
        _ => Err("give two angles in degrees, and a zoom factor if wanted, such as 30,15,2".into()),
    }
}

fn point(text: &str) -> std::result::Result<glam::DVec3, String> {
    match numbers(text).as_deref() {
        Some([x, y, z]) => Ok(glam::DVec3::new(*x, *y, *z)),
        _ => Err("give three numbers in metres, such as 0,0.1,0.05".into()),
    }
}

fn overlay(text: &str) -> std::result::Result<Overlay, String> {
    let known = CHOICES.iter().find(|(name, _)| *name == text);
    let names = CHOICES.map(|(name, _)| name);
    known.map(|(_, overlay)| *overlay).ok_or_else(|| format!("give some of {}", names.join(", ")))
}

impl Look {
    /// Reads such options from the words of a command line.
    pub fn parse(words: &[String]) -> Result<Look> {
        let program = std::iter::once("picture").chain(words.iter().map(String::as_str));
        Picturing::try_parse_from(program)
            .map(|picturing| picturing.look)
            .map_err(|error| Error::Usage(one_line(&error)))
    }

    /// The overlays to show. Errors: several overlays that are drawn as colours, of which only one can be shown.
    pub fn shown(&self) -> Result<Overlays> {
        let shown = Overlays::of(&self.show);
        match CHOICES.iter().find(|(_, overlay)| self.show.contains(overlay) && !shown.has(*overlay)) {
            None => Ok(shown),
            Some((name, _)) => Err(Error::Usage(format!(
                "--show {name}: show only one of pressure, depth, energy, displacement, von-mises, hydrostatic and materials"
            ))),
        }
    }

    fn size(&self) -> [u32; 2] {
        self.size.unwrap_or(SIZE)
    }

    /// Whether any of these options was given.
    pub fn is_asked_for(&self) -> bool {
        self.size.is_some() || self.camera.is_some() || self.at.is_some() || !self.show.is_empty() || self.no_time
    }

    /// A studio (renderer without a window) that makes images of a simulation with these options.
    pub fn studio(&self, simulation: &mut Simulation) -> Result<Studio> {
        let shown = self.shown()?;
        let mut studio = Studio::new(simulation, Settings { size: self.size(), samples: SAMPLES })?;
        studio.shown = shown;
        studio.shows_time = !self.no_time;
        if let Some(view) = self.camera {
            view.aim(&mut studio);
        }
        studio.camera.target = self.at.unwrap_or(studio.camera.target);
        Ok(studio)
    }
}

/// Samples per pixel, for antialiasing.
pub const SAMPLES: u32 = 4;

impl View {
    /// Sets a studio's camera to this view.
    pub fn aim(&self, studio: &mut Studio) {
        let camera = &mut studio.camera;
        (camera.yaw, camera.pitch) = (self.yaw.to_radians(), self.pitch.clamp(-89.0, 89.0).to_radians());
        camera.distance /= self.nearer;
    }
}

/// Renders the film or the folder of images.
pub fn film(arguments: &Arguments) -> Result<()> {
    arguments.look.shown()?;
    refuse_video(arguments)?;
    let scene = Scene::load(&arguments.scene)?;
    let duration = arguments.seconds.unwrap_or(scene.duration());
    let apart = arguments.speed / f64::from(arguments.fps);
    let pictures = (duration / apart + 1e-9).floor() + 1.0;
    if pictures > MOST_PICTURES {
        let problem = format!("{pictures} images for {duration:?} s are too many, {MOST_PICTURES} at most");
        return Err(Error::Usage(format!("{problem}: give a lower --fps, a higher --speed or fewer --seconds")));
    }
    let options = Options { device: arguments.device.clone(), threads: Some(Threads::Auto), ..Options::of_program() };
    let mut simulation = Simulation::open(&scene, &options)?;
    simulation.notes().iter().for_each(|note| tell(note));
    let mut studio = arguments.look.studio(&mut simulation)?;
    if apart < scene.step.dt {
        tell(&format!("images are {apart:?} s apart, and steps last {:?} s: some images are the same", scene.step.dt));
    }
    let (folder, name) = target(&arguments.out);
    let mut output = Output::create(folder)?;
    let bar = ProgressBar::new(pictures as u64).with_finish(ProgressFinish::AndClear);
    let mut take = |k: u64| -> Result<Picture> {
        // The image shows the first step that ends no more than half a step before the image's time.
        while simulation.time() + 0.5 * scene.step.dt < k as f64 * apart {
            simulation.step()?;
        }
        bar.inc(1);
        studio.picture(&mut simulation)
    };
    let count = pictures as u64;
    if name.is_none() {
        output.replaces(is_frame);
    }
    match name {
        None => (0..pictures as u64).try_for_each(|k| {
            let picture = take(k)?;
            output.write(&format!("frame-{k:05}.png"), |w| picture.write_png(w))
        })?,
        Some(name) => {
            let failed = |source| Error::Output { file: arguments.out.clone(), source };
            let mut file = output.file(name)?;
            animate(&mut file, arguments, pictures as u32, &mut take)?;
            file.flush().map_err(failed)?;
        }
    }
    output.commit()?;
    print(&format!("{}: {count} images for {duration:?} s\n", arguments.out.display()))
}

/// Whether a file's name is that of an image of a film.
fn is_frame(name: &str) -> bool {
    let number = name.strip_prefix("frame-").and_then(|rest| rest.strip_suffix(".png"));
    number.is_some_and(|number| number.len() == 5 && number.bytes().all(|byte| byte.is_ascii_digit()))
}

/// Refuses names of videos and GIF images, which are not written.
fn refuse_video(arguments: &Arguments) -> Result<()> {
    let out = arguments.out.display();
    let end = arguments.out.extension().and_then(|end| end.to_str()).unwrap_or_default().to_ascii_lowercase();
    if !VIDEOS.contains(&end.as_str()) {
        return Ok(());
    }
    let remedy = "give FILE.apng, or a directory of images and then";
    let fps = arguments.fps;
    // Most players need this pixel format, which needs an even width and height.
    let pixels = if end == "gif" { "" } else { " -vf 'pad=ceil(iw/2)*2:ceil(ih/2)*2' -pix_fmt yuv420p" };
    Err(Error::Usage(format!(
        "--out {out}: films in the format .{end} are not written; {remedy}: \
         ffmpeg -framerate {fps} -i DIRECTORY/frame-%05d.png{pixels} {out}"
    )))
}

/// The folder to write into, and the file's name if the film is one animated image.
fn target(out: &Path) -> (&Path, Option<&str>) {
    let is_file =
        out.extension().is_some_and(|end| end.eq_ignore_ascii_case("apng") || end.eq_ignore_ascii_case("png"));
    match (is_file, out.parent(), out.file_name().and_then(|name| name.to_str())) {
        (true, Some(parent), Some(name)) => {
            (if parent.as_os_str().is_empty() { Path::new(".") } else { parent }, Some(name))
        }
        _ => (out, None),
    }
}

/// Writes an animated PNG that plays for ever.
fn animate(
    out: impl Write,
    arguments: &Arguments,
    pictures: u32,
    take: &mut dyn FnMut(u64) -> Result<Picture>,
) -> Result<()> {
    let failed = |error: png::EncodingError| Error::Output { file: arguments.out.clone(), source: error.into() };
    let [width, height] = arguments.look.size();
    let mut encoder = png::Encoder::new(out, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    encoder.set_animated(pictures, 0).map_err(failed)?;
    encoder.set_frame_delay(1, arguments.fps).map_err(failed)?;
    let mut writer = encoder.write_header().map_err(failed)?;
    for k in 0..u64::from(pictures) {
        writer.write_image_data(&take(k)?.rgb()).map_err(failed)?;
    }
    writer.finish().map_err(failed)
}
