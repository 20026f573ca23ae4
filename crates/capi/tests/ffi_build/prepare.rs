//! Preparing with somebody watching, who may end it.

use super::*;

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
