//! What the shaders declare, in Rust: for each kernel a struct of its arguments by name, and the structs and constants
//! that shaders and host share. The build script generates all of it from `shaders/`, where it is defined and
//! documented.

include!(concat!(env!("OUT_DIR"), "/shaders.rs"));
