//! Tests of the preparation of bodies with a progress callback, which may cancel it. To prepare a body is to make its
//! tetrahedral simulation mesh and its collision proxies (convex hulls); this has several stages.

use super::*;

/// Data of the progress callback: the scene in preparation; a record of the callback's calls (`seen`: body, stage,
/// number of bodies that are ready, and number of all bodies); and the number of calls after which it cancels (`most`).
struct Watcher {
    scene: *mut palpate_scene,
    seen: Vec<(String, String, u32, u32)>,
    most: usize,
}

/// The progress callback: checks that a call on the scene in preparation is refused as busy, and records its own call.
unsafe extern "C" fn watch(user: *mut c_void, body: *const c_char, stage: *const c_char, done: u32, total: u32) -> i32 {
    // SAFETY: `user` is the `Watcher` that the test passed, and both texts are terminated by a zero byte.
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
    let (home, radius) = (tempfile::tempdir().unwrap(), 0.05);
    let folder = CString::new(home.path().to_str().unwrap()).unwrap();
    // SAFETY: the string is terminated by a zero byte; the library checks the handle.
    ok(unsafe { palpate_scene_cache(scene, folder.as_ptr()) });
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
        // SAFETY: `watcher`, which the callback uses, outlives the call.
        let status = unsafe { palpate_scene_prepare(scene, Some(watch), (&raw mut watcher).cast()) };
        (status, watcher.seen)
    };
    let (status, seen) = prepare(4);
    refused(status, Cancelled, "the callback cancelled the preparation before stage `repair` of `ball`");
    assert_eq!(seen.len(), 5);
    let (status, seen) = prepare(usize::MAX);
    ok(status);
    let stages = |of: &str| -> Vec<&str> {
        let mut stages: Vec<&str> = seen.iter().filter(|s| s.0 == of).map(|s| s.1.as_str()).collect();
        stages.dedup();
        stages
    };
    assert_eq!(stages("ball"), ["cache", "read", "repair", "layer", "embed", "proxies", "cache", "bind", "ready"]);
    assert!(stages("tool").starts_with(&["cache"]) && stages("tool").ends_with(&["ready"]));
    let before = |name: &str| ["floor", "ball", "tool"].iter().position(|other| *other == name).unwrap() as u32;
    let counts = |(name, stage, done, total): &(String, String, u32, u32)| {
        *total == 3 && *done == before(name) + u32::from(stage == "ready")
    };
    assert!(seen.iter().all(counts), "numbers of bodies that are ready: {seen:?}");
    // All bodies are ready now, so the callback is not called until another body is added.
    assert_eq!(prepare(0), (palpate_status::Ok, Vec::new()));
    ok(add_body(scene, &palpate_body { name: c"other".as_ptr(), ..body }));
    let (status, seen) = prepare(usize::MAX);
    ok(status);
    assert!(
        seen.iter().all(|s| s.0 == "other" || s.0 == "tool") && seen.iter().any(|s| s.0 == "other"),
        "only calls about `other` and the tool expected; calls of the callback: {seen:?}"
    );
    // A scene that was prepared by several calls gives the same simulation as a scene that is prepared by one call. The
    // callback may be null.
    let again = empty();
    ok(add_surface(again, c"skin", &ball(radius)));
    ok(add_body(again, &floor));
    ok(add_body(again, &body));
    ok(add_body(again, &palpate_body { name: c"other".as_ptr(), ..body }));
    ok(set_tool(again, &palpate_tool { sphere: 0.0, surface: c"skin".as_ptr(), ..presser() }));
    // SAFETY: a null callback is allowed; the library checks the handle.
    ok(unsafe { palpate_scene_prepare(again, None, null_mut()) });
    assert_eq!(felt(scene, 3), felt(again, 3));
}

/// Makes a scene of one soft ball of this radius, sets its cache folder (which keeps prepared bodies), prepares it, and
/// returns the stages that the callback received.
fn stages_with(folder: Option<&CStr>, radius: f64) -> Vec<String> {
    let scene = empty();
    ok(add_surface(scene, c"skin", &ball(radius)));
    let body = palpate_body { name: c"ball".as_ptr(), surface: c"skin".as_ptr(), across: 5, ..soft() };
    ok(add_body(scene, &body));
    let folder = folder.map_or(null(), CStr::as_ptr);
    let mut watcher = Watcher { scene, seen: Vec::new(), most: usize::MAX };
    // SAFETY (all calls in this block): the pointer `folder` leads to a string or is null, and `watcher`, which the
    // callback uses, outlives the call.
    unsafe {
        ok(palpate_scene_cache(scene, folder));
        ok(palpate_scene_prepare(scene, Some(watch), (&raw mut watcher).cast()));
        ok(palpate_scene_destroy(scene));
    }
    watcher.seen.into_iter().map(|seen| seen.1).collect()
}

#[test]
fn prepared_bodies_are_kept_where_a_folder_is_named_and_nowhere_else() {
    let home = tempfile::tempdir().unwrap();
    let folder = CString::new(home.path().join("kept").to_str().unwrap()).unwrap();
    let is_made = |stages: Vec<String>| stages.iter().any(|stage| stage == "layer");
    assert!(is_made(stages_with(None, 0.05)));
    assert!(is_made(stages_with(None, 0.05)), "without a cache folder the ball was not made again");
    assert!(!home.path().join("kept").exists());
    assert!(is_made(stages_with(Some(&folder), 0.05)));
    assert!(!is_made(stages_with(Some(&folder), 0.05)), "the ball was made again, although the cache folder has it");
    assert!(is_made(stages_with(Some(&folder), 0.06)), "a ball of another radius was taken from the cache folder");
}

#[test]
fn a_context_refuses_what_it_cannot_be_told() {
    for (wrong, words) in [
        (palpate_context_options { measure: 2, ..zeros() }, "palpate_context_options.measure is 2; give 0 or 1"),
        (palpate_context_options { threads: -2, ..zeros() }, "palpate_context_options.threads is -2; give -1, 0"),
        (palpate_context_options { validation: 7, ..zeros() }, "palpate_context_options.validation is 7; give 0 or 1"),
    ] {
        let mut none = null_mut();
        // SAFETY: the options and the output variable are live local variables.
        refused(unsafe { palpate_context_create(&wrong, &mut none) }, Argument, words);
        assert!(none.is_null());
    }
}

/// What the callback of [`palpate_simulation_create_with_progress`] was told of GPU kernels, and the number of them
/// after which it cancels.
struct Kernels {
    seen: Vec<(String, u32, u32)>,
    most: u32,
}

unsafe extern "C" fn count(user: *mut c_void, _: *const c_char, stage: *const c_char, done: u32, total: u32) -> i32 {
    // SAFETY: `user` is the `Kernels` that the test passed, and the text is terminated by a zero byte.
    let (kernels, stage) = unsafe { (&mut *user.cast::<Kernels>(), CStr::from_ptr(stage).to_str().unwrap()) };
    kernels.seen.push((stage.into(), done, total));
    i32::from(stage == "kernels" && done >= kernels.most)
}

#[test]
fn making_a_simulation_tells_of_kernels_once_and_ends_where_the_callback_wants() {
    let scene = empty();
    ok(add_surface(scene, c"skin", &ball(0.05)));
    ok(add_body(scene, &palpate_body { name: c"ball".as_ptr(), surface: c"skin".as_ptr(), across: 5, ..soft() }));
    ok(set_tool(scene, &presser()));
    let mut context = null_mut();
    // SAFETY: null options are allowed, and the output pointer leads to a live local variable.
    ok(unsafe { palpate_context_create(null(), &mut context) });
    let make = |most| {
        let (mut simulation, mut kernels) = (null_mut(), Kernels { seen: Vec::new(), most });
        let user = (&raw mut kernels).cast();
        // SAFETY: `kernels`, which the callback uses, outlives the call; the library checks handles.
        let status =
            unsafe { palpate_simulation_create_with_progress(context, scene, Some(count), user, &mut simulation) };
        (status, simulation, kernels.seen)
    };
    let compiled = |seen: &[(String, u32, u32)]| -> Vec<(u32, u32)> {
        seen.iter().filter(|(stage, ..)| stage == "kernels").map(|(_, done, total)| (*done, *total)).collect()
    };
    let (status, simulation, seen) = make(3);
    refused(status, Cancelled, "the callback cancelled the work after 3 GPU kernels");
    assert!(simulation.is_null());
    assert!(seen.iter().any(|(stage, done, total)| stage == "ready" && *done == 1 && *total == 2), "{seen:?}");
    assert_eq!(compiled(&seen), [(0, 0), (1, 0), (2, 0), (3, 0)]);
    let (status, first, seen) = make(u32::MAX);
    ok(status);
    let rest = compiled(&seen).len();
    assert!(rest > 10, "only {rest} kernels were compiled");
    let (status, second, seen) = make(u32::MAX);
    ok(status);
    assert_eq!(compiled(&seen), [], "a second simulation of the same body compiles nothing");
    ok(palpate_simulation_destroy(first));
    ok(palpate_simulation_destroy(second));
    ok(palpate_scene_destroy(scene));
    ok(palpate_context_destroy(context));
}
