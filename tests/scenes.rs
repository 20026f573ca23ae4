//! Tests of the scenes that come with the program: all of them can be read. Those that reproduce the experiments of the
//! paper that the program implements (Galoppo, Tekin, Otaduy, Gross and Lin; see the README) have the paper's numbers
//! of vertices and its motions.

use std::path::{Path, PathBuf};

use palpate::Scene;
use palpate::scene::{Motion, Shape, Surface};

fn scenes() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/scenes");
    std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect()
}

/// Number of vertices of the skin (surface mesh) of each soft body of a scene.
fn sizes(name: &str) -> Vec<usize> {
    let file = scenes()
        .into_iter()
        .find(|path| path.file_stem().unwrap() == name)
        .unwrap_or_else(|| panic!("no scene {name}"));
    let scene = Scene::load(&file).unwrap();
    let size = |body: &palpate::scene::Body| match &body.shape {
        Shape::Soft { surface: Some(Surface::Model { vertices, .. }), .. } => *vertices,
        other => panic!("scene {name}: the surface of a body is not a generated model: {other:?}"),
    };
    scene.bodies.iter().map(size).collect()
}

#[test]
fn every_scene_is_read() {
    assert!(scenes().len() >= 8);
    for file in scenes() {
        let scene = Scene::load(&file).unwrap_or_else(|error| panic!("{error}"));
        for probe in &scene.probes {
            assert!(
                scene.bodies.iter().any(|body| body.name == probe.body),
                "{}: the scene lacks the body of probe {}",
                file.display(),
                probe.name
            );
        }
    }
}

#[test]
fn the_papers_scenes_have_its_sizes() {
    assert_eq!(sizes("touch-head"), [44_000]);
    assert_eq!(sizes("two-heads"), [44_000; 2]);
    assert_eq!(sizes("gears"), [29_000; 2]);
    assert_eq!(sizes("pumpkins"), [30_000; 2]);
    assert_eq!(sizes("touch-human"), [13_000]);
}

#[test]
fn what_should_move_moves() {
    let load = |name: &str| {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/scenes");
        Scene::load(&folder.join(name)).unwrap()
    };
    let gears = load("gears.toml");
    assert!(matches!(gears.bodies[0].cores[0].motion, Motion::Kinematic(_)));
    assert!(gears.bodies[1].cores[0].hinge.is_some());
    let human = load("touch-human.toml");
    let kinematic = |core: &&palpate::scene::Core| matches!(core.motion, Motion::Kinematic(_));
    assert_eq!(human.bodies[0].cores.iter().filter(kinematic).count(), 2);
    assert!(load("pumpkins.toml").bodies[1].cores.is_empty());
}
