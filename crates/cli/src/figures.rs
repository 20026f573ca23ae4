//! `palpate figures`: renders the README's images, each after a figure of the paper (Galoppo et al. 2007), from the
//! scenes of this repository.

use std::path::PathBuf;

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
    /// Folder of the scene files
    #[arg(long, value_name = "DIR", default_value = "assets/scenes")]
    scenes: PathBuf,
    /// Numbers of the figures to render [default: all]
    #[arg(long, value_name = "N,..", value_delimiter = ',')]
    only: Vec<u32>,
    /// Vulkan device: its name, or its index in the list of `palpate devices`
    #[arg(long, value_name = "NAME-OR-INDEX", value_parser = NonEmptyStringValueParser::new())]
    device: Option<String>,
}

/// One image of a figure: a scene as it is at a simulated time.
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
}

/// A figure: images side by side.
struct Figure {
    number: u32,
    name: &'static str,
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
    Shot { scene, time, shown, from: View { yaw, pitch, nearer }, aside, size }
}

const FIGURES: [Figure; 6] = [
    Figure {
        number: 1,
        name: "touched-head",
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
        number: 2,
        name: "layers",
        shots: &[
            shot("touch-head", 0.0, &[Overlay::Proxies], [25.0, 8.0, 1.1], [0.0; 3], [427, 480]),
            shot("touch-head", 0.0, &[Overlay::Layer, Overlay::Cores], [25.0, 8.0, 1.1], [0.0; 3], [427, 480]),
            shot("touch-head", 0.0, &[], [25.0, 8.0, 1.1], [0.0; 3], [426, 480]),
        ],
    },
    Figure {
        number: 4,
        name: "contact",
        shots: &[
            shot("two-heads", 0.1, &[Overlay::Proxies], [60.0, 10.0, 1.0], [0.0; 3], [427, 480]),
            shot("two-heads", 0.1, &[Overlay::Cores, Overlay::ContactPatches], [60.0, 10.0, 1.0], [0.0; 3], [427, 480]),
            shot("touch-head", 0.3, &[Overlay::Depth], [40.0, 5.0, 4.5], [0.02, -0.02, 0.05], [426, 480]),
        ],
    },
    Figure {
        number: 5,
        name: "two-heads",
        shots: &[
            shot("two-heads", 0.0, &[], [70.0, 8.0, 1.3], [0.0; 3], [640, 480]),
            shot("two-heads", 0.14, &[Overlay::Displacement], [70.0, 8.0, 1.3], [0.0; 3], [640, 480]),
        ],
    },
    Figure {
        number: 6,
        name: "gears",
        shots: &[
            shot("gears", 0.2, &[], [20.0, 12.0, 1.2], [0.0; 3], [640, 480]),
            shot("gears", 0.2, &[Overlay::Energy], [5.0, 5.0, 3.4], [0.0; 3], [640, 480]),
        ],
    },
    Figure {
        number: 7,
        name: "pumpkins-and-human",
        shots: &[
            shot("pumpkins", 0.0, &[], [20.0, 10.0, 0.95], [0.0; 3], [427, 480]),
            shot("pumpkins", 0.25, &[], [20.0, 10.0, 0.95], [0.0; 3], [427, 480]),
            shot("touch-human", 0.3, &[Overlay::Arrows], [25.0, 8.0, 1.5], [0.0, 0.2, 0.0], [426, 480]),
        ],
    },
];

/// Renders all figures, or only those with the numbers that `--only` gives.
pub fn figures(arguments: &Arguments) -> Result<()> {
    let known = FIGURES.map(|figure| figure.number);
    if let Some(number) = arguments.only.iter().find(|number| !known.contains(number)) {
        return Err(Error::Usage(format!("--only {number}: there is no such figure; give some of {known:?}")));
    }
    let wanted = |figure: &&Figure| arguments.only.is_empty() || arguments.only.contains(&figure.number);
    let wanted: Vec<&Figure> = FIGURES.iter().filter(wanted).collect();
    let mut output = Output::create(&arguments.out)?;
    let bar = ProgressBar::new(wanted.iter().map(|figure| figure.shots.len() as u64).sum());
    let bar = bar.with_finish(ProgressFinish::AndClear);
    for figure in wanted {
        let take = |shot: &Shot| {
            let picture = take(shot, arguments);
            bar.inc(1);
            picture
        };
        let pictures: Vec<Picture> = figure.shots.iter().map(take).collect::<Result<_>>()?;
        let whole = Picture::beside(&pictures);
        output.write(&format!("figure-{}-{}.png", figure.number, figure.name), |w| whole.write_png(w))?;
    }
    output.commit()
}

fn take(shot: &Shot, arguments: &Arguments) -> Result<Picture> {
    let scene = Scene::load(&arguments.scenes.join(format!("{}.toml", shot.scene)))?;
    let options = Options { device: arguments.device.clone(), threads: Some(Threads::Auto), ..Options::of_program() };
    let mut simulation = Simulation::open(&scene, &options)?;
    let mut studio = Studio::new(&mut simulation, Settings { size: shot.size, samples: SAMPLES })?;
    shot.from.aim(&mut studio);
    studio.camera.target += DVec3::from(shot.aside);
    studio.shown = Overlays::of(shot.shown);
    while simulation.time() + 0.5 * scene.step.dt < shot.time {
        simulation.step()?;
    }
    studio.picture(&mut simulation)
}
