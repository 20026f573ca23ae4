//! Scenes made from a file or a text; `build.rs` adds to them by calls. The bodies of a scene are prepared before it is
//! simulated: their simulation meshes and collision proxies are made, which takes seconds.

use std::ffi::c_char;
use std::path::Path;

use palpate::internal::prepare::Cache;
use palpate::internal::prepare::bodies::{Bodies, Progress};
use palpate::{Result, Scene, SceneBuilder};

use super::handles::{self, Handled};
use super::sized;
use super::status::{Outcome, guarded, palpate_status};

/// Description of bodies, tool and settings from which any number of simulations can be made: read from a file or a
/// text, or built by calls. The mesh files that it names are opened when its bodies are prepared.
pub struct palpate_scene {
    _opaque: [u8; 0],
}

/// The object behind a scene's handle: the scene with the meshes that it may name, those of its bodies that are
/// prepared, and the cache of prepared bodies.
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

    /// Returns copies of the scene and of its prepared bodies.
    pub fn parts(&self) -> (Scene, Bodies) {
        (self.scene().clone(), self.bodies.clone())
    }

    /// Changes the scene by `work`, which may add bodies and may replace the tool: prepared bodies stay, the prepared
    /// tool is discarded.
    pub fn change<R>(&mut self, work: impl FnOnce(&mut SceneBuilder) -> Outcome<R>) -> Outcome<R> {
        self.bodies.tool = None;
        work(&mut self.builder)
    }

    /// Prepares the bodies that are not prepared yet; `watch` is called as each stage begins.
    pub fn prepare(&mut self, watch: &mut dyn FnMut(Progress) -> Result<()>) -> Result<()> {
        self.bodies.complete(self.builder.scene(), &self.cache, watch)
    }

    /// Sets where prepared bodies are kept from now on.
    pub fn set_cache(&mut self, cache: Cache) {
        self.cache = cache;
    }
}

impl Handled for SceneObject {
    const NAME: &str = "scene";
}

/// Makes a scene from a scene file.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_scene_load(file: *const c_char, scene: *mut *mut palpate_scene) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let (file, scene) = unsafe { (sized::string(file, "file")?, sized::answer(scene, "scene")?) };
        *scene = std::ptr::null_mut();
        given(scene, SceneObject::new(Scene::load(Path::new(file))?))
    })
}

/// Makes a scene from a text in the format of a scene file. Relative paths in it are relative to `folder`; null: to the
/// working directory.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_scene_parse(
    text: *const c_char,
    folder: *const c_char,
    scene: *mut *mut palpate_scene,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let (text, scene) = unsafe { (sized::string(text, "text")?, sized::answer(scene, "scene")?) };
        *scene = std::ptr::null_mut();
        let folder = match folder.is_null() {
            true => "",
            // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
            false => unsafe { sized::string(folder, "folder")? },
        };
        given(scene, SceneObject::new(Scene::parse(&Path::new(folder).join("scene"), text)?))
    })
}

pub(super) fn given(to: &mut *mut palpate_scene, scene: SceneObject) -> Outcome {
    *to = handles::insert(scene) as *mut palpate_scene;
    Ok(())
}

/// Destroys a scene; simulations that were made of it go on. Null does nothing.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_scene_destroy(scene: *mut palpate_scene) -> palpate_status {
    guarded(|| if scene.is_null() { Ok(()) } else { handles::remove::<SceneObject>(scene as usize) })
}
