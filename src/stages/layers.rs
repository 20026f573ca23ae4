//! Fills the model (the scene's static arrays, made before the first step) with nodes, tetrahedra and dynamic cores,
//! from a soft body's layer (its tetrahedral simulation mesh) or from the mass of a dynamic rigid body. A core is a
//! rigid body to which nodes are attached; it is dynamic if forces move it. A frame is a rigid coordinate frame; the
//! displacements of nodes are measured in frames.

use crate::shaders;
use glam::{DMat3, DVec3};

use super::material_law::parameters;
use super::model::{Core, FramePlace, Model, Motion, texel};
use crate::prepare::patch::MOST_NODES;
use crate::prepare::{FrameMotion, Layer, Materials, Skin};
use crate::shaders::NONE;

/// Marks an entry of `node_elements` (the list of element forces that add up at each node) that belongs to an F-bar
/// patch (tetrahedra that share one volumetric strain); the entry's index on the GPU can be computed only once the
/// number of all tetrahedra is known.
pub(super) const OF_PATCH: u32 = 1 << 31;

impl Model {
    /// Inertia tensor of the nodes attached to a dynamic core, about its frame's centre, frame axes, kg m^2.
    pub fn inertia_of(&self, core: &Core) -> DMat3 {
        let point = |node: &u32| {
            let [x, y, z, mass] = self.node_rest[*node as usize].map(f64::from);
            let r = DVec3::new(x, y, z);
            mass * (DMat3::from_diagonal(DVec3::splat(r.length_squared()))
                - DMat3::from_cols(r * r.x, r * r.y, r * r.z))
        };
        core.nodes.iter().map(point).fold(DMat3::ZERO, |sum, part| sum + part)
    }

    /// Adds a dynamic core, not joined to any other, with the nodes attached to it.
    fn add_core(&mut self, frame: usize, nodes: Vec<u32>) {
        let own = self.cores.len();
        self.cores.push(Core { frame, nodes, hinge: self.hinge(frame), group: own..own + 1, parent: None });
    }

    /// The hinge axis of a frame, a unit vector in world axes; zero where the frame has no hinge.
    fn hinge(&self, frame: usize) -> DVec3 {
        let FramePlace { orientation, motion, .. } = &self.frames[frame];
        match motion {
            Motion::Prepared(FrameMotion::Dynamic { hinge: Some(hinge), .. }) => *orientation * hinge.axis,
            _ => DVec3::ZERO,
        }
    }

    /// Adds a dynamic rigid body: four point masses attached to a core, which together have the body's centre of mass
    /// and inertia, and its skin (surface mesh) embedded in the tetrahedron between them. The solver then treats the
    /// body like any other core. The mass is in kg, the centre in the body's rest frame in m, and the inertia about
    /// that centre in kg m^2.
    pub(super) fn add_masses(
        &mut self,
        frame: usize,
        (mass, centre, inertia): (f64, DVec3, DMat3),
        velocity: DVec3,
        skin: &Skin,
    ) {
        // The corners x of this regular tetrahedron have sum x x^T / 4 = I, the identity. Point masses m / 4 at S x
        // have the second moment m S S^T; S is chosen so that they have the body's inertia.
        let corners = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]].map(DVec3::from_array);
        let trace = inertia.x_axis.x + inertia.y_axis.y + inertia.z_axis.z;
        let square = (DMat3::from_diagonal(DVec3::splat(0.5 * trace)) - inertia) * (1.0 / mass);
        let shape = lower_root(square);
        let node_first = self.node_rest.len() as u32;
        for corner in corners {
            self.attached_nodes.push(self.node_rest.len() as u32);
            self.node_info.push([self.node_elements.len() as u32, 0, frame as u32, shaders::NODE_ATTACHED]);
            self.node_rest.push(texel(shape * corner + centre - self.frames[frame].rest_centre, 0.25 * mass));
            self.node_damping.push(0.0);
            self.velocity.push(texel(velocity, 0.0));
        }
        let back = shape.inverse();
        for x in &skin.vertices {
            let at = back * (*x - centre);
            self.skin_nodes.push([0, 1, 2, 3].map(|k| node_first + k));
            self.skin_weights.push(corners.map(|corner| (0.25 * (1.0 + corner.dot(at))) as f32));
        }
        self.add_core(frame, (node_first..node_first + 4).collect());
    }

    /// Adds the nodes and tetrahedra of a soft body whose frames have been added already, from index `frame_first` on;
    /// `node_frames`: the frame of each node, counted from `frame_first`.
    pub(super) fn add_layer(
        &mut self,
        layer: &Layer,
        node_frames: &[u32],
        materials: &Materials,
        frame_first: usize,
        velocity: DVec3,
    ) {
        let node_first = self.node_rest.len();
        let tetrahedron_first = self.tetrahedra.len();
        let material_first = self.materials.len();
        self.materials.extend(materials.all.iter().map(parameters));
        let frame_of = |n: u32| frame_first as u32 + node_frames[n as usize];
        let dynamic = |frame: u32| match self.frames[frame as usize].motion {
            Motion::Prepared(FrameMotion::Dynamic { mass, .. }) => Some(mass),
            _ => None,
        };
        let carries: Vec<Option<Option<f64>>> = (0..layer.nodes.len())
            .map(|n| if layer.attached[n] { dynamic(frame_of(n as u32)) } else { None })
            .collect();
        let mut mass = vec![0.0; layer.nodes.len()];
        let mut damping = mass.clone();
        let mut entries = vec![Vec::new(); layer.nodes.len()];
        // Whether a tetrahedron lies within one core, so that it does not deform.
        let rigid = |t: usize| {
            let nodes = layer.tetrahedra[t];
            nodes.iter().all(|n| layer.attached[*n as usize] && frame_of(*n) == frame_of(nodes[0]))
        };
        for (t, nodes) in layer.tetrahedra.iter().enumerate() {
            let x = nodes.map(|n| layer.nodes[n as usize]);
            let edges = glam::DMat3::from_cols(x[1] - x[0], x[2] - x[0], x[3] - x[0]);
            let volume = edges.determinant() / 6.0;
            let gradients = edges.inverse().transpose();
            let frame = frame_of(nodes[0]);
            let links = nodes.map(|n| self.link(frame, frame_of(n)));
            self.tetrahedra.push(nodes.map(|n| n + node_first as u32));
            self.tetrahedron_links.push(links);
            self.rest_gradients.push(texel(gradients.x_axis, volume.sqrt()));
            let material = materials.of(t);
            self.rest_gradients.extend([gradients.y_axis, gradients.z_axis].map(|g| texel(g, 0.0)));
            self.element_info.push([(material_first + materials.index(t)) as u32, frame]);
            for (corner, n) in nodes.iter().enumerate() {
                mass[*n as usize] += 0.25 * material.density * volume;
                damping[*n as usize] += 0.25 * material.damping_mass * material.density * volume;
                // The nodes of a dynamic core get no force from a tetrahedron within it.
                if !(rigid(t) && carries[*n as usize].is_some()) {
                    entries[*n as usize].push((4 * (tetrahedron_first + t) + corner) as u32);
                }
            }
        }
        let patch_first = self.patches.count();
        let moduli = |t: usize| {
            let material = parameters(materials.of(t));
            [material.lambda, material.damping].map(f64::from)
        };
        self.patches.add(layer, node_first, moduli, rigid);
        for t in 0..layer.tetrahedra.len() {
            let own = tetrahedron_first + t;
            if !rigid(t) || self.patches.of[own] != NONE {
                let [material, frame] = self.element_info[own];
                self.deforming.push([own as u32, material, frame, 0]);
            }
        }
        for (node, [patch, place]) in self.patches.entries(patch_first) {
            entries[node as usize - node_first].push(OF_PATCH | (MOST_NODES as u32 * patch + place));
        }
        for (i, rest) in layer.nodes.iter().enumerate() {
            let frame = frame_of(i as u32);
            let place = &self.frames[frame as usize];
            // A node that belongs to no tetrahedron has no mass and stays at rest in its frame.
            let bound = layer.attached[i] || mass[i] == 0.0;
            let holder = match carries[i] {
                Some(_) => shaders::NODE_ATTACHED,
                None if bound => shaders::NODE_KINEMATIC,
                None => shaders::NODE_FREE,
            };
            if bound
                && matches!(place.motion, Motion::Prepared(FrameMotion::Kinematic(_) | FrameMotion::Dynamic { .. }))
            {
                self.attached_nodes.push((node_first + i) as u32);
            }
            // A node's entries fill whole groups of four; `NONE` pads the last group, and is replaced once the number
            // of all tetrahedra is known.
            let quads = entries[i].len().div_ceil(4);
            self.node_info.push([self.node_elements.len() as u32, quads as u32, frame, holder]);
            for quad in entries[i].chunks(4) {
                self.node_elements.push(std::array::from_fn(|k| quad.get(k).copied().unwrap_or(NONE)));
            }
            self.node_rest.push(texel(*rest - place.rest_centre, mass[i]));
            self.node_damping.push(damping[i] as f32);
            self.velocity.push(texel(if holder == shaders::NODE_KINEMATIC { DVec3::ZERO } else { velocity }, 0.0));
        }
        for frame in frame_first..self.frames.len() {
            if let Motion::Prepared(FrameMotion::Dynamic { mass: wanted, .. }) = self.frames[frame].motion {
                let own = |n: &usize| layer.attached[*n] && frame_of(*n as u32) == frame as u32;
                let nodes: Vec<u32> = (0..layer.nodes.len()).filter(own).map(|n| (node_first + n) as u32).collect();
                let own_mass: f64 = nodes.iter().map(|n| mass[*n as usize - node_first]).sum();
                let factor = wanted.map_or(1.0, |wanted| wanted / own_mass);
                for node in &nodes {
                    self.node_rest[*node as usize][3] *= factor as f32;
                    self.node_damping[*node as usize] *= factor as f32;
                }
                self.add_core(frame, nodes);
            }
        }
    }
}

/// Cholesky factor L of a symmetric positive definite matrix a: L L^T = a.
fn lower_root(a: DMat3) -> DMat3 {
    let l00 = a.x_axis.x.sqrt();
    let (l10, l20) = (a.x_axis.y / l00, a.x_axis.z / l00);
    let l11 = (a.y_axis.y - l10 * l10).sqrt();
    let l21 = (a.y_axis.z - l10 * l20) / l11;
    let l22 = (a.z_axis.z - l20 * l20 - l21 * l21).sqrt();
    DMat3::from_cols(DVec3::new(l00, l10, l20), DVec3::new(0.0, l11, l21), DVec3::new(0.0, 0.0, l22))
}
