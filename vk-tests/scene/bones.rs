//! Compares whole simulation steps of soft bodies with the f64 oracle, the reference implementation on the CPU, which
//! uses no moving coordinate frames. Some bodies have several rigid cores (rigid bodies inside a soft one, to which
//! nodes of its tetrahedral mesh are attached); a core is fixed, driven (it moves as keys, poses at given times, say)
//! or dynamic (it moves freely). Other bodies are free: they have no core, and their floating frame, a rigid coordinate
//! frame, is fitted to their nodes. The tool is the rigid body that the haptic device leads through the virtual
//! coupling, a spring and damper.

use std::fmt::Write;

use glam::{DMat3, DQuat, DVec3};
use palpate::internal::prepare::{FrameMotion, Shape, layer};
use palpate::internal::step::tool::Tool;
use palpate::internal::step::trajectory::Trajectory;
use palpate::scene::Key;
use palpate::{Flags, Options, RigidState, Scene, Simulation};
use palpate_oracle as oracle;

use crate::scene::touch::{Place, Twin, press};
use crate::scene::whole_step::{open, relative_error, run, scene, soft_twin};

/// Greatest allowed error of node displacements, relative to the largest displacement; `whole_step.rs`, where cores are
/// fixed, allows as much.
pub const SHAPE: f64 = 2.0e-5;
/// Greatest allowed error of node velocities, relative to the largest velocity. It is greater than `SHAPE`, since the
/// solver finds changes of velocity to a tolerance relative to the whole right-hand side.
pub const SPEED: f64 = 1.0e-4;
/// Greatest allowed error of the force on the tool, relative to the largest force of the run.
const FORCE: f64 = 5.0e-5;

/// Text of a scene with a bar that is attached to a rigid core at either end. The first core is fixed, and the second
/// is driven along `keys`. `young` is Young's modulus, Pa.
pub fn bar(young: f64, keys: &str) -> String {
    format!(
        "[step]\ngravity = [0.0, -9.81, 0.0]\n[solver]\ntolerance = 5e-6\nmax_iterations = 1000\n[[body]]\n\
         name = \"bar\"\nlayer = {{ box = [[-0.1, -0.02, -0.02], [0.1, 0.02, 0.02]], cells = [12, 3, 3] }}\n\
         position = [0.4, 0.1, -0.2]\norientation = [0.1, 0.2, 0.3, 0.9273618495495703]\n\
         material = {{ young = {young:e}, poisson = 0.4, density = 1000.0, damping_stiffness = 0.002 }}\n\
         [[body.core]]\nname = \"left\"\nbind = {{ box = [[-0.2, -0.1, -0.1], [-0.08, 0.1, 0.1]] }}\n\
         [[body.core]]\nname = \"right\"\nmotion = \"driven\"\nkeys = {keys}\n\
         bind = {{ box = [[0.08, -0.1, -0.1], [0.2, 0.1, 0.1]] }}\n"
    )
}

/// Text of the keys of a driven core. Within 40 ms they turn the core by up to `angle` (rad) and shift it by up to
/// `shift` (m), from the pose in which the scene places the body.
pub fn keys(scene_position: DVec3, orientation: DQuat, angle: f64, shift: DVec3) -> String {
    let mut text = String::from("[");
    for (time, share) in [(0.0, 0.0), (0.02, 0.4), (0.04, 1.0)] {
        let q = DQuat::from_scaled_axis(angle * share * DVec3::new(0.6, 0.0, 0.8)) * orientation;
        let p = scene_position + share * shift;
        let _ =
            write!(text, "[{time:?}, {:?}, {:?}, {:?}, {:?}, {:?}, {:?}, {:?}], ", p.x, p.y, p.z, q.x, q.y, q.z, q.w);
    }
    text + "]"
}

/// Gives the attached nodes of the oracle's body `twin` the velocities of their driven cores over the step of `h`
/// seconds that ends at `time`.
pub fn carry(twin: &mut oracle::step::SoftBody, simulation: &Simulation, body: usize, time: f64, h: f64) {
    let place = &simulation.bodies()[body];
    let Shape::Soft { layer, frames, node_frames, .. } = &place.shape else { panic!("the body is not soft") };
    for (i, rest) in layer.nodes.iter().enumerate().filter(|(i, _)| layer.attached[*i]) {
        let FrameMotion::Kinematic(keys) = &frames[node_frames[i] as usize].motion else { continue };
        let trajectory = Trajectory::new(keys, Key { time: 0.0, position: DVec3::ZERO, orientation: DQuat::IDENTITY });
        let at = |time: f64| {
            let (position, orientation) = trajectory.pose(time);
            position + orientation * *rest
        };
        twin.velocity[i] = (at(time) - at(time - h)) / h;
    }
}

#[test]
fn a_bar_between_a_fixed_and_a_kinematic_core_bends_as_the_oracles() {
    let orientation = DQuat::from_xyzw(0.1, 0.2, 0.3, 0.9273618495495703);
    let position = DVec3::new(0.4, 0.1, -0.2);
    for (young, angle) in [(2e4, 0.4), (2e4, 1.5), (1e6, 0.4)] {
        let keys = keys(position, orientation, angle, DVec3::new(-0.02, 0.03, 0.01));
        let scene = scene(&bar(young, &keys));
        let mut simulation = open(&scene, None);
        let mut twin = oracle::step::Simulation::new(scene.step.dt, scene.step.gravity);
        twin.bodies.push(soft_twin(&simulation, 0));
        let (mut worst, mut flags, mut residual) = (0.0f64, 0, 0.0f64);
        for step in 1..=60 {
            let row = run(&mut simulation, 1).remove(0);
            flags |= row.flags.0;
            residual = residual.max(row.residual);
            carry(&mut twin.bodies[0], &simulation, 0, row.time, scene.step.dt);
            twin.step(None, &[]).unwrap();
            if step % 10 == 0 {
                let (moved, _) = simulation.nodes(0).unwrap().unwrap();
                worst = worst.max(relative_error(&moved, &twin.bodies[0].displacement));
            }
        }
        println!("bar at {young:e} Pa turned by {angle} rad: greatest relative error of displacements {worst:.1e}");
        assert!(
            flags == 0 && worst < SHAPE,
            "{young:e} Pa, {angle} rad: relative error of displacements {worst:e}, flags {flags}, residual {residual:e}"
        );
    }
}

/// Presses a block with a tool that the virtual coupling pulls, in the engine and in the oracle. Returns the greatest
/// force on the tool, N, the relative error of the force, and the relative error of displacements.
fn pressed(scene: &Scene, steps: usize) -> (f64, f64, f64) {
    let mut simulation = open(scene, None);
    let mut twin = Twin::new(scene, &simulation);
    let (mut forces, mut shape) = ((vec![], vec![]), 0.0f64);
    let h = scene.step.dt;
    for _ in 0..steps {
        let time = (forces.0.len() + 1) as f64 * h;
        carry(&mut twin.oracle.bodies[0], &simulation, 0, time, h);
        let row = run(&mut simulation, 1).remove(0);
        assert!(row.flags == Flags::default(), "step {}: flags {:?}", row.step, row.flags);
        let normal = DVec3::from(simulation.touch().unwrap().0[0].normal.map(f64::from));
        let contacts = if normal == DVec3::ZERO { vec![] } else { twin.contacts(normal.normalize()) };
        let RigidState { position, orientation, velocity, angular_velocity } =
            Trajectory::new(&scene.trajectory, scene.trajectory[0]).device(row.time, h);
        let device = oracle::tool::Device { position, orientation, velocity, angular_velocity };
        let report = twin.oracle.step(Some(&device), &contacts).unwrap();
        forces.0.push(row.tool.unwrap().force);
        forces.1.push(report.wrench.force);
        let (moved, _) = simulation.nodes(0).unwrap().unwrap();
        if contacts.len() > 4 {
            shape = shape.max(relative_error(&moved, &twin.oracle.bodies[0].displacement));
        }
    }
    let peak = forces.1.iter().map(|f| f.length()).fold(0.0, f64::max);
    (peak, relative_error(&forces.0, &forces.1), shape)
}

const TIGHT: &str = "tolerance = 1e-6\nmax_iterations = 1000";

#[test]
fn a_block_whose_core_is_kinematic_into_the_tool_pushes_as_the_oracles() {
    let text = press(2e4, 0.001, Place::default(), TIGHT);
    let driven = "motion = \"driven\"\nkeys = [[0.0, 0.0, 0.0, 0.0], \
                  [0.03, 0.001, 0.004, 0.0, 0.03, 0.0, 0.04, 0.9987492177719089]]";
    let scene = scene(&text.replace("motion = \"fixed\"", driven));
    let (peak, force, shape) = pressed(&scene, 50);
    println!(
        "block on a driven core: greatest force {peak:.2} N; relative errors of force {force:.1e}, of displacements \
         {shape:.1e}"
    );
    assert!(peak > 0.1 && force < FORCE && shape < SHAPE, "relative errors: force {force:e}, displacements {shape:e}");
}

/// The dynamic cores of a body as the oracle represents them, in their initial state.
pub fn twin_cores(simulation: &Simulation, body: usize) -> Vec<oracle::step::Core> {
    let place = &simulation.bodies()[body];
    let Shape::Soft { layer, frames, node_frames, .. } = &place.shape else { panic!("the body is not soft") };
    let core = |(index, frame): (usize, &palpate::internal::prepare::Frame)| {
        let FrameMotion::Dynamic { hinge, .. } = frame.motion else { return None };
        let attached = (0..layer.nodes.len()).filter(|n| layer.attached[*n] && node_frames[*n] == index as u32);
        Some(oracle::step::Core {
            nodes: attached.map(|n| (body, n as u32)).collect(),
            centre: place.position + place.orientation * frame.centre,
            velocity: if hinge.is_some() { DVec3::ZERO } else { place.velocity },
            spin: DVec3::ZERO,
            hinge: hinge.map(|hinge| place.orientation * hinge.axis),
        })
    };
    frames.iter().enumerate().filter_map(core).collect()
}

#[test]
#[ignore = "long: 9 s"]
fn dynamic_cores_and_the_bar_between_them_move_as_the_oracles() {
    // First one end is fixed and the other has a dynamic core; then both ends have dynamic cores, and the bar flies.
    for (name, left, velocity) in
        [("hanging", "", ""), ("flying", "motion = \"dynamic\"", "velocity = [0.3, 1.0, -0.2]")]
    {
        for young in [2e4, 1e6] {
            let text = bar(young, "[]")
                .replace("motion = \"driven\"\nkeys = []", "motion = \"dynamic\"")
                .replace("name = \"left\"", &format!("name = \"left\"\n{left}"))
                .replace("position = [0.4", &format!("{velocity}\nposition = [0.4"));
            let scene = scene(&text);
            let mut simulation = open(&scene, None);
            let mut twin = oracle::step::Simulation::new(scene.step.dt, scene.step.gravity);
            twin.bodies.push(soft_twin(&simulation, 0));
            twin.cores = twin_cores(&simulation, 0);
            for core in &twin.cores {
                core.nodes.iter().for_each(|(_, n)| twin.bodies[0].velocity[*n as usize] = core.velocity);
            }
            let rows = run(&mut simulation, 80);
            (0..80).for_each(|_| drop(twin.step(None, &[]).unwrap()));
            let (moved, velocities) = simulation.nodes(0).unwrap().unwrap();
            let shape = relative_error(&moved, &twin.bodies[0].displacement);
            let speed = relative_error(&velocities, &twin.bodies[0].velocity);
            let place = simulation.frames(0)[1];
            let centre = place.centre.distance(twin.cores[twin.cores.len() - 1].centre);
            println!(
                "{name} bar at {young:e} Pa: relative errors of displacements {shape:.1e}, of velocities {speed:.1e}; \
                 error of the last core's centre {centre:.1e} m; up to {} solver iterations",
                rows.iter().map(|r| r.iterations).max().unwrap()
            );
            assert!(rows.iter().all(|row| row.flags == Flags::default()));
            assert!(
                shape < SHAPE && speed < SPEED && centre < 1e-6,
                "{name} bar at {young:e} Pa: relative errors of displacements {shape:e}, of velocities {speed:e}; \
                 error of the last core's centre {centre:e} m"
            );
        }
    }
}

#[test]
fn a_dynamic_rigid_body_falls_on_a_block_as_a_tool_that_nobody_holds() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("ball.obj");
    let (vertices, triangles) = palpate::internal::prepare::sphere::icosphere(0.02);
    palpate::scene::obj::write(&mut std::fs::File::create(&file).unwrap(), &vertices, &triangles).unwrap();
    // By default triangles would be tested against the tool, which they are against no dynamic body.
    let block = "[solver]\ntolerance = 1e-6\nmax_iterations = 1000\n[contact]\nsamples = \"vertices\"\n[[body]]\n\
        name = \"block\"\nlayer = { box = [[-0.05, -0.03, -0.05], [0.05, 0.03, 0.05]], cells = [8, 5, 8] }\n\
        material = { young = 2e4, poisson = 0.4, density = 1000.0 }\n\
        [[body.core]]\nname = \"bottom\"\nbind = { box = [[-1.0, -1.0, -1.0], [1.0, -0.029, 1.0]] }\n";
    let start = "position = [0.02, 0.052, -0.01]\nvelocity = [0.1, -0.4, 0.0]";
    let tool = scene(&format!("{block}[tool]\nsphere = 0.02\nmass = 0.05\n{start}\n"));
    let body = scene(&format!(
        "{block}[[body]]\nname = \"ball\"\nsurface = {file:?}\nmotion = \"dynamic\"\nmass = 0.05\n{start}\n"
    ));
    let (mut one, mut other) = (open(&tool, None), open(&body, None));
    let (mut a, mut b) = (run(&mut one, 40), run(&mut other, 40));
    // Displacements are compared after 40 steps, in the midst of the contact. The run ends before the second bounce,
    // which would magnify rounding errors.
    let error = relative_error(&other.nodes(0).unwrap().unwrap().0, &one.nodes(0).unwrap().unwrap().0);
    a.extend(run(&mut one, 60));
    b.extend(run(&mut other, 60));
    assert!(a.iter().chain(&b).all(|row| row.flags == Flags::default()));
    let touched = a.iter().filter(|row| row.contacts.unwrap() > 0).count();
    let held = one.tool().unwrap();
    let place = other.frames(1)[0];
    let (away, turned) = (place.centre.distance(held.centre), place.rotation.angle_between(held.orientation));
    println!(
        "ball as a body and ball as the tool: {touched} steps in contact; at the end their centres are {away:.1e} m \
         apart and their orientations differ by {turned:.1e} rad; relative difference of the block's displacements \
         {error:.1e}"
    );
    assert!(
        touched > 30 && away < 1e-7 && turned < 1e-5 && error < SHAPE,
        "centres of ball and tool are {away:e} m apart, their orientations differ by {turned:e} rad; relative \
         difference of the block's displacements {error:e}"
    );
}

/// The surface of a cube, as the text of an OBJ file; `half` is half of its edge, m.
pub fn cube(half: f64) -> String {
    let (vertices, triangles, _) = layer::boundary(&layer::kuhn_box(DVec3::splat(-half), DVec3::splat(half), [3; 3]));
    let v = vertices.iter().map(|x| format!("v {:?} {:?} {:?}\n", x.x, x.y, x.z));
    let f = triangles.iter().map(|t| format!("f {} {} {}\n", t[0] + 1, t[1] + 1, t[2] + 1));
    v.chain(f).collect()
}

#[test]
fn a_kinematic_body_presses_as_if_the_other_came_to_it() {
    // Either a rigid cube comes down on a block, or the cube rests while the block's core moves up. Relative to the
    // core, the cube moves alike in both cases.
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("cube.obj");
    std::fs::write(&file, cube(0.02)).unwrap();
    let run_with = |block: &str, core: &str, body: &str| {
        let text = format!(
            "[step]\ngravity = [0.0, 0.0, 0.0]\n[solver]\n{TIGHT}\n[[body]]\nname = \"block\"\n{block}\n\
             layer = {{ box = [[-0.04, -0.04, -0.04], [0.04, 0.0, 0.04]], cells = [8, 4, 8] }}\n\
             material = {{ young = 2e4, poisson = 0.4, density = 1000.0 }}\n\
             [[body.core]]\nname = \"bottom\"\n{core}\nbind = {{ box = [[-1.0, -1.0, -1.0], [1.0, -0.039, 1.0]] }}\n\
             [[body]]\nname = \"cube\"\nsurface = {file:?}\n{body}\n"
        );
        let mut simulation = open(&scene(&text), None);
        let rows = run(&mut simulation, 80);
        assert!(rows.iter().all(|row| row.flags == Flags::default()));
        assert!(
            rows[79].contacts.unwrap() > 8,
            "contacts in the last step: {:?}, expected more than 8",
            rows[79].contacts
        );
        (simulation.nodes(0).unwrap().unwrap().0, simulation.frames(0)[0].centre)
    };
    let down = "motion = \"driven\"\nkeys = [[0.0, 0.003, 0.0205, 0.0, 0.1, 0.0, 0.0, 0.99498743710662], \
                [0.08, 0.003, 0.0125, 0.0, 0.1, 0.0, 0.0, 0.99498743710662]]";
    let (pressed, start) = run_with("", "", down);
    let rest = "position = [0.003, 0.0205, 0.0]\norientation = [0.1, 0.0, 0.0, 0.99498743710662]";
    let up = "motion = \"driven\"\nkeys = [[0.0, 0.0, 0.0, 0.0], [0.08, 0.0, 0.008, 0.0]]";
    let (lifted, end) = run_with("velocity = [0.0, 0.1, 0.0]", up, rest);
    let lift = end - start;
    assert!((lift - DVec3::Y * 0.008).length() < 1e-12, "the core moved by {lift} m, expected 0.008 m along y");
    let relative: Vec<DVec3> = lifted.iter().map(|d| *d - lift).collect();
    let error = relative_error(&relative, &pressed);
    let largest = pressed.iter().map(|d| d.length()).fold(0.0, f64::max);
    println!(
        "moving cube and moving core: relative difference of displacements {error:.1e}, largest displacement \
         {largest:.4} m"
    );
    assert!(largest > 0.005 && error < SHAPE, "relative difference of displacements {error:e}");
}

#[test]
fn a_slab_that_tumbles_gains_no_energy() {
    // No force acts on the slab. It spins about an axis near that of its middle principal moment of inertia, where
    // rotation is unstable. The time step is 1, 4 or 33 ms.
    for dt in [0.001, 0.004, 0.033] {
        let size = DVec3::new(0.3, 0.04, 1.0);
        let inertia = DMat3::from_diagonal(DVec3::new(
            size.y * size.y + size.z * size.z,
            size.x * size.x + size.z * size.z,
            size.x * size.x + size.y * size.y,
        )) * (0.1 / 12.0);
        let (velocity, position) = (DVec3::ZERO, DVec3::ZERO);
        let mut tool = Tool {
            mass: 0.1,
            inertia,
            coupling: None,
            centre: position,
            orientation: DQuat::IDENTITY,
            velocity,
            angular_velocity: DVec3::new(3.0, 0.3, 0.2),
        };
        let energy = |tool: &Tool| {
            let turn = DMat3::from_quat(tool.orientation);
            let w = tool.angular_velocity;
            0.5 * w.dot(turn * tool.inertia * turn.transpose() * w)
        };
        let (start, mut most) = (energy(&tool), 0.0f64);
        let still = RigidState { position, orientation: DQuat::IDENTITY, velocity, angular_velocity: DVec3::ZERO };
        for _ in 0..(20.0 / dt) as usize {
            let rows = tool.rows(dt, DVec3::ZERO, &still);
            let block = DMat3::from_cols_array_2d(&[0, 1, 2].map(|c| [0, 1, 2].map(|r| rows.matrix[3 + r][3 + c])));
            let change = (block.inverse() * DVec3::from_slice(&rows.rhs[3..])).as_vec3();
            tool.advance(dt, [0.0, 0.0, 0.0, change.x.into(), change.y.into(), change.z.into()]);
            most = most.max(energy(&tool));
        }
        println!(
            "slab in steps of {dt} s: kinetic energy relative to that at the start: at most {:.6}, after 20 s {:.3}",
            most / start,
            energy(&tool) / start
        );
        assert!(most < 1.01 * start, "steps of {dt} s: greatest energy {most} J, at the start {start} J");
    }
}

#[test]
fn a_human_bends_its_arm() {
    // The scene, which comes with the program, turns a forearm about its elbow by half a radian in 0.2 s.
    let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/scenes/touch-human.toml");
    let elbow = DVec3::new(0.457, 1.395, -0.012);
    let turn = DQuat::from_rotation_y(-0.5);
    let options =
        Options { device: std::env::var("PALPATE_TEST_DEVICE").ok(), validation: false, ..Options::of_program() };
    let mut simulation = Simulation::open(&Scene::load(&file).unwrap(), &options).unwrap();
    let rows: Vec<_> = (0..200).map(|_| simulation.step().unwrap()).collect();
    assert!(rows.iter().all(|row| row.flags == Flags::default()));
    let Shape::Soft { layer, frames, node_frames, proxies, .. } = &simulation.bodies()[0].shape else {
        panic!("the body is not soft")
    };
    let driven = |frame: u32| matches!(frames[frame as usize].motion, FrameMotion::Kinematic(_));
    assert!(proxies.iter().any(|proxy| driven(proxy.frame)), "the forearm must have collision proxies (convex hulls)");
    let (moved, _) = simulation.nodes(0).unwrap().unwrap();
    // Nodes attached to the driven core, the forearm's bone, are where the bone took them, and nodes attached to other
    // bones have not moved. The free nodes between them are displaced.
    let (mut attached, mut free) = (0, 0.0f64);
    for (n, d) in moved.iter().enumerate() {
        let taken = turn * (layer.nodes[n] - elbow) + elbow - layer.nodes[n];
        match (layer.attached[n], driven(node_frames[n])) {
            (true, true) => {
                attached += 1;
                assert!(d.distance(taken) < 1e-9, "displacement {d} m of an attached node, expected {taken} m");
            }
            (true, false) => assert!(d.length() < 1e-9),
            (false, _) => free = free.max(d.length()),
        }
    }
    println!("human: {attached} nodes attached to the forearm; free nodes moved by up to {free:.3} m");
    assert!(attached > 3 && free > 0.05 && free < 0.5);
}

#[test]
fn a_free_block_is_pushed_away_and_spun_as_the_oracles() {
    // The block is struck near its edge while it flies freely, so that it spins.
    let place = Place { slide: DVec3::ZERO, ..Place::default() };
    let text = press(2e4, 0.001, place, TIGHT);
    let core = text.find("[[body.core]]").unwrap();
    let end = text.find("[tool]").unwrap();
    let free = format!("{}{}", &text[..core], &text[end..])
        .replace("position = [0.0, 0.0, 0.0]", "position = [0.03, 0.0, 0.01]\nvelocity = [0.0, 0.5, 0.2]");
    let (peak, force, shape) = pressed(&scene(&free), 120);
    println!(
        "free block: greatest force {peak:.2} N; relative errors of force {force:.1e}, of displacements {shape:.1e}"
    );
    assert!(peak > 0.1 && force < FORCE && shape < SHAPE, "relative errors: force {force:e}, displacements {shape:e}");
}

#[test]
fn a_floating_frame_keeps_up_with_a_body_that_flies_and_turns() {
    // The bar flies obliquely at a floor, and the end that meets the floor sets it spinning.
    let text = "[step]\ngravity = [0.0, 0.0, 0.0]\n[[body]]\nname = \"bar\"\n\
        layer = { box = [[-0.1, -0.015, -0.015], [0.1, 0.015, 0.015]], cells = [10, 2, 2] }\n\
        orientation = [0.0, 0.0, 0.3826834323650898, 0.9238795325112867]\nvelocity = [0.5, -2.0, 0.0]\n\
        material = { young = 2e5, poisson = 0.4, density = 1000.0 }\n\
        [[body]]\nname = \"floor\"\nplane = [0.0, 1.0, 0.0, -0.1]\n";
    let mut simulation = open(&scene(text), None);
    let rest = simulation.frames(0)[0];
    run(&mut simulation, 400);
    let Shape::Soft { layer, .. } = &simulation.bodies()[0].shape else { panic!("the body is not soft") };
    let layer = layer.clone();
    let (moved, velocity) = simulation.nodes(0).unwrap().unwrap();
    let frame = simulation.frames(0)[0];
    let mean = velocity.iter().sum::<DVec3>() / velocity.len() as f64;
    let turned = rest.rotation.angle_between(frame.rotation);
    // Relative to its floating frame, the bar is nearly in its rest shape, though it has moved far.
    let body = &simulation.bodies()[0];
    let away = moved.iter().map(|d| d.length()).fold(0.0, f64::max);
    let stray = layer.nodes.iter().zip(&moved).map(|(r, d)| {
        let x = body.position + body.orientation * (*r + *d);
        (frame.rotation.conjugate() * (x - frame.centre)).distance(*r)
    });
    let stray = stray.fold(0.0, f64::max);
    println!(
        "flying bar: nodes moved by up to {away:.2} m, frame turned by {turned:.2} rad; nodes up to \
         {stray:.1e} m from their rest places in the floating frame; mean velocity {mean:.2} m/s"
    );
    assert!(
        away > 0.2 && turned > 0.5 && stray < 0.01,
        "nodes moved by up to {away} m, frame turned by {turned} rad, nodes up to {stray} m from their rest places"
    );
}
