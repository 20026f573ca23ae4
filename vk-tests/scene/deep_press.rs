//! Large deformations of 30 to 40 percent, as in the paper whose method the program implements: a rigid sphere is
//! pressed into soft bodies by four tenths of their radius. The force must rise all the way in, no tetrahedron may be
//! inverted, and after the release the body must return to its rest shape.

use glam::{DMat3, DVec3};
use palpate::internal::prepare::{Layer, Shape};
use palpate::{Options, Simulation, StepReport};

use crate::harness::real_meshes::meshes;
use crate::scene::whole_step::scene;

/// Bits that a folded skin (surface mesh of the body) sets in the flags of a step: 8 if a depth is beyond the limit, 16
/// if the skin is not a height field over a plane across the contact normal.
const FOLDED: u32 = 8 + 16;
/// Numbers of steps, each of 2 ms, in which the sphere is pressed in, stays, is pulled out and stays away.
const PHASES: [usize; 4] = [200, 25, 100, 500];

/// The least ratio of a tetrahedron's volume to its rest volume; negative if a tetrahedron is inverted.
fn least_volume(layer: &Layer, moved: &[DVec3]) -> f64 {
    let volume = |t: &[u32; 4], at: &dyn Fn(usize) -> DVec3| {
        let [a, b, c, d] = t.map(|n| at(n as usize));
        DMat3::from_cols(b - a, c - a, d - a).determinant()
    };
    let rest = |n: usize| layer.nodes[n];
    let now = |n: usize| layer.nodes[n] + moved[n];
    layer.tetrahedra.iter().map(|t| volume(t, &now) / volume(t, &rest)).fold(f64::INFINITY, f64::min)
}

fn largest(moved: &[DVec3]) -> f64 {
    moved.iter().map(|d| d.length()).fold(0.0, f64::max)
}

/// One test: the surface mesh `name` is filled with tetrahedra of size `cell` (m), whose nodes in the middle are
/// attached to a rigid core, a rigid body inside the soft one. A sphere of radius `sphere` (m) presses the body on the
/// way from `from` to `to`. `body_radius` (m) is the radius of the body there.
struct Deep {
    name: &'static str,
    cell: f64,
    /// Centre and radius of the core, m.
    core: [f64; 4],
    from: DVec3,
    to: DVec3,
    sphere: f64,
    body_radius: f64,
}

fn press(deep: &Deep) {
    let Deep { name, cell, core, from, to, sphere, body_radius } = *deep;
    let Some(meshes) = meshes() else { return };
    let key = |t: f64, x: DVec3| format!("[{t:?}, {:?}, {:?}, {:?}]", x.x, x.y, x.z);
    let [a, b, c, _] = PHASES.map(|n| n as f64 * 0.002);
    let keys = [key(0.0, from), key(a, to), key(a + b, to), key(a + b + c, from + (from - to))].join(", ");
    let text = format!(
        "[step]\ndt = 0.002\ngravity = [0.0, 0.0, 0.0]\n[[body]]\nname = \"{name}\"\nsurface = {:?}\n\
         layer = {{ cell = {cell:?} }}\n\
         material = {{ young = 2e4, poisson = 0.4, density = 1000.0, damping_mass = 20.0, damping_stiffness = 0.005 }}\n\
         [[body.core]]\nname = \"core\"\nbind = {{ sphere = {core:?} }}\n\
         [tool]\nsphere = {sphere:?}\nmass = 0.1\nposition = [{:?}, {:?}, {:?}]\n\
         [coupling]\nstiffness = 50000.0\ndamping = 50.0\nangular_stiffness = 10.0\nangular_damping = 0.1\n\
         [drive]\nkeys = [{keys}]\n",
        meshes.join(format!("surf/{name}.obj")),
        from.x,
        from.y,
        from.z
    );
    let options =
        Options { device: std::env::var("PALPATE_TEST_DEVICE").ok(), validation: false, ..Options::of_program() };
    let mut simulation = Simulation::open(&scene(&text), &options).unwrap();
    let Shape::Soft { layer, .. } = &simulation.bodies()[0].shape else { panic!("the body is not soft") };
    let layer = layer.clone();
    let mut rows: Vec<StepReport> = Vec::new();
    let mut least = f64::INFINITY;
    let mut deepest = 0.0f64;
    for step in 0..PHASES.iter().sum() {
        rows.push(simulation.step().unwrap());
        if step % 10 == 9 {
            let (moved, _) = simulation.nodes(0).unwrap().unwrap();
            least = least.min(least_volume(&layer, &moved));
            deepest = deepest.max(largest(&moved));
        }
    }
    let left = largest(&simulation.nodes(0).unwrap().unwrap().0) / deepest;
    let force: Vec<f64> = rows.iter().map(|row| row.tool.unwrap().force.length()).collect();
    let touch = force.iter().position(|f| *f > 0.0).unwrap();
    let travel = from.distance(rows[PHASES[0] - 1].tool.unwrap().tool.position);
    let at_touch = from.distance(rows[touch].tool.unwrap().tool.position);
    let pressing = &force[touch..PHASES[0]];
    let fall = pressing.windows(2).map(|w| w[0] - w[1]).fold(0.0, f64::max);
    println!(
        "{name}: {} tetrahedra; sphere pressed in by {:.4} m, force there {:.1} N; least ratio of a tetrahedron's \
         volume to its rest volume {least:.2}; greatest fall of the force in a step {fall:.1e} N; greatest \
         displacement {deepest:.3} m, displacement at the end relative to the greatest {left:.1e}",
        layer.tetrahedra.len(),
        travel - at_touch,
        force[PHASES[0] - 1]
    );
    // Where a sphere is pressed in deeper than its radius, some of the body's skin lies above the sphere's widest
    // circle. Measured along the contact normal, such skin is deeper than the limit or is no height field, and flags
    // report that.
    let folds = rows.iter().filter(|row| row.flags.0 != 0).count();
    let others: Vec<(u64, u32)> =
        rows.iter().filter(|row| row.flags.0 & !FOLDED != 0).map(|r| (r.step, r.flags.0)).collect();
    assert!(
        travel - at_touch >= 0.4 * body_radius,
        "{name}: the sphere was pressed in by only {} m",
        travel - at_touch
    );
    assert!(
        others.is_empty(),
        "{name}: steps with flags other than those of a folded skin, and their flags: {others:?}"
    );
    assert!(
        folds == 0 || travel - at_touch > sphere,
        "{name}: {folds} steps with flags of a folded skin, though the sphere is not pressed in deeper than its radius"
    );
    println!("{name}: {folds} steps with flags of a folded skin");
    assert!(least > 0.0, "{name}: a tetrahedron is inverted: least ratio of volumes {least}");
    // Skin that comes into contact above the sphere's widest circle, or leaves it there, changes the force by a few
    // thousandths of its value. Without such skin the force must not fall at all.
    let allowed = if folds > 0 { 0.005 * force[PHASES[0] - 1] } else { 0.0 };
    assert!(fall <= allowed, "{name}: the force falls by {fall} N on the way in");
    assert!(
        force[PHASES[..3].iter().sum::<usize>()..].iter().all(|f| *f == 0.0),
        "{name}: there is a force in the last phase, when the sphere is away"
    );
    assert!(left < 0.01, "{name}: ratio of the displacement at the end to the greatest: {left}");
}

#[test]
#[ignore = "needs real meshes"]
fn a_deep_press_into_a_pumpkin() {
    // The sphere comes from the side, between stem and ground.
    let from = DVec3::new(0.0, 0.14, 0.225);
    let to = from - DVec3::Z * 0.084;
    press(&Deep {
        name: "pumpkin",
        cell: 0.03,
        core: [0.0, 0.14, -0.02, 0.05],
        from,
        to,
        sphere: 0.06,
        body_radius: 0.16,
    });
}

#[test]
#[ignore = "needs real meshes"]
fn a_deep_press_into_a_head() {
    // The sphere comes down on the crown.
    let from = DVec3::new(0.0, 0.19, -0.01);
    let to = from - DVec3::Y * 0.056;
    press(&Deep { name: "head", cell: 0.02, core: [0.0, 0.0, -0.01, 0.05], from, to, sphere: 0.04, body_radius: 0.12 });
}
