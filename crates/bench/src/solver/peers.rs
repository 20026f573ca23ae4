//! Others' times of the same cases, and ours that they are held against.

use super::{Case, Measured, Mesh, Run};

/// The displacement error that a setting may have to be compared with others.
pub const ALLOWED_ERROR: f64 = 1e-4;
/// Time step of the cases compared, s.
const DT: f64 = 1e-3;

/// What others take for a step of a case, and how many times faster we mean to be than the fastest of them. Measured on
/// another machine of two cores of the kind that this project is developed on.
pub struct Peer {
    /// The body.
    pub mesh: Mesh,
    /// Young's modulus, Pa.
    pub young: f64,
    /// Vega FEM 4.0: f64, conjugate gradients with Jacobi's preconditioner to 1e-6, ms.
    pub vega_ms: f64,
    /// MuJoCo 4, its fastest setting, ms.
    pub mujoco_ms: Option<f64>,
    /// Factor aimed at.
    pub goal: f64,
}

/// All that is known.
pub const PEERS: [Peer; 4] = [
    Peer { mesh: Mesh::Block(12), young: 2e4, vega_ms: 19.0, mujoco_ms: Some(15.5), goal: 2.5 },
    Peer { mesh: Mesh::Block(12), young: 2e6, vega_ms: 48.0, mujoco_ms: Some(50.0), goal: 2.5 },
    Peer { mesh: Mesh::Block(26), young: 2e4, vega_ms: 332.0, mujoco_ms: None, goal: 5.0 },
    Peer { mesh: Mesh::Block(26), young: 2e6, vega_ms: 2520.0, mujoco_ms: None, goal: 8.0 },
];

impl Peer {
    /// Its case among those that were measured.
    pub fn case<'a>(&self, cases: &'a [Measured]) -> Option<&'a Measured> {
        let is_its = |case: &Case| case.mesh == self.mesh && case.young == self.young && case.dt == DT;
        cases.iter().find(|measured| is_its(&measured.case))
    }

    /// The fastest peer, ms.
    pub fn best_ms(&self) -> f64 {
        self.mujoco_ms.unwrap_or(f64::INFINITY).min(self.vega_ms)
    }
}

/// The fastest setting that raised no flag and whose error is allowed.
pub fn fastest(measured: &Measured) -> Option<&Run> {
    let good = measured.runs.iter().filter(|run| run.flagged == 0 && run.error <= ALLOWED_ERROR);
    good.min_by(|a, b| a.ms().total_cmp(&b.ms()))
}
