//! Tests of the kernels skin/embed, which puts skin vertices into a spatial hash in the plane of their contact patch
//! (place where a pair of bodies may touch along one normal), and depth/ray_hits, which finds the triangles that the
//! vertices' rays hit: every vertex that has a weight in a patch and lies in the patch's rectangle is in one list of
//! the hash, hits agree with f64, and no ray slips through at edges and corners. A hash entry is one vertex of a work
//! item (a chunk, that is a group of skin vertices and triangles, in a patch). A side is body a or b of the pair. The
//! min-max depth grid tells how far each side reaches along the normal, over 16 x 16 cells of a patch.

use std::collections::{BTreeMap, BTreeSet};

use glam::{DQuat, DVec3};
use palpate::internal::shaders;
use palpate::internal::shaders::{ActiveChunk, Chunk, ContactPatch, NONE, Pair, PairProxy};
use palpate::internal::stages::{CHUNK_TRIANGLES, CHUNK_VERTICES, PAIR_PATCHES};

use crate::harness::bodies::{Mesh, half_space, rigid, sheet, sphere, whole};
use crate::harness::context;
use crate::harness::random::Random;
use crate::stage::flow::{Flow, GRID_WORDS};

/// Barycentric weight, and depth in m, within which rounding may decide whether a ray hits a triangle.
const EDGE: f64 = 1e-6;

pub fn wide(x: [f32; 3]) -> DVec3 {
    DVec3::from_array(x.map(f64::from))
}

pub fn axes(contact_patch: &ContactPatch) -> [DVec3; 3] {
    [wide(contact_patch.tangent), wide(contact_patch.bitangent), wide(contact_patch.normal)]
}

/// Two rigid meshes, a's and b's, in chunks (fixed-size groups of vertices and triangles) that are all active in these
/// contact patches. The min-max depth grids exclude no vertex and no triangle.
pub fn meshes(sides: [&Mesh; 2], contact_patches: &[ContactPatch]) -> Flow {
    let ball = rigid("tool", sphere(1.0, 0), whole, DVec3::ZERO, DQuat::IDENTITY);
    let mut flow = Flow::new(&[half_space(DVec3::Y, 0.0)], Some(&ball), DVec3::ZERO);
    flow.frames[0].rotation = [0.0, 0.0, 0.0, 1.0];
    flow.pairs = vec![Pair { proxy_count: [1, 1], first_pair_proxy: [0, 1], ..Pair::default() }];
    flow.contact_patches = contact_patches.to_vec();
    flow.contact_patches.resize(PAIR_PATCHES, ContactPatch::default());
    let model = &mut flow.model;
    model.proxies.resize(2, model.proxies[0]);
    model.pair_proxies = (0..2).map(|side| PairProxy { side, proxy: side, ..PairProxy::default() }).collect();
    (model.skin_nodes, model.skin_weights, model.triangles) = (vec![], vec![], vec![]);
    (model.chunks, model.chunk_vertices, model.chunk_triangles) = (vec![], vec![], vec![]);
    flow.active_chunks = vec![];
    flow.work_items = vec![];
    let each = contact_patches.len() as u32;
    for (side, (vertices, triangles)) in sides.into_iter().enumerate() {
        let (vertex_first, triangle_first) = (model.skin_nodes.len() as u32, model.triangles.len() as u32);
        model.skin_nodes.extend(vertices.iter().map(|_| [NONE, 0, 0, 0]));
        model.skin_weights.extend(vertices.iter().map(|x| x.as_vec3().extend(0.0).to_array()));
        model.triangles.extend(triangles.iter().map(|t| {
            let [a, b, c] = t.map(|v| v + vertex_first);
            [a, b, c, 0]
        }));
        let parts = vertices.len().div_ceil(CHUNK_VERTICES).max(triangles.len().div_ceil(CHUNK_TRIANGLES));
        for part in 0..parts {
            let own = |count: usize, most: usize| (part * most).min(count)..((part + 1) * most).min(count);
            let (own, drawn) = (own(vertices.len(), CHUNK_VERTICES), own(triangles.len(), CHUNK_TRIANGLES));
            let index = flow.active_chunks.len() as u32;
            model.chunks.push(Chunk {
                vertex_first: model.chunk_vertices.len() as u32,
                vertex_count: own.len() as u32,
                embed_count: own.len() as u32,
                triangle_first: model.chunk_triangles.len() as u32,
                triangle_count: drawn.len() as u32,
                ..Chunk::default()
            });
            model.chunk_vertices.extend(own.map(|v| v as u32 + vertex_first));
            model.chunk_triangles.extend(drawn.map(|t| t as u32 + triangle_first));
            let first_work_item = flow.work_items.len() as u32;
            let (pair_proxy, contact_patches) = (side as u32, (1 << each) - 1);
            flow.active_chunks.push(ActiveChunk {
                chunk: index,
                pair_proxy,
                side: pair_proxy,
                contact_patches,
                first_work_item,
            });
            flow.work_items.extend((0..each).map(|r| [index, r]));
        }
    }
    flow.skin = vec![[0.0; 4]; flow.model.skin_nodes.len()];
    flow.max_work_items = flow.work_items.len();
    flow.shares = vec![0.5; 2 * PAIR_PATCHES];
    // According to the grids, body a reaches up without limit, and body b reaches down without limit.
    flow.depth_grids = (0..PAIR_PATCHES * GRID_WORDS).map(|k| if k / 256 % 2 == 0 { NONE } else { 0 }).collect();
    flow.args[3 * shaders::ARGS_ACTIVE as usize] = flow.active_chunks.len() as u32;
    flow.args[3 * shaders::ARGS_WORK_ITEMS as usize] = flow.work_items.len() as u32;
    flow
}

/// A contact patch along a normal, over a square of half edge `half` about the origin. `cell` is the edge of the hash
/// cells for vertices of a, m; those for b are larger.
pub fn contact_patch(normal: DVec3, half: f32, cell: f32) -> ContactPatch {
    let normal = normal.normalize();
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    let [normal, tangent, bitangent] = [normal, tangent, bitangent].map(|axis| axis.as_vec3().to_array());
    let (low, high) = ([-half; 2], [half; 2]);
    ContactPatch {
        normal,
        tangent,
        bitangent,
        low,
        high,
        cells_per_metre: [1.0 / cell, 1.0 / (1.7 * cell)],
        weight: 1.0,
        ..ContactPatch::default()
    }
}

/// For each hash entry its vertex and the number 2 * patch + side, computed from the chunks; `NONE` for unused entries.
fn hash_entries(flow: &Flow) -> Vec<(u32, u32)> {
    let mut hash_entries = vec![(NONE, NONE); flow.hash_entries.len()];
    for entry in flow.active_chunks.iter().take(flow.args[3 * shaders::ARGS_ACTIVE as usize] as usize) {
        let chunk = &flow.model.chunks[entry.chunk as usize];
        let listed = (0..PAIR_PATCHES as u32).filter(|r| entry.contact_patches >> r & 1 == 1);
        for (k, r) in listed.enumerate() {
            for l in 0..chunk.vertex_count as usize {
                let hash_entry = (entry.first_work_item as usize + k) * CHUNK_VERTICES + l;
                let vertex = flow.model.chunk_vertices[chunk.vertex_first as usize + l];
                hash_entries[hash_entry] = (vertex, 2 * r + entry.side);
            }
        }
    }
    hash_entries
}

/// Sortable key of the height from which a vertex of this side casts its ray; the ray with the least key reaches the
/// most triangles.
pub fn search_depth_key(side: usize, height: f32) -> u32 {
    let bits = height.to_bits();
    let key = if bits >> 31 == 1 { !bits } else { bits | 1 << 31 };
    if side == 0 { !key } else { key }
}

/// Compares the lists of all buckets with the hash entries that must be in the lists. Returns the number of hash
/// entries in lists.
fn check_hash_entries(flow: &Flow) -> usize {
    let known = hash_entries(flow);
    let mut listed = BTreeMap::new();
    for (bucket, first) in flow.buckets.iter().enumerate().take(flow.bucket_count as usize) {
        let mut hash_entry = *first;
        while hash_entry != NONE {
            assert!(listed.insert(hash_entry, bucket).is_none(), "hash entry {hash_entry} is in two lists");
            hash_entry = flow.hash_entries[hash_entry as usize][3];
        }
    }
    let (mut cells, mut search_depths) = (BTreeMap::new(), vec![NONE; flow.contact_patches.len() * GRID_WORDS]);
    for (hash_entry, (vertex, patch_side)) in known.iter().enumerate() {
        if *vertex == NONE {
            assert!(!listed.contains_key(&(hash_entry as u32)) && flow.entry_hits[hash_entry] == NONE - 1);
            continue;
        }
        assert_eq!(flow.entry_hits[hash_entry], NONE, "there must be no ray hit yet");
        let (r, side) = (*patch_side as usize / 2, *patch_side as usize % 2);
        let contact_patch = &flow.contact_patches[r];
        let x = flow.skin[*vertex as usize];
        let at = palpate_oracle::contact_patches::along(axes(contact_patch), wide([x[0], x[1], x[2]]));
        let depth = |k: usize| (at[k] - f64::from(contact_patch.low[k])).min(f64::from(contact_patch.high[k]) - at[k]);
        let within = depth(0).min(depth(1));
        let sees = flow.shares[side * PAIR_PATCHES + r] > 0.0;
        match listed.get(&(hash_entry as u32)) {
            None => assert!(!sees || within < EDGE, "vertex {vertex} must be in a list of contact patch {r}"),
            Some(bucket) => {
                assert!(sees && within > -EDGE, "vertex {vertex} must be in no list of contact patch {r}");
                let stored = [0, 1, 2].map(|k| f64::from(f32::from_bits(flow.hash_entries[hash_entry][k])));
                assert!(DVec3::from_array(stored).distance(at) < EDGE, "stored position {stored:?}, expected {at}");
                // Whatever the hash function is, vertices of one cell must lie in one bucket.
                let square = |k: usize| {
                    let (low, cells) = (contact_patch.low[k], contact_patch.cells_per_metre[side]);
                    ((f32::from_bits(flow.hash_entries[hash_entry][k]) - low) * cells).floor() as i32
                };
                let grid = |k: usize| {
                    let size = (contact_patch.high[k] - contact_patch.low[k]) / 16.0;
                    ((f32::from_bits(flow.hash_entries[hash_entry][k]) - contact_patch.low[k]) / size).clamp(0.0, 15.0)
                        as usize
                };
                let search_depth = &mut search_depths[*patch_side as usize * 256 + grid(1) * 16 + grid(0)];
                *search_depth =
                    (*search_depth).min(search_depth_key(side, f32::from_bits(flow.hash_entries[hash_entry][2])));
                let key = [*patch_side, (square(0) | square(1) << 16) as u32];
                assert_eq!(flow.entry_cells[hash_entry], key, "key of the cell of vertex {vertex}");
                let of_square = *cells.entry((*patch_side, square(0), square(1))).or_insert(*bucket);
                assert_eq!(of_square, *bucket, "vertex {vertex}: a cell must have a single bucket");
            }
        }
    }
    assert_eq!(
        flow.buckets[flow.bucket_count as usize..][..search_depths.len()],
        search_depths,
        "least sortable keys of rays, by cell"
    );
    let buckets: BTreeSet<_> = listed.values().collect();
    let (squares, lists) = (cells.len(), buckets.len());
    assert!(
        lists * 2 > squares.min(flow.bucket_count as usize),
        "{squares} cells have vertices, in {lists} lists: expected more than half of the cells, or of all buckets"
    );
    listed.len()
}

/// For each hash entry, the triangles that its ray hits, with depth and whether the front is hit.
pub fn is_hit(flow: &Flow) -> BTreeMap<usize, BTreeMap<u32, (f64, bool)>> {
    let mut all = BTreeMap::new();
    for (hash_entry, first) in flow.entry_hits.iter().enumerate().filter(|(_, first)| **first < NONE - 1) {
        let list: &mut BTreeMap<u32, (f64, bool)> = all.entry(hash_entry).or_default();
        let mut hit = *first;
        while hit != NONE {
            let [triangle, next, depth, what] = flow.ray_hits[hit as usize];
            let work_item = flow.work_items[what as usize >> 1];
            let chunk = &flow.model.chunks[flow.active_chunks[work_item[0] as usize].chunk as usize];
            let own = &flow.model.chunk_triangles[chunk.triangle_first as usize..][..chunk.triangle_count as usize];
            assert!(own.contains(&triangle), "triangle {triangle} is not in work item {}", what >> 1);
            let twice = list.insert(triangle, (f64::from(f32::from_bits(depth)), what & 1 == 1));
            assert!(twice.is_none(), "triangle {triangle} is twice on the ray of hash entry {hash_entry}");
            hit = next;
        }
    }
    all
}

/// Compares hits of every vertex's ray with every triangle of the other side with f64. Returns the number of hits.
fn check_ray_hits(flow: &Flow) -> usize {
    let (known, found) = (hash_entries(flow), is_hit(flow));
    let (mut count, nothing) = (0, BTreeMap::new());
    let chunks = flow.active_chunks.iter().flat_map(|entry| {
        let chunk = &flow.model.chunks[entry.chunk as usize];
        let own = &flow.model.chunk_triangles[chunk.triangle_first as usize..][..chunk.triangle_count as usize];
        own.iter().map(|t| (entry.side, *t))
    });
    let triangles: Vec<(u32, u32)> = chunks.collect();
    for (hash_entry, (vertex, patch_side)) in known.iter().enumerate().filter(|(_, known)| known.0 != NONE) {
        let list = found.get(&hash_entry).unwrap_or(&nothing);
        let side = patch_side % 2;
        if flow.shares[side as usize * PAIR_PATCHES + *patch_side as usize / 2] == 0.0 {
            assert!(list.is_empty());
            continue;
        }
        let contact_patch = &flow.contact_patches[*patch_side as usize / 2];
        let place = |v: u32| {
            let x = flow.skin[v as usize];
            palpate_oracle::contact_patches::along(axes(contact_patch), wide([x[0], x[1], x[2]]))
        };
        let x = place(*vertex);
        let seen = (0..2).all(|k| x[k] > f64::from(contact_patch.low[k]) && x[k] < f64::from(contact_patch.high[k]));
        for (_, triangle) in triangles.iter().filter(|(of, _)| *of != side) {
            let corners = flow.model.triangles[*triangle as usize];
            let [p, q, r] = [0, 1, 2].map(|k| place(corners[k]) - x);
            let twice = (q - p).truncate().perp_dot((r - p).truncate());
            let size = [q - p, r - q, p - r].iter().map(|e| e.truncate().length()).fold(0.0, f64::max);
            let weights = [q.truncate().perp_dot(r.truncate()), r.truncate().perp_dot(p.truncate())];
            let weights = [weights[0] / twice, weights[1] / twice, 1.0 - (weights[0] + weights[1]) / twice];
            let inside = weights.iter().copied().fold(f64::INFINITY, f64::min);
            let height = weights[0] * p.z + weights[1] * q.z + weights[2] * r.z;
            let (depth, front) = if side == 0 { (-height, twice < 0.0) } else { (height, twice > 0.0) };
            let got = list.get(triangle);
            // Rays nearer to an edge than rounding errors, and degenerate triangles, are not compared.
            let slack = EDGE * size / twice.abs() + EDGE;
            if !seen || slack.is_nan() || inside.abs() < slack || depth.abs() < EDGE + slack || slack > 0.1 {
                continue;
            }
            let want = inside > 0.0 && depth > 0.0;
            assert_eq!(
                got.is_some(),
                want,
                "whether the ray of vertex {vertex} hits triangle {triangle}: weights {weights:?}, depth {depth:e} m"
            );
            if let Some((found, is_front)) = got {
                assert!(
                    (found - depth).abs() < EDGE + slack * (p.z - q.z).abs().max((q.z - r.z).abs()),
                    "depth {found:e} m of a ray hit, expected {depth:e} m"
                );
                assert_eq!(*is_front, front, "vertex {vertex}, triangle {triangle}: whether the front is hit");
                count += 1;
            }
        }
    }
    count
}

/// Random vertices, and random triangles with edges of about `size` (m), within a box about the origin.
fn soup(vertices: usize, triangles: usize, size: f64, random: &mut Random) -> Mesh {
    let mut points: Vec<DVec3> = (0..vertices).map(|_| 0.5 * random.vector()).collect();
    let corners = (0..triangles as u32).map(|t| [0, 1, 2].map(|k| (vertices as u32) + 3 * t + k)).collect();
    for _ in 0..triangles {
        let at = 0.5 * random.vector();
        points.extend([(); 3].map(|()| at + size * random.vector()));
    }
    (points, corners)
}

#[test]
fn soups_of_triangles_cross_what_f64_says() {
    let mut random = Random(61);
    let width = context().reduce_size() as usize;
    // However many cells share a bucket, each hit must be found once. Wide workgroups get more buckets: a lane that walks
    // one list of all vertices for each of its triangle's cells would need more rounds than a loop may have.
    let few = (width as u32 / 16).next_power_of_two();
    let cases = [(1, 0.5, 1), (width - 1, 0.3, few), (width, 0.2, 2 * few), (65, 0.2, 64), (300, 0.1, 1 << 13)];
    for (n, size, buckets) in cases {
        let (a, b) = (soup(n, n, size, &mut random), soup(2 * n + 1, n, size, &mut random));
        for count in [1, 2, PAIR_PATCHES] {
            let contact_patches: Vec<ContactPatch> =
                (0..count).map(|_| contact_patch(random.vector(), 0.45, 0.07)).collect();
            let mut flow = meshes([&a, &b], &contact_patches);
            // Where there are several patches, the second one does not see a's vertices.
            if count > 1 {
                flow.shares[1] = 0.0;
            }
            flow.bucket_count = buckets;
            flow.embed();
            let listed = check_hash_entries(&flow);
            flow.cross();
            assert_eq!(flow.counts.flags, 0);
            let ray_hits = check_ray_hits(&flow);
            assert!(
                n < 65 || (listed > n && ray_hits > n),
                "{n} triangles: {listed} hash entries in lists, {ray_hits} ray hits"
            );
        }
    }
}

/// A bumpy sheet of triangles over the square from -1 to 1, and points exactly above its corners and the middles of its
/// edges and triangles; f32 holds all these numbers exactly.
pub fn bumpy(random: &mut Random) -> (Mesh, Vec<DVec3>) {
    let (mut points, triangles) = sheet(1.0, 16);
    points.iter_mut().for_each(|x| *x = DVec3::new(x.x, x.z, (64.0 * random.next()).round() / 512.0));
    let triangles: Vec<[u32; 3]> = triangles.into_iter().map(|[a, b, c]| [a, c, b]).collect();
    let mut over: Vec<DVec3> = points.clone();
    for t in &triangles {
        let [a, b, c] = t.map(|v| points[v as usize]);
        over.extend([(a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0, (a + b) / 4.0 + c / 2.0]);
    }
    over.iter_mut().for_each(|x| x.z = 0.5);
    ((points, triangles), over)
}

#[test]
fn rays_through_edges_and_corners_meet_a_triangle() {
    let mut random = Random(62);
    let (mesh, over) = bumpy(&mut random);
    let points = (over.clone(), vec![]);
    for cell in [0.013, 0.1, 1.0] {
        let up =
            ContactPatch { tangent: [1.0, 0.0, 0.0], bitangent: [0.0, 1.0, 0.0], ..contact_patch(DVec3::Z, 1.0, cell) };
        // Rays from points of a go down to the mesh of b; in the other case everything is mirrored in z, and rays from
        // points of b go up to the mesh of a.
        for turned in [false, true] {
            let flip = |mesh: &Mesh| (mesh.0.iter().map(|x| DVec3::new(x.x, x.y, -x.z)).collect(), mesh.1.clone());
            let mut flow = match turned {
                false => meshes([&points, &mesh], &[up]),
                true => meshes([&flip(&mesh), &flip(&points)], &[up]),
            };
            flow.embed();
            flow.cross();
            let found = is_hit(&flow);
            let side = u32::from(turned);
            let known = hash_entries(&flow);
            let looking = known.iter().enumerate().filter(|(_, known)| known.0 != NONE && known.1 == side);
            let slipped = looking.clone().filter(|(hash_entry, _)| !found.contains_key(hash_entry)).count();
            assert_eq!(
                (looking.count(), slipped),
                (over.len(), 0),
                "number of rays, and of rays without a hit; cells of {cell} m, mirrored: {turned}"
            );
        }
    }
}

#[test]
fn rays_next_to_edges_in_any_direction_meet_a_triangle() {
    let mut random = Random(63);
    let (mesh, over) = bumpy(&mut random);
    for _ in 0..3 {
        let turn = random.turn(3.0);
        let placed = (mesh.0.iter().map(|x| turn * *x).collect(), mesh.1.clone());
        // The points are so far from the sheet's rim that no inclined ray passes beside the sheet.
        let inner = over.iter().filter(|x| x.x.abs().max(x.y.abs()) < 0.8);
        let points: Mesh = (inner.map(|x| turn * DVec3::new(x.x, x.y, 0.2)).collect(), vec![]);
        let up = contact_patch(turn * (DVec3::Z + 0.1 * random.vector()), 2.0, 0.05);
        let mut flow = meshes([&points, &placed], &[up]);
        flow.embed();
        flow.cross();
        let found = is_hit(&flow);
        assert!((0..points.0.len()).all(|v| found.contains_key(&v)), "a ray slips through");
        assert!(check_ray_hits(&flow) > points.0.len() / 4);
    }
}

#[test]
fn triangles_without_area_cross_nothing_and_hide_nothing() {
    let mut random = Random(64);
    let (mut mesh, over) = bumpy(&mut random);
    let points = (over, vec![]);
    let up = contact_patch(DVec3::Z, 1.0, 0.1);
    let count = |mesh: &Mesh| {
        let mut flow = meshes([&points, mesh], &[up]);
        flow.embed();
        flow.cross();
        assert!(flow.ray_hits.iter().take(flow.counts.hits as usize).all(|h| f32::from_bits(h[2]).is_finite()));
        flow.counts.hits
    };
    let before = count(&mesh);
    // The mesh gets triangles with two or three corners in one place, and walls along the rays.
    let first = mesh.0.len() as u32;
    mesh.0.extend([DVec3::ZERO, DVec3::new(0.5, 0.5, 0.1), DVec3::new(0.5, 0.5, 0.3)]);
    mesh.1.extend(
        (0..100).map(|k| [[k, k, k], [k, k + 1, k], [k, first + 1, first + 2], [first, first, k]][k as usize % 4]),
    );
    assert_eq!(count(&mesh), before);
    assert!(before >= points.0.len() as u32);
}

#[test]
fn what_lies_in_front_of_all_that_the_other_side_reaches_is_left_out() {
    let mut random = Random(66);
    let (mesh, over) = bumpy(&mut random);
    let mut flow = meshes([&(over, vec![]), &mesh], &[contact_patch(DVec3::Z, 1.0, 0.1)]);
    // b's chunks reach down to a height of 0.75, above a's vertices, except in the first cell of the min-max depth
    // grid.
    let key = 0x8000_0000 | 0.75f32.to_bits();
    flow.depth_grids[256..512].fill(key);
    flow.depth_grids[256] = 0;
    flow.embed();
    let square = |x: &[f32; 4]| x[0] < -1.0 + 2.0 / 16.0 && x[1] < -1.0 + 2.0 / 16.0;
    let listed = flow.hash_entries.iter().filter(|hash_entry| hash_entry[3] != NONE - 1).count();
    let contact_patch = flow.contact_patches[0];
    // The lists hold all of b's vertices but of a's vertices only those in that cell, whichever way the patch's axes
    // lie.
    let first = flow.skin.iter().take(flow.skin.len() - mesh.0.len()).filter(|x| {
        let at = palpate_oracle::contact_patches::along(axes(&contact_patch), wide([x[0], x[1], x[2]])).as_vec3();
        square(&[at.x, at.y, 0.0, 0.0])
    });
    let inside = first.count();
    assert!(
        inside > 5 && listed == inside + mesh.0.len(),
        "{listed} vertices in lists, expected {inside} of a and {} of b",
        mesh.0.len()
    );
}
