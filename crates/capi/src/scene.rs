//! Functions that make scenes from a file or a text; those of `build.rs` add to a scene by calls. The bodies of a scene
//! are prepared before the scene is simulated: their tetrahedral simulation meshes and their collision proxies (convex
//! hulls for the broad phase) are made, which takes seconds. The C caller names a scene by its handle, a number
//! (`handles.rs`).

use std::ffi::c_char;
use std::path::Path;

use palpate::internal::prepare::Cache;
use palpate::internal::prepare::bodies::{Bodies, Progress};
use palpate::{Result, Scene, SceneBuilder};

use super::handles::{self, Handled};
use super::sized;
use super::status::{Outcome, guarded, palpate_status};

/// A scene: the description of bodies, tool and settings, from which any number of simulations can be made. It is read
/// from a file or a text, or built by calls. The mesh files that it names are opened when its bodies are prepared.
pub struct palpate_scene {
    _opaque: [u8; 0],
}

/// The object for which the handle of a scene stands: the scene, with the meshes in memory to which its bodies refer by
/// name (`builder`), those of its bodies that are already prepared (`bodies`), and the folder that keeps prepared
/// bodies for later runs (`cache`).
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

    /// Changes the scene by `work`, which may add bodies and may replace the tool. Bodies that are prepared stay so;
    /// the prepared tool is discarded, because it may be replaced.
    pub fn change<R>(&mut self, work: impl FnOnce(&mut SceneBuilder) -> Outcome<R>) -> Outcome<R> {
        self.bodies.tool = None;
        work(&mut self.builder)
    }

    /// Prepares the bodies that are not prepared yet; `watch` is called as each stage of a body's preparation begins.
    pub fn prepare(&mut self, watch: &mut dyn FnMut(Progress) -> Result<()>) -> Result<()> {
        self.bodies.complete(self.builder.scene(), &self.cache, watch)
    }

    /// Sets the folder that keeps bodies prepared from now on for later runs.
    pub fn set_cache(&mut self, cache: Cache) {
        self.cache = cache;
    }
}

impl Handled for SceneObject {
    const NAME: &str = "scene";
}

/// Makes a scene from the scene file at the path `file`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_scene_load(file: *const c_char, scene: *mut *mut palpate_scene) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let (file, scene) = unsafe { (sized::string(file, "file")?, sized::answer(scene, "scene")?) };
        *scene = std::ptr::null_mut();
        given(scene, SceneObject::new(Scene::load(Path::new(file))?))
    })
}

/// Makes a scene from a text in the format of a scene file. Relative paths in the text are relative to `folder`, or, if
/// `folder` is null, to the working directory.
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

/// Destroys a scene. Simulations that were made of the scene can still be used. With null the call does nothing.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_scene_destroy(scene: *mut palpate_scene) -> palpate_status {
    guarded(|| if scene.is_null() { Ok(()) } else { handles::remove::<SceneObject>(scene as usize) })
}
