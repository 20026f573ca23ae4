// Indirect arguments of the step's dispatches: each constant below numbers a VkDispatchIndirectCommand of three words
// in the buffer `args`. An earlier kernel writes the numbers of workgroups.

const uint ARGS_DIRECTION = 0;      // one workgroup for each active pair of collision proxies
const uint ARGS_CHUNKS = 1;         // one workgroup for each active slot (a proxy in a pair of bodies)
const uint ARGS_ACTIVE = 2;         // one workgroup for each active chunk
const uint ARGS_WORK_ITEMS = 3;          // one workgroup for each active chunk and contact patch of it
const uint ARGS_DEEPEST = 4;        // one workgroup, or none where all contacts fit
const uint ARGS_CONTACTS = 5;       // workgroups of GROUP contacts
const uint ARGS_NODES = 6;          // one workgroup for each node with contacts
const uint ARGS_GATHERING = 7;      // one workgroup for each active chunk whose vertices gather contacts
const uint ARGS_LOOP_APPLY = 8;     // tetrahedra, in the solver's loop, whose arguments are zero once converged
const uint ARGS_LOOP_CONTACT_PRODUCT = 9;     // contacts, in the solver's loop
const uint ARGS_LOOP_PATCHES = 10;  // F-bar patches, in the solver's loop
const uint ARGS_LOOP_FREE = 11;     // one workgroup for each block of free nodes, in the solver's loop
const uint ARGS_LOOP_ATTACHED = 12;  // one workgroup for each block of nodes attached to dynamic cores, in the loop
const uint ARGS_LOOP_TOOL = 13;     // one workgroup for the tool's rows, in the solver's loop
const uint ARGS_COMMIT = 14;        // every node, once the step is accepted
const uint ARGS_WRENCH = 15;        // one workgroup, once the step is accepted
const uint ARGS_GAP = 16;           // one workgroup for each part of skin that a tool held by a haptic loop may touch
const uint ARGS_DRAW = 20;          // a VkDrawIndirectCommand, four words at word 3 * 20, a multiple of 16 bytes

layout(constant_id = 10) const uint GROUP = 64;   // workgroup size of kernels with one invocation for each element

uint groups_of(uint elements) { return (elements + GROUP - 1) / GROUP; }
const uint ARGS_WORDS = 64;         // words of the buffer of arguments
