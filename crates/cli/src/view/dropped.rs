//! Handles a surface file that is dropped onto the window: a separate thread makes a soft body and a scene of it, as
//! `palpate prepare` does.

use std::path::{Path, PathBuf};

use palpate::internal::prepare::Cache;
use palpate::internal::prepare::bodies::Bodies;
use palpate::{Error, Result, Scene};
use tempfile::TempDir;
use winit::event_loop::EventLoopProxy;

use super::app::Said;

/// Prepares a surface file on a new thread, which sends its progress and the result to the window's thread.
pub fn prepare(file: PathBuf, said: EventLoopProxy<Said>) {
    let tell = said.clone();
    let work = move || {
        // If the event loop has ended, sending fails, which is ignored.
        let made = made(&file, &mut |line| drop(tell.send_event(Said::Progress(line))));
        drop(tell.send_event(Said::Ready(made.map(Box::new))));
    };
    if let Err(error) = std::thread::Builder::new().name("palpate-prepare".into()).spawn(work) {
        let error = Error::Simulation(format!("the thread that prepares the file cannot be started: {error}"));
        drop(said.send_event(Said::Ready(Err(error))));
    }
}

fn made(file: &Path, say: &mut dyn FnMut(String)) -> Result<(Scene, Bodies)> {
    let folder = TempDir::new().map_err(|source| Error::Output { file: std::env::temp_dir(), source })?;
    let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
    crate::prepare::quietly(file, folder.path(), &mut |stage| say(format!("preparing {name}: {stage}")))?;
    let mut scene = Scene::load(&folder.path().join("scene.toml"))?;
    scene.haptics.has_device = true;
    let mut bodies = Bodies::default();
    bodies.complete(&scene, &Cache::of_user(), &mut |progress| {
        say(format!("preparing {name}: {}, {}", progress.name, progress.stage.name()));
        Ok(())
    })?;
    Ok((scene, bodies))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A box with edges of 4 (in the file's units), as an OBJ file.
    const BOX: &str = "v -2 -2 -2\nv 2 -2 -2\nv 2 2 -2\nv -2 2 -2\nv -2 -2 2\nv 2 -2 2\nv 2 2 2\nv -2 2 2\n\
        f 1 3 2\nf 1 4 3\nf 5 6 7\nf 5 7 8\nf 1 2 6\nf 1 6 5\nf 3 4 8\nf 3 8 7\nf 2 3 7\nf 2 7 6\nf 1 5 8\nf 1 8 4\n";

    #[test]
    fn a_surface_becomes_a_body_with_a_sphere_in_front_of_it_and_a_bad_one_a_line() {
        let folder = TempDir::new().unwrap();
        let (good, bad) = (folder.path().join("box.obj"), folder.path().join("bad.obj"));
        std::fs::write(&good, BOX).unwrap();
        std::fs::write(&bad, "v 1 2\nf 1 2 3\n").unwrap();
        let mut lines = Vec::new();
        let (scene, bodies) = made(&good, &mut |line| lines.push(line)).unwrap();
        assert!(scene.tool.is_some() && scene.coupling.is_some() && scene.haptics.has_device);
        assert_eq!((bodies.bodies.len(), bodies.tool.is_some()), (1, true));
        assert!(
            lines.iter().all(|line| line.starts_with("preparing box.obj: ")) && lines.len() > 3,
            "more than 3 lines of progress that name the file are expected: {lines:?}"
        );
        let error = made(&bad, &mut |_| {}).map(drop).unwrap_err().to_string();
        assert!(error.contains("bad.obj") && !error.contains('\n'), "wrong error: {error}");
    }
}
