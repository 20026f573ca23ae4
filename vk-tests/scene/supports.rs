//! Supports (conditions on the motion of a soft body's nodes) and reactions (the forces that hold a body) in whole
//! scenes: steps beside the f64 oracle (the reference implementation on the CPU), balances of forces, and closed forms.

use glam::{DMat3, DVec3};
use palpate::internal::prepare::Shape;
use palpate::{Simulation, StepReport, Wrench};
use palpate_oracle as oracle;

use crate::invariant::friction::beside;
use crate::scene::loads::piola;
use crate::scene::whole_step::{open, relative_error, run, scene, soft_twin};

/// Greatest errors against the oracle: of displacements, and of reactions, each relative to the largest.
const SHAPE: f64 = 1e-5;
const REACTION: f64 = 1e-5;
/// Greatest error of reactions where stiff contacts press.
const PRESSED_REACTION: f64 = 1e-4;

/// The reactions that the oracle's holding forces (per node, N) of a body make, with the nodes where the oracle's body has
/// them: as the engine reports them, in the same order.
pub fn reactions_of(
    simulation: &Simulation,
    index: usize,
    twin: &oracle::step::SoftBody,
    holding: &[DVec3],
) -> Vec<Wrench> {
    let body = &simulation.bodies()[index];
    let Shape::Soft { supports, .. } = &body.shape else { panic!("{} is not soft", body.name) };
    let turn = DMat3::from_quat(body.orientation);
    let wrench = |holder: &palpate::internal::prepare::supports::Holder| {
        let mut sum = Wrench::ZERO;
        for (node, share) in &holder.nodes {
            let force = turn * *share * turn.transpose() * holding[*node as usize];
            sum.force += force;
            sum.torque += twin.world_node(*node).cross(force);
        }
        sum
    };
    supports.holders.iter().map(wrench).collect()
}

/// Greatest difference of reactions, relative to the largest force and torque among them.
pub fn reaction_error(got: &[Wrench], want: &[Wrench]) -> f64 {
    assert_eq!(got.len(), want.len());
    let parts = |all: &[Wrench], of: fn(&Wrench) -> DVec3| all.iter().map(of).collect::<Vec<_>>();
    let error = |of: fn(&Wrench) -> DVec3| relative_error(&parts(got, of), &parts(want, of));
    error(|wrench| wrench.force).max(error(|wrench| wrench.torque))
}

/// A block that stands oblique in the world and moves at the start. Three supports hold it along planes that are not
/// orthogonal, one along lines, one at points; a driven core pulls at it.
pub fn held_block(law: &str, newton: u32, solver: &str) -> String {
    format!(
        "[step]\ndt = 0.002\nnewton = {newton}\n[solver]\ntolerance = 1e-6\nmax_iterations = 1000\n{solver}\n\
         [[body]]\nname = \"block\"\nposition = [0.3, -0.2, 0.5]\norientation = [0.3, -0.1, 0.4, 0.860232526704]\n\
         velocity = [0.05, 0.1, -0.07]\nlayer = {{ box = [[0.0, 0.0, 0.0], [0.05, 0.06, 0.04]], cells = [5, 6, 4] }}\n\
         material = {{ young = 2e4, poisson = 0.4, density = 1000.0, damping_mass = 2.0, damping_stiffness = 1e-3, \
         law = \"{law}\" }}\n\
         [[body.support]]\nname = \"side\"\nplane = [1, 0, 0]\nbind = {{ box = [[-1, -1, -1], [1e-6, 1, 1]] }}\n\
         [[body.support]]\nname = \"oblique\"\nplane = [3, 4, 0]\nbind = {{ box = [[-1, -1, -1], [1, 1e-6, 1]] }}\n\
         [[body.support]]\nname = \"back\"\nplane = [0, 0, 1]\nbind = {{ box = [[-1, -1, -1], [1, 1, 1e-6]] }}\n\
         [[body.support]]\nname = \"guide\"\naxis = [1, 2, 2]\nbind = {{ sphere = [0.05, 0.03, 0.04, 0.0051] }}\n\
         [[body.support]]\nname = \"pin\"\npoint = true\nbind = {{ sphere = [0.05, 0.01, 0.02, 0.0051] }}\n\
         [[body.core]]\nname = \"grip\"\nmotion = \"driven\"\n\
         keys = [[0.0, 0.3, -0.2, 0.5, 0.3, -0.1, 0.4, 0.860232526704], \
         [0.04, 0.304, -0.198, 0.501, 0.32, -0.12, 0.38, 0.859464949254]]\n\
         bind = {{ box = [[0.01, 0.0599, 0.01], [0.04, 0.0601, 0.03]] }}\n"
    )
}

/// Runs the block of [`held_block`] and the oracle side by side.
fn beside_the_oracle(text: &str, steps: usize) -> [f64; 2] {
    let scene = scene(text);
    let mut simulation = open(&scene, None);
    let mut twin = oracle::step::Simulation::new(scene.step.dt, scene.step.gravity);
    twin.newton = scene.step.newton as usize;
    twin.bodies.push(soft_twin(&simulation, 0));
    let names: Vec<_> = simulation.reaction_names().map(String::from).collect();
    assert_eq!(names, ["grip", "side", "oblique", "back", "guide", "pin"].map(|name| format!("block.{name}")));
    let (mut shape, mut reaction) = (0.0f64, 0.0f64);
    let body = simulation.bodies()[0].clone();
    let Shape::Soft { layer, node_frames, .. } = &body.shape else { panic!() };
    // The core's pose at the start and at the end of the step gives the velocity of its nodes.
    let pose = |simulation: &Simulation| simulation.core_pose(0, 0).unwrap();
    let mut before = pose(&simulation);
    for _ in 0..steps {
        let row = run(&mut simulation, 1).remove(0);
        assert_eq!(row.flags.0, 0, "flags of step {}", row.step);
        let after = pose(&simulation);
        let place = |at: palpate::Pose, node: usize| at.position + at.orientation * layer.nodes[node];
        for node in (0..layer.nodes.len()).filter(|n| layer.attached[*n] && node_frames[*n] == 0) {
            twin.bodies[0].velocity[node] = (place(after, node) - place(before, node)) / scene.step.dt;
        }
        before = after;
        let start = twin.bodies[0].clone();
        let report = twin.step(None, &[]).unwrap();
        let (moved, _) = simulation.nodes(0).unwrap().unwrap();
        shape = shape.max(relative_error(&moved, &twin.bodies[0].displacement));
        let want = reactions_of(&simulation, 0, &start, &report.holding[0]);
        reaction = reaction.max(reaction_error(&row.reactions, &want));
    }
    [shape, reaction]
}

#[test]
#[ignore = "long: 20 s"]
fn a_supported_block_moves_and_is_held_as_the_oracles() {
    for (law, newton, solver) in [
        ("corotational", 1, ""),
        ("corotational", 1, "operator = \"matrix-free\""),
        ("neo-hookean", 1, "preconditioner = \"coarse\""),
        ("neo-hookean", 3, ""),
    ] {
        let [shape, reaction] = beside_the_oracle(&held_block(law, newton, solver), 20);
        println!("{law}, newton {newton}, {solver}: displacements {shape:.2e}, reactions {reaction:.2e}");
        assert!(shape < SHAPE, "{law}, newton {newton}, {solver}: relative error of displacements {shape:e}");
        assert!(reaction < REACTION, "{law}, newton {newton}, {solver}: relative error of reactions {reaction:e}");
    }
}

/// A block on rollers, one of whose sides is a plane of symmetry, under a tool that presses and rubs.
const PRESSED: &str = "[solver]\ntolerance = 1e-6\nmax_iterations = 1000\n[contact]\nstiffness = 3e7\nfriction = 0.5\n\
    [[body]]\nname = \"block\"\nlayer = { box = [[-0.04, 0.0, -0.04], [0.04, 0.04, 0.04]], cells = [6, 3, 6] }\n\
    material = { young = 2e4, poisson = 0.45, density = 1000.0, damping_stiffness = 0.002 }\n\
    [[body.support]]\nname = \"floor\"\nplane = [0, 1, 0]\nbind = { box = [[-1, -1, -1], [1, 1e-6, 1]] }\n\
    [[body.support]]\nname = \"left\"\nplane = [1, 0, 0]\nbind = { box = [[-1, -1, -1], [-0.0399, 1, 1]] }\n\
    [[body.support]]\nname = \"back\"\nplane = [0, 0, 1]\nbind = { box = [[-1, -1, -1], [1, 1, -0.0399]] }\n\
    [tool]\nsphere = 0.02\nmass = 0.1\nposition = [0.003, 0.0615, -0.002]\n\
    [coupling]\nstiffness = 500.0\ndamping = 5.0\n\
    [drive]\nkeys = [[0.0, 0.003, 0.0615, -0.002], [0.03, 0.003, 0.055, -0.002], [0.06, 0.009, 0.054, 0.002]]\n";

#[test]
#[ignore = "long: 15 s"]
fn a_block_on_rollers_is_pressed_and_rubbed_as_the_oracles() {
    let scene = scene(PRESSED);
    let (mut error, mut peak) = (0.0f64, 0.0f64);
    let mut start = soft_twin(&open(&scene, None), 0);
    let errors = beside(&scene, 60, |row, simulation, twin, report| {
        let want = reactions_of(simulation, 0, &start, &report.holding[0]);
        error = error.max(reaction_error(&row.reactions, &want));
        peak = peak.max(row.tool.unwrap().force.length());
        start = twin.oracle.bodies[0].clone();
    });
    println!("{errors:?}, reactions {error:.2e}, greatest force on the tool {peak:.2} N");
    assert!(peak > 0.5, "the tool was pressed by {peak} N");
    assert!(errors.force < 5e-5 && errors.shape < SHAPE && errors.place < 1e-7, "errors {errors:?}");
    assert!(error < PRESSED_REACTION, "relative error of reactions {error:e}");
}

/// Momentum of a soft body, kg m/s, and its mass, kg.
fn momentum(simulation: &Simulation) -> (DVec3, f64) {
    let mut twin = soft_twin(simulation, 0);
    (twin.displacement, twin.velocity) = simulation.nodes(0).unwrap().unwrap();
    (twin.momentum(), twin.elements.masses.iter().sum())
}

fn sum(reactions: &[Wrench]) -> Wrench {
    let add = |a: Wrench, b: &Wrench| Wrench { force: a.force + b.force, torque: a.torque + b.torque };
    reactions.iter().fold(Wrench::ZERO, add)
}

#[test]
fn reactions_weight_and_contact_make_the_change_of_momentum() {
    let scene = scene(PRESSED);
    let mut simulation = open(&scene, None);
    let (mut before, mass) = momentum(&simulation);
    let (mut error, mut largest) = (0.0f64, 0.0f64);
    for _ in 0..80 {
        let row = run(&mut simulation, 1).remove(0);
        let (after, _) = momentum(&simulation);
        let held = sum(&row.reactions).force;
        let all = held + mass * scene.step.gravity - row.tool.unwrap().force;
        error = error.max((all - (after - before) / scene.step.dt).length());
        largest = largest.max(held.length());
        before = after;
    }
    // What the solver leaves of the equations is not held by anything.
    println!("largest sum of reactions {largest:.3} N, greatest error of the balance {error:.1e} N");
    assert!(error < 2e-5 * largest, "the balance is off by {error} N of {largest} N");
}

#[test]
fn at_rest_reactions_carry_the_weight() {
    // The damping makes the block come to rest; the steps are long.
    let text = PRESSED
        .replace("[solver]", "[step]\ndt = 0.01\n[solver]")
        .replace("damping_stiffness = 0.002", "damping_mass = 20.0");
    let alone = text.split("[tool]").next().unwrap();
    for turn in ["", "orientation = [0.0, 0.0, 0.38268343236509, 0.92387953251129]\nposition = [2.0, -3.0, 5.0]\n"] {
        let scene = scene(&alone.replace("name = \"block\"\n", &format!("name = \"block\"\n{turn}")));
        let mut simulation = open(&scene, None);
        let row: StepReport = run(&mut simulation, 150).pop().unwrap();
        let (_, mass) = momentum(&simulation);
        let held = sum(&row.reactions);
        let weight = mass * scene.step.gravity;
        let force = (held.force + weight).length() / weight.length();
        // The torque of the weight about the world's origin, with the nodes where they came to rest.
        let mut twin = soft_twin(&simulation, 0);
        (twin.displacement, _) = simulation.nodes(0).unwrap().unwrap();
        let of_weight: DVec3 = (twin.world_nodes().iter().zip(&twin.elements.masses))
            .map(|(place, mass)| place.cross(*mass * scene.step.gravity))
            .sum();
        let arm = twin.world_nodes()[0].length().max(0.08);
        let torque = (held.torque + of_weight).length() / (arm * weight.length());
        println!("reactions less weight: force {force:.1e}, torque {torque:.1e}");
        assert!(force < 1e-5, "the sum of reactions differs from the weight by {force:e} of it");
        assert!(torque < 1e-5, "the torque of reactions differs from that of the weight by {torque:e}");
    }
}

/// A box whose sides slide on rollers and whose top follows a driven core, so that it is stretched uniformly.
fn confined(law: &str, stretch: f64) -> String {
    let height = 0.05 * (stretch - 1.0);
    format!(
        "[step]\ndt = 0.01\ngravity = [0.0, 0.0, 0.0]\n[solver]\ntolerance = 1e-7\nmax_iterations = 2000\n\
         [[body]]\nname = \"box\"\nlayer = {{ box = [[0.0, 0.0, 0.0], [0.04, 0.05, 0.03]], cells = [4, 5, 3] }}\n\
         material = {{ young = 2e4, poisson = 0.4, density = 1000.0, damping_mass = 30.0, law = \"{law}\" }}\n\
         [[body.support]]\nname = \"bottom\"\nplane = [0, 1, 0]\nbind = {{ box = [[-1, -1, -1], [1, 1e-6, 1]] }}\n\
         [[body.support]]\nname = \"left\"\nplane = [1, 0, 0]\nbind = {{ box = [[-1, -1, -1], [1e-6, 1, 1]] }}\n\
         [[body.support]]\nname = \"right\"\nplane = [1, 0, 0]\nbind = {{ box = [[0.039999, -1, -1], [1, 1, 1]] }}\n\
         [[body.support]]\nname = \"back\"\nplane = [0, 0, 1]\nbind = {{ box = [[-1, -1, -1], [1, 1, 1e-6]] }}\n\
         [[body.support]]\nname = \"front\"\nplane = [0, 0, 1]\nbind = {{ box = [[-1, -1, 0.029999], [1, 1, 1]] }}\n\
         [[body.core]]\nname = \"top\"\nmotion = \"driven\"\nbind = {{ box = [[-1, 0.049999, -1], [1, 1, 1]] }}\n\
         keys = [[0.0, 0.0, 0.0, 0.0], [0.5, 0.0, {height:?}, 0.0]]\n"
    )
}

#[test]
fn a_confined_box_is_held_by_the_stresses_of_the_closed_forms() {
    for law in ["corotational", "neo-hookean"] {
        for stretch in [0.8, 1.5] {
            let mut simulation = open(&scene(&confined(law, stretch)), None);
            let row = run(&mut simulation, 400).pop().unwrap();
            assert_eq!(row.flags.0, 0);
            // Nominal stresses along the stretch and across it, in the closed form of each law.
            let stress = piola(law, DMat3::from_diagonal(DVec3::new(1.0, stretch, 1.0)));
            let names: Vec<&str> = simulation.reaction_names().collect();
            let force =
                |name: &str| row.reactions[names.iter().position(|own| *own == format!("box.{name}")).unwrap()].force;
            let area = 0.04 * 0.03;
            let want = stress.y_axis.y * area;
            for (what, got) in [("top", force("top").y), ("bottom", -force("bottom").y)] {
                let error = (got / want - 1.0).abs();
                println!("{law}, stretch {stretch}: {what} {got:.6} N, closed form {want:.6} N, off by {error:.1e}");
                assert!(error < 1e-5, "{law}, stretch {stretch}: {what} {got} N, closed form {want} N");
            }
            // Across the stretch, the core carries what pulls at its own nodes, which is half of the uppermost of five rows
            // of cells; so a side carries nine tenths of the stress on it.
            let sideways = [force("left") + force("right"), force("back") + force("front")];
            assert!(
                sideways.iter().all(|sum| sum.length() < 1e-5 * want.abs()),
                "{law}: the sides differ: {sideways:?}"
            );
            let share = force("right").x / (stress.x_axis.x * 0.05 * 0.03);
            println!(
                "{law}, stretch {stretch}: the right side carries {share:.4} of the closed form; the core the rest"
            );
            assert!((share - 0.9).abs() < 1e-5, "{law}: the right side carries {share}");
        }
    }
}
