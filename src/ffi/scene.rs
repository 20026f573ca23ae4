//! Scenes, from a file or a text.

use std::ffi::c_char;
use std::path::Path;

use super::handles::{self, Handled};
use super::sized;
use super::status::{Outcome, guarded, palpate_status};
use crate::scene::Scene;

/// A scene as it was read: what a simulation is made of, any number of times. Files that it names (surfaces, layers) are
/// opened when it is made into a simulation.
pub struct palpate_scene {
    _opaque: [u8; 0],
}

pub(super) struct SceneObject(pub Scene);

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
        given(scene, Scene::load(Path::new(file))?)
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
        given(scene, Scene::parse(&Path::new(folder).join("scene"), text)?)
    })
}

fn given(to: &mut *mut palpate_scene, scene: Scene) -> Outcome {
    *to = handles::insert(SceneObject(scene)) as *mut palpate_scene;
    Ok(())
}

/// Lets go of a scene. Null does nothing.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_scene_destroy(scene: *mut palpate_scene) -> palpate_status {
    guarded(|| if scene.is_null() { Ok(()) } else { handles::remove::<SceneObject>(scene as usize) })
}
