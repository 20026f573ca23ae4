//! Tests of the meshes that are drawn over the skins (surface meshes): collision proxies (convex hulls), cut layers
//! (tetrahedral meshes of soft bodies), rigid cores (rigid bodies inside soft ones) and bones (capsules by which cores
//! are given). Their vertices must be where the host computes them in f64, and the meshes must be closed and face
//! outward. The squares that show contact patches are tested too.

use std::collections::BTreeMap;

use glam::{DQuat, DVec3};
use palpate::Simulation;
use palpate::internal::prepare::Shape;
use palpate::internal::prepare::mass::properties;
use palpate::internal::step::{Cut, Field, Mesh, Overlay, Part};
use palpate::scene::{Bind, Capsule};

use crate::scene::joints;
use crate::scene::touch::{Place, press};
use crate::scene::whole_step::{open, run, scene};

/// Error of positions relative to the distance from the chosen origin: f32 sums of a few terms.
const POSITION: f64 = 4e-7;
/// Relative error of volumes: positions are f32.
const VOLUME: f64 = 1e-5;

/// World positions of a mesh's vertices, and its triangles.
fn read(mesh: &Mesh, origin: DVec3) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let all = mesh.positions.read::<[f32; 4]>().unwrap();
    let places = all[..mesh.vertex_count].iter().map(|x| {
        assert_eq!(x[3], 1.0);
        origin + DVec3::new(x[0].into(), x[1].into(), x[2].into())
    });
    let words = mesh.triangles.read::<u32>().unwrap();
    assert!(words.len().is_multiple_of(4) && words[3 * mesh.triangle_count..].iter().all(|w| *w == 0));
    let triangles = words[..3 * mesh.triangle_count].chunks(3).map(|t| [t[0], t[1], t[2]]);
    (places.collect(), triangles.collect())
}

/// Checks that the parts of a mesh follow one another, cover the whole mesh, and use their own vertices only.
fn check_parts(mesh: &Mesh, triangles: &[[u32; 3]]) {
    let (mut vertex, mut triangle) = (0, 0);
    for part in mesh.parts.iter() {
        assert_eq!(
            (part.vertices.start, part.triangles.start),
            (vertex, triangle),
            "first vertex and triangle of {part:?}"
        );
        (vertex, triangle) = (part.vertices.end, part.triangles.end);
        let own = triangles[part.triangles.clone()].as_flattened();
        assert!(
            own.iter().all(|v| part.vertices.contains(&(*v as usize))),
            "a triangle uses vertices outside {part:?}"
        );
    }
    assert_eq!((vertex, triangle), (mesh.vertex_count, mesh.triangle_count));
}

/// Checks that every edge is passed as often in one direction as in the other. Corners are identified by their
/// positions.
fn expect_closed(what: &str, places: &[DVec3], triangles: &[[u32; 3]]) {
    let key = |v: u32| places[v as usize].to_array().map(f64::to_bits);
    let mut edges: BTreeMap<_, i32> = BTreeMap::new();
    for t in triangles {
        for k in 0..3 {
            let (a, b) = (key(t[k]), key(t[(k + 1) % 3]));
            *edges.entry((a.min(b), a.max(b))).or_default() += if a < b { 1 } else { -1 };
        }
    }
    assert!(!edges.is_empty() && edges.values().all(|n| *n == 0), "the surface of {what} is not closed");
}

fn near(what: &str, got: DVec3, want: DVec3, origin: DVec3) {
    let (error, reach) = (got.distance(want), (want - origin).length().max(0.1));
    assert!(error < POSITION * reach, "{what}: at {got} m, expected {want} m, off by {error:e} m");
}

/// The triangles of a part.
fn of<'a>(part: &Part, triangles: &'a [[u32; 3]]) -> &'a [[u32; 3]] {
    &triangles[part.triangles.clone()]
}

fn pressed() -> (Simulation, DVec3) {
    let place = Place { shift: DVec3::new(0.3, -0.2, 0.1), turn: DQuat::from_rotation_z(0.5), slide: DVec3::ZERO };
    (open(&scene(&press(2e4, 1e-3, place, "")), None), place.shift)
}

/// A chain of three rigid cores, two of which swing; the nodes attached to the core at its tip are those within a
/// capsule.
fn chain() -> Simulation {
    let keys = "motion = \"driven\"\nkeys = [[0.0, 0.4, 0.1, -0.2, 0.1, 0.2, 0.3, 0.9273618495495703], \
                [0.2, 0.42, 0.1, -0.2, 0.1, 0.2, 0.3, 0.9273618495495703]]";
    let text = joints::chain(2e4, keys, ["", "stiffness = 0.5"], "gravity = [5.0, -25.0, 8.0]");
    let mut scene = scene(&text);
    let ends = [DVec3::new(0.1, 0.0, 0.0), DVec3::new(0.13, 0.0, 0.01)];
    scene.bodies[0].cores[0].bind = Some(Bind::Capsule(Capsule { ends, radii: [0.04, 0.03] }));
    // Units and scale together give metres; whatever uses one of the two alone is wrong by a factor of two.
    (scene.bodies[0].units, scene.bodies[0].scale) = (Some(0.5), 2.0);
    open(&scene, None)
}

#[test]
fn proxies_ride_on_their_frames() {
    let (mut simulation, origin) = pressed();
    for steps in [0, 40] {
        run(&mut simulation, steps);
        let mesh = simulation.overlay(Overlay::Proxies, origin).unwrap();
        let (places, triangles) = read(&mesh, origin);
        check_parts(&mesh, &triangles);
        let names: Vec<(&str, usize)> = mesh.parts.iter().map(|part| (part.name.as_str(), part.body)).collect();
        assert_eq!(names, [("block", 0), ("tool", 1)]);
        let values = mesh.values.read::<f32>().unwrap();
        let numbers = values[..mesh.vertex_count].iter().copied().fold(0.0, f32::max);
        assert_eq!(numbers, mesh.greatest);
        for part in mesh.parts.iter() {
            expect_closed(&part.name, &places, of(part, &triangles));
        }
        // The block's frame stays, and so do its hulls. The corners of the tool's hull are vertices of its skin, which
        // moves with the tool.
        let Shape::Soft { proxies, .. } = &simulation.bodies()[0].shape else { panic!("body 0 is not soft") };
        let body = &simulation.bodies()[0];
        let rest: Vec<DVec3> =
            proxies.iter().flat_map(|p| &p.hull).map(|x| body.position + body.orientation * *x).collect();
        for v in mesh.parts[0].vertices.clone() {
            let nearest = rest.iter().copied().min_by(|a, b| a.distance(places[v]).total_cmp(&b.distance(places[v])));
            near("hull of the block", places[v], nearest.unwrap(), origin);
        }
        let tool = simulation.tool().unwrap();
        for v in mesh.parts[1].vertices.clone() {
            let skin = simulation.tool_skin().into_iter().map(|x| tool.centre + tool.orientation * x);
            let nearest = skin.min_by(|a, b| a.distance(places[v]).total_cmp(&b.distance(places[v])));
            near("hull of the tool", places[v], nearest.unwrap(), origin);
        }
    }
    let messages = simulation.context().validation_messages();
    assert!(messages.is_empty(), "{messages:#?}");
}

/// Every triangle of a part is a face of a tetrahedron that has the part's material, and all parts together are the
/// whole mesh.
#[test]
fn the_parts_of_a_layer_go_by_material() {
    let text = std::fs::read_to_string("crates/cli/tests/golden/parts.toml").unwrap();
    let mut simulation = open(&scene(&text), None);
    let mesh = simulation.overlay(Overlay::Layers(Field::StrainEnergy), DVec3::ZERO).unwrap();
    let (places, triangles) = read(&mesh, DVec3::ZERO);
    check_parts(&mesh, &triangles);
    let named: Vec<_> = mesh.parts.iter().map(|part| (part.body, part.name.as_str(), part.material)).collect();
    let slab = [(0, "skin", 0), (0, "cut", 0), (0, "skin", 1), (0, "cut", 1), (0, "skin", 2), (0, "cut", 2)];
    assert_eq!(named, [&slab[..], &[(1, "skin", 0), (1, "cut", 0)]].concat());
    expect_closed("two layers", &places, &triangles);
    // Only the sphere (material 1) has no face on the boundary of the slab.
    for part in mesh.parts.iter() {
        let is_hidden = (part.body, part.name.as_str(), part.material) == (0, "skin", 1);
        assert_eq!(part.triangles.is_empty(), is_hidden, "{part:?}");
    }
    let Shape::Soft { layer, materials, .. } = &simulation.bodies()[0].shape else { panic!("body 0 is not soft") };
    let now = simulation.node_positions(0).unwrap();
    let node_of = |x: DVec3| (0..now.len()).min_by(|a, b| now[*a].distance(x).total_cmp(&now[*b].distance(x))).unwrap();
    for part in mesh.parts.iter().filter(|part| part.body == 0) {
        for triangle in of(part, &triangles) {
            let nodes = triangle.map(|v| node_of(places[v as usize]) as u32);
            let around = layer.tetrahedra.iter().enumerate().filter(|(_, t)| nodes.iter().all(|node| t.contains(node)));
            let found: Vec<usize> = around.map(|(t, _)| materials.index(t)).collect();
            assert!(found.contains(&part.material), "a face of material {} lies between {found:?}", part.material);
        }
    }
}

#[test]
fn a_layer_is_cut_open_where_its_nodes_are() {
    let (mut simulation, origin) = pressed();
    run(&mut simulation, 40);
    let Shape::Soft { layer, .. } = simulation.bodies()[0].shape.clone() else { panic!("body 0 is not soft") };
    // By default the cut goes through the middle, normal to x or z, whichever the layer is shorter along; the block is
    // as long along x as along z, and then the cut is normal to z. A cut across y follows, and then a cut that misses
    // the block.
    assert_eq!(simulation.layer_cut(0), Some(Cut { normal: DVec3::Z, offset: 0.0 }));
    let across = Cut { normal: DVec3::Y, offset: 0.01 };
    for cut in [None, Some(Cut { normal: 2.0 * across.normal, ..across }), Some(Cut { normal: DVec3::X, offset: 1.0 })]
    {
        simulation.cut_layer(0, cut).unwrap();
        let used = simulation.layer_cut(0).unwrap();
        let now = simulation.node_positions(0).unwrap();
        let mesh = simulation.overlay(Overlay::Layers(Field::Displacement), origin).unwrap();
        let (places, triangles) = read(&mesh, origin);
        check_parts(&mesh, &triangles);
        expect_closed("a layer", &places, &triangles);
        // `node_of` finds the node at which a vertex lies.
        let node_of =
            |x: DVec3| (0..now.len()).min_by(|a, b| now[*a].distance(x).total_cmp(&now[*b].distance(x))).unwrap();
        let nodes: Vec<usize> = places.iter().map(|x| node_of(*x)).collect();
        places.iter().zip(&nodes).for_each(|(x, n)| near("a node", *x, now[*n], origin));
        // The mesh must enclose the volume behind the cut, with the nodes where they are now.
        let volume6 = |t: &[u32; 4]| palpate::internal::prepare::layer::volume6(&now, t);
        let middle = |t: &[u32; 4]| t.iter().map(|n| layer.nodes[*n as usize]).sum::<DVec3>() / 4.0;
        let kept = layer.tetrahedra.iter().filter(|t| used.normal.dot(middle(t)) <= used.offset);
        let (want, got) = (kept.map(volume6).sum::<f64>() / 6.0, properties(&places, &triangles).volume);
        assert!((got - want).abs() < VOLUME * want && want > 0.0, "volume {got} m^3, expected {want} m^3");
        let all = layer.tetrahedra.iter().map(volume6).sum::<f64>() / 6.0;
        let [skin, open] = &mesh.parts[..] else { panic!("a cut layer must have two parts") };
        assert_eq!((skin.name.as_str(), open.name.as_str()), ("skin", "cut"));
        assert_eq!(open.triangles.is_empty(), want == all);
        // Cut faces lie near the plane, since cells are 12.5 mm wide.
        for v in open.vertices.clone() {
            assert!((used.normal.dot(layer.nodes[nodes[v]]) - used.offset).abs() < 0.0126);
        }
        // The value at a vertex is the displacement of its node. The strain energy gives other values.
        let (moved, _) = simulation.nodes(0).unwrap().unwrap();
        let values = mesh.values.read::<f32>().unwrap();
        for (v, n) in nodes.iter().enumerate() {
            assert!((f64::from(values[v]) - moved[*n].length()).abs() < 1e-7, "displacement shown at vertex {v}");
        }
        assert_eq!(mesh.greatest, values[..mesh.vertex_count].iter().copied().fold(0.0, f32::max));
        let other = simulation.overlay(Overlay::Layers(Field::StrainEnergy), origin).unwrap();
        assert!(other.greatest > 0.0 && other.values.read::<f32>().unwrap() != values);
        let none = simulation.overlay(Overlay::Layers(Field::Pressure), origin).unwrap();
        assert_eq!(none.greatest, 0.0);
    }
    assert!(simulation.cut_layer(1, None).is_err() && simulation.layer_cut(1).is_none());
    assert!(simulation.cut_layer(0, Some(Cut { normal: DVec3::ZERO, offset: 0.0 })).is_err());
    let messages = simulation.context().validation_messages();
    assert!(messages.is_empty(), "{messages:#?}");
}

#[test]
fn cores_and_bones_are_where_their_frames_are() {
    let mut simulation = chain();
    let origin = DVec3::new(0.4, 0.1, -0.2);
    run(&mut simulation, 30);
    let Shape::Soft { layer, frames, node_frames, .. } = simulation.bodies()[0].shape.clone() else {
        panic!("body 0 is not soft")
    };
    let places_now = simulation.frames(0);
    let at =
        |frame: usize, x: DVec3| places_now[frame].centre + places_now[frame].rotation * (x - frames[frame].centre);
    let mesh = simulation.overlay(Overlay::Cores, origin).unwrap();
    let (places, triangles) = read(&mesh, origin);
    check_parts(&mesh, &triangles);
    let names: Vec<&str> = mesh.parts.iter().map(|part| part.name.as_str()).collect();
    assert_eq!(names, ["tip", "root", "middle"]);
    let values = mesh.values.read::<f32>().unwrap();
    for (k, part) in mesh.parts.iter().enumerate() {
        assert!(values[part.vertices.clone()].iter().all(|x| *x == k as f32));
        expect_closed(&part.name, &places, of(part, &triangles));
        let own = |n: &u32| layer.attached[*n as usize] && node_frames[*n as usize] == k as u32;
        let whole = layer.tetrahedra.iter().filter(|t| t.iter().all(own));
        let want = whole.map(|t| palpate::internal::prepare::layer::volume6(&layer.nodes, t)).sum::<f64>() / 6.0;
        let got = properties(&places, of(part, &triangles)).volume;
        assert!(
            (got - want).abs() < VOLUME * want && want > 0.0,
            "{}: volume {got} m^3, expected {want} m^3",
            part.name
        );
        let rest: Vec<DVec3> =
            (0..layer.nodes.len() as u32).filter(own).map(|n| at(k, layer.nodes[n as usize])).collect();
        for v in part.vertices.clone() {
            let nearest = rest.iter().copied().min_by(|a, b| a.distance(places[v]).total_cmp(&b.distance(places[v])));
            near(&part.name, places[v], nearest.unwrap(), origin);
        }
    }
    let mesh = simulation.overlay(Overlay::Bones, origin).unwrap();
    let (places, triangles) = read(&mesh, origin);
    check_parts(&mesh, &triangles);
    assert_eq!(mesh.parts.len(), 1, "number of bones; the nodes of one core are given by a capsule");
    assert_eq!((mesh.parts[0].name.as_str(), mesh.greatest), ("tip", 0.0));
    expect_closed("a bone", &places, &triangles);
    assert!(properties(&places, &triangles).volume > 0.0, "the bone must face outward");
    let [a, b] = [DVec3::new(0.1, 0.0, 0.0), DVec3::new(0.13, 0.0, 0.01)].map(|x| at(0, x));
    for x in &places {
        let t = ((*x - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
        let error = (x.distance(a + t * (b - a)) - (0.04 - 0.01 * t)).abs();
        assert!(error < 1e-6, "vertex at {x} m: {error:e} m off the capsule");
    }
    let messages = simulation.context().validation_messages();
    assert!(messages.is_empty(), "{messages:#?}");
}

#[test]
fn regions_are_squares_at_their_contacts() {
    let (mut simulation, shift) = pressed();
    assert!(
        simulation.contact_patch_rectangles().unwrap().is_empty(),
        "there are contact patches before the first step"
    );
    run(&mut simulation, 45);
    let squares = simulation.contact_patch_rectangles().unwrap();
    let contacts = simulation.contacts().unwrap();
    assert_eq!(squares.iter().map(|square| square.contacts).sum::<usize>(), contacts.len());
    let (square, up) = (&squares[0], DQuat::from_rotation_z(0.5) * DVec3::Y);
    assert_eq!(square.bodies, [0, 1]);
    assert!(square.normal.dot(up) > 0.99, "wrong normal: {square:?}");
    let [u, v] = square.tangents;
    assert!(u.dot(v).abs() < 1e-6 && u.dot(square.normal).abs() < 1e-6 && v.dot(square.normal).abs() < 1e-6);
    for contact in &contacts {
        let from = contact.position - square.centre;
        // After the contacts were found, the step moved the bodies by less than 1 mm.
        let within = [u, v].iter().zip(square.half).all(|(t, half)| t.dot(from).abs() <= half + 1e-3);
        assert!(within && square.normal.dot(from).abs() < 5e-3, "{contact:?} is outside its patch's square {square:?}");
    }
    assert!((square.centre - (shift + up * 0.03)).length() < 0.01, "wrong centre: {square:?}");
    let floor = "[[body]]\nname = \"floor\"\nplane = [0.0, 1.0, 0.0, 0.0]\n[[body]]\nname = \"block\"\n\
                 layer = { box = [[-0.02, -0.02, -0.02], [0.02, 0.02, 0.02]], cells = [3, 3, 3] }\n\
                 position = [0.1, 0.0195, 0.2]\nmaterial = { young = 5e4, poisson = 0.4, density = 1000.0 }\n";
    let mut simulation = open(&scene(floor), None);
    run(&mut simulation, 5);
    let squares = simulation.contact_patch_rectangles().unwrap();
    assert_eq!(squares.len(), 1);
    assert!(squares[0].contacts >= 16 && squares[0].normal.y.abs() > 0.999);
    assert!((squares[0].centre - DVec3::new(0.1, 0.0, 0.2)).length() < 2e-3, "wrong centre: {squares:?}");
    assert!(squares[0].half.iter().all(|half| *half > 0.019 && *half < 0.03));
}
