//! The reference of the solver benchmark: node displacements after the benchmark's steps, computed in f64 with a direct
//! solver ([`palpate_oracle::step`]). Factorising the matrices of the larger bodies takes minutes, so that references
//! are kept in the user's cache.

use std::time::Instant;

use glam::DVec3;
use palpate::internal::prepare::cache::{Entry, Key, KeyMaker};
use palpate::internal::prepare::{Body, Cache, Shape};
use palpate::{Error, Result, Scene};
use palpate_oracle::step::{Simulation, SoftBody};
use serde::{Deserialize, Serialize};

/// Source files on which the reference depends besides its inputs; a change of any of these files invalidates the
/// cache. The library that solves the linear systems is left out, because another version of it changes at most the
/// thirteenth digit of the results.
const SOURCES: &[&str] = &[
    include_str!("../../../oracle/src/body.rs"),
    include_str!("../../../oracle/src/elastic.rs"),
    include_str!("../../../oracle/src/linear.rs"),
    include_str!("../../../oracle/src/step.rs"),
];

/// Displacements of the nodes after the last step, and how long computing them took.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Reference {
    /// Displacement of each node from rest, in the body's rest axes, m.
    pub displacement: Vec<[f64; 3]>,
    /// Time that computing the reference took, s.
    pub seconds: f64,
}

impl Reference {
    /// Largest distance of a node from its position in the reference, divided by the reference's largest displacement.
    /// NaN if no node moved or if a displacement is NaN.
    pub fn error(&self, displacement: &[DVec3]) -> f64 {
        let pairs = displacement.iter().zip(&self.displacement);
        pairs.map(|(x, y)| x.distance(DVec3::from_array(*y))).fold(0.0, greater) / self.largest()
    }

    /// The largest displacement of a node, m.
    pub fn largest(&self) -> f64 {
        self.displacement.iter().map(|x| DVec3::from_array(*x).length()).fold(0.0, greater)
    }
}

/// The greater of two numbers, or NaN if one of them is NaN.
fn greater(a: f64, b: f64) -> f64 {
    if a > b || a.is_nan() { a } else { b }
}

/// The reference after `steps` steps of a scene with one soft body that is attached to fixed rigid cores (rigid bodies
/// inside it). It is read from the cache or computed; `watch` is called before each computed step. Errors: a linear
/// system cannot be factorised.
pub fn reference(
    scene: &Scene,
    body: &Body,
    steps: usize,
    cache: &Cache,
    watch: &mut dyn FnMut(&str),
) -> Result<Reference> {
    let Shape::Soft { layer, materials, .. } = &body.shape else {
        return Err(Error::Simulation(format!("the body `{}` is not soft", body.name)));
    };
    let twin = SoftBody::new(layer.clone(), materials, body.position, body.orientation, body.velocity);
    let key = key(scene, &twin, steps)?;
    if let Entry::Found(reference) = cache.load(&key) {
        return Ok(reference);
    }
    let begun = Instant::now();
    let mut simulation = Simulation::new(scene.step.dt, scene.step.gravity);
    simulation.bodies.push(twin);
    for step in 1..=steps {
        watch(&format!("reference in f64, step {step} of {steps} ({:.0} s so far)", begun.elapsed().as_secs_f64()));
        simulation.step(None, &[])?;
    }
    let displacement = simulation.bodies[0].displacement.iter().map(|x| x.to_array()).collect();
    let reference = Reference { displacement, seconds: begun.elapsed().as_secs_f64() };
    if let Err(note) = cache.store(&key, &reference) {
        watch(&note);
    }
    Ok(reference)
}

fn key(scene: &Scene, twin: &SoftBody, steps: usize) -> Result<Key> {
    let mut maker = KeyMaker::of(SOURCES);
    let nodes: Vec<[f64; 3]> = twin.layer.nodes.iter().map(|x| x.to_array()).collect();
    maker.add(bytemuck::cast_slice(&nodes));
    maker.add(bytemuck::cast_slice(&twin.layer.tetrahedra));
    maker.add(&twin.layer.attached.iter().map(|bound| u8::from(*bound)).collect::<Vec<_>>());
    // The debug format of a floating-point number is the shortest text that reads back as this number, so that
    // different inputs give different texts.
    let rest = (
        &twin.elements.materials[..1],
        twin.position,
        twin.elements.frame,
        &twin.velocity,
        scene.step.dt,
        scene.step.gravity,
    );
    maker.add(format!("{rest:?} {steps}").as_bytes());
    Ok(maker.finish())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solver::cases::{Mesh, prepared};

    #[test]
    fn what_is_kept_is_what_was_found_and_belongs_to_its_inputs() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::at(folder.path());
        let find = |young: f64, dt: f64, steps: usize| {
            let scene = Mesh::Block(2).scene(young, dt).unwrap();
            let body = prepared(&scene).unwrap();
            let mut solved = 0;
            (reference(&scene, &body, steps, &cache, &mut |_| solved += 1).unwrap(), solved)
        };
        let (first, solved) = find(2e4, 0.01, 3);
        assert_eq!(solved, 3);
        assert_eq!(find(2e4, 0.01, 3), (first.clone(), 0));
        for (young, dt, steps) in [(3e4, 0.01, 3), (2e4, 0.02, 3), (2e4, 0.01, 4)] {
            let (other, solved) = find(young, dt, steps);
            assert!(solved == steps && other.displacement != first.displacement);
        }
        // The block falls, but less far than it would in free fall.
        let least = first.displacement.iter().map(|x| x[1]).fold(0.0, f64::min);
        assert!(least < -1e-4 && least > -9.81 * 0.01 * 0.01 * 6.0, "lowest displacement of a node: {least} m");
    }

    #[test]
    fn errors_are_of_the_largest_displacement() {
        let reference = Reference { displacement: vec![[0.0; 3], [0.0, 3.0, 4.0]], seconds: 0.0 };
        assert_eq!(reference.error(&[DVec3::X * 0.5, DVec3::new(0.0, 3.0, 4.0)]), 0.1);
        assert!(reference.error(&[DVec3::NAN, DVec3::new(0.0, 3.0, 4.0)]).is_nan());
        assert!(reference.error(&[DVec3::ZERO, DVec3::NAN]).is_nan());
    }
}
