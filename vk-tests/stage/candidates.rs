//! Tests of kernel contact/candidates, which decides for each candidate (vertex of a skin, that is a surface mesh)
//! whether it collides and how deep. The tests make up lists of ray hits (triangles of the other body that a vertex's
//! ray meets). The nearest hit on a vertex's ray decides, depths in several contact patches of a pair of bodies (places
//! where the pair may touch along one normal) are blended, and flags and pushes (depth times rest area times the normal
//! of what faces the contact around the vertex, from which the next step's contact normals are found) are written.
//! Results are compared with f64.

use glam::{DMat3, DVec3};
use palpate::internal::shaders;
use palpate::internal::shaders::{ActiveChunk, Chunk, ContactPatch, NONE, Pair};
use palpate::internal::stages::{CHUNK_VERTICES, PAIR_PATCHES};
use palpate_oracle::contact_patches;

use crate::harness::bodies::{half_space, rigid, sphere, whole};
use crate::harness::random::Random;
use crate::harness::{Tolerance, expect_close};
use crate::stage::flow::Flow;

/// Flags of a step, in this order: too many contacts or ray hits; a contact deeper than the limit; a skin that is not a
/// height field.
const CONTACT_OVERFLOW: u32 = 4;
const DEPTH_LIMIT: u32 = 8;
const NOT_HEIGHT_FIELD: u32 = 16;
/// Tolerance of depths and positions, m: positions of some centimetres in f32 are known to 4e-9 m, and triangles are
/// inclined by up to 45 degrees.
const DEPTH: f64 = 4e-8;
/// Relative tolerance of blended values: depths of at least 4 mm are known to 1e-5. A patch's strength, which is its
/// weight at the vertex divided by the squared depth, is known to 2e-5, and the smooth step that turns strengths into
/// blending weights has a slope of up to 3.
const BLENDED: f64 = 1e-4;
const FIRST_PROXY_PAIR: u32 = 10;

/// A ray hit: its depth, m, and whether it is on the front of a triangle.
type RayHit = (f64, bool);

/// A ray hit as the tests make it: triangle, depth (m), whether the front is hit, and index of the opposing pair proxy
/// (a collision proxy, or convex hull, in the pair of bodies).
type Made = (u32, f64, bool, u32);

/// Skin vertices of one side of the pair (0: body a, 1: body b) with the hits on their rays in each contact patch, and
/// the [`Flow`] (arrays of the proximity query) that holds them.
struct Given {
    side: u32,
    flow: Flow,
    /// Area vectors of the two triangles around each vertex.
    around: Vec<[DVec3; 2]>,
    /// Ray hits, by vertex and patch.
    is_hit: Vec<[Vec<Made>; PAIR_PATCHES]>,
}

fn narrow(x: DVec3) -> [f32; 4] {
    x.as_vec3().extend(1.0).to_array()
}

fn wide(x: &[f32]) -> DVec3 {
    DVec3::new(x[0].into(), x[1].into(), x[2].into())
}

impl Given {
    /// A pair of bodies with contact patches of these normals, and no vertices yet. The pair has two pair proxies of
    /// body a, then two of body b; vertices will lie in the second pair proxy of their side.
    fn new(side: u32, normals: &[DVec3]) -> Given {
        let ball = rigid("tool", sphere(1.0, 0), whole, DVec3::ZERO, glam::DQuat::IDENTITY);
        let mut flow = Flow::new(&[half_space(DVec3::Y, 0.0)], Some(&ball), DVec3::ZERO);
        let pair = Pair {
            proxy_count: [2, 2],
            first_pair_proxy: [0, 2],
            first_proxy_pair: FIRST_PROXY_PAIR,
            ..Pair::default()
        };
        flow.pairs = vec![pair];
        flow.contact_patches = vec![ContactPatch::default(); PAIR_PATCHES];
        for (contact_patch, normal) in flow.contact_patches.iter_mut().zip(normals) {
            let normal = normal.as_vec3().as_dvec3();
            let (tangent, bitangent) = normal.any_orthonormal_pair();
            [contact_patch.normal, contact_patch.tangent, contact_patch.bitangent] =
                [normal, tangent, bitangent].map(|axis| axis.as_vec3().to_array());
            contact_patch.weight = 1.0;
        }
        flow.shares = vec![1.0; 4 * PAIR_PATCHES];
        let model = &mut flow.model;
        (flow.skin, model.triangles, model.fan_first, model.fans, model.skin_areas) =
            (vec![], vec![], vec![0], vec![], vec![]);
        Given { side, flow, around: vec![], is_hit: vec![] }
    }

    /// Number of contact patches.
    fn contact_patches(&self) -> usize {
        self.flow.contact_patches.iter().filter(|contact_patch| contact_patch.weight > 0.0).count()
    }

    /// Adds a vertex in a triangle with this normal and in a smaller one at right angles to it, and makes the hits on its
    /// ray in each patch, in the order of `ray_hits`.
    fn add(&mut self, x: DVec3, outward: DVec3, ray_hits: &[Vec<RayHit>], random: &mut Random) {
        let model = &mut self.flow.model;
        let first = self.flow.skin.len() as u32;
        let (u, v) = outward.any_orthonormal_pair();
        let turned = if u.cross(v).dot(outward) > 0.0 { [u, v] } else { [v, u] };
        let corners = [x, x + 0.01 * turned[0], x + 0.01 * turned[1], x + 0.004 * outward];
        self.flow.skin.extend(corners.map(narrow));
        let corner = |k: u32| wide(&self.flow.skin[(first + k) as usize]) - wide(&self.flow.skin[first as usize]);
        self.around.push([corner(1).cross(corner(2)), corner(3).cross(corner(1))]);
        model.fans.extend([0, 1].map(|k| model.triangles.len() as u32 + k));
        model.fan_first.extend([model.fans.len() as u32; 4]);
        model.skin_areas.extend([1e-4 * (1.5 + random.next() as f32), 0.0, 0.0, 0.0]);
        model.triangles.extend([[first, first + 1, first + 2, 0], [first, first + 3, first + 1, 0]]);
        let mut is_hit: [Vec<_>; PAIR_PATCHES] = Default::default();
        for (r, list) in ray_hits.iter().enumerate() {
            for (depth, front) in list {
                let triangle = self.cross(wide(&self.flow.skin[first as usize]), r, *depth, random);
                let pair_proxy = if self.side == 0 { 2 } else { 0 } + random.below(2) as u32;
                is_hit[r].push((triangle, *depth, *front, pair_proxy));
            }
        }
        self.is_hit.push(is_hit);
    }

    /// Adds a triangle, inclined at random, that the vertex's ray hits at this depth.
    fn cross(&mut self, x: DVec3, r: usize, depth: f64, random: &mut Random) -> u32 {
        let contact_patch = &self.flow.contact_patches[r];
        let axes = [contact_patch.tangent, contact_patch.bitangent, contact_patch.normal]
            .map(|axis| DVec3::from_array(axis.map(f64::from)));
        let sign = if self.side == 0 { -1.0 } else { 1.0 };
        let at = x + sign * depth * axes[2];
        let mut corner = |turn: f64| {
            let (sin, cos) = (turn + 0.3 * random.next()).sin_cos();
            0.01 * (cos * axes[0] + sin * axes[1] + 0.7 * random.next() * axes[2])
        };
        let (p, q) = (corner(0.0), corner(2.0));
        let weights = [0.3, 0.3].map(|w| w + 0.1 * random.next());
        let last = 1.0 - weights[0] - weights[1];
        let third = -(weights[0] * p + weights[1] * q) / last;
        let first = self.flow.skin.len() as u32;
        let corners = if random.next() > 0.0 { [p, q, third] } else { [third, p, q] };
        self.flow.skin.extend(corners.map(|corner| narrow(at + corner)));
        let model = &mut self.flow.model;
        model.fan_first.extend([model.fans.len() as u32; 3]);
        model.skin_areas.extend([0.0; 3]);
        model.triangles.push([first, first + 1, first + 2, 0]);
        model.triangles.len() as u32 - 1
    }

    /// Makes lists of hits, chunks (groups of up to 64 skin vertices) and work items (a chunk in a patch), and runs the
    /// kernel.
    fn run(&mut self) {
        let (count, contact_patches) = (self.is_hit.len(), self.contact_patches());
        let flow = &mut self.flow;
        let is_own = |t: &u32| flow.model.fans.contains(t);
        let own = (0..flow.model.triangles.len() as u32).filter(is_own);
        flow.model.chunk_vertices = own.map(|t| flow.model.triangles[t as usize][0]).collect();
        flow.model.chunk_vertices.dedup();
        let chunk = |first: usize| Chunk {
            vertex_first: first as u32,
            vertex_count: (count - first).min(CHUNK_VERTICES) as u32,
            ..Chunk::default()
        };
        flow.model.chunks = (0..count).step_by(CHUNK_VERTICES).map(chunk).collect();
        let chunks = flow.model.chunks.len() as u32;
        let (mask, each) = ((1 << contact_patches) - 1, contact_patches as u32);
        let pair_proxy = 2 * self.side + 1;
        let entry = |chunk: u32| ActiveChunk {
            chunk,
            pair_proxy,
            side: self.side,
            contact_patches: mask,
            first_work_item: chunk * each,
        };
        flow.active_chunks = (0..chunks).map(entry).collect();
        flow.work_items = (0..chunks * each).map(|i| [i / each, i % each]).collect();
        // Behind the chunks that the kernel works on, one more chunk is listed for each of the four pair proxies; a ray
        // hit names the chunk of its triangle.
        let opposing = flow.work_items.len() as u32;
        for other in 0..4 {
            flow.work_items.push([flow.active_chunks.len() as u32, 0]);
            flow.active_chunks.push(ActiveChunk {
                pair_proxy: other,
                side: u32::from(other > 1),
                ..ActiveChunk::default()
            });
        }
        flow.entry_hits = vec![NONE; CHUNK_VERTICES * (chunks * each) as usize];
        flow.ray_hits = vec![];
        for (v, is_hit) in self.is_hit.iter().enumerate() {
            for (r, list) in is_hit.iter().take(contact_patches).enumerate() {
                let hash_entry = (v / CHUNK_VERTICES * contact_patches + r) * CHUNK_VERTICES + v % CHUNK_VERTICES;
                for (triangle, depth, front, pair_proxy) in list {
                    let next = std::mem::replace(&mut flow.entry_hits[hash_entry], flow.ray_hits.len() as u32);
                    let what = (opposing + pair_proxy) << 1 | u32::from(*front);
                    flow.ray_hits.push([*triangle, next, (*depth as f32).to_bits(), what]);
                }
            }
        }
        flow.counts = Default::default();
        flow.args[3 * shaders::ARGS_GATHERING as usize] = chunks;
        flow.candidates();
    }

    /// Compares the result for every vertex with f64. Returns the number of contacts, and the number of contacts that
    /// are blended from several patches.
    fn check(&self) -> [usize; 2] {
        let (flow, mut found, mut blended) = (&self.flow, 0, 0);
        for (v, is_hit) in self.is_hit.iter().enumerate() {
            let (hit, what) = (flow.hits[v], format!("vertex {v} of side {}", self.side));
            let mut seen = vec![];
            for (r, list) in is_hit.iter().enumerate() {
                let nearest = list.iter().min_by(|x, y| x.1.total_cmp(&y.1).then(x.0.cmp(&y.0)));
                if let Some(nearest) = nearest.filter(|nearest| nearest.2) {
                    let share = f64::from(flow.shares[(2 * self.side as usize + 1) * PAIR_PATCHES + r]);
                    seen.push((share, nearest.1, wide(&flow.contact_patches[r].normal), nearest));
                }
            }
            let search_depths: Vec<_> = seen.iter().map(|s| (s.0, s.1, s.2)).collect();
            let Some((depth, Some(normal))) = contact_patches::blend(&search_depths) else {
                assert_eq!(hit, [0.0; 4], "{what}: no contact expected");
                continue;
            };
            let sign = if self.side == 0 { 1.0 } else { -1.0 };
            let facing = sign * self.around[v].iter().sum::<DVec3>().normalize().dot(normal);
            if facing <= BLENDED {
                assert!(hit[3] < 1e-6, "{what} faces away, so that its area must be zero");
                continue;
            }
            let vertex = flow.model.chunk_vertices[v];
            let area = f64::from(flow.model.skin_areas[vertex as usize]);
            expect_close(&what, &hit[..1], &[depth], Tolerance { abs: DEPTH, rel: BLENDED });
            expect_close(&what, &hit[3..], &[0.5 * facing * area], Tolerance { abs: BLENDED * area, rel: 0.0 });
            let tilt = Tolerance { abs: BLENDED, rel: 0.0 };
            expect_close(&what, &flow.normals[v][..3], &normal.to_array(), tilt);
            let strength = |s: &(f64, f64, DVec3, &Made)| s.0 / (s.1 * s.1);
            let strongest = seen.iter().max_by(|x, y| strength(x).total_cmp(&strength(y))).unwrap();
            assert_eq!(
                flow.what[v],
                [vertex, self.side, strongest.3.0, 0],
                "{what}: vertex, side and opposing triangle"
            );
            self.check_point(v, strongest.2, strongest.1, strongest.3.0);
            let push = sign * depth * area * without_walls(&self.around[v], sign * normal);
            let allowed = Tolerance { abs: BLENDED * depth * area, rel: 0.0 };
            expect_close(&what, &flow.pushes[v][..3], &push.to_array(), allowed);
            let pair_proxies = if self.side == 0 { [1, strongest.3.3 - 2] } else { [strongest.3.3, 1] };
            assert_eq!(
                flow.pushes[v][3].to_bits(),
                FIRST_PROXY_PAIR + 2 * pair_proxies[0] + pair_proxies[1],
                "{what}: index of the pair of collision proxies"
            );
            found += 1;
            blended += usize::from(seen.len() > 1 && (normal - strongest.2).length() > 1e-3);
        }
        [found, blended]
    }

    /// Checks that the opposing point lies on the triangle and on the vertex's ray.
    fn check_point(&self, v: usize, normal: DVec3, depth: f64, triangle: u32) {
        let skin = |v: u32| wide(&self.flow.skin[v as usize]);
        let corners = self.flow.model.triangles[triangle as usize];
        let [_, q, r, _] = self.flow.hits[v].map(f64::from);
        let at = DMat3::from_cols(skin(corners[0]), skin(corners[1]), skin(corners[2])) * DVec3::new(1.0 - q - r, q, r);
        let sign = if self.side == 0 { -1.0 } else { 1.0 };
        let want = skin(self.flow.model.chunk_vertices[v]) + sign * depth * normal;
        assert!(at.distance(want) < 4.0 * DEPTH, "vertex {v}: opposing point {at} m, expected {want} m");
    }
}

/// The unit normal of triangles with these area vectors, without those that are steep to `towards` beside one that is not.
fn without_walls(areas: &[DVec3], towards: DVec3) -> DVec3 {
    let smooth = |low: f64, high: f64, x: f64| {
        let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    };
    let cosine = |area: &DVec3| area.normalize().dot(towards);
    let share = smooth(0.7, 0.95, areas.iter().map(cosine).fold(0.0, f64::max));
    areas.iter().map(|area| (1.0 - share + share * smooth(0.0, 0.5, cosine(area))) * *area).sum::<DVec3>().normalize()
}

/// Runs the kernel on one vertex that faces the other body and has these hits on its ray. Returns depth and flags.
fn one(side: u32, ray_hits: &[RayHit]) -> (f64, u32) {
    let mut random = Random(5);
    let mut given = Given::new(side, &[DVec3::Z]);
    given.flow.params.depth_limit = 0.02;
    let outward = if side == 0 { DVec3::Z } else { -DVec3::Z };
    given.add(0.03 * random.vector(), outward, &[ray_hits.to_vec()], &mut random);
    given.run();
    given.check();
    (f64::from(given.flow.hits[0][0]), given.flow.counts.flags)
}

#[test]
fn the_nearest_crossing_decides() {
    for side in 0..2 {
        let depth = |ray_hits: &[RayHit]| (one(side, ray_hits).0 * 1e6).round() / 1e6;
        assert_eq!(depth(&[]), 0.0);
        assert_eq!(depth(&[(0.01, true)]), 0.01);
        assert_eq!(depth(&[(0.01, false)]), 0.0, "the ray hits the back of a triangle, so that the vertex is outside");
        // The ray leaves one wall at 5 mm and meets others behind it. The vertex lies inside the first one, whatever
        // the order of the list.
        let mut layers = [(0.005, true), (0.008, false), (0.012, true), (0.015, false)];
        assert_eq!(depth(&layers), 0.005);
        layers.reverse();
        assert_eq!(depth(&layers), 0.005);
        // The ray enters a wall at 3 mm and leaves it at 7 mm: the vertex lies outside all walls.
        assert_eq!(depth(&[(0.007, true), (0.003, false), (0.01, false)]), 0.0);
    }
}

#[test]
fn the_nearest_of_a_long_list_is_found_or_flagged() {
    for count in [1_000, 60_000, 70_000] {
        let mut random = Random(8);
        let mut given = Given::new(0, &[DVec3::Z]);
        // The hit that is made first lies last in the list.
        let mut ray_hits = vec![(0.01, true); count];
        ray_hits[0].0 = 0.005;
        given.add(DVec3::ZERO, DVec3::Z, &[ray_hits], &mut random);
        given.run();
        let (depth, flags) = (f64::from(given.flow.hits[0][0]), given.flow.counts.flags);
        println!("list of {count} ray hits: depth {depth} m, flags {flags}");
        assert_eq!(flags, if (depth - 0.005).abs() < DEPTH { 0 } else { CONTACT_OVERFLOW });
    }
}

#[test]
fn of_equally_deep_crossings_the_lowest_triangle_stands() {
    for list in [[(0.01, true), (0.01, false)], [(0.01, false), (0.01, true)]] {
        // The hit that is made first is on the triangle with the lowest index, and lies last in the list.
        assert_eq!(one(0, &list).0 > 0.0, list[0].1);
    }
}

#[test]
fn flags_say_what_is_too_deep_or_too_thin() {
    for side in 0..2 {
        let flags = |ray_hits: &[RayHit]| one(side, ray_hits).1;
        assert_eq!(flags(&[(0.019, true)]), 0);
        assert_eq!(flags(&[(0.021, true)]), DEPTH_LIMIT);
        assert_eq!(
            flags(&[(0.005, true), (0.019, false)]),
            NOT_HEIGHT_FIELD,
            "flags where a second surface lies within the depth limit"
        );
        assert_eq!(flags(&[(0.005, true), (0.021, false)]), 0);
        assert_eq!(flags(&[(0.021, false), (0.022, true)]), 0, "flags of a vertex outside the other body");
    }
}

#[test]
fn opposite_regions_that_are_equally_near_say_nothing() {
    let mut random = Random(6);
    for (depth, flags) in [(0.01, NOT_HEIGHT_FIELD), (0.03, 0)] {
        let mut given = Given::new(0, &[DVec3::Z, -DVec3::Z]);
        given.flow.params.depth_limit = 1.0;
        given.add(DVec3::ZERO, DVec3::Z, &[vec![(0.01, true)], vec![(depth, true)]], &mut random);
        given.run();
        given.check();
        assert_eq!(given.flow.counts.flags, flags);
        assert_eq!(given.flow.hits[0][0] > 0.0, flags == 0);
    }
}

#[test]
fn vertices_by_the_hundred_in_up_to_four_regions_against_the_oracle() {
    let mut random = Random(7);
    for side in 0..2 {
        for contact_patches in 1..=PAIR_PATCHES {
            let normals: Vec<DVec3> =
                (0..contact_patches).map(|_| (DVec3::Z + 0.5 * random.vector()).normalize()).collect();
            let mut given = Given::new(side, &normals);
            given.flow.shares.iter_mut().for_each(|share| *share = 0.55 + 0.45 * random.next() as f32);
            for _ in 0..300 {
                let ray_hits: Vec<Vec<RayHit>> = (0..contact_patches)
                    .map(|_| {
                        let count = random.below(4);
                        (0..count).map(|_| (0.012 + 0.008 * random.next(), random.next() > -0.4)).collect()
                    })
                    .collect();
                let towards = if side == 0 { DVec3::Z } else { -DVec3::Z };
                let outward = (towards + 1.2 * random.vector()).normalize();
                given.add(0.03 * random.vector(), outward, &ray_hits, &mut random);
            }
            given.run();
            let [found, blended] = given.check();
            assert!(
                found > 80 && (contact_patches == 1) == (blended == 0),
                "{found} contacts in {contact_patches} patches; {blended} contacts are blended from several patches"
            );
        }
    }
}
