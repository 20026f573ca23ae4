//! Quoted times of other software for cases of the solver benchmark (a case is a body with a stiffness and a time
//! step), and the choice of the palpate setting (preconditioner with a tolerance) that is compared with them.

use super::{Case, Measured, Mesh, Run};

/// Largest allowed displacement error, relative to the largest displacement, of a setting that is compared with other
/// software.
pub const ALLOWED_ERROR: f64 = 1e-4;
/// Time step of the cases that are compared with other software, s.
const DT: f64 = 1e-3;

/// Times that other software takes for a step of a case, and the goal for palpate's speed. The times were measured on
/// another machine, with two CPU cores like those of the machine on which palpate is developed.
pub struct Peer {
    /// The body.
    pub mesh: Mesh,
    /// Young's modulus, Pa.
    pub young: f64,
    /// Time of Vega FEM 4.0, ms, which ran in f64 and solved by conjugate gradients with Jacobi's preconditioner to a
    /// tolerance of 1e-6.
    pub vega_ms: f64,
    /// Time of MuJoCo 4 in its fastest setting, ms; `None`: not known.
    pub mujoco_ms: Option<f64>,
    /// Goal for the time of the fastest other software, divided by palpate's time.
    pub goal: f64,
}

/// All cases with quoted times.
pub const PEERS: [Peer; 4] = [
    Peer { mesh: Mesh::Block(12), young: 2e4, vega_ms: 19.0, mujoco_ms: Some(15.5), goal: 2.5 },
    Peer { mesh: Mesh::Block(12), young: 2e6, vega_ms: 48.0, mujoco_ms: Some(50.0), goal: 2.5 },
    Peer { mesh: Mesh::Block(26), young: 2e4, vega_ms: 332.0, mujoco_ms: None, goal: 5.0 },
    Peer { mesh: Mesh::Block(26), young: 2e6, vega_ms: 2520.0, mujoco_ms: None, goal: 8.0 },
];

impl Peer {
    /// The measurements of palpate for this case; `None`: the case was not measured.
    pub fn case<'a>(&self, cases: &'a [Measured]) -> Option<&'a Measured> {
        let is_its = |case: &Case| case.mesh == self.mesh && case.young == self.young && case.dt == DT;
        cases.iter().find(|measured| is_its(&measured.case))
    }

    /// Time of the fastest other software, ms.
    pub fn best_ms(&self) -> f64 {
        self.mujoco_ms.unwrap_or(f64::INFINITY).min(self.vega_ms)
    }
}

/// The fastest setting that raised no flag (report of a problem in a step) and whose error is at most
/// [`ALLOWED_ERROR`].
pub fn fastest(measured: &Measured) -> Option<&Run> {
    let good = measured.runs.iter().filter(|run| run.flagged == 0 && run.error <= ALLOWED_ERROR);
    good.min_by(|a, b| a.ms().total_cmp(&b.ms()))
}
