//! Predicts how fast a body comes to rest, for the stability matrix (many stiff and extreme simulations, some of which
//! must come to rest in time). The prediction follows from the slowest mode of vibration about the body's rest state,
//! and from the damping of that mode by the material and by implicit Euler.

use glam::DQuat;
use palpate::Result;
use palpate_oracle::elastic::Weight;
use palpate_oracle::linear::{Entries, Solver};
use palpate_oracle::step::SoftBody;

/// Greatest number of rounds of the inverse iteration, which finds the slowest mode.
const ROUNDS: usize = 200;
/// The inverse iteration ends when the squared frequency changes in a round by at most this share.
const DONE: f64 = 1e-9;

/// Factor by which implicit Euler scales the velocity of a body near rest in a step of `h` seconds, for its
/// slowest-decaying mode; 0 if no node is free. The damping of the first tetrahedron's material is used for all.
pub fn slowest_decay(body: &SoftBody, h: f64) -> Result<f64> {
    let Some(square) = slowest_square(body)? else { return Ok(0.0) };
    let Some(material) = body.elements.materials.first() else { return Ok(0.0) };
    let (alpha, beta) = (material.damping_mass, material.damping_stiffness);
    // With damping by stiffness (beta), the fastest modes are overdamped and creep back at the rate 1 / beta; implicit
    // Euler keeps beta / (h + beta) of their amplitude in a step.
    Ok(decay(square.sqrt(), alpha + beta * square, h).max(beta / (h + beta)))
}

/// Mean factor by which implicit Euler scales the solution of x'' = -w^2 x - a x' in a step of `h` seconds (w:
/// `frequency`, rad/s; a: `damping`, 1/s): |1 / (1 - h s)| for the slower root s of s^2 + a s + w^2 = 0.
pub fn decay(frequency: f64, damping: f64, h: f64) -> f64 {
    let square = frequency * frequency;
    let inside = 0.25 * damping * damping - square;
    if inside < 0.0 {
        return (1.0 + h * damping + h * h * square).powf(-0.5);
    }
    // The product of the two roots is w^2, so that the slow root follows from the fast one without a loss of digits.
    let fast = 0.5 * damping + inside.sqrt();
    let slow = if fast > 0.0 { square / fast } else { 0.0 };
    1.0 / (1.0 + h * slow)
}

/// Whether a chain of tetrahedra leads from each node to an attached one.
fn is_held(tetrahedra: &[[u32; 4]], attached: &[bool]) -> bool {
    let mut held = attached.to_vec();
    let mut count = 0;
    while count < held.iter().filter(|held| **held).count() {
        count = held.iter().filter(|held| **held).count();
        for nodes in tetrahedra {
            if nodes.iter().any(|i| held[*i as usize]) {
                nodes.iter().for_each(|i| held[*i as usize] = true);
            }
        }
    }
    count == held.len()
}

/// The least w^2 of K x = w^2 M x over the free nodes of a body at rest (K: stiffness, M: lumped mass), by inverse
/// iteration; `None`: no node is free. Errors: K cannot be factorised.
fn slowest_square(body: &SoftBody) -> Result<Option<f64>> {
    let (elements, bound) = (&body.elements, &body.layer.attached);
    let mut unknown = vec![None; bound.len()];
    let free = bound.iter().enumerate().filter(|(_, bound)| !**bound);
    let count = free.enumerate().map(|(k, (i, _))| unknown[i] = Some(3 * k)).count();
    match count {
        0 => return Ok(None),
        // A part without attached nodes moves as a whole at frequency 0, and the stiffness matrix is singular.
        _ if !is_held(&elements.tetrahedra, bound) => return Ok(Some(0.0)),
        _ => {}
    }
    let mut stiffness = Entries::default();
    for (e, nodes) in elements.tetrahedra.iter().enumerate() {
        let blocks = elements.stiffness_blocks(e, DQuat::IDENTITY, Weight::both(1.0));
        for (k, i) in nodes.iter().enumerate() {
            for (l, j) in nodes.iter().enumerate() {
                if let (Some(row), Some(column)) = (unknown[*i as usize], unknown[*j as usize]) {
                    stiffness.add_block(row, column, &blocks[k][l]);
                }
            }
        }
    }
    let mut masses = vec![0.0; 3 * count];
    for (at, mass) in unknown.iter().zip(&elements.masses) {
        at.iter().for_each(|at| masses[*at..*at + 3].fill(*mass));
    }
    let (mut solver, mut square) = (Solver::default(), f64::INFINITY);
    // The initial vector is arbitrary: it is no mode, and it is orthogonal to no mode.
    let mut x: Vec<f64> = (0..3 * count).map(|k| 1.0 + 0.7 * (1.3 * k as f64).sin()).collect();
    for _ in 0..ROUNDS {
        let momentum: Vec<f64> = x.iter().zip(&masses).map(|(x, m)| x * m).collect();
        let next = solver.solve(&stiffness, &momentum)?;
        // Rayleigh quotient of `next`: since K next = momentum, both of its quadratic forms are dot products of known
        // vectors.
        let strain: f64 = next.iter().zip(&momentum).map(|(a, b)| a * b).sum();
        let motion: f64 = next.iter().zip(&masses).map(|(x, m)| m * x * x).sum();
        let (last, size) = (square, motion.sqrt());
        square = strain / motion;
        x = next.iter().map(|x| x / size).collect();
        if (last - square).abs() <= DONE * square {
            break;
        }
    }
    Ok(Some(square))
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use palpate::internal::prepare::Layer;
    use palpate::internal::prepare::layer::kuhn_box;
    use palpate::scene::{Material, MaterialLaw};

    use super::*;

    fn bar(cells: [u32; 3], size: DVec3, poisson: f64) -> SoftBody {
        let mut layer: Layer = kuhn_box(DVec3::ZERO, size, cells);
        layer.attached = layer.nodes.iter().map(|x| x.x < 1e-9).collect();
        let material = Material {
            law: MaterialLaw::Corotational,
            young: 2e4,
            poisson,
            density: 1000.0,
            damping_mass: 0.0,
            damping_stiffness: 0.0,
        };
        SoftBody::new(layer, material, DVec3::ZERO, DQuat::IDENTITY, DVec3::ZERO)
    }

    #[test]
    fn a_slender_bar_bends_at_the_frequency_of_a_cantilever() {
        // A cantilever's frequency is w = 1.875^2 sqrt(E I / (rho A)) / L^2 with Young's modulus E, density rho, length
        // L and, for a square section of edge a, I / A = a^2 / 12; linear tetrahedra are a little too stiff.
        let (length, edge) = (1.0, 0.1);
        let body = bar([40, 4, 4], DVec3::new(length, edge, edge), 0.0);
        let want = 1.875f64.powi(2) * (2e4f64 / 1000.0 / 12.0).sqrt() * edge / length.powi(2);
        let got = slowest_square(&body).unwrap().unwrap().sqrt();
        assert!(got > 0.97 * want && got < 1.1 * want, "frequency {got} rad/s, expected {want} rad/s");
    }

    #[test]
    fn a_mode_decays_as_implicit_euler_has_it() {
        for (w, a, h) in
            [(30.0, 0.0, 1e-3), (30.0, 20.0, 1e-2), (30.0, 63.0, 1e-3), (30.0, 500.0, 1e-2), (3.0, 1e6, 0.1)]
        {
            let (mut x, mut v) = (1.0, 0.3 * w);
            let mut sizes = Vec::new();
            for _ in 0..4000 {
                v = (v - h * w * w * x) / (1.0 + h * a + h * h * w * w);
                x += h * v;
                let size = f64::hypot(w * x, v);
                (x, v) = (x / size, v / size);
                sizes.push(size);
            }
            // The mean is taken over the last 2000 steps, which evens out the oscillation; before these steps the
            // motion of the faster root has died out.
            let mean = (sizes[2000..].iter().map(|s| s.ln()).sum::<f64>() / 2000.0).exp();
            let want = decay(w, a, h);
            assert!(
                (mean - want).abs() < 2e-3 * (1.0 - want),
                "frequency {w} rad/s, damping {a} 1/s, step {h} s: mean decay factor {mean} a step, expected {want}"
            );
        }
    }
}
