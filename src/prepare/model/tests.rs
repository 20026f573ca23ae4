//! Tests of the generated models (head, pumpkin, gear, human, sphere): invariants that hold for all models, and the
//! features of single models.

use std::collections::HashMap;

use glam::DVec3;

use super::gear::TIP;
use super::*;
use crate::prepare::distance::winding_number;
use crate::prepare::{Skin, mass, skin};

/// Number of triangles met when walking once around corner `k` of the triangle `start`. `edges`: the triangle of each
/// directed edge.
fn ring(skin: &Skin, edges: &HashMap<(u32, u32), usize>, start: usize, k: usize) -> usize {
    let vertex = skin.triangles[start][k];
    let (mut t, mut count) = (start, 0);
    loop {
        let at = skin.triangles[t].iter().position(|&v| v == vertex).unwrap();
        t = edges[&(skin.triangles[t][(at + 1) % 3], vertex)];
        count += 1;
        if t == start || count > 1000 {
            return count;
        }
    }
}

/// Checks that the skin has the exact number of vertices and the right genus, and is closed, manifold and in one piece.
fn check_topology(skin: &Skin, count: usize, genus: usize) {
    assert_eq!(skin.vertices.len(), count);
    assert_eq!(
        skin.triangles.len() + 4,
        2 * count + 4 * genus,
        "number of triangles plus 4, against 2 x vertices + 4 x genus (Euler's formula)"
    );
    assert_eq!(skin::defects(&skin.triangles), (0, 0));
    assert_eq!(skin::parts(count, &skin.triangles).1, 1);
    // The triangles around each vertex form one ring, so that no two sheets meet in a point.
    let mut degree = vec![0; count];
    skin.triangles.iter().flatten().for_each(|&v| degree[v as usize] += 1);
    let corners = skin.triangles.iter().enumerate().flat_map(|(t, triangle)| (0..3).map(move |k| (t, triangle, k)));
    let edges = corners.map(|(t, triangle, k)| ((triangle[k], triangle[(k + 1) % 3]), t)).collect();
    for (t, triangle) in skin.triangles.iter().enumerate() {
        for k in 0..3 {
            assert_eq!(ring(skin, &edges, t, k), degree[triangle[k] as usize]);
        }
    }
}

/// Least and greatest corner (m) and volume (m^3) of a fine mesh of each model.
fn measures(model: Model) -> (DVec3, DVec3, f64) {
    match model {
        Model::Head => (DVec3::new(-0.092, -0.125, -0.110), DVec3::new(0.092, 0.125, 0.112), 0.00417),
        Model::Pumpkin => (DVec3::new(-0.143, -0.101, -0.148), DVec3::new(0.144, 0.148, 0.150), 0.00898),
        Model::Gear => (DVec3::new(-TIP, -TIP, -0.01), DVec3::new(TIP, TIP, 0.01), 9.34e-5),
        Model::Human => (DVec3::new(-0.868, 0.0, -0.126), DVec3::new(0.868, 1.7, 0.187), 0.0665),
        Model::Sphere => (DVec3::NEG_ONE, DVec3::ONE, 4.0 / 3.0 * std::f64::consts::PI),
    }
}

/// Tolerance on the extents of a coarse mesh in addition to [`EXTENT`], in edge lengths of the mesh: a coarse mesh cuts
/// off tips, 1.3 edge lengths of the coarsest human's fingers.
const LOST: f64 = 1.5;
/// Radius of the gear's bore, m.
const BORE: f64 = 0.0125;
/// Tolerance for vertices of a tooth's flank to lie on the involute, m: rounding errors only.
const INVOLUTE: f64 = 1e-12;
/// Tolerance on the extents of a fine mesh, m.
const EXTENT: f64 = 0.003;

#[test]
#[ignore = "long: 9 s"]
fn models_of_any_count_are_closed_outward_and_whole() {
    for model in Model::ALL {
        let least = *model.vertices().start();
        for count in [least, 3_333, model.default_vertices()] {
            let start = std::time::Instant::now();
            let (vertices, triangles) = super::surface(model, count);
            println!("{} with {count} vertices: made in {:.2?}", model.name(), start.elapsed());
            let skin = skin::build(vertices, triangles);
            check_topology(&skin, count, usize::from(model == Model::Gear));
            let area: f64 = skin.areas.iter().sum();
            let edge = (area / count as f64).sqrt();
            let (low, high, volume) = measures(model);
            let near = |a: DVec3, b: DVec3| (a - b).abs().max_element() < EXTENT + LOST * edge;
            let nothing = (DVec3::INFINITY, DVec3::NEG_INFINITY);
            let corners = skin.vertices.iter().fold(nothing, |(l, h), &v| (l.min(v), h.max(v)));
            assert!(
                near(corners.0, low) && near(corners.1, high),
                "{model:?}: wrong corners of the bounding box, {corners:?} m"
            );
            let found = mass::properties(&skin.vertices, &skin.triangles).volume;
            assert!(
                (found / volume - 1.0).abs() < 0.01 + 0.2 * edge * area / volume,
                "{model:?}: wrong volume {found} m^3"
            );
        }
    }
}

#[test]
fn models_are_the_same_bits_every_time() {
    for model in Model::ALL {
        let bits = || {
            let (vertices, triangles) = super::surface(model, 3_000);
            let numbers = vertices.iter().flat_map(|v| v.to_array()).map(f64::to_bits);
            let all = numbers.chain(triangles.into_iter().flatten().map(u64::from));
            // The bits are hashed by FNV-1a (G. Fowler, L. Noll and P. Vo 1991), one word at a time.
            all.fold(0xcbf2_9ce4_8422_2325_u64, |hash, word| (hash ^ word).wrapping_mul(0x0100_0000_01b3))
        };
        let first = bits();
        println!("{} with 3000 vertices: hash {first:#018x}", model.name());
        assert_eq!(first, bits(), "{model:?}: two runs give different bits");
    }
}

#[test]
fn flanks_of_the_gear_are_involutes_and_its_bore_is_open() {
    let (vertices, triangles) = crate::prepare::model::surface(Model::Gear, Model::Gear.default_vertices());
    // Angle from the middle of a tooth to the start of the tooth's involute on the base circle. The angle follows from
    // the pitch circle, where the tooth is half a pitch wide.
    let pressure = 20f64.to_radians();
    let start = std::f64::consts::PI / (2.0 * gear::TEETH as f64) + pressure.tan() - pressure;
    let (mut flank, mut tips) = (0, 0);
    for v in vertices.iter().filter(|v| v.z.abs() < gear::HALF_WIDTH) {
        let radius = v.truncate().length();
        if radius < gear::BASE + 1e-9 {
            continue;
        }
        if radius > TIP - 1e-12 {
            tips += 1;
            continue;
        }
        // By the involute's definition, the taut string from the base circle to the vertex is as long as the arc that
        // the string unwound from.
        let string = (radius * radius - gear::BASE * gear::BASE).sqrt();
        let pitch = std::f64::consts::TAU / gear::TEETH as f64;
        let angle = v.y.atan2(v.x);
        let from_middle = (angle - pitch * (angle / pitch).round()).abs();
        let unrolled = start - from_middle + (string / gear::BASE).atan();
        assert!(
            (string - gear::BASE * unrolled).abs() < INVOLUTE,
            "vertex {v}: the taut string is {string} m long, but the arc that it unwound from is {} m long",
            gear::BASE * unrolled
        );
        flank += 1;
    }
    assert!(
        flank > 2_000 && tips > 1_000,
        "{flank} vertices on flanks, expected over 2000; {tips} vertices on tips, expected over 1000"
    );
    let inside = |x: f64, y: f64| winding_number(&vertices, &triangles, DVec3::new(x, y, 0.0)) > 0.5;
    assert!(!inside(0.0, 0.0) && !inside(BORE - 1e-4, 0.0) && inside(BORE + 1e-4, 0.0));
    // The first point lies in a tooth, the second in the gap next to it.
    let half = std::f64::consts::PI / gear::TEETH as f64;
    assert!(inside(0.047, 0.0) && !inside(0.047 * half.cos(), 0.047 * half.sin()));
}

#[test]
fn the_human_has_ten_fingers_apart() {
    let (vertices, triangles) = crate::prepare::model::surface(Model::Human, Model::Human.default_vertices());
    // Beyond the knuckles the mesh of each hand consists of four connected pieces, the fingers without the thumb.
    let beyond = |t: &&[u32; 3]| t.iter().all(|&v| vertices[v as usize].x.abs() > 0.805);
    let fingers: Vec<[u32; 3]> = triangles.iter().filter(beyond).copied().collect();
    let (labels, _) = skin::parts(vertices.len(), &fingers);
    let mut pieces: Vec<u32> = fingers.iter().map(|t| labels[t[0] as usize]).collect();
    pieces.sort_unstable();
    pieces.dedup();
    assert_eq!(pieces.len(), 8);
    for side in [-1.0, 1.0] {
        let inside = |x: f64, y, z| winding_number(&vertices, &triangles, DVec3::new(side * x, y, z)) > 0.5;
        assert!(inside(0.774, 1.381, 0.062), "a point of the thumb is not inside");
        assert!(!inside(0.780, 1.388, 0.048), "a point between thumb and forefinger is inside");
        assert!(inside(0.818, 1.396, 0.035) && !inside(0.818, 1.396, 0.020) && inside(0.818, 1.397, 0.005));
    }
}

#[test]
fn the_pumpkin_has_ten_ribs_and_a_stem() {
    let (vertices, triangles) = crate::prepare::model::surface(Model::Pumpkin, 10_000);
    let inside = |p: DVec3| winding_number(&vertices, &triangles, p) > 0.5;
    let at = |turns: f64, r: f64| DVec3::new(r * (turns * 0.62832).cos(), 0.0, r * (turns * 0.62832).sin());
    for k in 0..10 {
        let rib = f64::from(k) + 0.5;
        assert!(inside(at(rib, 0.14)) && !inside(at(rib + 0.5, 0.136)), "rib {k} or the groove after it is missing");
    }
    assert!(inside(DVec3::new(0.007, 0.115, 0.003)) && !inside(DVec3::new(0.04, 0.115, 0.0)));
}
