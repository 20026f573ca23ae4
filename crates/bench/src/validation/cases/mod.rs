//! The cases of `palpate validate`, by what they are about.

mod bar;
mod contact;
mod elastica;
mod membrane;
mod patch;
mod plate;
mod sofa;
mod turek;

use palpate::Result;

use super::lab::Lab;
use super::series::Quantity;

/// A problem with a published answer.
#[derive(Debug)]
pub struct Case {
    /// Name on the command line.
    pub name: &'static str,
    /// Title in the report.
    pub title: &'static str,
    /// Who published the values, and where they are found.
    pub source: &'static str,
    /// The problem, as it is posed there, and how it is posed here.
    pub problem: &'static str,
    /// Runs it on all levels.
    pub measure: fn(&mut Lab) -> Result<Vec<Quantity>>,
}

/// All cases, in the order of the report.
pub static ALL: [Case; 15] = [
    patch::CASE,
    patch::ENERGY,
    bar::HANGING,
    membrane::CASE,
    turek::LARGE,
    turek::SMALL,
    turek::SWINGING,
    elastica::CASE,
    sofa::CANTILEVER,
    sofa::SWINGING,
    plate::CASE,
    bar::IMPACT,
    contact::INDENTATION,
    contact::PULLED,
    contact::SLOPE,
];

/// The head of a scene file: a solver that stops at a relative residual of `tolerance`, gravity (m/s^2) and the time
/// step (s). It ends within the table [step], whose other keys may follow.
fn head(dt: f64, gravity: [f64; 3], tolerance: f64) -> String {
    format!("[solver]\ntolerance = {tolerance:?}\nmax_iterations = 5000\n[step]\ngravity = {gravity:?}\ndt = {dt:?}\n")
}

/// A region of nodes: all whose coordinate `axis` is within rounding of `at`, in a body of at most 1e3 m.
fn face(axis: usize, at: f64) -> String {
    let (mut low, mut high) = ([-1e3; 3], [1e3; 3]);
    (low[axis], high[axis]) = (at - 1e-6 * at.abs().max(1e-2), at + 1e-6 * at.abs().max(1e-2));
    format!("{{ box = [{low:?}, {high:?}] }}")
}

/// A support with a name, its condition (`point = true`), and the region of its nodes.
fn support(name: &str, condition: &str, bind: &str) -> String {
    format!("[[body.support]]\nname = \"{name}\"\n{condition}\nbind = {bind}\n")
}

/// A force per area (Pa) on the skin in a region.
fn traction(name: &str, traction: [f64; 3], bind: &str) -> String {
    format!("[[body.load]]\nname = \"{name}\"\ntraction = {traction:?}\nbind = {bind}\n")
}
