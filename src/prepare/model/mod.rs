//! Models made by the engine itself, so that scenes need no files: solids as signed distances, surfaces extracted from
//! them, brought to an exact number of vertices. Bit for bit the same everywhere: only correctly rounded operations.

pub mod collapse;
pub mod extract;
mod head;
pub mod solid;

pub use head::{VERTICES, head};
