//! Fields that are computed from others where a series is written: principal values, and the deformation of tetrahedra.

use std::f64::consts::PI;

use glam::{DMat3, DVec3};

/// A symmetric matrix: xx, yy, zz, xy, yz, xz, the order of symmetric tensors in VTK files.
pub type Symmetric = [f64; 6];

/// Eigenvalues, the greatest first, by the trigonometric solution of the characteristic equation (Smith, "Eigenvalues of a
/// symmetric 3 x 3 matrix", 1961): the writer needs two for each tetrahedron of each moment, which iterative methods of
/// libraries take a step's time for.
pub fn eigenvalues([xx, yy, zz, xy, yz, xz]: Symmetric) -> [f64; 3] {
    let mean = (xx + yy + zz) / 3.0;
    let (a, b, c) = (xx - mean, yy - mean, zz - mean);
    let scale = ((a * a + b * b + c * c + 2.0 * (xy * xy + yz * yz + xz * xz)) / 6.0).sqrt();
    if scale == 0.0 {
        return [mean; 3];
    }
    let determinant = a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz);
    let angle = (0.5 * determinant / scale.powi(3)).clamp(-1.0, 1.0).acos() / 3.0;
    let greatest = mean + 2.0 * scale * angle.cos();
    let least = mean + 2.0 * scale * (angle + 2.0 * PI / 3.0).cos();
    [greatest, 3.0 * mean - greatest - least, least]
}

/// Least principal stretch of a tetrahedron, the least singular value of its deformation gradient; negative where the
/// tetrahedron is inside out. `rest`: inverse of the matrix of its edges at rest; `corners`: where its nodes are.
pub fn least_stretch(rest: DMat3, [a, b, c, d]: [DVec3; 4]) -> f64 {
    let f = DMat3::from_cols(b - a, c - a, d - a) * rest;
    let (x, y, z) = (f.x_axis, f.y_axis, f.z_axis);
    let [_, _, least] = eigenvalues([x.dot(x), y.dot(y), z.dot(z), x.dot(y), y.dot(z), x.dot(z)]);
    least.max(0.0).sqrt() * f.determinant().signum()
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;

    #[test]
    fn eigenvalues_are_those_that_the_matrix_was_made_of() {
        let turn = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::new(0.3, -1.1, 0.7)));
        for wanted in
            [[3.0, 1.0, -2.0], [1e6, 1e6, 1.0], [5.0, -4.0, -4.0], [1e-3, 0.0, 0.0], [2.0, 2.0, 2.0], [0.0; 3]]
        {
            let m = turn * DMat3::from_diagonal(DVec3::from(wanted)) * turn.transpose();
            let (x, y, z) = (m.x_axis, m.y_axis, m.z_axis);
            let got = eigenvalues([x.x, y.y, z.z, x.y, y.z, x.z]);
            let size = wanted.iter().fold(0.0f64, |size, x| size.max(x.abs()));
            // Two that are nearly equal are known to the root of the rounding.
            assert!(got.iter().zip(wanted).all(|(a, b)| (a - b).abs() <= 1e-7 * size), "{got:?} instead of {wanted:?}");
        }
    }

    #[test]
    fn the_least_stretch_is_that_of_the_deformation() {
        let rest = [DVec3::ZERO, DVec3::new(0.1, 0.01, 0.0), DVec3::new(0.0, 0.2, 0.02), DVec3::new(0.01, 0.0, 0.3)];
        let edges = DMat3::from_cols(rest[1] - rest[0], rest[2] - rest[0], rest[3] - rest[0]);
        let (a, b) = (DQuat::from_rotation_y(0.8), DQuat::from_rotation_x(-2.0));
        for least in [0.3, 0.99, -0.5] {
            let stretch = DMat3::from_diagonal(DVec3::new(1.5, least, 1.0));
            let f = DMat3::from_quat(a) * stretch * DMat3::from_quat(b);
            let got = least_stretch(edges.inverse(), rest.map(|x| f * x + DVec3::ONE));
            assert!((got - least).abs() < 1e-7, "{got} instead of {least}");
        }
    }
}
