//! A surface that is dropped on the window: prepared in a thread of its own, as `palpate prepare` does, and touched.

use std::path::{Path, PathBuf};

use palpate::prepare::bodies::Bodies;
use palpate::scene::Scene;
use palpate::{Error, Result};
use tempfile::TempDir;
use winit::event_loop::EventLoopProxy;

use super::app::Said;

/// The folder of a scene that was made of a surface.
#[derive(Debug)]
pub struct Dropped(#[expect(dead_code, reason = "removed when it is dropped")] TempDir);

/// Prepares a file and says how it goes.
pub fn prepare(file: PathBuf, said: EventLoopProxy<Said>) {
    let tell = said.clone();
    let work = move || {
        // The loop may have ended.
        let made = made(&file, &mut |line| drop(tell.send_event(Said::Progress(line))));
        drop(tell.send_event(Said::Ready(made.map(Box::new))));
    };
    if let Err(error) = std::thread::Builder::new().name("palpate-prepare".into()).spawn(work) {
        let error = Error::Simulation(format!("no thread to prepare it: {error}"));
        drop(said.send_event(Said::Ready(Err(error))));
    }
}

fn made(file: &Path, say: &mut dyn FnMut(String)) -> Result<(Scene, Bodies, Dropped)> {
    let folder = TempDir::new().map_err(|source| Error::Output { file: std::env::temp_dir(), source })?;
    let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
    crate::prepare::quietly(file, folder.path(), &mut |stage| say(format!("preparing {name}: {stage}")))?;
    let mut scene = Scene::load(&folder.path().join("scene.toml"))?;
    scene.haptics.is_held = true;
    let mut bodies = Bodies::default();
    bodies.complete(&scene, &mut |progress| {
        say(format!("preparing {name}: {}, {}", progress.name, progress.stage.name()));
        Ok(())
    })?;
    Ok((scene, bodies, Dropped(folder)))
}
