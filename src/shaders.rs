//! What the shaders declare, in Rust: of each kernel its arguments by name, and the structs and constants that shaders and host
//! share. All of it is made by the build script from `shaders/`, where it is defined and explained.

include!(concat!(env!("OUT_DIR"), "/shaders.rs"));
