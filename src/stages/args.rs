//! Slots of the indirect arguments; twins of shaders/shared/args.glsl.

/// A workgroup an active pair of proxies.
pub const DIRECTION: u32 = 0;
/// Skin vertices to place.
pub const EMBED: u32 = 1;
/// Triangles to rasterize.
pub const RASTER: u32 = 2;
/// Candidate vertices.
pub const CANDIDATES: u32 = 3;
/// One, where there are candidates.
pub const COMPACT: u32 = 4;
/// Contacts.
pub const CONTACTS: u32 = 5;
/// Every node, where there are contacts.
pub const CONTACT_NODES: u32 = 6;
/// 16 a contact.
pub const ENTRIES: u32 = 7;
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
