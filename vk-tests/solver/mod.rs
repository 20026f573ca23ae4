//! Solve: the operator, the system, the iteration, the verdict; and all of it on small systems.

pub mod newton;
pub mod system;

mod assemble;
mod coarse;
mod convergence;
mod end;
mod iteration;
mod joints;
mod operator;
pub mod passes;
mod start;
mod whole;
