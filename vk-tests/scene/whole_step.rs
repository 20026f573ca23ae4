//! Scenes as a user writes them, run by the engine on the GPU, and helpers to compare their steps with the f64 oracle,
//! the reference implementation on the CPU.

use crate::harness::real_meshes::meshes;

use glam::DVec3;
use palpate::internal::prepare::Shape;
use palpate::internal::stages::depth;
use palpate::{Options, Scene, Simulation, StepReport};
use palpate_oracle as oracle;

/// Writes a scene to a file of its own and loads it.
pub fn scene(text: &str) -> Scene {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scene.toml");
    std::fs::write(&file, text).unwrap();
    Scene::load(&file).unwrap_or_else(|e| panic!("{e}\n{text}"))
}

/// Opens a simulation of the scene with Vulkan's validation layer on. `path` chooses the implementation of the depth
/// stage (graphics or compute) if it is given.
pub fn open(scene: &Scene, path: Option<depth::Path>) -> Simulation {
    crate::harness::turn();
    let options = Options {
        device: std::env::var("PALPATE_TEST_DEVICE").ok(),
        validation: crate::harness::validation(),
        ..Options::of_program()
    };
    let mut scene = scene.clone();
    scene.contact.depth = path.or(scene.contact.depth);
    Simulation::open(&scene, &options).unwrap()
}

/// Runs steps and returns their reports; any message of Vulkan's validation layer is a failure.
pub fn run(simulation: &mut Simulation, steps: usize) -> Vec<StepReport> {
    let rows = (0..steps).map(|_| simulation.step().unwrap()).collect();
    let messages = simulation.context().validation_messages();
    assert!(messages.is_empty(), "{messages:#?}");
    rows
}

/// A soft body as the oracle represents it, in the state in which the scene starts.
pub fn soft_twin(simulation: &Simulation, body: usize) -> oracle::step::SoftBody {
    let body = &simulation.bodies()[body];
    let Shape::Soft { layer, materials, supports, .. } = &body.shape else { panic!("{} is not soft", body.name) };
    oracle::step::SoftBody::new(layer.clone(), materials, body.position, body.orientation, body.velocity)
        .supported(supports)
}

/// Length of the largest difference divided by the length of the largest wanted vector.
pub fn relative_error(got: &[DVec3], want: &[DVec3]) -> f64 {
    let largest = want.iter().map(|x| x.length()).fold(0.0, f64::max);
    got.iter().zip(want).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max) / largest
}

/// Greatest allowed error of displacements after 20 steps, relative to the largest displacement. The engine keeps f32
/// displacements, and its solver stops at a relative residual of 1e-6.
const FREE_FALL: f64 = 2.0e-5;

#[test]
#[ignore = "needs real meshes"]
fn free_fall_of_a_bound_human_agrees_with_the_oracle() {
    let Some(meshes) = meshes() else { return };
    let file = meshes.join("tet/human.v41.msh");
    let layer = palpate::scene::gmsh::read(&file).unwrap();
    let centroid = layer.nodes.iter().sum::<DVec3>() / layer.nodes.len() as f64;
    for young in [2.0e4, 2.0e6] {
        let text = format!(
            "[solver]\ntolerance = 1e-6\nmax_iterations = 1000\n[[body]]\nname = \"human\"\nlayer = {file:?}\n\
             material = {{ young = {young:e}, poisson = 0.45, density = 1000.0 }}\n\
             [[body.core]]\nname = \"core\"\nmotion = \"fixed\"\n\
             bind = {{ sphere = [{}, {}, {}, 0.15] }}\n",
            centroid.x, centroid.y, centroid.z
        );
        let scene = scene(&text);
        let mut simulation = open(&scene, None);
        let mut twin = oracle::step::Simulation::new(scene.step.dt, scene.step.gravity);
        twin.bodies.push(soft_twin(&simulation, 0));
        let rows = run(&mut simulation, 20);
        for _ in 0..20 {
            twin.step(None, &[]).unwrap();
        }
        let (moved, _) = simulation.nodes(0).unwrap().unwrap();
        let error = relative_error(&moved, &twin.bodies[0].displacement);
        let iterations: Vec<u32> = rows.iter().map(|row| row.iterations).collect();
        println!(
            "free fall at {young:e} Pa: relative error of displacements {error:.2e}; solver iterations in each step \
             {iterations:?}"
        );
        assert!(rows.iter().all(|row| row.flags.0 == 0), "a step has flags at {young:e} Pa");
        assert!(error < FREE_FALL, "{young:e} Pa: relative error of displacements {error:e}");
    }
}

/// A block that lands on a corner. The contacts push and, on the rebound, pull: they are released.
fn rebound(operator: &str) -> String {
    format!(
        "[solver]\ntolerance = 1e-6\noperator = \"{operator}\"\n[contact]\nfriction = 0.3\n\
         [[body]]\nname = \"block\"\nhulls = 1\nposition = [0.0, 0.002, 0.0]\nvelocity = [0.2, -0.5, 0.0]\n\
         layer = {{ box = [[0.0, 0.0, 0.0], [0.06, 0.06, 0.06]], cells = [5, 5, 5] }}\n\
         material = {{ young = 2e4, poisson = 0.4, density = 1000.0 }}\n\
         [[body]]\nname = \"floor\"\nplane = [0.1, 1.0, 0.0, 0.0]\n"
    )
}

#[test]
fn plans_that_are_too_short_change_nothing() {
    // Plans of four iterations are cut off at any place, also between the two iterations that release contacts.
    let [usual, short] = [false, true].map(|forgets| {
        let mut simulation = open(&scene(&rebound("auto")), None);
        let (mut solves, mut submits) = (0, 0);
        for _ in 0..40 {
            if forgets {
                simulation.forget_needs();
            }
            let report = simulation.step().unwrap();
            assert_eq!(report.flags.0, 0);
            (solves, submits) = (solves + report.work.solves, submits + report.work.submits);
        }
        (simulation.nodes(0).unwrap().unwrap().0, solves, submits)
    });
    println!("solves {} and {}, submits {} and {}", usual.1, short.1, usual.2, short.2);
    assert_eq!(usual.0, short.0, "displacements with usual and with short plans");
    assert!(short.1 > 42 && usual.1 == short.1, "solves in 40 steps: {} and {}", usual.1, short.1);
    assert!(short.2 > 2 * usual.2, "submits in 40 steps: {} and {}", usual.2, short.2);
}

/// Greatest allowed difference of displacements after 70 steps between the two ways to apply the operator, relative to
/// the largest displacement. The solvers stop at a relative residual of 1e-6.
const OPERATORS: f64 = 1.0e-5;

#[test]
fn a_block_that_lands_and_rebounds_moves_alike_with_both_operators() {
    let moved = ["auto", "matrix-free"].map(|operator| {
        let mut simulation = open(&scene(&rebound(operator)), None);
        let rows = run(&mut simulation, 70);
        let contacts: Vec<_> = rows.iter().map(|row| row.contacts.unwrap_or_default()).collect();
        println!("{operator}: contacts in each step {contacts:?}");
        assert!(rows.iter().all(|row| row.flags.0 == 0), "{operator}: a step has flags");
        assert!(contacts.iter().any(|n| *n > 10) && contacts[69] == 0, "{operator}: no rebound: {contacts:?}");
        simulation.nodes(0).unwrap().unwrap().0
    });
    let error = relative_error(&moved[0], &moved[1]);
    println!("difference of displacements: {error:.2e}");
    assert!(error < OPERATORS, "the two operators lead to displacements that differ by {error:e}");
}

/// Greatest allowed number of bytes on the GPU per tetrahedron, in all arrays together, for a scene without contact; some
/// 185 of them are the assembled operator and the lists of edges.
const BYTES: f64 = 625.0;

#[test]
fn a_tetrahedron_takes_little_memory() {
    for young in [2.0e4, 2.0e6] {
        let text = format!(
            "[[body]]\nname = \"block\"\nhulls = 1\n\
             layer = {{ box = [[0.0, 0.0, 0.0], [0.1, 0.1, 0.1]], cells = [12, 12, 12] }}\n\
             material = {{ young = {young:e}, poisson = 0.45, density = 1000.0 }}\n[[body.core]]\nname = \"core\"\n\
             bind = {{ box = [[-1e-6, -1e-6, -1e-6], [1e-6, 1.0, 1.0]] }}\n"
        );
        let bytes = open(&scene(&text), None).context().bytes_allocated() as f64 / f64::from(6 * 12u32.pow(3));
        println!("{young:e} Pa: {bytes:.0} bytes per tetrahedron");
        assert!(bytes <= BYTES, "{young:e} Pa: {bytes} bytes per tetrahedron");
    }
}
