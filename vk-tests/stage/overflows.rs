//! Tests of the kernels depth/ray_hits and contact/candidates where results are incomplete: there are more ray hits
//! than the buffers hold, or a driver leaves loops early. If anything is missing, a flag must be raised. A ray hit is a
//! triangle that the ray of a skin vertex of the other body meets. Work items (chunks of skin vertices in a contact
//! patch, which is a place where two bodies may touch) that cannot hit anything are tested too.

use std::collections::BTreeMap;

use glam::{DQuat, DVec3};
use palpate::Query;
use palpate::internal::query::QuerySettings;
use palpate::internal::shaders::ContactPatch;
use palpate::internal::stages::depth::Path;

use crate::harness::bodies::{Mesh, rigid, sphere, whole};
use crate::harness::random::Random;
use crate::harness::{assert_clean, context};
use crate::stage::flow::Flow;
use crate::stage::ray_hits::{bumpy, contact_patch, is_hit, meshes};

/// The flag that some ray hits or contacts are missing.
const CONTACT_OVERFLOW: u32 = 4;

/// Runs depth/ray_hits with room for `ray_hits` hits: either all are found, or a flag says that some are missing.
fn found_or_flagged(what: &str, mut flow: Flow, ray_hits: usize) {
    flow.most_hits = ray_hits;
    flow.embed();
    flow.cross();
    let found: usize = is_hit(&flow).values().map(BTreeMap::len).sum();
    println!("{what}: {found} ray hits found, room for {ray_hits}; flags {}", flow.counts.flags);
    let flags = if found < ray_hits { CONTACT_OVERFLOW } else { 0 };
    assert_eq!(
        (found, flow.counts.flags),
        (flow.counts.hits as usize, flags),
        "{what}: number of ray hits on the lists, and flags"
    );
}

#[test]
fn what_a_driver_leaves_out_of_long_loops_is_flagged() {
    let mut random = Random(67);
    let axes =
        ContactPatch { tangent: [1.0, 0.0, 0.0], bitangent: [0.0, 1.0, 0.0], ..contact_patch(DVec3::Z, 1.0, 0.25) };
    // The grid has eight rows of eight cells, and each row has a triangle. Row r has a pile of vertices in its cell r:
    // the lanes of a workgroup, each of which takes a row, come to the piles one after another, and each lane to one
    // pile only.
    let at = |k: usize| -0.875 + 0.25 * k as f64;
    let rows = (0..8).flat_map(|r| {
        let across = DVec3::new(0.999, at(r), 0.0);
        [DVec3::new(-0.999, at(r), 0.0), across - 0.1 * DVec3::Y, across + 0.1 * DVec3::Y]
    });
    let rows: Mesh = (rows.collect(), (0..8).map(|r| [3 * r, 3 * r + 1, 3 * r + 2]).collect());
    for (piles, each) in [(8, 100), (8, 7_000), (8, 9_000), (2, 40_000), (1, 65_500), (1, 70_000)] {
        let place = |k: usize| DVec3::new(at(k % piles), at(k % piles), 0.5) + 0.002 * random.vector();
        let points: Mesh = ((0..piles * each).map(place).collect(), vec![]);
        found_or_flagged(&format!("{piles} piles of {each} vertices"), meshes([&points, &rows], &[axes]), piles * each);
    }
    // Now each triangle covers all cells of a fine grid.
    for layers in [10, 100] {
        let points: Mesh =
            ((0..200).map(|_| random.vector() * DVec3::new(0.4, 0.4, 0.0) + 0.5 * DVec3::Z).collect(), vec![]);
        let layer =
            |k: u32| [(-3.0, -1.0), (3.0, -1.0), (0.0, 3.0)].map(|(x, y)| DVec3::new(x, y, -f64::from(k) / 100.0));
        let sheets: Mesh =
            ((0..layers).flat_map(layer).collect(), (0..layers).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect());
        let fine = ContactPatch { cells_per_metre: [64.0; 2], ..axes };
        found_or_flagged(&format!("{layers} sheets"), meshes([&points, &sheets], &[fine]), 200 * layers as usize);
    }
}

#[test]
fn more_crossings_than_fit_are_flagged() {
    let mut random = Random(65);
    let (mesh, over) = bumpy(&mut random);
    let mut flow = meshes([&(over, vec![]), &mesh], &[contact_patch(DVec3::Z, 1.0, 0.1)]);
    flow.embed();
    flow.cross();
    let all = flow.counts.hits;
    for (most, flags) in [(all as usize, 0), (all as usize - 1, CONTACT_OVERFLOW), (100, CONTACT_OVERFLOW)] {
        flow.most_hits = most;
        flow.counts = Default::default();
        flow.embed();
        flow.cross();
        assert_eq!((flow.counts.hits, flow.counts.flags), (all, flags));
        let listed: usize = is_hit(&flow).values().map(BTreeMap::len).sum();
        assert_eq!(listed, most.min(all as usize), "number of listed ray hits: all that fit");
    }
}

#[test]
fn more_crossings_than_fit_are_flagged_on_both_paths() {
    let ball = rigid("ball", sphere(1.0, 5), whole, DVec3::ZERO, DQuat::IDENTITY);
    for (layers, flags) in [(4, 0), (120, CONTACT_OVERFLOW)] {
        // The layers are one large triangle each, above one another through the ball's height.
        let layer = |k: u32| {
            let height = 1.8 * (f64::from(k) + 0.5) / f64::from(layers) - 0.9;
            [(-3.0, -1.5), (3.0, -1.5), (0.0, 4.0)].map(|(x, y)| DVec3::new(x, y, height))
        };
        let mesh =
            ((0..layers).flat_map(layer).collect(), (0..layers).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect());
        let pile = rigid("pile", mesh, whole, DVec3::ZERO, DQuat::IDENTITY);
        for path in [Path::Compute, Path::Graphics] {
            let settings =
                QuerySettings { direction: Some(DVec3::Z), depth: Some(path), ..QuerySettings::of(&ball, &pile) };
            let mut query = Query::on_device(context(), &ball, &pile, &settings).unwrap();
            let answer = query.run((DVec3::ZERO, DQuat::IDENTITY), (DVec3::ZERO, DQuat::IDENTITY)).unwrap();
            println!("{} path, {layers} layers: {} hits, flags {:?}", path.name(), answer.counts.hits, answer.flags);
            assert_eq!(
                answer.flags.0 & CONTACT_OVERFLOW,
                flags,
                "{} path, {layers} layers: flag that ray hits are missing",
                path.name()
            );
            assert!(answer.counts.hits > 1000);
        }
    }
    assert_clean(context(), "more ray hits than fit");
}

#[test]
fn items_of_half_spaces_cross_nothing() {
    let mut random = Random(68);
    let (mesh, over) = bumpy(&mut random);
    let mut flow = meshes([&(over, vec![]), &mesh], &[contact_patch(DVec3::Z, 1.0, 0.1)]);
    flow.embed();
    // The pair becomes one with a plane only now, so the spatial hash holds vertices, as if another pair had left them.
    flow.pairs[0].is_plane = 1;
    flow.cross();
    assert_eq!(flow.counts.hits, 0);
    flow.pairs[0].is_plane = 0;
    flow.cross();
    assert!(flow.counts.hits > 0);
}
