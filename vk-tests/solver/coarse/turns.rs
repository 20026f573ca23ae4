//! Tests of the rotations of blocks, which solve/assemble finds from the displacements. A block is the nodes that one
//! workgroup of the solver owns, an aggregate of the coarse space of the preconditioner; the modes of the coarse space,
//! affine motions of a block, turn with it.

use glam::{DMat3, DQuat, DVec3};
use palpate::scene::Preconditioner;

use super::super::passes::Passes;
use super::{kinds, plane, row, tilted, turned};
use crate::harness::random::Random;
use crate::solver::system::System;

/// Greatest allowed error of an angle, rad.
const ANGLE: f64 = 1e-5;

/// The solver's passes for bodies whose free nodes are turned by `turn` in their rest frames, and shifted.
fn turned_by(bodies: &[palpate::internal::prepare::Body], turn: DQuat) -> Passes {
    let mut system = System::preconditioned(bodies, 0.0, 3, Preconditioner::Coarse);
    let mut at = 0;
    for body in &system.twin.bodies {
        for (x, bound) in body.layer.nodes.iter().zip(&body.layer.attached) {
            let d = if *bound { DVec3::ZERO } else { turn * *x - *x + DVec3::new(0.02, -0.01, 0.03) };
            system.displacement[at] = d.as_vec3().extend(0.0).to_array();
            at += 1;
        }
    }
    Passes::new(system)
}

/// The angle between two rotations, rad.
fn angle(a: DQuat, b: DQuat) -> f64 {
    2.0 * (a.normalize().conjugate() * b.normalize()).xyz().length().min(1.0).asin()
}

fn quaternion(q: [f32; 4]) -> DQuat {
    DQuat::from_array(q.map(f64::from))
}

/// True if a block's nodes lie in a plane.
fn is_flat(system: &System, block: usize) -> bool {
    let [first, count, ..] = system.model.blocks.blocks[block];
    let nodes = &system.model.blocks.nodes[first as usize..(first + count) as usize];
    let place = |n: &[u32; 4]| DVec3::from_slice(&system.model.node_rest[n[0] as usize].map(f64::from)[..3]);
    let middle = nodes.iter().map(place).sum::<DVec3>() / nodes.len() as f64;
    let outer = |x: DVec3| DMat3::from_cols(x * x.x, x * x.y, x * x.z);
    // Places are relative to the cell size of 20 mm.
    let sum = nodes.iter().fold(DMat3::ZERO, |sum, n| sum + outer((place(n) - middle) / 0.02));
    sum.determinant() < 1e-6
}

/// For each block of free nodes: the rotation within its rigid coordinate frame and the rotation in the world, as
/// solve/assemble found them, and the rotation of the frame.
fn rotations(passes: &Passes) -> Vec<(DQuat, DQuat, DQuat)> {
    let (blocks, frames) = (&passes.system.model.blocks, &passes.system.frames);
    let found = |b: usize| {
        let frame = quaternion(frames[blocks.blocks[b][2] as usize].rotation);
        (quaternion(passes.block_rotations[b]), quaternion(passes.block_turns[b]), frame)
    };
    (0..blocks.free).map(found).collect()
}

#[test]
fn blocks_turn_with_their_nodes() {
    let mut random = Random(11);
    let (mut worst, mut flat, mut known) = (0.0f64, 0, 0);
    for (what, bodies) in kinds() {
        for turn in [random.turn(0.01), random.turn(0.5), random.turn(1.5)] {
            let mut passes = turned_by(&bodies, turn);
            passes.assemble();
            for (b, (found, world, frame)) in rotations(&passes).into_iter().enumerate() {
                if is_flat(&passes.system, b) {
                    flat += 1;
                    continue;
                }
                known += 1;
                worst = worst.max(angle(found, turn)).max(angle(world, frame * turn));
                assert!(
                    angle(found, turn) < ANGLE,
                    "{what}: rotation {found}, expected {turn}, off by {:e} rad",
                    angle(found, turn)
                );
                assert!(angle(world, frame * turn) < ANGLE, "{what}: wrong rotation {world} in the world");
            }
            // The next run starts from the rotations found and must find the same ones.
            let before = passes.block_rotations.clone();
            passes.assemble();
            for (a, b) in before.iter().zip(&passes.block_rotations) {
                assert!(angle(quaternion(*a), quaternion(*b)) < ANGLE, "{what}: a second run finds another rotation");
            }
        }
    }
    println!("rotations of {known} blocks are off by up to {worst:.1e} rad; {flat} flat blocks are not compared");
    assert!(known > flat, "{known} blocks are not flat, {flat} are flat");
}

#[test]
fn blocks_at_rest_and_carried_ones_are_not_turned() {
    for (what, bodies) in kinds() {
        let mut passes = turned_by(&bodies, DQuat::IDENTITY);
        passes.system.displacement.fill([0.0; 4]);
        passes.assemble();
        for (b, turn) in passes.block_turns.iter().enumerate() {
            assert_eq!(passes.block_rotations[b], [0.0, 0.0, 0.0, 1.0], "{what}: rotation of block {b} in its frame");
            let frame = passes.system.model.blocks.blocks[b][2] as usize;
            let apart = angle(quaternion(*turn), quaternion(passes.system.frames[frame].rotation));
            assert!(apart < 1e-6, "{what}: rotation of block {b} is off its frame's by {apart:e} rad");
        }
    }
}

#[test]
fn what_is_known_of_flat_blocks_is_found() {
    // For a block whose nodes lie in a plane, a turn within this plane must be found. For a block whose nodes lie in a
    // row, no turn is made, and none must be found. After any other turn, the result must still be a rotation.
    let mut random = Random(12);
    for (what, layer, axis) in [("a plane", plane(), Some(DVec3::Z)), ("a row", row(), None)] {
        let tilt = DQuat::from_scaled_axis(DVec3::new(0.5, -0.8, 0.3));
        for (layer, axis) in [(layer.clone(), axis), (tilted(layer), axis.map(|axis| tilt * axis))] {
            let turn = axis.map_or(DQuat::IDENTITY, |axis| DQuat::from_axis_angle(axis, 0.8));
            let mut passes = turned_by(&[turned(layer.clone())], turn);
            passes.assemble();
            for (found, ..) in rotations(&passes) {
                assert!(
                    angle(found, turn) < ANGLE,
                    "{what}: rotation {found}, expected {turn}, off by {:e} rad",
                    angle(found, turn)
                );
            }
            let mut passes = turned_by(&[turned(layer)], random.turn(1.5));
            passes.assemble();
            for (found, world, _) in rotations(&passes) {
                let unit = |q: DQuat| (q.length() - 1.0).abs() < 1e-6;
                assert!(unit(found) && unit(world), "{what}: not unit quaternions: {found}, {world}");
            }
        }
    }
}
