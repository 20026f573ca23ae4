//! Tests of bodies with defective meshes: tetrahedral meshes with slivers (nearly flat tetrahedra) under gravity, and
//! skins (surface meshes) with holes, pressed by the tool, a rigid sphere.

use glam::DVec3;
use palpate::Flags;
use palpate::scene::tetrahedra;

use crate::harness::real_meshes::meshes;
use crate::scene::whole_step::{open, run, scene};

/// Number of steps, of 1 ms each.
const STEPS: usize = 50;
/// Upper bound of displacements, relative to the distance g t^2 / 2 of free fall in time t under gravity g. Elasticity
/// holds a body back, but implicit Euler lets it fall too far: g h^2 n (n + 1) / 2 in n steps of length h, which is 2 %
/// more here.
const FREE_FALL: f64 = 1.05;

#[test]
#[ignore = "needs real meshes"]
fn layers_with_slivers_stay_finite_and_fall_no_faster_than_they_must() {
    let Some(meshes) = meshes() else { return };
    for name in ["human_tetgen_sliver", "bad_slivers"] {
        let file = meshes.join(format!("tet/{name}.v41.msh"));
        let mesh = tetrahedra::read(&file).unwrap();
        let low = mesh.nodes.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let high = mesh.nodes.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
        // The nodes in the lower tenth of the body's height are attached to a fixed core (rigid body inside the soft
        // one).
        let held = low.y + 0.1 * (high.y - low.y);
        let below = low - DVec3::ONE;
        for young in [2e4, 2e6] {
            let text = format!(
                "[solver]\nmax_iterations = 2000\n[[body]]\nname = \"dirty\"\nlayer = {file:?}\n\
                 material = {{ young = {young:e}, poisson = 0.45, density = 1000.0 }}\n\
                 [[body.core]]\nname = \"foot\"\nmotion = \"fixed\"\n\
                 bind = {{ box = [[{}, {}, {}], [{}, {held}, {}]] }}\n",
                below.x,
                below.y,
                below.z,
                high.x + 1.0,
                high.z + 1.0
            );
            let mut simulation = open(&scene(&text), None);
            let rows = run(&mut simulation, STEPS);
            let (moved, _) = simulation.nodes(0).unwrap().unwrap();
            let most = moved.iter().map(|d| d.length()).fold(0.0, f64::max);
            let time = STEPS as f64 * 1e-3;
            let bound = FREE_FALL * 9.81 * time * time / 2.0;
            let iterations = rows.iter().map(|row| row.iterations).max().unwrap();
            let flags = rows.iter().fold(0, |all, row| all | row.flags.0);
            println!(
                "{name} at {young:e} Pa: greatest displacement {most:.2e} m, bound {bound:.2e} m; flags {flags}; up \
                 to {iterations} solver iterations"
            );
            assert!(
                moved.iter().all(|d| d.is_finite()) && most > 0.0 && most < bound,
                "{name} at {young:e} Pa: greatest displacement {most} m"
            );
            assert!(!Flags(flags).contains(Flags::NON_FINITE), "{name} at {young:e} Pa: the solution is not finite");
        }
    }
}

#[test]
#[ignore = "needs real meshes"]
fn a_sphere_pressed_into_a_skin_with_holes_is_pushed_back() {
    let Some(meshes) = meshes() else { return };
    for name in ["open_holes", "triangle_soup"] {
        let file = meshes.join(format!("bad/{name}.obj"));
        // The tool starts in front of the belly and moves towards it.
        let text = format!(
            "[[body]]\nname = \"human\"\nsurface = {file:?}\nlayer = {{ cell = 0.08 }}\n\
             material = {{ young = 2e4, poisson = 0.45, density = 1000.0 }}\n\
             [[body.core]]\nname = \"core\"\nmotion = \"fixed\"\nbind = {{ inset = 0.05 }}\n\
             [tool]\nsphere = 0.04\nmass = 0.1\nposition = [0.0, 0.1, 0.3]\n\
             [coupling]\nstiffness = 2000.0\ndamping = 10.0\n\
             [drive]\nkeys = [[0.0, 0.0, 0.1, 0.3], [0.06, 0.0, 0.1, 0.17]]\n"
        );
        let mut simulation = open(&scene(&text), None);
        let rows = run(&mut simulation, 80);
        let force: Vec<DVec3> = rows.iter().map(|row| row.tool.unwrap().force).collect();
        let flags = rows.iter().fold(0, |all, row| all | row.flags.0);
        let contacts = rows.iter().map(|row| row.contacts.unwrap()).max().unwrap();
        println!("{name}: force {:.3} N at the end, up to {contacts} contacts, flags {flags}", force[79].length());
        assert!(
            force.iter().all(|f| f.is_finite()) && contacts > 0,
            "{name}: a force is not finite, or nothing was touched"
        );
        assert!(
            force[79].z > 0.5 * force[79].length() && force[79].length() > 0.1,
            "{name}: force at the end {} N, expected mainly along z",
            force[79]
        );
        assert!(!Flags(flags).contains(Flags::NON_FINITE), "{name}: the solution is not finite");
    }
}
