//! Tests of the solver's kernels (operator, right-hand side, iteration and decision whether the step is accepted), and
//! of whole solves of small systems.

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
pub mod start;
mod supports;
mod whole;
