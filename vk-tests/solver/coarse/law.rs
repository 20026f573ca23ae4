//! Test that the coarse space of the preconditioner, whose unknowns are affine motions of blocks of nodes (see mod.rs),
//! serves its purpose: with it, conjugate gradients must take far fewer iterations on stiff bodies.

use glam::DQuat;
use palpate::scene::Preconditioner;

use super::super::passes::Passes;
use super::boxed;
use crate::solver::system::{System, layered, material};

#[test]
#[ignore = "long: 5 s"]
fn a_stiff_block_takes_a_third_of_the_iterations() {
    // The body is a cube of 3072 tetrahedra with a Young's modulus of 2 MPa, attached on one side, under its own
    // weight.
    let layer = boxed([8, 8, 8], |x| x.z < -0.079);
    let body = layered(layer, material(2e6), DQuat::from_rotation_x(1.0));
    let iterations = [Preconditioner::Jacobi, Preconditioner::Coarse].map(|preconditioner| {
        let mut system = System::preconditioned(std::slice::from_ref(&body), 0.0, 1, preconditioner);
        system.velocity.fill([0.0; 4]);
        system.rotate();
        let mut passes = Passes::new(system);
        passes.system.stop_at(1e-4);
        passes.record_start();
        passes.iterate(1000);
        assert_eq!(passes.state.status, 1, "status of the solver, 1 if it converged");
        passes.record_end();
        assert!(passes.report.residual < 1e-3, "residual {:e}", passes.report.residual);
        passes.iterations_done()
    });
    println!("stiff cube: {} iterations without the coarse space, {} with it", iterations[0], iterations[1]);
    assert!(3 * iterations[1] <= iterations[0], "iterations without and with the coarse space: {iterations:?}");
}
