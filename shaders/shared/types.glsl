// Structures and constants that several kernels share. The build script (shaders/build) makes Rust structs and
// constants of them, and of those in the other files of this folder; the comments become their Rust documentation.
//
// All structures have scalar block layout. Positions are in world axes, relative to the step's origin, which the host
// (CPU side) chooses next to the tool, so that f32 loses no digits far from the world's origin. Units are SI; h is the
// length of the step, s.
//
// A soft body is a skin (high-resolution surface mesh) embedded in a layer (tetrahedral simulation mesh), some of whose
// nodes may be attached to rigid cores inside it. A core is dynamic if the solver finds its motion, kinematic if its
// motion is prescribed. The tool is the rigid body that the haptic device leads. A frame is the rigid coordinate frame
// of a core or of a body. A proxy is a convex collision proxy that covers part of a skin; a pair proxy is one proxy in
// one pair of bodies. A chunk is a group of at most 64 skin vertices with their triangles, which culling keeps or drops
// as a whole. A contact patch is a column of space in which two bodies a and b may touch, with one contact normal; a
// work item is a chunk in one contact patch. A side is body a or b of a pair. A, b and x are the linear solver's
// operator, right-hand side and solution (changes of velocity), M its preconditioner. A block is a set of nodes that
// one workgroup of the solver works on; its modes are affine motions of these nodes, the basis of M's coarse space.

const uint NONE = 0xffffffffu;  // index that stands for nothing
const uint MOST_TOOLS = 4;      // most tools of a scene

// A dynamic core that a haptic device holds as a tool, through a virtual coupling (spring and damper).
struct HeldCore {
    uint core;                  // its index among the dynamic cores
    float matrix[36];           // 6x6 operator of the coupling; the core's nodes have the inertia
    float rhs[6];               // right-hand side that belongs to the matrix, N s and N m s
    vec3 centre;                // the core's centre at the start, m, relative to the origin
};

// Inputs of one step, written by the host.
struct StepParams {
    float dt;                   // length h of the step, s
    float tolerance;            // relative residual at which conjugate gradients stop
    float loosest;              // relative residual above which they do not stop, however small the error is
    uint max_iterations;        // conjugate gradient iterations at most
    uint newton;                // Newton iterations of a step; 1: elasticity is linearised once
    vec3 gravity;               // m/s^2, world axes
    float depth_limit;          // penetration depth above which a contact raises FLAG_DEPTH_LIMIT, m
    float texel;                // edge of the spatial hash's cells, m; 0: chosen from the edge lengths of the skins
    uint wants_stiffness;               // 1: a haptic loop moves the tool, and needs the contact stiffness and damping
                                        // that the tool feels
    float friction;             // Coulomb's coefficient mu
    float friction_speed;       // sliding speed below which friction is viscous, m/s
    float tool_matrix[36];      // 6x6 operator of the rigid tool's twist without contact: inertia and virtual coupling
    float tool_rhs[6];          // right-hand side that belongs to tool_matrix, N s and N m s
    float tool_twist[6];        // linear (m/s) and angular (rad/s) velocity of the rigid tool at the start
    vec3 tool_centre;           // centre of the rigid tool, or of the first held core, at the start, m, relative to the
                                // origin
    HeldCore held[MOST_TOOLS];  // the dynamic cores that haptic devices hold, in the order of the tools
};

// A rigid coordinate frame: its rotation R0 and centre c0 at the start of the step, and its motion to R1 and c1 at the
// end; written by the host each step.
struct Frame {
    vec4 rotation;              // R0, quaternion x y z w, frame to world
    vec3 centre;                // c0, m, relative to the origin
    vec3 linear;                // (c1 - c0) / h, m/s
    vec3 angular;               // angular velocity, rad/s, world axes
    vec4 turn;                  // quaternion of R1^T R0, from the frame's axes at the start to those at the end
    vec3 gyroscopic;            // angular momentum that a dynamic core's spin gains by gyroscopic torque, N m s
    uint core;                  // the dynamic core whose frame this is, or NONE; the solver finds that core's motion,
                                // so linear and angular are its twist at the start, and turn has no meaning
    uint unused[3];             // fills the sixth texel (shared/frame.glsl)
};

// A rigid body among the solver's unknowns: a dynamic core or, after all dynamic cores, the tool. Its six unknowns are
// the change of its twist over the step (linear, then angular; world axes). The nodes attached to a core move with it.
struct Rigid {
    uint frame;                 // frame of a core
    uint node_first, node_count;            // nodes attached to the body, a range of block_nodes
    uint block_first, block_count;          // blocks of these nodes
    uint first_coarse_index;            // index of its first block's modes among the modes of all blocks
    vec3 hinge;                 // unit axis, in world axes, of a hinge through the centre, about which alone the body
                                // turns; zero: no hinge
    uint joint_first, joint_count;          // sides of joints that are on this body, a range of joint_sides
    uint group_first, group_count;          // its group: a range of rigid bodies, those that joints connect
    uint parent;                // rigid body that is its parent in the tree of the group's joints, or NONE
    uint inverse_first;         // where the inverse of its group's diagonal block of A begins in rigid_inverses
    float rounding;             // e . D^-1 e in its rows: D is the diagonal of A, e sums magnitudes of the terms of b
    float b[6];                 // right-hand side of its six rows, N s and N m s
    float operator_product[6];             // operator product A x of the last solution, then the residual b - A x
    float trend_product[6];             // operator product of the last two solutions' difference
    float linear_residual[6];           // b - A x of the last Newton iteration
    float carried_residual[6];          // b - A x of the last accepted step, which the next step's b includes
};

// A node of a soft body, where supports hold nodes or reactions are reported (shared/support.glsl).
struct Supported {
    vec4 left;                  // xyz: unit normal of the plane, or unit direction of the line, that supports leave to it,
                                // world axes; w: SUPPORT_*
    vec3 taken;                 // what its supports take from its right-hand side, N s
    vec3 impulse;               // impulse that holds it in the step, N s
};

// The part of a rigid body's state that conjugate gradient iterations change. There are two sets: an iteration reads
// one and writes the other.
struct RigidIterate {
    float x[6];                 // iterate: the change of twist
    float r[6];                 // residual
    float u[6];                 // M^-1 r
    float p[6];                 // search direction
    float s[6];                 // A p
};

// A ball joint with a dynamic core on at least one side. Its force acts on both sides at one point between them, so
// that momentum and angular momentum are conserved. Written by the host each step.
struct Joint {
    uint rigid[2];              // rigid bodies on its two sides; NONE: the motion of that side is prescribed
    vec3 arm[2];                // from the centre of each side to the joint, world axes, m
    float linear;               // h^2 k of the spring (stiffness k) that joins the two sides, kg
    float angular[6];           // h^2 K + h D (rotational stiffness K and damping D): xx yy zz, xy xz yz, world axes,
                                // kg m^2
    vec3 impulse;               // impulse of that spring on the first side, opposite to that on the second, N s
    vec3 twist;                 // angular impulse of the springs that resist rotation, on the first side, N m s
};

// An elastic material.
struct ElasticMaterial {
    float mu;                   // shear modulus at small strain, Pa
    float lambda;               // Lame's first parameter at small strain, Pa
    uint law;                   // material law, LAW_* of shared/material_law.glsl
    float damping;              // stiffness-proportional damping beta, s
    float more[4];              // parameters of a law that needs others than mu and lambda
};

// Placement of one frame relative to another. A node that lies at r from its own frame's centre at rest, displaced by
// d, has the displacement offset + (Q - I) r + Q d from its rest place in the other frame: only small terms are added.
// Written by the host each step.
struct Link {
    vec4 turn;                  // Q, quaternion x y z w
    vec3 offset;                // m; zero while both frames are where the scene placed them
    float unused;               // fills the second texel (shared/link.glsl)
};

// Sums over the nodes of a soft body without cores, from which the host fits the body's frame to them. A node has mass
// m, rest position r and displacement d in the frame, and position y and velocity v in the world.
struct Fit {
    vec3 shift;                 // sum m d, frame axes, kg m
    vec3 twist;                 // sum m r x d, frame axes, kg m^2
    vec3 momentum;              // sum m v, world axes, kg m/s
    vec3 spin;                  // sum m (y - centre) x v, world axes, kg m^2/s
};

// A pair of bodies a and b that may touch; b may be a half-space. Written by the host each step, because the half-space
// is relative to the origin.
struct Pair {
    uint first_proxy_pair;      // first of its pairs of proxies (one of a, one of b), ordered by a's, then by b's
    uint proxy_pair_count;
    uint first_proxy[2];        // first collision proxy of a and of b
    uint proxy_count[2];
    uint first_pair_proxy[2];         // first pair proxy of a and of b; each of their proxies has one
    float stiffness;            // penalty stiffness k, N/m^3
    float damping;              // penalty damping d, N s/m^3
    float tool_sign;            // 1: a is a tool or a body that a haptic device holds, -1: b alone is, 0: neither
    uint tools[2];              // indices of a and of b among the tools, or NONE
    uint is_plane;              // 1: b is a half-space
    uint kinematic_frame[2];       // frame of a and of b where these are rigid and kinematic, or NONE
    uint lone_side;             // which skin is tested for contact; 0: both sides, 1: that of a alone, 2: that of b alone
    uint by_triangles;          // 1: the triangles of the lone side are tested, 0: vertices; the other side is then rigid
                                // and has one proxy
    uint stiffens_tips;         // 1: k of a contact by triangles is multiplied by the stiffening of the rigid side
    uint damps_tips;            // 1: so is d
    vec4 direction;             // prescribed contact normal, in place of one from culling; w = 0: none is prescribed
    vec4 plane;                 // unit normal and offset (m) of the half-space's boundary
};

// Index of the pair proxy of the s-th proxy of a pair of bodies, counted from 0, a's proxies before b's.
uint pair_proxy_of(Pair pair, uint s) {
    uint a_count = pair.proxy_count[0];
    return s < a_count ? pair.first_pair_proxy[0] + s : pair.first_pair_proxy[1] + s - a_count;
}

// Whether the skin of a side (0: a, 1: b) is tested for contact.
bool gathers(Pair pair, uint side) { return pair.lone_side == 0 || pair.lone_side == side + 1; }

// Whether rays run from the vertices of a side (0: a, 1: b) to the triangles of the other.
bool casts_rays(Pair pair, uint side) { return pair.is_plane == 0 && pair.by_triangles == 0 && gathers(pair, side); }

// A convex collision proxy: a hull that moves with a frame and covers part of a skin.
struct Proxy {
    uint frame;
    uint hull_first, hull_count;            // vertices of the hull
    uint face_first, face_count;            // face planes of the hull
    uint chunk_first, chunk_count;          // chunks of the proxy's part of the skin
    uint node_first, node_count;            // nodes that move these chunks, a range of proxy_nodes
    float margin;                           // how far the skin sticks out of the hull at rest, m
    float weight_bound;                     // greatest sum of absolute embedding weights of a skin vertex
    float edge;                             // mean edge length of the chunks' triangles at rest, m
};

// Bounds of a collision proxy in this step.
struct ProxyBounds {
    vec3 low;                   // least corner of the hull's box, world axes, m
    float inflation;            // how far the skin may lie outside the hull: margin and displacements, m
    vec3 high;                  // greatest corner of that box, world axes, m
    float radius;               // half the diagonal of that box, m
};

// A chunk: at most 64 skin vertices of a proxy with their triangles, which culling keeps or drops as a whole.
struct Chunk {
    vec3 centre;                // centre of its box at rest, in the proxy's frame, m
    vec3 axes[2];               // the box's first two axes; the third is their cross product
    vec3 half_extent;           // half the box's size along its axes, m
    float weight_bound;         // greatest sum of absolute embedding weights of a vertex
    uint vertex_first;          // start of its vertex list: its own, then others that its triangles and normals need
    uint vertex_count, embed_count;         // number of its own vertices; number of all vertices in the list
    uint triangle_first, triangle_count;
    uint node_first, node_count;            // nodes that move the chunk, a range of chunk_nodes
};

const uint CHUNK_VERTICES = 64;     // most skin vertices of a chunk
const uint CHUNK_TRIANGLES = 128;   // most triangles of a chunk
const uint PAIR_PATCHES = 4;        // most contact patches of a pair of bodies

// How far a triangle of the gathering skin overlaps the other skin, seen along the normal of a contact patch.
struct Overlap {
    float area;                 // area of the overlap, projected along the normal, m^2
    float volume;               // integral of the depth over it, m^3
    vec2 barycentric;           // weights of the triangle's second and third corner at the centre of pressure
    vec3 push;                  // integral of the depth times a unit normal out of the gathering skin, world axes, m^3
    float deepest;              // greatest depth, m
    float stiffening;           // factor of the pair's contact stiffness
    uint vertex;                // a vertex of the triangle of the other skin with the greatest part of the volume
};

// A pair proxy: one collision proxy as a member of one pair of bodies.
struct PairProxy {
    uint pair;
    uint side;                  // the side of the pair to which the proxy belongs; 0: a, 1: b
    uint proxy;
    uint chunk_first;           // where its chunks begin in arrays with an entry for each chunk of each pair proxy
};

// A contact patch of a pair of bodies: a column of space in which they may touch, and the contact normal there.
struct ContactPatch {
    vec3 normal;                // unit, from a to b
    vec3 tangent;
    vec3 bitangent;
    vec2 low, high;             // rectangle along the tangents that the skins of both sides cover, m
    float cells_per_metre[2];   // 1 / cell size of the spatial hash of a's and of b's vertices, 1/m
    float weight;               // how strongly the bodies' proxies and contacts favour this normal; 0: no such patch
    float turn;                 // angle by which the normal turned since the last step, rad
    float unused[3];            // fills the fifth texel (shared/contact_patch.glsl)
};

// A chunk that passed culling. Active chunks are listed in the order of pair proxies.
struct ActiveChunk {
    uint chunk;
    uint pair_proxy;
    uint side;                  // 2 * pair + (0: the chunk is of body a, 1: of b)
    uint contact_patches;               // bit mask of the pair's contact patches in which the chunk may touch
    uint first_work_item;            // first of its work items, one for each of those patches
};

// Counters of the step, all on the GPU.
struct Counts {
    uint chunks;                // active chunks
    uint work_items;                 // work items, one for each active chunk and each contact patch in its bit mask
    uint gathering;             // active chunks whose vertices are tested for contact; they are listed first
    uint pair_proxies_met;             // workgroups of cull/meet that have finished
    uint hits;                  // ray hits found by the depth stage
    uint overlaps;              // overlaps of triangles found by the depth stage
    uint chunks_asked;          // workgroups of contact/candidates that have finished
    uint contacts;
    uint entries;               // entries in the lists of contacts by node; an entry is a contact and its weight
    uint turn;                  // largest rotation of a contact patch's normal since the last step, rad, as float bits
    uint last_contacts;         // contacts of the last step
    uint flags;                 // warnings of the step: bits FLAG_*
};

// A contact: one colliding skin vertex. Where triangles are tested for contact, the overlap of one triangle is kept as a
// contact of the other body's vertex with that triangle. The contact's point s1 on body a moves at v1, its point s2 on
// body b at v2.
struct Contact {
    vec3 normal;                // unit, from a to b
    float area;                 // area projected along the normal, halved where vertices of both sides are tested, m^2
    vec3 arm;                   // from tool_centre to the point where the contact acts on the tool, m
    float tool_sign;            // 1: a is a tool or a body that a haptic device holds, -1: b alone is, 0: neither
    float depth;                // penetration depth delta, m
    float rate;                 // delta' = normal . (v1 - v2) at the start, m/s
    float stiffness;            // k, N/m^3; negated where the contact was released in the present solve
    float damping;              // d, N s/m^3; after the solve a released contact has stiffness = damping = friction = 0
    float friction;             // c: friction is -c times the tangential part of v1 - v2 at the end of the step, N s/m
    vec3 slip;                  // tangential part of v1 - v2 at the start, m/s
    uint quads;                 // groups of four weighted nodes in use, 1 to 4
    uint vertex;                // the skin vertex
    uint side;                  // body to which the vertex belongs: 2 * pair + (0: a, 1: b)
    uint triangle;              // triangle of the opposing skin; NONE: a half-space
    vec2 barycentric;           // weights of the triangle's second and third corner at the contact's point on it
    vec2 unused;                // fills the sixth texel (shared/contact.glsl)
};

// State of the linear solver that stays on the GPU between passes (dispatches).
struct Solve {
    float warm_start[2];        // factors of the last solution and of the trend in the first iterate
    float rhs_norm2;            // b . M^-1 b
    float floor_norm2;          // part of rhs_norm2 that may be due to f32 rounding alone
    uint status;                // STATUS_*
    uint current;               // which of the two sets of iterates is the newest
    uint pulling[2];            // for each set of iterates: contacts under tension at its x, or 0 before these are counted
    uint newton_iterations;        // Newton iterations after the first in this step, counting the check after the last
    float first_norm2;          // rhs_norm2 of the first Newton iteration
    uint flags;                 // flags of the last Newton iteration's solve
    float energy_limit;         // e . A e above which iterations go on, with error e of the solution, J
    float normal_forces[2];     // sums of normal forces at the last step's end: of all tools' contacts, of others, N
    float stop_norm2;           // r . M^-1 r at which the iterations converged
    float solution_dt;          // length of the step whose changes of velocity the solution has, s; 0: it was rejected
};

const float UNLIMITED = 3.0e38;     // energy_limit where nothing touches, J

// Scalars of a conjugate gradient iteration. There are two sets: an iteration reads one and writes the other.
struct Iteration {
    float gamma;                // r . M^-1 r
    float alpha;                // step length along the search direction
    uint count;                 // iterations done
    uint fresh;                 // iterations since the search directions last began anew
    uint releases;              // how often contacts were released
    uint is_release;            // 1: the iteration that reads this releases contacts under tension
    vec4 energies;              // alpha gamma of the last four iterations, the latest first, J
    float change;               // energy of the difference from the last step's solution, as far as it is known, J
};

const uint MAX_RELEASES = 4;        // how often a solve releases contacts at most

const uint CORE_NUMBERS = 72;       // length of a dynamic core's data in rigid_blocks: two 6x6 matrices

const uint STATUS_RUNNING = 0;      // the solver has not converged yet
const uint STATUS_CONVERGED = 1;    // the residual is below the tolerance, and contact forces are accurate enough
const uint STATUS_STOPPED = 2;      // the solver reached max_iterations
const uint STATUS_BROKEN = 3;       // the operator seems not to be positive definite, or a number is NaN or infinite

// What the contacts do to a tool.
struct ToolWrench {
    float force[3];             // net force, N
    float torque[3];            // net torque about the tool's centre, N m
    float pressing;             // sum of the magnitudes of the normal forces, N
    float friction[3];          // friction, a part of `force`, N
    float stiffness[21];        // contact stiffness that the tool feels, upper triangle of the 6x6 matrix by rows
    float damping[21];          // contact damping that the tool feels, laid out like the stiffness
};

// Results that the host reads back after the step.
struct Report {
    uint verdict;               // whether the step is accepted, or how it must go on: one of VERDICT_*
    uint iterations;            // conjugate gradient iterations
    uint releases;              // how often the solver released contacts
    float residual;             // relative residual, recomputed from b - A x
    float residual_floor;       // least relative residual that f32 can reach
    float nonlinear_residual;   // residual of the nonlinear equations after several Newton iterations, relative to the
                                // step's first right-hand side
    uint contacts;
    float max_depth;            // greatest penetration depth of a contact, m
    float turn;                 // largest rotation of a contact patch's normal since the last step, rad
    uint flags;                 // warnings of the step: bits FLAG_*
    float tool_change[6];       // change of the tool's twist over the step, m/s and rad/s
    ToolWrench tools[MOST_TOOLS];           // in the scene's order
};

// A part of a skin that the tool may touch: some chunks of one proxy.
struct SkinPart {
    uint proxy;
    uint chunk_first, chunk_count;
    vec3 low, high;             // corners of the box around these chunks at rest, in the proxy's frame, m
};

// The shortest way from the tool to a SkinPart at the end of the step, for the host; for a spherical tool one of these
// for each sector of directions (see wrench/gap). It starts at the centre of a spherical tool, and at the surface of any
// other tool.
struct SkinGap {
    vec3 way;                   // vector to the nearest triangle that faces the tool, or to its plane, world axes, m
    uint triangle;              // nearest triangle, of the skin or of the tool; NONE: no triangle is near
    float back;                 // distance to the part's nearest triangle that faces away, m
};

const float GAP_FAR = 3.0e38;       // distance where nothing was found, m

const uint VERDICT_DONE = 0;        // the step is accepted
const uint VERDICT_CONTINUE = 1;    // the iterations recorded in the command buffers were too few: run more
const uint VERDICT_FAILED = 2;      // the solution is not finite, or its residual too large: the state stays as it was
const uint VERDICT_NEWTON = 3; // linearise at the solution, and solve again or, after the last solve, check its residual

const uint FLAG_NOT_CONVERGED = 1;      // the residual is well above both the tolerance and residual_floor
const uint FLAG_PATCH_OVERFLOW = 2;    // more contact patches or work items, or smaller hash cells, than supported
const uint FLAG_CONTACT_OVERFLOW = 4;   // too many contacts or ray hits for the arrays, or the driver cut off a loop
const uint FLAG_DEPTH_LIMIT = 8;        // a contact is deeper than depth_limit
const uint FLAG_NOT_HEIGHT_FIELD = 16;  // a skin folds over itself along the normal of a contact patch
const uint FLAG_NON_FINITE = 32;        // a number of the solution is NaN or infinite
const uint FLAG_TENSION = 256;          // contacts are under tension even after the last release
const uint FLAG_INVERTED = 1024;        // a tetrahedron is inside out, or its rotation was not found
const uint FLAG_NEWTON_NOT_CONVERGED = 2048;        // Newton iterations left much of the step's equations unsolved
