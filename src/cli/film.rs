//! `palpate film`: a scene from the first step to the last as a film, or as pictures in a folder; no display is needed.

use std::path::PathBuf;
use std::time::Instant;

use palpate::Result;
use palpate::gpu::Options;
use palpate::scene::Scene;
use palpate::step::Simulation;
use palpate::view::picture::Picture;
use palpate::view::{Camera, Moment, Renderer, Settings};

/// Options of `palpate film`.
#[derive(clap::Args)]
pub struct Arguments {
    /// The scene, a TOML file
    scene: PathBuf,
    /// Steps
    #[arg(long, default_value_t = 100)]
    steps: u64,
    #[arg(long, default_value_t = 1)]
    samples: u32,
    /// Where to
    #[arg(long)]
    out: PathBuf,
}

/// Makes a film.
pub fn film(arguments: &Arguments) -> Result<()> {
    let scene = Scene::load(&arguments.scene)?;
    let mut simulation = Simulation::new(&scene, &Options { one_thread: true, ..Options::default() }, None)?;
    let mut renderer = Renderer::new(&mut simulation, Settings { size: [1280, 720], samples: arguments.samples })?;
    let camera = Camera::around(glam::DVec3::new(-0.08, -0.13, -0.1), glam::DVec3::new(0.08, 0.13, 0.1));
    for step in 0..arguments.steps {
        simulation.step()?;
        if step % 10 == 0 {
            let a = Instant::now();
            let moment = Moment::of(&mut simulation, renderer.origin(), palpate::view::Overlays::default())?;
            let b = Instant::now();
            renderer.look(&moment, &camera)?;
            let mut text = format!("skins {:.1} ms", (b - a).as_secs_f64() * 1e3);
            for slice in renderer.slices() {
                let c = Instant::now();
                slice.submit_and_wait()?;
                text += &format!(", {:.1}", c.elapsed().as_secs_f64() * 1e3);
            }
            eprintln!("{text}; all {:.1}", a.elapsed().as_secs_f64() * 1e3);
        }
    }
    let picture: Picture = renderer.read()?;
    let file = std::fs::File::create(&arguments.out)
        .map_err(|source| palpate::Error::Output { file: arguments.out.clone(), source })?;
    picture
        .write_png(std::io::BufWriter::new(file))
        .map_err(|source| palpate::Error::Output { file: arguments.out.clone(), source })
}
