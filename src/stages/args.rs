//! Slots of the indirect arguments; twins of shaders/shared/args.glsl.

/// A workgroup an active pair of proxies.
pub const DIRECTION: u32 = 0;
/// A workgroup an active slot.
pub const CHUNKS: u32 = 1;
/// A workgroup an active chunk.
pub const ACTIVE: u32 = 2;
/// A workgroup an active chunk and region.
pub const ITEMS: u32 = 3;
/// One, where not all contacts fit.
pub const DEEPEST: u32 = 4;
/// Contacts.
pub const CONTACTS: u32 = 5;
/// A workgroup a touched node.
pub const NODES: u32 = 6;
/// A workgroup an active chunk whose vertices gather contacts.
pub const GATHERING: u32 = 7;
/// Tetrahedra, in the solver's loop.
pub const LOOP_APPLY: u32 = 8;
/// Contacts.
pub const LOOP_PRESS: u32 = 9;
/// Patches.
pub const LOOP_PATCHES: u32 = 10;
/// A workgroup a block of free nodes.
pub const LOOP_FREE: u32 = 11;
/// A workgroup a block of carried nodes.
pub const LOOP_CARRIED: u32 = 12;
/// One, for the tool.
pub const LOOP_TOOL: u32 = 13;
/// Nodes, once the step is accepted.
pub const COMMIT: u32 = 14;
/// One, once the step is accepted.
pub const WRENCH: u32 = 15;
/// A workgroup a part of the skins that the tool may touch, once the step is accepted, where a loop holds the tool.
pub const GAP: u32 = 16;
/// The draw, counted in VkDrawIndirectCommands.
pub const DRAW: u32 = 15;
/// Words in the buffer.
pub const WORDS: usize = 64;
