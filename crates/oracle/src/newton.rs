//! Newton iterations of a step: elasticity is linearised again at the trial state, the state that results from the last
//! solve. Each solve is for the whole change of velocity from the start of the step, so the solution of the last solve
//! is the result of the step. Terms that do not depend on displacement here (inertia, contacts, and the lever arms of
//! nodes on rigid cores inside the bodies) keep their values from the start of the step. Apart from these terms,
//! implicit Euler is solved exactly at the fixed point.

use glam::{DMat3, DQuat, DVec3};
use palpate::scene::Material;

use super::body::SoftBody;
use super::elastic::{Weight, outer};
use super::linear::Entries;
use super::step::{Map, Simulation, Unknowns, add_mapped};

/// State at which a body's elasticity is linearised.
pub(super) struct Trial {
    /// Displacement of each node, rest axes, m.
    pub displacement: Vec<DVec3>,
    /// Change x_t of each node's velocity over the step, world, m/s; `displacement` already contains the motion at the
    /// velocity v + x_t over the step. `None` in the first iteration, which linearises at the start of the step.
    pub change: Option<Vec<DVec3>>,
    /// Rotation of each tetrahedron.
    pub rotations: Vec<DQuat>,
}

impl Trial {
    /// The state at the start of the step.
    pub fn start(body: &SoftBody) -> Trial {
        Trial { displacement: body.displacement.clone(), change: None, rotations: body.rotations() }
    }
}

impl Simulation {
    /// Adds a body to the system A x = b of a step of h seconds: to A (1 + h alpha) M + (h^2 + h beta) K, and to b
    /// h [M g + f_el - alpha M v - beta K v] + h^2 f'_el in the first iteration, h [..] + h^2 K x_t in later ones, with
    /// mass M, gravity g, damping coefficients alpha and beta of each element, velocity v at the start, and elastic force
    /// f_el, its rate f'_el at v, stiffness K and change of velocity x_t of the trial state. Terms of beta are without
    /// geometric stiffness.
    pub(super) fn add_body(&self, a: &mut Entries, b: &mut [f64], body: &SoftBody, trial: &Trial, unknowns: &[Map]) {
        let Trial { displacement, rotations, .. } = trial;
        let (h, mut elements) = (self.dt, body.elements.linearised(displacement, rotations));
        for (nodes, operator) in elements.tetrahedra.iter().zip(&mut elements.operators) {
            // A tetrahedron whose nodes are all attached to one core does not deform. Its operator at the trial state
            // is left out, because it would respond to the core's motion, while the lever arms on the core are those of
            // the start.
            let [first, others @ ..] = nodes.map(|n| &unknowns[n as usize]);
            if first.len() > 1 && others.iter().all(|map| map.len() > 1 && map[0].0 == first[0].0) {
                (operator.mu, operator.lambda, operator.geometric) = (0.0, 0.0, DMat3::ZERO);
            }
        }
        let weight = |material: &Material| Weight::of_step(h, material);
        for (e, nodes) in elements.tetrahedra.iter().enumerate() {
            let blocks = elements.stiffness_blocks(e, rotations[e], weight(&elements.materials[e]));
            for (k, i) in nodes.iter().enumerate() {
                for (l, j) in nodes.iter().enumerate() {
                    add_mapped(a, &unknowns[*i as usize], &unknowns[*j as usize], &blocks[k][l]);
                }
            }
        }
        for row in elements.weighted_patch_rows(rotations, |material| weight(material).moduli) {
            for (i, left) in &row {
                for (j, right) in &row {
                    let block = outer(*left, *right);
                    add_mapped(a, &unknowns[*i as usize], &unknowns[*j as usize], &block);
                }
            }
        }
        let elastic = elements.impulses(displacement, rotations, &body.velocity, trial.change.as_deref(), h);
        for (i, map) in unknowns.iter().enumerate() {
            let (mass, damping) = (elements.masses[i], elements.damping[i]);
            let inertial = mass * self.gravity - damping * body.velocity[i];
            let load = h * inertial + elastic[i];
            add_mapped(a, map, map, &DMat3::from_diagonal(DVec3::splat(mass + h * damping)));
            for (first, matrix) in map {
                let mapped = matrix.transpose() * load;
                (0..3).for_each(|axis| b[first + axis] += mapped[axis]);
            }
        }
    }

    /// The trial states of the bodies at the end of the step that result from `change`, the change of the unknown
    /// velocities.
    pub(super) fn trials(&self, unknowns: &Unknowns, change: &[f64]) -> Vec<Trial> {
        let three = |first: usize| DVec3::from_slice(&change[first..first + 3]);
        let mut trials = Vec::new();
        for (body, maps) in self.bodies.iter().zip(&unknowns.nodes) {
            let gained = maps.iter().map(|map| map.iter().map(|(first, p)| *p * three(*first)).sum::<DVec3>());
            let change: Vec<DVec3> = gained.collect();
            let velocity = body.velocity.iter().zip(&change).map(|(v, x)| *v + *x);
            let back = body.elements.frame.transpose();
            let displacement = body.displacement.iter().zip(velocity).map(|(d, v)| *d + self.dt * (back * v)).collect();
            trials.push(Trial { displacement, change: Some(change), rotations: Vec::new() });
        }
        for (core, first) in self.cores.iter().zip(&unknowns.cores) {
            let turn = DQuat::from_scaled_axis(self.dt * (core.spin + three(first + 3)));
            let centre = core.centre + self.dt * (core.velocity + three(*first));
            for (index, node) in &core.nodes {
                let body = &self.bodies[*index];
                let place = centre + turn * (body.world_node(*node) - core.centre);
                let rest = body.elements.frame.transpose() * (place - body.position);
                trials[*index].displacement[*node as usize] = rest - body.layer.nodes[*node as usize];
            }
        }
        for (trial, body) in trials.iter_mut().zip(&self.bodies) {
            trial.rotations = body.elements.rotations(&trial.displacement);
        }
        trials
    }
}
