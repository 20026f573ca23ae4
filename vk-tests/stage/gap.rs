//! Tests of kernel wrench/gap and of the gap between tool and bodies that the haptic loop is given. The tool is the
//! rigid body that the haptic device leads. The kernel finds the shortest vector (a way) from the tool to the skins
//! (surface meshes) at the end of a step; it is compared with the oracle, which searches all points and triangles in
//! f64.

use bytemuck::Zeroable;
use glam::{DQuat, DVec3};
use palpate::internal::gpu::Size;
use palpate::internal::prepare::{self, Body, FrameMotion, Shape};
use palpate::internal::shaders::{Chunk, Frame, Link, NONE, Proxy, RigidIterate, SkinGap, SkinPart, Solve};
use palpate::internal::stages::gap::{MARGIN, RANGE, SECTORS, parts};
use palpate_oracle::gap as oracle;
use palpate_oracle::gap::{Mesh, Way};

use crate::harness::bodies::{octants, rigid, soft, sphere, whole};
use crate::harness::random::Random;
use crate::harness::{case, context};
use crate::stage::flow::{Flow, fours, some};

/// Radius of a sphere tool, m.
const RADIUS: f64 = 0.01;
/// Error of a way, m: positions of a tenth of a metre after some ten operations in f32.
const CLOSE: f64 = 2.0e-7;
/// The length that the kernel reports where it met no way, m.
const FAR: f32 = 3.0e38;
/// Greatest number of chunks (groups of skin vertices and triangles) in a part of a skin, which one workgroup handles.
const SHARE: u32 = 8;

/// Error of a way to the plane of a triangle, m: the normal of a small triangle is less exact than its corners.
const TILTED: f64 = 2.0e-6;
/// Least cosine of the angle between a way in a sector and its triangle's normal.
const COSINE: f64 = 0.948_683_298_050_513_8;

/// Inputs of wrench/gap. [`Flow`] holds the arrays of the stages before that kernel for some bodies; the last body is
/// the tool.
struct Given {
    flow: Flow,
    parts: Vec<SkinPart>,
    /// Changes of the twists of the rigid cores (rigid bodies inside soft ones), then of the tool. The changes are put
    /// into the second of the solver's two sets of iterates, which the test marks as the newest.
    changes: Vec<[f32; 6]>,
    is_round: bool,
    /// Radius of a ball about the tool's centre that holds the tool, m.
    radius: f64,
}

/// Centre and rotation of a frame at the end of the step.
type Place = (DVec3, DQuat);

fn vector(x: [f32; 3]) -> DVec3 {
    DVec3::from(x.map(f64::from))
}

fn quaternion(q: [f32; 4]) -> DQuat {
    DQuat::from_array(q.map(f64::from)).normalize()
}

impl Given {
    fn new(bodies: &[Body], tool: &Body, random: &mut Random) -> Given {
        let mut flow = Flow::new(bodies, Some(tool), DVec3::ZERO);
        flow.params.dt = 1.0 / 64.0;
        flow.params.tool_twist = std::array::from_fn(|k| (if k < 3 { 0.1 } else { 1.0 } * random.next()) as f32);
        let changes =
            (0..=flow.model.cores.len()).map(|_| std::array::from_fn(|_| 0.2 * random.next() as f32)).collect();
        let parts = parts(&flow.model).iter().map(|part| part.part).collect();
        Given { flow, parts, changes, is_round: false, radius: 0.0 }
    }

    fn tool_frame(&self) -> usize {
        self.flow.model.tool_frame.unwrap()
    }

    /// Number of sectors of directions in which ways are found.
    fn sectors(&self) -> usize {
        if self.is_round { SECTORS } else { 1 }
    }

    /// The ways to all parts: for each part one for each sector.
    fn run(&self, size: Size) -> Vec<Vec<SkinGap>> {
        let (flow, model) = (&self.flow, &self.flow.model);
        let old = [RigidIterate { x: [f32::NAN; 6], ..RigidIterate::zeroed() }].repeat(self.changes.len());
        let new = self.changes.iter().map(|x| RigidIterate { x: *x, ..RigidIterate::zeroed() });
        let proxies = &model.proxies;
        let of_tool: Vec<&Proxy> = proxies.iter().filter(|p| p.frame as usize == self.tool_frame()).collect();
        let reach = RANGE + if self.is_round { self.radius } else { 0.0 };
        let stale = vec![[-5.0f32; 4]; model.skin_nodes.len().max(1)];
        let out = case("wrench/gap")
            .size(size)
            .constant("RIGIDS", self.changes.len() as u32)
            .constant("SPANS", model.spans_frames())
            .constant("SHARE", SHARE)
            .constant("ROUND", self.is_round)
            .constant("RADIUS", self.radius as f32)
            .constant("REACH", reach as f32)
            .constant("TOOL_FRAME", self.tool_frame() as u32)
            .constant("TOOL_CHUNK_FIRST", of_tool[0].chunk_first)
            .constant("TOOL_CHUNKS", of_tool.iter().map(|p| p.chunk_count).sum::<u32>())
            .constant("SECTORS", self.sectors() as u32)
            .constant("MARGIN", if self.is_round { MARGIN as f32 } else { 0.0 })
            .input("params", &[flow.params])
            .input("frames", &flow.frames)
            .input("solve", &[Solve { current: 1, ..Solve::zeroed() }])
            .input("iterates", &old.into_iter().chain(new).collect::<Vec<_>>())
            .input("parts", &some(&self.parts))
            .input("proxies", proxies)
            .input("chunks", &model.chunks)
            .input("proxy_nodes", &fours(model.proxy_nodes.as_flattened()))
            .input("chunk_nodes", &fours(model.chunk_nodes.as_flattened()))
            .input("chunk_vertices", &fours(&model.chunk_vertices))
            .input("chunk_triangles", &fours(&model.chunk_triangles))
            .input("triangles", &some(&model.triangles))
            .input("skin_nodes", &some(&model.skin_nodes))
            .input("skin_weights", &some(&model.skin_weights))
            .input("node_rest", &some(&model.node_rest))
            .input("displacement", &some(&flow.displacement))
            .input("node_info", &some(&model.node_info))
            .input("links", &flow.links)
            .inout("skin", &stale)
            .output::<SkinGap>("gaps", self.sectors() * self.parts.len())
            .groups(self.parts.len())
            .run();
        // The positions of vertices that the kernel read must be those of the oracle, relative to the tool's centre and
        // along its axes.
        let ((centre, rotation), positions) = (self.tool_at_end(), self.positions());
        for (got, want) in out.get::<[f32; 4]>("skin").iter().zip(&positions) {
            let want = rotation.inverse() * (*want - centre);
            let is_there = vector([got[0], got[1], got[2]]).distance(want) < CLOSE;
            assert!(*got == [-5.0; 4] || (is_there && got[3] == 1.0), "vertex at {got:?}, expected {want}");
        }
        out.get::<SkinGap>("gaps").chunks(self.sectors()).map(<[SkinGap]>::to_vec).collect()
    }

    fn tool_at_end(&self) -> Place {
        let (params, frame) = (&self.flow.params, &self.flow.frames[self.tool_frame()]);
        let change = self.changes[self.changes.len() - 1];
        let h = f64::from(params.dt);
        let twist: Vec<f64> = change.iter().zip(params.tool_twist).map(|(x, v)| h * f64::from(x + v)).collect();
        let turn = DQuat::from_scaled_axis(DVec3::from_slice(&twist[3..]));
        (vector(params.tool_centre) + DVec3::from_slice(&twist[..3]), turn * quaternion(frame.rotation))
    }

    fn end_of(&self, frame: &Frame) -> Place {
        let h = f64::from(self.flow.params.dt);
        let (centre, rotation) = (vector(frame.centre), quaternion(frame.rotation));
        if frame.core == NONE {
            return (centre + h * vector(frame.linear), rotation * quaternion(frame.turn).inverse());
        }
        let x = self.changes[frame.core as usize].map(f64::from);
        let turn = DQuat::from_scaled_axis(h * (vector(frame.angular) + DVec3::from_slice(&x[3..])));
        (centre + h * (vector(frame.linear) + DVec3::from_slice(&x[..3])), turn * rotation)
    }

    /// Positions of all skin vertices at the end of the step, those of the tool included.
    fn positions(&self) -> Vec<DVec3> {
        let (flow, model) = (&self.flow, &self.flow.model);
        let ends: Vec<Place> = flow.frames.iter().map(|frame| self.end_of(frame)).collect();
        let node = |node: u32| {
            let (rest, moved) = (model.node_rest[node as usize], flow.displacement[node as usize]);
            let (centre, rotation) = ends[model.node_info[node as usize][2] as usize];
            centre + rotation * (vector([rest[0], rest[1], rest[2]]) + vector([moved[0], moved[1], moved[2]]))
        };
        let mut frame_of = vec![0; model.skin_nodes.len()];
        for proxy in &model.proxies {
            for chunk in &model.chunks[proxy.chunk_first as usize..][..proxy.chunk_count as usize] {
                let listed = &model.chunk_vertices[chunk.vertex_first as usize..][..chunk.embed_count as usize];
                listed.iter().for_each(|v| frame_of[*v as usize] = proxy.frame as usize);
            }
        }
        let place = |(nodes, weights, frame): (&[u32; 4], &[f32; 4], usize)| {
            if nodes[0] == NONE {
                let (centre, rotation) = if frame == self.tool_frame() { self.tool_at_end() } else { ends[frame] };
                return centre + rotation * vector([weights[0], weights[1], weights[2]]);
            }
            nodes.iter().zip(weights).map(|(n, w)| f64::from(*w) * node(*n)).sum()
        };
        let all = model.skin_nodes.iter().zip(&model.skin_weights).zip(frame_of);
        all.map(|((nodes, weights), frame)| place((nodes, weights, frame))).collect()
    }

    /// The triangles of a range of chunks: their indices, and their corners.
    fn triangles(&self, first: u32, count: u32) -> (Vec<u32>, Vec<[u32; 3]>) {
        let model = &self.flow.model;
        let chunks = &model.chunks[first as usize..][..count as usize];
        let of = |c: &Chunk| &model.chunk_triangles[c.triangle_first as usize..][..c.triangle_count as usize];
        let indices: Vec<u32> = chunks.iter().flat_map(of).copied().collect();
        let corners = indices.iter().map(|t| model.triangles[*t as usize]).map(|[a, b, c, _]| [a, b, c]).collect();
        (indices, corners)
    }

    /// All ways from the tool to a part, with triangles numbered as in the kernel.
    fn ways(&self, part: &SkinPart) -> Vec<Way> {
        let positions = self.positions();
        let model = &self.flow.model;
        let own = |first: u32, count: u32| -> Vec<DVec3> {
            let chunks = &model.chunks[first as usize..][..count as usize];
            let of = |c: &Chunk| &model.chunk_vertices[c.vertex_first as usize..][..c.vertex_count as usize];
            chunks.iter().flat_map(of).map(|v| positions[*v as usize]).collect()
        };
        let (indices, corners) = self.triangles(part.chunk_first, part.chunk_count);
        let named = |way: Way, names: &[u32]| Way { triangle: names[way.triangle] as usize, ..way };
        if self.is_round {
            let mesh: Mesh = (&positions, &corners);
            return oracle::from_point(self.tool_at_end().0, mesh).map(|way| named(way, &indices)).collect();
        }
        let of_tool: Vec<&Proxy> = model.proxies.iter().filter(|p| p.frame as usize == self.tool_frame()).collect();
        let (first, count) = (of_tool[0].chunk_first, of_tool.iter().map(|p| p.chunk_count).sum());
        let (tool_indices, tool_corners) = self.triangles(first, count);
        // Ways go from vertices of the tool to triangles of the part, and from triangles of the tool to vertices of the
        // part; corners are indices into all positions.
        let towards = own(first, count)
            .into_iter()
            .flat_map(|x| oracle::from_point(x, (&positions, &corners)).collect::<Vec<_>>());
        let back = own(part.chunk_first, part.chunk_count).into_iter().flat_map(|x| {
            let ways = oracle::from_point(x, (&positions, &tool_corners));
            ways.map(|way| Way { along: -way.along, ..way }).collect::<Vec<_>>()
        });
        towards.map(|way| named(way, &indices)).chain(back.map(|way| named(way, &tool_indices))).collect()
    }

    /// Compares the kernel's ways with all ways, at the workgroup sizes of a CPU and of a GPU. Returns the number of
    /// parts within reach of the tool, the number of parts whose nearest triangle faces away from the tool, so that
    /// the tool is within the body, and the number of sectors in which a triangle faces a sphere.
    fn agree(&self) -> [usize; 3] {
        let (mut near, mut within, mut towards) = (0, 0, 0);
        let [small, large] = [Size::Reduce, Size::Group].map(|size| self.run(size));
        let reach = RANGE + if self.is_round { self.radius } else { 0.0 };
        for ((part, got), other) in self.parts.iter().zip(&small).zip(&large) {
            let ways = self.ways(part);
            let [sectors, of_others] = [got, other];
            let [got, other] = [got, other].map(|all| &all[self.sectors() / 2]);
            let [one, two] = [got, other].map(|gap| (gap.way.map(f32::to_bits), gap.triangle));
            assert_eq!(one, two, "way and triangle, with workgroups of two sizes");
            if self.is_round {
                let bits = |all: &[SkinGap]| all.iter().map(|gap| (gap.way.map(f32::to_bits), gap.triangle)).collect();
                let [one, two]: [Vec<_>; 2] = [bits(sectors), bits(of_others)];
                assert_eq!(one, two, "ways in sectors, with workgroups of two sizes");
                towards += self.agree_in_sectors(part, sectors);
            }
            let size = |way: Way| way.along.length();
            let front = oracle::shortest(ways.iter().copied(), true).filter(|way| size(*way) < reach);
            let back = oracle::shortest(ways.iter().copied(), false).filter(|way| size(*way) < reach);
            match front {
                Some(front) => {
                    let way = vector(got.way);
                    assert!(
                        (way.length() - size(front)).abs() < CLOSE,
                        "the kernel's way {got:?}, the oracle's {front:?}"
                    );
                    let mut same = ways.iter().filter(|way| way.triangle == got.triangle as usize && way.faces);
                    assert!(
                        same.any(|known| known.along.distance(way) < CLOSE),
                        "the kernel's way does not lead to its triangle: {got:?}, shortest way {front:?}"
                    );
                    near += 1;
                }
                None => assert_eq!((got.way, got.triangle), ([0.0; 3], NONE)),
            }
            // If the nearest triangle faces away, the kernel's `back` is the length of the way to this triangle;
            // otherwise its `back` is the length of some way to a triangle facing away that was met during the search.
            let most = front.map_or(f64::INFINITY, |front| size(front) - CLOSE);
            for found in [got, other].map(|got| f64::from(got.back)) {
                match back.filter(|back| size(*back) < most) {
                    Some(back) => assert!(
                        (found - size(back)).abs() < CLOSE,
                        "way to a triangle that faces away: length {found} m, expected that of {back:?}"
                    ),
                    None => assert!(
                        found > back.map_or(0.0, |back| size(back) - CLOSE),
                        "length {found} m of a way to a triangle that faces away; shortest {back:?}"
                    ),
                }
            }
            within += usize::from(back.is_some_and(|back| size(back) < most));
        }
        [near, within, towards]
    }
}

impl Given {
    /// Compares the ways in sectors with the ways to the planes of all triangles of a part: each must be that to the nearest
    /// triangle in its sector, unless that is farther away than the nearest of all by more than the margin. Returns the number of sectors in which there is such a way.
    fn agree_in_sectors(&self, part: &SkinPart, sectors: &[SkinGap]) -> usize {
        let centre = self.tool_at_end().0;
        let positions = self.positions();
        let (indices, corners) = self.triangles(part.chunk_first, part.chunk_count);
        let ways: Vec<Way> = oracle::from_point(centre, (&positions, &corners)).collect();
        let size = |triangle: usize| ways[triangle].along.length();
        let least = oracle::shortest(ways.iter().copied(), true).map_or(f64::INFINITY, |way| way.along.length());
        let limit = (RANGE + self.radius).min(least + MARGIN) - CLOSE;
        let planes: Vec<Way> = oracle::to_planes(centre, (&positions, &corners), COSINE - 1e-4).collect();
        // Ways at the border of a sector or at the limit of angles may count or not.
        let is_clear = |way: &Way| {
            let direction = way.along.normalize();
            direction.to_array().iter().all(|x| (x.abs() - 0.5).abs() > 1e-4) && (way.cosine - COSINE).abs() > 1e-4
        };
        let mut found = 0;
        for (index, got) in sectors.iter().enumerate().filter(|(index, _)| *index != SECTORS / 2) {
            let sector = [index / 9, index / 3 % 3, index % 3].map(|digit| digit as i32 - 1);
            let own = planes.iter().filter(|way| is_clear(way) && oracle::sector_of(way.along.normalize()) == sector);
            let most = own.map(|way| size(way.triangle)).filter(|size| *size < limit);
            let most = most.fold(f64::INFINITY, f64::min);
            found += usize::from(most < f64::INFINITY);
            if got.triangle == NONE {
                assert_eq!(most, f64::INFINITY, "no way is found in sector {sector:?}; there is one of {most} m");
                continue;
            }
            let way = vector(got.way);
            let mut same = planes.iter().filter(|way| indices[way.triangle] == got.triangle);
            let nearest = same.clone().map(|way| size(way.triangle)).fold(f64::INFINITY, f64::min);
            assert!(nearest < most + CLOSE, "{got:?} in sector {sector:?} is {nearest} m away; a triangle is {most} m");
            assert!(
                same.any(|known| known.along.distance(way) < TILTED),
                "{got:?} is no way to its triangle's plane: {:?}",
                oracle::to_planes(centre, (&positions, &corners), 0.0)
                    .find(|way| indices[way.triangle] == got.triangle)
            );
            let near = |x: f64, digit: i32| match digit {
                0 => x.abs() < 0.5 + 1e-4,
                digit => f64::from(digit) * x > 0.5 - 1e-4,
            };
            let is_in = way.normalize().to_array().into_iter().zip(sector).all(|(x, digit)| near(x, digit));
            assert!(is_in, "{got:?} is not in sector {sector:?}");
        }
        found
    }
}

/// A rigid skin of `count` loose triangles about the origin: centres lie up to `reach` (m) away along each axis, edges
/// are some `edge` (m) long.
fn soup(name: &str, count: usize, reach: f64, edge: f64, random: &mut Random) -> Body {
    // A skin has at least one triangle; a test that needs none removes it later.
    let count = count.max(1);
    let mut vertices = vec![];
    for _ in 0..count {
        let centre = reach * random.vector();
        vertices.extend((0..3).map(|_| centre + 0.5 * edge * random.vector()));
    }
    let triangles = (0..count as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    let all = |skin: &prepare::Skin| {
        let hull = prepare::hull::reduced(&skin.vertices).unwrap();
        let triangles = (0..skin.triangles.len() as u32).collect();
        let vertices = (0..skin.vertices.len() as u32).collect();
        vec![prepare::Proxy { hull: hull.vertices, faces: hull.faces, triangles, vertices, ..Default::default() }]
    };
    rigid(name, (vertices, triangles), all, DVec3::ZERO, random.turn(3.0))
}

/// A frame that turns and moves over the step.
fn moving(frame: &Frame, random: &mut Random) -> Frame {
    let turn = random.turn(0.1).as_quat().to_array();
    Frame { linear: (0.3 * random.vector()).as_vec3().to_array(), turn, core: NONE, ..*frame }
}

#[test]
fn a_triangle_before_a_sphere_and_behind_it_by_hand() {
    // wrench/gap: in a step of 1/64 s the tool's centre moves by (0.64 + 0.64) / 64 = 0.02 m along z, to 0.04 m above a
    // triangle in z = 0, or to 0.04 m behind the triangle.
    let mut random = Random(3);
    let tool = rigid("tool", sphere(RADIUS, 1), whole, DVec3::ZERO, DQuat::IDENTITY);
    let mesh = (
        vec![DVec3::new(-0.02, -0.02, 0.0), DVec3::new(0.04, -0.02, 0.0), DVec3::new(-0.02, 0.04, 0.0)],
        vec![[0, 1, 2]],
    );
    for (z, front) in [(0.02f32, true), (-0.06, false)] {
        let mut body = soup("body", 1, 0.1, 0.1, &mut random);
        let Shape::Rigid { skin, .. } = &mut body.shape else { unreachable!() };
        skin.vertices.clone_from(&mesh.0);
        body.orientation = DQuat::IDENTITY;
        let mut given = Given::new(&[body], &tool, &mut random);
        (given.is_round, given.radius) = (true, RADIUS);
        given.flow.frames.iter_mut().for_each(|frame| (frame.turn, frame.core) = ([0.0, 0.0, 0.0, 1.0], NONE));
        (given.flow.params.tool_centre, given.flow.params.tool_twist) = ([0.0, 0.0, z], [0.0; 6]);
        given.flow.params.tool_twist[2] = 0.64;
        given.changes = vec![[0.0, 0.0, 0.64, 0.0, 0.0, 0.0]];
        let got = given.run(Size::Reduce)[0][SECTORS / 2];
        match front {
            true => assert!(
                (got.way, got.triangle, got.back) == ([0.0, 0.0, -0.04], 0, FAR),
                "triangle in front of the sphere: {got:?}"
            ),
            false => assert!((got.triangle, got.back) == (NONE, 0.04), "triangle behind the sphere: {got:?}"),
        }
        // A little farther away the triangle is out of reach.
        given.flow.params.tool_centre[2] += if front { 1e-5 } else { -1e-5 };
        let got = given.run(Size::Reduce)[0][SECTORS / 2];
        assert_eq!((got.triangle, got.way), (NONE, [0.0; 3]));
    }
}

#[test]
fn equal_ways_go_to_the_lower_triangle() {
    // wrench/gap: the nearest point is a corner that several triangles share, so that their ways are equal to the last
    // bit.
    let mut random = Random(8);
    let tool = rigid("tool", sphere(RADIUS, 1), whole, DVec3::ZERO, DQuat::IDENTITY);
    let mut body = soup("body", 6, 0.1, 0.1, &mut random);
    let Shape::Rigid { skin, .. } = &mut body.shape else { unreachable!() };
    for (i, x) in skin.vertices.iter_mut().enumerate() {
        let angle = ((i / 3 + i % 3) % 6) as f64;
        *x = if i % 3 == 0 { DVec3::ZERO } else { DVec3::new(0.02 * angle.cos(), 0.02 * angle.sin(), -0.01) };
    }
    body.orientation = DQuat::IDENTITY;
    let mut given = Given::new(&[body], &tool, &mut random);
    (given.is_round, given.radius) = (true, RADIUS);
    given.flow.frames.iter_mut().for_each(|frame| (frame.turn, frame.core) = ([0.0, 0.0, 0.0, 1.0], NONE));
    (given.flow.params.tool_centre, given.flow.params.tool_twist) = ([0.0, 0.0, 0.02], [0.0; 6]);
    given.changes = vec![[0.0; 6]];
    for size in [Size::Reduce, Size::Group] {
        let got = given.run(size)[0][SECTORS / 2];
        assert_eq!((got.way, got.triangle), ([0.0, 0.0, -0.02], 0), "way and triangle: {got:?}");
    }
}

#[test]
#[ignore = "long: 10 s"]
fn shortest_ways_to_loose_triangles_of_any_number() {
    let (narrow, wide) = (context().reduce_size() as usize, context().group_size() as usize);
    let (mut near, mut within, mut towards) = (0, 0, 0);
    for n in [0, 1, narrow - 1, narrow, narrow + 1, wide - 1, wide, wide + 1, 1234] {
        for is_round in [true, false] {
            let mut random = Random(n as u64 + 7);
            let body = soup("body", n, 0.08, 0.02, &mut random);
            let tool = match is_round {
                true => rigid("tool", sphere(RADIUS, 1), whole, DVec3::ZERO, DQuat::IDENTITY),
                false => soup("tool", 30, 0.01, 0.02, &mut random),
            };
            let mut given = Given::new(&[body], &tool, &mut random);
            given.is_round = is_round;
            given.radius = if is_round { RADIUS } else { given.flow.model.tool_radius };
            given.flow.frames.iter_mut().for_each(|frame| *frame = moving(frame, &mut random));
            given.flow.params.tool_centre = (0.05 * random.vector()).as_vec3().to_array();
            if n == 0 {
                let first = given.parts[0].chunk_first as usize;
                let chunk = &mut given.flow.model.chunks[first];
                (chunk.vertex_count, chunk.embed_count, chunk.triangle_count) = (0, 0, 0);
            }
            let [some, inside, facing] = given.agree();
            (near, within, towards) = (near + some, within + inside, towards + facing);
            // First all parts lose their chunks, then there are no parts at all.
            given.parts.iter_mut().for_each(|part| part.chunk_count = 0);
            assert!(
                given.run(Size::Reduce).iter().flatten().all(|got| got.triangle == NONE),
                "{n} triangles: the kernel reports a way to a part without chunks"
            );
            given.parts.clear();
            assert!(given.run(Size::Reduce).is_empty());
        }
    }
    assert!(near >= 20 && within > 5, "{near} parts within reach; in {within} parts the tool is within the body");
    assert!(towards > 0, "in {towards} sectors a triangle faces the sphere");
}

/// A soft ball, and displacements of its nodes of up to `size` (m). If `spans`, all but its left end belongs to a
/// second rigid coordinate frame, that of a dynamic core.
fn ball(spans: bool, size: f64, random: &mut Random) -> (Body, Vec<[f32; 4]>) {
    let mut ball = soft("ball", sphere(0.04, 4), octants, DVec3::new(0.02, -0.01, 0.03), random.turn(3.0));
    let Shape::Soft { layer, frames, node_frames, .. } = &mut ball.shape else { unreachable!() };
    if spans {
        let motion = FrameMotion::Dynamic { mass: None, hinge: None };
        frames.push(prepare::Frame { centre: DVec3::new(0.2, 0.05, 0.0), motion });
        *node_frames = layer.nodes.iter().map(|x| u32::from(x.x > -0.03)).collect();
    }
    let shaken = layer.nodes.iter().map(|_| (size * random.vector()).as_vec3().extend(0.0).to_array()).collect();
    (ball, shaken)
}

#[test]
#[ignore = "long: 8 s"]
fn shortest_ways_to_deformed_bodies() {
    let (mut near, mut within, mut towards) = (0, 0, 0);
    for seed in 0..12 {
        let mut random = Random(seed + 40);
        let (spans, is_round) = (seed % 2 == 1, seed % 4 < 2);
        // The ball is at rest for the first seeds, then its nodes are displaced, and for the last seeds the whole ball
        // is shifted besides.
        let (size, shift) = [(0.0, 0.0), (0.004, 0.0), (0.01, 0.05)][seed as usize / 4];
        let shift = shift * random.vector().normalize();
        let (ball, mut shaken) = ball(spans, size, &mut random);
        for d in &mut shaken {
            *d = (vector([d[0], d[1], d[2]]) + shift).as_vec3().extend(0.0).to_array();
        }
        let tool = match is_round {
            true => rigid("tool", sphere(RADIUS, 2), whole, DVec3::ZERO, DQuat::IDENTITY),
            false => rigid("tool", sphere(0.012, 2), octants, DVec3::ZERO, random.turn(3.0)),
        };
        let mut given = Given::new(std::slice::from_ref(&ball), &tool, &mut random);
        given.is_round = is_round;
        given.radius = if is_round { RADIUS } else { given.flow.model.tool_radius };
        given.flow.displacement = shaken;
        if spans {
            // The frame of the ball's larger part has moved away from the other frame, and turned.
            let frame = &mut given.flow.frames[1];
            frame.centre = (vector(frame.centre) + 0.04 * random.vector()).as_vec3().to_array();
            frame.rotation = (random.turn(0.4) * quaternion(frame.rotation)).as_quat().to_array();
        }
        let starts: Vec<Place> = given.flow.frames.iter().map(|f| (vector(f.centre), quaternion(f.rotation))).collect();
        given.flow.frames.iter_mut().for_each(|frame| *frame = moving(frame, &mut random));
        if spans {
            given.flow.frames[1].core = 0;
            given.flow.frames[1].angular = random.vector().as_vec3().to_array();
            assert_eq!(given.changes.len(), 2, "number of twists: of one core and of the tool");
        }
        let links = given.flow.model.links.clone();
        for (link, [to, from]) in given.flow.links.iter_mut().zip(&links) {
            let (to, from) = (*to as usize, *from as usize);
            let back = starts[to].1.inverse();
            let rest = given.flow.model.frames[from].rest_centre - given.flow.model.frames[to].rest_centre;
            let offset = back * (starts[from].0 - starts[to].0) - rest;
            *link = Link {
                turn: (back * starts[from].1).as_quat().to_array(),
                offset: offset.as_vec3().to_array(),
                ..Link::default()
            };
        }
        // The tool's centre is put at falling distances from random places of the skin, the first one out of reach.
        let (skin, count) = (given.positions(), sphere(0.04, 4).0.len());
        for away in [0.045, 0.035, 0.028, 0.02, 0.014, 0.01, 0.005, 0.0] {
            let centre = skin[random.below(count)] + away * random.vector().normalize();
            given.flow.params.tool_centre = centre.as_vec3().to_array();
            let [some, inside, facing] = given.agree();
            (near, within, towards) = (near + some, within + inside, towards + facing);
        }
    }
    println!("{near} parts within reach; in {within} parts the tool is within the body");
    assert!(near > 60 && within > 30, "{near} parts within reach; in {within} parts the tool is within the body");
    assert!(towards > 50, "in {towards} sectors a triangle faces the sphere");
}

/// The gap that whole steps report to the haptic loop.
mod told {
    use glam::{DQuat, DVec3};
    use palpate::internal::step::{ContactWrench, DeviceInput, FARTHER};
    use palpate::{RigidState, Simulation};

    use super::RADIUS;
    use crate::scene::whole_step::{open, scene};

    /// Time step, s.
    const STEP: f64 = 5e-3;
    /// Stiffness of contact, N/m^3.
    const STIFFNESS: f64 = 3e7;
    /// Error of the gap's length, m: positions near the tool and frames are rounded to f32.
    const CLOSE: f64 = 5e-8;

    /// A scene with these bodies and a tool that has no virtual coupling.
    fn opened(bodies: &str, tool: &str) -> Simulation {
        let text = format!(
            "[step]\ndt = {STEP:?}\ngravity = [0.0, -9.81, 0.0]\n[solver]\ntolerance = 1e-5\n\
             [contact]\nstiffness = {STIFFNESS:?}\n{bodies}\n\
             [tool]\n{tool}\nmass = 0.05\nposition = [0.0, 0.015, 0.0]\n"
        );
        open(&scene(&text), None)
    }

    /// A block whose nodes are all attached to a rigid core; its top is at y = 0, and its sides are 0.04 m from the
    /// origin along x and z.
    fn block(core: &str) -> String {
        format!(
            "[[body]]\nname = \"block\"\n\
             layer = {{ box = [[-0.04, -0.05, -0.04], [0.04, 0.0, 0.04]], cells = [4, 3, 4] }}\n\
             material = {{ young = 1e5, poisson = 0.4, density = 1000.0 }}\n\
             [[body.core]]\nname = \"core\"\nbind = {{ all = true }}\n{core}\n"
        )
    }

    const FLOOR: &str = "[[body]]\nname = \"floor\"\nplane = [0.0, 0.8, 0.6, -0.02]\n";

    /// Runs a step from this pose and velocity of the tool.
    fn step(simulation: &mut Simulation, tool: RigidState) -> ContactWrench {
        let input = DeviceInput { ticks: 1, time: 0.0, device: tool, tool, coupling: None, max_force: f64::INFINITY };
        simulation.step_device_input(&input, STEP).unwrap();
        let messages = simulation.context().validation_messages();
        assert!(messages.is_empty(), "{messages:#?}");
        *simulation.contact_wrench().unwrap()
    }

    fn at(x: f64, y: f64, z: f64) -> RigidState {
        RigidState::at_rest(DVec3::new(x, y, z), DQuat::IDENTITY)
    }

    fn expect(simulation: &mut Simulation, tool: RigidState, normal: DVec3, distance: f64) {
        let wrench = step(simulation, tool);
        let gap = wrench.gap.unwrap_or_else(|| panic!("no gap is reported with the tool at {} m", tool.position));
        assert!(
            (gap.distance - distance).abs() < CLOSE,
            "{gap:?}, expected {distance} m with the tool at {} m",
            tool.position
        );
        assert!(gap.normal.distance(normal.normalize()) < 1e-5, "{gap:?}, expected a normal along {normal}");
        // STIFFNESS times the area of the cap that a plane cuts off a sphere at the depth d, 2 pi RADIUS d: at 0.5 mm,
        // and integrated over the depth.
        let area = 2.0 * std::f64::consts::PI * RADIUS;
        assert!((gap.stiffness / (STIFFNESS * area * 5e-4) - 1.0).abs() < 1e-6, "wrong stiffness: {gap:?}");
        assert!((gap.steepness / (0.5 * STIFFNESS * area) - 1.0).abs() < 1e-6, "wrong steepness: {gap:?}");
        assert_eq!((wrench.wrench.force, wrench.pressing), (DVec3::ZERO, 0.0));
    }

    #[test]
    fn a_sphere_over_a_block_and_a_half_space_by_hand() {
        let sphere = format!("sphere = {RADIUS:?}");
        let mut simulation = opened(&block("motion = \"fixed\""), &sphere);
        expect(&mut simulation, at(0.0, 0.015, 0.0), DVec3::Y, 0.005);
        // Where the sphere is next to an edge or a corner of the block, the nearest point lies on that edge or corner.
        expect(&mut simulation, at(0.05, 0.012, 0.001), DVec3::new(0.01, 0.012, 0.0), 0.01f64.hypot(0.012) - RADIUS);
        let corner = DVec3::new(0.01, 0.012, -0.008);
        expect(&mut simulation, at(0.05, 0.012, -0.048), corner, corner.length() - RADIUS);
        // The gap is found within the range of the search, and is not found beyond that range.
        expect(&mut simulation, at(0.0, 0.0399, 0.0), DVec3::Y, 0.0299);
        assert_eq!(step(&mut simulation, at(0.0, 0.0401, 0.0)).gap, None);
        // The gap that is reported is that at the end of the step.
        let moving = RigidState { velocity: DVec3::new(0.4, -0.2, 0.0), ..at(0.0, 0.015, 0.0) };
        expect(&mut simulation, moving, DVec3::Y, 0.005 - 0.2 * STEP);
        // In the step in which tool and block meet, no contact was found at the start, and the gap ends below zero. A faster
        // tool would do the step in parts, of which a later one finds contact.
        let fast = RigidState { velocity: DVec3::Y * -1.3, ..at(0.0, 0.012, 0.0) };
        expect(&mut simulation, fast, DVec3::Y, 0.002 - 1.3 * STEP);
        // No gap is reported if no haptic loop moves the tool, and no gap is reported during contact.
        simulation.step().unwrap();
        assert_eq!(simulation.contact_wrench().unwrap().gap, None);
        let touching = (0..3).map(|_| step(&mut simulation, at(0.0, 0.0095, 0.0))).last().unwrap();
        assert!(
            touching.wrench.force.y > 0.0 && touching.gap.is_none(),
            "contact must push upwards and report no gap: {touching:?}"
        );
        // Deep inside a body no way out is known, so no gap is reported.
        assert_eq!(step(&mut simulation, at(0.0, -0.03, 0.0)).gap, None);

        let mut simulation = opened(FLOOR, &sphere);
        let normal = DVec3::new(0.0, 0.8, 0.6);
        expect(&mut simulation, at(0.3, 0.01, 0.005), normal, 0.8 * 0.01 + 0.6 * 0.005 + 0.02 - RADIUS);
        assert_eq!(step(&mut simulation, at(0.0, 0.1, 0.0)).gap, None);
        // If there are two bodies, the gap is that to the nearer one.
        let mut simulation = opened(&format!("{}{FLOOR}", block("motion = \"fixed\"")), &sphere);
        expect(&mut simulation, at(0.0, 0.012, 0.0), DVec3::Y, 0.002);
        let farther = step(&mut simulation, at(0.0, 0.012, 0.0)).farther;
        let other = farther[0].expect("the half-space is farther away than the block, in another direction");
        assert!(other.normal.distance(normal) < 1e-6 && (other.distance - 0.0196).abs() < CLOSE, "{other:?}");
        assert_eq!(farther[1..], [None; FARTHER - 1]);
        expect(&mut simulation, at(0.0, 0.015, -0.03), normal, 0.8 * 0.015 - 0.6 * 0.03 + 0.02 - RADIUS);
        let wrench = step(&mut simulation, at(0.0, 0.03, -0.06));
        assert!(
            wrench.gap.is_some_and(|gap| gap.normal.distance(normal) < 1e-6 && gap.distance > 0.0)
                || wrench.gap.is_none()
        );
    }

    /// A sphere in the inner corner of a body with an L as its profile: the wall is nearest, and the floor is told too.
    /// Over the middle of a face, over an outer edge, and beside a corner there is one gap.
    #[test]
    fn in_a_corner_each_face_has_its_gap() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("corner.obj");
        let profile = [[-0.04, -0.02], [0.04, -0.02], [0.04, 0.0], [-0.02, 0.0], [-0.02, 0.04], [-0.04, 0.04]];
        let mut text = String::new();
        for z in [-0.04, 0.04] {
            profile.iter().for_each(|[x, y]| text.push_str(&format!("v {x} {y} {z}\n")));
        }
        for k in 0..6 {
            let (a, b) = (k + 1, (k + 1) % 6 + 1);
            text.push_str(&format!("f {a} {b} {} {}\n", b + 6, a + 6));
        }
        text.push_str("f 4 3 2 1\nf 6 5 4 1\nf 7 8 9 10\nf 7 10 11 12\n");
        std::fs::write(&file, text).unwrap();
        let body = format!("[[body]]\nname = \"corner\"\nsurface = {file:?}\nmotion = \"fixed\"\n");
        let mut simulation = opened(&body, &format!("sphere = {RADIUS:?}"));
        let tool = at(-0.007, 0.015, 0.003);
        expect(&mut simulation, tool, DVec3::X, 0.003);
        let farther = step(&mut simulation, tool).farther;
        let floor = farther[0].expect("the floor is farther away than the wall");
        assert!(floor.normal.distance(DVec3::Y) < 1e-5 && (floor.distance - 0.005).abs() < CLOSE, "{floor:?}");
        assert_eq!(farther[1..], [None; FARTHER - 1]);
        // However the sphere is turned.
        let turned = RigidState { orientation: DQuat::from_rotation_arc(DVec3::ONE.normalize(), DVec3::NEG_Y), ..tool };
        let again = step(&mut simulation, turned).farther[0].expect("the floor, for a sphere that is turned");
        assert!(again.normal.distance(floor.normal) < 1e-5 && (again.distance - floor.distance).abs() < CLOSE);
        for alone in [at(0.025, 0.012, 0.003), at(0.047, 0.008, 0.003), at(-0.046, 0.047, -0.046)] {
            let wrench = step(&mut simulation, alone);
            assert!(wrench.gap.is_some() && wrench.farther == [None; FARTHER], "{wrench:?}");
        }
    }

    /// A bump, hollows and creases in a sheet of 9,800 triangles: the first gap is the way to the nearest place. Wherever a
    /// sphere over hollows and creases is moved to by 8 mm, it is in no wall of the step before unless it touches the
    /// sheet, within 0.3 mm; in a crease of 40 degrees each side has its gap.
    #[test]
    fn walls_are_where_a_hollow_is() {
        let folder = tempfile::tempdir().unwrap();
        // Name, height of the sheet, and number of gaps over its middle; 0: any.
        type Height = fn(f64, f64) -> f64;
        let shapes: [(&str, Height, usize); 5] = [
            ("flat", |_, _| 0.0, 1),
            ("bump", |x, z| -(x * x + z * z) / 0.06, 1),
            ("bowl", |x, z| (x * x + z * z) / 0.06, 0),
            ("crease of 20 degrees", |x, _| 0.176 * x.abs(), 1),
            ("crease of 40 degrees", |x, _| 0.364 * x.abs(), 2),
        ];
        for (name, height, want) in shapes {
            let file = folder.path().join("sheet.obj");
            let (count, mut text) = (70, String::new());
            let at_grid = |i: usize| (i as f64 / count as f64 - 0.5) * 0.1;
            for (i, k) in (0..=count).flat_map(|i| (0..=count).map(move |k| (i, k))) {
                let (x, z) = (at_grid(i), at_grid(k));
                text.push_str(&format!("v {x} {} {z}\n", height(x, z)));
            }
            for (i, k) in (0..count).flat_map(|i| (0..count).map(move |k| (i, k))) {
                let corner = |i: usize, k: usize| i * (count + 1) + k + 1;
                let (a, b, c, d) = (corner(i, k), corner(i, k + 1), corner(i + 1, k + 1), corner(i + 1, k));
                text.push_str(&format!("f {a} {b} {c}\nf {a} {c} {d}\n"));
            }
            // Below the grid a wall on each side and a floor: a body that is closed.
            let side = |k: usize| [(k, 0), (count, k), (count - k, count), (0, count - k)];
            let rim: Vec<usize> = (0..4)
                .flat_map(|s| (0..count).map(move |k| side(k)[s]))
                .map(|(i, k)| i * (count + 1) + k + 1)
                .collect();
            let below = (count + 1) * (count + 1);
            for vertex in &rim {
                let (i, k) = ((vertex - 1) / (count + 1), (vertex - 1) % (count + 1));
                text.push_str(&format!("v {} -0.1 {}\n", at_grid(i), at_grid(k)));
            }
            text.push_str("v 0 -0.1 0\n");
            let middle = below + rim.len() + 1;
            for (k, vertex) in rim.iter().enumerate() {
                let (next, own) = ((k + 1) % rim.len(), below + k + 1);
                let other = below + next + 1;
                text.push_str(&format!(
                    "f {vertex} {} {other}\nf {vertex} {other} {own}\nf {own} {other} {middle}\n",
                    rim[next]
                ));
            }
            std::fs::write(&file, text).unwrap();
            let body = format!("[[body]]\nname = \"sheet\"\nsurface = {file:?}\nmotion = \"fixed\"\n");
            let mut simulation = opened(&body, &format!("sphere = {RADIUS:?}"));
            // Distance of a sphere's surface from the sheet, to a tenth of a millimetre.
            let clearance = |at: DVec3| {
                let points =
                    (0..=400).flat_map(|i| (0..=400).map(move |k| [i, k].map(|j| (f64::from(j) / 400.0 - 0.5) * 0.1)));
                let least =
                    points.map(|[x, z]| DVec3::new(x, height(x, z), z).distance(at)).fold(f64::INFINITY, f64::min);
                least - RADIUS
            };
            for (x, z) in [(0.0, 0.0), (0.004, 0.003), (-0.006, 0.008)] {
                let mut tool = at(x, height(x, z) + 0.02, z);
                tool.position.y -= clearance(tool.position) - 0.002;
                let wrench = step(&mut simulation, tool);
                let nearest = wrench.gap.unwrap_or_else(|| panic!("{name}: no gap at {}", tool.position));
                let free = clearance(tool.position);
                assert!((nearest.distance - free).abs() < 1e-4, "{name}: {nearest:?}, {free} m are free");
                let found = wrench.gaps().count();
                assert!(want == 0 || found == want || (x != 0.0 && found <= want), "{name}: {found} gaps at {x}, {z}");
                // The wall over a bump is the plane at its top, which the skin falls away from.
                if name == "bump" {
                    continue;
                }
                for (sine, cosine) in (0..24).map(|k| (0.2618 * f64::from(k)).sin_cos()) {
                    for moved in [DVec3::new(sine, 0.0, cosine), DVec3::new(sine, -0.3, cosine)].map(|d| 0.008 * d) {
                        let depths = wrench.gaps().map(|gap| -gap.distance - gap.normal.dot(moved));
                        let depth = depths.fold(f64::NEG_INFINITY, f64::max);
                        let free = clearance(tool.position + moved);
                        assert!(depth < 3e-4 || free < 3e-4, "{name}: {depth} m in a wall, {free} m free");
                    }
                }
            }
        }
    }

    #[test]
    #[ignore = "long: 6 s"]
    fn bodies_that_move_are_where_the_step_leaves_them() {
        let sphere = format!("sphere = {RADIUS:?}");
        // The block is driven upwards by 0.2 m/s, and turns about y meanwhile.
        let keys = "motion = \"driven\"\nkeys = [[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], \
                    [1.0, 0.0, 0.2, 0.0, 0.0, 0.38268343236, 0.0, 0.92387953251]]";
        let mut simulation = opened(&block(keys), &sphere);
        for k in 1..=3 {
            expect(&mut simulation, at(0.0, 0.02, 0.0), DVec3::Y, 0.01 - 0.2 * STEP * f64::from(k));
        }
        // A block falls away in steps of implicit Euler: first a block with a dynamic core (which moves freely), then a
        // block without a core.
        let dynamic = block("motion = \"dynamic\"");
        let floating = dynamic.split("[[body.core]]").next().unwrap().to_string();
        for body in [dynamic, floating] {
            let mut simulation = opened(&body, &sphere);
            for k in 1..=3 {
                let fallen = 9.81 * STEP * STEP * f64::from(k * (k + 1) / 2);
                expect(&mut simulation, at(0.0, 0.015, 0.0), DVec3::Y, 0.005 + fallen);
            }
        }
    }

    #[test]
    fn a_cube_over_a_block_by_hand() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("cube.obj");
        let corners = (0..8).map(|k| [k & 1, k >> 1 & 1, k >> 2].map(|b| if b == 1 { 0.01 } else { -0.01 }));
        let mut text: String = corners.map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect();
        for face in ["1 3 4 2", "5 6 8 7", "1 2 6 5", "3 7 8 4", "1 5 7 3", "2 4 8 6"] {
            text.push_str(&format!("f {face}\n"));
        }
        std::fs::write(&file, text).unwrap();
        let tool = format!("surface = {file:?}");
        let mut simulation = opened(&format!("{}{FLOOR}", block("motion = \"fixed\"")), &tool);
        let gap = |simulation: &mut Simulation, tool: RigidState| step(simulation, tool).gap;
        let found = gap(&mut simulation, at(0.0, 0.015, 0.0)).unwrap();
        assert!(
            (found.distance - 0.005).abs() < CLOSE && found.normal.distance(DVec3::Y) < 1e-6,
            "gap of a cube 5 mm above the block: {found:?}"
        );
        // The cube stands on a corner, 10 mm times the square root of three below its centre.
        let turn = DQuat::from_rotation_arc(DVec3::ONE.normalize(), DVec3::NEG_Y);
        let tilted = RigidState { orientation: turn, ..at(0.0, 0.025, 0.0) };
        let found = gap(&mut simulation, tilted).unwrap();
        let want = 0.025 - 0.01 * 3f64.sqrt();
        assert!(
            (found.distance - want).abs() < CLOSE && found.normal.distance(DVec3::Y) < 1e-5,
            "gap of a cube on its corner: {found:?}"
        );
        // The cube is above the half-space, next to the block.
        let beside = RigidState { orientation: turn, ..at(0.3, 0.02, 0.0) };
        let found = gap(&mut simulation, beside).unwrap();
        let normal = DVec3::new(0.0, 0.8, 0.6);
        let local = turn.inverse() * normal;
        let want = 0.8 * 0.02 + 0.02 - 0.01 * (local.x.abs() + local.y.abs() + local.z.abs());
        assert!(
            (found.distance - want).abs() < CLOSE && found.normal.distance(normal) < 1e-6,
            "gap of a cube over the half-space {found:?}, expected {want} m"
        );
        // A corner lies in the block at the end of the step: no way out is known, so no gap is reported.
        let fast = RigidState { velocity: DVec3::Y * -2.0, orientation: turn, ..at(0.3, 0.0, 0.0) };
        let fast = RigidState { position: DVec3::new(0.003, 0.0225, 0.001), ..fast };
        assert_eq!(gap(&mut simulation, fast), None);
        assert_eq!(gap(&mut simulation, at(0.0, 0.1, 0.0)), None);
    }
}
