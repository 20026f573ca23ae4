//! Slots of the indirect arguments; twins of shaders/shared/args.glsl.

/// A workgroup an active pair of proxies.
pub const DIRECTION: u32 = 0;
/// A workgroup an active slot.
pub const CHUNKS: u32 = 1;
/// A workgroup an active chunk.
pub const ACTIVE: u32 = 2;
/// A workgroup an active chunk and region.
pub const ITEMS: u32 = 3;
/// One, where a chunk is active.
pub const COMPACT: u32 = 4;
/// Contacts.
pub const CONTACTS: u32 = 5;
/// 16 a contact.
pub const ENTRIES: u32 = 6;
/// A workgroup a touched node.
pub const NODES: u32 = 7;
/// Tetrahedra and contacts.
pub const APPLY: u32 = 8;
/// The same in the solver's loop.
pub const LOOP_APPLY: u32 = 9;
/// Nodes, in workgroups that sum.
pub const LOOP_GATHER: u32 = 10;
/// One.
pub const LOOP_ONE: u32 = 11;
/// Nodes.
pub const LOOP_UPDATE: u32 = 12;
/// Nodes, once the step is accepted.
pub const COMMIT: u32 = 13;
/// One, once the step is accepted.
pub const WRENCH: u32 = 14;
/// The draw, counted in VkDrawIndirectCommands.
pub const DRAW: u32 = 12;
/// Words in the buffer.
pub const WORDS: usize = 52;
