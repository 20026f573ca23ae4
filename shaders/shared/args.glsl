// Indirect arguments: one VkDispatchIndirectCommand a slot, three words each.

const uint ARGS_DIRECTION = 0;      // a workgroup an active proxy pair
const uint ARGS_CHUNKS = 1;         // a workgroup an active slot
const uint ARGS_ACTIVE = 2;         // a workgroup an active chunk
const uint ARGS_ITEMS = 3;          // a workgroup an active chunk and region
const uint ARGS_DEEPEST = 4;        // one, or none where all contacts fit
const uint ARGS_CONTACTS = 5;
const uint ARGS_NODES = 6;          // a workgroup a touched node
const uint ARGS_GATHERING = 7;      // a workgroup an active chunk whose vertices gather contacts
const uint ARGS_LOOP_APPLY = 8;     // in its loop: tetrahedra; all of these are zero once converged
const uint ARGS_LOOP_PRESS = 9;     // contacts
const uint ARGS_LOOP_PATCHES = 10;
const uint ARGS_LOOP_FREE = 11;     // a workgroup a block of free nodes
const uint ARGS_LOOP_CARRIED = 12;  // a workgroup a block of nodes that cores carry
const uint ARGS_LOOP_TOOL = 13;     // one
const uint ARGS_COMMIT = 14;        // every node, once the step is accepted
const uint ARGS_WRENCH = 15;
const uint ARGS_GAP = 16;           // a workgroup a part of the skins that the tool may touch, where a loop holds it
const uint ARGS_DRAW = 20;          // VkDrawIndirectCommand: four words at 3 * 20, a multiple of 16 bytes

layout(constant_id = 10) const uint GROUP = 64;   // local size of the kernels that are dispatched by elements

uint groups_of(uint elements) { return (elements + GROUP - 1) / GROUP; }
const uint ARGS_WORDS = 64;         // of the buffer
