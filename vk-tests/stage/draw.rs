//! Tests of skins (surface meshes) as they are drawn: positions and normals on the GPU must be those that the host
//! computes in f64, and the arrays can be exported to other programs.

use glam::DVec3;
use palpate::Simulation;

use crate::invariant::friction;
use crate::scene::joints;
use crate::scene::touch::{Place, press};
use crate::scene::whole_step::{open, run, scene};

/// Error of positions relative to the distance from the chosen origin: f32 sums of a few terms.
const POSITION: f64 = 4e-7;
/// Error of unit normals: the error of a position over the shortest edge of the skins in these tests (5 mm), and a
/// little more.
const NORMAL: f64 = 2e-4;

/// World positions of the skin vertices of all bodies and of the tool, in f64.
fn places(simulation: &Simulation) -> Vec<DVec3> {
    let mut all: Vec<DVec3> =
        (0..simulation.bodies().len()).flat_map(|body| simulation.skin_positions(body).unwrap()).collect();
    if let Some(tool) = simulation.tool() {
        all.extend(simulation.tool_skin().iter().map(|x| tool.centre + tool.orientation * *x));
    }
    all
}

/// Vertex normals of the skins if their vertices are at `places`.
fn normals(simulation: &Simulation, places: &[DVec3]) -> Vec<DVec3> {
    let mut sums = vec![DVec3::ZERO; places.len()];
    for (body, range) in simulation.skin_ranges().iter().enumerate() {
        for corners in simulation.skin_triangles(body) {
            let [a, b, c] = corners.map(|v| range.start + v as usize);
            let area = (places[b] - places[a]).cross(places[c] - places[a]);
            [a, b, c].into_iter().for_each(|v| sums[v] += area);
        }
    }
    sums.iter().map(|sum| sum.normalize_or_zero()).collect()
}

fn shown_as_it_is(name: &str, text: &str, origin: DVec3) {
    let mut simulation = open(&scene(text), None);
    for steps in [0, 30] {
        run(&mut simulation, steps);
        let (places, ranges) = (places(&simulation), simulation.skin_ranges());
        assert_eq!(ranges.last().unwrap().end, places.len(), "{name}: number of skin vertices");
        let normals = normals(&simulation, &places);
        let skins = simulation.skins(origin).unwrap();
        let read = |array: &palpate::internal::gpu::Buffer| array.read::<[f32; 4]>().unwrap();
        let (shown, directions) = (read(skins.positions), read(skins.normals));
        assert_eq!((shown.len(), directions.len()), (places.len(), places.len()));
        let wide = |x: &[f32; 4]| DVec3::new(x[0].into(), x[1].into(), x[2].into());
        let reach = places.iter().map(|x| (*x - origin).length()).fold(0.0, f64::max);
        for (vertex, (x, n)) in places.iter().zip(&normals).enumerate() {
            let (position, direction) = (&shown[vertex], &directions[vertex]);
            assert!(position[3] == 1.0 && direction[3] == 0.0);
            let error = wide(position).distance(*x - origin);
            assert!(
                error < POSITION * reach,
                "{name}, vertex {vertex}: position {position:?}, expected {}, off by {error:e} m",
                *x - origin
            );
            let error = wide(direction).distance(*n);
            assert!(
                error < NORMAL && n.length() > 0.5,
                "{name}, vertex {vertex}: normal {direction:?}, expected {n}, off by {error:e}"
            );
        }
        let messages = simulation.context().validation_messages();
        assert!(messages.is_empty(), "{messages:#?}");
    }
}

#[test]
fn skins_are_shown_where_they_are() {
    let place = Place { shift: DVec3::new(0.3, -0.2, 0.1), ..Place::default() };
    shown_as_it_is("pressed", &press(2e4, 1e-3, place, ""), place.shift);
    shown_as_it_is("free", &friction::collision(0.3), DVec3::ZERO);
    let keys = "motion = \"driven\"\nkeys = [[0.0, 0.4, 0.1, -0.2, 0.1, 0.2, 0.3, 0.9273618495495703], \
                [0.2, 0.42, 0.1, -0.2, 0.1, 0.2, 0.3, 0.9273618495495703]]";
    // In this scene nothing can touch, so a step has no stage `skin` with arrays that the drawing could share.
    let chain = joints::chain(2e4, keys, ["", "stiffness = 0.5"], "gravity = [5.0, -25.0, 8.0]");
    shown_as_it_is("a chain", &chain, DVec3::new(0.4, 0.1, -0.2));
}

#[test]
fn what_is_shown_can_be_given_to_other_programs() {
    let mut simulation = open(&scene(&press(2e4, 1e-3, Place::default(), "")), None);
    let shares = simulation.context().shares_memory();
    let skins = simulation.skins(DVec3::ZERO).unwrap();
    assert!(skins.positions.raw() != 0 && skins.positions.raw() != skins.normals.raw());
    match shares {
        true => {
            let (descriptor, bytes) = skins.positions.export().unwrap();
            assert!(descriptor >= 0 && bytes >= skins.positions.bytes());
            close(descriptor);
        }
        false => assert!(skins.positions.export().unwrap_err().to_string().contains("VK_KHR_external_memory_fd")),
    }
    assert!(skins.triangles.export().is_err(), "the array of triangles was not made for export");
    let messages = simulation.context().validation_messages();
    assert!(messages.is_empty(), "{messages:#?}");
}

/// Takes ownership of a file descriptor, and thereby closes it.
#[allow(unsafe_code)]
fn close(descriptor: i32) {
    use std::os::fd::{FromRawFd, OwnedFd};
    // SAFETY: the descriptor was given to this test alone.
    drop(unsafe { OwnedFd::from_raw_fd(descriptor) });
}
