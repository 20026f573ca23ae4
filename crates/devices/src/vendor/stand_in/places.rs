//! What stands where in the memory `STAND_IN` that a stand-in library shares with the tests: numbers of double
//! precision, each as its bits. Each stand-in uses some of them.

#![allow(dead_code)]

/// Length of the memory.
pub const LENGTH: usize = 128;
/// Where the places of a second device begin: those of its buttons, errors, position, axes, velocities, wrench, and of
/// whether its force is enabled. The other places are those of both.
pub const SECOND_DEVICE: usize = 64;

/// Whether there is a device (not zero), and whether the library can open it.
pub const IS_THERE: usize = 0;
/// Whether it is calibrated.
pub const IS_CALIBRATED: usize = 1;
/// Type of the device: the number that `dhdGetSystemType` returns; an index in the list of models of `hd.rs`.
pub const TYPE: usize = 2;
pub const SERIAL: usize = 3;
pub const BUTTONS: usize = 4;
/// Error that every sample meets (not zero): with `dhd.rs` any number, with `hd.rs` its code.
pub const ERROR: usize = 5;
/// Calibrations that succeed when asked for (`hd.rs`).
pub const STYLES: usize = 6;
/// Position, three numbers, in the library's axes and units; so are the next four.
pub const POSITION: usize = 8;
/// Axes of the handle: three rows of the matrix, nine numbers.
pub const AXES: usize = 11;
pub const VELOCITY: usize = 20;
pub const ANGULAR_VELOCITY: usize = 23;
/// The force and torque that were commanded last, six numbers.
pub const WRENCH: usize = 26;
/// Number of samples, of opened and of closed devices.
pub const SAMPLES: usize = 32;
pub const OPENED: usize = 33;
pub const CLOSED: usize = 34;
/// Number of calls that the library's reference forbids.
pub const MISUSES: usize = 35;
/// Whether force is enabled.
pub const IS_ENABLED: usize = 36;
/// Number of calibrations.
pub const CALIBRATIONS: usize = 37;
/// Whether the device's own button, or limit of speed, has switched its forces off (`dhd.rs`).
pub const IS_OFF: usize = 38;
/// Serial number of a second device, which is listed first; 0: there is none. With `hd.rs` its name is "Right Device".
pub const SECOND: usize = 39;
/// Whether the scheduler calls nothing any more (1), and does not end for a second either (2), or for as long as this says
/// (4); whether nothing can be scheduled (3) (`hd.rs`).
pub const HANGS: usize = 40;
/// Code of an error of the device that is noted between two frames, so that whichever frame comes next is told (`hd.rs`).
pub const LATE_ERROR: usize = 42;
/// Whether only a hand can calibrate the device now (`hd.rs`).
pub const NEEDS_HAND: usize = 41;
