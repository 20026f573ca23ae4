//! Kernel depth/ray_hits, which finds the triangles that the rays of skin vertices meet, must leave out triangles that
//! no ray can reach. The rays of a contact patch start at skin vertices, and a grid over the patch stores for each cell
//! the height of that start from which a ray reaches most. Such a triangle lies behind the starts of all rays in each
//! cell that it covers.

use std::collections::BTreeSet;

use glam::DVec3;
use palpate::internal::shaders::NONE;
use palpate_oracle::contact_patches::along;

use crate::harness::random::Random;
use crate::stage::ray_hits::{axes, bumpy, contact_patch, is_hit, meshes, search_depth_key, wide};

#[test]
fn triangles_that_no_vertex_looks_as_far_back_as_are_left_out() {
    let mut random = Random(67);
    let (mesh, over) = bumpy(&mut random);
    let points = (over, vec![]);
    let contact_patch = contact_patch(DVec3::Z, 1.0, 0.1);
    let run = |key: u32| {
        let mut flow = meshes([&points, &mesh], &[contact_patch]);
        flow.embed();
        // The grid is set as if body a's vertices cast their rays down from the height of `key`, in the first cell
        // alone.
        let first = flow.bucket_count as usize;
        flow.buckets[first..first + 256].fill(NONE);
        flow.buckets[first] = key;
        flow.cross();
        assert_eq!(flow.counts.flags, 0);
        let found: BTreeSet<u32> = is_hit(&flow).values().flat_map(|list| list.keys().copied()).collect();
        let meets = |t: &u32| {
            let at = flow.model.triangles[*t as usize];
            let corners = [0, 1, 2].map(|k| wide(flow.skin[at[k] as usize][..3].try_into().unwrap()));
            let at = corners.map(|x| along(axes(&contact_patch), x));
            at[0].min(at[1]).min(at[2]).truncate().max_element() < -1.0 + 2.0 / 16.0 + 1e-3
        };
        assert!(found.iter().all(meets));
        found.len()
    };
    // The mesh reaches up to a height of 1/8 m: rays from 0.5 m may hit all of the mesh, rays from -0.2 m hit nothing.
    let found = run(search_depth_key(0, 0.5));
    assert!(found > 0 && found < mesh.1.len() / 50, "{found} triangles of {} are hit", mesh.1.len());
    assert_eq!(run(search_depth_key(0, -0.2)), 0);
}
