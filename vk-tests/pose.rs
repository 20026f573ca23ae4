//! pose/place: hulls and face planes in the world, cleared counters and indirect arguments.

use bytemuck::Zeroable;
use glam::{DQuat, DVec3};
use palpate::oracle::proximity;
use palpate::stages::args;
use palpate::stages::types::{Counts, Frame};

use crate::harness::{Outcome, Tolerance, case, context, expect_close};
use crate::random::Random;

/// Positions of order one through some twenty f32 operations.
const PLACED: Tolerance = Tolerance { abs: 2e-6, rel: 1e-6 };
const TETRAHEDRA: u32 = 1000;

struct Given {
    frames: Vec<Frame>,
    hull: Vec<[f32; 4]>,
    faces: Vec<[f32; 4]>,
    face_frames: Vec<[u32; 4]>,
}

fn run(given: &Given) -> Outcome {
    // What a step left behind.
    let stale = vec![77u32; args::WORDS];
    case("pose/place")
        .constant("HULL_VERTICES", given.hull.len() as u32)
        .constant("FACES", given.faces.len() as u32)
        .constant("TETRAHEDRA", TETRAHEDRA)
        .constant("GROUP", context().group_size())
        .input("frames", &given.frames)
        .input("hull_rest", &given.hull)
        .input("face_rest", &given.faces)
        .input("face_frame", &given.face_frames)
        .output::<[f32; 4]>("hull", given.hull.len())
        .output::<[f32; 4]>("faces", given.faces.len())
        .output::<Counts>("counts", 1)
        .partial("args", &stale)
        .elements(given.hull.len() + given.faces.len())
        .run()
}

fn frame(rotation: DQuat, centre: DVec3) -> Frame {
    let (rotation, centre) = (rotation.as_quat().to_array(), centre.as_vec3().to_array());
    Frame { rotation, centre, ..Frame::zeroed() }
}

fn f64s(x: [f32; 4]) -> DVec3 {
    DVec3::new(x[0].into(), x[1].into(), x[2].into())
}

#[test]
fn a_quarter_turn_by_hand() {
    let turn = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
    let given = Given {
        frames: vec![frame(DQuat::IDENTITY, DVec3::ZERO), frame(turn, DVec3::new(10.0, 0.0, 0.0))],
        hull: vec![[1.0, 2.0, 3.0, 0.0], [1.0, 0.0, 0.5, 1.0]],
        faces: vec![[1.0, 0.0, 0.0, 0.25]],
        face_frames: vec![[1, 0, 0, 0]],
    };
    let out = run(&given);
    let hull: Vec<f32> = out.get("hull");
    expect_close("hull", &hull, &[1.0, 2.0, 3.0, 0.0, 10.0, 1.0, 0.5, 0.0], PLACED);
    // The x face turns to y; the frame moved along x, so its offset stays.
    expect_close("faces", &out.get("faces"), &[0.0, 1.0, 0.0, 0.25], PLACED);
    assert_eq!(out.get::<Counts>("counts"), [Counts::default()]);
    let slots: Vec<u32> = out.get("args");
    for slot in 0..args::LOOP_APPLY {
        let groups = if slot == args::APPLY { TETRAHEDRA.div_ceil(context().group_size()) } else { 0 };
        assert_eq!(slots[3 * slot as usize..][..3], [groups, 1, 1], "slot {slot}");
    }
    assert!(slots[3 * args::LOOP_APPLY as usize..].iter().all(|word| *word == 77), "the solver's slots are its own");
}

#[test]
fn any_number_of_hull_vertices_and_faces_against_the_oracle() {
    let width = context().group_size() as usize;
    let mut random = Random(1);
    let places: Vec<_> = (0..5).map(|_| (random.vector(), random.turn(3.0))).collect();
    let frames: Vec<Frame> = places.iter().map(|(c, q)| frame(*q, *c)).collect();
    for n in [1, width - 1, width, width + 1, 1234] {
        let count = n / 3;
        let of = |i: usize| (i * 7 + 2) % 5;
        let point = |random: &mut Random, w: f32| -> [f32; 4] {
            let x = random.vector().as_vec3();
            [x.x, x.y, x.z, w]
        };
        let hull: Vec<_> = (0..n - count).map(|i| point(&mut random, of(i) as f32)).collect();
        let faces: Vec<_> = (0..count)
            .map(|_| {
                let normal = random.vector().normalize().as_vec3();
                [normal.x, normal.y, normal.z, random.next() as f32]
            })
            .collect();
        let face_frames = (0..count).map(|i| [of(i) as u32, 0, 0, 0]).collect();
        let out = run(&Given { frames: frames.clone(), hull: hull.clone(), faces: faces.clone(), face_frames });
        let placed = hull.iter().enumerate().flat_map(|(i, x)| {
            let (centre, rotation) = places[of(i)];
            proximity::place(centre, rotation, f64s(*x)).extend(0.0).to_array()
        });
        expect_close("hull", &out.get("hull"), &placed.collect::<Vec<_>>(), PLACED);
        let turned = faces.iter().enumerate().flat_map(|(i, x)| {
            let (centre, rotation) = places[of(i)];
            let (normal, offset) = proximity::place_face(centre, rotation, (f64s(*x), x[3].into()));
            normal.extend(offset).to_array()
        });
        expect_close("faces", &out.get("faces"), &turned.collect::<Vec<_>>(), PLACED);
    }
}

#[test]
fn a_point_keeps_its_height_over_a_face_wherever_both_go() {
    let mut random = Random(9);
    let frames = vec![frame(random.turn(3.0), random.vector() * 3.0)];
    let x = random.vector();
    let normal = random.vector().normalize();
    let given = Given {
        frames,
        hull: vec![[x.x as f32, x.y as f32, x.z as f32, 0.0]],
        faces: vec![[normal.x as f32, normal.y as f32, normal.z as f32, 0.5]],
        face_frames: vec![[0; 4]],
    };
    let out = run(&given);
    let (hull, face) = (out.get::<[f32; 4]>("hull")[0], out.get::<[f32; 4]>("faces")[0]);
    let height = f64s(face).dot(f64s(hull)) - f64::from(face[3]);
    expect_close("height", &[height as f32], &[normal.dot(x) - 0.5], PLACED);
}
