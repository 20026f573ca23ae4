//! The C ABI's scenes built by calls: they are what files say, bit for bit; wrong values are told by name and change nothing.
#![allow(unsafe_code)]

use std::ffi::{CStr, CString, c_char, c_void};
use std::path::Path;
use std::ptr::{null, null_mut};

use glam::DVec3;
use palpate::ffi::build::{
    palpate_scene_add, palpate_scene_add_body, palpate_scene_add_layer, palpate_scene_add_surface,
    palpate_scene_create, palpate_scene_prepare, palpate_scene_set_collides, palpate_scene_set_tool,
};
use palpate::ffi::context::{palpate_context, palpate_context_create, palpate_context_destroy};
use palpate::ffi::describe::*;
use palpate::ffi::scene::{palpate_scene, palpate_scene_destroy, palpate_scene_load, palpate_scene_parse};
use palpate::ffi::simulation::{
    palpate_nodes, palpate_pose, palpate_simulation_create, palpate_simulation_destroy, palpate_step, palpate_wrench,
};
use palpate::ffi::status::{palpate_last_error, palpate_status};
use palpate::prepare::{layer, sphere};
use palpate_status::{Argument, Busy, Cancelled, Handle, Input, Null};

/// Steps that are compared.
const STEPS: usize = 25;

fn last_error() -> String {
    // SAFETY: never null, and ends in a zero.
    unsafe { CStr::from_ptr(palpate_last_error()) }.to_str().unwrap().into()
}

#[track_caller]
fn ok(status: palpate_status) {
    assert_eq!(status, palpate_status::Ok, "{}", last_error());
}

#[track_caller]
fn refused(status: palpate_status, expected: palpate_status, words: &str) {
    let error = last_error();
    assert_eq!(status, expected, "{error}");
    assert!(error.contains(words) && error.lines().count() == 1, "{error}");
}

/// A struct of zeros that knows its size.
fn zeros<T: Copy>() -> T {
    // SAFETY: used for structs of numbers and pointers that begin with a `u32` of their size.
    unsafe {
        let mut made: T = std::mem::zeroed();
        (&raw mut made).cast::<u32>().write(size_of::<T>() as u32);
        made
    }
}

/// A scene of nothing with the usual settings.
fn empty() -> *mut palpate_scene {
    let mut scene = null_mut();
    // SAFETY: no settings, and a place for the answer.
    ok(unsafe { palpate_scene_create(null(), &mut scene) });
    scene
}

fn add_surface(scene: *mut palpate_scene, name: &CStr, (v, t): &(Vec<DVec3>, Vec<[u32; 3]>)) -> palpate_status {
    // SAFETY: arrays of their lengths; vectors are three numbers each.
    unsafe { palpate_scene_add_surface(scene, name.as_ptr(), v.as_ptr().cast(), v.len(), t.as_ptr().cast(), t.len()) }
}

fn add_layer(scene: *mut palpate_scene, name: &CStr, (n, t): &(Vec<DVec3>, Vec<[u32; 4]>)) -> palpate_status {
    // SAFETY: arrays of their lengths; vectors are three numbers each.
    unsafe { palpate_scene_add_layer(scene, name.as_ptr(), n.as_ptr().cast(), n.len(), t.as_ptr().cast(), t.len()) }
}

fn add_body(scene: *mut palpate_scene, body: &palpate_body) -> palpate_status {
    // SAFETY: a struct, and nobody wants the index.
    unsafe { palpate_scene_add_body(scene, body, null_mut()) }
}

fn set_tool(scene: *mut palpate_scene, tool: &palpate_tool) -> palpate_status {
    // SAFETY: a struct.
    unsafe { palpate_scene_set_tool(scene, tool) }
}

fn parsed(text: &str, folder: &Path) -> *mut palpate_scene {
    let (text, folder) = (CString::new(text).unwrap(), CString::new(folder.to_str().unwrap()).unwrap());
    let mut scene = null_mut();
    // SAFETY: strings, and a place for the answer.
    ok(unsafe { palpate_scene_parse(text.as_ptr(), folder.as_ptr(), &mut scene) });
    scene
}

/// Bits of force and torque of each step, and of the nodes at the end, of all `bodies`; lets go of the scene.
fn felt(scene: *mut palpate_scene, bodies: u32) -> Vec<u64> {
    let (bits, has_force) = stepped(scene, bodies);
    assert!(has_force, "nothing is felt");
    bits
}

/// The same, and whether there is a force at the end.
fn stepped(scene: *mut palpate_scene, bodies: u32) -> (Vec<u64>, bool) {
    let (mut context, mut simulation): (*mut palpate_context, _) = (null_mut(), null_mut());
    let mut wrench: palpate_wrench = zeros::<palpate_wrench>();
    let mut bits = Vec::new();
    // SAFETY: handles, and places for answers that are large enough.
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

/// What presses: a sphere above the middle.
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

/// Soft material, without a name yet.
fn soft() -> palpate_body {
    palpate_body { young: 2e4, poisson: 0.45, density: 1000.0, damping_stiffness: 1e-3, ..zeros() }
}

const SOFT: &str = "material = { young = 2e4, poisson = 0.45, density = 1000.0, damping_stiffness = 1e-3 }\n";

/// A block that stands on what is held.
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
        // SAFETY: settings, and a place for the answer.
        ok(unsafe { palpate_scene_create(&settings, &mut scene) });
        ok(set_tool(scene, &presser()));
        ok(add_body(scene, &block(&[core])));
        felt(scene, 1)
    };
    assert_eq!(built(0.4, [0.0, 0.6, 0.0, 0.8]), told);
    // Any of it matters.
    assert_ne!(built(0.3, [0.0, 0.6, 0.0, 0.8]), told);
    assert_ne!(built(0.4, [0.0, 0.8, 0.0, 0.6]), told);
}

/// Numbers in words that read back as the same.
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

/// A ball with a triangle the wrong way round, which is repaired.
fn ball(radius: f64) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let (vertices, mut triangles) = sphere::icosphere(radius);
    triangles[7].swap(0, 1);
    (vertices, triangles)
}

/// A cube around a ball of this radius, with a tetrahedron inside out and a node of none.
fn cube(radius: f64) -> (Vec<DVec3>, Vec<[u32; 4]>) {
    let made = layer::kuhn_box(DVec3::splat(-1.1 * radius), DVec3::splat(1.1 * radius), [5, 5, 5]);
    let (mut nodes, mut tetrahedra) = (made.nodes, made.tetrahedra);
    tetrahedra[3].swap(0, 1);
    nodes.push(DVec3::ONE);
    (nodes, tetrahedra)
}

#[test]
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
        assert_eq!(built(&skin, &hand, &inside, body), told, "{keys}");
        // A coordinate that is off by a micrometre is felt, in each of the arrays.
        let mut spoiled = hand.clone();
        spoiled.0[0] += DVec3::splat(1e-6);
        assert_ne!(built(&skin, &spoiled, &inside, body), told, "{keys}");
        let mut spoiled = (skin.clone(), inside.clone());
        spoiled.0.0[0] += DVec3::splat(1e-6);
        spoiled.1.0[0] += DVec3::splat(1e-6);
        assert_ne!(built(&spoiled.0, &hand, &spoiled.1, body), told, "{keys}");
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
        // SAFETY: a handle and a string.
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
            // SAFETY: a list of no names.
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
    // SAFETY: a string, and a place for the answer.
    ok(unsafe { palpate_scene_load(CString::new(file.to_str().unwrap()).unwrap().as_ptr(), &mut scene) });
    let mut index = 7;
    let cores = [bottom()];
    // SAFETY: a struct, and a place for the answer.
    ok(unsafe { palpate_scene_add_body(scene, &block(&cores), &mut index) });
    assert_eq!(index, 0);
    let built = empty();
    ok(set_tool(built, &presser()));
    ok(add_body(built, &block(&cores)));
    assert_eq!(felt(scene, 1), felt(built, 1));
}

#[test]
fn wrong_values_are_told_by_name_and_change_nothing() {
    let scene = empty();
    let (skin, inside) = (ball(0.05), cube(0.05));
    ok(add_surface(scene, c"skin", &skin));
    ok(add_layer(scene, c"inside", &inside));
    let (good_core, two) = ([bottom()], [bottom(), bottom()]);
    let good = block(&good_core);
    let core = |wrong: palpate_core| {
        let cores = [wrong];
        add_body(scene, &block(&cores))
    };
    let nan = f64::NAN;
    for (wrong, words) in [
        (palpate_body { young: nan, ..good }, "`body.block.material.young`: is NaN"),
        (palpate_body { young: -1.0, ..good }, "`body.block.material.young`: is -1.0"),
        (palpate_body { density: 0.0, ..good }, "`body.block.material.density`: missing"),
        (palpate_body { poisson: 0.5, ..good }, "`body.block.material.poisson`: is 0.5"),
        (palpate_body { damping_mass: f64::INFINITY, ..good }, "`body.block.material.damping_mass`: is inf"),
        (palpate_body { position: [0.0, nan, 0.0], ..good }, "`body.block.position[1]`: is NaN"),
        (palpate_body { orientation: [0.0, 0.0, 0.0, 2.0], ..good }, "`body.block.orientation`: quaternion"),
        (palpate_body { scale: -2.0, ..good }, "`body.block.scale`: is -2.0"),
        (palpate_body { box_low: [1.0; 3], ..good }, "`body.block.layer.box`"),
        (palpate_body { box_cells: [0, 1, 1], ..good }, "`body.block.layer.cells[0]`: is 0"),
        (palpate_body { box_cells: [u32::MAX; 3], ..good }, "`body.block.layer.cells[0]`: is 4294967295"),
        (palpate_body { cell: 0.1, ..good }, "`body.block.layer.box`: given beside `cell`"),
        (palpate_body { layer: c"inside".as_ptr(), ..good }, "`body.block.layer.box`"),
        (
            palpate_body {
                layer: c"outside".as_ptr(),
                box_low: [0.0; 3],
                box_high: [0.0; 3],
                box_cells: [0; 3],
                ..good
            },
            "no mesh \"outside\" was handed over; ",
        ),
        (palpate_body { surface: c"skim".as_ptr(), ..good }, "did you mean \"skin\""),
        (palpate_body { name: c"a b".as_ptr(), ..good }, "`body[0].name`: \"a b\" cannot be a name"),
        (palpate_body { name: c"tool".as_ptr(), ..good }, "\"tool\" is taken"),
        (palpate_body { motion: 3, ..good }, "palpate_body.motion is 3; give a PALPATE_MOTION_* of 0 to 2"),
        (palpate_body { motion: 2, ..good }, "`body.block.motion`: belongs to a rigid body"),
        (palpate_body { law: u32::MAX, ..good }, "palpate_body.law is 4294967295"),
        (palpate_body { dilatation: 2, ..good }, "palpate_body.dilatation is 2"),
        (palpate_body { strict: 2, ..good }, "palpate_body.strict is 2; give 0 or 1"),
        (palpate_body { strict: 1, ..good }, "`body.block.repair`: has no meaning without a surface"),
        (palpate_body { plane: [0.0, 1.0, 0.0, 0.0], ..good }, "has no meaning for a plane"),
        (palpate_body { hulls: 100_000, ..good }, "`body.block.hulls`: is 100000"),
        (palpate_body { reserved: 1, ..good }, "palpate_body.reserved is 1"),
        (palpate_body { size: 12, ..good }, "palpate_body.size is 12; set it to sizeof(palpate_body)"),
        (palpate_body { core_count: usize::MAX, ..good }, "palpate_body.cores has 18446744073709551615 elements"),
        (palpate_body { cores: two.as_ptr(), core_count: 2, ..good }, "\"bottom\" is taken by another core"),
        (palpate_body { key_count: usize::MAX / 64, keys: std::ptr::dangling(), ..good }, "more than any memory"),
    ] {
        refused(add_body(scene, &wrong), Argument, words);
    }
    refused(add_body(scene, &palpate_body { name: null(), ..good }), Null, "palpate_body.name is null");
    refused(add_body(scene, &palpate_body { cores: null(), ..good }), Null, "palpate_body.cores is null");
    let key = |time| palpate_key { time, pose: palpate_pose { position: [0.0; 3], orientation: [0.0; 4] } };
    let keys = [key(1.0), key(0.5), key(nan)];
    let led = palpate_core { motion: PALPATE_MOTION_DRIVEN, keys: keys.as_ptr(), key_count: 2, ..bottom() };
    let many: Vec<u32> = vec![1, u32::MAX];
    for (wrong, words) in [
        (led, "`body.block.core.bottom.keys[1]`: time 0.5 does not come after 1.0"),
        (palpate_core { keys: &keys[2], key_count: 1, ..led }, "`body.block.core.bottom.keys[0][0]`: is NaN"),
        (palpate_core { key_count: 0, ..led }, "`body.block.core.bottom.keys`: missing"),
        (palpate_core { motion: 0, ..led }, "belongs to motion = \"driven\""),
        (palpate_core { motion: 9, ..bottom() }, "palpate_core.motion is 9"),
        (palpate_core { all: 2, ..bottom() }, "palpate_core.all is 2"),
        (palpate_core { all: 1, ..bottom() }, "`body.block.core.bottom.bind.all`: given beside `box`"),
        (palpate_core { box_low: [0.0; 3], box_high: [0.0; 3], ..bottom() }, "`body.block.core.bottom.bind`: missing"),
        (palpate_core { mass: 1.0, ..bottom() }, "belongs to motion = \"dynamic\""),
        (
            palpate_core { nodes: many.as_ptr(), node_count: 2, box_low: [0.0; 3], box_high: [0.0; 3], ..bottom() },
            "bind.nodes[1]`: is 4294967295",
        ),
        (palpate_core { size: 16, ..bottom() }, "palpate_core.size is 16"),
    ] {
        refused(core(wrong), Argument, words);
    }
    let tool = presser();
    for (wrong, words) in [
        (palpate_tool { sphere: nan, ..tool }, "`tool.sphere`: is NaN"),
        (palpate_tool { sphere: 0.0, ..tool }, "`tool.sphere`: missing; give exactly one of"),
        (palpate_tool { surface: c"skin".as_ptr(), ..tool }, "given beside `sphere`"),
        (palpate_tool { mass: 0.0, ..tool }, "`tool.mass`: missing"),
        (palpate_tool { stiffness: -1.0, ..tool }, "`coupling.stiffness`: is -1.0"),
        (palpate_tool { strict: 7, ..tool }, "palpate_tool.strict is 7"),
    ] {
        refused(set_tool(scene, &wrong), Argument, words);
    }
    wrong_arrays(scene, &skin, &inside);
    // SAFETY (all here): handles, and pointers that are null where that is tried.
    unsafe {
        refused(palpate_scene_add_body(scene, null(), null_mut()), Null, "body is null; give a palpate_body");
        refused(palpate_scene_set_tool(scene, null()), Null, "tool is null");
        refused(palpate_scene_add(scene, null()), Null, "text is null");
        refused(palpate_scene_add(scene, c"[[body]]\nnam = 1".as_ptr()), Input, "scene:2: unknown key");
        refused(palpate_scene_add(scene, c"[drive]\nkeys = [[0, 0, 0, 0]]".as_ptr()), Input, "there is no [tool]");
        refused(palpate_scene_add(null_mut(), c"".as_ptr()), Null, "scene is null");
        refused(add_body(scene.cast::<u8>().wrapping_add(1 << 40).cast(), &good), Handle, "scene was destroyed");
    }
    wrong_settings();
    // None of that is there: the scene is still of nothing, then of this alone.
    let mut context = null_mut();
    // SAFETY: places for answers.
    unsafe {
        ok(palpate_context_create(null(), &mut context));
        let mut none = null_mut();
        refused(palpate_simulation_create(context, scene, &mut none), Input, "neither a body nor a tool");
        assert!(none.is_null());
        ok(palpate_context_destroy(context));
    }
    ok(set_tool(scene, &tool));
    ok(add_body(scene, &good));
    refused(add_body(scene, &good), Argument, "\"block\" is taken");
    let alone = empty();
    ok(set_tool(alone, &tool));
    ok(add_body(alone, &good));
    wrong_partners(scene);
    assert_eq!(felt(scene, 1), felt(alone, 1));
}

/// Of a scene of one body and a tool; it stays as it is.
fn wrong_partners(scene: *mut palpate_scene) {
    let names = [c"tool".as_ptr(), c"nobody".as_ptr(), null()];
    let collides = |body, first: usize, count| {
        // SAFETY: names, or null; as many as are counted.
        unsafe { palpate_scene_set_collides(scene, body, names[first..].as_ptr(), count) }
    };
    refused(collides(0, 0, 2), Argument, "`body.block.collides`: there is no body \"nobody\"");
    refused(collides(0, 2, 1), Null, "names[..] is null");
    refused(collides(1, 0, 1), Argument, "`body`: is 1; the scene has 1");
    // SAFETY: no names.
    refused(unsafe { palpate_scene_set_collides(scene, 0, null(), 1) }, Null, "names is null");
    ok(collides(0, 0, 1));
}

fn wrong_arrays(scene: *mut palpate_scene, skin: &(Vec<DVec3>, Vec<[u32; 3]>), inside: &(Vec<DVec3>, Vec<[u32; 4]>)) {
    let surface = |vertex: f64, index: u32| {
        let mut wrong = skin.clone();
        (wrong.0[3].y, wrong.1[5][2]) = (vertex, index);
        add_surface(scene, c"wrong", &wrong)
    };
    refused(surface(f64::NAN, 0), Argument, "surface \"wrong\": vertex 3 has the coordinate NaN");
    refused(surface(1e31, 0), Argument, "vertex 3 has the coordinate 1e31");
    let count = skin.0.len();
    refused(surface(0.0, count as u32), Argument, &format!("triangle 5 names point {count}, and there are {count}"));
    refused(surface(0.0, u32::MAX), Argument, "triangle 5 names point 4294967295");
    refused(add_surface(scene, c"wrong", &(Vec::new(), skin.1.clone())), Argument, "vertex count is 0");
    refused(add_surface(scene, c"wrong", &(skin.0.clone(), Vec::new())), Argument, "triangle count is 0");
    refused(
        add_surface(scene, c"wrong", &(vec![DVec3::ZERO; 3], vec![[0, 1, 2]])),
        Argument,
        "no triangle has any area",
    );
    refused(add_surface(scene, c"skin", skin), Argument, "there is one of that name");
    refused(add_surface(scene, c"", skin), Argument, "the name is empty");
    let layer = |node: f64, index: u32| {
        let mut wrong = inside.clone();
        (wrong.0[3].y, wrong.1[5][2]) = (node, index);
        add_layer(scene, c"wrong", &wrong)
    };
    refused(layer(f64::INFINITY, 0), Argument, "layer \"wrong\": node 3 has the coordinate inf");
    refused(layer(0.0, 1 << 30), Argument, "tetrahedron 5 names point 1073741824");
    refused(layer(inside.0[3].y, inside.1[5][1]), Argument, "tetrahedron 5 has no volume");
    let twice = (inside.0.clone(), vec![inside.1[0]; 2]);
    refused(add_layer(scene, c"wrong", &twice), Argument, "tetrahedron 1 is tetrahedron 0 again");
    refused(add_layer(scene, c"inside", inside), Argument, "there is one of that name");
    let (numbers, indices) = ([0.0; 9], [0, 1, 2]);
    let raw = |vertices, count, triangles, many| {
        // SAFETY: places that are null, or not looked at before their counts are.
        unsafe { palpate_scene_add_surface(scene, c"wrong".as_ptr(), vertices, count, triangles, many) }
    };
    refused(raw(null(), 3, indices.as_ptr(), 1), Null, "vertices is null");
    refused(raw(numbers.as_ptr(), 3, null(), 1), Null, "triangles is null");
    refused(raw(numbers.as_ptr(), usize::MAX, indices.as_ptr(), 1), Argument, "vertices has 18446744073709551615");
    refused(raw(numbers.as_ptr(), 3, indices.as_ptr(), usize::MAX / 12 + 2), Argument, "more than any memory");
    let odd = numbers.as_ptr().cast::<u8>().wrapping_add(1).cast();
    refused(raw(odd, 2, indices.as_ptr(), 1), Argument, "vertices is not aligned");
}

fn wrong_settings() {
    let good = zeros::<palpate_settings>();
    for (wrong, words) in [
        (palpate_settings { dt: f64::NAN, ..good }, "`step.dt`: is NaN"),
        (palpate_settings { dt: -0.001, ..good }, "`step.dt`: is -0.001"),
        (palpate_settings { newton: 1000, ..good }, "`step.newton`: is 1000"),
        (palpate_settings { tolerance: 2.0, ..good }, "`solver.tolerance`: is 2.0"),
        (palpate_settings { friction: -0.1, ..good }, "`contact.friction`: is -0.1"),
        (palpate_settings { weightless: 2, ..good }, "palpate_settings.weightless is 2"),
        (palpate_settings { weightless: 1, gravity: [0.0, 1.0, 0.0], ..good }, "palpate_settings.weightless is 1"),
        (palpate_settings { size: 0, ..good }, "palpate_settings.size is 0"),
    ] {
        let mut none = std::ptr::dangling_mut();
        // SAFETY: settings, and a place for the answer.
        refused(unsafe { palpate_scene_create(&wrong, &mut none) }, Argument, words);
        assert!(none.is_null() || words.contains("size"));
    }
    // SAFETY: settings.
    refused(unsafe { palpate_scene_create(&good, null_mut()) }, Null, "scene is null");
}

/// What a callback saw, and after how many calls it ends it.
struct Watcher {
    scene: *mut palpate_scene,
    seen: Vec<(String, String, u32, u32)>,
    most: usize,
}

unsafe extern "C" fn watch(user: *mut c_void, body: *const c_char, stage: *const c_char, done: u32, total: u32) -> i32 {
    // SAFETY: what the test passed, and strings.
    let (watcher, [body, stage]) = unsafe {
        let text = |text| CStr::from_ptr(text).to_str().unwrap().to_owned();
        (&mut *user.cast::<Watcher>(), [body, stage].map(text))
    };
    refused(set_tool(watcher.scene, &presser()), Busy, "the scene is in use by another call");
    watcher.seen.push((body, stage, done, total));
    i32::from(watcher.seen.len() > watcher.most)
}

#[test]
fn preparing_tells_its_stages_and_ends_where_the_callback_wants() {
    let scene = empty();
    // A size that nobody has prepared before.
    let radius = 0.05 + 1e-9 * f64::from(std::process::id());
    ok(add_surface(scene, c"skin", &ball(radius)));
    let cores = [palpate_core { name: c"held".as_ptr(), sphere_radius: 0.02, ..zeros() }];
    let body = palpate_body { name: c"ball".as_ptr(), surface: c"skin".as_ptr(), across: 6, ..soft() };
    let body = palpate_body { cores: cores.as_ptr(), core_count: 1, ..body };
    let floor = palpate_body { name: c"floor".as_ptr(), plane: [0.0, 1.0, 0.0, -0.06], ..zeros() };
    ok(add_body(scene, &floor));
    ok(add_body(scene, &body));
    ok(set_tool(scene, &palpate_tool { sphere: 0.0, surface: c"skin".as_ptr(), ..presser() }));
    let prepare = |most| {
        let mut watcher = Watcher { scene, seen: Vec::new(), most };
        // SAFETY: the callback's own.
        let status = unsafe { palpate_scene_prepare(scene, Some(watch), (&raw mut watcher).cast()) };
        (status, watcher.seen)
    };
    let (status, seen) = prepare(3);
    refused(status, Cancelled, "the callback ended it before stage `repair` of `ball`");
    assert_eq!(seen.len(), 4);
    let (status, seen) = prepare(usize::MAX);
    ok(status);
    let stages = |of: &str| -> Vec<&str> {
        let mut stages: Vec<&str> = seen.iter().filter(|s| s.0 == of).map(|s| s.1.as_str()).collect();
        stages.dedup();
        stages
    };
    assert_eq!(stages("ball"), ["cache", "read", "repair", "layer", "embed", "proxies", "cache", "bind"]);
    assert!(stages("tool").starts_with(&["cache"]));
    assert!(seen.iter().all(|(name, _, done, total)| *total == 3 && *done == if name == "tool" { 2 } else { 1 }));
    // All is ready: nothing is told, until there is more.
    assert_eq!(prepare(0), (palpate_status::Ok, Vec::new()));
    ok(add_body(scene, &palpate_body { name: c"other".as_ptr(), ..body }));
    let (status, seen) = prepare(usize::MAX);
    ok(status);
    assert!(seen.iter().all(|s| s.0 == "other" || s.0 == "tool") && seen.iter().any(|s| s.0 == "other"), "{seen:?}");
    // Prepared before or not, it is the same simulation; and null is nobody who watches.
    let again = empty();
    ok(add_surface(again, c"skin", &ball(radius)));
    ok(add_body(again, &floor));
    ok(add_body(again, &body));
    ok(add_body(again, &palpate_body { name: c"other".as_ptr(), ..body }));
    ok(set_tool(again, &palpate_tool { sphere: 0.0, surface: c"skin".as_ptr(), ..presser() }));
    // SAFETY: a handle, and nobody who watches.
    ok(unsafe { palpate_scene_prepare(again, None, null_mut()) });
    assert_eq!(felt(scene, 3), felt(again, 3));
}
