//! Elasticity of tetrahedra in f64: rotations, forces and the stiffness operator, for corotational and
//! (`neo_hookean.rs`) neo-Hookean materials. Reference implementation of the elastic stage of a step. The strain of a
//! tetrahedron is E = R^T F - I, with its rotation R and deformation gradient F; mu and lambda are Lamé's parameters.
//!
//! A layer (tetrahedral mesh of a soft body) may have F-bar patches against volumetric locking: groups of tetrahedra
//! that share one volumetric strain theta, the mean of their tr(E) weighted by their volumes V (de Souza Neto, Andrade
//! Pires and Owen 2005). The energy sum V (mu |E|^2 + lambda/2 theta^2) keeps the stiffness symmetric positive
//! semi-definite. Each tetrahedron has a term of mu of its own, which makes a patch internally as stable as a material
//! whose Poisson's ratio is zero.
//!
//! Methods: Müller and Gross, "Interactive Virtual Materials" (2004); the polar rotation by singular value
//! decomposition has the sign convention of Irving, Teran and Fedkiw, "Invertible Finite Elements" (2004).

use std::collections::BTreeMap;

use faer::{Mat, Side};
use glam::{DMat3, DQuat, DVec3};
use palpate::internal::prepare::{Layer, Materials};
use palpate::scene::Material;

use super::material_law;

/// A layer's tetrahedra with precomputed data. Arrays have an element for each node or for each tetrahedron.
#[derive(Debug, Clone)]
pub struct Elements {
    /// Four node indices of each tetrahedron.
    pub tetrahedra: Vec<[u32; 4]>,
    /// Rest gradients of the four shape functions, 1/m, rest axes.
    pub gradients: Vec<[DVec3; 4]>,
    /// Rest volumes, m^3.
    pub volumes: Vec<f64>,
    /// Lumped node masses, kg: density times a quarter of each adjacent volume.
    pub masses: Vec<f64>,
    /// Mass-proportional damping of each node, kg/s: the material's damping coefficient alpha (1/s) times density times
    /// a quarter of each adjacent volume.
    pub damping: Vec<f64>,
    /// Rotation from rest axes to world axes.
    pub frame: DMat3,
    /// The material of each tetrahedron.
    pub materials: Vec<Material>,
    /// Stiffness of each tetrahedron, its part of the whole stiffness K; see [`Elements::linearised`].
    pub operators: Vec<Operator>,
    /// Index of the F-bar patch of each tetrahedron, only if all materials are corotational; empty: each tetrahedron
    /// has its own volumetric strain.
    pub patches: Vec<u32>,
}

/// Stiffness K of a tetrahedron: the product with node vectors p_j is, at node i,
/// (K p)_i = V (2 mu sym(W) + lambda tr(W) I) g'_i + V/2 (Z w) x g'_i, with W = sum p_j g'_j^T over its nodes j and
/// g'_j = R `fold` g_j, for rest gradients g_j of the shape functions, rotation R and rest volume V; w is the axial
/// vector of the skew part of W.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Operator {
    /// Shear modulus, Pa.
    pub mu: f64,
    /// Lamé's first parameter, Pa.
    pub lambda: f64,
    /// Symmetric matrix that maps rest gradients to gradients of the deformed tetrahedron; the identity for linear
    /// elasticity.
    pub fold: DMat3,
    /// Geometric stiffness Z, Pa, before the rotation R: symmetric, positive semi-definite, zero where nothing is
    /// stretched.
    pub geometric: DMat3,
}

/// Weights of the two parts of the stiffness K: of the moduli mu and lambda, and of the geometric stiffness.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weight {
    /// Weight of mu and lambda.
    pub moduli: f64,
    /// Weight of the geometric stiffness.
    pub geometric: f64,
}

impl Weight {
    /// Weights that are equal for both parts of the stiffness.
    pub const fn both(weight: f64) -> Weight {
        Weight { moduli: weight, geometric: weight }
    }

    /// Weights in a step of `h` seconds: h^2, and for the moduli h beta besides, with stiffness-proportional damping
    /// beta. Geometric stiffness has no damping, which would act on rigid rotation.
    pub fn of_step(h: f64, material: &Material) -> Weight {
        Weight { moduli: h * (h + material.damping_stiffness), geometric: h * h }
    }
}

impl Operator {
    /// Operator of linear elasticity; `lambda` is Lamé's first parameter without the part that an F-bar patch applies,
    /// Pa.
    pub(super) fn linear(material: &Material, lambda: f64) -> Operator {
        Operator { mu: lame(material).0, lambda, fold: DMat3::IDENTITY, geometric: DMat3::ZERO }
    }

    /// Stress of linear elasticity, 2 mu sym(E) + lambda tr(E) I.
    pub(super) fn stress(&self, strain: DMat3) -> DMat3 {
        symmetric(strain) * (2.0 * self.mu) + DMat3::from_diagonal(DVec3::splat(self.lambda * trace(strain)))
    }
}

impl Elements {
    /// Precomputes gradients, volumes and masses. `frame` rotates rest axes into world axes.
    pub fn new(layer: &Layer, materials: impl Into<Materials>, frame: DMat3) -> Self {
        let all = materials.into();
        let (mut masses, mut damping) = (vec![0.0; layer.nodes.len()], vec![0.0; layer.nodes.len()]);
        let mut gradients = Vec::with_capacity(layer.tetrahedra.len());
        let mut volumes = Vec::with_capacity(layer.tetrahedra.len());
        let materials: Vec<Material> = (0..layer.tetrahedra.len()).map(|t| *all.of(t)).collect();
        for (nodes, material) in layer.tetrahedra.iter().zip(&materials) {
            let [x0, x1, x2, x3] = nodes.map(|i| layer.nodes[i as usize]);
            let edges = DMat3::from_cols(x1 - x0, x2 - x0, x3 - x0);
            let volume = edges.determinant() / 6.0;
            let inverse = edges.inverse().transpose();
            let [g1, g2, g3] = [inverse.col(0), inverse.col(1), inverse.col(2)];
            gradients.push([-(g1 + g2 + g3), g1, g2, g3]);
            volumes.push(volume);
            for &i in nodes {
                masses[i as usize] += material.density * volume / 4.0;
                damping[i as usize] += material.damping_mass * material.density * volume / 4.0;
            }
        }
        let (tetrahedra, patches) = (layer.tetrahedra.clone(), layer.patches.clone());
        let mut elements =
            Self { tetrahedra, gradients, volumes, masses, damping, frame, materials, operators: Vec::new(), patches };
        elements.operators = (0..elements.tetrahedra.len())
            .map(|e| Operator::linear(&elements.materials[e], elements.own_lambda(e)))
            .collect();
        elements
    }

    /// Number of nodes.
    pub fn node_count(&self) -> usize {
        self.masses.len()
    }

    /// Gradient G = sum d_i g_i^T of node vectors d_i (rest axes) in a tetrahedron with rest gradients g_i.
    pub fn gradient(&self, element: usize, d: &[DVec3]) -> DMat3 {
        let nodes = self.tetrahedra[element];
        let mut sum = DMat3::ZERO;
        for (i, g) in nodes.iter().zip(&self.gradients[element]) {
            sum += outer(d[*i as usize], *g);
        }
        sum
    }

    /// Proper polar rotation of F = I + G of every tetrahedron, with the gradient G of the displacements `d` (m, rest
    /// axes).
    pub fn rotations(&self, d: &[DVec3]) -> Vec<DQuat> {
        (0..self.tetrahedra.len()).map(|e| polar_rotation(DMat3::IDENTITY + self.gradient(e, d))).collect()
    }

    /// Elastic forces on nodes, N, world axes. `d`: displacements, m, rest axes; `rotations`: one for each tetrahedron.
    pub fn forces(&self, d: &[DVec3], rotations: &[DQuat]) -> Vec<DVec3> {
        let mut forces = vec![DVec3::ZERO; self.node_count()];
        let strains: Vec<_> =
            (0..rotations.len()).map(|e| strain(rotations[e].normalize(), self.gradient(e, d))).collect();
        let pressures = self.patch_pressures(&strains);
        for (e, nodes) in self.tetrahedra.iter().enumerate() {
            let of_law = material_law::stress(&self.materials[e], self.own_lambda(e), strains[e]) + pressures[e];
            let stress = DMat3::from_quat(rotations[e].normalize()) * of_law;
            for (i, g) in nodes.iter().zip(&self.gradients[e]) {
                forces[*i as usize] -= self.frame * (stress * *g) * self.volumes[e];
            }
        }
        forces
    }

    /// Rate, N/s, world axes, at which the elastic forces change at displacements `d` (m, rest axes) and velocities `v`
    /// (m/s, world axes); see [`material_law::stress_rate`].
    pub fn force_rates(&self, d: &[DVec3], rotations: &[DQuat], v: &[DVec3]) -> Vec<DVec3> {
        let local: Vec<DVec3> = v.iter().map(|v| self.frame.transpose() * *v).collect();
        let turn = |e: usize| DMat3::from_quat(rotations[e].normalize());
        let rates: Vec<_> = (0..rotations.len()).map(|e| turn(e).transpose() * self.gradient(e, &local)).collect();
        let pressures = self.patch_pressures(&rates);
        let mut sum = vec![DVec3::ZERO; self.node_count()];
        for (e, nodes) in self.tetrahedra.iter().enumerate() {
            let strain = strain(rotations[e].normalize(), self.gradient(e, d));
            let of_law = material_law::stress_rate(&self.materials[e], self.own_lambda(e), strain, rates[e]);
            let rate = turn(e) * (of_law + pressures[e]);
            for (i, g) in nodes.iter().zip(&self.gradients[e]) {
                sum[*i as usize] -= self.frame * (rate * *g) * self.volumes[e];
            }
        }
        sum
    }

    /// Stiffness product K p with rotations held fixed; p and the product are in world axes.
    pub fn apply_stiffness(&self, p: &[DVec3], rotations: &[DQuat]) -> Vec<DVec3> {
        self.apply_weighted(p, rotations, |_| Weight::both(1.0))
    }

    /// Stiffness product K p in which the K of every tetrahedron is multiplied by a weight that depends on its
    /// material.
    pub fn apply_weighted(&self, p: &[DVec3], rotations: &[DQuat], weight: impl Fn(&Material) -> Weight) -> Vec<DVec3> {
        let to_rest = self.frame.transpose();
        let local: Vec<DVec3> = p.iter().map(|p| to_rest * *p).collect();
        let mut product = vec![DVec3::ZERO; self.node_count()];
        let turns: Vec<_> = rotations.iter().map(|q| DMat3::from_quat(q.normalize())).collect();
        let strain = |(e, r): (usize, &DMat3)| r.transpose() * self.gradient(e, &local) * self.operators[e].fold;
        let strains: Vec<_> = turns.iter().enumerate().map(strain).collect();
        let pressures = self.patch_pressures(&strains);
        for (e, nodes) in self.tetrahedra.iter().enumerate() {
            let operator = &self.operators[e];
            let Weight { moduli, geometric } = weight(&self.materials[e]);
            let turning = cross_matrix(operator.geometric * axial(strains[e])) * 0.5;
            let stress = (operator.stress(strains[e]) + pressures[e]) * moduli + turning * geometric;
            let stress = turns[e] * stress * operator.fold;
            for (i, g) in nodes.iter().zip(&self.gradients[e]) {
                product[*i as usize] += self.frame * (stress * *g) * self.volumes[e];
            }
        }
        product
    }

    /// Damping forces beta K v, N, world axes, of stiffness-proportional damping beta at velocities `v` (m/s, world axes);
    /// K is without geometric stiffness.
    pub fn viscous_forces(&self, v: &[DVec3], rotations: &[DQuat]) -> Vec<DVec3> {
        let weight = |material: &Material| Weight { moduli: material.damping_stiffness, geometric: 0.0 };
        self.apply_weighted(v, rotations, weight)
    }

    /// What elasticity and stiffness-proportional damping beta add to the right-hand side of a step of `h` seconds, N s:
    /// h (f + h f' - beta K v) in the first Newton iteration, with the forces f at displacements `d` and their rate f' at
    /// the velocities v; h (f + h K x - beta K v) in later ones, which linearise where the change of velocity x has led.
    /// The operators must be those at `d`; the K of beta is without geometric stiffness.
    pub fn impulses(
        &self,
        d: &[DVec3],
        rotations: &[DQuat],
        velocity: &[DVec3],
        change: Option<&[DVec3]>,
        h: f64,
    ) -> Vec<DVec3> {
        let viscous = self.viscous_forces(velocity, rotations);
        let linear = match change {
            None => self.force_rates(d, rotations, velocity),
            Some(change) => self.apply_stiffness(change, rotations),
        };
        let forces = self.forces(d, rotations);
        forces.iter().zip(&viscous).zip(&linear).map(|((f, damped), linear)| h * (*f - *damped + h * *linear)).collect()
    }

    /// The 3x3 blocks K_ij of one tetrahedron, world axes, rotations held fixed, times the weights:
    /// K_ij = V (mu ((g'_i . g'_j) I + g'_j g'_i^T) + lambda g'_i g'_j^T) + V/4 [g'_i]^T Z [g'_j], see [`Operator`],
    /// with `[g]` the cross product matrix of g. The term of lambda of F-bar patches is in [`Elements::patch_rows`].
    pub fn stiffness_blocks(&self, element: usize, rotation: DQuat, weight: Weight) -> [[DMat3; 4]; 4] {
        let operator = &self.operators[element];
        let turn = self.frame * DMat3::from_quat(rotation.normalize());
        let g = self.gradients[element].map(|g| turn * operator.fold * g);
        let geometric = turn * operator.geometric * turn.transpose() * (0.25 * weight.geometric);
        let block = |i: usize, j: usize| {
            let shear = DMat3::from_diagonal(DVec3::splat(g[i].dot(g[j]))) + outer(g[j], g[i]);
            let moduli = (shear * operator.mu + outer(g[i], g[j]) * operator.lambda) * weight.moduli;
            (moduli + cross_matrix(g[i]).transpose() * geometric * cross_matrix(g[j])) * self.volumes[element]
        };
        std::array::from_fn(|i| std::array::from_fn(|j| block(i, j)))
    }

    /// The contribution c c^T of each F-bar patch to the stiffness, as its nodes j with their vectors
    /// c_j = sqrt(lambda / V) sum V_e R_e g_ej, sqrt(N/m), world axes. The sum is over the tetrahedra e of the patch
    /// with volume V_e, rotation R_e and rest gradient g_ej; V is the volume of the patch.
    pub fn patch_rows(&self, rotations: &[DQuat]) -> Vec<BTreeMap<u32, DVec3>> {
        self.weighted_patch_rows(rotations, |_| 1.0)
    }

    /// The vectors c_j of [`Elements::patch_rows`], with the stiffness of each F-bar patch multiplied by a weight that
    /// depends on its material.
    pub fn weighted_patch_rows(
        &self,
        rotations: &[DQuat],
        weight: impl Fn(&Material) -> f64,
    ) -> Vec<BTreeMap<u32, DVec3>> {
        let volumes = self.patch_volumes();
        let mut rows = vec![BTreeMap::new(); volumes.len()];
        for (e, patch) in self.patches.iter().enumerate() {
            let patch = *patch as usize;
            let turn = self.frame * DMat3::from_quat(rotations[e].normalize());
            let stiffness = weight(&self.materials[e]) * lame(&self.materials[e]).1;
            let scale = (stiffness / volumes[patch]).sqrt() * self.volumes[e];
            for (i, g) in self.tetrahedra[e].iter().zip(&self.gradients[e]) {
                *rows[patch].entry(*i).or_insert(DVec3::ZERO) += scale * (turn * *g);
            }
        }
        rows
    }

    /// Volume of each F-bar patch, m^3.
    fn patch_volumes(&self) -> Vec<f64> {
        let mut volumes = vec![0.0; self.patches.iter().max().map_or(0, |last| *last as usize + 1)];
        self.patches.iter().zip(&self.volumes).for_each(|(patch, volume)| volumes[*patch as usize] += volume);
        volumes
    }

    /// Stress lambda theta I that the F-bar patch of each tetrahedron causes, Pa, with theta the volume-weighted mean
    /// of tr(E) in the patch; zero without patches.
    fn patch_pressures(&self, strains: &[DMat3]) -> Vec<DMat3> {
        if self.patches.is_empty() {
            return vec![DMat3::ZERO; strains.len()];
        }
        let means = self.dilatations(strains);
        let pressure = |(e, theta)| DMat3::from_diagonal(DVec3::splat(lame(&self.materials[e]).1 * theta));
        means.into_iter().enumerate().map(pressure).collect()
    }

    /// Lamé's lambda of a tetrahedron without the part that its F-bar patch applies, Pa; zero where patches apply all
    /// of it.
    fn own_lambda(&self, element: usize) -> f64 {
        if self.patches.is_empty() { lame(&self.materials[element]).1 } else { 0.0 }
    }

    /// Volumetric strain of each tetrahedron: tr(E) of its strain E, or the mean of tr(E) over its F-bar patch,
    /// weighted by volume.
    pub fn dilatations(&self, strains: &[DMat3]) -> Vec<f64> {
        if self.patches.is_empty() {
            return strains.iter().map(|e| trace(*e)).collect();
        }
        let volumes = self.patch_volumes();
        let mut means = vec![0.0; volumes.len()];
        for (e, patch) in self.patches.iter().enumerate() {
            means[*patch as usize] += self.volumes[e] * trace(strains[e]) / volumes[*patch as usize];
        }
        self.patches.iter().map(|patch| means[*patch as usize]).collect()
    }

    /// Elastic energy, J, at displacements `d` (m, rest axes).
    pub fn energy(&self, d: &[DVec3], rotations: &[DQuat]) -> f64 {
        self.densities(d, rotations).iter().zip(&self.volumes).map(|(density, volume)| volume * density).sum()
    }

    /// Elastic energy density of each tetrahedron, J/m^3: for corotational materials mu |E|^2 + lambda/2 theta^2, with
    /// E = sym(R^T F) - I and theta the trace of E, or its mean over the F-bar patch; for other materials the density
    /// of their law. The density of the compression penalty is added.
    pub fn densities(&self, d: &[DVec3], rotations: &[DQuat]) -> Vec<f64> {
        let strains: Vec<_> =
            (0..rotations.len()).map(|e| strain(rotations[e].normalize(), self.gradient(e, d))).collect();
        let dilatations = self.dilatations(&strains);
        let density = |e: usize| material_law::energy(&self.materials[e], strains[e], dilatations[e]);
        (0..self.tetrahedra.len()).map(density).collect()
    }

    /// Cauchy's stress of each tetrahedron, P F^T / det F with its stress P, Pa, world axes; zero where det F is not
    /// positive.
    pub fn stresses(&self, d: &[DVec3], rotations: &[DQuat]) -> Vec<DMat3> {
        let strains: Vec<_> =
            (0..rotations.len()).map(|e| strain(rotations[e].normalize(), self.gradient(e, d))).collect();
        let pressures = self.patch_pressures(&strains);
        let stress = |e: usize| {
            let f = DMat3::IDENTITY + self.gradient(e, d);
            if f.determinant() <= 0.0 {
                return DMat3::ZERO;
            }
            let of_law = material_law::stress(&self.materials[e], self.own_lambda(e), strains[e]) + pressures[e];
            let cauchy = DMat3::from_quat(rotations[e].normalize()) * of_law * f.transpose() * f.determinant().recip();
            self.frame * cauchy * self.frame.transpose()
        };
        (0..self.tetrahedra.len()).map(stress).collect()
    }

    /// A copy of these elements, with the operators linearised at displacements `d` (m, rest axes).
    pub fn linearised(&self, d: &[DVec3], rotations: &[DQuat]) -> Self {
        let operator = |e: usize| {
            let strain = strain(rotations[e].normalize(), self.gradient(e, d));
            material_law::operator(&self.materials[e], self.own_lambda(e), strain)
        };
        Self { operators: (0..self.tetrahedra.len()).map(operator).collect(), ..self.clone() }
    }
}

/// Shear modulus and Lamé's first parameter, Pa.
pub fn lame(material: &Material) -> (f64, f64) {
    let nu = material.poisson;
    let mu = material.young / (2.0 * (1.0 + nu));
    (mu, material.young * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)))
}

/// Strain E = R^T F - I = R^T G + (R^T - I) with F = I + G; the last term is computed from the quaternion's vector
/// part, so that nothing cancels.
pub fn strain(rotation: DQuat, gradient: DMat3) -> DMat3 {
    let v = DVec3::new(rotation.x, rotation.y, rotation.z);
    let cross = DMat3::from_cols(DVec3::new(0.0, v.z, -v.y), DVec3::new(-v.z, 0.0, v.x), DVec3::new(v.y, -v.x, 0.0));
    let minus_identity = cross * cross * 2.0 - cross * (2.0 * rotation.w);
    DMat3::from_quat(rotation).transpose() * gradient + minus_identity
}

/// The rotation nearest to F; where F is inverted (negative determinant), the direction of its least singular value is
/// flipped first.
pub fn polar_rotation(f: DMat3) -> DQuat {
    let matrix = Mat::from_fn(3, 3, |i, j| f.col(j)[i]);
    // A matrix with non-finite numbers has no decomposition. The identity is returned for it; the non-finite numbers
    // still show in the forces.
    let Ok(svd) = matrix.svd() else { return DQuat::IDENTITY };
    let to_glam = |m: faer::MatRef<'_, f64>| DMat3::from_cols_array(&std::array::from_fn(|k| m[(k % 3, k / 3)]));
    let (u, v) = (to_glam(svd.U()), to_glam(svd.V()));
    // faer sorts singular values in descending order: the last column is the direction of the least one.
    let flip = DVec3::new(1.0, 1.0, (u.determinant() * v.determinant()).signum());
    DQuat::from_mat3(&(u * DMat3::from_diagonal(flip) * v.transpose())).normalize()
}

/// Outer product a b^T.
pub fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// Cross product matrix of v, whose product with p is v x p.
pub(super) fn cross_matrix(v: DVec3) -> DMat3 {
    DMat3::from_cols(DVec3::new(0.0, v.z, -v.y), DVec3::new(-v.z, 0.0, v.x), DVec3::new(v.y, -v.x, 0.0))
}

/// Axial vector w of the skew part of a matrix: the skew part's product with p is w x p.
pub(super) fn axial(m: DMat3) -> DVec3 {
    0.5 * DVec3::new(m.y_axis.z - m.z_axis.y, m.z_axis.x - m.x_axis.z, m.x_axis.y - m.y_axis.x)
}

/// A symmetric matrix with its negative eigenvalues set to zero.
pub(super) fn positive_part(m: DMat3) -> DMat3 {
    let Ok(eigen) = Mat::from_fn(3, 3, |i, j| m.col(j)[i]).self_adjoint_eigen(Side::Lower) else { return m };
    let axis = |k: usize| DVec3::from_array(std::array::from_fn(|i| eigen.U()[(i, k)]));
    (0..3).fold(DMat3::ZERO, |sum, k| sum + outer(axis(k), axis(k)) * eigen.S()[k].max(0.0))
}

/// Square |M|^2 of the Frobenius norm.
pub(super) fn square(m: DMat3) -> f64 {
    m.to_cols_array().iter().map(|x| x * x).sum()
}

pub(super) fn symmetric(m: DMat3) -> DMat3 {
    (m + m.transpose()) * 0.5
}

pub(super) fn trace(m: DMat3) -> f64 {
    m.x_axis.x + m.y_axis.y + m.z_axis.z
}
