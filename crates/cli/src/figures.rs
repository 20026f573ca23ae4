//! `palpate figures`: renders the README's images, each after a figure of the paper (Galoppo et al. 2007), and those of
//! the gallery (the example scenes in assets/gallery), from the scenes of this repository. An *overlay* is what an
//! image shows besides the skins (the bodies' surface meshes).

mod gallery;

use std::path::{Path, PathBuf};

use clap::builder::NonEmptyStringValueParser;
use glam::DVec3;
use indicatif::{ProgressBar, ProgressFinish};
use palpate::{Error, Options, Result, Scene, Simulation, Threads};
use palpate_view::picture::Picture;
use palpate_view::{Overlay, Overlays, Settings, Studio};

use crate::film::{SAMPLES, View};
use crate::report::Output;

/// Options of `palpate figures`.
#[derive(clap::Args)]
pub struct Arguments {
    /// Directory to write the images into
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Folder of the scenes [default: assets/scenes for the paper's figures, assets/gallery for the gallery]
    #[arg(long, value_name = "DIR")]
    scenes: Option<PathBuf>,
    /// Figures to render: numbers of figures of the paper, names of scenes of the gallery [default: the paper's]
    #[arg(long, value_name = "NAME,..", value_delimiter = ',', conflicts_with = "gallery")]
    only: Vec<String>,
    /// Render all pictures of the gallery instead of the paper's figures
    #[arg(long)]
    gallery: bool,
    /// Vulkan device: its name, or its index in the list of `palpate devices`
    #[arg(long, value_name = "NAME-OR-INDEX", value_parser = NonEmptyStringValueParser::new())]
    device: Option<String>,
}

/// One image of a figure: the state of a scene at a simulated time.
struct Shot {
    scene: &'static str,
    /// Simulated time, s.
    time: f64,
    shown: &'static [Overlay],
    from: View,
    /// Offset of the camera's target from the middle of all bodies, m.
    aside: [f64; 3],
    /// Width and height, pixels.
    size: [u32; 2],
    /// Whether the image's upper left corner shows the simulated time.
    shows_time: bool,
}

/// A figure: one file with images side by side.
struct Figure {
    /// Name by which the option `--only` selects the figure.
    name: &'static str,
    /// Name of the figure's file without the ending `.png`.
    file: &'static str,
    /// Folder of the figure's scenes, unless the option `--scenes` gives another one.
    scenes: &'static str,
    shots: &'static [Shot],
}

const fn shot(
    scene: &'static str,
    time: f64,
    shown: &'static [Overlay],
    [yaw, pitch, nearer]: [f64; 3],
    aside: [f64; 3],
    size: [u32; 2],
) -> Shot {
    Shot { scene, time, shown, from: View { yaw, pitch, nearer }, aside, size, shows_time: false }
}

/// Folder of the scenes of the paper's figures.
const PAPER: &str = "assets/scenes";

const FIGURES: [Figure; 6] = [
    Figure {
        name: "1",
        file: "figure-1-touched-head",
        scenes: PAPER,
        shots: &[
            shot("touch-head", 0.3, &[], [25.0, 8.0, 1.1], [0.0; 3], [560, 560]),
            shot(
                "touch-head",
                0.3,
                &[Overlay::Pressure, Overlay::Arrows],
                [40.0, 5.0, 2.8],
                [0.02, -0.02, 0.05],
                [720, 560],
            ),
        ],
    },
    Figure {
        name: "2",
        file: "figure-2-layers",
        scenes: PAPER,
        shots: &[
            shot("touch-head", 0.0, &[Overlay::Proxies], [25.0, 8.0, 1.1], [0.0; 3], [427, 480]),
            shot("touch-head", 0.0, &[Overlay::Layer, Overlay::Cores], [25.0, 8.0, 1.1], [0.0; 3], [427, 480]),
            shot("touch-head", 0.0, &[], [25.0, 8.0, 1.1], [0.0; 3], [426, 480]),
        ],
    },
    Figure {
        name: "4",
        file: "figure-4-contact",
        scenes: PAPER,
        shots: &[
            shot("two-heads", 0.1, &[Overlay::Proxies], [60.0, 10.0, 1.0], [0.0; 3], [427, 480]),
            shot("two-heads", 0.1, &[Overlay::Cores, Overlay::ContactPatches], [60.0, 10.0, 1.0], [0.0; 3], [427, 480]),
            shot("touch-head", 0.3, &[Overlay::Depth], [40.0, 5.0, 4.5], [0.02, -0.02, 0.05], [426, 480]),
        ],
    },
    Figure {
        name: "5",
        file: "figure-5-two-heads",
        scenes: PAPER,
        shots: &[
            shot("two-heads", 0.0, &[], [70.0, 8.0, 1.3], [0.0; 3], [640, 480]),
            shot("two-heads", 0.14, &[Overlay::Displacement], [70.0, 8.0, 1.3], [0.0; 3], [640, 480]),
        ],
    },
    Figure {
        name: "6",
        file: "figure-6-gears",
        scenes: PAPER,
        shots: &[
            shot("gears", 0.2, &[], [20.0, 12.0, 1.2], [0.0; 3], [640, 480]),
            shot("gears", 0.2, &[Overlay::Energy], [5.0, 5.0, 3.4], [0.0; 3], [640, 480]),
        ],
    },
    Figure {
        name: "7",
        file: "figure-7-pumpkins-and-human",
        scenes: PAPER,
        shots: &[
            shot("pumpkins", 0.0, &[], [20.0, 10.0, 0.95], [0.0; 3], [427, 480]),
            shot("pumpkins", 0.25, &[], [20.0, 10.0, 0.95], [0.0; 3], [427, 480]),
            shot("touch-human", 0.3, &[Overlay::Arrows], [25.0, 8.0, 1.5], [0.0, 0.2, 0.0], [426, 480]),
        ],
    },
];

/// The figures that the options select. Errors: `--only` has a name that no figure has.
fn wanted(arguments: &Arguments) -> Result<Vec<&'static Figure>> {
    if arguments.gallery {
        return Ok(gallery::GALLERY.iter().collect());
    }
    if arguments.only.is_empty() {
        return Ok(FIGURES.iter().collect());
    }
    let known = || FIGURES.iter().chain(&gallery::GALLERY);
    if let Some(name) = arguments.only.iter().find(|name| known().all(|figure| figure.name != **name)) {
        let names: Vec<&str> = known().map(|figure| figure.name).collect();
        return Err(Error::Usage(format!("--only {name}: there is no such figure; give some of {}", names.join(", "))));
    }
    Ok(known().filter(|figure| arguments.only.iter().any(|name| name == figure.name)).collect())
}

/// Renders the figures that the options select.
pub fn figures(arguments: &Arguments) -> Result<()> {
    let wanted = wanted(arguments)?;
    let mut output = Output::create(&arguments.out)?;
    let bar = ProgressBar::new(wanted.iter().map(|figure| figure.shots.len() as u64).sum());
    let bar = bar.with_finish(ProgressFinish::AndClear);
    for figure in wanted {
        let take = |shot: &Shot| {
            let scenes = arguments.scenes.as_deref().unwrap_or(Path::new(figure.scenes));
            let picture = take(shot, scenes, arguments);
            bar.inc(1);
            picture
        };
        let pictures: Vec<Picture> = figure.shots.iter().map(take).collect::<Result<_>>()?;
        let whole = Picture::beside(&pictures);
        output.write(&format!("{}.png", figure.file), |w| whole.write_png(w))?;
    }
    output.commit()
}

fn take(shot: &Shot, scenes: &Path, arguments: &Arguments) -> Result<Picture> {
    let scene = Scene::load(&scenes.join(format!("{}.toml", shot.scene)))?;
    let options = Options { device: arguments.device.clone(), threads: Some(Threads::Auto), ..Options::of_program() };
    let mut simulation = Simulation::open(&scene, &options)?;
    let mut studio = Studio::new(&mut simulation, Settings { size: shot.size, samples: SAMPLES })?;
    shot.from.aim(&mut studio);
    studio.camera.target += DVec3::from(shot.aside);
    studio.shown = Overlays::of(shot.shown);
    studio.shows_time = shot.shows_time;
    while simulation.time() + 0.5 * scene.step.dt < shot.time {
        simulation.step()?;
    }
    studio.picture(&mut simulation)
}
