//! Newton iterations of a step: elasticity is linearised again at the trial state, the state that results from the last
//! solve. Each solve is for the whole change of velocity from the start of the step, so the solution of the last solve
//! is the result of the step. Terms that do not depend on displacement here (inertia, contacts, and the lever arms of
//! nodes on rigid cores inside the bodies) keep their values from the start of the step. Apart from these terms,
//! implicit Euler is solved exactly at the fixed point.

use glam::{DMat3, DQuat, DVec3};
use palpate::scene::Material;

use super::body::SoftBody;
use super::elastic::outer;
use super::linear::Entries;
use super::step::{Map, Simulation, Unknowns, add_mapped};

/// State at which a body's elasticity is linearised.
pub(super) struct Trial {
    /// Displacement of each node, rest axes, m.
    pub displacement: Vec<DVec3>,
    /// Velocity v_t of each node at the end of the step, world, m/s; `displacement` already contains the motion at v_t
    /// over the step. It is zero in the first iteration, which linearises at the start of the step.
    pub velocity: Vec<DVec3>,
    /// Rotation of each tetrahedron.
    pub rotations: Vec<DQuat>,
}

impl Trial {
    /// The state at the start of the step.
    pub fn start(body: &SoftBody) -> Trial {
        Trial {
            displacement: body.displacement.clone(),
            velocity: vec![DVec3::ZERO; body.displacement.len()],
            rotations: body.rotations(),
        }
    }
}

impl Simulation {
    /// Adds a body to the system A x = b of a step of h seconds: to A (1 + h alpha) M + (h^2 + h beta) K, and to b
    /// h [M g + f_el - alpha M v - (beta + h) K v + h K v_t], with mass M, gravity g, damping coefficients alpha and
    /// beta of each element, velocity v at the start, and elastic force f_el, stiffness K and velocity v_t of the trial
    /// state.
    pub(super) fn add_body(&self, a: &mut Entries, b: &mut [f64], body: &SoftBody, trial: &Trial, unknowns: &[Map]) {
        let Trial { displacement, rotations, .. } = trial;
        let (h, mut elements) = (self.dt, body.elements.linearised(displacement, rotations));
        for (nodes, operator) in elements.tetrahedra.iter().zip(&mut elements.operators) {
            // A tetrahedron whose nodes are all attached to one core does not deform. Its operator at the trial state
            // is left out, because it would respond to the core's motion, while the lever arms on the core are those of
            // the start.
            let [first, others @ ..] = nodes.map(|n| &unknowns[n as usize]);
            if first.len() > 1 && others.iter().all(|map| map.len() > 1 && map[0].0 == first[0].0) {
                (operator.mu, operator.lambda) = (0.0, 0.0);
            }
        }
        let weight = |material: &Material| h * (h + material.damping_stiffness);
        for (e, nodes) in elements.tetrahedra.iter().enumerate() {
            let blocks = elements.stiffness_blocks(e, rotations[e]);
            for (k, i) in nodes.iter().enumerate() {
                for (l, j) in nodes.iter().enumerate() {
                    let block = blocks[k][l] * weight(&elements.materials[e]);
                    add_mapped(a, &unknowns[*i as usize], &unknowns[*j as usize], &block);
                }
            }
        }
        for row in elements.weighted_patch_rows(rotations, weight) {
            for (i, left) in &row {
                for (j, right) in &row {
                    let block = outer(*left, *right);
                    add_mapped(a, &unknowns[*i as usize], &unknowns[*j as usize], &block);
                }
            }
        }
        let elastic = elements.forces(displacement, rotations);
        let stiff = elements.apply_weighted(&body.velocity, rotations, weight);
        let held = elements.apply_weighted(&trial.velocity, rotations, |_| h * h);
        for (i, map) in unknowns.iter().enumerate() {
            let (mass, damping) = (elements.masses[i], elements.damping[i]);
            let inertial = mass * self.gravity - damping * body.velocity[i];
            let load = h * (inertial + elastic[i]) - stiff[i] + held[i];
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
            let velocity: Vec<DVec3> = body.velocity.iter().zip(gained).map(|(v, x)| *v + x).collect();
            let back = body.elements.frame.transpose();
            let moved = body.displacement.iter().zip(&velocity).map(|(d, v)| *d + self.dt * (back * *v));
            trials.push(Trial { displacement: moved.collect(), velocity, rotations: Vec::new() });
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
