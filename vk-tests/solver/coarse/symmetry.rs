//! The preconditioner M^-1 with a coarse space (whose unknowns are affine motions of blocks of nodes, see mod.rs) must
//! be symmetric and positive definite, as conjugate gradients require.

use super::super::passes::{Change, Passes};
use super::kernels::{SUM, Twin, coarse, dot, magnitudes, node_vectors, only_free, random_unknowns, six};
use super::{large_core, product};
use crate::harness::random::Random;
use crate::solver::system::{two_layers, two_layers_one_on_a_core, two_layers_one_on_a_hinge};

/// M^-1 r by the kernels: an iteration with step length one along a zero direction leaves r unchanged and applies M^-1
/// to it.
fn device_preconditioned(passes: &mut Passes, r: &[f64]) -> Vec<f64> {
    let zeros = vec![[0.0; 4]; passes.nodes()];
    passes.residual = only_free(passes, node_vectors(&passes.system, r));
    (passes.preconditioned, passes.direction, passes.direction_product) = (zeros.clone(), zeros.clone(), zeros);
    passes.restricted_direction.fill([0.0; 4]);
    for index in 0..passes.rigids.len() {
        let own = six(passes, index, r);
        *passes.rigid(index) = bytemuck::Zeroable::zeroed();
        passes.rigid(index).r = own;
    }
    passes.iterations = bytemuck::Zeroable::zeroed();
    passes.apply(Change::Preconditioned);
    passes.gather(1);
    passes.dots.fill([0.0; 2]);
    passes.dots[0] = [1.0, 1.0];
    passes.update();
    assert_eq!(passes.state.status, 0);
    passes.unknowns(&passes.preconditioned, |now| now.u)
}

#[test]
fn the_preconditioner_is_symmetric_and_positive() {
    // Checks x.M^-1 y = y.M^-1 x and x.M^-1 x > 0 for random vectors and for motions of whole blocks, also under stiff
    // contacts.
    let bodies = [
        ("layers", two_layers(), false),
        ("stiff contacts", two_layers(), true),
        ("a core", two_layers_one_on_a_core(), true),
        ("a hinge", two_layers_one_on_a_hinge(), true),
        ("a core of several blocks", vec![large_core(false)], true),
        ("a hinge of several blocks", vec![large_core(true)], false),
    ];
    for (what, bodies, stiff) in bodies {
        let mut system = coarse(&bodies, 9).with_tool().with_friction().with_contacts(100, 90);
        system.contacts.iter_mut().filter(|_| stiff).for_each(|contact| {
            contact.damping *= 100.0;
            contact.friction *= 100.0;
        });
        let mut passes = Passes::new(system);
        passes.record_start();
        let twin = Twin::new(&passes);
        passes.system.stop_at(0.0);
        passes.state.floor_norm2 = 0.0;
        let mut random = Random(91);
        let mut vectors: Vec<Vec<f64>> = (0..4).map(|_| random_unknowns(&passes.system, &mut random, 1.0)).collect();
        for _ in 0..3 {
            let z: Vec<f64> = (0..twin.p.ncols()).map(|_| random.next()).collect();
            vectors.push(product(&twin.p, &z).iter().map(|x| f64::from(*x as f32)).collect());
        }
        // A vector in which only the dynamic cores (rigid bodies inside soft ones) move.
        let mut rigid = vectors[0].clone();
        let firsts = passes.system.twin.unknowns().cores;
        let own = |i: usize| firsts.iter().any(|first| (*first..first + 6).contains(&i));
        rigid.iter_mut().enumerate().filter(|(i, _)| !own(*i)).for_each(|(_, x)| *x = 0.0);
        vectors.extend((!firsts.is_empty()).then_some(rigid));
        let operator_products: Vec<Vec<f64>> = vectors.iter().map(|x| device_preconditioned(&mut passes, x)).collect();
        for (i, (x, mx)) in vectors.iter().zip(&operator_products).enumerate() {
            assert!(dot(x, mx) > 0.0, "{what}, vector {i}: x.M^-1 x = {:e} is not positive", dot(x, mx));
            for (j, (y, my)) in vectors.iter().zip(&operator_products).enumerate().take(i) {
                let size = dot(&magnitudes(x), &twin.sizes(&passes, y));
                let apart = dot(x, my) - dot(y, mx);
                assert!(
                    apart.abs() < SUM * size,
                    "{what}, vectors {i} and {j}: x.M^-1 y = {:e}, y.M^-1 x = {:e}",
                    dot(x, my),
                    dot(y, mx)
                );
            }
        }
    }
}
