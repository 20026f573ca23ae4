//! Tests of scenes that are built by calls of the C ABI of palpate: a simulation of such a scene computes the same bits
//! as a simulation of the equal scene file, and wrong values are refused with a message that names them, and change
//! nothing. The tool is the rigid body that the haptic device leads, by a spring and damper, the virtual coupling; a
//! rigid core is a rigid body inside a soft body, to which nodes of the soft body are attached.
#![allow(unsafe_code)]

mod prepare;
mod wrong;

use std::ffi::{CStr, CString, c_char, c_void};
use std::path::Path;
use std::ptr::{null, null_mut};

use glam::DVec3;
use palpate::internal::prepare::{layer, sphere};
use palpate_capi::build::{
    palpate_scene_add, palpate_scene_add_body, palpate_scene_add_layer, palpate_scene_add_surface, palpate_scene_cache,
    palpate_scene_create, palpate_scene_prepare, palpate_scene_set_collides, palpate_scene_set_tool,
};
use palpate_capi::context::{
    palpate_context, palpate_context_create, palpate_context_destroy, palpate_context_options,
};
use palpate_capi::describe::*;
use palpate_capi::scene::{palpate_scene, palpate_scene_destroy, palpate_scene_load, palpate_scene_parse};
use palpate_capi::simulation::{
    palpate_nodes, palpate_pose, palpate_simulation_create, palpate_simulation_create_with_progress,
    palpate_simulation_destroy, palpate_step, palpate_wrench,
};
use palpate_capi::status::{palpate_last_error, palpate_status};
use palpate_status::{Argument, Busy, Cancelled, Handle, Input, Null};

/// Number of steps of each simulation.
const STEPS: usize = 25;

fn last_error() -> String {
    // SAFETY: the library's message is never null and is terminated by a zero byte.
    unsafe { CStr::from_ptr(palpate_last_error()) }.to_str().unwrap().into()
}

#[track_caller]
fn ok(status: palpate_status) {
    assert_eq!(status, palpate_status::Ok, "last error: {}", last_error());
}

#[track_caller]
fn refused(status: palpate_status, expected: palpate_status, words: &str) {
    let error = last_error();
    assert_eq!(status, expected, "last error: {error}");
    assert!(error.contains(words) && error.lines().count() == 1, "wrong error: {error}");
}

/// Returns a struct of palpate.h whose size field is set and whose other fields are zero.
fn zeros<T: Copy>() -> T {
    // SAFETY: the function is used only for structs of numbers and pointers, whose first field, a `u32`, is their size.
    unsafe {
        let mut made: T = std::mem::zeroed();
        (&raw mut made).cast::<u32>().write(size_of::<T>() as u32);
        made
    }
}

/// Makes an empty scene with default settings.
fn empty() -> *mut palpate_scene {
    let mut scene = null_mut();
    // SAFETY: null settings are allowed, and the output pointer leads to a live local variable.
    ok(unsafe { palpate_scene_create(null(), &mut scene) });
    scene
}

fn add_surface(scene: *mut palpate_scene, name: &CStr, (v, t): &(Vec<DVec3>, Vec<[u32; 3]>)) -> palpate_status {
    // SAFETY: the arrays have the lengths that are passed, and a `DVec3` is three `f64` without padding.
    unsafe { palpate_scene_add_surface(scene, name.as_ptr(), v.as_ptr().cast(), v.len(), t.as_ptr().cast(), t.len()) }
}

fn add_layer(scene: *mut palpate_scene, name: &CStr, (n, t): &(Vec<DVec3>, Vec<[u32; 4]>)) -> palpate_status {
    // SAFETY: the arrays have the lengths that are passed, and a `DVec3` is three `f64` without padding.
    unsafe { palpate_scene_add_layer(scene, name.as_ptr(), n.as_ptr().cast(), n.len(), t.as_ptr().cast(), t.len()) }
}

fn add_body(scene: *mut palpate_scene, body: &palpate_body) -> palpate_status {
    // SAFETY: the struct is live during the call, and `index` may be null.
    unsafe { palpate_scene_add_body(scene, body, null_mut()) }
}

fn set_tool(scene: *mut palpate_scene, tool: &palpate_tool) -> palpate_status {
    // SAFETY: the struct is live during the call.
    unsafe { palpate_scene_set_tool(scene, tool) }
}

fn parsed(text: &str, folder: &Path) -> *mut palpate_scene {
    let (text, folder) = (CString::new(text).unwrap(), CString::new(folder.to_str().unwrap()).unwrap());
    let mut scene = null_mut();
    // SAFETY: the strings are terminated by a zero byte, and the output pointer leads to a live local variable.
    ok(unsafe { palpate_scene_parse(text.as_ptr(), folder.as_ptr(), &mut scene) });
    scene
}

/// Makes a simulation of the scene, does its steps, and destroys scene and simulation. Returns the bits of the force
/// and torque on the tool at each step, and of the node positions of the first `bodies` bodies at the end. Fails if
/// there is no force at the end.
fn felt(scene: *mut palpate_scene, bodies: u32) -> Vec<u64> {
    let (bits, has_force) = stepped(scene, bodies);
    assert!(has_force, "the tool felt no force at the end");
    bits
}

/// Does what [`felt`] does, but returns also whether there is a force at the end, and does not fail without a force.
fn stepped(scene: *mut palpate_scene, bodies: u32) -> (Vec<u64>, bool) {
    let (mut context, mut simulation): (*mut palpate_context, _) = (null_mut(), null_mut());
    let mut wrench: palpate_wrench = zeros::<palpate_wrench>();
    let mut bits = Vec::new();
    // SAFETY: the output pointers lead to live memory of sufficient size; the library checks handles.
    unsafe {
        ok(palpate_context_create(null(), &mut context));
        ok(palpate_simulation_create(context, scene, &mut simulation));
        ok(palpate_scene_destroy(scene));
        for step in 0..STEPS {
            let position = [0.0, 0.0702 - 5e-3 * (step as f64 / 10.0).min(1.0), 0.0];
            let pose = palpate_pose { position, orientation: [0.0, 0.0, 0.0, 1.0] };
            ok(palpate_step(simulation, &pose, &mut wrench));
            bits.extend(wrench.force.iter().chain(&wrench.torque).map(|x| x.to_bits()));
        }
        for body in 0..bodies {
            let mut count = 0;
            ok(palpate_nodes(simulation, body, null_mut(), 0, &mut count));
            let mut nodes = vec![[0.0; 3]; count];
            ok(palpate_nodes(simulation, body, nodes.as_mut_ptr(), count, &mut count));
            bits.extend(nodes.iter().flatten().map(|x| x.to_bits()));
        }
        ok(palpate_simulation_destroy(simulation));
        ok(palpate_context_destroy(context));
    }
    (bits, wrench.force.iter().any(|x| x.abs() > 1e-3))
}

/// The tool: a sphere above the middle of the bodies, which the haptic device presses down.
fn presser() -> palpate_tool {
    palpate_tool {
        sphere: 0.02,
        mass: 0.05,
        position: [0.0, 0.0702, 0.0],
        stiffness: 500.0,
        damping: 2.0,
        angular_stiffness: 0.5,
        angular_damping: 0.002,
        ..zeros()
    }
}

const COUPLING: &str =
    "[coupling]\nstiffness = 500.0\ndamping = 2.0\nangular_stiffness = 0.5\nangular_damping = 0.002\n";
const SPHERE: &str = "[tool]\nsphere = 0.02\nmass = 0.05\nposition = [0.0, 0.0702, 0.0]\n";

/// Returns a body that has a soft material, but no name and no shape yet.
fn soft() -> palpate_body {
    palpate_body { young: 2e4, poisson: 0.45, density: 1000.0, damping_stiffness: 1e-3, ..zeros() }
}

const SOFT: &str = "material = { young = 2e4, poisson = 0.45, density = 1000.0, damping_stiffness = 1e-3 }\n";

/// Returns a soft block with these rigid cores.
fn block(cores: &[palpate_core]) -> palpate_body {
    palpate_body {
        name: c"block".as_ptr(),
        box_low: [-0.05, -0.01, -0.05],
        box_high: [0.05, 0.05, 0.05],
        box_cells: [6, 4, 6],
        cores: cores.as_ptr(),
        core_count: cores.len(),
        ..soft()
    }
}

/// Returns a fixed rigid core to which the nodes at the bottom of the block are attached.
fn bottom() -> palpate_core {
    palpate_core { name: c"bottom".as_ptr(), box_low: [-0.06, -0.02, -0.06], box_high: [0.06, -0.009, 0.06], ..zeros() }
}

#[test]
fn a_box_built_by_calls_is_the_box_of_the_text() {
    let text = format!(
        "[step]\ndt = 0.002\ngravity = [0.0, -3.7, 0.1]\nnewton = 2\n[contact]\nfriction = 0.4\n[solver]\ntolerance = 1e-6\n\
         [[body]]\nname = \"block\"\nlayer = {{ box = [[-0.05, -0.01, -0.05], [0.05, 0.05, 0.05]], cells = [6, 4, 6] }}\n\
         {SOFT}[[body.core]]\nname = \"bottom\"\nmotion = \"driven\"\n\
         keys = [[0.0, 0.0, 0.005, 0.0], [0.5, 0.002, 0.005, 0.001, 0.0, 0.6, 0.0, 0.8]]\n\
         bind = {{ box = [[-0.06, -0.02, -0.06], [0.06, -0.009, 0.06]] }}\n{SPHERE}{COUPLING}"
    );
    let told = felt(parsed(&text, Path::new("")), 1);
    let turned = |orientation| palpate_pose { position: [0.002, 0.005, 0.001], orientation };
    let start = palpate_pose { position: [0.0, 0.005, 0.0], orientation: [0.0; 4] };
    let built = |friction: f64, end: [f64; 4]| {
        let settings =
            palpate_settings { newton: 2, dt: 0.002, gravity: [0.0, -3.7, 0.1], tolerance: 1e-6, friction, ..zeros() };
        let keys = [palpate_key { time: 0.0, pose: start }, palpate_key { time: 0.5, pose: turned(end) }];
        let core = palpate_core { motion: PALPATE_MOTION_DRIVEN, keys: keys.as_ptr(), key_count: 2, ..bottom() };
        let mut scene = null_mut();
        // SAFETY: the settings and the output variable are live local variables.
        ok(unsafe { palpate_scene_create(&settings, &mut scene) });
        ok(set_tool(scene, &presser()));
        ok(add_body(scene, &block(&[core])));
        felt(scene, 1)
    };
    assert_eq!(built(0.4, [0.0, 0.6, 0.0, 0.8]), told);
    // The comparison above can fail: with another friction coefficient or another last keyframe the bits differ.
    assert_ne!(built(0.3, [0.0, 0.6, 0.0, 0.8]), told);
    assert_ne!(built(0.4, [0.0, 0.8, 0.0, 0.6]), told);
}

/// Writes an OBJ file. Numbers printed by the format `{:?}` are read back to the same bits.
fn write_obj(file: &Path, (vertices, triangles): &(Vec<DVec3>, Vec<[u32; 3]>)) {
    let vertex = |v: &DVec3| format!("v {:?} {:?} {:?}\n", v.x, v.y, v.z);
    let face = |t: &[u32; 3]| format!("f {} {} {}\n", t[0] + 1, t[1] + 1, t[2] + 1);
    std::fs::write(file, vertices.iter().map(vertex).chain(triangles.iter().map(face)).collect::<String>()).unwrap();
}

fn write_tetgen(file: &Path, (nodes, tetrahedra): &(Vec<DVec3>, Vec<[u32; 4]>)) {
    let node = |(k, x): (usize, &DVec3)| format!("{k} {:?} {:?} {:?}\n", x.x, x.y, x.z);
    let element = |(k, t): (usize, &[u32; 4])| format!("{k} {} {} {} {}\n", t[0], t[1], t[2], t[3]);
    let nodes = format!("{} 3 0 0\n", nodes.len()) + &nodes.iter().enumerate().map(node).collect::<String>();
    let elements = format!("{} 4 0\n", tetrahedra.len());
    let elements = elements + &tetrahedra.iter().enumerate().map(element).collect::<String>();
    std::fs::write(file.with_extension("node"), nodes).unwrap();
    std::fs::write(file.with_extension("ele"), elements).unwrap();
}

/// Makes a ball with one triangle turned inside out. The preparation of the body repairs this defect.
fn ball(radius: f64) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let (vertices, mut triangles) = sphere::icosphere(radius);
    triangles[7].swap(0, 1);
    (vertices, triangles)
}

/// Makes a tetrahedral mesh of a cube around a ball of this radius, with one inverted tetrahedron and one node that no
/// tetrahedron uses.
fn cube(radius: f64) -> (Vec<DVec3>, Vec<[u32; 4]>) {
    let made = layer::kuhn_box(DVec3::splat(-1.1 * radius), DVec3::splat(1.1 * radius), [5, 5, 5]);
    let (mut nodes, mut tetrahedra) = (made.nodes, made.tetrahedra);
    tetrahedra[3].swap(0, 1);
    nodes.push(DVec3::ONE);
    (nodes, tetrahedra)
}

#[test]
#[ignore = "long: 9 s"]
fn bodies_from_arrays_are_those_from_files() {
    let folder = tempfile::tempdir().unwrap();
    let (skin, hand, inside) = (ball(0.05), ball(0.02), cube(0.05));
    write_obj(&folder.path().join("skin.obj"), &skin);
    write_obj(&folder.path().join("hand.obj"), &hand);
    write_tetgen(&folder.path().join("inside.node"), &inside);
    let held = "[[body.core]]\nname = \"held\"\nbind = { sphere = [0.0, 0.0, 0.0, 0.02] }\n";
    let tool = "[tool]\nsurface = \"hand.obj\"\nmass = 0.05\nposition = [0.0, 0.0702, 0.0]\n";
    let core = palpate_core { name: c"held".as_ptr(), sphere_radius: 0.02, ..zeros() };
    let body = palpate_body { name: c"ball".as_ptr(), cores: &core, core_count: 1, ..soft() };
    let hand_tool = palpate_tool { sphere: 0.0, surface: c"hand".as_ptr(), ..presser() };
    let built = |skin: &_, hand: &_, inside: &_, body: &palpate_body| {
        let scene = empty();
        ok(add_surface(scene, c"skin", skin));
        ok(add_surface(scene, c"hand", hand));
        ok(add_layer(scene, c"inside", inside));
        ok(add_body(scene, body));
        ok(set_tool(scene, &hand_tool));
        felt(scene, 1)
    };
    let (skin_name, layer_name) = (c"skin".as_ptr(), c"inside".as_ptr());
    let bodies = [
        ("surface = \"skin.obj\"\nlayer = { across = 6 }", palpate_body { surface: skin_name, across: 6, ..body }),
        (
            "surface = \"skin.obj\"\nlayer = \"inside.node\"",
            palpate_body { surface: skin_name, layer: layer_name, ..body },
        ),
        ("layer = \"inside.node\"", palpate_body { layer: layer_name, ..body }),
    ];
    for (keys, body) in &bodies {
        let text = format!("[[body]]\nname = \"ball\"\n{keys}\n{SOFT}{held}{tool}{COUPLING}");
        let told = felt(parsed(&text, folder.path()), 1);
        assert_eq!(
            built(&skin, &hand, &inside, body),
            told,
            "bits of the built scene (left) and of the scene file with `{keys}` (right)"
        );
        // The comparison above can fail: coordinates that are off by a micrometre, in the surface of the tool or in the
        // meshes of the body, change the bits.
        let mut spoiled = hand.clone();
        spoiled.0[0] += DVec3::splat(1e-6);
        assert_ne!(
            built(&skin, &spoiled, &inside, body),
            told,
            "a tool with a moved vertex gave equal bits; body with `{keys}`"
        );
        let mut spoiled = (skin.clone(), inside.clone());
        spoiled.0.0[0] += DVec3::splat(1e-6);
        spoiled.1.0[0] += DVec3::splat(1e-6);
        assert_ne!(
            built(&spoiled.0, &hand, &spoiled.1, body),
            told,
            "a body with a moved vertex and a moved node gave equal bits; body with `{keys}`"
        );
    }
}

#[test]
fn a_rigid_body_from_arrays_and_tables_from_a_text_go_together() {
    let folder = tempfile::tempdir().unwrap();
    write_obj(&folder.path().join("skin.obj"), &ball(0.05));
    let rest = "[contact]\nfriction = 0.2\n[[body]]\nname = \"floor\"\nplane = [0.0, 1.0, 0.0, -0.05]\n";
    let text = format!(
        "[[body]]\nname = \"thing\"\nsurface = \"skin.obj\"\nmotion = \"dynamic\"\nmass = 0.3\nvelocity = [0.1, 0.0, 0.0]\n\
         {rest}{SPHERE}{COUPLING}"
    );
    let told = felt(parsed(&text, folder.path()), 1);
    let built = |mass: f64| {
        let scene = empty();
        ok(add_surface(scene, c"skin", &ball(0.05)));
        let body = palpate_body {
            name: c"thing".as_ptr(),
            surface: c"skin".as_ptr(),
            motion: PALPATE_MOTION_DYNAMIC,
            velocity: [0.1, 0.0, 0.0],
            mass,
            ..zeros()
        };
        ok(add_body(scene, &body));
        // SAFETY: the string is terminated by a zero byte; the library checks the handle.
        ok(unsafe { palpate_scene_add(scene, CString::new(rest).unwrap().as_ptr()) });
        ok(set_tool(scene, &presser()));
        felt(scene, 1)
    };
    assert_eq!(built(0.3), told);
    assert_ne!(built(0.31), told);
}

#[test]
fn a_body_with_a_list_of_none_is_not_felt() {
    let force = |with_list: bool| {
        let scene = empty();
        let cores = [bottom()];
        ok(add_body(scene, &block(&cores)));
        ok(set_tool(scene, &presser()));
        if with_list {
            // SAFETY: the pointer to the list is not null, and the library reads no element, because the count is 0.
            ok(unsafe { palpate_scene_set_collides(scene, 0, [null()].as_ptr(), 0) });
        }
        stepped(scene, 1).1
    };
    assert!(force(false) && !force(true));
}

#[test]
fn a_scene_from_a_file_takes_more() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scene.toml");
    std::fs::write(&file, format!("{SPHERE}{COUPLING}")).unwrap();
    let mut scene = null_mut();
    // SAFETY: the string is terminated by a zero byte, and the output pointer leads to a live local variable.
    ok(unsafe { palpate_scene_load(CString::new(file.to_str().unwrap()).unwrap().as_ptr(), &mut scene) });
    let mut index = 7;
    let cores = [bottom()];
    // SAFETY: the struct and the output variable are live during the call.
    ok(unsafe { palpate_scene_add_body(scene, &block(&cores), &mut index) });
    assert_eq!(index, 0);
    let built = empty();
    ok(set_tool(built, &presser()));
    ok(add_body(built, &block(&cores)));
    assert_eq!(felt(scene, 1), felt(built, 1));
}
