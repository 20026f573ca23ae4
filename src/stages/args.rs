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
/// Tetrahedra, in the solver's loop.
pub const LOOP_APPLY: u32 = 7;
/// Contacts.
pub const LOOP_PRESS: u32 = 8;
/// Patches.
pub const LOOP_PATCHES: u32 = 9;
/// A workgroup a block of free nodes.
pub const LOOP_FREE: u32 = 10;
/// A workgroup a block of carried nodes.
pub const LOOP_CARRIED: u32 = 11;
/// One, for the tool.
pub const LOOP_TOOL: u32 = 12;
/// Nodes, once the step is accepted.
pub const COMMIT: u32 = 13;
/// One, once the step is accepted.
pub const WRENCH: u32 = 14;
/// The draw, counted in VkDrawIndirectCommands.
pub const DRAW: u32 = 12;
/// Words in the buffer.
pub const WORDS: usize = 52;
