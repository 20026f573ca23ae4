//! C functions that build a scene by calls instead of from a scene file: settings, meshes, bodies and the tool (what
//! the haptic device moves) are added one by one. A further function prepares the bodies of a scene, with a progress
//! callback.
//!
//! To prepare a body is to repair its surface (the skin, which is seen and touched), fill it with tetrahedra (the
//! layer, that is, the simulation mesh), embed the skin in the layer, cover the skin by convex hulls (collision
//! proxies, for the coarse search for contacts), and attach nodes of the layer to rigid cores (rigid bodies inside the
//! soft one).

use std::ffi::{CString, c_char, c_void};

use glam::DVec3;
use palpate::internal::prepare::bodies::Progress;
use palpate::internal::prepare::{Cache, Stage};
use palpate::{Error, Result, Scene};

use super::context::cache_folder;
use super::describe::{palpate_body, palpate_settings, palpate_tool};
use super::scene::{SceneObject, given, palpate_scene};
use super::sized::{self, Sized32};
use super::status::{Failure, Outcome, guarded, palpate_status};
use super::{handles, tables};

/// Name of a scene made by calls; messages give it in place of the path of a scene file. It names no folder, so
/// relative paths in a text that is added to the scene are relative to the working directory.
const FILE: &str = "scene";

/// Progress callback of `palpate_scene_prepare` and of `palpate_simulation_create_with_progress`, called as each stage
/// begins. `body` is the name of the body that is being prepared, or "tool". `stage` is "cache" (the cache is searched
/// for the prepared body), "read" (the surface is read), "repair" (the surface is repaired), "layer" (tetrahedra are
/// made), "embed" (the skin is embedded in the tetrahedra), "proxies" (convex hulls are made), "bind" (nodes are attached
/// to rigid cores) or "ready" (the body is ready). `done` is the number of bodies that are ready and `total` that of all
/// bodies; a tool that is not one of the bodies counts as one more body. The strings are valid until the callback
/// returns. Return 0 to continue, anything else to cancel. While the callback of `palpate_scene_prepare` runs, calls on
/// the scene give PALPATE_STATUS_BUSY. The callback must return: no longjmp, and no exception.
pub type palpate_progress = Option<
    unsafe extern "C" fn(user: *mut c_void, body: *const c_char, stage: *const c_char, done: u32, total: u32) -> i32,
>;

/// Makes an empty scene, to which the functions below add. `settings` may be null: then all settings have their
/// defaults. Relative paths in a text that palpate_scene_add adds to the scene are relative to the working directory.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_scene_create(
    settings: *const palpate_settings,
    scene: *mut *mut palpate_scene,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let (settings, scene) = unsafe { (sized::read(settings)?, sized::answer(scene, "scene")?) };
        *scene = std::ptr::null_mut();
        let mut made = SceneObject::new(Scene::empty(FILE));
        made.change(|builder| builder.tables(&tables::of_settings(&settings)?).map_err(argument))?;
        given(scene, made)
    })
}

/// Adds the tables of a text in the format of a scene file, for everything that has no field in the structs of this
/// header, such as joints, material regions (parts of a layer with a material of their own), skeletons (files of bones,
/// which become rigid cores), probes (points of a skin whose paths are recorded) and `[haptics]`. Bodies and probes are
/// appended to the existing ones; other tables and keys replace the existing ones, and those that the text leaves out
/// stay. A body in the text may name a mesh by `surface = { mesh = "name" }` if palpate_scene_add_surface has handed it
/// over, or by `layer = { mesh = "name" }` if palpate_scene_add_layer has.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_scene_add(scene: *mut palpate_scene, text: *const c_char) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let text = unsafe { sized::string(text, "text")? };
        change(scene, |object| object.change(|builder| Ok(builder.toml(text).map(|_| ())?)))
    })
}

/// Hands over a triangle surface in place of a file, under a name by which bodies and the tool refer to it.
/// `vertices`: 3 * `vertex_count` coordinates; multiplied by the body's `scale` they are in m. `triangles`: 3 *
/// `triangle_count` vertex indices from 0; seen from outside, each triangle is counter-clockwise. Defects of the
/// surface are repaired when bodies are prepared. The name must differ from those of other surfaces, and may be any
/// text but "".
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
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
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

/// Hands over the tetrahedra of a layer (the simulation mesh of a soft body) in place of a mesh file, under a name by
/// which bodies refer to it. `nodes`: 3 * `node_count` coordinates; multiplied by the body's `scale` they are in m.
/// `tetrahedra`: 4 * `tetrahedron_count` node indices from 0; inverted tetrahedra are reoriented, and tetrahedra
/// without volume or given twice are refused. The name must differ from those of other layers, and may be any text but
/// "".
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
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
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

/// Adds a body. `index` receives the position of the body in the scene, from 0, and may be null. Error messages name a
/// wrong value by the value's key in a scene file: `body.NAME.material.young` stands for the field `young`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_scene_add_body(
    scene: *mut palpate_scene,
    body: *const palpate_body,
    index: *mut u32,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let tables = unsafe { tables::of_body(&needed(body, "body")?)? };
        let place = change(scene, |object| {
            object.change(|builder| builder.tables(&tables).map_err(argument))?;
            Ok(object.scene().bodies.len() - 1)
        })?;
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        if let Some(index) = unsafe { index.as_mut() } {
            *index = place as u32;
        }
        Ok(())
    })
}

/// Sets the bodies with which the body at position `body` in the scene collides: `names` are `count` names of bodies of
/// the scene, with "tool" for the tool. If `names` is null, the body collides with every other body, which is the
/// default. Two bodies collide if each of them has the other in its list or has no list; with an empty list (`count` 0,
/// `names` not null) a body collides with nothing. Two tools that are bodies collide only if one of them has a list.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_scene_set_collides(
    scene: *mut palpate_scene,
    body: u32,
    names: *const *const c_char,
    count: usize,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let given = unsafe { sized::array(names, count, "names")? };
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let name = |name: &*const c_char| unsafe { sized::string(*name, "names[..]") }.map(String::from);
        let given: Vec<String> = given.iter().map(name).collect::<Outcome<_>>()?;
        let list = (!names.is_null()).then_some(given);
        change(scene, |object| {
            object.change(|builder| builder.collides(body as usize, list).map(|_| ()).map_err(argument))
        })
    })
}

/// Sets the scene's tool, and the virtual coupling (spring and damper) between haptic device and tool. Both replace
/// those that the scene has; of several tools (`[[tool]]`) all are removed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_scene_set_tool(
    scene: *mut palpate_scene,
    tool: *const palpate_tool,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let tables = unsafe { tables::of_tool(&needed(tool, "tool")?)? };
        change(scene, |object| object.change(|builder| builder.replace_tool(&tables).map_err(argument)))
    })
}

/// Sets the folder in which palpate_scene_prepare keeps prepared bodies for later runs; "": the user's cache folder
/// (see `cache` in palpate_context_options); null, which is the default: prepared bodies are not kept.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_scene_cache(scene: *mut palpate_scene, folder: *const c_char) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let folder = unsafe { cache_folder(folder)? };
        change(scene, |object| {
            object.set_cache(folder.as_deref().map_or_else(Cache::off, Cache::at));
            Ok(())
        })
    })
}

/// Prepares the bodies of a scene: repairs surfaces, fills them with tetrahedra, and does the other stages that
/// palpate_progress lists. This takes seconds, unless prepared bodies are found in the cache (palpate_scene_cache).
/// Bodies that were not prepared by this call are prepared when a simulation is made.
/// `progress` is called with `user` on this thread as each stage begins; it may be null. If the callback cancels
/// (PALPATE_STATUS_CANCELLED), bodies that are ready stay ready, and the next call continues with the others.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_scene_prepare(
    scene: *mut palpate_scene,
    progress: palpate_progress,
    user: *mut c_void,
) -> palpate_status {
    guarded(|| change(scene, |object| Ok(object.prepare(&mut |state| tell(progress, user, &state))?)))
}

/// Calls the progress callback, if there is one, as a stage of a body's preparation begins.
pub(super) fn tell(progress: palpate_progress, user: *mut c_void, state: &Progress) -> Result<()> {
    let (name, stage) = (state.name, state.stage.name());
    if wants_more(progress, user, [name, stage], [state.done, state.total]) {
        return Ok(());
    }
    let place = match state.stage {
        Stage::Ready => format!("when `{name}` was ready"),
        _ => format!("before stage `{stage}` of `{name}`"),
    };
    Err(Error::Cancelled(format!("the callback cancelled the preparation {place}")))
}

/// Calls the progress callback, if there is one, before a GPU kernel is compiled, after `done` others.
pub(super) fn tell_of_kernels(progress: palpate_progress, user: *mut c_void, done: usize) -> Result<()> {
    if wants_more(progress, user, ["", "kernels"], [done, 0]) {
        return Ok(());
    }
    Err(Error::Cancelled(format!("the callback cancelled the work after {done} GPU kernels")))
}

fn wants_more(progress: palpate_progress, user: *mut c_void, texts: [&str; 2], counts: [usize; 2]) -> bool {
    let Some(progress) = progress else { return true };
    let [body, stage] = texts.map(|text| CString::new(text).unwrap_or_default());
    let [done, total] = counts.map(|count| count as u32);
    // SAFETY: the header demands a callback that may be called with this `user`; the strings live until it returns.
    unsafe { progress(user, body.as_ptr(), stage.as_ptr(), done, total) == 0 }
}

/// Reads a struct that must not be null.
///
/// # Safety
/// The conditions of [`sized::read`] hold for `from`.
unsafe fn needed<T: Sized32>(from: *const T, name: &str) -> Outcome<T> {
    if from.is_null() {
        return Err(Failure::new(palpate_status::Null, format!("{name} is null; give a {}", T::NAME)));
    }
    // SAFETY: the caller keeps the conditions under `# Safety`.
    unsafe { sized::read(from) }
}

fn change<R>(scene: *mut palpate_scene, work: impl FnOnce(&mut SceneObject) -> Outcome<R>) -> Outcome<R> {
    handles::with(scene as usize, work)
}

/// Turns an input error into an argument error: a wrong value in a struct or an array is an error in an argument of the
/// caller, not in a file.
fn argument(error: Error) -> Failure {
    match Failure::from(error) {
        Failure { status: palpate_status::Input, message } => Failure { status: palpate_status::Argument, message },
        other => other,
    }
}
