//! Asks whether the system gives memory, before work whose need of it depends on the input. Such work takes its memory
//! piece by piece, and a piece that is refused ends the process; asking first gives a message instead. It helps where
//! the process has a limit, or the work needs more than there is at all. A system that promises more than it has, as
//! Linux does within bounds, may still end the process later.

use std::hint::black_box;

/// Bytes that reading a mesh file and repairing its mesh take, per byte of the file: 12 for a surface of 500,000
/// vertices, in OBJ.
pub const BYTES_PER_BYTE_OF_MESH: f64 = 16.0;
/// Bytes that filling a surface with tetrahedra takes, per cell of the lattice around it: 950 to 1,230 for a head in
/// 58,000 and 394,000 cells.
pub const BYTES_PER_CELL: f64 = 1300.0;
/// Bytes that preparing and simulating a layer takes, per tetrahedron: 1,000 for a box of 750,000 tetrahedra on a
/// Vulkan device that shares the host's memory.
pub const BYTES_PER_TETRAHEDRON: f64 = 1000.0;

/// The problem, in words, if the system does not give `bytes` bytes of memory.
pub fn ask(bytes: f64) -> Result<(), String> {
    let needed = bytes.max(0.0).min(isize::MAX as f64) as usize;
    let mut room = Vec::<u8>::new();
    let given = room.try_reserve_exact(needed);
    // Without this the compiler might leave the request out.
    black_box(&room);
    given.map_err(|_| format!("about {:.0} MB of memory are needed, which the system does not give", bytes / 1e6))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_had_is_told() {
        ask(1e6).unwrap();
        ask(-1.0).unwrap();
        let said = ask(2f64.powi(60)).unwrap_err();
        assert_eq!(said, "about 1152921504607 MB of memory are needed, which the system does not give");
        ask(f64::INFINITY).unwrap_err();
    }
}
