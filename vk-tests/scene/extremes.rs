//! Scenes at the limits of computation: no setting of a scene may lose contacts silently, and a step whose numbers
//! overflow single precision must raise flags and leave the state as it was.

use glam::DVec3;
use palpate::{Flags, Simulation, StepReport};

use crate::scene::whole_step::{open, run, scene};

/// `BLOCK` is text of the tetrahedral mesh and the material of a cube with edges of 0.1 m and its top at y = 0. `HELD`
/// is text of a fixed rigid core (rigid body inside the cube), to which the nodes of the cube's bottom are attached.
const BLOCK: &str = "layer = { box = [[-0.05, -0.1, -0.05], [0.05, 0.0, 0.05]], cells = [4, 4, 4] }\n\
                     material = { young = 2e4, poisson = 0.45, density = 1000.0, damping_stiffness = 0.002 }\n";
const HELD: &str = "[[body.core]]\nname = \"k\"\nbind = { box = [[-1, -0.11, -1], [1, -0.09, 1]] }\n";
/// Text of the tool, a rigid sphere that starts 1 mm deep in the block's top.
const SPHERE: &str = "sphere = 0.01\nmass = 0.05\nposition = [0.0, 0.009, 0.0]\n";

/// Opens a simulation of the block and a tool. `tool` is text of the scene's table `[tool]`, `more` is text of further
/// tables.
fn press(tool: &str, more: &str) -> Simulation {
    open(&scene(&format!("[[body]]\nname = \"b\"\n{BLOCK}{HELD}[tool]\n{tool}{more}")), None)
}

fn force(rows: &[StepReport]) -> f64 {
    rows[rows.len() - 1].tool.unwrap().force.length()
}

#[test]
#[ignore = "long: 6 s"]
fn no_texel_and_no_depth_limit_is_too_coarse_for_contact() {
    let plain = force(&run(&mut press(SPHERE, ""), 2));
    assert!(plain > 0.1, "force {plain} N, expected more than 0.1 N");
    for line in ["texel = 0.001", "texel = 16.0", "texel = 1e30", "depth_limit = 1.0", "depth_limit = 1e10"] {
        let got = force(&run(&mut press(SPHERE, &format!("[contact]\n{line}\n")), 2));
        // Depth is computed from exact ray hits, so that these settings must not change the force.
        assert!((got - plain).abs() < 1e-4 * plain, "{line}: force {got} N, by default {plain} N");
    }
}

#[test]
fn a_scene_of_planes_alone_has_steps_in_which_nothing_happens() {
    let plane = "[[body]]\nname = \"floor\"\nplane = [0.0, 1.0, 0.0, 0.0]\n";
    for text in [plane.to_string(), format!("{plane}[tool]\n{SPHERE}")] {
        let rows = run(&mut open(&scene(&text), None), 3);
        assert!(rows.iter().all(|row| row.flags == Flags(0) && row.time > 0.0), "{text}: {rows:?}");
    }
}

#[test]
fn bodies_in_the_same_place_are_seen_to_overlap() {
    let both = format!("[[body]]\nname = \"b\"\n{BLOCK}[[body]]\nname = \"c\"\n{BLOCK}");
    let rows = run(&mut open(&scene(&both), None), 1);
    assert!(rows[0].flags.contains(Flags::DEPTH_BEYOND_LIMIT), "no flag for a depth beyond the limit: {:?}", rows[0]);
}

#[test]
fn what_overflows_is_flagged_and_moves_nothing() {
    let mut simulation = press(SPHERE, "[step]\ngravity = [0.0, -1e30, 0.0]\n");
    for row in run(&mut simulation, 3) {
        // The step is tried again in halves, quarters and eighths. These parts overflow as well, so that the state is
        // frozen.
        let said = Flags::NON_FINITE | Flags::STEP_RETRIED | Flags::FROZEN;
        assert!(row.flags.contains(said), "flags are missing: {row:?}");
        let tool = row.tool.unwrap();
        assert_eq!((tool.force.length(), tool.torque.length(), row.residual), (0.0, 0.0, 1.0));
    }
    assert_eq!(simulation.tool().unwrap().centre.y, 0.009);
    // No step was solved, so that contacts are reported with their pressure at the start of the step.
    let contacts = simulation.contacts().unwrap();
    assert!(!contacts.is_empty());
    for contact in &contacts {
        assert!(
            contact.pressure > 0.0 && contact.pressure < 1e7 && contact.friction == DVec3::ZERO,
            "pressure or friction is wrong: {contact:?}"
        );
    }
}

#[test]
fn as_many_iterations_as_a_scene_allows_are_done() {
    // The bar is long and stiff: with the Jacobi preconditioner it takes many iterations, in many submissions to the
    // GPU, until forces reach its end.
    let bar = "[step]\ndt = 0.01\n[solver]\npreconditioner = \"jacobi\"\nmax_iterations = 1500\ntolerance = 1e-6\n\
               [[body]]\nname = \"bar\"\nlayer = { box = [[0.0, 0.0, 0.0], [1.0, 0.1, 0.1]], cells = [40, 3, 3] }\n\
               material = { young = 1e9, poisson = 0.4, density = 1000.0 }\n\
               [[body.core]]\nname = \"k\"\nbind = { box = [[-1, -1, -1], [1e-6, 1, 1]] }\n";
    let row = run(&mut open(&scene(bar), None), 1)[0].clone();
    assert!(row.iterations > 1024, "expected more than 1024 solver iterations: {row:?}");
}
