//! The shaders' declarations in Rust: for each kernel a struct of its arguments by name, and the structs and constants
//! that shaders and host share. The build script generates these declarations from the files in `shaders/`, where they
//! are defined and documented.

include!(concat!(env!("OUT_DIR"), "/shaders.rs"));
