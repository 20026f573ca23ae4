//! Tests of the operator product A x, against values found by hand and against the f64 oracle (the reference
//! implementation on the CPU). The kernels are solve/element_product (elements, matrix-free), solve/stiffness_blocks
//! (elements, assembled as a matrix), solve/contact_iteration (contacts) and solve/gather (sums over nodes, and the rows of
//! the tool, the rigid body that the haptic device leads).

use glam::{DMat3, DQuat, DVec3};

use palpate::internal::shaders;

use super::passes::{Change, Passes};
use crate::harness::random::Random;
use crate::harness::{Tolerance, context, expect_close};
use crate::solver::system::{DT, System, layer, layered, material, mixed, triples, two_layers};
use crate::stage::elastic::expect_of_largest;

/// Greatest allowed error of A x, relative to the largest value of a body's rows, which sum a few dozen terms. Each
/// term is a dozen roundings of 6e-8 away from the input.
const PRODUCT: f64 = 2.0e-6;
/// Greatest allowed error of A x where tetrahedra are so compressed that the modulus of the compression penalty rises:
/// this modulus is known to 1e-5.
const COMPRESSED_PRODUCT: f64 = 4.0e-6;
/// Greatest allowed error of inner products, relative to the sum of the magnitudes of the terms: vectors of a hundred
/// numbers of both signs.
const DOT: f64 = 2.0e-6;
/// Number of contacts. One workgroup of solve/contact_iteration handles 64, so that a second one is partly filled. There
/// are at least 14 contacts of each of the seven kinds that `with_contacts` makes, which differ in what touches: soft
/// bodies, the tool or fixed bodies.
const CONTACTS: usize = 100;
/// Largest displacement of a node, m, in cells of 20 mm: a few per cent of the tetrahedra are inverted.
const AMPLITUDE: f64 = 0.012;

/// Computes A x at the nodes and for the tool; the kernels read x where they keep the preconditioned residual u.
fn product(passes: &mut Passes, x: &[[f32; 4]], tool: [f32; 6]) {
    passes.preconditioned = x.to_vec();
    passes.residual = x.to_vec();
    if passes.tool {
        let own = passes.tool_iterate_mut();
        (own.u, own.r) = (tool, tool);
    }
    passes.apply(Change::Preconditioned);
    passes.gather(1);
}

fn tool_vector(random: &mut Random) -> [f32; 6] {
    std::array::from_fn(|_| random.next() as f32)
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn magnitude(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a * b).abs()).sum()
}

/// Compares the product A x, at nodes and tool, with that of the oracle's matrix, within `share` of the largest value,
/// with the operator assembled and matrix-free. Returns how many tetrahedra are inverted.
fn expect_oracle(what: &str, system: System, seed: u64, share: f64) -> usize {
    let mut passes = Passes::new(system);
    let mut random = Random(seed);
    let (x, tool) = (passes.system.random_field(&mut random), tool_vector(&mut random));
    for assembled in [false, true] {
        let what = format!("{what}, {}", if assembled { "assembled" } else { "matrix-free" });
        passes.assembled = assembled;
        product(&mut passes, &x, tool);
        let s = &passes.system;
        let (a, _) = s.twin.assemble(s.device.as_ref(), &s.twin_contacts);
        let (nodes, twist) = s.rows(&a.multiply(&s.unknowns(&x, &tool)));
        let got = triples(&passes.operator_product);
        let mut at = 0;
        for (b, want) in nodes.iter().enumerate() {
            expect_of_largest(&format!("{what}: body {b}"), &got[at..at + want.len()], want, share);
            at += want.len();
        }
        if passes.tool {
            expect_of_largest(&format!("{what}: tool, force"), &passes.tool_rows()[..3], &twist[..3], share);
            expect_of_largest(&format!("{what}: tool, torque"), &passes.tool_rows()[3..], &twist[3..], share);
        }
    }
    let s = &passes.system;
    let inverted = |body: &palpate_oracle::step::SoftBody| {
        let deformed =
            |e: &usize| (DMat3::IDENTITY + body.elements.gradient(*e, &body.displacement)).determinant() < 0.0;
        (0..body.layer.tetrahedra.len()).filter(deformed).count()
    };
    s.twin.bodies.iter().map(inverted).sum()
}

#[test]
fn a_unit_tetrahedron_and_one_contact_by_hand() {
    // The gradients g of the shape functions of nodes 1 to 3 are e_x, e_y, e_z, the Lamé constants are mu = 2 and
    // lambda = 3, and node 1 moves along x at 1 m/s. The velocity gradient is W = sum v g^T = diag(1, 0, 0), with node
    // velocities v, and the stress is S = 2 mu sym(W) + lambda tr(W) I = diag(2 * 2 + 3, 3, 3).
    let nodes = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
    let tetrahedron = palpate::internal::prepare::Layer {
        nodes,
        tetrahedra: vec![[0, 1, 2, 3]],
        attached: vec![false; 4],
        ..Default::default()
    };
    let mut system = System::new(&[layered(tetrahedron, material(2e4), DQuat::IDENTITY)], 0.0, 1);
    system = system.with_tool().with_contacts(3, 2);
    system.gradients[..3].copy_from_slice(&[[1.0, 0.0, 0.0, 2.0], [0.0, 1.0, 0.0, 3.0], [0.0, 0.0, 1.0, 0.0]]);
    // Contact 2 is that of one vertex of the skin (surface mesh), with normal velocity n . (0.25 v_0 + 0.75 v_1), where
    // v_0 and v_1 are velocities of nodes 0 and 1 and n is the contact normal, and the tool at rest.
    let contact = &mut system.contacts[2];
    // The tool's lever, -arm x n, is (0, -4/3, 1).
    (contact.normal, contact.area, contact.arm) = ([0.0, 0.6, 0.8], 0.5, [-1.0 / 0.6, 0.0, 0.0]);
    (contact.stiffness, contact.damping, contact.quads, contact.tool_sign) = (4.0, 2.0, 1, -1.0);
    system.entry_nodes[8] = [0, 1, 2, 3];
    system.entry_weights[8] = [0.25, 0.75, 0.0, 0.0];
    let mut passes = Passes::new(system);
    passes.assembled = false;
    passes.preconditioned = vec![[0.0; 4], [1.0, 0.0, 0.0, 0.0], [0.0; 4], [0.0; 4]];
    passes.tool_iterate_mut().x = [9.0; 6];
    passes.apply(Change::Preconditioned);
    let want = [-7.0, -3.0, -3.0, 7.0, 0.0, 0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 3.0];
    assert_eq!(triples(&passes.element_forces[..4]), want);
    assert_eq!(passes.contact_forces[2], [0.0; 4], "the contact does not move along its normal");
    // Now node 1 moves along the normal: its part of the speed is 0.75 * (0.6, 0.8) . (3, 4), and the part of the tool
    // with twist (u, w) is -n . u + lever . w = -0.8 * 2 + 5.
    passes.preconditioned[1] = [0.0, 3.0, 4.0, 0.0];
    passes.tool_iterate_mut().u = [0.0, 0.0, 2.0, 0.0, 0.0, 5.0];
    passes.apply(Change::Preconditioned);
    let h = f64::from(DT);
    let force = h * (h * 4.0 + 2.0) * 0.5 * (0.75 * 5.0 - 1.6 + 5.0);
    let want = [0.0, 0.6 * force, 0.8 * force, force];
    expect_close("contact", &passes.contact_forces[2], &want, Tolerance { abs: 0.0, rel: 1e-6 });
    // Geometric stiffness with Z = diag(1, 2, 4), xy 8: for node 1 moving by (0, 3, 4), w = e_x x v = (0, -4, 3), Z w =
    // (-32, -8, 12), and the force on node i is (Z w) x e_i.
    passes.system.gradients[..5].copy_from_slice(&[
        [1.0, 0.0, 0.0, 0.0],
        [0.0, 1.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.0],
        [1.0, 2.0, 4.0, 0.0],
        [8.0, 0.0, 0.0, 0.0],
    ]);
    passes.apply(Change::Preconditioned);
    let want = [-4.0, -44.0, -40.0, 0.0, 12.0, 8.0, -12.0, 0.0, -32.0, -8.0, 32.0, 0.0];
    let sum: Vec<f64> = (0..3).map(|axis| -(want[3 + axis] + want[6 + axis] + want[9 + axis])).collect();
    assert_eq!(triples(&passes.element_forces[..4])[3..], want[3..].iter().map(|x| *x as f32).collect::<Vec<_>>()[..]);
    assert_eq!(triples(&passes.element_forces[..1]), sum.iter().map(|x| *x as f32).collect::<Vec<_>>());
    // The assembled operator of the same tetrahedron has for nodes 1 and 2, with g_1 = e_x and g_2 = e_y, the block mu
    // g_2 g_1^T + lambda g_1 g_2^T + [g_1]^T Z [g_2], where Z [g_2] has the columns -Z e_z, 0, Z e_x, and the
    // transpose of [g_1] takes v to v x e_x.
    passes.assembled = true;
    passes.system.gradients[0][3] = 2.0;
    passes.system.gradients[1][3] = 3.0;
    passes.apply(Change::Preconditioned);
    // The block lies in the row of node 1, and its transpose in that of node 2; the first column names the other node.
    let block = |i: u32, j: f32| -> [[f32; 4]; 3] {
        let [_, first, count, _] = passes.edges.block_nodes.iter().find(|node| node[0] == i).unwrap();
        let at = |k: u32, c: u32| passes.edges.blocks[(first + (3 * k + c) * shaders::ROW_SLICE) as usize];
        let k = (0..*count).find(|k| at(*k, 0)[3] == j).unwrap();
        [0, 1, 2].map(|c| at(k, c))
    };
    assert_eq!(block(1, 2.0), [[0.0, 2.0 - 4.0, 0.0, 2.0], [3.0, 0.0, 0.0, 0.0], [0.0, 0.0, -8.0, 0.0]]);
    assert_eq!(block(2, 1.0), [[0.0, 3.0, 0.0, 1.0], [2.0 - 4.0, 0.0, 0.0, 0.0], [0.0, 0.0, -8.0, 0.0]]);
}

#[test]
fn nodes_gather_their_elements_by_hand() {
    // For one tetrahedron, a node's row of w = A u is (1 + h alpha) m u + the element's force on the node, with time
    // step h, mass damping alpha and node mass m. Padding entries in a node's list of elements add no force.
    let nodes = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
    let tetrahedron = palpate::internal::prepare::Layer {
        nodes,
        tetrahedra: vec![[0, 1, 2, 3]],
        attached: vec![false, true, false, false],
        ..Default::default()
    };
    let system = System::new(&[layered(tetrahedron, material(2e4), DQuat::IDENTITY)], 0.0, 1);
    let mut passes = Passes::new(system);
    passes.assembled = false;
    for k in 0..4 {
        passes.element_forces[k] = [k as f32 + 1.0, 10.0, 0.0, 0.0];
    }
    passes.preconditioned = vec![[0.0, 0.0, 1.0, 0.0]; 4];
    passes.residual = vec![[2.0, 0.0, 3.0, 0.0]; 4];
    passes.gather(1);
    // Each node has 1 / 24 of 1000 kg, and alpha = 0.5 / s.
    let m = (1.0 + f64::from(DT) * 0.5) * 1000.0 / 24.0;
    let want = [1.0, 10.0, m, 0.0, 0.0, 0.0, 3.0, 10.0, m, 4.0, 10.0, m];
    let rounding = Tolerance { abs: 0.0, rel: 1e-6 };
    expect_close("operator_product", &triples(&passes.operator_product), &want, rounding);
    let sums: [f32; 2] = passes.dots.iter().fold([0.0; 2], |s, d| [s[0] + d[0], s[1] + d[1]]);
    expect_close("r.u and w.u of free nodes", &sums, &[9.0, 3.0 * m], rounding);
}

/// True if the layer has no tetrahedra, and thus nothing for contacts to act on.
fn is_empty(body: &palpate::internal::prepare::Body) -> bool {
    matches!(&body.shape, palpate::internal::prepare::Shape::Soft { layer, .. } if layer.tetrahedra.is_empty())
}

#[test]
fn products_agree_with_the_assembled_matrix_at_every_size() {
    // Sizes are around the workgroup size of solve/gather, which sums over nodes, and around that of
    // solve/element_product, which does not.
    let width = context().reduce_size() as usize;
    let large = context().group_size() as usize;
    for nodes in [0, 1, width - 1, width, width + 1, large - 1, large, large + 1, 1234] {
        let bodies =
            if nodes == 0 { vec![] } else { vec![layered(layer(nodes), material(2e4), DQuat::from_rotation_x(1.0))] };
        expect_oracle(&format!("{nodes} nodes"), System::new(&bodies, AMPLITUDE, 3), 4, PRODUCT);
        if !bodies.iter().all(is_empty) {
            let system = System::new(&bodies, AMPLITUDE, 3).with_tool().with_contacts(nodes, 5);
            expect_oracle(&format!("{nodes} nodes and contacts"), system, 4, PRODUCT);
        }
    }
}

#[test]
fn products_agree_with_the_assembled_matrix_for_mixed_materials() {
    // A node's damping is that of the elements at the node, weighted by their mass.
    let bodies = [layered(layer(200), mixed(1000), DQuat::from_rotation_x(1.0))];
    expect_oracle("mixed materials", System::new(&bodies, AMPLITUDE, 3), 4, PRODUCT);
}

#[test]
fn products_agree_with_the_assembled_matrix_for_inverted_tetrahedra() {
    let bodies = two_layers();
    for seed in 0..4 {
        let inverted =
            expect_oracle("without contacts", System::new(&bodies, AMPLITUDE, seed), seed + 10, COMPRESSED_PRODUCT);
        assert!(inverted > 10, "{inverted} tetrahedra are inverted, expected more than 10");
        let system = System::new(&bodies, AMPLITUDE, seed).with_contacts(CONTACTS, seed + 20);
        expect_oracle("contacts", system, seed + 10, COMPRESSED_PRODUCT);
        let system = System::new(&bodies, AMPLITUDE, seed).with_tool().with_contacts(CONTACTS, seed + 20);
        expect_oracle("contacts and a tool", system, seed + 10, COMPRESSED_PRODUCT);
        let system =
            System::new(&bodies, AMPLITUDE, seed).with_tool().with_friction().with_contacts(CONTACTS, seed + 20);
        expect_oracle("friction", system, seed + 10, COMPRESSED_PRODUCT);
    }
}

#[test]
fn the_operator_is_symmetric_and_positive() {
    // Checks x . A y = y . A x and x . A x > 0 for nodes and tool together, with inverted tetrahedra among them.
    let bodies = two_layers();
    for (seed, assembled) in (0..4).flat_map(|seed| [(seed, false), (seed, true)]) {
        let system = System::new(&bodies, AMPLITUDE, seed).with_tool();
        let system = if seed % 2 == 0 { system } else { system.with_friction() };
        let mut passes = Passes::new(system.with_contacts(CONTACTS, seed + 30));
        passes.assembled = assembled;
        let mut random = Random(seed + 40);
        let mut product_of = |passes: &mut Passes| {
            let (x, tool) = (passes.system.random_field(&mut random), tool_vector(&mut random));
            product(passes, &x, tool);
            let s = &passes.system;
            (s.unknowns(&x, &tool), s.unknowns(&passes.operator_product, &passes.tool_rows()))
        };
        let (x, ax) = product_of(&mut passes);
        let (y, ay) = product_of(&mut passes);
        let (left, right) = (dot(&x, &ay), dot(&y, &ax));
        assert!((left - right).abs() < DOT * magnitude(&x, &ay), "x.Ay = {left}, y.Ax = {right}");
        let (xx, yy) = (dot(&x, &ax), dot(&y, &ay));
        assert!(
            xx > 1e-3 * magnitude(&x, &ax) && yy > 1e-3 * magnitude(&y, &ay),
            "not positive: x.Ax = {xx}, y.Ay = {yy}"
        );
    }
}

#[test]
fn rigid_motions_meet_no_elastic_force() {
    // The elements must give no force for translations at any deformation, nor for twists of a body that is turned but
    // not deformed.
    let bodies = two_layers();
    let mut passes = Passes::new(System::new(&bodies, AMPLITUDE, 5));
    passes.preconditioned = vec![[0.3, -0.7, 0.4, 0.0]; passes.nodes()];
    passes.assembled = false;
    passes.apply(Change::Preconditioned);
    assert!(passes.element_forces.iter().flatten().all(|f| *f == 0.0), "a translation causes an elastic force");
    passes.gather(1);
    let of_masses = passes.operator_product.clone();
    passes.assembled = true;
    passes.apply(Change::Preconditioned);
    passes.gather(1);
    assert_eq!(passes.operator_product, of_masses, "a translation causes a force of the assembled elements");

    let mut system = System::new(&bodies, 0.0, 5);
    let spin = DVec3::new(0.4, -1.0, 0.8);
    let mut twist = vec![];
    let mut at = 0;
    for (b, body) in system.twin.bodies.iter().enumerate() {
        let turn = DQuat::from_scaled_axis(DVec3::new(1.0 + b as f64, 0.5, -0.7));
        for x in &body.layer.nodes {
            let d = (turn * *x - *x).as_vec3();
            system.displacement[at] = [d.x, d.y, d.z, 0.0];
            let v = spin.cross(body.elements.frame * (turn * *x)).as_vec3();
            twist.push([v.x, v.y, v.z, 0.0]);
            at += 1;
        }
    }
    system.rotate();
    let mut passes = Passes::new(system);
    passes.assembled = false;
    let largest = |passes: &Passes| passes.element_forces.iter().flatten().fold(0.0f32, |m, f| m.max(f.abs()));
    // For comparison, the velocities are of similar size but are no rigid motion.
    passes.preconditioned = twist.iter().map(|v| [v[1], -v[2], v[0] * 0.5, 0.0]).collect();
    passes.apply(Change::Preconditioned);
    let usual = largest(&passes);
    passes.preconditioned = twist;
    passes.apply(Change::Preconditioned);
    assert!(
        f64::from(largest(&passes)) < 1e-5 * f64::from(usual),
        "largest element force {:e} for a twist, {usual:e} for another motion",
        largest(&passes)
    );
    passes.gather(1);
    let of_masses = triples(&passes.operator_product);
    passes.assembled = true;
    passes.apply(Change::Preconditioned);
    passes.gather(1);
    let assembled = triples(&passes.operator_product);
    let largest = of_masses.iter().zip(&assembled).fold(0.0f32, |m, (a, b)| m.max((a - b).abs()));
    assert!(largest < 1e-5 * usual, "assembled, a twist causes forces of {largest:e}, another motion {usual:e}");
}

#[test]
fn inner_products_of_every_mode() {
    // solve/gather runs in its modes 0 (warm start, with w = A x), 1 (iteration, with w = A u) and 2 (end, with w = A
    // x), with and without contacts. Its inner products are compared with f64 sums that use the kernel's own w.
    for contacts in [0, CONTACTS] {
        let system = System::new(&two_layers(), AMPLITUDE, 6).with_tool().with_contacts(contacts, 7);
        let mut passes = Passes::new(system);
        let mut random = Random(50);
        passes.assemble();
        passes.solution = passes.system.random_field(&mut random);
        passes.residual = passes.system.random_field(&mut random);
        passes.preconditioned = passes.system.random_field(&mut random);
        passes.trend = passes.system.random_field(&mut random);
        for mode in 0..3 {
            passes.apply(if mode == 1 { Change::Preconditioned } else { Change::Start });
            passes.gather(mode);
            let wide = |x: &[[f32; 4]]| -> Vec<f64> { triples(x).into_iter().map(f64::from).collect() };
            let (w, first) = (wide(&passes.operator_product), wide(&passes.preconditioned));
            let conditioned = |x: &[f64]| -> Vec<f64> {
                let by_node = x.chunks(3).enumerate().map(|(i, x)| passes.precondition(i, [x[0], x[1], x[2]]));
                by_node.flatten().collect()
            };
            let left: Vec<f64> = wide(&passes.rhs).iter().zip(&w).map(|(b, w)| b - w).collect();
            let pairs = match mode {
                0 => {
                    let x = wide(&passes.solution);
                    vec![(x.clone(), wide(&passes.rhs)), (x, w.clone()), (wide(&passes.trend), w)]
                }
                1 => vec![(wide(&passes.residual), first.clone()), (w, first)],
                // The last inner product is (eps x)^2 . D, with the rounding unit eps and the diagonal D of A: the
                // squared residual that rounding of x leaves.
                _ => {
                    let lost: Vec<f64> = wide(&passes.solution).iter().map(|x| 6e-8 * x).collect();
                    let diagonal = |i: usize| 1.0 / f64::from(passes.inverse[2 * (i / 3)][i % 3]);
                    let moved = lost.iter().enumerate().map(|(i, x)| if *x == 0.0 { 0.0 } else { x * diagonal(i) });
                    vec![(left.clone(), conditioned(&left)), (lost.clone(), moved.collect())]
                }
            };
            for (k, (a, b)) in pairs.iter().enumerate() {
                let got: f64 = match mode {
                    0 => passes.projections.iter().map(|d| f64::from(d[k])).sum(),
                    _ => passes.dots.iter().map(|d| f64::from(d[k])).sum(),
                };
                let error = (got - dot(a, b)).abs();
                assert!(
                    error <= DOT * magnitude(a, b),
                    "solve/gather in mode {mode}, inner product {k}: {got:e}, expected {:e}",
                    dot(a, b)
                );
            }
        }
    }
}
