//! Tests of wrong values in calls that build a scene: each is refused with a message that names the value, and changes
//! nothing.

use super::*;

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
        (palpate_body { cell: 0.1, ..good }, "`body.block.layer.box`: given together with `cell`"),
        (palpate_body { layer: c"inside".as_ptr(), ..good }, "`body.block.layer.box`"),
        (
            palpate_body {
                layer: c"outside".as_ptr(),
                box_low: [0.0; 3],
                box_high: [0.0; 3],
                box_cells: [0; 3],
                ..good
            },
            "there is no mesh \"outside\" in memory; ",
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
        (palpate_body { key_count: usize::MAX / 64, keys: std::ptr::dangling(), ..good }, "more than fit into memory"),
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
        (palpate_core { all: 1, ..bottom() }, "`body.block.core.bottom.bind.all`: given together with `box`"),
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
        (palpate_tool { surface: c"skin".as_ptr(), ..tool }, "given together with `sphere`"),
        (palpate_tool { mass: 0.0, ..tool }, "`tool.mass`: missing"),
        (palpate_tool { stiffness: -1.0, ..tool }, "`coupling.stiffness`: is -1.0"),
        (palpate_tool { strict: 7, ..tool }, "palpate_tool.strict is 7"),
    ] {
        refused(set_tool(scene, &wrong), Argument, words);
    }
    wrong_arrays(scene, &skin, &inside);
    // SAFETY (all calls in this block): each pointer is null, which the library must refuse, or leads to live memory;
    // the library checks handles.
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
    // The refused calls must have added nothing: the scene must still be empty, and after a tool and a body are added,
    // it must give the same bits as a new scene with the same tool and body.
    let mut context = null_mut();
    // SAFETY: the output pointers lead to live local variables.
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

/// Tries wrong lists of collision partners (names of the bodies with which a body collides) in a scene of one body and
/// a tool. The last call, with a right list, leaves the contacts of the scene as they are.
fn wrong_partners(scene: *mut palpate_scene) {
    let names = [c"tool".as_ptr(), c"nobody".as_ptr(), null()];
    let collides = |body, first: usize, count| {
        // SAFETY: from index `first` on, the array has at least `count` pointers, each to a string or null.
        unsafe { palpate_scene_set_collides(scene, body, names[first..].as_ptr(), count) }
    };
    refused(collides(0, 0, 2), Argument, "`body.block.collides`: there is no body \"nobody\"");
    refused(collides(0, 2, 1), Null, "names[..] is null");
    refused(collides(1, 0, 1), Argument, "`body`: is 1; the scene has 1");
    // SAFETY: the pointer to the names is null, which the library must refuse before it reads a name.
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
    refused(surface(0.0, count as u32), Argument, &format!("triangle 5 names point {count}, but there are {count}"));
    refused(surface(0.0, u32::MAX), Argument, "triangle 5 names point 4294967295");
    refused(add_surface(scene, c"wrong", &(Vec::new(), skin.1.clone())), Argument, "vertex count is 0");
    refused(add_surface(scene, c"wrong", &(skin.0.clone(), Vec::new())), Argument, "triangle count is 0");
    refused(
        add_surface(scene, c"wrong", &(vec![DVec3::ZERO; 3], vec![[0, 1, 2]])),
        Argument,
        "no triangle has any area",
    );
    refused(add_surface(scene, c"skin", skin), Argument, "the name is already taken");
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
    refused(add_layer(scene, c"wrong", &twice), Argument, "tetrahedron 1 repeats tetrahedron 0");
    refused(add_layer(scene, c"inside", inside), Argument, "the name is already taken");
    let (numbers, indices) = ([0.0; 9], [0, 1, 2]);
    let raw = |vertices, count, triangles, many| {
        // SAFETY: in each of these calls an array is null or misaligned, or its count is too large; the library must
        // refuse the call before it reads an element.
        unsafe { palpate_scene_add_surface(scene, c"wrong".as_ptr(), vertices, count, triangles, many) }
    };
    refused(raw(null(), 3, indices.as_ptr(), 1), Null, "vertices is null");
    refused(raw(numbers.as_ptr(), 3, null(), 1), Null, "triangles is null");
    refused(raw(numbers.as_ptr(), usize::MAX, indices.as_ptr(), 1), Argument, "vertices has 18446744073709551615");
    refused(raw(numbers.as_ptr(), 3, indices.as_ptr(), usize::MAX / 12 + 2), Argument, "more than fit into memory");
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
        // SAFETY: the settings and the output variable are live local variables.
        refused(unsafe { palpate_scene_create(&wrong, &mut none) }, Argument, words);
        assert!(none.is_null() || words.contains("size"));
    }
    // SAFETY: the settings are a live local variable; the output pointer is null, which the library must refuse.
    refused(unsafe { palpate_scene_create(&good, null_mut()) }, Null, "scene is null");
}
