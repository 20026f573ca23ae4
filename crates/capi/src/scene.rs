//! Scenes, from a file or a text; `build.rs` adds to them.

use std::ffi::c_char;
use std::path::Path;

use palpate::internal::prepare::Cache;
use palpate::internal::prepare::bodies::{Bodies, Progress};
use palpate::{Result, Scene, SceneBuilder};

use super::handles::{self, Handled};
use super::sized;
use super::status::{Outcome, guarded, palpate_status};

/// What a simulation is made of, any number of times: read from a file or a text, or built by calls. Files that it names
/// (surfaces, layers) are opened when its bodies are prepared.
pub struct palpate_scene {
    _opaque: [u8; 0],
}

/// A scene, what of it is prepared, and the meshes that it may name.
pub(super) struct SceneObject {
    builder: SceneBuilder,
    bodies: Bodies,
    cache: Cache,
}

impl SceneObject {
    pub fn new(scene: Scene) -> SceneObject {
        SceneObject { builder: SceneBuilder::of(scene), bodies: Bodies::default(), cache: Cache::off() }
    }

    pub fn scene(&self) -> &Scene {
        self.builder.scene()
    }

    /// The scene, and those of its bodies that are prepared.
    pub fn parts(&self) -> (Scene, Bodies) {
        (self.scene().clone(), self.bodies.clone())
    }

    /// Adds to the scene. Bodies that it has stay as they are, the tool may be another.
    pub fn change<R>(&mut self, work: impl FnOnce(&mut SceneBuilder) -> Outcome<R>) -> Outcome<R> {
        self.bodies.tool = None;
        work(&mut self.builder)
    }

    /// Prepares what is not prepared yet.
    pub fn prepare(&mut self, watch: &mut dyn FnMut(Progress) -> Result<()>) -> Result<()> {
        self.bodies.complete(self.builder.scene(), &self.cache, watch)
    }

    /// Where prepared bodies are kept from now on.
    pub fn set_cache(&mut self, cache: Cache) {
        self.cache = cache;
    }
}

impl Handled for SceneObject {
    const NAME: &str = "scene";
}

/// Reads a scene file.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_scene_load(file: *const c_char, scene: *mut *mut palpate_scene) -> palpate_status {
    guarded(|| {
        // SAFETY: the caller's, as the header says.
        let (file, scene) = unsafe { (sized::string(file, "file")?, sized::answer(scene, "scene")?) };
        *scene = std::ptr::null_mut();
        given(scene, SceneObject::new(Scene::load(Path::new(file))?))
    })
}

/// Reads a scene from the text of a scene file. `folder`: what files that it names are relative to; null: the working
/// directory.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_scene_parse(
    text: *const c_char,
    folder: *const c_char,
    scene: *mut *mut palpate_scene,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the caller's, as the header says.
        let (text, scene) = unsafe { (sized::string(text, "text")?, sized::answer(scene, "scene")?) };
        *scene = std::ptr::null_mut();
        let folder = match folder.is_null() {
            true => "",
            // SAFETY: the caller's, as the header says.
            false => unsafe { sized::string(folder, "folder")? },
        };
        given(scene, SceneObject::new(Scene::parse(&Path::new(folder).join("scene"), text)?))
    })
}

pub(super) fn given(to: &mut *mut palpate_scene, scene: SceneObject) -> Outcome {
    *to = handles::insert(scene) as *mut palpate_scene;
    Ok(())
}

/// Lets go of a scene. Null does nothing.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_scene_destroy(scene: *mut palpate_scene) -> palpate_status {
    guarded(|| if scene.is_null() { Ok(()) } else { handles::remove::<SceneObject>(scene as usize) })
}
