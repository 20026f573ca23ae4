//! Invariants of contact and culling: depths found by rays against brute force and the analytic sphere, and distances
//! of convex hulls against the collision library parry.

use glam::{DQuat, DVec3};

use crate::contact::{Contact, ContactLaw, Support, Surface, Tips, gather, gather_triangles, ray_depths};
use crate::rays::Rays;
use crate::testing::Random;
use crate::{cull, skin};

/// Vertices and triangles of a sphere: an octahedron subdivided `levels` times, its vertices projected onto the sphere.
pub(super) fn sphere(radius: f64, centre: DVec3, levels: usize) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let mut vertices = vec![DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z];
    let mut triangles: Vec<[u32; 3]> =
        vec![[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
    for _ in 0..levels {
        let mut middles = std::collections::BTreeMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                vertices.push((vertices[a as usize] + vertices[b as usize]).normalize());
                vertices.len() as u32 - 1
            })
        };
        let mut finer = Vec::new();
        for [a, b, c] in triangles {
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        triangles = finer;
    }
    (vertices.iter().map(|v| centre + radius * *v).collect(), triangles)
}

/// Depth of `x` below a skin (triangle mesh) along `normal`, by a plane equation for every triangle, without a grid.
fn brute(normal: DVec3, x: DVec3, positions: &[DVec3], triangles: &[[u32; 3]]) -> Option<f64> {
    let ray_hit = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|i| positions[i as usize]);
        let m = (b - a).cross(c - a);
        let depth = m.dot(x - a) / m.dot(normal);
        let p = x - depth * normal;
        let inside = [(a, b), (b, c), (c, a)].iter().all(|(s, e)| (*e - *s).cross(p - *s).dot(m) >= 0.0);
        (inside && depth > 0.0).then_some((depth, m.dot(normal) < 0.0))
    };
    let (depth, leaves) = triangles.iter().filter_map(ray_hit).reduce(|p, q| if q.0 < p.0 { q } else { p })?;
    leaves.then_some(depth)
}

#[test]
fn rays_agree_with_trying_every_triangle() {
    let mut random = Random(11);
    let normal = random.vector().normalize();
    let (a, at) = sphere(0.1, DVec3::ZERO, 4);
    // The second sphere is dented and has another sheet within it, so that rays meet several triangles.
    let (mut b, mut bt) = sphere(0.1, normal * 0.17, 4);
    let (inner, inner_triangles) = sphere(0.095, normal * 0.17, 4);
    let first = b.len() as u32;
    b.extend(inner);
    bt.extend(inner_triangles.iter().map(|t| t.map(|i| i + first)));
    b.iter_mut().for_each(|x| *x += 0.004 * random.vector());
    let hits = ray_depths(normal, &a, &at, &b, &bt, f64::INFINITY);
    let facing = skin::normals(&a, &at);
    let mut count = 0;
    for (i, x) in a.iter().enumerate() {
        let expected = if facing[i].dot(normal) > 0.0 { brute(normal, *x, &b, &bt) } else { None };
        assert_eq!(hits[i].is_some(), expected.is_some(), "vertex {i}: rays and brute force must agree on the hit");
        let (Some(hit), Some(expected)) = (hits[i], expected) else { continue };
        count += 1;
        assert!((hit.depth - expected).abs() < 1e-14, "depth {} m, expected {expected} m", hit.depth);
        let corners = bt[hit.triangle as usize];
        let point: DVec3 = (0..3).map(|k| b[corners[k] as usize] * hit.barycentric[k]).sum();
        assert!((*x - hit.depth * normal).distance(point) < 1e-14, "barycentric coordinates must give the hit point");
    }
    println!("rays: {count} of {} vertices are in contact", a.len());
    assert!(count > 50);
}

#[test]
fn depths_between_spheres_follow_the_analytic_sphere() {
    let normal = DVec3::new(0.3, -0.5, 0.8).normalize();
    let worst = |levels: usize| {
        let (a, at) = sphere(0.1, DVec3::ZERO, levels);
        let (b, bt) = sphere(0.1, normal * 0.19, levels);
        let hits = ray_depths(normal, &a, &at, &b, &bt, f64::INFINITY);
        let errors = a.iter().zip(&hits).filter_map(|(x, hit)| {
            let r = x - normal * normal.dot(*x);
            let analytic = normal.dot(*x) - (0.19 - (0.01 - r.length_squared()).sqrt());
            Some((hit.as_ref()?.depth - analytic).abs())
        });
        errors.fold(0.0, f64::max)
    };
    let (coarse, fine) = (worst(4), worst(5));
    println!(
        "spheres: worst depth error {coarse:.2e} m, on the finer mesh {fine:.2e} m; order of convergence {:.2}",
        (coarse / fine).log2()
    );
    assert!(coarse < 1e-3 && coarse / fine > 3.0, "the error must fall as the square of the edge length");
}

fn surface<'a>(positions: &[DVec3], triangles: &'a [[u32; 3]], areas: &'a [f64]) -> Surface<'a> {
    Surface { positions: positions.to_vec(), triangles, areas, support: Support::Fixed }
}

#[test]
fn gathering_is_symmetric_and_its_area_does_not_depend_on_the_cut() {
    let normal = DVec3::Z;
    let law = ContactLaw { stiffness: 1e6, damping: 0.0, depth_limit: 0.05 };
    let force = |levels: usize, flip: bool| {
        let (a, at) = sphere(0.1, DVec3::ZERO, levels);
        let (b, bt) = sphere(0.1, normal * 0.19, levels);
        let (aa, ba) = (skin::areas(&a, &at), skin::areas(&b, &bt));
        let (a, b) = (surface(&a, &at, &aa), surface(&b, &bt, &ba));
        let contacts = if flip { gather(-normal, &b, &a, &law) } else { gather(normal, &a, &b, &law) };
        for c in &contacts {
            assert!((c.first.position - c.second.position - c.depth * c.normal).length() < 1e-14);
        }
        (contacts.len(), contacts.iter().map(|c| c.area * c.stiffness * c.depth).sum::<f64>())
    };
    // The exact force is the stiffness k = 1e6 N/m^3 times the volume of the overlap of two equal spheres of radius R,
    // which is that of two spherical caps of height c = 5 mm, each pi c^2 (6 R - 2 c) / 6.
    let cap = 0.005f64;
    let exact = 1e6 * 2.0 * std::f64::consts::PI * cap * cap * (0.3 - cap) / 3.0;
    let ((n, coarse), (_, fine), (m, flipped)) = (force(5, false), force(6, false), force(5, true));
    println!("overlapping spheres: {coarse:.4} N by {n} contacts, finer mesh {fine:.4} N, exact {exact:.4} N");
    assert_eq!(n, m);
    assert!((coarse - flipped).abs() < 1e-12 * coarse);
    assert!((coarse - exact).abs() < 0.05 * exact && (fine - exact).abs() < 0.02 * exact);
}

#[test]
fn triangles_of_a_coarse_sphere_push_as_its_overlap_with_a_fine_one() {
    let normal = DVec3::Z;
    let ((a, at), (b, bt)) = (sphere(0.1, DVec3::ZERO, 2), sphere(0.1, DVec3::new(0.03, -0.01, 0.17), 5));
    let (own, other) = (surface(&a, &at, &[]), surface(&b, &bt, &[]));
    let law = ContactLaw { stiffness: 1e6, damping: 10.0, depth_limit: 0.05 };
    let stiffening: Vec<f64> = (0..bt.len()).map(|i| 1.0 + (i % 7) as f64).collect();
    let found = gather_triangles(normal, &own, &other, &law, &Tips { stiffening: stiffening.clone(), damps: true });
    // Net force and torque are compared with sums over a grid of points, through each of which rays meet both spheres.
    let (above, below) = (Rays::new(normal, &a, &at), Rays::new(-normal, &b, &bt));
    let step = 2e-4;
    let (mut force, mut torque) = (0.0, DVec3::ZERO);
    for i in 0..1000 {
        for k in 0..1000 {
            let x = DVec3::new(step * (f64::from(i) - 499.5), step * (f64::from(k) - 499.5), 0.0);
            let hits = (above.first(x + normal), below.first(x - normal));
            let (Some(top), Some(bottom)) = hits else { continue };
            let depth = (1.0 - top.depth) - (bottom.depth - 1.0);
            let push = law.stiffness * stiffening[bottom.triangle as usize] * depth.max(0.0) * step * step;
            force += push;
            torque += push * x.cross(normal);
        }
    }
    let push = |c: &Contact| c.area * c.depth * c.stiffness;
    let (sum, turned): (f64, DVec3) =
        (found.iter().map(push).sum(), found.iter().map(|c| push(c) * c.second.position.cross(normal)).sum());
    println!("{} contacts: {sum} N, {turned} N m; by rays {force} N, {torque} N m", found.len());
    assert!((sum / force - 1.0).abs() < 1e-3 && turned.distance(torque) < 1e-3 * torque.length());
    for c in &found {
        assert!((c.first.position - c.second.position - c.depth * c.normal).length() < 1e-14);
        let factor = c.stiffness / law.stiffness;
        assert!(factor > 1.0 && factor < 7.0 && (c.damping / (factor * law.damping) - 1.0).abs() < 1e-12);
    }
    let given = gather_triangles(normal, &own, &other, &law, &Tips { stiffening, damps: false });
    assert!(given.len() == found.len() && given.iter().all(|c| c.damping == 10.0));
}

#[test]
fn a_large_query_takes_under_a_second() {
    let (a, at) = sphere(0.1, DVec3::ZERO, 7);
    let (b, bt) = sphere(0.1, DVec3::Z * 0.19, 5);
    let clock = std::time::Instant::now();
    let hits = ray_depths(DVec3::Z, &a, &at, &b, &bt, 0.02);
    let back = ray_depths(DVec3::NEG_Z, &b, &bt, &a, &at, 0.02);
    let time = clock.elapsed().as_secs_f64();
    println!("ray depths between skins of {} and {} vertices take {time:.3} s", a.len(), b.len());
    assert!(hits.iter().flatten().count() > 100 && back.iter().flatten().count() > 10);
    assert!(time < 1.0);
}

fn cube(half: f64) -> (Vec<DVec3>, Vec<(DVec3, f64)>) {
    let corner = |i: usize| DVec3::from_array(std::array::from_fn(|k| if i >> k & 1 == 1 { half } else { -half }));
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    ((0..8).map(corner).collect(), axes.iter().flat_map(|a| [(*a, half), (-*a, half)]).collect())
}

#[test]
fn penetration_of_convex_pairs_is_bounded_by_parry() {
    let mut random = Random(12);
    let (points, faces) = cube(1.0);
    let (mut equal, mut apart, mut worst) = (0, 0, 0.0f64);
    for _ in 0..200 {
        let turn = DQuat::from_scaled_axis(2.0 * random.vector());
        let shift = 2.5 * random.vector();
        let other: Vec<_> = points.iter().map(|p| turn * *p + shift).collect();
        let other_faces: Vec<_> = faces.iter().map(|(n, d)| (turn * *n, d + (turn * *n).dot(shift))).collect();
        let (normal, separation) = cull::best_face(&points, &faces, &other, &other_faces).unwrap();
        let (direction, distance) = cull::exact_distance(&points, &other).unwrap();
        // The separation along parry's direction is parry's distance; no direction separates further.
        let along = cull::separation_along(direction, &points, &other);
        assert!((along - distance).abs() < 1e-6, "separation {along} m, expected parry's {distance} m");
        worst = worst.max((along - distance).abs());
        assert!(separation <= distance + 1e-6, "separation {separation} m exceeds the distance {distance} m");
        assert!((normal.length() - 1.0).abs() < 1e-12);
        equal += usize::from((separation - distance).abs() < 1e-6);
        apart += usize::from(distance > 0.0);
    }
    println!(
        "convex pairs: greatest difference from parry's distance {worst:.1e} m; of 200 pairs, face normals give the \
         exact distance for {equal}, and {apart} do not overlap"
    );
    assert!(equal > 50 && apart > 10 && apart < 190);
}
