//! Tests of scenes with several tools, each a body that a haptic device of its own holds by a core (rigid body inside a
//! soft one) through a virtual coupling (spring and damper). Steps are compared with the f64 oracle, the reference
//! implementation on the CPU.

use glam::{DQuat, DVec3};
use palpate::internal::stages::PAIR_PATCHES;
use palpate::internal::step::{DeviceInput, RigidState};
use palpate::scene::Material;
use palpate::{Flags, Options, Pose, Simulation, StepReport, StepWork};

use crate::invariant::friction::{beside, device_momentum};
use crate::scene::whole_step::{open, relative_error, run, scene};

/// Greatest allowed errors against the oracle: of force and torque on each tool, each relative to the largest value of
/// its kind.
const FORCE: f64 = 5.0e-5;
const TORQUE: f64 = 1.0e-4;
/// Greatest difference between the block's momentum and the impulses of the tools, relative to the largest momentum. The
/// engine reports forces as f32.
const MOMENTUM: f64 = 1.0e-4;

/// Text of a table `[[tool]]` for the pad of this name, whose device moves from `start` to `end` (m) in 40 ms.
fn tool(name: &str, start: DVec3, end: DVec3) -> String {
    format!(
        "[[tool]]\nname = \"{name}\"\nbody = \"{name}\"\n\
         coupling = {{ stiffness = 500.0, damping = 5.0, angular_stiffness = 0.5, angular_damping = 0.002 }}\n\
         drive = {{ keys = [[0.0, {:?}, {:?}, {:?}], [0.04, {:?}, {:?}, {:?}, 0.05, 0.0, 0.02, 0.99854894]] }}\n",
        start.x, start.y, start.z, end.x, end.y, end.z
    )
}

/// Starts of the left and the right pad, and where their devices go, m.
const WAYS: [[DVec3; 2]; 2] = [
    [DVec3::new(-0.0325, 0.002, 0.0), DVec3::new(-0.0265, 0.004, 0.001)],
    [DVec3::new(0.0325, -0.001, 0.001), DVec3::new(0.028, 0.003, 0.0)],
];

/// Text of a scene with a free block of 40 mm that two soft pads of 24 mm squeeze from the left and from the right.
/// `tools`: text of the tables `[[tool]]`.
fn squeeze(tools: &str) -> String {
    let pad = |name: &str, at: DVec3, young: f64| {
        format!(
            "[[body]]\nname = \"{name}\"\n\
             layer = {{ box = [[-0.012, -0.012, -0.012], [0.012, 0.012, 0.012]], cells = [4, 4, 4] }}\n\
             position = [{:?}, {:?}, {:?}]\n\
             material = {{ young = {young:e}, poisson = 0.4, density = 1000.0, damping_stiffness = 0.002 }}\n\
             [[body.core]]\nname = \"handle\"\nmotion = \"dynamic\"\n\
             bind = {{ box = [[-0.007, -0.007, -0.007], [0.007, 0.007, 0.007]] }}\n",
            at.x, at.y, at.z
        )
    };
    format!(
        "[step]\ngravity = [0.0, 0.0, 0.0]\n[solver]\ntolerance = 1e-6\nmax_iterations = 1000\n\
         [contact]\nstiffness = 3e7\nfriction = 0.5\n\
         [[body]]\nname = \"block\"\n\
         layer = {{ box = [[-0.02, -0.02, -0.02], [0.02, 0.02, 0.02]], cells = [5, 5, 5] }}\n\
         material = {{ young = 2e4, poisson = 0.45, density = 1000.0, damping_stiffness = 0.002 }}\n{}{}{tools}",
        pad("left", WAYS[0][0], 5e4),
        pad("right", WAYS[1][0], 2e5),
    )
}

fn both() -> String {
    squeeze(&(tool("left", WAYS[0][0], WAYS[0][1]) + &tool("right", WAYS[1][0], WAYS[1][1])))
}

#[test]
#[ignore = "long: 20 s"]
fn two_pads_squeeze_a_block_as_the_oracles() {
    let scene = scene(&both());
    let (mut forces, mut torques) = ((vec![], vec![]), (vec![], vec![]));
    let (mut momenta, mut impulses, mut impulse) = (vec![], vec![], DVec3::ZERO);
    let errors = beside(&scene, 60, |row, simulation, _, report| {
        let [right] = row.further_tools[..] else { panic!("{} tools after the first", row.further_tools.len()) };
        forces.0.push(right.force);
        forces.1.push(report.further[0].force);
        torques.0.push(right.torque);
        torques.1.push(report.further[0].torque);
        // What the block gains in momentum are the impulses of the pads.
        impulse -= scene.step.dt * (row.tool.unwrap().force + right.force);
        impulses.push(impulse);
        momenta.push(device_momentum(simulation, 1).0);
    });
    let peak = forces.1.iter().map(|force| force.length()).fold(0.0, f64::max);
    let (force, torque) = (relative_error(&forces.0, &forces.1), relative_error(&torques.0, &torques.1));
    let momentum = relative_error(&momenta, &impulses);
    println!(
        "two pads: force on the right one up to {peak:.2} N, errors of its force {force:.1e} and torque {torque:.1e}, of \
         the left one {errors:?}; momentum of the block off by {momentum:.1e}"
    );
    assert!(peak > 0.5, "peak force {peak} N");
    assert!(errors.force < FORCE && errors.torque < TORQUE, "the left pad's errors are {errors:?}");
    assert!(force < FORCE && torque < TORQUE, "the right pad's errors are {force:e} and {torque:e}");
    assert!(momentum < MOMENTUM, "momentum is off by {momentum:e}");
}

/// Greatest difference of forces between scenes whose tools come in another order, relative to the largest force. The
/// solver stops at a relative residual of 1e-6.
const ORDER: f64 = 1.0e-4;

#[test]
fn the_order_of_tools_does_not_matter() {
    let [left, right] = [("left", WAYS[0]), ("right", WAYS[1])].map(|(name, [start, end])| tool(name, start, end));
    let forces = |tools: String, steps: usize| -> Vec<[DVec3; 2]> {
        let mut simulation = open(&scene(&squeeze(&tools)), None);
        let rows = run(&mut simulation, steps);
        rows.iter().map(|row| [row.tool.unwrap().force, row.further_tools[0].force]).collect()
    };
    let one = forces(left.clone() + &right, 30);
    let other = forces(right + &left, 30);
    for k in 0..2 {
        let [a, b] = [(&one, k), (&other, 1 - k)].map(|(all, k)| all.iter().map(|f| f[k]).collect::<Vec<_>>());
        let error = relative_error(&a, &b);
        println!("force on tool {k}: differs by {error:.1e} where the tools come in the other order");
        assert!(error < ORDER, "force on tool {k} differs by {error:e}");
        assert!(a[29].x.abs() > 0.1 && a[29].x * if k == 0 { -1.0 } else { 1.0 } > 0.0, "force on tool {k}: {}", a[29]);
    }
}

#[test]
fn a_haptic_loop_leads_the_first_tool_and_the_others_follow_their_trajectories() {
    let scene = scene(&both());
    let mut simulation = open(&scene, None);
    let device = |time: f64| RigidState::at_rest(WAYS[0][0].lerp(WAYS[0][1], time / 0.04), DQuat::IDENTITY);
    let mut row = StepReport::default();
    for step in 1..=20 {
        let time = 1e-3 * f64::from(step);
        let (device, tool) = (device(time), device(0.0));
        let input = DeviceInput { ticks: 0, time, device, tool, coupling: scene.coupling, max_force: f64::INFINITY };
        row = simulation.step_device_input(&input, 1e-3).unwrap();
    }
    let (left, right) = (row.tool.unwrap(), row.further_tools[0]);
    assert!(left.device.position.distance(device(0.02).position) < 1e-12, "device at {}", left.device.position);
    let half = 0.5 * (WAYS[1][0] + WAYS[1][1]);
    assert!(right.device.position.distance(half) < 1e-12, "the other device is at {}", right.device.position);
    assert!(left.force.x < -0.01 && right.force.x > 0.01, "forces {} and {}", left.force, right.force);
    assert_eq!(row.flags, Flags::default());
}

#[test]
fn haptic_loops_lead_each_of_several_tools() {
    let [left, right] = [("left", WAYS[0]), ("right", WAYS[1])].map(|(name, [start, end])| tool(name, start, end));
    // The contact wrenches on the tools after 20 steps that loops have led: `ways` are those of the tools in their order.
    let wrenches = |tools: String, ways: [[DVec3; 2]; 2]| {
        let scene = scene(&squeeze(&tools).replacen("[0.0, 0.0, 0.0]", "[0.0, -9.81, 0.0]", 1));
        let mut simulation = open(&scene, None);
        let at = |k: usize, time: f64| RigidState::at_rest(ways[k][0].lerp(ways[k][1], time / 0.04), DQuat::IDENTITY);
        let mut last = Vec::new();
        for step in 1..=20 {
            let time = 1e-3 * f64::from(step);
            let input = |k: usize| DeviceInput {
                ticks: 0,
                time: time + k as f64,
                device: at(k, time),
                tool: at(k, 0.0),
                coupling: scene.coupling,
                // The springs would pull with up to 1.5 N.
                max_force: 0.5,
            };
            let inputs = [input(0), input(1)];
            let row = simulation.step_device_inputs(&inputs, 1e-3).unwrap();
            assert_eq!(row.flags, Flags::default());
            last = simulation.contact_wrenches(&inputs);
            for (k, wrench) in last.iter().enumerate() {
                assert_eq!((wrench.time, wrench.h, wrench.step), (inputs[k].time, 1e-3, step as u64));
            }
            assert_eq!(last[1].wrench.force, row.further_tools[0].force);
        }
        let resting = at(0, 0.0);
        let input = DeviceInput { ticks: 0, time: 1.0, device: resting, tool: resting, coupling: None, max_force: 1.0 };
        let error = |simulation: &mut Simulation, inputs: &[DeviceInput]| {
            simulation.step_device_inputs(inputs, 1e-3).unwrap_err().to_string()
        };
        assert!(error(&mut simulation, &[]).contains("needs the state of a device"));
        assert!(error(&mut simulation, &[input; 3]).contains("3 haptic devices are given, but only 2"));
        // A tool that the loops no longer lead has no wrench for them, and its coupling is the scene's again.
        let coupling = |simulation: &Simulation| simulation.tools().nth(1).unwrap().coupling;
        simulation.step_device_inputs(&[input; 2], 1e-3).unwrap();
        assert_eq!(coupling(&simulation), None);
        assert!(simulation.contact_wrenches(&[input; 2])[1].step > 0);
        simulation.step_device_input(&input, 1e-3).unwrap();
        assert_eq!(coupling(&simulation), scene.further_tools[0].coupling);
        assert_eq!(simulation.contact_wrenches(&[input; 2])[1].step, 0);
        let state = simulation.save().unwrap();
        let leave: [&dyn Fn(&mut Simulation); 3] = [
            &|simulation| simulation.couple(scene.coupling),
            &|simulation| drop(simulation.step().unwrap()),
            &|simulation| simulation.restore(&state).unwrap(),
        ];
        for leave in leave {
            simulation.step_device_inputs(&[input; 2], 1e-3).unwrap();
            assert_eq!(coupling(&simulation), None);
            leave(&mut simulation);
            assert_eq!(coupling(&simulation), scene.further_tools[0].coupling);
        }
        // A tool has the mass of its core's nodes, also when the density changes.
        let mass = |simulation: &Simulation| simulation.tools().nth(1).unwrap().mass;
        let body = scene.bodies.iter().position(|body| body.name == scene.further_tools[0].body).unwrap();
        let (before, material) = (mass(&simulation), simulation.materials(body)[0]);
        simulation.set_material(body, 0, Material { density: 2.0 * material.density, ..material }).unwrap();
        assert!((mass(&simulation) / before - 2.0).abs() < 1e-6);
        last
    };
    let one = wrenches(left.clone() + &right, WAYS);
    let other = wrenches(right + &left, [WAYS[1], WAYS[0]]);
    // Which tool comes first does not matter: force, stiffness and damping of a tool are the same.
    for (a, b) in [(one[0], other[1]), (one[1], other[0])] {
        let largest = |matrix: &[[f64; 6]; 6]| matrix.iter().flatten().fold(0.0f64, |most, x| most.max(x.abs()));
        let matrices = [(a.stiffness, b.stiffness), (a.damping, b.damping)];
        for (name, (a, b)) in ["stiffness", "damping"].into_iter().zip(matrices) {
            let difference: [[f64; 6]; 6] = std::array::from_fn(|i| std::array::from_fn(|k| a[i][k] - b[i][k]));
            let error = largest(&difference) / largest(&a);
            println!("{name} up to {:.2e}, differs by {error:.1e}", largest(&a));
            assert!(largest(&a) > 0.0 && error < 10.0 * ORDER, "{name} differs by {error:e}");
        }
        let error = (a.wrench.force - b.wrench.force).length() / a.wrench.force.length();
        println!("force {} differs by {error:.1e}", a.wrench.force);
        assert!(a.wrench.force.length() > 0.02 && error < 10.0 * ORDER, "force differs by {error:e}");
        let pressing = (a.pressing - b.pressing).abs() / a.pressing;
        assert!(pressing < 10.0 * ORDER, "pressing differs by {pressing:e}");
    }
}

#[test]
fn two_tools_touch_only_if_one_of_them_says_so() {
    let [left, right] = [("left", WAYS[0]), ("right", WAYS[1])].map(|(name, [start, end])| tool(name, start, end));
    let text = squeeze(&(left + &right));
    let pairs = |collides: &str| {
        let text = text.replacen("name = \"left\"", &format!("name = \"left\"\n{collides}"), 1);
        open(&scene(&text), None).touch().unwrap().0.len() / PAIR_PATCHES
    };
    assert_eq!([pairs(""), pairs("collides = [\"block\", \"right\"]"), pairs("collides = [\"block\"]")], [2, 3, 2]);
}

/// Mass of the ball, kg.
const BALL: f64 = 0.0503;

#[test]
#[ignore = "long: 60 s"]
fn lasting_two_spheres_lift_a_soft_ball_and_hold_it() {
    let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/scenes/grasp.toml");
    let scene = palpate::Scene::load(&file).unwrap();
    // Vulkan validation is left off: it would slow these runs down too much.
    let options = Options { device: std::env::var("PALPATE_TEST_DEVICE").ok(), ..Options::of_program() };
    let mut simulation = Simulation::open(&scene, &options).unwrap();
    let rows: Vec<StepReport> = (0..2700).map(|_| simulation.step().unwrap()).collect();
    let flagged = rows.iter().filter(|row| row.flags != Flags::default()).count();
    assert_eq!(flagged, 0, "steps with flags");
    // Lifted by 5 cm at 0.7 s, and held until 2.7 s.
    let top = |step: usize| rows[step - 1].probes[0].y;
    let (lifted, slip) = (top(700) - top(1), top(700) - top(2700));
    let carried = |row: &StepReport| -(row.tool.unwrap().force.y + row.further_tools[0].force.y);
    let weight = BALL * 9.81;
    let off = rows[2000..].iter().map(|row| (carried(row) / weight - 1.0).abs()).fold(0.0, f64::max);
    println!(
        "grasp: lifted by {:.1} mm, slips by {:.2} mm in 2 s, the tools carry its weight to {off:.1e}",
        1e3 * lifted,
        1e3 * slip
    );
    assert!(lifted > 0.045 && slip < 2.0 * scene.contact.friction_speed && off < 0.02);
    let mut again = Simulation::open(&scene, &options).unwrap();
    let same: Vec<StepReport> = (0..300).map(|_| again.step().unwrap()).collect();
    assert_eq!(numbers(&same), numbers(&rows[..300]));
}

fn numbers(rows: &[StepReport]) -> Vec<String> {
    let plain =
        |row: &StepReport| format!("{:?}", StepReport { step_us: 0.0, work: StepWork::default(), ..row.clone() });
    rows.iter().map(plain).collect()
}

#[test]
fn poses_lead_each_tool_and_saved_states_continue_it() {
    let scene = scene(&both());
    let mut simulation = open(&scene, None);
    let at = |k: usize, time: f64| {
        let [start, end] = WAYS[k];
        Pose { position: start.lerp(end, time / 0.04), ..Pose::default() }
    };
    let wrong = simulation.step_at_poses(&[Pose::default()]).unwrap_err().to_string();
    assert!(wrong.contains("1 poses are given for 2 tools"), "{wrong}");
    let lead = |simulation: &mut Simulation, steps: std::ops::Range<usize>| -> Vec<StepReport> {
        let time = |step: usize| 1e-3 * (step + 1) as f64;
        steps.map(|step| simulation.step_at_poses(&[at(0, time(step)), at(1, time(step))]).unwrap()).collect()
    };
    let _ = lead(&mut simulation, 0..10);
    let state = simulation.save().unwrap();
    let rows = lead(&mut simulation, 10..20);
    assert!(rows.iter().all(|row| row.flags == Flags::default()));
    for (k, told) in [rows[9].tool.unwrap(), rows[9].further_tools[0]].into_iter().enumerate() {
        assert!(
            told.device.position.distance(at(k, 0.02).position) < 1e-12,
            "device {k} is at {}",
            told.device.position
        );
        assert!(told.force.x.abs() > 0.01, "force on tool {k}: {}", told.force);
    }
    let mut other = open(&scene, None);
    other.restore(&state).unwrap();
    assert_eq!(numbers(&lead(&mut other, 10..20)), numbers(&rows));
}
