//! Tests of the whole preparation of a scene's bodies and tool (rigid body that the haptic device leads), on generated
//! and on real meshes. A soft body has a *skin* (surface mesh) that is embedded in a *layer* (tetrahedral mesh; it may
//! be made by filling the skin with lattice *cells*), rigid *cores* to which nodes of the layer are attached, and
//! *proxies* (convex hulls that cover the skin). The *extrapolation* of a skin vertex is by how much the least of its
//! weights in its tetrahedron lies below 0.

#[path = "../../tests/real_meshes/mod.rs"]
pub mod real_meshes;

use std::time::Instant;

use glam::{DQuat, DVec3};

use super::{Body, Layer, Shape, body, embed, layer, mass, proxies, skin, stuffing, tool};
use crate::Result;
use crate::scene::{
    self, Bind, Contact, Core, Haptics, Material, MaterialLaw, Model, Motion, Operator, Preconditioner, Scene, Solver,
    Step, Surface, Tool, ToolShape, triangles,
};
use real_meshes::meshes;

/// Material of the soft bodies in these tests.
pub const MATERIAL: Material = Material {
    law: MaterialLaw::Corotational,
    young: 2e4,
    poisson: 0.45,
    density: 1000.0,
    damping_mass: 0.0,
    damping_stiffness: 0.0,
};

#[test]
#[ignore = "needs real meshes"]
fn real_surfaces_get_a_layer_an_embedding_and_proxies() {
    let Some(folder) = meshes() else { return };
    for name in ["head", "pumpkin", "gear", "human", "human_3000"] {
        let mesh = triangles::read(&folder.join(format!("surf/{name}.obj"))).unwrap().mesh;
        let low = mesh.vertices.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let high = mesh.vertices.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
        let cell = (high - low).max_element() / 25.0;
        let start = Instant::now();
        let layer = stuffing::stuff(&mesh.vertices, &mesh.triangles, &stuffing::Options::uniform(cell)).unwrap().0;
        let layer_time = start.elapsed();
        check_layer(&layer, mass::properties(&mesh.vertices, &mesh.triangles).volume);
        let embeddings = embed(&mesh.vertices, &layer).unwrap();
        let worst = embed::extrapolation(&embeddings);
        assert!(
            worst < EXTRAPOLATION,
            "{name}: greatest extrapolation of a skin vertex {worst} with cells of {cell} m"
        );
        let embed_time = start.elapsed() - layer_time;
        let skin = skin::build(mesh.vertices, mesh.triangles);
        assert_eq!(skin::defects(&skin.triangles), (0, 0));
        let start = Instant::now();
        let proxies = proxies(&skin).unwrap();
        let proxy_time = start.elapsed();
        super::proxy::tests::check(&skin, &proxies);
        assert!((2..=40).contains(&proxies.len()));
        let margin = proxies.iter().map(|p| p.margin).fold(0.0, f64::max);
        let most = proxies.iter().map(|p| p.triangles.len()).max().unwrap();
        println!(
            "{name}: {} tetrahedra in {layer_time:.0?}, embedding in {embed_time:.0?}, {} proxies in {proxy_time:.0?}; \
             the skin is up to {margin:.2e} m outside its hull; a proxy has up to {most} triangles",
            layer.tetrahedra.len(),
            proxies.len()
        );
        // A proxy's hull has at most 64 corners, so the skin sticks out of the hull by its *margin*, a few per cent of
        // the hull's size. If the farthest vertex were left out of a hull, the skin would stick out far more.
        assert!(margin < 0.02 * (high - low).length(), "{name}: greatest margin of a proxy {margin} m");
    }
}

/// Upper bound of the extrapolation. A skin vertex outside the layer lies within one cell of the layer, and no height
/// of a tetrahedron is much below half a cell.
const EXTRAPOLATION: f64 = 1.5;

/// Checks that all tetrahedra have positive volumes, the layer is in one part, and its volume agrees with `volume`
/// (m^3), the volume that the surface encloses.
fn check_layer(layer: &Layer, volume: f64) {
    let volumes = layer.tetrahedra.iter().map(|t| layer::volume6(&layer.nodes, t) / 6.0);
    assert!(volumes.clone().all(|v| v > 0.0));
    assert!((volumes.sum::<f64>() / volume - 1.0).abs() < 0.02);
    assert_eq!(layer::parts(layer).1, 1);
}

pub(crate) fn scene(shape: scene::Shape, cores: &[Bind]) -> Scene {
    let core = |(i, bind): (usize, &Bind)| Core {
        name: format!("core{i}"),
        motion: Motion::Fixed,
        bind: Some(bind.clone()),
        mass: None,
        hinge: None,
    };
    let body = scene::Body {
        name: "thing".into(),
        shape,
        hulls: None,
        units: None,
        scale: 2.0,
        position: DVec3::X,
        orientation: DQuat::IDENTITY,
        velocity: DVec3::ZERO,
        material: Some(MATERIAL),
        regions: Vec::new(),
        dilatation: Default::default(),
        collides: None,
        cores: cores.iter().enumerate().map(core).collect(),
        repair: true,
        joints: Vec::new(),
        supports: Vec::new(),
        loads: Vec::new(),
        reactions: None,
        skeleton: None,
    };
    Scene {
        file: "scene.toml".into(),
        step: Step { dt: 0.001, gravity: DVec3::ZERO, newton: 1 },
        solver: Solver {
            tolerance: Some(1e-5),
            max_iterations: 200,
            preconditioner: Preconditioner::Auto,
            operator: Operator::Auto,
        },
        contact: Contact {
            stiffness: None,
            damping: None,
            friction: 0.0,
            friction_speed: 0.001,
            texel: None,
            depth_limit: 0.02,
            depth: None,
            sides: crate::scene::Sides::Both,
            samples: crate::scene::Samples::Auto,
        },
        bodies: vec![body],
        tool: None,
        further_tools: vec![],
        coupling: None,
        trajectory: Vec::new(),
        haptics: Haptics::default(),
        probes: Vec::new(),
        preset: None,
    }
}

fn cube() -> scene::Shape {
    let layer = scene::Layer::Box { low: DVec3::ZERO, high: DVec3::ONE, cells: [2, 2, 2] };
    scene::Shape::Soft { surface: None, layer }
}

fn prepared(scene: &Scene) -> Result<Body> {
    body(&scene.bodies[0], scene)
}

#[test]
fn a_box_is_bound_in_file_coordinates_and_scaled() {
    let face = Bind::Box { low: DVec3::ZERO, high: DVec3::new(0.0, 1.0, 1.0) };
    let body = prepared(&scene(cube(), &[face])).unwrap();
    let Shape::Soft { layer, embedding, skin, proxies, .. } = body.shape else { panic!("the body is not soft") };
    assert_eq!(layer.nodes[26], DVec3::splat(2.0));
    assert_eq!(layer.attached.iter().filter(|&&b| b).count(), 9);
    assert!((0..27).all(|n| layer.attached[n] == (layer.nodes[n].x == 0.0)));
    assert_eq!((skin.vertices.len(), proxies.len()), (26, 1));
    assert!(embedding.iter().all(|e| e.weights.contains(&1.0)));
    assert_eq!(body.position, DVec3::X);
}

#[test]
fn cores_that_hold_nothing_and_bad_nodes_are_refused_by_name() {
    let nowhere = Bind::Sphere { centre: DVec3::splat(9.0), radius: 0.1 };
    let error = prepared(&scene(cube(), &[Bind::All, nowhere])).unwrap_err().to_string();
    assert!(
        error.contains("`body.thing.core.core1.bind`") && error.contains("no node is attached to the core"),
        "the error is: {error}"
    );
    let error = prepared(&scene(cube(), &[Bind::Nodes(vec![27])])).unwrap_err().to_string();
    assert!(error.contains("node 27 does not exist: the layer has 27 nodes"), "the error is: {error}");
    assert!(prepared(&scene(cube(), &[])).is_ok());
}

#[test]
fn cells_out_of_range_are_refused_by_name() {
    let layer = scene::Layer::Box { low: DVec3::ZERO, high: DVec3::ONE, cells: [200, 200, 200] };
    let error = prepared(&scene(scene::Shape::Soft { surface: None, layer }, &[])).unwrap_err().to_string();
    assert!(error.contains("`body.thing.layer.cells`") && error.contains("48000000"), "the error is: {error}");
    let layer = scene::Layer::Cell { cell: 3.0, grade: 1, thickness: None };
    let surface = Some(Surface::Model { model: Model::Head, vertices: 3000 });
    let error = prepared(&scene(scene::Shape::Soft { surface, layer }, &[])).unwrap_err().to_string();
    assert!(
        error.contains("`body.thing.layer.cell`") && error.contains("smaller than one cell"),
        "the error is: {error}"
    );
}

#[test]
fn parts_with_nothing_to_hold_them_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("two.msh");
    let nodes = "1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n5 9 0 0\n6 10 0 0\n7 9 1 0\n8 9 0 1\n";
    let elements = "1 4 2 0 0 1 2 3 4\n2 4 2 0 0 5 6 7 8\n";
    let text = format!(
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n8\n{nodes}$EndNodes\n$Elements\n2\n{elements}$EndElements\n"
    );
    std::fs::write(&path, text).unwrap();
    let shape = scene::Shape::Soft { surface: None, layer: scene::Layer::File(path) };
    let error = prepared(&scene(shape.clone(), &[Bind::Nodes(vec![1])])).unwrap_err().to_string();
    assert!(error.contains("4 nodes, among them") && error.contains("node 4"), "the error is: {error}");
    assert!(prepared(&scene(shape, &[Bind::Nodes(vec![1, 7])])).is_ok());
}

#[test]
fn nodes_of_no_tetrahedron_are_left_out_and_cores_count_as_the_file_does() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("spare.node");
    std::fs::write(&path, "6 3 0 0\n0 9 9 9\n1 0 0 0\n2 1 0 0\n3 5 5 5\n4 0 1 0\n5 0 0 1\n").unwrap();
    std::fs::write(folder.path().join("spare.ele"), "1 4 0\n0 1 2 4 5\n").unwrap();
    let shape = scene::Shape::Soft { surface: None, layer: scene::Layer::File(path) };
    let body = prepared(&scene(shape.clone(), &[Bind::Nodes(vec![2, 5])])).unwrap();
    let Shape::Soft { layer, .. } = &body.shape else { panic!("the body is not soft") };
    assert_eq!(layer.nodes, [DVec3::ZERO, 2.0 * DVec3::X, 2.0 * DVec3::Y, 2.0 * DVec3::Z]);
    assert_eq!((&layer.tetrahedra[..], &layer.attached[..]), (&[[0, 1, 2, 3]][..], &[false, true, false, true][..]));
    assert!(
        body.report.notes[0].contains("spare.node: 2 nodes that belong to no tetrahedron were left out"),
        "the note on unused nodes is missing: {:?}",
        body.report
    );
    for (node, words) in [(3, "node 3 belongs to no tetrahedron"), (6, "node 6 does not exist")] {
        let error = prepared(&scene(shape.clone(), &[Bind::Nodes(vec![node])])).unwrap_err().to_string();
        assert!(error.contains(words), "the error is: {error}");
    }
}

#[test]
fn the_sphere_tool_is_a_ball_and_a_tool_body_is_not_made_here() {
    let scene = scene(cube(), &[]);
    let mut ball = Tool::sphere(0.01, 0.05).at([0.0, 1.0, 0.0]);
    let Shape::Rigid { skin, proxies, centroid, .. } = tool(&ball, &scene).unwrap().shape else {
        panic!("the tool is not rigid")
    };
    assert!(skin.vertices.len() >= 2500 && proxies.len() == 1 && centroid.length() < 1e-15);
    ball.shape = ToolShape::Body("thing".into());
    assert!(tool(&ball, &scene).unwrap_err().to_string().contains("`tool.body`"));
}

#[test]
#[ignore = "needs real meshes"]
fn the_real_head_is_prepared_with_a_core() {
    let Some(folder) = meshes() else { return };
    let surface = Some(Surface::File(folder.join("surf/head.obj")));
    let shape = scene::Shape::Soft { surface, layer: scene::Layer::Cell { cell: 0.012, grade: 1, thickness: None } };
    let start = std::time::Instant::now();
    let body = prepared(&scene(shape, &[Bind::Inset(0.03)])).unwrap();
    println!("the head was prepared in {:.1?}", start.elapsed());
    let Shape::Soft { layer, embedding, skin, .. } = body.shape else { panic!("the body is not soft") };
    let bound = layer.attached.iter().filter(|&&b| b).count();
    assert!(
        bound > layer.nodes.len() / 10 && bound < layer.nodes.len() / 2,
        "{bound} nodes are attached to the core, expected a tenth to a half of all {} nodes",
        layer.nodes.len()
    );
    assert_eq!(embedding.len(), skin.vertices.len());
    assert!(embed::extrapolation(&embedding) < EXTRAPOLATION);
}

#[test]
#[ignore = "needs real meshes"]
fn the_real_human_sticks_out_of_its_file_layer_a_little() {
    let Some(folder) = meshes() else { return };
    let surface = Some(Surface::File(folder.join("surf/human.obj")));
    let shape = scene::Shape::Soft { surface, layer: scene::Layer::File(folder.join("tet/human.v22.msh")) };
    let body = prepared(&scene(shape, &[Bind::Inset(0.03)])).unwrap();
    let Shape::Soft { layer, embedding, skin, proxies, .. } = body.shape else { panic!("the body is not soft") };
    assert_eq!((layer.nodes.len(), layer.tetrahedra.len(), skin.vertices.len()), (3128, 10204, 13380));
    // The file's tetrahedra were made by fTetWild, which follows the surface within a tolerance, so some skin vertices
    // lie outside. An extrapolation above 1 would mean that a vertex was embedded in a sliver.
    let worst = embed::extrapolation(&embedding);
    assert!(worst > 0.0 && worst < 1.0, "greatest extrapolation of a skin vertex {worst}, expected between 0 and 1");
    for (e, &v) in embedding.iter().zip(&skin.vertices) {
        let nodes = layer.tetrahedra[e.tetrahedron as usize].map(|i| layer.nodes[i as usize]);
        let back: DVec3 = nodes.iter().zip(e.weights).map(|(&n, w)| n * w).sum();
        assert!(back.distance(v) < 1e-10);
    }
    super::proxy::tests::check(&skin, &proxies);
}
