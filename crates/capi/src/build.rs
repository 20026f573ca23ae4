//! Scenes by calls: settings, meshes, bodies and the tool one by one, and bodies prepared with somebody watching.

use std::ffi::{CString, c_char, c_void};

use glam::DVec3;
use palpate::internal::prepare::Cache;
use palpate::internal::prepare::bodies::Progress;
use palpate::{Error, Result, Scene};

use super::context::cache_folder;
use super::describe::{palpate_body, palpate_settings, palpate_tool};
use super::scene::{SceneObject, given, palpate_scene};
use super::sized::{self, Sized32};
use super::status::{Failure, Outcome, guarded, palpate_status};
use super::{handles, tables};

/// Where paths and messages of a scene say that it comes from.
const FILE: &str = "scene";

/// Is told what is being prepared: the body's name, or "tool"; the stage ("cache", "read", "repair", "layer", "embed",
/// "proxies", "bind"); how many bodies are ready, and how many there are, the tool counted as one. The strings live until it
/// returns. Give 0 to go on, anything else to end it there. Calls on the scene give PALPATE_STATUS_BUSY meanwhile. It must
/// return: no longjmp, and no exception.
pub type palpate_progress = Option<
    unsafe extern "C" fn(user: *mut c_void, body: *const c_char, stage: *const c_char, done: u32, total: u32) -> i32,
>;

/// Makes a scene of nothing, for the functions below. `settings` may be null. Files that its texts name are relative to the
/// working directory.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_scene_create(
    settings: *const palpate_settings,
    scene: *mut *mut palpate_scene,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the caller's, as the header says.
        let (settings, scene) = unsafe { (sized::read(settings)?, sized::answer(scene, "scene")?) };
        *scene = std::ptr::null_mut();
        let mut made = SceneObject::new(Scene::empty(FILE));
        made.change(|builder| builder.tables(&tables::of_settings(&settings)?).map_err(argument))?;
        given(scene, made)
    })
}

/// Adds the tables of a text to a scene, as of a scene file: anything that the structs here have no fields for, such as joints,
/// regions, skeletons, probes and `[haptics]`. Bodies and probes come after those that there are; other tables and keys replace
/// what there is, and what the text leaves out stays. Bodies may name meshes that were handed over, `surface = { mesh = "name" }`
/// and `layer = { mesh = "name" }`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_scene_add(scene: *mut palpate_scene, text: *const c_char) -> palpate_status {
    guarded(|| {
        // SAFETY: the caller's, as the header says.
        let text = unsafe { sized::string(text, "text")? };
        change(scene, |object| object.change(|builder| Ok(builder.toml(text).map(|_| ())?)))
    })
}

/// Hands a surface over, under a name by which bodies and the tool call it: what an OBJ file of the same vertices and faces
/// would be. `vertices`: 3 * `vertex_count` numbers, m before the body's scale. `triangles`: 3 * `triangle_count` vertices,
/// counted from 0, counter-clockwise seen from outside. What of it needs repair is repaired where bodies are prepared. The name
/// is no other surface's, and may be any text but "".
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_scene_add_surface(
    scene: *mut palpate_scene,
    name: *const c_char,
    vertices: *const f64,
    vertex_count: usize,
    triangles: *const u32,
    triangle_count: usize,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the caller's, as the header says.
        let (name, vertices, triangles) = unsafe {
            let vertices = sized::rows::<f64, 3>(vertices, vertex_count, "vertices")?;
            (sized::string(name, "name")?, vertices, sized::rows::<u32, 3>(triangles, triangle_count, "triangles")?)
        };
        change(scene, |object| {
            let vertices = vertices.iter().copied().map(DVec3::from_array).collect();
            object.change(|builder| builder.meshes().add_surface(name, vertices, triangles).map_err(argument))
        })
    })
}

/// Hands the tetrahedra of a layer over, under a name by which bodies call it: what a mesh file of them would be. `nodes`:
/// 3 * `node_count` numbers, m before the body's scale. `tetrahedra`: 4 * `tetrahedron_count` nodes, counted from 0; those that
/// are inside out are turned, those without volume or given twice are refused. The name is no other layer's, and may be any text
/// but "".
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_scene_add_layer(
    scene: *mut palpate_scene,
    name: *const c_char,
    nodes: *const f64,
    node_count: usize,
    tetrahedra: *const u32,
    tetrahedron_count: usize,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the caller's, as the header says.
        let (name, nodes, tetrahedra) = unsafe {
            let nodes = sized::rows::<f64, 3>(nodes, node_count, "nodes")?;
            (sized::string(name, "name")?, nodes, sized::rows::<u32, 4>(tetrahedra, tetrahedron_count, "tetrahedra")?)
        };
        change(scene, |object| {
            let nodes = nodes.iter().copied().map(DVec3::from_array).collect();
            object.change(|builder| builder.meshes().add_layer(name, nodes, tetrahedra).map_err(argument))
        })
    })
}

/// Adds a body. `index` receives its position in the scene, from 0, and may be null. What is wrong is named as in a scene file:
/// `body.NAME.material.young` is the field `young`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_scene_add_body(
    scene: *mut palpate_scene,
    body: *const palpate_body,
    index: *mut u32,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the caller's, as the header says.
        let tables = unsafe { tables::of_body(&needed(body, "body")?)? };
        let place = change(scene, |object| {
            object.change(|builder| builder.tables(&tables).map_err(argument))?;
            Ok(object.scene().bodies.len() - 1)
        })?;
        // SAFETY: the caller's, as the header says.
        if let Some(index) = unsafe { index.as_mut() } {
            *index = place as u32;
        }
        Ok(())
    })
}

/// Says with what a body of a scene collides: with `count` bodies of these names ("tool": the tool), all of which are there.
/// `names` null: with every other, as it is where nobody says. Two bodies collide where each has the other in its list or has
/// no list; a list of none is one.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_scene_set_collides(
    scene: *mut palpate_scene,
    body: u32,
    names: *const *const c_char,
    count: usize,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the caller's, as the header says.
        let given = unsafe { sized::array(names, count, "names")? };
        // SAFETY: the caller's, as the header says.
        let name = |name: &*const c_char| unsafe { sized::string(*name, "names[..]") }.map(String::from);
        let given: Vec<String> = given.iter().map(name).collect::<Outcome<_>>()?;
        let list = (!names.is_null()).then_some(given);
        change(scene, |object| {
            object.change(|builder| builder.collides(body as usize, list).map(|_| ()).map_err(argument))
        })
    })
}

/// Gives a scene this tool, held so, in place of any that it has.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_scene_set_tool(
    scene: *mut palpate_scene,
    tool: *const palpate_tool,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the caller's, as the header says.
        let tables = unsafe { tables::of_tool(&needed(tool, "tool")?)? };
        change(scene, |object| object.change(|builder| builder.replace_tool(&tables).map_err(argument)))
    })
}

/// Says where palpate_scene_prepare keeps prepared bodies for later runs: in `folder`, or the user's where that is "" (as the
/// context's options say). Null, and without this call: nowhere.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_scene_cache(scene: *mut palpate_scene, folder: *const c_char) -> palpate_status {
    guarded(|| {
        // SAFETY: the caller's, as the header says.
        let folder = unsafe { cache_folder(folder)? };
        change(scene, |object| {
            object.set_cache(folder.as_deref().map_or_else(Cache::off, Cache::at));
            Ok(())
        })
    })
}

/// Prepares the bodies of a scene: repairs surfaces, fills them with cells, and so on: seconds, unless they were kept
/// (palpate_scene_cache).
/// palpate_simulation_create does it too where it is not done, with nobody watching. `progress` is called as each stage begins,
/// with `user`, on this thread; it may be null. Where it ends it (PALPATE_STATUS_CANCELLED), bodies that are ready stay so, and
/// the next call goes on.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_scene_prepare(
    scene: *mut palpate_scene,
    progress: palpate_progress,
    user: *mut c_void,
) -> palpate_status {
    guarded(|| change(scene, |object| Ok(object.prepare(&mut |state| tell(progress, user, &state))?)))
}

fn tell(progress: palpate_progress, user: *mut c_void, state: &Progress) -> Result<()> {
    let Some(progress) = progress else { return Ok(()) };
    let [body, stage] = [state.name, state.stage.name()].map(|text| CString::new(text).unwrap_or_default());
    // SAFETY: the caller's function, as the header says; the strings live until it returns.
    let wish = unsafe { progress(user, body.as_ptr(), stage.as_ptr(), state.done as u32, state.total as u32) };
    match wish {
        0 => Ok(()),
        _ => {
            let place = format!("the callback ended it before stage `{}` of `{}`", state.stage.name(), state.name);
            Err(Error::Cancelled(format!("{place}; call again to go on")))
        }
    }
}

/// A struct that must be there.
///
/// # Safety
/// As [`sized::read`].
unsafe fn needed<T: Sized32>(from: *const T, name: &str) -> Outcome<T> {
    if from.is_null() {
        return Err(Failure::new(palpate_status::Null, format!("{name} is null; give a {}", T::NAME)));
    }
    // SAFETY: the caller's promise.
    unsafe { sized::read(from) }
}

fn change<R>(scene: *mut palpate_scene, work: impl FnOnce(&mut SceneObject) -> Outcome<R>) -> Outcome<R> {
    handles::with(scene as usize, work)
}

/// What is wrong with a struct or an array is no file's fault.
fn argument(error: Error) -> Failure {
    match Failure::from(error) {
        Failure { status: palpate_status::Input, message } => Failure { status: palpate_status::Argument, message },
        other => other,
    }
}
