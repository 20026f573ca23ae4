//! Twins of the structures in shaders/shared/types.glsl (scalar block layout). A vk-test compares every offset.

mod solver;

use bytemuck::{Pod, Zeroable};

pub use solver::{Iteration, Joint, Rigid, RigidIterate, Solve};

/// No element.
pub const NONE: u32 = u32::MAX;

/// One step's inputs.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct StepParams {
    /// s.
    pub dt: f32,
    /// Residual to stop at.
    pub tolerance: f32,
    /// Iterations at most.
    pub max_iterations: u32,
    /// Linearisations of elasticity in a step.
    pub newton: u32,
    /// m/s^2.
    pub gravity: [f32; 3],
    /// m.
    pub depth_limit: f32,
    /// Edge of the squares of the depth stage, m; 0: from the skins.
    pub texel: f32,
    /// 1: a loop holds the tool, and asks for the wrench's stiffness and damping.
    pub is_held: u32,
    /// Coefficient.
    pub friction: f32,
    /// Speed below which it is viscous, m/s.
    pub friction_speed: f32,
    /// Operator of the tool's twist without contact; of a held core its coupling alone.
    pub tool_matrix: [f32; 36],
    /// Right-hand side of the same.
    pub tool_rhs: [f32; 6],
    /// Twist at the start.
    pub tool_twist: [f32; 6],
    /// m, relative to the origin.
    pub tool_centre: [f32; 3],
}

/// Placement of a body's frame.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
pub struct Frame {
    /// Quaternion x y z w, frame to world.
    pub rotation: [f32; 4],
    /// m, relative to the origin.
    pub centre: [f32; 3],
    /// m/s.
    pub linear: [f32; 3],
    /// rad/s.
    pub angular: [f32; 3],
    /// Quaternion of R1^T R0: how the start lies in the frame at the end of the step.
    pub turn: [f32; 4],
    /// Of a dynamic core: what its spin gives to its momentum over the step, N m s.
    pub gyroscopic: [f32; 3],
    /// The dynamic core that it is, or [`NONE`].
    pub core: u32,
}

/// Where points of one frame are in another.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
pub struct Link {
    /// Quaternion x y z w.
    pub turn: [f32; 4],
    /// m; zero while both are as placed.
    pub offset: [f32; 3],
}

/// What the host fits a floating frame from: sums over its nodes.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub struct Fit {
    /// m d, frame axes, kg m.
    pub shift: [f32; 3],
    /// m r x d, frame axes, kg m^2.
    pub twist: [f32; 3],
    /// m v, world axes, kg m/s.
    pub momentum: [f32; 3],
    /// m (x - centre) x v, world axes, kg m^2/s.
    pub spin: [f32; 3],
}

/// Two bodies that may touch.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
pub struct Pair {
    /// Into the pairs of proxies.
    pub first_proxy_pair: u32,
    /// Pairs of proxies.
    pub proxy_pair_count: u32,
    /// Of a and b.
    pub first_proxy: [u32; 2],
    /// Of a and b.
    pub proxy_count: [u32; 2],
    /// A [`Slot`] each proxy of a, and of b.
    pub first_slot: [u32; 2],
    /// N/m^3.
    pub stiffness: f32,
    /// N s/m^3.
    pub damping: f32,
    /// 1: a is the tool or the body that is held, -1: b is, 0: neither.
    pub tool_sign: f32,
    /// b is a half-space.
    pub is_plane: u32,
    /// The driven frame of a and b where their skins are rigid, or [`NONE`].
    pub driven_frame: [u32; 2],
    /// 0: vertices of both gather contacts; 1: a's alone, 2: b's alone.
    pub lone_side: u32,
    /// w not 0: the normal to use, whatever culling finds.
    pub direction: [f32; 4],
    /// Unit normal, offset relative to the origin.
    pub plane: [f32; 4],
}

/// A convex hull on a frame.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
pub struct Proxy {
    /// Frame it rides on.
    pub frame: u32,
    /// Hull vertices.
    pub hull_first: u32,
    /// Hull vertices.
    pub hull_count: u32,
    /// Face planes.
    pub face_first: u32,
    /// Face planes.
    pub face_count: u32,
    /// Chunks of the skin it owns.
    pub chunk_first: u32,
    /// Chunks of the skin it owns.
    pub chunk_count: u32,
    /// Nodes that move it.
    pub node_first: u32,
    /// Nodes that move it.
    pub node_count: u32,
    /// m.
    pub margin: f32,
    /// Greatest sum of absolute weights.
    pub weight_bound: f32,
    /// Mean length of its triangles' edges at rest, m.
    pub edge: f32,
}

/// A proxy's bounds this step.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub struct ProxyBounds {
    /// Least corner of the hull's box.
    pub low: [f32; 3],
    /// m.
    pub inflation: f32,
    /// Greatest corner.
    pub high: [f32; 3],
    /// Half the box's diagonal, m.
    pub radius: f32,
}

/// At most [`CHUNK_VERTICES`] skin vertices of a proxy with their triangles.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub struct Chunk {
    /// Of the rest box, in the proxy's frame, m.
    pub centre: [f32; 3],
    /// Its first two axes; the third is their cross product.
    pub axes: [[f32; 3]; 2],
    /// Along them, m.
    pub half_extent: [f32; 3],
    /// Greatest sum of absolute weights.
    pub weight_bound: f32,
    /// Skin vertices: first those it owns, then what their triangles and normals need besides.
    pub vertex_first: u32,
    /// Vertices it owns.
    pub vertex_count: u32,
    /// All of them.
    pub embed_count: u32,
    /// Triangles it owns.
    pub triangle_first: u32,
    /// Triangles it owns.
    pub triangle_count: u32,
    /// Nodes that move it.
    pub node_first: u32,
    /// Nodes that move it.
    pub node_count: u32,
}

/// Vertices of a chunk at most.
pub const CHUNK_VERTICES: usize = 64;
/// Triangles of a chunk at most.
pub const CHUNK_TRIANGLES: usize = 128;
/// Regions that a pair of bodies can have.
pub const PAIR_REGIONS: usize = 4;

/// A proxy's part in a pair of bodies.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub struct Slot {
    /// The pair.
    pub pair: u32,
    /// 0: of a, 1: of b.
    pub side: u32,
    /// The proxy.
    pub proxy: u32,
    /// Room for its active chunks.
    pub chunk_first: u32,
}

/// Where, and in which direction, a pair of bodies may touch.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub struct Region {
    /// Unit, from a to b.
    pub normal: [f32; 3],
    /// First tangent.
    pub tangent: [f32; 3],
    /// Second tangent.
    pub bitangent: [f32; 3],
    /// Least corner of what both sides cover in common along the tangents, m.
    pub low: [f32; 2],
    /// Greatest corner, m.
    pub high: [f32; 2],
    /// Edge of the squares in which vertices of a and of b are binned, m.
    pub cell: [f32; 2],
    /// 0: nothing may touch.
    pub weight: f32,
    /// How far the normal turned since the last step, rad.
    pub turn: f32,
}

/// A chunk that may touch.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub struct ActiveChunk {
    /// The chunk.
    pub chunk: u32,
    /// Its proxy's slot.
    pub slot: u32,
    /// 2 * pair + side.
    pub side: u32,
    /// A bit each of the pair's regions.
    pub regions: u32,
    /// A work item each bit.
    pub first_item: u32,
}

/// Counters of the step.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub struct Counts {
    /// Active chunks.
    pub chunks: u32,
    /// Chunks times their regions.
    pub items: u32,
    /// The first of the chunks: those whose vertices gather contacts.
    pub gathering: u32,
    /// Slots whose chunks were looked at.
    pub slots_met: u32,
    /// Crossings found.
    pub hits: u32,
    /// Chunks that were asked for contacts.
    pub chunks_asked: u32,
    /// Contacts.
    pub contacts: u32,
    /// Entries of the transposed contact index.
    pub entries: u32,
    /// Contacts dropped because they would pull.
    pub pulling: u32,
    /// Bits of the largest turn of a region's normal, rad.
    pub turn: u32,
    /// Contacts of the last step.
    pub last_contacts: u32,
    /// Flags as in the trace.
    pub flags: u32,
}

/// A colliding skin vertex.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub struct Contact {
    /// Unit, from a to b.
    pub normal: [f32; 3],
    /// Projected, with its side's weight, m^2.
    pub area: f32,
    /// From the tool's centre to where the contact acts on it, m.
    pub arm: [f32; 3],
    /// As in [`Pair`].
    pub tool_sign: f32,
    /// m.
    pub depth: f32,
    /// At the start, m/s.
    pub rate: f32,
    /// N/m^3; 0: dropped.
    pub stiffness: f32,
    /// N s/m^3.
    pub damping: f32,
    /// Of the tangential velocity at the end of the step, N s/m; 0: none.
    pub friction: f32,
    /// Tangential part of v1 - v2 at the start, m/s.
    pub slip: [f32; 3],
    /// Groups of four entries: at most 4.
    pub quads: u32,
    /// Skin vertex.
    pub vertex: u32,
    /// As in [`ActiveChunk`].
    pub side: u32,
    /// Opposing triangle or [`NONE`].
    pub triangle: u32,
    /// Weights of its second and third corner.
    pub barycentric: [f32; 2],
}

/// What the host reads back.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Report {
    /// 0 done, or one of [`verdict`].
    pub verdict: u32,
    /// Done.
    pub iterations: u32,
    /// Recomputed.
    pub residual: f32,
    /// What f32 can reach.
    pub residual_floor: f32,
    /// Contacts of both sides.
    pub contacts: u32,
    /// m.
    pub max_depth: f32,
    /// The largest turn of a region's normal in the step, rad.
    pub turn: f32,
    /// As in the trace.
    pub flags: u32,
    /// On the tool, N.
    pub force: [f32; 3],
    /// About its centre, N m.
    pub torque: [f32; 3],
    /// Sizes of the contacts' forces along their normals, summed, N.
    pub pressing: f32,
    /// Change of its twist.
    pub tool_change: [f32; 6],
    /// Upper triangle by rows, N/m.
    pub stiffness: [f32; 21],
    /// Upper triangle by rows, N s/m.
    pub damping: [f32; 21],
}

/// Chunks of a proxy that the tool may touch.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub struct SkinPart {
    /// The proxy.
    pub proxy: u32,
    /// The first of the chunks.
    pub chunk_first: u32,
    /// How many.
    pub chunk_count: u32,
    /// Least corner of what holds their boxes at rest, in the proxy's frame, m.
    pub low: [f32; 3],
    /// Greatest corner.
    pub high: [f32; 3],
}

/// The shortest way from the tool to such a part at the end of the step: from a sphere's centre, from any other tool's surface.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub struct SkinGap {
    /// To what faces the tool, world axes, m.
    pub way: [f32; 3],
    /// Where it ends, of the skin or of the tool; [`NONE`]: nothing is near.
    pub triangle: u32,
    /// Length of the shortest met to what faces away, m.
    pub back: f32,
}

/// Verdicts of [`Report`].
pub mod verdict {
    /// The recorded iterations ran out.
    pub const CONTINUE: u32 = 1;
    /// Contacts pulled and were dropped: solve again.
    pub const RETRY: u32 = 2;
    /// Not finite, or worth nothing: the state stays as it was.
    pub const FAILED: u32 = 3;
    /// Solved: linearise elasticity where that leads, solve again.
    pub const RELINEARISE: u32 = 4;
}
