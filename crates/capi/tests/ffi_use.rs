//! Tests of the C ABI, called from Rust as a C program would call it: wrong use is refused and harms nothing, a time
//! step allocates no memory on the CPU, destroyed simulations leave no memory on their context (an opened GPU device),
//! and two threads with a context each do not disturb one another.
#![allow(unsafe_code)]

mod ffi_help;

use std::alloc::{GlobalAlloc, Layout, System};
use std::ffi::{CString, c_char, c_void};
use std::ptr::{null, null_mut};
use std::sync::atomic::{AtomicUsize, Ordering};

use palpate_capi::context::{
    palpate_context, palpate_context_create, palpate_context_destroy, palpate_context_memory, palpate_context_options,
};
use palpate_capi::scene::{palpate_scene, palpate_scene_destroy, palpate_scene_parse};
use palpate_capi::shown::palpate_contact_forces;
use palpate_capi::simulation::{
    palpate_nodes, palpate_pose, palpate_simulation, palpate_simulation_create, palpate_simulation_destroy,
    palpate_step, palpate_step_tools, palpate_stresses, palpate_tool_count, palpate_tool_wrench, palpate_wrench,
};
use palpate_capi::status::palpate_status;

use ffi_help::{DEEP, context, ok, refused, wrench};

/// An allocator that counts the allocations of each thread of this program. The Vulkan driver does not allocate through
/// it.
struct Counted;

thread_local! {
    static COUNT: AtomicUsize = const { AtomicUsize::new(0) };
}

// SAFETY: all calls go to the system's allocator, which fulfils the conditions of `GlobalAlloc`.
unsafe impl GlobalAlloc for Counted {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // While a thread ends, its counter may be gone already.
        let _ = COUNT.try_with(|count| count.fetch_add(1, Ordering::Relaxed));
        // SAFETY: the caller keeps the conditions of `GlobalAlloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller keeps the conditions of `GlobalAlloc`.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counted = Counted;

fn allocations() -> usize {
    COUNT.with(|count| count.load(Ordering::Relaxed))
}

/// Scene text: a block with `cells` cells along x, y and z, fixed at its bottom, and just above it a sphere as the tool
/// (rigid body that the haptic device leads).
fn scene_text(cells: &str) -> CString {
    CString::new(format!(
        "[[body]]\nname = \"block\"\nlayer = {{ box = [[-0.05, -0.03, -0.05], [0.05, 0.03, 0.05]], cells = {cells} }}\n\
         material = {{ young = 2e4, poisson = 0.45, density = 1000.0 }}\n[[body.core]]\nname = \"bottom\"\nmotion = \"fixed\"\n\
         bind = {{ box = [[-0.06, -0.04, -0.06], [0.06, -0.029, 0.06]] }}\n\
         [tool]\nsphere = 0.02\nmass = 0.05\nposition = [0.0, 0.0502, 0.0]\n[coupling]\nstiffness = 500.0\ndamping = 2.0\n\
         angular_stiffness = 0.5\nangular_damping = 0.002\n"
    ))
    .unwrap()
}

fn scene(cells: &str) -> *mut palpate_scene {
    let mut scene = null_mut();
    // SAFETY: the text is terminated by a zero, and the output pointer leads to a live local variable.
    ok(unsafe { palpate_scene_parse(scene_text(cells).as_ptr(), null(), &mut scene) });
    scene
}

fn simulation(context: *mut palpate_context, cells: &str) -> *mut palpate_simulation {
    let (scene, mut simulation) = (scene(cells), null_mut());
    // SAFETY: the output pointer leads to a live local variable; the library itself checks handles (its pointers to
    // contexts, scenes and simulations).
    ok(unsafe { palpate_simulation_create(context, scene, &mut simulation) });
    ok(palpate_scene_destroy(scene));
    simulation
}

#[test]
fn a_step_allocates_nothing_once_it_runs() {
    let context = context();
    let simulation = simulation(context, "[6, 4, 6]");
    let mut wrench = wrench();
    let mut steps = |count: usize| {
        for _ in 0..count {
            // SAFETY: the pose and the output are live local variables; the library checks handles.
            ok(unsafe { palpate_step(simulation, &DEEP, &mut wrench) });
        }
    };
    steps(20);
    let before = allocations();
    steps(50);
    let made = allocations() - before;
    assert_eq!(made, 0, "number of allocations in 50 steps");
    assert!(wrench.force[1] > 0.1 && wrench.step == 70, "wrong step number or force: {wrench:?}");
    // Proof that this test can fail: the counter counts an allocation.
    drop(std::hint::black_box(Box::new(1)));
    assert!(allocations() > before);
    ok(palpate_simulation_destroy(simulation));
    ok(palpate_context_destroy(context));
}

#[test]
fn each_of_two_tools_is_led_and_felt() {
    use palpate_status::{Argument, Null};
    let context = context();
    let (simulation, mut count) = (ffi_help::simulation(context, ffi_help::TWO_TOOLS), 0);
    // SAFETY (this and the blocks below): poses and outputs are live local variables or null, and the library checks
    // handles.
    ok(unsafe { palpate_tool_count(simulation, &mut count) });
    assert_eq!(count, 2);
    let at = |x: f64, y: f64| palpate_pose { position: [x, y, 0.0], orientation: [0.0, 0.0, 0.0, 1.0] };
    let felt = |tool: u32| {
        let mut told = wrench();
        ok(unsafe { palpate_tool_wrench(simulation, tool, &mut told) });
        told
    };
    assert_eq!((felt(1).step, felt(1).force), (0, [0.0; 3]));
    let poses = [at(-0.03, 0.008), at(0.03, 0.006)];
    for _ in 0..200 {
        ok(unsafe { palpate_step_tools(simulation, poses.as_ptr(), 2) });
    }
    // At rest the springs of the couplings press each sphere on the plane.
    for (tool, stiffness) in [(0, 500.0), (1, 1000.0)] {
        let told = felt(tool);
        let pull = stiffness * (told.tool.position[1] - told.device.position[1]);
        assert!(told.step == 200 && told.device.position == poses[tool as usize].position, "tool {tool}: {told:?}");
        assert!(pull > 0.5 && (told.force[1] / pull - 1.0).abs() < 0.01, "tool {tool} is pulled by {pull} N: {told:?}");
    }
    // A step with one pose leads the first tool; the other device stays.
    let mut told = wrench();
    ok(unsafe { palpate_step(simulation, &at(-0.03, 0.007), &mut told) });
    assert_eq!(
        (told.device.position[1], felt(0).device.position[1], felt(1).device.position[1]),
        (0.007, 0.007, 0.006)
    );
    let wrong = [at(0.0, 0.0), palpate_pose { position: [0.0, f64::NAN, 0.0], ..at(0.0, 0.0) }];
    unsafe {
        refused(palpate_step_tools(simulation, poses.as_ptr(), 1), Argument, "count is 1, but the scene has 2 tools");
        refused(palpate_step_tools(simulation, null(), 2), Null, "devices");
        refused(palpate_step_tools(simulation, wrong.as_ptr(), 2), Argument, "devices[1].position[1] is NaN");
        refused(palpate_tool_wrench(simulation, 2, &mut told), Argument, "tool is 2, but the scene has 2 tools");
        refused(palpate_tool_wrench(simulation, 0, null_mut()), Null, "wrench is null");
        refused(palpate_tool_count(simulation, null_mut()), Null, "count");
    }
    assert_eq!(felt(1).step, 201);
    ok(palpate_simulation_destroy(simulation));
    ok(palpate_context_destroy(context));
}

#[test]
fn wrong_use_is_told_and_harms_nothing() {
    use palpate_status::{Argument, Handle, Input, Null, TooSmall};
    let context = context();
    let simulation = simulation(context, "[3, 2, 3]");
    let mut count = 0;
    let mut told = wrench();
    let step = |simulation, pose: &palpate_pose| {
        let mut wrench = wrench();
        // SAFETY: the pose and the output are live local variables; the library checks handles, also the null
        // handle, the handle of a context and the destroyed handle that this test passes.
        unsafe { palpate_step(simulation, pose, &mut wrench) }
    };
    let bad = |position, orientation| palpate_pose { position, orientation };
    refused(step(null_mut(), &DEEP), Null, "simulation is null");
    refused(step(context.cast(), &DEEP), Handle, "not that of a simulation");
    refused(step(simulation, &bad([0.0, f64::NAN, 0.0], DEEP.orientation)), Argument, "device.position[1] is NaN");
    refused(step(simulation, &bad(DEEP.position, [0.0; 4])), Argument, "unit quaternion");
    // SAFETY (all below): each pointer is null, which the library checks, or leads to a live variable of the right
    // type.
    unsafe {
        told.size = 7;
        refused(palpate_step(simulation, &DEEP, &mut told), Argument, "palpate_wrench.size is 7");
        refused(palpate_nodes(simulation, 0, null_mut(), 0, null_mut()), Null, "count is null");
        refused(palpate_nodes(simulation, 1, null_mut(), 0, &mut count), Argument, "body is 1");
        ok(palpate_nodes(simulation, 0, null_mut(), 0, &mut count));
        assert_eq!(count, 4 * 3 * 4);
        let mut nodes = vec![[7.0; 3]; count];
        refused(palpate_nodes(simulation, 0, null_mut(), count, &mut count), Null, "positions is null");
        refused(
            palpate_nodes(simulation, 0, nodes.as_mut_ptr(), count - 1, &mut count),
            TooSmall,
            "room for 47 elements, but there are 48",
        );
        assert!(nodes.iter().all(|x| *x == [7.0; 3]));
        ok(palpate_nodes(simulation, 0, nodes.as_mut_ptr(), count, &mut count));
        assert!(nodes.iter().flatten().all(|x| x.abs() <= 0.05));
        refused(palpate_stresses(simulation, 1, null_mut(), 0, &mut count), Argument, "body is 1");
        ok(palpate_stresses(simulation, 0, null_mut(), 0, &mut count));
        let mut stresses = vec![[7.0; 6]; count];
        refused(palpate_stresses(simulation, 0, stresses.as_mut_ptr(), count - 1, &mut count), TooSmall, "room for");
        ok(palpate_stresses(simulation, 0, stresses.as_mut_ptr(), count, &mut count));
        assert!(!stresses.is_empty() && stresses.iter().flatten().all(|x| *x == 0.0), "before the first step");
        refused(palpate_contact_forces(simulation, 2, null_mut(), 0, &mut count), Argument, "body is 2");
        for body in [0, 1] {
            ok(palpate_contact_forces(simulation, body, null_mut(), 0, &mut count));
            let mut forces = vec![[7.0; 3]; count];
            ok(palpate_contact_forces(simulation, body, forces.as_mut_ptr(), count, &mut count));
            assert!(!forces.is_empty() && forces.iter().flatten().all(|x| *x == 0.0), "before the first step");
        }
        let large = scene("[400, 300, 100]");
        let mut none = null_mut();
        let status = palpate_simulation_create(context, large, &mut none);
        refused(
            status,
            palpate_status::Memory,
            "72000000 tetrahedra in layers given as boxes: 8064000000 bytes are needed",
        );
        assert!(none.is_null());
        ok(palpate_scene_destroy(large));
        let mut none = null_mut();
        refused(palpate_scene_parse(null(), null(), &mut none), Null, "text is null");
        refused(palpate_scene_parse(c"[[body]]\nnam = 1".as_ptr(), null(), &mut none), Input, "`");
        refused(palpate_simulation_create(context, null_mut(), &mut null_mut()), Null, "scene is null");
        refused(palpate_context_create(null(), null_mut()), Null, "context is null");
        let mut options = palpate_context_options { device: c"nobody's".as_ptr(), ..ffi_help::zeroed() };
        let mut none = null_mut();
        refused(palpate_context_create(&options, &mut none), palpate_status::NoDevice, "nobody's");
        (options.validation, options.device) = (2, null());
        refused(palpate_context_create(&options, &mut none), Argument, "validation is 2");
        // The size that the struct states, 19 bytes, ends within the field `log`: the library must not call the address
        // that consists of the field's first three bytes and five zero bytes.
        unsafe extern "C" fn log(_: *mut c_void, _: u32, _: *const c_char) {}
        options = palpate_context_options { size: 19, log: Some(log), ..ffi_help::zeroed() };
        let cut =
            "palpate_context_options.size is 19, which cuts a field in two; set it to sizeof(palpate_context_options)";
        refused(palpate_context_create(&options, &mut none), Argument, cut);
        assert!(none.is_null());
        // A size at which a field ends is accepted, because a program compiled with an older, shorter struct states
        // such a size.
        options.size = std::mem::offset_of!(palpate_context_options, log) as u32;
        ok(palpate_context_create(&options, &mut none));
        ok(palpate_context_destroy(none));
    }
    // None of the calls above did a step, so the next step is the first.
    told.size = size_of::<palpate_wrench>() as u32;
    // SAFETY: a null pose is allowed, and the output pointer leads to a live local variable; the library checks
    // handles.
    ok(unsafe { palpate_step(simulation, null(), &mut told) });
    assert_eq!(told.step, 1);
    // Pressed, the skin is pushed by as much as the tool feels, and the block is under pressure along y most of all.
    for _ in 0..20 {
        // SAFETY: both pointers lead to live variables of the right type.
        ok(unsafe { palpate_step(simulation, &DEEP, &mut told) });
    }
    let (mut forces, mut stresses) = (vec![[0.0; 3]; 1000], vec![[0.0; 6]; 1000]);
    // SAFETY: the arrays have room for as many elements as is said.
    unsafe {
        ok(palpate_contact_forces(simulation, 0, forces.as_mut_ptr(), forces.len(), &mut count));
        ok(palpate_stresses(simulation, 0, stresses.as_mut_ptr(), stresses.len(), &mut count));
    }
    let size = told.force.iter().map(|x| x * x).sum::<f64>().sqrt();
    for k in 0..3 {
        let sum: f64 = forces.iter().map(|force| force[k]).sum();
        assert!((sum + told.force[k]).abs() < 1e-5 * size, "{sum} N on the skin, {} N on the tool", told.force[k]);
    }
    let least = |k: usize| stresses.iter().map(|stress| stress[k]).fold(0.0, f64::min);
    assert!(told.force[1] > 0.1 && least(1) < least(0) && least(1) < least(2), "{:?} N", told.force);
    ok(palpate_simulation_destroy(simulation));
    refused(palpate_simulation_destroy(simulation), Handle, "was destroyed");
    refused(step(simulation, &DEEP), Handle, "was destroyed");
    ok(palpate_simulation_destroy(null_mut()));
    ok(palpate_context_destroy(context));
}

#[test]
fn a_simulation_outlives_its_context_and_leaves_no_memory_on_one_that_stays() {
    let (stays, goes) = (context(), context());
    let survivor = simulation(goes, "[3, 2, 3]");
    ok(palpate_context_destroy(goes));
    let memory = || {
        let mut bytes = 0;
        // SAFETY: the output pointer leads to a live local variable; the library checks handles.
        ok(unsafe { palpate_context_memory(stays, &mut bytes) });
        bytes
    };
    assert_eq!(memory(), 0);
    for _ in 0..3 {
        let simulation = simulation(stays, "[3, 2, 3]");
        assert!(memory() > 0);
        ok(palpate_simulation_destroy(simulation));
        assert_eq!(memory(), 0);
    }
    let mut told = wrench();
    // SAFETY: the pose and the output are live local variables; the library checks handles.
    ok(unsafe { palpate_step(survivor, &DEEP, &mut told) });
    ok(palpate_simulation_destroy(survivor));
    ok(palpate_context_destroy(stays));
}

#[test]
fn two_threads_with_contexts_of_their_own_do_not_change_each_others_bits() {
    let alone = forces();
    let both: Vec<_> = (0..2).map(|_| std::thread::spawn(forces)).collect();
    for thread in both {
        assert_eq!(thread.join().unwrap(), alone);
    }
}

fn forces() -> Vec<[u64; 3]> {
    let context = context();
    let simulation = simulation(context, "[6, 4, 6]");
    let mut told = wrench();
    let mut step = || {
        // SAFETY: the pose and the output are live local variables; the library checks handles.
        ok(unsafe { palpate_step(simulation, &DEEP, &mut told) });
        told.force.map(f64::to_bits)
    };
    let forces: Vec<_> = (0..30).map(|_| step()).collect();
    assert!(f64::from_bits(forces[29][1]) > 0.1);
    ok(palpate_simulation_destroy(simulation));
    ok(palpate_context_destroy(context));
    forces
}
