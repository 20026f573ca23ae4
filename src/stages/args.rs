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
/// Tetrahedra and contacts.
pub const APPLY: u32 = 7;
/// The same in the solver's loop.
pub const LOOP_APPLY: u32 = 8;
/// A workgroup a block of nodes, and the tool.
pub const LOOP_BLOCKS: u32 = 9;
/// Nodes, once the step is accepted.
pub const COMMIT: u32 = 10;
/// One, once the step is accepted.
pub const WRENCH: u32 = 11;
/// The draw, counted in VkDrawIndirectCommands.
pub const DRAW: u32 = 9;
/// Words in the buffer.
pub const WORDS: usize = 40;
