// Structures that several kernels share. The build makes Rust structs and constants of these and of
// others in this folder (shaders/build).
// Scalar block layout throughout. Positions are world axes relative to the step's origin (chosen by the host next to the
// tool, so that f32 loses nothing far from the world's origin). SI units.

const uint NONE = 0xffffffffu;

// One step's inputs, written by the host.
struct StepParams {
    float dt;                   // s
    float tolerance;            // residual to stop at
    uint max_iterations;
    uint newton;                // linearisations of elasticity in a step
    vec3 gravity;               // m/s^2
    float depth_limit;          // m
    float texel;                // edge of the squares of the depth stage, m; 0: from the skins
    uint is_held;               // 1: a loop holds the tool, and asks for the wrench's stiffness and damping
    float friction;             // mu
    float friction_speed;       // m/s; below it friction is viscous
    float tool_matrix[36];      // operator of the tool's twist without contact: inertia and virtual coupling; of a held core
                                // the coupling alone, its nodes have the inertia
    float tool_rhs[6];          // right-hand side of the same
    float tool_twist[6];        // linear (m/s) and angular (rad/s) velocity at the start; of a held core unused
    vec3 tool_centre;           // m, relative to the origin
};

// Placement of a frame at the start of the step, R0 and c0, and its motion over it; written by the host each step.
struct Frame {
    vec4 rotation;              // quaternion x y z w, frame to world
    vec3 centre;                // m, relative to the origin
    vec3 linear;                // (c1 - c0) / h, m/s
    vec3 angular;               // rad/s
    vec4 turn;                  // quaternion of R1^T R0: how the start lies in the frame at the end
    vec3 gyroscopic;            // of a dynamic core: what its spin gives to its momentum over the step, N m s
    uint core;                  // the dynamic core that it is, whose motion the solver finds, or NONE; then linear and angular
                                // are its twist at the start, and turn means nothing
};

// A rigid body among the unknowns: a dynamic core, and after those the tool. Its six unknowns are the change of its twist
// (linear, then angular; world axes), on which the nodes that a core carries hang.
struct Rigid {
    uint frame;                 // of a core
    uint node_first, node_count;            // into block_nodes
    uint block_first, block_count;          // blocks of those nodes
    uint slot_first;            // of their modes
    vec3 hinge;                 // unit axis through its centre that is all it may turn about, world; zero: it moves freely
    uint joint_first, joint_count;          // into joint_sides
    uint group_first, group_count;          // the rigid bodies that joints join to it, itself included
    uint parent;                // the one of its group that it hangs on, or NONE
    uint inverse_first;         // of its group's inverse, into rigid_inverses
    float rounding;             // e . M^-1 e, e the magnitudes that b is made of
    float b[6];
    float image[6];             // before the loop A x, after it b - A x
    float leftover[6];          // b - A x of the last accepted step
};

// What iterations change of it. There are two sets: an iteration reads one and writes the other.
struct RigidIterate {
    float x[6];
    float r[6];
    float u[6];                 // M^-1 r
    float p[6];
    float s[6];                 // A p
};

// A ball joint of which a dynamic core is a side. Both sides feel it at one point between them, so that neither force nor
// torque appears from nothing. Written by the host each step.
struct Joint {
    uint rigid[2];              // its sides; NONE: one whose motion is known
    vec3 arm[2];                // from the centre of each to the joint, world axes, m
    float linear;               // h^2 k, kg
    float angular[6];           // h^2 K + h D of the relative spin: xx yy zz, xy xz yz, world axes, kg m^2
    vec3 impulse;               // on the first side, N s
    vec3 twist;                 // on the first side besides, N m s
};

// An elastic material. `more` is room for the parameters of a law that needs others than mu and lambda.
struct ElasticMaterial {
    float mu;                   // of small strain, Pa
    float lambda;
    uint law;                   // LAW_* of shared/material_law.glsl
    float damping;              // beta, s
    float more[4];
};

// Where a point of one frame is in another, x_to = r + offset + (Q - I) r + Q d, r relative to the centres at rest, so that
// nothing cancels; written by the host each step.
struct Link {
    vec4 turn;                  // Q, quaternion x y z w
    vec3 offset;                // m; zero while both are as placed
};

// What the host fits a floating frame from: sums over its nodes.
struct Fit {
    vec3 shift;                 // m d, frame axes
    vec3 twist;                 // m r x d, frame axes
    vec3 momentum;              // m v, world axes
    vec3 spin;                  // m (x - centre) x v, world axes
};

// Two bodies that may touch; b may be a half-space. Written by the host each step (the plane is relative to the origin).
struct Pair {
    uint first_proxy_pair;      // b's proxies fastest
    uint proxy_pair_count;
    uint first_proxy[2];        // proxies of a and b
    uint proxy_count[2];
    uint first_slot[2];         // a slot each proxy of a, and of b
    float stiffness;            // N/m^3
    float damping;              // N s/m^3
    float tool_sign;            // 1: a is the tool or the body that is held, -1: b is, 0: neither
    uint is_plane;
    uint driven_frame[2];       // of a and b where their skins are rigid, or NONE
    uint lone_side;             // 0: vertices of both gather contacts; 1: a's alone, 2: b's alone
    vec4 direction;             // w != 0: the normal to use, whatever culling finds
    vec4 plane;                 // unit normal, offset
};

// The slot of the s-th proxy of a pair, a's before b's.
uint slot_of(Pair pair, uint s) {
    uint a_count = pair.proxy_count[0];
    return s < a_count ? pair.first_slot[0] + s : pair.first_slot[1] + s - a_count;
}

bool gathers(Pair pair, uint side) { return pair.lone_side == 0 || pair.lone_side == side + 1; }

// A convex hull that rides on a frame.
struct Proxy {
    uint frame;
    uint hull_first, hull_count;
    uint face_first, face_count;
    uint chunk_first, chunk_count;          // of the skin it owns
    uint node_first, node_count;            // nodes that move it
    float margin;                           // how far the skin sticks out of the hull at rest, m
    float weight_bound;                     // greatest sum of absolute weights of an embedding
    float edge;                             // mean length of its triangles' edges at rest, m
};

// A proxy's bounds this step.
struct ProxyBounds {
    vec3 low;
    float inflation;            // margin and the largest displacement, m
    vec3 high;
    float radius;               // half the diagonal of the hull's box, m
};

// At most 64 skin vertices of a proxy with their triangles.
struct Chunk {
    vec3 centre;                // of the rest box, in the proxy's frame
    vec3 axes[2];               // its first two axes; the third is their cross product
    vec3 half_extent;           // along them
    float weight_bound;         // greatest sum of absolute weights
    uint vertex_first;          // first those it owns, then what their triangles and normals need besides
    uint vertex_count, embed_count;
    uint triangle_first, triangle_count;
    uint node_first, node_count;
};

const uint CHUNK_VERTICES = 64;
const uint CHUNK_TRIANGLES = 128;
// Regions that a pair of bodies can have.
const uint PAIR_REGIONS = 4;

// A proxy's part in a pair of bodies.
struct Slot {
    uint pair;
    uint side;                  // 0: of a, 1: of b
    uint proxy;
    uint chunk_first;           // room for its active chunks
};

// Where, and in which direction, a pair of bodies may touch.
struct Region {
    vec3 normal;                // unit, from a to b
    vec3 tangent;
    vec3 bitangent;
    vec2 low, high;             // what both sides cover in common along the tangents, m
    float cell[2];              // edge of the squares in which vertices of a and of b are binned, m
    float weight;               // 0: nothing may touch
    float turn;                 // how far the normal turned since the last step, rad
};

// A chunk that may touch, in the order of slots.
struct ActiveChunk {
    uint chunk;
    uint slot;
    uint side;                  // 2 * pair + (0: a, 1: b)
    uint regions;               // a bit each of the pair's
    uint first_item;            // a work item each bit
};

// Counters of the step; flags as in the trace.
struct Counts {
    uint chunks;                // active
    uint items;                 // chunks times their regions
    uint gathering;             // the first of the chunks: those whose vertices gather contacts
    uint slots_met;             // whose chunks were looked at
    uint hits;                  // crossings found
    uint chunks_asked;          // for contacts
    uint contacts;
    uint entries;               // of the transposed contact index
    uint pulling;               // contacts dropped because they would pull
    uint turn;                  // bits of the largest turn of a region's normal, rad
    uint last_contacts;         // of the last step
    uint flags;
};

// A colliding skin vertex.
struct Contact {
    vec3 normal;                // unit, from a to b
    float area;                 // projected, with its side's half weight, m^2
    vec3 arm;                   // from the tool's centre to where the contact acts on it, m
    float tool_sign;
    float depth;                // m
    float rate;                 // normal . (v1 - v2) at the start, m/s
    float stiffness;            // N/m^3
    float damping;              // N s/m^3; a dropped contact has stiffness = damping = friction = 0
    float friction;             // c: friction is -c times the tangential part of v1 - v2 at the end of the step, N s/m
    vec3 slip;                  // that part at the start, m/s
    uint quads;                 // groups of four entries in use: 1 to 4
    uint vertex;                // skin vertex
    uint side;                  // as in ActiveChunk
    uint triangle;              // opposing, NONE: a plane
    vec2 barycentric;           // of the opposing point: weights of its second and third corner
};

// State of the linear solver that lives on the device between passes.
struct Solve {
    float warm;                 // factor on the last solution
    float rhs_norm2;            // b . M^-1 b
    float floor_norm2;          // what f32 rounding leaves of it
    uint status;                // STATUS_*
    uint current;               // the set that holds the newest iterate
    uint retries;               // how often it was solved again without the contacts that pulled
    uint linearisations;        // how often elasticity was linearised again in this step
};

// Scalars of an iteration, of which there are two sets as well.
struct Iteration {
    float gamma;                // r . M^-1 r
    float alpha;
    uint count;                 // iterations done
};

// Numbers of rigid_blocks, a dynamic core.
const uint CORE_NUMBERS = 72;

const uint STATUS_RUNNING = 0;      // not converged yet
const uint STATUS_CONVERGED = 1;
const uint STATUS_STOPPED = 2;      // at max_iterations
const uint STATUS_BROKEN = 3;       // the operator seems not positive, or something is no number

// What the host reads back after the step.
struct Report {
    uint verdict;               // VERDICT_*
    uint iterations;
    float residual;             // recomputed from b - A x
    float residual_floor;       // what f32 can reach
    uint contacts;
    float max_depth;            // m
    float turn;                 // the largest of a region's normal in the step, rad
    uint flags;
    float force[3];             // on the tool, N
    float torque[3];            // about its centre, N m
    float pressing;             // forces along the normals, sizes summed, N
    float tool_change[6];       // of its twist
    float stiffness[21];        // contact stiffness seen by the tool, upper triangle by rows
    float damping[21];
};

// Chunks of a proxy that the tool may touch.
struct SkinPart {
    uint proxy;
    uint chunk_first, chunk_count;
    vec3 low, high;             // what holds their boxes at rest, in the proxy's frame, m
};

// The shortest way from the tool to such a part at the end of the step, for the host: from a sphere's centre, from any other
// tool's surface.
struct SkinGap {
    vec3 way;                   // to what faces the tool, world axes, m
    uint triangle;              // where it ends, of the skin or of the tool; NONE: nothing is near
    float back;                 // length of the shortest met to what faces away, m
};

// Where no way was found, its length, m.
const float GAP_FAR = 3.0e38;

const uint VERDICT_DONE = 0;
const uint VERDICT_CONTINUE = 1;    // the recorded iterations ran out
const uint VERDICT_RETRY = 2;       // contacts pulled: dropped, solve again
const uint VERDICT_FAILED = 3;      // not finite, or worth nothing: the state stays
const uint VERDICT_RELINEARISE = 4; // solved: linearise elasticity where that leads, solve again

const uint FLAG_NOT_CONVERGED = 1;
const uint FLAG_REGION_OVERFLOW = 2;
const uint FLAG_CONTACT_OVERFLOW = 4;
const uint FLAG_DEPTH_LIMIT = 8;
const uint FLAG_NOT_HEIGHT_FIELD = 16;
const uint FLAG_NON_FINITE = 32;
const uint FLAG_PULLING = 256;
const uint FLAG_INVERTED = 1024;
