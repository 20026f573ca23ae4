//! The C ABI: sequences of calls on handles that are live, destroyed, null or made up, with numbers of every kind. Pointers
//! keep the header's rules; everything else is the fuzzer's choice. Every status that is not success has a message.
#![no_main]
// Struct fields have C names and are filled by the fuzzer, so `Default` is the shortest start.
#![allow(clippy::field_reassign_with_default)]

use std::cell::Cell;
use std::ffi::{CStr, CString, c_char};
use std::ptr::{null, null_mut};
use std::sync::OnceLock;

use libfuzzer_sys::fuzz_target;
use palpate_capi::build::*;
use palpate_capi::change::*;
use palpate_capi::context::*;
use palpate_capi::describe::*;
use palpate_capi::scene::*;
use palpate_capi::shown::*;
use palpate_capi::simulation::*;
use palpate_capi::state::*;
use palpate_capi::statistics::*;
use palpate_capi::status::*;
use palpate_capi::steps::*;

/// Capacity of every array that a call may fill.
const ROOM: usize = 512;
/// Calls for one input.
const MOST_CALLS: usize = 512;

const TEXTS: [&CStr; 6] = [
    c"",
    c"b",
    c"[contact]\nfriction = 0.3\n",
    c"[[body]]\nname = \"p\"\nplane = [0.0, 1.0, 0.0, -0.05]\n",
    c"[[body]]\nname = \"b\"\nlayer = { box = [[-0.02, -0.02, -0.02], [0.02, 0.0, 0.02]], cells = [2, 1, 2] }\n\
      material = { young = 2e4, poisson = 0.4, density = 1e3 }\n\
      [tool]\nsphere = 0.01\nmass = 0.05\nposition = [0.0, 0.0095, 0.0]\n",
    c"[coupling]\nstiffness = 500.0\ndamping = 5.0\n",
];
const NUMBERS: [f64; 14] =
    [0.0, 1.0, -1.0, 0.001, 0.01, 0.05, 0.45, 1e3, 2e4, 1e10, 1e300, f64::NAN, f64::INFINITY, f64::MIN_POSITIVE];

/// The bytes of a sequence, which end in zeros.
struct Choices<'a>(&'a [u8]);

impl Choices<'_> {
    fn byte(&mut self) -> u8 {
        let Some((first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        *first
    }

    fn of<T: Copy>(&mut self, all: &[T]) -> T {
        all[usize::from(self.byte()) % all.len()]
    }

    fn number(&mut self) -> f64 {
        match self.byte() {
            byte if byte < 240 => NUMBERS[usize::from(byte) % NUMBERS.len()],
            _ => f64::from_bits(u64::from_le_bytes(std::array::from_fn(|_| self.byte()))),
        }
    }

    fn numbers<const N: usize>(&mut self) -> [f64; N] {
        std::array::from_fn(|_| self.number())
    }

    fn count(&mut self) -> usize {
        usize::from(self.byte()) * 2 % (ROOM + 1)
    }

    fn index(&mut self) -> u32 {
        match self.byte() {
            byte if byte < 200 => u32::from(byte) % 4,
            byte => u32::MAX - u32::from(byte),
        }
    }

    fn text(&mut self) -> *const c_char {
        if self.byte() % 8 == 0 { null() } else { self.of(&TEXTS).as_ptr() }
    }

    /// One of the handles, or null, or a number that was never one.
    fn handle<T>(&mut self, handles: &[*mut T]) -> *mut T {
        match self.byte() {
            byte if byte < 224 && !handles.is_empty() => handles[usize::from(byte) % handles.len()],
            byte if byte % 2 == 0 => null_mut(),
            byte => usize::from(byte) as *mut T,
        }
    }

    fn pose(&mut self) -> palpate_pose {
        let mut pose = palpate_pose { position: [0.0, 0.01, 0.0], orientation: [0.0, 0.0, 0.0, 1.0] };
        if self.byte() % 4 == 0 {
            pose = palpate_pose { position: self.numbers(), orientation: self.numbers() };
        }
        pose.position[1] -= f64::from(self.byte()) * 1e-5;
        pose
    }
}

/// A struct of the header with its size set and all else zero.
fn zeroed<T: Copy>() -> T {
    // SAFETY: used only for structs of numbers and pointers, whose first field, a `u32`, is their size.
    unsafe {
        let mut value: T = std::mem::zeroed();
        (&raw mut value).cast::<u32>().write(size_of::<T>() as u32);
        value
    }
}

thread_local! {
    static CALLS: Cell<u64> = const { Cell::new(0) };
}

/// Counts a call, and requires a message for every failure.
fn check(status: palpate_status) -> bool {
    let calls = CALLS.get() + 1;
    CALLS.set(calls);
    if calls.is_multiple_of(100_000) {
        eprintln!("{calls} calls of the C ABI");
    }
    if status == palpate_status::Ok {
        return true;
    }
    assert!(status != palpate_status::Fault, "{}", message());
    assert!(!message().is_empty());
    false
}

fn message() -> String {
    // SAFETY: the message is never null and ends with a zero byte.
    unsafe { CStr::from_ptr(palpate_last_error()) }.to_string_lossy().into_owned()
}

fn context() -> *mut palpate_context {
    static CONTEXT: OnceLock<usize> = OnceLock::new();
    *CONTEXT.get_or_init(|| {
        let mut context = null_mut();
        // SAFETY: null options are allowed, and the output pointer leads to a live variable.
        assert!(check(unsafe { palpate_context_create(null(), &mut context) }), "{}", message());
        context as usize
    }) as *mut palpate_context
}

fuzz_target!(|bytes: &[u8]| {
    let mut choices = Choices(bytes);
    let contexts = [context()];
    let (mut scenes, mut simulations) = (Vec::new(), Vec::new());
    let (mut positions, mut floats) = (vec![[0.0f64; 3]; ROOM], vec![[0.0f32; 3]; ROOM]);
    let (mut triangles, mut state, mut count) = (vec![[0u32; 3]; ROOM], vec![0u8; 64 * ROOM], 0usize);
    let mut rounds = 0;
    for _ in 0..MOST_CALLS {
        if choices.0.is_empty() {
            // A short input goes round, each time from one byte further on, so that every input makes as many calls.
            rounds += 1;
            choices = Choices(bytes.get(rounds % bytes.len().max(1)..).unwrap_or_default());
        }
        let scene = choices.handle(&scenes);
        let simulation = choices.handle(&simulations);
        // SAFETY (of all calls): pointers are null where the header allows it, or lead to live memory of the size that the
        // call is told; the library checks handles.
        unsafe {
            match choices.byte() % 34 {
                0 => {
                    let mut made = null_mut();
                    if check(palpate_scene_parse(choices.text(), null(), &mut made)) {
                        scenes.push(made);
                    }
                }
                1 => {
                    let mut settings: palpate_settings = zeroed();
                    if choices.byte() % 2 == 0 {
                        (settings.dt, settings.friction) = (choices.number(), choices.number());
                        (settings.gravity, settings.newton) = (choices.numbers(), choices.index());
                        (settings.tolerance, settings.max_iterations) = (choices.number(), choices.index());
                    }
                    let mut made = null_mut();
                    if check(palpate_scene_create(&settings, &mut made)) {
                        scenes.push(made);
                    }
                }
                2 => drop(check(palpate_scene_destroy(scene))),
                3 => drop(check(palpate_scene_add(scene, choices.text()))),
                4 => {
                    let corners: [f64; 12] = choices.numbers();
                    let faces = [0u32, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, choices.index()];
                    let (name, n, m) = (choices.text(), choices.count() % 5, choices.count() % 5);
                    check(palpate_scene_add_surface(scene, name, corners.as_ptr(), n, faces.as_ptr(), m));
                }
                5 => {
                    let nodes: [f64; 15] = choices.numbers();
                    let tetrahedra = [0u32, 1, 2, 3, 1, 2, 3, choices.index()];
                    let (name, n, m) = (choices.text(), choices.count() % 6, choices.count() % 3);
                    check(palpate_scene_add_layer(scene, name, nodes.as_ptr(), n, tetrahedra.as_ptr(), m));
                }
                6 => {
                    let mut body: palpate_body = zeroed();
                    (body.name, body.surface, body.layer) = (choices.text(), choices.text(), choices.text());
                    (body.box_low, body.box_high) = (choices.numbers(), choices.numbers());
                    body.box_cells = std::array::from_fn(|_| choices.index() % 4);
                    (body.cell, body.across) = (choices.number(), choices.index() % 5);
                    let mut index = 0;
                    check(palpate_scene_add_body(scene, &body, &mut index));
                }
                7 => {
                    let mut tool: palpate_tool = zeroed();
                    (tool.sphere, tool.mass, tool.position) = (choices.number(), choices.number(), choices.numbers());
                    (tool.surface, tool.stiffness) = (choices.text(), choices.number());
                    check(palpate_scene_set_tool(scene, &tool));
                }
                8 => {
                    let names = [choices.text(), choices.text()];
                    check(palpate_scene_set_collides(scene, choices.index(), names.as_ptr(), choices.count() % 3));
                }
                9 => drop(check(palpate_scene_prepare(scene, None, null_mut()))),
                10..=12 => {
                    let mut made = null_mut();
                    if simulations.len() < 3
                        && check(palpate_simulation_create(choices.handle(&contexts), scene, &mut made))
                    {
                        simulations.push(made);
                    }
                }
                // To create a simulation takes as long as a thousand other calls, so few are destroyed.
                13 if choices.byte() % 8 == 0 => drop(check(palpate_simulation_destroy(simulation))),
                14..=16 => {
                    let (pose, mut wrench) = (choices.pose(), zeroed::<palpate_wrench>());
                    let target = if choices.byte() % 3 == 0 { null() } else { &raw const pose };
                    check(palpate_step(simulation, target, &mut wrench));
                }
                17 => {
                    let pose = choices.pose();
                    check(palpate_step_submit(simulation, &pose));
                }
                18 => {
                    let mut is_done = 0;
                    check(palpate_step_poll(simulation, &mut is_done));
                }
                19 => drop(check(palpate_step_wait(simulation))),
                20 => {
                    let (mut wrench, mut age) = (zeroed::<palpate_wrench>(), 0.0);
                    check(palpate_wrench_newest(simulation, &mut wrench, &mut age));
                }
                21 => {
                    let room = choices.count();
                    check(palpate_nodes(simulation, choices.index(), positions.as_mut_ptr(), room, &mut count));
                }
                22 => {
                    let room = choices.count() * 64;
                    check(palpate_state_save(simulation, state.as_mut_ptr(), room, &mut count));
                }
                23 => {
                    let size = if choices.byte() % 2 == 0 { count.min(state.len()) } else { choices.count() };
                    if choices.byte() % 4 == 0 {
                        let at = choices.count();
                        state[at] ^= choices.byte();
                    }
                    check(palpate_state_restore(simulation, state.as_ptr(), size));
                }
                24 => drop(check(palpate_time_every(simulation, u64::from(choices.index())))),
                25 => {
                    let mut stages: Vec<palpate_stage> = (0..16).map(|_| std::mem::zeroed()).collect();
                    check(palpate_stages(simulation, stages.as_mut_ptr(), choices.count() % 17, &mut count));
                }
                26 => {
                    let mut material: palpate_material = zeroed();
                    let (body, index) = (choices.index(), choices.index());
                    if check(palpate_material_get(simulation, body, index, &mut material)) {
                        material.young = choices.number();
                        material.poisson = choices.number();
                        check(palpate_material_set(simulation, body, index, &material));
                    }
                }
                27 => {
                    let mut law: palpate_contact_law = zeroed();
                    check(palpate_contact_get(simulation, &mut law));
                    (law.stiffness, law.friction) = (choices.number(), choices.number());
                    check(palpate_contact_set(simulation, &law));
                }
                28 => {
                    let mut coupling: palpate_coupling = zeroed();
                    (coupling.stiffness, coupling.damping) = (choices.number(), choices.number());
                    check(palpate_coupling_set(simulation, &coupling));
                }
                29 => {
                    let (body, core) = (choices.index(), choices.index());
                    let mut pose = choices.pose();
                    check(palpate_core_pose(simulation, body, core, &mut pose));
                    check(palpate_core_move(simulation, body, core, &pose, choices.number()));
                }
                30 => {
                    let (origin, room): ([f64; 3], _) = (choices.numbers(), choices.count());
                    let at = if choices.byte() % 2 == 0 { null() } else { origin.as_ptr() };
                    let into = floats.as_mut_ptr();
                    check(palpate_skin(simulation, choices.index(), at, into, null_mut(), room, &mut count));
                }
                31 => {
                    let (body, room) = (choices.index(), choices.count());
                    check(palpate_skin_triangles(simulation, body, triangles.as_mut_ptr(), room, &mut count));
                    let (mut first, mut number) = (0, 0);
                    check(palpate_skin_range(simulation, body, &mut first, &mut number));
                }
                32 => {
                    let mut contacts: Vec<palpate_contact> = (0..64).map(|_| std::mem::zeroed()).collect();
                    check(palpate_contacts(simulation, contacts.as_mut_ptr(), choices.count() % 65, &mut count));
                }
                _ => {
                    let mut size = 0;
                    check(palpate_context_memory(choices.handle(&contexts), &mut size));
                    check(palpate_scene_cache(scene, null()));
                    let folder = CString::default();
                    let mut made = null_mut();
                    if check(palpate_scene_load(folder.as_ptr(), &mut made)) {
                        scenes.push(made);
                    }
                }
            }
        }
    }
    for simulation in simulations {
        check(palpate_simulation_destroy(simulation));
    }
    for scene in scenes {
        check(palpate_scene_destroy(scene));
    }
});
