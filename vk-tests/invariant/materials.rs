//! Tests of the material laws: neo-Hookean and corotational tetrahedra in one body, with different densities and
//! dampings, are compared with values computed by hand and with the oracle (the reference implementation in f64), whose
//! copy of a scene is called its twin.

use glam::{DMat3, DQuat, DVec3};
use palpate::internal::prepare::layer::volume6;
use palpate::internal::prepare::{Layer, Shape};
use palpate::scene::{Material, MaterialLaw};
use palpate_oracle as oracle;

use crate::harness::context;
use crate::harness::random::Random;
use crate::scene::whole_step::{open, relative_error, run, scene, soft_twin};
use crate::solver::system::{DT, System, layered, material, mixed, triples};
use crate::stage::elastic::{deformed_of, expect_of_largest, expect_oracle, stretched, sync};

/// Tolerance of forces relative to the largest force, which is that of the stiffest material; the tests of the
/// corotational law alone have the same tolerance.
const FORCE: f64 = 1.0e-5;
/// Tolerance of forces relative to the largest force, where strains are as small as 1e-6.
const TINY_STRAIN: f64 = 5.0e-6;
/// Tolerance relative to the largest value where the expected values are computed by hand: the sum of a dozen rounding
/// errors of f32.
const BY_HAND: f64 = 1.0e-6;
/// Tolerance of displacements after 20 steps, relative to the largest: ten times the measured error; the solver stops
/// at a relative residual of 1e-6.
const STEPS: f64 = 3.0e-6;

#[test]
fn a_neo_hookean_tetrahedron_stretched_by_half_by_hand() {
    // The kernel elastic/element_forces, which computes the forces of elements, runs on one tetrahedron with unit edges
    // along the axes. Its volume is V = 1/6, its deformation gradient F = diag(1.5, 1, 1). So |F|^2 = 4.25, J = det F =
    // 1.5, and the cofactor matrix of F is C = diag(1, 1.5, 1.5). With the Lame parameters mu and lambda, the stress is
    // P = 4/3 mu (1 - 1 / (|F|^2 + 1)) F + ((lambda + 5/6 mu) (J - 1) - mu) C.
    let nodes = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
    let layer = Layer { nodes, tetrahedra: vec![[0, 1, 2, 3]], attached: vec![false; 4], ..Layer::default() };
    let soft = Material { law: MaterialLaw::NeoHookean, ..material(2e4) };
    let mut system = System::new(&[layered(layer, soft, DQuat::IDENTITY)], 0.0, 1);
    system.velocity.fill([0.0; 4]);
    system.displacement[1] = [0.5, 0.0, 0.0, 0.0];
    system.rotate();
    let (mu, lambda) = (2e4 / 2.9, 2e4 * 0.45 / (1.45 * 0.1));
    let (first, pressure) = (4.0 / 3.0 * mu * (1.0 - 1.0 / 5.25), 0.5 * (lambda + 5.0 / 6.0 * mu) - mu);
    let (along, across) = (1.5 * first + pressure, first + 1.5 * pressure);
    let h = f64::from(DT) / 6.0;
    let want = [along, across, across, -along, 0.0, 0.0, 0.0, -across, 0.0, 0.0, 0.0, -across].map(|p| h * p);
    expect_of_largest("forces", &triples(&system.element_forces[..4]), &want, BY_HAND);
    // Gradients of the shape functions in the stretched tetrahedron, times the square root of V.
    let root = (1.0f64 / 6.0).sqrt();
    let want = [root / 1.5, 0.0, 0.0, 0.0, root, 0.0, 0.0, 0.0, root];
    expect_of_largest("gradients", &triples(&system.gradients[..3]), &want, BY_HAND);
}

#[test]
fn mixed_tetrahedra_agree_with_the_oracle_at_every_size() {
    let width = context().group_size() as usize;
    for count in [0, 1, width - 1, width, width + 1, 1234] {
        let mut system = deformed_of(&mixed(count), count, 7, |random| {
            let turn = DQuat::from_scaled_axis(0.5 * random.vector());
            let least = 0.8 + 0.1 * random.next();
            stretched(turn, least, random)
        });
        let [velocity, change] = [8, 9].map(|seed| system.random_field(&mut Random(seed)));
        system.velocity = velocity.iter().map(|v| v.map(|x| 0.1 * x)).collect();
        sync(&mut system);
        system.rotate();
        expect_oracle(&format!("{count} tetrahedra of mixed materials"), &system, FORCE);
        // The trial change of velocity is the result of a Newton iteration; the next iteration takes the elastic forces
        // at the displacements to which it leads.
        system.trial_change = change.iter().map(|v| v.map(|x| 0.1 * x)).collect();
        system.rotate();
        expect_oracle(&format!("{count} tetrahedra of mixed materials, trial change of velocity"), &system, FORCE);
    }
}

#[test]
fn mixed_tetrahedra_pressed_flat_and_inside_out_agree_with_the_oracle() {
    // Where a principal stretch lies below a limit, a compression penalty (an additional stiffness) acts in materials
    // of both laws, and the solver's matrix uses the gradients that neo-Hookean tetrahedra have at that limit.
    for (least, spread) in [(0.2, 0.09), (-0.35, 0.25)] {
        let mut system = deformed_of(&mixed(600), 600, 13, |random| {
            let (turn, least) = (random.turn(2.5), least + spread * random.next());
            stretched(turn, least, random)
        });
        for _ in 0..5 {
            system.rotate();
        }
        expect_oracle(&format!("least stretch {least}"), &system, FORCE);
        assert!(system.gradients.iter().flatten().all(|x| x.is_finite()));
    }
}

#[test]
fn mixed_tetrahedra_keep_the_digits_of_tiny_strains_and_rigid_ones_push_nothing() {
    let mut system = deformed_of(&mixed(300), 300, 17, |random| {
        let g = DMat3::from_cols(random.vector(), random.vector(), random.vector());
        DMat3::IDENTITY + 1e-6 * g
    });
    system.rotate();
    expect_oracle("tiny strains", &system, TINY_STRAIN);
    let size = |system: &System| {
        let forces = triples(&system.element_forces);
        forces.iter().fold(0.0f32, |m, x| m.max(x.abs()))
    };
    let tiny = size(&system);
    let mut turned = deformed_of(&mixed(300), 300, 19, |random| DMat3::from_quat(random.turn(2.5)));
    turned.rotate();
    // Rounding a rotation to f32 causes strains of a few 1e-7.
    assert!(size(&turned) < tiny, "force {:e} of rotated tetrahedra, {tiny:e} at strains of 1e-6", size(&turned));
}

#[test]
fn bodies_of_regions_and_of_either_law_step_as_the_oracles_do() {
    // Whole steps of a block 0.2 m long with regions of different materials: one end is fixed, the material at the
    // other end is neo-Hookean, and a sphere of a denser material lies in the middle of the block.
    for law in ["corotational", "neo-hookean"] {
        let text = format!(
            "[solver]\ntolerance = 1e-6\nmax_iterations = 1000\n[[body]]\nname = \"block\"\n\
             layer = {{ box = [[0, 0, 0], [0.2, 0.1, 0.1]], cells = [8, 4, 4] }}\n\
             material = {{ law = \"{law}\", young = 2e4, poisson = 0.45, density = 1000, damping_mass = 2 }}\n\
             [[body.region]]\nsphere = [0.1, 0.05, 0.05, 0.04]\n\
             material = {{ young = 1e5, density = 3000, damping_stiffness = 1e-3, damping_mass = 0 }}\n\
             [[body.region]]\nbox = [[0.12, 0, 0], [0.2, 0.1, 0.1]]\n\
             material = {{ law = \"neo-hookean\", young = 1e4 }}\n\
             [[body.core]]\nname = \"wall\"\nbind = {{ box = [[-0.001, 0, 0], [0.001, 0.1, 0.1]] }}\n"
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
        println!("{law} with material regions: displacements differ from the oracle's by {error:.2e} of the largest");
        assert!(rows.iter().all(|row| row.flags.0 == 0), "{law}: a step raised flags");
        assert!(error < STEPS, "{law}: relative error of displacements {error:e}");
    }
}

/// Final volume, divided by the rest volume, of a block with Poisson's ratio 0.49 that is pulled at its ends to twice
/// its length. No step may raise a flag.
fn drawn_volume(law: &str) -> f64 {
    let text = format!(
        "[step]\ngravity = [0, 0, 0]\n[solver]\nmax_iterations = 1000\n[[body]]\nname = \"block\"\n\
         layer = {{ box = [[0, 0, 0], [0.2, 0.1, 0.1]], cells = [8, 4, 4] }}\n\
         material = {{ law = \"{law}\", young = 2e6, poisson = 0.49, density = 1000 }}\n\
         [[body.core]]\nname = \"wall\"\nbind = {{ box = [[-0.001, 0, 0], [0.001, 0.1, 0.1]] }}\n\
         [[body.core]]\nname = \"end\"\nmotion = \"driven\"\n\
         keys = [[0, 0, 0, 0, 0, 0, 0, 1], [0.1, 0.2, 0, 0, 0, 0, 0, 1]]\n\
         bind = {{ box = [[0.199, 0, 0], [0.201, 0.1, 0.1]] }}\n"
    );
    let mut simulation = open(&scene(&text), None);
    let rows = run(&mut simulation, 150);
    assert!(rows.iter().all(|row| row.flags.0 == 0), "{law}: a step raised flags");
    let Shape::Soft { layer, .. } = &simulation.bodies()[0].shape else { panic!("the block is not soft") };
    let (moved, _) = simulation.nodes(0).unwrap().unwrap();
    let now: Vec<DVec3> = layer.nodes.iter().zip(&moved).map(|(r, d)| *r + *d).collect();
    assert!(now.iter().any(|x| (x.x - 0.4).abs() < 1e-5), "{law}: the block is not drawn to twice its length");
    let volume = |nodes: &[DVec3]| layer.tetrahedra.iter().map(|t| volume6(nodes, t)).sum::<f64>();
    volume(&now) / volume(&layer.nodes)
}

#[test]
fn a_block_drawn_to_twice_its_length_keeps_its_volume_only_by_the_nonlinear_law() {
    // Whole steps far from rest, with a Young's modulus of 2 MPa. The corotational law is linear in the stretches, so
    // that nothing stops the block from becoming thinner and thinner.
    let [linear, soft] = ["corotational", "neo-hookean"].map(drawn_volume);
    println!("final volume over rest volume: {linear:.3} corotational, {soft:.3} neo-Hookean");
    assert!((0.99..1.05).contains(&soft), "neo-Hookean: final volume over rest volume {soft}");
    assert!(linear < 0.6, "corotational: final volume over rest volume {linear}");
}
