//! Shapes and places that easily mislead the proximity query, which finds where and how deep two bodies overlap.
//! Whatever the scene, forces must be finite, the flags of a step must report what is wrong (8: a contact deeper than
//! the scene's depth limit; 16: a skin, which is the surface mesh of a body, is not a height field along the contact
//! normal), and Vulkan's validation layer must not complain.

use std::fmt::Write;
use std::path::PathBuf;

use glam::DVec3;
use palpate::internal::prepare::layer;
use palpate::internal::stages::depth::Path;
use palpate::{Simulation, StepReport};
use tempfile::TempDir;

use crate::scene::whole_step::{open, run, scene};

/// Number of steps, of 1 ms each.
const STEPS: usize = 20;
/// Flags as in `trace.csv`: a contact deeper than the limit (8), and a skin that is not a height field (16).
const DEEP: u32 = 8;
const NOT_HEIGHT_FIELD: u32 = 16;
/// Flags that a step may have, besides `DEEP`, where one body lies deep in another: a skin is not a height field (16),
/// contacts still pull after the second solve (256), tetrahedra are inverted (1024).
const UNSEEN: u32 = NOT_HEIGHT_FIELD | 256 | 1024;

/// A soft block with edges of 0.1 m and its top at y = 0; its bottom nodes are attached to a fixed core (rigid body
/// inside a soft one).
const BLOCK: &str = "layer = { box = [[-0.05, -0.1, -0.05], [0.05, 0.0, 0.05]], cells = [6, 6, 6] }\n\
                     material = { young = 2e4, poisson = 0.45, density = 1000.0, damping_stiffness = 0.002 }\n\
                     [[body.core]]\nname = \"bottom\"\nbind = { box = [[-1, -0.11, -1], [1, -0.09, 1]] }\n";
/// Scene text: `STILL` switches gravity off. `HELD` is a virtual coupling (spring and damper between haptic device and
/// tool), which pulls the tool to the place where it starts.
const STILL: &str = "[step]\ngravity = [0.0, 0.0, 0.0]\n";
const HELD: &str = "[coupling]\nstiffness = 2000.0\ndamping = 10.0\nangular_stiffness = 1.0\nangular_damping = 0.01\n";

/// A triangle mesh that is being built.
#[derive(Default)]
struct Mesh {
    vertices: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
}

impl Mesh {
    fn block(low: DVec3, high: DVec3, cells: [u32; 3]) -> Mesh {
        let (vertices, triangles, _) = layer::boundary(&layer::kuhn_box(low, high, cells));
        Mesh { vertices, triangles }
    }

    /// A cone with its tip at the origin, pointing downwards.
    fn needle(radius: f64, length: f64, sides: u32) -> Mesh {
        let mut mesh = Mesh { vertices: vec![DVec3::ZERO, DVec3::Y * length], triangles: vec![] };
        for k in 0..sides {
            let angle = std::f64::consts::TAU * f64::from(k) / f64::from(sides);
            mesh.vertices.push(DVec3::new(radius * angle.cos(), length, radius * angle.sin()));
            let (a, b) = (2 + k, 2 + (k + 1) % sides);
            mesh.triangles.extend([[0, a, b], [1, b, a]]);
        }
        mesh
    }

    /// Writes the mesh to an OBJ file in a folder.
    fn write(&self, folder: &TempDir, name: &str) -> PathBuf {
        let file = folder.path().join(name);
        let v = self.vertices.iter().map(|x| format!("v {:?} {:?} {:?}\n", x.x, x.y, x.z));
        let f = self.triangles.iter().map(|t| format!("f {} {} {}\n", t[0] + 1, t[1] + 1, t[2] + 1));
        std::fs::write(&file, v.chain(f).collect::<String>()).unwrap();
        file
    }
}

/// The block and a tool. `tool` is further text of the scene's table `[tool]`, `more` is text of further tables.
fn block_and(tool: &str, more: &str) -> Simulation {
    open(&scene(&format!("{STILL}{more}[[body]]\nname = \"block\"\n{BLOCK}[tool]\nmass = 0.05\n{tool}\n{HELD}")), None)
}

/// The block and a tool that has this mesh as its surface.
fn block_and_mesh(mesh: &Mesh, position: [f64; 3]) -> Simulation {
    let folder = tempfile::tempdir().unwrap();
    let file = mesh.write(&folder, "tool.obj");
    block_and(&format!("surface = {file:?}\nposition = {position:?}"), "")
}

/// Runs the scene and checks that all results are finite, that the first step's flags are `first`, and that no step has
/// flags other than `first` and `later`.
fn judge(name: &str, mut simulation: Simulation, first: u32, later: u32) -> Vec<StepReport> {
    let rows = run(&mut simulation, STEPS);
    let seen: Vec<u32> = rows.iter().map(|row| row.flags.0).collect();
    let force: Vec<f64> = rows.iter().map(|row| row.tool.map_or(0.0, |tool| tool.force.length())).collect();
    let contacts: Vec<u32> = rows.iter().map(|row| row.contacts.unwrap()).collect();
    let deepest = rows.iter().map(|row| row.max_depth.unwrap()).fold(0.0, f64::max);
    println!(
        "{name}: flags {} in the first step, {} in all steps; {} contacts and {:.3} N in the first step, {} contacts \
         and {:.3} N in the last; depth at most {:.2} mm",
        seen[0],
        seen.iter().fold(0, |all, f| all | f),
        contacts[0],
        force[0],
        contacts[STEPS - 1],
        force[STEPS - 1],
        1e3 * deepest
    );
    for row in &rows {
        assert!(
            row.residual.is_finite() && row.max_depth.unwrap().is_finite(),
            "{name}: residual or depth is not finite: {row:?}"
        );
        if let Some(tool) = row.tool {
            assert!(
                tool.force.is_finite() && tool.torque.is_finite() && tool.tool.position.is_finite(),
                "{name}: force, torque or position of the tool is not finite: {row:?}"
            );
        }
        assert!(
            row.flags.0 & !(first | later) == 0,
            "{name}: some of the flags {} are not allowed in step {}",
            row.flags.0,
            row.step
        );
    }
    assert_eq!(seen[0], first, "{name}: flags of the first step");
    for body in 0..simulation.bodies().len() {
        if let Some((moved, velocity)) = simulation.nodes(body).unwrap() {
            assert!(
                moved.iter().chain(&velocity).all(|x| x.is_finite()),
                "{name}: displacement or velocity of a node is not finite"
            );
        }
    }
    rows
}

#[test]
fn a_tool_wholly_inside_the_body_is_deeper_than_the_limit() {
    let rows = judge("inside", block_and("sphere = 0.01\nposition = [0.003, -0.05, 0.002]", ""), DEEP, UNSEEN);
    assert!(rows[0].contacts.unwrap() > 0);
}

#[test]
fn a_tool_larger_than_the_body_presses_it() {
    let rows = judge("larger", block_and("sphere = 0.5\nposition = [0.0, 0.499, 0.0]", ""), 0, 0);
    assert!(rows[0].tool.unwrap().force.y > 0.0);
}

#[test]
fn a_body_wholly_inside_the_tool_is_deeper_than_the_limit() {
    judge("swallowed", block_and("sphere = 0.5\nposition = [0.01, 0.02, 0.03]", ""), DEEP, UNSEEN);
}

#[test]
fn a_needle_is_felt_or_flagged() {
    let needle = Mesh::needle(0.0005, 0.05, 12);
    let rows = judge("needle", block_and_mesh(&needle, [0.001, 0.75 * 0.05 - 0.003, 0.002]), 0, NOT_HEIGHT_FIELD);
    assert!(rows.len() == STEPS);
}

#[test]
fn a_thin_plate_is_pressed_on_its_flat() {
    let half = DVec3::new(0.02, 0.0001, 0.02);
    let plate = Mesh::block(-half, half, [10, 1, 10]);
    let rows = judge("plate", block_and_mesh(&plate, [0.0, -0.0004, 0.0]), 0, 0);
    assert!(rows[0].tool.unwrap().force.y > 0.1, "the tool's force along y is at most 0.1 N: {:?}", rows[0]);
}

#[test]
fn a_thin_plate_is_pressed_on_its_edge() {
    let half = DVec3::new(0.0001, 0.02, 0.02);
    let plate = Mesh::block(-half, half, [1, 10, 10]);
    let rows = judge("plate on edge", block_and_mesh(&plate, [0.0, 0.018, 0.0]), 0, 0);
    assert!(rows[0].tool.unwrap().force.y > 0.1, "the tool's force along y is at most 0.1 N: {:?}", rows[0]);
}

#[test]
fn bodies_in_the_same_place_overlap_beyond_the_limit() {
    for shift in [0.0, 0.001] {
        let text = format!(
            "{STILL}[[body]]\nname = \"a\"\n{BLOCK}[[body]]\nname = \"b\"\nposition = [0.0, {shift:?}, 0.0]\n{BLOCK}"
        );
        judge(&format!("two blocks at a distance of {shift} m"), open(&scene(&text), None), DEEP, UNSEEN);
    }
}

#[test]
fn what_only_touches_is_not_pushed() {
    let rows = judge("touching sphere", block_and("sphere = 0.015625\nposition = [0.0, 0.015625, 0.0]", ""), 0, 0);
    assert!(rows.iter().all(|row| row.tool.unwrap().force.length() < 1e-6 && row.max_depth.unwrap() < 1e-8));
    let text =
        format!("{STILL}[[body]]\nname = \"a\"\n{BLOCK}[[body]]\nname = \"b\"\nposition = [0.0, 0.1, 0.0]\n{BLOCK}");
    let rows = judge("touching blocks", open(&scene(&text), None), 0, 0);
    assert!(rows.iter().all(|row| row.max_depth.unwrap() < 1e-7));
}

/// Numbers of rigid cubes along the x and the z side of a soft slab, and the distance between neighbouring cubes, m.
const CUBES: (usize, usize, f64) = (20, 10, 0.02);

#[test]
fn two_hundred_pairs_of_bodies_touch_at_once() {
    many_pairs([20, 4, 10]);
}

#[test]
fn two_hundred_pairs_of_bodies_touch_a_fine_skin_at_once() {
    many_pairs([40, 4, 20]);
}

/// Presses rigid cubes into a soft slab with `cells` cells along its three edges, each cut into six tetrahedra. The
/// slab must have contacts with every cube.
fn many_pairs(cells: [u32; 3]) {
    let folder = tempfile::tempdir().unwrap();
    let half = DVec3::splat(0.006);
    let file = Mesh::block(-half, half, [3, 3, 3]).write(&folder, "cube.obj");
    let (columns, rows, pitch) = CUBES;
    let mut text = format!(
        "{STILL}[[body]]\nname = \"slab\"\n\
         layer = {{ box = [[-0.01, -0.04, -0.01], [{:?}, 0.0, {:?}]], cells = {cells:?} }}\n\
         material = {{ young = 2e4, poisson = 0.45, density = 1000.0, damping_stiffness = 0.002 }}\n\
         [[body.core]]\nname = \"bottom\"\nbind = {{ box = [[-1, -0.11, -1], [1, -0.039, 1]] }}\n",
        columns as f64 * pitch - 0.01,
        rows as f64 * pitch - 0.01
    );
    for k in 0..columns * rows {
        let (x, z) = (pitch * (k % columns) as f64, pitch * (k / columns) as f64);
        let _ = write!(
            text,
            "[[body]]\nname = \"cube{k}\"\nsurface = {file:?}\nposition = [{x:?}, 0.0055, {z:?}]\ncollides = [\"slab\"]\n"
        );
    }
    let mut simulation = open(&scene(&text), Some(Path::Compute));
    // The contacts of the first step are judged, in which cubes and slab still overlap as the scene places them: in
    // later steps the slab has moved away from the cubes.
    let mut rows = run(&mut simulation, 1);
    let (contact_patches, contacts) = simulation.touch().unwrap();
    let mut pushed = vec![false; columns * CUBES.1];
    contacts.iter().for_each(|contact| pushed[contact.side as usize / 2] = true);
    rows.extend(run(&mut simulation, STEPS - 1));
    let flags = rows.iter().fold(0, |all, row| all | row.flags.0);
    println!(
        "200 pairs of bodies: {} contact patches, {} contacts, {} pairs with contacts; flags {flags}; up to {} solver \
         iterations",
        contact_patches.iter().filter(|contact_patch| contact_patch.weight > 0.0).count(),
        contacts.len(),
        pushed.iter().filter(|p| **p).count(),
        rows.iter().map(|row| row.iterations).max().unwrap()
    );
    let (moved, _) = simulation.nodes(0).unwrap().unwrap();
    assert!(moved.iter().all(|d| d.is_finite()) && moved.iter().any(|d| d.y < -1e-4));
    assert!(flags == 0 && pushed.iter().all(|p| *p), "flags {flags}, expected 0; every pair must have contacts");
}

#[test]
fn triangles_without_area_in_single_precision_do_no_harm() {
    // Every fifth triangle of the block's skin gets a vertex in the middle of its first edge, moved inwards by so
    // little that the sliver triangle between the vertex and that edge has no area in f32. The mesh stays closed.
    let low = DVec3::new(-0.05, -0.1, -0.05);
    let mut mesh = Mesh::block(low, low + DVec3::splat(0.1), [8, 8, 8]);
    for t in (0..mesh.triangles.len()).step_by(5) {
        let [a, b, c] = mesh.triangles[t];
        let [x, y, z] = [a, b, c].map(|v| mesh.vertices[v as usize]);
        let inwards = 3e-7 * (z - 0.5 * (x + y));
        let m = mesh.vertices.len() as u32;
        mesh.vertices.push(0.5 * (x + y) + inwards);
        mesh.triangles[t] = [a, m, c];
        mesh.triangles.extend([[m, b, c], [a, b, m]]);
    }
    let folder = tempfile::tempdir().unwrap();
    let file = mesh.write(&folder, "block.obj");
    let press = |surface: &str| {
        let text = format!(
            "{STILL}[[body]]\nname = \"block\"\n{surface}{BLOCK}[tool]\nsphere = 0.02\nmass = 0.05\n\
             position = [0.001, 0.019, 0.002]\n{HELD}"
        );
        open(&scene(&text), None)
    };
    let slivers = press(&format!("surface = {file:?}\nrepair = false\n"));
    let rows = judge("slivers", slivers, 0, 0);
    let plain = judge("no slivers", press(""), 0, 0);
    let (got, want) = (rows[STEPS - 1].tool.unwrap().force.y, plain[STEPS - 1].tool.unwrap().force.y);
    assert!((got / want - 1.0).abs() < 0.05, "force {got} N with sliver triangles, expected {want} N, as without them");
}
