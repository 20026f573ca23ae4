//! Tests of the functions of the C ABI that a program calls between two time steps. The tests save and restore the
//! state of a simulation, change materials and the contact law, and read skins (surface meshes), contacts, the time of
//! each stage of a step and log messages. They also change the virtual coupling (spring and damper between the haptic
//! device and the tool, which is the rigid body that the device leads) and move a rigid core (rigid body inside a soft
//! body, to which nodes are attached). The last test checks the errors about a Vulkan device that the program itself
//! opened and passes to the library.
#![allow(unsafe_code)]

mod ffi_help;

use std::ffi::{CStr, c_char, c_void};
use std::ptr::{null, null_mut};
use std::sync::Mutex;

use palpate::internal::gpu::FAULTS;
use palpate_capi::change::{
    palpate_contact_get, palpate_contact_law, palpate_contact_set, palpate_core_move, palpate_core_pose,
    palpate_coupling, palpate_coupling_set, palpate_material, palpate_material_get, palpate_material_set,
};
use palpate_capi::context::{
    palpate_context, palpate_context_create, palpate_context_destroy, palpate_context_options,
};
use palpate_capi::host::{palpate_context_create_on, palpate_vulkan};
use palpate_capi::shown::{
    PALPATE_SKIN_NORMALS, palpate_contact, palpate_contacts, palpate_skin, palpate_skin_buffers, palpate_skin_export,
    palpate_skin_range, palpate_skin_triangles, palpate_skins,
};
use palpate_capi::simulation::{
    palpate_pose, palpate_reaction, palpate_reactions, palpate_simulation, palpate_simulation_destroy, palpate_step,
};
use palpate_capi::state::{palpate_state_restore, palpate_state_save};
use palpate_capi::statistics::{palpate_stage, palpate_stages, palpate_time_every};
use palpate_capi::status::palpate_status::{Argument, Handle, NoDevice, Null, Simulation, TooSmall, Vulkan};
use palpate_capi::steps::palpate_wrench_newest;

use ffi_help::{BLOCK, DEEP, SPHERE, context, last_error, memory, nodes, ok, refused, simulation, wrench, zeroed};

fn pressed() -> (*mut palpate_context, *mut palpate_simulation) {
    let context = context();
    (context, simulation(context, &format!("{BLOCK}{SPHERE}")))
}

fn end(context: *mut palpate_context, simulation: *mut palpate_simulation) {
    ok(palpate_simulation_destroy(simulation));
    assert_eq!(memory(context), 0, "the simulation left GPU memory allocated");
    ok(palpate_context_destroy(context));
}

/// Does `count` steps with a device pose that pushes the sphere deep into the block. Returns the bit patterns of the
/// force on the tool after each step, then those of the node positions after the last step.
fn steps(simulation: *mut palpate_simulation, count: usize) -> Vec<u64> {
    let mut told = wrench();
    let mut step = || {
        // SAFETY: the pose is a constant, and the output is a live local variable; the library itself checks handles
        // (its pointers to contexts and simulations).
        ok(unsafe { palpate_step(simulation, &DEEP, &mut told) });
        told.force.map(f64::to_bits)
    };
    let mut bits: Vec<u64> = (0..count).flat_map(|_| step()).collect();
    bits.extend(nodes(simulation).iter().flatten().map(|x| x.to_bits()));
    bits
}

fn saved(simulation: *mut palpate_simulation) -> Vec<u8> {
    let mut size = 0;
    // SAFETY (both calls): the array is null with length 0 or has the length that is passed, and the output pointer
    // leads to a live local variable.
    ok(unsafe { palpate_state_save(simulation, null_mut(), 0, &mut size) });
    let mut bytes = vec![0; size];
    ok(unsafe { palpate_state_save(simulation, bytes.as_mut_ptr(), size, &mut size) });
    assert_eq!(size, bytes.len());
    bytes
}

/// A host goes on after its device was lost: with a new context, and the state that it saved last.
#[test]
fn a_host_whose_device_is_lost_goes_on_with_another() {
    FAULTS.concern_contexts_of_this_thread();
    FAULTS.arm(None, 0);
    let (context, lost) = pressed();
    steps(lost, 10);
    let state = saved(lost);
    let expected = steps(lost, 10);
    FAULTS.lose_devices();
    // SAFETY (both calls): null is passed only where palpate.h allows it.
    refused(unsafe { palpate_step(lost, &DEEP, null_mut()) }, Vulkan, " failed in stage");
    assert!(last_error().ends_with("the device was lost"), "it said: {}", last_error());
    refused(unsafe { palpate_step(lost, &DEEP, null_mut()) }, Simulation, "an earlier step failed halfway");
    // SAFETY: the array has the length that is passed.
    refused(unsafe { palpate_state_restore(lost, state.as_ptr(), state.len()) }, Vulkan, "the device was lost");
    end(context, lost);
    FAULTS.arm(None, 0);
    let (context, next) = pressed();
    // SAFETY: the array has the length that is passed.
    ok(unsafe { palpate_state_restore(next, state.as_ptr(), state.len()) });
    assert_eq!(steps(next, 10), expected);
    end(context, next);
}

/// For each contact of the last step: the index of its skin vertex, and the bit patterns of its depth and of its
/// position.
fn contacts(simulation: *mut palpate_simulation) -> Vec<(u32, u64, [u64; 3])> {
    let mut count = 0;
    // SAFETY (both calls): the array is null with length 0 or has the length that is passed, and the output pointer
    // leads to a live local variable.
    ok(unsafe { palpate_contacts(simulation, null_mut(), 0, &mut count) });
    let mut contacts = vec![palpate_contact::default(); count];
    ok(unsafe { palpate_contacts(simulation, contacts.as_mut_ptr(), count, &mut count) });
    contacts.iter().map(|c| (c.vertex, c.depth.to_bits(), c.position.map(f64::to_bits))).collect()
}

#[test]
fn a_state_is_taken_up_bit_for_bit() {
    let (context, first) = pressed();
    let second = simulation(context, &format!("{BLOCK}{SPHERE}"));
    steps(first, 15);
    let (state, touched) = (saved(first), contacts(first));
    assert!(touched.len() > 4);
    let on = steps(first, 20);
    steps(second, 3);
    assert_ne!(contacts(second), touched);
    // SAFETY (all below): each pointer is null, which the library checks, or leads to a live variable, and byte arrays
    // are at least as long as the length that is passed; the library checks handles.
    unsafe {
        ok(palpate_state_restore(second, state.as_ptr(), state.len()));
        assert_eq!(contacts(second), touched);
        let (mut newest, mut age) = (wrench(), 0.0);
        ok(palpate_wrench_newest(second, &mut newest, &mut age));
        assert!(newest.step == 0 && age.is_infinite(), "after a restore there must be no newest wrench");
        assert_eq!(steps(second, 20), on);
        ok(palpate_state_restore(first, state.as_ptr(), state.len()));
        assert_eq!(steps(first, 20), on);
        assert_ne!(steps(first, 20), on);
        refused(palpate_state_restore(first, state.as_ptr(), state.len() - 1), Argument, "the state is damaged");
        refused(palpate_state_restore(first, null(), 9), Null, "bytes is null");
        refused(palpate_state_restore(null_mut(), state.as_ptr(), state.len()), Null, "simulation is null");
        let (mut small, mut size) = (vec![7; state.len() - 1], 0);
        refused(palpate_state_save(first, small.as_mut_ptr(), small.len(), &mut size), TooSmall, "room for");
        assert!(size == state.len() && small.iter().all(|byte| *byte == 7));
        refused(palpate_state_save(first, null_mut(), 0, null_mut()), Null, "size is null");
    }
    ok(palpate_simulation_destroy(second));
    end(context, first);
}

#[test]
#[ignore = "long: 9 s"]
fn a_material_a_law_and_a_coupling_are_changed_and_refused() {
    let (context, simulation) = pressed();
    let rest = || {
        let mut told = wrench();
        // Does 400 steps, after which the block is at rest: a block that becomes stiffer under load first throws the
        // tool up.
        (0..400).for_each(|_| {
            // SAFETY: the pose is a constant, and the output is a live local variable; the library checks handles.
            ok(unsafe { palpate_step(simulation, &DEEP, &mut told) });
        });
        assert_eq!(told.flags, 0);
        told
    };
    let force = || rest().force[1];
    let soft = force();
    // SAFETY (all below): each pointer is null, which the library checks, or leads to a live struct that is at least as
    // large as the size that it states; the library checks handles.
    unsafe {
        let mut material = zeroed::<palpate_material>();
        ok(palpate_material_get(simulation, 0, 0, &mut material));
        assert_eq!((material.young, material.poisson, material.density), (2e4, 0.45, 1000.0));
        material.young = 8e4;
        ok(palpate_material_set(simulation, 0, 0, &material));
        let stiff = force();
        assert!(stiff > 1.3 * soft, "force with the stiffer block: {stiff} N; with the softer block: {soft} N");
        refused(palpate_material_set(simulation, 0, 1, &material), Argument, "counted from 0, and none at 1");
        refused(palpate_material_set(simulation, 9, 0, &material), Argument, "body 9 has 0 materials");
        refused(palpate_material_set(simulation, 0, 0, null()), Null, "material is null");
        refused(palpate_material_get(simulation, 0, 0, null_mut()), Null, "material is null");
        for (wrong, words) in [(f64::NAN, "material.young is NaN"), (-1.0, "material.young is -1.0")] {
            let wrong = palpate_material { young: wrong, ..material };
            refused(palpate_material_set(simulation, 0, 0, &wrong), Argument, words);
        }
        let wrong = palpate_material { reserved: 3, ..material };
        refused(palpate_material_set(simulation, 0, 0, &wrong), Argument, "reserved is 3");
        let wrong = palpate_material { size: 12, ..material };
        refused(palpate_material_set(simulation, 0, 0, &wrong), Argument, "palpate_material.size is 12");

        let mut law = zeroed::<palpate_contact_law>();
        ok(palpate_contact_get(simulation, &mut law));
        assert_eq!((law.stiffness, law.damping, law.friction), (-1.0, -1.0, 0.0));
        (law.stiffness, law.friction) = (1e6, 0.4);
        ok(palpate_contact_set(simulation, &law));
        ok(palpate_contact_get(simulation, &mut law));
        assert_eq!((law.stiffness, law.damping, law.friction), (1e6, -1.0, 0.4));
        // The GPU buffers of the skins stay the same when friction is switched off and on again.
        let (mut shown, mut again) = (zeroed::<palpate_skins>(), zeroed::<palpate_skins>());
        ok(palpate_skin_buffers(simulation, null(), &mut shown));
        ok(palpate_contact_set(simulation, &palpate_contact_law { friction: 0.0, ..law }));
        ok(palpate_contact_set(simulation, &law));
        ok(palpate_skin_buffers(simulation, null(), &mut again));
        assert_eq!((again.positions, again.normals), (shown.positions, shown.normals));
        let yielding = force();
        assert!(yielding < 0.9 * stiff, "force with the softer contact law: {yielding} N; before: {stiff} N");
        let wrong = palpate_contact_law { stiffness: f64::NAN, ..law };
        refused(palpate_contact_set(simulation, &wrong), Argument, "contact.stiffness is NaN");
        let wrong = palpate_contact_law { friction: -0.5, ..law };
        refused(palpate_contact_set(simulation, &wrong), Argument, "contact.friction is -0.5");

        let mut coupling = zeroed::<palpate_coupling>();
        (coupling.stiffness, coupling.damping) = (30.0, 1.0);
        ok(palpate_coupling_set(simulation, &coupling));
        // At rest, the contact force carries the tool's weight and the force of the coupling's spring.
        let told = rest();
        let held = 0.05 * 9.81 + coupling.stiffness * (told.tool.position[1] - DEEP.position[1]);
        assert!(
            (told.force[1] / held - 1.0).abs() < 0.01 && held < 0.9 * yielding,
            "expected force: {held} N; force with the stiffer spring: {yielding} N; wrench of the last step: {told:?}"
        );
        coupling.damping = f64::INFINITY;
        refused(palpate_coupling_set(simulation, &coupling), Argument, "coupling.damping is inf");
        ok(palpate_coupling_set(simulation, null()));
    }
    end(context, simulation);
}

#[test]
fn a_kinematic_core_is_taken_along_and_others_stay() {
    let context = context();
    let driven = BLOCK.replace("motion = \"fixed\"", "motion = \"driven\"\nkeys = [[0.0, 0.0, 0.0, 0.0]]");
    let simulation = simulation(context, &driven);
    let mut pose = palpate_pose { position: [1.0; 3], orientation: [0.0; 4] };
    // SAFETY (all below): each pointer is null, which the library checks, or leads to a live local variable; the
    // library checks handles.
    unsafe {
        ok(palpate_core_pose(simulation, 0, 0, &mut pose));
        assert_eq!((pose.position, pose.orientation), ([0.0; 3], [0.0, 0.0, 0.0, 1.0]));
        // As in an animation, the core gets a new pose before every step.
        for step in 1..=10 {
            pose.position[0] = 1e-4 * f64::from(step);
            ok(palpate_core_move(simulation, 0, 0, &pose, 0.0));
            ok(palpate_step(simulation, null(), null_mut()));
            let mut now = pose;
            ok(palpate_core_pose(simulation, 0, 0, &mut now));
            assert!((now.position[0] - pose.position[0]).abs() < 1e-12, "the core is not where it was put: {now:?}");
        }
        let bottom = nodes(simulation)[0];
        assert!((bottom[0] - (1e-3 - 0.05)).abs() < 1e-6, "the first node did not follow the core: {bottom:?} m");
        refused(palpate_core_pose(simulation, 0, 1, &mut pose), Argument, "body 0 has no core 1");
        refused(palpate_core_move(simulation, 0, 0, null(), 0.0), Null, "pose is null");
        refused(palpate_core_move(simulation, 0, 0, &pose, -1.0), Argument, "seconds is -1");
        refused(palpate_core_move(simulation, 0, 0, &pose, f64::NAN), Argument, "seconds is NaN");
        pose.position[2] = f64::NAN;
        refused(palpate_core_move(simulation, 0, 0, &pose, 0.0), Argument, "pose.position[2] is NaN");
    }
    end(context, simulation);
    let (context, simulation) = pressed();
    // SAFETY: the pose is a constant; the library checks the handle.
    unsafe { refused(palpate_core_move(simulation, 0, 0, &DEEP, 0.0), Argument, "core 0 of body 0 is not driven") };
    end(context, simulation);
}

#[test]
fn skins_and_contacts_are_told_as_they_are() {
    let (context, simulation) = pressed();
    steps(simulation, 30);
    let origin = [0.01, 0.02, 0.03];
    let mut count = 0;
    // SAFETY (all below): arrays are null with length 0 or have the lengths that are passed, output pointers lead to
    // live variables, and the exported file descriptor belongs to this test; the library checks handles.
    unsafe {
        ok(palpate_skin(simulation, 0, null(), null_mut(), null_mut(), 0, &mut count));
        let (mut places, mut normals) = (vec![[0.0f32; 3]; count], vec![[0.0f32; 3]; count]);
        ok(palpate_skin(simulation, 0, origin.as_ptr(), places.as_mut_ptr(), normals.as_mut_ptr(), count, &mut count));
        // This body's skin is the boundary of its layer (the tetrahedral mesh), so every skin vertex lies on a node.
        let nodes = nodes(simulation);
        for place in &places {
            let at: [f64; 3] = std::array::from_fn(|k| f64::from(place[k]) + origin[k]);
            let near = |x: &[f64; 3]| (0..3).all(|k| (x[k] - at[k]).abs() < 1e-7);
            assert!(nodes.iter().any(near), "a skin vertex at {at:?} m lies on no node");
        }
        let up = places.iter().zip(&normals).filter(|(x, n)| x[1] > 0.005 && n[1] > 0.9).count();
        assert!(up > 10, "too few skin normals on the top face point up: {up}");
        let mut few = vec![[9.0f32; 3]; count - 1];
        let status = palpate_skin(simulation, 0, null(), few.as_mut_ptr(), null_mut(), few.len(), &mut count);
        refused(status, TooSmall, "positions has room for");
        assert!(few.iter().flatten().all(|x| *x == 9.0));
        // The skin of the tool comes after those of the bodies: it has index 1.
        let mut of_tool = 0;
        ok(palpate_skin(simulation, 1, null(), null_mut(), null_mut(), 0, &mut of_tool));
        let status = palpate_skin(simulation, 2, null(), null_mut(), null_mut(), 0, &mut count);
        refused(status, Argument, "body is 2; the scene has 2");
        let wrong = [0.0, f64::NAN, 0.0];
        let status = palpate_skin(simulation, 0, wrong.as_ptr(), null_mut(), null_mut(), 0, &mut count);
        refused(status, Argument, "origin is");

        let mut triangle_count = 0;
        ok(palpate_skin_triangles(simulation, 0, null_mut(), 0, &mut triangle_count));
        let mut triangles = vec![[0u32; 3]; triangle_count];
        ok(palpate_skin_triangles(simulation, 0, triangles.as_mut_ptr(), triangle_count, &mut triangle_count));
        assert!(triangles.iter().flatten().all(|v| (*v as usize) < places.len()));
        let (mut first, mut own) = (9, 9);
        ok(palpate_skin_range(simulation, 1, &mut first, &mut own));
        assert_eq!((first as usize, own as usize), (places.len(), of_tool));
        let mut skins = zeroed::<palpate_skins>();
        ok(palpate_skin_buffers(simulation, null(), &mut skins));
        assert_eq!(skins.vertex_count as usize, places.len() + of_tool);
        assert!(skins.positions != 0 && skins.normals != 0 && skins.triangle_count as usize > triangle_count);
        let (mut descriptor, mut bytes) = (-5, 0);
        let status = palpate_skin_export(simulation, PALPATE_SKIN_NORMALS, &mut descriptor, &mut bytes);
        if status != Vulkan {
            ok(status);
            assert!(descriptor >= 0 && bytes >= 16 * u64::from(skins.vertex_count));
            drop(std::os::fd::OwnedFd::from_raw(descriptor));
        }
        refused(
            palpate_skin_export(simulation, 7, &mut descriptor, &mut bytes),
            Argument,
            "which is 7; give one of PALPATE_SKIN_*",
        );
        assert_eq!(descriptor, -1);

        let mut told = wrench();
        ok(palpate_step(simulation, &DEEP, &mut told));
        ok(palpate_contacts(simulation, null_mut(), 0, &mut count));
        assert!(count == told.contacts as usize && count > 4, "contacts copied: {count}; step: {told:?}");
        let mut contacts = vec![palpate_contact::default(); count];
        ok(palpate_contacts(simulation, contacts.as_mut_ptr(), count, &mut count));
        let mut push = 0.0;
        for contact in &contacts {
            let [own, other] = contact.body;
            assert!((own, other) == (0, 1) || (own, other) == (1, 0), "contact not of bodies 0 and 1: {contact:?}");
            // The normal points out of the touched body: up for contacts at the sphere's vertices, down for those at
            // the block's.
            let up = contact.normal[1] * if own == 1 { 1.0 } else { -1.0 };
            let size = contact.normal.iter().map(|x| x * x).sum::<f64>();
            assert!(up > 0.5 && (size - 1.0).abs() < 1e-4, "wrong length or direction of the normal: {contact:?}");
            assert!(
                contact.depth > 0.0 && contact.depth <= told.max_depth * 1.001 && contact.area > 0.0,
                "the depth or the area is out of range: {contact:?}"
            );
            assert!(contact.position[0].hypot(contact.position[2]) < 0.02, "contact not under the sphere: {contact:?}");
            push += contact.area * contact.pressure * up;
        }
        // At rest, the sum of pressure times area over all contacts is the upward force on the tool.
        assert!(
            (push / told.force[1] - 1.0).abs() < 0.05,
            "sum of pressure times area: {push} N; force on the tool: {:?} N",
            told.force
        );
        let mut one = vec![palpate_contact::default(); 1];
        refused(palpate_contacts(simulation, one.as_mut_ptr(), 1, &mut count), TooSmall, "contacts has room for 1");
        refused(palpate_contacts(context.cast(), null_mut(), 0, &mut count), Handle, "not that of a simulation");
    }
    end(context, simulation);
}

/// Gives `OwnedFd`, which closes its descriptor when dropped, a shorter constructor.
trait FromRaw {
    unsafe fn from_raw(descriptor: i32) -> Self;
}

impl FromRaw for std::os::fd::OwnedFd {
    unsafe fn from_raw(descriptor: i32) -> Self {
        // SAFETY: the caller owns the descriptor, as `FromRawFd` demands.
        unsafe { std::os::fd::FromRawFd::from_raw_fd(descriptor) }
    }
}

#[test]
fn stages_are_told_with_passes_and_times() {
    let (context, simulation) = pressed();
    let stages = || {
        let mut count = 0;
        // SAFETY (both calls): the array is null with length 0 or has the length that is passed, and the output pointer
        // leads to a live local variable.
        ok(unsafe { palpate_stages(simulation, null_mut(), 0, &mut count) });
        let empty = palpate_stage { name: [0; 32], microseconds: -1.0, passes: 0, reserved: 0 };
        let mut stages = vec![empty; count];
        ok(unsafe { palpate_stages(simulation, stages.as_mut_ptr(), count, &mut count) });
        let told = |stage: &palpate_stage| {
            // SAFETY: the library terminates the text by a zero.
            let name = unsafe { CStr::from_ptr(stage.name.as_ptr()) }.to_str().unwrap().to_owned();
            (name, stage.microseconds, stage.passes)
        };
        stages.iter().map(told).collect::<Vec<_>>()
    };
    steps(simulation, 4);
    let untimed = stages();
    let of = |name: &str| untimed.iter().find(|stage| stage.0 == name).cloned().unwrap();
    assert!(untimed.iter().all(|stage| stage.1 == 0.0) && of("solve").2 > of("elastic").2);
    ok(palpate_time_every(simulation, 1));
    steps(simulation, 2);
    let timed = stages();
    assert!(timed.iter().map(|stage| stage.1).sum::<f64>() > 0.0, "no stage has a time: {timed:?}");
    end(context, simulation);
}

#[test]
fn reactions_are_listed_by_name() {
    let context = context();
    let roller =
        "[[body.support]]\nname = \"side\"\nplane = [1, 0, 0]\nbind = { box = [[-1, -1, -1], [-0.0499, 1, 1]] }\n";
    let simulation = simulation(context, &format!("{BLOCK}{roller}{SPHERE}"));
    let reactions = || {
        let mut count = 0;
        // SAFETY (both calls): the array is null with length 0 or has the length that is passed, and the output pointer
        // leads to a live local variable.
        ok(unsafe { palpate_reactions(simulation, null_mut(), 0, &mut count) });
        let mut all = vec![palpate_reaction { name: [0; 208], force: [0.0; 3], torque: [0.0; 3] }; count];
        ok(unsafe { palpate_reactions(simulation, all.as_mut_ptr(), count, &mut count) });
        let told = |reaction: &palpate_reaction| {
            // SAFETY: the library terminates the text by a zero.
            let name = unsafe { CStr::from_ptr(reaction.name.as_ptr()) }.to_str().unwrap().to_owned();
            (name, reaction.force, reaction.torque)
        };
        all.iter().map(told).collect::<Vec<_>>()
    };
    assert!(reactions().is_empty(), "before the first step nothing is known");
    steps(simulation, 2);
    let all = reactions();
    let names: Vec<&str> = all.iter().map(|(name, ..)| name.as_str()).collect();
    assert_eq!(names, ["block.bottom", "block.side"]);
    assert!(all[0].1[1] > 0.1, "the core carries the block: {all:?}");
    assert!(all[1].1[0] != 0.0 && all[1].1[1] == 0.0, "a roller pushes along its normal: {all:?}");
    let mut count = 0;
    let mut one = [palpate_reaction { name: [0; 208], force: [0.0; 3], torque: [0.0; 3] }];
    // SAFETY: the array has the length that is passed, and the output pointer leads to a live local variable.
    assert_eq!(unsafe { palpate_reactions(simulation, one.as_mut_ptr(), 1, &mut count) }, TooSmall);
    assert_eq!((count, one[0].force), (2, [0.0; 3]));
    end(context, simulation);
}

/// Messages that the log callback received.
static HEARD: Mutex<Vec<(u32, String)>> = Mutex::new(Vec::new());

unsafe extern "C" fn hear(user: *mut c_void, level: u32, message: *const c_char) {
    // SAFETY: `user` leads to the number (77) that the test passed, and the message is terminated by a zero.
    let (mark, message) = unsafe { (*user.cast::<u32>(), CStr::from_ptr(message)) };
    assert_eq!(mark, 77);
    HEARD.lock().unwrap().push((level, message.to_str().unwrap().into()));
}

#[test]
fn a_log_hears_what_is_chosen_and_found() {
    let (mut mark, mut context) = (77u32, null_mut());
    let mut options = zeroed::<palpate_context_options>();
    options.log = Some(hear);
    (options.log_user, options.validation) = ((&raw mut mark).cast(), 1);
    // SAFETY: the options state their true size; they and the output are live local variables.
    ok(unsafe { palpate_context_create(&options, &mut context) });
    let simulation = simulation(context, &format!("contact = {{ samples = \"vertices\" }}\n{BLOCK}{SPHERE}"));
    steps(simulation, 3);
    end(context, simulation);
    let heard = HEARD.lock().unwrap().clone();
    assert!(
        heard.iter().any(|(level, line)| *level == 0 && line.starts_with("device: ")),
        "no note names the device: {heard:?}"
    );
    assert!(
        heard.iter().any(|(level, line)| *level == 0 && line.starts_with("depth stage: ")),
        "no note says whether the depth stage runs as graphics or as compute: {heard:?}"
    );
    assert!(
        heard.iter().all(|(level, line)| *level == 0 && !line.contains('\n')),
        "a log message is no note (level 0), or has several lines: {heard:?}"
    );
}

#[test]
fn what_a_host_says_of_its_device_is_checked_as_far_as_it_can_be() {
    let mut vulkan = zeroed::<palpate_vulkan>();
    let mut context = null_mut();
    // SAFETY (all below): structs state their true size, pointers lead to live variables, and Vulkan's own functions
    // get valid arguments; the library refuses each call before it uses a made-up Vulkan handle.
    let mut make = |vulkan: &palpate_vulkan| unsafe { palpate_context_create_on(vulkan, &mut context) };
    refused(make(&vulkan), NoDevice, "the host's instance is null");
    vulkan.enabled = 64;
    refused(make(&vulkan), Argument, "palpate_vulkan.enabled is 64");
    vulkan.enabled = 0;
    vulkan.lock = Some(lock);
    refused(make(&vulkan), Argument, "lock and unlock go together");
    vulkan.lock = None;
    let entry = unsafe { ash::Entry::load() }.unwrap();
    let application = ash::vk::ApplicationInfo::default().api_version(ash::vk::API_VERSION_1_3);
    let info = ash::vk::InstanceCreateInfo::default().application_info(&application);
    let instance = unsafe { entry.create_instance(&info, None) }.unwrap();
    let physical = unsafe { instance.enumerate_physical_devices() }.unwrap()[0];
    use ash::vk::Handle as _;
    let handle = |raw: u64| raw as usize as *mut c_void;
    let nobodys = handle(0x10);
    (vulkan.instance, vulkan.device, vulkan.queue) = (handle(instance.handle().as_raw()), nobodys, nobodys);
    vulkan.physical_device = nobodys;
    refused(make(&vulkan), NoDevice, "physical_device is not one of the host's instance");
    (vulkan.physical_device, vulkan.queue_family) = (handle(physical.as_raw()), 99);
    refused(make(&vulkan), NoDevice, "queue_family is 99");
    refused(unsafe { palpate_context_create_on(null(), &mut context) }, Null, "vulkan is null");
    unsafe { instance.destroy_instance(None) };
}

unsafe extern "C" fn lock(_: *mut c_void) {}
