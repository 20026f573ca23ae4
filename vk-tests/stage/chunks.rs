//! Tests of kernel cull/chunks, which finds the box of each chunk (group of at most 64 skin vertices) along the axes of
//! a contact patch (place where a pair of bodies may touch along one normal) and writes the min-max depth grid (how far
//! each body reaches along the normal, over 16 x 16 cells of the patch), and of kernel cull/meet, which lists the
//! chunks that may reach the other body. No chunk that may touch may be lost, and chunks that cannot touch must be left
//! out. A pair proxy is a collision proxy (convex hull) in a pair of bodies; a side is body a or b of the pair; a work
//! item is a chunk in a patch. The oracle is the f64 reference implementation.

use glam::{DMat3, DQuat, DVec3};
use palpate::internal::gpu::Size;
use palpate::internal::shaders;
use palpate::internal::shaders::{ActiveChunk, ContactPatch, Counts, NONE, Pair, PairProxy, Proxy};
use palpate::internal::stages::ARGS_WORDS;
use palpate::internal::stages::PAIR_PATCHES;
use palpate_oracle::contact_patches::{along, chunk_box};

use crate::harness::bodies::{octants, rigid, soft, sphere, whole};
use crate::harness::random::Random;
use crate::harness::{case, context};
use crate::stage::flow::{Flow, GRID_WORDS};
use crate::stage::skin::covered;

/// Greatest distance by which a box may exceed the oracle's box, m, for positions of half a metre. The kernel enlarges
/// a box by 1.5 micrometres and by a thousandth of the spread of the displacements in the chunk; the box at rest is
/// rounded to f32.
const BOX: f64 = 4e-6;
/// Number of cells of the min-max depth grid along each tangent.
const GRID: usize = 16;

fn wide(x: &[f32]) -> DVec3 {
    DVec3::new(x[0].into(), x[1].into(), x[2].into())
}

fn axes(contact_patch: &ContactPatch) -> [DVec3; 3] {
    [wide(&contact_patch.tangent), wide(&contact_patch.bitangent), wide(&contact_patch.normal)]
}

/// A contact patch along a normal, over the square from -`half` to `half` (m) along both tangents.
fn contact_patch(normal: DVec3, half: f32) -> ContactPatch {
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    let [normal, tangent, bitangent] = [normal, tangent, bitangent].map(|axis| axis.as_vec3().to_array());
    ContactPatch {
        normal,
        tangent,
        bitangent,
        low: [-half; 2],
        high: [half; 2],
        weight: 1.0,
        ..ContactPatch::default()
    }
}

/// Two soft balls whose nodes are displaced by up to `size` (m) along each axis. Every pair proxy takes part in each
/// patch, and the boxes of pair proxies are so large that all chunks may meet the other side.
fn shaken(size: f64, contact_patches: &[ContactPatch], random: &mut Random) -> Flow {
    let mut place = || (0.1 * random.vector(), random.turn(3.0));
    let ((x, q), (y, p)) = (place(), place());
    let balls = [soft("a", sphere(0.1, 4), octants, x, q), soft("b", sphere(0.1, 4), octants, y, p)];
    let mut flow = Flow::new(&balls, None, DVec3::ZERO);
    for d in &mut flow.displacement {
        *d = (size * random.vector()).as_vec3().extend(0.0).to_array();
    }
    flow.contact_patches = contact_patches.to_vec();
    flow.contact_patches.resize(PAIR_PATCHES, ContactPatch::default());
    let pair_proxies = flow.model.pair_proxies.len();
    flow.proxy_patches = vec![(1 << contact_patches.len()) - 1; pair_proxies];
    flow.boxes = vec![[[-9.0; 3], [9.0; 3]]; PAIR_PATCHES * pair_proxies];
    flow.active_pair_proxies = (0..pair_proxies as u32).rev().collect();
    flow.pair_proxy_counts = vec![[0; 2]; pair_proxies];
    flow.depth_grids = (0..PAIR_PATCHES * GRID_WORDS).map(|k| if k / 256 % 2 == 0 { 0 } else { NONE }).collect();
    flow.args[3 * shaders::ARGS_CHUNKS as usize] = pair_proxies as u32;
    flow
}

/// World positions of a chunk's skin vertices, in f64.
fn places(flow: &Flow, chunk: usize, frame: usize) -> Vec<DVec3> {
    let frame = &flow.frames[frame];
    let rotation = DQuat::from_array(frame.rotation.map(f64::from)).normalize();
    let place = |v: u32| {
        let nodes = flow.model.skin_nodes[v as usize].map(|n| n as usize);
        let local: DVec3 = (0..4)
            .map(|k| {
                let x = wide(&flow.model.node_rest[nodes[k]]) + wide(&flow.displacement[nodes[k]]);
                f64::from(flow.model.skin_weights[v as usize][k]) * x
            })
            .sum();
        wide(&frame.centre) + rotation * local
    };
    covered(&flow.model, &flow.model.chunks[chunk]).into_iter().map(place).collect()
}

/// The oracle's box of a chunk along a patch's axes.
fn boxed(flow: &Flow, chunk: usize, frame: usize, contact_patch: &ContactPatch) -> (DVec3, DVec3) {
    let (chunk, frame) = (&flow.model.chunks[chunk], &flow.frames[frame]);
    let rotation = DQuat::from_array(frame.rotation.map(f64::from)).normalize();
    let nodes = &flow.model.chunk_nodes[chunk.node_first as usize..][..chunk.node_count as usize];
    let moved: Vec<DVec3> = nodes.iter().map(|[n, _]| wide(&flow.displacement[*n as usize])).collect();
    let [u, v] = chunk.axes.map(|axis| wide(&axis));
    let rest = (wide(&chunk.centre), DMat3::from_cols(u, v, u.cross(v)), wide(&chunk.half_extent));
    chunk_box(rest, (&moved, f64::from(chunk.weight_bound)), (wide(&frame.centre), rotation), axes(contact_patch))
}

/// The height that a sortable key stands for: the inverse of `height_key` in shared/depth_grid.glsl.
fn height_of(key: u32) -> f64 {
    f64::from(f32::from_bits(if key & 0x8000_0000 != 0 { key & 0x7fff_ffff } else { !key }))
}

/// The cell of a patch's min-max depth grid that a place projects to.
fn grid_cell_of(contact_patch: &ContactPatch, at: DVec3) -> [usize; 2] {
    [0, 1].map(|k| {
        let size = f64::from(contact_patch.high[k] - contact_patch.low[k]) / GRID as f64;
        (((at[k] - f64::from(contact_patch.low[k])) / size).max(0.0) as usize).min(GRID - 1)
    })
}

/// Checks that each chunk's slab (its box in a patch, with a plane that no vertex passes) holds the chunk's vertices
/// and agrees with the oracle's box, and that the min-max depth grid lies beyond the vertices. Returns the number of
/// slabs.
fn check_slabs(flow: &Flow, contact_patches: usize, tight: bool) -> usize {
    let mut count = 0;
    for pair_proxy in &flow.model.pair_proxies {
        let proxy = &flow.model.proxies[pair_proxy.proxy as usize];
        for k in 0..proxy.chunk_count as usize {
            let (at, index) = (pair_proxy.chunk_first as usize + k, proxy.chunk_first as usize + k);
            assert_eq!(
                flow.pair_proxy_chunks[at],
                [(1 << contact_patches) - 1, 0],
                "chunk {index} must meet all contact patches"
            );
            let skin = places(flow, index, proxy.frame as usize);
            for (r, contact_patch) in flow.contact_patches[..contact_patches].iter().enumerate() {
                let want = boxed(flow, index, proxy.frame as usize, contact_patch);
                let slab = flow.slabs[at * PAIR_PATCHES + r].map(f64::from);
                let side = if pair_proxy.side == 0 { 1.0 } else { -1.0 };
                let extreme = if pair_proxy.side == 0 { want.1.z } else { want.0.z };
                let errors = [slab[0] - want.0.x, slab[1] - want.0.y, want.1.x - slab[2], want.1.y - slab[3]];
                let allowed = BOX + 2e-3 * (want.1 - want.0).max_element();
                assert!(
                    errors.iter().all(|e| *e < 0.0 && -*e < allowed),
                    "chunk {index}: differences of its box from the oracle's box, m: {errors:?}"
                );
                let beyond = side * (slab[7] - extreme);
                assert!(
                    beyond > 0.0 && beyond < allowed,
                    "chunk {index}: its extreme height is {beyond} m beyond the oracle's"
                );
                let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
                for x in &skin {
                    let x = along(axes(contact_patch), *x);
                    (low, high) = (low.min(x), high.max(x));
                    let plane = slab[4] * x.x + slab[5] * x.y + slab[6];
                    assert!(
                        side * (plane - x.z) > 0.0,
                        "a vertex of chunk {index} passes the plane of the chunk's slab by {} m",
                        side * (x.z - plane)
                    );
                    assert!(side * (slab[7] - x.z) > 0.0, "a vertex of chunk {index} leaves the box");
                    let [i, j] = grid_cell_of(contact_patch, x);
                    let grid = flow.depth_grids[(2 * r + pair_proxy.side as usize) * 256 + j * GRID + i];
                    assert!(side * (height_of(grid) - x.z) > 0.0, "a vertex of chunk {index} passes the depth grid");
                }
                // Along the patch's axes, a box that is inclined to them is less than twice as large as the skin in the
                // box.
                let (own, skins) = (want.1 - want.0, high - low);
                assert!(
                    !tight || own.max_element() < 1.8 * skins.max_element() + BOX,
                    "box of chunk {index} with edges of {own} m, for skin with an extent of {skins} m"
                );
                count += 1;
            }
        }
    }
    count
}

#[test]
fn no_skin_leaves_its_chunk_s_slab_or_passes_the_field() {
    let mut random = Random(81);
    for size in [0.0, 0.003, 0.03] {
        for count in [1, PAIR_PATCHES] {
            let contact_patches: Vec<ContactPatch> =
                (0..count).map(|_| contact_patch(random.vector().normalize(), 0.5)).collect();
            let mut flow = shaken(size, &contact_patches, &mut random);
            flow.box_chunks();
            assert!(check_slabs(&flow, count, size == 0.0) > 30 * count);
        }
    }
}

#[test]
fn chunks_beside_the_column_or_in_front_of_all_boxes_are_left_out() {
    let mut random = Random(82);
    let mut flow = shaken(0.003, &[contact_patch(DVec3::Z, 0.05)], &mut random);
    // All pair proxies of body a have boxes between heights of 0 and 0.1 m. Of body b only the first pair proxy takes
    // part; its box begins at a height of 0.02 m.
    let pair_proxies = flow.model.pair_proxies.clone();
    for (pair_proxy, given) in pair_proxies.iter().zip(flow.boxes.chunks_mut(PAIR_PATCHES)) {
        let (low, high) = if pair_proxy.side == 0 { (0.0, 0.1) } else { (0.02, 9.0) };
        given.fill([[-0.04, -9.0, low], [0.04, 9.0, high]]);
    }
    let first_b = pair_proxies.iter().position(|pair_proxy| pair_proxy.side == 1).unwrap();
    flow.proxy_patches[first_b + 1..].fill(0);
    flow.box_chunks();
    let (mut kept, mut left) = ([0; 2], [0; 2]);
    for (s, pair_proxy) in pair_proxies.iter().enumerate() {
        let proxy = flow.model.proxies[pair_proxy.proxy as usize];
        for k in 0..proxy.chunk_count as usize {
            let skin = places(&flow, proxy.chunk_first as usize + k, proxy.frame as usize);
            let skin: Vec<DVec3> = skin.iter().map(|x| along(axes(&flow.contact_patches[0]), *x)).collect();
            let low = skin.iter().fold(DVec3::INFINITY, |low, x| low.min(*x));
            let high = skin.iter().fold(DVec3::NEG_INFINITY, |high, x| high.max(*x));
            let beside = low.x > 0.04 || high.x < -0.04 || low.y > 0.05 || high.y < -0.05;
            let in_front = if pair_proxy.side == 0 { high.z < 0.02 } else { low.z > 0.1 };
            let found = flow.pair_proxy_chunks[pair_proxy.chunk_first as usize + k][0];
            let is_open = flow.proxy_patches[s] != 0;
            assert!(is_open || found == 0);
            // Each chunk that might touch must be kept.
            assert!(
                !is_open || beside || in_front || found == 1,
                "pair proxy {s}, chunk {k} may touch but is left out: box from {low} to {high} m"
            );
            let side = pair_proxy.side as usize;
            kept[side] += usize::from(found == 1);
            left[side] += usize::from(is_open && found == 0);
        }
    }
    assert!(
        kept.iter().chain(&left).all(|n| *n > 0),
        "numbers of chunks of bodies a and b: {kept:?} kept, {left:?} left out"
    );
}

#[test]
fn a_half_space_keeps_the_chunks_that_reach_below_it() {
    let mut random = Random(83);
    let mut flow = shaken(0.003, &[contact_patch(-DVec3::Y, 0.5)], &mut random);
    flow.pairs[0] = Pair { is_plane: 1, plane: [0.0, 1.0, 0.0, 0.01], ..flow.pairs[0] };
    let a = flow.pairs[0].proxy_count[0] as usize;
    flow.active_pair_proxies.retain(|pair_proxy| (*pair_proxy as usize) < a);
    flow.args[3 * shaders::ARGS_CHUNKS as usize] = a as u32;
    flow.box_chunks();
    flow.meet();
    let mut totals = [0; 2];
    for pair_proxy in 0..a {
        let proxy = flow.model.proxies[flow.model.pair_proxies[pair_proxy].proxy as usize];
        let lowest = |k: u32| {
            let skin = places(&flow, (proxy.chunk_first + k) as usize, proxy.frame as usize);
            skin.iter().map(|x| x.y).fold(f64::INFINITY, f64::min)
        };
        let below = (0..proxy.chunk_count).filter(|k| lowest(*k) <= 0.01).count() as u32;
        // Apart from rounding, a chunk is kept exactly if its box reaches below the plane.
        let may = |slack: f64| {
            let top = |k: &u32| {
                boxed(&flow, (proxy.chunk_first + k) as usize, proxy.frame as usize, &flow.contact_patches[0]).1.z
            };
            (0..proxy.chunk_count).filter(|k| top(k) >= -0.01 + slack).count() as u32
        };
        let listed = flow.active_chunks[..flow.counts.chunks as usize]
            .iter()
            .filter(|entry| entry.pair_proxy as usize == pair_proxy);
        let (chunks, work_items) =
            listed.fold((0, 0), |(n, work_items), entry| (n + 1, work_items + entry.contact_patches.count_ones()));
        assert!(
            chunks == work_items && chunks >= below && chunks >= may(0.0) && chunks <= may(-1e-3),
            "{chunks} chunks are kept; the skin of {below} chunks reaches below the plane"
        );
        totals = [totals[0] + chunks, totals[1] + proxy.chunk_count];
    }
    assert!(totals[0] > 0 && totals[0] < totals[1], "number of chunks kept, and number of all chunks: {totals:?}");
}

/// Kernel cull/meet on chunks of three pair proxies with random flat slabs, against random min-max depth grids.
#[test]
fn chunks_meet_where_some_square_of_the_other_side_reaches_them() {
    let mut random = Random(84);
    let width = context().reduce_size();
    for count in [0, 1, width - 1, width, width + 1, 333] {
        let pair_proxies: Vec<PairProxy> = (0..3)
            .map(|s| PairProxy { side: s % 2, proxy: s, chunk_first: s * count, ..PairProxy::default() })
            .collect();
        let proxy = |s: u32| Proxy { chunk_first: 1000 * s, chunk_count: count, ..Proxy::default() };
        let contact_patches: Vec<ContactPatch> = (0..PAIR_PATCHES).map(|_| contact_patch(DVec3::Z, 1.0)).collect();
        let mut height = |share: f64| (random.next() + share) as f32;
        let key = |x: f32| if x.is_sign_negative() { !x.to_bits() } else { x.to_bits() | 0x8000_0000 };
        // The grid's heights are random: for body a between -1.6 and 0.4 m, for body b between -0.4 and 1.6 m.
        let depth_grids: Vec<f32> =
            (0..PAIR_PATCHES * GRID_WORDS).map(|k| if k / 256 % 2 == 0 { height(-0.6) } else { height(0.6) }).collect();
        let slab = |height: &mut dyn FnMut(f64) -> f32| {
            let (u, v, z) = (height(-0.1), height(-0.1), height(0.0));
            [u, v, u + 0.2, v + 0.1, 0.0, 0.0, z, z]
        };
        let slabs: Vec<[f32; 8]> = (0..PAIR_PATCHES * 3 * count as usize).map(|_| slab(&mut height)).collect();
        let masks: Vec<u32> = (0..3 * count).map(|k| (k * 7 + 3) % 16).collect();
        let out = case("cull/meet")
            .size(Size::Reduce)
            .constant("PAIR_PROXIES", 3u32)
            .constant("MAX_WORK_ITEMS", 12 * count.max(1))
            .constant("GATHERING", 3u32)
            .input("pairs", &[Pair::default()])
            .input("pair_proxies", &pair_proxies)
            .input("active_pair_proxies", &[2u32, 0, 1])
            .input("proxies", &[proxy(0), proxy(1), proxy(2)])
            .input("contact_patches", &contact_patches)
            .input("slabs", &crate::stage::flow::some(&slabs))
            .input("depth_grids", &depth_grids.iter().map(|x| key(*x)).collect::<Vec<_>>())
            .inout("pair_proxy_chunks", &masks.iter().map(|m| [*m, 0]).collect::<Vec<_>>())
            .inout("pair_proxy_counts", &[[9u32; 2]; 3])
            .partial("active_chunks", &vec![ActiveChunk::default(); 12 * count.max(1) as usize])
            .partial("work_items", &vec![[NONE; 2]; 12 * count.max(1) as usize])
            .inout("counts", &[Counts::default()])
            .partial("args", &vec![7u32; ARGS_WORDS])
            .groups(3)
            .run();
        let meets = |side: usize, r: usize, slab: &[f32; 8]| {
            let square = |x: f32| (((x + 1.0) * 8.0).clamp(0.0, 15.0)) as usize;
            let mut squares = (square(slab[1])..=square(slab[3]))
                .flat_map(|y| (square(slab[0])..=square(slab[2])).map(move |x| (x, y)));
            squares.any(|(x, y)| {
                let other = depth_grids[(2 * r + 1 - side) * 256 + y * GRID + x];
                if side == 0 { slab[7] >= other } else { slab[7] <= other }
            })
        };
        let count_of = out.get::<Counts>("counts")[0];
        let mut totals: Vec<[u32; 2]> = out.get("pair_proxy_counts");
        totals.push([count_of.chunks, count_of.work_items]);
        let counts: Vec<[u32; 2]> = totals.windows(2).map(|t| [t[1][0] - t[0][0], t[1][1] - t[0][1]]).collect();
        let listed: Vec<[u32; 2]> = out.get("pair_proxy_chunks");
        let mut dropped = 0;
        for (s, pair_proxy) in pair_proxies.iter().enumerate() {
            let (mut want, mut work_items) = (vec![], 0);
            for k in 0..count {
                let at = (pair_proxy.chunk_first + k) as usize;
                let stays =
                    (0..PAIR_PATCHES).filter(|r| meets(pair_proxy.side as usize, *r, &slabs[at * PAIR_PATCHES + r]));
                let mask = masks[at] & stays.map(|r| 1 << r).sum::<u32>();
                dropped += (masks[at] ^ mask).count_ones();
                if mask != 0 {
                    want.push([1000 * pair_proxy.proxy + k, mask | work_items << PAIR_PATCHES]);
                    work_items += mask.count_ones();
                }
            }
            assert_eq!(
                counts[s],
                [want.len() as u32, work_items],
                "{count} chunks, pair proxy {s}: numbers of chunks and of work items"
            );
            assert_eq!(
                listed[pair_proxy.chunk_first as usize..][..want.len()],
                want,
                "{count} chunks, pair proxy {s}: listed chunks"
            );
        }
        assert!(
            count < 300 || (dropped > 300 && counts[0][0] > 50),
            "{dropped} work items dropped; numbers of chunks and work items left, by pair proxy: {counts:?}"
        );
    }
}

/// A tool and a body, both spheres: every chunk with a colliding vertex or an opposing triangle must be active (pass
/// culling), and many other chunks must not be active.
#[test]
fn chunks_that_collide_are_active_and_those_far_away_are_not() {
    let mut random = Random(86);
    for cut in [whole, octants] {
        for gap in [1.95, 1.7] {
            let a = rigid("a", sphere(0.01, 5), cut, DVec3::ZERO, random.turn(3.0));
            let place = gap * 0.01 * random.vector().normalize();
            let tool = rigid("tool", sphere(0.01, 5), cut, place, random.turn(3.0));
            let mut flow = Flow::new(std::slice::from_ref(&a), Some(&tool), place);
            let normal = (place + 0.001 * random.vector()).normalize();
            flow.pairs[0].direction = normal.as_vec3().extend(1.0).to_array();
            flow.place();
            flow.cull();
            let normal = wide(&flow.contact_patches[0].normal);
            let (sides, firsts) = crate::scene::spheres::sides(&a, &tool, normal);
            let mut needed = std::collections::BTreeSet::new();
            let owner = |model: &palpate::internal::stages::model::Model, vertex: u32| {
                let owns = |chunk: &palpate::internal::shaders::Chunk| {
                    let own = &model.chunk_vertices[chunk.vertex_first as usize..][..chunk.vertex_count as usize];
                    own.contains(&vertex)
                };
                model.chunks.iter().position(owns).unwrap() as u32
            };
            let drawer = |model: &palpate::internal::stages::model::Model, triangle: u32| {
                let draws = |chunk: &palpate::internal::shaders::Chunk| {
                    let own = &model.chunk_triangles[chunk.triangle_first as usize..][..chunk.triangle_count as usize];
                    own.contains(&triangle)
                };
                model.chunks.iter().position(draws).unwrap() as u32
            };
            for (side, vertex, triangle) in sides {
                needed.insert(owner(&flow.model, vertex + firsts[side].0));
                needed.insert(drawer(&flow.model, triangle + firsts[1 - side].1));
            }
            let active: std::collections::BTreeSet<u32> =
                flow.active_chunks[..flow.counts.chunks as usize].iter().map(|entry| entry.chunk).collect();
            assert!(
                needed.len() > 2 && needed.is_subset(&active),
                "chunks {needed:?} are needed, {active:?} are active"
            );
            let share = active.len() as f64 / flow.model.chunks.len() as f64;
            println!(
                "sphere centres {gap} radii apart: {} chunks of {} are active, {} chunks are needed",
                active.len(),
                flow.model.chunks.len(),
                needed.len()
            );
            assert!(share < 0.6, "share of active chunks {share}");
        }
    }
}
