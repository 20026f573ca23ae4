// Indirect arguments of the dispatches of a step: each constant below is the index of a VkDispatchIndirectCommand
// (three words) in the buffer `args`. An earlier kernel writes the numbers of workgroups; for the solver's loop
// (conjugate gradient iterations) they are zero once the loop has ended. A collision proxy is a convex hull around part
// of a skin (a body's surface mesh), a pair proxy one proxy in one pair of bodies. A chunk is a group of at most 64
// skin vertices, culled as a whole; pairs, pair proxies and chunks that pass culling are active. A contact patch is a
// column of space where two bodies may touch, an F-bar patch a group of tetrahedra that share one volumetric strain. A
// block is a set of nodes of one soft body; a dynamic core is a rigid body inside a soft one, whose motion the solver
// finds; the tool is the rigid body that the haptic device leads. In a haptic loop wrench/gap finds the gap between the
// tool and each part of skin (some chunks of one proxy) that the tool may touch.

const uint ARGS_DIRECTION = 0;      // one workgroup for each active pair of collision proxies
const uint ARGS_CHUNKS = 1;         // one workgroup for each active pair proxy
const uint ARGS_ACTIVE = 2;         // one workgroup for each active chunk
const uint ARGS_WORK_ITEMS = 3;          // one workgroup for each active chunk and each of its contact patches
const uint ARGS_DEEPEST = 4;        // one workgroup of contact/deepest; none if all contacts fit into their arrays
const uint ARGS_CONTACTS = 5;       // one invocation for each contact
const uint ARGS_NODES = 6;          // one workgroup for each node with contacts
const uint ARGS_GATHERING = 7;      // one workgroup for each active chunk whose vertices are tested for contact
// One workgroup for each active chunk whose skin is tested for contact, and each of its contact patches.
const uint ARGS_OVERLAPS = 8;
const uint ARGS_LOOP_ELEMENT_PRODUCT = 9;     // one invocation for each tetrahedron, in the solver's loop
const uint ARGS_LOOP_CONTACT_PRODUCT = 10;     // one invocation for each contact, in the solver's loop
const uint ARGS_LOOP_PATCHES = 11;  // one invocation for each F-bar patch, in the solver's loop
const uint ARGS_LOOP_FREE = 12;     // one workgroup for each block of free nodes, in the solver's loop
const uint ARGS_LOOP_ATTACHED = 13;  // one workgroup for each block of nodes attached to dynamic cores, in the loop
const uint ARGS_LOOP_TOOL = 14;     // one workgroup for the six equations of the tool, in the solver's loop
const uint ARGS_COMMIT = 15;        // one invocation for each node, once the step is accepted
const uint ARGS_WRENCH = 16;        // one workgroup of wrench/reduce for each tool, once the step is accepted
const uint ARGS_GAP = 17;           // one workgroup of wrench/gap for each part of skin that the tool may touch
const uint ARGS_DRAW = 20;          // draw of the depth stage's graphics version: a VkDrawIndirectCommand (four words)

layout(constant_id = 10) const uint GROUP = 64;   // workgroup size of kernels with one invocation for each item

// Number of workgroups for `elements` items, such as nodes or contacts, at one invocation for each item.
uint groups_of(uint elements) { return (elements + GROUP - 1) / GROUP; }
const uint ARGS_WORDS = 64;         // length of the buffer of arguments, in words
